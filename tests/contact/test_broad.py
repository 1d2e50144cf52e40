"""Broad phase: the pairs of brute force on any input, and as many tests as theory says."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from course import contact
from course.charts.contact.geometry import random_poses
from course.contact import broad
from course.contact.shapes import corners_in_space
from tests.budget import examples
from tests.contact import draws


def by_definition(boxes):
    """All pairs whose intervals meet on every axis, by NumPy."""
    low, high = boxes[0][:, :, None], boxes[1][:, None, :]
    meet = ((low <= high) & (low <= high).transpose(0, 2, 1)).all(axis=0)
    return np.argwhere(np.triu(meet, 1)).T


@st.composite
def box_sets(draw):
    """Few boxes on a coarse grid, so that ties, touching and zero sizes are the rule."""
    dim, n = draw(st.integers(1, 4)), draw(st.integers(0, 12))
    low = draw(hnp.arrays(np.int64, (dim, n), elements=st.integers(-4, 4)))
    edge = draw(hnp.arrays(np.int64, (dim, n), elements=st.integers(0, 3)))
    return np.stack((low, low + edge)) * draw(st.sampled_from([1.0, 0.1, 1e-3, 1e3]))


@pytest.mark.prove
@given(box_sets(), st.randoms(use_true_random=False))
@examples(150)
def test_every_method_finds_the_same_pairs(boxes, random):
    expected = by_definition(boxes)
    pairs, tests = contact.brute_force(boxes)
    n = boxes.shape[2]
    assert tests == n * (n - 1) // 2
    assert np.array_equal(pairs, expected)
    for method in ("sweep", "grid", "brute_force"):
        assert np.array_equal(contact.overlapping_pairs(boxes, method), expected)
    longest = float((boxes[1] - boxes[0]).max(initial=0.0))
    cell = max(0.3 * longest, 0.05 * float(np.ptp(boxes) if n else 0.0)) or 1.0
    assert np.array_equal(contact.uniform_grid(boxes, cell)[0], expected)
    # The order of one scene is the start for any other of the same size.
    sweep = contact.SweepAndPrune(axis=random.randrange(boxes.shape[1]))
    for _ in range(3):
        assert np.array_equal(sweep.pairs(boxes), by_definition(boxes))
        boxes = boxes[:, :, random.sample(range(n), n)]


def test_swaps_are_the_pairs_out_of_order():
    rng = np.random.default_rng(1)
    boxes = broad.crowd("spread", 300, rng)
    sweep = contact.SweepAndPrune(axis=0)
    sweep.pairs(boxes)
    assert sweep.swaps == 0
    old = np.array(sweep.order)
    moved = boxes + rng.normal(scale=0.2, size=(3, 300))
    sweep.pairs(moved)
    keys = moved[0, 0, old]
    assert sweep.swaps == np.sum(np.triu(keys[:, None] > keys[None, :], 1)) > 0
    sweep.pairs(moved)
    assert sweep.swaps == 0


@pytest.mark.prove
def test_the_grid_tests_a_fixed_number_a_box():
    rng = np.random.default_rng(2)
    shares = [contact.uniform_grid(broad.crowd("spread", n, rng))[1] / n for n in (1000, 10_000)]
    assert shares[1] == pytest.approx(shares[0], rel=0.2)


def test_a_plane_meets_everything_and_does_not_choose_the_axis():
    boxes = broad.crowd("aligned", 50, np.random.default_rng(3))
    boxes = np.concatenate((np.array([[[-np.inf]] * 3, [[np.inf]] * 3]), boxes), axis=2)
    sweep = contact.SweepAndPrune()
    assert np.array_equal(sweep.pairs(boxes), by_definition(boxes))
    assert sweep.axis in (1, 2)
    with pytest.raises(ValueError, match="finite for a grid"):
        contact.uniform_grid(boxes)


@pytest.mark.parametrize("name", draws.SHAPES)
def test_bounds_hold_the_shape_and_touch_it_on_every_side(name):
    shape, pose = draws.SHAPES[name], random_poses(np.random.default_rng(4), 20, 1.0)
    boxes = contact.bounds(shape, pose)
    assert boxes.shape == (2, 3, 20)
    core = corners_in_space(shape, pose)
    assert np.abs(core.min(axis=1) - shape.radius - boxes[0]).max() < 1e-12
    assert np.abs(core.max(axis=1) + shape.radius - boxes[1]).max() < 1e-12


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: contact.overlapping_pairs([[[np.nan]], [[1.0]]]), r"boxes\[:, 0, 0\]"),
        (lambda: contact.overlapping_pairs([[[2.0]], [[1.0]]]), "not below"),
        (lambda: contact.overlapping_pairs(np.zeros((3, 2))), "boxes.shape"),
        (lambda: contact.overlapping_pairs(np.zeros((2, 3, 4)), "magic"), "method"),
        (lambda: contact.uniform_grid(np.zeros((2, 3, 4)), 0.0), "cell"),
        (lambda: contact.uniform_grid(np.array([[[0.0]], [[1.0]]]), 1e-12), "larger edge"),
        (lambda: contact.SweepAndPrune(axis=3).pairs(np.zeros((2, 3, 4))), "axis"),
    ],
)
def test_bad_boxes_are_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_a_kept_order_refuses_another_number_of_boxes():
    sweep = contact.SweepAndPrune()
    sweep.pairs(np.zeros((2, 3, 4)))
    with pytest.raises(ValueError, match="as in the call before"):
        sweep.pairs(np.zeros((2, 3, 5)))
