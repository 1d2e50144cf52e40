"""Broad phase: which pairs of bounding boxes overlap, without asking all of them.

Boxes are lower and upper corners, shape (2, d, N) in any dimension d. They are closed: boxes that
touch overlap. Every method returns the same pairs (i, j), i < j, sorted, shape (2, K), and counts
its overlap tests, as a count does not depend on the machine.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import float64, int64, types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of, positive
from course.compiled import VECTOR, compiled
from course.contact.shapes import Array

Pairs = NDArray[np.int64]

_BOXES = types.Array(float64, 3, "C")
_INDICES = types.Array(int64, 1, "C")
_PAIRS = types.Array(int64, 2, "C")
_TWO = types.UniTuple(int64, 2)


def _boxes(boxes: ArrayLike) -> Array:
    """Return boxes from outside; an infinite one is allowed, as a plane has no other."""
    given = np.ascontiguousarray(boxes, dtype=float)
    if given.ndim != 3 or given.shape[0] != 2 or not given.shape[1]:
        raise invalid("boxes.shape", given.shape, "(2, d, N), lower and upper corners")
    # The negated comparison finds NaNs as well.
    wrong = np.argwhere(~(given[0] <= given[1]))
    if wrong.size:
        axis, i = (int(k) for k in wrong[0])
        ends = (float(given[0, axis, i]), float(given[1, axis, i]))
        raise invalid(f"boxes[:, {axis}, {i}]", ends, "a lower end, and an upper one not below it")
    return given


@register_jitable
def aabb_overlap(boxes, i, j):
    """Return whether boxes i and j of boxes (2, d, N) overlap.

    They do unless some axis separates them.
    """
    for axis in range(boxes.shape[1]):
        if boxes[0, axis, i] > boxes[1, axis, j] or boxes[0, axis, j] > boxes[1, axis, i]:
            return False
    return True


@register_jitable
def _note(pairs, result, i, j):
    """Write the pair down where there is room; how many there are."""
    if result < pairs.shape[1]:
        pairs[0, result] = min(i, j)
        pairs[1, result] = max(i, j)
    return result + 1


def _all_pairs(boxes, pairs):
    result = 0
    n = boxes.shape[2]
    for i in range(n):
        for j in range(i + 1, n):
            if aabb_overlap(boxes, i, j):
                result = _note(pairs, result, i, j)
    return result, n * (n - 1) // 2


def _sort(keys, order):
    """Sort `order` by its keys with insertion sort.

    It costs one swap for each pair out of order, so almost nothing while boxes move little between
    steps.
    """
    swaps = 0
    # Insertion sort: larger keys move up by one until the place of this one is free.
    for k in range(1, order.size):
        this = order[k]
        key = keys[this]
        at = k
        while at > 0 and keys[order[at - 1]] > key:
            order[at] = order[at - 1]
            at -= 1
        order[at] = this
        swaps += k - at
    return swaps


def _sweep(boxes, axis, order, pairs):
    """Walk along the axis; a box is tested against those that begin before it ends."""
    result, tests = 0, 0
    for k in range(order.size):
        i = order[k]
        # Prune: only boxes whose interval begins before this one's ends can overlap it.
        end = boxes[1, axis, i]
        for other in range(k + 1, order.size):
            j = order[other]
            if boxes[0, axis, j] > end:
                break
            tests += 1
            if aabb_overlap(boxes, i, j):
                result = _note(pairs, result, i, j)
    return result, tests


def _cells(boxes, first, shape, cell, keys, members):
    """Return every cell that a box lies in, as one number, and the box; how many there are."""
    dim = boxes.shape[1]
    low = np.zeros(dim, np.int64)
    span = np.zeros(dim, np.int64)
    filled = 0
    for i in range(boxes.shape[2]):
        count = 1
        # The cell of the lower corner, and how many cells the box spans on each axis.
        for axis in range(dim):
            low[axis] = int((boxes[0, axis, i] - first[axis]) / cell)
            span[axis] = int((boxes[1, axis, i] - first[axis]) / cell) - low[axis] + 1
            count *= span[axis]
        # A box that no longer fits is counted but not written: the caller then makes more room.
        for k in range(count if filled + count <= keys.size else 0):
            # Mixed-radix digits of k enumerate the cells of the box.
            rest = k
            key = 0
            for axis in range(dim):
                key = key * shape[axis] + low[axis] + rest % span[axis]
                rest //= span[axis]
            keys[filled + k] = key
            members[filled + k] = i
        filled += count
    return filled


def _grid(boxes, first, shape, cell, keys, members, pairs):
    """Test the boxes that share a cell; a pair counts in the cell where their overlap begins."""
    result, tests = 0, 0
    # The keys are sorted, so the boxes of one cell stand next to each other.
    for p in range(keys.size):
        i = members[p]
        for q in range(p + 1, keys.size):
            if keys[q] != keys[p]:
                break
            j = members[q]
            tests += 1
            if aabb_overlap(boxes, i, j):
                # Large boxes share several cells. A pair is reported only in the cell that holds
                # the lower corner of its overlap, so no set of known pairs is needed.
                key = 0
                for axis in range(boxes.shape[1]):
                    begin = max(boxes[0, axis, i], boxes[0, axis, j])
                    key = key * shape[axis] + int((begin - first[axis]) / cell)
                if key == keys[p]:
                    result = _note(pairs, result, i, j)
    return result, tests


_KERNELS = {
    _all_pairs: _TWO(_BOXES, _PAIRS),
    _sort: int64(VECTOR, _INDICES),
    _sweep: _TWO(_BOXES, int64, _INDICES, _PAIRS),
    _cells: int64(_BOXES, VECTOR, _INDICES, float64, _INDICES, _INDICES),
    _grid: _TWO(_BOXES, VECTOR, _INDICES, float64, _INDICES, _INDICES, _PAIRS),
}


@functools.cache
def _kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    return compiled(function, _KERNELS[function])


def _collect(function: Callable[..., Any], n: int, *arguments: Any) -> tuple[Pairs, int]:
    """Run a kernel that writes pairs, again with more room if there was too little."""
    # A guess; a kernel that runs out of room still counts the pairs, so the second run has enough.
    room = 4 * n + 16
    while True:
        pairs = np.empty((2, room), np.int64)
        result, tests = _kernel(function)(*arguments, pairs)
        if result <= room:
            # In lexicographic order, so that all methods return the same array.
            order = np.lexsort((pairs[1, :result], pairs[0, :result]))
            return pairs[:, :result][:, order], int(tests)
        room = result


def brute_force(boxes: ArrayLike) -> tuple[Pairs, int]:
    """Return all n (n - 1) / 2 tests of boxes (2, d, N): the overlapping pairs, and how many tests.

    Raises:
        ValueError: for another shape, a NaN, or an upper end below the lower one.
    """
    given = _boxes(boxes)
    return _collect(_all_pairs, given.shape[2], given)


@dataclass
class SweepAndPrune:
    """Sort the lower ends along one axis, and test what overlaps there (Baraff, 1992).

    The order is kept: where little moved, insertion sort brings it up to date with few swaps
    (Cohen, Lin, Manocha and Ponamgi, I-COLLIDE, 1995).

    Attributes:
        axis: along which is swept; None for the axis on which the boxes of the first call spread
            most.
        order: of the boxes after the last call, shape (N,).
        tests: overlap tests of the last call.
        swaps: swaps of neighbours in the order in the last call; 0 for the first, which sorts.
    """

    axis: int | None = None
    order: Pairs | None = field(default=None, init=False)
    tests: int = field(default=0, init=False)
    swaps: int = field(default=0, init=False)

    def pairs(self, boxes: ArrayLike) -> Pairs:
        """Return the overlapping pairs.

        Raises:
            ValueError: as for `brute_force`, and for another number of boxes than before.
        """
        given = _boxes(boxes)
        if self.axis is None:
            # An infinite box says nothing about the spread.
            real = given[:, :, np.isfinite(given).all(axis=(0, 1))]
            spread = real[0].std(axis=1) if real.size else np.zeros(given.shape[1])
            self.axis = int(np.argmax(spread))
        axis = count("axis", self.axis, 0, given.shape[1] - 1)
        keys = np.ascontiguousarray(given[0, axis])
        if self.order is None:
            self.order, self.swaps = np.argsort(keys, kind="stable"), 0
        elif self.order.size != keys.size:
            raise invalid("boxes.shape[2]", keys.size, f"{self.order.size}, as in the call before")
        else:
            # The last order is nearly sorted where the boxes moved little (temporal coherence).
            self.swaps = int(_kernel(_sort)(keys, self.order))
        result, self.tests = _collect(_sweep, keys.size, given, axis, self.order)
        return result


def uniform_grid(boxes: ArrayLike, cell: float | None = None) -> tuple[Pairs, int]:
    """Test only boxes that share a cell of a grid.

    Args:
        boxes: lower and upper corners, shape (2, d, N), finite.
        cell: edge of a cell [m]; None for twice the mean length of the boxes' edges, doubled until
            no more than 16 cells a box are filled.

    Returns:
        The overlapping pairs, and the number of tests; boxes that share two cells are tested twice.

    Raises:
        ValueError: as for `brute_force`, for an infinite box, or a cell so small that the boxes
            fill more than 10^8 or the grid has more than 2^62.
    """
    # Twice the mean extent: a typical box then lies in few cells, and a cell holds few boxes.
    given = _boxes(boxes)
    if not np.isfinite(given).all():
        raise invalid("boxes", given, "finite for a grid")
    n = given.shape[2]
    if not n:
        return np.empty((2, 0), np.int64), 0
    edge = 2.0 * float((given[1] - given[0]).mean()) if cell is None else positive("cell", cell)
    first, extent = given[0].min(axis=1), float((given[1].max(axis=1) - given[0].min(axis=1)).max())
    # A tiny edge would make huge cell numbers; where all boxes are one point any edge will do.
    edge = max(edge, 1e-9 * extent) or 1.0 if cell is None else edge
    # Without a given edge, double it until the boxes fill few cells and cell numbers fit 64 bits.
    while True:
        ends = np.floor((given - first[:, None]) / edge)
        filled = (ends[1] - ends[0] + 1.0).prod(axis=0).sum()
        shape = ends[1].max(axis=1) + 1.0
        if cell is not None or (filled <= 16 * n and shape.prod() < 2.0**62):
            break
        edge *= 2.0
    if filled > 1e8 or shape.prod() >= 2.0**62:
        raise invalid("cell", cell, "a larger edge: the boxes fill too many such cells")
    keys, members = np.empty((2, int(filled)), np.int64)
    whole = shape.astype(np.int64)
    _kernel(_cells)(given, first, whole, edge, keys, members)
    # Sorting by cell brings the boxes that share one together.
    order = np.argsort(keys, kind="stable")
    return _collect(_grid, n, given, first, whole, edge, keys[order], members[order])


def overlapping_pairs(boxes: ArrayLike, method: str = "sweep") -> Pairs:
    """Return the pairs of boxes that overlap or touch, indices i < j, sorted, shape (2, K).

    Args:
        boxes: lower and upper corners, shape (2, d, N).
        method: "sweep" (sweep and prune), "grid" or "brute_force".

    Raises:
        ValueError: as for the chosen method (only the grid rejects infinite boxes), and for another
            method.
    """
    one_of("method", method, ("sweep", "grid", "brute_force"))
    if method == "sweep":
        return SweepAndPrune().pairs(boxes)
    return (uniform_grid if method == "grid" else brute_force)(boxes)[0]


CROWDS = {"spread": 3, "settled": 2, "aligned": 2}


def crowd(kind: str, n: int, rng: np.random.Generator) -> Array:
    """Return n boxes of edges 0.5 to 1 m, about one on each cubic metre (on each square metre).

    Args:
        kind: "spread" in a cube, "settled" in one layer, or "aligned": a wall across the
            x axis, on which all of them overlap.
        n: how many.
        rng: where they are drawn from.

    Returns:
        Boxes, shape (2, 3, n).
    """
    free = CROWDS[one_of("kind", kind, tuple(CROWDS))]
    # The region grows with n, so the density stays the same.
    middle = rng.uniform(0.0, count("n", n, 1) ** (1.0 / free), (3, n))
    if kind != "spread":
        middle[0 if kind == "aligned" else 2] = rng.uniform(0.0, 0.2, n)
    half = rng.uniform(0.25, 0.5, (3, n))
    return np.stack((middle - half, middle + half))


def warm() -> None:
    """Compile every loop of this file."""
    for function in _KERNELS:
        _kernel(function)
