"""A small network that says how an L-shaped part is turned: a start for ICP, not an answer.

It sees a patch of heights above the table, 24 x 24 cells around the part, and returns the cosine
and the sine of the part's turn. It is trained on rendered pictures with the sensor's own noise, in
half a minute on one core, so that it knows what these look like and nothing else: with other noise
or another part it may be wrong without any sign of it. The test `see_through` refutes most poses of
the mirrored part, but it does not notice errors of a few millimetres.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np

from course.check import count, vector
from course.kinematics.chain import compose, turn_to
from course.perception.camera import Array, Camera, Sensor, Shapes, render, sense, shape, together
from course.perception.cloud import back_project
from course.rigid_body.quaternion import conjugate, exp, rotate

SIDE, CELL = 24, 0.008  # of the patch [cells, m]
TALL = 0.04  # of the part [m]
L_PART = together(
    [
        shape("box", 0.06, 0.02, 0.5 * TALL),
        shape("box", 0.02, 0.03, 0.5 * TALL, pose=(-0.04, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0)),
    ]
)
_HIDDEN = (128, 48)
_LAYERS = (SIDE * SIDE, *_HIDDEN, 2)
WEIGHTS = sum((a + 1) * b for a, b in itertools.pairwise(_LAYERS))  # with a bias for each output

Network = Callable[[Array], Array]
"""Patches (n, SIDE, SIDE) -> turns about the table's normal (n,) [rad]."""


def above_table(depth: Array, camera: Camera, sensor: Sensor, table: Array) -> Array:
    """Return the points above a known table by more than its noise, (3, N) [m].

    They are in the camera's frame.

    Args:
        depth: shape (H, W) [m].
        camera: intrinsics of the image.
        sensor: noise of the depth.
        table: (nx, ny, nz, d), towards the camera.
    """
    points, _ = back_project(depth, camera)
    slope = np.abs(table[:3] @ points) / points[2]
    high = table[:3] @ points + table[3]
    return points[:, high > 4.0 * sensor.sigma(points[2], camera) * slope + 1e-3]


def height_patch(points: Array, table: Array) -> Array:
    """Return heights of a part's points above the table, over its part of the table: (SIDE, SIDE).

    The middle is that of a box along the table's axes; a cell without a point has height 0, the
    unit is that of the part.

    Args:
        points: shape (3, N) in the camera's frame [m].
        table: (nx, ny, nz, d), towards the camera.

    Raises:
        ValueError: for no point or a NaN.
    """
    given = vector("points", points, (3, None), unit="m")
    count("points.shape[1]", given.shape[1], 1)
    flat = rotate(conjugate(turn_to(table[:3])), given + table[3] * table[:3, None])
    # Percentiles, so that stray points do not move the patch.
    middle = np.percentile(flat[:2], (2.0, 98.0), axis=1).mean(axis=0)
    cells = np.floor((flat[:2] - middle[:, None]) / CELL).astype(int) + SIDE // 2
    inside = np.all((cells >= 0) & (cells < SIDE), axis=0)
    patch = np.zeros((SIDE, SIDE))
    # A cell's height is that of its highest point.
    np.maximum.at(patch, (*cells[:, inside],), np.clip(flat[2, inside] / TALL, 0.0, 1.5))
    return patch


def picture(
    camera: Camera, sensor: Sensor, table: Array, rng: np.random.Generator, part: Shapes = L_PART
) -> tuple[Array, Array]:
    """Return one part somewhere on the table: what the sensor gives (H, W) [m], and the pose (7,).

    Args:
        camera: intrinsics of the image.
        sensor: noise and resolution of the depth.
        table: pose (7,) of the table's frame, z up, in the camera's.
        rng: of place, turn and noise.
        part: whose frame is in the middle of its height.
    """
    yaw = np.array([0.0, 0.0, rng.uniform(-math.pi, math.pi)])
    at = [*rng.uniform(-0.12, 0.12, 2), 0.5 * TALL, *exp(yaw)]
    pose = compose(table[:, None], np.array(at)[:, None])[:, 0]
    exact, _ = render(together([shape("plane").moved(table), part.moved(pose)]), camera)
    return sense(exact, camera, sensor, rng), pose


def plane_of(table: Array) -> Array:
    """Return the plane (nx, ny, nz, d) of a table's pose (7,)."""
    normal = rotate(table[3:], np.array([0.0, 0.0, 1.0]))
    return np.append(normal, -normal @ table[:3])


def train(
    camera: Camera,
    sensor: Sensor,
    table: Array,
    *,
    pictures: int = 4000,
    steps: int = 1500,
    seed: int = 0,
) -> Network:
    """Train the network on `pictures` images, with `steps` steps of Adam of 256 patches each.

    The turn is about the axes that `turn_to` gives to the table's normal, as `locate` uses them.

    Args:
        camera: as for `picture`.
        sensor: as for `picture`.
        table: pose (7,) in the camera's frame.
        pictures: number of training images.
        steps: of the training.
        seed: of pictures and weights.
    """
    import torch

    count("pictures", pictures, 1)
    count("steps", steps, 1)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # two threads that share a busy core cost more than they win
    torch.manual_seed(seed)
    rng, plane = np.random.default_rng(seed), plane_of(table)
    patches, turns = np.zeros((pictures, SIDE, SIDE), np.float32), np.zeros(pictures)
    for k in range(pictures):
        depth, pose = picture(camera, sensor, table, rng)
        patches[k] = height_patch(above_table(depth, camera, sensor, plane), plane)
        turns[k] = turn_of(pose, plane)
    x = torch.tensor(patches.reshape(pictures, -1))
    # Cosine and sine are continuous, while the angle itself jumps at pi.
    y = torch.tensor(np.stack((np.cos(turns), np.sin(turns)), axis=1), dtype=torch.float32)
    wide, narrow = _HIDDEN
    net = torch.nn.Sequential(
        torch.nn.Linear(SIDE * SIDE, wide),
        torch.nn.SiLU(),
        torch.nn.Linear(wide, narrow),
        torch.nn.SiLU(),
        torch.nn.Linear(narrow, 2),
    )
    optimiser = torch.optim.Adam(net.parameters(), 2e-3)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for _ in range(steps):
        some = torch.randint(pictures, (256,))
        loss = ((net(x[some]) - y[some]) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        slower.step()
    torch.set_num_threads(threads)

    def turned(given: Array) -> Array:
        with torch.no_grad():
            flat = torch.tensor(np.asarray(given, np.float32).reshape(-1, SIDE * SIDE))
            c, s = np.asarray(net(flat), dtype=float).T
        return np.asarray(np.arctan2(s, c))

    return turned


def turn_of(pose: Array, plane: Array) -> float:
    """Return a standing part's turn about the table's normal, from the axes of `turn_to` [rad]."""
    x, y, _ = rotate(conjugate(turn_to(plane[:3])), rotate(pose[3:], np.array([1.0, 0.0, 0.0])))
    return math.atan2(y, x)
