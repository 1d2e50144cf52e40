"""The world of the robot: tasks, posts, the camera's image, and the arm as it really is.

The noise of task k comes from seed sequences of k alone, so that every set of parts gets the same
tasks, the same images' noise and the same delays: common random numbers.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drills.robot.records import Array, Cell

GRID = 0.05  # rad, of the map of joint angles
ELBOW = 2.8  # rad, largest bend of the elbow
MARGIN = 0.02  # m, clearance of the postures that count as free on the map
ROOM = 0.065  # m, clearance of the ends of each motion
FEEDER = (-0.15, -0.5, 0.1)  # m, a post that stands in every scene
SCENE, CAMERA, PLANNER, BUS, TIP, ENCODER = range(6)  # streams of random numbers of a task


class Level(NamedTuple):
    """What a level asks of the robot.

    Attributes:
        number: from 1.
        title: a few words.
        breaks: what usually breaks at this level.
        threshold: success rate that the lower confidence bound has to exceed.
        noise: standard deviation of a pixel's depth [m].
        lost_pixels: share of pixels without a measurement.
        marker: standard deviation of the tip's measured position, each axis [m].
        offset: error of the camera's calibration, length [m]; its direction is random.
        latency: from the capture of an image to its arrival [s].
        jitter: largest additional latency [s].
        speed: largest speed of the part [m/s].
        posts: number of additional posts.
        clutter: number of other objects on the table.
        lost: share of images that never arrive.
    """

    number: int
    title: str
    breaks: str
    threshold: float
    noise: float = 0.0
    lost_pixels: float = 0.0
    marker: float = 0.0
    offset: float = 0.0
    latency: float = 0.0
    jitter: float = 0.0
    speed: float = 0.0
    posts: int = 0
    clutter: int = 0
    lost: float = 0.0


class World(NamedTuple):
    """The arm as it really is.

    Attributes:
        lengths, masses: of the links [m, kg].
        damping: viscous friction of each joint [N m s/rad].
        coulomb: dry friction of each joint [N m].
        delay: of a torque, in ticks.
        payload: a point mass at the tip that the robot's programs ignore [kg].
        motor: factor from the commanded torque to the motor's.
        bias: offset of both encoders [rad].
        noise: standard deviation of an encoder's reading [rad].
        transition: speed at which dry friction is tanh(1) of its full size [rad/s].
    """

    lengths: tuple[float, float]
    masses: tuple[float, float]
    damping: tuple[float, float] = (0.0, 0.0)
    coulomb: tuple[float, float] = (0.0, 0.0)
    delay: int = 0
    payload: float = 0.0
    motor: float = 1.0
    bias: float = 0.0
    noise: float = 0.0
    transition: float = 0.01


class Task(NamedTuple):
    """One part to pick up and put into its slot.

    Attributes:
        number, seed: they determine everything random.
        part: position at time 0, shape (2,) [m].
        heading: of its long side [rad].
        velocity: shape (2,) [m/s].
        slot: where it belongs, shape (2,) [m].
        posts: rows (x, y, radius), shape (m, 3) [m].
        clutter: other objects, rows (x, y, heading, half length, half width, height) [m, rad].
        offset: error of the camera's calibration, shape (2,) [m].
        free: which postures of `joint_map` keep a margin to the posts, shape (n, m).
    """

    number: int
    seed: int
    part: Array
    heading: float
    velocity: Array
    slot: Array
    posts: Array
    clutter: Array
    offset: Array
    free: NDArray[np.bool_]

    def at(self, seconds: float) -> Array:
        """Return the position of the part on the belt, shape (2,) [m]."""
        return self.part + seconds * self.velocity


def stream(task_seed: int, number: int, *of: int) -> np.random.Generator:
    """Return the random numbers of one purpose of one task."""
    return np.random.default_rng(np.random.SeedSequence([task_seed, number, *of]))


# --- geometry and dynamics ------------------------------------------------------------------------


def tip_of(lengths: tuple[float, float], q: Array) -> Array:
    """Return the position of the tip, shape (2,) [m]."""
    a, b = float(q[0]), float(q[0] + q[1])
    x = lengths[0] * math.cos(a) + lengths[1] * math.cos(b)
    return np.array([x, lengths[0] * math.sin(a) + lengths[1] * math.sin(b)])


def tip_rate(lengths: tuple[float, float], q: Array, v: Array) -> Array:
    """Return the velocity of the tip, shape (2,) [m/s]."""
    a, b = float(q[0]), float(q[0] + q[1])
    first, second = lengths[0] * float(v[0]), lengths[1] * float(v[0] + v[1])
    x = -first * math.sin(a) - second * math.sin(b)
    return np.array([x, first * math.cos(a) + second * math.cos(b)])


def clearance(lengths: tuple[float, float], posts: Array, q: Array) -> Array:
    """Return the smallest distance from the arm's axis to a post, of each posture.

    Args:
        lengths: of the links [m].
        posts: rows (x, y, radius), shape (m, 3) [m].
        q: shape (n, 2) [rad].

    Returns:
        Shape (n,) [m]; negative where they overlap, infinite without posts.
    """
    angle = np.cumsum(np.atleast_2d(q), axis=1)
    start = np.zeros((len(angle), 2))
    gap = np.full(len(angle), np.inf)
    for i, length in enumerate(lengths):
        unit = np.stack((np.cos(angle[:, i]), np.sin(angle[:, i])), axis=1)
        for x, y, radius in posts:
            offset = np.array([x, y]) - start
            along = np.clip(np.sum(offset * unit, axis=1), 0.0, length)
            away = offset - along[:, None] * unit
            gap = np.minimum(gap, np.hypot(away[:, 0], away[:, 1]) - radius)
        start = start + length * unit
    return gap


def inertia(world: World) -> tuple[float, float, float, float, float]:
    """Return what the equations of motion take from masses and lengths.

    Returns:
        M11 without its share of the elbow's cosine, that share's factor, M22 [kg m^2]; the weights
        of the first link and of the second, over gravity [kg m].
    """
    (l1, l2), (m1, m2), load = world.lengths, world.masses, world.payload
    outer = (m2 / 3.0 + load) * l2 * l2
    bend = (0.5 * m2 + load) * l1 * l2
    base = (m1 / 3.0 + m2 + load) * l1 * l1 + outer
    return base, bend, outer, (0.5 * m1 + m2 + load) * l1, (0.5 * m2 + load) * l2


def acceleration(
    world: World, gravity: float, tau: Array, v: Array, q: Array
) -> tuple[float, float]:
    """Return the joint accelerations under torques, gravity and friction [rad/s^2]."""
    base, bend, m22, first, second = inertia(world)
    v1, v2 = float(v[0]), float(v[1])
    q1, q2 = float(q[0]), float(q[1])
    cosine = bend * math.cos(q2)
    m11, m12 = base + 2.0 * cosine, m22 + cosine
    spin = bend * math.sin(q2)
    outer = gravity * second * math.cos(q1 + q2)
    inner = gravity * first * math.cos(q1)
    drag1 = world.damping[0] * v1 + world.coulomb[0] * math.tanh(v1 / world.transition)
    drag2 = world.damping[1] * v2 + world.coulomb[1] * math.tanh(v2 / world.transition)
    f1 = float(tau[0]) + spin * (2.0 * v1 * v2 + v2 * v2) - inner - outer - drag1
    f2 = float(tau[1]) - spin * v1 * v1 - outer - drag2
    scale = m11 * m22 - m12 * m12
    return (m22 * f1 - m12 * f2) / scale, (m11 * f2 - m12 * f1) / scale


# --- the map of joint angles ----------------------------------------------------------------------


def grid() -> tuple[Array, Array]:
    """Return the angles of both joints at which the map of postures is evaluated [rad]."""
    first = np.arange(-math.pi + 0.5 * GRID, math.pi, GRID)
    return first, np.arange(-ELBOW + 0.5 * GRID, ELBOW, GRID)


def joint_map(cell: Cell, posts: Array, gaps: Callable[..., Array]) -> NDArray[np.bool_]:
    """Return which postures are free, on a grid of joint angles.

    Args:
        cell: with the arm.
        posts: rows (x, y, radius), shape (m, 3) [m].
        gaps: `clearance`, or its compiled form.

    Returns:
        Whether the arm has its margin at each posture of `grid`, shape (n, m).
    """
    first, second = grid()
    q = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    wide = posts + np.array([0.0, 0.0, cell.width + MARGIN])
    free = gaps(cell.lengths, wide, q) > 0.0
    return np.asarray(free.reshape(first.size, second.size))


def shadows(free: NDArray[np.bool_]) -> Array:
    """Return discs that cover the outline of the blocked postures of a map, shape (n, 3) [rad]."""
    first, second = grid()
    near = np.zeros_like(free)
    near[1:] |= free[:-1]
    near[:-1] |= free[1:]
    near[:, 1:] |= free[:, :-1]
    near[:, :-1] |= free[:, 1:]
    i, j = np.nonzero(~free & near)
    return np.column_stack((first[i], second[j], np.full(i.size, 0.75 * GRID)))


def postures(lengths: tuple[float, float], target: Array) -> Array:
    """Return both postures that reach a position, by the law of cosines; no rows if none does."""
    l1, l2 = lengths
    bend = (float(target @ target) - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
    if not -1.0 < bend < 1.0:
        return np.zeros((0, 2))
    rows = []
    for q2 in (math.acos(bend), -math.acos(bend)):
        aside = math.atan2(l2 * math.sin(q2), l1 + l2 * math.cos(q2))
        rows.append([math.remainder(math.atan2(target[1], target[0]) - aside, math.tau), q2])
    return np.array(rows)


def _solvable(cell: Cell, posts: Array, free: NDArray[np.bool_], ends: list[Array]) -> bool:
    """Return whether one region of free postures holds the home and a posture of each end."""

    def cell_of(q: Array) -> tuple[int, int]:
        i = min(max(int((q[0] + math.pi) / GRID), 0), free.shape[0] - 1)
        return i, min(max(int((q[1] + ELBOW) / GRID), 0), free.shape[1] - 1)

    wide = posts + np.array([0.0, 0.0, cell.width])
    reached = np.zeros_like(free)
    reached[cell_of(np.array(cell.home))] = True
    # Flood from the home until nothing changes.
    size = 0
    while size != (size := int(reached.sum())):
        for _ in range(8):
            grown = reached.copy()
            grown[1:] |= reached[:-1]
            grown[:-1] |= reached[1:]
            grown[:, 1:] |= reached[:, :-1]
            grown[:, :-1] |= reached[:, 1:]
            reached = grown & free
    for end in ends:
        fitting = [
            q
            for q in postures(cell.lengths, end)
            if abs(q[1]) < ELBOW - 0.1
            and clearance(cell.lengths, wide, q)[0] > ROOM
            and reached[cell_of(q)]
        ]
        if not fitting:
            return False
    return bool(clearance(cell.lengths, wide, np.array(cell.home))[0] > ROOM)


def make_task(
    cell: Cell,
    level: Level,
    seed: int,
    number: int,
    gaps: Callable[..., Array] = clearance,
) -> Task:
    """Return task k: the same whichever parts are in the robot.

    Args:
        cell: the robot's cell.
        level: what it asks.
        seed: of all tasks.
        number: k, from 0.
        gaps: `clearance`, or its compiled form.
    """
    rng = stream(seed, number, SCENE)
    while True:
        part = np.array([rng.uniform(0.52, 0.68), rng.uniform(0.08, 0.22)])
        slot = np.array([rng.uniform(-0.72, -0.52), rng.uniform(0.10, 0.38)])
        heading, direction = rng.uniform(-1.5, 1.5), rng.uniform(1.2, 1.9)
        velocity = level.speed * rng.uniform(0.5, 1.0)
        bearing = rng.uniform(0.0, math.tau)
        angles = np.concatenate(([rng.uniform(1.2, 1.9)], rng.uniform(0.8, 2.3, 3)))
        radii = np.concatenate(([rng.uniform(0.62, 0.70)], rng.uniform(0.66, 0.85, 3)))
        sizes = np.concatenate(([0.05], rng.uniform(0.02, 0.035, 3)))
        spots = rng.uniform(-1.0, 1.0, (4, 2))
        turns, lows = rng.uniform(-1.5, 1.5, 4), rng.random(4)
        n = 1 + level.posts
        posts = np.column_stack((radii * np.cos(angles), radii * np.sin(angles), sizes))[:n]
        posts = np.vstack((posts, FEEDER))
        speed = velocity * np.array([math.cos(direction), math.sin(direction)])
        ends = (
            [part, slot] if not velocity else [part, part + 2.0 * speed, part + 4.0 * speed, slot]
        )
        free = joint_map(cell, posts, gaps)
        if not _solvable(cell, posts, free, ends):
            continue
        clutter: list[list[float]] = []
        for (x, y), turn, low in zip(spots, turns, lows, strict=True):
            place = np.array([0.6 + 0.16 * x, 0.2 + 0.24 * y])
            # Flat or tall, never of the part's height; clear of the part's path.
            height = 0.022 if low < 0.5 else 0.07
            path = [part + t * speed for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)]
            away = min(math.dist(place, p) for p in path)
            others = [math.dist(place, row[:2]) for row in clutter]
            if away > 0.15 and all(d > 0.13 for d in others) and len(clutter) < level.clutter:
                clutter.append([*place, turn, 0.03 + 0.01 * low, 0.025, height])
        offset = level.offset * np.array([math.cos(bearing), math.sin(bearing)])
        rows = np.array(clutter).reshape(-1, 6)
        return Task(number, seed, part, heading, speed, slot, posts, rows, offset, free)


# --- the camera -----------------------------------------------------------------------------------


@functools.cache
def _faces(half: tuple[float, float], top: tuple[float, float], height: float) -> Array:
    """Return the planes n . x <= d of a body with sloped sides, rows (nx, ny, nz, d)."""
    (a, b), (c, d) = half, top
    rows = [[0.0, 0.0, 1.0, height], [0.0, 0.0, -1.0, 0.0]]
    for sign in (1.0, -1.0):
        rows.append([sign * height, 0.0, a - c, a * height])
        rows.append([0.0, sign * height, b - d, b * height])
    planes = np.array(rows)
    return np.asarray(planes / np.linalg.norm(planes[:, :3], axis=1)[:, None])


@functools.cache
def rays_of(cell: Cell) -> Array:
    """Return the direction of each pixel's ray in the base, of depth 1, shape (3, n)."""
    v, u = np.mgrid[: cell.pixels[0], : cell.pixels[1]].reshape(2, -1)
    (fx, fy), (cx, cy) = cell.focal, cell.axis
    rays = np.array([(u - cx) / fx, (v - cy) / fy, np.ones(u.size)])
    return np.asarray(np.array(cell.turn).reshape(3, 3) @ rays)


