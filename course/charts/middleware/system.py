"""What the running system gives: a loop among others, carriers by size, queues, and real QoS."""

import contextlib
import math
from collections.abc import Iterator, Sequence

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.middleware import Bus, Link, QoS, loop, transport

REAL = ("cyclonedds", "eclipse-zenoh")


@chart(columns=2)
def loop_lateness(periods: int = 1500, busy: int = 4, quiet: int = 300) -> Iterator[Panel]:
    """Chart a loop of 1 kHz beside processes that always compute; and what a relative sleep does.

    Args:
        periods: of each run.
        busy: processes that compete for the cores.
        quiet: periods of the runs without them.
    """
    panel = Panel(
        f"1 kHz beside {busy} busy processes",
        "share of the periods that ran",
        "late by [ms]",
        scale="log y",
        lines=[("y", 1.0, "one period")],
        footer=machine(0.0, libraries=()),
    )
    for tried in loop.among_busy(busy=busy, periods=periods):
        # Empirical distribution of the lateness.
        late = np.sort(1e3 * tried.record.lateness)
        share = (np.arange(late.size) + 0.5) / late.size
        rejected = "; ".join(f"{k}: {v}" for k, v in tried.granted.denied.items())
        half, largest, worst = (1e3 * q for q in tried.quantiles)
        panel.series.append(
            Series(
                tried.name,
                share,
                np.maximum(late, 1e-3),
                marker="",
                note=f"{tried.name}: skipped {tried.record.skipped} of {periods} periods; late by "
                f"{half:.3f} ms (half), {largest:.3f} (99 %), {worst:.3f} (all); scheduler "
                f"{tried.granted.scheduler}{'; rejected ' + rejected if rejected else ''}",
            )
        )
    yield panel
    drift = Panel("Two ways to wait", "period", "late by [ms]")
    for relative in (True, False):
        result = loop.run(lambda k: loop.compute(1e-4), 1e-3, quiet, relative=relative)
        late = 1e3 * result.lateness
        # Drift of the lateness with time: what a relative sleep adds in each period.
        slope = float(np.polyfit(result.release, late, 1)[0]) * 1e3
        name = "sleep for a period" if relative else "sleep until the release"
        drift.series.append(
            Series(
                name,
                result.release,
                late,
                marker="",
                note=f"{name}: {slope:.1f} us later each period",
            )
        )
    yield drift


@chart
def round_trips(
    sizes: Sequence[int] = (64, 1024, 16_384, 262_144, 921_600, 4_194_304), repeats: int = 7
) -> Iterator[Panel]:
    """Chart round trips by size, to another process or thread; the unit is 64 B between threads.

    Args:
        sizes: of the payload [bytes].
        repeats: rounds of each.
    """
    from course.oracles import cyclonedds, zenoh

    names = (
        "threads, a queue",
        "Unix socket",
        "shared-memory ring",
        "zenoh, TCP",
        "Cyclone DDS, reliable",
        "Cyclone DDS, sequence",
    )
    times = {name: np.full((3, len(sizes)), np.nan) for name in names}
    for k, size in enumerate(sizes):
        payload = bytes(size)
        with contextlib.ExitStack() as stack:
            paths = transport.carriers(size)
            trips = [stack.enter_context(carrier) for carrier in paths.values()]
            known = [*list(names[: len(trips)]), "zenoh, TCP", "Cyclone DDS, reliable"]
            trips.append(stack.enter_context(zenoh.echo()))
            trips.append(stack.enter_context(cyclonedds.echo(size)))
            if size <= 921_600:  # each byte is an object of Python
                trips.append(stack.enter_context(cyclonedds.echo(size, kind="sequence")))
                known.append("Cyclone DDS, sequence")
            # All carriers of one size are open at the same time and sampled in turn.
            samplers = [calls(trip, payload) for trip in trips]
            result = interleaved(samplers, repeats=repeats, sample=3e-3, at_most=200)
        for name, timing in zip(known, result, strict=True):
            times[name][:, k] = timing.median, timing.low, timing.high
    # The fastest round trip as the unit, so that machines can be compared.
    floor = times[names[0]][0, 0]
    panel = Panel(
        "There and back, to another process or thread",
        "payload [bytes]",
        "time / time of 64 B between threads",
        scale="log",
        footer=machine(0.0, libraries=REAL),
    )
    for name, rows in times.items():
        observed = np.isfinite(rows[0])
        ratio = rows[:, observed] / floor
        message = ", ".join(
            f"{s}: {r:.3g}" for s, r in zip(np.array(sizes)[observed], ratio[0], strict=True)
        )
        panel.series.append(
            Series(
                name,
                np.array(sizes)[observed],
                ratio[0],
                low=ratio[1],
                high=ratio[2],
                note=f"{name}, by bytes: {message}",
            )
        )
    yield panel


