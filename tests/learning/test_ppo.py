"""PPO against sums and cases by hand, autograd, and the exact optimum of the point."""

import math
import sys
from dataclasses import replace
from typing import Any, cast

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st

from course.learning import Diverged, Settings, clipped_objective, evaluate, gae, ppo
from course.learning.ppo import ActorCritic, Runner, Table, judged, slopes
from course.vector_env import PointReachVector
from course.vector_env.point import optimum
from tests.budget import examples

SMALL = Settings(horizon=16, epochs=5, minibatches=2, rate=3e-3, hidden=(16, 16))


def points(n: int = 16, mode: str = "SameStep", **task: Any) -> PointReachVector:
    return PointReachVector(n, task.pop("reward", "potential"), autoreset_mode=mode, **task)


@examples(40)
@given(st.integers(0, 10**6), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(1, 30))
def test_advantages_are_the_double_sum(seed, gamma, decay, T):
    """Over all later steps of the episode: (gamma lambda)^k times the critic's error there."""
    rng = np.random.default_rng(seed)
    rewards, values, following = rng.normal(size=(3, T, 3))
    ends = rng.random((2, T, 3)) < 0.15
    over, late = ends
    got = gae(rewards, values, following, over, late, gamma, decay)
    for i in range(3):
        for t in range(T):
            total, k = 0.0, t
            while True:
                future = 0.0 if over[k, i] else gamma * following[k, i]
                error = rewards[k, i] + future - values[k, i]
                total += (gamma * decay) ** (k - t) * error
                if over[k, i] or late[k, i] or k == T - 1:
                    break
                k += 1
            assert got[t, i] == pytest.approx(total, abs=1e-9)
    r, v, after = rewards[:, 0], values[:, 0], following[:, 0]
    one = gae(r, v, after, over[:, 0], late[:, 0], gamma, decay)
    np.testing.assert_array_equal(one, got[:, 0])


@pytest.mark.parametrize(
    ("ratio", "advantage", "value", "slope"),
    [
        (0.5, 2.0, 1.0, 2.0),  # good and become rarer: pulled back
        (1.1, 2.0, 2.2, 2.0),  # good, near: pushed
        (1.5, 2.0, 2.4, 0.0),  # good and likely enough: left
        (0.5, -2.0, -1.6, 0.0),  # bad and rare enough: left
        (0.9, -2.0, -1.8, -2.0),  # bad, near: pushed
        (1.5, -2.0, -3.0, -2.0),  # bad and become likelier: pulled back
    ],
)
def test_the_six_cases_of_the_clip(ratio, advantage, value, slope):
    got = clipped_objective(np.array([ratio]), np.array([advantage]), 0.2)
    assert [float(x[0]) for x in got] == pytest.approx([value, slope])
    free = clipped_objective(np.array([ratio]), np.array([advantage]), math.inf)
    assert [float(x[0]) for x in free] == pytest.approx([ratio * advantage, advantage])


@examples(100)
@given(st.floats(0.01, 3.0), st.floats(-3.0, 3.0), st.floats(0.01, 0.9))
def test_its_slope_is_the_difference(ratio, advantage, clip):
    step = 1e-6
    if min(abs(ratio - 1.0 - clip), abs(ratio - 1.0 + clip)) > 2.0 * step:
        around = clipped_objective(
            np.array([ratio - step, ratio + step]), np.full(2, advantage), clip
        )[0]
        slope = clipped_objective(np.array([ratio]), np.array([advantage]), clip)[1]
        assert slope[0] == pytest.approx(np.diff(around)[0] / (2.0 * step), abs=1e-5)


def test_the_gradient_of_a_minibatch_is_that_of_autograd():
    settings = replace(SMALL, entropy=0.03, value_weight=0.7)
    policy, rng = ActorCritic(4, 2, 3, settings, 8), np.random.default_rng(0)
    with torch.no_grad():
        policy.log_std.copy_(torch.tensor([-0.3, 0.2]))
        policy.flat += 0.1 * torch.from_numpy(rng.normal(size=policy.flat.shape)).float()
    part = Table(*(rng.normal(size=(64, d)).astype(np.float32) for d in (4, 2, 1, 1, 1)))
    loss = slopes(policy, part, settings)
    by_hand = policy.flat.grad.numpy().copy()
    observed, actions, drawn, advantages, targets = map(torch.from_numpy, part)
    normal = torch.distributions.Normal(policy.actor(observed), policy.log_std.exp())
    constant = 0.5 * math.log(2.0 * math.pi)
    log_prob = (normal.log_prob(actions) + constant).sum(1, keepdim=True)
    ratio = (log_prob - drawn).exp()
    clipped = torch.minimum(ratio * advantages, ratio.clamp(0.8, 1.2) * advantages)
    total = 0.7 * (policy.critic(observed) - targets).square().mean() - clipped.mean()
    total = total - 0.03 * policy.log_std.sum()
    policy.flat.grad.zero_()
    total.backward()
    assert loss == pytest.approx(total.item(), rel=1e-5)
    np.testing.assert_allclose(by_hand, policy.flat.grad.numpy(), rtol=1e-4, atol=1e-5)
    assert np.abs(by_hand).max() > 0.01


