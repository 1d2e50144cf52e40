"""What mending does, how many trials tell, and the bound: by counting, enumeration, brute force."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from course.measure.success import paired, trials
from course.sim_to_real import plants, real, rollouts, tasks
from course.sim_to_real.transfer import (
    KINDS,
    PARTS,
    attribution,
    harmful_corrections,
    mended,
    share_of_bound,
    subsets,
    transfer_bound,
)
from tests.budget import examples


def test_each_parameter_is_mended_by_one_part_and_all_of_them_give_the_real_arm():
    assert sorted(f for part in PARTS.values() for f in part) == sorted(plants.FIELDS)
    assert sorted(part for kind in KINDS.values() for part in kind) == sorted(PARTS)
    arms = real(np.array([0.3, 1.0]), 0.01)
    assert np.array_equal(mended(arms, PARTS).columns(), arms.columns())
    assert np.array_equal(mended(arms, KINDS).columns(), arms.columns())
    assert np.array_equal(mended(arms, ()).columns(), plants.nominal(2).columns())
    alone = mended(arms, ["delay"])
    assert alone.delay.tolist() == [0.01, 0.01]
    assert alone.mass.tolist() == [1.0, 1.0]


@examples(10)
@given(seed=st.integers(0, 10_000))
def test_the_average_is_that_of_all_orders_and_adds_up(seed):
    names, rng = ["a", "b", "c", "d"], np.random.default_rng(seed)
    value = {some: float(rng.normal()) for some in subsets(names)}
    assert len(value) == 16
    result = attribution(value)
    gains: dict[str, list[float]] = {name: [] for name in names}
    for order in permutations(names):
        for i, name in enumerate(order):
            gains[name].append(value[frozenset(order[: i + 1])] - value[frozenset(order[:i])])
    for name, (alone, average, last) in result.items():
        assert average == pytest.approx(np.mean(gains[name]), abs=1e-12)
        assert alone == value[frozenset(name)] - value[frozenset()]
        assert last == value[frozenset(names)] - value[frozenset(names) - {name}]
    worse = harmful_corrections(value)
    assert all(value[some | {part}] - value[some] == change < 0.0 for some, part, change in worse)
    assert len(worse) == sum(v < 0.0 for row in gains.values() for v in set(row))
    assert worse == sorted(worse, key=lambda row: row[2])


@pytest.mark.parametrize(
    ("p", "q", "both"), [(0.78, 0.87, None), (0.78, 0.87, 0.75), (0.5, 0.4, 0.35)]
)
def test_so_many_trials_find_a_difference_four_times_in_five(p, q, both):
    """Counted: the test that the number is made for, over 4,000 experiments."""
    n, rng = trials(p, q, together=both), np.random.default_rng(3)
    if both is None:
        a, b = rng.binomial(n, p, 4000), rng.binomial(n, q, 4000)
        middle = (a + b) / (2.0 * n)
        z = (a - b) / np.sqrt(2.0 * n * middle * (1.0 - middle))
    else:
        ups, downs, *_ = rng.multinomial(n, [q - both, p - both, 1.0 - p - q + 2.0 * both], 4000).T
        z = (ups - downs) / np.sqrt(np.maximum(ups + downs, 1))
    assert 0.77 < np.mean(np.abs(z) > 1.959964) < 0.83


@pytest.mark.prove
def test_few_trials_are_too_few_for_an_exact_test():
    """The figures of the docstring, by Fisher's exact test and all outcomes."""

    def detected(n, p, q):
        """Return the probability that Fisher's test on n and n trials reaches 0.05."""
        weight = np.outer(stats.binom.pmf(range(n + 1), n, p), stats.binom.pmf(range(n + 1), n, q))
        return sum(
            weight[i, j]
            for i, j in np.ndindex(weight.shape)
            if stats.fisher_exact([[i, n - i], [j, n - j]]).pvalue <= 0.05
        )

    assert trials(0.0, 1.0) == 2
    assert stats.fisher_exact([[0, 2], [2, 0]]).pvalue == pytest.approx(1.0 / 3.0)
    assert detected(3, 0.0, 1.0) == 0.0
    assert detected(4, 0.0, 1.0) == 1.0
    assert trials(0.2, 0.8) == 10
    assert detected(10, 0.2, 0.8) == pytest.approx(0.64, abs=0.005)
    assert trials(0.5, 0.8) == 39
    assert detected(39, 0.5, 0.8) == pytest.approx(0.73, abs=0.005)
    # The text of the docstring has these figures.
    text = " ".join((trials.__doc__ or "").split())
    assert "below 1/3" in text and "probability of 0.64" in text and "39, with 0.73" in text


