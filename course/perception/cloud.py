"""From a depth picture to points, a plane and clusters.

Points are columns, shape (3, N) [m]. Space is cut into cubic cells, and a cell's three indices make
one key. Where only sums are wanted (the voxel mean) a hash table finds the cell of a key; where
neighbours are (DBSCAN, radius search) the points are sorted by key, as then the cells of a row
follow each other. The k-d tree of the registration is for the nearest point at any distance.

A plane is (nx, ny, nz, d): n . p + d is the height of a point above it, towards the camera.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import boolean, float64, int64, types, void
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, vector
from course.compiled import MATRIX, VECTOR, compiled, loop
from course.perception.camera import Array, Camera, Ids, rays_of
from course.perception.linear import eigen, row_sums, times_transposed

_INDICES = types.Array(int64, 1, "C")
_WHOLE = types.Array(int64, 2, "C")
_FLAGS = types.Array(boolean, 1, "C")
_MASK = types.Array(boolean, 2, "C")
_BITS = 21  # of a key for each index of a cell


def _checked(points: ArrayLike, least: int = 1) -> tuple[Array, Array, Array]:
    """Return a caller's points as contiguous floats (3, N), with their bounding box."""
    given = np.ascontiguousarray(points, dtype=float)
    if given.ndim == 2 and given.shape[0] == 3 and given.shape[1] >= least:
        low, high = given.min(axis=1), given.max(axis=1)
        if np.isfinite(low).all() and np.isfinite(high).all():
            return given, low, high
    vector("points", points, (3, None), unit="m")
    raise invalid("points.shape", given.shape, f"(3, N) with N at least {least}")


def _length(name: str, value: float, low: Array, high: Array) -> float:
    """Return a length, checked to be positive and above the rounding of the coordinates.

    The coordinates lie between low and high.
    """
    largest = float(np.maximum(np.abs(low), np.abs(high)).max())
    return finite(name, value, max(4.0 * np.finfo(float).eps * largest, POSITIVE), unit="m")


def back_project(depth: ArrayLike, camera: Camera) -> tuple[Array, Ids]:
    """Return the points of all pixels that have a measurement, row by row.

    Args:
        depth: along z, shape (H, W), 0 where there is none [m].
        camera: whose picture it is.

    Returns:
        Points, shape (3, N) [m], and their pixels as numbers v W + u, shape (N,).

    Raises:
        ValueError: as for `Camera.picture`.
    """
    return unproject(camera.picture(depth), camera)


@register_jitable
def unproject(z, camera):
    """Return points and pixels as `back_project`, of a depth image that is checked."""
    n = np.count_nonzero(z)
    points, pixels = np.empty((3, n)), np.empty(n, np.int64)
    x, y = rays_of(camera)
    _back_project_loop(z, x, y, points, pixels)
    return points, pixels


def _back_project(z, x, y, points, pixels):
    n = 0
    for v in range(z.shape[0]):
        for u in range(z.shape[1]):
            far = z[v, u]
            if far > 0.0:
                points[0, n], points[1, n], points[2, n] = x[u] * far, y[v] * far, far
                pixels[n] = v * z.shape[1] + u
                n += 1


# --- Cells ----------------------------------------------------------------------------------------


def _keys(name: str, points: Array, cell: float, origin: Array, high: Array) -> Ids:
    """Return the key of each point's cell; indices that it has no room for are refused."""
    # A few indices stay unused, for the cells around the outermost ones.
    if not ((high - origin) / cell).max() < 2**_BITS - 4:
        message = f"a larger length: of this one the points span more than {2**_BITS - 8}"
        raise invalid(name, cell, message)
    return _keys_of(points, cell, origin)


@register_jitable
def _keys_of(points, cell, origin):
    keys = np.empty(points.shape[1], np.int64)
    _cells_loop(points, origin, cell, keys)
    return keys


