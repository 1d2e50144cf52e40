"""The silent-bug hunt of chapter 9: nothing clipped and all reached, then starts too far away."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return laws from gentle to steep, and tests of which more or less is within reach."""

    def carriages(
        label: str,
        level: str = "core",
        *,
        steep: float = 1.5,
        far: float = 3.0,
        n: int = 8,
        T: int = 12,
        k: int = 30,
    ) -> Case:
        weights = np.array([-steep, 0.1 * rng.normal()])
        statistics = np.array([40.0, 0.3 * rng.normal(), 40.0 * rng.uniform(0.7, 1.3)])
        starts, noise = rng.uniform(-2.0, 2.0, n), rng.normal(size=(T, n))
        tested = far * np.linspace(-1.0, 1.0, k) + rng.uniform(-0.02, 0.02, k)
        if steep < 0.5:
            noise = np.clip(noise, -1.0, 1.0)
        return Case((weights, statistics, starts, noise, tested), label, level)

    return [
        carriages("gentle, one step", "simple", steep=0.1, far=0.5, T=1),
        carriages("gentle, a near test", "simple", steep=0.1, far=0.5),
        *(carriages("a near test", far=1.0) for _ in range(2)),
        *(carriages("a far test") for _ in range(3)),
        carriages("a steep law", steep=3.0, k=60),
        carriages("one start in the test", "edge", k=1),
        carriages("one step", "edge", T=1),
        carriages("hardly any is reached", "edge", far=8.0),
    ]


def results(figure: Any, shown: Shown) -> None:
    """Plot weights, mean and deviation of the places, and the share, one beside the other."""
    axes = picture.plane(figure, "slope, offset, mean, deviation [m], share", "value")
    for (w, known, share), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot([*w, known[1], (known[2] / known[0]) ** 0.5, share], marker="o", **style)
    axes.legend()


_ONCE = """        reached = np.zeros(x.size, dtype=bool)
        for _ in range(limit):
            x = x + dt * np.clip(w[0] * normalised(x) + w[1], -1.0, 1.0)
            reached |= np.abs(x) < 0.1
        return float(np.mean(reached))
"""
_FIRST = """        begun, age, reached = np.array(x), np.zeros(x.size), []
        while len(reached) < x.size:
            x = x + dt * np.clip(w[0] * normalised(x) + w[1], -1.0, 1.0)
            age += 1
            over = (np.abs(x) < 0.1) | (age == limit)
            reached += list(np.abs(x[over]) < 0.1)
            x[over], age[over] = begun[over], 0
        return float(np.mean(reached[: x.size]))
"""
_LEARN = (
    "        return np.asarray((x",
    "        learn(x)\n        return np.asarray((x",
    "        learn(x)\n        z",
    "        z",
)
_CLIP = ("action = mean + sigma * drawn", "action = np.clip(mean + sigma * drawn, -1.0, 1.0)")

SLIPS = slips(
    clipped_before_it_is_stored=(
        *_CLIP,
        "The action is clipped before its probability is taken: the gradient is that of an action "
        "that was never drawn. Clip what goes to the drive, store what came from the policy.",
    ),
    first_finished=(
        _ONCE,
        _FIRST,
        "The first episodes to finish are counted: the short ones, which succeed, come twice, and "
        "the long ones never. Take one episode of each start.",
    ),
    statistics_of_the_test=(
        *_LEARN,
        "The test changes the statistics, and with them the policy that it tests: freeze them.",
    ),
    all_still_there=(_ONCE, _FIRST, *_LEARN, *_CLIP, "All three are still there."),
    first_finished_and_statistics=(
        _ONCE,
        _FIRST,
        *_LEARN,
        "The gradient is mended. The test still counts the first to finish, and still learns.",
    ),
    first_finished_and_clipped=(
        _ONCE,
        _FIRST,
        *_CLIP,
        "The statistics are mended. The test counts the first to finish, the gradient is clipped.",
    ),
    statistics_and_clipped=(
        *_LEARN,
        *_CLIP,
        "The count is mended. The test still learns, and the gradient is of clipped actions.",
    ),
    never_clipped=(
        "dt * np.clip(action, -1.0, 1.0)",
        "dt * action",
        "Nothing is clipped: the drive limits speeds to 1 m/s.",
    ),
    only_the_end_counts=(
        "reached |= np.abs(x) < 0.1",
        "reached = np.abs(x) < 0.1",
        "Only where a carriage is at the limit counts. It has arrived once it was within 0.1 m.",
    ),
    statistics_frozen=(
        "        learn(x)\n        z",
        "        z",
        "The statistics never learn: the places of training belong in them.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "rounding, over some dozens of steps", explain=coarse),
    examples=(
        "training_round([-1.0, 0.0], [10.0, 0.0, 10.0], [1.0, -1.0], np.ones((2, 2)), "
        "np.array([0.5, 3.0]))",
    ),
    picture=results,
    slips=SLIPS
    + coarse_slips("training_round", "The step of one round is small.")
    + value_slips("training_round", whole=False),
)
