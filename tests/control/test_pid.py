"""The PID drill's answer and its joint, against SciPy, closed forms and MuJoCo."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.charts.control import pid as charts
from course.charts.control.pid import LOOP, Loop, WindingPID
from course.drills import PID, ExactJoint, closed_loop
from course.oracles.mujoco import kit as mujoco_kit
from course.oracles.mujoco.joint import MotorJoint
from tests.drills.here import grade_here

INF = math.inf


def controller(**changes):
    numbers = dict(kp=2.0, ki=3.0, kd=0.4, dt=0.01, u_min=-5.0, u_max=4.0, tau=0.03)
    return PID(**(numbers | changes))


def commands(pid, setpoints, measurements):
    pairs = np.broadcast(np.asarray(setpoints, float), np.asarray(measurements, float))
    return np.array([pid.update(w, y) for w, y in pairs])


# --- the three parts ------------------------------------------------------------------------------


def test_each_part_alone():
    y = np.sin(np.arange(40.0))
    error = 0.5 - y
    assert commands(controller(ki=0, kd=0), 0.5, y) == pytest.approx(2.0 * error, abs=1e-14)
    summed = 3.0 * 0.01 * np.cumsum(error)
    assert commands(controller(kp=0, kd=0), 0.5, y) == pytest.approx(summed, abs=1e-14)


@pytest.mark.parametrize("tau", [0.0, 0.002, 0.03, 1.0])
def test_the_derivative_is_scipys_backward_difference_of_s_over_one_plus_tau_s(tau):
    from scipy import signal

    dt = 0.01
    y = np.concatenate([[0.0], np.random.default_rng(3).normal(size=200)])
    # s -> (1 - 1/z) / dt in s / (tau s + 1)
    expected = signal.lfilter([1.0, -1.0], [tau + dt, -tau], y)
    got = commands(controller(kp=0, ki=0, tau=tau, u_min=-INF, u_max=INF), 0.0, y)
    assert got == pytest.approx(-0.4 * expected, rel=1e-12, abs=1e-12)


def test_a_ramp_is_followed_with_the_filters_time_constant():
    tau, dt, slope = 0.05, 1e-4, 0.7
    y = slope * dt * np.arange(10_000)
    got = commands(controller(kp=0, ki=0, kd=1.0, dt=dt, tau=tau), 0.0, y)
    expected = -slope * (1.0 - np.exp(-dt * np.arange(y.size) / tau))
    assert np.max(np.abs(got - expected)) < slope * dt / tau  # first order in the step


@given(
    dt=st.floats(1e-4, 1e-1),
    ratio=st.floats(0.0, 50.0),
    kd=st.floats(0.01, 10.0),
    step=st.floats(-3.0, 3.0),
)
def test_a_step_of_the_set_point_makes_no_kick(dt, ratio, kd, step):
    tau = ratio * dt
    wide = dict(dt=dt, tau=tau, kd=kd, u_min=-INF, u_max=INF)
    pid = controller(**wide)
    pid.update(0.0, 0.0)
    assert pid.update(step, 0.0) == pytest.approx((2.0 + 3.0 * dt) * step, abs=1e-12)
    # The derivative of the error would have added kd step / (tau + dt), as the measurement does.
    pid = controller(**wide)
    pid.update(0.0, 0.0)
    kick = pid.update(0.0, -step) - (2.0 + 3.0 * dt) * step
    assert kick == pytest.approx(kd * step / (tau + dt), rel=1e-9, abs=1e-9)


@pytest.mark.prove
@pytest.mark.parametrize("tau", [0.0, 0.01, 0.05])
def test_noise_comes_through_the_filter_as_theory_says(tau):
    dt, n = 0.01, 200_000
    noise = np.random.default_rng(5).normal(size=n)
    pid = controller(kp=0, ki=0, kd=1.0, dt=dt, tau=tau, u_min=-INF, u_max=INF)
    got = np.std(commands(pid, 0.0, noise)[1000:])
    # a first-order recursion driven by differences of white noise
    theory = math.sqrt(2.0 / ((tau + dt) * (2.0 * tau + dt)))
    assert got == pytest.approx(theory, rel=0.01)
    assert theory <= math.sqrt(2.0) / dt


# --- limits, windup, bumps ------------------------------------------------------------------------


@given(
    st.lists(st.tuples(st.floats(-50, 50), st.floats(-50, 50)), min_size=1, max_size=60),
    st.floats(-3.0, 1.0),
    st.floats(0.1, 4.0),
)
def test_the_command_stays_between_its_limits_and_the_integral_does_not_run_away(
    pairs, u_min, width
):
    u_max = u_min + width
    pid = controller(u_min=u_min, u_max=u_max)
    for setpoint, measurement in pairs:
        before = abs(pid.integral)
        assert u_min <= pid.update(setpoint, measurement) <= u_max
        error = setpoint - measurement
        # It grows only while the command that it would make is within the limits.
        room = max(abs(u_min), abs(u_max)) + 2.0 * abs(error) + 0.4 * abs(pid.rate)
        assert abs(pid.integral) <= max(before, room) + 1e-9


def test_held_at_a_limit_the_integral_stands_still_and_leaves_at_once():
    pid = controller(kd=0.0)
    commands(pid, 10.0, np.zeros(1000))
    assert pid.integral == 0.0  # kp * 10 alone is above the limit
    assert pid.update(-0.5, 0.0) == pytest.approx(-(2.0 + 3.0 * 0.01) * 0.5)
    winding = WindingPID(2.0, 3.0, 0.0, 0.01, -5.0, 4.0, 0.03)
    commands(winding, 10.0, np.zeros(1000))
    assert winding.integral == pytest.approx(3.0 * 10.0 * 10.0)
    assert winding.update(-0.5, 0.0) == 4.0  # still at the wrong limit


def test_an_error_that_leads_out_of_the_limit_is_integrated():
    pid = controller(kd=0.0)
    pid.integral = 10.0
    pid.update(-1.0, 0.0)
    assert pid.integral == pytest.approx(10.0 - 0.03)


def test_a_new_integral_gain_makes_no_bump():
    pid = controller(kp=1.0, kd=0.0, u_min=-INF, u_max=INF)
    commands(pid, 1.0, np.zeros(500))
    before = pid.update(0.0, 0.0)
    pid.ki = 30.0
    assert pid.update(0.0, 0.0) == before


@pytest.mark.prove
@given(st.lists(st.floats(-5, 5), min_size=1, max_size=30))
def test_reset_is_a_new_controller_and_two_do_not_share(measurements):
    used, other = controller(), controller()
    commands(used, 1.0, measurements)
    used.reset()
    fresh = controller()
    assert commands(used, 0.3, measurements) == pytest.approx(
        commands(fresh, 0.3, measurements), abs=0.0
    )
    assert vars(other) == vars(controller())


def test_the_first_update_takes_no_derivative():
    pid = controller(tau=0.0)
    assert pid.update(1.0, 1.0) == 0.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("dt", 0.0),
        ("dt", -0.01),
        ("dt", INF),
        ("dt", math.nan),
        ("tau", -0.1),
        ("tau", math.nan),
        ("kp", -1.0),
        ("ki", math.nan),
        ("kd", INF),
        ("u_min", 4.0),
        ("u_max", -6.0),
        ("u_max", math.nan),
    ],
)
def test_wrong_numbers_are_refused(name, value):
    with pytest.raises(ValueError, match="u_min" if name.startswith("u_") else name):
        controller(**{name: value})


@pytest.mark.parametrize("bad", [math.nan, INF, -INF])
def test_a_measurement_that_is_not_finite_is_refused_and_leaves_no_trace(bad):
    pid, twin = controller(), controller()
    for one in (pid, twin):
        one.update(1.0, 0.2)
    for pair in ((bad, 0.0), (0.0, bad)):
        with pytest.raises(ValueError, match="must be a finite number"):
            pid.update(*pair)
    assert pid.update(1.0, 0.3) == twin.update(1.0, 0.3)


# --- the joint ------------------------------------------------------------------------------------


@given(
    inertia=st.floats(1e-3, 10.0),
    damping=st.one_of(st.just(0.0), st.floats(1e-9, 20.0)),
    dt=st.floats(1e-4, 0.1),
    q=st.floats(-3, 3),
    v=st.floats(-3, 3),
    torque=st.floats(-3, 3),
)
def test_the_joint_is_scipys_zero_order_hold(inertia, damping, dt, q, v, torque):
    from scipy.signal import cont2discrete

    a = np.array([[0.0, 1.0], [0.0, -damping / inertia]])
    b = np.array([[0.0], [1.0 / inertia]])
    ad, bd, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), dt)
    joint = ExactJoint(inertia, damping, dt, load=0.5)
    joint.reset(q, v)
    joint.step(torque)
    expected = ad @ [q, v] + bd[:, 0] * (torque + 0.5)
    scale = 1.0 + np.max(np.abs(expected)) + dt / inertia
    assert [joint.q, joint.v] == pytest.approx(expected, abs=1e-11 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_mujocos_joint_converges_to_the_exact_one(integrator):
    torques = np.random.default_rng(1).uniform(-2.0, 2.0, 400)
    exact = LOOP.joint()
    truth = np.array([exact.step(u) for u in torques])
    errors = []
    for substeps in (1, 10, 100):
        joint = LOOP.mujoco(substeps, integrator)
        errors.append(np.max(np.abs([joint.step(u) for u in torques] - truth)))
    if integrator == "RK4":
        assert errors[0] < 1e-8 and errors[1] < 1e-11
    else:
        assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.05)
        assert errors[1] / errors[2] == pytest.approx(10.0, rel=0.05)


def test_dry_friction_holds_what_is_below_it_and_takes_what_is_above():
    joint = MotorJoint(0.05, 0.0, 0.005, friction=0.2)
    for _ in range(200):
        joint.step(0.19)
    assert abs(joint.q) < 1e-4
    joint.reset()
    for _ in range(200):
        joint.step(0.7)
    assert joint.v == pytest.approx(0.5 / 0.05, rel=1e-3)  # 1 s of the rest


@pytest.mark.parametrize("kind", ["exact", "mujoco"])
def test_a_jammed_joint_stays_and_leaves_when_it_is_free(kind):
    joint = LOOP.joint() if kind == "exact" else LOOP.mujoco()
    joint.reset(0.4, 1.0)
    held = [joint.step(2.0, True) for _ in range(100)]
    assert abs(held[-1] - 0.4) < 1e-3
    assert np.ptp(held[5:]) < 1e-5
    assert abs(joint.v) < 1e-6
    free = ExactJoint(LOOP.inertia, LOOP.damping, LOOP.dt, LOOP.load)
    free.reset(held[-1])
    for _ in range(20):
        free.step(1.0)
        joint.step(1.0)
    assert joint.q == pytest.approx(free.q, abs=1e-3)


@pytest.mark.parametrize("kind", [ExactJoint, MotorJoint])
@pytest.mark.parametrize(
    ("name", "value"),
    [("inertia", 0.0), ("inertia", math.nan), ("damping", -1.0), ("dt", 0.0), ("load", INF)],
)
def test_a_joint_refuses_wrong_numbers(kind, name, value):
    with pytest.raises(ValueError, match=name):
        kind(**(dict(inertia=0.05, damping=0.1, dt=0.01, load=0.0) | {name: value}))


def test_mujocos_joint_refuses_its_own_wrong_numbers():
    wrong: tuple[dict[str, Any], ...]
    wrong = ({"friction": -0.1}, {"substeps": 0}, {"integrator": "Heun"})
    for changes in wrong:
        with pytest.raises(ValueError, match=next(iter(changes))):
            MotorJoint(0.05, 0.1, 0.005, **changes)
    assert "implicitfast" in mujoco_kit.MUJOCO_INTEGRATORS


def test_closed_loop_hands_over_noise_and_jam():
    pid, joint = LOOP.controller(), LOOP.joint()
    noise = 0.1 * np.ones(4)
    angles, sent = closed_loop(pid, joint, np.zeros(4), [True, True, False, False], noise)
    assert angles.shape == (5,) and sent.shape == (4,)
    assert angles[:3] == pytest.approx(np.zeros(3), abs=0.0) and angles[4] != 0.0
    assert sent[0] == pytest.approx(-0.1 * (LOOP.kp + LOOP.ki * LOOP.dt))


# --- stability ------------------------------------------------------------------------------------


def test_proportional_control_alone_has_a_closed_form_limit():
    # z^2 - (1 + a - kp b1) z + a + kp (reach b2 - a b1): its last coefficient reaches 1 first
    loop = Loop(ki=0.0, kd=0.0, kp=1.0, tau=0.0, dt=0.02)
    joint = loop.joint()
    (_, reach), (_, a) = joint.transition
    b1, b2 = joint.drive
    limit = (1.0 - a) / (reach * b2 - a * b1)
    for growth in (charts.theoretical_growth, charts.measured_growth):
        assert charts.gain_limit(loop, growth) == pytest.approx(limit, rel=2e-4)


@pytest.mark.parametrize(
    "loop",
    [LOOP, Loop(dt=0.02), Loop(tau=0.0), Loop(ki=0.0), Loop(damping=0.0, tau=0.04), Loop(kd=2.0)],
)
def test_the_measured_growth_is_the_largest_root(loop):
    theory = charts.theoretical_growth(loop)
    if loop.ki == 0.0:
        theory = max(theory, 1.0)  # the integral stands still, and is part of the state
    # a triple root is known to the cube root of rounding
    assert charts.measured_growth(loop) == pytest.approx(theory, rel=2e-5)


@pytest.mark.parametrize("dt", [0.002, 0.005, 0.015])
def test_the_measured_gain_limit_is_theorys_and_both_sides_of_it_run(dt):
    loop = Loop(dt=dt, load=0.0)
    limit = charts.gain_limit(loop, charts.theoretical_growth)
    assert charts.gain_limit(loop, charts.measured_growth) == pytest.approx(limit, rel=3e-4)

    def ends(gain):
        joint = loop.joint()
        joint.reset(1e-3)
        at = loop.scaled(gain)
        angles, _ = closed_loop(at.controller(limit=INF), joint, np.zeros(20_000))
        return float(np.max(np.abs(angles[-200:])) / np.max(np.abs(angles[:200])))

    assert ends(0.99 * limit) < 0.01
    assert ends(1.01 * limit) > 100.0


def test_the_slowest_stable_rate_is_theorys():
    theory = charts.rate_limit(LOOP, charts.theoretical_growth)
    assert charts.rate_limit(LOOP, charts.measured_growth) == pytest.approx(theory, rel=3e-4)
    assert theory > 2.0 * LOOP.dt


def test_mujocos_loop_has_the_same_limit():
    theory = charts.gain_limit(LOOP, charts.theoretical_growth)

    def limit(integrator, substeps):
        def growth(loop):
            joint = Loop(**(vars(loop) | {"load": 0.0})).mujoco(substeps, integrator)
            step = charts.loop_step(loop, joint)
            return charts.stability.spectral_radius(charts.stability.amplification(step, 5))

        return charts.gain_limit(LOOP, growth)

    assert limit("RK4", 1) == pytest.approx(theory, rel=3e-4)
    # first order in its step, which is what the difference comes from
    coarse, fine = (limit("implicitfast", n) / theory - 1.0 for n in (10, 40))
    assert coarse / fine == pytest.approx(4.0, rel=0.2)


# --- windup ---------------------------------------------------------------------------------------


def test_the_scene_fits_its_question_and_its_neighbours_do_not():
    scene = charts.jam_scene()
    assert scene.check() == []
    changed = charts.overshoot(kind=WindingPID) - charts.overshoot()
    assert changed > 100.0 * scene.tolerance.value  # as its tolerance says
    assert charts.overshoot(Loop(friction=0.2).mujoco()) < charts.overshoot() - 0.01


@pytest.mark.parametrize("joint", ["exact", "mujoco"])
def test_anti_windup_recovers_from_a_jam_and_its_absence_does_not(joint):
    def run(kind):
        plant = LOOP.joint() if joint == "exact" else LOOP.mujoco()
        times, angles, _ = charts.jammed(joint=plant, kind=kind)
        return charts.recovery(times, angles)

    with_it, without = run(PID), run(WindingPID)
    assert without.overshoot > 10.0 * with_it.overshoot
    assert without.time > 2.0 * with_it.time
    # Without it the integral holds what the jam gave it: ki times error times time.
    times, _, _ = charts.jammed(kind=WindingPID)
    assert LOOP.ki * charts.STEP * charts.JAM > 5.0 * LOOP.limit and times[-1] > charts.JAM


def test_a_jam_that_saturates_leaves_no_trace_at_all():
    # kp times the error alone is at the limit: nothing is integrated while the joint is held.
    n, held = 1200, 400
    free, _ = closed_loop(LOOP.controller(), LOOP.joint(), np.ones(n - held))
    late, _ = closed_loop(LOOP.controller(), LOOP.joint(), np.ones(n), np.arange(n) < held)
    assert late[held:] == pytest.approx(free, abs=1e-15)


def test_the_load_is_carried_and_a_record_that_does_not_settle_is_refused():
    times, angles, sent = charts.jammed()
    assert angles[-1] == pytest.approx(charts.STEP, abs=1e-6)
    assert sent[-1] == pytest.approx(-LOOP.load, abs=1e-5)
    with pytest.raises(ValueError, match="angles"):
        charts.recovery(times[:420], angles[:420])


# --- the drill takes every sensible answer --------------------------------------------------------

ANSWER = """
import math


