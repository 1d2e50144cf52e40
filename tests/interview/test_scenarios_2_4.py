"""The policy on the robot and the door: probes find what was put in, by closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from course.interview.scenarios import gap, policy
from course.interview.scenarios.programs import gap as planner
from course.interview.scenarios.programs import policy as program
from tests.budget import examples

SEEDS = st.integers(0, 2**32 - 1)


def put(monkeypatch: pytest.MonkeyPatch, cause: str, **numbers: float) -> None:
    """A fault of another size."""
    monkeypatch.setitem(policy.FAULTS, cause, numbers)


# --- The policy -----------------------------------------------------------------------------------


def test_the_policy_is_the_critically_damped_spring_that_was_asked_for() -> None:
    model = replace(policy.MODEL, friction=0.0)
    target, t = np.linspace(0.1, 0.39, 20), program.STEP * np.arange(1, 151)[:, None]
    for bandwidth in (6.0, 10.7):
        log = program.press(model, program.train(model, bandwidth), target, 150)
        closed = target * (1.0 - (1.0 + bandwidth * t) * np.exp(-bandwidth * t))
        # First order: the error of a step is a share of what moves in it.
        assert np.abs(log.q - closed).max() < program.STEP * bandwidth * target.max()


def test_a_dry_arm_stops_and_a_damped_one_slows_as_they_should() -> None:
    v, still = np.linspace(0.5, 2.0, 8), np.zeros(8)
    dry = replace(policy.MODEL, drag=0.0, friction=0.5)
    log = program.move(dry, lambda *_: still, still - 9.0, v, 60)
    distance = dry.inertia * v**2 / (2.0 * dry.friction)
    assert (
        log.q[-1] + 9.0 == pytest.approx(distance, abs=program.STEP * 2.0) and not log.v[-1].any()
    )
    wet = replace(policy.MODEL, friction=0.0)
    log = program.move(wet, lambda *_: still, still - 9.0, v, 100)
    assert log.v[-1] == pytest.approx(v * np.exp(-wet.drag * 0.4 / wet.inertia), rel=5e-3)


@pytest.mark.parametrize(
    ("delay", "friction", "inertia"), [(0, 0.1, 0.04), (5, 0.3, 0.07), (14, 0.6, 0.11)]
)
def test_probes_find_what_was_put_in(
    delay: int, friction: float, inertia: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(monkeypatch, "late_drive", delay=delay)
    put(monkeypatch, "dry_joint", friction=friction)
    put(monkeypatch, "heavy_tool", inertia=inertia)
    # After break-away the ramp r needs a while for 2 mrad: angle = r t^3 / (6 inertia).
    later = np.cbrt(6.0 * policy.MODEL.inertia * 2e-3 * 0.5**2)
    for seed in range(3):
        assert policy.lag("late_drive", seed) == 1e3 * program.STEP * delay
        assert policy.breakaway("dry_joint", seed) == pytest.approx(friction + later, abs=0.03)
        assert policy.two_torques("heavy_tool", seed) == pytest.approx(inertia, rel=0.03)


@pytest.mark.parametrize("stiffness", [4.0, 6.0, 9.3])
def test_a_key_stops_the_arm_where_a_damped_spring_does(
    stiffness: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(monkeypatch, "stiff_keys", stiffness=stiffness)
    J, friction = policy.MODEL.inertia, policy.MODEL.friction
    decay = (policy.MODEL.drag + policy.MODEL.damping) / (2.0 * J)
    omega, rest, t = np.sqrt(stiffness / J - decay**2), friction / stiffness, np.arange(2000) * 1e-4
    swing = rest * np.cos(omega * t) + (2.0 + decay * rest) / omega * np.sin(omega * t)
    deep = (np.exp(-decay * t) * swing).max() - rest
    for seed in range(3):
        assert policy.strike("stiff_keys", seed) == pytest.approx(1e3 * deep, rel=0.03)


def test_when_the_error_comes_does_not_name_the_cause() -> None:
    """Early is not delay alone, late not friction alone; a stiff key does come late."""
    early, late = (
        {cause: replayed(cause, 0) for cause in policy.FAULTS}
        for replayed in (policy.replayed(0, 20), policy.replayed(80, 100))
    )
    assert min(early["late_drive"], early["heavy_tool"]) > 4.0 * early["dry_joint"]
    assert late["stiff_keys"] > late["dry_joint"] > late["heavy_tool"] > 5.0 * late["late_drive"]
    assert early["stiff_keys"] < 2.0


def test_widening_presses_more_keys_of_some_robots_and_fewer_of_others() -> None:
    on_model = program.success(
        *policy.pressed(policy.MODEL, policy.weights(), 0), policy.WIDTHS, 25
    )
    change = {c: policy.symptom(c, 0, "widen") - policy.symptom(c, 0, None) for c in policy.FAULTS}
    assert on_model > 0.99 and change["heavy_tool"] > 0.1 > -0.1 > change["late_drive"]


# --- The door -------------------------------------------------------------------------------------


@examples(30)
@given(SEEDS, st.booleans(), st.floats(0.05, 0.45), st.floats(1e-6, 0.1), st.booleans())
def test_the_flood_passes_a_door_wider_than_the_carriage(
    seed: int, twice: bool, half: float, spare: float, open_: bool
) -> None:
    one = gap.room("inflated_twice" if twice else "edge_check", seed)
    one = replace(one, half=half, grown=half if twice else 0.0, boxes=one.boxes[:6].copy())
    width = 2.0 * (half + one.grown) + (spare if open_ else -spare)
    middle = gap.door_middle(seed)[1]
    one.boxes[4, 3], one.boxes[5, 1] = middle - width / 2.0, middle + width / 2.0
    area, result = gap.cells(replace(one, start=np.array([1.9, 2.0])))
    margin = half + one.grown
    side = (3.95 - 2.0 * margin) * (4.0 - 2.0 * margin)
    door = (0.1 + 2.0 * margin) * spare
    assert area[result].sum() == pytest.approx(2.0 * side + door if open_ else side, rel=1e-6)


@examples(20)
@given(SEEDS)
def test_an_edge_is_clear_if_it_is_nowhere_inside(seed: int) -> None:
    """How deep a point is inside a box is concave along an edge: its largest by thirds."""
    one, rng = gap.room("goal_inside", seed), np.random.default_rng(seed)
    a, b = rng.uniform(0.0, planner.SIZE, (2, 100, 2))
    low, high = planner.walls(one)
    left, right = np.zeros((2, 100, len(low)))
    right = right + 1.0

    def depth(share: np.ndarray) -> np.ndarray:
        p = a[:, None] + share[..., None] * (b - a)[:, None]
        return np.minimum(p - low, high - p).min(axis=2)

    for _ in range(80):
        third = (right - left) / 3.0
        worse = depth(left + third) < depth(right - third)
        left, right = np.where(worse, left + third, left), np.where(worse, right, right - third)
    deepest = depth(left).max(axis=1)
    sure = np.abs(deepest) > 1e-9
    assert np.array_equal(planner.clear(one, a, b)[sure], deepest[sure] < 0.0)


@examples(20)
@given(SEEDS, st.integers(1, 60), st.integers(0, 80))
def test_what_is_reached_is_the_component_of_the_first(seed: int, count: int, edges: int) -> None:
    pairs = np.random.default_rng(seed).integers(0, count, (edges, 2))
    graph = coo_array((np.ones(edges), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    assert np.array_equal(planner.reached(count, pairs), part == part[0])


@pytest.mark.parametrize(("cause", "free"), [("improbable", 0.01), ("edge_check", 0.5)])
def test_points_in_the_door_are_as_many_as_its_area(cause: str, free: float) -> None:
    expected = 1e5 * free * 2.0 * gap.HALF / planner.SIZE.prod()
    mean = np.mean([gap.points_in_door(cause, seed) for seed in range(20)])
    assert abs(mean - expected) < 4.0 * np.sqrt(10.0 * expected / 20.0)


@pytest.mark.parametrize("cause", ["inflated_twice", "goal_inside"])
def test_more_points_never_open_what_is_closed(cause: str) -> None:
    for seed in range(3):
        assert gap.symptom(cause, seed, "more_samples") == gap.TRIALS
