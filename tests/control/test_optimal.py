"""The regulator, the box and the horizon against SciPy, and what a weak motor can catch."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.optimize import lsq_linear

from course.control.optimal import box_qp, horizon, lqr, mpc
from tests.budget import examples

seeds = st.integers(0, 100_000)


def drawn(seed):
    """A system, stable or not, and its weights."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 9)), int(rng.integers(1, 4))
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.5, 1.5) / np.abs(np.linalg.eigvals(A)).max()
    W, V = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    return A, rng.normal(size=(n, m)), W @ W.T, V @ V.T + 0.1 * np.eye(m)


def residual(A, B, Q, R, P):
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    return np.abs(Q + A.T @ P @ (A - B @ K) - P).max() / np.abs(P).max()


@examples(40)
@given(seeds)
def test_the_regulator_is_scipys(seed):
    A, B, Q, R = drawn(seed)
    result, truth = lqr(A, B, Q, R), solve_discrete_are(A, B, Q, R)
    scale = np.abs(truth).max()
    known = residual(A, B, Q, R, truth)
    assert residual(A, B, Q, R, result.P) < 3.0 * known + 1e-12
    assert np.abs(result.P - truth).max() < 1e-7 * scale
    assert result.radius < 1.0
    assert 1 <= result.doublings <= 20
    # x^T P x is the cost of a run under the law.
    x, cost = np.ones(len(A)), 0.0
    for _ in range(int(40.0 / -math.log(result.radius + 1e-9)) + 10):
        u = -result.K @ x
        cost += x @ Q @ x + u @ R @ u
        x = A @ x + B @ u
    assert cost == pytest.approx(result.P.sum(), rel=1e-8)


def test_a_mode_that_no_law_can_stop_or_that_costs_nothing_is_named():
    A = np.diag([1.2, 0.5])
    with pytest.raises(ValueError, match=r"^B must be an input .* eigenvalue 1\.2"):
        lqr(A, [[0.0], [1.0]], np.eye(2), [[1.0]])
    with pytest.raises(ValueError, match=r"^Q must be a weight .* eigenvalue 1\b"):
        lqr(np.diag([1.0, 0.5]), [[1.0], [1.0]], np.diag([0.0, 1.0]), [[1.0]])
    # A mode that decays by itself may be out of reach, and may cost nothing.
    assert lqr(A, [[1.0], [0.0]], np.eye(2), [[1.0]]).radius < 1.0
    assert lqr(A, [[1.0], [0.0]], np.diag([1.0, 0.0]), [[1.0]]).radius < 1.0


@pytest.mark.prove
@examples(120)
@given(seeds)
def test_the_box_is_scipys_active_set(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 21))
    M, b = rng.normal(size=(n + 5, n)), 3.0 * rng.normal(size=n + 5)
    low = -rng.uniform(0.0, 1.0, n)
    high = low + rng.uniform(0.05, 1.0, n)
    low[rng.random(n) < 0.2], high[rng.random(n) < 0.2] = -np.inf, np.inf
    result = box_qp(M.T @ M, -M.T @ b, low, high)
    truth = lsq_linear(M, b, (low, high), method="bvls", tol=1e-15).x
    assert np.abs(result.x - truth).max() < 1e-10
    # What is at a bound is there exactly, and pushes outwards; what is free has no slope.
    slope = M.T @ (M @ result.x - b)
    assert (result.free == ((result.x > low) & (result.x < high))).all()
    assert np.abs(slope[result.free]).max(initial=0.0) < 1e-10
    assert (slope[result.x == low] >= 0.0).all() and (slope[result.x == high] <= 0.0).all()
    warm = box_qp(M.T @ M, -M.T @ b, low, high, result.x)
    assert warm.iterations <= 1
    assert np.abs(warm.x - result.x).max() < 1e-12


def test_bounds_that_meet_and_starts_anywhere():
    H, g = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([-8.0, 1.0])
    for start in ([9.0, -9.0], [-9.0, 9.0], [0.5, 0.0]):
        result = box_qp(H, g, [0.5, -5.0], [0.5, 5.0], start)
        assert result.x == pytest.approx([0.5, -0.5], abs=1e-15)
    assert box_qp(H, g, -np.inf, np.inf).x == pytest.approx(np.linalg.solve(H, -g), rel=1e-14)


def cart(dt=0.05):
    """A mass of 1 kg on a line, its command held."""
    return np.array([[1.0, dt], [0.0, 1.0]]), np.array([[0.5 * dt**2], [dt]])


def pendulum(dt, stiff=9.81):
    """An upright pendulum of 1 kg at 1 m: theta'' = stiff theta + u, held for a sample, exactly."""
    w = math.sqrt(stiff)
    c, s = math.cosh(w * dt), math.sinh(w * dt)
    return np.array([[c, s / w], [w * s, c]]), np.array([[(c - 1.0) / stiff], [s / w]])


def test_a_plan_without_limits_is_the_regulator_and_with_them_it_costs_no_more():
    A, B = pendulum(0.05)
    Q, R = np.diag([10.0, 1.0]), np.array([[0.1]])
    K, plan = lqr(A, B, Q, R).K, horizon(A, B, Q, R, 25)
    x = np.array([0.02, -0.03])
    first = mpc(plan, x, 1e6)
    for k in range(25):
        assert first[k] == pytest.approx(-K @ x, abs=1e-9)
        x = A @ x + B @ first[k]

    # A mass that brakes too late under the clipped law, as its motor is weak.
    A, B = cart()
    R = np.array([[0.01]])
    K, plan = lqr(A, B, Q, R).K, horizon(A, B, Q, R, 40)

    def cost(law, limit):
        x, last, total = np.array([2.0, 0.0]), None, 0.0
        for _ in range(200):
            u, last = law(x, last, limit)
            total += x @ Q @ x + u @ R @ u
            x = A @ x + B @ u
        return total

    def clipped(x, last, limit):
        return np.clip(-K @ x, -limit, limit), None

    def planned(x, last, limit):
        last = mpc(plan, x, limit, last)
        return last[0], last

    gains = [cost(clipped, limit) / cost(planned, limit) for limit in (0.3, 1e3)]
    assert gains[0] > 1.01
    assert gains[1] == pytest.approx(1.0, abs=1e-9)


