"""Following a path within the limits of the joints: clipped, scaled, or a quadratic program."""

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.kinematics import (
    Chain,
    bounded_velocity,
    damped_velocity,
    jacobian,
    panda,
    pose_error,
    tip,
    velocity_bounds,
)
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles import mink, pink

Array = NDArray[np.float64]
Velocity = Callable[[Array, Array], Array]
FASTEST = 2.0  # rad/s, of every joint
DAMPING = 0.01  # m/rad
SECONDS = 3.0  # length of a path
TOLERANCE = 1e-5  # rad, by which a joint may pass a limit: DAQP stops at 1e-6


def reference(chain: Chain, rng: np.random.Generator, dt: float) -> Array:
    """Return a motion of all joints within their limits, (n, cycles + 1).

    Each joint swings over 98 % of its range at most at four fifths of its speed limit. The poses
    of its tip are a path that the arm can follow.
    """
    middle, half = 0.5 * (chain.lower + chain.upper), 0.49 * (chain.upper - chain.lower)
    rate = 0.8 * FASTEST / half * rng.uniform(0.2, 1.0, chain.n)
    phase = rng.uniform(-np.pi, np.pi, chain.n)
    t = dt * np.arange(round(SECONDS / dt) + 1)
    swing = np.sin(phase[:, None] + rate[:, None] * t)
    return np.asarray(middle[:, None] + half[:, None] * swing)


def scaled(v: Array, low: Array, high: Array) -> Array:
    """Return v, shortened as a whole until every joint is within its bounds."""
    room = np.where(v > 0.0, high, low)
    moving = v != 0.0
    return v * np.min(room[moving] / v[moving], initial=1.0)


def methods(chain: Chain, dt: float, libraries: bool = True) -> dict[str, Velocity]:
    """Return the methods: functions of a posture and the next pose, which return velocities."""

    def commanded(q: Array, target: Array) -> tuple[Array, Array]:
        return jacobian(chain, q), pose_error(target, tip(chain, q)) / dt

    def unlimited(q: Array, target: Array) -> Array:
        return damped_velocity(*commanded(q, target), DAMPING)

    def clipped(q: Array, target: Array) -> Array:
        return np.clip(unlimited(q, target), *velocity_bounds(chain, q, FASTEST, dt))

    def shortened(q: Array, target: Array) -> Array:
        return scaled(unlimited(q, target), *velocity_bounds(chain, q, FASTEST, dt))

    def program(q: Array, target: Array) -> Array:
        limits = velocity_bounds(chain, q, FASTEST, dt)
        return bounded_velocity(*commanded(q, target), *limits, DAMPING).v

    result: dict[str, Velocity] = {
        "no limits": unlimited,
        "scaled": shortened,
        "clipped": clipped,
        "quadratic program": program,
    }
    for name, library in (("mink", mink), ("pink", pink)) if libraries else ():
        result[name] = library.Tracker(chain, FASTEST, dt, DAMPING).velocity
    return result


class Run(NamedTuple):
    """How one method followed one path.

    Attributes:
        error: distance from the path after each cycle, shape (cycles,) [m].
        beyond: the farthest that a joint was beyond a limit [rad].
        seconds: processor time of one cycle [s].
    """

    error: Array
    beyond: float
    seconds: float


def follow(chain: Chain, velocity: Velocity, motion: Array, dt: float) -> Run:
    """Follow the tip's poses of a motion (n, cycles + 1), one velocity per cycle."""
    poses = np.ascontiguousarray(tip(chain, motion).T)
    postures = np.empty_like(motion)
    postures[:, 0] = q = motion[:, 0].copy()
    start = time.process_time()
    for k in range(1, len(poses)):
        q = q + dt * velocity(q, poses[k])
        postures[:, k] = q
    seconds = (time.process_time() - start) / (len(poses) - 1)
    error = np.linalg.norm(tip(chain, postures)[:3] - poses.T[:3], axis=0)[1:]
    low, high = chain.lower[:, None], chain.upper[:, None]
    return Run(error, float(np.maximum(low - postures, postures - high).max()), seconds)


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


