"""Scene by engine by settings: error, cost, verdict; each change's effect; readers; installs."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from course.charts import FOLDER, chart
from course.charts.platforms.smooth import LIBRARIES, again, here
from course.measure.data import document, from_json
from course.measure.figure import Panel, Series
from course.measure.timing import Sampler
from course.measure.work_precision import machine
from course.oracles.installs import install
from course.oracles.readers import READERS, readings
from course.platforms import AS_SHIPPED, FAIR, SCENES, Engine, Scene, prepared
from course.platforms.contract import Settings
from course.platforms.measures import effects, path_error, repeatability
from course.platforms.models import MODELS, honesty, verdict
from course.platforms.scenes import brake, field, tower

Rows = Sequence[Sequence[Any]]
"""(scene, engine, settings, step [s], error at the end, unit, tolerance, cost over MuJoCo fair,
verdict, quartiles of the cost)."""

TABLE: dict[str, Callable[[], Scene]] = {
    **{name: SCENES[name] for name in ("tumble", "chain", "arm", "drop", "rest", "slide")},
    "brake": SCENES["brake"],
    "tower": partial(tower, 3),
    "grasp": SCENES["grasp"],
    "field": partial(field, 4),
}
ENGINES = ("own code", "MuJoCo", "Drake", "PyBullet")
SMOOTH = ("tumble", "chain", "arm")
TOUCHING = tuple(name for name in TABLE if name not in SMOOTH)


def stored_rows(name: str = "platforms_table") -> Rows:
    """Return the rows of a table as they were measured last.

    No simulator is needed to read them.
    """
    return from_json((FOLDER / f"{name}.json").read_text(encoding="utf-8"))["rows"]


def with_rows(panels: Sequence[Panel], rows: Rows) -> list[Panel]:
    """Return panels whose data file holds the rows of their table as well."""
    panels[0].data = {**document(panels), "rows": rows}
    return [*panels]


def errors(rows: Rows, scene: str, settings: str = "fair") -> dict[str, float]:
    """Return the error of every engine in a scene."""
    return {row[1]: row[4] for row in rows if row[0] == scene and row[2] == settings}


def costs(rows: Rows, scene: str, settings: str = "fair") -> dict[str, float]:
    """Return cost of every engine in a scene, over that of MuJoCo, fair."""
    return {row[1]: row[7] for row in rows if row[0] == scene and row[2] == settings}


def good(rows: Rows, engine: str, settings: str = "fair") -> set[str]:
    """Return the scenes in which an engine is within the tolerance."""
    return {row[0] for row in rows if row[1:3] == [engine, settings] and row[8] == "good"}


def spread(rows: Rows, scene: str, settings: str = "fair") -> float:
    """Return the largest error of the simulators over the smallest, our own code aside."""
    result = [e for name, e in errors(rows, scene, settings).items() if name != "own code"]
    return max(result) / min(result)


SENTENCES: dict[str, Callable[[Rows], bool]] = {
    "With the same scheme and step all engines err alike where nothing touches, to 0.2 %.": (
        lambda r: all(
            max(e.values()) < 1.002 * min(e.values()) for e in (errors(r, name) for name in SMOOTH)
        )
    ),
    "There the defaults of MuJoCo and Drake change nothing, PyBullet's more than tenfold.": (
        lambda r: all(
            max(
                abs(errors(r, s, "as shipped")[e] / errors(r, s)[e] - 1.0)
                for e in ("MuJoCo", "Drake")
            )
            < 1e-6
            and errors(r, s, "as shipped")["PyBullet"] > 10.0 * errors(r, s)["PyBullet"]
            for s in SMOOTH
        )
    ),
    "At 1 ms, the first-order schemes of all engines miss in chain, arm and slide.": (
        lambda r: not any(good(r, e) & {"chain", "arm", "slide"} for e in ENGINES)
    ),
    "Fair, all engines are good at tumble, drop, rest, brake, tower and field.": (
        lambda r: all(
            good(r, e) >= {"tumble", "drop", "rest", "brake", "tower", "field"} for e in ENGINES
        )
    ),
    "As shipped, simulators differ over 100-fold in tumble, rest, slide, brake, tower, grasp.": (
        lambda r: (
            {s for s in TABLE if spread(r, s, "as shipped") > 100.0}
            == {"tumble", "rest", "slide", "brake", "tower", "grasp"}
        )
    ),
    "Fair, they differ less than tenfold in rest, brake and slide.": (
        lambda r: max(spread(r, s) for s in ("rest", "brake", "slide")) < 10.0
    ),
    "As shipped, PyBullet misses rest, slide, brake and grasp, where it multiplies friction.": (
        lambda r: not good(r, "PyBullet", "as shipped") & {"rest", "slide", "brake", "grasp"}
    ),
    "As shipped, Drake's contact by points misses rest, slide, brake, tower and grasp.": (
        lambda r: not good(r, "Drake", "as shipped") & {"rest", "slide", "brake", "tower", "grasp"}
    ),
    "Our own contacts neither sink nor creep: rest, tower and grasp err by less than 1e-9 m.": (
        lambda r: max(errors(r, s)["own code"] for s in ("rest", "tower", "grasp")) < 1e-9
    ),
    "They are paid for: in every scene with contact our step costs over ten times MuJoCo's.": (
        lambda r: min(costs(r, s)["own code"] for s in TOUCHING) > 10.0
    ),
    "Drake's patches cost more than PyBullet's points in every scene with contact.": (
        lambda r: all(costs(r, s)["Drake"] > costs(r, s)["PyBullet"] for s in TOUCHING)
    ),
}


ROUNDS, SHORT = 15, 0.3  # pairs with MuJoCo, fair; seconds above which a motion is run twice only


def relative_costs(
    samplers: Sequence[Sampler], unit: int, rounds: int = ROUNDS
) -> list[list[float]]:
    """Return lower quartile, median and upper quartile of each motion's cost over one of them.

    Args:
        samplers: of whole motions, each from its start (`again`), warmed up.
        unit: whose cost is 1; it is timed again in every round.
        rounds: pairs of times; motions longer than `SHORT` have two.
    """
    ratios: list[list[float]] = [[] for _ in samplers]

    def seconds(k: int) -> float:
        # The engine that ran before has emptied the caches, and a motion of a few milliseconds
        # would take a tenth longer. So a short motion is run once more, and the second run counts.
        first = samplers[k](1)
        return samplers[k](1) if first < SHORT else first

    for turn in range(max(2, rounds)):
        # Ratios within a round cancel slow changes of the machine.
        own = seconds(unit)
        for k, some in enumerate(ratios):
            if k == unit:
                some.append(1.0)
            # Slow motions are run twice only.
            elif turn < 2 or some[0] * own < SHORT:
                some.append(seconds(k) / own)
    return [[float(x) for x in np.quantile(some, [0.25, 0.5, 0.75])] for some in ratios]


def scene_rows(name: str, dt: float, rounds: int = ROUNDS) -> list[list[Any]]:
    """Return the rows of a scene: every engine that is installed, fair and as shipped.

    The cost is the median over rounds of the processor time over that of MuJoCo, fair, in the same
    round; the quartiles of these ratios are the last two entries of a row.
    """
    scene = TABLE[name]()
    steps = max(1, round(scene.duration / dt))
    rows, samplers, runs = list[list[Any]](), list[Sampler](), []
    for engine in here().values():
        for settings in (FAIR, AS_SHIPPED) if engine.changes else (FAIR,):
            runs.append(prepared(engine, scene, dt, settings))
            samplers.append(again(runs[-1], steps))
            # A first run that isn't timed: it warms the caches and gives the error.
            samplers[-1](1)
            error = scene.error(runs[-1].state(), steps * dt)
            within = "good" if error <= scene.tolerance else "misses"
            known = [name, engine.name, settings.name, dt, error, scene.unit, scene.tolerance]
            rows.append([*known, 0.0, within])
    unit = next(k for k, row in enumerate(rows) if row[1:3] == ["MuJoCo", "fair"])
    for row, (low, middle, high) in zip(rows, relative_costs(samplers, unit, rounds), strict=True):
        row[7] = middle
        row += [low, high]
    for run in runs:
        run.close()
    return rows


@chart(columns=2)
def platforms_table(
    scenes: Sequence[str] = tuple(TABLE), dt: float = 1e-3, rounds: int = ROUNDS
) -> Iterator[Panel]:
    """Chart every scene by every engine, as shipped and fair, at one step: error, cost, verdict.

    Args:
        scenes: some of `TABLE`.
        dt: step [s].
        rounds: pairs of times of a motion.
    """
    rows: list[list[Any]] = []
    for name in scenes:
        rows += scene_rows(name, dt, rounds)
    panels = []
    for title, unit, how in (
        ("Error over tolerance, fair", "error over tolerance", "fair"),
        ("Error over tolerance, as shipped", "error over tolerance", "as shipped"),
        ("Cost of the motion, fair", "over MuJoCo's", "fair"),
    ):
        error = title.startswith("Error")
        panel = Panel(
            title,
            "",
            unit,
            scale="log y",
            ticks=tuple(range(len(scenes))),
            tick_names=tuple(scenes),
            lines=[("y", 1.0, "tolerance")] * error,
            footer=machine(0.0, libraries=LIBRARIES) if error else "",
        )
        for engine_name in here():
            some = [row for row in rows if row[1:3] == [engine_name, how]]
            x = [list(scenes).index(row[0]) for row in some]
            # An exact zero has no place on a logarithm.
            y = [max(row[4] / row[6], 1e-8) if error else row[7] for row in some]
            if some:
                panel.series.append(Series(engine_name, x, y, engine_name, "", size=6.0))
        panels.append(panel)
    report = panels[0].notes
    report.append(
        f"a step of {1e3 * dt:g} ms; cost over that of MuJoCo, fair; error at the end; below "
        "tolerance: good"
    )
    report.append(f"{'scene':<8} {'engine':<9} {'settings':<10} {'error':>10}     {'cost':>8}")
    for row in rows:
        report.append(
            f"{row[0]:<8} {row[1]:<9} {row[2]:<10} {row[4]:10.3e} {row[5]:<3} "
            f"{row[7]:8.2g} [{row[9]:.2g} {row[10]:.2g}]  {row[8]}"
        )
    if set(scenes) == set(TABLE) and set(here()) == set(ENGINES):
        report += [sentence for sentence, holds in SENTENCES.items() if holds(rows)]
    yield from with_rows(panels, rows)


# --- the whole motion, not only its end -------------------------------------------------------

ON_THE_WAY = ("chain", "drop", "rest", "slide", "brake", "tower", "grasp")
"""Scenes of `platform_paths`, whose rows are (scene, engine, settings, step [s], error at the end,
largest error, unit, tolerance, share of the time in the air)."""
# The block brakes until Coulomb's law has stopped it; what comes after would dilute the share.
MOVING = {"brake": SCENES["brake"]().duration / 1.5}
MESSAGES: dict[str, Callable[[Rows], bool]] = {
    "Fair, MuJoCo's braking and sliding blocks are in the air for over half of the time.": (
        lambda r: min(in_the_air(r, s)["MuJoCo"] for s in ("brake", "slide")) > 0.5
    ),
    "No other engine's block, braking or sliding, is in the air for over 1 % of the time.": (
        lambda r: (
            max(
                share
                for s in ("brake", "slide")
                for name, share in in_the_air(r, s).items()
                if name != "MuJoCo"
            )
            < 0.01
        )
    ),
    "On the way MuJoCo errs over four times as much as at the end, and more than as shipped.": (
        lambda r: (
            path_errors(r, "brake")["MuJoCo"]
            > max(
                4.0 * errors(r, "brake")["MuJoCo"],
                2.0 * path_errors(r, "brake", "as shipped")["MuJoCo"],
            )
        )
    ),
}


def path_errors(rows: Rows, scene: str, settings: str = "fair") -> dict[str, float]:
    """Return the largest error on the way of every engine, from rows of `platform_paths`."""
    return {row[1]: row[5] for row in rows if row[0] == scene and row[2] == settings}


def in_the_air(rows: Rows, scene: str, settings: str = "fair") -> dict[str, float]:
    """Return every engine's share of the time in the air, from rows of `platform_paths`."""
    return {row[1]: row[8] for row in rows if row[0] == scene and row[2] == settings}


