"""PPO on the point: beside others, without each detail, by reward, by step size and epochs."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.control import cem
from course.learning import Settings, band, evaluate, ppo
from course.measure.figure import Panel, Series
from course.measure.sweep import sweep
from course.measure.work_precision import machine
from course.oracles import sb3
from course.vector_env import PointReachVector
from course.vector_env.point import DT, MAX_STEPS, optimum

Array = NDArray[np.float64]
SMALL = Settings(epochs=5, minibatches=4, rate=3e-3, hidden=(16, 16))
SHARE = "share of the optimum"
LIBRARIES = ("torch", "stable_baselines3")
NUM, STARTS, SOLVED = 64, 1000, 0.9  # environments, seed of the test, share of the optimum


class Trained(NamedTuple):
    """A learner's way: environment steps, processor time [s], shares of the optimum, divergence."""

    steps: Array
    seconds: Array
    scores: Array
    kl: float


def test(policy: Any, paid: str = "sparse", **task: Any) -> float:
    """Return the achieved share of the exact optimum, over 64 common starts.

    The optimum is that of the prize, or of a lasting bonus.
    """
    task = {k: v for k, v in task.items() if k not in ("prize", "max_steps")}
    late, bonus = (1000 if paid == "hover" else MAX_STEPS), task.get("bonus", 0.0)
    envs = PointReachVector(NUM, paid, autoreset_mode="SameStep", max_steps=late, **task)
    first = envs.reset(seed=STARTS)[0]
    distances = (first - task.get("offset", 0.0)) / task.get("unit", 1.0)
    # The exact optimum over the same starts, so that 1 is the best possible.
    best = optimum(
        distances, paid, bonus=bonus, max_steps=late, radius=task.get("radius", 0.05)
    ).mean()
    return float(evaluate(policy, envs, STARTS).returns.mean() / best)


