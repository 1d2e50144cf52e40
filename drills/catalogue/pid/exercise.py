"""PID: judged by what it does, so that any sensible discretisation and anti-windup is right.

The joint is stepped in this process; the submission maps set-point and measurement to a command.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.cards import definitions
from drills.case_judge import Stage, staged
from drills.catalogue.pid.chart import SETPOINT, WIDE, sampled
from drills.catalogue.pid.slips import SLIPS
from drills.chart import chart_of
from drills.exercise import Exercise
from drills.grade_report import Shown
from drills.sandbox import Handle, Limits
from drills.values import as_float64, describe

Array = NDArray[np.float64]

ENTRY = "PID"
# Sample times [s] and the speed of the loop's poles [rad/s] on the exact joint; each run lasts
# LONG over the speed.
RATES = ((0.02, 8.0), (0.01, 11.0), (0.005, 16.0))
JAM_RATE = 0.01, 11.0
JAM = 1.0  # s, as the prompt says
LONG = 11.0
BAND = 0.1  # of the step
OVERSHOOT = 1.0  # of the step
EXACT = 1e-5  # N m
ROUNDING = "a handful of products and sums: their rounding, in single precision at worst"
GIVEN = (
    definitions(Path(__file__).parents[3] / "course" / "drills.py", ["ExactJoint", "closed_loop"])
    + """

def run(controller, setpoints, measurements):
    return [controller.update(w, y) for w, y in zip(setpoints, measurements)]


def updates(controller, count):
    for i in range(count):
        controller.update(0.5, 1e-4 * (i % 100))


def drive(gains, dt, limit, tau, inertia, damping, setpoint, count):
    from submission import PID

    controller = PID(*gains, dt, -limit, limit, tau)
    joint = ExactJoint(inertia, damping, dt)
    return closed_loop(controller, joint, [setpoint] * count)[0]
"""
)


@dataclass(frozen=True)
class Numbers:
    """The constructor's arguments."""

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    dt: float = 0.005
    u_min: float = -WIDE
    u_max: float = WIDE
    tau: float = 0.02

    def arguments(self) -> tuple[float, ...]:
        """Return the constructor's arguments in their order."""
        return self.kp, self.ki, self.kd, self.dt, self.u_min, self.u_max, self.tau


class Controller:
    """One controller of the submission."""

    def __init__(self, attempt: Attempt, numbers: Numbers) -> None:
        self.attempt = attempt
        self.numbers = numbers
        self.handle: Handle = attempt.learner.new(ENTRY, *numbers.arguments())
        self.over = 0.0  # N m, by which a command of `update` passed its limit

    def update(self, setpoint: float, measurement: float) -> float:
        """Return one command, clipped as the motor does it.

        A command that is not a finite number ends the grading.
        """
        got = self.attempt.learner.method(self.handle, "update", setpoint, measurement)
        command = got if type(got) is float and math.isfinite(got) else _number(got)
        low, high = self.numbers.u_min, self.numbers.u_max
        self.over = max(self.over, command - high, low - command)
        return min(max(command, low), high)

    def run(self, setpoints: Any, measurements: Any) -> Array:
        """Run two sequences, or a sequence and a number, in one request; return the commands."""
        w, y = np.broadcast_arrays(setpoints, measurements)
        learner = self.attempt.learner
        got = learner.given("run", self.handle, w.tolist(), y.tolist())
        if isinstance(got, list):
            for command in got:
                _number(command)
        return as_float64(got, w.shape, "the list of commands")

    def compare(self, name: str, got: Any, expected: Any, **more: Any) -> bool:
        """Check commands."""
        text: dict[str, Any] = {
            "tolerance": EXACT,
            "why": ROUNDING,
            "unit": "N m",
            "call": self.call,
            **more,
        }
        right = self.attempt.compare(name, got, expected, **text)
        if not right and np.size(got) > 2:
            self.show(name, "command [N m]", got, expected)
        return right

    def show(self, name: str, what: str, got: Any, expected: Any) -> None:
        """Keep the first response that is wrong, for the picture."""
        if self.attempt.report.shown is None:
            times = self.numbers.dt * np.arange(np.size(got))
            self.attempt.report.shown = Shown(name, (times, what), got, expected)

    def require(self, name: str, holds: bool, **more: Any) -> bool:
        """Check a property of commands."""
        text: dict[str, Any] = {"unit": "N m", "call": self.call, **more}
        return self.attempt.require(name, holds, **text)

    def reset(self) -> None:
        """Reset it."""
        self.attempt.learner.method(self.handle, "reset")

    @property
    def call(self) -> str:
        """How it was made, and that it was updated."""
        inside = ", ".join(f"{value:.6g}" for value in self.numbers.arguments())
        return f"PID({inside}).update(...)"


