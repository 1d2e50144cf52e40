"""Policies that draw: denoising diffusion and flow matching on actions or chunks of them.

Both start from normal noise at time 0 and end at an action at time 1. Between them a sample is
a(t) clean + s(t) noise. A network is fitted to a mean given such a sample, from which follows the
clean action for diffusion and the velocity clean - noise for the flow. For Gaussian mixtures these
means are known, so that a sampler is tried without any training.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from course.check import count, finite, invalid, one_of, vector
from course.learning.clone import Policy, fitted, normals, prepared
from course.learning.network import network, predict, tensor
from course.learning.tasks import Array
from course.libraries import pytorch

Field = Callable[[Array, float], Array]

# Runge and Kutta's explicit methods: rows of the stages, and the weights at the end.
TABLEAUS: dict[str, tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]] = {
    "euler": ((), (1.0,)),
    "heun": (((1.0,),), (0.5, 0.5)),
    "rk4": (((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}
SOLVERS = (*TABLEAUS, "ddim", "ddpm")


def integrate(field: Field, noise: ArrayLike, steps: int, solver: str = "heun") -> Array:
    """Follow a velocity from time 0 to 1 in equal steps.

    One Euler step ends at noise + field(noise, 0). Suppose that noise and data were paired at
    random and joined by straight paths at constant speed. Then flow matching fits the field to the
    mean of clean - noise given the sample, which at time 0 is the noise itself and says nothing of
    the clean action: field(noise, 0) = mean - noise, and the step ends at the mean.

    Args:
        field: samples (n, d), time -> velocities (n, d).
        noise: samples at time 0, (n, d).
        steps: equal ones; each asks the field once for every stage of the solver.
        solver: "euler", "heun" or "rk4".
    """
    rows, ends = TABLEAUS[one_of("solver", solver, TABLEAUS)]
    x, h = vector("noise", noise, (None, None)), 1.0 / count("steps", steps, 1)
    for k in range(steps):
        slopes = [field(x, k * h)]
        # Stages of an explicit Runge-Kutta method; the time of a stage is the sum of its row.
        for row in rows:
            at = x + h * sum(w * slope for w, slope in zip(row, slopes, strict=True))
            slopes.append(field(at, (k + sum(row)) * h))
        x = x + h * sum(w * slope for w, slope in zip(ends, slopes, strict=True))
    return x


@register_jitable
def mix(time: Array | float) -> tuple[Any, Any]:
    """Return the diffusion's signal and noise scales a and s, with a^2 + s^2 = 1.

    The schedule follows the cosine of Nichol and Dhariwal (2021).
    """
    angle = 0.5 * np.pi * time
    return np.sin(angle), np.cos(angle)


@register_jitable
def ddim_step(
    x: Array, clean: Array, before: tuple[float, float], after: tuple[float, float], fresh: float
) -> Array:
    """Return samples one step of a diffusion later, without the fresh noise (DDIM, eq. 12).

    Args:
        x: samples (n, d).
        clean: the predicted clean samples (n, d).
        before: scales a and s of the samples, as of `mix`.
        after: the same one step later; s is 0 after the last step.
        fresh: deviation of the noise that the caller adds, 0 for DDIM.
    """
    # The noise that goes with the prediction follows from x; then both are mixed again in the
    # proportions of the next time.
    implied = (x - before[0] * clean) / before[1]
    return after[0] * clean + math.sqrt(after[1] ** 2 - fresh**2) * implied


def denoise(
    clean: Field, noise: ArrayLike, steps: int, rng: np.random.Generator, eta: float = 0.0
) -> Array:
    """Take a diffusion back from time 0 to 1 (Song, Meng and Ermon, DDIM, 2021, eq. 12 and 16).

    Args:
        clean: samples (n, d), time -> means of the clean action (n, d). The noise follows from it;
            the other way round one divides by a, which is 0 at the start.
        noise: samples at time 0, (n, d).
        steps: calls of `clean`. With a single one the answer is the mean, as of a flow.
        eta: 0 for DDIM, where only the start is drawn; 1 for the ancestral sampling of DDPM (Ho,
            Jain and Abbeel, 2020), which draws at each step but the last.
        rng: source of the noise that is drawn while denoising.
    """
    x = vector("noise", noise, (None, None))
    eta = finite("eta", eta, 0.0, 1.0)
    alpha, sigma = mix(np.linspace(0.0, 1.0, count("steps", steps, 1) + 1))
    # No noise is left at the end of the last step.
    sigma[-1] = 0.0
    for k in range(steps):
        # DDPM's share of fresh noise (DDIM, eq. 16); with eta = 0 the step is deterministic.
        fresh = eta * sigma[k + 1] / sigma[k] * math.sqrt(1.0 - (alpha[k] / alpha[k + 1]) ** 2)
        # `clean` returns the guess of the clean action; the noise follows from it.
        before, after = (alpha[k], sigma[k]), (alpha[k + 1], sigma[k + 1])
        x = ddim_step(x, clean(x, k / steps), before, after, fresh)
        if fresh:
            x = x + fresh * rng.standard_normal(x.shape)
    return x


@register_jitable
def posterior_means(
    weights: Array, means: Array, deviations: Array, x: Array, a: float, s: float
) -> tuple[Array, Array]:
    """Return the means of clean and noise given x = a clean + s noise, for a mixture of normals.

    Args:
        weights: of the m components, shape (m,).
        means: shape (m, d).
        deviations: standard deviation of each component in all directions, shape (m,).
        x: samples, shape (n, d).
        a: scale of the clean sample.
        s: scale of the noise; not zero together with a.

    Returns:
        Both means, each of shape (n, d).
    """
    m, (n, d) = len(weights), x.shape
    width = (a * deviations) ** 2 + s**2  # variance of x in each component
    # Posterior of the component given x, by log-weights; then the linear-Gaussian mean in each.
    logs = np.empty((m, n))
    for k in range(m):
        away = x - a * means[k]
        logs[k] = np.log(weights[k] + 1e-300) - 0.5 * (
            np.sum(away * away, axis=1) / width[k] + d * np.log(width[k])
        )
    # Softmax over the components, with the largest logarithm subtracted against overflow.
    largest = logs[0].copy()
    for k in range(1, m):
        largest = np.maximum(largest, logs[k])
    shares = np.exp(logs - largest)
    shares = shares / np.sum(shares, axis=0)
    clean, noise = np.zeros((n, d)), np.zeros((n, d))
    for k in range(m):
        away = x - a * means[k]
        share = shares[k].copy().reshape(n, 1)
        # Given a component, clean and noise share the deviation by their parts of its variance.
        clean += share * (means[k] + a * deviations[k] ** 2 / width[k] * away)
        noise += share * away * (s / width[k])
    return clean, noise


@dataclass(frozen=True)
class Mixture:
    """Normal distributions with weights, whose fields are known.

    Attributes:
        weights: of m parts, positive, of sum 1, shape (m,).
        means: shape (m, d).
        deviations: of each part, the same in all directions, shape (m,).
    """

    weights: Array
    means: Array
    deviations: Array

    def __post_init__(self) -> None:
        m = len(vector("means", self.means, (None, None)))
        vector("deviations", self.deviations, (m,), low=0.0)
        if abs(vector("weights", self.weights, (m,), low=0.0).sum() - 1.0) > 1e-9:
            raise invalid("sum of weights", self.weights.sum(), "1")

    def draw(self, number: int, rng: np.random.Generator) -> Array:
        """Return samples, shape (number, d)."""
        part = rng.choice(len(self.weights), number, p=self.weights)
        spread = self.deviations[part, None] * rng.standard_normal((number, self.means.shape[1]))
        return self.means[part] + spread

    def expect(self, x: Array, a: float, s: float) -> tuple[Array, Array]:
        """Return the means of clean and noise given x = a clean + s noise, both (n, d) as x.

        The scales a and s must not both be 0.
        """
        return posterior_means(self.weights, self.means, self.deviations, x, a, s)

    def velocity(self, x: Array, time: float) -> Array:
        """Return the exact field of flow matching on the straight way, a = t, s = 1 - t."""
        clean, noise = self.expect(x, time, 1.0 - time)
        return clean - noise

    def clean(self, x: Array, time: float) -> Array:
        """Return the exact mean of the clean sample for `denoise`."""
        a, s = mix(time)
        return self.expect(x, float(a), float(s))[0]


# --- policies -------------------------------------------------------------------------------------


@dataclass
class Drawn(Policy):
    """A policy that draws its actions; `replace(policy, steps=..., solver=...)` changes how.

    Attributes:
        solver: "euler", "heun" or "rk4" of a flow, "ddim" or "ddpm" of a diffusion.
        steps: of the solver.
    """

    solver: str = "euler"
    steps: int = 10

    def __call__(self, states: ArrayLike, rng: np.random.Generator) -> Array:
        """Return actions for states (N, d), shape (N, *shape)."""
        rows = self.inputs(states)
        field = partial(self.draw, rows)
        noise = rng.standard_normal((len(rows), math.prod(self.shape)))
        if self.solver in TABLEAUS:
            drawn = integrate(field, noise, self.steps, self.solver)
        else:
            drawn = denoise(field, noise, self.steps, rng, float(self.solver == "ddpm"))
        return self.done.undo(drawn).reshape(len(drawn), *self.shape)


def _generative(
    states: ArrayLike,
    actions: ArrayLike,
    seed: int,
    flow: bool,
    width: int,
    solver: str,
    sampled: int,
    how: dict[str, Any],
) -> Drawn:
    blank, x, y = prepared(states, actions)
    torch, size = pytorch(), y.shape[1]
    net = network((x.shape[1] + size + 5, width, width, size), seed, activation="silu", last=0.1)
    inputs, desired, randn = tensor(x), tensor(y), normals(seed)

    def mean(sample: Any, time: Any, rows: Any) -> Any:
        """Return the answer for normal data, which is known, and what the network adds to it."""
        # The clock as sines and cosines, and a skip connection: the network learns the rest only.
        turn = 2.0 * math.pi * time
        clock = (time, turn.sin(), turn.cos(), (2.0 * turn).sin(), (2.0 * turn).cos())
        # For normal data of variance 1 the mean velocity is this factor times the sample; the mean
        # of a diffusion's target is 0.
        skip = (2.0 * time - 1.0) / ((1.0 - time) ** 2 + time**2) if flow else 0.0
        return skip * sample + net(torch.cat((sample, *clock, rows), 1))

    def loss(pick: Any) -> Any:
        clean = desired[pick]
        noise = randn(clean.shape)
        # Uniform times in (0, 1): normal numbers through their own distribution function.
        time = torch.special.ndtr(randn((len(clean), 1)))  # even in (0, 1)
        a, s = (time, 1.0 - time) if flow else ((w := 0.5 * math.pi * time).sin(), w.cos())
        # The target: velocity of the straight path, or the velocity form of the diffusion
        # (v-prediction).
        rate = clean - noise if flow else s * clean - a * noise
        return (mean(a * clean + s * noise, time, inputs[pick]) - rate).square().mean()

    def draw(rows: Array, sample: Array, time: float) -> Array:
        clock = torch.full((len(rows), 1), time)
        rate = predict(lambda given: mean(given, clock, tensor(rows)), sample)
        a, s = mix(time)
        # With x = a clean + s noise and v = s clean - a noise, clean is a x + s v.
        return rate if flow else a * sample + s * rate

    parts = blank.inputs, blank.done, blank.shape
    one_of("solver", solver, SOLVERS[:3] if flow else SOLVERS[3:])
    policy = Drawn(*parts, draw, solver=solver, steps=count("sampled", sampled, 1))
    fitted(policy, net, loss, len(x), seed=seed, **how)
    return policy


def flow_policy(
    states: ArrayLike,
    actions: ArrayLike,
    seed: int,
    *,
    width: int = 128,
    solver: str = "euler",
    sampled: int = 10,
    **how: Any,
) -> Drawn:
    """Return flow matching on straight ways (Lipman et al., 2023; Liu, Gong and Liu, 2023).

    The network is fitted by squared error to clean - noise at an even time between both. It adds to
    the field of a normal distribution, so that what is only noise needs not be learned.

    Args:
        states: shape (n, d).
        actions: shape (n, a), or chunks (n, H, a).
        seed: of weights, noise and batches.
        width: of the two hidden layers.
        solver: how actions are integrated: "euler", "heun" or "rk4".
        sampled: steps of that solver.
        how: `steps`, `batch`, `rate` and `clip` of `fit`.
    """
    return _generative(states, actions, seed, True, width, solver, sampled, how)


def diffusion_policy(
    states: ArrayLike,
    actions: ArrayLike,
    seed: int,
    *,
    width: int = 128,
    solver: str = "ddim",
    sampled: int = 10,
    **how: Any,
) -> Drawn:
    """Return denoising diffusion of actions (Chi et al., Diffusion policy, 2023).

    The network is fitted by squared error to s clean - a noise (Salimans and Ho, 2022), from which
    clean = a sample + s network. What is off in it counts s times, nothing at the end; fitted to
    the clean action it counts at each of many last steps, fitted to the noise it is divided by 0
    at the start.
    Arguments as of `flow_policy`; the solver is "ddim" or "ddpm".
    """
    return _generative(states, actions, seed, False, width, solver, sampled, how)
