"""The reaching task: its two models, single and batched, Gymnasium's wrappers, a rollout loop."""

import functools
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st

from course.kinematics.two_link import TORQUES, TwoLink, acceleration
from course.oracles.gymnasium import check, sync_vector_env
from course.oracles.mujoco.reach import MujocoArmReach, MujocoArmReachVector
from course.vector_env import ArmReach, ArmReachVector, ProcessVectorEnv, VectorizedEnv
from course.vector_env.picture import TARGET, TIP
from course.vector_env.reach import CONTROL_STEP, RADIUS
from tests.budget import examples
from tests.vector_env.test_vector_env import identical

IDS = ["course/ArmReach-v0", "course/ArmReachMujoco-v0"]
PAIRS = [(ArmReach, ArmReachVector), (MujocoArmReach, MujocoArmReachVector)]
MODES = [mode.value for mode in AutoresetMode]


def random_arms(n: int, seed: int = 0) -> list[TwoLink]:
    rng = np.random.default_rng(seed)

    def pair(low, high):
        return tuple(float(x) for x in rng.uniform(low, high, 2))

    return [
        TwoLink(pair(0.3, 0.8), pair(0.5, 2.0), pair(0.0, 0.5), pair(0.5, 3.0)) for _ in range(n)
    ]


def spring_policy(observations: np.ndarray) -> np.ndarray:
    """Pulls the tip of the default arm to the target, with damping: most episodes succeed."""
    c1, s1, c2, s2, w1, w2, dx, dy = np.atleast_2d(observations).T
    c12, s12 = c1 * c2 - s1 * s2, s1 * c2 + c1 * s2
    x2, y2 = 0.4 * c12, 0.4 * s12
    x, y = 0.5 * c1 + x2, 0.5 * s1 + y2
    torque = np.stack([y * dx - x * dy, y2 * dx - x2 * dy]) * 30.0 - np.stack([w1, 0.3 * w2])
    return (torque / np.array([[2.0], [1.0]])).T.astype(np.float32)


# --- one environment ------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", IDS)
def test_gymnasium_finds_nothing_wrong(name: str) -> None:
    warnings = check(gymnasium.make(name).unwrapped)
    # The joints' rates have no bound.
    assert all("infinity" in text for text in warnings), warnings


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_two_models_agree_over_an_episode(seed: int) -> None:
    """The same method and step in both: rounding is all that is left."""
    ours, theirs = ArmReach(), MujocoArmReach()
    identical(ours.reset(seed=seed), theirs.reset(seed=seed))
    rng = np.random.default_rng(seed)
    over = False
    while not over:
        action = rng.uniform(-1.2, 1.2, 2).astype(np.float32)
        a, b = ours.step(action), theirs.step(action)
        np.testing.assert_allclose(a[0], b[0], rtol=0, atol=1e-11)
        assert a[1] == pytest.approx(b[1], abs=1e-11) and a[2:] == b[2:]
        over = a[2] or a[3]


def tip_error(env_fn, steps: int = 100, samples: int = 8) -> float:
    """Largest distance [m] of the tip from that of a run with 64 Runge-Kutta steps in each."""
    worst = 0.0
    for seed in range(samples):
        env, fine = env_fn(), ArmReach(substeps=64)
        env.reset(seed=seed), fine.reset(seed=seed)
        rng = np.random.default_rng(seed)
        for k in range(steps):
            if k % 10 == 0:
                action = rng.uniform(-1, 1, 2).astype(np.float32)
            a, b = env.step(action)[0], fine.step(action)[0]
            worst = max(worst, float(np.hypot(*(a[6:] - b[6:]))))
    return worst


