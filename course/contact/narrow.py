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

from course.check import invalid
from course.compiled import MATRIX, VECTOR, compiled
from course.contact.shapes import Array, Shape, corners_in_space
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import poses

_EPS = 2.0**-52
_SIDE = 16.0 * _EPS  # of the size: how far rounding puts a point on the wrong side of a face
_NEEDLE = 1e-4  # height to longest edge of a face whose plane is known worse than that
_ALL = 1 << 30  # iterations of GJK: as many as it takes
_STUCK = 4  # iterations in a row that bring neither bound of the distance nearer
# Vertices that a growing polytope may have, and more for each corner of the shapes: where both are
# round and nearly concentric, it needs many. Its faces are fewer than twice as many.
_VERTICES, _PER_CORNER = 120, 4

# Where a pair of shapes stands in its array of numbers: half sizes of a and of b, centre and
# rotation of b, all in the frame of a, the size that rounding is measured in, the rotation of a.
_A, _B, _P, _R, _SIZE, _TURN = 0, 3, 6, 9, 18, 19
# Corners of a tetrahedron's faces from outside, and the faces across the edges that begin there.
_FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_ACROSS = ((1, 2, 3), (3, 2, 0), (1, 3, 0), (2, 1, 0))


@register_jitable
def dot(a, b):
    """Return a . b of triples."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@register_jitable
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@register_jitable
def _added(a, t, b):
    """Return a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


@register_jitable
def _across(a, e):
    """Return the part of a at right angles to e."""
    return _added(a, -dot(a, e) / dot(e, e), e)


@register_jitable
def _unit(a):
    length = math.sqrt(dot(a, a))
    return a[0] / length, a[1] / length, a[2] / length


@register_jitable
def _row(s, i):
    return s[i, 0], s[i, 1], s[i, 2]


@register_jitable
def _copy(s, i, k):
    """Make row k what row i is."""
    for c in range(9):
        s[k, c] = s[i, c]


@register_jitable
def turned(R, at, a):
    """Return R a, of a rotation matrix whose nine numbers stand row by row in R from `at` on."""
    return (
        R[at] * a[0] + R[at + 1] * a[1] + R[at + 2] * a[2],
        R[at + 3] * a[0] + R[at + 4] * a[1] + R[at + 5] * a[2],
        R[at + 6] * a[0] + R[at + 7] * a[1] + R[at + 8] * a[2],
    )


@register_jitable
def turned_back(R, at, a):
    """Return R^T a."""
    return (
        R[at] * a[0] + R[at + 3] * a[1] + R[at + 6] * a[2],
        R[at + 1] * a[0] + R[at + 4] * a[1] + R[at + 7] * a[2],
        R[at + 2] * a[0] + R[at + 5] * a[1] + R[at + 8] * a[2],
    )


@register_jitable
def _support(d, va, vb, pair, out, k):
    """Row k of out: the point of the set of differences farthest along d, then of a, of b.

    The sign of a component picks the corner of a box; vertices are searched.
    """
    x, y, z = d
    best, top = 0, -math.inf
    # Vertices first, then the box that is added: its farthest corner has the signs of d.
    for i in range(va.shape[1]):
        value = va[0, i] * x + va[1, i] * y + va[2, i] * z
        if value > top:
            best, top = i, value
    ax = va[0, best] + math.copysign(pair[0], x)
    ay = va[1, best] + math.copysign(pair[1], y)
    az = va[2, best] + math.copysign(pair[2], z)
    x, y, z = turned_back(pair, _R, (-x, -y, -z))
    best, top = 0, -math.inf
    for i in range(vb.shape[1]):
        value = vb[0, i] * x + vb[1, i] * y + vb[2, i] * z
        if value > top:
            best, top = i, value
    x = vb[0, best] + math.copysign(pair[3], x)
    y = vb[1, best] + math.copysign(pair[4], y)
    z = vb[2, best] + math.copysign(pair[5], z)
    x, y, z = turned(pair, _R, (x, y, z))
    bx, by, bz = x + pair[6], y + pair[7], z + pair[8]
    out[k, 0], out[k, 1], out[k, 2] = ax - bx, ay - by, az - bz
    out[k, 3], out[k, 4], out[k, 5] = ax, ay, az
    out[k, 6], out[k, 7], out[k, 8] = bx, by, bz


