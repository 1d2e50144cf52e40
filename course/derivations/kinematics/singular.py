"""Claims on what happens near a singular posture, and on what says how near it is."""

from typing import Any

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.kinematics import (
    ARM,
    Floats,
    damped_inverse,
    panda_postures,
    planar_jacobian,
    planar_tip,
    two_links,
)

SYMBOLS = {
    "l1": Symbol("length of the first link [m]"),
    "l2": Symbol("length of the second link [m]"),
    "s": Symbol("singular value of J [m/rad]"),
    "lambda": Symbol("damping [m/rad]"),
    "e": Symbol("error of the tip [m]"),
    "delta": Symbol("angle of the elbow from stretched [rad]", 0.001, 0.01),
}


def _listing(
    target: Floats, start: Floats, damping: float = 0.1, steps: int = 100, share: float = 0.5
):
    """Return the result of the usual loop: damped steps, scaled by a share, until 0.1 mm is left.

    Args:
        target: (2,) or (2, N) [m].
        start: joint angles, of the same shape.
        damping: of the least-squares step.
        steps: limit of the number of steps.
        share: factor on each damped step.

    Returns:
        Joint angles, distance left [m] and steps taken; what was not reached took all of them.
    """
    target, q = (np.array(x, float).reshape(2, -1) for x in (target, start))
    taken = np.zeros(q.shape[1], int)
    for _ in range(steps):
        error = target - planar_tip(ARM, q)
        # Only the targets that are still farther than 0.1 mm away are stepped.
        going = np.flatnonzero(np.hypot(*error) >= 1e-4)
        if not going.size:
            break
        taken[going] += 1
        inverse = damped_inverse(planar_jacobian(ARM, q[:, going]), damping)
        q[:, going] += share * np.einsum("kij,jk->ik", inverse, error[:, going])
    return q, np.hypot(*(target - planar_tip(ARM, q))), taken


def _around(rng: np.random.Generator, low: float, high: float, count: int = 2000) -> np.ndarray:
    """Return random points between two distances from the base, (2, count) [m]."""
    # Uniform in radius and angle, so that both edges of the annulus are sampled.
    angle = rng.uniform(-np.pi, np.pi, count)
    return rng.uniform(low, high, count) * np.array([np.cos(angle), np.sin(angle)])


@claim(
    "At a singularity the pseudo-inverse asks for infinite joint steps.",
    "At it a pseudo-inverse from singular values drops the lost direction and asks for nothing; "
    "beside it, it asks for almost everything. Stretched to {delta_rad:.0e} rad, links of {l1_m} m "
    "and {l2_m} m should turn by {step_rad:.0f} rad for a centimetre along the arm.",
    ask=(
        "The elbow is delta from stretched, delta small. Which step (its length, to leading "
        "order) does the pseudo-inverse ask for to bring the tip in by e?",
        "dq, step = e*sqrt((l1 + l2)^2 + l2^2)/(l1*l2*delta)",
        {
            "e/(l1*l2*delta)": "1 / det has no unit of a step: s_min is det / s_max.",
            "e/delta": "Check the units: a length over an angle is no angle.",
            "e/(l1 + l2)": "That is a step across the arm, which is the easy direction.",
            "e*sqrt(l1^2 + l2^2)/(l1*l2*delta)": "The first joint moves the tip on a lever of "
            "l1 + l2.",
        },
    ),
)
def pseudo_inverse_beside(result):
    import sympy

    e, delta = sympy.symbols("e delta", positive=True)
    (l1, l2), (q1, q2), J = two_links()
    J = J.subs({q1: 0, q2: delta})
    # Cramer's rule: the determinant is what vanishes at the singularity.
    step = J.adjugate() * sympy.Matrix([e, 0]) / sympy.simplify(J.det())
    square = sympy.limit(sympy.simplify(step.dot(step) * delta**2), delta, 0)
    result.formula = sympy.sqrt(sympy.factor(square)) / delta
    law = sympy.lambdify((l1, l2, e, delta), result.formula)

    def requested(lengths: Floats, beside: float, error: float) -> float:
        J = planar_jacobian(lengths, [0.0, beside])
        return float(np.linalg.norm(np.linalg.pinv(J, rcond=1e-12) @ [-error, 0.0]))

    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    beside = result.input("delta_rad", 1e-6)
    result.measure("step_rad", requested(lengths, beside, 0.01), 1e-5)
    result.measure("at_it_rad", requested(lengths, 0.0, 0.01))
    draws = result.rng.uniform((0.3, 0.3, 0.001, -6), (1.5, 1.5, 0.1, -4), (40, 4))
    # Elbows within 1e-6 to 1e-4 rad of stretched, where only the leading order is left.
    ratios = [requested(d[:2], 10 ** d[3], d[2]) / law(*d[:3], 10 ** d[3]) for d in draws]
    result.statement = "Two-link Jacobian by algebra; pinv of NumPy at 40 random arms and angles."
    result.statement_holds(not requested(lengths, 0.0, 0.01) < 1e6)
    result.correction_holds(
        requested(lengths, 0.0, 0.01) == 0,
        requested(lengths, beside, 0.01) > 1e4,
        np.allclose(ratios, 1, atol=1e-3),
    )


