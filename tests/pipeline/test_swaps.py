"""Real libraries in the places of the stages, on common seeds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student

from course.oracles import pipeline as libraries
from course.perception import Camera
from course.pipeline import Scenario, Settings, Sight, Stages, errors, run, run_many, successes
from course.pipeline.drive import Q, V
from course.pipeline.eye import Eye, find

pytestmark = pytest.mark.slow


EYE = Eye(bodies=False, camera=Camera.symmetric(320, 240, math.radians(62.0)), height=1.0)
SHORT = Scenario(seconds=0.5, tilt=0.05)


def band(differences):
    """Half the width of the interval for their mean, 99 %."""
    n = differences.size
    return student.ppf(0.995, n - 1) * differences.std(ddof=1) / math.sqrt(n)


def paired(name, settings, seeds):
    """Records with a library and with the course's own, and what their final errors differ by."""
    theirs, ours = libraries.swaps(EYE)[name]
    one, other = (run_many(Scenario(), settings, seeds, stages) for stages in (theirs, ours))
    away = [np.linalg.norm(errors(records), axis=0) for records in (one, other)]
    return one, other, away[0] - away[1]


@pytest.mark.prove
@pytest.mark.parametrize(
    "name, at_most, seeds",
    [
        ("OMPL plans", 1e-3, 12),
        ("Pinocchio commands", 1e-9, 5),
        ("MuJoCo moves", 1e-4, 5),
    ],
)
def test_a_library_in_one_place_gives_the_same_success_and_error(name, at_most, seeds):
    law = "computed_torque" if "Pinocchio" in name else "pd"
    one, other, difference = paired(name, Settings(law=law), range(seeds))
    assert np.array_equal(successes(one), successes(other)) and successes(one).mean() > 0.5
    # Another path is another way to the same end, which the arm is still settling at.
    assert (
        np.abs(difference).max() < at_most
        and abs(difference.mean()) <= band(difference) + at_most / 20.0
    )


@pytest.mark.prove
@pytest.mark.parametrize(
    "name, at_most, seeds",
    [
        ("MuJoCo's rays", 1e-9, 2),
        ("Open3D perceives", 2e-3, 3),
        ("all of them", 2e-3, 2),
    ],
)
def test_a_library_that_sees_gives_the_same_within_the_band(name, at_most, seeds):
    """Open3D's fit is off by less than 1 mm and scatters by 2 mm: so little does the end differ."""
    settings = Settings(frame=0.2, law="computed_torque", drift=(0.02, 0.02))
    one, other, difference = paired(name, settings, range(seeds))
    assert successes(one).all() and successes(other).all()
    assert abs(difference.mean()) <= band(difference) + 1e-9 and np.abs(difference).max() < at_most


def test_both_find_the_part_and_neither_finds_what_is_hidden():
    scenario, rng = Scenario(), np.random.default_rng(0)
    wide = replace(EYE, camera=Camera.symmetric(640, 480, math.radians(62.0)))
    for eye in (wide, replace(wide, find=libraries.find)):
        for seconds in (0.0, 2.0, 4.0):
            target = scenario.at(seconds)
            sight = Sight(0, 0, target, np.zeros(2), rng.standard_normal(2), 1.0)
            place, covariance, frame, _ = eye(sight, scenario, Settings())
            assert frame == "base" and math.dist(place, target) < 4e-3
            assert np.linalg.eigvalsh(covariance).min() > 0.0
            missing = replace(sight, target=np.array([0.0, 3.0]))
            assert np.isinf(eye(missing, scenario, Settings())[1][0, 0])
    # The arm over the part: nothing is found, and nothing is what is said.
    blocked = replace(EYE, bodies=True, radius=0.015)
    under = Sight(0, 0, np.array([0.25, 0.0]), np.array([0.0, 2.5]), rng.standard_normal(2), 1.0)
    assert np.isinf(blocked(under, Scenario(start=(0.0, 2.5)), Settings())[1][0, 0])
    assert EYE.find is find


def test_motions_meet_mujocos_as_the_step_goes_to_zero():
    """Both are of first order; MuJoCo takes the damping implicitly, which is all that differs."""
    difference = []
    for step in (2e-3, 1e-3, 5e-4, 2.5e-4):
        settings = Settings(noise=0.0, latency=0.02, physics=step, control=step)
        ours, theirs = (run(SHORT, settings, s) for s in (Stages(), Stages(move=libraries.move)))
        difference.append(np.abs(ours.log[:, Q:V] - theirs.log[:, Q:V]).max())
    ratios = np.array(difference[:-1]) / difference[1:]
    assert np.all((1.8 < ratios) & (ratios < 2.2)) and 0.0 < difference[-1] < 1e-3