@pytest.mark.prove
def test_what_differs_between_the_models_is_the_integrator() -> None:
    """First order for MuJoCo's default, fourth for both Runge-Kuttas; a tenth of the target."""
    tolerance = 0.1 * RADIUS
    assert tip_error(ArmReach) < 0.1 * tolerance
    assert tip_error(MujocoArmReach) == pytest.approx(tip_error(ArmReach), rel=1e-6)
    ratio = tip_error(ArmReach) / tip_error(lambda: ArmReach(substeps=2))
    assert 12 < ratio < 24
    euler = [tip_error(lambda s=s: MujocoArmReach(integrator="Euler", substeps=s)) for s in (4, 8)]
    assert euler[0] > euler[1] > tolerance
    assert euler[0] / euler[1] == pytest.approx(2.0, abs=0.3)


@examples(30)
@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.integers(0, 20))
def test_the_closed_form_conserves_energy_and_gains_what_the_motors_give(state, seed) -> None:
    """Without damping the power of the torques is the rate of the kinetic energy."""
    arm = random_arms(1, seed)[0]
    column = TwoLink(arm.lengths, arm.masses, (0.0, 0.0), arm.torques).column()
    rng = np.random.default_rng(seed)
    column[TORQUES, 0] = rng.normal(size=2)
    q, v = np.array(state[:2])[:, None], np.array(state[2:])[:, None]
    a, b, d = column[:3, 0]

    def energy(angle: float, rates: np.ndarray) -> float:
        c = np.cos(angle)
        inertia = np.array([[a + 2 * b * c, d + b * c], [d + b * c, d]])
        return float(0.5 * rates @ inertia @ rates)

    h, rates = 1e-5, acceleration(q, v, column)[:, 0]
    ahead = energy(q[1, 0] + h * v[1, 0], v[:, 0] + h * rates)
    behind = energy(q[1, 0] - h * v[1, 0], v[:, 0] - h * rates)
    power = float(column[TORQUES, 0] @ v[:, 0])
    assert (ahead - behind) / (2 * h) == pytest.approx(power, abs=1e-5 * (1 + abs(ahead)))


def test_reward_ends_and_targets_are_what_the_text_says() -> None:
    env = ArmReach(max_steps=7)
    for seed in range(50):
        observation, _ = env.reset(seed=seed)
        c1, s1, c2, s2, w1, w2, dx, dy = observation
        tip = np.array([0.5 * c1 + 0.4 * (c1 * c2 - s1 * s2), 0.5 * s1 + 0.4 * (s1 * c2 + c1 * s2)])
        assert 0.1 + 0.05 <= np.hypot(*(tip - [dx, dy])) <= 0.95 * 0.9 and w1 == w2 == 0.0
    env.reset(seed=0)
    for k in range(7):
        observation, reward, terminated, truncated, info = env.step(np.array([3.0, -0.5]))
        assert reward == pytest.approx(-np.hypot(*observation[6:]) - 0.01 * 1.25)
        assert (terminated, truncated) == (False, k == 6)
        assert info == ({"is_success": False} if k == 6 else {})


@pytest.mark.parametrize("env_fn", [ArmReach, MujocoArmReach])
def test_a_single_environment_refuses_nonsense(env_fn) -> None:
    env = env_fn()
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2))
    env.reset(seed=0)
    for bad, text in (
        (np.zeros(3), r"action.shape must be \(2,\).*, got \(3,\)"),
        (0.5, r"action.shape must be .*, got \(\)"),
        ([np.nan, 0.0], r"action\[0, 0\] must be a number, got nan"),
        (["a", "b"], "must be float32"),
    ):
        with pytest.raises(ValueError, match=text):
            env.step(bad)
    with pytest.raises(ValueError, match="max_steps"):
        env_fn(max_steps=0)
    with pytest.raises(ValueError, match="substeps"):
        env_fn(substeps=0)
    with pytest.raises(
        ValueError, match=r"masses\[1\] must be a positive finite number \[kg\].*, got -1.0"
    ):
        TwoLink(masses=(1.0, -1.0))
    with pytest.raises(ValueError, match=r"integrator must be one of.*, got 'euler'"):
        MujocoArmReach(integrator="euler")


