"""Claims of chapter 7: what a picture tells, what a cloud keeps, and which poses are right."""

from typing import Any

import numpy as np


def image_of(
    part: Any, x: float, yaw: float, rng: np.random.Generator, tilt: float = 0.0
) -> tuple[Any, Any]:
    """Return the charts' picture of a part on their table, (H, W) [m], and the part's pose (7,).

    A box with a tilt [rad] about its x axis rests on its lower edge.
    """
    from course.charts.perception.poses import EYE, SENSOR, TABLE
    from course.kinematics.chain import compose
    from course.perception import render, sense, shape, together
    from course.rigid_body.quaternion import exp, product

    turn = product(exp(np.array([0.0, 0.0, yaw])), exp(np.array([tilt, 0.0, 0.0])))
    height = part.sizes[2, 0] * np.cos(tilt) + part.sizes[1, 0] * abs(np.sin(tilt))
    at = np.array([x, 0.0, height, *turn])
    pose = compose(TABLE[:, None], at[:, None])[:, 0]
    scene = together([shape("plane").moved(TABLE), part.moved(pose)])
    return sense(render(scene, EYE)[0], EYE, SENSOR, rng), pose


def walls(z: float, rng: np.random.Generator, count: int = 1, n: int = 140, **sensor: Any) -> Any:
    """Return what a sensor of f B = 30 m px makes of a wall: (count, n, n) [m]."""
    from course.perception import Camera, Sensor, sense

    eye = Camera(n, n, 600.0, 600.0, 0.5 * (n - 1), 0.5 * (n - 1))
    options: dict[str, Any] = {"baseline": 0.05, "noise": 0.1} | sensor
    kind = Sensor(**options)
    return np.array([sense(np.full((n, n), z), eye, kind, rng) for _ in range(count)])
