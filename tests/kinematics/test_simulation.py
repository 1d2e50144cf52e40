"""Chapter 4's simulations: what they show against closed forms and the chapter's own functions."""

import math

import numpy as np
import pytest

from course import kinematics
from course.kinematics import inverse
from course.kinematics.chain import planar
from course.rigid_body.quaternion import angle_between
from course.simulations import simulation
from course.simulations.kinematics import arm, elbow
from course.simulations.model import Experiment
from course.simulations.pen import DISC, RED, decode

CHAIN = planar((arm.L1, arm.L2))
PSEUDO, DAMPED = inverse.METHODS.index("pseudo_inverse"), arm.DAMPED


def after(model, seconds, **values):
    experiment = Experiment(model, **values)
    experiment.advance(seconds)
    return experiment


def chosen(model, preset, seconds=0.0):
    experiment = Experiment(model)
    experiment.choose(preset)
    experiment.advance(seconds)
    return experiment


def number(experiment, name):
    """A number as it is printed below the picture."""
    text = experiment.picture().numbers[name].split()[0].strip("°")
    return math.inf if text == "∞" else float(text.replace("\N{MINUS SIGN}", "-"))


def polar(r, angle):
    return r * math.cos(angle), r * math.sin(angle)


def glow(experiment):
    """The radius of the red around the tip, in units of the window."""
    result = [item.style for item in decode(experiment.picture()) if item.kind == DISC]
    return max(style[0] for style in result if style[1] == RED and style[4] < 1.0)


def test_a_simulation_is_had_by_its_name():
    for name, module in (("arm", arm), ("elbow", elbow)):
        panel = simulation(name)
        assert panel.model is module.MODEL
        panel.close()
    with pytest.raises(ValueError, match="name"):
        simulation("wrist")


# --- two links ------------------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("method", range(len(inverse.METHODS)))
def test_every_step_ends_at_one_of_the_two_exact_answers(method):
    for target in ((0.5, 1.1), (-0.9, 0.4), (0.2, -1.0)):
        now = after(arm.MODEL, 60.0, method=method, target=target)
        exact = kinematics.two_link_ik((arm.L1, arm.L2), target).q
        error = np.abs(np.exp(1j * now.state["q"])[:, None] - np.exp(1j * exact)).max(axis=0)
        assert error.min() < 1e-6 < error.max()
        assert number(now, "error") == 0.0


def test_one_step_is_that_of_the_formula():
    """Damped: J^T (J J^T + lambda^2)^-1 e; the pseudo-inverse: J^-1 e, of what a step aims at."""
    for method, damping in ((DAMPED, 0.1), (DAMPED, 0.6), (PSEUDO, 0.1)):
        now = after(arm.MODEL, 0.05, method=method, damping=damping)
        q, target = arm.CONTROLS.new()["start"], arm.CONTROLS.new()["target"]
        J = kinematics.jacobian(CHAIN, q)[:2]
        e = target - kinematics.tip(CHAIN, q)[:2]
        e *= arm._AIM / np.linalg.norm(e)
        square = damping**2 if method == DAMPED else 0.0
        change = J.T @ np.linalg.solve(J @ J.T + square * np.eye(2), e)
        np.testing.assert_allclose(now.state["q"], q + change, atol=1e-13)
        assert now.state["amplification"] == pytest.approx(np.linalg.norm(change) / arm._AIM)


def test_the_numbers_are_those_of_the_chapter():
    for seconds, rows in ((0.0, 0), (0.2, 1), (1.0, 2)):
        now = after(arm.MODEL, seconds, rows=rows)
        whole = kinematics.jacobian(CHAIN, now.state["q"])
        s = np.linalg.svd(whole[:2])[1]
        assert number(now, "manipulability") == pytest.approx(
            arm.L1 * arm.L2 * abs(math.sin(now.state["q"][1])), abs=6e-5
        )
        assert number(now, "smallest value") == pytest.approx(s[1], abs=6e-5)
        length = {0: None, 1: 1.0, 2: 1e-3}[rows]
        expected = (
            s[0] / s[1]
            if length is None
            else kinematics.condition_number(
                np.vstack((whole[:2], np.zeros((3, 2)), whole[5:])), length
            )
        )
        assert number(now, "condition number") == pytest.approx(expected, abs=0.06)


def test_stretched_with_a_target_inward_no_step_moves_and_a_nudge_frees_it():
    for method in range(len(inverse.METHODS)):
        stuck = chosen(arm.MODEL, "Stretched, target inward")
        stuck.set(method=method)
        stuck.advance(3.0)
        assert np.abs(stuck.state["q"] - (0.6, 0.0)).max() < 1e-9
        assert number(stuck, "error") == pytest.approx(arm.L1 + arm.L2 - 0.6)
        assert stuck.state["steps"] == 60
    stuck.set(method=DAMPED)
    stuck.press("ArrowRight")
    stuck.advance(30.0)
    assert number(stuck, "error") < 1e-5


def test_out_of_reach_it_stretches_towards_the_target():
    beyond = chosen(arm.MODEL, "Target out of reach", 60.0)
    distance = math.hypot(1.7, 1.3) - arm.L1 - arm.L2
    assert number(beyond, "error") == pytest.approx(distance, abs=2e-2)
    inside = after(arm.MODEL, 60.0, target=polar(0.1, 2.0), start=(0.3, 2.5))
    assert number(inside, "error") == pytest.approx(arm.L1 - arm.L2 - 0.1, abs=2e-2)


