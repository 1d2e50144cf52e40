"""Self-collision and a held object: against Coal, in both directions, and at their limits."""

import functools
import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import charts, contact
from course.kinematics import panda, planar
from course.measure.data import FOLDER
from course.oracles import coal
from course.planning import (
    capsule_arm,
    check_path,
    clearance,
    edge_free,
    holding,
    plan,
    scenes,
    shelf,
    state_free,
    with_self_collision,
)
from course.planning.batches import in_batches
from course.planning.capsules import HAND, sampled
from course.planning.held import CUP, GRASP, SAMPLES, covering, pairs_of
from tests.budget import examples
from tests.planning.test_capsules import clutter

seeds = st.integers(0, 2**32 - 1)
CAPSULE = contact.capsule(0.04, 0.03)
EVERYWHERE = functools.cache(lambda: with_self_collision(capsule_arm([])))


LINKS = ((0.2, 0.8), (0.2, 0.8), (0.2, 0.72))  # where the capsules of three links begin and end
BEND = 2.4  # of the second joint [rad]


@functools.cache
def triangle():
    """Return three links of 1 m in the plane, 0.01 m thick, whose third can meet the first.

    The capsules begin 0.2 m after the joints, so that neighbours never meet.
    """
    chain = planar([1.0, 1.0, 1.0])
    fields = (chain.parent, chain.placement, chain.mass, chain.centre, chain.inertia)
    chain = type(chain)(*fields, lower=-2.9, upper=2.9, tool=chain.tool)
    links = [(k, (a, 0, 0), (b, 0, 0), 0.01) for k, (a, b) in enumerate(LINKS)]
    return with_self_collision(capsule_arm([], chain, links))


def gap_of_triangle(third):
    """Return the distance of the third link's capsule from the first's, by points on both."""
    points = 1.0 + np.exp(1j * BEND) + np.exp(1j * (BEND + third)) * np.linspace(0.2, 0.72, 4001)
    nearest = np.clip(points.real, *LINKS[0])
    return float(np.abs(points - nearest).min()) - 0.02


@pytest.mark.slow
@examples(8)
@given(seeds)
def test_coal_and_pinocchio_agree_state_by_state(seed) -> None:
    """With obstacles, the arm's own pairs and a capsule in the hand; apart by 1 um or more."""
    rng = np.random.default_rng(seed)
    obstacles = clutter(rng, 2)
    world = holding(with_self_collision(capsule_arm(obstacles)), CAPSULE)
    theirs = coal.CapsuleArm(panda(), HAND, obstacles, pairs_of(world), [(CAPSULE, GRASP)])
    for q in rng.uniform(world.bounds[0], world.bounds[1], (200, 7)):
        if abs(clearance(world, q)) > 1e-5:
            assert state_free(world, q) == theirs.state_free(q)


@pytest.mark.prove
@pytest.mark.slow
def test_some_states_collide_only_with_themselves() -> None:
    world, rng = EVERYWHERE(), np.random.default_rng(0)
    theirs = coal.CapsuleArm(panda(), HAND, [], pairs_of(world))
    states = rng.uniform(world.bounds[0], world.bounds[1], (2000, 7))
    ours = np.array([state_free(world, q) for q in states])
    assert all(free == theirs.state_free(q) for free, q in zip(ours, states, strict=True))
    assert 0.05 < np.mean(~ours) < 0.4
    assert all(state_free(capsule_arm([]), q) for q in states)


def test_pairs_that_are_not_checked_always_touch_or_do_not_in_other_samples() -> None:
    """Twice as many postures as the choice was made from, by Coal."""
    world = EVERYWHERE()
    low, high = world.bounds
    checked = {tuple(pair) for pair in pairs_of(world).tolist()}
    assert {(0, 7), (1, 4), (4, 7)} < checked
    states = np.random.default_rng(1).uniform(low, high, (2 * SAMPLES, 7))
    for i, j in itertools.combinations(range(len(HAND)), 2):
        if (i, j) in checked or HAND[i][0] == HAND[j][0]:
            continue
        alone = coal.CapsuleArm(panda(), HAND, [], [(i, j)])
        first = alone.state_free(states[0])
        assert all(alone.state_free(q) == first for q in states[:: 20 if first else 100])
        if first:
            assert all(alone.state_free(q) for q in states)


