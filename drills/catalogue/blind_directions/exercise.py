"""Blind motions of patches, balls, cylinders and boxes of all sizes, in any place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]
LEAST = 0.02


def clear(args: tuple[Any, ...]) -> bool:
    """Return whether each motion is seen well, or far from it."""
    points, normals, lever, least = args
    rows = np.vstack((normals, np.cross(points.T, normals.T).T / lever))
    gaps = np.sqrt(np.clip(np.linalg.eigvalsh(rows @ rows.T / rows.shape[1]), 0.0, None))
    return not np.any((gaps > least / 3.0) & (gaps < 2.0 * least))


def small_beside_the_largest(args: tuple[Any, ...], low: float, high: float) -> bool:
    """Return whether a gap between two values is below the threshold times the largest gap."""
    points, normals, lever, least = args
    rows = np.vstack((normals, np.cross(points.T, normals.T).T / lever))
    gaps = np.sqrt(np.clip(np.linalg.eigvalsh(rows @ rows.T / rows.shape[1]), 0.0, None))
    return bool(np.any((gaps > low) & (gaps < min(high, 0.7 * least * gaps[-1]))))


def cases(rng: np.random.Generator) -> list[Case]:
    """Return surfaces with known blind motions, about the origin, then in any pose and size."""

    def surface(kind: str, n: int) -> tuple[Array, Array]:
        """Return points and normals of a surface of size one about its frame's origin."""
        if kind == "ball":
            normals = rng.normal(size=(3, n))
            normals /= np.linalg.norm(normals, axis=0)
            return normals.copy(), normals
        along, turn = rng.uniform(-1.0, 1.0, (2, n)), rng.uniform(0.0, 2.0 * np.pi, n)
        if kind == "cylinder":
            normals = np.array([np.cos(turn), np.sin(turn), 0.0 * turn])
            return normals + np.array([[0.0], [0.0], [1.5]]) * along[0], normals
        faces = {"patch": [2], "edge": [2, 0], "corner": [0, 1, 2]}[kind]
        normals = np.eye(3)[:, rng.permutation(np.resize(faces, n))]
        return np.where(normals > 0.0, 1.0, rng.uniform(-1.0, 1.0, (3, n))), normals

    def observed(
        kind: str,
        label: str = "",
        *,
        n: int = 40,
        size: float = 1.0,
        moved: float = 0.0,
        rough: float = 0.0,
        level: str = "core",
        least: float = LEAST,
        between: tuple[float, float] | None = None,
    ) -> Case:
        while True:
            points, normals = surface(kind, n)
            normals = normals + rough * rng.normal(size=(3, n))
            normals /= np.linalg.norm(normals, axis=0)
            if moved:
                Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
                points, normals = Q @ points + moved * rng.normal(size=(3, 1)), Q @ normals
            args = size * points, normals, size * rng.uniform(0.8, 1.3), least
            if clear(args) and (not between or small_beside_the_largest(args, *between)):
                return Case(args, label or f"a {kind}", level)

    # A peg whose axis does not go through the origin: turning about the axis is a shift and a turn
    # of the frame, so the projector holds fractions although the points are integers.
    whole = (
        np.array([[3, -1, 1, 1], [1, 1, 3, -1], [1, 4, 0, 5]]),
        np.array([[1, -1, 0, 0], [0, 0, 1, -1], [0, 0, 0, 0]]),
        2.5,
        1e-3,
    )
    small, large = 0.01, 3.0
    return [
        *(observed(kind, level="simple") for kind in ("patch", "ball", "cylinder")),
        *(
            observed(kind, f"{kind}, moved and turned", moved=0.6)
            for kind in ("patch", "ball", "cylinder", "edge", "corner")
        ),
        *(
            observed(kind, f"{kind} of centimetres", size=small, moved=0.6)
            for kind in ("ball", "cylinder", "edge", "corner")
        ),
        *(
            observed(kind, f"{kind} of metres", size=large, moved=0.6)
            for kind in ("cylinder", "corner")
        ),
        *(
            observed(kind, f"{kind}, rough", rough=2e-4, moved=0.6)
            for kind in ("patch", "cylinder")
        ),
        *(
            observed(kind, f"{kind}, many points", n=400, rough=2e-3, moved=0.6)
            for kind in ("patch", "ball")
        ),
        observed("cylinder", "a strict threshold", rough=1e-2, least=1e-4, moved=0.6),
        # Far from the origin a turn moves the points by many levers, so the largest mean square is
        # far above 1: a threshold in parts of it takes observed motions for blind ones.
        observed(
            "patch", "far from the origin", rough=0.06, moved=8.0, between=(LEAST, 0.8 * LEAST**0.5)
        ),
        # A threshold that is not squared, sqrt(least), is above that gap and below this one.
        observed(
            "patch", "far away, rough", rough=0.2, moved=25.0, between=(1.2 * LEAST**0.5, 1.0)
        ),
        observed("corner", "all is seen", n=60, level="edge"),
        observed("patch", "one point", n=1, level="edge"),
        Case(whole, WHOLE, "edge"),
    ]