def path_row(engine: Engine, name: str, settings: Settings, dt: float) -> list[Any]:
    """Return one row of `platform_paths`."""
    scene = TABLE[name]()
    # Only the time until Coulomb's law stops the block counts for the share in the air.
    one = path_error(engine, scene, dt, settings, moving=MOVING.get(name, math.inf))
    return [
        name,
        engine.name,
        settings.name,
        dt,
        one.final,
        one.largest,
        scene.unit,
        scene.tolerance,
        one.airborne,
    ]


@chart(columns=2)
def platform_paths(scenes: Sequence[str] = ON_THE_WAY, dt: float = 1e-3) -> Iterator[Panel]:
    """Chart the largest error of a motion beside that at its end, and the time in the air.

    Args:
        scenes: some of `TABLE`.
        dt: step [s].
    """
    rows = [
        path_row(engine, name, settings, dt)
        for name in scenes
        for engine in here().values()
        for settings in ((FAIR, AS_SHIPPED) if engine.changes else (FAIR,))
    ]
    ticks, panels = tuple(range(len(scenes))), []
    for how in ("fair", "as shipped"):
        panel = Panel(
            f"Largest error on the way, {how}",
            "",
            "error over tolerance",
            scale="log y",
            ticks=ticks,
            tick_names=tuple(scenes),
            lines=[("y", 1.0, "tolerance")],
            footer=machine(0.0, libraries=LIBRARIES),
        )
        # The links of a chain touch nothing at any time: it has no place among shares in the air.
        touching = [name for name in scenes if name not in SMOOTH]
        air = Panel(f"Share of the time in the air, {how}", "", "share")
        air.ticks, air.tick_names = tuple(range(len(touching))), tuple(touching)
        air.ylim = (-0.05, 1.05)
        for engine_name in here():
            some = [row for row in rows if row[1:3] == [engine_name, how]]
            if some:
                x = [list(scenes).index(row[0]) for row in some]
                # An exact zero has no place on a logarithm.
                y = [max(row[5] / row[7], 1e-8) for row in some]
                panel.series.append(Series(engine_name, x, y, engine_name, "", size=6.0))
                touch = [row for row in some if row[0] in touching]
                x, y = [touching.index(row[0]) for row in touch], [row[8] for row in touch]
                air.series.append(Series(engine_name, x, y, engine_name, "", size=6.0))
        panels += [panel, air]
    report = panels[0].notes
    report.append(f"a step of {1e3 * dt:g} ms; error at the end, largest on the way, in the air")
    for row in rows:
        report.append(
            f"{row[0]:<8} {row[1]:<9} {row[2]:<10} {row[4]:10.3e} {row[5]:10.3e} {row[6]:<3} "
            f"{100 * row[8]:5.1f} %"
        )
    if set(scenes) == set(ON_THE_WAY) and set(here()) == set(ENGINES):
        report += [sentence for sentence, holds in MESSAGES.items() if holds(rows)]
    yield from with_rows(panels, rows)


