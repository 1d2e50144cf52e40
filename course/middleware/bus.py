"""Publish and subscribe, services and actions, in virtual time or in real time.

What DDS does between two ends, event by event: who is matched, what is kept, lost and sent again,
told. In virtual time the seed alone decides. Times: whole nanoseconds inside, seconds outside.

A callback is a function, which takes no time, or a generator: `yield seconds` computes for so
long, `answer = yield client.call(request)` waits for an answer and keeps its thread.

Left out: discovery takes no time; heartbeats and negative acknowledgements are not lost; packets
have no headers; a link's buffer is endless; of exclusive writers all are heard.
Sources: OMG, DDS 1.4, 2015; OMG, DDS Interoperability Wire Protocol 2.3, 2019, sec. 8.4.
"""

import heapq
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from types import GeneratorType
from typing import Any, NamedTuple

import numpy as np

from course.check import count, finite, positive
from course.middleware.qos import QoS, compatible

ARRIVAL, CALL, CHECK, START = range(4)  # the order of what happens at the same nanosecond
NEVER = 1 << 60


def nanoseconds(seconds: float) -> int:
    """Return the nearest whole number; infinity is `NEVER`."""
    return NEVER if seconds == math.inf else round(seconds * 1e9)


class Sample(NamedTuple):
    """What was published: when [s], its number from 1 on by its writer, its bytes."""

    value: Any
    stamp: float
    number: int
    size: int
    expires: int  # [ns]


class Event(NamedTuple):
    """A status that a writer or reader is told, with the time, the topic and the end.

    "incompatible" (detail: the policies), "deadline", "not alive", "alive", "lost" (detail: the
    sample's number).
    """

    time: float
    kind: str
    topic: str
    end: str  # "writer" or "reader"
    node: str
    detail: Any = None