@claim(
    "Damped least squares, dq = J^T (J J^T + lambda^2 I)^-1 dx, bounds the step by a constant "
    "times the error.",
    "Each singular value s of J turns an error into s / (s^2 + lambda^2) of it: never more than "
    "{formula}, reached at s = lambda and nowhere else. The bound is on the ratio of step and "
    "error, so a large error still causes a large step: up to {step_rad:.0f} rad for a metre, with "
    "a damping of {damping} m/rad.",
    ask=(
        "What is the largest gain s / (s^2 + lambda^2) over all s?",
        "gain = 1/(2*lambda)",
        {
            "1/lambda": "At s = lambda both terms of the denominator are equal: half of that.",
            "1/lambda^2": "Check the units: s is a length over an angle, and so is lambda.",
            "1/(2*lambda^2)": "Check the units: s is a length over an angle, and so is lambda.",
            "lambda/2": "That is how much of a motion leaks out of a damped null space.",
        },
    ),
    source="Nakamura and Hanafusa (1986); Wampler (1986)",
)
def damped_gain(result):
    import sympy

    s, damping = sympy.symbols("s lambda", positive=True)
    gain = s / (s**2 + damping**2)
    (best,) = sympy.solve(sympy.diff(gain, s), s)
    result.formula = sympy.simplify(gain.subs(s, best))
    lam = result.input("damping", 0.1)
    q = result.rng.uniform(-np.pi, np.pi, (2, 4000))
    q[1, ::2] *= 10 ** result.rng.uniform(-6, 0, 2000)  # half of them near stretched
    J, gains = planar_jacobian(ARM, q), {}
    for value in (0.01, lam, 1.0):
        gains[value] = 2 * value * np.linalg.norm(damped_inverse(J, value), 2, axis=(1, 2))
    result.measure("step_rad", gains[lam].max() / (2 * lam), 1e-3)
    # The gain from the singular values, independent of the damped inverse.
    values = np.linalg.svd(np.moveaxis(J, 2, 0))[1] / lam
    law = (2 * values / (values**2 + 1)).max(axis=1)
    result.statement = "Norm of the damped inverse at 4000 postures, half of them near stretched."
    result.statement_holds(all(x.max() <= 1 + 1e-9 for x in gains.values()))
    result.correction_holds(
        best == damping,
        gains[lam].max() > 0.999,
        np.abs(gains[lam] - law).max() < 1e-9,
    )


