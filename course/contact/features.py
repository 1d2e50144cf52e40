"""Faces, edges and corners: manifolds, and distances by looking at every feature.

A contact of two faces is not one point: a box that rests on its lowest corner alone would tip. And
where there are few features, trying all of them is a check that shares nothing with the search.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import int64
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid
from course.compiled import MATRIX, VECTOR, compiled
from course.contact.broad import overlapping_pairs
from course.contact.narrow import measured, paired, rotation, turned_back
from course.contact.shapes import Array, Shape, bounds_in_space, corners_in_space
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import poses

_FACE = 1.0 - 1e-6  # cosine from which a normal counts as that of a face: 0.08 degrees


# --- every feature --------------------------------------------------------------------------------


def _edges(shape: Shape, R: Array) -> list[Array]:
    """Return half edges of the core in the world, one a direction, each of shape (3, N)."""
    return [shape.half[k] * R[:, k] for k in np.flatnonzero(shape.half)]


def _simple(name: str, shape: Shape) -> None:
    if shape.name not in ("box", "capsule", "sphere"):
        raise invalid(name, shape.name, "a box, a capsule or a sphere")


def separating_axes(
    a: Shape, pose_a: ArrayLike, b: Shape, pose_b: ArrayLike
) -> tuple[Array, Array]:
    """Return the most that any candidate axis separates two boxes, capsules or spheres.

    The candidates are the normals of the faces of the set of differences, which are the products of
    any two edges (Gottschalk, Lin and Manocha, OBBTree, 1996). Below zero the result is the depth
    of two boxes exactly; above, it only says that they are apart, and not by how much.

    Returns:
        Separation [m], shape (N,), and the axis, a unit vector from a to b, shape (dim, N).

    Raises:
        ValueError: as for `distance`, for other shapes, and where all edges are parallel or there
            are none, as of two parallel capsules or two spheres.
    """
    _simple("a", a)
    _simple("b", b)
    qa, qb, _ = paired(a, pose_a, b, pose_b)
    edges = _edges(a, to_matrix(qa[3:])) + _edges(b, to_matrix(qb[3:]))
    between = qb[:3] - qa[:3]
    across = edges if a.dim == 3 else [*edges, np.zeros_like(between) + [[0.0], [0.0], [1.0]]]
    best, axis = np.full(qa.shape[1], -np.inf), np.zeros_like(between)
    # Candidate axes: the face normals are products of edges of the same box, the rest are products
    # of an edge of each (Gottschalk, Lin and Manocha, 1996).
    for i, first in enumerate(across):
        for second in across[i + 1 :]:
            n = np.cross(first, second, axis=0)
            length = np.linalg.norm(n, axis=0)
            sizes = np.linalg.norm(first, axis=0) * np.linalg.norm(second, axis=0)
            # Parallel edges have no axis; a length of rounding size would be normalised noise.
            real = length > 1e-12 * sizes
            n = np.where(real, n / np.where(real, length, 1.0), 0.0)
            along = np.sum(n * between, axis=0)
            reach = np.sum([np.abs(np.sum(n * edge, axis=0)) for edge in edges], axis=0)
            separation = np.where(real, np.abs(along) - reach, -np.inf)
            axis = np.where(separation > best, np.where(along < 0.0, -n, n), axis)
            best = np.maximum(best, separation)
    if not np.isfinite(best).all():
        raise invalid("a, b", f"{a.name}, {b.name}", "shapes with two edges that are not parallel")
    return best - a.radius - b.radius, axis[: a.dim]


def _segments(shape: Shape, q: Array) -> tuple[Array, Array]:
    """Return ends of the edges of the core in the world, each (3, n, N)."""
    corners, own = corners_in_space(shape, q), shape.corners
    ends = [
        (i, j)
        for i in range(own.shape[1])
        for j in range(i + 1, own.shape[1])
        if np.count_nonzero(own[:, i] != own[:, j]) == 1
    ]
    first, last = ([pair[k] for pair in ends] for k in (0, 1))
    return corners[:, first], corners[:, last]


def enumerated(a: Shape, pose_a: ArrayLike, b: Shape, pose_b: ArrayLike) -> Array:
    """Return the signed distance of two boxes, capsules or spheres from all pairs of features.

    Apart, the nearest points are a corner and a shape, or two edges; in each other the separating
    axes give the depth. It takes 144 pairs of edges for two boxes, and no search.

    Returns:
        Signed distances [m], shape (N,).

    Raises:
        ValueError: as for `separating_axes`.
    """
    inside, _ = separating_axes(a, pose_a, b, pose_b)
    qa, qb, _ = paired(a, pose_a, b, pose_b)
    nearest = np.full(qa.shape[1], np.inf)
    # Vertex against face: clamp each corner of one box to the other.
    for one, q, other, p in ((a, qa, b, qb), (b, qb, a, qa)):
        offset = corners_in_space(one, q) - p[:3, None]
        local = np.einsum("jin,jkn->ikn", to_matrix(p[3:]), offset)
        beyond = local - np.clip(local, -other.half[:, None, None], other.half[:, None, None])
        nearest = np.minimum(nearest, np.linalg.norm(beyond, axis=0).min(axis=0))
    (p0, p1), (q0, q1) = _segments(a, qa), _segments(b, qb)
    if p0.shape[1] and q0.shape[1]:
        d, e = np.broadcast_arrays((p1 - p0)[:, :, None], (q1 - q0)[:, None])
        r = p0[:, :, None] - q0[:, None]
        # Normal equations for the nearest points of two lines (Ericson, Real-Time Collision
        # Detection, 2005).
        dd, de, ee, dr, er = ((x * y).sum(0) for x, y in ((d, d), (d, e), (e, e), (d, r), (e, r)))
        # Inner points of both edges; where an end is nearest, that is a corner, tried above.
        det = dd * ee - de * de
        parallel = det <= 1e-14 * dd * ee
        safe = np.where(parallel, 1.0, det)
        s, t = (de * er - dr * ee) / safe, (dd * er - de * dr) / safe
        inner = ~parallel & (s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)
        gap = np.linalg.norm(r + s * d - t * e, axis=0)
        nearest = np.minimum(nearest, np.where(inner, gap, np.inf).min(axis=(0, 1)))
    # Cores apart: the nearest features decide. Cores in each other: the separating axes do.
    return np.where(inside > -a.radius - b.radius, nearest - a.radius - b.radius, inside)


# --- contacts -------------------------------------------------------------------------------------


@register_jitable
def _clip(polygon, n, c, sign, limit, other):
    """Clip a polygon to sign * coordinate c <= limit and return how many corners remain.

    (Sutherland and Hodgman, 1974.)
    """
    retained = 0
    near = 1e-10 * limit  # a corner on the line is cut once, and not a second time beside it
    for i in range(n):
        j = (i + 1) % n
        # Signed heights of the edge's two ends above the clipping line.
        here, far_end = sign * polygon[i, c] - limit, sign * polygon[j, c] - limit
        inside, cut = here <= near, min(here, far_end) < -near and max(here, far_end) > near
        if inside:
            for k in range(3):
                other[retained, k] = polygon[i, k]
            retained += 1
        if cut:
            share = here / (here - far_end)
            for k in range(3):
                other[retained, k] = polygon[i, k] + share * (polygon[j, k] - polygon[i, k])
            retained += 1
    for i in range(retained):
        for k in range(3):
            polygon[i, k] = other[i, k]
    return retained


@register_jitable
def _facing(axes, n):
    """Return the axis of a rotation matrix that n is most along, and its component."""
    best, largest = 0, 0.0
    for k in range(3):
        along = axes[k] * n[0] + axes[3 + k] * n[1] + axes[6 + k] * n[2]
        if abs(along) > abs(largest):
            best, largest = k, along
    return best, largest


def _box_contacts(halves, near, qa, qb, numbers, out):
    """Return contacts of boxes: the face of one cut by the sides of the other's, or a single point.

    Args:
        halves: of a and of b, shape (2, 3) [m].
        near: rows of `measure` for each pair, shape (12, N).
        qa: poses of a, shape (7, N).
        qb: poses of b, shape (7, N).
        numbers: radius of a, of b, margin [m], dimensions.
        out: which pair, point, normal, distance, shape (8, 8 N).

    Returns:
        How many contacts there are.
    """
    result = 0
    polygon, other, axes = np.empty((12, 3)), np.empty((12, 3)), np.empty((2, 9))
    for i in range(near.shape[1]):
        if near[0, i] > numbers[2]:
            continue
        first = result
        m = near[1, i], near[2, i], near[3, i]
        rotation((qa[3, i], qa[4, i], qa[5, i], qa[6, i]), axes[0], 0)
        rotation((qb[3, i], qb[4, i], qb[5, i], qb[6, i]), axes[1], 0)
        # Choose the reference face: the one that the contact normal fits best.
        (f, of_a), (g, of_b) = _facing(axes[0], m), _facing(axes[1], m)
        if max(abs(of_a), abs(of_b)) >= _FACE:
            # The face that the normal belongs to, a's where both do, and the other's that meets it.
            r = 0 if abs(of_a) >= abs(of_b) - 1e-9 else 1
            if r == 1:
                f, of_a = g, -of_b
            R, S = axes[r], axes[1 - r]
            up = math.copysign(1.0, of_a)
            normal = (up * R[f], up * R[3 + f], up * R[6 + f])
            # The incident face: the one of the other box that faces the reference face most
            # squarely.
            g, of_b = _facing(S, normal)
            u, v, top = (f + 1) % 3, (f + 2) % 3, halves[r, f]
            side = 1.0 - 2.0 * r
            # Write the incident face's corners into the frame of the reference face.
            for corner in range(4):
                x, y, z = qb[0, i] - qa[0, i], qb[1, i] - qa[1, i], qb[2, i] - qa[2, i]
                x, y, z = side * x, side * y, side * z
                for k in range(3):
                    step = math.copysign(halves[1 - r, k], -of_b)
                    if k == (g + 1) % 3:
                        step = math.copysign(step, 1.5 - corner)
                    elif k != g:
                        step = math.copysign(step, 1.0 if corner in (0, 3) else -1.0)
                    x, y, z = x + step * S[k], y + step * S[3 + k], z + step * S[6 + k]
                local = turned_back(R, 0, (x, y, z))
                polygon[corner, 0], polygon[corner, 1] = local[u], local[v]
                polygon[corner, 2] = up * local[f] - top
            count = 4
            # Clip the incident face at the four side planes of the reference face.
            for edge in range(4):
                limit = halves[r, u if edge < 2 else v]
                count = _clip(polygon, count, edge // 2, 1.0 - 2.0 * (edge % 2), limit, other)
            # Keep what is within the margin of the reference face; its height is the distance.
            for j in range(count):
                s, t = polygon[j, 0], polygon[j, 1]
                far = polygon[j, 2] - numbers[0] - numbers[1]
                if far > numbers[2]:
                    continue
                if numbers[3] == 2.0:
                    # In the plane the boxes are bars about z = 0: one end stands for both.
                    if (s if u == 2 else t) < 0.0:
                        continue
                    s, t = (0.0, t) if u == 2 else (s, 0.0)
                out[0, result], out[7, result] = i, far
                for c in range(3):
                    # Midway between the two surfaces.
                    place = s * R[3 * c + u] + t * R[3 * c + v]
                    place += (top + numbers[r] + far / 2.0) * normal[c]
                    out[1 + c, result] = place + (qb[c, i] if r == 1 else qa[c, i])
                    out[4 + c, result] = side * normal[c]
                result += 1
        # Nothing remained, or edges cross: the pair of nearest points is the only contact.
        if result == first:
            out[0, result], out[7, result] = i, near[0, i]
            for c in range(3):
                out[1 + c, result] = (near[4 + c, i] + near[7 + c, i]) / 2.0
                out[4 + c, result] = near[1 + c, i]
            result += 1
    return result


@functools.cache
def _kernel():
    return compiled(_box_contacts, int64(MATRIX, MATRIX, MATRIX, MATRIX, VECTOR, MATRIX))


@dataclass(frozen=True)
class Contacts:
    """Where the bodies of a scene touch, sorted by pair.

    Attributes:
        bodies: first and second body of each contact, first < second, shape (2, K).
        point: midway between the two surfaces, shape (dim, K) [m].
        normal: unit vector from the first to the second body, shape (dim, K).
        distance: negative where they are in each other, shape (K,) [m].
    """

    bodies: NDArray[np.int64]
    point: Array
    normal: Array
    distance: Array


def _single(rows: Array) -> Array:
    """Return one contact a pair, as in `_box_contacts`."""
    points = (rows[4:7] + rows[7:10]) / 2.0
    return np.vstack((np.arange(rows.shape[1]), points, rows[1:4], rows[0]))


def _on_plane(qa: Array, b: Shape, qb: Array, dim: int) -> Array:
    """Return a contact for every corner of b at a plane a, which is first."""
    normal = to_matrix(qa[3:])[:, dim - 1]
    corners = corners_in_space(b, qb)
    height = np.einsum("in,ikn->kn", normal, corners - qa[:3, None]) - b.radius
    point = corners - normal[:, None] * (b.radius + height / 2.0)
    pair = np.broadcast_to(np.arange(height.shape[1]), height.shape)
    normals = np.broadcast_to(normal[:, None], point.shape)
    return np.vstack([x.reshape(-1, height.size) for x in (pair, point, normals, height)])


def _pair_contacts(a: Shape, qa: Array, b: Shape, qb: Array, margin: float) -> Array:
    """Return rows: which pair, point (3), normal (3), distance."""
    if a.name == "plane":
        return _on_plane(qa, b, qb, a.dim)
    if b.name == "plane":
        # The plane is the second body here, so its normal is reversed.
        rows = _on_plane(qb, a, qa, a.dim)
        rows[4:7] *= -1.0
        return rows
    near = measured(a, qa, b, qb)
    if a.name == b.name == "box":
        halves = np.stack((a.half, b.half))
        if a.dim == 2:
            # Boxes of the plane become bars, which have side faces to clip.
            halves[:, 2] = 1.0
        out = np.empty((8, 8 * qa.shape[1]))
        numbers = np.array([a.radius, b.radius, margin, a.dim], float)
        return out[:, : _kernel()(halves, near, qa, qb, numbers, out)]
    return _single(near)


def contacts(shapes: Sequence[Shape], pose: ArrayLike, margin: float = 0.0) -> Contacts:
    """Return all contacts of a scene: bounding boxes first, then each pair that is left.

    Two boxes that meet with a face get the corners of the faces' common part, up to eight, a shape
    on a plane one for every corner of its core. Any other pair has one contact point: a capsule or
    a mesh (`points`) that lies on a box can tip over it, which an engine with full manifolds would
    not let it do. Bodies that share a `Shape` are worked out together.

    Args:
        shapes: of each body, of one dimension.
        pose: of each body, a column each, shape (7, n) or (3, n).
        margin: distance up to which there is a contact [m], 0 for touching or overlapping.

    Raises:
        ValueError: for no shape, different dimensions, a batch of another length, a NaN, a
            quaternion that is not of unit length, or a negative margin.
    """
    near = finite("margin", margin, 0.0, unit="m")
    if not shapes or len({shape.dim for shape in shapes}) > 1:
        raise invalid("shapes", [shape.dim for shape in shapes], "shapes of one dimension")
    dim = shapes[0].dim
    q = poses("pose", pose, dim)
    if q.shape[1] != len(shapes):
        raise invalid("pose.shape[1]", q.shape[1], f"{len(shapes)}, a column for each shape")
    kinds = {id(shape): shape for shape in shapes}
    of = np.array([list(kinds).index(id(shape)) for shape in shapes])
    boxes = np.empty((2, 3, len(shapes)))
    for k, shape in enumerate(kinds.values()):
        boxes[:, :, of == k] = bounds_in_space(shape, q[:, of == k])
    # Grown by half the margin on each side, boxes overlap if they are within the margin.
    boxes += np.array([-near / 2.0, near / 2.0])[:, None, None]
    i, j = overlapping_pairs(boxes[:, :dim])
    rows, groups = [np.empty((9, 0))], of[i] * len(kinds) + of[j]
    # Pairs of the same two shapes are handled in one batch.
    for group in np.unique(groups):
        these = np.flatnonzero(groups == group)
        a, b = shapes[i[these[0]]], shapes[j[these[0]]]
        # Two planes have no contact with each other.
        if a.name != "plane" or b.name != "plane":
            qa, qb = (np.ascontiguousarray(q[:, body[these]]) for body in (i, j))
            some = _pair_contacts(a, qa, b, qb, near)
            some = some[:, some[7] <= near]
            rows.append(np.vstack((these[some[0].astype(int)], some)))
    result = np.hstack(rows)
    result = result[:, np.argsort(result[0], kind="stable")]
    pair = result[0].astype(int)
    return Contacts(
        np.stack((i[pair], j[pair])), result[2 : 2 + dim], result[5 : 5 + dim], result[8]
    )


def warm() -> None:
    """Compile the loop of this file."""
    _kernel()