def _number(got: Any) -> float:
    return float(as_float64(got, (), "the command"))


# --- each part alone ------------------------------------------------------------------------------


def _proportional(attempt: Attempt) -> None:
    rng = attempt.rng
    controller = Controller(attempt, Numbers(kp=float(rng.uniform(1.0, 9.0))))
    setpoints, measurements = rng.uniform(-2.0, 2.0, (2, 6))
    expected = controller.numbers.kp * (setpoints - measurements)
    got = controller.run(setpoints, measurements)
    slip = ""
    if _near(got, -expected):
        # Which of the two is differentiated tells a wrong sign from arguments in the wrong order.
        ramp = Controller(attempt, Numbers(kd=1.0)).run(0.1 * np.arange(4.0), 0.0)
        slip = "arguments_swapped" if np.any(np.abs(ramp[1:]) > 1e-3) else "error_sign"
    elif np.array_equal(got, np.trunc(expected)):
        slip = "whole_numbers"
    elif not np.any(got):
        slip = "proportional_missing"
    elif np.all(np.abs(got) == WIDE):
        slip = "limits_swapped"
    controller.compare("proportional part alone", got, expected, slip=slip)


def _integral(attempt: Attempt) -> None:
    """Check a constant error, then another: any rule of summing gives these differences."""
    rng = attempt.rng
    numbers = Numbers(ki=float(rng.uniform(5.0, 30.0)), dt=float(rng.uniform(0.002, 0.008)))
    controller = Controller(attempt, numbers)
    # so small that a clamp shows as one: the gain of a sample is a few hundredths
    first, second = rng.uniform([0.015, -0.02], [0.03, -0.01]) / (numbers.ki * numbers.dt)
    got = controller.run(np.repeat([first, second], (25, 20)), 0.0)
    steps = np.diff(got)
    # Where the error changes, rules differ: a sample earlier, later, or half of both.
    retained = np.r_[2:23, 26:44]
    errors = np.repeat([first, second], (21, 18))
    expected = numbers.ki * errors * numbers.dt
    slip = ""
    if _near(steps[retained], numbers.ki * errors):
        slip = "integral_without_dt"
    elif _near(steps[retained] / numbers.dt, numbers.ki * errors * numbers.dt):
        slip = "dt_twice_in_integral"
    elif _near(steps[retained], errors * numbers.dt):
        slip = "integral_gain_missing"
    elif _flattens(steps[:24], expected[0]):
        slip = "integral_clamped_small"
    elif not np.any(got):
        slip = "integral_of_the_measurement"  # it is zero all the time
    right = controller.compare(
        "what the integral gains in a sample", steps[retained], expected, slip=slip
    )
    if right:
        error, allowed = abs(got[24] - 25.0 * expected[0]), expected[0] * 1.01
        controller.require(
            "the integral begins at zero",
            bool(error <= allowed),
            sentence=f"After 25 samples the command is {got[24]:.6g} N m.",
            got=f"{got[24]:.6g}",
            expected=f"{25.0 * expected[0]:.6g}",
            error=float(error),
            tolerance=float(allowed),
            why="rules of summing differ by one sample",
        )


def _flattens(steps: Array, gain: float) -> bool:
    """Return whether what is added is right at first and then nothing at all."""
    right, nothing = np.isclose(steps, gain, rtol=1e-9), np.abs(steps) < 1e-12
    stop = int(np.argmax(nothing))
    begun = stop > 3 and np.all(right[2 : stop - 1])
    return bool(np.any(nothing) and begun and np.all(nothing[stop:]))


