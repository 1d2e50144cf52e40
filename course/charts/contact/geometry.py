"""Chapter 2, geometry: broad phase by size, narrow phase beside Coal, and where walls leak."""

import functools
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from course import contact
from course.charts import chart
from course.contact import broad
from course.contact.narrow import measured
from course.contact.shapes import Array, Shape
from course.measure.figure import Panel, Series
from course.measure.timing import Ratio, Timing, calls, interleaved, pairwise_ratios
from course.measure.work_precision import machine
from course.oracles import coal
from course.oracles.mujoco import shapes as mujoco_shapes
from course.rigid_body.quaternion import exp, product

THEORY = {"spread": 5 / 3, "settled": 3 / 2, "aligned": 2.0}
WORDS = {"spread": "spread in a cube", "settled": "in one layer", "aligned": "aligned on the axis"}
LABELS = {"kept order": "sweep, presorted", "sweep and prune": "sweep, unsorted"}
SIZES = (100, 300, 1000, 3000, 10_000, 30_000, 100_000)


def _power(x: Sequence[float], y: Sequence[float]) -> float:
    # Slope in a log-log plot.
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def _law(x: Sequence[float], y: Sequence[float], exponent: float) -> Callable[[float], float]:
    """Return the power law with that exponent through the last point."""
    return lambda n: y[-1] * (n / x[-1]) ** exponent


def _moved(boxes: Array, rng: np.random.Generator) -> Array:
    """Return each box moved by one per cent of an edge, 7.5 mm, in any direction."""
    return boxes + rng.normal(scale=0.0075, size=boxes.shape[1:])


@chart
def broad_phase(
    sizes: Sequence[int] = SIZES,
    aligned: int = 30_000,
    brute: int = 10_000,
    mujoco: int = 3000,
    repeats: int = 5,
) -> Iterator[Panel]:
    """Chart overlap tests, which no machine changes, and times; sweeping one axis, three crowds."""
    counts = Panel(
        "Overlap tests, and pairs that remain",
        "boxes N",
        "number per sweep",
        scale="log",
        theory="predicted powers of N",
    )
    for kind, theory in THEORY.items():
        n = [size for size in sizes if kind != "aligned" or size <= aligned]
        tests, pairs, swaps = [], [], []
        for size in n:
            rng = np.random.default_rng(size)
            boxes = broad.crowd(kind, size, rng)
            sweep = contact.SweepAndPrune(axis=0)
            pairs.append(sweep.pairs(boxes).shape[1])
            tests.append(sweep.tests)
            # A second sweep after a small motion: temporal coherence shows in the number of swaps.
            sweep.pairs(_moved(boxes, rng))
            swaps.append(sweep.swaps)
        exponent, grown, swapped = (_power(n, result) for result in (tests, pairs, swaps))
        note = f"{kind:<8} tests N^{exponent:.2f}, theory N^{theory:.2f}; pairs N^{grown:.2f}"
        if kind == "spread":
            note += f"; swaps after a move of 1 % N^{swapped:.2f}"
        counts.series.append(
            Series(
                f"tests, {WORDS[kind]}: $N^{{{exponent:.2f}}}$",
                n,
                tests,
                theory=_law(n, tests, theory),
                note=note,
            )
        )
        if kind == "spread":
            label = f"swaps after a move of 1 %: $N^{{{swapped:.2f}}}$"
            counts.series += [
                Series(f"pairs, {WORDS[kind]}: $N^{{{grown:.2f}}}$", n, pairs, style=":"),
                Series(label, n, swaps, style="--"),
            ]
    yield counts
    times = Panel("Time to find the pairs in the cube", "boxes N", "time [s]", scale="log")
    result: dict[str, list[tuple[int, Timing]]] = {}
    for size in sizes:
        rng = np.random.default_rng(size)
        boxes = broad.crowd("spread", size, rng)
        retained, paths = (
            contact.SweepAndPrune(axis=0),
            itertools.cycle((_moved(boxes, rng), boxes)),
        )
        methods = {
            "sweep and prune": calls(lambda b=boxes: contact.SweepAndPrune(axis=0).pairs(b)),
            # Two states in turn, so that every call has something to re-sort.
            "kept order": calls(lambda k=retained, w=paths: k.pairs(next(w))),
            "uniform grid": calls(contact.uniform_grid, boxes),
        }
        if size <= brute:
            methods["brute force"] = calls(contact.brute_force, boxes)
        if size <= mujoco:
            methods["MuJoCo"] = mujoco_shapes.BroadPhase(boxes).seconds
        # All methods that can still take this size, in turn.
        timings = interleaved(list(methods.values()), repeats=repeats)
        for name, timing in zip(methods, timings, strict=True):
            result.setdefault(name, []).append((size, timing))
    for name, rows in result.items():
        n, median = [size for size, _ in rows], [timing.median for _, timing in rows]
        # Small sizes measure what a call costs by itself.
        large = [k for k, size in enumerate(n) if size >= 1000] or list(range(len(n)))
        slope = _power([n[k] for k in large], [median[k] for k in large]) if large[1:] else 0.0
        times.series.append(
            Series(
                f"{LABELS.get(name, name)}: $N^{{{slope:.2f}}}$" if slope else name,
                n,
                median,
                name,
                low=[timing.low for _, timing in rows],
                high=[timing.high for _, timing in rows],
                note=f"{name:<16} "
                + ", ".join(f"{a}: {1e3 * b:.3g} ms" for a, b in zip(n, median, strict=True)),
            )
        )
    times.footer = machine(max(timing.busy for rows in result.values() for _, timing in rows))
    yield times