def test_common_successes_at_their_bounds_are_allowed():
    """0.9 + 0.8 - 1 is not 0.7 to the bit."""
    for first, second in ((0.9, 0.8), (0.3, 0.1), (0.95, 0.6)):
        for together in (round(max(0.0, first + second - 1.0), 12), min(first, second)):
            assert trials(first, second, together=together) >= 1


def test_pairing_needs_fewer_and_its_interval_covers():
    own, same = trials(0.78, 0.87), trials(0.78, 0.87, together=0.75)
    assert same < 0.6 * own
    rng, hit = np.random.default_rng(5), 0
    for _ in range(600):
        kind = rng.choice(4, 100, p=[0.7, 0.15, 0.05, 0.1])  # both, second, first, none
        _, low, high = paired(np.isin(kind, (0, 2)), np.isin(kind, (0, 1)))
        hit += low <= 0.1 <= high
    assert 0.93 < hit / 600 < 0.98


@examples(20)
@given(
    gamma=st.floats(0.0, 0.98),
    eps=st.floats(0.001, 0.5),
    seed=st.integers(0, 10_000),
)
def test_no_pair_of_chains_passes_the_bound_and_the_worst_reaches_its_share(gamma, eps, seed):
    def value(P, r):
        return np.linalg.solve(np.eye(len(r)) - gamma * P, r)

    rng = np.random.default_rng(seed)
    P, r = rng.dirichlet(np.full(5, 0.3), 5), rng.uniform(0.0, 2.0, 5)
    Q = (1.0 - eps) * P + eps * rng.dirichlet(np.full(5, 0.1), 5)
    far = 0.5 * np.abs(P - Q).sum(axis=1).max()
    bound = transfer_bound(gamma, far, 2.0)
    assert np.abs(value(P, r) - value(Q, r)).max() <= bound + 1e-9
    worst = np.array([[1.0 - eps, eps], [0.0, 1.0]])
    gap = (value(np.eye(2), np.array([2.0, 0.0])) - value(worst, np.array([2.0, 0.0])))[0]
    assert gap == pytest.approx(
        share_of_bound(gamma, eps) * transfer_bound(gamma, eps, 2.0), abs=1e-9
    )


def test_a_success_rate_on_the_same_tasks_is_compared_in_pairs():
    posed, gains = tasks(300, 4), np.array([[50, 3, 7, 25, 2, 1.3], [80, 3, 8, 30, 2, 1.3]]).T
    got = rollouts(real(0.7, 0.01), gains, posed).success
    change, low, high = paired(got[0], got[1])
    assert low <= change <= high
    own = 1.96 * np.sqrt(sum(p * (1 - p) / 300 for p in got.mean(axis=1)))
    assert 0.5 * (high - low) < own


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: mended(real(1.0), ["gravity"]), r"part must be .*, got 'gravity'"),
        (
            lambda: attribution({frozenset("ab"): 1.0, frozenset(): 0.0}),
            r'value must be .*, got "without',
        ),
        (lambda: trials(0.5, 0.5), r"second must be .*, got 0.5"),
        (lambda: trials(0.5, 0.6, together=0.7), r"together must be .*, got 0.7"),
        (lambda: transfer_bound(1.0, 0.1), r"gamma must be .*, got 1.0"),
        (lambda: transfer_bound(0.9, 1.5), r"eps must be .*, got 1.5"),
        (lambda: paired([True], [True, False]), "n at least 1"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
