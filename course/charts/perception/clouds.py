"""Chapter 7, pictures and clouds: the law of noise, lost parts, draws, and each step's speed."""

import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from course import perception
from course.charts import chart
from course.kinematics.chain import compose
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import open3d
from course.oracles.mujoco import camera as mujoco
from course.perception import Camera, Sensor, Shapes, shape, together
from course.perception.camera import Array
from course.rigid_body.quaternion import exp

EYE = Camera(160, 120, 600.0, 600.0, 79.5, 59.5)
WIDE = Camera.symmetric(320, 240, 1.0)
ABOVE = Sensor(noise=0.08, window=3)  # the sensor above the table
TABLE = np.array([0.0, 0.0, 0.8, *exp(np.array([math.pi - 0.4, 0.0, 0.0]))])


def _walls(sensor: Sensor, z: float, count: int, rng: np.random.Generator, eye: Camera) -> Array:
    """Return a wall at z, measured again and again, shape (count, H, W)."""
    # A wall parallel to the image: the same depth at every pixel.
    exact = np.full((eye.height, eye.width), z)
    return np.array([perception.sense(exact, eye, sensor, rng) for _ in range(count)])


@chart(columns=2)
def depth_noise(pictures: int = 12, places: int = 9) -> Iterator[Panel]:
    """Chart what is measured of a wall, beside z^2 sqrt(s^2 + q^2 / 12) / (f B)."""
    rng = np.random.default_rng(0)
    law = Panel(
        "The noise grows with the square of the distance",
        "distance z [m]",
        "standard deviation [m]",
        scale="log",
        ticks=(0.3, 0.5, 1, 2, 4, 6),
    )
    z = np.geomspace(0.3, 6.0, places)
    for noise, step in ((0.05, 0.0), (0.15, 0.0), (0.04, 0.12)):
        sensor = Sensor(noise=noise, step=step)
        spread = [float(_walls(sensor, far, pictures, rng, EYE).std()) for far in z]
        ratio = np.array(spread) / sensor.sigma(z, EYE)
        law.series.append(
            Series(
                f"{noise:g} px" + (f", steps of {step:g} px" if step else ""),
                z,
                spread,
                theory=functools.partial(sensor.sigma, camera=EYE),
                note=f"noise {noise:g} px, steps {step:g} px: measured over predicted "
                f"{ratio.min():.3f} to {ratio.max():.3f}",
            )
        )
    yield law
    k = np.arange(1, 400)
    remaining = Panel(
        "A disparity a quarter of a step off: what averaging leaves",
        "noise / step",
        "mean error / step",
    )
    shares, mean = np.linspace(0.02, 0.6, places), []
    for noise in shares:
        coarse = Sensor(noise=0.25 * noise, step=0.25)
        # A disparity a quarter of a step off the grid, where quantisation is biased.
        middle = EYE.fx * 0.05 / (37.25 * 0.25)
        disparity = EYE.fx * 0.05 / _walls(coarse, middle, pictures, rng, EYE)
        mean.append(float(disparity.mean()) / 0.25 - 37.25)

    def waves(share: Array) -> Array:
        # Fourier series of the mean of a quantiser under Gaussian dither.
        parts = (-1.0) ** k / k * np.sin(0.5 * np.pi * k)
        size = np.exp(-2.0 * (np.pi * k * np.asarray(share)[..., None]) ** 2)
        return size @ parts / np.pi

    third = float(waves(np.array(1 / 3)))
    remaining.series.append(
        Series(
            "measured",
            shares,
            mean,
            theory=waves,
            note="a quarter step off: mean error 0.25 step without noise, "
            f"{abs(third):.3f} step with noise of a third of a step",
        )
    )
    yield remaining
    share = Panel(
        "Shared noise averages out more slowly",
        "side of the averaged square [px]",
        "spread of the mean / spread with independent pixels",
        scale="log x",
        ticks=(4, 8, 16, 32, 64),
    )
    sides = (4, 8, 16, 32, 64)
    for window in (1, 3, 5, 7):
        result = []
        for n in sides:
            eye = Camera(n, n, 600.0, 600.0, 0.5 * (n - 1), 0.5 * (n - 1))
            sensor = Sensor(noise=0.05, window=window)
            means = EYE.fx * 0.05 / _walls(sensor, 1.0, 60 * pictures, rng, eye)
            result.append(float(means.mean(axis=(1, 2)).std() / 0.05 * n))

        def theory(n: Array, w: int = window) -> Array:
            # Sum over the triangular autocorrelation of a moving average.
            lag = np.arange(1 - w, w)
            size = np.asarray(n, dtype=float)[..., None]
            return (np.clip(size - np.abs(lag), 0, None) * (1 - np.abs(lag) / w)).sum(-1) / size[
                ..., 0
            ]

        share.series.append(
            Series(
                f"window {window} px",
                sides,
                result,
                theory=theory,
                note=f"window {window} px, mean of 64 x 64 px: {result[-1]:.2f} times the spread "
                f"that "
                "independent pixels would give",
            )
        )
    yield share


