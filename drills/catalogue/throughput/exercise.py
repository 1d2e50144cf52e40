"""Latency and throughput of a pipeline: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 5, workers: int = 4) -> Case:
        while True:
            times, k = rng.uniform(0.002, 0.2, n), rng.integers(1, workers + 1, n)
            first, *others = np.sort(k / times)
            if not others or others[0] > 1.01 * first:
                return Case((times, k), label, level)

    return [
        draw("one stage", "simple", n=1, workers=1),
        draw("three stages, one worker each", "simple", n=3, workers=1),
        *(draw("several workers") for _ in range(6)),
        Case((np.array([0.3, 0.1, 0.05]), np.array([8, 1, 1])), "the longest has many workers"),
        draw("one stage, several workers", "edge", n=1),
        draw("many stages", "edge", n=12),
        Case((np.array([2, 7, 3]), np.array([1, 2, 1])), WHOLE, "edge"),
    ]


SLIPS = slips(
    one_after_the_other=(
        "float(rates[slowest])",
        "float(1.0 / times.sum())",
        "The rate is that of one image after the other. The stages run in parallel: the slowest "
        "sets the rate.",
    ),
    workers_ignored=(
        "np.asarray(workers) / times",
        "1.0 / times",
        "The workers do not count in your answer. A stage with k of them finishes k images in "
        "its time.",
    ),
    workers_shorten_latency=(
        "float(times.sum())",
        "float((times / np.asarray(workers)).sum())",
        "The workers shorten the latency in your answer. Each image is handled by one worker, in"
        " the same time as before.",
    ),
    slowest_stage_latency=(
        "float(times.sum())",
        "float(times.max())",
        "The latency is that of the longest stage. One image passes through all of them: add up.",
    ),
    longest_for_slowest=(
        "int(np.argmin(rates))",
        "int(np.argmax(times))",
        "You name the stage that takes longest. With enough workers it does not limit the rate: "
        "compare workers / time.",
    ),
    counted_from_one=(
        "float(rates[slowest]), slowest",
        "float(rates[slowest]), slowest + 1",
        "The stages are counted from 1. The first is number 0.",
    ),
    sum_of_rates=(
        "float(rates[slowest])",
        "float(rates.sum())",
        "The rates are added, as if each stage made images of its own. They follow one another: "
        "the smallest rate counts.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: [1e-12 * float(truth[0]), 1e-12 * float(truth[1]), 1e-9],
        "a sum and a quotient",
        explain=coarse,
    ),
    examples=(
        "throughput([0.02, 0.05, 0.01], [1, 1, 1])",
        "throughput([0.02, 0.05, 0.03], [1, 4, 1])",
    ),
    slips=SLIPS
    + coarse_slips("throughput", "A camera that is a little faster fills any queue.")
    + value_slips("throughput"),
)
