"""A loaded model: in the file's order and axes, then in the simulator's own."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def rotation(q: Array) -> Array:
    """Return the rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = q
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * w * K + 2.0 * K @ K)


def cases(rng: np.random.Generator) -> list[Case]:
    """Return arms with light fingers; each kind of fault alone, then all of them."""

    def model(
        label: str,
        level: str = "core",
        *,
        turn: float | None = None,
        shuffled: bool = True,
        faults: str = "",
        n: int = 8,
    ) -> Case:
        tolerance = 0.01
        ids, masses = rng.permutation(40)[:n] + 1, 10.0 ** rng.uniform(-3.0, 1.0, n)
        rods = masses[:, None] * rng.uniform(8e-4, 1e-3, (n, 3)) * [1.0, 3.0, 8.0]
        moments = rods.sum(axis=1)[:, None] - rods  # so that no two are greater than the third
        turns = rng.normal(size=(n, 4))
        if turn is not None:  # about one of the axes
            turns = np.cos(turn / 2.0) * np.eye(4)[np.zeros(n, dtype=int)]
            turns += np.sin(turn / 2.0) * np.eye(4)[rng.integers(1, 4, n)]
        turns /= np.linalg.norm(turns, axis=1)[:, None]
        inertias = np.array(
            [rotation(q) @ np.diag(d) @ rotation(q).T for q, d in zip(turns, moments, strict=True)]
        )
        sizes = 1.0 + tolerance * rng.uniform(-0.4, 0.4, n)  # within the tolerance, as is the turn
        loaded, held = masses * sizes, moments * sizes[::-1, None]
        axes = turns + 7e-4 * rng.uniform(-1.0, 1.0, (n, 4))
        missing: list[int] = []
        for at, kind in zip(rng.permutation(n).tolist(), faults, strict=False):
            if kind == "m":
                loaded[at] *= 1.0 + rng.choice([-3.0, 3.0]) * tolerance
            elif kind == "i":
                held[at] *= 1.0 + rng.choice([-3.0, 3.0]) * tolerance
            elif kind == "b":
                loaded[at] *= 1.5
                held[at] *= 0.5
            elif kind == "t":  # the right moments, about other axes
                axes[at] = [1.0, 0.0, 0.0, 0.0] if turn is None else [0.5, 0.5, 0.5, 0.5]
            elif kind == "o":  # little on the diagonal
                axes[at] = [1.0, 0.035, 0.0, 0.0]
            else:
                missing.append(at)
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        order = rng.permutation(n) if shuffled else np.arange(n)
        order = np.array([one for one in order if one not in missing], dtype=int)
        body = ids[order], loaded[order], held[order], axes[order]
        if shuffled:  # and the world, and something that stands in it
            body = (
                np.r_[0, body[0], 77],
                np.r_[0.0, body[1], 1.0],
                np.vstack((np.zeros(3), body[2], np.ones(3))),
                np.vstack((np.eye(4)[0], body[3], np.eye(4)[0])),
            )
        return Case((ids, masses, inertias, *body, tolerance), label, level)

    return [
        model("file's order and axes", "simple", turn=0.0, shuffled=False),
        model("masses", "simple", turn=0.0, shuffled=False, faults="mmm"),
        model("inertias", "simple", turn=0.0, shuffled=False, faults="iit"),
        model("turned axes", shuffled=False),
        model("its own order", turn=0.0, faults="mi"),
        model("half turns", turn=np.pi, faults="m"),
        model("quarter turns", turn=np.pi / 2.0),
        model("beside the diagonal", turn=0.0, faults="oo"),
        model("about other axes", faults="tt"),
        model("both faults in one link", faults="bb"),
        model("not loaded", faults="xx"),
        *(model("all kinds", faults="mitbx") for _ in range(3)),
        model("one link", "edge", n=1, faults="t"),
        model("nothing loaded", "edge", n=2, faults="xx"),
    ]


def faults(figure: Any, shown: Shown) -> None:
    """Plot the sum of each link."""
    axes = picture.plane(figure, "link of the file", "1: mass, 2: inertia, 4: not there")
    for (result,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(result, dtype=float), "o", **style | {"ls": "-"})
    axes.legend()


_LOADED = "loaded = R @ np.diag(np.asarray(moments, dtype=float)[j]) @ R.T"
_INERTIA = "np.abs(loaded - inertia[i]).max() > tolerance * np.abs(inertia[i]).max()"
_MASS, _PLACE = "> tolerance * M[i]", "j = place.get(int(one))"
_EQUAL = """np.abs(np.sort(np.asarray(moments)[j]) - np.linalg.eigvalsh(inertia[i])).max() > (
            tolerance * np.abs(inertia[i]).max())"""

