"""Latency over a graph: one chain, then branches, clocks, side tracks and dead ends."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return chains, then graphs in a hidden order.

    Some stages are on no chain of the sensor.
    """

    def graph(
        label: str,
        level: str = "core",
        *,
        n: int = 6,
        share: float = 0.2,
        clocks: float = 0.5,
        k: int = 4,
        allowed: float = 0.5,
        aside: int = 1,
    ) -> Case:
        on = n - aside  # behind the actuator, and beside the sensor, other stages
        pairs = {(i - 1, i) for i in range(1, n)}
        if share > 0.0:  # each stage has an input and an output, and a share has more
            pairs = {(int(rng.integers(max(0, i - 3), i)), i) for i in range(1, n)}
            pairs |= {(i, int(rng.integers(i + 1, min(i + 4, on)))) for i in range(on - 1)}
            pairs |= {(i, j) for j in range(n) for i in range(j - 1) if rng.random() < share}
        names = rng.permutation(n)
        order = rng.permutation(len(pairs))
        edges = np.array([(names[i], names[j]) for i, j in sorted(pairs)])[order]
        runs = rng.uniform(0.002, 0.03, (n, 1)) * rng.uniform(0.5, 2.0, (n, k))
        periods = rng.choice([0.01, 0.02, 0.033, 0.05], n) * (rng.random(n) < clocks)
        sensor, actuator = int(names[0]), int(names[on - 1])
        return Case((edges, runs, periods, sensor, actuator, allowed), label, level)

    def beside(label: str) -> Case:
        """Return a second source that the sensor doesn't reach, and a branch that ends nowhere."""
        edges = np.array([[3, 1], [0, 1], [1, 2], [0, 4], [4, 5]])
        runs, periods = rng.uniform(0.01, 0.1, (6, 3)), rng.uniform(0.0, 0.05, 6)
        runs[[3, 5]] += 0.5
        return Case((edges, runs, periods, 0, 2, 0.4), label, "core")

    whole = (
        np.array([[0, 1], [1, 2], [0, 2]]),
        np.array([[1, 2], [3, 1], [1, 1]]),
        np.array([4, 0, 2]),
        0,
        2,
        9.75,
    )
    return [
        graph("a chain, one run each", "simple", n=3, share=0.0, clocks=0.0, k=1, aside=0),
        graph("a chain", "simple", n=4, share=0.0, clocks=0.0, aside=0),
        graph("a chain with clocks", "simple", n=4, share=0.0, clocks=1.0, aside=0),
        *(graph("branches", n=n, aside=0) for n in (4, 5, 6)),
        *(graph("branches and a dead end", n=n) for n in (6, 7, 8)),
        *(graph("every pair", n=n, share=1.0) for n in (6, 7)),
        beside("beside the chain"),
        beside("beside the chain, another time"),
        graph("too much already", allowed=0.01),
        graph("all clocked", n=9, clocks=1.0),
        graph("two stages", "edge", n=2, aside=0),
        graph("no clock", "edge", clocks=0.0),
        Case(whole, WHOLE, "edge"),
    ]


_RUNS, _PERIODS = "np.asarray(runs, dtype=float).max(axis=1)", "np.asarray(periods, dtype=float)"
_AHEAD = "ahead[b] = max(ahead[b], ahead[a] + cost[b])"
_BEHIND = "behind[a] = max(behind[a], behind[b] + cost[a])"
_THROUGH, _WORST = "through = ahead + behind - cost", "worst = through[sensor]"
_ON = "np.where(np.isfinite(through), through, 0.0)"
_FULL = "np.full((2, len(cost)), -np.inf)"

