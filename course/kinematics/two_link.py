"""Two links in a plane, in closed form: the smallest arm whose joints disturb each other.

Uniform rods, viscous friction in the joints, a point mass as payload at the tip, and gravity along
-y where the plane stands upright. With q1 from the x axis, q2 from the first link, payload p and

    a = I1 + m1 l1^2 / 4 + (m2 + p) l1^2 + d,   d = I2 + m2 l2^2 / 4 + p l2^2,
    b = (m2 / 2 + p) l1 l2,   w1 = (m1 / 2 + m2 + p) l1,   w2 = (m2 / 2 + p) l2

about the rods' centres, the equations of motion are (Spong, Hutchinson and Vidyasagar, Robot
Modeling and Control, 2006, sec. 7.3; the sum of two angles is q12)

    [a + 2 b cos q2,  d + b cos q2] [q1'']   [tau1 - c1 q1' + b sin q2 q2' (2 q1' + q2') - G1]
    [d + b cos q2,    d           ] [q2''] = [tau2 - c2 q2' - b sin q2 q1'^2 - G2            ]

with G1 = g (w1 cos q1 + w2 cos q12) and G2 = g w2 cos q12. They are linear in a, b, d, c1, c2, w1
and w2: what one arm can tell of itself, and what an adaptive law has to learn.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, finite, invalid, vector
from course.kinematics.chain import Chain

Array = NDArray[np.float64]

# Rows of `TwoLink.column`, one column an arm.
LENGTHS, LIMITS, WEIGHTS, TORQUES = slice(5, 7), slice(7, 9), slice(9, 11), slice(11, 13)


@dataclass(frozen=True)
class TwoLink:
    """The arm's parameters, each pair for the two links or joints.

    Attributes:
        lengths, masses: of the links [m], uniform rods [kg].
        damping: viscous, of the joints [N m s/rad].
        torques: the motors' limits [N m]; who steps the arm applies them.
        payload: a point mass at the tip [kg].
        gravity: along -y [m/s^2]; 0 for a horizontal plane.
    """

    lengths: tuple[float, float] = (0.5, 0.4)
    masses: tuple[float, float] = (1.0, 0.8)
    damping: tuple[float, float] = (0.2, 0.2)
    torques: tuple[float, float] = (2.0, 1.0)
    payload: float = 0.0
    gravity: float = 0.0

    def __post_init__(self) -> None:
        vector("lengths", self.lengths, (2,), low=POSITIVE, unit="m")
        vector("masses", self.masses, (2,), low=POSITIVE, unit="kg")
        vector("damping", self.damping, (2,), low=0.0, unit="N m s/rad")
        vector("torques", self.torques, (2,), low=POSITIVE, unit="N m")
        finite("payload", self.payload, 0.0, unit="kg")
        finite("gravity", self.gravity, unit="m/s^2")

    @property
    def inertias(self) -> tuple[float, float]:
        """About each rod's centre [kg m^2]."""
        (m1, m2), (l1, l2) = self.masses, self.lengths
        return m1 * l1**2 / 12.0, m2 * l2**2 / 12.0

    @property
    def parameters(self) -> Array:
        """The parameters in which the equations are linear: a, b, d, c1, c2, shape (5,).

        Their units are kg m^2 and N m s/rad. In an upright plane w1 and w2 [kg m] follow, shape
        (7,).
        """
        (m1, m2), (l1, l2), (i1, i2), p = self.masses, self.lengths, self.inertias, self.payload
        # Steiner's theorem: each rod about its joint, with what the end of link 1 carries.
        d = i2 + 0.25 * m2 * l2**2 + p * l2**2
        a = i1 + 0.25 * m1 * l1**2 + m2 * l1**2 + p * l1**2 + d
        row = (a, 0.5 * m2 * l1 * l2 + p * l1 * l2, d, *self.damping)
        upright = ((0.5 * m1 + m2 + p) * l1, (0.5 * m2 + p) * l2) if self.gravity else ()
        return np.array(row + upright)

    def column(self) -> Array:
        """Return what `acceleration` reads, shape (13, 1).

        A, b, d, c1, c2, l1, l2, limits, then the weights g w1 and g w2, and at the end the two
        torques, which are 0 here.
        """
        weights = self.gravity * self.parameters[5:] if self.gravity else np.zeros(2)
        numbers = (*self.parameters[:5], *self.lengths, *self.torques, *weights, 0.0, 0.0)
        return np.array(numbers)[:, None]

    def chain(self) -> Chain:
        """Return the same arm as a `Chain`; hand `gravity=(0, -g, 0)` to its dynamics."""
        (m1, m2), (l1, l2), (i1, i2), p = self.masses, self.lengths, self.inertias, self.payload
        whole = m2 + p
        # Rod and payload as one body: common centre of mass, and the inertia about it (Steiner).
        middle = (0.5 * m2 + p) * l2 / whole
        across = i2 + m2 * (0.5 * l2 - middle) ** 2 + p * (l2 - middle) ** 2
        return Chain(
            parent=(-1, 0),
            placement=np.array([(0.0, 0, 0, 1, 0, 0, 0), (l1, 0, 0, 1, 0, 0, 0)]).T,
            mass=(m1, whole),
            centre=np.array([(0.5 * l1, 0.0, 0.0), (middle, 0.0, 0.0)]).T,
            # About its own axis no link turns: any share does.
            inertia=np.stack([np.diag((0.01 * i, i, i)) for i in (i1, across)], axis=2),
            damping=self.damping,
            tool=(l2, 0, 0, 1, 0, 0, 0),
        )

    def regressor(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, reference: ArrayLike | None = None
    ) -> Array:
        """Return the regressor Y with torque = Y @ parameters.

        Its shape is (2, 5) or (2, 5, N); in an upright plane it has 7 columns instead of 5.

        The arm's masses do not enter, so it may be asked of one whose masses nobody knows. With a
        reference velocity w it is that of M a + C(q, v) w + D w + G, where M' - 2 C is
        skew-symmetric: what the adaptive law of Slotine and Li (1987) needs.

        Args:
            q: angles, shape (2,) or (2, N) [rad].
            v: rates, same shape [rad/s].
            a: accelerations, same shape [rad/s^2].
            reference: w, same shape; default: v, which gives the torque of the motion.

        Raises:
            ValueError: for shapes that disagree or numbers that are not finite.
        """
        given = {"q": q, "v": v, "a": a, "reference": v if reference is None else reference}
        q, v, a, w = (_pair(name, value, q) for name, value in given.items())
        c, s = np.cos(q[1]), np.sin(q[1])
        result = np.zeros((2, 7 if self.gravity else 5) + q.shape[1:])
        result[0, 0] = a[0]
        # C(q, v) w has -b sin q2 (v2 w1 + (v1 + v2) w2) in its first row, b sin q2 v1 w1 below.
        result[0, 1] = c * (2.0 * a[0] + a[1]) - s * (v[1] * w[0] + (v[0] + v[1]) * w[1])
        result[1, 1] = c * a[0] + s * v[0] * w[0]
        result[0, 2], result[1, 2] = a[1], a[0] + a[1]
        result[0, 3], result[1, 4] = w[0], w[1]
        if self.gravity:
            result[0, 5] = self.gravity * np.cos(q[0])
            result[0, 6] = result[1, 6] = self.gravity * np.cos(q[0] + q[1])
        return result

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Return torques of a motion [N m], shape (2,) or (2, N); arguments as for `regressor`."""
        return np.asarray(np.einsum("ip...,p->i...", self.regressor(q, v, a), self.parameters))

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return torques of that motion without acceleration: M a + bias = torque; shape of q."""
        return self.inverse_dynamics(q, v, np.zeros(np.shape(q)))

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Return M, shape (2, 2) or (2, 2, N) [kg m^2]."""
        a, b, d = self.parameters[:3]
        c = np.cos(_pair("q", q, q)[1])
        return np.array([[a + 2.0 * b * c, d + b * c], [d + b * c, d + 0.0 * c]])


def _pair(name: str, value: ArrayLike, like: ArrayLike) -> Array:
    array = vector(name, value, (2,), (2, None))
    if array.shape != np.shape(like):
        raise invalid(f"{name}.shape", array.shape, f"that of q, {np.shape(like)}")
    return array


@register_jitable
def accelerations(q1, q2, v1, v2, arm, i):
    """Return joint accelerations (a1, a2) of column i of `arm`, see `acceleration`."""
    a, b, d = arm[0, i], arm[1, i], arm[2, i]
    c, s = np.cos(q2), np.sin(q2)
    # Torque less damping, with the centrifugal and Coriolis terms of the equations above.
    f1 = arm[11, i] - arm[3, i] * v1 + b * s * v2 * (2.0 * v1 + v2)
    f2 = arm[12, i] - arm[4, i] * v2 - b * s * v1 * v1
    # Most arms lie flat, and two cosines are a third of the cost.
    if arm[9, i] != 0.0 or arm[10, i] != 0.0:
        hanging = arm[10, i] * np.cos(q1 + q2)
        f1 -= arm[9, i] * np.cos(q1) + hanging
        f2 -= hanging
    # The 2 x 2 mass matrix is inverted in closed form; its determinant is positive.
    m11, m12 = a + 2.0 * b * c, d + b * c
    inverse = 1.0 / (m11 * d - m12 * m12)
    return (d * f1 - m12 * f2) * inverse, (m11 * f2 - m12 * f1) * inverse


@register_jitable
def acceleration(q, v, arm):
    """Return joint accelerations of N arms, shape (2, N) [rad/s^2]; to be called by compiled loops.

    q and v, (2, N), are angles [rad] and rates, `arm` (13, N) columns of `TwoLink.column`.
    """
    result = np.empty_like(v)
    for i in range(q.shape[1]):
        result[0, i], result[1, i] = accelerations(q[0, i], q[1, i], v[0, i], v[1, i], arm, i)
    return result


@register_jitable
def branches(l1, l2, x, y):
    """Return angles that put the tip at (x, y), or as near as it comes.

    q1 with the elbow to either side, the bend (q2, and -q2 for the other side), and how far the
    target is from the base [m, rad].

    tan^2(q2 / 2) = (far - r)(far + r) / ((r - near)(r + near)) at the distance r.
    """
    r, far, near = np.hypot(x, y), l1 + l2, abs(l1 - l2)
    # A target out of reach is replaced with the nearest one on the edge of the annulus.
    held = np.minimum(np.maximum(r, near), far)
    # The law of cosines in half angles: acos would lose half the digits near both edges.
    bend = 2.0 * np.arctan2(
        np.sqrt((far - held) * (far + held)), np.sqrt((held - near) * (held + near))
    )
    # The bend turns the line from base to tip away from link 1 by the angle `elbow`.
    elbow, heading = np.arctan2(l2 * np.sin(bend), l1 + l2 * np.cos(bend)), np.arctan2(y, x)
    return heading - elbow, heading + elbow, bend, r


class TwoLinkIK(NamedTuple):
    """Both answers to where the joints must be.

    Attributes:
        q: angles [rad], shape (2, 2) or (2, 2, N): joints along axis 0, then the branch, q2 from 0
            to pi first. Outside the annulus both point at the target as near as the arm can.
        reached: whether the target lies in the annulus |l1 - l2| <= r <= l1 + l2.
        distance: from the tip to the target [m]: how far it lies outside, or 0.
    """

    q: Array
    reached: Any
    distance: Any


def two_link_ik(lengths: ArrayLike, target: ArrayLike) -> TwoLinkIK:
    """Return joint angles that put the tip of two links at a point: both branches.

    By the tangent of half q2, as the usual arccosine loses half the digits near both edges of the
    annulus. At the centre of an arm with equal links q1 is that of a target at angle 0.

    Args:
        lengths: of the links, shape (2,), positive [m].
        target: of the tip, (x, y), shape (2,) or (2, N) [m].

    Raises:
        ValueError: for other shapes, lengths that are not positive, numbers that are not finite.
    """
    l1, l2 = vector("lengths", lengths, (2,), low=POSITIVE, unit="m")
    x, y = vector("target", target, (2,), (2, None), unit="m")
    left, right, bend, r = branches(l1, l2, x, y)
    # How far the target is outside the annulus, on either side of it.
    outside = np.maximum(np.maximum(r - (l1 + l2), abs(l1 - l2) - r), 0.0)
    q = np.array([[left, right], [bend, -bend]])
    return TwoLinkIK(q, (outside == 0.0)[()], outside[()])
