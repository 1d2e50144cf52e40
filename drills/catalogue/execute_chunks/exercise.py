"""Executed chunks: one action, one chunk, then seams, and ensembles with different rates."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return predictions that all differ, so that an executed action shows where it comes from."""

    def run(
        label: str,
        level: str = "core",
        *,
        T: int = 20,
        H: int = 5,
        m: int = 2,
        every: int = 3,
        rate: float = -1.0,
    ) -> Case:
        rate = rate if rate >= 0.0 else float(rng.uniform(0.1, 1.0))
        return Case((rng.normal(size=(T, H, m)), every, rate), label, level)

    return [
        run("chunks of one action", "simple", H=1, m=1, every=1),
        run("a plain mean", "simple", T=6, m=1, rate=0.0),
        run("one chunk", "simple", T=4, every=4),
        *(run("seams") for _ in range(3)),
        run("whole chunks", every=5),
        run("two of eight", H=8, every=2),
        run("a long run", T=60, H=10, every=7),
        run("asked at each step", "edge", every=1),
        run("one step", "edge", T=1),
        run("a large rate", "edge", rate=30.0),
        Case((np.arange(12).reshape(4, 3, 1) ** 2, 2, 1), WHOLE, "edge"),
    ]


def actions(figure: Any, shown: Shown) -> None:
    """Plot the first component of both kinds of action over the steps."""
    axes = picture.plane(figure, "step", "first component")
    for parts, style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        for part, marker, name in zip(parts, "os", ("committed", "ensembled"), strict=True):
            label = f"{name}, {style['label']}"
            axes.plot(np.asarray(part)[:, 0], **style | {"marker": marker, "label": label})
    axes.legend()


_PLANS, _BEGAN = "plans[began, steps - began]", "began = steps // every * every"
_ASKED = "made = np.arange(max(0, t - H + 1), t + 1)"
_WEIGHTS = "np.exp(-rate * np.arange(made.size))"

SLIPS = slips(
    replans_every_step=(
        _PLANS,
        "plans[:, 0]",
        "The committed actions come from a new chunk at every step, so nothing is committed to.",
    ),
    weights_reversed=(
        _WEIGHTS,
        f"{_WEIGHTS}[::-1]",
        "The weights are reversed: the oldest prediction has i = 0 and the largest weight.",
    ),
    seam_off_by_one=(
        _BEGAN,
        "began = np.maximum(steps - 1, 0) // every * every",
        _PLANS,
        "plans[began, np.minimum(steps - began, H - 1)]",
        "Each chunk is executed one step too long: at the seam the first action of the new chunk "
        "is due.",
    ),
    first_action_skipped=(
        _PLANS,
        "plans[began, np.minimum(steps - began + (began > 0), H - 1)]",
        "The first action of each new chunk is skipped.",
    ),
    whole_chunks=(
        _BEGAN,
        "began = steps // H * H",
        "Chunks are executed to their end. A new one is due every `every` steps.",
    ),
    no_weights=(
        _WEIGHTS,
        "np.ones(made.size)",
        "All predictions have the same weight, so the rate has no effect.",
    ),
    weights_not_normalised=(
        " / weights.sum()",
        "",
        "The weights do not add up to 1: divide by their sum.",
    ),
    first_actions_averaged=(
        "plans[made, t - made]",
        "plans[made, 0]",
        "First actions of several chunks are averaged, but each of them is for a different step. "
        "The chunk predicted at step s has its action t - s for step t.",
    ),
    oldest_left_out=(
        _ASKED,
        _ASKED.replace("t - H + 1)", "min(t, t - H + 2))"),
        "The oldest chunk that contains an action for this step is missing: the one predicted at "
        "step t - H + 1.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "a mean of a few numbers", explain=coarse),
    examples=("execute_chunks([[[0.0], [1.0]], [[2.0], [4.0]], [[5.0], [6.0]]], 2, 0.7)",),
    picture=actions,
    slips=SLIPS
    + coarse_slips("execute_chunks", "The command of an arm then jumps.")
    + value_slips("execute_chunks", swapped=True),
)
