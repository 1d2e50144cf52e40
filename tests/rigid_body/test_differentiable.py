"""Gradients through impacts, and parameters read off recordings."""

import math
import subprocess
import sys
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body.differentiable import (
    NAMES,
    Recording,
    Setup,
    drop_gradients,
    gradient,
    information,
    jacobian,
    loss,
    naive_drop,
    naive_drop_gradients,
    record,
    recover,
    segments,
    trajectory,
)
from course.rigid_body.planar import advance_boxes, box_parameters
from tests.budget import examples

torch.set_num_threads(1)

G = 9.80665
THROW = Setup((0.0, 0.5), (2.0, 0.0), push=((0.1, 0.4, 3.0), (1.0, 1.4, 8.0)))
TRUTH = np.array([0.6, 0.25, 1.3])
TIMES = np.linspace(0.0, 2.0, 101)

CASES: dict[str, tuple[Setup, Any]] = {
    "throw": (THROW, TRUTH),
    "rough": (Setup((0.0, 1.0), (1.0, 2.0), push=((0.3, 2.0, 4.0),)), np.array([0.4, 0.9, 0.7])),
    "backwards": (Setup((3.0, 0.2), (-4.0, 1.0), push=((0.5, 0.9, 6.0),)), [0.8, 0.3, 2.0]),
    "slide": (Setup((0.0, 0.0), (1.5, 0.0), push=((0.8, 1.2, 5.0),)), np.array([0.5, 0.3, 1.0])),
    "elastic": (Setup((0.0, 0.8), (3.0, 0.0), push=((0.0, 2.0, 1.0),)), np.array([0.95, 0.1, 1.5])),
}


def away_from_events(parameters, scene, times, margin=1e-3):
    starts = np.array([float(piece.start) for piece in segments(parameters, scene, 10.0)])
    return times[np.abs(times[:, None] - starts[1:]).min(axis=1, initial=np.inf) > margin]


def central_differences(function, point, step=1e-6):
    point = np.asarray(point, dtype=float)
    columns = []
    for direction in np.eye(len(point)):
        near = [np.asarray(function(point + k * step * direction)) for k in (-2, -1, 1, 2)]
        columns.append((near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * step))
    return np.stack(columns, axis=-1)


# The motion itself, against formulas.


def test_a_drop_and_two_bounces():
    e, h = 0.7, 1.0
    v = math.sqrt(2 * G * h)
    first = v / G
    second = first + 2 * e * v / G
    x, y, vx, vy = trajectory(
        [e, 0.3, 1.0], Setup((0.2, h)), [0.3, first, first + 0.1, second + 1e-6]
    )
    assert y[0] == pytest.approx(h - 0.5 * G * 0.3**2, abs=1e-14)
    assert y[1] == pytest.approx(0.0, abs=1e-14)
    assert y[2] == pytest.approx(e * v * 0.1 - 0.5 * G * 0.1**2, abs=1e-14)
    assert vy[3] == pytest.approx(e * e * v - G * 1e-6, abs=1e-12)
    np.testing.assert_array_equal(x, 0.2)
    np.testing.assert_array_equal(vx, 0.0)


def test_a_slide_stops_where_it_should():
    v, mu = 1.5, 0.3
    stop = v / (mu * G)
    out = trajectory([0.5, mu, 2.0], Setup((0.0, 0.0), (v, 0.0)), [stop / 2, stop + 1])
    assert out[0, 1] == pytest.approx(v * v / (2 * mu * G), abs=1e-14)
    assert out[2, 0] == pytest.approx(v / 2, abs=1e-14)
    assert out[2, 1] == 0.0


def test_friction_at_an_impact_slips_or_sticks():
    e, h = 0.5, 1.0
    v = math.sqrt(2 * G * h)
    after = [v / G + 1e-3]
    for vx, mu in ((4.0, 0.2), (-4.0, 0.2), (1.0, 0.4), (-1.0, 0.4)):
        got = trajectory([e, mu, 1.0], Setup((0.0, h), (vx, 0.0)), after)[2, 0]
        limit = mu * (1 + e) * v
        assert got == pytest.approx(math.copysign(max(abs(vx) - limit, 0.0), vx), abs=1e-14)


