"""Chapter 6's simulations: the chapter's own runs, and what each preset says."""

import math

import numpy as np
import pytest

from course import control
from course.control import Actuator, Encoder, Gains, Joint, Probe, TouchLaw, run_joint, run_touch
from course.simulations import simulation
from course.simulations.control import joint, probe
from course.simulations.model import Experiment


def chosen(model, preset, **values):
    experiment = Experiment(model)
    experiment.choose(preset)
    if values:
        experiment.set(**values)
    return experiment


def outcome(preset, **values):
    """Overshoot, settling, error, growth and the margins of a preset of the joint."""
    return chosen(joint.MODEL, preset, **values).state["report"]


@pytest.mark.prove
@pytest.mark.parametrize("preset", joint.MODEL.presets)
def test_the_run_and_its_numbers_are_the_chapters(preset):
    experiment = chosen(joint.MODEL, preset)
    c, state = experiment.controls, experiment.state
    dt, late = 1e-3 * c["dt"], 1e-3 * c["delay"]
    limit, n = c["limit"], round(joint.SECONDS / dt)
    gains = Gains(
        c["kp"],
        c["ki"],
        c["kd"],
        u_min=-limit,
        u_max=limit,
        rate_weight=float(c["on_error"]),
        windup="conditional" if c["conditional"] else "none",
    )
    t = dt * np.arange(n)
    run = run_joint(
        Joint(joint.INERTIA, joint.DAMPING, -c["load"], c["friction"], c["static"] * c["friction"]),
        Actuator(delay=late),
        Encoder(joint.BITS[c["encoder"]]),
        gains,
        np.where(t >= joint.STEP - 1e-9, c["target"], 0.0),
        dt,
        joint.SECONDS,
        extra=np.where((t > 3.0) & (t < 3.1), c["push"], 0.0),
        blocked=(t < joint.STEP + joint.JAM) & bool(c["jam"]),
    )
    assert np.array_equal(state["run"][:, : n + 1], np.stack((run.q, run.torque)))
    first = math.ceil(joint.STEP / dt)
    observed = control.step_metrics(run.times[first:], run.q[first:], c["target"])
    assert state["report"][0] == observed.overshoot
    assert state["report"][2] == pytest.approx(observed.error, rel=1e-9, abs=1e-12)
    A, B = control.joint_system(joint.INERTIA, joint.DAMPING)
    law = gains.law(dt)
    growth = control.growth(control.loop_matrix(control.held(A, B, dt, late), law))
    assert state["report"][3] == pytest.approx(growth, rel=1e-10)


def test_a_delay_margin_is_the_delay_at_which_it_grows():
    """With whole samples of delay the frequency response has it to rounding."""
    at = {"kp": 40.0, "ki": 0.0, "kd": 2.0, "dt": 5.0}
    margin = 1e3 * outcome("Default", **at)[6]
    assert outcome("Default", **at, delay=5.0 * math.floor(margin / 5.0))[3] < 1.0
    assert outcome("Default", **at, delay=5.0 * math.ceil(margin / 5.0))[3] > 1.0


def test_the_presets_of_the_joint_show_what_they_say():
    assert abs(outcome("P at its limit")[3] - 1.0) < 1e-8 < outcome("P past its limit")[3] - 1.0
    near = outcome("PD at its limit")[4]
    assert 1.0 < near < 1.03 and outcome("PD at its limit", kd=19.5 * near + 0.1)[3] > 1.0
    jam = outcome("A jam"), outcome("A jam", conditional=True)
    assert jam[0][0] > 0.5 > 0.2 > jam[1][0]
    kick = chosen(joint.MODEL, "Derivative kick"), chosen(joint.MODEL, "Default")
    assert [float(np.max(e.state["run"][1])) for e in kick] == [50.0, 20.002]
    assert kick[0].state["report"][3] == kick[1].state["report"][3]
    assert abs(outcome("Dry friction")[2] - 1.0 / 20.0) < 1e-4
    swing = [
        np.ptp(chosen(joint.MODEL, "Hunting", static=s).state["run"][0, 3000:]) for s in (3.0, 1.0)
    ]
    assert swing[0] > 0.05 and swing[1] < 0.01
    assert outcome("Z-N, P")[3] < 1.0 < outcome("Z-N, PI")[3] and outcome("Z-N, PID")[3] < 1.0
    assert outcome("The quoted gains")[3] > 1.0


@pytest.mark.prove
def test_the_probe_is_the_chapters_and_stands_where_it_is_said_to():
    growth = {}
    for preset in probe.MODEL.presets:
        experiment = chosen(probe.MODEL, preset)
        c, state = experiment.controls, experiment.state
        n, wall, growth[preset] = int(state["samples"]), 10.0 ** c["wall"], state["growth"]
        law = TouchLaw(*probe.law_of(c))
        aim = np.minimum(probe.SPEED * probe.DT * np.arange(n) - probe.FAR, c["aim"])
        start = 0.0 if c["controller"] == probe.PRESSES else -probe.FAR
        run = run_touch(
            Probe(probe.MASS, probe.FRICTION, wall),
            law,
            aim,
            probe.DT,
            n * probe.DT,
            delay=1e-3 * c["delay"],
            start=(start, 0.0),
        )
        assert np.array_equal(state["run"][:2, : n + 1], np.stack((run.q, run.torque)))
        if growth[preset] < 0.99:
            at = float(run.torque[-1])
            assert abs(at - probe.expected(c)) < 0.2 + 0.01 * at
    unstable = {
        "A little stiffer",
        "Too much damping",
        "Force, too much gain",
        "Admittance, too light",
    }
    assert {name for name, g in growth.items() if g > 1.0} == unstable


@pytest.mark.prove
def test_a_panel_begins_with_what_is_asked_for():
    panel = simulation("joint", "Hunting")
    assert panel.controls["static"] == 3.0
    panel.close()
    for wrong in (("wrist", ""), ("probe", "Hunting")):
        with pytest.raises(ValueError, match=r"name|preset"):
            simulation(*wrong)
