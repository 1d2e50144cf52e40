"""Claims on where an arm can be: products of transforms, two links, how many answers there are."""

from typing import Any

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.kinematics import Floats, planar_jacobian, planar_tip, two_links

SYMBOLS = {
    "l1": Symbol("length of the first link [m]"),
    "l2": Symbol("length of the second link [m]"),
    "q1": Symbol("angle of the first link from the x axis [rad]", -3.0, 3.0),
    "q2": Symbol("angle of the second link from the first [rad]", -3.0, 3.0),
}


def _lengths(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return random pairs of link lengths [m], one row each."""
    return rng.uniform(0.2, 1.5, (count, 2))


def _ring(rng: np.random.Generator, lengths: Floats, count: int, low: float = 0, high: float = 1):
    """Return points between two shares of the width of the annulus of two links, (2, count) [m]."""
    near, far = abs(lengths[0] - lengths[1]), sum(lengths)
    r = near + (far - near) * rng.uniform(low, high, count)
    angle = rng.uniform(-np.pi, np.pi, count)
    return r * np.array([np.cos(angle), np.sin(angle)])


@claim(
    "The pose of the tip is a product of one transform per joint, in order from base to tip.",
    "A fixed transform of the tool may follow, and only the joints on the path count. The order "
    "matters: multiplied the other way round, the tip of a random arm of {joints:g} joints, "
    "about half a metre from each to the next, lies {reversed_m:.1f} m away in the median. The "
    "transforms may be matrices or, as in this course, positions with quaternions; both agree to "
    "rounding.",
    source="Denavit and Hartenberg, A kinematic notation for lower-pair mechanisms (1955)",
)
def fk_is_a_product(result):
    from course.kinematics import random_chain, tip
    from course.rigid_body import quaternion

    def product(arm: Any, q: np.ndarray, backwards: bool) -> np.ndarray:
        """Return the tip from a product of 4 x 4 matrices, two a joint."""
        poses = []
        for i in arm.path():
            slides, half = arm.slides[i], q[i] / 2
            moved = [0, 0, q[i], 1, 0, 0, 0]
            turned = [0, 0, 0, np.cos(half), 0, 0, np.sin(half)]
            poses += [arm.placement[:, i], np.array(moved if slides else turned)]
        factors = []
        for pose in [*poses, arm.tool]:
            rows = np.column_stack([quaternion.to_matrix(pose[3:]), pose[:3]])
            # Homogeneous matrices: an implementation that shares nothing with the quaternions.
            factors.append(np.vstack([rows, [0, 0, 0, 1]]))
        return np.linalg.multi_dot(factors[::-1] if backwards else factors)[:3, 3]

    joints, distances, deviation = result.input("joints", 7), [], []
    for k in range(60):
        arm = random_chain(joints, result.rng, tree=k % 2 == 1)
        q = result.rng.uniform(-3, 3, joints)
        other = tip(arm, q)[:3]
        deviation.append(np.abs(product(arm, q, False) - other).max())
        distances.append(np.linalg.norm(product(arm, q, True) - other))
    result.measure("reversed_m", np.median(distances), 1e-3)
    result.statement = "60 random chains and trees with both kinds of joints, as 4 x 4 matrices."
    result.statement_holds(max(deviation) < 1e-12)
    result.correction_holds(min(distances[::2]) > 1e-3, max(deviation) < 1e-12)


@claim(
    "The tip of two links is at x = l1 cos q1 + l2 cos(q1 + q2), y = l1 sin q1 + l2 sin(q1 + q2).",
    "Models of a double pendulum often measure q1 from the arm that hangs down: subtract pi/2 from "
    "it first. If q2 is zero with the second link folded onto the first, subtract pi from it. "
    "Motors that sit in the base measure both angles from the x axis; then q2 replaces the sum. "
    "Confusing the two conventions puts the tip of links of {l1_m} m and {l2_m} m up to "
    "{worst_m:.2f} m off.",
)
def two_link_position(result):
    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)

    def deviation(
        lengths: Floats, q: np.ndarray, absolute: bool = False, zero: float = 0.0
    ) -> float:
        """Return distance between the quoted formula and the course's arm [m].

        `zero` is the direction from which q1 is measured.
        """
        (l1, l2), (a, b) = lengths, q
        quoted = [l1 * f(a) + l2 * f(a + b) for f in (np.cos, np.sin)]
        # An absolute second angle is the sum of both joint angles.
        joints = (np.array([a, b - a]) if absolute else q) + np.array([zero, 0.0])
        return float(np.linalg.norm(planar_tip(lengths, joints) - quoted))

    draws = result.rng.uniform(-np.pi, np.pi, (40, 2))
    arms = _lengths(result.rng, 40)
    grid = [
        deviation(lengths, np.array([a, 0.3]), absolute=True) for a in np.linspace(-3.1, 3.1, 63)
    ]
    result.measure("worst_m", max(grid), 1e-3)
    plain, absolute = (
        [deviation(arm, q, direction) < 1e-12 for arm, q in zip(arms, draws, strict=True)]
        for direction in (False, True)
    )
    result.statement = "40 random arms and postures, against the product of transforms."
    # Chosen to break it: whole turns, and links that differ by a factor of up to ten thousand.
    turns = draws + 2.0 * np.pi * result.rng.integers(-9, 10, (40, 2))
    uneven = arms * 10 ** result.rng.uniform(-4.0, 0.0, (40, 2))
    wound = [deviation(arm, q) < 1e-12 for arm, q in zip(uneven, turns, strict=True)]
    # Outside: q1 from an arm that hangs down, and both angles clockwise.
    hanging = [deviation(arm, q, zero=-0.5 * np.pi) for arm, q in zip(arms, draws, strict=True)]
    clockwise = [
        np.linalg.norm(planar_tip(arm, -q) - planar_tip(arm, q))
        for arm, q in zip(arms, draws, strict=True)
    ]
    # Chosen to break it: q2 as the angle between the links, zero when they are folded.
    between = [
        np.linalg.norm(planar_tip(arm, q - [0.0, np.pi]) - planar_tip(arm, q))
        for arm, q in zip(arms, draws, strict=True)
    ]
    result.statement_holds(
        all(plain) and max(grid) < 1e-12,
        only_if="the base is at the origin, q1 is measured from the x axis and q2 from the "
        "extension of the first link, both in the direction from x to y",
        inside=plain + wound,
        outside=absolute + [x < 1e-12 for x in (*hanging, *clockwise, *between)],
    )
    result.correction_holds(
        max(grid) > lengths[1],
        max(grid) <= 2 * lengths[1] + 1e-12,
        # The tip turns with q1, so a quarter turn moves it by sqrt(2) of its distance.
        all(
            abs(x - np.sqrt(2) * np.linalg.norm(planar_tip(arm, q))) < 1e-12
            for x, arm, q in zip(hanging, arms, draws, strict=True)
        ),
        # Half a turn of the second link moves the tip by twice its length.
        all(abs(x - 2 * arm[1]) < 1e-12 for x, arm in zip(between, arms, strict=True)),
    )


@claim(
    "The determinant of the Jacobian of two links depends on the elbow angle q2 alone, not on q1.",
    "It is {formula}: multiply the Jacobian's diagonals and use the formula for the sine of a "
    "difference. Turning the whole arm brings it no nearer to a singularity.",
    ask=(
        "What is the determinant of the Jacobian of two links, as a product?",
        "det, d = l1*l2*sin(q2)",
        {
            "l1*l2*sin(q1 + q2)": "The direction of the whole arm cannot matter; set q1 = 0.",
            "l1*l2*cos(q2)": "Stretched, q2 = 0, the tip cannot move along the arm.",
            "l1*l2*sin(q1)": "Turning the whole arm changes nothing.",
            "(l1 + l2)*l2*sin(q2)": "The l2^2 terms cancel.",
        },
    ),
)
def two_link_jacobian(result):
    import sympy

    (l1, l2), (q1, q2), derived = two_links()
    s12, c12 = sympy.sin(q1 + q2), sympy.cos(q1 + q2)
    quoted = sympy.Matrix(
        [[-l1 * sympy.sin(q1) - l2 * s12, -l2 * s12], [l1 * sympy.cos(q1) + l2 * c12, l2 * c12]]
    )
    result.formula = sympy.simplify(derived.det())
    arms, draws = _lengths(result.rng, 50), result.rng.uniform(-np.pi, np.pi, (50, 2))
    # The quoted matrix against the geometric Jacobian, and against the derivative by algebra.
    numeric = sympy.lambdify((l1, l2, q1, q2), quoted)
    deviation = [
        np.abs(numeric(*a, *q) - planar_jacobian(a, q)).max()
        for a, q in zip(arms, draws, strict=True)
    ]
    result.measure(
        "det_at_right_angle", np.linalg.det(planar_jacobian((1.0, 0.8), [0.3, np.pi / 2]))
    )
    result.statement = (
        "The formulas of the tip differentiated by algebra, and 50 random arms and postures of "
        "the course's geometric Jacobian."
    )
    result.statement_holds(sympy.simplify(sympy.diff(quoted.det(), q1)) == 0)
    result.correction_holds(
        sympy.simplify(derived - quoted) == sympy.zeros(2),
        max(deviation) < 1e-12,
        all(
            abs(np.linalg.det(planar_jacobian(a, q)) - a[0] * a[1] * np.sin(q[1])) < 1e-12
            for a, q in zip(arms, draws, strict=True)
        ),
    )


@claim(
    "An arm is singular exactly when it is stretched or folded.",
    "For two links the determinant l1 l2 sin q2 says so. If the direction of the last link counts "
    "too, three links in a plane are singular as soon as the first two are in line. "
    "A spatial arm may have "
    "other singular postures in the middle of its workspace: the 7-R arm with q2 = q5 = 0 and q3 = "
    "+-{q3_deg:g} degrees, whatever its elbow does, has rank {rank_bent:g} of 6: with the "
    "elbow at {elbow_rad:g} rad, the hand is at {reach_percent:.0f} % of its reach.",
    source="Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), sec. 3.3",
)
def singular_stretched_or_folded(result):
    from course.kinematics import jacobian, panda, planar, singular_values, tip

    arm = panda()
    half = np.radians(result.input("q3_deg", 90))

    def rank(J: np.ndarray) -> int:
        s = singular_values(J)
        # Rank relative to the largest singular value, well above rounding.
        return int(np.sum(s > 1e-9 * s[0]))

    def shoulder() -> np.ndarray:
        q = result.rng.uniform(arm.lower, arm.upper)
        # The family of the claim; the other joints are random.
        q[1], q[2], q[4] = 0.0, half * result.rng.choice([-1, 1]), 0.0
        return q

    bent = [shoulder() for _ in range(30)]
    usual = [result.rng.uniform(arm.lower, arm.upper) for _ in range(30)]
    shown = np.array([0.0, 0.0, half, -1.8, 0.0, 1.5, 0.0])
    reach = np.linalg.norm(tip(arm, shown)[:3] - [0, 0, arm.placement[2, 0]]) / arm.reach[1]
    result.measure("rank_bent", rank(jacobian(arm, shown)))
    result.measure("elbow_rad", shown[3])
    result.measure("reach_percent", 100 * reach, 1e-3)
    arms, ends = _lengths(result.rng, 20), np.array([0.0, np.pi, -np.pi])
    turns = result.rng.uniform(-3, 3, (20, 2))
    straight = [
        rank(planar_jacobian(a, [q[0], end])) == 1
        for a, q in zip(arms, turns, strict=True)
        for end in ends
    ]
    result.statement = "Singular values of 20 random two-link arms and 60 postures of the 7-R arm."

    # Chosen to break it: two to six links, random or each straight or folded, equal links among
    # them (the tip then meets a joint), and a tip on a joint while the arm is not in one line.
    longer = []
    for n in range(2, 7):
        for links in (result.rng.uniform(0.2, 1.5, n), np.ones(n)):
            q = result.rng.uniform(-3.0, 3.0, n)
            line = np.append(q[0], np.pi * result.rng.integers(-1, 2, n - 1))
            longer += [
                rank(planar_jacobian(links, q)) == 2,
                rank(planar_jacobian(links, line)) == 1,
            ]
    longer += [rank(planar_jacobian([1.0, 0.6, 0.6], [x, 1.0, np.pi])) == 2 for x in turns[:4, 0]]
    # Outside: the direction of the last link counts too, and only the first two are in line.
    with_direction = [
        rank(jacobian(planar([1.0, 0.8, 0.5]), [q[0], end, q[1]])[[0, 1, 5]]) == 3
        for q in turns[:8]
        for end in ends
    ]
    from scipy.optimize import brentq

    def coupled(first: float, second: float) -> np.ndarray:
        """Return the Jacobian of a finger of three equal links, the last joint coupled 2 to 1."""
        return planar_jacobian(np.ones(3), [first, second, 2 * second]) @ [[1, 0], [0, 1], [0, 2]]

    elbow = brentq(lambda x: np.linalg.det(coupled(0.0, x)), 1.2, 1.4, xtol=1e-14)
    result.statement_holds(
        all(rank(jacobian(arm, q)) == 6 for q in bent),
        only_if="it is a chain of joints with parallel axes, each joint moves on its own, and only "
        "the position of its tip in their plane counts; stretched or folded then means that all "
        "links are in one line",
        inside=[rank(planar_jacobian(a, q)) == 2 for a, q in zip(arms, turns, strict=True)]
        + straight
        + longer,
        outside=[rank(jacobian(arm, q)) == 6 for q in bent]
        + with_direction
        # Chosen to break it: the coupled finger, which is not in one line there.
        + [rank(coupled(x, elbow)) == 2 for x in turns[:4, 0]],
    )
    result.correction_holds(
        all(rank(jacobian(arm, q)) == 5 for q in bent),
        all(rank(jacobian(arm, q)) == 6 for q in usual),
        0.3 < reach < 0.9,
    )


@claim(
    "The tip of two links reaches the annulus |l1 - l2| <= r <= l1 + l2.",
    "It does if the first joint turns all the way round and the elbow from stretched to folded, on "
    "one side at least. An elbow that stops at +-beta leaves a hole of "
    "radius sqrt(l1^2 + l2^2 + 2 l1 l2 cos(beta)): {hole_m:.2f} m instead of {free_m:.2f} m for "
    "{l1_m} m, {l2_m} m and {beta_rad} rad.",
    ask=Ask(
        "The elbow stops at +-beta. What is the radius of the hole around the base?",
        "r = sqrt(l1^2 + l2^2 + 2*l1*l2*cos(beta))",
        {
            "l1 - l2": "That is an elbow that folds up entirely.",
            "sqrt(l1^2 + l2^2 - 2*l1*l2*cos(beta))": "beta is measured from the stretched arm, "
            "not between the links: at beta = 0 the radius is l1 + l2.",
            "l1 + l2*cos(beta)": "That is the distance along the first link only.",
        },
        symbols={"beta": Symbol("largest |q2| [rad]", 0.1, 3.0)},
    ),
)
def reachable_annulus(result):
    import sympy

    from course.kinematics import two_link_ik

    def right(
        lengths: Floats, beta: float, points: np.ndarray, low: float | None = None, turn: float = 4
    ) -> bool:
        """Return whether the annulus says of every point whether the arm gets there.

        The elbow turns from `low`, if None -beta, to beta, the first joint from -turn to turn.
        """
        answer = two_link_ik(lengths, points)
        error = np.linalg.norm(
            [planar_tip(lengths, answer.q[:, k]) - points for k in (0, 1)], axis=1
        )  # branch, point
        # Both branches of the closed form, checked by forward kinematics and by the elbow's limit.
        first = np.abs((answer.q[0] + np.pi) % (2.0 * np.pi) - np.pi) <= turn
        elbow = (answer.q[1] >= (-beta if low is None else low)) & (answer.q[1] <= beta)
        gets = ((error < 1e-6) & first & elbow).any(axis=0)
        r = np.hypot(*points)
        inside = (r >= abs(lengths[0] - lengths[1])) & (r <= sum(lengths))
        return bool((gets == inside).all())

    def hole(lengths: Floats, beta: float) -> float:
        """Return the least distance of the tip from the base, from a sweep of the elbow [m]."""
        # A sweep of the elbow, independent of the formula.
        bend = np.linspace(-beta, beta, 2001)
        return float(np.hypot(*planar_tip(lengths, np.array([0 * bend, bend]))).min())

    l1, l2 = sympy.symbols("l1 l2", positive=True)
    beta = sympy.Symbol("beta", positive=True)
    folded = sympy.Matrix([l1 + l2 * sympy.cos(beta), l2 * sympy.sin(beta)])
    result.formula = sympy.sqrt(sympy.trigsimp(sympy.expand(folded.dot(folded))))
    law = sympy.lambdify((l1, l2, beta), result.formula)
    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    stop = result.input("beta_rad", 2.5)
    result.measure("hole_m", hole(lengths, stop))
    result.measure("free_m", hole(lengths, np.pi))
    result.statement = "Closed form and product of transforms at 200 points for each of 24 arms."
    arms = _lengths(result.rng, 24)
    clouds = [result.rng.uniform(-1, 1, (2, 200)) * 1.2 * a.sum() for a in arms]
    stops = result.rng.uniform(0.5, 2.8, 24)
    # Chosen to break it: an elbow that bends to one side only, equal links, and very unequal ones.
    pairs = [
        *arms[:8],
        *(np.ones(2) * a[0] for a in arms[:4]),
        *(a * (1.0, 1e-3) for a in arms[:4]),
    ]
    spread = [result.rng.uniform(-1, 1, (2, 200)) * 1.2 * a.sum() for a in pairs]
    one_side = [right(a, np.pi, p, low=0.0) for a, p in zip(pairs, spread, strict=True)]
    # Outside: the first joint does not turn all the way round.
    short_turn = [
        right(a, np.pi, p, turn=result.rng.uniform(0.5, 2.8))
        for a, p in zip(arms, clouds, strict=True)
    ]
    result.statement_holds(
        all(right(a, b, p) for a, b, p in zip(arms, stops, clouds, strict=True)),
        only_if="the first joint turns all the way round, and the elbow from stretched to folded "
        "on at least one side",
        inside=[right(a, np.pi, p) for a, p in zip(arms, clouds, strict=True)] + one_side,
        outside=[right(a, b, p) for a, b, p in zip(arms, stops, clouds, strict=True)] + short_turn,
    )
    result.correction_holds(
        all(abs(hole(a, b) - law(*a, b)) < 1e-9 for a, b in zip(arms, stops, strict=True)),
        hole(lengths, stop) > 1.5 * hole(lengths, np.pi),
        sum(short_turn) < len(short_turn) / 2,
    )


@claim(
    "Inverse kinematics has infinitely many solutions, or none.",
    "With as many joints as the task has numbers there are usually finitely many: two links reach "
    "a point inside the annulus in {inside:g} ways, on its edge in {edge:g}, beyond in "
    "{beyond:g}, and three links a point with a heading in up to {heading:g}; an arm of six "
    "revolute joints has at most sixteen that stand alone. A continuum needs a spare joint or a "
    "special posture: folded, equal links reach the base in any direction, and in a wrist whose "
    "first and last axes lie on one line, only one combination of their two angles counts (the "
    "sum or the difference).",
    source="Raghavan and Roth, Inverse kinematics of the general 6R manipulator (1993)",
)
def number_of_solutions(result):
    from course.kinematics import jacobian, null_space, planar, two_link_ik

    def paths(lengths: Floats, target: np.ndarray) -> int:
        """Return different postures of the closed form whose tip is at the target."""
        q = two_link_ik(lengths, target).q
        other = [bool(np.linalg.norm(planar_tip(lengths, q[:, k]) - target) < 1e-9) for k in (0, 1)]
        # Two branches that coincide count once.
        differ = np.abs(np.exp(1j * q[:, 0]) - np.exp(1j * q[:, 1])).max() > 1e-6
        return other.count(True) if differ else int(other[0])

    def free(links: int) -> float:
        """Return the dimension of the answers around a random posture that places the tip."""
        arm, q = planar(result.rng.uniform(0.3, 1, links)), result.rng.uniform(-3, 3, links)
        # The trace of a projector is the dimension of its space.
        return float(np.trace(null_space(jacobian(arm, q)[:2])))

    def heading_ways(lengths: np.ndarray, q: np.ndarray) -> int:
        """Return three links with a heading: two links to the wrist."""
        heading = np.array([np.cos(q.sum()), np.sin(q.sum())])
        return paths(lengths[:2], planar_tip(lengths, q) - lengths[2] * heading)

    arms = _lengths(result.rng, 40)
    inner, edge, outer = (
        [paths(a, _ring(result.rng, a, 1, *band)[:, 0]) for a in arms]
        for band in ((0.02, 0.98), (1, 1), (1.01, 2))
    )
    thirds = result.rng.uniform(0.2, 1.0, (40, 3))
    headed = [heading_ways(a, result.rng.uniform(-3, 3, 3)) for a in thirds]
    for name, ways_of in (("inside", inner), ("edge", edge), ("beyond", outer)):
        result.measure(name, np.median(ways_of))
    result.measure("heading", max(headed))
    result.measure("free_3_links", round(free(3), 9))
    result.statement = (
        "40 random arms each, answers put through the product of transforms; the number for 6-R "
        "is the source's."
    )
    folded = planar_tip((1.0, 1.0), np.array([result.rng.uniform(-3, 3, 9), np.full(9, np.pi)]))
    from course.rigid_body import quaternion

    def wrist(a: float, bend: float, b: float) -> np.ndarray:
        """Return the orientation that a wrist with the axes z, y, z gives the hand."""
        halves = 0.5 * np.array([a, bend, b])
        za, y, zb = (
            np.array([np.cos(x), *(np.sin(x) * np.eye(3)[axis])])
            for x, axis in zip(halves, (2, 1, 2), strict=True)
        )
        return quaternion.to_matrix(quaternion.product(quaternion.product(za, y), zb))

    def turned(bend: float) -> float:
        """Return how far the hand turns if the outer two joints turn against each other."""
        a, b, x = result.rng.uniform(-1, 1, 3)
        return float(np.abs(wrist(a + x, bend, b - x) - wrist(a, bend, b)).max())

    result.statement_holds(all(count != 2 for count in inner))
    result.correction_holds(
        all(turned(0.0) < 1e-12 for _ in range(8)),
        all(turned(0.5) > 1e-3 for _ in range(8)),
        np.abs(folded).max() < 1e-12,
        set(inner) == {2},
        set(edge) == {1},
        set(outer) == {0},
        max(headed) == 2,
        all(abs(free(links) - (links - 2)) < 1e-9 for links in (2, 3, 4, 7)),
    )


@claim(
    "A planner gives points of the tip, and IK turns them and the straight lines between them into "
    "joint angles.",
    "Reachable points are not enough. Neighbouring points may get solutions on different "
    "branches. Of the straight lines between points that links of {l1_m} m "
    "and {l2_m} m reach (at uniformly distributed distances from the base), {hole_percent:.0f} % "
    "cross the hole around the base, and of the others one in ten asks for {rate:.0f} rad per "
    "metre or more somewhere. A straight line in joint space stays reachable as long as the "
    "joints can turn. So planners for arms plan there.",
)
def tip_plans_need_joints(result):
    from course.kinematics import singular_values, two_link_ik

    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    t = np.linspace(0, 1, 201)
    a, b = (_ring(result.rng, lengths, 1000)[:, :, None] for _ in (0, 1))
    lines = a * (1 - t) + b * t
    answer = two_link_ik(lengths, lines.reshape(2, -1))
    reached = answer.reached.reshape(lines.shape[1:]).all(axis=1)
    # A line leaves the annulus only through the hole.
    stays = np.hypot(*lines).min(axis=1) > lengths[0] - lengths[1]
    with np.errstate(divide="ignore"):
        # Joint speed for a unit speed of the tip in the worst direction.
        rates = 1 / singular_values(planar_jacobian(lengths, answer.q[:, 0]))[-1]
    worst = rates.reshape(lines.shape[1:]).max(axis=1)[stays]
    result.measure("hole_percent", 100 * (1 - stays.mean()), 1e-3)
    result.measure("rate", np.percentile(worst, 90), 1e-3)
    turned = np.hypot(*planar_tip(lengths, result.rng.uniform(-np.pi, np.pi, (2, 4000))))
    result.statement = (
        "1000 lines between points of the annulus at uniform distances, 201 points on each."
    )

    def follows(arm: Floats, a: np.ndarray, b: np.ndarray, most: float = np.pi) -> bool:
        """Return whether one branch follows a line without a jump, the elbow within its stop."""
        t = np.linspace(0.0, 1.0, 4000)
        answer = two_link_ik(arm, a[:, None] * (1 - t) + b[:, None] * t)
        steps = (np.diff(answer.q[:, 0]) + np.pi) % (2.0 * np.pi) - np.pi
        within = np.abs(answer.q[1, 0]).max() <= most
        return bool(answer.reached.all() and np.abs(steps).max() < 0.5 and within)

    def past_base(arm: Floats, distance: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends of a line that passes the base at this distance."""
        angle = result.rng.uniform(-np.pi, np.pi)
        along, across = np.array([np.cos(angle), np.sin(angle)]), [-np.sin(angle), np.cos(angle)]
        middle, half = distance * np.array(across), 0.6 * sum(arm) * along
        return middle - half, middle + half

    # Chosen to break it: lines that nearly touch the hole, arms with the longer link second, and
    # equal links, whose annulus has no hole, close to the base.
    others = _lengths(result.rng, 6)
    near = [follows(x, *past_base(x, abs(x[0] - x[1]) + 0.01 * sum(x))) for x in others]
    near += [follows(x, *past_base(x, 0.02)) for x in np.ones((4, 2)) * others[:4, :1]]
    # Outside: through the base q1 jumps by half a turn. And an elbow that stops at 1.5 rad.
    through = [follows(x, *past_base(x, 0.0)) for x in np.ones((4, 2)) * others[:4, :1]]
    stopped = [follows(x, *past_base(x, 0.2), 1.5) for x in np.ones((4, 2)) * others[:4, :1]]
    result.statement_holds(
        reached.all(),
        only_if="these lines stay in the annulus and do not pass through the base, IK stays on one "
        "branch, and no joint reaches a stop",
        inside=[*reached[stays], *near],
        outside=[*reached[~stays], *through, *stopped],
    )
    result.correction_holds(
        0.05 < 1 - stays.mean() < 0.5,
        not any(through),
        not any(stopped),
        np.percentile(worst, 90) > 4,
        (turned > lengths[0] - lengths[1] - 1e-9).all(),
        (turned < sum(lengths) + 1e-9).all(),
    )