# --- batches --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("single", "batch"), PAIRS)
def test_a_batch_is_gymnasiums_loop_to_the_bit(single, batch, mode) -> None:
    n = 7
    truth = sync_vector_env(lambda: single(max_steps=60), n, mode)
    loop = VectorizedEnv(lambda: single(max_steps=60), n, autoreset_mode=mode)
    every = [truth, loop, batch(n, max_steps=60, autoreset_mode=mode)]
    if single is MujocoArmReach:
        every += [batch(n, max_steps=60, autoreset_mode=mode, threads=k) for k in (1, 2, 3)]
    start = [envs.reset(seed=5) for envs in every]
    for other in start[1:]:
        identical(other, start[0])
    terminated = truncated = 0
    masked = False
    observations = start[0][0]
    for k in range(140):
        actions = spring_policy(observations)
        steps = [envs.step(actions) for envs in every]
        for other in steps[1:]:
            identical(other, steps[0])
        observations = steps[0][0]
        terminated += int(steps[0][2].sum())
        truncated += int(steps[0][3].sum())
        over = steps[0][2] | steps[0][3]
        due = mode == "Disabled" and over.any()
        if due or (k > 40 and not masked and over.any()):
            mask = over if masked else over | (np.arange(n) == 0)
            masked = True
            seeds: list[int | None] = [9] * n
            part = [e.reset(seed=seeds, options={"reset_mask": mask}) for e in every]
            for other in part[1:]:
                identical(other, part[0])
            observations = part[0][0]
    assert terminated > 0 and truncated > 0 and masked
    for envs in every:
        envs.close()


@pytest.mark.parametrize(("single", "batch"), PAIRS)
@pytest.mark.parametrize("n", [1, 3, 8])
def test_each_environment_has_its_own_arm(single, batch, n) -> None:
    arms = random_arms(n)
    turns = iter(arms)
    loop, envs = VectorizedEnv(lambda: single(next(turns)), n), batch(n, arms)
    identical(envs.reset(seed=2), loop.reset(seed=2))
    rng = np.random.default_rng(0)
    for _ in range(110):
        actions = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
        identical(envs.step(actions), loop.step(actions))
    with pytest.raises(ValueError, match=r"arms must be a TwoLink or"):
        batch(n + 1, arms)


def test_arms_differ_and_agree_between_the_models() -> None:
    arms = random_arms(6)
    ours, theirs = ArmReachVector(6, arms), MujocoArmReachVector(6, arms)
    ours.reset(seed=[1] * 6), theirs.reset(seed=[1] * 6)
    for _ in range(50):
        actions = np.full((6, 2), 0.3, np.float32)
        a, b = ours.step(actions)[0], theirs.step(actions)[0]
    assert np.min(np.abs(np.diff(a[:, 5]))) > 1e-3
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-11)
    # One field of the batch's model can be changed alone.
    theirs.batch.expand("body_mass")[:] *= 3.0
    theirs.batch.set_const()
    assert np.max(np.abs(theirs.step(actions)[0] - ours.step(actions)[0])) > 1e-4


@examples(15)
@given(st.integers(1, 40), st.integers(0, 1000))
def test_what_happens_in_one_does_not_depend_on_the_others(n, seed) -> None:
    more, few = ArmReachVector(n, max_steps=9), ArmReachVector(1, max_steps=9)
    k = seed % n
    more.reset(seed=seed), few.reset(seed=seed + k)
    rng = np.random.default_rng(seed)
    for _ in range(25):
        actions = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
        a, b = more.step(actions), few.step(actions[k : k + 1])
        for x, y in zip(a[:4], b[:4], strict=True):
            np.testing.assert_array_equal(x[k], y[0])