@dataclass(frozen=True, eq=False)
class Link:
    """A way from writers to a reader; readers that are given the same one share its wire.

    Attributes:
        delay, jitter: of each message; evenly from delay to delay + jitter [s].
        loss: share of packets that do not arrive, each for itself.
        fragment: bytes of a packet; a message arrives with its last one.
        rate: of the wire [bytes/s].
        nack: from noticing a loss to asking again [s].
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    fragment: int = 1472
    rate: float = math.inf
    nack: float = 0.0

    def __post_init__(self) -> None:
        for name in ("delay", "jitter", "nack"):
            finite(name, getattr(self, name), 0.0, unit="s")
        finite("loss", self.loss, 0.0, 0.99)
        count("fragment", self.fragment, 1)
        if self.rate != math.inf:
            positive("rate", self.rate, unit="bytes/s")

    def fragments(self, size: int) -> int:
        """Return the number of packets of a message of `size` bytes."""
        return max(1, -(-size // self.fragment))


DEFAULT, IDEAL = QoS(), Link()


@dataclass(eq=False)
class Group:
    """Callbacks that run one at a time; any number at once where it is reentrant."""

    name: str
    reentrant: bool = False


# Executors run callbacks outside of the bus's lock, so one thread may set an answer while another
# begins to wait for it. This lock makes "is it there? else append" a single step; it is shared by
# all answers, and never held while a callback runs.
_SETTING = threading.Lock()


class Future:
    """An answer that is still to come, and the callbacks that have to run before it is there.

    Attributes:
        done, value: whether the answer is there, and the answer.
        needs: callbacks that have to run before.
        unserved: name of the service that nobody served when the request was sent, or "". Such a
            request is lost: a server that starts later does not see it.
    """

    __slots__ = ("_then", "done", "needs", "unserved", "value")

    def __init__(self, *needs: "Callback", unserved: str = "") -> None:
        self.done, self.value, self.needs, self.unserved = False, None, list(needs), unserved
        self._then: list[Callable[[Any], Any]] = []

    def then(self, call: Callable[[Any], Any]) -> None:
        """Call with the value as soon as it is there: at once if it is, else from `set`."""
        with _SETTING:
            if not self.done:
                self._then.append(call)
                return
        call(self.value)

    def set(self, value: Any) -> None:
        """Set the answer, and call everyone who waits for it."""
        with _SETTING:
            self.done, self.value, self.needs = True, value, []
            waiting, self._then = self._then, []
        for call in waiting:
            call(value)


class Callback:
    """What an executor runs: of a timer, a reader ("subscription"), a service or a client.

    Attributes:
        take: gives the arguments of the next run, or None, and forgets them.
        oldest: when the first event that waits for it came [ns], or None.
        skipped: ticks of a timer that came while one was waiting.
    """

    __slots__ = ("function", "group", "kind", "name", "node", "oldest", "skipped", "take")

    def __init__(
        self,
        node: "Node",
        kind: str,
        name: str,
        function: Callable,
        group: Group | None,
        take: Callable[[], tuple | None],
        oldest: Callable[[], int | None],
    ) -> None:
        self.node, self.kind, self.name, self.function = node, kind, name, function
        self.group, self.take, self.oldest, self.skipped = group or node.group, take, oldest, 0
        node.executor.add(self)


def drive(
    bus: "Bus",
    steps: Generator,
    finish: Callable[[Any], None] | None = None,
    blocked: Callable[[Future | None], None] | None = None,
    value: Any = None,
) -> None:
    """Run a generator to its next wait; the bus, or the answer, resumes it until it ends.

    Returns at the first wait. What follows runs from an event of the bus, or from `Future.set`.

    Args:
        bus: the bus on whose clock it waits.
        steps: yields either seconds to wait, or a `Future` whose answer is to be sent back.
        finish: called with what the generator returned, or with None if it raised an error. The
            error is then raised to the caller.
        blocked: called with the future that it waits for, and with None when it continues.
        value: the result of its last wait, which is sent into the generator; None to start.

    Raises:
        ValueError: if it yields a wait that is not a non-negative finite number. The error is
            raised inside the generator, at its `yield`, and comes here if it is not handled there.
    """
    error: ValueError | None = None
    while True:
        try:
            request = steps.send(value) if error is None else steps.throw(error)
        except StopIteration as stop:
            if finish:
                finish(stop.value)
            return
        except Exception:
            # Its executor would otherwise wait for ever for the end of this run.
            if finish:
                finish(None)
            raise
        error = None
        if not isinstance(request, Future):
            # The generator asks for time: an event of the bus resumes it.
            try:
                name = getattr(steps, "__name__", "a generator")
                wait = finite(f"the wait yielded by {name}", request, 0.0, unit="s")
            except ValueError as rejected:
                error = rejected
                continue
            bus.after(wait, drive, bus, steps, finish, blocked)
            return
        if not request.done:
            # It asks for an answer: `Future.set` calls `resume` directly, so nobody polls for it.
            def resume(answer: Any) -> None:
                if blocked:
                    blocked(None)
                drive(bus, steps, finish, blocked, answer)

            # In this order, because another thread may set the answer at any moment: `blocked` is
            # called with the future before `resume` calls it with None.
            if blocked:
                blocked(request)
            request.then(resume)
            return
        # The answer is already there: send it at once, without a wait.
        value = request.value


class Direct:
    """Runs every callback at once, each on a thread of its own."""

    def __init__(self, bus: "Bus") -> None:
        self.bus = bus

    def add(self, callback: Callback) -> None:
        """Accept a callback; there is nothing to store."""

    def ready(self, callback: Callback) -> None:
        """Run a callback for which an event came."""
        given = callback.take()
        if given is not None:
            steps = callback.function(*given)
            if type(steps) is GeneratorType:
                drive(self.bus, steps)


class Bus:
    """Topics, and what happens when.

    Attributes:
        ns: now, since the start [ns].
        events: all events of the ends, in order.
    """

    def __init__(self, seed: int = 0) -> None:
        self.rng, self.ns = np.random.default_rng(count("seed", seed)), 0
        self.events: list[Event] = []
        self.ends: dict[str, tuple[list[Writer], list[Reader]]] = {}
        self.wires: dict[Link, int] = {}  # when each is free again [ns]
        self.executors: list[Any] = []
        self.lock = threading.RLock()
        self.changed, self.real = threading.Condition(self.lock), False
        self._heap: list[tuple[int, int, Callable, tuple]] = []
        self._pushed = self._start = 0

    @property
    def now(self) -> float:
        """Time since the start [s]."""
        return 1e-9 * self.tick()

    def tick(self) -> int:
        """Return the time since the start [ns], which goes on by itself in real time only."""
        if self.real:
            # The clock must not go back, although the monotonic one was read by several threads.
            self.ns = max(self.ns, time.monotonic_ns() - self._start)
        return self.ns

    def push(self, ns: int, rank: int, call: Callable, *given: Any) -> None:
        """Call at a time [ns]; of several then, the lowest rank first, then the oldest."""
        if self.real:
            self.lock.acquire()
        self._pushed += 1
        # Time and rank in one key; the counter keeps the order of events with equal keys.
        heapq.heappush(self._heap, (4 * ns + rank, self._pushed, call, given))
        if self.real:
            self.changed.notify_all()
            self.lock.release()

    def after(self, seconds: float, call: Callable, *given: Any) -> None:
        """Schedule a call in `seconds` seconds."""
        wait = nanoseconds(finite("seconds", seconds, 0.0, unit="s"))
        self.push(self.tick() + wait, CALL, call, *given)

    def run(self, seconds: float, real: bool = False) -> None:
        """Run all events up to a time since the start [s].

        In real time this takes as long: deliveries are then made by this thread, and executors
        start theirs.
        """
        # The key that `push` makes of the end: all events up to it, of every rank.
        end, heap = 4 * nanoseconds(finite("seconds", seconds, 0.0, unit="s")) + START, self._heap
        if real:
            self._run_real(end)
        while heap and heap[0][0] <= end and not real:
            key, _, call, given = heapq.heappop(heap)
            self.ns = key >> 2
            call(*given)
        self.ns = max(self.ns, end >> 2)

    # Callbacks run under the lock, except in executors, which release it while they compute.
    def _run_real(self, end: int) -> None:
        self._start, self.real = time.monotonic_ns() - self.ns, True
        threads = [thread for executor in self.executors for thread in executor.start()]
        with self.lock:
            while (now := self.tick()) <= end >> 2:
                first = self._heap[0][0] if self._heap else NEVER
                # In real time: sleep until the next event, or until somebody adds an earlier one.
                if first >> 2 > now:
                    self.changed.wait(1e-9 * (min(first, end + 4) - 4 * now) / 4)
                    continue
                _, _, call, given = heapq.heappop(self._heap)
                call(*given)
            self.real = False
            self.changed.notify_all()
        # The executors' threads end by themselves once `real` is false.
        for thread in threads:
            thread.join()

    def node(self, name: str, executor: Any = None) -> "Node":
        """Return a part of the software, whose callbacks an executor runs.

        `Direct` if there is none.
        """
        return Node(self, name, executor or Direct(self))

    def notify(self, end: "Writer | Reader", kind: str, detail: Any = None) -> None:
        """Tell an end what has happened."""
        side = "writer" if isinstance(end, Writer) else "reader"
        event = Event(1e-9 * self.ns, kind, end.topic, side, end.node.name, detail)
        self.events.append(event)
        if end.on_event:
            end.on_event(event)


class _Watch:
    """Tells an end when nothing has come for a period [s]: again and again, or once."""

    __slots__ = ("_again", "_armed", "_due", "_end", "_period", "_silent")

    def __init__(self, end: "Writer | Reader", period: float, again: bool) -> None:
        self._end, self._period, self._again = end, nanoseconds(period), again
        self._armed, self._silent, self._due = self._period == NEVER, False, 0

    # Only the due time moves: pushing a check for every message would fill the queue.
    def touch(self) -> None:
        bus = self._end.bus
        self._due = bus.ns + self._period
        if self._silent:
            self._silent = False
            bus.notify(self._end, "alive")
        if not self._armed:
            self._armed = True
            bus.push(self._due, CHECK, self._check)

    def _check(self) -> None:
        bus = self._end.bus
        # Each message moves the deadline; the check runs at the old one and finds out.
        if bus.ns >= self._due:
            self._due += self._period
            self._armed = self._again
            self._silent = not self._again
            bus.notify(self._end, "deadline" if self._again else "not alive")
        if self._armed:
            bus.push(self._due, CHECK, self._check)


class Writer:
    """The end that publishes. Made by `Node.writer`."""

    def __init__(self, node: "Node", topic: str, qos: QoS, on_event: Callable | None) -> None:
        self.node, self.topic, self.qos, self.on_event = node, topic, qos, on_event
        self.bus, self.number, self.dead = node.bus, 0, False
        self.matches: list[_Match] = []
        # The history serves late readers and repetitions; keep-last drops the oldest by itself.
        selected = None if qos.history == "keep_all" else qos.depth
        self.history: deque[Sample] = deque(maxlen=selected)
        self._keeps, self._manual = qos.durability != "volatile", qos.liveliness != "automatic"
        self._lifespan = nanoseconds(qos.lifespan)
        self._deadline = _deadline(self)
        # A lease is checked on the writer's side only where the application has to assert it.
        lease = qos.liveliness_lease_duration if self._manual else math.inf
        self._lease = _Watch(self, lease, False)
        self._lease.touch()

    def publish(self, value: Any, size: int = 0) -> Sample:
        """Hand a value of `size` bytes to all readers that are matched with this writer."""
        bus = self.bus
        with bus.lock:
            ns = bus.tick() if bus.real else bus.ns
            self.number += 1
            sample = Sample(value, 1e-9 * ns, self.number, size, ns + self._lifespan)
            if not self.dead:
                if self._keeps:
                    self.history.append(sample)
                if self._deadline:
                    self._deadline.touch()
                if self._manual:
                    self.assert_liveliness()
                for match in self.matches:
                    match.send(sample)
        return sample

    def assert_liveliness(self) -> None:
        """Say that this writer lives; by participant: that all of the node's do."""
        shared = self.qos.liveliness == "manual_by_participant"
        for writer in self.node.writers if shared else [self]:
            if not writer.dead and writer.qos.liveliness == self.qos.liveliness:
                writer._lease.touch()
                # Readers hear of an assertion after the link's delay, like of a message.
                for match in writer.matches:
                    wait = nanoseconds(match.link.delay)
                    self.bus.push(self.bus.ns + wait, ARRIVAL, match.lease.touch)

    def die(self) -> None:
        """End the process without a word: nobody is told, and the lease runs."""
        self.dead = True
        # Automatic liveliness was asserted until now, so the lease begins to run at death.
        for match in self.matches:
            if not self._manual:
                match.lease.touch()