def table_with(size: float, height: float, z: float) -> Shapes:
    """Return a square part in the middle of a table at a distance z along the camera's axis [m]."""
    top = np.concatenate((TABLE[:2], [z], TABLE[3:]))
    part = shape("box", 0.5 * size, 0.5 * size, 0.5 * height)
    above = np.array([0.0, 0.0, 0.5 * height, 1.0, 0.0, 0.0, 0.0])
    return together([shape("plane", pose=top), part.at(compose(top, above))])


def counts(
    height: float,
    z: float,
    tolerance: float,
    least: int,
    voxel: float,
    eps: float,
    rng: np.random.Generator,
    size: float = 0.04,
) -> dict[str, int]:
    """Return how many points of a part are left after each stage, and clusters of anything else."""
    depth, ids = perception.render(table_with(size, height, z), WIDE)
    observed = perception.sense(depth, WIDE, ABOVE, rng)
    points, pixels = perception.back_project(observed, WIDE)
    means, _ = perception.voxel_mean(points, voxel)
    plane, near, _ = perception.ransac_plane(means, tolerance, rng)
    above = np.ascontiguousarray(means[:, (plane[:3] @ means + plane[3] > 0) & ~near])
    part = np.ascontiguousarray(points[:, ids.ravel()[pixels] == 1])
    # A mean counts for the part if more than half a voxel of it is within reach of one.
    # The number of the part's points within reach of each voxel mean.
    own = np.diff(perception.radius_search(part, above, 0.5 * voxel)[0]) > 0
    above_part = int(own.sum())
    labels = perception.dbscan(above, eps, least)[0] if above.size else np.zeros(0, np.int64)
    # A cluster is the part's if most of it is.
    own &= labels >= 0
    clustered = np.bincount(labels[labels >= 0])
    right = np.bincount(labels[own], minlength=clustered.size)
    real = right > 0.5 * clustered
    return {
        "pixels": part.shape[1],
        "above": above_part,
        "clustered": int(right[real].sum()),
        "false": int(np.sum(~real)),
    }


