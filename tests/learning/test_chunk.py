"""Chunks carried out: what each executor does, exactly, and what it costs on the tasks."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.learning import (
    Commit,
    Delayed,
    Ensemble,
    TwoWays,
    chunk_policy,
    nearest,
    recorded,
    remake,
    roll,
    windows,
)
from course.learning.recorded import HEADS
from tests.budget import examples

pytestmark = pytest.mark.slow


WAYS = TwoWays()
SHOWN = WAYS.demonstrate(100, 0)


def labelled_chunk(states, rng, length=6):
    """A chunk that says when it was made and which of its steps this is: (10 step, place)."""
    made = np.repeat(states[:, :1], length, axis=1)
    return np.stack((made, np.broadcast_to(np.arange(length), made.shape)), axis=2)


def actions_made(executor, steps=20):
    """(when the action was made, its place in the chunk) at each step, for two rows."""
    executor.reset()
    ran = [executor(np.full((2, 1), float(k)), np.random.default_rng(0)) for k in range(steps)]
    assert all(np.array_equal(a[0], a[1]) for a in ran)
    return np.array(ran)[:, 0]


def success(act, noise=0.0, number=400, steps=16):
    task = TwoWays(noise=noise)
    start = task.starts(number, np.random.default_rng(3))
    ran = roll(task, act, start, steps, np.random.default_rng(4))
    return np.mean(task.sides(ran.states) != 0)


# --- executors ------------------------------------------------------------------------------------


@examples(30)
@given(st.integers(1, 6), st.integers(0, 5), st.floats(-1.0, 1.0))
def test_each_executor_takes_the_actions_it_says(executed, delay, decay):
    k = np.arange(20)
    place = k % executed
    assert np.array_equal(
        actions_made(Commit(labelled_chunk, executed)), np.stack((k - place, place), axis=1)
    )
    made = np.maximum(k - delay, 0)
    assert np.array_equal(
        actions_made(Delayed(labelled_chunk, delay)), np.stack((made, k - made), axis=1)
    )
    for step, (when, where) in enumerate(actions_made(Ensemble(labelled_chunk, decay))):
        made = np.arange(max(0, step - 5), step + 1)  # the oldest first
        weights = np.exp(-decay * np.arange(len(made)))
        mean = np.sum(weights * made) / weights.sum()
        assert (when, where) == pytest.approx((mean, step - mean), abs=1e-9)


def test_executors_without_a_delay_or_a_chunk_are_the_policy_itself():
    states, chunks = windows(SHOWN, 8)
    policy, starts = nearest(states, chunks), SHOWN.states[:50, 0]
    paths = [
        roll(WAYS, act, starts, 16, np.random.default_rng(0)).states
        for act in (lambda s, rng: policy(s, rng)[:, 0], Commit(policy, 1), Delayed(policy, 0))
    ]
    assert np.array_equal(paths[0], paths[1]) and np.array_equal(paths[0], paths[2])
    again = [roll(WAYS, Commit(policy, 5), starts, 16, np.random.default_rng(0)) for _ in "12"]
    assert np.array_equal(again[0].states, again[1].states)
    act = Commit(policy, 5)  # `roll` resets it
    both = [roll(WAYS, act, starts, 7, np.random.default_rng(0)).states for _ in "12"]
    assert np.array_equal(both[0], both[1])


def test_bad_chunks_are_refused_by_shape():
    rng = np.random.default_rng(0)
    for act, expected in (
        (Commit(labelled_chunk, 7), r"chunk.shape must be \(3, 7 or more, a\).*, got \(3, 6, 2\)"),
        (Delayed(labelled_chunk, 6), r"\(3, 7 or more, a\)"),
        (Commit(lambda s, rng: s, 1), r"chunk.shape must be .*, got \(3, 1\)"),
    ):
        with pytest.raises(ValueError, match=expected):
            act(np.zeros((3, 1)), rng)
    for begun in (Commit(labelled_chunk, 3), Ensemble(labelled_chunk), Delayed(labelled_chunk, 2)):
        begun(np.zeros((3, 1)), rng)
        with pytest.raises(ValueError, match=r"reset\(\)"):
            begun(np.zeros((4, 1)), rng)


@pytest.mark.parametrize(
    ("make", "value", "message"),
    [
        (Commit, 0, r"executed must be .*, got 0"),
        (Commit, 1.5, r"executed must be .*, got 1.5"),
        (Delayed, -1, r"delay must be .*, got -1"),
        (Ensemble, np.inf, r"decay must be .*, got inf"),
    ],
)
def test_an_executor_with_a_bad_number_is_refused_when_it_is_made(make, value, message):
    with pytest.raises(ValueError, match=message):
        make(labelled_chunk, value)


# --- commit or react ------------------------------------------------------------------------------


@pytest.mark.prove
def test_noise_injected_into_demonstrations_turns_which_is_best():
    """Without it nothing says how to come back, so that reacting gains little; with it, much."""
    gains = []
    for injected in (0.0, 0.05):
        shown = WAYS.demonstrate(400, 0, injected=injected)
        policy = nearest(*windows(shown, 8))
        gains.append([success(Commit(policy, k), 0.05) for k in (1, 8)])
    (plain, plain_open), (taught, taught_open) = gains
    assert taught > plain + 0.1
    assert taught - taught_open > plain - plain_open + 0.1


# --- an autoencoder, and what is on record --------------------------------------------------------


@pytest.mark.prove
def test_the_code_says_which_way():
    learn = partial(chunk_policy, SHOWN.states[:, 0], SHOWN.actions, 0, rate=3e-3)
    policy = learn(latent=1, beta=0.1, steps=800)
    rng = np.random.default_rng(1)
    start = WAYS.starts(500, rng)

    def sides(acting):
        chunks = acting(start, rng)
        zeros = np.zeros((500, 1, 2))
        path = start[:, None] + np.concatenate((zeros, np.cumsum(chunks, axis=1)), axis=1)
        return WAYS.sides(path), path[:, 8, 1]

    (side, middle), (fixed, still) = sides(policy), sides(replace(policy, zero=True))
    assert np.mean(side != 0) > 0.55 and 0.3 < np.mean(side[side != 0] > 0) < 0.7
    assert np.mean(fixed != 0) < np.mean(side != 0) and still.std() < 0.7 * middle.std()
    codes = np.linspace(-2.0, 2.0, 9)[:, None]
    path = policy.done.undo(policy.draw(np.zeros((9, 2)), codes)).reshape(9, 16, 2)
    ends = path[:, :8, 1].sum(axis=1)
    assert abs(np.corrcoef(codes[:, 0], ends)[0, 1]) > 0.8  # from one way to the other
    assert np.ptp(ends) > 0.5
    mute = learn(beta=100.0, steps=300)
    assert np.mean(sides(mute)[0] != 0) < 0.2  # a code too dear says nothing: the mean


@pytest.mark.prove
def test_policies_on_record_do_what_they_are_shown_for_and_can_be_made_again():
    result = {name: success(Commit(recorded(name), 4)) for name in HEADS}
    assert result["mean"] < 0.15
    assert min(result[name] for name in ("mixture", "flow", "diffusion")) > 0.8
    states, rng = windows(SHOWN, 8)[0], np.random.default_rng(0)
    old, new = (make("mean")(states, rng) for make in (recorded, remake))
    # The same to rounding on one machine; on another CPU training ends at other weights, whose
    # steps are nearly the same beside the deviation of those that were shown [m].
    assert np.sqrt(np.mean((old - new) ** 2)) < 0.2 * np.std(windows(SHOWN, 8)[1])
    with pytest.raises(ValueError, match=r"name must be .*, got 'median'"):
        partial(recorded, "median")()