class Reader:
    """The end that listens, and its cache. Made by `Node.reader`.

    Attributes:
        received: samples that came in; of them `dropped` were pushed out by newer ones before they
            were taken, `expired` outlived their lifespan.
        lost: samples that never came in; rounds: in which lost packets were sent again.
    """

    def __init__(
        self, node: "Node", topic: str, qos: QoS, link: Link, on_event: Callable | None
    ) -> None:
        self.node, self.topic, self.qos, self.on_event = node, topic, qos, on_event
        self.bus, self.link = node.bus, link
        self.received = self.dropped = self.expired = self.lost = self.rounds = 0
        self.callback: Callback | None = None
        self._cache: deque[tuple[int, Sample]] = deque()
        self._capacity, self._deadline = qos.history_depth, _deadline(self)

    def __len__(self) -> int:
        return len(self._cache)

    def take(self) -> Sample | None:
        """Remove and return the oldest sample that is stored and has not expired."""
        # Expiry is checked when a sample is taken: no timer for each sample is needed.
        while self._cache:
            sample = self._cache.popleft()[1]
            if sample.expires > self.bus.ns:
                return sample
            self.expired += 1
        return None

    def given(self) -> tuple[Sample] | None:
        """Return the same as the arguments of a callback."""
        sample = self.take()
        return None if sample is None else (sample,)

    def oldest(self) -> int | None:
        """Return when the oldest sample that is kept came in [ns]."""
        return self._cache[0][0] if self._cache else None

    def accept(self, number: int, sample: Sample | None) -> None:
        """Take in a sample, or count one that is not handed on.

        A reliable reader gets the samples in their writer's order. With best effort a loss is
        reported at once, while earlier samples may still be on their way.

        Args:
            number: of the sample, for the report of a loss.
            sample: None for one that was lost, or that came after a newer one.
        """
        if sample is None:
            self.lost += 1
            self.bus.notify(self, "lost", number)
            return
        self.received += 1
        # A deadline is about how often samples come: one that is too old counts as well.
        if self._deadline:
            self._deadline.touch()
        if sample.expires <= self.bus.ns:
            self.expired += 1
            return
        # Keep-last: a full cache drops its oldest sample.
        if len(self._cache) >= self._capacity:
            self._cache.popleft()
            self.dropped += 1
        self._cache.append((self.bus.ns, sample))
        if self.callback:
            self.node.executor.ready(self.callback)


