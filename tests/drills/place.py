"""A folder to work in, for the tests of the command `drills`: in this process, or as a script."""

import contextlib
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
import unittest.mock
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from drills import cards as catalogue
from drills.cli import cli

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = Path(sys.executable).with_name("drills")
SCHEMA = json.loads((ROOT / "drills" / "schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
COMMANDS = list(cli.commands)

RIGHT = catalogue.card("verlet").solution_text()
# What an answer does that never ends: it says so in its scratch folder and sleeps. The seconds that
# it may take are of processor time, so it still runs when a busy machine delays the test.
ENDLESS = """
import time
open("running", "w").close()
while True:
    time.sleep(0.01)
"""
WRONG = "def verlet_step(q, v, a, acceleration, dt):\n    return q, v, a\n"


class Place:
    """A folder to work in, and the command: most of the time of a process is starting Python, so it
    runs in this one where the process is not the point."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.work = folder / "work"
        selected = {
            k: v for k, v in os.environ.items() if not k.startswith(("DRILLS", "LC_", "LANG"))
        }
        selected.pop("NO_COLOR", None)
        selected.pop("COLUMNS", None)
        self.environment = {**selected, "LC_ALL": "C.UTF-8", "TERM": "xterm"}
        self.environment["COURSE_QUIET"] = "1"
        self.started: list[subprocess.Popen[bytes]] = []
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as it is in a shell's background
            signal.signal(signal.SIGINT, signal.default_int_handler)

    def popen(self, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
        extra = options.pop("env", {})
        pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
        process: subprocess.Popen[bytes] = subprocess.Popen(
            [str(SCRIPT), *arguments],
            cwd=self.folder,
            env={**self.environment, **extra},
            **pipes,
        )
        self.started.append(process)
        return process

    def script(self, *arguments: str, **extra: str) -> "Done":
        """The real console script, in a process of its own."""
        process = self.popen(*arguments, stdin=subprocess.PIPE, env=extra)
        out, err = process.communicate(b"", timeout=120)
        return Done(process.returncode, out.decode(), err.decode())

    def run(self, *arguments: str, text: str | bytes = "", **extra: str) -> "Done":
        """The command in this process, as in a pipe."""
        environment = {**self.environment, **extra}
        with (
            contextlib.chdir(self.folder),
            unittest.mock.patch.dict(os.environ, environment, clear=True),
        ):
            done = CliRunner().invoke(cli, arguments, input=text, prog_name="drills")
        assert isinstance(done.exception, SystemExit | None), done.exception
        return Done(done.exit_code, done.stdout, done.stderr)

    def json(self, *arguments: str, text: str | bytes = "", **extra: str) -> dict[str, Any]:
        done = self.run(*arguments, "--json", text=text, **extra)
        lines = done.out.splitlines()
        assert len(lines) == 1, done
        assert done.err == "", done
        data = json.loads(lines[0])
        VALIDATOR.validate(data)
        assert data["exit"] == done.code
        return data

    def answer(self, text: str, name: str = "verlet") -> Path:
        self.work.mkdir(exist_ok=True)
        path = self.work / f"{name}.py"
        path.write_text(text, encoding="utf-8")
        return path

    def watch_scratch(self) -> None:
        """Let the answers of commands that are started from now on run in a folder of ours."""
        self.scratch = self.folder / "scratch"
        self.scratch.mkdir()
        self.environment["TMPDIR"] = str(self.scratch)

    def wait_for_answer(self, process: subprocess.Popen[bytes]) -> set[int]:
        """Wait until an `ENDLESS` answer runs; return the processes below the command."""
        deadline = time.monotonic() + 120
        while not any(self.scratch.rglob("running")):
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
        return descendants(process.pid)

    def record(self, name: str = "verlet") -> dict[str, Any]:
        content = json.loads((self.work / "progress.json").read_text(encoding="utf-8"))
        return content["exercises"].get(name, {})


@pytest.fixture(name="place")
def a_place(tmp_path: Path) -> Iterator[Place]:
    """A folder to work in; no process that was started stays, whatever a test finds."""
    place = Place(tmp_path)
    yield place
    for process in place.started:
        if process.poll() is None:
            process.kill()
            process.communicate()


class Done:
    """How a command ended."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err

    def __repr__(self) -> str:
        return f"exit {self.code}\n{self.out}\n--- stderr\n{self.err}"


def descendants(pid: int) -> set[int]:
    """The processes below one, by /proc."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                status = (entry / "stat").read_text()
            except OSError:
                continue
            parents[int(entry.name)] = int(status.rpartition(")")[2].split()[1])
    result: set[int] = set()
    while more := {child for child, parent in parents.items() if parent in {pid, *result}} - result:
        result |= more
    return result


def in_terminal(
    place: Place, arguments: list[str], typed: str = "", until: str = "", **extra: str
) -> tuple[int, str]:
    """Run a command in a pseudo-terminal; gives its exit code and what it wrote.

    With `until`, the terminal is closed as soon as the command has written this text.
    """
    try:
        ours, theirs = pty.openpty()
    except OSError as error:
        pytest.skip(f"nothing was run in a terminal: the system gives no pseudo-terminal: {error}")
    process = place.popen(
        *arguments,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={"LINES": "500", **extra},  # no screen is full
        start_new_session=True,
    )
    os.close(theirs)
    os.write(ours, typed.encode())
    out = b""
    while True:
        try:
            data = os.read(ours, 65536)
        except OSError:  # the other side is closed
            break
        if not data:
            break
        out += data
        if until and until.encode() in out:
            time.sleep(0.5)  # what comes behind it is written too
            break
    os.close(ours)
    return process.wait(timeout=120), out.decode("utf-8", "replace")


def next_line(process: subprocess.Popen[bytes], seconds: float = 120.0) -> bytes:
    """The next line of a running command's output."""
    assert process.stdout is not None
    line, deadline = b"", time.monotonic() + seconds
    handle = process.stdout.fileno()
    while not line.endswith(b"\n"):
        assert select.select([handle], [], [], max(0.0, deadline - time.monotonic()))[0], line
        byte = os.read(handle, 1)
        assert byte, (process.wait(), line)
        line += byte
    return line


def until(process: subprocess.Popen[bytes], text: str) -> str:
    """What a running command writes until a line holds `text`."""
    read = ""
    while text not in read:
        read += next_line(process).decode()
    return read