def kinds() -> dict[str, Shape]:
    """Return one shape of each kind, of about the same size."""
    cloud = np.random.default_rng(7).normal(size=(3, 12)) * 0.4
    return {
        "sphere": contact.sphere(0.4),
        "capsule": contact.capsule(0.25, 0.5),
        "box": contact.box([0.3, 0.4, 0.6]),
        "points": contact.points(cloud),
    }


def random_poses(rng: np.random.Generator, n: int, spread: float) -> Array:
    """Return any rotation, places in a cube, shape (7, n)."""
    q = rng.normal(size=(4, n))
    return np.vstack((rng.uniform(-spread, spread, (3, n)), q / np.linalg.norm(q, axis=0)))


def drawn_pairs(a: Shape, b: Shape, n: int, apart: bool) -> tuple[Array, Array]:
    """Return a number of random pairs that are apart, or in each other."""
    rng = np.random.default_rng(3)
    retained: list[tuple[Array, Array]] = []
    while sum(pair[0].shape[1] for pair in retained) < n:
        pose_a, pose_b = (random_poses(rng, 4 * n, 1.2 if apart else 0.5) for _ in range(2))
        # Rejection sampling of one kind of pair.
        some = (contact.distance(a, pose_a, b, pose_b).distance > 0.0) == apart
        retained.append((pose_a[:, some], pose_b[:, some]))
    first, second = (np.hstack([pair[k] for pair in retained])[:, :n] for k in (0, 1))
    return np.ascontiguousarray(first), np.ascontiguousarray(second)


def _timed(a: Shape, b: Shape, qa: Array, qb: Array, repeats: int) -> tuple[float, list[Ratio]]:
    """Return seconds a pair of `contact.distance`, and over that the times of Coal.

    In one call of Pinocchio's for all pairs, and in one call a pair from Python. Poses are set
    before the clock starts, in the form that each of them reads.
    """
    pair, batch, clock = coal.Pair(a, b), coal.Batch(a, qa, b, qb), time.process_time
    # The same pairs three ways; transforms are built before the clock starts.
    samplers = [
        calls(contact.distance, a, qa, b, qb, clock=clock),
        calls(batch.compute, clock=clock),
        calls(pair.loop, coal.transforms(qa), coal.transforms(qb), clock=clock),
    ]
    # Our absolute time, and the ratios from paired samples.
    (own,) = interleaved(samplers[:1], repeats=repeats, sample=2e-3)
    return own.median / qa.shape[1], pairwise_ratios(samplers, pairs=repeats, sample=2e-3)