class PID:
    def __init__(self, kp, ki, kd, dt, u_min, u_max, tau):
        gains = (kp, ki, kd, dt, tau)
        if not all(0 <= x < math.inf for x in gains) or dt == 0 or not u_min < u_max:
            raise ValueError("bad argument")
        self.kp, self.ki, self.kd, self.dt, self.tau = gains
        self.low, self.high = u_min, u_max
        self.reset()

    def reset(self):
        self.i = self.d = 0.0
        self.saturated = 0
        self.y = self.smooth = self.e = None

    def update(self, setpoint, y):
        if not (math.isfinite(setpoint) and math.isfinite(y)):
            raise ValueError("not finite")
        dt, tau, ki = self.dt, self.tau, self.ki
        if self.y is None:
            self.y = self.smooth = y
            self.e = setpoint - y
        change = y - self.y
        {derivative}
        self.y = y
        e = setpoint - y
        pd = self.kp * e - self.kd * self.d
        {integral}
        return u
"""
CUT = "u = min(max(raw, self.low), self.high)"
DERIVATIVES = {
    "backward": "self.d = (tau * self.d + change) / (tau + dt)",
    "Tustin": "self.d = ((2 * tau - dt) * self.d + 2 * change) / (2 * tau + dt)",
    "exact": "a = math.exp(-dt / tau); self.d = a * self.d + (1 - a) * change / dt",
    "forward": "self.d += dt / tau * (change / dt - self.d)",
    "smoothed measurement": "old = self.smooth; self.smooth += dt / (tau + dt) * (y - old); "
    "self.d = (self.smooth - old) / dt",
}
INTEGRALS = {
    "clamped to the limits": f"""self.i = min(max(self.i + ki * e * dt, self.low), self.high)
        raw = pd + self.i
        {CUT}""",
    "integrated after use, frozen": f"""raw = pd + self.i
        {CUT}
        if u == raw or raw * e < 0:
            self.i += ki * e * dt""",
    "judged by the sample before": f"""if self.saturated * e <= 0:
            self.i += ki * e * dt
        raw = pd + self.i
        {CUT}
        self.saturated = (raw > u) - (raw < u)""",
    "trapezoid": f"""new = self.i + ki * 0.5 * (e + self.e) * dt
        self.e = e
        raw = pd + new
        {CUT}
        if u == raw or (raw - u) * e < 0:
            self.i = new""",
    "back-calculation": f"""self.i += ki * e * dt
        raw = pd + self.i
        {CUT}
        self.i += dt / (self.kp / ki if ki and self.kp else 1.0) * (u - raw)""",
    "back-calculation in one sample": f"""raw = pd + self.i + ki * e * dt
        {CUT}
        self.i = u - pd if ki else 0.0""",
    "back-calculation, slow": f"""self.i += ki * e * dt
        raw = pd + self.i
        {CUT}
        self.i += dt * (u - raw)""",
    "none": f"""self.i += ki * e * dt
        raw = pd + self.i
        {CUT}""",
}


def graded(derivative, integral, seed):
    text = ANSWER.replace("{derivative}", DERIVATIVES[derivative])
    return grade_here("pid", text.replace("{integral}", INTEGRALS[integral]), seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("derivative", "integral"),
    [
        ("Tustin", "back-calculation"),
        ("exact", "clamped to the limits"),
        ("forward", "integrated after use, frozen"),
        ("smoothed measurement", "judged by the sample before"),
        ("backward", "trapezoid"),
        ("backward", "back-calculation in one sample"),
    ],
)
def test_another_discretisation_or_anti_windup_is_right(derivative, integral):
    report = graded(derivative, integral, seed=11)
    assert report.passed, report.sentence
    assert report.slip == ""


@pytest.mark.slow
def test_anti_windup_that_is_missing_or_too_slow_is_told_apart():
    missing, slow = (graded("Tustin", kind, 12) for kind in ("none", "back-calculation, slow"))
    assert (missing.verdict, missing.slip) == ("fail", "integral_not_stopped")
    assert (slow.verdict, slow.slip) == ("fail", "")
    assert "too slowly" in slow.sentence
