"""What the charts of chapter 5 say is in what they measured: their stored series are read."""

import re

import numpy as np
import pytest

from course import charts
from course.charts.planning import ladder, limits
from course.planning import check_path, edge_free, plan, shelf


def middle(series) -> float:
    """Where a curve of shares passes one half."""
    return float(np.asarray(series.x)[np.argmax(np.asarray(series.y) >= 0.5)])


def test_a_plan_is_found_sooner_than_by_ompl_with_states_in_python_and_never_collides() -> None:
    panels = charts.stored("plan_times")
    assert len(panels) == 4
    for panel in panels:
        python, fine = panel["OMPL, Python states"], panel["OMPL, Python, 0.2%"]
        assert panel["ours"].y[-1] == 1.0 == panel["OMPL, our edge check"].y[-1]
        assert middle(python) > 2.0 * middle(panel["ours"])
        assert python.y[-1] <= fine.y[-1] <= 1.0 and middle(fine) >= middle(python)
        assert middle(panel["OMPL's own part"]) < middle(panel["OMPL, our edge check"])
        assert np.all(np.diff(panel["ours"].y) >= 0.0)
    assert panels[2]["OMPL, Python states"].y[-1] < 0.9  # collides in the narrow gap
    assert middle(panels[3]["OMPL, Python states"]) > 30.0 * middle(panels[3]["ours"])
    assert middle(panels[2]["OMPL, our edge check"]) > middle(panels[2]["ours"])


def test_the_rungs_of_the_ladder_bought_what_the_notebook_says() -> None:
    longer_with_paths = 0
    for panel in charts.stored("shelf_ladder"):
        for place in ("still", "moved"):
            middle, tail = (
                np.asarray(panel[f"{name}, {place}"].y) for name in ("median", "slowest")
            )
            longer, both, batches, bridge, _, _, trees, earlier = middle
            assert 2.0 * both < min(longer, bridge)
            assert max(both, trees, earlier) < 2.5 * min(both, trees, earlier)
            # In batches, some ends touch because the spheres are larger than the arm.
            assert np.isinf(tail[2]) and (batches < both) == panel.title.startswith("open")
            assert tail[6] < min(tail[1], 0.1) and tail[7] < 0.1
            longer_with_paths += earlier > trees
    short = r"^(?:compiled|in batches|edges proved) +still.* (\d+) of +10,.*slowest +inf"
    solved = re.findall(short, charts.read("shelf_ladder"), re.M)
    assert longer_with_paths == 3
    assert len(solved) == 6 and all(int(count) <= 5 for count in solved)


@pytest.mark.prove
@pytest.mark.parametrize("name", ["open", "tight"])
def test_the_second_tree_needs_no_larger_limit_with_the_shelf_unchanged(name: str) -> None:
    requested = shelf(name)
    queries, _ = ladder.certified(requested, 100, 0)
    limited = ladder.BOTH | {"budget": ladder.SAMPLES}
    assert all(plan(requested.world, *q, rng=i, **limited).solved for i, q in enumerate(queries))


def test_ours_and_ompl_take_as_many_samples() -> None:
    """By the largest distance of two shares, at a risk of 1 % (Smirnov, 1948)."""
    *counts, roadmaps = charts.stored("sample_counts")
    for panel, seeds in zip(counts, (500, 500, 100), strict=True):
        for ours, other in zip(panel.series[::2], panel.series[1::2], strict=True):
            difference = np.abs(np.asarray(ours.y) - other.y).max()
            assert ours.label.split(",")[0] == other.label.split(",")[0]
            assert difference < 1.63 * np.sqrt(2.0 / seeds)
            assert ours.y[-1] == other.y[-1] == 1.0
    for ours, other in zip(roadmaps.series[::2], roadmaps.series[1::2], strict=True):
        assert np.all(np.asarray(ours.low) <= other.high)
        assert np.all(np.asarray(other.low) <= ours.high)


