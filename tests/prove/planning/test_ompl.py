"""Ours beside OMPL over 300 seeds: every scene, every planner; and on the 7-R arm at a shelf."""

import numpy as np
import pytest

from course.planning import check_path, scenes, shelf
from tests.planning import test_ompl as quick

SEEDS = range(1, 301)


@pytest.mark.parametrize("method", ["rrt", "rrt_connect"])
@pytest.mark.parametrize("scene", quick.SCENES, ids=lambda scene: scene.name)
def test_samples_and_lengths_come_from_one_distribution(scene, method) -> None:
    quick.compare(scene, method, SEEDS)


@pytest.mark.parametrize("scene", quick.QUICK, ids=lambda scene: scene.name)
def test_roadmaps_are_alike(scene) -> None:
    quick.compare_roadmaps(scene, SEEDS)


def test_seven_joints_at_a_shelf() -> None:
    place, rng = shelf("open"), np.random.default_rng(1)
    for _ in range(3):
        scene = scenes.Scene("shelf", place.world, *place.query(rng), 1.0)
        quick.compare(scene, "rrt_connect", range(1, 101))
        result = quick.ours(scene, "rrt_connect", 1)
        assert not result.solved or check_path(scene.world, result.path, scene.start, scene.goal)
