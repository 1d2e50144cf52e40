"""MuJoCo as the adapter prepares it, against closed forms: is it really the same question?"""

import logging
import math
import subprocess
import sys

import numpy as np
import pytest

from course.measure import stability
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import free as mujoco_free
from course.oracles.mujoco import kit as mujoco_kit
from course.oracles.mujoco import oscillator as mujoco_oscillator
from course.rigid_body import oscillator, problems

ORDER = {"Euler": 1, "RK4": 4, "implicit": 1, "implicitfast": 1, "discrete": 1}
EXPLICIT_CONTACT = ("Euler", "implicit", "implicitfast")


def _order(errors):
    """Slope over the last three halvings of the step."""
    return float(np.log2(errors[-4] / errors[-1]) / 3.0)


def _multiply(a, b):
    w, x, y, z = a
    return np.array(
        [
            w * b[0] - x * b[1] - y * b[2] - z * b[3],
            w * b[1] + x * b[0] + y * b[3] - z * b[2],
            w * b[2] - x * b[3] + y * b[0] + z * b[1],
            w * b[3] + x * b[2] - y * b[1] + z * b[0],
        ]
    )


def _turn(vector):
    """Unit quaternion of a rotation vector."""
    angle = np.linalg.norm(vector)
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * np.asarray(vector) / angle])


def _angle(a, b):
    return 2.0 * math.asin(min(1.0, float(min(np.linalg.norm(a - b), np.linalg.norm(a + b))) / 2.0))


# --- conventions ----------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", mujoco_kit.MUJOCO_INTEGRATORS)
def test_free_joint_spins_in_the_body_frame_and_moves_in_the_world_frame(integrator):
    start = _turn([0.5 * math.pi, 0.0, 0.0])
    spin, velocity = np.array([0.0, 0.0, 2.0]), np.array([0.3, -0.2, 0.1])
    runner = mujoco_free.free_body(
        [1.0, 1.0, 1.0], [0, 0, 0, *start], [*velocity, *spin], 1e-3, integrator
    )
    q, v = runner.run(500)
    assert q[:3] == pytest.approx(0.5 * velocity, abs=1e-12)
    assert _angle(q[3:], _multiply(start, _turn(0.5 * spin))) < 1e-12
    assert _angle(q[3:], _multiply(_turn(0.5 * spin), start)) > 0.5  # what the world frame would be
    assert v == pytest.approx([*velocity, *spin], abs=1e-12)


def test_gravity_points_down_z():
    runner = mujoco_free.free_body(
        [1, 1, 1], [0, 0, 5, 1, 0, 0, 0], np.zeros(6), 1e-3, "RK4", gravity=9.81
    )
    q, _ = runner.run(1000)
    assert q[:3] == pytest.approx([0.0, 0.0, 5.0 - 0.5 * 9.81], abs=1e-10)


def test_planar_angle_is_counter_clockwise():
    """Positive theta lifts the right lower corner, so the left one lands first, and turns back."""
    runner = mujoco_box.box_drop(
        (0.1, 0.1), 1.0, [0, 0.2, 0.3], [0, -1, 0], 1e-3, "Euler", friction=0
    )
    _, v = runner.run(300)
    down = 0.1 * (math.cos(0.3) + math.sin(0.3))
    assert runner.samples(300).q[1].min() < down + 1e-3
    assert v[2] != 0.0
    # Lowest corner of a box turned by +0.3 is the left one only if theta is counter-clockwise ...
    corners = np.array([[-0.1, -0.1], [0.1, -0.1]]).T
    c, s = math.cos(0.3), math.sin(0.3)
    heights = (np.array([[c, -s], [s, c]]) @ corners)[1]
    assert heights[0] < heights[1]
    # ... and the push from the ground at its left turns it clockwise.
    first = next(x for x in runner.samples(300).v[2] if x != 0.0)
    assert first < 0.0