@register_jitable
def _edge(s, i, j):
    """Return the vector from row i of s to row j."""
    return _added(_row(s, j), -1.0, _row(s, i))


@register_jitable
def _normal(s, i, j, k):
    """Return twice the area of the triangle i, j, k of rows of s, as a vector."""
    return _cross(_edge(s, i, j), _edge(s, i, k))


@register_jitable
def _areas(n, s, i, j, k):
    """Return the parts of n . (normal of i, j, k) that lie across from i, j and k."""
    p, q, r = _row(s, i), _row(s, j), _row(s, k)
    return dot(n, _cross(q, r)), dot(n, _cross(r, p)), dot(n, _cross(p, q))


@register_jitable
def _on_edge(s, i, j):
    """Return the share of j in the point of the edge i, j nearest to the origin."""
    e = _edge(s, i, j)
    length, along = dot(e, e), -dot(_row(s, i), e)
    return 0.0 if along <= 0.0 else 1.0 if along >= length else along / length


@register_jitable
def _square(s, i, j, k, shares):
    """Return squared distance from the origin of a point of the triangle i, j, k."""
    u, v, w = shares
    zero = (0.0, 0.0, 0.0)
    p = _added(_added(_added(zero, u, _row(s, i)), v, _row(s, j)), w, _row(s, k))
    return dot(p, p)


@register_jitable
def _on_triangle(s, i, j, k):
    """Return shares of i, j, k in the point of their triangle nearest to the origin.

    Of two edges that rounding cannot tell apart, one with the newest vertex, k, is taken: the edge
    without it would be the simplex of the iteration before, and nothing more would be learned.
    """
    # Barycentric coordinates of the origin's projection: all positive means inside.
    u, v, w = _areas(_normal(s, i, j, k), s, i, j, k)
    if u > 0.0 and v > 0.0 and w > 0.0:
        total = u + v + w
        return u / total, v / total, w / total
    # Not inside: the nearest of the three edges, which costs little and trusts no sign.
    u, v, w = _on_edge(s, i, j), _on_edge(s, j, k), _on_edge(s, k, i)
    result = (0.0, 1.0 - v, v)
    best = _square(s, i, j, k, result)
    for shares, least in (((w, 0.0, 1.0 - w), 1.0), ((1.0 - u, u, 0.0), 1.0 - 8.0 * _EPS)):
        far = _square(s, i, j, k, shares)
        if far < least * best:
            best, result = far, shares
    return result


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
        # Tetrahedron: the nearest point is on a face that has the origin on its outer side.
        best = math.inf
        for face in range(4):
            # In ascending order: the newest vertex is the last, or it is the one left out.
            i, j, k = 0 if face > 0 else 1, 1 if face > 1 else 2, 2 if face > 2 else 3
            m = _normal(s, i, j, k)
            # A tetrahedron thinner than rounding has no reliable sides, so none of its faces is
            # ruled out.
            here = dot(m, _row(s, i))
            other = here - dot(m, _row(s, face))
            if here * other > 0.0 and other * other > dot(m, m) * thin * thin:
                continue  # the origin is on the inner side of this face
            shares = _on_triangle(s, i, j, k)
            far = _square(s, i, j, k, shares)
            if far < best:
                best = far
                share[face] = 0.0
                share[i], share[j], share[k] = shares
        if best == math.inf:
            return 5
    # Keep the vertices that carry the nearest point: the reduced simplex of Gilbert, Johnson and
    # Keerthi.
    retained = 0
    for i in range(n):
        if share[i] > 0.0:
            if retained < i:
                share[retained] = share[i]
                _copy(s, i, retained)
            retained += 1
    return retained


