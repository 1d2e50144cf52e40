"""pink: differential inverse kinematics as a quadratic program, on Pinocchio (Caron, 2022)."""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import bounds
from course.kinematics.chain import Chain
from course.libraries import import_error
from course.oracles import pinocchio as adapter

Array = NDArray[np.float64]


def library() -> ModuleType:
    """Return pink, or raise an ImportError that says how to install it."""
    try:
        import pink.limits
    except ImportError as error:
        install = "pip install 'pin-pink>=4.4' 'daqp>=0.8'"
        raise import_error("pink", install, error) from error
    return pink


class Tracker:
    """An arm whose tip follows poses, with one quadratic program of pink's per cycle.

    Costs, limits and solver are those of `course.oracles.mink.Tracker`.

    Args:
        chain: the arm; its joints in Pinocchio's order, as a serial arm's are.
        fastest: speed limits, a number or shape (n,) [rad/s or m/s].
        dt: length of a cycle [s].
        damping: as in `bounded_velocity`.
        gain: share of the distance to a position limit that a joint may cover in one cycle.

    Raises:
        ImportError: if pink or Pinocchio is not installed.
    """

    def __init__(
        self, chain: Chain, fastest: ArrayLike, dt: float, damping: float, gain: float = 0.95
    ) -> None:
        pink, model = library(), adapter.model(chain)
        model.lowerPositionLimit, model.upperPositionLimit = chain.lower, chain.upper
        model.velocityLimit = bounds("fastest", fastest, chain.n)
        self._pink, self._pinocchio = pink, adapter._pinocchio()
        self._dt, self._damping = dt, damping**2
        self._configuration = pink.Configuration(model, model.createData(), np.zeros(chain.n))
        self._task = pink.FrameTask("tip", position_cost=1.0, orientation_cost=1.0)
        self._limits = [
            pink.limits.ConfigurationLimit(model, config_limit_gain=gain),
            pink.limits.VelocityLimit(model),
        ]

    def velocity(self, q: Array, target: Array) -> Array:
        """Return the joint velocities of one cycle towards a pose.

        Args:
            q: posture, shape (n,).
            target: pose that the tip should have after the cycle, shape (7,).
        """
        self._configuration.update(q)
        rotation = self._pinocchio.Quaternion(*target[3:]).matrix()
        self._task.set_target(self._pinocchio.SE3(rotation, target[:3]))
        return np.asarray(
            self._pink.solve_ik(
                self._configuration,
                [self._task],
                self._dt,
                "daqp",
                damping=self._damping,
                limits=self._limits,
                safety_break=False,
            )
        )