def test_a_batch_refuses_what_a_loop_refuses() -> None:
    for envs in (ArmReachVector(3), MujocoArmReachVector(3)):
        with pytest.raises(ResetNeeded):
            envs.step(np.zeros((3, 2)))
        with pytest.raises(ResetNeeded):
            envs.reset(options={"reset_mask": np.array([True, False, False])})
        envs.reset(seed=0)
        with pytest.raises(ValueError, match=r"actions.shape must be \(3, 2\).*, got \(4, 2\)"):
            envs.step(np.zeros((4, 2)))
        with pytest.raises(ValueError, match=r"actions\[1, 0\] must be .*, got nan"):
            envs.step(np.array([[0, 0], [np.nan, 0], [0, 0]]))
    with pytest.raises(ValueError, match="num_envs"):
        ArmReachVector(0)
    with pytest.raises(ValueError, match="threads"):
        MujocoArmReachVector(2, threads=-1)


def test_returned_arrays_are_the_callers() -> None:
    for kind in (ArmReachVector, MujocoArmReachVector):
        envs, other = (kind(4, max_steps=3, autoreset_mode="SameStep") for _ in range(2))
        first, again = envs.reset(seed=0)[0], other.reset(seed=0)[0]
        first[:] = 99.0
        for _ in range(8):
            a, b = envs.step(np.full((4, 2), 0.2)), other.step(np.full((4, 2), 0.2))
            identical(a, b)
            for array in a[:4]:
                array[:] = 0
            if "final_obs" in a[4]:
                assert np.all(a[4]["final_obs"][0] != 0.0)
        assert again.max() < 99.0


# --- pictures -------------------------------------------------------------------------------------


def test_every_backend_draws_what_a_single_environment_draws() -> None:
    """And the picture shows the state: the tip in orange, the target in red, where they are."""
    drawn = functools.partial(ArmReach, render_mode="rgb_array")
    processes = ProcessVectorEnv(drawn, 2, num_workers=1)
    every: list[Any] = [processes, VectorizedEnv(drawn, 2)]
    every += [kind(2, render_mode="rgb_array") for kind in (ArmReachVector, MujocoArmReachVector)]
    single = drawn()
    observation, _ = single.reset(seed=4)
    picture = single.render()
    assert picture.shape == (300, 300, 3) and picture.dtype == np.uint8
    for envs in every:
        envs.reset(seed=4)
        frames = envs.render()
        assert envs.render_mode == "rgb_array" and len(frames) == 2
        np.testing.assert_array_equal(frames[0], picture)
        assert np.any(frames[1] != picture)
    processes.close()
    c1, s1, c2, s2, _, _, dx, dy = observation
    tip = np.array([0.5 * c1 + 0.4 * (c1 * c2 - s1 * s2), 0.5 * s1 + 0.4 * (s1 * c2 + c1 * s2)])
    scale = 300.0 / (2.0 * 1.1 * 0.9)
    for place, colour in ((tip, TIP), (tip - [dx, dy], TARGET)):
        x, y = (np.array([150.0, 150.0]) + scale * place * [1.0, -1.0]).astype(int)
        assert tuple(picture[y, x]) == colour


def test_who_is_not_asked_for_pictures_makes_none() -> None:
    for env in (ArmReach(), ArmReachVector(2)):
        with pytest.raises(ResetNeeded):
            env.render()
        env.reset(seed=0)
        assert env.render() is None
    with pytest.raises(
        ValueError, match=r"render_mode must be one of None, 'rgb_ar.*, got 'human'"
    ):
        ArmReachVector(2, render_mode="human")


# --- Gymnasium's tools ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", IDS)
def test_gymnasium_makes_them_by_name(name: str) -> None:
    envs = gymnasium.make_vec(f"course.vector_env:{name}", num_envs=3)
    assert isinstance(envs, ArmReachVector | MujocoArmReachVector)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.spec is not None and envs.spec.id == name
    loop = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync")
    identical(envs.reset(seed=1), loop.reset(seed=1))
    actions = np.full((3, 2), 0.5, np.float32)
    identical(envs.step(actions), loop.step(actions))
    assert not gymnasium.make(name, max_steps=5).reset(seed=0)[1]


