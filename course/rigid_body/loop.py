"""The fixed-step simulation loop: six phases, each at its own rate, on one exact schedule.

A frame of real time comes in, whole physics steps go out. What is left over stays in an
accumulator until the next frame, and a picture shows the motion between the last two physics
states (Fiedler, "Fix Your Timestep!", 2004). Three decisions make the loop reproducible:

- Time is counted in whole ticks, the greatest common divisor of all periods. Physics at 1 kHz and
  pictures at 60 Hz share ticks of 1/3000 s: a step is 3 of them, a picture 50. Nothing drifts,
  because nothing is rounded.
- The loop never looks at a clock. It is told how much real time has passed, so a test can replay
  any history of frames, and the physics does not depend on how that history was cut up.
- A machine that cannot keep up loses time, at most to a stated bound, and every loss is reported.
"""

from __future__ import annotations

import math
import time as wall
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from numbers import Rational, Real
from typing import Any, NamedTuple

import numpy as np

from course.check import count, finite, invalid, positive

Seconds = int | float | str | Fraction

_LARGEST_DENOMINATOR = 1_000_000


def exact_seconds(value: Seconds, name: str = "seconds") -> Fraction:
    """Return a duration as the fraction that was meant.

    `0.001` in floating point is not a thousandth, and `1 / 60` is not a sixtieth. Both are the
    nearest double to a fraction with a small denominator, and that fraction is returned.

    Args:
        value: duration [s]: a Fraction, an int, a string such as "1/60" or "0.001", or a float.
        name: what to call it in an error.

    Returns:
        The exact duration [s].

    Raises:
        ValueError: if it is not a finite number, or a float that is not the nearest double to any
            fraction with a denominator up to 1,000,000.
    """
    # Booleans are rationals to Python, but True is no duration: they fall through to the error.
    if isinstance(value, Rational) and not isinstance(value, bool):
        return Fraction(int(value.numerator), int(value.denominator))
    if isinstance(value, str):
        try:
            return Fraction(value)
        except (ValueError, ZeroDivisionError):
            raise invalid(name, value, "a number of seconds such as '0.001' or '1/60'") from None
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        number = float(value)
        # Best rational approximation by continued fractions, accepted only if it rounds to this
        # very float.
        fraction = Fraction(number).limit_denominator(_LARGEST_DENOMINATOR)
        if float(fraction) == number:
            return fraction
        raise invalid(
            name,
            value,
            f"a fraction with a denominator up to {_LARGEST_DENOMINATOR}; for any other number "
            "fractions.Fraction or a string",
        )
    raise invalid(name, value, "a finite number of seconds")


def interpolate_linearly(previous: Any, current: Any, alpha: float) -> Any:
    """Interpolate between `previous` and `current`, component by component.

    The result lies a fraction alpha of the way from the first to the second.

    The error for a smooth motion is at most max |acceleration| * dt**2 / 8. It suits positions and
    velocities; a quaternion needs an interpolation along the sphere instead.

    Args:
        previous: the earlier state, a number or an array.
        current: the later state, same shape.
        alpha: 0 at the earlier state, 1 at the later.

    Returns:
        The state in between, same shape.
    """
    return (1.0 - alpha) * previous + alpha * current


class Image(NamedTuple):
    """What the camera took: `time` of the exposure [s] and `data`, whatever the camera returned."""

    time: float
    data: Any


class Event(NamedTuple):
    """Record of a completed phase.

    Attributes:
        time: when it ran, in simulated time [s].
        phase: its name: sense, camera, control, apply forces, integrate, detect collisions, render,
            or dropped, for time that was lost.
        state_time: time of the state it worked with [s]. `time - state_time` is the age of the
            information: the latency. For `apply forces` it is the age of the measurement behind
            the command in force (nan before the first command), for `dropped` it is nan.
    """

    time: float
    phase: str
    state_time: float


