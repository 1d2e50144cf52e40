"""mink: differential inverse kinematics as a quadratic program, on MuJoCo (Zakka, 2024)."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import bounds
from course.kinematics.chain import Chain
from course.libraries import import_error
from course.oracles.mujoco import chain as mujoco_chain

Array = NDArray[np.float64]


def library() -> ModuleType:
    """Return mink, or raise an ImportError that says how to install it."""
    try:
        import mink
    except ImportError as error:
        raise import_error("mink", "pip install 'mink>=1.3'", error) from error
    return mink


class Tracker:
    """An arm whose tip follows poses, with one quadratic program of mink's per cycle.

    Position and rotation have the cost 1, so that the objective is that of
    `course.kinematics.bounded_velocity`; the limits are those of `velocity_bounds`. The solver is
    DAQP, which mink installs.

    Args:
        chain: the arm; its joints in MuJoCo's order, as a serial arm's are.
        fastest: speed limits, a number or shape (n,) [rad/s or m/s].
        dt: length of a cycle [s].
        damping: as in `bounded_velocity`.
        gain: share of the distance to a position limit that a joint may cover in one cycle.

    Raises:
        ImportError: if mink is not installed.
    """

    def __init__(
        self, chain: Chain, fastest: ArrayLike, dt: float, damping: float, gain: float = 0.95
    ) -> None:
        self._library = mink = library()
        self._dt, self._damping = dt, damping**2
        model: Any = mujoco_chain.model(chain)
        self._configuration = mink.Configuration(model)
        self._task = mink.FrameTask("tip", "site", position_cost=1.0, orientation_cost=1.0)
        speeds = bounds("fastest", fastest, chain.n)
        self._limits = [
            mink.ConfigurationLimit(model, gain=gain),
            mink.VelocityLimit(model, {f"joint {i}": speeds[i] for i in range(chain.n)}),
        ]

    def velocity(self, q: Array, target: Array) -> Array:
        """Return the joint velocities of one cycle towards a pose.

        Args:
            q: posture, shape (n,).
            target: pose that the tip should have after the cycle, shape (7,).
        """
        self._configuration.update(q)
        rotation = self._library.SO3(target[3:])
        self._task.set_target(self._library.SE3.from_rotation_and_translation(rotation, target[:3]))
        return np.asarray(
            self._library.solve_ik(
                self._configuration,
                [self._task],
                self._dt,
                "daqp",
                damping=self._damping,
                limits=self._limits,
            )
        )
