"""Chapter 7, a bin of parts: why small ones are missed and large ones are not where they seem."""

import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from course import perception
from course.charts import chart
from course.charts.perception.clouds import ABOVE, WIDE, table_with
from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE, turned_by
from course.charts.perception.precision import box_surface, on_table
from course.kinematics.chain import compose, invert
from course.measure.figure import Panel, Series
from course.perception import (
    Camera,
    Cloud,
    Sensor,
    icp,
    locate,
    pose_distance,
    render,
    sense,
    shape,
    together,
)
from course.perception.camera import Array
from course.rigid_body.quaternion import exp, rotate

# --- Small parts ----------------------------------------------------------------------------------

STAGES = ("pixels", "voxels", "above the plane", "clustered")
# As a tutorial sets it, and each cure alone: distance [m], voxel [m], tolerance [m] or in standard
# deviations, neighbours (a share of pi (eps/v)^2 where below 1), pictures averaged.
TUTORIAL: dict[str, Any] = {"z": 0.8, "voxel": 0.005, "tolerance": 0.01, "least": 50, "shots": 1}
CURES: dict[str, dict[str, Any]] = {
    "as in a tutorial": {},
    "nearer: 0.5 m": {"z": 0.5},
    "grid of 3 mm": {"voxel": 0.003},
    "tolerance 3 sigma": {"sigmas": 3.0},
    "neighbours 0.2 pi (eps/v)^2": {"least": 0.2},
    "3 sigma, 0.2 pi (eps/v)^2": {"sigmas": 3.0, "least": 0.2},
    "3 sigma, 0.2 pi ..., 5 images": {"sigmas": 3.0, "least": 0.2, "shots": 5},
    "3 sigma, components of pixels": {"sigmas": 3.0, "least": 0.2, "pixels": True},
    "components, 0.5 m": {"sigmas": 3.0, "least": 0.2, "pixels": True, "z": 0.5},
    "components, 5 images, 0.5 m": {
        "sigmas": 3.0,
        "least": 0.2,
        "pixels": True,
        "z": 0.5,
        "shots": 5,
    },
}


def chain(size: float, rng: np.random.Generator, **settings: Any) -> dict[str, float]:
    """Return points of a cube of one size [m] after each stage, clusters of bare table, and time.

    Times are in s.

    A mean counts for the part if it is nearer than a voxel to a point of it; eps is 20 mm.
    """
    given = TUTORIAL | settings
    exact, ids = render(table_with(size, size, given["z"]), WIDE)
    shots = [sense(exact, WIDE, ABOVE, rng) for _ in range(given["shots"])]
    # Rendering and sensing are outside the clock.
    begin, eps, v = time.process_time(), 0.02, given["voxel"]
    # Averaged in inverse depth, in which a stereo sensor's noise is even.
    observed = shots[0] if len(shots) == 1 else 1.0 / np.mean(1.0 / np.array(shots), axis=0)
    points, pixels = perception.back_project(observed, WIDE)
    means, _ = perception.voxel_mean(points, v)
    tolerance = given["tolerance"]
    if "sigmas" in given:
        # The mean of n images has a standard deviation smaller by the root of n.
        sigma = float(ABOVE.sigma(given["z"], WIDE)) / math.sqrt(given["shots"])
        tolerance = given["sigmas"] * sigma
    plane, _, _ = perception.ransac_plane(means, tolerance, rng)
    least = given["least"] if given["least"] >= 1 else given["least"] * math.pi * (eps / v) ** 2
    if given.get("pixels"):
        means, v = points, 1e-6
    high = plane[:3] @ means + plane[3] > tolerance
    above = np.ascontiguousarray(means[:, high])
    if not above.size:
        labels = np.zeros(0, np.int64)
    elif given.get("pixels"):
        picture = np.zeros(observed.size)
        picture[pixels[high]] = above[2]
        groups = perception.components(picture.reshape(observed.shape), WIDE, 0.01)
        labels = groups.ravel()[pixels[high]]
        count = np.bincount(labels[labels >= 0])
        labels = np.where((labels >= 0) & (count[labels] >= least), labels, -1)
    else:
        labels, _ = perception.dbscan(above, eps, max(1, round(least)))
    # What follows only counts points for the chart.
    spent = time.process_time() - begin
    part = np.ascontiguousarray(points[:, ids.ravel()[pixels] == 1])

    def own(some: Array) -> Any:
        if not some.size:
            return np.zeros(0, bool)
        return np.diff(perception.radius_search(part, some, 0.5 * v)[0]) > 0

    mine = own(above) & (labels >= 0)
    clusters = np.bincount(labels[labels >= 0])
    real = np.bincount(labels[mine], minlength=clusters.size) > 0.5 * clusters
    # Of the cluster, too, only the part's own means: a border mean belongs to the table as well.
    clustered = np.bincount(labels[mine], minlength=clusters.size)[real].sum()
    counts = (part.shape[1], own(means).sum(), own(above).sum(), clustered)
    false = float(np.count_nonzero(clusters)) - np.count_nonzero(real & (clusters > 0))
    return dict(zip(STAGES, map(float, counts), strict=True)) | {
        "false": float(false),
        "time": spent,
    }