def render(cell: Cell, level: Level, task: Task, frame: int, seconds: float) -> Array:
    """Return the depth picture of the table, the part and the clutter in counts.

    The arm is not in it, as a robot masks its own arm.

    Args:
        cell: with the camera.
        level: its noise.
        task: the scene.
        frame: number of the image, which determines its noise.
        seconds: time of the capture [s].
    """
    rays, eye = rays_of(cell), eye_of(cell, task)
    depth = np.full(rays.shape[1], eye[2]) / -rays[2]
    for x, y, turn, planes in bodies_of(cell, task, seconds):
        c, s = math.cos(turn), math.sin(turn)
        R = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        start, along = R @ (eye - np.array([x, y, 0.0])), R @ rays
        # Clip the ray by each plane: the last entry before the first exit.
        slope = planes[:, :3] @ along
        reach = planes[:, 3] - planes[:, :3] @ start
        with np.errstate(divide="ignore"):
            at = reach[:, None] / slope
        entry = np.where(slope < 0.0, at, -np.inf).max(axis=0)
        leave = np.where(slope > 0.0, at, np.inf).min(axis=0)
        depth = np.where(entry <= leave, np.minimum(depth, entry), depth)
    return sense(cell, level, task, frame, depth)


def eye_of(cell: Cell, task: Task) -> Array:
    """Return where the camera really is, shape (3,) [m]."""
    return np.asarray(np.array(cell.camera) + np.append(task.offset, 0.0))


