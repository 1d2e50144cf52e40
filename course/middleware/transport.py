"""Process to process on one machine: a queue, a socket, a ring in shared memory; lost fragments.

A carrier is a context that yields trip(payload) -> what came back from another process, which
answers with what it got. The queue goes to another thread and hands on a reference, so it is the
floor: what it costs to wake somebody up. Loss is programmed: fragments of a message go over a real
loopback socket, and a seeded coin leaves some out. Source of the two formulas: each fragment is
lost by itself with probability p (W. Feller, An Introduction to Probability, 1968).
"""

from __future__ import annotations

import contextlib
import itertools
import math
import multiprocessing
import queue
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from typing import Any

import numpy as np

from course.check import count, finite

Trip = Callable[[bytes | memoryview], Any]
PATIENCE = 20.0  # s: a partner that is silent for so long is gone
# An Ethernet frame carries 1500 bytes, of which 20 are IP's and 8 UDP's header.
DATAGRAM = 1472


# Python runs the main script again in each new process, up to this line.
UNGUARDED = (
    'a child process died while it started; a script needs `if __name__ == "__main__":` around '
    "what it runs, as Python imports the script again in each child"
)


def no_answer(what: str, patience: float = PATIENCE) -> TimeoutError:
    """Return the error when a partner did not answer in time [s]."""
    return TimeoutError(f"{what} did not answer within {patience:g} s")


def elsewhere() -> Any:
    """Return what makes processes.

    Forked from one that has imported this chapter and has no threads.

    It keeps the environment that this process had when it asked first, and ends with it.

    Raises:
        RuntimeError: this process is such a child itself, and still importing the main script.
    """
    # The parent kills its other children when one dies: what they had made in shared memory by
    # then would stay for ever. So nothing is made before this is known.
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise RuntimeError(UNGUARDED)
    # A fork server: children start fast, and inherit neither threads nor locks of this process.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "course.middleware.inversion"])
    return context


@contextlib.contextmanager
def partner(target: Callable[..., None], *args: Any) -> Iterator[Any]:
    """Another process that runs target(*args); it is ended with the context.

    Raises:
        RuntimeError: it died while it started, so that it never answered.
    """
    child = elsewhere().Process(target=target, args=args, daemon=True)
    child.start()
    try:
        yield child
    except TimeoutError as error:
        if child.exitcode == 1:  # it died while it started
            raise RuntimeError(UNGUARDED) from error
        raise
    finally:
        child.kill()
        child.join()


# --- Carriers -------------------------------------------------------------------------------------


@contextlib.contextmanager
def threads() -> Iterator[Trip]:
    """Open a queue between two threads of this process; nothing is copied."""
    out: queue.SimpleQueue[bytes | memoryview | None] = queue.SimpleQueue()
    back: queue.SimpleQueue[bytes | memoryview] = queue.SimpleQueue()

    def answer() -> None:
        # None ends the thread; until then each message goes straight back (echo).
        while (payload := out.get()) is not None:
            back.put(payload)

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()

    def trip(payload: bytes | memoryview) -> bytes | memoryview:
        out.put(payload)
        return back.get(timeout=PATIENCE)

    try:
        yield trip
    finally:
        out.put(None)
        thread.join()


@contextlib.contextmanager
def unix_socket() -> Iterator[Trip]:
    """Open a Unix stream socket to another process; four bytes of length precede each message."""
    here, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    with here, other, partner(_answer_socket, other):
        here.settimeout(PATIENCE)

        def trip(payload: bytes | memoryview) -> bytearray:
            _send(here, payload)
            return _receive(here)

        yield trip


def _send(end: socket.socket, payload: bytes | bytearray | memoryview) -> None:
    # Length-prefixed framing: a byte stream has no message boundaries.
    end.sendall(struct.pack("!I", len(payload)))
    end.sendall(payload)


def _receive(end: socket.socket) -> bytearray:
    def exactly(size: int) -> bytearray:
        buffer = bytearray(size)
        view, have = memoryview(buffer), 0
        # A stream may deliver a message in pieces.
        while have < size:
            got = end.recv_into(view[have:])
            if not got:
                raise no_answer("a socket")
            have += got
        return buffer

    (size,) = struct.unpack("!I", exactly(4))
    return exactly(size)


