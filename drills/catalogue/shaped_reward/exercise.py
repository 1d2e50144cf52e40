"""Shaped rewards: one step, one episode, then logs with ends of both kinds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return walks among ten states; those from 7 on are terminal."""

    def log(
        label: str,
        level: str = "core",
        *,
        n: int = 12,
        ends: str = "",
        gamma: float = 0.0,
        high: float = 5.0,
    ) -> Case:
        state, following = rng.integers(0, 7, n), rng.integers(0, 7, n)
        terminated, truncated = np.zeros(n, int), np.zeros(n, int)
        for t in range(n):
            if t % 4 == 3 and ends:
                kind = ends if ends != "both" else ("terminal", "limit")[t // 4 % 2]
                terminated[t], truncated[t] = kind == "terminal", kind == "limit"
                following[t] = rng.integers(7, 10) if terminated[t] else following[t]
            elif t + 1 < n:
                state[t + 1] = following[t]
        phi = rng.uniform(-high, high, 10)
        args = state, following, rng.normal(size=n), terminated, truncated, phi
        return Case((*args, gamma or float(rng.uniform(0.5, 0.98))), label, level)

    whole = (
        np.array([0, 2, 1]),
        np.array([2, 3, 0]),
        np.array([1, 0, -1]),
        np.array([0, 1, 0]),
        np.array([0, 0, 1]),
        np.array([4, -3, 2, 6]),
        0.75,  # with 0.5 every result is an integer, and an answer that truncates passes
    )
    return [
        log("one step", "simple", n=1),
        log("no end", "simple", n=6),
        log("no end", "simple"),
        *(log("ends of an episode", ends="terminal") for _ in range(3)),
        *(log("time limits", ends="limit") for _ in range(3)),
        *(log("ends and time limits", ends="both", n=40) for _ in range(3)),
        log("a flat potential", "edge", high=1e-9, ends="both"),
        log("no discount", "edge", gamma=1.0, ends="both"),
        log("no steps", "edge", n=0),
        Case(whole, WHOLE, "edge"),
    ]


_ENDED = "ended = np.asarray(terminated) != 0"

SLIPS = slips(
    terminal_potential_kept=(
        "np.where(ended, 0.0, potential[np.asarray(following)])",
        "potential[np.asarray(following)]",
        "The potential of a terminal state is kept. The sum then leaves gamma^T times it, which "
        "depends on where the episode ended: the best policy may change. It counts as 0 there.",
    ),
    time_limit_taken_for_an_end=(
        _ENDED,
        "ended = (np.asarray(terminated) != 0) | (np.asarray(truncated) != 0)",
        "A time limit is taken for an end. This learner bootstraps there: the potential stays.",
    ),
    gamma_on_the_wrong_term=(
        "gamma * ahead - potential[np.asarray(state)]",
        "ahead - gamma * potential[np.asarray(state)]",
        "The discount is on the potential behind. It belongs to the one ahead, or the sum does not "
        "telescope.",
    ),
    gamma_forgotten=(
        "gamma * ahead",
        "ahead",
        "The potential ahead is not discounted: what is added does not telescope.",
    ),
    potential_of_the_start=(
        "gamma * ahead - potential[np.asarray(state)]",
        "potential[np.asarray(state)]",
        "The potential of the state in which the action is taken is paid as a reward. Then it "
        "pays to stay where it is high; it is the difference that changes nothing.",
    ),
    sign_turned=(
        "gamma * ahead - potential[np.asarray(state)]",
        "potential[np.asarray(state)] - gamma * ahead",
        "The difference has the wrong sign: going uphill is punished.",
    ),
    next_row_for_next_state=(
        "potential[np.asarray(following)])",
        "np.append(potential[np.asarray(state)][1:], potential[np.asarray(following)][-1:]))",
        "The next row's state is taken for the state ahead. After an end or a time limit the next "
        "row is the start of another episode.",
    ),
)


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-12 of the largest number."""
    return 1e-12 * max(1.0, float(np.abs(truth[0]).max(initial=0.0)))


EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "two additions and a product", explain=coarse),
    examples=(
        "shaped_reward([0, 1], [1, 2], [0.0, 1.0], [0, 1], [0, 0], [1.0, 2.0, 5.0], 0.9)",
        "shaped_reward([0, 1], [1, 2], [0.0, 1.0], [0, 0], [0, 1], [1.0, 2.0, 5.0], 0.9)",
    ),
    slips=SLIPS
    + coarse_slips("shaped_reward", "What is left of a telescoped sum is a small difference.")
    + value_slips("shaped_reward", in_part=False),
)
