"""Chapter 1: how many bodies a core can step, beside `mujoco.batch`, at the same accuracy."""

import itertools
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from course.charts import chart, save
from course.check import refused
from course.measure.work_precision import PALETTE, machine
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import free as mujoco_free
from course.rigid_body import planar, problems, quaternion
from course.rigid_body.integrators import Array
from course.rigid_body.problems import STANDARD_GRAVITY
from course.rigid_body.spatial import advance_bodies

SIZES = (1, 10, 100, 1000, 10_000, 100_000)
# A whole run of so many boxes would take MuJoCo minutes: from here on a run is a few steps of boxes
# that are caught at all moments of their runs.
MIXED_FROM = 100_000


@dataclass(frozen=True)
class Contender:
    """One way of stepping N bodies with one step size.

    Attributes:
        name: as in the legend.
        dt: step [s], the largest tried that meets the tolerance.
        error: its largest error at that step.
        prepare: N -> function that takes so many steps of all N bodies.
    """

    name: str
    dt: float
    error: float
    prepare: Callable[[int], Callable[[int], Any]]


@dataclass(frozen=True)
class Rate:
    """Median and quartiles of body-steps per second, and of simulated seconds per second."""

    name: str
    n: int
    dt: float
    error: float
    steps_per_second: float
    low: float
    high: float
    seconds_per_second: float


BOX = (0.3, 0.2)
BOX_TOLERANCE = 5e-3  # m, a fortieth of the box's height: which way it falls is right, a grasp is
BODY_TOLERANCE = 1e-3  # rad
INERTIA = (1.0, 2.0, 2.5)
OURS = "rk4_renormalised"
DURATION = 1.0  # s
_STEPS = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001, 5e-4, 2e-4, 1e-4, 5e-5)


def box_states(n: int, seed: int = 7) -> Array:
    """Boxes thrown at random above the ground, shape (6, n)."""
    rng = np.random.default_rng(seed)
    state = np.empty((6, n))
    state[0] = rng.uniform(-5.0, 5.0, n)
    state[1] = rng.uniform(0.6, 1.4, n)
    state[2] = rng.uniform(0.0, 2.0 * np.pi, n)
    state[3:5] = rng.normal(0.0, 0.5, (2, n))
    state[5] = rng.normal(0.0, 1.5, n)
    return state


def mixed_states(n: int, groups: int = 20) -> Array:
    """The boxes of `box_states` at moments spread evenly over their run, shape (6, n)."""
    state = box_states(n)
    rough = planar.box_parameters(1.0, *BOX, restitution=0.5, friction=0.5)
    for i in range(groups):
        part = slice(i, n, groups)
        steps = round((i + 0.5) / groups * DURATION / 1e-3)
        state[:, part], _ = planar.rollout(state[:, part], rough, 1e-3, steps, integrator="rk4")
    return state


def body_states(n: int, seed: int = 7) -> tuple[Array, Array]:
    """Free bodies thrown at random, shapes (7, n) and (6, n)."""
    rng = np.random.default_rng(seed)
    q = np.concatenate([rng.uniform(-5, 5, (3, n)), quaternion.exp(rng.normal(0, 1, (3, n)))])
    return q, rng.normal(0.0, 1.0, (6, n))


def _coarsest(errors: Callable[[float], float], tolerance: float) -> tuple[float, float]:
    """The largest step of the list that meets the tolerance, as does the next finer one."""
    found = errors(_STEPS[0])
    for dt, finer in itertools.pairwise(_STEPS):
        error, found = found, errors(finer)
        if error <= tolerance and found <= tolerance:
            return dt, error
    raise refused("tolerance", tolerance, f"one that a step down to {_STEPS[-1]} s meets")


