"""Many ways to do it: heads, samplers, and how long a chunk is carried out without a look."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from course import learning
from course.charts import chart
from course.learning.recorded import CHUNK, DEMONSTRATIONS, HEADS, SEED
from course.learning.tasks import Act
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine

Array = NDArray[np.float64]


def driven(executor: Act, n: int, noise: float = 0.0) -> NDArray[np.int64]:
    """Return sides of n runs of two ways: +1 left, -1 right, 0 hit or not arrived."""
    # The same starts and disturbances for every executor.
    task, rng = learning.TwoWays(noise), np.random.default_rng(41)
    return task.sides(learning.roll(task, executor, task.starts(n, rng), task.steps, rng).states)


def passed(executor: Act, n: int, noise: float = 0.0) -> float:
    """Return the share of n runs that pass on either side."""
    return float(np.mean(driven(executor, n, noise) != 0))


def shares(
    label: str, x: Sequence[float] | Array, rates: Sequence[float], n: int, **view: Any
) -> Series:
    """Return shares of n runs over x, with Wilson's interval."""
    low, high = wilson(n * np.array(rates), n)
    message = ", ".join(f"{a:g} {rate:.2f}" for a, rate in zip(x, rates, strict=True))
    return Series(label, x, rates, low=low, high=high, note=f"{label}: {message}", **view)


@chart(columns=2)
def many_ways(n: int = 1000, held: int = 500, repeats: int = 25) -> Iterator[Panel]:
    """Chart six ways to copy 100 people who pass left or right: success, error, cost, mode shares.

    Args:
        n: runs.
        held: demonstrations held out.
        repeats: of a timing.
    """
    shown = learning.TwoWays().demonstrate(DEMONSTRATIONS, SEED)
    # Held-out demonstrations from another seed.
    apart = learning.TwoWays().demonstrate(held, SEED + 77)
    policies: dict[str, list[Any]] = {name: [learning.recorded(name)] for name in HEADS}
    policies["autoencoder, z = 0"] = [replace(policies["autoencoder"][0], zero=True)]
    policies["nearest"] = [learning.nearest(*learning.windows(shown, CHUNK))]
    for name in ("flow", "diffusion"):
        policies[name] = [replace(policies[name][0], steps=k) for k in (1, 2, 5, 10)]
    rng = np.random.default_rng(0)
    # Policies are loaded before the clock starts; one state at a time, as on a robot.
    timed = [
        calls(policy, apart.states[:1, 0], rng, clock=time.process_time)
        for kinds in policies.values()
        for policy in kinds
    ]
    spent = iter(interleaved(timed, repeats=repeats))
    error = Panel(
        "Success against held-out error\n(numbers: steps of the sampler)",
        "held-out error of the first chunk, rms [mm]",
        "success rate",
        ylim=(0.0, 1.05),
    )
    priced = Panel(
        "Success against computing time, chunks of 8",
        "processor time per action [µs]",
        "success rate",
        scale="log x",
        ticks=(5, 10, 20, 50),
        ylim=(0.0, 1.05),
        footer=machine(libraries=("torch",)),
    )
    remaining = {"demonstrations": int((shown.states[:, 8, 1] > 0.0).sum()) / DEMONSTRATIONS}
    for name, kinds in policies.items():
        deviation, good, micro = [], [], []
        for policy in kinds:
            guess = policy(apart.states[:, 0], np.random.default_rng(1))
            # The first chunk, where the two ways separate: here the mean has the least error.
            deviation.append(1e3 * float(np.sqrt(np.mean((guess - apart.actions[:, :CHUNK]) ** 2))))
            sides = driven(learning.Commit(policy, CHUNK), n)
            good.append(float(np.mean(sides != 0)))
            # The best round, over the actions of a chunk.
            micro.append(1e6 * next(spent).best / CHUNK)
        low, high = wilson(n * np.array(good), n)
        message = "; ".join(
            f"success {s:.3f}, held-out {e:.1f} mm, {t:.1f} us an action"
            for s, e, t in zip(good, deviation, micro, strict=True)
        )
        steps = " (1, 2, 5, 10 steps)" if len(kinds) > 1 else ""
        view: dict[str, Any] = {"low": low, "high": high, "extra": name.endswith("z = 0")}
        # Along the curves of the samplers the number of steps grows.
        counted = [str(one.steps) for one in kinds] if name == "flow" else ()
        error.series.append(
            Series(name, deviation, good, note=f"{name}{steps}: {message}", tags=counted, **view)
        )
        priced.series.append(Series(name, micro, good, **view))
        # Shares of the sides only for policies that get through.
        if good[-1] > 0.5:
            remaining[name] = float(np.mean(sides[sides != 0] > 0))
    low, high = wilson(100.0 * remaining["demonstrations"], DEMONSTRATIONS)
    yield error
    yield priced
    yield Panel(
        "Which side the runs that succeed take",
        "share that passes left",
        series=[
            Series(
                "",
                list(remaining.values()),
                list(remaining),
                style="bar",
                tags=[f"{x:.2f}" for x in remaining.values()],
                note="left: " + ", ".join(f"{k} {x:.2f}" for k, x in remaining.items()),
            )
        ],
        spans=[("x", float(low), float(high), "95 % interval of the demonstrations")],
        xlim=(0.0, 1.0),
    )


