"""The learner that a page runs is the chapter's `ppo`: the same numbers but for float32."""

import importlib
import math
from typing import Any

import numpy as np
import pytest

from course.learning import evaluate, first_finished
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.learning import learner, point
from course.simulations.model import Experiment
from course.vector_env import PointReachVector
from tests.budget import sampled
from tests.learning import presets

pytestmark = pytest.mark.slow

chapter: Any = importlib.import_module("course.learning.ppo")


def test_exponential_and_hyperbolic_tangent_are_those_of_the_library() -> None:
    for x in np.linspace(-88.0, 88.0, 4001):
        assert learner.exp(x) == pytest.approx(math.exp(x), rel=1e-11)
        assert learner.tanh(x) == pytest.approx(math.tanh(x), abs=1e-11)
    assert learner.exp(88.1) == learner.exp(math.nan) == math.inf
    assert learner.exp(-1e9) == learner.exp(-88.0)
    assert learner.tanh(1e9) == 1.0 == -learner.tanh(-1e9)


def test_the_first_weights_are_orthogonal_and_the_actor_starts_near_zero() -> None:
    weights, hidden = np.empty(learner.WEIGHTS), learner.HIDDEN
    learner.initialise(weights, np.array([np.uint64(4)]))
    for start, outputs, last in ((0, 2, 0.01), (learner.CRITIC, 1, 1.0)):
        first = weights[start : start + 4 * hidden].reshape(hidden, 4)
        np.testing.assert_allclose(first.T @ first, 2.0 * np.eye(4), atol=1e-12)
        at = start + 5 * hidden
        second = weights[at : at + hidden * hidden].reshape(hidden, hidden)
        np.testing.assert_allclose(second @ second.T, 2.0 * np.eye(hidden), atol=1e-12)
        at += hidden * hidden + hidden
        third = weights[at : at + outputs * hidden].reshape(outputs, hidden)
        np.testing.assert_allclose(third @ third.T, last**2 * np.eye(outputs), atol=1e-12)
    assert np.all(weights[learner.LOG_STD :] == 0.0)


class Stream:
    """The learner's random numbers, as the chapter's runner and environments take theirs."""

    def __init__(self, random: Any) -> None:
        self.random = random

    def normal(self, size: tuple[int, ...]) -> Any:
        return learner.normal(self.random, math.prod(size)).reshape(size)

    def permutation(self, n: int) -> Any:
        state = {"random": self.random, "order": np.empty(n, np.int64)}
        learner.shuffle(state)
        return state["order"]

    def starts(self, task: Any) -> Any:
        """What takes the place of a task's `start`."""

        def start(ids: Any, _generators: Any) -> Any:
            draws = np.empty(4 * len(ids))
            splitmix.uniform(self.random, draws)
            given = draws.reshape(-1, 4), ids, task.p, task.v, task.goal, task.steps, task.numbers
            return learner.place(*given)

        return start


@pytest.mark.parametrize(
    "preset", sampled(["Potential", "Hovering", "Lambda 0", "No reward scaling"], 3)
)
def test_two_iterations_are_those_of_the_chapter(preset: str, monkeypatch: Any) -> None:
    """The same random numbers and first weights, through `ppo` itself."""
    run = Experiment(point.MODEL, **{**point.PRESETS[preset].values, "seed": 3, "epochs": 3})
    stream = Stream(np.array([np.uint64(3)]))
    first = np.empty(learner.WEIGHTS)
    learner.initialise(first, stream.random)
    np.testing.assert_array_equal(first, run.state["weights"])
    torch = importlib.import_module("torch")

    class Policy(chapter.ActorCritic):  # type: ignore[misc]
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            with torch.no_grad():
                self.flat.copy_(torch.from_numpy(first.astype(np.float32)))

    class Runner(chapter.Runner):  # type: ignore[misc]
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            self.rng = stream

    monkeypatch.setattr(chapter, "ActorCritic", Policy)
    monkeypatch.setattr(chapter, "Runner", Runner)
    kind = point.REWARDS[run.controls["reward"]]
    envs = PointReachVector(point.POINTS, kind, autoreset_mode="SameStep")
    monkeypatch.setattr(envs.task, "start", stream.starts(envs.task))
    steps = point.ITERATIONS * point.POINTS * point.HORIZON
    iterations = chapter.ppo(envs, presets.settings_of(run.controls), steps=steps)
    ended = 0
    for k in range(2):
        now = next(iterations)
        run.advance(point.PICTURE)
        assert run.state["trained"] == k + 1 and run.state["part"] == 0
        weights, state = now.policy.flat.detach().numpy(), run.state
        moved = np.abs(state["weights"] - first).max()
        assert np.abs(state["weights"] - weights).max() < 2e-3 * moved
        assert state["kl"] == pytest.approx(now.kl, rel=5e-3)
        np.testing.assert_allclose(state["mean"][:4], now.policy.normaliser.mean, atol=1e-5)
        np.testing.assert_allclose(state["variance"][:4], now.policy.normaliser.variance, rtol=1e-5)
        assert state["random"] == stream.random
        ended += now.returns.size
    assert ended > 20  # episodes that began anew, so that their starts were compared


