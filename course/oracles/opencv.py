"""OpenCV's hand-eye calibration: five published methods behind one call, `cv2.calibrateHandEye`."""

from __future__ import annotations

from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from course.check import one_of, vector
from course.libraries import import_error
from course.perception.camera import Array
from course.rigid_body.quaternion import to_matrix

METHODS = ("PARK", "HORAUD", "TSAI", "ANDREFF", "DANIILIDIS")
_INSTALL = "pip install 'opencv-python-headless>=4.11,<5'"


def library() -> ModuleType:
    """Return OpenCV.

    Raises:
        ImportError: it is not installed, or this version has no hand-eye calibration in Python, as
            5.0 (github.com/opencv/opencv/issues/29565); the message names what to install.
    """
    try:
        import cv2
    except ImportError as error:
        raise import_error("OpenCV", _INSTALL, error) from error
    if not hasattr(cv2, "calibrateHandEye"):
        raise ImportError(f"OpenCV {cv2.__version__} has no calibrateHandEye: {_INSTALL}")
    return cv2


class HandEye:
    """Poses of hand and target as OpenCV takes them, to be made before the clock starts.

    OpenCV computes the motions itself, between every two of the poses.

    Args:
        hand: poses of the hand in the base, shape (7, N).
        target: poses of the target in the camera's frame at the same moments, shape (7, N).

    Raises:
        ImportError: as for `library`.
    """

    def __init__(self, hand: ArrayLike, target: ArrayLike) -> None:
        self._library = library()
        self._poses: list[list[Array]] = []
        for name, poses in (("hand", hand), ("target", target)):
            q = vector(name, poses, (7, None))
            turns = np.ascontiguousarray(np.moveaxis(to_matrix(q[3:]), 2, 0))
            self._poses += [list(turns), [one.reshape(3, 1) for one in q[:3].T.copy()]]

    def solve(self, method: str) -> tuple[Array, Array]:
        """Return the camera's rotation and position in the hand, shapes (3, 3) and (3, 1).

        Args:
            method: one of `METHODS`.
        """
        which = getattr(self._library, f"CALIB_HAND_EYE_{one_of('method', method, METHODS)}")
        R, p = self._library.calibrateHandEye(*self._poses, method=which)
        return R, p
