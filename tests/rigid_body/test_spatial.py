"""The 13-number rigid body against closed forms, momentum balance and MuJoCo."""

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body import RigidBody, advance_bodies, problems, quaternion
from course.rigid_body.spatial import inertia_tensor, newton_euler_acceleration
from tests.budget import examples

finite = st.floats(-3, 3)
vector = st.lists(finite, min_size=3, max_size=3).map(np.array)


def tilted_tensor() -> np.ndarray:
    turn = quaternion.to_matrix(quaternion.exp(np.array([0.4, -0.9, 0.2])))
    return turn @ np.diag([1.0, 2.0, 2.5]) @ turn.T


def test_tumble_in_a_tilted_body_frame_is_the_same_motion() -> None:
    """Any inertia tensor: the closed-form tumble seen from a body frame that is not principal."""
    problem = problems.tumble(inertia=(1.0, 2.0, 2.5), duration=5.0)
    turn = quaternion.exp(np.array([0.4, -0.9, 0.2]))
    q0 = quaternion.product(problem.system.q0, quaternion.conjugate(turn))
    body = RigidBody(
        2.0,
        tilted_tensor(),
        np.concatenate([[0.0, 0.0, 0.0], q0]),
        np.concatenate([[0.0, 0.0, 0.0], quaternion.rotate(turn, problem.system.v0)]),
    )
    for _ in range(1000):
        body.step(5e-3, gravity=(0.0, 0.0, 0.0))
    true_q, _ = problem.truth(5.0)
    assert (
        quaternion.angle_between(body.q[3:], quaternion.product(true_q, quaternion.conjugate(turn)))
        < 1e-8
    )


@given(vector, vector, vector, vector)
@examples(40)
def test_newton_and_euler_hold_in_the_world(force, point, spin, turn) -> None:
    """d(momentum)/dt = force and d(angular momentum)/dt = (point - centre) x force."""
    body = RigidBody(1.7, tilted_tensor(), v=np.concatenate([[0.2, -0.4, 0.1], spin]))
    body.q[3:] = quaternion.exp(turn)
    before_p, before_l = body.mass * body.v[:3], body.angular_momentum()
    dt = 1e-6
    body.apply_force(force, point)
    torque = body.torque.copy()
    body.step(dt, gravity=(0.0, 0.0, 0.0))
    np.testing.assert_allclose((body.mass * body.v[:3] - before_p) / dt, force, atol=1e-7)
    np.testing.assert_allclose((body.angular_momentum() - before_l) / dt, torque, atol=2e-4)
    np.testing.assert_allclose(torque, np.cross(point, force), atol=1e-12)
    assert not body.force.any() and not body.torque.any()


def test_one_step_acceleration_is_mujocos() -> None:
    xml = """<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>
      <inertial pos="0 0 0" mass="1.7" fullinertia="{}"/></body></worldbody></mujoco>"""
    tensor = tilted_tensor()
    entries = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    model = mujoco.MjModel.from_xml_string(xml.format(" ".join(f"{x:.17g}" for x in entries)))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(5)
    for _ in range(20):
        body = RigidBody(1.7, tensor, v=rng.normal(size=6))
        body.q[3:] = quaternion.exp(rng.normal(size=3))
        force, point = rng.normal(size=3), rng.normal(size=3)
        body.apply_force(force, point)
        data.qpos[:], data.qvel[:] = body.q, body.v
        data.xfrc_applied[1] = np.concatenate([force, np.cross(point, force)])
        mujoco.mj_forward(model, data)
        params = np.concatenate(
            [force / 1.7, body.torque, tensor.ravel(), np.linalg.inv(tensor).ravel()]
        )
        ours = newton_euler_acceleration(body.q, body.v, params)
        np.testing.assert_allclose(ours, data.qacc, rtol=1e-9, atol=1e-9)


def test_thrown_body_keeps_energy_and_flies_a_parabola() -> None:
    body = RigidBody(1.0, (1.0, 2.0, 2.5), v=np.array([1.0, 2.0, 5.0, 0.5, 3.0, -1.0]))
    total = body.energy()[2]
    for _ in range(500):
        body.step(2e-3)
    assert body.energy()[2] == pytest.approx(total, rel=1e-9)
    np.testing.assert_allclose(body.q[:3], [1.0, 2.0, 5.0 - 0.5 * 9.80665], atol=1e-10)


@pytest.mark.prove
def test_a_batch_flies_as_its_bodies_do() -> None:
    rng = np.random.default_rng(1)
    n = 300  # more than one block
    q = np.concatenate([rng.normal(size=(3, n)), quaternion.exp(rng.normal(size=(3, n)))])
    v = rng.normal(size=(6, n))
    many_q, many_v = advance_bodies(q, v, (1.0, 2.0, 2.5), 1e-2, 50)
    for i in (0, 255, 256, n - 1):
        body = RigidBody(1.0, (1.0, 2.0, 2.5), q[:, i], v[:, i])
        for _ in range(50):
            body.step(1e-2, integrator="rk4_renormalised")
        np.testing.assert_allclose(many_q[:, i], body.q, atol=1e-12)
        np.testing.assert_allclose(many_v[:, i], body.v, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"mass": 0.0}, r"mass must be .*, got 0.0"),
        ({"mass": float("nan")}, r"mass must be .*, got nan"),
        ({"inertia": (1.0, 1.0, 3.0)}, "at most the sum"),
        ({"inertia": (1.0, -1.0, 1.0)}, "positive principal moments"),
        ({"inertia": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "symmetric"),
        ({"q": np.zeros(7)}, "quaternion"),
        ({"v": np.zeros(3)}, "v.shape must be"),
        ({"v": np.full(6, np.inf)}, "finite"),
    ],
)
def test_wrong_bodies_are_named(arguments: dict, word: str) -> None:
    given: dict[str, Any] = {"mass": 1.0, "inertia": (1.0, 1.0, 1.0)} | arguments
    with pytest.raises(ValueError, match=word):
        RigidBody(**given)


def test_an_orientation_that_was_set_wrongly_is_refused() -> None:
    body = RigidBody(1.0, (1.0, 1.0, 1.0))
    body.q[3:] = (2.0, 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="quaternion"):
        body.step(0.1)


def test_wrong_calls_are_named() -> None:
    body = RigidBody(1.0, (1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match=r"dt must be .*, got 0"):
        body.step(0)
    with pytest.raises(ValueError, match=r"integrator must be .*, got 'euler'"):
        body.step(0.1, integrator="euler")
    with pytest.raises(ValueError, match=r"force.shape must be .*, got \(2,\)"):
        body.apply_force((1.0, 2.0))
    with pytest.raises(ValueError, match=r"q.shape, v.shape"):
        advance_bodies(np.zeros((6, 3)), np.zeros((6, 3)), (1.0, 1.0, 1.0), 0.1, 1)
    with pytest.raises(ValueError, match="at most the sum"):
        inertia_tensor((5.0, 1.0, 1.0))