@chart(columns=2)
def small_parts(
    sizes: Sequence[float] = (0.006, 0.008, 0.01, 0.012, 0.016, 0.02, 0.03, 0.04),
    pictures: int = 8,
) -> Iterator[Panel]:
    """Chart which stage between depth image and cluster loses small cubes, and what helps."""
    rng = np.random.default_rng(7)
    runs = {
        name: [[chain(size, rng, **cure) for _ in range(pictures)] for size in sizes]
        for name, cure in CURES.items()
    }
    retained = Panel(
        "Points left after each stage; triangles: none",
        "side of the cube [mm]",
        "points of the cube",
        scale="log",
        ticks=(6, 10, 20, 40),
    )
    for stage in STAGES:
        y = [float(np.median([run[stage] for run in row])) for row in runs["as in a tutorial"]]
        message = ", ".join(f"{1e3 * s:g} mm {n:.0f}" for s, n in zip(sizes, y, strict=True))
        # A triangle already means that no point is left.
        marker = "X" if stage == "clustered" else None
        retained.series.append(
            Series(stage, 1e3 * np.array(sizes), y, marker=marker, note=f"{stage}: {message}")
        )
    yield retained
    best = Panel("The smallest cube found", "side of the cube [mm]")
    least = []
    for name, rows in runs.items():
        result = [np.mean([run["clustered"] > 0 for run in row]) > 0.5 for row in rows]
        # The smallest size from which on all larger ones are found.
        lost = np.flatnonzero(~np.array(result))
        first = lost[-1] + 1 if lost.size else 0
        least.append(1e3 * sizes[first] if first < len(sizes) else math.inf)
        every = [run for row in rows for run in row]
        ms, false = (
            1e3 * np.median([r["time"] for r in every]),
            np.mean([r["false"] for r in every]),
        )
        best.notes.append(
            f"{name:<30} {least[-1]:4.0f} mm, {false:6.2f} false clusters an image, {ms:5.1f} ms"
        )
    shown = [1e3 * sizes[-1] if math.isinf(x) else x for x in least]
    best.series.append(Series("", shown, [*runs], style="bar"))
    yield best


# --- Large parts ----------------------------------------------------------------------------------

CAUSES = (
    "as it is",
    "touching",
    "its twin beside it",
    "occluded",
    "cut off",
    "scale 1 % off",
    "camera 1 deg off",
)
SHORT = ("alone", "touching", "twin", "hidden", "cut off", "scale 1 %", "camera 1°")
NEIGHBOUR = shape("box", 0.03, 0.03, 0.02)
ESTIMATORS = (
    "centroid",
    "box along the table",
    "principal axes",
    "box along principal axes",
    "ICP, points",
    "ICP, shape",
    "locate",
)