def test_no_star_tree_is_first_within_five_percent_and_no_path_beats_the_shortest() -> None:
    for panel in charts.stored("path_quality"):
        (pick,) = (s for s in panel.series if s.key == "chosen")
        name = panel.title.split(": fastest within 5%:\n")[1]
        assert pick.y[0] <= 0.05 and name in ("PRM*", "RRT-Connect, shortcuts")
        assert pick.x[0] in panel[name].x
        curves = [s for s in panel.series if s.counts]
        assert len(curves) == 5
        for series in curves:
            x, y = np.asarray(series.x), np.asarray(series.y)
            assert np.all(y > 0.0) and np.all(x[y <= 0.05] >= pick.x[0])
            assert y[-1] < y[0]
        informed, star = panel["Informed RRT*"], panel["RRT*"]
        assert informed.y[-1] < 0.7 * star.y[-1]


def test_a_hole_closes_with_the_dimension_as_theory_says_and_a_slab_does_not() -> None:
    pair, samples = charts.stored("narrow_passages")
    for name in ("slab", "hole"):
        bounded = [1 if name == "slab" else n - 1 for n in pair[name].x]
        law = np.array([limits.pair_joined(0.1, b) for b in bounded])
        assert np.all(np.abs(pair[name].y - law) < 4.0 * np.sqrt(law / 100_000))
    assert limits.pair_joined(0.1, 2) == pytest.approx(0.01 * 7 / 3, rel=0.02)
    assert max(samples["slab"].y) < 30 and max(samples["slab, OMPL"].y) < 30
    for name in ("hole", "tunnel", "hole, OMPL", "tunnel, OMPL"):
        assert np.isinf(samples[name].y[-1])
        assert np.all(np.diff(samples[name].y) > 0.0)


def test_the_judge_of_a_hole_says_what_the_kernel_says() -> None:
    rng = np.random.default_rng(1)
    for bounded, depth in ((1, 0.2), (2, 0.05), (2, 0.3)):
        world = limits.hole(3, 0.3, depth, bounded)
        for a, b in rng.uniform(-0.5, 0.5, (300, 2, 3)):
            assert edge_free(world, a, b) == bool(check_path(world, np.array([a, b]).T))


def test_points_miss_as_often_as_the_closed_form_says_and_the_exact_test_never() -> None:
    (panel,) = charts.stored("thin_obstacles")
    for name, law in (("wall", lambda x: max(0.0, 1.0 - x)), ("disc", limits.disc_missed)):
        expected = np.array([law(x) for x in panel[f"{name}, points"].x])
        for owner in ("points", "OMPL"):
            assert np.abs(panel[f"{name}, {owner}"].y - expected).max() < 0.04
    assert max(panel["both, our exact test"].y) == 0.0
    offsets = np.linspace(0.0, 1.0, 20_001)  # of a disc of 1.3 spacings, by quadrature
    missed = np.maximum(0.0, 1.0 - 1.3 * np.sqrt(1.0 - offsets**2)).mean()
    assert limits.disc_missed(1.3) == pytest.approx(missed, abs=1e-4)


def test_limits_hold_between_points_only_where_both_ends_are_constrained() -> None:
    over, times = charts.stored("limits_between")
    points = np.asarray(over["tested at the first point"].y)
    assert np.all(points > 0.01) and np.all(np.diff(points) < 0.0)
    assert max(over["tested at both ends"].high) < 1e-9
    rounded = np.asarray(times["time-optimal, rounded"].y)
    assert rounded[0] == 1.0 and np.all(np.diff(rounded) < 0.0)
    assert max(times["each joint a trapezoid"].high) <= 1.0


def test_optimisers_end_in_discs_where_rrt_connect_finds_a_path() -> None:
    panels = charts.stored("optimiser_minima")
    stuck = [len(panel["collides"].x) for panel in panels]
    assert stuck[0] > 5 * stuck[1] > 0
    assert all(len(panel["free, longer"].x) > 10 for panel in panels)
    assert charts.read("optimiser_minima").count("169 of 169 seeds") == 2
