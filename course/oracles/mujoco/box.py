"""MuJoCo asked about the box on the ground: planar, in a batch, and with what that leaves out.

`spatial_box` has the contact of `box_drop`, so that two answers differ by the effect alone: the
third dimension, the air, a contact that gives way.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.check import POSITIVE, finite, invalid, one_of, positive, vector
from course.oracles.mujoco.kit import GRAVITY, BatchRunner, Runner, inertial, library, scene_xml
from course.rigid_body import quaternion

# The largest that MuJoCo takes (mjMAXIMP): 1e-4 of the load is left to softness.
_IMPEDANCE = 0.9999
_CORNER = 1e-9  # m; a sphere needs a radius


def box_drop(
    half_size: Sequence[float],
    mass: float,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    restitution: float = 0.5,
    friction: float = 0.5,
    gravity: float = GRAVITY,
    contact: str = "impulse",
    contact_steps: float = 20.0,
    friction_steps: float = 10.0,
    inertia: float | None = None,
) -> Runner:
    """Return a planar box above the ground z = 0: q = (x, z, theta), theta counter-clockwise.

    MuJoCo has no coefficient of restitution. It asks for a reference acceleration
    -b v - k r at each contact (v the approach speed, r the depth) and clips the force at zero. Two
    ways to a wanted restitution e follow (both with solref in its direct form and refsafe off):

    - "impulse": k = 0 and b = (1 + e) / dt, so one step turns v into -e v: Newton's rule. Exact but
      for the impedance (1e-4), and only for one-stage integrators with explicit constraints:
      Euler, implicit, implicitfast. Nothing pushes a sunken box out again: the depth, at most
      one step's travel, stays while the box rests.
    - "spring": a spring-damper that lasts about `contact_steps` steps. From
      r'' + 2 zeta w r' + w^2 r = 0, r(0) = 0, with the contact over when the force is zero, at
      w sqrt(1 - zeta^2) t = 2 acos(zeta): e = exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), solved
      here for zeta (acosh when overdamped). Gravity and the finite step are not in this formula: a
      longer contact errs more by the first, a shorter one by the second. For all integrators, and
      the only one for RK4 and discrete: discrete takes the damper implicitly, v1 = v / (1 + b dt),
      which never turns a velocity round, and adds a damping ratio of w dt / 2 that is taken off.

    Friction has its own reference (solreffriction), which takes 1 / `friction_steps` of the sliding
    velocity away in a step; left alone it would reuse b, and a sticking corner would spring back
    sideways. No choice is right for everything, since the contact model is convex: whatever slip
    friction fails to remove below that reference comes back as a speed away from the ground,
    friction coefficient times the slip left over. With 1 a sticking impact is exact, but one that
    slides separates too fast, and a sliding box hops. With 10 (about MuJoCo's default of 100 / s at
    1 ms) a sliding box stays down and stops where Coulomb says, but a one-step impact gets too
    little friction to stick. Without friction there is no such choice to make.

    Args:
        half_size: half width and half height [m].
        mass: [kg].
        q0: (x, z, theta) [m, m, rad].
        v0: their rates.
        dt: step [s].
        integrator: one of `MUJOCO_INTEGRATORS`.
        restitution: e, 0 to 1.
        friction: Coulomb's coefficient, not negative.
        gravity: [m/s^2].
        contact: "impulse" or "spring".
        contact_steps: length of a "spring" contact in steps.
        friction_steps: steps in which friction would stop a slip, at least 1.
        inertia: about the centre [kg m^2]; None for a uniform box.

    Returns:
        A prepared `Runner`.
    """
    hx, hz = vector("half_size", half_size, (2,), low=POSITIVE, unit="m").tolist()
    positive("mass", mass, unit="kg")
    moment = mass * (hx**2 + hz**2) / 3.0 if inertia is None else inertia
    positive("inertia", moment, unit="kg m^2")
    finite("restitution", restitution, 0.0, 1.0)
    finite("friction", friction, 0.0)
    # MuJoCo has no restitution: a spring-damper is solved for that bounces by the same factor.
    stiffness, damping = _contact_reference(contact, restitution, dt, integrator, contact_steps)
    finite("friction_steps", friction_steps, 1.0)
    # Explicit rows multiply a slip by 1 - b dt, implicit ones divide it by 1 + b dt.
    slide = 1.0 / (friction_steps * dt)
    if integrator == "discrete":
        slide = 1.0 / (max(friction_steps - 1.0, 1e-4) * dt)
    contact_of = _pair((stiffness, damping), slide, friction)
    corners = [(-hx, 0.0, -hz), (hx, 0.0, -hz), (hx, 0.0, hz), (-hx, 0.0, hz)]
    joints = (
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<joint type="hinge" axis="0 -1 0"/>'
    )
    body = joints + inertial(mass, 0.0, np.full(3, moment))
    xml = _on_ground(body, corners, contact_of, dt, integrator, gravity)
    return Runner(xml, q0, v0, integrator)


def batch_boxes(
    half_size: Sequence[float],
    mass: float,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    threads: int = 1,
    **box: Any,
) -> BatchRunner:
    """Return N planar boxes in `mujoco.batch`.

    It is `box_drop` with q0 and v0 (3, N), and its keywords in box.

    `threads` counts the caller's own; 0 takes one a core.
    """
    q, v = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
    # One compiled model serves all boxes; only their states differ.
    one = box_drop(half_size, mass, q[:, 0], v[:, 0], dt, integrator, **box)
    return BatchRunner(one, q, v, threads)


def ball_drop(
    height: float,
    dt: float,
    reference: tuple[float, float],
    *,
    onset: float = 0.0,
    gravity: float = GRAVITY,
) -> Runner:
    """Return a ball of no size at rest above the ground z = 0, which moves up and down only.

    Args:
        height: at the start [m].
        dt: step [s].
        reference: stiffness and damping of the contact, per unit of mass [1/s^2, 1/s].
        onset: depth over which the contact force sets in smoothly [m]; 0 for all at once.
        gravity: [m/s^2].
    """
    finite("onset", onset, 0.0, unit="m")
    stiffness, damping = reference
    # A quadratic rise of the impedance from almost 0, so that neither force jumps at the touch.
    least, depth = (_IMPEDANCE, 0.001) if onset == 0.0 else (1e-4, onset)
    pair = (
        f'solref="{-stiffness:.17g} {-damping:.17g}" '
        f'solimp="{least} {_IMPEDANCE} {depth:.17g} 0.5 2" condim="1"'
    )
    body = '<joint type="slide" axis="0 0 1"/>' + inertial(1.0, 0.0, np.full(3, 1e-3))
    xml = _on_ground(body, [(0.0, 0.0, 0.0)], pair, dt, "Euler", gravity)
    return Runner(xml, [height], [0.0], "Euler")


def soft_reference(
    restitution: float, speed: float, contact_time: float, onset: float
) -> tuple[float, float]:
    """Return stiffness and damping of a contact with a smooth onset that bounces as wanted.

    Args:
        restitution: speed after over speed before, between 0.1 and 0.95, at `speed`.
        speed: of the impact [m/s].
        contact_time: half a period of the spring without damping [s].
        onset: see `ball_drop` [m], positive.
    """
    finite("restitution", restitution, 0.1, 0.95)
    positive("speed", speed, unit="m/s")
    omega = math.pi / positive("contact_time", contact_time, unit="s")
    dt = contact_time / 1000.0

    def bounce(zeta: float) -> float:
        runner = ball_drop(0.0, dt, (omega**2, 2.0 * zeta * omega), onset=onset, gravity=0.0)
        runner.v0[0] = -speed
        return float(runner.run(5000)[1][0]) / speed

    # More damping, less bounce: bisection.
    low, high = 0.0, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bounce(middle) > restitution else (low, middle)
    return omega**2, (low + high) * omega


def spring_restitution(damping_ratio: float) -> float:
    """Return the restitution of a spring-damper contact that cannot pull, gravity neglected.

    exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), with acosh and zeta^2 - 1 for zeta > 1.

    Args:
        damping_ratio: zeta, not negative.
    """
    # Closed form of the bounce of a linear spring-damper that lets go when the force is zero.
    zeta = damping_ratio
    if abs(zeta - 1.0) < 1e-9:
        return math.exp(-2.0)
    if zeta < 1.0:
        return math.exp(-2.0 * zeta * math.acos(zeta) / math.sqrt(1.0 - zeta**2))
    return math.exp(-2.0 * zeta * math.acosh(zeta) / math.sqrt(zeta**2 - 1.0))


def measured_restitution(
    restitution: float,
    dt: float,
    integrator: str,
    *,
    contact: str = "impulse",
    contact_steps: float = 20.0,
    speed: float = 2.0,
    gravity: float = GRAVITY,
    phases: int = 16,
) -> tuple[float, float]:
    """Return what a flat drop really gives back, when `restitution` was asked for.

    The speed away from the ground over the speed towards it, both taken to the height z = 0 of the
    bottom face by the parabola of free flight; over `phases` starts that differ by fractions of one
    step's travel, because the grid of steps and the surface do not line up.

    Returns:
        Mean and largest deviation from `restitution`, (mean e, worst |e - wanted|).
    """
    half = 0.1
    runner = box_drop(
        (half, half),
        1.0,
        [0.0, 1.0, 0.0],
        [0.0, -speed, 0.0],
        dt,
        integrator,
        restitution=restitution,
        friction=0.0,
        gravity=gravity,
        contact=contact,
        contact_steps=contact_steps,
    )
    result = []
    # The contact begins anywhere within a step: the drop is repeated over the phases of the grid.
    for phase in range(phases):
        # Three steps of approach plus a fraction of one.
        gap = speed * dt * (3.0 + phase / phases)
        runner.q0[1] = half + gap
        path = runner.samples(int(20 + 4 * contact_steps))
        height, rate = path.q[1] - half, path.v[1]
        # Speeds at the ground, from energy: the samples are a little above it.
        down = math.sqrt(speed**2 + 2.0 * gravity * gap)
        away = np.flatnonzero((rate > 0.0) & (height > 0.0))
        if away.size:
            i = away[0]
            result.append(math.sqrt(rate[i] ** 2 + 2.0 * gravity * height[i]) / down)
        else:
            result.append(0.0)
    return float(np.mean(result)), float(np.max(np.abs(np.array(result) - restitution)))


def _pair(reference: tuple[float, float], slide: float, friction: float) -> str:
    """Return attributes of a contact with the ground."""
    stiffness, damping = reference
    return (
        f'solref="{-stiffness:.17g} {-damping:.17g}" solreffriction="0 {-slide:.17g}" '
        f'solimp="{_IMPEDANCE} {_IMPEDANCE} 0.001" condim="{3 if friction else 1}" '
        f'friction="{friction:.17g} {friction:.17g} 0.005 0.0001 0.0001"'
    )


def _on_ground(
    body: str,
    corners: Sequence[tuple[float, ...]],
    pair: str,
    dt: float,
    integrator: str,
    gravity: float,
) -> str:
    """Return the text of a body whose corners touch the ground z = 0.

    A ball of no size at each corner: one contact a corner, where a box geom, which has a thickness,
    makes two and doubles the solver's work. The plane lies one radius lower, so that a corner
    touches at z = 0.
    """
    deviation = 'contype="0" conaffinity="0"'
    ground = f'<geom name="ground" type="plane" size="0 0 1" pos="0 0 {-_CORNER}" {deviation}/>'
    geoms, pairs = "", ""
    # Spheres of a nanometre at the corners: contact points whose set does not depend on the pose.
    for i, (x, y, z) in enumerate(corners):
        place = f"{x:.17g} {y:.17g} {z:.17g}"
        geoms += f'<geom name="c{i}" type="sphere" size="{_CORNER}" pos="{place}" {deviation}/>'
        pairs += f'<pair geom1="ground" geom2="c{i}" {pair}/>'
    return scene_xml(
        f"{ground}<body>{body}{geoms}</body>",
        dt,
        integrator,
        gravity,
        touching=True,
        gap=["refsafe"],
        extra=f"<contact>{pairs}</contact>",
    )


def _contact_reference(
    contact: str, restitution: float, dt: float, integrator: str, contact_steps: float
) -> tuple[float, float]:
    """Return stiffness and damping for solref's direct form; MuJoCo scales by the impedance."""
    positive("dt", dt, unit="s")
    one_of("contact", contact, ("impulse", "spring"))
    if contact == "impulse":
        if integrator in ("RK4", "discrete"):
            raise invalid(
                "contact",
                contact,
                f"'spring' with the integrator {integrator!r}: 'impulse' needs one explicit stage "
                "(Euler, implicit, implicitfast)",
            )
        # One explicit stage turns a damper of (1 + e) / dt into an impulse with restitution e.
        return 0.0, (1.0 + restitution) / dt
    positive("contact_steps", contact_steps)
    # The bounce falls with damping: bisection for the damping ratio.
    low, high = 0.0, 1.0
    while spring_restitution(high) > restitution and high < 64.0:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if spring_restitution(middle) > restitution:
            low = middle
        else:
            high = middle
    zeta = 0.5 * (low + high)
    # Half a period of the damped oscillation is the duration of the contact.
    angle = 2.0 * math.acos(zeta) / math.sqrt(1.0 - zeta**2) if zeta < 0.999 else 2.0
    omega = angle / (contact_steps * dt)
    if integrator == "discrete":
        zeta -= 0.5 * omega * dt  # the implicit spring damps by itself
    if zeta < 0.0 or (integrator != "discrete" and 2.0 * zeta * omega * dt > 1.0):
        raise invalid(
            "contact_steps",
            contact_steps,
            f"a larger number for restitution {restitution} with the integrator {integrator!r}",
        )
    return omega**2, 2.0 * zeta * omega


