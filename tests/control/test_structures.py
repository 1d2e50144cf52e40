"""Cascade, notch, disturbance observer and predictor: identities, closed forms and SciPy."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from course.control import structures as shapes
from course.control.joint import Actuator, Encoder, Joint, run_joint
from course.control.pid import Gains
from course.control.sampled import growth, held, joint_system, loop_matrix, pid_law

J, B, DT = 0.5, 0.5, 1e-3
MODEL: dict[str, Any] = {"dt": DT, "inertia": J, "damping": B}


def joint(samples=0.0, inertia=J, damping=B):
    return held(*joint_system(inertia, damping), DT, samples * DT)


def grows(plant, law, seconds=20.0):
    """Return the growth of a simulated run: the size of its last tenth over that of its first."""
    start = np.zeros(plant.now.size)
    start[0] = 1e-3
    error = shapes.respond(plant, law, samples=round(seconds / DT), start=start).error
    tenth = error.size // 10
    return float(np.abs(error[-tenth:]).max() / np.abs(error[tenth : 2 * tenth]).max())


def edge(stable, low, high):
    """Return where a loop stops being stable, by bisection on its matrix."""
    assert stable(low)
    assert not stable(high)
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


# --- angles that wrap -----------------------------------------------------------------------------


@given(st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_direction_within_half_a_turn(angle) -> None:
    result = float(shapes.wrap(angle))
    assert -math.pi <= result <= math.pi
    assert np.exp(1j * result) == pytest.approx(np.exp(1j * angle), abs=1e-9)


@pytest.mark.parametrize("share", [-1.02, -0.98, 0.98, 1.02])
def test_the_rate_of_a_wrapped_encoder_is_right_up_to_half_a_turn_a_sample(share) -> None:
    speed = share * math.pi / DT
    angles = shapes.wrap(speed * DT * np.arange(100))
    rates = shapes.wrap(np.diff(angles)) / DT
    right = np.allclose(rates, speed, rtol=1e-6)
    assert right == (abs(share) < 1.0)
    unwrapped = np.diff(np.unwrap(angles)) / DT
    assert rates == pytest.approx(unwrapped)


# --- the cascade ----------------------------------------------------------------------------------


def cascade_by_hand(position, velocity, integral, setpoint, steps, late):
    """Return angles of two nested loops as they are drawn, on the exact joint."""
    plant = joint()
    x, total, last, queue, angles = np.zeros(2), 0.0, 0.0, [0.0] * late, []
    for _ in range(steps):
        angles.append(x[0])
        rate, last = (x[0] - last) / DT, x[0]
        missing = position * (setpoint - x[0]) - rate
        total += integral * DT * missing
        queue.append(velocity * missing + total)
        x = plant.transition @ x + plant.now * queue.pop(0)
    return np.array(angles)


@pytest.mark.parametrize("late", [0, 5])
def test_two_nested_loops_are_one_pid_with_a_share_of_the_set_point(late) -> None:
    numbers = 8.0, 12.0, 30.0
    angles = cascade_by_hand(*numbers, 1.0, 3000, late)
    actuator = Actuator(delay=late * DT)
    run = run_joint(Joint(J, B), actuator, Encoder(), shapes.cascade(*numbers), 1.0, DT, 3.0)
    assert run.q[:-1] == pytest.approx(angles, abs=1e-9)


def test_not_every_pid_is_a_cascade() -> None:
    """The zeros of kd s^2 + kp s + ki are real: they are the gain of each loop."""
    for position, velocity, integral in np.random.default_rng(0).uniform(0.1, 50.0, (50, 3)):
        gains = shapes.cascade(position, velocity, integral)
        zeros = np.roots([gains.kd, gains.kp, gains.ki])
        assert np.isreal(zeros).all()
        assert sorted(-zeros.real) == pytest.approx(sorted((position, integral / velocity)))


@pytest.mark.prove
@pytest.mark.parametrize("late", [2, 10])
def test_a_cascade_diverges_just_past_the_limit_of_its_matrix(late) -> None:
    plant = joint(late)

    def law(position):
        return shapes.cascade(position, 10.0, 20.0).law(DT)

    limit = edge(lambda p: growth(loop_matrix(plant, law(p))) < 1.0, 1.0, 1e4)
    assert grows(plant, law(0.98 * limit)) < 1.0 < grows(plant, law(1.02 * limit))


def test_without_delay_the_limit_of_a_cascade_is_that_of_routh() -> None:
    """J s^3 + kv s^2 + (kv kp + ki) s + ki kp, sampled so fast that the hold is small."""
    velocity, integral, dt = 5.0, 100.0, 1e-5
    # kv (kv kp + ki) > J ki kp.
    known = velocity * integral / (J * integral - velocity**2)
    plant = held(*joint_system(J), dt)

    def stable(position):
        law = shapes.cascade(position, velocity, integral).law(dt)
        return growth(loop_matrix(plant, law)) < 1.0

    assert edge(stable, 1.0, 1e3) == pytest.approx(known, rel=1e-3)


# --- the disturbance observer ---------------------------------------------------------------------


@pytest.mark.prove
@given(
    kp=st.floats(1.0, 200.0),
    kd=st.floats(0.1, 20.0),
    bandwidth=st.floats(1.0, 300.0),
    inertia=st.floats(0.1, 2.0),
    damping=st.floats(0.0, 2.0),
)
def test_an_observer_of_first_order_is_a_pid(kp, kd, bandwidth, inertia, damping) -> None:
    model = {"dt": DT, "inertia": inertia, "damping": damping}
    gains = shapes.disturbance_observer(kp, kd, bandwidth, **model)
    law = shapes.observer_law(kp, kd, bandwidth, **model)
    push = np.random.default_rng(0).standard_normal(300)
    plant = joint(3)
    runs = [shapes.respond(plant, one, push, samples=300) for one in (gains.law(DT), law)]
    scale = np.abs(runs[0].command).max()
    assert runs[1].command == pytest.approx(runs[0].command, abs=1e-7 * scale)


@pytest.mark.prove
@pytest.mark.parametrize("late", [0, 1, 10])
@pytest.mark.parametrize("wrong", [0.7, 1.0, 1.5])
def test_the_observer_removes_a_constant_load_whatever_its_inertia(late, wrong) -> None:
    law = shapes.observer_law(20.0, 6.0, 10.0, dt=DT, inertia=wrong * J, damping=B, late=late)
    run = shapes.respond(joint(late), law, 2.0, samples=12_000)
    assert abs(run.error[-1]) < 1e-9
    plain = shapes.respond(joint(late), pid_law(20.0, 0.0, 6.0, dt=DT), 2.0, samples=12_000)
    assert plain.error[-1] == pytest.approx(2.0 / 20.0, rel=1e-6)


def test_with_an_exact_model_the_estimate_is_the_filtered_load() -> None:
    """An exact rate: the estimate is the load behind a filter of first order, as SciPy has it."""
    late, bandwidth = 4, 25.0
    law = shapes.observer_law(20.0, 6.0, bandwidth, **MODEL, late=late, rate="exact")
    push = np.random.default_rng(1).standard_normal(2000)
    run = shapes.respond(joint(late), law, push, samples=2000)
    # The estimate from the command: what PD would send, less what was sent.
    speed = run.error[1:-1]
    plant = joint()
    # Exact rate of each sample from two angles and the torque between them.
    torque = push[:-1] + np.concatenate([np.zeros(late), run.command])[: push.size - 1]
    start = (speed - run.error[:-2] - plant.now[0] * torque) / plant.transition[0, 1]
    estimate = -run.command[:-1] - 20.0 * run.error[:-2] - 6.0 * start
    share = shapes.observer_share(bandwidth, DT)
    known = signal.lfilter([0.0, share], [1.0, share - 1.0], push)[:-1]
    assert estimate == pytest.approx(known, abs=1e-6)


@pytest.mark.parametrize("late", [3, 7, 12])
def test_an_observer_that_ignores_the_delay_has_the_limit_of_levin_and_may(late) -> None:
    limit = shapes.observer_limit(DT, late)
    plant = joint(late, damping=0.0)

    def law(share):
        bandwidth = -math.log1p(-share) / DT
        return shapes.observer_law(0.0, 0.0, bandwidth, dt=DT, inertia=J, late=0, rate="exact")

    def rate_growth(share):
        # Without P nothing reads the angle: cut its row and column, an eigenvalue of 1.
        F = loop_matrix(plant, law(share))
        values = np.linalg.eigvals(F[1:, 1:])
        # The other eigenvalue of 1 is the observer's sum, which nothing moves.
        return np.max(np.abs(values[np.abs(values - 1.0) > 1e-6]))

    assert rate_growth(limit) == pytest.approx(1.0, abs=1e-7)
    assert rate_growth(0.98 * limit) < 1.0 < rate_growth(1.02 * limit)
    polynomial = np.zeros(late + 2)
    polynomial[0], polynomial[1], polynomial[-1] = 1.0, -1.0, limit
    assert np.max(np.abs(np.roots(polynomial))) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.prove
@pytest.mark.parametrize("known", [False, True])
def test_the_observers_bandwidth_has_a_limit_if_delay_or_inertia_is_wrong(known) -> None:
    late, inertia = 20, J if not known else 2.0 * J

    def law(bandwidth):
        return shapes.observer_law(
            J * 100.0,
            J * 20.0 - B,
            bandwidth,
            dt=DT,
            inertia=inertia,
            damping=B,
            late=late if known else 0,
        )

    plant = joint(late)
    limit = edge(lambda g: growth(loop_matrix(plant, law(g))) < 1.0, 1.0, 1e3)
    assert grows(plant, law(0.98 * limit)) < 1.0 < grows(plant, law(1.02 * limit))


# --- the predictor --------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", ["exact", "difference"])
@pytest.mark.parametrize("late", [0, 1, 7, 20])
def test_with_the_exact_delay_the_predictor_takes_it_out_of_the_polynomial(rate, late) -> None:
    kp, kd = 200.0, 20.0
    law = shapes.predictor_law(kp, kd, late=late, rate=rate, **MODEL)
    F = loop_matrix(joint(late), law)
    plant = joint()
    free = plant.transition - np.outer(plant.now, [kp, kd])
    # Coefficients, not roots: zero is a root many times over, and rounding scatters those.
    expected = np.concatenate([np.poly(free), np.zeros(F.shape[0] - 2)])
    assert np.poly(F) == pytest.approx(expected, abs=1e-9)


@pytest.mark.prove
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("p", [80.0, 150.0])
def test_a_wrong_delay_makes_the_predictor_unstable_where_its_matrix_says(side, p) -> None:
    late = 20
    law = shapes.predictor_law(J * p * p, 2.0 * J * p - B, late=late, **MODEL)

    def stable(error):
        return growth(loop_matrix(joint(late * (1.0 + side * error)), law)) < 1.0

    limit = edge(stable, 0.0, 0.4)
    for factor, bounded in ((0.98, True), (1.02, False)):
        plant = joint(late * (1.0 + side * factor * limit))
        assert (grows(plant, law, 10.0) < 1.0) == bounded


def test_the_predictor_does_not_remove_a_load() -> None:
    """Its model does not know the load: the error is larger than that of PD without a delay."""
    kp, kd, late = 100.0, 12.0, 10
    law = shapes.predictor_law(kp, kd, late=late, rate="exact", **MODEL)
    run = shapes.respond(joint(late), law, 1.0, samples=8000)
    # At rest u = -1, which the model takes for a motion: subtract it.
    plant, state = joint(), np.zeros(2)
    for _ in range(late):
        state = plant.transition @ state - plant.now
    assert run.error[-1] == pytest.approx((1.0 - np.dot([kp, kd], state)) / kp, rel=1e-6)
    assert run.error[-1] > 1.05 / kp


# --- the notch ------------------------------------------------------------------------------------


@pytest.mark.parametrize("w", [50.0, 158.0, 1500.0])
def test_the_notch_is_that_of_scipy(w) -> None:
    width, floor = 0.5, 0.1
    top, under = shapes.notch(w, DT, width, floor)
    # SciPy's Tustin rule, its sampling rate chosen so that w stays in place.
    fs = 0.5 * w / math.tan(0.5 * w * DT)
    known = signal.bilinear([1.0, 2 * floor * width * w, w * w], [1.0, 2 * width * w, w * w], fs)
    assert top == pytest.approx(known[0], rel=1e-9, abs=1e-12)
    assert under == pytest.approx(known[1], rel=1e-9, abs=1e-12)
    _, at = signal.freqz(top, under, [1e-9, w * DT, math.pi - 1e-9])
    assert np.abs(at) == pytest.approx([1.0, floor, 1.0], rel=1e-6)
    # A notch to zero, with the quality at which SciPy's own has the same width.
    quality = 0.5 * w * DT / math.atan(width * math.sin(w * DT))
    known = signal.iirnotch(w * DT / math.pi, quality)
    assert np.concatenate(shapes.notch(w, DT, width, 0.0)) == pytest.approx(np.concatenate(known))


def test_a_law_behind_a_filter_is_the_filtered_command() -> None:
    law = pid_law(20.0, 5.0, 3.0, dt=DT, tau=0.01)
    top, under = shapes.notch(200.0, DT)
    y = np.random.default_rng(2).standard_normal((500, 2))

    def commands(one):
        c, out = np.zeros(one.C.size), []
        for row in y:
            out.append(one.C @ c + one.D @ row)
            c = one.A @ c + one.B @ row
        return np.array(out)

    known = signal.lfilter(top, under, commands(law))
    assert commands(shapes.behind(law, top, under)) == pytest.approx(known, rel=1e-9)


def test_the_elastic_joint_swings_at_its_resonance_and_is_rigid_in_the_limit() -> None:
    A, push = shapes.elastic_joint(0.2, 0.3, 3000.0)
    values = np.linalg.eigvals(A)
    assert np.max(values.imag) == pytest.approx(shapes.resonance(0.2, 0.3, 3000.0), rel=1e-9)
    stiff = held(*shapes.elastic_joint(0.2, 0.3, 1e7, B, 300.0), DT, 5 * DT)
    law = pid_law(40.0, 0.0, 6.0, dt=DT)
    one, two = (shapes.respond(p, law, added=1.0, samples=2000) for p in (stiff, joint(5)))
    assert one.error == pytest.approx(two.error, abs=1e-4 * np.abs(two.error).max())
    assert push[1] == pytest.approx(5.0)


@pytest.mark.prove
@pytest.mark.parametrize("share", [None, 1.0, 1.2])
def test_an_elastic_joint_diverges_just_past_the_limit_of_its_matrix(share) -> None:
    plant = held(*shapes.elastic_joint(0.2, 0.3, 3000.0, B, 0.3), DT, 5 * DT)
    w = shapes.resonance(0.2, 0.3, 3000.0)

    def law(factor):
        one = pid_law(200.0 * factor, 0.0, 20.0 * factor, dt=DT)
        return shapes.behind(one, *shapes.notch(share * w, DT)) if share else one

    limit = edge(lambda f: growth(loop_matrix(plant, law(f))) < 1.0, 0.1, 10.0)
    assert grows(plant, law(0.98 * limit)) < 1.0 < grows(plant, law(1.02 * limit))


# --- the simulated loop ---------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0, 3, 2.4])
def test_respond_is_the_compiled_joint(late) -> None:
    gains, n = Gains(20.0, 15.0, 4.0, rate_weight=1.0), 2000
    push = np.random.default_rng(3).standard_normal(n)
    run = run_joint(
        Joint(J, B), Actuator(delay=late * DT), Encoder(), gains, 0.0, DT, n * DT, extra=push
    )
    ours = shapes.respond(joint(late), gains.law(DT), push, samples=n)
    assert ours.error == pytest.approx(run.q, abs=1e-10)
    assert ours.command == pytest.approx(run.command, abs=1e-9)


@pytest.mark.prove
@pytest.mark.parametrize("late", [0, 3])
def test_the_noise_of_the_torque_is_that_of_a_long_run(late) -> None:
    law = shapes.observer_law(20.0, 4.0, 30.0, **MODEL, late=late)
    plant = joint(late)
    noise = np.random.default_rng(4).standard_normal(40_000)
    run = shapes.respond(plant, law, noise=noise, samples=noise.size)
    assert shapes.torque_noise(plant, law) == pytest.approx(np.std(run.command), rel=0.03)


# --- input ----------------------------------------------------------------------------------------

BAD = {
    "position": lambda: shapes.cascade(0.0, 1.0),
    "integral": lambda: shapes.cascade(1.0, 1.0, -1.0),
    "bandwidth": lambda: shapes.observer_share(0.0, DT),
    "late": lambda: shapes.predictor_law(1.0, 1.0, late=-1, **MODEL),
    "rate": lambda: shapes.observer_law(1.0, 1.0, 1.0, rate="filtered", **MODEL),
    "w must": lambda: shapes.notch(4000.0, DT),
    "under": lambda: shapes.behind(pid_law(1.0, dt=DT), [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]),
    "noise": lambda: shapes.respond(joint(), pid_law(1.0, dt=DT), noise=[0.0, 1.0], samples=3),
}


@pytest.mark.parametrize("match", BAD)
def test_bad_input_is_named(match) -> None:
    with pytest.raises(ValueError, match=match):
        BAD[match]()