def test_trajectory_and_run_agree():
    runner = mujoco_oscillator.pendulum(1.0, 1.0, 0.0, 1e-3, "RK4")
    path = runner.samples(100, every=20)
    q, v = runner.run(100)
    assert path.times == pytest.approx(np.arange(6) * 0.02)
    assert path.q.shape == path.v.shape == (1, 6)
    assert path.q[0, 0] == 1.0
    assert (path.q[0, -1], path.v[0, -1]) == (q[0], v[0])
    assert runner.run(0)[0] == 1.0
    assert (runner.evaluations(100), mujoco_kit.EVALUATIONS_PER_STEP["Euler"]) == (400, 1)


def test_a_second_run_is_the_first():
    """Nothing is left over from the last run, the contact solver's warm start included."""
    runner = mujoco_box.box_drop((0.1, 0.1), 1.0, [0, 0.099, 0.1], [1, 0, 2], 1e-3, "Euler")
    first = runner.run(150)
    runner.run(33)
    second = runner.run(150)
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", mujoco_kit.MUJOCO_INTEGRATORS)
def test_oscillator(integrator):
    mass, stiffness, damping, end = 2.0, 50.0, 1.2, 2.0
    decay = 0.5 * damping / mass
    omega = math.sqrt(stiffness / mass - decay**2)

    def truth(t):
        return math.exp(-decay * t) * (
            0.3 * math.cos(omega * t) + (0.7 + decay * 0.3) / omega * math.sin(omega * t)
        )

    errors = []
    for n in 25 * 2 ** np.arange(6):
        runner = mujoco_oscillator.oscillator(
            mass, stiffness, damping, 0.3, 0.7, end / n, integrator
        )
        errors.append(abs(runner.run(int(n))[0][0] - truth(end)))
    assert _order(errors) == pytest.approx(ORDER[integrator], abs=0.15)
    assert errors[-1] < (1e-8 if integrator == "RK4" else 2e-2)


@pytest.mark.parametrize("integrator", mujoco_kit.MUJOCO_INTEGRATORS)
def test_symmetric_body(integrator):
    """Torque-free: q(t) = exp(L t / I1) q0 exp((1 - I3 / I1) w3 t e3)."""
    i1, i3, end = 1.0, 0.4, 1.5
    start, spin = _turn([0.3, -0.8, 0.5]), np.array([0.6, -0.4, 3.0])
    momentum = np.array([i1, i1, i3]) * spin
    back = start * [1, -1, -1, -1]
    world = _multiply(_multiply(start, np.concatenate([[0.0], momentum])), back)[1:]
    truth = _multiply(
        _multiply(_turn(world * end / i1), start), _turn([0, 0, (1 - i3 / i1) * spin[2] * end])
    )
    errors = []
    for n in 20 * 2 ** np.arange(6):
        runner = mujoco_free.free_body(
            [i1, i1, i3], [0, 0, 0, *start], [0, 0, 0, *spin], end / n, integrator
        )
        errors.append(_angle(runner.run(int(n))[0][3:], truth))
    assert _order(errors) == pytest.approx(ORDER[integrator], abs=0.15)


@pytest.mark.parametrize("joint", ["free", "ball"])
@pytest.mark.parametrize("integrator", mujoco_kit.MUJOCO_INTEGRATORS)
def test_order_on_the_asymmetric_tumble(integrator, joint):
    problem, end = problems.tumble(), 5.0
    q0, v0 = problem.system.q0, problem.system.v0
    if joint == "free":
        q0, v0 = np.concatenate([np.zeros(3), q0]), np.concatenate([np.zeros(3), v0])
    errors = []
    for n in 100 * 2 ** np.arange(4):
        runner = mujoco_free.free_body((1.0, 2.0, 3.0), q0, v0, end / n, integrator)
        errors.append(problem.error(runner.run(int(n))[0][-4:], end))
    # Since version 4 RK4 carries the Munthe-Kaas correction; before, it had order 2 here.
    assert _order(errors) == pytest.approx(ORDER[integrator], abs=0.15)


