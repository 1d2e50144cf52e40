"""100,000 random pairs of every two shapes against Coal, and boxes against every feature."""

import itertools

import numpy as np
import pytest

from course import contact
from course.oracles import coal
from tests.contact import draws

SHAPES = draws.shapes()
PAIRS = list(itertools.combinations_with_replacement(SHAPES, 2))
COUNT = 100_000


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_agrees_with_coal(first, second):
    rng = np.random.default_rng()
    a, b = SHAPES[first], SHAPES[second]
    size = a.size + b.size
    for spread in (0.4, 1.5):
        pose_a, pose_b = draws.poses(rng, COUNT // 2, spread), draws.poses(rng, COUNT // 2, spread)
        found = contact.distance(a, pose_a, b, pose_b)
        other = coal.Pair(a, b).distances(pose_a, pose_b)
        error = np.abs(found.distance - other) / size
        worst = int(error.argmax())
        assert error[worst] < 1e-9, (pose_a[:, worst].tolist(), pose_b[:, worst].tolist())
        assert found.gap.max() < 1e-12 * size


@pytest.mark.parametrize("angle", [None, 1e-3, 1e-6, 1e-8, 1e-10, 1e-13, 0.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_boxes_agree_with_every_feature(angle, scale):
    rng = np.random.default_rng()
    for _ in range(10):
        a, b = (contact.box(scale * 10.0 ** rng.uniform(-2, 0, 3)) for _ in range(2))
        pose_a, pose_b = (draws.poses(rng, 500, scale) for _ in range(2))
        if angle is not None:
            pose_b[3:] = draws.turned(rng, pose_a, angle)[3:]
        found = contact.distance(a, pose_a, b, pose_b)
        expected = contact.enumerated(a, pose_a, b, pose_b)
        assert np.abs(found.distance - expected).max() < 1e-12 * scale
