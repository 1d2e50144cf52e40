"""Diagnosis of failed runs: one cause at a time, then records and replays of all kinds."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return five contracts over forty ticks, four stages; a disturbance passes from row to row."""

    def run(
        label: str,
        level: str = "core",
        *,
        first: int = 1,
        cure: int = 1,
        m: int = 5,
        at_once: bool = False,
        feedback: bool = False,
    ) -> Case:
        n, k = 40, 4
        limits = rng.uniform(1.0, 3.0, m)
        # Row 0 is quiet but for one value that is unusual and allowed.
        record = limits[:, None] * rng.uniform(0.1, 0.9, (m, n))
        record[0] *= 0.1
        record[0, 2] = 0.8 * limits[0]
        record[-1, 1] = limits[-1]  # as much as is allowed
        if first >= 0:
            tick = int(rng.integers(5, 12))
            for late, row in enumerate(range(first, m)):  # larger and larger on its way
                record[row, tick + late * (3 * (not at_once)) :] *= 2.0 + late
                record[row, tick + late * (3 * (not at_once))] = (1.5 + late) * limits[row]
            if feedback:  # the loop is closed: what is upstream sees it later
                record[:first, 35:] = 6.0 * limits[:first, None]
        errors = rng.uniform(0.03, 0.08, 1 << k)
        sets = [sum(1 << i for i in g) for size in (1, 2) for g in combinations(range(k), size)]
        singles, pairs = sets[:k], sets[k:]
        if cure == 1:
            errors[rng.permutation(singles)[:2]] = rng.uniform(0.002, 0.018, 2)
            errors[pairs] = rng.uniform(0.0, 0.001, len(pairs))
        elif cure == 2:  # the best single repair is in a pair that cures, not in the best one
            best = int(errors[singles].argmin())
            for has, least in ((1, 0.012), (0, 0.002)):
                among = [s for s in pairs if s >> best & 1 == has]
                errors[rng.choice(among)] = least + rng.uniform(0.0, 0.006)
        errors[-1] = 1e-4
        return Case((record, limits, errors, 0.02), label, level)

    whole = (np.array([[1, 1, 5], [2, 4, 1]]), np.array([3, 3]), np.array([9, 8, 1, 0]), 2)
    return [
        run("upstream", "simple", first=0),
        run("in the middle", "simple", first=2),
        run("in the last row", "simple", first=4),
        *(run("a single repair", first=int(rng.integers(5))) for _ in range(2)),
        *(run("two repairs", first=int(rng.integers(4)), cure=2) for _ in range(4)),
        *(run("a closed loop", first=int(rng.integers(1, 3)), feedback=True) for _ in range(2)),
        run("at once", first=1, at_once=True),
        run("at once, two", at_once=True, cure=2),
        run("nothing is broken", "edge", first=-1),
        run("no cure in two", "edge", cure=3),
        run("one contract", "edge", m=1, first=0),
        Case(whole, WHOLE, "edge"),
    ]


def repairs(figure: Any, shown: Shown) -> None:
    """Plot the stages to mend; the contracts stand above."""
    axes = picture.plane(figure, "stage", "to mend")
    for (_, stages), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(stages, dtype=float), "o", **style | {"ls": "-"})
    axes.set_title(f"contract {float(shown.got[0]):g}, right is {float(shown.expected[0]):g}")
    axes.legend()


_BROKEN = "broken = np.asarray(record) > np.asarray(limits)[:, None]"
_CONTRACT = "contract = int(np.argmin(ticks)) if broken.any() else -1"
_SIZES = "for size in (1, 2):"
_BEST = "best = min(tried, key=lambda group: left[sum(1 << i for i in group)])"

SLIPS = slips(
    last_stage_blamed=(
        _CONTRACT,
        "contract = int(np.flatnonzero(broken.any(axis=1))[-1]) if broken.any() else -1",
        "The last broken row is blamed. Each stage passes on what it receives: a failure shows"
        " at the end, and its cause lies earlier.",
    ),
    first_anomaly=(
        _BROKEN,
        "r = np.asarray(record)\n    broken = r > (r.mean(axis=1) + 2.0 * r.std(axis=1))[:, None]",
        "That is the first value that is unusual for its row. Unusual is not broken: a "
        "contract says what is allowed.",
    ),
    largest_breach=(
        _CONTRACT,
        "contract = int(np.argmax((np.asarray(record) / "
        "np.asarray(limits)[:, None]).max(axis=1))) if broken.any() else -1",
        "The largest breach is blamed. A disturbance can grow from stage to stage.",
    ),
    upstream_whenever=(
        _CONTRACT,
        "contract = int(np.argmax(broken.any(axis=1))) if broken.any() else -1",
        "The row closest to the camera that ever breaks is blamed. The loop is closed, so "
        "early stages see the failure too, only later. Time comes first.",
    ),
    downstream_of_equals=(
        _CONTRACT,
        "contract = len(ticks) - 1 - int(np.argmin(ticks[::-1])) if broken.any() else -1",
        "If contracts break at the same tick, the one furthest from the camera is taken.",
    ),
    limit_itself_broken=(
        _BROKEN,
        _BROKEN.replace(">", ">="),
        "A value exactly at its limit counts as broken; it is allowed.",
    ),
    row_zero_for_none=(
        "if broken.any() else -1",
        "if broken.any() else 0",
        "If no contract is broken, the first one is blamed.",
    ),
    single_repairs_only=(
        _SIZES,
        "for size in (1,):",
        "Only single stages are tried. If two faults come together, such as an old image and a"
        " lagging arm, neither helps alone.",
    ),
    pairs_at_once=(
        _SIZES,
        "for size in (2,):",
        "Pairs are tried where a single stage is enough: the second one has nothing to do with"
        " the cause.",
    ),
    all_that_it_takes=(
        _SIZES,
        "for size in range(1, stages + 1):",
        "Sets of more than two stages are tried: making everything ideal cures anything and "
        "explains nothing. Stop after pairs.",
    ),
    best_not_cured=(
        "if left[sum(1 << i for i in best)] <= tolerance:",
        "if size == 2 or left[sum(1 << i for i in best)] <= tolerance:",
        "The best pair is returned, though the run still fails with it.",
    ),
    first_that_cures=(
        _BEST,
        "best = next((g for g in tried if left[sum(1 << i for i in g)] <= tolerance), tried[0])",
        "The first stage that is good enough is taken; the task wants the one that leaves the "
        "smallest error.",
    ),
    greedy_pair=(
        _BEST,
        "kept = [] if size == 1 else [min(range(stages), key=lambda i: "
        "left[1 << i])]\n        tried = [g for g in tried if set(kept) <= set(g)]\n        "
        + _BEST,
        "The pair is built on the best single stage. If two faults hide each other, neither "
        "looks good alone: try all pairs.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-12, "whole numbers"),
    examples=(
        "which_stage([[0.1, 0.2, 9.0], [0.1, 3.0, 3.0]], [1.0, 1.0], [0.05, 0.04, 0.01, 0], 0.02)",
        "which_stage([[0.1, 0.2], [0.1, 3.0]], [1.0, 1.0], [0.05, 0.04, 0.06, 0.001], 0.02)",
    ),
    picture=repairs,
    slips=SLIPS + value_slips("which_stage", whole=False),
)
