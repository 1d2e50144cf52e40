"""Smooth motion: the same scheme gives the same error, and what an error costs."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.timing import Sampler, interleaved
from course.measure.work_precision import machine
from course.oracles.engines import engines
from course.platforms import AS_SHIPPED, FAIR, SCENES, Engine, Run, Scene, Settings, prepared
from course.platforms.measures import position_error, slope
from course.platforms.scenes import tower

LIBRARIES = ("mujoco", "drake", "pybullet")
# Curves that lie on each other: the first are the largest, and empty.
SIZES = {"own code": 13.0, "MuJoCo": 10.0, "Drake": 7.0, "PyBullet": 4.0}


def here() -> dict[str, Engine]:
    """Return the engines that are installed."""
    return {name: engine for name, engine in engines().items() if engine.available()}


def on_one_another(name: str, label: str, x: Sequence[float], y: Sequence[float]) -> Series:
    """Return points of an engine that others may have too, so that each is seen."""
    return Series(label, x, y, name, "", hollow=name != "PyBullet", size=SIZES[name])


def _errors(engine: Engine, scene: Scene, steps: Sequence[float], how: Settings) -> list[float]:
    return [position_error(engine, scene, dt, how) for dt in steps]


def first_order(steps: Sequence[float], errors: Sequence[float]) -> Callable[[float], float]:
    """Return the line of order 1 through the finest error."""
    # Through the finest error, where higher orders matter least.
    return lambda dt: errors[-1] * dt / steps[-1]


@chart(columns=2)
def platform_accuracy(
    steps: Sequence[float] = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4), share: float = 1.0
) -> Iterator[Panel]:
    """Chart whether the same scheme has the same error in every engine.

    All engines run a tumble, a chain and an arm, with fair settings and as shipped.

    Args:
        steps: the largest first [s].
        share: of each scene's duration.
    """
    deviation: dict[str, list[list[float]]] = {}
    for name in ("tumble", "chain", "arm"):
        scene = SCENES[name](duration=share * SCENES[name]().duration)
        panel = Panel(
            f"{name}, {scene.duration:g} s",
            "step [s]",
            f"error [{scene.unit}]",
            scale="log",
            theory="order 1",
            footer=machine(0.0, libraries=LIBRARIES),
        )
        own: list[float] = []
        for label, engine in here().items():
            fair = _errors(engine, scene, steps, FAIR)
            own = own or fair
            # With the same scheme the errors themselves must agree, not only their order.
            deviation.setdefault(label, []).append(np.abs(np.divide(fair, own) - 1.0).tolist())
            shipped = _errors(engine, scene, steps, AS_SHIPPED)
            panel.series += [
                on_one_another(label, label, steps, fair),
                Series(
                    f"{label}, as shipped",
                    steps,
                    shipped,
                    label,
                    "--",
                    marker="",
                    extra=label != "PyBullet",
                ),
            ]
            panel.series[-2].note = (
                f"{name:<7} {label:<9} order {slope(steps, fair):.3f}; error at "
                f"{1e3 * steps[-1]:g} ms {fair[-1]:.4e} {scene.unit}, as shipped {shipped[-1]:.4e}"
            )
        panel.series[0].theory = first_order(steps, own)
        higher = {"MuJoCo": "RK4", "Drake": "runge_kutta3"}
        for label, scheme in higher.items():
            if label in here():
                y = _errors(here()[label], scene, steps, FAIR.using(scheme))
                panel.series.append(
                    Series(
                        f"{label}, {scheme.replace('runge_kutta', 'RK')}",
                        steps,
                        y,
                        label,
                        ":",
                        size=3.0,
                        extra=label == "Drake",
                        note=f"{name:<7} {label} {scheme}: "
                        f"order {slope(steps[:3], y[:3]):.2f} at the coarse end, error "
                        f"{y[-1]:.2e}",
                    )
                )
        yield panel
    agree = Panel(
        "How far errors differ from our own", "step [s]", "relative difference", scale="log"
    )
    for label, rows in list(deviation.items())[1:]:
        worst = np.max(rows, axis=0)
        note = f"{label}: errors within {worst.max():.1e} of our own"
        agree.series.append(Series(label, steps, np.maximum(worst, 1e-16), label, note=note))
    yield agree


# --- work and precision -----------------------------------------------------------------------


def again(run: Run, steps: int) -> Sampler:
    """Return a sampler of a whole motion: each time from the same start, the way back is not timed.

    All engines compute in one thread, so the clock is that of the process: it doesn't count what
    other processes do.
    """
    start = run.save()

    def sampler(n: int) -> float:
        spent = 0.0
        for _ in range(n):
            # Restoring is outside the clock.
            run.restore(start)
            begin = time.process_time()
            run.run(steps)
            spent += time.process_time() - begin
        return spent

    return sampler


SMOOTH = {
    "own code": ("semi_implicit_euler", "rk4"),
    "MuJoCo": ("Euler", "RK4"),
    "Drake": ("discrete", "runge_kutta3"),
    "PyBullet": ("semi-implicit Euler",),
}
TOUCHING = {name: schemes[:1] for name, schemes in SMOOTH.items()}
Schemes = Mapping[str, Sequence[str]]
QUESTIONS: dict[str, tuple[Callable[[], Scene], Schemes, Sequence[float]]] = {
    "tumble": (partial(SCENES["tumble"], 1.0), SMOOTH, (16e-3, 8e-3, 4e-3, 2e-3, 1e-3)),
    "chain": (partial(SCENES["chain"], 6, 1.0), SMOOTH, (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)),
    "arm": (partial(SCENES["arm"], 0.5), SMOOTH, (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)),
    "brake": (SCENES["brake"], TOUCHING, (16e-3, 8e-3, 4e-3, 2e-3)),
    "tower": (partial(tower, 3, 0.2), TOUCHING, (8e-3, 4e-3, 2e-3)),
}


@chart(columns=2)
def platform_precision(
    scenes: Sequence[str] = tuple(QUESTIONS), coarse: int = 5, repeats: int = 3
) -> Iterator[Panel]:
    """Chart error against cost, and the cheapest that is within the tolerance of its scene.

    Cost is the processor time of the whole motion, the least of some interleaved rounds, over that
    of MuJoCo's semi-implicit Euler at the largest step. All settings are fair.

    Args:
        scenes: some of `QUESTIONS`.
        coarse: how many of the steps.
        repeats: timed rounds.
    """
    for name in scenes:
        make, schemes, steps = QUESTIONS[name]
        scene, rows, samplers = make(), [], []
        for label, engine in here().items():
            for scheme in schemes[label]:
                for dt in steps[:coarse]:
                    run = prepared(engine, scene, dt, FAIR.using(scheme))
                    n = round(scene.duration / dt)
                    samplers.append(again(run, n))
                    # A first run that is not timed; its end state gives the error.
                    samplers[-1](1)
                    rows.append((label, scheme, dt, scene.error(run.state(), n * dt)))
        # All engines, schemes and steps of a scene in turn.
        times = interleaved(samplers, repeats=repeats, sample=4e-3, warm=True)
        unit = times[[row[:2] for row in rows].index(("MuJoCo", "Euler"))].best
        panel = Panel(
            f"{name}, {scene.duration:.2g} s",
            f"cost, MuJoCo Euler at {1e3 * steps[0]:g} ms = 1",
            f"error [{scene.unit}]",
            scale="log",
            lines=[("y", scene.tolerance, f"tolerance {scene.tolerance:g}")],
            footer=machine(max(t.busy for t in times), libraries=LIBRARIES),
        )
        best: tuple[float, float, str] | None = None
        for label in here():
            for k, scheme in enumerate(schemes[label]):
                words = scheme.replace("semi_implicit_euler", "semi-impl. Euler")
                words = words.replace("semi-implicit", "semi-impl.").replace("runge_kutta", "RK")
                words = f"{label}, {words}"
                mine = [
                    (t.best / unit, max(e, 1e-16), dt, t)
                    for (a, s, dt, e), t in zip(rows, times, strict=True)
                    if (a, s) == (label, scheme)
                ]
                for cost, error, dt, _ in mine:
                    if error <= scene.tolerance and (best is None or cost < best[0]):
                        best = cost, error, f"{words}, {1e3 * dt:g} ms"
                message = "; ".join(f"{1e3 * dt:g} ms {e:.2e} at {c:.3g}" for c, e, dt, _ in mine)
                panel.series.append(
                    Series(
                        words,
                        [row[0] for row in mine],
                        [row[1] for row in mine],
                        label,
                        ":" if k else "-",
                        size=4.0,
                        extra=(label, k) == ("Drake", 1),
                        low=[row[3].best / unit for row in mine],
                        across=True,
                        high=[row[3].high / unit for row in mine],
                        note=f"{name}: {words}: {message}",
                    )
                )
        if best:
            panel.series.append(
                Series("", best[:1], best[1:2], "chosen", "", hollow=True, size=13.0, tags=["pick"])
            )
        result = [y for series in panel.series for y in series.y]
        panel.ylim = 0.1 * min(result), 10.0 * max(result)
        panel.notes.append(
            f"{name}: pick for {scene.tolerance:g} {scene.unit}: "
            + (f"{best[2]}, cost {best[0]:.3g}" if best else "none")
        )
        yield panel
