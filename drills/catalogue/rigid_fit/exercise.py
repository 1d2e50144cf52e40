"""The best rigid motion: shifts and quarter turns first, then noise, flat points, mirror images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]
LEAST = 0.1  # of the largest singular value, what tells the weakest turn


def clear(source: Array, target: Array, weights: Array) -> bool:
    """Return whether the best rotation is no close call: the weakest turn is told well."""
    w = weights / weights.sum()
    a, b = source - (source @ w)[:, None], target - (target @ w)[:, None]
    spread = b * w @ a.T
    s, handed = np.linalg.svd(spread)[1], np.linalg.det(spread)
    return bool(s[1] + np.sign(handed) * s[2] > LEAST * s[0])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return shifts, quarter turns; then any motion, with noise and weights."""

    def pairs(
        label: str,
        n: int = 12,
        *,
        turned: bool = True,
        noise: float = 0.0,
        form: tuple[float, ...] = (1.0, 0.7, 0.4),
        weighted: bool = False,
        level: str = "core",
        mirrored: bool = False,
        far: float = 0.5,
    ) -> Case:
        while True:
            a = np.array(form)[:, None] * rng.normal(size=(3, n)) + far * rng.normal(size=(3, 1))
            Q = np.linalg.qr(rng.normal(size=(3, 3)))[0] if turned else np.eye(3)
            Q *= np.linalg.det(Q)
            b = Q @ (a * np.array([1.0, 1.0, -1.0 if mirrored else 1.0])[:, None])
            b += far * rng.normal(size=(3, 1)) + noise * rng.normal(size=(3, n))
            w = rng.uniform(0.1, 3.0, n) if weighted else np.ones(n)
            if clear(a, b, w):
                return Case((a, b, w), label, level)

    corners = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 3.0]])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    some = pairs("", 9, noise=0.2).args
    stray = np.hstack((some[1], 5.0 * rng.normal(size=(3, 3))))
    lost = np.hstack((some[0], rng.normal(size=(3, 3)))), stray, np.append(some[2], np.zeros(3))
    whole = (
        np.array([[0, 3, 0, 1], [0, 0, 4, 1], [0, 0, 0, 5]]),
        np.array([[1, 1, -3, 0], [2, 5, 2, 4], [3, 3, 4, 8]]),
        np.array([1, 2, 1, 3]),
    )
    return [
        pairs("a shift", 5, turned=False, level="simple"),
        Case((corners, quarter @ corners, np.ones(4)), "a quarter turn", "simple"),
        Case((corners, quarter @ corners + 1.0, np.ones(4)), "turn and shift", "simple"),
        *(pairs("any motion", n) for n in (5, 30)),
        *(pairs("noise", noise=size) for size in (0.02, 0.3)),
        *(pairs("noise, weights", noise=0.3, weighted=True) for _ in range(3)),
        pairs("flat points", form=(1.0, 0.7, 0.0)),
        *(pairs("flat points, noise", form=(1.0, 0.7, 0.0), noise=0.1) for _ in range(3)),
        *(pairs("a mirror image", mirrored=True, weighted=True) for _ in range(3)),
        Case(lost, "points that don't count"),
        pairs("far from the origin", noise=0.02, far=30.0),
        pairs("three points", 3, noise=0.1, level="edge"),
        Case((some[0], some[0].copy(), some[2]), "nothing to do", "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-10 of R, and of the largest coordinate."""
    return [1e-10, 1e-10 * max(1.0, *(float(np.abs(value).max()) for value in case.args[:2]))]


def explain(answers: Sequence[Answer]) -> str:
    """Return digits that are gone, or a mirror image, whatever made it."""
    mirrored = [
        np.linalg.det(np.asarray(a.parts[0], dtype=float)) < -0.5
        for a in answers
        if largest_error(a.parts[0], a.truth[0]) < np.inf
    ]
    return coarse(answers) or ("mirror_image" if any(mirrored) else "")


def brought(figure: Any, shown: Shown) -> None:
    """Check where the answer brings a point that lies above the others."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    axes.plot(*shown.args[1][:2], "o", color="0.75", label="target")
    for (R, p), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        other = np.asarray(R) @ shown.args[0] + np.asarray(p)[:, None]
        axes.plot(*other[:2], "x", **style | {"ls": ""})
    axes.legend()


_KEPT = "R = Vt.T @ np.diag([1.0, 1.0, handed]) @ U.T"
_SHIFT = "return R, end - R @ start"
_SPREAD = "spread = (a - start[:, None]) * w @ (b - end[:, None]).T"
_MEANS = "start, end = a @ w, b @ w"

SLIPS = slips(
    mirror_image=(
        _KEPT,
        "R = Vt.T @ U.T",
        "R may be a mirror image: nobody looks at the determinant. Flat or noisy points then come "
        "out turned inside out.",
    ),
    all_signs_changed=(
        _KEPT,
        "R = handed * (Vt.T @ U.T)",
        "A mirror is mended by the sign of all of R. That is a rotation, and not the best: only "
        "the direction of the smallest singular value is to be turned back.",
    ),
    strongest_direction_turned=(
        _KEPT,
        _KEPT.replace("[1.0, 1.0, handed]", "[handed, 1.0, 1.0]"),
        "The determinant goes to the largest singular value. Turn the weakest direction back: that "
        "costs least.",
    ),
    transposed=(
        _KEPT,
        "R = (Vt.T @ np.diag([1.0, 1.0, handed]) @ U.T).T",
        "R is transposed: it turns the target's way back, while the shift is meant for the way "
        "there.",
    ),
    direction_swapped=(
        _SHIFT,
        "return R.T, start - R.T @ end",
        "This motion brings the target onto the source. The other way is asked for.",
    ),
    not_centred=(
        _SPREAD,
        "spread = a * w @ b.T",
        "The means are still in the products: far from the origin the place decides about R. Take "
        "the means off first.",
    ),
    shift_without_the_turn=(
        _SHIFT,
        "return R, end - start",
        "p is the difference of the means. R turns about the origin and so moves the mean: p = "
        "mean(target) - R mean(source).",
    ),
    means_without_weights=(
        _MEANS,
        "start, end = a.mean(axis=1), b.mean(axis=1)",
        "The means are taken without the weights.",
    ),
    no_weights=(
        "w = w / w.sum()",
        "w = np.ones(len(w)) / len(w)",
        "The weights are not used: points of weight 0 count too.",
    ),
    weights_squared=(
        "(a - start[:, None]) * w @",
        "(a - start[:, None]) * w**2 @",
        "The weights enter the sum of products twice. Multiply one of the two sets by them.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "singular vectors of a 3 x 3 matrix: rounding", explain=explain),
    examples=(
        "rigid_fit(np.eye(3), np.eye(3)[:, [1, 2, 0]], np.ones(3))",
        "rigid_fit([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[1, 2, 1], [2, 2, 3], [3, 3, 3]], [1] * 3)",
        "rigid_fit([[0, 1, 0], [0, 0, 2], [0, 0, 0]], [[0, -1, 0], [0, 0, 2], [0, 0, 0]], [1] * 3)",
    ),
    picture=brought,
    slips=SLIPS
    + coarse_slips("rigid_fit", "R is then no rotation to that digit, and errors add up.")
    + value_slips("rigid_fit"),
)
