"""The outline of a part in a depth image: what the border pixels tell about its pose.

Between a pixel of the part and a neighbour that sees something farther away, the outline of the
part crosses the line between the two pixel centres. The middle of the two is a measurement of the
crossing, and half a pixel is the largest error it can have. Distances to the contour of the model
are residuals of the same form as those of points along their normals (`registration`): the contour
point c with the normal n, perpendicular to the ray, moves with the part, so J = (n, c x n).

The errors of neighbouring border pixels are not independent. Where an edge runs along the rows of
the image all of its pixels are off by the same part of a pixel, and averaging gains nothing. So the
covariance is taken over all shifts of the part by parts of a pixel, for the pose that was found.

Left out, as in `sense`: sensors that smear a border over several pixels, as stereo matching over a
window does. There the border is known less well than is claimed here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import boolean, int64, types, void
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.compiled import MATRIX, VECTOR, compiled, loop
from course.perception.camera import (
    CYLINDER,
    SPHERE,
    Array,
    Camera,
    Sensor,
    Shapes,
    depth_deviation,
    moved_to,
    numbers,
    view,
)
from course.perception.linear import apply, pseudoinverse, row_sums, times_transposed
from course.perception.registration import DIRECTIONS
from course.rigid_body.quaternion import (
    conjugate,
    cross,
    exp,
    log,
    product,
    rotate,
    to_matrix,
)

_CHORDS = 64  # of the part of a cylinder's rim that is outline
_SHIFTS = 8  # by eighths of a pixel, along rows and along columns
_GATES = (8.0, 4.0, 2.0, 1.5, 1.5)  # distance of a border from the contour, step by step [pixels]
_OFF = 3.0  # a border that is farther from the contour counts as this far off [pixels]
_LUCK = 0.25  # share of independent errors that the covariance of the border has at least
_LEAST = 6  # border pixels, to be used
_SIGMAS = 4.0
_TIE = 1e-13  # squared distances at z = 1 that differ by less are equal: at most 3e-7 apart
_ROUNDING = 1e-12  # a direction with less than this share of the largest information has none


class Border(NamedTuple):
    """Pairs of neighbouring pixels, one of the part and one that sees farther.

    Attributes:
        rays: through the middle of each pair, at z = 1, shape (3, N).
        along: 0 for neighbours in a row, 1 for neighbours in a column, shape (N,).
        near, far: depths of the two pixels, shape (N,) [m].
        outside: row and column of the one that sees farther, shape (2, N).
    """

    rays: Array
    along: NDArray[np.int64]
    near: Array
    far: Array
    outside: NDArray[np.int64]


@register_jitable
def border(z: Array, camera: Camera, sensor: Sensor, cluster: NDArray[np.bool_]) -> Border:
    """Return where a cluster of pixels ends in front of something that is farther away.

    Each entry is a pair of neighbouring pixels: one belongs to the cluster, the other does not and
    measures a larger depth. Between the two lies the outline of the part. Three kinds of pairs are
    no outline and are omitted: the neighbour is nearer (it hides the part), one of the two has no
    measurement, or the depths differ by no more than noise explains.

    Args:
        z: depth image, shape (H, W) [m].
        camera: intrinsics of the image.
        sensor: noise of its depths.
        cluster: which pixels belong to the part, shape (H, W).

    Returns:
        The pairs as a `Border`, with one ray through the middle of each pair.
    """
    # A pixel has four neighbours, so there are at most four pairs for each pixel of the cluster.
    pairs = np.empty((4 * np.count_nonzero(cluster), 5), np.int64)
    # The jump must exceed the noise of a difference of two depths: sqrt(2) times that of one.
    allowed = math.sqrt(2.0) * _SIGMAS * depth_deviation(z, camera, sensor) + 1e-3
    n = _pairs_loop(z, cluster, allowed, pairs)
    along, v, u = pairs[:n, 0].copy(), pairs[:n, 1], pairs[:n, 2]
    outside = np.empty((2, n), np.int64)
    outside[0], outside[1] = pairs[:n, 3], pairs[:n, 4]
    # The outline passes between the two pixels: the mean of both, as a ray of the pinhole camera.
    rays = np.ones((3, n))
    rays[0] = (0.5 * (u + outside[1]) - camera.cx) / camera.fx
    rays[1] = (0.5 * (v + outside[0]) - camera.cy) / camera.fy
    # Numba does not index an image with two arrays at once, so the pixels are numbered row by row.
    width = z.shape[1]
    flat = z.ravel()
    return Border(rays, along, flat[v * width + u], flat[outside[0] * width + outside[1]], outside)


def _pairs(z, cluster, allowed, pairs):
    """Write a row of `pairs` for each pair, and return how many there are.

    A row is (along, v, u, a, b): the direction, the pixel (v, u) of the cluster and its neighbour
    (a, b) outside.
    """
    n = 0
    height, width = z.shape
    for side in range(4):  # in rows the neighbour after, and the one before; the same in columns
        along, step = side // 2, 1 - 2 * (side % 2)
        dv, du = step * along, step * (1 - along)
        # Row by row for neighbours in a row, column by column for neighbours in a column.
        for i in range(width if along else height):
            for j in range(height if along else width):
                v, u = (j, i) if along else (i, j)
                a, b = v + dv, u + du
                if not (0 <= a < height and 0 <= b < width):
                    continue
                near, far = z[v, u], z[a, b]
                if cluster[v, u] and not cluster[a, b] and 0.0 < near < far - allowed[a, b]:
                    pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3], pairs[n, 4] = (
                        along,
                        v,
                        u,
                        a,
                        b,
                    )
                    n += 1
    return n


# --- The contour of the model ---------------------------------------------------------------------


# The edges of a box: ends, and the normals of the two faces that meet there.
def _box_edges() -> tuple[Array, Array]:
    ends, faces = [], []
    for axis, sign_a, sign_b in itertools.product(range(3), (1.0, -1.0), (1.0, -1.0)):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        corner = np.zeros((2, 3))
        corner[:, axis], corner[:, a], corner[:, b] = (1.0, -1.0), sign_a, sign_b
        ends.append(corner)
        faces.append(np.stack((sign_a * np.eye(3)[a], sign_b * np.eye(3)[b])))
    return np.stack(ends, axis=2), np.stack(faces, axis=2)


_ENDS, _FACES = _box_edges()


def contour(shapes: Shapes, rays: Array) -> tuple[Array, Array, Array]:
    """Return for each ray the nearest point on the outline of posed shapes, as the camera sees it.

    Args:
        shapes: in the camera's frame, in front of it. Of several the outline of all together.
        rays: at z = 1, shape (3, N).

    Returns:
        Contour points c, shape (3, N) [m]; outward normals n (3, N), perpendicular to the line of
        sight at c; distance of the ray from the contour in the image, (N,), infinite where there
        is no contour.
    """
    return contour_of(numbers(shapes), rays)


@register_jitable
def contour_of(shapes, rays):
    """Return as `contour`, of shapes as numbers."""
    if shapes.kinds.size == 1:
        return _of_shape(shapes, 0, rays)
    n = rays.shape[1]
    best = np.full(n, np.inf)
    points, normals = np.zeros((3, n)), np.zeros((3, n))
    for i in range(shapes.kinds.size):
        c, normal, distance = _of_shape(shapes, i, rays)
        outer = distance < best
        for other in range(shapes.kinds.size):
            if other == i or not outer.any():
                continue
            # Inside the outline of another shape it is no outline of all.
            line = c + 1e-6 * normal
            line = line / np.where(line[2] > 0.0, line[2], 1.0)
            on, across, gap = _of_shape(shapes, other, line)
            outer &= ~(np.isfinite(gap) & ((across * (line - on)).sum(axis=0) < 0.0))
        for x in range(3):
            points[x] = np.where(outer, c[x], points[x])
            normals[x] = np.where(outer, normal[x], normals[x])
        best = np.where(outer, distance, best)
    return points, normals, best


@register_jitable
def _of_shape(shapes, i, rays):
    """Return as `contour`, of one of the shapes."""
    p, size, kind = shapes.poses[:3, i].copy(), shapes.sizes[:, i].copy(), shapes.kinds[i]
    R = to_matrix(shapes.poses[3:, i])
    # The camera's centre in the frame of the shape.
    eye = -apply(R.T, p)
    no_hit = np.zeros(rays.shape), np.zeros(rays.shape), np.full(rays.shape[1], np.inf)
    if kind == SPHERE:
        return _of_sphere(p, size[0], rays) if np.sum(p * p) > size[0] * size[0] else no_hit
    if kind == CYLINDER:
        ends, angles = _cylinder_lines(eye, size[0], size[1])
    else:
        ends, angles = _box_lines(eye, size)
    if ends.size == 0:
        return no_hit
    a, b = apply(R, ends[0]) + p.reshape(3, 1), apply(R, ends[1]) + p.reshape(3, 1)
    # Behind the camera there is no image: give the shape up.
    if min(a[2].min(), b[2].min()) <= 0.0:
        return no_hit
    c, along, distance, which, share = _of_segments(a, b, rays)
    if kind == CYLINDER:  # from the chord of a rim to the rim, where the surface bends
        first, last = angles[0][which], angles[1][which]
        angle = first + share * (last - first)
        ring, tangent = np.empty(c.shape), np.zeros(c.shape)
        ring[0], ring[1] = size[0] * np.cos(angle), size[0] * np.sin(angle)
        ring[2] = (1.0 - share) * ends[0, 2][which] + share * ends[1, 2][which]
        c = apply(R, ring) + p.reshape(3, 1)
        tangent[0], tangent[1] = -np.sin(angle), np.cos(angle)
        along = np.where(first == last, along, apply(R, tangent))
    # The normal is perpendicular to the line of sight and to the contour.
    normal = cross(c, along)
    normal /= np.maximum(np.sqrt((normal * normal).sum(axis=0)), 1e-300)
    # Away from the middle of the shape.
    normal *= np.where(p[0] * normal[0] + p[1] * normal[1] + p[2] * normal[2] > 0.0, -1.0, 1.0)
    return c, normal, distance


@register_jitable
def _box_lines(eye, size):
    """Return the outline of a box in its frame: edges between a face that is seen and one not.

    Returns:
        As `_cylinder_lines`; the angles are 0.
    """
    ends, n = np.empty((2, 3, 12)), 0
    for edge in range(12):
        seen = 0
        for face in range(2):
            # A face is seen if the camera is beyond its plane.
            to_eye = to_face = 0.0
            for x in range(3):
                to_eye += _FACES[face, x, edge] * eye[x]
                to_face += _FACES[face, x, edge] * size[x]
            seen += to_eye > abs(to_face)
        if seen == 1:
            for x in range(3):
                ends[0, x, n] = _ENDS[0, x, edge] * size[x]
                ends[1, x, n] = _ENDS[1, x, edge] * size[x]
            n += 1
    return ends[:, :, :n].copy(), np.zeros((2, n))


@register_jitable
def _cylinder_lines(eye, radius, half):
    """Return the outline of a cylinder in its frame as lines: two along it, chords of its rims.

    A rim is outline where one of side and end is seen there and the other isn't.

    Returns:
        Ends (2, 3, E) [m], and the angles about the axis at both ends (2, E) [rad]; equal for a
        line along the axis.
    """
    distance, towards = np.hypot(eye[0], eye[1]), math.atan2(eye[1], eye[0])
    reach = math.acos(radius / distance) if distance > radius else 0.0  # the side that is seen
    angles, levels, n = np.empty((2, 2 + 2 * _CHORDS)), np.empty((2, 2 + 2 * _CHORDS)), 0
    if reach > 0.0:
        for sign in (-1.0, 1.0):
            angles[:, n] = towards + sign * reach
            levels[0, n], levels[1, n] = half, -half
            n += 1
    # Where the end is hidden, its rim is outline along the side that is seen; where the end is
    # seen, along the hidden side.
    for sign in (1.0, -1.0):
        begin, stop = towards - reach, towards + reach
        if sign * eye[2] > half:
            begin, stop = stop, begin + 2.0 * math.pi
        if stop > begin:
            chords = np.linspace(begin, stop, _CHORDS + 1)
            angles[0, n : n + _CHORDS], angles[1, n : n + _CHORDS] = chords[:-1], chords[1:]
            levels[:, n : n + _CHORDS] = sign * half
            n += _CHORDS
    ends = np.empty((2, 3, n))
    ends[:, 0] = radius * np.cos(angles[:, :n])
    ends[:, 1] = radius * np.sin(angles[:, :n])
    ends[:, 2] = levels[:, :n]
    return ends, angles[:, :n].copy()


@register_jitable
def _of_sphere(p, radius, rays):
    """Return as `contour`, of a sphere: the circle where lines of sight touch it."""
    unit = rays / np.sqrt((rays * rays).sum(axis=0))
    # In the plane of the ray and the middle the touching line has its foot at c.
    far = np.sqrt(np.sum(p * p))
    axis = (p / far).reshape(3, 1)
    across = unit - axis * (axis * unit).sum(axis=0)
    across /= np.maximum(np.sqrt((across * across).sum(axis=0)), 1e-300)
    # Half the opening of the cone of lines of sight that touch the sphere.
    sine = radius / far
    cosine = math.sqrt(1.0 - sine * sine)
    normal = cosine * across - sine * axis
    c = p.reshape(3, 1) + radius * normal
    gap = rays - c / c[2]
    return c, normal, np.sqrt((gap * gap).sum(axis=0))


@register_jitable
def _of_segments(a, b, rays):
    """Return for each ray the nearest point in the image of lines from a to b, shape (3, E).

    Returns:
        Points (3, N) [m]; directions of their lines (3, N); distances in the image (N,); which
        line (N,); how far along it in space (N,), from 0 to 1.
    """
    n = rays.shape[1]
    c, along, distance = np.empty((3, n)), np.empty((3, n)), np.empty(n)
    which, share = np.empty(n, np.int64), np.empty(n)
    lines = np.empty((4, a.shape[1]))
    _segments_loop(a, b, rays, lines, c, along, distance, which, share)
    return c, along, distance, which, share


def _segments(a, b, rays, lines, c, along, distance, which, share):
    # The images of the lines, at z = 1: start and direction.
    for e in range(a.shape[1]):
        for x in range(2):
            lines[x, e] = a[x, e] / a[2, e]
            lines[2 + x, e] = b[x, e] / b[2, e] - lines[x, e]
    for k in range(rays.shape[1]):
        best, nearest, part = math.inf, 0, 0.0
        for e in range(a.shape[1]):
            # Closest point on the line's image.
            x, y, dx, dy = (
                rays[0, k] - lines[0, e],
                rays[1, k] - lines[1, e],
                lines[2, e],
                lines[3, e],
            )
            t = min(1.0, max(0.0, (x * dx + y * dy) / max(dx * dx + dy * dy, 1e-300)))
            square = (x - t * dx) ** 2 + (y - t * dy) ** 2
            # Two edges are equally near where they meet: the first one counts, not rounding.
            if square < best - _TIE:
                best, nearest, part = square, e, t
        # From the share in the image to the share in space (perspective).
        near, far = a[2, nearest], b[2, nearest]
        part = part * near / (far + part * (near - far))
        for x in range(3):
            along[x, k] = b[x, nearest] - a[x, nearest]
            c[x, k] = a[x, nearest] + part * along[x, k]
        distance[k], which[k], share[k] = math.sqrt(best), nearest, part


# --- Its information ------------------------------------------------------------------------------


class Rows(NamedTuple):
    """Residuals of border pixels and how they change with the six directions of the part.

    Attributes:
        residual: distance of the border outside the contour, shape (N,) [m].
        J: shape (6, N).
        pixel: what a pixel along the row or column changes of the residual, shape (N,) [m].
        slope: by how much the crossing moves along it, for a shift of the part by a pixel in u and
            in v, shape (2, N).
    """

    residual: Array
    J: Array
    pixel: Array
    slope: Array


def rows(
    part: Shapes, pose: Array, camera: Camera, sensor: Sensor, at: Border, gate: float
) -> Rows:
    """Return the rows of the outline at a pose.

    A border counts where it crosses the contour at more than 45 degrees, so that each crossing
    counts once, in its row or its column; and where what it hides is behind the contour by more
    than the noise, which it isn't at the foot of a part.

    Args:
        part: about its own origin.
        pose: in the camera's frame, shape (7,).
        camera: intrinsics of the image.
        sensor: noise of its depths.
        at: the border pixels.
        gate: largest distance from the contour [pixels].
    """
    return rows_of(numbers(part), pose, camera, sensor, at, gate)


@register_jitable
def rows_of(part, pose, camera, sensor, at, gate):
    """Return as `rows`, of a part as numbers."""
    c, n, _ = contour_of(moved_to(part, pose), at.rays)
    depth = np.where(c[2] > 0.0, c[2], 1.0)
    # A shift of the line of sight by a pixel, at the depth of the contour.
    right, down = n[0] / camera.fx * depth, n[1] / camera.fy * depth
    pixel = np.where(at.along == 0, right, down)
    other = np.where(at.along == 0, down, right)
    # The middle of the pair of pixels, taken to the depth of the contour.
    residual = (n * (at.rays * depth - c)).sum(axis=0)
    allowed = _SIGMAS * depth_deviation(at.far, camera, sensor) + 1e-3
    used = np.flatnonzero(
        (c[2] > 0.0)
        & (np.abs(pixel) >= np.abs(other))
        & (np.abs(residual) < gate * np.abs(pixel))
        & (at.far > depth + allowed)
    )
    # Into the frame of the part, in which the six directions are defined.
    back, size = conjugate(pose[3:]), used.size
    arm, normal = np.empty((3, size)), np.empty((3, size))
    for x in range(3):
        arm[x], normal[x] = c[x][used] - pose[x], n[x][used]
    arm, normal = rotate(back, arm), rotate(back, normal)
    J, slope = np.empty((6, size)), np.empty((2, size))
    J[:3], J[3:] = normal, cross(arm, normal)
    slope[0], slope[1] = right[used] / pixel[used], down[used] / pixel[used]
    return Rows(residual[used], J, pixel[used], slope)


# Shifts to the middles of 8 x 8 parts of a pixel, shape (2, 64).
_PARTS = (np.arange(_SHIFTS) + 0.5) / _SHIFTS
_SHIFT = np.stack(np.meshgrid(_PARTS, _PARTS)).reshape(2, -1)


def information(of: Rows, free: tuple[str, ...] = DIRECTIONS) -> tuple[Array, Array]:
    """Return the information of the outline, and the motion that it asks for times it.

    With weights 12 / pixel^2, as of errors spread evenly over a pixel, the normal equations are
    H d = g. Over all shifts of the part by parts of a pixel g varies by G, so that its information
    about d is H G^-1 H. Roundings that cancel for this pose alone are luck: G gets a quarter of
    what independent errors leave, H, too.

    Args:
        of: the rows.
        free: the directions that may move; the outline tells nothing of the others.

    Returns:
        Information (6, 6) and what it makes of the residuals, (6,), in the part's frame.
    """
    return weigh(of, np.isin(DIRECTIONS, free))


@register_jitable
def weigh(of, mobile):
    """Return as `information`, with the directions that may move as flags (6,)."""
    # Inverse variance of an error that is spread evenly over one pixel.
    weight = 12.0 / of.pixel**2
    J = of.J * (1.0 * mobile).reshape(6, 1)
    weighted = J * weight
    H = times_transposed(weighted, J)
    g = row_sums(weighted * of.residual)
    # Where the contour would then cross between two pixels, less the rounding to the nearest
    # middle.
    crossing = (
        of.residual / of.pixel
        + _SHIFT[0].reshape(64, 1) * of.slope[0]
        + _SHIFT[1].reshape(64, 1) * of.slope[1]
    )
    wrapped = crossing - np.rint(crossing)
    changes = times_transposed(J, wrapped * (weight * of.pixel))
    G = times_transposed(changes, changes) / changes.shape[1] + _LUCK * H
    # Unit diagonal before the pseudoinverse, so that its threshold does not depend on units.
    scale = _scale(H)
    inner = pseudoinverse(G * np.outer(scale, scale), 1e-9) * np.outer(scale, scale)
    # Both are symmetric, so that a product with a transposed matrix is one with the matrix.
    weighing = times_transposed(H, inner)
    return times_transposed(weighing, H), (weighing * g).sum(axis=1)


@register_jitable
def _scale(H):
    """Return what makes each direction's information 1; 0 where it is only rounding."""
    alone = np.diag(H)
    observed = alone > _ROUNDING * max(alone.max(), 0.0)
    return np.where(observed, 1.0 / np.sqrt(np.where(observed, alone, 1.0)), 0.0)


