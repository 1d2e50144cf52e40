"""How a child ends, what it can't reach, and that nothing of it is left."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import struct
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drills.reasons import Reason
from drills.sandbox import (
    Ended,
    Limits,
    Raised,
    confine,
    protections,
    readable_paths,
    scratch,
    tree,
)
from drills.sandbox.process import LAYERS
from tests.drills.sandbox_children import PLAIN, QUICK, child, ended, loaded

LINUX = sys.platform.startswith("linux")
# Ends


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "reason", "word"),
    [
        ("while True: pass", Reason.TIMED_OUT, "Stopped after 0.5 s of processor time in f(...)."),
        (
            "import time; time.sleep(60)",
            Reason.TIMED_OUT,
            "Stopped after 1.5 s by the clock in f(...).",
        ),
        ("import os; os._exit(0)", Reason.EXITED, "status 0"),
        ("import os; os._exit(3)", Reason.EXITED, "status 3"),
        ("import sys; sys.exit(4)", Reason.EXITED, "sys.exit(4)"),
        ("exit()", Reason.EXITED, "sys.exit"),
        ("raise SystemExit('bye')", Reason.EXITED, "sys.exit"),
        ("import ctypes; ctypes.string_at(0)", Reason.CRASHED, "SIGSEGV"),
        ("import os; os.abort()", Reason.CRASHED, "SIGABRT"),
        ("import os; os.kill(os.getpid(), 9)", Reason.KILLED, "SIGKILL"),
        ("import os; os.kill(os.getpid(), 19)", Reason.TIMED_OUT, ""),
        ("import signal; signal.setitimer(0, 0.1); signal.pause()", Reason.KILLED, "SIGALRM"),
        ("return bytearray(10**11)", Reason.OUT_OF_MEMORY, "512 MiB"),
        ("import numpy; numpy.ones((10**5, 10**6))", Reason.OUT_OF_MEMORY, ""),
        ("while True: print('spam' * 100)", Reason.OUTPUT_FLOOD, "256 KiB"),
        ("import os\n    while True: os.write(2, b'x' * 4096)", Reason.OUTPUT_FLOOD, ""),
        ("open('big', 'wb').write(bytes(10**7))", Reason.DISK_FLOOD, "2 MiB"),
        ("for i in range(10**6): open(str(i), 'wb').write(bytes(10**5))", Reason.DISK_FLOOD, ""),
        ("for i in range(10**6): open(str(i), 'wb').close()", Reason.DISK_FLOOD, "files"),
        ("import os\n    while True: os.mkdir('d'); os.chdir('d')", Reason.DISK_FLOOD, "deep"),
        ("import os; os.closerange(3, 200)", Reason.EXITED, ""),
    ],
)
def test_every_end_has_its_reason(body: str, reason: Reason, word: str) -> None:
    # On a busy machine the clock must not come first: a flood of the disk takes its time, and so
    # does half a second of processor time.
    limits = QUICK if reason is Reason.TIMED_OUT else replace(QUICK, call=30.0, total=60.0)
    if "processor" in word:
        limits = replace(QUICK, patience=100.0)
    end = ended(f"def f():\n    {body}", limits=limits)
    assert end.reason is reason, end.sentence
    assert word in end.sentence
    assert end.sentence.endswith(".")


def test_resident_memory_is_watched_from_outside() -> None:
    # Far below the limit on addresses, so that only the look from outside can end it.
    body = "import numpy as np\n    a = np.ones(2 * 10**7)\n    while True: a += 1"
    limits = Limits(call=10, memory=80 << 20)
    end = ended(f"def f():\n    {body}", limits=limits)
    assert end.reason is Reason.OUT_OF_MEMORY
    assert "limit 80 MiB" in end.sentence


def test_top_level_has_its_own_limit() -> None:
    end = ended("while True: pass", limits=Limits(load=0.3))
    assert end.reason is Reason.TIMED_OUT
    assert end.sentence == "Stopped after 0.3 s of processor time while the file was loaded."


BUSY = """
import threading, time
def f(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end: pass
    return 1
def g(seconds): time.sleep(seconds); return 1
def h(seconds):
    both = [threading.Thread(target=f, args=(seconds,)) for _ in range(2)]
    for thread in both: thread.start()
    for thread in both: thread.join()
"""


@pytest.mark.prove
def test_time_is_what_the_child_works_not_what_passes() -> None:
    with loaded(BUSY, limits=Limits(call=0.5)) as running:
        assert running.call("g", 0.8) == 1
        assert running.elapsed > 0.7 and running.spent < 0.4
        assert running.call("f", 0.3) == 1
        assert 0.3 <= running.spent < 0.5
        with pytest.raises(Ended, match=r"0\.5 s of processor time in h"):
            running.call("h", 60.0)
        assert running.spent >= 0.5 and running.used >= 0.8


@pytest.mark.prove
@pytest.mark.parametrize(
    ("name", "patience", "clock"), [("f", 50, "of processor"), ("g", 1, "by the")]
)
def test_total_time_ends_a_child_that_is_slow_every_time(
    name: str, patience: float, clock: str
) -> None:
    with loaded(BUSY, limits=Limits(call=9, total=1.5, patience=patience)) as running:
        with pytest.raises(Ended) as caught:
            for _ in range(10):
                running.call(name, 0.4)
    assert caught.value.reason is Reason.TIMED_OUT
    assert f"1.5 s {clock}" in caught.value.sentence and "in all, in" in caught.value.sentence


@pytest.mark.prove
def test_seconds_of_one_request() -> None:
    with loaded(BUSY, limits=Limits(call=0.2)) as running:
        assert running.call("f", 0.4, seconds=5.0) == 1
        with pytest.raises(Ended, match=r"0\.2 s"):
            running.call("f", 60.0)


FORGE = """
import os, struct, json
def reply_pipe():
    for fd in range(3, 64):
        try:
            os.write(fd, b"")
            if fd != 0: yield fd
        except OSError:
            pass
def send(data):
    for fd in reply_pipe():
        try: os.write(fd, data)
        except OSError: pass
def f():
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "body",
    [
        "send(b'\\xff\\xff\\xff\\xff')",
        "send(struct.pack('>I', 4) + b'null')",
        "send(struct.pack('>I', 17) + b'{\"id\": 1, \"ok\":1}')",
        "send(os.urandom(5000))",
        "send(struct.pack('>I', 1000) + b'[' * 1000)",
        "m = json.dumps({'id': 'x', 'ok': 1}).encode(); send(struct.pack('>I', len(m)) + m)",
    ],
)
def test_forged_replies_are_garbled(body: str) -> None:
    assert ended(f"{FORGE}    {body}\n    return 1").reason is Reason.GARBLED


