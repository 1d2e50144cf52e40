"""Each invariant on right things and on wrong ones."""

from __future__ import annotations

import math
import re
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.interview import invariants
from tests.budget import examples

SEEDS = st.integers(0, 2**32 - 1)
WRONG = st.floats(0.01, 10.0) | st.floats(-10.0, -0.01)
DISCOUNTS = st.floats(0.0, 0.99)


def rotation(rng: np.random.Generator, n: int) -> np.ndarray:
    turn, _ = np.linalg.qr(rng.normal(size=(n, n)))
    turn[:, 0] *= np.linalg.det(turn)
    return turn


@examples(30)
@given(SEEDS, st.integers(2, 4), WRONG)
def test_a_rotation_is_told_from_a_mirror_and_a_stretch(seed: int, n: int, wrong: float) -> None:
    turn = rotation(np.random.default_rng(seed), n)
    assert invariants.rotation_error(turn) < 1e-12
    mirror = np.diag([-1.0] + [1.0] * (n - 1))
    assert invariants.rotation_error(turn @ mirror) == pytest.approx(2.0)
    assert invariants.rotation_error((1.0 + abs(wrong)) * turn) > 0.01
    assert invariants.rotation_error(np.full((n, n), np.nan)) == math.inf


@examples(30)
@given(SEEDS, WRONG)
def test_lengths_and_inertias_of_bodies(seed: int, wrong: float) -> None:
    rng = np.random.default_rng(seed)
    units = rng.normal(size=(4, 5))
    units /= np.linalg.norm(units, axis=0)
    assert max(invariants.norm_error(units), invariants.norm_error(units[:, 0])) < 1e-12
    units[:, 2] *= 1.0 + abs(wrong)
    assert invariants.norm_error(units) == pytest.approx(abs(wrong))
    # Of point masses about their centre: the definition.
    masses, places = rng.uniform(0.1, 2.0, 6), rng.normal(size=(3, 6))
    places -= (places @ masses / masses.sum())[:, None]
    second = (masses * places) @ places.T
    inertia = np.trace(second) * np.eye(3) - second
    assert invariants.inertia_error(inertia) < 1e-12
    # All points in a plane are the limit: the moment about its normal is the sum of both others.
    flat = places * [[1.0], [1.0], [0.0]]
    second = (masses * flat) @ flat.T
    inertia = np.trace(second) * np.eye(3) - second
    assert invariants.inertia_error(inertia) < 1e-12
    turn = rotation(rng, 3)
    inertia[2, 2] *= 1.0 + abs(wrong)  # positive definite as before, and no body has it
    assert invariants.inertia_error(turn @ inertia @ turn.T) == pytest.approx(
        abs(wrong) / (1.0 + abs(wrong))
    )
    # What is not symmetric leaves the moments of the symmetric part as they are.
    lopsided = np.diag([2.0, 2.0, 2.0]) + [[0.0, 0.1, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert invariants.inertia_error(lopsided) == pytest.approx(0.1)
    assert invariants.inertia_error(np.full((3, 3), np.nan)) == math.inf


@examples(30)
@given(SEEDS, WRONG)
def test_a_motion_elsewhere_is_told_from_one_that_knows_the_origin(seed: int, wrong: float) -> None:
    state = np.random.default_rng(seed).uniform(-1.0, 1.0, 4)  # two places, two velocities

    def step(x, stray=0.0):
        pull = x[1] - x[0]
        return x + 0.1 * np.array([x[2], x[3], pull + stray * x[0], -pull])

    shift = np.array([3.0, 3.0, 0.0, 0.0])
    assert invariants.shift_error(step, state, shift) < 1e-12
    assert invariants.shift_error(partial(step, stray=wrong), state, shift) == pytest.approx(
        0.3 * abs(wrong)
    )


@examples(30)
@given(st.floats(0.1, 5.0), st.floats(2.0, 10.0))
def test_an_integral_that_winds_up_is_told_from_one_that_stops(gain: float, pushed: float) -> None:
    def make(windup: bool):
        total = 0.0

        def control(error: float) -> float:
            nonlocal total
            raw = error + gain * (total + 0.01 * error)
            clipped = min(max(raw, -1.0), 1.0)
            if windup or raw == clipped:
                total += 0.01 * error
            return clipped

        return control

    after = [-0.5] * 1500  # until the shorter integral is gone
    assert invariants.saturation_error(partial(make, False), pushed, after) == 0.0
    assert invariants.saturation_error(partial(make, True), pushed, after) > 0.05


@examples(30)
@given(SEEDS, WRONG)
def test_a_derivative_is_told_from_a_wrong_one(seed: int, wrong: float) -> None:
    rng = np.random.default_rng(seed)
    matrix, point = rng.uniform(-1.0, 1.0, (2, 3)), rng.uniform(-1.0, 1.0, 3)

    def value(x: np.ndarray) -> np.ndarray:
        return np.sin(matrix @ x)

    def jacobian(x: np.ndarray) -> np.ndarray:
        return np.cos(matrix @ x)[:, None] * matrix

    assert invariants.derivative_error(value, jacobian, point) < 1e-8
    assert invariants.derivative_error(value, lambda x: jacobian(x) + wrong, point) > 0.005
    assert invariants.derivative_error(math.exp, math.exp, 0.3) < 1e-8
    assert invariants.derivative_error(math.exp, lambda t: math.exp(t) + wrong, 0.3) > 0.005


@examples(30)
@given(SEEDS, WRONG)
def test_writing_and_going_round_change_nothing(seed: int, wrong: float) -> None:
    rng = np.random.default_rng(seed)
    turn, state = rotation(rng, 3), rng.normal(size=3)
    forward, back = (lambda x: turn @ x), (lambda x: turn.T @ x)
    assert invariants.write_read_error(forward, lambda s, shown: turn.T @ shown, state) < 1e-12
    assert invariants.write_read_error(forward, lambda s, shown: s + wrong, state) > 0.005
    assert invariants.round_trip_error(forward, back, state) < 1e-12
    assert invariants.round_trip_error(forward, lambda x: turn.T @ x + wrong, state) > 0.005


@examples(30)
@given(SEEDS, WRONG)
def test_a_mirrored_motion_is_told_from_a_lopsided_one(seed: int, wrong: float) -> None:
    state, push = np.random.default_rng(seed).normal(size=(2, 2))

    def step(x, u, more=0.0):
        return x + np.array([u[0] + u[1], (1.0 + more) * u[0] - u[1]])

    def mirror(x):
        return x * [1.0, -1.0]

    def swap(u):
        return np.asarray(u)[::-1]

    assert invariants.mirror_error(step, mirror, swap, state, push) < 1e-12
    lopsided = invariants.mirror_error(
        lambda x, u: step(x, u, wrong), mirror, swap, state, push + 20.0
    )
    assert lopsided > 0.01


@examples(30)
@given(st.floats(0.1, 10.0), st.floats(1.0, 10.0), st.floats(0.1, 5.0))
def test_units_and_turns(length: float, speed: float, wrong: float) -> None:
    inputs, factors = (length, speed), (1000.0, 3.6)  # m to mm, m/s to km/h

    def froude(x: float, v: float) -> float:
        return v * v / x

    assert invariants.unit_error(froude, inputs, factors, 3.6**2 / 1000.0) < 1e-12
    assert invariants.unit_error(lambda x, v: v * v / (x + wrong), inputs, factors, 0.01296) > 1e-4
    assert invariants.turn_error(lambda a: [math.cos(a), math.sin(a)], length, 3) < 1e-12
    assert invariants.turn_error(lambda a: a * wrong, length) > 0.1


@examples(30)
@given(SEEDS, WRONG)
def test_weight_fall_and_what_is_kept(seed: int, wrong: float) -> None:
    masses = np.random.default_rng(seed).uniform(0.1, 10.0, 5)
    assert invariants.weight_error(9.81 * masses, masses) < 1e-12
    assert invariants.weight_error(np.zeros(5), masses) == pytest.approx(1.0)
    assert invariants.weight_error(9.81 * masses * (1.0 + wrong), masses) > 0.005
    assert invariants.fall_error(9.81 * 3.0, 3.0) < 1e-12
    assert invariants.fall_error(9.81 * 3.0 + wrong, 3.0) > 3e-4
    assert invariants.kept_error(np.tile(masses, (4, 1))) == 0.0
    assert invariants.kept_error(masses[:1] + wrong * np.arange(4)) > 0.001
    assert invariants.kept_error([1.0, math.inf]) == math.inf


@examples(30)
@given(st.floats(0.01, 10.0), st.integers(1, 4), st.floats(1.0, 10.0))
def test_a_step_cures_the_integrator_only(scale: float, order: int, wrong: float) -> None:
    assert invariants.refined_ratio(lambda h: scale * h**order, 0.1) == pytest.approx(0.25**order)
    assert invariants.refined_ratio(lambda h: scale * (h**order + wrong), 0.1) > 0.9
    assert invariants.refined_ratio(lambda h: math.nan, 0.1) == math.inf
    assert invariants.refined_ratio(lambda h: 0.0, 0.1) == 0.0


@examples(30)
@given(SEEDS, WRONG)
def test_paths_and_trees(seed: int, wrong: float) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 1.0, (20, 2))
    assert invariants.ends_error(points, points[0], points[-1]) == 0.0
    assert invariants.ends_error(None, points[0], points[-1]) == 0.0
    assert invariants.ends_error(points, points[0], points[-1] + wrong) >= 0.009
    assert invariants.ends_error(points[:0], points[0], points[-1]) == math.inf
    parents = [-1, *(int(rng.integers(node)) for node in range(1, 20))]
    costs = np.zeros(20)
    for node in range(1, 20):
        edge = np.linalg.norm(points[node] - points[parents[node]])
        costs[node] = costs[parents[node]] + edge
    assert invariants.tree_error(points, parents, costs) < 1e-12
    costs[rng.integers(20)] += wrong
    assert invariants.tree_error(points, parents, costs) > 0.009
    assert invariants.tree_error(points[:2], [1, 0], costs[:2]) == math.inf


@examples(30)
@given(SEEDS, st.integers(2, 4), DISCOUNTS)
def test_episodes_in_one_buffer(seed: int, count: int, discount: float) -> None:
    rng = np.random.default_rng(seed)
    lengths = rng.integers(2, 9, count).tolist()
    episodes = [tuple(rng.normal(size=(2, n))) for n in lengths]

    def returns(rewards, values, ends, last, forget=False):
        out, after = np.zeros(len(rewards)), last
        for t in reversed(range(len(rewards))):
            after = rewards[t] + discount * after * (1.0 - (ends[t] and not forget))
            out[t] = after
        return out - values

    assert invariants.episodes_error(returns, episodes) < 1e-12
    if discount > 0.1:
        leaks = invariants.episodes_error(partial(returns, forget=True), episodes)
        assert leaks > 1e-9
    clock = np.concatenate([np.arange(n) for n in lengths])
    assert invariants.stored_error(clock, clock + 1, lengths) == 0
    crossing = np.append(clock, lengths[-1]), np.append(clock + 1, 0)
    assert invariants.stored_error(*crossing, lengths) == 2  # goes back, and is one too many
    assert invariants.stored_error(clock[1:], clock[1:] + 1, lengths) == 1


@examples(30)
@given(DISCOUNTS, WRONG)
def test_for_ever_and_idle_parameters(discount: float, wrong: float) -> None:
    due = 1.0 / (1.0 - discount)
    assert invariants.forever_error(due, discount) < 1e-12
    assert invariants.forever_error(due + wrong, discount) >= 0.99 * abs(wrong) / due
    gradients = {"one": np.array([[0.0, wrong]]), "two": np.array([wrong])}
    assert invariants.idle_parameters(gradients) == []
    gradients |= {"dead": np.zeros(3), "broken": np.array([wrong, math.nan])}
    assert invariants.idle_parameters(gradients) == ["dead", "broken"]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: invariants.gap([1.0], [1.0, 2.0]), "other.shape must be"),
        (lambda: invariants.rotation_error([1.0]), "matrix.shape must be"),
        (lambda: invariants.norm_error(1.0), r"vectors.shape must be .*, got \(\)"),
        (lambda: invariants.inertia_error(np.eye(2)), "inertia.shape must be"),
        (
            lambda: invariants.saturation_error(lambda: abs, 1.0, [0.0], (0, 5)),
            r"samples must be .*, got 0",
        ),
        (lambda: invariants.derivative_error(abs, abs, 1.0, step=0.0), r"step must be .*, got 0.0"),
        (lambda: invariants.unit_error(abs, [1.0], [], 1.0), r"factors must be 1 factors.*, got 0"),
        (lambda: invariants.weight_error([1.0], [0.0]), "masses"),
        (lambda: invariants.fall_error(1.0, 0.0), r"seconds must be .*, got 0.0"),
        (lambda: invariants.refined_ratio(abs, 1.0, parts=1), r"parts must be .*, got 1"),
        (lambda: invariants.forever_error(1.0, 1.0), r"discount must be .*, got 1.0"),
    ],
)
def test_bad_input_is_named(call, message: str) -> None:
    with pytest.raises(ValueError, match="must be") as rejected:
        call()
    assert re.search(message, str(rejected.value))