def test_a_push_moves_what_static_friction_cannot_hold():
    push, m = 6.0, 2.0
    scene = Setup((0.0, 0.0), push=((0.5, 1.5, push),))
    held = trajectory([0.5, 0.31, m], scene, [0.4, 1.0, 3.0])
    np.testing.assert_array_equal(held, 0.0)
    mu = 0.2
    a = push / m - mu * G
    moved = trajectory([0.5, mu, m], scene, [1.5, 10.0])
    assert moved[0, 0] == pytest.approx(0.5 * a, abs=1e-14)
    assert moved[0, 1] == pytest.approx(0.5 * a + a * a / (2 * mu * G), abs=1e-13)
    remaining = trajectory([0.5, mu, m], Setup((0.0, 0.0), push=((0.5, 1.5, -push),)), [1.5, 10.0])
    np.testing.assert_array_equal(remaining, -moved)


@examples(80)
@given(
    st.floats(0.0, 1.0),
    st.floats(0.0, 2.0),
    st.floats(0.0, 2.0),
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
)
def test_without_a_push_energy_never_grows_and_the_ground_holds(e, mu, y, vx, vy):
    times = np.linspace(0, 2, 300)
    _, y, vx, vy = trajectory([e, mu, 1.0], Setup((0.0, y), (vx, vy)), times)
    energy = 0.5 * (vx**2 + vy**2) + G * y
    assert np.all(np.diff(energy) <= 1e-9 * (1 + energy[0]))
    assert y.min() > -1e-12


def test_mass_alone_changes_nothing_without_a_push():
    scene = Setup((0.0, 0.5), (2.0, 0.0))
    light, heavy = (trajectory([0.6, 0.2, m], scene, TIMES) for m in (0.1, 50.0))
    np.testing.assert_array_equal(light, heavy)


def test_cutting_off_the_small_bounces_keeps_the_tangential_velocity():
    """The impulses of all bounces that are left out add up to that of the contact instead."""
    finals = [
        trajectory([0.6, 0.1, 1.0], Setup((0.0, 0.5), (3.0, 0.0), rest_speed=s), [1.9])[:, 0]
        for s in (0.3, 1e-2, 1e-6)
    ]
    np.testing.assert_allclose(finals[0][2], finals[2][2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(finals[1][2], finals[2][2], rtol=0, atol=1e-12)
    assert abs(finals[1][0] - finals[2][0]) < 1e-5


@pytest.mark.parametrize("case", CASES)
def test_tensors_and_floats_give_the_same_numbers(case):
    scene, parameters = CASES[case]
    numbers = trajectory(parameters, scene, TIMES)
    tensors = trajectory(torch.tensor(np.asarray(parameters)), scene, TIMES).numpy()
    np.testing.assert_allclose(tensors, numbers, rtol=0, atol=1e-13)


# A non-rotating box of the planar module is this block.


@pytest.mark.parametrize("name", ["throw", "rough", "slide"])
def test_agrees_with_the_planar_box_that_cannot_turn(name):
    scene, (e, mu, m) = CASES[name]
    scene = Setup(scene.position, scene.velocity, scene.push, gravity=G, rest_speed=0.01)
    height, dt, steps = 0.2, 1e-3, 2000
    box = box_parameters(
        m, 0.3, height, inertia=1e9, restitution=e, friction=mu, rest_speed=scene.rest_speed
    )
    state = np.array([scene.position[0], scene.position[1] + height / 2, 0, *scene.velocity, 0])
    state = state.reshape(6, 1)
    edges = sorted({0, steps, *(round(t / dt) for piece in scene.push for t in piece[:2])})
    times, states = [], []
    for start, end in pairwise(edges):
        force = sum(f for a, b, f in scene.push if a <= (start + 0.5) * dt < b)
        for n in range(start, end, 50):
            state, _ = advance_boxes(
                state,
                box,
                dt,
                min(50, end - n),
                gravity=G,
                forces=np.array([force, 0.0, 0.0]),
                integrator="velocity_verlet",
            )
            times.append(min(n + 50, end) * dt)
            states.append(state[[0, 1, 3, 4], 0] - [0, height / 2, 0, 0])
    ours = trajectory([e, mu, m], scene, times)
    difference = np.abs(ours - np.array(states).T)
    print(f"{name}: worst difference to the planar box {difference.max(axis=1)}")
    assert difference.max() < 1e-5


# Gradients.


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_jacobian_against_central_differences(case):
    scene, parameters = CASES[case]
    times = away_from_events(parameters, scene, TIMES)
    assert len(times) > 80
    J = jacobian(parameters, scene, times)
    expected = central_differences(lambda p: trajectory(p, scene, times), parameters)
    error = np.abs(J - expected).max(axis=(0, 1)) / np.abs(expected).max(axis=(0, 1), initial=1e-3)
    print(f"{case}: relative error of d/d{NAMES} {error}")
    assert error.max() < 1e-6


@pytest.mark.parametrize("case", CASES)
def test_gradient_of_the_loss_against_differences_and_jacobian(case):
    scene, parameters = CASES[case]
    times = away_from_events(parameters, scene, TIMES)
    recorded = record(parameters, scene, times, 1e-3, np.random.default_rng(3))
    deviation = np.asarray(parameters) * [1.0002, 0.9998, 1.0003]
    got = gradient(deviation, recorded, scene)
    expected = central_differences(lambda p: loss(p, recorded, scene), deviation, 1e-7)
    np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-4 * np.abs(expected).max())
    J = jacobian(deviation, scene, times)[:2].reshape(-1, 3)
    residual = (trajectory(deviation, scene, times)[:2] - recorded.positions).ravel()
    np.testing.assert_allclose(got, J.T @ residual / 1e-6, rtol=1e-9)


def test_derivatives_of_a_drop_in_closed_form():
    h, e = 1.0, 0.7
    v = math.sqrt(2 * G * h)
    for duration in (0.3, 0.6, 0.8, 1.0):
        got = drop_gradients(h, e, duration)
        t = duration - v / G
        if t < 0:
            expected = (h - 0.5 * G * duration**2, 1.0, 0.0)
        else:
            expected = (e * v * t - 0.5 * G * t * t, (1 + e) * G * t / v - e, v * t)
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-13)


