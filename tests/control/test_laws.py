"""The laws against Pinocchio, MuJoCo, closed forms and the constraint they push on."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.control import laws
from course.control.tracking import KINDS, JointLaw, track
from course.kinematics import (
    TwoLink,
    bias,
    forward_dynamics,
    jacobian,
    jacobian_rate,
    mass_matrix,
    panda,
    planar,
    random_chain,
    tip,
)
from course.oracles import pinocchio
from course.oracles.mujoco import chain as mujoco_chain
from course.oracles.mujoco.kit import library
from tests.budget import examples
from tests.kinematics.arms import relative

seeds = st.integers(0, 10_000)
ARM = TwoLink(payload=0.3, gravity=9.81)
HEAVY = TwoLink(payload=0.8, damping=(0.4, 0.1), gravity=9.81)
GAINS = ([100.0, 80.0], [20.0, 15.0])


def sweep(times):
    """A smooth motion of two joints, and its rates."""
    w = np.array([[2.0], [3.0]])
    q = np.array([[0.8], [0.5]]) * np.sin(w * times + [[0.3], [1.0]])
    v = np.array([[0.8], [0.5]]) * w * np.cos(w * times + [[0.3], [1.0]])
    return q, v, -(w**2) * q


def drawn(seed, count=None):
    rng = np.random.default_rng(seed)
    chain = random_chain(int(rng.integers(2, 8)), rng, tree=seed % 2 == 1)
    shape = (chain.n,) if count is None else (chain.n, count)
    return chain, rng, [rng.normal(size=shape) for _ in range(5)]


# --- joints ---------------------------------------------------------------------------------------


@pytest.mark.prove
@examples(25)
@given(seeds)
def test_laws_of_joints_are_pinocchios_torques(seed):
    chain, rng, (q, v, q_ref, v_ref, a_ref) = drawn(seed)
    kp, kd = rng.uniform(1.0, 50.0, (2, chain.n))
    judge, zero = pinocchio.Arm(chain), np.zeros(chain.n)
    e = kp * (q_ref - q) + kd * (v_ref - v)
    state = (chain, q, v, q_ref, v_ref)
    result = laws.computed_torque(*state, a_ref, kp, kd)
    assert relative(result, judge.inverse_dynamics(q, v, a_ref + e)) < 1e-11
    result = laws.pd_gravity(*state, kp, kd)
    assert relative(result, judge.inverse_dynamics(q, zero, zero) + e) < 1e-11
    result = laws.feedforward(*state, a_ref, kp, kd)
    assert relative(result, judge.inverse_dynamics(q_ref, v_ref, a_ref) + e) < 1e-11
    # Half a sample on, by the law's own rule.
    h = 0.005
    result = laws.computed_torque(*state, a_ref, kp, kd, dt=2 * h)
    q2, v2 = q + h * v + h**2 / 2 * a_ref, v + h * a_ref
    e = kp * (q_ref - q2) + kd * (v_ref - v2)
    assert relative(result, judge.inverse_dynamics(q2, v2, a_ref + e)) < 1e-11


@examples(4)
@given(seeds)
def test_many_arms_are_each_its_own(seed):
    chain, rng, (q, v, q_ref, v_ref, a_ref) = drawn(seed, 4)
    rows, null = [0, 1], rng.normal(size=q.shape)
    target, turn = rng.normal(size=(3, 4)), np.array([[0.6, -0.8], [0.8, 0.6]])
    one = [
        lambda k: laws.pd_gravity(chain, q[:, k], v[:, k], q_ref[:, k], v_ref[:, k], 9.0, 2.0),
        lambda k: laws.feedforward(
            chain, q[:, k], v[:, k], q_ref[:, k], v_ref[:, k], a_ref[:, k], 9.0, 2.0
        ),
        lambda k: laws.computed_torque(
            chain, q[:, k], v[:, k], q_ref[:, k], v_ref[:, k], a_ref[:, k], 9.0, 2.0, 0.01
        ),
        lambda k: laws.impedance(chain, q[:, k], v[:, k], target[:, k], 50.0, 3.0, rows=rows),
    ]
    if chain.n > 2:
        one.append(
            lambda k: laws.hybrid(
                chain,
                q[:, k],
                v[:, k],
                target[:, k],
                0.1,
                0.2,
                9.0,
                2.0,
                5.0,
                [1.0, 2.0],
                turn,
                [True, False],
                null[:, k],
                force_gain=0.5,
                force_damping=2.0,
                rows=rows,
            )
        )
    for law in one:
        try:
            whole = law(slice(None))
        except ValueError as error:
            assert "singularity" in str(error)
            continue
        apart = np.column_stack([law(k) for k in range(4)])
        assert relative(whole, apart) < 1e-9


def test_two_links_are_their_chain():
    q, v, a = np.random.default_rng(0).normal(size=(3, 2, 5))
    down = (0.0, -9.81, 0.0)
    result = laws.computed_torque(ARM, q, v, v, a, q, *GAINS, 0.01)
    whole = laws.computed_torque(ARM.chain(), q, v, v, a, q, *GAINS, 0.01, gravity=down)
    assert relative(result, whole) < 1e-13


@pytest.mark.prove
@pytest.mark.parametrize("w", [4.0, 10.0])
@pytest.mark.parametrize("ratio", [0.8, 1.25])
def test_a_wrong_inertia_leaves_the_error_of_theory(w, ratio):
    """e'' + kd e' + kp e = (I / I^ - 1) q'': the steady answer to a sine, from that equation."""
    chain, model = (planar([1.0], [m]) for m in (1.0, 1.0 / ratio))
    kp, kd, flat, period = 100.0, 20.0, (0.0, 0.0, 0.0), 2 * np.pi / w

    def wave(t):
        return np.sin(w * t)[None], w * np.cos(w * t)[None], -(w**2) * np.sin(w * t)[None]

    def answer(dt):
        samples = round(period / dt)
        dt = period / samples
        law = JointLaw("computed_torque", model, kp, kd, dt, flat)
        run = track(chain, law, wave, dt, np.ceil(1.6 / period + 1) * period, gravity=flat)
        t = run.times[-1 - samples : -1]
        e = run.setpoint[0, -samples:] - run.q[0, -1 - samples : -1]
        return 2.0j * np.mean(e * np.exp(-1j * w * t))

    # With q = 1 - e: (kp - w^2 + i w kd) e = -w^2 (ratio - 1) (1 - e).
    drive = -(w**2) * (ratio - 1.0)
    truth = drive / (kp - w**2 + 1j * w * kd + drive)
    coarse, fine = answer(period / 160), answer(period / 320)
    # The hold leaves an error of first order, which two sample times tell.
    assert abs(fine - truth) < 0.02 * abs(truth)
    assert abs(2.0 * fine - coarse - truth) < 1e-3 * abs(truth)


