"""Intervals of success rates: in the middle, at the ends, at other confidences and few trials."""

from __future__ import annotations

import numpy as np

from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return counts from a handful to thousands; rates in the middle and at both ends."""

    def counts(
        label: str,
        level: str = "core",
        *,
        n: int = 6,
        at_most: int = 400,
        confidence: float = 0.0,
        share: float = -1.0,
        half: float = 0.0,
        ends: bool = False,
    ) -> Case:
        tried = rng.integers(max(at_most // 4, 1), at_most + 1, n)
        solved = np.array([rng.integers(0, one + 1) for one in tried])
        if ends:
            solved[::2], solved[1::2] = tried[::2], 0
        return Case(
            (
                solved,
                tried,
                confidence or float(rng.uniform(0.7, 0.99)),
                float(rng.uniform(0.1, 0.9)) if share < 0.0 else share,
                half or float(rng.uniform(0.02, 0.1)),
            ),
            label,
            level,
        )

    return [
        counts("one count", "simple", n=1, confidence=0.95),
        counts("95 %, rates in the middle", "simple", confidence=0.95, share=0.5),
        counts("few trials", "simple", at_most=12, confidence=0.95),
        *(counts("any confidence") for _ in range(3)),
        *(counts("few", at_most=9) for _ in range(2)),
        counts("all or none", ends=True, share=0.9),
        counts("a rare failure", share=0.99),
        counts("few trials are enough", half=0.3),
        counts("many trials", half=0.004),
        counts("never fails", "edge", share=1.0, ends=True),
        counts("never works", "edge", share=0.0),
        counts("one trial each", "edge", at_most=1),
        counts("one is enough", "edge", confidence=0.5, half=0.45),
        counts("any interval is narrow enough", "edge", half=0.6),
    ]


_QUANTILE = "0.5 + confidence / 2.0"
_MIDDLE = "middle = (p + square / (2.0 * n)) / (1.0 + square / n)"
_WIDTH = (
    "width = np.sqrt(square * (p * (1.0 - p) / n + square / (4.0 * n**2))) / (1.0 + square / n)"
)
_WALD = "width = np.sqrt(square * p * (1.0 - p) / n)"
_ROOT = "root = np.sqrt(square * (spread / trials + square / (4.0 * trials**2)))"
_FIT = "return bool(root > half * (1.0 + square / trials))"
_SPREAD, _ENDS = "spread = share * (1.0 - share)", "middle - width, middle + width"

SLIPS = slips(
    usual_interval=(
        _MIDDLE,
        "middle = p",
        _WIDTH,
        _WALD,
        "That is the usual interval, p +- z sqrt(p (1 - p) / n): no width where all trials "
        "worked, and too short with few. Wilson's takes the spread of the true rate.",
    ),
    usual_interval_throughout=(
        _MIDDLE,
        "middle = p",
        _WIDTH,
        _WALD,
        _ROOT,
        "root = np.sqrt(square * spread / trials)",
        _FIT,
        "return bool(root > half)",
        "Both the intervals and the number of trials come from the usual formula, "
        "p +- z sqrt(p (1 - p) / n). Wilson's interval uses the spread of the true rate.",
    ),
    not_divided=(
        _MIDDLE,
        "middle = p + square / (2.0 * n)",
        _WIDTH,
        _WIDTH.replace(" / (1.0 + square / n)", ""),
        _FIT,
        "return bool(root > half)",
        "The division of middle and half width by 1 + z^2 / n is missing.",
    ),
    cut_at_0_and_1=(
        _MIDDLE,
        "middle = p",
        _WIDTH,
        _WALD,
        _ENDS,
        "np.maximum(p - width, 0.0), np.minimum(p + width, 1.0)",
        "The usual interval, cut at 0 and 1: where all trials worked it still has no width.",
    ),
    not_moved_to_the_middle=(
        _MIDDLE,
        "middle = p",
        "The width is Wilson's, and the middle is the rate that was seen. It lies nearer to one "
        "half: (p + z^2 / 2 n) / (1 + z^2 / n).",
    ),
    two_and_two_added=(
        _WIDTH,
        "width = np.sqrt(square * middle * (1.0 - middle) / (n + square))",
        "That is Agresti and Coull's: z^2 / 2 successes and as many failures added, and the usual "
        "width. It has Wilson's middle and is wider.",
    ),
    one_sided=(
        _QUANTILE,
        "confidence",
        "The quantile is that of one side: the rest of the confidence lies on both.",
    ),
    always_95=(_QUANTILE, "0.975", "The confidence is taken for 95 %, whatever it is."),
    quantile_not_squared=("** 2\n    n = ", "\n    n = ", "z stands where z^2 has to."),
    trials_of_the_usual_interval=(
        _ROOT,
        "root = np.sqrt(square * spread / trials)",
        _FIT,
        "return bool(root > half)",
        "The intervals are Wilson's, the trials are those of the usual one, z^2 p (1 - p) / "
        "half^2: none at all for a policy that never fails.",
    ),
    whole_width=(
        _FIT,
        "return bool(2.0 * root > half * (1.0 + square / trials))",
        "The whole width is held to `half`: that takes some four times as many trials.",
    ),
    worst_rate=(
        _SPREAD,
        "spread = 0.25",
        "The trials are those for a rate of one half, the worst. The rate expected is `share`.",
    ),
    one_too_few=(
        "middle + width, high",
        "middle + width, low",
        "The number of trials is one too small: with it the interval is still too wide.",
    ),
    no_trial_at_all=(
        "middle + width, high",
        "middle + width, high * int(half < 0.5)",
        "No trials are planned where `half` is large. Without a trial there is no rate and no "
        "interval: the smallest number is 1.",
    ),
    power_of_two=(
        "while high - low > 1:",
        "while False:",
        "The number is enough, and not the least: it was doubled until it was.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "a root and a quotient: rounding", explain=coarse),
    examples=(
        "success_interval([9, 10], [10, 10], 0.95, 0.9, 0.05)",
        "success_interval([90, 100], [100, 100], 0.95, 1.0, 0.05)",
    ),
    slips=SLIPS
    + coarse_slips("success_interval", "Two policies may differ by less.")
    + value_slips("success_interval", swapped=True, whole=False),
)