@register_jitable
def _known(s, n):
    """Return whether row n of s is one of those before it."""
    for i in range(n):
        if s[i, 0] == s[n, 0] and s[i, 1] == s[n, 1] and s[i, 2] == s[n, 2]:
            return True
    return False


@register_jitable
def _gjk(va, vb, pair, s, share, most=_ALL):
    """Return the point of the set of differences nearest to the origin, as shares of rows of s.

    After `most` iterations it stops, so that a picture can show each of them.

    Returns:
        How many rows of s hold it, 5 where the origin is inside; its distance, and a lower bound of
        that; how many iterations; the direction that proves the bound, of any length.
    """
    # Start along the line of the centres, which is often close to the answer.
    p = (pair[_P], pair[_P + 1], pair[_P + 2])
    if p[0] == 0.0 and p[1] == 0.0 and p[2] == 0.0:
        p = (-1.0, 0.0, 0.0)
    _support(p, va, vb, pair, s, 0)
    n = 1
    share[0] = 1.0
    x = proof = _row(s, 0)
    square = dot(x, x)
    low, last, rounding = -math.inf, math.inf, 4.0 * _EPS * pair[_SIZE]
    iterations, stuck = 0, 0
    while iterations < most and square > 100.0 * rounding * rounding:  # below, they touch
        iterations += 1
        # support: the point of the Minkowski difference farthest towards the origin.
        _support((-x[0], -x[1], -x[2]), va, vb, pair, s, n)
        # All of the set lies beyond the plane through this support.
        bound = dot(x, _row(s, n)) / math.sqrt(dot(x, x))
        # No progress in either bound: rounding, so a few rounds of it end the loop.
        stuck = stuck + 1 if square >= last and bound <= low else 0
        last = min(square, last)
        if bound > low:
            low, proof = bound, x
        if math.sqrt(square) - low <= rounding or stuck == _STUCK or _known(s, n):
            break  # certain; or rounding lets neither bound come nearer
        # nearest: reduce the simplex to its part nearest to the origin (distance sub-algorithm).
        n = _nearest(s, n + 1, share, rounding)
        if n == 5:
            break
        x = (0.0, 0.0, 0.0)
        for i in range(n):
            x = _added(x, share[i], _row(s, i))
        square = dot(x, x)
        if n == 2:
            # Of an edge, what rounding left along it goes.
            x = _across(x, _edge(s, 0, 1))
        elif n == 3:
            # The triangle's normal keeps its direction where the point is all but zero, and the
            # point where the triangle is all but an edge: of both the one that rounding hurts less.
            m = _normal(s, 0, 1, 2)
            side = dot(m, _row(s, 0))
            if side != 0.0 and dot(m, m) > square * pair[_SIZE] * pair[_SIZE]:
                x = m if side > 0.0 else (-m[0], -m[1], -m[2])
            else:
                # Shares of a needle are known badly along it.
                e, f, g = _edge(s, 0, 1), _edge(s, 1, 2), _edge(s, 2, 0)
                e = f if dot(f, f) > dot(e, e) else e
                e = g if dot(g, g) > dot(e, e) else e
                x = _across(x, e)
        if x[0] == 0.0 and x[1] == 0.0 and x[2] == 0.0:
            square = 0.0
    return n, math.sqrt(square), low, iterations, proof


@register_jitable
def _spread(s, k, rank, d):
    """Return how far row k is from row 0, from the line of rows 0 and 1, or along d."""
    if rank == 2:
        return abs(dot(d, _edge(s, 0, k)))
    m = _edge(s, 0, k) if rank == 0 else _cross(_unit(_edge(s, 0, 1)), _edge(s, 0, k))
    return math.sqrt(dot(m, m))


