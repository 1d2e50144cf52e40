"""The matrix of quality of service: each row run on Cyclone DDS, beside it what we say.

`matrix()` is all of it, 90 rows in 3 s, most of which is waiting: `pair_rows` who hears whom,
`kept_rows` what is kept, `event_rows` what comes of time, strength and order. One process, so a
sample is with its readers as soon as it is written. Nothing here depends on how fast the machine
is: what time does is waited for, and repeated where the machine stalled in between.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise, product
from typing import Any

from course.check import count
from course.middleware.qos import ORDERS, SAME, QoS, compatible
from course.oracles.cyclonedds import Topic, participant, take, until, verdicts

RELIABLE, LATE = QoS(), QoS(durability="transient_local")
SHORT, LONG = 0.05, 30.0  # s: runs out in a test, and does not
_TIMES = (0.05, 0.1, math.inf)


@dataclass(frozen=True)
class Row:
    """One row.

    Attributes:
        policy: what is varied.
        offered, requested: the writer's and the reader's value, or what was done.
        cyclone, ours: what came of it on Cyclone DDS, and what the course's functions say.
        named: the policy that Cyclone's events name at both ends; "" where nothing fails.
        agree: whether the two say the same.
    """

    policy: str
    offered: str
    requested: str
    cyclone: str
    ours: str
    named: str = ""

    @property
    def agree(self) -> bool:
        """Return whether Cyclone DDS and the course reach the same verdict."""
        return self.cyclone == self.ours


def pairs() -> list[tuple[str, QoS, QoS]]:
    """Return every pair of values of every policy with a request.

    Three pairs follow in which several policies fail.
    """
    values: dict[str, tuple[Any, ...]] = {
        **ORDERS,
        **SAME,
        "deadline": _TIMES,
        "liveliness_lease_duration": _TIMES,
    }
    result = [
        (name, replace(RELIABLE, **{name: a}), replace(RELIABLE, **{name: b}))
        for name, kinds in values.items()
        for a, b in product(kinds, repeat=2)
    ]
    sensor, command = QoS("best_effort", depth=5), replace(LATE, deadline=0.1)
    result.append(("several", sensor, command))
    result.append(("several", command, sensor))
    result.append(("several", RELIABLE, replace(command, liveliness="manual_by_topic")))
    return result


def pair_rows() -> list[Row]:
    """Return who hears whom: both verdicts, and the policy that Cyclone names.

    Cyclone's event names one policy only, the first that it found. Where several fail, ours names
    all; the row agrees if Cyclone's is among them, and both ends say the same.
    """
    rows = []
    listed = pairs()
    for (name, offered, requested), result in zip(
        listed, verdicts([pair[1:] for pair in listed]), strict=True
    ):
        failing = compatible(offered, requested)
        one = result.writer == result.reader and result.matched == (result.delivered == 1)
        message = result.writer if one else f"{result.writer} / {result.reader}"
        cyclone = "heard" if result.matched and one and not message else f"silent: {message}"
        ours = "heard" if not failing else f"silent: {', '.join(failing)}"
        # Naming one of several failing policies counts as agreement.
        if message in failing:
            cyclone = ours
        shown = _label(name, offered), _label(name, requested)
        rows.append(Row(name, *shown, cyclone, ours, message))
    return rows


def _label(name: str, qos: QoS) -> str:
    if name != "several":
        value = getattr(qos, name)
        return f"{value:g} s" if isinstance(value, float) else value
    units = {"depth": "depth {}", "deadline": "deadline {:g} s"}
    return (
        ", ".join(
            units.get(field, "{}").format(value)
            for field, value in vars(qos).items()
            if value != getattr(RELIABLE, field)
        )
        or "default"
    )


# --- What is kept ---------------------------------------------------------------------------------


def history(
    offered: QoS,
    requested: QoS,
    samples: int,
    *,
    late: bool = False,
    kept_for_late: int | None = None,
    keyed: bool = False,
) -> list[int]:
    """Return the numbers of the samples that a reader takes at its first call.

    Args:
        offered: settings of the writer.
        requested: settings of the reader.
        samples: written at once, numbered from 0.
        late: whether the reader comes after them.
        kept_for_late: depth of the durability service, see `cyclonedds.policies`.
        keyed: whether the number is the topic's key.
    """
    with participant() as member:
        topic = Topic(member, keyed)
        writer = topic.writer(offered, kept_for_late)
        reader = None if late else topic.reader(requested)
        topic.write(writer, *range(count("samples", samples, 1)))
        return take(reader or topic.reader(requested))


def expected(offered: QoS, requested: QoS, samples: int, late: bool, retained: float) -> list[int]:
    """Return what is left of 0, 1, .

    The last of them, as many as the least of the depths allows.

    A reader that was there is bound by its own depth. One that comes late gets something only if
    both ends are reliable and transient-local, and no more than the writer kept for late ones.
    """
    if compatible(offered, requested):
        return []
    ends = (offered, requested)
    past = all(q.reliability == "reliable" and q.durability != "volatile" for q in ends)
    largest = (
        requested.history_depth
        if not late
        else min(requested.history_depth, retained)
        if past
        else 0
    )
    return list(range(samples))[int(samples - min(samples, largest)) :]


def kept_rows(samples: int = 8) -> list[Row]:
    """Return depths, and late joiners."""
    rows = []
    for reliability, depth in product(ORDERS["reliability"], (1, 3, 5)):
        for writer, reader in ((10, depth), (depth, 10)):
            ends = QoS(reliability, depth=writer), QoS(reliability, depth=reader)
            rows.append(_kept_row("depth", *ends, samples, late=False))
    whole = replace(LATE, history="keep_all")
    for offered, requested in (
        (replace(LATE, depth=3), LATE),
        (LATE, replace(LATE, depth=2)),
        (whole, whole),
        (LATE, RELIABLE),
        (RELIABLE, RELIABLE),
        (RELIABLE, LATE),
        (LATE, replace(LATE, reliability="best_effort")),
        (replace(LATE, reliability="best_effort"), replace(LATE, reliability="best_effort")),
    ):
        rows.append(_kept_row("late joiner", offered, requested, samples, late=True))
    for offered, retained in ((replace(LATE, depth=3), 0), (whole, 0), (replace(LATE, depth=1), 5)):
        rows.append(_kept_row("late joiner", offered, LATE, samples, late=True, retained=retained))
    return rows


def _kept_row(
    policy: str, offered: QoS, requested: QoS, samples: int, late: bool, retained: int | None = None
) -> Row:
    result = history(offered, requested, samples, late=late, kept_for_late=retained)
    # Cyclone's own default of the durability service is to keep the last one.
    depth = offered.history_depth if retained is None else retained or 1
    service = (
        "" if retained is None else f", service {depth}" if retained else ", service as by default"
    )
    text = [_label("several", qos) for qos in (offered, requested)]
    ours = expected(offered, requested, samples, late, depth)
    return Row(policy, text[0] + service, text[1], f"{result}", f"{ours}")


# --- What time does -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Missed:
    """Events of missed deadlines: at the writer, at the reader, and how many there have to be.

    Cyclone counts when its timer thread runs, so a machine that is busy elsewhere delays events,
    and a sample that is written meanwhile cancels them. No event is ever early, though.

    Attributes:
        offered, requested: events at the writer and at the reader.
        least: one for each whole deadline in each nominal gap. A gap ends only after they came.
        at_most: one for each whole deadline in each gap as the clock measured it.
        deadline, gap: nominal [s].
    """

    offered: int
    requested: int
    least: int
    at_most: int
    deadline: float
    gap: float

    @property
    def disturbed(self) -> bool:
        """Return whether the gaps became too long to predict a single number of events."""
        return self.least != self.at_most

    @property
    def possible(self) -> bool:
        """Return whether both counts are possible, which a disturbed run has to satisfy as well."""
        return all(self.least <= n <= self.at_most for n in (self.offered, self.requested))


def missed(deadline: float = SHORT, gap: float = 1.5 * SHORT, gaps: int = 5) -> Missed:
    """Write with gaps in which whole deadlines pass, and wait in each for their events.

    Args:
        deadline: that both ends have agreed on [s].
        gap: the least time between two samples [s]. Half a deadline beyond the last whole one is
            the widest margin for a machine that is late or early.
        gaps: how many.
    """
    qos = QoS(deadline=deadline)
    each = math.floor(gap / deadline)
    with participant() as member:
        topic = Topic(member)
        writer, reader = topic.writer(qos), topic.reader(qos)

        def events() -> tuple[int, int]:
            return (
                writer.get_offered_deadline_missed_status().total_count,
                reader.get_requested_deadline_missed_status().total_count,
            )

        def counted(due: int) -> bool:
            return min(events()) >= due

        times = []
        for number in range(count("gaps", gaps, 1) + 1):
            # Clock before and after each write: the true gap lies between two bounds.
            before = time.monotonic()
            topic.write(writer, number)
            times.append((before, time.monotonic()))
            if number < gaps:
                due = min(events()) + each
                time.sleep(gap)
                until(partial(counted, due))
        ends = events()
        # The last gap is that between the last sample and the reading of the counts.
        times.append((time.monotonic(),) * 2)
    largest = sum(math.floor((b[1] - a[0]) / deadline) for a, b in pairwise(times))
    return Missed(*ends, each * gaps, largest, deadline, gap)


def missed_undisturbed(
    deadline: float = SHORT, gap: float = 1.5 * SHORT, gaps: int = 5, tries: int = 6
) -> Missed:
    """Repeat `missed`, each time with twice the deadline and gap, until nothing disturbed it.

    The law, one event for each whole deadline in a gap, does not depend on the deadline, and a
    longer one leaves more time for the machine. The last try's deadline is 32 times the first.

    Returns:
        The first run that the machine did not disturb or in which a count is impossible; else the
        last one.
    """
    for turn in range(count("tries", tries, 1)):
        result = missed(2**turn * deadline, 2**turn * gap, gaps)
        if not (result.disturbed and result.possible):
            break
    return result


def silence(qos: QoS, seconds: float = 4 * SHORT, tries: int = 100) -> tuple[int, int, int]:
    """Run a writer that writes once, is silent, and writes once more.

    Args:
        qos: of both ends, with a lease.
        seconds: of silence at least; a writer that has to speak for itself is waited for longer,
            until it is lost.
        tries: how often to start again when the machine stalled for a whole lease between two
            calls, so that the lease ran out there.

    Returns:
        How often the writer was told that it lost its liveliness, and how many writers its reader
        took to be alive after the silence and after the second sample.

    Raises:
        TimeoutError: the machine stalled in every try.
    """
    for _ in range(count("tries", tries, 1)):
        if result := _silence(qos, seconds):
            return result
    lease = qos.liveliness_lease_duration
    raise TimeoutError(f"the machine stalled for {lease:g} s in each of {tries} tries")


def _silence(qos: QoS, seconds: float) -> tuple[int, int, int] | None:
    """Return one run of `silence`, or None if the lease of a manual writer ran out in a stall."""
    lease = qos.liveliness_lease_duration
    manual = qos.liveliness != "automatic"
    with participant() as member:
        topic = Topic(member)
        start = time.monotonic()
        writer, reader = topic.writer(qos), topic.reader(qos)
        topic.write(writer, 0)
        if manual and time.monotonic() - start >= lease:
            return None
        time.sleep(seconds)

        def status() -> tuple[int, int]:
            return (
                writer.get_liveliness_lost_status().total_count,
                reader.get_liveliness_changed_status().alive_count,
            )

        if manual:
            # When either end notices that the lease ran out is not fixed.
            until(lambda: status()[0] > 0 and status()[1] == 0)
        lost, alive = status()
        start = time.monotonic()
        topic.write(writer, 1)
        result = lost, alive, status()[1]
        return None if manual and time.monotonic() - start >= lease else result


def _is_empty(reader: Any) -> bool:
    return not reader.read(3)


def event_rows() -> list[Row]:
    """Return lifespan, deadline, liveliness, ownership by strength, and order by source time."""
    rows = []
    for lifespan, expected in ((SHORT, 0), (LONG, 3), (math.inf, 3)):
        with participant() as member:
            topic = Topic(member)
            writer = topic.writer(replace(RELIABLE, lifespan=lifespan))
            reader = topic.reader(RELIABLE)
            topic.write(writer, 0, 1, 2)
            time.sleep(3 * SHORT)
            if lifespan <= 3 * SHORT:
                # When Cyclone's timer thread removes what has expired is not fixed.
                until(partial(_is_empty, reader))
            result = len(take(reader))
        observed = f"looked after {3 * SHORT:g} s"
        rows.append(
            Row("lifespan", f"{lifespan:g} s", observed, f"{result} of 3", f"{expected} of 3")
        )
    for deadline in (SHORT, LONG):
        report = missed_undisturbed(deadline, 0.12, 5)
        text = "{} events at the writer, {} at the reader"
        cyclone = text.format(report.offered, report.requested)
        ours = (
            f"{report.least} to {report.at_most} at each"
            if report.disturbed
            else text.format(report.least, report.at_most)
        )
        shown = f"five gaps of {report.gap:g} s"
        rows.append(Row("deadline missed", f"{report.deadline:g} s", shown, cyclone, ours))
    for kind in ORDERS["liveliness"]:
        known = (0, 1, 1) if kind == "automatic" else (1, 0, 1)
        both = silence(QoS(liveliness=kind, liveliness_lease_duration=SHORT)), known
        cyclone, ours = (f"lost {a}, alive {b}, then {c}" for a, b, c in both)
        rows.append(Row("liveliness lost", kind, "silent, then a sample", cyclone, ours))
    for kind, received in (("shared", [1, 2, 3]), ("exclusive", [1, 2])):
        got = _two_writers(QoS(ownership=kind), (1, 2, 1), (0.0, 0.0, 0.0))
        shown = "1 weak, 2 strong, 3 weak"
        rows.append(Row("ownership strength", kind, shown, f"{got}", f"{received}"))
    for kind, received in zip(ORDERS["destination_order"], ([1, 2, 3], [1, 3]), strict=True):
        got = _two_writers(QoS(destination_order=kind), (1, 2, 1), (0.0, -1.0, 1.0))
        rows.append(Row("order", kind, "stamps 0, -1, 1 s", f"{got}", f"{received}"))
    return rows


def _two_writers(qos: QoS, strengths: tuple[int, ...], stamps: tuple[float, ...]) -> list[int]:
    """Return which of the samples 1, 2, ... a reader gets from writers of these strengths.

    Each sample is stamped with the present time plus its stamp [s].
    """
    exclusive = qos.ownership == "exclusive"
    with participant() as member:
        topic, now = Topic(member), time.time()
        # One writer per strength: the same writer may send more than once.
        writers = {s: topic.writer(qos, strength=s * exclusive) for s in sorted(set(strengths))}
        reader = topic.reader(qos)
        for number, (strength, stamp) in enumerate(zip(strengths, stamps, strict=True), 1):
            topic.write(writers[strength], number, stamp=now + stamp)
        return take(reader)


def matrix() -> list[Row]:
    """Return all rows, run now."""
    return pair_rows() + kept_rows() + event_rows()
