"""Estimates against closed forms, exact probabilities and simulations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import binom

from course.interview import estimates as e
from course.interview import fields
from tests.budget import examples

SOME = st.floats(0.05, 20.0)


def test_the_load_of_a_fleet_is_a_product() -> None:
    assert e.readings_per_s(3, 2, 100.0, 10.0, 4.0) == 3 * 2 * 100 * 10 * 4


@examples(50)
@given(
    st.integers(1, 400), st.integers(1, 3), st.floats(1.0, 300.0), st.floats(0, 60), st.floats(1, 9)
)
@example(40, 1, 480.0, 120.0, 1.0)  # ten turns each, and none left over
def test_the_workers_are_just_enough(scenarios, repeats, scenario_s, start_s, night_h) -> None:
    """Runs are handed out one by one, each to the worker that is free first."""
    needed = e.workers(scenarios, scenario_s, start_s, 2.0, night_h, repeats)

    def ends(hands: int) -> float:
        return math.ceil(scenarios * repeats / hands) * (scenario_s / 2.0 + start_s)

    assert ends(needed) <= 3600.0 * night_h * (1.0 + 1e-11)
    assert needed == 1 or ends(needed - 1) > 3600.0 * night_h * (1.0 + 1e-12)


def test_a_night_too_short_for_one_scenario_is_refused() -> None:
    with pytest.raises(ValueError, match=r"night_h must be 1.01 or more.*, got 1.0"):
        e.workers(10, 3600.0, 36.0, 1.0, 1.0)


@pytest.mark.parametrize(("gate", "true"), [(0.7, 0.8), (0.7, 0.9), (0.5, 0.6), (0.9, 0.95)])
def test_the_trials_of_a_gate_have_the_power_they_promise(gate: float, true: float) -> None:
    """The exact test: passed by so many that one at the gate has them in 5 % of all cases."""
    powers = []
    for n in range(e.trials_for_gate(gate, true), e.trials_for_gate(gate, true) + 12):
        bar = binom.isf(0.05, n, gate) + 1
        powers.append(binom.sf(bar - 1, n, true))
    assert np.mean(powers) == pytest.approx(0.8, abs=0.05)


def test_the_trials_of_two_policies_have_the_power_they_promise() -> None:
    """Every pair of counts, weighed by its probability, and the test with the pooled share."""
    n = e.trials_each(0.7, 0.8)
    k = np.arange(n + 1)
    pooled = (k[:, None] + k) / (2 * n)
    with np.errstate(invalid="ignore"):
        z = np.abs(k[:, None] - k) / np.sqrt(2 * n * pooled * (1 - pooled))
    power = binom.pmf(k, n, 0.7) @ (z > 1.959964) @ binom.pmf(k, n, 0.8)
    assert power == pytest.approx(0.8, abs=0.01)


def test_the_width_of_an_interval_is_the_one_of_its_equation() -> None:
    """Wilson's ends are the shares p at which |share - p| is 1.96 spreads of p."""
    half, n, z = e.half_width(0.7, 100), 100, 1.959963984540054
    roots = np.roots([1 + z * z / n, -(2 * 0.7 + z * z / n), 0.49])
    assert half == pytest.approx(0.5 * np.ptp(roots), rel=1e-12)
    least = e.trials_for_width(0.7, 0.05)
    assert e.half_width(0.7, least) <= 0.05 < e.half_width(0.7, least - 1)


@examples(30)
@given(st.floats(0.01, 3.0), st.floats(0.1, 3.0), st.floats(0.2, 10.0))
def test_no_motion_within_the_limits_is_faster_and_this_one_keeps_them(leg, top, rise) -> None:
    """The fastest speed at each place is the least of three limits; its way is summed up."""
    x = np.linspace(0.0, leg, 20_001)
    middle = 0.5 * (x[1:] + x[:-1])
    speed = np.minimum(top, np.sqrt(2.0 * rise * np.minimum(middle, leg - middle)))
    assert e.motion_s([leg], top, rise) == pytest.approx(np.sum(np.diff(x) / speed), rel=5e-3)


def test_what_computing_has_is_what_goes_without_it() -> None:
    case = e.ESTIMATES["cycle"]
    share = 1.0 - case.value(computing_s=0.0) / case.value()
    assert e.ESTIMATES["computing_share"].value() == pytest.approx(share, rel=1e-12)
    assert case.value() == e.motion_s([0.6, 0.15, 0.15] * 2, 1.0, 3.0) + 0.6 + 0.3


def test_two_spreads_leave_out_so_many_on_the_side_of_the_bias() -> None:
    rng = np.random.default_rng(3)
    spreads, biases = np.array([0.7, 1.6, 0.5]), [2.0, -0.5]
    drawn = (rng.standard_normal((400_000, 3)) * spreads).sum(axis=1) + sum(biases)
    assert np.mean(drawn > e.error_mm(spreads, biases)) == pytest.approx(0.02275, abs=1e-3)


