"""Both sides of every limit: it works just inside, it fails just outside, theory says where."""

import math

import numpy as np
import pytest

from course.charts import build
from course.charts.rigid_body import drift, failures, impacts
from course.charts.rigid_body.failures import LABELS
from course.measure import stability
from course.rigid_body import oscillator, planar
from course.rigid_body.integrators import INTEGRATORS
from tests.budget import sampled

# --- stability limits -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("zeta", sampled([0.0, 0.4, 1.0, 1.7], 2))
@pytest.mark.parametrize("name", failures.contenders())
def test_measured_limit_is_the_theory_and_both_sides_show_it(name, zeta):
    contender = failures.contenders()[name]
    theory = contender.theory(zeta)
    assert failures.deviation(contender.limit(zeta), theory) < 5e-3

    def runs(omega_dt, **options):  # by running on, which knows nothing of matrices
        return stability.is_stable_by_iteration(contender.step(omega_dt, zeta), 2, **options)

    if theory == 0.0:
        # The midpoint rule grows by x^4 / 8 a step only.
        assert not runs(0.2 if "mid" in name else 0.1, steps=3000)
    elif math.isinf(theory):
        assert runs(50.0, steps=300)
    else:
        assert runs(0.995 * theory, steps=1000)
        assert not runs(1.005 * theory, steps=8000, ceiling=1e3)


def test_the_chart_of_limits_shows_both_and_says_the_worst():
    names = ("semi_implicit_euler", "implicit_midpoint", "MuJoCo Euler")
    ours, theirs = build("stability_limits", zetas=(0.0, 0.5), names=names)
    assert [s.key for s in ours.series + theirs.series] == list(names)
    euler, midpoint = ours.series
    assert np.allclose(euler.y, euler.expected, rtol=1e-3) and np.all(np.isinf(midpoint.y))
    lines = theirs.notes
    assert len(lines) == 5 and "none       none" in lines[2] and lines[1].endswith("%")


def test_damping_taken_implicitly_and_explicitly_differ():
    implicit, explicit = (failures.mujoco_theory(1.0, "Euler", flag) for flag in (True, False))
    assert implicit / explicit == pytest.approx((math.sqrt(2.0) + 1.0) ** 2)


@pytest.mark.parametrize("method", LABELS)
def test_the_boundary_of_a_map_is_within_half_a_cell_of_theory(method):
    x, zeta = np.linspace(0.03, 3.9, 130), np.linspace(0.0, 1.9, 20)
    result = failures.growth_map(method, x, zeta)
    assert failures.boundary_error(result, method) <= 0.51
    for i, j in ((3, 10), (15, 60)):
        theory = stability.spectral_radius(oscillator.step_matrix(method, x[j], zeta[i]))
        assert result.values[i, j] == pytest.approx(theory, rel=1e-7)


# --- the stiff spring -----------------------------------------------------------------------------


def test_discrete_is_implicit_euler_on_a_spring_and_pays_half_of_omega_dt_in_damping():
    for x in (0.03, 0.7, 12.0, 900.0):
        result, theory = failures.mujoco_mode("discrete", x), failures.implicit_euler_mode(x)
        assert result.growth == pytest.approx(theory.growth, rel=1e-9)
        assert result.growth == pytest.approx((1.0 + x * x) ** -0.5, rel=1e-9)
        assert result.damping == pytest.approx(theory.damping, rel=1e-6)
        assert result.phase == pytest.approx(theory.phase, rel=1e-6)
    small = failures.mujoco_mode("discrete", 0.02)
    assert small.damping == pytest.approx(0.01, rel=1e-3)
    assert small.phase == pytest.approx(-(0.02**2) / 3.0, rel=1e-3)
    assert abs(failures.mujoco_mode("Euler", 0.02).damping) < 1e-12


