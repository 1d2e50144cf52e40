"""How far it moves before it knows: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 4, m: int = 3) -> Case:
        return Case(
            (rng.uniform(0.001, 0.1, n), float(rng.uniform(0.005, 0.1)), rng.uniform(0.1, 3.0, m)),
            label,
            level,
        )

    return [
        draw("one stage", "simple", n=1, m=1),
        draw("two stages", "simple", n=2, m=1),
        *(draw("a chain") for _ in range(6)),
        draw("no stages", "edge", n=0),
        draw("many speeds", "edge", m=9),
        Case((rng.uniform(0.001, 0.1, 3), 0.02, np.array([0.0, 1.0])), "at rest", "edge"),
        Case((np.array([1, 2]), 1, np.array([3, 5])), WHOLE, "edge"),
    ]


SLIPS = slips(
    slowest_stage_only=(
        "np.sum(np.asarray(latencies, dtype=float))",
        "np.max(np.asarray(latencies, dtype=float), initial=0.0)",
        "Only the slowest stage counts in your answer. That sets the rate of a pipeline; its "
        "delay is the sum of all stages.",
    ),
    mean_latency=(
        "np.sum(np.asarray(latencies, dtype=float))",
        "np.mean(np.asarray(latencies, dtype=float)) if np.size(latencies) else 0.0",
        "The latencies are averaged. The stages follow one another, so their times add up.",
    ),
    no_waiting=(
        "v * (delay + period / 2.0), v * (delay + period)",
        "v * delay, v * delay",
        "The wait for the loop is missing: half a period on average, a whole one at worst.",
    ),
    mean_is_worst=(
        "v * (delay + period / 2.0)",
        "v * (delay + period)",
        "Your mean is the worst case. The wait is uniform between 0 and one period: half a "
        "period on average.",
    ),
    waits_one_period_more=(
        "v * (delay + period / 2.0), v * (delay + period)",
        "v * (delay + 1.5 * period), v * (delay + 2.0 * period)",
        "You wait one period too long. The next tick takes the result, at most one period after "
        "it arrives.",
    ),
    a_period_per_stage=(
        "delay = float(np.sum(np.asarray(latencies, dtype=float)))",
        "delay = float(np.sum(np.asarray(latencies, dtype=float) + period)) - period",
        "Every stage waits for a clock in your answer. Only the last one, the loop, has one.",
    ),
    speeds_cut_to_integers=(
        "v = np.asarray(speed, dtype=float)",
        "v = np.asarray(speed, dtype=int)",
        "The speeds are cut to integers: 0.8 m/s becomes 0. Use float for a quantity with a unit.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-12 * max(1.0, float(np.abs(truth[1]).max())),
        "a sum and two products",
        explain=coarse,
    ),
    examples=(
        "blind_distance([0.03, 0.02], 0.01, [1.0, 2.0])",
        "blind_distance([0.1], 0.1, [0.5])",
    ),
    slips=SLIPS
    + coarse_slips("blind_distance", "Two speeds may differ by less.")
    + value_slips("blind_distance", swapped=True),
)
