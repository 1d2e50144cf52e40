"""Chapter 7, the frontier: a network's start for ICP beside one, four and eight starts."""

import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from course.charts import chart
from course.charts.perception.poses import EYE, SENSOR, TABLE
from course.kinematics.chain import turn_to
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.perception import Sensor, icp, pose_distance, see_through, shape, together, yaw_net
from course.perception.camera import Array
from course.perception.pose import STANDING, standing_at, verdict
from course.rigid_body.quaternion import conjugate, rotate

# What the network has not seen: the same part seen in a mirror.
MIRRORED = together(
    [
        shape("box", 0.06, 0.02, 0.02),
        shape("box", 0.02, 0.03, 0.02, pose=(0.04, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0)),
    ]
)

# The kinds of starts, as short as they stand beside the points of the chart.
SHORT = {
    "1 start": "1",
    "4 starts": "4",
    "8 starts": "8",
    "principal axis": "axis",
    "network": "network",
}

Ways = dict[str, Callable[[Array], Array]]
"""Points (3, N) -> turns to start from (n,) [rad]."""


def methods(network: yaw_net.Network, rng: np.random.Generator) -> Ways:
    """Return even starts, the principal axis, and the network's turn."""
    plane = yaw_net.plane_of(TABLE)

    def axis(points: Array) -> Array:
        flat = rotate(conjugate(turn_to(plane[:3])), points)[:2]
        along = np.linalg.eigh(np.cov(flat))[1][:, 1]
        return np.array([math.atan2(along[1], along[0])])

    def even(n: int) -> Callable[[Array], Array]:
        return lambda points: rng.uniform(0.0, 7.0) + np.arange(0.0, 6.28, 2.0 * math.pi / n)

    return {
        "1 start": even(1),
        "4 starts": even(4),
        "8 starts": even(8),
        "principal axis": axis,
        "network": lambda points: network(yaw_net.height_patch(points, plane)[None]),
    }


def laid(
    depth: Array, sensor: Sensor, path: Callable[[Array], Array]
) -> tuple[Array, float, float]:
    """Return the best pose, the time from the image on [s], and the result of `see_through`."""
    begin, plane = time.process_time(), yaw_net.plane_of(TABLE)
    points = yaw_net.above_table(depth, EYE, sensor, plane)
    some = np.ascontiguousarray(points[:, :: max(1, points.shape[1] // 400)])
    sigma, best = sensor.sigma(some[2], EYE), (-1.0, np.zeros(7))
    last = 4.0 * float(np.median(sigma)) + 1e-3
    cluster = np.zeros(depth.shape, bool)
    u, v = np.rint(EYE.project(points)).astype(int)
    cluster[v, u] = True
    for start in standing_at(yaw_net.L_PART, points, plane, path(points)):
        fit = icp(
            some,
            yaw_net.L_PART,
            start,
            gate=(max(last, 0.04), last),
            sigma=sigma,
            free=STANDING,
            rays=False,
            tolerance=1e-5,
        )
        score = verdict(depth, EYE, sensor, yaw_net.L_PART.moved(fit.pose), cluster)[2]
        best = max(best, (float(score), fit.pose), key=lambda one: one[0])
    spent = time.process_time() - begin
    return best[1], spent, see_through(depth, EYE, sensor, yaw_net.L_PART.moved(best[1]))


@chart(columns=2)
def learned_start(
    pictures: int = 100,
    training: int = 4000,
    steps: int = 1500,
    noises: Sequence[float] = (1.0, 3.75),
) -> Iterator[Panel]:
    """Chart how often ICP ends right, and what it takes; what tells a wrong end."""
    rng = np.random.default_rng(11)
    begin = time.process_time()
    network = yaw_net.train(EYE, SENSOR, TABLE, pictures=training, steps=steps)
    spent = time.process_time() - begin
    plane, known = yaw_net.plane_of(TABLE), methods(network, rng)
    trade = Panel(
        "Right poses and time, by the kind of start",
        "processor time [ms]",
        "share within 2 mm and 2 degrees",
    )
    shows = Panel(
        "What see-through says about the poses",
        "error of the turn [deg]",
        "see-through share",
        scale="log x",
        lines=[("y", 0.1, "refuted above")],
    )
    trade.notes.append(f"{training} pictures, {steps} steps: trained in {spent:.0f} s")
    for noise in noises:
        sensor = Sensor(SENSOR.baseline, noise * SENSOR.noise)
        share, took, starts = [], [], []
        looks = [yaw_net.picture(EYE, sensor, TABLE, rng) for _ in range(pictures)]
        for name, method in known.items():
            rows = []
            for depth, pose in looks:
                result, seconds, through = laid(depth, sensor, method)
                far, turn = pose_distance(yaw_net.L_PART, pose, result)
                rows.append((far < 2e-3 and turn < math.radians(2.0), seconds, through, turn))
            right, seconds, through, turn = np.array(rows).T
            share.append(float(right.mean()))
            took.append(1e3 * float(np.median(seconds)))
            wrong = through[right == 0]
            observed = f", see-through notices {np.sum(wrong > 0.1)} of {wrong.size} wrong"
            trade.notes.append(
                f"noise x {noise:g}, {name}: {share[-1]:.2f} right, "
                f"{took[-1]:.1f} ms{observed if wrong.size else ''}"
            )
        report = turn, through  # of the last, the network
        trade.series.append(
            Series(
                f"noise x {noise:g}",
                took,
                share,
                style="",
                tags=tuple(SHORT[name] for name in known),
            )
        )
        for depth, pose in looks:
            points = yaw_net.above_table(depth, EYE, sensor, plane)
            text = network(yaw_net.height_patch(points, plane)[None])[0]
            deviation = text - yaw_net.turn_of(pose, plane)
            starts.append(abs(math.remainder(deviation, 2.0 * math.pi)))
        deg = np.degrees(starts)
        shows.notes.append(
            f"noise x {noise:g}: the network's turn is {np.median(deg):.2f} degrees "
            f"off (median), {deg.max():.1f} at most"
        )
        shows.series.append(
            Series(f"noise x {noise:g}", np.degrees(report[0]), report[1], style="")
        )
    trade.footer = machine()
    yield trade
    other = []
    for _ in range(pictures):
        depth, pose = yaw_net.picture(EYE, SENSOR, TABLE, rng, MIRRORED)
        result, _, through = laid(depth, SENSOR, known["network"])
        other.append((math.degrees(pose_distance(yaw_net.L_PART, pose, result)[1]), through))
    x, y = np.array(other).T
    shows.notes.append(f"a mirrored part: refuted in {np.mean(y > 0.1):.2f} of the pictures")
    shows.series.append(Series("mirrored part", x, y, style=""))
    yield shows
