"""Time of impact of two balls: a number, with cases where the obvious formula loses its digits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]
FAR = "very far away"


def cases(rng: np.random.Generator) -> list[Case]:
    """Return flights that hit, miss, graze, and those in which digits are lost."""

    def direction(d: int) -> Array:
        v = rng.normal(size=d)
        return np.asarray(v / np.linalg.norm(v))

    def flight(
        d: int,
        label: str,
        *,
        gap: float,
        offset: float,
        reach: float = 1.0,
        speed: float = 0.0,
        level: str = "core",
        sign: float = 1.0,
    ) -> Case:
        """Return balls that approach each other from a gap along the motion.

        They pass each other at `offset` times the sum of their radii.
        """
        speed = speed or rng.uniform(0.5, 5.0)
        along = direction(d)
        across = direction(d)
        across = across - (across @ along) * along if d > 1 else np.zeros(d)
        across = offset * reach * across / max(float(np.linalg.norm(across)), 1e-300)
        reach_along = math.sqrt(max(reach**2 - float(across @ across), 0.0))
        place, velocity = rng.uniform(-1.0, 1.0, d), rng.uniform(-1.0, 1.0, d)
        other = place + across + (reach_along + gap) * along
        return Case((place, velocity, other, velocity - sign * speed * along, reach), label, level)

    x = np.array([1.0, 0.0, 0.0])
    return [
        Case((0.0 * x, x, 5.0 * x, -x, 1.0), "head on", "simple"),
        Case((0.0 * x, 2.0 * x, 3.0 * x, 0.0 * x, 0.5), "one at rest", "simple"),
        Case((0.0 * x, -x, 5.0 * x, x, 1.0), "flying apart", "simple"),
        flight(2, "in the plane", gap=2.0, offset=0.5),
        flight(3, "in space", gap=3.0, offset=0.7),
        flight(3, "in space", gap=rng.uniform(0.5, 9.0), offset=0.2),
        flight(1, "on a line", gap=1.5, offset=0.0),
        flight(5, "in five dimensions", gap=2.0, offset=0.4),
        flight(2, "passing at a distance", gap=2.0, offset=rng.uniform(1.2, 2.0)),
        flight(3, "passing at a distance", gap=5.0, offset=1.05),
        flight(2, "a graze that hits", gap=4.0, offset=0.99),
        Case((x, x, np.array([3.0, 1.0, 0.0]), x, 1.0), "side by side"),
        flight(3, "flying apart", gap=1.0, offset=0.3, sign=-1.0),
        Case((0.0 * x, -x, 0.6 * x, x, 1.0), "overlapping, flying apart", "edge"),
        Case((0.0 * x, x, 0.3 * x, 0.0 * x, 1.0), "overlapping", "edge"),
        flight(3, FAR, gap=1e6, offset=0.0, reach=0.01, speed=900.0, level="edge"),
        flight(2, "nearly touching", gap=1e-8, offset=0.0, level="edge"),
        flight(3, "a near graze", gap=50.0, offset=1.0 - 1e-5, level="edge"),
        flight(2, "slow", gap=1e-3, offset=0.3, speed=1e-6, level="edge"),
        Case(
            (np.array([0, 0]), np.array([1, 0]), np.array([6, 1]), np.array([-2, 0]), 2),
            WHOLE,
            "edge",
        ),
    ]


def allowed(case: Case, truth: tuple[Any, ...]) -> float:
    """Return 1e-9 of the time, and of that in which the relative motion covers the reach."""
    speed = float(np.linalg.norm(case.args[3] - case.args[1]))
    own = min(case.args[4] / speed, 1.0) if speed > 0.0 else 1.0
    return 1e-9 * (max(float(truth[0]), 0.0) + own)


def squares(answers: Sequence[Answer]) -> str:
    """Return whether only digits are wrong, and only where the balls are far from each other."""
    wrong = [a for a in answers if not all(a.right)]
    near = [
        a for a in wrong if largest_error(a.parts[0], a.truth[0]) > 1e-6 * abs(float(a.truth[0]))
    ]
    far = all(a.case.label == FAR for a in wrong)
    return "squares_subtracted" if wrong and far and not near else coarse(answers)


def balls(figure: Any, shown: Shown) -> None:
    """Plot the first ball as seen from the second: its way, and where it touches."""
    axes = picture.plane(figure, "along the motion [m]", "across it [m]", equal=True)
    place, velocity, other, other_velocity, reach = shown.args
    d, v = np.asarray(place, float) - other, np.asarray(velocity, float) - other_velocity
    along = v / max(float(np.linalg.norm(v)), 1e-300)
    start = np.array([d @ along, np.linalg.norm(d - (d @ along) * along)])
    around = np.linspace(0.0, 2.0 * math.pi, 100)
    axes.plot(reach * np.cos(around), reach * np.sin(around), "k", label="reach")
    speed = float(np.linalg.norm(v))
    for (time,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        end = start + [speed * max(float(time), 0.0), 0.0]
        axes.plot([start[0], end[0]], [start[1], end[1]], marker="o", **style)
    axes.legend()


RELATIVE = "np.asarray(other_velocity, dtype=float) - np.asarray(velocity, dtype=float)"
TIME = "return c / (closing + math.sqrt(root))"

SLIPS = slips(
    squares_subtracted=(
        "root = speed_squared * (reach * reach - float(across @ across))",
        "root = closing * closing - speed_squared * c",
        "The formula is right, but it loses its digits: far away, closing^2 and speed^2 * c are "
        "two huge numbers that agree in nearly all digits. Use the part of the distance that is "
        "perpendicular to the motion: speed^2 * (reach^2 - across^2) has the same value.",
    ),
    second_root=(
        TIME,
        "return (closing + math.sqrt(root)) / speed_squared",
        "That is the larger root, the time at which they separate again. They touch at the smaller "
        "root.",
    ),
    flying_apart_counted=(
        "if closing <= 0.0:",
        "if closing == 0.0:",
        "You return a time for balls that fly apart: a negative one, or one in the past. Only "
        "balls that approach each other can touch.",
    ),
    miss_not_seen=(
        "    if root < 0.0:\n        return -1.0\n",
        "    root = abs(root)\n",
        "You return a time for balls that pass at a distance. If the value under the root is "
        "negative, they never touch.",
    ),
    nearest_approach=(
        TIME,
        "return closing / speed_squared",
        "That is the time of closest approach. They touch before it.",
    ),
    distance_over_speed=(
        TIME,
        "return (distance - reach) / math.sqrt(speed_squared)",
        "Gap over speed is right only for a head-on impact. Off-centre, the balls travel farther.",
    ),
    own_velocity_only=(
        RELATIVE,
        "-np.asarray(velocity, dtype=float)",
        "You move only the first ball. Use the relative velocity.",
    ),
    velocities_added=(
        RELATIVE,
        "np.asarray(other_velocity, dtype=float) + np.asarray(velocity, dtype=float)",
        "You add the velocities. The relative velocity is their difference.",
    ),
    reach_halved=(
        "c = (distance - reach) * (distance + reach)",
        "reach = 0.5 * reach\n    c = (distance - reach) * (distance + reach)",
        "You use half of reach. It already is the sum of both radii: the balls touch when the "
        "centres are reach apart.",
    ),
    reach_forgotten=(
        "c = (distance - reach) * (distance + reach)",
        "reach = 0.0\n    c = (distance - reach) * (distance + reach)",
        "You treat the balls as points. They touch when the centres are reach apart.",
    ),
    overlap_ignored=(
        "if c <= 0.0:",
        "if False:",
        "Balls that overlap now are in contact now: the time is 0, wherever they are flying.",
    ),
    overlap_only_when_closing=(
        "if c <= 0.0:",
        "if c <= 0.0 and d @ v < 0.0:",
        "Balls that overlap while they fly apart still overlap now: the time is 0.",
    ),
    clearance_of_a_second=(
        "return c / (closing + math.sqrt(root))",
        "time = c / (closing + math.sqrt(root))\n    return time if time <= 1.0 else -1.0",
        "You do not report impacts later than some limit. The task sets no limit.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "a closed form without cancellation: only the rounding of the arguments remains",
        explain=squares,
    ),
    examples=(
        "impact_time([0.0, 0.0], [1.0, 0.0], [5.0, 0.0], [-1.0, 0.0], 1.0)",
        "impact_time([0.0, 0.0], [1.0, 0.0], [5.0, 0.8], [0.0, 0.0], 1.0)",
        "impact_time([0.0, 0.0], [1.0, 0.0], [5.0, 1.8], [0.0, 0.0], 1.0)",
    ),
    picture=balls,
    slips=SLIPS
    + coarse_slips("impact_time", "You then miss an impact within the next microsecond.")
    + value_slips("impact_time", in_part=False),
)
