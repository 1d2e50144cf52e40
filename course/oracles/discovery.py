"""Cyclone DDS asked why a topic is listed and yet not matched.

Each case has a process of its own for each participant, as domain, multicast and peers are read
once in a process. The first process holds a reader; the second one lists what discovery shows it
(the built-in topics), and reports whether its writer is matched and by which policy it is not.
Nothing leaves the machine, see `course.oracles.cyclonedds`: multicast is off in all cases, as on a
network that drops it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Any

from course.check import one_of
from course.oracles.cyclonedds import CONFIGURATION, library

# The reader's definition of the type where it differs under the same type name: fields and their
# types. The writer's is {"number": "int32"}.
DEFINITIONS = {
    "field added": {"number": "int32", "effort": "float64"},
    "field changed": {"number": "float32"},
    "field renamed": {"position": "int32"},
    "appendable": {"number": "int32", "effort": "float64"},
    "no coercion": {"number": "int32", "effort": "float64"},
}
# Cyclone takes a type as final unless it is declared appendable (DDS-XTypes 1.3, 2020).
APPENDABLE = ("appendable", "no coercion")
CASES = (
    "works",
    "other domain",
    "other type",
    "other policy",
    "no peer",
    "with a peer",
    *DEFINITIONS,
)


@dataclass(frozen=True)
class Discovered:
    """What the second process saw.

    Attributes:
        participants: how many participants it discovered, other than itself.
        listed: whether the built-in topics list a reader of the topic's name.
        types: the type names of these readers.
        matched: whether its writer is matched with a reader.
        policy: the policy that the event "offered incompatible QoS" names, or "".
        same_hash: whether every reader that is listed announced the type identifier of the writer's
            own type, a hash of the definition.
        inconsistent: the count of the writer's status "inconsistent topic".
        received: the fields of the message that the reader took, if the writer was matched.
    """

    participants: int
    listed: bool
    types: list[str]
    matched: bool
    policy: str
    same_hash: bool = True
    inconsistent: int = 0
    received: dict[str, float] = field(default_factory=dict)


INDEX = {"reader": 41, "writer": 42}  # above the 32 that a participant without peers asks


def configuration(domain: int, tag: str, role: str = "", peer: bool = False) -> str:
    """Return Cyclone's settings: on this machine alone, without multicast.

    Args:
        domain: its number.
        tag: only participants with the same one discover each other.
        role: "" for the ports that all participants of this machine ask; "reader" or "writer" for
            one that nobody asks unless a peer names it.
        peer: whether to name the reader's address and port.
    """
    text = CONFIGURATION.format(domain=domain, process=tag)
    if role:
        text = text.replace("Index>auto<", f"Index>{INDEX[role]}<")
    if peer:
        # The port of a participant follows from domain and index (DDSI-RTPS, 2022, 9.6.2).
        port = 7400 + 250 * domain + 10 + 2 * INDEX["reader"]
        text = text.replace('address="127.0.0.1"', f'address="127.0.0.1:{port}"')
    return text


def discover(case: str, seconds: float = 2.0) -> Discovered:
    """Run two processes and return what the second one discovered of the first.

    Args:
        case: one of `CASES`; in those of `DEFINITIONS` both ends have the same type name, and in
            "no coercion" the reader's policy demands the same definition as well.
        seconds: for how long the second process waits for a match.

    Raises:
        RuntimeError: one of the processes failed; the text is what it printed.
    """
    one_of("case", case, CASES)
    library()
    domain, tag = 1 + os.getpid() % 200, f"discovery-{os.getpid()}"
    hidden = case in ("no peer", "with a peer")
    first = configuration(domain, tag, "reader" if hidden else "")
    # Only the second process names the first: one direction is enough.
    second = configuration(
        domain + (case == "other domain"),
        tag,
        "writer" if hidden else "",
        peer=case == "with a peer",
    )
    processes = []
    for role, uri in (("reader", first), ("writer", second)):
        processes.append(
            subprocess.Popen(
                [sys.executable, "-m", __name__, role, case, str(seconds)],
                env=os.environ | {"CYCLONEDDS_URI": uri},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        if role == "reader" and processes[0].stdout.readline().strip() != "ready":  # type: ignore[union-attr]
            processes[0].kill()
            raise RuntimeError(processes[0].communicate()[1])
    reader, writer = processes
    try:
        out, error = writer.communicate(timeout=60)
    finally:
        # The end of its input ends the reader.
        taken, reader_error = reader.communicate(timeout=60)
    if writer.returncode or reader.returncode:
        raise RuntimeError(error or reader_error)
    return Discovered(**json.loads(out), received=json.loads(taken))


def _definition(case: str, role: str) -> Any:
    """Return the type that one of the two processes gives its topic."""
    from cyclonedds import idl
    from cyclonedds.idl import annotations, types

    if role == "reader" and case == "other type":
        return idl.make_idl_struct("Pose", "course.Pose", {"x": types.float64})
    fields = {"number": "int32"}
    if role == "reader":
        fields = DEFINITIONS.get(case, fields)
    kind = idl.make_idl_struct(
        "Joint", "course.Joint", {name: getattr(types, one) for name, one in fields.items()}
    )
    return annotations.appendable(kind) if case in APPENDABLE else kind


def _main(role: str, case: str, seconds: float) -> None:
    from cyclonedds import builtin
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import NAMES, policies, until

    member = DomainParticipant()
    kind = _definition(case, role)
    topic = Topic(member, "joints", kind)
    if role == "reader":
        # Transient local: a message that is written before the reader knows the writer is not lost.
        requested = policies(QoS(durability="transient_local"))
        if case == "no coercion":
            requested = Qos(Policy.TypeConsistency.DisallowTypeCoercion(), base=requested)
        end = DataReader(member, topic, requested)
        print("ready", flush=True)
        sys.stdin.read()
        taken = [vars(one) for one in end.take(10) if isinstance(one, kind)]
        fields = kind.__dataclass_fields__
        print(json.dumps({name: taken[0][name] for name in fields} if taken else {}))
        return
    offered = QoS(
        "best_effort" if case == "other policy" else "reliable", durability="transient_local"
    )
    people = builtin.BuiltinDataReader(member, builtin.BuiltinTopicDcpsParticipant)
    ends = builtin.BuiltinDataReader(member, builtin.BuiltinTopicDcpsSubscription)
    source = DataWriter(member, topic, policies(offered))

    def matched() -> bool:
        return bool(source.get_publication_matched_status().current_count)

    if until(matched, seconds):
        source.write(kind(number=7))
        # The reader has it in its queue before this process ends.
        source.wait_for_acks(round(1e9 * seconds))
    status = source.get_offered_incompatible_qos_status()
    mine = member.get_guid()
    listed = [one for one in ends.take(100) if one.topic_name == "joints"]
    discovered = Discovered(
        participants=sum(one.key != mine for one in people.take(100)),
        listed=bool(listed),
        types=sorted(one.type_name for one in listed),
        matched=matched(),
        policy=NAMES.get(status.last_policy_id, "") if status.total_count else "",
        same_hash=all(one.type_id == kind.__idl__.get_type_id() for one in listed),
        inconsistent=topic.get_inconsistent_topic_status().total_count,
    )
    # What was received is the reader's to report.
    shown = vars(discovered)
    del shown["received"]
    print(json.dumps(shown))


if __name__ == "__main__":
    _main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