@register_jitable
def _farther(va, vb, pair, s, k, d, rank):
    """Put the supports along and against d into row k if they are farther off; how far."""
    far = _spread(s, k, rank, d)
    for sign in (1.0, -1.0):
        _support((sign * d[0], sign * d[1], sign * d[2]), va, vb, pair, s, k + 1)
        deviation = _spread(s, k + 1, rank, d)
        if deviation > far:
            far = deviation
            _copy(s, k + 1, k)
    return far


@register_jitable
def _grow(va, vb, pair, s):
    """Return four rows of s that span the set of differences, or the normal of a set that is flat.

    Returns:
        Whether the set has a volume; if not, a unit vector that is the same on all of it.
    """
    flat = (1.0, 0.0, 0.0)
    _support(flat, va, vb, pair, s, 0)
    # Grow the hull by one dimension at a time: point, line, triangle, tetrahedron.
    for rank in range(3):
        _copy(s, 0, rank + 1)
        if rank == 0:
            _farther(va, vb, pair, s, 1, (0.0, 0.0, 1.0), 0)
            _farther(va, vb, pair, s, 1, (0.0, 1.0, 0.0), 0)
        elif rank == 1:
            # Two directions at right angles to the line.
            e = _unit(_edge(s, 0, 1))
            flat = _unit((-e[1], e[0], 0.0) if abs(e[2]) <= 0.8 else (e[2], 0.0, -e[0]))
            _farther(va, vb, pair, s, 2, _cross(e, flat), 1)
        else:
            flat = _unit(_normal(s, 0, 1, 2))
        if _farther(va, vb, pair, s, rank + 1, flat, rank) <= _SIDE * pair[_SIZE]:
            return False, flat
    return True, flat


@register_jitable
def _apart(s, i, j, k):
    """Return the distance between the origin and the triangle i, j, k, a needle or a fold.

    Unlike the distance to its plane it has no sign, and it hardly depends on how a needle is turned
    about its length.
    """
    far = math.sqrt(_square(s, i, j, k, _on_triangle(s, i, j, k)))
    for p, q in ((i, j), (j, k), (k, i)):
        nearest = _added(_row(s, p), _on_edge(s, p, q), _edge(s, p, q))
        far = min(far, math.sqrt(dot(nearest, nearest)))
    return far


@register_jitable
def _face(f, i, j, k, s, size, middle, corner, face, key):
    """Write face f: its corners, unit normal away from `middle`, and distance from the origin."""
    corner[f, 0], corner[f, 1], corner[f, 2] = i, j, k
    face[f, 4], face[f, 5] = _SIDE * size, math.inf
    m = _normal(s, i, j, k)
    # The rounding of its corners tilts a needle about its longest edge, so that a point at the
    # other end of the set seems to lie on a side on which it does not.
    area, longest = dot(m, m), 0.0
    for p, q in ((i, j), (j, k), (k, i)):
        e = _edge(s, p, q)
        longest = max(longest, dot(e, e))
    if area < _NEEDLE * _NEEDLE * longest * longest:
        # By the size over the height of the needle.
        face[f, 4] *= size * math.sqrt(longest / area) if area > 0.0 else math.inf
    if area > 0.0:
        m = _unit(m)
        far = dot(m, _row(s, i))
        # A vertex that is beyond a face by little more than rounding folds the surface: one of its
        # faces lies on its back. As a plane that bounds the set it is as good as the others.
        if dot(m, middle) - far > face[f, 4]:
            m, far = (-m[0], -m[1], -m[2]), -far
        face[f, 3] = key[f] = far
    else:
        face[f, 3], key[f] = 0.0, math.inf
    face[f, 0], face[f, 1], face[f, 2] = m


