"""Inertia and damping by output error: without noise first, then with it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import Case, judge_of
from drills.exercise import Exercise, slips, value_slips

Array = NDArray[np.float64]


def _moved(inertia: float, damping: float, tau: Array, dt: float, q: float, v: float) -> Array:
    """Return angles at the samples, by the classical Runge-Kutta method in two steps a sample."""
    angles, h = np.zeros(len(tau)), dt / 2.0
    for i, torque in enumerate(tau.tolist()):
        angles[i] = q
        for _ in range(2):
            z = -damping * h / inertia
            a = (torque - damping * v) / inertia
            q += h * v + h * h * a * (0.5 + z / 6.0 + z * z / 24.0)
            v += h * a * (1.0 + z / 2.0 + z * z / 6.0 + z**3 / 24.0)
    return angles


def cases(rng: np.random.Generator) -> list[Case]:
    """Return joints under two sines of torque, from rest and moving."""

    def log(
        label: str,
        level: str = "core",
        *,
        noise: float = 1e-3,
        rate: float = 0.0,
        dt: float = 0.01,
        n: int = 200,
    ) -> Case:
        inertia = float(rng.uniform(0.1, 0.4))
        damping = inertia * float(rng.uniform(1.0, 4.0))
        t = dt * np.arange(n)
        tau = np.zeros(n)
        for w in (3.0, 9.0):
            amplitude = inertia * float(rng.uniform(10.0, 20.0))
            tau += amplitude * np.sin(w * t + rng.uniform(0.0, 6.0))
        q = float(rng.uniform(-1.0, 1.0))
        angles = _moved(inertia, damping, tau, dt, q, rate) + noise * rng.normal(size=n)
        factor = np.exp(rng.uniform(-0.6, 0.6, 2))
        guess = factor * [inertia, damping]
        return Case((angles, tau, dt, np.array([q, rate]), guess), label, level)

    return [
        log("from rest, no noise", "simple", noise=0.0),
        log("moving at the start, no noise", "simple", noise=0.0, rate=0.8),
        *(log("from rest") for _ in range(2)),
        *(log("moving at the start", rate=v) for v in (0.6, -1.0)),
        log("samples of 20 ms", "edge", dt=0.02),
        log("samples of 5 ms", "edge", dt=5e-3, n=400),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-4 of the smaller parameter."""
    return 1e-4 * float(truth[0].min())


_RETURN = "first + np.concatenate(([0.0], np.cumsum(moved[:-1])))"
_MOVED = "moved = final * dt + (rate - final) * time * (1.0 - decay)"

SLIPS = slips(
    sensor_one_step_late=(
        _RETURN,
        "first + np.cumsum(moved)",
        "The simulated angle is recorded after the torque of its sample has acted: one step late. "
        "The fit then has wrong parameters and a larger residual.",
    ),
    residual_sign=(
        "residual = measured - angles",
        "residual = angles - measured",
        "The residual has the wrong sign for this step: each one leads away from the fit.",
    ),
    difference_too_coarse=(
        "small = np.log(np.asarray(guess, dtype=float)), 1e-6",
        "small = np.log(np.asarray(guess, dtype=float)), 1.0",
        "The parameters are changed by so much for the differences that these are no derivatives: "
        "with noise the fit stops beside the smallest sum.",
    ),
    start_not_at_rest=(
        "rate = speed * powers",
        "rate = 0.0 * powers",
        "The simulation starts at rest. The joint was moving when the log began.",
    ),
    start_at_zero=(
        _RETURN,
        _RETURN.replace("first", "0.0"),
        "The simulation starts at angle 0, the joint did not.",
    ),
    one_step_only=(
        "range(15)",
        "range(1)",
        "One step of Gauss-Newton is not enough: go on until the parameters stay.",
    ),
    damping_forgotten=(
        "changes = small * np.eye(2)",
        "changes = np.diag([small, 0.0])",
        "The damping is never changed, so it stays the guess.",
    ),
    logarithms_returned=(
        "return np.exp(logs)",
        "return logs",
        "These are the logarithms of the parameters.",
    ),
    euler_steps=(
        "decay = np.exp(-dt / time)",
        "decay = 1.0 - dt / time",
        _MOVED,
        "moved = rate * dt",
        "The simulation takes explicit Euler steps of a whole sample: at 10 ms that is an error "
        "of its own, and the parameters make up for it.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a smallest sum is found to better than this"),
    examples=(  # without noise: 0.5 kg m^2 and 1 N m s/rad from rest, then 0.2 and 0.4, moving
        "output_error(np.arange(60) / 50 + np.expm1(-np.arange(60) / 25) / 2, np.ones(60), 0.02, "
        "[0.0, 0.0], [0.6, 1.5])",
        "output_error(-np.arange(60) / 50 - 1.5 * np.expm1(-np.arange(60) / 25), "
        "np.full(60, -0.4), 0.02, [0.0, 2.0], [0.3, 0.3])",
    ),
    slips=SLIPS + value_slips("output_error", whole=False),
)
