"""The 7-R arm in closed form: its curve of postures, and what a posture within the limits costs."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.charts.kinematics.inverse import reachable
from course.kinematics import ik, panda, pose_error, tip, within
from course.kinematics.seven_joint import (
    BRANCHES,
    closed_form,
    postures_within_limits,
    swivel_angle,
)
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles.pinocchio import Arm

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Answer = Callable[[Array, np.random.Generator], Array | None]
# A posture in the middle of the ranges: the pose of its tip has branches on both sides [rad].
POSTURE = np.array([0.3, 0.4, -0.2, -1.9, 0.5, 1.8, 0.4])
# In single calls most of the time is that of the call, so both methods lie at the same times; with
# as many tries they leave about as many poses as their batches.
DRAWN = ("closed form, a batch", "compiled search, a batch")
FOOTER = (
    "Numbers: angles of the last joint, or starts, that are tried. Triangles: every pose got an "
    "answer."
)


def curve(target: Array, count: int = 721) -> tuple[Array, Array, Flags, Array]:
    """Return the branches of a pose by the last joint angle.

    Returns:
        The last angles (N,) [rad], the swivel angles (8, N) [rad], whether a posture is within
        the limits (8, N), and the postures (7, 8, N) [rad].
    """
    arm = panda()
    last = np.linspace(arm.lower[6], arm.upper[6], count)
    q = closed_form(arm, target, last)
    low, high = arm.lower[:, None, None], arm.upper[:, None, None]
    # The sixth joint may pass half a turn.
    q = np.where((q < low) & (q + 2.0 * np.pi <= high), q + 2.0 * np.pi, q)
    swivel = np.full(q.shape[1:], np.nan)
    solved = np.isfinite(q[0])
    swivel[solved] = swivel_angle(arm, q[:, solved])
    return last, swivel, ((q >= low) & (q <= high)).all(axis=0), q


def closed(number: int) -> Answer:
    """Return a method: the closed form at `number` last angles, the first posture that fits."""
    arm = panda()

    def answer(target: Array, rng: np.random.Generator) -> Array | None:
        first = rng.uniform()  # the grid has no favourite angle
        last = arm.lower[6] + (arm.upper[6] - arm.lower[6]) * (
            (first + np.arange(number) / number) % 1.0
        )
        solved = postures_within_limits(arm, target, last)
        return solved[:, 0] if solved.shape[1] else None

    return answer


def searched(starts: int) -> Answer:
    """Return a method: the course's Levenberg-Marquardt, compiled, from `starts` uniform starts."""
    arm = panda()

    def answer(target: Array, rng: np.random.Generator) -> Array | None:
        result = ik(arm, target, restarts=starts, rng=rng)
        return np.asarray(result.q) if result.success else None

    return answer


def library(starts: int) -> Answer:
    """Return a method: Pinocchio's kinematics in the same search, its loop in Python."""
    arm = panda()
    model = Arm(arm)

    def answer(target: Array, rng: np.random.Generator) -> Array | None:
        begin = rng.uniform(arm.lower, arm.upper, (starts, 7))
        q, present, _ = model.marquardt_ik(target, begin, (arm.lower, arm.upper))
        return np.asarray(q) if present else None

    return answer


def closed_batch(poses: Array, number: int, rng: np.random.Generator) -> Array:
    """Return the first posture within the limits for each pose (7, N), or NaN, all at once."""
    arm, size = panda(), poses.shape[1]
    share = (rng.uniform(size=(size, 1)) + np.arange(number) / number) % 1.0
    last = arm.lower[6] + (arm.upper[6] - arm.lower[6]) * share
    q = closed_form(arm, np.repeat(poses, number, axis=1), last.ravel())
    low, high = arm.lower[:, None, None], arm.upper[:, None, None]
    q = np.where((q < low) & (q + 2.0 * np.pi <= high), q + 2.0 * np.pi, q)
    fits = ((q >= low) & (q <= high)).all(axis=0)
    # Branches and angles of one pose side by side; the first that fits is the answer.
    fits = np.moveaxis(fits.reshape(BRANCHES, size, number), 1, 0).reshape(size, -1)
    q = np.moveaxis(q.reshape(7, BRANCHES, size, number), 2, 1).reshape(7, size, -1)
    first = np.argmax(fits, axis=1)
    return np.where(fits.any(axis=1), q[:, np.arange(size), first], np.nan)


def searched_batch(poses: Array, number: int, rng: np.random.Generator) -> Array:
    """Return the posture that the compiled search found for each pose (7, N), or NaN."""
    result = ik(panda(), poses, restarts=number, rng=rng)
    return np.where(result.success, result.q, np.nan)


def _counts(sizes: Sequence[int], failed: Sequence[float]) -> list[str]:
    """Return the numbers of tries, up to the first that leaves no pose: that one is a triangle."""
    pairs = zip(sizes, failed, strict=True)
    return [str(n) for n, share in itertools.takewhile(lambda pair: pair[1] > 0.0, pairs)]