def spatial_box(
    size: tuple[float, float, float],
    mass: float,
    state: np.ndarray,
    tilt: float,
    dt: float,
    *,
    restitution: float,
    friction: float,
    gravity: float,
    integrator: str = "Euler",
    contact: str = "impulse",
    contact_steps: float = 40.0,
) -> Runner:
    """Return a box on a free joint above the ground z = 0, thrown in the x-z plane but for a tilt.

    Args:
        size: width (x), depth (y) and height (z) [m].
        mass: [kg]; the box is uniform.
        state: planar start (x, z, angle, vx, vz, omega), the angle anticlockwise as seen along y.
        tilt: turn out of the plane, about the box's own x axis [rad].
        dt: step [s].
        restitution: as for `box_drop`.
        friction: as for `box_drop`.
        gravity: as for `box_drop`.
        integrator: as for `box_drop`.
        contact: as for `box_drop`.
        contact_steps: as for `box_drop`.

    Returns:
        A prepared `Runner`; q is the free joint's.
    """
    x, z, angle, vx, vz, omega = (float(value) for value in state)
    width, depth, height = size
    moments = (
        mass / 12.0 * np.array([depth**2 + height**2, width**2 + height**2, width**2 + depth**2])
    )
    stiffness, damping = _contact_reference(contact, restitution, dt, integrator, contact_steps)
    contact_of = _pair((stiffness, damping), 1.0 / dt, friction)
    corners = list(itertools.product(*((-0.5 * s, 0.5 * s) for s in size)))
    body = "<freejoint/>" + inertial(mass, 0.0, moments)
    xml = _on_ground(body, corners, contact_of, dt, integrator, gravity)
    # Anticlockwise seen along y is a negative turn about y.
    turn = quaternion.exp(np.array([0.0, -angle, 0.0]))
    q = quaternion.product(turn, quaternion.exp(np.array([tilt, 0.0, 0.0])))
    # MuJoCo's angular velocity of a free joint is in the body's axes.
    spin = quaternion.rotate(quaternion.conjugate(q), np.array([0.0, -omega, 0.0]))
    q0 = np.concatenate([[x, 0.0, z], q])
    return Runner(xml, q0, np.concatenate([[vx, 0.0, vz], spin]), integrator)


def add_air(runner: Runner) -> None:
    """Put a scene into air of 20 degrees C, as MuJoCo's inertia-based fluid model takes it."""
    mujoco = library()
    # The kit switches passive forces off where a scene has none.
    runner.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
    runner.model.opt.density = 1.204
    runner.model.opt.viscosity = 1.82e-5