def picture_of(cause: str, yaw: float, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return a picture of the large box (H, W), the pixels of its cluster, and its pose (7,)."""
    pose = on_table(BOX, 0.45 if cause == "cut off" else 0.0, 0.0, yaw)
    things = [shape("plane").moved(TABLE), BOX.moved(pose)]
    if cause == "touching":
        things.append(NEIGHBOUR.moved(turned_by(pose, 0.02, 0.08, -0.01, 0.0, 0.0, 0.0)))
    if cause == "its twin beside it":
        things.append(BOX.moved(turned_by(pose, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0)))
    if cause == "occluded":
        can = shape("cylinder", 0.03, 0.12)
        things.append(can.moved(turned_by(TABLE, 0.03, -0.13, 0.12, 0.0, 0.0, 0.0)))
    exact, ids = render(together(things), EYE)
    depth = sense(exact, EYE, SENSOR, rng) * (1.01 if cause == "scale 1 % off" else 1.0)
    return depth, (ids == 1) | ((ids == 2) & (cause in CAUSES[1:3])), pose


def estimates(depth: Array, cluster: Array, table: Array, model: Cloud) -> dict[str, Array]:
    """Return each estimator's pose of the box from its cluster, (7,).

    A nan turn where it has none.
    """
    points, _ = perception.back_project(np.where(cluster, depth, 0.0), EYE)
    flat = rotate(_back(table)[3:], points) + _back(table)[:3, None]

    def posed(x: float, y: float, yaw: float) -> Array:
        at = np.array([x, y, BOX.sizes[2, 0], *exp(np.array([0.0, 0.0, yaw]))])
        return compose(table[:, None], at[:, None])[:, 0]

    ends = 0.5 * (flat.min(axis=1) + flat.max(axis=1))
    # Principal axis of the points in the table's plane.
    along = np.linalg.eigh(np.cov(flat[:2]))[1][:, 1]
    yaw = math.atan2(along[1], along[0])
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
    inside = turn @ flat[:2]
    x, y = turn.T @ (0.5 * (inside.min(axis=1) + inside.max(axis=1)))
    start, sigma = posed(x, y, yaw), SENSOR.sigma(points[2], EYE)
    by_points = icp(points, model, start, method="point", gate=0.03, iterations=100)
    (first, *_) = locate(depth, EYE, SENSOR, BOX)
    blind = np.full(4, np.nan)
    return {
        "centroid": np.append(points.mean(axis=1), blind),
        "box along the table": np.append(posed(ends[0], ends[1], 0.0)[:3], blind),
        "principal axes": np.append(points.mean(axis=1), start[3:]),
        "box along principal axes": start,
        "ICP, points": by_points.pose,
        "ICP, shape": icp(points, BOX, start, gate=0.03, sigma=sigma).pose,
        "locate": first.pose,
    }


def _back(pose: Array) -> Array:
    return invert(pose[:, None])[:, 0]


@chart(columns=2)
def large_parts(turns: int = 10, model: int = 6000) -> Iterator[Panel]:
    """Chart seven estimators of one pose, and what goes wrong: medians over the part's turn."""
    rng = np.random.default_rng(8)
    cloud = Cloud.of(*box_surface(BOX.sizes[:, 0], model, rng))
    lean = np.array([0.0, 0.0, 0.0, *exp(np.array([math.radians(1.0), 0.0, 0.0]))])
    tilted = compose(lean[:, None], TABLE[:, None])[:, 0]
    deviation: dict[tuple[str, str], list[tuple[float, float]]] = {}
    report: dict[str, list[tuple[str, float]]] = {}
    for cause in CAUSES:
        for yaw in np.linspace(0.2, 2.9, turns):
            depth, cluster, pose = picture_of(cause, yaw, rng)
            # The camera is not where it was said to be: the estimate is right in its own frame.
            table = tilted if cause == "camera 1 deg off" else TABLE
            for name, result in estimates(depth, cluster, TABLE, cloud).items():
                # Error in the robot's frame: a wrong camera pose shows only there.
                base = compose(_back(table)[:, None], result[:, None])[:, 0]
                true = compose(_back(TABLE)[:, None], pose[:, None])[:, 0]
                far, angle = float(np.linalg.norm(base[:3] - true[:3])), math.nan
                if np.isfinite(result[3:]).all():
                    angle = pose_distance(BOX, true, base)[1]
                deviation.setdefault((name, cause), []).append((far, angle))
            (first, *_) = locate(depth, EYE, SENSOR, BOX)
            report.setdefault(cause, []).append((first.status, first.agrees))
    places = list(range(len(CAUSES)))
    shift = Panel(
        "Position of a box, 160 x 100 x 60 mm",
        "",
        "position error, median [mm]",
        scale="log y",
        ticks=places,
        tick_names=SHORT,
        lines=[("y", 2.0, "tolerance 2 mm")],
    )
    turn = Panel(
        "Its turn",
        "",
        "angle error, median [deg]",
        scale="log y",
        ticks=places,
        tick_names=SHORT,
        lines=[("y", 2.0, "tolerance 2 degrees")],
    )
    for number, name in enumerate(ESTIMATORS):
        # Side by side, as equal errors would hide each other.
        at = [place + 0.12 * (number - 3) for place in places]
        middle = np.array([np.median(deviation[name, cause], axis=0) for cause in CAUSES])
        mm, deg = 1e3 * middle[:, 0], np.degrees(middle[:, 1])
        if name != "principal axes":  # their position is the centroid
            shift.series.append(Series(name, at, mm, name, ""))
        # The turn of a box along the principal axes is theirs.
        if np.isfinite(deg).any() and name != "box along principal axes":
            turn.series.append(Series(name, at, deg, name, ""))
        row = " ".join(f"{a:6.2f} {b:5.2f}" for a, b in zip(mm, deg, strict=True))
        shift.notes.append(f"{name:<24} {row.replace('nan', '  -')}")
    head = " ".join(f"{word:<12}" for word in SHORT).rstrip()
    shift.notes.insert(0, f"{'median error [mm, deg]':<24} {head}")
    for cause, rows in report.items():
        text = [word for word, _ in rows]
        shift.notes.append(
            f"{cause}: locate returns "
            + ", ".join(f"{word} {text.count(word)}" for word in dict.fromkeys(text))
            + f"; agrees {np.median([share for _, share in rows]):.2f}"
        )
    yield shift
    yield turn


# --- Near twins -----------------------------------------------------------------------------------

FINE = Camera.symmetric(640, 480, 1.0)
# How the part differs from the model: its sign, and the noise as a multiple of the usual one.
TWINS = {"longer": (1.0, 1.0), "shorter": (-1.0, 1.0), "longer, noise x 3": (1.0, 3.0)}


def twin_limits(camera: Camera, distance: float) -> tuple[float, float]:
    """Return the differences in length at which the border is as far off as `locate` allows [m].

    The two ends are a share of the border, and a difference there is f / z times as many pixels.
    If the model lies at one end of the part, the other end is off by the whole difference: the
    first limit. If it lies in the middle, both ends are off by half of it: the second. Rounding to
    pixels adds its variance, 1/12; the noise of the depths does not enter.

    Args:
        camera: intrinsics of the image.
        distance: depth of the part [m].
    """
    length, width, _ = BOX.sizes[:, 0]
    ends = width / (length + width)
    allowed = math.sqrt(perception.pose._OFF_OUTLINE**2 - 1.0 / 12.0) * distance / camera.fx
    return allowed * math.sqrt(2.0 / ends), 2.0 * allowed / math.sqrt(ends)


@chart(columns=2)
def near_twins(
    differences: Sequence[float] = tuple(1e-3 * k for k in range(9)), pictures: int = 24
) -> Iterator[Panel]:
    """Chart how often `locate` takes a part that is a little longer or shorter for its model.

    Args:
        differences: of the lengths [m].
        pictures: of each difference, at turns that are evenly spread.
    """
    half, mm = BOX.sizes[:, 0], 1e3 * np.array(differences)
    for camera in (EYE, FINE):
        rng, distance = np.random.default_rng(9), float(TABLE[2])
        first, second = twin_limits(camera, distance)
        panel = Panel(
            f"{camera.width} x {camera.height} pixels, {1e3 * distance / camera.fx:.1f} mm each",
            "difference of the lengths [mm]",
            "share reported as found",
            lines=[("x", 1e3 * first, "one end off"), ("x", 1e3 * second, "both ends off")],
        )
        panel.notes.append(
            f"{camera.width} x {camera.height} pixels: predicted limit {1e3 * first:.1f} mm with "
            f"one end off, {1e3 * second:.1f} mm with both"
        )
        for name, (sign, times) in TWINS.items():
            sensor = Sensor(SENSOR.baseline, times * SENSOR.noise)
            shares, far = [], [0.0]
            for difference in differences:
                part, accepted = shape("box", half[0] + 0.5 * sign * difference, *half[1:]), 0
                for yaw in np.linspace(0.2, 2.9, pictures):
                    x, y = rng.uniform(-0.05, 0.05, 2)
                    true = on_table(part, x, y, yaw)
                    scene = together([shape("plane").moved(TABLE), part.moved(true)])
                    depth = sense(render(scene, camera)[0], camera, sensor, rng)
                    (one, *_) = locate(depth, camera, sensor, BOX)
                    if one.status == "found":
                        accepted += 1
                        far.append(1e3 * pose_distance(BOX, true, one.pose)[0])
                shares.append(accepted / pictures)
            # The shares fall; np.interp needs them to rise.
            middle = float(np.interp(-0.5, -np.array(shares), mm))
            panel.series.append(
                Series(
                    name,
                    mm,
                    shares,
                    hollow=name == "shorter",
                    note=f"{camera.width} x {camera.height}, {name}: half are found at "
                    f"{middle:.1f} mm; found poses are up to {max(far):.1f} mm off",
                )
            )
        yield panel
