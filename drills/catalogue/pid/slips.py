"""What goes wrong in a PID controller, as edits of the worked answer."""

from drills.exercise import Slip

SLIPS = (
    Slip(
        "integral_not_stopped",
        "The integral goes on while the command is held at its limit, and all of it has to be "
        "unwound before the joint turns back. Don't integrate while the command is cut off "
        "and the error pushes further out.",
        edits=(
            (
                "        if not deeper:\n            self.integral = integral",
                "        self.integral = integral",
            ),
        ),
    ),
    Slip(
        "derivative_kick",
        "The derivative is taken of the error, so a step of the set-point is differentiated "
        "too: a kick of kd step / (tau + dt). Differentiate the measurement and subtract it.",
        edits=(
            ("else measurement - self.last", "else self.last - (setpoint - measurement)"),
            ("self.last = measurement", "self.last = setpoint - measurement"),
        ),
    ),
    Slip(
        "derivative_not_filtered",
        "The derivative is a bare difference. It multiplies the noise of the measurement by up "
        "to 2 / dt; tau asks for a low-pass before it.",
        edits=(("(self.tau * self.rate + change) / (self.tau + self.dt)", "change / self.dt"),),
    ),
    Slip(
        "integral_without_dt",
        "The errors are summed without dt. The integral then grows 1 / dt times too fast, and "
        "with another sample time it is another controller.",
        edits=(("self.ki * error * self.dt", "self.ki * error"),),
    ),
    Slip(
        "derivative_without_dt",
        "The difference of two measurements is not divided by dt, so the derivative is too "
        "small by that factor and does next to nothing.",
        edits=(("+ change) /", "+ change * self.dt) /"),),
    ),
    Slip(
        "output_not_limited",
        "The command is handed out without its limits. The motor cuts it off anyway, and the "
        "controller doesn't know.",
        edits=(("min(max(wanted, self.u_min), self.u_max)", "wanted"),),
    ),
    Slip(
        "derivative_sign",
        "The derivative has the wrong sign: it pushes the joint on instead of braking it. The "
        "error falls when the measurement rises, so it is - kd times the rate.",
        edits=(("- self.kd * self.rate", "+ self.kd * self.rate"),),
    ),
    Slip(
        "error_sign",
        "The error has the wrong sign: it is set-point minus measurement. This controller "
        "drives the joint away.",
        edits=(("error = setpoint - measurement", "error = measurement - setpoint"),),
    ),
    Slip(
        "first_update_kick",
        "The first update takes the derivative against a measurement of 0 that never was, so "
        "the loop starts with a spike. Remember that there is none yet.",
        edits=(
            (
                "self.last: float | None = None",
                "self.last: float | None = 0.0",
            ),
        ),
    ),
    Slip(
        "filter_weights_swapped",
        "The low-pass has its weights the wrong way round: the old rate gets dt / (tau + dt) "
        "and the new difference tau / (tau + dt). A large tau then filters less, not more.",
        edits=(
            (
                "(self.tau * self.rate + change)",
                "(self.dt * self.rate + self.tau * change / self.dt)",
            ),
        ),
    ),
    Slip(
        "reset_keeps_integral",
        "reset leaves the integral as it was. The next run starts with the load of the last.",
        edits=(
            (
                "self.integral = 0.0",
                'self.integral = getattr(self, "integral", 0.0)',
            ),
        ),
    ),
    Slip(
        "reset_keeps_derivative",
        "reset leaves the last measurement or the filtered rate as it was, so the next run "
        "starts with the derivative of a jump that never was.",
        edits=(
            (
                "self.last: float | None = None",
                'self.last: float | None = getattr(self, "last", None)',
            ),
        ),
    ),
    Slip(
        "integral_clamped_small",
        "The integral is clamped to a range that is smaller than the command's. It can't carry "
        "a load beyond that, and an offset stays. Its range follows from u_min and u_max.",
        edits=(
            (
                "            self.integral = integral",
                "            self.integral = min(max(integral, -0.2), 0.2)",
            ),
        ),
    ),
    Slip(
        "nan_accepted",
        "A number that is NaN or infinite gets in, and every command after it is wrong. A "
        "comparison does not stop it: nan < 0 is false. Ask math.isfinite, in the constructor and "
        "in update, before anything is changed.",
        edits=(("if not abs(value) < np.inf:", "if abs(value) < 0.0:"),),
    ),
)
