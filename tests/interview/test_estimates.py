"""Estimates against closed forms, exact probabilities and simulations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import binom, binomtest

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


def test_pairs_have_the_power_they_promise() -> None:
    """McNemar's statistic over every count of pairs that disagree, weighed by its probability."""
    case = e.ESTIMATES["pairs"]
    given, n = case.given(), int(case.value())
    won = given["second_share"] - given["together"]
    apart = won + given["first_share"] - given["together"]
    assert apart == pytest.approx(0.1)
    power = 0.0
    for pairs in range(1, n + 1):
        k = np.arange(pairs + 1)
        noticed = np.abs(2 * k - pairs) / np.sqrt(pairs) > 1.959964
        power += binom.pmf(pairs, n, apart) * binom.pmf(k, pairs, won / apart)[noticed].sum()
    # The normal approximation, of a count of thirty or so.
    assert power == pytest.approx(0.8, abs=0.03)


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


# --- What the model answers compute ---------------------------------------------------------------


@examples(30)
@given(st.integers(1, 300), st.floats(0.0, 1.0))
def test_the_ends_of_an_interval_are_those_of_scipy(trials: int, part: float) -> None:
    solved = round(part * trials)
    right = binomtest(solved, trials).proportion_ci(0.95, "wilson")
    ends = e.wilson_low(solved, trials), e.wilson_high(solved, trials)
    np.testing.assert_allclose(ends, (right.low, right.high), atol=1e-12)


@pytest.mark.parametrize(("gate", "n"), [(0.7, 100), (0.7, 119), (0.83, 155), (0.5, 12)])
def test_a_bar_is_the_least_count_that_chance_rarely_reaches(gate: float, n: int) -> None:
    """Binomial probabilities written out as a sum."""

    def tail(least: int, p: float) -> float:
        return sum(math.comb(n, k) * p**k * (1 - p) ** (n - k) for k in range(least, n + 1))

    bar = e.bar_for_gate(gate, n)
    assert tail(bar, gate) <= 0.05 < tail(bar - 1, gate)
    assert e.chance_at_gate(gate, bar, n) == pytest.approx(tail(bar, gate), rel=1e-9)
    better = 0.5 * (1.0 + gate)
    assert e.gate_power(gate, better, n) == pytest.approx(tail(bar, better), rel=1e-9)


def test_objects_that_are_alike_are_counted_as_the_policy_fails_on_them() -> None:
    """Each object has a rate of its own, beta distributed; trials of it share that rate."""
    rng = np.random.default_rng(8)
    likeness, each, n = 0.3, 5, e.objects_for_gate(0.7, 0.8, 5, 0.3)
    total = 1.0 / likeness - 1.0

    def means(share: float) -> np.ndarray:
        rates = rng.beta(share * total, (1.0 - share) * total, (20_000, n))
        return rng.binomial(each, rates).mean(axis=1) / each

    bar = np.quantile(means(0.7), 0.95)
    assert np.mean(means(0.8) > bar) == pytest.approx(0.8, abs=0.04)
    assert e.objects_for_gate(0.7, 0.8, 1, 0.9) == e.trials_for_gate(0.7, 0.8)


def test_nothing_seen_is_a_bound_and_no_zero() -> None:
    assert (1.0 - e.most_unseen(100)) ** 100 == pytest.approx(0.05)
    rng = np.random.default_rng(9)
    first = rng.exponential(8.0, 200_000)  # a mean of just what is to be shown
    assert np.mean(first > e.faultless_h(8.0)) == pytest.approx(0.05, abs=2e-3)
    quiet = rng.exponential(e.mean_time_h(8.0, 0.9), 200_000)
    assert np.mean(quiet > 8.0) == pytest.approx(0.9, abs=3e-3)


def test_shifts_without_a_call_show_nine_of_ten() -> None:
    n = e.faultless_trials(0.1)
    assert 0.9**n <= 0.05 < 0.9 ** (n - 1)
    # The answers say: three times in four with ninety-nine quiet shifts of a hundred.
    assert n == e.ESTIMATES["quiet_shifts"].value() and 0.99**n == pytest.approx(0.75, abs=0.01)
    # And with a mean of one shift between calls, most shifts have one.
    assert math.exp(-1.0) < 0.5


def test_pairs_stop_a_release_that_is_worse_and_pass_an_equal_one() -> None:
    """The difference of paired runs: +1, -1 or 0, against its own spread."""
    margin, disagree, n = 0.03, 0.1, e.pairs_not_worse(0.03, 0.1)
    rng = np.random.default_rng(14)

    def passes(loss: float) -> float:
        shares = [0.5 * (disagree - loss), 0.5 * (disagree + loss), 1.0 - disagree]
        won, lost, _ = rng.multinomial(n, shares, 100_000).T
        mean = (won - lost) / n
        spread = np.sqrt(((won + lost) / n - mean**2) / n)
        return float(np.mean(mean - 1.6449 * spread > -margin))

    assert passes(0.0) == pytest.approx(0.8, abs=0.02)
    assert passes(margin) == pytest.approx(0.05, abs=0.01)
    assert n < e.ESTIMATES["night_workers"].given()["scenarios"]


