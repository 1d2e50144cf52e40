"""The scenes that every engine is asked to run: geometry, parameters, tolerance and truth, as data.

There are two kinds. A scene of joints is one URDF text (and the same arm as a `Chain` of chapter
4). A scene of bodies is a list of boxes, on a level ground z = 0 or without one. The truth is a
closed form, or chapter 1's tight reference, which no engine of this chapter makes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from course import kinematics
from course.check import count, finite, positive, vector
from course.kinematics import Chain
from course.platforms.state import Array, State
from course.rigid_body import problems, quaternion
from course.rigid_body.integrators import System

GRAVITY = 9.81  # m/s^2
HALF = 0.05  # of a cube [m]
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid box.

    Attributes:
        name: unique in its scene.
        half: half sizes (3,) [m]; None for a body that touches nothing.
        mass: [kg].
        moments: principal moments about its centre, along its axes, (3,) [kg m^2].
        pose: of the centre at the start, (7,).
        velocity: at the start, (6,), as in `State.v`.
        guide: None for a free body; else a unit vector in the world along which it slides, its only
            freedom.
        force: constant, at its centre, in the world (3,) [N].
    """

    name: str
    half: tuple[float, float, float] | None
    mass: float
    moments: tuple[float, float, float]
    pose: tuple[float, ...]
    velocity: tuple[float, ...] = (0.0,) * 6
    guide: tuple[float, float, float] | None = None
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Scene:
    """One scene.

    Attributes:
        name: its kind, such as "tower".
        duration: of the motion that is judged [s].
        tolerance: of `error` [m, or rad].
        judge: "turn" (angle of the turn that is missing [rad]), "joints" (largest error of a joint
            [rad]) or "place" (largest distance of a centre from its truth [m]).
        truth: time [s] -> the true q, in the form of `State.q`; NaN where nothing is compared.
        bodies: the bodies, without the ground; empty in scenes of joints.
        urdf: the model's text in scenes of joints, else "".
        chain: the same arm, as chapter 4 has it.
        q0, v0: joints at the start, (n,) [rad, rad/s].
        ground: whether there is the level ground z = 0.
        friction: coefficient of every pair.
        gravity: (3,) [m/s^2].
        settle: time at rest before the start velocities are given [s]; see `prepared`.
    """

    name: str
    duration: float
    tolerance: float
    judge: str
    truth: Callable[[float], Array]
    bodies: tuple[Body, ...] = ()
    urdf: str = ""
    chain: Chain | None = None
    q0: Array | None = None
    v0: Array | None = None
    ground: bool = False
    friction: float = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    settle: float = 0.0

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        if self.chain:
            return self.chain.n
        return sum(1 if body.guide else 6 for body in self.bodies)

    @property
    def unit(self) -> str:
        """Unit of `error`."""
        return "m" if self.judge == "place" else "rad"

    @property
    def start(self) -> State:
        """The state at the start."""
        if self.chain:
            assert self.q0 is not None and self.v0 is not None
            return State(0.0, self.q0.copy(), self.v0.copy())
        q = np.array([body.pose for body in self.bodies], dtype=float).T
        return State(0.0, q, np.array([body.velocity for body in self.bodies], dtype=float).T)

    @property
    def joints(self) -> list[str]:
        """Names of the joints in the URDF text, in the order of `State.q`."""
        return [f"joint{i}" for i in range(self.chain.n if self.chain else 0)]

    def at_rest(self) -> Scene:
        """Return the same without velocities at the start."""
        still = tuple(replace(body, velocity=(0.0,) * 6) for body in self.bodies)
        return replace(self, bodies=still, v0=None if self.v0 is None else 0.0 * self.v0)

    def error(self, state: State, time: float | None = None) -> float:
        """Return the distance of a state from the truth at a time, by default the end.

        Infinite if not finite.

        Args:
            state: what an engine reached.
            time: since the start of the motion [s].
        """
        if not np.isfinite(state.q).all():
            return math.inf
        true = self.truth(self.duration if time is None else time)
        if self.judge == "turn":
            # An engine's quaternion may have drifted from unit length; the angle must not see that.
            turn = quaternion.normalise(state.q[3:, 0])
            return float(quaternion.angle_between(turn, true[3:, 0]))
        deviation = state.q - true
        if self.judge == "joints":
            return float(np.max(np.abs(deviation)))
        # NaN in the truth marks what is not compared.
        return float(np.max(np.linalg.norm(np.nan_to_num(deviation[:3]), axis=0)))

    def energy(self, state: State) -> float:
        """Return kinetic plus potential energy of a state [J], 0 at rest in the world's origin."""
        down = np.array(self.gravity)
        if self.chain:
            return float(kinematics.energy(self.chain, state.q, state.v, gravity=down)[2])
        total = 0.0
        for body, q, v in zip(self.bodies, state.q.T, state.v.T, strict=True):
            total += 0.5 * body.mass * float(v[:3] @ v[:3]) - body.mass * float(down @ q[:3])
            total += 0.5 * float(np.array(body.moments) @ v[3:] ** 2)
            # A constant force has the potential -f . x.
            total -= float(np.array(body.force) @ q[:3])
        return total