def gap(samples: Array, exact: Array) -> float:
    """Return the rms distance of a sample's quantiles from the exact ones (Wasserstein-2)."""
    return float(np.sqrt(np.mean((np.sort(samples.ravel()) - exact) ** 2)))


def quantiles(mixture: learning.Mixture, share: Array) -> Array:
    """Return quantiles of a one-dimensional mixture between -6 and 6, to about 1e-7."""
    x = np.linspace(-6.0, 6.0, 100_001)
    # Distribution function on a grid, inverted by interpolation.
    deviation = (x[:, None] - mixture.means[:, 0]) / mixture.deviations
    return np.interp(share, ndtr(deviation) @ mixture.weights, x)


@chart(columns=2)
def samplers(
    n: int = 4000,
    runs: int = 1000,
    fit: int = 4000,
    counts: Sequence[int] = (1, 2, 5, 10, 20, 50, 100),
) -> Iterator[Panel]:
    """Chart what steps of a sampler buy: on an exact field, on a trained one, in driving.

    Args:
        n: samples.
        runs: runs of the task with two ways.
        fit: training steps of the two networks.
        counts: evaluations of the field.
    """
    modes = learning.Mixture(np.full(2, 0.5), np.array([[-1.0], [1.0]]), np.full(2, 0.3))
    share = (np.arange(n) + 0.5) / n
    # Stratified noise: its quantiles are exact, so that no sampling error hides the sampler's.
    exact, noise, rng = quantiles(modes, share), ndtri(share)[:, None], np.random.default_rng(3)
    report, blank = modes.draw(4000, rng), rng.standard_normal((4000, 1))
    how: dict[str, Any] = {"width": 64, "rate": 2e-3, "steps": fit}
    flow, diffusion = (
        f(blank, report, 0, **how) for f in (learning.flow_policy, learning.diffusion_policy)
    )

    def drawn(policy: Any, solver: str, steps: int) -> Array:
        """Return samples of a trained net, at the state 0 that tells nothing."""
        field = partial(policy.draw, policy.inputs(np.zeros((n, 1))))
        if solver in ("ddim", "ddpm"):
            return policy.done.undo(
                learning.denoise(field, noise, steps, rng, float(solver == "ddpm"))
            )
        return policy.done.undo(learning.integrate(field, noise, steps, solver))

    panel = Panel(
        "Two modes (solid: exact field; dashed: trained network)",
        "evaluations of the field or network",
        "rms error of the samples' quantiles",
        scale="log",
    )
    methods = {
        "Euler": lambda k: learning.integrate(modes.velocity, noise, k, "euler"),
        "Heun": lambda k: learning.integrate(modes.velocity, noise, k // 2, "heun"),
        "DDIM": lambda k: learning.denoise(modes.clean, noise, k, rng),
        "DDPM": lambda k: learning.denoise(modes.clean, noise, k, rng, 1.0),
        "flow net, Heun": lambda k: drawn(flow, "heun", k // 2),
        "diffusion net, DDIM": lambda k: drawn(diffusion, "ddim", k),
    }
    for label, method in methods.items():
        # Heun takes two evaluations per step: equal evaluations, half the steps.
        x = [k for k in counts if k % 2 == 0 or "Heun" not in label]
        y = [gap(method(k), exact) for k in x]
        # Observed order from the two finest counts.
        order = np.log(y[-2] / y[-1]) / np.log(x[-1] / x[-2])
        note = f"{label}: " + ", ".join(f"{k} {e:.3g}" for k, e in zip(x, y, strict=True))
        panel.series.append(
            Series(
                label,
                x,
                y,
                note=f"{note}; order at the end {order:.2f}",
                style="--" if "net" in label else "-",
            )
        )
    mean = gap(np.full(n, exact.mean()), exact)
    panel.lines = [("y", mean, "one step: the mean")]
    panel.notes.append(f"all at the mean: {mean:.4f}")
    yield panel
    panel = Panel(
        "Two-route task, trained networks",
        "network evaluations per chunk of 8",
        "success rate",
        scale="log x",
        ylim=(0.0, 1.05),
    )
    for kind in ("flow, Euler", "flow, Heun", "diffusion, DDIM", "diffusion, DDPM"):
        name, solver = kind.lower().split(", ")
        each = 2 if solver == "heun" else 1
        x = [k for k in counts if k <= 50 and k % each == 0]
        net: Any = learning.recorded(name)
        nets = [replace(net, solver=solver, steps=k // each) for k in x]
        rates = [passed(learning.Commit(one, CHUNK), runs) for one in nets]
        panel.series.append(shares(kind, x, rates, runs))
    yield panel


def switches_and_mismatch(policy: Any, executed: int, n: int, noise: float) -> tuple[float, float]:
    """Return how often a run changes sides before the obstacle, and its distance off plan [m]."""
    task, rng, step = learning.TwoWays(noise), np.random.default_rng(41), 0
    state, sides, deviation = task.starts(n, rng), [], []
    while step < task.steps // 2:
        plan = policy(state, rng)
        # The side that the rest of the plan leads to, half way.
        halfway = state + plan[:, : task.steps // 2 - step].sum(axis=1)
        sides.append(np.sign(halfway[:, 1]))
        # Where the executed part would end without disturbance.
        intended = state + plan[:, :executed].sum(axis=1)
        for k in range(executed):
            state = task.step(state, plan[:, k], rng)
        deviation.append(np.sum((state - intended) ** 2, axis=1) / 2.0)
        step += executed
    turned = float(np.mean(np.sum(np.diff(sides, axis=0) != 0.0, axis=0))) if sides[1:] else 0.0
    return turned, float(np.sqrt(np.mean(deviation)))


@chart(columns=2)
def commit_or_react(
    n: int = 1000,
    executed: Sequence[int] = (1, 2, 4, 8),
    fit: int = 2000,
    noises: Sequence[float] = (0.0, 0.01, 0.02, 0.03, 0.05),
) -> Iterator[Panel]:
    """Chart success over steps carried out without a look, and over noise; both ends explained.

    Args:
        n: runs.
        executed: how many actions of a chunk are executed.
        fit: training steps of the mixture that is fitted to disturbed demonstrations.
        noises: standard deviations of the disturbance in a step [m].
    """
    policy = learning.recorded("mixture")
    panel = Panel(
        "Success of the mixture, chunks of 8 steps",
        "executed steps of each chunk",
        "success rate",
        ticks=executed,
        scale="log x",
        ylim=(0.0, 1.05),
    )
    for noise in (0.0, 0.02, 0.05):
        rates = [passed(learning.Commit(policy, k), n, noise) for k in executed]
        panel.series.append(shares(f"disturbed by {1e3 * noise:g} mm a step", executed, rates, n))
    yield panel
    shown = learning.TwoWays().demonstrate(DEMONSTRATIONS, SEED, injected=0.05)
    # The same head, trained on demonstrations that were disturbed (DART).
    taught = HEADS["mixture"](*learning.windows(shown, CHUNK), SEED, steps=fit)
    panel = Panel(
        "Mixture: success of each remedy",
        "disturbance in a step, std. dev. [mm]",
        "success rate",
        ylim=(0.0, 1.05),
    )
    cures: dict[str, Any] = {f"{k} executed": learning.Commit(policy, k) for k in (1, 2, 8)}
    cures |= {
        "temporal ensembling": learning.Ensemble(policy),
        "delayed by 1": learning.Delayed(policy, 1),
        "trained on disturbed data": learning.Commit(taught, 1),
    }
    for label, method in cures.items():
        rates = [passed(method, n, noise) for noise in noises]
        panel.series.append(
            shares(label, 1e3 * np.array(noises), rates, n, extra="delayed" in label)
        )
    yield panel
    noise = 0.05
    result = [switches_and_mismatch(policy, k, n, noise) for k in executed]
    yield Panel(
        "Executing few: changes of side (50 mm)",
        "executed steps of each chunk",
        "changes of side per run",
        scale="log x",
        ticks=executed,
        series=[
            Series(
                "",
                executed,
                [t for t, _ in result],
                note="changes of side: " + ", ".join(f"{t:.2f}" for t, _ in result),
            )
        ],
    )
    yield Panel(
        "Executing many: drift (50 mm)",
        "executed steps of each chunk",
        "deviation from the plan, rms [mm]",
        scale="log x",
        ticks=executed,
        series=[
            Series(
                "simulated",
                executed,
                [1e3 * d for _, d in result],
                style="",
                theory=lambda k: 1e3 * noise * np.sqrt(k),
                note="off the plan: " + ", ".join(f"{1e3 * d:.0f} mm" for _, d in result),
            )
        ],
        theory="50 mm times √k",
    )