@pytest.mark.slow
def test_a_length_without_content_times_out() -> None:
    body = "send(struct.pack('>I', 1000) + b'{'); import time; time.sleep(9)"
    assert ended(f"{FORGE}    {body}").reason is Reason.TIMED_OUT


@pytest.mark.prove
def test_answers_are_bounded_in_all() -> None:
    source = "import numpy as np\na = np.zeros(900_000)\ndef f(): return a"
    with loaded(source, limits=Limits(total=300)) as running:
        with pytest.raises(Ended) as caught:
            for _ in range(12):
                running.call("f")
    assert caught.value.reason is Reason.GARBLED
    assert "64 MiB" in caught.value.sentence


# What it prints


def test_output_is_kept_cut_and_safe() -> None:
    source = """
import sys, os
print("loading")
def f(n):
    print("a\\x1b[2J\\ud800")
    sys.stderr.write("warned\\n")
    os.write(1, b"\\xff")
    print("x" * n)
"""
    with loaded(source) as running:
        running.call("f", 10)
        assert running.output == "loading\na\\x1b[2J\\ud800\nwarned\n\ufffd" + "x" * 10 + "\n"
        running.call("f", 50_000)
        assert len(running.output) < 20_000
        assert running.printed > 50_000


def test_output_before_a_time_out_is_shown() -> None:
    with loaded("def f():\n    print('step 1')\n    while True: pass") as running:
        with pytest.raises(Ended):
            running.call("f", seconds=0.2)
        assert running.output == "step 1\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    "setup",
    [
        "import sys; sys.stdout.close(); sys.stderr.close()",
        "import os; os.close(1); os.close(2)",
        "import sys; sys.stdout = sys.stderr = None",
        "import builtins; builtins.print = None",
        "import threading, time; threading.Thread(target=time.sleep, args=(60,)).start()",
        "import threading as t, time; t.Thread(target=time.sleep, args=(60,), daemon=True).start()",
        "import atexit, time; atexit.register(time.sleep, 60)",
        "import signal\nfor s in (1, 2, 10, 12, 15): signal.signal(s, signal.SIG_IGN)",
        "import warnings; warnings.warn('old'); warnings.simplefilter('error')",
        "import faulthandler; faulthandler.enable()",
        "import gc; gc.disable()",
        "import sys; sys.modules.pop('numpy'); sys.modules.pop('json', None)",
        "import os, shutil; shutil.rmtree(os.getcwd(), ignore_errors=True)",
        "import os; os.environ.clear()",
        "import locale; locale.setlocale(locale.LC_ALL, '')",
        "import asyncio\nasync def a(): return 1\nasyncio.run(a())",
        "from concurrent.futures import ThreadPoolExecutor as T\nlist(T(4).map(abs, range(9)))",
        "import tempfile; t = tempfile.NamedTemporaryFile(); t.write(b'x'); d = tempfile.mkdtemp()",
        "import random, time, platform; platform.platform()",
    ],
)
def test_careless_but_right_is_right(setup: str) -> None:
    with loaded(f"{setup}\ndef f(x): return x + 1") as running:
        assert [running.call("f", k) for k in range(3)] == [1, 2, 3]


