"""The vector environment whose environments live in worker processes.

Numbers travel in anonymous shared memory, which has no name that could stay behind; commands, infos
and errors in pipes. What a step costs beside the environments themselves is one message to and one
from each worker, so few workers with many environments each beat a process per environment.

Nothing outlives its owner: the workers end when the environment is closed or collected, when the
main process exits or is killed (a thread in each worker watches for that), and when one of them
fails. A worker leads its own process group, so what an environment has started ends with it, and
Ctrl-C reaches the main process alone.
"""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import pickle
import select
import signal
import threading
import time
import traceback
import weakref
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np
from gymnasium import Env, Space, spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import (
    CloudpickleWrapper,
    batch_space,
    concatenate,
    create_empty_array,
    iterate,
)
from numpy.typing import DTypeLike

from course.check import count, invalid, positive
from course.vector_env.interface import AutoresettingVectorEnv, Lane, check_spaces
from course.vector_env.sequential import Batch, spread

_STEP = pickle.dumps(("step", None))
_IDLE = -1
_LOOK = 0.5  # s between looks at whether a worker that says nothing is still there
_STACK_WAIT = 1.0  # s that a hanging worker is given to say where it hangs


class WorkerError(RuntimeError):
    """A worker process failed; all workers have been ended.

    Attributes:
        how: "raised", "died" or "hung".
        worker: number of the worker.
        index: number of the environment it was busy with; None if it was with none.
        traceback: the worker's own traceback, or what is known of where it was.
    """

    def __init__(self, how: str, worker: int, index: int | None, what: str, trace: str) -> None:
        self.how, self.worker, self.index, self.traceback = how, worker, index, trace
        where = "" if index is None else f"environment {index}, "
        super().__init__(f"{where}worker {worker}: {what}\n{trace}".rstrip())


def shareable(space: Space[Any]) -> bool:
    """Return whether a batch of this space is made of arrays of a fixed size."""
    if isinstance(space, spaces.Dict):
        return all(shareable(item) for item in space.values())
    if isinstance(space, spaces.Tuple):
        return all(shareable(item) for item in space)
    return isinstance(
        space, spaces.Box | spaces.Discrete | spaces.MultiDiscrete | spaces.MultiBinary
    )