def trained(
    settings: Settings,
    seed: int,
    steps: int,
    points: int = 1,
    reward: str = "potential",
    **task: Any,
) -> Trained:
    """Return ours, judged at `points` points; judging is not part of the time."""
    envs = PointReachVector(NUM, reward, autoreset_mode="SameStep", **task)
    paid = reward if reward == "hover" else "sparse"
    rounds = max(1, steps // (NUM * settings.horizon))
    rows, kl, began = [], [], time.process_time()
    for k, one in enumerate(ppo(envs, settings, steps=steps, seed=seed), 1):
        kl.append(one.kl)
        # Evenly spaced points of the curve.
        if k * points // rounds > (k - 1) * points // rounds:
            spent = time.process_time() - began
            rows.append((one.steps, spent, test(one.policy, paid, **task)))
            # The clock is moved on by what judging took.
            began = time.process_time() - spent
    at, spent, scores = np.array(rows).T
    return Trained(at, spent, scores, float(np.median(kl)))


def library(settings: Settings, seed: int, steps: int, points: int) -> Trained:
    """Return stable-Baselines3 with the same settings."""
    envs = PointReachVector(NUM, "potential", autoreset_mode="SameStep")
    # The library is judged after whole iterations, as often as ours.
    every = max(1, steps // (NUM * settings.horizon) // points)
    curve = sb3.ppo(envs, settings, test, steps=steps, seed=seed, every=every)
    return Trained(curve.steps.astype(float), curve.seconds, curve.scores, 0.0)


def linear_law(gains: Array, observed: Array) -> NDArray[np.float32]:
    """Return actions (n, 2) of observations (n, 4)."""
    return (observed @ gains.T).astype(np.float32)


def searched(seed: int, rounds: int, samples: int = 24, episodes: int = 4) -> Trained:
    """Return cross-entropy search on a linear law, actions = (2, 4) gains times observations."""
    envs = PointReachVector(samples * episodes, "potential", autoreset_mode="SameStep")
    used, rows = [0, seed], []

    def rollout(tries: Array) -> Array:
        # Every candidate gets the same number of episodes in one batch.
        gains = np.repeat(tries, episodes, axis=0).reshape(-1, 2, 4)
        # New starts in every round, the same for all candidates of a round.
        used[1] += 1
        ran = evaluate(
            lambda observed: (gains @ observed[..., None])[..., 0].astype(np.float32),
            envs,
            1000 * used[1],
        )
        used[0] += int(ran.steps.sum())
        return -ran.returns.reshape(samples, episodes).mean(axis=1)

    for k in range(1, rounds + 1):  # each from the start, the same as far as the shorter one went
        used[:] = [0, seed]
        began, rng = time.process_time(), np.random.default_rng(seed)
        law = cem(
            rollout, np.zeros((1, 8)), rng, samples=samples, elites=5, rounds=k, spread=2.0
        ).plan
        spent = time.process_time() - began
        rows.append((used[0], spent, test(partial(linear_law, law.reshape(2, 4)))))
    at, spent, scores = np.array(rows).T
    return Trained(at, spent, scores, 0.0)


def jobs(**lists: Any) -> list[dict[str, Any]]:
    """Return one job for each seed; the rest is the same."""
    seeds = lists.pop("seeds")
    return [{**lists, "seed": seed} for seed in range(seeds)]


@chart(columns=2)
def learning_curves(
    steps: int = 120_000, points: int = 8, seeds: int = 10, rounds: int = 12
) -> Iterator[Panel]:
    """Chart the share of the exact optimum over steps and time: ours, the library, a search.

    Ten seeds of each are run.
    """
    wide = replace(SMALL, hidden=(64, 64))
    same: dict[str, Any] = {"steps": steps, "points": points}
    methods: dict[str, tuple[Any, dict[str, Any]]] = {
        "ours, 16 wide": (trained, {"settings": SMALL, **same}),
        "ours, 64 wide": (trained, {"settings": wide, **same}),
        "Stable-Baselines3": (library, {"settings": wide, **same}),
        "search, linear policy": (searched, {"rounds": rounds}),
    }
    # In turns, seed by seed, so that other work on the machine is shared by all.
    turns = [
        {
            label: sweep(method, [{**how, "seed": seed}])[0]
            for label, (method, how) in methods.items()
        }
        for seed in range(seeds)
    ]
    runs = {label: [one[label] for one in turns] for label in methods}
    by_steps = Panel(
        "By environment steps",
        "environment steps",
        SHARE,
        lines=[("y", 1.0, "optimum")],
        ylim=(0.0, 1.05),
    )
    by_time = Panel(
        "By processor time, one core",
        "processor time, minimum over seeds [s]",
        SHARE,
        scale="log x",
        lines=[("y", 1.0, "optimum")],
        ylim=(0.0, 1.05),
        footer=f"{machine(libraries=LIBRARIES)}; {seeds} seeds",
    )
    for label, some in runs.items():
        middle, low, high = band([one.scores for one in some])
        at = np.median([one.steps for one in some], axis=0)
        # The least time over the seeds: the work is the same, only disturbances differ.
        spent = np.min([one.seconds for one in some], axis=0)
        other = [one.steps[one.scores >= SOLVED][0] for one in some if one.scores.max() >= SOLVED]
        message = (
            f"{label}: {middle[-1]:.3f} ({low[-1]:.3f} to {high[-1]:.3f}) after {at[-1]:,.0f} "
        )
        message += f"steps and {spent[-1]:.1f} s; {SOLVED:.0%} in {len(other)} of {seeds} seeds"
        if other:
            message += f", after {min(other):,.0f} to {max(other):,.0f} steps"
        by_steps.series.append(Series(label, at, middle, low=low, high=high, note=message))
        by_time.series.append(Series(label, spent, middle, low=low, high=high))
    yield by_steps
    yield by_time


def soft_actor_critic(seed: int, steps: int, every: int, hidden: tuple[int, ...]) -> Trained:
    """Return the learning curve of Stable-Baselines3's SAC in eight environments."""
    # Few environments, since SAC takes one gradient step for each environment step.
    envs = PointReachVector(8, "potential", autoreset_mode="SameStep")
    curve = sb3.sac(envs, test, steps=steps, seed=seed, every=every, hidden=hidden)
    return Trained(curve.steps.astype(float), curve.seconds, curve.scores, 0.0)


def batched_ppo(settings: Settings, n: int, seed: int, steps: int, every: int) -> Trained:
    """Return the learning curve of Stable-Baselines3's PPO in n environments."""
    envs = PointReachVector(n, "potential", autoreset_mode="SameStep")
    batches = max(1, every // (n * settings.horizon))
    curve = sb3.ppo(envs, settings, test, steps=steps, seed=seed, every=batches)
    return Trained(curve.steps.astype(float), curve.seconds, curve.scores, 0.0)


@chart
def off_policy(
    seeds: int = 10,
    steps: int = 7000,
    small: int = 16_384,
    large: int = 65_536,
    every: int = 1000,
    hidden: tuple[int, ...] = (64, 64),
    solved: float = 0.5,
) -> Iterator[Panel]:
    """Chart SAC beside PPO, both of Stable-Baselines3, by environment steps: median and quartiles.

    PPO runs with two sizes of batch, since a batch of 2,048 steps leaves it only three updates in
    the steps that SAC takes.

    Args:
        seeds: runs of each method.
        steps: environment steps of SAC.
        small: environment steps of PPO with batches of 512 steps.
        large: environment steps of PPO with batches of 2,048 steps.
        every: environment steps between two points of a curve.
        hidden: widths of the layers.
        solved: share of the optimum for which the text gives the number of steps.
    """
    panel = Panel(
        f"Off-policy (SAC) and on-policy (PPO), {seeds} seeds",
        "environment steps",
        SHARE,
        scale="log x",
        lines=[("y", 1.0, "optimum")],
        ylim=(0.0, 1.05),
        footer="median and quartiles; Stable-Baselines3",
    )
    usual = replace(SMALL, hidden=hidden)
    methods: dict[str, tuple[Any, dict[str, Any]]] = {
        "SAC": (soft_actor_critic, {"steps": steps, "every": every, "hidden": hidden}),
        "PPO, batches of 512": (
            batched_ppo,
            {"settings": replace(usual, epochs=10), "n": 16, "steps": small, "every": every},
        ),
        "PPO, batches of 2,048": (
            batched_ppo,
            {"settings": usual, "n": 64, "steps": large, "every": 4 * every},
        ),
    }
    for label, (method, how) in methods.items():
        runs = sweep(method, jobs(seeds=seeds, **how))
        scores = np.array([one.scores for one in runs])
        low, middle, high = np.quantile(scores, [0.25, 0.5, 0.75], axis=0)
        reached = runs[0].steps[middle >= solved]
        when = f"{reached[0]:,.0f} steps" if reached.size else "not reached"
        note = (
            f"{label}: {middle[-1]:.2f} ({low[-1]:.2f} to {high[-1]:.2f}) after "
            f"{runs[0].steps[-1]:,.0f} steps; median at {solved:g}: {when}"
        )
        panel.series.append(Series(label, runs[0].steps, middle, low=low, high=high, note=note))
    yield panel


LEFT_OUT: dict[str, dict[str, Any]] = {
    "complete PPO": {},
    "lambda 0": {"trace": 0.0},
    "one epoch": {"epochs": 1},
    "discount 0.9": {"discount": 0.9},
    "4 hidden units": {"hidden": (4,)},
    "rewards not rescaled": {"scale_rewards": False},
    "no clip": {"clip": np.inf},
    "advantages not normalised": {"normalise_advantages": False},
    "observations not normalised": {"normalise_observations": False},
    "gradient not limited": {"longest_gradient": np.inf},
    "constant step size": {"anneal": False},
    "time limit is an end": {"bootstrap": False},
}
# Where a detail matters: what the task or the settings are like there, and the detail left out.
MATTERS: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "observations near 10": (
        {"offset": 10.0},
        {},
        {"- without normalising them": {"normalise_observations": False}},
    ),
    "step size 0.01, 20 epochs": (
        {},
        {"epochs": 20, "rate": 1e-2},
        {"- without the clip": {"clip": np.inf}},
    ),
    "prize of 10": ({"prize": 10.0}, {}, {"- without rescaling rewards": {"scale_rewards": False}}),
    # To stay is worth 1.5 if nothing ends, 0.6 at most to who counts the clock; the prize about 1.
    "paid for staying near": (
        {"reward": "hover", "bonus": 0.015, "max_steps": 50},
        {},
        {"- time limit counted as an end": {"bootstrap": False}},
    ),
}


def banded(rows: dict[str, list[Trained]], report: str) -> Series:
    """Return a bar for each row, the middle over its seeds, with the band as its word."""
    every = {k: band([float(one.scores[-1]) for one in some]) for k, some in rows.items()}
    middle = [max(0.0, float(b.middle)) for b in every.values()]
    # The band over the seeds beside the middle: three seeds are few.
    tags = [f"{b.middle:.2f} ({b.low:.2f} to {b.high:.2f})" for b in every.values()]
    note = f"{report}: " + "; ".join(f"{k} {t}" for k, t in zip(every, tags, strict=True))
    low, high = ([float(b[i]) for b in every.values()] for i in (1, 2))
    return Series("", middle, list(every), style="bar", tags=tags, note=note, low=low, high=high)


@chart(columns=2)
def details_that_matter(steps: int = 80_000, seeds: int = 3) -> Iterator[Panel]:
    """Chart PPO without each of its details, on the usual task and where the detail matters."""
    same: dict[str, Any] = {"steps": steps, "seeds": seeds}
    usual = {
        k: sweep(trained, jobs(settings=replace(SMALL, **change), **same))
        for k, change in LEFT_OUT.items()
    }
    yield Panel(
        f"One detail changed, {seeds} seeds",
        SHARE,
        xlim=(0.0, 2.1),
        series=[banded(usual, "left out on the usual task")],
    )
    present: dict[str, list[Trained]] = {}
    for name, (task, settings, less) in MATTERS.items():
        for row, change in {name: {}, **less}.items():
            how = replace(SMALL, **{**settings, **change})
            present[row] = sweep(trained, jobs(settings=how, **same, **task))
    yield Panel(
        "Where one detail matters",
        SHARE,
        xlim=(0.0, 2.1),
        series=[banded(present, "where it matters")],
    )


def stumbles(radius: float) -> float:
    """Predict the chance that an untrained policy meets the disc in an episode.

    What a path sweeps, over the area where the goal may be: a disc once, and twice its radius times
    the way within that square. Speed and place go together there: who is fast is outside sooner.
    Left out: that a path crosses its own, and the seams at the edge of the square.
    """
    k = np.arange(1, MAX_STEPS + 1)[:, None]
    # Variance of a standard normal number that is cut at -1 and 1.
    push = np.sqrt(1.0 - 2.0 * np.exp(-0.5) / np.sqrt(2.0 * np.pi))
    speed = push * DT * np.sqrt(k)  # deviation along an axis [m/s]
    far = push * DT**2 * np.sqrt(k * (k + 1) * (2 * k + 1) / 6.0)  # and of the place [m]
    d = np.linspace(-2.0, 2.0, 4001)
    density = np.exp(-0.5 * (d / far) ** 2) / far / np.sqrt(2.0 * np.pi)
    weight = density * (1.0 - 0.5 * np.abs(d)) * (d[1] - d[0])
    # Density of the place times the share of goals that can lie there (triangular), by axis.
    inside = weight.sum(axis=1)
    spread = (weight * d * d).sum(axis=1) / inside
    # Of a sum of steps the speed is 1.5 place / time on average, with a quarter of its variance.
    slow = np.sqrt(0.25 * speed[:, 0] ** 2 + (1.5 / (k[:, 0] * DT)) ** 2 * spread)
    distance = np.sum(DT * np.sqrt(0.5 * np.pi) * slow * inside**2)
    return float(np.pi * radius**2 + 2.0 * radius * distance) / 4.0


@chart(columns=2)
def rewards(
    steps: int = 150_000,
    seeds: int = 4,
    points: int = 6,
    tried: int = 4000,
    radii: Sequence[float] = (0.03, 0.05, 0.1, 0.2, 0.3),
    few: int = 3,
    short: int = 60_000,
) -> Iterator[Panel]:
    """Chart three rewards for one task, and what the sparse one owes to chance.

    Args:
        steps: steps of learning.
        seeds: runs of each reward.
        points: number of points of a learning curve.
        tried: episodes of an untrained policy, at each radius [m].
        radii: radii of the goal [m].
        few: seeds at each radius.
        short: steps of learning at each radius.
    """
    panel = Panel(
        f"Rewards compared, {seeds} seeds",
        "environment steps",
        SHARE,
        lines=[("y", 1.0, "optimum")],
        ylim=(0.0, 1.05),
    )
    kinds = {
        "potential": (SMALL, "potential"),
        "sparse": (SMALL, "sparse"),
        "minus distance": (SMALL, "distance"),
        "minus distance, not rescaled": (replace(SMALL, scale_rewards=False), "distance"),
    }
    for label, (settings, reward) in kinds.items():
        some = sweep(
            trained, jobs(settings=settings, reward=reward, steps=steps, points=points, seeds=seeds)
        )
        middle, low, high = band([one.scores for one in some])
        last = ", ".join(f"{one.scores[-1]:.2f}" for one in some)
        message = f"{label}: {middle[-1]:.2f} ({low[-1]:.2f} to {high[-1]:.2f}); seeds {last}"
        panel.series.append(Series(label, some[0].steps, middle, low=low, high=high, note=message))
    yield panel
    panel = Panel(
        f"Sparse reward, by the size of the disc, {few} seeds",
        "radius of the disc [m]",
        "share of episodes, or of the optimum",
        scale="log",
        ticks=radii,
        theory="predicted: swept share of the goals' area",
        ylim=(None, 1.3),
    )
    rng, met, share = np.random.default_rng(2), [], []
    for radius in radii:
        envs = PointReachVector(tried, "sparse", autoreset_mode="SameStep", radius=radius)
        # Untrained policies, for the theory beside it.
        ran = evaluate(lambda observed: rng.standard_normal((len(observed), 2)), envs, 7)
        met.append(float(ran.success.mean()))
        some = sweep(
            trained, jobs(settings=SMALL, reward="sparse", steps=short, seeds=few, radius=radius)
        )
        share.append(float(np.median([one.scores[-1] for one in some])))
    message = ", ".join(
        f"{r:g} m {p:.3f} (predicted {stumbles(r):.3f}), learned {s:.2f}"
        for r, p, s in zip(radii, met, share, strict=True)
    )
    panel.series += [
        Series(
            "random actions: episodes that succeed",
            radii,
            met,
            theory=stumbles,
            note=f"chance, by radius: {message}",
        ),
        Series(
            f"learned after {short:,} steps: share of the optimum",
            radii,
            [s or np.nan for s in share],
        ),
    ]
    yield panel


@chart(columns=2)
def step_epochs(
    steps: int = 60_000,
    seeds: int = 3,
    counts: Sequence[int] = (1, 3, 10, 30),
    rates: Sequence[float] = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2),
    solved: float = 0.8,
) -> Iterator[Panel]:
    """Step size against epochs: what is reached, and how far the policy moves in an iteration.

    Args:
        steps: steps of learning.
        seeds: runs of each setting.
        counts: epochs per batch.
        rates: step sizes of the optimiser.
        solved: share of the optimum above which a seed counts as solved, in the text.
    """
    reached = Panel(
        f"After {steps:,} steps: median and range of {seeds} seeds",
        "step size of Adam",
        SHARE,
        scale="log x",
        ylim=(0.0, 1.05),
    )
    moved = Panel(
        "Each run (colours as left) by its divergence",
        "KL divergence per iteration, median [nats]",
        SHARE,
        scale="log x",
        ylim=(0.0, 1.05),
    )
    for epochs in counts:
        rows = [
            sweep(
                trained,
                jobs(settings=replace(SMALL, rate=rate, epochs=epochs), steps=steps, seeds=seeds),
            )
            for rate in rates
        ]
        scores = np.array([[one.scores[-1] for one in some] for some in rows])
        # How far the policy moves per iteration explains the result better than step size or epochs
        # alone.
        kl = np.array([[one.kl for one in some] for some in rows])
        middle = np.median(scores, axis=1)
        message = "; ".join(
            f"{r:g} {m:.2f}, {np.mean(s >= solved):.0%} solve, divergence {np.median(k):.2g}"
            for r, m, s, k in zip(rates, middle, scores, kl, strict=True)
        )
        name = f"{epochs} epoch" + "s" * (epochs > 1)
        low, high = scores.min(axis=1), scores.max(axis=1)
        reached.series.append(
            Series(name, rates, middle, low=low, high=high, note=f"{name}: {message}")
        )
        # Without a name: colours and marks are those of the panel beside it.
        moved.series.append(Series("", kl.ravel(), scores.ravel(), style=""))
    every, far = (np.concatenate([getattr(s, x) for s in moved.series]) for x in "yx")
    good = far[every >= solved]
    if good.size:
        moved.spans = [
            ("x", float(good.min()), float(good.max()), f"contains all runs at {solved:g} or above")
        ]
        moved.notes.append(
            f"all {good.size} of {far.size} seeds that reach {solved:g} move by "
            f"{good.min():.2g} to {good.max():.2g}"
        )
    yield reached
    yield moved
