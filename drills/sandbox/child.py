"""The child process: confines itself, then runs a submission and answers requests about it.

Run as a script by `drills.sandbox.process`, with the numbers of two pipes and of the grader's
process. It holds no expected value, and nothing that it says is believed beyond "this is what the
code returned".
"""

from __future__ import annotations

import builtins
import errno
import importlib
import io
import linecache
import os
import select
import signal
import sys
import threading
import time
import types
from typing import Any, cast

REQUESTS, REPLIES, PARENT = (int(text) for text in sys.argv[1:4])
OWN = os.getpid()
SPIN = 1e-4  # s
# What it may read about itself. Beside these are the system's connections, mounts and sockets.
OF_ITSELF = "stat statm status maps smaps cmdline comm environ limits cgroup auxv fd fdinfo io"
_read, _write, _getpid, _exit = os.read, os.write, os.getpid, os._exit
_monotonic, _poll = time.monotonic, select.poll()
_poll.register(REQUESTS, select.POLLIN)
_waiting = _poll.poll


def _exactly(count: int) -> bytes:
    parts = []
    while count:
        try:
            part = _read(REQUESTS, min(count, 1 << 20))
        except OSError:  # the submission has closed the pipe
            _exit(1)
        if not part:
            _exit(0)  # the grader is gone
        parts.append(part)
        count -= len(part)
    return b"".join(parts)


def _frame() -> bytes:
    until = _monotonic() + SPIN
    while not _waiting(0) and _monotonic() < until:
        pass  # the next request is often there at once; to be woken would take longer
    return _exactly(int.from_bytes(_exactly(4), "big"))