def test_there_is_no_keyboard() -> None:
    with loaded(
        "def f(): return input('?')\ndef g():\n    import sys; return sys.stdin.read()"
    ) as c:
        with pytest.raises(Raised, match="no keyboard") as caught:
            c.call("f")
        assert caught.value.type == "EOFError"
        assert c.call("g") == ""


# What it can't reach

REACH = """
import ctypes, os, socket, signal
def tried(what, *a):
    try:
        if what == "read":
            with open(a[0], "rb") as file: file.read(1)
        elif what == "list": os.listdir(a[0])
        elif what == "write":
            with open(a[0], "wb") as file: file.write(b"x")
        elif what == "remove": os.remove(a[0])
        elif what == "rename": os.rename(a[0], a[0] + "2")
        elif what == "link": os.symlink(a[0], "link"); os.stat("link"); open("link").close()
        elif what == "hard link": os.link(a[0], "hard")
        elif what == "truncate": os.truncate(a[0], 0)
        elif what == "chmod": os.chmod(a[0], 0)
        elif what == "times": os.utime(a[0], (0, 0))
        elif what == "mkdir": os.mkdir(a[0])
        elif what == "signal": os.kill(a[0], 0)
        elif what == "socket": socket.socket(*a).close()
        elif what == "fork":
            if os.fork() == 0: os._exit(0)
        elif what == "exec": os.execv("/bin/true", ["true"])
        elif what == "memory": open(f"/proc/{a[0]}/mem", "rb").close()
        elif what == "environ": open(f"/proc/{a[0]}/environ", "rb").read()
        else: raise KeyError(what)
    except OSError as error:
        return error.errno
    return 0
def f(): pass
def syscall(number, *a):
    libc = ctypes.CDLL(None, use_errno=True)
    ctypes.set_errno(0)
    return [libc.syscall(number, *map(ctypes.c_ulong, a)), ctypes.get_errno()]
"""

ROOT = Path(readable_paths.HERE)


def kernel_has(layer: str) -> bool:
    with loaded(PLAIN, "same") as running:
        return running.layers.get(layer, "off").startswith("on")


def test_files_of_the_course_and_the_user_are_out_of_reach(tmp_path: Path) -> None:
    mine = tmp_path / "progress.json"
    mine.write_text("{}")
    secrets = [
        ROOT / "drills" / "reasons.py",
        ROOT / "course" / "rigid_body.py",
        ROOT / "solutions" / "__init__.py",
        ROOT / "tests" / "test_sandbox.py",
        ROOT / "pyproject.toml",
        Path.home() / ".profile",
        Path("/etc/passwd"),
        mine,
    ]
    with loaded(REACH) as running:
        if not running.layers["landlock"].startswith("on"):
            return  # the kernel has none; the other tests cover what remains
        for path in secrets:
            if path.exists():
                assert running.call("tried", "read", str(path)) == 13, path
                assert running.call("tried", "write", str(path)) == 13, path
                assert running.call("tried", "link", str(path)) in (13, 17), path
        for what in ("remove", "rename", "hard link", "truncate"):
            assert running.call("tried", what, str(mine)) in (1, 13, 18), what
        for place in (ROOT, ROOT / "drills", Path.home(), Path("/"), tmp_path, Path("/dev/shm")):
            assert running.call("tried", "list", str(place)) == 13, place
            assert running.call("tried", "write", str(place / "new")) == 13, place
            assert running.call("tried", "mkdir", str(place / "folder")) == 13, place
        for what in ("memory", "environ"):
            assert running.call("tried", what, os.getpid()) in (1, 13)
        assert running.call("tried", "signal", os.getpid()) == 1
        assert running.call("tried", "read", np.__file__) == 0
        assert running.call("tried", "write", "here") == 0
        assert running.call("tried", "write", "/dev/null") == 0
        assert running.call("tried", "read", "/proc/self/status") == 0
    assert mine.read_text() == "{}"


