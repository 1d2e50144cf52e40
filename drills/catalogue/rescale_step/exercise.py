"""The same task at another step: without discount, with it, then with goals and odd ratios."""

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
    """Return cases with steps of some milliseconds, prices of time, and goals."""

    def task(
        label: str,
        level: str = "core",
        *,
        part: float = 0.1,
        gamma: float | None = None,
        goals: bool = True,
        steps: int = 300,
        m: int = 4,
    ) -> Case:
        rewards, dt = 10.0 * rng.normal(size=m), float(rng.choice([0.01, 0.02, 0.05]))
        once = np.arange(m) % 2 * int(goals)
        discount = float(rng.uniform(0.9, 0.995)) if gamma is None else gamma
        return Case((rewards, once, discount, steps, dt, part * dt), label, level)

    return [
        task("no discount, no goal", "simple", gamma=1.0, goals=False),
        task("no discount", "simple", gamma=1.0),
        task("no goal", "simple", goals=False),
        *(task("a tenth of the step") for _ in range(2)),
        task("a fifth", part=0.2),
        task("strongly discounted", gamma=0.5),
        task("twice the step", part=2.0),
        task("four times the step", part=4.0),
        task("the ratio is not whole", part=0.3),
        task("a discount near 1", "edge", gamma=1.0 - 5e-6, part=0.5),
        task("a limit between two steps", "edge", part=0.7, steps=11),
        task("a limit just above a whole step", "edge", part=3.0, steps=100),
        task("the same step", "edge", part=1.0),
        task("no terms", "edge", m=0),
        Case((np.array([-1, 5]), np.array([0, 1]), 1, 100, 2, 1), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9 of the largest reward, 1e-12 for the discount, the whole number exactly."""
    return [1e-9 * max(1.0, float(np.abs(truth[0]).max(initial=0.0))), 1e-12, 0.0]


def discounts(figure: Any, shown: Shown) -> None:
    """Plot what a reward is worth over the time that it is away."""
    axes = picture.plane(figure, "time [s]", "discount")
    dt, new = shown.args[4:]
    for values, style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        steps = np.arange(0.0, 100.0 * dt, new)
        axes.plot(steps, float(values[1]) ** (steps / new), **style)
    axes.set_title(
        "time limit {:g} s, right is {:g} s".format(
            *(float(v[2]) * new for v in (shown.got, shown.expected))
        )
    )
    axes.legend()


_FACTOR = "factor = (1.0 - gamma**part) / (1.0 - gamma)"
_ONCE = "np.where(np.asarray(once) != 0, 1.0, factor)"
_GAMMA, _STEPS = "scaled, gamma**part", "round(steps / part)"

SLIPS = slips(
    gamma_kept=(
        _GAMMA,
        "scaled, gamma",
        "The discount per step is unchanged: with a tenth of the step the agent looks only a "
        "tenth as far ahead in seconds.",
    ),
    gamma_linear=(
        _GAMMA,
        "scaled, gamma * part",
        "The discount is scaled as if it were a rate. It is a factor per step: take a power of it.",
    ),
    gamma_first_order=(
        _GAMMA,
        "scaled, 1.0 - (1.0 - gamma) * part",
        "1 - (1 - gamma) new / dt is only the first-order approximation, good near 1.",
    ),
    gamma_other_way=(
        _GAMMA,
        "scaled, gamma ** (1.0 / part)",
        "The exponent is inverted: a shorter step discounts less.",
    ),
    rewards_not_scaled=(
        _ONCE,
        "1.0",
        "The rewards are unchanged. A price per step is then paid ten times as often, and "
        "goals that were worth the effort no longer are.",
    ),
    reward_by_the_time_alone=(
        _FACTOR,
        "factor = part",
        "The price is scaled by new / dt. That is right without a discount. With one, the new "
        "steps are discounted one after the other, and together have to pay what the old step "
        "paid.",
    ),
    reward_other_way=(
        _FACTOR,
        "factor = (1.0 - gamma) / (1.0 - gamma**part)",
        "factor = part\n",
        "factor = 1.0 / part\n",
        "The price grows where it should fall: a shorter step pays less.",
    ),
    goals_scaled=(
        _ONCE,
        "factor",
        "The reward of an event is scaled, too. It is paid once, however short the step is.",
    ),
    once_swapped=(
        _ONCE,
        "np.where(np.asarray(once) != 0, factor, 1.0)",
        "Rewards of events are scaled and prices per step are not: it is the other way round.",
    ),
    limit_in_steps=(
        _STEPS,
        "steps",
        "The time limit has the same number of steps: with a tenth of the step the episode "
        "ends ten times too early.",
    ),
    limit_other_way=(
        _STEPS,
        "round(steps * part)",
        "A shorter step needs more steps for the same seconds.",
    ),
    limit_rounded_up=(
        _STEPS,
        "int(np.ceil(steps / part))",
        "The time limit is rounded up. It is the nearest integer, which may be the one below.",
    ),
    limit_cut_off=(
        _STEPS,
        "int(steps / part)",
        "The time limit is cut off; the task wants the nearest integer.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a power and a quotient: rounding", explain=coarse),
    examples=(
        "rescale_step([-1.0, 10.0], [0, 1], 0.99, 200, 0.01, 0.001)",
        "rescale_step([-1.0, 10.0], [0, 1], 1.0, 200, 0.01, 0.001)",
    ),
    picture=discounts,
    slips=SLIPS
    + coarse_slips("rescale_step", "A discount is taken to a power of thousands.")
    + value_slips("rescale_step"),
)
