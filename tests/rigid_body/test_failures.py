"""Both sides of every limit: it works just inside, it fails just outside, theory says where."""

import math

import numpy as np
import pytest

from course.charts.rigid_body import drift, failures, impacts
from course.measure import stability
from course.oracles.mujoco import oscillator as mujoco_oscillator
from course.rigid_body import oscillator
from course.rigid_body.integrators import INTEGRATORS

# --- stability limits -----------------------------------------------------------------------------


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.5, 1.0, 1.7])
@pytest.mark.parametrize("method", failures.NAMES)
def test_measured_limit_is_the_theory_and_both_sides_show_it(method, zeta):
    (found,) = failures.limits((zeta,), (method,), mujoco=False)
    assert found.deviation < 5e-3
    if found.theory == 0.0:
        step = oscillator.stepper(method, 0.1, zeta)
        assert not stability.is_stable_by_iteration(
            step, 2, steps=40_000 if "mid" in method else 999
        )
    elif math.isinf(found.theory):
        assert stability.is_stable_by_iteration(
            oscillator.stepper(method, 50.0, zeta), 2, steps=300
        )
    else:
        # By running on, which knows nothing of matrices.
        inside = oscillator.stepper(method, 0.995 * found.theory, zeta)
        outside = oscillator.stepper(method, 1.005 * found.theory, zeta)
        assert stability.is_stable_by_iteration(inside, 2, steps=1500)
        assert not stability.is_stable_by_iteration(outside, 2, steps=8000, ceiling=1e3)


@pytest.mark.parametrize("zeta", [0.0, 0.4, 1.2])
@pytest.mark.parametrize(("name", "integrator", "damping"), failures._MUJOCO_VARIANTS)
def test_mujocos_limits(name, integrator, damping, zeta):
    theory = failures.mujoco_theory(integrator, zeta, damping)

    def step_at(x):
        return mujoco_oscillator.oscillator_step(integrator, x, zeta, implicit_damping=damping)

    measured = failures.measured_limit(step_at)
    if math.isinf(theory):
        assert math.isinf(measured)
        return
    assert measured == pytest.approx(theory, rel=5e-3)
    assert stability.is_stable_by_iteration(step_at(0.995 * theory), 2, steps=1500)
    assert not stability.is_stable_by_iteration(step_at(1.005 * theory), 2, steps=1500)


def test_damping_taken_implicitly_and_explicitly_differ():
    implicit, explicit = (failures.mujoco_theory("Euler", 1.0, flag) for flag in (True, False))
    assert implicit / explicit == pytest.approx((math.sqrt(2.0) + 1.0) ** 2)


@pytest.mark.parametrize("method", failures.NAMES)
def test_the_boundary_of_a_map_is_within_half_a_cell_of_theory(method):
    x, zeta = np.linspace(0.03, 3.9, 130), np.linspace(0.0, 1.9, 20)
    found = failures.growth_map(method, x, zeta)
    assert failures.boundary_error(found, method) <= 0.51
    for i, j in ((3, 10), (15, 60)):
        theory = stability.spectral_radius(oscillator.step_matrix(method, x[j], zeta[i]))
        assert found.growth[i, j] == pytest.approx(theory, rel=1e-7)


# --- the stiff spring -----------------------------------------------------------------------------


def test_discrete_is_implicit_euler_on_a_spring():
    for x in (0.03, 0.7, 12.0, 900.0):
        (found,) = failures.stiff_spring([x], "discrete")
        theory = failures.implicit_euler_mode(x)
        assert found.growth == pytest.approx(theory.growth, rel=1e-9)
        assert found.damping == pytest.approx(theory.damping, rel=1e-6)
        assert found.phase == pytest.approx(theory.phase, rel=1e-6)


def test_discrete_pays_half_of_omega_dt_in_damping():
    (small,) = failures.stiff_spring([0.02], "discrete")
    assert small.damping == pytest.approx(0.01, rel=1e-3)
    assert small.phase == pytest.approx(-(0.02**2) / 3.0, rel=1e-3)
    (euler,) = failures.stiff_spring([0.02], "Euler")
    assert abs(euler.damping) < 1e-12


# --- long runs ------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", failures.NAMES)
def test_only_the_symplectic_keep_their_first_energy_error(method):
    run = drift.long_energy(method, steps=60_000)
    if INTEGRATORS[method].symplectic:
        assert run.last < 1.01 * run.first
    else:
        assert run.last > 10.0 * run.first


def test_alternating_steps_on_both_sides_of_the_trace():
    root = math.sqrt(2.0)
    # On the line h1 + h2 = 2 sqrt(2) the product of the steps is the most unstable place near.
    unstable, stable = (root + 0.1, root - 0.1), (root - 0.05, root - 0.05)
    assert abs(drift.pattern_trace(*unstable)) > 2.0 > abs(drift.pattern_trace(*stable))
    energy, growth = drift.measured_pattern(unstable, 400)
    assert growth == pytest.approx(drift.pattern_growth(unstable), rel=5e-3)
    assert energy[-1] > 1e6
    energy, _ = drift.measured_pattern(stable, 4000)
    assert energy.max() < 1e3


@pytest.mark.parametrize("other", [0.4, 0.9, 1.3])
def test_boundary_of_alternating_steps(other):
    # (h1 + h2)^2 - (h1 h2)^2 = 4 solved for h1.
    edge = float(np.sort(np.roots([1.0 - other**2, 2.0 * other, other**2 - 4.0]).real)[-1])
    if other > 1.0:
        edge = min(r for r in np.roots([1.0 - other**2, 2.0 * other, other**2 - 4.0]).real if r > 0)
    assert edge < 2.0
    measured = stability.limit(
        lambda h: drift.measured_pattern((h, other), 3000)[0].max() < 1e6, 0.8 * edge, 1.02 * edge
    )
    assert measured == pytest.approx(edge, rel=5e-3)


