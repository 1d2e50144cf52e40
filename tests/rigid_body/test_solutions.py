"""The worked answers of chapter 1, against closed forms, MuJoCo and the laws they must keep."""

import math
import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from course.measure import stability
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import free as mujoco_free
from course.oracles.mujoco import kit as mujoco_kit
from course.oracles.mujoco import oscillator as mujoco_oscillator
from course.rigid_body import planar, problems, quaternion
from solutions import rigid_body as solutions
from tests.budget import examples

# A busy machine is no defect of the code: no example has a deadline.
unhurried = examples(60)


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No answer may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def numbers(low: float, high: float):
    return st.floats(low, high, allow_nan=False)


def vectors(size: int, bound: float):
    return st.lists(numbers(-bound, bound), min_size=size, max_size=size).map(np.array)


def unit_quaternions():
    return (
        vectors(4, 1.0)
        .filter(lambda q: np.linalg.norm(q) > 0.1)
        .map(lambda q: q / np.linalg.norm(q))
    )


def observed(errors: list[float]) -> float:
    """Order from the last halving of the step."""
    return float(np.log2(errors[-2] / errors[-1]))


# --- velocity Verlet ------------------------------------------------------------------------------


def verlet(q, v, acceleration, dt, steps):
    """States after every step, and how often the acceleration was asked for."""
    calls = 0

    def counted(x):
        nonlocal calls
        calls += 1
        return acceleration(x)

    a = counted(q)
    path = [(q, v)]
    for _ in range(steps):
        q, v, a = solutions.verlet_step(q, v, a, counted, dt)
        path.append((q, v))
    return path, calls


def pendulum_acceleration(q):
    return -problems.STANDARD_GRAVITY * np.sin(q)


def test_verlet_is_of_second_order_on_the_pendulum():
    truth, errors = problems.pendulum(), []
    for steps in (800, 1600, 3200):
        path, _ = verlet(
            truth.system.q0, truth.system.v0, pendulum_acceleration, 2.0 / steps, steps
        )
        errors.append(truth.error(path[-1][0]))
    assert observed(errors) == pytest.approx(2.0, abs=0.1)
    assert errors[-1] < 1e-5


def test_verlet_asks_for_the_acceleration_once_a_step():
    path, calls = verlet(np.array([1.0]), np.array([0.0]), pendulum_acceleration, 0.01, 50)
    assert len(path) == 51
    assert calls == 51


def test_verlet_has_the_positions_of_mujoco_euler_started_half_a_step_earlier():
    """The two methods differ only in where the velocity is read off."""
    omega, dt, steps = 2.0 * math.pi, 0.01, 300
    q, v = np.array([0.4]), np.array([-1.1])
    path, _ = verlet(q, v, lambda x: -(omega**2) * x, dt, steps)
    earlier = v[0] + 0.5 * dt * omega**2 * q[0]
    runner = mujoco_oscillator.oscillator(1.0, omega**2, 0.0, q[0], earlier, dt, "Euler")
    ours = np.array([state[0][0] for state in path])
    assert runner.samples(steps).q[0] == pytest.approx(ours, abs=1e-11)
    # Started with the velocity as it is, MuJoCo is visibly elsewhere.
    other = mujoco_oscillator.oscillator(1.0, omega**2, 0.0, q[0], v[0], dt, "Euler").samples(steps)
    assert np.max(np.abs(other.q[0] - ours)) > 1e-3


@unhurried
@given(vectors(2, 2.0), vectors(2, 3.0), numbers(1e-4, 0.05), st.integers(1, 60))
def test_verlet_runs_back(q, v, dt, steps):
    path, _ = verlet(q, v, pendulum_acceleration, dt, steps)
    end_q, end_v = path[-1]
    back, _ = verlet(end_q, end_v, pendulum_acceleration, -dt, steps)
    assert back[-1][0] == pytest.approx(q, abs=1e-10)
    assert back[-1][1] == pytest.approx(v, abs=1e-10)


