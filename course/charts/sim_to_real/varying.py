"""Arms that differ in every episode: six methods on the same arms; and models of an actuator."""

import time
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.learning import one_thread
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.sim_to_real import actuator_network as an
from course.sim_to_real import varying_arms as va

Array = NDArray[np.float64]
LOST = 100.0  # an arm with a larger error shakes instead of following [mrad]


def percentiles(values: Sequence[Array]) -> list[float]:
    """Return median, 10th and 90th percentile of all values together."""
    return np.percentile(np.concatenate(values), [50, 10, 90]).tolist()


@chart(height=4.0)
def varying_arms(
    seeds: int = 6,
    n: int = 24,
    loads: Sequence[float] = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0),
    lengths: Sequence[int] = (1, 3, 20),
    updates: int = 400,
    repeats: int = 15,
    dampings: Sequence[float] = tuple(np.geomspace(4.0, 300.0, 24)),
) -> Iterator[Panel]:
    """Chart six methods on arms whose load and friction vary, each tuned and tested per seed.

    Args:
        seeds: of tuning, training, and test arms.
        n: test arms of a seed.
        loads: of the second panel [kg].
        lengths: entries of the history in the third panel; the last is the student's own.
        updates: steps of Adam in a round of training.
        repeats: of timing.
        dampings: of the fourth panel [1/s].
    """
    within: dict[str, list[Array]] = {}
    over: dict[str, list[list[Array]]] = {}
    noise = {"noise as in training": va.NOISE, "5 times the noise": 5.0 * va.NOISE}
    short: dict[str, list[list[Array]]] = {label: [[] for _ in lengths] for label in noise}
    tuned = []
    for seed in range(seeds):
        methods = va.tune_methods(seed, 12)
        tuned.append(methods)
        students = [
            va.train_student(methods.teacher, seed, entries=entries, updates=updates)
            for entries in lengths
        ]
        rng = np.random.default_rng([seed, 3])
        arms, paths = va.family(n, rng), va.references(n, rng)
        for name, errors in va.compare(methods, students[-1], arms, paths, seed=seed).items():
            within.setdefault(name, []).append(1e3 * errors)
        few, their = va.family(8, rng), va.references(8, rng)
        for i, load in enumerate(loads):
            few[:, 0] = load
            for name, errors in va.compare(methods, students[-1], few, their, seed=seed).items():
                over.setdefault(name, [[] for _ in loads])[i].append(1e3 * errors)
        for label, spread in noise.items():
            for rows, student in zip(short[label], students, strict=True):
                run = va.track(
                    arms, methods.teacher, paths, student=student, noise=spread, seed=seed
                )
                rows.append(1e3 * run.error)
    runs = {
        "one tuned gain set": partial(va.track, arms, methods.nominal, paths),
        "randomised gains": partial(va.track, arms, methods.randomised, paths),
        "adaptive law": partial(va.track, arms, methods.adaptive, paths, rate=methods.rate),
        "student with history": partial(
            va.track, arms, methods.teacher, paths, student=students[-1]
        ),
        "teacher": partial(va.track, arms, methods.teacher, paths, estimate=arms),
    }
    timed = interleaved(
        [calls(run, clock=time.process_time) for run in runs.values()], repeats=repeats
    )
    periods = paths.shape[0] * paths.shape[1]
    cost = {k: 1e9 * t.median / periods for k, t in zip(runs, timed, strict=True)}
    # In hindsight an arm runs one gain set; the search for it needs them all.
    cost["best gains in hindsight"] = cost["randomised gains"]
    panel = Panel(
        "Tracking error and computing time",
        "error, median and 10 to 90 % [mrad]",
        "computing time of a control period [ns]",
        scale="log x",
    )
    for name, parts in within.items():
        middle, low, high = percentiles(parts)
        every = np.concatenate(parts)
        note = (
            f"{name}: median {middle:.1f} mrad, nine of ten arms below {high:.1f}, mean "
            f"{every.mean():.1f}; {np.mean(every > LOST):.1%} of the arms above {LOST:g}; "
            f"{cost[name]:.0f} ns"
        )
        panel.series.append(
            Series(
                name,
                [middle],
                [cost[name]],
                name,
                style="",
                low=[low],
                high=[high],
                across=True,
                note=note,
            )
        )
    bound = within["best gains in hindsight"]
    for name in ("teacher", "student with history", "randomised gains"):
        share = np.mean(np.concatenate(within[name]) < np.concatenate(bound))
        means = sum(a.mean() < b.mean() for a, b in zip(within[name], bound, strict=True))
        panel.notes.append(
            f"{name} below the best fixed gains in hindsight: on {share:.0%} of the arms, and in "
            f"the mean of {means} of {seeds} seeds"
        )
    panel.notes.append(
        "damping by tuning, median of the seeds: "
        + ", ".join(
            f"{name} {np.median([getattr(m, name).damping for m in tuned]):.0f}"
            for name in ("nominal", "randomised", "adaptive", "teacher")
        )
        + " /s"
    )
    yield panel
    panel = Panel(
        "Loads inside and outside of the range",
        "load [kg]",
        "error, median [mrad]",
        scale="log y",
        spans=[("x", float(va.LOW[0]), float(va.HIGH[0]), "range of training")],
    )
    for name, by_load in over.items():
        y = [percentiles(row)[0] for row in by_load]
        note = ", ".join(f"{kg:g} kg {e:.1f}" for kg, e in zip(loads, y, strict=True))
        panel.series.append(Series(name, loads, y, name, note=f"{name} [mrad]: {note}"))
    yield panel
    times = [1e3 * va.DT * va.WINDOW * entries for entries in lengths]
    panel = Panel(
        "Student: a short history, a noisy encoder",
        "length of the history [ms]",
        "error, median and 10 to 90 % [mrad]",
        scale="log",
        ticks=times,
    )
    for label, by_length in short.items():
        parts_of = np.array([percentiles(row) for row in by_length]).T
        note = ", ".join(f"{x:g} ms {y:.1f}" for x, y in zip(times, parts_of[0], strict=True))
        panel.series.append(
            Series(
                label,
                times,
                parts_of[0],
                low=parts_of[1],
                high=parts_of[2],
                note=f"{label} [mrad]: {note}",
            )
        )
    yield panel
    yield limits(dampings)


