"""Where it breaks: the step, the gain of looking again, noise, and a failure that is rare."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from course.charts import chart
from course.kinematics import TwoLink
from course.measure.figure import Panel, Series
from course.measure.stability import Map, limit
from course.measure.success import wilson
from course.measure.work_precision import machine
from course.pipeline import Scenario, Settings, move, run_many, successes, theory
from course.pipeline.blame import gained
from course.pipeline.budget import predicted
from course.pipeline.rare import cross_entropy, plain

Array = NDArray[np.float64]
KP, STEP, WITNESS = 25.0, 4e-3, 3e-3  # N m/rad; s; of energy won, the contract of `blame`


def stays(arm: TwoLink, q: Array, kp: float, kd: float, dt: float, steps: int = 1500) -> bool:
    """Return whether the arm without limits returns to q from 2 microradians beside it."""
    place, v, scene = q + (1e-6, -2e-6), np.zeros(2), Scenario(arm=arm)
    for _ in range(steps):
        # The arm without limits of its motors, so that instability isn't hidden by saturation.
        place, v = move(place, v, kp * (q - place) - kd * v, dt, scene)
        if np.abs(place - q).max() > 1e-3:
            return False
    return bool(np.abs(place - q).max() <= 1e-6)


def shown_limit(arm: TwoLink, q: Array, kd: float) -> float:
    """Return theory's limit [ms]."""
    return 1e3 * theory.step_limit(arm, q, KP, kd)


def let_through(frames: int, share: float) -> float:
    """Return theory's deviation over that of a picture, at a share of the largest gain."""
    return math.sqrt(theory.look_noise(share * theory.look_limit(frames), frames))


@chart(columns=2)
def step_map(points: int = 45, tested: int = 5, seeds: int = 12) -> Iterator[Panel]:
    """Chart the largest stable step over posture and damping, and what a run shows on both sides.

    Args:
        points: of each axis of the map.
        tested: gains whose limit is found by stepping the arm.
        seeds: runs of a step.
    """
    arm = Scenario().arm
    bends, damped = np.linspace(0.0, 180.0, points), np.linspace(0.0, 16.0, points)
    values = np.array(
        [
            [theory.growth(arm, (0.4, math.radians(q2)), KP, kd, STEP) for kd in damped]
            for q2 in bends
        ]
    )
    at = np.array(
        [[theory.step_limit(arm, (0.4, math.radians(q2)), KP, kd) for kd in damped] for q2 in bends]
    )
    # The damping at which the limit equals this step; the limit falls with Kd, hence the signs.
    edge = [float(np.interp(-STEP, -row, damped, right=np.nan)) for row in at]
    grid = Map(damped, bends, values, quantity="growth per step")
    yield Panel(
        "Steps of 4 ms: stable folded, not stretched",
        "Kd [N m s/rad]",
        "elbow [deg]",
        [Series("limit of theory", edge, bends, "theory on a map", marker="")],
        grid=grid,
        xlim=(0.0, 16.0),
        footer=machine(0.0),
        notes=[
            f"largest stable step at Kd 8: {1e3 * theory.step_limit(arm, (0.4, b), KP, 8.0):.2f}"
            f" ms with the elbow at {math.degrees(b):.0f} deg"
            for b in (0.0, 1.64, math.pi)
        ],
    )
    panel = Panel(
        "Largest stable step: simulation and formula",
        "Kd [N m s/rad]",
        "step [ms]",
        scale="log y",
    )
    for bend in (0.0, 90.0, 170.0):
        q, kds = np.array([0.4, math.radians(bend)]), np.linspace(0.0, 16.0, tested)
        report = partial(theory.step_limit, arm, q, KP)
        # Bisection by stepping the arm, between 0.8 and 1.3 of the theory.
        result = [
            limit(partial(stays, arm, q, KP, kd), 0.8 * report(kd), 1.3 * report(kd), 3e-3)
            for kd in kds.tolist()
        ]
        error = max(abs(h / report(kd) - 1.0) for h, kd in zip(result, kds.tolist(), strict=True))
        note = f"elbow {bend:.0f}: limits of the arm are off theory by {100 * error:.2f} % at most"
        panel.series.append(
            Series(
                f"elbow {bend:.0f} deg",
                kds,
                1e3 * np.array(result),
                style="",
                theory=partial(shown_limit, arm, q),
                note=note,
            )
        )
    yield panel
    shares = (0.7, 0.9, 0.97, 1.03, 1.1, 1.3, 1.6, 2.0, 2.6, 3.2)
    answer = Panel(
        "A run still succeeds above the limit",
        "step, limit = 1",
        "success",
        lines=[("x", 1.0, "limit")],
    )
    energy = Panel(
        "Energy from nowhere shows it",
        "step, limit = 1",
        "energy from nowhere, share",
        scale="log y",
        lines=[("x", 1.0, "limit"), ("y", WITNESS, "contract")],
    )
    for kd in (4.0, 8.0):
        h = theory.step_limit(arm, (0.624, 1.64), KP, kd)
        rows = [
            run_many(
                Scenario(),
                replace(Settings(noise=0.01, kd=kd), physics=x * h, control=x * h),
                range(seeds),
            )
            for x in shares
        ]
        rate = [float(successes(row).mean()) for row in rows]
        won = [float(np.median([gained(r, KP, kd) for r in row])) for row in rows]
        low, high = wilson(seeds * np.array(rate), seeds)
        message = ", ".join(
            f"{x:g}: {a:.2f} and {b:.1g}" for x, a, b in zip(shares, rate, won, strict=True)
        )
        answer.series.append(
            Series(
                f"Kd {kd:g}",
                shares,
                rate,
                low=low,
                high=high,
                note=f"Kd {kd:g}, limit {1e3 * h:.1f} ms, success and energy "
                f"won by share of it: {message}",
            )
        )
        energy.series.append(Series(f"Kd {kd:g}", shares, np.maximum(won, 1e-6)))
    yield answer
    yield energy


