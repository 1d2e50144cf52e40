"""Worked answers of the graded exercises of chapter 1: rigid bodies, rotations, integrators.

Every function stands alone, so that it can be read, copied and explained by itself. The chapter's
own functions (`course.rigid_body`) are the judges in the tests; these are what one would write on a
whiteboard. Quaternions are scalar first, (w, x, y, z), and turn body coordinates into world ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def verlet_step(
    q: Array,
    v: Array,
    a: Array,
    acceleration: Callable[[Array], Array],
    dt: float,
) -> tuple[Array, Array, Array]:
    """Return one step of velocity Verlet, with one evaluation of the acceleration.

    Second order, symplectic and reversible for forces that depend on the position alone: a step
    with -dt leads back. The acceleration at the new position is handed on, because the next step
    begins with it (Swope et al. 1982).

    Args:
        q: positions at the start of the step, shape (n,) [m].
        v: velocities there, shape (n,) [m/s].
        a: acceleration at q, shape (n,) [m/s^2].
        acceleration: function q -> acceleration, shape (n,) each; called once.
        dt: step [s]; negative runs backwards.

    Returns:
        The new (q, v, a), each of shape (n,); the inputs are left as they were.

    Raises:
        ValueError: when q, v and a differ in shape.
    """
    q, v, a = (np.asarray(x, dtype=float) for x in (q, v, a))
    if not q.shape == v.shape == a.shape:
        raise ValueError(f"q, v and a must have one shape, got {q.shape}, {v.shape}, {a.shape}")
    # The velocity half way is what moves the position: that makes each line a shear.
    v_half = v + 0.5 * dt * a
    q_new = q + dt * v_half
    a_new = np.asarray(acceleration(q_new), dtype=float)
    v_new = v_half + 0.5 * dt * a_new
    return q_new, v_new, a_new


def update_orientation(q: Array, omega: Array, dt: float) -> Array:
    """Return the orientation after turning for dt at a constant body rate.

    Exact for any angle: q exp(dt omega), with the exponential on the right because the rate is
    given in the body frame (Solà 2017, Quaternion kinematics for the error-state Kalman filter,
    sec. 4.6).

    Args:
        q: unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        dt: step [s].

    Returns:
        Unit quaternion (w, x, y, z), shape (4,).

    Raises:
        ValueError: when q is not a unit quaternion, or the turn is not finite.
    """
    w, x, y, z = np.asarray(q, dtype=float)
    if not abs(w * w + x * x + y * y + z * z - 1.0) < 1e-6:
        raise ValueError(f"q must be a unit quaternion, got {q}")
    half_turn = 0.5 * dt * np.asarray(omega, dtype=float)
    half_angle = np.linalg.norm(half_turn)
    if not np.isfinite(half_angle):
        raise ValueError(f"dt * omega must be finite, got {2.0 * half_turn}")
    # np.sinc(t) is sin(pi t) / (pi t), and 1 at zero: no division by a vanishing angle.
    c = np.cos(half_angle)
    i, j, k = np.sinc(half_angle / np.pi) * half_turn
    turned = np.array(
        [
            w * c - x * i - y * j - z * k,
            w * i + x * c + y * k - z * j,
            w * j - x * k + y * c + z * i,
            w * k + x * j - y * i + z * c,
        ]
    )
    # Both factors have length one; this takes away rounding, which would add up.
    return turned / np.linalg.norm(turned)


def bounce_step(
    y: float, v: float, dt: float, restitution: float, gravity: float = 9.81
) -> tuple[float, float]:
    """Return the height and velocity of a bouncing point after a step with any number of bounces.

    The impact time is the root of a parabola; after it come flights of 2 u / g, 2 e u / g, ...,
    whose sum is finite for e < 1: what bounces infinitely often is at rest at a known time. Nothing
    loops, so neither a long step nor a resting ball costs more.

    Args:
        y: height above the floor at the start, not negative [m].
        v: velocity, upwards positive [m/s].
        dt: step, positive [s].
        restitution: speed after an impact over speed before, 0 to 1.
        gravity: downwards, positive [m/s^2].

    Returns:
        (y, v) at the end of the step; (0.0, 0.0) from the moment at which the ball lies still.

    Raises:
        ValueError: for a number outside these ranges.
    """
    if not (0.0 <= y < math.inf and math.isfinite(v)):
        raise ValueError(f"y must be finite and not negative and v finite, got {y} and {v}")
    if not (0.0 < dt < math.inf and 0.0 < gravity < math.inf):
        raise ValueError(f"dt and gravity must be positive and finite, got {dt} and {gravity}")
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must be within 0 to 1, got {restitution}")
    # The later root of y + v t - g t^2 / 2.
    impact = math.sqrt(v * v + 2.0 * gravity * y)
    fall = (v + impact) / gravity
    if dt < fall:
        return max(y + v * dt - 0.5 * gravity * dt * dt, 0.0), v - gravity * dt
    left = dt - fall
    up = restitution * impact
    # All flights that are still to come last 2 u / g (1 + e + e^2 + ...) = 2 u / (g (1 - e)).
    elapsed = left * gravity / 2.0
    if elapsed * (1.0 - restitution) >= up:
        return 0.0, 0.0
    if restitution < 1.0:
        flights = math.floor(
            math.log1p(-elapsed * (1.0 - restitution) / up) / math.log(restitution)
        )
        flown = up * (1.0 - restitution**flights) / (1.0 - restitution)
    else:
        flights = math.floor(elapsed / up)
        flown = up * flights
    up *= restitution**flights
    left = max(2.0 * (elapsed - flown) / gravity, 0.0)
    return max(up * left - 0.5 * gravity * left * left, 0.0), up - gravity * left


def largest_stable_step(stiffness: Array, mass: Array) -> float:
    """Return the longest step at which semi-implicit Euler is stable on M x'' = -K x.

    2 / omega_max, where omega_max^2 is the largest eigenvalue of K x = omega^2 M x. The same limit
    holds for velocity Verlet (Hairer, Lubich and Wanner, Geometric Numerical Integration, 2006,
    sec. I.1).

    Args:
        stiffness: K, symmetric and positive semi-definite, shape (n, n) [N/m].
        mass: M, symmetric and positive definite, shape (n, n) [kg].

    Returns:
        The step [s]; infinite where there is no spring at all.

    Raises:
        ValueError: when a matrix is not square and symmetric, or one of the two is not definite.
    """
    K, M = np.asarray(stiffness, dtype=float), np.asarray(mass, dtype=float)
    for name, matrix in (("stiffness", K), ("mass", M)):
        if matrix.ndim != 2 or matrix.shape != K.shape or matrix.shape != matrix.T.shape:
            raise ValueError(f"{name} must be a square matrix of one size, got {matrix.shape}")
        if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
            raise ValueError(f"{name} must be symmetric and finite, got {matrix}")
    try:
        L = np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        raise ValueError(f"mass must be positive definite, got {M}") from None
    # With M = L L^T the problem is symmetric again: L^-1 K L^-T has the same eigenvalues.
    squares = np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, K).T))
    if squares[0] < -1e-9 * abs(squares[-1]):
        raise ValueError(f"stiffness must have no negative eigenvalue, got {squares[0]}")
    return 2.0 / math.sqrt(squares[-1]) if squares[-1] > 0.0 else math.inf


def tumble(q: Array, omega: Array, inertia: Array, dt: float, steps: int) -> tuple[Array, Array]:
    """Return a body that turns freely, integrated with RK4.

    Four quantities are constant: the length of q, the kinetic energy, and the angular momentum in
    the **world** as a vector, which is more than its length. The silent bug of this exercise is a
    sign that only the last one shows.

    Args:
        q: orientation, unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        inertia: principal moments, shape (3,) [kg m^2].
        dt: step [s].
        steps: how many.

    Returns:
        (q, omega) at the end, shapes (4,) and (3,).
    """
    inertia = np.asarray(inertia, dtype=float)

    def rates(q: Array, omega: Array) -> tuple[Array, Array]:
        w, x, y, z = q
        i, j, k = omega
        # q times (0, omega) / 2: a body rate stands on the right.
        q_rate = 0.5 * np.array(
            [
                -x * i - y * j - z * k,
                w * i + y * k - z * j,
                w * j + z * i - x * k,
                w * k + x * j - y * i,
            ]
        )
        # No torque: I omega' + omega x (I omega) = 0.
        omega_rate = -np.cross(omega, inertia * omega) / inertia
        return q_rate, omega_rate

    q, omega = np.array(q, dtype=float), np.array(omega, dtype=float)
    for _ in range(steps):
        q1, w1 = rates(q, omega)
        q2, w2 = rates(q + 0.5 * dt * q1, omega + 0.5 * dt * w1)
        q3, w3 = rates(q + 0.5 * dt * q2, omega + 0.5 * dt * w2)
        q4, w4 = rates(q + dt * q3, omega + dt * w3)
        q = q + dt / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
        omega = omega + dt / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        q = q / np.linalg.norm(q)
    return q, omega


def observed_order(
    coarse: Array, medium: Array, fine: Array, ratio: float = 2.0
) -> tuple[float, Array]:
    """Return the order of accuracy shown by three runs, and their extrapolated result.

    No true solution is needed: with an error C h^p, the two differences of successive results are
    in the ratio r^p, and the last difference is r^p - 1 times the error that is left (Richardson
    1911; Roache 1994).

    Args:
        coarse, medium, fine: the same quantity, computed with steps r^2 h, r h and h; one shape.
        ratio: r, by which the step was divided each time, above 1.

    Returns:
        p, from the 2-norms of the differences, and the extrapolated result in the shape of `fine`.

    Raises:
        ValueError: when the runs do not converge, so that they have no order.
    """
    coarse, medium, fine = (np.asarray(x, dtype=float) for x in (coarse, medium, fine))
    if not coarse.shape == medium.shape == fine.shape:
        raise ValueError(
            "coarse, medium and fine must have one shape, "
            f"got {coarse.shape}, {medium.shape}, {fine.shape}"
        )
    if not 1.0 < ratio < math.inf:
        raise ValueError(f"ratio must be above 1 and finite, got {ratio}")
    first = np.linalg.norm(medium - coarse)
    second = np.linalg.norm(fine - medium)
    if not 0.0 < second < first < math.inf:
        raise ValueError(f"the differences must get smaller, got {first} and then {second}")
    growth = first / second  # r^p
    order = math.log(growth) / math.log(ratio)
    return order, fine + (fine - medium) / (growth - 1.0)
