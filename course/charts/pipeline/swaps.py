"""Real components in each place, and what a run costs for what it tells."""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import ks_2samp, levene
from scipy.stats import t as student

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.success import paired
from course.measure.work_precision import machine
from course.oracles import pipeline as libraries
from course.perception import Camera
from course.pipeline import Record, Scenario, Settings, Stages, errors, move, run_many, successes
from course.pipeline.drive import Q, V
from course.pipeline.eye import Eye
from course.pipeline.run import tip_of

Array = NDArray[np.float64]
SMALL = Eye(bodies=False, camera=Camera.symmetric(320, 240, math.radians(62.0)), height=1.0)
SEEN = Settings(frame=0.2, law="computed_torque", drift=(0.02, 0.02))


def through_python(
    q: Array, v: Array, tau: Array, dt: float, scenario: Scenario
) -> tuple[Array, Array]:
    """Return our own step, called as a library's is: from Python, once a step.

    Another function than `move` itself, so the run is not compiled. It is the control of every
    ratio of time: what it costs is the interface's price, not a library's.
    """
    return move(q, v, tau, dt, scenario)


PYTHON = "ours, through Python"


def settings_for(name: str) -> Settings:
    """Return settings with which a library can stand in that place."""
    sees = name in ("Open3D perceives", "MuJoCo's rays", "all of them")
    return SEEN if sees else Settings(law="computed_torque" if "Pinocchio" in name else "pd")


def timed(settings: Settings, stages: Stages, seeds: Sequence[int]) -> tuple[list[Record], float]:
    """Return records, and processor time of a run, the median over the seeds [s]."""
    records, each = [], []
    # A short first run compiles and fills caches; it is not timed.
    run_many(Scenario(seconds=0.3), settings, seeds[:1], stages)
    for seed in seeds:
        # Processor time, one run at a time; the median over the seeds.
        start = time.process_time()
        records += run_many(Scenario(), settings, [seed], stages)
        each.append(time.process_time() - start)
    return records, float(np.median(each))


@chart(columns=3)
def swap_matrix(seeds: int = 100, seeing: int = 20) -> Iterator[Panel]:
    """Chart a library in each place on the seeds of the course's own: success, error, and time.

    Args:
        seeds: number of seeds for components that move the arm.
        seeing: number of seeds for components that take images.
    """
    shown = [
        Panel(
            "Success, minus ours",
            "difference",
            footer=machine(0.0),
            xlim=(-0.15, 0.15),
            lines=[("x", 0.0, "")],
        ),
        Panel("Error, minus ours", "difference [mm]", lines=[("x", 0.0, "")]),
        Panel(
            "Time of a run",
            "time / time with our stage",
            scale="log x",
            lines=[("x", 1.0, "")],
            ticks=(1, 2, 5, 10, 20, 50),
        ),
    ]
    cases = libraries.swaps(SMALL) | {PYTHON: (Stages(move=through_python), Stages())}
    for row, (name, pair) in enumerate(cases.items()):
        sees = pair[1].perceive is not Stages().perceive
        some = range(seeing if sees else seeds)
        (theirs, slow), (ours, fast) = (timed(settings_for(name), one, some) for one in pair)
        # The same seeds on both sides: differences of pairs, not of means.
        work = paired(successes(ours), successes(theirs))
        difference = 1e3 * (np.array([a.distance for a in theirs]) - [b.distance for b in ours])
        # 95 % half-width of a mean difference by Student's t.
        half = (
            student.ppf(0.975, difference.size - 1)
            * difference.std(ddof=1)
            / math.sqrt(difference.size)
        )
        error = (difference.mean(), difference.mean() - half, difference.mean() + half)
        note = (
            f"{name}: success {successes(theirs).mean():.2f} against "
            f"{successes(ours).mean():.2f} of {len(ours)}, error {error[0]:+.3g} "
            f"[{error[1]:+.2g} {error[2]:+.2g}] mm, "
            f"{slow / fast:.2g} times our {1e3 * fast:.3g} ms"
        )
        for panel, result in zip(shown, (work, error, (slow / fast,) * 3), strict=True):
            panel.series.append(
                Series(
                    # The axis names every row. Without a label the control, a seventh row, is
                    # drawn beside the six libraries instead of being switched off at first.
                    "" if name == PYTHON else name,
                    result[:1],
                    [-row],
                    style="",
                    across=True,
                    low=result[1:2],
                    high=result[2:],
                    note=note,
                )
            )
            note = ""
    for panel in shown:
        panel.ylim, panel.legend = (-row - 0.5, 0.5), False
        panel.rows = list(cases) if panel is shown[0] else [""] * len(cases)
        yield panel


