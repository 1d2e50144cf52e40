"""A hopper's filter: errors beside the worked answer and the bound, consistency, causality."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Stage
from drills.exercise import Exercise, slips
from drills.grade_report import LEVELS

if TYPE_CHECKING:
    from course.perception.hopper import HopLog

Array = NDArray[np.float64]

LOGS = 6  # of each group
GROUP, ALL, BOUND = 1.3, 1.15, 1.4  # largest ratios of errors
NAMES = ("height", "velocity")
UNITS = ("m", "m/s")
# Standard score that a normal variable passes with a probability of 1e-4 on one side.
BAND = 3.719
WHY = "errors of the same logs, so that luck cancels"

# Groups of logs: level, label, what differs from the usual hopper.
GROUPS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    (
        "simple",
        "a right contact sensor, the foot below the hip",
        {"reach": 0.0, "wrong": 0.0, "late": 0},
    ),
    ("simple", "a right contact sensor", {"wrong": 0.0, "late": 0}),
    ("core", "a late contact sensor", {"wrong": 0.0}),
    ("core", "a contact sensor that is sometimes wrong", {"late": 0, "wrong": 0.03}),
    ("core", "late and wrong", {}),
    ("core", "a foot far ahead and behind", {"reach": 0.25}),
    ("edge", "samples of 8 ms", {"dt": 8e-3, "samples": 200, "late": 2}),
)


@dataclass
class Errors:
    """What the groups have shown so far: errors of the answer, the worked one and the bound.

    Attributes:
        yours, ours, least: mean squares of height and velocity error, one row (2,) for each log.
        nees: normalised squared errors of each log in its middle and at its end.
    """

    yours: list[Array] = field(default_factory=list)
    ours: list[Array] = field(default_factory=list)
    least: list[Array] = field(default_factory=list)
    nees: list[tuple[float, float]] = field(default_factory=list)


def chi_squared_band(degrees: int) -> tuple[float, float]:
    """Return the band of chi squared with 1e-4 on each side (Wilson and Hilferty, 1931)."""
    part = 2.0 / (9.0 * degrees)
    low, high = (degrees * (1.0 - part + z * math.sqrt(part)) ** 3 for z in (-BAND, BAND))
    return low, high


def _answer(attempt: Attempt, log: HopLog) -> tuple[Array, Array] | None:
    """Return estimates and covariances of the submission, or None after a failed check."""
    n = len(log.force)
    got = attempt.parts(attempt.call(*log.sensors), ["estimates", "covariances"])
    if got is None:
        return None
    estimates = attempt.numbers("estimates", got[0], (n, 2))
    covariances = attempt.numbers("covariances", got[1], (n, 2, 2))
    return None if estimates is None or covariances is None else (estimates, covariances)


def _group(label: str, changed: dict[str, Any], errors: Errors) -> Callable[[Attempt], None]:
    """Return the stage that grades a group of logs."""

    def run(attempt: Attempt) -> None:
        from course.perception.hopper import hop_bound, hop_logs

        first = len(errors.yours)
        for log in hop_logs(attempt.rng, LOGS, **changed):
            answer = _answer(attempt, log)
            if answer is None:
                return
            estimates, covariances = answer
            truth = np.column_stack((log.height, log.velocity))
            scored = len(truth) // 3
            away = estimates - truth
            with np.errstate(all="ignore"):  # what came back may be as large as it likes
                errors.yours.append(np.mean(away[scored:] ** 2, axis=0))
            reference = attempt.expected(*log.sensors)[0]
            errors.ours.append(np.mean((reference - truth)[scored:] ** 2, axis=0))
            bound = hop_bound(log)[scored:, [0, 1], [0, 1]]
            errors.least.append(np.mean(bound, axis=0))
            if not _positive(attempt, covariances):
                return
            middle, end = (_nees(away[i], covariances[i]) for i in (len(truth) // 2, -1))
            errors.nees.append((middle, end))
        _compare(attempt, label, errors.yours[first:], errors.ours[first:], GROUP)

    return run


def _positive(attempt: Attempt, covariances: Array) -> bool:
    """Check that covariances are symmetric and positive definite."""
    with np.errstate(all="ignore"):
        a, b, c, d = covariances.reshape(-1, 4).T
        even = np.abs(b - c) <= 1e-9 * np.sqrt(np.abs(a * d))
        holds = bool(np.all(even & (a > 0.0) & (d > 0.0) & (a * d > b * c)))
    return attempt.require(
        "a covariance",
        holds,
        sentence="A covariance that came back is not symmetric and positive definite.",
        why="it is the covariance of errors",
    )


def _nees(error: Array, covariance: Array) -> float:
    """Return e^T P^-1 e, by the inverse of a 2 by 2 matrix."""
    (a, b), (_, d) = covariance.tolist()
    e, f = error.tolist()
    return float((d * e * e - 2.0 * b * e * f + a * f * f) / (a * d - b * b))


def _compare(
    attempt: Attempt,
    label: str,
    yours: Sequence[Array],
    other: Sequence[Array],
    limit: float,
    baseline: str = "the worked answer's",
) -> None:
    """Check root mean square errors of height and velocity against others of the same logs."""
    ratios = np.sqrt(np.mean(yours, axis=0) / np.mean(other, axis=0)).tolist()
    sizes = np.sqrt(np.mean(yours, axis=0)).tolist()
    for name, unit, ratio, size in zip(NAMES, UNITS, ratios, sizes, strict=True):
        attempt.require(
            f"{label}: error of the {name}",
            ratio <= limit,
            sentence=f"The root mean square error of the {name} is {size:.3g} {unit}, "
            f"{ratio:.3g} times {baseline}. At most {limit:g} times is right.",
            error=ratio,
            tolerance=limit,
            why=WHY,
        )


def _all_logs(errors: Errors) -> Callable[[Attempt], None]:
    """Return the stage that compares all errors with the worked ones and the bound."""

    def run(attempt: Attempt) -> None:
        _compare(attempt, "all logs", errors.yours, errors.ours, ALL)
        _compare(attempt, "all logs", errors.yours, errors.least, BOUND, "the Cramér-Rao bound")
        roots = [np.sqrt(np.mean(rows, axis=0)) for rows in (errors.yours, errors.least)]
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
            attempt.cost(
                f"error of the {name}, beside the Cramér-Rao bound",
                unit,
                yours=float(roots[0][k]),
                reference=float(roots[1][k]),
            )

    return run


def _consistent(errors: Errors) -> Callable[[Attempt], None]:
    """Return the stage that compares normalised squared errors with chi squared."""

    def run(attempt: Attempt) -> None:
        low, high = chi_squared_band(2 * len(errors.nees))
        for where, values in zip(("the middle", "the end"), np.array(errors.nees).T, strict=True):
            total = float(np.sum(values))
            mean = total / len(values)
            fault = (
                "The errors are larger than the covariance says: the filter is too sure of itself"
                if total > high
                else "The errors are smaller than the covariance says: the filter is too cautious"
            )
            attempt.require(
                f"consistency in {where} of the logs",
                low <= total <= high,
                sentence=f"{fault}. In {where} of the logs the mean of e^T P^-1 e is {mean:.3g}; "
                f"of two states it is 2, and {low / len(values):.2f} to {high / len(values):.2f} "
                f"over {len(values)} logs.",
                got=f"{mean:.3g}",
                expected="2",
                why="chi squared leaves the band with a probability of 1e-4 on each side",
            )

    return run


def _causal(attempt: Attempt) -> None:
    """Check that half of a log gives the first half of the estimates."""
    from course.perception.hopper import hop_logs

    (log,) = hop_logs(attempt.rng, 1)
    half = len(log.force) // 2
    # Where the second half is cut off, a filter doesn't notice; a smoother does.
    short = log._replace(
        force=log.force[:half],
        length=log.length[:half],
        offset=log.offset[:half],
        contact=log.contact[:half],
    )
    full, cut = _answer(attempt, log), _answer(attempt, short)
    if full is None or cut is None:
        return
    for name, a, b in zip(("estimates", "covariances"), full, cut, strict=True):
        away = float(np.max(np.abs(a[:half] - b), initial=0.0))
        attempt.require(
            f"{name} use no later sample",
            away <= 1e-9,
            sentence=f"The {name} of the first half change by up to {away:.3g} when the second "
            "half is cut off. A robot has no later samples: filter, don't smooth.",
            error=away,
            tolerance=1e-9,
            why="the same operations on the same numbers",
        )


def judge(attempt: Attempt) -> None:
    """Grade group by group; what all groups show comes last."""
    from course.perception.hopper import hop_logs

    errors = Errors()
    stages = [Stage(level, label, _group(label, more, errors)) for level, label, more in GROUPS]
    stages += [
        Stage("edge", "all logs", _all_logs(errors)),
        Stage("edge", "consistency", _consistent(errors)),
        Stage("edge", "no later samples", _causal),
    ]
    attempt.plan([(stage.level, stage.label) for stage in stages])
    for index, stage in enumerate(stages):
        # The simple groups all run; a harder one only while nothing has failed.
        if attempt.failed and stage.level != LEVELS[0]:
            return
        with attempt.part(index):
            stage.run(attempt)
    if not attempt.failed:
        (log,) = hop_logs(attempt.rng, 1)
        attempt.time_call(*log.sensors, what="time per log of 300 samples")


_LOADED = "if force[i] - x[2] > 4.0 * np.sqrt(noise[0] ** 2 + P[2, 2]):"
_GATE = "if innovation**2 < 16.0 * S:"
_EXPECTED = "expected = np.hypot(x[0], offset[i])"
_H = "H = np.array([x[0] / expected, 0.0, 0.0])"
_RETURN = "return estimates, covariances"

SLIPS = slips(
    encoder_always_trusted=(
        _LOADED,
        "if True:",
        _GATE,
        "if True:",
        "Every reading of the leg counts as a measurement of the height, in flight as well. There "
        "the encoder shows the rest length of the leg, whatever the height is.",
    ),
    flag_trusted=(
        _LOADED,
        "if contact[i] > 0.5:",
        _GATE,
        "if True:",
        "The contact sensor decides alone. It reports lift-off late, and in these samples the "
        "encoder shows the rest length instead of the height.",
    ),
    gate_without_load=(
        _LOADED,
        "if contact[i] > 0.5:",
        "A gate on the innovation cannot replace the test for contact. Right after lift-off the "
        "rest length hardly differs from the height, so the gate accepts it, and the filter is "
        "pulled down and sure of itself. Check in the force whether the leg carries load.",
    ),
    never_corrected=(
        _LOADED,
        "if False:",
        "The leg's readings are never used: the accelerometer alone drifts away with its bias.",
    ),
    bias_not_estimated=(
        "K = P @ H / S",
        "K = P @ H / S * [1.0, 1.0, 0.0]",
        "The bias stays what it was at the start. The readings of the leg determine it too, "
        "through its covariance with height and velocity: let the gain correct all three states.",
    ),
    offset_ignored=(
        _EXPECTED,
        "expected = x[0]",
        "The leg's length is taken for the height. It is sqrt(height^2 + offset^2).",
    ),
    slope_of_the_offset=(
        _H,
        "H = np.array([offset[i] / expected, 0.0, 0.0])",
        "The slope is the derivative with respect to the offset. The state is the height: "
        "H = height / length.",
    ),
    gravity_forgotten=(
        "(force[i] - 9.81)",
        "force[i]",
        "An accelerometer at rest shows 9.81 m/s^2, and in free fall zero. Subtract gravity from "
        "the specific force.",
    ),
    gravity_added=(
        "(force[i] - 9.81)",
        "(force[i] + 9.81)",
        "Gravity has the wrong sign. At rest the specific force is +9.81 m/s^2 and the "
        "acceleration zero.",
    ),
    process_noise_missing=(
        "P = A @ P @ A.T + Q",
        "P = A @ P @ A.T",
        "The noise of the accelerometer doesn't enlarge the covariance. The filter becomes too "
        "sure of itself and stops listening to the leg.",
    ),
    deviation_for_variance=(
        "R = noise[1] ** 2",
        "R = noise[1]",
        "R is a variance: square the standard deviation of the encoder. Unsquared, the filter "
        "hardly uses its readings.",
    ),
    noise_without_dt=(
        "Q = noise[0] ** 2 * np.outer(B, B)",
        "Q = noise[0] ** 2 * np.diag([0.0, 1.0, 0.0])",
        "The noise of the force is added to the velocity's variance as it is. It acts for dt: it "
        "enters through B, as the force does, so the variance is (sigma dt)^2.",
    ),
    covariance_not_updated=(
        "P = J @ P @ J.T + R * np.outer(K, K)",
        "pass",
        "A measurement corrects the state but doesn't reduce the covariance. It grows forever, "
        "and every reading is taken at face value.",
    ),
    standard_deviations_returned=(
        _RETURN,
        "return estimates, np.sqrt(np.abs(covariances))",
        "These are roots of the covariances. The task asks for covariances, with their squares "
        "of units.",
    ),
    one_sample_early=(
        _RETURN,
        "return np.vstack((estimates[1:], estimates[-1:])), covariances",
        "The estimates are one sample early: each row belongs to the sample before.",
    ),
    smoothed=(
        _RETURN,
        "for i in range(1, force.size - 1):\n"
        "        estimates[i] += 0.01 * (estimates[i + 1] - estimates[i - 1])\n"
        "    " + _RETURN,
        "The estimates use later samples. A filter that runs on the robot has none.",
    ),
)

EXERCISE = Exercise(
    judge=judge,
    examples=(
        # Two samples of free fall from 1 m.
        "hopper_filter([0.0, 0.0], [0.6, 0.6], [0.0, 0.0], [0, 0], [1.0, 0.0, 0.0], "
        "[0.1, 0.1, 0.1], [0.5, 0.004], 0.6, 0.01)",
        # Standing on the leg: the second reading measures the height.
        "hopper_filter([9.81, 9.81], [0.55, 0.55], [0.0, 0.0], [1, 1], [0.5, 0.0, 0.0], "
        "[0.1, 0.1, 0.1], [0.5, 0.004], 0.6, 0.01)",
    ),
    slips=SLIPS,
)