def box_contenders(samples: int = 24) -> list[Contender]:
    """Planar boxes on the ground: ours and MuJoCo's, each at the step the tolerance allows.

    The accuracy is judged on frictionless boxes up to half a second, through their first
    impacts, against `problems.frictionless_box`; later bounces multiply any error by ten and
    more, in either engine. The rate is measured with friction on the same kind of boxes until
    they lie still, so all phases count: flight, impact, slide and rest.
    """
    horizon, restitution = 0.5, 0.5
    start = box_states(samples)
    truth = np.array(
        [problems.frictionless_box(horizon, s, *BOX, restitution)[:2] for s in start.T]
    ).T
    smooth = planar.box_parameters(1.0, *BOX, restitution=restitution, friction=0.0)
    rough = planar.box_parameters(1.0, *BOX, restitution=restitution, friction=0.5)
    half = (0.5 * BOX[0], 0.5 * BOX[1])

    def ours_error(dt: float) -> float:
        if dt > horizon:
            return np.inf
        steps = round(horizon / dt)
        end, _ = planar.rollout(start, smooth, horizon / steps, steps, integrator="rk4")
        return float(np.median(np.max(np.abs(end[:2] - truth), axis=0)))

    def mujoco_error(dt: float) -> float:
        if dt > 0.05:
            return np.inf
        steps = round(horizon / dt)
        runner = mujoco_box.batch_boxes(
            half, 1.0, start[:3], start[3:], horizon / steps, "Euler",
            restitution=restitution, friction=0.0, gravity=STANDARD_GRAVITY,
        )  # fmt: skip
        q, _ = runner.run(steps)
        return float(np.median(np.max(np.abs(q[:2] - truth), axis=0)))

    def ours(dt: float) -> Callable[[int], Callable[[int], Any]]:
        def prepare(n: int) -> Callable[[int], Any]:
            states = box_states(n) if n < MIXED_FROM else mixed_states(n)
            return lambda steps: planar.rollout(states, rough, dt, steps, integrator="rk4")

        return prepare

    def mujocos(dt: float) -> Callable[[int], Callable[[int], Any]]:
        def prepare(n: int) -> Callable[[int], Any]:
            states = box_states(n) if n < MIXED_FROM else mixed_states(n)
            runner = mujoco_box.batch_boxes(
                half, 1.0, states[:3], states[3:], dt, "Euler",
                restitution=restitution, friction=0.5, gravity=STANDARD_GRAVITY,
            )  # fmt: skip

            def run(steps: int) -> None:
                runner.reset()
                runner.step(steps)

            return run

        return prepare

    dt_mujoco, error_mujoco = _coarsest(mujoco_error, BOX_TOLERANCE)
    dt_ours, error_ours = _coarsest(ours_error, BOX_TOLERANCE)
    return [
        Contender("course", dt_mujoco, ours_error(dt_mujoco), ours(dt_mujoco)),
        Contender("mujoco.batch", dt_mujoco, error_mujoco, mujocos(dt_mujoco)),
        Contender("course, its own step", dt_ours, error_ours, ours(dt_ours)),
    ]


def body_contenders(samples: int = 24) -> list[Contender]:
    """Free bodies, each at the coarsest step that keeps the attitude to 1 mrad for 1 s."""
    q0, v0 = body_states(samples)
    fine, _ = advance_bodies(q0, v0, INERTIA, 5e-4, 2000)
    gravity = (0.0, 0.0, -STANDARD_GRAVITY)

    def attitude(q: Array) -> float:
        return float(np.max(quaternion.angle_between(quaternion.normalise(q[3:]), fine[3:])))

    def ours_error(name: str) -> Callable[[float], float]:
        def error(dt: float) -> float:
            steps = round(DURATION / dt)
            q, _ = advance_bodies(q0, v0, INERTIA, DURATION / steps, steps, gravity, name)
            return attitude(q)

        return error

    def mujoco_error(name: str) -> Callable[[float], float]:
        def error(dt: float) -> float:
            steps = round(DURATION / dt)
            q, _ = mujoco_free.batch_free_bodies(
                INERTIA, q0, v0, DURATION / steps, name, gravity=STANDARD_GRAVITY
            ).run(steps)
            return attitude(q)

        return error

    def ours(name: str, dt: float) -> Callable[[int], Callable[[int], Any]]:
        def prepare(n: int) -> Callable[[int], Any]:
            q, v = body_states(n)
            return lambda steps: advance_bodies(q, v, INERTIA, dt, steps, gravity, name)

        return prepare

    def mujocos(name: str, dt: float) -> Callable[[int], Callable[[int], Any]]:
        def prepare(n: int) -> Callable[[int], Any]:
            q, v = body_states(n)
            runner = mujoco_free.batch_free_bodies(
                INERTIA, q, v, dt, name, gravity=STANDARD_GRAVITY
            )

            def run(steps: int) -> None:
                runner.reset()
                runner.step(steps)

            return run

        return prepare

    dt, error = _coarsest(ours_error(OURS), BODY_TOLERANCE)
    found = [Contender(f"course {OURS}", dt, error, ours(OURS, dt))]
    for name in ("RK4", "Euler", "implicitfast"):
        dt, error = _coarsest(mujoco_error(name), BODY_TOLERANCE)
        found.append(Contender(f"mujoco.batch {name}", dt, error, mujocos(name, dt)))
    return found


