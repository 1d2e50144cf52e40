"""Where is the known thing? Measured points laid onto a cloud or onto a shape, with what is known.

A pose is (R, p): a point m of the target's frame stands at R m + p in the frame of the measured
points, which is the camera's. The six ways to move it are those of the target's own frame: shifts
along its axes, then turns about them, p' = p + R d, R' = R exp(t). A measured point with the
closest point c and the normal n there is off by r = n (m - c), which a motion changes by
-n d - (m x n) t. So J = (n, m x n), the information is the sum of J J^T / variance, and its null
space is what the picture does not show: a cylinder's turn about its axis, a sphere's three turns,
two shifts and a turn of a face (Besl and McKay, 1992; Chen and Medioni, 1991; Censi, 2007).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numba import float64, int64, types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, vector
from course.compiled import MATRIX, VECTOR, compiled, loop
from course.perception import camera
from course.perception.camera import CYLINDER, PLANE, SPHERE, STILL, Shapes, Solids, numbers
from course.perception.linear import eigen, times_transposed
from course.perception.rigid import rotation
from course.perception.tree import NO_CLOUD, Cloud, nearest_row
from course.rigid_body.quaternion import exp, from_matrix, to_matrix
from course.rigid_body.spatial import poses as checked_poses

Array = NDArray[np.float64]

DIRECTIONS = ("x", "y", "z", "turn x", "turn y", "turn z")
METHODS = ("point", "plane")

_LEAST_COSINE = 0.1  # of ray and normal, for a weight: what grazes is not known ever better
_EDGE = 0.5  # standard deviations of depth: a ray that passes an edge nearer counts for no face
_BLIND = 1e-6  # an eigenvalue below this, where each direction alone has 1, is not observed
_ROUNDING = 1e-15  # a direction with less than this share of the largest information has none
_UNSEEN = 1e-9  # a motion with less than this share of the largest information gets no step
_INDICES = types.Array(int64, 1, "C")
_FLAGS = types.Array(numba.boolean, 1, "C")
_CUBE = types.Array(float64, 3, "C")


@dataclass(frozen=True, eq=False)
class Fit:
    """What a registration found.

    Attributes:
        R, p: of the target in the frame of the points, (3, 3) and (3,) [m]; `pose` as (7,).
        matched: which points have a match within the last gate, (N,).
        residual: root mean square of the matched distances, along the normals for "plane" [m].
        iterations: steps made.
        converged: whether the last step was below the tolerance, at the narrowest gate.
        information: of the six directions, (6, 6) [1/m^2, 1/(m rad), 1/rad^2]; 0 without normals.
        free: the directions that could change; of the others the covariance is zero.
    """

    R: Array
    p: Array
    matched: NDArray[np.bool_]
    residual: float
    iterations: int
    converged: bool
    information: Array
    free: tuple[str, ...] = DIRECTIONS

    @property
    def pose(self) -> Array:
        """Position and unit quaternion in one array, shape (7,)."""
        return np.concatenate((self.p, from_matrix(self.R)))

    @property
    def covariance(self) -> Array:
        """Covariance of the six directions, (6, 6); infinite on the diagonal where unknown."""
        return known(self.information, self.free)[0]

    @property
    def unobserved(self) -> tuple[str, ...]:
        """The directions that the points do not tell, by name."""
        return known(self.information, self.free)[1]


def known(
    information: ArrayLike, free: tuple[str, ...] = DIRECTIONS
) -> tuple[Array, tuple[str, ...]]:
    """Return covariance and blind directions of an information matrix.

    A motion is **blind** if the information matrix has a small eigenvalue along it. Each direction
    is scaled to an information of 1 first (van der Sluis, 1969), so that neither the unit of a
    rotation nor how well another direction is known changes which motions are blind. A direction
    with a part in a blind motion has an infinite variance, and no covariance with the others.

    Args:
        information: shape (6, 6), of shifts [1/m^2] and turns [1/rad^2].
        free: the directions that are not known beforehand; the others have no variance.

    Returns:
        Covariance (6, 6) and the names of the directions of infinite variance.
    """
    H = vector("information", information, (6, 6))
    covariance, blind = covariance_of(H, np.isin(DIRECTIONS, free))
    return covariance, tuple(str(name) for name in np.array(DIRECTIONS)[blind])


@register_jitable
def covariance_of(information, mobile):
    """Return the covariance of `known` and which directions are blind, (6,).

    Args:
        information: shape (6, 6).
        mobile: the directions that are not known beforehand, (6,).
    """
    H = information * np.outer(1.0 * mobile, 1.0 * mobile)
    alone = np.diag(H)
    # Unit diagonal first: the eigenvalues then say how independent the directions are, whatever
    # their units. A direction without information, or one that is not free, is divided by infinity.
    scale = np.sqrt(np.where(alone > _ROUNDING * alone.max(), alone, np.inf))
    values, vectors = eigen(H / np.outer(scale, scale))
    # An eigenvalue near 0 belongs to a motion that changes no measurement.
    observed = values > _BLIND
    blind = mobile & (np.where(observed, 0.0, vectors * vectors).sum(axis=1) > _BLIND)
    # Pseudoinverse on the observed motions, with the scaling undone.
    inverse = np.where(observed, 1.0 / np.where(observed, values, 1.0), 0.0)
    part = vectors / scale.reshape(6, 1)
    result = times_transposed(part * inverse, part)
    for x in range(6):
        if blind[x]:
            result[x, :] = 0.0
            result[:, x] = 0.0
    for x in range(6):
        if blind[x]:
            result[x, x] = np.inf
    return result, blind


def icp(
    points: ArrayLike,
    target: Cloud | Shapes,
    start: ArrayLike = STILL,
    *,
    method: str = "plane",
    gate: float | tuple[float, float] = np.inf,
    sigma: ArrayLike | float | None = None,
    free: tuple[str, ...] = DIRECTIONS,
    rays: bool = True,
    iterations: int = 50,
    tolerance: float = 1e-8,
) -> Fit:
    """Return iterative closest points: match to the target, best motion for these matches, repeat.

    "point" takes the best rigid motion onto the closest points, "plane" a Gauss-Newton step on the
    distances along their normals. On a shape the closest point is exact. A gate drops what is
    farther from the target than a part of this scene can be off; given as (first, last) it narrows
    by a third a step, so that it catches at first and shuts out a neighbour in the end.

    With `sigma` a point's weight is 1 / (sigma |n ray| / z)^2: the error lies along the ray, and
    only its part along the normal counts. Without, all weights are equal and the scale of the noise
    is that of the residual.

    A noisy point near an edge is closest to a face that its ray never met. That biases the pose and
    makes a covariance out of nothing where a face is not seen. So the last steps of "plane" on a
    shape compare each point with the point of the shape on its own ray, as a picture does (Blais
    and Levine, 1995), without the pixels that graze the shape or pass near its edge.

    Args:
        points: measured, in the camera's frame if `sigma` is given, shape (3, N) [m].
        target: a cloud (with normals for "plane"), or shapes posed in the part's frame.
        start: pose of the target in the frame of the points, shape (7,).
        method: one of `METHODS`.
        gate: greatest distance of a match, or the first and the last [m].
        sigma: standard deviation of the depth z of each point, a number or (N,) [m].
        free: the directions that may change, of `DIRECTIONS`; the others stay as they start.
        rays: whether the last steps follow the rays, on a shape with `sigma`.
        iterations: most steps.
        tolerance: a step that moves the part by less is the last [m].

    Raises:
        ValueError: for bad input, and where fewer than 3 points are within the first gate.
    """
    source = np.ascontiguousarray(vector("points", points, (3, None), unit="m").T)
    plane = METHODS.index(one_of("method", method, METHODS))
    first, last = gate if isinstance(gate, tuple) else (gate, gate)
    if not 0.0 < last <= first:
        raise invalid("gate", gate, "a positive distance, or a first and a smaller last [m]")
    spread = np.zeros(len(source))
    if sigma is not None:
        spread[:] = vector("sigma", sigma, (), (len(source),), low=1e-12, unit="m")
        if source[:, 2].min(initial=1.0) <= 0.0:
            raise invalid("points[2]", source[:, 2], "points before the camera, where sigma is")
    allowed = [one_of("free", name, DIRECTIONS) for name in free]
    mobile = np.isin(DIRECTIONS, allowed)
    if not plane and not mobile.all():
        raise invalid("free", free, "all six directions for point-to-point")
    begin = checked_poses("start", vector("start", start, (7,)), 3)[:, 0]
    steps = count("iterations", iterations, 1)
    tree = target if isinstance(target, Cloud) else NO_CLOUD
    if plane and tree is target and not len(tree.normals):
        raise invalid("target.normals", None, "normals, for point-to-plane")
    parts = numbers(target) if isinstance(target, Shapes) else _NO_PARTS
    made = register(
        source,
        spread,
        (tree.points, tree.normals, tree.axes, tree.cuts),
        parts,
        begin,
        (float(first), float(last)),
        mobile,
        plane,
        rays,
        steps,
        finite("tolerance", tolerance, 0.0, unit="m"),
    )
    H = made.information
    if made.matches < 3 and made.steps == 0:
        raise invalid("start", begin, f"a pose with 3 points within the gate (here {made.matches})")
    # Without given deviations the residual's own variance scales the information.
    if sigma is None:
        H *= max(made.matches - mobile.sum(), 1.0) / max(made.weighted, 1e-300)
    return Fit(
        made.R,
        made.p,
        matched=made.flags > 0,
        residual=made.residual,
        iterations=made.steps,
        converged=made.converged,
        information=H,
        free=free,
    )


class Registered(NamedTuple):
    """What `register` found, as numbers; see `Fit`.

    Attributes:
        R, p: of the target in the frame of the points, (3, 3) and (3,) [m].
        flags: of each point 1 matched, 2 rejected by its ray, 0 neither, (N,).
        matches: number of matched points.
        weighted: sum of the weighted squares.
        residual: root mean square of the matched distances, infinite if they are fewer than 3 [m].
        steps: that were made.
        converged: as of `Fit`.
        information: of the six directions, (6, 6), with the weights of the points.
    """

    R: Array
    p: Array
    flags: NDArray[np.int64]
    matches: int
    weighted: float
    residual: float
    steps: int
    converged: bool
    information: Array


@register_jitable
def register(source, spread, tree, parts, start, gate, mobile, plane, rays, steps, tolerance):
    """Return `icp`'s result for arguments that are checked.

    Args:
        source: points, shape (N, 3) [m].
        spread: standard deviations of their depths, 0 for equal weights, shape (N,) [m].
        tree: points, normals, axes and cuts of a `Cloud`, empty beside shapes.
        parts: shapes as numbers, none beside a cloud.
        start: pose, shape (7,).
        gate: the first and the last [m].
        mobile: the directions that may change, (6,).
        plane: 1 for point-to-plane.
        rays: whether the last steps follow the rays.
        steps: limit on the number of iterations.
        tolerance: a step that moves the part by less is the last [m].
    """
    R, p = to_matrix(start[3:]), start[:3].copy()
    # Graduated gate: wide at first, to catch far matches, and narrower each iteration.
    gates = np.empty(steps + 1)
    wide = gate[0]
    for k in range(steps + 1):
        gates[k] = max(gate[1], wide)
        wide *= 2.0 / 3.0
    limits = np.array([tolerance, _EDGE if rays else -1.0])
    n = source.shape[0]
    H, out, flags = np.zeros((6, 6)), np.zeros(6), np.zeros(n, np.int64)
    points, normals, axes, cuts = tree
    kinds, sizes, turns, places = solids(parts)
    closest, weights = np.zeros((n, 3)), np.zeros(n)
    _icp_loop(
        source,
        spread,
        points,
        normals,
        axes,
        cuts,
        kinds,
        sizes,
        turns,
        places,
        R,
        p,
        gates,
        limits,
        mobile,
        plane,
        closest,
        weights,
        flags,
        H,
        out,
    )
    # The loop fills the lower triangle only.
    for x in range(6):
        for y in range(x):
            H[y, x] = H[x, y]
    matched, enough = int(out[0]), out[0] >= 3.0
    residual = math.sqrt(out[2] / out[0]) if enough else math.inf
    converged = enough and out[4] > 0.0
    return Registered(R, p, flags, matched, out[1], residual, int(out[3]), converged, H)


@register_jitable
def solids(parts):
    """Return kinds (n,), sizes (n, 3), rotations (n, 3, 3) and places (n, 3) for the loop."""
    n = parts.kinds.size
    sizes, turns, places = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3))
    for i in range(n):
        sizes[i], places[i] = parts.sizes[:, i], parts.poses[:3, i]
        turns[i] = to_matrix(parts.poses[3:, i])
    return parts.kinds, sizes, turns, places


_NO_PARTS = Solids(np.zeros(0, np.int64), np.zeros((3, 0)), np.zeros((7, 0)))


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def _onto(kind, s0, s1, s2, x, y, z):
    """Return the closest surface point, its outward normal and its distance from an edge.

    Beyond an edge the normal points from the edge to (x, y, z), and the last number is zero.
    """
    if kind == PLANE:
        return x, y, 0.0, 0.0, 0.0, 1.0, np.inf
    if kind == SPHERE:
        length = np.sqrt(x * x + y * y + z * z)
        # The centre of a sphere has no nearest point of its own: any will do.
        if length == 0.0:
            return 0.0, 0.0, s0, 0.0, 0.0, 1.0, np.inf
        a, b, c = x / length, y / length, z / length
        return s0 * a, s0 * b, s0 * c, a, b, c, np.inf
    if kind == CYLINDER:
        # In the half plane through the axis and the point the cylinder is a rectangle.
        radial, up = np.sqrt(x * x + y * y), 1.0 if z > 0.0 else -1.0
        a, b = (x / radial, y / radial) if radial > 0.0 else (1.0, 0.0)
        side, end = radial - s0, abs(z) - s1
        # Beyond both side and end the rim is closest.
        if side > 0.0 and end > 0.0:
            gap = np.sqrt(side * side + end * end)
            c, d = side / gap, end / gap
            return s0 * a, s0 * b, s1 * up, a * c, b * c, up * d, 0.0
        # Otherwise the face that the point is beyond, or inside the face with the smaller depth.
        if side > end:
            return s0 * a, s0 * b, z, a, b, 0.0, -end
        return x, y, s1 * up, 0.0, 0.0, up, -side
    # A box. How far beyond each pair of faces, and on which side.
    q0, q1, q2 = abs(x) - s0, abs(y) - s1, abs(z) - s2
    a, b, c = 1.0 if x > 0.0 else -1.0, 1.0 if y > 0.0 else -1.0, 1.0 if z > 0.0 else -1.0
    outside = (1 if q0 > 0.0 else 0) + (1 if q1 > 0.0 else 0) + (1 if q2 > 0.0 else 0)
    # Beyond an edge or a corner the normal points from there to the query.
    if outside > 1:
        d0, d1, d2 = max(q0, 0.0), max(q1, 0.0), max(q2, 0.0)
        gap = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        x, y, z = x - a * d0, y - b * d1, z - c * d2
        return x, y, z, a * d0 / gap, b * d1 / gap, c * d2 / gap, 0.0
    # Onto the face with the smallest depth; the nearest of the other faces tells the edge's
    # distance.
    if q0 >= q1 and q0 >= q2:
        return s0 * a, y, z, a, 0.0, 0.0, -max(q1, q2)
    if q1 >= q2:
        return x, s1 * b, z, 0.0, b, 0.0, -max(q0, q2)
    return x, y, s2 * c, 0.0, 0.0, c, -max(q0, q1)


@register_jitable
def _meets(kind, size, o, d):
    """Return where the ray o + t d goes into a solid and out of it."""
    if kind == PLANE:
        return camera.through_plane(size, o, d)
    if kind == SPHERE:
        return camera.through_sphere(size, o, d)
    if kind == CYLINDER:
        return camera.through_cylinder(size, o, d)
    return camera.through_box(size, o, d)


@register_jitable
def _solve(H, g, mobile, length, step):
    """Write the smallest step with H step = g, turns in units of 1 / length.

    Only directions that may move do. A motion that the points hardly resist gets no step: dividing
    by its information, which is only rounding, would let rounding decide where the part goes.
    """
    A, scale = np.zeros((6, 6)), np.zeros(6)
    for x in range(6):
        if mobile[x]:
            scale[x] = 1.0 if x < 3 else 1.0 / length
        for y in range(x + 1):
            A[x, y] = H[x, y] * scale[x] * scale[y]
            A[y, x] = A[x, y]
    # Pseudoinverse, by eigenvectors: the independent motions and the information about each.
    values, vectors = eigen(A)
    for x in range(6):
        step[x] = 0.0
    for k in range(6):
        if values[k] > _UNSEEN * values[5]:
            along = 0.0
            for x in range(6):
                along += vectors[x, k] * g[x] * scale[x]
            # Back from the scaled unknowns to metres and radians.
            for x in range(6):
                step[x] += vectors[x, k] * along / values[k] * scale[x]


def _icp(
    source,
    spread,
    points,
    normals,
    axes,
    cuts,
    kinds,
    sizes,
    turns,
    places,
    R,
    p,
    gates,
    limits,
    mobile,
    plane,
    closest,
    weights,
    flags,
    H,
    out,
):
    """Run ICP on R and p in place; for each point: closest, weight, flag 1 matched, 2 rejected.

    out: matched, sum of w r^2, sum of r^2, steps, converged, mean square of the distance |m|.
    `_SIGNATURE` says what the arguments are.
    """
    steps, tolerance, edge = len(gates) - 1, limits[0], limits[1]
    nodes, offsets = np.empty((64, 3), dtype=np.int64), np.empty((64, 4))
    last = np.full(len(source), -1)
    m, q, J, g, step = np.empty(3), np.empty(3), np.empty(6), np.zeros(6), np.zeros(6)
    old, before = np.empty((3, 3)), np.empty(3)
    # Stages: 0 closest points; 1 along the rays, which settles what is left out; 2 after it.
    stage, final = 0, 2 if edge > 0.0 and spread.max() > 0.0 and plane and len(kinds) else 0
    for k in range(steps + 1):
        gate = gates[k]
        for x in range(6):
            out[x], g[x] = 0.0, 0.0
            for y in range(6):
                H[x, y] = 0.0
        # R^T p, so that m = R^T s - R^T p is a measured point in the frame of the target.
        for x in range(3):
            q[x] = R[0, x] * p[0] + R[1, x] * p[1] + R[2, x] * p[2]
        for i in range(len(source)):
            weights[i] = 0.0
            # What stage 1 has rejected stays out, so that the set of points no longer changes.
            if stage == 2 and flags[i] == 2:
                continue
            flags[i] = 0
            s0, s1, s2 = source[i, 0], source[i, 1], source[i, 2]
            for x in range(3):
                m[x] = R[0, x] * s0 + R[1, x] * s1 + R[2, x] * s2 - q[x]
            square, border = gate * gate, np.inf
            c0, c1, c2, n0, n1, n2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            if len(points):
                if last[i] >= 0:  # the match of the step before bounds that of this one
                    now = 0.0
                    for x in range(3):
                        now += (points[last[i], x] - m[x]) ** 2
                    if now >= square:
                        last[i] = -1
                    else:
                        square = now
                last[i], square = nearest_row(
                    m, points, axes, cuts, square, last[i], nodes, offsets
                )
                at = last[i]
                if at < 0:
                    continue
                c0, c1, c2 = points[at, 0], points[at, 1], points[at, 2]
                if len(normals):
                    n0, n1, n2 = normals[at, 0], normals[at, 1], normals[at, 2]
            else:
                # Shapes: the closest of all parts or, along the rays, the first one that the ray
                # meets.
                first = 10.0  # times the measured depth: where the ray meets a part first
                for part in range(len(kinds)):
                    T = turns[part]
                    kind, size = kinds[part], (sizes[part, 0], sizes[part, 1], sizes[part, 2])
                    a, b, c = m[0] - places[part, 0], m[1] - places[part, 1], m[2] - places[part, 2]
                    # The point in the frame of this part.
                    u = T[0, 0] * a + T[1, 0] * b + T[2, 0] * c
                    v = T[0, 1] * a + T[1, 1] * b + T[2, 1] * c
                    w = T[0, 2] * a + T[1, 2] * b + T[2, 2] * c
                    if stage:
                        # The camera's ray through the point in the same frame; at t = 1 it is at
                        # the measured depth.
                        a, b, c = m[0] + q[0], m[1] + q[1], m[2] + q[2]
                        d = T[0, 0] * a + T[1, 0] * b + T[2, 0] * c
                        e = T[0, 1] * a + T[1, 1] * b + T[2, 1] * c
                        f = T[0, 2] * a + T[1, 2] * b + T[2, 2] * c
                        near, far = _meets(kind, size, (u - d, v - e, w - f), (d, e, f))
                        if not (0.0 < near <= far and near < first):
                            continue
                        first, now = near, 0.0
                        u, v, w = u + (near - 1.0) * d, v + (near - 1.0) * e, w + (near - 1.0) * f
                    a, b, c, d, e, f, rim = _onto(kind, size[0], size[1], size[2], u, v, w)
                    if not stage:
                        now = (a - u) ** 2 + (b - v) ** 2 + (c - w) ** 2
                    if stage or now < square:
                        square, border = now, rim
                        # Closest point and normal, back in the frame of the target.
                        c0 = T[0, 0] * a + T[0, 1] * b + T[0, 2] * c + places[part, 0]
                        c1 = T[1, 0] * a + T[1, 1] * b + T[1, 2] * c + places[part, 1]
                        c2 = T[2, 0] * a + T[2, 1] * b + T[2, 2] * c + places[part, 2]
                        n0 = T[0, 0] * d + T[0, 1] * e + T[0, 2] * f
                        n1 = T[1, 0] * d + T[1, 1] * e + T[1, 2] * f
                        n2 = T[2, 0] * d + T[2, 1] * e + T[2, 2] * f
                if not square < gate * gate:
                    continue
            flags[i] = 1
            closest[i, 0], closest[i, 1], closest[i, 2] = c0, c1, c2
            weight, r = 1.0, n0 * (m[0] - c0) + n1 * (m[1] - c1) + n2 * (m[2] - c2)
            # Along a ray the gate applies to the distance in the direction of the normal.
            if stage and r * r >= gate * gate:
                flags[i] = 0
                continue
            if spread[i] > 0.0:
                weight = 1.0 / (spread[i] * spread[i])
                if plane:
                    # Along the ray the surface is at t times the measured depth. The noise is even
                    # in disparity, so that weights at the measured depth would favour what came
                    # out too near; as residuals of disparity they are 1 / t^3 as large.
                    ray = n0 * (m[0] + q[0]) + n1 * (m[1] + q[1]) + n2 * (m[2] + q[2])
                    if stage == 1 and (border < edge * spread[i] or ray > -_LEAST_COSINE * s2):
                        flags[i] = 2
                        continue
                    slope = max(_LEAST_COSINE, abs(ray) / s2)
                    t = min(2.0, max(0.5, 1.0 - r / (-slope * s2 if ray < 0.0 else slope * s2)))
                    weight /= slope * slope * t * t * t
            weights[i] = weight
            J[0], J[1], J[2] = n0, n1, n2
            # Lever arm of a turn: the measured point or, along the rays, the point on the surface.
            if not stage:
                c0, c1, c2 = m[0], m[1], m[2]
            J[3], J[4], J[5] = c1 * n2 - c2 * n1, c2 * n0 - c0 * n2, c0 * n1 - c1 * n0
            # Normal equations of Gauss-Newton, lower triangle.
            for x in range(6):
                g[x] += weight * r * J[x]
                for y in range(x + 1):
                    H[x, y] += weight * J[x] * J[y]
            square = r * r if plane else square
            out[0] += 1.0
            out[1] += weight * square
            out[2] += square
            out[5] += m[0] * m[0] + m[1] * m[1] + m[2] * m[2]
        out[3] = k
        # Too few matches: the part is lost.
        if out[0] < 3.0:
            return
        out[5] /= out[0]
        if k == steps:
            return
        stage = 2 if stage == 1 else stage
        # Root mean square distance from the target's origin: what a turn of 1 rad moves the points
        # by.
        length = max(np.sqrt(out[5]), 1e-9)
        for x in range(3):
            before[x] = p[x]
            for y in range(3):
                old[x, y] = R[x, y]
        if plane:
            _solve(H, g, mobile, length, step)
            # Some points at an edge may ask for a step far beyond where they are matched.
            largest = 1e-300
            for x in range(6):
                largest = max(largest, abs(step[x]) * (1.0 if x < 3 else length))
            for x in range(6):
                step[x] *= min(1.0, min(gate, length) / largest)
            # Exponential map; the step acts in the target's own frame, R' = R exp(t).
            turn = to_matrix(exp(step[3:]))
            for x in range(3):
                for y in range(3):
                    p[x] += old[x, y] * step[y]
                    R[x, y] = 0.0
                    for z in range(3):
                        R[x, y] += old[x, z] * turn[z, y]
        elif not rotation(closest, source, weights, R, p):
            return
        # Size of the step. A small turn by t changes the matrix by 2 t^2, summed over its squared
        # entries.
        moved = 0.0
        for x in range(3):
            moved += (p[x] - before[x]) ** 2
            for y in range(3):
                moved += 0.5 * length * length * (R[x, y] - old[x, y]) ** 2
        out[3] = k + 1
        if gate == gates[steps] and stage == final and np.sqrt(moved) < tolerance:
            out[4] = 1.0
            return
        # What is not seen may creep for ever: at most two thirds of the steps go to closest points.
        near = np.sqrt(moved) < 1e3 * tolerance or 3 * k >= 2 * steps
        if gate == gates[steps] and stage < final and near:
            stage = 1


# A k-d tree as the loops take it: points (N, 3) in its order, normals (N, 3) or (0, 3), and of its
# inner nodes the axis and the coordinate of the cut. All arrays are C-contiguous, with one point a
# row.
_TREE = (MATRIX, MATRIX, _INDICES, VECTOR)
# Shapes: kind, sizes (n, 3), rotation (n, 3, 3) and position (n, 3) of each; no row beside a cloud,
# as the tree has none beside shapes.
_PARTS = (_INDICES, MATRIX, _CUBE, MATRIX)
# The pose, which starts as the guess and ends as the result: R (3, 3) and p (3,). Then the gate of
# each step; tolerance and the width of a blind edge; which of the six directions may move; 1 for
# point-to-plane.
_RULES = (MATRIX, VECTOR, VECTOR, VECTOR, _FLAGS, int64)
# Filled for each point: match (N, 3), weight, flag. Then H (6, 6) and the six figures of `out`.
_RESULTS = (MATRIX, VECTOR, _INDICES, MATRIX, VECTOR)
# The signature is explicit, so that the machine code is stored for the next process
# (`course.compiled`). The first two arguments are the points and their deviations.
_SIGNATURE = types.void(MATRIX, VECTOR, *_TREE, *_PARTS, *_RULES, *_RESULTS)
_icp_loop = loop(_icp, _SIGNATURE)


def warm() -> None:
    """Compile the loop of this file."""
    compiled(_icp, _SIGNATURE)