def _derivative(attempt: Attempt) -> None:
    """Check a ramp of the measurement: none at first, 63 % after tau, the slope in the end."""
    rng = attempt.rng
    ratio = int(rng.integers(5, 9))
    dt = float(rng.uniform(0.002, 0.008))
    numbers = Numbers(kd=float(rng.uniform(0.5, 3.0)), dt=dt, tau=ratio * dt)
    controller = Controller(attempt, numbers)
    slope = float(rng.uniform(0.5, 2.0)) * float(rng.choice([-1.0, 1.0]))
    start = float(rng.uniform(0.5, 1.5)) * float(rng.choice([-1.0, 1.0]))
    got = controller.run(0.0, start + slope * dt * np.arange(12 * ratio))
    full = -numbers.kd * slope
    share = got / full
    spike = -numbers.kd * start / full
    at_start = spike / (dt * (ratio + 1)), spike / (dt * ratio)
    controller.compare(
        "no derivative at the first update",
        got[0],
        0.0,
        slip="first_update_kick" if _between(share[0], *at_start) else "",
    )
    if attempt.failed:
        return
    last = float(got[-1])
    slip = "derivative_sign" if abs(last + full) <= 0.01 * abs(full) else ""
    if abs(last / full / dt - 1.0) <= 0.01:
        slip = "derivative_without_dt"
    elif abs(last + slope) <= 0.01 * abs(slope):
        slip = "derivative_gain_missing"
    right = controller.compare(
        "derivative of a long ramp",
        last,
        full,
        tolerance=0.01 * abs(full),
        why="after 12 tau a first-order low-pass is within 1e-4 of the slope",
        slip=slip,
    )
    if not right:
        return
    slip = ""
    if abs(share[1] - 1.0) <= 1e-9:
        slip = "derivative_not_filtered"
    elif abs(share[1] - ratio / (ratio + 1.0)) <= 1e-9:
        slip = "filter_weights_swapped"
    # From one backward step less than tau to the last forward step: 1 - (r / (r + 1))^(r - 1)
    # and 1 - (1 - 1 / r)^r lie within; the exact low-pass gives 0.632.
    observed = float(share[ratio])
    error = abs(observed - 0.632)
    attempt.require(
        "the low-pass takes its time",
        bool(error <= 0.13),
        sentence=f"After tau the derivative of a ramp is at {observed:.1%} of its final value.",
        got=f"{observed:.4g}",
        expected="about 0.632",
        error=error,
        tolerance=0.13,
        unit="1",
        why="ways to discretise the low-pass differ by this much at tau = 5 dt",
        call=controller.call,
        slip=slip,
    )


def _kick(attempt: Attempt) -> None:
    """Check a step of the set-point: proportional part, and a sample of the integral at most."""
    rng = attempt.rng
    dt = float(rng.uniform(0.002, 0.008))
    kp, ki, kd = (float(rng.uniform(low, 3.0 * low)) for low in (2.0, 5.0, 0.5))
    numbers = Numbers(kp, ki, kd, dt, tau=dt * float(rng.uniform(2.0, 6.0)))
    controller = Controller(attempt, numbers)
    at, step = (float(value) for value in rng.uniform(0.5, 1.5, 2))
    setpoints = np.r_[np.full(4, at), np.full(4, at + step)]
    got = controller.run(setpoints, at)
    extra = got[4:] - kp * step
    low, high = ki * step * dt * np.arange(4.0), ki * step * dt * np.arange(1.0, 5.0)
    error = float(np.max(np.maximum(low - extra, extra - high)))
    kick = kd * step
    from_kick = kick / (numbers.tau + dt), kick / numbers.tau + high[0]
    controller.require(
        "a step of the set-point makes no kick",
        bool(error <= EXACT) and bool(np.max(np.abs(got[:4])) <= EXACT),
        sentence=f"When the set-point steps by {step:.4g} rad, the command goes to {got[4]:.6g} "
        f"N m; the proportional part is {kp * step:.6g} N m.",
        got=describe(got[4:]),
        expected=f"{kp * step:.6g} N m and at most {high[0]:.4g} N m more with each sample",
        error=max(error, 0.0),
        tolerance=EXACT,
        why=ROUNDING,
        slip="derivative_kick" if _between(extra[0], *from_kick) else "",
    )