@dataclass(frozen=True)
class Phases:
    """The functions of the six phases. Only `integrate` must be given.

    A phase without a function still has its place in the schedule and in the trace.
    A state is whatever `integrate` takes and returns; it is passed on, never changed in place.

    Attributes:
        integrate: (state, force, dt) -> state one step later.
        sense: (state, time) -> measurement, at the control rate; without it control gets the state.
        camera: (state, time) -> picture data, at the camera rate: sensing, only slower.
        control: (measurement, image, time) -> command; `image` is the newest Image that has
            arrived, or None. The command is held until the next one (zero-order hold).
        apply_forces: (state, command, time) -> force; without it the command is the force.
        detect_collisions: (state, time) -> state with its contacts resolved.
        render: (state, time): draws the state at that time, interpolated.
        interpolate: (previous, current, alpha) -> state between the last two physics states.
    """

    integrate: Callable[[Any, Any, float], Any]
    sense: Callable[[Any, float], Any] | None = None
    camera: Callable[[Any, float], Any] | None = None
    control: Callable[[Any, Image | None, float], Any] | None = None
    apply_forces: Callable[[Any, Any, float], Any] | None = None
    detect_collisions: Callable[[Any, float], Any] | None = None
    render: Callable[[Any, float], object] | None = None
    interpolate: Callable[[Any, Any, float], Any] = interpolate_linearly


@dataclass
class Advance:
    """What became of some real time.

    Attributes:
        steps: physics steps taken.
        controls: control ticks.
        images: camera exposures.
        pictures: pictures rendered.
        dropped: real time thrown away because it was beyond the bound [s].
        alpha: share of a step that waits in the accumulator, in [0, 1).
    """

    steps: int = 0
    controls: int = 0
    images: int = 0
    pictures: int = 0
    dropped: float = 0.0
    alpha: float = 0.0


