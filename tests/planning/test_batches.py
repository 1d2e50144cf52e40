"""Edges in batches: the same verdict as the same points one by one, and where both are wrong."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import charts
from course.charts.planning.batches import across, collision_lengths, expected_missed, pole
from course.planning import capsule_arm, clearance, edge_free, shelf, state_free
from course.planning.batches import (
    AROUND,
    GROUP,
    LANES,
    in_batches,
    one_by_one,
    points_of,
    spheres_over,
)
from course.planning.capsules import FRAME, FROM, HAND, THICK, TO
from tests.budget import examples
from tests.planning.test_capsules import clutter

seeds = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("swell", [0.02, 0.1, 0.5])
def test_spheres_cover_their_capsule_and_are_not_much_larger(swell: float) -> None:
    rng = np.random.default_rng(0)
    for capsule in HAND:
        frame, start, end, radius = capsule
        a, b = np.array(start, dtype=float), np.array(end, dtype=float)
        spheres = spheres_over([capsule], swell)
        centres = np.array([one[1] for one in spheres])
        sizes = np.array([one[3] for one in spheres])
        assert {one[0] for one in spheres} == {frame} and sizes.max() <= (
            1 + swell
        ) * radius + 1e-12
        # Random points of the capsule's surface.
        along, out = rng.uniform(size=(400, 1)), rng.normal(size=(400, 3))
        points = a + along * (b - a) + radius * out / np.linalg.norm(out, axis=1)[:, None]
        apart = np.linalg.norm(points[:, None] - centres, axis=2)
        assert np.all((apart <= sizes + 1e-12).any(axis=1))


@pytest.mark.prove
@examples(60)
@given(seeds)
def test_batches_say_what_their_points_say(seed: int) -> None:
    """Against the scalar code in double precision, at the very points of the batches."""
    rng = np.random.default_rng(seed)
    world = in_batches(capsule_arm(clutter(rng, 4)), rng.uniform(0.02, 0.3))
    a, b = (np.asarray(rng.uniform(*world.bounds)) for _ in range(2))
    b = a + (b - a) * rng.uniform(0.01, 0.4)
    points = points_of(a, b, world.body[-1, -1])
    assert points.shape[1] % LANES == 0
    np.testing.assert_allclose(points[:, LANES - 1], b, rtol=0, atol=1e-12)
    gaps = np.array([clearance(world, q) for q in points.T])
    if abs(gaps.min()) > 1e-4:  # single precision decides nearer than that
        assert edge_free(world, a, b) == (gaps.min() > 0.0)


@pytest.mark.prove
def test_what_the_batches_call_free_is_free_and_too_large_spheres_reject_more() -> None:
    world, rng = shelf("open").world, np.random.default_rng(3)
    fine, coarse = in_batches(world, 0.02, 0.1), in_batches(world, 0.02, 0.8)
    counts = np.zeros(4, int)
    for _ in range(200):
        a = rng.uniform(*world.bounds)
        along = rng.normal(size=7)
        b = np.clip(a + 1.5 * along / np.linalg.norm(along), *world.bounds)
        if not state_free(coarse, a):
            continue
        proof, batch, single, fat = (
            edge_free(each, a, b) for each in (world, fine, one_by_one(fine), coarse)
        )
        assert proof >= batch >= fat and single == batch
        counts += (proof, batch, fat, 1)
    assert counts[0] >= counts[1] > counts[2] > 20


@pytest.mark.slow
def test_a_fine_spacing_misses_no_thin_pole() -> None:
    from course import contact

    pole = (contact.capsule(0.004, 0.25), np.array([0.55, 0.0, 0.55, 1.0, 0.0, 0.0, 0.0]))
    world = capsule_arm([pole])
    fine, rng, hits = in_batches(world, 0.02), np.random.default_rng(0), 0
    for _ in range(300):
        a, b = (np.asarray(rng.uniform(*world.bounds)) for _ in range(2))
        b = a + 2.5 * (b - a) / np.linalg.norm(b - a)
        if state_free(fine, a) and not edge_free(world, a, b):
            hits += 1
            assert not edge_free(fine, a, b)
    assert hits > 20


@pytest.mark.parametrize("lone", [False, True])
def test_a_ball_around_a_group_contains_its_spheres(lone: bool) -> None:
    """Groups are those of the capsules, or of single spheres on one frame."""
    capsules = list(reversed(spheres_over(HAND))) if lone else HAND
    world = in_batches(capsule_arm([], None, capsules))
    first, rows, counted = world.dim + 1, world.body, 0
    while first < len(rows):
        size = int(rows[first, GROUP])
        these, ball = rows[first : first + size], rows[first, AROUND : AROUND + 4]
        assert len({row[FRAME] for row in these}) == 1
        away = np.linalg.norm(these[:, FROM:TO] - ball[:3], axis=1) + these[:, THICK]
        assert away.max() == pytest.approx(ball[3], rel=1e-12)
        first, counted = first + size, counted + 1
    assert first == len(rows) and counted == len({c[0] for c in HAND} if lone else HAND)


def test_points_miss_a_collision_as_often_as_chance_says() -> None:
    """In one dimension: points with a random offset, a stretch of random length."""
    rng, ratio = np.random.default_rng(0), np.geomspace(0.3, 6.0, 9)
    for r in ratio:
        # The spacing is 1, the stretch 1 / r long.
        start = rng.uniform(0.0, 1.0, 20_000)
        missed = np.floor(start + 1.0 / r) == np.floor(start)
        law = expected_missed(r)
        assert abs(missed.mean() - law) < 4.0 * np.sqrt(law * (1 - law) / 20_000) + 1e-9


@pytest.mark.prove
def test_the_length_of_a_collision_is_that_of_its_end_states() -> None:
    """Bisection of the clearance's sign, by other code."""
    world = pole(spheres_over(HAND))
    a, b = across(world, 12, 5)
    for p, q, length in zip(a, b, collision_lengths(world, a, b), strict=True):
        if not np.isfinite(length):
            continue
        shares = np.linspace(0.0, 1.0, 1001)
        inside = [s for s in shares if clearance(world, p + s * (q - p)) <= 0.0]
        step = np.linalg.norm(q - p) / 1000.0
        assert abs(length - len(inside) * step) < 2.0 * step


