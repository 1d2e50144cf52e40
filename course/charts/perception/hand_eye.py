"""Chapter 7, hand-eye calibration: what it costs, and the motions that do not determine it."""

import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from course.charts import chart
from course.kinematics.chain import compose, invert
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import opencv
from course.perception.calibrate import HandEye, hand_eye
from course.perception.camera import Array
from course.rigid_body.quaternion import exp, to_matrix

MOUNT = np.array([0.05, 0.0, 0.1, *exp(np.array([0.3, 0.2, -0.5]))])  # X, the camera in the hand
_BOARD = np.array([0.6, 0.1, 0.0, *exp(np.array([0.0, 0.0, 0.4]))])  # the target in the base
_AWAY = np.array([[0.0], [0.0], [0.5]])  # of the target from the camera, and where errors count [m]
# Standard deviations of the target's pose in the camera's frame, for each axis [rad], [m].
TURN_NOISE, SHIFT_NOISE = 1e-3, 5e-4
# Partners of a pose in the course's motions; 0 for all others.
PARTNERS = {"next pose": 1, "four partners": 4, "all pairs": 0}

# Curves that lie on PARK's, so they are drawn only when they are switched on.
_AS_PARK = ("OpenCV HORAUD", "OpenCV TSAI")
_SOME = 12_000  # poses of one count in all sets together

Poses = tuple[Array, Array]
"""Poses of the hand in the base and of the target in the camera's frame, (7, N) each."""


def observed(
    count: int,
    turns: Sequence[float],
    rng: np.random.Generator,
    noise: tuple[float, float] = (TURN_NOISE, SHIFT_NOISE),
) -> Poses:
    """Return poses of the hand, which are exact, and of the target, measured by the camera.

    The camera moves about the target and stays about half a metre away from it.

    Args:
        count: of the poses.
        turns: standard deviation of the camera's rotation vector about each axis, (3,) [rad].
        rng: where the poses and the noise come from.
        noise: of the target's turn [rad] and position [m], for each axis.
    """
    vectors = np.array(turns, dtype=float)[:, None] * rng.standard_normal((3, count))
    shifts = _AWAY + 0.05 * rng.standard_normal((3, count))
    target = np.concatenate((shifts, exp(vectors)))
    board, mount = (np.tile(one[:, None], count) for one in (_BOARD, MOUNT))
    hand = compose(board, invert(compose(mount, target)))
    # The measured board is turned about its own middle.
    error = np.concatenate((np.zeros((3, count)), exp(noise[0] * rng.standard_normal((3, count)))))
    measured = compose(target, error)
    measured[:3] += noise[1] * rng.standard_normal((3, count))
    return hand, measured


def motions(hand: Array, target: Array, partners: int = 0) -> tuple[Array, Array]:
    """Return the motions A of the hand and B of the camera between pairs of poses.

    They lead from the later pose back to the earlier one, as in OpenCV.

    Args:
        hand: poses in the base, shape (7, N).
        target: poses in the camera's frame, shape (7, N).
        partners: later poses that each pose is paired with, the first ones following the last; 0
            for every pair once.
    """
    n = hand.shape[1]
    if partners and 2 * partners < n - 1:
        first = np.tile(np.arange(n), partners)
        second = (first + np.repeat(np.arange(1, partners + 1), n)) % n
    else:
        first, second = np.triu_indices(n, 1)
    A = compose(invert(hand[:, second]), hand[:, first])
    return A, compose(target[:, second], invert(target[:, first]))


def solve(hand: Array, target: Array, partners: int) -> HandEye:
    """Return the course's calibration from absolute poses."""
    return hand_eye(*motions(hand, target, partners))


def turn_error(R: Array) -> float:
    """Return the error of the rotation: small angles as they are, infinity for NaN [rad].

    It is |R - R_true| / sqrt 2, which is 2 sin(angle / 2), and is defined for a mirror image, too.
    """
    error = float(np.linalg.norm(R - to_matrix(MOUNT[3:])) / math.sqrt(2.0))
    return error if math.isfinite(error) else math.inf


def point_error(R: Array, p: Array) -> float:
    """Return the error in the hand's frame of a point 0.5 m in front of the camera [m].

    It contains the error of the rotation, times half a metre, and that of the position.
    """
    expected = to_matrix(MOUNT[3:]) @ _AWAY + MOUNT[:3, None]
    return float(np.linalg.norm(R @ _AWAY + np.reshape(p, (3, 1)) - expected))


def expected_turn_error(count: float, turns: Sequence[float], partners: int = 0) -> float:
    """Return the root mean square error of the rotation that the noise of the turns makes [rad].

    Small turns, all pairs: covariance sigma^2 / N (trace(S) - S)^(-1), where S = diag(turns^2). A
    pose with few partners meets them again as noise, which adds 1 / (2 partners) to it.
    """
    square = np.square(np.asarray(turns, dtype=float))
    variance = TURN_NOISE**2 / count * np.sum(1.0 / (square.sum() - square))
    return float(np.sqrt(variance * (1.0 + (0.5 / partners if partners else 0.0))))


def answers(poses: Poses, library: bool) -> dict[str, Callable[[], Any]]:
    """Return what each method computes from the same poses; conversions are made here."""
    own: dict[str, Callable[[], Any]] = {
        name: functools.partial(solve, *poses, partners) for name, partners in PARTNERS.items()
    }
    if not library:
        return own
    given = opencv.HandEye(*poses)
    theirs = {f"OpenCV {name}": functools.partial(given.solve, name) for name in opencv.METHODS}
    return own | theirs


