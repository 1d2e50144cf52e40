"""Holes that attacks on the grader found, each closed: the kernel's side doors, forged replies,
answers that cost the grader dearly to look at, odd surroundings of the command."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from drills import cards as catalogue
from drills import feedback, progress
from drills.grader import grade
from drills.reasons import Reason
from drills.sandbox import Child, Ended, Limits, scratch, wire
from drills.values import describe, numbers

LINUX = sys.platform.startswith("linux")
COMMAND = (sys.executable, "-m", "drills")
FK3 = catalogue.card("fk3")

FORGE = """
import json, os, struct, sys, time

def say(content):
    frame = sys._getframe()
    while "request" not in frame.f_locals:
        frame = frame.f_back
    text = json.dumps({"id": frame.f_locals["request"]["id"], **content}).encode()
    text = struct.pack(">I", len(text)) + text
    while text:
        text = text[os.write(sys.modules["__main__"].REPLIES, text):]
    time.sleep(60)

def fk3(lengths, thetas):
    return None

"""

REACH = """
import ctypes, fcntl, os, socket, struct
libc = ctypes.CDLL(None, use_errno=True)

def call(name, *arguments):
    if getattr(libc, name)(*arguments) < 0:
        return ctypes.get_errno()
    return 0

def datagram(path):
    socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)[0].sendto(b"x", path)

def stream_bound():
    socket.socketpair()[0].bind("here")

def flags():
    import numpy
    file, value = os.open(numpy.__file__, os.O_RDONLY), bytearray(8)
    fcntl.ioctl(file, 0x80086601, value)
    fcntl.ioctl(file, 0x40086602, bytes(value))

def lease():
    import numpy
    fcntl.fcntl(os.open(numpy.__file__, os.O_RDONLY), fcntl.F_SETLEASE, fcntl.F_RDLCK)

def tried(name, *arguments):
    try:
        globals()[name](*arguments)
    except OSError as error:
        return error.errno
    return 0

def read(path):
    try:
        open(path).read()
    except OSError as error:
        return error.errno
    return 0

def pair():
    a, b = socket.socketpair()
    a.send(b"x")
    return b.recv(1).decode()
"""


def test_what_other_processes_share_is_out_of_reach(tmp_path: Path) -> None:
    if not LINUX:
        return
    libc = ctypes.CDLL(None)
    memory = libc.shmget(0, 4096, 0o1600)
    queue = libc.msgget(0, 0o1600)
    receiver = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    receiver.bind(str(tmp_path / "socket"))
    try:
        with Child(REACH, filename="x.py", entry="call") as child:
            child.load()
            if child.layers["seccomp"] != "on" or not child.layers["landlock"].startswith("on"):
                return
            assert child.call("call", "shmctl", memory, 0, None) == 1
            assert child.call("call", "msgctl", queue, 0, None) == 1
            assert child.call("call", "msgrcv", queue, None, 0, 0, 0o4000) == 1
            assert child.call("tried", "datagram", str(tmp_path / "socket")) == 1
            for name in ("stream_bound", "flags", "lease"):
                assert child.call("tried", name) == 1, name
            for name in ("net/tcp", "net/unix", "mounts", "mem", "task/../net/tcp"):
                assert child.call("read", f"/proc/self/{name}") == 13, name
            assert child.call("read", "/proc/self/status") == 0
            assert child.call("pair") == "x"
        assert libc.shmctl(memory, 0, None) == 0, "the segment is gone"
    finally:
        libc.msgctl(queue, 0, None)
        receiver.close()


def test_memory_is_seen_after_the_first_thread_has_ended() -> None:
    if not LINUX:
        return
    source = """
import ctypes, threading, time
def f():
    def take():
        time.sleep(0.1)
        kept = [b"a" * (1 << 26) for _ in range(6)]
        time.sleep(60)
    threading.Thread(target=take).start()
    ctypes.CDLL(None).syscall(NUMBER, 0)
"""
    number = {"x86_64": "60", "aarch64": "93"}[os.uname().machine]
    text = source.replace("NUMBER", number)
    with Child(text, filename="x.py", entry="f", limits=Limits(memory=1 << 28)) as child:
        child.load()
        with pytest.raises(Ended) as end:
            child.call("f")
    assert end.value.reason is Reason.OUT_OF_MEMORY


def test_a_folder_closed_to_its_reader_is_counted(tmp_path: Path) -> None:
    if not LINUX:
        return
    (tmp_path / "closed").mkdir()
    (tmp_path / "closed" / "large").write_bytes(b"a" * (1 << 20))
    (tmp_path / "closed").chmod(0o300)
    (tmp_path / "link").symlink_to("/")
    assert "MiB" in scratch.excess(str(tmp_path), 1 << 19)
    assert scratch.excess(str(tmp_path), 1 << 22) == ""
    assert scratch.excess(str(tmp_path / "gone"), 1) == ""


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ('{"syntax": [-10**6, 0, "", "x"]}', Reason.SYNTAX_ERROR),
        ('{"syntax": [10**4000, -10**4000, "", "x"]}', Reason.SYNTAX_ERROR),
        ('{"syntax": [1, 1, "a" * 10**6, "b" * 10**6]}', Reason.SYNTAX_ERROR),
        ('{"missing": ["fk3", ["a" * 10**6] * 6]}', Reason.MISSING_NAME),
        ('{"ok": [[["a" * 10**6, "keyword_only", False]] * 5, True, False]}', "wrong_signature"),
        ('{"raised": ["K" * 10**6, "m" * 10**6, [[10**4000, "f" * 10**5]] * 20]}', Reason.RAISED),
        ('{"raised": ["K", "m", [[-5, "f"]]], "about": ["x"]}', Reason.RAISED),
    ],
)
def test_forged_words_are_cut_and_shown(content: str, reason: str) -> None:
    report = grade("fk3", f"{FORGE}say({content})\n", seed=1)
    assert report.reason == reason
    assert len(report.sentence) < 20_000
    shown = feedback.text(report, FK3), feedback.html(report, FK3)
    assert all(len(text) < 40_000 for text in shown)
    json.dumps(feedback.as_dict(report, FK3), allow_nan=False)


@pytest.mark.parametrize("shape", ["(10**9, 0)", "(0, 10**9)", "(10**6, 0, 10**6)"])
def test_empty_rows_without_number_cost_nothing(shape: str) -> None:
    text = f"import numpy as np\ndef fk3(lengths, thetas): return np.zeros({shape})\n"
    report = grade("fk3", text, seed=1)
    assert report.reason in (Reason.WRONG_TYPE, Reason.WRONG_SHAPE)
    with pytest.raises(wire.Malformed):
        wire.decode({"a": ["float64", [1 << 30, 0], ""]}, lambda tag, content: None)
    assert describe(np.zeros((10**6, 0))) == "array of shape (1000000, 0)"


def test_a_long_array_is_not_taken_apart() -> None:
    text = """
