"""The residuals of a contact solution: each sees its own fault and no other's."""

import numpy as np
import pytest

from course.contact import Residuals, residuals, solve
from course.contact.scenes import GRAVITY, block, rod, tower

DT = 0.01


def judged(impulse: list[float], velocity: tuple[float, float] = (1.0, 0.0)) -> Residuals:
    """What is said of the impulse (normal, along, across) on 1 kg that slides, mu = 0.5."""
    return residuals(block(0.0, 0.5, velocity).problem(DT), [impulse])


WEIGHT = GRAVITY * DT


def test_coulombs_impulse_owes_nothing() -> None:
    result = judged([WEIGHT, -0.5 * WEIGHT, 0.0])
    assert result.penetration < 1e-12 and result.signorini < 1e-12
    assert result.cone < 1e-12 and result.dissipation < 1e-12
    # Friction takes out what the block loses: force times the mean of the speeds.
    slid = 1.0 - 0.5 * WEIGHT
    fallen = 0.5 * WEIGHT**2  # what gravity alone would have given it in the step
    assert result.energy == pytest.approx(0.5 * (slid**2 - 1.0) - fallen, rel=1e-12)


def test_each_fault_is_seen_in_its_own_units() -> None:
    light = judged([0.9 * WEIGHT, -0.45 * WEIGHT, 0.0])
    assert light.signorini == pytest.approx(0.1 * WEIGHT)  # it still goes down at this speed
    assert light.penetration == pytest.approx(0.1 * WEIGHT * DT)
    assert light.cone < 1e-12 and light.dissipation < 1e-12
    heavy = judged([1.1 * WEIGHT, -0.55 * WEIGHT, 0.0])
    assert heavy.signorini == pytest.approx(0.1 * WEIGHT) and heavy.penetration == 0.0
    strong = judged([WEIGHT, -0.6 * WEIGHT, 0.0])
    assert strong.cone == pytest.approx(0.1 / 0.5 * WEIGHT)
    weak = judged([WEIGHT, -0.4 * WEIGHT, 0.0])
    assert weak.dissipation == pytest.approx(0.1 * WEIGHT * (1.0 - 0.4 * WEIGHT))
    assert weak.cone == 0.0
    askew = judged([WEIGHT, -0.3 * WEIGHT, -0.4 * WEIGHT])
    assert askew.cone < 1e-12 and askew.dissipation > 0.01 * WEIGHT
    pulling = judged([-WEIGHT, 0.0, 0.0])
    assert pulling.cone == pytest.approx(WEIGHT)
    pushing = judged([WEIGHT, 0.5 * WEIGHT, 0.0])
    assert pushing.energy > 0.0 and pushing.dissipation > 0.0


def test_friction_without_a_coefficient_is_outside_the_cone() -> None:
    problem = block(0.0, 0.0, (1.0, 0.0)).problem(DT)
    assert residuals(problem, [[WEIGHT, -1e-9, 0.0]]).cone == np.inf
    assert residuals(problem, [[WEIGHT, 0.0, 0.0]]).cone == 0.0


def test_they_tell_the_models_apart() -> None:
    """The convex cone opens a gap by sliding, a swept tower sinks, a damper that may pull pulls."""
    problem = block(0.0, 0.5, (1.0, 0.0)).problem(DT)
    convex = residuals(problem, solve("convex", problem).impulses)
    assert convex.signorini > 0.1 and convex.dissipation < 1e-9 and convex.cone < 1e-12
    coulomb = residuals(problem, solve("coulomb", problem).impulses)
    assert max(coulomb.signorini, coulomb.dissipation, coulomb.cone) < 1e-12
    heavy = tower([1.0, 1000.0]).problem(DT)
    swept = residuals(heavy, solve("pgs", heavy, sweeps=20).impulses)
    assert swept.penetration > 1e-5 > residuals(heavy, solve("lcp", heavy).impulses).penetration


def test_the_energy_of_a_jam_is_lost() -> None:
    problem = rod(1.0, 3.0).problem(1e-4)
    result = residuals(problem, solve("lcp", problem).impulses)
    end = problem.jacobian[0] @ problem.free  # the speed of the end, which is stopped
    assert result.energy == pytest.approx(
        -0.5 * end @ np.linalg.solve(problem.delassus, end), rel=1e-9
    )


def test_bad_impulses_are_named() -> None:
    problem = block().problem(DT)
    with pytest.raises(ValueError, match=r"impulses\.shape"):
        residuals(problem, [[1.0, 0.0]])
    with pytest.raises(ValueError, match="impulses"):
        residuals(problem, [[np.nan, 0.0, 0.0]])
