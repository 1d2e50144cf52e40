"""Vectorised environments: steps per second against N, their error, when processes pay."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.charts import chart
from course.kinematics.two_link import TwoLink
from course.learning import Settings, clone, dagger, evaluate, ppo, roll
from course.measure.figure import Panel, Series
from course.measure.timing import Ratio, Timing, calls, interleaved, pairwise_ratios
from course.measure.work_precision import machine
from course.oracles.gymnasium import async_vector_env, sync_vector_env
from course.oracles.mujoco.reach import MujocoArmReach, MujocoArmReachVector
from course.vector_env import ArmReach, ArmReachVector, ProcessVectorEnv, VectorizedEnv
from course.vector_env.busy import Busy
from course.vector_env.reach import MAX_STEPS, RADIUS, ReachTask, table
from course.vector_env.training import JUDGES, features, play, train

Array = NDArray[np.float64]

SIZES = (1, 4, 16, 64, 256, 1024, 4096)
COMPARED_AT = 256
TOLERANCE = 0.1 * RADIUS  # m: a tenth of the target's radius
WORKERS = 2
CROSSING_ENVS = 8


@dataclass(frozen=True)
class Contender:
    """One way of stepping N arms.

    Attributes:
        make: N -> vector environment.
        key: row of `course.measure.colours.KEYS`.
        max_envs: the largest N that is measured.
        style: line style.
        extra: not among the six curves that are shown.
    """

    make: Callable[[int], Any]
    key: str = ""
    max_envs: int = SIZES[-1]
    style: str = "-"
    extra: bool = False


def _workers(n: int) -> ProcessVectorEnv:
    return ProcessVectorEnv(MujocoArmReach, n, num_workers=min(n, WORKERS))


SYNC, ASYNC = "Gymnasium SyncVectorEnv, MuJoCo", "Gymnasium AsyncVectorEnv, MuJoCo"
CLOSED, BATCH = "ArmReachVector, closed form", "MujocoArmReachVector, mujoco.batch"
BATCH_ALONE = "mujoco.batch on one thread"
SYNC_CLOSED = "Gymnasium SyncVectorEnv, closed form"
CONTENDERS = {
    CLOSED: Contender(ArmReachVector, "closed form"),
    BATCH: Contender(MujocoArmReachVector, "mujoco.batch, RK4"),
    # Gymnasium's loop has one thread: this one is compared with it by what it does, not by cores.
    BATCH_ALONE: Contender(lambda n: MujocoArmReachVector(n, threads=1), "mujoco.batch"),
    f"ProcessVectorEnv, MuJoCo, {WORKERS} workers": Contender(_workers, "processes"),
    # As fast as Gymnasium's loop, on which it would lie.
    "VectorizedEnv, MuJoCo": Contender(
        lambda n: VectorizedEnv(MujocoArmReach, n), "loop", extra=True
    ),
    SYNC: Contender(lambda n: sync_vector_env(MujocoArmReach, n), "Gymnasium, loop", style="--"),
    # A process each: beyond 256 most machines run out of patience before memory. The third panel
    # draws it, too.
    ASYNC: Contender(
        lambda n: async_vector_env(MujocoArmReach, n), "Gymnasium, processes", 256, "--", extra=True
    ),
    SYNC_CLOSED: Contender(
        lambda n: sync_vector_env(ArmReach, n), "Gymnasium, loop, closed form", style=":"
    ),
}

Rates = dict[str, dict[int, Timing]]
"""Seconds of a step of all N, by name and N."""


def measure_rates(
    contenders: Mapping[str, Contender],
    sizes: Sequence[int] = SIZES,
    repeats: int = 25,
    sample: float = 0.01,
    clock: Callable[[], float] = time.perf_counter,
) -> Rates:
    """Time a step of every contender, all interleaved and with the same actions.

    Args:
        contenders: what to run.
        sizes: numbers of environments.
        repeats: rounds; each takes one sample of every contender.
        sample: about the time of one sample [s]. The samples of the slow ones are shorter than an
            episode of 100 steps and hold few resets, which is in their favour.
        clock: see `course.measure.timing.calls`.
    """
    rates: Rates = {name: {} for name in contenders}
    for n in sizes:
        # The same actions for all, drawn before the clock starts.
        actions = np.random.default_rng(0).uniform(-1, 1, (n, 2)).astype(np.float32)
        running = {name: c.make(n) for name, c in contenders.items() if n <= c.max_envs}
        # Reset outside the timer; a first, uncounted call follows in `interleaved`.
        for envs in running.values():
            envs.reset(seed=0)
        samplers = [calls(envs.step, actions, clock=clock) for envs in running.values()]
        # Round after round in turn, so that other work on the machine hits all contenders alike.
        timed = interleaved(samplers, repeats=repeats, sample=sample)
        for (name, envs), result in zip(running.items(), timed, strict=True):
            rates[name][n] = result
            envs.close()
    return rates


def paired_ratio(
    slow: Contender,
    fast: Contender,
    n: int = COMPARED_AT,
    pairs: int = 25,
    sample: float = 0.01,
    clock: Callable[[], float] = time.perf_counter,
) -> Ratio:
    """Return how many times as fast one contender steps as another, of interleaved pairs.

    Both samples of a pair are taken within a few hundredths of a second, so that other work on the
    machine slows both. A ratio of two best or two median samples compares different moments.

    Args:
        slow: whose time is the numerator.
        fast: whose time is the denominator.
        n: number of environments.
        pairs: pairs of samples; each is a call of `course.measure.timing.interleaved`, which takes
            a disturbed pair again.
        sample: about the time of one sample [s].
        clock: see `course.measure.timing.calls`.
    """
    actions = np.random.default_rng(0).uniform(-1, 1, (n, 2)).astype(np.float32)
    both = [slow.make(n), fast.make(n)]
    for envs in both:
        envs.reset(seed=0)
    samplers = [calls(envs.step, actions, clock=clock) for envs in both]
    # Ratios of neighbouring samples cancel slow changes of the machine; then the median.
    (ratio,) = pairwise_ratios(samplers[::-1], pairs=pairs, sample=sample)
    for envs in both:
        envs.close()
    return ratio


# --- accuracy beside speed ------------------------------------------------------------------------


def tip_error(make: Callable[[int], Any], samples: int = 32, steps: int = 99) -> float:
    """Return the largest distance [m] of the tip from the truth, over an episode of many arms.

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
        # An arm that has arrived restarts elsewhere in one of the two runs: it is no longer
        # compared.
        going &= ~(over | late | truly)  # one that has reached its target starts again elsewhere
        worst = max(worst, float(np.max(np.hypot(*(a - b)[going, 6:].T), initial=0.0)))
    return worst


