"""Following a part on the table: a Kalman filter on place and turn, and what pictures cost in age.

The state is (x, y, yaw) and its rates; between pictures an unknown constant acceleration of a given
standard deviation acts (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking
and Navigation, 2001, sec. 6.3.2).
"""

from __future__ import annotations

import math

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from course.check import count, finite, invalid, positive, vector
from course.perception.camera import Array

# What chi squared with 3 (2, 1) degrees of freedom exceeds once in a thousand times.
_GATES = (10.83, 13.82, 16.27)


def steady_gains(index: float) -> tuple[float, float]:
    """Return the steady-state gains of position and rate.

    They follow from the tracking index (Kalata, 1984).

    Args:
        index: acceleration T^2 / sigma, for a picture every T seconds.

    Returns:
        alpha and beta: after an innovation r the place moves by alpha r, the rate by beta r / T.

    Raises:
        ValueError: for an index that is not positive.
    """
    lam = positive("index", index)
    # r is what is left of an innovation; 1 - r from the conjugate root, which does not cancel.
    root = math.sqrt(lam * lam + 8.0 * lam)
    r = 4.0 / (4.0 + lam + root)
    missing = (lam + root) / (4.0 + lam + root)
    return missing * (1.0 + r), 2.0 * missing * missing


def averaged_error(k: ArrayLike, sigma: float, period: float, speed: float) -> Array:
    """Return the error of the mean of k pictures of a part that moves: noise falls, the lag grows.

    Args:
        k: numbers of pictures.
        sigma: of one picture [m].
        period: between pictures [s].
        speed: of the part [m/s].

    Returns:
        sqrt(sigma^2 / k + ((k - 1) period speed / 2)^2), of the shape of k [m].
    """
    n = vector("k", k, low=1.0)
    return np.hypot(sigma / np.sqrt(n), 0.5 * (n - 1.0) * period * speed)


@register_jitable
def follow(x, P, dt, z, R, acceleration):
    """Take a measured place in the plane into a track, in place: a `Tracker` for compiled loops.

    It has no gate and no turn. x (4,) is (x, y) and its rates, P (4, 4) their covariance, both at
    the picture before, dt [s] ago; z (2,) is what was seen, R (2, 2) its covariance, acceleration
    the standard deviation of what acts in between [m/s^2].
    """
    # Prediction of a constant velocity: F P F^T, first the rows, then the columns.
    for i in range(2):
        x[i] += dt * x[i + 2]
        P[i] += dt * P[i + 2]
    for i in range(2):
        P[:, i] += dt * P[:, i + 2]
    # Process noise of an acceleration that is constant between two pictures.
    for i in range(2):
        P[i, i] += (0.5 * acceleration * dt * dt) ** 2
        P[i, i + 2] += 0.5 * acceleration * acceleration * dt**3
        P[i + 2, i] += 0.5 * acceleration * acceleration * dt**3
        P[i + 2, i + 2] += (acceleration * dt) ** 2
    # Covariance of the innovation, inverted below with its determinant.
    s, c, u = P[0, 0] + R[0, 0], P[0, 1] + R[0, 1], P[1, 1] + R[1, 1]
    det = s * u - c * c
    r1, r2 = z[0] - x[0], z[1] - x[1]
    # Both rows as they were before the update, which changes them on the way.
    above = P[:2].copy()
    for i in range(4):
        k1, k2 = (u * P[i, 0] - c * P[i, 1]) / det, (s * P[i, 1] - c * P[i, 0]) / det
        x[i] += k1 * r1 + k2 * r2
        P[i] -= k1 * above[0] + k2 * above[1]