def test_derivative_after_the_second_bounce_in_closed_form():
    h, e, duration = 1.0, 0.7, 1.2
    v = math.sqrt(2 * G * h)
    t = duration - v / G - 2 * e * v / G
    # y = e^2 v t - g t^2 / 2 with dt/de = -2 v / g.
    by_e = 2 * e * v * t + (e * e * v - G * t) * (-2 * v / G)
    assert drop_gradients(h, e, duration).by_restitution == pytest.approx(by_e, abs=1e-12)


def test_derivatives_of_a_slide_and_of_a_push_in_closed_form():
    v, mu, m, push, t = 1.5, 0.3, 2.0, 8.0, 0.4
    J = jacobian([0.5, mu, m], Setup((0.0, 0.0), (v, 0.0)), [3.0])
    np.testing.assert_allclose(J[0, 0], [0, -v * v / (2 * mu**2 * G), 0], atol=1e-13)
    np.testing.assert_array_equal(J[1:], 0.0)
    J = jacobian([0.5, mu, m], Setup((0.0, 5.0), push=((0.0, 1.0, push),)), [t])
    np.testing.assert_allclose(J[0, 0], [0, 0, -0.5 * push * t * t / m**2], atol=1e-13)


def test_derivative_of_a_slipping_impact_in_closed_form():
    h, e, mu, vx = 1.0, 0.5, 0.2, 4.0
    v = math.sqrt(2 * G * h)
    J = jacobian([e, mu, 1.0], Setup((0.0, h), (vx, 0.0)), [v / G + 0.05])
    np.testing.assert_allclose(J[2, 0], [-mu * v, -(1 + e) * v, 0], atol=1e-13)


# What an impact does to a gradient.


def test_the_gradient_jumps_when_the_time_crosses_the_impact():
    """Before: dy/dh = 1. After: the block rebounds from a later impact, dy/dh = -e."""
    h, e = 1.0, 0.7
    impact = math.sqrt(2 * h / G)
    before, after = (drop_gradients(h, e, impact + s).by_height for s in (-1e-9, 1e-9))
    assert before == pytest.approx(1.0, abs=1e-6)
    assert after == pytest.approx(-e, abs=1e-6)