@pytest.mark.slow
def test_the_chart_of_the_spring_agrees_with_its_theory():
    growth, middle, right = build("mujoco_stiff_spring", points=13)
    assert growth["discrete"].y[-1] == pytest.approx(1e-3, rel=1e-5)
    assert max(growth["Euler"].y[:5]) == pytest.approx(1.0) and growth["Euler"].y[-1] > 1e5
    series = [middle["discrete"], right["discrete (too low)"], right["Euler (too high)"]]
    for s in series:
        np.testing.assert_allclose(s.y, s.expected, rtol=1e-5)
    assert right["RK4 (too low)"].y[0] < 1e-4 * right["Euler"].y[0]
    assert growth.notes[0].endswith("limit of omega dt 2.0001, theory 2.0000")


# --- long runs ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_only_the_symplectic_keep_their_first_energy_error():
    (panel,) = build("long_run_energy", steps=60_000)
    assert [s.key for s in panel.series] == [*LABELS]
    for series in panel.series:
        early = series.y[np.searchsorted(series.x, 600)]
        if INTEGRATORS[series.key].symplectic:
            assert series.y[-1] < 1.01 * early
        else:
            assert series.y[-1] > 10.0 * early


def test_alternating_steps_on_both_sides_of_the_trace():
    root = math.sqrt(2.0)
    # On the line h1 + h2 = 2 sqrt(2) the product of the steps is the most unstable place near.
    unstable, stable = (root + 0.1, root - 0.1), (root - 0.05, root - 0.05)
    assert drift.pattern_growth(unstable) > 1.0 == drift.pattern_growth(stable)
    energy, growth = drift.measured_pattern(unstable, 400)
    assert growth == pytest.approx(drift.pattern_growth(unstable), rel=5e-3)
    assert energy[-1] > 1e6
    energy, _ = drift.measured_pattern(stable, 4000)
    assert energy.max() < 1e3


@pytest.mark.parametrize("other", [0.4, 0.9, 1.3])
def test_boundary_of_alternating_steps(other):
    # |2 - (a + b)^2 + a^2 b^2| = 2 is a b = 2 + b - a or a b = 2 - b + a, solved for a.
    edge = min(a for a in ((2.0 + other) / (1.0 + other), (2.0 - other) / (other - 1.0)) if a > 0)
    assert edge < 2.0
    measured = stability.limit(
        lambda h: drift.measured_pattern((h, other), 800)[0].max() < 1e6,
        0.8 * edge,
        1.02 * edge,
        rel=1e-3,
    )
    assert measured == pytest.approx(edge, rel=5e-3)


def test_the_chart_of_varying_steps_agrees_with_its_theory():
    pairs, patterns, phase = build("symplectic_not_enough", side=20, cycles=60, periods=400)
    edge = pairs["|trace| = 2"]
    wide = (edge.y > 1.05) & (edge.y < 1.4)  # where it is the first edge from the left
    assert pairs.grid is not None
    measured = pairs.grid.boundary()[wide]
    np.testing.assert_allclose(measured, edge.x[wide], atol=0.051)
    for series in patterns.series[:2]:
        np.testing.assert_allclose(series.y[30:], series.expected[30:], rtol=0.5)
    assert patterns.series[2].theory is None and patterns.series[2].y.max() < 2.0
    theory = {
        "velocity Verlet": 2.0 * math.asin(0.05) / 0.1 - 1.0,
        "semi-implicit Euler": 2.0 * math.asin(0.05) / 0.1 - 1.0,
        "implicit midpoint": 1.0 - 2.0 * math.atan(0.05) / 0.1,
    }
    for label, rate in theory.items():  # the phase error grows linearly at this rate
        slope = np.polyfit(phase[label].x, phase[label].y, 1)[0]
        assert slope == pytest.approx(2.0 * math.pi * rate, rel=5e-3)


