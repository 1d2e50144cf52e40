"""What theory says of lost packets, task sets, locks and executors, and what runs show."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.measure.work_precision import machine
from course.middleware import Bus, Link, QoS, inversion, schedule
from course.middleware.executor import ORDERS, Work, bounds, respond
from course.middleware.transport import expected_loss, expected_rounds, lossy

PACKET = 1472  # bytes


def on_the_bus(messages: int, packets: int, loss: float, reliability: str, seed: int) -> float:
    """Return the share of messages that the bus loses, or under "reliable" its mean rounds."""
    bus, link = Bus(seed), Link(loss=loss, fragment=PACKET)
    qos = QoS(reliability, history="keep_all")
    writer = bus.node("camera").writer("image", qos)
    reader = bus.node("perception").reader("image", None, qos, link)
    for _ in range(messages):
        writer.publish(None, packets * PACKET)
    # Long enough for all rounds; the link itself takes no time.
    bus.run(1.0)
    if reliability == "reliable":
        return 1.0 + reader.rounds / messages
    return reader.lost / messages


@chart(columns=2)
def lost_fragments(messages: int = 4000, sent: int = 150) -> Iterator[Panel]:
    """Chart a message is lost with any of its packets; sent again, it takes rounds.

    Args:
        messages: on the bus, at each size.
        sent: over a loopback socket.
    """
    sizes = np.array([1, 10, 100, 627, 2000])
    lost = Panel(
        "A message is lost with any packet",
        "packets of a message",
        "share lost",
        scale="log",
        footer=machine(0.0, libraries=()),
    )
    turns = Panel(
        "Reliable: rounds until all are there", "packets of a message", "rounds", scale="log x"
    )
    for p in (1e-4, 1e-3):
        rate = np.array([on_the_bus(messages, n, p, "best_effort", 5) for n in sizes.tolist()])
        # Wilson's interval, which also holds for shares near 0.
        low, high = wilson(messages * rate, messages)
        report = partial(expected_loss, loss=p)
        theory = np.array([report(n) for n in sizes.tolist()])
        note = ", ".join(
            f"{n}: {100 * r:.2f} % ({100 * t:.2f})"
            for n, r, t in zip(sizes, rate, theory, strict=True)
        )
        observed = rate > 0.0
        lost.series.append(
            Series(
                f"bus, {p:g} of the packets",
                sizes[observed],
                rate[observed],
                low=low[observed],
                high=high[observed],
                style="",
                theory=np.vectorize(report, otypes=[float]),
                note=f"lost of packets {p:g}; of messages by packets (theory): {note}",
            )
        )
        rounds = np.array([on_the_bus(messages, n, p, "reliable", 6) for n in sizes.tolist()])
        report = partial(expected_rounds, loss=p)
        note = ", ".join(
            f"{n}: {r:.3f} ({report(n):.3f})" for n, r in zip(sizes.tolist(), rounds, strict=True)
        )
        turns.series.append(
            Series(
                f"bus, {p:g} of the packets",
                sizes,
                rounds,
                style="",
                theory=np.vectorize(report, otypes=[float]),
                note=f"lost of packets {p:g}; rounds by packets (theory): {note}",
            )
        )
    count = sizes[2:4].tolist()
    # The same over a real socket, where packets are dropped at random before sending.
    real = [lossy(sent, n, 1e-3, 7) for n in count]
    share = np.array([each.lost for each in real])
    low, high = wilson(sent * share, sent)
    lost.series.append(
        Series(
            "socket, 0.001",
            count,
            share,
            style="",
            low=low,
            high=high,
            hollow=True,
            note="socket, 0.001: "
            + ", ".join(f"{n}: {100 * x:.1f} %" for n, x in zip(count, share, strict=True)),
        )
    )
    turns.series.append(
        Series(
            "socket, 0.001",
            count,
            [each.rounds for each in real],
            style="",
            hollow=True,
            note="socket, 0.001: "
            + ", ".join(f"{n}: {each.rounds:.3f}" for n, each in zip(count, real, strict=True)),
        )
    )
    yield lost
    yield turns


@chart(columns=2)
def task_sets(sets: int = 1000, seconds: float = 4.0) -> Iterator[Panel]:
    """Chart which task sets are in time: three tests, and a scheduler that runs them.

    Args:
        sets: random sets of each size and load.
        seconds: of a run.
    """
    rng, n = np.random.default_rng(10), 5
    loads = np.linspace(0.6, 1.0, 17)
    tests = "Liu and Layland", "hyperbolic", "exact", "run"
    shares: dict[str, list[float]] = {name: [] for name in tests}
    worst = 0.0
    for load in loads.tolist():
        # Random sets at a given utilisation, so that every load has as many.
        C, T = schedule.random_sets(n, load, sets, rng, ratio=10.0)
        report = schedule.response_times(C, T)
        ran = schedule.run(C, T, seconds)
        fits = np.isfinite(report).all(axis=0)
        in_time = ~ran.late.any(axis=0)
        shares["Liu and Layland"].append(
            float(np.mean(schedule.utilization(C, T) <= schedule.liu_layland(n)))
        )
        shares["hyperbolic"].append(float(np.mean(schedule.hyperbolic(C, T))))
        shares["exact"].append(float(np.mean(fits)))
        shares["run"].append(float(np.mean(in_time)))
        # The analysis is exact: a run from the critical instant must show the same longest
        # response.
        worst = max(
            worst, float(np.max(np.abs(ran.longest[:, fits] - report[:, fits]), initial=0.0))
        )
    low = schedule.liu_layland(n)
    panel = Panel(
        f"{n} tasks: sets that a test accepts",
        "utilization",
        "share of sets accepted",
        lines=[("x", low, "bound of Liu and Layland")],
        footer=machine(0.0, libraries=()),
    )
    panel.notes.append(
        f"largest difference of a run's longest response from the analysis: "
        f"{1e9 * worst:.0f} ns, of {len(loads) * sets} sets"
    )
    for name, values in shares.items():
        panel.series.append(
            Series(
                name,
                loads,
                values,
                style="" if name == "run" else "-",
                hollow=name == "run",
                marker=None if name == "run" else "",
                note=f"{name}: in time at 0.8 {values[8]:.3f}, at 0.9 {values[12]:.3f}",
            )
        )
    yield panel
    counts = (2, 3, 5, 10, 20)
    broken = Panel(
        "Breakdown utilization",
        "tasks",
        "utilization at the first miss",
        scale="log x",
        ticks=counts,
    )
    rows = []
    for size in counts:
        C, T = schedule.random_sets(size, 0.5, sets, rng)
        rows.append(np.quantile(schedule.breakdown(C, T), (0.05, 0.5, 0.95)))
    fifth, middle, largest = np.array(rows).T
    note = ", ".join(
        f"{k}: {a:.3f} {b:.3f} {c:.3f}" for k, (a, b, c) in zip(counts, rows, strict=True)
    )
    broken.series.append(
        Series(
            "random sets",
            counts,
            middle,
            low=fifth,
            high=largest,
            note=f"5 %, median and 95 % by tasks: {note}",
        )
    )
    bound = [schedule.liu_layland(k) for k in counts]
    note = f"bound at 2 {bound[0]:.3f}, at 20 {bound[-1]:.3f}"
    broken.series.append(Series("Liu and Layland", counts, bound, style="--", marker="", note=note))
    yield broken


@chart(columns=2)
def lock_waits(middles: Sequence[float] = (0.0, 0.02, 0.05, 0.1, 0.15)) -> Iterator[Panel]:
    """Chart how long the most urgent task waits for a lock of the least urgent one.

    Args:
        middles: what the task between them computes [s].
    """
    holds, phase = 0.02, np.array([1e-6, 2e-6, 0.0])
    panel = Panel(
        "A lock of 20 ms, and a task in the middle",
        "the middle task computes [ms]",
        "the most urgent one waits [ms]",
        footer=machine(0.0, libraries=()),
    )
    x = 1e3 * np.array(middles)
    for protocol in schedule.PROTOCOLS:
        waits = []
        for middle in middles:
            # High, middle and low priority; the low task holds the lock first.
            C, T = np.array([1e-3, max(middle, 1e-6), 0.03]), np.array([1.0, 1.0, 1.0])
            ran = schedule.run(
                C,
                T,
                0.99,
                phase,
                before=[0.0, 0.0, 0.0],
                lock=[0, -1, 0],
                section=[1e-3, 0.0, holds],
                protocol=protocol,
            )
            waits.append(1e3 * float(ran.longest[0] - C[0]))
        message = ", ".join(f"{a:g}: {b:.1f}" for a, b in zip(x, waits, strict=True))
        panel.series.append(
            Series(protocol, x, waits, note=f"{protocol}, in virtual time: {message}")
        )
    for inherit in (False, True):
        observed = [inversion.measure(inherit, holds, middle) for middle in middles]
        name = "this system, inheritance" if inherit else "this system, none"
        # Real-time priorities may not be granted; then only the simulated curves are drawn.
        if observed[0].denied:
            panel.notes.append(f"{name}: {observed[0].denied}")
            continue
        waits = [1e3 * each.wait for each in observed]
        message = ", ".join(
            f"{a:g}: {b:.1f} ({1e3 * each.theory:.0f})"
            for a, b, each in zip(x, waits, observed, strict=True)
        )
        panel.series.append(
            Series(
                name, x, waits, style="", hollow=True, note=f"{name}, measured (theory): {message}"
            )
        )
    yield panel


@chart(columns=2)
def executor_waits(
    cameras: Sequence[float] = (0.005, 0.010, 0.015, 0.020, 0.025), phases: int = 12
) -> Iterator[Panel]:
    """Chart response times of a 1 ms control callback next to a camera's, and their bound.

    Args:
        cameras: what the camera's callback computes [s].
        phases: how many times of its first event are tried.
    """
    x = 1e3 * np.array(cameras)
    panel = Panel(
        "One thread: control waits for the camera",
        "the camera's callback [ms]",
        "from due to end, at most [ms]",
        theory="bound",
        footer=machine(0.0, libraries=()),
    )
    rng = np.random.default_rng(3)

    def works(camera: float, own: bool) -> list[Work]:
        return [
            # A period that is no divisor of the camera's: the phases drift through all cases.
            Work("control", 1e-3, 0.0313),
            Work("camera", camera, 1 / 30, "subscription", "camera" if own else "default"),
        ]

    rows = [(order, order, 1, False) for order in ORDERS]
    rows.append(("a thread and group of its own", "ready set", 2, True))
    for name, order, threads, own in rows:
        longest, largest = [], []
        for camera in cameras:
            both = works(camera, own)
            # The worst of several phases, since one phase may never meet the blocking.
            runs = [
                respond(both, order, threads, (0.0, float(p)), 3.0)["control"].max()
                for p in rng.random(phases)
            ]
            longest.append(1e3 * max(runs))
            largest.append(1e3 * bounds(both, order, threads)["control"])
        message = ", ".join(
            f"{a:g}: {b:.1f} ({c:.1f})" for a, b, c in zip(x, longest, largest, strict=True)
        )
        panel.series.append(
            Series(
                name,
                x,
                longest,
                style="",
                hollow=order == "fifo",
                size=9.0 if order == "fifo" else 0,
                theory=partial(np.interp, xp=x, fp=largest) if order == "ready set" else None,
                note=f"{name}, at most by camera (bound): {message}",
            )
        )
    yield panel
