"""Vector environments: equal to a loop and to Gymnasium's, hostile workers, nothing left behind."""

import contextlib
import gc
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode
from hypothesis import given
from hypothesis import strategies as st

from course.oracles.gymnasium import sync_vector_env
from course.vector_env import ProcessVectorEnv, VectorizedEnv, WorkerError
from tests.budget import examples

ROOT = Path(__file__).resolve().parents[2]
MODES = [mode.value for mode in AutoresetMode]


class Counter(gymnasium.Env):
    """Counts its steps from a random start; ends by itself or by the clock, at times by both.

    It hands out the same observation array every time, as environments with a buffer do.
    """

    def __init__(self, ends: int = 5, clock: int = 4, trouble: str = "") -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.ends, self.clock, self.trouble = ends, clock, trouble
        self._buffer = np.zeros(3)
        self.colour = "red"

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.count, self.length = 0, int(self.np_random.integers(1, self.ends + 1))
        self._buffer[:] = self.np_random.random(), self.length, 0.0
        return self._buffer, {"length": self.length, "options": dict(options or {})}

    def step(self, action):
        self.count += 1
        self._buffer[2] += float(action[0]) + self.np_random.normal()
        if self.trouble and self.length == 1:
            self._misbehave()
        info: dict[str, Any] = {"count": self.count}
        if self.count % 2:
            info |= {"odd": {"half": self.count / 2, "vector": self._buffer[:2]}, "text": "odd"}
        return (
            self._buffer,
            float(action[1]),
            self.count >= self.length,
            self.count >= self.clock,
            info,
        )

    def _misbehave(self) -> None:
        if self.trouble == "raise":
            raise KeyError("lost its way")
        if self.trouble == "odd exception":

            class LocalError(Exception):
                def __init__(self, one, two):
                    super().__init__(one)

            raise LocalError(1, 2)
        if self.trouble == "exit":
            sys.exit(3)
        if self.trouble == "os exit":
            os._exit(7)
        if self.trouble == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.trouble == "hang":
            self.stare_into_space()
        if self.trouble == "stop":
            os.kill(os.getpid(), signal.SIGSTOP)
        if self.trouble == "grandchild":
            subprocess.Popen(["sleep", "1000"])
            os._exit(1)
        if self.trouble == "fork":
            if os.fork() == 0:
                time.sleep(1000)
            os._exit(2)

    def stare_into_space(self) -> None:
        while True:
            time.sleep(0.01)

    def close(self) -> None:
        if self.trouble == "close":
            raise OSError("would not close")


class Nested(gymnasium.Env):
    """Dict and Tuple spaces."""

    observation_space = spaces.Dict(
        {
            "x": spaces.Box(-9, 9, (2, 2), np.float32),
            "pair": spaces.Tuple((spaces.Discrete(9), spaces.MultiBinary(3))),
        }
    )
    action_space = spaces.Dict({"go": spaces.Discrete(5), "how": spaces.Box(-1, 1, (2,))})

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self._observation(0), {}

    def _observation(self, k):
        x = self.np_random.random((2, 2)).astype(np.float32)
        return {"x": x, "pair": (k, np.array([k % 2, 1, 0], np.int8))}

    def step(self, action):
        k = int(action["go"])
        return self._observation(k), float(np.sum(action["how"])), k == 4, False, {}


class Talker(gymnasium.Env):
    """Observations that no array of a fixed size holds."""

    observation_space = spaces.Text(9, charset="abcdefgh")
    action_space = spaces.Discrete(8)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return "a", {}

    def step(self, action):
        return "abcdefgh"[: 1 + int(action)], 1.0, action == 7, False, {"word": "x"}


def identical(a: Any, b: Any) -> None:
    """Equal down to the dtype and the bit."""
    assert type(a) is type(b), (a, b)
    if isinstance(a, dict):
        assert a.keys() == b.keys(), (a.keys(), b.keys())
        for key in a:
            identical(a[key], b[key])
    elif isinstance(a, tuple | list):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            identical(one, other)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape, (a.dtype, b.dtype)
        if a.dtype == object:
            for one, other in zip(a, b, strict=True):
                identical(one, other)
        else:
            np.testing.assert_array_equal(a, b)
    else:
        assert a == b