# --- one change at a time ---------------------------------------------------------------------

ASKED: dict[str, Mapping[str, Callable[[], Scene]]] = {
    "MuJoCo": {
        "brake at 22.5 deg": partial(brake, math.pi / 8),
        "rest": SCENES["rest"],
        "tower": partial(tower, 3),
        "grasp": SCENES["grasp"],
    },
    "Drake": {"rest": SCENES["rest"], "brake": brake, "tower": partial(tower, 3)},
    "PyBullet": {
        "tumble": SCENES["tumble"],
        "chain": SCENES["chain"],
        "rest": SCENES["rest"],
        "brake": brake,
    },
}


@chart(columns=1, height=2.6)
def platform_effects(
    engines: Sequence[str] = tuple(ASKED), at_most: int = 4, dt: float = 1e-3
) -> Iterator[Panel]:
    """Chart each change between as shipped and fair by itself: what it does to the error.

    Args:
        engines: names of the engines to measure.
        at_most: scenes of each.
        dt: step [s].
    """
    panels, rows = [], []
    for name in engines:
        if name not in here():
            continue
        panel = Panel(
            f"{name}: fair without one change, error over fair",
            "logarithm to base 10 of the factor (its value is at the bar)",
            xlim=(-2.0, 4.8),
            footer=machine(0.0, libraries=LIBRARIES),
        )
        names, tags, without = [], [], []
        for label, make in list(ASKED[name].items())[:at_most]:
            for one in effects(here()[name], make(), dt):
                rows.append([name, label, one.key, one.shipped, one.alone, one.without, one.fair])
                panel.notes.append(
                    f"{name:<8} {label:<17} {one.key:<12} shipped {one.shipped:9.3e}, with it "
                    f"alone {one.alone:9.3e}, without it {one.without:9.3e}, fair {one.fair:9.3e}"
                )
                # What the fair settings lose if this one change is taken back.
                factor = one.without / one.fair
                if abs(factor - 1.0) > 0.02:
                    # A bar to the left has no room for its number at its end.
                    names.append(f"{label}: {one.key}" + f", {factor:.2g}" * (factor < 1.0))
                    tags.append(f"{factor:.3g}" * (factor > 1.0))
                    without.append(math.log10(factor))
        panel.series = [Series("", without, names, name, "bar", tags=tags)]
        panels.append(panel)
    yield from with_rows(panels, rows)


