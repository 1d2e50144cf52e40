"""Forward kinematics of a planar arm: values against the closed form, slips by their values."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place
from drills.exercise import Exercise, Slip
from drills.judge import Case, repeat_calls
from drills.values import Mismatch, as_float64, describe_call

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]

GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")
RELATIVE = 1e-12  # for each metre and radian, one of each added
WHY = "a closed form: only rounding is left, which grows with the arm's length and the angles"


def judge(attempt: Attempt) -> None:
    """Every case once in random order, then some again, then the time of a call."""
    cases = _cases(attempt.rng)
    made: list[tuple[tuple[Any, ...], Any]] = []
    for index in attempt.rng.permutation(len(cases)):
        case = cases[index]
        got = attempt.call(*case.args)
        made.append((case.args, got))
        truth = np.asarray(attempt.expected(*case.args))
        attempt.compare(
            case.label,
            got,
            truth,
            tolerance=_tolerance(case),
            unit="m",
            why=WHY,
            call=describe_call(attempt.card.entry, case.args),
            slip=_coarse(got, truth),
        )
    if not attempt.failed:
        repeat_calls(attempt, made)
    if not attempt.failed:
        attempt.time_call(*cases[0].args)


def _cases(rng: np.random.Generator) -> list[Case]:
    def lengths() -> Array:
        return rng.uniform(0.2, 1.5, 3)

    def angles() -> Array:
        return rng.uniform(-math.pi, math.pi, 3)

    quarter = math.pi / 2.0
    cases = [Case((lengths(), angles())) for _ in range(10)]
    cases += [
        Case((np.ones(3), np.zeros(3)), "stretched along x"),
        Case((lengths(), np.array([quarter, 0.0, 0.0])), "stretched along y"),
        Case((lengths(), np.array([0.0, math.pi, 0.0])), "folded back"),
        Case((lengths(), np.array([quarter, -quarter, quarter])), "a staircase"),
        Case((lengths(), np.array([0.0, 0.0, rng.uniform(0.3, 2.5)])), "the last joint alone"),
        Case((lengths(), -rng.uniform(0.1, 1.0, 3)), "all clockwise"),
        Case((lengths(), rng.uniform(20.0, 60.0, 3)), "many turns"),
        Case((np.array([1.0, 0.0, 0.5]), angles()), "a link of no length"),
        Case((np.zeros(3), angles()), "an arm of no length"),
        Case((np.array([1e-3, 1.0, 1e3]), angles()), "links of very different lengths"),
    ]
    return cases


def _tolerance(case: Case) -> float:
    lengths, thetas = case.args
    return float(RELATIVE * (1.0 + lengths.sum()) * (1.0 + np.abs(thetas).sum()))


def _coarse(got: Any, expected: Array) -> str:
    """The slip that shows in an answer which is right but for its digits, or ""."""
    try:
        values = as_float64(got, expected.shape)
    except Mismatch:
        return ""
    scale, error = max(1.0, float(np.abs(expected).max())), float(np.abs(values - expected).max())
    if error <= 1e-5 * scale and np.array_equal(values, values.astype(np.float32)):
        return "single_precision"
    decimals = next((k for k in range(2, 11) if np.array_equal(values, values.round(k))), None)
    if decimals is None or error > 0.501 * 10.0**-decimals or not values.any():
        return ""  # more than half a digit: another mistake, in numbers that happen to be short
    return "rounded"


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """A hundred poses of an arm, at joint angles from one radian to a million."""
    import mpmath

    from course.measure.work_precision import Method, Result, measure
    from course.oracles.pinocchio import PlanarChain

    lengths = np.array([0.4, 0.3, 0.2])
    shapes = np.random.default_rng(attempt.report.seed).uniform(-1.0, 1.0, (100, 3))
    poses = {size: size * shapes for size in (1e6, 1e4, 1e2, 1.0)}
    count = len(shapes)

    def exactly(thetas: Array) -> list[list[float]]:
        points, direction = [[mpmath.mpf(0)] * 2], mpmath.mpf(0)
        for length, theta in zip(lengths, thetas, strict=True):
            direction += mpmath.mpf(float(theta))
            turn = (mpmath.cos(direction), mpmath.sin(direction))
            ends = zip(points[-1], turn, strict=True)
            points.append([p + mpmath.mpf(float(length)) * t for p, t in ends])
        return [[float(x) for x in point] for point in points]

    def extended(thetas: Array) -> Array:
        directions = np.cumsum(thetas.astype(np.longdouble))
        links = np.stack((np.cos(directions), np.sin(directions)), axis=1)
        ends = np.cumsum(lengths.astype(np.longdouble)[:, None] * links, axis=0)
        return np.vstack((np.zeros(2), ends)).astype(float)

    with mpmath.workdps(40):
        truth = {size: np.array([exactly(p) for p in poses[size]]) for size in poses}
    second = [np.array([extended(p) for p in poses[size]]) - truth[size] for size in poses]
    library = PlanarChain(lengths)

    # What is charted is the deviation, as the truth differs from setting to setting.
    def driven(child: Place) -> Callable[[float], Result]:
        return lambda size: Result(child.given("drive", lengths, poses[size]) - truth[size], count)

    def asked(size: float) -> Result:
        answer = np.array([library.positions(thetas) for thetas in poses[size]])
        return Result(answer - truth[size], count)

    def single(size: float) -> Result:
        directions = np.cumsum(poses[size].astype(np.float32), axis=1)
        links = np.stack((np.cos(directions), np.sin(directions)), axis=2)
        ends = np.cumsum(lengths.astype(np.float32)[:, None] * links, axis=1)
        answer = np.concatenate((np.zeros((count, 1, 2)), ends), axis=1)
        return Result(answer - truth[size], count)

    unit, sizes = "poses", list(poses)
    return measure(
        [
            Method("yours", driven(attempt.learner.child), sizes, style="yours", unit=unit),
            Method("worked answer", driven(worked), sizes, unit=unit),
            Method("all poses at once, float32", single, sizes, unit=unit),
            Method("Pinocchio", asked, sizes, style="oracle", unit=unit),
        ],
        np.zeros((count, 4, 2)),
        reference_check=np.max(np.abs(second), axis=0),
        tolerance=1e-6,
        failed_above=float(2.0 * lengths.sum()),
        repeats=3,
        question="100 poses of a 3-link arm, angles up to the setting in rad",
        error_unit="m",
    )


_DIRECTIONS = "    directions = np.cumsum(thetas)\n"
_LINKS = "np.column_stack((np.cos(directions), np.sin(directions)))"
_RETURN = "    return np.vstack((np.zeros(2), np.cumsum(links, axis=0)))\n"


def _returning(value: str) -> tuple[tuple[str, str], ...]:
    return ((_RETURN, f"    return {value}\n"),)


def _directed(value: str) -> tuple[tuple[str, str], ...]:
    return ((_DIRECTIONS, f"    directions = {value}\n"),)


EXERCISE = Exercise(
    judge=judge,
    given=GIVEN,
    examples=(
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.0]))",
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.5, 0.0, 0.0]))",
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.5, -0.5, 0.5]))",
        "fk3(np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, -0.2]))",
    ),
    chart=chart,
    slips=(
        Slip(
            "degrees_for_radians",
            "The angles are treated as degrees. They come in radians, which is what np.cos and "
            "np.sin take: convert nothing.",
            edits=_directed("np.cumsum(np.deg2rad(thetas))"),
        ),
        Slip(
            "absolute_angles",
            "Each angle is taken from the x axis. It is measured from the link before: the "
            "direction of a link is the sum of all angles up to its joint.",
            edits=_directed("thetas"),
        ),
        Slip(
            "last_joint_forgotten",
            "The last joint does nothing: the third link follows the direction of the second. "
            "Its direction is the sum of all three angles.",
            edits=_directed("np.cumsum(thetas * [1.0, 1.0, 0.0])"),
        ),
        Slip(
            "turned_one_link_late",
            "Every joint turns the link after the next: the sum of the angles lags behind by one. "
            "Add a joint's angle before you place its link.",
            edits=_directed("np.cumsum(thetas) - thetas"),
        ),
        Slip(
            "elbow_sign",
            "The elbow bends the wrong way: the second angle is subtracted where it is added. "
            "All joints turn counter-clockwise.",
            edits=_directed("np.cumsum(thetas * [1.0, -1.0, 1.0])"),
        ),
        Slip(
            "clockwise",
            "The arm is mirrored in the x axis: your angles count clockwise, or y points down as "
            "on a screen. Here angles count counter-clockwise and y points up.",
            edits=_directed("-np.cumsum(thetas)"),
        ),
        Slip(
            "sine_and_cosine_swapped",
            "Sine and cosine are swapped, so that a zero angle points along y. x goes with the "
            "cosine, y with the sine.",
            edits=((_LINKS, "np.column_stack((np.sin(directions), np.cos(directions)))"),),
        ),
        Slip(
            "links_not_added_up",
            "Each row is one link as seen from its own joint. A joint's position is the sum of all "
            "links before it.",
            edits=_returning("np.vstack((np.zeros(2), links))"),
        ),
        Slip(
            "lengths_reversed",
            "The link lengths are used from tip to base. They come from base to tip.",
            edits=(("lengths[:, None]", "lengths[::-1, None]"),),
        ),
        Slip(
            "order_reversed",
            "The points are right but run from tip to base. The base comes first.",
            edits=_returning("np.vstack((np.zeros(2), np.cumsum(links, axis=0)))[::-1]"),
        ),
        Slip(
            "tip_missing",
            "The tip is missing: three links end in three points, and the base is a fourth.",
            edits=_returning("np.vstack((np.zeros(2), np.cumsum(links, axis=0)))[:-1]"),
        ),
        Slip(
            "base_missing",
            "The base is missing: the first row is the origin, where the first joint sits.",
            edits=_returning("np.cumsum(links, axis=0)"),
        ),
        Slip(
            "tip_only",
            "Only the tip came back. Drawing an arm, or checking it for collisions, takes every "
            "joint: base, both inner joints, tip.",
            edits=_returning("np.sum(links, axis=0)"),
        ),
        Slip(
            "rows_and_columns_swapped",
            "The points are right but stand in columns. One row is one point, (x, y).",
            edits=_returning("np.vstack((np.zeros(2), np.cumsum(links, axis=0))).T"),
        ),
        Slip(
            "single_precision",
            "The answer is right to single precision only: somewhere it became float32, of "
            "seven digits. A difference of two near positions then has hardly any. Keep float64.",
            edits=((_RETURN, _RETURN.replace("\n", ".astype(np.float32)\n")),),
        ),
        Slip(
            "rounded",
            "The answer is rounded to a few decimals. Round when you print, never what you return: "
            "the next computation needs the digits.",
            edits=_returning("np.round(np.vstack((np.zeros(2), np.cumsum(links, axis=0))), 6)"),
        ),
    ),
)
