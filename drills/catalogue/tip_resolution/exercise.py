"""What one encoder count moves: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 6) -> Case:
        args = (2 ** rng.integers(10, 20, n), rng.uniform(1.0, 160.0, n), rng.uniform(0.05, 1.5, n))
        return Case(args, label, level)

    return [
        draw("one joint", "simple", n=1),
        Case((np.array([4096]), np.array([1.0]), np.array([1.0])), "no gear", "simple"),
        draw("two joints", "simple", n=2),
        *(draw("an arm") for _ in range(6)),
        draw("seven joints", "edge", n=7),
        Case(
            (np.array([4096, 8192]), np.array([100.0, 50.0]), np.array([0.8, 0.0])),
            "reach 0",
            "edge",
        ),
        Case((np.array([4096, 1000]), np.array([100, 50]), np.array([2, 1])), WHOLE, "edge"),
    ]


SLIPS = slips(
    gear_forgotten=(
        " * np.asarray(ratio))",
        ")",
        "The gear is missing: the encoder is on the motor, and the joint turns by a ratio-th of "
        "it.",
    ),
    gear_upside_down=(
        "(np.asarray(counts, dtype=float) * np.asarray(ratio))",
        "np.asarray(counts, dtype=float) * np.asarray(ratio)",
        "The gear makes the motion coarser in your answer. The motor turns `ratio` times for one"
        " turn of the joint: divide.",
    ),
    metres=(
        "1e3 * angle",
        "angle",
        "That is in metres. Return millimetres.",
    ),
    degrees=(
        "2.0 * np.pi /",
        "360.0 /",
        "The angle is in degrees. An arc is the radius times the angle in radians.",
    ),
    turns_for_radians=(
        "2.0 * np.pi /",
        "1.0 /",
        "The angle is in turns. A turn has 2 pi radians.",
    ),
    root_of_squares=(
        "float(each.sum())",
        "float(np.sqrt((each**2).sum()))",
        "The root of the squares is what independent errors make on average. In the worst case "
        "they add up.",
    ),
    largest_of_them=(
        "float(each.sum())",
        "float(each.max())",
        "The largest alone is not the worst case: all joints can be off at once.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases, lambda case, truth: 1e-12 * float(truth[1]), "products and a sum", explain=coarse
    ),
    examples=(
        "tip_resolution([4096], [100.0], [0.8])",
        "tip_resolution([4096, 4096], [100.0, 50.0], [0.8, 0.4])",
    ),
    slips=SLIPS
    + coarse_slips("tip_resolution", "One count is small next to a reach.")
    + value_slips("tip_resolution"),
)
