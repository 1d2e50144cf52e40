"""Chapter 7: a pose without a start, by features and by many starts; where each of them fails."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from course.charts import chart
from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE
from course.kinematics.chain import compose, invert
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles import open3d
from course.perception import locate, pose_distance, render, sense, shape, together, yaw_net
from course.perception.camera import Array, Shapes
from course.rigid_body.quaternion import rotate

SCENES = {
    "standing": "an L, standing",
    "any turn": "an L, held anyhow",
    "hidden": "an L, partly hidden",
    "box": "a box",
}
FLAT = 0.012  # radius for normals [m]; of several that were tried, the most poses were right
WAYS = {"ransac": "FPFH, RANSAC", "fast": "FPFH, fast global"}


def surface(part: Shapes, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return points and outward normals on the boxes of a part, without what is inside: (3, n)."""
    areas = [float(np.prod(s) * np.sum(1.0 / s)) for s in part.sizes.T]
    points, normals = [], []
    for size, pose, area in zip(part.sizes.T, part.poses.T, areas, strict=True):
        n = round(count * area / sum(areas))
        face = rng.choice(3, n, p=(np.prod(size) / size) / area)
        normal = np.eye(3)[:, face] * rng.choice([-1.0, 1.0], n)
        at = size[:, None] * (rng.uniform(-1.0, 1.0, (3, n)) * (normal == 0.0) + normal)
        points.append(rotate(pose[3:], at) + pose[:3, None])
        normals.append(rotate(pose[3:], normal))
    every, outward = np.hstack(points), np.hstack(normals)
    # A point in or on another box of the part is not seen from outside.
    owner = np.repeat(np.arange(len(points)), [one.shape[1] for one in points])
    outside = np.ones(owner.size, bool)
    for k, (size, pose) in enumerate(zip(part.sizes.T, part.poses.T, strict=True)):
        back = np.concatenate((-pose[:3], pose[3:]))
        local = rotate(back[3:] * np.array([1.0, -1.0, -1.0, -1.0]), every - pose[:3, None])
        outside &= (owner == k) | np.any(np.abs(local) > size[:, None] + 1e-9, axis=0)
    return every[:, outside], outward[:, outside]


def scene(name: str, rng: np.random.Generator) -> tuple[Shapes, Array, Array]:
    """Return a part, its pose (7,) and a depth image (H, W) [m] of it above the table."""
    part = BOX if name == "box" else yaw_net.L_PART
    if name == "any turn":
        q = rng.standard_normal(4)
        local = np.array([*rng.uniform(-0.1, 0.1, 2), 0.12, *(q / np.linalg.norm(q))])
    else:
        yaw = 0.5 * rng.uniform(-math.pi, math.pi)
        height = float(part.sizes[2, 0])
        spin = [math.cos(yaw), 0.0, 0.0, math.sin(yaw)]
        local = np.array([*rng.uniform(-0.1, 0.1, 2), height, *spin])
    pose = compose(TABLE[:, None], local[:, None])[:, 0]
    shapes = [shape("plane").moved(TABLE), part.moved(pose)]
    exact, ids = render(together(shapes), EYE)
    depth = sense(exact, EYE, SENSOR, rng)
    if name == "hidden":
        # What is beyond a line through the part is not measured, as behind an edge.
        v, u = np.nonzero(ids > 0)
        angle = rng.uniform(0.0, 2.0 * math.pi)
        along = math.cos(angle) * u + math.sin(angle) * v
        hidden = along > np.quantile(along, 0.65)
        depth[v[hidden], u[hidden]] = 0.0
    return part, pose, depth


