"""Eclipse zenoh asked what a message costs from process to process.

Nothing leaves the machine: scouting and gossip are off, the only endpoint is a port of 127.0.0.1
that one process listens on and the other is told of. By itself zenoh hands messages of 3 kB and
more to a neighbour through shared memory; `shared` says whether it may.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import queue
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from course.libraries import import_error
from course.middleware.transport import PATIENCE, Trip, no_answer, partner
from course.oracles.cyclonedds import until


def library() -> ModuleType:
    """Return zenoh.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    try:
        import zenoh
    except ImportError as error:
        raise import_error("zenoh", "pip install 'eclipse-zenoh>=1.10'", error) from error
    return zenoh


def configuration(port: int, listens: bool, shared: bool) -> Any:
    """Return the settings of one of two processes that know each other by a port of 127.0.0.1."""
    made = library().Config()
    endpoint = [f"tcp/127.0.0.1:{port}"]
    for key, value in {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": endpoint if listens else [],
        "connect/endpoints": [] if listens else endpoint,
        "transport/shared_memory/enabled": shared,
    }.items():
        made.insert_json5(key, json.dumps(value))
    return made


def read_back(made: Any) -> dict[str, Any]:
    """Return what a configuration says of itself."""
    keys = (
        "scouting/multicast/enabled",
        "scouting/gossip/enabled",
        "listen/endpoints",
        "connect/endpoints",
        "transport/shared_memory/enabled",
    )
    return {key: json.loads(made.get_json(key)) for key in keys}


def free_port() -> int:
    """Return a port of 127.0.0.1 that nobody listens on just now."""
    with socket.socket() as end:
        end.bind(("127.0.0.1", 0))
        return int(end.getsockname()[1])


@contextlib.contextmanager
def echo(shared: bool = False) -> Iterator[Trip]:
    """A trip through another process, as the carriers of `course.middleware.transport` are.

    Args:
        shared: whether larger messages may go through shared memory, as by default in zenoh;
            otherwise all go over TCP.
    """
    if shared:
        _clean_at_exit()
    port, inbox = free_port(), queue.SimpleQueue[Any]()
    with library().open(configuration(port, True, shared)) as session:
        outbox = _publisher(session, "course/out")
        back = session.declare_subscriber("course/back", inbox.put)
        with partner(_answer, port, shared):
            until(lambda: outbox.matching_status.matching)

            def trip(payload: bytes | memoryview) -> Any:
                outbox.put(bytes(payload))
                try:
                    return inbox.get(timeout=PATIENCE).payload.to_bytes()
                except queue.Empty:
                    raise no_answer("zenoh") from None

            yield trip
        back.undeclare()


@functools.cache
def _clean_at_exit() -> None:
    """Remove this process's segments of shared memory when it ends, once.

    zenoh removes those of processes that are dead, such as the partner's, but leaves its own, of 16
    MiB and more, until the next process that uses it.
    """
    maps = Path("/proc/self/maps")

    def clean() -> None:
        for line in maps.read_text(encoding="utf-8").splitlines():
            if line.endswith(".zenoh") and "/dev/shm/" in line:
                Path("/dev/shm", line.rsplit("/", 1)[1]).unlink(missing_ok=True)

    if maps.is_file():
        atexit.register(clean)


def _publisher(session: Any, key: str) -> Any:
    """Return one that waits where the line is full; as by default zenoh would drop the message."""
    block = library().CongestionControl.BLOCK
    return session.declare_publisher(key, congestion_control=block)


def _answer(port: int, shared: bool) -> None:
    with library().open(configuration(port, False, shared)) as session:
        outbox = _publisher(session, "course/back")
        session.declare_subscriber("course/out", lambda sample: outbox.put(sample.payload))
        threading.Event().wait(600.0)  # until its partner ends it, but not for ever