@pytest.mark.prove
@examples(6)
@given(seeds, st.booleans())
def test_no_edge_is_passed_that_a_dense_sampling_finds_blocked(seed, cup) -> None:
    rng = np.random.default_rng(seed)
    world = with_self_collision(capsule_arm(clutter(rng, 1)))
    world = holding(world, contact.box(CUP)) if cup else world
    for _ in range(40):
        a = rng.uniform(*world.bounds)
        b = np.clip(a + 1.5 * (d := rng.normal(size=7)) / np.linalg.norm(d), *world.bounds)
        dense = np.linspace(a, b, 401)
        free = all(state_free(world, q) for q in dense)
        if edge_free(world, a, b):
            assert free
        elif free:
            assert min(clearance(world, q) for q in dense) < 5e-3


@examples(6)
@given(seeds)
def test_the_judge_and_the_edge_test_agree(seed) -> None:
    rng = np.random.default_rng(seed)
    world = holding(EVERYWHERE(), CAPSULE)
    for _ in range(4):
        a = rng.uniform(*world.bounds)
        b = np.clip(a + 0.5 * rng.normal(size=7), *world.bounds)
        judged = check_path(world, np.stack((a, b), axis=1))
        if edge_free(world, a, b):
            assert judged
        if not judged:
            assert judged.state is not None and clearance(world, judged.state) < 0.0


def test_forearm_and_base_touch_at_a_posture_found_by_bisection() -> None:
    """By Coal's distance: rejected 20 um inside, passed 20 um outside, edge and judge alike."""
    world, rng = EVERYWHERE(), np.random.default_rng(2)
    alone = coal.CapsuleArm(panda(), HAND, [], [(0, 4)])
    others = coal.CapsuleArm(
        panda(), HAND, [], [p for p in pairs_of(world).tolist() if p != [0, 4]]
    )
    tried = 0
    while tried < 5:
        a, b = rng.uniform(world.bounds[0], world.bounds[1], (2, 7))
        if alone.state_free(b) or not alone.state_free(a):
            continue
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            if alone.state_free(a + middle * (b - a)):
                low = middle
            else:
                high = middle
        deviation = 2e-5
        outside, inside = (a + (low + s * deviation) * (b - a) for s in (-1.0, 1.0))
        if not (others.state_free(outside) and others.state_free(inside)):
            continue
        tried += 1
        assert not alone.state_free(inside) and not state_free(world, inside)
        assert clearance(world, inside) < 0.0 < clearance(world, outside)
        assert state_free(world, outside) == (clearance(world, outside) > 5e-6)
        assert not edge_free(world, outside, inside)
        assert not check_path(world, np.stack((outside, inside), axis=1))
    assert tried == 5


@pytest.mark.slow
def test_an_edge_collides_with_itself_between_two_free_ends() -> None:
    """Three links in the plane: the third sweeps across the first while both ends are free."""
    world = triangle()
    assert pairs_of(world).tolist() == [[0, 2]]
    start, end = np.array([0.4, BEND, 1.9]), np.array([-0.4, BEND, 2.83])
    assert gap_of_triangle(1.9) > 0.01 and gap_of_triangle(2.83) > 0.01
    assert state_free(world, start) and state_free(world, end)
    assert not edge_free(world, start, end)
    assert not edge_free(sampled(world), start, end)
    assert not check_path(world, np.stack((start, end), axis=1))
    # The first joint turns the whole arm and changes no gap.
    assert edge_free(world, [-2.9, BEND, 1.9], [2.9, BEND, 1.9])


def test_three_links_touch_where_geometry_says() -> None:
    world, low, high = triangle(), 1.9, 2.49
    assert gap_of_triangle(low) > 0.0 > gap_of_triangle(high)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gap_of_triangle(middle) > 0.0 else (low, middle)
    for deviation, free in ((-1e-4, True), (1e-4, False)):
        assert state_free(world, [0.3, BEND, low + deviation]) is free
        assert edge_free(world, [-0.3, BEND, 1.9], [0.3, BEND, low + deviation]) is free


@pytest.mark.parametrize("columns", [1, 2, 3])
def test_capsules_cover_a_box_and_reach_as_far_beyond_it_as_stated(columns) -> None:
    rng = np.random.default_rng(columns)
    half = np.array(CUP)
    spots = rng.uniform(-half, half, (5000, 3))
    spots[:8] = half * list(itertools.product((-1, 1), repeat=3))
    capsules = covering(contact.box(half), columns)
    least = np.full(len(spots), np.inf)
    for a, b, radius in capsules:
        t = np.clip((spots - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-300), 0.0, 1.0)
        distance = np.linalg.norm(spots - a - t[:, None] * (b - a), axis=1)
        least = np.minimum(least, distance - radius)
    assert least.max() <= 1e-12
    beyond = max(float((np.maximum(np.abs(a), np.abs(b)) + r - half).max()) for a, b, r in capsules)
    assert beyond == pytest.approx((3**0.5 - 1) * 0.04 / columns)