def children() -> set[int]:
    """Processes below this one, finished ones that nobody has asked for included.

    Not Python's own helpers for spawned processes, which it keeps for the next time.
    """
    result = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text().rpartition(")")[2].split()
                helper = b"tracker import main" in (command := (entry / "cmdline").read_bytes())
            except OSError:
                continue
            helper = helper or b"forkserver import main" in command
            if int(stat[1]) == os.getpid() and not helper:
                result.add(int(entry.name))
    return result


def group_members(groups: set[int]) -> set[int]:
    """Processes whose group is one of these."""
    result = set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(stat[2]) in groups and stat[0] != "Z":
                result.add(int(entry.name))
    return result


def soon(holds, seconds: float = 60.0) -> bool:
    """Whether something becomes true within some seconds."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def abandoned(before: set[str]) -> set[str]:
    """Return the new entries of shared memory that no process of other tests has mapped."""
    new, used = set(os.listdir("/dev/shm")) - before, ""
    for process in os.listdir("/proc") if new else ():
        with contextlib.suppress(OSError):
            if process.isdigit() and int(process) != os.getpid():
                used += Path("/proc", process, "maps").read_text()
    return {name for name in new if f"/dev/shm/{name}" not in used}


@pytest.fixture(autouse=True, scope="module")
def first_use():
    """Python opens some files for good when processes are first used."""
    ProcessVectorEnv(Counter, 2).close()


@pytest.fixture(autouse=True)
def nothing_stays_behind():
    processes, shared = children(), set(os.listdir("/dev/shm"))
    descriptors = len(os.listdir("/proc/self/fd"))
    yield
    gc.collect()
    assert soon(lambda: children() <= processes), children() - processes
    assert soon(lambda: not abandoned(shared)), abandoned(shared)
    # Python keeps a block of shared memory for the next use, and a pipe to each of its helpers.
    assert len(os.listdir("/proc/self/fd")) <= descriptors + 3


# --- the same results, whoever steps -------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("workers", [1, 2, 5])
def test_processes_loop_and_gymnasium_agree_to_the_bit(mode: str, workers: int) -> None:
    truth = sync_vector_env(lambda: Copying(Counter()), 5, mode)
    loop = VectorizedEnv(Counter, 5, autoreset_mode=mode)
    processes = ProcessVectorEnv(Counter, 5, num_workers=workers, autoreset_mode=mode)
    rng = np.random.default_rng(3)
    every = (truth, loop, processes)
    start = [envs.reset(seed=[3, 1, 4, 1, 5], options={"a": 1}) for envs in every]
    identical(start[1], start[0])
    identical(start[2], start[0])
    both = 0
    for _ in range(40):
        actions = rng.uniform(-1, 1, (5, 2)).astype(np.float32)
        steps = [envs.step(actions) for envs in every]
        identical(steps[1], steps[0])
        identical(steps[2], steps[0])
        both += int(np.sum(steps[0][2] & steps[0][3]))
        over = steps[0][2] | steps[0][3]
        if mode == "Disabled" and over.any():
            for ours in (loop, processes):
                with pytest.raises(ResetNeeded, match=rf"{np.flatnonzero(over)[0]}.* are over"):
                    ours.step(actions)
            again = [envs.reset(options={"reset_mask": over}) for envs in every]
            identical(again[1], again[0])
            identical(again[2], again[0])
    assert both > 0
    mask = np.array([True, False, True, False, False])
    partial = [
        envs.reset(seed=[7, None, None, 2, 3], options={"reset_mask": mask}) for envs in every
    ]
    identical(partial[1], partial[0])
    identical(partial[2], partial[0])
    for envs in every:
        envs.close()


class Copying(gymnasium.Wrapper):
    """Observations and infos of their own: Gymnasium's loop keeps references to what it gets."""

    def reset(self, **kwargs):
        observation, info = self.env.reset(**kwargs)
        return observation.copy(), info

    def step(self, action):
        observation, *rest = self.env.step(action)
        return observation.copy(), *rest


