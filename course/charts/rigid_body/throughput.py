"""Chapter 1: how many bodies a core can step, beside `mujoco.batch`, at the same accuracy."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from course.charts import chart
from course.check import invalid
from course.measure.figure import Panel, Series
from course.measure.timing import batches, calls, interleaved
from course.measure.work_precision import machine
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import free as mujoco_free
from course.rigid_body import planar, problems, quaternion
from course.rigid_body.integrators import STANDARD_GRAVITY, Array
from course.rigid_body.spatial import advance_bodies

SIZES = (1, 10, 100, 1000, 10_000, 100_000)
# A whole run of this many boxes would take MuJoCo minutes: above this number, a run is a few steps
# of boxes that are caught at all moments of their runs.
MIXED_FROM = 100_000


Run = Callable[[int], tuple[Array, Any]]
"""Takes a number of steps from the start, the same one every time."""


@dataclass(frozen=True)
class Contender:
    """One way of stepping N bodies with one step size.

    Attributes:
        name: at the end of its curve.
        key: row of `course.measure.colours.KEYS`.
        dt: step [s], the largest tried that meets the tolerance.
        error: its largest error at that step.
        prepare: N -> a run of N bodies.
    """

    name: str
    key: str
    dt: float
    error: float
    prepare: Callable[[int], Run]


@dataclass(frozen=True)
class Rate:
    """Median and quartiles of the body-steps per second of a contender with n bodies."""

    contender: Contender
    n: int
    steps_per_second: float
    low: float
    high: float
    busy: float

    @property
    def seconds_per_second(self) -> float:
        """Simulated body-seconds per second."""
        return self.steps_per_second * self.contender.dt


BOX = (0.3, 0.2)
BOX_TOLERANCE = 5e-3  # m, a fortieth of the box's height: which way it falls is right, a grasp is
BODY_TOLERANCE = 1e-3  # rad
INERTIA = (1.0, 2.0, 2.5)
OURS = "rk4_renormalised"
DURATION = 1.0  # s
_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4, 5e-5)


def box_states(n: int, seed: int = 7) -> Array:
    """Return boxes thrown at random above the ground, shape (6, n)."""
    rng = np.random.default_rng(seed)
    state = np.empty((6, n))
    state[0] = rng.uniform(-5.0, 5.0, n)
    state[1] = rng.uniform(0.6, 1.4, n)
    state[2] = rng.uniform(0.0, 2.0 * np.pi, n)
    state[3:5] = rng.normal(0.0, 0.5, (2, n))
    state[5] = rng.normal(0.0, 1.5, n)
    return state


def mixed_states(n: int, groups: int = 20) -> Array:
    """Return the boxes of `box_states` at moments spread evenly over their run, shape (6, n)."""
    state = box_states(n)
    rough = planar.box_parameters(1.0, *BOX, restitution=0.5, friction=0.5)
    for i in range(groups):
        # Every group is advanced to another moment: a few steps then meet all phases of the motion.
        part = slice(i, n, groups)
        steps = round((i + 0.5) / groups * DURATION / 1e-3)
        state[:, part], _ = planar.advance_boxes(
            state[:, part], rough, 1e-3, steps, integrator="rk4"
        )
    return state


def body_states(n: int, seed: int = 7) -> tuple[Array, Array]:
    """Return free bodies thrown at random, shapes (7, n) and (6, n)."""
    rng = np.random.default_rng(seed)
    q = np.concatenate([rng.uniform(-5, 5, (3, n)), quaternion.exp(rng.normal(0, 1, (3, n)))])
    return q, rng.normal(0.0, 1.0, (6, n))


def _coarsest(errors: Callable[[float], float], tolerance: float) -> tuple[float, float]:
    """Return the largest step of the list that meets the tolerance, as does the next finer one."""
    result = errors(_STEPS[0])
    for dt, finer in itertools.pairwise(_STEPS):
        error, result = result, errors(finer)
        # Two in a row, so that a lucky coarse step isn't taken for accurate.
        if error <= tolerance and result <= tolerance:
            return dt, error
    raise invalid("tolerance", tolerance, f"one that a step down to {_STEPS[-1]} s meets")


def box_contenders(samples: int = 24) -> list[Contender]:
    """Return planar boxes on the ground: ours and MuJoCo's, each at the step the tolerance allows.

    The accuracy is judged on frictionless boxes up to half a second, through their first
    impacts, against `problems.frictionless_box`; later bounces multiply any error by ten and
    more, in either engine. The rate is measured with friction on the same kind of boxes until
    they lie still, so all phases count: flight, impact, slide and rest.
    """
    horizon, restitution = 0.5, 0.5
    start = box_states(samples)
    # Frictionless boxes have a reference that uses neither engine's contact solver.
    truth = np.array(
        [problems.frictionless_box(horizon, s, *BOX, restitution)[:2] for s in start.T]
    ).T

    def ours(state: Array, dt: float, friction: float = 0.5) -> Run:
        box = planar.box_parameters(1.0, *BOX, restitution=restitution, friction=friction)
        return lambda steps: planar.advance_boxes(state, box, dt, steps, integrator="rk4")

    def mujocos(state: Array, dt: float, friction: float = 0.5) -> Run:
        return mujoco_box.batch_boxes(
            (0.5 * BOX[0], 0.5 * BOX[1]),
            1.0,
            state[:3],
            state[3:],
            dt,
            "Euler",
            restitution=restitution,
            friction=friction,
            gravity=STANDARD_GRAVITY,
        ).run

    def errors(engine: Callable[..., Run], longest: float) -> Callable[[float], float]:
        def error(dt: float) -> float:
            if dt > longest:
                return np.inf
            steps = round(horizon / dt)
            end, _ = engine(start, horizon / steps, 0.0)(steps)
            # The median: a box that lands on its corner multiplies any error.
            return float(np.median(np.max(np.abs(end[:2] - truth), axis=0)))

        return error

    def prepare(engine: Callable[..., Run], dt: float) -> Callable[[int], Run]:
        return lambda n: engine(box_states(n) if n < MIXED_FROM else mixed_states(n), dt)

    ours_error, mujoco_error = errors(ours, horizon), errors(mujocos, 0.05)
    dt, error = _coarsest(mujoco_error, BOX_TOLERANCE)
    own, own_error = _coarsest(ours_error, BOX_TOLERANCE)
    return [
        Contender("course", "course", dt, ours_error(dt), prepare(ours, dt)),
        Contender("mujoco.batch", "mujoco.batch", dt, error, prepare(mujocos, dt)),
        Contender("course, its own step", "course", own, own_error, prepare(ours, own)),
    ]


def body_contenders(
    samples: int = 24, integrators: Sequence[str] = ("RK4", "Euler", "implicitfast")
) -> list[Contender]:
    """Return free bodies, each at the coarsest step that keeps its orientation to 1 mrad."""
    start = body_states(samples)
    # Reference with a step far below those compared.
    fine, _ = advance_bodies(*start, INERTIA, 5e-4, 2000)

    def ours(q: Array, v: Array, dt: float) -> Run:
        gravity = (0.0, 0.0, -STANDARD_GRAVITY)
        return lambda steps: advance_bodies(q, v, INERTIA, dt, steps, gravity, OURS)

    def mujocos(name: str) -> Callable[[Array, Array, float], Run]:
        return lambda q, v, dt: (
            mujoco_free.batch_free_bodies(INERTIA, q, v, dt, name, gravity=STANDARD_GRAVITY).run
        )

    def contender(name: str, key: str, engine: Callable[[Array, Array, float], Run]) -> Contender:
        def error(dt: float) -> float:
            steps = round(DURATION / dt)
            q, _ = engine(*start, DURATION / steps)(steps)
            error = quaternion.angle_between(quaternion.normalise(q[3:]), fine[3:])
            return float(np.max(error))

        dt, reached = _coarsest(error, BODY_TOLERANCE)
        return Contender(name, key, dt, reached, lambda n: engine(*body_states(n), dt))

    return [contender(f"course {OURS}", OURS, ours)] + [
        contender(f"mujoco.batch {name}", f"mujoco.batch, {name}", mujocos(name))
        for name in integrators
    ]


def measure_rates(
    contenders: Sequence[Contender],
    sizes: Sequence[int] = SIZES,
    repeats: int = 5,
    sample: float = 0.05,
    horizon: float | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> list[Rate]:
    """Measure body-steps per second of every contender and size, interleaved in one process.

    Args:
        contenders: what to run; one thread each.
        sizes: numbers of bodies.
        repeats: rounds; each runs every contender once.
        sample: about the time of one sample [s].
        horizon: simulated time of a run [s], which sets the mix of flight and contact; default,
            and for batches from MIXED_FROM on: as many steps as a sample takes.
        clock: see `course.measure.timing.calls`.
    """
    rates = []
    for n in sizes:
        whole = horizon if n < MIXED_FROM else None
        steps = [1 if whole is None else max(1, round(whole / c.dt)) for c in contenders]
        # States and models are prepared before the clock starts.
        runs = [contender.prepare(n) for contender in contenders]
        samplers = [
            # Without a horizon one call takes as many steps as fit; otherwise whole runs are
            # repeated.
            batches(run, clock) if whole is None else calls(run, count, clock=clock)
            for run, count in zip(runs, steps, strict=True)
        ]
        timed = interleaved(samplers, repeats=repeats, sample=sample)
        for name, count, result in zip(contenders, steps, timed, strict=True):
            work = n * count
            rates.append(
                Rate(
                    name,
                    n,
                    work / result.median,
                    work / result.high,
                    work / result.low,
                    result.busy,
                )
            )
    return rates


def memory_bandwidth(megabytes: int = 256) -> float:
    """Return bytes per second that a plain copy moves, read and written, best of five."""
    source = np.ones(megabytes * 131_072)
    (result,) = interleaved([calls(np.copyto, np.empty_like(source), source)])
    # Read and written once each.
    return 2.0 * source.nbytes / result.best


def ratios(rates: Sequence[Rate], ours: str, theirs: str) -> tuple[float, float]:
    """Return our best rate over the other side's best rate.

    Rates are (body-steps, simulated seconds) per second.
    """
    steps, seconds = (
        # Each side at its best N.
        {name: max(by(r) for r in rates if r.contender.name == name) for name in (ours, theirs)}
        for by in (lambda r: r.steps_per_second, lambda r: r.seconds_per_second)
    )
    return steps[ours] / steps[theirs], seconds[ours] / seconds[theirs]


def _limit_text(rates: list[Rate], name: str, bytes_per_body: int) -> str:
    """Return what limits a rate: bytes it must move if a body's state passes once per step."""
    bandwidth = memory_bandwidth()
    best = max(r.steps_per_second for r in rates if r.contender.name == name)
    # Roofline argument: bytes that must move against those that a copy moves.
    share = best * bytes_per_body / bandwidth
    kind = "arithmetic and latency, not by memory" if share < 0.5 else "memory bandwidth"
    return (
        f"{name}: {best:.3g} body-steps/s; with the state read and written at every step that is "
        f"{best * bytes_per_body / 1e9:.2f} GB/s of the {bandwidth / 1e9:.1f} GB/s a copy reaches "
        f"({100 * share:.0f} %): limited by {kind}"
    )