@unhurried
@given(numbers(-2.5, 2.5), numbers(-3.0, 3.0), numbers(0.001, 0.3))
def test_verlet_keeps_area(q, v, dt):
    """The determinant of the map (q, v) -> (q, v), by central differences."""

    def step(state):
        one = np.array(state[:1]), np.array(state[1:])
        a = pendulum_acceleration(one[0])
        new_q, new_v, _ = solutions.verlet_step(*one, a, pendulum_acceleration, dt)
        return np.array([new_q[0], new_v[0]])

    h, state = 1e-5, np.array([q, v])
    columns = [(step(state + h * e) - step(state - h * e)) / (2.0 * h) for e in np.eye(2)]
    assert np.linalg.det(np.array(columns)) == pytest.approx(1.0, abs=1e-8)


def test_verlet_leaves_its_arguments_and_refuses_other_shapes():
    q, v, a = np.ones(3), np.zeros(3), np.full(3, -1.0)
    solutions.verlet_step(q, v, a, lambda x: -x, 0.1)
    assert (q == 1.0).all() and (v == 0.0).all() and (a == -1.0).all()
    with pytest.raises(ValueError, match=r"one shape, got \(3,\), \(3,\), \(1,\)"):
        solutions.verlet_step(q, v, a[:1], lambda x: -x, 0.1)


# --- orientation ----------------------------------------------------------------------------------


@unhurried
@given(unit_quaternions(), vectors(3, 1e4), numbers(0.0, 10.0))
def test_orientation_keeps_unit_length_and_agrees_with_the_course(q, omega, dt):
    new = solutions.update_orientation(q, omega, dt)
    assert abs(np.linalg.norm(new) - 1.0) < 4e-16
    expected = quaternion.product(q, quaternion.exp(dt * omega))
    # An angle of 1e5 rad is itself only known to its rounding.
    assert new == pytest.approx(expected, abs=1e-15 * (4.0 + dt * np.linalg.norm(omega)))


@pytest.mark.parametrize("angle", [0.0, 5e-324, 1e-200, 1e-16, 1e-8, 1e-4, 3.0, 2.0 * math.pi])
def test_orientation_from_the_smallest_angle_to_a_full_turn(angle):
    start = quaternion.exp(np.array([0.3, -0.7, 0.2]))
    axis = np.array([0.6, 0.0, -0.8])
    new = solutions.update_orientation(start, angle / 0.5 * axis, 0.5)
    turn = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
    assert new == pytest.approx(quaternion.product(start, turn), abs=5e-16)


def test_orientation_does_not_lose_a_small_turn():
    """What 1 - cos would lose: 1e-9 rad stays 1e-9 rad."""
    new = solutions.update_orientation(np.array([1.0, 0, 0, 0]), np.array([1e-9, 0, 0]), 1.0)
    assert new[1] == pytest.approx(0.5e-9, rel=1e-15)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicitfast"])
def test_orientation_is_where_mujoco_puts_a_ball_of_equal_moments(integrator):
    """Equal moments have no gyroscopic torque: the body rate is constant, one step is exact."""
    start, omega = quaternion.exp(np.array([1.0, 0.4, -0.3])), np.array([2.0, -5.0, 1.0])
    runner = mujoco_free.free_body(np.ones(3), start, omega, 0.05, integrator)
    q, v = runner.run(1)
    assert v == pytest.approx(omega, abs=1e-12)
    new = solutions.update_orientation(start, omega, 0.05)
    assert quaternion.angle_between(q, new) < 1e-14
    other_side = quaternion.product(quaternion.exp(0.05 * omega), start)
    assert quaternion.angle_between(q, other_side) > 0.05


def test_orientation_over_many_steps_is_one_long_step():
    omega, q = np.array([3.0, -1.0, 2.0]), np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(20_000):
        q = solutions.update_orientation(q, omega, 1e-3)
    whole = solutions.update_orientation(np.array([1.0, 0, 0, 0]), omega, 20.0)
    assert abs(np.linalg.norm(q) - 1.0) < 4e-16
    assert quaternion.angle_between(q, whole) < 1e-11


@pytest.mark.parametrize(
    ("q", "omega", "match"),
    [
        ([0, 0, 0, 0], [1, 0, 0], "unit quaternion"),
        ([2, 0, 0, 0], [1, 0, 0], "unit quaternion"),
        ([math.nan, 0, 0, 1], [1, 0, 0], "unit quaternion"),
        ([1, 0, 0, 0], [math.nan, 0, 0], "finite"),
        ([1, 0, 0, 0], [math.inf, 0, 0], "finite"),
    ],
)
def test_orientation_refuses(q, omega, match):
    with pytest.raises(ValueError, match=match):
        solutions.update_orientation(np.array(q, float), np.array(omega, float), 0.1)