@register_jitable
def _epa(va, vb, pair, s, share, corner, beyond, face, key, link, stack):
    """Return the least depth of the origin in the set of differences that rows 0 to 3 of s span.

    The polytope grows at the face that is nearest to the origin. The support along any direction
    bounds the depth from above, the nearest face from below.

    Args:
        va: vertices of core a, shape (3, n) [m].
        vb: vertices of core b, shape (3, m) [m].
        pair: numbers of the pair, at the offsets `_A` to `_TURN`.
        s: points of the set of differences, each with its points of a and of b, rows of 9.
        share: output, weights of the corners of the nearest face.
        corner: corners of each face, counter-clockwise from outside.
        beyond: neighbours of each face, across the edges that begin at its corners.
        face: of each face its normal, its distance, how far a point may seem to be beyond it by
            rounding, and the bound that it proves where it was given up.
        key: distance of each face again, infinite once it is done with, -inf once it is removed.
        link: work space, the edges of the horizon and the new faces at them.
        stack: work space, the faces still to be visited.

    Returns:
        Depth, what it may be too large by, iterations, normal; in rows 0 to 2 of s the corners of
        its face, and their shares.
    """
    # Orient the tetrahedron so that its normals point outwards.
    if dot(_normal(s, 0, 1, 2), _edge(s, 0, 3)) > 0.0:
        for c in range(9):
            s[1, c], s[2, c] = s[2, c], s[1, c]
    # A point within the tetrahedron, and so within the polytope at all times.
    middle = (0.0, 0.0, 0.0)
    for c in range(4):
        middle = _added(middle, 0.25, _row(s, c))
    for f in range(4):
        i, j, k = _FACES[f]
        _face(f, i, j, k, s, pair[_SIZE], middle, corner, face, key)
        beyond[f, 0], beyond[f, 1], beyond[f, 2] = _ACROSS[f]
    faces, new, iterations = 4, 4, 0  # `new` is the row of the next vertex
    rounding = _SIDE * pair[_SIZE]
    depth, low, best = math.inf, -math.inf, (0.0, 0.0, 0.0)
    while True:
        # closest face: a linear search; polytopes have few faces.
        f = 0
        for g in range(1, faces):
            f = g if key[g] < key[f] else f
        low = key[f]
        if low > depth + rounding:
            break
        iterations += 1
        # expand_polytope: the support beyond that face is the new vertex.
        normal = _row(face, f)
        _support(normal, va, vb, pair, s, new)
        point = _row(s, new)
        high = dot(normal, point)
        # The support distance along any direction bounds the depth from above.
        if high < depth:
            depth, best = high, normal
        needle = face[f, 4] > rounding
        if high - face[f, 3] <= rounding and not needle:
            break
        if high - face[f, 3] <= face[f, 4] or new == s.shape[0] - 4 or _known(s, new):
            # Nothing beyond this face but rounding, or no room: it stays a bound of the depth. A
            # vertex just outside of a face of its own plane folds the surface there: one of its
            # faces looks inwards. What bounds the depth is how far such a face is, not its sign.
            i, j, k = corner[f, 0], corner[f, 1], corner[f, 2]
            face[f, 5] = _apart(s, i, j, k) if needle or key[f] < 0.0 else key[f]
            key[f] = math.inf
            continue
        # Faces that the new vertex sees go (-inf); each edge of the hole makes a face with it.
        key[f] = -math.inf
        stack[0] = f
        observed, missing, edges = 1, 0, 0
        # Flood fill from the closest face: the faces that the new vertex sees form one patch, and
        # the edges around it are the horizon.
        while missing < observed:
            old = stack[missing]
            missing += 1
            for e in range(3):
                g = beyond[old, e]
                if key[g] == -math.inf:
                    continue
                if dot(_row(face, g), point) > face[g, 3] + face[g, 4]:
                    key[g] = -math.inf
                    stack[observed] = g
                    observed += 1
                else:
                    link[edges, 0], link[edges, 1] = corner[old, e], corner[old, (e + 1) % 3]
                    link[edges, 2] = g
                    edges += 1
        # Close the hole with a fan of faces from the horizon to the new vertex. Rows of removed
        # faces are used again.
        for n in range(edges):
            made = stack[n] if n < observed else faces
            faces = max(faces, made + 1)
            p, q, g = link[n, 0], link[n, 1], link[n, 2]
            _face(made, p, q, new, s, pair[_SIZE], middle, corner, face, key)
            beyond[made, 0] = g
            for e in range(3):
                if corner[g, e] == q:
                    beyond[g, e] = made
            # The new face of this edge, the one whose edge begins at p, the one whose ends at q.
            link[n, 5] = link[p, 3] = link[q, 4] = made
        # Link neighbours within the fan.
        for n in range(edges):
            made = link[n, 5]
            beyond[made, 1], beyond[made, 2] = link[link[n, 1], 3], link[link[n, 0], 4]
        # Rows that the fan does not need stay removed.
        for n in range(edges, observed):
            key[stack[n]] = face[stack[n], 5] = math.inf
        new += 1
    # Several triangles may lie in the plane of the nearest face: the one that the origin is above.
    inside, f = -math.inf, 0
    for g in range(faces):
        aligned = dot(_row(face, g), best) > 1.0 - 1e-9
        if aligned and key[g] <= depth + rounding:
            u, v, w = _areas(best, s, corner[g, 0], corner[g, 1], corner[g, 2])
            least = min(u, v, w) / (u + v + w)
            # Of a face on its back all three areas are negative.
            if u + v + w > 0.0 and least > inside:
                inside, f = least, g
                u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
                total = u + v + w
                share[0], share[1], share[2] = u / total, v / total, w / total
    i, j, k = corner[f, 0], corner[f, 1], corner[f, 2]
    for c in range(9):
        s[0, c], s[1, c], s[2, c] = s[i, c], s[j, c], s[k, c]
    for g in range(faces):
        low = min(low, face[g, 5])
    return depth, depth - min(low, depth), iterations, best


