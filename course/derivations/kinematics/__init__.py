"""Claims of chapter 4: where an arm is, how it moves, and what its joints feel."""

from collections.abc import Sequence
from typing import Any

import numpy as np

Floats = Sequence[float] | np.ndarray

ARM = (1.0, 0.8)  # links of the usual listing [m]


def planar_tip(lengths: Floats, q: Floats) -> np.ndarray:
    """Return the tip of a planar arm by the course's kinematics, (2,) or (2, N) [m]."""
    from course.kinematics import planar, tip

    return tip(planar(lengths), q)[:2]


def planar_jacobian(lengths: Floats, q: Floats) -> np.ndarray:
    """Return the course's Jacobian of a planar arm's tip position, (2, n) or (2, n, N)."""
    from course.kinematics import jacobian, planar

    return jacobian(planar(lengths), q)[:2]


def two_links() -> tuple[Any, Any, Any]:
    """Return two links by algebra: lengths, angles, and the Jacobian of the tip's position."""
    import sympy

    l1, l2 = sympy.symbols("l1 l2", positive=True)
    q1, q2 = sympy.symbols("q1 q2", real=True)
    place = sympy.Matrix([l1 * f(q1) + l2 * f(q1 + q2) for f in (sympy.cos, sympy.sin)])
    return (l1, l2), (q1, q2), place.jacobian([q1, q2])


def panda_postures(rng: np.random.Generator, count: int) -> tuple[Any, np.ndarray]:
    """Return the 7-R arm and random postures within its limits, (7, count) [rad]."""
    from course.kinematics import panda

    arm = panda()
    return arm, rng.uniform(arm.lower, arm.upper, (count, 7)).T


def damped_inverse(J: np.ndarray, damping: float) -> np.ndarray:
    """Return J^T (J J^T + damping^2 I)^-1 of a batch (m, n, N), (N, n, m)."""
    stack = np.moveaxis(J, 2, 0)
    back = stack.transpose(0, 2, 1)
    return back @ np.linalg.inv(stack @ back + damping**2 * np.eye(J.shape[0]))
