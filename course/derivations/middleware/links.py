"""Claims of chapter 10: what goes over a link, and what topics and services are."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "p": Symbol("share of packets lost", 0.01, 0.9),
    "n": Symbol("packets of a message", 1.0, 1000.0),
    "w": Symbol("pixels in a row"),
    "h": Symbol("rows"),
    "c": Symbol("bytes of a pixel"),
    "f": Symbol("pictures a second [1/s]"),
}


def lossy(reliability, packets, loss, messages, rate=float("inf")):
    """Return a reader, its link and bus after messages of several packets, published at once."""
    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    bus, link = Bus(), Link(loss=loss, rate=rate)
    qos = QoS(reliability, "keep_all")
    writer = bus.node("camera").writer("image", qos)
    reader = bus.node("eye").reader("image", None, qos, link)
    for k in range(messages):
        writer.publish(k, packets * link.fragment)
    bus.run(1e6)
    return reader, link, bus


@claim(
    "A link that loses one packet in a thousand loses one image in a thousand.",
    "An image is lost if any of its packets is lost. If each packet is lost independently, a "
    "message of {twelve:.0f} packets is lost with probability {formula}. At {p:.1%} packet loss, "
    "{lost:.0%} of the images with {n:.0f} packets (VGA colour) are lost, and {few:.1%} of the "
    "messages with {twelve:.0f}. Losses that come in bursts hit fewer images.",
    ask=(
        "Each packet is lost with probability p, independently, and none is sent again. With which "
        "probability is a message of 12 packets lost?",
        "1 - (1 - p)^12",
        {
            "p": "That is one packet.",
            "12*p": "This is close if p is small. But two lost packets lose only one message.",
            "p^12": "That is the probability that all of them are lost.",
            "(1 - p)^12": "That is the probability that the message arrives.",
        },
    ),
)
def picture_lost_like_packet(result):
    import sympy

    from course.middleware.bus import Link
    from course.middleware.transport import expected_loss

    p = sympy.Symbol("p", positive=True)
    through = sympy.prod([1 - p] * 12)
    result.formula = 1 - through
    n, loss = int(result.input("n", Link().fragments(640 * 480 * 3))), result.input("p", 1e-3)
    twelve = int(result.input("twelve", 12))

    def share(packets, loss, messages=4000):
        return lossy("best_effort", packets, loss, messages)[0].lost / messages

    lost = result.measure("lost", expected_loss(n, loss))
    few = result.measure("few", float(result.formula.subs(p, loss)))
    drawn = result.rng.uniform(0.01, 0.3, 6)
    # As many losses, in rows of ten.
    rows = result.rng.random((4000, n)) < loss / 10
    # Every lost start takes ten packets with it: the same loss rate, but in bursts.
    rows = np.logical_or.reduce([np.roll(rows, k) for k in range(10)])
    result.statement = (
        "Messages on the bus, each packet drawn; losses in rows of ten by themselves."
    )
    observed = share(n, loss)
    result.statement_holds(observed < 2.0 * loss)
    result.correction_holds(
        abs(observed - lost) < 0.03,
        abs(share(twelve, loss, 20_000) - few) < 0.004,
        all(abs(share(12, float(x)) - float(result.formula.subs(p, x))) < 0.04 for x in drawn),
        abs(rows.mean() / loss - 1.0) < 0.1,
        rows.any(axis=1).mean() < 0.3 * lost,
    )


def forgets(packets, loss, messages=1000):
    """Return whether a reliable writer of depth 1 resends nothing to a late request."""
    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    bus, link = Bus(), Link(loss=loss, delay=0.02)
    writer = bus.node("camera").writer("image", QoS(depth=1))
    reader = bus.node("eye").reader("image", None, QoS(history="keep_all"), link)
    for k in range(messages):
        bus.after(k / 30, writer.publish, k, packets * link.fragment)
    bus.run(messages)
    # Requests come a link delay too late: a writer of depth 1 has already replaced the sample.
    # All but the last few, which nothing replaced.
    return reader.lost > 100 and reader.rounds - reader.lost <= 3


@claim(
    "Reliable delivery on a lossy link sends the whole image again and again.",
    "It sends only the packets that are missing, as long as the writer stores them: {formula} "
    "packets in all on average. An image of {n:.0f} packets on a link that loses {p:.1%} takes "
    "{more:.2%} more packets and {rounds:.2f} rounds. Sending the whole image again until one copy "
    "is complete would take {whole:.2f} times all packets. The real price is age, as each further "
    "round is a trip there and back. And a writer of depth 1 that was asked after the next image "
    "was out sent nothing again. (If IP splits one DDS packet into pieces, a lost piece costs that "
    "whole packet.)",
    ask=(
        "A message has n packets, and each transmission is lost with probability p. Only the lost "
        "packets are sent again, until all have arrived. How many packets are sent on average?",
        "n/(1 - p)",
        {
            "n*(1 + p)": "Some of the packets that are sent again are lost again.",
            "n": "That is without losses.",
            "n/p": "A link with little loss needs few packets.",
            "n/(1 - p)^2": "Each packet needs only the trip to the reader to succeed.",
        },
    ),
)
def reliable_resends_all(result):
    import sympy

    from course.middleware.transport import expected_loss, expected_rounds

    n, p, k = sympy.symbols("n p k", positive=True)
    result.formula = sympy.simplify(n * (1 + (sympy.Sum(p**k, (k, 1, sympy.oo)).doit().args[0][0])))
    size, loss = int(result.input("n", 627)), result.input("p", 1e-3)

    def packets(size, loss, messages=300, rate=1e9):
        """Return packets of each message on average, and rounds.

        The wire never rests before everything is delivered.
        """
        reader, link, bus = lossy("reliable", size, loss, messages, rate)
        # Bytes that have occupied the wire, so every repetition is counted.
        sent = 1e-9 * bus.wires[link] * rate / link.fragment
        return sent / messages, 1.0 + reader.rounds / messages

    sent, observed_rounds = packets(size, loss, 3000)
    more = result.measure("more", float(result.formula.subs({n: size, p: loss})) / size - 1.0)
    rounds = result.measure("rounds", expected_rounds(size, loss))
    # One copy is complete with probability (1 - p)^n, independently of the others.
    whole = result.measure("whole", 1.0 / (1.0 - expected_loss(size, loss)))
    alone = 4000 / lossy("best_effort", size, loss, 4000)[0].received
    drawn = [(int(a), float(b)) for a, b in result.rng.uniform((5, 0.05), (200, 0.5), (5, 2))]
    observed = [(packets(a, b)[0], float(result.formula.subs({n: a, p: b}))) for a, b in drawn]
    result.statement = "Bytes on the bus's wire; what asks for them is not lost and not counted."
    result.statement_holds(bool(abs(observed_rounds / alone - 1.0) < 0.1))
    result.correction_holds(
        all(abs(a / b - 1.0) < 0.03 for a, b in observed),
        abs(observed_rounds - rounds) < 0.05,
        abs(alone - whole) < 0.15,
        rounds < whole - 0.2,
        abs(sent / size - 1.0 - more) < 0.3 * more,
        forgets(size, loss),
    )


@claim(
    "One camera at 720p and 30 Hz, with colour and depth, fits through gigabit Ethernet.",
    "Uncompressed it does not. It needs {formula}, which is {camera:.0f} MB/s, and the cable "
    "carries at most {cable:.0f} MB/s. If nothing is dropped, the queue grows and the images get "
    "older by {slope_ms:.0f} ms with each second of sending. VGA colour needs {vga:.1f} MB/s, in "
    "{packets:.0f} packets per image.",
    ask=(
        "A camera sends f uncompressed images per second, of w by h pixels with c bytes each. How "
        "many bytes per second is that?",
        "B, rate = w*h*c*f",
        {
            "8*w*h*c*f": "That is bits.",
            "w*h*f": "A pixel has more than one byte.",
            "w*h*c/f": "More images per second are more bytes.",
            "(w + h)*c*f": "The number of pixels is rows times columns.",
        },
    ),
)
def gigabit_is_enough(result):
    import sympy

    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    w, h, c, f, k = sympy.symbols("w h c f k", positive=True)
    result.formula = sympy.summation(sympy.summation(c, (k, 1, w)), (k, 1, h)) * f

    def rate(*of):
        return float(result.formula.subs(dict(zip((w, h, c, f), of, strict=True))))

    def slope(size, wire, hz=30.0, seconds=10.0):
        """Return the rate [s/s] at which images get older, and their age at the end [s]."""
        bus, observed = Bus(), list[tuple[float, float]]()
        out = bus.node("camera").writer("image", QoS(history="keep_all"))
        bus.node("eye").reader(
            "image",
            lambda s: observed.append((s.stamp, bus.now - s.stamp)),
            QoS(history="keep_all"),
            Link(rate=wire),
        )
        bus.node("shutter").timer(1.0 / hz, lambda: (out.publish(0, size), None)[1])
        bus.run(seconds)
        stamp, old = np.transpose(observed)
        # Growth of the age of images over their time stamps.
        return float(np.polyfit(stamp, old, 1)[0])

    wire = 1e6 * result.input("cable", 125)
    camera = result.measure("camera", rate(1280, 720, 5, 30) / 1e6)
    vga = result.measure("vga", rate(640, 480, 3, 30) / 1e6)
    packets = result.measure("packets", Link().fragments(int(rate(640, 480, 3, 1))))
    grows = result.measure("slope_ms", 1e3 * slope(int(rate(1280, 720, 5, 1)), wire), 0.01)
    result.statement = "Arithmetic, and pictures on a wire of that many bytes a second, no headers."
    result.statement_holds(grows < 1.0)
    result.correction_holds(
        camera > 125.0,
        # In overload the queue grows by the ratio of rates less 1.
        abs(grows / (1e3 * (camera / 125.0 - 1.0)) - 1.0) < 0.01,
        abs(slope(int(rate(640, 480, 3, 1)), wire)) < 1e-6,
        vga < 28.0,
        packets * 1472 >= rate(640, 480, 3, 1),
    )


@claim(
    "A small command waits behind a large image that was sent just before it, in one burst, on a "
    "wire that carries packets in order.",
    "That is so with both reliabilities. At {mb_s:.0f} MB/s, an image of {mb:.1f} MB occupies "
    "the wire for {keeps_ms:.1f} ms, and commands at {hz:.0f} Hz waited up to {waited_ms:.1f} ms. "
    "On a wire of their own they waited {alone_ms:.3f} ms. If the writer spreads the image's "
    "packets over {spread_ms:.0f} ms, they waited {paced_ms:.3f} ms.",
)
def command_waits_for_picture(result):
    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    speed, size = 1e6 * result.input("mb_s", 125), 1e6 * result.input("mb", 0.9)
    period = 1.0 / result.input("hz", 1000)

    def waited(reliability, shared, phase=0.37, spread=0.0):
        bus, late, wire = Bus(), list[float](), Link(rate=speed)
        qos = QoS(reliability, "keep_all")
        image, torque = (bus.node(x).writer(x, qos) for x in ("image", "torque"))
        bus.node("eye").reader("image", None, qos, wire)
        bus.node("drive").reader(
            "torque",
            lambda s: late.append(bus.now - s.stamp),
            qos,
            wire if shared else Link(rate=speed),
        )
        parts = wire.fragments(int(size)) if spread else 1

        def shot():
            for k in range(parts):
                bus.after(k * spread / parts, image.publish, 0, int(size) // parts)

        bus.node("a").timer(1 / 30, shot, float(phase))
        bus.node("b").timer(period, lambda: (torque.publish(0, 100), None)[1])
        bus.run(1.0)
        return 1e3 * max(late)

    kinds = ("reliable", "best_effort")
    # Transmission time of the whole image: the bound of the wait.
    keeps = result.measure(
        "keeps_ms", 1e3 * Link(rate=speed).fragments(int(size)) * 1472 / speed, 0.01
    )
    largest = result.measure("waited_ms", max(waited(kind, True) for kind in kinds), 0.05)
    alone = result.measure("alone_ms", waited("reliable", False), 0.05)
    spread = 1e-3 * result.input("spread_ms", 20)
    paced = result.measure("paced_ms", waited("reliable", True, spread=spread), 0.1)
    drawn = [waited(kind, True, x) for kind in kinds for x in result.rng.uniform(0.1, 0.9, 4)]
    result.statement = "Pictures and commands on one wire of the bus, in ten phases."
    result.statement_holds(all(x > 0.8 * keeps for x in drawn))
    result.correction_holds(max(largest, *drawn) < 1.01 * keeps, alone < 0.01, paced < 0.02)


def newest(reliability, loss, repair, seconds=5.0):
    """Return age of the newest of 1,000 joint states a second, as seen at any time on the bus [ms].

    Args:
        reliability: setting of the writer and the reader.
        loss: share of the packets that is lost.
        repair: how long after its time a state that was lost once arrives [s].
        seconds: length of the run [s].
    """
    from course.middleware.bus import Bus, Link
    from course.middleware.qos import QoS

    bus, ages, state, delay = Bus(), list[float](), [0.0], 1e-4
    link = Link(delay=delay, loss=loss, nack=repair - 2.0 * delay)
    out = bus.node("drives").writer("joint_states", QoS(reliability))
    bus.node("control").reader(
        "joint_states", lambda s: state.__setitem__(0, s.stamp), QoS(reliability), link
    )
    bus.node("a").timer(1e-3, lambda: (out.publish(0), None)[1])
    # Observed with another period, so that all phases occur.
    bus.node("b").timer(1.0037e-3, lambda: ages.append(1e3 * (bus.now - state[0])))
    bus.run(seconds)
    return np.array(ages[10:])


@claim(
    "On a lossy link, joint states for a control loop need a reliable topic.",
    "A lost state is replaced by the next one. With reliable delivery the next one waits until the "
    "lost one has been sent again. With {loss:.0%} loss, {slow_ms:.0f} ms for a repair and a "
    "thousand states a second, the mean age was {best_ms:.2f} ms with best effort and "
    "{sure_ms:.2f} ms with reliable; the oldest hundredth was {best_tail:.1f} and {sure_tail:.1f} "
    "ms old. With {quick_ms:.1f} ms for a repair, reliable was better, at {quick:.2f} ms. A "
    "message that is sent once, such as a goal or a change of mode, needs reliable.",
)
def joint_states_reliable(result):
    loss, kinds = result.input("loss", 0.1), ("best_effort", "reliable")
    slow, quick = (1e-3 * result.input(*x) for x in (("slow_ms", 3), ("quick_ms", 0.3)))
    best, sure = (newest(kind, loss, slow) for kind in kinds)
    for name, some in (("best", best), ("sure", sure)):
        result.measure(f"{name}_ms", some.mean(), 0.1)
        result.measure(f"{name}_tail", np.quantile(some, 0.99), 0.2)
    again = result.measure("quick", newest("reliable", loss, quick).mean(), 0.1)
    fair = [newest(kind, 0.0, slow).mean() for kind in kinds]

    def fresher(loss, repair):
        one, other = (newest(kind, float(loss), float(repair)).mean() for kind in kinds)
        return bool(other < one)

    # Repair times below one period and above it, on both sides of the condition.
    within, after = (
        result.rng.uniform((0.1, 2e-4), (0.3, 7e-4), (8, 2)),
        result.rng.uniform((0.1, 1.3e-3), (0.3, 4e-3), (8, 2)),
    )
    # Chosen to break it: half of the repairs are lost as well, and a period has room for one.
    again_lost = [fresher(x, 9e-4) for x in (0.4, 0.5)]
    result.statement = "Joint states on the bus, 5 s each, looked at in all phases."
    result.statement_holds(
        bool(sure.mean() < best.mean()),
        only_if="a lost state arrives again before the next state is due, and few repairs are lost "
        "as well",
        inside=[fresher(*x) for x in within],
        outside=[fresher(*x) for x in after] + again_lost,
    )
    result.correction_holds(
        bool(again < best.mean()),
        abs(fair[0] / fair[1] - 1.0) < 1e-6,
        bool(np.quantile(sure, 0.99) > np.quantile(best, 0.99)),
        not any(fresher(*x) for x in after[:3]),
        not any(again_lost),
    )


@claim(
    "Topics are many-to-many.",
    "They are: {writers:.0f} writers and {readers:.0f} readers made {all:.0f} deliveries when each "
    "writer sent one message. This also allows a mistake. Two controllers that publish on one "
    "command topic are both obeyed: the drive switched between them {changes:.0f} times in "
    "{turns:.0f} messages, and no event was raised. DDS can make a topic exclusive, so that only "
    "the stronger writer is obeyed; ROS 2's profiles do not offer that.",
)
def topics_many_to_many(result):
    from course.middleware.qos import QoS
    from course.oracles.cyclonedds import Topic, participant, take

    count, others = int(result.input("writers", 3)), int(result.input("readers", 4))
    turns = int(result.input("turns", 10))
    with participant() as member:
        topic, second = Topic(member), Topic(member)
        writers = [topic.writer(QoS()) for _ in range(count)]
        readers = [topic.reader(QoS()) for _ in range(others)]
        for k, writer in enumerate(writers):
            topic.write(writer, k)
        got = [sorted(take(reader)) for reader in readers]
        pair, drive = [second.writer(QoS()) for _ in range(2)], second.reader(QoS(depth=100))
        for k in range(turns):
            second.write(pair[k % 2], k % 2)
        obeyed = take(drive)
        report = sum(one.get_offered_incompatible_qos_status().total_count for one in pair)
        third, sole = Topic(member), QoS(ownership="exclusive", depth=100)
        weak, strong = (third.writer(sole, strength=k) for k in (1, 2))
        drive = third.reader(sole)
        third.write(strong, 1)
        for k in range(turns):
            third.write((weak, strong)[k % 2], k % 2)
        alone = take(drive)
    result.measure("all", sum(map(len, got)))
    # Commands of both writers alternate at the reader.
    changes = result.measure("changes", int(np.count_nonzero(np.diff(obeyed))))
    result.statement = "Writers and readers on Cyclone DDS."
    result.statement_holds(got == [list(range(count))] * others)
    result.correction_holds(changes == turns - 1, report == 0, set(alone) == {1})


def answered(work, busy=0.0, phase=0.0, clients=1):
    """Return response times of services on the bus, by client [s].

    It also returns whether each client got its own answer.
    """
    from course.middleware.bus import Bus, Group
    from course.middleware.executor import Executor

    bus, observed = Bus(), list[tuple[float, bool]]()
    server = bus.node("server", Executor(bus))

    def serve(x):
        yield work
        return 2 * x

    def other():
        yield busy

    def ask(client, x, start=0.0):
        start = bus.now
        answer = yield client.call(x)
        observed.append((bus.now - start, answer == 2 * x))

    server.service("double", serve)
    if busy:
        server.timer(1.0, other, 0.1)
    for k in range(clients):
        node = bus.node(f"client {k}", Executor(bus, 2))
        client = node.client("double", Group("answers"))
        node.timer(1.0, lambda client=client, k=k: ask(client, k), 0.1 + phase)
    bus.run(1.0)
    return observed


@claim(
    "A topic takes one millisecond and a service five, and a service is one-to-one.",
    "None of these has a fixed latency. On DDS a service is a request topic, a reply topic and a "
    "callback. A service with {work_ms:.0f} ms of work answered after {least_ms:.0f} to "
    "{most_ms:.0f} ms, depending on whether another callback occupied its server. It is also "
    "many-to-one: {clients:.0f} clients that called at the same time each got their own reply, the "
    "last after {last_ms:.0f} ms. But requests wait in a queue of depth {depth:.0f}: of {many:.0f} "
    "simultaneous requests {heard:.0f} were answered, and the others wait forever.",
)
def service_takes_five(result):
    from course.middleware.qos import QoS

    work = 1e-3 * result.input("work_ms", 2)
    busy = 1e-3 * result.input("busy_ms", 40)
    # Requests before, during and after the other callback.
    phases = np.linspace(-0.05, 0.05, 41)
    observed = [1e3 * answered(work, busy, float(x))[0][0] for x in phases]
    least = result.measure("least_ms", min(observed), 0.01)
    largest = result.measure("most_ms", max(observed), 0.05)
    crowd = answered(work, clients=int(result.input("clients", 5)))
    last = result.measure("last_ms", 1e3 * max(x for x, _ in crowd), 0.01)
    depth = result.measure("depth", QoS().depth)
    received = result.measure("heard", len(answered(work, clients=int(result.input("many", 20)))))
    result.statement = "A server with a second callback on the bus, and clients that ask at once."
    result.statement_holds(len(crowd) < 2 or largest < 1.5 * least)
    result.correction_holds(
        all(right for _, right in crowd),
        len(crowd) == 5,
        largest > 10.0 * least,
        abs(last - 5e3 * work) < 0.1,
        received == depth,
    )


@claim(
    "If a tool lists a subscriber of your topic, your publisher's messages reach it.",
    "Being listed only means that discovery works. On Cyclone DDS, {listed:.0f} of {cases:.0f} "
    "ways to disagree left the other end listed and not matched: incompatible quality of service, "
    "another type name, and the same type name with a field added, changed or renamed. Each raised "
    "an event. It named {policy} for the quality of service, and {definition} for the types. If "
    "both types are declared appendable, an added field does not prevent the match, and the reader "
    "gets {missing:.0f} for it. With another domain id, or without multicast and without a peer, "
    "{unlisted:.0f} of {silent:.0f} cases listed nothing. Naming the other computer as a peer "
    "helped, and one direction was enough.",
    source="OMG, DDS 1.4, 2015, built-in topics; DDS-XTypes 1.3, 2020; Cyclone DDS, measured",
)
def listed_is_matched(result):
    from course.oracles.discovery import discover

    fields = {case: discover(case) for case in ("field added", "field changed", "field renamed")}
    apart = {case: discover(case) for case in ("other type", "other policy")} | fields
    appendable = discover("appendable")
    unseen = {case: discover(case) for case in ("other domain", "no peer")}
    works = {case: discover(case) for case in ("works", "with a peer")}
    result.measure("cases", len(apart))
    listed = result.measure("listed", sum(x.listed and not x.matched for x in apart.values()))
    result.measure("policy", apart["other policy"].policy)
    result.measure("definition", apart["field added"].policy.replace("_", " "))
    missing = result.measure("missing", appendable.received.get("effort", np.nan))
    result.measure("silent", len(unseen))
    unlisted = result.measure("unlisted", sum(not x.listed for x in unseen.values()))
    result.statement = "Two processes on Cyclone DDS in each case, without multicast."
    result.statement_holds(all(x.matched for x in apart.values()))
    result.correction_holds(
        listed == len(apart),
        apart["other policy"].policy == "reliability",
        apart["other type"].policy == "type_consistency",
        all(x.policy == "type_consistency" and not x.same_hash for x in fields.values()),
        all(x.types == ["course::Joint"] for x in fields.values()),
        appendable.matched and not appendable.same_hash and missing == 0.0,
        unlisted == len(unseen),
        sum(x.participants for x in unseen.values()) == 0,
        all(x.matched and x.listed for x in works.values()),
    )