def test_powers_of_ten_are_times() -> None:
    assert e.times_more(2.0) == pytest.approx(100.0)


def test_a_difference_that_is_detectable_is_detected_four_times_in_five() -> None:
    n, p = 320, 0.9
    spread = math.sqrt(p * (1 - p) / n)
    counts = np.random.default_rng(10).binomial(n, p - e.detectable(p, n), 100_000) / n
    assert np.mean(np.abs(counts - p) > 1.96 * spread) == pytest.approx(0.8, abs=0.04)


def test_misses_cost_cycles_and_come_in_rows() -> None:
    rng = np.random.default_rng(11)
    given: dict[str, Any] = {"legs_m": [0.6, 0.15], "top_m_per_s": 1.0, "rise_m_per_s2": 3.0}
    given |= {"still_s": 0.6, "computing_s": 0.3}
    needed = e.success_needed(2.5, **given)
    tries = rng.geometric(needed, 200_000)
    assert tries.mean() * e.cycle_s(**given) == pytest.approx(2.5, rel=0.01)
    assert e.part_s(needed, **given) == pytest.approx(2.5)
    assert e.leg_s(0.6, 1.0, 3.0) + e.leg_s(0.15, 1.0, 3.0) + 0.9 == pytest.approx(
        e.cycle_s(**given)
    )
    missed = rng.uniform(size=2_000_000) < 0.3
    waits, row, count = [], 0, 0
    for miss in missed:
        count, row = count + 1, row + 1 if miss else 0
        if row == 3:
            waits.append(count)
            count = row = 0
    assert np.mean(waits) == pytest.approx(e.picks_to_call(0.7, 3), rel=0.02)


def test_machines_and_cores_are_products() -> None:
    # A tenth of 1000 a second, halved: 20 000 s each, six of them, in ten hours.
    assert e.machines(1e6, 1000.0, 1.0, 2.0, 6, 10.0) == math.ceil(6 * 20_000 / 36_000)
    assert e.cores(5, 0.8, 2.0, 24) == pytest.approx(192.0)


def test_a_person_who_enters_at_the_worst_moment_is_noticed_in_time() -> None:
    """Scans at fixed times; the field wants two that see the person, then the outputs follow."""
    enters = np.random.default_rng(13).uniform(1.0, 2.0, 50_000)
    second = (np.floor(30.0 * enters) + 2.0) / 30.0  # the scan after the next has seen all of it
    delays = second + 0.11 - enters
    worst = e.reaction_s(2, 30.0, 40.0, 10.0, 60.0)
    assert delays.max() <= worst and delays.max() == pytest.approx(worst, abs=1e-3)
    walked = e.walked_m(1.5, 1.5, 0.2, 2.0)
    alone = e.stopping_m(1.5, 0.2, 2.0)
    assert e.separation_m(1.5, 1.5, 0.2, 2.0, 0.1) == pytest.approx(walked + alone + 0.1)


def test_a_base_tips_when_its_weight_no_longer_holds_it_down() -> None:
    mass, half, height = 80.0, 0.25, 0.9
    braking = e.tipping_m_per_s2(half, height)
    assert mass * braking * height == pytest.approx(mass * 9.81 * half)


def test_the_inputs_of_one_answer_agree_with_each_other() -> None:
    cases = e.ESTIMATES
    given = {name: case.given() for name, case in cases.items()}
    for name in ("separation", "separation_half", "stopping", "stopping_fast", "walked"):
        assert cases["reaction"].value() <= given[name]["reaction_s"]
        assert given[name]["braking_m_per_s2"] < cases["tipping"].value()
    late = given["separation_late"]["reaction_s"] - given["separation"]["reaction_s"]
    assert late == pytest.approx(0.1)
    objects = cases["hand_objects"]
    assert given["hand_trials_h"]["samples"] == objects.value() * objects.given()["trials_each"]
    # A blow has the closing speed: the walk alone if the base stands, both if it drives.
    both = given["separation"]
    assert given["contact_standing"]["speed_m_per_s"] == both["person_m_per_s"]
    closing = both["person_m_per_s"] + both["robot_m_per_s"]
    assert given["contact_base_fast"]["speed_m_per_s"] == closing
    assert given["grip_force_better"]["rise_m_per_s2"] == given["cycle_better"]["rise_m_per_s2"]
    for name in ("gate_trials", "bin_trials"):
        assert given[f"{name}_bar"]["trials"] == cases[name].value()
        assert given[f"{name}_bar"]["gate_share"] == given[name]["gate_share"]
    assert given["bin_trials"]["gate_share"] == pytest.approx(
        cases["success_better"].value(), abs=2e-3
    )
    assert given["software_cores"]["workers"] == cases["night_workers"].value()
    assert given["hall_detects"]["trials"] == cases["width_trials"].value()
    assert (
        given["gate_bar"]["trials"] == given["gate_low"]["trials"] == given["gate_power"]["trials"]
    )
    assert cases["gate_bar"].value() == given["gate_low"]["solved"]