def measure_rates(
    contenders: list[Contender],
    sizes: tuple[int, ...] = SIZES,
    repeats: int = 5,
    sample: float = 0.05,
    horizon: float | None = None,
) -> list[Rate]:
    """Body-steps per second of every contender at every size, interleaved in one process.

    Args:
        contenders: what to run; one thread each.
        sizes: numbers of bodies.
        repeats: rounds; each runs every contender once.
        sample: least time of one sample [s].
        horizon: simulated time of a run [s], which sets the mix of flight and contact; default,
            and for batches from MIXED_FROM on: as many steps as a sample takes.
    """
    rates = []
    for n in sizes:
        whole = horizon if n < MIXED_FROM else None
        jobs = []
        for contender in contenders:
            run = contender.prepare(n)
            steps = 1 if whole is None else max(1, round(whole / contender.dt))
            run(steps)
            loops = 1
            while True:
                start = time.perf_counter()
                for _ in range(loops):
                    run(steps)
                took = time.perf_counter() - start
                if took >= sample:
                    break
                if whole is None:
                    steps *= 2
                else:
                    loops *= 2
            jobs.append((contender, run, steps, loops))
        times: list[list[float]] = [[] for _ in jobs]
        for _ in range(repeats):
            for samples, (_, run, steps, loops) in zip(times, jobs, strict=True):
                start = time.perf_counter()
                for _ in range(loops):
                    run(steps)
                samples.append((time.perf_counter() - start) / (n * steps * loops))
        for samples, (contender, *_) in zip(times, jobs, strict=True):
            low, median, high = np.quantile(samples, [0.25, 0.5, 0.75])
            rates.append(
                Rate(contender.name, n, contender.dt, contender.error, 1.0 / median, 1.0 / high,
                     1.0 / low, contender.dt / median)
            )  # fmt: skip
    return rates


def memory_bandwidth(megabytes: int = 256) -> float:
    """Bytes per second that a plain copy moves, read and written, best of five."""
    source = np.ones(megabytes * 131_072)
    target = np.empty_like(source)
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        np.copyto(target, source)
        best = min(best, time.perf_counter() - start)
    return 2.0 * source.nbytes / best


def ratios(rates: list[Rate], ours: str, theirs: str) -> tuple[float, float]:
    """Best rate of ours over the best of theirs: (body-steps, simulated seconds) per second."""
    mine = [r for r in rates if r.name == ours]
    other = [r for r in rates if r.name == theirs]
    return (
        max(r.steps_per_second for r in mine) / max(r.steps_per_second for r in other),
        max(r.seconds_per_second for r in mine) / max(r.seconds_per_second for r in other),
    )


def _limit_text(rates: list[Rate], name: str, bytes_per_body: int) -> str:
    """What limits a rate: bytes it must move if a body's state passes once per step."""
    bandwidth = memory_bandwidth()
    best = max(r.steps_per_second for r in rates if r.name == name)
    share = best * bytes_per_body / bandwidth
    kind = "arithmetic and latency, not by memory" if share < 0.5 else "memory bandwidth"
    return (
        f"{name}: {best:.3g} body-steps/s; with the state read and written at every step that is "
        f"{best * bytes_per_body / 1e9:.2f} GB/s of the {bandwidth / 1e9:.1f} GB/s a copy reaches "
        f"({100 * share:.0f} %): limited by {kind}"
    )


