"""Inverse dynamics of a planar arm: values at rest, in motion, and term by term."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]
G = 9.81


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases in which one term stands alone, then all of them."""

    def moving(
        n: int,
        label: str = "random",
        level: str = "core",
        *,
        v: float = 2.0,
        a: float = 3.0,
        gravity: float = G,
    ) -> Case:
        lengths, masses = rng.uniform(0.2, 0.8, n), rng.uniform(0.3, 3.0, n)
        state = (rng.uniform(-math.pi, math.pi, n), v * rng.normal(size=n), a * rng.normal(size=n))
        return Case((lengths, masses, *state, gravity), label, level)

    one, zero = np.ones(1), np.zeros(1)
    light, short = moving(3).args, moving(3).args
    light[1][-1], short[0][1] = 0.0, 0.0
    return [
        Case((one, 2.0 * one, zero, zero, zero, G), "one link held along x", "simple"),
        Case((one, 2.0 * one, zero, zero, 3.0 * one, 0.0), "one link that speeds up", "simple"),
        moving(2, "two links held", "simple", v=0.0, a=0.0),
        moving(2, "two links speed up from rest", v=0.0, gravity=0.0),
        moving(2, "two links coast", a=0.0, gravity=0.0),
        moving(3, "three links held", v=0.0, a=0.0),
        moving(3, "three links coast", a=0.0, gravity=0.0),
        *(moving(n) for n in (1, 2, 2, 3, 4, 6)),
        moving(3, "gravity of the moon", gravity=1.62),
        moving(3, "fast", v=30.0),
        moving(12, "twelve links", "edge"),
        Case(light, "a link of no mass", "edge"),
        Case(short, "a link of no length", "edge"),
        moving(3, "no gravity at rest", "edge", v=0.0, a=0.0, gravity=0.0),
        Case(
            (
                np.array([2, 1]),
                np.array([3, 2]),
                np.array([1, -2]),
                np.array([2, 1]),
                np.array([-1, 3]),
                10,
            ),
            WHOLE,
            "edge",
        ),
    ]


def allowed(case: Case, truth: Any) -> float:
    """Return 1e-11 of the scale that the task states, one added."""
    lengths, masses, _, v, a, gravity = case.args
    reach, turning = np.sum(lengths), np.sum(np.abs(a)) + np.sum(np.abs(v)) ** 2
    return float(1e-11 * (1.0 + np.sum(masses) * reach * (gravity + reach * turning)))