def explain(answers: Sequence[Answer]) -> str:
    """Explain lost digits, or a single blind motion that is always returned.

    Chance decides which of several motions it is.
    """
    one = all(largest_error(a.parts[0], 1.0) == 0.0 for a in answers)
    return coarse(answers) or ("smallest_taken_for_null" if one else "")


_ROWS = "rows = np.hstack((n, np.cross(x, n) / lever))"
_BLIND = "blind = motions[:, values < least**2]"
_MEAN = "rows.T @ rows / len(rows)"

SLIPS = slips(
    radians_beside_metres=(
        "np.cross(x, n) / lever",
        "np.cross(x, n)",
        "Turns in radians stand beside shifts in metres: of a small part every turn looks blind. "
        "Divide the turn's columns by the lever.",
    ),
    lever_upside_down=(
        "np.cross(x, n) / lever",
        "np.cross(x, n) * lever",
        "The turn's columns are multiplied by the lever. The unknown is lever times w, so they are "
        "divided by it.",
    ),
    smallest_taken_for_null=(
        _BLIND,
        "blind = motions[:, :1]",
        "The smallest eigenvalue is taken for a null space. It may be large, and there may be "
        "several that are null.",
    ),
    sum_for_mean=(
        _MEAN,
        "rows.T @ rows",
        "The squares are summed, not averaged: with more points everything counts as seen.",
    ),
    threshold_not_squared=(
        _BLIND,
        "blind = motions[:, values < least]",
        "Eigenvalues are mean squares. The threshold is that of the root: square it.",
    ),
    relative_threshold=(
        _BLIND,
        "blind = motions[:, values < 1e-9 * values[-1]]",
        "Only what is zero to rounding counts as blind. Noise makes every eigenvalue positive; "
        "`least` says what is too little.",
    ),
    relative_to_the_largest=(
        _BLIND,
        "blind = motions[:, values < least**2 * values[-1]]",
        "The threshold is relative to the largest eigenvalue, which grows with the distance from "
        "the origin. `least` is a gap that could be measured: compare with its square alone.",
    ),
    axis_by_axis=(
        _BLIND,
        "blind = np.eye(6)[:, np.diag(rows.T @ rows / len(rows)) < least**2]",
        "Each of the six axes is asked by itself. What is blind is mostly a mixture: a ball off "
        "the origin turns and shifts.",
    ),
    the_seen_ones=(
        _BLIND,
        "blind = motions[:, values >= least**2]",
        "This is the space of the motions that are seen.",
    ),
    cross_product_sign=(
        "np.cross(x, n) / lever",
        "np.cross(n, x) / lever",
        "The cross product has the wrong sign: n . (w x x) is (x x n) . w.",
    ),
    about_the_mean=(
        _ROWS,
        _ROWS.replace("np.cross(x,", "np.cross(x - x.mean(axis=0),"),
        "The turns are about the mean of the points. They are asked for about the origin.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "eigenvectors across a wide gap: rounding", explain=explain),
    examples=(
        "blind_directions([[0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 0]], "
        "[[0, 0, 0, 0], [0, 0, 0, 0], [1, 1, 1, 1]], 1.0, 0.01)",
        "blind_directions(np.eye(3), np.eye(3), 1.0, 0.01)[0]",
        "blind_directions(np.hstack((np.eye(3), -np.eye(3))), np.eye(3)[:, [1, 2, 0, 1, 2, 0]], "
        "1.0, 0.01)[0]",
    ),
    slips=SLIPS
    + coarse_slips("blind_directions", "A projector applied twice is then another one.")
    + value_slips("blind_directions"),
)
