"""An energy log: whole periods of one cosine, then parts of a period, harmonics, uneven samples."""

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
    """Return logs with more or less of drift, swing and offset."""

    def log(
        label: str,
        level: str = "core",
        *,
        periods: float | None = None,
        offset: float = 2.0,
        drift: float = 1.0,
        swing: float = 0.1,
        harmonics: int = 3,
        even: bool = True,
    ) -> Case:
        count = rng.uniform(2.2, 5.8) if periods is None else periods
        period, n = float(rng.uniform(0.4, 2.0)), int(rng.integers(150, 250))
        t = np.arange(n) / n if even else np.sort(rng.uniform(0.0, 1.0, n))
        t = float(rng.uniform(0.5, 3.0)) + count * period * t
        energy = offset + 0.05 * drift * rng.uniform(0.5, 2.0) * rng.choice([-1.0, 1.0]) * t
        for k in range(1, harmonics + 1):
            size, phase = swing * rng.uniform(0.4, 1.0), rng.uniform(0.0, 6.28)
            energy += size * np.cos(2.0 * np.pi * k * t / period + phase)
        return Case((t, energy, period), label, level)

    whole = np.arange(20), np.array([5, 7, 4, 2, 1, 3, 6, 8, 6, 7, 3, 1, 2, 4, 7, 9, 8, 6, 5, 2]), 8
    return [
        log("no swing", "simple", swing=0.0),
        log("no drift", "simple", drift=0.0, harmonics=1),
        log("one cosine", "simple", harmonics=1),
        *(log("a part of a period at the end") for _ in range(4)),
        log("whole periods", periods=3.0),
        log("mostly swing", swing=1.0, drift=0.1),
        log("uneven samples", even=False),
        log("a far zero of energy", offset=-400.0),
        log("two periods", "edge", periods=2.0),
        log("neither", "edge", drift=0.0, swing=0.0),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9 of the largest energy; of that over the duration for the drift."""
    times, energy, _ = case.args
    largest = float(np.abs(energy).max())
    return [1e-9 * largest / float(times[-1] - times[0]), 1e-9 * largest]


def lines(figure: Any, shown: Shown) -> None:
    """Plot the log, and the drift through its middle with the swing as its width."""
    t, energy, _ = (np.asarray(one, dtype=float) for one in shown.args)
    axes = picture.plane(figure, "time [s]", "energy [J]")
    axes.plot(t, energy, color="0.8", lw=1.0, label="log")
    for (drift, swing), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        line = energy.mean() + float(drift) * (t - t.mean())
        axes.plot(t, line, **style)
        axes.plot(t, line + float(swing), **{**style, "label": None, "lw": 0.6})
    axes.legend()


_ORDERS, _RETURN = "for k in (1, 2, 3):", "return float(fit[1]), float("
_RMS = "np.sqrt(np.sum(fit[2:] ** 2) / 2.0)"
_E = "np.asarray(energy, dtype=float)"

SLIPS = slips(
    end_minus_start=(
        _RETURN,
        f"return float(({_E}[-1] - {_E}[0]) / (t[-1] - t[0])), float(",
        "The drift is the last sample less the first, over the time: a piece of the swing counts "
        "as drift, and the answer depends on where the log ends.",
    ),
    straight_line_only=(
        _ORDERS,
        "for k in ():",
        _RMS,
        f"np.sqrt(np.mean(({_E} - np.column_stack(columns) @ fit) ** 2))",
        "A straight line alone is fitted: right after whole periods of a log without end. What is "
        "left of a period at the end tilts it. Fit the swing in the same go.",
    ),
    drift_counts_as_swing=(
        _RMS,
        f"np.std({_E})",
        "The swing is the deviation of the log as it is: its drift is in it. Take it off first.",
    ),
    spread_for_drift=(
        _RETURN,
        f"return float(np.ptp({_E}) / np.ptp(t)), float(",
        "The drift is the largest less the smallest energy over the time: that is the swing, "
        "mostly, and never negative.",
    ),
    size_for_rms=(
        _RMS,
        "np.sqrt(np.sum(fit[2:] ** 2))",
        "The sizes of the cosines are added without the half: the mean square of a cosine is half "
        "of its size squared.",
    ),
    peak_to_peak=(
        _RMS,
        "np.ptp(np.column_stack(columns)[:, 2:] @ fit[2:])",
        "That is the largest less the smallest value of the swing; its root mean square is asked.",
    ),
    fundamental_only=(
        _ORDERS,
        "for k in (1,):",
        "The swing is taken for a single cosine. It has a second and a third harmonic.",
    ),
    harmonics_two_only=(
        _ORDERS,
        "for k in (1, 2):",
        "The third harmonic is missing: `range(1, 3)` ends with 2.",
    ),
    angular_frequency_forgotten=(
        "2.0 * np.pi * k * t / period",
        "k * t / period",
        "The factor 2 pi is missing: a period is a whole turn of the phase.",
    ),
    drift_per_period=(
        _RETURN,
        "return float(fit[1] * period), float(",
        "The drift is that of a period, in joules; that of a second is asked for.",
    ),
    drift_sign=(
        _RETURN,
        "return float(-fit[1]), float(",
        "The sign is turned: energy that is lost is a negative drift.",
    ),
    relative_drift=(
        _RETURN,
        f"return float(fit[1] / {_E}[0]), float(",
        "The drift is divided by the energy at the start. The zero of an energy is anybody's "
        "choice, so a part of it says nothing; watts are asked for.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a least squares fit that is exact: rounding", explain=coarse),
    examples=(
        "energy_drift(np.arange(40) / 10, 3.0 - np.arange(40) / 100 "
        "+ 0.5 * np.sin(2 * np.pi * np.arange(40) / 15), 1.5)",
    ),
    picture=lines,
    slips=SLIPS
    + coarse_slips("energy_drift", "A drift is small beside the energy that it belongs to.")
    + value_slips("energy_drift", swapped=True),
)