# --- limits, memory, refusals ---------------------------------------------------------------------


def _limits(attempt: Attempt) -> None:
    rng = attempt.rng
    numbers = Numbers(
        kp=float(rng.uniform(2.0, 6.0)),
        u_min=-float(rng.uniform(1.0, 2.0)),
        u_max=float(rng.uniform(3.0, 5.0)),
    )
    for far in (float(rng.uniform(8.0, 20.0)), -float(rng.uniform(8.0, 20.0))):
        # The limit comes last and once: what back-calculation makes of it is free.
        controller = Controller(attempt, numbers)
        errors = np.array([0.1, -0.1, far])
        got = controller.run(errors, 0.0)
        free = numbers.kp * errors
        one_size = (abs(numbers.u_min), numbers.u_max)
        slip = "output_not_limited" if _near(got, free) else ""
        if any(_near(got, np.clip(free, -size, size)) for size in one_size):
            slip = "symmetric_limits"
        controller.compare(
            "the command keeps its limit",
            got,
            np.clip(free, numbers.u_min, numbers.u_max),
            slip=slip,
        )


def _after_limits(attempt: Attempt) -> None:
    """Check without an integral nothing is remembered of a command that was cut off."""
    for side in (1.0, -1.0):
        limit = float(attempt.rng.uniform(4.0, 6.0))
        numbers = Numbers(kp=float(attempt.rng.uniform(1.5, 2.5)), u_min=-limit, u_max=limit)
        controller = Controller(attempt, numbers)
        free = side * limit * np.array([0.2, 1.7, 0.3])
        got = controller.run(free / numbers.kp, 0.0)
        cut = 0.7 * limit
        error, allowed = abs(float(got[2] - free[2])), 0.5 * cut
        clamped = abs(got[2] - (free[2] - side * cut)) <= 1e-9 * limit
        controller.require(
            "nothing is left of a command that was cut off",
            bool(error <= allowed),
            sentence=f"With ki = kd = 0 the command after one at its limit is {got[2]:.6g} N m; "
            f"kp e is {free[2]:.6g} N m.",
            got=f"{got[2]:.6g}",
            expected=f"{free[2]:.6g}",
            error=error,
            tolerance=allowed,
            why="half of what was cut off, as kinds of anti-windup differ",
            slip="clamped_increments" if clamped else "",
        )


def _memory(attempt: Attempt) -> None:
    """Reset: first each part alone, which says what was kept; then everything at once."""
    rng = attempt.rng
    at, other = (float(value) for value in rng.uniform(0.4, 1.5, 2) * [1.0, -1.0])
    for name, numbers, slip in (
        ("reset forgets the integral", Numbers(ki=7.0), "reset_keeps_integral"),
        ("reset forgets the derivative", Numbers(kd=1.5), "reset_keeps_derivative"),
    ):
        controller, never = Controller(attempt, numbers), Controller(attempt, numbers)
        for one in (controller, never):
            one.run([at, at, other], [other, at, other])
        controller.reset()
        got, retained = controller.update(at, at), never.update(at, at)
        if abs(got - retained) > 1e-9 * (1.0 + abs(retained)):
            slip = ""  # it did forget something
        controller.compare(name, got, 0.0, slip=slip)
    if attempt.failed:
        return
    numbers = Numbers(4.0, 20.0, 0.3, 0.004, -3.0, 2.0, 0.012)
    setpoints, measurements = rng.uniform(-0.4, 0.4, (2, 12))
    alone = Controller(attempt, numbers).run(setpoints, measurements)
    used, second = Controller(attempt, numbers), Controller(attempt, numbers)
    used.run(measurements, setpoints)
    used.reset()
    again = []
    for setpoint, measurement in zip(setpoints.tolist(), measurements.tolist(), strict=True):
        again.append(used.update(setpoint, measurement))
        second.update(
            measurement, setpoint
        )  # in turns: two that share something disturb each other
    _same(
        attempt,
        "a reset controller is a new one, and two share nothing",
        np.array(again),
        alone,
        "Used and reset, and in turns with another one, the controller gives other commands than "
        "a new one alone.",
        used,
    )


