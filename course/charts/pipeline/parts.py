"""Which part owns which millimetre, and whose fault a failure is."""

from collections.abc import Iterator, Sequence

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.measure.work_precision import machine
from course.pipeline import STAGES, Scenario, Settings, repair
from course.pipeline.blame import FAULTS, Fault, confusion, contracts_alone
from course.pipeline.budget import Budget, budget
from course.sim_to_real.transfer import attribution

PARTS = ("perceive", "age", "control", "move")
# Stages as the chapter's text calls them.
NAMES = dict(zip(STAGES, ("perception", "age", "planning", "control", "physics"), strict=True))


def vectors(result: Budget) -> Panel:
    """Return the mean error of each component alone, chained head to tail, and of the whole."""
    panel = Panel(
        "Mean errors of single stages, tip to tail",
        "x [mm]",
        "y [mm]",
        equal=True,
        legend=False,
        footer=machine(0.0),
    )
    at, report = np.zeros(2), np.zeros(2)
    for part in result.parts:
        mean, chance = result.mean(result.only(part))
        # A line of three points: its name stands beside the second.
        path = 1e3 * np.stack((at, at + 0.25 * mean, at + mean), axis=1)
        guess = result.moments[result.only(part)][0]
        words = ", ".join("({:+.2f} {:+.2f})".format(*(1e3 * x)) for x in (mean, chance, guess))
        panel.series.append(
            Series(
                part,
                path[0],
                path[1],
                # A stage that adds nothing has no name in the picture.
                tags=("", NAMES[part] if np.hypot(*mean) > 1e-5 else "", ""),
                marker="",
                note=f"{part} alone, mean, +-, predicted: {words}",
            )
        )
        at, report = at + mean, report + guess
    whole, chance = result.mean(frozenset())
    panel.series += [
        Series(
            "together",
            [1e3 * whole[0]],
            [1e3 * whole[1]],
            style="",
            hollow=True,
            tags=("triangle: together",),
            note="together: ({:+.2f} {:+.2f}) +- ({:.2f} {:.2f}) mm".format(
                *(1e3 * np.array([whole, chance]).ravel())
            ),
        ),
        Series(
            "sum predicted",
            [1e3 * report[0]],
            [1e3 * report[1]],
            "theory",
            style="",
            marker="s",
            tags=("square: predicted",),
            note="predicted: ({:+.2f} {:+.2f}) mm".format(*(1e3 * report)),
        ),
    ]
    gap, chance = result.gap()
    for axis in range(2):
        # Two standard errors of the difference between the end of the chain and the whole.
        away = 2.0 * chance[axis] * np.eye(2)[axis]
        ends = 1e3 * np.stack((whole - away, whole + away), axis=1)
        panel.series.append(Series("", ends[0], ends[1], "theory", marker=""))
    panel.notes.append(
        "sum of the parts minus the whole: ({:+.2f} {:+.2f}) +- ({:.2f} {:.2f}) mm".format(
            *(1e3 * np.array([gap, chance]).ravel())
        )
    )
    return panel


def as_predicted(result: Budget) -> Panel:
    """Return the measured root mean square of every subset against the predicted one."""
    panel = Panel(
        "Every set of real stages, rms error", "predicted [mm]", "measured [mm]", theory="equal"
    )
    rows = {some: (1e3 * result.rms(some)[1], 1e3 * result.rms(some)[0]) for some in result.errors}
    top = max(max(row) for row in rows.values())
    panel.series.append(Series("equal", (0.0, top), (0.0, top), "theory", marker=""))
    for label, ideal in (("perception real", False), ("perception ideal", True)):
        here = sorted(row for some, row in rows.items() if ("perceive" in some) == ideal)
        x, y = np.array(here).T
        panel.series.append(Series(label, x, y, style=""))
    for label, some in [(p, result.only(p)) for p in result.parts] + [("together", frozenset())]:
        panel.notes.append("{}: rms {:.2f} mm, predicted {:.2f}".format(label, *rows[some][::-1]))
    return panel


