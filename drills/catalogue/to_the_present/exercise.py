"""An estimate to the present: one message, then several, then such as overtake one another."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return messages of a camera at 10 Hz, with a latency that is constant or spread."""

    def log(
        label: str,
        level: str = "core",
        *,
        n: int = 5,
        spread: float = 0.0,
        noise: float = 0.5,
        speed: float = 0.3,
        shuffled: bool = False,
        now: float | None = None,
    ) -> Case:
        captured = 0.1 * np.arange(n) + rng.uniform(0.0, 0.05)
        arrived = captured + 0.07 + spread * rng.random(n)
        if spread:  # the last one overtakes the one before it
            arrived[-2] = arrived.max() + 0.01
        states = np.hstack((rng.uniform(-0.5, 0.5, (n, 2)), speed * rng.normal(size=(n, 2))))
        roots = rng.normal(size=(n, 4, 4)) * [[0.01], [0.01], [0.1], [0.1]]
        if now is None:
            low = arrived.max() if spread else arrived.min()
            now = float(rng.uniform(low, low + 0.03 + 0.1 * (n - 1)))
        order = np.roll(np.arange(n), int(rng.integers(1, n)) if shuffled else 0)
        covariances = roots @ roots.swapaxes(1, 2)
        args = states[order], covariances[order], captured[order], arrived[order]
        return Case((*args, now, noise), label, level)

    at = log("at the moment of arrival", "edge", n=3)
    eye = np.tile(np.eye(4, dtype=int), (2, 1, 1))
    return [
        log("one message, no noise", "simple", n=1, noise=0.0, now=0.3),
        log("one message", "simple", n=1, now=0.4),
        log("at rest", "simple", n=2, speed=0.0),
        *(log("several") for _ in range(2)),
        *(log("in any order", shuffled=True) for _ in range(2)),
        *(log("one overtakes another", spread=0.4, n=8) for _ in range(3)),
        log("much noise", noise=20.0),
        log("long ago", now=3.0),
        log("all arrived, the last one first", spread=0.4, n=8, shuffled=True, now=2.0),
        Case((*at.args[:4], float(at.args[3][-1]), 0.5), at.label, "edge"),
        Case(
            (
                np.array([[1, 2, 3, -1], [0, 1, 2, 1]]),
                eye,
                np.array([1, 2]),
                np.array([3, 4]),
                5,
                3,
            ),
            WHOLE,
            "edge",
        ),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-12 of the largest number of each."""
    return [1e-12 * max(1.0, float(np.abs(value).max())) for value in truth]


def ellipses(figure: Any, shown: Shown) -> None:
    """Plot both estimates with their ellipses of one deviation."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    turn = np.linspace(0.0, 2.0 * np.pi, 60)
    for (state, P), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        values, vectors = np.linalg.eigh(np.asarray(P, dtype=float)[:2, :2])
        ring = vectors @ (np.sqrt(np.abs(values))[:, None] * [np.cos(turn), np.sin(turn)])
        axes.plot(*(np.asarray(state, dtype=float)[:2, None] + ring), **style)
    axes.legend()


_AGE = "age = now - stamps[newest]"
_NEWEST = "newest = here[np.argmax(stamps[here])]"
_MOVED = "F @ np.asarray(covariances, dtype=float)[newest] @ F.T"
_PLUS = " + np.kron(growth, np.eye(2))"
_DIAGONAL = "[[age**3 / 3.0, age**2 / 2.0], [age**2 / 2.0, age]]"

SLIPS = slips(
    from_arrival=(
        _AGE,
        "age = now - np.asarray(arrived)[newest]",
        "The state is predicted from its arrival. It describes the moment of capture: "
        "exposure, perception and transmission belong to the age.",
    ),
    covariance_not_grown=(
        _MOVED,
        "np.asarray(covariances, dtype=float)[newest]",
        _PLUS,
        "",
        "The covariance is still that of the message: a predicted estimate is less certain "
        "than the original one.",
    ),
    age_counted_twice=(
        "return F @ np",
        "return F @ F @ np",
        "The age is counted twice: the state is now as far ahead of the target as it was behind.",
    ),
    frame_period_for_age=(
        _AGE,
        "age = stamps[here].max() - np.sort(np.append(stamps, stamps.min() - 0.1))[-2]",
        "The time between two frames is used as the age. The age of the newest one has nothing"
        " to do with it.",
    ),
    last_arrived=(
        _NEWEST,
        "newest = here[np.argmax(np.asarray(arrived)[here])]",
        "The message that arrived last is used as the newest: it may have been overtaken.",
    ),
    last_in_the_list=(
        _NEWEST,
        "newest = here[-1]",
        "The last message in the list is used as the newest. The list is in no particular order.",
    ),
    from_the_future=(
        "np.asarray(arrived) <= now",
        "stamps <= now",
        "Messages are used as soon as they are captured. Nobody has them before they arrive.",
    ),
    strictly_before=(
        "np.asarray(arrived) <= now",
        "np.asarray(arrived) <= now - 1e-12",
        "A message that arrives exactly at `now` is ignored.",
    ),
    no_acceleration_noise=(
        _PLUS,
        "",
        "The unknown acceleration is missing: only the uncertainty of the velocity is propagated.",
    ),
    doubt_of_the_rate_forgotten=(
        _MOVED,
        "np.asarray(covariances, dtype=float)[newest]",
        "Noise is added, but the uncertainty of the velocity is not propagated into the "
        "position: F P F^T.",
    ),
    transposed_transition=(
        _MOVED,
        "F.T @ np.asarray(covariances, dtype=float)[newest] @ F",
        "F is transposed in the covariance: the uncertainty of the position goes into the "
        "velocity.",
    ),
    not_correlated=(
        _DIAGONAL,
        "np.diag([age**3 / 3.0, age])",
        "An acceleration changes position and velocity together: the term T^2 / 2 between them"
        " is missing.",
    ),
    noise_into_the_rate_only=(
        _DIAGONAL,
        "np.diag([0.0, age])",
        "The acceleration noise is in the velocity only; the position takes T^3 / 3 of it.",
    ),
    oldest=(
        _NEWEST,
        "newest = here[np.argmin(stamps[here])]",
        "The oldest estimate is taken. The one that was captured last knows more of the present.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a few products: rounding", explain=coarse),
    examples=("to_the_present([[0, 0, 1, 0]], [np.eye(4)], [1.0], [1.5], 2.0, 0.0)",),
    picture=ellipses,
    slips=SLIPS
    + coarse_slips("to_the_present", "Covariances of millimetres are small numbers.")
    + value_slips("to_the_present"),
)