SLIPS = slips(
    mean_for_worst=(
        _RUNS,
        _RUNS.replace("max", "mean"),
        "The mean of the runs is taken. A budget is for the worst of them: the mean is missed in "
        "every other run.",
    ),
    half_a_period=(
        _PERIODS,
        f"0.5 * {_PERIODS}",
        "A clock costs half a period: that is the mean wait. At worst the input arrives just after "
        "a tick, and waits for a whole one.",
    ),
    waits_forgotten=(
        f" + {_PERIODS}",
        "",
        "The waits for the clocks are missing: an input lies there until the next tick.",
    ),
    sensor_does_not_wait=(
        "    links = ",
        "    cost[sensor] -= np.asarray(periods, dtype=float)[sensor]\n    links = ",
        "The event waits for every clock except that of the sensor. The sensor may also have "
        "looked just before the event.",
    ),
    first_run_only=(
        _RUNS,
        "np.asarray(runs, dtype=float)[:, 0]",
        "Only the first run of each stage is used. The cost of a stage is its longest run.",
    ),
    period_holds_the_run=(
        f"{_RUNS} + {_PERIODS}",
        f"np.maximum({_RUNS}, {_PERIODS})",
        "The run is taken as a part of the period. First the input waits for a tick, then the "
        "stage runs: both.",
    ),
    sum_of_all=(
        _WORST,
        "worst = cost.sum()",
        "The cost of all stages is added up. Branches run side by side, and some lead nowhere.",
    ),
    shortest_chain=(
        _FULL,
        "np.full((2, len(cost)), np.inf)",
        _AHEAD,
        _AHEAD.replace("max(", "min("),
        _BEHIND,
        _BEHIND.replace("max(", "min("),
        "That is the shortest chain: what comes first. The worst one is the longest.",
    ),
    wherever_it_ends=(
        _WORST,
        "worst = ahead.max()",
        "The longest chain from the sensor is taken, wherever it ends. Only those that lead to the "
        "actuator count.",
    ),
    wherever_it_begins=(
        _WORST,
        "worst = behind.max()",
        "The longest chain to the actuator is taken, wherever it begins: the sensor is one end.",
    ),
    sensor_for_nothing=(
        _WORST,
        "worst = through[sensor] - cost[sensor]",
        "The sensor costs nothing here. It takes its time, and an event may come just after it has "
        "looked.",
    ),
    actuator_for_nothing=(
        _WORST,
        "worst = through[sensor] - cost[actuator]",
        "The actuator's own time is missing: the chain ends when its work does.",
    ),
    edges_once_in_their_order=(
        "range(len(cost))",
        "range(1)",
        "The edges are gone through once, in the order of the list, which is no order. Sort the "
        "stages first, or repeat until nothing changes.",
    ),
    counted_twice=(
        _THROUGH,
        "through = ahead + behind\n    through[sensor] -= cost[sensor]",
        "Of the two halves of a chain through a stage each holds the stage: its cost is counted "
        "twice.",
    ),
    same_for_all=(
        _ON,
        "through[sensor] * np.isfinite(through)",
        "The same is left for each stage. One that is not on the longest chain may cost more: the "
        "longest chain through that very stage counts.",
    ),
    own_cost_only=(
        _ON,
        "cost * np.isfinite(through)",
        "What is left for a stage is compared with its own cost alone; the rest of the chain needs "
        "its time, too.",
    ),
    never_negative=(
        f"allowed - {_ON}",
        f"np.maximum(allowed - {_ON}, 0.0)",
        "Where the budget is overdrawn 0 is returned: say by how much.",
    ),
    on_no_chain_like_the_rest=(
        _ON,
        "np.maximum(np.where(np.isfinite(ahead), ahead, 0.0), np.maximum(through, 0.0))",
        "A stage that doesn't lead to the actuator is charged for its way from the sensor. It is "
        "on no chain, and may take what is allowed.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "sums of a few numbers: rounding", explain=coarse),
    examples=(
        "latency_budget([[0, 1], [1, 2]], [[0.01, 0.02], [0.03, 0.01], [0.004, 0.004]], "
        "[0.1, 0, 0.05], 0, 2, 0.25)",
        "latency_budget([[0, 1], [1, 3], [0, 2], [2, 3]], [[0.01], [0.04], [0.02], [0.01]], "
        "[0, 0, 0.05, 0], 0, 3, 0.1)",
    ),
    slips=SLIPS
    + coarse_slips("latency_budget", "A budget is closed by its last digits.")
    + value_slips("latency_budget"),
)
