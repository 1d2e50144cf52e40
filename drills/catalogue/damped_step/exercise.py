"""Damped least squares: the bound on the step first, then its values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]
TINY = "a damping of 1e-7"


def _two_link(q1: float, q2: float) -> Array:
    one, both = (
        np.array([math.cos(q1), math.sin(q1)]),
        np.array([math.cos(q1 + q2), math.sin(q1 + q2)]),
    )
    ahead = np.column_stack((one + 0.7 * both, 0.7 * both))
    return np.array([-ahead[1], ahead[0]])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return arms far from, near and at a singularity, and Jacobians of every shape."""

    def drawn(m: int, n: int, damping: float, label: str = "random", level: str = "core") -> Case:
        return Case((rng.normal(size=(m, n)), rng.normal(size=m), damping), label, level)

    def arm(bend: float, damping: float, label: str, level: str = "core") -> Case:
        error = 0.3 * rng.normal(size=2)
        return Case((_two_link(float(rng.uniform(-3, 3)), bend), error, damping), label, level)

    def singular(size: int, damping: float, label: str, level: str) -> Case:
        U, _, Vt = np.linalg.svd(rng.normal(size=(size, size)))
        s = np.array([*rng.uniform(0.5, 2.0, size - 1), damping])
        return Case((U * s @ Vt, U @ rng.uniform(0.3, 1.0, size), damping), label, level)

    return [
        Case((np.eye(2), np.array([1.0, -0.5]), 1.0), "the identity", "simple"),
        Case((np.array([[2.0]]), np.array([1.0]), 0.5), "one joint", "simple"),
        Case((np.diag([1.0, 0.1]), rng.uniform(0.5, 1, 2), 0.1), "one small value", "simple"),
        arm(1.4, 0.1, "a bent arm"),
        arm(0.02, 0.1, "an arm nearly stretched"),
        arm(0.0, 0.1, "a stretched arm"),
        *(drawn(m, n, float(10.0 ** rng.uniform(-1.5, 0.5))) for m, n in ((3, 3), (6, 6), (6, 7))),
        drawn(3, 7, 0.2, "more joints than rows"),
        drawn(3, 2, 0.3, "fewer joints than rows"),
        drawn(2, 5, 3.0, "strongly damped"),
        singular(4, 0.05, "a singular value equal to the damping", "core"),
        singular(3, 1e-7, TINY, "edge"),
        Case((np.outer([0.6, 0.8], [0.8, -0.6]), rng.normal(size=2), 1e-2), "rank one", "edge"),
        Case((np.zeros((3, 4)), rng.normal(size=3), 0.1), "a Jacobian of zeros", "edge"),
        Case((rng.normal(size=(3, 4)), np.zeros(3), 0.1), "no error", "edge"),
        Case((1e-4 * rng.normal(size=(2, 3)), rng.normal(size=2), 1e-4), "small numbers", "edge"),
        Case((np.array([[2, 1, 0], [1, 3, 1]]), np.array([3, -2]), 2), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: Any) -> float:
    """Return the tolerance: 1e-10 of the bound plus the Jacobian's round-off."""
    J, error, damping = case.args
    bound = float(np.linalg.norm(error)) / (2.0 * damping)
    return bound * (1e-10 + 1e-14 * (1.0 + float(np.linalg.norm(J))) / damping) + 1e-15


def bounded(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check the bound: it says what is wrong, a value only that something is."""
    J, error, damping = case.args
    try:
        step = as_float64(parts[0], (np.shape(J)[1],))
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        length, bound = float(np.linalg.norm(step)), float(np.linalg.norm(error)) / (2.0 * damping)
    attempt.require(
        f"{case.label}: the bound",
        bool(not length > bound + allowed(case, None)),
        sentence=f"The step is {length:.3g} rad long; damping of {damping:.3g} m/rad bounds it by "
        f"|error| / (2 damping) = {bound:.3g} rad.",
        got=f"{length:.6g}",
        expected=f"at most {bound:.6g}",
        call=call,
    )


def explain(answers: Sequence[Answer]) -> str:
    """Return digits that are lost only where the damping is tiny; what is coarse everywhere."""
    wrong = [a for a in answers if not all(a.right)]
    if wrong and all(a.case.label == TINY for a in wrong):
        return "damping_lost"
    return coarse(answers)


def joints(figure: Any, shown: Shown) -> None:
    """Plot the step, joint by joint, and its bound."""
    axes = picture.plane(figure, "joint", "step [rad]")
    J, error, damping = shown.args
    bound = float(np.linalg.norm(error)) / (2.0 * damping)
    number = np.arange(np.shape(J)[1])
    axes.axhspan(-bound, bound, color="0.93", label="the bound of its length")
    axes.plot(number, shown.got[0], "o-", **picture.YOURS)
    axes.plot(number, shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks(number)
    difference = np.max(np.abs(np.asarray(shown.got[0]) - shown.expected[0]))
    axes.set_title(f"largest difference {difference:.2g} rad")
    axes.legend()


_GAIN = "gain = s / (s**2 + damping**2)"
_RETURN = "return Vt.T @ (gain * (U.T @ np.asarray(error, dtype=float)))"

SLIPS = slips(
    damping_not_squared=(
        _GAIN,
        "gain = s / (s**2 + damping)",
        "The damping is added as it is; its square belongs there. The units say so: J J^T is in "
        "m^2/rad^2, damping in m/rad.",
    ),
    pseudo_inverse=(
        "    " + _GAIN + "\n",
        "",
        _RETURN,
        "return np.linalg.pinv(np.asarray(J, dtype=float)) @ error",
        "This is the pseudo-inverse: the damping does nothing. Beside a singularity its steps "
        "have no bound.",
    ),
    transpose_alone=(
        _GAIN,
        "gain = s",
        "This is J^T error, the gradient. Damping divides it by s^2 + lambda^2 in each singular "
        "direction: solve with J J^T + lambda^2 I first.",
    ),
    damping_added_to_values=(
        _GAIN,
        "gain = 1.0 / (s + damping)",
        "The damping is added to the singular values themselves, 1 / (s + lambda). That is "
        "bounded by 1 / lambda, moves along directions that the arm has not, and is another step.",
    ),
    small_values_cut_off=(
        _GAIN,
        "gain = np.where(s > damping, 1.0 / np.maximum(s, 1e-300), 0.0)",
        "Singular values below the damping are left out and the others are not damped. That "
        "jumps when a value crosses the limit; damping changes smoothly.",
    ),
    damped_only_when_singular=(
        _GAIN,
        "gain = s / (s**2 + damping**2) if s.min() < damping else 1.0 / s",
        "The damping is switched on only near a singularity. Here it always acts, by how much the "
        "singular values decide.",
    ),
    step_cut_off=(
        "    " + _GAIN + "\n",
        "",
        _RETURN,
        "step = np.linalg.pinv(np.asarray(J, dtype=float)) @ np.asarray(error, dtype=float)\n"
        "    size, bound = np.linalg.norm(step), np.linalg.norm(error) / (2.0 * damping)\n"
        "    return step * min(1.0, bound / size) if size else step",
        "The step of the pseudo-inverse is cut off at the bound. It points along the singular "
        "direction, which is the worst of all; damping turns it away from there.",
    ),
    sign_of_the_error=(
        _RETURN,
        _RETURN.replace("return ", "return -"),
        "The step goes the other way: the error is target minus tip, what is yet to move.",
    ),
    damping_twice=(
        _GAIN,
        "gain = s / (s**2 + 2.0 * damping**2)",
        "The damping counts twice: a factor of 2 comes from one of the two squares and not from "
        "the other. The gradient of both has it.",
    ),
    damping_halved=(
        _GAIN,
        "gain = s / (s**2 + 0.25 * damping**2)",
        "The damping is halved, as by a 1/2 that stands at one of the two squares only. The bound "
        "is then twice as high.",
    ),
    damping_to_the_fourth=(
        _GAIN,
        "gain = s / (s**2 + damping**4)",
        "The damping is squared twice: in the stacked system [J; lambda I] it stands as it is, and "
        "its square comes by itself.",
    ),
    damping_relative=(
        _GAIN,
        "gain = s / (s**2 + (damping * s.max()) ** 2)",
        "The damping is taken relative to the largest singular value. It is given in m/rad, the "
        "unit of the singular values, and is used as it is.",
    ),
    gain_squared=(
        _GAIN,
        "gain = s / (s**2 + damping**2) * s**2 / (s**2 + damping**2)",
        "The damping acts twice, as in J^T times a damped inverse of a Jacobian that was damped "
        "already.",
    ),
    damping_lost=(
        "    U, s, Vt = np.linalg.svd(np.asarray(J, dtype=float), full_matrices=False)\n",
        "    J = np.asarray(J, dtype=float)\n",
        "    " + _GAIN + "\n",
        "",
        _RETURN,
        "normal = J @ J.T + damping**2 * np.eye(len(J))\n"
        "    return J.T @ np.linalg.lstsq(normal, np.asarray(error, dtype=float), 1e-300)[0]",
        "The formula is right and its digits are gone: damping^2 = 1e-14 beside numbers of one "
        "leaves two digits in J J^T + damping^2 I. Use the singular values of J itself.",
    ),
    cut_off_relative_to_the_largest=(
        "    " + _GAIN + "\n",
        "",
        _RETURN,
        "return np.linalg.pinv(np.asarray(J, dtype=float), rcond=damping) @ error",
        "The damping is used as the limit below which the pseudo-inverse drops singular values. "
        "Damping drops none: each gets the factor s / (s^2 + lambda^2).",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "singular values are known to rounding of the largest; the gain turns it by 1 / damping",
        first=bounded,
        explain=explain,
    ),
    examples=(
        "damped_step(np.eye(2), np.array([1.0, -0.5]), 1.0)",
        "damped_step(np.array([[0.0, 0.0], [1.7, 0.7]]), np.array([0.1, 0.0]), 0.1)",
        "damped_step(np.array([[0.1]]), np.array([1.0]), 0.1)",
    ),
    picture=joints,
    slips=SLIPS
    + coarse_slips("damped_step", "What is left of the error then never gets below 1e-7.")
    + value_slips("damped_step", in_part=False),
)
