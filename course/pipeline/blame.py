"""Works nine times in ten: whose fault is the tenth? A procedure, and the faults that test it.

First the contracts at the interfaces, upstream first: a convention, since a record does not hold
when each broke. Then replays of the same seed with one stage ideal, then with two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.control import Actuator
from course.kinematics import two_link_ik
from course.pipeline.drive import LEAST, REFERENCE, SENT, TORQUE, Q, V
from course.pipeline.run import Record, run, tip_of
from course.pipeline.scenario import STAGES, Scenario, Settings, microseconds, repair
from course.pipeline.stages import Frames
from course.planning import clearance

SURE = 5.0  # standard deviations beyond which an error does not agree with its covariance
SLACK = 1e-3  # m; of a path's end, and of what it keeps from the discs
READY = 250_000  # us; a plan that takes longer is late
# Perfect tracking leaves physics no part and cures what is wrong there: physics is tried before.
REPLAYED = ("perceive", "age", "plan", "move", "control")


class Broken(NamedTuple):
    """A contract that was broken: whose, and what of it."""

    stage: str
    what: str


def contracts(record: Record, agreed: Settings, truth: bool = True) -> list[Broken]:
    """Return each contract that a run broke, upstream first.

    Args:
        record: of the run; its settings are ignored.
        agreed: what was promised.
        truth: whether each picture is compared with where the target really was. A simulator
            knows that; on hardware it takes a second, better measurement of the target.
    """
    result, scenario = [], record.scenario
    log, pictures = record.log, record.pictures
    # A stage that handed over something impossible has stopped the run.
    if record.reason.split(":")[0] in ("perceive", "plan", "control", "move"):
        stage, what = record.reason.split(": ")
        result.append(Broken("age" if "stamp" in what else stage, what))
    late, period = microseconds(agreed.latency), microseconds(agreed.frame)
    arrived = np.array([p.arrived for p in pictures] + [microseconds(scenario.seconds)])
    # Contracts of time: the age of an image, and the gap between two.
    ages = np.array([p.arrived - p.captured for p in pictures])
    # Half a period of tolerance beyond the agreed latency.
    if ages.size and ages.max() > late + period // 2:
        result.append(Broken("age", "frames are older than was agreed"))
    if np.diff(arrived, prepend=late).max() > 3 * period:
        result.append(Broken("age", "frames do not arrive"))
    # Contracts of perception: the stated covariance, and with the truth known the errors
    # themselves.
    if len(pictures) > 1:
        each = np.sqrt([np.diag(np.asarray(p.covariance)) for p in pictures])
        if np.median(each) > 1.5 * max(agreed.noise, LEAST):
            result.append(Broken("perceive", "it is less exact than was agreed"))
    if truth and len(pictures) > 1:
        true = np.array([scenario.at(1e-6 * p.captured) for p in pictures])
        # Errors in units of their stated deviation, without the agreed bias.
        z = (np.array([p.value for p in pictures]) - true - agreed.bias) / each
        # The mean of n independent errors has the deviation 1 / sqrt(n).
        if np.abs(z.mean(axis=0)).max() * np.sqrt(len(z)) > SURE:
            result.append(Broken("perceive", "errors do not agree with the bias"))
        if np.abs(z).max() > SURE + 1.0:
            result.append(Broken("perceive", "errors do not agree with the covariance"))
    known = {one.captured: one.value for one in record.estimates}
    # Contracts of planning: a path in time, clear of the discs, and ending at the goal.
    for requested, crossing in zip(record.plan_requests, record.plans, strict=False):
        path = crossing.value
        if path.motion is None:
            result.append(Broken("plan", f"no path: {path.status}"))
        elif path.motion.duration > scenario.seconds - 1e-6 * requested:
            result.append(Broken("plan", "its path takes longer than there is time"))
        if crossing.arrived - requested > READY:
            result.append(Broken("plan", "it is late"))
        if path.motion is not None:
            gaps = _gaps(scenario, path.waypoints)
            # The same rule as in `plan_path`: the agreed margin, or half of what the ends allow.
            if gaps.min() < min(agreed.margin, 0.5 * min(gaps[0], gaps[-1])) - SLACK:
                result.append(Broken("plan", "it keeps less from the discs than was agreed"))
            end, goal = tip_of(scenario.arm, path.goal), known.get(crossing.captured)
            if goal is not None and two_link_ik(scenario.arm.lengths, goal).reached:
                if np.hypot(*(end - goal)) > SLACK:
                    result.append(Broken("plan", "its path does not end at the goal"))
    # Contracts of control and physics: the torque of the law, bounded rates, no energy from
    # nowhere.
    rows = slice(0, -1, max(1, microseconds(agreed.control) // record.step))
    e, v, sent = (log[rows, some] for some in (slice(4, 6), slice(2, 4), slice(6, 8)))
    largest = np.minimum(scenario.arm.torques, agreed.actuator.limit)
    # The PD law with its limits, recomputed from the logged state and reference.
    right = np.clip(agreed.kp * (e - log[rows, Q:V]) - agreed.kd * v, -largest, largest)
    asked_for = np.any(sent != 0.0, axis=1) & (agreed.law == "pd")
    if np.any(np.abs(sent - right)[asked_for] > 1e-6):
        result.append(Broken("control", "the torque is not that of the law"))
    if np.abs(log[:, V:REFERENCE]).max() > 3.0 * agreed.rate:
        result.append(Broken("move", "the arm is faster than any path"))
    if gained(record, agreed.kp, agreed.kd) > 0.003:
        result.append(Broken("move", "energy rises unforced"))
    return sorted(result, key=lambda one: STAGES.index(one.stage))


def _gaps(scenario: Scenario, waypoints: np.ndarray) -> np.ndarray:
    """Return clearance along a path, at its ends and every 50 mrad or nearer [m]."""
    lengths = np.linalg.norm(np.diff(waypoints), axis=0)
    count = 2 + int(lengths.sum() / 0.05)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    at = np.sort(np.concatenate((np.linspace(0.0, along[-1], count), along)))
    # Both equal spacing and every waypoint, so that no corner is cut off.
    places = np.stack([np.interp(at, along, row) for row in waypoints])
    return np.array([clearance(scenario.world(), q) for q in places.T])


def gained(record: Record, kp: float, kd: float) -> float:
    """Return the energy that appeared without a source, over the most that arm and spring had.

    With PD, W = v^T M v / 2 + kp e^2 / 2 rises by no more than what is brought: by the moving
    reference kp e . dr, and by torques that are not those of the law, such as at their limit,
    (torque + kd v - kp e) . dq. A step that is too large makes more.

    Args:
        record: of a run whose arm is moved by torques.
        kp: gain of the law [N m/rad].
        kd: gain of the law [N m s/rad].
    """
    if len(record.log) < 3:
        return 0.0
    log = record.log.T
    q, v, r, sent = log[Q:V], log[V:REFERENCE], log[REFERENCE:SENT], log[TORQUE : TORQUE + 2]
    r = np.hstack([r[:, :-1], r[:, -2:-1]])  # the last row has no command of its own
    W = 0.5 * np.einsum("in,ijn,jn->n", v, record.scenario.arm.mass_matrix(q), v)
    W += 0.5 * kp * np.sum((r - q) ** 2, axis=0)
    # Work of the moving reference on the spring, and of every torque that is not the PD law's.
    brought = kp * np.sum(((r - q)[:, 1:] + (r - q)[:, :-1]) * np.diff(r), axis=0) / 2.0
    brought += np.sum((sent + kd * v - kp * (r - q))[:, :-1] * np.diff(q), axis=0)
    # Only what rises by more than was brought counts, relative to the largest energy.
    return float(np.sum(np.maximum(np.diff(W) - brought, 0.0)) / max(float(W.max()), 1e-12))


class Verdict(NamedTuple):
    """Whose fault it was, by what it was found, and how many replays that took."""

    stages: tuple[str, ...]
    how: str
    runs: int


def blame(
    record: Record,
    agreed: Settings | None,
    replay: Callable[..., Record],
    truth: bool = True,
) -> Verdict:
    """Find the single stage, or else the pair, whose ideal version makes a failed run succeed.

    Args:
        record: the log of the failed run.
        agreed: the settings that the contracts are checked against; the stages that broke one
            are tried first. None: no contracts are checked.
        replay: maps ideal stages to the record of the same seed. Only a simulator can do that:
            no robot repeats its noise, and none has an ideal camera or arm.
        truth: whether the true target is known, as for `contracts`.

    Returns:
        The stages, how they were found, and the number of replays; no stage if no pair helps.
    """
    broken = [one.stage for one in contracts(record, agreed, truth)] if agreed else []
    # Stages with a broken contract are tried first.
    order, runs = list(dict.fromkeys([*broken, *REPLAYED])), 0
    for size, how in ((1, "repair"), (2, "pair")):
        for some in combinations(order, size):
            runs += 1
            if replay(*some).success:
                return Verdict(some, "contract" if some[0] in broken and size == 1 else how, runs)
    return Verdict((), "", runs)


def first_broken(record: Record, agreed: Settings, truth: bool = True) -> str:
    """Return the stage of the first contract that is broken, without any replay; empty for none.

    Without `truth` a robot can do this with its own record.
    """
    broken = contracts(record, agreed, truth)
    return broken[0].stage if broken else ""


def last_error(record: Record) -> str:
    """Return who would be blamed by the error of the last stages.

    The arm, if it is further from its reference than that is from the target, else perception.
    """
    scenario = record.scenario
    desired = tip_of(scenario.arm, record.log[-2, REFERENCE : REFERENCE + 2])
    here = tip_of(scenario.arm, record.log[-1, Q:V])
    error = np.linalg.norm(desired - scenario.at(scenario.seconds))
    return "control" if np.linalg.norm(here - desired) > error else "perceive"


def minimal(scenario: Scenario, fails: Callable[[Scenario], bool]) -> Scenario:
    """Return the simplest scenario that still fails.

    It has fewer discs, a level table, and a target at rest.

    Args:
        scenario: one that fails.
        fails: whether a scenario does.
    """
    # One simplification at a time, as in delta debugging; recursion until none still fails.
    fewer = combinations(scenario.discs, max(len(scenario.discs) - 1, 0))
    simpler = [replace(scenario, discs=some) for some in fewer]
    still = replace(scenario, velocity=(0.0, 0.0))
    for plainer in (*simpler, replace(scenario, tilt=0.0), still):
        if plainer != scenario and fails(plainer):
            return minimal(plainer, fails)
    return scenario


class Fault(NamedTuple):
    """Something that befalls a run.

    Attributes:
        name, stage: what it is, and whose.
        settings: those of a run -> those with the fault.
        disturb: what befalls the camera, for a seed.
    """

    name: str
    stage: str
    settings: Callable[[Settings], Settings] = lambda settings: settings
    disturb: Callable[[Frames, int], Frames] = lambda frames, seed: frames


def _shifted(frames: Frames, shift: np.ndarray, since: float = 0.0) -> Frames:
    late = (frames.captured >= 1e6 * since)[:, None]
    return replace(frames, shift=frames.shift + shift * late)


def _direction(seed: int) -> np.ndarray:
    angle = np.random.default_rng([seed, 7]).uniform(-np.pi, np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _burst(frames: Frames, seed: int) -> Frames:
    rng = np.random.default_rng([seed, 8])
    return _shifted(frames, 0.12 * rng.standard_normal(frames.shift.shape), 3.0)


FAULTS = (
    Fault("calibration moved", "perceive", disturb=lambda f, s: _shifted(f, 0.035 * _direction(s))),
    Fault("wrong object", "perceive", disturb=lambda f, s: _shifted(f, 0.15 * _direction(s), 1.0)),
    Fault("noise burst", "perceive", disturb=_burst),
    Fault("late frames", "age", disturb=lambda f, s: replace(f, arrived=f.arrived + 1_300_000)),
    Fault("dropped frames", "age", disturb=lambda f, s: f.where(f.captured < 2_200_000)),
    Fault("wrong stamp", "age", disturb=lambda f, s: replace(f, stamp=f.stamp + 150_000)),
    Fault("slow planner", "plan", lambda s: replace(s, check_cost=0.03)),
    Fault("clearance too small", "plan", lambda s: replace(s, margin=0.0)),
    Fault("weak motor", "control", lambda s: replace(s, actuator=Actuator(limit=0.12))),
    Fault("step too large", "move", lambda s: replace(s, physics=0.045, control=0.045)),
)

CASE = (
    Scenario(velocity=(-0.016, 0.012)),
    Settings(noise=0.01, bias=(-0.001, 0.001), kd=4.0, drift=(0.01, 0.03)),
)


def injected(
    fault: Fault, seed: int, case: tuple[Scenario, Settings] = CASE
) -> Callable[..., Record]:
    """Return replays of a run with an injected fault: stages to make ideal -> record.

    None stands for the run itself.
    """
    scenario, settings = case

    def replay(*mended: str) -> Record:
        report = repair(fault.settings(settings), *mended)
        return run(scenario, report, seed=seed, disturb=lambda f: fault.disturb(f, seed))

    return replay


def failing(
    desired: int, faults: Sequence[Fault] = FAULTS, case: tuple[Scenario, Settings] = CASE
) -> list[list[Record]]:
    """Return `desired` failing runs of each fault, of at most eight times as many seeds."""
    result: list[list[Record]] = [[] for _ in faults]
    for fault, records in zip(faults, result, strict=True):
        for seed in range(8 * desired):
            if len(records) == desired:
                break
            record = injected(fault, seed, case)()
            if not record.success:
                records.append(record)
    return result


def contracts_alone(
    desired: int, faults: Sequence[Fault] = FAULTS, case: tuple[Scenario, Settings] = CASE
) -> NDArray[np.int64]:
    """Return how many failing runs of each fault the first broken contract names, without a replay.

    Args:
        desired: as for `confusion`.
        faults: as for `confusion`.
        case: as for `confusion`.

    Returns:
        Shape (2, faults): with the true target, and with what a robot's own record holds.
    """
    runs = failing(desired, faults, case)
    return np.array(
        [
            [
                sum(first_broken(record, case[1], truth) == fault.stage for record in records)
                for fault, records in zip(faults, runs, strict=True)
            ]
            for truth in (True, False)
        ]
    )


def confusion(
    desired: int,
    faults: Sequence[Fault] = FAULTS,
    case: tuple[Scenario, Settings] = CASE,
    contracted: bool = True,
    truth: bool = True,
) -> tuple[NDArray[np.int64], list[list[int]], NDArray[np.int64]]:
    """Diagnose `desired` failing runs of each fault without a look at the fault.

    Args:
        desired: failing runs of each fault; at most eight times as many seeds are tried.
        faults: the faults that are injected.
        case: the scenario and settings that they are injected into.
        contracted: whether contracts are read first.
        truth: as for `contracts`.

    Returns:
        How often each stage was named, then a pair that holds the right one, then any other answer,
        (faults, len(STAGES) + 2); replays that each diagnosis took; and how often the last error
        names each stage, (faults, len(STAGES)).
    """
    result, last = (np.zeros((len(faults), len(STAGES) + more), np.int64) for more in (2, 0))
    runs: list[list[int]] = [[] for _ in faults]
    for i, fault in enumerate(faults):
        for seed in range(8 * desired):
            if len(runs[i]) == desired:
                break
            replay = injected(fault, seed, case)
            record = replay()
            if record.success:
                continue
            stages, _, taken = blame(record, case[1] if contracted else None, replay, truth)
            pair = len(STAGES) if fault.stage in stages else len(STAGES) + 1
            result[i, STAGES.index(stages[0]) if len(stages) == 1 else pair] += 1
            last[i, STAGES.index(last_error(record))] += 1
            runs[i].append(taken)
    return result, runs, last
