"""The integrators against closed forms, a tight reference and conserved quantities."""

import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body import integrators, problems, quaternion
from course.rigid_body.integrators import INTEGRATORS, System, evaluations_per_step, simulate
from tests.budget import examples

PROBLEMS = problems.all_problems()
# Step counts in the asymptotic range of each problem, coarse enough to stay above rounding.
STEPS = {
    "oscillator": {1: 8000, 2: 2000, 4: 400},
    "pendulum": {1: 16000, 2: 4000, 4: 800},
    "tumble": {1: 50_000, 2: 8000, 4: 2000},
    "heavy_top": {1: 200_000, 2: 16000, 4: 8000},
    "double_pendulum": {1: 16000, 2: 8000, 4: 2000},
}


def slope(name: str, problem: problems.Problem, steps: int) -> float:
    """Observed order from three runs at steps, 2 steps, 4 steps."""
    counts = (steps, 2 * steps, 4 * steps)
    errors = []
    for n in counts:
        end = simulate(problem.system, name, problem.duration / n, n)
        errors.append(state_error(problem, end.q[-1], end.v[-1]))
    return float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])


def state_error(problem: problems.Problem, q: np.ndarray, v: np.ndarray) -> float:
    """Error of the whole state: one component alone may cross zero and show a false order."""
    _, true_v = problem.truth(problem.duration)
    scale = max(1.0, float(np.max(np.abs(true_v))))
    return float(np.hypot(problem.error(q), np.max(np.abs(v - true_v)) / scale))


@pytest.mark.slow
@pytest.mark.parametrize("problem", PROBLEMS)
@pytest.mark.parametrize("name", INTEGRATORS)
def test_observed_order_is_the_theoretical_one(problem: str, name: str) -> None:
    order = INTEGRATORS[name].order
    assert slope(name, PROBLEMS[problem], STEPS[problem][order]) == pytest.approx(order, abs=0.1)


def test_tumble_agrees_with_the_closed_form_for_twenty_seconds() -> None:
    tumble = PROBLEMS["tumble"]
    run = simulate(tumble.system, "rk4", 1e-3, 20_000, every=1000)
    errors = [tumble.error(q, t) for q, t in zip(run.q, run.t, strict=True)]
    assert max(errors) < 1e-9
    energy = [
        problems.tumble_energy(q, v, tumble.system.params)
        for q, v in zip(run.q, run.v, strict=False)
    ]
    assert np.ptp(energy) < 1e-12 * energy[0]
    momentum = [
        problems.angular_momentum(q, v, tumble.system.params)
        for q, v in zip(run.q, run.v, strict=False)
    ]
    assert np.max(np.abs(momentum - momentum[0])) < 1e-11 * np.linalg.norm(momentum[0])


def test_implicit_midpoint_keeps_quadratic_invariants_of_the_free_body() -> None:
    system = PROBLEMS["tumble"].system
    run = simulate(system, "implicit_midpoint", 0.05, 2000, every=100)
    body = system.params * run.v
    energy = problems.tumble_energy(run.q.T, run.v.T, system.params)
    assert np.ptp(np.sum(body**2, axis=1)) < 1e-11
    assert np.ptp(energy) < 1e-11
    # The same step of an explicit method loses them visibly.
    other = simulate(system, "explicit_midpoint", 0.05, 2000, every=100)
    assert np.ptp(problems.tumble_energy(other.q.T, other.v.T, system.params)) > 1e-3


