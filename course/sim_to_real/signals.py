"""Logs with signals of different kinds, and logs that were recorded under feedback.

Two questions that the output error of `identify` leaves open. Signals with different units and
noise need weights before their residuals may be added (Aitken, 1936). And a controller feeds the
noise of its sensor into the torque, so that the regressor of a least-squares fit depends on the
noise (Soderstrom and Stoica, System Identification, 1989, ch. 10).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, positive, vector
from course.sim_to_real import plants
from course.sim_to_real.identify import Log, Simulate

Array = NDArray[np.float64]


def angles_and_rates(parameters: Mapping[str, Array], log: Log) -> Array:
    """Simulate angles and speeds of flat arms under the torques of a log.

    Args:
        parameters: `identify.BASE` by name, shape (K,) each [kg m^2, N m s/rad].
        log: its commands and its sample time.

    Returns:
        Two angles, then two speeds, shape (4, T + 1, K) [rad, rad/s].
    """
    empty = 0.0 * parameters["a"]
    given = {"torque": 1.0 + empty, **parameters}
    rows = np.array([given.get(name, empty) for name in plants.ROWS])
    run = plants.driven(rows, log.command.T, np.zeros((4, empty.size)), log.dt)
    return np.concatenate([run.measured.swapaxes(1, 2), run.v.swapaxes(1, 2)])


def weighted(simulate: Simulate, log: Log, scale: ArrayLike) -> tuple[Simulate, Log]:
    """Return a simulator and a log whose signals are divided by a scale each.

    `identify.fit` of the two minimises the sum of the squared residuals, each divided by its scale.
    With the standard deviations of the noise as scales that is the fit of maximum likelihood.

    Args:
        simulate: parameters -> simulated signals, (n, T + 1, K).
        log: with n measured signals.
        scale: of each signal, shape (n,), positive [unit of the signal].

    Raises:
        ValueError: for a scale of another shape, or one that is not positive.
    """
    size = vector("scale", scale, (len(log.measured),), low=POSITIVE)

    def scaled(parameters: Mapping[str, Array], some: Log) -> Array:
        return np.asarray(simulate(parameters, some)) / size[:, None, None]

    return scaled, replace(log, measured=log.measured / size[:, None])


def weighted_covariance(slope: Array, noise: ArrayLike, scale: ArrayLike) -> Array:
    """Return the covariance of a weighted fit, to first order in the noise.

    It is (J'WJ)^-1 J'W S W J (J'WJ)^-1 with the weights W = scale^-2 and the variances S = noise^2.
    With scale = noise it is the Cramer-Rao bound (J' S^-1 J)^-1.

    Args:
        slope: d simulated / d parameter, shape (n, T + 1, P) [unit of the signal / parameter].
        noise: standard deviation of each signal's noise, shape (n,) [unit of the signal].
        scale: what the fit divides each signal by, shape (n,) [unit of the signal].

    Returns:
        The covariance, shape (P, P).
    """
    n = len(slope)
    deviation = vector("noise", noise, (n,), low=POSITIVE)
    weight = vector("scale", scale, (n,), low=POSITIVE) ** -2.0
    # One P x P matrix per signal: only the weights differ between them.
    squares = np.einsum("ntp,ntq->npq", slope, slope)
    inverse = np.linalg.inv(np.einsum("n,npq->pq", weight, squares))
    middle = np.einsum("n,npq->pq", (weight * deviation) ** 2, squares)
    return np.asarray(inverse @ middle @ inverse)


@dataclass(frozen=True)
class SpeedLoop:
    """A joint that follows a planned speed: I dv/dt = plan + gain * (reference - measured).

    The planned torque is a sum of two sines, the reference is the speed that it causes, and
    feedback corrects the rest. Torques are held for a sample, so that the speed changes by exactly
    dt * torque / I. With a gain of 0 the loop is open.

    Attributes:
        inertia: of the joint and its load [kg m^2].
        gain: of the feedback [N m s/rad].
        noise: standard deviation of the measured speed, independent in each sample [rad/s].
        disturbance: standard deviation of a torque that is not in the log, likewise [N m].
        dt: sample time [s].

    Raises:
        ValueError: for a gain with which the loop is unstable, and for sizes that are not positive.
    """

    inertia: float = 0.1
    gain: float = 2.0
    noise: float = 0.05
    disturbance: float = 0.0
    dt: float = 2e-3

    def __post_init__(self) -> None:
        positive("inertia", self.inertia, unit="kg m^2")
        positive("dt", self.dt, unit="s")
        finite("noise", self.noise, 0.0, np.inf)
        finite("disturbance", self.disturbance, 0.0, np.inf)
        if not 0.0 <= self.decay < 2.0:
            rule = f"from 0 to below 2 * inertia / dt = {2.0 * self.inertia / self.dt:g}"
            raise invalid("gain", self.gain, rule)

    @property
    def decay(self) -> float:
        """Return the share of a speed error that feedback removes in one sample."""
        return self.gain * self.dt / self.inertia

    def plan(self, samples: int) -> Array:
        """Return the planned torque, shape (samples,) [N m]."""
        t = 2.0 * np.pi * self.dt * np.arange(count("samples", samples, 1))
        return np.asarray(np.sin(1.5 * t) + 0.5 * np.sin(3.5 * t + 1.0))

    def record(self, samples: int, runs: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Record logs from rest.

        Args:
            samples: of each log.
            runs: how many logs.
            rng: of the noise and the disturbance.

        Returns:
            Measured speeds, shape (runs, samples + 1) [rad/s], and the torques that were sent,
            shape (runs, samples) [N m].
        """
        planned = self.plan(samples)
        desired = self.dt / self.inertia * (np.cumsum(planned) - planned)
        error = self.noise * rng.standard_normal((samples + 1, runs))
        push = self.disturbance * rng.standard_normal((samples, runs))
        measured, sent, v = np.empty_like(error), np.empty_like(push), np.zeros(runs)
        for k in range(samples):
            measured[k] = v + error[k]
            sent[k] = planned[k] + self.gain * (desired[k] - measured[k])
            v = v + self.dt / self.inertia * (sent[k] + push[k])
        measured[-1] = v + error[-1]
        return measured.T, sent.T

    def bias(self, samples: int) -> float:
        """Return by how much `regression` is wrong on average in a long log [1/(kg m^2)].

        The measured acceleration has the noise (e[k+1] - e[k]) / dt, and the torque contains
        -gain * e[k]. Their product has the mean gain * noise^2 / dt, and least squares divides it
        by the mean square of the torque: that of the planned torque, plus what the noise adds
        through the loop. White torque disturbances add to the denominator only.
        """
        planned = float(np.mean(self.plan(samples) ** 2))
        shaken = 2.0 * (self.gain * self.noise) ** 2 / (2.0 - self.decay)
        pushed = self.decay * self.disturbance**2 / (2.0 - self.decay)
        return self.gain * self.noise**2 / (self.dt * (planned + shaken + pushed))


def regression(measured: Array, sent: Array, dt: float) -> Array:
    """Return 1 / I by least squares of the differentiated speed on the torque, shape (runs,)."""
    return with_instrument(measured, sent, sent, dt)


def with_instrument(measured: Array, sent: Array, instrument: Array, dt: float) -> Array:
    """Return 1 / I from an instrument: a signal with the torque in it and without the noise.

    It is the sum of instrument times acceleration over the sum of instrument times torque
    (Reiersol, 1941). With the torque itself as the instrument it is least squares.

    Args:
        measured: speeds, shape (runs, T + 1) [rad/s].
        sent: torques, shape (runs, T) [N m].
        instrument: shape (T,) or (runs, T), such as the torque planned beforehand.
        dt: sample time [s].

    Returns:
        1 / I of each log, shape (runs,) [1/(kg m^2)].
    """
    acceleration = np.diff(measured, axis=1) / positive("dt", dt, unit="s")
    return np.asarray(np.sum(instrument * acceleration, 1) / np.sum(instrument * sent, 1))


def speed_output_error(measured: Array, sent: Array, dt: float) -> Array:
    """Return 1 / I by output error: the simulated speed is linear in it, so one step suffices.

    Args:
        measured: speeds, shape (runs, T + 1) [rad/s].
        sent: torques, shape (runs, T) [N m].
        dt: sample time [s].

    Returns:
        1 / I of each log, shape (runs,) [1/(kg m^2)].
    """
    slope = positive("dt", dt, unit="s") * np.cumsum(sent, axis=1)
    return np.asarray(np.sum(slope * measured[:, 1:], 1) / np.sum(slope**2, 1))


def spin(parameters: Mapping[str, Array], log: Log) -> Array:
    """Simulate the speed of a joint from rest: a `Simulate` of "mobility", 1 / I, (1, T + 1, K)."""
    rise = np.concatenate([[0.0], log.dt * np.cumsum(log.command[0])])
    return rise[None, :, None] * parameters["mobility"]
