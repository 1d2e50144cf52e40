"""A reader slower than its writer, on Cyclone DDS: what it misses, and how old the rest is."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from course.check import count, finite, one_of
from course.middleware.qos import ORDERS, QoS
from course.middleware.transport import PATIENCE, elsewhere, no_answer
from course.oracles.cyclonedds import (
    Topic,
    Wire,
    connect,
    names,
    neighbour,
    participant,
    take,
    until,
)


@dataclass(frozen=True)
class Queue:
    """What one slow reader got.

    Attributes:
        ages: of each sample that it took, in periods of the writer.
        lost: share of the samples that it never saw, of those that are no longer in the queue.
    """

    ages: list[int]
    lost: float


def queue_ages(
    depth: int, each: int, takes: int, reliability: str = "reliable", *, newest: bool = False
) -> Queue:
    """Return the ages of samples that a slow reader takes, in one process.

    It takes one sample after every few that are written, in turn.

    No clock is involved: the age of a sample is the number of those that were written after it.
    Once the queue is full, the oldest of `depth` samples is (depth - 1) periods old.

    Args:
        depth: of the reader's keep-last queue.
        each: samples written for one that is taken, at least 1.
        takes: how often it takes.
        reliability: of both ends.
        newest: take all that is there and use the newest instead.
    """
    for name, value in (("depth", depth), ("each", each), ("takes", takes)):
        count(name, value, 1)
    qos = QoS(one_of("reliability", reliability, ORDERS["reliability"]), depth=depth)
    ages, observed = [], 0
    with participant() as member:
        topic = Topic(member)
        writer, reader = topic.writer(qos), topic.reader(qos)
        for turn in range(takes):
            topic.write(writer, *range(turn * each, (turn + 1) * each))
            got = take(reader) if newest else [s.number for s in reader.take(1)]
            ages.append((turn + 1) * each - 1 - got[-1])
            observed += len(got)
        waiting = len(take(reader))
    return Queue(ages, 1.0 - observed / (takes * each - waiting))


@dataclass(frozen=True)
class Flood:
    """What came of messages that were written at a given rate, or as fast as possible.

    Attributes:
        received: how many came through.
        lost: share that did not.
        written: payload that the writer wrote in a second [B/s].
        through: payload that the reader took in a second, from the first to the last [B/s].
    """

    received: int
    lost: float
    written: float
    through: float


def flood(
    size: int,
    depth: int,
    messages: int = 200,
    pause: float = 0.0,
    reliability: str = "best_effort",
    every: float = 0.0,
) -> Flood:
    """Write messages to a reader in another process, by default as fast as the writer can.

    Args:
        size: of a message [bytes].
        depth: of the keep-last queues of both ends.
        messages: how many.
        pause: that the reader makes after each message [s].
        reliability: of both ends. What depth lets go is lost under either.
        every: time from one write to the next [s]; with 0 all are written at once.
    """
    count("messages", messages, 1)
    finite("pause", pause, 0.0, 1.0, unit="s")
    finite("every", every, 0.0, 1.0, unit="s")
    qos = QoS(one_of("reliability", reliability, ORDERS["reliability"]), depth=depth)
    topics, tally_ways, connected = names(), names(), elsewhere().Event()
    with (
        neighbour(_slow, connected, size, qos, pause, topics[::-1], tally_ways[::-1]),
        participant() as member,
    ):
        wire = Wire(member, size, qos, topics)
        report = Wire(member, 16, QoS(), tally_ways)
        until(report.ready)
        connect(wire, connected)
        payload = memoryview(bytes(size))
        start = time.perf_counter()
        for k in range(messages):
            if every:  # absolute times, so that the writer does not drift
                time.sleep(max(start + k * every - time.perf_counter(), 0.0))
            wire.send(payload)
        wrote = time.perf_counter() - start
        if reliability == "reliable":  # what was lost on the way may still be sent again
            wire.writer.wait_for_acks(round(1e9 * PATIENCE))
        report.send(memoryview(bytes(16)))
        if (tally := report.receive(PATIENCE)) is None:
            raise no_answer("the slow reader")
    received = int.from_bytes(tally[:8], "little")
    seconds = 1e-9 * int.from_bytes(tally[8:], "little")
    through = size * (received - 1) / seconds if received > 1 else 0.0
    return Flood(received, 1.0 - received / messages, size * messages / wrote, through)


def _slow(
    connected: Any,
    size: int,
    qos: QoS,
    pause: float,
    paths: tuple[str, str],
    tally_ways: tuple[str, str],
) -> None:
    """Take until the end is told and nothing is left; then say how many came, in how long [ns]."""
    with participant() as member:
        wire = Wire(member, size, qos, paths)
        report = Wire(member, 16, QoS(), tally_ways)
        if until(lambda: wire.ready() and report.ready()):
            connected.set()
        received, first, last, ended = 0, 0, 0, False
        limit = time.monotonic() + 3.0 * PATIENCE
        while time.monotonic() < limit:
            if wire.receive(0.1) is not None:
                last = time.perf_counter_ns()
                first = first or last
                received += 1
                time.sleep(pause)
            elif ended:
                break
            else:
                ended = report.receive(0.0) is not None
        report.send(
            memoryview(received.to_bytes(8, "little") + (last - first).to_bytes(8, "little"))
        )
        time.sleep(PATIENCE)  # its partner ends it
