"""The nearest of many points: a k-d tree, cut at medians (Bentley, 1975).

The tree is a cloud's points in its order, and of each inner node the axis and the coordinate of its
cut. Nodes are numbered breadth first, so that it needs no pointers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import float64, int64, types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, vector
from course.compiled import MATRIX, VECTOR, compiled, loop

Array = NDArray[np.float64]

_LEAF = 16  # points in a leaf of the tree
_INDICES = types.Array(int64, 1, "C")


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points in a k-d tree (Bentley, 1975): cut at the median across the widest side.

    Made by `Cloud.of`. In the order of the tree: `points` (N, 3) [m], `normals` (N, 3) or (0, 3),
    `order` (N,) each point's number; `axes`, `cuts` (2^k - 1,) of inner nodes, breadth first.
    """

    points: Array
    normals: Array
    order: NDArray[np.int64]
    axes: NDArray[np.int64]
    cuts: Array

    @classmethod
    def of(cls, points: ArrayLike, normals: ArrayLike | None = None) -> Cloud:
        """Return a cloud to register to, or to ask for nearest points.

        Args:
            points: shape (3, N), at least one [m].
            normals: shape (3, N), of unit length; needed for point-to-plane only.

        Raises:
            ValueError: for no point, a NaN, or normals of another shape or length.
        """
        rows = vector("points", points, (3, None), unit="m").T.copy()
        if not len(rows):
            raise invalid("points.shape", (3, 0), "at least one point")
        order, axes, cuts = tree_of(rows)
        turned = np.zeros((0, 3))
        if normals is not None:
            given = vector("normals", normals, (3, len(rows)))
            length = np.linalg.norm(given, axis=0)
            if np.abs(length - 1.0).max() > 1e-6:
                raise invalid("normals", length, "vectors of unit length")
            turned = np.ascontiguousarray(given.T[order])
        return cls(rows, turned, order, axes, cuts)

    def nearest(self, queries: ArrayLike, within: float = np.inf) -> tuple[Array, Any]:
        """Return the nearest point to each query, shape (3, n) [m].

        Returns:
            Distances (n,) [m] and numbers of the points (n,); infinite and -1 where none is nearer
            than `within`.
        """
        q = np.ascontiguousarray(vector("queries", queries, (3, None), unit="m").T)
        tree = self.points, self.order, self.axes, self.cuts
        return nearest_in(tree, q, float(within))


@register_jitable
def tree_of(rows):
    """Put the rows of points (N, 3) into the order of a k-d tree.

    Returns:
        order, axes and cuts, as of `Cloud`.
    """
    # Levels of a balanced tree with at most _LEAF points in each leaf.
    leaves = 1
    while leaves * _LEAF < len(rows):
        leaves *= 2
    order = np.arange(len(rows))
    axes, cuts = np.zeros(leaves - 1, dtype=np.int64), np.zeros(leaves - 1)
    _build_loop(rows, order, axes, cuts)
    return order, axes, cuts


@register_jitable
def nearest_in(tree, queries, within):
    """Return distances and numbers of the nearest points, as `Cloud.nearest`.

    Args:
        tree: points, order, axes and cuts, as of `Cloud`.
        queries: shape (n, 3) [m].
        within: largest distance [m].
    """
    points, order, axes, cuts = tree
    distance, index = np.empty(len(queries)), np.empty(len(queries), dtype=np.int64)
    _query_loop(queries, points, axes, cuts, within, distance, index)
    return distance, np.where(index < 0, -1, order[index])


_NO_ROWS, _NO_INDICES = np.zeros((0, 3)), np.zeros(0, np.int64)
NO_CLOUD = Cloud(_NO_ROWS, _NO_ROWS, _NO_INDICES, _NO_INDICES, np.zeros(0))
NO_TREE = NO_CLOUD.points, NO_CLOUD.normals, NO_CLOUD.axes, NO_CLOUD.cuts


# --- compiled -------------------------------------------------------------------------------------


