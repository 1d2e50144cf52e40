"""The worked answers beside the chapter's own functions, and beside all ways written out."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.role import Stage, age, simulate
from solutions.role import blind_distance, chain_age, log_age, over_budget
from tests.budget import examples


@examples(40)
@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.01), st.sampled_from((0.0, 0.02, 0.05, 0.11))),
        min_size=1,
        max_size=6,
    )
)
def test_ages_are_those_of_the_chapter(stages):
    C, T = np.array(stages).T
    T[0] = T[0] or 0.03
    message = age([Stage(f"{i}", c, t or None) for i, (c, t) in enumerate(zip(C, T, strict=True))])
    assert chain_age(C, T) == pytest.approx([message.least, message.mean, message.greatest])


def test_ages_of_a_log_are_those_of_the_simulation():
    camera = Stage("camera", 0.05, 1 / 30, overload="pipelined", jitter=0.04)
    run = simulate([camera], [0.2], 3, 5.0)
    times = np.linspace(0.5, 4.9, 300)
    order = np.random.default_rng(0).permutation(run.published.size)
    result = log_age(run.captured[order], run.published[order], times)
    assert result == pytest.approx(run.age(times))
    assert log_age([0.0], [1.0], [0.5, 1.0]).tolist() == [-1.0, 1.0]


@pytest.mark.parametrize("seed", range(20))
def test_the_critical_path_is_the_longest_of_all(seed):
    rng = np.random.default_rng(seed)
    n = 6
    pairs = [
        p for p in itertools.combinations(range(n), 2) if p[1] == p[0] + 1 or rng.random() < 0.6
    ]
    taken, allowed = rng.random((2, len(pairs)))
    latency = {pair: t for pair, t in zip(pairs, taken, strict=True)}
    paths = [
        list(itertools.pairwise((0, *middle, n - 1)))
        for k in range(n - 1)
        for middle in itertools.combinations(range(1, n - 1), k)
    ]
    paths = [method for method in paths if all(pair in latency for pair in method)]
    longest = max(paths, key=lambda method: sum(latency[pair] for pair in method))
    late = [pairs.index(p) for p in longest if latency[p] > allowed[pairs.index(p)]]
    order = rng.permutation(len(pairs))
    edge, total = over_budget(np.array(pairs)[order], taken[order], allowed[order], 0, n - 1)
    assert total == pytest.approx(sum(latency[pair] for pair in longest))
    assert (order[edge] if edge >= 0 else -1) == (late[0] if late else -1)


@pytest.mark.parametrize("seed", range(5))
def test_a_robot_is_blind_until_the_tick_after_the_last_stage(seed):
    """Phases of the clock in equal steps: the result waits for the next tick."""
    rng = np.random.default_rng(seed)
    latencies, period, speed = rng.uniform(0.01, 0.1, 3), 0.02, np.array([0.5, 2.0])
    arrival = latencies.sum()
    phase = (np.arange(20000) + 0.5) / 20000 * period
    age = phase + np.ceil((arrival - phase) / period) * period
    mean, worst = blind_distance(latencies, period, speed)
    assert mean == pytest.approx(speed * age.mean(), rel=1e-4)
    assert worst == pytest.approx(speed * age.max(), rel=1e-4)
