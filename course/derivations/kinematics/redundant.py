"""Claims on arms with a joint to spare, their null space, and learned answers."""

from typing import Any

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.kinematics import damped_inverse, panda_postures, planar_tip

SYMBOLS = {
    "a": Symbol("length of (dJ/dt) dq/dt at a rate of 1 in the null space [m/s^2]"),
    "h": Symbol("length of the joint step"),
    "lambda": Symbol("damping [m/rad]"),
    "n": Symbol("joints", 1, 30),
    "r": Symbol("rank of J", 1, 30),
}


def _null_vectors(J: np.ndarray) -> np.ndarray:
    """Return a unit vector of the null space of each J, (n, N)."""
    return np.linalg.svd(np.moveaxis(J, 2, 0))[2][:, -1].T


@claim(
    "A 7-R arm has exactly one independent joint motion that leaves its hand at rest.",
    "Where J has full rank there is exactly one, since 7 - 6 = 1. With q2 = q5 = 0 and q3 a right "
    "angle the rank is 5: two independent motions leave the hand at rest, and one motion of the "
    "hand is lost.",
)
def one_joint_to_spare(result):
    from course.kinematics import jacobian, null_space

    arm, q = panda_postures(result.rng, 60)
    lost = q.copy()
    lost[[1, 4]], lost[2] = 0, np.pi / 2

    def spare(postures: np.ndarray) -> np.ndarray:
        N = null_space(jacobian(arm, postures))
        return np.round(np.trace(N), 6)

    result.measure("spare_usual", np.median(spare(q)))
    result.measure("spare_singular", np.median(spare(lost)))
    result.statement = "Trace of the projector at 60 random postures, and at 60 singular ones."
    # Chosen to break it: a thousandth of a radian and less away from these singular postures.
    close = lost + result.rng.uniform(1e-5, 1e-3, (1, 60)) * np.eye(7)[:, [1]]
    result.statement_holds(
        (spare(lost) == 1).all(),
        only_if="J has full rank in this posture",
        inside=[*(spare(q) == 1), *(spare(close) == 1)],
        outside=spare(lost) == 1,
    )
    result.correction_holds((spare(lost) == 2).all(), (spare(q) == 1).all())