@register_jitable
def rotation(q, out, at):
    """Write the rotation matrix of a unit quaternion into nine places of out, row by row."""
    w, x, y, z = q
    out[at], out[at + 4], out[at + 8] = (y * y + z * z, x * x + z * z, x * x + y * y)
    for k in range(0, 9, 4):
        out[at + k] = 1.0 - 2.0 * out[at + k]
    out[at + 1], out[at + 3] = 2.0 * (x * y - w * z), 2.0 * (x * y + w * z)
    out[at + 2], out[at + 6] = 2.0 * (x * z + w * y), 2.0 * (x * z - w * y)
    out[at + 5], out[at + 7] = 2.0 * (y * z - w * x), 2.0 * (y * z + w * x)


@register_jitable
def _from_point(half, radius, radius_y, sign, dims, qx, qy, i, out, pair):
    """`measure` where one core is a point, y, and the other a box about its origin, x: no search.

    half and radius are those of x [m]; sign is 1.0 if x is the first shape, -1.0 if the second.
    """
    rotation((qx[3, i], qx[4, i], qx[5, i], qx[6, i]), pair, _TURN)
    offset = (qy[0, i] - qx[0, i], qy[1, i] - qx[1, i], qy[2, i] - qx[2, i])
    p = turned_back(pair, _TURN, offset)
    near = (
        min(max(p[0], -half[0]), half[0]),
        min(max(p[1], -half[1]), half[1]),
        min(max(p[2], -half[2]), half[2]),
    )
    # The nearest point of a box is the clamped point.
    v = _added(p, -1.0, near)
    core = math.sqrt(dot(v, v))
    if core > 1e-140:
        v = (v[0] / core, v[1] / core, v[2] / core)
    else:  # inside: out through the nearest face
        k, core = 0, abs(p[0]) - half[0]
        for c in range(1, dims):
            if abs(p[c]) - half[c] > core:
                k, core = c, abs(p[c]) - half[c]
        side = math.copysign(1.0, p[k])
        v = (side * (k == 0), side * (k == 1), side * (k == 2))
        near = _added(p, -core, v)
    v, near = turned(pair, _TURN, v), turned(pair, _TURN, near)
    on_x = _added(_added((qx[0, i], qx[1, i], qx[2, i]), 1.0, near), radius, v)
    out[0, i] = core - radius - radius_y
    out[1, i], out[2, i], out[3, i] = sign * v[0], sign * v[1], sign * v[2]
    a, b = (4, 7) if sign > 0.0 else (7, 4)
    out[a, i], out[a + 1, i], out[a + 2, i] = on_x
    out[b, i], out[b + 1, i], out[b + 2, i] = _added(on_x, out[0, i], v)
    out[10, i] = out[11, i] = 0.0