@claim(
    "Damping prevents the blow-up near a singularity and changes nothing else.",
    "A step leaves the fraction {formula} of an error along a singular direction: all of it where "
    "s goes to 0, and something in every other posture. With links of {l1_m} m and {l2_m} m and a "
    "damping of {damping} m/rad it is {left_percent:.1f} % along the weaker direction, in the "
    "median of random postures.",
    ask=(
        "Of an error along the direction of a singular value s, which share does one full damped "
        "step leave (linearised)?",
        "share = lambda^2/(s^2 + lambda^2)",
        {
            "s^2/(s^2 + lambda^2)": "That is the share it removes.",
            "s/(s^2 + lambda^2)": "That is the step; J turns it into a motion of the tip.",
            "lambda/(s + lambda)": "Both are squared.",
        },
    ),
)
def damping_is_free(result):
    import sympy

    s, lam = sympy.symbols("s lambda", positive=True)
    result.formula = sympy.simplify(1 - s * s / (s**2 + lam**2))
    law = sympy.lambdify((s, lam), result.formula)
    damping = result.input("damping", 0.1)
    lengths = result.input("l1_m", ARM[0]), result.input("l2_m", ARM[1])
    q = result.rng.uniform(-np.pi, np.pi, (2, 2000))
    J = planar_jacobian(lengths, q)
    stack = np.moveaxis(J, 2, 0)
    U, values, _ = np.linalg.svd(stack)

    def remaining(i: int, value: float) -> np.ndarray:
        """Return the remaining share of an error along singular direction i, for all postures."""
        # Left singular vectors: directions of the tip that decouple.
        along = U[:, :, i : i + 1]
        return np.linalg.norm(along - stack @ (damped_inverse(J, value) @ along), axis=(1, 2))

    error = [
        np.abs(remaining(i, v) - law(values[:, i], v)).max() for i in (0, 1) for v in (0.01, 0.1, 1)
    ]
    result.measure("left_percent", 100 * np.median(remaining(1, damping)), 1e-3)
    result.statement = (
        f"2000 random postures, both directions, three dampings: law to {max(error):.0e}."
    )
    result.statement_holds(np.max(remaining(1, damping)) < 1e-3)
    result.correction_holds(max(error) < 1e-9, np.median(remaining(1, damping)) > 0.01)


@claim(
    "IK fails when the Jacobian loses rank.",
    "Many methods get there. The closed form solves targets exactly on "
    "the outer edge, whose only answer is singular, up to rounding. A loop of half damped steps "
    "comes within a tenth of a millimetre too, but the larger lambda, the more slowly: in "
    "{steps_edge:.0f} steps with {damping} m/rad (for targets inside it needs {steps_inside:.0f}), "
    "in {steps_more:.0f} with {more} m/rad.",
)
def rank_loss_is_failure(result):
    from course.kinematics import two_link_ik

    # Exactly on the outer edge, whose only posture is stretched.
    edge, inside = _around(result.rng, 1.8, 1.8, 500), _around(result.rng, 0.5, 1.5, 500)
    start = result.rng.uniform(-np.pi, np.pi, (2, 500))
    answer = two_link_ik(ARM, edge)
    closed = np.hypot(*(planar_tip(ARM, answer.q[:, 0]) - edge))
    damping, more = result.input("damping", 0.03), result.input("more", 0.1)
    (_, remaining, slow), (_, _, quick) = (
        _listing(x, start, damping, 3000) for x in (edge, inside)
    )
    _, also, slower = _listing(edge, start, more, 3000)
    # The answers on the edge really are singular, or the test would be no test.
    rank = [np.linalg.matrix_rank(planar_jacobian(ARM, q), 1e-6) for q in answer.q[:, 0].T[:50]]
    result.measure("steps_edge", np.median(slow), 0.05)
    result.measure("steps_inside", np.median(quick), 0.05)
    result.measure("steps_more", np.median(slower), 0.05)
    result.statement = f"500 targets; at most {remaining.max():.1e} m are left on the edge."
    result.statement_holds(remaining.max() > 1e-3 or closed.max() > 1e-3)
    result.correction_holds(
        closed.max() < 1e-12,
        (remaining < 1e-4).all(),
        (also < 1e-4).all(),
        max(rank) == 1,
        np.median(slower) > 3 * np.median(slow),
        np.median(slow) > 1.5 * np.median(quick),
    )