def test_a_finite_difference_across_the_impact_blows_up():
    """The velocity at a fixed time jumps by (1 + e) v: the quotient is that over the step."""
    h, e = 1.0, 0.7
    v = math.sqrt(2 * G * h)
    impact = v / G

    def speed(height):
        return trajectory([e, 0.0, 1.0], Setup((0.0, height)), [impact])[3, 0]

    for step in (1e-2, 1e-4, 1e-6):
        quotient = (speed(h + step) - speed(h - step)) / (2 * step)
        print(
            f"step {step:g}: quotient {quotient:.4g}, jump over step {-(1 + e) * v / 2 / step:.4g}"
        )
        assert quotient * 2 * step == pytest.approx(-(1 + e) * v, rel=0.02)


@pytest.mark.parametrize(("clamp", "wrong"), [(True, 0.0), (False, 1.0)])
def test_fixed_steps_converge_in_value_and_not_in_gradient(clamp, wrong):
    h, e, duration = 1.0, 0.7, 0.8
    true = drop_gradients(h, e, duration)
    for dt in (1e-2, 1e-3, 2e-4):
        naive = naive_drop_gradients(h, e, dt, duration, clamp)
        print(
            f"dt {dt:g}, clamp {clamp}: height off by {naive.height - true.height:+.2e}, "
            f"d/dh {naive.by_height:+.4f} (true {true.by_height:+.4f}), "
            f"d/de off by {naive.by_restitution - true.by_restitution:+.2e}"
        )
        assert abs(naive.height - true.height) < 10 * dt
        assert naive.by_height == wrong
        # The time of the first impact does not depend on restitution, so this one converges.
        assert abs(naive.by_restitution - true.by_restitution) < 10 * dt
    assert true.by_height == pytest.approx(0.612, abs=1e-3)


def test_after_a_second_bounce_the_gradient_to_restitution_is_wrong_too():
    true = drop_gradients(1.0, 0.7, 1.2)
    for dt in (1e-2, 1e-3, 2e-4):
        naive = naive_drop_gradients(1.0, 0.7, dt, 1.2)
        print(f"dt {dt:g}: d/de {naive.by_restitution:+.4f}, true {true.by_restitution:+.4f}")
        assert abs(naive.by_restitution - true.by_restitution) > 0.1


def test_finite_differences_of_fixed_steps_need_a_step_far_above_dt():
    """A tiny difference sees a plateau or a jump; a wide one averages over many of both."""
    dt, duration = 1e-3, 0.8
    heights = 1.0 + np.linspace(0, 0.02, 41)

    def worst(width):
        errors = []
        for h in heights:
            up, down = (naive_drop(h + s * width, 0.7, dt, duration) for s in (1, -1))
            true = drop_gradients(float(h), 0.7, duration).by_height
            errors.append(abs((up - down) / (2 * width) - true))
        return max(errors)

    tiny, wide = worst(1e-5), worst(5e-2)
    print(f"worst error of the quotient: {tiny:.3g} for 1e-5 m, {wide:.3g} for 5e-2 m")
    assert tiny > 0.5
    assert wide < 0.2


# Parameters from recordings.


@pytest.mark.prove
def test_recovers_parameters_within_their_standard_errors():
    """Twenty recordings at 1 mm noise; the normalised errors must look like the normal law."""
    guess = [0.5, 0.4, 1.0]
    scores = []
    for seed in range(20):
        recorded = record(TRUTH, THROW, TIMES, 1e-3, np.random.default_rng(seed))
        result = recover(recorded, THROW, guess)
        assert result.converged
        assert result.fits
        assert result.information.identified == (True, True, True)
        scores.append((result.parameters - TRUTH) / result.information.standard_errors)
        if seed == 0:
            print(result)
    z = np.array(scores)
    within = np.mean(np.abs(z) < 1)
    print(f"within one standard error {within:.2f}, mean {z.mean(axis=0)}, rms {z.std(axis=0)}")
    assert np.abs(z).max() < 4.0
    # chi^2 with 60 degrees of freedom: between 31 and 99 with probability 0.998.
    assert 31 < np.sum(z**2) < 99
    assert 0.5 < within < 0.85


