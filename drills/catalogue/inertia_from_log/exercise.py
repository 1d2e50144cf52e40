"""Inertia from a log: without noise first, where other ways still work, then with it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import Answer, Case, judge_of, largest_error
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]
SAMPLES = 1200
NOISELESS = "no noise"


def _swung(
    inertia: float, friction: float, weight: float, q: float, v: float, tau: Array, dt: float
) -> Array:
    """Return angles at the samples under a held torque, by the classical Runge-Kutta method."""
    angles = np.zeros(len(tau))
    for i, pushed in enumerate(tau.tolist()):
        angles[i] = q

        def rate(q: float, v: float, pushed: float = pushed) -> float:
            return (pushed - friction * v - weight * math.cos(q)) / inertia

        a = rate(q, v)
        v2 = v + 0.5 * dt * a
        b = rate(q + 0.5 * dt * v, v2)
        v3 = v + 0.5 * dt * b
        c = rate(q + 0.5 * dt * v2, v3)
        v4 = v + dt * c
        d = rate(q + dt * v3, v4)
        q += dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
        v += dt / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return angles


def cases(rng: np.random.Generator) -> list[Case]:
    """Return joints with and without friction and weight.

    They start from rest and moving, with noise of 0 to 0.1 mrad.
    """

    def log(
        label: str,
        level: str = "core",
        *,
        noise: float = 5e-5,
        friction: float = 1.0,
        weight: float = 1.0,
        start: float = 0.0,
        dt: float = 2e-3,
        whole: bool = False,
        samples: int = SAMPLES,
    ) -> Case:
        """Return sines of three frequencies as a torque.

        Friction and weight are factors of usual ones.
        """
        inertia = float(rng.uniform(0.1, 1.0))
        b, w = friction * rng.uniform(1.0, 3.0) * inertia, weight * rng.uniform(4.0, 10.0) * inertia
        t, q = dt * np.arange(samples), float(rng.uniform(-0.5, 0.5))
        sines = [
            a * np.sin(f * t + p)
            for a, f, p in zip(
                rng.uniform(8.0, 16.0, 3), (2.5, 6.0, 13.0), rng.uniform(0.0, 6.0, 3), strict=True
            )
        ]
        tau = inertia * np.sum(sines, axis=0) + 0.7 * w
        if whole:
            tau = np.round(tau).astype(int)
        angles = _swung(inertia, b, w, q, start, np.asarray(tau, dtype=float), dt)
        return Case((angles + noise * rng.normal(size=samples), tau, dt), label, level)

    return [
        log("inertia alone, from rest, no noise", "simple", noise=0.0, friction=0.0, weight=0.0),
        log("inertia and friction, no noise", "simple", noise=0.0, weight=0.0),
        log("inertia and weight, no noise", "simple", noise=0.0, friction=0.0),
        log("moving at the start, no noise", noise=0.0, start=2.0),
        log("inertia alone, from rest", friction=0.0, weight=0.0),
        log("inertia alone, moving at the start", friction=0.0, weight=0.0, start=-2.0),
        *(log("from rest", noise=level) for level in (2e-5, 5e-5, 1e-4)),
        *(log("moving at the start", start=start) for start in (1.5, -2.5)),
        log("much friction", friction=3.0),
        log("a heavy link", weight=2.0),
        log("samples of 1 ms", "edge", dt=1e-3, samples=2400),
        log("samples of 5 ms", "edge", dt=5e-3),
        log("a torque of whole numbers, no noise", "edge", whole=True, noise=0.0, weight=3.0),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-3 of the inertia, 1e-4 without noise."""
    return (1e-4 if case.label.endswith(NOISELESS) else 1e-3) * float(truth[0])


def explain(answers: Sequence[Answer]) -> str:
    """Return too small with noise, and near without it: the mark of differences."""
    clean = [a for a in answers if a.case.label.endswith(NOISELESS)]
    noisy = [a for a in answers if not a.case.label.endswith(NOISELESS)]
    share = [largest_error(a.parts[0], 0.0) / float(a.truth[0]) for a in noisy]
    near = [largest_error(a.parts[0], a.truth[0]) < 0.02 * float(a.truth[0]) for a in clean]
    small = bool(share) and max(share) < 0.998 and float(np.median(share)) < 0.6
    return "differentiated" if small and near and all(near) else ""


