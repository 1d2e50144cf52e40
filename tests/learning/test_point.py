"""The point against its closed form: nobody is faster than the plan, and the plan is as fast."""

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.oracles.gymnasium import check
from course.sim_to_real import Process, shaped
from course.vector_env import PointReach, PointReachVector, VectorizedEnv
from course.vector_env.point import BONUS, DISCOUNT, DT, NEAR, RADIUS, REWARDS, optimum, plan
from tests.budget import examples

SEEDS = st.integers(0, 10**6)


def episodes(envs, law, seed):
    """Steps until the disc of each environment, 0 where it was not reached; and all transitions."""
    observed, _ = envs.reset(seed=seed)
    steps, alive, retained = np.zeros(envs.num_envs, int), np.ones(envs.num_envs, bool), []
    for k in range(1, 101):
        if not alive.any():
            break
        following, rewards, over, late, _ = envs.step(law(observed).astype(np.float32))
        retained.append((observed, rewards, over, alive.copy()))
        steps[alive & over] = k
        alive &= ~(over | late)
        observed = following
    return steps, retained


@pytest.mark.prove
@examples(20)
@given(SEEDS, st.sampled_from([(0.05, 0.05), (0.02, 0.05), (0.05, 0.1), (0.2, 0.02)]))
def test_the_plan_takes_the_steps_that_it_promises(seed, case):
    radius, dt = case
    envs = PointReachVector(20, radius=radius, dt=dt)
    starts, _ = envs.reset(seed=seed)
    least, _ = plan(starts, radius=radius, dt=dt)
    # Float32 actions: a disc that is only just met may be missed by 1e-7 m.
    steps, _ = episodes(envs, lambda observed: plan(observed, radius=radius, dt=dt)[1], seed)
    reached = least <= 100
    assert np.all((steps - least)[reached] >= 0) and np.all((steps - least)[reached] <= 1)
    assert np.mean((steps == least)[reached]) > 0.9
    np.testing.assert_allclose(optimum(starts, radius=radius, dt=dt), DISCOUNT ** (least - 1.0))


@examples(50)
@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
def test_one_step_less_is_not_enough(path):
    """A direction in which, a step before, no sequence of accelerations gets far enough."""
    path = np.array(path)
    (least,), _ = plan(path[None])
    if least == 1:
        return
    k = least - 1
    # What each acceleration still adds to the position at step k, the first one k times.
    reach = DT * DT * np.arange(k, 0, -1).sum()
    rest = path[:2] - DT * k * path[2:]
    angles = np.linspace(0.0, 2.0 * np.pi, 20_001)
    along = np.stack([np.cos(angles), np.sin(angles)])
    short = rest @ along - np.abs(along).sum(axis=0) * reach
    assert short.max() > RADIUS - 1e-6


@pytest.mark.prove
@examples(20)
@given(SEEDS, st.floats(0.0, 3.0))
def test_no_policy_beats_the_optimum(seed, stray):
    envs = PointReachVector(40)
    rng = np.random.default_rng(seed)
    least, _ = plan(envs.reset(seed=seed)[0])
    steps, _ = episodes(
        envs, lambda observed: plan(observed)[1] + stray * rng.normal(size=(40, 2)), seed
    )
    assert np.all((steps >= least) | (steps == 0))


