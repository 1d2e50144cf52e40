"""Pinocchio asked for the kinematics of a planar chain.

The model is built joint by joint, each turning about z and placed at the end of the link before it;
the tip is a frame at the end of the last link. Building it is not part of what one would time: make
the chain once, then ask it for positions.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import refused, vector

Array = NDArray[np.float64]


def _pinocchio() -> ModuleType:
    try:
        import pinocchio
    except ImportError as error:
        raise ImportError("this needs Pinocchio: pip install 'pin>=4.0'") from error
    return pinocchio


class PlanarChain:
    """A planar arm of revolute joints about z, of given link lengths.

    Args:
        lengths: link lengths, shape (n,) [m], n at least 1.

    Raises:
        ValueError: if lengths is not a row of finite numbers.
        ImportError: if Pinocchio is not installed.
    """

    def __init__(self, lengths: ArrayLike) -> None:
        pinocchio = _pinocchio()
        lengths = vector("lengths", lengths, (None,))
        if not lengths.size:
            raise refused("lengths", lengths, "one or more finite numbers")
        self.model = pinocchio.Model()
        joint, place = 0, pinocchio.SE3.Identity()
        for i, length in enumerate(lengths):
            joint = self.model.addJoint(joint, pinocchio.JointModelRZ(), place, f"joint {i}")
            place = pinocchio.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        tip = pinocchio.Frame("tip", joint, place, pinocchio.FrameType.OP_FRAME)
        self._tip = self.model.addFrame(tip)
        self._data = self.model.createData()
        self._update = pinocchio.framesForwardKinematics

    def positions(self, thetas: ArrayLike) -> Array:
        """Where the joints and the tip are.

        Args:
            thetas: joint angles, shape (n,) [rad], each relative to the link before it.

        Returns:
            Positions (x, y) of the n joints, the base first, and of the tip, shape (n + 1, 2) [m].

        Raises:
            ValueError: if there is not one angle for each joint.
        """
        thetas = vector("thetas", thetas, (self.model.nq,))
        self._update(self.model, self._data, thetas)
        joints = [self._data.oMi[i].translation for i in range(1, self.model.njoints)]
        return np.array([*joints, self._data.oMf[self._tip].translation])[:, :2]