@register_jitable
def refine(part, pose, mobile, of_points, camera, sensor, at):
    """Return a pose moved to where points and outline agree best, by Gauss-Newton steps.

    The fit of the points counts as a measurement of the pose with its information. Only the
    directions that were free in it move.

    Args:
        part: about its own origin, as numbers.
        pose: of the fit to the points, shape (7,).
        mobile: the directions that were free in it, (6,).
        of_points: its information about the six directions, shape (6, 6).
        camera: intrinsics of the image.
        sensor: noise of its depths.
        at: the border of the part.

    Returns:
        The pose; the information of the outline, (6, 6); the root mean square distance of the
        border from it, about 0.25 where rounding to pixels is all [pixels].
    """
    first, free = pose.copy(), 1.0 * mobile
    pose, of_outline, moved = pose.copy(), np.zeros((6, 6)), np.zeros(6)
    for gate in _GATES:
        lines = rows_of(part, pose, camera, sensor, at, gate)
        if lines.pixel.size < _LEAST:
            return first, np.zeros((6, 6)), 0.0
        of_outline, pull = weigh(lines, mobile)
        both = (of_points + of_outline) * np.outer(free, free)
        scale = _scale(both)
        # Two measurements of one pose: that of the points pulls back by how far the pose has moved.
        right = (pull - (of_points * moved).sum(axis=1)) * scale
        inverse = pseudoinverse(both * np.outer(scale, scale), 1e-9)
        step = scale * (inverse * right).sum(axis=1)
        _move_loop(step, first, pose, moved)
    posed = moved_to(part, pose)
    _, _, distance = contour_of(posed, at.rays)
    # Where a steep side goes on beyond the cluster, towards the foot, is no border.
    exact, _ = view(posed, camera)
    own = exact.ravel()[at.outside[0] * exact.shape[1] + at.outside[1]]
    allowed = _SIGMAS * depth_deviation(own, camera, sensor) + 1e-3
    counts = ~((own > 0.0) & (np.abs(at.far - own) < allowed))
    off = np.minimum(camera.fx * distance[counts], _OFF)
    if off.size == 0:
        return pose, of_outline, 0.0
    return pose, of_outline, math.sqrt(row_sums((off * off).reshape(1, off.size))[0] / off.size)


def _move(step, first, pose, moved):
    """Move a pose by a step; write how far it has then moved from the first one, (6,)."""
    # Right update, in the part's frame: p' = p + R d, R' = R exp(t).
    pose[:3] += rotate(pose[3:], step[:3])
    pose[3:] = product(pose[3:], exp(step[3:]))
    # In the six directions of the first pose.
    back = conjugate(first[3:])
    moved[:3] = rotate(back, pose[:3] - first[:3])
    moved[3:] = log(product(back, pose[3:]))


_SIGNATURES: dict[Callable[..., Any], Any] = {
    _pairs: int64(MATRIX, types.Array(boolean, 2, "C"), MATRIX, types.Array(int64, 2, "C")),
    _segments: void(*6 * (MATRIX,), VECTOR, types.Array(int64, 1, "C"), VECTOR),
    _move: void(VECTOR, VECTOR, VECTOR, VECTOR),
}
_pairs_loop, _segments_loop, _move_loop = (
    loop(each, signature) for each, signature in _SIGNATURES.items()
)


def warm() -> None:
    """Compile the loops of this file."""
    for function, signature in _SIGNATURES.items():
        compiled(function, signature)
