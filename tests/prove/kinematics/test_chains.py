"""A thousand random chains and trees of 1 to 30 joints beside Pinocchio and MuJoCo."""

import numpy as np
import pytest

from tests.kinematics.arms import drawn
from tests.kinematics.compare import beside_mujoco, beside_pinocchio, too_far


@pytest.mark.parametrize("library", [beside_pinocchio, beside_mujoco])
def test_a_thousand_chains_and_trees(library) -> None:
    wrong = {}
    for seed in range(1000):
        chain = drawn(seed)
        result = too_far(library(chain, np.random.default_rng(seed)), max(1.0, chain.reach[1]))
        if result:
            wrong[seed] = result
    assert not wrong