@pytest.mark.parametrize("name", [*IDS, "course/PointReach-v0"])
def test_the_specification_states_the_length_of_an_episode(name: str) -> None:
    """What reads the specification, such as `TimeAwareObservation`, needs it."""
    single = gymnasium.make(f"course.vector_env:{name}")
    envs = gymnasium.make_vec(f"course.vector_env:{name}", num_envs=3, max_episode_steps=7)
    assert single.spec is not None and single.spec.max_episode_steps == 100
    observation, _ = gymnasium.wrappers.TimeAwareObservation(single).reset(seed=0)
    assert single.observation_space.shape is not None
    assert observation.shape == (single.observation_space.shape[0] + 1,)
    first, _ = envs.reset(seed=0)
    idle = np.zeros((len(first), 2), np.float32)
    ends = [np.all(np.logical_or(*envs.step(idle)[2:4])) for _ in range(7)]
    assert ends == [False] * 6 + [True]
    with pytest.raises(ValueError, match=r"max_episode_steps must be .*, got 0"):
        gymnasium.make_vec(name, num_envs=1, max_episode_steps=0)


def advantages(envs, steps: int, gamma: float = 0.95, lam: float = 0.9) -> np.ndarray:
    """What a training loop computes: a rollout, values bootstrapped where the clock ran out."""
    weights = np.linspace(-1.0, 1.0, 8)
    observations, _ = envs.reset(seed=3)
    rewards, values, ends = [], [], []
    for _ in range(steps):
        values.append(observations @ weights)
        observations, reward, terminated, truncated, infos = envs.step(spring_policy(observations))
        for i in np.flatnonzero(truncated & ~terminated):
            reward[i] += gamma * (infos["final_obs"][i] @ weights)
        rewards.append(reward)
        ends.append(terminated | truncated)
    result, running, following = np.empty((steps, envs.num_envs)), 0.0, observations @ weights
    for t in reversed(range(steps)):
        alive = 1.0 - ends[t]
        delta = rewards[t] + gamma * following * alive - values[t]
        running = delta + gamma * lam * alive * running
        result[t], following = running, values[t]
    return result


def test_a_rollout_loop_gets_what_single_episodes_give() -> None:
    n, steps, gamma, lam = 5, 70, 0.95, 0.9
    result = advantages(ArmReachVector(n, max_steps=25, autoreset_mode="SameStep"), steps)
    weights = np.linspace(-1.0, 1.0, 8)
    for i in range(n):
        env = ArmReach(max_steps=25)
        observation, _ = env.reset(seed=3 + i)
        episodes: list[list[Any]] = [[]]
        t = 0
        while t < steps:
            value = observation @ weights
            after, reward, terminated, truncated, _ = env.step(spring_policy(observation)[0])
            tail = 0.0 if terminated else gamma * (after @ weights)
            episodes[-1].append(reward + tail - value)
            t += 1
            if terminated or truncated:
                episodes.append([])
                after, _ = env.reset()
            observation = after
        expected = []
        for deltas in episodes:
            running, back = 0.0, []
            for delta in reversed(deltas):
                running = delta + gamma * lam * running
                back.append(running)
            expected += back[::-1]
        np.testing.assert_allclose(result[:, i], expected, rtol=0, atol=1e-9)


def test_the_spring_policy_reaches_most_targets() -> None:
    envs = ArmReachVector(200, max_steps=150)
    observations, _ = envs.reset(seed=0)
    reached = np.zeros(200, bool)
    for _ in range(round(3.0 / CONTROL_STEP)):
        observations, _, terminated, *_ = envs.step(spring_policy(observations))
        reached |= terminated
    assert reached.mean() > 0.75