@chart(columns=2)
def lost_parts(
    heights: Sequence[float] = (0.004, 0.006, 0.008, 0.01, 0.015, 0.02, 0.03, 0.04),
    distances: Sequence[float] = (0.5, 0.65, 0.8, 1.0, 1.3, 1.6),
    pictures: int = 8,
) -> Iterator[Panel]:
    """Chart the lowest part that becomes a cluster in most pictures, and clusters of bare table."""
    lost = Panel("The lowest part that is found", "distance [m]", "height [m]", scale="log")
    false = Panel("Clusters of bare table in an image", "distance [m]", "clusters", scale="log x")
    lost.ticks = false.ticks = distances

    def three_sigma(z: float) -> float:
        return 3.0 * float(ABOVE.sigma(z, WIDE))

    for name, fixed, least in (
        ("10 mm, 50 neighbours", 0.01, 50),
        ("10 mm, 12 neighbours", 0.01, 12),
        ("4 mm, 12 neighbours", 0.004, 12),
        ("3 sigma, 12 neighbours", None, 12),
    ):
        rng, lowest, bare = np.random.default_rng(1), [], []
        for z in distances:
            result, empty = math.nan, []
            # From tall to low, until most images lose the part.
            for height in sorted(heights, reverse=True):
                runs = [
                    counts(height, z, fixed or three_sigma(z), least, 0.005, 0.02, rng)
                    for _ in range(pictures)
                ]
                empty += [run["false"] for run in runs]
                if np.mean([run["clustered"] >= least for run in runs]) <= 0.5:
                    break
                result = height
            lowest.append(result)
            bare.append(float(np.mean(empty)))
        note = ", ".join(
            f"{z:g} m " + ("none" if math.isnan(h) else f"{1e3 * h:.0f} mm")
            for z, h in zip(distances, lowest, strict=True)
        )
        lost.series.append(Series(name, distances, lowest, note=f"{name}: {note}"))
        message = ", ".join(f"{n:.1f}" for n in bare)
        false.series.append(Series(name, distances, bare, note=f"{name}: bare clusters {message}"))
    limit = 3.0 * ABOVE.sigma(np.array(distances), WIDE)
    lost.series.append(Series("3 sigma(z)", distances, limit, "theory", marker=""))
    yield lost
    yield false


@chart
def ransac_draws(trials: int = 600, points: int = 200) -> Iterator[Panel]:
    """Chart as many draws as the law asks for nine in ten; half of the points are the plane's."""
    panel = Panel(
        "How often the plane is found with the samples that the formula gives for 0.9",
        "tolerance / noise",
        "share of 600 runs",
        lines=[("y", 0.9, "promised")],
    )
    sigmas = (1.5, 2.0, 2.5, 3.3, 4.0, 5.0, 7.0)
    largest = math.ceil(perception.draws_needed(0.5, 0.9))
    exact = share_found(None, 0, trials, points, largest)
    for refits, name in enumerate(("no refit", "one refit", "two refits")):
        share = [share_found(k, refits, trials, points, largest) for k in sigmas]
        message = ", ".join(f"{k:g} sigma {s:.2f}" for k, s in zip(sigmas, share, strict=True))
        panel.series.append(Series(name, sigmas, share, note=f"{name}: {message}"))
    panel.notes.append(f"three exact inliers are drawn in {exact:.3f} of the runs, asked for 0.9")
    yield panel


