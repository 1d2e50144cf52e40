"""Where model files go wrong: a joint that falls on its limit, and a joint that copies another."""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.charts.platforms.smooth import LIBRARIES
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles.engines import engines
from course.oracles.pybullet import PyBulletRun
from course.platforms import FAIR, Engine, Run, Scene, Settings
from course.platforms.joint_scenes import coupled, stop

Array = NDArray[np.float64]
# A label, the key of its colour, the engine, and what to change in a run before its start.
Case = tuple[str, str, Engine, Callable[[Run], None] | None]
# MuJoCo's fair settings of smooth scenes switch its constraints off, and a limit is one.
SETTINGS = {"MuJoCo": FAIR.using(but=("constraint",))}
TIME = 0.02  # MuJoCo's default time constant of a constraint [s]
STIFF = 0.005  # a stiffer one [s]; at least two steps
FINE = 1e-4  # smaller overshoots, which few encoders of robots resolve, are drawn at this [rad]
# PyBullet's gear needs a torque limit, here far above any that acts [N m].
TORQUE = 1e4


def settings_of(engine: Engine) -> Settings:
    """Return the settings of an engine in both scenes."""
    return SETTINGS.get(engine.name, FAIR)


def stiffened(run: Run) -> None:
    """Make the limits and couplings of a run of MuJoCo stiffer; others stay as they are."""
    model = getattr(run, "model", None)
    if model is not None:
        model.jnt_solref[:, 0] = model.eq_solref[:, 0] = max(STIFF, 2.0 * run.dt)


def geared(run: Run, ratio: float) -> None:
    """Add to a run of PyBullet the gear that its reader of URDF leaves out."""
    assert isinstance(run, PyBulletRun), run
    first, second = run.scene.joints[:2]
    run.couple(first, second, ratio, TORQUE)


def motion(
    engine: Engine,
    scene: Scene,
    dt: float,
    seconds: float,
    changed: Callable[[Run], None] | None = None,
) -> tuple[Array, Array, Array]:
    """Return times [s], joint angles (n, steps) [rad] and rates of a run, each step of it."""
    run = engine.build(scene, dt, settings_of(engine))
    try:
        if changed is not None:
            changed(run)
        q, v = [], []
        for _ in range(round(seconds / dt)):
            run.run(1)
            now = run.state()
            q.append(now.q)
            v.append(now.v)
    finally:
        run.close()
    return np.arange(1.0, len(q) + 1.0) * dt, np.array(q).T, np.array(v).T


def at_the_stop(
    engine: Engine,
    dt: float,
    starts: Sequence[float],
    changed: Callable[[Run], None] | None = None,
) -> tuple[float, float, float]:
    """Return how far a joint passes its limit, its rebound, and where it rests.

    Args:
        engine: a simulator.
        dt: step [s].
        starts: angles of release [rad]; the worst is returned, as an impact falls anywhere in a
            step.
        changed: what to do with each run before its start.

    Returns:
        The largest angle beyond the limit [rad], the largest speed back over the speed at the
        impact, and how far beyond the limit the joint is at the end [rad].
    """
    result = []
    for start in starts:
        problem = stop(start)
        _, q, v = motion(engine, problem.scene, dt, 1.0, changed)
        beyond = problem.limit - q[0]
        result.append((beyond.max(), v[0].max() / problem.speed, beyond[-1]))
    past, back, rest = np.array(result).max(axis=0)
    return float(past), float(back), float(rest)


def overshoot_in_theory(dt: float, time: float = TIME) -> float:
    """Return how far a critically damped stop with this time constant is passed [rad].

    It moves like v t exp(-t / time), whose largest value is v time / e. MuJoCo makes the constant
    at least two steps.
    """
    return stop().speed * max(time, 2.0 * dt) / math.e


def late(dt: float) -> float:
    """Return how far the joint comes within the step in which it reaches the limit [rad]."""
    return stop().speed * dt


