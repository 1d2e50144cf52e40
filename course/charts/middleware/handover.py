"""How long a reader waits for the newest value: without a lock, and with two kinds of lock."""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.middleware import handover

TITLES = {
    "alone": "Reader and writer, a core each",
    "loaded": "Beside two busy threads on each core",
    "preempted": "A busy thread beside the writer only",
    "writer": "The writer, beside two busy threads",
}


@chart(columns=2)
def handover_waits(seconds: float = 2.0, rounds: int = 3) -> Iterator[Panel]:
    """Chart how long a reader and a writer take that share a trajectory, up to the worst case.

    Args:
        seconds: of a run.
        rounds: of all runs in turn; of each quantile, the median over the rounds, and of the worst
            case the largest.
    """
    with tempfile.TemporaryDirectory() as folder:
        program = handover.build(Path(folder))
        # All methods and scenarios in turn, so that a disturbance does not meet one of them only.
        runs: dict[tuple[str, str], list[handover.Latency]] = {
            (scenario, method): [] for scenario in handover.SCENARIOS for method in handover.METHODS
        }
        for _ in range(rounds):
            for key, made in runs.items():
                made.append(handover.latency(program, key[1], key[0], seconds))
    urgent = all(one.urgent for made in runs.values() for one in made)
    ticks = list(range(len(handover.SHARES)))
    for scenario, title in TITLES.items():
        panel = Panel(
            title,
            "share of the calls below",
            "time of a call [s]",
            scale="log y",
            ticks=ticks,
            tick_names=("50 %", "99 %", "99.9 %", "all"),
            xlim=(-0.3, len(ticks) - 0.3),
            lines=[("y", 5e-4, "a period of 2 kHz")] if scenario != "writer" else [],
            footer=machine(0.0, libraries=()),
        )
        for method, name in handover.METHODS.items():
            made = runs["loaded" if scenario == "writer" else scenario, method]
            rows = np.array([one.written if scenario == "writer" else one.read for one in made])
            y = np.append(np.median(rows[:, :-1], axis=0), rows[:, -1].max())
            calls = sum(one.writes if scenario == "writer" else one.reads for one in made)
            text = ", ".join(f"{1e6 * t:.2f}" for t in y)
            panel.series.append(
                Series(
                    name,
                    ticks,
                    y,
                    note=f"{scenario}, {name}: {text} us; {calls} calls",
                )
            )
        if scenario == "alone":
            panel.notes.append(
                "the reader runs under SCHED_FIFO" if urgent else "SCHED_FIFO was refused"
            )
            panel.notes.append("times below which 50 %, 99 %, 99.9 % and all of the calls lie")
        yield panel
