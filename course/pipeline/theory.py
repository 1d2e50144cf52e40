"""What a run should give, before it is run: each part of the error, and each limit, in closed form.

An error of the tip is a vector [m], what it is minus what it should be. The arm is held by
torque = kp (reference - q) - kd v, so kd acts on the joint's speed alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, positive, vector
from course.kinematics.two_link import TwoLink

Array = NDArray[np.float64]


# --- the parts of the error -----------------------------------------------------------------------


def filter_gain(alpha: float, beta: float, ahead: float = 0.0) -> float:
    """Return the variance of an alpha-beta filter's place over that of one picture.

    With x as the error of the place and T v of the rate, the filter is the linear system
    x' = (1 - alpha)(x + T v) + alpha n, T v' = T v - beta (x + T v) + beta n, whose covariance is
    [2 alpha^2 + beta (2 - 3 alpha), beta (2 alpha - beta), 2 beta^2] / (alpha (4 - beta -
    2 alpha)) (Kalata, The tracking index, 1984).

    Args:
        alpha: gain on the position, stable while both are positive and 2 alpha + beta < 4; 1 for no
            filter.
        beta: gain on the rate; 0 for no filter.
        ahead: periods that the estimate is carried forward at its own rate.
    """
    a, b = positive("alpha", alpha), finite("beta", beta, 0.0)
    # Stability of the alpha-beta filter (Kalata, 1984).
    t, room = finite("ahead", ahead, 0.0), 4.0 - b - 2.0 * a
    if room <= 0.0:
        raise invalid("2 alpha + beta", 2.0 * a + b, "a number below 4")
    place, both, rate = 2.0 * a * a + b * (2.0 - 3.0 * a), b * (2.0 * a - b), 2.0 * b * b
    return (place + 2.0 * t * both + t * t * rate) / (a * room)


def settling(
    pictures: int, period: float, ratio: float, drift: float, retain: float = 0.0
) -> tuple[float, float]:
    """Return the effect of a target's speed and noise on a Kalman filter that has not settled.

    It starts at its first picture and believes in a speed around 0, so that it has to be taught
    every speed: at first it stays behind.

    Args:
        pictures: number of images that it has processed.
        period: between them [s].
        ratio: of the speeds that it believes in to the noise, standard deviations [1/s].
        drift: the same of accelerations [1/s^2].
        retain: fraction of its state that the arm retains from image to image, as in `low_pass`.

    Returns:
        Mean error for each unit of speed [s], and variance over that of a picture, of the place;
        with `retain` of what an arm makes of it.
    """
    T, e = positive("period", period, unit="s"), np.array([1.0, 0.0])
    F, Q = np.array([[1.0, T], [0.0, 1.0]]), drift**2 * np.outer((T * T / 2, T), (T * T / 2, T))
    # In units of a picture's noise: its variance is 1, that of the unknown speed ratio^2.
    P, mean, C = np.diag([1.0, ratio**2]), np.array([0.0, -1.0, 0.0]), np.diag([1.0, 0.0, 1.0])
    A, take = np.diag([0.0, 0.0, retain]), 1.0 - retain
    # Kalman recursion for a target of constant velocity; (mean, C) follow the true error, with the
    # arm's low-pass as a third state.
    for _ in range(count("pictures", pictures, 1) - 1):
        P = F @ P @ F.T + Q
        k = P[:, 0] / (P[0, 0] + 1.0)
        P = P - np.outer(k, P[0])
        A[:2, :2] = (np.eye(2) - np.outer(k, e)) @ F
        A[2, :2] = take * A[0, :2]
        B = np.array([k[0], k[1], take * k[0]])
        mean, C = A @ mean, A @ C @ A.T + np.outer(B, B)
    return float(mean[2]), float(C[2, 2])


def low_pass(period: float, lag: float) -> float:
    """Return variance that an arm of some lag [s] keeps of a reference that jumps once a period.

    The slow mode is y' = (r - y) / lag; over a period y keeps p = exp(-period / lag) of itself and
    takes 1 - p of r, so that (1 - p) / (1 + p) is left when r is white.
    """
    p = math.exp(-positive("period", period, unit="s") / positive("lag", lag, unit="s"))
    return (1.0 - p) / (1.0 + p)


def tip_jacobian(arm: TwoLink, q: ArrayLike) -> Array:
    """Return d tip / d q, shape (2, 2) [m/rad]."""
    (q1, q2), (l1, l2) = vector("q", q, (2,), unit="rad"), arm.lengths
    far = l2 * np.array([-np.sin(q1 + q2), np.cos(q1 + q2)])
    return np.stack([far + l1 * np.array([-np.sin(q1), np.cos(q1)]), far], axis=1)


def lag(arm: TwoLink, q: ArrayLike, kp: float, kd: float, velocity: ArrayLike) -> Array:
    """Return how far the tip lags behind a moving reference, -(kd + c) / kp times its velocity.

    At a steady rate the spring has to pay for all damping: kp e = (kd + c) v in each joint. The
    torques of acceleration are left out: they grow with the square of the speed.

    Args:
        arm: c is its damping.
        q: posture, shape (2,), not stretched.
        kp: stiffness of the law [N m/rad].
        kd: damping of the law [N m s/rad].
        velocity: of the reference's tip, shape (2,) [m/s].
    """
    J, u = tip_jacobian(arm, q), vector("velocity", velocity, (2,), unit="m/s")
    times = (finite("kd", kd, 0.0) + np.array(arm.damping)) / positive("kp", kp)
    return np.asarray(-J @ (times * np.linalg.solve(J, u)))


def sag(arm: TwoLink, q: ArrayLike, kp: float) -> Array:
    """Return where gravity pulls the tip: -J G(q) / kp, to first order [m].

    A table that is off the level by an angle is an arm with gravity 9.81 sin(angle) along -y.
    """
    still = np.zeros(2)
    return np.asarray(-tip_jacobian(arm, q) @ arm.bias(q, still) / positive("kp", kp))


def collision_share(clearance: ArrayLike, covariance: ArrayLike, normal: ArrayLike) -> Array:
    """Return share of plans that touch, of those that keep a clearance from where a disc was seen.

    The error across the gap is normal with variance n^T C n. Exact for a path that passes straight;
    one that bends round the disc by an angle t touches it in t / (2 pi) exp(-gap^2 / (2 sigma^2))
    more, with sigma in every direction. Of places where an arm stands less touch: a disc curves.

    Args:
        clearance: any shape [m].
        covariance: of the place, shape (2, 2) [m^2].
        normal: direction of the shortest way, shape (2,).
    """
    from scipy.special import ndtr

    n = vector("normal", normal, (2,))
    variance = float(n @ vector("covariance", covariance, (2, 2)) @ n) / max(float(n @ n), POSITIVE)
    if variance <= 0.0:
        raise invalid("variance across the gap", variance, "a positive number")
    return np.asarray(ndtr(-vector("clearance", clearance) / math.sqrt(variance)))


# --- the limits -----------------------------------------------------------------------------------


def _pulls(arm: TwoLink, q: ArrayLike, kp: float, kd: float) -> tuple[Array, Array]:
    """Return M^-1 Kp and M^-1 (Kd + c), each (2, 2)."""
    inverse = np.asarray(np.linalg.inv(arm.mass_matrix(vector("q", q, (2,)))), dtype=float)
    return positive("kp", kp) * inverse, inverse * (finite("kd", kd, 0.0) + np.array(arm.damping))


def step_limit(arm: TwoLink, q: ArrayLike, kp: float, kd: float) -> float:
    """Return the largest stable step of semi-implicit Euler with PD at every step [s].

    With m the largest eigenvalue of the inverse inertia, k = kp m and d = (kd + c) m it is
    (sqrt(d^2 + 4 k) - d) / k: -1 becomes an eigenvalue. With other damping in each joint it is the
    least h for which 4 M - 2 h (kd + c) - h^2 kp is singular, which is what is solved here.

    Args:
        arm: linearised at rest in q.
        q: posture, shape (2,) [rad].
        kp: stiffness of the law [N m/rad].
        kd: damping of the law [N m s/rad].
    """
    K, D = _pulls(arm, q, kp, kd)
    # 1 / h is an eigenvalue: 4 (1 / h)^2 - 2 D (1 / h) - K = 0.
    companion = np.block([[np.zeros((2, 2)), np.eye(2)], [0.25 * K, 0.5 * D]])
    return float(1.0 / np.linalg.eigvals(companion).real.max())


def growth(arm: TwoLink, q: ArrayLike, kp: float, kd: float, dt: float, held: int = 1) -> float:
    """Return growth a control period near rest in q: the largest eigenvalue's size; stable below 1.

    Args:
        arm: as for `step_limit`.
        q: as for `step_limit`.
        kp: as for `step_limit`.
        kd: as for `step_limit`.
        dt: physics step [s].
        held: steps for which a torque is held.
    """
    h, n = positive("dt", dt, unit="s"), count("held", held, 1)
    inverse = np.linalg.inv(arm.mass_matrix(vector("q", q, (2,))))
    # Damping acts on the velocity of the step's start, the spring of the law on the held sample.
    damped, zero = np.eye(2) - h * inverse @ np.diag(arm.damping), np.zeros((2, 2))
    free = np.block([[np.eye(2), h * damped], [zero, damped]])
    push = np.vstack([h * h * inverse, h * inverse])
    law = -np.hstack([kp * np.eye(2), kd * np.eye(2)])
    state = np.eye(4)
    for _ in range(n):
        # Every step of the period applies the torque of the state that was sampled at its start.
        state = free @ state + push @ law
    return float(np.abs(np.linalg.eigvals(state)).max())


class Modes(NamedTuple):
    """Two motions of an arm at rest, each for itself, the slow one first; shapes (2,).

    omega = sqrt(kp m) [rad/s], m an eigenvalue of the inverse inertia; zeta = (kd + c) sqrt(m / kp)
    / 2; overshoot of a step, exp(-pi zeta / sqrt(1 - zeta^2)), 0 from zeta = 1 on; ring: time until
    a fiftieth is left, of the slower part [s].
    """

    omega: Array
    zeta: Array
    overshoot: Array
    ring: Array


def modes(arm: TwoLink, q: ArrayLike, kp: float, kd: float) -> Modes:
    """Return modes of an arm whose joints are damped alike; ValueError where they are not."""
    if arm.damping[0] != arm.damping[1]:
        raise invalid("arm.damping", arm.damping, "the same in both joints")
    m = np.sort(np.linalg.eigvals(_pulls(arm, q, kp, kd)[0]).real) / kp
    omega, zeta = np.sqrt(kp * m), 0.5 * (kd + arm.damping[0]) * np.sqrt(m / kp)
    inner = np.sqrt(np.maximum(1.0 - zeta**2, POSITIVE))
    overshoot = np.where(zeta < 1.0, np.exp(-np.pi * np.minimum(zeta, 1.0) / inner), 0.0)
    # Decay rate of the slower pole: zeta omega below critical damping, the slower real pole above.
    slow = omega * (zeta - np.sqrt(np.maximum(zeta**2 - 1.0, 0.0)))
    return Modes(omega, zeta, overshoot, math.log(50.0) / slow)


def look_limit(frames: int) -> float:
    """Return the largest gain of e[t + 1] = e[t] - g e[t - k]: 2 sin(pi / (2 (2 k + 1))).

    On the circle z^k (z - 1) = -g means that w k + w / 2 + pi / 2 = pi at |z - 1| = 2 sin(w / 2).

    Args:
        frames: k, by which the picture is late.
    """
    return 2.0 * math.sin(0.5 * math.pi / (2 * count("frames", frames) + 1))


def look_matrix(gain: float, frames: int) -> Array:
    """Return that loop as a matrix on (e[t], e[t - 1], ..., e[t - k]), shape (k + 1, k + 1)."""
    # A shift register of past errors, with the feedback from the oldest one.
    matrix = np.eye(count("frames", frames) + 1, k=-1)
    matrix[0, 0] = 1.0
    matrix[0, -1] -= finite("gain", gain)
    return matrix


def look_noise(gain: float, frames: int) -> float:
    """Return the variance of the place over that of one picture.

    From P = A P A^T + B B^T, solved as linear equations; gain / (2 - gain) for fresh pictures.
    ValueError beyond `look_limit`.
    """
    # Stationary covariance: the Lyapunov equation X = A X A^T + B B^T as a linear system.
    A, n = look_matrix(gain, frames), frames + 1
    if not 0.0 < gain < look_limit(frames):
        raise invalid("gain", gain, f"a number above 0 and below {look_limit(frames):g}")
    noise = np.zeros(n * n)
    noise[0] = gain * gain
    return float(np.linalg.solve(np.eye(n * n) - np.kron(A, A), noise)[0])
