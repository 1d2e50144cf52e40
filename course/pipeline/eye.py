"""Perception with pictures: chapter 7's whole chain in the place of its two numbers.

A depth camera looks straight down on the table; arm and discs stand in the picture as they do in
the scene. For the question when the two numbers are enough, and for what a library sees instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import positive
from course.perception import STEREO, Camera, Sensor, Shapes, locate, render, sense, shape, together
from course.pipeline.scenario import Scenario, Settings
from course.pipeline.stages import FRAME, Sight

Array = NDArray[np.float64]
Find = Callable[[Array, Camera, Sensor, Shapes, Array], tuple[Array, Array]]

NOTHING = np.diag([np.inf, np.inf])  # covariance where nothing is seen
WIDE = Camera.symmetric(640, 480, math.radians(62.0))
THICK = 0.03  # half the height of a link, and how far it is above the discs [m]


def find(
    depth: Array, camera: Camera, sensor: Sensor, part: Shapes, table: Array
) -> tuple[Array, Array]:
    """Return the part's place in the picture's plane (2,) and its covariance (2, 2) [m, m^2]."""
    result = [
        one
        for one in locate(depth, camera, sensor, part, table=table, starts=1)
        if one.status == "found"
    ]
    if not result:
        return np.zeros(2), NOTHING
    # From the frame of the part to that of the camera.
    R = result[0].R[:2, :2]
    return result[0].p[:2], R @ result[0].covariance[:2, :2] @ R.T


@dataclass(frozen=True, eq=False)
class Eye:
    """A `perceive` for `Stages` that takes pictures.

    Attributes:
        camera, sensor: what takes them.
        height: of the camera over the table [m].
        middle: of the picture, in the frame of the base (2,) [m].
        radius: of the part, a ball on the table; seen from above, a flat top tells no place [m].
        picture: (shapes, camera) -> depth; a library's may take them instead.
        find: depth, camera, sensor, part, table -> place and covariance, likewise.
        bodies: whether arm and discs are in the picture.
    """

    camera: Camera = WIDE
    sensor: Sensor = STEREO
    height: float = 1.5
    middle: tuple[float, float] = (0.1, 0.4)
    radius: float = 0.05
    picture: Callable[[Shapes, Camera], Array] = lambda shapes, camera: render(shapes, camera)[0]
    find: Find = find
    bodies: bool = True

    def __post_init__(self) -> None:
        positive("height", self.height, unit="m")

    @property
    def table(self) -> Array:
        """The plane of the table, towards the camera, as `locate` takes it."""
        return np.array([0.0, 0.0, -1.0, self.height])

    def _pose(self, x: float, y: float, z: float, turn: float) -> Array:
        """Return a pose in the camera's frame.

        The camera's x is the base's; its y and z are turned round.
        """
        (u, v), half = self.middle, 0.5 * turn
        place = (x - u, v - y, self.height - z)
        # A half turn about an axis in the image plane: the camera looks down, and the part is
        # turned.
        return np.array([*place, 0.0, math.cos(half), -math.sin(half), 0.0])

    def shapes(self, target: Array, q: Array, scenario: Scenario) -> Shapes:
        """Return what stands before the camera."""
        low, (l1, l2) = 0.06, scenario.arm.lengths  # height of the discs, over which the arm moves
        other = [
            shape("plane", pose=self._pose(0.0, 0.0, 0.0, 0.0)),
            shape("sphere", self.radius, pose=self._pose(target[0], target[1], self.radius, 0.0)),
        ]
        if self.bodies:
            other += [
                shape("cylinder", r, 0.5 * low, pose=self._pose(x, y, 0.5 * low, 0.0))
                for x, y, r in scenario.discs
            ]
            x, y, angle, at = 0.0, 0.0, 0.0, low + 2.0 * THICK
            for length, turn in ((l1, q[0]), (l2, q[1])):
                angle += turn
                u, v = 0.5 * length * math.cos(angle), 0.5 * length * math.sin(angle)
                link = self._pose(x + u, y + v, at, angle)
                other.append(shape("box", 0.5 * length, scenario.radius, THICK, pose=link))
                x, y = x + 2.0 * u, y + 2.0 * v
        return together(other)

    def __call__(
        self, sight: Sight, scenario: Scenario, settings: Settings
    ) -> tuple[Array, Array, str, int]:
        """Return what `perceive` returns, from a rendered depth image.

        The noise is the sensor's, so that of the settings has no part in it.
        """
        exact = self.picture(self.shapes(sight.target, sight.q, scenario), self.camera)
        # The bits of the frame's normal numbers are the seed, so that each frame has its own noise.
        rng = np.random.default_rng(sight.draws.view(np.uint64).tolist())
        depth = sense(exact, self.camera, self.sensor, rng)
        part = shape("sphere", self.radius)
        place, covariance = self.find(depth, self.camera, self.sensor, part, self.table)
        # The image's y runs against the base's, so the mixed terms change their sign.
        turned = np.array([[1.0, -1.0], [-1.0, 1.0]])
        x, y = self.middle
        return np.array([x + place[0], y - place[1]]), turned * covariance, FRAME, sight.captured
