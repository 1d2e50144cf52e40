"""A camera on the hand locates a box: corners in the image, their depth, and a fit of the model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """The true scene. Frames are 4 by 4 matrices that transform points into the base frame.

    Attributes:
        box: frame of the box, its grasp point at the origin.
        hand: frame of the hand when the image is taken.
        moving: velocity of the hand in the base [m/s].
        corners: of the box in its frame, (3, n) [m].
        twin: pose, in the frame of the box, that looks the same to the camera as the true pose.
    """

    box: Array
    hand: Array
    moving: Array
    corners: Array
    twin: Array


@dataclass(frozen=True)
class Stage:
    """The parameters that the perception stage assumes.

    Attributes:
        focal, middle: focal length and principal point of the camera [pixels].
        gain, offset: of the depth: true depth = gain * measured depth + offset [m].
        mount: frame of the camera in the hand.
        late: age of the hand's frame when it is used [s].
        model: corners of the box in the model's frame, (3, n) [m].
        marked: whether the texture distinguishes the two ends of the box.
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
    """The true parameters of the camera, named as in `Stage`."""

    focal: float
    middle: Array
    gain: float
    offset: float
    mount: Array


def moved(frame: Array, points: Array) -> Array:
    """Transform points, (3, n), into the parent of the frame."""
    return frame[:3, :3] @ points + frame[:3, 3:]


def image(camera: Camera, scene: Scene) -> tuple[Array, Array]:
    """Return the pixels, (2, n), and measured depths [m], (n,), of the corners."""
    to_camera: Array = np.asarray(np.linalg.inv(scene.hand @ camera.mount), dtype=float)
    points = moved(to_camera, moved(scene.box, scene.corners))
    pixels = camera.focal * points[:2] / points[2] + camera.middle[:, None]
    return pixels, (points[2] - camera.offset) / camera.gain


def fit(model: Array, points: Array) -> tuple[Array, float]:
    """Return the frame that maps the model onto the points, and the root mean square residual."""
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
