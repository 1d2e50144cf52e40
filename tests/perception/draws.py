"""Cameras, scenes and poses for the tests of perception."""

import numpy as np

from course.perception import Camera, Shapes, shape, together
from course.rigid_body.quaternion import exp

SMALL = Camera.symmetric(80, 60, 1.0)
# A camera like that above a table: its picture is a quarter of 640 x 480, its focal length whole.
LONG = Camera(160, 120, 600.0, 600.0, 79.5, 59.5)


def turn(rng: np.random.Generator) -> np.ndarray:
    """Any rotation as a quaternion."""
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def at(x=0.0, y=0.0, z=0.0, turned=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose by its place and rotation vector."""
    return np.array([x, y, z, *exp(np.array(turned, dtype=float))])


def facing(z: float, tilt: float = 0.0) -> Shapes:
    """A plane across the camera's axis, seen from above, tilted about x."""
    return shape("plane", pose=at(0.0, 0.0, z, (np.pi + tilt, 0.0, 0.0)))


def scene(rng: np.random.Generator, n: int = 8) -> Shapes:
    """A tilted plane behind n shapes in any pose; some reach behind the camera."""
    kinds, sizes = ("box", "cylinder", "sphere"), {"box": 3, "cylinder": 2, "sphere": 1}
    shapes = [facing(1.5, rng.uniform(-0.5, 0.5))]
    for _ in range(n):
        kind = kinds[rng.integers(len(kinds))]
        pose = [*rng.uniform(-0.4, 0.4, 2), rng.uniform(0.1, 1.5), *turn(rng)]
        shapes.append(shape(kind, *rng.uniform(0.02, 0.2, sizes[kind]), pose=pose))
    return together(shapes)


def boxes(rng: np.random.Generator, n: int = 6) -> Shapes:
    """Boxes in any pose, well in front of the camera."""
    return together(
        [
            shape(
                "box", *rng.uniform(0.02, 0.2, 3), pose=[*rng.uniform(-0.4, 0.4, 2), z, *turn(rng)]
            )
            for z in rng.uniform(0.8, 1.5, n)
        ]
    )


def blobs(rng: np.random.Generator, n: int) -> np.ndarray:
    """Points in three blobs and some between, shape (3, n)."""
    points = (
        rng.normal(scale=0.02, size=(3, n))
        + 0.1 * np.array([-1.0, 0.0, 1.0])[rng.integers(0, 3, n)]
    )
    stray = rng.random(n) < 0.1
    points[:, stray] = rng.uniform(-0.2, 0.2, (3, stray.sum()))
    return points
