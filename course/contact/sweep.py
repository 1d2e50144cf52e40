"""Time of impact: when do two moving shapes first touch, however large the step.

Shapes move with constant velocity and turn with constant angular velocity, so a test at the ends of
a step may see nothing of a touch in between: that is tunnelling.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, finite, invalid, positive, vector
from course.contact.narrow import measured, paired
from course.contact.shapes import Array, Shape
from course.rigid_body.quaternion import exp, product

_MOST = 500  # advances of one pair


@dataclass(frozen=True)
class Impact:
    """When and where shapes first come within the tolerance of each other, over the batch.

    Attributes:
        time: 0 where they touch at the start, infinite where they don't touch in time [s].
        normal: from a to b at that time, shape (dim,) or (dim, N). NaN where there is no impact or
            the search was cut short.
        point: midway between the nearest points at that time [m], likewise.
        advances: distances that were computed.
        converged: False where the search was cut short: `time` is then safe, but early.
    """

    time: Array
    normal: Array
    point: Array
    advances: NDArray[np.int64]
    converged: NDArray[np.bool_]


def spheres_time_of_impact(offset: ArrayLike, velocity: ArrayLike, reach: ArrayLike) -> Array:
    """Return when two balls touch, in closed form: the first root of |offset + t velocity| = reach.

    Args:
        offset: from one centre to the other, shape (d,) or (d, N) [m].
        velocity: its rate, likewise [m/s].
        reach: the sum of the radii [m].

    Returns:
        Time [s], 0 where they touch already, infinite where they never do.

    Raises:
        ValueError: for a NaN, a reach that is not positive, or arrays of unequal shapes.
    """
    p = vector("offset", offset, (None,), (None, None), unit="m")
    v = vector("velocity", velocity, p.shape, unit="m/s")
    r = vector("reach", reach, (), p.shape[1:], low=POSITIVE, unit="m")
    far, b, a = np.linalg.norm(p, axis=0), np.sum(p * v, axis=0), np.sum(v * v, axis=0)
    # The difference of two squares as a product: near contact no digits cancel.
    c = (far - r) * (far + r)
    # The discriminant b^2 - a c from the distance at which they pass: no digits cancel.
    passing = np.linalg.norm(p - v * (b / np.where(a > 0.0, a, 1.0)), axis=0)
    inside = a * (r - passing) * (r + passing)
    hit = (b < 0.0) & (inside >= 0.0)
    # The first root in the form whose terms have one sign, as b is negative for a hit.
    root = c / np.where(hit, -b + np.sqrt(np.where(hit, inside, 0.0)), 1.0)
    return np.where(c <= 0.0, 0.0, np.where(hit, root, np.inf))


def moved(q: Array, v: Array, t: Array) -> Array:
    """Return poses in space after t seconds of constant velocity and angular velocity.

    Both velocities are in the world frame.
    """
    # Angular velocity in the world: its rotation multiplies from the left.
    return np.concatenate((q[:3] + v[:3] * t, product(exp(v[3:] * t), q[3:])))


def _velocities(name: str, value: ArrayLike, dim: int, n: int) -> Array:
    rows = {2: 3, 3: 6}[dim]
    given = vector(name, value, (rows,), (rows, 1), (rows, n)).reshape(rows, -1)
    # A motion in the plane is vx, vy and a rate about z in space.
    whole = np.zeros((6, n))
    whole[[0, 1, 5] if dim == 2 else slice(6)] = given
    return whole


def time_of_impact(
    a: Shape,
    pose_a: ArrayLike,
    velocity_a: ArrayLike,
    b: Shape,
    pose_b: ArrayLike,
    velocity_b: ArrayLike,
    duration: float,
    tolerance: float = 1e-9,
) -> Impact:
    """Return when two moving shapes first touch, computed with conservative advancement.

    It repeatedly advances time by the current distance divided by an upper bound on the approach
    speed. Within that time the shapes cannot meet, so it never passes a wall, however thin
    (Mirtich, Impulse-based dynamic simulation of rigid body systems, 1996, sec. 2.3).

    Beside a face that turns, the bound can be far above the true approach speed. From a gap of
    1e-7 m the search may then be cut short.

    Args:
        a: first shape; may be a plane that does not turn, unless b is one.
        b: second shape, of the same dimension.
        pose_a: pose of a at the start.
        pose_b: pose of b at the start.
        velocity_a: velocity and angular velocity of a, both in the world, shape (6,) or (6, N); in
            the plane (vx, vy, rate of the angle) [m/s, rad/s].
        velocity_b: the same of b.
        duration: time span to search [s].
        tolerance: distance that counts as touching [m].

    Raises:
        ValueError: as for `distance`; for a turning plane, a duration that is negative, or a
            tolerance that is not positive.
    """
    qa, qb, single = paired(a, pose_a, b, pose_b)
    end, near = finite("duration", duration, 0.0, unit="s"), positive("tolerance", tolerance)
    va = _velocities("velocity_a", velocity_a, a.dim, qa.shape[1])
    vb = _velocities("velocity_b", velocity_b, b.dim, qa.shape[1])
    for name, shape, v in (("velocity_a", a, va), ("velocity_b", b, vb)):
        if shape.name == "plane" and v[3:].any():
            raise invalid(name, v, "one without turning, as a plane is infinite")
    size_a, size_b = (0.0 if shape.name == "plane" else shape.size for shape in (a, b))
    n = qa.shape[1]
    time, advances = np.zeros(n), np.zeros(n, np.int64)
    rows, active = np.full((12, n), np.nan), np.ones(n, bool)
    for _ in range(_MOST):
        # Only the pairs without a result are measured again.
        now = np.flatnonzero(active)
        if not now.size:
            break
        at = moved(qa[:, now], va[:, now], time[now]), moved(qb[:, now], vb[:, now], time[now])
        rows[:, now] = measured(a, at[0], b, at[1])
        advances[now] += 1
        normal, far = rows[1:4, now], rows[0, now]
        # An upper bound on the approach speed: relative velocity along the normal, plus what
        # turning adds.
        closing = np.sum((va - vb)[:3, now] * normal, axis=0)
        for v, size in ((va, size_a), (vb, size_b)):
            closing += size * np.linalg.norm(np.cross(v[3:, now], normal, axis=0), axis=0)
        touching = far <= near
        # Aim at half the tolerance: aiming at 0 would come ever closer and never be there.
        with np.errstate(divide="ignore"):
            step = np.where(closing > 0.0, (far - near / 2.0) / closing, np.inf)
        time[now] = np.where(touching, time[now], time[now] + step)
        # No contact within the duration.
        away = ~touching & (time[now] > end)
        time[now[away]], active[now[touching | away]] = np.inf, False
    hit = np.isfinite(time) & ~active
    place = np.where(hit, (rows[4:7] + rows[7:10]) / 2.0, np.nan)
    facing = np.where(hit, rows[1:4], np.nan)
    pick = 0 if single else slice(None)
    return Impact(
        time[pick], facing[: a.dim, pick], place[: a.dim, pick], advances[pick], ~active[pick]
    )
