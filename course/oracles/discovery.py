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
from dataclasses import dataclass

from course.check import one_of
from course.oracles.cyclonedds import CONFIGURATION, library

CASES = ("works", "other domain", "other type", "other policy", "no peer", "with a peer")


@dataclass(frozen=True)
class Discovered:
    """What the second process saw.

    Attributes:
        participants: how many participants it discovered, other than itself.
        listed: whether the built-in topics list a reader of the topic's name.
        types: the type names of these readers.
        matched: whether its writer is matched with a reader.
        policy: the policy that the event "offered incompatible QoS" names, or "".
    """

    participants: int
    listed: bool
    types: list[str]
    matched: bool
    policy: str


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
        case: one of `CASES`.
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
        reader.communicate(timeout=60)
    if writer.returncode:
        raise RuntimeError(error)
    return Discovered(**json.loads(out))


def _main(role: str, case: str, seconds: float) -> None:
    from cyclonedds import builtin, idl
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl.types import float64, int32
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import NAMES, policies, until

    member = DomainParticipant()
    other = case == "other type" and role == "reader"
    kind = (
        idl.make_idl_struct("Pose", "course.Pose", {"x": float64})
        if other
        else idl.make_idl_struct("Joint", "course.Joint", {"number": int32})
    )
    topic = Topic(member, "joints", kind)
    if role == "reader":
        end = DataReader(member, topic, policies(QoS()))
        print("ready", flush=True)
        sys.stdin.read()
        del end
        return
    offered = QoS("best_effort") if case == "other policy" else QoS()
    people = builtin.BuiltinDataReader(member, builtin.BuiltinTopicDcpsParticipant)
    ends = builtin.BuiltinDataReader(member, builtin.BuiltinTopicDcpsSubscription)
    source = DataWriter(member, topic, policies(offered))

    def matched() -> bool:
        return bool(source.get_publication_matched_status().current_count)

    until(matched, seconds)
    status = source.get_offered_incompatible_qos_status()
    mine = member.get_guid()
    types = [one.type_name for one in ends.take(100) if one.topic_name == "joints"]
    discovered = Discovered(
        participants=sum(one.key != mine for one in people.take(100)),
        listed=bool(types),
        types=sorted(types),
        matched=matched(),
        policy=NAMES.get(status.last_policy_id, "") if status.total_count else "",
    )
    print(json.dumps(vars(discovered)))


if __name__ == "__main__":
    _main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
