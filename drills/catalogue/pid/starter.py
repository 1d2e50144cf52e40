class PID:
    """A sampled PID controller with output limits, anti-windup and a filtered derivative."""

    def __init__(self, kp, ki, kd, dt, u_min, u_max, tau):
        """Set the gains.

        Args:
            kp, ki, kd: gains [N m/rad, N m/(rad s), N m s/rad].
            dt: time from one update to the next [s].
            u_min, u_max: limits of the command [N m].
            tau: time constant of the derivative's low-pass [s].
        """
        self.kp, self.ki, self.kd = kp, ki, kd
        self.dt, self.tau = dt, tau
        self.u_min, self.u_max = u_min, u_max
        self.reset()

    def reset(self):
        """Forget the past."""

    def update(self, setpoint, measurement):
        """Return the command for the sample that begins now [N m].

        Args:
            setpoint: wanted angle [rad].
            measurement: angle now [rad].
        """
        # The proportional part alone: it stops short of the set-point under a load.
        return self.kp * (setpoint - measurement)
