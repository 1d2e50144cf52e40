"""Vectorised environments: steps per second against N, their error, when processes pay."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.charts import chart, save
from course.measure.work_precision import PALETTE, machine
from course.oracles.gymnasium import async_vector_env, sync_vector_env
from course.oracles.mujoco.reach import MujocoArmReach, MujocoArmReachVector
from course.vector_env import ArmReach, ArmReachVector, ProcessVectorEnv, VectorizedEnv
from course.vector_env.busy import Busy
from course.vector_env.reach import RADIUS

SIZES = (1, 4, 16, 64, 256, 1024, 4096)
COMPARED_AT = 256
TOLERANCE = 0.1 * RADIUS  # m: a tenth of the target's radius
WORKERS = 2
CROSSING_ENVS = 8


@dataclass(frozen=True)
class Contender:
    """One way of stepping N arms.

    Attributes:
        name: as in the legend.
        make: N -> vector environment.
        most: the largest N it is asked for.
        style: line style.
    """

    name: str
    make: Callable[[int], Any]
    most: int = SIZES[-1]
    style: str = "-"


@dataclass(frozen=True)
class Rate:
    """Median, quartiles and best sample of environment steps per second."""

    name: str
    n: int
    steps_per_second: float
    low: float
    high: float
    best: float


def _workers(n: int) -> ProcessVectorEnv:
    return ProcessVectorEnv(MujocoArmReach, n, num_workers=min(n, WORKERS))


SYNC, ASYNC = "Gymnasium SyncVectorEnv, MuJoCo", "Gymnasium AsyncVectorEnv, MuJoCo"
CLOSED, BATCH = "ArmReachVector, closed form", "MujocoArmReachVector, mujoco.batch"
SYNC_CLOSED = "Gymnasium SyncVectorEnv, closed form"
CONTENDERS = (
    Contender(CLOSED, ArmReachVector),
    Contender(BATCH, MujocoArmReachVector),
    Contender(f"ProcessVectorEnv, MuJoCo, {WORKERS} workers", _workers),
    Contender("VectorizedEnv, MuJoCo", lambda n: VectorizedEnv(MujocoArmReach, n)),
    Contender(SYNC, lambda n: sync_vector_env(MujocoArmReach, n), style="--"),
    # A process each: beyond 256 most machines run out of patience before memory.
    Contender(ASYNC, lambda n: async_vector_env(MujocoArmReach, n), 256, "--"),
    Contender(SYNC_CLOSED, lambda n: sync_vector_env(ArmReach, n), style=":"),
)


def measure_rates(
    contenders: Sequence[Contender] = CONTENDERS,
    sizes: Sequence[int] = SIZES,
    repeats: int = 25,
    sample: float = 0.01,
) -> list[Rate]:
    """Environment steps per second, all contenders interleaved, with the same actions.

    Args:
        contenders: what to run.
        sizes: numbers of environments.
        repeats: rounds; each takes one sample of every contender.
        sample: least time of one sample [s]. The samples of the slow ones are shorter than an
            episode of 100 steps and hold few resets, which is in their favour.
    """
    rates = []
    for n in sizes:
        actions = np.random.default_rng(0).uniform(-1, 1, (n, 2)).astype(np.float32)
        jobs: list[tuple[str, Any, int, list[float]]] = []
        for contender in contenders:
            if n > contender.most:
                continue
            envs = contender.make(n)
            envs.reset(seed=0)
            begin = time.perf_counter()
            steps = 0
            while steps < 3 or (took := time.perf_counter() - begin) < sample:
                envs.step(actions)
                steps += 1
                took = time.perf_counter() - begin
            jobs.append((contender.name, envs, max(1, round(steps * sample / took)), []))
        for _ in range(repeats):
            for _, envs, steps, samples in jobs:
                begin = time.perf_counter()
                for _ in range(steps):
                    envs.step(actions)
                samples.append(n * steps / (time.perf_counter() - begin))
        for name, envs, _, samples in jobs:
            low, median, high = (float(x) for x in np.quantile(samples, [0.25, 0.5, 0.75]))
            rates.append(Rate(name, n, median, low, high, max(samples)))
            envs.close()
    return rates


def ratio(rates: Sequence[Rate], name: str, others: Sequence[str], n: int = COMPARED_AT) -> float:
    """Best sample of one at N = n over the best sample of some others.

    Other work on the machine slows long samples down more than short ones, so the medians of slow
    contenders suffer more; the best of each is nearest to what it does alone.
    """
    at = {rate.name: rate for rate in rates if rate.n == n}
    return at[name].best / max(at[other].best for other in others if other in at)


# --- accuracy beside speed ------------------------------------------------------------------------


def tip_error(make: Callable[[int], Any], samples: int = 32, steps: int = 99) -> float:
    """Largest distance [m] of the tip from the truth, over an episode of many arms.

    Truth: the closed form with 64 Runge-Kutta steps in a control step, whose own error, judged by
    32, is below 1e-11 m. The actions change every tenth of an episode, at random.
    """
    envs, fine = make(samples), ArmReachVector(samples, substeps=64, max_steps=steps + 1)
    envs.reset(seed=0)
    fine.reset(seed=0)
    rng = np.random.default_rng(1)
    worst, going = 0.0, np.ones(samples, dtype=bool)
    actions = np.zeros((samples, 2), dtype=np.float32)
    for k in range(steps):
        if k % 10 == 0:
            actions = rng.uniform(-1, 1, (samples, 2)).astype(np.float32)
        a, _, over, late, _ = envs.step(actions)
        b, _, truly, *_ = fine.step(actions)
        going &= ~(over | late | truly)  # one that has reached its target starts again elsewhere
        worst = max(worst, float(np.max(np.hypot(*(a - b)[going, 6:].T), initial=0.0)))
    return worst


ACCURACY: dict[str, Callable[[int, int], Any]] = {
    "closed form, Runge-Kutta": lambda n, s: ArmReachVector(n, substeps=s),
    "mujoco.batch, RK4": lambda n, s: MujocoArmReachVector(n, substeps=s),
    "mujoco.batch, Euler": lambda n, s: MujocoArmReachVector(n, substeps=s, integrator="Euler"),
}
SUBSTEPS = (1, 2, 4, 8, 16, 32)


def _turned(make: Callable[[int, int], Any], substeps: int, n: int) -> Any:
    return make(n, substeps)


def accuracy_and_speed(
    substeps: Sequence[int] = SUBSTEPS, n: int = COMPARED_AT, repeats: int = 15
) -> dict[str, list[tuple[int, float, float]]]:
    """For each model and integrator: (substeps, largest error of the tip [m], steps per second)."""
    contenders = [
        Contender(f"{name}|{s}", partial(_turned, make, s))
        for name, make in ACCURACY.items()
        for s in substeps
    ]
    found: dict[str, list[tuple[int, float, float]]] = {name: [] for name in ACCURACY}
    for rate in measure_rates(contenders, (n,), repeats, 0.01):
        name, _, text = rate.name.partition("|")
        s = int(text)
        error = tip_error(partial(_turned, ACCURACY[name], s))
        found[name].append((s, error, rate.steps_per_second))
    return found


# --- when processes pay ---------------------------------------------------------------------------


BUSY_SIZES = (0, 4_000, 16_000, 64_000, 128_000, 256_000, 512_000, 1_024_000)


def cost_of_processes(
    sizes: Sequence[int] = BUSY_SIZES, n: int = CROSSING_ENVS, repeats: int = 25
) -> dict[str, Any]:
    """Seconds per step of N environments, a loop's and processes', against an environment's cost.

    Returns:
        Best of all repeats: "cost" [s] of one environment's step, "loop", "processes" and
        "gymnasium" [s per step of all N], each a list by size;
        "predicted" and "measured", the cost [s] above which the processes of ours are faster than
        the loop (None where they do not meet).
    """
    data: dict[str, Any] = {"n": n, "workers": WORKERS}
    names = ("cost", "loop", "processes", "gymnasium")
    data |= {name: [] for name in names}
    actions = np.zeros((n, 2), dtype=np.float32)
    for size in sizes:
        build = partial(Busy, size)
        every: list[Any] = [
            VectorizedEnv(build, n),
            ProcessVectorEnv(build, n, num_workers=WORKERS),
            async_vector_env(build, n),
        ]
        runs: list[Callable[[], Any]] = [partial(Busy(size).step, actions[0])]
        for envs in every:
            envs.reset(seed=0)
            runs.append(partial(envs.step, actions))
        samples = np.empty((repeats, len(runs)))
        for run in runs:
            run()
        for row in samples:
            for i, run in enumerate(runs):
                begin = time.perf_counter()
                for _ in range(8):
                    run()
                row[i] = (time.perf_counter() - begin) / 8
        for name, value in zip(names, samples.min(axis=0), strict=True):
            data[name].append(float(value))
        for envs in every:
            envs.close()
    data["predicted"] = predicted_crossing(
        data["loop"][0], data["processes"][0], n, WORKERS, data["cost"][0]
    )
    data["measured"] = crossing(data["cost"], data["loop"], data["processes"])
    return data


def predicted_crossing(loop: float, processes: float, n: int, workers: int, base: float) -> float:
    """The cost of one environment's step [s] from which W processes beat a loop over N.

    N c + loop = N c / W + processes, with both measured for an environment that does nothing:
    c = (processes - loop) / (N (1 - 1 / W)).

    Args:
        loop: time of a step of N such environments in a loop [s].
        processes: the same with processes [s].
        n: environments.
        workers: processes, at least 2.
        base: what the step of an environment that does nothing costs [s].
    """
    return base + max(0.0, processes - loop) / (n * (1.0 - 1.0 / workers))


def crossing(cost: ArrayLike, loop: ArrayLike, processes: ArrayLike) -> float | None:
    """Where the ratio of two curves passes 1, interpolated in logarithms; None if it never does."""
    c = np.log(np.array(cost, dtype=float))
    gap = np.log(np.array(processes, dtype=float) / np.array(loop, dtype=float))
    below = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0))
    if below.size == 0:
        return None
    i = int(below[-1])
    share = gap[i] / (gap[i] - gap[i + 1])
    return float(np.exp(c[i] + share * (c[i + 1] - c[i])))


# --- the chart ------------------------------------------------------------------------------------


def _draw(rates: list[Rate], accuracy: dict[str, Any], busy: dict[str, Any]) -> Any:
    import matplotlib.pyplot as plt

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(17, 5.2), layout="constrained")
    for ax in (left, middle, right):
        ax.set(xscale="log", yscale="log")
        ax.grid(True, which="major", alpha=0.3)
    for i, contender in enumerate(CONTENDERS):
        rows = [rate for rate in rates if rate.name == contender.name]
        n = [rate.n for rate in rows]
        low, high = [rate.low for rate in rows], [rate.high for rate in rows]
        left.fill_between(n, low, high, color=PALETTE[i], alpha=0.2, linewidth=0)
        left.plot(
            n, [rate.steps_per_second for rate in rows], contender.style, marker="o", markersize=4,
            color=PALETTE[i], label=contender.name,
        )  # fmt: skip
    left.set(title="Reaching task, one step of 20 ms", xlabel="number of environments N")
    left.set_ylabel("environment steps per second")
    left.set_ylim(top=left.get_ylim()[1] * 300.0)  # room for the legend
    for i, (name, points) in enumerate(accuracy.items()):
        _, error, rate = zip(*points, strict=True)
        style = "-" if i == 0 else "--"
        middle.plot(rate, error, style, marker="o", markersize=4, color=PALETTE[i], label=name)
        for s, e, r in points:
            middle.annotate(f"{s}", (r, e), fontsize="xx-small", xytext=(3, 3),
                            textcoords="offset points")  # fmt: skip
    middle.axhline(TOLERANCE, color="0.4", linewidth=0.8)
    middle.text(0.02, TOLERANCE, f"tolerance {TOLERANCE * 1e3:g} mm", fontsize="x-small",
                color="0.3", va="bottom", transform=middle.get_yaxis_transform())  # fmt: skip
    middle.set(
        title=f"Accuracy beside speed, N = {COMPARED_AT}; numbers: substeps",
        xlabel="environment steps per second", ylabel="largest error of the tip over 2 s [m]",
    )  # fmt: skip
    names = {
        "loop": "VectorizedEnv (a loop)",
        "processes": f"ProcessVectorEnv, {WORKERS} workers",
        "gymnasium": f"Gymnasium AsyncVectorEnv, {busy['n']} workers",
    }
    cost = np.array(busy["cost"]) * 1e6
    for i, (key, name) in enumerate(names.items()):
        style = "--" if key == "gymnasium" else "-"
        right.plot(cost, np.array(busy[key]) * 1e6, style, marker="o", markersize=4,
                   color=PALETTE[i], label=name)  # fmt: skip
    right.axvline(busy["predicted"] * 1e6, color="0.4", linewidth=0.8)
    right.text(busy["predicted"] * 1e6, 0.98, " processes pay\n from here (predicted)", va="top",
               fontsize="x-small", color="0.3", transform=right.get_xaxis_transform())  # fmt: skip
    right.set(
        title=f"When processes pay, N = {busy['n']}",
        xlabel="cost of one environment's step [µs]", ylabel="time of a step of all N [µs]",
    )  # fmt: skip
    left.legend(fontsize="x-small", loc="upper left")
    middle.set_ylim(bottom=1e-12)  # room for the legend
    middle.legend(fontsize="x-small", loc="lower left")
    right.legend(fontsize="x-small", loc="lower right")
    figure.supxlabel(machine(), fontsize="x-small", color="0.4")
    return figure


def _table(rates: list[Rate]) -> str:
    sizes = sorted({rate.n for rate in rates})
    lines = [f"{'env steps/s at N =':<38}" + "".join(f"{n:>10}" for n in sizes)]
    for name in dict.fromkeys(rate.name for rate in rates):
        at = {rate.n: rate.steps_per_second for rate in rates if rate.name == name}
        cells = (f"{at[n]:.3g}" if n in at else "-" for n in sizes)
        lines.append(f"{name:<38}" + "".join(f"{cell:>10}" for cell in cells))
    return "\n".join(lines)


@chart
def vector_env() -> str:
    """Steps per second of vectorised environments, their error, and when processes pay."""
    rates = measure_rates()
    accuracy = accuracy_and_speed()
    busy = cost_of_processes()
    data = {
        "rates": [asdict(rate) for rate in rates],
        "accuracy": accuracy,
        "processes": busy,
        "machine": machine(),
    }
    save("vector_env", _draw(rates, accuracy, busy), data)
    both = (SYNC, ASYNC)
    lines = [
        _table(rates),
        f"at N = {COMPARED_AT}, best samples, beside the better of Gymnasium's two on the "
        "MuJoCo arm: "
        f"mujoco.batch {ratio(rates, BATCH, both):.1f} times, closed form "
        f"{ratio(rates, CLOSED, both):.0f} times; the closed form beside Gymnasium's loop over the "
        f"closed form: {ratio(rates, CLOSED, [SYNC_CLOSED]):.0f} times",
        f"{'largest error of the tip over 2 s [m]':<38}"
        + "".join(f"{s:>10}" for s in SUBSTEPS) + "  substeps",
    ]  # fmt: skip
    for name, points in accuracy.items():
        lines.append(f"{name:<38}" + "".join(f"{error:>10.1e}" for _, error, _ in points))
    measured = busy["measured"]
    found = (
        f"they did not meet in this run: it takes {WORKERS} free cores"
        if measured is None
        else f"measured {measured * 1e6:.0f} us"
    )
    lines.append(
        f"{WORKERS} processes beat a loop over {busy['n']} environments from "
        f"{busy['predicted'] * 1e6:.0f} us a step on, as predicted from the cost of doing nothing; "
        f"{found}"
    )
    return "\n".join(lines)
