"""A table of engines: all known and larger better, then errors, gaps, and needs nobody meets."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return six engines by rising cost.

    Two fail, of one something is not known, the last three do.
    """

    def job(
        label: str,
        level: str = "core",
        *,
        smaller: int = 2,
        gap: bool = False,
        near: float = 0.5,
        met: bool = True,
        free: bool = False,
        expensive: bool = False,
    ) -> Case:
        n = 4
        larger = np.ones(n, dtype=int)
        larger[rng.permutation(n)[:smaller]] = 0
        margins = 10.0 ** rng.uniform(0.45, 0.6, (6, n))  # all by a factor of three or more
        margins[3, rng.integers(n)] = 10.0 ** rng.uniform(0.18, 0.22)  # that of the pick
        margins[4] *= 30.0
        margins[5, rng.integers(n)] = 10.0 ** rng.uniform(0.3, 0.35)
        cost = 10.0 ** (np.arange(6) + rng.uniform(-0.4, 0.4, 6))
        two, one = rng.permutation(n)[:2], rng.integers(n)
        margins[0] *= 1e4  # all points
        margins[0, two] = 10.0 ** rng.uniform(-0.03, -0.01, 2)  # fails two by little
        margins[1, one] = 10.0 ** (-near * rng.uniform(0.9, 1.1))  # and one by more or less
        if expensive:  # the one that costs most fails a single need, and by the least of all
            margins[5, rng.integers(n)] = 10.0 ** rng.uniform(-0.03, -0.01)
        limits = 10.0 ** rng.uniform(-4.0, 4.0, n)
        if not met:
            margins[2:, rng.integers(n)] = 10.0 ** rng.uniform(-1.0, -0.7, 4)
        facts = limits * np.where(larger != 0, margins, 1.0 / margins)
        if gap:
            facts[2, rng.integers(n)] = np.nan
        if free:  # the last one's cost is not known, and all is well with it
            facts[5] = facts[4]
        cost = np.where((np.arange(6) == 5) & free, np.nan, cost)
        rows = rng.permutation(6) if level != "simple" else np.arange(2, 6)
        if level == "core" and not gap:
            rows = rows[rows != 2]
        return Case((facts[rows], limits, larger, cost[rows]), label, level)

    at_limit = np.array([[2.0, 0.25], [8.0, 0.1]]), np.array([2.0, 0.25]), np.array([1, 0])
    two_of_all = np.array([[1.0, 1.0], [1.5, 1.0]]), np.array([2.0, 2.0]), np.array([1, 1])
    whole = np.array([[3, 9], [7, 5], [8, 20]]), np.array([2, 10]), np.array([1, 0])
    return [
        job("larger is better", "simple", smaller=0),
        job("all meet their needs", "simple"),
        job("smaller is better", smaller=4),
        *(job("both kinds") for _ in range(2)),
        *(job("a cheaper one is nearly in", near=0.08) for _ in range(2)),
        job("an expensive one is nearly in", expensive=True),
        *(job("not all is known", gap=True, near=near) for near in (0.08, 0.5, 0.5)),
        job("a cost is not known", free=True),
        job("none will do", met=False),
        job("none is known to do", met=False, gap=True),
        Case((*at_limit, np.array([1.0, 2.0])), "at its limit", "edge"),
        Case((*two_of_all, np.array([1.0, 2.0])), "no single limit is enough", "edge"),
        Case((np.full((1, 1), np.nan), *np.ones((3, 1))), "nothing is known", "edge"),
        Case((*whole, np.array([1, 3, 2])), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return numbers exactly, the factor to 1e-9 of itself."""
    return [0.0, 0.0, 1e-9 * max(1.0, float(truth[2]))]


def margins(figure: Any, shown: Shown) -> None:
    """Plot every engine's margin in every need, and what was picked."""
    facts, limits, larger, cost = (np.asarray(one, dtype=float) for one in shown.args)
    axes = picture.plane(figure, "cost", "margin of each need")
    ratio = np.where(larger != 0, facts / limits, limits / facts)
    axes.loglog(cost, ratio, "o", color="0.7")
    axes.axhline(1.0, color="0.6", lw=0.8)
    for (pick, *_), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        row = int(np.clip(float(pick), -1, len(cost) - 1))
        axes.axvline(cost[row] if row >= 0 else np.nanmin(cost) / 3.0, **style)
    axes.set_title(
        "need {:g}, factor {:.4g}; right is {:g}, {:.4g}".format(
            *(float(v) for v in (*shown.got[1:], *shown.expected[1:]))
        )
    )
    axes.legend()


_MARGINS = "np.where(np.asarray(larger) != 0, table / limit, limit / table)"
_UNKNOWN = "margins = np.where(np.isnan(margins), 0.0, margins)"
_PICK = "np.argmin(np.where(able, price, np.inf))"
_WAYS = "[] if pick < 0 else [(float(one), need) for need, one in enumerate(margins[pick])]"
_IN = "if len(failed) == 1 and margins[i, failed[0]] > 0.0:"

SLIPS = slips(
    unknown_passes=(
        _UNKNOWN,
        "margins = np.where(np.isnan(margins), np.inf, margins)",
        "A fact that nobody measured counts as met: the engine of which least is known does best. "
        "Unknown is not a pass.",
    ),
    unknown_as_enough=(
        _UNKNOWN,
        "margins = np.where(np.isnan(margins), 1.0, margins)",
        "A fact that nobody measured counts as exactly enough, so its engine is let in.",
    ),
    unknown_cost_is_low=(
        "np.where(np.isnan(price), np.inf, price)",
        "np.where(np.isnan(price), 1e-9, price)",
        "A cost that nobody measured counts as none at all.",
    ),
    smaller_is_better_mixed_up=(
        _MARGINS,
        "table / limit",
        "Larger counts as better everywhere: an engine with a large error gets in. Where smaller "
        "is better the margin is limit / fact.",
    ),
    kinds_swapped=(
        _MARGINS,
        "np.where(np.asarray(larger) != 0, limit / table, table / limit)",
        "The two kinds are swapped: 1 in `larger` says that a larger fact is better.",
    ),
    sum_of_ratings=(
        _PICK,
        "np.argmax(margins.sum(axis=1))",
        "The most points win: speed pays for a need that is not met, and for the cost.",
    ),
    points_among_the_able=(
        _PICK,
        "np.argmax(np.where(able, margins.sum(axis=1), -1.0))",
        "Of the engines that meet all needs the one with the most points is picked. What is beyond "
        "a need is not needed: the cheapest will do.",
    ),
    cheapest_although_not_met=(
        "able = met.all(axis=1) & np.isfinite(price)",
        "able = np.isfinite(price)",
        "The cheapest is picked whether it meets the needs or not.",
    ),
    most_needs_met=(
        "able = met.all(axis=1) & np.isfinite(price)",
        "able = (met.sum(axis=1) >= met.sum(axis=1).max()) & np.isfinite(price)",
        "Where none meets all needs the one that meets most of them is picked. The best of none is "
        "none.",
    ),
    limit_itself_refused=(
        "met = margins >= 1.0",
        "met = margins > 1.0",
        "A need that is met exactly is refused.",
    ),
    dearest=(_PICK, "np.argmax(np.where(able, price, -1.0))", "The dearest engine is picked."),
    only_tighter=(
        _IN,
        "if False:",
        "Only tighter limits are tried. A looser one can let in an engine that is cheaper.",
    ),
    only_looser=(_WAYS, "[]", "Only looser limits are tried. A tighter one throws the pick out."),
    two_limits_at_once=(
        _IN,
        "if margins[i, failed].min(initial=1.0) > 0.0 and len(failed):",
        "An engine that fails two needs is let in by changing one of them.",
    ),
    expensive_let_in=(
        "price < (price[pick] if pick >= 0 else np.inf)",
        "price < np.inf",
        "A limit is loosened for an engine that costs more than the pick. That does not change the "
        "pick: the cheapest engine that meets all needs is still the same one.",
    ),
    factor_inverted=(
        "changes.append((1.0 / float(margins[i, failed[0]]),",
        "changes.append((float(margins[i, failed[0]]),",
        "Where a looser limit does it the factor is below 1: it is the ratio of the larger limit "
        "to the smaller one, in either direction.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "quotients: rounding", explain=coarse),
    examples=(
        "pick_engine([[4e5, 1e-3], [9e6, 3e-2], [5e5, float('nan')]], [1e5, 5e-3], [1, 0], "
        "[2.0, 1.0, 1.5])",
        "pick_engine([[5e4, 1e-3], [9e6, 2e-2]], [1e5, 5e-3], [1, 0], [2.0, 1.0])",
    ),
    picture=margins,
    slips=SLIPS
    + coarse_slips("pick_engine", "Two limits can be close.")
    + value_slips("pick_engine"),
)
