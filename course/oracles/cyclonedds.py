"""Eclipse Cyclone DDS asked who hears whom, what a late joiner gets, and what a message costs.

Nothing leaves the machine: `library` confines what Cyclone sends to the interface lo, without
multicast, with 127.0.0.1 as the only peer, in a domain and under a tag of its own, before it is
imported first. Listening is not confined: Cyclone binds its sockets to all interfaces, so a packet
from outside would be read, and dropped where domain and tag differ.
Whoever hears it is in this process or was started by it. In one process a sample is with its
readers when `write` returns; `echo` goes through the sockets of two processes.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from course.check import count, one_of
from course.libraries import import_error
from course.middleware.qos import QoS
from course.middleware.transport import PATIENCE, Trip, elsewhere, no_answer, partner

CONFIGURATION = """<CycloneDDS xmlns="https://cdds.io/config"><Domain Id="{domain}">
<General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
<AllowMulticast>false</AllowMulticast><EnableMulticastLoopback>false</EnableMulticastLoopback>
</General><Discovery><Tag>course-{process}</Tag><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>
</Discovery></Domain></CycloneDDS>"""

# dds_public_qosdefs.h: the numbers that an event names a policy by.
NAMES = {
    2: "durability",
    4: "deadline",
    6: "ownership",
    8: "liveliness",
    11: "reliability",
    12: "destination_order",
    24: "type_consistency",
}
KINDS = {
    "volatile": "Volatile",
    "transient_local": "TransientLocal",
    "transient": "Transient",
    "persistent": "Persistent",
    "automatic": "Automatic",
    "manual_by_participant": "ManualByParticipant",
    "manual_by_topic": "ManualByTopic",
    "shared": "Shared",
    "exclusive": "Exclusive",
    "by_reception_timestamp": "ByReceptionTimestamp",
    "by_source_timestamp": "BySourceTimestamp",
}
_topics = itertools.count()


def library() -> ModuleType:
    """Return cyclonedds, confined to this machine. A child process shares the domain of its parent.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    if "<Tag>course-" not in os.environ.get("CYCLONEDDS_URI", ""):
        me = os.getpid()
        # Domain and tag from the process number keep runs on one machine apart.
        xml = CONFIGURATION.format(domain=1 + me % 230, process=me)
        os.environ["CYCLONEDDS_URI"] = xml
    try:
        import cyclonedds
    except ImportError as error:
        raise import_error("Cyclone DDS", "pip install 'cyclonedds>=11.0'", error) from error
    return cyclonedds


@contextlib.contextmanager
def participant() -> Iterator[Any]:
    """Open a participant in this process's domain; its threads and sockets end with it."""
    library()
    from cyclonedds.domain import DomainParticipant

    made = DomainParticipant()
    try:
        yield made
    finally:
        # pyrefly: ignore[unsupported-operation]
        del made._entities[made._ref]  # else it would be deleted once more with the last name
        made._delete(made._ref)


def read_back() -> dict[str, str]:
    """Return the settings that Cyclone reports once it runs, and its multicast groups.

    Returns:
        By name: `domain`, `interfaces`, `multicast`, `peers`, `tag`, `address` of its own, and
        `groups`, the memberships of all interfaces that came with it. A child process asks.
    """
    library()
    with tempfile.TemporaryDirectory() as folder:
        trace = Path(folder) / "trace"
        traced = f"<Tracing><Verbosity>config</Verbosity><OutputFile>{trace}</OutputFile></Tracing>"
        xml = os.environ["CYCLONEDDS_URI"].replace("</Domain>", f"{traced}</Domain>")
        # In a child process, since the configuration is read once, at the first import.
        code = (
            "from pathlib import Path\nfrom course.oracles import cyclonedds\n"
            "def groups(): return Path('/proc/net/igmp').read_text().count('\\t\\t\\t\\t')\n"
            "before = groups()\nwith cyclonedds.participant() as p:\n"
            "    print(p.domain_id, groups() - before)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=os.environ | {"CYCLONEDDS_URI": xml},
            check=True,
            capture_output=True,
            text=True,
            timeout=60,
        )
        # Cyclone's own trace of the settings in force.
        lines = trace.read_text().splitlines()

    def text(word: str) -> str:
        return " ".join(line.split(word, 1)[1].strip() for line in lines if word in line)

    domain, groups = done.stdout.split()
    return {
        "domain": domain,
        "groups": groups,
        "interfaces": text("selected interfaces:"),
        "multicast": text("General/AllowMulticast/#text:").split()[0],
        "peers": text("Peer[@Address]:").split()[0],
        "address": text("ownip:"),
        "tag": text("Discovery/Tag/#text:").split()[0],
    }


