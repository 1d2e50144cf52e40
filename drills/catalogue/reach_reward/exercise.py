"""Rewards of a run: before the disc, at the disc, then logs that stay inside, leave and return."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return paths with given distances, in units of the radius."""

    def run(label: str, distances: Any, level: str = "core") -> Case:
        goal, radius = rng.uniform(-1.0, 1.0, 2), float(rng.uniform(0.05, 0.3))
        angle = rng.uniform(0.0, 6.0) + np.cumsum(rng.uniform(0.0, 0.5, len(distances)))
        away = radius * np.asarray(distances) * rng.uniform(0.9, 1.1, len(distances))
        path = goal[:, None] + away * np.array([np.cos(angle), np.sin(angle)])
        return Case((path, goal, radius, float(rng.uniform(0.8, 0.99))), label, level)

    whole = np.array([[4, 3, 1, 0, 0], [0, 0, 1, 1, 0]]), np.array([0, 0]), 1, 0.5
    return [
        run("one step on the way", [5, 4], "simple"),
        run("one step to it", [2, 0.4], "simple"),
        run("a time limit", [6, 5, 4, 5, 3], "simple"),
        *(run("reached at the end", [7, 5, 3, 0.6]) for _ in range(2)),
        *(run("stays inside", [4, 2, 0.7, 0.3, 0.1, 0.2]) for _ in range(2)),
        *(run("flies through", [5, 2, 0.5, 2, 4]) for _ in range(2)),
        run("comes back", [3, 0.8, 2, 3, 0.5, 2]),
        run("a time limit near the disc", [4, 2, 1.3]),
        run("begins inside and leaves", [0.5, 2, 3], "edge"),
        run("begins inside and stays", [0.5, 0.4, 0.3], "edge"),
        run("stands still", [3, 3, 3], "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def rewards(figure: Any, shown: Shown) -> None:
    """Plot rewards over the steps."""
    axes = picture.plane(figure, "step", "reward")
    for (part, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(part, marker="o", ms=4, **style)
    axes.legend()


_PHI, _AHEAD = "phi = -np.hypot(away[0], away[1])", "np.where(inside, 0.0, phi[1:])"
_SUM, _BEHIND = "inside + gamma * ahead - phi[:-1]", "reward[steps:] = 0.0"

SLIPS = slips(
    paid_every_step=(
        _BEHIND,
        "reward[steps:] = inside[steps:]",
        "The bonus is paid for every step inside, so hovering there pays better than arriving. It "
        "is paid once, and it ends the episode.",
    ),
    goes_on=(
        _BEHIND,
        "pass",
        "Rewards continue after the end. The episode is over with the first step into the disc.",
    ),
    sign_turned=(
        _SUM,
        "inside - gamma * ahead + phi[:-1]",
        "The sign is wrong, so moving away is rewarded. The potential is minus the distance.",
    ),
    potential_at_the_end=(
        _AHEAD,
        "phi[1:]",
        "The potential of the position inside the disc is used. The episode ended there, so the "
        "potential counts as 0; otherwise the reward depends on where the point enters.",
    ),
    time_limit_taken_for_an_end=(
        _AHEAD,
        "np.where(np.arange(steps_of) == steps - 1, 0.0, phi[1:])",
        "steps = int",
        "steps_of = inside.size\n    steps = int",
        "A time limit is treated as an end. Where a log only stops, the potential keeps its value.",
    ),
    minus_distance=(
        _SUM,
        "inside + phi[1:]",
        "Minus the distance itself is used as the reward. It can change which policy is best; the "
        "difference of a potential cannot.",
    ),
    gamma_forgotten=(
        _SUM,
        "inside + ahead - phi[:-1]",
        "The potential after the step is not discounted, so the shaping rewards do not telescope.",
    ),
    bonus_forgotten=(
        _SUM,
        "gamma * ahead - phi[:-1]",
        "The bonus for reaching the disc is missing.",
    ),
    start_counts=(
        "inside = -phi[1:] <= radius\n",
        "inside = -phi[1:] <= radius\n    inside[0] |= -phi[0] <= radius\n",
        "A start inside the disc ends the episode in your answer. Only the end of a step counts.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "a root and two products", explain=coarse),
    examples=("reach_reward([[2.0, 1.0, 0.2], [0.0, 0.0, 0.0]], [0.0, 0.0], 0.5, 0.9)",),
    picture=rewards,
    slips=SLIPS
    + coarse_slips("reach_reward", "Near the disc the differences are small.")
    + value_slips("reach_reward"),
)