# --- the bouncing ball ----------------------------------------------------------------------------


def energy(y: float, v: float, gravity: float = 9.81) -> float:
    return 0.5 * v * v + gravity * y


def bounce_by_bounce(y, v, dt, restitution, gravity):
    """The same, one flight after the other, until an impact is slower than 1e-13 m/s."""
    impacts = 0
    while True:
        speed = math.sqrt(v * v + 2.0 * gravity * y)
        fall = (v + speed) / gravity
        if dt < fall:
            return y + v * dt - 0.5 * gravity * dt * dt, v - gravity * dt, impacts
        y, v, dt, impacts = 0.0, restitution * speed, dt - fall, impacts + 1
        if v < 1e-13:
            return 0.0, 0.0, impacts


@unhurried
@given(
    numbers(0.0, 3.0),
    numbers(-10.0, 10.0),
    numbers(1e-4, 5.0),
    numbers(0.0, 1.0),
    numbers(0.1, 30.0),
)
def test_bounce_agrees_with_one_flight_after_the_other(y, v, dt, restitution, gravity):
    assume(restitution < 0.99 or math.hypot(v, y) > 0.1)  # the loop has to end
    got = solutions.bounce_step(y, v, dt, restitution, gravity)
    *expected, impacts = bounce_by_bounce(y, v, dt, restitution, gravity)
    # At an impact the velocity jumps: compare what does not, and the velocity away from it.
    slack = 1e-9 * (1 + impacts)
    assert got[0] == pytest.approx(expected[0], abs=slack)
    if expected[0] > 1e-6:
        assert got[1] == pytest.approx(expected[1], abs=slack)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8, 0.95])
@pytest.mark.parametrize("t", [0.1, 0.7, 1.5, 3.1, 9.0, 60.0])
def test_bounce_is_the_closed_form_in_one_step_and_in_many(restitution, t):
    expected = problems.bounce_height(t, 1.0, restitution)
    gravity = problems.STANDARD_GRAVITY
    assert solutions.bounce_step(1.0, 0.0, t, restitution, gravity)[0] == pytest.approx(
        expected, abs=1e-10
    )
    state = 1.0, 0.0
    for _ in range(700):
        state = solutions.bounce_step(*state, t / 700, restitution, gravity)
    assert state[0] == pytest.approx(expected, abs=1e-8)


@unhurried
@given(numbers(0.0, 3.0), numbers(-5.0, 5.0), numbers(1e-4, 2.0), numbers(0.0, 1.0))
def test_bounce_never_goes_below_the_floor_nor_gains_energy(y, v, dt, restitution):
    new = solutions.bounce_step(y, v, dt, restitution)
    assert new[0] >= 0.0
    before, after = energy(y, v), energy(*new)
    assert after <= before * (1.0 + 1e-11) + 1e-12
    if restitution == 1.0 or dt < math.sqrt(2.0 * y / 9.81) - max(-v, 0.0) / 9.81:
        assert after == pytest.approx(before, rel=1e-9, abs=1e-12)


@unhurried
@given(numbers(0.01, 3.0), numbers(0.1, 1.0), st.integers(1, 20))
def test_bounce_energy_between_impacts_is_a_power_of_the_restitution(height, restitution, bounces):
    times = problems.bounce_times(height, restitution, bounces + 1, 9.81)
    assume(times[-1] - times[-2] > 1e-6)
    _, v = state = solutions.bounce_step(height, 0.0, float(times[-2:].mean()), restitution)
    expected = restitution ** (2 * bounces) * 9.81 * height
    assert energy(*state) == pytest.approx(expected, rel=1e-6)
    assert abs(v) < 1e-6  # the apex is half way


def test_bounce_agrees_with_the_planar_box_of_the_course():
    box = planar.PlanarBody(restitution=0.6, friction=0.0)
    box.state[:] = (0.0, 1.1, 0.0, 0.0, 0.0, 0.0)
    for _ in range(900):
        box.step(1e-3, integrator="rk4")
    y, v = solutions.bounce_step(1.0, 0.0, 0.9, 0.6, problems.STANDARD_GRAVITY)
    assert box.state[1] - 0.1 == pytest.approx(y, abs=1e-9)
    assert box.state[4] == pytest.approx(v, abs=1e-9)


