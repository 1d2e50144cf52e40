"""Chapter 7, speed against accuracy: poses over voxel size, whole frames, and planes."""

import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from course import perception
from course.charts import chart
from course.charts.perception.poses import BOX, SENSOR, TABLE, turned_by
from course.kinematics.chain import compose, invert
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import open3d, small_gicp
from course.perception import Camera, Cloud, Sensor, Shapes, icp, render, sense, shape, together
from course.perception.camera import Array
from course.perception.pose import standing_starts
from course.rigid_body.quaternion import exp, rotate

CORNERS = BOX.sizes * np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8)


def on_table(part: Shapes, x: float, y: float, yaw: float) -> Array:
    """Return the pose of a part that stands on the charts' table, in the camera's frame, (7,)."""
    at = np.array([x, y, part.sizes[2, 0], *exp(np.array([0.0, 0.0, yaw]))])
    return compose(TABLE[:, None], at[:, None])[:, 0]


def corner_error(result: Array, true: Array) -> float:
    """Return how far the corners of the box are from where they are, in the mean square [m]."""
    # One error in metres for position and rotation together.
    where = [rotate(q[3:], CORNERS) + q[:3, None] for q in (result, true)]
    return float(np.sqrt(np.mean(np.sum((where[0] - where[1]) ** 2, axis=0))))