def test_who_keeps_the_energy_of_a_tumble():
    problem = problems.tumble()
    inertia = np.array([1.0, 2.0, 3.0])
    q0 = np.concatenate([np.zeros(3), problem.system.q0])
    v0 = np.concatenate([np.zeros(3), problem.system.v0])
    change = {}
    for integrator in mujoco_kit.MUJOCO_INTEGRATORS:
        spin = mujoco_free.free_body(inertia, q0, v0, 5e-3, integrator).run(4000)[1][3:]
        start = problem.system.v0
        change[integrator] = float(inertia @ spin**2 / (inertia @ start**2) - 1.0)
    assert abs(change["RK4"]) < 1e-9
    assert change["Euler"] > 1e-3  # the gyroscopic torque explicitly: gains
    for implicit in ("implicit", "implicitfast", "discrete"):  # implicitly: loses
        assert change[implicit] < -1e-3


def test_pendulum_is_the_ideal_one():
    problem = problems.pendulum()
    gravity = problem.system.params[0]  # length 1
    runner = mujoco_oscillator.pendulum(
        1.0, problem.system.q0[0], 0.0, 1e-3, "RK4", gravity=gravity
    )
    assert problem.error(runner.run(round(problem.duration / 1e-3))[0]) < 1e-10
    longer = mujoco_oscillator.pendulum(4.0, 0.01, 0.0, 1e-3, "RK4")
    period = 2.0 * math.pi * math.sqrt(4.0 / 9.81) * (1.0 + 0.01**2 / 16.0)
    assert longer.run(round(0.25 * period / 1e-3))[0][0] == pytest.approx(0.0, abs=1e-5)


def test_double_pendulum_is_two_point_masses():
    problem = problems.double_pendulum()
    phi = problem.system.q0
    runner = mujoco_oscillator.double_pendulum(
        (1.0, 1.0),
        (1.0, 1.0),
        (phi[0], phi[1] - phi[0]),
        (0.0, 0.0),
        1e-3,
        "RK4",
        gravity=problem.system.params[4],
    )
    q, _ = runner.run(round(problem.duration / 1e-3))
    assert problem.error(np.array([q[0], q[0] + q[1]])) < 1e-8


def test_double_pendulum_with_unequal_masses_keeps_its_energy():
    """The substitute bodies have the right moments: the point masses' energy is kept."""
    m1, m2, l1, l2, g = 0.4, 3.0, 0.7, 1.3, 9.81
    runner = mujoco_oscillator.double_pendulum(
        (m1, m2), (l1, l2), (1.0, 0.5), (0.3, -0.2), 2e-4, "RK4"
    )
    path = runner.samples(5000, every=500)
    a, b = path.q[0], path.q[0] + path.q[1]
    va, vb = path.v[0], path.v[0] + path.v[1]
    kinetic = 0.5 * (m1 + m2) * (l1 * va) ** 2 + 0.5 * m2 * (l2 * vb) ** 2
    kinetic = kinetic + m2 * l1 * l2 * va * vb * np.cos(a - b)
    energy = kinetic - (m1 + m2) * g * l1 * np.cos(a) - m2 * g * l2 * np.cos(b)
    assert np.ptp(energy) < 1e-7


def test_heavy_top_nutates_as_the_closed_form():
    inertia, weight, tilt, spin = (0.02, 0.004), 1.0, 0.5, 80.0
    problem = problems.heavy_top(inertia, weight, tilt, spin)
    runner = mujoco_free.heavy_top(inertia, weight, problem.system.q0, [0, 0, spin], 2.5e-4, "RK4")
    path = runner.samples(4000, every=400)
    height = 1.0 - 2.0 * (path.q[1] ** 2 + path.q[2] ** 2)
    truth = [problems.top_height_truth(t, inertia, weight, tilt, spin) for t in path.times]
    assert height == pytest.approx(np.array(truth), abs=1e-7)
    assert np.ptp(height) > 1e-2


