"""Tasks for imitation: what is known of them exactly, against what is simulated."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import linalg, optimize, stats

from course.learning import (
    Circle,
    Regulator,
    Runs,
    TwoWays,
    accumulated,
    context_costs,
    expected_cost,
    roll,
    runs,
    windows,
)
from tests.budget import examples

WAYS = TwoWays()


def exponent(x, y):
    return np.polyfit(np.log(x), np.log(y), 1)[0]


# --- runs -----------------------------------------------------------------------------------------


def test_a_window_is_what_follows_a_step():
    shown = WAYS.demonstrate(5, 3)
    states, chunks = windows(shown, 6)
    assert states.shape == (80, 2) and chunks.shape == (80, 6, 2)
    for run in range(5):
        for k in range(16):
            row, remaining = 16 * run + k, 16 - k
            assert np.array_equal(states[row], shown.states[run, k])
            assert np.array_equal(chunks[row, :remaining], shown.actions[run, k : k + 6])
            assert not chunks[row, remaining:].any()


def test_demonstrations_obey_the_task():
    rng = np.random.default_rng(1)
    shown = WAYS.demonstrate(20, 1, pause=3)
    taken = iter(np.swapaxes(shown.actions, 0, 1))
    again = roll(WAYS, lambda states, rng: next(taken), shown.states[:, 0], 19, rng)
    assert np.allclose(again.states, shown.states, atol=1e-12)
    still = np.all(shown.actions == 0.0, axis=2)
    assert np.array_equal(np.flatnonzero(still.all(axis=0)), [4, 5, 6])
    lone = runs(list(shown.states), list(shown.actions))
    assert np.array_equal(lone.states, shown.states) and np.array_equal(lone.actions, shown.actions)


def test_noise_injected_moves_the_task_and_is_not_recorded():
    rng = np.random.default_rng(4)
    ran = roll(WAYS, lambda states, rng: -states, np.ones((500, 2)), 8, rng, injected=0.3)
    assert np.array_equal(ran.actions, -ran.states[:, :-1])
    assert ran.states[:, 1:].std() == pytest.approx(0.3, rel=0.05)
    disturbed = TwoWays(noise=0.2)
    ran = roll(disturbed, lambda states, rng: -states, np.ones((500, 2)), 8, rng)
    assert ran.states[:, 1:].std() == pytest.approx(0.2, rel=0.05)


def test_bad_demonstrations_are_refused_by_name():
    shown = WAYS.demonstrate(3, 0)
    states, actions = list(shown.states), list(shown.actions)
    for bad_states, bad_actions, report in (
        ([], [], "two runs or more"),
        (states[:1], actions[:1], "two runs or more"),
        (states, actions[:2], "as many of both"),
        ([*states[:2], states[2][:-1]], actions, r"states\[2\].shape must be .*, got \(16, 2\)"),
        (states, [*actions[:2], actions[2][:-1]], r"actions\[2\].shape must be .*, got \(15, 2\)"),
        ([s[:-1] for s in states], actions, "one fewer than the states"),
        (
            states,
            [actions[0], actions[1] * np.nan, actions[2]],
            r"actions\[1\]\[0, 0\] must be .*, got nan",
        ),
    ):
        with pytest.raises(ValueError, match=report):
            runs(bad_states, bad_actions)
    with pytest.raises(ValueError, match=r"length must be an integer from 1 to 16.*, got 17"):
        windows(shown, 17)
    with pytest.raises(ValueError, match=r"demonstrations must be .*, got 1"):
        windows(Runs(shown.states[:1], shown.actions[:1]), 4)
    with pytest.raises(ValueError, match=r"action at step 2\[0, 0\] must be .*, got nan"):
        text = iter([0.0, 0.0, np.nan])
        rng = np.random.default_rng(0)
        roll(WAYS, lambda states, rng: np.full((1, 2), next(text)), np.zeros((1, 2)), 5, rng)


# --- two ways -------------------------------------------------------------------------------------


def test_every_demonstration_passes_and_the_sides_are_drawn():
    for remaining, seed in ((0.5, 0), (0.8, 1), (1.0, 2)):
        side = WAYS.sides(WAYS.demonstrate(2000, seed, left=remaining).states)
        assert np.all(side != 0)
        assert stats.binomtest(int(np.sum(side > 0)), 2000, remaining).pvalue > 1e-3
    assert np.all(WAYS.sides(WAYS.demonstrate(100, 4, pause=7).states) != 0)
    first, again, other = (WAYS.demonstrate(9, seed).states for seed in (7, 7, 8))
    assert np.array_equal(first, again) and not np.allclose(first, other)


@examples(60)
@given(st.integers(0, 2**31), st.floats(0.02, 0.4))
def test_a_side_is_that_of_the_way_between_its_points(seed, spread):
    """Against points along the ways, a thousand to a step, and the mirror image."""
    rng = np.random.default_rng(seed)
    direction = np.linspace([0.0, 0.0], [1.0, 0.0], 6) + spread * rng.standard_normal((30, 6, 2))
    report = WAYS.sides(direction)
    part = np.linspace(0.0, 1.0, 1001)[:, None]
    along = direction[:, :-1, None] * (1.0 - part) + direction[:, 1:, None] * part
    nearest = np.hypot(along[..., 0] - 0.5, along[..., 1]).min(axis=(1, 2))
    other = np.hypot(direction[:, -1, 0] - 1.0, direction[:, -1, 1]) <= 0.15
    sure = np.abs(nearest - 0.2) > 1e-3
    assert np.array_equal((report != 0)[sure], ((nearest > 0.2) & other)[sure])
    assert np.array_equal(WAYS.sides(direction * [1.0, -1.0]), -report)


# --- contexts -------------------------------------------------------------------------------------


@examples(25)
@given(st.integers(1, 60), st.integers(2, 80), st.booleans(), st.integers(0, 2**31))
def test_the_cost_of_a_copied_table_is_the_formula(wrong, steps, recovers, seed):
    table = np.arange(200) < wrong
    costs = context_costs(table, steps, 2000, np.random.default_rng(seed), recovers=recovers)
    mean = expected_cost(table.mean(), steps, recovers=recovers)
    error = max(costs.std(), 0.05) / np.sqrt(2000)
    assert abs(costs.mean() - mean) < 5.0 * error
    if not recovers:
        summed = sum(1.0 - (1.0 - table.mean()) ** t for t in range(1, steps + 1))
        assert mean == pytest.approx(summed, rel=1e-9)


def test_errors_grow_with_the_square_only_while_they_are_rare():
    steps = np.array([5, 10, 20, 40, 80])
    rng, table = np.random.default_rng(0), np.arange(1000) < 1
    for recovers, least, largest in ((False, 1.9, 1.95), (True, 0.999, 1.001)):
        exact = exponent(steps, expected_cost(0.001, steps, recovers=recovers))
        costs = [context_costs(table, T, 40_000, rng, recovers=recovers).mean() for T in steps]
        assert least < exact < largest and exponent(steps, costs) == pytest.approx(exact, abs=0.06)
    assert exponent(steps, expected_cost(0.3, steps, recovers=False)) < 1.25  # nearly all is lost
    for eps in (1e-4, 0.01, 0.3):  # the law eps T^2 / 2 bounds it, and holds to eps T / 3
        law = eps * steps * (steps + 1) / 2
        exact = expected_cost(eps, steps, recovers=False)
        assert np.all(exact <= law * (1 + 1e-9)) and np.all(exact <= steps)
        assert np.all(1.0 - exact / law <= eps * steps / 3 + 1e-9)
    assert expected_cost(0.0, 7, recovers=False) == 0.0


def test_a_constant_error_adds_up_as_the_system_lets_it():
    T = np.arange(1, 401)
    for a, e in ((0.9, 0.1), (0.99, -0.2), (-0.5, 0.1)):
        x = e * (1.0 - a**T) / (1.0 - a)
        assert np.allclose(accumulated(a, e, 400), np.cumsum(np.abs(x)), rtol=1e-10)
    assert np.allclose(accumulated(1.0, 0.1, 400), 0.1 * T * (T + 1) / 2)
    growth = np.diff(np.log(accumulated(1.1, 0.1, 400)))
    assert growth[-1] == pytest.approx(np.log(1.1), rel=1e-9)


# --- regulator and circle -------------------------------------------------------------------------


@examples(40)
@given(st.floats(0.5, 20.0), st.floats(0.01, 0.2), st.floats(0.3, 3.0), st.floats(1.2, 4.0))
def test_the_regulator_is_the_exact_step_with_the_roots_it_says(stiffness, dt, slow, ratio):
    task = Regulator(stiffness, dt, slow, ratio * slow)
    block = np.zeros((3, 3))
    block[:2] = [[0.0, 1.0, 0.0], [stiffness, 0.0, 1.0]]
    exact = linalg.expm(block * dt)
    assert np.allclose(task.A, exact[:2, :2], atol=1e-12) and np.allclose(task.B, exact[:2, 2])
    roots = np.sort(np.linalg.eigvals(task.closed(task.K)).real)
    assert np.allclose(roots, np.exp([-ratio * slow * dt, -slow * dt]), atol=1e-9)
    assert task.radius(task.K) < 1.0 < task.radius([0.0, 0.0])
    mode = task.slow_mode()
    assert np.allclose(task.closed(task.K) @ mode, np.exp(-slow * dt) * mode, atol=1e-9)


def test_the_cart_drives_arcs_and_its_expert_comes_to_the_circle():
    task, rng = Circle(), np.random.default_rng(2)
    start = task.starts(40, rng)
    turn = rng.uniform(-3.0, 3.0, (40, 1))
    moved, fine = task.step(start, turn, rng), start
    for _ in range(2000):  # the same rate in steps of 0.05 ms
        fine = Circle(task.dt / 2000).step(fine, turn, rng)
    assert np.allclose(moved, fine, atol=1e-10)
    heading = np.arctan2(start[:, 3], start[:, 2])
    centre = start[:, :2] + np.stack((-np.sin(heading), np.cos(heading)), 1) / turn
    radius = [np.hypot(*(end[:, :2] - centre).T) for end in (start, moved)]
    assert np.allclose(radius[0], radius[1], atol=1e-9)

    far = task.cost(roll(task, task.expert, start, 60, rng).states)
    assert far[:, 0].max() > 0.05 and far[:, -1].max() < 1e-4

    def envelope(t, size, share):  # a double root at -2: (size + share t) exp(-2 t)
        return (size + share * t) * np.exp(-2.0 * t)

    small = start.copy()  # linear only near the circle: start very near
    small[:, :2] *= (1.0 + 1e-4 * far[:, :1]) / np.hypot(*start[:, :2].T)[:, None]
    place = np.arctan2(small[:, 1], small[:, 0])
    small[:, 2:] = np.stack((-np.sin(place), np.cos(place)), 1)
    fast = Circle(0.001)
    report = fast.cost(roll(fast, fast.expert, small, 2000, rng).states)[:, ::100]
    t = 0.1 * np.arange(21)
    for run in report[:3]:
        fit, _ = optimize.curve_fit(envelope, t, run / run[0])
        assert fit == pytest.approx([1.0, 2.0], abs=0.02)