def _cells(points, origin, cell, keys):
    for p in range(keys.size):
        # No coordinate is below the origin, so truncation is the floor.
        i = int((points[0, p] - origin[0]) / cell)
        j = int((points[1, p] - origin[1]) / cell)
        k = int((points[2, p] - origin[2]) / cell)
        # Three indices of 21 bits in one integer.
        keys[p] = (i << 2 * _BITS) | (j << _BITS) | k


def voxel_mean(
    points: ArrayLike, voxel: float, origin: ArrayLike | None = None
) -> tuple[Array, Ids]:
    """Return one point for each cell of a grid that holds any: their mean.

    Args:
        points: shape (3, N) [m].
        voxel: edge of a cell [m].
        origin: a corner of the grid, shape (3,), below all points [m]; None for half a voxel below
            the least coordinates, as in Open3D.

    Returns:
        Means, shape (3, M) [m], in the order in which the cells are met, and of how many points
        each is, shape (M,).

    Raises:
        ValueError: for no point, a NaN, a voxel that is not positive, below the rounding of the
            points, or so small that a cell has no number.
    """
    given, low, high = _checked(points)
    edge = _length("voxel", voxel, low, high)
    base = low - 0.5 * edge if origin is None else vector("origin", origin, (3,), unit="m")
    if not np.all(base <= low):
        raise invalid("origin", base, "a corner below all points")
    return _means(given, _keys("voxel", given, edge, base, high))


@register_jitable
def means_in_cells(points, edge):
    """Return means and counts as `voxel_mean` with its usual origin, of points that are checked."""
    low = np.array([points[0].min(), points[1].min(), points[2].min()])
    return _means(points, _keys_of(points, edge, low - 0.5 * edge))


@register_jitable
def _means(points, keys):
    # A power of two, so that a mask replaces the modulo, and more than twice the points, so that
    # probing stays short.
    size = 1
    while size <= 2 * keys.size:
        size *= 2
    table = np.full((2, size), -1)
    sums, counts = np.zeros((keys.size, 3)), np.zeros(keys.size, np.int64)
    cells = _sums_loop(points, keys, table, sums, counts)
    means = np.empty((3, cells))
    for axis in range(3):
        means[axis] = sums[:cells, axis] / counts[:cells]
    return means, counts[:cells].copy()


def _sums(points, keys, table, sums, counts):
    cells, last, cell = 0, -1, 0
    for p in range(keys.size):
        key = keys[p]
        if key != last:  # neighbouring pixels often share a cell
            last = key
            # The hash of Teschner et al. (2003); full places are passed over.
            i, j, k = key >> 2 * _BITS, (key >> _BITS) & (2**_BITS - 1), key & (2**_BITS - 1)
            slot = ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & (table.shape[1] - 1)
            # Linear probing: the table is at most half full, so probes are short.
            while table[0, slot] != key and table[0, slot] >= 0:
                slot = (slot + 1) & (table.shape[1] - 1)
            if table[0, slot] < 0:
                table[0, slot], table[1, slot] = key, cells
                cells += 1
            cell = table[1, slot]
        counts[cell] += 1
        for axis in range(3):
            sums[cell, axis] += points[axis, p]
    return cells


def _sorted(name: str, points: Array, cell: float, low: Array, high: Array) -> tuple[Any, ...]:
    """Return points sorted by cell, where each cell begins, its key, and the order."""
    # No neighbour has a key below 0.
    return _in_order(points, _keys(name, points, cell, low - 2.0 * cell, high))


@register_jitable
def _in_order(points, keys):
    order = np.argsort(keys, kind="mergesort")  # equal keys stay in their order
    ordered = keys[order]
    new = np.ones(keys.size, np.bool_)
    new[1:] = ordered[1:] != ordered[:-1]
    first = np.flatnonzero(new)
    inner = np.empty(points.shape)
    for axis in range(3):
        inner[axis] = points[axis][order]
    return inner, np.append(first, keys.size), ordered[first], order


def _rows(reach: int) -> Ids:
    """Return what to add to a key for the rows of cells around it, the nearest first."""
    near = sorted(
        np.ndindex(2 * reach + 1, 2 * reach + 1), key=lambda c: sum((i - reach) ** 2 for i in c)
    )
    return np.array([(i - reach << 2 * _BITS) + (j - reach << _BITS) for i, j in near])