def test_course_can_not_be_imported() -> None:
    for name in ("course", "drills", "solutions", "tests"):
        source = f"def f():\n    import {name}"
        with loaded(source) as running, pytest.raises(Raised) as caught:
            running.call("f")
        assert caught.value.type == "ModuleNotFoundError"


def test_filter_refuses_without_landlock(tmp_path: Path) -> None:
    mine = tmp_path / "file"
    mine.write_text("x")
    mine.chmod(0o644)
    with loaded(REACH, _layers=frozenset({"seccomp"})) as running:
        if running.layers["seccomp"] != "on":
            return
        for what in ("fork", "exec"):
            assert running.call("tried", what) == 1
        for family in (1, 2, 10, 16):
            assert running.call("tried", "socket", family, 1) == 1
        for target in (os.getpid(), 1, 0, -1):
            assert running.call("tried", "signal", target) == 1
        for what in ("chmod", "times"):
            assert running.call("tried", what, str(mine)) == 1
        column = confine.MACHINES[os.uname().machine][0]
        special = {"fcntl", "ioctl", "prctl", "clone3"} | set(confine.OWN_ONLY)
        for name, numbers in confine.NUMBERS.items():
            if numbers[column] < 0 or name in special:
                continue
            assert running.call("syscall", numbers[column], 0, 0, 0, 0, 0) == [-1, 1], name
        clone3 = confine.NUMBERS["clone3"][column]
        assert running.call("syscall", clone3, 0, 0) == [-1, 38]
        for option in (1, 4, 36):
            number = confine.NUMBERS["prctl"][column]
            assert running.call("syscall", number, option, 0) == [-1, 1]
    assert mine.stat().st_mode & 0o777 == 0o644 and mine.stat().st_mtime > 1e9


def run_filter(program: bytes, arch: int, number: int, *arguments: int) -> int:
    """What a BPF program says about a system call (an interpreter for the instructions in use)."""
    words = [*arguments, 0, 0, 0, 0, 0, 0][:6]
    data = struct.pack("=IIQ6Q", number, arch, 0, *(w & (2**64 - 1) for w in words))
    steps = list(struct.iter_unpack("=HBBI", program))
    at, value = 0, 0
    while True:
        code, yes, no, k = steps[at]
        at += 1
        if code == confine.RETURN:
            return k
        if code == confine.LOAD:
            (value,) = struct.unpack_from("=I", data, k)
        else:
            holds = {
                confine.JEQ: value == k,
                confine.JGE: value >= k,
                confine.JSET: bool(value & k),
            }[code]
            at += yes if holds else no


@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_filter_program(machine: str) -> None:
    column, arch = confine.MACHINES[machine]
    program = confine.filter_program(machine, 4321)
    no, missing = confine.REFUSE | 1, confine.REFUSE | 38
    number = {name: numbers[column] for name, numbers in confine.NUMBERS.items()}

    def answer(name: str, *arguments: int) -> int:
        return run_filter(program, arch, number[name], *arguments)

    assert run_filter(program, arch ^ 1, 0) == no
    if machine == "x86_64":
        assert run_filter(program, arch, 0x40000000 + 57) == no
        assert answer("fork") == answer("vfork") == no
    assert answer("execve") == answer("socket", 2) == answer("setsid") == no
    assert answer("clone3") == missing
    thread = 0x3D0F00
    assert answer("clone", thread) == confine.ALLOW
    assert answer("clone", 0x1200011) == answer("clone", 0) == no
    for name in ("kill", "tgkill", "rt_sigqueueinfo"):
        assert answer(name, 4321) == confine.ALLOW
        assert answer(name, 1) == answer(name, 0) == answer(name, -1) == answer(name, -4321) == no
    assert answer("prlimit64", 0) == answer("prlimit64", 4321) == confine.ALLOW
    assert answer("prlimit64", 1) == no
    assert answer("setpriority", 0, 0) == confine.ALLOW
    assert answer("setpriority", 0, 1) == answer("setpriority", 2, 0) == no
    assert answer("fcntl", 3, 3) == answer("ioctl", 1, 0x5401) == confine.ALLOW
    assert answer("fcntl", 3, 8) == answer("ioctl", 0, 0x5412) == no
    assert answer("prctl", 15) == confine.ALLOW
    assert answer("prctl", confine.PR_SET_DUMPABLE, 1) == no
    for harmless in {"x86_64": (0, 1, 9, 202), "aarch64": (63, 64, 222, 98)}[machine]:
        assert run_filter(program, arch, harmless) == confine.ALLOW