@register_jitable
def measure(va, vb, halves, sizes, qa, qb, i, out, work):
    """Write column i of out: the distance of shape a at qa[:, i] from shape b at qb[:, i].

    Args:
        va: vertices of core a, shape (3, n) [m].
        vb: vertices of core b, shape (3, m) [m].
        halves: half sizes of a, then of b, shape (6,) [m].
        sizes: radius of a, radius of b, the sum of both cores' sizes, 2.0 or 3.0 dimensions.
        qa: poses of a, shape (7, N).
        qb: poses of b, shape (7, N).
        i: the column.
        out: shape (12, N): distance, normal from a to b, points on a and on b, what the distance
            may be off by, and iterations.
        work: as `_distances` makes it.
    """
    s, pair, share, corner, beyond, face, key, link, stack = work
    w, x, y, z = qa[3, i], qa[4, i], qa[5, i], qa[6, i]
    rotation((w, x, y, z), pair, _TURN)
    d, e, f, g = qb[3, i], qb[4, i], qb[5, i], qb[6, i]
    # Of equal rotations the difference is exactly none.
    relative = (
        w * d + x * e + y * f + z * g,
        w * e - x * d - y * g + z * f,
        w * f - y * d - z * e + x * g,
        w * g - z * d - x * f + y * e,
    )
    rotation(relative, pair, _R)
    offset = (qb[0, i] - qa[0, i], qb[1, i] - qa[1, i], qb[2, i] - qa[2, i])
    for c in range(6):
        pair[c] = halves[c]
    pair[_P], pair[_P + 1], pair[_P + 2] = turned_back(pair, _TURN, offset)
    pair[_SIZE] = sizes[2] + math.sqrt(dot(offset, offset))
    # GJK finds the distance of the cores; only cores that overlap need EPA.
    n, core, low, rounds, v = _gjk(va, vb, pair, s, share)
    if n < 5 and core > 40.0 * _EPS * pair[_SIZE]:
        gap = core - low
        v = _unit((-v[0], -v[1], -v[2]))
    else:
        if sizes[3] == 2.0:
            # The plane's shapes become bars, so long that none is pushed out at its end.
            pair[2] = 4.0 * pair[_SIZE]
            n = 4
        solid = n == 5
        if not solid:
            solid, v = _grow(va, vb, pair, s)
        if solid:
            depth, gap, more, v = _epa(
                va, vb, pair, s, share, corner, beyond, face, key, link, stack
            )
            core, n = -depth, 3
            rounds += more
        else:
            core, gap = 0.0, 0.0
            # Of the two sides of a flat set, the one towards b.
            if dot(v, (pair[_P], pair[_P + 1], pair[_P + 2])) < 0.0:
                v = (-v[0], -v[1], -v[2])
    out[0, i] = core - sizes[0] - sizes[1]
    out[10, i], out[11, i] = max(gap, 0.0), rounds
    # The point of a's core, and b's core across the distance; then both move by their radii.
    point = (0.0, 0.0, 0.0)
    for k in range(n):
        point = _added(point, share[k], (s[k, 3], s[k, 4], s[k, 5]))
    v, point = turned(pair, _TURN, v), turned(pair, _TURN, point)
    point = _added(_added((qa[0, i], qa[1, i], qa[2, i]), 1.0, point), sizes[0], v)
    out[1, i], out[2, i], out[3, i] = v
    out[4, i], out[5, i], out[6, i] = point
    out[7, i], out[8, i], out[9, i] = _added(point, out[0, i], v)