_ROWS = _rows(2)


@register_jitable
def _square(points, p, x, y, z):
    a, b, c = points[0, p] - x, points[1, p] - y, points[2, p] - z
    return a * a + b * b + c * c


def radius_search(points: ArrayLike, queries: ArrayLike, radius: float) -> tuple[Ids, Ids]:
    """Return the points within a radius of each query, the border included.

    Args:
        points: the cloud, shape (3, N) [m].
        queries: centres of the balls, shape (3, M) [m].
        radius: [m].

    Returns:
        Where those of each query begin, shape (M + 1,), and the numbers of the points.

    Raises:
        ValueError: as for `voxel_mean`.
    """
    given, low, high = _checked(points)
    reach = _length("radius", radius, low, high)
    requested, _, _ = _checked(queries)
    inner, start, keys, order = _sorted("radius", given, reach, low, high)
    base, top = low - 2.0 * reach, high + 2.0 * reach
    # A query beyond the widened bounding box has no neighbour, and no key.
    near = ((requested > base[:, None]) & (requested < top[:, None])).all(axis=0)
    own = np.full(requested.shape[1], -1)
    own[near] = _keys("radius", np.ascontiguousarray(requested[:, near]), reach, base, high)
    rows = own[:, None] + _rows(1)
    # Keys of a row of three neighbouring cells are consecutive, so one range covers them.
    begin = start[np.searchsorted(keys, rows - 1)]
    end = start[np.searchsorted(keys, rows + 1, side="right")]
    end[~near] = begin[~near]
    first, result = np.zeros(own.size + 1, np.int64), np.empty(0, np.int64)
    # Two passes: the first counts, the second writes into an array of the right size.
    _within_loop(inner, requested, reach * reach, begin, end, first, result)  # counts
    first = np.cumsum(first)
    result = np.empty(first[-1], np.int64)
    if result.size:
        _within_loop(inner, requested, reach * reach, begin, end, first, result)
    return first, order[result]


def _within(points, queries, square, begin, end, first, result):
    for q in range(queries.shape[1]):
        n = 0
        for row in range(begin.shape[1]):
            for p in range(begin[q, row], end[q, row]):
                if _square(points, p, queries[0, q], queries[1, q], queries[2, q]) <= square:
                    if result.size:
                        result[first[q] + n] = p
                    n += 1
        if not result.size:
            first[q + 1] = n


# --- Clusters -------------------------------------------------------------------------------------