def test_small_steps_in_tune_with_the_motion_grow_and_out_of_tune_do_not():
    pattern = drift.resonant_pattern()
    assert max(pattern) == 0.3
    energy, growth = drift.measured_pattern(pattern, 100)
    assert growth == pytest.approx(drift.pattern_growth(pattern), rel=1e-3)
    assert energy[-1] > 1e6
    detuned = [0.3] * 5 + [0.1] * 8
    assert drift.pattern_growth(detuned) == 1.0
    assert drift.measured_pattern(detuned, 500)[0].max() < 2.0


def test_phase_error_grows_linearly_at_the_rate_of_theory():
    omega_dt = 0.1
    theory = {
        "velocity_verlet": 2.0 * math.asin(0.5 * omega_dt) / omega_dt - 1.0,
        "semi_implicit_euler": 2.0 * math.asin(0.5 * omega_dt) / omega_dt - 1.0,
        "implicit_midpoint": 2.0 * math.atan(0.5 * omega_dt) / omega_dt - 1.0,
    }
    for method, rate in theory.items():
        periods, error = drift.phase_error(method, 400, omega_dt)
        slope = np.polyfit(periods, error, 1)[0]
        assert slope == pytest.approx(2.0 * math.pi * rate, rel=5e-3)


# --- quaternions ----------------------------------------------------------------------------------


def test_added_quaternions_grow_and_lag_as_the_closed_form_says():
    steps = (10, 1000, 100_000)
    for angle in (1e-3, 2e-2):
        length, attitude = drift.spin_errors("added", angle, steps)
        np.testing.assert_allclose(
            length, drift.added_length(angle, np.array(steps)) - 1.0, rtol=1e-4
        )
        np.testing.assert_allclose(attitude, drift.added_lag(angle, np.array(steps)), rtol=1e-4)


def test_renormalising_keeps_the_length_and_the_lag():
    steps = (1000, 100_000)
    length, attitude = drift.spin_errors("added and renormalised", 1e-2, steps)
    assert length.max() < 1e-15
    np.testing.assert_allclose(attitude, drift.added_lag(1e-2, np.array(steps)), rtol=1e-4)
    length, attitude = drift.spin_errors("exponential map", 1e-2, steps)
    assert length.max() < 1e-11 and attitude.max() < 1e-11
    with pytest.raises(ValueError, match="update"):
        drift.spin_errors("slerp", 1e-2, steps)


# --- tunnelling -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("ratio", "share"), [(0.99, 0.0), (1.25, 0.2), (4.0, 0.75)])
def test_share_of_missed_walls(ratio, share):
    rng = np.random.default_rng(0)
    measured = impacts.point_misses(ratio, 40_000, rng)
    assert measured == pytest.approx(share, abs=0.0 if share == 0.0 else 0.01)
    assert impacts.swept_misses(ratio, 30, rng) == 0.0


def test_mujocos_one_step_contact_has_half_the_wall_and_one_radius():
    phases = (np.arange(200) + 0.5) / 200.0
    thickness, radius, dt = 0.03, 0.004, 1e-3
    reach = 0.5 * thickness + radius
    for ratio in (0.995, 1.005, 2.0, 5.0):
        share = impacts.mujoco_through(thickness, radius, ratio * reach / dt, dt, phases, True)
        assert share == pytest.approx(max(0.0, 1.0 - 1.0 / ratio), abs=0.006)


@pytest.mark.parametrize("dt", [2e-4, 1e-3])
def test_mujocos_default_contact_lets_through_by_speed_whatever_the_step(dt):
    theory = 0.02 / impacts.soft_contact_depth()
    measured = impacts.penetration_speed(0.02, 0.01, dt, False, phases=6)
    assert measured == pytest.approx(theory, rel=0.02)  # the first millimetre is softer
    phases = np.linspace(0.001, 0.999, 6)
    assert impacts.mujoco_through(0.02, 0.01, 0.97 * theory, dt, phases, False) == 0.0
    assert impacts.mujoco_through(0.02, 0.01, 1.03 * theory, dt, phases, False) > 0.0


# --- rest -----------------------------------------------------------------------------------------


def test_a_box_rests_with_a_rest_speed_and_chatters_without():
    quiet = impacts.our_box_at_rest(0.01, duration=1.0)
    loud = impacts.our_box_at_rest(0.0, duration=1.0)
    late = impacts.our_box_at_rest(0.01, False, duration=1.0)
    assert quiet.impacts_per_second == 0.0 and quiet.noise == 0.0
    assert loud.impacts_per_second > 1000.0 and loud.noise > 1e-3
    assert late.impacts_per_second > 50.0 and late.noise > 1e-3
    assert impacts.mujoco_box_at_rest("Euler", "impulse", 1.0).noise < 1e-5


def test_bounces_pile_up_as_the_geometric_series_says():
    e, end = 0.7, impacts.zeno_end(1.0, 0.7)
    first = math.sqrt(2.0 / 9.80665)
    left = np.array([0.3, 1e-2, 1e-4, 1e-6])
    # After n impacts 2 t1 e^n / (1 - e) is left.
    theory = np.floor(1.0 + np.log(left * (1.0 - e) / (2.0 * first * e)) / math.log(e) + 1e-12)
    assert impacts.zeno_counts(end - left).tolist() == theory.tolist()
    # With a rest speed it ends with the first impact that is slower.
    slowest = math.floor(math.log(0.01 / math.sqrt(2.0 * 9.80665)) / math.log(e)) + 2
    assert abs(impacts.zeno_counts(np.array([end + 1.0]), rest_speed=0.01)[0] - slowest) <= 1
