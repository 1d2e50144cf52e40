"""The probe and its wall: against a tight integration, its own matrix, energy, and MuJoCo."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from course.charts.control import touch as charts
from course.control import Probe, TouchLaw, run_touch
from course.control.sampled import force_limit, held, loop_matrix, passive_stiffness
from course.oracles.mujoco import wall as mujoco

DT = 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.0013, 0.002])
@pytest.mark.parametrize("wall_damping", [0.0, 30.0, 900.0])
def test_touching_and_leaving_is_a_tight_integration(delay, wall_damping):
    probe = Probe(2.0, 5.0, 8e3, wall_damping, 0.003)
    law = TouchLaw(500.0, 20.0, force=3.0)
    run = run_touch(probe, law, 0.01, DT, 0.15, delay=delay, start=(-0.01, 0.3))
    whole = math.floor(delay / DT + 1e-9)
    part = delay - whole * DT
    x = np.array([-0.01, 0.3])
    for k in range(run.command.size):
        for length, at in ((part, k - whole - 1), (DT - part, k - whole)):
            if length < 1e-12:
                continue
            u = run.command[at] if at >= 0 else 0.0

            def rate(_, s, u=u):
                depth = s[0] - 0.003
                push = 8e3 * depth + wall_damping * s[1] if depth > 0.0 else 0.0
                return [s[1], (u - 5.0 * s[1] - push) / 2.0]

            x = solve_ivp(rate, (0.0, length), x, rtol=1e-9, atol=1e-12, max_step=2e-4).y[:, -1]
        assert [run.q[k + 1], run.v[k + 1]] == pytest.approx(x, abs=2e-5)
    assert np.max(run.torque) > 20.0 and np.min(run.torque) == 0.0


def test_a_bounce_without_friction_keeps_its_energy_and_has_the_peak_of_theory():
    probe = Probe(3.0, 0.0, 5e4)
    run = run_touch(probe, TouchLaw(), 0.0, DT, 0.1, start=(-0.01, 0.4))
    assert run.v[-1] == pytest.approx(-0.4, abs=1e-12)
    fine = run_touch(probe, TouchLaw(), 0.0, 1e-5, 0.06, start=(-0.01, 0.4))
    assert np.max(fine.torque) == pytest.approx(0.4 * math.sqrt(3.0 * 5e4), rel=1e-5)


@pytest.mark.parametrize(
    "law",
    [
        TouchLaw(2000.0, 180.0, 1000.0, force_gain=0.05),
        TouchLaw(4e4, 800.0, 1000.0, mass=2.0, give=50.0, hold=300.0),
    ],
)
@pytest.mark.parametrize("delay", [0.0, 0.0013, 0.002])
def test_in_contact_the_loop_is_its_matrix(law, delay):
    probe = Probe(surface=-0.1, wall_damping=15.0)
    runs = [run_touch(probe, law, 0.0, DT, 0.1, delay=delay, start=(x, 0.0)).q for x in (1e-3, 0.0)]
    plant = held(*probe.system(), DT, delay)
    matrix = loop_matrix(plant, law.linear(probe, DT))
    state = np.zeros(len(matrix))
    state[0] = 1e-3
    for difference in runs[0] - runs[1]:
        assert state[0] == pytest.approx(difference, abs=1e-12)
        state = matrix @ state


# --- limits, both sides ---------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("wall", [1e3, 1e5])
def test_the_force_loops_limit_is_theorys_and_mujocos(wall):
    edge = charts.force_edge(wall)
    assert edge == pytest.approx(force_limit(20.0, wall, 2.5e-3), rel=0.12)
    for factor, stays in ((0.95, True), (1.05, False)):
        law = TouchLaw(force=50.0, force_gain=factor * edge)
        start = (50.0 / wall * 1.02, 0.0)
        force = run_touch(Probe(wall=wall), law, 0.0, DT, 12.0, delay=2e-3, start=start).torque - 50
        first, last = np.max(np.abs(force[100:600])), np.max(np.abs(force[-500:]))
        assert (last < first) == stays
    assert charts.force_edge_mujoco(wall, 2e-3, "spring", 10) == pytest.approx(edge, rel=0.03)


@pytest.mark.prove
def test_a_simulated_contact_passes_the_command_on():
    spring, contact = (charts.force_edge_mujoco(1e5, 2e-3, kind) for kind in ("spring", "contact"))
    assert contact == pytest.approx(1.0 / 0.9, rel=0.02) and contact > 10.0 * spring
    # but on a wall so hard and a loop so late that what is left of the spring rings
    assert charts.force_edge_mujoco(1e6, 4e-3, "contact") < 0.1
    soft = charts.force_edge_mujoco(1e5, 2e-3, "contact", 10, 0.02)
    assert soft == pytest.approx(charts.force_edge(1e5), rel=0.05)


@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_own_friction_carries_the_passive_stiffness_at_every_wall(delay):
    bound = passive_stiffness(20.0, DT, delay)
    for wall in (10.0, 1e3, 1e5, 1e6):
        assert charts.growth(TouchLaw(0.99 * bound), wall, delay) <= 1.0 + 1e-9
    assert charts.growth(TouchLaw(1.05 * bound), 1e3, delay) > 1.0


def test_admittance_grows_heavier_with_the_wall():
    masses = [charts.lightest(wall) for wall in (1e3, 1e4, 1e5)]
    assert masses[0] < 0.1 < masses[1] < 3.0 < masses[2] < 4.0


# --- the scene and its table ----------------------------------------------------------------------


def test_the_scene_fits_its_question():
    assert charts.touch_scene().check() == []


@pytest.mark.parametrize("name", charts.REGIMES)
def test_each_row_of_the_regimes_says_what_was_measured(name):
    result, law, text = charts.row(name), charts.REGIMES[name], charts.sentence(name)
    for figure in (
        f"{result['off_n']:+.1f} N",
        f"{result['peak_n']:.0f} N",
        f"x{result['margin']:.1f}",
        f"{result['rate_hz']:.0f} Hz",
    ):
        assert figure in text
    theory = charts.series_stiffness(law) if law.stiffness and not law.mass else 0.0
    assert result["off_n"] == pytest.approx(theory, rel=0.02, abs=0.01)
    assert result["margin"] > 2.0 and 1.0 < result["rate_hz"] < 500.0
    if name not in charts.TANGENT:  # both sides of the least rate
        slow, fast = (
            [charts.growth(law, charts.WALL, dt=1.0 / (f * result["rate_hz"])) for f in factors]
            for factors in ([0.97], np.geomspace(1.03, 10.0, 9))
        )
        assert max(fast) <= 1.0 < min(slow)


def test_what_the_regimes_are_for():
    rows = {name: charts.row(name) for name in charts.REGIMES}
    stiff, soft, press, both = (
        rows[n] for n in ("stiff position", "soft impedance", "force", "hybrid")
    )
    assert stiff["peak_n"] > 3.0 * soft["peak_n"]
    assert stiff["free_mm"] < 0.5 * soft["free_mm"] and math.isnan(press["free_mm"])
    assert both["free_mm"] == stiff["free_mm"] and both["off_n"] == press["off_n"]
    assert both["margin"] <= press["margin"] and both["rate_hz"] >= press["rate_hz"]


def test_mujocos_probe_rests_where_the_force_says():
    for kind, impedance in (("spring", 0.9), ("contact", 0.9), ("contact", 0.02)):
        probe = mujoco.Probe(4.0, 400.0, 1e4, DT, wall=kind, impedance=impedance)
        for _ in range(8000):
            force = probe.step(20.0)
        assert force == pytest.approx(20.0, abs=1e-3)
        assert probe.x == pytest.approx(20.0 / 1e4, rel=1e-3)
    probe.reset(-0.1)
    assert probe.step(0.0) == 0.0  # away from the wall nothing pulls


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: Probe(mass=0.0), "mass"),
        (lambda: Probe(wall=-1.0), "wall"),
        (lambda: Probe(surface=math.nan), "surface"),
        (lambda: TouchLaw(-1.0), "stiffness"),
        (lambda: TouchLaw(force=math.inf), "force"),
        (lambda: run_touch(Probe(), TouchLaw(), 0.0, 0.0, 1.0), "dt"),
        (lambda: run_touch(Probe(), TouchLaw(), np.zeros(3), DT, 1.0), "target.shape"),
        (lambda: run_touch(Probe(), TouchLaw(), 0.0, DT, 1.0, delay=-1.0), "delay"),
        (lambda: mujoco.Probe(1.0, 0.0, 1e3, DT, wall="rubber"), "wall"),
        (lambda: mujoco.Probe(1.0, 0.0, 1e3, DT, impedance=1.0), "impedance"),
    ],
)
def test_wrong_numbers_are_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
