"""A camera on the hand finds a box: corners in the image, their depth, and a fit of the model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """What is there. Frames are 4 by 4 matrices that take points into the base.

    Attributes:
        box: frame of the box, its grasp point at the origin.
        hand: frame of the hand when the image is taken.
        moving: velocity of the hand in the base [m/s].
        corners: of the box in its frame, (3, n) [m].
        twin: how a view of the box may be taken for another one: a frame in that of the box.
    """

    box: Array
    hand: Array
    moving: Array
    corners: Array
    twin: Array


@dataclass(frozen=True)
class Stage:
    """What the perception stage takes for granted.

    Attributes:
        focal, middle: of the camera [pixels], the point in the middle of the image.
        gain, offset: of the depth: true = gain times measured plus offset [m].
        mount: frame of the camera in the hand.
        late: age of the hand's frame when it is used [s].
        model: corners of the box in the model's frame, (3, n) [m].
        marked: whether the texture tells the two ends of the box apart.
    """

    focal: float
    middle: Array
    gain: float
    offset: float
    mount: Array
    late: float
    model: Array
    marked: bool


@dataclass(frozen=True)
class Camera:
    """What the camera really is."""

    focal: float
    middle: Array
    gain: float
    offset: float
    mount: Array


def moved(frame: Array, points: Array) -> Array:
    """Return points, (3, n), in the frame's parent."""
    return frame[:3, :3] @ points + frame[:3, 3:]


def image(camera: Camera, scene: Scene) -> tuple[Array, Array]:
    """Return the pixels, (2, n), and measured depths [m], (n,), of the corners."""
    to_camera: Array = np.asarray(np.linalg.inv(scene.hand @ camera.mount), dtype=float)
    points = moved(to_camera, moved(scene.box, scene.corners))
    pixels = camera.focal * points[:2] / points[2] + camera.middle[:, None]
    return pixels, (points[2] - camera.offset) / camera.gain


def fit(model: Array, points: Array) -> tuple[Array, float]:
    """Return the frame that takes the model to the points, and the root mean square left."""
    a, b = (p - p.mean(axis=1, keepdims=True) for p in (model, points))
    U, _, Vt = np.linalg.svd(b @ a.T)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    frame = np.eye(4)
    frame[:3, :3] = R
    frame[:3, 3] = points.mean(axis=1) - R @ model.mean(axis=1)
    return frame, float(np.sqrt(np.mean(np.sum((moved(frame, model) - points) ** 2, axis=0))))


def estimate(stage: Stage, camera: Camera, scene: Scene) -> tuple[Array, float]:
    """Return the frame of the box in the base, as the stage reports it, and its residual [m]."""
    pixels, depth = image(camera, scene)
    z = stage.gain * depth + stage.offset
    rays = (pixels - stage.middle[:, None]) / stage.focal
    hand = scene.hand.copy()
    hand[:3, 3] -= stage.late * scene.moving
    points = moved(hand @ stage.mount, np.vstack((rays * z, z)))
    frame, residual = fit(stage.model, points)
    return (frame if stage.marked else frame @ scene.twin), residual
