"""Stopping before a person: level ground and a person who stands, then everything at once."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return robots as in a hall or a yard; each cause of a longer way alone, then all."""

    def robot(
        label: str,
        level: str = "core",
        *,
        reaction: float | None = None,
        slope: float | None = 0.0,
        person: float | None = None,
        unsure: float | None = None,
        sight: float | None = None,
        n: int = 5,
    ) -> Case:
        drawn = rng.uniform([0.1, -0.15, 0.5, 0.05, 4.0], [0.6, 0.1, 2.0, 0.3, 9.0]).tolist()
        given = (reaction, slope, person, unsure, sight)
        late, turn, walk, far, sees = [
            d if g is None else g for d, g in zip(drawn, given, strict=True)
        ]
        braking = float(rng.uniform(1.5, 4.0))
        return Case((rng.uniform(1.0, 20.0, n), late, braking, turn, walk, far, sees), label, level)

    whole = (np.array([3, 9, 18]), 1, 2, 0, 1, 0, 5)
    return [
        robot("the brake alone", "simple", reaction=0.0, person=0.0, unsure=0.0),
        robot("with a reaction", "simple", person=0.0, unsure=0.0),
        robot("a person who stands", "simple", person=0.0),
        *(robot("a person who walks") for _ in range(3)),
        *(robot("on a slope", slope=None) for _ in range(3)),
        robot("up a steep ramp", slope=-0.2),
        robot("down a ramp", slope=0.12),
        robot("stands already", "edge", n=1, slope=None),
        robot("no sight", "edge", sight=0.05),
        robot("just too little", "edge", reaction=0.5, person=1.0, unsure=0.1, sight=0.5),
        Case(whole, WHOLE, "edge"),
        robot("no reaction time", "edge", reaction=0.0, slope=None),
    ]


_V, _SLOWING = "dtype=float) / 3.6", "slowing = braking - 9.81 * np.sin(slope)"
_WAY = "distance = v * reaction + v**2 / (2.0 * slowing)"
_TIME, _GAP = "time = reaction + v / slowing", "gap = distance + person * time + unsure"
_LINEAR, _LEFT = "linear = reaction + person / slowing", "left = sight - person * reaction - unsure"
_RETURN = "max(3.6 * float(top), 0.0)"

SLIPS = slips(
    reaction_forgotten=(
        _WAY,
        "distance = v**2 / (2.0 * slowing)",
        _LINEAR,
        "linear = person / slowing",
        "The robot goes on at full speed until the brake acts: the way of the reaction time is "
        "missing.",
    ),
    half_missing=(
        _WAY,
        "distance = v * reaction + v**2 / slowing",
        "The way of the brake is v^2 / (2 a): the mean speed while braking is half the first.",
    ),
    kilometres_an_hour=(
        _V,
        "dtype=float)",
        "The speeds come in km/h and are taken for m/s: a way 3.6 times too long at least, 13 "
        "times that of the brake.",
    ),
    kilometres_an_hour_throughout=(
        _V,
        "dtype=float)",
        _RETURN,
        "max(float(top), 0.0)",
        "The speeds come in km/h and are used as if they were in m/s, and so is the highest speed "
        "that is returned.",
    ),
    times_instead_of_over=(_V, "dtype=float) * 3.6", "A metre a second is 3.6 km/h: divide."),
    top_in_metres_a_second=(
        _RETURN,
        "max(float(top), 0.0)",
        "The highest speed comes in m/s; asked is km/h.",
    ),
    person_forgotten=(
        _GAP,
        "gap = distance + unsure",
        _LINEAR,
        "linear = reaction",
        _LEFT,
        "left = sight - unsure",
        "The person walks on while the robot stops.",
    ),
    person_in_the_reaction_only=(
        _TIME,
        "time = reaction + 0.0 * v",
        _LINEAR,
        "linear = reaction",
        "The person walks during the reaction only. Nobody tells them when the brake begins: they "
        "walk until the robot stands.",
    ),
    person_while_braking_only=(
        _TIME,
        "time = v / slowing",
        _LEFT,
        "left = sight - unsure",
        "The person walks while the robot brakes, and in the reaction time, too.",
    ),
    slope_forgotten=(
        _SLOWING,
        "slowing = braking",
        "Gravity is left out: downhill a part of it works against the brake.",
    ),
    slope_turned=(
        _SLOWING,
        _SLOWING.replace("- 9", "+ 9"),
        "The slope has the other sign: positive is downhill, where the brake is weaker.",
    ),
    cosine_of_the_slope=(
        _SLOWING,
        "slowing = braking * np.cos(slope)",
        "The brake is made weaker by the cosine. What matters is gravity along the ground, "
        "g sin(slope).",
    ),
    slope_in_degrees=(
        _SLOWING,
        _SLOWING.replace("(slope)", "(np.deg2rad(slope))"),
        "The slope comes in radians.",
    ),
    unsure_forgotten=(
        _GAP,
        "gap = distance + person * time",
        _LEFT,
        "left = sight - person * reaction",
        "What the scanner may measure too far is left out.",
    ),
    unsure_taken_off=(
        _GAP,
        "gap = distance + person * time - unsure",
        _LEFT,
        "left = sight - person * reaction + unsure",
        "What the scanner may measure too far makes the gap larger, not smaller.",
    ),
    negative_speed=(
        _RETURN,
        "3.6 * float(top)",
        "No speed is allowed where the person is too near even for a robot that stands: 0, not a "
        "negative one.",
    ),
    top_of_the_brake_alone=(
        _LINEAR,
        "linear = 0.0",
        "The highest speed counts the way of the brake alone: sqrt(2 a sight). Solve the whole "
        "gap for v.",
    ),
    tangent_of_the_slope=(
        "np.sin(slope)",
        "np.tan(slope)",
        "The tangent of the slope is used. Along the ground gravity pulls with 9.81 sin(slope).",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "sums and a root: rounding", explain=coarse),
    examples=(
        "stopping_distance([3.6, 7.2], 0.2, 2.0, 0.0, 1.6, 0.1, 4.0)",
        "stopping_distance([3.6, 7.2], 0.2, 2.0, 0.05, 0.0, 0.0, 4.0)",
    ),
    slips=SLIPS
    + coarse_slips("stopping_distance", "A sum of lengths is checked by its digits.")
    + value_slips("stopping_distance", swapped=True),
)
