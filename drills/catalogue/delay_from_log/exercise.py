"""Delay from a log: whole samples without an offset, then parts of samples, offset and noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import Answer, Case, judge_of, largest_error
from drills.exercise import Exercise, slips, value_slips

Array = NDArray[np.float64]
FASTEST = 0.05  # part of the sample rate


def cases(rng: np.random.Generator) -> list[Case]:
    """Return sums of sines, so that a late value is known exactly."""

    def log(
        label: str,
        level: str = "core",
        *,
        samples: float | None = None,
        offset: float = 3.0,
        noise: float = 0.01,
        n: int = 1500,
        dt: float = 2e-3,
        own_offset: float = 0.0,
        half_period: float = 0.0,
    ) -> Case:
        late = rng.uniform(0.2, 0.8) + rng.integers(1, 20) if samples is None else samples
        rates = 2.0 * np.pi * rng.uniform(0.2, 1.0, 12) * FASTEST
        phases, sizes = rng.uniform(0.0, 6.28, 12), rng.uniform(0.5, 1.0, 12)
        if half_period:  # [samples] of a command that is a single sine
            rates, sizes = np.full(12, np.pi / half_period), np.eye(12)[0]

        def signal(t: Array) -> Array:
            return np.asarray(sizes @ np.sin(np.outer(rates, t) + phases[:, None]))

        t, gain = np.arange(n, dtype=float), float(rng.uniform(0.3, 3.0))
        sent, clean = signal(t), gain * signal(t - late)
        measured = clean + noise * np.std(clean) * rng.normal(size=n)
        signs = rng.choice([-1.0, 1.0], 2)
        moved = sent + signs[0] * offset, measured + signs[1] * gain * (offset + own_offset)
        return Case((*moved, dt, 25.0 * dt), label, level)

    return [
        log("whole samples, no offset", "simple", samples=7.0, offset=0.0, noise=0.0),
        log("whole samples", "simple", samples=4.0, noise=0.0),
        *(log("parts of a sample, no offset", offset=0.0, noise=0.0) for _ in range(2)),
        *(log("parts of a sample") for _ in range(4)),
        log("a large offset", offset=30.0),
        # Offsets of the same part of both signals don't move the best match, one of its own does.
        *(log("an offset of one log alone", offset=0.0, own_offset=100.0) for _ in range(2)),
        # Half a period later, here a whole number of samples, a sine is its own negative. The next
        # match of the right sign is beyond `longest`.
        log("a single sine", samples=2.4, offset=0.0, half_period=13.6),
        log("more noise", noise=0.02),
        log("samples of 10 ms", dt=0.01),
        log("no delay", "edge", samples=0.0),
        log("less than a sample", "edge", samples=0.4),
        log("the longest delay", "edge", samples=25.0),
        log("a short log", "edge", n=600),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return a tenth of a sample."""
    return 0.1 * float(case.args[2])


def explain(answers: Sequence[Answer]) -> str:
    """Return right but for the part of a sample."""
    whole = [
        largest_error(a.parts[0], a.case.args[2] * np.rint(a.truth[0] / a.case.args[2]))
        for a in answers
    ]
    near = all(w < 1e-6 * a.case.args[2] for w, a in zip(whole, answers, strict=True))
    return "whole_samples_only" if near else ""


_MEANS = "        a, b = a - np.mean(a), b - np.mean(b)\n"
_MATCH = "return float(a @ b / np.sqrt((a @ a) * (b @ b)))"
_RETURN = "return float(dt * (lags[at] + part))"
_PART = "part = 0.5 * (before - after) / (before - 2.0 * best + after)"

SLIPS = slips(
    sign_turned=(
        _RETURN,
        _RETURN.replace("(dt *", "(-dt *"),
        "The sign is turned: a measurement that comes after its command has a positive delay.",
    ),
    mean_not_removed=(
        _MEANS,
        "",
        _MATCH,
        "return float(a @ b)",
        "The means are left in: with a large offset the sum of products is nearly all mean, and "
        "the lag with the longest or shortest overlap wins.",
    ),
    means_left_in=(
        _MEANS,
        "",
        "The means are left in. Where only one of the logs has an offset, the match then follows "
        "the sum of the other log over the overlap: take the mean off both parts.",
    ),
    either_sign=(
        "np.argmax(matches[1:-1])",
        "np.argmax(np.abs(matches[1:-1]))",
        "The largest match of either sign is taken. The gain is positive, so a match of -1 is half "
        "a period too late: take the largest, not the largest amount.",
    ),
    off_by_one=(
        "lags[at]",
        "at",
        "One sample too long: the first match is that of lag -1, so index and lag differ by one.",
    ),
    one_too_short=(
        "lags[at]",
        "(lags[at] - 1)",
        "One sample too short: an index is taken for the lag.",
    ),
    whole_samples_only=(
        _PART,
        "part = 0.0",
        "Only whole samples: half a sample is left in doubt, and a delay of 0.4 of one is none. "
        "Put a parabola through the best match and its neighbours.",
    ),
    parabola_mirrored=(
        _PART,
        _PART.replace("(before - after)", "(after - before)"),
        "The part of a sample has the wrong sign: the top lies on the side of the better "
        "neighbour.",
    ),
    parabola_without_half=(
        _PART,
        _PART.replace("0.5 * ", ""),
        "The part of a sample is twice too large: the vertex has a half in it.",
    ),
    samples_for_seconds=(
        _RETURN,
        _RETURN.replace("dt * ", ""),
        "This is in samples; the delay is asked for in seconds.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a parabola on a smooth top, and noise of 2 %", explain=explain),
    examples=(
        "delay_from_log(np.sin(0.1 * np.arange(600)) + np.sin(0.23 * np.arange(600)), "
        "np.sin(0.1 * np.arange(-4.5, 595)) + np.sin(0.23 * np.arange(-4.5, 595)), 0.01, 0.2)",
        "delay_from_log(np.sin(0.1 * np.arange(600)), np.sin(0.1 * np.arange(600)), 0.01, 0.1)",
    ),
    slips=SLIPS + value_slips("delay_from_log", in_part=False, whole=False),
)