def _at_rest(samples: int = 1000) -> float:
    """Share of the boxes of a run that lie still at its end, where the kernel skips them."""
    rough = planar.box_parameters(1.0, *BOX, restitution=0.5, friction=0.5)
    end, _ = planar.rollout(box_states(samples), rough, 1e-3, round(DURATION / 1e-3))
    return float(np.mean(np.all(end[3:] == 0.0, axis=0)))


def _table(rates: list[Rate]) -> str:
    lines = [f"{'who':<30} {'N':>7} {'dt':>8} {'error':>9} {'body-steps/s':>13} {'sim s / s':>10}"]
    lines += [
        f"{r.name:<30} {r.n:>7} {r.dt:>8.4g} {r.error:>9.1e} {r.steps_per_second:>13.3g}"
        f" {r.seconds_per_second:>10.3g}"
        for r in rates
    ]
    return "\n".join(lines)


def _draw(panels: list[tuple[str, list[Rate], bool]]) -> Any:
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(panels), figsize=(12, 4.6), layout="constrained")
    for ax, (title, rates, per_step) in zip(axes, panels, strict=True):
        for i, name in enumerate(dict.fromkeys(r.name for r in rates)):
            rows = [r for r in rates if r.name == name]
            scale = [1.0 if per_step else r.dt for r in rows]
            n = [r.n for r in rows]
            middle = [r.steps_per_second * s for r, s in zip(rows, scale, strict=True)]
            ax.fill_between(
                n,
                [r.low * s for r, s in zip(rows, scale, strict=True)],
                [r.high * s for r, s in zip(rows, scale, strict=True)],
                color=PALETTE[i],
                alpha=0.2,
                linewidth=0,
            )
            ax.plot(
                n, middle, "--" if "mujoco" in name else "-", marker="o", markersize=4,
                color=PALETTE[i], label=f"{name}, dt = {rows[0].dt * 1e3:g} ms",
            )  # fmt: skip
        ax.set(xscale="log", yscale="log", title=title, xlabel="number of bodies N")
        ax.set_ylabel("body-steps per second" if per_step else "simulated body-seconds per second")
        ax.grid(True, which="major", alpha=0.3)
        ax.legend(fontsize="small", loc="center right", bbox_to_anchor=(1.0, 0.36))
    figure.supxlabel(machine() + "; one core", fontsize="x-small", color="0.4")
    return figure


@chart
def throughput() -> str:
    """Batches of planar boxes and free bodies beside mujoco.batch."""
    boxes = measure_rates(box_contenders(), horizon=DURATION)
    bodies = measure_rates(body_contenders())
    figure = _draw(
        [
            (
                "Planar boxes on the ground, same step",
                [r for r in boxes if "own" not in r.name],
                True,
            ),
            ("Free bodies, attitude to 1 mrad after 1 s", bodies, False),
        ]
    )
    data = {
        "boxes": [asdict(r) for r in boxes],
        "bodies": [asdict(r) for r in bodies],
        "machine": machine(),
    }
    save("throughput", figure, data)
    step, _ = ratios(boxes, "course", "mujoco.batch")
    _, own = ratios(boxes, "course, its own step", "mujoco.batch")
    theirs = max((r for r in bodies if "mujoco" in r.name), key=lambda r: r.seconds_per_second).name
    ours = max((r for r in bodies if "course" in r.name), key=lambda r: r.seconds_per_second).name
    same_step, same = ratios(bodies, ours, theirs)
    return "\n".join(
        [
            _table(boxes),
            f"boxes: {step:.0f} times the body-steps of mujoco.batch at its own step; "
            f"{own:.0f} times the simulated time at each one's own step "
            f"({100 * _at_rest():.0f} % of the boxes lie still at the end of a run)",
            _limit_text(boxes, "course", 2 * 6 * 8),
            _table(bodies),
            f"bodies: {ours} against {theirs}, each at its own step for 1 mrad: {same:.0f} times "
            f"the simulated time, {same_step:.0f} times the body-steps",
            _limit_text(bodies, ours, 2 * 13 * 8),
        ]
    )
