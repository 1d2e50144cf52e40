"""The silent-bug hunt of chapter 3: scenes in which one mistake shows, then all together."""

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
    """Return rough or smooth, a light plank or a heavy one, one step or two, near and far."""

    def scene(
        label: str,
        level: str = "core",
        *,
        mu: float | None = None,
        plank: float = 2.0,
        place: float = 0.0,
        two: bool = False,
        long: int = 20,
    ) -> Case:
        masses = rng.uniform(0.5, 2.0) * np.array([1.0, plank])
        rough = float(rng.uniform(0.1, 0.6)) if mu is None else mu
        dt = 0.01 if long > 20 else float(rng.choice([0.005, 0.01]))
        times = 2.0 * dt * np.unique(np.append(rng.integers(1, long, 12), long - 1))
        args = rough, masses, place, float(rng.uniform(0.8, 2.0))
        return Case((*args, np.array([dt, 2.0 * dt if two else dt]), times), label, level)

    whole = 1, np.array([2, 3]), 0, 60, np.array([1, 2]), np.array([2, 4])
    return [
        scene("as its author tried it", "simple", mu=1.0, plank=1e6),
        scene("a light plank", "simple", mu=1.0),
        scene("smooth", mu=0.0),
        scene("as rough as 0.3", mu=0.3, plank=1e6),
        scene("two steps", mu=1.0, two=True),
        scene("far away", mu=1.0, place=1000.0),
        *(scene("all together", two=True, place=place) for place in (0.0, 30.0, -500.0)),
        scene("until it sticks", long=30, two=True),
        scene("a plank like a table", plank=1e6),
        scene("no friction, two steps", "edge", mu=0.0, two=True),
        scene("one step", "edge", long=2),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9, of values above 1 as much of them; far away a place has fewer digits."""
    far = max(1.0, 1e-3 * abs(case.args[2]), float(np.abs(truth[0]).max()))
    return [1e-9 * far, 1e-9 * max(1.0, float(np.abs(truth[1]).max()))]


def plot_distance(figure: Any, shown: Shown) -> None:
    """Plot how far the engines are apart."""
    axes = picture.plane(figure, "time [s]", "second less first engine [m]")
    times = np.asarray(shown.args[5], dtype=float)
    for (between, gained), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        label = "{}: {:.3g} and {:.3g} J".format(style["label"], *np.asarray(gained, dtype=float))
        axes.plot(times, np.asarray(between, dtype=float), **{**style, "label": label})
    axes.legend()


_RULE, _DAMPING = ("(mu**0.5, mu**0.5)", "(mu, mu)"), ("a * b, 0.0,", "a * b, 0.04,")
_TIMES = ("        log = [(*x, *v)]\n", "        log = []\n")
_ENERGY = ("np.sum(masses * state[2:] ** 2) / 2.0", "masses[0] * state[2] ** 2 / 2.0")
_DIGITS = (
    "x, v = np.array([place, place], dtype=float), np.array([speed, 0.0])",
    "x, v = np.array([[place, place], [speed, 0.0]], dtype=np.float32)",
)

SLIPS = slips(
    friction_rule=(
        *_RULE,
        "The first engine multiplies the two coefficients: with mu on both surfaces it has mu^2, "
        "which is mu only at 1. Give it roots.",
    ),
    leftover_damping=(
        *_DAMPING,
        "The first engine still damps every body as shipped: nothing that slides should lose speed "
        "but by friction.",
    ),
    times_a_step_late=(
        *_TIMES,
        "A log that begins after the first step has the time of (k + 1) dt in row k: with equal "
        "steps both are late alike. Log the start, or count from it.",
    ),
    energy_without_the_base=(
        *_ENERGY,
        "Only the block's energy is counted. What friction takes from it goes to the plank in "
        "part, and the plank is free.",
    ),
    float32_state=(
        *_DIGITS,
        "The state is kept in single precision: seven digits, of which a place far from the origin "
        "leaves few for a step.",
    ),
    rule_and_damping=(
        *_RULE,
        *_DAMPING,
        "Times, energy and digits are right. The defaults of the first engine are left: its rule "
        "for friction, and its damping.",
    ),
    times_and_energy=(
        *_TIMES,
        *_ENERGY,
        "Both engines are set alike now. What is read from their logs is not: times, and whose "
        "energy.",
    ),
    all_still_there=(
        *_RULE,
        *_DAMPING,
        *_TIMES,
        *_ENERGY,
        *_DIGITS,
        "All five are still there: rule, damping, times, energy, digits.",
    ),
    square_for_root=(
        _RULE[0],
        "(mu**2, mu**2)",
        "The coefficients are squared where a root is needed: they are multiplied once more.",
    ),
    rule_by_half=(
        _RULE[0],
        "(mu / 2.0, mu / 2.0)",
        "Halves multiply to a quarter of the square. It takes roots.",
    ),
    second_one_damped=(
        "max, 0.0, steps",
        "max, 0.04, steps",
        "Both engines are damped alike. They agree, and both are wrong: the scene has none.",
    ),
    energy_of_what_slides=(
        _ENERGY[0],
        "masses[0] * (state[2] - state[3]) ** 2 / 2.0",
        "This is the energy of the block as the plank sees it. Energy is counted in one frame that "
        "does not move, for both bodies.",
    ),
    rows_cut_off=(
        "np.rint(times / dt)",
        "np.floor(times / dt)",
        "Times are cut off to rows: 0.07 / 0.01 is a little less than 7. Round them.",
    ),
    both_pushed_forward=(
        "np.array([1.0, -1.0])",
        "np.array([1.0, 1.0])",
        "Friction pushes block and plank in the same direction. It acts with opposite signs on "
        "the two bodies, and their momentum is constant.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "some dozens of steps: rounding", explain=coarse),
    examples=(
        "compare_engines(0.3, [1.0, 2.0], 0.0, 1.0, [0.01, 0.02], [0.1, 0.2, 0.4])",
        "compare_engines(0.3, [1.0, 2.0], 1000.0, 1.0, [0.01, 0.01], [0.1, 0.2, 0.4])",
    ),
    picture=plot_distance,
    slips=SLIPS
    + coarse_slips("compare_engines", "How far two engines are apart is a small difference.")
    + value_slips("compare_engines"),
)
