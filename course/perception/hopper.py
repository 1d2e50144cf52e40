"""Height and velocity of a one-legged hopper: logs, a filter with five contact rules, the bound.

The hopper is a unit mass on a massless spring leg (Blickhan, The spring-mass model for running and
hopping, 1989). Its body moves vertically, its foot stands a known horizontal distance from below
the hip. The accelerometer has noise and a constant bias. The leg encoder measures the hip's
distance from the ground point only while the foot touches: in flight it shows the leg's rest
length. The state of the filter is (height, velocity, bias).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import count, invalid, one_of
from course.perception.camera import Array

GRAVITY = 9.81  # m/s^2
SUBSTEPS = 10  # of the simulation in each sample
GATE = 4.0  # standard deviations of an innovation, and of the force that shows load
CONTACT = ("always", "flag", "flag and gate", "flag, load and gate", "load and gate")


class HopLog(NamedTuple):
    """What the sensors of a hopper recorded, and the truth.

    Attributes:
        force: specific force, the mean over the interval that ends at the sample, (n,) [m/s^2].
        length: leg encoder (n,) [m].
        offset: horizontal distance from the hip to the foot (n,) [m].
        contact: what the contact sensor reports, 0 or 1 (n,).
        start: expected height, velocity and bias at the first sample (3,) [m, m/s, m/s^2].
        spread: their standard deviations (3,).
        noise: standard deviations of force and length (2,) [m/s^2, m].
        rest: length of the leg in flight [m].
        dt: between samples [s].
        height, velocity: the truth (n,) [m, m/s].
        stance: whether the foot really touches (n,).
    """

    force: Array
    length: Array
    offset: Array
    contact: Array
    start: Array
    spread: Array
    noise: Array
    rest: float
    dt: float
    height: Array
    velocity: Array
    stance: NDArray[np.bool_]

    @property
    def sensors(self) -> tuple[Array | float, ...]:
        """The fields that a filter may use, in the order of the fields."""
        return self[:9]


def hop_logs(
    rng: np.random.Generator,
    logs: int,
    *,
    samples: int = 300,
    dt: float = 5e-3,
    reach: float = 0.15,
    late: int = 4,
    wrong: float = 0.01,
) -> list[HopLog]:
    """Simulate hoppers and their sensors.

    Args:
        rng: generator of everything that is random.
        logs: how many hoppers.
        samples: of each log.
        dt: between samples [s].
        reach: amplitude of the foot's horizontal distance from the hip [m].
        late: by how many samples the contact sensor is late, at most; at least one if it is late.
        wrong: probability per sample that one to three wrong readings of it begin.

    Raises:
        ValueError: for counts that are not positive.
    """
    count("logs", logs, 1)
    count("samples", samples, 2)
    if not 0.0 <= reach < 0.3:
        raise invalid("reach", reach, "a length from 0 to 0.3 m")
    rest = rng.uniform(0.55, 0.65, logs)
    stiffness = rng.uniform(400.0, 700.0, logs)  # per mass [1/s^2]
    sway, phase = rng.uniform(2.0, 5.0, logs), rng.uniform(0.0, 6.28, logs)
    h = rest + rng.uniform(0.08, 0.22, logs)
    v = rng.uniform(-0.5, 0.5, logs)

    def foot(t: float) -> Array:
        return np.asarray(reach * np.sin(sway * t + phase))

    def push(h: Array, d: Array) -> Array:
        """Return the vertical acceleration by the leg, which pushes only."""
        leg = np.hypot(h, d)
        return np.asarray(stiffness * np.maximum(rest - leg, 0.0) * h / leg)

    heights, velocities = np.zeros((2, samples, logs))
    offsets = np.zeros((samples, logs))
    small = dt / SUBSTEPS
    a = push(h, foot(0.0))
    for i in range(samples):
        heights[i], velocities[i], offsets[i] = h, v, foot(i * dt)
        for k in range(SUBSTEPS):  # velocity Verlet
            half = v + 0.5 * small * (a - GRAVITY)
            h = h + small * half
            a = push(h, foot(i * dt + (k + 1) * small))
            v = half + 0.5 * small * (a - GRAVITY)
    lengths = np.hypot(heights, offsets)
    stances = lengths < rest
    noise, spread = np.array([0.5, 4e-3]), np.array([0.05, 0.3, 0.4])
    result = []
    for j in range(logs):
        bias = spread[2] * rng.normal()
        force = np.diff(velocities[:, j], prepend=velocities[0, j] + dt * GRAVITY) / dt
        force += GRAVITY + bias
        delay = int(rng.integers(1, late + 1)) if late else 0
        flag = np.concatenate((np.zeros(delay, dtype=bool), stances[: samples - delay, j]))
        for begin in np.flatnonzero(rng.random(samples) < wrong):
            flag[begin : begin + int(rng.integers(1, 4))] ^= True
        result.append(
            HopLog(
                force + noise[0] * rng.normal(size=samples),
                np.minimum(lengths[:, j], rest[j]) + noise[1] * rng.normal(size=samples),
                offsets[:, j].copy(),
                flag.astype(float),
                np.array([heights[0, j], velocities[0, j], 0.0])
                + spread * [rng.normal(), rng.normal(), 0.0],
                spread,
                noise,
                float(rest[j]),
                dt,
                heights[:, j].copy(),
                velocities[:, j].copy(),
                stances[:, j].copy(),
            )
        )
    return result


def _model(noise: Array, dt: float) -> tuple[Array, Array, Array]:
    """Return transition (3, 3), effect of the specific force (3,) and its noise (3, 3)."""
    A = np.array([[1.0, dt, -0.5 * dt * dt], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    B = np.array([0.5 * dt * dt, dt, 0.0])
    return A, B, noise[0] ** 2 * np.outer(B, B)


def hop_filter(log: HopLog, contact: str = CONTACT[-1]) -> tuple[Array, Array]:
    """Filter a log with an extended Kalman filter.

    Args:
        log: only its sensors are used.
        contact: when a leg length counts as a measurement of the height, one of `CONTACT`.

    Returns:
        Height and velocity (n, 2) [m, m/s], and their covariance (n, 2, 2).

    Raises:
        ValueError: for an unknown rule.
    """
    rule = CONTACT.index(one_of("contact", contact, CONTACT))
    A, B, Q = _model(log.noise, log.dt)
    x, P = log.start.copy(), np.diag(log.spread**2)
    n = len(log.force)
    states, covariances = np.zeros((n, 2)), np.zeros((n, 2, 2))
    for i in range(n):
        if i:
            x = A @ x + B * (log.force[i] - GRAVITY)
            P = A @ P @ A.T + Q
        touching = rule in (0, 4) or log.contact[i] > 0.5
        if rule > 2:
            # The bias is uncertain as well: its variance adds to that of the noise.
            load = log.force[i] - x[2]
            touching &= bool(load > GATE * np.sqrt(log.noise[0] ** 2 + P[2, 2]))
        if touching:
            leg = float(np.hypot(x[0], log.offset[i]))
            slope = x[0] / leg
            S = slope * slope * P[0, 0] + log.noise[1] ** 2
            innovation = log.length[i] - leg
            if rule < 2 or innovation**2 < GATE**2 * S:
                K = P[:, 0] * slope / S
                x = x + K * innovation
                # Joseph's form stays symmetric and positive.
                J = np.eye(3)
                J[:, 0] -= slope * K
                P = J @ P @ J.T + log.noise[1] ** 2 * np.outer(K, K)
        states[i], covariances[i] = x[:2], P[:2, :2]
    return states, covariances


def hop_bound(log: HopLog) -> Array:
    """Return the Cramer-Rao bound of a filter that is told when the foot touches.

    It is the covariance recursion with the Jacobians at the true trajectory (Tichavsky, Muravchik
    and Nehorai, Posterior Cramer-Rao bounds for discrete-time nonlinear filtering, 1998).

    Args:
        log: with the truth.

    Returns:
        Bound on the covariance of height and velocity (n, 2, 2).
    """
    A, _, Q = _model(log.noise, log.dt)
    P = np.diag(log.spread**2)
    slopes = log.height / np.hypot(log.height, log.offset)
    result = np.zeros((len(slopes), 2, 2))
    for i, slope in enumerate(slopes):
        if i:
            P = A @ P @ A.T + Q
        if log.stance[i]:
            # The information of a reading adds to the inverse of the covariance.
            row = P[:, 0] * slope
            P = P - np.outer(row, row) / (slope * row[0] + log.noise[1] ** 2)
        result[i] = P[:2, :2]
    return result
