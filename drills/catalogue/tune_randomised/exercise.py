"""The silent-bug hunt of chapter 8: carts that differ in one thing, then in all, then the test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]
NOMINAL = (1.0, 0.2, 0.0)


def cases(rng: np.random.Generator) -> list[Case]:
    """Return where each mistake shows by itself, then all together."""

    def carts(
        label: str,
        level: str = "core",
        *,
        mass: float = 0.0,
        damping: float = 0.0,
        delay: int = 0,
        trained: int = 3,
        tested: int = 3,
    ) -> Case:
        n = trained + tested
        draws = np.tile(NOMINAL, (n, 1))
        draws[:, 0] *= np.exp(mass * rng.uniform(-1.0, 1.0, n))
        draws[:, 1] += damping * rng.uniform(0.0, 1.0, n)
        draws[:, 2] = rng.integers(1, delay + 1, n) if delay else 0.0
        gains = np.column_stack((rng.uniform(4.0, 15.0, 4), rng.uniform(1.0, 6.0, 4)))
        return Case((gains, draws, trained), label, level)

    whole = np.array([[6, 2], [12, 5]]), np.array([[2, 1, 3], [1, 0, 2], [3, 1, 5]]), 2
    return [
        carts("the nominal cart", "simple"),
        carts("other masses", "simple", mass=0.7),
        carts("other dampings", damping=2.0),
        *(carts("other delays", delay=8) for _ in range(2)),
        *(carts("all drawn", mass=0.7, damping=2.0, delay=8) for _ in range(4)),
        carts("the last cart is for the test", "edge", mass=0.7, delay=3, tested=1),
        carts("one cart to train on", "edge", mass=0.7, delay=3, trained=1),
        Case(whole, WHOLE, "edge"),
    ]


_LOOP = "            costs.append(rollout(kp, kd))\n            cart.update(nominal)\n"
_RESTORE = (_LOOP, "            cart.update(nominal)\n            costs.append(rollout(kp, kd))\n")
_DELAY = ("force = waiting.pop(0)", "force = waiting.pop(-1)")
_TEST = ("carts[trained:])", "carts[:trained])")

SLIPS = slips(
    restored_before_the_rollout=(
        *_RESTORE,
        "The cart is put back to nominal before it is driven: every draw is the same cart. As long "
        "as that is so, neither the delay nor the test can show what is wrong with them.",
    ),
    delay_drawn_and_unused=(
        *_DELAY,
        "The delay is drawn and never acts: a command has to wait behind as many zeros.",
    ),
    tested_on_the_training=(
        *_TEST,
        "The test uses the carts by which the gains were chosen: it can only agree.",
    ),
    delay_and_test=(
        *_DELAY,
        *_TEST,
        "The draws are driven now. The delay still does nothing, and the test is still on the "
        "carts of the training.",
    ),
    never_restored_delay=(
        "cart.update(mass=mass, damping=damping, delay=delay)",
        "cart.update(mass=mass, damping=damping, delay=max(delay, cart['delay']))",
        "cart.update(nominal)",
        "pass",
        "The delay of one cart is left over for the next.",
    ),
    one_sample_more=(
        '[0.0] * int(cart["delay"])',
        '[0.0] * (int(cart["delay"]) + 1)',
        "Each command acts a sample too late: with a delay of 0 it acts at once.",
    ),
    worst_chosen=(
        "np.argmin(costs)",
        "np.argmax(costs)",
        "The gains with the largest cost are chosen.",
    ),
)


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return costs to 1e-10, the row exactly."""
    return [1e-10, 0.0, 1e-10]


EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "rounding, over a hundred samples", explain=coarse),
    examples=(
        "tune_randomised([[8.0, 3.0], [12.0, 5.0]], [[1.0, 0.2, 0], [2.0, 0.5, 4]], 1)",
        "tune_randomised([[8.0, 3.0]], [[1.0, 0.2, 0], [1.0, 0.2, 10]], 1)",
    ),
    slips=SLIPS
    + coarse_slips("tune_randomised", "Two rows of gains are told apart by small differences.")
    + value_slips("tune_randomised"),
)