def test_a_held_box_is_refused_wherever_coal_has_it_collide() -> None:
    """The covering only adds volume; of a capsule in the hand there is no difference at all."""
    requested, rng = shelf("open"), np.random.default_rng(3)
    box = contact.box(CUP)
    world = holding(requested.world, box, columns=3)
    links = [k for k, row in enumerate(HAND) if row[0] != 7]
    boards = [(contact.box(r[4:7]), [*r[1:4], 1.0, 0.0, 0.0, 0.0]) for r in world.obstacles]
    pairs = [(k, len(HAND)) for k in links if k not in (5, 6)]
    theirs = coal.CapsuleArm(panda(), HAND, boards, pairs, [(box, GRASP)])
    rejected = 0
    for q in rng.uniform(world.bounds[0], world.bounds[1], (3000, 7)):
        if not theirs.state_free(q):
            assert not state_free(world, q)
        elif state_free(requested.world, q):
            rejected += not state_free(world, q)
    assert rejected > 0


def test_the_order_of_object_and_self_collision_does_not_matter() -> None:
    bare = capsule_arm([])
    first = holding(with_self_collision(bare), CAPSULE)
    second = with_self_collision(holding(bare, CAPSULE))
    assert sorted(pairs_of(first).tolist()) == sorted(pairs_of(second).tolist())
    only = holding(bare, CAPSULE)
    assert set(pairs_of(only)[:, 1]) == {len(HAND)}
    # Contact with the hand that holds it is allowed, in every order.
    for world in (first, second, only):
        assert not {(7, len(HAND)), (8, len(HAND))} & {tuple(p) for p in pairs_of(world).tolist()}


def test_what_is_switched_off_stays_as_it_was() -> None:
    world = shelf("open").world
    assert pairs_of(world).shape == (0, 2)
    assert len(world.body) == 8 + len(HAND)


def test_a_plan_with_a_cup_is_right() -> None:
    requested, rng = shelf("open"), np.random.default_rng(1)
    held = replace(requested, world=holding(with_self_collision(requested.world), contact.box(CUP)))
    solved = 0
    for k in range(3):
        start, goal = held.query(rng)
        result = plan(held.world, start, goal, budget=50_000, rng=k)
        solved += result.solved
        if result.path is not None:
            assert check_path(held.world, result.path, start, goal)
    assert solved >= 2


def test_a_cup_is_upright_where_the_hand_points_ahead_and_level() -> None:
    flange = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # z ahead, y level
    axis = flange @ contact.shapes.to_matrix(np.array(GRASP[3:]))[:, 2]
    assert abs(axis[2]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: with_self_collision(scenes.gap(0.1).world), "world.kind"),
        (lambda: holding(scenes.gap(0.1).world, CAPSULE), "world.kind"),
        (lambda: holding(capsule_arm([]), contact.plane()), "shape"),
        (lambda: holding(capsule_arm([]), CAPSULE, np.zeros(6)), "pose"),
        (lambda: covering(contact.box(CUP), 0), "columns"),
        (lambda: with_self_collision(capsule_arm([]), samples=0), "samples"),
        (lambda: in_batches(EVERYWHERE()), "self-collision"),
    ],
)
def test_bad_input_is_named(call, named) -> None:
    with pytest.raises(ValueError, match=named):
        call()


def test_the_stored_chart_shows_what_the_page_says() -> None:
    times, missed = charts.stored("held_object")
    value = dict(zip(times.series[0].y, times.series[0].x, strict=True))
    assert value["edge, obstacles only"] < value["edge, and itself"] < value["edge, and a cup"]
    assert value["state, and a cup"] < value["state by Coal, and a cup"]
    share = dict(zip(missed.series[0].y, missed.series[0].x, strict=True))
    assert share["random states, itself"] > 10.0 and share["paths, tight shelf, cup"] > 50.0
    assert "Coal disagrees: 0 of" in (FOLDER / "held_object.txt").read_text()


@pytest.mark.slow
def test_a_small_chart_is_measured_as_the_stored_one() -> None:
    panels = charts.build("held_object", states=50, timed=5, queries=2, cups=1, repeats=2)
    assert [panel.title for panel in panels] == [p.title for p in charts.stored("held_object")]