@pytest.mark.prove
def test_perfect_tracking_costs_the_sample_time_and_with_preview_its_square():
    worst = {
        preview: [
            np.abs(run.q - sweep(run.times)[0]).max()
            for dt in (0.004, 0.002, 0.001)
            for law in [JointLaw("computed_torque", ARM, *GAINS, dt * preview)]
            for run in [track(ARM, law, sweep, dt, 2.0, 2)]
        ]
        for preview in (0, 1)
    }
    plain, ahead = worst[0], worst[1]
    assert plain[1] / plain[2] == pytest.approx(2.0, abs=0.1)
    assert ahead[1] / ahead[2] == pytest.approx(4.0, abs=0.2)
    assert plain[2] > 50.0 * ahead[2]
    assert ahead[2] < 3e-6


def test_friction_compensation_is_odd_and_has_its_limits():
    v = np.array([[-3.0, 0.0, 1e-6], [2.0, 1.0, -2.0]])
    result = laws.friction_compensation(v, [0.4, 0.2], 0.1, 0.02)
    np.testing.assert_allclose(result, -laws.friction_compensation(-v, [0.4, 0.2], 0.1, 0.02))
    assert result[:, 0] == pytest.approx([-0.4 - 0.3, 0.2 + 0.2], abs=1e-12)
    assert result[0, 1] == 0.0
    assert result[0, 2] == pytest.approx(1e-6 * (0.4 / 0.02 + 0.1), rel=1e-6)


