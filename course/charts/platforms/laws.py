"""Where each engine fails, with the theory drawn over it: braking, cones, creep, grasp, sag."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from course.charts import chart
from course.charts.platforms.smooth import LIBRARIES, here, on_one_another
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles.mujoco_scenes import MuJoCo
from course.platforms import AS_SHIPPED, FAIR, SCENES, Engine, Scene, Settings, prepared, theory
from course.platforms.measures import creep, position_error, slope, squeezed, stop
from course.platforms.scenes import grasp, tower

FULL = theory.braking_distance()
FOOTER = partial(machine, 0.0, libraries=LIBRARIES)
# Drake with contact by points, its shipped answer, and by each of two ways to solve for it.
POINTS = FAIR.using(but=("hydroelastic",))


def known(rows: Mapping[str, tuple[str, Settings]]) -> Iterator[tuple[str, str, Engine, Settings]]:
    """Label, engine's name, engine and settings of the rows whose engine is installed."""
    result = here()
    for label, (name, settings) in rows.items():
        if name in result:
            yield label, name, result[name], settings


@chart(columns=2)
def platform_braking(
    steps: Sequence[float] = (16e-3, 8e-3, 4e-3, 2e-3, 1e-3, 5e-4), finest: float = 2e-3
) -> Iterator[Panel]:
    """Chart the missing share of a braking distance: mu g dt / v at small steps and fair settings.

    Args:
        steps: [s].
        finest: smallest step of our own code, which runs in Python [s].
    """
    panel = Panel(
        "Stopped short, fair",
        "step [s]",
        "missing share of the distance",
        scale="log",
        lines=[("y", 0.01 / FULL, "tolerance 1 cm")],
        theory="mu g dt / v",
        footer=FOOTER(),
    )
    for name, engine in here().items():
        x = [dt for dt in steps if name != "own code" or dt >= finest]
        y = [1.0 - stop(engine, 0.0, dt).distance / FULL for dt in x]
        # Deviation from the first-order law of a step's braking.
        error = max(abs(s / theory.stopped_short(dt=dt) - 1.0) for s, dt in zip(y, x, strict=True))
        message = ", ".join(
            f"{100 * s:.4f} % at {1e3 * dt:g} ms" for s, dt in zip(y, x, strict=True)
        )
        series = on_one_another(name, name, x, y)
        series.note = f"{name:<9} {message}; within {100 * error:.2g} % of the law, "
        series.note += f"order {slope(x, y):.3f}"
        if name == "MuJoCo":
            series.theory = lambda dt: theory.stopped_short(dt=dt)
        panel.series.append(series)
    yield panel
    panel = Panel(
        "As shipped, at the end of the scene",
        "step [s]",
        "missing share of the distance",
        scale="log x",
        ylim=(-1.0, 1.1),
        lines=[("y", 0.0, "none is missing")],
    )
    rows = {
        "MuJoCo, as shipped": ("MuJoCo", AS_SHIPPED),
        "Drake, as shipped (lagged)": ("Drake", AS_SHIPPED),
        "Drake, points by sap": ("Drake", POINTS.using(approximation="sap")),
        "PyBullet, as shipped": ("PyBullet", AS_SHIPPED),
    }
    for label, name, engine, settings in known(rows):
        y = [1.0 - stop(engine, 0.0, dt, settings).distance / FULL for dt in steps]
        beyond = max(y) < 0.0
        message = ", ".join(
            f"{100 * abs(s) if beyond else 100 * s:.2f} % at {1e3 * dt:g} ms"
            for s, dt in zip(y, steps, strict=True)
        )
        panel.series.append(
            Series(
                label,
                steps,
                y,
                name,
                ":" if "sap" in label else "-",
                size=4.0,
                note=f"{label}: {'too far' if beyond else 'short'} by {message}",
            )
        )
    yield panel


CONES = {
    "own code": ("own code", FAIR, "circle"),
    "MuJoCo, elliptic": ("MuJoCo", FAIR, "circle"),
    "MuJoCo, pyramid (shipped)": ("MuJoCo", FAIR.using(but=("cone",)), "inscribed"),
    "Drake": ("Drake", FAIR, "circle"),
    "PyBullet": ("PyBullet", FAIR, "circle"),
    "PyBullet, box": ("PyBullet", FAIR.using(enableConeFriction=0), "box"),
}