@claim(
    "Damping gets an arm out of a singular start.",
    "Not if the target lies along the stretched arm: the error is across every column of J, J^T e "
    "= 0, and every method that starts from J^T, damped or not, stays where it is: after "
    "{steps:g} steps the error is still {away_m} m. This balance is unstable: a small bend of the "
    "elbow grows {growth:.0f}-fold in the first full step here, so bend it a little (unless the "
    "arm points along x, rounding may do it).",
)
def singular_start(result):
    import sympy

    from course.kinematics import ik, planar
    from course.kinematics.inverse import METHODS

    away, damping = result.input("away_m", 0.5), 0.1
    steps = result.input("steps", 100)

    def remaining(bend: float, error: float, value: float = damping) -> float:
        return float(_listing([sum(ARM) - error, 0.0], [0.0, bend], value, steps)[1][0])

    def growth(bend: float, error: float, value: float) -> float:
        """Return the factor by which one full damped step multiplies the bend of the elbow."""
        target = [sum(ARM) - error, 0.0]
        return float(_listing(target, [0.0, bend], value, 1, 1.0)[0][1, 0] / bend)

    # The step to first order in the bend, by algebra.
    e, value, bend = sympy.symbols("e value bend", positive=True)
    l1, l2 = (sympy.Rational(str(x)) for x in ARM)
    J = sympy.Matrix([[-l2 * bend, -l2 * bend], [l1 + l2, l2]])
    error = sympy.Matrix([-e, -l2 * bend])
    inner = J * J.T + value**2 * sympy.eye(2)
    step = J.T * inner.adjugate() * error / inner.det()
    # Derivative of the elbow's step with respect to its bend: an unstable balance if it is above 1.
    law = sympy.lambdify((e, value), 1 + sympy.diff(step[1], bend).subs(bend, 0))

    draws = result.rng.uniform((0.01, 0.03), (1.0, 0.5), (30, 2))
    arm, goal, options = planar(ARM), [sum(ARM) - away, 0, 0], {"restarts": 0, "iterations": steps}
    # Restarts are off, since they would hide what one start does.
    stuck = [ik(arm, goal, [0.0, 0.0], method=method, **options).q for method in METHODS]
    result.measure("growth", growth(1e-5, away, damping), 1e-4)
    stretched = planar_jacobian(ARM, [0.0, 0.0])
    still = [stretched.T @ [-away, 0.0], np.linalg.pinv(stretched) @ [-away, 0.0]]
    bent = result.measure("left_bent_m", remaining(1e-9, away), 0.5)
    result.statement = f"Started with the elbow at 0 and at 1e-9 rad, which ends {bent:.0e} m off."
    result.statement_holds(remaining(0.0, away) < 1e-3)
    result.correction_holds(
        # Bit for bit: not a single rounding error may move the arm.
        all(remaining(0.0, e, value) == abs(sum(ARM) - (sum(ARM) - e)) for e, value in draws),
        all(abs(growth(1e-5, *d) / law(*d) - 1) < 1e-4 for d in draws),
        bent < 1e-4,
        not np.any(still),
        not np.any(stuck),
    )


@claim(
    "The usual first listing of damped least squares (lambda = 0.1, half of each step, 100 steps) "
    "reaches the point (1.2, 0.5) with links of 1 m and 0.8 m.",
    "From q1 = q2 = {start_rad} rad it does, in {steps:g} steps, and from {share_percent:.1f} % "
    "of random starts. It stops {left_mm:.3f} mm short, as it ends once less than a tenth of a "
    "millimetre is left. Which of the two answers it finds depends on the start: from "
    "{same_percent:.0f} % of the random ones the elbow ends on the side on which it began.",
)
def listing_reaches_its_target(result):
    from course.kinematics import two_link_ik

    target = np.array([1.2, 0.5])
    _, remaining, steps = _listing(target, [result.input("start_rad", 0.5)] * 2)
    starts = result.rng.uniform(-np.pi, np.pi, (2, 1000))
    spread, away, _ = _listing(np.tile(target[:, None], 1000), starts)
    answers = two_link_ik(ARM, target).q
    # Angles are compared modulo a full turn.
    gap = np.angle(np.exp(1j * (spread[:, None] - answers[:, :, None])))
    result.measure("steps", steps[0])
    result.measure("left_mm", 1000 * remaining[0], 1e-4)
    result.measure("share_percent", 100 * np.mean(away < 1e-4), 2e-3)
    same = np.sin(spread[1]) * np.sin(starts[1]) > 0
    result.measure("same_percent", 100 * same.mean(), 0.05)
    result.statement = "The listing from its own start and from 1000 random ones."
    result.statement_holds(remaining[0] < 1e-4)
    result.correction_holds(
        np.mean(away < 1e-4) > 0.98,
        remaining[0] > 1e-6,
        0.55 < same.mean() < 0.75,
        (np.abs(gap[:, :, away < 1e-4]).max(axis=0).min(axis=0) < 1e-2).all(),
    )