@given(
    st.lists(st.floats(-2, 2), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.floats(1e-3, 0.2),
    st.sampled_from(sorted(INTEGRATORS)),
)
@examples(60)
def test_a_turned_world_gives_the_turned_result(rates, turn, dt, name) -> None:
    """Left invariance: turning the world before or after a free step is the same."""
    q0, params = quaternion.exp(np.array([0.3, -0.2, 0.5])), np.array([1.0, 2.0, 2.5])
    world = quaternion.exp(np.array(turn))
    step = INTEGRATORS[name].step
    q1, v1 = step(q0, np.array(rates), problems.tumble_acceleration, dt, params)
    turned, v2 = step(
        quaternion.product(world, q0), np.array(rates), problems.tumble_acceleration, dt, params
    )
    assert quaternion.angle_between(turned, quaternion.product(world, q1)) < 1e-12
    np.testing.assert_allclose(v1, v2, atol=1e-14)
    assert abs(np.linalg.norm(turned) - 1.0) < 1e-14


@pytest.mark.parametrize("name", ["velocity_verlet", "implicit_midpoint"])
def test_symmetric_methods_run_backwards(name: str) -> None:
    """A step forward and a step back end where they began: what makes energy errors bounded."""
    system = PROBLEMS["pendulum"].system
    step = INTEGRATORS[name].step
    q, v = step(system.q0 - 0.4, system.v0 + 0.3, system.acceleration, 0.1, system.params)
    q, v = step(q, v, system.acceleration, -0.1, system.params)
    np.testing.assert_allclose([q[0], v[0]], [system.q0[0] - 0.4, 0.3], atol=1e-13)
    q, v = integrators.rk4(
        system.q0 - 0.4, system.v0 + 0.3, system.acceleration, 0.1, system.params
    )
    q, v = integrators.rk4(q, v, system.acceleration, -0.1, system.params)
    assert abs(q[0] - system.q0[0] + 0.4) > 1e-9


@pytest.mark.parametrize("name", INTEGRATORS)
def test_phase_area_is_kept_exactly_by_the_symplectic_ones(name: str) -> None:
    """Determinant of the one-step map of the pendulum, by central differences."""
    item, system = INTEGRATORS[name], PROBLEMS["pendulum"].system
    base, eps = np.array([1.1, 0.7]), 1e-5
    columns = []
    for direction in np.eye(2):
        ends = []
        for sign in (1.0, -1.0):
            state = base + sign * eps * direction
            q, v = item.step(state[:1], state[1:], system.acceleration, 0.3, system.params)
            ends.append(np.array([q[0], v[0]]))
        columns.append((ends[0] - ends[1]) / (2.0 * eps))
    area = np.linalg.det(np.array(columns).T)
    assert (abs(area - 1.0) < 1e-8) == item.symplectic, area


@pytest.mark.parametrize("name", INTEGRATORS)
def test_a_batch_is_its_bodies_one_by_one(name: str) -> None:
    rng = np.random.default_rng(3)
    q = quaternion.exp(rng.normal(size=(3, 5)))
    v = rng.normal(size=(3, 5))
    params = np.array([1.0, 2.0, 2.5])
    step = INTEGRATORS[name].step
    many_q, many_v = step(q, v, problems.tumble_acceleration, 0.05, params)
    for i in range(5):
        one_q, one_v = step(
            q[:, i].copy(), v[:, i].copy(), problems.tumble_acceleration, 0.05, params
        )
        np.testing.assert_allclose(many_q[:, i], one_q, atol=1e-14)
        np.testing.assert_allclose(many_v[:, i], one_v, atol=1e-14)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_inputs_are_left_alone(name: str) -> None:
    system = PROBLEMS["heavy_top"].system
    q, v = system.q0.copy(), system.v0.copy()
    INTEGRATORS[name].step(q, v, system.acceleration, 1e-3, system.params)
    assert np.array_equal(q, system.q0) and np.array_equal(v, system.v0)


@pytest.mark.prove
def test_compiled_and_plain_source_agree() -> None:
    code = (
        "from course.rigid_body import problems, integrators as i\n"
        "p = problems.heavy_top()\n"
        "for n in i.INTEGRATORS:\n"
        "    r = i.simulate(p.system, n, 1e-3, 20); print(*r.q[-1], *r.v[-1])\n"
    )
    rows = []
    for disable in ("0", "1"):
        environment = os.environ | {"NUMBA_DISABLE_JIT": disable, "COURSE_QUIET": "1"}
        out = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        rows.append(
            np.array([[float(x) for x in line.split()] for line in out.stdout.splitlines()])
        )
    assert rows[0].shape == (len(INTEGRATORS), 7)
    np.testing.assert_allclose(rows[0], rows[1], rtol=1e-12, atol=1e-12)


def test_evaluations_are_counted() -> None:
    system = PROBLEMS["pendulum"].system
    counts = {name: evaluations_per_step(system, name, 1e-2) for name in INTEGRATORS}
    assert [counts[n] for n in ("explicit_euler", "semi_implicit_euler")] == [1, 1]
    assert [counts[n] for n in ("velocity_verlet", "explicit_midpoint", "rk4")] == [2, 2, 4]
    assert 3 <= counts["implicit_midpoint"] <= 8


def test_a_learners_function_runs_on_a_problem() -> None:
    problem = PROBLEMS["pendulum"]

    def mine(q, v, acceleration, dt, params):
        v = v + dt * acceleration(q, v, params)
        return q + dt * v, v

    ours = simulate(problem.system, "semi_implicit_euler", 1e-2, 200)
    theirs = simulate(problem.system, mine, 1e-2, 200)
    np.testing.assert_allclose(ours.q, theirs.q, rtol=1e-12)


def test_a_step_that_works_in_place_leaves_the_system_alone() -> None:
    system = PROBLEMS["pendulum"].system

    def in_place(q, v, acceleration, dt, params):
        v += dt * acceleration(q, v, params)
        q += dt * v
        return q, v

    before = system.q0.copy()
    assert evaluations_per_step(system, in_place, 1e-2) == 1
    runs = [simulate(system, in_place, 1e-2, 100).q[-1] for _ in range(2)]
    assert np.array_equal(system.q0, before) and np.array_equal(*runs)
    np.testing.assert_allclose(runs[0], simulate(system, "semi_implicit_euler", 1e-2, 100).q[-1])


def test_implicit_midpoint_says_when_it_has_not_converged() -> None:
    def dry_friction(q, v, params):
        return -100.0 * np.sign(v)  # within this step no mid velocity satisfies the equation

    q, _ = integrators.implicit_midpoint(np.array([0.1]), np.array([1.0]), dry_friction, 0.1, None)
    assert np.isnan(q[0])


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"integrator": "leapfrog"}, r"integrator must be .*, got 'leapfrog'"),
        ({"dt": -1.0}, r"dt must be .*, got -1.0"),
        ({"dt": float("nan")}, r"dt must be .*, got nan"),
        ({"steps": 0}, r"steps must be .*, got 0"),
        ({"every": 3}, r"every must be .*, got 3"),
    ],
)
def test_wrong_input_is_named(change: dict, word: str) -> None:
    arguments: dict[str, Any] = {"integrator": "rk4", "dt": 0.1, "steps": 10} | change
    with pytest.raises(ValueError, match=word):
        simulate(PROBLEMS["pendulum"].system, **arguments)


def test_a_system_checks_its_shapes() -> None:
    with pytest.raises(ValueError, match=r"q0.shape, v0.shape"):
        System("x", problems.pendulum_acceleration, np.ones(1), np.zeros(3), np.zeros(1))
    with pytest.raises(ValueError, match=r"params\[0\] must be .*, got nan"):
        System("x", problems.pendulum_acceleration, np.array([np.nan]), np.zeros(1), np.zeros(1))