def _at_rest(samples: int = 1000) -> float:
    """Return share of the boxes of a run that lie still at its end, where the kernel skips them."""
    rough = planar.box_parameters(1.0, *BOX, restitution=0.5, friction=0.5)
    end, _ = planar.advance_boxes(box_states(samples), rough, 1e-3, round(DURATION / 1e-3))
    return float(np.mean(np.all(end[3:] == 0.0, axis=0)))


def _table(rates: Sequence[Rate]) -> str:
    lines = [f"{'who':<30} {'N':>7} {'dt':>8} {'error':>9} {'body-steps/s':>13} {'sim s / s':>10}"]
    lines += [
        f"{r.contender.name:<30} {r.n:>7} {r.contender.dt:>8.4g} {r.contender.error:>9.1e} "
        f"{r.steps_per_second:>13.3g} {r.seconds_per_second:>10.3g}"
        for r in rates
    ]
    return "\n".join(lines)


def _panel(title: str, y: str, rates: Sequence[Rate], per_step: bool) -> Panel:
    panel = Panel(title, "number of bodies N", y, scale="log")
    panel.footer = machine(max(r.busy for r in rates)) + "; one core"
    for name in dict.fromkeys(r.contender for r in rates):
        rows = [r for r in rates if r.contender == name]
        middle, low, high = (
            [value * (1.0 if per_step else name.dt) for value in values]
            for values in (
                [r.steps_per_second for r in rows],
                [r.low for r in rows],
                [r.high for r in rows],
            )
        )
        panel.series.append(
            Series(
                f"{name.name}, dt = {name.dt * 1e3:g} ms",
                [r.n for r in rows],
                middle,
                name.key,
                "--" if "mujoco" in name.name else "-",
                low=low,
                high=high,
            )
        )
    return panel