def _distances(va, vb, halves, sizes, qa, qb, out):
    vertices = _VERTICES + _PER_CORNER * (va.shape[1] + vb.shape[1] - 2)
    room = 2 * vertices
    places = (np.empty((vertices + 4, 9)), np.empty(28), np.empty(4))
    faces = (np.empty((room, 3), np.int64), np.empty((room, 3), np.int64))
    keys = (np.empty((room, 6)), np.empty(room))
    work = places + faces + keys + (np.empty((room, 6), np.int64), np.empty(room, np.int64))
    boxes = va.shape[1] == vb.shape[1] == 1 and not va.any() and not vb.any()
    ra, rb, dims = sizes[0], sizes[1], int(sizes[3])
    for i in range(qa.shape[1]):
        # A core that is a single point needs no search: it is clamped to the other core, a box.
        if boxes and not halves[3:].any():
            _from_point(halves[:3], ra, rb, 1.0, dims, qa, qb, i, out, places[1])
        elif boxes and not halves[:3].any():
            _from_point(halves[3:], rb, ra, -1.0, dims, qb, qa, i, out, places[1])
        else:
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
    """Return poses of two shapes as poses in space of one length, and whether both are single.

    Raises:
        ValueError: for shapes of different dimensions, two planes, or batches of unequal length.
    """
    if a.dim != b.dim:
        raise invalid("b.dim", b.dim, f"{a.dim}, as that of a")
    if a.name == b.name == "plane":
        raise invalid("b", b.name, "no plane, as a is one: planes are not convex bodies")
    qa, qb = poses("pose_a", pose_a, a.dim), poses("pose_b", pose_b, b.dim)
    n = max(qa.shape[1], qb.shape[1]) if min(qa.shape[1], qb.shape[1]) else 0
    for name, q in (("pose_a", qa), ("pose_b", qb)):
        if q.shape[1] not in (1, n):
            raise invalid(f"{name}.shape[1]", q.shape[1], f"1 or {n}, as the other batch")
    single = np.ndim(pose_a) == np.ndim(pose_b) == 1
    return (
        np.array(np.broadcast_to(qa, (7, n)), order="C"),
        np.array(np.broadcast_to(qb, (7, n)), order="C"),
        single,
    )


def _from_plane(a: Shape, qa: Array, b: Shape, qb: Array) -> Array:
    """Return the rows of `measure` for a plane a: its normal, and the lowest corner of b."""
    # The normal of a plane is its z axis in space, its y axis in two dimensions.
    normal = to_matrix(qa[3:])[:, a.dim - 1]
    corner = corners_in_space(b, qb)
    height = np.einsum("in,ikn->kn", normal, corner - qa[:3, None])
    lowest = height.argmin(axis=0)
    far = height.min(axis=0) - b.radius
    point = np.take_along_axis(corner, lowest[None, None], 1)[:, 0] - b.radius * normal
    return np.vstack((far, normal, point - far * normal, point, np.zeros((2, far.size))))


def measured(a: Shape, qa: Array, b: Shape, qb: Array) -> Array:
    """Return the rows of `measure`, shape (12, N), for poses in space that are checked."""
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
    """Return the signed distance of two shapes, with the nearest or deepest points.

    Args:
        a: first shape; may be a plane unless b is one.
        b: second shape, of the same dimension.
        pose_a: pose of a, or a batch of N.
        pose_b: pose of b, or a batch of N.

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
