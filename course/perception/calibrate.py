"""Where is the camera? From touched points to its pose in the base, and the hand-eye equation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from course.check import finite, invalid, vector
from course.perception.camera import Array
from course.perception.rigid import rigid_fit
from course.rigid_body.quaternion import from_matrix, log, to_matrix, unit_quaternion


def target_error(points: ArrayLike, places: ArrayLike, sigma: float) -> Array:
    """Return root mean square error at places, of a rigid fit to noisy points.

    sigma^2 (1 + sum_k d_k^2 / f_k^2 / 3) 3 / N: d_k is a place's distance from principal axis k of
    the points, f_k the root mean square distance of the points from it. So the error is least in
    their middle, and grows fast beyond them (Fitzpatrick, West and Maurer, 1998).

    Args:
        points: those of the fit, shape (3, N) [m].
        places: shape (3, M) [m].
        sigma: of each coordinate, of both measurements together [m].

    Returns:
        Shape (M,) [m].

    Raises:
        ValueError: for fewer than three points, points in one line, a NaN or a negative sigma.
    """
    given, at = vector("points", points, (3, None), unit="m"), vector("places", places, (3, None))
    spread = finite("sigma", sigma, 0.0, unit="m")
    if given.shape[1] < 3:
        raise invalid("points.shape", given.shape, "at least three points")
    middle = given.mean(axis=1, keepdims=True)
    axes, lengths, _ = np.linalg.svd(given - middle, full_matrices=False)
    if lengths[1] <= 1e-9 * lengths[0]:
        raise invalid("points", given, "points off one line")
    n = given.shape[1]
    # Mean square distance from each principal axis: the total less the part along it.
    f = (np.sum(lengths**2) - lengths**2) / n
    along = (axes.T @ (at - middle)) ** 2
    d = along.sum(axis=0) - along
    return spread * np.sqrt(3.0 / n * (1.0 + np.sum(d / f[:, None], axis=0) / 3.0))


@dataclass(frozen=True, eq=False)
class Calibration:
    """The camera in the base: a point c of the camera's frame stands at R c + p.

    Attributes:
        R, p: (3, 3) and (3,) [m].
        sigma: of each coordinate, estimated from the residual [m].
        points: those touched, in the base (3, N) [m].
    """

    R: Array
    p: Array
    sigma: float
    points: Array

    def error_at(self, places: ArrayLike) -> Array:
        """Return the predicted root mean square error at places in the base, shape (M,) [m].

        The places have shape (3, M) [m].
        """
        return target_error(self.points, places, self.sigma)


def camera_to_base(observed: ArrayLike, touched: ArrayLike) -> Calibration:
    """Return the camera's pose from the same points seen by it and touched by the arm.

    Three points leave a residual too, but it says least about the error: of 3 N coordinates the fit
    takes six, so that the mean square residual is (1 - 2 / N) times that of the noise.

    Args:
        observed: the same points in the camera's frame, shape (3, N) [m].
        touched: in the base, shape (3, N) [m].

    Raises:
        ValueError: as for `rigid_fit`.
    """
    base = vector("touched", touched, (3, None), unit="m")
    R, p = rigid_fit(observed, base)
    deviation = R @ np.asarray(observed, dtype=float) + p[:, None] - base
    return Calibration(R, p, float(np.sqrt(np.sum(deviation**2) / (3 * base.shape[1] - 6))), base)


@dataclass(frozen=True, eq=False)
class HandEye:
    """The solution X of A X = X B.

    Attributes:
        pose: (7,), the camera in the hand where A are motions of the hand, B of the camera.
        rank: 3 where the motions turn about two axes or more; 2 where all axes are parallel, as of
            a planar arm: then no motion tells the shift along the axis, and no turn, of which the
            rotation is fitted here, that about it.
        singular: singular values of the equations for the shift, the largest first, (3,).
    """

    pose: Array
    rank: int
    singular: Array


def hand_eye(A: ArrayLike, B: ArrayLike, tolerance: float = 0.02) -> HandEye:
    """Return X of A X = X B for many motions (Park and Martin, 1994).

    The rotation vectors of A are those of B turned by X, which is a fit of directions: with
    M = sum b a^T it is (M^T M)^(-1/2) M^T. Then (R_A - 1) x = R_X t_B - t_A by least squares.

    Args:
        A: motions to the left of X, shape (7, N), N at least 2.
        B: the same motions to the right of X, same shape.
        tolerance: a singular value below this share of the largest counts as zero; the errors of
            the turns, over the turns, make one of that size out of nothing [1].

    Raises:
        ValueError: for fewer than two motions, or motions that do not turn.
    """
    a, b = vector("A", A, (7, None)), vector("B", B, (7, None))
    if a.shape != b.shape or a.shape[1] < 2:
        raise invalid("A.shape", a.shape, f"two motions or more, as many as in B, {b.shape}")
    turns = [log(unit_quaternion(x[3:], f"{name}[3:]")) for name, x in (("A", a), ("B", b))]
    # The rotation vectors are vectors that R turns into each other: Kabsch's fit of directions.
    U, s, V = np.linalg.svd(turns[0] @ turns[1].T)
    if s[0] <= 1e-12:
        raise invalid("A", a, "motions that turn")
    # The determinant keeps it a proper rotation.
    R = U @ np.diag((1.0, 1.0, np.linalg.det(U @ V))) @ V
    # With R known the translation is linear: (R_A - 1) x = R t_B - t_A for all motions.
    rows = np.concatenate(np.moveaxis(to_matrix(a[3:]), 2, 0) - np.eye(3))
    right = (R @ b[:3] - a[:3]).T.ravel()
    x, _, rank, singular = np.linalg.lstsq(rows, right, rcond=tolerance)
    return HandEye(
        np.concatenate((x, from_matrix(R))), int(rank), np.asarray(singular, dtype=float)
    )