class Tracker:
    """A Kalman filter on (x, y, yaw) with innovations that are gated.

    Args:
        acceleration: standard deviation of what acts between two pictures: of a shift [m/s^2] and
            of a turn [rad/s^2].
        speed: the same of the first rates [m/s, rad/s].
        period: of the turn, after which the part looks the same [rad]: pi for a box.
        gate: square of the normalised innovation above which a measurement is rejected; None for
            what is exceeded once in a thousand times, infinite for no gate.
        patience: rejections in a row after which the track restarts; 0 for never, which locks the
            filter out for good once the part did what it deems impossible.
        gains: alpha and beta to use always, instead of the best for what is known.

    Attributes:
        state: (x, y, yaw, and their rates) at `stamp`, (6,).
        covariance: of the state, (6, 6).
        stamp: of the last picture taken in [s], minus infinity before the first.
        rejected: measurements in a row that were rejected.
    """

    def __init__(
        self,
        acceleration: tuple[float, float] = (0.5, 2.0),
        speed: tuple[float, float] = (0.5, 2.0),
        *,
        period: float = 2.0 * math.pi,
        gate: float | None = None,
        patience: int = 5,
        gains: tuple[float, float] | None = None,
    ) -> None:
        shift, turn = vector("acceleration", acceleration, (2,), low=0.0)
        self.acceleration = np.array([shift, shift, turn])
        shift, turn = vector("speed", speed, (2,), low=0.0)
        self.speed = np.array([shift, shift, turn])
        self.period = positive("period", period, unit="rad")
        self.gate, self.gains = gate, gains
        self.patience = count("patience", patience)
        self.state, self.covariance = np.zeros(6), np.zeros((6, 6))
        self.stamp = -math.inf
        self.rejected = 0

    def _at(self, stamp: float) -> tuple[Array, Array]:
        """Return the state and covariance at a time from the last picture on."""
        if self.stamp == -math.inf:
            raise invalid("stamp", stamp, "a time after the first update")
        dt = finite("stamp", stamp, self.stamp, unit="s") - self.stamp
        # Transition at constant velocity, and what a constant acceleration adds.
        F = np.eye(6) + dt * np.eye(6, k=3)
        G = np.vstack((0.5 * dt * dt * np.eye(3), dt * np.eye(3))) * self.acceleration
        return F @ self.state, F @ self.covariance @ F.T + G @ G.T

    def predict(self, stamp: float) -> tuple[Array, Array]:
        """Return where the part is now, though its last picture is old.

        Returns:
            (x, y, yaw) and its covariance, (3,) and (3, 3).

        Raises:
            ValueError: before the first update, or for a time before that of the last picture.
        """
        x, P = self._at(stamp)
        return x[:3], P[:3, :3]

    def update(self, stamp: float, z: ArrayLike, covariance: ArrayLike) -> bool:
        """Take a measurement in.

        Args:
            stamp: when its picture was taken, not when it arrived [s].
            z: (x, y, yaw) [m, rad].
            covariance: of z, (3, 3); infinite on the diagonal for what was not observed.

        Returns:
            Whether it was taken; not if the gate rejected it.

        Raises:
            ValueError: for a picture older than the last one, a NaN, or a first measurement that
                does not tell all.
        """
        seen_at, given = finite("stamp", stamp, unit="s"), vector("z", z, (3,))
        R = np.asarray(covariance, dtype=float)
        if R.shape != (3, 3) or np.isnan(R).any() or not (np.diag(R) > 0.0).all():
            raise invalid("covariance", R, "a (3, 3) matrix with positive variances")
        report = np.isfinite(np.diag(R))
        if self.stamp == -math.inf:
            if not report.all():
                raise invalid("covariance", R, "finite for the first measurement")
            self._start(seen_at, given, R)
            return True
        x, P = self._at(seen_at)
        H, R = np.eye(6)[:3][report], R[np.ix_(report, report)]
        r = given - x[:3]
        # The innovation of the turn, modulo the period after which the part looks the same.
        r[2] -= self.period * np.rint(r[2] / self.period)
        S = H @ P @ H.T + R
        gate = self.gate if self.gate is not None else _GATES[max(0, report.sum() - 1)]
        # Normalised innovation squared, compared with a quantile of chi squared.
        if report.any() and r[report] @ np.linalg.solve(S, r[report]) > gate:
            self.rejected += 1
            if self.patience and self.rejected >= self.patience and report.all():
                self._start(seen_at, given, R)
                return True
            return False
        if self.gains is None:
            # Kalman gain P H^T S^-1, by a solve instead of an inverse.
            K = np.linalg.solve(S, H @ P).T
        else:
            dt = max(seen_at - self.stamp, 1e-12)
            K = np.vstack((self.gains[0] * np.eye(3), self.gains[1] / dt * np.eye(3)))[:, report]
        # Joseph's form holds for any gain, and keeps the covariance positive.
        remaining = np.eye(6) - K @ H
        self.state, self.covariance = x + K @ r[report], remaining @ P @ remaining.T + K @ R @ K.T
        self.stamp, self.rejected = seen_at, 0
        return True

    def _start(self, stamp: float, z: Array, R: Array) -> None:
        self.state = np.concatenate((z, np.zeros(3)))
        self.covariance = np.zeros((6, 6))
        self.covariance[:3, :3], self.covariance[3:, 3:] = R, np.diag(self.speed**2)
        self.stamp, self.rejected = stamp, 0