@examples(20)
@given(seeds)
def test_a_plan_is_scipys_and_may_start_from_the_last(seed):
    A, B, Q, R = drawn(seed)
    A = A / max(1.0, np.abs(np.linalg.eigvals(A)).max())
    rng = np.random.default_rng(seed)
    plan, x = horizon(A, B, Q, R, 6), 2.0 * rng.normal(size=len(A))
    cold = mpc(plan, x, 0.3)
    root = np.linalg.cholesky(plan.H).T
    want = np.linalg.solve(root.T, -plan.F @ x)
    truth = lsq_linear(root, want, (-0.3, 0.3), method="bvls", tol=1e-15).x
    assert np.abs(cold.ravel() - truth).max() < 1e-8
    warm = mpc(plan, x, 0.3, rng.normal(size=cold.shape))
    assert np.abs(warm - cold).max() < 1e-8

    # The cost that it says is that of the run, less what no plan can change.
    def run(U):
        s, total = x, 0.0
        for u in U:
            total += s @ Q @ s + u @ R @ u
            s = A @ s + B @ u
        return total + s @ lqr(A, B, Q, R).P @ s

    U = rng.normal(size=cold.shape)
    flat = U.ravel()
    quadratic = 0.5 * flat @ plan.H @ flat + (plan.F @ x) @ flat
    assert run(U) - run(0.0 * U) == pytest.approx(quadratic, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("dt", [1e-3, 0.05])
def test_a_weak_motor_catches_the_linear_pendulum_inside_u_over_m_g_l(dt):
    A, B = pendulum(dt)
    K = lqr(A, B, np.diag([10.0, 1.0]), [[0.1]]).K
    limit = 2.0

    def caught(angle):
        x = np.array([angle, 0.0])
        while 1e-6 < np.abs(x).max() < 1.0:
            x = A @ x + B @ np.clip(-K @ x, -limit, limit)
        return np.abs(x).max() < 1.0

    edge = limit / 9.81
    assert caught(edge * (1.0 - 1e-9)) and not caught(edge * (1.0 + 1e-9))


def test_it_catches_the_true_pendulum_inside_the_arcsine():
    dt, limit = 0.01, 2.0
    A, B = pendulum(dt)
    K = lqr(A, B, np.diag([10.0, 1.0]), [[0.1]]).K

    def caught(angle):
        q, v = angle, 0.0
        while 1e-4 < abs(q) + abs(v) and abs(q) < 1.0:
            u = min(max(-(K[0, 0] * q + K[0, 1] * v), -limit), limit)
            for _ in range(2):  # velocity Verlet: at rest it errs in nothing
                h = 0.5 * dt
                a = 9.81 * math.sin(q) + u
                q += h * v + 0.5 * h * h * a
                v += 0.5 * h * (a + 9.81 * math.sin(q) + u)
        return abs(q) < 1.0

    edge = math.asin(limit / 9.81)
    assert caught(edge * (1.0 - 1e-9)) and not caught(edge * (1.0 + 1e-9))
    assert edge > limit / 9.81


def cart_plan(samples):
    A, B = cart()
    return horizon(A, B, np.eye(2), [[1.0]], samples)


I2, ONE = np.eye(2), np.ones((2, 1))
BAD = {
    "A": lambda: lqr([[1.0, np.nan], [0.0, 1.0]], ONE, I2, [[1.0]]),
    "A.shape": lambda: lqr([[1.0, 0.0]], [[1.0]], I2, [[1.0]]),
    "B.shape": lambda: lqr(I2, np.ones((3, 1)), I2, [[1.0]]),
    "Q": lambda: lqr(I2, ONE, -I2, [[1.0]]),
    "Q ": lambda: lqr(I2, ONE, [[1.0, 0.5], [0.0, 1.0]], [[1.0]]),
    "R": lambda: lqr(I2, ONE, I2, [[0.0]]),
    "R ": lambda: lqr(I2, ONE, I2, [[-1.0]]),
    "H": lambda: box_qp([[1.0, 2.0], [2.0, 1.0]], [0.0, 1.0], -1.0, 1.0),
    "H ": lambda: box_qp([[1.0, 2.0], [0.0, 5.0]], [0.0, 1.0], -1.0, 1.0),
    "g": lambda: box_qp(I2, [0.0, np.inf], -1.0, 1.0),
    "(low, high)": lambda: box_qp(I2, [0.0, 1.0], 1.0, -1.0),
    "low": lambda: box_qp(I2, [0.0, 1.0], np.nan, 1.0),
    "high.shape": lambda: box_qp(I2, [0.0, 1.0], -1.0, [1.0] * 3),
    "start": lambda: box_qp(I2, [0.0, 1.0], -1.0, 1.0, [0.0]),
    "samples": lambda: cart_plan(0),
    "limit": lambda: mpc(cart_plan(3), [0.0, 0.0], 0.0),
    "limit.shape": lambda: mpc(cart_plan(3), [0.0, 0.0], [1.0, 1.0]),
    "x": lambda: mpc(cart_plan(3), [0.0], 1.0),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    with pytest.raises(ValueError) as caught:
        BAD[name]()
    assert str(caught.value).startswith((f"{name.strip()} must be", f"{name}[", f"{name}.shape"))