@chart
def seven_joint(
    targets: int = 2000,
    slow: int = 200,
    grids: Sequence[int] = (1, 2, 4, 8, 16, 32, 64, 128),
    starts: Sequence[int] = (1, 2, 4, 8, 16, 32, 64),
    batches: int = 5,
) -> Iterator[Panel]:
    """Chart the postures of one pose, and the share of poses without an answer against time.

    Every method has to find one posture within the limits, in a call for each of the `targets`;
    Pinocchio's loop gets `slow` of them. `grids` are numbers of last angles, `starts` of starts.
    At the end all poses go into one call, `batches` times.
    """
    arm = panda()
    last, swivel, fits, q = curve(tip(arm, POSTURE))
    posture_panel = Panel(
        "All postures of one pose",
        "angle of the last joint [rad]",
        "swivel angle of the elbow [rad]",
        ylim=(-np.pi, np.pi),
    )
    for name, chosen, key in (
        ("outside the limits", ~fits & np.isfinite(swivel), "no limits"),
        ("within the limits", fits, "closed form"),
    ):
        # Points, as branches begin, end and pass half a turn.
        x = np.broadcast_to(last, swivel.shape)[chosen]
        points = Series(name, x, swivel[chosen], key=key, style="", marker=".", size=3.0)
        posture_panel.series.append(points)
    solved = np.isfinite(q[0])
    wide = np.broadcast_to(tip(arm, POSTURE)[:, None], (7, int(solved.sum())))
    posture_panel.notes = [
        f"{solved.sum()} postures of one pose, {fits.sum()} within the limits; the largest error "
        f"of the tip is {np.abs(pose_error(wide, tip(arm, q[:, solved]))).max():.0e} m or rad"
    ]
    yield posture_panel

    right = Panel(
        "A posture within the limits",
        "time for a pose [s]",
        "share of the poses without an answer",
        scale="log",
        footer=f"{FOOTER} {machine(libraries=('pin',))}",
    )
    poses = reachable(arm, targets, 4)
    methods = {
        "closed form": (closed, grids, poses),
        "compiled search": (searched, starts, poses),
        "our method in Python": (library, starts, poses[:slow]),
    }
    seconds: dict[tuple[str, int], list[float]] = {}
    errors: dict[tuple[str, int], list[float]] = {}
    answers = {(name, n): make(n) for name, (make, sizes, _) in methods.items() for n in sizes}
    for answer in answers.values():
        answer(poses[0], np.random.default_rng(0))  # loads and compiles
    for k, pose in enumerate(poses):
        # Interleaved: the methods take turns on each pose, so other work slows all of them.
        for (name, n), answer in answers.items():
            if k >= len(methods[name][2]):
                continue
            rng = np.random.default_rng(k)
            begin = time.process_time()
            solved = answer(pose, rng)
            seconds.setdefault((name, n), []).append(time.process_time() - begin)
            # Forward kinematics and the limits judge every answer.
            error = np.inf
            if solved is not None and within(arm, solved):
                error = float(np.abs(pose_error(pose, tip(arm, solved))).max())
            errors.setdefault((name, n), []).append(error)
    whole = np.array(poses).T
    for k in range(batches):
        for name, (batch, sizes) in {
            "closed form, a batch": (closed_batch, grids),
            "compiled search, a batch": (searched_batch, starts),
        }.items():
            for n in sizes:
                begin = time.process_time()
                q = batch(whole, n, np.random.default_rng(k))
                spent = (time.process_time() - begin) / len(poses)
                seconds.setdefault((name, n), []).append(spent)
                known = np.isfinite(q[0]) & np.asarray(within(arm, np.nan_to_num(q)))
                errors_of_batch = np.full(len(poses), np.inf)
                errors_of_batch[known] = np.abs(
                    pose_error(whole[:, known], tip(arm, q[:, known]))
                ).max(axis=0)
                errors.setdefault((name, n), []).extend(errors_of_batch.tolist())
    for name in dict.fromkeys(name for name, _ in seconds):
        sizes = [n for other, n in seconds if other == name]
        # The mean over poses, as a few of them need many starts; the median over batches.
        average = np.median if "batch" in name else np.mean
        cost = [float(average(seconds[name, n])) for n in sizes]
        failed = [float(np.mean(np.array(errors[name, n]) > 1e-5)) for n in sizes]
        good = np.concatenate([errors[name, n] for n in sizes])
        good = good[np.isfinite(good)]
        right.series.append(
            Series(
                name,
                cost,
                failed,
                name,
                tags=_counts(sizes, failed) if name in DRAWN else [],
                extra=name not in DRAWN,
                note=f"{name:<23} {failed[-1]:.2%} without an answer at {sizes[-1]} tries, "
                f"{1e6 * cost[-1]:.3g} us; error of the answers {np.median(good):.0e} in the "
                f"median, {good.max():.0e} at most [m, rad]",
            )
        )
    right.notes = [f"{targets} poses of random postures within the limits, {slow} for Pinocchio"]
    yield right
