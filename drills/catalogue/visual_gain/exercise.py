"""Look and move: without delay, with a frame of it, then with many and near the limit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return gains in parts of what each delay allows."""

    def loop(label: str, level: str = "core", *, delay: int, part: float = 0.0) -> Case:
        limit = 2.0 * math.sin(math.pi / (4.0 * delay + 2.0))
        gain = limit * (part or float(rng.uniform(0.2, 0.8)))
        return Case((gain, delay), label, level)

    return [
        *(loop("no delay", "simple", delay=0) for _ in range(2)),
        loop("too much, no delay", "simple", delay=0, part=1.2),
        *(loop("one frame", delay=1) for _ in range(2)),
        loop("two frames", delay=2),
        *(loop(f"{k} frames", delay=k) for k in (3, 5, 8)),
        loop("too much for three", delay=3, part=1.1),
        loop("too much for one", delay=1, part=1.5),
        loop("near the limit, no delay", "edge", delay=0, part=0.98),
        loop("near the limit, four frames", "edge", delay=4, part=0.98),
        loop("just too much, two frames", "edge", delay=2, part=1.02),
        Case((0.0, 2), "no gain", "edge"),
        Case((-0.3, 1), "the wrong sign", "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-12 for the limit, 1e-8 of the variance, which a linear system gives."""
    return [1e-12, 1e-8 * abs(float(truth[1]))]


def frames(figure: Any, shown: Shown) -> None:
    """Plot an error of 1, corrected with nine tenths of each limit."""
    axes = picture.plane(figure, "frame", "error, with 0.9 of the limit")
    for (limit, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        delay = int(shown.args[1])
        e = [1.0] * (delay + 1)
        for _ in range(60):
            e.append(min(max(e[-1] - 0.9 * float(limit) * e[-1 - delay], -5.0), 5.0))
        axes.plot(e[delay:], **style)
    axes.legend()


_LIMIT = "limit = 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay + 1.0)))"
_CHECK = "if not 0.0 < gain < limit:"
_RETURN = "return limit, float(covariance[0])"

SLIPS = slips(
    two_for_every_delay=(
        _LIMIT,
        "limit = 2.0",
        "2 is the limit without delay. One frame of delay halves it, and each further frame "
        "lowers it.",
    ),
    one_frame_too_many=(
        _LIMIT,
        _LIMIT.replace("delay + 1.0", "delay + 3.0"),
        "The limit is that of a delay which is one frame longer: without delay it is 2.",
    ),
    one_frame_too_few=(
        _LIMIT,
        _LIMIT.replace("delay + 1.0", "max(delay - 1.0, 0.0) + 1.0"),
        "The limit is that of a delay which is one frame shorter: with one frame it is 1.",
    ),
    degrees=(
        _LIMIT,
        "limit = 2.0 * math.sin(90.0 / (2.0 * delay + 1.0))",
        "The angle at the limit is in degrees; math.sin takes radians.",
    ),
    half_the_angle=(
        _LIMIT,
        "limit = 2.0 * math.sin(math.pi / (2.0 * delay + 1.0))",
        "That is the sine of the full angle per frame. The magnitude of e^(i w) - 1 is 2 sin(w"
        " / 2).",
    ),
    one_over_the_delay=(
        _LIMIT,
        "limit = 2.0 / (2.0 * delay + 1.0)",
        "The sine is replaced by a straight line: right without delay, and too small by up to "
        "half for long delays.",
    ),
    no_delay_for_the_noise=(
        _RETURN,
        "return limit, gain / (2.0 - gain)",
        "g / (2 - g) is the variance without delay. With delay, noise is corrected late, and "
        "more of it stays.",
    ),
    noise_once=(
        _RETURN,
        "return limit, gain**2",
        "That is what one image adds. The noise of earlier images is still there.",
    ),
    deviation_for_variance=(
        _RETURN,
        "return limit, float(np.sqrt(covariance[0]))",
        "This is the standard deviation; the task wants the variance.",
    ),
    limit_not_looked_at=(
        _CHECK,
        "if not 0.0 < gain < 2.0:",
        "A variance is returned where nothing settles: beyond the limit the linear system "
        "still has a solution, but it is meaningless.",
    ),
    wrong_sign_accepted=(
        _CHECK,
        "if gain >= limit:",
        "With a gain of 0 or less the error never settles: return -1.",
    ),
    a_hundred_frames=(
        _RETURN,
        "e = [0.0] * n + [-gain]\n    for _ in range(100):\n        "
        "e.append(e[-1] - gain * e[-1 - delay])\n    return limit, sum(x * x for x in e)",
        "The sum of squares stops after a hundred frames. Near the limit an impulse lasts longer.",
    ),
    one_frame_less_in_both=(
        _LIMIT,
        "delay = max(delay - 1, 0)\n    " + _LIMIT,
        "Limit and variance are those of a delay that is one frame shorter. An image that is d "
        "frames old shows e[n - d].",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a sine; a linear system near the limit", explain=coarse),
    examples=("visual_gain(0.5, 0)", "visual_gain(0.5, 1)", "visual_gain(0.5, 3)"),
    picture=frames,
    slips=SLIPS
    + coarse_slips("visual_gain", "At the limit the last of them decides.")
    + value_slips("visual_gain", swapped=True, whole=False),
)