def _same(
    attempt: Attempt,
    name: str,
    got: Array,
    expected: Array,
    sentence: str,
    controller: Controller,
    slip: str = "",
) -> None:
    """Check two controllers that must do the same sums: the same bits."""
    controller.require(
        name,
        bool(np.array_equal(got, expected)),
        sentence=sentence,
        got=describe(got),
        expected=describe(expected),
        error=float(np.max(np.abs(got - expected))),
        tolerance=0.0,
        why="the same sums of the same numbers",
        slip=slip,
    )


def _refusals(attempt: Attempt) -> None:
    good = Numbers(2.0, 3.0, 0.4, 0.01, -2.0, 2.0, 0.03)
    order = list(Numbers.__dataclass_fields__)
    bad = [
        ("dt", 0.0, "dt is 0"),
        ("dt", -0.01, "dt is negative"),
        ("tau", -0.01, "tau is negative"),
        ("u_min", 2.0, "the limits are equal"),
        ("u_max", -5.0, "the limits are the wrong way round"),
        (str(attempt.rng.choice(["kp", "ki", "kd"])), -1.0, "a gain is negative"),
        (str(attempt.rng.choice(["kp", "ki", "kd", "dt", "tau"])), math.nan, "a number is NaN"),
    ]
    for name, value, what in bad:
        arguments = list(good.arguments())
        arguments[order.index(name)] = value
        attempt.require_error(
            f"refused: {what}",
            functools.partial(attempt.learner.new, ENTRY, *arguments),
            sentence=f"A controller was made although {what}.",
            call=f"PID({', '.join(f'{argument:.4g}' for argument in arguments)})",
            slip="nan_accepted" if math.isnan(value) else "arguments_unchecked",
        )
    controller, twin = Controller(attempt, good), Controller(attempt, good)
    for one in (controller, twin):
        one.run(1.0, [0.2, 0.3])
    for pair in ((0.5, math.nan), (math.inf, 2.3)):
        attempt.require_error(
            "refused: an update with a number that is not finite",
            functools.partial(attempt.learner.method, controller.handle, "update", *pair),
            sentence="A set-point or measurement that is not finite was accepted.",
            call=f"update({pair[0]:g}, {pair[1]:g})",
            slip="nan_accepted",
        )
    if attempt.failed:
        return
    # Controllers that share a state differ without any refusal.
    apart = [Controller(attempt, good) for _ in range(2)]
    for one in apart:
        one.run(1.0, [0.2, 0.3])
    alike = np.array_equal(apart[0].run(0.9, [0.4, 0.5]), apart[1].run(0.9, [0.4, 0.5]))
    _same(
        attempt,
        "a refused update leaves no trace",
        controller.run(0.9, [0.4, 0.5]),
        twin.run(0.9, [0.4, 0.5]),
        "After a refused update the commands are others than without it.",
        controller,
        "changed_before_refusal" if alike else "",
    )


# --- the integral at the limit --------------------------------------------------------------------


def _windup(attempt: Attempt) -> None:
    """Check the integral reaches either limit; how it leaves is kept for the jam to judge."""
    for sign in (1.0, -1.0):
        numbers = Numbers(kp=1.2, ki=14.0, u_min=-5.0, u_max=4.0)
        controller = Controller(attempt, numbers)
        limit = numbers.u_max if sign > 0.0 else -numbers.u_min
        got = sign * controller.run(np.full(90, sign), 0.0)
        gain = numbers.ki * numbers.dt
        error = float(limit - got[-1])
        controller.require(
            "the integral can carry as much as the limits allow",
            bool(error <= 2.0 * gain),
            sentence=f"Under a constant error the command stops at {sign * got[-1]:.4g} N m; the "
            f"limit is {sign * limit:.4g} N m.",
            got=f"{sign * got[-1]:.6g}",
            expected=f"{sign * limit:.6g}",
            error=max(error, 0.0),
            tolerance=2.0 * gain,
            why="what the integral gains in two samples",
            slip="integral_clamped_small" if _flattens(np.diff(got), gain) else "",
        )