# --- the stiff spring -----------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("zeta", [0.05, 0.3, 1.2])
@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_stiff_spring_limit(integrator, zeta):
    def is_stable(x):
        return stability.is_stable_by_matrix(
            mujoco_oscillator.oscillator_step(integrator, x, zeta), 2
        )

    if integrator == "RK4":
        theory = oscillator.limit("rk4", zeta)
    else:
        theory = oscillator.implicit_damping_limit(zeta)
    assert stability.limit(is_stable, 0.1, 20.0) == pytest.approx(theory, rel=5e-3)
    for factor, stable in ((0.995, True), (1.005, False)):
        step = mujoco_oscillator.oscillator_step(integrator, factor * theory, zeta)
        assert stability.is_stable_by_iteration(step, 2, steps=1500) is stable


@pytest.mark.parametrize("zeta", [0.3, 1.2])
def test_explicit_damper_lowers_the_limit(zeta):
    def is_stable(x):
        step = mujoco_oscillator.oscillator_step("Euler", x, zeta, implicit_damping=False)
        return stability.is_stable_by_matrix(step, 2)

    theory = oscillator.limit("semi_implicit_euler", zeta)
    assert stability.limit(is_stable, 0.05, 20.0) == pytest.approx(theory, rel=5e-3)


@pytest.mark.parametrize("zeta", [0.0, 0.5])
def test_discrete_has_no_limit(zeta):
    for x in (1.0, 3.0, 100.0, 1e4):
        step = mujoco_oscillator.oscillator_step("discrete", x, zeta)
        assert stability.is_stable_by_iteration(step, 2, steps=200)


def test_divergence_is_returned_and_leaves_no_file(tmp_path, monkeypatch, caplog):
    monkeypatch.chdir(tmp_path)
    with caplog.at_level(logging.INFO, logger="course.oracles.mujoco.kit"):
        q, _ = mujoco_oscillator.oscillator(1.0, 1.0, 0.0, 1.0, 0.0, 3.0, "Euler").run(2000)
    assert not np.all(np.isfinite(q)) or np.abs(q[0]) > 1e100
    assert list(tmp_path.iterdir()) == []


# --- the box --------------------------------------------------------------------------------------


@pytest.mark.parametrize("desired", [0.0, 0.3, 0.5, 0.7, 0.9, 1.0])
@pytest.mark.parametrize("integrator", EXPLICIT_CONTACT)
def test_restitution_by_impulse(integrator, desired):
    exact, worst = mujoco_box.measured_restitution(desired, 1e-3, integrator, gravity=0.0)
    assert exact == pytest.approx(desired, abs=3e-4)
    assert worst < 3e-4
    _, with_gravity = mujoco_box.measured_restitution(desired, 1e-3, integrator)
    assert with_gravity < 0.01


@pytest.mark.parametrize("integrator", mujoco_kit.MUJOCO_INTEGRATORS)
def test_restitution_by_spring_gets_better_with_a_longer_contact(integrator):
    errors = [
        mujoco_box.measured_restitution(
            0.5, 1e-4, integrator, contact="spring", contact_steps=n, gravity=0.0, phases=6
        )[1]
        for n in (20, 80)
    ]
    assert errors[0] < 0.03
    assert errors[1] < 0.5 * errors[0]


def test_spring_restitution_formula():
    """Against a fine integration of the clipped spring-damper."""
    for zeta in (0.0, 0.2, 0.7, 1.0, 2.5):
        depth, rate, h = 0.0, 1.0, 1e-4
        while True:
            force = depth + 2.0 * zeta * rate
            if force <= 0.0 and rate < 0.0:
                break
            rate -= h * force
            depth += h * rate
        assert mujoco_box.spring_restitution(zeta) == pytest.approx(-rate, abs=1e-3)