# --- readers of models ------------------------------------------------------------------------


@chart(columns=2)
def platform_readers(readers: Sequence[str] = tuple(READERS)) -> Iterator[Panel]:
    """Chart what five readers of models do with faulty texts, and which features they keep."""
    rows: list[list[str]] = []
    for reader in readers:
        try:
            result = readings(reader)
        # A reader that isn't installed has no row.
        except ImportError:
            continue
        rows += [[reader, m.name, m.kind, verdict(m, result[m.name])] for m in MODELS]
    requested = list(dict.fromkeys(row[0] for row in rows))

    def count(reader: str, kinds: Sequence[str], verdicts: Sequence[str]) -> int:
        return sum(row[0] == reader and row[2] in kinds and row[3] in verdicts for row in rows)

    panels = []
    reported = ("refused or warned", ("refused", "warned"))
    # A silent repair counts: what runs then isn't the model in the file.
    silent = ("swallowed, repaired or crashed", ("swallowed", "repaired", "crashed"))
    preserved, lost = ("kept", ("kept",)), ("lost or crashed", ("swallowed", "crashed"))
    for title, kinds, parts in (
        ("Models that cannot exist", ("impossible",), (reported, silent)),
        ("Files that break the format", ("broken",), (reported, silent)),
        ("Features", ("feature",), (preserved, lost)),
    ):
        of = sum(model.kind in kinds for model in MODELS)
        panel = Panel(
            f"{title} ({of})",
            "models",
            xlim=(0, of + 0.5),
            footer=machine(0.0, libraries=(*LIBRARIES, "pin")),
        )
        for label, verdicts in parts:
            number = [count(reader, kinds, verdicts) for reader in requested]
            panel.series.append(Series(label, number, requested, style="bar"))
        panels.append(panel)
    report = panels[0].notes
    report.append(f"{'model':<17} " + " ".join(f"{reader:<10}" for reader in requested))
    for model in MODELS:
        each = [row[3] for row in rows if row[1] == model.name]
        report.append(f"{model.name:<17} " + " ".join(f"{word:<10}" for word in each))
    for reader in requested:
        share = honesty({row[1]: row[3] for row in rows if row[0] == reader})
        report.append(f"{reader}: refuses or warns about {100 * share:.0f} % of the faulty models")
    yield from with_rows(panels, rows)