def test_from_the_camera_to_the_finger_through_a_real_projection() -> None:
    """A point is projected, its pixel disturbed, brought back, turned and moved, many times."""
    rng = np.random.default_rng(4)
    n, reach, focal, turn, arm = 400_000, 0.8, 600.0, 2e-3, 0.5e-3
    u = focal * 0.0 / reach + 0.5 * rng.standard_normal(n)
    angle = turn * rng.standard_normal(n)
    x = np.cos(angle) * reach * u / focal + np.sin(angle) * reach + arm * rng.standard_normal(n)
    report = e.finger_error_mm(reach, 0.5, focal, 1e3 * turn, 1e3 * arm, 0.0, 100.0)
    assert report == pytest.approx(2e3 * x.std(), rel=5e-3)
    late = e.finger_error_mm(reach, 0.5, focal, 1e3 * turn, 1e3 * arm, 0.02, 100.0)
    assert late - report == pytest.approx(2.0)


@examples(50)
@given(SOME, st.floats(0.1, 1.5), st.floats(0.0, 20.0), st.integers(1, 5))
def test_the_grip_just_holds_without_safety(mass, friction, rise, fingers) -> None:
    force = e.grip_force_n(mass, friction, rise, safety=1.0, fingers=fingers)
    assert fingers * friction * force - mass * 9.81 == pytest.approx(mass * rise, abs=1e-9 * mass)
    assert e.grip_force_n(mass, friction, rise, 3.0, fingers) == pytest.approx(3.0 * force)


@examples(30)
@given(st.floats(0.1, 5.0), st.floats(0.0, 900.0))
def test_a_late_sine_is_as_wrong_as_its_samples(frequency, delay_ms) -> None:
    t = np.linspace(0.0, 1.0 / frequency, 2001)
    late = np.sin(2 * np.pi * frequency * (t - 1e-3 * delay_ms))
    worst = 7.0 * np.abs(np.sin(2 * np.pi * frequency * t) - late).max()
    assert e.sine_error_mm(7.0, frequency, delay_ms) == pytest.approx(worst, abs=1e-4)
    ramp = e.tracking_error_mm(2e-3 * np.pi * frequency * 7.0, delay_ms)
    assert ramp >= e.sine_error_mm(7.0, frequency, delay_ms) - 1e-9  # the sine's highest speed


@examples(20)
@given(st.floats(0.05, 3.0), st.floats(0.0, 0.5), st.floats(0.5, 8.0), st.floats(0.0, 2.0))
def test_who_stops_at_the_gap_stops_before_the_person(speed, reaction, brake, walk) -> None:
    t = np.linspace(0.0, reaction + speed / brake, 20_001)
    now = np.where(t < reaction, speed, speed - brake * (t - reaction))
    distance = np.trapezoid(now, t)
    assert e.stopping_m(speed, reaction, brake) == pytest.approx(distance, rel=1e-3)
    gap = e.separation_m(walk, speed, reaction, brake, 0.1)
    assert gap - distance - walk * t[-1] == pytest.approx(0.1, abs=1e-3 * (1 + distance))


@examples(15)
@given(st.floats(0.05, 2.0), st.floats(1e3, 1e5), SOME, st.floats(0.1, 50.0))
def test_the_peak_force_is_that_of_two_masses_and_a_spring(v, k, robot, body) -> None:
    def rates(_: float, y: np.ndarray) -> list[float]:
        force = k * (y[0] - y[1])
        return [y[2], y[3], -force / robot, force / body]

    half = math.pi * math.sqrt(robot * body / (robot + body) / k)
    run = solve_ivp(rates, (0.0, half), [0, 0, v, 0], rtol=1e-9, atol=1e-12, max_step=half / 500)
    peak = k * (run.y[0] - run.y[1]).max()
    assert e.contact_force_n(v, k, robot, body) == pytest.approx(peak, rel=1e-4)
    assert e.contact_force_n(v, k, robot) > e.contact_force_n(v, k, robot, body)


# The power of the result in the factor, as the units of it say.
@pytest.mark.parametrize(
    ("name", "given", "power"),
    [
        ("rays", "hertz", 1),
        ("samples_billion", "samples", 1),
        ("grip_force", "mass_kg", 1),
        ("grip_force", "friction", -1),
        ("contact_free", "speed_m_per_s", 1),
        ("late_ramp", "delay_ms", 1),
        ("contact_free", "stiffness_n_per_m", 0.5),
        ("contact_clamped", "robot_kg", 0.5),
    ],
)
def test_a_result_scales_with_an_input(name: str, given: str, power: float) -> None:
    case = e.ESTIMATES[name]
    twice = case.value(**{given: 2.0 * case.given()[given]})
    assert twice / case.value() == pytest.approx(2.0**power, rel=1e-12)


@pytest.mark.parametrize("name", e.ESTIMATES)
def test_every_case_fills_a_field_and_shows_its_inputs(name: str) -> None:
    case = e.ESTIMATES[name]
    text = fields.filled(f"{{estimate.{name}:.6g}}", lambda *_: 0.0)
    assert float(text) == pytest.approx(case.value(), rel=1e-5) and case.value() > 0.0
    assert all(f"  {given} " in str(case) for given in case.inputs)
    with pytest.raises(ValueError, match=r"input must be one of.*, got 'colour'"):
        case.value(colour=1.0)


def test_hours_are_counted_with_the_rate_that_was_measured() -> None:
    case = e.ESTIMATES["samples_loop"].given()
    hours = e.ESTIMATES["samples_loop"].value()
    assert hours * 3600.0 * case["samples_per_s"] == pytest.approx(case["samples"])
    assert case["samples_per_s"] == fields.chart("vector_env/0/ProcessVectorEnv/y/max")
