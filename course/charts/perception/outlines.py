"""Chapter 7, the outline of a part: what it costs a fit, and what it buys."""

import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from course.charts import chart
from course.charts.perception.poses import BOX, SENSOR, turned_by
from course.charts.perception.precision import corner_error, methods, model_points
from course.kinematics.chain import compose
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import open3d
from course.perception import Camera, Fit, back_project, icp, render, sense, shape, together
from course.perception.camera import Array, numbers
from course.perception.outline import border, refine
from course.perception.pose import STANDING
from course.perception.registration import DIRECTIONS
from course.rigid_body.quaternion import exp

_TILTS = {"one face seen, from straight above": 0.0, "three faces seen, tilted": 0.6}
_GATE = (0.03, 0.006)  # greatest distance of a match, first and last [m]


def fit_points(points: Array, eye: Camera, start: Array, gate: float | tuple[float, float]) -> Fit:
    """Return a fit of x, y and the turn of the box to its points alone."""
    sigma = SENSOR.sigma(points[2], eye)
    return icp(points, BOX, start, gate=gate, sigma=sigma, free=STANDING)


def fit_both(
    points: Array, depth: Array, cluster: Array, eye: Camera, start: Array
) -> tuple[Array, float]:
    """Return the pose from points and outline as `locate` fits it, and its root mean square [px].

    Args:
        points: of the box, (3, N) [m].
        depth: the image that they come from, (H, W) [m].
        cluster: the box's pixels, (H, W).
        eye: the camera.
        start: pose (7,).
    """
    mobile, part = np.isin(DIRECTIONS, STANDING), numbers(BOX)
    at, pose, error, gate = border(depth, eye, SENSOR, cluster), start, 0.0, _GATE
    # Twice: points near an edge are chosen again once the edge is known.
    for _ in range(2):
        fit = fit_points(points, eye, pose, gate)
        weighted = fit.information / SENSOR.window**2
        pose, _, error = refine(part, fit.pose, mobile, weighted, eye, SENSOR, at)
        gate = (_GATE[1], _GATE[1])
    return pose, error


@chart(columns=2)
def outline_precision(
    widths: Sequence[int] = (80, 160, 320, 640, 1280), pictures: int = 40, repeats: int = 9
) -> Iterator[Panel]:
    """Chart error against time of a box's pose with and without its outline, by resolution.

    The box stands on a table 0.8 m away; its pixels are known. All methods start from one pose,
    8 mm and 3.4 degrees off. The course fits x, y and the turn; Open3D fits all six numbers to a
    cloud of the model's points, as far apart as the pixels (1 to 4 mm).

    Args:
        widths: of the images [pixels]; the field of view stays.
        pictures: of each width and view.
        repeats: rounds of the timer.
    """
    for name, tilt in _TILTS.items():
        table = np.array([0.0, 0.0, 0.8, *exp(np.array([math.pi - tilt, 0.0, 0.0]))])
        panel = Panel(
            f"{name[0].upper()}{name[1:]}",
            "processor time of a pose [s]",
            "error of a corner [m]",
            scale="log",
            lines=[("y", 2e-3, "tolerance 2 mm")],
        )
        samplers, errors = [], dict[str, list[float]]()
        for width in widths:
            eye, rng = Camera.symmetric(width, 3 * width // 4, 1.0), np.random.default_rng(8)
            # As far apart as the pixels on the table, but not closer than 1 mm: 63,000 points.
            spacing = min(0.004, max(0.001, 0.8 / eye.fx))
            _, by_open3d = methods(eye, model_points(spacing))["Open3D"]
            rows = dict[str, list[float]]()
            for k in range(pictures):
                x, y, yaw = rng.uniform((-0.03, -0.03, -3.0), (0.03, 0.03, 3.0))
                at = np.array([x, y, BOX.sizes[2, 0], *exp(np.array([0.0, 0.0, yaw]))])
                pose = compose(table[:, None], at[:, None])[:, 0]
                scene = together([shape("plane").moved(table), BOX.moved(pose)])
                exact, ids = render(scene, eye)
                depth, cluster = sense(exact, eye, SENSOR, rng), ids == 1
                points, _ = back_project(np.where(cluster, depth, 0.0), eye)
                start = turned_by(pose, 0.006, -0.005, 0.0, 0.0, 0.0, 0.06)
                cloud = open3d.Cloud(points)
                runs: dict[str, Callable[[], Array]] = {
                    "points": lambda p=points, e=eye, s=start: fit_points(p, e, s, _GATE).pose,
                    "points and outline": (
                        lambda p=points, z=depth, c=cluster, e=eye, s=start: fit_both(
                            p, z, c, e, s
                        )[0]
                    ),
                    "Open3D": lambda c=cloud, s=start, lay=by_open3d: np.asarray(lay(c, s)[2]),
                }
                for method, run in runs.items():
                    rows.setdefault(method, []).append(corner_error(run(), pose))
                    if not k:
                        samplers.append(calls(run, clock=time.process_time))
            for method, row in rows.items():
                errors.setdefault(method, []).append(float(np.sqrt(np.mean(np.square(row)))))
        timings = interleaved(samplers, repeats=repeats, sample=5e-3, warm_up=5e-3)
        for k, (method, y) in enumerate(errors.items()):
            took = [timings[k + len(errors) * i] for i in range(len(widths))]
            message = ", ".join(
                f"{width} px {1e3 * error:.3f} mm {1e3 * t.median:.3g} ms"
                for width, error, t in zip(widths, y, took, strict=True)
            )
            theirs = method == "Open3D"
            panel.series.append(
                Series(
                    method,
                    [t.median for t in took],
                    y,
                    method,
                    "--" if theirs else "-",
                    low=[t.low for t in took],
                    high=[t.high for t in took],
                    across=True,
                    hollow=theirs,
                    note=f"{name}, {method}: {message}",
                )
            )
        panel.footer = machine(max(t.busy for t in timings), libraries=("open3d",))
        yield panel