def left_over(figure: Any, shown: Shown) -> None:
    """Plot what the equation, integrated twice, leaves over with each inertia, the rest fitted."""
    axes = picture.plane(figure, "time [s]", "left over of the torque's integral [N m s^2]")
    q, tau, dt = shown.args

    def integral(y: Array) -> Array:
        return np.asarray(dt * (np.cumsum(y) - 0.5 * (y + y[0])))

    t, one = dt * np.arange(len(q)), np.ones(len(q))
    rest = np.column_stack((integral(q), integral(integral(np.cos(q))), t, one))
    pushed = integral(dt * (np.cumsum(tau) - tau))
    for (inertia,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        remaining = pushed - float(inertia) * q
        axes.plot(t, remaining - rest @ np.linalg.lstsq(rest, remaining, rcond=None)[0], **style)
    axes.legend()


def one_log(attempt: Attempt, drawn: Sequence[Case]) -> None:
    """Time the identification from one log."""
    attempt.time_call(*drawn[0].args, what="time per log")


_COLUMNS = "columns = (q, integral(q), integral(integral(np.cos(q))), t, np.ones(q.size))"
_FOUND = "fitted = np.linalg.lstsq(np.column_stack(columns), integral(pushed), rcond=None)[0]"
_PUSHED = "pushed = np.concatenate(([0.0], np.cumsum(dt * tau[:-1])))"
_RETURN = "return float(fitted[0])"

SLIPS = slips(
    differentiated=(
        _COLUMNS,
        "rate = np.gradient(q, dt)\n    columns = (np.gradient(rate, dt), rate, np.cos(q))",
        _FOUND,
        _FOUND.replace("integral(pushed)", "tau"),
        "The log is differentiated twice. Without noise that is nearly right. With noise the "
        "acceleration is mostly noise, and the fit finds far too little inertia.",
    ),
    friction_left_out=(
        _COLUMNS,
        _COLUMNS.replace("integral(q), ", "", 1),
        "Friction is missing in the fit. Where there is friction, the fit attributes it to "
        "the inertia.",
    ),
    weight_left_out=(
        _COLUMNS,
        _COLUMNS.replace("integral(integral(np.cos(q))), ", ""),
        "The weight is missing in the fit. Where there is one, the fit attributes it to the "
        "inertia.",
    ),
    start_rate_forgotten=(
        _COLUMNS,
        _COLUMNS.replace(", t, np", ", np"),
        "The initial rate is assumed to be zero. Integrating twice leaves v0 t with an "
        "unknown v0: add a column for it. (Friction adds to the same column.)",
    ),
    start_angle_forgotten=(
        _COLUMNS,
        _COLUMNS.replace(", np.ones(q.size)", ""),
        "The initial angle is missing: the double integral gives q - q0. Add a column for "
        "the constant.",
    ),
    both_constants_forgotten=(
        _COLUMNS,
        _COLUMNS.replace(", t, np.ones(q.size)", ""),
        "Both constants of the double integral are missing: the angle and the rate at the start.",
    ),
    sine_for_cosine=(
        _COLUMNS,
        _COLUMNS.replace("np.cos", "np.sin"),
        "The weight acts with the cosine: the angle is measured from the horizontal.",
    ),
    integrated_once=(
        _FOUND,
        _FOUND.replace("integral(pushed)", "pushed"),
        "The torque is integrated once and the motion twice. Both sides need the same number "
        "of integrals.",
    ),
    sample_time_forgotten=(
        _PUSHED,
        _PUSHED.replace("dt * tau", "tau"),
        "The torques are summed but not multiplied by dt, so the sum is not their integral.",
    ),
    torque_late=(
        _PUSHED,
        "pushed = np.concatenate(([0.0, 0.0], np.cumsum(dt * tau[:-2])))",
        "The torque is one sample late: tau[i] acts from sample i on, not from the next one.",
    ),
    inverse_returned=(_RETURN, "return float(1.0 / fitted[0])", "This is one over the inertia."),
    friction_returned=(
        _RETURN,
        "return float(fitted[1])",
        "This is the coefficient of the viscous friction. The task asks for the inertia.",
    ),
    weight_returned=(
        _RETURN,
        "return float(fitted[2])",
        "This is the weight. The inertia is asked for.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "noise of 0.1 mrad leaves 0.01 % of the inertia in doubt when nothing is differentiated",
        explain=explain,
        timed=one_log,
    ),
    examples=(
        # A constant torque of 2 N m on 2 kg m^2, from rest.
        "inertia_from_log(0.5 * (0.002 * np.arange(1200)) ** 2, np.full(1200, 2.0), 0.002)",
        # A torque of 1 N m on 0.5 kg m^2, moving at the start.
        "inertia_from_log(0.3 + 0.001 * np.arange(1200) + (0.001 * np.arange(1200)) ** 2, "
        "np.ones(1200, dtype=int), 0.001)",
    ),
    picture=left_over,
    slips=SLIPS + value_slips("inertia_from_log", in_part=False, whole=False),
)
