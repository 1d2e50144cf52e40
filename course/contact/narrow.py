"""Narrow phase: how far apart are two convex shapes, or how deep in each other, and where.

Everything happens in the set of differences a - b of points of the two cores, in the frame of a.
The distance is that of the origin to this set (Gilbert, Johnson and Keerthi, A fast procedure for
computing the distance between complex objects, 1988); where the origin lies inside, the depth is
its distance to the boundary (van den Bergen, Proximity queries and penetration depth computation
on 3D game objects, 2001). The cores are polytopes, so both end exactly; radii come afterwards.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
from numba import void
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from course.check import refused
from course.compiled import MATRIX, VECTOR, compiled
from course.contact.shapes import Array, Shape, poses
from course.rigid_body.quaternion import to_matrix

_EPS = 2.0**-52
_STUCK = 4  # iterations in a row that bring neither bound of the distance nearer
_VERTICES = 120  # that a growing polytope may have; its faces are fewer than twice as many

# Where a pair of shapes stands in its array of numbers: half sizes of a and of b, centre of b,
# rotation of b, all in the frame of a, and the size that rounding is measured in.
_A, _B, _P, _R, _SIZE = 0, 3, 6, 9, 18


@register_jitable
def _support(x, y, z, va, vb, pair, out, k):
    """Row k of out: the point of the set of differences farthest along (x, y, z), then of a, of b.

    The sign of a component picks the corner of a box; vertices are searched.
    """
    best = 0
    top = va[0, 0] * x + va[1, 0] * y + va[2, 0] * z
    for i in range(1, va.shape[1]):
        value = va[0, i] * x + va[1, i] * y + va[2, i] * z
        if value > top:
            best, top = i, value
    ax = va[0, best] + math.copysign(pair[0], x)
    ay = va[1, best] + math.copysign(pair[1], y)
    az = va[2, best] + math.copysign(pair[2], z)
    u = -(pair[9] * x + pair[12] * y + pair[15] * z)
    v = -(pair[10] * x + pair[13] * y + pair[16] * z)
    w = -(pair[11] * x + pair[14] * y + pair[17] * z)
    best = 0
    top = vb[0, 0] * u + vb[1, 0] * v + vb[2, 0] * w
    for i in range(1, vb.shape[1]):
        value = vb[0, i] * u + vb[1, i] * v + vb[2, i] * w
        if value > top:
            best, top = i, value
    u = vb[0, best] + math.copysign(pair[3], u)
    v = vb[1, best] + math.copysign(pair[4], v)
    w = vb[2, best] + math.copysign(pair[5], w)
    bx = pair[6] + pair[9] * u + pair[10] * v + pair[11] * w
    by = pair[7] + pair[12] * u + pair[13] * v + pair[14] * w
    bz = pair[8] + pair[15] * u + pair[16] * v + pair[17] * w
    out[k, 0], out[k, 1], out[k, 2] = ax - bx, ay - by, az - bz
    out[k, 3], out[k, 4], out[k, 5] = ax, ay, az
    out[k, 6], out[k, 7], out[k, 8] = bx, by, bz


@register_jitable
def _normal(s, i, j, k):
    """Twice the area of the triangle i, j, k of rows of s, as a vector."""
    ax, ay, az = s[j, 0] - s[i, 0], s[j, 1] - s[i, 1], s[j, 2] - s[i, 2]
    bx, by, bz = s[k, 0] - s[i, 0], s[k, 1] - s[i, 1], s[k, 2] - s[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@register_jitable
def _area(n, s, i, j):
    """n . (row i x row j)."""
    return (
        n[0] * (s[i, 1] * s[j, 2] - s[i, 2] * s[j, 1])
        + n[1] * (s[i, 2] * s[j, 0] - s[i, 0] * s[j, 2])
        + n[2] * (s[i, 0] * s[j, 1] - s[i, 1] * s[j, 0])
    )


@register_jitable
def _on_edge(s, i, j):
    """The share of j in the point of the edge i, j nearest to the origin."""
    ex, ey, ez = s[j, 0] - s[i, 0], s[j, 1] - s[i, 1], s[j, 2] - s[i, 2]
    length = ex * ex + ey * ey + ez * ez
    along = -(s[i, 0] * ex + s[i, 1] * ey + s[i, 2] * ez)
    return 0.0 if along <= 0.0 else 1.0 if along >= length else along / length


@register_jitable
def _on_triangle(s, i, j, k):
    """Shares of i, j, k in the point of their triangle nearest to the origin."""
    n = _normal(s, i, j, k)
    u, v, w = _area(n, s, j, k), _area(n, s, k, i), _area(n, s, i, j)
    if u > 0.0 and v > 0.0 and w > 0.0:
        total = u + v + w
        return u / total, v / total, w / total
    # Not inside: the nearest of the three edges, which costs little and trusts no sign.
    best, result = math.inf, (1.0, 0.0, 0.0)
    for edge in range(3):
        p, q = (i, j) if edge == 0 else (j, k) if edge == 1 else (k, i)
        t = _on_edge(s, p, q)
        x = s[p, 0] + t * (s[q, 0] - s[p, 0])
        y = s[p, 1] + t * (s[q, 1] - s[p, 1])
        z = s[p, 2] + t * (s[q, 2] - s[p, 2])
        far = x * x + y * y + z * z
        if far < best:
            best = far
            if edge == 0:
                result = (1.0 - t, t, 0.0)
            elif edge == 1:
                result = (0.0, 1.0 - t, t)
            else:
                result = (t, 0.0, 1.0 - t)
    return result


@register_jitable
def _square(s, i, j, k, shares):
    x = shares[0] * s[i, 0] + shares[1] * s[j, 0] + shares[2] * s[k, 0]
    y = shares[0] * s[i, 1] + shares[1] * s[j, 1] + shares[2] * s[k, 1]
    z = shares[0] * s[i, 2] + shares[1] * s[j, 2] + shares[2] * s[k, 2]
    return x * x + y * y + z * z


@register_jitable
def _nearest(s, n, share, thin):
    """Reduce a simplex of n rows to those whose hull holds its point nearest to the origin.

    Of a tetrahedron thinner than `thin` the sides cannot be told, so all four are tried.

    Returns:
        How many rows are left, with their shares in `share`; 5 where the origin is inside.
    """
    for i in range(4):
        share[i] = 0.0
    if n == 2:
        share[1] = _on_edge(s, 0, 1)
        share[0] = 1.0 - share[1]
    elif n == 3:
        share[0], share[1], share[2] = _on_triangle(s, 0, 1, 2)
    else:
        best = math.inf
        inside = True
        for face in range(4):
            i, j, k = (face + 1) % 4, (face + 2) % 4, (face + 3) % 4
            m = _normal(s, i, j, k)
            here = m[0] * s[i, 0] + m[1] * s[i, 1] + m[2] * s[i, 2]
            there = here - (m[0] * s[face, 0] + m[1] * s[face, 1] + m[2] * s[face, 2])
            clear = there * there > (m[0] * m[0] + m[1] * m[1] + m[2] * m[2]) * thin * thin
            if clear and here * there > 0.0:
                continue  # the origin is on the inner side of this face
            inside = False
            shares = _on_triangle(s, i, j, k)
            far = _square(s, i, j, k, shares)
            if far < best:
                best = far
                share[face] = 0.0
                share[i], share[j], share[k] = shares
        if inside:
            return 5
    kept = 0
    for i in range(n):
        if share[i] > 0.0:
            if kept < i:
                share[kept] = share[i]
                for c in range(9):
                    s[kept, c] = s[i, c]
            kept += 1
    return kept


@register_jitable
def _known(s, n, k):
    """Whether row k of s is one of its first n."""
    for i in range(n):
        if s[i, 0] == s[k, 0] and s[i, 1] == s[k, 1] and s[i, 2] == s[k, 2]:
            return True
    return False


@register_jitable
def _gjk(va, vb, pair, s, share, v):
    """The point of the set of differences nearest to the origin, as shares of rows of s.

    Returns:
        How many rows of s hold it, 5 where the origin is inside; its distance, and a lower bound of
        that; how many iterations. In `v` the direction that proves the bound, of any length.
    """
    x, y, z = -pair[6], -pair[7], -pair[8]
    if x == 0.0 and y == 0.0 and z == 0.0:
        x = 1.0
    _support(-x, -y, -z, va, vb, pair, s, 0)
    n = 1
    share[0] = 1.0
    x, y, z = s[0, 0], s[0, 1], s[0, 2]
    square = x * x + y * y + z * z
    low, last, rounding = -math.inf, math.inf, 4.0 * _EPS * pair[_SIZE]
    iterations, stuck = 0, 0
    while True:
        if square <= 100.0 * rounding * rounding:
            break  # touching
        iterations += 1
        _support(-x, -y, -z, va, vb, pair, s, n)
        # All of the set lies beyond the plane through this support.
        bound = (x * s[n, 0] + y * s[n, 1] + z * s[n, 2]) / math.sqrt(x * x + y * y + z * z)
        stuck = stuck + 1 if square >= last and bound <= low else 0
        last = min(square, last)
        if bound > low:
            low = bound
            v[0], v[1], v[2] = x, y, z
        if math.sqrt(square) - low <= rounding or stuck == _STUCK or _known(s, n, n):
            break  # certain; or rounding lets neither bound come nearer
        n = _nearest(s, n + 1, share, rounding)
        if n == 5:
            break
        x, y, z = 0.0, 0.0, 0.0
        for i in range(n):
            x += share[i] * s[i, 0]
            y += share[i] * s[i, 1]
            z += share[i] * s[i, 2]
        square = x * x + y * y + z * z
        if n == 2:
            # Of an edge, what rounding left along it goes.
            ex, ey, ez = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2]
            along = (x * ex + y * ey + z * ez) / (ex * ex + ey * ey + ez * ez)
            x, y, z = x - along * ex, y - along * ey, z - along * ez
            if x == 0.0 and y == 0.0 and z == 0.0:
                square = 0.0
        elif n == 3:
            # The triangle's normal keeps its direction where the point is all but zero, and the
            # point where the triangle is all but an edge: of both the one that rounding hurts less.
            m = _normal(s, 0, 1, 2)
            side = m[0] * s[0, 0] + m[1] * s[0, 1] + m[2] * s[0, 2]
            area = m[0] * m[0] + m[1] * m[1] + m[2] * m[2]
            if side != 0.0 and area > square * pair[_SIZE] * pair[_SIZE]:
                side = math.copysign(1.0, side)
                x, y, z = side * m[0], side * m[1], side * m[2]
    return n, math.sqrt(square), low, iterations


@register_jitable
def _off(s, k, rank, x, y, z):
    """How far row k is from row 0, from the line of rows 0 and 1, or along (x, y, z)."""
    dx, dy, dz = s[k, 0] - s[0, 0], s[k, 1] - s[0, 1], s[k, 2] - s[0, 2]
    if rank == 0:
        return math.sqrt(dx * dx + dy * dy + dz * dz)
    if rank == 2:
        return abs(x * dx + y * dy + z * dz)
    ex, ey, ez = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2]
    m = _normal(s, 0, 1, k)
    return math.sqrt((m[0] ** 2 + m[1] ** 2 + m[2] ** 2) / (ex * ex + ey * ey + ez * ez))


@register_jitable
def _farther(va, vb, pair, s, k, x, y, z, rank):
    """Put the supports along and against (x, y, z) into row k if they are farther off; how far."""
    far = _off(s, k, rank, x, y, z)
    for sign in (1.0, -1.0):
        _support(sign * x, sign * y, sign * z, va, vb, pair, s, k + 1)
        off = _off(s, k + 1, rank, x, y, z)
        if off > far:
            far = off
            for c in range(9):
                s[k, c] = s[k + 1, c]
    return far


@register_jitable
def _unit(x, y, z):
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@register_jitable
def _grow(va, vb, pair, s, flat):
    """Four rows of s that span the set of differences, or the normal of a set that is flat.

    Returns:
        Whether the set has a volume. If not, `flat` is a unit vector that is the same on all of it.
    """
    thin = 16.0 * _EPS * pair[_SIZE]
    _support(1.0, 0.0, 0.0, va, vb, pair, s, 0)
    x, y, z = 1.0, 0.0, 0.0
    for rank in range(3):
        for c in range(9):
            s[rank + 1, c] = s[0, c]
        if rank == 0:
            _farther(va, vb, pair, s, 1, 0.0, 0.0, 1.0, 0)
            _farther(va, vb, pair, s, 1, 0.0, 1.0, 0.0, 0)
            far = _farther(va, vb, pair, s, 1, x, y, z, 0)
        elif rank == 1:
            # Two directions at right angles to the line.
            ex, ey, ez = _unit(s[1, 0] - s[0, 0], s[1, 1] - s[0, 1], s[1, 2] - s[0, 2])
            if abs(ez) <= 0.8:
                x, y, z = _unit(-ey, ex, 0.0)
            else:
                x, y, z = _unit(ez, 0.0, -ex)
            _farther(va, vb, pair, s, 2, ey * z - ez * y, ez * x - ex * z, ex * y - ey * x, 1)
            far = _farther(va, vb, pair, s, 2, x, y, z, 1)
        else:
            m = _normal(s, 0, 1, 2)
            x, y, z = _unit(m[0], m[1], m[2])
            far = _farther(va, vb, pair, s, 3, x, y, z, 2)
        if far <= thin:
            flat[0], flat[1], flat[2] = x, y, z
            return False
    return True


@register_jitable
def _face(f, i, j, k, s, corner, face, key):
    """Write face f: its corners, outward unit normal and distance from the origin."""
    corner[f, 0], corner[f, 1], corner[f, 2] = i, j, k
    m = _normal(s, i, j, k)
    length = math.sqrt(m[0] * m[0] + m[1] * m[1] + m[2] * m[2])
    if length > 0.0:
        x, y, z = m[0] / length, m[1] / length, m[2] / length
        face[f, 0], face[f, 1], face[f, 2] = x, y, z
        face[f, 3] = x * s[i, 0] + y * s[i, 1] + z * s[i, 2]
        key[f] = face[f, 3]
    else:
        face[f, 0], face[f, 1], face[f, 2], face[f, 3] = 0.0, 0.0, 0.0, 0.0
        key[f] = math.inf


@register_jitable
def _epa(va, vb, pair, s, share, best, corner, beyond, face, key, link, stack):
    """The least depth of the origin in the set of differences that rows 0 to 3 of s span.

    The polytope grows at the face that is nearest to the origin. The support along any direction
    bounds the depth from above, the nearest face from below.

    Args:
        corner, beyond: of each face its corners, counter-clockwise from outside, and the faces
            across the edges that begin there.
        face, key: its normal and distance; the distance again, infinite once it is done with.
        link, stack: work space.

    Returns:
        Depth, what it may be too large by, iterations; the normal in `best`, in rows 0 to 2 of s
        the corners of its face, and their shares.
    """
    m = _normal(s, 0, 1, 2)
    if m[0] * (s[3, 0] - s[0, 0]) + m[1] * (s[3, 1] - s[0, 1]) + m[2] * (s[3, 2] - s[0, 2]) > 0.0:
        for c in range(9):
            s[1, c], s[2, c] = s[2, c], s[1, c]
    _face(0, 0, 1, 2, s, corner, face, key)
    _face(1, 0, 3, 1, s, corner, face, key)
    _face(2, 1, 3, 2, s, corner, face, key)
    _face(3, 2, 3, 0, s, corner, face, key)
    beyond[0, 0], beyond[0, 1], beyond[0, 2] = 1, 2, 3
    beyond[1, 0], beyond[1, 1], beyond[1, 2] = 3, 2, 0
    beyond[2, 0], beyond[2, 1], beyond[2, 2] = 1, 3, 0
    beyond[3, 0], beyond[3, 1], beyond[3, 2] = 2, 1, 0
    faces, vertices, iterations = 4, 4, 0
    rounding = 16.0 * _EPS * pair[_SIZE]
    depth, low = math.inf, -math.inf
    while True:
        f = 0
        for g in range(1, faces):
            if key[g] < key[f]:
                f = g
        low = key[f]
        if low > depth + rounding:
            break
        iterations += 1
        x, y, z = face[f, 0], face[f, 1], face[f, 2]
        _support(x, y, z, va, vb, pair, s, vertices)
        sx, sy, sz = s[vertices, 0], s[vertices, 1], s[vertices, 2]
        high = x * sx + y * sy + z * sz
        last = high - face[f, 3] <= rounding
        if high < depth:
            depth = high
            best[0], best[1], best[2] = x, y, z
        if last:
            break
        if vertices == _VERTICES or _known(s, vertices, vertices):
            key[f] = math.inf
            continue
        # Faces that the new vertex sees go; each edge of the hole makes a face with it.
        key[f] = math.nan
        stack[0] = f
        seen, gone = 1, 0
        edges = 0
        while gone < seen:
            old = stack[gone]
            gone += 1
            for e in range(3):
                g = beyond[old, e]
                if math.isnan(key[g]):
                    continue
                if face[g, 0] * sx + face[g, 1] * sy + face[g, 2] * sz > face[g, 3] + rounding:
                    key[g] = math.nan
                    stack[seen] = g
                    seen += 1
                else:
                    link[edges, 0], link[edges, 1] = corner[old, e], corner[old, (e + 1) % 3]
                    link[edges, 2] = g
                    edges += 1
        for n in range(edges):
            new = stack[n] if n < seen else faces
            faces = max(faces, new + 1)
            p, q, g = link[n, 0], link[n, 1], link[n, 2]
            _face(new, p, q, vertices, s, corner, face, key)
            beyond[new, 0] = g
            for e in range(3):
                if corner[g, e] == q:
                    beyond[g, e] = new
            link[n, 5] = new
            link[p, 3] = new  # the new face whose edge begins at p,
            link[q, 4] = new  # and whose ends at q
        for n in range(edges):
            new = link[n, 5]
            beyond[new, 1] = link[link[n, 1], 3]
            beyond[new, 2] = link[link[n, 0], 4]
        for n in range(edges, seen):
            key[stack[n]] = math.inf
        vertices += 1
    # Several triangles may lie in the plane of the nearest face: the one that the origin is above.
    inside, f = -math.inf, 0
    for g in range(faces):
        aligned = face[g, 0] * best[0] + face[g, 1] * best[1] + face[g, 2] * best[2]
        if math.isfinite(key[g]) and aligned > 1.0 - 1e-9 and key[g] <= depth + rounding:
            i, j, k = corner[g, 0], corner[g, 1], corner[g, 2]
            u, v, w = _area(best, s, j, k), _area(best, s, k, i), _area(best, s, i, j)
            least = min(u, v, w) / (u + v + w)
            if least > inside:
                inside, f = least, g
                share[0], share[1], share[2] = max(u, 0.0), max(v, 0.0), max(w, 0.0)
    total = share[0] + share[1] + share[2]
    i, j, k = corner[f, 0], corner[f, 1], corner[f, 2]
    for c in range(9):
        a, b, d = s[i, c], s[j, c], s[k, c]
        s[0, c], s[1, c], s[2, c] = a, b, d
    for c in range(3):
        share[c] /= total
    return depth, depth - min(low, depth), iterations


@register_jitable
def rotation(w, x, y, z, out, at):
    """Write the rotation matrix of a unit quaternion into nine places of out, row by row."""
    out[at], out[at + 4], out[at + 8] = (y * y + z * z, x * x + z * z, x * x + y * y)
    for k in range(0, 9, 4):
        out[at + k] = 1.0 - 2.0 * out[at + k]
    out[at + 1], out[at + 3] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    out[at + 2], out[at + 6] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    out[at + 5], out[at + 7] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)


@register_jitable
def workspace():
    """The arrays that a pair is worked out in, made once for a whole batch."""
    room = 2 * _VERTICES
    return (
        np.empty((_VERTICES + 4, 9)),
        np.empty(32),
        np.empty((2, 4)),
        np.empty((room, 3), np.int64),
        np.empty((room, 3), np.int64),
        np.empty((room, 4)),
        np.empty(room),
        np.empty((room, 6), np.int64),
        np.empty(room, np.int64),
    )


@register_jitable
def measure(va, vb, halves, sizes, qa, qb, i, out, work):
    """Write column i of out: the distance of shape a at qa[:, i] from shape b at qb[:, i].

    Args:
        va, vb: vertices of the cores, shapes (3, n) and (3, m) [m].
        halves: half sizes of a, then of b, shape (6,) [m].
        sizes: radius of a, radius of b, the sum of both cores' sizes, 2.0 or 3.0 dimensions.
        qa, qb: poses, shape (7, N).
        out: shape (12, N): distance, normal from a to b, points on a and on b, what the distance
            may be off by, and iterations.
        work: of `workspace`.
    """
    s, pair, small, corner, beyond, face, key, link, stack = work
    share, v = small[0], small[1]
    w, x, y, z = qa[3, i], qa[4, i], qa[5, i], qa[6, i]
    rotation(w, x, y, z, pair, 19)
    d, e, f, g = qb[3, i], qb[4, i], qb[5, i], qb[6, i]
    # Of equal rotations the difference is exactly none.
    rotation(
        w * d + x * e + y * f + z * g,
        w * e - x * d - y * g + z * f,
        w * f - y * d - z * e + x * g,
        w * g - z * d - x * f + y * e,
        pair,
        _R,
    )
    x, y, z = qb[0, i] - qa[0, i], qb[1, i] - qa[1, i], qb[2, i] - qa[2, i]
    for c in range(3):
        pair[_P + c] = pair[19 + c] * x + pair[22 + c] * y + pair[25 + c] * z
        pair[_A + c], pair[_B + c] = halves[c], halves[3 + c]
    pair[_SIZE] = sizes[2] + math.sqrt(x * x + y * y + z * z)
    n, core, low, rounds = _gjk(va, vb, pair, s, share, v)
    if n < 5 and core > 40.0 * _EPS * pair[_SIZE]:
        gap = core - low
        v[0], v[1], v[2] = _unit(-v[0], -v[1], -v[2])
    else:
        if sizes[3] == 2.0:
            # The plane's shapes become bars, so long that none is pushed out at its end.
            pair[2] = 4.0 * pair[_SIZE]
            n = 4
        solid = n == 5 or _grow(va, vb, pair, s, v)
        if solid:
            depth, gap, more = _epa(
                va, vb, pair, s, share, v, corner, beyond, face, key, link, stack
            )
            core, n = -depth, 3
            rounds += more
        else:
            core, gap = 0.0, 0.0
            # Of the two sides of a flat set, the one towards b.
            if v[0] * pair[_P] + v[1] * pair[_P + 1] + v[2] * pair[_P + 2] < 0.0:
                v[0], v[1], v[2] = -v[0], -v[1], -v[2]
    out[0, i] = core - sizes[0] - sizes[1]
    out[10, i], out[11, i] = max(gap, 0.0), rounds
    # The point of a's core, and b's core across the distance; then both move by their radii.
    for c in range(3):
        point = 0.0
        for k in range(n):
            point += share[k] * s[k, 3 + c]
        pair[28 + c] = point
    for c in range(3):
        out[1 + c, i] = pair[19 + 3 * c] * v[0] + pair[20 + 3 * c] * v[1] + pair[21 + 3 * c] * v[2]
        out[4 + c, i] = (
            qa[c, i]
            + pair[19 + 3 * c] * pair[28]
            + pair[20 + 3 * c] * pair[29]
            + pair[21 + 3 * c] * pair[30]
            + sizes[0] * out[1 + c, i]
        )
        out[7 + c, i] = out[4 + c, i] + out[0, i] * out[1 + c, i]


def _distances(va, vb, halves, sizes, qa, qb, out):
    work = workspace()
    for i in range(qa.shape[1]):
        measure(va, vb, halves, sizes, qa, qb, i, out, work)


@functools.cache
def _kernel():
    return compiled(_distances, void(MATRIX, MATRIX, VECTOR, VECTOR, MATRIX, MATRIX, MATRIX))


@dataclass(frozen=True)
class Distance:
    """How two shapes lie to each other; arrays of a batch have one more axis, the last.

    point_b - point_a = distance * normal, whether they are apart or in each other.

    Attributes:
        distance: signed: positive apart, 0 touching, negative by the least depth [m].
        normal: unit vector from a to b, shape (dim,). Where it is not unique, as between concentric
            spheres, it is one of the right ones. Between cores that all but touch, its error is
            rounding over their distance.
        point_a, point_b: the nearest points of both surfaces, or the deepest, shape (dim,) [m].
        gap: what the distance may be too large by [m]; rounding, unless the search was cut short.
        iterations: of both searches.
    """

    distance: Array
    normal: Array
    point_a: Array
    point_b: Array
    gap: Array
    iterations: Array


def paired(a: Shape, pose_a: ArrayLike, b: Shape, pose_b: ArrayLike) -> tuple[Array, Array, bool]:
    """Poses of two shapes as poses in space of one length, and whether both are single.

    Raises:
        ValueError: for shapes of different dimensions, two planes, or batches of unequal length.
    """
    if a.dim != b.dim:
        raise refused("b.dim", b.dim, f"{a.dim}, as that of a")
    if a.name == b.name == "plane":
        raise refused("b", b.name, "no plane, as a is one: planes are not convex bodies")
    qa, qb = poses("pose_a", pose_a, a.dim), poses("pose_b", pose_b, b.dim)
    n = max(qa.shape[1], qb.shape[1]) if min(qa.shape[1], qb.shape[1]) else 0
    for name, q in (("pose_a", qa), ("pose_b", qb)):
        if q.shape[1] not in (1, n):
            raise refused(f"{name}.shape[1]", q.shape[1], f"1 or {n}, as the other batch")
    single = np.ndim(pose_a) == np.ndim(pose_b) == 1
    return (
        np.array(np.broadcast_to(qa, (7, n)), order="C"),
        np.array(np.broadcast_to(qb, (7, n)), order="C"),
        single,
    )


def _from_plane(a: Shape, qa: Array, b: Shape, qb: Array) -> Array:
    """The rows of `measure` for a plane a: its normal, and the lowest corner of b."""
    normal = to_matrix(qa[3:])[:, a.dim - 1]
    corner = np.einsum("ijn,jk->ikn", to_matrix(qb[3:]), b.corners) + (qb - qa)[:3, None]
    height = np.einsum("in,ikn->kn", normal, corner)
    lowest = height.argmin(axis=0)
    far = height.min(axis=0) - b.radius
    point = np.take_along_axis(corner, lowest[None, None], 1)[:, 0] + qa[:3] - b.radius * normal
    return np.vstack((far, normal, point - far * normal, point, np.zeros((2, far.size))))


def measured(a: Shape, qa: Array, b: Shape, qb: Array) -> Array:
    """`distance` for poses in space that are checked: the rows of `measure`, shape (12, N)."""
    if a.name == "plane":
        return _from_plane(a, qa, b, qb)
    if b.name == "plane":
        rows = _from_plane(b, qb, a, qa)
        return np.vstack((rows[0], -rows[1:4], rows[7:10], rows[4:7], rows[10:]))
    sizes = np.array([a.radius, b.radius, a.size - a.radius + b.size - b.radius, a.dim], float)
    out = np.empty((12, qa.shape[1]))
    _kernel()(a.vertices, b.vertices, np.concatenate((a.half, b.half)), sizes, qa, qb, out)
    return out


def distance(a: Shape, pose_a: ArrayLike, b: Shape, pose_b: ArrayLike) -> Distance:
    """The signed distance of two shapes, with the nearest or deepest points.

    Args:
        a, b: shapes of one dimension; one of them may be a plane.
        pose_a, pose_b: their poses; single, or batches of one length.

    Returns:
        Arrays over the batch; plain shapes (), (dim,) where both poses are single.

    Raises:
        ValueError: for different dimensions, two planes, unequal batches, a NaN, or a quaternion
            that is not of unit length.
    """
    qa, qb, single = paired(a, pose_a, b, pose_b)
    rows = measured(a, qa, b, qb)
    rows = rows[:, 0] if single else rows
    normal, at_a, at_b = (rows[k : k + a.dim] for k in (1, 4, 7))
    return Distance(rows[0], normal, at_a, at_b, rows[10], rows[11].astype(int))


def warm() -> None:
    """Compile the loop of this file."""
    _kernel()
