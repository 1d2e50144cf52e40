"""Absolute orientation: the rigid motion that lays points onto their partners, in closed form."""

from __future__ import annotations

import numpy as np
from numba import boolean
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, vector
from course.compiled import MATRIX, VECTOR, compiled, loop
from course.kinematics.inverse import decompose

Array = NDArray[np.float64]

# Points count as on one line where the middle singular value of their covariance is at most this
# share of the largest one. A covariance has squared lengths, so they are then 3e-5 of their length
# wide; rounding alone leaves a share of about 1e-16.
_LINE = 1e-9


def rigid_fit(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[Array, Array]:
    """Return R, p that minimise sum w |R source + p - target|^2 among proper rotations.

    From the singular values of the weighted covariance of target and source, U diag(s) V^T:
    R = U diag(1, 1, d) V^T, where d, the determinant of U V^T, keeps a mirror image out (Kabsch,
    1978; Umeyama, 1991).

    Args:
        source: points, shape (3, N), N at least 3 [m].
        target: their partners, same shape [m].
        weights: shape (N,), not negative; None for equal ones.

    Returns:
        R (3, 3) and p (3,) [m].

    Raises:
        ValueError: for fewer than three points, points on one line (the turn about it is free), a
            NaN or a negative weight.
    """
    a = vector("source", source, (3, None), unit="m")
    b = vector("target", target, a.shape, unit="m")
    w = np.ones(a.shape[1]) if weights is None else vector("weights", weights, a[0].shape, low=0.0)
    if np.count_nonzero(w) < 3:
        raise invalid("source.shape", a.shape, "at least three points that have a weight")
    R, p = np.empty((3, 3)), np.empty(3)
    rows = (np.ascontiguousarray(x.T) for x in (a, b))
    if not _rotation_loop(*rows, np.ascontiguousarray(w), R, p):
        raise invalid("source", a, "points off one line, here and in target")
    return R, p


@register_jitable
def rotation(a, b, w, R, p):
    """Fill in the motion that minimises sum w |R a + p - b|^2 (Kabsch, 1978; Umeyama, 1991).

    Args:
        a: points, one a row, shape (N, 3) [m].
        b: their partners, shape (N, 3) [m].
        w: weights, not negative, shape (N,). A row of weight 0 has no influence, whatever is in it.
        R: receives the rotation, shape (3, 3).
        p: receives the shift, shape (3,) [m].

    Returns:
        Whether the points determine the motion. They do not without weight, on one line in a or b,
        or with a NaN or an infinity; R and p then stay as they are.
    """
    # Weighted centroids, then the cross-covariance of the centred points.
    total, ca, cb = 0.0, np.zeros(3), np.zeros(3)
    for i in range(len(a)):
        if w[i] == 0.0:  # 0 times NaN would be NaN
            continue
        total += w[i]
        for x in range(3):
            ca[x] += w[i] * a[i, x]
            cb[x] += w[i] * b[i, x]
    if not total > 0.0:
        return False
    for x in range(3):
        ca[x] /= total
        cb[x] /= total
    S = np.zeros((3, 3))
    for i in range(len(a)):
        if w[i] == 0.0:
            continue
        for x in range(3):
            for y in range(3):
                S[x, y] += w[i] * (b[i, x] - cb[x]) * (a[i, y] - ca[y])
    # Singular value decomposition S = U diag(s) V^T by one-sided Jacobi: A = diag(s) V^T.
    A, U = np.empty((3, 3)), np.empty((3, 3))
    decompose(S, A, U)
    s, smallest, largest = np.empty(3), 0, 0
    for r in range(3):
        s[r] = np.sqrt(A[r, 0] ** 2 + A[r, 1] ** 2 + A[r, 2] ** 2)
        if not s[r] < np.inf:  # the numbers below would be no indices
            return False
        smallest = r if s[r] < s[smallest] else smallest
        largest = r if s[r] >= s[largest] else largest
    middle = 3 - largest - smallest
    # Only one singular value: the points lie on a line, and the turn about it is free.
    if s[middle] <= _LINE * s[largest]:
        return False
    for x in range(3):
        A[largest, x] /= s[largest]
        A[middle, x] /= s[middle]
    # Two pairs of singular vectors fix a rotation. The third vectors complete U's and V's to
    # right-handed triples, which is U diag(1, 1, d) V^T whatever sign the smallest singular value
    # asks for.
    for x in range(3):
        y, z = (x + 1) % 3, (x + 2) % 3
        A[smallest, x] = A[largest, y] * A[middle, z] - A[largest, z] * A[middle, y]
        U[x, smallest] = U[y, largest] * U[z, middle] - U[z, largest] * U[y, middle]
    for x in range(3):
        for y in range(3):
            R[x, y] = 0.0
            for r in range(3):
                R[x, y] += U[x, r] * A[r, y]
    # The shift maps the one centroid onto the other.
    for x in range(3):
        p[x] = cb[x] - R[x, 0] * ca[0] - R[x, 1] * ca[1] - R[x, 2] * ca[2]
    return True


_SIGNATURE = boolean(MATRIX, MATRIX, VECTOR, MATRIX, VECTOR)
_rotation_loop = loop(rotation, _SIGNATURE)


def warm() -> None:
    """Compile the loop of this file."""
    compiled(rotation, _SIGNATURE)