@chart(columns=2)
def platform_cone(points: int = 9, dt: float = 2e-3) -> Iterator[Panel]:
    """Chart where a braking block stops, and how far it is steered, over its heading.

    Args:
        points: headings from 0 to 90 degrees.
        dt: step [s].
    """
    far = Panel(
        "Length of the path",
        "heading [deg]",
        "length / (v^2 / (2 mu g))",
        ticks=(0, 45, 90),
        footer=FOOTER(),
    )
    deviation = Panel("Turned from the heading", "heading [deg]", "[deg]", ticks=(0, 45, 90))
    degrees = np.linspace(0.0, 90.0, points)
    fine = np.linspace(0.0, 90.0, 181)
    for cone in theory.CONES:
        distance, turn = theory.stop(np.radians(fine), cone)
        for panel, y in ((far, distance / FULL), (deviation, np.degrees(turn))):
            style = {"circle": ":", "inscribed": "-", "box": "--"}[cone]
            panel.series.append(Series(f"theory, {cone}", fine, y, "theory", style, marker=""))
    for label, name, engine, settings in known({k: v[:2] for k, v in CONES.items()}):
        result = [stop(engine, math.radians(at), dt, settings) for at in degrees]
        ratio = np.array([one.distance for one in result]) / FULL
        turned = np.degrees([one.turn for one in result])
        distance, turn = theory.stop(np.radians(degrees), CONES[label][2])
        # Worst deviation over the headings, as a share of Coulomb's distance.
        error = 100 * np.max(np.abs(ratio - distance / FULL))
        report = f"{label}: from theory by {error:.2f} % of the way"
        report += f" and {np.max(np.abs(turned - np.degrees(turn))):.2f} deg at most; "
        report += ", ".join(
            f"{at:g} deg {r:.4f} {t:+.2f}" for at, r, t in zip(degrees, ratio, turned, strict=True)
        )
        for panel, y, note in ((far, ratio, report), (deviation, turned, "")):
            series = on_one_another(name, label, degrees.tolist(), y.tolist())
            series.note = note
            # The two cones of an engine look different.
            series.marker = {"inscribed": "^", "box": "s"}.get(CONES[label][2])
            panel.series.append(series)
    yield far
    yield deviation


SOFT: dict[str, Any] = {
    "cone": "elliptic",
    "solref": (0.02, 1.0),
    "solimp": (0.9, 0.95, 0.001, 0.5, 2.0),
}


def law_of_creep(impratio: float, scene: Scene, dt: float) -> float:
    """Return the theoretical creep speed of the first body [m/s], by MuJoCo's load and gap."""
    run = prepared(MuJoCo(), scene, dt, FAIR.using(impratio=impratio, **SOFT))
    # After 0.4 s the load and the gap are those of steady creep.
    run.run(round(0.4 / dt))
    report = run.contacts()
    load = float(np.linalg.norm(report.tangential_force, axis=0)[0])
    weight = sum(1.0 / body.mass for body in scene.bodies[:2])  # a block on the ground is alone
    return theory.creep_speed(
        load, float(report.gap[0]), weight, 0.5, dt, impratio=impratio, **SOFT
    )


@chart(columns=2)
def platform_creep(
    ratios: Sequence[float] = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0), dt: float = 1e-3
) -> Iterator[Panel]:
    """Chart how fast a block on a slope and a part between fingers move that should stick.

    Args:
        ratios: MuJoCo's impratio.
        dt: step [s].
    """
    scenes = {
        "A block on a slope of 0.1": SCENES["rest"](0.1),
        "A part held by 6 N a finger": grasp(6.0),
    }
    sides = {
        "MuJoCo, noslip 3": ("MuJoCo", AS_SHIPPED.using(noslip_iterations=3)),
        "Drake": ("Drake", FAIR),
        "PyBullet": ("PyBullet", FAIR),
        "own code, 10 ms, <1e-12": ("own code", FAIR),
    }
    for title, scene in scenes.items():
        law = partial(law_of_creep, scene=scene, dt=dt)
        panel = Panel(
            title, "impratio", "creep [m/s]", scale="log", theory="R f / b", footer=FOOTER()
        )
        for cone, style in (("elliptic", ""), ("pyramidal", "--")):
            soft = AS_SHIPPED.using(**SOFT | {"cone": cone})
            y = [creep(MuJoCo(), scene, dt, soft.using(impratio=r)) for r in ratios]
            message = ", ".join(f"{r:g}: {1e6 * v:.4g}" for r, v in zip(ratios, y, strict=True))
            line = Series(
                f"MuJoCo, {cone}",
                ratios,
                y,
                "MuJoCo",
                style,
                size=6.0,
                hollow=cone == "pyramidal",
                note=f"{scene.name}, {cone}, um/s at impratio {message}",
            )
            if cone == "elliptic":
                line.theory = law
                far = [abs(v / law(r) - 1.0) for r, v in zip(ratios, y, strict=True)]
                line.note += f"; relative difference from the law at most {max(far):.1e}"
            panel.series.append(line)
        for label, name, engine, settings in known(sides):
            h = 1e-2 if name == "own code" else dt
            speed = max(creep(engine, scene, h, settings), 1e-12)
            note = f"{scene.name}, {label}: {1e6 * speed:.3g} um/s"
            flat = [speed] * len(ratios)
            panel.series.append(Series(label, ratios, flat, name, ":", marker="", note=note))
        yield panel


SQUEEZES = (0.8, 0.9, 0.95, 0.98, 1.02, 1.05, 1.1, 1.2, 1.4, 1.6, 1.8, 2.0, 2.5, 3.0)


