"""Which part owns which millimetre, and whose fault a failure is."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

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


def vectors(result: Budget) -> Panel:
    """Return the mean error of each component alone, chained head to tail, and of the whole."""
    panel = Panel("Mean errors add up, with their signs", "x [mm]", "y [mm]", equal=True)
    at, report = np.zeros(2), np.zeros(2)
    for part in result.parts:
        mean, chance = result.mean(result.only(part))
        path, guess = 1e3 * np.stack((at, at + mean), axis=1), result.moments[result.only(part)][0]
        words = ", ".join("({:+.2f} {:+.2f})".format(*(1e3 * x)) for x in (mean, chance, guess))
        panel.series.append(
            Series(part, path[0], path[1], note=f"{part} alone, mean, +-, predicted: {words}")
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
            marker="P",
            note="predicted: ({:+.2f} {:+.2f}) mm".format(*(1e3 * report)),
        ),
    ]
    gap, chance = result.gap()
    panel.notes.append(
        "sum of the parts minus the whole: ({:+.2f} {:+.2f}) +- ({:.2f} {:.2f}) mm".format(
            *(1e3 * np.array([gap, chance]).ravel())
        )
    )
    return panel


def as_predicted(result: Budget) -> Panel:
    """Return root mean square of every subset over what was predicted."""
    panel = Panel(
        "Every subset, measured and predicted", "predicted [mm]", "measured [mm]", theory="equal"
    )
    rows = {some: (1e3 * result.rms(some)[1], 1e3 * result.rms(some)[0]) for some in result.errors}
    for label, ideal in (("with perception", False), ("perception ideal", True)):
        here = sorted(row for some, row in rows.items() if ("perceive" in some) == ideal)
        x, y = np.array(here).T
        panel.series.append(Series(label, x, y, style="", theory=lambda v: v))
    for label, some in [(p, result.only(p)) for p in result.parts] + [("together", frozenset())]:
        panel.notes.append("{}: rms {:.2f} mm, predicted {:.2f}".format(label, *rows[some][::-1]))
    return panel


def owned(result: Budget) -> Panel:
    """Return the same part asked three times: alone, Shapley's average, last."""
    panel = Panel(
        "What each part owns of the square",
        "0 it alone, 1 Shapley, 2 mended first",
        "mean squared error [mm$^2$]",
        ticks=(0, 1, 2),
    )
    shares, value = result.shares(), attribution(result.squares())
    for part, (share, low, high) in shares.items():
        # `attribution` counts from what is there: to be mended last is to be there alone.
        last, _, first = (-1e6 * change for change in value[part])
        y = [first, 1e6 * share, last]
        ends = [[y[0], 1e6 * end, y[2]] for end in (low, high)]
        message = (
            f"{part}: {y[0]:.1f} alone, {y[1]:.1f} [{ends[0][1]:.1f} {ends[1][1]:.1f}] owned, "
        )
        message += f"{y[2]:.1f} saved by mending it first"
        panel.series.append(Series(part, (0, 1, 2), y, low=ends[0], high=ends[1], note=message))
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
    case = replace(case, noise=0.0005, bias=(-0.0035, 0.0026))
    two = budget(
        Scenario(), repair(case, "age"), range(max(2, seeds // 10)), ("perceive", "control")
    )
    names = {
        "neither mended": (),
        "perception": ("perceive",),
        "control": ("control",),
        "both": ("perceive", "control"),
    }
    rms = [1e3 * math.sqrt(two.squares()[frozenset(some)]) for some in names.values()]
    panel = Panel(
        "Errors that cancel: what is mended",
        "rms of the error [mm]",
        xlim=(0, 5),
        footer=machine(0.0),
    )
    message = ", ".join(f"{name} {x:.2f}" for name, x in zip(names, rms, strict=True))
    message += f" mm; orders of repairs that never make it worse: {len(two.orders())}"
    panel.series.append(
        Series(
            "",
            rms,
            list(names),
            style="bar",
            tags=[f"{x:.2f}" for x in rms],
            note=f"errors that cancel, mended: {message}",
        )
    )
    yield panel


@chart(columns=2)
def whose_fault(desired: int = 20, faults: Sequence[Fault] = FAULTS) -> Iterator[Panel]:
    """Chart ten faults diagnosed blindly: contracts first, replays only, and by the last error."""
    rows, right = np.arange(len(faults)), [STAGES.index(fault.stage) for fault in faults]
    result, taken, last = confusion(desired, faults)
    blind, more, _ = confusion(desired, faults, contracted=False)
    names, total = [fault.name for fault in faults], int(result.sum())
    panel = Panel(
        "Named the right stage", "share of failing runs", xlim=(0, 1.15), footer=machine(0.0)
    )
    replays = Panel("Replays of a diagnosis", "mean number", ticks=())
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
        if label != "replays only":
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
    columns = "0 perceive, 1 age, 2 plan, 3 control, 4 move, 5 pair with it, 6 other"
    for title, matrix in (("Confusion: contracts first", result), ("Confusion: last error", last)):
        panel = Panel(
            title,
            columns,
            "fault, from above",
            ticks=tuple(range(len(STAGES) + 2)),
            xlim=(-0.5, 7.0),
            ylim=(-len(faults) + 0.5, 0.6),
        )
        i, j = np.nonzero(matrix)
        good = np.array(right)[i] == j
        for label, some in (("right", good), ("wrong", ~good)):
            tags = [str(n) for n in matrix[i[some], j[some]]]
            panel.series.append(Series(label, j[some], -i[some], style="", tags=tags))
        yield panel