def test_bounce_is_what_mujoco_comes_to_with_smaller_steps():
    """MuJoCo places the impact at the end of a step, and leaves 1e-4 of an impact to softness."""
    y, v = solutions.bounce_step(1.0, 0.0, 0.8, 0.5)
    deviation = {}
    for dt in (1e-3, 1e-4, 1e-5):
        runner = mujoco_box.box_drop(
            (0.1, 0.1), 1.0, (0, 1.1, 0), (0, 0, 0), dt, "Euler", restitution=0.5, friction=0.0
        )
        q, qd = runner.run(round(0.8 / dt))
        deviation[dt] = abs(q[1] - 0.1 - y), abs(qd[1] - v)
    assert deviation[1e-5][0] < 3e-4 and deviation[1e-5][1] < 1e-3
    assert deviation[1e-3][0] > 5e-4 and deviation[1e-3][1] > 1e-2


@pytest.mark.parametrize(
    ("y", "v", "dt", "restitution", "expected"),
    [
        (0.0, 0.0, 0.01, 0.5, (0.0, 0.0)),
        (0.0, 0.0, 1e9, 1.0, (0.0, 0.0)),
        (0.0, -1.0, 1e-9, 0.5, (0.5e-9, 0.5 - 9.81e-9)),
        (0.0, 1e-300, 0.01, 0.999999, (0.0, 0.0)),
        (1.0, 0.0, 1e6, 0.999, (0.0, 0.0)),
        (1.0, 0.0, 10.0, 0.0, (0.0, 0.0)),
        (0.0, 9.81, 2.0 - 1e-12, 0.5, (0.0, -9.81)),
        (1e-12, -100.0, 1e-3, 1.0, (0.1, 100.0)),
    ],
)
def test_bounce_at_the_edges(y, v, dt, restitution, expected):
    got = solutions.bounce_step(y, v, dt, restitution)
    assert got == pytest.approx(expected, rel=1e-4, abs=1e-11)


def test_bounce_does_not_loop_over_impacts():
    """1e11 impacts in one step; a loop would still be running tomorrow."""
    y, v = solutions.bounce_step(0.0, 1e-9, 10.0, 1.0)
    assert 0.0 <= y <= 1e-18 and abs(v) <= 1.0001e-9
    y, v = solutions.bounce_step(0.0, 1e-9, 10.0, 1.0 - 1e-12)
    assert 0.0 <= y <= 1e-18 and abs(v) <= 1.0001e-9


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((-0.1, 0.0, 0.1, 0.5), "y must"),
        ((math.nan, 0.0, 0.1, 0.5), "y must"),
        ((1.0, math.inf, 0.1, 0.5), "v finite"),
        ((1.0, 0.0, 0.0, 0.5), "dt and gravity"),
        ((1.0, 0.0, math.nan, 0.5), "dt and gravity"),
        ((1.0, 0.0, 0.1, 1.1), "restitution must"),
        ((1.0, 0.0, 0.1, math.nan), "restitution must"),
        ((1.0, 0.0, 0.1, 0.5, 0.0), "dt and gravity"),
    ],
)
def test_bounce_refuses(arguments, match):
    with pytest.raises(ValueError, match=match):
        solutions.bounce_step(*arguments)


# --- the largest stable step ----------------------------------------------------------------------


def chain(n: int, stiffness: float) -> np.ndarray:
    """n masses in a row, springs between them and to both walls."""
    return stiffness * (2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))


@pytest.mark.parametrize("n", [1, 2, 5, 40])
def test_stable_step_of_a_chain_is_the_closed_form(n):
    """omega_max = 2 sqrt(k / m) sin(n pi / (2 (n + 1)))."""
    k, m = 3e4, 0.7
    omega = 2.0 * math.sqrt(k / m) * math.sin(n * math.pi / (2 * (n + 1)))
    got = solutions.largest_stable_step(chain(n, k), m * np.eye(n))
    assert got == pytest.approx(2.0 / omega, rel=1e-12)


