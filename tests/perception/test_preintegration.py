"""Increments of an IMU against integration in world axes and differences of themselves."""

import numpy as np
import pytest

from course.perception.preintegration import preintegrate
from course.rigid_body import quaternion

GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def samples(rng, n=60):
    return rng.normal(0.0, 2.0, (3, n)), rng.normal(0.0, 8.0, (3, n))


def differing(a, b):
    """Rotation vector, velocity and position from b to a, (9,)."""
    turn = quaternion.log(quaternion.product(quaternion.conjugate(b.rotation), a.rotation))
    return np.concatenate([turn, a.velocity - b.velocity, a.position - b.position])


def test_prediction_is_integration_in_world_axes(rng):
    gyro, force = samples(rng)
    increments = preintegrate(gyro, force, 5e-3)
    for _ in range(5):
        q = quaternion.exp(rng.normal(0.0, 2.0, 3))
        v, p = rng.normal(0.0, 30.0, 3), rng.normal(0.0, 1e3, 3)
        predicted = increments.predict(q, v, p, GRAVITY)
        for w, f in zip(gyro.T, force.T, strict=True):
            a = quaternion.rotate(q, f) + GRAVITY
            p, v = p + 5e-3 * v + 0.5 * 5e-3**2 * a, v + 5e-3 * a
            q = quaternion.product(q, quaternion.exp(5e-3 * w))
        assert quaternion.angle_between(predicted[0], q) < 1e-7
        np.testing.assert_allclose(predicted[1], v, atol=1e-10)
        np.testing.assert_allclose(predicted[2], p, atol=1e-9)


def test_a_turn_with_constant_force_has_a_closed_form():
    rate, seconds, n = 2.0, 1.0, 4000
    gyro = np.tile([[0.0], [0.0], [rate]], n)
    force = np.tile([[1.0], [0.0], [0.0]], n)
    increments = preintegrate(gyro, force, seconds / n)
    expected = np.array([np.sin(rate), 1.0 - np.cos(rate), 0.0]) / rate
    np.testing.assert_allclose(increments.velocity, expected, atol=1e-3)
    turn = quaternion.exp(np.array([0.0, 0.0, rate]))
    np.testing.assert_allclose(increments.rotation, turn, atol=1e-12)


@pytest.mark.parametrize("still", [False, True])
def test_the_jacobian_is_that_of_differences(rng, still):
    gyro, force = samples(rng)
    if still:
        gyro = np.zeros_like(gyro)
    middle = preintegrate(gyro, force, 5e-3)
    step, columns = 1e-5, []
    for unit in np.eye(6):
        ahead = preintegrate(gyro, force, 5e-3, step * unit[:3], step * unit[3:])
        behind = preintegrate(gyro, force, 5e-3, -step * unit[:3], -step * unit[3:])
        columns.append((differing(ahead, middle) - differing(behind, middle)) / (2.0 * step))
    np.testing.assert_allclose(middle.jacobian, np.array(columns).T, atol=2e-6)


def test_a_changed_accelerometer_bias_is_corrected_exactly(rng):
    gyro, force = samples(rng)
    change = np.array([0.3, -1.0, 2.0])
    corrected = preintegrate(gyro, force, 5e-3).corrected(np.zeros(3), change)
    again = preintegrate(gyro, force, 5e-3, np.zeros(3), change)
    np.testing.assert_allclose(differing(corrected, again), 0.0, atol=1e-10)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="force"):
        preintegrate(np.zeros((3, 4)), np.zeros((3, 5)), 1e-3)
    with pytest.raises(ValueError, match="dt"):
        preintegrate(np.zeros((3, 4)), np.zeros((3, 4)), 0.0)
