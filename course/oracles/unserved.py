"""Cyclone DDS asked about a service whose reply does not come: nobody serves it, or another reason.

A service of ROS 2 on DDS is two topics, one of requests and one of replies. To DDS a request is a
message like any other: it is written without an error whether or not a server exists. What tells
the causes apart is discovery: is a reader of the requests listed, and is it matched?
Nothing leaves the machine, see `course.oracles.cyclonedds`.
"""

from __future__ import annotations

import itertools
import os
from dataclasses import dataclass
from typing import Any

from course.check import one_of
from course.middleware.qos import QoS
from course.oracles.cyclonedds import NAMES, participant, policies, until

CASES = ("answers", "no server", "other type", "other policy", "busy")
CAUSES = {
    "answers": "",
    "not discovered": "no server is discovered: start it, or compare service name and domain",
    "type mismatch": "a server is listed but not matched: compare the names and hashes of types",
    "policy mismatch": "a server is listed but not matched: compare the quality of service",
    "server busy": "a server is matched and has not replied: its callback waits, runs or failed",
}
_numbers = itertools.count()


@dataclass(frozen=True)
class Requested:
    """What a client observed after one request.

    Attributes:
        listed: whether discovery lists a reader of the requests.
        matched: whether the client's writer is matched with it.
        policy: the policy that the event "offered incompatible QoS" names, or "".
        replied: whether the reply came in time.
    """

    listed: bool
    matched: bool
    policy: str
    replied: bool

    @property
    def cause(self) -> str:
        """Why there is no reply: a key of `CAUSES`."""
        if self.replied:
            return "answers"
        if not self.listed:
            return "not discovered"
        if not self.matched:
            types = self.policy in ("", "type_consistency")
            return "type mismatch" if types else "policy mismatch"
        return "server busy"


def request(case: str, seconds: float = 0.5) -> Requested:
    """Send a request, which raises no error in any case, and return what the client can observe.

    Args:
        case: one of `CASES`; "busy" is a server that does not get round to its callback.
        seconds: for how long the client waits for a match, and again for the reply.
    """
    one_of("case", case, CASES)
    with participant() as client, participant() as server:
        from cyclonedds import builtin, idl
        from cyclonedds.idl.types import float64, int32
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        name = f"plan_{os.getpid()}_{next(_numbers)}"
        kind: Any = idl.make_idl_struct("Plan", "course.Plan", {"number": int32})
        other: Any = idl.make_idl_struct("Pose", "course.PlanPose", {"x": float64})
        qos = policies(QoS())
        requests = DataWriter(client, Topic(client, f"{name}/request", kind), qos)
        replies = DataReader(client, Topic(client, f"{name}/reply", kind), qos)
        ends = builtin.BuiltinDataReader(client, builtin.BuiltinTopicDcpsSubscription)
        served = answers = None
        if case != "no server":
            serves = other if case == "other type" else kind
            # A writer that is reliable but volatile, and a reader that requests more.
            wants = QoS(durability="transient_local") if case == "other policy" else QoS()
            served = DataReader(server, Topic(server, f"{name}/request", serves), policies(wants))
            answers = DataWriter(server, Topic(server, f"{name}/reply", kind), qos)

        def matched() -> bool:
            return bool(requests.get_publication_matched_status().current_count)

        until(matched, seconds if case != "no server" else 0.2)
        requests.write(kind(number=1))  # an error would be raised here
        if case == "answers" and served is not None and answers is not None:
            until(lambda: bool(served.read(1)), seconds)
            for one in served.take(1):
                answers.write(kind(number=one.number + 1))
        replied = until(lambda: bool(replies.read(1)), seconds)
        status = requests.get_offered_incompatible_qos_status()
        return Requested(
            listed=any(one.topic_name == f"{name}/request" for one in ends.take(100)),
            matched=matched(),
            policy=NAMES.get(status.last_policy_id, "") if status.total_count else "",
            replied=replied,
        )
