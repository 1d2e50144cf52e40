"""Joint angles for a pose: shares solved, residuals, and what a learned start is worth."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.kinematics import (
    Chain,
    Samples,
    ik,
    panda,
    planar,
    pose_error,
    tip,
    two_link_ik,
    within,
)
from course.kinematics.inverse import METHODS
from course.measure.figure import Panel, Series
from course.measure.success import collect
from course.oracles.pinocchio import Arm

Array = NDArray[np.float64]
Solve = Callable[[Array, np.random.Generator], float]
HOME = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])  # of the 7-R arm [rad]


def reachable(chain: Chain, count: int, seed: int) -> list[Array]:
    """Return poses of random postures within the limits."""
    q = np.random.default_rng(seed).uniform(chain.lower, chain.upper, (count, chain.n))
    return list(tip(chain, q.T).T)


def near_singular(count: int, seed: int, beside: float = 1e-4) -> list[Array]:
    """Return poses of the 7-R arm with its shoulder within `beside` [rad] of a singular posture."""
    arm, rng = panda(), np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (count, 7))
    # Joint angles at which the 7-R arm loses rank, plus a small deviation.
    q[:, [1, 2, 4]] = np.array([0.0, np.pi / 2, 0.0]) + rng.uniform(-beside, beside, (count, 3))
    return list(tip(arm, q.T).T)


def beyond(chain: Chain, count: int, seed: int, factor: float = 1.05) -> list[Array]:
    """Return reachable poses moved out beyond the arm's reach."""
    base, result = chain.placement[:3, 0], []
    for pose in reachable(chain, count, seed):
        out = (pose[:3] - base) / np.linalg.norm(pose[:3] - base)
        # Moved outwards along the line from the base, 5 % beyond the reach.
        result.append(np.concatenate([base + factor * chain.reach[1] * out, pose[3:]]))
    return result


def solver(chain: Chain, start: Any = None, **options: Any) -> Solve:
    """Return the course's `ik` as a count of iterations, infinite where it did not succeed."""

    def solve(target: Array, rng: np.random.Generator) -> float:
        first = start(target, rng) if callable(start) else start
        result = ik(chain, target, first, rng=rng, **options)
        return float(result.iterations) if result.success else np.inf

    return solve


# --- solved within a budget -----------------------------------------------------------------------


def usual(chain: Chain, clamped: bool, starts: int, rate: float, at_most: int) -> Solve:
    """Return a method: Pinocchio's usual loop, with its steps, infinite beyond the limits."""
    arm, limits = Arm(chain), (chain.lower, chain.upper)

    def solve(target: Array, rng: np.random.Generator) -> float:
        begin = rng.uniform(*limits, (starts, chain.n))
        q, present, steps = arm.usual_ik(target, begin, limits if clamped else None, rate, at_most)
        # Convergence outside the limits does not count as solved.
        return float(steps) if present and within(chain, q) else np.inf

    return solve


def marquardt_in_python(chain: Chain, starts: int = 60) -> Solve:
    """Return the course's own method in Python on Pinocchio's calls, with its steps."""
    arm, limits = Arm(chain), (chain.lower, chain.upper)

    def solve(target: Array, rng: np.random.Generator) -> float:
        begin = rng.uniform(*limits, (starts, chain.n))
        _, present, steps = arm.marquardt_ik(target, begin, limits)
        return float(steps) if present else np.inf

    return solve