@chart(columns=2)
def platform_installs(processes: int = 3, steps: int = 200) -> Iterator[Panel]:
    """Chart an engine's cost before its first step, and whether its runs repeat bit by bit."""
    # Each engine in new processes: an import is only paid once per process.
    result = {name: install(name, processes) for name in here()}
    panels = []
    for title, unit, field_ in (
        ("Size on disk", "MB", "size"),
        ("Import", "s", "import_time"),
        ("A chain of six from its text", "s", "load_time"),
        ("Memory", "MB", "memory"),
    ):
        sizes = [float(getattr(one, field_)) for one in result.values()]
        panel = Panel(
            f"{title} [{unit}]",
            unit,
            xlim=(0, 1.25 * max(sizes)),
            footer=machine(0.0, libraries=LIBRARIES),
        )
        tags = [f"{x:.3g}" if x > 1e-5 else "0" for x in sizes]
        panel.series.append(Series("", sizes, list(result), style="bar", tags=tags))
        panels.append(panel)
    rows: list[list[Any]] = []
    for name, one in result.items():
        # Fewer steps of our own code, which pays for Python in every step.
        again_ = repeatability(here()[name], brake(), 1e-3, 40 if name == "own code" else steps)
        rows.append(
            [
                name,
                one.version,
                one.size,
                one.import_time,
                one.load_time,
                one.memory,
                again_.fresh,
                again_.reset,
                again_.saved,
            ]
        )
        panels[0].notes.append(
            f"{name:<9} {one.version:<7} {one.size:7.1f} MB, import {one.import_time:.2f} s, load "
            f"{1e3 * float(one.load_time or 0):.1f} ms, memory {one.memory:.0f} MB; differs: fresh "
            f"{again_.fresh:.1e}, reset {again_.reset:.1e}, saved {again_.saved:.1e}"
        )
    yield from with_rows(panels, rows)
