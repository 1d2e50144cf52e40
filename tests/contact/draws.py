"""Shapes and poses for the tests of contact geometry."""

import numpy as np

from course import contact
from course.rigid_body.quaternion import exp, product

CUBE = contact.box([0.5, 0.5, 0.5])
CLOUD = np.random.default_rng(7).normal(size=(3, 12)) * 0.4
# One of each kind, of about the same size.
SHAPES = {
    "sphere": contact.sphere(0.4),
    "capsule": contact.capsule(0.25, 0.5),
    "box": contact.box([0.3, 0.4, 0.6]),
    "points": contact.points(CLOUD),
}


def at(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose by its place and rotation vector."""
    return np.array([x, y, z, *exp(np.array(turn, dtype=float))])


def poses(rng: np.random.Generator, n: int, spread: float = 1.0) -> np.ndarray:
    """Any rotation, places in a cube, shape (7, n)."""
    q = rng.normal(size=(4, n))
    return np.vstack((rng.uniform(-spread, spread, (3, n)), q / np.linalg.norm(q, axis=0)))


def turned(rng: np.random.Generator, pose: np.ndarray, angle: float) -> np.ndarray:
    """The poses, turned by about an angle about any axis."""
    u = angle * rng.normal(size=(3, pose.shape[1]))
    return np.vstack((pose[:3], product(exp(u), pose[3:])))