def policies(qos: QoS, kept_for_late: int | None = None, strength: int = 0) -> Any:
    """Return ours in Cyclone's words.

    Args:
        qos: of a writer or a reader.
        kept_for_late: depth of the durability service, which decides in Cyclone what a late joiner
            gets; 0 leaves Cyclone's default of 1 sample. By default it is the history's, as ROS 2's
            rmw_cyclonedds_cpp sets it (rmw_node.cpp, create_readwrite_qos, Humble, 2022).
        strength: of a writer with exclusive ownership.
    """
    library()
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration

    def time_of(seconds: float) -> int:
        # DDS counts in nanoseconds and has its own infinity.
        return duration(infinite=True) if math.isinf(seconds) else round(1e9 * seconds)

    def selected(depth: float) -> Any:
        return Policy.History.KeepAll if math.isinf(depth) else Policy.History.KeepLast(int(depth))

    best = qos.reliability == "best_effort"
    result = [
        Policy.Reliability.BestEffort if best else Policy.Reliability.Reliable(time_of(1.0)),
        getattr(Policy.Durability, KINDS[qos.durability]),
        selected(qos.history_depth),
        Policy.Deadline(time_of(qos.deadline)),
        Policy.Lifespan(time_of(qos.lifespan)),
        getattr(Policy.Liveliness, KINDS[qos.liveliness])(time_of(qos.liveliness_lease_duration)),
        getattr(Policy.Ownership, KINDS[qos.ownership]),
        getattr(Policy.DestinationOrder, KINDS[qos.destination_order]),
    ]
    if strength:
        result.append(Policy.OwnershipStrength(strength))
    if kept_for_late != 0:
        result.append(
            Policy.DurabilityService(0, selected(kept_for_late or qos.history_depth), -1, -1, -1)
        )
    return Qos(*result)


class Topic:
    """A topic of numbers, with a name of its own, for writers and readers of this process."""

    def __init__(self, member: Any, keyed: bool = False) -> None:
        """Create the topic; where it is keyed, each number is an instance with its own history."""
        from cyclonedds import idl, topic
        from cyclonedds.idl.types import int32

        key = {"number": {"key": True}} if keyed else None
        self.kind: Any = idl.make_idl_struct(
            "Number", "course.Number", {"number": int32}, field_annotations=key
        )
        self.topic = topic.Topic(member, f"numbers_{os.getpid()}_{next(_topics)}", self.kind)
        self.member = member

    def writer(self, qos: QoS, kept_for_late: int | None = None, strength: int = 0) -> Any:
        """Return a writer, see `policies`."""
        from cyclonedds.pub import DataWriter

        return DataWriter(self.member, self.topic, policies(qos, kept_for_late, strength))

    def reader(self, qos: QoS) -> Any:
        """Return a reader."""
        from cyclonedds.sub import DataReader

        return DataReader(self.member, self.topic, policies(qos))

    def write(self, writer: Any, *numbers: int, stamp: float | None = None) -> None:
        """Write numbers, with a source time of their own [s] or now."""
        for number in numbers:
            # DDS time stamps are in nanoseconds.
            writer.write(self.kind(number=number), None if stamp is None else round(1e9 * stamp))


def take(reader: Any) -> list[int]:
    """Take the numbers that wait in a reader.

    Notices that a writer has left are skipped.
    """
    return [s.number for s in reader.take(1000) if hasattr(s, "number")]


