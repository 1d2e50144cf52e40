"""Where is the part? From a picture to poses, each with a covariance and a word on its trust.

The chain: table, what stands above it, clusters on the grid of pixels, some starts for each, the
closest points, the choice by what the picture shows, and a last fit along the rays and to the
outline (`outline`), which tells x and y where the faces don't. A residual does not tell a right
pose from a wrong one, since a wrong one also lies on the points. What tells is the picture itself:
it looks through a part that is not there. The covariance, of the six directions in
the part's frame, is that of the fit plus the table that the part stands on, times w^2 where
neighbours share their noise over a window of w pixels: so many measurements count as one.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numba import boolean, int64, types, void
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, vector
from course.compiled import MATRIX, compiled, loop
from course.kinematics.chain import shortest_turn
from course.perception.camera import (
    BOX,
    CYLINDER,
    SPHERE,
    STILL,
    Array,
    Camera,
    Sensor,
    Shapes,
    depth_deviation,
    moved_to,
    numbers,
    render,
    sense,
    shape,
    together,
    view,
)
from course.perception.cloud import (
    back_project,
    components,
    facing,
    heights,
    inverse_depth_plane,
    ransac_plane,
    unproject,
)
from course.perception.linear import times_transposed
from course.perception.outline import border, refine, rows
from course.perception.outline import information as outline_information
from course.perception.registration import (
    DIRECTIONS,
    covariance_of,
    icp,
    known,
    register,
)
from course.perception.tree import NO_TREE
from course.rigid_body.quaternion import (
    conjugate,
    exp,
    from_matrix,
    log,
    product,
    rotate,
    to_matrix,
)

STATUS = ("found", "ambiguous", "cut", "refuted")
FOUND, AMBIGUOUS, CUT, REFUTED = range(4)
NONE = -1  # no start converged
STANDING = ("x", "y", "turn z")

_SIGMAS = 4.0  # of a depth: what is farther off is another thing
_SEES_THROUGH = 0.1  # share of pixels that may look past a pose, or be left over: right ones 0.03
_AGREES = 0.5  # share of a pose's visible pixels that the picture must show where it says
_RIVAL = 0.02  # by how much less another pose may agree, and still be as good an answer
_OFF_OUTLINE = 0.75  # root mean square distance of border and outline; 0.25 if right [pixels]
_DISTINCT = math.radians(5.0)
_SAMPLE = 400  # points of a cluster that the starts are tried with


@dataclass(frozen=True, eq=False)
class Estimate:
    """One answer of `locate`; `pose` is R and p as (7,), in the camera's frame.

    Attributes:
        R, p: (3, 3) and (3,) [m].
        covariance: of the directions `DIRECTIONS` in the part's frame, (6, 6) [m, rad].
        matched: share of the cluster's points that lie on the part.
        residual: root mean square distance of its points along the normals [m].
        see_through: share of the pixels of this pose where the picture looks past it.
        agrees: share of the pixels, of pose or cluster, where both say the same.
        unobserved: names of the directions that the image does not constrain.
        status: one of `STATUS`. Cut: it reaches the picture's edge, so what is missing is not seen;
            ambiguous: another pose, not the same by symmetry, agrees as well, or a shift is
            unobserved, or a tenth of what is seen does not agree with it, or its border is off the
            outline by three quarters of a pixel in the root mean square: there is more than the
            part, or it is of another size.
    """

    R: Array
    p: Array
    covariance: Array
    matched: float
    residual: float
    see_through: float
    agrees: float
    unobserved: tuple[str, ...]
    status: str

    @property
    def pose(self) -> Array:
        """Position and unit quaternion in one array, shape (7,)."""
        return np.concatenate((self.p, from_matrix(self.R)))


# --- Symmetry -------------------------------------------------------------------------------------

# The 24 rotations of a cube, and as quaternions (4, 24).
_CUBE = np.array(
    [
        R
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
        if np.linalg.det(R := np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0.0
    ]
)
_TURNS = from_matrix(np.moveaxis(_CUBE, 0, 2))


def pose_distance(part: Shapes, a: ArrayLike, b: ArrayLike) -> tuple[float, float]:
    """Return how far two poses of a part are from each other, the least over its symmetries.

    A box looks the same after half turns, or quarter turns where two sides are equal; a cylinder
    after any turn about its axis, and upside down; a sphere after any. Of several shapes together
    no symmetry is assumed.

    Args:
        part: about its own origin.
        a: pose, shape (7,).
        b: pose, shape (7,).

    Returns:
        Distance of the origins [m] and least angle [rad].
    """
    return apart(numbers(part), vector("a", a, (7,)), vector("b", b, (7,)))


@register_jitable
def apart(part, a, b):
    """Return distance and angle of two poses (7,) as `pose_distance`, of a part as numbers."""
    shift = b[:3] - a[:3]
    far = math.sqrt(np.sum(shift * shift))
    turn = product(conjugate(a[3:]), b[3:])
    kind = part.kinds[0] if part.kinds.size == 1 else -1
    if kind == SPHERE:
        return far, 0.0
    if kind == CYLINDER:
        # Only the tilt of the axis counts, in either direction.
        axis = rotate(turn, np.array([0.0, 0.0, 1.0]))
        return far, math.atan2(math.hypot(axis[0], axis[1]), abs(axis[2]))
    turns = turn.reshape(4, 1)
    if kind == BOX:
        # Rotations of the cube that map the box onto itself are its symmetries.
        half = part.sizes[:, 0]
        off = np.abs((np.abs(_CUBE) * half).sum(axis=2) - half)
        off = np.maximum(np.maximum(off[:, 0], off[:, 1]), off[:, 2])
        same = np.flatnonzero(off < 1e-9 * half.max())
        chosen = np.empty((4, same.size))
        for x in range(4):
            chosen[x] = _TURNS[x][same]
        turns = product(chosen, turn)  # as far as the turn followed by it
    # Angle of a quaternion; the absolute value takes the nearer of q and -q.
    sine = np.sqrt(turns[1] * turns[1] + turns[2] * turns[2] + turns[3] * turns[3])
    return far, 2.0 * np.arctan2(sine, np.abs(turns[0])).min()


# --- What the picture says to a pose --------------------------------------------------------------


def verdict(
    z: Array, camera: Camera, sensor: Sensor, shapes: Shapes, cluster: NDArray[np.bool_]
) -> tuple[float, float, float, NDArray[np.bool_]]:
    """Return the share looked through, the share that agrees, both combined, and the mask."""
    through, agree, score, exact = judge(z, camera, sensor, numbers(shapes), cluster)
    return through, agree, score, exact > 0.0


@register_jitable
def judge(z, camera, sensor, shapes, cluster):
    """Return the shares of `verdict`, of shapes as numbers, and their exact image (H, W) [m]."""
    exact, _ = view(shapes, camera)
    # A pixel disagrees if it is off by more than the noise allows: farther means that the sensor
    # looks through the supposed part, nearer that something hides it.
    allowed = _SIGMAS * depth_deviation(exact, camera, sensor) + 1e-3
    counts = np.zeros(4, np.int64)
    _compare_loop(z, exact, allowed, cluster, counts)
    pixels, through, hidden, both = counts[0], counts[1], counts[2], counts[3]
    shown, visible = max(1.0 * pixels, 1.0), 1.0 * (pixels - hidden + both)
    agree = 1.0 * (pixels - through - hidden)
    return through / shown, agree / shown, agree / (visible if visible > 0.0 else 1.0), exact


def _compare(z, exact, allowed, cluster, counts):
    """Count pixels with shape and depth, those seen through, hidden, and of the cluster only."""
    for v in range(z.shape[0]):
        for u in range(z.shape[1]):
            if exact[v, u] > 0.0:
                if z[v, u] > 0.0:
                    deviation = z[v, u] - exact[v, u]
                    counts[0] += 1
                    counts[1] += deviation > allowed[v, u]
                    counts[2] += deviation < -allowed[v, u]
            elif cluster[v, u]:
                counts[3] += 1


def see_through(depth: ArrayLike, camera: Camera, sensor: Sensor, shapes: Shapes) -> float:
    """Return the share of the shapes' pixels at which the image shows something behind them.

    Behind means by more than 4 standard deviations of the depth and a millimetre. Pixels where
    something else is in front say nothing. 1 where the shapes are not in the picture.
    """
    z = camera.picture(depth)
    through, agree, _, _ = verdict(z, camera, sensor, shapes, np.zeros(z.shape, bool))
    return float(through) if through + agree > 0.0 else 1.0


@register_jitable
def _at_edge(mask):
    return mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any()


# --- The chain ------------------------------------------------------------------------------------


def _extent(part: Shapes) -> tuple[Array, Array]:
    """Return the least and greatest coordinates of a part in its own frame [m]."""
    if "plane" in part.kinds:
        raise invalid("part.kinds", part.kinds, "a thing with an end: no plane")
    return extent_of(numbers(part))


@register_jitable
def extent_of(part):
    """Return least and greatest coordinates of a part as numbers, in its own frame [m]."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(part.kinds.size):
        size, place, turn = part.sizes[:, i], part.poses[:3, i], to_matrix(part.poses[3:, i])
        reach = np.full(3, size[0])
        # Support in the direction of each axis: a turned box reaches |R| times its half sides, a
        # cylinder's discs add the part of their radius across the axis, a sphere does not turn.
        if part.kinds[i] == BOX:
            reach = (np.abs(turn) * size).sum(axis=1)
        elif part.kinds[i] == CYLINDER:
            axis = turn[:, 2]
            across = np.sqrt(np.maximum(1.0 - axis * axis, 0.0))
            reach = size[1] * np.abs(axis) + size[0] * across
        low, high = np.minimum(low, place - reach), np.maximum(high, place + reach)
    return low, high


