"""The adapter for Stable-Baselines3: as the library's own loop over single environments.

Its name puts it last in the folder: a process that has loaded torch pays more for each fork.
"""

import sys
from copy import deepcopy
from typing import Any

import gymnasium
import numpy as np
import pytest

from course.oracles import sb3
from course.vector_env import ArmReach, ArmReachVector, ProcessVectorEnv, VectorizedEnv
from tests import optional
from tests.vector_env.test_vector_env import Counter, identical
from tests.vector_env.test_wrappers import Pixels


@pytest.fixture
def library() -> Any:
    try:
        from stable_baselines3.common import vec_env
    except ImportError:
        optional.skip("the adapter was NOT compared with the library: pip install -e '.[sb3]'")
    return vec_env


def arm() -> ArmReach:
    return ArmReach(max_steps=7, render_mode="rgb_array")


class Detached(gymnasium.Wrapper):
    """Results of its own: the library's loop copies the infos after the reset has written over."""

    def reset(self, **kwargs):
        return deepcopy(self.env.reset(**kwargs))

    def step(self, action):
        return deepcopy(self.env.step(action))


def counter() -> gymnasium.Env:
    return Detached(Counter())


CASES: dict[str, Any] = {
    "arrays": (
        arm,
        lambda n: ArmReachVector(
            n, max_steps=7, render_mode="rgb_array", autoreset_mode="SameStep"
        ),
    ),
    "loop": (arm, lambda n: VectorizedEnv(arm, n, autoreset_mode="SameStep")),
    "processes": (arm, lambda n: ProcessVectorEnv(arm, n, autoreset_mode="SameStep")),
    "infos and options": (counter, lambda n: VectorizedEnv(counter, n, autoreset_mode="SameStep")),
    "pixels": (Pixels, lambda n: VectorizedEnv(Pixels, n, autoreset_mode="SameStep")),
}


@pytest.mark.slow
@pytest.mark.optional
@pytest.mark.parametrize("case", CASES)
def test_the_adapter_is_the_librarys_own_loop(library, case: str) -> None:
    single, batch = CASES[case]
    truth, ours = library.DummyVecEnv([single] * 3), sb3.vec_env(batch(3))
    assert isinstance(ours, library.VecEnv)
    assert (ours.observation_space, ours.action_space) == (
        truth.observation_space,
        truth.action_space,
    )
    assert ours.render_mode == truth.render_mode
    ended = 0
    for again in range(2):
        for envs in (truth, ours):
            envs.seed(5 + again)
            envs.set_options({"a": again} if single is counter else None)
        identical(ours.reset(), truth.reset())
        identical(ours.reset_infos, truth.reset_infos)
        truth.action_space.seed(1)
        for _ in range(20):
            actions = np.stack([truth.action_space.sample() for _ in range(3)])
            result, expected = ours.step(actions), truth.step(actions)
            identical(result, expected)
            identical(ours.reset_infos, truth.reset_infos)
            ended += int(expected[2].sum())
    assert ended > 3
    if single is arm:
        identical(ours.render(), truth.render())
    ours.close(), truth.close()


@pytest.mark.optional
def test_attributes_methods_and_wrappers(library) -> None:
    ours = sb3.vec_env(VectorizedEnv(counter, 3, autoreset_mode="SameStep"))
    truth = library.DummyVecEnv([counter] * 3)
    for envs in (truth, ours):
        assert envs.get_attr("ends") == [5, 5, 5] and envs.get_attr("clock", [0, 2]) == [4, 4]
        assert envs.env_is_wrapped(Detached) == [True] * 3
        assert envs.env_is_wrapped(gymnasium.wrappers.ClipAction, 1) == [False]
        assert envs.env_method("has_wrapper_attr", "ends") == [True] * 3
        assert envs.has_attr("ends") and not envs.has_attr("no such thing")
    ours.set_attr("colour", "green", [1])
    assert ours.get_attr("colour") == ["red", "green", "red"]
    with pytest.raises(ValueError, match=r"indices must be None.*, got 1"):
        ours.env_method("close", indices=1)
    ours.set_options([{}, {"a": 1}, {}])
    with pytest.raises(ValueError, match=r"options must be the same for all"):
        ours.reset()
    arrays = sb3.vec_env(ArmReachVector(2, autoreset_mode="SameStep"))
    assert arrays.env_is_wrapped(Detached) == [False, False]


@pytest.mark.optional
def test_the_library_trains_on_it(library) -> None:
    from stable_baselines3 import PPO

    envs = library.VecMonitor(sb3.vec_env(ArmReachVector(8, autoreset_mode="SameStep")))
    model = PPO("MlpPolicy", envs, n_steps=128, batch_size=256, n_epochs=1, seed=0, device="cpu")
    before = [p.detach().clone() for p in model.policy.parameters()]
    model.learn(1024)
    assert model.num_timesteps == 1024 and len(model.ep_info_buffer or []) >= 8
    after = [*model.policy.parameters()]
    assert any((a != b).any() for a, b in zip(after, before, strict=True))


@pytest.mark.optional
@pytest.mark.parametrize("mode", ["NextStep", "Disabled"])
def test_another_autoreset_mode_is_refused(library, mode: str) -> None:
    with pytest.raises(ValueError, match=rf"autoreset_mode must be 'SameStep'.*, got '{mode}'"):
        sb3.vec_env(ArmReachVector(2, autoreset_mode=mode))


def test_without_the_library_one_sentence_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ImportError, match=r"pip install 'stable-baselines3>=2\.9'"):
        sb3.vec_env(ArmReachVector(2, autoreset_mode="SameStep"))


def test_infos_by_environment() -> None:
    mask, one = np.array([True, True]), np.array([False, True])
    infos = {"a": np.array([1, 2]), "_a": mask, "b": {"c": np.array([0.0, 3.5]), "_c": one}}
    assert sb3.rows({**infos, "_b": one}, 2) == [{"a": 1}, {"a": 2, "b": {"c": 3.5}}]