def _leaves_limit(attempt: Attempt) -> None:
    """Check that the integral leaves the limit when the error changes sign.

    The integral alone holds the command at that limit.
    """
    for side in (1.0, -1.0):
        numbers = Numbers(ki=float(attempt.rng.uniform(9.0, 12.0)), kd=1.0, u_min=-5.0, u_max=5.0)
        controller = Controller(attempt, numbers)
        gain = numbers.ki * numbers.dt
        rise = math.ceil(5.0 / gain) + 10
        got = side * controller.run(side * np.repeat([1.0, -1.0], (rise, 4 * rise)), 0.0)
        error = float(got[-1] + 5.0)
        controller.require(
            "the integral comes back from the limit",
            bool(error <= 2.0 * gain),
            sentence=f"Under an error that has changed its sign for {4 * rise * numbers.dt:.3g} s "
            f"the command is {side * got[-1]:.4g} N m; the limit there is {-side * 5.0:.4g} N m.",
            got=f"{side * got[-1]:.6g}",
            expected=f"{-side * 5.0:.6g}",
            error=max(error, 0.0),
            tolerance=2.0 * gain,
            why="what the integral gains in two samples",
            slip="integral_frozen" if got[-1] >= 5.0 - 2.0 * gain else "",
        )
        _leaves_limit_after_moving(attempt, numbers, side)


def _leaves_limit_after_moving(attempt: Attempt, numbers: Numbers, side: float) -> None:
    """Check that the integral leaves the limit where the derivative had let it grow beyond.

    The joint moves fast and the derivative opposes the integral, which therefore exceeds the limit
    while the command does not. Then the joint stops past the set-point. The command is cut off now,
    and only an integral that goes on under this error can bring it back.
    """
    controller = Controller(attempt, numbers)
    gain, speed = numbers.ki * numbers.dt, 3.0
    moving = math.ceil((5.0 + numbers.kd * speed) / gain) + 10
    samples = np.arange(5 * moving)
    measurements = speed * numbers.dt * np.minimum(samples, moving)
    setpoints = measurements + np.where(samples < moving, 1.0, -1.0)
    got = side * controller.run(side * setpoints, side * measurements)
    error = float(got[-1] + 5.0)
    controller.require(
        "the integral comes back after the derivative opposed it",
        bool(error <= 2.0 * gain),
        sentence="The joint moved fast towards the set-point and then stopped past it. The error "
        f"has had the other sign for {4 * moving * numbers.dt:.3g} s since, and the command is "
        f"{side * got[-1]:.4g} N m; the limit there is {-side * 5.0:.4g} N m.",
        got=f"{side * got[-1]:.6g}",
        expected=f"{-side * 5.0:.6g}",
        error=max(error, 0.0),
        tolerance=2.0 * gain,
        why="what the integral gains in two samples",
        slip="integral_frozen_when_cut_off" if got[-1] >= 5.0 - 2.0 * gain else "",
    )


def _winds_up(attempt: Attempt, side: float) -> bool:
    """Return whether the integral keeps growing at the limit.

    The sample at which the command leaves the limit shows it.
    """
    numbers = Numbers(kp=1.2, ki=14.0, u_min=-4.0, u_max=4.0)
    controller = Controller(attempt, numbers)
    held = 160
    controller.run(np.full(held, side), 0.0)
    gain = numbers.ki * numbers.dt
    due = (held * gain - numbers.kp - numbers.u_max) / gain
    after = side * controller.run(np.full(math.ceil(due) + 4, -side), 0.0)
    remaining = int(np.argmax(after < numbers.u_max - 1e-9)) if np.any(after < numbers.u_max) else 0
    return abs(remaining - due) <= 3.0


