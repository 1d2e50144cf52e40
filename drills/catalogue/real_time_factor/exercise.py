"""How many times faster than real time: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 4, copies: int = 4096) -> Case:
        args = (
            rng.uniform(5e-4, 2e-2, n),
            rng.integers(100, 100000, n),
            rng.integers(1, copies + 1, n),
            rng.uniform(0.5, 600.0, n),
        )
        return Case(args, label, level)

    return [
        draw("one run, one robot", "simple", n=1, copies=1),
        draw("two runs, one robot", "simple", n=2, copies=1),
        *(draw("several runs") for _ in range(6)),
        draw("one run", "edge", n=1),
        draw("many runs", "edge", n=40),
        Case(
            (np.array([1, 2]), np.array([5, 3]), np.array([1, 3]), np.array([7, 4])), WHOLE, "edge"
        ),
    ]


SLIPS = slips(
    copies_forgotten=(
        " * np.asarray(copies)\n",
        "\n",
        "The parallel robots are missing. Each of them makes all the steps.",
    ),
    mean_of_factors=(
        "float(simulated.sum() / taken.sum())",
        "float(np.mean(simulated / taken))",
        "The total is the mean of the factors. A short run then counts as much as a long one: "
        "divide the sum of simulated times by the sum of times on the clock.",
    ),
    upside_down=(
        "simulated / taken, float(simulated.sum() / taken.sum())",
        "taken / simulated, float(taken.sum() / simulated.sum())",
        "That is time on the clock for a simulated second. The factor is its inverse: above 1 is"
        " faster than real time.",
    ),
    steps_per_second=(
        "np.asarray(step, dtype=float) * np.asarray(steps)",
        "1.0 * np.asarray(steps)",
        "Those are steps per second. A step of a tenth of the length needs ten times as many of "
        "them: multiply by the step.",
    ),
    sum_of_factors=(
        "float(simulated.sum() / taken.sum())",
        "float(np.sum(simulated / taken))",
        "The total adds the factors, as if the runs went on side by side. They follow one another.",
    ),
    runs_side_by_side=(
        "taken.sum()",
        "taken.max()",
        "The total divides by the longest run, as if all ran at the same time. They follow one "
        "another.",
    ),
    divided_by_the_copies=(
        " * np.asarray(copies)\n",
        " / np.asarray(copies)\n",
        "You divide by the number of robots. All of them make all the steps, so simulated time is "
        "multiplied by it.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: [1e-12 * float(truth[0].max()), 1e-12 * float(truth[1])],
        "products and a quotient",
        explain=coarse,
    ),
    examples=(
        "real_time_factor([0.002], [5000], [1], [2.5])",
        "real_time_factor([0.01, 0.01], [1000, 1000], [1, 64], [1.0, 4.0])",
    ),
    slips=SLIPS
    + coarse_slips("real_time_factor", "Two simulators may differ by less.")
    + value_slips("real_time_factor"),
)
