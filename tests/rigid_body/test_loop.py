"""The fixed-step loop: exact counts, exact repetition, delays, interpolation, lost time."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body.loop import (
    Advance,
    FixedStepLoop,
    Phases,
    exact_seconds,
    float_clock_error,
    flow_diagram,
    interpolate_linearly,
    run,
    trace_table,
)
from tests.budget import examples


def counting(state, force, dt):
    return state + 1


def oscillator_loop(log, **settings):
    """An oscillator under a controller; `log` gets every state, command and picture."""

    def integrate(state, force, dt):
        x, v = state
        v = v + dt * (force - 40.0 * x)
        new = np.array([x + dt * v, v])
        log.append(("state", new.tobytes()))
        return new

    def control(measurement, image, time):
        observed = 0.0 if image is None else image.data
        command = -3.0 * measurement[1] - 0.1 * observed
        log.append(("command", time, command))
        return command

    phases = Phases(
        integrate=integrate,
        control=control,
        camera=lambda state, time: float(state[0]),
        render=lambda state, time: log.append(("picture", time, state.tobytes())),
    )
    defaults: dict[str, Any] = {
        "initial_command": 0.0,
        "camera_delay": "0.02",
        "actuation_delay": "0.0015",
    }
    return FixedStepLoop(np.array([0.3, -1.0]), phases, **(defaults | settings))


@pytest.mark.prove
def test_an_hour_has_the_exact_number_of_steps_and_pictures():
    loop = FixedStepLoop(0, Phases(integrate=counting), max_frame=None)
    done = loop.advance(3600)
    assert (done.steps, done.pictures) == (3_600_000, 216_000)
    assert (done.controls, done.images) == (1_800_000, 108_000)
    assert loop.state == 3_600_000
    assert loop.time == 3600.0
    assert done.alpha == 0.0
    assert done.dropped == 0.0


def test_counts_stay_exact_when_frames_come_as_floating_point_sixtieths():
    loop = FixedStepLoop(0, Phases(integrate=counting), physics_dt=0.01, control_period=0.01)
    real = Fraction(0)
    for _ in range(5000):
        loop.advance(1 / 60)
        real += Fraction(1 / 60)
    assert loop.totals.steps == real // Fraction(1, 100)
    assert loop.totals.pictures == real // Fraction(1, 60)


@examples(60)
@given(st.lists(st.floats(min_value=0.0, max_value=0.2), min_size=1, max_size=12))
def test_how_real_time_is_cut_changes_nothing_bit_for_bit(frames):
    cut: list = []
    whole: list = []
    loop = oscillator_loop(cut)
    for frame in frames:
        loop.advance(frame)
    other = oscillator_loop(whole, max_frame=None)
    other.advance(sum(map(Fraction, frames)))
    assert cut == whole
    assert loop.totals == other.totals


def test_phases_run_in_order_within_a_step():
    order = []

    def named(name, result):
        def phase(*arguments):
            order.append(name)
            return result

        return phase

    phases = Phases(
        integrate=named("integrate", 1.0),
        sense=named("sense", 1.0),
        camera=named("camera", 1.0),
        control=named("control", 1.0),
        apply_forces=named("apply forces", 1.0),
        detect_collisions=named("detect collisions", 1.0),
        render=named("render", None),
    )
    loop = FixedStepLoop(
        0.0,
        phases,
        physics_dt="0.01",
        control_period="0.01",
        camera_period="0.02",
        render_period="0.01",
        record=True,
    )
    loop.advance(0.0200001)
    step = ["sense", "control", "apply forces", "integrate", "detect collisions", "render"]
    assert order == ["camera", *step, *step]
    assert [event.phase for event in loop.trace] == order


def test_control_is_held_between_its_ticks():
    forces = []

    def integrate(state, force, dt):
        forces.append(force)
        return state + 1

    phases = Phases(integrate=integrate, control=lambda measurement, image, time: measurement)
    loop = FixedStepLoop(0, phases, physics_dt="0.001", control_period="0.004")
    loop.advance(Fraction(13, 1000))
    assert forces == [0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12]


def test_a_control_rate_that_does_not_divide_the_physics_rate_is_right_on_average():
    times = []
    phases = Phases(integrate=counting, control=lambda measurement, image, time: times.append(time))
    loop = FixedStepLoop(0, phases, control_period=Fraction(1, 300), max_frame=None)
    loop.advance(100)
    assert len(times) == 30_000
    jitter = np.array(times) - np.arange(30_000) / 300
    assert jitter.min() > -1e-12
    assert jitter.max() < 0.001
    assert times[:4] == [0.0, 0.004, 0.007, 0.01]


@pytest.mark.parametrize("delay_steps", [0, 1, 2, 5])
def test_sensing_acts_after_the_stated_number_of_steps(delay_steps):
    applied = []
    phases = Phases(
        integrate=counting,
        control=lambda measurement, image, time: measurement,
        apply_forces=lambda state, command, time: applied.append((state, command)),
    )
    loop = FixedStepLoop(
        0,
        phases,
        control_period="0.001",
        actuation_delay=Fraction(delay_steps, 1000),
        record=True,
    )
    loop.advance(Fraction(20, 1000))
    assert applied[:delay_steps] == [(n, None) for n in range(delay_steps)]
    assert applied[delay_steps:] == [(n, n - delay_steps) for n in range(delay_steps, 20)]
    ages = [e.time - e.state_time for e in loop.trace if e.phase == "apply forces"]
    assert ages[delay_steps:] == pytest.approx([delay_steps / 1000] * (20 - delay_steps), abs=1e-15)


def test_a_delay_between_two_steps_ends_at_the_next_one():
    applied = []
    phases = Phases(
        integrate=counting,
        control=lambda measurement, image, time: measurement,
        apply_forces=lambda state, command, time: applied.append(command),
    )
    loop = FixedStepLoop(0, phases, control_period="0.001", actuation_delay="0.0015")
    loop.advance(Fraction(5, 1000))
    assert applied == [None, None, 0, 1, 2]


def test_an_image_reaches_control_after_the_camera_delay():
    observed: list = []

    def control(measurement, image, time):
        observed.append((time, None if image is None else image.time))
        return 0.0

    loop = FixedStepLoop(
        0,
        Phases(integrate=counting, control=control),
        control_period="0.005",
        camera_period="0.02",
        camera_delay="0.032",
    )
    loop.advance(Fraction(1, 10))
    assert observed[:7] == [(k * 5 / 1000, None) for k in range(7)]
    for time, exposure in observed[7:]:
        # Delivered at the first control tick from 32 ms on; then ages until the next delivery.
        assert 0.032 - 1e-12 <= time - exposure < 0.032 + 0.02 + 1e-12
        assert exposure * 50 == pytest.approx(round(exposure * 50), abs=1e-12)
    assert observed[7] == (0.035, 0.0)
    assert observed[11] == (0.055, 0.02)


def test_a_picture_shows_the_motion_one_step_before_its_own_time():
    shown = []
    phases = Phases(integrate=counting, render=lambda state, time: shown.append((state, time)))
    loop = FixedStepLoop(0.0, phases, max_frame=None)
    loop.advance(1)
    states, times = np.array(shown).T
    np.testing.assert_allclose(times, np.arange(1, 61) / 60 - 0.001, atol=1e-15)
    # The state counts steps, so the state that is shown must be the time in milliseconds.
    np.testing.assert_allclose(states, 1000 * times, rtol=0, atol=1e-9)


def test_pictures_may_be_faster_than_physics():
    shown = []
    phases = Phases(integrate=counting, render=lambda state, time: shown.append(state))
    loop = FixedStepLoop(
        0.0,
        phases,
        physics_dt="0.02",
        control_period="0.02",
        render_period=Fraction(1, 200),
        max_frame=None,
    )
    loop.advance(Fraction(1, 10))
    assert shown == [0, 0, 0, *(n / 4 for n in range(17))]


def test_interpolation_error_is_second_order_and_within_its_bound():
    omega = 7.0
    errors = []
    steps = [Fraction(1, 50), Fraction(1, 100), Fraction(1, 200), Fraction(1, 400)]
    for dt in steps:
        worst = [0.0]

        def render(state, time, worst=worst):
            worst[0] = max(worst[0], abs(state[0] - math.sin(omega * time)))

        def integrate(state, force, dt):
            n = state[1] + 1
            return np.array([math.sin(omega * n * dt), n])

        loop = FixedStepLoop(
            np.zeros(2),
            Phases(integrate=integrate, render=render),
            physics_dt=dt,
            control_period=dt,
            render_period=Fraction(1, 61),
            max_frame=None,
        )
        loop.advance(20)
        errors.append(worst[0])
        assert worst[0] <= (omega * float(dt)) ** 2 / 8
    order = np.polyfit(np.log(np.array(steps, dtype=float)), np.log(errors), 1)[0]
    print(f"interpolation error {errors}, order {order:.3f}")
    assert order == pytest.approx(2.0, abs=0.05)


def test_without_interpolation_the_error_is_first_order():
    """The reason to interpolate: holding the last state is wrong by up to speed times dt."""
    errors = []
    for dt in (Fraction(1, 100), Fraction(1, 400)):
        worst = [0.0]

        def render(state, time, worst=worst):
            worst[0] = max(worst[0], abs(state - time))

        loop = FixedStepLoop(
            0.0,
            Phases(
                integrate=lambda state, force, dt: state + dt,
                render=render,
                interpolate=lambda previous, current, alpha: previous,
            ),
            physics_dt=dt,
            control_period=dt,
            render_period=Fraction(1, 61),
            max_frame=None,
        )
        loop.advance(5)
        errors.append(worst[0])
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_time_beyond_the_bound_is_dropped_and_reported():
    loop = FixedStepLoop(0, Phases(integrate=counting), max_frame="0.25", record=True)
    first = loop.advance(1.0)
    assert first.steps == 250
    assert first.dropped == 0.75
    second = loop.advance(0.1)
    assert (second.steps, second.dropped) == (100, 0.0)
    loop.advance(0.5)
    assert loop.dropped == 1
    assert loop.totals.dropped == 1.0
    assert loop.time == pytest.approx(0.6, abs=1e-15)
    assert [e.phase for e in loop.trace].count("dropped") == 2
    assert "dropped" in trace_table(loop.trace)


class SlowMachine:
    """A clock that only the work itself moves: each physics step costs `cost` seconds."""

    def __init__(self, cost):
        self.now = 0.0
        self.cost = cost
        self.slept = 0.0

    def integrate(self, state, force, dt):
        self.now += self.cost
        return state + 1

    def clock(self):
        self.now += 1e-6
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        self.slept += seconds


def test_a_machine_that_is_too_slow_loses_time_instead_of_spiralling():
    machine = SlowMachine(cost=0.0015)
    loop = FixedStepLoop(0, Phases(integrate=machine.integrate), max_frame="0.1")
    total = run(loop, 10.0, machine.clock, machine.sleep)
    # 1.5 s of work per simulated second: a third of the time cannot be simulated.
    assert total.dropped / machine.now == pytest.approx(1 / 3, abs=0.03)
    assert loop.time + total.dropped == pytest.approx(machine.now, abs=0.2)
    # A frame never takes longer than the work of the bound, so the run ends on time.
    assert machine.now < 10.0 + 2 * 0.1 * 1.5


def test_without_the_bound_the_same_machine_spirals():
    machine = SlowMachine(cost=0.0015)
    loop = FixedStepLoop(0, Phases(integrate=machine.integrate), max_frame=None)
    machine.now += 0.01
    frames, last = [], 0.0
    for _ in range(12):
        now = machine.clock()
        frames.append(now - last)
        loop.advance(now - last)
        last = now
    growth = np.array(frames[6:]) / np.array(frames[5:-1])
    np.testing.assert_allclose(growth, 1.5, rtol=0.02)


def test_a_machine_that_is_fast_enough_keeps_up_and_sleeps():
    machine = SlowMachine(cost=0.0001)
    loop = FixedStepLoop(0, Phases(integrate=machine.integrate))
    total = run(loop, 2.0, machine.clock, machine.sleep)
    assert total.dropped == 0.0
    assert total.steps == pytest.approx(2000, abs=3)
    assert machine.slept > 1.5


def test_adding_a_floating_point_step_drifts_and_counting_ticks_does_not():
    steps = 3_600_000
    error = float_clock_error(0.001, steps)
    running = 0.0
    for _ in range(steps):
        running += 0.001
    assert error == pytest.approx(running - 3600.0, rel=1e-6)
    assert 1e-8 < abs(error) < 1e-5
    print(f"0.001 added {steps} times: {error:.3e} s off")
    # A power of two is exact in binary, so that clock is right.
    assert float_clock_error(1 / 1024, 1024 * 3600) == 0.0


def test_the_drift_of_a_floating_point_clock_miscounts_pictures():
    """Ten periods of 0.1 s added up are less than 1 s, so `while clock >= 1` misses one."""
    clock = 0.0
    for _ in range(10):  # not sum(), which compensates for rounding since Python 3.12
        clock += 0.1
    assert clock < 1.0
    loop = FixedStepLoop(0, Phases(integrate=counting), 0.1, control_period=0.1, camera_period=0.1)
    for _ in range(10):
        loop.advance(Fraction(1, 10))
    assert loop.totals.steps == 10
    assert loop.time == 1.0


# A step that varies takes away what makes semi-implicit Euler bounded.


def oscillator_energy_growth(omega, steps):
    """Energy after the steps over energy before, of semi-implicit Euler on x'' = -omega^2 x."""
    x, v = 1.0, 0.0
    for dt in steps:
        v -= dt * omega**2 * x
        x += dt * v
    return (v * v + omega**2 * x * x) / omega**2


def test_alternating_steps_blow_up_where_each_of_them_alone_is_bounded():
    """A 9 Hz spring on a display that misses every second refresh: 1/60 s, 1/30 s, 1/60 s, ...

    Over such a pair the map has determinant 1 and trace 2 - (a + b)^2 + a^2 b^2 with
    a = omega h1 and b = omega h2. Its eigenvalues leave the unit circle once |trace| > 2, although
    a < 2 and b < 2.
    """
    omega = 2 * math.pi * 9.0
    short, long = 1 / 60, 1 / 30
    a, b = omega * short, omega * long
    assert max(a, b) < 2
    for fixed in (short, long):
        peaks = [oscillator_energy_growth(omega, [fixed] * n) for n in range(900, 1000)]
        assert max(peaks) < 40
    trace = 2 - (a + b) ** 2 + (a * b) ** 2
    assert trace < -2
    factor = (abs(trace) + math.sqrt(trace**2 - 4)) / 2
    near, far = (oscillator_energy_growth(omega, [short, long] * pairs) for pairs in (10, 20))
    print(f"energy grows by {factor**2:.3f} per pair of steps; measured {(far / near) ** 0.1:.3f}")
    assert (far / near) ** (1 / 10) == pytest.approx(factor**2, rel=1e-6)


def modulated_steps(omega, mean, depth, count):
    """Steps that follow the oscillation: long ones twice per period, as an adaptive step does."""
    time, steps = 0.0, []
    for _ in range(count):
        steps.append(mean * (1 + depth * math.sin(2 * omega * time)))
        time += steps[-1]
    return steps


def test_small_steps_in_rhythm_with_the_motion_pump_energy_too():
    omega, mean, depth = 1.0, 0.1, 0.5
    count = 4000
    steps = modulated_steps(omega, mean, depth, count)
    assert max(steps) * omega < 0.16
    grown = oscillator_energy_growth(omega, steps)
    fixed = oscillator_energy_growth(omega, [mean] * count)
    print(f"energy after {count} small steps: {grown:.3g} times, with fixed steps {fixed:.3f}")
    assert max(grown, 1 / grown) > 100
    assert fixed == pytest.approx(1.0, abs=0.12)


def test_the_loop_keeps_the_energy_bounded_under_the_frames_that_break_the_variable_step():
    omega = 2 * math.pi * 9.0
    energies = []

    def integrate(state, force, dt):
        v = state[1] - dt * omega**2 * state[0]
        new = np.array([state[0] + dt * v, v])
        energies.append((new[1] ** 2 + (omega * new[0]) ** 2) / omega**2)
        return new

    loop = FixedStepLoop(np.array([1.0, 0.0]), Phases(integrate=integrate))
    for _ in range(200):
        loop.advance(1 / 60)
        loop.advance(1 / 30)
    assert loop.totals.steps == pytest.approx(10_000, abs=1)
    # Bounded by the step's own ripple, about omega dt / 2 on either side.
    assert max(energies) < 1 + omega * 0.001
    assert min(energies) > 1 - omega * 0.001


def test_exact_seconds_means_what_was_written():
    assert exact_seconds(0.001) == Fraction(1, 1000)
    assert exact_seconds(1 / 60) == Fraction(1, 60)
    assert exact_seconds("1/3000") == Fraction(1, 3000)
    assert exact_seconds("0.002") == Fraction(1, 500)
    assert exact_seconds(np.float64(0.02)) == Fraction(1, 50)
    assert exact_seconds(2) == 2


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_exact_seconds_undoes_the_rounding_of_a_quotient(numerator, denominator):
    assert exact_seconds(numerator / denominator) == Fraction(numerator, denominator)


@pytest.mark.parametrize("bad", [math.pi, math.nan, math.inf, "soon", "1/0", True, None])
def test_exact_seconds_refuses(bad):
    with pytest.raises(ValueError, match=r"dt must be"):
        exact_seconds(bad, "dt")


@pytest.mark.parametrize(
    "bad",
    [
        {"physics_dt": 0},
        {"physics_dt": -0.001},
        {"physics_dt": math.nan},
        {"control_period": 0.0005},
        {"camera_period": 0.0005},
        {"render_period": 0},
        {"camera_delay": -0.01},
        {"actuation_delay": -0.01},
        {"max_frame": 0.0005},
    ],
)
def test_a_loop_refuses_impossible_times(bad):
    with pytest.raises(ValueError, match=f"{next(iter(bad))} must be"):
        FixedStepLoop(0, Phases(integrate=counting), **bad)


@pytest.mark.parametrize("bad", [-0.1, math.nan, math.inf, "1"])
def test_advance_refuses_impossible_times(bad):
    loop = FixedStepLoop(0, Phases(integrate=counting))
    with pytest.raises(ValueError, match="real_seconds"):
        loop.advance(bad)


def test_other_bad_input():
    loop = FixedStepLoop(0, Phases(integrate=counting))
    with pytest.raises(ValueError, match="seconds"):
        run(loop, 0.0)
    with pytest.raises(ValueError, match="steps"):
        float_clock_error(0.001, 0)


def test_nothing_is_due_before_the_first_step():
    loop = FixedStepLoop(0, Phases(integrate=counting))
    done = loop.advance(0.0004)
    assert done == Advance(alpha=done.alpha)
    assert done.alpha == pytest.approx(0.4)
    assert loop.seconds_to_next == pytest.approx(0.0006)


def test_interpolation_ends_at_both_states():
    a, b = np.array([1.0, -2.0]), np.array([4.0, 0.5])
    np.testing.assert_array_equal(interpolate_linearly(a, b, 0.0), a)
    np.testing.assert_array_equal(interpolate_linearly(a, b, 1.0), b)


def test_the_diagram_names_the_six_phases_and_the_repetition():
    text = flow_diagram(FixedStepLoop(0, Phases(integrate=counting)))
    for phase in ("sense", "control", "apply forces", "integrate", "detect collisions", "render"):
        assert phase in text
    assert text.count("↓") == 5
    assert "↻ repeat at 1 kHz" in text


def test_the_trace_is_only_kept_on_request():
    loop = FixedStepLoop(0, Phases(integrate=counting))
    loop.advance(0.1)
    assert loop.trace == []