# --- adaptive -------------------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_the_adaptive_laws_function_falls_by_its_damping(gravity):
    arm = TwoLink(payload=0.4, damping=(0.3, 0.1), gravity=gravity)
    law = laws.Adaptive(arm, 5.0, [4.0, 2.0], 0.5, 0.0)
    size = len(arm.parameters)

    def rates(t, x):
        law.estimate = x[4:]
        q, v, a = sweep(np.array([t]))
        tau, change, _ = law.parts(x[:2], x[2:4], q[:, 0], v[:, 0], a[:, 0])
        acc = np.linalg.solve(arm.mass_matrix(x[:2]), tau - arm.bias(x[:2], x[2:4]))
        return np.concatenate([x[2:4], acc, change])

    def lyapunov(t, x):
        law.estimate = x[4:]
        q, v, a = sweep(np.array([t]))
        s = law.parts(x[:2], x[2:4], q[:, 0], v[:, 0], a[:, 0])[2]
        wrong = x[4:] - arm.parameters
        fall = s @ ((np.array([4.0, 2.0]) + arm.damping) * s)
        return 0.5 * s @ arm.mass_matrix(x[:2]) @ s + 0.5 * wrong @ wrong / 0.5, fall

    x, h = np.concatenate([[1.0, -1.0, 0.5, 0.0], np.zeros(size)]), 1e-3
    start, lost, values = lyapunov(0.0, x)[0], 0.0, []
    for k in range(600):
        t, before = k * h, lyapunov(k * h, x)[1]
        k1 = rates(t, x)
        k2 = rates(t + h / 2, x + h / 2 * k1)
        k3 = rates(t + h / 2, x + h / 2 * k2)
        k4 = rates(t + h, x + h * k3)
        middle = lyapunov(t + h / 2, x + h / 2 * k2)[1]
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        value, after = lyapunov(t + h, x)
        lost += h / 6 * (before + 4 * middle + after)
        values.append(value)
    assert (np.diff(values) <= 0.0).all()
    assert start - values[-1] == pytest.approx(lost, rel=5e-4)
    assert values[-1] < 0.95 * start


@pytest.mark.prove
def test_the_adaptive_law_learns_to_track_where_the_wrong_model_does_not():
    wrong = TwoLink(gravity=9.81)
    law = laws.Adaptive(wrong, 10.0, 5.0, 2.0, 1e-3, wrong.parameters)
    run = track(HEAVY, law, sweep, 1e-3, 4.0)
    error = np.abs(run.q[:, :-1] - run.setpoint)
    fixed = track(HEAVY, JointLaw("computed_torque", wrong, *GAINS), sweep, 1e-3, 4.0)
    other = np.abs(fixed.q[:, :-1] - fixed.setpoint)
    assert error[:, 3000:].max() < 0.2 * error[:, :1000].max()
    assert error[:, 3000:].max() < 0.05 * other[:, 3000:].max()
    frozen = laws.Adaptive(wrong, 10.0, 5.0, 2.0, 0.0, wrong.parameters)
    track(HEAVY, frozen, sweep, 1e-3, 0.1)
    np.testing.assert_array_equal(frozen.estimate, wrong.parameters)


# --- the tip --------------------------------------------------------------------------------------


def bent(chain, rng):
    q = rng.uniform(-1.0, 1.0, chain.n) + (0.3 if chain.n == 3 else 0.0)
    q[1:] += 0.5 * np.sign(q[1:])
    return q, rng.normal(size=chain.n)


@pytest.mark.parametrize("name", ["planar", "panda"])
@examples(15)
@given(seeds)
def test_the_tip_obeys_and_does_not_feel_the_null_space(name, seed):
    chain = planar([0.5, 0.4, 0.3], damping=0.2) if name == "planar" else panda()
    rows = [0, 1] if name == "planar" else [0, 1, 2]
    rng = np.random.default_rng(seed)
    q, v = bent(chain, rng)
    goal, rate, acc = rng.normal(size=3), rng.normal(size=len(rows)), rng.normal(size=len(rows))
    J, drift = jacobian(chain, q)[rows], (jacobian_rate(chain, q, v) @ v)[rows]
    expected = acc + 9.0 * (goal - tip(chain, q)[:3])[rows] + 4.0 * (rate - J @ v)
    moved = []
    for null in (np.zeros(chain.n), 10.0 * rng.normal(size=chain.n)):
        tau = laws.operational_space(chain, q, v, goal, rate, acc, 9.0, 4.0, null, rows=rows)
        a = forward_dynamics(chain, q, v, tau)
        assert J @ a + drift == pytest.approx(expected, abs=1e-8)
        moved.append(a)
    assert np.abs(moved[1] - moved[0]).max() > 1e-3
    # The projector of velocities, I - J^+ J, keeps the tip still in statics only.
    usual = (np.eye(chain.n) - np.linalg.pinv(J) @ J) @ null
    assert np.abs(J @ np.linalg.solve(mass_matrix(chain, q), usual)).max() > 1e-6