@examples(20)
@given(
    n=st.integers(1, 6), seed=st.integers(0, 2**31), ends=st.integers(1, 6), clock=st.integers(1, 6)
)
def test_a_vector_environment_is_a_loop_over_single_ones(n, seed, ends, clock) -> None:
    """Written out here, without any of the code under test."""
    envs = VectorizedEnv(lambda: Counter(ends, clock), n, autoreset_mode="SameStep")
    singles = [Counter(ends, clock) for _ in range(n)]
    observations, _ = envs.reset(seed=seed)
    for i, env in enumerate(singles):
        np.testing.assert_array_equal(observations[i], env.reset(seed=seed + i)[0])
    rng = np.random.default_rng(seed)
    for _ in range(12):
        actions = rng.uniform(-1, 1, (n, 2)).astype(np.float32)
        observations, rewards, terminations, truncations, infos = envs.step(actions)
        for i, env in enumerate(singles):
            observation, reward, terminated, truncated, info = env.step(actions[i])
            assert (rewards[i], terminations[i], truncations[i]) == (reward, terminated, truncated)
            over = terminated or truncated
            assert ("final_obs" in infos and infos["_final_obs"][i]) == over
            if over:
                np.testing.assert_array_equal(infos["final_obs"][i], observation)
                assert infos["_final_info"][i]
                assert infos["final_info"]["_count"][i]
                assert infos["final_info"]["count"][i] == info["count"]
                observation, info = env.reset()
                assert infos["_length"][i] and infos["length"][i] == info["length"]
            np.testing.assert_array_equal(observations[i], observation)
    envs.close()


@pytest.mark.parametrize("env_fn", [Nested, Talker])
def test_other_spaces_travel_as_well(env_fn) -> None:
    truth = sync_vector_env(env_fn, 3)
    ours: list[Any] = [VectorizedEnv(env_fn, 3), ProcessVectorEnv(env_fn, 3, num_workers=2)]
    first = truth.reset(seed=1)
    for envs in ours:
        identical(envs.reset(seed=1), first)
    truth.action_space.seed(5)
    for _ in range(25):
        actions = truth.action_space.sample()
        expected = truth.step(actions)
        for envs in ours:
            identical(envs.step(actions), expected)
    truth.close()
    for envs in ours:
        envs.close()


@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
def test_nothing_returned_changes_later(kind) -> None:
    envs = kind(lambda: Counter(ends=2), 3)
    returned = [envs.reset(seed=1)]
    actions = np.full((3, 2), 0.5, np.float32)
    returned += [envs.step(actions) for _ in range(4)]
    retained = [repr(item) for item in returned]
    for _ in range(6):
        envs.step(actions)
    assert [repr(item) for item in returned] == retained
    np.testing.assert_array_equal(actions, 0.5)
    envs.close()


def test_every_environment_has_its_own_seed() -> None:
    envs = VectorizedEnv(Counter, 4)
    shifted = envs.reset(seed=10)[0][:, 0]
    assert len(set(shifted)) == 4
    np.testing.assert_array_equal(envs.reset(seed=[13, 12, 11, 10])[0][:, 0], shifted[::-1])
    again = envs.reset()[0][:, 0]  # goes on with the generators, doesn't seed them again
    assert not set(again) & set(shifted)
    envs.close()


# --- wrong use ------------------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
@pytest.mark.parametrize(
    ("actions", "text"),
    [
        (np.zeros((3, 2), np.float32), r"\.shape must be \(4, 2\).*, got \(3, 2\)"),
        (np.zeros((5, 2), np.float32), r"got \(5, 2\)"),
        (np.zeros((4, 3), np.float32), r"got \(4, 3\)"),
        (np.zeros(8, np.float32), r"got \(8,\)"),
        (np.zeros((4, 2), complex), r"\.dtype must be float32.*, got .*complex128.*"),
        (np.full((4, 2), "0.1"), r"\.dtype must be float32.*, got .*<U3.*"),
        (np.array([[0, 0], [0, 0], [0, np.nan], [0, 0]]), r"\[2, 1\] must be .*, got nan"),
        (None, r"got \(\)"),
    ],
)
def test_wrong_actions_are_refused_and_do_no_harm(kind, actions, text) -> None:
    envs, untouched = kind(Counter, 4), kind(Counter, 4)
    envs.reset(seed=0), untouched.reset(seed=0)
    with pytest.raises(ValueError, match=rf"actions.*{text}"):
        envs.step(actions)
    good = np.zeros((4, 2))
    identical(envs.step(good), untouched.step(good))
    envs.close()
    untouched.close()


