"""What goes wrong in a PID controller, as edits of the worked answer."""

from drills.exercise import slips

SLIPS = slips(
    integral_not_stopped=(
        "        if not deeper:\n            self.integral = integral",
        "        self.integral = integral",
        "The integral goes on while the command is held at its limit, and all of it has to be "
        "unwound before the joint turns back. Don't integrate while the command is cut off and "
        "the error pushes further out.",
    ),
    integral_frozen=(
        "integral = self.integral + self.ki * error * self.dt",
        "integral = self.integral",
        "        if not deeper:\n            self.integral = integral",
        "        if desired == command:\n"
        "            self.integral = integral + self.ki * error * self.dt",
        "The integral stands still whenever the command is at its limit, also when the error "
        "would bring it back: an integral that alone holds the limit stays there for ever. Stop "
        "it only while the error pushes further out.",
    ),
    integral_frozen_when_cut_off=(
        "        if not deeper:\n",
        "        if desired == command:\n",
        "The integral stands still whenever the command is cut off, whatever the sign of the "
        "error. Once the derivative has let the integral grow beyond the limit, the command "
        "never comes back. Stop the integral only while the error pushes further out.",
    ),
    clamped_increments=(
        "self.rate = 0.0  # [y/s]",
        "self.rate = self.command = self.parts = 0.0",
        "        desired = self.kp * error + integral - self.kd * self.rate\n",
        "        parts = self.kp * error - self.kd * self.rate\n"
        "        desired = self.command + parts - self.parts + self.ki * error * self.dt\n"
        "        self.parts = parts\n",
        "        return float(command)",
        "        self.command = command\n        return command",
        "What the limit cut off is missing afterwards: increments are added to a command that was "
        "cut. Without an integral the command is kp e, whatever came before; limit what you "
        "return, and keep the sum of the parts.",
    ),
    arguments_swapped=(
        "def update(self, setpoint: float, measurement: float)",
        "def update(self, measurement: float, setpoint: float)",
        "Set-point and measurement are taken for each other: the error has the wrong sign and the "
        "set-point is differentiated. The task says update(setpoint, measurement).",
    ),
    symmetric_limits=(
        "max(desired, self.u_min)",
        "max(desired, -self.u_max)",
        "The command is limited to the same size on both sides. The limits need not be "
        "symmetric: u_min below, u_max above.",
    ),
    arguments_unchecked=(
        "            if not 0.0 <= value < np.inf:",
        "            if value != value:",
        "if not 0.0 < dt < np.inf:",
        "if dt != dt:",
        "if not u_min < u_max:",
        "if u_min != u_min:",
        "The constructor takes numbers that make no controller: a negative gain, a dt of zero, "
        "limits that leave nothing between them. Raise ValueError there; later nobody knows "
        "where the nonsense came from.",
    ),
    changed_before_refusal=(
        '        for name, value in (("setpoint", setpoint), ("measurement", measurement)):\n',
        "        before, self.last = self.last, measurement\n"
        '        for name, value in (("setpoint", setpoint), ("measurement", measurement)):\n',
        "change = 0.0 if self.last is None else measurement - self.last",
        "change = 0.0 if before is None else measurement - before",
        "The update is refused, but too late: something of it was kept before, and the next "
        "commands are others. Check the arguments first, then change the state.",
    ),
    proportional_missing=(
        "self.kp * error + integral",
        "integral",
        "The proportional part is missing: with kp alone the command stays at zero.",
    ),
    limits_swapped=(
        "min(max(desired, self.u_min), self.u_max)",
        "max(min(desired, self.u_min), self.u_max)",
        "The limits are taken for each other: whatever is wanted, a limit comes out. Not below "
        "u_min and not above u_max: min(max(u, u_min), u_max).",
    ),
    dt_twice_in_integral=(
        "self.ki * error * self.dt",
        "self.ki * error * self.dt**2",
        "The integral grows with dt squared: dt is multiplied twice, perhaps in the sum and once "
        "more where it is used.",
    ),
    integral_gain_missing=(
        "self.ki * error * self.dt",
        "error * self.dt",
        "The integral grows by e dt in a sample: its gain ki is missing.",
    ),
    derivative_gain_missing=(
        "self.kd * self.rate",
        "self.rate",
        "The derivative enters the command without its gain kd, also where that is 0.",
    ),
    integral_of_the_measurement=(
        "self.ki * error * self.dt",
        "self.ki * measurement * self.dt",
        "The measurement is integrated where the error is due.",
    ),
    derivative_of_the_setpoint=(
        "measurement - self.last",
        "setpoint - self.last",
        "self.last = measurement",
        "self.last = setpoint",
        "The set-point is differentiated. A joint that moves gets no damping from that: "
        "differentiate the measurement.",
    ),
    whole_numbers=(
        "return float(command)",
        "return int(command)",
        "The command loses the digits behind its point: return a float.",
    ),
    state_of_the_class=(
        "self.integral = 0.0",
        "PID.integral = 0.0",
        "            self.integral = integral",
        "            PID.integral = integral",
        "Two controllers share something: it is an attribute of the class, not of the object. Keep "
        "the state in self.",
    ),
    derivative_kick=(
        "else measurement - self.last",
        "else self.last - (setpoint - measurement)",
        "self.last = measurement",
        "self.last = setpoint - measurement",
        "The derivative is taken of the error, so a step of the set-point is differentiated too: "
        "a kick of kd step / (tau + dt). Differentiate the measurement and subtract it.",
    ),
    derivative_not_filtered=(
        "(self.tau * self.rate + change) / (self.tau + self.dt)",
        "change / self.dt",
        "The derivative is a bare difference. It multiplies the noise of the measurement by up "
        "to 2 / dt; tau asks for a low-pass before it.",
    ),
    integral_without_dt=(
        "self.ki * error * self.dt",
        "self.ki * error",
        "The errors are summed without dt. The integral then grows 1 / dt times too fast, and "
        "with another sample time it is another controller.",
    ),
    derivative_without_dt=(
        "+ change) /",
        "+ change * self.dt) /",
        "The difference of two measurements is not divided by dt, so the derivative is too small "
        "by that factor and does next to nothing.",
    ),
    output_not_limited=(
        "min(max(desired, self.u_min), self.u_max)",
        "desired",
        "The command is handed out without its limits. The motor cuts it off anyway, and the "
        "controller doesn't know.",
    ),
    derivative_sign=(
        "- self.kd * self.rate",
        "+ self.kd * self.rate",
        "The derivative has the wrong sign: it pushes the joint on instead of braking it. The "
        "error falls when the measurement rises, so it is - kd times the rate.",
    ),
    error_sign=(
        "error = setpoint - measurement",
        "error = measurement - setpoint",
        "The error has the wrong sign: it is set-point minus measurement. This controller drives "
        "the joint away.",
    ),
    first_update_kick=(
        "self.last: float | None = None",
        "self.last: float | None = 0.0",
        "The first update takes the derivative against a measurement of 0 that never was, so the "
        "loop starts with a spike. Remember that there is none yet.",
    ),
    filter_weights_swapped=(
        "(self.tau * self.rate + change)",
        "(self.dt * self.rate + self.tau * change / self.dt)",
        "The low-pass has its weights the wrong way round: the old rate gets dt / (tau + dt) and "
        "the new difference tau / (tau + dt). A large tau then filters less, not more.",
    ),
    reset_keeps_integral=(
        "self.integral = 0.0",
        'self.integral = getattr(self, "integral", 0.0)',
        "reset leaves the integral as it was. The next run starts with the load of the last.",
    ),
    reset_keeps_derivative=(
        "self.last: float | None = None",
        'self.last: float | None = getattr(self, "last", None)',
        "reset leaves the last measurement or the filtered rate as it was, so the next run "
        "starts with the derivative of a jump that never was.",
    ),
    integral_clamped_small=(
        "            self.integral = integral",
        "            self.integral = min(max(integral, -0.2), 0.2)",
        "The integral is clamped to a range that is smaller than the command's. It can't carry a "
        "load beyond that, and an offset stays. Its range follows from u_min and u_max.",
    ),
    nan_accepted=(
        "if not abs(value) < np.inf:",
        "if abs(value) < 0.0:",
        "A number that is NaN or infinite gets in, and every command after it is wrong. A "
        "comparison does not stop it: nan < 0 is false. Ask math.isfinite, in the constructor "
        "and in update, before anything is changed.",
    ),
)
