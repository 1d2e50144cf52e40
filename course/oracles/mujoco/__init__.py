"""MuJoCo asked the questions of chapter 1: tumble, top, pendulums, oscillator, box drop.

Every scene function returns a `Runner`: the model is compiled and the data allocated before the
clock starts, and `run(steps)` goes through MuJoCo's own compiled loop (`mj_step(model, data,
nstep)`), so Python's overhead is not charged to MuJoCo. States are MuJoCo's: a free joint is
q = (x, y, z, qw, qx, qy, qz) with v = (linear velocity in the world, angular velocity in the body).

What is switched off so that MuJoCo runs at its fastest fair setting: sensors, actuation, automatic
reset, islands, the mid-phase and energy (off by default) in every scene; gravity, springs and
dampers where a scene has none; the whole constraint solver, with its warm start and collision
detection, where nothing touches. None of these changes the motion. The automatic reset has to go
for another reason as well: it would put a diverging state back to the start, and an unstable run
would look stable.

Integrators (MuJoCo 4 documentation, Computation, Numerical integration): "Euler" is semi-implicit
with joint damping taken implicitly, "implicit" and "implicitfast" are implicit in velocity, "RK4"
is the classical method, "discrete" is implicit in velocity and position.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, one_of, positive, refused, vector

_log = logging.getLogger(__name__)

INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")
EVALUATIONS_PER_STEP = {name: 4 if name == "RK4" else 1 for name in INTEGRATORS}

_ALWAYS_OFF = ("actuation", "sensor", "autoreset", "island", "midphase")
_CONTACT_OFF = ("constraint", "contact", "warmstart")
_IMPEDANCE = (
    0.9999  # the largest that MuJoCo takes (mjMAXIMP): 1e-4 of the load is left to softness
)


def _mujoco() -> ModuleType:
    try:
        import mujoco
    except ImportError as error:
        raise ImportError("this needs MuJoCo: pip install 'mujoco>=4.0'") from error
    # MuJoCo writes the warning of a diverging state into MUJOCO_LOG.TXT in the current folder. Here
    # divergence is a result, which the caller sees in the state, so the text goes to the log.
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.info)
    return mujoco


@dataclass(frozen=True)
class Trajectory:
    """A recorded motion: times (n,) [s], q (nq, n) and v (nv, n), components along axis 0."""

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64]


class Runner:
    """One prepared scene: model, data and start state; `run` is the part to be timed."""

    def __init__(self, xml: str, q0: ArrayLike, v0: ArrayLike, integrator: str) -> None:
        mujoco = _mujoco()
        self.integrator = integrator
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self._step = mujoco.mj_step
        self.q0 = vector("q0", q0, (self.model.nq,)).copy()
        self.v0 = vector("v0", v0, (self.model.nv,)).copy()
        self.reset()

    @property
    def dt(self) -> float:
        """The time step [s]; may be set between runs."""
        return float(self.model.opt.timestep)

    @dt.setter
    def dt(self, value: float) -> None:
        self.model.opt.timestep = positive("dt", value, unit="s")

    def reset(self) -> None:
        """Back to the start state (and without the solver's memory of the last run)."""
        data = self.data
        data.time, data.qpos[:], data.qvel[:] = 0.0, self.q0, self.v0
        data.qacc_warmstart[:] = 0.0

    def run(self, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The state after `steps` steps from the start, in one compiled loop.

        A run that diverges returns what it reached, NaN or infinity included; nothing is clamped.

        Args:
            steps: how many, not negative.

        Returns:
            Copies of (q, v), shapes (nq,) and (nv,).
        """
        count("steps", steps)
        self.reset()
        if steps:
            self._step(self.model, self.data, steps)
        return self.data.qpos.copy(), self.data.qvel.copy()

    def trajectory(self, steps: int, every: int = 1) -> Trajectory:
        """The motion from the start, recorded every `every` steps (the start included)."""
        count("steps", steps)
        count("every", every, 1)
        self.reset()
        n = steps // every + 1
        times, q, v = np.empty(n), np.empty((self.model.nq, n)), np.empty((self.model.nv, n))
        for i in range(n):
            if i:
                self._step(self.model, self.data, every)
            times[i], q[:, i], v[:, i] = self.data.time, self.data.qpos, self.data.qvel
        return Trajectory(times, q, v)

    def evaluations(self, steps: int) -> int:
        """Force evaluations that `run(steps)` costs: one a step, four with RK4."""
        return EVALUATIONS_PER_STEP[self.integrator] * steps


class BatchRunner:
    """N copies of one scene in `mujoco.batch`: q is (nq, N), v is (nv, N)."""

    def __init__(self, one: Runner, q0: ArrayLike, v0: ArrayLike, threads: int) -> None:
        _mujoco()
        from mujoco import batch

        count("threads", threads)
        self.integrator = one.integrator
        self.model = one.model
        self.q0 = np.array(q0, dtype=float)
        self.v0 = np.array(v0, dtype=float)
        n = self.q0.shape[-1]
        if self.q0.shape != (one.model.nq, n) or self.v0.shape != (one.model.nv, n) or n < 1:
            raise refused(
                "(q0.shape, v0.shape)",
                (self.q0.shape, self.v0.shape),
                f"(({one.model.nq}, N), ({one.model.nv}, N))",
            )
        self._batch = batch.Batch(one.model, n, threads)
        self._q, self._v = self._batch.bind("qpos"), self._batch.bind("qvel")
        self.threads: int = self._batch.nthread
        self.reset()

    @property
    def size(self) -> int:
        """How many bodies."""
        return self.q0.shape[1]

    def reset(self) -> None:
        """Back to the start states."""
        self._batch.state[:] = 0.0
        self._q[:], self._v[:] = self.q0.T, self.v0.T

    def step(self, steps: int) -> None:
        """Go on by `steps` steps, in one compiled call: the part to be timed."""
        count("steps", steps)
        self._batch.step(nstep=steps)

    def run(self, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The states after `steps` steps from the start, shapes (nq, N) and (nv, N)."""
        self.reset()
        self.step(steps)
        return self._q.T.copy(), self._v.T.copy()


# --- scenes without contact -----------------------------------------------------------------------


def free_body(
    inertia: ArrayLike,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    mass: float = 1.0,
    gravity: float = 0.0,
) -> Runner:
    """A free rigid body; without gravity, the torque-free tumble.

    Seven positions make a free joint. Four (a quaternion alone) make a ball joint through the
    centre of mass: the same tumble with half the state, but MuJoCo treats it differently:
    implicitfast and discrete take the gyroscopic torque implicitly for free joints only.

    Args:
        inertia: the three principal moments in the body frame [kg m^2].
        q0: (x, y, z, qw, qx, qy, qz), scalar first, or (qw, qx, qy, qz).
        v0: linear velocity in the world, angular velocity in the body [m/s, rad/s]; the angular
            velocity alone with four positions.
        dt: step [s].
        integrator: one of `INTEGRATORS`.
        mass: [kg].
        gravity: downwards along z [m/s^2].

    Returns:
        A prepared `Runner`.
    """
    moments = _moments("inertia", inertia)
    joint = '<joint type="ball"/>' if np.size(q0) == 4 else "<freejoint/>"
    body = f"<body>{joint}{_inertial(mass, 0.0, moments)}</body>"
    return Runner(_xml(body, dt, integrator, gravity), q0, v0, integrator)


def heavy_top(
    inertia: Sequence[float],
    weight: float,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
) -> Runner:
    """A symmetric top on a ball joint at the origin, its centre of mass on its own z axis.

    The motion depends on the moments about the pivot and on the product m g l alone, so mass and
    distance are chosen here such that the moments about the centre of mass are a body's.

    Args:
        inertia: (I1 = I2, I3) about the **pivot** [kg m^2].
        weight: m g l, mass times gravity times distance to the centre of mass [N m].
        q0: unit quaternion (w, x, y, z), body to world.
        v0: angular velocity in the body frame [rad/s].
        dt: step [s].
        integrator: one of `INTEGRATORS`.

    Returns:
        A prepared `Runner`; q is the quaternion, v the angular velocity in the body.
    """
    i1, i3 = vector("inertia", inertia, (2,), low=POSITIVE, unit="kg m^2").tolist()
    positive("weight", weight, unit="N m")
    if i1 <= 0.5 * i3:
        raise refused("inertia", (i1, i3), "I1 above I3 / 2")
    shift = 0.5 * (i1 - 0.5 * i3)  # m l^2, half of the most that parallel axes allow
    mass = (weight / 9.81) ** 2 / shift
    distance = shift * 9.81 / weight
    central = np.array([i1 - shift, i1 - shift, i3])
    body = f'<body><joint type="ball"/>{_inertial(mass, distance, central)}</body>'
    return Runner(_xml(body, dt, integrator, 9.81), q0, v0, integrator)


def oscillator(
    mass: float,
    stiffness: float,
    damping: float,
    q0: float,
    v0: float,
    dt: float,
    integrator: str,
    *,
    implicit_damping: bool = True,
) -> Runner:
    """A mass on a spring and a damper: m x'' = -k x - c x', on one slide joint.

    Args:
        mass, stiffness, damping: m [kg], k [N/m], c [N s/m].
        q0, v0: start [m, m/s].
        dt: step [s].
        integrator: one of `INTEGRATORS`.
        implicit_damping: False sets MuJoCo's eulerdamp flag to off: the damper is then explicit
            under "Euler" (the other integrators ignore the flag).

    Returns:
        A prepared `Runner`.
    """
    off: list[str] = [] if implicit_damping else ["eulerdamp"]
    finite("stiffness", stiffness, 0.0, unit="N/m")
    finite("damping", damping, 0.0, unit="N s/m")
    body = (
        f'<body><joint type="slide" stiffness="{stiffness:.17g}" damping="{damping:.17g}"/>'
        f"{_inertial(mass, 0.0, np.ones(3))}</body>"
    )
    xml = _xml(body, dt, integrator, 0.0, springs=True, off=off)
    return Runner(xml, [q0], [v0], integrator)


def pendulum(
    length: float, q0: float, v0: float, dt: float, integrator: str, *, gravity: float = 9.81
) -> Runner:
    """The ideal pendulum theta'' = -(g / length) sin(theta), theta = 0 hanging down.

    MuJoCo takes no body without inertia, so the bob is spread out: mass 2 at half the length with
    the moment length^2 / 2 about its own centre has the same first and second moment about the
    hinge as mass 1 at the end, and so exactly the same motion.
    """
    half = 0.5 * positive("length", length, unit="m")
    body = (
        '<body><joint type="hinge" axis="0 -1 0"/>'
        f"{_inertial(2.0, -half, np.full(3, 2.0 * half**2))}</body>"
    )
    return Runner(_xml(body, dt, integrator, gravity), [q0], [v0], integrator)


def double_pendulum(
    masses: Sequence[float],
    lengths: Sequence[float],
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    gravity: float = 9.81,
) -> Runner:
    """Two point masses on massless rods; q = (theta1, theta2 **relative to the first rod**).

    As in `pendulum`, the point masses are replaced by bodies with the same moments: the second has
    mass m2 / s at s l2, the first what is then missing. Both angles are zero hanging down. With
    absolute angles (phi1, phi2): theta1 = phi1, theta2 = phi2 - phi1.
    """
    m1, m2 = vector("masses", masses, (2,), low=POSITIVE, unit="kg").tolist()
    l1, l2 = vector("lengths", lengths, (2,), low=POSITIVE, unit="m").tolist()
    # The first body must keep a positive mass: m2 / s < m1 + m2.
    s = 0.5 * (1.0 + m2 / (m1 + m2))
    rest = m1 + m2 - m2 / s
    second = _inertial(m2 / s, -s * l2, np.full(3, m2 * l2**2 * (1.0 - s)))
    first = _inertial(rest / s, -s * l1, np.full(3, rest * l1**2 * (1.0 - s)))
    joint = '<joint type="hinge" axis="0 -1 0"/>'
    body = f'<body>{joint}{first}<body pos="0 0 {-l1:.17g}">{joint}{second}</body></body>'
    return Runner(_xml(body, dt, integrator, gravity), q0, v0, integrator)


# --- the stiff spring -----------------------------------------------------------------------------


def oscillator_step(
    integrator: str,
    omega_dt: float,
    damping_ratio: float = 0.0,
    *,
    implicit_damping: bool = True,
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """One MuJoCo step of x'' = -x - 2 zeta x', as a function (x, x') -> (x, x').

    The function is what the detectors of `course.measure.stability` take. In theory Euler, implicit
    and implicitfast step v1 = (v - h w^2 q) / (1 + 2 zeta w h), q1 = q + h v1 and are stable while
    w h < 2 (sqrt(1 + zeta^2) + zeta): more damping, longer steps. With the damper explicit the sign
    of zeta turns: 2 (sqrt(1 + zeta^2) - zeta). RK4 has the classical region (2 sqrt(2) undamped);
    "discrete" has no limit.

    Args:
        integrator: one of `INTEGRATORS`.
        omega_dt: natural frequency times step, positive.
        damping_ratio: zeta, not negative.
        implicit_damping: see `oscillator`.

    Returns:
        The step; its argument stays as it is.
    """
    damping = 2.0 * damping_ratio
    runner = oscillator(
        1.0, 1.0, damping, 0.0, 0.0, omega_dt, integrator, implicit_damping=implicit_damping
    )
    data = runner.data

    def step(state: NDArray[np.float64]) -> NDArray[np.float64]:
        data.qpos[0], data.qvel[0] = state
        runner._step(runner.model, data)
        return np.array([data.qpos[0], data.qvel[0]])

    return step


# --- the box on the ground ------------------------------------------------------------------------


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
    gravity: float = 9.81,
    contact: str = "impulse",
    contact_steps: float = 20.0,
    friction_steps: float = 10.0,
    inertia: float | None = None,
) -> Runner:
    """A planar box above the ground z = 0: q = (x, z, theta), theta counter-clockwise.

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
        integrator: one of `INTEGRATORS`.
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
    stiffness, damping = _contact_reference(contact, restitution, dt, integrator, contact_steps)
    finite("friction_steps", friction_steps, 1.0)
    # Explicit rows multiply a slip by 1 - b dt, implicit ones divide it by 1 + b dt.
    slide = 1.0 / (friction_steps * dt)
    if integrator == "discrete":
        slide = 1.0 / (max(friction_steps - 1.0, 1e-4) * dt)
    pair = (
        f'solref="{-stiffness:.17g} {-damping:.17g}" solreffriction="0 {-slide:.17g}" '
        f'solimp="{_IMPEDANCE} {_IMPEDANCE} 0.001" condim="{3 if friction else 1}" '
        f'friction="{friction:.17g} {friction:.17g} 0.005 0.0001 0.0001"'
    )
    # A ball of no size at each corner: one contact a corner, where a box geom, which has a
    # thickness, makes two and doubles the solver's work.
    names = ("sw", "se", "ne", "nw")
    corners = ((-hx, -hz), (hx, -hz), (hx, hz), (-hx, hz))
    geoms = "".join(
        f'<geom name="{n}" type="sphere" size="{_CORNER}" pos="{x:.17g} 0 {z:.17g}" contype="0" '
        'conaffinity="0"/>'
        for n, (x, z) in zip(names, corners, strict=True)
    )
    pairs = "".join(f'<pair geom1="ground" geom2="{n}" {pair}/>' for n in names)
    joints = (
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        '<joint type="hinge" axis="0 -1 0"/>'
    )
    # The plane lies one ball radius lower, so that a corner touches at z = 0.
    body = (
        f'<geom name="ground" type="plane" size="0 0 1" pos="0 0 {-_CORNER}" contype="0" '
        'conaffinity="0"/>'
        f"<body>{joints}{_inertial(mass, 0.0, np.full(3, moment))}{geoms}</body>"
    )
    xml = _xml(
        body,
        dt,
        integrator,
        gravity,
        touching=True,
        off=["refsafe"],
        extra=f"<contact>{pairs}</contact>",
    )
    return Runner(xml, q0, v0, integrator)


_CORNER = 1e-9  # m; a sphere needs a radius


def spring_restitution(damping_ratio: float) -> float:
    """Restitution of a spring-damper contact that cannot pull, gravity neglected.

    exp(-2 zeta acos(zeta) / sqrt(1 - zeta^2)), with acosh and zeta^2 - 1 for zeta > 1.

    Args:
        damping_ratio: zeta, not negative.
    """
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
    gravity: float = 9.81,
    phases: int = 16,
) -> tuple[float, float]:
    """What a flat drop really gives back, when `restitution` was asked for.

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
    found = []
    for phase in range(phases):
        gap = speed * dt * (3.0 + phase / phases)
        runner.q0[1] = half + gap
        path = runner.trajectory(int(20 + 4 * contact_steps))
        height, rate = path.q[1] - half, path.v[1]
        down = math.sqrt(speed**2 + 2.0 * gravity * gap)
        away = np.flatnonzero((rate > 0.0) & (height > 0.0))
        if away.size:
            i = away[0]
            found.append(math.sqrt(rate[i] ** 2 + 2.0 * gravity * height[i]) / down)
        else:
            found.append(0.0)
    return float(np.mean(found)), float(np.max(np.abs(np.array(found) - restitution)))


def _contact_reference(
    contact: str, restitution: float, dt: float, integrator: str, contact_steps: float
) -> tuple[float, float]:
    """Stiffness and damping for solref's direct form, which MuJoCo scales by the impedance."""
    positive("dt", dt, unit="s")
    one_of("contact", contact, ("impulse", "spring"))
    if contact == "impulse":
        if integrator in ("RK4", "discrete"):
            raise refused(
                "contact",
                contact,
                f"'spring' with the integrator {integrator!r}: 'impulse' needs one explicit stage "
                "(Euler, implicit, implicitfast)",
            )
        return 0.0, (1.0 + restitution) / dt
    positive("contact_steps", contact_steps)
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
    angle = 2.0 * math.acos(zeta) / math.sqrt(1.0 - zeta**2) if zeta < 0.999 else 2.0
    omega = angle / (contact_steps * dt)
    if integrator == "discrete":
        zeta -= 0.5 * omega * dt  # the implicit spring damps by itself
    if zeta < 0.0 or (integrator != "discrete" and 2.0 * zeta * omega * dt > 1.0):
        raise refused(
            "contact_steps",
            contact_steps,
            f"a larger number for restitution {restitution} with the integrator {integrator!r}",
        )
    return omega**2, 2.0 * zeta * omega


# --- batches --------------------------------------------------------------------------------------


def batch_free_bodies(
    inertia: ArrayLike,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    threads: int = 1,
    gravity: float = 0.0,
) -> BatchRunner:
    """N free bodies in `mujoco.batch`: `free_body` with q0 (7, N), v0 (6, N), one inertia for all.

    `threads` counts the caller's own; 0 takes one a core.
    """
    q, v = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
    one = free_body(inertia, q[:, 0], v[:, 0], dt, integrator, gravity=gravity)
    return BatchRunner(one, q, v, threads)


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
    """N planar boxes in `mujoco.batch`: `box_drop` with q0 and v0 (3, N), and its keywords in box.

    `threads` counts the caller's own; 0 takes one a core.
    """
    q, v = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
    one = box_drop(half_size, mass, q[:, 0], v[:, 0], dt, integrator, **box)
    return BatchRunner(one, q, v, threads)


# --- model text and checks ------------------------------------------------------------------------


def _xml(
    body: str,
    dt: float,
    integrator: str,
    gravity: float,
    *,
    springs: bool = False,
    touching: bool = False,
    off: Sequence[str] = (),
    extra: str = "",
) -> str:
    one_of("integrator", integrator, INTEGRATORS)
    positive("dt", dt, unit="s")
    finite("gravity", gravity, unit="m/s^2")
    flags = [*_ALWAYS_OFF, *off]
    if not touching:
        flags += _CONTACT_OFF
    if not springs:
        flags += ["spring", "damper"]
    if gravity == 0.0:
        flags.append("gravity")
    switched = " ".join(f'{flag}="disable"' for flag in flags)
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{dt:.17g}" integrator="{integrator}" '
        f'gravity="0 0 {-gravity:.17g}" cone="elliptic"><flag {switched}/></option>'
        f"<worldbody>{body}</worldbody>{extra}</mujoco>"
    )


def _inertial(mass: float, z: float, moments: NDArray[np.float64]) -> str:
    positive("mass", mass, unit="kg")
    text = " ".join(f"{moment:.17g}" for moment in moments)
    return f'<inertial pos="0 0 {z:.17g}" mass="{mass:.17g}" diaginertia="{text}"/>'


def _moments(name: str, value: ArrayLike) -> NDArray[np.float64]:
    moments = vector(name, value, (3,), low=POSITIVE, unit="kg m^2")
    largest = float(np.max(moments))
    if 2.0 * largest > float(np.sum(moments)) * (1.0 + 1e-9):
        raise refused(name, moments, "three moments of which none is above the sum of the others")
    return moments
