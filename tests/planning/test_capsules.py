"""The arm of capsules: its distances and edges against other code, and what the shelves ask."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.compiled import compiled
from course.kinematics import frames, panda, planar, random_chain, tip
from course.planning import capsule_arm, check_path, clearance, edge_free, plan, shelf, state_free
from course.planning.capsules import HAND
from course.planning.worlds import EDGE, STATE
from tests.budget import examples

seeds = st.integers(0, 2**32 - 1)


def quaternion(rng):
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def clutter(rng, count=4):
    """Shapes of chapter 2 around the arm, of all three kinds."""
    made = []
    for k in range(count):
        shape = (
            contact.sphere(rng.uniform(0.05, 0.2)),
            contact.capsule(rng.uniform(0.02, 0.1), rng.uniform(0.05, 0.4)),
            contact.box(rng.uniform(0.02, 0.3, 3), rng.choice([0.0, 0.03])),
        )[k % 3]
        spot = rng.normal(size=3)
        spot *= rng.uniform(0.45, 1.0) / np.linalg.norm(spot)
        made.append((shape, np.append(spot + [0, 0, 0.3], quaternion(rng))))
    return made


def gap_by_chapter_two(obstacles, q):
    """The least distance of a capsule from an obstacle, by GJK; capsules as hulls of two points."""
    arm = panda()
    poses = np.column_stack((frames(arm, q), tip(arm, q)))
    return min(
        float(contact.distance(contact.points(np.array([a, b]).T, r), poses[:, f], o, p).distance)
        for f, a, b, r in HAND
        for o, p in obstacles
    )


@examples(40)
@given(seeds)
def test_the_clearance_is_that_of_chapter_two(seed) -> None:
    rng = np.random.default_rng(seed)
    obstacles = clutter(rng, 6)
    world = capsule_arm(obstacles)
    q = rng.uniform(*world.bounds)
    ours, theirs = clearance(world, q), gap_by_chapter_two(obstacles, q)
    if theirs > -0.025 and ours > -0.02:  # deeper, a line goes through: there only the sign counts
        assert ours == pytest.approx(theirs, abs=1e-9)
    assert (ours > 0.0) == (theirs > 0.0) and state_free(world, q) == (theirs >= 5e-6)


@examples(6)
@given(seeds)
def test_no_edge_is_passed_that_a_dense_sampling_finds_blocked(seed) -> None:
    """Sampled every 0.001 rad; of what is refused though free, the gap is under 10 um of motion."""
    rng = np.random.default_rng(seed)
    world = capsule_arm(clutter(rng))
    edge, state = compiled(world.edge_free, EDGE), compiled(world.state_free, STATE)
    for _ in range(40):
        a = rng.uniform(*world.bounds)
        b = a + 0.5 * (d := rng.normal(size=7)) / np.linalg.norm(d)
        dense = np.linspace(a, b, 501)
        free = all(state(world.obstacles, world.body, q) for q in dense)
        if edge(world.obstacles, world.body, a, b):
            assert free
        elif free:
            least = min(clearance(world, q) for q in dense)
            assert least < 1e-3  # between the samples it is nearer by at most their motion


@examples(8)
@given(seeds)
def test_the_judge_and_the_edge_test_agree(seed) -> None:
    rng = np.random.default_rng(seed)
    world = capsule_arm(clutter(rng, 3))
    for _ in range(4):
        a = rng.uniform(*world.bounds)
        b = np.clip(a + 0.3 * rng.normal(size=7), *world.bounds)
        judged = check_path(world, np.stack((a, b), axis=1))
        if edge_free(world, a, b):
            assert judged
        if not judged:
            assert judged.state is not None and clearance(world, judged.state) < 0.0


@examples(30)
@given(seeds)
def test_no_point_moves_farther_than_the_bound_says(seed) -> None:
    """The sum of |dq| times the distance from each axis, at one posture, for any other posture."""
    rng = np.random.default_rng(seed)
    chain = random_chain(int(rng.integers(1, 7)), rng)
    q = rng.normal(size=chain.n)
    dq = rng.normal(size=chain.n) * 10 ** rng.uniform(-3, 0.5)
    poses = frames(chain, q)
    here, other = tip(chain, q)[:3], tip(chain, q + dq)[:3]
    z = np.array([contact.shapes.to_matrix(p[3:])[:, 2] for p in poses.T])
    lever = np.linalg.norm(np.cross(z, here - poses[:3].T), axis=1)
    bound = np.sum(np.abs(dq) * np.where(chain.slides, 1.0, lever))
    assert np.linalg.norm(other - here) <= bound + 1e-12


def test_an_arm_of_one_link_meets_a_sphere_where_geometry_says() -> None:
    chain = planar([1.0])
    chain = type(chain)(
        chain.parent,
        chain.placement,
        chain.mass,
        chain.centre,
        chain.inertia,
        lower=-3.0,
        upper=3.0,
        tool=chain.tool,
    )
    link = [(0, (0, 0, 0), (1.0, 0, 0), 0.1)]
    ball = [(contact.sphere(0.2), [0.0, 0.8, 0, 1, 0, 0, 0])]
    world = capsule_arm(ball, chain, link)
    touching = np.pi / 2 - np.arcsin(0.3 / 0.8)
    for deviation, free in ((-2e-5, True), (2e-5, False)):
        assert state_free(world, [touching + deviation]) is free
        assert edge_free(world, [-1.0], [touching + deviation]) is free
    assert not edge_free(world, [-1.0], [3.0])  # both ends free, the ball between them
    assert not check_path(world, [[-1.0, 3.0]]) and check_path(world, [[-1.0, touching - 2e-5]])


@pytest.mark.parametrize("name", ["open", "tight"])
def test_shelf_queries_are_solved_and_every_path_is_one(name) -> None:
    requested = shelf(name)
    rng = np.random.default_rng(1)
    solved = 0
    for k in range(3):
        start, goal = requested.query(rng)
        for q in (start, goal):
            assert state_free(requested.world, q)
            assert 0.5 < tip(panda(), q)[0] + 0.145 < 0.8  # the fingers are in a bay
        world = requested.disturbed(rng, start, goal) if k else requested.world
        result = plan(world, start, goal, budget=20_000, rng=k)
        solved += result.solved
        if result.path is not None:
            assert check_path(world, result.path, start, goal)
    assert solved >= 2


def test_the_hand_has_a_centimetre_to_spare_upright_in_the_tight_bay() -> None:
    (wide,) = [c for c in HAND if c[1] == (0, -0.075, 0.03)]
    assert 2 * (0.075 + wide[3]) == pytest.approx(0.23)
    assert shelf("tight").height == 0.25 and shelf("open").bays.shape == (3, 4)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: capsule_arm([(contact.plane(), [0, 0, 0, 1, 0, 0, 0])]), "shape"),
        (lambda: capsule_arm([(contact.sphere(0.1), [0, 0, np.nan, 1, 0, 0, 0])]), "pose"),
        (lambda: capsule_arm([], panda(), [(9, (0, 0, 0), (0, 0, 1), 0.1)]), "frame"),
        (lambda: capsule_arm([], planar([1.0]), []), "chain limits"),
        (lambda: shelf("wide"), "name"),
        (lambda: edge_free(shelf("open").world, np.zeros(6), np.zeros(7)), "a.shape"),
    ],
)
def test_bad_input_is_named(call, named) -> None:
    with pytest.raises(ValueError, match=named):
        call()