def seen_shift(first: Array, second: Array, rng: np.random.Generator, tries: int = 200) -> float:
    """Return the shift that a Kolmogorov-Smirnov test detects four times in five.

    It is in standard deviations of the second sample, for equally many runs of both.
    """
    for shift in np.arange(0.1, 3.0, 0.05):
        # Bootstrap samples of one distribution, shifted on purpose: the power of the test.
        drawn = (rng.choice(second, n) for n in tries * [first.size])
        observed = [ks_2samp(some + shift * second.std(), second).pvalue < 0.05 for some in drawn]
        if np.mean(observed) >= 0.8:
            return float(shift)
    return math.inf


@chart(columns=2)
def two_numbers(seeds: int = 40, drawn: int = 400) -> Iterator[Panel]:
    """Chart errors at the end with pictures, and with the two numbers that were measured from them.

    Args:
        seeds: of runs with images.
        drawn: of runs in which bias and noise replace the images.
    """
    scenario, settings = Scenario(), replace(SEEN, frame=0.1)
    full = run_many(scenario, settings, range(seeds), Stages(perceive=SMALL))
    observed = [p for record in full for p in record.pictures]
    deviation = np.array([p.value - scenario.at(1e-6 * p.captured) for p in observed])
    # What the estimator itself says of its noise, beside what is measured.
    stated = math.sqrt(np.mean([np.trace(np.asarray(p.covariance)) / 2.0 for p in observed]))
    bias, noise = deviation.mean(axis=0), math.sqrt(np.mean(deviation.var(axis=0)))
    x, y = 1e3 * bias
    words = (
        f"a picture is off by ({x:+.2f} {y:+.2f}) mm with a deviation of {1e3 * noise:.2f}; "
        f"its covariance says {1e3 * stated:.2f}"
    )
    report = replace(settings, noise=noise, bias=(float(bias[0]), float(bias[1])))
    u = np.array(scenario.velocity) / math.hypot(*scenario.velocity)
    paths, rng = {"along": u, "across": np.array([-u[1], u[0]])}, np.random.default_rng(0)
    # The same scene with images; seeds of the short runs are others.
    pictured = 1e3 * errors(full)
    titles = ("Final error, noise measured on images", "Final error, noise as stated")
    for title, name, sigma in zip(
        titles, ("two numbers", "the noise that is stated"), (noise, stated), strict=True
    ):
        short = 1e3 * errors(
            run_many(scenario, replace(report, noise=sigma), range(1000, 1000 + drawn))
        )
        panel = Panel(
            title,
            "with two parameters, minus median [mm]",
            "with images, minus that median [mm]",
            theory="equal",
            footer=machine(0.0),
            notes=[words] if words else [],
        )
        for method, unit in paths.items():
            a, b = unit @ pictured, unit @ short
            at = (np.arange(19) + 1.0) / 20.0
            # A test that finds nothing means little without the shift that it would have found.
            p, shift = ks_2samp(a, b).pvalue, seen_shift(a, b, rng) * b.std()
            note = (
                f"{name}, {method} the motion: {b.mean():+.2f} +- {b.std():.2f} mm, pictures "
                f"{a.mean():+.2f} +- {a.std():.2f}; p {p:.2g}, of the spread "
                f"{levene(a, b).pvalue:.1g}; a shift of {shift:.2f} mm would be seen four "
                "times in five"
            )
            # One median for both axes: the diagonal stays, and both directions share a scale.
            middle = np.median(b)
            panel.series.append(
                Series(
                    f"{method} the motion",
                    np.quantile(b, at) - middle,
                    np.quantile(a, at) - middle,
                    style="",
                    theory=lambda x: x,
                    note=note,
                )
            )
        words = ""
        yield panel


