"""The worked answers of chapter 12 against SciPy, small steps and everything written out."""

import ast
import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, norm

from drills import cards
from solutions import interview as solutions
from tests.budget import examples


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


def test_the_answers_stand_alone_and_have_their_places():
    nodes = list(ast.walk(ast.parse(Path(solutions.__file__).read_text(encoding="utf-8"))))
    assert not [
        node for node in nodes if isinstance(node, ast.Import) and node.names[0].name != "numpy"
    ]
    imported = {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    assert imported <= {"numpy.typing", "statistics"}
    mine = [card for card in cards.cards() if card.chapter == 12]
    assert [card.place for card in mine] == sorted({card.place for card in mine})
    assert all(card.solution == f"solutions.interview:{card.entry}" for card in mine)


# --- intervals and trials -------------------------------------------------------------------------


@examples(40)
@given(st.integers(1, 500), st.floats(0.0, 1.0), st.floats(0.05, 0.999))
def test_the_intervals_are_those_of_scipy(tried, part, confidence):
    solved = round(part * tried)
    low, high, _ = solutions.success_interval([solved], [tried], confidence, 0.5, 0.5)
    right = binomtest(solved, tried).proportion_ci(confidence, "wilson")
    np.testing.assert_allclose((low[0], high[0]), (right.low, right.high), atol=1e-12)


@examples(40)
@given(st.floats(0.0, 1.0), st.floats(0.003, 0.3), st.floats(0.5, 0.99))
def test_the_trials_are_the_first_whose_rates_lie_close_together(share, half, confidence):
    """The ends are the roots of (share - p)^2 = z^2 p (1 - p) / n."""
    z = norm.ppf(0.5 + confidence / 2.0)

    def width(n):
        ends = np.roots([1.0 + z**2 / n, -2.0 * share - z**2 / n, share**2])
        return abs(ends[0] - ends[1]) / 2.0

    n = solutions.success_interval([1], [2], confidence, share, half)[2]
    assert width(n) <= half + 1e-9
    assert n == 1 or width(n - 1) > half - 1e-9


# --- a person in the way --------------------------------------------------------------------------


@examples(25)
@given(rngs())
def test_the_way_is_that_of_small_steps(rng):
    reaction, slope, person, unsure, sight = rng.uniform(
        [0.0, -0.2, 0.0, 0.0, 0.2], [0.6, 0.15, 2.0, 0.3, 9.0]
    )
    args = reaction, 2.5, slope, person, unsure, sight
    along = np.array([np.cos(slope), -np.sin(slope)]) @ [0.0, -9.81]  # gravity on the way down
    dt = 1e-4

    def stops(kmh):
        t = dt * (np.arange(200_000) + 0.5)
        v = np.maximum(kmh * 1000.0 / 3600.0 + (along - 2.5) * np.maximum(t - reaction, 0.0), 0.0)
        still = max(dt * np.count_nonzero(v), reaction)
        return dt * v.sum(), dt * v.sum() + person * still + unsure

    speed = rng.uniform(0.0, 15.0)
    way, gap, top = solutions.stopping_distance([speed], *args)
    np.testing.assert_allclose((way[0], gap[0]), stops(speed), atol=1e-3)
    if top > 0.0:
        assert stops(top)[1] == pytest.approx(sight, abs=1e-3)
    else:
        assert stops(0.0)[1] > sight - 1e-3


# --- latency over a graph -------------------------------------------------------------------------


@examples(40)
@given(rngs(), st.integers(2, 6))
def test_the_budget_is_that_of_every_chain_written_out(rng, n):
    edges = [pair for pair in itertools.combinations(range(n), 2) if rng.random() < 0.5] + [(0, 1)]
    runs, periods = rng.random((n, 3)), rng.random(n) * rng.integers(0, 2, n)
    goal = max(b for a, b in edges if a == 0)
    chains = [
        (0, *middle, goal)
        for k in range(goal)
        for middle in itertools.combinations(range(1, goal), k)
        if all(pair in edges for pair in itertools.pairwise((0, *middle, goal)))
    ]
    lengths = {chain: sum(max(runs[i]) + periods[i] for i in chain) for chain in chains}
    through = [max((s for chain, s in lengths.items() if i in chain), default=0) for i in range(n)]
    name = rng.permutation(n)
    place = np.argsort(name)
    order = rng.permutation(len(edges))
    worst, left = solutions.latency_budget(
        name[np.array(edges)][order], runs[place], periods[place], name[0], name[goal], 2.0
    )
    assert worst == pytest.approx(max(lengths.values()))
    np.testing.assert_allclose(left[name], 2.0 - np.array(through), atol=1e-12)


# --- episodes in a buffer -------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(1, 5), st.booleans())
def test_each_episode_has_the_advantages_that_it_has_alone(rng, episodes, begun):
    """The double sum over each episode, whatever stands beside it in the buffer."""
    gamma, lam = rng.uniform(0.5, 1.0, 2)
    rows, finals, right, last = [], [], [], 0.0
    for k in range(episodes):
        n, over = int(rng.integers(1, 6)), rng.random() < 0.5
        reward, value = rng.normal(size=(2, n))
        last = rng.normal()
        if not over and k < episodes - 1:
            finals.append(last)
        ahead = [*value[1:], 0.0 if over else last]
        delta = reward + gamma * np.array(ahead) - value
        right += [sum((gamma * lam) ** (s - t) * delta[s] for s in range(t, n)) for t in range(n)]
        first = [int(k > 0 or not begun)] + [0] * (n - 1)
        rows += list(zip(reward, value, first, [0] * (n - 1) + [int(over)], strict=True))
    columns = list(np.array(rows).T)
    found, target = solutions.truncated_advantages(*columns, finals, last, gamma, lam)
    np.testing.assert_allclose(found, right, atol=1e-12)
    np.testing.assert_allclose(target - columns[1], right, atol=1e-12)


def test_a_reward_of_one_for_ever_leaves_nothing_to_learn_whatever_the_time_limit():
    """What is worth 1 / (1 - gamma) everywhere has no advantage anywhere, cut off or not."""
    gamma, n = 0.9, 12
    worth = 1.0 / (1.0 - gamma)
    starts = np.arange(n) % 4 == 0
    found, target = solutions.truncated_advantages(
        np.ones(n), np.full(n, worth), starts, np.zeros(n), [worth] * 2, worth, gamma, 0.95
    )
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    np.testing.assert_allclose(target, worth, atol=1e-12)