@chart(columns=2)
def queue_ages(depths: Sequence[int] = (1, 2, 5, 10, 20), rate: int = 3) -> Iterator[Panel]:
    """Chart how old the sample is that a slow reader takes: on the bus, on Cyclone DDS, by theory.

    Args:
        depths: of the reader's queue.
        rate: samples written for each that is taken.
    """
    from course.oracles import slow_reader

    def on_the_bus(depth: int) -> float:
        bus = Bus()
        qos = QoS("reliable", depth=depth)
        writer = bus.node("writer").writer("t", qos)
        reader = bus.node("reader").reader("t", None, qos)
        for k in range(60 * rate):
            bus.run(float(k))
            writer.publish(k)
            # Half a period later the sample is certainly there: the ages are whole periods.
            bus.run(k + 0.5)  # until it is there
            taken = reader.take() if k % rate == rate - 1 else None
        assert taken is not None
        return float(60 * rate - 1 - taken.value)

    panel = Panel(
        f"The reader takes one of {rate} messages: its age",
        "depth of the reader's queue",
        "least age [periods of the writer]",
        ticks=depths,
        theory="depth - 1",
        footer=machine(0.0, libraries=REAL[:1]),
    )
    theory = {True: "depth - 1", False: "theory"}

    def cyclone(depth: int, newest: bool = False) -> float:
        return float(slow_reader.queue_ages(depth, rate, 40, newest=newest).ages[-1])

    for name, ages, late in (
        ("bus", [on_the_bus(depth) for depth in depths], True),
        ("Cyclone DDS", [cyclone(depth) for depth in depths], True),
        ("all are taken, newest used", [cyclone(depth, True) for depth in depths], False),
    ):
        message = ", ".join(
            f"{d}: {a:g} ({late * (d - 1)})" for d, a in zip(depths, ages, strict=True)
        )
        panel.series.append(
            Series(
                name,
                depths,
                ages,
                style="",
                hollow=name == "bus",
                theory=(lambda d: np.asarray(d) - 1.0) if name == "bus" else None,
                note=f"{name}, age by depth ({theory[late]}): {message}",
            )
        )
    yield panel


@chart
def qos_verdicts() -> Iterator[Panel]:
    """Chart every pair of policies on Cyclone DDS beside ours: a table, without a picture."""
    from course.oracles import qos_matrix

    rows = qos_matrix.matrix()
    panel = Panel(
        "Quality of service, run",
        data=[
            [row.policy, row.offered, row.requested, row.cyclone, row.ours, row.named]
            for row in rows
        ],
    )
    agree = sum(row.agree for row in rows)
    panel.notes.append(f"{agree} of {len(rows)} rows agree with Cyclone DDS")
    for row in rows:
        named = f" ({row.named})" if row.named else ""
        panel.notes.append(f"{row.policy}: {row.offered} -> {row.requested}: {row.cyclone}{named}")
    yield panel


@chart(columns=2)
def late_or_lost(
    paths: Sequence[float] = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2),
    loss: float = 0.05,
    seconds: float = 60.0,
) -> Iterator[Panel]:
    """Chart a servo behind a lossy link: commands sent again and late, or lost and replaced.

    Args:
        paths: delay of the link in one direction [s].
        loss: share of the packets that is lost.
        seconds: of each run.
    """
    panel = Panel(
        f"A command every 10 ms, of which {100 * loss:g} % are lost",
        "delay of the link [ms]",
        "rms error that the loss adds [mrad]",
        scale="log",
        footer=machine(0.0, libraries=()),
    )
    for reliability in ("best_effort", "reliable"):
        errors = [1e3 * added(method, loss, reliability, seconds) for method in paths]
        name = "lost, the next one counts" if reliability == "best_effort" else "sent again"
        message = ", ".join(f"{1e3 * w:g} ms: {e:.3f}" for w, e in zip(paths, errors, strict=True))
        panel.series.append(Series(name, 1e3 * np.array(paths), errors, note=f"{name}: {message}"))
    yield panel


def added(
    delay: float, loss: float, reliability: str, seconds: float, period: float = 0.01
) -> float:
    """Return the rms distance between a servo over a lossy link and one over a lossless link [rad].

    The command is a sine of 0.3 rad at 1 Hz; the servo (60 rad/s, critically damped) holds the
    newest command that it has.
    """
    paths = []
    for share in (loss, 0.0):
        bus, got = Bus(11), [(0.0, 0.0)]
        qos = QoS(reliability, depth=1)
        sender, servo = bus.node("sender"), bus.node("servo")
        writer = sender.writer("command", QoS(reliability, depth=1000))

        def received(sample, bus=bus, got=got):
            got.append((bus.now, sample.value))

        servo.reader("command", received, qos, Link(delay, loss=share))
        sender.timer(
            period,
            lambda bus=bus, writer=writer: writer.publish(
                0.3 * math.sin(2.0 * math.pi * bus.now), 64
            ),
        )
        bus.run(seconds)
        times = np.arange(0.0, seconds, 1e-3)
        when, what = np.array(got).T
        # Zero-order hold of the newest command that has arrived.
        held = what[np.searchsorted(when, times, side="right") - 1]
        q = v = 0.0
        path = np.empty(times.size)
        for k, aim in enumerate(held.tolist()):
            # Critically damped servo, by semi-implicit Euler at 1 ms.
            v += 1e-3 * (3600.0 * (aim - q) - 120.0 * v)
            q += 1e-3 * v
            path[k] = q
        # With and without losses, on the same link: the delay itself cancels in the difference.
        paths.append(path)
    return float(np.sqrt(np.mean((paths[0] - paths[1]) ** 2)))
