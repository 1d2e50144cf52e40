"""100,000 random pairs of every two shapes against Coal, and boxes against every feature."""

import itertools

import numpy as np
import pytest

from course import contact
from course.charts.contact.geometry import random_poses
from course.oracles import coal
from course.rigid_body.quaternion import exp
from tests.contact import draws

PAIRS = list(itertools.combinations_with_replacement(draws.SHAPES, 2))
COUNT = 100_000


@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_agrees_with_coal(first, second):
    rng = np.random.default_rng()
    a, b = draws.SHAPES[first], draws.SHAPES[second]
    size = a.size + b.size
    for spread in (0.4, 1.5):
        pose_a, pose_b = (
            random_poses(rng, COUNT // 2, spread),
            random_poses(rng, COUNT // 2, spread),
        )
        result = contact.distance(a, pose_a, b, pose_b)
        other = coal.Pair(a, b).distances(pose_a, pose_b)
        error = np.abs(result.distance - other) / size
        worst = int(error.argmax())
        assert error[worst] < 1e-9, (pose_a[:, worst].tolist(), pose_b[:, worst].tolist())
        assert result.gap.max() < 1e-12 * size


@pytest.mark.parametrize("angle", [None, 1e-3, 1e-6, 1e-8, 1e-10, 1e-13, 0.0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_boxes_agree_with_every_feature(angle, scale):
    rng = np.random.default_rng()
    for _ in range(10):
        a, b = (contact.box(scale * 10.0 ** rng.uniform(-2, 0, 3)) for _ in range(2))
        pose_a, pose_b = (random_poses(rng, 500, scale) for _ in range(2))
        if angle is not None:
            pose_b[3:] = draws.turned(rng, pose_a, angle)[3:]
        result = contact.distance(a, pose_a, b, pose_b)
        expected = contact.enumerated(a, pose_a, b, pose_b)
        assert np.abs(result.distance - expected).max() < 1e-12 * scale


def test_boxes_of_any_proportions_all_but_aligned():
    """Sizes 1:10,000, turns and offsets that make edges, faces and corners all but meet."""
    angles = [0.0, 1e-12, 1e-8, 1e-4, 0.3, np.pi / 4, np.pi / 2]
    offsets = [0.0, 1e-14, 1e-9, 1e-3, 0.5, 1.0, 1.0 + 1e-12, 2.0]
    first = int(np.random.default_rng().integers(1 << 40))
    for seed in range(first, first + 600):
        rng = np.random.default_rng(seed)
        a, b = (contact.box(10.0 ** rng.uniform(-2, 2, 3)) for _ in range(2))
        turns = [exp(rng.choice(angles, (3, 50))) for _ in range(2)]
        place = rng.choice(offsets, (3, 50)) * max(a.size, b.size)
        pose_a, pose_b = np.vstack((0.0 * place, turns[0])), np.vstack((place, turns[1]))
        size = a.size + b.size + np.linalg.norm(place, axis=0)
        result = contact.distance(a, pose_a, b, pose_b)
        expected = contact.enumerated(a, pose_a, b, pose_b)
        assert (np.abs(result.distance - expected) / size).max() < 1e-13, seed
        assert (result.gap / size).max() < 1e-11, seed
