"""A point with a velocity: its simulation, the least time between two states, and the margin."""

import math
import re

import numpy as np
import pytest

from course import charts
from course.charts.planning import constraints
from course.charts.planning.constraints import BEGIN, END, ROOM, crossings, missed, touches
from course.planning import kinodynamic
from course.planning.kinodynamic import free_steps, kinodynamic_rrt, minimum_time, propagate

WIDE = np.array([[-1e3] * 4, [1e3] * 4])


def test_the_simulation_is_that_of_many_small_steps() -> None:
    state, control = np.array([0.2, -1.0, 0.7, 0.3]), np.array([0.5, -0.8])
    s, h = state.copy(), 1e-4
    for _ in range(10_000):
        s = s + h * np.concatenate((s[2:], control))
    assert propagate(state, control, 1.0) == pytest.approx(s, abs=2e-4)


def test_the_minimum_time_of_known_motions() -> None:
    # From rest to rest over a distance d: 2 sqrt(d / a).
    assert minimum_time([0, 0, 0, 0], [4, 1, 0, 0], 1.0) == pytest.approx(4.0)
    assert minimum_time([0, 0, 0, 0], [4, 1, 0, 0], 4.0) == pytest.approx(2.0)
    # Only braking: v / a; over a shorter distance it must come back.
    assert minimum_time([0, 0, 2, 0], [2, 0, 0, 0], 1.0) == pytest.approx(2.0)
    assert minimum_time([0, 0, 2, 0], [0, 0, 0, 0], 1.0) == pytest.approx(2.0 + 2.0 * 2.0**0.5)
    assert minimum_time(BEGIN, BEGIN) == 0.0


def test_the_minimum_time_is_the_first_at_which_a_linear_program_is_feasible() -> None:
    """Piecewise constant accelerations: feasible a little above the time, nowhere below it."""
    from scipy.optimize import linprog

    rng, n = np.random.default_rng(0), 200

    def feasible(distance, v, w, total):
        h = total / n
        remaining = total - h * (np.arange(n) + 0.5)
        rows = np.stack((np.full(n, h), h * remaining))
        values = [w - v, distance - v * total]
        return linprog(np.zeros(n), A_eq=rows, b_eq=values, bounds=(-1.0, 1.0)).status == 0

    for _ in range(15):
        distance, v, w = rng.uniform(-3, 3), *rng.uniform(-2, 2, 2)
        least = minimum_time([0.0, 0.0, v, 0.0], [distance, 0.0, w, 0.0])
        assert feasible(distance, v, w, 1.01 * least + 1e-3)
        assert not any(feasible(distance, v, w, s * least) for s in np.linspace(0.05, 0.99, 20))


def test_no_trajectory_beats_the_bound_and_each_ends_where_it_says() -> None:
    discs = constraints.posts()
    for seed in range(10):
        for metric in kinodynamic.METRICS:
            motion = kinodynamic_rrt(discs, ROOM, BEGIN, END, metric=metric, rng=seed)
            assert motion.solved
            assert motion.seconds >= minimum_time(motion.states[:, 0], motion.states[:, -1])
            assert np.linalg.norm(motion.states[:, -1] - END) <= 0.5
            assert np.abs(motion.controls).max() <= 1.0
            for k, t in enumerate(motion.durations):
                end = propagate(motion.states[:, k], motion.controls[:, k], t)
                assert end == pytest.approx(motion.states[:, k + 1], abs=1e-9)


def test_with_the_margin_nothing_is_hit_and_without_it_posts_are() -> None:
    discs, hits = constraints.posts(), {True: 0, False: 0}
    for seed in range(12):
        for proved in hits:
            motion = kinodynamic_rrt(discs, ROOM, BEGIN, END, dt=0.2, proved=proved, rng=seed)
            hits[proved] += motion.solved and touches(discs, motion)
    assert hits[True] == 0 < hits[False]


def test_the_margin_covers_a_disc_that_touches_between_the_points_and_little_more() -> None:
    """A disc on the parabola's middle, of any radius: blocked; moved away by the margin: free."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        state = np.concatenate(([0.0, 0.0], rng.uniform(-2, 2, 2)))
        control, dt = rng.uniform(-1, 1, 2), rng.uniform(0.05, 1.0)
        middle = propagate(state, control, rng.random() * dt)[:2]
        radius = 10.0 ** rng.uniform(-6, -1)
        assert free_steps([[*middle, radius]], WIDE, state, control, dt, 1) == 0
        # Every disc whose distance from both ends exceeds the margin leaves the step free.
        chord = np.linalg.norm(propagate(state, control, dt)[:2])
        margin = 0.5 * chord + 0.125 * np.linalg.norm(control) * dt * dt
        assert kinodynamic.step_margin(state, control, dt) == pytest.approx(margin)
        angle = rng.uniform(0.0, 2.0 * math.pi)
        far = chord + margin + radius + 1e-9
        away = far * np.array([math.cos(angle), math.sin(angle)])
        assert free_steps([[*away, radius]], WIDE, state, control, dt, 1) == 1


def test_points_miss_as_many_crossings_as_geometry_says() -> None:
    for spacing in (0.5, 1.0, 3.0):
        points, margin = crossings(spacing, 1500, 1)
        share = missed(spacing)
        assert abs(points - share) < 4.0 * math.sqrt(share * (1.0 - share) / 1500) + 1e-3
        assert margin == 0.0
    assert missed(3.0) == pytest.approx(1.0 - math.pi / 12.0, abs=1e-4)


def test_more_controls_for_each_sample_need_fewer_samples() -> None:
    discs = constraints.posts()
    drawn = {
        tries: [
            kinodynamic_rrt(discs, ROOM, BEGIN, END, tries=tries, rng=seed).samples
            for seed in range(12)
        ]
        for tries in (1, kinodynamic.TRIES)
    }
    assert np.median(drawn[1]) > 1.5 * np.median(drawn[kinodynamic.TRIES])


def test_bad_input() -> None:
    with pytest.raises(ValueError, match="metric must be"):
        kinodynamic_rrt(np.zeros((0, 3)), ROOM, BEGIN, END, metric="Dubins")
    with pytest.raises(ValueError, match="dt must be"):
        kinodynamic_rrt(np.zeros((0, 3)), ROOM, BEGIN, END, dt=0.0)
    blocked = kinodynamic_rrt([[9.0, 9.0, 1.0]], ROOM, BEGIN, END)
    assert blocked.status == "goal in collision" and not blocked.solved


def test_the_chart_shows_both_sides_of_the_margin() -> None:
    solved, ratio, crossing, hits = charts.stored("kinodynamic_bounds")
    text = charts.read("kinodynamic_bounds")
    # With one control and the same rules ours and OMPL's take as many samples: one algorithm.
    (p,) = re.findall(r"^samples of one control .*, p (\S+)$", text, re.M)
    assert float(p) > 0.01
    others = dict(re.findall(r"^OMPL, (up to \d+ steps): .* samples and (\S+) ms", text, re.M))
    assert len(others) == len(constraints.LONGEST)
    (best,) = re.findall(r"^drawn of OMPL's is (.+) of a control", text, re.M)
    assert float(others[best]) == min(map(float, others.values()))
    assert solved["minimum time, proved"].y[-1] > 0.95
    for series in ratio.series:
        assert min(series.x) >= 1.0
    assert max(crossing["with the margin"].y) == 0.0 == max(hits["with the margin"].y)
    assert max(hits["points alone"].y) > 0.2