def test_a_whole_pose_is_a_task():
    chain, rng = panda(), np.random.default_rng(3)
    q, v = np.array([0.2, 0.4, -0.3, -1.6, 0.5, 1.4, 0.3]), rng.normal(size=7)
    goal = tip(chain, q + 0.1)
    tau = laws.operational_space(chain, q, v, goal, 0.0, 0.0, 9.0, 4.0, rows=range(6))
    a = forward_dynamics(chain, q, v, tau)
    result = jacobian(chain, q) @ a + jacobian_rate(chain, q, v) @ v
    expected = 9.0 * laws.pose_error(goal, tip(chain, q)) - 4.0 * jacobian(chain, q) @ v
    assert result == pytest.approx(expected, abs=1e-9)


@examples(25)
@given(seeds, st.floats(-3.0, 3.0))
def test_hybrid_pushes_on_a_turned_surface_and_moves_along_it(seed, angle):
    """The reaction of a hard surface solves M a + bias = tau + J^T n r with n^T (tip at rest)."""
    chain, rng = planar([0.5, 0.4, 0.3], damping=0.1), np.random.default_rng(seed)
    q, v = bent(chain, rng)
    rows, c, s = [0, 1], np.cos(angle), np.sin(angle)
    frame, n, along = np.array([[c, -s], [s, c]]), np.array([c, s]), np.array([-s, c])
    J = jacobian(chain, q)[rows]
    v = v - np.linalg.pinv(J) @ n * (n @ J @ v)  # it slides on the surface
    drift, M = (jacobian_rate(chain, q, v) @ v)[rows], mass_matrix(chain, q)
    goal, acc = rng.normal(size=3), rng.normal(size=2)

    def pressed(frame, forced):
        tau = laws.hybrid(
            chain, q, v, goal, 0.0, acc, 9.0, 4.0, [12.0, 0.0], 0.0, frame, forced, rows=rows
        )
        K = np.block([[M, -(n @ J)[:, None]], [(n @ J)[None], np.zeros((1, 1))]])
        result = np.linalg.solve(K, np.append(tau - bias(chain, q, v), -(n @ drift)))
        return result[-1], along @ (J @ result[:3] + drift)

    expected = acc + 9.0 * (goal - tip(chain, q)[:3])[rows] - 4.0 * (J @ v)
    reaction, moved = pressed(frame, [True, False])
    assert reaction == pytest.approx(-12.0, abs=1e-8)
    assert moved == pytest.approx(along @ expected, abs=1e-8)
    if abs(s) > 0.1:  # chosen among the world's axes it is neither
        reaction, moved = pressed(np.eye(2), [True, False])
        assert abs(reaction + 12.0) > 1e-4
        assert abs(moved - along @ expected) > 1e-4


def test_measured_force_and_speed_enter_along_forced_axes_only():
    chain, q, v = planar([0.5, 0.4]), np.array([0.4, 1.2]), np.array([0.3, -0.7])
    frame = np.array([[0.6, -0.8], [0.8, 0.6]])
    common = (chain, q, v, np.zeros(3), 0.0, 0.0, 0.0, 0.0)
    forces = ([5.0, 7.0], [4.0, 1.0], frame, [True, False])
    first = laws.hybrid(*common, *forces, rows=[0, 1])
    second = laws.hybrid(*common, *forces, rows=[0, 1], force_gain=0.5, force_damping=3.0)
    J = jacobian(chain, q)[:2]
    push = 0.5 * (5.0 - 4.0) - 3.0 * (frame[:, 0] @ J @ v)
    assert second - first == pytest.approx(J.T @ frame[:, 0] * push, abs=1e-12)


@examples(15)
@given(seeds)
def test_an_impedance_at_rest_is_its_spring(seed):
    chain, rng = panda(), np.random.default_rng(seed)
    q, _ = bent(chain, rng)
    A = rng.normal(size=(3, 3))
    K, goal, still = 100.0 * (A @ A.T + np.eye(3)), rng.normal(size=3), np.zeros(7)
    tau = laws.impedance(chain, q, still, goal, K, 5.0)
    pull = -K @ (goal - tip(chain, q)[:3])
    a = forward_dynamics(chain, q, still, tau, np.append(pull, np.zeros(3)))
    assert np.abs(a).max() < 1e-9 * np.abs(tau).max() / 0.1
    v = rng.normal(size=7)
    change = laws.impedance(chain, q, v, goal, K, 5.0, 0.2) - tau
    J = jacobian(chain, q)[:3]
    assert change == pytest.approx(J.T @ (5.0 * (0.2 - J @ v)), abs=1e-9)


