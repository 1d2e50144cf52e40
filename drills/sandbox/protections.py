"""Which protections hold on this machine, tried out rather than assumed."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

from drills.sandbox import readable_paths, tree
from drills.sandbox.outcome import Ended, Raised, StartFailed
from drills.sandbox.process import Child

PROBE = """
import os, signal, socket

def tried(action):
    try:
        action()
    except OSError as error:
        return error.strerror or "refused"
    return ""

def start():
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)

def report(file, parent):
    return {
        "files": tried(lambda: open(file).close()),
        "signals": tried(lambda: os.kill(parent, 0)),
        "network": tried(lambda: socket.socket().close()),
        "processes": tried(start),
    }
"""


@dataclass(frozen=True)
class Protection:
    """One protection, and whether it is active here."""

    name: str
    active: bool
    detail: str


def protections() -> list[Protection]:
    """Start a child and try what it must not be able to do.

    Returns:
        One entry for each protection; `detail` says what it is, or why it is off.
    """
    result = [
        Protection("own process", True, "a fresh interpreter for each attempt, killed after it")
    ]
    try:
        with Child("def nothing(): pass", filename="probe", entry="nothing", given=PROBE) as child:
            child.load()
            layers = child.layers
            tried = child.given(
                "report", str(readable_paths.HERE / "drills" / "reasons.py"), os.getpid()
            )
    except (StartFailed, Ended, Raised) as error:
        return [Protection("own process", False, str(error))]
    names = {
        "limits": ("resource limits", "memory, processor time, file size, open files"),
        "settled": ("no new privileges", "not inspectable, dies with the grader"),
        "capabilities": ("no capabilities", "root is treated like any user"),
        "landlock": ("Landlock", "files, TCP and signals are confined by the kernel"),
        "seccomp": ("system-call filter", "no processes, sockets, changed modes, foreign signals"),
    }
    for key, (name, meaning) in names.items():
        state = layers.get(key, "off")
        detail = meaning if state == "on" else f"{meaning}: {state}"
        result.append(Protection(name, not state.startswith("off"), detail))
    questions = {
        "files": ("the course's files can't be read", "the answers on disk can be read"),
        "signals": ("no signals to the grader", "the grader's process can be signalled"),
        "network": ("no sockets", "sockets can be opened"),
        "processes": ("no other processes", "processes can be started; they are found and killed"),
    }
    for key, (good, bad) in questions.items():
        rejected = isinstance(tried, dict) and bool(tried.get(key))
        result.append(Protection(f"tried: {key}", rejected, good if rejected else bad))
    how = "/proc, orphans adopted" if tree.LINUX else f"ps ({sys.platform})"
    result.append(
        Protection("watched from outside", True, f"memory, processes, disk through {how}")
    )
    return result