@chart(columns=2)
def pipeline_speed(
    steps: Sequence[float] = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4),
    seeds: int = 4,
    widths: Sequence[int] = (160, 320, 640),
) -> Iterator[Panel]:
    """Chart error against time of the motion, and the speed of a run with and without images.

    Args:
        steps: of the physics [s].
        seeds: runs of each image size.
        widths: of an image [pixels].
    """
    calm, ours = Settings(noise=0.0), Stages()
    panel = Panel(
        "Error of the motion",
        "processor time of a run [ms]",
        "largest error of the tip [mm]",
        scale="log",
        footer=machine(0.0),
        # Names beside the curves: a leader from the left curve would cross the others.
        legend=False,
    )
    quick: dict[str, float] = {}
    theirs = Stages(move=libraries.move)
    called = Stages(move=through_python)
    for label, stages, key, style in (
        ("ours", ours, "course", "-"),
        (PYTHON, called, "course", "--"),
        ("MuJoCo moves", theirs, "MuJoCo", "-"),
    ):

        def motion(h: float, stages: Stages = stages) -> tuple[Array, float]:
            settings = replace(calm, physics=h, control=h)
            records, cost = timed(settings, stages, range(3) if stages is ours else range(1))
            # Compared at common times, every 8 ms.
            every = round(8e-3 / h)
            tip = tip_of(records[0].scenario.arm, records[0].log[::every, Q:V].T)
            return tip, cost

        # Each engine against its own limit, at half of its smallest step.
        fine, cost = motion(min(steps) / 2.0)
        x, y = [], []
        for h in steps:
            tip, cost = motion(h)
            x.append(1e3 * cost)
            y.append(1e3 * float(np.abs(tip - fine).max()))
        # Four simulated seconds over the processor time.
        quick[label] = 4.0 / (1e-3 * x[list(steps).index(2e-3)])
        message = ", ".join(f"{1e3 * h:g} ms {e:.2g} mm" for h, e in zip(steps, y, strict=True))
        # At different points, so that the names of neighbouring curves do not meet.
        tags = {"ours": ("", "ours"), PYTHON: ("",) * 4 + (label,)}.get(label, (label,))
        tags = tags[: len(x)]
        panel.series.append(Series(label, x, y, key, style, note=f"{label}: {message}", tags=tags))
    yield panel
    dear = replace(SEEN, frame=0.1)
    cast = {
        "our camera": Eye(bodies=False, height=1.0),
        "MuJoCo's rays": Eye(bodies=False, height=1.0, picture=libraries.picture),
    }
    names = {"ours": "two parameters", PYTHON: "our motion through Python"}
    names["MuJoCo moves"] = "MuJoCo's motion"
    for name, eye in cast.items():
        for w in widths:
            camera = Camera.symmetric(w, 3 * w // 4, math.radians(62.0))
            stages = Stages(perceive=replace(eye, camera=camera))
            row = f"{name}, {w} px"
            # Four simulated seconds over the processor time.
            quick[row] = 4.0 / timed(dear, stages, range(seeds))[1]
            names[row] = row
    panel = Panel(
        "Speed of a run",
        "simulated time / processor time",
        scale="log x",
        xlim=(None, 6e3),
        lines=[("x", 1.0, "real time")],
    )
    x = [quick[name] for name in names]
    message = ", ".join(f"{n} {v:.3g}" for n, v in zip(names.values(), x, strict=True))
    panel.series.append(
        Series(
            "",
            x,
            list(names.values()),
            style="bar",
            tags=[f"{v:,.0f}" if v >= 100.0 else f"{v:.3g}" for v in x],
            note=f"times real time: {message}",
        )
    )
    yield panel
