"""Plans: where limits make them worth their time, how many tries they need, and what those cost."""

import functools
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.charts.control.tracking import ARM, DOWN
from course.control import box_qp, horizon, lqr, mpc, mppi, rollouts
from course.control.sampling import shifted
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.measure.timing import calls, interleaved, pairwise_ratios
from course.oracles.mujoco import chain as mujoco

Array = NDArray[np.float64]

# --- a mass of 1 kg on a line, whose motor is weak ------------------------------------------------

STEP, WEAK = 0.05, 0.3  # s, N
A, B = np.array([[1.0, STEP], [0.0, 1.0]]), np.array([[0.5 * STEP**2], [STEP]])
Q, R = np.diag([10.0, 1.0]), np.array([[0.01]])
K = lqr(A, B, Q, R).K


def cost(x: Array, samples: int = 0, limit: float = WEAK, at_most: int = 1500) -> tuple[float, int]:
    """Return what it costs to come to rest at 0, and on how many sides the limit was met.

    Args:
        x: place and speed at the start [m, m/s].
        samples: of the horizon of MPC; 0 for the clipped regulator.
        limit: of the force [N].
        at_most: samples of the run.
    """
    plan, last, total, sides = horizon(A, B, Q, R, samples) if samples else None, None, 0.0, set()
    for _ in range(at_most):
        if plan is None:
            u = -K @ x
            # Limits met on both sides: then clipping is no longer optimal, and a plan pays.
            sides |= {float(np.sign(u[0]))} if abs(u[0]) > limit else set()
            u = np.clip(u, -limit, limit)
        else:
            last = mpc(plan, x, limit, last)
            u = last[0]
        total += float(x @ Q @ x + u @ R @ u)
        x = A @ x + B @ u
        # Until nothing is left that could cost anything.
        if np.abs(x).max() < 1e-9:
            break
    return total, len(sides)


@chart
def mpc_where(
    points: int = 13,
    samples: Sequence[int] = (10, 20, 40),
    repeats: int = 5,
    clock: Callable[[], float] = time.process_time,
) -> Iterator[Panel]:
    """Chart MPC beside the clipped regulator: what it saves over the distance, and its time.

    Args:
        points: distances.
        samples: horizons.
        repeats: of the timing.
        clock: of the timing.
    """
    far = np.geomspace(0.01, 10.0, points)
    clipped = [cost(np.array([x, 0.0])) for x in far]
    panel = Panel(
        "From rest, MPC saves where both limits are met",
        "distance [m]",
        "cost of the clipped regulator over MPC's",
        scale="log x",
    )
    first = far[[sides for _, sides in clipped].index(2)]
    panel.lines = [("x", float(first), "both limits met")]
    for n in samples:
        ratio = [c / cost(np.array([x, 0.0]), n)[0] for x, (c, _) in zip(far, clipped, strict=True)]
        # Where at most one limit binds, both laws must cost the same: the control.
        near = max(abs(r - 1) for r, (_, sides) in zip(ratio, clipped, strict=True) if sides < 2)
        panel.series.append(
            Series(
                f"{n * STEP:g} s ahead",
                far,
                ratio,
                note=f"{n} samples ahead: up to {max(ratio):.2f} times cheaper; the same to "
                f"{near:.0e} where the limit binds on one side at most",
            )
        )
    yield panel

    x = np.array([2.0, 0.0])
    runs: dict[str, Callable[[], Array]] = {"saturated LQR": lambda: np.clip(-K @ x, -WEAK, WEAK)}
    for n in samples:
        plan = horizon(A, B, Q, R, n)
        # The warm start is computed before the clock starts.
        last = mpc(plan, x, WEAK)
        runs[f"cold {n}"] = functools.partial(mpc, plan, x, WEAK)
        runs[f"warm {n}"] = functools.partial(mpc, plan, x, WEAK, last)
    # All horizons, cold and warm, and the regulator in turn.
    timed = interleaved([calls(run, clock=clock) for run in runs.values()], repeats=repeats)
    spent = {name: 1e6 * result.median for name, result in zip(runs, timed, strict=True)}
    panel = Panel(
        "Computing time per command",
        "horizon [samples]",
        "time of a command [us]",
        scale="log",
        ticks=samples,
    )
    for name in ("cold", "warm"):
        y = [spent[f"{name} {n}"] for n in samples]
        panel.series.append(
            Series(
                f"MPC, {name} start",
                samples,
                y,
                note=f"MPC, {name} start: {y[0]:.0f} us at {samples[0]} samples, {y[-1]:.0f} at "
                f"{samples[-1]}; the clipped regulator {spent['saturated LQR']:.1f} us",
            )
        )
    panel.lines = [("y", spent["saturated LQR"], "clipped regulator")]
    yield panel


