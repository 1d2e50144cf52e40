"""Quality of service: what one end of a topic offers or asks for, and which pairs are heard.

A writer offers, a reader requests. In each policy with an order the offer has to be at least as
strong as the request: one that is too weak in a single policy makes the pair silent. What is kept
and for how long (history, depth, lifespan) is each end's own affair. Source: OMG, Data Distribution
Service 1.4, 2015, sec. 2.2.3; the names are those of ROS 2 (rmw/types.h, qos_overrides).
"""

import math
from dataclasses import dataclass
from typing import Any

from course.check import count, invalid, one_of, positive

# Weakest first: an offer satisfies a request for the same and for all before it.
ORDERS = {
    "reliability": ("best_effort", "reliable"),
    "durability": ("volatile", "transient_local", "transient", "persistent"),
    "liveliness": ("automatic", "manual_by_participant", "manual_by_topic"),
    "destination_order": ("by_reception_timestamp", "by_source_timestamp"),
}
# No order: both ends have to say the same.
SAME = {"ownership": ("shared", "exclusive")}
# The offer has to be at most the request. What each belongs to: DDS knows lease and kind of
# liveliness as one policy.
TIMES = {"deadline": "deadline", "liveliness_lease_duration": "liveliness"}


@dataclass(frozen=True)
class QoS:
    """One end's policies; the defaults are ROS 2's.

    Attributes:
        reliability: "reliable": what is lost is sent again; "best_effort": it is not.
        history: "keep_last": the last `depth` samples; "keep_all": each, until it is taken.
        depth: samples that are stored; ignored under "keep_all".
        durability: what a writer keeps for readers that come later. "volatile": nothing;
            "transient_local": its history, as long as it lives; "transient" and "persistent" (not
            in ROS 2) in a service beyond it.
        deadline: longest time between two samples [s]; infinite: none.
        lifespan: age from which on a sample is thrown away [s]; of writers.
        liveliness: who asserts that a writer is alive. "automatic": the middleware;
            "manual_by_participant" (not in ROS 2): any writer of its process; "manual_by_topic":
            the writer, by publishing or asserting.
        liveliness_lease_duration: time without a word after which it counts as dead [s].
        ownership: "shared": samples of all writers arrive; "exclusive": only those of the strongest
            writer (not in ROS 2).
        destination_order: "by_reception_timestamp" or "by_source_timestamp" (not in ROS 2).
    """

    reliability: str = "reliable"
    history: str = "keep_last"
    depth: int = 10
    durability: str = "volatile"
    deadline: float = math.inf
    lifespan: float = math.inf
    liveliness: str = "automatic"
    liveliness_lease_duration: float = math.inf
    ownership: str = "shared"
    destination_order: str = "by_reception_timestamp"

    def __post_init__(self) -> None:
        for name, kinds in (ORDERS | SAME).items():
            one_of(name, getattr(self, name), kinds)
        one_of("history", self.history, ("keep_last", "keep_all"))
        count("depth", self.depth, 1)
        for name in (*TIMES, "lifespan"):
            _period(name, getattr(self, name))

    @property
    def history_depth(self) -> float:
        """How many samples a history holds at most, infinite under "keep_all"."""
        return math.inf if self.history == "keep_all" else self.depth


def compatible(offered: QoS, requested: QoS) -> tuple[str, ...]:
    """Return the policies for which a reader that requests hears nothing of a writer that offers.

    Args:
        offered: of the writer.
        requested: of the reader.

    Returns:
        Names of policies in the order of `QoS`, "liveliness" for its kind and its lease; none: the
        pair is heard.
    """
    ends = offered, requested
    result = set()
    # Ordered policies: the offer must be at least as strong as the request (DDS request-offered).
    for name, order in ORDERS.items():
        offer, request = (order.index(getattr(end, name)) for end in ends)
        if offer < request:
            result.add(name)
    for name, policy in TIMES.items():
        if getattr(offered, name) > getattr(requested, name):
            result.add(policy)
    result |= {name for name in SAME if getattr(offered, name) != getattr(requested, name)}
    return tuple(name for name in QoS.__dataclass_fields__ if name in result)


def _period(name: str, value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise invalid(name, value, "a positive number, infinite for none [s]")
    return math.inf if value == math.inf else positive(name, value, unit="s")
