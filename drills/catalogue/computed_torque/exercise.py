"""Computed torque of two links: terms that stand alone first, then all of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

G = 9.81


def cases(rng: np.random.Generator) -> list[Case]:
    """Return holding, an error at rest, coasting on the reference; then arms that do all of it."""

    def moving(
        label: str = "random",
        level: str = "core",
        *,
        error: float = 0.3,
        slow: float = 0.5,
        v: float = 2.0,
        a: float = 4.0,
        gravity: float = G,
        turns: float = 0.0,
    ) -> Case:
        """Return errors of angle and rate, speed and acceleration of these sizes."""
        lengths, masses = rng.uniform(0.2, 0.8, 2), rng.uniform(0.3, 3.0, 2)
        q = rng.uniform(-math.pi, math.pi, 2) + turns
        rate = v * rng.uniform(0.5, 1.5, 2) * rng.choice([-1.0, 1.0], 2)
        reference = np.array(
            [
                q + error * rng.normal(size=2),
                rate + slow * rng.normal(size=2),
                a * rng.normal(size=2),
            ]
        )
        gains = rng.uniform(20.0, 200.0, 2), rng.uniform(5.0, 30.0, 2)
        return Case((lengths, masses, gravity, q, rate, reference, *gains), label, level)

    still = {"error": 0.0, "slow": 0.0, "v": 0.0, "a": 0.0}
    one, zero, far = np.ones(2), np.zeros(2), moving().args
    far[5][0] = far[3] + rng.uniform(7.0, 9.0, 2)
    whole = (
        np.array([1, 2]),
        np.array([2, 1]),
        10,
        np.array([1, -1]),
        np.array([1, 2]),
        np.array([[2, 1], [0, 1], [3, -2]]),
        np.array([9, 16]),
        np.array([6, 8]),
    )
    return [
        Case((one, 2.0 * one, G, zero, zero, np.zeros((3, 2)), one, one), "held along x", "simple"),
        moving("held on the reference", "simple", **still),
        moving("an error at rest, no gravity", "simple", **still | {"error": 0.3}, gravity=0.0),
        moving("an error of the rate, no gravity", "core", **still | {"slow": 0.5}, gravity=0.0),
        moving("coasting on the reference", error=0.0, slow=0.0, a=0.0, gravity=0.0),
        moving("speeding up from rest", error=0.0, slow=0.0, v=0.0),
        *(moving() for _ in range(5)),
        moving("gravity of the moon", gravity=1.62),
        moving("a large error", error=2.0, slow=5.0),
        moving("fast", "edge", v=20.0),
        moving("wound up by three turns", "edge", turns=6.0 * math.pi),
        Case(far, "an error of more than a turn", "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: Any) -> float:
    """Return 1e-11 of the scale that the task states, one added."""
    lengths, masses, gravity, q, v, reference, kp, kd = case.args
    reach, a = np.sum(lengths), reference[2] + kd * (reference[1] - v) + kp * (reference[0] - q)
    moved = reach * (np.abs(a).max() + np.sum(np.abs(v)) ** 2)
    return float(1e-11 * (1.0 + np.sum(masses) * reach * (gravity + moved)))


def torques(figure: Any, shown: Shown) -> None:
    """Plot the torques, joint by joint."""
    axes = picture.plane(figure, "joint", "torque [N m]")
    axes.plot([1, 2], shown.got[0], "o-", **picture.YOURS)
    axes.plot([1, 2], shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks([1, 2])
    axes.legend()


_A = "a = a_ref + np.asarray(kd) * (v_ref - v) + np.asarray(kp) * (q_ref - q)"
_PD = "np.asarray(kd) * (v_ref - v) + np.asarray(kp) * (q_ref - q)"
_RETURN = "return M @ a + coriolis + weight"
_SPIN = "np.array([-2.0 * v[0] * v[1] - v[1] ** 2, v[0] ** 2])"
_OUTER = "outer = 0.5 * m2 * l2 * math.cos(q[0] + q[1])"

SLIPS = slips(
    gains_outside_the_mass_matrix=(
        _A,
        "a = a_ref",
        _RETURN,
        f"{_RETURN} + {_PD}",
        "The gains act as torques: they stand outside the mass matrix. Then a joint's error moves "
        "the other one, and the poles change with the posture. Inside, M turns the wanted "
        "acceleration, gains and all, into torque.",
    ),
    rate_of_the_reference_in_coriolis=(
        _SPIN,
        _SPIN.replace("v[", "v_ref["),
        "The Coriolis term takes the rate of the reference. It undoes a torque that the arm has "
        "now: with the rate that is measured.",
    ),
    one_rate_of_each_in_coriolis=(
        _SPIN,
        "np.array([-v[0] * v_ref[1] - v[1] * v_ref[0] - v[1] * v_ref[1], v[0] * v_ref[0]])",
        "The Coriolis term is C(q, v) v_ref: that is the law of Slotine and Li, whose error obeys "
        "another equation. Here it undoes the arm's own torque, C(q, v) v.",
    ),
    gravity_sign=(
        _RETURN,
        "return M @ a + coriolis - weight",
        "Gravity has the wrong sign: the torque must hold the arm up. A link along +x wants a "
        "positive torque.",
    ),
    gravity_forgotten=(_RETURN, "return M @ a + coriolis", "Gravity is missing."),
    coriolis_forgotten=(
        _RETURN,
        "return M @ a + weight",
        "The Coriolis and centripetal torques are missing. At rest you don't see this.",
    ),
    coriolis_sign=(
        _RETURN,
        "return M @ a - coriolis + weight",
        "The Coriolis and centripetal torques have the wrong sign: they double what they "
        "should cancel.",
    ),
    two_forgotten_in_coriolis=(
        _SPIN,
        "np.array([-v[0] * v[1] - v[1] ** 2, v[0] ** 2])",
        "The Coriolis torque on the first joint is -h (2 v1 v2 + v2^2): the 2 is missing.",
    ),
    acceleration_forgotten=(
        "a = a_ref + ",
        "a = ",
        "The acceleration of the reference is not fed forward: the arm then lags behind whenever "
        "it has to speed up.",
    ),
    error_reversed=(
        _A,
        _A.replace("(q_ref - q)", "(q - q_ref)"),
        "The error of the angles has the wrong sign: use reference minus measured. With this "
        "sign the arm is driven away.",
    ),
    rate_error_reversed=(
        _A,
        _A.replace("(v_ref - v)", "(v - v_ref)"),
        "The error of the rates has the wrong sign: use reference minus measured.",
    ),
    damping_of_the_whole_rate=(
        _A,
        _A.replace("(v_ref - v)", "-v"),
        "The damping acts on the rate instead of the rate error, so it brakes the desired motion.",
    ),
    gains_swapped=(
        _A,
        "a = a_ref + np.asarray(kp) * (v_ref - v) + np.asarray(kd) * (q_ref - q)",
        "kp and kd are swapped.",
    ),
    model_at_the_reference=(
        "    " + _A + "\n",
        "",
        "    coupling, tip =",
        f"    {_A}\n    q, v = q_ref, v_ref\n    coupling, tip =",
        "The model is evaluated at the reference. That is feedforward: it does not cancel "
        "the torques of the actual motion, and the errors of the joints stay coupled.",
    ),
    weight_at_the_reference=(
        "math.cos(q[0]) + outer",
        "math.cos(q_ref[0]) + outer",
        _OUTER,
        _OUTER.replace("q[0] + q[1]", "q_ref[0] + q_ref[1]"),
        "Gravity is evaluated at the reference. It acts on the arm in the measured posture.",
    ),
    error_wrapped=(
        "(q_ref - q)",
        "((q_ref - q + np.pi) % (2.0 * np.pi) - np.pi)",
        "The error is wrapped to -pi ... pi. The task uses the plain difference: a joint "
        "that is one turn away has to turn back.",
    ),
    diagonal_only=(
        "[base, across], [across, tip]",
        "[base, 0.0], [0.0, tip]",
        "Only the diagonal of the mass matrix is used: each joint is driven as if the other "
        "were at rest.",
    ),
    absolute_second_angle=(
        _OUTER,
        _OUTER.replace("q[0] + q[1]", "q[1]"),
        "The second link's weight takes q2 from the x axis. It is measured from the first link: "
        "its direction is q1 + q2.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases, allowed, "a closed form of some dozen products: rounding", explain=coarse
    ),
    examples=(
        "computed_torque(np.ones(2), np.ones(2), 9.81, np.zeros(2), np.zeros(2), np.zeros((3, 2)), "
        "np.ones(2), np.ones(2))",
        "computed_torque(np.ones(2), np.ones(2), 0.0, np.zeros(2), np.zeros(2), "
        "np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]), np.full(2, 100.0), np.full(2, 20.0))",
        "computed_torque(np.ones(2), np.ones(2), 0.0, np.array([0.0, np.pi / 2]), np.ones(2), "
        "np.array([[0.0, np.pi / 2], [1.0, 1.0], [0.0, 0.0]]), np.ones(2), np.ones(2))",
    ),
    picture=torques,
    slips=SLIPS
    + coarse_slips("computed_torque", "The joints then hum at the last digits.")
    + value_slips("computed_torque", in_part=False),
)