def test_capabilities_are_gone() -> None:
    if not LINUX:
        return
    source = """
def f():
    return [x for x in open("/proc/self/status") if x.startswith(("Cap", "NoNew"))]
"""
    with loaded(source, limits=QUICK) as running:
        lines = running.call("f")
    assert lines is not None
    values = {line.split(":")[0]: int(line.split()[1], 16) for line in lines}
    assert values["CapEff"] == values["CapPrm"] == values["CapInh"] == values["CapAmb"] == 0
    assert values["NoNewPrivs"] == 1


# Processes: refused, and swept when they are not refused

STARTS = {
    "fork": "os.fork()",
    "subprocess": "subprocess.run(['sleep', '60'])",
    "system": "os.system('sleep 60')",
    "popen": "os.popen('sleep 60').read()",
    "multiprocessing": "multiprocessing.get_context('fork').Process(target=time.sleep).start()",
    "pool": "concurrent.futures.ProcessPoolExecutor(2).submit(abs, 1).result()",
    "spawn": "os.posix_spawn('/bin/sleep', ['sleep', '60'], {})",
    "exec": "os.execv('/bin/sleep', ['sleep', '60'])",
}


@pytest.mark.prove
@pytest.mark.parametrize("path", STARTS)
def test_process_starts_are_refused_and_named(path: str) -> None:
    source = f"""
import concurrent.futures, multiprocessing, os, subprocess, time
def f(): {STARTS[path]}
"""
    if not kernel_has("seccomp"):
        return
    end = ended(source)
    assert end.reason is Reason.PROCESSES, end.sentence


def living(zombies: bool = True) -> set[int]:
    """Processes of this test: descendants of this process."""
    result: set[int] = set()
    pending = [os.getpid()]
    while pending:
        for process in tree._children(pending.pop()):
            status = tree._status(process)
            if status is not None and (zombies or status[0] != "Z"):
                result.add(process)
                pending.append(process)
    return result


DAEMON = """
import os, signal, sys, time
def daemon(depth):
    if os.fork() == 0:
        os.setsid()
        for number in range(1, 32):
            try: signal.signal(number, signal.SIG_IGN)
            except (OSError, ValueError): pass
        if depth and os.fork() == 0:
            daemon(depth - 1)
        if depth:
            os._exit(0)
        os.closerange(0, 64)
        while True: time.sleep(0.05)
def f():
    daemon(int(os.environ.get("DEPTH", "{depth}")))
    {after}
"""


@pytest.mark.prove
@pytest.mark.parametrize("layers", [{"procfs"}, {"procfs", "capabilities"}, set()])
@pytest.mark.parametrize(
    ("depth", "after"),
    [
        (0, "time.sleep(5)"),
        (1, "time.sleep(5)"),
        (2, "return 1"),
        (1, "os._exit(0)"),
        (0, "os.kill(os.getpid(), 9)"),
    ],
)
def test_processes_that_left_are_swept(layers: set[str], depth: int, after: str) -> None:
    if not LINUX:
        return
    before = living()
    source = DAEMON.replace("{depth}", str(depth)).replace("{after}", after)
    with child(source, _layers=frozenset(layers)) as running:
        running.load()
        with contextlib.suppress(Ended):
            running.call("f")
            time.sleep(0.1)
    # Without /proc there are no adopted orphans either: the system's first process reaps them.
    assert living(zombies="procfs" in layers) <= before


def test_fork_bomb_is_swept_without_the_filter() -> None:
    if not LINUX:
        return
    before = living()
    source = """
import os, time
def f():
    end = time.monotonic() + 0.7
    while time.monotonic() < end:
        try:
            if os.fork() == 0: os.setsid()
        except OSError: pass
        time.sleep(0.02)
    time.sleep(5)
"""
    end = ended(source, _layers=frozenset({"procfs", "capabilities"}))
    assert end.reason is Reason.PROCESSES
    assert living() <= before