class Answers:
    """The objects that stay here, and what is done with them."""

    def __init__(self, wire: Any, inspect: Any) -> None:
        self.wire, self.inspect = wire, inspect
        self.objects: dict[int, Any] = {}
        self.modules: dict[str, types.ModuleType] = {}
        self.attempts: list[str] = []  # functions called that start a process
        self.filename = "submission.py"
        self.request = ""  # the one that is being answered
        self.one_at_a_time = threading.Lock()
        self.converse: Any = None

    def value(self, data: Any) -> Any:
        """Return an argument: plain data, with handles and the grader's functions resolved."""
        return self.wire.decode(
            data, lambda tag, number: self.objects[number] if tag == "h" else self.asking(number)
        )

    def asking(self, number: int) -> Any:
        """Return a stand-in for a function that stays in the grader.

        A call is sent there and waits for the answer.
        """

        def function(*args: Any) -> Any:
            if not self.request:
                raise RuntimeError("this function can only be asked during the call that gave it")
            # One question at a time: threads of the submission would mix up their replies.
            with self.one_at_a_time:
                question = {"ask": number, "args": [self.plain(value) for value in args]}
                answer = self.converse(self.request, question)
            if "refused" in answer:
                raise TypeError(answer["refused"])
            return self.value(answer["value"])

        return function

    def plain(self, value: Any) -> Any:
        """Return a result as it travels."""
        try:
            return self.wire.encode(value, lambda x, name: {"x": name})
        except self.wire.TooLarge as error:
            return {"x": f"{self.wire.type_name(value)}, {error}"}
        except RecursionError:
            return {"x": f"{self.wire.type_name(value)}, nested too deeply"}

    def execute(self, name: str, source: str, filename: str, code: Any) -> types.ModuleType:
        """Run a source as the module `name`."""
        module = types.ModuleType(name)
        module.__file__ = filename
        # Registered with `linecache`, so that tracebacks can quote lines of the submission.
        linecache.cache[filename] = (len(source), None, source.splitlines(keepends=True), filename)
        self.modules[name] = sys.modules[name] = module
        exec(code, module.__dict__)
        return module

    def defined(self, module: types.ModuleType) -> list[str]:
        """Return the public functions and classes that a module defines itself."""
        return [
            str(name)[:100]
            for name, value in list(module.__dict__.items())
            if not name.startswith("_")
            and callable(value)
            and getattr(value, "__module__", None) == module.__name__
        ][:50]

    def given(self, request: dict[str, Any]) -> dict[str, Any]:
        """Run the drill's own module."""
        code = compile(request["source"], "given.py", "exec", dont_inherit=True)
        self.execute("given", request["source"], "given.py", code)
        return {"ok": None}

    def load(self, request: dict[str, Any]) -> dict[str, Any]:
        """Run the submission and describe the name that is graded."""
        self.filename, entry = request["filename"], request["entry"]
        sys.argv[:] = [self.filename]
        try:
            code = compile(request["source"], self.filename, "exec", dont_inherit=True)
        except SyntaxError as error:
            parts = (error.lineno or 0, error.offset or 0, error.text or "", error.msg or "")
            return {"syntax": [parts[0], parts[1], str(parts[2])[:500], str(parts[3])[:500]]}
        except (RecursionError, MemoryError):
            return {"syntax": [0, 0, "", "the code is nested too deeply"]}
        except (ValueError, OverflowError) as error:
            return {"syntax": [0, 0, "", str(error)[:500]]}
        module = self.execute("submission", request["source"], self.filename, code)
        if entry not in module.__dict__:
            return {"missing": [entry, self.defined(module)]}
        target = module.__dict__[entry]
        parameters: list[list[Any]] | None = None
        try:
            parameters = [
                [
                    str(parameter.name)[:100],
                    parameter.kind.name.lower(),
                    parameter.default is not parameter.empty,
                ]
                for parameter in self.inspect.signature(target).parameters.values()
            ][:100]
        except (TypeError, ValueError):
            pass  # builtins and such have no signature that could be read
        return {"ok": [parameters, callable(target), isinstance(target, type)]}

    def call(self, request: dict[str, Any]) -> dict[str, Any]:
        """Call a function of a module or a method of a kept object."""
        where, name = request["where"], request["name"]
        if isinstance(where, int):
            function = getattr(self.objects[where], name)
        else:
            module = self.modules[where]
            if name not in module.__dict__:
                return {"missing": [name, self.defined(module)]}
            function = module.__dict__[name]
        args = [self.value(data) for data in request["args"]]
        kwargs = {key: self.value(data) for key, data in request["kwargs"].items()}
        for _ in range(request["repeat"]):
            result = function(*args, **kwargs)
        if request["keep"]:
            self.objects[request["keep"]] = result
            answer = None
        else:
            answer = self.plain(result)
        return {"ok": answer, "changed": self.changed(request, args, kwargs)}

    def changed(self, request: dict[str, Any], args: list[Any], kwargs: dict[str, Any]) -> bool:
        """Return whether an argument differs from what was sent."""
        pairs = [*zip(request["args"], args, strict=True)]
        pairs += [(data, kwargs[key]) for key, data in request["kwargs"].items()]
        # Handles and functions of the grader are left out: they have no data to compare.
        return any(
            isinstance(data, (dict, list))
            and not {"h", "c"} & set(data if isinstance(data, dict) else ())
            and self.plain(value) != data
            for data, value in pairs
        )

    def fetch(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the value of a kept object."""
        return {"ok": self.plain(self.objects[request["where"]])}

    def raised(self, error: BaseException) -> dict[str, Any]:
        """Return an exception as data; whatever it does when it is asked for its text."""
        frames = []
        walked, trace = 0, error.__traceback__
        files = []
        # Bounded: a recursion may have left a very long traceback.
        while trace is not None and walked < 100_000:
            code = trace.tb_frame.f_code
            files.append(code.co_filename)
            if code.co_filename == self.filename:
                frames.append([trace.tb_lineno or 0, str(code.co_name)[:100]])
            walked, trace = walked + 1, trace.tb_next
        # Its `__str__` is foreign code, and may raise or return another type.
        try:
            message = str.__str__(str(error))[:2000]
        except BaseException as second:
            message = f"(its text can't be read: {type(second).__name__})"[:200]
        return {
            "raised": [str(type(error).__name__)[:200], message, frames[-20:]],
            "kinds": [
                kind.__name__ for kind in type.mro(type(error)) if kind.__module__ == "builtins"
            ][:20],
            "about": self.about(error, files),
        }

    def about(self, error: BaseException, files: list[str]) -> str:
        """Return what an exception is a sign of, where that has a verdict of its own."""
        if isinstance(error, SystemExit):
            code = error.code
            return "exit " + (str(code) if type(code) is int and abs(code) < 1 << 31 else "?")
        if isinstance(error, MemoryError):
            return "memory"
        chain: list[BaseException] = []
        link: BaseException | None = error
        # The cause may be wrapped in other exceptions, possibly in a cycle.
        while link is not None and len(chain) < 20:
            chain.append(link)
            link = link.__cause__ or link.__context__
        if any(isinstance(part, OSError) and part.errno == errno.EFBIG for part in chain):
            return "disk"
        if any(isinstance(part, OSError) for part in chain):
            paths = ("multiprocessing", "subprocess.py")
            if self.attempts or any(method in file for file in files[1:] for method in paths):
                return "processes"
        return ""

    def watch_process_starts(self) -> None:
        """Note each attempt to start a process. That it fails is the kernel's work, not ours."""

        def noted(name: str, original: Any) -> Any:
            def start(*args: Any, **kwargs: Any) -> Any:
                self.attempts.append(name)
                return original(*args, **kwargs)

            return start

        def system(command: Any) -> int:
            self.attempts.append("system")
            status = original_system(command)
            if status in (-1, 127 << 8):  # what the C library makes of a refusal
                raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))
            return status

        original_system = os.system
        for name in ("fork", "forkpty", "posix_spawn", "posix_spawnp", "execv", "execve"):
            if hasattr(os, name):
                setattr(os, name, noted(name, getattr(os, name)))
        os.system = system
        import _posixsubprocess

        _posixsubprocess.fork_exec = noted("fork_exec", _posixsubprocess.fork_exec)
        if "subprocess" in sys.modules:
            sys.modules["subprocess"].__dict__["_fork_exec"] = _posixsubprocess.fork_exec


