"""Dynamics against each other, energy, closed forms, and where digits go."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import kinematics
from course.derivations.kinematics.dynamics import exact_accelerations
from course.kinematics import TwoLink, bias, forward_dynamics, inverse_dynamics, mass_matrix, planar
from course.kinematics.two_link import TORQUES
from course.kinematics.two_link import acceleration as two_link_acceleration
from course.rigid_body import System, simulate
from tests.budget import examples
from tests.kinematics.arms import drawn, named, relative, states

seeds = st.integers(0, 10_000)


@examples(40)
@given(seeds)
def test_forward_undoes_inverse_with_a_wrench_at_the_tip(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v, a = states(chain, rng)
    wrench = rng.normal(size=6)
    tau = inverse_dynamics(chain, q, v, a, wrench)
    pulled = bias(chain, q, v) - kinematics.jacobian(chain, q).T @ wrench
    assert relative(tau, mass_matrix(chain, q) @ a + pulled) < 1e-12
    assert np.abs(forward_dynamics(chain, q, v, tau, wrench) - a).max() < 1e-8


@examples(40)
@given(seeds)
def test_the_mass_matrix_is_symmetric_positive_and_the_kinetic_energy(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v = states(chain, rng, 2)
    M = mass_matrix(chain, q)
    np.testing.assert_array_equal(M, M.T)
    assert np.linalg.eigvalsh(M).min() > 0.0
    # The energy of each body by itself: velocity of its centre, spin in its own frame.
    result = 0.5 * chain.armature @ v**2
    for i in range(chain.n):
        twist = kinematics.jacobian(chain, q, chain.centre[:, i], joint=i) @ v
        pose = kinematics.frames(chain, q)[:, i]
        spin = kinematics.chain.rotate(kinematics.chain.conjugate(pose[3:]), twist[3:])
        result += 0.5 * chain.mass[i] * twist[:3] @ twist[:3]
        result += 0.5 * spin @ chain.inertia[:, :, i] @ spin
    assert kinematics.energy(chain, q, v)[0] == pytest.approx(result, rel=1e-12)


@examples(30)
@given(seeds)
def test_gravity_is_the_slope_of_the_potential_and_power_is_the_rate_of_energy(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v, a = states(chain, rng)
    h, still = 1e-5, np.zeros(chain.n)
    forward, back = (q[:, None] + t * np.eye(chain.n) for t in (h, -h))
    at_rest = np.zeros_like(forward)
    rise = (
        kinematics.energy(chain, forward, at_rest)[1] - kinematics.energy(chain, back, at_rest)[1]
    )
    slope, weight = rise / (2 * h), bias(chain, q, still)
    assert np.abs(slope - weight).max() < 1e-6 * (1.0 + np.abs(weight).max())
    tau = inverse_dynamics(chain, q, v, a)
    ahead, behind = (
        kinematics.energy(chain, q + t * v + 0.5 * t * t * a, v + t * a)[2] for t in (h, -h)
    )
    power = (tau - chain.damping * v) @ v
    size = 1.0 + np.abs(tau) @ np.abs(v)
    assert abs((ahead - behind) / (2 * h) - power) < 1e-5 * size


@examples(15)
@given(seeds)
def test_the_regressor_is_linear_in_ten_numbers_a_link(seed) -> None:
    chain, rng = drawn(seed % 500), np.random.default_rng(seed)
    q, v, a = states(chain, rng)
    Y = kinematics.regressor(chain, q, v, a)
    tau = Y @ kinematics.inertial_parameters(chain) + chain.armature * a + chain.damping * v
    assert relative(tau, inverse_dynamics(chain, q, v, a)) < 1e-12


def test_the_energy_of_a_free_arm_is_kept_at_the_order_of_the_integrator() -> None:
    """Or, with RK4, an order better; not to rounding, as none is symplectic in angles and rates."""
    chain = planar([0.5, 0.4, 0.3], [1.0, 0.8, 0.5])
    q0, v0 = np.array([0.3, 0.8, -0.5]), np.array([0.5, -1.0, 1.5])
    down = (0.0, -9.81, 0.0)
    arm = System("arm", kinematics.acceleration, kinematics.pack(chain, 0.0, down), q0, v0)
    start = kinematics.energy(chain, q0, v0, gravity=down)[2]
    for name, first, order in (
        ("semi_implicit_euler", 4000, 1),
        ("explicit_midpoint", 1600, 2),
        ("rk4", 400, 4),
    ):
        drift = []
        for steps in (first, 2 * first):
            run = simulate(arm, name, 1.0 / steps, steps, steps // 50)
            energies = kinematics.energy(chain, run.q.T, run.v.T, gravity=down)[2]
            drift.append(float(np.sqrt(np.mean((energies - start) ** 2))))
        assert order - 0.4 < np.log2(drift[0] / drift[1]) < order + 1.4, name
        assert drift[1] > 1e-13


def test_a_pendulum_swings_with_its_closed_form() -> None:
    """One rod, small angle: period 2 pi sqrt(2 l / 3 g), and the exact one by the AGM."""
    chain, g, angle = planar([0.8]), 9.81, 1.0
    params = kinematics.pack(chain, 0.0, (0.0, -g, 0.0))
    period = float(
        2 * mpmath.pi * mpmath.sqrt(2 * 0.8 / (3 * g)) / mpmath.agm(1, mpmath.cos(angle / 2))
    )
    swing = System(
        "rod", kinematics.acceleration, params, np.array([angle - np.pi / 2]), np.zeros(1)
    )
    last = simulate(swing, "rk4", period / 2000, 2000)
    assert last.q[-1, 0] == pytest.approx(angle - np.pi / 2, abs=1e-10)
    batch = kinematics.acceleration(last.q[-1][:, None], last.v[-1][:, None], params)
    assert batch.shape == (1, 1)


@pytest.mark.parametrize("which", named())
def test_a_small_motion_is_the_linear_one(which) -> None:
    chain, rng = named()[which], np.random.default_rng(2)
    q, v, a = states(chain, rng)
    tau = inverse_dynamics(chain, q, v, a)
    A, B = kinematics.linearise(chain, q, v, tau)
    n = chain.n
    assert relative(B[n:], np.linalg.inv(mass_matrix(chain, q))) < 1e-8
    dq, dv, du = 1e-4 * rng.normal(size=(3, n))
    moved = forward_dynamics(chain, q + dq, v + dv, tau + du) - a
    linear = A[n:] @ np.concatenate([dq, dv]) + B[n:] @ du
    assert relative(linear, moved) < 5e-3
    np.testing.assert_array_equal(A[:n, n:], np.eye(n))


@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e3, 1e6, 1e9])
def test_both_ways_to_accelerations_lose_what_the_conditioning_takes(mass) -> None:
    """Articulated bodies and a factorised mass matrix, against 60 digits: alike at every mass."""
    rng, down, worst = np.random.default_rng(0), (0.0, -9.81, 0.0), 0.0
    lengths, masses = [0.5, 0.4, 0.3], [1.0, 0.8, mass]
    for _ in range(8):
        chain, (q, v, tau) = planar(lengths, masses), rng.normal(size=(3, 3))
        M, h = mass_matrix(chain, q), bias(chain, q, v, gravity=down)
        exact = exact_accelerations(lengths, masses, q, v, tau, 9.81)
        for result in (
            forward_dynamics(chain, q, v, tau, gravity=down),
            np.linalg.solve(M, tau - h),
        ):
            worst = max(worst, relative(result, exact) / (np.linalg.cond(M) * 2.2e-16))
    assert worst < 10.0


# --- two links ------------------------------------------------------------------------------------

positive = st.floats(0.1, 3.0)
arms = st.builds(
    TwoLink,
    lengths=st.tuples(positive, positive),
    masses=st.tuples(positive, positive),
    damping=st.tuples(positive, positive),
    payload=st.floats(0.0, 2.0),
    gravity=st.sampled_from([0.0, 9.81]),
)


@examples(60)
@given(arms, seeds)
def test_two_links_are_the_chain(arm, seed) -> None:
    q, v, a = np.random.default_rng(seed).normal(size=(3, 2))
    chain, down = arm.chain(), (0.0, -arm.gravity, 0.0)
    tau = inverse_dynamics(chain, q, v, a, gravity=down)
    assert relative(arm.inverse_dynamics(q, v, a), tau) < 1e-12
    assert relative(arm.mass_matrix(q), mass_matrix(chain, q)) < 1e-12
    assert relative(arm.bias(q, v), bias(chain, q, v, gravity=down)) < 1e-11
    column = arm.column()
    column[TORQUES, 0] = tau
    result = two_link_acceleration(q[:, None], v[:, None], column)[:, 0]
    assert np.abs(result - a).max() < 1e-9 * (1.0 + np.abs(a).max())


@examples(60)
@given(arms, seeds)
def test_the_regressor_of_two_links_has_a_skew_symmetric_rest(arm, seed) -> None:
    """w^T (M' - 2 C) w = 0, which the proof of the adaptive law needs; masses do not enter."""
    q, v, a, w = np.random.default_rng(seed).normal(size=(4, 2))
    still, zero = TwoLink(arm.lengths, arm.masses, (0.0, 0.0), payload=arm.payload), np.zeros(2)
    C = np.stack([still.regressor(q, v, zero, e) @ still.parameters for e in np.eye(2)], axis=1)
    h = 1e-6
    rate = (still.mass_matrix(q + h * v) - still.mass_matrix(q - h * v)) / (2 * h)
    assert abs(w @ (rate - 2.0 * C) @ w) < 1e-7 * (1.0 + np.abs(C).max() * (w @ w))
    other = TwoLink(arm.lengths, (9.0, 9.0), payload=9.0, gravity=arm.gravity)
    np.testing.assert_array_equal(arm.regressor(q, v, a, w), other.regressor(q, v, a, w))
    batch = arm.regressor(*(np.stack([x, 2 * x], axis=1) for x in (q, v, a, w)))
    np.testing.assert_array_equal(batch[:, :, 0], arm.regressor(q, v, a, w))
    assert batch.shape == (2, 7 if arm.gravity else 5, 2)