ACCURACY: dict[str, tuple[str, Callable[..., Any]]] = {
    "closed form, Runge-Kutta": ("closed form", ArmReachVector),
    "mujoco.batch, RK4": ("mujoco.batch, RK4", MujocoArmReachVector),
    "mujoco.batch, Euler": (
        "mujoco.batch, Euler",
        partial(MujocoArmReachVector, integrator="Euler"),
    ),
}
SUBSTEPS = (1, 2, 4, 8, 16, 32)


# --- when processes pay ---------------------------------------------------------------------------


BUSY_SIZES = (0, 4_000, 16_000, 64_000, 128_000, 256_000, 512_000, 1_024_000)


def cost_of_processes(
    sizes: Sequence[int] = BUSY_SIZES, n: int = CROSSING_ENVS, repeats: int = 25
) -> dict[str, list[float]]:
    """Return seconds per step of N environments, in a loop and in processes, by their cost.

    Args:
        sizes: how much an environment computes in a step.
        n: environments.
        repeats: rounds, of which the best counts.

    Returns:
        "cost" [s] of one environment's step, "loop", "processes" and "gymnasium" [s per step of all
        N], each a list by size.
    """
    names = ("cost", "loop", "processes", "gymnasium")
    data: dict[str, list[float]] = {name: [] for name in names}
    actions = np.zeros((n, 2), dtype=np.float32)
    for size in sizes:
        # An environment whose step only computes for a chosen time.
        build = partial(Busy, size)
        every: list[Any] = [
            VectorizedEnv(build, n),
            ProcessVectorEnv(build, n, num_workers=WORKERS),
            async_vector_env(build, n),
        ]
        for envs in every:
            envs.reset(seed=0)
        samplers = [calls(Busy(size).step, actions[0])]
        samplers += [calls(envs.step, actions) for envs in every]
        timed = interleaved(samplers, repeats=repeats, sample=5e-3)
        for name, result in zip(names, timed, strict=True):
            # The best round: waiting for a busy core is not a property of the method.
            data[name].append(result.best)
        for envs in every:
            envs.close()
    return data