# --- a pendulum with a third of the torque that holds it up sideways ------------------------------


def swings_up(samples: int, ahead: int, seed: int, plans: int = 70, dt: float = 0.1) -> bool:
    """Return whether MPPI brings a pendulum of 1 kg at 1 m upright and holds it there.

    Args:
        samples: tries a plan.
        ahead: samples of the horizon.
        seed: of the tries.
        plans: after which it is judged.
        dt: sample time, two steps of semi-implicit Euler [s].
    """
    limit, rng = 9.81 / 3.0, np.random.default_rng(seed)

    def move(q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        for _ in range(2):
            v = v + 0.5 * dt * (9.81 * np.sin(q) + u)
            q = q + 0.5 * dt * v
        return q, v

    plan, q, v = np.zeros((ahead, 1)), np.array([np.pi]), np.zeros(1)
    for _ in range(plans):

        def judged(tries: Array, q: Array = q, v: Array = v) -> Array:
            # All tries side by side, by the same two half steps as the plant.
            total = np.zeros(len(tries))
            for u in tries[:, :, 0].T:
                q, v = move(q, v, u)
                total += 1.0 - np.cos(q) + 0.02 * v**2
            return total

        plan = mppi(
            judged, plan, rng, samples=samples, spread=limit, temperature=0.5, limit=limit
        ).plan
        q, v = move(q, v, plan[0])
        # Warm start: the plan moved on by a sample.
        plan = shifted(plan)
    return bool(abs(np.sin(q[0])) < 0.3 and np.cos(q[0]) > 0.0 and abs(v[0]) < 1.0)


@chart
def swing_up(
    samples: Sequence[int] = (2, 4, 8, 16, 32, 64, 256),
    ahead: Sequence[int] = (3, 5, 8, 12, 16, 20, 30),
    seeds: int = 20,
) -> Iterator[Panel]:
    """Chart how often MPPI swings a weak pendulum up: over its tries, and over how far it looks.

    Args:
        samples: numbers of sampled plans, of the first panel.
        ahead: lengths of the horizon, of the second panel.
        seeds: runs of a point.
    """
    for title, words, values, fixed in (
        ("More rollouts", "rollouts per plan", samples, {"ahead": 20}),
        ("Longer horizon", "horizon [samples]", ahead, {"samples": 64}),
    ):
        name = "ahead" if "samples" in fixed else "samples"
        won = [
            sum(swings_up(**{name: n, **fixed, "seed": s}) for s in range(seeds)) for n in values
        ]
        low, high = wilson(won, seeds)
        share = np.array(won) / seeds
        with_what = ", ".join(f"{n} {k}" for k, n in fixed.items()).replace("samples", "rollouts")
        row = ", ".join(f"{n}: {s:.0%}" for n, s in zip(values, share, strict=True))
        yield Panel(
            f"{title} ({with_what})",
            words,
            "share of runs upright",
            scale="log x",
            ticks=values,
            series=[
                Series(
                    "",
                    values,
                    share,
                    "MPPI",
                    low=low,
                    high=high,
                    note=f"upright by {words}, {with_what}: {row}",
                )
            ],
        )


@chart
def control_speed(
    plans: Sequence[int] = (16, 64, 256, 1024),
    samples: int = 50,
    sizes: Sequence[int] = (2, 4, 8),
    systems: int = 1000,
    repeats: int = 15,
    clock: Callable[[], float] = time.process_time,
) -> Iterator[Panel]:
    """Chart rollouts beside `mujoco.batch` and `mujoco.rollout`, regulators and boxes beside SciPy.

    All on one core.

    Args:
        plans: at a time.
        samples: of each.
        sizes: states of a system, and unknowns of a box.
        systems: drawn in all for the residuals.
        repeats: of the timing.
        clock: of the timing.
    """
    dt, start = 0.01, (np.array([0.3, 0.5]), np.array([0.1, -0.2]))
    rivals = {"mujoco.batch": mujoco.rollouts, "mujoco.rollout": mujoco.thread_pool_rollouts}
    rates: dict[str, list[float]] = {name: [] for name in ("course", *rivals)}
    deviation, notes = 0.0, []
    for n in plans:
        torques = np.random.default_rng(n).normal(size=(n, samples, 2))
        # Models and plans of the rivals are prepared outside the timed functions.
        theirs = [rival(ARM.chain(), torques, dt, start, DOWN) for rival in rivals.values()]

        def ours(torques: Array = torques) -> Array:
            return rollouts(ARM, torques, dt, start)[0][-1].T

        here = ours()
        # Equal answers first: the same integrator, step and torques.
        deviation = max(deviation, *(float(np.abs(here - run()).max()) for run in theirs))
        samplers = [calls(run, clock=clock) for run in (ours, *theirs)]
        timed = interleaved(samplers, repeats=repeats)
        for name, result in zip(rates, timed, strict=True):
            rates[name].append(n * samples / result.median)
        ratios = pairwise_ratios(samplers, pairs=repeats)
        notes.append(
            f"{n:5d} plans at a time, one core, over the course's time: "
            + ", ".join(f"{name} {r}" for name, r in zip(rivals, ratios, strict=True))
        )
    panel = Panel(
        "Rollouts of two links", "plans at a time", "samples per second", scale="log", ticks=plans
    )
    panel.series = [Series(name, plans, y, name) for name, y in rates.items()]
    panel.notes = [*notes, f"largest difference {deviation:.0e} rad"]
    yield panel
    yield _beside_scipy(sizes, systems, repeats, clock)


def residual(system: Sequence[Array], P: Array) -> float:
    """Return what is left of the Riccati equation, over the largest entry of P."""
    A, B, Q, R = system
    # Discrete algebraic Riccati equation, put back into itself.
    gain = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    return float(np.abs(Q + A.T @ P @ (A - B @ gain) - P).max() / np.abs(P).max())


def drawn(rng: np.random.Generator, n: int) -> tuple[Array, ...]:
    """Return a system of n states and n // 2 inputs, stable or not, and its weights."""
    m, A, W = n // 2, rng.normal(size=(n, n)), rng.normal(size=(n, n))
    # Spectral radius between 0.5 and 1.5: stable and unstable plants.
    A *= rng.uniform(0.5, 1.5) / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.normal(size=(n, m)), W @ W.T, np.eye(m)


def _beside_scipy(
    sizes: Sequence[int], systems: int, repeats: int, clock: Callable[[], float]
) -> Panel:
    from scipy.linalg import solve_discrete_are
    from scipy.optimize import lsq_linear

    rng, panel = (
        np.random.default_rng(0),
        Panel("One answer", "size", "time [us]", scale="log", ticks=sizes),
    )
    names = ("regulator", "SciPy's Riccati", "box", "SciPy's BVLS")
    spent: dict[str, list[float]] = {name: [] for name in names}
    ratios: dict[str, list[str]] = {names[1]: [], names[3]: []}
    worst, difference = np.zeros(2), 0.0
    for n in sizes:
        for _ in range(systems // len(sizes)):
            system = drawn(rng, n)
            both = lqr(*system).P, solve_discrete_are(*system)
            worst = np.maximum(worst, [residual(system, P) for P in both])
        # A least-squares problem, so that BVLS and the box QP have the same minimum.
        M, b = rng.normal(size=(n + 5, n)), 3.0 * rng.normal(size=n + 5)
        H, g = M.T @ M, -M.T @ b
        runs = (
            functools.partial(lqr, *system),
            functools.partial(solve_discrete_are, *system),
            functools.partial(box_qp, H, g, -0.3, 0.3),
            functools.partial(lsq_linear, M, b, (-0.3, 0.3), method="bvls", tol=1e-15),
        )
        difference = max(difference, float(np.abs(runs[2]().x - runs[3]().x).max()))
        samplers = [calls(run, clock=clock) for run in runs]
        for name, result in zip(names, interleaved(samplers, repeats=repeats), strict=True):
            spent[name].append(1e6 * result.median)
        for k in (0, 2):
            # Ratios of neighbouring samples, not of two medians.
            (ratio,) = pairwise_ratios(samplers[k : k + 2], pairs=repeats)
            ratios[names[k + 1]].append(f"size {n}: {ratio}")
    panel.series = [Series(name, sizes, y) for name, y in spent.items()]
    panel.notes = [
        f"{name} over the course's time, {', '.join(rows)}" for name, rows in ratios.items()
    ]
    panel.notes += [
        f"largest residual of {systems} Riccati equations {worst[0]:.0e}, SciPy's {worst[1]:.0e}",
        f"boxes: largest difference {difference:.0e}",
    ]
    return panel