@chart
def ik_success(
    targets: int = 10_000, slow: int = 300, seeds: Sequence[int] = (0, 1, 2), table: int = 10_000
) -> Iterator[Panel]:
    """Chart share of poses solved within the limits against time, beside the loop that users write.

    Pinocchio's loops get only `slow` of the targets; `seeds` are those of the starts, `table` the
    number of postures in the table.
    """
    arm = panda()
    samples = Samples(arm, table, 1)
    sets = {
        "Reachable poses of the 7-R arm": reachable(arm, targets, 0),
        "Poses within 1e-4 rad of a singular posture": near_singular(targets // 10, 0),
    }
    ours = {"uniform starts": solver(arm), "nearest of a table": solver(arm, samples)}
    theirs = {
        "usual loop": usual(arm, False, 1, 0.1, 1000),
        "usual loop, clamped, 20 starts": usual(arm, True, 20, 0.1, 1000),
        "same with full steps": usual(arm, True, 60, 1.0, 100),
        "our method in Python": marquardt_in_python(arm),
    }
    budgets = np.logspace(-4.3, 0.5, 70)
    for title, poses in sets.items():
        panel = Panel(
            title, "time for a pose [s]", "share of the poses solved", scale="log x", ylim=(0, 1.02)
        )
        rates, whole = {}, np.array(poses).T
        for name, solve in (ours | theirs).items():
            some, tried = (poses, seeds) if name in ours else (poses[:slow], seeds[:1])
            # Processor time of the whole batch, starts and failures included.
            start = time.process_time()
            steps, seconds = collect(name, solve, some, tried, "steps")
            called = name if name in theirs else f"{name}, a call a pose"
            rates[called] = steps.ever * len(some) * len(tried) / (time.process_time() - start)
            series = seconds.series(budgets, name)
            series.note = steps.series(budgets, name).note
            panel.series.append(series)
        for name, first in zip(ours, (None, samples), strict=True):
            start = time.process_time()
            result = ik(arm, whole, first)
            rates[name] = result.success.sum() / (time.process_time() - start)
            remaining = pose_error(whole, tip(arm, result.q))[:, result.success]
            # Every claimed success is checked with forward kinematics.
            wrong = (
                np.maximum(*(np.linalg.norm(x, axis=0) for x in (remaining[:3], remaining[3:])))
                > 1e-6
            )
            panel.notes.append(
                f"{name:<20} {result.success.mean():.2%} of {len(poses)}, "
                f"{wrong.sum()} claims that FK contradicts, "
                f"{result.starts.mean():.1f} starts and {result.iterations.mean():.0f} steps each"
            )
        best = rates["nearest of a table"]
        panel.notes += [
            f"{name:<31} {rate:10.3g} solved a second, table is {best / rate:6.1f} times that"
            for name, rate in rates.items()
        ]
        yield panel
    far = ik(arm, np.array(beyond(arm, slow, 0)).T, restarts=10)
    shares = {str(r): float(np.mean(far.reason == r)) for r in np.unique(far.reason)}
    message = ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
    yield Panel(
        "Beyond", notes=[f"poses 5 % beyond the reach: {far.success.sum()} claimed; {message}"]
    )


# --- residuals ------------------------------------------------------------------------------------


@chart
def ik_residual(
    budgets: Sequence[int] = (1, 2, 3, 4, 5, 6, 8, 10, 13, 17, 23, 30, 45, 70, 100),
    targets: int = 60,
) -> Iterator[Panel]:
    """Chart the median error after k steps, for ordinary targets and for targets on the edge."""
    rng, arm, two = np.random.default_rng(8), panda(), planar([1.0, 0.8])
    near = tip(arm, HOME[:, None] + rng.uniform(-0.4, 0.4, (7, targets)))
    angle = rng.uniform(-np.pi, np.pi, targets)
    edge = 1.8 * np.array([np.cos(angle), np.sin(angle), 0 * angle])
    scenes = {
        "An ordinary target of the 7-R arm": (arm, near, HOME),
        "A target on the edge of two links": (two, edge, np.array([0.3, 1.0])),
    }
    for title, (chain, goals, start) in scenes.items():
        panel = Panel(title, "steps", "median error left [m, rad]", scale="log")
        for method in METHODS:
            remaining = []
            for k in budgets:
                # Restarts off and a tolerance that is never met: exactly k steps are taken.
                options: Any = {"restarts": 0, "iterations": k, "tolerance": (1e-14, 1e-14)}
                result = ik(chain, goals, start, method=method, **options)
                remaining.append(float(np.median(np.hypot(result.distance, result.angle))))
            other = [k for k, e in zip(budgets, remaining, strict=True) if e < 1e-6]
            message = (
                f"below 1e-6 after {other[0]} steps" if other else f"{remaining[-1]:.1e} at the end"
            )
            panel.series.append(
                Series(
                    method,
                    budgets,
                    np.maximum(remaining, 1e-17),
                    method,
                    note=f"{title:<34} {method:<20} {message}",
                )
            )
        yield panel


# --- learned starts -------------------------------------------------------------------------------


def trained(
    chain: Chain, rows: Sequence[int], heads: int = 8, steps: int = 1500, width: int = 192
) -> Callable[[Array, np.random.Generator], Array]:
    """Return a small network that proposes postures for a pose.

    It has several heads, and only the nearest one learns.

    One head would learn the mean of all answers, which is none (Guzman-Rivera et al., Multiple
    choice learning, 2012). The network sees some rows of the pose, has two hidden layers and is
    trained for `steps` steps of Adam, each with 512 new postures. Returns (target, rng) -> starts
    (n, heads).
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # two threads that share a busy core cost more than they win
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    low, high = (
        np.where(np.isfinite(x), x, s * np.pi) for x, s in ((chain.lower, -1), (chain.upper, 1))
    )
    angles, observed = 2 * chain.n, len(rows)
    net = torch.nn.Sequential(
        torch.nn.Linear(observed, width),
        torch.nn.SiLU(),
        torch.nn.Linear(width, width),
        torch.nn.SiLU(),
        torch.nn.Linear(width, heads * angles),
    )
    optimiser = torch.optim.Adam(net.parameters(), 2e-3)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        q = rng.uniform(low[:, None], high[:, None], (chain.n, 512))
        pose = torch.tensor(_signed(tip(chain, q))[list(rows)].T, dtype=torch.float32)
        truth = torch.tensor(np.concatenate([np.cos(q), np.sin(q)]).T, dtype=torch.float32)
        # Cosine and sine of each angle, so that a full turn has no jump.
        deviation = ((net(pose).reshape(-1, heads, angles) - truth[:, None]) ** 2).sum(dim=2)
        # A little for all heads, so that none is left behind for good.
        loss = deviation.min(dim=1).values.mean() + 0.02 * deviation.mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        slower.step()
    torch.set_num_threads(threads)

    def propose(target: Array, rng: np.random.Generator) -> Array:
        pose = np.concatenate([target, np.zeros(7 - target.size)])[:, None]
        with torch.no_grad():
            out = net(torch.tensor(_signed(pose)[list(rows), 0], dtype=torch.float32))
        c, s = np.asarray(out.reshape(heads, 2, chain.n), dtype=float).transpose(1, 2, 0)
        # The heads in random order, so that no head is always tried first.
        q = np.arctan2(s, c)[:, rng.permutation(heads)]
        return np.asarray(np.clip(q, chain.lower[:, None], chain.upper[:, None]))

    return propose


def _signed(pose: Array) -> Array:
    """Return poses with qw from 0 on: q and -q are one rotation, and one input."""
    return np.concatenate([pose[:3], pose[3:] * np.where(pose[3:4] < 0, -1.0, 1.0)])


def solution_curve(lengths: Sequence[float], target: Array, count: int = 720) -> Array:
    """Return all postures of three links that put the tip at a point, by its last heading, (3, M).

    Two links reach the wrist for each heading: the answers are a curve, or two.
    """
    heading = np.linspace(-np.pi, np.pi, count, endpoint=False)
    wrist = target[:2, None] - lengths[2] * np.array([np.cos(heading), np.sin(heading)])
    answer = two_link_ik(lengths[:2], wrist)
    # The last joint makes up the difference to the heading.
    ends = heading - answer.q.sum(axis=0)
    q = np.stack([answer.q[0], answer.q[1], ends])[:, :, answer.reached]
    return np.asarray(q.reshape(3, -1))


def covered(curve: Array, result: Array, near: float = 0.3) -> float:
    """Return the share of the curve (3, M) within `near` [rad] of a posture (3, K), per joint."""
    # Angles are compared modulo a full turn, by the worst joint.
    distance = np.abs(np.angle(np.exp(1j * (curve[:, :, None] - result[:, None]))))
    return float((distance.max(axis=0).min(axis=1) < near).mean())


@chart
def learned_seeds(
    targets: int = 1000,
    steps: int = 1500,
    table: int = 10_000,
    draws: Sequence[int] = (1, 2, 4, 8, 16, 32, 64, 128),
    points: int = 40,
) -> Iterator[Panel]:
    """Chart the baselines that a learned solver must beat.

    They are starts for Levenberg-Marquardt, and the share of answers that they cover.

    On the left `targets` of the 7-R arm, with `steps` steps of training and `table` postures
    in the table; on the right `points` of the 3-R arm, by numbers of starts (`draws`).
    """
    arm, begun, rng = panda(), time.process_time(), np.random.default_rng(3)
    network = trained(arm, range(7), steps=steps)
    took = time.process_time() - begun
    methods: dict[str, Any] = {
        "uniform starts": solver(arm),
        "nearest of a table": solver(arm, Samples(arm, table, 1)),
        "network's starts": solver(arm, network),
    }
    budgets = np.unique(np.round(np.logspace(0.3, 3.5, 60)))
    budget_panel = Panel(
        "7-R arm: solved within a budget",
        "steps of Levenberg-Marquardt",
        "share of targets solved",
        scale="log x",
    )
    problems = reachable(arm, targets, 2)
    # What the network's proposals are worth before any step of the solver.
    alone = [
        np.linalg.norm((tip(arm, network(pose, rng)) - pose[:, None])[:3], axis=0).min()
        for pose in problems
    ]
    budget_panel.notes = [
        f"the network learned for {took:.0f} s; alone the best of its proposals is "
        f"{np.median(alone):.3f} m off in the median"
    ]
    for name, solve in methods.items():
        result, _ = collect(name, solve, problems, (0,), "steps")
        budget_panel.series.append(result.series(budgets, name))
    yield budget_panel

    lengths = (1.0, 0.8, 0.5)
    three = planar(lengths)
    proposals = trained(three, (0, 1), heads=max(draws), steps=steps)
    places = Samples(three, table, 1)
    radius, angle = rng.uniform(0.3, 1.9, points), rng.uniform(-np.pi, np.pi, points)
    goals = np.array([radius * np.cos(angle), radius * np.sin(angle), 0 * angle]).T

    def uniform(goal: Array, k: int) -> Array:
        return rng.uniform(-np.pi, np.pi, (3, k))

    def nearest(goal: Array, k: int) -> Array:
        return places.nearest(goal[:, None], k)[0].T

    def learned(goal: Array, k: int) -> Array:
        return proposals(goal, rng)[:, :k]

    right = Panel(
        "3-R arm: answers found of a known curve",
        "starts, each solved",
        "share of the curve within 0.3 rad",
        scale="log x",
    )
    for (name, _), seeds in zip(methods.items(), (uniform, nearest, learned), strict=True):
        shares = np.zeros((len(draws), points))
        for j, goal in enumerate(goals):
            starts = seeds(goal, max(draws))
            # One answer from each start, as a chain of its own.
            ends = [ik(three, goal, start, restarts=0) for start in starts.T]
            good = np.array([end.q for end in ends if end.success]).reshape(-1, 3).T
            # Which start each answer came from: the first k starts are a prefix.
            order = np.flatnonzero([end.success for end in ends])
            curve = solution_curve(lengths, goal)
            for i, k in enumerate(draws):
                selected = good[:, order < k]
                shares[i, j] = covered(curve, selected) if selected.size else 0.0
        mean = shares.mean(axis=1)
        right.series.append(
            Series(
                name,
                draws,
                mean,
                name,
                note=f"{name:<20} covers {mean[len(draws) // 2]:.0%} of the answers with "
                f"{draws[len(draws) // 2]} starts, {mean[-1]:.0%} with {draws[-1]}",
            )
        )
    yield right