def policy_of(state: Any) -> Any:
    """The policy of a state, written down in NumPy."""
    w, n = state["weights"], learner.HIDDEN

    def act(observed: Any) -> Any:
        scaled = (observed - state["mean"][:4]) / np.sqrt(state["variance"][:4] + 1e-8)
        x, at = np.clip(scaled, -10.0, 10.0), 0
        for size in (n, n, 2):
            end = at + size * x.shape[1]
            x = x @ w[at:end].reshape(size, -1).T + w[end : end + size]
            x, at = (np.tanh(x) if size == n else x), end + size
        return x

    return act


@pytest.mark.prove
@pytest.mark.parametrize("preset", ["First to finish", "Hovering"])
def test_what_is_judged_is_one_episode_of_each_common_start(preset: str, monkeypatch: Any) -> None:
    run = Experiment(point.MODEL, **{**point.PRESETS[preset].values, "first": True})
    run.advance(12 * point.PICTURE + 0.001)
    report, act = run.state["report"][12], policy_of(run.state)
    test = PointReachVector(point.STARTS, point.REWARDS[run.controls["reward"]])
    played = evaluate(act, test, point.FIRST)
    assert report[point.SUCCESS] == played.success.mean()
    assert report[point.RETURN] == pytest.approx(played.returns.mean(), abs=1e-5)
    paths, ends = run.state["paths"][12], run.state["steps"][12]
    assert np.array_equal(ends, played.steps[: point.SHOWN])
    inside = np.hypot(*paths.transpose(1, 0, 2)) < point.RADIUS
    for i, end in enumerate(ends):
        assert inside[i, end] == run.state["arrived"][12, i] and not inside[i, :end].any()
        assert np.all(paths[i, :, end:] == paths[i, :, end:][:, :1])
    # Whoever restarts begins at the same new starts.
    stream, start = Stream(np.array([np.uint64(point.FIRST)])), test.task.start
    again = stream.starts(test.task)
    first = [start, again]

    def starts(ids: Any, generators: Any) -> Any:
        return (first.pop(0) if len(first) > 1 else again)(ids, generators)

    monkeypatch.setattr(test.task, "start", starts)
    read = first_finished(act, test, point.STARTS, point.FIRST)
    assert report[point.READ] == read.success.mean()
    assert read.steps.min() < point.MAX_STEPS


def test_a_run_that_diverges_stops_and_shows_its_last_policy() -> None:
    run = Experiment(point.MODEL, epochs=1)
    run.advance(2 * point.PICTURE + 0.001)
    run.state["weights"][learner.CRITIC :] = 1e200
    run.advance(point.PICTURE)
    state = run.state
    assert state["diverged"] == 1 and state["trained"] == point.ITERATIONS
    assert np.all(state["report"][3:] == state["report"][2])
    assert np.all(state["paths"][3:] == state["paths"][2])
    assert not np.array_equal(state["report"][2], state["report"][1])
    run.advance(point.PICTURE)
    assert any("diverged" in item.words for item in draw.decode(run.picture()))


def test_pieces_of_time_train_what_a_whole_does() -> None:
    whole, pieces = Experiment(point.MODEL, epochs=2), Experiment(point.MODEL, epochs=2)
    whole.advance(2.0)
    for _ in range(40):
        pieces.advance(0.05)
    assert abs(int(whole.state["trained"]) - int(pieces.state["trained"])) <= 1
    done = min(int(whole.state["trained"]), int(pieces.state["trained"])) + 1
    assert done >= 4
    assert np.array_equal(whole.state["report"][:done], pieces.state["report"][:done])
