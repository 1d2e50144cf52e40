"""Shorter, smoother, timed: what may never happen, closed forms, and where optimisers get stuck."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from course.drills import edge_is_free, rrt
from course.planning import length, plane
from course.planning.trajectory import (
    Limits,
    covariant_gradient,
    sequential_convex,
    shortcut,
    smooth,
    time_parameterise,
    trapezoid,
)
from drills.geometry import path_faults
from tests.budget import examples

BOUNDS = np.array([[0.0, 0.0], [10.0, 10.0]])
seeds = st.integers(0, 2**32 - 1)


def draw(seed: int):
    """A path of RRT among discs, the discs, and whether an edge is free."""
    rng = np.random.default_rng(seed)
    discs = np.column_stack((rng.uniform(1.5, 8.5, (12, 2)), rng.uniform(0.2, 0.9, 12)))
    result = rrt((0.5, 0.5), (9.5, 9.5), discs, BOUNDS, 0.8, 4000, rng)[0]
    path = np.array([[0.5, 0.5], [0.5, 9.5], [9.5, 9.5]]) if result is None else result
    return path.T, discs, lambda a, b: edge_is_free(a, b, discs)


def faults(path, discs):
    """What the exact judge of the drill finds wrong, which shares no code with `edge_is_free`."""
    return path_faults(path.T, path[:, 0], path[:, -1], discs, BOUNDS, 99.0)


@pytest.mark.slow
@examples(25)
@given(seeds)
def test_a_shortcut_never_lengthens_never_collides_and_keeps_its_ends(seed) -> None:
    path, discs, free = draw(seed)
    rng = np.random.default_rng(seed)
    for kind in ("vertex", "partial"):
        short = shortcut(path, free, rng, rounds=60, kind=kind)
        assert length(short) <= length(path) * (1.0 + 1e-12)
        assert (short[:, [0, -1]] == path[:, [0, -1]]).all()
        assert not faults(short, discs)
    soft = smooth(short, free)
    assert length(soft) <= length(short) * (1 + 1e-12) and not faults(soft, discs)


@examples(100)
@given(seeds)
def test_one_joint_straightened_over_arc_length_never_lengthens(seed) -> None:
    """Where nothing is in the way, each kind of shortcut alone ends at the straight line."""
    rng = np.random.default_rng(seed)
    path = rng.normal(size=(int(rng.integers(1, 8)), int(rng.integers(3, 9))))
    lengths = [length(path)]
    for _ in range(6):
        path = shortcut(path, lambda a, b: rng.random() < 0.7, rng, rounds=1)
        lengths.append(length(path))
    assert (np.diff(lengths) <= 1e-12).all()
    assert shortcut(path, lambda a, b: True, rng).shape[1] == 2


def test_partial_shortcuts_bring_what_those_of_vertices_cannot() -> None:
    """Two tubes, one behind the other: only one joint at a time can be straightened."""
    path = np.array([[0, 0, 0], [0, 3, 1], [2, 3, 1], [2, 3, 2], [2, 0, 3]], float).T

    def free(a, b):  # while the first two joints move along an L, the third is free
        corner = np.linspace(a, b, 200)
        return bool(
            np.all((corner[:, 0] < 1e-9) | (corner[:, 1] > 2.5) | (corner[:, 0] > 2 - 1e-9))
        )

    by_kind = {
        kind: np.mean(
            [
                length(shortcut(path, free, np.random.default_rng(s), rounds=150, kind=kind))
                for s in range(5)
            ]
        )
        for kind in ("vertex", "partial")
    }
    assert by_kind["partial"] < by_kind["vertex"] - 0.3


def test_smoothing_goes_to_the_spline_and_corners_that_collide_stay() -> None:
    path = np.array([[0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    soft = smooth(path, lambda a, b: True, rounds=6)
    turns = np.diff(soft, 2) * 4.0**6
    # A spline's second difference is bounded; the corner's own would grow fourfold each round.
    assert np.abs(turns).max() < 2.0
    assert (smooth(path, lambda a, b: (a == b).any(), rounds=2)[:, 4] == path[:, 1]).all()


# --- timed ----------------------------------------------------------------------------------------


def drawn_motion(seed: int):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    path = rng.normal(size=(n, int(rng.integers(2, 8))))
    limits = Limits(rng.uniform(0.3, 3.0, n), rng.uniform(0.3, 10.0, n))
    return rng, path, limits, float(rng.choice([0.0, 0.03, 0.5]))


@examples(60)
@given(seeds)
def test_limits_hold_at_a_thousand_times_between_the_grid(seed) -> None:
    rng, path, limits, blend = drawn_motion(seed)
    motion = time_parameterise(path, limits, blend=blend, grid=int(rng.integers(2, 20)))
    _, rate, acceleration = motion(rng.uniform(0.0, motion.duration, 1000))
    assert (np.abs(rate) <= limits.velocity[:, None] * (1 + 1e-12)).all()
    assert (np.abs(acceleration) <= limits.acceleration[:, None] * (1 + 1e-12)).all()


@examples(60)
@given(seeds)
def test_rate_and_acceleration_are_those_of_the_state_and_the_path_is_followed(seed) -> None:
    rng, path, limits, blend = drawn_motion(seed)
    motion = time_parameterise(path, limits, blend=blend)
    np.testing.assert_allclose(motion([0.0, motion.duration])[0], path[:, [0, -1]], atol=1e-12)
    assert not motion([-1.0, motion.duration + 1.0])[1:].any()
    i = rng.choice(np.flatnonzero(np.diff(motion.times) > 1e-6), size=20)
    t = motion.times[i] + rng.uniform(0.2, 0.8, 20) * np.diff(motion.times)[i]
    dt = 1e-3 * np.diff(motion.times)[i]
    before, now, after = motion(t - dt), motion(t), motion(t + dt)
    scale = np.abs(now[1]).max() + 1e-9
    np.testing.assert_allclose((after[0] - before[0]) / (2 * dt), now[1], atol=1e-5 * scale)
    far = np.abs(now[2]).max() + 1e-9
    np.testing.assert_allclose((after[1] - before[1]) / (2 * dt), now[2], atol=1e-5 * far)
    # Every state lies on the path, or within a quarter of the blend's turn of it.
    at, path = motion(rng.uniform(0.0, motion.duration, 100))[0].T, path.T
    edges = np.diff(path, axis=0)
    share = np.einsum("tki,ki->tk", at[:, None] - path[:-1], edges) / np.sum(edges**2, axis=1)
    foot = path[:-1] + np.clip(share, 0.0, 1.0)[:, :, None] * edges
    error = np.linalg.norm(at[:, None] - foot, axis=2).min(axis=1)
    assert error.max() <= 0.5 * blend + 1e-12
    shape = motion.waypoints(0.1)
    np.testing.assert_allclose(shape.T[[0, -1]], path[[0, -1]], atol=1e-12)


@examples(60)
@given(seeds)
def test_a_line_is_the_trapezoid_of_its_slowest_joint(seed) -> None:
    rng = np.random.default_rng(seed)
    d = rng.normal(size=5) * 10 ** rng.uniform(-2, 1)
    v, a = rng.uniform(0.3, 3.0, 5), rng.uniform(0.3, 10.0, 5)
    motion = time_parameterise(np.array([np.zeros(5), d]).T, (v, a))
    # One unit along the line: the rate and acceleration that the joints leave to it.
    v1, a1 = np.min(v / np.abs(d)), np.min(a / np.abs(d))
    closed = 1.0 / v1 + v1 / a1 if v1**2 < a1 else 2.0 / np.sqrt(a1)
    assert motion.duration == pytest.approx(closed, rel=1e-13)
    each, peak = trapezoid(d, v, a)
    assert each.max() <= motion.duration * (1 + 1e-13) and (peak <= v).all()
    middle = motion(0.5 * closed)
    np.testing.assert_allclose(middle[0], 0.5 * d, rtol=1e-12)
    np.testing.assert_allclose(np.max(np.abs(middle[1]) / np.abs(d)), min(v1, np.sqrt(a1)))


def test_no_slower_motion_of_the_grid_is_left_out() -> None:
    """Against a linear programme that knows no passes: the sum of all squared speeds at its most.

    Reachability gives the largest squared speed at each point at once, so their sum is largest too.
    """
    rng = np.random.default_rng(3)
    path = rng.normal(size=(3, 4))
    v, a = np.full(3, 1.0), np.full(3, 2.0)
    motion = time_parameterise(path, (v, a), blend=10.0, grid=12)
    h, m = np.diff(motion.stations), len(motion.push)
    rows, largest = [], []
    for i in range(m):
        for end in (0.0, h[i]):
            tangent = motion.first[i] + end * motion.second[i]
            for j in range(3):
                row = np.zeros(m + 1)  # u = (x[i+1] - x[i]) / 2h, x there linear
                row[i] = -tangent[j] / (2 * h[i]) + motion.second[i, j] * (1 - end / h[i])
                row[i + 1] = tangent[j] / (2 * h[i]) + motion.second[i, j] * end / h[i]
                rows += [row, -row]
                largest += [a[j], a[j]]
    steepest = np.abs(np.stack((motion.first, motion.first + h[:, None] * motion.second))).max(
        axis=0
    )
    top = np.min((v / steepest) ** 2, axis=1)
    cap = np.minimum(np.append(top, np.inf), np.append(np.inf, top))
    cap[[0, -1]] = 0.0
    best = linprog(-np.ones(m + 1), rows, largest, bounds=[(0.0, c) for c in cap], method="highs")
    np.testing.assert_allclose(motion.speeds**2, best.x, atol=1e-7)


def test_rounding_saves_time_and_a_finer_grid_saves_little_more() -> None:
    path = np.cumsum(np.random.default_rng(5).normal(size=(7, 8)), axis=1)
    limits = (np.full(7, 2.0), np.full(7, 5.0))
    stops = time_parameterise(path, limits).duration
    coarse, fine = (time_parameterise(path, limits, blend=0.3, grid=g).duration for g in (16, 256))
    assert fine < coarse < fine * 1.001 < 0.9 * stops


def test_a_rounding_that_collides_is_made_smaller() -> None:
    path, discs = np.array([[0.0, 1, 1], [0, 0, 1]]), np.array([[0.7, 0.28, 0.25]])
    motion = time_parameterise(
        path, (1.0, 1.0), blend=1.0, free=lambda a, b: edge_is_free(a, b, discs)
    )
    wide = time_parameterise(path, (1.0, 1.0), blend=1.0)

    def gap(motion):
        return np.hypot(*(motion.waypoints(1e-3) - discs[0, :2, None])).min() - 0.25

    assert gap(wide) < 0.0 < gap(motion)
    assert wide.duration < motion.duration < time_parameterise(path, (1.0, 1.0)).duration


# --- out of obstacles -----------------------------------------------------------------------------


DISC = np.array([[0.5, 0.05, 0.2]])
LINE = np.array([[0.0, 1.0], [0.0, 0.0]])
OPTIMISERS: list[Any] = [covariant_gradient, sequential_convex]


def to_disc(Q, disc=DISC[0]):
    return np.hypot(Q[0] - disc[0], Q[1] - disc[1]) - disc[2]


@pytest.mark.parametrize("optimise", OPTIMISERS)
def test_an_optimiser_leaves_a_disc_on_the_nearer_side(optimise) -> None:
    result = optimise(LINE, to_disc, margin=0.05)
    dense = np.linspace(result.path[:, :-1], result.path[:, 1:], 50)
    gap = np.min([to_disc(q) for q in dense])
    assert gap > 0.0 and result.clearance == pytest.approx(gap, abs=1e-4)
    np.testing.assert_array_equal(result.path[:, [0, -1]], LINE)
    assert result.path[1].min() < -0.14 and result.path[1].max() < 1e-2
    # A taut string below: a tangent from each end, and the arc between them.
    far = np.hypot(0.5, 0.05)
    arc = np.pi + 2 * np.arctan2(-0.05, 0.5) - 2 * np.arccos(0.2 / far)
    string = 2 * np.sqrt(far**2 - 0.2**2) + 0.2 * arc
    assert string < length(result.path) < 1.1 * string


def test_hinges_keep_the_margin_to_their_tolerance_and_an_empty_world_is_a_line() -> None:
    result = sequential_convex(LINE, to_disc, margin=0.05)
    assert to_disc(result.path[:, 1:-1]).min() == pytest.approx(0.05, abs=1e-3)
    bent = np.array([[0.0, 0.3, 1.0], [0.0, 1.0, 0.0]])
    for optimise in OPTIMISERS:
        line = optimise(bent, lambda Q: np.ones(Q.shape[1]), margin=0.1).path
        np.testing.assert_allclose(line, np.linspace([0, 0], [1, 0], 42).T, atol=2e-3)


@pytest.mark.parametrize("optimise", OPTIMISERS)
def test_a_start_through_the_middle_stays_stuck_and_says_so(optimise) -> None:
    middle = np.array([0.5, 0.0, 0.2])
    result = optimise(LINE, lambda Q: to_disc(Q, middle), margin=0.05)
    assert result.clearance < 0.0 and np.abs(result.path[1]).max() < 1e-6


@pytest.mark.parametrize("optimise", OPTIMISERS)
def test_a_world_is_a_distance_too(optimise) -> None:
    world = plane([[-1, -1], [2, 1]], DISC)
    result, same = (optimise(LINE, field, margin=0.05, iterations=20) for field in (world, to_disc))
    np.testing.assert_allclose(result.path, same.path, atol=1e-6)
    assert result.evaluations == same.evaluations


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: shortcut([[0.0, np.nan]], lambda a, b: True, np.random.default_rng(0)), "path"),
        (lambda: shortcut([1.0, 2.0], lambda a, b: True, np.random.default_rng(0)), "path.shape"),
        (lambda: time_parameterise([[0.0, 1.0]], (0.0, 1.0)), "limits.velocity"),
        (lambda: time_parameterise([[0.0, 1.0]], (1.0, np.inf)), "limits.acceleration"),
        (lambda: time_parameterise([[0.0, 1.0]], (1.0, 1.0), blend=-1.0), "blend"),
        (lambda: sequential_convex([[0.0, 1.0]], lambda Q: Q[0], margin=0.0), "margin"),
    ],
)
def test_bad_input_is_named(call, named) -> None:
    with pytest.raises(ValueError, match=named):
        call()


def test_a_path_that_does_not_move_takes_no_time() -> None:
    motion = time_parameterise([[1.0], [2.0]], (1.0, 1.0))
    assert motion.duration == 0.0 and motion(0.0)[0].tolist() == [1.0, 2.0]
