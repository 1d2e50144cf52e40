"""Decision processes: against enumeration of all policies, walks counted by hand, and algebra."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.sim_to_real.shaping import (
    Process,
    evaluate_policy,
    grid,
    learning_steps,
    policy_iteration,
    shaped,
    value_iteration,
)
from tests.budget import examples


def drawn(seed: int, S: int = 6, A: int = 2, ends: int = 0, gamma: float = 0.95) -> Process:
    rng = np.random.default_rng(seed)
    P, R = rng.dirichlet(np.full(S, 0.3), (S, A)), rng.normal(size=(S, A, S))
    terminal = np.arange(S) >= S - ends
    P[terminal], R[terminal] = np.eye(S)[terminal][:, None], 0.0
    return Process(P, R, gamma, terminal)


@examples(8)
@given(seed=st.integers(0, 10_000), ends=st.integers(0, 2), gamma=st.floats(0.0, 0.97))
def test_the_best_policy_is_the_best_of_all(seed, ends, gamma):
    process = drawn(seed, ends=ends, gamma=gamma)
    result = value_iteration(process)
    every = np.array([evaluate_policy(process, p) for p in product(range(2), repeat=6)])
    assert np.abs(result.value - every.max(axis=0)).max() < 1e-9
    assert np.abs(result.q.max(axis=1) - result.value).max() < 1e-9
    mixed = np.random.default_rng(seed).dirichlet(np.ones(2), 6)
    value = evaluate_policy(process, mixed)
    assert np.abs((mixed * process.backup(value)).sum(axis=1) - value).max() < 1e-9


@examples(20)
@given(seed=st.integers(0, 10_000), ends=st.integers(0, 2))
def test_shaping_takes_the_potential_off_q_and_leaves_the_best_policy(seed, ends):
    process, phi = drawn(seed, ends=ends), 5.0 * np.random.default_rng(seed + 1).normal(size=6)
    before, after = value_iteration(process), value_iteration(shaped(process, phi))
    inner = ~process.terminal
    assert np.abs(after.q - (before.q - phi[:, None]))[inner].max() < 1e-11
    assert np.abs(evaluate_policy(process, after.policy) - before.value).max() < 1e-9


def test_a_free_potential_at_the_end_changes_the_answer():
    """By exactly what is expected of it: the process that pays the potential for ending there."""
    changed = 0
    for seed in range(40):
        process, phi = drawn(seed, ends=2), 5.0 * np.random.default_rng(seed).normal(size=6)
        free = value_iteration(shaped(process, phi, free_end=True))
        paid = process.reward + np.where(process.terminal, process.gamma * phi, 0.0)
        paid[process.terminal] = 0.0
        equal = value_iteration(Process(process.transition, paid, 0.95, process.terminal))
        assert np.abs(free.q - (equal.q - phi[:, None]))[:4].max() < 1e-10
        lost = value_iteration(process).value - evaluate_policy(process, free.policy)
        changed += bool(lost.max() > 1e-9)
    assert changed > 20


def test_a_constant_step_penalty_is_a_potential_where_nothing_ends():
    """phi = c / (1 - gamma) everywhere costs every step c; with an end it favours long walks."""
    process = drawn(5)
    phi = np.full(6, 0.3 / 0.05)
    assert np.abs(shaped(process, phi).reward - (process.reward - 0.3)).max() < 1e-12
    tired = grid(3, step=-1.0, pay=0.0)
    assert value_iteration(tired).value[0] == pytest.approx(-(1.0 - 0.95**4) / 0.05)
    assert np.all(value_iteration(grid(3, pay=0.0)).value == 0.0)


def test_the_grid_and_its_learner():
    for n in (2, 4):
        walk = grid(n, gamma=0.9, pay=2.0)
        value = value_iteration(walk).value
        steps = 2 * (n - 1) - np.arange(n)[:, None] - np.arange(n)
        expected = np.where(steps > 0, 2.0 * 0.9 ** (steps - 1.0), 0.0)
        assert np.abs(value.reshape(n, n) - expected).max() < 1e-12
    walk = grid(6)
    known = shaped(walk, value_iteration(walk).value)
    runs = {
        name: [learning_steps(p, np.random.default_rng(seed), 10) for seed in range(5)]
        for name, p in (("plain", walk), ("known", known))
    }
    assert max(runs["known"]) < min(runs["plain"])
    assert np.isinf(learning_steps(walk, np.random.default_rng(0), 10, at_most=20))


@pytest.mark.parametrize("scale", [-1.0, 0.5])
def test_learning_with_a_potential_is_learning_that_starts_from_it(scale):
    """Wiewiora (2003), to the last step: the numbers are halves of halves, so none is rounded."""
    walk, phi = grid(4, gamma=0.5), scale * np.arange(16) / 16.0
    phi[-1] = 0.0
    for seed in range(5):
        runs = [
            learning_steps(p, np.random.default_rng(seed), 6, start=start)
            for p, start in ((shaped(walk, phi), 0.0), (walk, phi))
        ]
        assert runs[0] == runs[1] < np.inf


@pytest.mark.parametrize("gamma", [0.5, 0.95, 0.999, 0.999_999])
def test_policy_iteration_needs_few_solves_at_any_discount(gamma):
    """Against Bellman's equation itself, and against value iteration where that ends soon."""
    for seed in range(12):
        process = drawn(seed, ends=seed % 2, gamma=gamma)
        solution = policy_iteration(process)
        size = max(1.0, np.abs(solution.value).max())
        residual = process.backup(solution.value).max(axis=1) - solution.value
        assert np.abs(residual).max() < 1e-9 * size
        assert solution.sweeps < 10
        if gamma < 0.99:
            assert np.abs(solution.value - value_iteration(process).value).max() < 1e-11 * size
    everywhere_equal = policy_iteration(replace(grid(3, pay=0.0), gamma=gamma))
    assert everywhere_equal.sweeps == 1 and not everywhere_equal.value.any()


P2 = np.eye(2)[:, None]
NONE, ALL = np.zeros(2, dtype=bool), np.ones(2, dtype=bool)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: Process(0.9 * P2, 0.0 * P2, 0.9, NONE),
            r"sum of transition\[0, 0\] must be .*, got 0.9",
        ),
        (lambda: Process(P2, P2, 0.9, ALL), r"reward\[0\] must be 0.*, got 1.0"),
        (lambda: Process(P2[::-1], 0.0 * P2, 0.9, ALL), r"transition\[0\] must be"),
        (lambda: Process(P2, P2, 1.0, NONE), r"gamma must be .*, got 1.0"),
        (lambda: Process(P2, P2[:1], 0.9, NONE), "reward.shape"),
        (lambda: evaluate_policy(drawn(1), np.full(6, 2)), "policy must be"),
        (lambda: evaluate_policy(drawn(1), np.full((6, 2), 0.4)), "policy must be"),
        (lambda: shaped(drawn(1), np.zeros(3)), "phi.shape must be"),
        (
            lambda: value_iteration(replace(drawn(1), gamma=0.999), max_sweeps=100),
            r"max_sweeps must be .*policy_iteration.*, got 100",
        ),
        (lambda: value_iteration(drawn(1), max_sweeps=0), r"max_sweeps must be .*, got 0"),
        (
            lambda: learning_steps(grid(2), np.random.default_rng(0), 2, chance=np.nan),
            "chance must be",
        ),
        (
            lambda: learning_steps(grid(2), np.random.default_rng(0), 2, chance=5.0),
            r"chance must be .*, got 5",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