def _corner_impact(integrator, mu, slide, **options):
    """Separation speed of the corner, velocities, and their closed form with sliding friction."""
    mass, inertia, angle, e = 2.0, 0.05, 0.4, 0.6
    c, s = math.cos(angle), math.sin(angle)
    rx, rz = -0.1 * c + 0.2 * s, -0.1 * s - 0.2 * c  # the left lower corner
    runner = mujoco_box.box_drop(
        (0.1, 0.2),
        mass,
        [0, -rz + 0.0105, angle],
        [slide, -1.0, 0.0],
        1e-3,
        integrator,
        restitution=e,
        friction=mu,
        gravity=0.0,
        inertia=inertia,
        **options,
    )
    _, v = runner.run(12)
    # The corner slides to the right all through the impact: the impulse is N (-mu, 1).
    spin = (rx + mu * rz) / inertia
    normal = (1.0 + e) / (1.0 / mass + spin * rx)
    expected = [slide - mu * normal / mass, -1.0 + normal / mass, spin * normal]
    return v[1] + rx * v[2], v[0] - rz * v[2], v, expected


@pytest.mark.parametrize("integrator", EXPLICIT_CONTACT)
def test_corner_impact_is_newtons(integrator):
    """One corner, no gravity: the closed form of a rigid impulse."""
    separation, _, v, expected = _corner_impact(integrator, 0.0, 2.0)
    assert separation == pytest.approx(0.6, abs=1e-3)
    assert v == pytest.approx(expected, abs=2e-3)


def test_friction_lifts_a_sliding_corner():
    """The convex contact model: separation is e times approach plus mu times the slip left over."""
    separation, slip, _, _ = _corner_impact("Euler", 0.2, 5.0, friction_steps=1.0)
    assert slip > 3.0
    assert separation == pytest.approx(0.6 + 0.2 * slip, rel=2e-3)
    # A gentler friction reference: nearly Coulomb's answer.
    separation, _, v, expected = _corner_impact("Euler", 0.2, 5.0, friction_steps=3.0)
    assert separation == pytest.approx(0.6, abs=0.1)
    assert v == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize("integrator", EXPLICIT_CONTACT)
def test_sliding_box_stops_where_coulomb_says(integrator):
    mu, speed, hops = 0.4, 1.5, {}
    for steps in (1.0, 10.0):
        path = mujoco_box.box_drop(
            (0.2, 0.05),
            1.0,
            [0, 0.05 - 1e-6, 0],
            [speed, 0, 0],
            1e-3,
            integrator,
            restitution=0.0,
            friction=mu,
            friction_steps=steps,
        ).samples(1000)
        assert path.q[0, -1] == pytest.approx(speed**2 / (2 * mu * 9.81), rel=0.01)
        assert abs(path.v[0, -1]) < 1e-3
        hops[steps] = path.q[1].max() - 0.05
    assert hops[10.0] < 5e-4
    assert hops[1.0] > 5e-3


def test_sticking_impact_sticks_with_the_hardest_friction():
    remaining = {}
    for steps in (1.0, 10.0):
        runner = mujoco_box.box_drop(
            (0.2, 0.05),
            1.0,
            [0, 0.0605, 0],
            [0.3, -1.0, 0],
            1e-3,
            "Euler",
            restitution=0.8,
            friction=1.0,
            gravity=0.0,
            friction_steps=steps,
        )
        _, v = runner.run(15)
        assert v[1] == pytest.approx(0.8, abs=1e-3)
        remaining[steps] = v[0] + 0.05 * v[2]
    assert abs(remaining[1.0]) < 1e-3
    assert remaining[10.0] == pytest.approx(0.9 * 0.3, rel=1e-2)


