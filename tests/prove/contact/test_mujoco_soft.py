"""The soft model against `efc_force`, long: every scene and option over 1,000 steps."""

import numpy as np
import pytest

from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import Options
from tests.contact.test_mujoco_soft import OPTIONS, SCENES, compared, own_links

COMBINATIONS = [
    (scene, cone, what)
    for scene in SCENES
    for cone in ("elliptic", "pyramidal")
    for what in OPTIONS
    # A stack of boxes is costly: the options that the others do not tell more about are left out.
    if scene != "stack of 4" or what in ("default", "condim 4", "impratio 10", "diagexact")
]


@pytest.mark.parametrize(("scene", "cone", "what"), COMBINATIONS)
def test_forces_over_a_thousand_steps(scene: str, cone: str, what: str) -> None:
    options = Options(cone=cone, **OPTIONS[what])
    worst, observed = compared(SCENES[scene](options), options, 1000)
    assert worst < 1e-9
    assert observed > 5


def test_our_own_arm_over_a_thousand_steps() -> None:
    options = Options()
    q, v = own_links(options, 1000)
    theirs = mujoco_contact.links(options).run(1000)
    assert np.allclose(q, theirs[0], rtol=0.0, atol=1e-9)
    assert np.allclose(v, theirs[1], rtol=0.0, atol=1e-7)