@chart(columns=2)
def narrow_phase(count: int = 1000, repeats: int = 15, boxes: int = 2000) -> Iterator[Panel]:
    """Chart time of Coal over the course's, in turns in one process; for boxes error over time."""
    shapes = kinds()
    for apart in (True, False):
        what = "apart: distance" if apart else "in each other: depth"
        panel = Panel(
            f"Shapes {what}, {count} pairs at a time",
            "time of Coal / time of the course",
            scale="log x",
            lines=[("x", 1.0, "")],
        )
        names, batched, looped, worst = [], [], [], 0.0
        for first, second in itertools.combinations_with_replacement(shapes, 2):
            a, b = shapes[first], shapes[second]
            qa, qb = drawn_pairs(a, b, count, apart)
            own, (batch, loop) = _timed(a, b, qa, qb, repeats)
            error = contact.distance(a, qa, b, qb).distance - coal.Pair(a, b).distances(qa, qb)
            worst = max(worst, float(np.abs(error).max()) / (a.size + b.size))
            names.append(f"{first}, {second}")
            batched.append(batch)
            looped.append(loop)
            panel.notes.append(
                f"{names[-1]:<17}{'apart' if apart else 'deep':<6} {1e6 * own:5.2f} us, Coal in "
                f"one call for all: {batch}, one call a pair: {loop}"
            )
        panel.notes.append(f"largest difference from Coal {worst:.1e} of the size, {what}")
        for name, ratios in (("Coal, a call a pair", looped), ("Coal, one call for all", batched)):
            panel.series.append(Series(name, [r.median for r in ratios], names, name, "bar"))
        yield panel
    yield _box_panel(boxes, repeats)


def box_scenes(n: int) -> dict[str, tuple[Array, Array]]:
    """Return pairs of boxes: at random, all but parallel, and aligned with small gaps."""
    rng = np.random.default_rng(5)
    pose_a, pose_b = random_poses(rng, n, 0.8), random_poses(rng, n, 0.8)
    near = pose_b.copy()
    # All but parallel edges, where the cross products of the separating axes vanish.
    near[3:] = product(pose_a[3:], exp(1e-8 * rng.normal(size=(3, n))))
    aligned = np.zeros((7, n))
    aligned[3] = 1.0
    beside = aligned.copy()
    beside[0] = 0.6 + 10.0 ** rng.uniform(-9, -1, n)
    beside[1:3] = rng.uniform(-0.3, 0.3, (2, n))
    return {
        "random": (pose_a, pose_b),
        "turned by 1e-8": (pose_a, near),
        "aligned, small gap": (aligned, beside),
    }


def _box_panel(n: int, repeats: int) -> Panel:
    box = kinds()["box"]
    panel = Panel(
        "Two boxes: time and error; the truth is from all pairs of features",
        "time of a pair [s]",
        "largest error / size",
        scale="log",
        lines=[("y", 1e-9, "enough for a planner: a nanometre per metre")],
    )
    rows: dict[str, list[tuple[float, float]]] = {}
    scenes = box_scenes(n)
    tight, loose = coal.Pair(box, box), coal.Pair(box, box, None)
    methods: dict[str, Callable[..., object]] = {
        "GJK and EPA": lambda qa, qb, *_: contact.distance(box, qa, box, qb).distance,
        "Coal, tolerance 1e-12": lambda _, __, *places: tight.loop(*places),
        "Coal, default tolerance": lambda _, __, *places: loose.loop(*places),
        "every feature": lambda qa, qb, *_: contact.enumerated(box, qa, box, qb),
    }
    for qa, qb in scenes.values():
        given = qa, qb, coal.transforms(qa), coal.transforms(qb)
        # All pairs of features: slow, without iteration, and independent of GJK.
        truth = contact.enumerated(box, qa, box, qb)
        samplers = [calls(run, *given, clock=time.process_time) for run in methods.values()]
        timings = interleaved(samplers, repeats=repeats)
        for (name, run), timing in zip(methods.items(), timings, strict=True):
            deviation = float(np.abs(np.asarray(run(*given)) - truth).max()) / (2 * box.size)
            rows.setdefault(name, []).append((timing.median / n, deviation))
    for name, points in rows.items():
        cost, error = (np.array(column) for column in zip(*points, strict=True))
        if name == "every feature":
            panel.notes.append(f"{name:<24} {1e6 * np.median(cost):6.1f} us a pair: the truth here")
            continue
        # An exact zero has no place on a logarithm: it is drawn at the rounding of the size.
        panel.series.append(
            Series(
                name,
                cost,
                np.maximum(error, 1e-17),
                name.removesuffix(", tolerance 1e-12"),
                "",
                tags=list(scenes),
                note=f"{name:<24} "
                + ", ".join(f"{scene}: {e:.1e}" for scene, e in zip(scenes, error, strict=True)),
            )
        )
    panel.footer = machine()
    return panel


