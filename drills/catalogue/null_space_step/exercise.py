"""Redundancy: that the tip moves as asked, then the step nearest to the second wish."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]


def _planar(q: Array) -> tuple[Array, Array]:
    """Return the tip's Jacobian (2, n) of a planar arm, and the gradient of the elbow's height.

    Its links are equal; the elbow is the point after two of them.
    """
    angle = np.cumsum(q)
    links = np.stack((np.cos(angle), np.sin(angle))) * 0.4
    ahead = np.cumsum(links[:, ::-1], axis=1)[:, ::-1]  # from each joint to the tip
    elbow = np.zeros(len(q))
    elbow[:2] = ahead[0, :2] - ahead[0, 2]
    return np.stack((-ahead[1], ahead[0])), elbow


def cases(rng: np.random.Generator) -> list[Case]:
    """Return arms in the plane whose elbow is to rise, random Jacobians, and a square one."""

    def jacobian(m: int, n: int) -> Array:
        U, _, _ = np.linalg.svd(rng.normal(size=(m, m)))
        _, _, Vt = np.linalg.svd(rng.normal(size=(m, n)), full_matrices=False)
        return np.asarray(U * rng.uniform(0.3, 2.0, m) @ Vt)

    def drawn(m: int, n: int, spread: float, label: str = "random", level: str = "core") -> Case:
        weights = 10.0 ** rng.uniform(-spread, spread, n)
        args = jacobian(m, n), rng.normal(size=m), rng.normal(size=n), weights
        return Case(args, label, level)

    def elbow(n: int, equal: bool, label: str, level: str = "core") -> Case:
        J, up = _planar(np.array([rng.uniform(-1, 1), *rng.uniform(0.5, 1.1, n - 1)]))
        weights = np.ones(n) if equal else rng.uniform(0.2, 5.0, n)
        return Case((J, np.zeros(2), up, weights), label, level)

    J = jacobian(3, 7)
    return [
        Case(
            (np.array([[1.0, 1.0]]), np.zeros(1), np.array([1.0, 0.0]), np.ones(2)),
            "two joints that undo each other",
            "simple",
        ),
        elbow(3, True, "raise the elbow, equal weights", "simple"),
        Case(
            (jacobian(2, 3), rng.normal(size=2), np.zeros(3), np.ones(3)),
            "the task alone",
            "simple",
        ),
        elbow(3, False, "raise the elbow"),
        elbow(5, False, "raise the elbow of five links"),
        *(drawn(m, n, 0.6) for m, n in ((2, 3), (3, 5), (6, 7), (1, 4))),
        Case((J, np.zeros(3), rng.normal(size=7), rng.uniform(0.2, 5.0, 7)), "the tip stays"),
        Case((J, rng.normal(size=3), np.zeros(7), rng.uniform(0.2, 5.0, 7)), "nothing wished"),
        Case(
            (J, rng.normal(size=3), J.T @ rng.normal(size=3), np.ones(7)),
            "a wish that only moves the tip",
        ),
        drawn(4, 4, 0.5, "nothing left over", "edge"),
        drawn(3, 6, 2.0, "weights from 0.01 to 100", "edge"),
        Case(
            (
                np.array([[1, 1, 0], [0, 1, 2]]),
                np.array([1, 3]),
                np.array([2, 0, -1]),
                np.array([1, 4, 9]),
            ),
            WHOLE,
            "edge",
        ),
    ]


def allowed(case: Case, truth: Any) -> float:
    """Return 1e-9 of the size of what goes in, one added."""
    return float(1e-9 * (1.0 + np.linalg.norm(case.args[1]) + np.linalg.norm(case.args[2])))


def tip_first(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check what the tip does: it says what is wrong, a value only that something is."""
    J, dx = (np.asarray(value, dtype=float) for value in case.args[:2])
    try:
        step = as_float64(parts[0], (J.shape[1],))
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        moved = J @ step
        error = float(np.linalg.norm(moved - dx))
        tolerance = 10.0 * allowed(case, None)
    attempt.require(
        f"{case.label}: the tip",
        bool(error <= tolerance),
        sentence=f"J dq is {error:.3g} m away from dx: the tip "
        + ("does not stay where it is." if not dx.any() else "does not go where it should."),
        got=np.array2string(moved, precision=6),
        expected=np.array2string(dx, precision=6),
        error=error,
        tolerance=tolerance,
        unit="m",
        why="the step solves J dq = dx, but for rounding",
        call=call,
    )