def test_admittance_is_its_mass_spring_and_damper():
    mass, damping, stiffness, force = 2.0, 8.0, 50.0, 3.0
    errors = []
    for dt in (2e-3, 1e-3):
        x, v = np.zeros(1), np.zeros(1)
        for _ in range(round(0.5 / dt)):
            x, v = laws.admittance(x, v, [force], mass, damping, stiffness, dt)
        decay, w = damping / (2 * mass), np.sqrt(stiffness / mass - (damping / (2 * mass)) ** 2)
        turn = np.cos(w * 0.5) + decay / w * np.sin(w * 0.5)
        truth = force / stiffness * (1.0 - np.exp(-decay * 0.5) * turn)
        errors.append(abs(x[0] - truth))
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.15)
    assert errors[1] < 2e-4
    x, v = np.ones(1), np.ones(1)
    for _ in range(800):  # a body of next to no mass: dt damping / mass = 1e5
        x, v = laws.admittance(x, v, [1.0], 1e-6, 100.0, 2e3, 1e-3)
    assert x == pytest.approx(1.0 / 2e3, rel=1e-3)


# --- the loop -------------------------------------------------------------------------------------


class Plain:
    """A law that `track` knows nothing about."""

    def __init__(self, law, preview):
        self.law, self.preview = law, preview

    def __call__(self, *state):
        return self.law(*state)


@pytest.mark.prove
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("limit", [np.inf, [6.0, 3.0]])
def test_the_compiled_loop_is_the_python_loop_and_mujocos(kind, limit):
    dt, preview = 2e-3, 2e-3 if kind == "computed_torque" else 0.0
    law = JointLaw(kind, ARM, [[90.0, 5.0], [0.0, 40.0]], [12.0, 9.0], preview)
    start = (np.array([0.3, 0.1]), np.array([0.2, -0.4]))
    run = track(HEAVY, law, sweep, dt, 0.3, state=start, limit=limit)

    for arm, gravity in ((HEAVY, None), (HEAVY.chain(), (0.0, -9.81, 0.0))):
        other = track(
            arm,
            Plain(law, preview),
            sweep,
            dt,
            0.3,
            state=start,
            limit=limit,
            gravity=gravity or (),
        )
        for name in ("q", "v", "torque", "command", "measured", "setpoint", "times"):
            assert relative(getattr(run, name), getattr(other, name)) < 1e-12
    mujoco, model = library(), mujoco_chain.model(HEAVY.chain(), (0.0, -9.81, 0.0))
    model.opt.timestep, model.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start
    top = np.broadcast_to(limit, 2)
    for k in range(150):
        motion = [x[:, 0] for x in sweep(np.array([k * dt + preview / 2]))]
        data.qfrc_applied[:] = np.clip(law(data.qpos, data.qvel, *motion), -top, top)
        mujoco.mj_step(model, data)
    assert np.abs(data.qpos - run.q[:, -1]).max() < 1e-11
    assert (np.abs(run.command) <= np.reshape(top, (2, 1))).all()


def test_a_run_goes_on_where_another_ended():
    law = JointLaw("pd_gravity", ARM, *GAINS)
    whole = track(HEAVY, law, sweep, 1e-3, 0.4, 2)
    first = track(HEAVY, law, sweep, 1e-3, 0.15, 2)
    state = first.q[:, -1], first.v[:, -1]
    second = track(HEAVY, law, lambda t: sweep(t + 0.15), 1e-3, 0.25, 2, state)
    np.testing.assert_allclose(second.q, whole.q[:, 150:], atol=1e-12)
    assert whole.q.shape == (2, 401) and whole.command.shape == (2, 400)


def test_many_arms_run_as_one_each():
    law = JointLaw("computed_torque", ARM, *GAINS)
    starts = np.random.default_rng(0).normal(0.0, 0.3, (2, 2, 3))
    for controller in (law, lambda *state: law(*state)):
        count = track(HEAVY, controller, sweep, 1e-3, 0.05, 1, tuple(starts))
        assert count.q.shape == (2, 3, 51)
        for k in range(3):
            one = track(HEAVY, law, sweep, 1e-3, 0.05, 1, tuple(starts[:, :, k]))
            np.testing.assert_allclose(count.q[:, k], one.q, atol=1e-13)


def test_a_run_that_diverges_ends_in_nan():
    law = JointLaw("pd", ARM, 1e7, 0.0)
    for controller in (law, lambda *state: law(*state)):
        run = track(ARM, controller, sweep, 0.02, 4.0, 1, ([2.0, 1.0], [0.0, 0.0]))
        assert not np.isfinite(run.q[:, -1]).any()


