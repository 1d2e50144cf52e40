"""Shapes and poses for the tests of contact geometry, from a generator."""

import numpy as np

from course import contact
from course.rigid_body.quaternion import exp, product

CLOUD = np.random.default_rng(7).normal(size=(3, 12)) * 0.4


def shapes() -> dict[str, contact.Shape]:
    """One of each kind, of about the same size."""
    return {
        "sphere": contact.sphere(0.4),
        "capsule": contact.capsule(0.25, 0.5),
        "box": contact.box([0.3, 0.4, 0.6]),
        "points": contact.points(CLOUD),
    }


def poses(rng: np.random.Generator, n: int, spread: float = 1.0) -> np.ndarray:
    """Any rotation, places in a cube, shape (7, n)."""
    q = rng.normal(size=(4, n))
    return np.vstack((rng.uniform(-spread, spread, (3, n)), q / np.linalg.norm(q, axis=0)))


def turned(rng: np.random.Generator, pose: np.ndarray, angle: float) -> np.ndarray:
    """The poses, turned by about an angle about any axis."""
    u = angle * rng.normal(size=(3, pose.shape[1]))
    return np.vstack((pose[:3], product(exp(u), pose[3:])))
