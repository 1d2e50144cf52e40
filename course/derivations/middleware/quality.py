"""Claims of chapter 10: who hears whom, what is kept, and what an end is told; on Cyclone DDS."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "d": Symbol("depth of the queue", 1.0, 20.0),
    "T": Symbol("period of the writer [s]"),
}


def late(**changed):
    """Return a quality of service that hands on the past."""
    from course.middleware.qos import QoS

    options: dict[str, Any] = {"durability": "transient_local", **changed}
    return QoS(**options)


def through(offered, requested, link, messages=2000, interval=1e-3):
    """Return the reader that messages went to on the bus, one every `interval` seconds."""
    from course.middleware.bus import Bus

    bus = Bus()
    writer = bus.node("writer").writer("x", offered)
    reader = bus.node("reader").reader("x", None, requested, link)
    for k in range(messages):
        bus.after(k * interval, writer.publish, k)
    # Long enough after the last message for every retransmission to end.
    bus.run(messages * interval + 100.0)
    return reader


@claim(
    "If one end is reliable and the other is best effort, the two do not connect.",
    "Of the four pairs only {silent:.0f} is silent: a best-effort writer with a reader that "
    "requests reliable. A reliable writer and a best-effort reader connect, without "
    "retransmission. On a link that loses {loss:.0%}, nothing was sent again and {lost:.0%} of the "
    "messages were missing.",
    source="OMG, Data Distribution Service 1.4, 2015, sec. 2.2.3.14",
)
def reliability_both_ways(result):
    from course.middleware.bus import Link
    from course.middleware.qos import ORDERS, QoS, compatible
    from course.oracles.cyclonedds import verdicts

    kinds = ORDERS["reliability"]
    # All four combinations, on a real DDS implementation; our own rule must agree with each.
    pairs = [(QoS(a), QoS(b)) for a in kinds for b in kinds]
    received = {
        (a.reliability, b.reliability): one.delivered == 1
        for (a, b), one in zip(pairs, verdicts(pairs), strict=True)
    }
    silent = [pair for pair, one in received.items() if not one]
    result.measure("silent", len(silent))
    reader = through(QoS(), QoS("best_effort"), Link(loss=result.input("loss", 0.2)))
    lost = result.measure("lost", reader.lost / 2000, 0.2)
    result.statement = "All pairs on Cyclone DDS; a link with losses on the bus."
    result.statement_holds(
        not received["reliable", "best_effort"] and not received["best_effort", "reliable"]
    )
    result.correction_holds(
        silent == [tuple(kinds)],
        reader.rounds == 0,
        bool(abs(lost - 0.2) < 0.05),
        all(
            one == (not compatible(*pair))
            for pair, one in zip(pairs, received.values(), strict=True)
        ),
    )


@claim(
    "Messages that arrive late are a sign of incompatible quality of service.",
    "A reader gets nothing at all from a writer with incompatible settings: of {sent:.0f} "
    "messages {came:.0f} arrived. Both ends received an event that names the incompatible policy, "
    "{policy}. Late "
    "messages waited in a queue, on the link or for an executor, or were stamped with a clock that "
    "is not synchronised.",
)
def mismatch_is_late(result):
    from course.middleware.bus import Link
    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import verdicts
    from course.oracles.qos_matrix import history

    # The one incompatible pair of reliabilities.
    pair = QoS("best_effort"), QoS()
    (report,) = verdicts([pair])
    sent = int(result.input("sent", 20))
    came = result.measure("came", len(history(*pair, sent)))
    result.measure("policy", report.writer)
    events = through(*pair, Link(), 3).bus.events
    result.statement = "On Cyclone DDS, and the events of the bus."
    result.statement_holds(came > 0)
    result.correction_holds(
        came == 0,
        report.writer == report.reader == "reliability",
        [one.end for one in events] == ["writer", "reader"],
        all(one.detail == (report.reader,) for one in events),
    )


def drawn(rng, least=None):
    """Return a random quality of service.

    It is at least as strong as another one in each policy with an order.

    Shared ownership, which has no order.
    """
    from course.middleware.qos import ORDERS, QoS

    def kind(name):
        # From the rank that is requested upwards: an offer at least as strong.
        low = ORDERS[name].index(getattr(least, name)) if least else 0
        return str(rng.choice(ORDERS[name][low:]))

    def seconds(name):
        largest = min(getattr(least, name), 1e3) if least else 30.0
        return float(rng.uniform(0.05, largest)) if least or rng.random() < 0.7 else math.inf

    times = ("deadline", "liveliness_lease_duration")
    return QoS(**{name: kind(name) for name in ORDERS}, **{name: seconds(name) for name in times})


@claim(
    "On ROS 2, a writer and a reader have discovered each other on one topic and use one type. "
    "Nothing else forbids the connection: no end was set to ignore the other, no security rule "
    "applies, and no partition (a label that both ends must share). In every ranked policy the "
    "writer offers at least what the reader requests. Then they are connected.",
    "All {tried:.0f} random pairs of this kind connected; {ordered:.0f} of the ranked policies of "
    "DDS were varied. A reader that ignores the writers of its own participant got {ignored:.0f} "
    "of {written:.0f} messages from one. For times, the shorter one is the stronger offer. "
    "Ownership (a DDS policy that ROS 2 does not use) has no ranking: both ends must be equal. "
    "History, depth and lifespan are not compared at all.",
    source="OMG, Data Distribution Service 1.4, 2015, sec. 2.2.3",
)
def stronger_offer(result):
    from course.middleware.qos import ORDERS, QoS, compatible
    from course.oracles.cyclonedds import own_messages, verdicts

    requests = [drawn(result.rng) for _ in range(int(result.input("tried", 24)))]
    offers = [
        replace(drawn(result.rng, least=one), depth=int(result.rng.integers(1, 20)))
        for one in requests
    ]
    # A real middleware decides; our rule is compared with it afterwards.
    observed = verdicts(list(zip(offers, requests, strict=True)))
    ends: list[dict[str, Any]] = [{n: k[at] for n, k in ORDERS.items()} for at in (0, -1)]
    result.measure("ordered", len(compatible(QoS(**ends[0]), QoS(**ends[1], deadline=0.1))))
    written = int(result.input("written", 3))
    plain, alone = (own_messages(written, ignore) for ignore in (False, True))
    result.measure("ignored", alone)
    unlike = [QoS(ownership=kind) for kind in ("shared", "exclusive")]
    mixed = verdicts([(unlike[0], unlike[1]), (unlike[1], unlike[0])])
    # The other way round a pair is silent as soon as one policy is really stronger.
    back = [bool(compatible(a, b)) for a, b in zip(requests, offers, strict=True)]
    result.statement = "Pairs by chance on Cyclone DDS."
    result.statement_holds(all(one.delivered == 1 for one in observed))
    result.correction_holds(
        not any(compatible(*pair) for pair in zip(offers, requests, strict=True)),
        not any(one.matched for one in mixed),
        all(back),
        plain == written,
        alone == 0,
    )


@claim(
    "With a volatile writer and a transient-local reader, only the messages from before are "
    "missing.",
    "Everything is missing. Volatile is the weaker offer, so the two do not connect: of {sent:.0f} "
    "messages that were written while both were running, {came:.0f} arrived. With the two policies "
    "swapped, all {back:.0f} arrived.",
)
def volatile_is_no_past(result):
    from course.middleware.qos import QoS, compatible
    from course.oracles.qos_matrix import history

    sent = int(result.input("sent", 8))
    came = result.measure("came", len(history(QoS(), late(), sent)))
    back = result.measure("back", len(history(late(), QoS(), sent)))
    result.statement = "On Cyclone DDS."
    result.statement_holds(came == sent)
    result.correction_holds(came == 0, back == sent, compatible(QoS(), late()) == ("durability",))


@claim(
    "A writer with a deadline is connected to a reader that requests one.",
    "A deadline promises the longest time between two messages, so the shorter one is the stronger "
    "offer. Having no deadline counts as an infinite one: it satisfied {met:.0f} of {asked:.0f} "
    "requests for a finite deadline. The lease of liveliness is compared in the same way.",
)
def deadline_for_deadline(result):
    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import own_messages, verdicts

    requested = result.rng.uniform(0.05, 20.0, int(result.input("asked", 10)))
    name = {"deadline": "deadline", "lease": "liveliness_lease_duration"}

    def received(policy, factors):
        def one(period: float) -> QoS:
            wish: dict[str, Any] = {name[policy]: float(period)}
            return QoS(**wish)

        pairs = [(one(f * t), one(t)) for f, t in zip(factors, requested, strict=True)]
        return [one.delivered == 1 for one in verdicts(pairs)]

    below, above = result.rng.uniform(0.3, 1.0, requested.size), result.rng.uniform(1.001, 1.1, 10)
    # Equality is the border case: it must match.
    below[0] = 1.0
    inside, outside = received("deadline", below), received("deadline", above)
    met = result.measure("met", sum(received("deadline", np.full(requested.size, math.inf))))
    # A shorter deadline, and another policy that fails.
    pairs = [
        (QoS("best_effort", deadline=0.5 * float(t)), QoS(deadline=float(t))) for t in requested
    ]
    other = [one.delivered == 1 for one in verdicts(pairs)]
    result.statement = "Deadlines and leases by chance on Cyclone DDS."
    result.statement_holds(
        all(outside),
        only_if="the writer's deadline is at most as long as the reader's, all other policies "
        "are compatible, and nothing else forbids the connection",
        inside=inside,
        # Chosen to break it: a reader that ignores the writers of its own participant.
        outside=[*outside, *other, own_messages(1, True) == 1],
    )
    result.correction_holds(
        met == 0,
        all(received("lease", below)),
        not any(received("lease", above)),
        not any(outside),
        not any(other),
    )


@claim(
    "The event about incompatible settings names all policies that fail.",
    "When {failing:.0f} policies were incompatible, Cyclone DDS named {named:.0f}, the same one at "
    "both ends. If you fix that one, the next one appears. Comparing the two profiles shows all of "
    "them.",
)
def event_names_all(result):
    from course.middleware.qos import QoS, compatible
    from course.oracles.cyclonedds import verdicts

    offered = QoS("best_effort")
    requested = QoS(durability="transient_local", deadline=0.1, liveliness="manual_by_topic")
    failing, named = compatible(offered, requested), []
    while compatible(offered, requested):
        (report,) = verdicts([(offered, requested)])
        named.append({report.reader, report.writer})
        if report.writer != report.reader or report.delivered:
            break
        # Fix the one policy that was named and ask again.
        offered = replace(offered, **{report.reader: getattr(requested, report.reader)})
    result.measure("failing", len(failing))
    one = result.measure("named", len(named[0]))
    result.statement = "On Cyclone DDS, mended policy by policy."
    result.statement_holds(len(failing) == one)
    result.correction_holds(len(named) == len(failing), set().union(*named) == set(failing))


@claim(
    "On a reliable topic every message arrives.",
    "Reliable means that messages which the network loses are sent again, as long as the writer "
    "stores them. It does not protect a queue: of {burst:.0f} messages at once, a depth of "
    "{depth:.0f} kept {kept:.0f}, with either reliability. On a link that loses {loss:.0%}, a "
    "reliable writer of depth 1 lost {gone:.0%} when a repair took longer than its period, and "
    "none when it was faster. A writer that keeps all messages lost none. But if the link is down "
    "for longer than the lease, the writer drops the reader, and a volatile topic does not send it "
    "again what the reader missed.",
    source="OMG, Data Distribution Service 1.4, 2015, sec. 2.2.3.18",
)
def reliable_arrives(result):
    from course.middleware.bus import Link
    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import Topic, participant, take
    from course.oracles.qos_matrix import history

    burst, depth = int(result.input("burst", 8)), int(result.input("depth", 3))
    retained = result.measure("kept", len(history(QoS(), QoS(depth=depth), burst)))
    # The control: best effort with the same depth keeps the same number.
    best = history(QoS("best_effort"), QoS("best_effort", depth=depth), burst)
    link = Link(delay=0.01, loss=result.input("loss", 0.2))
    short, long = (
        through(replace(QoS(depth=1), history=kind), QoS(history="keep_all"), link)
        for kind in ("keep_last", "keep_all")
    )
    missing = result.measure("gone", short.lost / 2000, 0.2)
    quick = through(QoS(depth=1), QoS(history="keep_all"), replace(link, delay=1e-4))

    def all_of(n, writer, reader):
        return history(QoS(depth=int(writer)), QoS(depth=int(reader)), int(n)) == list(range(n))

    n = result.rng.integers(2, 15, 8)
    inside = [
        all_of(k, k + a, k + b)
        for k, (a, b) in zip(n, result.rng.integers(0, 3, (8, 2)), strict=True)
    ]
    # One place too few at the reader.
    outside = [all_of(k, k, k - 1) for k in n]
    # Chosen to break it: nine packets of ten are lost and the others overtake one another; and two
    # that have discovered each other, but disagree about another policy.
    kept = QoS(history="keep_all")
    awful = through(kept, kept, replace(link, jitter=0.05, loss=0.9), 300)
    outside.append(history(QoS(), QoS(deadline=0.1), 3) == [0, 1, 2])

    def interrupted(missed):
        """Return whether all messages arrive although the writer loses its reader for a while.

        Deleting the reader and creating another one does to the writer what a lease does that ends
        during an outage: it forgets the reader and discovers it again.
        """
        keep_all, received = QoS(history="keep_all"), list[int]()
        with participant() as member:
            topic = Topic(member)
            writer = topic.writer(keep_all)
            for numbers in (range(3), range(3, 3 + missed), range(3 + missed, 6 + missed)):
                reader = topic.reader(keep_all) if 3 not in numbers else None
                topic.write(writer, *numbers)
                received += take(reader) if reader else []
                del reader
        return received == list(range(6 + missed))

    # Chosen to break it: the reader is lost and found again, with queues of any length.
    outside += [interrupted(missed) for missed in (1, 5)]
    result.statement = "Bursts on Cyclone DDS, whose reader looks afterwards; losses on the bus."
    result.statement_holds(
        retained == burst,
        only_if="both ends are compatible and stay alive, the writer has discovered the reader "
        "before it sends, and no outage is longer than the lease, so that it does not lose the "
        "reader again. Neither queue overflows, and no lifespan ends",
        inside=[*inside, long.lost == 0, awful.lost == 0 and awful.received == 300],
        outside=[*outside, history(QoS(), QoS(), 3, late=True) == [0, 1, 2]],
    )
    result.correction_holds(
        len(best) == retained == depth,
        missing > 0.1,
        not any(outside),
        long.rounds > 0,
        quick.lost == 0,
    )


def ages(depth, ratio, reliability="reliable", reads=400, interval=0.01):
    """Return the age of samples that a slow reader takes from a full queue on the bus.

    It is in periods of the writer.
    """
    from course.middleware.bus import Bus
    from course.middleware.qos import QoS

    bus, observed = Bus(), list[float]()
    qos = QoS(reliability, depth=depth)
    out = bus.node("writer").writer("x", qos)
    reader = bus.node("reader").reader("x", None, qos)

    def view():
        if sample := reader.take():
            observed.append((bus.now - sample.stamp) / interval)

    bus.node("clock").timer(interval, lambda: (out.publish(0), None)[1])
    # Clocks of their own with a ratio that is no simple fraction: the phase drifts over the period.
    bus.node("other clock").timer(ratio * interval, view, phase=0.5)
    bus.run(reads * ratio * interval)
    # The first samples come before the queue is full.
    return np.array(observed)[3 * depth :]


@claim(
    "Best effort drops old images for a slow reader, so that none of them queues up.",
    "It is the depth that does this, with either reliability. A reader with a full queue of depth "
    "d takes messages that are between (d - 1)*T and d*T old, on average {formula} if reader and "
    "writer run on clocks of their own. Best effort with depth {depth:.0f} was {deep:.0f} writer "
    "periods behind; reliable with depth 1 was {newest:.0f} behind.",
    ask=(
        "A slow subscriber takes one message at a time, the oldest of a full queue of depth d, at "
        "random moments. Its writer has the period T. What is the mean age of the message that it "
        "takes?",
        "A, age = (d - 1/2)*T",
        {
            "(d - 1)*T": "That is the smallest age, just after a message has arrived.",
            "d*T": "That is the largest age, just before the next message arrives.",
            "d*T/2": "The queue is full each time, not half full.",
            "T/2": "That is for depth 1.",
        },
    ),
)
def best_effort_is_fresh(result):
    import sympy

    from course.middleware.qos import ORDERS
    from course.oracles.slow_reader import queue_ages

    d, T, w = sympy.symbols("d T w", positive=True)
    result.formula = sympy.factor(sympy.integrate((d - 1) * T + w, (w, 0, T)) / T)
    depth = int(result.input("depth", 10))
    deep = result.measure("deep", queue_ages(depth, 3, 20, "best_effort").ages[-1])
    newest = result.measure("newest", queue_ages(1, 3, 20, "reliable").ages[-1])
    # The two reliabilities in turn: depth, not reliability, must decide the age.
    drawn = zip(result.rng.integers(1, 12, 6), result.rng.uniform(1.3, 4.0, 6), strict=True)
    observed = [
        (int(k), ages(int(k), float(r), ORDERS["reliability"][int(k) % 2])) for k, r in drawn
    ]
    result.statement = "On Cyclone DDS in turns, and on the bus with clocks of their own."
    result.statement_holds(deep == 0)
    result.correction_holds(
        deep == depth - 1,
        newest == 0,
        all(k - 1 - 1e-6 < a.min() and a.max() < k + 1e-6 for k, a in observed),
        all(abs(a.mean() - float(result.formula.subs({d: k, T: 1}))) < 0.1 for k, a in observed),
    )


def still_there(lifespan=math.inf, dies=False):
    """Return whether a reader that joins a second late gets the last sample, on the bus."""
    from course.middleware.bus import Bus

    bus = Bus()
    writer = bus.node("monitor").writer("x", late(depth=1, lifespan=lifespan))
    writer.publish("safe")
    bus.run(1.0)
    if dies:
        writer.die()
    reader = bus.node("screen").reader("x", None, late())
    bus.run(2.0)
    return len(reader) > 0


def newer_first():
    """Return what a late reader of depth 1 keeps, on the bus, where two writers have written."""
    from course.middleware.bus import Bus

    bus = Bus()
    writers = [bus.node(name).writer("x", late(depth=1)) for name in ("first", "second")]
    # The writer that matches first wrote last.
    for writer, value in zip(writers[::-1], ("old", "new"), strict=True):
        writer.publish(value)
        bus.run(bus.now + 1.0)
    reader = bus.node("screen").reader("x", None, late(depth=1))
    bus.run(bus.now + 1.0)
    stored = reader.take()
    assert stored is not None
    return stored.value


@claim(
    "With transient-local durability, a reader that joins late gets the last message.",
    "Both ends have to request it, and both have to be reliable: on Cyclone DDS, {given:.0f} of "
    "the four pairs of durabilities delivered old messages, and {reliable:.0f} of the four pairs "
    "of reliabilities. A message is gone when its lifespan has ended or when its writer no longer "
    "exists. Where a topic has several writers, the reader gets the last message of each. With "
    "depth 1 it stores whichever arrives last, which may be the oldest of them.",
)
def late_joiner_gets_the_last(result):
    from course.middleware.qos import ORDERS
    from course.oracles.qos_matrix import history

    def gets(offered, requested):
        return history(offered, requested, 4, late=True) == [3]

    kinds = {name: ORDERS[name][:2] for name in ("durability", "reliability")}
    last = late(depth=1)
    # Each policy varied on its own, with the others at their strongest.
    given = {
        name: [gets(late(**{"depth": 1, name: a}), late(**{name: b})) for a in some for b in some]
        for name, some in kinds.items()
    }
    result.measure("given", sum(given["durability"]))
    result.measure("reliable", sum(given["reliability"]))
    result.statement = "Pairs on Cyclone DDS; lifespan and the writer's end on the bus."
    result.statement_holds(
        all(given["reliability"]),
        cases=True,
        only_if="both ends are transient-local, reliable and otherwise compatible, the message's "
        "lifespan has not ended, and its writer is alive and the only one of the topic",
        inside=[gets(last, late(depth=n)) for n in (1, 2, 10)] + [still_there()],
        outside=[
            *given["durability"][:3],
            *given["reliability"][:3],
            gets(last, late(deadline=0.1)),
            still_there(lifespan=0.5),
            still_there(dies=True),
            # Chosen to break it: two writers.
            newer_first() == "new",
        ],
    )
    result.correction_holds(
        sum(given["durability"]) == 1,
        sum(given["reliability"]) == 1,
        not still_there(lifespan=0.5),
        not still_there(dies=True),
    )


@claim(
    "A transient-local writer of depth d gives a late reader its last d messages.",
    "In DDS another policy decides this, the durability service. With a writer's depth of "
    "{depth:.0f}, Cyclone DDS delivered {plain:.0f} message, because its durability service stores "
    "that many by default. ROS 2's layer for Cyclone sets the durability service's depth to the "
    "writer's depth. The reader's own depth limits the number once more.",
    source="Eclipse Cyclone DDS, issues 1616 and 1782; rmw_cyclonedds_cpp, rmw_node.cpp, Foxy 2020 "
    "and later",
)
def late_joiner_depth(result):
    from course.oracles.qos_matrix import history

    def handed(depth, service, reader=20, keyed=False, **requested):
        return len(
            history(
                late(depth=int(depth)),
                late(depth=reader, **requested),
                12,
                late=True,
                kept_for_late=int(service),
                keyed=keyed,
            )
        )

    depth = int(result.input("depth", 3))
    plain = result.measure("plain", handed(depth, 0))
    depths = result.rng.integers(2, 10, 8)
    result.statement = "Late readers on Cyclone DDS, after 12 samples; lifespan on the bus."
    result.statement_holds(
        plain == depth,
        only_if="its durability service has depth d as well, the reader at least depth d, both "
        "ends are reliable and transient-local, no message's lifespan has run out, and the topic "
        "has no key (with a key, each of its values has a depth of its own)",
        inside=[handed(k, k) == k for k in depths],
        # One less in the durability service, or one less at the reader.
        outside=[handed(k, k - 1) == k for k in depths]
        + [handed(k, k, int(k) - 1) == k for k in depths]
        # Chosen to break it: a reader that wants no past, and one that does not acknowledge.
        + [
            handed(3, 3, **one) == 3
            for one in ({"durability": "volatile"}, {"reliability": "best_effort"})
        ]
        # Chosen to break it: a topic with a key, and a message that has outlived its lifespan.
        + [handed(3, 3, keyed=True) == 3, still_there(lifespan=0.5)],
    )
    result.correction_holds(plain == 1, handed(5, 5, reader=2) == 2)


def usable(lifespan, delay, seconds):
    """Return whether a sample can still be taken so long after its arrival, on the bus [s]."""
    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    bus = Bus()
    writer = bus.node("a").writer("x", QoS(lifespan=lifespan))
    reader = bus.node("b").reader("x", None, QoS(), Link(delay=delay))
    writer.publish(0)
    bus.run(delay + seconds)
    return reader.take() is not None


@claim(
    "A lifespan guarantees that no message older than it is delivered.",
    "In the standard, the lifespan counts from the timestamp, as on the bus here: with a lifespan "
    "of {life_ms:.0f} ms and {link_ms:.0f} ms on the link, a message could still be taken "
    "{left_ms:.0f} ms after its arrival. Cyclone DDS did not use the timestamp, which the standard "
    "allows where clocks may disagree: of {sent:.0f} messages stamped {ago_s:.0f} s ago, with a "
    "lifespan of {life_s:.0f} s, {came:.0f} arrived. If you need a limit on the age, check the "
    "timestamp yourself.",
    source="OMG, Data Distribution Service 1.4, 2015, sec. 2.2.3.16; Eclipse Cyclone DDS 11",
)
def lifespan_bounds_age(result):
    import time

    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import Topic, participant, take

    life, link = (1e-3 * result.input(*x) for x in (("life_ms", 100), ("link_ms", 60)))
    # In steps of 1 ms, hence the tolerance of 1.5 ms below.
    waits = [1e-3 * k for k in range(120) if usable(life, link, 1e-3 * k)]
    remaining = result.measure("left_ms", 1e3 * max(waits), 0.05)
    ago, lasts = result.input("ago_s", 60), result.input("life_s", 30)
    with participant() as member:
        topic = Topic(member)
        writer, reader = topic.writer(QoS(lifespan=lasts)), topic.reader(QoS())
        topic.write(writer, *range(int(result.input("sent", 3))), stamp=time.time() - ago)
        came = result.measure("came", len(take(reader)))
    result.statement = "Times of taking on the bus; early stamps on Cyclone DDS, in one process."
    result.statement_holds(came == 0)
    result.correction_holds(came == 3, 1e3 * (life - link) - 1.5 < remaining < 1e3 * (life - link))


def missed_on_the_bus(gap, deadline):
    """Return events of missed deadlines at the writer and at the reader, of one gap on the bus."""
    from course.middleware.bus import Bus
    from course.middleware.qos import QoS

    bus = Bus()
    writer = bus.node("a").writer("x", QoS(deadline=deadline))
    bus.node("b").reader("x", None, QoS(deadline=deadline))
    for k in range(2):
        bus.after(k * gap, writer.publish, k)
    bus.run(gap)
    return [sum(one.end == end for one in bus.events) for end in ("writer", "reader")]


@claim(
    "A missed deadline raises one event, and a dead camera raises it.",
    "It raises one event for each deadline that passes in the gap: a gap of {gap_ms:.0f} ms with a "
    "deadline of {deadline_ms:.0f} ms raised {events:.0f} at each end. The clock starts with the "
    "first message, and stops when Cyclone DDS knows that the writer is gone. A writer that never "
    "wrote raised {never:.0f} events, one that was closed {closed:.0f}.",
)
def deadline_is_one_event(result):
    import time

    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import Topic, participant, until
    from course.oracles.qos_matrix import missed_undisturbed

    gap = 1e-3 * result.input("gap_ms", 120)
    deadline = 1e-3 * result.input("deadline_ms", 50)

    events = result.measure("events", missed_on_the_bus(gap, deadline)[1])
    timed = QoS(deadline=0.02)

    def count_of(end):
        return end.get_requested_deadline_missed_status().total_count

    def pair(member):
        """Return a writer and a reader with a deadline, on a topic of their own."""
        topic = Topic(member)
        return topic, topic.writer(timed), topic.reader(timed)

    # A third pair stays connected after its one message. Once it has counted several events, the
    # two others have had the time to count theirs.
    with participant() as member:
        _, _silent, unwritten = pair(member)
        open_topic, stays, witness = pair(member)
        for _ in range(100):
            topic, writer, abandoned = pair(member)
            start = time.monotonic()
            topic.write(writer, 1)
            del writer
            disconnected = abandoned.get_subscription_matched_status().current_count == 0
            # Only a writer that closes within its deadline shows that closing stops the clock.
            if disconnected and time.monotonic() - start < timed.deadline:
                break
        else:
            raise TimeoutError("the machine stalled whenever a writer was to be closed in time")
        open_topic.write(stays, 1)
        until(lambda: count_of(witness) >= 5)
        never = result.measure("never", count_of(unwritten))
        closed = result.measure("closed", count_of(abandoned))
        witnessed = count_of(witness)
    real = missed_undisturbed(deadline, gap, 2)
    draws = result.rng.uniform((0.05, 0.01), (0.5, 0.049), (20, 2))
    result.statement = "Gaps on the bus, and those that there really were on Cyclone DDS."
    result.statement_holds(events == 1)
    result.correction_holds(
        # One event for each whole deadline in the gap, at both ends.
        all(missed_on_the_bus(float(g), float(d)) == [math.floor(g / d)] * 2 for g, d in draws),
        never == closed == 0 and witnessed >= 5,
        # Real time: bounds from the clock, which coincide unless the machine was disturbed.
        real.least == real.offered == real.requested == real.at_most,
    )