def test_a_discrete_action_must_be_whole() -> None:
    envs = VectorizedEnv(lambda: gymnasium.make("CartPole-v1"), 2)
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions.dtype must be int64.*, got .*float64.*"):
        envs.step(np.array([0.7, 1.0]))
    nested = VectorizedEnv(Nested, 2)
    nested.reset(seed=0)
    with pytest.raises(
        ValueError, match=r"actions.keys\(\) must be \['go', 'how'\].*, got \['go'\]"
    ):
        nested.step({"go": np.array([1, 1])})
    with pytest.raises(ValueError, match=r"actions\['how'\].shape must be \(2, 2\).*, got \(2,\)"):
        nested.step({"go": np.array([1, 1]), "how": np.zeros(2)})
    envs.close()
    nested.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((Counter, 0), r"num_envs must be a positive integer.*, got 0"),
        ((Counter, 2.0), "num_envs"),
        ((Counter, True), "num_envs"),
        ((Counter(), 2), "env_fn must be a function"),
    ],
)
def test_wrong_construction_is_refused(kind, arguments, text) -> None:
    with pytest.raises(ValueError, match=text):
        kind(*arguments)


def test_more_wrong_construction() -> None:
    one = Counter()
    with pytest.raises(ValueError, match="new environment at every call"):
        VectorizedEnv(lambda: one, 2)
    turns = iter([Counter(), Nested()])
    with pytest.raises(ValueError, match="environment 1 must be"):
        VectorizedEnv(lambda: next(turns), 2)
    with pytest.raises(
        ValueError, match=r"autoreset_mode must be one of 'NextStep', 'SameStep', 'D.*, got 'Never'"
    ):
        VectorizedEnv(Counter, 2, autoreset_mode="Never")
    with pytest.raises(ValueError, match=r"num_workers must be an integer from 1 to 2.*, got 3"):
        ProcessVectorEnv(Counter, 2, num_workers=3)
    with pytest.raises(ValueError, match=r"timeout must be a positive.*, got 0.0"):
        ProcessVectorEnv(Counter, 2, timeout=0.0)


@pytest.mark.prove
@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
@pytest.mark.parametrize("seed", [[1, 2], -1, "12", 1.5, [1, 2, -3], [1, 2, True]])
def test_wrong_seeds_are_refused(kind, seed) -> None:
    envs = kind(Counter, 3)
    with pytest.raises(ValueError, match="seed must be"):
        envs.reset(seed=seed)
    for mask in ([True, False, True], np.array([True]), np.zeros(3, bool), np.ones(3)):
        if not isinstance(mask, list):
            with pytest.raises(ValueError, match="reset_mask"):
                envs.reset(options={"reset_mask": mask})
    envs.close()


@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
def test_a_partial_reset_comes_after_a_whole_one(kind) -> None:
    envs, mask = kind(Counter, 3), np.array([True, False, True])
    with pytest.raises(ResetNeeded, match="before all were reset once"):
        envs.reset(options={"reset_mask": mask})
    # The refused call has changed nothing.
    envs.reset(seed=0)
    assert len(envs.reset(options={"reset_mask": mask})[0]) == 3
    envs.close()


@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
def test_closing_twice_is_fine_and_using_it_then_is_not(kind) -> None:
    envs = kind(Counter, 2)
    envs.reset(seed=0)
    envs.close()
    envs.close()
    for use in (envs.reset, lambda: envs.step(np.zeros((2, 2))), lambda: envs.get_attr("colour")):
        with pytest.raises(ClosedEnvironmentError):
            use()


@pytest.mark.parametrize("kind", [VectorizedEnv, ProcessVectorEnv])
def test_attributes_and_methods(kind) -> None:
    envs = kind(Counter, 3)
    envs.set_attr("colour", ["red", "green", "blue"])
    assert envs.get_attr("colour") == ("red", "green", "blue")
    envs.set_attr("colour", "grey")
    assert envs.call("colour") == ("grey",) * 3
    with pytest.raises(ValueError, match=r"len\(values\) must be 3.*, got 1"):
        envs.set_attr("colour", ["red"])
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.observation_space.shape == (3, 3) and envs.single_action_space.shape == (2,)
    envs.close()