def share_found(sigmas: float | None, refits: int, trials: int, n: int, at_most: int) -> float:
    """Return the share of runs whose plane has nine tenths of the true plane's inliers."""
    rng, result = np.random.default_rng(10), 0
    sigma = 1e-3 if sigmas else 0.0
    tolerance = sigma * sigmas if sigmas else 1e-9
    for _ in range(trials):
        cloud = rng.uniform(-0.3, 0.3, (3, n))
        # Half of the points on the plane, with noise; the others anywhere.
        cloud[2, : n // 2] = sigma * rng.normal(size=n // 2)
        true = np.count_nonzero(np.abs(cloud[2, : n // 2]) <= tolerance)
        cloud[2] += 1.0
        plane, _, _ = perception.ransac_plane(
            cloud, tolerance, rng, confidence=1.0, at_most=at_most, refits=refits
        )
        heights = np.abs(plane[:3] @ cloud[:, : n // 2] + plane[3])
        # Nine tenths of what the true plane would have.
        result += int(np.count_nonzero(heights <= tolerance) >= 0.9 * true)
    return result / trials


@chart(columns=2)
def cloud_speed(
    repeats: int = 7, sizes: Sequence[int] = (1000, 2000, 4000, 8000, 15_000, 30_000)
) -> Iterator[Panel]:
    """Chart processor time of each step beside the library's, at equal answers, in turns."""
    rng = np.random.default_rng(2)
    boxes = together(
        [
            shape(
                "box", 0.05, 0.04, 0.03, pose=compose(TABLE, np.array([x, y, 0.03, 1.0, 0, 0, 0]))
            )
            for x in (-0.2, 0.0, 0.2)
            for y in (-0.1, 0.1)
        ]
    )
    scene = together([shape("plane", pose=TABLE), boxes])
    depth, _ = perception.render(scene, WIDE)
    observed = perception.sense(depth, WIDE, Sensor(noise=0.03, window=3, dropout=0.02), rng)
    points, _ = perception.back_project(observed, WIDE)
    # Conversion to the library's types is not timed.
    theirs, picture = open3d.Cloud(points), open3d.Picture(observed, WIDE)
    run = functools.partial
    draws = run(perception.ransac_plane, points, 0.005)
    steps: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {
        "image, MuJoCo": (run(perception.render, scene, WIDE), mujoco.Rays(scene, WIDE).cast),
        "image, Embree": (run(perception.render, boxes, WIDE), open3d.Rays(boxes, WIDE).cast),
        "points": (run(perception.back_project, observed, WIDE), picture.cloud),
    }
    for v in (0.002, 0.005, 0.02):
        own_means, their_means = run(perception.voxel_mean, points, v), run(theirs.voxel_mean, v)
        steps[f"voxels of {1e3 * v:g} mm"] = own_means, their_means
    steps["plane, 300 draws"] = (
        run(draws, rng, at_most=300, confidence=1.0),
        run(theirs.plane, 0.005, 300),
    )
    steps["plane, early stop"] = run(draws, rng), run(theirs.plane, 0.005, 1000, 0.99)
    panel = Panel(
        "Steps on 75,000 pixels",
        "time of the library / time of the course",
        scale="log x",
        lines=[("x", 1.0, "")],
    )
    names, ratios, busy = [], [], 0.0
    for name, both in steps.items():
        # In turns, by processor time: neither side pays for other processes.
        own, other = interleaved(
            [calls(f, clock=time.process_time) for f in both], repeats=repeats, sample=5e-3
        )
        names.append(name)
        ratios.append(other.median / own.median)
        busy = max(busy, own.busy)
        panel.notes.append(
            f"{name:<18} {1e3 * own.median:7.3f} ms, library {ratios[-1]:5.1f} times"
        )
    panel.series.append(Series("library", ratios, names, "Open3D", "bar"))
    panel.footer = machine(busy)
    yield panel
    growth = Panel("Clusters: time by the number of points", "points", "time [s]", scale="log")
    result: list[tuple[float, float]] = []
    for n in sizes:
        some = rng.uniform(0.0, 1.0, (3, n)) * np.array([[0.4], [0.3], [0.02]])
        cloud = open3d.Cloud(some)
        methods = (
            calls(perception.dbscan, some, 0.02, 10, clock=time.process_time),
            calls(cloud.dbscan, 0.02, 10, clock=time.process_time),
        )
        timings = interleaved(methods, repeats=repeats, sample=5e-3)
        result.append((timings[0].median, timings[1].median))
    for k, name in enumerate(("course", "Open3D")):
        took = [row[k] for row in result]
        # Large sizes only: small ones measure what a call costs.
        slope = np.polyfit(np.log(sizes[-3:]), np.log(took[-3:]), 1)[0]  # the large ones
        growth.series.append(
            Series(
                f"{name}: $N^{{{slope:.2f}}}$",
                sizes,
                took,
                name,
                note=f"{name:<7} N^{slope:.2f}, "
                + ", ".join(
                    f"{n} points {1e3 * t:.1f} ms" for n, t in zip(sizes, took, strict=True)
                ),
            )
        )
    growth.footer = machine(busy)
    yield growth