SLIPS = slips(
    rotated_frames_compared=(
        _LOADED,
        "loaded = np.diag(np.asarray(moments, dtype=float)[j])",
        "The principal moments are compared with the diagonal of a matrix along other axes: a "
        "link that is right is reported. Turn them into the link's axes first.",
    ),
    moments_alone=(
        _INERTIA,
        _EQUAL,
        "Only the moments are compared. An inertia with the right moments about the wrong axes "
        "passes, such as a tool that is mounted across.",
    ),
    turned_the_other_way=(
        _LOADED,
        "loaded = R.T @ np.diag(np.asarray(moments, dtype=float)[j]) @ R",
        "The rotation goes the other way: R turns components along the principal axes into "
        "components along the link's axes, so it stands on the left.",
    ),
    turned_one_side=(
        _LOADED,
        "loaded = R @ np.diag(np.asarray(moments, dtype=float)[j])",
        "A matrix is turned from both sides, R I R^T; from one side only vectors are.",
    ),
    scalar_last=(
        "w, *v = np.asarray(turns, dtype=float)[j]",
        "*v, w = np.asarray(turns, dtype=float)[j]",
        "The quaternion is read with its scalar part last. Engines differ in this; here it comes "
        "first.",
    ),
    absolute_tolerance=(
        _INERTIA,
        "np.abs(loaded - inertia[i]).max() > tolerance",
        _MASS,
        "> tolerance",
        "The tolerance is taken in kilograms: a finger of a gram may be anything. It is a part of "
        "the file's value.",
    ),
    absolute_inertia=(
        _INERTIA,
        "np.abs(loaded - inertia[i]).max() > tolerance",
        "The inertia's tolerance is absolute: the inertia of a light link passes, whatever it is.",
    ),
    entry_by_entry=(
        _INERTIA,
        "(np.abs(loaded - inertia[i]) > tolerance * np.abs(inertia[i])).any()",
        "Each entry has its own tolerance: one beside the diagonal may be zero, and then rounding "
        "is an error. Measure by the largest entry.",
    ),
    by_row=(
        _PLACE,
        "j = i if i < len(np.asarray(loaded_ids)) else None",
        "Row i of the file is compared with body i of the simulator. It has an order and bodies of "
        "its own; match by id.",
    ),
    world_counted=(
        _PLACE,
        "j = i + 1 if i + 1 < len(np.asarray(loaded_ids)) else None",
        "The world is skipped, and the rest is taken in the file's order. Match by id.",
    ),
    missing_is_fine=("marks[i] = 4", "marks[i] = 0", "A link that was not loaded at all passes."),
    codes_mixed=(
        "marks[i] += 1",
        "marks[i] += 3",
        "marks[i] += 2",
        "marks[i] += 1",
        "marks[i] += 3",
        "marks[i] += 2",
        "Mass and inertia are mixed up: 1 is for the mass, 2 for the inertia.",
    ),
    first_fault_only=(
        "        if np.abs(loaded",
        "        elif np.abs(loaded",
        "Only the first fault of a link is told. A link can have another mass and another inertia: "
        "the sum says both.",
    ),
    diagonal_only=(
        _INERTIA,
        "np.abs(np.diag(loaded - inertia[i])).max() > tolerance * np.abs(inertia[i]).max()",
        "Only the diagonals are compared: products of inertia count, too.",
    ),
    absolute_mass=(
        _MASS,
        "> tolerance",
        "The tolerance of the mass is taken in kilograms. It is a part of the mass in the file: "
        "multiply by that.",
    ),
    inertia_reported_as_mass=(
        "marks[i] += 2",
        "marks[i] += 1",
        "A wrong inertia adds 1 in your answer, the code of a wrong mass. It adds 2.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-12, "whole numbers"),
    examples=(
        "audit_model([5], [2.0], [np.diag([2.0, 3.0, 1.0])], [0, 5], [0.0, 2.0], "
        "[[0, 0, 0], [3.0, 1.0, 2.0]], [[1, 0, 0, 0], [0.5, 0.5, 0.5, 0.5]], 0.01)",
    ),
    picture=faults,
    slips=SLIPS + value_slips("audit_model", in_part=False, whole=False),
)