# --- closed loops ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plant:
    """A joint, a set-point step and gains that put three poles of the loop at -speed."""

    inertia: float
    damping: float
    load: float
    limit: float
    speed: float
    step: float

    def numbers(self, dt: float) -> Numbers:
        """Return the controller's arguments at a sample time [s]."""
        w, j = self.speed, self.inertia
        gains = 3.0 * w * w * j, w**3 * j, 3.0 * w * j - self.damping
        return Numbers(*gains, dt, -self.limit, 0.9 * self.limit, 2.0 * dt)


def _plant(rng: np.random.Generator, speed: float, side: float = 0.0) -> Plant:
    """Return drawn so that a faster loop has a stronger motor.

    In units of 1 / speed all are alike.
    """
    inertia = float(rng.uniform(0.03, 0.08))
    speed *= float(rng.uniform(0.95, 1.05))
    limit = 0.62 * inertia * speed**2
    side = side or float(rng.choice([-1.0, 1.0]))
    return Plant(
        inertia=inertia,
        damping=float(rng.uniform(0.06, 0.4)) * inertia * speed,
        load=float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.15, 0.25)) * limit,
        limit=limit,
        speed=speed,
        step=side * float(rng.uniform(0.5, 0.8)),
    )


def _loops(attempt: Attempt) -> None:
    from course.control import ExactJoint, closed_loop

    for dt, speed in attempt.rng.permutation(RATES).tolist():
        plant = _plant(attempt.rng, speed)
        controller = Controller(attempt, plant.numbers(dt))
        joint = ExactJoint(plant.inertia, plant.damping, dt, plant.load)
        setpoints = np.full(round(LONG / speed / dt), plant.step)
        angles, _ = closed_loop(controller, joint, setpoints)
        _limits_are_respected(attempt, controller)
        if not _settled(attempt, f"settled at {1.0 / dt:g} Hz", controller, plant, angles):
            joint.reset()
            right, _ = closed_loop(_reference_controller(controller.numbers), joint, setpoints)
            controller.show(f"a step at {1.0 / dt:g} Hz", "angle [rad]", angles, right)


def _jams(attempt: Attempt) -> None:
    """Check both ways: an integral may know one limit and not the other."""
    for side in attempt.rng.permutation([1.0, -1.0]).tolist():
        if not attempt.failed:
            _jam(attempt, side)


def _limits_are_respected(attempt: Attempt, controller: Controller) -> None:
    numbers, over = controller.numbers, controller.over
    controller.require(
        "limits kept in the loop",
        over <= EXACT,
        sentence=f"A command passes its limit by {over:.4g} N m.",
        got=f"{over:.4g} N m too much",
        expected=f"{numbers.u_min:.4g} to {numbers.u_max:.4g} N m",
        error=over,
        tolerance=EXACT,
        why=ROUNDING,
    )


