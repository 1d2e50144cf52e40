"""Does shaping change the answer? Decision processes as arrays, solved exactly.

With the potential of a state subtracted and that of the next one added, discounted, a telescoped
sum remains: Q'(s, a) = Q(s, a) - phi(s), and the best action stays (Ng, Harada and Russell, Policy
invariance under reward transformations, 1999). At the end of an episode the sum leaves gamma^T
times the last potential, which depends on where it ended: there it has to be 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.sim_to_real.motion import CUBE
from course.sim_to_real.transfer import discount

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Process:
    """A finite decision process.

    Attributes:
        transition: probability of the next state, shape (S, A, S).
        reward: of each step, shape (S, A, S).
        gamma: discount, in [0, 1).
        terminal: states in which an episode has ended, shape (S,): they keep to themselves and pay
            nothing.

    Raises:
        ValueError: for rows that don't sum to 1, a terminal state that pays or can be left, a
            discount of 1.
    """

    transition: Array
    reward: Array
    gamma: float
    terminal: NDArray[np.bool_]

    def __post_init__(self) -> None:
        P = vector("transition", self.transition, (None, None, None), low=0.0, high=1.0)
        S, A, _ = P.shape
        if P.shape[2] != S:
            raise invalid("transition.shape", P.shape, f"({S}, {A}, {S})")
        R = vector("reward", self.reward, P.shape)
        ends = vector("terminal", self.terminal, (S,)) != 0.0
        discount(self.gamma)
        rows = P.sum(axis=2)
        if np.abs(rows - 1.0).max() > 1e-9:
            at = np.unravel_index(int(np.abs(rows - 1.0).argmax()), rows.shape)
            raise invalid(f"sum of transition[{at[0]}, {at[1]}]", float(rows[at]), "1")
        for s in np.flatnonzero(ends).tolist():
            if np.any(P[s, :, s] != 1.0):
                raise invalid(f"transition[{s}]", "one that leaves", "a terminal state that stays")
            if np.any(R[s] != 0.0):
                raise invalid(f"reward[{s}]", float(np.abs(R[s]).max()), "0 in a terminal state")
        for name, value in (("transition", P), ("reward", R), ("terminal", ends)):
            object.__setattr__(self, name, value)

    def backup(self, value: ArrayLike) -> Array:
        """Return Q of a value (S,).

        Reward of a step and discounted value of the next state, (S, A).
        """
        # Bellman backup: the expected reward plus the discounted value of the next state.
        target = self.reward + self.gamma * np.asarray(value, dtype=float)
        return np.asarray(np.einsum("ijk,ijk->ij", self.transition, target))


@dataclass(frozen=True)
class Solution:
    """Value (S,), Q (S, A), a best policy (S,), and how many sweeps or solves it took."""

    value: Array
    q: Array
    policy: NDArray[np.int64]
    sweeps: int


def value_iteration(
    process: Process, tolerance: float = 1e-12, *, max_sweeps: int = 50_000
) -> Solution:
    """Solve a process with value iteration, then evaluate its policy exactly.

    The method is Bellman's (Puterman, Markov Decision Processes, 1994).

    Each sweep multiplies the error by gamma at best, so the number of sweeps is proportional to
    1 / (1 - gamma): hundreds of thousands at 0.9999. `policy_iteration` needs a few solves.

    Args:
        process: any.
        tolerance: of the value at the end, relative to its size.
        max_sweeps: limit on the sweeps, after which a ValueError is raised.
    """
    value, sweeps = np.zeros(process.transition.shape[0]), 0
    positive("tolerance", tolerance)
    count("max_sweeps", max_sweeps, 1)
    while True:
        if sweeps == max_sweeps:
            rule = "more: the tolerance is not reached; near a discount of 1 use policy_iteration"
            raise invalid("max_sweeps", max_sweeps, rule)
        # Bellman's optimality operator on all states at once.
        following = process.backup(value).max(axis=1)
        change, value, sweeps = np.abs(following - value).max(), following, sweeps + 1
        small = tolerance * max(1.0, float(np.abs(value).max()))
        # Contraction: the distance from the fixed point is at most gamma / (1 - gamma) times the
        # change.
        if change * process.gamma <= small * (1.0 - process.gamma):
            break
    # The greedy policy's value by a linear solve does not carry the error of the sweeps.
    policy = process.backup(value).argmax(axis=1)
    exact = evaluate_policy(process, policy)
    return Solution(exact, process.backup(exact), policy, sweeps)


def policy_iteration(process: Process) -> Solution:
    """Run Howard's policy iteration (1960): evaluate exactly, make greedy, until nothing changes.

    Its number of solves does not depend on the discount, where that of the sweeps of
    `value_iteration` is proportional to 1 / (1 - gamma). An action is replaced only by one that is
    better by more than rounding, and it ends when the value no longer rises, so ties can't cycle.

    Args:
        process: any.
    """
    rows = np.arange(process.transition.shape[0])
    policy, solves, before = process.backup(np.zeros(rows.size)).argmax(axis=1), 0, -np.inf
    while True:
        value = evaluate_policy(process, policy)
        q, solves = process.backup(value), solves + 1
        # Only a strict improvement changes the policy, so rounding cannot make it alternate.
        better = q.max(axis=1) > q[rows, policy] + 1e-12 * np.abs(q).max()
        if not better.any() or value.sum() <= before:
            return Solution(value, q, q.argmax(axis=1), solves)
        policy, before = np.where(better, q.argmax(axis=1), policy), value.sum()


def evaluate_policy(process: Process, policy: ArrayLike) -> Array:
    """Return the value of a policy by a linear solve, shape (S,).

    Args:
        process: any.
        policy: an action for each state, whole numbers (S,), or probabilities (S, A).
    """
    S, A, _ = process.transition.shape
    chosen = vector("policy", policy, (S,), (S, A), low=0.0)
    if chosen.ndim == 1:
        if np.any(chosen != np.round(chosen)) or chosen.max() >= A:
            raise invalid("policy", chosen, f"integers from 0 to {A - 1}")
        chosen = np.eye(A)[chosen.astype(int)]
    elif np.abs(chosen.sum(axis=1) - 1.0).max() > 1e-9:
        raise invalid("policy", chosen, "rows that sum to 1")
    # Transition and mean reward of the Markov chain that the policy makes.
    P = np.einsum("ij,ijk->ik", chosen, process.transition)
    r = np.einsum("ij,ijk,ijk->i", chosen, process.transition, process.reward)
    # Value of a policy: (I - gamma P) v = r.
    return np.asarray(np.linalg.solve(np.eye(S) - process.gamma * P, r))


def shaped(process: Process, phi: ArrayLike, *, free_end: bool = False) -> Process:
    """Return the process with gamma phi(next) - phi(state) added to its rewards.

    Args:
        process: any; what a terminal state pays stays 0.
        phi: potential of each state, shape (S,).
        free_end: keep the potential of terminal states as it is, which is the mistake; it counts
            as 0 otherwise.
    """
    potential = vector("phi", phi, process.terminal.shape).copy()
    if not free_end:
        # The potential of a terminal state is 0, else shaping changes the best policy.
        potential[process.terminal] = 0.0
    # Potential-based shaping: gamma phi(next) - phi(state) (Ng, Harada and Russell, 1999).
    added = process.gamma * potential[None, None] - potential[:, None, None]
    # A terminal state pays nothing, shaped or not.
    added = np.where(process.terminal[:, None, None], 0.0, added)
    return replace(process, reward=process.reward + added)


def grid(n: int, gamma: float = 0.95, pay: float = 1.0, step: float = 0.0) -> Process:
    """Return n x n cells, state = n row + column, four moves.

    The last cell ends the episode and pays.

    Args:
        n: from 2 on.
        gamma: discount.
        pay: for entering the last cell.
        step: reward of each move, such as -1.
    """
    S = count("n", n, 2) ** 2
    P = np.zeros((S, 4, S))
    for s in range(S - 1):
        for a, (down, right) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
            # A move against the border stays in its cell.
            row, column = np.clip((s // n + down, s % n + right), 0, n - 1)
            P[s, a, n * row + column] = 1.0
    P[S - 1, :, S - 1] = 1.0
    ends = np.arange(S) == S - 1
    reward = np.full((S, 4, S), finite("step", step))
    reward[:, :, S - 1] += finite("pay", pay)
    reward[S - 1] = 0.0
    return Process(P, reward, gamma, ends)


def _learn(P, R, ends, numbers, draws, optimal, q):
    """Run Q-learning from state 0; return the steps until the greedy walk is optimal, or -1."""
    gamma, rate, chance = numbers[0], numbers[1], numbers[2]
    S, A = q.shape
    state, limit = 0, draws.shape[0]
    for k in range(limit):
        action = int(draws[k, 1] * A)
        # Epsilon-greedy action.
        if draws[k, 0] >= chance:
            action = int(np.argmax(q[state]))
        # Sample the successor from its distribution.
        following, rest = 0, draws[k, 2]
        while following < S - 1 and rest >= P[state, action, following]:
            rest -= P[state, action, following]
            following += 1
        # The temporal-difference target has no future after a terminal state.
        ahead = 0.0 if ends[following] > 0.0 else gamma * np.max(q[following])
        q[state, action] += rate * (R[state, action, following] + ahead - q[state, action])
        state = following
        # The episode is over: the next one begins in state 0.
        if ends[state] > 0.0:
            state = 0
        if k % 20 == 19:  # the greedy walk from the start, where each state has one best successor
            s, walked = 0, 0
            while ends[s] == 0.0 and walked <= S:
                s = int(np.argmax(P[s, np.argmax(q[s])]))
                walked += 1
            if ends[s] > 0.0 and walked <= optimal:
                return k + 1
    return -1


_learn_loop = loop(_learn, numba.int64(CUBE, CUBE, VECTOR, VECTOR, MATRIX, numba.int64, MATRIX))


def learning_steps(
    process: Process,
    rng: np.random.Generator,
    optimal: int,
    *,
    start: ArrayLike = 0.0,
    at_most: int = 100_000,
    rate: float = 0.5,
    chance: float = 0.1,
) -> float:
    """Return how many steps Q-learning (Watkins, 1989) needs to find a shortest walk.

    It has found one when its greedy walk from state 0 is shortest.

    Shaped by phi it does what it does unshaped with values that start at phi (Wiewiora, 2003): so a
    potential that is too high makes it try everything, one that is too low nothing new.

    Args:
        process: with moves that are certain, such as `grid`.
        rng: of the exploration.
        optimal: length of a shortest walk.
        start: of Q, a number or one for each state (S,).
        at_most: steps after which it is given up.
        rate: learning rate.
        chance: probability of a random action.

    Returns:
        Steps; infinite if they were not enough.
    """
    S, A, _ = process.transition.shape
    q = np.tile(np.broadcast_to(vector("start", start, (), (S,)), (S,))[:, None], (1, A))
    numbers = np.array(
        [process.gamma, finite("rate", rate, 0.0, 1.0), finite("chance", chance, 0.0, 1.0)]
    )
    steps = _learn_loop(
        np.ascontiguousarray(process.transition),
        np.ascontiguousarray(process.reward),
        process.terminal.astype(float),
        numbers,
        rng.random((count("at_most", at_most, 1), 3)),
        count("optimal", optimal, 1),
        q,
    )
    return float(steps) if steps > 0 else np.inf