def pose_of(answer: Any) -> Poses:
    """Return rotation and position, (3, 3) and (3,), of an answer of either side."""
    if isinstance(answer, HandEye):
        return to_matrix(answer.pose[3:]), answer.pose[:3]
    return answer[0], answer[1].ravel()


@chart(columns=2)
def hand_eye_precision(
    counts: Sequence[int] = (4, 10, 30, 100, 300),
    sizes: Sequence[float] = (1e-4, 3e-4, 1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3),
    seeds: int = 100,
    repeats: int = 15,
    library: bool = True,
) -> Iterator[Panel]:
    """Chart a calibration's error against its time, and against how far its axes spread.

    Both sides get the same poses: the hand's are exact, the target's have 1 mrad and 0.5 mm of
    noise for each axis. Each side computes its motions inside the timer.

    Args:
        counts: of poses, the fewest first.
        sizes: of the turns about the second and third axis, in the right panel [rad].
        seeds: sets of poses for each point; at most 12,000 poses in all.
        repeats: rounds of the timer.
        library: whether OpenCV is compared.
    """
    wide = (0.4, 0.4, 0.4)
    panel = Panel(
        f"{counts[0]} to {counts[-1]} poses, turns of 0.4 rad about each axis",
        "processor time of a calibration [s]",
        "error of a point 0.5 m away [m]",
        scale="log",
    )
    samplers, errors = [], dict[str, list[list[float]]]()
    for count in counts:
        # OpenCV takes about a second for all pairs of 300 poses.
        for seed in range(min(seeds, max(1, _SOME // count))):
            methods = answers(observed(count, wide, np.random.default_rng((seed, count))), library)
            for name, run in methods.items():
                if not seed:
                    errors.setdefault(name, []).append([])
                    samplers.append(calls(run, clock=time.process_time))
                errors[name][-1].append(point_error(*pose_of(run())))
    timings = interleaved(samplers, repeats=repeats, sample=2e-3, warm_up=3e-3)
    for k, (name, rows) in enumerate(errors.items()):
        took = [timings[k + len(errors) * i] for i in range(len(counts))]
        middle = [float(np.median(row)) for row in rows]
        bounds = [1e3 * np.percentile(row, (25, 75)) for row in rows]
        message = ", ".join(
            f"{count} poses {1e3 * y:.3f} mm ({low:.3f} to {high:.3f}), {1e3 * t.median:.3g} ms"
            for count, y, t, (low, high) in zip(counts, middle, took, bounds, strict=True)
        )
        theirs = name.startswith("OpenCV")
        panel.series.append(
            Series(
                name,
                [t.median for t in took],
                middle,
                name,
                "--" if theirs else "-",
                low=[t.low for t in took],
                high=[t.high for t in took],
                across=True,
                hollow=theirs,
                extra=name in _AS_PARK,
                note=f"{name}: {message}",
            )
        )
    panel.footer = machine(
        max(t.busy for t in timings), libraries=("opencv-python-headless",) if library else ()
    )
    yield panel
    yield spread(sizes, seeds, library)


def spread(
    sizes: Sequence[float], seeds: int, library: bool, count: int = 30, first: float = 0.4
) -> Panel:
    """Return a panel: error of the rotation against the size of all turns but those about x."""
    panel = Panel(
        f"{count} poses, {first:g} rad about x: axes that are nearly parallel",
        "turns about y and z [rad]",
        "error of the rotation [rad]",
        scale="log",
        theory="noise of the turns",
    )
    errors, ranks = dict[str, list[float]](), []
    for size in sizes:
        rows, full = dict[str, list[float]](), 0
        for seed in range(seeds):
            poses = observed(count, (first, size, size), np.random.default_rng((seed, count)))
            for name, run in answers(poses, library).items():
                answer = run()
                rows.setdefault(name, []).append(turn_error(pose_of(answer)[0]))
                full += name == "all pairs" and answer.rank == 3
        ranks.append(full / seeds)
        for name, row in rows.items():
            errors.setdefault(name, []).append(float(np.sqrt(np.mean(np.square(row)))))
    # Below this the course reports that one axis is missing.
    known = [size for size, share in zip(sizes, ranks, strict=True) if share >= 0.5]
    if known:
        panel.lines = [("x", known[0], "course: rank 3")]
    for name in ("all pairs", *(f"OpenCV {name}" for name in opencv.METHODS if library)):
        theirs = name.startswith("OpenCV")
        panel.series.append(
            Series(
                name,
                sizes,
                errors[name],
                name,
                "--" if theirs else "-",
                theory=None
                if theirs
                else lambda x: expected_turn_error(count, (first, float(x), float(x))),
                hollow=theirs,
                extra=name in _AS_PARK,
                note=f"{name}: "
                + ", ".join(
                    f"{size:g} rad {y:.2g} rad" for size, y in zip(sizes, errors[name], strict=True)
                ),
            )
        )
    panel.notes.append(
        "rank 3 reported by the course: "
        + ", ".join(f"{size:g} rad {share:.0%}" for size, share in zip(sizes, ranks, strict=True))
    )
    return panel