# --- scenes of joints -----------------------------------------------------------------------------


def urdf(chain: Chain, name: str = "arm") -> str:
    """Return the URDF text of an arm without branches.

    Its links are `base`, `link0`, ... and its joints `joint0`, ...

    Every number is written with all its digits. URDF knows no armature, and a tool is no part of
    it; a joint without limits is continuous.
    """

    def pose(place: Array) -> str:
        # URDF's rpy are fixed-axis angles, which are ZYX Euler angles in reverse order.
        yaw, pitch, roll = quaternion.to_euler_zyx(place[3:])
        return f'<origin xyz="{_text(place[:3])}" rpy="{_text((roll, pitch, yaw))}"/>'

    lines = [f'<robot name="{name}"><link name="base"/>']
    for i in range(chain.n):
        inertia, centre = chain.inertia[:, :, i], _text(chain.centre[:, i])
        xx, xy, xz, yy, yz, zz = (f"{x:.17g}" for x in inertia[np.triu_indices(3)])
        limits, kind = "", "prismatic" if chain.slides[i] else "continuous"
        if np.isfinite(chain.lower[i]) and np.isfinite(chain.upper[i]):
            kind = "prismatic" if chain.slides[i] else "revolute"
            limits = f'lower="{chain.lower[i]:.17g}" upper="{chain.upper[i]:.17g}" '
        lines.append(
            f'<link name="link{i}"><inertial><origin xyz="{centre}" rpy="0 0 0"/>'
            f'<mass value="{chain.mass[i]:.17g}"/><inertia ixx="{xx}" ixy="{xy}" ixz="{xz}" '
            f'iyy="{yy}" iyz="{yz}" izz="{zz}"/></inertial></link>\n'
            f'<joint name="joint{i}" type="{kind}">{pose(chain.placement[:, i])}'
            f'<parent link="{"base" if i == 0 else f"link{i - 1}"}"/><child link="link{i}"/>'
            f'<axis xyz="0 0 1"/><limit {limits}effort="1000" velocity="1000"/>'
            f'<dynamics damping="{chain.damping[i]:.17g}" friction="0"/></joint>'
        )
    return "\n".join([*lines, "</robot>"])


def _text(values: ArrayLike) -> str:
    return " ".join(f"{float(x):.17g}" for x in np.asarray(values))


def linked(
    name: str,
    chain: Chain,
    q0: ArrayLike,
    duration: float,
    tolerance: float,
    down: tuple[float, float, float] = (0.0, 0.0, -GRAVITY),
) -> Scene:
    """Return a scene of joints that is released at rest.

    Its truth is chapter 1's tight reference.
    """
    start = vector("q0", q0, (chain.n,)).copy()

    def acceleration(q: Array, v: Array, params: Array) -> Array:
        return kinematics.forward_dynamics(chain, q, v, np.zeros(chain.n), gravity=down)

    still = np.zeros(chain.n)
    # Integrated by chapter 1 to rounding, with chapter 4's dynamics: no engine takes part.
    system = System(name, acceleration, np.zeros(0), start, still, compile=False)

    @functools.lru_cache(maxsize=64)
    def truth(time: float) -> Array:
        return problems.tight_reference(system, time)[0]

    return Scene(
        name,
        duration,
        tolerance,
        "joints",
        truth,
        urdf=urdf(chain, name),
        chain=chain,
        q0=start,
        v0=still,
        gravity=down,
    )


def chain(n: int = 6, duration: float = 2.0, tolerance: float = 1e-2) -> Scene:
    """Return n rods of 0.2 m and 0.5 kg that hang on each other, in one plane, let go at an angle.

    The plane is that of x and y, with gravity along -y; all joints turn about z.
    """
    count("n", n, 1, 64)
    arm = kinematics.planar(np.full(n, 0.2), np.full(n, 0.5))
    q0 = np.full(n, 0.05)
    q0[0] = -0.5
    return linked("chain", arm, q0, duration, tolerance, (0.0, -GRAVITY, 0.0))