def joints(figure: Any, shown: Shown) -> None:
    """Plot the step, joint by joint, and the wish."""
    axes = picture.plane(figure, "joint", "step [rad]")
    number = np.arange(len(shown.args[2]))
    axes.plot(number, shown.args[2], "s:", color="0.7", label="wished")
    axes.plot(number, shown.got[0], "o-", **picture.YOURS)
    axes.plot(number, shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks(number)
    axes.legend()


_RETURN = "return secondary + inverse @ (dx - J @ secondary)"
_SCALE = "scale = np.sqrt(np.asarray(weights, dtype=float))"
_PLAIN = "np.linalg.pinv(J)"

SLIPS = slips(
    projector_transposed=(
        _RETURN,
        "return inverse @ dx + secondary - J.T @ (inverse.T @ secondary)",
        "The projector is transposed: I - J^T A^T. That one takes joint torques to those that do "
        "not push at the tip; with equal weights it is the same. For velocities it is I - A J.",
    ),
    not_projected=(
        _RETURN,
        "return inverse @ dx + secondary",
        "The second wish is added as it is, and moves the tip by J @ secondary. Project it first: "
        "subtract A J secondary.",
    ),
    weights_ignored=(
        _SCALE,
        "scale = np.ones(J.shape[1])",
        "The weights do nothing: this is the plain pseudo-inverse, where all joints count alike.",
    ),
    weights_upside_down=(
        _SCALE,
        "scale = 1.0 / np.sqrt(np.asarray(weights, dtype=float))",
        "The weights are used upside down: a joint of large weight must stay nearer to the wish. "
        "A = W^-1 J^T (J W^-1 J^T)^-1 has the inverse of W.",
    ),
    weights_for_their_roots=(
        _SCALE,
        "scale = np.asarray(weights, dtype=float)",
        "The weights count squared: in units in which all joints weigh the same each is scaled by "
        "the root of its weight.",
    ),
    roots_for_the_weights=(
        _SCALE,
        "scale = np.asarray(weights, dtype=float) ** 0.25",
        "The weights count with their roots only.",
    ),
    task_dropped=(
        _RETURN,
        "return secondary - inverse @ (J @ secondary)",
        "The task is missing: the elbow moves, and the tip stays although dx is not zero.",
    ),
    wish_dropped=(
        _RETURN,
        "return inverse @ np.asarray(dx, dtype=float)",
        "The second wish is missing: this is the smallest step that does the task.",
    ),
    wrong_space=(
        _RETURN,
        "return inverse @ (dx + J @ secondary)",
        "The wish is projected onto what moves the tip, A J, not onto what leaves it, I - A J.",
    ),
    projector_added=(
        _RETURN,
        "return secondary + inverse @ (dx + J @ secondary)",
        "The projector is I - A J, with a minus: take out of the wish what would move the tip.",
    ),
    wish_reversed=(
        _RETURN,
        "return inverse @ (dx + J @ secondary) - secondary",
        "The wish has the wrong sign: the elbow goes down where it should go up. The tip does not "
        "see it.",
    ),
    two_inverses=(
        _RETURN,
        f"return inverse @ dx + secondary - {_PLAIN} @ (J @ secondary)",
        "The task uses the weights and the projector does not. Each alone is right for the tip; "
        "the step nearest to the wish takes the same A twice.",
    ),
    weights_in_the_projector_only=(
        _RETURN,
        f"return {_PLAIN} @ dx + secondary - inverse @ (J @ secondary)",
        "The projector uses the weights and the task does not: take the same A twice.",
    ),
    transpose_for_the_inverse=(
        "np.linalg.pinv(J / scale) / scale[:, None]",
        "(J / scale).T / scale[:, None]",
        "J^T stands where the pseudo-inverse belongs. J^T J is a projector only for a Jacobian "
        "with orthonormal rows.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "a linear system whose condition is below 1e5: rounding is left",
        first=tip_first,
        explain=coarse,
    ),
    examples=(
        "null_space_step(np.array([[1.0, 1.0]]), np.array([0.0]), np.array([1.0, 0.0]), "
        "np.array([1.0, 1.0]))",
        "null_space_step(np.array([[1.0, 1.0]]), np.array([0.0]), np.array([1.0, 0.0]), "
        "np.array([1.0, 3.0]))",
        "null_space_step(np.array([[1.0, 1.0]]), np.array([0.4]), np.array([0.0, 0.0]), "
        "np.array([1.0, 3.0]))",
    ),
    picture=joints,
    slips=SLIPS
    + coarse_slips("null_space_step", "The tip then creeps away over many steps.")
    + value_slips("null_space_step", in_part=False),
)