@claim(
    "That listing converges even near singularities; if it does not, raise the damping.",
    "Away from the edges of the annulus it nearly always does. Of targets in the last centimetre "
    "before the outer edge {outer_percent:.0f} % are reached in its hundred steps, of those in "
    "the last tenth of a millimetre {edge_percent:.1f} %. Three times the damping reaches only "
    "{more_percent:.1f} % in the last centimetre, a third of it {less_percent:.0f} %. The step "
    "along a direction shrinks with s / (s^2 + lambda^2), and lambda is what shrinks it. Beyond "
    "the annulus it returns joint angles like any others, and no word that it failed.",
)
def listing_converges(result):
    def reached(low: float, high: float, damping: float = 0.1, steps: int = 100) -> float:
        start = result.rng.uniform(-np.pi, np.pi, (2, 1000))
        return 100 * np.mean(
            _listing(_around(result.rng, low, high, 1000), start, damping, steps)[1] < 1e-4
        )

    outer = result.measure("outer_percent", reached(1.79, 1.8), 0.02)
    edge = result.measure("edge_percent", reached(1.7999, 1.8), 0.5)
    more = result.measure("more_percent", reached(1.79, 1.8, 0.3), 0.5)
    less = result.measure("less_percent", reached(1.79, 1.8, 0.1 / 3), 0.02)
    inside, beyond = reached(0.4, 1.6), reached(1.801, 3.0)
    result.measure("inside_percent", inside, 0.01)
    result.statement = f"1000 random targets and starts each; inside {inside:.1f} %."
    result.statement_holds(edge > 90 and more > outer)
    result.correction_holds(inside > 98, edge < 5, more < 5, 80 < outer < less, beyond == 0)


@claim(
    "The condition number of J is its largest times its smallest singular value.",
    "It is the largest over the smallest: how much larger a joint step the worst direction needs "
    "than the best. The product of both is, for two links, |det J|, the manipulability. That one "
    "shrinks with the arm: made ten times smaller in the same posture, its determinant is "
    "{shrunk:g} times as large, its condition number the same.",
)
def condition_is_a_product(result):
    from course.kinematics import manipulability, singular_values

    q = result.rng.uniform(-np.pi, np.pi, (2, 300))
    # Singular postures are moved, where the condition number is infinite.
    q[1] = np.where(np.abs(np.sin(q[1])) < 0.02, 1.0, q[1])
    large, small = (planar_jacobian(np.array(ARM) * scale, q) for scale in (1.0, 0.1))
    (top, low), ours = singular_values(large), np.linalg.cond(np.moveaxis(large, 2, 0))
    ratio = manipulability(small) / manipulability(large)
    # The joint steps that unit motions of the tip ask for, by direction.
    around, inverse = np.linspace(0, np.pi, 721), np.linalg.inv(np.moveaxis(large, 2, 0))
    # The definition by directions, on a grid of a quarter degree: hence 1 %.
    requested = np.linalg.norm(inverse @ [np.cos(around), np.sin(around)], axis=1)
    result.measure("shrunk", np.median(ratio))
    result.measure("ratio_at_right_angle", np.linalg.cond(planar_jacobian(ARM, [0.0, np.pi / 2])))
    result.statement = "300 random postures of two links, and the same arm a tenth as long."
    result.statement_holds(np.allclose(ours, top * low))
    result.correction_holds(
        np.allclose(ours, top / low),
        np.allclose(top * low, manipulability(large)),
        np.allclose(manipulability(large), np.abs(np.linalg.det(np.moveaxis(large, 2, 0)))),
        np.allclose(requested.max(axis=1) / requested.min(axis=1), ours, rtol=1e-2),
        np.allclose(ours, np.linalg.cond(np.moveaxis(small, 2, 0))),
        np.ptp(ratio) < 1e-9,
    )


