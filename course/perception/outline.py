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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from course.perception.camera import Array, Camera, Sensor, Shapes, render
from course.perception.registration import DIRECTIONS, Fit
from course.rigid_body.quaternion import (
    conjugate,
    exp,
    from_matrix,
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
_ROUNDING = 1e-12  # a direction with less than this share of the largest information has none


@dataclass(frozen=True, eq=False)
class Border:
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


def border(z: Array, camera: Camera, sensor: Sensor, cluster: NDArray[np.bool_]) -> Border:
    """Return the border of a cluster where it hides something that is farther away.

    A border where something nearer cuts the cluster off is no outline of the part, and neither is
    one without a measurement on both sides, or one where the depth goes on without a jump.

    Args:
        z: the image, shape (H, W) [m].
        camera: intrinsics of the image.
        sensor: noise of its depths.
        cluster: pixels of the part, shape (H, W).
    """
    contours = []
    for along in (0, 1):
        depth, mine = (z, cluster) if along == 0 else (z.T, cluster.T)
        for step in (1, 0):  # the neighbour after, and the one before
            inside, outside = (np.s_[:, 1 - s : depth.shape[1] - s] for s in (step, 1 - step))
            near, far = depth[inside], depth[outside]
            # The jump must exceed the noise of a difference of two depths.
            allowed = math.sqrt(2.0) * _SIGMAS * sensor.sigma(far, camera) + 1e-3
            v, u = np.nonzero(mine[inside] & ~mine[outside] & (near > 0.0) & (far > near + allowed))
            middle = (u + 0.5, v) if along == 0 else (v, u + 0.5)
            rays = np.stack(
                (
                    (middle[0] - camera.cx) / camera.fx,
                    (middle[1] - camera.cy) / camera.fy,
                    np.ones(u.size),
                )
            )
            at = np.stack((v, u + step) if along == 0 else (u + step, v))
            contours.append((rays, np.full(u.size, along), near[v, u], far[v, u], at))
    return Border(*(np.concatenate(parts, axis=-1) for parts in zip(*contours, strict=True)))


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
    n = rays.shape[1]
    best = np.full(n, np.inf)
    points, normals = np.zeros((3, n)), np.zeros((3, n))
    candidates = [_of_shape(shapes, i, rays) for i in range(len(shapes.kinds))]
    for i, (c, normal, distance) in enumerate(candidates):
        outer = distance < best
        for other in (k for k in range(len(candidates)) if k != i and outer.any()):
            # Inside the outline of another shape it is no outline of all.
            line = c + 1e-6 * normal
            line = line / np.where(line[2] > 0.0, line[2], 1.0)
            there, across, gap = _of_shape(shapes, other, line)
            outer &= ~(np.isfinite(gap) & (np.sum(across * (line - there), axis=0) < 0.0))
        points[:, outer], normals[:, outer] = c[:, outer], normal[:, outer]
        best[outer] = distance[outer]
    return points, normals, best


def _of_shape(shapes: Shapes, i: int, rays: Array) -> tuple[Array, Array, Array]:
    """Return as `contour`, of one of the shapes."""
    p, R, size = shapes.poses[:3, i], to_matrix(shapes.poses[3:, i]), shapes.sizes[:, i]
    # The camera's centre in the frame of the shape.
    eye = -R.T @ p
    no_hit = np.zeros_like(rays), np.zeros_like(rays), np.full(rays.shape[1], np.inf)
    kind = shapes.kinds[i]
    if kind == "sphere":
        return _of_sphere(p, size[0], rays) if np.linalg.norm(p) > size[0] else no_hit
    if kind == "cylinder":
        ends, angles = _cylinder_lines(eye, size[0], size[1])
    else:  # a box: between a face that is seen and one that isn't
        # A face is seen if the camera is beyond its plane. An edge between a seen and a hidden face
        # is outline.
        visible = np.einsum("kie,i->ke", _FACES, eye) > np.abs(np.einsum("kie,i->ke", _FACES, size))
        ends, angles = _ENDS[..., visible[0] != visible[1]] * size[:, None], np.zeros((2, 0))
    if not ends.size:
        return no_hit
    a, b = (R @ end + p[:, None] for end in ends)
    # Behind the camera there is no image: give the shape up.
    if min(a[2].min(), b[2].min()) <= 0.0:
        return no_hit
    c, along, distance, which, share = _of_segments(a, b, rays)
    if kind == "cylinder":  # from the chord of a rim to the rim, where the surface bends
        first, last = angles[:, which]
        angle = first + share * (last - first)
        zero = np.zeros_like(angle)
        height = (1.0 - share) * ends[0][2, which] + share * ends[1][2, which]
        c = R @ np.stack((size[0] * np.cos(angle), size[0] * np.sin(angle), height)) + p[:, None]
        tangent = R @ np.stack((-np.sin(angle), np.cos(angle), zero))
        along = np.where(first == last, along, tangent)
    # The normal is perpendicular to the line of sight and to the contour.
    normal = np.cross(c.T, along.T).T
    normal /= np.maximum(np.linalg.norm(normal, axis=0), 1e-300)
    normal *= np.where(p @ normal > 0.0, -1.0, 1.0)  # away from the middle of the shape
    return c, normal, distance


def _cylinder_lines(eye: Array, radius: float, half: float) -> tuple[Array, Array]:
    """Return the outline of a cylinder in its frame as lines: two along it, chords of its rims.

    A rim is outline where one of side and end is seen there and the other isn't.

    Returns:
        Ends (2, 3, E) [m], and the angles about the axis at both ends (2, E) [rad]; equal for a
        line along the axis.
    """
    distance, towards = math.hypot(eye[0], eye[1]), math.atan2(eye[1], eye[0])
    reach = math.acos(radius / distance) if distance > radius else 0.0  # the side that is seen
    first, last, heights = [], [], []
    if reach:
        touching = np.array([towards - reach, towards + reach])
        first.append(touching)
        last.append(touching)
        heights.append(np.array([[half, half], [-half, -half]]))
    # Where the end is hidden, its rim is outline along the side that is seen; where the end is
    # seen, along the hidden side.
    for height, end_is_seen in ((half, eye[2] > half), (-half, eye[2] < -half)):
        begin, stop = towards - reach, towards + reach
        if end_is_seen:
            begin, stop = stop, begin + 2.0 * math.pi
        if stop > begin:
            angles = np.linspace(begin, stop, _CHORDS + 1)
            first.append(angles[:-1])
            last.append(angles[1:])
            heights.append(np.full((2, _CHORDS), height))
    if not first:
        return np.zeros((2, 3, 0)), np.zeros((2, 0))
    angles = np.stack((np.concatenate(first), np.concatenate(last)))
    level = np.concatenate(heights, axis=1)
    ends = np.stack((radius * np.cos(angles), radius * np.sin(angles), level), axis=1)
    return ends, angles


def _of_sphere(p: Array, radius: float, rays: Array) -> tuple[Array, Array, Array]:
    """Return as `contour`, of a sphere: the circle where lines of sight touch it."""
    unit = rays / np.linalg.norm(rays, axis=0)
    # In the plane of the ray and the middle the touching line has its foot at c.
    axis = p / np.linalg.norm(p)
    across = unit - axis[:, None] * (axis @ unit)
    across /= np.maximum(np.linalg.norm(across, axis=0), 1e-300)
    # Half the opening of the cone of lines of sight that touch the sphere.
    sine = radius / np.linalg.norm(p)
    cosine = math.sqrt(1.0 - sine * sine)
    normal = cosine * across - sine * axis[:, None]
    c = p[:, None] + radius * normal
    distance = np.linalg.norm(rays - c / c[2], axis=0)
    return c, normal, distance


def _of_segments(
    a: Array, b: Array, rays: Array
) -> tuple[Array, Array, Array, NDArray[np.int64], Array]:
    """Return for each ray the nearest point in the image of lines from a to b, shape (3, E).

    Returns:
        Points (3, N) [m]; directions of their lines (3, N); distances in the image (N,); which
        line (N,); how far along it in space (N,), from 0 to 1.
    """
    # Closest point on each line's image, at z = 1.
    start, end = a[:2] / a[2], b[:2] / b[2]
    line = end - start
    length = np.maximum(np.sum(line * line, axis=0), 1e-300)
    offset = rays[:2, :, None] - start[:, None, :]
    share = np.clip(np.einsum("kne,ke->ne", offset, line) / length, 0.0, 1.0)
    gap = offset - share * line[:, None, :]
    distance = np.sqrt(np.sum(gap * gap, axis=0))
    nearest = distance.argmin(axis=1)
    every = np.arange(rays.shape[1])
    share = share[every, nearest]
    # From the share in the image to the share in space (perspective).
    near, far = a[:, nearest], b[:, nearest]
    share = share * near[2] / (far[2] + share * (near[2] - far[2]))
    return near + share * (far - near), far - near, distance[every, nearest], nearest, share


# --- Its information ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Rows:
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
    c, n, _ = contour(part.moved(pose), at.rays)
    depth = np.where(c[2] > 0.0, c[2], 1.0)
    # A shift of the line of sight by a pixel, at the depth of the contour.
    step = np.stack((n[0] / camera.fx, n[1] / camera.fy)) * depth
    pixel = np.where(at.along == 0, step[0], step[1])
    other = np.where(at.along == 0, step[1], step[0])
    # The middle of the pair of pixels, taken to the depth of the contour.
    middle = at.rays * depth
    residual = np.sum(n * (middle - c), axis=0)
    allowed = _SIGMAS * sensor.sigma(at.far, camera) + 1e-3
    used = (
        (c[2] > 0.0)
        & (np.abs(pixel) >= np.abs(other))
        & (np.abs(residual) < gate * np.abs(pixel))
        & (at.far > depth + allowed)
    )
    c, n, pixel = c[:, used], n[:, used], pixel[used]
    # Into the frame of the part, in which the six directions are defined.
    R = to_matrix(pose[3:])
    m, normal = R.T @ (c - pose[:3, None]), R.T @ n
    J = np.concatenate((normal, np.cross(m.T, normal.T).T))
    return Rows(residual[used], J, pixel, step[:, used] / pixel)


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
    # Inverse variance of an error that is spread evenly over one pixel.
    weight = 12.0 / of.pixel**2
    J = of.J * np.isin(DIRECTIONS, free)[:, None]
    H = (J * weight) @ J.T
    g = (J * weight) @ of.residual
    # Shifts to the middles of 8 x 8 parts of a pixel.
    parts = (np.arange(_SHIFTS) + 0.5) / _SHIFTS
    shift = np.stack(np.meshgrid(parts, parts)).reshape(2, -1)
    # Where the contour would then cross between two pixels, less the rounding to the nearest
    # middle.
    crossing = of.residual / of.pixel + shift.T @ of.slope
    wrapped = crossing - np.rint(crossing)
    changes = (wrapped * weight * of.pixel) @ J.T
    G = changes.T @ changes / len(changes) + _LUCK * H
    # Unit diagonal before the pseudoinverse, so that its threshold does not depend on units.
    scale = _scale(H)
    weighing = H @ (scale[:, None] * np.linalg.pinv(G * np.outer(scale, scale), 1e-9) * scale)
    return weighing @ H, weighing @ g


def _scale(H: Array) -> Array:
    """Return what makes each direction's information 1; 0 where it is only rounding."""
    alone = np.diag(H)
    observed = alone > _ROUNDING * alone.max(initial=0.0)
    return np.where(observed, 1.0 / np.sqrt(np.where(observed, alone, 1.0)), 0.0)


def refine(
    part: Shapes,
    fit: Fit,
    of_points: Array,
    camera: Camera,
    sensor: Sensor,
    at: Border,
) -> tuple[Fit, Array, float]:
    """Return a fit moved to where points and outline agree best, by Gauss-Newton steps.

    The fit of the points counts as a measurement of the pose with its information. Only the
    directions that were free in it move.

    Args:
        part: about its own origin.
        fit: of the points.
        of_points: its information about the six directions, shape (6, 6).
        camera: intrinsics of the image.
        sensor: noise of its depths.
        at: the border of the part.

    Returns:
        The fit; the information of the outline, (6, 6); the root mean square distance of the
        border from it, about 0.25 where rounding to pixels is all [pixels].
    """
    free = np.flatnonzero(np.isin(DIRECTIONS, fit.free))
    block = np.ix_(free, free)
    pose, of_outline, moved = fit.pose, np.zeros((6, 6)), np.zeros(6)
    for gate in _GATES:
        lines = rows(part, pose, camera, sensor, at, gate)
        if lines.pixel.size < _LEAST:
            return fit, np.zeros((6, 6)), 0.0
        of_outline, asked = information(lines, fit.free)
        both = (of_points + of_outline)[block]
        scale = _scale(both)
        # Two measurements of one pose: that of the points pulls back by how far the pose has moved.
        right = (asked - of_points @ moved)[free] * scale
        step = np.zeros(6)
        step[free] = scale * (np.linalg.pinv(both * np.outer(scale, scale), 1e-9) @ right)
        # Right update, in the part's frame: p' = p + R d, R' = R exp(t).
        pose = np.concatenate(
            (pose[:3] + rotate(pose[3:], step[:3]), product(pose[3:], exp(step[3:])))
        )
        # The motion since the fit of the points, in the six directions of that fit.
        back = conjugate(from_matrix(fit.R))
        moved = np.append(rotate(back, pose[:3] - fit.p), log(product(back, pose[3:])))
    _, _, distance = contour(part.moved(pose), at.rays)
    # Where a steep side goes on beyond the cluster, towards the foot, is no border.
    exact, _ = render(part.moved(pose), camera)
    own = exact[at.outside[0], at.outside[1]]
    going_on = (own > 0.0) & (np.abs(at.far - own) < _SIGMAS * sensor.sigma(own, camera) + 1e-3)
    distance = np.minimum(camera.fx * distance[~going_on], _OFF)
    rms = float(np.sqrt(np.mean(distance**2))) if distance.size else 0.0
    return replace(fit, R=to_matrix(pose[3:]), p=pose[:3]), of_outline, rms