class Clock(PointReachVector):
    """The reward of a step is its number in the episode; ends by the clock after 5 of them."""

    def _move(self, actions):
        observed, _, over, late = super()._move(actions)
        return observed, self.task.steps.astype(float), over & False, late


@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_no_stored_step_crosses_a_reset(mode):
    envs = Clock(3, max_steps=5, autoreset_mode=mode)
    settings = replace(SMALL, horizon=17, minibatches=1)
    policy = ActorCritic(4, 2, 0, settings, 3)
    batch = Runner(envs, 0, settings).collect(policy)
    assert [length for _, length, _ in batch.ended] == [5] * len(batch.ended)
    assert {total for total, _, _ in batch.ended} == {15.0}
    rewards = batch.rewards[batch.valid].reshape(-1, 3)[:, 0]
    np.testing.assert_array_equal(rewards, np.arange(len(rewards)) % 5 + 1)
    assert batch.valid.all() == (mode == "SameStep")
    # What follows the last step is its own last observation: the way goes on from there.
    table = judged(batch, batch.rewards, policy, settings)
    assert len(table.observations) == batch.valid.sum()
    wrong = judged(batch, batch.rewards, policy, replace(settings, crossing=True))
    assert len(wrong.observations) == 17 * 3
    for t in np.flatnonzero(batch.truncated[:, 0]).tolist():
        last = dict(batch.cut)[t] if mode == "SameStep" else batch.observations[t + 1]
        moved = batch.observations[t, 0, :2] - last[0, :2]
        np.testing.assert_allclose(moved, 0.05 * last[0, 2:], atol=1e-12)
        with torch.no_grad():
            value = policy.critic(policy.to_rows(last[:1])).item()
            now = policy.critic(policy.to_rows(batch.observations[t, :1])).item()
        row = int(batch.valid[:t].sum())
        assert table.advantages[row, 0] == pytest.approx(5.0 + 0.99 * value - now, rel=1e-5)
    ended = judged(batch, batch.rewards, policy, replace(settings, bootstrap=False))
    assert not np.allclose(ended.advantages, table.advantages)


def test_rewards_are_scaled_by_what_they_come_to():
    runner = Runner(points(6, max_steps=7), 0, SMALL)
    batch = runner.collect(ActorCritic(4, 2, 0, SMALL, 6))
    worth, sums = np.zeros(6), []
    for r, over in zip(batch.rewards, batch.terminated | batch.truncated, strict=True):
        worth = 0.99 * worth + r
        sums.append(worth)
        worth = np.where(over, 0.0, worth)
    np.testing.assert_allclose(runner.scaled(batch), batch.rewards / np.std(sums), rtol=1e-4)


@pytest.mark.prove
@pytest.mark.parametrize("mode", ["SameStep", "NextStep"])
def test_the_point_is_learned(mode):
    *_, last = ppo(points(64, mode), replace(SMALL, horizon=32, minibatches=4), steps=60_000)
    judge = points(128, reward="sparse")
    best = optimum(judge.reset(seed=10**6)[0])
    got = evaluate(last.policy, judge, 10**6)
    assert np.all(got.returns <= best + 1e-9)
    assert 0.5 < got.returns.mean() / best.mean() <= 1.0
    assert got.success.mean() > 0.7
    assert last.steps == 29 * 2048


def test_each_iteration_is_told_and_a_seed_is_a_run():
    def run(seed, **changes):
        return list(ppo(points(), replace(SMALL, **changes), steps=1024, seed=seed))

    one, same, other = run(1), run(1), run(2)
    assert [it.steps for it in one] == [256, 512, 768, 1024]
    assert all(it.kl > 0.0 and 0.0 <= it.clipped <= 1.0 and it.value_loss > 0.0 for it in one)
    for a, b in zip(one, same, strict=True):
        assert a.kl == b.kl and np.array_equal(a.returns, b.returns)
    assert one[-1].kl != other[-1].kl
    retained = one[0].policy.copy()
    before = retained(np.ones((2, 4)))
    next(ppo(points(), SMALL, steps=256, seed=1))
    np.testing.assert_array_equal(retained(np.ones((2, 4))), before)
    # A divergence that may not be passed stops the epochs, and large steps diverge more.
    bold = run(1, rate=0.03)[0].kl
    assert run(1, rate=0.03, most_kl=1e-3)[0].kl < bold and bold > one[0].kl