@pytest.mark.slow
def test_standard_errors_are_those_of_many_recordings():
    """Near the truth the fit is linear in the noise, so 20,000 recordings cost nothing."""
    report = information(TRUTH, THROW, TIMES, 1e-3)
    estimator = np.linalg.pinv(jacobian(TRUTH, THROW, TIMES)[:2].reshape(-1, 3))
    noise = np.random.default_rng(1).normal(0.0, 1e-3, (2 * len(TIMES), 20_000))
    spread = (estimator @ noise).std(axis=1) / report.standard_errors
    print(f"spread of 20,000 linear fits over standard error {spread}")
    np.testing.assert_allclose(spread, 1.0, atol=0.03)
    exact = trajectory(TRUTH, THROW, TIMES)[:2]
    for n in range(3):
        recorded = Recording(TIMES, exact + noise[:, n].reshape(2, -1), 1e-3)
        result = (
            recover(recorded, THROW, [0.5, 0.4, 1.0]).parameters - TRUTH
        ) / report.standard_errors
        np.testing.assert_allclose(
            result, estimator @ noise[:, n] / report.standard_errors, atol=0.05
        )


@pytest.mark.prove
def test_recovers_from_several_guesses_and_reports_when_it_is_trapped():
    recorded = record(TRUTH, THROW, TIMES, 1e-3, np.random.default_rng(5))
    for guess in ([0.5, 0.4, 1.0], [0.8, 0.1, 2.0], [0.4, 0.4, 0.5]):
        result = recover(recorded, THROW, guess)
        assert result.fits
        np.testing.assert_allclose(result.parameters, TRUTH, rtol=3e-3)
    trapped = recover(recorded, THROW, [0.5, 1.5, 1.0])
    assert not trapped.fits
    assert "does NOT fit" in str(trapped)


def test_the_loss_never_rises():
    recorded = record(TRUTH, THROW, TIMES, 1e-3, np.random.default_rng(5))
    assert np.all(np.diff(recover(recorded, THROW, [0.5, 0.4, 1.0]).losses) < 0)


def test_a_vertical_drop_says_nothing_about_friction_and_mass():
    scene = Setup((0.0, 1.0))
    report = information(TRUTH, scene, TIMES)
    assert report.identified == (True, False, False)
    assert np.isinf(report.standard_errors[1:]).all()
    np.testing.assert_array_equal(report.singular_values[1:], 0.0)
    recorded = record(TRUTH, scene, TIMES, 1e-3, np.random.default_rng(0))
    result = recover(recorded, scene, [0.65, 0.9, 3.0])
    assert result.parameters[0] == pytest.approx(0.6, abs=5 * report.standard_errors[0])
    np.testing.assert_array_equal(result.parameters[1:], [0.9, 3.0])
    assert "friction     not identified" in str(result)
    assert "mass         not identified" in str(result)


def test_a_sticking_block_gives_only_a_bound_on_friction():
    scene = Setup((0.0, 0.0), push=((0.2, 1.0, 3.0), (1.0, 1.5, 2.0)))
    report = information([0.5, 0.6, 1.0], scene, TIMES)
    assert report.identified == (False, False, False)
    assert report.friction_at_least == pytest.approx(3.0 / G)
    assert f"at least {3.0 / G:.4g}" in str(report)
    # The bound is sharp: a little less friction and the block moves.
    assert not trajectory([0.5, 3.0 / G + 1e-9, 1.0], scene, TIMES).any()
    assert trajectory([0.5, 3.0 / G - 1e-9, 1.0], scene, TIMES).any()


def test_a_sticking_impact_gives_its_own_bound():
    h, e, vx = 1.0, 0.5, 1.0
    report = information([e, 0.8, 1.0], Setup((0.0, h), (vx, 0.0)), TIMES)
    assert not report.identified[1]
    assert report.friction_at_least == pytest.approx(vx / ((1 + e) * math.sqrt(2 * G * h)))


def test_free_flight_says_nothing_about_mass_unless_it_is_pushed():
    times = np.linspace(0, 0.4, 41)
    assert information(TRUTH, Setup((0.0, 2.0), (1.0, 1.0)), times).unknown == NAMES
    pushed = information(TRUTH, Setup((0.0, 2.0), push=((0.0, 1.0, 5.0),)), times)
    assert pushed.identified == (False, False, True)