@pytest.mark.parametrize("reward", REWARDS)
def test_a_batch_is_its_environments_and_each_passes_the_checker(reward):
    assert [w for w in check(PointReach(reward)) if "spec" not in w] == []
    name = "course.vector_env:course/PointReach-v0"
    single = gymnasium.make(name, reward=reward, max_steps=9)
    assert check(single.unwrapped) == []
    batch = gymnasium.make_vec(name, 3, reward=reward, max_steps=9)
    loop = VectorizedEnv(lambda: PointReach(reward, max_steps=9), 3)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(batch.reset(seed=4)[0], loop.reset(seed=4)[0])
    for _ in range(25):
        actions = rng.uniform(-2, 2, (3, 2)).astype(np.float32)
        for ours, theirs in zip(batch.step(actions)[:4], loop.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(ours, theirs)


@examples(10)
@given(SEEDS)
def test_the_potential_is_that_of_chapter_8(seed):
    """Each episode as a chain of states, shaped as there."""
    n = 6
    for law in (lambda observed: plan(observed)[1], lambda observed: np.ones((n, 2))):
        steps, retained = episodes(PointReachVector(n, "potential"), law, seed)
        for i in range(n):
            rows = [row for row in retained if row[3][i]]
            T = len(rows)
            chain, phi = np.zeros((T + 1, 1, T + 1)), np.zeros(T + 1)
            chain[np.arange(T), 0, np.arange(1, T + 1)] = chain[T, 0, T] = 1.0
            phi[:T] = [-np.hypot(*row[0][i, :2]) for row in rows]
            pay = np.zeros_like(chain)
            pay[T - 1, 0, T] = steps[i] > 0
            process = Process(chain, pay, DISCOUNT, np.arange(T + 1) == T)
            expected = shaped(process, phi).reward[np.arange(T), 0, np.arange(1, T + 1)]
            got = np.array([row[1][i] for row in rows])
            # An episode that the clock cuts has not ended: its last potential is still there.
            last = T if steps[i] else T - 1
            np.testing.assert_allclose(got[:last], expected[:last], atol=1e-12)


def test_the_other_rewards_and_units():
    for reward in ("sparse", "distance", "hover", "once"):
        steps, retained = episodes(PointReachVector(30, reward, prize=3.0), lambda s: plan(s)[1], 1)
        for k, (_observed, rewards, over, alive) in enumerate(retained[:-1]):
            distance = np.hypot(*retained[k + 1][0][:, :2].T)
            expected = {
                "sparse": 0.0,
                "distance": -distance,
                "hover": BONUS * (distance < NEAR),
                "once": BONUS * (k == 0) * (distance < NEAR),
            }[reward]
            going = alive & ~over
            np.testing.assert_allclose(rewards[going], (expected + np.zeros(30))[going], atol=1e-12)
            assert np.all(rewards[alive & over] >= 3.0 - RADIUS)
        assert steps.min() > 0
    plain, scaled = PointReachVector(5), PointReachVector(5, unit=1000.0, offset=7.0)
    np.testing.assert_allclose(scaled.reset(seed=2)[0], 7.0 + 1000.0 * plain.reset(seed=2)[0])


@pytest.mark.prove
@pytest.mark.parametrize("bonus", [0.0, 0.0098, 0.0102, 0.05])
@pytest.mark.parametrize("reward", ["sparse", "potential", "hover", "once"])
def test_a_prize_put_off_pays_from_a_bonus_of_one_per_cent_on(reward, bonus):
    """What waiting and then going collects, for every time of waiting: the best is the optimum."""
    envs = PointReachVector(8, reward, bonus=bonus)
    starts, _ = envs.reset(seed=3)
    least, first = plan(starts)
    collected = np.zeros((101, 8))
    for wait in range(0, 101 - least.max()):
        steps, retained = episodes(
            envs, lambda observed, w=wait: first * (envs.task.steps[:, None] >= w), 3
        )
        assert np.all(np.isin(steps - least - wait, (0, 1)))
        for k, (_observed, rewards, _over, alive) in enumerate(retained):
            collected[wait] += alive * DISCOUNT**k * rewards
    best = optimum(starts, reward, bonus=bonus)
    assert np.all(collected <= best + 1e-9)
    # Waiting until the last step is exact for the one that needs longest.
    slow = int(np.argmax(least))
    assert collected[:, slow].max() == pytest.approx(best[slow], rel=0.011)
    if reward == "hover":
        assert (np.argmax(collected[:, slow]) > 0) == (bonus > 1.0 - DISCOUNT)


@pytest.mark.parametrize(
    ("task", "report"),
    [
        ({"reward": "dense"}, r"reward must be .*, got 'dense'"),
        ({"dt": 0.0}, r"dt must be .*, got 0.0"),
        ({"radius": -0.05}, r"radius must be .*, got -0.05"),
        ({"max_steps": 0}, r"max_steps must be .*, got 0"),
        ({"offset": np.nan}, r"offset must be .*, got nan"),
    ],
)
def test_bad_input(task, report):
    with pytest.raises(ValueError, match=report):
        PointReachVector(2, **task)
    with pytest.raises(ValueError, match=report):
        PointReach(**task)