def _build(points, order, axes, cuts):
    """Put the rows of points into the order of the tree; ranges of nodes are halved by rule."""
    inner = len(axes)
    # Breadth-first numbering: the children of node k are 2 k + 1 and 2 k + 2.
    ranges = np.empty((2 * inner + 1, 2), dtype=np.int64)
    ranges[0, 0], ranges[0, 1] = 0, len(points)
    for node in range(inner):
        low, high = ranges[node]
        # Split the widest axis at the median: a balanced k-d tree without pointers.
        axis, widest = 0, -1.0
        for x in range(3):
            wide = points[low:high, x].max() - points[low:high, x].min()
            if wide > widest:
                axis, widest = x, wide
        middle = (low + high) // 2
        i, j = low, high - 1
        while i < j:  # Hoare's selection of the median
            pivot = points[(i + j) // 2, axis]
            a, b = i, j
            while a <= b:
                while points[a, axis] < pivot:
                    a += 1
                while points[b, axis] > pivot:
                    b -= 1
                if a <= b:
                    for x in range(3):
                        points[a, x], points[b, x] = points[b, x], points[a, x]
                    order[a], order[b] = order[b], order[a]
                    a += 1
                    b -= 1
            # Go on in the part that contains the median.
            if middle <= b:
                j = b
            elif middle >= a:
                i = a
            else:
                break
        axes[node], cuts[node] = axis, points[middle, axis]
        ranges[2 * node + 1, 0], ranges[2 * node + 1, 1] = low, middle
        ranges[2 * node + 2, 0], ranges[2 * node + 2, 1] = middle, high


@register_jitable
def nearest_row(q, points, axes, cuts, best, index, nodes, offsets):
    """Return the row of the nearest point within sqrt(best) of q, and the squared distance.

    `best` is the squared distance to beat and `index` the row that it belongs to, or -1 for a mere
    bound; both come back unchanged if no point is nearer. The points are in the order of `_build`;
    nodes and offsets are work space. A branch is skipped when its cuts alone are farther away than
    the best (Arya and Mount, 1993).
    """
    inner, top = len(axes), 1
    # Stack: a node and its range of rows; the squared offsets of its cell from q along each axis,
    # and their sum.
    nodes[0, 0], nodes[0, 1], nodes[0, 2] = 0, 0, len(points)
    offsets[0] = 0.0
    while top > 0:
        top -= 1
        # Prune: the cell is farther away than the best point so far.
        s = offsets[top, 3]
        if s >= best:
            continue
        node, low, high = nodes[top, 0], nodes[top, 1], nodes[top, 2]
        o0, o1, o2 = offsets[top, 0], offsets[top, 1], offsets[top, 2]
        while node < inner:
            axis = axes[node]
            deviation, middle = q[axis] - cuts[node], (low + high) // 2
            old = o0 if axis == 0 else (o1 if axis == 1 else o2)
            # Squared distance to the other half's cell, updated in one axis (Arya and Mount, 1993).
            far = s - old + deviation * deviation
            if deviation < 0.0:
                other, other_low, other_high = 2 * node + 2, middle, high
                node, high = 2 * node + 1, middle
            else:
                other, other_low, other_high = 2 * node + 1, low, middle
                node, low = 2 * node + 2, middle
            # The other half waits, with the offset along this axis replaced.
            if far < best:
                nodes[top, 0], nodes[top, 1], nodes[top, 2] = other, other_low, other_high
                offsets[top, 0], offsets[top, 1], offsets[top, 2] = o0, o1, o2
                offsets[top, axis], offsets[top, 3] = deviation * deviation, far
                top += 1
        # Leaf: compare all its points.
        for i in range(low, high):
            x, y, z = points[i, 0] - q[0], points[i, 1] - q[1], points[i, 2] - q[2]
            square = x * x + y * y + z * z
            if square < best:
                best, index = square, i
    return index, best


def _query(queries, points, axes, cuts, within, distance, index):
    """Find the nearest point of each query."""
    nodes, offsets = np.empty((64, 3), dtype=np.int64), np.empty((64, 4))
    for k in range(len(queries)):
        index[k], square = nearest_row(
            queries[k], points, axes, cuts, within * within, -1, nodes, offsets
        )
        distance[k] = np.sqrt(square) if index[k] >= 0 else np.inf


_SIGNATURES: dict[Callable[..., Any], Any] = {
    _build: types.void(MATRIX, _INDICES, _INDICES, VECTOR),
    _query: types.void(MATRIX, MATRIX, _INDICES, VECTOR, float64, VECTOR, _INDICES),
}
_build_loop, _query_loop = (
    loop(function, signature) for function, signature in _SIGNATURES.items()
)


def warm() -> None:
    """Compile the loops of this file."""
    for function, signature in _SIGNATURES.items():
        compiled(function, signature)