# --- hostile workers ------------------------------------------------------------------------------


def troubled(trouble: str, timeout: float = 30.0) -> ProcessVectorEnv:
    """Four environments on two workers; number 2 alone comes to an episode of length 1."""
    envs = ProcessVectorEnv(lambda: Counter(trouble=trouble), 4, num_workers=2, timeout=timeout)
    lengths = {s: int(np.random.default_rng(s).integers(1, 6)) for s in range(50)}
    short = next(s for s, n in lengths.items() if n == 1)
    tall = [s for s, n in lengths.items() if n == 5]
    envs.reset(seed=[tall[0], tall[1], short, tall[2]])
    return envs


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trouble", "how", "text"),
    [
        ("raise", "raised", "environment 2, worker 1: raised KeyError\\('lost its way'\\)"),
        ("odd exception", "raised", "environment 2, worker 1: raised LocalError"),
        ("exit", "raised", "environment 2, worker 1: raised SystemExit\\(3\\)"),
        ("os exit", "died", "environment 2, worker 1: exited with status 7"),
        ("kill", "died", "environment 2, worker 1: was killed by SIGKILL"),
        ("grandchild", "died", "environment 2, worker 1: exited with status 1"),
        ("fork", "died", "environment 2, worker 1: exited with status 2"),
    ],
)
def test_a_worker_that_fails_is_reported(trouble: str, how: str, text: str) -> None:
    envs = troubled(trouble)
    pids = {process.pid for process in envs._processes}
    with pytest.raises(WorkerError, match=text) as caught:
        envs.step(np.zeros((4, 2)))
    assert (caught.value.how, caught.value.worker, caught.value.index) == (how, 1, 2)
    if how == "raised":
        assert "_misbehave" in caught.value.traceback
    if trouble == "raise":
        assert isinstance(caught.value.__cause__, KeyError)
    assert envs.closed
    with pytest.raises(ClosedEnvironmentError):
        envs.step(np.zeros((4, 2)))
    assert soon(lambda: not group_members(pids)), "what it had started is still there"


@pytest.mark.slow
@pytest.mark.parametrize("trouble", [pytest.param("hang", marks=pytest.mark.prove), "stop"])
def test_a_worker_that_hangs_is_reported_in_time_with_its_place(trouble: str) -> None:
    envs = troubled(trouble, timeout=3.0)
    with pytest.raises(WorkerError, match="environment 2, worker 1: has not answered for 3 s") as e:
        envs.step(np.zeros((4, 2)))
    assert (e.value.how, e.value.index) == ("hung", 2)
    assert ("stare_into_space" if trouble == "hang" else "it didn't say where") in e.value.traceback
    envs.close()


def test_an_environment_that_cannot_be_built_or_closed() -> None:
    main = os.getpid()

    def build() -> Counter:
        if os.getpid() != main:
            raise OSError("no such robot")
        return Counter()

    with pytest.raises(WorkerError, match="environment 0, worker 0: raised OSError"):
        ProcessVectorEnv(build, 3, num_workers=1)
    envs = ProcessVectorEnv(
        lambda: Counter(trouble="close") if os.getpid() != main else Counter(), 2
    )
    with pytest.raises(WorkerError, match="would not close"):
        envs.close()
    assert envs.closed
    envs.close()
    with pytest.raises(OSError, match="would not close"):
        VectorizedEnv(lambda: Counter(trouble="close"), 2).close()


def test_a_worker_killed_between_steps_is_reported() -> None:
    envs = ProcessVectorEnv(Counter, 4, num_workers=2)
    envs.reset(seed=0)
    os.kill(envs._processes[1].pid, signal.SIGKILL)
    with pytest.raises(WorkerError, match="worker 1: was killed by SIGKILL") as caught:
        envs.step(np.zeros((4, 2)))
    assert caught.value.index is None


def test_an_info_that_cannot_travel_is_an_error_of_its_environment() -> None:
    class Locked(Counter):
        def step(self, action):
            return *super().step(action)[:4], {"lock": threading.Lock()}

    envs = ProcessVectorEnv(Locked, 2)
    envs.reset(seed=0)
    with pytest.raises(WorkerError, match="cannot pickle"):
        envs.step(np.zeros((2, 2)))