def predicted_crossing(loop: float, processes: float, n: int, workers: int, base: float) -> float:
    """Return the cost of one environment's step [s] from which W processes beat a loop over N.

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


def predicted_by_size(data: Mapping[str, ArrayLike], n: int, workers: int) -> Array:
    """Return what `predicted_crossing` says with the time of waking as it was at each cost [s].

    That time is what a step of the processes takes beyond N c / W. If it were the same at every
    cost, so would be these, and the crossing; busy cores, which the workers wait for, raise it.
    """
    cost, loop, processes = (np.array(data[name]) for name in ("cost", "loop", "processes"))
    # What remains after N c / W is the time of waking the workers and passing the data.
    waking = processes - n * (cost - cost[0]) / workers
    return np.array([predicted_crossing(loop[0], r, n, workers, cost[0]) for r in waking])


def crossing(cost: ArrayLike, loop: ArrayLike, processes: ArrayLike) -> float | None:
    """Return where the ratio of two curves passes 1, interpolated in logarithms.

    It returns None if the ratio never does.
    """
    c = np.log(np.array(cost, dtype=float))
    gap = np.log(np.array(processes, dtype=float) / np.array(loop, dtype=float))
    # The last change of sign: noise may make the curves cross more than once.
    below = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0))
    if below.size == 0:
        return None
    i = int(below[-1])
    share = gap[i] / (gap[i] - gap[i + 1])
    return float(np.exp(c[i] + share * (c[i + 1] - c[i])))


# --- the chart ------------------------------------------------------------------------------------


@chart
def vector_env(
    sizes: Sequence[int] = SIZES,
    substeps: Sequence[int] = SUBSTEPS,
    busy: Sequence[int] = BUSY_SIZES,
    repeats: int = 25,
) -> Iterator[Panel]:
    """Chart steps per second of vectorised environments, their error, and when processes pay.

    Args:
        sizes: numbers of environments.
        substeps: integration steps in a control step.
        busy: how much an environment computes, for the third panel.
        repeats: rounds.
    """
    rates = measure_rates(CONTENDERS, sizes, repeats)
    rate_panel = Panel(
        "Reaching task, one step of 20 ms",
        "number of environments N",
        "environment steps per second",
        scale="log",
    )
    disturbed = max(result.busy for row in rates.values() for result in row.values())
    # The footer says in what share of the rounds the machine was disturbed.
    envs = MujocoArmReachVector(max(sizes))
    rate_panel.footer = (
        f"{machine(disturbed)}; mujoco.batch on {envs.threads} threads, loops on one, "
        f"ProcessVectorEnv in {WORKERS} processes, AsyncVectorEnv in one per environment"
    )
    envs.close()
    rate_panel.notes.append(f"{'env steps/s at N =':<38}" + "".join(f"{n:>10}" for n in sizes))
    for name, contender in CONTENDERS.items():
        row = rates[name]
        speed, low, high = (
            [n / value(result) for n, result in row.items()]
            for value in (lambda t: t.median, lambda t: t.high, lambda t: t.low)
        )
        rate_panel.series.append(
            Series(
                name,
                [*row],
                speed,
                contender.key,
                contender.style,
                low=low,
                high=high,
                extra=contender.extra,
            )
        )
        cells = dict(zip(row, (f"{value:.3g}" for value in speed), strict=True))
        rate_panel.notes.append(f"{name:<38}" + "".join(f"{cells.get(n, '-'):>10}" for n in sizes))
    at = COMPARED_AT if COMPARED_AT in sizes else sizes[-1]
    for fast, slow in ((BATCH, SYNC), (BATCH_ALONE, SYNC), (CLOSED, SYNC), (CLOSED, SYNC_CLOSED)):
        # Ratios are measured in pairs, not as quotients of two medians from different moments.
        times_as_fast = paired_ratio(CONTENDERS[slow], CONTENDERS[fast], at, repeats)
        rate_panel.notes.append(
            f"at N = {at}, median of {repeats} interleaved pairs: {fast} beside {slow}: "
            f"{times_as_fast}"
        )
    yield rate_panel

    turned = {
        (name, s): Contender(partial(make, substeps=s))
        for name, (_, make) in ACCURACY.items()
        for s in substeps
    }
    times = measure_rates({f"{name}|{s}": c for (name, s), c in turned.items()}, (at,), repeats)
    middle = Panel(
        f"Accuracy beside speed, N = {at}; numbers: substeps",
        "environment steps per second",
        "largest error of the tip over 2 s [m]",
        scale="log",
        lines=[("y", TOLERANCE, f"tolerance {TOLERANCE * 1e3:g} mm")],
        ylim=(1e-12, None),
    )
    middle.notes.append(
        f"{'largest error of the tip over 2 s [m]':<38}"
        + "".join(f"{s:>10}" for s in substeps)
        + "  substeps"
    )
    for name, (key, _) in ACCURACY.items():
        errors = [tip_error(turned[name, s].make) for s in substeps]
        speed = [at / times[f"{name}|{s}"][at].median for s in substeps]
        middle.series.append(
            Series(
                name,
                speed,
                errors,
                key,
                "--" if "mujoco" in name else "-",
                tags=[str(s) for s in substeps],
                note=f"{name:<38}" + "".join(f"{error:>10.1e}" for error in errors),
            )
        )
    yield middle

    data = cost_of_processes(busy, CROSSING_ENVS, repeats)
    predicted = predicted_by_size(data, CROSSING_ENVS, WORKERS) * 1e6
    measured = crossing(data["cost"], data["loop"], data["processes"])
    right = Panel(
        f"When processes pay, N = {CROSSING_ENVS}",
        "cost of one environment's step [µs]",
        "time of a step of all N [µs]",
        scale="log",
        lines=[] if measured is None else [("x", 1e6 * measured, "measured crossing")],
    )
    for name, key, label in (
        ("loop", "loop", "VectorizedEnv (a loop)"),
        ("processes", "processes", f"ProcessVectorEnv, {WORKERS} workers"),
        ("gymnasium", "Gymnasium, processes", f"Gymnasium AsyncVectorEnv, {CROSSING_ENVS} workers"),
    ):
        style = "--" if name == "gymnasium" else "-"
        cost, spent = (np.array(data[column]) * 1e6 for column in ("cost", name))
        right.series.append(Series(label, cost, spent, key, style))
    waking = data["processes"][0] * 1e6
    right.notes.append(
        f"{WORKERS} processes beat a loop over {CROSSING_ENVS} environments from "
        f"{predicted[0]:.0f} us a step on, if waking always takes the {waking:.0f} us that it "
        f"takes where there is nothing to compute. With what it took at the other costs: from "
        f"{predicted.min():.0f} to {predicted.max():.0f} us, and "
        + (
            "they did not meet: the workers waited for a free core."
            if measured is None
            else f"{measured * 1e6:.0f} us measured."
        )
    )
    yield right


# --- a learning curve -----------------------------------------------------------------------------

# Pull the tip at the target, J^T (target - tip), and damp the joints: the law that a person writes.
BY_HAND = np.array([[[0, -7.5, 0, -6.0, -0.5, 0], [0, 0, 0, -12.0, 0, -0.3]]])


@chart
def learning_curve_reach(seeds: int = 8, generations: int = 30) -> Iterator[Panel]:
    """Chart what `course.vector_env.training` learns, next to a law written by hand.

    The training is repeated over several seeds.

    Args:
        seeds: runs.
        generations: of each.
    """
    curves = np.array([train(seed, generations)[0] for seed in range(seeds)])
    by_hand = play(BY_HAND, *JUDGES)[:, 0]
    steps = curves[0, :, 0]
    panels = (
        ("Return of an episode", "mean sum of rewards", ".1f"),
        ("Targets reached within 2 s", "share of 200 targets", ".2f"),
    )
    for k, (title, unit, form) in enumerate(panels, 1):
        # Range over seeds, as single runs differ more than the methods do.
        low, middle, high = np.quantile(curves[:, :, k], (0.0, 0.5, 1.0), axis=0)
        panel = Panel(title, "environment steps", unit)
        panel.lines = [("y", by_hand[k - 1], "hand-written law")]
        panel.series.append(
            Series(
                f"learned: median and range of {seeds} runs",
                steps,
                middle,
                "closed form",
                marker="",
                low=low,
                high=high,
            )
        )
        panel.notes.append(
            f"{title}: {middle[0]:{form}} untrained; after {steps[-1]:.3g} steps "
            f"{middle[-1]:{form}} (from {low[-1]:{form}} to {high[-1]:{form}} over {seeds} runs); "
            f"{by_hand[k - 1]:{form}} by hand"
        )
        yield panel


class Arm:
    """The arm as a task for imitation: its observation (8,) says all of its state."""

    def starts(self, number: int, rng: np.random.Generator) -> Array:
        """Return first observations, (number, 8)."""
        task = ReachTask(table(TwoLink(), number), MAX_STEPS)
        return task.start(np.arange(number), [rng] * number)

    def step(self, states: Array, actions: Array, rng: np.random.Generator) -> Array:
        """Return the observations a control step later, also of arms that have arrived."""
        task = ReachTask(table(TwoLink(), len(states)), MAX_STEPS)
        c1, s1, c2, s2, *rates, dx, dy = states.T
        task.q[:], task.v[:] = (np.arctan2(s1, c1), np.arctan2(s2, c2)), rates
        near, far = task.arm[5], task.arm[6]  # the links' lengths
        # Forward kinematics of the tip, less the observed offset, gives the target back.
        task.target[0] = near * c1 + far * (c1 * c2 - s1 * s2) - dx
        task.target[1] = near * s1 + far * (s1 * c2 + c1 * s2) - dy
        return task.move(np.asarray(actions, dtype=np.float32), 1)[0]

    def expert(self, states: Array, rng: np.random.Generator) -> Array:
        """Return the law written by hand, within the torques' limits, (N, 2)."""
        return np.clip(features(states) @ BY_HAND[0].T, -1.0, 1.0)

    def reached(self, act: Any, number: int) -> float:
        """Return the share of `number` common targets that a policy reaches within an episode."""
        rng = np.random.default_rng(9)
        distance = roll(self, act, self.starts(number, rng), MAX_STEPS, rng).states[:, 1:, 6:]
        return float((np.hypot(*np.moveaxis(distance, 2, 0)) < RADIUS).any(axis=1).mean())


