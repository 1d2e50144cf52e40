"""The truths that the integrators are judged by are themselves checked here."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body import planar, problems, quaternion
from course.rigid_body.integrators import simulate
from tests.budget import examples

CLOSED = [name for name, problem in problems.all_problems().items() if problem.closed_form]


@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("fraction", [0.0, 0.13, 0.5, 1.0])
def test_closed_form_agrees_with_an_independent_integration(name: str, fraction: float) -> None:
    problem = problems.all_problems()[name]
    t = fraction * problem.duration
    q, v = problems.tight_reference(problem.system, t)
    assert problem.error(q, t) < 2e-12
    np.testing.assert_allclose(v, problem.truth(t)[1], atol=5e-12)


@pytest.mark.parametrize("name", CLOSED)
def test_closed_form_satisfies_the_equation_of_motion(name: str) -> None:
    problem = problems.all_problems()[name]
    t, h = 0.37 * problem.duration, 1e-4
    (q0, _), (q1, v1), (q2, _) = (problem.truth(t + k * h) for k in (-1, 0, 1))
    (_, v0), (_, v2) = problem.truth(t - h), problem.truth(t + h)
    acceleration = problem.system.acceleration(q1, v1, problem.system.params)
    np.testing.assert_allclose((v2 - v0) / (2 * h), acceleration, rtol=1e-5, atol=1e-5)
    if q0.shape == v1.shape:
        np.testing.assert_allclose((q2 - q0) / (2 * h), v1, rtol=1e-5, atol=1e-5)
    else:
        turn = quaternion.log(quaternion.product(quaternion.conjugate(q0), q2)) / (2 * h)
        np.testing.assert_allclose(turn, v1, atol=1e-5)


@pytest.mark.slow
@given(
    st.floats(0.2, 2.0),
    st.floats(0.3, 3.0),
    st.floats(0.0, 200.0),
    st.tuples(st.floats(0.5, 1.0), st.floats(1.2, 1.8)),
)
@examples(60)
def test_tumble_keeps_energy_and_momentum_at_any_time(w1, w3, t, moments) -> None:
    inertia = (moments[0], moments[1], 2.0 * moments[0] * 0.9 + 0.3 * moments[1])
    inertia = (inertia[0], inertia[1], min(inertia[0] + inertia[1], max(inertia[2], 1.9)))
    square = (inertia[0] * w1) ** 2 + (inertia[2] * w3) ** 2
    if inertia[1] >= inertia[2] or square <= 1.02 * inertia[1] * (
        inertia[0] * w1**2 + inertia[2] * w3**2
    ):
        with pytest.raises(ValueError, match=r"inertia is|rates is|L\^2"):
            problems.tumble(inertia, (w1, -w3))
        return
    problem = problems.tumble(inertia, (w1, w3))
    params = problem.system.params
    start, end = problem.truth(0.0), problem.truth(t)
    energy = [problems.tumble_energy(q, v, params) for q, v in (start, end)]
    momentum = [problems.angular_momentum(q, v, params) for q, v in (start, end)]
    assert energy[1] == pytest.approx(energy[0], rel=1e-11)
    size = float(np.linalg.norm(momentum[0]))
    np.testing.assert_allclose(momentum[1], momentum[0], atol=1e-10 * size)
    np.testing.assert_allclose(momentum[0][:2], 0.0, atol=1e-12)


@pytest.mark.prove
def test_top_reference_is_checked_by_its_closed_height_and_by_halving() -> None:
    inertia, weight, tilt, spin = (0.02, 0.004), 1.0, 0.5, 80.0
    top = problems.heavy_top(inertia, weight, tilt, spin)
    for t in np.linspace(0.1, 2.0, 7):
        height = problems.top_height(top.truth(t)[0])
        assert height == pytest.approx(
            problems.top_height_truth(t, inertia, weight, tilt, spin), abs=2e-12
        )
    assert_checked_by_halving(top, 80_000)


def test_nutation_stays_between_its_limits_and_touches_both() -> None:
    top = problems.heavy_top()
    run = simulate(top.system, "rk4", 1e-4, 20_000, every=1)
    heights = problems.top_height(run.q.T)
    low, high, _ = problems.nutation_limits((0.02, 0.004), 1.0, 0.5, 80.0)
    assert heights.min() == pytest.approx(low, abs=2e-7)
    assert heights.max() == pytest.approx(high, abs=2e-7)
    assert high == pytest.approx(np.cos(0.5), abs=1e-12)
    assert heights.min() > low - 1e-9 and heights.max() < high + 1e-9


def test_double_pendulum_reference_is_checked_by_halving() -> None:
    problem = problems.double_pendulum()
    assert_checked_by_halving(problem, 20_000)
    q, v = problem.truth(problem.duration)
    energy = [
        problems.double_pendulum_energy(*state, problem.system.params)
        for state in ((problem.system.q0, problem.system.v0), (q, v))
    ]
    assert energy[1] == pytest.approx(energy[0], rel=1e-12)


def assert_checked_by_halving(problem: problems.Problem, steps: int) -> None:
    """Another method at h and h/2: its error falls sixteenfold towards the reference."""
    coarse, fine = (
        problem.error(simulate(problem.system, "rk4", problem.duration / n, n).q[-1])
        for n in (steps // 4, steps // 2)
    )
    assert coarse / fine == pytest.approx(16.0, rel=0.1)
    end = simulate(problem.system, "rk4", problem.duration / steps, steps)
    assert problem.error(end.q[-1]) < 1e-11
    # The reference at a hundred times the tolerance stays where it was.
    loose, _ = problems.tight_reference(problem.system, problem.duration, rtol=1e-11)
    assert problem.error(loose) < 1e-8
    halved, _ = problems.tight_reference(problem.system, problem.duration, rtol=5e-14)
    assert problem.error(halved) < 2e-11


@pytest.mark.slow
def test_double_pendulum_equations_against_lagrange() -> None:
    import sympy as sp

    t = sp.symbols("t")
    a, b = sp.Function("a")(t), sp.Function("b")(t)
    m1, m2, l1, l2, g = sp.symbols("m1 m2 l1 l2 g", positive=True)
    x1, y1 = l1 * sp.sin(a), -l1 * sp.cos(a)
    x2, y2 = x1 + l2 * sp.sin(b), y1 - l2 * sp.cos(b)
    speed = [sum(sp.diff(c, t) ** 2 for c in pair) for pair in ((x1, y1), (x2, y2))]
    lagrangian = m1 / 2 * speed[0] + m2 / 2 * speed[1] - m1 * g * y1 - m2 * g * y2
    unknown = [sp.diff(a, t, 2), sp.diff(b, t, 2)]
    equations = [
        sp.diff(sp.diff(lagrangian, sp.diff(c, t)), t) - sp.diff(lagrangian, c) for c in (a, b)
    ]
    values = dict(zip((m1, m2, l1, l2, g), (1.3, 0.7, 0.9, 1.1, 9.81), strict=True))
    state = {sp.diff(a, t): 1.7, sp.diff(b, t): -0.4, a: 0.8, b: -1.9}
    symbols = sp.symbols("u w")
    numeric = [
        e.subs(dict(zip(unknown, symbols, strict=True))).subs(state).subs(values) for e in equations
    ]
    solution = sp.solve(numeric, symbols)
    ours = problems.double_pendulum_acceleration(
        np.array([0.8, -1.9]), np.array([1.7, -0.4]), np.array([1.3, 0.7, 0.9, 1.1, 9.81])
    )
    np.testing.assert_allclose(ours, [float(solution[s]) for s in symbols], rtol=1e-12)


def test_bounce_times_and_heights_belong_together() -> None:
    times = problems.bounce_times(2.0, 0.8, 6)
    for t in times:
        assert problems.bounce_height(t, 2.0, 0.8) == pytest.approx(0.0, abs=1e-12)
    for k, (left, right) in enumerate(itertools.pairwise(times), start=1):
        top = problems.bounce_height(0.5 * (left + right), 2.0, 0.8)
        assert top == pytest.approx(0.8 ** (2 * k) * 2.0, rel=1e-12)
    limit = times[0] * (1 + 0.8) / (1 - 0.8)
    assert problems.bounce_height(limit + 1e-6, 2.0, 0.8) == 0.0


def test_tumble_refuses_a_case_its_closed_form_does_not_cover() -> None:
    with pytest.raises(ValueError, match="inertia must be"):
        problems.tumble(inertia=(1.0, 1.0, 2.0))
    with pytest.raises(ValueError, match="rates must be"):
        problems.tumble(rates=(3.0, 0.1))


def test_the_two_first_order_errors_of_the_charted_box_are_opposite_and_partly_cancel():
    from course.charts.rigid_body import accuracy

    start, size, e = accuracy.BOX_START, accuracy.BOX_SIZE, accuracy.BOX_RESTITUTION
    truth = problems.frictionless_box(1.0, start, *size, e)[1]
    box = planar.box_parameters(1.0, *size, restitution=e, friction=0.0, rest_speed=0.0)

    def error(integrator, resolve):
        how = {"integrator": integrator, "resolve_impacts": resolve}
        end, _ = planar.advance_boxes(start[:, None], box, 1e-3, 1000, **how)
        return end[1, 0] - truth

    flight, impact = error("semi_implicit_euler", True), error("rk4", False)
    both = error("semi_implicit_euler", False)
    assert flight * impact < 0.0 and abs(both) < 0.5 * min(abs(flight), abs(impact))
