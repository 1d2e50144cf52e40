"""BIT* and convex regions against the exact shortest path, and regions against the disc."""

import math
from typing import Any

import numpy as np
import pytest

from course import charts
from course.charts.planning import informed
from course.charts.planning.ompl_comparison import exactly_known
from course.oracles import convex_sets
from course.planning import check_path, length
from tests import optional


def needs_drake() -> None:
    try:
        import pydrake  # noqa: F401
    except ImportError as error:
        optional.skip(f"graphs of convex sets were NOT tried: {error}")


def needs_ompl() -> None:
    try:
        import ompl  # noqa: F401
    except ImportError as error:
        optional.skip(f"BIT* was NOT tried: {error}")


@pytest.mark.parametrize("number", [6, 13])
def test_sectors_leave_out_the_disc_and_little_else(number: int) -> None:
    rng, regions = np.random.default_rng(0), informed.sectors(number)
    points = rng.uniform(0.0, 10.0, (4000, 2))
    inside = np.any([np.all(points @ A.T <= b, axis=1) for A, b in regions], axis=0)
    away = np.linalg.norm(points - 5.0, axis=1)
    assert not np.any(inside[away < 2.0])
    # The farthest that a tangent polygon reaches out is its corners.
    assert np.all(inside[away > (2.0 + 1e-3) / math.cos(math.pi / number)])


@pytest.mark.optional
def test_convex_sets_find_the_shortest_path_of_the_gap_and_of_the_polygon() -> None:
    needs_drake()
    (disc, around), (wall, shortest) = exactly_known()
    answer = convex_sets.solve(wall.start, wall.goal, informed.rooms())
    assert check_path(wall.world, answer.path, wall.start, wall.goal)
    assert answer.path is not None
    assert length(answer.path) == pytest.approx(shortest, rel=1e-7)
    excess = []
    for number in (8, 16):
        answer = convex_sets.solve(disc.start, disc.goal, informed.sectors(number))
        assert check_path(disc.world, answer.path, disc.start, disc.goal)
        assert answer.path is not None
        excess.append(length(answer.path) / around - 1.0)
    # Never shorter than the shortest; twice the regions, about a quarter of the excess.
    assert excess[0] > excess[1] > 0.0 and 0.15 < excess[1] / excess[0] < 0.35


@pytest.mark.optional
def test_no_region_is_rejected_and_a_goal_outside_has_no_path() -> None:
    needs_drake()
    with pytest.raises(ValueError, match="regions"):
        convex_sets.solve([0, 0], [1, 1], [])
    (_, _), (wall, _) = exactly_known()
    assert convex_sets.solve(wall.start, wall.goal, informed.rooms()[:1]).path is None


def path_of(run: Any, seed: int) -> Any:
    """Return the path that a method has found after 1,000 samples."""
    path = run(seed, 1000)[1]
    assert path is not None
    return path


@pytest.mark.optional
def test_bit_star_checks_fewer_edges_than_rrt_star_for_the_same_length() -> None:
    needs_ompl()
    for scene, best in exactly_known():
        batch, tree = (informed.counted(scene, method) for method in ("bit_star", "rrt_star"))
        rows = np.array([(*batch(k, 1000)[:1], *tree(k, 1000)[:1]) for k in range(1, 6)])
        excess = np.array(
            [[length(path_of(run, k)) / best - 1.0 for run in (batch, tree)] for k in range(1, 6)]
        )
        assert np.median(rows[:, 0]) < 0.3 * np.median(rows[:, 1])
        assert np.all(excess > 0.0) and np.median(excess[:, 0]) < 2.0 * np.median(excess[:, 1])


def test_the_stored_chart_shows_what_the_page_says() -> None:
    disc, gap, regions = charts.stored("informed_and_convex")
    for panel in (disc, gap):
        batch, tree = panel["OMPL BIT*"], panel["Informed RRT*"]
        # With fewer checks than the tree's first point, BIT* has the shorter path.
        assert batch.x[1] < tree.x[0] and batch.y[1] < 0.5 * tree.y[0]
    line = regions["Drake, graph of convex sets"]
    slope = np.polyfit(np.log(line.x), np.log(line.y), 1)[0]
    assert slope == pytest.approx(-2.0, abs=0.3)