def bodies_of(cell: Cell, task: Task, seconds: float) -> list[tuple[float, float, float, Array]]:
    """Return what lies on the table: x, y, heading, and the planes of its faces in its frame."""
    x, y = task.at(seconds)
    bodies = [(float(x), float(y), task.heading, _faces(cell.base, cell.top, cell.height))]
    for x, y, turn, long, wide, height in task.clutter.tolist():
        box = _faces((long, wide), (0.9 * long, 0.9 * wide), height)
        bodies.append((x, y, turn, box))
    return bodies


def sense(cell: Cell, level: Level, task: Task, frame: int, depth: Array) -> Array:
    """Return the picture in counts, with noise and lost pixels, of exact depths (n,) [m]."""
    rng = stream(task.seed, task.number, CAMERA, frame)
    depth = depth + level.noise * rng.standard_normal(depth.size)
    # Of the pixels without a measurement some hold 0, some NaN.
    lost = rng.random(depth.size)
    depth[lost < level.lost_pixels] = 0.0
    depth[lost < 0.3 * level.lost_pixels] = math.nan
    return (depth / cell.unit).reshape(cell.pixels)


def triples(cell: Cell, task: Task, frame: int, count: int = 40) -> NDArray[np.int64]:
    """Return the random triples of an image, as fractions of its points scaled to 2^31."""
    rng = stream(task.seed, task.number, CAMERA, frame, 1)
    return rng.integers(0, 1 << 31, (count, 3))


def make_latency(level: Level, task: Task, frame: int) -> float:
    """Return the latency of an image [s]; infinite where it never arrives."""
    rng = stream(task.seed, task.number, BUS, frame)
    lost, extra = rng.random(2)
    return math.inf if lost < level.lost else level.latency + level.jitter * float(extra)


def marker_noise(level: Level, task: Task, frame: int) -> Array:
    """Return the error of the tip's measured position in an image, shape (2,) [m]."""
    return level.marker * stream(task.seed, task.number, TIP, frame).standard_normal(2)