@chart(columns=2)
def arm_learned(
    number: int = 100,
    rounds: int = 2,
    seeds: int = 3,
    judged: int = 500,
    fit: int = 2000,
    steps: int = 500_000,
) -> Iterator[Panel]:
    """Chart the hard end: torques of an arm, copied from a written law, and learned from reward.

    Args:
        number: demonstrations in a round.
        rounds: of DAgger after the first.
        seeds: of training.
        judged: targets on which a policy is evaluated.
        fit: steps of a training of the network.
        steps: of the arm, for PPO.
    """
    arm, largest = Arm(), number * (1 + rounds)
    learn = partial(clone, rate=2e-3)
    small: dict[str, Any] = {"width": 64, "steps": fit}
    methods = {
        "DAgger": [(number, rounds, small)],
        "cloned": [(number, 0, small), (largest, 0, small)],
        "cloned, wider network, longer training": [(largest, 0, {"width": 128, "steps": 2 * fit})],
    }
    # The expert's own share, which cloning tries to reach.
    by_hand = arm.reached(arm.expert, judged)
    panel = Panel(
        "Cloned, same number of labels",
        "labelled runs of 2 s",
        "share of targets reached",
        lines=[("y", by_hand, "hand-written law")],
        ylim=(0.0, 1.0),
    )
    for label, kinds in methods.items():
        x, rows = [], []
        for first, more, how in kinds:
            each = []
            for seed in range(seeds):
                taught, rng = partial(learn, seed=seed, **how), np.random.default_rng(seed)
                report = dagger(
                    arm, arm.expert, taught, arm.starts, MAX_STEPS, rng, number=first, rounds=more
                )
                each.append([arm.reached(one.policy, judged) for one in report])
            x += [first * (k + 1) for k in range(1 + more)]
            rows += list(zip(*each, strict=True))
        result = np.array(rows)
        message = ", ".join(
            f"{k} runs {r.mean():.2f} ({r.min():.2f} to {r.max():.2f})"
            for k, r in zip(x, result, strict=True)
        )
        note = f"{label}: {message}; the law itself {by_hand:.2f}"
        low, high = result.min(axis=1), result.max(axis=1)
        panel.series.append(Series(label, x, result.mean(axis=1), low=low, high=high, note=note))
    yield panel
    rated, curves = ArmReachVector(200, autoreset_mode="SameStep"), []
    for seed in range(seeds):
        envs, curve = ArmReachVector(64, autoreset_mode="SameStep"), []
        settings = Settings(hidden=(64, 64), rate=3e-3)
        rounds_of = max(1, steps // 2048)
        for k, one in enumerate(ppo(envs, settings, steps=steps, seed=seed), 1):
            if k * 5 // rounds_of > (k - 1) * 5 // rounds_of:
                success = evaluate(one.policy, rated, JUDGES[0]).success.mean()
                curve.append((one.steps, float(success)))
        curves.append(curve)
    at, share = np.moveaxis(np.array(curves), 2, 0)
    middle = share.mean(axis=0)
    panel = Panel(
        "PPO, torques as actions",
        "environment steps",
        "share of targets reached",
        lines=[("y", by_hand, "hand-written law")],
        ylim=(0.0, 1.0),
    )
    panel.series.append(
        Series(
            "PPO, 64 wide",
            at[0],
            middle,
            low=share.min(axis=0),
            high=share.max(axis=0),
            note=f"PPO, 64 wide: {middle[-1]:.2f} ({share[:, -1].min():.2f} to "
            f"{share[:, -1].max():.2f}) after {at[0, -1]:,.0f} steps, {seeds} seeds",
        )
    )
    yield panel
