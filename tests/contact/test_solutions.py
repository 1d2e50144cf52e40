"""The worked answers of chapter 2, against brute force, the chapter, Coal and closed forms."""

import itertools
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.contact import scenes
from course.contact.problem import Problem
from course.oracles import coal
from drills.catalogue.solve_stack.exercise import BARS, gauss_seidel, residual
from drills.catalogue.solve_stack.exercise import cases as stacks
from solutions import contact as solutions
from tests.budget import PROVE, examples


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No answer may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


# --- boxes ----------------------------------------------------------------------------------------


def overlap(a, b):
    """Whether boxes overlap by more than rounding, by intervals."""
    return all(min(p, q) - max(r, s) > 1e-12 for r, p, s, q in zip(*a, *b, strict=True))


@examples(60)
@given(st.integers(0, 10**9), st.integers(1, 5))
def test_no_shorter_move_along_an_axis_parts_the_boxes(seed, d):
    rng = np.random.default_rng(seed)
    a, b = (np.sort(rng.uniform(-1.0, 1.0, (2, d)), axis=0) for _ in range(2))
    depth, push = solutions.aabb_contact(a, b)
    assert (depth > 0.0) == overlap(a, b)
    if depth <= 0.0:
        gaps = [max(s - p, r - q) for r, p, s, q in zip(*a, *b, strict=True)]
        assert depth == -max(gaps) and not push.any()
        return
    assert not overlap(a, b + push) and np.count_nonzero(push) == 1
    assert np.abs(push).max() == depth
    for axis in range(d):
        for direction in (-1.0, 1.0):
            for share in (0.2, 0.5, 0.9, 0.999):
                assert overlap(a, b + direction * share * depth * (np.arange(d) == axis))


# --- circles --------------------------------------------------------------------------------------


def test_circles_are_those_of_the_chapter_and_of_coal():
    rng = np.random.default_rng(0)
    for _ in range(100):
        (r, s), p, q = rng.uniform(0.1, 1.0, 2), rng.normal(size=2), rng.normal(size=2)
        gap, normal, point = solutions.circle_contact(p, r, q, s)
        ours = contact.distance(
            contact.sphere(r, dim=2), [*p, 0.0], contact.sphere(s, dim=2), [*q, 0.0]
        )
        assert gap == pytest.approx(float(ours.distance), abs=1e-13)
        assert np.allclose(normal, ours.normal, rtol=0.0, atol=1e-12)
        assert np.allclose(point, 0.5 * (ours.point_a + ours.point_b), rtol=0.0, atol=1e-12)
        poses = np.array([[*p, 0.0, 1.0, 0, 0, 0], [*q, 0.0, 1.0, 0, 0, 0]])[:, :, None]
        theirs = coal.Pair(contact.sphere(r), contact.sphere(s)).distances(*poses)
        assert gap == pytest.approx(theirs[0], abs=1e-10)


@pytest.mark.parametrize("far", [0.0, 5e-324, 1e-200, 1e-20, 1.0, 1e150])
def test_a_normal_has_length_one_at_any_distance(far):
    gap, normal, _ = solutions.circle_contact([0.0, 0.0], 0.5, [far, -far], 0.25)
    assert np.hypot(*normal) == pytest.approx(1.0, abs=1e-15)
    assert gap == pytest.approx(math.hypot(far, far) - 0.75, rel=1e-15)
    if far == 0.0:
        assert normal.tolist() == [1.0, 0.0]
    elif far > 5e-324:
        assert normal == pytest.approx([math.sqrt(0.5), -math.sqrt(0.5)], abs=1e-15)


# --- time of impact -------------------------------------------------------------------------------


def test_impacts_are_those_of_the_chapter():
    rng = np.random.default_rng(1)
    counts = {True: 0, False: 0}
    for _ in range(200):
        place, velocity, other, aim = rng.normal(size=(4, 3))
        reach = rng.uniform(0.3, 2.0)
        result = solutions.impact_time(place, velocity, other, aim, reach)
        exact = contact.spheres_time_of_impact(other - place, aim - velocity, reach)
        counts[bool(np.isfinite(exact))] += 1
        assert result == (pytest.approx(float(exact), rel=1e-10) if np.isfinite(exact) else -1.0)
        if 0.0 < result < 10.0:
            ball = contact.sphere(0.5 * reach)
            advanced = contact.time_of_impact(
                ball,
                [*place, 1, 0, 0, 0],
                [*velocity, 0, 0, 0],
                ball,
                [*other, 1, 0, 0, 0],
                [*aim, 0, 0, 0],
                duration=20.0,
                tolerance=1e-11,
            )
            slowest = np.linalg.norm(aim - velocity)
            assert abs(float(advanced.time) - result) < 1e-4 / slowest
    assert min(counts.values()) > 30


# --- a sweep --------------------------------------------------------------------------------------