def test_small_steps_in_tune_with_the_motion_grow_and_out_of_tune_do_not():
    pattern = drift.resonant_pattern()
    assert max(pattern) == 0.3
    energy, growth = drift.measured_pattern(pattern, 100)
    assert growth == pytest.approx(drift.pattern_growth(pattern), rel=1e-3)
    assert energy[-1] > 1e6
    detuned = [0.3] * 5 + [0.1] * 8
    assert drift.pattern_growth(detuned) == 1.0
    assert drift.measured_pattern(detuned, 500)[0].max() < 2.0


# --- quaternions ----------------------------------------------------------------------------------


@pytest.mark.prove
def test_quaternions_grow_and_lag_as_the_closed_form_says():
    norm_panel, attitude_panel, order_panel = build(
        "quaternion_drift", at_most=100_000, points=3, angles=(1e-3, 2e-2), counts=(500, 1000)
    )
    panels = (norm_panel, attitude_panel)
    for size in ("1 mrad a step", "20 mrad a step"):
        for panel in panels:
            added = panel[f"added, {size}"]
            np.testing.assert_allclose(added.y, added.expected, rtol=1e-4)
        # Rescaled, the length is right and the lag stays; multiplied, both are right.
        rescaled = attitude_panel[f"added and renormalised, {size}"]
        np.testing.assert_allclose(rescaled.y, rescaled.expected, rtol=1e-4)
        assert norm_panel[f"added and renormalised, {size}"].y.max() < 1e-15
        assert max(panel[f"exponential map, {size}"].y.max() for panel in panels) < 1e-11
    assert all(series.y[1] < series.y[0] / 14.0 for series in order_panel.series)
    # Independent of the closed forms: to first order n (h w)^2 / 8 and n (h w)^3 / 12.
    assert drift.added_length(1e-3, 10) - 1.0 == pytest.approx(10 * 1e-6 / 8, rel=1e-5)
    assert drift.added_lag(1e-3, 10) == pytest.approx(10 * 1e-9 / 12, rel=1e-5)
    with pytest.raises(ValueError, match="update"):
        drift.spin_errors("slerp", 1e-2, (1,))


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
    theory = 0.02 / impacts.stopping_time()
    measured = impacts.penetration_speed(0.02, 0.01, dt, False, phases=6)
    assert measured == pytest.approx(theory, rel=0.02)  # the first millimetre is softer
    phases = np.linspace(0.001, 0.999, 6)
    assert impacts.mujoco_through(0.02, 0.01, 0.97 * theory, dt, phases, False) == 0.0
    assert impacts.mujoco_through(0.02, 0.01, 1.03 * theory, dt, phases, False) > 0.0


def test_the_ball_sinks_in_by_a_third_of_the_time_constant_times_its_speed():
    # 0.36 T v in MuJoCo itself, and T / e at critical damping, which 0.95 is not far from.
    assert impacts.stopping_time() == pytest.approx(0.02 / math.e, rel=0.02)
    runner = impacts.mujoco_wall(0.02, 0.01, 2.0, 1e-4, False)
    runner.q0[0] = -0.02
    depth = runner.samples(400).q[0].max() + 0.02
    assert depth == pytest.approx(2.0 * impacts.stopping_time(), rel=0.02)


def test_the_chart_of_tunnelling_agrees_with_its_theory():
    missed_panel, right = build(
        "tunnelling",
        ratios=(0.8, 2.0, 5.0),
        balls=10_000,
        swept=10,
        phases=100,
        steps=(1e-3, 2e-3),
        walls=((0.02, 0.01),),
    )
    for label in ("course, checked", "MuJoCo, one-step"):
        assert missed_panel[label].y == pytest.approx(missed_panel[label].expected, abs=0.02)
    assert missed_panel["impact as an event"].y == [0.0, 0.0, 0.0]
    for label in ("default contact", "one-step contact"):
        assert right[label].y == pytest.approx(right[label].expected, rel=0.04)


# --- rest -----------------------------------------------------------------------------------------