def box_surface(half: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return points on a box and their normals, (3, count) each."""
    # Faces are drawn by area, so that the points are uniform on the surface.
    area = np.prod(half) / half
    face = rng.choice(3, count, p=area / area.sum())
    normal = np.eye(3)[:, face] * rng.choice([-1.0, 1.0], count)
    return half[:, None] * (rng.uniform(-1.0, 1.0, (3, count)) * (normal == 0.0) + normal), normal


def model_points(voxel: float) -> int:
    """Return how many points a model of the box needs for a spacing of `voxel` metres.

    Open3D builds the tree of its target at each call, so a denser model would only cost it time.
    """
    half = BOX.sizes[:, 0]
    area = 8.0 * float(np.prod(half) * np.sum(1.0 / half))
    return max(500, round(area / voxel**2))


Lay = Callable[[Any, Array], tuple[float, float, Array]]


@functools.cache
def methods(eye: Camera, model: int) -> dict[str, tuple[Callable[..., Any], Lay]]:
    """Return for each method a function (points, voxel) -> means, and a registration function.

    The second one maps (means, start) to (unmatched, residual, pose). All register the means to the
    part's planes, within 30 mm at first and 6 mm in the end, until a step is below 10 um. The
    cloud's normals are known to all but small_gicp, which fits them.

    Args:
        eye: the camera.
        model: points on the box, for the methods that register to a cloud.
    """
    points, normals = box_surface(BOX.sizes[:, 0], model, np.random.default_rng(0))
    # Models and trees are built once, outside the timed calls.
    own, theirs = Cloud.of(points, normals), open3d.Cloud(points)
    small, last = small_gicp.Cloud(points, 12), 0.006
    theirs.set_normals(normals)

    def to_shape(means: Array, start: Array) -> tuple[float, float, Array]:
        sigma = SENSOR.sigma(means[2], eye)
        fit = icp(means, BOX, start, gate=(0.03, last), sigma=sigma, tolerance=1e-5)
        return float(np.mean(~fit.matched)), fit.residual, fit.pose

    def to_cloud(means: Array, start: Array) -> tuple[float, float, Array]:
        fit = icp(means, own, start, gate=(0.03, last), tolerance=1e-5)
        return float(np.mean(~fit.matched)), fit.residual, fit.pose

    def by_open3d(means: open3d.Cloud, start: Array) -> tuple[float, float, Array]:
        at = invert(start[:, None])[:, 0]
        # The same two gates and stopping rule as ours.
        for gate in (0.03, last):
            fit = means.icp(theirs, at, gate, 30, True, 1e-5)
            at = fit.pose
        return 1.0 - fit.matched, fit.residual, invert(at[:, None])[:, 0]

    def by_small(means: small_gicp.Cloud, start: Array) -> tuple[float, float, Array]:
        at = invert(start[:, None])[:, 0]
        for gate in (0.03, last):
            fit = means.align(small, at, gate, 30, "PLANE_ICP", 1e-5)
            at = fit.pose
        return -float(fit.matched), fit.error, invert(at[:, None])[:, 0]

    def means_of(cloud: Array, voxel: float) -> Array:
        return perception.voxel_mean(cloud, voxel)[0]

    return {
        "shape": (means_of, to_shape),
        "cloud": (means_of, to_cloud),
        "Open3D": (lambda cloud, voxel: open3d.Cloud.of(cloud.voxel_mean(voxel)), by_open3d),
        "small_gicp": (lambda cloud, voxel: cloud.voxel_mean(voxel), by_small),
    }


MADE: dict[str, Callable[[Array], Any]] = {
    "shape": np.asarray,
    "cloud": np.asarray,
    "Open3D": open3d.Cloud,
    "small_gicp": small_gicp.Cloud,
}


@chart(columns=2)
def pose_precision(
    voxels: Sequence[float] = (0.001, 0.002, 0.004, 0.008, 0.015, 0.03),
    pictures: int = 20,
    repeats: int = 7,
) -> Iterator[Panel]:
    """Chart what a finer grid costs and what it buys, where three faces of the part are seen."""
    eye, rng = Camera.symmetric(640, 480, 1.0), np.random.default_rng(4)
    compared = {v: methods(eye, model_points(v)) for v in voxels}
    names = tuple(compared[voxels[0]])
    for window, noise in ((1, "independent noise"), (5, "noise shared over 5 px")):
        sensor, looks = Sensor(SENSOR.baseline, SENSOR.noise, window), []
        for x, y, yaw in rng.uniform((-0.15, -0.1, 0.4), (0.15, 0.1, 1.1), (pictures, 3)):
            pose = on_table(BOX, x, y, yaw)
            depth = sense(render(BOX.moved(pose), eye)[0], eye, sensor, rng)
            # A start a few millimetres and degrees off, the same for all methods.
            start = turned_by(pose, 0.006, -0.005, 0.004, 0.02, -0.02, 0.06)
            looks.append((perception.back_project(depth, eye)[0], pose, start))
        panel = Panel(
            f"Error of a pose, {noise}",
            "time of a pose [s]",
            "error of a corner [m]",
            scale="log",
            lines=[("y", 2e-3, "tolerance 2 mm"), ("y", 2e-4, "a tenth")],
        )
        samplers, rows = [], []
        for name in names:
            clouds = [MADE[name](points) for points, _, _ in looks]

            def run(cloud: Any, v: float, start: Array, name: str = name) -> Array:
                grid, lay = compared[v][name]
                return np.asarray(lay(grid(cloud, v), start)[2])

            for v in voxels:
                each = zip(clouds, looks, strict=True)
                error = [
                    corner_error(run(cloud, v, start), pose) for cloud, (_, pose, start) in each
                ]
                rows.append((name, v, float(np.sqrt(np.mean(np.square(error))))))
                # Processor time, which other processes do not lengthen; conversion to each library
                # is outside.
                samplers.append(calls(run, clouds[0], v, looks[0][2], clock=time.process_time))
        # All methods and voxel sizes in turn, in one set of rounds.
        timings = interleaved(samplers, repeats=repeats, sample=5e-3)
        times = [one.median for one in timings]
        for name in names:
            mine = [k for k, row in enumerate(rows) if row[0] == name]
            message = ", ".join(
                f"{1e3 * rows[k][1]:g} mm: {1e3 * rows[k][2]:.3f} mm, {1e3 * times[k]:.2f} ms"
                for k in mine
            )
            theirs = name in ("Open3D", "small_gicp")
            panel.series.append(
                Series(
                    name,
                    [times[k] for k in mine],
                    [rows[k][2] for k in mine],
                    name,
                    "--" if theirs else "-",
                    hollow=theirs,
                    size=6.0 if theirs else 4.0,
                    note=f"{noise}, {name}: {message}",
                )
            )
        for _, limit, words in panel.lines:
            good = [
                (times[k], e, f"{name}, {1e3 * v:g} mm")
                for k, (name, v, e) in enumerate(rows)
                if e <= limit
            ]
            if good:
                x, y, pick = min(good)
                panel.series.append(
                    Series(
                        "",
                        [x],
                        [y],
                        "chosen",
                        "",
                        hollow=True,
                        size=13.0,
                        tags=[f"pick: {pick}"],
                        note=f"{noise}, pick for {words}: {pick}",
                    )
                )
        panel.footer = machine(max(one.busy for one in timings))
        yield panel


# --- Whole frames ---------------------------------------------------------------------------------

PLACES = ((-0.22, -0.02), (0.0, 0.06), (0.22, -0.04))
STAGES = ("points", "voxels", "plane", "clusters", "poses")
FRAME = Camera.symmetric(320, 240, 1.0)


def frame(
    depth: Array, eye: Camera, library: bool, voxel: float = 0.004
) -> tuple[list[Array], Array]:
    """Run the chain on one depth image, with the course or Open3D.

    It returns poses, and processor time for each stage.

    Both: points, voxel means, RANSAC within 4 sigma, DBSCAN of 20 mm with 10 neighbours, then four
    starts for each cluster; of the answers the one that leaves out the fewest points, and of these
    the one with the smallest residual.
    """
    grid, lay = methods(eye, model_points(voxel))["Open3D" if library else "shape"]
    # Four standard deviations of depth noise at the distance of the table.
    tolerance = 4.0 * float(SENSOR.sigma(0.8, eye))
    picture = open3d.Picture(depth, eye) if library else None  # made before the clock starts
    # The image is converted before the first mark; then one mark after each stage.
    marks = [time.process_time()]
    if picture is not None:
        cloud = open3d.Cloud.of(picture.cloud())
        marks.append(time.process_time())
        some = grid(cloud, voxel)
        marks.append(time.process_time())
        plane, near = some.plane(tolerance, 1000, 0.99)
        remaining = some.handle.select_by_index(np.flatnonzero(near), invert=True)
        marks.append(time.process_time())
        labels = open3d.Cloud.of(remaining).dbscan(0.02, 10)
        above = some.array(remaining)
    else:
        points, _ = perception.back_project(depth, eye)
        marks.append(time.process_time())
        some = grid(points, voxel)
        marks.append(time.process_time())
        plane, near, _ = perception.ransac_plane(some, tolerance, np.random.default_rng(0))
        above = np.ascontiguousarray(some[:, ~near])
        marks.append(time.process_time())
        labels, _ = perception.dbscan(above, 0.02, 10)
    marks.append(time.process_time())
    poses = []
    for k in range(labels.max(initial=-1) + 1):
        mine = np.ascontiguousarray(above[:, labels == k])
        given = open3d.Cloud(mine) if library else mine
        answers = [lay(given, start) for start in standing_starts(BOX, mine, plane, 4)]
        # Fewest points left out first, then the smallest residual.
        poses.append(min(answers, key=lambda one: (round(one[0], 2), one[1]))[2])
    marks.append(time.process_time())
    return poses, np.diff(marks)


@chart
def frame_speed(pictures: int = 25) -> Iterator[Panel]:
    """Chart three boxes on a table, from the picture to their poses: where a frame's time goes."""
    eye, rng = FRAME, np.random.default_rng(5)
    places = list(range(len(STAGES) + 1))
    panel = Panel(
        "A frame with three boxes, one thread",
        "",
        "processor time [ms]",
        scale="log y",
        ticks=places,
        tick_names=(*STAGES, "whole frame"),
    )
    spent: dict[str, list[Array]] = {"course": [], "Open3D": []}
    whole, right, errors = [], dict.fromkeys((*spent, "locate"), 0), dict[str, list[Array]]()
    for turns in rng.uniform(-3.0, 3.0, (pictures, 3)):
        true = [on_table(BOX, x, y, yaw) for (x, y), yaw in zip(PLACES, turns, strict=True)]
        scene = together([shape("plane").moved(TABLE), *(BOX.moved(pose) for pose in true)])
        depth = sense(render(scene, eye)[0], eye, SENSOR, rng)
        answers: dict[str, list[Array]] = {}
        for name in spent:
            answers[name], took = frame(depth, eye, name == "Open3D")
            spent[name].append(took)
        begin = time.process_time()
        answers["locate"] = [one.pose for one in perception.locate(depth, eye, SENSOR, BOX)]
        whole.append(time.process_time() - begin)
        for name, poses in answers.items():
            for pose in true:
                near = [perception.pose_distance(BOX, pose, one) for one in poses]
                far = min(near, default=(np.inf, np.inf))
                # Right: within 2 mm and 2 degrees of a true box.
                right[name] += int(far[0] < 2e-3 and far[1] < math.radians(2.0))
                errors.setdefault(name, []).append(np.array(far))
    for name in spent:
        stage = 1e3 * np.median(spent[name], axis=0)
        panel.series.append(Series(name, places, [*stage, stage.sum()], name, ""))
    total = {name: 1e3 * np.median(np.sum(rows, axis=1)) for name, rows in spent.items()}
    total["locate"] = 1e3 * float(np.median(whole))
    panel.series.append(Series("locate", places[-1:], [total["locate"]], "locate", ""))
    for name, ms in total.items():
        mm, deg = np.median(errors[name], axis=0) * (1e3, 180.0 / math.pi)
        panel.notes.append(
            f"{name:<7} {ms:6.1f} ms, {right[name]} of {3 * pictures} right, "
            f"median {mm:.3f} mm, {deg:.3f} degrees"
        )
    for k, word in enumerate(STAGES):
        own, other = (1e3 * np.median(np.array(rows)[:, k]) for rows in spent.values())
        panel.notes.append(f"{word:<8} {own:6.2f} ms, Open3D {other:7.2f} ms")
    panel.notes.append(
        f"{eye.width} x {eye.height} pixels; Open3D's model has {model_points(0.004)} points, "
        "spaced like the grid of 4 mm"
    )
    panel.notes.append(
        f"Open3D's frame takes {total['Open3D'] / total['course']:.1f} times as long"
    )
    panel.footer = machine()
    yield panel


# --- Planes ---------------------------------------------------------------------------------------


@chart(columns=2)
def plane_precision(
    draws: Sequence[int] = (3, 10, 30, 100, 300),
    thin: Sequence[int] = (1024, 256, 64, 16, 4, 1),
    noises: Sequence[float] = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6),
    pictures: int = 40,
    repeats: int = 7,
) -> Iterator[Panel]:
    """Chart the table behind a box: its angle over what it costs, and how far off its middle is."""
    eye, rng = Camera.symmetric(320, 240, 1.0), np.random.default_rng(6)
    truth = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
    pose = on_table(BOX, 0.0, 0.0, 0.5)
    exact, ids = render(together([shape("plane").moved(TABLE), BOX.moved(pose)]), eye)
    table = ids == 0

    def observed(noise: float) -> tuple[Array, Array]:
        depth = sense(exact, eye, Sensor(SENSOR.baseline, noise), rng)
        return depth, perception.back_project(depth, eye)[0]

    looks = [observed(0.3) for _ in range(pictures)]
    tolerance = 4.0 * float(Sensor(SENSOR.baseline, 0.3).sigma(0.8, eye))
    # Only pixels of the table, for the fits that have no outliers to reject.
    masks = {n: table & (np.arange(table.size).reshape(table.shape) % n == 0) for n in thin}

    def ransac(view: tuple[Array, Array], n: int, refits: int) -> Array:
        return perception.ransac_plane(
            view[1], tolerance, rng, confidence=1.0, at_most=n, refits=refits
        )[0]

    def points(view: tuple[Array, Array], n: int) -> Array:
        cloud, _ = perception.back_project(np.where(masks[n], view[0], 0.0), eye)
        return perception.fit_plane(cloud)

    def inverse(view: tuple[Array, Array], n: int) -> Array:
        return perception.inverse_depth_plane(view[0], eye, masks[n])

    methods: dict[str, tuple[Callable[..., Array], list[tuple[int, ...]]]] = {
        "RANSAC": (ransac, [(n, 0) for n in draws]),
        "RANSAC, refit": (ransac, [(n, 1) for n in draws]),
        "SVD of points": (points, [(n,) for n in thin]),
        "inverse depth": (inverse, [(n,) for n in thin]),
    }
    panel = Panel(
        "Angle of the table, 320 x 240 px, noise 0.3 px",
        "processor time [ms]",
        "angle error [rad]",
        scale="log",
        ticks=(0.2, 0.5, 1, 2, 5),
        lines=[("y", 2e-3, "0.2 mm on 100 mm")],
    )
    # All settings of all methods in one set of interleaved rounds.
    samplers = [
        calls(method, looks[0], *setting, clock=time.process_time)
        for method, settings in methods.values()
        for setting in settings
    ]
    timings = interleaved(samplers, repeats=repeats, sample=2e-3)
    times = iter([1e3 * one.median for one in timings])
    for name, (method, settings) in methods.items():
        deviation = [
            float(
                np.sqrt(
                    np.mean(
                        [np.sum(np.cross(method(view, *one)[:3], truth) ** 2) for view in looks]
                    )
                )
            )
            for one in settings
        ]
        took = [next(times) for _ in settings]
        message = ", ".join(
            f"{1e3 * a:.2f} mrad {t:.2f} ms" for a, t in zip(deviation, took, strict=True)
        )
        panel.series.append(Series(name, took, deviation, name, note=f"{name}: {message}"))
    best = {series.label: series.y[-1] for series in panel.series}
    times_less = best["SVD of points"] / best["inverse depth"]
    panel.notes.append(f"the fit of inverse depth errs {times_less:.1f} times less than the SVD")
    panel.footer = machine(max(one.busy for one in timings))
    yield panel
    bias = Panel(
        "Systematic offset of the table", "noise of the disparity [px]", "mean offset [mm]"
    )
    result = {"SVD of points": points, "inverse depth": inverse}
    offs: dict[str, list[float]] = {name: [] for name in result}
    for noise in noises:
        some = [observed(noise) for _ in range(pictures)]
        for name, method in result.items():
            planes = [method(view, thin[-1]) for view in some]
            # A mean over many images: what remains is bias, not noise.
            offs[name].append(1e3 * float(np.mean([p[:3] @ TABLE[:3] + p[3] for p in planes])))
    for name, y in offs.items():
        message = ", ".join(f"{n:g} px {o:.3f} mm" for n, o in zip(noises, y, strict=True))
        bias.series.append(Series(name, noises, y, name, note=f"{name}, offset: {message}"))
    yield bias