def test_stable_step_is_scipys_generalised_eigenvalue():
    from scipy.linalg import eigh

    rng = np.random.default_rng(5)
    for n in (1, 2, 3, 8):
        half, other = rng.normal(size=(2, n, n))
        K, M = 1e3 * half @ half.T, other @ other.T + 0.1 * np.eye(n)
        expected = 2.0 / math.sqrt(eigh(K, M, eigvals_only=True)[-1])
        assert solutions.largest_stable_step(K, M) == pytest.approx(expected, rel=1e-9)


def test_stable_step_separates_bounded_from_growing_runs():
    """Semi-implicit Euler on a chain of unequal masses, just inside and just outside."""
    K, M = chain(4, 500.0), np.diag([1.0, 0.3, 2.0, 0.8])
    limit, A = solutions.largest_stable_step(K, M), np.linalg.solve(M, K)
    largest = {}
    for factor in (0.999, 1.001):
        dt = factor * limit
        x, v = np.array([0.1, -0.2, 0.15, 0.05]), np.zeros(4)
        top = 0.0
        for _ in range(2000):
            v = v - dt * A @ x
            x = x + dt * v
            top = max(top, float(np.max(np.abs(x))))
        largest[factor] = top
    assert largest[0.999] < 50.0
    assert largest[1.001] > 1e20