@dataclass(frozen=True)
class Verdict:
    """What Cyclone made of a pair.

    Attributes:
        matched: whether writer and reader know of each other.
        writer, reader: the policy that the event at each end names, or "".
        delivered: of one sample, how many came.
    """

    matched: bool
    writer: str
    reader: str
    delivered: int


def verdicts(pairs: Sequence[tuple[QoS, QoS]]) -> list[Verdict]:
    """Return each pair (offered, requested) on a topic of its own."""
    result = []
    with participant() as member:
        for offered, requested in pairs:
            # A topic of its own for each pair, so that no earlier writer is matched.
            topic = Topic(member)
            writer, reader = topic.writer(offered), topic.reader(requested)
            topic.write(writer, 1)
            # The counters are read after the write: in one process matching is finished by then.
            ends = (
                writer.get_offered_incompatible_qos_status(),
                reader.get_requested_incompatible_qos_status(),
            )
            writer_told, reader_told = (
                NAMES[end.last_policy_id] if end.total_count else "" for end in ends
            )
            known = (
                writer.get_publication_matched_status().current_count
                + reader.get_subscription_matched_status().current_count
            )
            result.append(Verdict(known == 2, writer_told, reader_told, len(take(reader))))
    return result


def own_messages(count: int, ignores: bool) -> int:
    """Return how many of `count` messages a reader gets from a writer of its own participant.

    Args:
        count: messages that are written.
        ignores: whether the reader ignores the writers of its participant (ROS 2:
            `ignore_local_publications`).
    """
    with participant() as member:
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader

        topic, rest = Topic(member), policies(QoS())
        if ignores:
            rest = Qos(Policy.IgnoreLocal.Participant, base=rest)
        reader = DataReader(member, topic.topic, rest)
        topic.write(topic.writer(QoS()), *range(count))
        return len(take(reader))


# --- Between two processes ------------------------------------------------------------------------


def payload_type(size: int, kind: str = "array") -> Any:
    """Return a message of `size` bytes in the field `data`.

    Args:
        size: in bytes.
        kind: "array": array[uint8, size], which the binding copies as a block; "sequence":
            sequence[uint8], which it packs number by number.
    """
    from cyclonedds import idl
    from cyclonedds.idl.types import array, sequence, uint8

    one_of("kind", kind, ("array", "sequence"))
    wide = count("size", size, 1)
    data = array[uint8, wide] if kind == "array" else sequence[uint8]  # type: ignore[misc]
    return idl.make_idl_struct("Bytes", f"course.{kind.title()}{size}", {"data": data})


class Wire:
    """One end of two topics of bytes: `send` on one of them, `receive` from the other.

    Args:
        member: participant.
        size, kind: of the payload, see `payload_type`.
        qos: of all ends.
        paths: the names of the two topics, see `names`.
    """

    def __init__(
        self, member: Any, size: int, qos: QoS, paths: tuple[str, str], kind: str = "array"
    ) -> None:
        from cyclonedds.core import ReadCondition, SampleState, WaitSet
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        self.kind = payload_type(size, kind)
        out, back = (Topic(member, method, self.kind) for method in paths)
        self.writer = DataWriter(member, out, policies(qos))
        self.reader = DataReader(member, back, policies(qos))
        self.set = WaitSet(member)
        self.condition = ReadCondition(self.reader, SampleState.NotRead)
        self.set.attach(self.condition)

    def ready(self) -> bool:
        """Return whether both topics have their other end."""
        return bool(
            self.writer.get_publication_matched_status().current_count
            and self.reader.get_subscription_matched_status().current_count
        )

    def send(self, payload: Any) -> None:
        """Write."""
        self.writer.write(self.kind(data=payload))

    def receive(self, patience: float) -> Any:
        """Return the oldest payload that is there, or None if none came in time [s]."""
        if not self.set.wait(round(1e9 * patience)):
            return None
        return next((s.data for s in self.reader.take(1) if hasattr(s, "data")), None)