def owned(result: Budget) -> Panel:
    """Return a stage's part of the squared error: alone, Shapley's average, ideal first."""
    panel = Panel(
        "Parts of the squared error, in three ways",
        "mean squared error [mm$^2$]",
        rows=("if only this stage is real", "Shapley's share", "saved if only it is ideal"),
        ylim=(-2.7, 0.4),
        # Names beside the points: a leader to the margin would look like an error bar.
        legend=False,
    )
    shares, value = result.shares(), attribution(result.squares())
    for lane, (part, (share, low, high)) in enumerate(shares.items()):
        # `attribution` counts from what is there: to be mended last is to be there alone.
        last, _, first = (-1e6 * change for change in value[part])
        x = [first, 1e6 * share, last]
        ends = [[x[0], 1e6 * end, x[2]] for end in (low, high)]
        rows = [-row - 0.15 * lane for row in range(3)]
        message = (
            f"{part}: {x[0]:.1f} alone, share of the total {x[1]:.1f} "
            f"({ends[0][1]:.1f} to {ends[1][1]:.1f}), fixing it first removes {x[2]:.1f}"
        )
        panel.series.append(
            Series(
                NAMES[part],
                x,
                rows,
                style="",
                across=True,
                low=ends[0],
                high=ends[1],
                tags=(NAMES[part],),
                note=message,
            )
        )
    whole = 1e6 * result.squares()[frozenset()]
    panel.notes.append(f"all of it: {whole:.1f} mm^2")
    return panel


@chart(columns=2)
def error_budget(seeds: int = 150) -> Iterator[Panel]:
    """Chart all subsets of the error sources on the same seeds: vectors, prediction and shares."""
    case = repair(Settings(), "plan")
    result = budget(Scenario(), case, range(seeds), PARTS)
    yield vectors(result)
    yield as_predicted(result)
    yield owned(result)


@chart(columns=2)
def whose_fault(desired: int = 20, faults: Sequence[Fault] = FAULTS) -> Iterator[Panel]:
    """Chart ten faults diagnosed blindly: contracts first, replays only, and by the last error."""
    rows, right = np.arange(len(faults)), [STAGES.index(fault.stage) for fault in faults]
    result, taken, last = confusion(desired, faults)
    blind, more, _ = confusion(desired, faults, contracted=False)
    names, total = [fault.name for fault in faults], int(result.sum())
    panel = Panel(
        "Right stage named, by weaker methods",
        "share of failed runs",
        xlim=(0, 1.15),
        footer=machine(0.0),
    )
    replays = Panel("Replays until a stage is named", "mean number", ticks=())
    for label, matrix, runs in (
        ("contracts first", result, taken),
        ("replays only", blind, more),
        ("last error", last, []),
    ):
        hits = matrix[rows, right]
        low, high = (float(end) for end in wilson(int(hits.sum()), total))
        cost = f", {np.mean(np.concatenate(runs)):.2f} replays" if runs else ""
        each = ", ".join(f"{name} {hit}" for name, hit in zip(names, hits, strict=True))
        note = f"{label}: {hits.sum()} of {total} right [{low:.3f} {high:.3f}]{cost}; {each}"
        # A third bar would hide one of the others; contracts first has a panel of its own.
        if label == "last error":
            share = hits / np.maximum(matrix.sum(axis=1), 1)
            panel.series.append(Series(label, share, names, style="bar", note=note))
        else:
            panel.notes.append(note)
        if runs:
            mean = [float(np.mean(some or [0])) for some in runs]
            replays.series.insert(0, Series(label, mean, names, style="bar"))
    alone = contracts_alone(desired, faults)
    for label, hits in zip(("contracts alone", "without the true target"), alone, strict=True):
        low, high = (float(end) for end in wilson(int(hits.sum()), total))
        each = ", ".join(f"{name} {hit}" for name, hit in zip(names, hits, strict=True))
        note = f"{label}: {hits.sum()} of {total} right [{low:.3f} {high:.3f}], no replay; {each}"
        share = hits / np.maximum(result.sum(axis=1), 1)
        if label == "contracts alone":
            panel.notes.append(note)
        else:
            panel.series.append(Series(label, share, names, style="bar", note=note))
    yield panel
    yield replays
    columns = [*(NAMES[stage] for stage in STAGES), "pair with it", "other"]
    # Columns of pairs and others only where there are any.
    used = len(columns) if result[:, len(STAGES) :].any() else len(STAGES)
    for title, matrix, ys in (
        ("Contracts, then replays: stage named", result, names),
        ("Largest error at the end: stage named", last, [""] * len(names)),
    ):
        panel = Panel(
            title,
            ticks=tuple(range(used)),
            tick_names=columns[:used],
            rows=ys,
            xlim=(-0.5, used - 0.3),
            ylim=(-len(faults) + 0.5, 0.6),
        )
        i, j = np.nonzero(matrix)
        good = np.array(right)[i] == j
        for label, some in (("right", good), ("wrong", ~good)):
            tags = [str(n) for n in matrix[i[some], j[some]]]
            panel.series.append(Series(label, j[some], -i[some], style="", tags=tags))
        yield panel
