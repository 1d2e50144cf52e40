"""A range that spans factors: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, m: int = 4, n: int = 3, span: float = 2.0) -> Case:
        middle = 10.0 ** rng.uniform(-2.0, 2.0, n)
        width = 10.0 ** rng.uniform(0.3, span, n)
        return Case((middle / width, middle * width, rng.uniform(0.0, 1.0, (m, n))), label, level)

    low = rng.uniform(0.1, 1.0, 2)
    return [
        Case((np.array([0.1]), np.array([10.0]), np.array([[0.5], [0.25]])), "0.1 to 10", "simple"),
        draw("one parameter", "simple", m=2, n=1),
        *(draw("several") for _ in range(6)),
        Case((low, 4.0 * low, np.array([[0.0, 1.0], [1.0, 0.0]])), "the ends"),
        Case((low, low.copy(), rng.uniform(0.0, 1.0, (3, 2))), "a fixed parameter", "edge"),
        draw("no episode", "edge", m=0),
        draw("ranges over ten powers of ten", "edge", span=5.0),
        Case((np.array([1, 3]), np.array([7, 5]), np.array([[0.3, 0.6]])), WHOLE, "edge"),
    ]


SLIPS = slips(
    uniform_in_the_value=(
        "np.exp(start + share * (end - start))",
        "np.exp(start) + share * (np.exp(end) - np.exp(start))",
        "The draws are uniform in the value: from 0.1 to 10 nine tenths of them lie above 1. "
        "Interpolate the logarithms.",
    ),
    no_exponential=(
        "np.exp(start + share * (end - start))",
        "start + share * (end - start)",
        "That is the logarithm of the parameter. Take the exponential.",
    ),
    ends_swapped=(
        "start + share * (end - start)",
        "end + share * (start - end)",
        "0 becomes the upper end in your answer. It has to become the lower one.",
    ),
    base_mixed=(
        "np.exp(start + share * (end - start))",
        "10.0 ** (start + share * (end - start))",
        "Natural logarithm and power of ten are mixed. Use one base for both.",
    ),
    logarithm_of_base_ten=(
        "np.log(np.asarray(low, dtype=float))",
        "np.log10(np.asarray(low, dtype=float))",
        "np.log(np.asarray(high, dtype=float))",
        "np.log10(np.asarray(high, dtype=float))",
        "The logarithms have base ten and the exponential has base e. Use one base for both.",
    ),
    width_only=(
        "np.exp(start + share * (end - start))",
        "np.exp(share * (end - start))",
        "That is the factor on the lower end. Multiply by low.",
    ),
    uniform_in_the_inverse=(
        "np.exp(start + share * (end - start))",
        "1.0 / (np.exp(-start) + share * (np.exp(-end) - np.exp(-start)))",
        "The draws are uniform in the inverse, which favours small values. Interpolate the "
        "logarithms.",
    ),
    ends_taken_as_exponents=(
        "np.exp(start + share * (end - start))",
        "10.0 ** (np.exp(start) + share * (np.exp(end) - np.exp(start)))",
        "The ends are taken as exponents of ten. They are values: take their logarithms first.",
    ),
    one_number_for_all=(
        "share = np.asarray(u, dtype=float)",
        "share = np.asarray(u, dtype=float)[:, :1]",
        "All parameters of an episode get the first random number, so they rise and fall "
        "together. Each parameter has a column of its own.",
    ),
    ratio_rounded_down=(
        "np.exp(start + share * (end - start))",
        "np.asarray(low, dtype=float) * (np.asarray(high, dtype=float) // np.asarray(low))**share",
        "The ratio of the ends is rounded down to an integer: // is an integer division.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-12 * float(np.abs(truth[0]).max(initial=1e-300)),
        "a logarithm and an exponential",
        explain=coarse,
    ),
    examples=(
        "log_uniform([0.1], [10], [[0.0], [0.5], [1.0]])",
        "log_uniform([1.0, 0.5], [4.0, 0.5], [[0.5, 0.3]])",
    ),
    slips=SLIPS
    + coarse_slips("log_uniform", "A range over powers of ten has small values as well.")
    + value_slips("log_uniform", in_part=False),
)