@chart(columns=2)
def global_registration(
    pictures: int = 20,
    voxels: Sequence[float] = (0.004, 0.005, 0.007, 0.01),
    starts: Sequence[int] = (1, 4),
) -> Iterator[Panel]:
    """Chart poses without a start: features by Open3D beside the starts of `locate`.

    Both get the same image and the table's plane. Open3D gets the points above it as a cloud, made
    before the clock starts, and the model's features, which do not change; its answer is refined
    by point-to-plane ICP on the same grid, as `locate` refines its own.

    Args:
        pictures: of each scene.
        voxels: sizes of Open3D's grid [m].
        starts: of `locate`, in turn; the part that is held anyhow takes 24 orientations at least.
    """
    plane = yaw_net.plane_of(TABLE)
    models = {}
    for name, part in (("L", yaw_net.L_PART), ("box", BOX)):
        points, normals = surface(part, 30_000, np.random.default_rng(0))
        whole = open3d.Cloud(points)
        whole.set_normals(normals)
        models[name] = {v: open3d.Features.of(whole, v) for v in voxels}

    def by_features(cloud: open3d.Cloud, name: str, v: float, method: str) -> Array:
        target = models["box" if name == "box" else "L"][v]
        image = open3d.Features.of(cloud, v, np.zeros(3), FLAT)
        fit = open3d.register_features(image, target, method)
        for gate in (0.01, 0.004):
            fit = image.cloud.icp(target.cloud, fit.pose, gate, 30, True, 1e-6)
        return invert(fit.pose[:, None])[:, 0]

    def ours(depth: Array, part: Shapes, name: str, n: int) -> Array | None:
        standing = name != "any turn"
        answers = locate(depth, EYE, SENSOR, part, table=plane, standing=standing, starts=n)
        return answers[0].pose if answers else None

    rows: dict[tuple[str, str, float], list[tuple[float, float, bool]]] = {}
    for name in SCENES:
        rng = np.random.default_rng(20)
        for k in range(pictures):
            part, pose, depth = scene(name, rng)
            cloud = open3d.Cloud(yaw_net.above_table(depth, EYE, SENSOR, plane))
            calls: list[tuple[str, float, Callable[[], Array | None]]] = [
                ("locate", n, partial(ours, depth, part, name, n)) for n in starts
            ]
            calls += [
                (WAYS[method], v, partial(by_features, cloud, name, v, method))
                for method in WAYS
                for v in voxels
            ]
            # In turn on each image, so that a disturbance meets all of them.
            for label, size, call in calls:
                if k == 0:
                    call()  # compiles, and loads the library
                begin = time.process_time()
                result = call()
                spent = time.process_time() - begin
                far, turn = (math.inf, math.inf)
                if result is not None:
                    far, turn = pose_distance(part, pose, result)
                error = far + 0.05 * turn  # of a point 50 mm from the origin, at most
                right = far < 2e-3 and turn < math.radians(2.0)
                rows.setdefault((name, label, size), []).append((spent, error, right))
    labels = ("locate", *WAYS.values())
    sizes = {"locate": tuple(starts)} | dict.fromkeys(WAYS.values(), tuple(voxels))
    best: dict[tuple[str, str], float] = {}
    for name, title in SCENES.items():
        panel = Panel(
            f"Median error, {title}",
            "processor time of a pose [s]",
            "error of a point at 50 mm [m]",
            scale="log",
            lines=[("y", 2e-3, "2 mm")],
            footer=machine(libraries=("open3d",)),
        )
        for label in labels:
            made = [np.array(rows[name, label, size], dtype=float) for size in sizes[label]]
            shares = [float(one[:, 2].mean()) for one in made]
            best[name, label] = max(shares)
            settings = ", ".join(
                f"{f'{size:g} starts' if label == 'locate' else f'{1e3 * size:g} mm'}: "
                f"{share:.2f} right, {1e3 * np.median(one[:, 0]):.0f} ms, "
                f"{1e3 * np.median(one[:, 1]):.2f} mm"
                for size, one, share in zip(sizes[label], made, shares, strict=True)
            )
            panel.series.append(
                Series(
                    label,
                    [float(np.median(one[:, 0])) for one in made],
                    [float(np.median(one[:, 1])) for one in made],
                    style="-" if label == "locate" else "--",
                    hollow=label != "locate",
                    note=f"{name}, {label}: {settings}",
                )
            )
        yield panel