class _Match:
    """A writer that a reader hears: what is on its way, and the order in which it is handed on."""

    def __init__(self, writer: Writer, reader: Reader) -> None:
        self.writer, self.reader, self.bus, self.link = writer, reader, writer.bus, reader.link
        ends = writer.qos, reader.qos
        # Reliable only if both ends are: the weaker end decides.
        self.reliable = all(qos.reliability == "reliable" for qos in ends)
        # The reader expects the numbers after the writer's last one, unless it gets history.
        self._next, self._early = writer.number + 1, dict[int, Sample | None]()
        self.lease = _Watch(reader, writer.qos.liveliness_lease_duration, False)
        self._manual = writer.qos.liveliness != "automatic"
        if self._manual:
            self.lease.touch()
        # A reader that does not acknowledge gets no history (so does Cyclone DDS, measured).
        if self.reliable and all(qos.durability != "volatile" for qos in ends):
            selected = [sample for sample in writer.history if sample.expires > self.bus.ns]
            self._next = selected[0].number if selected else self._next
            for sample in selected:
                self.send(sample)

    def send(self, sample: Sample, packets: int = 0) -> None:
        """Send `packets` packets of a sample, 0 for all, and lost ones again."""
        bus, link = self.bus, self.link
        arrival, size, lost = bus.ns, sample.size, 0
        # Each fragment is lost independently; a message is complete when all have arrived.
        if link.loss:
            n = packets or link.fragments(size)
            draw = bus.rng.random() < link.loss if n == 1 else bus.rng.binomial(n, link.loss)
            lost = int(draw)
        # The wire is shared: a message begins when the one before it has been sent.
        if link.rate < math.inf:
            size = min(size, packets * link.fragment) if packets else size
            arrival = max(arrival, bus.wires.get(link, 0)) + nanoseconds(size / link.rate)
            bus.wires[link] = arrival
        # Delay and jitter come after the wire, so they don't occupy it.
        if link.delay or link.jitter:
            late = link.jitter * bus.rng.random() if link.jitter else 0.0
            arrival += nanoseconds(link.delay + late)
        if not lost:
            bus.push(arrival, ARRIVAL, self._arrived, sample.number, sample)
        # Reliable: the reader's negative acknowledgement asks for the missing fragments again.
        elif self.reliable:
            self.reader.rounds += 1
            requested = arrival + nanoseconds(link.nack + link.delay)
            bus.push(requested, ARRIVAL, self._again, sample, lost)
        # Best effort: a message with a missing fragment is lost as a whole.
        else:
            self.reader.accept(sample.number, None)

    def _again(self, sample: Sample, packets: int) -> None:
        """Send packets of a sample that the reader asks for, or a notice that it is gone."""
        number, writer = sample.number, self.writer
        # A dead writer sends nothing again, and no notice either.
        if writer.dead:
            return
        # Only a sample that is still in the writer's history can be sent again.
        if number > writer.number - writer.qos.history_depth and sample.expires > self.bus.ns:
            self.send(sample, packets)
        else:
            missing = self.bus.ns + nanoseconds(self.link.delay)
            self.bus.push(missing, ARRIVAL, self._arrived, number, None)

    def _arrived(self, number: int, sample: Sample | None) -> None:
        """Handle a sample that has come in whole, or that is known to be gone."""
        if self._manual:
            self.lease.touch()
        # Reliable readers get samples in order: early ones wait. Best effort drops late ones.
        if number != self._next or self._early:
            if self.reliable:  # nothing is handed on before what it follows
                self._early[number] = sample
                while self._next in self._early:
                    self._next += 1
                    self.reader.accept(self._next - 1, self._early.pop(self._next - 1))
                return
            if number < self._next:  # a newer one was faster
                self.reader.accept(number, None)
                return
        self._next = number + 1
        self.reader.accept(number, sample)