def arm(duration: float = 0.5, tolerance: float = 5e-2, damping: float = 0.0) -> Scene:
    """Return the 7-R arm of chapter 4, let go in a bent posture.

    It falls without limits, and without its motors' inertia, for which URDF has no word; its
    damping is 0 unless asked for [N m s/rad].
    """
    # What URDF cannot express is removed, so that every engine gets the same arm.
    robot = replace(kinematics.panda(), armature=0.0, damping=damping, lower=-np.inf, upper=np.inf)
    return linked("arm", robot, [0.3, -0.4, 0.2, -1.8, 0.4, 1.6, 0.1], duration, tolerance)


# --- scenes of bodies -----------------------------------------------------------------------------


def box(
    name: str,
    half: Sequence[float],
    mass: float,
    place: Sequence[float],
    **more: Sequence[float] | None,
) -> Body:
    """Return a uniform upright box with its centre at a place; `more` are fields of `Body`."""
    x, y, z = vector("half", half, (3,), unit="m").tolist()
    # A third of the mass: moments of a box in terms of half sizes.
    m = positive("mass", mass, unit="kg") / 3.0
    moments = (m * (y * y + z * z), m * (x * x + z * z), m * (x * x + y * y))
    pose = (*(float(c) for c in place), *UPRIGHT)
    return Body(name, (x, y, z), mass, moments, pose, **more)  # type: ignore[arg-type]


def tumble(duration: float = 5.0, tolerance: float = 1e-2) -> Scene:
    """Return a freely turning body with three different moments of inertia.

    The truth is chapter 1's closed form.
    """
    problem = problems.tumble(duration=duration)
    # Jacobi's closed form at time 0 is the start.
    q0, v0 = problem.truth(0.0)
    i1, i2, i3 = problem.system.params.tolist()
    nil = (0.0, 0.0, 0.0)
    body = Body("body", None, 1.0, (i1, i2, i3), (*nil, *q0.tolist()), (*nil, *v0.tolist()))

    def truth(time: float) -> Array:
        return np.concatenate([np.zeros(3), problem.truth(time)[0]])[:, None]

    return Scene("tumble", duration, tolerance, "turn", truth, bodies=(body,), gravity=nil)


def _unmoved(bodies: Sequence[Body], shift: Callable[[float], ArrayLike] | None = None):
    """Return a truth in which all centres keep their places, or all are shifted."""
    places = np.array([body.pose for body in bodies], dtype=float).T

    def truth(time: float) -> Array:
        other = places.copy()
        other[:3] += np.zeros((3, 1)) if shift is None else np.reshape(shift(time), (3, 1))
        return other

    return truth


def drop(height: float = 0.1, duration: float = 1.0, tolerance: float = 1e-3) -> Scene:
    """Return a cube of 1 kg that falls flat from a height above the ground [m] and stays there."""
    finite("height", height, 0.0, unit="m")
    cube = box("cube", (HALF,) * 3, 1.0, (0.0, 0.0, HALF + height))

    def fallen(time: float) -> Array:
        # Free fall until the ground; rigid and without bounce from then on.
        return np.array([0.0, 0.0, -min(height, 0.5 * GRAVITY * time**2)])

    return Scene(
        "drop",
        duration,
        tolerance,
        "place",
        _unmoved([cube], fallen),
        bodies=(cube,),
        ground=True,
        friction=0.5,
    )


def slope(
    angle: float = 0.3, friction: float = 0.5, duration: float = 1.0, tolerance: float = 1e-3
) -> Scene:
    """Return a flat block of 1 kg on a slope, down along x: it rests if friction >= tan(angle).

    Else it slides with g (sin - mu cos). Gravity is turned by the angle [rad], not the ground.
    """
    finite("angle", angle, 0.0, 0.5 * math.pi, unit="rad")
    finite("friction", friction, 0.0)
    body = _block()
    s, c = math.sin(angle), math.cos(angle)
    # Coulomb: it slides down with g (sin - mu cos), or stays.
    rate = GRAVITY * max(0.0, s - friction * c)
    return Scene(
        "rest" if rate == 0.0 else "slide",
        duration,
        tolerance,
        "place",
        _unmoved([body], lambda t: np.array([0.5 * rate * t * t, 0.0, 0.0])),
        bodies=(body,),
        ground=True,
        friction=friction,
        gravity=(GRAVITY * s, 0.0, -GRAVITY * c),
        settle=0.0 if rate else 0.1,
    )