def test_every_detail_can_be_turned_off():
    def divergence(steps, **changes):
        *_, last = ppo(points(), replace(SMALL, **changes), steps=steps, seed=1)
        return last.kl

    plain = divergence(256), divergence(512)
    changes: list[dict[str, Any]] = [
        {"trace": 0.0},
        {"epochs": 1},
        {"discount": 0.5},
        {"clip": math.inf},
        {"entropy": 0.1},
        {"longest_gradient": 1e-3},
        {"normalise_advantages": False},
        {"scale_rewards": False},
        {"hidden": (4,)},
        {"spread": 0.5},
        {"value_weight": 0.0},
        {"rate": 1e-4},
    ]
    assert all(divergence(256, **change) != plain[0] for change in changes)
    for name in ("anneal", "normalise_observations", "shared"):  # from the second iteration on
        deviation: dict[str, Any] = {name: False}
        assert divergence(512, **deviation) != plain[1]
    one_each = next(ppo(points(), replace(SMALL, shared=False), steps=256)).policy
    assert one_each.normaliser.mean.shape == (64,)


class Broken(PointReachVector):
    """After three steps something of environment 1 is no number, or nothing ever changes."""

    what = "observation"

    def _move(self, actions):
        observed, rewards, over, late = super()._move(actions)
        if self.what == "still":
            observed[:, 3] = 0.0
        elif self.what == "fortune":
            rewards[1] = 1e30 * (self.task.steps[0] == 30)
        elif self.task.steps[0] == 3:
            (observed if self.what == "observation" else rewards)[1] = np.nan
        return observed, rewards, over, late


@pytest.mark.parametrize(
    ("what", "report"),
    [
        ("observation", "observation of environment 1 at step 2"),
        ("reward", "reward of environment 1 at step 2"),
    ],
)
def test_what_is_no_number_is_named(what, report):
    envs = Broken(16, autoreset_mode="SameStep")
    envs.what = what
    with pytest.raises(ValueError, match=report):
        next(ppo(envs, SMALL, steps=256))
    with pytest.raises(ValueError, match=report):
        evaluate(lambda observed: 0.0 * observed[:, :2], envs)


def test_an_observation_that_never_changes_is_refused():
    envs = Broken(16, autoreset_mode=AutoresetMode.NEXT_STEP)
    envs.what = "still"
    with pytest.raises(ValueError, match=r"variance of observations\[:, 3\]"):
        next(ppo(envs, SMALL, steps=256))


def test_a_run_that_diverges_keeps_the_last_good_weights():
    envs = Broken(16, autoreset_mode="SameStep")
    envs.what = "fortune"
    runs = ppo(
        envs, replace(SMALL, scale_rewards=False, trace=0.0, minibatches=8), steps=10**4, seed=3
    )
    policy = next(runs).policy
    good = policy.flat.detach().numpy().copy()
    with pytest.raises(Diverged, match="the loss is inf"):
        next(runs)
    np.testing.assert_array_equal(policy.flat.detach().numpy(), good)
    with pytest.raises(Diverged, match="lower the rate"):
        list(ppo(points(), replace(SMALL, rate=1e18, longest_gradient=math.inf), steps=10**4))


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.4, 1e-3], ids=["some reset", "all reset at once"])
def test_steps_that_reset_leave_fewer_rows_than_minibatches(radius):
    """Batches of one step of 8 environments, of which some, or all, only reset."""
    # At the first step all are at rest, so the velocities have no variance yet.
    settings = replace(SMALL, horizon=1, epochs=1, minibatches=8, normalise_observations=False)
    envs = points(8, "NextStep", max_steps=20, radius=radius)
    sizes: list[int] = []
    before: Any = None
    for iteration in ppo(envs, settings, steps=8 * 45, seed=1):
        weights = iteration.policy.flat.detach().numpy().copy()
        assert np.isfinite(weights).all() and math.isfinite(iteration.kl)
        # One step of each environment, so the rows are those whose episode had not just ended.
        rows = 8 - (sizes[-1] if sizes else 0)
        assert math.isnan(iteration.value_loss) == (rows == 0)
        if not rows:
            # Nothing was learned from, so nothing has changed.
            np.testing.assert_array_equal(weights, before)
            assert iteration.kl == iteration.clipped == 0.0
        sizes.append(len(iteration.returns))
        before = weights
    # Both kinds of batches occurred, after a step in which all episodes ended or some of them.
    assert (8 in sizes) if radius < 0.1 else any(0 < size < 8 for size in sizes)