@register_jitable
def yaws(part, starts):
    """Return turns about z to start from: evenly over what is not the same by symmetry [rad]."""
    # A part that a turn by one degree leaves the same is round: any turn does.
    for n in (360, 4, 2):
        turned = STILL.copy()
        turned[3:] = exp(np.array([0.0, 0.0, 2.0 * math.pi / n]))
        if apart(part, STILL, turned)[1] < 1e-9:
            return 2.0 * math.pi / n / starts * np.arange(1 if n == 360 else starts)
    return 2.0 * math.pi / starts * np.arange(starts)


def standing_starts(part: Shapes, points: Array, table: Array, starts: int) -> list[Array]:
    """Return poses on the table at turns evenly over what is not the same by symmetry."""
    return standing_at(part, points, table, yaws(numbers(part), starts))


def standing_at(part: Shapes, points: Array, table: Array, yaws: Array) -> list[Array]:
    """Return poses on the table: for each turn the middle of the box around the points."""
    return list(stand(numbers(part), points, table, np.asarray(yaws, dtype=float)))


@register_jitable
def stand(part, points, table, turns):
    """Return as `standing_at`, of a part as numbers, shape (n, 7)."""
    low, high = extent_of(part)
    up = shortest_turn(table[:3])
    # The point of the table below the camera is the origin of the table's frame.
    foot = -table[3] * table[:3]
    flat = rotate(conjugate(up), points - foot.reshape(3, 1))
    poses = np.empty((turns.size, 7))
    for k in range(turns.size):
        q = exp(np.array([0.0, 0.0, turns[k]]))
        inside = rotate(conjugate(q), flat)
        middle = -0.5 * (low + high)
        # Percentiles instead of extremes: a few stray points do not move the box.
        for x in range(2):
            row = np.sort(inside[x])
            middle[x] += 0.5 * (_between(row, 0.02) + _between(row, 0.98))
        middle[2] = -low[2]
        poses[k, :3] = foot + rotate(up, rotate(q, middle))
        poses[k, 3:] = product(up, q)
    return poses


