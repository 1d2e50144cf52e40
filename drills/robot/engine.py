"""What the robot's loop computes with: plain NumPy in the sandbox, compiled code for known parts.

A learner's part runs in the sandbox's child process, which has NumPy and no file of the course.
`drills.robot.compiled` makes the engine for robots without a part of the learner's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drills.robot import cell as scene
from drills.robot.records import Array


def _squares(points: Array, model: Array) -> Array:
    """Return the squared distance of each point to each model point, shape (n, k) [m^2]."""
    near = np.sum(points**2, axis=0)[:, None] + np.sum(model**2, axis=0)
    return np.asarray(np.maximum(near - 2.0 * points.T @ model, 0.0))


def nearest(points: Array, model: Array) -> Array:
    """Return the model point nearest to each point, both (3, ...) [m]; shape of the points."""
    return np.asarray(model[:, _squares(points, model).argmin(axis=1)])


def on_a_face(points: Array, model: Array, faces: Array, crease: float) -> NDArray[np.bool_]:
    """Return which points clearly belong to one of the part's five faces.

    Args:
        points: shape (3, n) [m].
        model: points of the part, shape (3, k) [m].
        faces: number of the face of each model point, from 0, shape (k,).
        crease: by how much farther the second nearest face must be [m].
    """
    squares = _squares(points, model)
    each = np.sqrt(np.stack([squares[:, faces == face].min(axis=1) for face in range(5)]))
    each.sort(axis=0)
    return np.asarray(each[1] - each[0] > crease)


class Engine(NamedTuple):
    """Functions that the loop calls; all have a plain and a compiled form with the same arguments.

    Attributes:
        functions: known parts by the name of their slot; the others are loaded and checked.
        render: as `cell.render`.
        clearance: as `cell.clearance`.
        nearest, on_a_face: as above.
        drive: plays the ticks of a whole motion at once, see `compiled.drive`; None where each tick
            is a call of the control part and of the physics part.
    """

    functions: Mapping[str, Callable[..., Any]] = MappingProxyType({})
    render: Callable[..., Array] = scene.render
    clearance: Callable[..., Array] = scene.clearance
    nearest: Callable[[Array, Array], Array] = nearest
    on_a_face: Callable[[Array, Array, Array, float], NDArray[np.bool_]] = on_a_face
    drive: Callable[..., Any] | None = None


PLAIN = Engine()