def limits(dampings: Sequence[float], n: int = 12, slope: float = 10.0) -> Panel:
    """Chart the error over the damping for three loads and one assumed load, with the limits.

    Args:
        dampings: [1/s].
        n: references.
        slope: of the law [1/s].
    """
    panel = Panel(
        "One assumed load, three stability limits",
        "damping [1/s]",
        "error, median [mrad]",
        scale="log",
    )
    paths = va.references(n, np.random.default_rng(5))
    for load in (0.0, 1.0, 2.0):
        arms = np.tile([load, 0.3, 0.0], (n, 1))
        y = [
            1e3 * np.median(va.track(arms, (slope, d, 0.0), paths, estimate=(1.0, 0.3, 0.0)).error)
            for d in dampings
        ]
        limit = va.largest_damping(load, 1.0, slope, 0.3)
        best = int(np.argmin(y))
        note = (
            f"load {load:g} kg, 1 kg assumed: unstable from a damping of {limit:.0f} /s; least "
            f"error {y[best]:.1f} mrad at {dampings[best]:.0f} /s"
        )
        panel.series.append(Series(f"load {load:g} kg", dampings, y, note=note))
        panel.lines = [*panel.lines, ("x", limit, f"limit {load:g} kg")]
    return panel


@chart(height=4.2)
def actuator_models(
    seeds: int = 6,
    n: int = 24,
    updates: int = 3000,
    widths: Sequence[int] = (2, 4, 8, 16, 32, 64),
    few: int = 3,
    repeats: int = 15,
) -> Iterator[Panel]:
    """Chart the torque error of three actuator models, on the recorded drive and off it.

    Args:
        seeds: of recordings and weights.
        n: runs of a recording.
        updates: of the network's fit.
        widths: units in a hidden layer of the networks in the second panel.
        few: seeds of these networks.
        repeats: of timing.
    """
    results = [an.compare(seed, n, updates) for seed in range(seeds)]
    cases = list(an.CASES)
    panel = Panel(
        "On the recorded drive, and off it",
        "torque error, median and 10 to 90 % of the runs [N m]",
        scale="log x",
        rows=cases,
    )
    for k, model in enumerate(results[0][cases[0]]):
        parts = [percentiles([r[case][model] for r in results]) for case in cases]
        middle, low, high = np.array(parts).T
        note = "; ".join(
            f"{case} {row[0]:.2f} (nine of ten below {row[2]:.2f})"
            for case, row in zip(cases, parts, strict=True)
        )
        y = [0.25 * (1 - k) - row for row in range(len(cases))]
        panel.series.append(
            Series(
                model,
                middle,
                y,
                model,
                style="",
                low=low,
                high=high,
                across=True,
                note=f"{model} [N m]: {note}",
            )
        )
    yield panel
    yield sizes(n, updates, widths, few, repeats)