@register_jitable
def _between(row, share):
    """Return the number below which a share of a sorted row lies, between its two neighbours."""
    place = share * (row.size - 1)
    k = int(place)
    return row[k] + (place - k) * (row[min(k + 1, row.size - 1)] - row[k])


def floating_starts(part: Shapes, points: Array, starts: int) -> list[Array]:
    """Return poses anywhere: the principal axes in all their orders, and turned by an eighth."""
    low, high = _extent(part)
    middle = points.mean(axis=1)
    # The visible side is nearer than the middle of the part: start a little farther away.
    away = middle / np.linalg.norm(middle) * 0.25 * float((high - low).min())
    axes = np.linalg.svd(points - middle[:, None])[0]
    # Principal axes may form a mirror image: make them right-handed.
    axes[:, 2] *= np.linalg.det(axes)
    poses: list[Array] = []
    for k, R in itertools.product(range(max(1, starts // 4)), _CUBE):
        turn = exp(np.array([0.0, 0.0, 0.25 * math.pi * k]))
        q = product(from_matrix(axes @ R), turn)
        pose = np.concatenate((middle + away - to_matrix(q) @ (0.5 * (low + high)), q))
        if all(pose_distance(part, pose, other)[1] > _DISTINCT for other in poses):
            poses.append(pose)
    return poses


@register_jitable
def _of_table(points, sigma, table, pose):
    """Return what the table tells about a part that stands on it: height and two tilts, (6, 6)."""
    local = rotate(conjugate(pose[3:]), points - pose[:3].reshape(3, 1))
    # An error along the ray shows in the height by this factor.
    slope = np.abs(heights(table, points) - table[3]) / points[2]
    # Jacobian of the height above the table by the six directions, divided by its deviation.
    J = np.zeros((6, sigma.size))
    J[2] = 1.0 / (sigma * slope)
    J[3], J[4] = local[1] * J[2], -local[0] * J[2]
    return times_transposed(J, J)


def locate(
    depth: ArrayLike,
    camera: Camera,
    sensor: Sensor,
    part: Shapes,
    *,
    table: ArrayLike | None = None,
    standing: bool = True,
    starts: int = 4,
    least: int = 40,
    seed: int = 0,
) -> list[Estimate]:
    """Return every cluster above the table that may be the part, the one that agrees best first.

    Args:
        depth: shape (H, W) [m], 0 where there is no measurement.
        camera: intrinsics of the image.
        sensor: noise and resolution of the depth.
        part: one shape, or several posed in the part's frame.
        table: (nx, ny, nz, d) [m], with the normal to either side: the camera is above it; None
            to find the largest plane.
        standing: whether the part stands on the table with its z up, so that only place and turn
            are free; else it may lie anyhow. A part that leans by 3 degrees and is located as
            standing is mostly reported as "found", although the pose is up to 3 mm off (claim
            `not_looked_through_is_right`). Where parts may lean, pass False.
        starts: turns to start from, evenly over the period of the part.
        least: pixels that a cluster needs.
        seed: of the draws that find the table.

    Returns:
        The estimates; none where nothing stands on the table. One that is refuted, by what the
        picture sees through it or in front of it, says so in its status.

    Raises:
        ValueError: as for `Camera.picture`; for a plane as a part, or a table that is no plane.
    """
    z = camera.picture(depth)
    _extent(part)
    count("starts", starts, 1)
    points, pixels = back_project(z, camera)
    sigma = np.maximum(sensor.sigma(points[2], camera), 1e-7)
    # Find the table, unless it is known.
    if table is None:
        rng = np.random.default_rng(seed)
        some = points[:, rng.integers(0, points.shape[1], min(2000, points.shape[1]))]
        plane, _, _ = ransac_plane(some, _SIGMAS * float(np.median(sigma)) + 1e-3, rng, at_most=200)
    else:
        plane = vector("table", table, (4,))
        if abs(np.linalg.norm(plane[:3]) - 1.0) > 1e-6:
            raise invalid("table", plane, "a normal of unit length, and a distance")
        plane = facing(plane)
    # Refine it by all points near it, then classify what is above.
    for _ in range(2 if table is None else 1):
        slope = np.abs(plane[:3] @ points) / points[2]
        # Height in standard deviations, with a millimetre of tolerance at the threshold.
        height = (plane[:3] @ points + plane[3]) / (sigma * slope + 1e-3 / _SIGMAS)
        on = np.abs(height) < _SIGMAS
        if table is None:
            mask = np.zeros(z.size, bool)
            mask[pixels[on]] = True
            plane = inverse_depth_plane(z, camera, mask.reshape(z.shape))
    above = np.zeros(z.size)
    above[pixels[height > _SIGMAS]] = points[2, height > _SIGMAS]
    # Segment what is above the table: connected pixels of similar depth.
    if not above.any():
        return []
    step = 0.01 + 6.0 * float(np.median(sigma))
    labels = components(above.reshape(z.shape), camera, step)
    on_table = some_of(points[:, on], sigma[on])
    result = []
    for label in np.flatnonzero(np.bincount(labels[labels >= 0]) >= least):
        cluster = labels == label
        best = pose_of(
            z, camera, sensor, part, cluster, plane, on_table, standing=standing, starts=starts
        )
        if best is not None:
            result.append(best)
    return sorted(result, key=lambda one: (one.status == "refuted", -one.agrees))


@register_jitable
def some_of(points: Array, sigma: Array, at_most: int = 2000) -> tuple[Array, Array]:
    """Return every n-th point, and deviations with which these tell as much as all do [m]."""
    n = max(1, sigma.size // at_most)
    some = sigma[::n]
    return points[:, ::n], some * math.sqrt(some.size / max(1, sigma.size))


def pose_of(
    z: Array,
    camera: Camera,
    sensor: Sensor,
    part: Shapes,
    cluster: NDArray[np.bool_],
    table: Array,
    on_table: tuple[Array, Array],
    *,
    standing: bool = True,
    starts: int = 4,
) -> Estimate | None:
    """Return the pose of a cluster with which the image agrees most.

    It returns None if no start converges.

    Args:
        z: the picture, shape (H, W) [m].
        camera: as for `locate`.
        sensor: as for `locate`.
        part: as for `locate`.
        standing: as for `locate`.
        starts: as for `locate`.
        cluster: its pixels, shape (H, W).
        table: the plane, shape (4,).
        on_table: points of it, (3, N), and the deviations of their depths, (N,) [m].
    """
    first = np.empty((0, 7))
    if not standing:
        points, _ = back_project(np.where(cluster, z, 0.0), camera)
        first = np.array(floating_starts(part, points, starts))
    mobile = np.isin(DIRECTIONS, STANDING if standing else DIRECTIONS)
    one = settle(z, camera, sensor, numbers(part), cluster, table, on_table, mobile, starts, first)
    if one.status == NONE:
        return None
    return Estimate(
        R=one.R,
        p=one.p,
        covariance=one.covariance,
        matched=one.matched,
        residual=one.residual,
        see_through=one.through,
        agrees=one.agrees,
        unobserved=tuple(str(name) for name in np.array(DIRECTIONS)[one.blind]),
        status=STATUS[one.status],
    )


class Settled(NamedTuple):
    """What `settle` found, as numbers; see `Estimate`.

    Attributes:
        R, p, covariance, matched, residual, agrees: as of `Estimate`.
        through: as its `see_through`.
        blind: the directions that are not observed, (6,).
        status: number in `STATUS`, or `NONE`.
    """

    R: Array
    p: Array
    covariance: Array
    matched: float
    residual: float
    through: float
    agrees: float
    blind: NDArray[np.bool_]
    status: int


@register_jitable
def _nowhere():
    blind = np.zeros(6, np.bool_)
    return Settled(np.eye(3), np.zeros(3), np.zeros((6, 6)), 0.0, 0.0, 0.0, 0.0, blind, NONE)


@register_jitable
def settle(z, camera, sensor, part, cluster, table, on_table, mobile, starts, poses):
    """Return as `pose_of`, of a part as numbers.

    Args:
        z: as for `pose_of`.
        camera: as for `locate`.
        sensor: as for `locate`.
        part: as numbers.
        cluster: as for `pose_of`.
        table: as for `pose_of`.
        on_table: as for `pose_of`.
        mobile: the directions that are free, (6,); those of `STANDING` for a part that stands.
        starts: turns to start from, for a part that stands.
        poses: where another part starts, shape (n, 7).
    """
    standing = not mobile[2]
    points, _ = unproject(np.where(cluster, z, 0.0), camera)
    if points.shape[1] < 3:
        return _nowhere()
    sigma = np.maximum(depth_deviation(points[2], camera, sensor), 1e-7)
    low, high = extent_of(part)
    last = _SIGMAS * _between(np.sort(sigma), 0.5) + 1e-3
    # Graduated gate: at first a quarter of the part's diagonal, in the end the noise.
    size = high - low
    wide = (max(last, 0.25 * math.sqrt(np.sum(size * size))), last)
    each = max(1, points.shape[1] // _SAMPLE)
    some, spread = points[:, ::each].T.copy(), sigma[::each].copy()
    if standing:
        poses = stand(part, points, table, yaws(part, starts))
    # Coarse registration from all starts, then from three turns of the best of them; ranked by how
    # well the whole picture agrees.
    first = poses.shape[0]
    tried, laid = np.empty((first + 3, 7)), np.zeros(first + 3, np.bool_)
    through, scores, matched = np.zeros(first + 3), np.full(first + 3, -1.0), np.zeros(first + 3)
    best = 0
    for k in range(first + 3):
        if k < first:
            start = poses[k].copy()
        else:
            best = int(scores[:first].argmax())
            if not laid[best]:
                return _nowhere()
            # A part that is nearly the same after a quarter turn: that too has to be worse.
            quarter = 0.5 * math.pi * (k - first + 1)
            start = tried[best].copy()
            start[3:] = product(start[3:], exp(np.array([0.0, 0.0, quarter])))
            again = False
            for other in range(first):
                if laid[other] and apart(part, start, tried[other])[1] <= 0.2 * _DISTINCT:
                    again = True
            if again:
                continue
        fit = register(some, spread, NO_TREE, part, start, wide, mobile, 1, False, 40, 1e-5)
        if fit.matches < 3 and fit.steps == 0:  # nothing within the gate
            continue
        tried[k, :3], tried[k, 3:], laid[k] = fit.p, from_matrix(fit.R), True
        through[k], _, scores[k], _ = judge(z, camera, sensor, moved_to(part, tried[k]), cluster)
        matched[k] = np.count_nonzero(fit.flags > 0) / fit.flags.size
    best = int(scores.argmax())
    pose = tried[best].copy()
    # All that the pose covers, also what is too near the table to be told from it.
    exact, _ = view(moved_to(part, pose), camera)
    covered, _ = unproject(np.where((exact > 0.0) | cluster, z, 0.0), camera)
    # Fine registration of all covered points from the best start.
    spread = np.maximum(depth_deviation(covered[2], camera, sensor), 1e-7)
    source = covered.T.copy()
    # What the faces do not show, the outline does: x and y of a part that is seen from above.
    at, weight, off, residual = border(z, camera, sensor, cluster), 1.0 / sensor.window**2, 0.0, 0.0
    of_points, of_outline = np.zeros((6, 6)), np.zeros((6, 6))
    for _ in range(2):  # points near an edge are chosen again once the edge is known
        fit = register(source, spread, NO_TREE, part, pose, (last, last), mobile, 1, True, 50, 1e-8)
        if not math.isfinite(fit.residual):
            return _nowhere()
        of_points, residual = fit.information, fit.residual
        pose[:3], pose[3:] = fit.p, from_matrix(fit.R)
        pose, of_outline, off = refine(part, pose, mobile, of_points * weight, camera, sensor, at)
    seen, agree, score, exact = judge(z, camera, sensor, moved_to(part, pose), cluster)
    # A different pose that explains the picture about as well makes the answer ambiguous.
    rival = False
    for k in range(first + 3):
        if k != best and laid[k] and scores[k] > scores[best] - _RIVAL:
            shift, turn = apart(part, pose, tried[k])
            different = max(shift / (2.0 * last), turn / _DISTINCT) > 1.0
            rival = rival or (different and through[k] <= _SEES_THROUGH)
    if standing:
        also = _of_table(on_table[0], on_table[1], table, pose)
        if np.all(part.kinds == SPHERE):  # it touches the table in a point, whatever its turn
            also[3:], also[:, 3:] = 0.0, 0.0
        of_points = of_points + also
    # Neighbouring pixels of a stereo window share their noise: fewer independent points.
    covariance, blind = covariance_of(of_points * weight + of_outline, np.ones(6, np.bool_))
    left_over = score < 1.0 - _SEES_THROUGH or off > _OFF_OUTLINE
    status = AMBIGUOUS if rival or left_over or blind[:3].any() else FOUND
    # The worse finding overrules: cut before ambiguous, refuted before all.
    if _at_edge(exact > 0.0) or _at_edge(cluster):
        status = CUT
    if seen > _SEES_THROUGH or agree < _AGREES:
        status = REFUTED
    R, p = to_matrix(pose[3:]), pose[:3].copy()
    return Settled(R, p, covariance, matched[best], residual, seen, score, blind, status)


def stand_in(
    camera: Camera, sensor: Sensor, part: Shapes, places: ArrayLike, *, standing: bool = True
) -> tuple[Array, Array]:
    """Return the predicted bias and standard deviation of `locate`.

    The bias is that of an image without noise.

    The spread is that of the exact picture's information, and of its outline against the table
    where the part stands on one. What averaging does not remove are the sensor's steps: of the
    error that they make without noise exp(-2 pi^2 (noise / step)^2) is left (Widrow and Kollar,
    Quantization Noise, 2008, ch. 4). A part that is alone in the picture.

    Args:
        camera: as for `locate`.
        sensor: as for `locate`.
        part: as for `locate`.
        places: poses in the camera's frame, shape (7, N).
        standing: whether the part stands on a table that is known, and with it height and tilts.

    Returns:
        Bias (6, N) and covariance (6, 6, N) of `DIRECTIONS` in the part's frame [m, rad]; infinite
        variance where nothing is seen.
    """
    poses = vector("places", places, (7, None))
    foot = _extent(part)[0][2]
    free = STANDING if standing else DIRECTIONS
    moving = np.array([name in free for name in DIRECTIONS])
    bias, covariance = np.zeros((6, poses.shape[1])), np.zeros((6, 6, poses.shape[1]))
    for i, pose in enumerate(poses.T):
        exact, _ = render(part.moved(pose), camera)
        if np.count_nonzero(exact) < 3:
            covariance[:, :, i] = np.diag(np.where(moving, np.inf, 0.0))
            continue
        # A sensor without noise shows the bias that its steps cause.
        coarse = replace(sensor, noise=0.0, dropout=0.0)
        depth = float(np.median(exact[exact > 0.0]))
        steps = max(sensor.step * depth**2 / (camera.fx * sensor.baseline), sensor.unit)
        noise = sensor.noise * depth**2 / (camera.fx * sensor.baseline)
        # Noise dithers the steps. This is its characteristic function at one cycle a step.
        remaining = math.exp(-2.0 * (math.pi * noise / steps) ** 2) if steps else 0.0
        offset = np.zeros(6)
        for picture in (sense(exact, camera, coarse, np.random.default_rng(0)), exact):
            points, _ = back_project(picture, camera)
            sigma = np.maximum(sensor.sigma(points[2], camera), 1e-7)
            gate = _SIGMAS * float(np.median(sigma)) + 1e-3
            fit = icp(points, part, pose, gate=gate, sigma=sigma, free=free)
            if picture is not exact:
                back = conjugate(pose[3:])
                turned = log(product(back, fit.pose[3:]))
                offset = remaining * np.append(rotate(back, fit.p - pose[:3]), turned)
        of_points, of_outline = fit.information / sensor.window**2, np.zeros((6, 6))
        if standing:
            low = np.array([0.0, 0.0, foot, 1.0, 0.0, 0.0, 0.0])
            table = shape("plane", pose=low).moved(pose)
            scene, _ = render(together([table, part.moved(pose)]), camera)
            at = border(scene, camera, sensor, exact > 0.0)
            of_outline, _ = outline_information(rows(part, pose, camera, sensor, at, 1.0), free)
        covariance[:, :, i], _ = known(of_points + of_outline, free)
        # The points alone would be off by this; the outline, which has no steps, holds against it.
        finite = np.isfinite(np.diag(covariance[:, :, i]))
        share = np.where(np.outer(finite, finite), covariance[:, :, i], 0.0) @ of_points
        bias[:, i] = share @ offset
    return bias, covariance


_SIGNATURE = void(
    MATRIX,
    MATRIX,
    MATRIX,
    types.Array(boolean, 2, "C"),
    types.Array(int64, 1, "C"),
)
_compare_loop = loop(_compare, _SIGNATURE)


def warm() -> None:
    """Compile the loop of this file."""
    compiled(_compare, _SIGNATURE)
