"""The processes below a child: found, measured and ended from outside.

Linux answers through /proc; elsewhere psutil does. A process that left the group and the session
and whose parents are gone is found too: while a child runs, the grader adopts orphans
(PR_SET_CHILD_SUBREAPER), and knows its own by resource limits, which a process can't raise again.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator

import psutil

LINUX = sys.platform.startswith("linux") and os.path.isdir("/proc/self/task")
PAGE = os.sysconf("SC_PAGE_SIZE")
PR_SET_CHILD_SUBREAPER, PR_GET_CHILD_SUBREAPER = 36, 37

_adopting = 0
_adopted_before = 0
_lock = threading.Lock()
ROOTS: set[int] = set()  # process ids of the children that run now


def adopt_orphans(start: bool) -> None:
    """Let orphaned descendants become children of this process, while any child runs."""
    global _adopting, _adopted_before
    if not LINUX:
        return
    with _lock:
        libc = ctypes.CDLL(None)
        if start and _adopting == 0:
            flag = ctypes.c_int()
            libc.prctl(PR_GET_CHILD_SUBREAPER, ctypes.byref(flag), 0, 0, 0)
            _adopted_before = flag.value
            libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        _adopting += 1 if start else -1
        if _adopting == 0:
            libc.prctl(PR_SET_CHILD_SUBREAPER, _adopted_before, 0, 0, 0)


def _read(path: str) -> str:
    try:
        with open(path, "rb", buffering=0) as file:
            return (file.read(8192) or b"").decode("ascii", "replace")
    except OSError:
        return ""


def _status(process: int) -> tuple[str, int, int, int] | None:
    """Return the state, parent, session and start time of a process; None when there is none."""
    text = _read(f"/proc/{process}/stat")
    fields = text[text.rfind(")") + 2 :].split()
    if len(fields) < 20:
        return None
    return fields[0], int(fields[1]), int(fields[3]), int(fields[19])


def _children(process: int) -> list[int]:
    result: list[int] = []
    try:
        threads = os.listdir(f"/proc/{process}/task")
    except OSError:
        return result
    for thread in threads:
        result += map(int, _read(f"/proc/{process}/task/{thread}/children").split())
    return result


def _another(process: int) -> int:
    """Return a thread of a process, not its first; the process itself if there is none."""
    try:
        return max(int(name) for name in os.listdir(f"/proc/{process}/task") if name.isdigit())
    except (OSError, ValueError):
        return process


def _limit(process: int, name: str) -> float:
    for line in _read(f"/proc/{process}/limits").splitlines():
        if line.startswith(name):
            word = line[len(name) :].split()[1]  # the hard limit
            return float("inf") if word == "unlimited" else float(word)
    return float("inf")


class Tree:
    """A process with all that came from it.

    Args:
        root: its process id, a child of this process that leads its own group and session.
        file_size: its hard limit on a file's size [bytes], by which orphans are known.
        token: text in its environment, by which they are known where there is no /proc.
    """

    def __init__(self, root: int, file_size: int, token: str, procfs: bool = LINUX) -> None:
        self.root, self.file_size, self.token, self.procfs = root, file_size, token, procfs
        status = _status(root) if procfs else None
        self.started = status[3] if status else 0
        self.known: dict[int, int] = {}  # descendants by start time
        self._handles: dict[int, psutil.Process] = {}  # descendants, where there is no /proc
        self._others: set[tuple[int, int]] = set()  # our other children, examined before
        self._processor = 0.0

    def descendants(self) -> list[int]:
        """Return all processes below the root that are alive, the root not among them."""
        if not self.procfs:
            return self._descendants_by_psutil()
        result: dict[int, int] = {}
        pending = [self.root, *self._orphans(), *self.known]
        visited = {os.getpid()}
        while pending:
            process = pending.pop()
            if process in visited:
                continue
            visited.add(process)
            if process != self.root:
                status = _status(process)
                if status is None or self.known.get(process, status[3]) != status[3]:
                    self.known.pop(process, None)
                    continue
                self.known[process] = status[3]
                if status[0] not in "ZX":
                    result[process] = status[3]
            pending += _children(process)
        return list(result)

    def _orphans(self) -> Iterator[int]:
        for process in _children(os.getpid()):
            if process in ROOTS or process in self.known:
                continue
            status = _status(process)
            if status is None or (process, status[3]) in self._others:
                continue
            if status[3] >= self.started and _limit(process, "Max file size") <= self.file_size:
                yield process
            elif status[0] not in "ZX":
                self._others.add((process, status[3]))

    def _descendants_by_psutil(self) -> list[int]:
        """Return what `descendants` does, from a listing of all processes.

        A process belongs to the tree if it is in the root's group, has the token in its
        environment or its command line, was found before, or descends from one that belongs.
        """
        processes: dict[int, psutil.Process] = {}
        parents: dict[int, int] = {}
        ours, dead = {self.root}, set()
        for pid in psutil.pids():
            try:
                process = psutil.Process(pid)
                parents[pid] = process.ppid()
                if process.status() == psutil.STATUS_ZOMBIE:
                    dead.add(pid)
            except psutil.NoSuchProcess:
                continue  # it ended meanwhile
            except psutil.AccessDenied:
                pass  # another user's: nothing of ours
            processes[pid] = process
            # Equality of two handles includes the start time: a reused number is another process.
            if self._handles.get(pid) == process or self._marked(process):
                ours.add(pid)
        while new := {p for p, parent in parents.items() if parent in ours} - ours:
            ours |= new
        alive = ours - dead - {self.root, os.getpid()}
        self._handles.update((pid, processes[pid]) for pid in alive if pid in processes)
        return [pid for pid in alive if pid in processes]

    def _marked(self, process: psutil.Process) -> bool:
        """Return whether a process is in the root's group, or carries the token."""
        try:
            if os.getpgid(process.pid) == self.root:
                return True
        except OSError:
            pass  # it ended meanwhile, or the system does not say
        for read in (lambda: process.environ().values(), process.cmdline):
            try:
                texts = read()
            except (psutil.Error, OSError):
                continue
            if any(self.token in text for text in texts):
                return True
        return False

    def threads(self) -> int:
        """Return threads of the root; 1 where that can't be seen."""
        text = _read(f"/proc/{self.root}/stat") if self.procfs else ""
        fields = text[text.rfind(")") + 2 :].split()
        return int(fields[17]) if len(fields) > 17 else 1

    def processor_time(self) -> float:
        """Return processor time of the root's threads so far [s].

        The wall clock where none is told.
        """
        if not LINUX:
            return time.monotonic()
        try:  # the clock of another process, numbered as clock_getcpuclockid(3) does
            self._processor = time.clock_gettime((~self.root << 3) | 2)
        except OSError:
            pass  # it is gone: what was read last counts
        return self._processor

    def resident(self, processes: list[int]) -> int:
        """Return memory of the root and the given processes together [bytes]."""
        if not self.procfs:
            total = 0
            for process in (self.root, *processes):
                with contextlib.suppress(psutil.Error):  # it ended meanwhile
                    total += psutil.Process(process).memory_info().rss
            return total
        pages = 0
        for process in (self.root, *processes):
            fields = _read(f"/proc/{process}/statm").split()
            if fields[1:2] == ["0"]:  # its first thread has ended; another shares what it had
                fields = _read(f"/proc/{process}/task/{_another(process)}/statm").split()
            pages += int(fields[1]) if len(fields) > 1 else 0
        return pages * PAGE

    def kill(self, patience: float = 10.0) -> list[int]:
        """End everything below the root, and the root's group. The root must not be reaped yet.

        Args:
            patience: how long to try [s].

        Returns:
            Processes that are alive all the same.
        """
        deadline = time.monotonic() + patience
        pause = 0.0005
        self._signal_group()
        remaining = self.descendants()
        while remaining and time.monotonic() < deadline:
            for process in remaining:
                self._signal(process)
            self._signal_group()
            self._reap()
            time.sleep(pause)
            pause = min(2 * pause, 0.02)
            remaining = self.descendants()
        self._reap()
        return remaining

    def _signal_group(self) -> None:
        try:
            os.killpg(self.root, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            pass  # gone already; or all that is left of it is dead

    def _signal(self, process: int) -> None:
        """Kill one process, surely this one and not a later one of the same number."""
        try:
            if not self.procfs:
                self._handles[process].kill()  # which looks at the start time, too
                return
            if not hasattr(os, "pidfd_open"):
                os.kill(process, signal.SIGKILL)
                return
            handle = os.pidfd_open(process)
            try:
                status = _status(process)
                if status is not None and status[3] == self.known.get(process):
                    signal.pidfd_send_signal(handle, signal.SIGKILL)
            finally:
                os.close(handle)
        except (OSError, psutil.Error):
            pass  # it ended by itself

    def _reap(self) -> None:
        for process in [*self.known, *self._handles]:
            try:
                os.waitpid(process, os.WNOHANG)
            except OSError:
                pass  # not a child of ours; its own parent reaps it
