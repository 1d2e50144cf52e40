"""The step of an adaptive law, the cures against its drift, and the law on one joint.

The estimate moves by rate Y^T s. Sampled, that has a limit, which is computed here. The noise in Y
is correlated with that in s, so an estimate that nothing excites drifts. Four cures are in use: a
dead zone, projection, leakage and normalisation (Ioannou and Sun, Robust Adaptive Control, 1996,
chapter 8). The law is that of Slotine and Li (1987), for a joint of inertia, damping and load.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, positive, vector
from course.control.joint import Joint
from course.control.sampled import held, joint_system

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cures:
    """What keeps an estimate from running away; by default nothing does.

    Attributes:
        dead_zone: size of s up to which the estimate rests, in the unit of s.
        low: smallest estimates (projection), a number or one for each parameter.
        high: largest estimates, likewise.
        leakage: rate at which the estimate returns to `nominal` [1/s].
        nominal: where it returns to, a number or one for each parameter.
        normalisation: n in the step divided by 1 + n |Y|^2; 0 for none.
    """

    dead_zone: float = 0.0
    low: ArrayLike = -np.inf
    high: ArrayLike = np.inf
    leakage: float = 0.0
    nominal: ArrayLike = 0.0
    normalisation: float = 0.0

    def __post_init__(self) -> None:
        for name in ("dead_zone", "leakage", "normalisation"):
            finite(name, getattr(self, name), 0.0)
        if not (np.asarray(self.low) <= np.asarray(self.high)).all():
            raise invalid("low", self.low, f"at most high = {self.high}")


def adapted(
    estimate: Array, Y: Array, s: Array, rate: ArrayLike, dt: float, cures: Cures | None = None
) -> Array:
    """Return the estimate after one sample: an Euler step of rate Y^T s, with its cures.

    Args:
        estimate: shape (p,) or (p, N).
        Y: regressor, shape (n, p) or (n, p, N).
        s: sliding variable, shape (n,) or (n, N).
        rate: of adaptation, a number or shape (p,), or (p, 1) with N.
        dt: sample time [s].
        cures: see `Cures`.
    """
    cures = cures or Cures()
    change = rate * np.einsum("np...,n...->p...", Y, s)
    if cures.normalisation:
        change = change / (1.0 + cures.normalisation * np.sum(Y**2, axis=(0, 1)))
    if cures.dead_zone:
        change = np.where(np.sqrt(np.sum(s**2, axis=0)) > cures.dead_zone, change, 0.0)
    if cures.leakage:
        change = change - cures.leakage * (estimate - _column(cures.nominal, estimate))
    low, high = _column(cures.low, estimate), _column(cures.high, estimate)
    return guarded(estimate, change, dt, low, high)


def guarded(estimate: Array, change: Array, dt: float, low: ArrayLike, high: ArrayLike) -> Array:
    """Return the estimate after an Euler step, projected onto the box from low to high."""
    return np.asarray(np.clip(estimate + dt * change, low, high))


def _column(value: ArrayLike, like: Array) -> Array:
    """Return one number a parameter in a shape that fits a batch."""
    array = np.asarray(value, dtype=float)
    return array[:, None] if array.ndim == 1 and like.ndim == 2 else array


def adaptation_limit(damping: float, friction: float, dt: float) -> float:
    """Return the largest stable rate |Y|^2 of adaptation for a rate loop with a constant regressor.

    One sample maps s and the error of Y times the estimate by a 2 x 2 matrix. Jury's condition on
    its determinant gives rate |Y|^2 dt = damping + friction, exactly, for any inertia for which the
    damping torque alone is stable.

    Args:
        damping: gain of s [N m s/rad].
        friction: viscous friction of the joint [N m s/rad].
        dt: sample time [s].
    """
    return (positive("damping", damping) + finite("friction", friction, 0.0)) / positive("dt", dt)


def adaptation_matrix(joint: Joint, damping: float, product: float, dt: float) -> Array:
    """Return the matrix of one sample of (s, error of the estimated torque), shape (2, 2).

    Args:
        joint: its inertia and damping count.
        damping: gain of s [N m s/rad].
        product: rate |Y|^2.
        dt: sample time [s].
    """
    plant = held(*joint_system(joint.inertia, joint.damping), dt)
    decay, push = plant.transition[1, 1], plant.now[1]
    return np.array([[decay - push * damping, -push], [dt * product, 1.0]])


@dataclass(frozen=True)
class JointAdaptive:
    """Slotine and Li's law for one joint with unknown inertia, damping and load.

    Attributes:
        slope: decay rate of the error once s is 0 [1/s].
        damping: gain of s [N m s/rad].
        rate: of adaptation, a number or one each for inertia, damping and load torque.
        cures: against drift.
    """

    slope: float
    damping: float
    rate: ArrayLike
    cures: Cures = Cures()

    def __post_init__(self) -> None:
        positive("slope", self.slope, unit="1/s")
        positive("damping", self.damping, unit="N m s/rad")
        vector("rate", self.rate, (), (3,), low=POSITIVE)


class Run(NamedTuple):
    """Errors q_d - q, shape (n, N) [rad], and estimates, shape (n, 3, N), at the samples."""

    error: Array
    estimate: Array


def run_adaptive(
    joint: Joint,
    law: JointAdaptive,
    reference: Array,
    dt: float,
    *,
    estimate: ArrayLike = (0.0, 0.0, 0.0),
    noise: float = 0.0,
    seeds: int = 1,
    start: float = 0.0,
) -> Run:
    """Run the law on a joint from many seeds of its encoder noise at once.

    The rate is the difference of two noisy angles. The torque is held, and the joint moves exactly.
    A run that diverges is NaN from then on.

    Args:
        joint: as it is; dry friction is not modelled here.
        law: the controller.
        reference: rows q_d, v_d, a_d at the samples, shape (3, n).
        dt: sample time [s].
        estimate: at the start, of inertia, damping and the torque against the load, shape (3,).
        noise: standard deviation of the angle [rad].
        seeds: number of runs N; run i has the seed i.
        start: angle error at the start [rad].
    """
    reference = vector("reference", reference, (3, None))
    n, size = reference.shape[1], count("seeds", seeds, 1)
    if joint.coulomb:
        raise invalid("joint.coulomb", joint.coulomb, "0")
    plant = held(*joint_system(joint.inertia, joint.damping), dt)
    blur = np.zeros((n + 1, size))
    if finite("noise", noise, 0.0, unit="rad"):
        for i in range(size):
            blur[:, i] = noise * np.random.default_rng(i).standard_normal(n + 1)
    q, v = np.full(size, reference[0, 0] - start), np.full(size, reference[1, 0])
    theta = np.tile(np.array(vector("estimate", estimate, (3,)))[:, None], (1, size))
    rate = np.asarray(law.rate, dtype=float).reshape(-1, 1)
    errors, estimates = np.full((n, size), np.nan), np.full((n, 3, size), np.nan)
    # The angle one sample before the start, as the joint moved at the reference's speed.
    last = q - dt * v + blur[-1]
    ones = np.ones(size)
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(n):
            q_d, v_d, a_d = reference[:, k]
            errors[k], estimates[k] = q_d - q, theta
            if not np.isfinite(q).any():
                break
            reading = q + blur[k]
            speed, last = (reading - last) / dt, reading
            e, de = q_d - reading, v_d - speed
            s = de + law.slope * e
            # Y of (inertia, damping, load): reference acceleration, reference speed, one.
            Y = np.stack([a_d + law.slope * de, v_d + law.slope * e, ones])[None]
            torque = np.einsum("p...,p...->...", Y[0], theta) + law.damping * s
            theta = adapted(theta, Y, s[None], rate, dt, law.cures)
            total = torque + joint.load
            q, v = (
                q + plant.transition[0, 1] * v + plant.now[0] * total,
                plant.transition[1, 1] * v + plant.now[1] * total,
            )
    return Run(errors, estimates)


def drift_rate(rate: float, slope: float, noise: float, dt: float) -> float:
    """Return the speed at which noise alone drives the estimate of the inertia at rest.

    The measured rate is in the regressor and in s with the same noise, so the mean of their product
    is slope times its variance, 2 noise^2 / dt^2 for a difference of two angles, and some more for
    the noise of the angle itself.

    Args:
        rate: of adaptation of the inertia.
        slope: see `JointAdaptive` [1/s].
        noise: standard deviation of the angle [rad].
        dt: sample time [s].

    Returns:
        Change of the estimate [kg m^2/s] as long as the loop does not feel it.
    """
    variance = 2.0 * finite("noise", noise, 0.0) ** 2 / positive("dt", dt) ** 2
    # e and the rate share one angle: their covariance is noise^2 / dt.
    shared = slope * noise**2 / dt
    return positive("rate", rate) * positive("slope", slope) * (variance + shared)