@chart(columns=2)
def platform_grasp(
    ratios: Sequence[float] = SQUEEZES,
    steps: Sequence[float] = (1e-3, 2e-3, 4e-3, 8e-3),
    finest: float = 8e-3,
) -> Iterator[Panel]:
    """Chart carried or falling, by squeeze and step: one threshold, but not always in PyBullet.

    Args:
        ratios: squeeze over m g / (2 mu).
        steps: [s].
        finest: smallest step of our own code [s].
    """
    rows = {
        "own code": ("own code", FAIR),
        "MuJoCo, fair": ("MuJoCo", FAIR),
        "MuJoCo, as shipped": ("MuJoCo", AS_SHIPPED),
        "Drake, fair": ("Drake", FAIR),
        "PyBullet, fair": ("PyBullet", FAIR),
        "PyBullet, as shipped": ("PyBullet", AS_SHIPPED),
    }
    for label, name, engine, settings in known(rows):
        some = [dt for dt in steps if name != "own code" or dt >= finest]
        panel = Panel(
            f"{label}: disc carried, x falls",
            "squeeze / (m g / (2 mu))",
            "step [ms]",
            scale="log",
            legend=False,
            ticks=(0.8, 1.0, 1.5, 2.0, 3.0),
            lines=[("x", 1.0, "theory")],
            ylim=(0.6e3 * min(steps), 1.7e3 * max(steps)),
            footer=FOOTER(),
        )
        held: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
        for dt in some:
            answers = []
            for ratio in ratios:
                answers.append(squeezed(engine, ratio, dt, settings)[0])
                held[answers[-1]].append((ratio, 1e3 * dt))
            message = "".join("o" if good else "x" for good in answers)
            # More than one change along the squeeze means that there is no threshold.
            turns = sum(a != b for a, b in itertools.pairwise(answers))
            panel.notes.append(f"{label:<20} {1e3 * dt:g} ms: {message} ({turns} changes)")
        for good, words in ((True, "held"), (False, "falls")):
            if not held[good]:
                continue
            x, y = np.array(held[good]).reshape(-1, 2).T
            panel.series.append(
                Series(
                    words,
                    x,
                    y,
                    name,
                    "",
                    hollow=not good,
                    marker="o" if good else "x",
                    size=6.0,
                )
            )
        yield panel


MOST: Mapping[str, int] = {"Drake": 4, "own code": 4}  # cubes: patches and Python are slow


@chart(columns=2)
def platform_sag(
    sizes: Sequence[int] = (1, 2, 3, 4, 6, 8), at_most: Mapping[str, int] = MOST, dt: float = 1e-3
) -> Iterator[Panel]:
    """Chart how deep a tower sinks after a second, over its cubes.

    Args:
        sizes: numbers of cubes.
        at_most: the largest number of cubes for each engine.
        dt: step [s].
    """
    rows = {
        "MuJoCo, as shipped": ("MuJoCo", AS_SHIPPED),
        "MuJoCo": ("MuJoCo", FAIR),
        "Drake, as shipped": ("Drake", AS_SHIPPED),
        "Drake": ("Drake", FAIR),
        "PyBullet": ("PyBullet", FAIR),
        "own code, 10 ms": ("own code", FAIR),
    }
    panel = Panel(
        "Sag of a tower's top",
        "cubes",
        "[m]",
        scale="log",
        ticks=sizes,
        footer=FOOTER(),
        lines=[("y", 1e-3, "tolerance")],
        theory="n^2 of one cube",
    )
    for label, name, engine, settings in known(rows):
        x = [n for n in sizes if n <= at_most.get(name, n)]
        h = 1e-2 if name == "own code" else dt
        # The sag is the position error, as the true tower does not sink.
        y = [max(position_error(engine, tower(n), h, settings), 1e-16) for n in x]
        message = ", ".join(f"{n} {1e6 * s:.4g}" for n, s in zip(x, y, strict=True))
        panel.series.append(
            Series(
                label,
                x,
                y,
                name,
                "--" if "shipped" in label else "-",
                size=4.0,
                note=f"{label}, um by cubes: {message}",
            )
        )
        if name == "MuJoCo":
            panel.series[-1].theory = lambda n, one=y[0]: one * n * n
    yield panel
    ratio = Panel("Over that of one cube", "cubes", "sag", scale="log", ticks=sizes)
    for series in panel.series:
        if series.y[0] > 1e-9 and series.label != "Drake, as shipped":
            share = [s / series.y[0] for s in series.y]
            ratio.series.append(
                Series(series.label, series.x, share, series.key, series.style, size=4.0)
            )
    laws = (("n^2", "inverse mass", "-"), ("n (n + 1) / 2", "springs", "--"))
    for words, compliance, style in laws:
        y = [theory.sag_growth(n, compliance) for n in sizes]
        ratio.series.append(Series(words, sizes, y, "theory", style, marker=""))
    yield ratio