def drawn(rng, n=2):
    """A step of n contacts that leaves the impulses unique: more freedoms than rows."""
    nv = 3 * n + 2
    root = rng.normal(size=(nv, nv))
    mass = root @ root.T / nv + np.eye(nv)
    rows = rng.normal(size=(n, 3, nv))
    free = rng.normal(size=nv)
    return Problem(mass, rows, free, free, np.zeros(n), np.full((n, 2), 0.6), 0.01)


@pytest.mark.parametrize("seed", range(6))
def test_sweeps_end_at_the_convex_solution(seed):
    problem = drawn(np.random.default_rng(seed))
    A, b = problem.delassus, problem.rows @ problem.free
    g = np.zeros((2, 3))
    for _ in range(1500):
        g = solutions.pgs_sweep(g, A, b, 0.6)
    convex = contact.solve("convex", problem)
    swept = contact.solve("pgs", problem, law="convex", sweeps=20000)
    assert convex.converged
    assert np.allclose(g, convex.impulses, rtol=0.0, atol=1e-9)
    assert np.allclose(g, swept.impulses, rtol=0.0, atol=1e-7)
    # Coulomb's law has another answer, where something slides.
    w = (A @ g.ravel() + b).reshape(2, 3)
    if (np.hypot(w[:, 1], w[:, 2]) * g[:, 0] > 1e-3).any():
        assert np.abs(contact.solve("coulomb", problem).impulses - g).max() > 1e-3


@examples(40)
@given(st.integers(0, 10**9), st.floats(0.0, 2.0))
def test_a_block_goes_to_the_nearest_point_of_its_cone(seed, mu):
    rng = np.random.default_rng(seed)
    start = rng.normal(size=3) * [2.0, 1.0, 1.0]
    (p,) = solutions.pgs_sweep(start[None], np.eye(3), np.zeros(3), mu)
    # With A = 1 and b = 0 the step goes to zero; from b = -start it goes to start.
    assert np.abs(p).max() == 0.0
    (p,) = solutions.pgs_sweep(np.zeros((1, 3)), np.eye(3), -start, mu)
    assert math.hypot(p[1], p[2]) <= mu * p[0] + 1e-12
    normal = rng.uniform(0.0, 3.0, 300)
    angle, part = rng.uniform(0.0, 2.0 * math.pi, 300), mu * normal * rng.uniform(0.0, 1.0, 300)
    others = np.column_stack((normal, part * np.cos(angle), part * np.sin(angle)))
    assert np.linalg.norm(others - start, axis=1).min() >= np.linalg.norm(p - start) - 1e-12


# --- the block ------------------------------------------------------------------------------------


@examples(40)
@given(st.floats(0.05, 1.0), st.floats(0.1, 1.4), st.sampled_from([0.001, 0.005, 0.01]))
def test_a_block_slides_with_g_times_sine_less_mu_cosine(mu, share, dt):
    slope = share * math.atan(mu)
    x, v = solutions.contact_step([0.0, 0.0], [0.0, 0.0], slope, mu, dt, 100)
    expected = max(0.0, 9.81 * (math.sin(slope) - mu * math.cos(slope)))
    if abs(share - 1.0) > 1e-6:
        assert v == pytest.approx([expected * 100 * dt, 0.0], abs=1e-11)
    assert x[1] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.5])
def test_a_landing_is_that_of_the_true_cone(slope):
    base = scenes.block(slope, 0.4, (1.5, 0.0))
    start = replace(base, q=np.array([0.0, 0.0, 0.3]), v=np.array([1.5, 0.0, -1.0]))
    for steps in (20, 60, 150):
        path = scenes.run(start, "coulomb", 0.005, steps)
        x, v = solutions.contact_step([0.0, 0.3], [1.5, -1.0], slope, 0.4, 0.005, steps)
        assert path.unsolved == 0
        assert x == pytest.approx(path.q[[0, 2], -1], abs=1e-9)
        assert v == pytest.approx(path.v[[0, 2], -1], abs=1e-9)


# --- a stack of boxes -----------------------------------------------------------------------------


def modes(A, b, mu):
    """Yield solutions of Coulomb's law, by trying every contact open, sticking, sliding both ways.

    In each combination the impulses follow from linear equations. Those that meet the inequalities
    as well are solutions.
    """
    n = len(mu)
    for mode in itertools.product(("open", "stick", "left", "right"), repeat=n):
        # Each contact has up to two unknowns, and the row of an equation for each of them.
        columns, rows = [], []
        for i, each in enumerate(mode):
            normal, tangent = np.eye(2 * n)[2 * i], np.eye(2 * n)[2 * i + 1]
            if each == "stick":
                columns += [normal, tangent]
                rows += [2 * i, 2 * i + 1]
            elif each != "open":
                columns.append(normal + mu[i] * tangent * (1.0 if each == "right" else -1.0))
                rows.append(2 * i)
        p = np.zeros(2 * n)
        if columns:
            basis = np.array(columns).T
            unknown = np.linalg.lstsq((A @ basis)[rows], -b[rows], rcond=1e-10)[0]
            p = basis @ unknown
        u = A @ p + b
        small = 1e-9 * np.max(np.abs(b))
        friction = np.abs(p[1::2]) <= mu * p[0::2] + small
        slides = np.array([each in ("left", "right") for each in mode])
        if (
            np.all(p[0::2] >= -small)
            and np.all(u[0::2] >= -small)
            and np.all(np.abs(p[0::2] * u[0::2]) <= small)
            and np.all(friction)
            and np.all(np.abs(u[1::2][~slides] * p[0::2][~slides]) <= small)
            and np.all(p[1::2][slides] * u[1::2][slides] <= small)
        ):
            yield p.reshape(n, 2), u


