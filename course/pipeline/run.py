"""A run of the whole pipeline, and all that crossed it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count, finite, invalid
from course.compiled import compiled
from course.kinematics import TwoLink
from course.kinematics.two_link import TORQUES
from course.pipeline import drive as by
from course.pipeline.drive import GAP, GUESS, GUESS_SPREAD, PLACE, REFERENCE, SENT, SPREAD, Q, V
from course.pipeline.scenario import LAWS, Scenario, Settings, microseconds
from course.pipeline.stages import FRAME, OURS, Crossing, Frames, Path, Sight, Stages, frames
from course.planning import clearance

Array = NDArray[np.float64]
Disturb = Callable[[Frames], Frames]


@dataclass(frozen=True, eq=False)
class Record:
    """What a run left.

    Attributes:
        scenario, settings, seed: what was run.
        reason: why it failed, empty for a success.
        error: of the tip at the end, tip minus target (2,) [m]; NaN where it did not get that far.
        clearance: the least, of links from discs [m].
        time: from when on the tip stayed within the tolerance [s]; infinity without success.
        log: a row each physics step, columns as in `drive`, shape (steps + 1, 11).
        timetable: of the camera, as it was.
        sightings: a row each frame, columns as in `drive`, shape (N, 14).
        plans: what came from the planner, in order; value a `Path`.
        plan_requests: when each plan was requested [us].
    """

    scenario: Scenario
    settings: Settings
    seed: int
    reason: str
    error: Array
    clearance: float
    time: float
    log: Array
    timetable: Frames
    sightings: Array
    plans: list[Crossing]
    plan_requests: list[int]

    @property
    def success(self) -> bool:
        """True if the tip was there in time and nothing was touched."""
        return not self.reason

    @property
    def distance(self) -> float:
        """From tip to target at the end [m]."""
        return float(np.hypot(*self.error))

    @property
    def step(self) -> int:
        """Physics time step [us]."""
        return step_of(self.settings)

    @property
    def times(self) -> Array:
        """Times of the rows of the log [s]."""
        return np.asarray(1e-6 * self.step * np.arange(len(self.log)), dtype=float)

    @property
    def pictures(self) -> list[Crossing]:
        """What perception said of each frame that arrived, in the order of arrival."""
        return [self._crossing(k, PLACE, SPREAD) for k in self._arrived()]

    @property
    def estimates(self) -> list[Crossing]:
        """What went on to plan and reference: after the filter, at the stamp of its picture."""
        used = (k for k in self._arrived() if self.sightings[k, by.USED] > 0.0)
        return [self._crossing(k, GUESS, GUESS_SPREAD) for k in used]

    def _arrived(self) -> list[int]:
        order = np.argsort(self.timetable.arrived, kind="stable")
        # USED is still 0 for a frame that has not arrived.
        return [int(k) for k in order if self.sightings[k, by.USED] != 0.0]

    def _crossing(self, k: int, place: int, spread: int) -> Crossing:
        row = self.sightings[k]
        xx, xy, yy = row[spread : spread + 3]
        stamp, arrived = int(row[by.WHEN]), int(self.timetable.arrived[k])
        return Crossing(
            row[place : place + 2], np.array([[xx, xy], [xy, yy]]), FRAME, stamp, arrived
        )


def run(
    scenario: Scenario,
    settings: Settings,
    stages: Stages = OURS,
    seed: int = 0,
    disturb: Disturb | None = None,
) -> Record:
    """Run the whole pipeline once; the record is the same on every machine.

    Args:
        scenario: the task.
        settings: periods, gains and errors of the stages.
        stages: whose functions do it.
        seed: of all random numbers; each stage has a stream of its own, so that two settings meet
            the same noise.
        disturb: what befalls the camera: its timetable before -> after. What is ideal in the
            settings is not disturbed.

    Raises:
        ValueError: for a latency or a first capture that is later than the end of the run, and
            for a stage that returns something of another kind or shape; it names the stage.
    """
    # One call to the end; a simulation instead calls `to` again and again.
    process = Run(scenario, settings, stages, seed, disturb)
    process.to(scenario.seconds)
    return process.record()


def run_many(
    scenario: Scenario,
    settings: Settings,
    seeds: Iterable[int],
    stages: Stages = OURS,
    disturb: Disturb | None = None,
) -> list[Record]:
    """Run the pipeline once for each seed; the arguments are those of `run`."""
    return [run(scenario, settings, stages, seed, disturb) for seed in seeds]


def errors(records: Sequence[Record]) -> Array:
    """Return the final error of the tip, (2, N) [m]; NaN where a run did not get that far."""
    return np.stack([record.error for record in records], axis=1)


def successes(records: Sequence[Record]) -> NDArray[np.bool_]:
    """Return which runs were successes, shape (N,)."""
    return np.array([record.success for record in records])


def tip_of(arm: TwoLink, q: Array) -> Array:
    """Return the place of the tip (2, ...) [m] for joint angles (2, ...)."""
    (l1, l2), both = arm.lengths, q[0] + q[1]
    x, y = l1 * np.cos(q[0]) + l2 * np.cos(both), l1 * np.sin(q[0]) + l2 * np.sin(both)
    return np.stack((x, y))


def step_of(settings: Settings) -> int:
    """Return the step of the physics [us]; at most a quarter of a millisecond where it is ideal."""
    return (
        min(250, microseconds(settings.physics))
        if "move" in settings.ideal
        else microseconds(settings.physics)
    )


class Run:
    """A run that can be stopped on its way; arguments are those of `run`.

    Attributes:
        log, sightings, timetable, plans, plan_requests: as in a `Record`, as far as it has come.
        wrong: what stopped it, or nothing.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Settings,
        stages: Stages = OURS,
        seed: int = 0,
        disturb: Disturb | None = None,
    ) -> None:
        if settings.latency >= scenario.seconds:
            allowed = f"less than the run, {scenario.seconds:g} s"
            raise invalid("latency", settings.latency, allowed)
        if microseconds(settings.phase) >= microseconds(scenario.seconds):
            allowed = f"less than the run, {scenario.seconds:g} s: else no picture is taken"
            raise invalid("phase", settings.phase, allowed)
        self.scenario, self.settings, self.stages = scenario, settings, stages
        self.seed, self.wrong = count("seed", seed), ""
        self.plans: list[Crossing] = []
        self.plan_requests: list[int] = []
        self._settings = ideal_settings(settings)
        self.timetable = timetable = _timetable(self._settings, scenario.seconds, seed, disturb)
        self._drive_settings = _numbers(scenario, self._settings)
        # Integer microseconds, rounded up: times add without error, and the end is covered.
        steps = -(-microseconds(scenario.seconds) // step_of(settings))
        self.sightings, self.log = (
            np.zeros((timetable.captured.size, 14)),
            np.zeros((steps + 1, 11)),
        )
        self._progress, self._aim = np.zeros((), by.PROGRESS)[()], np.zeros((), by.AIM)[()]
        # No plan is due yet, and a negative stamp marks that nothing was seen so far.
        self._progress["due"], self._aim["stamp"] = by.FAR, -1.0
        # Until its first plan the arm waits where it starts.
        self._aim["wait"] = scenario.start
        world = scenario.world()
        self.log[0, Q:V] = self.log[0, REFERENCE:SENT] = scenario.start
        self.log[0, GAP] = clearance(world, scenario.start)
        # Pictures are handled in the order in which they arrive, which jitter may change.
        self._order = np.argsort(timetable.arrived, kind="stable")
        self._given = (
            np.stack((timetable.captured, timetable.arrived, timetable.stamp), axis=1),
            self._order,
            np.column_stack((timetable.shift, timetable.scale, timetable.draws)),
            self._drive_settings,
            self._progress,
            self._aim,
            np.zeros(4),
            np.zeros((4, 4)),
            self.sightings,
        )
        self._fixed = (
            self.log,
            scenario.plant.column(),
            scenario.arm.column(),
            world.obstacles,
            world.body,
        )
        self._table, self._pending = np.zeros((2, 10)), Path("")
        self._drive, self._ours = self._stages()

    def _stages(self) -> tuple[Any, tuple[Any, Any]]:
        """Return the driver and the functions that it calls.

        They are compiled, or a learner's or a library's.
        """
        drive, *ours = by.kernels()
        stages, scenario, settings = self.stages, self.scenario, self._settings
        observed, law, moved = (
            getattr(stages, name) is getattr(OURS, name) for name in ("perceive", "control", "move")
        )
        # All three are the course's own: the loop stays in compiled code from event to event.
        if observed and law and moved:
            return drive, (ours[0], ours[1])

        def their_law(_n, _model, log, k, desired):
            # Copies, so that a stage from outside can't change the log.
            q, v = log[k, Q:V].copy(), log[k, V:REFERENCE].copy()
            torque = stages.control(q, v, desired.copy(), scenario, settings)
            log[k, SENT : SENT + 2] = _pair("control", torque, "the torques [N m]")

        def their_step(log, k, h, body):
            q, v, tau = log[k, Q:V].copy(), log[k, V:REFERENCE].copy(), body[TORQUES, 0].copy()
            angles, rates = _items(
                "move", stages.move(q, v, tau, h, scenario), "angles and rates", 2
            )
            log[k, Q:V] = _pair("move", angles, "the angles [rad]")
            log[k, V:REFERENCE] = _pair("move", rates, "the rates [rad/s]")

        between = compiled(by.between, by.BETWEEN)
        if not (law and moved):
            # Only what is not the course's own runs as plain Python.
            pair = by.law_loop if law else their_law, by.step_loop if moved else their_step
            between = functools.partial(by.advance, *pair)
        return by.drive, (compiled(by.observe, by.LOOK) if observed else self._observe, between)

    def _observe(self, k, n, times, noise, log, progress, observed) -> None:
        # The arm as it is at the first step that is not before the capture.
        when, q = int(times[k, 0]), log[progress["now"], Q:V].copy()
        target = self.scenario.at(1e-6 * when) + noise[k, :2]
        sight = Sight(int(k), when, target, q, noise[k, 3:].copy(), float(noise[k, 2]))
        message = self.stages.perceive(sight, self.scenario, self._settings)
        words = "place, covariance, frame and stamp"
        place, covariance, frame, stamp = _items("perceive", message, words, 4)
        spread = _covariance(covariance)
        observed[k, PLACE:SPREAD] = _pair("perceive", place, "the place [m]")
        stamp = finite("stamp that perceive returns", stamp, unit="us")
        observed[k, SPREAD : SPREAD + 3] = spread[0, 0], spread[0, 1], spread[1, 1]
        # What the timetable says beside the truth is the clock's error.
        observed[k, by.WHEN] = stamp + times[k, 2] - times[k, 0]
        if frame != FRAME:
            progress["wrong"] = by.WRONGS.index("perceive: another frame")

    def to(self, seconds: float) -> bool:
        """Advance to a time of the run [s], at most to its end; return whether all is well."""
        progress = self._progress
        self._drive_settings["end"] = microseconds(min(seconds, self.scenario.seconds))
        while not self.wrong:
            # The driver returns where it needs Python: for a plan, and when a plan is ready.
            code = self._drive(*self._ours, *self._given, self._table, *self._fixed)
            if code == by.ENDED:
                break
            if code == by.FAILED:
                self.wrong = by.WRONGS[progress["wrong"]]
            elif code == by.WANTED:
                self._ask()
            else:
                self._take()
        return not self.wrong

    def retarget(self, place: tuple[float, float]) -> None:
        """Put the target to a place [m] from now on; what was seen and done stays as it was."""
        self.scenario = replace(self.scenario, target=place, velocity=(0.0, 0.0))
        self._drive_settings["target"], self._drive_settings["velocity"] = self.scenario.target, 0.0

    def _ask(self) -> None:
        """Ask for a plan from where the reference is, and note when it will be ready."""
        progress, settings = self._progress, self._settings
        # The frame that arrived last is the one that asked for this plan.
        k = self._order[progress["arrived"] - 1]
        now = int(self.timetable.arrived[k])
        start = self.log[progress["now"], REFERENCE:SENT].copy()
        goal = self._aim["made"].copy()
        # A generator of its own for each plan: its random numbers do not depend on what came
        # before.
        rng = np.random.default_rng([self.seed, 2, len(self.plans)])
        tries = 3 if "plan" in settings.ideal else 1  # by chance a way is three times as long
        result = [self.stages.plan(start, goal, self.scenario, settings, rng) for _ in range(tries)]
        for other in result:
            if not isinstance(other, Path):
                raise invalid("what plan returns", other, "a course.pipeline.stages.Path")
        # The quickest of the paths; one without a motion counts as infinitely slow.
        path = self._pending = min(
            result, key=lambda p: p.motion.duration if p.motion else math.inf
        )
        if path.motion is not None:
            if not np.isfinite(path.motion.table).all():
                self.wrong = "plan: a path that is not finite"
            # The path must continue the reference without a jump.
            elif np.abs(path.motion.table[0, 4:6] - start).max() > 1e-9:
                self.wrong = "plan: a path that does not begin where the arm should be"
        # The plan is ready when its collision checks, at their stated cost, have been done.
        progress["due"] = due = now + round(1e6 * settings.check_cost * path.checks)
        self.plan_requests.append(now)
        self.plans.append(Crossing(path, None, "joints", int(self.sightings[k, by.WHEN]), due))

    def _take(self) -> None:
        """Put the plan that was waited for into force, if there is one."""
        progress, aim, path = self._progress, self._aim, self._pending
        if path.motion is not None:
            # The clock of the motion starts when the plan is ready, not when it was requested.
            progress["planned"], progress["interval"], progress["origin"] = 1, 0, progress["due"]
            aim["goal"], aim["side"] = path.goal, path.side
            # The end is corrected at once for what the target has done since the request.
            aim["fresh"] = 1.0
            self._table = path.motion.table
        progress["busy"], progress["due"] = 0, by.FAR

    def record(self) -> Record:
        """Return what it has left so far; a run that is not over is judged where it is."""
        scenario, log = self.scenario, self.log[: self._progress["now"] + 1]
        when = 1e-6 * step_of(self.settings) * np.arange(len(log))
        target = np.asarray(scenario.target)[:, None] + np.outer(scenario.velocity, when)
        away = tip_of(scenario.arm, log[:, Q:V].T) - target
        # Success needs the tip within the tolerance from some time on until the end.
        far = np.flatnonzero(~(np.hypot(*away) <= scenario.tolerance))
        reason, least = self.wrong, float(np.min(log[:, GAP]))
        error = away[:, -1] if not reason else np.full(2, np.nan)
        if not reason and least <= 0.0:
            reason = "touched a disc"
        if not reason and far.size and far[-1] == len(log) - 1:
            last = self.plans[-1].value if self.plans else Path("none was asked for")
            reason = "beside the target" if self._progress["planned"] else "the plan is late"
            if last.motion is None:
                reason = f"no plan: {last.status}"
        time = math.inf if reason else float(when[far[-1] + 1 if far.size else 0])
        return Record(
            scenario,
            self.settings,
            self.seed,
            reason,
            error,
            least,
            time,
            log,
            self.timetable,
            self.sightings,
            self.plans,
            self.plan_requests,
        )


def _items(stage: str, value: Any, what: str, n: int) -> list[Any]:
    """Return what a stage handed over, if it is a sequence of n."""
    if not isinstance(value, tuple | list | np.ndarray) or len(value) != n:
        raise invalid(f"what {stage} returns", value, what)
    return list(value)


def _array(stage: str, value: Any, what: str, shape: tuple[int, ...]) -> Array:
    """Return an array of a shape that a stage handed over; NaN is left to the contracts."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != shape:
        raise invalid(f"what {stage} returns", value, f"{what}, an array of shape {shape}")
    return array


def _pair(stage: str, value: Any, what: str) -> Array:
    return _array(stage, value, what, (2,))


def _covariance(value: Any) -> Array:
    """Return the covariance that perception handed over: it has to be symmetric."""
    spread = _array("perceive", value, "the covariance [m^2]", (2, 2))
    if abs(spread[0, 1] - spread[1, 0]) > 1e-9 * np.abs(spread).max():
        raise invalid("covariance that perceive returns", spread, "a symmetric matrix")
    return spread


def ideal_settings(settings: Settings) -> Settings:
    """Return the settings that the stages are passed where some of them are ideal."""
    if "perceive" in settings.ideal:
        settings = replace(settings, noise=0.0, bias=(0.0, 0.0))
    if "age" in settings.ideal:
        settings = replace(settings, latency=0.0, lost=0.0)
    if "plan" in settings.ideal:
        settings = replace(settings, check_cost=0.0, margin=max(settings.margin, 0.03))
    if "move" in settings.ideal and settings.control == settings.physics:
        fine = 1e-6 * step_of(settings)
        settings = replace(settings, physics=fine, control=fine)
    return settings


def _timetable(settings: Settings, seconds: float, seed: int, disturb: Disturb | None) -> Frames:
    """Return the camera's, and what disturbs it; what disturbs an ideal stage is taken back."""
    before = frames(settings, seconds, seed)
    after = before if disturb is None else disturb(before)
    # An ideal age restores the timetable. What befalls perception stays where the frames are the
    # same.
    if "age" in settings.ideal:
        shift = after if after.captured.size == before.captured.size else before
        after = replace(before, shift=shift.shift, scale=shift.scale, draws=shift.draws)
    if "perceive" in settings.ideal:
        after = replace(after, shift=0.0 * after.shift, scale=np.ones(after.scale.size))
    return after


def _numbers(scenario: Scenario, settings: Settings) -> Any:
    """Return the settings as the compiled loops read them, a record of `drive.SETTINGS`."""
    h, ideal, actuator = step_of(settings), settings.ideal, settings.actuator
    # The weaker of the arm's own limit and the actuator's.
    limits = [min(largest, actuator.limit) for largest in scenario.arm.torques]
    # First-order lag over one step, exactly: 1 - exp(-h / lag).
    sharp = -math.expm1(-1e-6 * h / actuator.lag) if actuator.lag > 0.0 else 1.0
    values = (
        h,
        microseconds(settings.control),
        LAWS.index(settings.law),
        settings.kp,
        settings.kd,
        limits,
        actuator.rate * settings.control,
        sharp,
        1e6 * actuator.delay,
        "control" in ideal,
        settings.noise,
        settings.bias,
        scenario.target,
        scenario.velocity,
        settings.filtered,
        settings.carried,
        "age" in ideal,
        *settings.drift,
        settings.replan,
        settings.hysteresis,
        0.0,
    )
    return np.array(values, by.SETTINGS)[()]
