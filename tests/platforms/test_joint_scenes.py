"""A joint limit and a mimic joint: truths against other truths, engines against their laws."""

import math

import numpy as np
import pytest

from course import charts, kinematics
from course.charts.platforms import joints
from course.oracles.engines import engines
from course.platforms.joint_scenes import coupled, stop
from tests import optional

OTHERS = [pytest.param(name, marks=pytest.mark.optional) for name in ("Drake", "PyBullet")]


def needs(name: str):
    """Return the engine of this name, or skip the test."""
    if missing := engines()[name].missing():
        optional.skip(f"{name} was NOT tried: {missing}")
    return engines()[name]


@pytest.mark.prove
def test_the_rod_falls_as_its_energy_says_and_stops_at_the_limit() -> None:
    problem = stop(0.2, -0.9, 0.3)
    fall = next(t for t in np.linspace(0.0, 1.0, 4001) if problem.scene.truth(t)[0] <= -0.9)
    early, late = (problem.scene.truth(fall - each)[0] for each in (2e-3, 1e-3))
    # A millisecond before the impact the rod is slower by no more than the gravity of 2 ms.
    assert (late - early) / 1e-3 == pytest.approx(-problem.speed, rel=0.02)
    chain = problem.scene.chain
    assert chain is not None
    still = chain, [-0.9], [0.0]
    moving = chain, [-0.9], [-problem.speed]
    start = chain, [0.2], [0.0]
    total = [kinematics.energy(*each, gravity=problem.scene.gravity)[2] for each in (start, moving)]
    assert total[0] == pytest.approx(total[1], rel=1e-12)
    assert kinematics.energy(*still, gravity=problem.scene.gravity)[2] < total[0] - 1.0
    assert problem.scene.truth(0.9)[0] == -0.9


def test_the_coupled_truth_keeps_its_energy_and_its_ratio() -> None:
    scene = coupled(1.5, -0.3)
    chain = scene.chain
    assert chain is not None
    h, energies = 1e-4, []
    for t in (0.1, 0.35, 0.8):
        early, now, late = (scene.truth(t + k * h) for k in (-1, 0, 1))
        v = (late - early) / (2 * h)
        energies.append(kinematics.energy(chain, now, v, gravity=scene.gravity)[2])
        assert now[1] == pytest.approx(1.5 * now[0], rel=1e-14)
    start = kinematics.energy(chain, scene.truth(0.0), np.zeros(2), gravity=scene.gravity)[2]
    np.testing.assert_allclose(energies, start, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ["MuJoCo", *OTHERS])
def test_each_engine_stops_a_joint_in_its_own_way(name: str) -> None:
    engine, dt = needs(name), 2e-3
    past, back, rest = joints.at_the_stop(engine, dt, (0.0, 0.01))
    if name == "MuJoCo":
        assert past == pytest.approx(joints.overshoot_in_theory(dt), rel=0.1)
        assert 1e-4 < rest < 1e-3 and 0.05 < back < 0.25
        stiff = joints.at_the_stop(engine, dt, (0.0, 0.01), joints.stiffened)
        assert stiff[0] == pytest.approx(joints.overshoot_in_theory(dt, joints.STIFF), rel=0.15)
    elif name == "Drake":
        assert past < joints.FINE and back < 1e-6
    else:
        assert 0.0 < past <= joints.late(dt) and abs(rest) < 1e-9


def test_the_own_code_knows_no_limit_and_no_copy() -> None:
    own = engines()["own code"]
    assert joints.at_the_stop(own, 2e-3, (0.0,))[0] > 2.0
    _, q, _ = joints.motion(own, coupled(), 2e-3, 0.4)
    assert np.abs(q[1] - 2.0 * q[0]).max() > 1.0


@pytest.mark.parametrize(
    ("name", "changed", "gap", "converges"),
    [
        ("MuJoCo", None, 1e-2, False),
        pytest.param("Drake", None, 1e-5, True, marks=pytest.mark.optional),
        pytest.param("PyBullet", None, math.inf, False, marks=pytest.mark.optional),
        pytest.param("PyBullet", "gear", 1e-3, True, marks=pytest.mark.optional),
    ],
)
def test_a_mimic_joint_is_soft_exact_or_lost(name, changed, gap, converges) -> None:
    engine, scene, errors = needs(name), coupled(duration=0.4), []
    for dt in (4e-3, 1e-3):
        act = (lambda run: joints.geared(run, 2.0)) if changed else None
        time, q, _ = joints.motion(engine, scene, dt, scene.duration, act)
        gap_error = np.abs(q[1] - 2.0 * q[0]).max()
        assert gap_error > 1.0 if gap == math.inf else gap_error < gap
        errors.append(abs(q[0, -1] - scene.truth(float(time[-1]))[0]))
    # An exact copy is of first order: a quarter of the step, about a quarter of the error.
    assert (errors[1] < 0.35 * errors[0]) == converges


@pytest.mark.optional
@pytest.mark.parametrize(
    ("change", "report"),
    [
        ({"first": "elbow"}, "joint"),
        ({"ratio": 0.0}, "ratio"),
        ({"ratio": math.nan}, "ratio"),
        ({"torque": 0.0}, "torque"),
    ],
)
def test_a_gear_that_cannot_be_made_is_named(change, report: str) -> None:
    run = needs("PyBullet").build(coupled(), 1e-3, joints.settings_of(engines()["PyBullet"]))
    try:
        first, second = run.scene.joints
        gear = {"first": first, "second": second, "ratio": 2.0, "torque": 1.0}
        with pytest.raises(ValueError, match=report):
            run.couple(**gear | change)
    finally:
        run.close()


def test_the_stored_chart_shows_it() -> None:
    _, past, lost, error = charts.stored("platform_joints")
    assert np.ptp(past["MuJoCo"].y) < 0.1 * np.max(past["MuJoCo"].y)
    assert np.all(np.array(past["Drake"].y) == joints.FINE)
    assert np.all(np.diff(past["PyBullet"].y) < 0.0)
    assert np.max(np.abs(lost["PyBullet"].y)) > 4.0 > 1e-2 > np.max(np.abs(lost["MuJoCo"].y))
    assert error["PyBullet with a gear"].y[-1] == pytest.approx(error["Drake"].y[-1], rel=0.05)


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: stop(0.0, 0.5), "limit"),
        (lambda: stop(0.0, -2.0), "limit"),
        (lambda: stop(length=0.0), "length"),
        (lambda: coupled(math.nan), "ratio"),
        (lambda: coupled(2.0, math.inf), "start"),
    ],
)
def test_bad_input(call, report: str) -> None:
    with pytest.raises(ValueError, match=report):
        call()


@pytest.mark.prove
def test_a_small_chart_is_measured_as_the_stored_one() -> None:
    panels = charts.build("platform_joints", steps=(4e-3, 2e-3))
    stored = charts.stored("platform_joints")
    for panel, other in zip(panels[1::2], stored[1::2], strict=True):
        for series in panel.series:
            same = {x: y for x, y in zip(other[series.label].x, other[series.label].y, strict=True)}
            for x, y in zip(series.x, series.y, strict=True):
                assert y == pytest.approx(same[x], rel=0.3, abs=1e-4), series.label