RADIUS, WALL, TIMECONST = 0.02, 0.01, 0.02
REACH, STILL = RADIUS + WALL / 2, np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def _ball_and_wall() -> tuple[Shape, Shape]:
    return contact.sphere(RADIUS), contact.box([WALL / 2, 1.0, 1.0])


def checked(dt: float, speed: float, phase: float) -> bool:
    """Return whether a ball of 20 mm passes a wall of 10 mm between two tests of their distance."""
    ball, wall = _ball_and_wall()
    step = speed * dt
    at = np.tile(STILL[:, None], 2 + int(2 * REACH / step))
    # Positions at the tests, from one step before the wall to behind it.
    at[0] = -REACH - step * (1.0 - phase) + step * np.arange(at.shape[1])
    still = np.tile(STILL[:, None], at.shape[1])
    return bool((measured(ball, at, wall, still)[0] > 0.0).all())


def advanced(dt: float, speed: float, phase: float) -> bool:
    """Return whether the ball passes if every step is searched for its time of impact."""
    ball, wall = _ball_and_wall()
    start, go = STILL.copy(), np.array([speed, 0.0, 0.0, 0.0, 0.0, 0.0])
    start[0] = -REACH - speed * dt * (1.0 - phase)
    for _ in range(2 + int(2 * REACH / (speed * dt))):
        # A finite time of impact within the step stops the ball.
        if np.isfinite(contact.time_of_impact(ball, start, go, wall, STILL, 0 * go, dt).time):
            return False
        start[0] += speed * dt
    return True


def in_mujoco(dt: float, speed: float, phase: float, speculative: bool = False) -> bool:
    """Return whether the ball passes in MuJoCo."""
    return mujoco_shapes.passes(speed, dt, 0.01 + phase * speed * dt, RADIUS, WALL, speculative)


@chart
def tunnelling_limit(
    steps: Sequence[float] = (2.5e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2), grid: int = 54, phases: int = 4
) -> Iterator[Panel]:
    """Chart the least speed at which a ball passes through a wall, by step, with two cures."""
    speeds = np.geomspace(1.0, 400.0, grid)
    soft = math.e * REACH / TIMECONST
    panel = Panel(
        "A ball of 20 mm radius, a wall of 10 mm: the lowest speed that passes (top: none does)",
        "step [s]",
        "speed [m/s]",
        scale="log",
        theory="geometric limit (2 r + w) / h",
        lines=[("y", soft, "MuJoCo's soft limit e (r + w/2) / timeconst")],
    )
    ratio = float(speeds[1] / speeds[0])
    panel.notes.append(f"speeds on a grid of {100 * (ratio - 1):.0f} %; soft limit {soft:.2f} m/s")
    # A run of MuJoCo takes long; elsewhere many phases find the first that slips through.
    rows: dict[str, tuple[Callable[..., bool], int]] = {
        "checked once a step": (checked, 10 * phases),
        "advanced to the impact": (advanced, 10 * phases),
        "MuJoCo, default": (in_mujoco, phases),
        "MuJoCo, speculative": (functools.partial(in_mujoco, speculative=True), phases),
    }
    for name, (passes, tried) in rows.items():
        shares = (np.arange(tried) + 0.5) / tried
        result = [
            # The slowest speed of the grid at which some phase passes.
            next((float(v) for v in speeds if any(passes(dt, v, p) for p in shares)), np.inf)
            for dt in steps
        ]
        shown = ", ".join(
            f"{1e3 * dt:g} ms: "
            + (f"{v:.3g}" if np.isfinite(v) else f"none up to {speeds[-1]:.0f}")
            for dt, v in zip(steps, result, strict=True)
        )
        theory = (lambda dt: 2 * REACH / dt) if passes is checked else None
        panel.series.append(
            Series(
                name,
                list(steps),
                result,
                name,
                theory=theory,
                # Its triangles lie on those of MuJoCo, which have to show through.
                hollow=passes is advanced,
                note=f"{name:<24} {shown}",
            )
        )
    yield panel