def test_the_pseudo_inverse_jumps_and_damping_keeps_its_bound():
    jump = chosen(arm.MODEL, "Jump beside the singularity", 0.05)
    s = np.linalg.svd(kinematics.jacobian(CHAIN, jump.controls["start"])[:2])[1]
    assert jump.state["largest"] == pytest.approx(1.0 / s[1], rel=1e-3) and 1.0 / s[1] > 2000.0
    for damping in (0.02, 0.1, 0.5):
        calm = chosen(arm.MODEL, "Jump beside the singularity")
        calm.set(method=DAMPED, damping=damping)
        calm.advance(20.0)
        assert 0.0 < calm.state["largest"] <= 0.5 / damping * (1.0 + 1e-12)
        assert number(calm, "its bound 1/(2λ)") == pytest.approx(0.5 / damping, abs=6e-3)


def test_more_damping_is_slower():
    remaining = [
        after(arm.MODEL, 6.0, damping=damping).state["past"][1] for damping in (0.05, 0.3, 1.0)
    ]
    reached = [np.argmax(errors[errors > 0] < 1e-3) or 10**6 for errors in remaining]
    assert reached == sorted(reached) and len(set(reached)) == 3


def test_red_grows_with_one_over_the_smallest_value():
    radii = [glow(Experiment(arm.MODEL, start=(0.3, bend))) for bend in (1.5, 0.4, 0.1, 0.02)]
    assert radii == sorted(radii) and radii[-1] > 2.0 * radii[0]


def test_the_same_posture_has_another_condition_in_millimetres():
    posture = chosen(arm.MODEL, "The same arm in millimetres")
    small = number(posture, "condition number")
    posture.set(rows=1)
    assert small > 40.0 * number(posture, "condition number")


def test_pointer_and_arrow_keys_move_the_target_and_the_arm_goes_on():
    moved = after(arm.MODEL, 0.5)
    before = moved.state["q"].copy()
    moved.drag(0.5 * (0.1 + 4.8), 0.5 * (0.15 + 4.85))  # the base, in the middle of the scene
    assert np.abs(moved.controls["target"]).max() < 1e-12
    assert (moved.state["q"] == before).all() and moved.state["steps"] == 10
    for key, change in (("ArrowUp", (0, 1)), ("ArrowDown", (0, -1)), ("ArrowLeft", (-1, 0))):
        held = moved.controls["target"].copy()
        moved.press(key)
        np.testing.assert_allclose(
            moved.controls["target"] - held, 0.05 * np.array(change), 0, 1e-12
        )
    for _ in range(200):
        moved.press("ArrowLeft")
    assert moved.controls["target"][0] == -2.2


def test_levenberg_and_marquardt_never_lose_ground():
    for target in ((0.5, 1.1), (1.7, 1.3), (-0.2, 0.1)):
        lm = after(arm.MODEL, 5.0, method="levenberg marquardt", target=target, start=(0.6, 0.3))
        errors = lm.state["past"][1, : lm.state["samples"]]
        assert (np.diff(errors) <= 0.0).all() and errors[-1] < errors[0]


# --- seven joints ---------------------------------------------------------------------------------

PANDA = kinematics.panda()


@pytest.mark.slow
def test_the_elbow_moves_and_the_tip_is_off_by_what_is_printed():
    for correct in (False, True):
        now = after(elbow.MODEL, 3.0, correct=correct)
        tip, goal = kinematics.tip(PANDA, now.state["q"]), now.state["goal"]
        away = 1000.0 * np.linalg.norm(tip[:3] - goal[:3])
        assert number(now, "the tip is off by") == pytest.approx(away, abs=1e-6)
        turned = math.degrees(angle_between(tip[3:], goal[3:]))
        assert number(now, "and turned by") == pytest.approx(turned, abs=1e-6)
        assert now.state["travelled"] > 0.2 and (away < 1e-4) == correct
        assert kinematics.within(PANDA, now.state["q"])


def test_a_step_leaves_the_tip_still_to_first_order_and_no_further():
    """Off by c h^2: c is half the second derivative along the null space, by other means."""
    start = Experiment(elbow.MODEL)
    q, along = start.state["q"], start.state["along"]
    J, rate = kinematics.jacobian(PANDA, q), kinematics.jacobian_rate(PANDA, q, along)
    assert np.linalg.norm(J @ along) < 1e-14 and np.linalg.norm(along) == pytest.approx(1.0)
    np.testing.assert_allclose(kinematics.null_space(J), np.outer(along, along), atol=1e-12)
    c = 0.5 * np.linalg.norm((rate @ along)[:3])
    for h in (0.002, 0.02):
        shown = number(Experiment(elbow.MODEL, h=h), "off by one step / h²")
        assert shown == pytest.approx(c, rel=2.0 * h)


@pytest.mark.prove
def test_it_swings_to_and_fro():
    now, paths = Experiment(elbow.MODEL, correct=True), []
    for _ in range(50):
        now.advance(0.2)
        paths.append(float(now.state["swing"]))
    assert max(paths) > 0.5 and min(paths) < -0.2 and max(np.abs(paths)) <= elbow._SWING + 1e-9
    assert (np.diff(np.sign(np.diff(paths))) != 0).sum() >= 2
