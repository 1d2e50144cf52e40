"""Chapter 7, poses: where ICP comes home, covariances that hold, silent errors, tracking."""

import functools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from course import perception
from course.charts import chart
from course.kinematics.chain import compose
from course.measure.figure import Panel, Series
from course.perception import Camera, Cloud, Sensor, Tracker, icp, render, sense, shape
from course.perception.camera import STILL, Array
from course.rigid_body.quaternion import conjugate, exp, log, product, rotate

EYE = Camera.symmetric(320, 240, 1.0)
SENSOR = Sensor(baseline=0.075, noise=0.05)
BOX = shape("box", 0.08, 0.05, 0.03)
TABLE = np.array([0.0, 0.0, 0.8, *exp(np.array([math.pi - 0.6, 0.0, 0.0]))])


def turned_by(pose: Array, *by: float) -> Array:
    """Return a pose shifted and turned in its own frame: x, y, z and a rotation vector."""
    q = np.concatenate((by[:3], exp(np.array(by[3:]))))
    return compose(pose[:, None], q[:, None])[:, 0]


def prism(sides: int, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return points and normals on the sides and the top of a prism 60 mm across and 60 mm high."""
    inner = 0.03 * math.cos(math.pi / sides)
    side = rng.integers(0, sides, count)
    angle = 2.0 * math.pi * side / sides
    along = rng.uniform(-1.0, 1.0, count) * inner * math.tan(math.pi / sides)
    top = rng.random(count) < 0.3
    # The root makes the points on the top uniform over its area.
    out = np.where(top, inner * np.sqrt(rng.random(count)), inner)
    along = np.where(top, along * out / inner, along)
    x, y = np.cos(angle), np.sin(angle)
    height = np.where(top, 0.03, rng.uniform(-0.03, 0.03, count))
    points = np.stack((out * x - along * y, out * y + along * x, height))
    return points, np.where(top, np.array([[0.0], [0.0], [1.0]]), np.stack((x, y, 0.0 * x)))


@chart(columns=2)
def icp_basin(turns: int = 31, points: int = 1200) -> Iterator[Panel]:
    """Chart how ICP, started too far off, ends in the next of a prism's equal poses.

    That happens once the prism is turned by more than half of its period.
    """
    rng, degrees = np.random.default_rng(0), np.linspace(0.0, 70.0, turns)
    home = Panel(
        "A start beyond 180 / n degrees ends in the next equal pose",
        "error of the starting turn [deg]",
        "error of the final turn [deg]",
        lines=[("x", 180.0 / n, f"180 / {n}") for n in (3, 4, 6)],
    )
    steps = Panel(
        "Point-to-point needs ten times the iterations",
        "error of the starting turn [deg]",
        "iterations",
        scale="log y",
    )
    for n in (3, 4, 6):
        target = Cloud.of(*prism(n, 4 * points, rng))
        observed, _ = prism(n, points, rng)
        end = []
        for angle in np.radians(degrees):
            fit = icp(observed, target, turned_by(STILL, 0, 0, 0, 0, 0, angle), iterations=200)
            end.append(math.degrees(math.atan2(fit.R[1, 0], fit.R[0, 0])))
        # The first turn from which ICP ends in another of the equal poses.
        edge = float(degrees[np.argmax(np.abs(end) > 90.0 / n)])
        message = f"{n} sides: starts of {edge:.1f} degrees and more do not reach the marked pose"
        home.series.append(Series(f"{n} sides", degrees, end, style="", note=message))
    pose = compose(TABLE[:, None], np.array([[0, 0, 0.03, 1, 0, 0, 0]]).T)[:, 0]
    pose = turned_by(pose, 0, 0, 0, 0, 0, 0.5)
    picture, _ = perception.back_project(render(BOX.moved(pose), EYE)[0], EYE)
    face = rng.choice(3, 4 * points, p=np.array([15, 24, 40]) / 79)
    normal = np.eye(3)[:, face] * rng.choice([-1.0, 1.0], face.size)
    inside = rng.uniform(-1.0, 1.0, (3, face.size)) * (normal == 0.0) + normal
    cloud = Cloud.of(BOX.sizes * inside, normal)
    targets: tuple[tuple[str, Cloud | perception.Shapes, str], ...] = (
        ("points", cloud, "point"),
        ("planes", cloud, "plane"),
        ("shape", BOX, "plane"),
    )
    for name, goal, method in targets:
        made = [
            icp(
                picture,
                goal,
                turned_by(pose, 0, 0, 0, 0, 0, math.radians(angle)),
                method=method,
                gate=0.05,
                iterations=300,
                tolerance=1e-6,
            ).iterations
            for angle in degrees[degrees < 40.0]
        ]
        message = f"{name}: {np.median(made):.0f} iterations (median)"
        steps.series.append(Series(name, degrees[degrees < 40.0], made, note=message))
    yield home
    yield steps


def laid_again(
    part: perception.Shapes, yaw: float, tilt: float, window: int, rays: bool, runs: int
) -> tuple[float, Array]:
    """Return the normalised squared error per known direction, and spread over prediction."""
    rng = np.random.default_rng(1)
    turn = product(exp(np.array([math.pi - tilt, 0.0, 0.0])), exp(np.array([0.0, 0.0, yaw])))
    pose = np.array([0.02 if yaw else 0.0, 0.03 if tilt else 0.0, 0.7, *turn])
    sensor = Sensor(baseline=0.075, noise=0.05, window=window)
    exact, _ = render(part.moved(pose), EYE)
    squares, errors, spread = [], [], []
    for _ in range(runs):
        points, _ = perception.back_project(sense(exact, EYE, sensor, rng), EYE)
        start = turned_by(pose, *(0.002 * rng.standard_normal(3)), *(0.02 * rng.standard_normal(3)))
        fit = icp(
            points, part, start, sigma=sensor.sigma(points[2], EYE), gate=(0.03, 0.01), rays=rays
        )
        back = conjugate(pose[3:])
        e = np.append(rotate(back, fit.p - pose[:3]), log(product(back, fit.pose[3:])))
        # Directions that the view leaves open have no finite variance.
        report = np.isfinite(np.diag(fit.covariance))
        C = fit.covariance[np.ix_(report, report)]
        # Normalised estimation error squared (NEES), by known direction: 1 if the covariance is
        # honest.
        squares.append(e[report] @ np.linalg.solve(C, e[report]) / report.sum())
        errors.append(np.where(report, e, np.nan) ** 2)
        spread.append(np.where(report, np.diag(fit.covariance), np.nan))
    retained = ~np.isnan(errors).all(axis=0)
    return float(np.mean(squares)), np.sqrt(
        np.nanmean(np.array(errors)[:, retained], 0) / np.nanmean(np.array(spread)[:, retained], 0)
    )


@chart(columns=2)
def pose_covariance(runs: int = 150) -> Iterator[Panel]:
    """Chart how honest a covariance is, with closest points and along the rays."""
    looks = {
        "three faces": (BOX, 0.5, 0.7),
        "two faces": (BOX, 0.0, 0.7),
        "one face": (BOX, 0.0, 0.0),
        "cylinder": (shape("cylinder", 0.04, 0.05), 0.5, 0.7),
        "sphere": (shape("sphere", 0.04), 0.5, 0.7),
    }
    places, words = list(range(len(looks))), tuple(looks)
    panel = Panel(
        "Squared error / predicted variance: 1 is honest",
        "what the camera sees",
        "ratio, mean over the observed directions",
        scale="log y",
        ticks=places,
        tick_names=words,
        xlim=(-0.4, len(looks) - 0.6),
        lines=[("y", 1.0, "honest")],
    )
    for name, rays in (("closest points", False), ("along the rays", True)):
        y = [laid_again(*view, 1, rays, runs)[0] for view in looks.values()]
        message = ", ".join(f"{what} {value:.2f}" for what, value in zip(looks, y, strict=True))
        panel.series.append(Series(name, places, y, style="", note=f"{name}: {message}"))
    yield panel
    windows = (1, 3, 5, 7)
    shared = Panel(
        "Shared noise: the spread grows with the window",
        "width of the matching window [pixels]",
        "spread of the pose / spread with independent pixels",
        theory="width of the window",
    )
    # Noise that is shared within a window: its effective number of pixels is smaller.
    ratios = np.array([laid_again(BOX, 0.5, 0.7, w, True, runs)[1] for w in windows])
    message = (
        f"window 7 px: spread {ratios[-1].min():.1f} to {ratios[-1].max():.1f} times that of "
        "independent noise, over the six directions"
    )
    shared.series.append(
        Series(
            "six directions",
            windows,
            ratios.mean(axis=1),
            low=ratios.min(axis=1),
            high=ratios.max(axis=1),
            theory=lambda w: 1.0 * np.asarray(w),
            note=message,
        )
    )
    yield shared


@chart(columns=2)
def silently_wrong(turns: int = 12) -> Iterator[Panel]:
    """Chart how residual, share of matches and see-through judge wrong poses."""
    rng = np.random.default_rng(2)
    result: dict[str, list[tuple[float, float, float]]] = {}
    for yaw in np.linspace(0.2, 2.9, turns):
        # A box in full view, one cut off by the image's edge, and depths that are 1 % too large.
        for name, x, scale in (
            ("right", 0.0, 1.0),
            ("cut off", 0.45, 1.0),
            ("scale 1 % off", 0.0, 1.01),
        ):
            at = np.array([x, 0.0, 0.03, *exp(np.array([0.0, 0.0, yaw]))])
            pose = compose(TABLE[:, None], at[:, None])[:, 0]
            scene = perception.together([shape("plane").moved(TABLE), BOX.moved(pose)])
            depth = scale * sense(render(scene, EYE)[0], EYE, SENSOR, rng)
            # The best pose, if any is found: its error, and the two values that are to judge it.
            for one in perception.locate(depth, EYE, SENSOR, BOX)[:1]:
                deviation = perception.pose_distance(BOX, pose, one.pose)[0]
                result.setdefault(name, []).append((deviation, one.residual, one.see_through))
            if name == "right":
                # A quarter turn: a wrong pose that fits the visible faces.
                wrong = turned_by(pose, 0, 0, 0, 0, 0, 0.5 * math.pi)
                points, _ = perception.back_project(render(BOX.moved(pose), EYE)[0], EYE)
                fit = icp(points, BOX, wrong, gate=0.03, free=("x", "y"))
                through = perception.see_through(depth, EYE, SENSOR, BOX.moved(fit.pose))
                turned = perception.pose_distance(BOX, pose, fit.pose)
                reach = float(np.hypot(turned[0], 0.08 * turned[1]))
                result.setdefault("quarter turn", []).append((reach, fit.residual, through))
    text = (
        (1, "The residual clearly reveals only the quarter turn", "residual [m]"),
        (2, "See-through also reveals some of the cut-off ones", "see-through share"),
    )
    for column, title, label in text:
        panel = Panel(
            title,
            "error [m]; of a turn: 80 mm times its angle",
            label,
            scale="log x",
            lines=[("y", 0.1, "refuted above")] if column == 2 else [],
        )
        for name, rows in result.items():
            far, value = np.array(rows)[:, 0], np.array(rows)[:, column]
            right = f"{np.count_nonzero(far < 2e-3)} of {far.size} within 2 mm"
            message = f"{label} {value.min():.4f} to {value.max():.4f}"
            distance = f"{1e3 * far.min():.2f} to {1e3 * far.max():.2f} mm off"
            message = f"{name}: {right}, {distance}, {message}"
            # The right ones among the cut-off parts lie on those of the other cases.
            hollow = name == "cut off"
            panel.series.append(Series(name, far, value, style="", hollow=hollow, note=message))
        yield panel


@chart(columns=2)
def tracking(runs: int = 400, speeds: Sequence[float] = (0.0, 0.02, 0.1)) -> Iterator[Panel]:
    """Chart how averages lag behind a part that moves, and a prediction over the age of a pose."""
    rng, sigma, period = np.random.default_rng(3), 1e-3, 1.0 / 30.0
    k = np.arange(1, 17)
    mean = Panel(
        "Averaging helps only a part that is (almost) at rest",
        "images averaged",
        "error [m]",
        scale="log y",
    )
    for speed in speeds:
        z = speed * period * np.arange(k[-1]) + sigma * rng.standard_normal((runs, k[-1]))
        # The truth at the last image, which an average lags behind.
        end = speed * period * (k[-1] - 1)
        error = [float(np.sqrt(np.mean((z[:, -n:].mean(axis=1) - end) ** 2))) for n in k]
        best = int(k[np.argmin(perception.averaged_error(k, sigma, period, speed))])
        mean.series.append(
            Series(
                f"{speed * 1e3:.0f} mm/s",
                k,
                error,
                theory=functools.partial(
                    perception.averaged_error, sigma=sigma, period=period, speed=speed
                ),
                note=f"{speed * 1e3:.0f} mm/s: smallest error with {best} images",
            )
        )
    yield mean
    ages = np.arange(0.0, 0.35, 0.05)
    late = Panel(
        "A moving part (about 150 mm/s): error against the age", "age of the pose [s]", "error [m]"
    )
    held: list[list[float]] = [[] for _ in ages]
    ahead: list[list[float]] = [[] for _ in ages]
    report: list[list[float]] = [[] for _ in ages]
    for _ in range(runs // 4):
        v, tracker, observed = (
            0.1 * rng.standard_normal(2),
            Tracker((0.05, 0.2), (0.1, 0.1)),
            np.zeros(3),
        )
        for i in range(30):
            observed = np.append(v * i * period, 0.0) + sigma * rng.standard_normal(3)
            tracker.update(i * period, observed, sigma**2 * np.eye(3))
        for j, age in enumerate(ages):
            x, P = tracker.predict(29 * period + age)
            true = v * (29 * period + age)
            held[j].append(float(np.sum((observed[:2] - true) ** 2)))
            ahead[j].append(float(np.sum((x[:2] - true) ** 2)))
            # The filter's own variance, beside its true error.
            report[j].append(float(P[0, 0] + P[1, 1]))
    for name, rows in (
        ("last pose", held),
        ("predicted", ahead),
        ("error that the filter expects", report),
    ):
        y = np.sqrt(np.mean(rows, axis=1))
        message = ", ".join(f"{1e3 * y[k]:.2f} mm at {ages[k]:.1f} s" for k in (2, -1))
        late.series.append(Series(name, ages, y, note=f"{name}: {message}"))
    yield late
