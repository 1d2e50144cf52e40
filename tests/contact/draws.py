"""Shapes and poses for the tests of contact geometry."""

import numpy as np

from course import contact
from course.charts.contact.geometry import kinds
from course.rigid_body.quaternion import exp, product

CUBE = contact.box([0.5, 0.5, 0.5])
SHAPES = kinds()  # one of each kind, of about the same size


def at(x=0.0, y=0.0, z=0.0, turn=(0.0, 0.0, 0.0)) -> np.ndarray:
    """A pose by its place and rotation vector."""
    return np.array([x, y, z, *exp(np.array(turn, dtype=float))])


def turned(rng: np.random.Generator, pose: np.ndarray, angle: float) -> np.ndarray:
    """The poses, turned by about an angle about any axis."""
    u = angle * rng.normal(size=(3, pose.shape[1]))
    return np.vstack((pose[:3], product(exp(u), pose[3:])))