@claim(
    "Whatever the arm and the units, cond(J) > 100 means that the arm is near a singularity.",
    "The number alone does not say so: it depends on the arm and on the unit. Links "
    "of {l1_m} m and {l2_m} m pass it within "
    "{beside_deg:.1f} degrees of stretched; a last link {short:g} times shorter than the first is "
    "above it in every posture, with both joints free to move the tip. With rotation in the task "
    "the unit decides: of random postures of the 7-R arm {percent_m:.0f} % are above it with rows "
    "of position in metres, {percent_mm:.0f} % in millimetres. Watch s_min against your own speed "
    "limits: the joints turn up to 1 / s_min times as fast as the tip moves.",
)
def condition_above_hundred(result):
    from course.kinematics import condition_number, jacobian
    from course.measure.stability import limit

    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    short = result.input("short", 120)

    def cond(bend: float, arm: Any = lengths) -> float:
        return float(np.linalg.cond(planar_jacobian(arm, [0.0, bend])))

    beside = limit(lambda bend: cond(np.pi / 2 - bend) < 100, 0.0, np.pi / 2 - 1e-6)
    # A sweep of the elbow: the least condition number, not a single posture's.
    stubby = [cond(bend, (1.0, 1.0 / short)) for bend in np.linspace(0.01, np.pi - 0.01, 400)]
    J = jacobian(*panda_postures(result.rng, 4000))
    above = {unit: 100 * np.mean(condition_number(J, unit) > 100) for unit in (1.0, 0.001)}
    result.measure("beside_deg", np.degrees(np.pi / 2 - beside), 1e-3)
    result.measure("least_of_the_stubby", min(stubby), 1e-3)
    result.measure("percent_m", above[1.0], 0.02)
    result.measure("percent_mm", above[0.001], 0.02)
    result.statement = "Sweeps of the elbow, and 4000 random postures of the 7-R arm."
    result.statement_holds(min(stubby) < 100 and above[0.001] < 50)
    result.correction_holds(min(stubby) > 100, above[1.0] < 20, above[0.001] > 99, cond(0.5) < 100)


@claim(
    "The condition number of a Jacobian with position and rotation is a property of the posture.",
    "It belongs to a posture and to a length that you choose. Rows of position in metres beside "
    "rows of rotation in radians have no common scale: with millimetres the same postures of the "
    "7-R arm have {factor:.0f} times the number in the median, from {least:.0f} to {most:.0f} "
    "times over nine of ten. Say by which length the rows were divided. Position rows alone need "
    "no length if all joints are revolute. With a sliding joint they need one too.",
)
def condition_needs_a_length(result):
    from course.kinematics import condition_number, jacobian

    J = jacobian(*panda_postures(result.rng, 4000))
    factor = condition_number(J, 0.001) / condition_number(J, 1.0)
    result.measure("factor", np.median(factor), 0.02)
    result.measure("least", np.percentile(factor, 5), 0.05)
    result.measure("most", np.percentile(factor, 95), 0.05)
    position = np.moveaxis(J[:3], 2, 0)
    # Chosen to break it: position rows alone, with a sliding joint, of an arm and of a smaller one.
    q = result.rng.uniform(0.3, 2.8, (2, 20))
    scara = np.zeros((2, 3, 3, 20))
    scara[:, 2, 2] = 1.0
    for k, scale in enumerate((1.0, 0.1)):
        scara[k, :2, :2] = planar_jacobian(np.array(ARM) * scale, q)
    large, small = np.linalg.cond(np.moveaxis(scara, 3, 1))
    result.statement = "4000 random postures; rows of position divided by 1 m and by 1 mm."
    result.statement_holds(np.allclose(factor, 1))
    result.correction_holds(
        np.median(factor) > 50,
        # Rows of one unit: any common scale cancels.
        np.allclose(np.linalg.cond(position), np.linalg.cond(1e3 * position)),
        (small > 2 * large).all(),
    )


