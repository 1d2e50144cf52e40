"""IMU samples between two images, combined once: relative increments that need no start state.

The increments of rotation, velocity and position are in the axes of the first image. Gravity, the
start pose and the start velocity enter only afterwards (Lupton and Sukkarieh, 2012). The Jacobians
by the biases are integrated along, so that a change of the biases is corrected to first order
(Forster, Carlone, Dellaert and Scaramuzza, On-manifold preintegration, 2017).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, positive, vector
from course.rigid_body import quaternion

Array = NDArray[np.float64]


class Increments(NamedTuple):
    """What an IMU measured between two images, in the axes of the first.

    Attributes:
        rotation: unit quaternion (w, x, y, z), from the last axes to the first, shape (4,).
        velocity: integral of the specific force [m/s], shape (3,).
        position: integral of that [m], shape (3,).
        seconds: from the first image to the last.
        jacobian: of rotation vector, velocity and position (rows, three each) by the biases of
            gyroscope and accelerometer (columns, three each), shape (9, 6).
    """

    rotation: Array
    velocity: Array
    position: Array
    seconds: float
    jacobian: Array

    def corrected(self, gyro_change: ArrayLike, force_change: ArrayLike) -> Increments:
        """Return the increments for changed biases, to first order; the Jacobian stays.

        Args:
            gyro_change: of the gyroscope's bias, shape (3,) [rad/s].
            force_change: of the accelerometer's bias, shape (3,) [m/s^2].
        """
        change = np.concatenate(
            [
                vector("gyro_change", gyro_change, (3,), unit="rad/s"),
                vector("force_change", force_change, (3,), unit="m/s^2"),
            ]
        )
        turn, velocity, position = (self.jacobian @ change).reshape(3, 3)
        return self._replace(
            rotation=quaternion.product(self.rotation, quaternion.exp(turn)),
            velocity=self.velocity + velocity,
            position=self.position + position,
        )

    def predict(
        self, rotation: Array, velocity: Array, position: Array, gravity: Array
    ) -> tuple[Array, Array, Array]:
        """Return attitude, velocity and position at the last image, in world axes.

        Args:
            rotation: at the first image, unit quaternion, shape (4,).
            velocity: at the first image, shape (3,) [m/s].
            position: at the first image, shape (3,) [m].
            gravity: shape (3,) [m/s^2].
        """
        t = self.seconds
        return (
            quaternion.product(rotation, self.rotation),
            velocity + gravity * t + quaternion.rotate(rotation, self.velocity),
            position
            + velocity * t
            + 0.5 * gravity * t * t
            + quaternion.rotate(rotation, self.position),
        )


def _skew(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _right_jacobian(u: Array) -> Array:
    """Return the right Jacobian of SO(3): exp(u + du) is exp(u) exp(J du) to first order."""
    angle = float(np.linalg.norm(u))
    cross = _skew(u)
    if angle < 1e-4:
        # Their series: the closed forms would divide rounding by the angle's square.
        a, b = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
    else:
        a, b = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
    return np.asarray(np.eye(3) - a * cross + b * cross @ cross)


def preintegrate(
    gyro: ArrayLike,
    force: ArrayLike,
    dt: float,
    gyro_bias: ArrayLike = (0.0, 0.0, 0.0),
    force_bias: ArrayLike = (0.0, 0.0, 0.0),
) -> Increments:
    """Return the increments of n samples, each held for dt, and their Jacobians by the biases.

    Args:
        gyro: angular velocity in the sensor's axes, shape (3, n) [rad/s].
        force: specific force in the sensor's axes, shape (3, n) [m/s^2].
        dt: between samples [s].
        gyro_bias: subtracted from `gyro`, shape (3,) [rad/s].
        force_bias: subtracted from `force`, shape (3,) [m/s^2].

    Raises:
        ValueError: for shapes that disagree, numbers that are not finite or no sample.
    """
    step = positive("dt", dt, unit="s")
    rates = vector("gyro", gyro, (3, None), unit="rad/s")
    forces = vector("force", force, (3, None), unit="m/s^2")
    if rates.shape != forces.shape or not rates.shape[1]:
        raise invalid("force.shape", forces.shape, f"that of gyro, {rates.shape}, with a sample")
    rates = rates - vector("gyro_bias", gyro_bias, (3,), unit="rad/s")[:, None]
    forces = forces - vector("force_bias", force_bias, (3,), unit="m/s^2")[:, None]
    R, q, v, p = np.eye(3), quaternion.identity(), np.zeros(3), np.zeros(3)
    turn, fast, far = np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6))
    # A change of the accelerometer's bias acts on the force alone.
    direct = np.hstack((np.zeros((3, 3)), np.eye(3)))
    for w, f in zip(rates.T, forces.T, strict=True):
        # A held force moves the position by its constant acceleration, before the sensor turns on.
        push = -R @ (_skew(f) @ turn + direct)
        far = far + step * fast + 0.5 * step**2 * push
        fast = fast + step * push
        p = p + step * v + 0.5 * step**2 * (R @ f)
        v = v + step * (R @ f)
        # The rotation so far carries its own Jacobian into the axes of the next sample.
        small = quaternion.exp(step * w)
        E = quaternion.to_matrix(small)
        turn = E.T @ turn
        turn[:, :3] -= step * _right_jacobian(step * w)
        q, R = quaternion.product(q, small), R @ E
    return Increments(q, v, p, step * rates.shape[1], np.vstack((turn, fast, far)))