def test_stable_step_is_mujocos_limit():
    """Slide joints in a row: springs between neighbours, a mass matrix that is not diagonal."""
    masses, springs = np.array([1.0, 0.4, 2.0]), np.array([900.0, 300.0, 1500.0])
    # The joints' coordinates are relative, so the mass matrix holds all that a joint carries.
    carried = np.cumsum(masses[::-1])[::-1]
    M = carried[np.maximum.outer(np.arange(3), np.arange(3))]
    limit = solutions.largest_stable_step(np.diag(springs), M)
    body = ""
    for m, k in zip(masses[::-1], springs[::-1], strict=True):
        body = (
            f'<body><joint type="slide" stiffness="{k}"/>'
            f'<inertial pos="0 0 0" mass="{m}" diaginertia="1 1 1"/>{body}</body>'
        )
    xml = (
        '<mujoco><option integrator="Euler" gravity="0 0 0"><flag autoreset="disable"/></option>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )
    runner = mujoco_kit.Runner(xml, [0.1, -0.05, 0.02], np.zeros(3), "Euler")
    runner.dt = 0.998 * limit
    assert np.max(np.abs(runner.samples(3000).q)) < 10.0
    runner.dt = 1.002 * limit
    with np.errstate(over="ignore", invalid="ignore"):
        grown = np.abs(runner.samples(3000).q)
    assert not np.max(grown) < 1e6


@pytest.mark.parametrize(("stiffness", "mass"), [(1.0, 1.0), (1e5, 1.0), (40.0, 0.3)])
def test_stable_step_of_one_spring_is_where_mujoco_begins_to_grow(stiffness, mass):
    omega = math.sqrt(stiffness / mass)
    result = stability.limit(
        lambda x: stability.is_stable_by_matrix(mujoco_oscillator.oscillator_step("Euler", x), 2),
        1.0,
        3.0,
    )
    step = solutions.largest_stable_step(np.array([[stiffness]]), np.array([[mass]]))
    assert step * omega == pytest.approx(result, rel=2e-4)


def test_stable_step_without_a_spring_is_infinite():
    assert solutions.largest_stable_step(np.zeros((2, 2)), np.eye(2)) == math.inf


@pytest.mark.parametrize(
    ("K", "M", "match"),
    [
        ([[1.0, 2.0], [0.0, 1.0]], np.eye(2), "stiffness must be symmetric"),
        ([[math.nan]], [[1.0]], "stiffness must be symmetric"),
        ([[1.0]], np.eye(2), "mass must be a square matrix"),
        ([1.0], [1.0], "stiffness must be a square matrix"),
        (np.eye(2), [[1.0, 0.0], [0.0, -1.0]], "mass must be positive definite"),
        (np.eye(2), np.zeros((2, 2)), "mass must be positive definite"),
        ([[1.0, 0.0], [0.0, -1.0]], np.eye(2), "no negative eigenvalue"),
    ],
)
def test_stable_step_refuses(K, M, match):
    with pytest.raises(ValueError, match=match):
        solutions.largest_stable_step(np.array(K), np.array(M))


# --- the tumbling body ----------------------------------------------------------------------------


def test_tumble_is_of_fourth_order_against_jacobis_functions():
    problem, errors = problems.tumble(duration=4.0), []
    system = problem.system
    for steps in (100, 200, 400):
        q, _ = solutions.tumble(system.q0, system.v0, system.params, 4.0 / steps, steps)
        errors.append(problem.error(q))
    assert observed(errors) == pytest.approx(4.0, abs=0.1)
    assert errors[-1] < 1e-6


def test_tumble_is_mujocos_free_body():
    system = problems.tumble().system
    q, omega = solutions.tumble(system.q0, system.v0, system.params, 2e-3, 1000)
    runner = mujoco_free.free_body(system.params, system.q0, system.v0, 2e-3, "RK4")
    theirs = runner.run(1000)
    assert quaternion.angle_between(q, theirs[0]) < 1e-8
    assert omega == pytest.approx(theirs[1], abs=1e-8)


@pytest.mark.slow
@examples(15)
@given(
    unit_quaternions(), vectors(3, 3.0), st.sampled_from([(1.0, 2.0, 2.5), (3, 2, 1.5), (1, 1, 1)])
)
def test_tumble_keeps_what_a_free_body_keeps(q, omega, inertia):
    moments = np.array(inertia, dtype=float)
    new_q, new_omega = solutions.tumble(q, omega, moments, 5e-3, 200)
    assert abs(np.linalg.norm(new_q) - 1.0) < 4e-16
    before = problems.angular_momentum(q, omega, moments)
    after = problems.angular_momentum(new_q, new_omega, moments)
    assert after == pytest.approx(before, abs=1e-6)
    kinetic = problems.tumble_energy(q, omega, moments)
    assert problems.tumble_energy(new_q, new_omega, moments) == pytest.approx(kinetic, abs=1e-6)


# --- observed order -------------------------------------------------------------------------------


@unhurried
@given(
    numbers(0.5, 6.0),
    numbers(1.2, 4.0),
    vectors(3, 5.0).filter(lambda c: np.linalg.norm(c) > 0.1),
    vectors(3, 5.0),
)
def test_observed_order_of_an_exact_power_law(order, ratio, constant, limit):
    coarse, medium, fine = (limit + constant * (0.1 * ratio**i) ** order for i in (2, 1, 0))
    assume(np.linalg.norm(fine - medium) > 1e-5)
    result, extrapolated = solutions.observed_order(coarse, medium, fine, ratio)
    assert result == pytest.approx(order, abs=1e-6)
    assert extrapolated == pytest.approx(limit, abs=1e-8)


def test_observed_order_of_real_runs():
    """RK4 and Verlet on smooth problems, and an extrapolation that gains digits."""
    tumble = problems.tumble(duration=2.0)
    system = tumble.system
    runs = [
        solutions.tumble(system.q0, system.v0, system.params, 2.0 / n, n)[1] for n in (50, 100, 200)
    ]
    order, limit = solutions.observed_order(runs[0], runs[1], runs[2])
    truth = tumble.truth(2.0)[1]
    assert order == pytest.approx(4.0, abs=0.1)
    assert np.max(np.abs(limit - truth)) < 0.1 * np.max(np.abs(runs[-1] - truth))

    pendulum = problems.pendulum()
    runs = [
        verlet(pendulum.system.q0, pendulum.system.v0, pendulum_acceleration, 2.0 / n, n)[0][-1][0]
        for n in (400, 800, 1600)
    ]
    assert solutions.observed_order(runs[0], runs[1], runs[2])[0] == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize(
    ("runs", "ratio", "match"),
    [
        (([1.0], [1.0], [1.0]), 2.0, "get smaller"),
        (([1.0], [2.0], [3.0]), 2.0, "get smaller"),
        (([1.0], [2.0], [math.nan]), 2.0, "get smaller"),
        (([1.0], [2.0, 1.0], [1.5]), 2.0, "one shape"),
        (([1.0], [1.5], [1.75]), 1.0, "ratio must"),
        (([1.0], [1.5], [1.75]), math.nan, "ratio must"),
    ],
)
def test_observed_order_refuses(runs, ratio, match):
    coarse, medium, fine = (np.array(run) for run in runs)
    with pytest.raises(ValueError, match=match):
        solutions.observed_order(coarse, medium, fine, ratio)