def test_the_stored_chart_shows_what_the_page_says() -> None:
    free, collide, wrong, pole_ = charts.stored("batch_edges")
    name, slow = f"batches of {LANES}", "the same points, one by one"
    at = list(free[name].x).index(0.05)
    assert free[slow].y[at] > 4.0 * free[name].y[at]
    assert collide["conservative advancement"].y[at] < collide[name].y[at]
    rejected = wrong["free edges rejected, by swelling"].y
    assert rejected[-1] == max(v for v in rejected if v == v)
    points, proof = pole_[name], pole_["conservative advancement"]
    x, y = np.asarray(points.x), np.asarray(points.y)
    assert max(proof.y) == 0.0 == max(y[x < 0.9]) and max(y) > 0.5
    worst = re.search(
        r"^batches .* at most (\S+) standard errors", charts.read("batch_edges"), re.M
    )
    assert worst and float(worst[1]) < 4.0 and len(x) >= 10


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda w: in_batches(w, 0.0), "spacing"),
        (lambda w: in_batches(w, 0.1, -0.1), "swell"),
        (lambda w: one_by_one(w), "in_batches"),
    ],
)
def test_bad_input(call, report: str) -> None:
    with pytest.raises(ValueError, match=report):
        call(shelf("open").world)
    from course.planning import scenes

    with pytest.raises(ValueError, match="capsule arm"):
        in_batches(scenes.gap(0.1).world)


@pytest.mark.prove
def test_a_small_chart_is_measured_as_the_stored_one() -> None:
    panels = charts.build(
        "batch_edges",
        number=150,
        timed=8,
        spacings=(0.02, 0.2),
        swells=(0.8,),
        repeats=2,
        crossed=300,
    )
    assert [panel.title for panel in panels] == [p.title for p in charts.stored("batch_edges")]
    assert all(0.0 < value < np.inf for series in panels[0].series for value in series.y)
