"""Small matrices without LAPACK and BLAS: loops that compile into a browser's module as well.

A symmetric matrix without negative eigenvalues is its own singular value decomposition, so the
rotations of `course.kinematics.inverse.decompose` (Hestenes, 1958), which turn its rows until they
are at right angles, also find its eigenvectors.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import void
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.compiled import MATRIX, VECTOR, compiled, loop
from course.kinematics.inverse import decompose

Array = NDArray[np.float64]


def _eigen(M, values, vectors):
    n = M.shape[0]
    A, U = np.empty((n, n)), np.empty((n, n))
    decompose(M, A, U)
    for k in range(n):
        square = 0.0
        for x in range(n):
            square += A[k, x] * A[k, x]
        # Sort by insertion: the columns above move up by one.
        value, at = np.sqrt(square), k
        while at > 0 and values[at - 1] > value:
            values[at] = values[at - 1]
            for x in range(n):
                vectors[x, at] = vectors[x, at - 1]
            at -= 1
        values[at] = value
        for x in range(n):
            vectors[x, at] = U[x, k]


def _across(a, b, out):
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for k in range(a.shape[1]):
                total += a[i, k] * b[j, k]
            out[i, j] = total


def _sums(a, out):
    for i in range(a.shape[0]):
        total = 0.0
        for k in range(a.shape[1]):
            total += a[i, k]
        out[i] = total


_SIGNATURES: dict[Callable[..., Any], Any] = {
    _eigen: void(MATRIX, VECTOR, MATRIX),
    _across: void(MATRIX, MATRIX, MATRIX),
    _sums: void(MATRIX, VECTOR),
}
_eigen_loop, _across_loop, _sums_loop = (loop(each, kind) for each, kind in _SIGNATURES.items())


@register_jitable
def eigen(M: Array) -> tuple[Array, Array]:
    """Return eigenvalues and eigenvectors of a symmetric matrix that has no negative eigenvalue.

    Args:
        M: shape (n, n); an eigenvalue that rounding has made negative comes back as its amount.

    Returns:
        Eigenvalues in rising order, shape (n,), and in the columns their vectors, shape (n, n).
    """
    values, vectors = np.empty(M.shape[0]), np.empty(M.shape)
    _eigen_loop(np.ascontiguousarray(M), values, vectors)
    return values, vectors


@register_jitable
def times_transposed(a: Array, b: Array) -> Array:
    """Return a b^T, shape (m, n), of matrices (m, N) and (n, N)."""
    out = np.empty((a.shape[0], b.shape[0]))
    _across_loop(np.ascontiguousarray(a), np.ascontiguousarray(b), out)
    return out


@register_jitable
def row_sums(a: Array) -> Array:
    """Return the sums of the rows of a matrix (m, N), shape (m,), added from left to right.

    NumPy adds long rows in another order than compiled code, so the last digits would differ.
    """
    out = np.empty(a.shape[0])
    _sums_loop(np.ascontiguousarray(a), out)
    return out


@register_jitable
def apply(R: Array, v: Array) -> Array:
    """Return R v of a matrix (3, 3) and vectors along axis 0, shape (3,) or (3, N)."""
    out = np.empty(v.shape)
    for x in range(3):
        out[x] = R[x, 0] * v[0] + R[x, 1] * v[1] + R[x, 2] * v[2]
    return out


@register_jitable
def pseudoinverse(M: Array, share: float) -> Array:
    """Return the inverse of a matrix as of `eigen` on what its rows span (Moore and Penrose).

    Args:
        M: shape (n, n).
        share: an eigenvalue below this share of the largest one counts as 0.
    """
    values, vectors = eigen(M)
    used = values > share * values.max()
    inverse = np.where(used, 1.0 / np.where(used, values, 1.0), 0.0)
    return times_transposed(vectors * inverse, vectors)


def warm() -> None:
    """Compile the loops of this file."""
    for function, signature in _SIGNATURES.items():
        compiled(function, signature)