class _Shared:
    """The arrays that main process and workers have in common, laid out alike in all of them."""

    def __init__(self, observation: Space[Any], action: Space[Any], n: int, memory: Any) -> None:
        self.size = 0
        self._memory = memory
        # Which environment each worker is busy with; there are not more workers than environments.
        self.busy = self._array((n,), np.int64)
        self.rewards = self._array((n,), np.float64)
        self.terminations = self._array((n,), np.bool_)
        self.truncations = self._array((n,), np.bool_)
        self.actions: Any = None
        self.observations: Any = None
        if shareable(action):
            self.actions = create_empty_array(action, n, fn=self._array)
        if shareable(observation):
            self.observations = create_empty_array(observation, n, fn=self._array)

    def _array(self, shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> Any:
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        # Without memory this only adds up the sizes, for the block that is then allocated.
        n = int(np.prod(shape))
        begin = self.size
        # Each array on cache lines of its own.
        self.size = begin + -(-n * np.dtype(dtype).itemsize // 64) * 64
        if self._memory is None:
            return np.empty(shape, dtype)
        return np.frombuffer(self._memory, dtype, n, begin).reshape(shape)


def _rows(arrays: Any, rows: slice) -> Any:
    if isinstance(arrays, dict):
        return {key: _rows(value, rows) for key, value in arrays.items()}
    if isinstance(arrays, tuple):
        return tuple(_rows(value, rows) for value in arrays)
    return arrays[rows]


def _copy(arrays: Any) -> Any:
    if isinstance(arrays, dict):
        return {key: _copy(value) for key, value in arrays.items()}
    return tuple(map(_copy, arrays)) if isinstance(arrays, tuple) else arrays.copy()


def _store(arrays: Any, values: Any) -> None:
    if isinstance(arrays, dict):
        for key, value in values.items():
            _store(arrays[key], value)
    elif isinstance(arrays, tuple):
        for target, value in zip(arrays, values, strict=True):
            _store(target, value)
    else:
        arrays[...] = values


# --- the worker -----------------------------------------------------------------------------------


def _watch(parent: int) -> None:
    """End this process and its group when the main process is gone."""
    # A worker must not outlive its owner, even one that was killed.
    process = multiprocessing.parent_process()
    assert process is not None
    # The sentinel shows that the parent is dead; a changed parent shows it for forked workers.
    while not wait([process.sentinel], 1.0) and os.getppid() == parent:
        pass
    os.killpg(os.getpid(), signal.SIGKILL)


class _Worker:
    """Environments first .. first + size - 1, and the commands they understand."""

    def __init__(
        self,
        number: int,
        first: int,
        build: Callable[[], Env[Any, Any]],
        size: int,
        memory: Any,
        plan: tuple[int, Space[Any], Space[Any], AutoresetMode],
    ) -> None:
        total, self.observation_space, action_space, mode = plan
        self.number, self.first = number, first
        shared = _Shared(self.observation_space, action_space, total, memory)
        self.shared = shared
        rows = slice(first, first + size)
        # Views of this worker's own rows of the shared arrays.
        self.actions: Any = None if shared.actions is None else _rows(shared.actions, rows)
        self.observations = (
            None if shared.observations is None else _rows(shared.observations, rows)
        )
        self.action_space = batch_space(action_space, size)
        self.lanes: list[Lane] = []
        for i in range(size):
            shared.busy[number] = first + i
            env = build()
            check_spaces(env, self.observation_space, action_space, first + i)
            self.lanes.append(Lane(env, mode))
        self.latest: list[Any] = [None] * size

    def answer(self, command: str, payload: Any) -> Any:
        """Carry out one command; `busy` says all along with which environment."""
        result = []
        shared = self.shared
        if command == "step":
            actions = self.actions if payload is None else payload
            if payload is None:
                # Copies: an environment may keep its action, and the shared array is overwritten.
                actions = iterate(self.action_space, _copy(actions))
            for i, (lane, action) in enumerate(zip(self.lanes, actions, strict=True), self.first):
                shared.busy[self.number] = i
                observation, reward, terminated, truncated, info, final = lane.step(action)
                self.latest[i - self.first] = observation
                shared.rewards[i] = reward
                shared.terminations[i], shared.truncations[i] = terminated, truncated
                # Only infos with content travel through the pipe.
                if info or final is not None:
                    result.append((i, info, final))
            return result, self._publish()
        if command == "reset":
            ids, seeds, options = payload
            for i, lane in enumerate(self.lanes, self.first):
                if i in ids:
                    shared.busy[self.number] = i
                    self.latest[i - self.first], info = lane.reset(seeds[i], options)
                    result.append((i, info, None))
            return result, self._publish()
        # close, set and call go to every environment in turn.
        for i, lane in enumerate(self.lanes, self.first):
            shared.busy[self.number] = i
            if command == "close":
                lane.env.close()
            elif command == "set":
                lane.env.set_wrapper_attr(payload[0], payload[1][i])
            else:
                name, arguments, keywords = payload
                item = lane.env.get_wrapper_attr(name)
                result.append(item(*arguments, **keywords) if callable(item) else item)
        return result

    def _publish(self) -> Any:
        if self.observations is None:
            return self.latest
        # Into shared memory where the space allows it; then the reply carries no observations.
        concatenate(self.observation_space, self.latest, self.observations)
        return None


def _work(
    number: int,
    first: int,
    link: Connection,
    stacks: Connection,
    inherited: list[Connection],
    build: CloudpickleWrapper[Any],
    rest: tuple[Any, ...],
) -> None:
    """A worker process: build the environments, then answer commands until told to close."""
    # A process group of its own, which can be killed with all that the worker starts.
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C before the group was its own
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # A copy of the main process's end would keep a pipe open after its death.
    for other in inherited:
        other.close()
    # Asked where it hangs, a worker writes its stack, also from within compiled code.
    faulthandler.register(signal.SIGUSR1, file=stacks.fileno(), all_threads=True)
    threading.Thread(target=_watch, args=(os.getppid(),), daemon=True).start()
    worker = None
    command = ""
    try:
        worker = _Worker(number, first, build.fn, *rest)
        reply: Any = None
        while True:
            # Idle while it waits, so that its death now is not blamed on an environment.
            worker.shared.busy[number] = _IDLE
            link.send_bytes(pickle.dumps((True, reply)))
            if command == "close":
                return
            command, payload = pickle.loads(link.recv_bytes())
            reply = worker.answer(command, payload)
    except (EOFError, BrokenPipeError):
        # The main process has ended or closed the pipe.
        return
    except BaseException as error:
        text = traceback.format_exc()
        try:
            # An exception that cannot be pickled is passed as text.
            original = pickle.dumps(error)
            pickle.loads(original)
        except Exception:
            original = b""
        link.send_bytes(pickle.dumps((False, (repr(error), text, original))))


# --- the main process -----------------------------------------------------------------------------


def _end(owner: int, processes: list[Any], links: list[Connection]) -> None:
    """Kill every worker with its group and close the pipes; harmless when done twice."""
    if os.getpid() != owner:  # a fork's copy of the object: the workers aren't its own
        return
    for process in processes:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            process.kill()  # not yet the leader of its group, or gone
    # Join every worker, so that no zombie process remains.
    for process in processes:
        process.join()
        process.close()
    for link in links:
        link.close()


class ProcessVectorEnv(AutoresettingVectorEnv):
    """`num_envs` environments in worker processes; the same results as `VectorizedEnv`.

    It pays where an environment's step costs more than about r / (N (1 - 1 / W)), with r the cost
    of waking W workers and hearing from them, N the number of environments. Below that the loop of
    `VectorizedEnv` is faster.
    """

    def __init__(
        self,
        env_fn: Callable[[], Env[Any, Any]],
        num_envs: int,
        *,
        num_workers: int | None = None,
        timeout: float = 60.0,
        context: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Start the workers.

        Args:
            env_fn: builds one environment; called once here for its spaces, then in the workers.
                A lambda will do with every start method, through cloudpickle.
            num_envs: how many, at least 1.
            num_workers: processes, 1 to num_envs; by default one for each processor.
            timeout: seconds that any call may take before a worker counts as hanging.
            context: start method of `multiprocessing`; None for the default.
            autoreset_mode: see `course.vector_env`.

        Raises:
            ValueError: for an argument out of its range.
            WorkerError: if an environment can't be built.
        """
        count("num_envs", num_envs, 1)
        if not callable(env_fn):
            raise invalid("env_fn", env_fn, "a function that builds an environment")
        positive("timeout", timeout, unit="s")
        if num_workers is None:
            workers = min(num_envs, len(os.sched_getaffinity(0)))
        else:
            workers = count("num_workers", num_workers, 1, num_envs)
        # One environment is built here only to learn the spaces, and closed again.
        first = env_fn()
        try:
            self._adopt(first, num_envs, autoreset_mode)
        finally:
            first.close()
        self.num_workers = workers
        self.timeout = timeout
        start: Any = multiprocessing.get_context(context)
        observation, action = self.single_observation_space, self.single_action_space
        # One block of shared memory for all arrays: workers write rows, no message carries them.
        memory = start.RawArray("b", _Shared(observation, action, num_envs, None).size)
        self._shared = _Shared(observation, action, num_envs, memory)
        self._processes: list[Any] = []
        self._links: list[Connection] = []
        self._stacks: list[Connection] = []
        self._pipes: list[Connection] = []
        # The finaliser holds no reference to the object, so it can run when the object is
        # collected.
        self._finalizer = weakref.finalize(self, _end, os.getpid(), self._processes, self._pipes)
        # Contiguous blocks of nearly equal size, one for each worker.
        bounds = np.linspace(0, num_envs, workers + 1).astype(int)
        self._firsts = [int(i) for i in bounds[:-1]]
        plan = (num_envs, observation, action, self.autoreset_mode)
        method = start.get_start_method()
        try:
            for k in range(workers):
                ours, theirs = start.Pipe()
                listen, speak = start.Pipe(duplex=False)
                self._links.append(ours)
                self._stacks.append(listen)
                self._pipes += [ours, listen]
                inherited = [*self._pipes] if method == "fork" else []
                size = int(bounds[k + 1] - bounds[k])
                process = start.Process(
                    target=_work,
                    args=(
                        k,
                        self._firsts[k],
                        theirs,
                        speak,
                        inherited,
                        CloudpickleWrapper(env_fn),
                        (size, memory, plan),
                    ),
                    daemon=True,
                    name=f"environments {self._firsts[k]} to {bounds[k + 1] - 1}",
                )
                process.start()
                self._processes.append(process)
                # Only the worker may hold these ends: else its death would not close the pipes.
                theirs.close()
                speak.close()
            self._collect()
        except BaseException:
            self._abandon()
            raise

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Start new episodes; arguments and results as for `VectorizedEnv.reset`."""
        ids, seeds, options = self._plan_reset(seed, options)
        chosen = frozenset(int(i) for i in ids)
        replies = self._ask(pickle.dumps(("reset", (chosen, seeds, options))))
        self._over[ids], self._begun[ids] = False, True
        return self._observations(replies), self._infos(replies)

    def step(self, actions: Any) -> Batch:
        """Step every environment once; arguments and results as for `VectorizedEnv.step`.

        Raises:
            ValueError: for the wrong number, shape or kind of actions.
            ResetNeeded: in the mode DISABLED, if an environment that is over was not reset.
            WorkerError: if a worker raises, dies, or takes longer than the timeout.
        """
        self._assert_open()
        batch = self._checked_actions(actions)
        shared = self._shared
        if shared.actions is None:
            # Actions without a fixed size are not in shared memory: each worker gets its own by
            # pipe.
            every = list(iterate(self.action_space, batch))
            ends = [*self._firsts[1:], self.num_envs]
            parts = [every[a:b] for a, b in zip(self._firsts, ends, strict=True)]
            replies = self._ask([pickle.dumps(("step", part)) for part in parts])
        else:
            # Written once into shared memory; the message to the workers is the same for all.
            _store(shared.actions, batch)
            replies = self._ask(_STEP)
        self._over = shared.terminations | shared.truncations
        return (
            self._observations(replies),
            shared.rewards.copy(),
            shared.terminations.copy(),
            shared.truncations.copy(),
            self._infos(replies),
        )

    def _observations(self, replies: list[Any]) -> Any:
        if self._shared.observations is not None:
            # A copy, since the next step overwrites the shared arrays.
            return _copy(self._shared.observations)
        latest = [observation for _, part in replies for observation in part]
        space = self.single_observation_space
        empty: Any = create_empty_array(space, self.num_envs, fn=np.zeros)
        return concatenate(space, latest, empty)

    def _infos(self, replies: list[Any]) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for result, _ in replies:
            for i, info, final in result:
                if final is not None:
                    infos = self._add_info(
                        infos, {"final_obs": final[0], "final_info": final[1]}, i
                    )
                infos = self._add_info(infos, info, i)
        return infos

    def render(self) -> tuple[Any, ...]:
        """Return what each environment renders."""
        return self.call("render")

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of every environment, or read an attribute, through its wrappers."""
        replies = self._ask(pickle.dumps(("call", (name, args, kwargs))))
        # Workers have contiguous environments, so their replies in turn are in the right order.
        return tuple(item for result in replies for item in result)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment: a list of one value each, or one value for all."""
        self._ask(pickle.dumps(("set", (name, spread(values, self.num_envs)))))

    def close_extras(self, **kwargs: Any) -> None:
        """Close the environments and end the workers.

        Raises:
            WorkerError: if an environment raises, or takes longer than the timeout, while closing.
        """
        if getattr(self, "_processes", None):
            try:
                self._ask(pickle.dumps(("close", None)))
            finally:
                self._abandon()

    def _ask(self, message: bytes | list[bytes]) -> list[Any]:
        """Send a command to every worker (or to each its own) and collect the answers."""
        self._assert_open()
        try:
            for k, link in enumerate(self._links):
                try:
                    link.send_bytes(message if isinstance(message, bytes) else message[k])
                except OSError:  # its end is closed: `_collect` finds out why
                    continue
            return self._collect()
        except BaseException:
            # Also for Ctrl-C: an answer that nobody has read would be taken for the next one.
            self._abandon()
            raise

    def _collect(self) -> list[Any]:
        replies: list[Any] = [None] * self.num_workers
        waiting = {link.fileno(): k for k, link in enumerate(self._links)}
        poller = select.poll()
        for descriptor in waiting:
            poller.register(descriptor, select.POLLIN)
        end = time.monotonic() + self.timeout
        # Poll all pipes: answers come in any order, and a dead or hanging worker is found.
        while waiting:
            remaining = end - time.monotonic()
            events = poller.poll(max(0.0, 1e3 * min(remaining, _LOOK)))
            for descriptor, _ in events:
                k = waiting.pop(descriptor)
                poller.unregister(descriptor)
                try:
                    good, reply = pickle.loads(self._links[k].recv_bytes())
                except (EOFError, OSError):
                    raise self._death(k) from None
                if not good:
                    raise self._failure(k, *reply)
                replies[k] = reply
            if not events:
                for k in waiting.values():
                    # A process that it has left behind may hold its end of the pipe open.
                    if not self._processes[k].is_alive() and not self._links[k].poll():
                        raise self._death(k)
                if remaining <= 0.0:
                    raise self._hanging(next(iter(waiting.values())))
        return replies

    def _busy(self, worker: int) -> int | None:
        index = int(self._shared.busy[worker])
        return None if index == _IDLE else index

    def _failure(self, worker: int, what: str, trace: str, original: bytes) -> WorkerError:
        error = WorkerError("raised", worker, self._busy(worker), f"raised {what}", trace)
        if original:
            # The original exception as the cause, so that the caller can tell its type.
            error.__cause__ = pickle.loads(original)
        return error

    def _death(self, worker: int) -> WorkerError:
        process = self._processes[worker]
        # The pipe may close a moment before the process has ended: wait for its exit code.
        process.join(1.0)
        code = process.exitcode
        if code is None:  # still alive after that second
            what = "closed its pipe"
        elif code < 0:
            # `multiprocessing` reports a death by a signal as the negative number of that signal.
            what = f"was killed by {signal.Signals(-code).name}"
        else:
            what = f"exited with status {code}"
        text = "it left no traceback: a process that ends like this runs no Python any more"
        return WorkerError("died", worker, self._busy(worker), what, text)

    def _hanging(self, worker: int) -> WorkerError:
        what = f"has not answered for {self.timeout:g} s"
        text = "it didn't say where"
        # `faulthandler` in the worker answers this signal with its stack.
        os.kill(self._processes[worker].pid, signal.SIGUSR1)
        stacks = self._stacks[worker]
        if stacks.poll(_STACK_WAIT):
            time.sleep(0.05)  # it writes line by line
            text = os.read(stacks.fileno(), 1 << 16).decode("utf-8", "replace")
        return WorkerError("hung", worker, self._busy(worker), what, text)

    def _abandon(self) -> None:
        """End the workers at once."""
        self.closed = True
        self._finalizer()