@dataclass
class FixedStepLoop:
    """Sense, control, apply forces, integrate, detect collisions; then render what is due.

    A physics step from t to t + dt runs once real time has reached t + dt. Sensing and control
    belong to the start of a step: they run in the first step that does not start before they are
    due, so a rate that does not divide the physics rate is right on average and off by less than
    one step each time. A picture closes its period: the first is due after one period, and shows
    the motion one step before its own time, because it lies between the two newest states. That
    one step of delay is the price of interpolating; it buys pictures that move evenly.

    Attributes:
        state: state at time 0.
        phases: the functions to call.
        physics_dt: physics step [s]; see `exact_seconds` for what a time may be written as.
        control_period: [s], at least one physics step.
        camera_period: [s], at least one physics step.
        render_period: [s], any positive time; may be shorter than a physics step.
        camera_delay: from exposure to the image's arrival at the controller [s].
        actuation_delay: from sensing to the command's effect [s]; 0 acts in the same step. A delay
            that is no whole number of steps ends at the next step.
        max_frame: largest real time one call may consume [s]; the rest is dropped and reported.
            None drops nothing: right for a run without a clock, a spiral of death for one with.
        initial_command: held until the first command takes effect.
        record: whether to keep the event trace (four to seven events a step).

    Raises:
        ValueError: if a time is not an exact positive number, or a control or camera period is
            shorter than a physics step.
    """

    state: Any
    phases: Phases
    physics_dt: Seconds = Fraction(1, 1000)
    control_period: Seconds = Fraction(1, 500)
    camera_period: Seconds = Fraction(1, 30)
    render_period: Seconds = Fraction(1, 60)
    camera_delay: Seconds = Fraction(0)
    actuation_delay: Seconds = Fraction(0)
    max_frame: Seconds | None = Fraction(1, 4)
    initial_command: Any = None
    record: bool = False

    previous: Any = field(init=False, repr=False)
    totals: Advance = field(init=False, repr=False)
    trace: list[Event] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        dt = self._exact("physics_dt", 0)
        control = self._exact("control_period", dt)
        camera = self._exact("camera_period", dt)
        render = self._exact("render_period", 0)
        camera_delay = self._exact("camera_delay", None)
        actuation_delay = self._exact("actuation_delay", None)
        self._bound = None if self.max_frame is None else self._exact("max_frame", dt)

        # The tick divides every period and delay, so the schedule below is in exact integers.
        self._tick = _common_tick([dt, control, camera, render, camera_delay, actuation_delay])
        self._dt_ticks = int(dt / self._tick)
        self._control_ticks = int(control / self._tick)
        self._camera_ticks = int(camera / self._tick)
        self._render_ticks = int(render / self._tick)
        self._camera_delay_ticks = int(camera_delay / self._tick)
        self._actuation_delay_ticks = int(actuation_delay / self._tick)
        self._dt_seconds = float(dt)

        # Before the first step both states are the same, so an early picture shows the start.
        self.previous = self.state
        self.totals = Advance()
        self.trace = []
        self._dropped = Fraction(0)
        self._granted = Fraction(0)
        self._next_control = 0
        self._next_camera = 0
        # A picture closes its period, so none is due at time 0.
        self._next_picture = self._render_ticks
        self._image: Image | None = None
        self._images_under_way: deque[tuple[int, Image]] = deque()
        self._command = self.initial_command
        self._command_sensed_at = math.nan
        self._commands_under_way: deque[tuple[int, Any, float]] = deque()

    def _exact(self, name: str, least: Fraction | int | None) -> Fraction:
        """Replace a time by its exact value; `least` 0 means positive, None means not negative."""
        value = getattr(self, name)
        exact = exact_seconds(value, name)
        if least is None:
            if exact < 0:
                raise invalid(name, value, "0 s or more")
        elif exact <= 0:
            raise invalid(name, value, "more than 0 s")
        elif exact < least:
            raise invalid(name, value, f"at least one physics step ({float(least):g} s)")
        setattr(self, name, exact)
        return exact

    @property
    def time(self) -> float:
        """Time of the newest physics state [s], rounded once, however many steps it took."""
        return self._seconds(self.totals.steps * self._dt_ticks)

    @property
    def tick(self) -> Fraction:
        """The unit in which everything is scheduled [s]."""
        return self._tick

    @property
    def dropped(self) -> Fraction:
        """Real time thrown away since the start [s], exact."""
        return self._dropped

    @property
    def seconds_to_next(self) -> float:
        """Real time until the next step or picture is due [s]."""
        due = min((self.totals.steps + 1) * self._dt_ticks, self._next_picture)
        return float(due * self._tick - self._granted)

    def advance(self, real_seconds: float | Fraction) -> Advance:
        """Consume real time: run every step and picture that is due.

        How the time is cut into calls makes no difference to the states, bit for bit, as long as
        no call exceeds `max_frame`.

        Args:
            real_seconds: real time since the last call [s]; a float counts at its exact value.

        Returns:
            What was done, with the time that was dropped.

        Raises:
            ValueError: if the time is negative or not finite.
        """
        finite("real_seconds", real_seconds, 0.0, unit="s")

        # The totals as they were: their change is what this call did.
        before = Advance(**vars(self.totals))
        frame = Fraction(real_seconds)
        lost = Fraction(0)
        # Time that a slow frame would ask to catch up beyond `max_frame` is dropped, and reported.
        if self._bound is not None and frame > self._bound:
            lost = frame - self._bound
            frame -= lost
            self._dropped += lost
            self.totals.dropped = float(self._dropped)
        # The accumulator: real time granted to the simulation so far, as an exact fraction.
        self._granted += frame

        # Ticks that are complete by now; the fraction of a tick waits in the accumulator.
        available = int(self._granted // self._tick)
        totals = self.totals
        while True:
            end_of_step = (totals.steps + 1) * self._dt_ticks
            # A step that ends with the picture comes first: the picture lies between two states.
            if end_of_step <= available and end_of_step <= self._next_picture:
                self._step(totals.steps * self._dt_ticks)
            elif self._next_picture <= available:
                self._render(self._next_picture)
            else:
                break
        if lost:
            self._note("dropped", available, math.nan)

        # What remains in the accumulator is a share of a step; a renderer interpolates by it.
        step = Fraction(self.physics_dt)
        totals.alpha = float((self._granted - totals.steps * step) / step)
        return Advance(
            steps=totals.steps - before.steps,
            controls=totals.controls - before.controls,
            images=totals.images - before.images,
            pictures=totals.pictures - before.pictures,
            dropped=float(lost),
            alpha=totals.alpha,
        )

    def _seconds(self, ticks: int) -> float:
        # Division of two integers is rounded once, so the millionth step is as exact as the first.
        return ticks * self._tick.numerator / self._tick.denominator

    def _note(self, phase: str, ticks: int, state_time: float) -> None:
        if self.record:
            self.trace.append(Event(self._seconds(ticks), phase, state_time))

    def _step(self, start: int) -> None:
        phases = self.phases
        end = start + self._dt_ticks
        now = self._seconds(start)
        # Exposed before control runs, so that without delay it sees this very picture.
        if start >= self._next_camera:
            self._expose(start, now)
        if start >= self._next_control:
            self._control(start, now)

        # Commands that have arrived by now replace the held one (zero-order hold).
        while self._commands_under_way and self._commands_under_way[0][0] <= start:
            _, self._command, self._command_sensed_at = self._commands_under_way.popleft()
        force = self._command
        if phases.apply_forces is not None:
            force = phases.apply_forces(self.state, self._command, now)
        self._note("apply forces", start, self._command_sensed_at)

        # Integrate with the force held over the step, then let the contacts correct the new state.
        state = phases.integrate(self.state, force, self._dt_seconds)
        self._note("integrate", start, now)
        if phases.detect_collisions is not None:
            state = phases.detect_collisions(state, self._seconds(end))
        self._note("detect collisions", end, self._seconds(end))

        # Pictures are interpolated between the two newest states, so both are stored.
        self.previous, self.state = self.state, state
        self.totals.steps += 1

    def _expose(self, start: int, now: float) -> None:
        # Scheduled from the last due time and not from `start`, so the mean rate does not drift.
        self._next_camera += self._camera_ticks
        self.totals.images += 1
        camera = self.phases.camera
        data = self.state if camera is None else camera(self.state, now)
        # Transport delay: the image is exposed now and reaches the controller later.
        arrival = start + self._camera_delay_ticks
        self._images_under_way.append((arrival, Image(now, data)))
        self._note("camera", start, now)

    def _control(self, start: int, now: float) -> None:
        # Scheduled from the last due time, as the camera is: the mean rate stays exact.
        self._next_control += self._control_ticks
        self.totals.controls += 1
        phases = self.phases
        measurement = self.state if phases.sense is None else phases.sense(self.state, now)
        self._note("sense", start, now)
        # Of the images that have arrived only the newest counts.
        while self._images_under_way and self._images_under_way[0][0] <= start:
            _, self._image = self._images_under_way.popleft()
        command = self._command
        if phases.control is not None:
            command = phases.control(measurement, self._image, now)
        self._note("control", start, now)
        # Dead time of the actuator: the command waits in a queue until its delay is over.
        self._commands_under_way.append((start + self._actuation_delay_ticks, command, now))

    def _render(self, due: int) -> None:
        self._next_picture += self._render_ticks
        self.totals.pictures += 1
        newest = self.totals.steps * self._dt_ticks
        # A picture is one step behind, between two known states, so that nothing is extrapolated.
        shown = self._seconds(max(due - self._dt_ticks, 0))
        if self.phases.render is not None:
            # Position of the shown time between the two newest states, in [0, 1).
            alpha = (due - newest) / self._dt_ticks
            state = self.phases.interpolate(self.previous, self.state, alpha)
            self.phases.render(state, shown)
        self._note("render", due, shown)


def _common_tick(times: Iterable[Fraction]) -> Fraction:
    """Return the largest time that divides all given times (zeros do not count)."""
    # The gcd of fractions is that of their numerators over a common denominator.
    numerator, denominator = 0, 1
    for time in times:
        scale = math.lcm(denominator, time.denominator)
        numerator = math.gcd(
            numerator * (scale // denominator), time.numerator * (scale // time.denominator)
        )
        denominator = scale
    return Fraction(numerator, denominator)


def run(
    loop: FixedStepLoop,
    seconds: float,
    clock: Callable[[], float] = wall.perf_counter,
    sleep: Callable[[float], object] = wall.sleep,
) -> Advance:
    """Run the loop against a clock for a while.

    Args:
        loop: the loop; it continues from its present state.
        seconds: how long, on that clock [s], positive and finite.
        clock: returns the time [s].
        sleep: waits for a time [s].

    Returns:
        What was done altogether. With `dropped` above zero it ran slower than the clock.

    Raises:
        ValueError: if `seconds` is not positive and finite.
    """
    positive("seconds", seconds, unit="s")
    total = Advance()
    start = last = clock()
    while last - start < seconds:
        now = clock()
        # Time that this call takes is part of the next frame, so no real time is lost between
        # calls.
        done = loop.advance(now - last)
        last = now
        total.steps += done.steps
        total.controls += done.controls
        total.images += done.images
        total.pictures += done.pictures
        total.dropped += done.dropped
        total.alpha = done.alpha
        # Read the clock again: the time that the steps took is not waited for a second time.
        wait = min(loop.seconds_to_next - (clock() - last), seconds - (clock() - start))
        if wait > 0:
            sleep(wait)
    return total


def float_clock_error(dt: float, steps: int) -> float:
    """Return how wrong a clock is that adds a floating-point dt once per step.

    Args:
        dt: step [s], as `exact_seconds` takes it.
        steps: number of additions, positive.

    Returns:
        The clock's reading minus the exact time [s].

    Raises:
        ValueError: if dt is not an exact number of seconds or steps is not positive.
    """
    exact = exact_seconds(dt, "dt")
    count("steps", steps, 1)
    # cumsum adds from left to right; np.sum would add in pairs and hide most of the error.
    reading = float(np.cumsum(np.full(steps, float(dt)))[-1])
    return float(Fraction(reading) - steps * exact)


def trace_table(events: Iterable[Event]) -> str:
    """Return the event trace as a text table.

    Args:
        events: from `FixedStepLoop.trace`.

    Returns:
        One line per event: its time, the phase, and the age of the state it used, in ms.
    """
    lines = [f"{'time [ms]':>10}  {'phase':<17}  {'age [ms]':>8}"]
    for time, phase, state_time in events:
        age = "" if math.isnan(state_time) else f"{1e3 * (time - state_time):8.3f}"
        lines.append(f"{1e3 * time:10.3f}  {phase:<17}  {age:>8}".rstrip())
    return "\n".join(lines)


def flow_diagram(loop: FixedStepLoop) -> str:
    """Return the six phases of a loop with their rates, as boxes and arrows.

    Args:
        loop: the loop to describe.

    Returns:
        Text of several lines.
    """
    dt, control, camera, render = (
        Fraction(value)
        for value in (loop.physics_dt, loop.control_period, loop.camera_period, loop.render_period)
    )
    physics_rate = f"{_rate(dt)}"
    boxes = [
        ("1 sense", f"{_rate(control)}, camera {_rate(camera)}"),
        ("2 plan, control", f"{_rate(control)}, command held between"),
        ("3 apply forces", physics_rate),
        ("4 integrate", physics_rate),
        ("5 detect collisions", physics_rate),
        ("6 render", f"{_rate(render)}, interpolated"),
    ]
    left = max(len(name) for name, _ in boxes)
    right = max(len(rate) for _, rate in boxes)
    rule = "─" * (left + right + 4)
    middle = " " * (len(rule) // 2) + "↓"
    lines = []
    for index, (name, rate) in enumerate(boxes):
        lines += [f"┌{rule}┐", f"│ {name:<{left}}  {rate:>{right}} │", f"└{rule}┘"]
        lines.append(middle if index < len(boxes) - 1 else f"↻ repeat at {_rate(dt)}")
    return "\n".join(lines)


def _rate(period: Fraction) -> str:
    rate = float(1 / period)
    return f"{rate / 1000:g} kHz" if rate >= 1000 else f"{rate:g} Hz"
