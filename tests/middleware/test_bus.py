"""The bus against closed forms, rules of the standard counted by hand, and what may never be."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.middleware.bus import ActionClient, Bus, Link
from course.middleware.qos import QoS
from tests.budget import examples

KEEP = QoS(history="keep_all")
LATE = QoS(durability="transient_local", depth=3)
MANY = QoS(durability="transient_local")


def ends(offered=KEEP, requested=None, link=None, seed=0, function=None):
    bus = Bus(seed)
    writer = bus.node("a").writer("x", offered)
    return bus, writer, bus.node("b").reader("x", function, requested or offered, link or Link())


def taken(reader):
    return [sample.value for sample in iter(reader.take, None)]


def kinds(bus, side):
    return [(e.kind, round(e.time, 9)) for e in bus.events if e.end == side]


# --- The link -------------------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize(("n", "p"), [(1, 0.05), (20, 0.01), (627, 1e-4)])
def test_a_message_of_n_fragments_is_lost_with_any_of_them(n, p):
    count, size = 20_000, 1472 * n
    bus, writer, reader = ends(QoS("best_effort", "keep_all"), link=Link(loss=p))
    for _ in range(count):
        writer.publish(0, size)
    bus.run(1.0)
    share = 1.0 - (1.0 - p) ** n
    assert reader.lost + reader.received == count
    assert reader.lost / count == pytest.approx(share, abs=4 * math.sqrt(share / count))


@pytest.mark.slow
@pytest.mark.parametrize(("n", "p"), [(1, 0.3), (627, 1e-3), (50, 0.2)])
def test_rounds_until_every_fragment_has_come_and_the_time_they_take(n, p):
    """The greatest of n geometric numbers: the sum over r of 1 - (1 - p^r)^n."""
    rounds = sum(1.0 - (1.0 - p**r) ** n for r in range(200))
    link = Link(delay=0.001, loss=p, nack=0.01)
    late: list[float] = []
    bus: Bus
    bus, writer, reader = ends(link=link, function=lambda s: late.append(bus.now - s.stamp))
    for k in range(4000):
        bus.push(k * 10**9, 1, writer.publish, k, 1472 * n)
    bus.run(5000.0)
    assert len(late) == 4000
    assert 1.0 + reader.rounds / 4000 == pytest.approx(rounds, rel=0.03)
    # Each round but the last: there, back, and the wait.
    assert np.mean(late) == pytest.approx(0.001 + 0.012 * (rounds - 1.0), rel=0.06)


def test_a_wire_carries_one_message_after_the_other():
    link, observed = Link(delay=0.002, rate=1e6), list[tuple[str, float]]()
    bus: Bus
    bus, writer, _ = ends(link=link, function=lambda s: observed.append((s.value, bus.now)))
    other = bus.node("c").writer("torque", KEEP)
    bus.node("d").reader("torque", lambda s: observed.append((s.value, bus.now)), KEEP, link)
    writer.publish("image", 500_000)
    other.publish("torque", 100)
    bus.run(1.0)
    assert [name for name, _ in observed] == ["image", "torque"]
    assert [t for _, t in observed] == pytest.approx([0.502, 0.5021])


LINKS = st.builds(
    Link,
    delay=st.sampled_from([0.0, 0.01]),
    jitter=st.sampled_from([0.0, 0.05]),
    loss=st.sampled_from([0.0, 0.1, 0.5]),
    fragment=st.sampled_from([100, 1472]),
    rate=st.sampled_from([math.inf, 1e4]),
    nack=st.sampled_from([0.0, 0.02]),
)


@examples(60)
@given(
    link=LINKS,
    seed=st.integers(0, 99),
    reliable=st.booleans(),
    depth=st.integers(1, 8),
    waits=st.lists(st.integers(0, 30), min_size=1, max_size=60),
)
def test_no_message_comes_twice_or_out_of_order_or_vanishes(link, seed, reliable, depth, waits):
    kind = "reliable" if reliable else "best_effort"

    def once(history):
        qos, observed = QoS(kind, history, depth), list[Any]()
        bus, writer, reader = ends(qos, QoS(kind, "keep_all"), link, seed, observed.append)
        at = 0
        for k, wait in enumerate(waits):
            at += wait * 10**6
            bus.push(at, 1, writer.publish, k, 300)
        bus.run(1e4)
        return observed, reader, bus.events

    for history in ("keep_last", "keep_all"):
        observed, reader, events = once(history)
        again = once(history)
        assert (observed, events) == (again[0], again[2])  # by its seed alone
        assert all(a.number < b.number for a, b in pairwise(observed))
        assert len(observed) == reader.received
        assert reader.received + reader.lost == len(waits)
        lost = {e.detail for e in events if e.kind == "lost"}
        assert lost.isdisjoint(s.number for s in observed)
        if history == "keep_all" and reliable:
            assert not lost
    if link.loss and len(waits) > 30 and link.loss * len(waits) > 20 and not reliable:
        assert lost


# --- What is kept ---------------------------------------------------------------------------------


@examples(40)
@given(depth=st.integers(1, 6), script=st.lists(st.booleans(), max_size=60))
def test_keep_last_drops_the_oldest(depth, script):
    bus, writer, reader = ends(QoS(depth=depth))
    model: list[int] = []
    dropped = 0
    for k, publishes in enumerate(script):
        if publishes:
            writer.publish(k)
            model.append(k)
            dropped += len(model) > depth
            model = model[-depth:]
        else:
            bus.run(0.0)
            sample = reader.take()
            assert (sample and sample.value) == (model.pop(0) if model else None)
    bus.run(0.0)
    assert (taken(reader), reader.dropped) == (model, dropped)


def test_reliable_and_keep_last_still_loses_what_was_overwritten_before_it_got_through():
    observed: list[Any] = []
    bus, writer, reader = ends(QoS(depth=1), link=Link(0.01, loss=0.5), function=observed.append)
    for k in range(200):
        bus.push(k * 10**7, 1, writer.publish, k)
    bus.run(100.0)
    assert reader.lost > 50
    assert observed[-1].value == 199  # the last one stays until it is through


def test_a_sample_lives_from_its_stamp_on_not_from_its_arrival():
    offered = QoS(lifespan=0.1)
    bus, writer, reader = ends(offered, link=Link(delay=0.06))
    writer.publish("a")
    bus.run(0.099)
    assert len(reader) == 1
    bus.run(0.1)
    assert (reader.take(), reader.expired) == (None, 1)
    slow = bus.node("c").reader("x", link=Link(delay=0.1))
    writer.publish("b")
    bus.run(1.0)
    assert (slow.received, slow.expired, len(slow)) == (1, 1, 0)


@pytest.mark.parametrize(
    ("offered", "requested", "gets"),
    [
        (LATE, MANY, [2, 3, 4, 5]),
        (LATE, QoS(), [5]),
        (QoS(), QoS(), [5]),
        (QoS(depth=9, durability="transient_local", lifespan=0.25), MANY, [3, 4, 5]),
        (LATE, QoS("best_effort", durability="transient_local"), [5]),
    ],
)
def test_what_a_late_reader_gets(offered, requested, gets):
    bus = Bus()
    writer = bus.node("a").writer("x", offered)
    for k in range(5):
        bus.after(0.1 * k, writer.publish, k)
    bus.run(0.5)
    reader = bus.node("b").reader("x", None, requested)
    writer.publish(5)
    bus.run(0.5)
    assert taken(reader)[-len(gets) :] == gets
    assert reader.received == len(gets)


# --- What the ends are told -----------------------------------------------------------------------


def test_a_pair_that_does_not_fit_is_silent_and_both_ends_are_told():
    report: list[Any] = []
    bus = Bus()
    writer = bus.node("a").writer("x", QoS("best_effort", deadline=1.0), report.append)
    reader = bus.node("b").reader("x", None, QoS(deadline=0.5), on_event=report.append)
    writer.publish(1)
    bus.run(0.4)
    assert reader.received == 0
    assert [(e.end, e.kind, e.detail) for e in report] == [
        (end, "incompatible", ("reliability", "deadline")) for end in ("writer", "reader")
    ]


def test_five_gaps_of_120_ms_under_a_deadline_of_50_ms_are_ten_events_on_each_side():
    bus, writer, _ = ends(QoS(deadline=0.05))
    for k in range(6):
        bus.push(k * 120_000_000, 1, writer.publish, k)
    bus.run(0.6)
    due = [("deadline", round(0.12 * k + 0.05 * m, 9)) for k in range(5) for m in (1, 2)]
    assert kinds(bus, "writer") == kinds(bus, "reader") == due
    bus, writer, _ = ends(QoS(deadline=0.05))
    for k in range(6):
        bus.push(k * 50_000_000, 1, writer.publish, k)  # just in time
    bus.run(0.25)
    assert not bus.events


def test_who_says_that_a_writer_lives():
    lease: dict[str, Any] = {"liveliness_lease_duration": 0.1}
    bus, writer, _ = ends(QoS(**lease))
    bus.run(1.0)
    assert not bus.events  # the middleware says so
    writer.die()
    writer.publish(1)
    bus.run(2.0)
    assert [(e.kind, e.end, e.time) for e in bus.events] == [("not alive", "reader", 1.1)]

    bus, writer, _ = ends(QoS(liveliness="manual_by_topic", **lease), link=Link(delay=0.01))
    bus.after(0.25, writer.publish, 1)
    bus.after(0.3, writer.assert_liveliness)
    bus.run(0.5)
    story = [("not alive", 0.1), ("alive", 0.25), ("not alive", 0.4)]
    assert kinds(bus, "writer") == story
    # Its lease began with the match; each later word needs 10 ms.
    assert kinds(bus, "reader") == [("not alive", 0.1), ("alive", 0.26), ("not alive", 0.41)]

    bus = Bus()
    node, mine = bus.node("a"), QoS(liveliness="manual_by_participant", **lease)
    first, second = node.writer("x", mine), node.writer("y", mine)
    for k in range(9):
        bus.after(0.08 * k, second.publish, k)
    bus.run(0.7)
    assert first.number == 0
    assert not bus.events  # any writer of the process speaks for all


# --- Services and actions -------------------------------------------------------------------------


def test_a_service_answers_each_client_for_itself():
    bus = Bus()
    server, nodes = bus.node("server"), [bus.node(name) for name in "ab"]

    def double(x):
        yield 0.1
        return 2 * x

    server.service("double", double)
    got = []

    def asking(client, x):
        answer = yield client.call(x)
        got.append((x, answer, round(bus.now, 9)))

    for node, x in zip(nodes, (3, 4), strict=True):
        client = node.client("double", link=Link(delay=0.05))
        node.timer(10.0, lambda client=client, x=x: asking(client, x))
    bus.run(1.0)
    assert got == [(3, 6, 0.15), (4, 8, 0.15)]


def test_an_action_gives_feedback_and_can_be_cancelled():
    bus, news, ended = Bus(), [], []

    def execute(goal):
        for k in range(goal.value):
            yield 0.1
            if goal.status == "canceling":
                return k
            goal.feedback(k)
        return goal.value

    bus.node("arm").action("move", execute)
    client = ActionClient(bus.node("mind"), "move", lambda key, x: news.append((key[1], x)))
    _, short = client.send(3)
    key, long = client.send(10)
    for future in (short, long):
        future.then(lambda end: ended.append((end, round(bus.now, 9))))
    requested: list[bool] = []
    bus.after(0.55, lambda: client.cancel(key).then(requested.append))
    bus.after(0.75, lambda: client.cancel(key).then(requested.append))
    bus.run(2.0)
    assert ended == [(("succeeded", 3), 0.3), (("canceled", 5), 0.6)]
    assert requested == [True, False]
    assert [x for k, x in news if k == 1] == [0, 1, 2]
    assert [x for k, x in news if k == 2] == [0, 1, 2, 3, 4]


# --- Real time ------------------------------------------------------------------------------------


def stack(bus):
    """Camera, perception, and a service that perception asks; what came out."""
    out, camera, eye, mind = [], bus.node("camera"), bus.node("eye"), bus.node("mind")
    images, poses = camera.writer("image"), eye.writer("pose")
    frames = iter(range(5))

    def shoot():
        if (k := next(frames, None)) is not None:
            images.publish(k, 1000)

    def see(sample):
        yield 0.001
        answer = yield client.call(sample.value)
        poses.publish((sample.value, answer))

    mind.service("square", lambda x: x * x)
    client = eye.client("square")
    camera.timer(0.01, shoot)
    eye.reader("image", see)
    mind.reader("pose", lambda sample: out.append(sample.value))
    return out


def test_the_same_nodes_run_in_virtual_and_in_real_time():
    result = []
    for real in (False, True):
        bus = Bus()
        out = stack(bus)
        bus.run(0.1, real)
        if real and len(out) < 5:  # on a busy machine
            bus.run(5.0, real)
        result.append(sorted(out))
    assert result[0] == result[1] == [(k, k * k) for k in range(5)]


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: Link(loss=1.0), "loss"),
        (lambda: Link(fragment=0), "fragment"),
        (lambda: Link(rate=0.0), "rate"),
        (lambda: Link(delay=-1.0), "delay"),
        (lambda: Bus(-1), "seed"),
        (lambda: Bus().node("a").timer(0.0, print), "period"),
        (lambda: Bus().after(-1.0, print), "seconds"),
        (lambda: Bus().run(math.inf), "seconds"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(ValueError, match=match):
        call()
