"""PID as a drive has it: the drill's controller and what stands around it, compiled.

With its defaults `update` gives the commands of `course.drills.PID` bit for bit; that text explains
the four choices in it. Here are the others: weights of the set-point, an observer or the true speed
for the rate, back-calculation, a limit of the command's rate, and changes without a bump (Astrom
and Hagglund, Advanced PID Control, 2006, ch. 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, one_of, positive, vector
from course.compiled import VECTOR, loop
from course.control.sampled import RATES, Law, pid_law

Array = NDArray[np.float64]
WINDUP = ("conditional", "back-calculation", "none")


@dataclass(frozen=True)
class Gains:
    """What is set at a controller; u is the command's unit, y the measurement's.

    Attributes:
        kp, ki, kd: [u/y, u/(y s), u s/y].
        tau: time constant of the rate's filter or observer [s].
        u_min, u_max: limits of the command [u], u_min < u_max.
        slew: largest change of the command [u/s].
        weight: share of the set-point in the proportional part, 0 to 1.
        rate_weight: that in the derivative: 1 is the derivative of the error, with its kick.
        rate: one of `course.control.sampled.RATES`.
        windup: "conditional" integration, "back-calculation", or "none" against it.
        tracking: time constant of back-calculation [s].
    """

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    tau: float = 0.0
    u_min: float = -math.inf
    u_max: float = math.inf
    slew: float = math.inf
    weight: float = 1.0
    rate_weight: float = 0.0
    rate: str = "filtered"
    windup: str = "conditional"
    tracking: float = 0.1

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "tau"):
            finite(name, getattr(self, name), 0.0)
        for name in ("weight", "rate_weight"):
            finite(name, getattr(self, name), 0.0, 1.0)
        if not self.u_min < self.u_max:
            raise invalid("u_min", self.u_min, f"a number below u_max = {self.u_max}")
        if not self.slew > 0.0:
            raise invalid("slew", self.slew, "a positive number")
        one_of("rate", self.rate, RATES)
        one_of("windup", self.windup, WINDUP)
        positive("tracking", self.tracking, unit="s")

    def numbers(self, dt: float) -> Array:
        """Return what `update` takes, shape (13,), for a sample time [s]."""
        return np.array(
            [
                self.kp,
                self.ki,
                self.kd,
                positive("dt", dt, unit="s"),
                self.u_min,
                self.u_max,
                self.tau,
                self.slew,
                self.weight,
                self.rate_weight,
                RATES.index(self.rate),
                WINDUP.index(self.windup),
                self.tracking,
            ],
            dtype=float,
        )

    def law(self, dt: float) -> Law:
        """Return the same without its limits, as a linear law."""
        return pid_law(self.kp, self.ki, self.kd, dt=dt, rate=self.rate, tau=self.tau)


def _advance_rate(kind, tau, dt, state, x, v):
    """Update the rate in state[1] with one more measurement x.

    State is (integral, rate, last, started, command).
    """
    if kind == 2:
        state[1] = v
    elif kind == 0 or state[3] == 0.0:
        # The first measurement has no predecessor: its rate is 0, not a jump from 0.
        change = 0.0 if state[3] == 0.0 else x - state[2]
        state[1] = (tau * state[1] + change) / (tau + dt)
        state[2] = x
    else:  # the observer: predict, then correct by what was missed
        # Double pole of the alpha-beta filter, as in `observer_gains`.
        pole = tau / (tau + dt)
        predicted = state[2] + dt * state[1]
        missed = x - predicted
        state[2] = predicted + (1.0 - pole * pole) * missed
        state[1] += (1.0 - pole) ** 2 / dt * missed
    state[3] = 1.0


_SCALAR = numba.float64
advance_rate = loop(_advance_rate, numba.void(_SCALAR, _SCALAR, _SCALAR, VECTOR, _SCALAR, _SCALAR))


def _update(numbers, state, setpoint, y, v):
    """Return the command of one sample.

    `numbers` as `Gains.numbers` gives them, the state in place.
    """
    kp, ki, kd, dt = numbers[0], numbers[1], numbers[2], numbers[3]
    u_min, u_max, tau, slew = numbers[4], numbers[5], numbers[6], numbers[7]
    weight, rate_weight, kind = numbers[8], numbers[9], numbers[10]
    windup, tracking = numbers[11], numbers[12]
    # With a weight of 0 the derivative acts on the measurement alone: no kick at a step.
    advance_rate(kind, tau, dt, state, y - rate_weight * setpoint, v)
    error = setpoint - y
    # Backward Euler: the integral includes the error of this sample.
    integral = state[0] + ki * error * dt
    desired = kp * (weight * setpoint - y) + integral - kd * state[1]
    # Limits of this sample: saturation and slew rate.
    low, high = max(u_min, state[4] - slew * dt), min(u_max, state[4] + slew * dt)
    command = min(max(desired, low), high)
    # Back-calculation: bleed the integral by what the limit cut off. Otherwise conditional
    # integration: stop integrating while the limit binds in the error's direction.
    if windup == 1.0:
        state[0] = integral + dt / tracking * (command - desired)
    elif windup == 2.0 or not ((desired > high and error > 0.0) or (desired < low and error < 0.0)):
        state[0] = integral
    state[4] = command
    return command


update = loop(_update, _SCALAR(VECTOR, VECTOR, _SCALAR, _SCALAR, _SCALAR))


class Controller:
    """A PID controller and its memory, for `course.drills.closed_loop` or a loop of one's own.

    Attributes:
        gains: what is set.
        dt: sample time [s].
        state: (integral [u], rate [y/s], last y, whether there was one, last command [u]).
    """

    def __init__(self, gains: Gains, dt: float) -> None:
        """Create a controller that has seen nothing yet; dt [s]."""
        self.gains, self.dt = gains, dt
        self._numbers = gains.numbers(dt)
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.state = np.zeros(5)

    def update(self, setpoint: float, measurement: float, speed: float = 0.0) -> float:
        """Return the command [u] for a wanted and a measured value [y].

        The speed is for rate "exact".

        Raises:
            ValueError: for a value that is not finite; the controller is then as it was before.
        """
        _finite(setpoint=setpoint, measurement=measurement, speed=speed)
        return float(update(self._numbers, self.state, setpoint, measurement, speed))

    def _without_integral(self, setpoint: float, measurement: float) -> float:
        g = self.gains
        return g.kp * (g.weight * setpoint - measurement) - g.kd * float(self.state[1])

    def change(self, gains: Gains, setpoint: float, measurement: float) -> None:
        """Other gains without a bump: the command for these values stays, by the integral."""
        _finite(setpoint=setpoint, measurement=measurement)
        # Bumpless transfer: the integral takes up the difference.
        before = self._without_integral(setpoint, measurement)
        self.gains, self._numbers = gains, gains.numbers(self.dt)
        self.state[0] += before - self._without_integral(setpoint, measurement)

    def take_over(self, command: float, setpoint: float, measurement: float) -> None:
        """Go from manual to automatic without a bump: the next command continues a person's [u]."""
        _finite(command=command, setpoint=setpoint, measurement=measurement)
        self.state[1:] = 0.0, measurement - self.gains.rate_weight * setpoint, 1.0, command
        # Solve for the integral with which the next command equals the last manual one.
        integrated = self.gains.ki * (setpoint - measurement) * self.dt
        self.state[0] = command - self._without_integral(setpoint, measurement) - integrated


def _finite(**values: float) -> None:
    for name, value in values.items():
        finite(name, value)


def rates(y: ArrayLike, dt: float, rate: str = "filtered", tau: float = 0.0) -> Array:
    """Return the rates that a controller computes from measurements y, shape (n,) [y/s].

    Args:
        y: measurements, one a sample.
        dt: sample time [s].
        rate: as for `Gains`, except "exact".
        tau: as for `Gains` [s].
    """
    values = vector("y", y, (None,))
    kind = float(RATES.index(one_of("rate", rate, RATES[:2])))
    positive("dt", dt, unit="s")
    finite("tau", tau, 0.0, unit="s")
    state, result = np.zeros(5), np.empty(values.size)
    for i, x in enumerate(values.tolist()):
        advance_rate(kind, tau, dt, state, x, 0.0)
        result[i] = state[1]
    return result