def test_the_loop_names_the_environment_that_raised() -> None:
    envs = VectorizedEnv(lambda: Counter(ends=1, trouble="raise"), 2)
    envs.reset(seed=0)
    with pytest.raises(KeyError) as caught:
        envs.step(np.zeros((2, 2)))
    assert caught.value.__notes__ == ["raised by environment 0 of 2"]


# --- nothing left behind --------------------------------------------------------------------------


def test_a_collected_environment_ends_its_workers() -> None:
    envs = ProcessVectorEnv(Counter, 4, num_workers=2)
    envs.reset(seed=0)
    pids = {process.pid for process in envs._processes}
    assert pids <= children()
    del envs
    gc.collect()
    assert soon(lambda: not pids & children())


def test_ctrl_c_ends_the_workers() -> None:
    envs = troubled("hang", timeout=120.0)
    main = threading.main_thread().ident

    def stepping() -> bool:
        frame = sys._current_frames().get(main or 0)
        while frame and frame.f_code is not ProcessVectorEnv.step.__code__:
            frame = frame.f_back
        return frame is not None

    def interrupt() -> None:
        # Only an interrupt within the step is the step's business.
        if soon(stepping, 60.0):
            time.sleep(0.3)
            os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        envs.step(np.zeros((4, 2)))
    assert envs.closed


PROGRAM = """
import os, signal, sys, threading, time
sys.path.insert(0, {root!r})
from tests.vector_env.test_vector_env import Counter, troubled
from course.vector_env import ProcessVectorEnv
envs = {envs}
print(*[process.pid for process in envs._processes], flush=True)
{rest}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("envs", "rest"),
    [
        ("ProcessVectorEnv(Counter, 4, num_workers=2)", "os.kill(os.getpid(), signal.SIGKILL)"),
        pytest.param(
            "ProcessVectorEnv(Counter, 4, num_workers=2)", "sys.exit(0)", marks=pytest.mark.prove
        ),
        pytest.param(
            "ProcessVectorEnv(Counter, 4, num_workers=2)",
            "raise RuntimeError",
            marks=pytest.mark.prove,
        ),
        pytest.param(
            "troubled('hang')",
            "threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()\n"
            "envs.step([[0.0, 0.0]] * 4)",
            marks=pytest.mark.prove,
        ),
        pytest.param(
            "ProcessVectorEnv(Counter, 4, num_workers=2, context='spawn')",
            "os._exit(1)",
            marks=pytest.mark.prove,
        ),
    ],
)
def test_no_worker_outlives_the_main_process(envs: str, rest: str) -> None:
    shared = set(os.listdir("/dev/shm"))
    program = textwrap.dedent(PROGRAM).format(root=str(ROOT), envs=envs, rest=rest)
    guard = f"if __name__ == '__main__':\n{textwrap.indent(program, '    ')}"
    done = subprocess.run(
        [sys.executable, "-c", guard], capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    pids = {int(pid) for pid in done.stdout.split()}
    assert len(pids) == 2, done.stderr
    assert soon(lambda: not any(Path(f"/proc/{pid}").exists() for pid in pids))
    assert soon(lambda: not abandoned(shared)), abandoned(shared)


def test_a_fork_does_not_end_its_parents_workers() -> None:
    envs = ProcessVectorEnv(Counter, 2)
    envs.reset(seed=0)
    child = multiprocessing.get_context("fork").Process(target=envs._finalizer)
    child.start()
    child.join()
    envs.step(np.zeros((2, 2)))
    envs.close()


def test_another_start_method_takes_a_lambda_too() -> None:
    here = VectorizedEnv(lambda: gymnasium.make("CartPole-v1"), 3)
    envs = ProcessVectorEnv(
        lambda: gymnasium.make("CartPole-v1"), 3, num_workers=2, context="forkserver"
    )
    identical(envs.reset(seed=4), here.reset(seed=4))
    identical(envs.step(np.array([1, 0, 1])), here.step(np.array([1, 0, 1])))
    envs.close()
    here.close()