class Node:
    """A part of the software: its ends and callbacks. Made by `Bus.node`."""

    def __init__(self, bus: Bus, name: str, executor: Any) -> None:
        self.bus, self.name, self.executor = bus, name, executor
        self.group, self.writers = Group(f"the default group of {name}"), list[Writer]()

    def writer(self, topic: str, qos: QoS = DEFAULT, on_event: Callable | None = None) -> Writer:
        """Return a writer to a topic; `on_event` is called with each of its events.

        A late reader gets all of its history, as ROS 2's layer asks of DDS's durability service.
        """
        with self.bus.lock:
            # Discovery: match the new writer with all readers that exist, and vice versa.
            writer = Writer(self, topic, qos, on_event)
            self.writers.append(writer)
            writers, readers = self.bus.ends.setdefault(topic, ([], []))
            writers.append(writer)
            for reader in readers:
                _match(writer, reader)
            return writer

    def reader(
        self,
        topic: str,
        function: Callable | None = None,
        qos: QoS = DEFAULT,
        link: Link = IDEAL,
        group: Group | None = None,
        on_event: Callable | None = None,
        kind: str = "subscription",
    ) -> Reader:
        """Add a reader of a topic to this node, and match it with the topic's writers.

        Args:
            topic: name of the topic.
            function: called with each sample, once the executor comes to it; without one, samples
                are taken by hand.
            qos: requested quality of service.
            link: network path to the reader; the default takes no time and loses nothing.
            group: callback group that it belongs to; the node's own by default.
            on_event: called with each of its events, such as a deadline that was missed.
            kind: what an executor's record calls the callback: "subscription", or "service" or
                "client" for the hidden topics of those.

        Returns:
            The reader. A writer whose offer is weaker than `qos` is not matched, and both ends get
            the event "incompatible".
        """
        # The lock: in real time other threads may publish on this topic meanwhile.
        with self.bus.lock:
            reader = Reader(self, topic, qos, link, on_event)
            # Before the first match, as a writer that keeps a history for late readers (transient
            # local) sends it while it is matched.
            if function:
                take, oldest = reader.given, reader.oldest
                reader.callback = Callback(self, kind, topic, function, group, take, oldest)
            # Discovery: a reader and the writers of its topic find each other in either order.
            writers, readers = self.bus.ends.setdefault(topic, ([], []))
            readers.append(reader)
            for writer in writers:
                if not writer.dead:
                    _match(writer, reader)
            return reader

    def timer(
        self, period: float, function: Callable, phase: float = 0.0, group: Group | None = None
    ) -> Callback:
        """Call once a period [s], the first time after `phase` periods.

        A tick that comes while one still waits for the executor is skipped.
        """
        bus, waiting = self.bus, deque[int](maxlen=1)
        period = positive("period", period, unit="s")
        first = bus.now + finite("phase", phase, 0.0) * period

        def tick(k: int) -> None:
            # The next tick is computed from the first one, so that rounding does not accumulate.
            bus.push(nanoseconds(first + (k + 1) * period), CALL, tick, k + 1)
            if waiting:
                made.skipped += 1
            else:
                waiting.append(bus.ns)
                self.executor.ready(made)

        made = Callback(
            self,
            "timer",
            self.name,
            function,
            group,
            lambda: () if waiting and waiting.pop() >= 0 else None,
            lambda: waiting[0] if waiting else None,
        )
        bus.push(nanoseconds(first), CALL, tick, 0)
        return made

    def service(self, name: str, function: Callable, group: Group | None = None) -> None:
        """Answer requests: the function returns the answer, a generator of it, or its `Future`."""
        replies = self.writer(f"{name}/reply")

        # A server's callback runs in its executor, so a busy server delays the answer.
        def serve(sample: Sample) -> Generator:
            client, number, request = sample.value
            answer = function(request)
            if isinstance(answer, GeneratorType):
                answer = yield from answer
            client.served(number)
            if isinstance(answer, Future):
                answer.then(lambda value: replies.publish((client, number, value)))
            else:
                replies.publish((client, number, answer))

        self.reader(f"{name}/request", serve, group=group, kind="service")

    def client(self, name: str, group: Group | None = None, link: Link = IDEAL) -> "Client":
        """Return what asks a service."""
        return Client(self, name, group, link)

    def action(self, name: str, execute: Callable[["Goal"], Generator]) -> None:
        """Serve an action: goals are accepted as they come, and run beside the callbacks.

        Args:
            name: name of the action.
            execute: goal -> generator that computes, calls `goal.feedback`, looks at
                `goal.status`, and returns the result.
        """
        news, goals = self.writer(f"{name}/feedback"), dict[Any, Goal]()

        def accept(request: tuple) -> bool:
            key, value = request
            goal = goals[key] = Goal(value, Future(), lambda x: news.publish((key, x)))

            # A goal whose generator raises an error is aborted, as in ROS 2.
            def run() -> Generator:
                try:
                    return (yield from execute(goal))
                except Exception:
                    goal.status = "aborted"
                    raise

            # A canceled goal returns a result too: its generator decides how to end.
            def finish(result: Any) -> None:
                if goal.status != "aborted":
                    goal.status = "canceled" if goal.status == "canceling" else "succeeded"
                goal.end.set((goal.status, result))

            drive(self.bus, run(), finish)
            return True

        def cancel(key: Any) -> bool:
            running = goals[key].status == "executing"
            if running:
                goals[key].status = "canceling"
            return running

        self.service(f"{name}/goal", accept)
        self.service(f"{name}/cancel", cancel)
        self.service(f"{name}/result", lambda key: goals[key].end)


