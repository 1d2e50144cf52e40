"""A chain of joints, or a tree of them, as arrays.

Each joint turns about, or slides along, the z axis of its own frame; for an axis of another
direction, turn the frame (`turn_to`). A link is the body behind a joint, and the joint's frame is
the frame of its link. So an arm of n joints is n parents, n placements and n inertias; a tree is a
chain in which a parent is not always the joint before, and costs nothing extra.

Poses are (x, y, z, qw, qx, qy, qz) as in the free joint of chapter 1, components along axis 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, vector
from course.rigid_body.quaternion import (
    conjugate,
    exp,
    normalise,
    product,
    rotate,
    to_matrix,
    unit_quaternion,
)
from course.rigid_body.spatial import inertia_tensor

Array = NDArray[np.float64]

HERE = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

# Columns of `Chain.table`, the numbers that compiled loops read: a row a joint, and the last row
# for the tool, a placement without a joint. Inertia is about the joint's origin: mass, first moment
# and second moment (xx, xy, xz, yy, yz, zz), in which torques are linear.
PARENT, SLIDES, PLACE, QUAT, TURN, TEN, ARMATURE, DAMPING, LOWER, UPPER, WIDTH = (
    0,
    1,
    2,
    5,
    9,
    18,
    28,
    29,
    30,
    31,
    32,
)


@register_jitable
def compose(a: Array, b: Array) -> Array:
    """Return the pose b, given in the frame of a, in the frame that a is given in.

    Shapes are (7,) or (7, N).
    """
    shift, turn = rotate(a[3:], b[:3]), product(a[3:], b[3:])
    result = np.empty((7,) + shift.shape[1:])
    for x in range(3):
        result[x] = a[x] + shift[x]
    result[3:] = turn
    return result


def invert(a: Array) -> Array:
    """Return the pose of the outer frame seen from the frame `a`, shape (7,) or (7, N)."""
    # The inverse of a rigid motion (R, p) is (R^T, -R^T p).
    back = conjugate(a[3:])
    return np.concatenate([-rotate(back, a[:3]), back])


def turn_to(axis: ArrayLike) -> Array:
    """Return the shortest rotation that takes z to a direction, shape (4,).

    About x where that is -z.
    """
    direction = vector("axis", axis, (3,))
    if not direction.any():
        raise invalid("axis", direction, "a direction, not zero")
    return shortest_turn(direction)


@register_jitable
def shortest_turn(direction: Array) -> Array:
    """Return the shortest rotation that takes z to a direction that is not zero, shape (4,)."""
    # Only the direction counts, and scaled like this no square overflows or vanishes.
    scaled = direction / np.abs(direction).max()
    x, y, z = scaled[0], scaled[1], scaled[2]
    across = np.hypot(x, y)
    angle = math.atan2(across, z)
    if across == 0.0:
        return exp(np.array([angle, 0.0, 0.0]))
    # The axis is z x direction = (-y, x, 0), the angle that between the two.
    return exp(np.array([-y, x, 0.0]) * (angle / across))


@dataclass(frozen=True, eq=False)
class Chain:
    """An arm: n joints, each with the link behind it. The tool is fixed to the last link.

    Attributes:
        parent: the joint before each one, -1 for the base; always an earlier one, shape (n,).
        placement: of each joint's frame in that of its parent where the joint is at 0, (7, n).
        slides: whether a joint slides along its z axis; else it turns about it, (n,).
        lower, upper: limits of the joints [rad or m], may be infinite, (n,).
        mass: of the links [kg], (n,).
        centre: centres of mass in the joints' frames [m], (3, n).
        inertia: about these centres, in the joints' frames [kg m^2], (3, 3, n).
        armature: inertia of the motor on its joint [kg m^2 or kg], (n,).
        damping: viscous [N m s/rad or N s/m], (n,).
        tool: pose of the tip in the frame of the last joint, (7,).
        table: all of it as compiled loops read it, (n + 1, WIDTH).

    Raises:
        ValueError: for what cannot be an arm: no joint, a parent that comes after its child, limits
            that cross, a mass that is not positive, an inertia that no body has, a rotation that is
            not a unit quaternion, NaN, shapes that disagree.
    """

    parent: Any
    placement: Any
    mass: Any
    centre: Any
    inertia: Any
    slides: Any = False
    lower: Any = -np.inf
    upper: Any = np.inf
    armature: Any = 0.0
    damping: Any = 0.0
    tool: Any = HERE
    table: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        parent = np.asarray(self.parent)
        n = count("len(parent)", parent.size, 1)
        if parent.shape != (n,) or parent.dtype.kind not in "iu":
            raise invalid("parent", self.parent, "a row of integers")
        # Parents come before their children, so a loop over the joints in order goes outwards.
        for i, before in enumerate(parent.tolist()):
            if not -1 <= before < i:
                raise invalid(f"parent[{i}]", before, f"-1 or a joint before {i}")
        result: dict[str, Any] = {
            "parent": parent.astype(np.int64),
            "placement": _poses("placement", self.placement, (7, n)),
            "mass": vector("mass", self.mass, (n,), low=POSITIVE, unit="kg"),
            "centre": vector("centre", self.centre, (3, n), unit="m"),
            "inertia": vector("inertia", self.inertia, (3, 3, n), unit="kg m^2"),
            "tool": _poses("tool", self.tool, (7,)),
        }
        for name, largest in (("slides", 1.0), ("armature", np.inf), ("damping", np.inf)):
            value = vector(name, getattr(self, name), (), (n,), low=0.0, high=largest)
            result[name] = np.broadcast_to(value, (n,))
        result["slides"] = result["slides"] > 0.0
        for name, default in (("lower", -np.inf), ("upper", np.inf)):
            # An infinite limit means none; all others have to be finite numbers.
            free = np.asarray(getattr(self, name)) == default
            value = np.where(free, np.array(0.0, dtype=object), getattr(self, name))
            value = vector(name, value, (), (n,), unit="rad or m")
            result[name] = np.broadcast_to(np.where(free, default, value), (n,))
        for i in np.flatnonzero(result["lower"] > result["upper"]).tolist():
            low, high = float(result["lower"][i]), float(result["upper"][i])
            raise invalid(f"(lower[{i}], upper[{i}])", (low, high), "limits that do not cross")
        # Each inertia must be one that some distribution of mass has.
        result["inertia"] = np.stack(
            [inertia_tensor(result["inertia"][:, :, i]) for i in range(n)], axis=2
        )
        # The class is frozen: checked, read-only copies are set past it.
        for name, value in result.items():
            object.__setattr__(self, name, _frozen(value))
        object.__setattr__(self, "table", _frozen(_table(self)))

    @property
    def n(self) -> int:
        """How many joints."""
        return len(self.parent)

    def path(self, joint: int | None = None) -> list[int]:
        """Return the joints from the base to a joint, or to the tool: those that move it."""
        i = self.n - 1 if joint is None else count("joint", joint, 0, self.n - 1)
        result = []
        while i >= 0:
            result.append(i)
            i = int(self.parent[i])
        return result[::-1]

    @property
    def reach(self) -> tuple[float, float]:
        """Bounds on the distance from the first joint's frame to the tip [m].

        The farthest is the sum of all offsets on the way and of the longest strokes. The nearest is
        what the longest offset has over all others, or 0. No posture is outside.
        """
        joints = self.path()
        offsets = np.linalg.norm(self.placement[:3, joints[1:]], axis=0)
        stroke = np.maximum(np.abs(self.lower), np.abs(self.upper))[joints]
        each = np.concatenate(
            [offsets, stroke[self.slides[joints]], [np.linalg.norm(self.tool[:3])]]
        )
        far = float(each.sum())
        # By the triangle inequality the tip is at least the longest offset less all the others
        # away.
        longest = float(np.max(offsets, initial=each[-1]))
        return (max(0.0, 2.0 * longest - far) if np.isfinite(far) else 0.0), far


def _frozen(value: Array) -> Array:
    # Read-only, since results are cached by chain.
    value = np.ascontiguousarray(value)
    value = value.copy() if value.flags.writeable else value
    value.flags.writeable = False
    return value


def _poses(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = np.array(vector(name, value, shape))
    array[3:] = normalise(unit_quaternion(array[3:], f"{name}[3:]"))
    return array


def _table(chain: Chain) -> Array:
    n = chain.n
    table = np.zeros((n + 1, WIDTH))
    table[:n, PARENT], table[n, PARENT] = chain.parent, n - 1
    table[:n, SLIDES] = chain.slides
    # The tool is one more placement without a joint, in the last row.
    place = np.column_stack([chain.placement, chain.tool])
    table[:, PLACE:TURN] = place.T
    table[:, TURN:TEN] = to_matrix(place[3:]).reshape(9, n + 1).T
    table[:n, TEN] = chain.mass
    table[:n, TEN + 1 : TEN + 4] = (chain.mass * chain.centre).T
    rows, columns = np.triu_indices(3)
    # Steiner: the second moment about the joint's origin.
    square = np.sum(chain.centre**2, axis=0) * np.eye(3)[:, :, None]
    outer = chain.centre[:, None] * chain.centre[None]
    table[:n, TEN + 4 : ARMATURE] = (chain.inertia + chain.mass * (square - outer))[rows, columns].T
    table[:n, ARMATURE], table[:n, DAMPING] = chain.armature, chain.damping
    # No limit is the largest number: a table of finite ones can be the parameters of a system.
    table[:n, LOWER], table[:n, UPPER] = np.nan_to_num(chain.lower), np.nan_to_num(chain.upper)
    return table


def planar(lengths: ArrayLike, masses: ArrayLike | None = None, damping: ArrayLike = 0.0) -> Chain:
    """Return uniform rods in the x-y plane, each joint turning about z.

    The first joint is at the origin.

    Args:
        lengths: of the links, shape (n,), positive [m].
        masses: of the links, shape (n,) [kg]; default: 1 kg a metre.
        damping: viscous, a number or shape (n,) [N m s/rad].

    Raises:
        ValueError: for a length or a mass that is not positive, or shapes that disagree.
    """
    lengths = vector("lengths", lengths, (None,), low=POSITIVE, unit="m")
    n = count("len(lengths)", lengths.size, 1)
    masses = lengths if masses is None else vector("masses", masses, (n,), low=POSITIVE, unit="kg")
    placement = np.zeros((7, n))
    placement[0, 1:], placement[3] = lengths[:-1], 1.0
    centre = np.zeros((3, n))
    centre[0] = 0.5 * lengths
    across = masses * lengths**2 / 12.0
    # About its own axis no link of a planar arm turns: any share does.
    inertia = np.zeros((3, 3, n))
    inertia[0, 0], inertia[1, 1], inertia[2, 2] = 0.01 * across, across, across
    return Chain(
        parent=np.arange(-1, n - 1),
        placement=placement,
        mass=masses,
        centre=centre,
        inertia=inertia,
        damping=damping,
        tool=(lengths[-1], 0, 0, 1, 0, 0, 0),
    )


def _rod(mass: float, line: Array, radius: float) -> Array:
    """Return the inertia of a solid cylinder along `line` about its centre."""
    length = float(np.linalg.norm(line))
    # A rod without length gets the z axis for its direction.
    along = line / length if length else np.array([0.0, 0.0, 1.0])
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return across * np.eye(3) + (0.5 * mass * radius**2 - across) * np.outer(along, along)


def panda() -> Chain:
    """Return a 7-R arm of the size of the Franka Emika Panda.

    Geometry and limits are the published ones (Franka Control Interface, Denavit-Hartenberg
    parameters in Craig's form). The inertias are not: each link is a solid cylinder of 6 cm radius
    from its joint half a link on, with a plausible mass. The tip is the flange.
    """
    # Craig's convention: shift by a and turn by alpha about x, then shift by d along the turned z.
    turns = 0.5 * np.pi * np.array([0, -1, 1, 1, -1, 1, 1])
    along_x = np.array([0, 0, 0, 0.0825, -0.0825, 0, 0.088])
    along_z = np.array([0.333, 0, 0.316, 0, 0.384, 0, 0])
    half = 0.5 * turns
    placement = np.stack(
        [along_x, -np.sin(turns) * along_z, np.cos(turns) * along_z, np.cos(half), np.sin(half)]
        + [np.zeros(7)] * 2
    )
    tool = np.array([0.0, 0.0, 0.107, 1.0, 0.0, 0.0, 0.0])
    mass = np.array([2.9, 2.7, 2.6, 2.6, 2.8, 1.6, 0.8])
    lines = np.column_stack([placement[:3, 1:], tool[:3]])
    lines[2, [0, 4]] = -0.19  # these two links hang below the joint that they end at
    return Chain(
        parent=np.arange(-1, 6),
        placement=placement,
        mass=mass,
        centre=0.5 * lines,
        inertia=np.stack([_rod(m, line, 0.06) for m, line in zip(mass, lines.T, strict=True)], 2),
        lower=[-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973],
        upper=[2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973],
        armature=0.1,
        damping=0.5,
        tool=tool,
    )


def random_chain(n: int, rng: np.random.Generator, tree: bool = False) -> Chain:
    """Return any arm of n joints of both kinds in any direction, with inertias that bodies have.

    In a tree a joint hangs on any earlier one, instead of on the one before.
    """
    count("n", n, 1)

    def poses(k: int) -> Array:
        return np.vstack([rng.normal(0.0, 0.3, (3, k)), normalise(rng.normal(size=(4, k)))])

    parent = np.arange(-1, n - 1)
    if tree:
        parent = np.array([-1, *(int(rng.integers(-1, i)) for i in range(1, n))])
    mass = rng.uniform(0.5, 3.0, n)
    # Three directions of spread, each with a square: the second moments of some body.
    spread = rng.normal(0.0, 0.1, (n, 3, 3))
    second = spread @ spread.transpose(0, 2, 1) + 1e-3 * np.eye(3)
    # I = m (tr(S) 1 - S) for second moments S, which satisfies the triangle inequality.
    inertia = [m * (np.trace(s) * np.eye(3) - s) for m, s in zip(mass, second, strict=True)]
    slides = rng.random(n) < 0.25
    lower = np.where(slides, rng.uniform(-0.5, -0.1, n), rng.uniform(-3.0, -0.5, n))
    upper = np.where(slides, rng.uniform(0.1, 0.5, n), rng.uniform(0.5, 3.0, n))
    return Chain(
        parent=parent,
        placement=poses(n),
        mass=mass,
        centre=rng.normal(0.0, 0.1, (3, n)),
        inertia=np.stack(inertia, axis=2),
        slides=slides,
        lower=lower,
        upper=upper,
        armature=rng.uniform(0.0, 0.1, n),
        damping=rng.uniform(0.0, 0.5, n),
        tool=poses(1)[:, 0],
    )