@contextlib.contextmanager
def buffered(least: int | None = None, at_most: int | None = None) -> Iterator[None]:
    """Sockets whose receive buffer has at least `least` and at most `at_most` bytes.

    Holds for domains that start inside, so no participant may be open. By itself Cyclone asks for
    1 MiB. More than net.core.rmem_max lets no participant start.
    """
    library()
    before = os.environ["CYCLONEDDS_URI"]
    sizes = {"min": least, "max": at_most}
    message = " ".join(f'{name}="{size}B"' for name, size in sizes.items() if size is not None)
    desired = f"<Internal><SocketReceiveBufferSize {message}/></Internal></Domain>"
    os.environ["CYCLONEDDS_URI"] = before.replace("</Domain>", desired)
    try:
        yield
    finally:
        os.environ["CYCLONEDDS_URI"] = before


def answered(size: int, trips: int, reliability: str, patience: float = 0.5) -> int:
    """Count the round trips of one message that came back in time [s]; see `echo`."""
    result = 0
    with echo(size, reliability, patience=patience) as trip:
        payload = memoryview(bytes(size))
        for _ in range(count("trips", trips, 1)):
            with contextlib.suppress(TimeoutError):
                trip(payload)
                result += 1
    return result


def names() -> tuple[str, str]:
    """Return two names of topics that nobody in this domain has had.

    The other end has them reversed.
    """
    here = f"{os.getpid()}_{next(_topics)}"
    return f"out_{here}", f"back_{here}"


@contextlib.contextmanager
def echo(
    size: int, reliability: str = "reliable", kind: str = "array", patience: float = PATIENCE
) -> Iterator[Trip]:
    """A trip through another process, as the carriers of `course.middleware.transport` are.

    Args:
        size: of the payload [bytes]; it is handed in as a memoryview or as bytes.
        reliability: of both topics; what is lost under "best_effort" raises TimeoutError.
        kind: see `payload_type`.
        patience: after which an answer is taken for lost [s].
    """
    topics, connected = names(), elsewhere().Event()
    qos = QoS(one_of("reliability", reliability, ("reliable", "best_effort")), depth=1)
    with (
        neighbour(_answer, connected, size, qos, topics[::-1], kind),
        participant() as member,
    ):
        wire = Wire(member, size, qos, topics, kind)
        connect(wire, connected)

        def trip(payload: Any) -> Any:
            wire.send(payload)
            if (answer := wire.receive(patience)) is None:
                raise no_answer("Cyclone DDS", patience)
            return answer

        yield trip


def neighbour(target: Callable[..., None], *args: Any) -> Any:
    """Return a `partner` of `course.middleware.transport` in the domain of this process."""
    library()
    return partner(_in_domain, os.environ["CYCLONEDDS_URI"], target, *args)


def _in_domain(uri: str, target: Callable[..., None], *args: Any) -> None:
    os.environ["CYCLONEDDS_URI"] = uri
    target(*args)


def connect(wire: Wire, connected: Any) -> None:
    """Wait until both processes know all ends of a wire.

    Each process discovers the other by itself, and a sample that arrives before its reader knows
    the writer is dropped. So one process that knows the other is not enough.

    Args:
        wire: of this process.
        connected: event that the other process sets once its own wire is ready.

    Raises:
        TimeoutError: one of them did not discover the other in time.
    """
    if not (until(wire.ready) and connected.wait(PATIENCE)):
        raise no_answer("Cyclone DDS")


def _answer(connected: Any, size: int, qos: QoS, paths: tuple[str, str], kind: str) -> None:
    with participant() as member:
        wire = Wire(member, size, qos, paths, kind)
        if until(wire.ready):
            connected.set()
        while True:
            if (payload := wire.receive(PATIENCE)) is not None:
                wire.send(payload)


def until(done: Callable[[], bool], seconds: float = PATIENCE) -> bool:
    """Wait until it is done, for `seconds` at most; return whether it is."""
    end = time.monotonic() + seconds
    while not (reached := done()) and time.monotonic() < end:
        time.sleep(0.005)
    return reached