def torques(figure: Any, shown: Shown) -> None:
    """Plot the torques, joint by joint."""
    axes = picture.plane(figure, "joint", "torque [N m]")
    number = np.arange(len(shown.args[0]))
    axes.plot(number, shown.got[0], "o-", **picture.YOURS)
    axes.plot(number, shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks(number)
    axes.legend()


def twelve_links(attempt: Attempt, drawn: Sequence[Case]) -> None:
    """Time a long arm."""
    attempt.time_call(*next(case.args for case in drawn if case.label == "twelve links"))


_LEVER = "lever = length * (turning[i] * across[i] - rate[i] ** 2 * along[i])"
_SUMS = "angle, rate, turning = np.cumsum(q), np.cumsum(v), np.cumsum(a)"
_SPIN = "spin = masses[i] * lengths[i] ** 2 / 12.0 * turning[i]"
_OWN, _BEYOND = "0.5 * (x * forces[i][1] - y * forces[i][0])", "x * force[1] - y * force[0]"

SLIPS = slips(
    own_acceleration=(
        "/ 12.0 * turning[i]",
        "/ 12.0 * a[i]",
        "A link's own inertia is multiplied by its joint's acceleration. The link turns with the "
        "sum of all up to it.",
    ),
    gravity_upside_down=(
        "np.array([0.0, gravity])",
        "np.array([0.0, -gravity])",
        "Gravity acts upwards. The base that stands for it accelerates *up* at g, so that every "
        "link feels pressed down.",
    ),
    gravity_forgotten=(
        "np.array([0.0, gravity])",
        "np.zeros(2)",
        "Gravity is missing: at rest all torques are zero.",
    ),
    gravity_along_x=(
        "np.array([0.0, gravity])",
        "np.array([gravity, 0.0])",
        "Gravity acts along x. It acts along -y.",
    ),
    centripetal_lost=(
        _LEVER,
        "lever = length * turning[i] * across[i]",
        "The centripetal term is missing: a point on a turning link accelerates towards the joint, "
        "by omega^2 times its distance. At rest one does not see it.",
    ),
    centripetal_outwards=(
        _LEVER,
        "lever = length * (turning[i] * across[i] + rate[i] ** 2 * along[i])",
        "The centripetal term points outwards. The acceleration points to the joint: minus "
        "omega^2 l along the link. (The force that one feels points outwards.)",
    ),
    rates_relative=(
        _SUMS,
        "angle, rate, turning = np.cumsum(q), np.asarray(v), np.cumsum(a)",
        "The rate of a link is taken from its own joint alone. It turns with all joints before it "
        "as well: sum the rates up to it. (This loses the Coriolis terms.)",
    ),
    squares_added_up=(
        _SUMS,
        "angle, turning = np.cumsum(q), np.cumsum(a)\n    rate = np.sqrt(np.cumsum(np.square(v)))",
        "The squares of the joint rates are added up. Square the sum: a link turns with the sum of "
        "the rates up to it.",
    ),
    accelerations_relative=(
        _SUMS,
        "angle, rate, turning = np.cumsum(q), np.cumsum(v), np.asarray(a)",
        "The angular acceleration of a link is taken from its own joint alone: sum the "
        "accelerations up to it.",
    ),
    absolute_angles=(
        _SUMS,
        "angle, rate, turning = np.asarray(q), np.cumsum(v), np.cumsum(a)",
        "Each angle is taken from the x axis. It is measured from the link before: sum them.",
    ),
    all_absolute=(
        _SUMS,
        "angle, rate, turning = np.asarray(q), np.asarray(v), np.asarray(a)",
        "Angles, rates and accelerations are taken as if measured from a fixed direction. They "
        "are relative to the link before: sum all three.",
    ),
    mass_at_the_end=(
        "(joint + 0.5 * lever)",
        "(joint + lever)",
        _OWN,
        _OWN[6:],
        "The mass of each link sits at its end. A uniform rod has its centre of mass half way.",
    ),
    inertia_about_the_end=(
        _SPIN,
        _SPIN.replace("12.0", "3.0"),
        "m l^2 / 3 is the inertia of a rod about its end, and holds the motion of its centre of "
        "mass already, which then counts twice. Newton and Euler need m l^2 / 12, about the "
        "centre.",
    ),
    inertia_forgotten=(
        _SPIN,
        "spin = 0.0",
        "The links have no inertia of their own: m l^2 / 12 times the angular acceleration is "
        "missing, as if each were a point.",
    ),
    forces_not_summed=(
        "force = force + forces[i]",
        "force = forces[i]",
        "A link feels the force of the next link alone, and not of all beyond it: hand on the sum "
        "of the forces from the tip inward.",
    ),
    lever_of_the_force_forgotten=(
        " + " + _BEYOND,
        "",
        "The force of the links beyond acts at the end of the link, and its moment there, lever "
        "times force, is missing.",
    ),
    moment_not_handed_on=(
        "moment += spin",
        "moment = spin",
        "The torque of the next joint is missing: it acts back on this link and is to be held by "
        "this joint as well.",
    ),
    own_force_twice=(
        "x * force[1] - y * force[0]",
        "x * (force + forces[i])[1] - y * (force + forces[i])[0]",
        "The link's own force counts twice: half way, where it acts, and once more at the end, "
        "with those of the links beyond. Take the moment before you add it.",
    ),
    lever_of_half_a_link=(
        _BEYOND,
        "0.5 * (x * force[1] - y * force[0])",
        "The force of the links beyond acts half way along the link. It acts at its end.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "sums and products of one pass out and one back: rounding",
        explain=coarse,
        timed=twelve_links,
    ),
    examples=(
        "rnea_planar(np.ones(1), np.array([2.0]), np.zeros(1), np.zeros(1), np.zeros(1), 9.81)",
        "rnea_planar(np.ones(1), np.array([3.0]), np.zeros(1), np.zeros(1), np.ones(1), 0.0)",
        "rnea_planar(np.ones(2), np.ones(2), np.array([0.0, np.pi / 2]), np.array([1.0, 0.0]), "
        "np.zeros(2), 0.0)",
    ),
    picture=torques,
    slips=SLIPS
    + coarse_slips("rnea_planar", "A controller that takes it as feed-forward then hums.")
    + value_slips("rnea_planar", in_part=False),
)
