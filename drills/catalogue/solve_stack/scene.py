"""A stack of flat boxes in the plane: its contacts, and the residual of Coulomb's law."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

WIDTH, HEIGHT = 0.6, 0.1  # m, of a box


def stack_matrix(
    mass: ArrayLike, centres: ArrayLike, points: ArrayLike, order: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Delassus matrix of a stack, and the Jacobian of its contacts.

    Args:
        mass: of each box, from the bottom, shape (boxes,) [kg].
        centres: their x, shape (boxes,) [m].
        points: x of the contacts below each box, shape (boxes, c) [m].
        order: in which the contacts are numbered, a permutation of boxes * c.

    Returns:
        (A, J): A = J M^-1 J^T, shape (2 n, 2 n) [1/kg]; J takes the velocities (x, y, turn) of
        all boxes to the normal and tangential velocity of each contact, shape (2 n, 3 boxes).
    """
    mass, at = np.asarray(mass, dtype=float), np.asarray(points, dtype=float)
    n, count = at.shape
    J = np.zeros((n, count, 2, n, 3))
    for k in range(n):
        for body, sign, up in ((k, 1.0, -0.5 * HEIGHT), (k - 1, -1.0, 0.5 * HEIGHT)):
            if body >= 0:
                J[k, :, 0, body, 1], J[k, :, 1, body, 0] = sign, sign
                J[k, :, 0, body, 2] = sign * (at[k] - np.asarray(centres)[body])
                J[k, :, 1, body, 2] = -sign * up
    J = J.reshape(n * count, 2, 3 * n)[np.asarray(order)].reshape(-1, 3 * n)
    turning = mass * (WIDTH**2 + HEIGHT**2) / 12.0
    return (J / np.column_stack((mass, mass, turning)).ravel()) @ J.T, J


def coulomb_errors(
    impulses: ArrayLike, A: ArrayLike, b: ArrayLike, mu: ArrayLike
) -> NDArray[np.float64]:
    """Return the error of Coulomb's law at each contact, as a velocity.

    Args:
        impulses: normal and tangential, shape (n, 2) [N s].
        A: Delassus matrix, shape (2 n, 2 n) [1/kg].
        b: velocities without impulses, shape (2 n,) [m/s].
        mu: coefficients of friction, shape (n,).

    Returns:
        Errors of the normal and of the tangential law, shape (n, 2) [m/s].
    """
    A, p = np.asarray(A, dtype=float), np.asarray(impulses, dtype=float)
    u = (A @ p.ravel() + np.asarray(b, dtype=float)).reshape(-1, 2)
    w = np.diag(A).reshape(-1, 2) * p
    bound = np.diag(A)[1::2] * np.asarray(mu) * np.maximum(p[:, 0], 0.0)
    normal = np.minimum(w[:, 0], u[:, 0])
    tangential = w[:, 1] - np.clip(w[:, 1] - u[:, 1], -bound, bound)
    return np.column_stack((normal, tangential))
