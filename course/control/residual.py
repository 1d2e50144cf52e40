"""What a model's torques lack, learned from logs: random features instead of equations.

The law is computed torque plus w^T cos(W x / scale + phase), where x holds angles, rates and
accelerations. Only w is fitted, so one linear system is all the training there is (Rahimi and
Recht, 2007). A better law visits other states than those it was fitted on, so it collects again,
and what was collected before is kept (Ross, Gordon and Bagnell, 2011).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, positive, vector
from course.control.joint import Record
from course.control.laws import Arm, like, needed, pd

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Features:
    """F random waves over (q, v, a), scaled, and their weights: (F, 3 n), (F,), (3 n,), (n, F)."""

    W: Array
    phase: Array
    scale: Array
    weights: Array

    def waves(self, x: ArrayLike) -> Array:
        """Return each wave by itself, shape (F,) or (F, K), at inputs (3 n,) or (3 n, K)."""
        return np.asarray(np.cos((np.transpose(x) / self.scale) @ self.W.T + self.phase).T)


@dataclass(frozen=True)
class Learned:
    """Computed torque with a model and a learned residual (None at first), for `track`.

    The gains kp and kd stand before the inertia [1/s^2, 1/s].
    """

    model: Arm
    kp: ArrayLike
    kd: ArrayLike
    extra: Features | None = None

    def __call__(
        self, q: ArrayLike, v: ArrayLike, q_ref: ArrayLike, v_ref: ArrayLike, a_ref: ArrayLike
    ) -> Array:
        """Return torques, shape of q [N m]."""
        desired = pd(q, v, q_ref, v_ref, self.kp, self.kd)
        a = desired + like("a_ref", a_ref, desired)
        tau, more = needed(self.model, q, v, a), self.extra
        return tau if more is None else tau + more.weights @ more.waves(np.concatenate([q, v, a]))


def lacking(model: Arm, log: Record) -> tuple[Array, Array]:
    """Return a run's inputs (3 n, K) and the torques (n, K) that the model doesn't explain.

    Means and differences over a sample stand for its middle, which is of second order in the
    sample time. Samples after a run diverged are left out.
    """
    q, v = (0.5 * (x[:, 1:] + x[:, :-1]) for x in (log.q, log.v))
    a = np.diff(log.v) / np.diff(log.times)
    whole = np.isfinite(q + v + a).all(axis=0)
    q, v, a, sent = (x[:, whole] for x in (q, v, a, log.command))
    return np.concatenate([q, v, a]), sent - needed(model, q, v, a)


def fit(
    x: ArrayLike,
    torque: ArrayLike,
    rng: np.random.Generator,
    *,
    features: int = 200,
    width: float = 0.15,
    ridge: float = 1e-6,
) -> Features:
    """Fit the weights of random waves by least squares.

    Args:
        x: inputs, shape (3 n, K).
        torque: the desired outputs, shape (n, K) [N m].
        rng: who draws the waves.
        features: how many.
        width: of their wave numbers, over one deviation of the inputs.
        ridge: price of the weights, as a share of the number of samples.

    Raises:
        ValueError: for an input that does not vary, shapes that disagree, NaN.
    """
    x = vector("x", x, (None, None))
    torque = vector("torque", torque, (None, x.shape[1]))
    F, scale = count("features", features, 1), x.std(axis=1)
    # Random Fourier features (Rahimi and Recht, 2007).
    if not (scale > 0.0).all():
        raise invalid("x.std(axis=1)", scale, "inputs that all vary")
    # Normal wave numbers with uniform phases approximate a Gaussian kernel.
    W = positive("width", width) * rng.standard_normal((F, len(x)))
    result = Features(W, rng.uniform(0.0, 2.0 * np.pi, F), scale, np.zeros((len(torque), F)))
    Z = result.waves(x)
    # Ridge regression by its normal equations.
    normal = Z @ Z.T + positive("ridge", ridge) * x.shape[1] * np.eye(F)
    return replace(result, weights=np.linalg.solve(normal, Z @ torque.T).T)


def learn(
    law: Learned,
    collect: Callable[[Learned], Record],
    rng: np.random.Generator,
    rounds: int = 5,
    **settings: Any,
) -> list[Learned]:
    """Learn in rounds; return the law after each, the first being the one that was handed in.

    A round runs the last law by `collect`, as with `track`, and fits to all runs so far; `rng` and
    `settings` are those of `fit`.
    """
    laws, observed = [law], []
    for _ in range(count("rounds", rounds, 1)):
        # DAgger for models: each round adds data of the motion that the last law makes.
        observed.append(lacking(law.model, collect(laws[-1])))
        x, torque = (np.concatenate(parts, axis=1) for parts in zip(*observed, strict=True))
        laws.append(replace(law, extra=fit(x, torque, rng, **settings)))
    return laws
