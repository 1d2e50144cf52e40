"""Behaviour cloning against closed forms: least squares, likelihoods, and where it drifts."""

import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from course.learning import (
    Diverged,
    Linear,
    Regulator,
    TwoWays,
    clone,
    dagger,
    linear,
    nearest,
    windows,
)
from tests.budget import examples

REGULATOR = Regulator()


def rounds_of(seed, task=REGULATOR, steps=40, **how):
    rng = np.random.default_rng(seed)
    text = {"number": 10, "rounds": 1} | how
    return list(dagger(task, task.expert, linear, task.starts, steps, rng, **text))


def radius(result):
    return REGULATOR.radius(result.policy.gain[0])


# --- drift is a question of identification --------------------------------------------------------


@examples(40)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(2, 12), st.integers(0, 2**31))
def test_the_linear_law_is_the_shortest_of_the_best(rank, size, rows, seed):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((rows, rank)) @ rng.standard_normal((rank, size))
    y = rng.standard_normal((rows, 2))
    law, (best, _, report, _) = linear(x, y), np.linalg.lstsq(x, y, rcond=1e-10)
    assert np.allclose(law.gain, -best.T, atol=1e-7 * max(1.0, np.abs(best).max()))
    assert law.rank == report


@examples(25)
@given(st.floats(1.0, 9.0), st.floats(0.02, 0.1), st.floats(0.5, 2.0), st.floats(1.5, 4.0))
def test_a_perfect_expert_on_its_slow_mode_teaches_an_unstable_law(stiffness, dt, slow, ratio):
    """Every label fits. The other root is what is left of the trace."""
    task = Regulator(stiffness, dt, slow, ratio * slow)
    mode = task.slow_mode()
    # Rounding puts the learner off the line, and each step takes it farther: a round is so short
    # that this stays below what `linear` counts as a direction of its own.
    grows = np.trace(task.A) - (task.K @ mode) * (mode @ task.B) - np.exp(-slow * dt)
    steps = min(40, int(math.log(1e-13 / np.finfo(float).eps) / math.log(grows)))
    first, later = rounds_of(3, task, steps=steps)
    for result in (first, later):  # a round of DAgger stays on the same line
        assert result.policy.rank == 1
        assert np.allclose(result.policy(result.states, None), result.labels, atol=1e-8)
        assert np.allclose(result.policy.gain[0], (task.K @ mode) * mode, atol=1e-6)
        other = np.trace(task.A) - result.policy.gain[0] @ task.B - np.exp(-slow * dt)
        assert task.radius(result.policy.gain[0]) == pytest.approx(other, abs=1e-6)
        assert other > 1.0
    mended = rounds_of(3, task, rounds=0, injected=1e-3)[0]
    assert mended.policy.rank == 2
    assert np.allclose(mended.policy.gain[0], task.K, rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_a_round_of_dagger_mends_it_as_soon_as_labels_are_not_perfect():
    """However small the noise: it sets the learner off its line, and is then in the labels too."""
    best = REGULATOR.radius(REGULATOR.K)
    for size in (1e-6, 1e-3, 1e-1):
        report = np.array([[radius(r) for r in rounds_of(s, label_noise=size)] for s in range(60)])
        assert np.all(report[:, 0] > 1.1)
        assert np.mean(np.abs(report[:, 1] - best) < 0.005) > 0.85
    halved = [radius(rounds_of(4, label_noise=size)[1]) for size in (1e-5, 1e-6)]
    assert halved[0] == pytest.approx(halved[1], abs=1e-5)  # the size cancels
    for steps, least, largest in ((40, 0.85, 1.0), (2, 0.0, 0.8)):  # the time to grow does not
        good = 0
        for seed in range(60):
            rng, task = np.random.default_rng(seed), REGULATOR
            *_, last = dagger(
                task,
                task.expert,
                linear,
                task.starts,
                steps,
                rng,
                rounds=1,
                label_noise=1e-3,
                number=400 // steps,
            )
            good += abs(radius(last) - best) < 0.005
        assert least <= good / 60 <= largest


def test_dagger_asks_the_expert_where_the_learner_went():
    """States of a later round are those that the policy before it reaches, labels the expert's."""
    first, second, third = rounds_of(1, rounds=2, label_noise=1e-3)
    assert [len(r.states) for r in (first, second, third)] == [400, 800, 1200]
    assert np.array_equal(third.states[:800], second.states)
    for before, after in ((first, second), (second, third)):
        new = after.states[-400:].reshape(10, 40, 2)
        loop = REGULATOR.closed(before.policy.gain[0])
        assert np.allclose(new[:, 1:], new[:, :-1] @ loop.T, atol=1e-9 * np.abs(new).max())
    deviation = third.labels - REGULATOR.expert(third.states, np.random.default_rng(0))
    assert np.std(deviation) == pytest.approx(1e-3, rel=0.1)
    quiet = rounds_of(1, injected=0.3)[0]
    assert np.allclose(
        quiet.labels, REGULATOR.expert(quiet.states, np.random.default_rng(0)), atol=1e-12
    )


# --- heads ----------------------------------------------------------------------------------------


@pytest.mark.prove
def test_each_head_learns_the_distribution_that_it_can_hold():
    """Two actions, at -1 and +1 with a state's share: mean and spread are known for each head."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-1.0, 1.0, (4000, 1))
    high = rng.random(4000) < 0.5 + 0.3 * x[:, 0]
    y = np.where(high, 1.0, -1.0)[:, None] + 0.1 * rng.standard_normal((4000, 1))
    at = np.repeat([[-0.8], [0.0], [0.8]], 2000, axis=0)
    share = 0.5 + 0.3 * at[::2000, 0]
    for head, seed in (("mean", 1), ("gaussian", 2), ("mixture", 3)):
        policy = clone(x, y, seed, head=head, steps=600, rate=3e-3, width=32)
        drawn = policy(at, rng)[:, 0].reshape(3, 2000)
        assert drawn.mean(axis=1) == pytest.approx(2.0 * share - 1.0, abs=0.12)
        spread = np.sqrt(4.0 * share * (1.0 - share) + 0.01)
        between = np.mean(np.abs(drawn) < 0.5, axis=1)
        if head == "mean":
            assert np.all(drawn.std(axis=1) < 1e-9)
        else:
            assert drawn.std(axis=1) == pytest.approx(spread, rel=0.1)
        if head == "gaussian":  # half of what a normal distribution of this spread says
            normal = stats.norm(2.0 * share - 1.0, spread)
            assert between == pytest.approx(normal.cdf(0.5) - normal.cdf(-0.5), abs=0.06)
        if head == "mixture":
            assert np.all(between < 0.02)
            assert np.std(drawn[drawn > 0.0] - 1.0) == pytest.approx(0.1, abs=0.03)
    assert len(policy.losses) == 600 and policy.losses[-50:].mean() < policy.losses[:50].mean()


@pytest.mark.slow
def test_a_policy_answers_in_the_shape_of_its_data_and_is_its_seed():
    states, chunks = windows(TwoWays().demonstrate(10, 0), 4)
    fit = partial(clone, steps=20, width=8)
    for actions in (chunks, chunks[:, 0]):
        drawn = [
            make(states, actions)(states[:7], np.random.default_rng(1))
            for make in (partial(fit, seed=5), partial(fit, seed=5), partial(fit, seed=6), nearest)
        ]
        assert all(d.shape == (7, *actions.shape[1:]) for d in drawn)
        assert np.array_equal(drawn[0], drawn[1]) and not np.allclose(drawn[0], drawn[2])
        assert np.allclose(drawn[3], actions[:7])


def test_the_nearest_demonstration_is_that():
    rng = np.random.default_rng(3)
    x, y = rng.standard_normal((50, 2)) * [1.0, 100.0], rng.standard_normal((50, 3))
    requested = rng.standard_normal((200, 2)) * [1.0, 100.0]
    scaled = (requested[:, None] - x) / x.std(axis=0)
    assert np.allclose(nearest(x, y)(requested, rng), y[np.argmin((scaled**2).sum(2), axis=1)])


# --- bad input ------------------------------------------------------------------------------------


def test_a_loss_without_end_stops_and_keeps_the_last_good_weights():
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((100, 2)), rng.standard_normal((100, 1))
    with pytest.raises(Diverged, match=r"the loss is (inf|nan) at step \d+ of 300: lower") as stop:
        clone(x, y, 0, steps=300, rate=1e25)
    retained = stop.value.policy(x, rng)
    assert retained.shape == (100, 1) and np.isfinite(retained).all()


def test_bad_data_are_refused_by_name():
    x, y = np.random.default_rng(0).standard_normal((2, 20, 2))
    for states, actions, report in (
        (x[:0], y[:0], r"demonstrated steps must be .*, got 0"),
        (x[:1], y[:1], r"demonstrated steps must be .*, got 1"),
        (x, y[:-1], r"actions.shape must be .*, got \(19, 2\)"),
        (x * np.nan, y, r"states\[0, 0\] must be .*, got nan"),
        (
            x * [1.0, 0.0],
            y,
            r"variance of states\[:, 1\] must be .*leave it out",
        ),
        (x, 0.0 * y, r"variance of actions\[:, 0\]"),
    ):
        for make in (partial(clone, seed=0), nearest):
            with pytest.raises(ValueError, match=report):
                make(states, actions)
    with pytest.raises(ValueError, match=r"head must be .*, got 'median'"):
        clone(x, y, 0, head="median")

    requested = iter(range(100))

    def broken(states, rng):  # drives 40 steps, labels once, and breaks when it is asked again
        return states[:, :1] * (np.nan if next(requested) > 40 else -5.0)

    observed, rng = [], np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"label of round 1\[0, 0\] must be .*, got nan"):
        observed += list(dagger(REGULATOR, broken, linear, REGULATOR.starts, 40, rng))
    requested, laps = iter(range(100)), dagger(REGULATOR, broken, linear, REGULATOR.starts, 40, rng)
    retained = next(laps).policy
    with pytest.raises(ValueError, match="label of round 1"):
        next(laps)
    assert isinstance(retained, Linear) and np.isfinite(retained.gain).all()