def test_processes_of_others_are_left_alone() -> None:
    mine = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    alone = subprocess.Popen(
        [sys.executable, "-c", "import time; time.sleep(60)"], start_new_session=True
    )
    try:
        with child("import os\ndef f(): os.fork()", _layers=frozenset({"procfs"})) as running:
            later = subprocess.Popen(["sleep", "60"], start_new_session=True)
            running.load()
            with contextlib.suppress(Ended):
                running.call("f")
                running.call("f")
        assert [p.poll() for p in (mine, alone, later)] == [None] * 3
    finally:
        for process in (mine, alone, later):
            process.kill()
            process.wait()


def test_child_dies_with_its_grader() -> None:
    program = """
import sys, time
from drills.sandbox import Child
c = Child("def f():\\n    while True: pass", filename="a", entry="f")
c.load()
print(c._process.pid, c._folder, flush=True)
c.call("f", seconds=60)
"""
    grader = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert grader.stdout is not None
    pid, folder = grader.stdout.readline().split()
    grader.kill()
    grader.wait()
    grader.stdout.close()
    deadline = time.monotonic() + 120
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < deadline:
        status = tree._status(int(pid))
        if status is None or status[0] == "Z":
            break
        time.sleep(0.01)
    else:
        assert not LINUX or not os.path.exists(f"/proc/{pid}")
    scratch.remove(folder)


# Its folder, and tidiness


def test_folder_is_removed_whatever_it_holds() -> None:
    source = """
import os
def f():
    os.mkdir("closed"); os.mkdir("closed/inner"); open("closed/inner/x", "w").close()
    os.mkdir("mode", 0)
    for i in range(300): open(f"f{i}", "w").close()
    os.symlink("/", "root"); os.symlink("loop", "loop")
    os.mkdir("a b\\n\\udcff")
    top = os.getcwd()
    for i in range(35):
        os.mkdir("n" * 200); os.chdir("n" * 200)
    return top
"""
    with loaded(source) as running:
        folder = running.call("f")
        assert os.path.isdir(folder)
    assert not os.path.lexists(folder)


def test_deep_folder_is_removed(tmp_path: Path) -> None:
    top = tmp_path / "top"
    top.mkdir()
    outside = tmp_path / "kept"
    outside.mkdir()
    (outside / "file").write_text("x")
    program = f"""
import os
os.chdir({str(top)!r})
for i in range(1500): os.mkdir("deep" * 20); os.chdir("deep" * 20)
os.symlink({str(outside)!r}, "out")
open("end", "w").close()
"""
    subprocess.run([sys.executable, "-c", program], check=True)
    assert scratch.excess(str(top), 1 << 20).startswith("Folders")
    scratch.remove(str(top))
    assert not top.exists()
    assert (outside / "file").read_text() == "x"
    scratch.remove(str(top))  # nothing there: nothing to do


@pytest.mark.prove
def test_nothing_is_left_behind() -> None:
    gc.collect()
    before = len(os.listdir("/dev/fd"))
    folders = []
    for _ in range(3):
        with loaded(PLAIN, "same") as running:
            folders.append(running._folder)
    loose = child(PLAIN, "same")
    folders.append(loose._folder)
    loose.load()
    loose.close()
    loose.close()
    with pytest.raises(ValueError, match="closed"):
        loose.call("same", 1)
    unread = child(PLAIN, "same")  # never loaded, never closed by hand
    folders.append(unread._folder)
    del unread
    gc.collect()
    assert len(os.listdir("/dev/fd")) == before
    assert not any(map(os.path.lexists, folders))


def test_two_children_at_once() -> None:
    with child("n = 1\ndef f(): return n") as a, child("n = 2\ndef f(): return n") as b:
        b.load()
        a.load()
        assert (a.call("f"), b.call("f")) == (1, 2)
        a.close()
        assert b.call("f") == 2


def test_import_is_light() -> None:
    heavy = ("course", "scipy", "numba", "mujoco")
    program = f"import sys, drills.sandbox; print([m for m in {heavy} if m in sys.modules])"
    answer = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "[]"


def test_doctor_tries_each_protection() -> None:
    result = {entry.name: entry for entry in protections()}
    assert result["own process"].active
    assert result["watched from outside"].active
    if LINUX and kernel_has("seccomp"):
        for name in ("processes", "network", "signals"):
            assert result[f"tried: {name}"].active
    assert all(entry.detail for entry in result.values())


def test_signal_names_are_classified() -> None:
    from drills.sandbox.process import CRASHES

    assert {s.name for s in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS)} <= CRASHES
    assert {"procfs", "landlock", "seccomp", "capabilities"} == LAYERS