def _settled(
    attempt: Attempt, name: str, controller: Controller, plant: Plant, angles: Array
) -> bool:
    """Return the last tenth of the run lies within the band."""
    tail = angles[-max(5, angles.size // 20) :]
    error, allowed = float(np.max(np.abs(tail - plant.step))), BAND * abs(plant.step)
    return attempt.require(
        name,
        bool(error <= allowed),
        sentence=f"At the end the joint is {error:.4g} rad from its set-point.",
        got=describe(tail[-3:]),
        expected=f"{plant.step:.6g}",
        error=error,
        tolerance=allowed,
        unit="rad",
        why="10 % of the step; the worked answer is within 2 %",
        call=controller.call,
    )


def _jam(attempt: Attempt, side: float) -> None:
    from course.control import closed_loop
    from course.oracles.mujoco.joint import MotorJoint

    dt, speed = JAM_RATE
    plant = _plant(attempt.rng, speed, side)
    controller = Controller(attempt, plant.numbers(dt))
    joint = MotorJoint(plant.inertia, plant.damping, dt, plant.load, substeps=10)
    held = round(JAM / dt)
    count = held + round(LONG / speed / dt)
    angles, _ = closed_loop(controller, joint, np.full(count, plant.step), np.arange(count) < held)
    _limits_are_respected(attempt, controller)

    def right() -> Array:
        again = MotorJoint(plant.inertia, plant.damping, dt, plant.load, substeps=10)
        blocked = np.arange(count) < held
        return closed_loop(
            _reference_controller(controller.numbers), again, np.full(count, plant.step), blocked
        )[0]

    past = float(np.max((angles - plant.step) * np.sign(plant.step)))
    allowed = OVERSHOOT * abs(plant.step)
    holds = past <= allowed
    winding = not holds and _winds_up(attempt, side)
    slowly = "" if holds or winding else " Its integral lets go too slowly."
    attempt.require(
        "recovers from a jam, on MuJoCo's joint",
        holds,
        sentence=f"Free again after {JAM:g} s, the joint passes its set-point by {past:.4g} rad; "
        f"the step was {abs(plant.step):.4g} rad.{slowly}",
        got=f"{past:.4g} rad past it",
        expected=f"at most {allowed:.4g} rad",
        error=max(past, 0.0),
        tolerance=allowed,
        unit="rad",
        why="the height of the step, as the task says; the worked answer takes about a fifth of it",
        call=controller.call,
        slip="integral_not_stopped" if winding else "",
    )
    if not (holds and _settled(attempt, "settled after the jam", controller, plant, angles)):
        controller.show("a step during a jam", "angle [rad]", angles, right())


def _reference_controller(numbers: Numbers) -> Any:
    """Return the worked answer's controller."""
    from course.control import PID

    return PID(*numbers.arguments())


def response(figure: Any, shown: Shown) -> None:
    """Plot commands or angles over time."""
    times, what = shown.args
    axes = picture.plane(figure, "time [s]", what)
    axes.plot(times, shown.got, **picture.YOURS)
    axes.plot(times, shown.expected, **picture.RIGHT)
    axes.legend()


def _time(attempt: Attempt) -> None:
    """Time one update."""
    arguments = Numbers(2.0, 3.0, 0.4, 0.01, -2.0, 2.0, 0.03).arguments()

    def sampler(place: Any) -> Callable[[int], float]:
        controller = place.new(ENTRY, *arguments)

        def run(n: int) -> float:
            place.given("updates", controller, n)
            return float(place.elapsed)

        return run

    attempt.time("time per update", sampler(attempt.learner.child), sampler(attempt.reference))


def _near(got: Array, other: Array) -> bool:
    return bool(np.all(np.abs(got - other) <= 1e-9 * (1.0 + np.max(np.abs(other)))))


def _between(value: float, low: float, high: float) -> bool:
    """Return whether a value lies between two of the same sign, in any order.

    One per cent is allowed beyond either.
    """
    a, b = sorted((abs(low), abs(high)))
    return bool((value > 0.0) == (low > 0.0) and 0.99 * a <= abs(value) <= 1.01 * b)


EXERCISE = Exercise(
    judge=staged(
        Stage("simple", "the proportional part", _proportional),
        Stage("simple", "the integral", _integral),
        Stage("simple", "the derivative", _derivative),
        Stage("core", "a step of the set-point", _kick),
        Stage("core", "the limits", _limits),
        Stage("core", "after a limit", _after_limits),
        Stage("core", "reset", _memory),
        Stage("core", "an integral at its limits", _windup),
        Stage("core", "an integral that lets go", _leaves_limit),
        Stage("core", "closed loops", _loops),
        Stage("core", "a jam", _jams),
        Stage("edge", "what is refused", _refusals),
        timed=_time,
    ),
    given=GIVEN,
    limits=Limits(total=60.0),
    # all parts alone and the beginning of the first loop
    replayed=150,
    examples=(
        "PID(2.0, 0.0, 0.0, 0.01, -5.0, 5.0, 0.05).update(1.0, 0.25)",
        "PID(2.0, 3.0, 0.0, 0.01, -5.0, 5.0, 0.05).update(1.0, 0.25)",
        "PID(2.0, 3.0, 0.4, 0.01, -5.0, 4.0, 0.05).update(9.0, 0.0)",
    ),
    picture=response,
    chart=chart_of(
        "Angle of a joint under PID control, against the loop in continuous time",
        sampled,
        unit="updates",
        tolerance=0.01 * SETPOINT,
        error_unit="rad",
        failed_above=SETPOINT,
    ),
    slips=SLIPS,
)
