"""How busy is the processor: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 4, load: float = 0.0) -> Case:
        periods = rng.uniform(0.002, 0.2, n)
        shares = rng.uniform(0.2, 1.0, n)
        desired = load or float(rng.choice([0.4, 0.62, 0.9, 1.3]))
        shares *= desired / shares.sum()
        return Case((shares * periods, periods), label, level)

    return [
        draw("one task", "simple", n=1, load=0.5),
        draw("two tasks", "simple", n=2, load=0.6),
        draw("two tasks, undecided", n=2, load=0.95),
        draw("many tasks, undecided", n=12, load=0.75),
        draw("overload", load=1.2),
        draw("little to do", load=0.3),
        *(draw("several tasks", n=int(n)) for n in rng.integers(3, 9, 4)),
        draw("one task, nearly all the time", "edge", n=1, load=0.97),
        draw("one task, too long", "edge", n=1, load=1.1),
        draw("just overloaded", "edge", n=5, load=1.01),
        Case((np.array([1, 2]), np.array([4, 7])), WHOLE, "edge"),
    ]


SLIPS = slips(
    ratio_of_sums=(
        "float(np.sum(np.asarray(executions, dtype=float) / np.asarray(periods)))",
        "float(np.sum(np.asarray(executions, dtype=float)) / np.sum(np.asarray(periods)))",
        "Sum of times over sum of periods is no utilization: divide each time by its own period,"
        " then add up.",
    ),
    bound_of_many=(
        "n * (2.0 ** (1.0 / n) - 1.0)",
        "float(np.log(2.0))",
        "That is the bound for very many tasks, ln 2. For n tasks it is n (2^(1/n) - 1).",
    ),
    undecided_is_overloaded=(
        "(-1 if load > 1.0 else 0)",
        "-1",
        "Above the bound the tasks are not overloaded, only unproven: that is 0 up to a "
        "utilization of 1.",
    ),
    below_one_is_enough=(
        "1 if load <= bound",
        "1 if load <= 1.0",
        "A utilization below 1 is enough for earliest deadline first, not for rate-monotonic "
        "priorities: compare with the bound.",
    ),
    mean_share=(
        "float(np.sum(np.asarray(executions, dtype=float) / np.asarray(periods)))",
        "float(np.mean(np.asarray(executions, dtype=float) / np.asarray(periods)))",
        "The shares are averaged. All tasks use one processor: add them up.",
    ),
    upside_down=(
        "np.asarray(executions, dtype=float) / np.asarray(periods)",
        "np.asarray(periods, dtype=float) / np.asarray(executions)",
        "A period is divided by the execution time. The share of the processor is the inverse.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-12, "quotients and a root", explain=coarse),
    examples=(
        "utilisation([0.001, 0.002], [0.01, 0.01])",
        "utilisation([0.004, 0.006], [0.01, 0.012])",
    ),
    slips=SLIPS
    + coarse_slips("utilisation", "Close to the bound it decides.")
    + value_slips("utilisation"),
)