def test_a_constant_push_on_a_slide_tells_one_combination_only():
    """The acceleration is push / m - mu g: heavier and smoother looks like lighter and rougher."""
    push, (_, mu, m) = 8.0, TRUTH
    scene = Setup((0.0, 0.0), push=((0.0, 5.0, push),))
    report = information([0.5, mu, m], scene, TIMES)
    assert report.identified == (False, False, False)
    assert report.singular_values[0] > 1e3
    assert report.singular_values[1] < 1e-6
    strong = np.array([0.0, -G, -push / m])  # d a / d (e, mu, log m)
    np.testing.assert_allclose(
        np.abs(report.directions[0]), np.abs(strong) / np.linalg.norm(strong), atol=1e-9
    )
    let_go = information([0.5, mu, m], Setup((0.0, 0.0), push=((0.0, 0.5, push),)), TIMES)
    assert let_go.identified == (False, True, True)


def test_standard_errors_scale_with_noise():
    one = information(TRUTH, THROW, TIMES, 1e-3)
    ten = information(TRUTH, THROW, TIMES, 1e-2)
    np.testing.assert_allclose(ten.standard_errors, 10 * one.standard_errors, rtol=1e-9)
    np.testing.assert_allclose(one.covariance, one.covariance.T, rtol=1e-12)


# Torch is asked for only where a gradient is.


@pytest.mark.slow
def test_numbers_need_no_torch():
    code = (
        "import sys; from course.rigid_body.differentiable import Setup, trajectory;"
        "trajectory([0.5, 0.2, 1.0], Setup((0.0, 1.0)), [0.1, 0.9]);"
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_missing_torch_is_said_in_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ModuleNotFoundError, match="this needs PyTorch"):
        jacobian(TRUTH, THROW, TIMES)


@pytest.mark.parametrize(
    ("parameters", "named"),
    [
        ([1.1, 0.2, 1.0], "restitution"),
        ([-0.1, 0.2, 1.0], "restitution"),
        ([0.5, -0.2, 1.0], "friction"),
        ([0.5, math.inf, 1.0], "friction"),
        ([0.5, 0.2, 0.0], "mass"),
        ([0.5, 0.2, math.nan], "mass"),
        ([0.5, 0.2], "parameters"),
    ],
)
def test_refuses_impossible_parameters(parameters, named):
    with pytest.raises(ValueError, match=named):
        trajectory(parameters, THROW, TIMES)


@pytest.mark.parametrize(
    ("bad", "named"),
    [
        ({"position": (0.0, -0.1)}, "position"),
        ({"position": (0.0, math.nan)}, "position"),
        ({"position": (0.0, 1.0), "velocity": (0.0,)}, "velocity"),
        ({"position": (0.0, 1.0), "gravity": 0.0}, "gravity"),
        ({"position": (0.0, 1.0), "rest_speed": 0.0}, "rest_speed"),
        ({"position": (0.0, 1.0), "push": ((0.5, 0.4, 1.0),)}, "push"),
        ({"position": (0.0, 1.0), "push": ((0.0, 0.4, 1.0), (0.3, 0.5, 1.0))}, "push"),
        ({"position": (0.0, 1.0), "push": ((0.0, 0.4, math.nan),)}, "push"),
    ],
)
def test_refuses_impossible_scenes(bad, named):
    with pytest.raises(ValueError, match=named):
        Setup(**bad)


def test_refuses_other_bad_input():
    good = record(TRUTH, THROW, TIMES, 1e-3, np.random.default_rng(0))
    with pytest.raises(ValueError, match="times"):
        trajectory(TRUTH, THROW, [-0.1])
    with pytest.raises(ValueError, match="times"):
        trajectory(TRUTH, THROW, [math.nan])
    with pytest.raises(ValueError, match="positions"):
        Recording(TIMES, good.positions[:, 1:], 1e-3)
    with pytest.raises(ValueError, match="positions"):
        Recording(TIMES, good.positions * math.nan, 1e-3)
    with pytest.raises(ValueError, match="noise"):
        Recording(TIMES, good.positions, 0.0)
    with pytest.raises(ValueError, match="noise"):
        information(TRUTH, THROW, TIMES, -1.0)
    with pytest.raises(ValueError, match="iterations"):
        recover(good, THROW, TRUTH, iterations=0)
    with pytest.raises(ValueError, match="dt"):
        naive_drop(1.0, 0.5, 0.0, 1.0)