@chart(columns=2)
def look_and_move(at_most: int = 8, chains: int = 400, looks: int = 2000) -> Iterator[Panel]:
    """Chart correcting the target from pictures that are late.

    The gain's limit, and what noise does.
    """

    def settles(gain: float, k: int) -> bool:
        past = [1.0] * (k + 1)
        while len(past) < 40_000 and abs(past[-1]) < 10.0:
            past.append(past[-1] - gain * past[-1 - k])
        return max(map(abs, past[-50:])) < 0.5

    late = list(range(at_most + 1))
    report = [theory.look_limit(k) for k in late]
    result = [
        limit(partial(settles, k=k), 0.9 * g, 1.1 * g, 1e-3)
        for k, g in zip(late, report, strict=True)
    ]
    panel = Panel("Largest gain that settles", "frames of delay", "gain", footer=machine(0.0))
    words = ", ".join(
        f"{k}: {g:.4f} ({t:.4f})" for k, g, t in zip(late, result, report, strict=True)
    )
    panel.series = [
        Series("measured", late, result, style="", note=f"limit of the gain (theory): {words}"),
        Series("theory", late, report, "theory", marker=""),
    ]
    yield panel
    panel = Panel(
        "Noise of the position",
        "gain / largest gain that settles",
        "its deviation / that of one image",
        scale="log y",
    )
    rng, shares = np.random.default_rng(0), (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9)
    for k in (0, 1, 3, 8):
        y = []
        for share in shares:
            e, observed = np.zeros((looks, chains)), rng.standard_normal((looks, chains))
            # Many chains at once: each its own noise, the same gain and delay.
            for t in range(k, looks - 1):
                e[t + 1] = e[t] - share * report[k] * (e[t - k] + observed[t])
            # Second half only, after the start at zero has been forgotten.
            y.append(float(e[looks // 2 :].std()))
        message = ", ".join(f"{v:.3f}" for v in y)
        panel.series.append(
            Series(
                f"{k} frames late" if k != 1 else "1 frame late",
                shares,
                y,
                style="",
                theory=partial(let_through, k),
                note=f"{k} late, by share of the limit: {message}",
            )
        )
    yield panel


@chart(columns=2)
def noise_and_filter(
    sigmas: Sequence[float] = (0.002, 0.005, 0.01, 0.02, 0.035, 0.05, 0.07, 0.1),
    steps: Sequence[float] = (0.3, 0.1, 0.03, 0.01, 0.005, 0.002),
    seeds: int = 40,
    raw: int = 10,
) -> Iterator[Panel]:
    """Chart what a filter is worth, and what a planner's small step costs.

    Args:
        sigmas: noise of an image [m].
        steps: of the planner [rad].
        seeds: runs of a point.
        raw: runs of a point without the filter, which replans again and again.
    """
    shown = [
        Panel(
            "Success", "noise of a frame [mm]", "share of runs", scale="log x", footer=machine(0.0)
        ),
        Panel(
            f"Plans in a run of {Scenario().seconds:g} s",
            "noise of a frame [mm]",
            "mean number of plans",
            scale="log",
        ),
        Panel(
            "Error at the end",
            "noise of a frame [mm]",
            "rms [mm]",
            scale="log",
            lines=[("y", 20.0, "tolerance")],
        ),
    ]
    for label, filtered, n in (("with the filter", True, seeds), ("without", False, raw)):
        report = [Settings(noise=s, filtered=filtered) for s in sigmas]
        rows = [run_many(Scenario(), settings, range(n)) for settings in report]
        rate = [float(successes(row).mean()) for row in rows]
        plans = [float(np.mean([len(r.plans) for r in row])) for row in rows]
        rms = [1e3 * math.sqrt(np.mean([r.distance**2 for r in row])) for row in rows]
        words = ", ".join(
            f"{1e3 * s:g} mm: {a:.2f} success, {b:.3g} plans, {c:.2g} mm"
            for s, a, b, c in zip(sigmas, rate, plans, rms, strict=True)
        )
        # Wilson's interval, which also holds near 0 and 1.
        low, high = wilson(n * np.array(rate), n)
        empty = (None, None)
        bands = ((low, high), empty, empty)
        for panel, y, ends in zip(shown, (rate, plans, rms), bands, strict=True):
            panel.series.append(Series(label, 1e3 * np.array(sigmas), y, low=ends[0], high=ends[1]))
        shown[0].series[-1].note = f"{label}: {words}"
        both = [predicted(Scenario(), settings) for settings in report]
        # Root mean square from the predicted mean and covariance.
        guess = [1e3 * math.sqrt(float(m @ m + np.trace(c))) for m, c in both]
        shown[2].series.append(
            Series(
                f"predicted {label}",
                1e3 * np.array(sigmas),
                guess,
                "theory",
                marker="",
                style="-" if filtered else "--",
            )
        )
    yield from shown
    panel = Panel(
        "When the last plan arrives, median",
        "planner's step [rad]",
        "time after the start [s]",
        scale="log",
        lines=[("y", Scenario().seconds, "end")],
    )
    for label, cost in (("20 us a check", 20e-6), ("1 us a check", 1e-6)):
        rows = [
            run_many(Scenario(), Settings(step=x, check_cost=cost), range(seeds)) for x in steps
        ]
        when = [[1e-6 * r.plans[-1].arrived for r in row] for row in rows]
        checks = [float(np.median([r.plans[0].value.checks for r in row])) for row in rows]
        rate = [float(successes(row).mean()) for row in rows]
        words = ", ".join(
            f"{x:g}: {c:.0f} checks, success {y:.2f}"
            for x, c, y in zip(steps, checks, rate, strict=True)
        )
        panel.series.append(
            Series(
                label,
                steps,
                [float(np.median(w)) for w in when],
                note=f"{label}, by step: {words}",
            )
        )
    yield panel


SHARE = 4.9e-4  # of a half-space, known exactly


@chart(columns=2)
def rare_failure(repeats: int = 100, plainly: int = 40) -> Iterator[Panel]:
    """Chart cross-entropy and plain sampling on a known failure rate: stated and true errors."""

    def severity(x: Array) -> Array:
        return np.asarray(0.8 * x[0] + 0.6 * x[1] - norm.isf(SHARE))

    methods = {
        "narrow proposal": [
            cross_entropy(severity, 6, np.random.default_rng(k)) for k in range(repeats)
        ],
        "width at least 1": [
            cross_entropy(severity, 6, np.random.default_rng(k), least=1.0) for k in range(repeats)
        ],
    }
    ladder = (2500, 10_000, 40_000, 160_000)
    # Scatter over repeats: the true standard error of plain sampling.
    spread = [
        float(
            np.std(
                [plain(severity, 6, n, np.random.default_rng(k)).share for k in range(plainly)],
                ddof=1,
            )
        )
        for n in ladder
    ]
    ranks = Panel(
        "Every repeat, with two reported errors",
        "repeat, by its answer",
        "failure rate [1e-4]",
        ylim=(0.0, 10.0),
        lines=[("y", 1e4 * SHARE, "truth")],
        footer=machine(0.0),
    )
    # Names beside the points: leaders to the margin would look like curves.
    price = Panel(
        "Scatter of the answers",
        "runs",
        "standard error",
        scale="log",
        ylim=(1.2e-5, 7e-4),
        legend=False,
    )
    others = [
        Series(
            "plain",
            ladder,
            spread,
            style="",
            theory=lambda n: math.sqrt(SHARE * (1.0 - SHARE) / n),
            tags=("", "plain (line: theory)"),
        )
    ]
    alarm = Panel(
        "Effective number gives no warning",
        "reported errors from the truth",
        "effective number",
        xlim=(-15.0, 5.0),
        lines=[("x", -3.0, "left: too low and sure")],
    )
    width = Panel(
        "Narrow proposals miss failures",
        "least width [standard deviations]",
        "failure rate, truth = 1",
        lines=[("x", 1.0, "width of the disturbances"), ("y", 1.0, "truth")],
    )
    for name, result in methods.items():
        y, error = np.array([(one.share, one.error) for one in result]).T
        # Errors in units of what each repeat states itself.
        order, deviation = np.argsort(y), (y - SHARE) / error
        sure, met = np.mean(deviation < -3.0), np.mean(np.abs(deviation) < 2.0)
        low, middle, high = (1e4 * (y + k * error)[order] for k in (-2.0, 0.0, 2.0))
        ranks.series.append(Series(name, range(repeats), middle, low=low, high=high))
        runs, true = result[0].runs, float(y.std(ddof=1))
        # Runs that plain sampling needs for the same true scatter.
        worth = SHARE * (1.0 - SHARE) / true**2 / runs
        price.series.append(
            Series(
                f"{name}, true",
                [runs],
                [true],
                style="",
                tags=(f"{name}, true",),
                note=f"{name}: {runs} runs, answers "
                f"scatter by {true:.2g}, {np.median(error):.2g} stated; {100 * sure:.0f} % too "
                f"low by 3 stated errors, within 2 {100 * met:.0f} %; plain sampling takes "
                f"{worth:.3g} times the runs",
            )
        )
        stated = float(np.median(error))
        label = f"{name}, reported"
        others.append(Series(label, [runs], [stated], style="", hollow=True, tags=(label,)))
        some = deviation < -3.0
        count = np.array([one.effective for one in result])
        if some.any():
            one, other = (np.median(count[at]) for at in (some, ~some))
            alarm.notes.append(
                f"{name}: effective number {one:.0f} where too low and sure, {other:.0f} elsewhere"
            )
        alarm.series.append(Series(name, deviation, count, style=""))
        width.series.append(Series(name, [one.width.min() for one in result], y / SHARE, style=""))
    # First the two proposals, so that they have the colours that they have on the other panels.
    price.series += others
    yield from (ranks, price, alarm, width)