@claim(
    "Where the Jacobian to Euler angles breaks down, the arm is singular.",
    "Only the angles fail. Choose other axes for the hand: the arm itself does not change, nor "
    "does its geometric Jacobian. But {near_deg:g} degree from a pitch of +-{lock_deg:g} the "
    "Jacobian to yaw, pitch and roll has {factor:.0f} times the condition number, in the median "
    "of random postures of the 7-R arm.",
)
def euler_jacobian_locks(result):
    from dataclasses import replace

    from course.kinematics import analytic_jacobian, condition_number, jacobian, tip
    from course.rigid_body import quaternion

    arm, draws = panda_postures(result.rng, 60)
    near, lock = result.input("near_deg", 1), result.input("lock_deg", 90)

    def painted(q: np.ndarray, pitch: float) -> tuple[float, float]:
        """Return conditions (geometric, analytic) with the hand's frame turned to a pitch [deg]."""
        desired = quaternion.from_euler_zyx(0.3, np.radians(pitch), 0.4)
        # The tool is turned such that the hand's frame has the desired pitch; the arm stays as it
        # is.
        turn = quaternion.product(quaternion.conjugate(tip(arm, q)[3:]), desired)
        tool = np.concatenate([arm.tool[:3], quaternion.product(arm.tool[3:], turn)])
        other = replace(arm, tool=tool)
        return tuple(condition_number(f(other, q), 1.0) for f in (jacobian, analytic_jacobian))

    flat, locked = (np.array([painted(q, x) for q in draws.T]) for x in (0, lock - near))
    result.measure("factor", np.median(locked[:, 1] / locked[:, 0]), 1e-3)
    result.measure("factor_at_pitch_0", np.median(flat[:, 1] / flat[:, 0]), 1e-3)
    result.statement = "60 random postures, each with the hand's frame turned two ways."
    result.statement_holds(np.allclose(locked[:, 1], locked[:, 0], rtol=1))
    result.correction_holds(
        np.allclose(flat[:, 0], locked[:, 0]),
        (locked[:, 1] > 5 * locked[:, 0]).mean() > 0.9,
        np.median(flat[:, 1] / flat[:, 0]) < 2,
    )


@claim(
    "When an IK loop that ignores the joint limits converges, its joint angles are usually within "
    "them.",
    "They reach the pose, but often with angles that the arm cannot take: the usual loop, a tenth "
    "of each pseudo-inverse step and no limits, converges from random starts on "
    "{there_percent:.1f} % of {poses:g} reachable poses of the 7-R arm and ends within the limits "
    "on {within_percent:.1f} %. Hold the limits in every step, and start again where that gets "
    "stuck: then {ours_percent:.1f} % are solved.",
)
def converged_within_limits(result):
    from course.kinematics import ik, tip, within
    from course.oracles.pinocchio import Arm

    count = result.input("poses", 400)
    arm, q = panda_postures(result.rng, count)
    poses, (_, starts), loop = tip(arm, q), panda_postures(result.rng, count), Arm(arm)
    ends = [loop.usual_ik(pose, start[None]) for pose, start in zip(poses.T, starts.T, strict=True)]
    other, last = np.array([end[1] for end in ends]), np.array([end[0] for end in ends]).T
    # Converged and within the limits; the error checks that "converged" was true.
    selected, error = other & within(arm, last), np.abs((tip(arm, last) - poses)[:3, other])
    ours = ik(arm, poses)
    result.measure("there_percent", 100 * other.mean(), 0.01)
    result.measure("within_percent", 100 * selected.mean(), 0.3)
    result.measure("ours_percent", 100 * np.mean(ours.success & within(arm, ours.q)), 0.02)
    result.statement = f"{count} reachable poses, Pinocchio's functions in the loop of its example."
    result.statement_holds(selected.sum() > 0.5 * other.sum())
    result.correction_holds(
        other.mean() > 0.8,
        selected.mean() < 0.4,
        error.max() < 1e-5,
        np.mean(ours.success & within(arm, ours.q)) > 0.98,
    )