@chart
def velocity_limits(
    cycles: Sequence[float] = (0.05, 0.02, 0.01, 0.005), paths: int = 100, libraries: bool = True
) -> Iterator[Panel]:
    """Chart how closely a hand follows a path within the joint limits, and what a cycle costs.

    The 7-R arm can follow each of the `paths` within its limits; `cycles` are lengths of the
    control cycle [s]. Without `libraries` mink and pink are left out.
    """
    arm = panda()
    runs: dict[str, list[list[Run]]] = {}
    for dt in cycles:
        followers = methods(arm, dt, libraries)
        # Interleaved: the methods take turns on each path, so other work slows all of them.
        for seed in range(paths):
            motion = reference(arm, np.random.default_rng(seed), dt)
            for name, velocity in followers.items():
                if not seed:
                    follow(arm, velocity, motion[:, :3], dt)  # loads and compiles
                rows = runs.setdefault(name, [[] for _ in cycles])
                rows[cycles.index(dt)].append(follow(arm, velocity, motion, dt))
    versions = ("mujoco", "mink", "pin-pink") if libraries else ("mujoco",)
    accuracy_panel = Panel(
        "Accuracy against time",
        "computing time for a second of path [s]",
        "largest error of the hand [m]",
        scale="log",
        footer=f"Beside the points: length of a cycle. {machine(libraries=versions)}",
    )
    for name, rows in runs.items():
        worst = np.array([[run.error.max() for run in row] for row in rows])
        low, median, high = np.percentile(worst, [25.0, 50.0, 75.0], axis=1)
        computing = [
            float(np.median([run.seconds for run in row])) / dt
            for row, dt in zip(rows, cycles, strict=True)
        ]
        beyond = np.mean([run.beyond > TOLERANCE for run in rows[-1]])
        banded = name in ("clipped", "quadratic program")  # six bands would hide one another
        accuracy_panel.series.append(
            Series(
                name,
                computing,
                median,
                name,
                low=low if banded else None,
                high=high if banded else None,
                tags=[f"{1e3 * dt:g} ms" for dt in cycles] if name == "scaled" else (),
                note=f"{name:<18} largest error {1e3 * median[-1]:6.2f} mm in the median "
                f"(quartiles {_two_digits(1e3 * low[-1])} and {_two_digits(1e3 * high[-1])}); "
                f"over a limit on {beyond:.0%} of paths",
            )
        )
    program = runs["quadratic program"]
    accuracy_panel.notes = [f"{paths} paths; key figures at a cycle of {1e3 * cycles[-1]:g} ms"]
    for name in runs:
        if name != "quadratic program":
            ratio = [
                a.seconds / b.seconds for a, b in zip(runs[name][-1], program[-1], strict=True)
            ]
            low, median, high = np.percentile(ratio, [25.0, 50.0, 75.0])
            accuracy_panel.notes.append(
                f"{name}: a cycle takes {median:.2g} times as long as with the quadratic program "
                f"(quartiles {low:.2g} to {high:.2g})"
            )
    yield accuracy_panel

    # A path at the upper quartile of what clipping costs.
    both = zip(runs["clipped"][-1], program[-1], strict=True)
    cost = [clip.error.max() / solved.error.max() for clip, solved in both]
    typical = int(np.argsort(cost)[3 * len(cost) // 4])
    right = Panel(
        "One path that meets a joint limit",
        "time [s]",
        "error of the hand [m]",
        scale="log y",
    )
    for name, rows in runs.items():
        if name == "pink":
            continue  # it lies on mink
        error = rows[-1][typical].error
        t = cycles[-1] * np.arange(1, error.size + 1)
        right.series.append(Series(name, t, np.maximum(error, 1e-7), name, marker=""))
    yield right