# --- batches --------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 2])
def test_batches_are_the_single_run(threads):
    rng = np.random.default_rng(5)
    n = 6
    q0 = np.array([np.zeros(n), np.full(n, 0.4), rng.uniform(-1.0, 1.0, n)])
    v0 = rng.normal(size=(3, n))
    boxes = mujoco_box.batch_boxes(
        (0.1, 0.1), 1.0, q0, v0, 1e-3, "Euler", threads=threads, restitution=0.6
    )
    assert (boxes.size, boxes.threads) == (n, threads)
    for _ in range(2):  # the second time from the same start
        q, v = boxes.run(400)
    for i in range(n):
        one = mujoco_box.box_drop(
            (0.1, 0.1), 1.0, q0[:, i], v0[:, i], 1e-3, "Euler", restitution=0.6
        ).run(400)
        assert np.array_equal(q[:, i], one[0])
        assert np.array_equal(v[:, i], one[1])


def test_batch_of_free_bodies():
    q0 = np.zeros((7, 3))
    q0[3] = 1.0
    v0 = np.random.default_rng(1).normal(size=(6, 3))
    q, v = mujoco_free.batch_free_bodies((1, 2, 3), q0, v0, 1e-2, "RK4").run(50)
    one = mujoco_free.free_body((1, 2, 3), q0[:, 2], v0[:, 2], 1e-2, "RK4").run(50)
    assert np.array_equal(q[:, 2], one[0])
    assert np.array_equal(v[:, 2], one[1])
    with pytest.raises(ValueError, match=r"q0.shape, v0.shape"):
        mujoco_free.batch_free_bodies((1, 2, 3), q0, v0[:, :2], 1e-2, "RK4")


# --- doors ----------------------------------------------------------------------------------------


def test_the_library_is_imported_inside():
    code = "import sys, course.oracles.mujoco.box; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_missing_library_gives_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ImportError, match="pip install"):
        mujoco_oscillator.pendulum(1.0, 0.1, 0.0, 1e-3, "Euler")


def test_bad_input():
    with pytest.raises(ValueError, match=r"integrator must be one of.*, got 'Verlet'"):
        mujoco_oscillator.pendulum(1.0, 0.1, 0.0, 1e-3, "Verlet")
    with pytest.raises(ValueError, match=r"dt must be a positive.*, got 0.0"):
        mujoco_oscillator.pendulum(1.0, 0.1, 0.0, 0.0, "Euler")
    with pytest.raises(ValueError, match=r"length must be .*, got -1.0"):
        mujoco_oscillator.pendulum(-1.0, 0.1, 0.0, 1e-3, "Euler")
    with pytest.raises(ValueError, match="inertia"):
        mujoco_free.free_body((1.0, 1.0, 3.0), np.ones(7), np.zeros(6), 1e-3, "Euler")
    with pytest.raises(ValueError, match=r"q0.shape must be \(7,\).*, got \(6,\)"):
        mujoco_free.free_body((1.0, 2.0, 3.0), np.ones(6), np.zeros(6), 1e-3, "Euler")
    with pytest.raises(ValueError, match=r"inertia must be I1 above"):
        mujoco_free.heavy_top((0.01, 0.03), 1.0, [1, 0, 0, 0], [0, 0, 1], 1e-3, "Euler")
    box = ((0.1, 0.1), 1.0, [0, 1, 0], [0, 0, 0], 1e-3)
    with pytest.raises(ValueError, match=r"restitution must be a number from 0 to 1.*, got 1.2"):
        mujoco_box.box_drop(*box, "Euler", restitution=1.2)
    with pytest.raises(ValueError, match="'spring'"):
        mujoco_box.box_drop(*box, "RK4")
    with pytest.raises(ValueError, match=r"contact must be .*, got 'glue'"):
        mujoco_box.box_drop(*box, "Euler", contact="glue")
    with pytest.raises(ValueError, match="friction_steps"):
        mujoco_box.box_drop(*box, "Euler", friction_steps=0.5)
    with pytest.raises(ValueError, match=r"contact_steps must be a larger"):
        mujoco_box.box_drop(*box, "discrete", contact="spring", restitution=1.0)
    with pytest.raises(ValueError, match=r"steps must be .*, got -1"):
        mujoco_oscillator.pendulum(1.0, 0.1, 0.0, 1e-3, "Euler").run(-1)