def sizes(n: int, updates: int, widths: Sequence[int], seeds: int, repeats: int) -> Panel:
    """Chart torque error against computing time: networks of several sizes, and both formulas."""
    import torch

    tests, networks, fitted = [], [], []
    for seed in range(seeds):
        rng = np.random.default_rng([seed, 5])
        training = an.record(an.Drive(), an.targets(n, rng))
        tests.append(an.record(an.Drive(), an.targets(n, rng)))
        networks.append([an.fit_network(training, seed, updates=updates, hidden=h) for h in widths])
        fitted.append(an.fit_parametric(training))
    first = tests[0]

    def library(network: an.Network) -> torch.Tensor:
        """Evaluate the same weights with PyTorch, its input prepared by the same function."""
        with torch.no_grad():
            out = torch.from_numpy(an.inputs(first))
            for i, (w, b) in enumerate(layers[id(network)]):
                out = torch.nn.functional.linear(out, w, b)
                out = torch.nn.functional.softsign(out) if i < 2 else out
            return an.TORQUE * out

    layers = {
        id(network): [
            (torch.from_numpy(w[:, :-1].copy()), torch.from_numpy(w[:, -1].copy()))
            for w in network.layers
        ]
        for network in networks[0]
    }
    with one_thread():
        timed = interleaved(
            [
                *(calls(an.predict_torque, network, first) for network in networks[0]),
                *(calls(library, network) for network in networks[0]),
                calls(an.ideal, first),
                calls(an.parametric, first, fitted[0]),
            ],
            repeats=repeats,
        )
        same = [
            np.abs(library(w).numpy().ravel() - an.predict_torque(w, first).ravel()).max()
            for w in networks[0]
        ]
    nanoseconds = [1e9 * t.median / first.torque.size for t in timed]
    k = len(widths)

    def median(predicted: Sequence[Array]) -> float:
        """Return the median error of all runs of all seeds."""
        pairs = zip(predicted, tests, strict=True)
        return float(np.median([an.torque_error(torque, test) for torque, test in pairs]))

    errors = {
        "network": [
            median([an.predict_torque(w[i], r) for w, r in zip(networks, tests, strict=True)])
            for i in range(k)
        ],
        "ideal drive": [median([an.ideal(r) for r in tests])],
        "lag and friction": [
            median([an.parametric(r, m) for r, m in zip(tests, fitted, strict=True)])
        ],
    }
    panel = Panel(
        "Accuracy and computing time",
        f"time of a torque, {len(first.torque)} drives at once [ns]",
        "torque error, median [N m]",
        scale="log",
        ylim=(0.1, 2.0),
        notes=[f"PyTorch's torques differ by {max(same):.1e} N m at most"],
    )
    for label, x, y, style in (
        ("network", nanoseconds[:k], errors["network"], "-"),
        ("network, PyTorch", nanoseconds[k : 2 * k], errors["network"], "--"),
        ("ideal drive", nanoseconds[-2:-1], errors["ideal drive"], ""),
        ("lag and friction", nanoseconds[-1:], errors["lag and friction"], ""),
    ):
        note = ", ".join(f"{e:.3f} N m in {t:.0f} ns" for t, e in zip(x, y, strict=True))
        tags = [f"{h}" for h in widths] if label == "network" else ()
        note = f"{label}{' of ' + ', '.join(tags) + ' units' if tags else ''}: {note}"
        panel.series.append(
            Series(
                label,
                x,
                y,
                label,
                style=style,
                hollow=label.endswith("PyTorch"),
                tags=tags,
                note=note,
            )
        )
    return panel