def test_a_box_rests_with_a_rest_speed_and_chatters_without():
    quiet = impacts.our_box_at_rest(0.01, duration=1.0)
    loud = impacts.our_box_at_rest(0.0, duration=1.0)
    late = impacts.our_box_at_rest(0.01, False, duration=1.0)
    assert quiet.impacts_per_second == 0.0 and quiet.noise == 0.0
    assert loud.impacts_per_second > 1000.0 and loud.noise > 1e-3
    assert late.impacts_per_second > 50.0 and late.noise > 1e-3
    assert impacts.mujoco_box_at_rest("Euler", "impulse", 1.0).noise < 1e-5


def test_exact_flight_without_a_rest_speed_mostly_rests_at_0_7_and_mostly_chatters_at_0_4():
    rng, n, dt = np.random.default_rng(0), 20, 2e-3
    starts = np.zeros((6, n))
    starts[1:3] = rng.uniform((0.3, -3.0), (1.0, 3.0), (n, 2)).T

    def share_at_rest(restitution):
        box = planar.box_parameters(restitution=restitution, rest_speed=0.0)
        options = {"integrator": "velocity_verlet"}
        late, _ = planar.advance_boxes(starts, box, dt, 3000, **options)
        _, counts = planar.advance_boxes(late, box, dt, 100, **options)
        return np.mean(counts[0] == 0)

    assert share_at_rest(0.7) > 0.5 > share_at_rest(0.4)


def test_mujocos_default_contact_lies_still_and_its_spring_bounces_less_with_a_smaller_step():
    import mujoco

    joints = "".join(
        f'<joint type="{kind}" axis="{axis}"/>'
        for kind, axis in (("slide", "1 0 0"), ("slide", "0 0 1"), ("hinge", "0 -1 0"))
    )
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/>'
        f'<body pos="0 0 0.3">{joints}<geom type="box" size="0.15 0.1 0.1" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[2] = 0.3
    mujoco.mj_step(model, data, 2500)
    fastest = 0.0
    for _ in range(500):
        mujoco.mj_step(model, data)
        fastest = max(fastest, float(np.abs(data.qvel).max()))
    assert fastest < 1e-6
    # The spring's bounces come from the speed g h that a step adds in the air.
    coarse, fine = (
        impacts.mujoco_box_at_rest("Euler", "spring", 1.0, h).noise for h in (2e-3, 5e-4)
    )
    assert coarse > 5e-3 and fine < 0.5 * coarse


def test_the_chart_of_chatter_counts_every_bounce_and_both_kinds_of_boxes():
    impacts_, speeds, bounces = build("chatter", duration=0.2, points=13)
    assert [len(s.y) for s in impacts_.series] == [5, 3] == [len(s.y) for s in speeds.series]
    assert len({name for s in impacts_.series for name in s.y}) == 8
    theory, every, cut = bounces.series
    assert every.y.tolist() == theory.y.tolist()
    assert cut.y[-1] < every.y[-1] and (cut.y[:4] == every.y[:4]).all()


def test_bounces_pile_up_as_the_geometric_series_says():
    e, end = 0.7, impacts.zeno_end(1.0, 0.7)
    first = math.sqrt(2.0 / 9.80665)
    remaining = np.array([0.3, 1e-2, 1e-4, 1e-6])
    # After n impacts 2 t1 e^n / (1 - e) is left.
    theory = np.floor(1.0 + np.log(remaining * (1.0 - e) / (2.0 * first * e)) / math.log(e) + 1e-12)
    assert impacts.zeno_counts(end - remaining).tolist() == theory.tolist()
    # With a rest speed it ends with the first impact that is slower.
    slowest = math.floor(math.log(0.01 / math.sqrt(2.0 * 9.80665)) / math.log(e)) + 2
    assert abs(impacts.zeno_counts(np.array([end + 1.0]), rest_speed=0.01)[0] - slowest) <= 1
