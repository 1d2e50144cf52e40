"""The grader's end: starts a child process, asks it, watches it and ends it.

A child's life: `Child(source, ...)` starts it, `load` runs the submission, `call` and its relatives
ask for values, `close` removes every trace. Every wait has a deadline, and every way in which the
child can end is an `Ended` with a reason of the closed list.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import secrets
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drills.reasons import Reason
from drills.sandbox import readable_paths, scratch, tree, wire
from drills.sandbox.outcome import (
    DEFAULT,
    Ended,
    Foreign,
    Frame,
    Handle,
    Limits,
    Loaded,
    MissingName,
    Parameter,
    Raised,
    StartFailed,
    SyntaxProblem,
)
from drills.sandbox.safe_text import readable, size_text

SCRIPT = Path(__file__).with_name("child.py")
START = 60.0  # s, for the interpreter, numpy and the drill's own module: not the learner's time
WATCH = 0.03  # s, between two looks from outside
PAUSED = 1.0  # s, by which no wait is ever too long while this process runs
SPIN = 1e-4  # s, to look for an answer without sleeping
ANSWERS = 64 << 20  # bytes of all answers, which the grader may keep
THREADS = 1000
LINES = 1 << 31  # beyond any line of a submission
KEPT = 16 << 10  # bytes of output kept for the feedback
LAYERS = frozenset({"capabilities", "landlock", "seccomp", "procfs"})

CRASHES = {"SIGSEGV", "SIGABRT", "SIGBUS", "SIGFPE", "SIGILL", "SIGTRAP", "SIGSYS", "SIGSTKFLT"}


_open: weakref.WeakSet[Child] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    if _open and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # impatience would leave something behind
    for child in list(_open):
        child.close()


class Child:
    """A process for one attempt. A context manager; the thread that makes it must outlive it.

    Args:
        source: the submission.
        filename: its name in tracebacks.
        entry: the name that is graded.
        given: the drill's own code for the child, run first, as module `given`.
        limits: what the child may use.
        _layers: the protections to switch on; the tests leave some out.

    Raises:
        StartFailed: when no process can be started.
    """

    def __init__(
        self,
        source: str,
        *,
        filename: str,
        entry: str,
        given: str = "",
        limits: Limits = DEFAULT,
        _layers: frozenset[str] = LAYERS,
    ) -> None:
        self.changed = False
        self.elapsed = 0.0  # s by the wall clock, the last request
        self.spent = 0.0  # s of processor time, the last request
        self.used = 0.0  # s of processor time, all requests
        self.layers: dict[str, str] = {}
        self._source, self._filename, self._entry, self._given = source, filename, entry, given
        self._limits = limits
        self._owner = os.getpid()
        self._ended: Ended | None = None
        self._closed = True
        self._ready = False
        self._printed = 0
        self._answered = 0
        self._text = bytearray()
        self._received = bytearray()
        self._waited = 0.0  # s by the wall clock, all requests
        self._next_watch = 0.0
        self._peak = 0
        self._dropped: list[int] = []
        self._handles = 0
        self._functions: list[Callable[..., Any]] = []  # that the submission may ask
        self._files: set[int] = set()
        self._process: subprocess.Popen[bytes] | None = None
        self._folder = tempfile.mkdtemp(prefix="drills-")
        tree.adopt_orphans(True)
        self._closed = False
        _open.add(self)
        try:
            self._start(_layers)
        except BaseException:
            self.close()
            raise

    # Start and end

    def _start(self, layers: frozenset[str]) -> None:
        # Three pipes: requests to the child, its replies, and what it prints.
        pipes: list[int] = []
        try:
            for _ in range(3):
                pipes += os.pipe()
        except OSError as error:
            for file in pipes:
                os.close(file)
            raise StartFailed(f"no pipe can be opened: {error}") from error
        requests_out, requests_in, replies_out, replies_in, output_out, output_in = pipes
        self._files = {requests_in, replies_out, output_out}
        theirs = (requests_out, replies_in, output_in)
        self._requests, self._replies, self._prints = requests_in, replies_out, output_out
        # Descendants inherit the token with the environment, and are recognized by it.
        token = secrets.token_hex(16)
        environment = {
            "HOME": self._folder,
            "TMPDIR": self._folder,
            "MPLCONFIGDIR": self._folder,
            "NUMBA_CACHE_DIR": self._folder,
            "PATH": "/usr/bin:/bin",
            "LANG": "C.UTF-8",
            "USER": "learner",  # the list of users is not readable
            "MUJOCO_GL": "off",  # MuJoCo looks for a window by starting a process
            "DRILLS_CHILD": token,
        }
        # One thread for each library: processor time then does not depend on the number of cores.
        for library in ("OMP", "OPENBLAS", "MKL", "VECLIB_MAXIMUM", "NUMEXPR", "NUMBA"):
            environment[f"{library}_NUM_THREADS"] = "1"
        # -I and -S: no environment, user site or startup file; -B: no bytecode is written.
        command = [sys.executable, "-I", "-S", "-B", "-X", "utf8", str(SCRIPT)]
        command += [str(requests_out), str(replies_in), str(self._owner)]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output_in,
                stderr=output_in,
                cwd=self._folder,
                env=environment,
                pass_fds=(requests_out, replies_in),
                start_new_session=True,
            )
        except OSError as error:
            raise StartFailed(f"Python can't be started: {error}") from error
        finally:
            for file in theirs:
                os.close(file)
        tree.ROOTS.add(self._process.pid)
        # Nothing here may block: a child that does not read or write must not hang the grader.
        for file in self._files:
            os.set_blocking(file, False)
        # A marker by the way: no other process has this odd limit, and no descendant can raise it.
        size = self._limits.disk + secrets.randbelow(4096)
        self._tree = tree.Tree(self._process.pid, size, token, tree.LINUX and "procfs" in layers)
        settings: dict[str, Any] = {
            "layers": sorted(layers),
            "limits": {
                "CORE": 0,
                "FSIZE": size,
                "CPU": math.ceil(self._limits.total + START),
                "AS": self._limits.memory + (2 << 30),  # libraries map far more than they use
                "NPROC": 256,
                "NOFILE": 128,
                "STACK": 8 << 20,
            },
            "path": readable_paths.search_path(),
            **readable_paths.access(self._folder),
        }
        self._pending = memoryview(wire.pack(settings))
        self._poll = select.poll()
        self._poll.register(self._replies, select.POLLIN)
        self._poll.register(self._prints, select.POLLIN)
        # The settings go out now; the child starts up while the caller goes on.
        self._send()

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_closed"):
            self.close()

    def close(self) -> None:
        """Kill the process and all that came from it, and remove its folder. Safe to repeat."""
        if self._closed or self._owner != os.getpid():
            return
        # An interrupt may come at any point: what is done is noted, so that a second call goes on.
        process = self._process
        remaining: list[int] = []
        if process is not None:
            if process.returncode is None:  # else its number may be another's by now
                self._tree.kill()
                patience = time.monotonic() + 10
                while self._status() is None and time.monotonic() < patience:
                    time.sleep(0.0005)
                remaining = self._tree.kill()  # what that death has orphaned
                process.wait()
            # Only now, with all its processes dead, may its number and its folder be given up.
            tree.ROOTS.discard(process.pid)
            self._process = None
        while self._files:
            os.close(self._files.pop())
        scratch.remove(self._folder)
        self._closed = True
        tree.adopt_orphans(False)
        _open.discard(self)
        if remaining:
            raise RuntimeError(f"processes {remaining} of a submission could not be ended")

    def kill(self) -> None:
        """End the process at once, from any thread; what waits for its answer raises `Ended`.

        The thread that works with the child closes it afterwards, as always.
        """
        process = self._process
        if process is not None and process.returncode is None:
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)

    # Questions

    def load(self) -> Loaded:
        """Run the drill's own module, then the submission.

        Raises:
            SyntaxProblem, MissingName, Raised, Ended: what the submission did.
            StartFailed: what the grader could not do.
        """
        self._start_up()
        answer = self._ask(
            {
                "do": "load",
                "source": self._source,
                "filename": self._filename,
                "entry": self._entry,
            },
            self._limits.load,
            "while the file was loaded",
        )
        # From here on everything received is untrusted: its types and lengths are checked first.
        described = answer.get("ok")
        if type(described) is not list or len(described) != 3:
            raise self._garbled()
        listed, is_callable, is_class = described
        if type(is_callable) is not bool or type(is_class) is not bool:
            raise self._garbled()
        parameters: tuple[Parameter, ...] | None = None
        if listed is not None:
            if type(listed) is not list:
                raise self._garbled()
            for item in listed:
                if type(item) is not list or [type(part) for part in item] != [str, str, bool]:
                    raise self._garbled()
            parameters = tuple(
                Parameter(readable(n[:100]), readable(k[:100]), d) for n, k, d in listed[:100]
            )
        return Loaded(parameters, is_callable, is_class)

    def _start_up(self) -> None:
        if self._ready:
            return
        try:
            answer = self._wait("ready", START, "at the start")
            self.layers = {str(k): str(v) for k, v in answer["ok"].items()}
            if self._given:
                message = {"id": "given", "do": "given", "source": self._given, "drop": []}
                self._pending = memoryview(wire.pack(message))
                answer = self._wait("given", START, "at the start")
                if "ok" not in answer:
                    raise StartFailed(f"the drill's own code failed: {answer.get('raised')}")
        except Ended as end:
            raise StartFailed(f"{end.sentence} {self.output}".strip()) from end
        self.used = self._waited = 0.0
        self._ready = True

    def call(
        self, name: str, *args: Any, repeat: int = 1, seconds: float | None = None, **kwargs: Any
    ) -> Any:
        """Call a function of the submission.

        Args:
            name: of the function.
            args: None, bool, int, float, str, list, tuple, dict with str keys, ndarray, Handle, or
                a function: it stays here, and each call of it from the child is answered here.
            repeat: how often to call it, in one request; the last result counts.
            seconds: limit for this request, in place of `Limits.call` [s of processor time].
            kwargs: as `args`.

        Returns:
            The result; `Foreign` for what does not travel.

        Raises:
            Raised, Ended, MissingName: what the submission did.
            TypeError: for an argument that can't be sent.
        """
        return self._value(self._call("submission", name, args, kwargs, 0, repeat, seconds), name)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Call a function or class of the submission; the result stays in the child."""
        return self._create("submission", name, args, kwargs)

    def method(self, handle: Handle, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a method of an object in the child."""
        return self._value(self._call(self._number(handle), name, args, kwargs), name)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the drill's own module."""
        return self._value(self._call("given", name, args, kwargs), name)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Call a function of the drill's own module; the result stays in the child."""
        return self._create("given", name, args, kwargs)

    def fetch(self, handle: Handle) -> Any:
        """Return the value of an object in the child, as plain data."""
        request = {"do": "fetch", "where": self._number(handle)}
        return self._value(self._ask(request, self._limits.call, "while a value was read"), "")

    @property
    def output(self) -> str:
        """What the submission printed so far: its first 16 KiB, safe to show."""
        return readable(bytes(self._text).decode("utf-8", "replace"))

    @property
    def printed(self) -> int:
        """Bytes printed so far, also those that are not kept."""
        return self._printed

    # Requests

    def _number(self, handle: Handle) -> int:
        if handle._child is not self:
            raise ValueError("this handle belongs to another child")
        return handle._number

    def _plain(self, value: Any) -> Any:
        def other(x: Any, name: str) -> Any:
            if isinstance(x, Handle):
                return {"h": self._number(x)}
            if isinstance(x, (np.generic, np.ndarray)) and x.dtype.name in wire.DTYPES:
                return plain(np.asarray(x))
            if callable(x):
                self._functions.append(x)
                return {"c": len(self._functions) - 1}
            raise TypeError(f"an argument of type {name} can't be sent to the child")

        def plain(x: Any) -> Any:
            if isinstance(x, np.generic) and x.dtype.name in wire.DTYPES:
                x = x.item()
            return wire.encode(x, other, text=wire.FRAME)

        return plain(value)

    def _create(self, where: Any, name: str, args: Any, kwargs: Any) -> Handle:
        self._handles += 1
        handle = Handle(self, self._handles)
        self._call(where, name, args, kwargs, retain=handle._number)
        return handle

    def _call(
        self,
        where: str | int,
        name: str,
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        retain: int = 0,
        repeat: int = 1,
        seconds: float | None = None,
    ) -> dict[str, Any]:
        self.changed = False
        request = {
            "do": "call",
            "where": where,
            "name": name,
            "args": [self._plain(value) for value in args],
            "kwargs": {key: self._plain(value) for key, value in kwargs.items()},
            "repeat": repeat,
            "keep": retain,
        }
        limit = self._limits.call if seconds is None else seconds
        answer = self._ask(request, limit, f"in {name}(...)")
        if type(answer.get("changed")) is not bool:
            raise self._garbled()
        self.changed = answer["changed"]
        return answer

    def _value(self, answer: dict[str, Any], name: str) -> Any:
        def special(tag: str, content: Any) -> Any:
            if tag == "x" and type(content) is str:
                return Foreign(readable(content[:300]))
            raise wire.Malformed("no such form in an answer")

        try:
            return wire.decode(answer.get("ok"), special)
        except wire.Malformed:
            raise self._garbled() from None

    def _ask(self, request: dict[str, Any], seconds: float, where: str) -> dict[str, Any]:
        if self._ended is not None:
            raise self._ended
        if self._closed:
            raise ValueError("this child is closed")
        if not self._ready:
            raise ValueError("load() comes first")
        # A random identity for each request: the submission cannot write an answer in advance.
        identity = secrets.token_hex(8)
        self._dropped, dropped = [], self._dropped
        self._pending = memoryview(wire.pack({"id": identity, "drop": dropped, **request}))
        self.spent = self.elapsed = 0.0
        # A submission may call back a function of the grader before its answer is there.
        answer = self._wait(identity, seconds, where)
        while "ask" in answer:
            self._pending = memoryview(wire.pack({"id": identity, **self._answer_query(answer)}))
            answer = self._wait(identity, seconds, where)
        if "raised" in answer:
            raise self._raised(answer, where)
        if "missing" in answer:
            missing = answer["missing"]
            if type(missing) is list and len(missing) == 2 and type(missing[1]) is list:
                if all(type(name) is str for name in missing[1]):
                    names = [readable(name[:100]) for name in missing[1][:50]]
                    raise MissingName(str(request.get("entry", request.get("name"))), names)
            raise self._garbled()
        if "syntax" in answer:
            result = answer["syntax"]
            if type(result) is list and [type(part) for part in result] == [int, int, str, str]:
                line, column = (number if 0 <= number < LINES else 0 for number in result[:2])
                raise SyntaxProblem(line, column, *(readable(part[:500]) for part in result[2:]))
            raise self._garbled()
        if "ok" not in answer:
            raise self._garbled()
        return answer

    def _answer_query(self, question: dict[str, Any]) -> dict[str, Any]:
        """Answer a question of the submission to a function that stays on this side."""
        number, listed = question["ask"], question.get("args")
        if type(number) is not int or not 0 <= number < len(self._functions):
            raise self._garbled()
        if type(listed) is not list:
            raise self._garbled()
        args = [self._value({"ok": item}, "") for item in listed]
        try:
            return {"value": self._plain(self._functions[number](*args))}
        except Exception as error:  # it was asked about something that it does not take
            return {"refused": f"{type(error).__name__}: {error}"[:500]}

    def _raised(self, answer: dict[str, Any], where: str) -> Exception:
        parts, about = answer["raised"], answer.get("about")
        if type(parts) is not list or [type(part) for part in parts] != [str, str, list]:
            return self._garbled()
        kind, message, listed = parts
        for item in listed:
            if type(item) is not list or [type(part) for part in item] != [int, str]:
                return self._garbled()
        message = readable(message[:2000])
        limits = self._limits
        if about == "memory":
            text = f"The memory limit of {size_text(limits.memory)} was reached {where}."
            return self._end(Reason.OUT_OF_MEMORY, text)
        if about == "disk":
            text = f"A file grew beyond {size_text(limits.disk)} {where}."
            return self._end(Reason.DISK_FLOOD, text)
        if about == "processes":
            text = f"Another process was to be started {where} and was refused ({message})."
            return self._end(Reason.PROCESSES, text)
        if type(about) is str and about.startswith("exit "):
            status = about[5:20].replace("?", "1")
            text = f"The code called sys.exit({readable(status)}) {where}."
            return self._end(Reason.EXITED, text)
        frames = [
            Frame(line if 0 <= line < LINES else 0, readable(function[:100]))
            for line, function in listed[-20:]
        ]
        kinds = answer.get("kinds")
        named = [k for k in kinds if type(k) is str] if type(kinds) is list else []
        return Raised(readable(kind[:200]), message, frames, tuple(named))

    # One loop for everything that is waited for

    def _wait(self, identity: str, seconds: float, where: str) -> dict[str, Any]:
        """Wait for an answer: `seconds` of the child's processor time at most, for this request.

        A child that waits itself uses none, so the wall clock ends it, much later.
        """
        # Two clocks: processor time is what the limit means, wall time catches a child that sleeps.
        start, begun = time.monotonic(), self._tree.processor_time()
        total, patience = self._limits.total, self._limits.patience
        if self._ready:
            largest = min(seconds - self.spent, total - self.used)
            longest = min(patience * seconds - self.elapsed, patience * total - self._waited)
        else:
            largest, longest = math.inf, START
        deadline = start + longest
        try:
            # Event loop: send, watch the process tree, and read until the answer is whole.
            self._send()
            while True:
                now, spent = time.monotonic(), self._tree.processor_time() - begun
                if now >= deadline or spent >= largest:
                    raise self._end(Reason.TIMED_OUT, self._late(seconds, spent >= largest, where))
                if now >= self._next_watch:
                    self._watch(where)
                    self._next_watch = time.monotonic() + WATCH
                requested = time.monotonic()
                pause = max(0.0, min(deadline, self._next_watch) - requested)
                # Most answers are there at once; to sleep and be woken would take longer.
                wait = 0 if now - start < SPIN else math.ceil(1e3 * pause)
                received = self._poll.poll(wait)
                late = time.monotonic() - requested - pause
                if late > PAUSED:  # this process was stopped (Ctrl-Z): not the learner's time
                    start, deadline = start + late, deadline + late
                for file, _ in received:
                    if file == self._prints:
                        self._drain(where)
                    elif file == self._requests:
                        self._send()
                    elif self._receive(where):
                        answer = self._unpack(identity)
                        self._drain(where)
                        return answer
        finally:
            elapsed, spent = time.monotonic() - start, self._tree.processor_time() - begun
            self.elapsed, self.spent = self.elapsed + elapsed, self.spent + spent
            self._waited, self.used = self._waited + elapsed, self.used + spent

    def _late(self, seconds: float, answer: bool, where: str) -> str:
        """Return what to say of a request that took too long."""
        if not self._ready:
            return f"Stopped after {START:g} s {where}."
        limits = self._limits
        if answer:
            whole = limits.total - self.used < seconds - self.spent
            clock, factor = "of processor time", 1.0
        else:
            remaining = limits.patience * limits.total - self._waited
            whole = remaining < limits.patience * seconds - self.elapsed
            clock, factor = "by the clock", limits.patience
        if whole:
            return f"Stopped after {factor * limits.total:g} s {clock} in all, {where}."
        return f"Stopped after {factor * seconds:g} s {clock} {where}."

    def _send(self) -> None:
        """Write what can be written at once of the pending request."""
        waiting = bool(self._pending)
        try:
            while self._pending:
                self._pending = self._pending[os.write(self._requests, self._pending) :]
        except BlockingIOError:
            self._poll.register(self._requests, select.POLLOUT)
            return
        except BrokenPipeError:
            self._pending = memoryview(b"")  # the reading side tells what happened
        if waiting:
            try:
                self._poll.unregister(self._requests)
            except KeyError:
                pass  # written at the first try

    def _drain(self, where: str) -> None:
        """Take what was printed, as far as it is there."""
        while True:
            try:
                part = os.read(self._prints, 65536)
            except BlockingIOError:
                return
            if not part:  # closed by everyone who could print
                try:
                    self._poll.unregister(self._prints)
                except KeyError:
                    pass
                return
            self._printed += len(part)
            # Output beyond the first 16 KiB is counted, and not kept.
            if len(self._text) < KEPT:
                self._text += part[: KEPT - len(self._text)]
            if self._printed > self._limits.output:
                text = f"More than {size_text(self._limits.output)} were printed {where}."
                raise self._end(Reason.OUTPUT_FLOOD, text)

    def _receive(self, where: str) -> bool:
        """Read from the reply pipe. Whether a whole message is there."""
        try:
            part = os.read(self._replies, 1 << 18)
        except BlockingIOError:
            return False
        if not part:
            raise self._pipe_ended(where)
        self._received += part
        # Length-prefixed frame: four bytes, big-endian, then the payload.
        if len(self._received) < 4:
            return False
        length = int.from_bytes(self._received[:4], "big")
        if length > wire.FRAME:
            raise self._garbled()
        # More than one frame: the child only speaks when asked, so this was forged.
        if len(self._received) > 4 + length:
            raise self._garbled()
        return len(self._received) == 4 + length

    def _unpack(self, identity: str) -> dict[str, Any]:
        payload = bytes(self._received[4:])
        self._answered += len(payload)
        if self._answered > ANSWERS:
            raise self._garbled(f"More than {size_text(ANSWERS)} came back in all")
        self._received.clear()
        try:
            answer = wire.unpack(payload)
        except wire.Malformed:
            raise self._garbled() from None
        if answer.get("id") != identity:
            raise self._garbled()
        return answer

    # Looking from outside

    def _watch(self, where: str) -> None:
        limits = self._limits
        threads = self._tree.threads()
        if threads > THREADS:  # to look at each of them would take too long
            raise self._end(Reason.PROCESSES, f"{threads} threads ran {where}.")
        others = self._tree.descendants()
        if others:
            text = f"{len(others)} other process{'es' * (len(others) > 1)} ran {where}."
            raise self._end(Reason.PROCESSES, text)
        resident = self._tree.resident(others)
        self._peak = max(self._peak, resident)
        if resident > limits.memory:
            used, largest = size_text(resident), size_text(limits.memory)
            text = f"{used} of memory were in use {where} (limit {largest})."
            raise self._end(Reason.OUT_OF_MEMORY, text)
        problem = scratch.excess(self._folder, limits.disk)
        if problem:
            raise self._end(Reason.DISK_FLOOD, f"{problem} {where}.")
        if self._status() is not None:
            # Dead, though somebody may hold the pipe open: what it said last is still read.
            if not (select.select([self._replies], [], [], 0)[0]):
                raise self._pipe_ended(where)

    def _status(self) -> int | None:
        """Return how the process ended, as `Popen.returncode`; None while it runs.

        It is not reaped, so that its number stays ours until its group is killed.
        """
        assert self._process is not None
        if not hasattr(os, "waitid"):
            return self._process.poll()
        try:
            result = os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return self._process.returncode or 0
        if result is None:
            return None
        return result.si_status if result.si_code == os.CLD_EXITED else -result.si_status

    def _pipe_ended(self, where: str) -> Ended:
        """Return the verdict on a reply pipe that is at its end."""
        # The pipe may close shortly before the process has ended; its status tells why.
        patience = time.monotonic() + 0.5
        while (status := self._status()) is None and time.monotonic() < patience:
            time.sleep(0.002)
        if status is None:
            return self._garbled("The grader's pipe was closed")
        if status >= 0:
            return self._end(Reason.EXITED, f"The process ended with status {status} {where}.")
        # Killed by a signal, whose name says which limit was reached.
        try:
            name = signal.Signals(-status).name
        except ValueError:
            name = f"signal {-status}"
        if name == "SIGXCPU":
            return self._end(Reason.TIMED_OUT, f"The processor time ran out {where}.")
        if name == "SIGXFSZ":
            text = f"A file grew beyond {size_text(self._limits.disk)} {where}."
            return self._end(Reason.DISK_FLOOD, text)
        if name in CRASHES:
            return self._end(Reason.CRASHED, f"The process crashed ({name}) {where}.")
        return self._end(Reason.KILLED, f"The process was killed ({name}) {where}.")

    def _garbled(self, what: str = "What came over the grader's pipe was not an answer") -> Ended:
        return self._end(Reason.GARBLED, f"{what}.")

    def _end(self, reason: Reason, sentence: str) -> Ended:
        """Close, and remember why."""
        if self._ended is None:
            try:
                self._drain_last()
            finally:
                self._ended = Ended(reason, sentence)
                self.close()
        return self._ended

    def _drain_last(self) -> None:
        """Keep what was printed before the end, as far as it is in the pipe."""
        # A bounded number of reads: a descendant that still prints must not keep us here.
        for _ in range(4):
            try:
                part = os.read(self._prints, 65536)
            except OSError:
                return
            if not part:
                return
            self._printed += len(part)
            self._text += part[: max(0, KEPT - len(self._text))]