@pytest.mark.parametrize("spread", [1e-4, 1e-9])
def test_a_policy_that_runs_away_with_finite_numbers_is_stopped(spread, monkeypatch):
    """Divergences of 1e5 and 1e15 in one iteration; the weights from before it are restored."""
    settings = replace(SMALL, spread=spread)
    first = ActorCritic(4, 2, 3, settings, 16).flat.detach().numpy()
    policies = []

    class Remembered(ActorCritic):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            policies.append(self)

    monkeypatch.setattr(sys.modules[ppo.__module__], "ActorCritic", Remembered)
    with pytest.raises(Diverged, match=r"by a KL divergence of .*: lower the rate"):
        next(ppo(points(), settings, steps=256, seed=3))
    np.testing.assert_array_equal(policies[0].flat.detach().numpy(), first)


@pytest.mark.parametrize("detached", [True, False])
def test_the_usual_listing_needs_detached_log_probabilities(detached):
    """Several epochs over one batch: the graph of the old policy is freed by the first."""
    torch.manual_seed(0)
    net, states, advantages = torch.nn.Linear(4, 2), torch.randn(8, 4), torch.randn(8)
    optimiser = torch.optim.Adam(net.parameters())

    def log_probs(actions):
        return torch.distributions.Normal(net(states), 1.0).log_prob(actions).sum(-1)

    actions = torch.distributions.Normal(net(states), 1.0).sample()
    old, epochs = log_probs(actions), 0
    old = old.detach() if detached else old
    try:
        for _ in range(3):
            ratio = (log_probs(actions) - old).exp()
            loss = -torch.min(ratio * advantages, ratio.clamp(0.8, 1.2) * advantages).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            epochs += 1
    except RuntimeError as problem:
        assert "backward through the graph a second time" in str(problem)
    assert epochs == (3 if detached else 1)


def test_an_end_needs_no_value_after_it():
    """What follows a termination is not used, so that it may be missing."""
    assert gae([1.0], [0.25], [math.nan], [True], [False])[0] == 0.75


wrong: Any = {"rate": 1.0}


def made(**values: Any) -> Settings:
    return Settings(**values)


def discrete() -> Any:
    envs: Any = points()
    envs.single_action_space = gymnasium.spaces.Discrete(3)
    return envs


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: Settings(discount=1.1), r"discount must be .*, got 1.1"),
        (lambda: Settings(trace=-0.1), r"trace must be .*, got -0.1"),
        (lambda: Settings(clip=0.0), r"clip must be .*, got 0.0"),
        (lambda: Settings(epochs=0), r"epochs must be .*, got 0"),
        (lambda: Settings(rate=math.nan), r"rate must be .*, got nan"),
        (
            lambda: next(ppo(points(), replace(SMALL, minibatches=3), steps=10)),
            r"minibatches must be .*, got 3",
        ),
        (
            lambda: next(ppo(points(mode="Disabled"), SMALL, steps=10)),
            r"autoreset_mode must be .*, got 'Dis",
        ),
        (lambda: next(ppo(points(), SMALL, steps=0)), r"steps must be .*, got 0"),
        (
            lambda: gae([1.0], [1.0, 2.0], [0.0], [False], [False]),
            r"values.shape must be .*, got \(2,\)",
        ),
        (lambda: gae([1.0], [1.0], [0.0], [False], [False], 2.0), r"discount must be .*, got 2.0"),
        (lambda: gae(1.0, 1.0, 0.0, False, False), r"rewards.shape must be .*, got \(\)"),
        (
            lambda: gae([1.0, math.nan], *cast(Any, np.zeros((4, 2)))),
            r"rewards\[1\] must be .*, got nan",
        ),
        (
            lambda: gae(np.zeros(2), [math.inf, 0.0], *cast(Any, np.zeros((3, 2)))),
            r"values\[0\] must be .*, got inf",
        ),
        (
            lambda: gae([1.0], [1.0], [math.nan], [False], [True]),
            r"following\[0\] must be .*, got nan",
        ),
        (lambda: made(clip="a"), r"clip must be .*, got 'a'"),
        (lambda: made(most_kl=(1.0, 2.0)), "most_kl must be"),
        (lambda: made(hidden=16), r"hidden must be .*, got 16"),
        (lambda: made(hidden=(16, 0)), r"hidden\[1\] must be .*, got 0"),
        (lambda: next(ppo(None, steps=10)), r"envs must be .*, got None"),
        (lambda: next(ppo(points(), wrong, steps=10)), r"settings must be .*, got {'rate': 1.0}"),
        (
            lambda: next(ppo(discrete(), SMALL, steps=10)),
            r"single_action_space must be .*, got Discrete\(3\)",
        ),
        (
            lambda: next(ppo(points(1), replace(SMALL, horizon=1, minibatches=1), steps=1)),
            r"horizon \* environments must be .*, got 1",
        ),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call()