import numpy as np
def rrt(start, goal, discs, bounds, step_size, max_samples, rng):
    return np.zeros(8 << 20, np.int8)
"""
    assert not grade("rrt", text, seed=1).passed
    assert numbers([1] * 10**5).shape == (10**5,)


def test_a_pause_of_the_grader_is_not_the_learners_time() -> None:
    source = "import time\ndef f():\n    time.sleep(0.3)\n    return 1\n"
    stop = (
        "import os, signal, sys, time\n"
        "time.sleep(0.1); os.kill(int(sys.argv[1]), signal.SIGSTOP)\n"
        "time.sleep(2); os.kill(int(sys.argv[1]), signal.SIGCONT)\n"
    )
    grader = (
        "import subprocess, sys, os\n"
        "from drills.sandbox import Child, Limits\n"
        f"c = Child({source!r}, filename='x', entry='f', limits=Limits(call=1.0, patience=1))\n"
        "c.load()\n"
        f"p = subprocess.Popen([sys.executable, '-c', {stop!r}, str(os.getpid())])\n"
        "print(c.call('f')); c.close(); p.wait()\n"
    )
    ran = subprocess.run([sys.executable, "-c", grader], capture_output=True, text=True)
    assert ran.stdout.strip() == "1", ran.stderr


def test_an_interrupt_while_closing_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    child = Child("def f(): pass\n", filename="x", entry="f")
    process, folder = child._process, child._folder
    assert process is not None

    def interrupted(folder: str) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as within:
        within.setattr(scratch, "remove", interrupted)
        with pytest.raises(KeyboardInterrupt):
            child.close()
    assert os.path.isdir(folder)
    child.close()
    assert not os.path.exists(folder) and process.returncode == -signal.SIGKILL
    child.close()


@pytest.fixture(name="work")
def a_work(tmp_path: Path) -> Path:
    (tmp_path / "fk3.py").write_text(FK3.solution_text())
    return tmp_path


def ran(work: Path, line: str, **more: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "DRILLS_WORK": str(work), **more}
    command = " ".join((*COMMAND, line))
    return subprocess.run(
        command, shell=True, env=environment, capture_output=True, text=True, timeout=60
    )


@pytest.mark.parametrize("closed", ["<&-", ">&-", "<&- >&- 2>&-"])
def test_closed_streams_do_not_matter(work: Path, closed: str) -> None:
    done = ran(work, f"check fk3 --json {closed}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert progress.load(work / "progress.json").of("fk3").state == progress.SOLVED


def test_a_full_disk_behind_the_output_is_not_a_wrong_answer(work: Path) -> None:
    if not os.path.exists("/dev/full"):
        return
    for line in ("list", "list --json", "show nothing --json"):
        assert ran(work, f"{line} > /dev/full").returncode == 3
        assert ran(work, f"{line} > /dev/full 2> /dev/full").returncode == 3
    assert "can't be written" in ran(work, "list > /dev/full").stderr


def test_progress_that_is_no_file_is_said_at_once(work: Path) -> None:
    os.mkfifo(work / "progress.json")
    start = time.monotonic()
    done = ran(work, "status --json")
    assert done.returncode == 0 and "not a file" in json.loads(done.stdout)["notices"][0]
    assert time.monotonic() - start < 30


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("1e-05", "NaN"),
        ("1e-05", "Infinity"),
        ("1e-05", "1" + "0" * 400),
        ('"s"', '"\\u001b[31m"'),
        ('"2026', '"\\ud800'),
        ('"fk3"', '"\\ud800"'),
    ],
)
def test_progress_that_could_not_be_written_again_is_put_aside(
    tmp_path: Path, old: str, new: str
) -> None:
    file = tmp_path / "progress.json"
    progress.change(
        file, "fk3", lambda r: progress.note_attempt(r, True, {"time": (1e-5, "s")}, "2026-01-01")
    )
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    loaded = progress.change(file, "fk3", lambda r: progress.note_attempt(r, True, {}))
    assert loaded.notices and loaded.of("fk3").attempts == 1
    assert (tmp_path / "progress.json.damaged-1").exists()


def test_names_of_files_do_not_paint_the_terminal(work: Path) -> None:
    link = work / "\x1b[31ml.py"
    link.symlink_to(work / "fk3.py")
    done = ran(work, f"check '{link}'")
    assert done.returncode == 2 and "symbolic link" in done.stderr
    assert "\x1b" not in done.stdout + done.stderr
    assert ran(work, "list", DRILLS_WORK="~nobody-of-that-name/x").returncode == 2