def _no_input(prompt: object = "") -> str:
    raise EOFError("there is no keyboard here: take what you need from the arguments, not input()")


def _start() -> tuple[Answers, Any]:
    """Confine this process. Returns what the loop needs."""
    here = os.path.dirname(os.path.abspath(__file__))
    # Imported by path, and then forgotten: the submission is not to find these modules.
    sys.path.insert(0, here)
    confine = importlib.import_module("confine")  # by path: the package is not reachable here

    del sys.path[0]
    import json

    settings = json.loads(_frame())
    layers = set(settings["layers"])
    # seccomp comes last: it restricts the very calls that set up the other layers.
    report = {"limits": confine.limit(settings["limits"])}
    if "capabilities" in layers:
        report["capabilities"] = confine.reached(confine.drop_capabilities)
    report["settled"] = confine.reached(confine.settle, PARENT, "procfs" in layers)
    sys.path += settings["path"]
    sys.path.insert(0, here)
    wire = importlib.import_module("wire")

    del sys.path[0], sys.modules["wire"], sys.modules["confine"]
    sys.path_importer_cache.pop(here, None)
    import inspect

    if "landlock" in layers:
        report["landlock"] = confine.reached(
            confine.landlock,
            [*settings["readable"], *(f"/proc/{OWN}/{name}" for name in OF_ITSELF.split())],
            settings["listable"],
            settings["writable"],
        )
    if "seccomp" in layers:
        report["seccomp"] = confine.reached(confine.system_calls)
    import _sitebuiltins

    builtins.input = _no_input
    builtins.exit = _sitebuiltins.Quitter("exit", "Ctrl-D")
    builtins.quit = _sitebuiltins.Quitter("quit", "Ctrl-D")
    answers = Answers(wire, inspect)
    answers.watch_process_starts()
    return answers, report


def _serve(answers: Answers, report: dict[str, str]) -> None:
    """Answer requests until the grader closes the pipe or kills this process."""
    import json

    loads, wire = json.JSONDecoder().decode, answers.wire
    own_streams = (sys.stdout, sys.stderr)
    cast(io.TextIOWrapper, sys.stdout).reconfigure(line_buffering=True, errors="backslashreplace")
    actions = {
        "given": answers.given,
        "load": answers.load,
        "call": answers.call,
        "fetch": answers.fetch,
    }

    def reply(identity: str, content: dict[str, Any]) -> None:
        if _getpid() != OWN:  # a copy of this process must not speak for it
            _exit(0)
        # Flushed first, so that what a call printed arrives before its answer.
        for stream in own_streams:
            try:
                stream.flush()
            except BaseException:  # closed, or replaced underneath
                continue
        try:
            data = wire.pack({"id": identity, **content})
        except wire.TooLarge as error:
            content = {"ok": {"x": f"value, {error}"}, "changed": False}
            data = wire.pack({"id": identity, **content})
        try:
            while data:
                data = data[_write(REPLIES, data) :]
        except OSError:  # the submission has closed the pipe
            _exit(1)

    def converse(identity: str, question: dict[str, Any]) -> dict[str, Any]:
        reply(identity, question)
        return loads(_frame().decode())

    answers.converse = converse
    reply("ready", {"ok": report})
    while True:
        request = loads(_frame().decode())
        # Handles that the grader no longer holds free their objects.
        for number in request["drop"]:
            answers.objects.pop(number, None)
        answers.attempts.clear()
        answers.request = request["id"]
        try:
            content = actions[request["do"]](request)
        except BaseException as error:
            content = answers.raised(error)
            del error
        answers.request = ""
        reply(request["id"], content)


def _main() -> None:
    answers, report = _start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is the grader's
    _serve(answers, report)


_main()