@claim(
    "A motion in the null space of J leaves the tip where it is.",
    "Only to first order. A step of length h along a unit vector v of the null space moves the "
    "tip by about c h^2. Here c is half the length of (dJ/dt) v, for joints that move at the rate "
    "v. For the 7-R arm c is {c_m:.3f} m in the median, or {drift_mm:.2f} mm in a step of "
    "{step_rad} rad. After one IK step an error of order h^{order_after:.0f} remains, "
    "{left_um:.3f} um.",
    ask=(
        "Along the null space, at a rate of 1, dJ/dt times the rate has the length a. How far does "
        "one joint step of length h move the tip, to leading order?",
        "d, c = a*h^2/2",
        {
            "a*h^2": "Half of it: the second derivative over two.",
            "a*h": "J v = 0 takes the first order away; the next one goes with h^2.",
            "a*h^2/4": "Half, not a quarter.",
            "0": "Only the rate of the tip vanishes, not its step.",
        },
    ),
)
def null_motion_leaves_the_tip(result):
    import sympy

    from course.kinematics import jacobian, jacobian_rate, pose_error, singular_values, tip

    arm, q = panda_postures(result.rng, 200)
    q = q[:, singular_values(jacobian(arm, q))[-1] > 0.05]  # one vector spans the null space there
    v, home = _null_vectors(jacobian(arm, q)), tip(arm, q)

    def sizes(h: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the tip's error [m] after a step, and after another IK step."""
        moved = q + h * v
        inverse = np.linalg.pinv(np.moveaxis(jacobian(arm, moved), 2, 0))
        mended = moved + np.einsum("kij,jk->ik", inverse, pose_error(home, tip(arm, moved)))
        return tuple(np.linalg.norm((home - tip(arm, x))[:3], axis=0) for x in (moved, mended))

    acceleration = np.einsum("ijk,jk->ik", jacobian_rate(arm, q, v), v)[:3]
    c = np.linalg.norm(acceleration, axis=0) / 2
    a, h, t = sympy.symbols("a h t", positive=True)
    result.formula = sympy.integrate(sympy.integrate(a, (t, 0, t)), (t, 0, h))
    steps = np.array([0.2, 0.1, 0.05])
    drift, remaining = np.median([sizes(x) for x in steps], axis=2).T
    orders = [np.polyfit(np.log(steps), np.log(x), 1)[0] for x in (drift, remaining)]
    step = result.input("step_rad", 0.1)
    result.measure("c_m", np.median(c), 1e-3)
    result.measure("drift_mm", 1000 * np.median(sizes(step)[0]), 1e-3)
    result.measure("left_um", 1e6 * np.median(sizes(step)[1]), 1e-2)
    result.measure("order_before", orders[0], 1e-2)
    result.measure("order_after", orders[1], 1e-2)
    result.statement = f"{q.shape[1]} random postures with no singular value below 0.05."
    result.statement_holds(drift.max() < 1e-9)
    result.correction_holds(
        np.allclose(sizes(1e-3)[0], c * 1e-6, rtol=0.05, atol=1e-9),
        abs(orders[0] - 2) < 0.05,
        abs(orders[1] - 4) < 0.2,
    )


@claim(
    "The projector onto the null space is N = I - J^+ J.",
    "Then J N = 0, N is symmetric, and N N = N. With a damped inverse N is no projector: up to "
    "{formula} of a joint rate of 1 leaks into the tip, where s = lambda. That is {leak_mm:.0f} "
    "mm/rad with a damping of {damping} m/rad.",
    ask=(
        "N = I - J^T (J J^T + lambda^2 I)^-1 J leaks s lambda^2 / (s^2 + lambda^2) of a rate along "
        "the direction of s into the tip. At most?",
        "leak = lambda/2",
        {
            "1/(2*lambda)": "That is the largest gain of the damped inverse.",
            "lambda": "Set the derivative by s to 0: s = lambda.",
            "lambda^2": "Check the units: the leak is a length over an angle, as s and lambda.",
        },
    ),
)
def projector_of_the_null_space(result):
    import sympy

    from course.kinematics import jacobian, null_space

    s, lam = sympy.symbols("s lambda", positive=True)
    leak = s * lam**2 / (s**2 + lam**2)
    (worst,) = sympy.solve(sympy.diff(leak, s), s)
    result.formula = leak.subs(s, worst)
    arm, q = panda_postures(result.rng, 500)
    rows = jacobian(arm, q)[:3]  # of the position alone: one unit
    J, N = (np.moveaxis(x, 2, 0) for x in (rows, null_space(rows)))

    def leaks(value: float) -> np.ndarray:
        """Return the largest speed of the tip over the length of a joint rate, by posture."""
        damped = np.eye(7) - damped_inverse(rows, value) @ J
        return np.linalg.norm(J @ damped, 2, axis=(1, 2))

    value = result.input("damping", 0.1)
    result.measure("leak_mm", 1000 * float(result.formula.subs(lam, value)))
    result.measure("seen_mm", 1000 * leaks(value).max(), 1e-3)
    exact = np.abs(J @ N).max(axis=(1, 2)) < 1e-12
    # Chosen to break it: all six rows, of an arm that is stretched more and more, so that rows
    # depend on each other. Singular values below 1e-10 of the largest count as zero.
    six = jacobian(arm, q[:, :20] * 10.0 ** -np.arange(20.0))
    rows_of, across = (np.moveaxis(x, 2, 0) for x in (six, null_space(six)))
    stretched = np.abs(rows_of @ across).max(axis=(1, 2)) < 1e-9
    result.statement = "500 random postures of the 7-R arm, the three rows of position."
    result.statement_holds(
        (leaks(value) < 1e-9).all(),
        only_if="the pseudo-inverse is exact, not damped",
        inside=np.append(exact[:40], stretched),
        outside=leaks(value)[:40] < 1e-9,
    )
    result.correction_holds(
        exact.all(),
        np.abs(N - N.transpose(0, 2, 1)).max() < 1e-12,
        np.abs(N @ N - N).max() < 1e-12,
        all((leaks(x) <= x / 2 + 1e-12).all() for x in (0.01, 0.1, 1.0)),
        leaks(value).max() > 0.45 * value,
    )


@claim(
    "dq = J^+ dx + N dq2 does a second task without disturbing the first.",
    "To first order the tip does not notice; after a step of {step_rad} rad it is "
    "{disturbed_mm:.1f} mm off in the median. And the second task is only done in part: of a "
    "random dq2 the fraction {formula} of the squared length survives, {kept_percent:.0f} % for "
    "the 7-R arm.",
    ask=(
        "n joints, J of rank r, dq2 in a random direction. Which fraction of |dq2|^2 survives "
        "the projection, on average?",
        "share = (n - r)/n",
        {
            "r/n": "That is the share that would move the tip.",
            "1/n": "Only where r = n - 1; in general n - r directions survive.",
            "(n - r)/r": "dq2 has n components, of which n - r survive.",
        },
    ),
    source="Liegeois (1977); Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), sec. 3.5",
)
def second_task(result):
    import sympy

    from course.kinematics import jacobian, null_space, tip

    arm, q = panda_postures(result.rng, 3000)
    J, wish = jacobian(arm, q), result.rng.normal(size=q.shape)
    wish /= np.linalg.norm(wish, axis=0)

    def selected(rows: int) -> float:
        N = null_space(J[:rows])
        return float(np.mean(np.sum(np.einsum("ijk,jk->ik", N, wish) ** 2, axis=0)))

    # E |N z|^2 = trace(N) / n for a unit z in a random direction, and trace(N) = n - rank.
    n, r = sympy.symbols("n r", positive=True)
    result.formula = (n - r) / n
    law = sympy.lambdify((n, r), result.formula)
    step = result.input("step_rad", 0.2)
    second = np.einsum("ijk,jk->ik", null_space(J), wish)
    first = np.linalg.norm(np.einsum("ijk,jk->ik", J, second), axis=0)
    second *= step / np.linalg.norm(second, axis=0)
    missing = np.linalg.norm((tip(arm, q + second) - tip(arm, q))[:3], axis=0)
    result.measure("disturbed_mm", 1000 * np.median(missing), 0.01)
    result.measure("kept_percent", 100 * selected(6), 0.05)
    result.statement = "3000 random postures with a random dq2 each; ranks 3 and 6."
    result.statement_holds(missing.max() < 1e-9)
    result.correction_holds(
        first.max() < 1e-9,
        np.median(missing) > 1e-4,
        all(abs(selected(rows) - law(7, rows)) < 0.01 for rows in (3, 6)),
    )


@claim(
    "IKFlow samples all valid solutions of a target.",
    "It samples many postures that are near one: within {mm:g} mm and {deg:g} degrees, as its "
    "authors write, who refine what must be exact. Nor are all of them valid: a flow bends one "
    "connected cloud of noise continuously, and where solutions come in separate pieces some "
    "samples lie between. Every path from one solution of links of {l1_m} m and {l2_m} m to the "
    "other leaves a target at {r_m} m by {strays_m:.1f} m or more: min(l1 + l2 - r, r - |l1 - "
    "l2|).",
    source="Ames, Morgan and Konidaris, IKFlow, IEEE Robotics and Automation Letters 7 (2022)",
)
def flow_samples_all(result):
    from course.kinematics import two_link_ik

    lengths = result.input("l1_m", 1.0), result.input("l2_m", 0.8)
    mm, deg = result.input("mm", 10), result.input("deg", 2)
    t = np.linspace(0, 1, 401)

    def strays(arm: Any, r: float, wiggle: np.ndarray, turn: int) -> float:
        """Return farthest from the target on a continuous way between both answers [m]."""
        target = np.array([r, 0.0])
        ends = two_link_ik(arm, target).q
        path = ends[:, :1] * (1 - t) + (ends[:, 1:] + 2 * np.pi * turn * np.array([[0], [1]])) * t
        path = path + wiggle * np.sin(np.pi * np.arange(1, 4)[:, None] * t).sum(axis=0)[None]
        return float(np.hypot(*(planar_tip(arm, path) - target[:, None])).max())

    def least(arm: Any, r: float) -> float:
        return min(sum(arm) - r, r - abs(arm[0] - arm[1]))

    r = result.input("r_m", 1.2)
    arms = result.rng.uniform(0.3, 1.5, (100, 2))
    reach = abs(arms[:, 0] - arms[:, 1]) + 2 * arms.min(axis=1) * result.rng.uniform(
        0.05, 0.95, 100
    )
    ratios = [
        strays(arm, x, result.rng.normal(0, 1, (2, 1)), k % 2) / least(arm, x)
        for k, (arm, x) in enumerate(zip(arms, reach, strict=True))
    ]
    best = min(strays(lengths, r, np.zeros((2, 1)), k) for k in (0, 1))
    result.measure("strays_m", best, 1e-3)
    result.measure("least_ratio", min(ratios), 0.01)
    result.statement = (
        f"{len(ratios)} ways between the branches of random arms, elbow through 0 or pi; none "
        f"strays less than the bound. Accuracy ({mm} mm, {deg} degrees) is the paper's abstract."
    )
    result.statement_holds(min(ratios) < 1e-6)
    result.correction_holds(min(ratios) >= 0.999, best >= least(lengths, r) - 1e-3, best < 1.5)


@claim(
    "Where joint velocities exceed their limits, clip each one: the hand follows as well as with a "
    "quadratic program.",
    "Both agree only while no limit is reached. On {paths:g} paths that the 7-R arm can follow "
    "within its limits, with a cycle of {cycle_ms:g} ms, the largest error of the hand is "
    "{clipped_mm:.0f} mm in the median with clipped velocities of the damped pseudo-inverse and "
    "{program_mm:.0f} mm with the quadratic program, in which the other joints make up for one at "
    "its limit. The program sees one cycle only: on a quarter of the paths it is more than "
    "{quarter_mm:.0f} mm off. Shortening all velocities by one factor keeps the direction of the "
    "hand, but a single joint that would have to pass its position limit stops the whole arm: "
    "{scaled_mm:.0f} mm.",
)
def clipped_velocities(result):
    from course.charts.kinematics import differential
    from course.kinematics import panda

    arm, paths = panda(), int(result.input("paths", 100))
    dt = 1e-3 * result.input("cycle_ms", 50)
    followers = differential.methods(arm, dt, libraries=False)
    motions = [differential.reference(arm, result.rng, dt) for _ in range(paths)]
    worst = {
        name: np.array(
            [differential.follow(arm, velocity, motion, dt).error.max() for motion in motions]
        )
        for name, velocity in followers.items()
    }
    clipped, program = worst["clipped"], worst["quadratic program"]
    # Where clipping changes nothing, no bound was met on the whole path.
    within = np.abs(clipped - worst["no limits"]) < 1e-12
    result.measure("clipped_mm", 1000 * np.median(clipped), 0.1)
    result.measure("program_mm", 1000 * np.median(program), 0.1)
    result.measure("quarter_mm", 1000 * np.percentile(program, 75), 0.1)
    result.measure("scaled_mm", 1000 * np.median(worst["scaled"]), 0.1)
    result.measure("better_percent", 100 * np.mean(program < 0.99 * clipped), 0.05)
    result.measure("worse_percent", 100 * np.mean(program > 1.01 * clipped), 0.5)
    result.statement = f"{paths} paths; on {within.sum()} of them no bound is met."
    result.statement_holds(np.median(clipped) < 1.1 * np.median(program))
    result.correction_holds(
        np.median(clipped) > 3.0 * np.median(program),
        np.median(worst["scaled"]) > np.median(clipped),
        np.mean(program < 0.99 * clipped) > 0.6,
        within.any(),
        np.allclose(clipped[within], program[within], rtol=1e-6),
    )


@claim(
    "A 7-joint arm has infinitely many postures for one pose, so its inverse kinematics has no "
    "closed form.",
    "It has, once one joint is chosen, for an arm whose first three axes meet in a shoulder and "
    "whose axes 5 and 6 meet in a wrist, such as the Panda. For each angle of the last joint there "
    "are {most:.0f} postures at most, and {mean_within:.1f} of them respect the joint limits, on "
    "average over random poses at the angle of the posture that they came from. The worst error "
    "of the tip is below {bound:.0e} m or rad. A branch ends where the other six joints become "
    "singular: next to its end their smallest singular value shrinks with the square root of the "
    "distance, with the exponent {order:.2f}.",
    source="He and Liu, Analytical inverse kinematics for Franka Emika Panda (2021)",
)
def seven_joints_have_no_closed_form(result):
    from course.kinematics import jacobian, pose_error, singular_values, tip
    from course.kinematics.seven_joint import BRANCHES, closed_form, postures_within_limits

    arm, q = panda_postures(result.rng, 300)
    goal = tip(arm, q)
    solved = closed_form(arm, goal, q[6])
    solved_at = np.isfinite(solved[0])
    wide = np.broadcast_to(goal[:, None], (7, BRANCHES, 300))
    error = np.abs(pose_error(wide[:, solved_at], tip(arm, solved[:, solved_at]))).max()
    within = [postures_within_limits(arm, goal[:, k], q[6, k]) for k in range(300)]
    back = [np.abs(x - q[:, k, None]).max(axis=0).min() for k, x in enumerate(within)]

    def ends(pose: np.ndarray) -> list[float]:
        """Return the exponents at which the singular value vanishes at the ends of branches."""
        grid, exponents = np.linspace(-np.pi, np.pi, 200), []
        shown = np.isfinite(closed_form(arm, pose, grid)[0])
        for branch in range(BRANCHES):
            for k in np.flatnonzero(shown[branch, :-1] != shown[branch, 1:])[:1]:
                inside, outside = grid[[k, k + 1]] if shown[branch, k] else grid[[k + 1, k]]
                for _ in range(50):
                    middle = 0.5 * (inside + outside)
                    good = np.isfinite(closed_form(arm, pose, middle)[0, branch])
                    inside, outside = (middle, outside) if good else (inside, middle)
                inwards = np.sign(inside - outside)
                near = [
                    closed_form(arm, pose, inside + inwards * d)[:, branch] for d in (1e-8, 1e-6)
                ]
                s = [singular_values(jacobian(arm, x)[:, :6])[-1] for x in near]
                exponents.append(float(np.log(s[1] / s[0]) / np.log(100.0)))
        return exponents

    orders = [x for k in range(20) for x in ends(goal[:, k])]
    result.measure("most", solved_at.sum(axis=0).max())
    result.measure("mean_within", np.mean([x.shape[1] for x in within]), 0.05)
    result.measure("bound", 10.0 ** np.ceil(np.log10(error) + 1.0))
    result.measure("order", np.median(orders), 0.01)
    result.statement = (
        f"300 random postures of the 7-R arm within its limits, and {len(orders)} ends of branches."
    )
    result.statement_holds(not solved_at.any())
    result.correction_holds(
        error < 1e-12,
        max(back) < 1e-6,
        set(solved_at.sum(axis=0)) <= {4, 8},
        np.allclose(orders, 0.5, atol=0.05),
    )