@chart(columns=2)
def platform_joints(
    steps: Sequence[float] = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4),
    starts: Sequence[float] = (0.0, 0.003, 0.007, 0.012),
    ratio: float = 2.0,
) -> Iterator[Panel]:
    """Chart what engines make of a joint limit and of a mimic joint in the same URDF.

    Args:
        steps: the largest first [s].
        starts: of the falling rod [rad].
        ratio: of the mimic joint.
    """
    known = {name: engine for name, engine in engines().items() if engine.available()}
    footer = machine(0.0, libraries=LIBRARIES)
    stiffer = "MuJoCo, stiffer"
    problem, middle = stop(), steps[len(steps) // 2]
    panel = Panel(
        "A rod falls on its limit, one start",
        "time since the release [s]",
        "angle beyond the limit [mrad]",
        ylim=(-100.0, 110.0),
        lines=[("y", 0.0, "limit")],
        footer=footer,
    )
    for name, engine in known.items():
        time, q, _ = motion(engine, problem.scene, middle, 0.6)
        beyond = 1e3 * (problem.limit - q[0])
        # Around the impact; a joint that swings through leaves the panel.
        shown = (time > 0.2) & (time < 0.4) & (beyond < 100.0)
        # Its name stands at its end, not at the right edge, which it never reaches.
        through = name == "own code"
        x, y = time[shown], beyond[shown]
        tags = [""] * (len(x) - 1) + [name] if through else []
        panel.series.append(Series("" if through else name, x, y, name, marker="", tags=tags))
    yield panel

    panel = Panel(
        f"Farthest beyond the limit, of {len(starts)} starts",
        "step [s]",
        "angle [rad]",
        scale="log",
        footer=footer,
    )
    laws: dict[str, Callable[[float], float]] = {
        "v T / e": partial(overshoot_in_theory, time=TIME),
        "v h, one step late": late,
    }
    cases: list[Case] = [
        (name, name, engine, None) for name, engine in known.items() if name != "own code"
    ]
    if "MuJoCo" in known:
        cases.append((stiffer, "MuJoCo", known["MuJoCo"], stiffened))
    for label, name, engine, changed in cases:
        rows = [at_the_stop(engine, dt, starts, changed) for dt in steps]
        past = [row[0] for row in rows]
        drawn = [max(x, FINE) for x in past]
        words = f"{label}, below {1e3 * FINE:g} mrad" if max(past) < FINE else label
        line = Series(words, steps, drawn, name, "--" if changed else "-")
        back, rest = rows[len(steps) // 2][1:]
        line.note = (
            f"limit, {label}: beyond it by "
            + ", ".join(f"{1e3 * x:.2g}" for x in past)
            + f" mrad at steps of {', '.join(f'{1e3 * dt:g}' for dt in steps)} ms; "
            f"bounces back with {back:.0%} of its speed, "
            f"rests {1e3 * max(rest, 0.0):.2f} mrad beyond"
        )
        panel.series.append(line)
    for (words, law), style in zip(laws.items(), ("-", ":"), strict=True):
        panel.series.append(
            Series(words, steps, [law(dt) for dt in steps], "theory", style, marker="")
        )
    if "own code" in known:
        through = at_the_stop(known["own code"], middle, starts[:1])[0]
        panel.notes.append(f"limit, own code: swings through, {through:.1f} rad beyond it")
    yield panel

    scene = coupled(ratio)
    cases = [(name, name, engine, None) for name, engine in known.items()]
    if "MuJoCo" in known:
        cases.append((stiffer, "MuJoCo", known["MuJoCo"], stiffened))
    if "PyBullet" in known:
        gear = partial(geared, ratio=ratio)
        cases.append(("PyBullet with a gear", "PyBullet", known["PyBullet"], gear))
    lost = Panel(
        f"Joint 2 copies joint 1 times {ratio:g}",
        "time [s]",
        "error of the copy [rad]",
        ylim=(-1.0, 5.5),
        footer=footer,
    )
    error = Panel("Largest error of joint 1", "step [s]", "angle [rad]", scale="log", footer=footer)
    for label, name, engine, changed in cases:
        worst, gaps = [], []
        for dt in steps:
            time, q, _ = motion(engine, scene, dt, scene.duration, changed)
            # The truth at twenty moments: a tight integration takes a while.
            at = np.linspace(0, len(time) - 1, 21).astype(int)[1:]
            true = np.array([scene.truth(float(t))[0] for t in time[at]])
            worst.append(float(np.max(np.abs(q[0, at] - true))))
            gaps.append(float(np.max(np.abs(q[1] - ratio * q[0]))))
            if dt == middle and not changed:
                copy = q[1] - ratio * q[0]
                lost.series.append(Series(label, time, copy, name, marker=""))
        style = "--" if changed else "-"
        line = Series(label, steps, worst, name, style, extra=name == "own code")
        line.note = (
            f"mimic, {label}: copy off by at most {1e3 * max(gaps):.2g} mrad; joint 1 off by "
            + ", ".join(f"{1e3 * x:.2g}" for x in worst)
            + " mrad at the same steps"
        )
        error.series.append(line)
    yield lost
    yield error