class Client:
    """Asks a service. Made by `Node.client`."""

    def __init__(self, node: Node, name: str, group: Group | None, link: Link) -> None:
        self.name = name
        self._requests = node.writer(f"{name}/request")
        self._servers = node.bus.ends[f"{name}/request"][1]
        self._open: dict[int, Future] = {}
        self._reader = node.reader(
            f"{name}/reply", self._reply, DEFAULT, link, group, kind="client"
        )

    def call(self, request: Any, size: int = 0) -> Future:
        """Send a request; the answer is there once this client's own callback has run, too.

        Where nobody serves the service yet the answer never comes, as in ROS 2 without
        `wait_for_service`; `Future.unserved` says so, and `executor.deadlocks` reports it.
        """
        # A deadlock analysis needs to know which callbacks an answer depends on: one server, this
        # client.
        needs = [*self._servers[:1], self._reader]
        number = self._requests.number + 1
        future = self._open[number] = Future(
            *(end.callback for end in needs if end.callback),
            unserved="" if self._servers else self.name,
        )
        self._requests.publish((self, number, request), size)
        return future

    def served(self, number: int) -> None:
        """Note that the server has run: the answer now needs only this client's own callback."""
        if number in self._open:
            self._open[number].needs = self._open[number].needs[-1:]

    def _reply(self, sample: Sample) -> None:
        # All clients of a service read one reply topic: each takes its own answers.
        client, number, answer = sample.value
        if client is self and number in self._open:
            self._open.pop(number).set(answer)


