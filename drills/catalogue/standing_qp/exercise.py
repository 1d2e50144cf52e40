"""A standing biped: the minimum of its program, conditions of optimality, and infeasible slopes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.values import Mismatch, as_float64

if TYPE_CHECKING:
    from course.control.standing import Program

Array = NDArray[np.float64]

EXACT = 1e-6  # of the weight
# Where the limits leave little choice, a small violation buys a large shift of the forces: SciPy's
# SLSQP, which satisfies the conditions to 1e-10, was up to 4e-5 off in 1,445 cases.
FORCES = 1e-4  # of the weight
STATIONARY = 1e-4  # of the gradient's length


def cases(rng: np.random.Generator) -> list[Case]:
    """Return bipeds far from every limit, at some limits, and beyond them."""
    from course.control.standing import GRAVITY, Biped, biped, stand

    def case(standing: Biped, label: str, level: str = "core") -> Case:
        return Case(tuple(standing), label, level)

    def sampled(tangent: float, *, lean: float = 0.0, mu: float = 0.0, limit: float = 1e4) -> Biped:
        """Return a biped on a slope whose tangent is a multiple of mu, with joints moved a bit."""
        mu = mu or float(rng.uniform(0.3, 0.9))
        standing = biped(
            math.atan(tangent * mu),
            mu,
            lean=lean,
            stance=float(rng.uniform(0.12, 0.2)),
            limit=limit,
            weight=float(rng.uniform(0.05, 0.6)),
            mass=float(rng.uniform(30.0, 80.0)),
        )
        return standing._replace(joints=standing.joints + rng.uniform(-0.03, 0.03, (2, 3, 2)))

    def least_limit(standing: Biped) -> float:
        """Return the smallest torque limit that suffices."""
        low, high = 0.0, standing.mass * GRAVITY
        for _ in range(40):
            middle = 0.5 * (low + high)
            feasible = stand(standing._replace(limit=middle)).feasible
            low, high = (low, middle) if feasible else (middle, high)
        return high

    def limited(standing: Biped, factor: float) -> Biped:
        return standing._replace(limit=factor * least_limit(standing))

    side = float(rng.choice([-1.0, 1.0]))
    return [
        case(sampled(0.0), "level ground", "simple"),
        case(sampled(0.3), "a gentle slope", "simple"),
        case(sampled(-0.5), "a slope that falls along x", "simple"),
        *(case(sampled(part), "a steep slope") for part in (0.8, -0.9)),
        *(
            case(sampled(part, lean=lean * side), "leaning to one side")
            for part, lean in ((0.2, 0.1), (0.5, -0.14))
        ),
        *(case(limited(sampled(part), 1.3), "weak joints") for part in (0.1, 0.5)),
        case(limited(sampled(0.7, lean=0.08 * side), 1.2), "weak joints, leaning"),
        case(sampled(1.3), "beyond the friction angle"),
        case(sampled(0.3, lean=0.4 * side), "the centre of mass beyond the feet"),
        case(limited(sampled(0.4), 0.7), "joints too weak"),
        case(sampled(0.98), "just below the friction angle", "edge"),
        case(sampled(1.02), "just beyond the friction angle", "edge"),
        case(sampled(-1.02), "just beyond the friction angle, falling", "edge"),
        case(limited(sampled(0.4), 1.02), "joints just strong enough", "edge"),
        case(limited(sampled(0.4), 0.98), "joints just too weak", "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-4 of the weight (forces), 1e-6 of the weight times 1 m (torques), 0 (status)."""
    heavy = 9.81 * float(case.args[0])
    return [FORCES * heavy, EXACT * heavy, 0.0]


def violations(program: Program, x: Array) -> tuple[float, float, float]:
    """Return by how much forces over m g miss the conditions of optimality.

    Args:
        program: of the biped.
        x: forces over m g, shape (8,).

    Returns:
        Residual of the balance, largest violation of an inequality, and the length of what remains
        of the gradient, over that of the gradient, after the best multipliers.
    """
    from scipy.optimize import nnls

    slack = program.h - program.G @ x
    gradient = program.root.T @ (program.root @ x)
    # Multipliers of equations have any sign: each is the difference of two that are not negative.
    rows = np.vstack((program.E, -program.E, program.G[slack < 1e-5]))
    length = float(np.linalg.norm(gradient))
    # Without forces the cost is at its minimum: no gradient remains.
    remaining = float(nnls(rows.T, -gradient)[1]) / length if length > 0.0 else 0.0
    return float(np.max(np.abs(program.E @ x - program.e))), float(np.max(-slack)), remaining