def stack_case(label, seed):
    drawn = stacks(np.random.default_rng(seed))
    return next(case for case in drawn if case.label == label)


@pytest.mark.prove
@pytest.mark.parametrize(
    "label",
    ["one box", "two boxes", "one box that slides", "two boxes, the upper one lifts off"],
)
def test_the_velocities_of_a_stack_are_those_of_some_mode(label):
    for seed in range(20):
        product, diagonal, b, mu, layer = stack_case(label, seed).args
        p = solutions.solve_stack(product, diagonal, b, mu, layer)
        u = product.matrix @ p.ravel() + b
        solved = list(modes(product.matrix, b, mu))
        assert solved
        assert min(np.max(np.abs(u - other)) for _, other in solved) < 1e-8
        # The judge's residual vanishes at every one of them, and nowhere near.
        for q, _ in solved:
            assert residual(q, product.matrix, b, mu) < 1e-7
            assert residual(1.2 * q, product.matrix, b, mu) > 1e-2
            assert residual(q[:, ::-1], product.matrix, b, mu) > 1e-2


@pytest.mark.slow
def test_heavy_boxes_carry_their_weight_down_the_stack():
    """The normal impulses of each layer stop what is above it, when nothing lifts off."""
    for seed in range(8):
        drawn = stacks(np.random.default_rng(seed))
        for case in drawn:
            if case.level != "edge":
                continue
            product, diagonal, b, mu, layer = case.args
            p = solutions.solve_stack(product, diagonal, b, mu, layer)
            slack = 1e-9 * np.max(np.abs(p))
            assert np.all(p[:, 0] >= -slack) and np.all(np.abs(p[:, 1]) <= mu * p[:, 0] + slack)
            u = (product.matrix @ p.ravel() + b).reshape(-1, 2)
            fast = 1e-7 * np.max(np.abs(b))
            assert np.all(u[:, 0] >= -fast)
            assert np.all(u[p[:, 0] > 1e-6 * np.max(p[:, 0]), 0] <= fast)
            slides = np.abs(u[:, 1]) > 1e-6 * np.max(np.abs(b))
            assert np.all((p * u)[slides, 1] <= slack)
            sticks = np.abs(p[:, 1]) < mu * p[:, 0] * (1.0 - 1e-6)
            assert np.all(np.abs(u[sticks & (p[:, 0] > 1e-6 * np.max(p[:, 0])), 1]) <= fast)


def test_a_matrix_read_by_colours_is_the_matrix():
    for case in stacks(np.random.default_rng(3)):
        product, layer = case.args[0], case.args[4]
        read = solutions.read_by_colours(product, np.repeat(layer, 2))
        assert np.array_equal(read, product.matrix)
        assert product.products == 2 * max(np.bincount(layer)) * min(3, max(layer) + 1)


@pytest.mark.prove
def test_worked_answer_reaches_every_bar_and_gauss_seidel_only_the_lowest():
    for seed in range(100 if PROVE else 6):
        lowest: list[bool] = []
        upper: list[bool] = []
        for case in stacks(np.random.default_rng(seed)):
            product, _, b, mu, _ = case.args
            bar, unknowns = BARS[case.level], len(b)
            p = solutions.solve_stack(*case.args)
            error = residual(p, product.matrix, b, mu)
            assert error < 1e-3 * bar.residual
            assert product.products <= 0.7 * bar.products(unknowns)
            # Plain Gauss-Seidel, stopped at the first sweep that is good enough, if there is one.
            limit = int(bar.products(unknowns))
            errors = gauss_seidel(case, limit)
            (lowest if case.level == "simple" else upper).append(min(errors) <= bar.residual)
        assert all(lowest) and not any(upper)


def test_products_are_counted_in_rows_and_end():
    product = stack_case("two boxes", 0).args[0]
    size = len(product.matrix)
    rows = [1, 4]
    some = product(np.ones(size), rows)
    assert np.allclose(some, product.matrix.sum(axis=1)[rows], rtol=0.0, atol=1e-12)
    assert product.products == 2 / size
    product(np.ones(size))
    assert product.products == 1.0 + 2 / size
    assert product.fresh().products == 0.0
    for bad, chosen in ((np.ones(size + 1), None), (np.ones(size), [size])):
        with pytest.raises(ValueError, match=r"must be|takes"):
            product(bad, chosen)
    with pytest.raises(ValueError, match="more than 1000 products"):
        for _ in range(1001):
            product(np.ones(size))
