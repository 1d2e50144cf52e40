"""Joint velocities within limits: a bounded least-squares problem, and its two libraries."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from course import charts
from course.charts.kinematics import differential as chart
from course.kinematics import (
    bounded_velocity,
    damped_velocity,
    jacobian,
    panda,
    planar,
    pose_error,
    tip,
    velocity_bounds,
)
from course.oracles import mink, pink
from tests import optional

ARM = panda()
SEEDS = st.integers(0, 2**32 - 1)


def problem(seed):
    """A random problem: J, twist, bounds and damping; some J are singular, some bounds equal."""
    rng = np.random.default_rng(seed)
    m, n = rng.integers(1, 7), rng.integers(1, 10)
    J = rng.normal(size=(m, n))
    if rng.random() < 0.3:
        J[:, rng.integers(n)] = J[:, 0]
    low, high = -rng.uniform(0.0, 1.0, n), rng.uniform(0.0, 1.0, n)
    if rng.random() < 0.2:
        low[0] = high[0]
    low[rng.random(n) < 0.1] = -np.inf
    twist = rng.normal(size=m) * 10 ** rng.uniform(-2, 2)
    return J, twist, low, high, 10 ** rng.uniform(-4, 0)


def stacked(J, twist, damping):
    """The same objective as |A v - b|^2."""
    n = J.shape[1]
    return np.vstack([J, damping * np.eye(n)]), np.concatenate([twist, np.zeros(n)])


@settings(max_examples=150, deadline=None)
@given(SEEDS)
def test_the_solution_is_within_the_bounds_and_satisfies_the_kkt_conditions(seed):
    J, twist, low, high, damping = problem(seed)
    v, active, _ = bounded_velocity(J, twist, low, high, damping)
    assert ((low <= v) & (v <= high)).all()
    A, b = stacked(J, twist, damping)
    gradient = A.T @ (A @ v - b)
    rounding = 1e-12 * (np.abs(A).T @ (np.abs(A) @ np.abs(v) + np.abs(b)))
    # Stationary where a joint is free; at a bound the cost falls outwards only.
    assert (np.abs(gradient[~active]) <= rounding[~active]).all()
    at_low, at_high = v == low, v == high
    assert (active <= (at_low | at_high)).all()
    assert (gradient >= -rounding)[at_low & ~at_high].all()
    assert (gradient <= rounding)[at_high & ~at_low].all()


@settings(max_examples=100, deadline=None)
@given(SEEDS)
def test_it_is_as_good_as_scipys_bounded_least_squares(seed):
    J, twist, low, high, damping = problem(seed)
    A, b = stacked(J, twist, damping)
    free = low < high  # SciPy takes no equal bounds
    other = np.where(free, 0.0, low)
    if free.any():
        remaining = b - A[:, ~free] @ low[~free]
        box = (low[free], high[free])
        other[free] = lsq_linear(A[:, free], remaining, box, method="bvls", tol=1e-15).x
    v = bounded_velocity(J, twist, low, high, damping).v
    assert np.linalg.norm(A @ v - b) <= np.linalg.norm(A @ other - b) * (1.0 + 1e-10)
    # The objective is strictly convex: where damping is not tiny, the solutions are close too.
    if damping > 1e-2:
        np.testing.assert_allclose(v, other, atol=1e-7 * (1.0 + np.abs(other).max()))


@settings(max_examples=100, deadline=None)
@given(SEEDS)
def test_without_an_active_bound_it_is_the_damped_pseudo_inverse(seed):
    J, twist, _, _, damping = problem(seed)
    free = damped_velocity(J, twist, damping)
    v, active, solves = bounded_velocity(J, twist, -np.inf, np.inf, damping)
    assert not active.any() and solves == 1
    # From J J^T digits are lost with the square of the damping.
    np.testing.assert_allclose(v, free, atol=1e-14 * (1.0 + np.abs(free).max()) / damping**2)


@settings(max_examples=100, deadline=None)
@given(SEEDS, st.floats(0.01, 1.0), st.floats(1e-4, 0.1))
def test_no_velocity_within_the_bounds_leads_beyond_a_limit(seed, gain, dt):
    rng = np.random.default_rng(seed)
    q = rng.uniform(ARM.lower, ARM.upper)
    q[rng.integers(7)] = ARM.upper[0] if rng.random() < 0.1 else q[0]
    q = np.clip(q, ARM.lower, ARM.upper)
    low, high = velocity_bounds(ARM, q, 2.0, dt, gain)
    assert ((-2.0 <= low) & (low <= 0.0) & (high >= 0.0) & (high <= 2.0)).all()
    for v in (low, high, rng.uniform(low, high)):
        moved = q + dt * v
        assert (ARM.lower - 1e-14 <= moved).all() and (moved <= ARM.upper + 1e-14).all()


def test_beyond_a_limit_a_joint_is_led_back_no_faster_than_it_may_move():
    q = ARM.upper + np.array([1e-4, 1.0, 0, 0, 0, 0, 0])
    low, high = velocity_bounds(ARM, q, 2.0, 0.01)
    assert high[0] == pytest.approx(-0.95e-4 / 0.01) and high[1] == low[1] == -2.0
    v = bounded_velocity(jacobian(ARM, ARM.upper), np.ones(6), low, high, 0.01).v
    assert (v <= high).all()


def test_joints_without_limits_have_their_speed_limit_alone():
    low, high = velocity_bounds(planar([1.0, 0.8]), [3.0, -9.0], [1.0, 2.0], 0.01)
    np.testing.assert_array_equal([low, high], [[-1.0, -2.0], [1.0, 2.0]])


def test_the_other_joints_make_up_for_one_at_its_limit():
    """Two joints move one number, 2 v1 + v2: the first may do little, the second does the rest."""
    v, active, _ = bounded_velocity([[2.0, 1.0]], [3.0], [-0.5, -9.0], [0.5, 9.0], 1e-6)
    np.testing.assert_allclose(v, [0.5, 2.0], atol=1e-9)
    assert active.tolist() == [True, False]
    clipped = np.clip(damped_velocity([[2.0, 1.0]], [3.0], 1e-6), [-0.5, -9.0], [0.5, 9.0])
    np.testing.assert_allclose(clipped, [0.5, 0.6], atol=1e-9)


@pytest.mark.parametrize("name", ["clipped", "scaled", "quadratic program"])
def test_on_a_path_no_joint_leaves_its_limits(name):
    dt = 0.02
    motion = chart.reference(ARM, np.random.default_rng(3), dt)
    velocity = chart.methods(ARM, dt, libraries=False)[name]
    assert chart.follow(ARM, velocity, motion, dt).beyond <= 1e-12
    unlimited = chart.methods(ARM, dt, libraries=False)["no limits"]
    assert chart.follow(ARM, unlimited, motion, dt).beyond > 1e-3


LIBRARIES = {"mink": mink, "pink": pink}


@pytest.mark.prove
@pytest.mark.optional
@pytest.mark.parametrize("name", LIBRARIES)
def test_the_library_solves_the_same_program(name):
    """Up to the shape of a step: the library's error is a screw, ours a line and a turn.

    Both agree to first order, so ten times smaller steps agree ten times better.
    """
    dt, fastest, damping = 0.01, 2.0, 0.05
    try:
        tracker = LIBRARIES[name].Tracker(ARM, fastest, dt, damping)
    except ImportError as error:
        optional.skip(f"differential inverse kinematics was NOT compared with {name}: {error}")
    rng, limited = np.random.default_rng(0), 0
    for _ in range(60):
        q = rng.uniform(ARM.lower, ARM.upper)
        joint = rng.integers(7)
        q[joint] = (ARM.lower, ARM.upper)[rng.integers(2)][joint]
        direction = rng.normal(size=7)
        for step in (1e-3, 1e-4):
            target = tip(ARM, q + step * direction)
            twist = pose_error(target, tip(ARM, q)) / dt
            bounds = velocity_bounds(ARM, q, fastest, dt)
            v, active, _ = bounded_velocity(jacobian(ARM, q), twist, *bounds, damping)
            difference = np.abs(tracker.velocity(q, target) - v).max()
            assert difference < 20.0 * step * np.linalg.norm(twist)
            limited += int(active.any())
    assert limited > 20


@pytest.mark.prove
def test_the_program_follows_best_within_the_limits():
    accuracy, right = charts.build("velocity_limits", cycles=(0.05,), paths=30, libraries=False)
    error = {series.label: series.y[0] for series in accuracy.series}
    program = error["quadratic program"]
    assert error["no limits"] < program < 0.5 * error["clipped"] < error["scaled"]
    assert "over a limit on 0% of paths" in accuracy["quadratic program"].note
    assert {series.label for series in right.series} == {*error}


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: bounded_velocity(np.eye(2), [1.0], 0.0, 1.0, 0.1), r"twist.shape must be \(2,\)"),
        (lambda: bounded_velocity(np.eye(2), [1, 1], 1.0, 0.0, 0.1), r"\(low, high\) must be"),
        (lambda: bounded_velocity(np.eye(2), [1, 1], [0], 1.0, 0.1), r"low.shape must be"),
        (lambda: bounded_velocity(np.eye(2), [1, 1], -1, 1, 0.0), "damping must be a positive"),
        (lambda: damped_velocity(np.eye(2), [1, 1], -1.0), "damping must be a positive"),
        (lambda: velocity_bounds(ARM, np.zeros(6), 1.0, 0.01), r"q.shape must be \(7,\)"),
        (lambda: velocity_bounds(ARM, np.zeros(7), 0.0, 0.01), "fastest must be a positive"),
        (lambda: velocity_bounds(ARM, np.zeros(7), 1.0, 0.01, 1.5), "gain must be"),
        (lambda: velocity_bounds(ARM, np.zeros(7), 1.0, 0.0), "dt must be a positive"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.optional
def test_with_minks_error_of_a_pose_both_solvers_agree() -> None:
    """What differs between mink and `bounded_velocity` in large steps is only the pose's error."""
    dt, fastest, damping = 0.05, 2.0, 0.01
    try:
        tracker = mink.Tracker(ARM, fastest, dt, damping)
    except ImportError as error:
        optional.skip(f"differential inverse kinematics was NOT compared with mink: {error}")
    rng, apart = np.random.default_rng(1), 0.0
    for _ in range(20):
        q = rng.uniform(ARM.lower, ARM.upper)
        target = tip(ARM, q + 0.1 * rng.normal(size=7))
        theirs = tracker.velocity(q, target)
        task, configuration = tracker._task, tracker._configuration
        J, error = task.compute_jacobian(configuration), task.compute_error(configuration)
        bounds = velocity_bounds(ARM, q, fastest, dt)
        assert theirs == pytest.approx(
            bounded_velocity(J, -error / dt, *bounds, damping).v, abs=1e-6
        )
        twist = pose_error(target, tip(ARM, q)) / dt
        ours = bounded_velocity(jacobian(ARM, q), twist, *bounds, damping).v
        apart = max(apart, float(np.abs(ours - theirs).max()))
    assert apart > 1e-3