@register_jitable
def _root(parent, i):
    """Return the set that i is in, with its path halved (Tarjan and van Leeuwen, 1984)."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


def dbscan(points: ArrayLike, eps: float, least: int) -> tuple[Ids, NDArray[np.bool_]]:
    """Return clusters of dense points (Ester, Kriegel, Sander and Xu, 1996), exactly.

    It needs O(N) memory.

    Points in a cell of edge eps / sqrt(3) are all within eps of each other, so core points are
    joined cell by cell (Gunawan, 2013), and no neighbourhood is stored. A border point goes to the
    nearest core point; the original leaves it to the order of the points.

    Args:
        points: shape (3, N) [m].
        eps: distance of neighbours, the border included [m].
        least: neighbours of a core point, itself among them.

    Returns:
        The cluster of each point, shape (N,), -1 for noise, in the order of their first core
        points; which are core points, shape (N,).

    Raises:
        ValueError: as for `voxel_mean`, and for a `least` below 1.
    """
    given, low, high = _checked(points)
    reach, needed = _length("eps", eps, low, high), count("least", least, 1)
    return _clusters(_sorted("eps", given, _SMALLER * reach, low, high), reach, needed)


# The edge of a cell over eps. A hair less than 1 / sqrt(3), so that rounding puts no two points in
# a cell that are farther apart.
_SMALLER = (1.0 - 1e-9) / math.sqrt(3.0)


@register_jitable
def dense_clusters(points, eps, least):
    """Return clusters and core points as `dbscan`, of points that are checked."""
    cell = _SMALLER * eps
    low = np.array([points[0].min(), points[1].min(), points[2].min()])
    return _clusters(_in_order(points, _keys_of(points, cell, low - 2.0 * cell)), eps, least)


@register_jitable
def _clusters(cells, eps, least):
    inner, start, keys, order = cells
    labels, core = np.full(order.size, -1), np.zeros(order.size, np.bool_)
    _dbscan_loop(inner, start, keys, order, _ROWS, eps * eps, least, labels, core)
    return labels, core


@register_jitable
def _near(keys, rows, fingers, c, near):
    """Return the cells around cell c, itself included, and their number.

    Each row of cells has a cursor: cells are queried in order, so a cursor only advances.
    """
    result = 0
    for o in range(rows.size):
        f = fingers[o]
        # The row's cells from two before to two after have consecutive keys.
        while f < keys.size and keys[f] < keys[c] + rows[o] - 2:
            f += 1
        fingers[o] = f
        while f < keys.size and keys[f] <= keys[c] + rows[o] + 2:
            near[result] = f
            result += 1
            f += 1
    return result


def _dbscan(points, start, keys, order, rows, square, least, labels, core):
    cells, n = keys.size, order.size
    near, parent = np.empty(5 * rows.size, np.int64), np.arange(cells)
    # Core points, in the order of cells: all of a full cell, of others those that count enough.
    # Points of a cell are all within eps of each other: a cell with `least` points needs no test.
    dense = np.zeros(n, np.bool_)
    fingers = np.zeros(rows.size, np.int64)
    for c in range(cells):
        if start[c + 1] - start[c] >= least:
            dense[start[c] : start[c + 1]] = True
            continue
        m = _near(keys, rows, fingers, c, near)
        for p in range(start[c], start[c + 1]):
            result = 0
            for b in near[:m]:
                for q in range(start[b], start[b + 1]):
                    result += _square(points, q, points[0, p], points[1, p], points[2, p]) <= square
                # Enough neighbours: the others need not be counted.
                if result >= least:
                    dense[p] = True
                    break
    # Cells are joined with those before them, by the first pair of core points in reach.
    fingers[:] = 0
    # Only rows up to the cell's own one, so that each pair of cells is tested once.
    before = rows[rows <= 0]
    for c in range(cells):
        m = _near(keys, before, fingers, c, near)
        for b in near[:m]:
            # Union-find over cells; pairs that are joined already need no distance.
            if b < c and _root(parent, b) != _root(parent, c):
                for p in range(start[c], start[c + 1]):
                    if dense[p] and _touches(points, p, start[b], start[b + 1], dense, square):
                        parent[_root(parent, b)] = _root(parent, c)
                        break
    # Clusters are numbered by their first core point.
    home = np.empty(n, np.int64)
    for c in range(cells):
        for p in range(start[c], start[c + 1]):
            core[order[p]], home[order[p]] = dense[p], _root(parent, c)
    names, clusters = np.full(cells, -1), 0
    for i in range(n):
        if core[i]:
            if names[home[i]] < 0:
                names[home[i]] = clusters
                clusters += 1
            labels[i] = names[home[i]]
    # Border points.
    fingers[:] = 0
    for c in range(cells):
        # A cell of core points only has no border points.
        if dense[start[c] : start[c + 1]].all():
            continue
        m = _near(keys, rows, fingers, c, near)
        for p in range(start[c], start[c + 1]):
            # No distance is below -1, so a core point keeps its label.
            best = -1.0 if dense[p] else square
            for b in near[:m]:
                for q in range(start[b], start[b + 1]):
                    far = _square(points, q, points[0, p], points[1, p], points[2, p])
                    if dense[q] and far <= best:
                        best = far
                        labels[order[p]] = labels[order[q]]


@register_jitable
def _touches(points, p, begin, end, dense, square):
    """Return whether a core point from begin to end is a neighbour of p."""
    for q in range(begin, end):
        near = _square(points, q, points[0, p], points[1, p], points[2, p]) <= square
        if near and dense[q]:
            return True
    return False


def components(depth: ArrayLike, camera: Camera, step: float) -> Ids:
    """Return clusters on the grid of pixels: neighbours whose depths differ by no more than a step.

    Args:
        depth: shape (H, W), 0 where a pixel takes no part, such as on the plane [m].
        camera: whose picture it is.
        step: largest difference of neighbours [m].

    Returns:
        The cluster of each pixel, shape (H, W), in the order of rows; -1 where it takes no part.

    Raises:
        ValueError: as for `Camera.picture`, and for a step that is not positive.
    """
    return connected(camera.picture(depth), finite("step", step, POSITIVE, unit="m"))


@register_jitable
def connected(z, step):
    """Return clusters of pixels as `components`, of a depth image that is checked."""
    labels = np.empty(z.shape, np.int64)
    _components_loop(z, step, labels)
    return labels


def _components(z, step, labels):
    rows, columns = z.shape
    parent = np.arange(rows * columns)
    for v in range(rows):
        for u in range(columns):
            if z[v, u] > 0.0:
                here = v * columns + u
                # Two-pass labelling: join with the left and the upper neighbour, then number the
                # roots.
                if u and z[v, u - 1] > 0.0 and abs(z[v, u] - z[v, u - 1]) <= step:
                    parent[here] = _root(parent, here - 1)
                if v and z[v - 1, u] > 0.0 and abs(z[v, u] - z[v - 1, u]) <= step:
                    a, b = _root(parent, here), _root(parent, here - columns)
                    parent[max(a, b)] = min(a, b)  # the first pixel stands for all
    clusters = 0
    for v in range(rows):
        for u in range(columns):
            root = _root(parent, v * columns + u)
            labels[v, u] = -1
            if z[v, u] > 0.0:
                # A root is the first pixel of its component in this order, so its label exists
                # before it is read.
                if root == v * columns + u:
                    labels[v, u] = clusters
                    clusters += 1
                else:
                    labels[v, u] = labels[root // columns, root % columns]


# --- Planes ---------------------------------------------------------------------------------------


def fit_plane(points: ArrayLike) -> Array:
    """Return the plane with the least sum of squared distances (Pearson, 1901), shape (4,).

    Raises:
        ValueError: for fewer than 3 points, a NaN, or points in one line (within a millionth).
    """
    given, _, _ = _checked(points, 3)
    plane, spans = least_squares_plane(given)
    if not spans:
        raise invalid("points", given, "points that are not all in one line")
    return plane


@register_jitable
def least_squares_plane(points):
    """Return the plane of `fit_plane` and whether the points span one."""
    middle = row_sums(points) / points.shape[1]
    # The normal is the direction of the least variance.
    offsets = points - middle.reshape(3, 1)
    values, axes = eigen(times_transposed(offsets, offsets))
    plane = np.empty(4)
    plane[:3] = axes[:, 0]
    plane[3] = -(plane[0] * middle[0] + plane[1] * middle[1] + plane[2] * middle[2])
    # Two vanishing variances: the points lie on a line, which has no plane of its own.
    return facing(plane), values[1] > 1e-12 * values[2]


@register_jitable
def facing(plane: Array) -> Array:
    """Return a plane, shape (4,), with its normal towards the camera."""
    return -plane if plane[3] < 0.0 else plane


@register_jitable
def heights(plane: Array, points: Array) -> Array:
    """Return the heights of points (3, N) above a plane (4,), shape (N,) [m]."""
    return plane[0] * points[0] + plane[1] * points[1] + plane[2] * points[2] + plane[3]


def inverse_depth_plane(
    depth: ArrayLike, camera: Camera, mask: NDArray[np.bool_] | None = None
) -> Array:
    """Return the plane of a picture by one linear fit, shape (4,).

    Along a plane 1 / z = a x + b y + c over the normalised pixels. A stereo sensor's noise is even
    in 1 / z, so that the fit needs no weights and has no bias to first order. If that noise is
    white, it is the best linear fit.

    Args:
        depth: shape (H, W) [m].
        camera: whose picture it is.
        mask: the pixels that count, shape (H, W); None for all that have a measurement.

    Raises:
        ValueError: as for `Camera.picture`, and for fewer than 3 pixels or pixels in one line.
    """
    z = camera.picture(depth)
    used = np.ascontiguousarray((z > 0.0) if mask is None else (z > 0.0) & np.asarray(mask, bool))
    plane, n = plane_of_pixels(z, camera, used)
    if not plane.any():
        raise invalid("mask", f"{n} pixels", "3 or more that are not all in one line")
    return plane


@register_jitable
def plane_of_pixels(z, camera, used):
    """Return the plane of `inverse_depth_plane`, zeros if there is none, and the number of pixels.

    Args:
        z: depths, shape (H, W) [m].
        camera: whose image it is.
        used: the pixels that count, all with a measurement, shape (H, W).
    """
    x, y = rays_of(camera)
    normal, right, plane = np.zeros((3, 3)), np.zeros(3), np.zeros(4)
    n = _inverse_depth_loop(z, x, y, used, normal, right)
    values, axes = eigen(normal)
    if n < 3 or not values[0] > 1e-12 * values[2]:
        return plane, n
    slope = np.zeros(3)
    for k in range(3):
        a = axes[:, k]
        slope += a * ((a[0] * right[0] + a[1] * right[1] + a[2] * right[2]) / values[k])
    # On the plane (a, b, c) . p = 1, so the camera at the origin is on its positive side.
    plane[:3], plane[3] = -slope, 1.0
    return plane / np.sqrt(np.sum(slope * slope)), n


def _inverse_depth(z, x, y, used, normal, right):
    # Normal equations of 1 / z = a x + b y + c.
    n = 0
    for v in range(y.size):
        for u in range(x.size):
            if used[v, u]:
                n += 1
                row = (x[u], y[v], 1.0)
                for i in range(3):
                    right[i] += row[i] / z[v, u]
                    for j in range(3):
                        normal[i, j] += row[i] * row[j]
    return n


def draws_needed(share: float, confidence: float, sample: int = 3) -> float:
    """Return how many draws of `sample` points hold one of inliers only, with so much confidence.

    log(1 - P) / log(1 - w^n) (Fischler and Bolles, 1981). Three inliers are not yet the plane: with
    noise near the tolerance many such triples miss most of it.
    """
    good = finite("share", share, 0.0, 1.0) ** count("sample", sample, 1)
    # log1p keeps both logarithms exact near 0 (for few inliers, or little doubt).
    missed = math.log1p(-finite("confidence", confidence, 0.0, 1.0 - 1e-15))
    if missed == 0.0 or good == 1.0:
        return 1.0 if missed else 0.0
    return missed / math.log1p(-good) if good > 0.0 else math.inf


def ransac_plane(
    points: ArrayLike,
    tolerance: float,
    rng: np.random.Generator,
    *,
    confidence: float = 0.99,
    at_most: int = 1000,
    refits: int = 1,
) -> tuple[Array, NDArray[np.bool_], int]:
    """Return the plane that most points lie near (Fischler and Bolles, 1981).

    Planes through three drawn points are tried until `draws_needed` for the best share so far;
    then the plane is fitted to the points near it, `refits` times.

    Args:
        points: shape (3, N) [m].
        tolerance: largest distance of a point that counts [m].
        rng: where the triples are drawn from.
        confidence: of having drawn three inliers; 1 for `at_most` draws always.
        at_most: limit on the number of draws, at least 1.
        refits: by least squares.

    Returns:
        The plane, shape (4,); which points are near it, shape (N,); how many planes were tried.

    Raises:
        ValueError: for fewer than 3 points, a NaN, a tolerance that is not positive or below the
            rounding of the points, numbers out of range, or no three points that are not in line.
    """
    given, low, high = _checked(points, 3)
    near = _length("tolerance", tolerance, low, high)
    triples = rng.integers(0, given.shape[1], (count("at_most", at_most, 1), 3))
    sure = finite("confidence", confidence, 0.0, 1.0)
    missed = math.log1p(-sure) if sure < 1.0 else -math.inf
    plane, tried = best_plane(given, near, triples, missed, count("refits", refits))
    if not plane.any():
        raise invalid("points", given, "points that are not all in one line")
    return plane, np.abs(heights(plane, given)) <= near, tried


@register_jitable
def best_plane(points, tolerance, triples, missed, refits):
    """Return the plane of `ransac_plane`, zeros if there is none, and how many were tried.

    Args:
        points: shape (3, N) [m].
        tolerance: largest distance of a point that counts [m].
        triples: the sampled points, shape (n, 3).
        missed: logarithm of the probability that no triple had inliers only; -inf for all triples.
        refits: by least squares.
    """
    plane = np.zeros(4)
    tried = _ransac_loop(points, tolerance, triples, missed, plane)
    # Least squares over the consensus set, which is then determined again.
    for _ in range(refits):
        near = np.flatnonzero(np.abs(heights(plane, points)) <= tolerance)
        inner = np.empty((3, near.size))
        for axis in range(3):
            inner[axis] = points[axis][near]
        if plane.any():
            plane, spans = least_squares_plane(inner)
            if not spans:
                plane = np.zeros(4)
    return facing(plane), tried


def _ransac(points, tolerance, triples, missed, plane):
    plane[:] = 0.0
    # Any three points that span a plane beat this start.
    best, n = 2, points.shape[1]
    for draw in range(triples.shape[0]):
        i, j, k = triples[draw, 0], triples[draw, 1], triples[draw, 2]
        p, q, r = points[:, i], points[:, j], points[:, k]
        a, b, c = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        d, e, f = r[0] - p[0], r[1] - p[1], r[2] - p[2]
        # Minimal sample: the plane through three points, unless they are nearly on a line.
        x, y, z = b * f - c * e, c * d - a * f, a * e - b * d
        length = math.sqrt(x * x + y * y + z * z)
        size = (a * a + b * b + c * c) + (d * d + e * e + f * f)
        if length > 1e-12 * size:
            x, y, z = x / length, y / length, z / length
            offset = -(x * p[0] + y * p[1] + z * p[2])
            # Consensus: count the points within the tolerance.
            result = 0
            for i in range(n):
                height = x * points[0, i] + y * points[1, i] + z * points[2, i] + offset
                result += abs(height) <= tolerance
            if result > best:
                best = result
                plane[0], plane[1], plane[2], plane[3] = x, y, z, offset
        # Adaptive stop: as many draws as the best share of inliers needs for the confidence.
        share = best / n
        if missed > -math.inf and (
            best == n or (draw + 1) * math.log1p(-share * share * share) <= missed
        ):
            return draw + 1
    return triples.shape[0]


_KERNELS: dict[Callable[..., Any], Any] = {
    _back_project: void(MATRIX, VECTOR, VECTOR, MATRIX, _INDICES),
    _cells: void(MATRIX, VECTOR, float64, _INDICES),
    _sums: int64(MATRIX, _INDICES, _WHOLE, MATRIX, _INDICES),
    _within: void(MATRIX, MATRIX, float64, _WHOLE, _WHOLE, _INDICES, _INDICES),
    _dbscan: void(MATRIX, _INDICES, _INDICES, _INDICES, _INDICES, float64, int64, _INDICES, _FLAGS),
    _components: void(MATRIX, float64, _WHOLE),
    _inverse_depth: int64(MATRIX, VECTOR, VECTOR, _MASK, MATRIX, VECTOR),
    _ransac: int64(MATRIX, float64, _WHOLE, float64, VECTOR),
}
(
    _back_project_loop,
    _cells_loop,
    _sums_loop,
    _within_loop,
    _dbscan_loop,
    _components_loop,
    _inverse_depth_loop,
    _ransac_loop,
) = (loop(function, signature) for function, signature in _KERNELS.items())


def warm() -> None:
    """Compile every loop of this file."""
    for function, signature in _KERNELS.items():
        compiled(function, signature)