def optimality(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check the conditions of optimality of forces that are said to be allowed."""
    from course.control.standing import Biped, program

    try:
        forces = as_float64(parts[0], (2, 2, 2)).ravel()
        status = float(as_float64(parts[2], ()))
    except Mismatch:
        return  # the comparison that follows says what is malformed
    if status == 0.0 or not np.all(np.abs(forces) < 1e9):
        return
    standing = Biped(*case.args)
    balance, inequality, gradient = violations(program(standing), forces / (9.81 * standing.mass))
    unbalanced = (
        "The forces don't balance the weight, or have a moment about the centre of mass: the "
        f"largest residual is {balance:.3g} of the weight (times 1 m)."
    )
    outside = (
        "A contact leaves its friction cone, or a joint its torque limit, by "
        f"{inequality:.3g} of the weight (times 1 m)."
    )
    expensive = (
        "The forces are allowed, but not the cheapest: no nonnegative multipliers of the active "
        f"constraints balance the gradient of the cost; {gradient:.3g} of it remains."
    )
    for name, error, largest, sentence in (
        ("balance", balance, 2.0 * EXACT, unbalanced),
        ("cones and limits", inequality, 2.0 * EXACT, outside),
        ("stationarity", gradient, STATIONARY, expensive),
    ):
        attempt.require(
            f"{case.label}: {name}",
            error <= largest,
            sentence=sentence,
            error=error,
            tolerance=largest,
            why="conditions of Karush, Kuhn and Tucker, checked without the worked answer",
            call=call,
        )


_AXES = "c, s = np.cos(slope), np.sin(slope)"
_CONES = "[[1.0, -mu], [-1.0, -mu]]"
_LIMITS = "np.ones(12)"
_RETURN = "return forces.reshape(2, 2, 2), torques.reshape(2, 3), 1.0"
_ROOT = "root = np.vstack((T, np.sqrt(weight) * np.eye(8)))"

SLIPS = slips(
    friction_forgotten=(
        _CONES,
        "[[0.0, -1.0], [0.0, -1.0]]",
        "Contacts only push, but nothing limits friction. Each tangential force may be at most mu "
        "times the normal force; beyond the friction angle the biped slides.",
    ),
    friction_on_one_side=(
        _CONES,
        "[[1.0, -mu], [1.0, -mu]]",
        "Friction is limited up the slope only. A cone has two sides: |t| <= mu n is t <= mu n and "
        "-t <= mu n.",
    ),
    angle_for_coefficient=(
        _CONES,
        "[[1.0, -np.arctan(mu)], [-1.0, -np.arctan(mu)]]",
        "The friction angle stands where the coefficient belongs. mu = tan(angle) multiplies the "
        "normal force.",
    ),
    limits_forgotten=(
        _LIMITS,
        "np.full(12, 1e6)",
        "The torque limits are missing from the inequalities. A torque in the cost is cheap or "
        "expensive, but only a constraint bounds it.",
    ),
    inequalities_forgotten=(
        "u = -r[:-1] / r[-1]",
        "u = np.zeros(len(r) - 1)",
        "This is the minimum under the balance alone. Where a cone or a limit is active, the "
        "cheapest allowed forces are others.",
    ),
    level_ground=(
        _AXES,
        "c, s = 1.0, 0.0",
        "The slope has no effect on your axes: normals are perpendicular to the ground, not "
        "vertical.",
    ),
    slope_mirrored=(
        _AXES,
        "c, s = np.cos(slope), -np.sin(slope)",
        "The ground rises along x for a positive slope: the normal is (-sin, cos).",
    ),
    moment_forgotten=(
        "E = np.vstack((np.tile(axes.T, 4), moments(contacts.reshape(4, 2) - com).ravel()))",
        "E = np.tile(axes.T, 4)",
        "e = np.array([0.0, 1.0, 0.0])",
        "e = np.array([0.0, 1.0])",
        "The forces carry the weight, but their moment about the centre of mass is not zero: the "
        "biped tips over.",
    ),
    moment_about_the_origin=(
        "contacts.reshape(4, 2) - com",
        "contacts.reshape(4, 2)",
        "The moment is taken about the origin. The weight acts at the centre of mass, so about "
        "another point it has a moment, too.",
    ),
    infeasible_not_reported=(
        "np.zeros((2, 3)), 0.0",
        "np.zeros((2, 3)), 1.0",
        "Where no forces are allowed, the status is still 1. Report it: a controller has to do "
        "something else then.",
    ),
    forces_in_world_axes=(
        _RETURN,
        "return forces.reshape(2, 2, 2) @ axes, torques.reshape(2, 3), 1.0",
        "The forces are horizontal and vertical. The task asks for components along the slope and "
        "along its normal.",
    ),
    normal_first=(
        _RETURN,
        "return forces.reshape(2, 2, 2)[..., ::-1], torques.reshape(2, 3), 1.0",
        "The components are swapped: the tangential force comes first.",
    ),
    torques_negated=(
        "torques = x * heavy, T @ x * limit",
        "torques = x * heavy, -(T @ x) * limit",
        "The torques have the opposite sign: a joint's torque is the counterclockwise moment of "
        "its leg's contact forces about it.",
    ),
    torques_over_their_limit=(
        "torques = x * heavy, T @ x * limit",
        "torques = x * heavy, T @ x",
        "These are torques in units of their limit. Return newton metres.",
    ),
    forces_over_the_weight=(
        "torques = x * heavy, T @ x * limit",
        "torques = x, T @ x * limit",
        "These are forces in units of the weight. Return newtons.",
    ),
    torques_not_in_the_cost=(
        _ROOT,
        "root = np.eye(8)",
        "The cost has the forces alone. The torques, over their limit, belong to it as well.",
    ),
    weight_not_rooted=(
        _ROOT,
        "root = np.vstack((T, weight * np.eye(8)))",
        "The weight is squared: in the square root of a cost it stands as its own square root.",
    ),
    weight_ignored=(
        _ROOT,
        "root = np.vstack((T, np.eye(8)))",
        "The weight of the forces has no effect: this is the minimum for a weight of 1.",
    ),
)

_FLAT = (
    "[[[0.0, 0.8], [{x}, 0.45], [-0.2, 0.07]], [[0.0, 0.8], [0.2, 0.45], [0.2, 0.07]]], "
    "[[[-0.3, 0.0], [-0.1, 0.0]], [[0.1, 0.0], [0.3, 0.0]]], 100.0, 0.25"
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "the minimum is unique, and an active-set method finds it to rounding",
        first=optimality,
    ),
    examples=(
        f"standing_qp(40.0, 0.6, 0.0, [0.0, 0.9], {_FLAT.format(x=-0.2)})",
        f"standing_qp(40.0, 0.6, 0.0, [0.5, 0.9], {_FLAT.format(x=-0.2)})",
    ),
    slips=SLIPS + value_slips("standing_qp", whole=False),
)