def _answer_socket(end: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while True:
            _send(end, _receive(end))


class Ring:
    """Slots in shared memory between one that puts and one that takes.

    Two semaphores count the free and the full slots. A process that has nothing to do sleeps on
    one, and what was written before it is released is seen by the process that gets it.

    Args:
        slots: how many messages fit, at least 1.
        size: of the largest message [bytes].
    """

    def __init__(self, slots: int, size: int) -> None:
        self.slots, self.size = count("slots", slots, 1), count("size", size, 1)
        # One length and one payload for each slot.
        processes = elsewhere()
        self.memory = SharedMemory(create=True, size=slots * (size + 4))
        self.free, self.full = processes.Semaphore(slots), processes.Semaphore(0)
        self.turn = {"put": 0, "take": 0}
        self.held: memoryview | None = None

    @property
    def room(self) -> Any:
        """All slots, as bytes."""
        return self.memory.buf

    def put(self, payload: bytes | memoryview, patience: float = PATIENCE) -> bool:
        """Copy a message into the next slot; False if none became free in time [s]."""
        count("the payload's size", len(payload), 0, self.size)
        # Two semaphores count free and full slots, so writer and reader need no lock.
        if not self.free.acquire(timeout=patience):
            return False
        at = self._advance("put")
        # Length first, so that messages shorter than the slot can be told apart.
        struct.pack_into("!I", self.room, at, len(payload))
        self.room[at + 4 : at + 4 + len(payload)] = payload
        self.full.release()
        return True

    def take(self, patience: float = PATIENCE) -> memoryview | None:
        """Take the oldest message, in place and valid until the next call; None if there is none.

        A message is not copied; None means that none came in time [s].
        """
        # The slot that the reader looked at is free again from now on.
        if self.held:
            self.held.release()
            self.free.release()
        self.held = None
        if self.full.acquire(timeout=patience):
            at = self._advance("take")
            (size,) = struct.unpack_from("!I", self.room, at)
            self.held = self.room[at + 4 : at + 4 + size]
        return self.held

    def _advance(self, name: str) -> int:
        at = self.turn[name] * (self.size + 4)
        self.turn[name] = (self.turn[name] + 1) % self.slots
        return at

    def close(self) -> None:
        """Give the memory back, for all who use it."""
        # A view into the memory would keep it from being closed.
        if self.held:
            self.held.release()
        self.memory.close()
        self.memory.unlink()


@contextlib.contextmanager
def shared_memory(size: int, slots: int = 4) -> Iterator[Trip]:
    """Open a ring in shared memory each way; a message is copied once, into its slot."""
    with contextlib.ExitStack() as stack:
        out, back = (Ring(slots, size) for _ in range(2))
        stack.callback(out.close)
        stack.callback(back.close)
        stack.enter_context(partner(_answer_ring, out, back))

        def trip(payload: bytes | memoryview) -> memoryview:
            # The echo makes a round trip; half of it is not a one-way time, as wake-ups differ.
            out.put(payload)
            if (answer := back.take()) is None:
                raise no_answer("a ring")
            return answer

        yield trip


def _answer_ring(out: Ring, back: Ring) -> None:
    while (payload := out.take(60.0)) is not None:
        back.put(payload)


def carriers(size: int) -> dict[str, Any]:
    """Return the three carriers for messages of up to `size` bytes, by name, the floor first."""
    return {
        "queue between threads": threads(),
        "Unix socket": unix_socket(),
        "shared-memory ring": shared_memory(count("size", size, 1)),
    }


# --- Bandwidth ------------------------------------------------------------------------------------


def stream(width: int, height: int, pixel: int, rate: float) -> tuple[int, float, int]:
    """Return what pictures of width x height pixels, of `pixel` bytes each, demand of a link.

    Returns:
        Bytes of a picture, bytes of payload a second at `rate` [1/s], and datagrams of a picture,
        each as full as an Ethernet frame allows.
    """
    frame = count("width", width, 1) * count("height", height, 1) * count("pixel", pixel, 1)
    return frame, frame * finite("rate", rate, 0.0, unit="1/s"), -(-frame // DATAGRAM)


# --- Lost fragments -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Loss:
    """What came of messages over a link that loses fragments.

    Attributes:
        lost: share of the messages that lacked a fragment after the first round.
        rounds: mean number of rounds until all fragments of a message were there.
        sent: fragments in all.
    """

    lost: float
    rounds: float
    sent: int


def lossy(messages: int, fragments: int, loss: float, seed: int, at_most: int = 100) -> Loss:
    """Send messages in fragments over a loopback socket, some of which a coin leaves out.

    After each round the receiver asks over the same socket for what it lacks, by number, and that
    is sent again: negative acknowledgement. Requests are not lost.

    Args:
        messages: how many.
        fragments: of each, at least 1.
        loss: probability that a fragment is not sent, below 1.
        seed: of the coin.
        at_most: rounds after which a message is given up.
    """
    count("messages", messages, 1), count("fragments", fragments, 1)
    finite("loss", loss, 0.0, 1.0 - 1e-6)
    rng = np.random.default_rng(seed)
    lost = rounds = sent = 0
    with (
        socket.socket(type=socket.SOCK_DGRAM) as sender,
        socket.socket(type=socket.SOCK_DGRAM) as receiver,
    ):
        for end in (sender, receiver):
            end.bind(("127.0.0.1", 0))
            end.settimeout(PATIENCE)
        sender.connect(receiver.getsockname())
        receiver.connect(sender.getsockname())
        # One message: rounds of sending and negative acknowledgement until nothing is missing.
        for _ in range(messages):
            desired = list(range(fragments))
            for turn in itertools.count(1):
                # The loss is drawn before sending, as the loopback itself loses nothing.
                selected = rng.random(len(desired)) >= loss
                have = set()
                for number in itertools.compress(desired, selected):
                    sender.send(struct.pack("!I", number))
                    have.add(struct.unpack("!I", receiver.recv(4))[0])
                sent += len(desired)
                missing = [number for number in desired if number not in have]
                # A request names up to 350 fragments, so that it fits in a datagram.
                desired = []
                for first in range(0, len(missing), 350):
                    part = missing[first : first + 350]
                    receiver.send(struct.pack(f"!{len(part)}I", *part))
                    desired += struct.unpack(f"!{len(part)}I", sender.recv(DATAGRAM))
                lost += turn == 1 and bool(desired)
                if not desired or turn == count("at_most", at_most, 1):
                    break
            rounds += turn
    return Loss(lost / messages, rounds / messages, sent)


def expected_loss(fragments: int, loss: float) -> float:
    """Return the probability that a message lacks a fragment: 1 - (1 - p)^n."""
    return -math.expm1(fragments * math.log1p(-loss))


def expected_rounds(fragments: int, loss: float) -> float:
    """Return the mean rounds until all n are there: the mean of the largest of n geometric numbers.

    A round k + 1 is needed if any of them was lost k times: the sum over k of 1 - (1 - p^k)^n.
    """
    finite("loss", loss, 0.0, 1.0 - 1e-6)
    total, k = 1.0, 1
    while (more := expected_loss(fragments, loss**k)) > 1e-15:
        total, k = total + more, k + 1
    return total
