"""What goes wrong in a PID controller, as edits of the worked answer."""

from drills.exercise import slips

SLIPS = slips(
    integral_not_stopped=("        if not deeper:\n            self.integral = integral",
        "        self.integral = integral",
        "The integral goes on while the command is held at its limit, and all of it has to be "
        "unwound before the joint turns back. Don't integrate while the command is cut off and "
        "the error pushes further out."),
    derivative_kick=("else measurement - self.last", "else self.last - (setpoint - measurement)",
        "self.last = measurement", "self.last = setpoint - measurement",
        "The derivative is taken of the error, so a step of the set-point is differentiated too: "
        "a kick of kd step / (tau + dt). Differentiate the measurement and subtract it."),
    derivative_not_filtered=("(self.tau * self.rate + change) / (self.tau + self.dt)",
        "change / self.dt",
        "The derivative is a bare difference. It multiplies the noise of the measurement by up "
        "to 2 / dt; tau asks for a low-pass before it."),
    integral_without_dt=("self.ki * error * self.dt", "self.ki * error",
        "The errors are summed without dt. The integral then grows 1 / dt times too fast, and "
        "with another sample time it is another controller."),
    derivative_without_dt=("+ change) /", "+ change * self.dt) /",
        "The difference of two measurements is not divided by dt, so the derivative is too small "
        "by that factor and does next to nothing."),
    output_not_limited=("min(max(wanted, self.u_min), self.u_max)", "wanted",
        "The command is handed out without its limits. The motor cuts it off anyway, and the "
        "controller doesn't know."),
    derivative_sign=("- self.kd * self.rate", "+ self.kd * self.rate",
        "The derivative has the wrong sign: it pushes the joint on instead of braking it. The "
        "error falls when the measurement rises, so it is - kd times the rate."),
    error_sign=("error = setpoint - measurement", "error = measurement - setpoint",
        "The error has the wrong sign: it is set-point minus measurement. This controller drives "
        "the joint away."),
    first_update_kick=("self.last: float | None = None", "self.last: float | None = 0.0",
        "The first update takes the derivative against a measurement of 0 that never was, so the "
        "loop starts with a spike. Remember that there is none yet."),
    filter_weights_swapped=("(self.tau * self.rate + change)",
        "(self.dt * self.rate + self.tau * change / self.dt)",
        "The low-pass has its weights the wrong way round: the old rate gets dt / (tau + dt) and "
        "the new difference tau / (tau + dt). A large tau then filters less, not more."),
    reset_keeps_integral=("self.integral = 0.0", 'self.integral = getattr(self, "integral", 0.0)',
        "reset leaves the integral as it was. The next run starts with the load of the last."),
    reset_keeps_derivative=("self.last: float | None = None",
        'self.last: float | None = getattr(self, "last", None)',
        "reset leaves the last measurement or the filtered rate as it was, so the next run "
        "starts with the derivative of a jump that never was."),
    integral_clamped_small=("            self.integral = integral",
        "            self.integral = min(max(integral, -0.2), 0.2)",
        "The integral is clamped to a range that is smaller than the command's. It can't carry a "
        "load beyond that, and an offset stays. Its range follows from u_min and u_max."),
    nan_accepted=("if not abs(value) < np.inf:", "if abs(value) < 0.0:",
        "A number that is NaN or infinite gets in, and every command after it is wrong. A "
        "comparison does not stop it: nan < 0 is false. Ask math.isfinite, in the constructor "
        "and in update, before anything is changed."),
)  # fmt: skip