def _block(velocity: Sequence[float] = (0.0,) * 6) -> Body:
    half = (0.1, 0.1, 0.02)
    return box("block", half, 1.0, (0.0, 0.0, half[2]), velocity=tuple(velocity))


def brake(
    heading: float = 0.0, speed: float = 2.0, friction: float = 0.5, tolerance: float = 1e-2
) -> Scene:
    """Return a flat block that is launched on level ground at a heading [rad] and stops.

    By Coulomb's law after speed^2 / (2 mu g) [m], along its heading.
    """
    finite("heading", heading, unit="rad")
    positive("speed", speed, unit="m/s")
    positive("friction", friction)
    along = np.array([math.cos(heading), math.sin(heading), 0.0])
    body = _block((*(speed * along), 0.0, 0.0, 0.0))
    # After this time the block stays: friction holds it.
    stop = speed / (friction * GRAVITY)

    def path(time: float) -> Array:
        t = min(time, stop)
        return (speed * t - 0.5 * friction * GRAVITY * t * t) * along

    return Scene(
        "brake",
        1.5 * stop,
        tolerance,
        "place",
        _unmoved([body], path),
        bodies=(body,),
        ground=True,
        friction=friction,
        settle=0.2,
    )


def tower(n: int = 5, duration: float = 1.0, tolerance: float = 1e-3) -> Scene:
    """Return n cubes of 1 kg on top of each other, the lowest first: they stay where they are."""
    count("n", n, 1)
    cubes = [box(f"cube{i}", (HALF,) * 3, 1.0, (0.0, 0.0, (2 * i + 1) * HALF)) for i in range(n)]
    return Scene(
        "tower",
        duration,
        tolerance,
        "place",
        _unmoved(cubes),
        bodies=tuple(cubes),
        ground=True,
        friction=0.5,
    )


def grasp(
    squeeze: float = 3.0, friction: float = 0.5, duration: float = 0.5, tolerance: float = 1e-3
) -> Scene:
    """Return a part of 0.2 kg between two fingers that squeeze it with a force each [N], no ground.

    It is held if squeeze >= m g / (2 mu), else it falls with g - 2 mu squeeze / m. The fingers
    slide along x; bodies are the part, the left and the right finger.
    """
    positive("squeeze", squeeze, unit="N")
    positive("friction", friction)
    mass = 0.2
    part = box("part", (0.02, 0.03, 0.03), mass, (0.0, 0.0, 0.0))
    fingers = [
        box(
            name,
            (0.01,) * 3,
            0.05,
            (0.03 * side, 0.0, 0.0),
            guide=(1.0, 0.0, 0.0),
            force=(-side * squeeze, 0.0, 0.0),
        )
        for name, side in (("left", -1.0), ("right", 1.0))
    ]
    # Both fingers carry up to mu F each; the rest of the weight accelerates the part.
    rate = max(0.0, GRAVITY - 2.0 * friction * squeeze / mass)
    bodies = (part, *fingers)
    still = _unmoved(bodies)

    def truth(time: float) -> Array:
        other = still(time)
        other[2, 0] -= 0.5 * rate * time * time
        return other

    return Scene("grasp", duration, tolerance, "place", truth, bodies=bodies, friction=friction)


def field(n: int = 64, duration: float = 0.5, tolerance: float = 1e-3) -> Scene:
    """Return n cubes of 1 kg on the ground in a square grid, 0.3 m apart: they stay."""
    count("n", n, 1)
    # A square grid, filled row by row.
    side = math.ceil(math.sqrt(n))
    cubes = [
        box(f"cube{i}", (HALF,) * 3, 1.0, (0.3 * (i % side), 0.3 * (i // side), HALF))
        for i in range(n)
    ]
    return Scene(
        "field",
        duration,
        tolerance,
        "place",
        _unmoved(cubes),
        bodies=tuple(cubes),
        ground=True,
        friction=0.5,
    )


SCENES: dict[str, Callable[..., Scene]] = {
    "tumble": tumble,
    "chain": chain,
    "arm": arm,
    "drop": drop,
    "rest": slope,
    "slide": functools.partial(slope, 0.5, 0.2),
    "brake": brake,
    "tower": tower,
    "grasp": grasp,
    "field": field,
}