class Lasting:
    duration = 0.5

    def __call__(self, times):
        return sweep(times)


def test_a_reference_of_another_length_is_refused():
    law = JointLaw("pd", ARM, 1.0, 1.0)
    track(ARM, law, Lasting(), 1e-3, 0.5)
    times = np.arange(100) * 1e-3
    track(ARM, law, sweep(times), 1e-3, 0.1)
    for seconds in (0.4, 0.6):
        with pytest.raises(ValueError, match=r"^reference\.duration must be .*, got 0\.5"):
            track(ARM, law, Lasting(), 1e-3, seconds)
    for seconds in (0.09, 0.11):
        with pytest.raises(ValueError, match=r"^q_ref\.shape must be"):
            track(ARM, law, sweep(times), 1e-3, seconds)


NAN = np.nan
TWO = planar([0.5, 0.4])
Z, PD = np.zeros(2), JointLaw("pd", ARM, 1.0, 1.0)
BAD = {
    "q": lambda: laws.pd([NAN, 0.0], Z, Z, Z, 1.0, 1.0),
    "kp": lambda: laws.pd(Z, Z, Z, Z, [1.0, 1.0, 1.0], 1.0),
    "kd": lambda: laws.pd(Z, Z, Z, Z, 1.0, -1.0),
    "a_ref": lambda: laws.computed_torque(TWO, Z, Z, Z, Z, [1.0], 1.0, 1.0),
    "dt": lambda: laws.computed_torque(TWO, Z, Z, Z, Z, Z, 1.0, 1.0, -0.1),
    "stiffness": lambda: laws.impedance(TWO, Z, Z, [1, 0, 0], -np.eye(2), 1.0, rows=[0, 1]),
    r"max\(rows\)": lambda: laws.impedance(TWO, Z, Z, [1, 0, 0], 1.0, 1.0, rows=[0, 5]),
    r"rows\[1\]": lambda: laws.impedance(TWO, Z, Z, [1, 0, 0], 1.0, 1.0, rows=[0, 6]),
    "target": lambda: laws.impedance(TWO, Z, Z, [1, 0], 1.0, 1.0),
    "v": lambda: laws.impedance(TWO, Z, [0.0], [1, 0, 0], 1.0, 1.0, rows=[0, 1]),
    "mass": lambda: laws.admittance(Z, Z, Z, 0.0, 1.0, 1.0, 0.1),
    "width": lambda: laws.friction_compensation(Z, 1.0, width=0.0),
    "slope": lambda: laws.Adaptive(ARM, 0.0, 1.0, 1.0, 0.1),
    "rate": lambda: laws.Adaptive(ARM, 1.0, 1.0, [1.0] * 5, 0.1),
    "estimate": lambda: laws.Adaptive(ARM, 1.0, 1.0, 1.0, 0.1, np.zeros(5)),
    "kind": lambda: JointLaw("pid", ARM, 1.0, 1.0),
    "preview": lambda: JointLaw("pd", ARM, 1.0, 1.0, 0.1),
    "seconds": lambda: track(ARM, PD, sweep, 0.1, -1.0),
    "substeps": lambda: track(ARM, PD, sweep, 0.1, 1.0, 0),
    "limit": lambda: track(ARM, PD, sweep, 0.1, 1.0, limit=-1.0),
    r"limit\.shape": lambda: track(ARM, PD, sweep, 0.1, 1.0, limit=[1.0] * 3),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    with pytest.raises(ValueError, match=rf"^{name}[ .\[].*must be"):
        BAD[name]()


def test_a_posture_near_a_singularity_and_a_frame_that_is_none_are_refused():
    common = (np.zeros(2), [1.0, 0.0, 0.0], 0.0, 0.0, 1.0, 1.0)
    laws.operational_space(TWO, [0.3, 0.1], *common, rows=[0, 1])
    with pytest.raises(ValueError, match=r"^q must be .*singularity"):
        laws.operational_space(TWO, [0.3, 1e-5], *common, rows=[0, 1])
    for frame, forced, name in (
        (np.array([[1.0, 0.1], [0.0, 1.0]]), [True, False], "frame"),
        (np.eye(2), [1, 0], "forced"),
        (np.eye(2), [True], "forced"),
    ):
        with pytest.raises(ValueError, match=f"^{name}"):
            laws.hybrid(TWO, [0.3, 1.0], *common, 1.0, 0.0, frame, forced, rows=[0, 1])