@chart
def throughput(
    sizes: Sequence[int] = SIZES, samples: int = 24, horizon: float = DURATION, repeats: int = 5
) -> Iterator[Panel]:
    """Chart batches of planar boxes and free bodies beside mujoco.batch.

    Args:
        sizes: numbers of bodies.
        samples: bodies by which the accuracy is judged.
        horizon: simulated time of a run of boxes [s].
        repeats: rounds.
    """
    boxes = measure_rates(box_contenders(samples), sizes, repeats, horizon=horizon)
    same = [r for r in boxes if "own" not in r.contender.name]
    same_step_panel = _panel(
        "Planar boxes on the ground, same step", "body-steps per second", same, True
    )
    step, _ = ratios(boxes, "course", "mujoco.batch")
    _, own = ratios(boxes, "course, its own step", "mujoco.batch")
    same_step_panel.notes = [
        _table(boxes),
        f"boxes: {step:.0f} times the body-steps of mujoco.batch at its own step; "
        f"{own:.0f} times the simulated time at each one's own step "
        f"({100 * _at_rest():.0f} % of the boxes lie still at the end of a run)",
        _limit_text(boxes, "course", 2 * 6 * 8),
    ]
    yield same_step_panel

    bodies = measure_rates(body_contenders(samples), sizes, repeats)
    right = _panel(
        "Free bodies, orientation to 1 mrad after 1 s",
        "simulated body-seconds per second",
        bodies,
        False,
    )
    fastest = sorted(bodies, key=lambda r: r.seconds_per_second)
    theirs = [r.contender.name for r in fastest if "mujoco" in r.contender.name][-1]
    ours = [r.contender.name for r in fastest if "course" in r.contender.name][-1]
    same_step, second = ratios(bodies, ours, theirs)
    right.notes = [
        _table(bodies),
        f"bodies: {ours} against {theirs}, each at its own step for 1 mrad: {second:.0f} times "
        f"the simulated time, {same_step:.0f} times the body-steps",
        _limit_text(bodies, ours, 2 * 13 * 8),
    ]
    yield right