@dataclass
class Goal:
    """A goal at its server.

    Attributes:
        value: what the client sent.
        end: a future of (status, result).
        feedback: sends a message to the client.
        status: "executing", "canceling", "canceled", "succeeded" or "aborted".
    """

    value: Any
    end: Future
    feedback: Callable[[Any], Any]
    status: str = "executing"


class ActionClient:
    """Sends goals to the server of an action.

    Args:
        feedback: called with a goal's key and the server's messages while it runs.
    """

    def __init__(self, node: Node, name: str, feedback: Callable | None = None) -> None:
        self._sent = 0
        parts = ("goal", "cancel", "result")
        self._goal, self._cancel, self._result = (node.client(f"{name}/{part}") for part in parts)

        def news(sample: Sample) -> None:
            key, value = sample.value
            if feedback and key[0] is self:
                feedback(key, value)

        node.reader(f"{name}/feedback", news)

    def send(self, goal: Any) -> tuple[Any, Future]:
        """Send a goal; return its key and a future of (status, result), set once it has ended."""
        self._sent += 1
        key, answer = (self, self._sent), Future()
        accepted = self._goal.call((key, goal))
        # A result is requested once the goal is accepted, as the protocol of ROS 2 actions does.
        accepted.then(lambda _: self._result.call(key).then(answer.set))
        return key, answer

    def cancel(self, key: Any) -> Future:
        """Ask to end a goal early; the answer is whether it still runs."""
        return self._cancel.call(key)


def _match(writer: Writer, reader: Reader) -> None:
    # Request-offered matching: an incompatible pair is no match, and both ends are notified.
    failing = compatible(writer.qos, reader.qos)
    if not failing:
        writer.matches.append(_Match(writer, reader))
    for end in (writer, reader) if failing else ():
        writer.bus.notify(end, "incompatible", failing)


def _deadline(end: Writer | Reader) -> _Watch | None:
    return None if end.qos.deadline == math.inf else _Watch(end, end.qos.deadline, True)
