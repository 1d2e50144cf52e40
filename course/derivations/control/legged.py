"""Claims of chapter 6 on legged robots: where to step, momentum, friction pyramids, touch."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "x": Symbol("position of the centre of mass [m]"),
    "v": Symbol("its velocity [m/s]"),
    "w": Symbol("rate of the pendulum, sqrt(g/z) [1/s]"),
    "T": Symbol("shortest time of a step [s]"),
    "l": Symbol("longest step [m]"),
    "n": Symbol("sides of the pyramid", 4.0, 32.0),
}
GRAVITY = 9.81  # m/s^2


def _pendulum(x, v, foot, rate, seconds, swing=0.0):
    """Return position and velocity of the linear inverted pendulum, by Runge-Kutta steps.

    The swing is the acceleration [m/s^2] from a change of the angular momentum about the centre of
    mass: its rate over the mass and the height.
    """
    from course.rigid_body.integrators import rk4

    n = max(1, int(np.ceil(seconds * rate * 200)))
    q, u = np.array([float(x)]), np.array([float(v)])
    for _ in range(n):
        q, u = rk4(q, u, lambda p, *_: rate**2 * (p - foot) + swing, seconds / n, None)
    return float(q[0]), float(u[0])


@claim(
    "A step to the capture point brings a walking robot to rest.",
    "With the foot at {formula} the centre of mass comes to rest above it, and the remaining "
    "distance falls with the rate w. That holds for a constant height, a constant angular momentum "
    "about the centre of mass, and a foot that is there at once and does not slip: swinging arms "
    "move the capture point. A foot that is {off:.0%} of the step short sends the robot away at "
    "the rate w: measured {growth:.3f} w. A step that takes {late:.1f}/w must aim farther, since "
    "the distance from the old foot to the capture point grows by a factor of {factor:.2f} "
    "meanwhile.",
    ask=(
        "The linear inverted pendulum x'' = w^2 (x - p) moves with v at x. Where must the foot p "
        "be placed so that it comes to rest?",
        "p = x + v/w",
        {
            "x + v*w": "A speed times a rate is an acceleration.",
            "x + v/w^2": "That has the unit m s.",
            "x - v/w": "That is behind the body: the foot would push it on.",
        },
    ),
    source="J. Pratt and others, Capture point: a step toward humanoid push recovery, 2006",
)
def capture_point_stops(result):
    import sympy

    x, v, w, p, t = sympy.symbols("x v w p t", positive=True)
    motion = sympy.Function("s")
    solved = sympy.dsolve(
        motion(t).diff(t, 2) - w**2 * (motion(t) - p),
        motion(t),
        ics={motion(0): x, motion(t).diff(t).subs(t, 0): v},
    ).rhs
    # The growing part has to vanish.
    result.formula = sympy.solve(sympy.expand(solved).coeff(sympy.exp(t * w)), p)[0]
    short, late = result.input("off", 0.01), result.input("late", 0.5)

    def stops(height, x, v, error=0.0, wait=0.0, aim=False, swing=0.0, slippery=np.inf):
        """Return whether the pendulum is at rest above its foot six time constants later.

        Arms may swing, with the angular momentum the same before and after; the friction may be
        this share of the friction that the foot needs.
        """
        rate = np.sqrt(GRAVITY / height)
        foot = x + v / rate
        if aim:
            foot *= np.exp(rate * wait)  # the old foot is at 0
        x, v = _pendulum(x, v, 0.0, rate, wait) if wait else (x, v)
        foot += error * v / rate
        if slippery < 1.0:
            # The foot needs the friction |x - foot| / height. With less it slides along, so that
            # the friction brakes the body, and stops ahead of it when the body stands.
            mu = slippery * abs(x - foot) / height
            x, v, foot = x + v * abs(v) / (2.0 * mu * GRAVITY), 0.0, np.sign(v) * mu * height
            foot += x
        for seconds, turning in ((0.2, swing), (0.2, -swing), (5.6, 0.0)):
            x, v = _pendulum(x, v, foot, rate, seconds / rate, turning * rate**2)
        return abs(v) < 0.02 and abs(x - foot) < 0.02

    def drawn(**changed):
        a, b, c = result.rng.uniform(0.0, 1.0, 3)
        sign = 1.0 if a > 0.5 else -1.0
        return stops(0.3 + 1.2 * b, 0.1 * a, sign * (0.4 + 1.6 * c), **changed)

    rate = np.sqrt(GRAVITY / 1.0)
    gaps = []
    for seconds in (3.0, 5.0):
        x_, v_ = _pendulum(0.0, 1.0, (1.0 - short) / rate, rate, seconds / rate)
        gaps.append(abs(x_ + v_ / rate - (1.0 - short) / rate))
    growth = result.measure("growth", np.log(gaps[1] / gaps[0]) / 2.0, 1e-4)
    x_, v_ = _pendulum(0.0, 1.0, 0.0, rate, late / rate)
    factor = result.measure("factor", (x_ + v_ / rate) * rate, 1e-4)
    result.statement = "Runge-Kutta steps of the pendulum at heights of 0.3 to 1.5 m."
    late_steps = [drawn(wait=0.1) for _ in range(8)]
    exact = [drawn() for _ in range(16)]
    missed = [drawn(error=e) for e in (-0.1, -0.03, 0.03, 0.1)]
    missed += [drawn(wait=s) for s in (0.02, 0.05, 0.1, 0.2)]
    aimed = [drawn(wait=s, aim=True) for s in result.rng.uniform(0.02, 0.2, 8)]
    # Chosen to break it: bodies far from the old foot, before and behind it; arms that swing and
    # come to rest again; floors with too little friction for this step.
    far = [stops(0.9, x, v) for x, v in ((-3.0, 0.2), (3.0, 0.2), (-2.0, -2.0), (0.0, 6.0))]
    disturbed = [drawn(swing=x) for x in (-0.2, -0.05, 0.05, 0.2)]
    disturbed += [drawn(slippery=x) for x in (0.5, 0.8, 0.95)]
    result.statement_holds(
        all(late_steps),
        only_if="the height and the angular momentum about the centre of mass stay constant, and "
        "the foot is at the point at once and exactly and does not slip",
        inside=[*exact, *far],
        outside=[*missed, *disturbed],
    )
    result.correction_holds(
        abs(growth - 1.0) < 1e-3,
        abs(factor - np.exp(late)) < 1e-3,
        all(aimed),
        not any(disturbed),
    )


@claim(
    "A robot that may take enough steps can stop after any push.",
    "Each step takes at least a time T and reaches at most a distance l. While the foot is down, "
    "the distance to the capture point grows by exp(w T), and a step takes away l at most. "
    "Infinitely many steps stop it only if the capture point is within {formula} of the foot. For "
    "{l:g} m, {T:g} s and a rate of {w:g} per second that is {limit:.3f} m. One step covers "
    "{one:.0%} of it, three cover {three:.0%}. Sideways, where a leg cannot pass the other one, "
    "only every second step takes anything away, and the limit is {side:.0%} of it.",
    ask=(
        "A point-footed linear inverted pendulum of rate w takes steps of at most l, each after a "
        "time T. Up to which distance between foot and capture point can it ever stop?",
        "d < l/(exp(w*T) - 1)",
        {
            "l": "The distance grows while the foot is on the ground.",
            "l*exp(-w*T)": "That is what one step can stop.",
            "l/exp(w*T - 1)": "The 1 is subtracted from the exponential function.",
            "l/(w*T)": "That is without the growth of higher orders.",
        },
    ),
    source="T. Koolen and others, Capturability-based analysis and control of legged locomotion, "
    "2012",
)
def enough_steps_stop(result):
    import sympy
    from scipy.optimize import linprog

    w, T, length, d = sympy.symbols("w T l d", positive=True)
    # The distance that repeats itself: it grows, and a longest step takes it back.
    result.formula = sympy.solve(sympy.Eq(d * sympy.exp(w * T) - length, d), d)[0]
    rate, step, reach = result.input("w", 3.0), result.input("T", 0.4), result.input("l", 0.5)

    def farthest(n, rate=rate, step=step, reach=reach):
        """Return the largest distance that n footholds can stop: a linear program over them."""
        grow = np.exp(rate * step)
        # Unknowns: the distance d, then the footholds p1 to pn; the first foot is at 0. The capture
        # point after k steps is linear in them, and the last foothold has to be on it.
        point = np.zeros(n + 1)
        point[0] = 1.0
        rows, foot = [], np.zeros(n + 1)
        for k in range(n):
            point = foot + grow * (point - foot)
            further = np.eye(n + 1)[k + 1]
            rows += [further - foot, foot - further]
            foot = further
        solved = linprog(
            -np.eye(n + 1)[0],
            A_ub=np.array(rows),
            b_ub=np.full(2 * n, reach),
            A_eq=[point - foot],
            b_eq=[0.0],
            bounds=[(None, None)] * (n + 1),
        )
        return float(-solved.fun)

    def bound(rate=rate, step=step, reach=reach):
        return float(result.formula.subs({w: rate, T: step, length: reach}))

    def stopped(share, rate, step, reach, sideways=False):
        """Return whether longest steps towards the capture point reach it within 60.

        Sideways, every second step only closes the legs.
        """
        foot, point = 0.0, share * bound(rate, step, reach)
        for k in range(60):
            point = foot + np.exp(rate * step) * (point - foot)
            if not (sideways and k % 2):
                foot += np.clip(point - foot, -reach, reach)
            if abs(point - foot) < 1e-9:
                return True
        return False

    def rests(share, rate, step, reach):
        """Return whether such steps in the plane bring a body to rest that starts anywhere."""
        bearing, grow = result.rng.uniform(0.0, 2.0 * np.pi), np.exp(rate * step)
        foot = np.zeros(2)
        x = result.rng.uniform(-3.0, 3.0, 2) * reach
        point = share * bound(rate, step, reach) * np.array([np.cos(bearing), np.sin(bearing)])
        for _ in range(60):
            # The centre of mass has a growing part, the capture point, and one that decays.
            decaying = (2.0 * x - point - foot) / grow
            point = foot + grow * (point - foot)
            x = 0.5 * (point + foot + decaying)
            gap = point - foot
            foot = foot + gap * min(1.0, reach / max(float(np.linalg.norm(gap)), 1e-12))
        speed = rate * (point - x)
        return float(np.linalg.norm(speed)) < 1e-6 and float(np.linalg.norm(x - foot)) < 1e-6

    limit = result.measure("limit", bound(), 1e-6)
    shares = [farthest(n) / limit for n in (1, 3, 12)]
    result.measure("one", shares[0], 1e-4)
    result.measure("three", shares[1], 1e-4)

    def drawn(low, high, test=stopped, **more):
        a, b, c, u = result.rng.uniform(0.0, 1.0, 4)
        return test(low + u * (high - low), 2.0 + 3.0 * a, 0.2 + 0.4 * b, 0.2 + 0.8 * c, **more)

    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        reached = stopped(middle, rate, step, reach, sideways=True)
        low, high = (middle, high) if reached else (low, middle)
    side = result.measure("side", low, 1e-4)

    series = [sum(np.exp(-rate * step * k) for k in range(1, n + 1)) * reach for n in (1, 3, 12)]
    result.statement = "Steps towards the capture point, and a linear program over all footholds."
    pushed = drawn(1.02, 1.5)
    near = [drawn(0.0, 0.98) for _ in range(16)]
    beyond = [drawn(1.02, 1.5) for _ in range(16)]
    # Chosen to break it: pushes in any direction of the plane, of a body anywhere around its foot;
    # and pushes sideways, where legs cannot cross.
    spread = [drawn(0.9, 0.98, rests) for _ in range(8)]
    crossed = [drawn(0.96, 0.98, sideways=True) for _ in range(8)]
    result.statement_holds(
        pushed,
        only_if="the capture point is within {formula} of the foot, {limit:.3f} m in the example, "
        "and every step can take l off this distance",
        inside=near + spread,
        outside=beyond + crossed,
    )
    result.correction_holds(
        bool(np.allclose(np.array(shares) * limit, series, rtol=1e-6)),
        shares[0] < shares[1] < shares[2] < 1.0,
        shares[2] > 0.99,
        # Two periods of growth for one step.
        abs(side - 1.0 / (1.0 + np.exp(-rate * step))) < 1e-4,
        not any(crossed),
    )


_WALKER = """
<mujoco><option timestep="0.001" tolerance="1e-14" iterations="500" ls_tolerance="1e-6"/>
<worldbody><geom type="plane" size="5 5 .1"/>
<body name="trunk" pos="0 0 .62"><freejoint/><geom type="box" size=".15 .1 .1" mass="10"/>
{legs}
</body></worldbody></mujoco>
"""
_LEG = """
<body pos="{x} {y} -.1"><joint type="hinge" axis="0 1 0" damping="0.3" stiffness="4"/>
<joint type="hinge" axis="1 0 0" damping="0.3"/>
<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass="{mass}"/>
<body pos="0 0 -.25"><joint type="hinge" axis="0 1 0" damping="0.3" limited="true" range="-5 5"/>
<geom type="capsule" fromto="0 0 0 0 0 -.25" size=".03" mass="{mass}"/></body></body>
"""


@claim(
    "The centroidal dynamics of a legged robot neglect the masses of its legs.",
    "They are exact: the momentum of the whole robot, legs included, changes with the contact "
    "forces and gravity alone, whatever the joints do. On a walker whose legs are {legs:.0%} of "
    "its mass both sides agreed to better than {bound:.0e} of the largest term. The approximation "
    "is a further one, a single rigid body of constant inertia: with legs that swing at random it "
    "missed {single:.0%} of the angular momentum (median).",
    source="D. Orin, A. Goswami, S.-H. Lee, Centroidal dynamics of a humanoid robot, 2013",
)
def centroidal_without_legs(result):
    import mujoco

    feet = [(x, y) for x in (-0.15, 0.15) for y in (-0.1, 0.1)]
    legs = "".join(_LEG.format(x=x, y=y, mass=0.8) for x, y in feet)
    model = mujoco.MjModel.from_xml_string(_WALKER.format(legs=legs))
    data, other = mujoco.MjData(model), mujoco.MjData(model)
    total = float(model.body_subtreemass[1])

    def momentum(q, v):
        """Return linear and angular momentum about the centre of mass, in world axes."""
        other.qpos[:], other.qvel[:] = q, v
        mujoco.mj_kinematics(model, other)
        mujoco.mj_comPos(model, other)
        mujoco.mj_comVel(model, other)
        mujoco.mj_subtreeVel(model, other)
        return np.append(total * other.subtree_linvel[1], other.subtree_angmom[1])

    def by_difference(step=1e-6):
        """Return the rate of the momentum along the motion, from its values on both sides."""
        ends = []
        for sign in (1.0, -1.0):
            q = data.qpos.copy()
            mujoco.mj_integratePos(model, q, data.qvel, sign * step)
            # The second-order change of the position has no effect on a central difference.
            ends.append(momentum(q, data.qvel + sign * step * data.qacc))
        return (ends[0] - ends[1]) / (2.0 * step)

    def by_contacts():
        """Return gravity and the contacts' forces and moments about the centre of mass."""
        rate = np.append(total * model.opt.gravity, np.zeros(3))
        sizes, wrench = [np.abs(rate).max()], np.zeros(6)
        for i, contact in enumerate(data.contact):
            if contact.geom[0] != 0:
                continue  # two parts of the robot: an internal force
            mujoco.mj_contactForce(model, data, i, wrench)
            # The force acts on the second geom; the floor is the first.
            force = contact.frame.reshape(3, 3).T @ wrench[:3]
            rate[:3] += force
            rate[3:] += np.cross(contact.pos - data.subtree_com[1], force)
            sizes.append(np.abs(force).max())
        return rate, max(sizes), len(sizes) - 1

    mujoco.mj_resetData(model, data)
    # The columns of the locked inertia: momenta of unit spins of the reset posture.
    inertia = np.array([momentum(model.qpos0, np.eye(model.nv)[3 + c])[3:] for c in range(3)]).T
    gaps, touches, single, pushed = [], [], [], []
    for k in range(600):
        # Random torques at all joints; at the start the robot also spins.
        if k % 150 == 0:
            mujoco.mj_resetData(model, data)
            data.qvel[:] = result.rng.normal(0.0, 1.0, model.nv)
        if k % 10 == 0:
            data.qfrc_applied[6:] = result.rng.normal(0.0, 6.0, model.nv - 6)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        if k % 5:
            continue
        contacts, size, count = by_contacts()
        gaps.append(np.abs(by_difference() - contacts).max() / size)
        touches.append(count)
        # One rigid body: the inertia of the start's posture, turned with the trunk.
        if k % 150 > 20:
            R, spin = data.xmat[1].reshape(3, 3), data.qvel[3:6]
            true = momentum(data.qpos, data.qvel)[3:]
            single.append(np.linalg.norm(R @ (inertia @ spin) - true) / np.linalg.norm(true))
    # A tether is no contact: its force must not be forgotten.
    push = 30.0  # N
    data.xfrc_applied[1, :3] = (push, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    contacts, size, _ = by_contacts()
    pushed.append(np.abs(by_difference() - contacts).max())
    result.measure("legs", 1.0 - float(model.body_mass[1]) / total, 1e-6)
    exact, bound = max(gaps), result.input("bound", 1e-7)
    middle = result.measure("single", np.median(single), 0.2)
    result.statement = (
        "A walker with four legs in MuJoCo under random torques: differences of its momentum along "
        "the motion against its contact forces."
    )
    result.statement_holds(exact > 1e-2)
    result.correction_holds(
        exact < bound,
        max(touches) >= 4,
        min(touches) == 0,
        middle > 0.05,
        abs(pushed[0] - push) < 0.01 * push,
    )


@claim(
    "Twice as many sides of a friction pyramid halve the friction that it loses.",
    "A pyramid with n sides and its edges on the cone loses {formula} of the friction in its "
    "worst direction: {four:.1%} with four sides, {eight:.1%} with eight, {sixteen:.1%} with "
    "sixteen, about a quarter each time. Of all the tangential forces that the cone admits, four "
    "sides exclude {area:.1%}. For a loss below {goal:.0%} it takes {sides:.0f} sides.",
    ask=(
        "A friction pyramid with n sides has its edges on the cone. Which share of the friction is "
        "lost in the worst direction?",
        "1 - cos(pi/n)",
        {
            "1 - cos(2*pi/n)": "Halfway between two edges the angle is pi/n.",
            "1/cos(pi/n) - 1": "That is how much a pyramid around the cone adds.",
            "1 - sin(pi/n)": "The middle of a side is the radius times the cosine.",
        },
    ),
)
def pyramid_halves_its_loss(result):
    import sympy
    from scipy.optimize import linprog
    from scipy.spatial import ConvexHull

    n = sympy.Symbol("n", positive=True)
    # An edge of length 1, and the direction halfway to the next one: the side's middle is as far
    # out as the edge reaches along that direction.
    edge, bisector = sympy.Matrix([1, 0]), sympy.Matrix([sympy.cos(sympy.pi / n), 0])
    bisector[1] = sympy.sin(sympy.pi / n)
    result.formula = 1 - edge.dot(bisector)

    def strongest(sides, angle, turned=0.0, normal=1.0, mu=0.6):
        """Return the largest friction along a direction, over mu N: a linear program."""
        edges = turned + 2.0 * np.pi * np.arange(sides) / sides
        fan = mu * np.array([np.cos(edges), np.sin(edges)])
        # Along the direction as far as possible, with no component across it.
        along = np.array([np.cos(angle), np.sin(angle)])
        across = np.array([-along[1], along[0]])
        solved = linprog(
            -along @ fan,
            A_eq=np.vstack((across @ fan, np.ones(sides))),
            b_eq=[0.0, normal],
        )
        return float(-solved.fun) / (mu * normal)

    def loss(sides):
        """Return what is lost in the worst of many directions, the pyramid turned at random."""
        turned = result.rng.uniform(0.0, np.pi)
        between = np.append(result.rng.uniform(0.0, 1.0, 20), 0.5) * 2.0 * np.pi / sides
        mu, normal = result.rng.uniform(0.2, 1.5), result.rng.uniform(0.1, 900.0)
        return 1.0 - min(strongest(sides, turned + a, turned, normal, mu) for a in between)

    names = {4: "four", 8: "eight", 16: "sixteen"}
    losses = {k: result.measure(name, loss(k), 1e-6) for k, name in names.items()}
    corners = np.pi / 2.0 * np.arange(4)
    hull = ConvexHull(np.array([np.cos(corners), np.sin(corners)]).T)
    area = result.measure("area", 1.0 - hull.volume / np.pi, 1e-9)
    goal = result.input("goal", 0.01)
    sides = result.measure("sides", next(k for k in range(3, 99) if loss(k) < goal))
    ratios = [losses[k] / losses[2 * k] for k in (4, 8)]
    theory = [float(result.formula.subs(n, k)) for k in names]
    result.statement = "Linear programs over the edges, pyramids turned at random."
    result.statement_holds(all(abs(r - 2.0) < 0.5 for r in ratios))
    result.correction_holds(
        bool(np.allclose(theory, list(losses.values()), atol=1e-9)),
        all(3.5 < r < 4.1 for r in ratios),
        abs(area - (1.0 - 2.0 / np.pi)) < 1e-9,
        loss(int(sides) - 1) >= goal,
    )


@claim(
    "A higher gain of the momentum observer notices a touch sooner.",
    "The residual follows the external torque with the time constant 1/K, and white torque noise "
    "passes with a standard deviation proportional to sqrt(K). The threshold stands at a fixed "
    "number of these standard deviations, so it rises with the gain. The delay is shortest with "
    "the threshold at {ideal:.1%} of the touch's torque, and half of that gain takes "
    "{ideal_half:.0%} longer. On the arm of the check, with samples of {dt_ms:g} ms, the best "
    "threshold is {share:.0%}, with a delay of {best_ms:.1f} ms for a touch of {touch:g} N m. "
    "There half of that gain takes {half:.0%} longer, {more:g} times that gain {double:.0%}, and "
    "at twice that gain the touch is never noticed without the help of noise. A touch that grows "
    "slowly is noticed later at a higher gain. So is every touch if the noise is that of the "
    "speed, which passes in proportion to K.",
    source="A. De Luca and others, Collision detection and safe reaction with the DLR-III, 2006",
)
def gain_notices_sooner(result):
    from itertools import pairwise

    from scipy.optimize import brentq, minimize_scalar
    from scipy.signal import lfilter

    from course.kinematics.dynamics import bias, forward_dynamics, mass_matrix
    from course.kinematics.two_link import TwoLink

    chain, n, begin = TwoLink().chain(), 3000, 1000
    dt = 1e-3 * result.input("dt_ms", 0.1)
    flat = (0.0, 0.0, 0.0)
    touch, k_sigma = result.input("touch", 0.2), result.input("sigmas", 5.0)
    noise = result.input("noise", 0.2)  # N m, of each sample of a torque

    # The truth: a moving arm that is touched at joint 2 from sample `begin` on.
    rng, q, v = result.rng, np.array([0.3, 0.8]), np.array([1.0, -2.0])
    motors = 0.3 * np.array([np.sin(0.01 * np.arange(n)), np.cos(0.013 * np.arange(n))])
    outside = np.zeros((2, n))
    outside[1, begin:] = touch
    states = []
    for tau in (motors + outside).T:
        middle_v = v + 0.5 * dt * forward_dynamics(chain, q, v, tau, gravity=flat)
        middle_q = q + 0.5 * dt * v
        states.append((q, v, middle_q, middle_v))
        q = q + dt * middle_v
        v = v + dt * forward_dynamics(chain, middle_q, middle_v, tau, gravity=flat)
    q0, v0, qm, vm = (np.array(column).T for column in zip(*states, strict=True))
    momentum = np.einsum("ijk,jk->ik", mass_matrix(chain, q0), v0)
    # What the momentum changes by without an external torque: M' v less the bias, mid-step.
    small = 1e-6
    turning = mass_matrix(chain, qm + small * vm) - mass_matrix(chain, qm - small * vm)
    model = np.einsum("ijk,jk->ik", turning, vm) / (2.0 * small)
    model = model - bias(chain, qm, vm, gravity=flat)

    def residuals(gains, error, shaken=0.0):
        """Return the residual of joint 2 for each gain over the samples, (n, gains).

        The errors are those of the torque and of the momentum.
        """
        r, total, rows = np.zeros(len(gains)), np.zeros(len(gains)), []
        known, measured = motors[1] + error + model[1], momentum[1] + shaken
        for k in range(n):
            r = gains * (measured[k] - momentum[1, 0] - total)
            rows.append(r)
            total = total + dt * (known[k] + r)
        return np.array(rows)

    # White noise of this density S has the variance K S / 2 behind a filter of gain K.
    density = noise**2 * dt
    # With the threshold at the share s of the touch the gain is proportional to s^2, and the delay
    # -ln(1 - s)/K is shortest where its derivative by s is zero.
    ideal = brentq(lambda s: s / (1.0 - s) + 2.0 * np.log1p(-s), 0.1, 0.99)
    result.measure("ideal", ideal, 1e-6)
    lower = np.log1p(-ideal / np.sqrt(2.0)) / np.log1p(-ideal)
    result.measure("ideal_half", 2.0 * lower - 1.0, 1e-6)
    best_gain = (ideal * touch / k_sigma) ** 2 * 2.0 / density
    gains = best_gain * np.array([0.5, 1.0, 1.8, 2.5])
    quiet = residuals(gains, np.zeros(n))
    # The response is linear in the noise: its own part, long enough for a standard deviation.
    loud = np.concatenate(
        [residuals(gains, rng.normal(0.0, noise, n))[500:] - quiet[500:] for _ in range(20)]
    )
    spread = loud.std(axis=0)
    theory = np.sqrt(gains * density / 2.0)

    def delay(share, gain):
        """Return seconds from the touch until the residual without noise passes the threshold."""
        row = residuals(np.array([gain]), np.zeros(n))[begin:, 0]
        passed = np.flatnonzero(row > share * touch)
        if not passed.size:
            return np.inf
        i = int(passed[0])
        return dt * (i - (row[i] - share * touch) / (row[i] - row[i - 1]))

    def waits(factor):
        """Return the delay at a multiple of the best gain, its threshold at the same sigmas."""
        gain = factor * best_gain
        return delay(k_sigma * np.sqrt(gain * density / 2.0) / touch, gain)

    optimum = minimize_scalar(waits, bounds=(0.3, 1.9), method="bounded", options={"xatol": 1e-4})
    share = k_sigma * np.sqrt(optimum.x * best_gain * density / 2.0) / touch
    result.measure("share", share, 0.02)
    best = result.measure("best_ms", 1e3 * optimum.fun, 0.02)
    more = result.input("more", 1.8)
    # Multiples of the gain that is best with these samples, a little above the ideal one.
    half = result.measure("half", 1e3 * waits(0.5 * optimum.x) / best - 1.0, 0.05)
    double = result.measure("double", 1e3 * waits(more * optimum.x) / best - 1.0, 0.05)
    result.statement = "An arm of two links that moves and is touched, with noise on its torques."

    def sooner(low, high):
        factor = low + (high - low) * rng.uniform()
        return waits(1.1 * factor) < waits(factor)

    below, above = ([sooner(*x) for _ in range(12)] for x in ((0.1, 0.85), (1.1, 1.7)))

    def caught(profile, factor):
        """Return the samples until the residual of an external torque passes its threshold."""
        gain = factor * best_gain
        # The arm above shows that the residual is this first-order filter of the torque.
        row = lfilter([dt * gain], [1.0, dt * gain - 1.0], profile)
        passed = np.flatnonzero(row > k_sigma * np.sqrt(gain * density / 2.0))
        return int(passed[0]) if passed.size else np.inf

    # Chosen to break it: touches that grow, that end too soon, or that are so strong that they are
    # noticed at the next sample; and noise of the measured speed instead of the torques.
    time = dt * np.arange(n)
    grows = [np.minimum(time / seconds, 1.0) * touch for seconds in (0.05, 0.2)]
    others = [*grows, touch * (time < 1e-3), np.full(n, 100.0 * touch)]
    slower = [
        caught(profile, 1.5 * f) < caught(profile, f) for profile in others for f in (0.3, 0.6)
    ]
    shaken = mass_matrix(chain, q0)[1, 1] * rng.normal(0.0, 1e-3, n)
    rough = (residuals(gains, np.zeros(n), shaken) - quiet)[500:].std(axis=0) / gains
    in_speed = [delay(0.5 * f, f * best_gain) for f in (0.2, 0.4, 0.8, 1.6)]
    slower += [late < early for early, late in pairwise(in_speed)]
    result.statement_holds(
        waits(more) < waits(1.0),
        only_if="the touch's torque comes at once and stays, the noise is white noise of the "
        "torques, the delay is long compared with a sample, and the threshold, in standard "
        "deviations of the residual, stays below {share:.0%} of the touch's torque",
        inside=below,
        outside=above + slower,
    )
    result.correction_holds(
        bool(np.all(np.abs(spread / theory - 1.0) < 0.15)),
        abs(share - ideal) < 0.02,
        abs(1.0 + half - 2.0 * lower) < 0.03,
        # The ideal delays at this share, for the same multiples of its gain.
        abs(1.0 + half - 2.0 * np.log1p(-share / np.sqrt(2.0)) / np.log1p(-share)) < 0.018,
        abs(1.0 + double - np.log1p(-share * np.sqrt(more)) / more / np.log1p(-share)) < 0.06,
        np.isinf(waits(2.0 * optimum.x)),
        not any(slower),
        np.ptp(rough) < 0.05 * rough.mean(),
    )
