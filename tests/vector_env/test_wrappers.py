"""Every wrapper of `gymnasium.wrappers.vector`, in every mode: as around Gymnasium's own loop."""

import functools
import inspect
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.error import DependencyNotInstalled
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from gymnasium.wrappers import vector as wrappers

from course.oracles.gymnasium import sync_vector_env
from course.oracles.mujoco.reach import MujocoArmReach, MujocoArmReachVector
from course.vector_env import ArmReach, ArmReachVector, ProcessVectorEnv, VectorizedEnv
from tests import optional
from tests.vector_env.test_vector_env import Nested, identical

N, STEPS, EPISODE = 2, 8, 3
MODES = [mode.value for mode in AutoresetMode]
NAMES = sorted(
    {*wrappers.__all__}
    | {
        name
        for name, kind in vars(wrappers).items()
        if inspect.isclass(kind) and issubclass(kind, VectorWrapper)
    }
)


class Pixels(gymnasium.Env):
    """Coloured noise that ends where the action is 3."""

    observation_space = spaces.Box(0, 255, (8, 8, 3), np.uint8)
    action_space = spaces.Discrete(4)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._observation(), {"start": 1}

    def _observation(self):
        return self.np_random.integers(0, 256, (8, 8, 3)).astype(np.uint8)

    def step(self, action):
        return self._observation(), float(action), bool(action == 3), False, {"action": int(action)}


class Lasting(VectorWrapper):
    """Survives the closing of what is around it, and leaves the caller's options alone.

    Gymnasium's environments take the mask out of them: a wrapper outside no longer sees it.
    """

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=seed, options=dict(options) if options else None)

    def close(self, **kwargs):
        pass


def drawn_arm() -> ArmReach:
    return ArmReach(max_steps=EPISODE, render_mode="rgb_array")


def mujoco_arm() -> MujocoArmReach:
    return MujocoArmReach(max_steps=EPISODE)


# Wrappers that need a package of the extra `wrappers`.
NEED_MORE = {
    "ArrayConversion",
    "HumanRendering",
    "JaxToNumpy",
    "JaxToTorch",
    "NumpyToTorch",
    "RecordVideo",
    "ResizeObservation",
}

SINGLES = {"arm": drawn_arm, "MuJoCo": mujoco_arm, "image": Pixels, "nested": Nested}


@functools.cache
def backends(subject: str, mode: str) -> list[Lasting]:
    """Gymnasium's loop over an environment, and everybody of the course who steps the same."""
    single: Any = SINGLES[subject]
    every: list[VectorEnv] = [
        sync_vector_env(single, N, mode),
        VectorizedEnv(single, N, autoreset_mode=mode),
    ]
    common: dict[str, Any] = {"max_steps": EPISODE, "autoreset_mode": mode}
    if subject == "arm":
        every.append(ArmReachVector(N, render_mode="rgb_array", **common))
    if subject == "MuJoCo":
        every.append(MujocoArmReachVector(N, **common))
    else:
        every.append(ProcessVectorEnv(single, N, num_workers=1, autoreset_mode=mode))
    return [Lasting(envs) for envs in every]


@pytest.fixture(autouse=True, scope="module")
def closing():
    yield
    for subject in SINGLES:
        for mode in MODES:
            for envs in backends(subject, mode):
                envs.unwrapped.close()
    backends.cache_clear()


def arguments(name: str, kind: type, folder: str) -> dict[str, Any]:
    """What a wrapper asks for, by the names of its parameters: a new one needs no entry here."""
    known: dict[str, Any] = {
        "func": np.negative,
        "observation_space": None,
        "action_space": None,
        "filter_keys": ["x"],
        "shape": (2, 4),
        "dtype": np.float32,
        "min_obs": 0,
        "max_obs": 100,
        "min_action": -0.5,
        "max_action": 0.5,
        "min_reward": -0.4,
        "max_reward": 0.3,
        "video_folder": folder,
        "env_xp": np,
        "target_xp": np,
    }
    result: dict[str, Any] = {}
    for parameter in [*inspect.signature(kind).parameters.values()][1:]:
        if parameter.name == "wrapper":
            # It brings a single environment's wrapper to many: the one of that name.
            single: Any = getattr(gymnasium.wrappers, name.removeprefix("Vectorize"))
            result |= {"wrapper": single, **arguments(name, single, folder)}
        elif parameter.name in known:
            result[parameter.name] = known[parameter.name]
        else:
            optional = parameter.default is not parameter.empty or parameter.kind.name != (
                "POSITIONAL_OR_KEYWORD"
            )
            assert optional, f"{name} asks for {parameter.name}: say what in `known`"
    return result


def plain(value: Any) -> Any:
    """NumPy's arrays for anybody's, and no wall-clock times."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items() if key != "t"}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return np.asarray(value) if hasattr(value, "__array__") else value


def played(name: str, envs: VectorEnv, mode: str, folder: str) -> tuple[list[Any], str]:
    """What a wrapped environment returns over some episodes, and the error that ended it, if any.

    Raises:
        ImportError, DependencyNotInstalled: if the wrapper needs a library that is not there.
    """
    received: list[Any] = []
    try:
        kind = getattr(wrappers, name)
        wrapped = kind(envs, **arguments(name, kind, folder))
        wrapped.action_space.seed(7)
        received.append(plain(wrapped.reset(seed=3)))
        for _ in range(STEPS):
            received.append(plain(wrapped.step(wrapped.action_space.sample())))
            over = received[-1][2] | received[-1][3]
            if mode == "Disabled" and over.any():
                received.append(plain(wrapped.reset(options={"reset_mask": over})))
        wrapped.close()
    except (ImportError, DependencyNotInstalled):
        raise
    except Exception as error:
        return received, type(error).__name__
    return received, ""


@pytest.mark.prove
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.optional] if n in NEED_MORE else []) for n in NAMES],
)
def test_a_wrapper_sees_what_it_sees_around_gymnasiums_loop(name, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")  # HumanRendering opens a window
    ran, lacking = set(), ""
    for subject in SINGLES:
        for mode in MODES:
            result = []
            for k, envs in enumerate(backends(subject, mode)):
                folder = tmp_path / f"{subject}{mode}{k}"
                try:
                    received, refusal = played(name, envs, mode, str(folder))
                except (ImportError, DependencyNotInstalled) as error:
                    lacking = str(error)
                    break
                files = sorted(path.name for path in folder.glob("*"))
                result.append((received, refusal, files))
            for received, refusal, files in result[1:]:
                # Where Gymnasium gives up, others need not: so with the masks of the Jax wrappers.
                observed, gave_up, written = result[0]
                identical(received[: len(observed)] if gave_up else received, observed)
                assert gave_up or (refusal, files) == ("", written)
            if result and not result[0][1]:
                ran.add(mode)
    print(f"{name}: {', '.join(sorted(ran))}")
    if lacking:
        assert name in NEED_MORE, f"{lacking}: a wrapper that needs more than the core is optional"
        optional.skip(f"{name} did NOT run: {lacking}")
    assert ran
