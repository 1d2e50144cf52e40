"""Drake and PyBullet as engines: the same scheme errs alike, and what each adapter says is so."""

import functools
import os
import sys
from collections import namedtuple
from types import SimpleNamespace

import numpy as np
import pytest

from course.oracles import installs
from course.oracles.drake import Drake
from course.oracles.engines import engines
from course.oracles.pinocchio import Arm
from course.oracles.pybullet import PyBullet
from course.oracles.quiet import quiet
from course.platforms import AS_SHIPPED, FAIR, NO_CONTACTS, measures, prepared, scenes
from tests import optional

SEMI_IMPLICIT = {
    "own code": "semi_implicit_euler",
    "MuJoCo": "Euler",
    "Drake": "discrete",
    "PyBullet": "semi-implicit Euler",
}
Version = namedtuple("Version", "major minor")
OTHERS = [pytest.param(name, marks=pytest.mark.optional) for name in ("Drake", "PyBullet")]


@functools.cache
def engine(name):
    result = engines()[name]
    if missing := result.missing():
        optional.skip(f"{name} was NOT tried: {missing}")
    return result


def test_all_engines_have_a_name_a_version_and_a_scheme():
    result = engines()
    assert list(result) == list(SEMI_IMPLICIT)
    for name, one in result.items():
        assert one.name == name and SEMI_IMPLICIT[name] == one.schemes[0]
        assert bool(one.version()) == one.available() == (not one.missing())
        assert len({change.key for change in one.changes}) == len(one.changes)


@pytest.mark.parametrize("minor", [11, 12, 13])
def test_what_is_missing_is_said(minor, monkeypatch):
    for name in ("pydrake", "pybullet"):
        for module in [m for m in sys.modules if m.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(
        "course.oracles.pybullet.sys", SimpleNamespace(version_info=Version(3, minor))
    )
    assert "make platforms" in Drake().missing()
    text = PyBullet().missing()
    assert (f"no wheel for Python 3.{minor}" if minor > 11 else "make platforms") in text
    assert PyBullet().version() == Drake().version() == ""
    with pytest.raises(ImportError, match=r"no wheel|make platforms"):
        PyBullet().build(scenes.tumble(), 1e-3)
    assert installs.install("PyBullet").missing == text


# --- the same scheme and step ---------------------------------------------------------------------

SMOOTH = {"tumble": 1.0, "chain": 1.0, "arm": 0.3}


@pytest.mark.slow
@pytest.mark.optional
@pytest.mark.parametrize(("kind", "duration"), SMOOTH.items())
def test_the_references_of_drake_and_mujoco_meet_the_truth(kind, duration):
    scene = scenes.SCENES[kind](duration=duration)
    fifth = measures.position_error(engine("Drake"), scene, 1e-3, FAIR.using("runge_kutta5"))
    fourth = measures.position_error(engine("MuJoCo"), scene, 2e-4, FAIR.using("RK4"))
    assert fifth < 1e-9 and fourth < 1e-9
    adaptive = FAIR.using("runge_kutta3", accuracy=1e-6)
    assert measures.position_error(engine("Drake"), scene, 0.1, adaptive) < 1e-4


def inverse_dynamics_by_pinocchio():
    """The arm at a random state; and by how much other torques than Pinocchio's are off."""
    scene, rng = scenes.arm(), np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 7))
    assert scene.chain
    truth = Arm(scene.chain, scene.gravity).inverse_dynamics(q, v, a)

    def deviation(tau):
        return np.abs(np.array(tau) - truth).max() / np.abs(truth).max()

    return scene, q, v, a, deviation


@pytest.mark.optional
def test_inverse_dynamics_of_drake_are_those_of_pinocchio():
    scene, q, v, a, deviation = inverse_dynamics_by_pinocchio()
    run = engine("Drake").build(scene, 1e-3)
    plant, context = run.plant, run.context
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    from pydrake.multibody.tree import MultibodyForces

    forces = MultibodyForces(plant)
    plant.CalcForceElementsContribution(context, forces)
    assert deviation(plant.CalcInverseDynamics(context, a, forces)) < 1e-13


@pytest.mark.optional
def test_inverse_dynamics_of_pybullet_need_the_inertias_of_the_file():
    scene, q, v, a, deviation = inverse_dynamics_by_pinocchio()
    engine("PyBullet")
    import pybullet

    for settings, low, high in ((FAIR, 0.0, 1e-9), (FAIR.using(but=("inertia",)), 1e-3, 1.0)):
        run = engine("PyBullet").build(scene, 1e-3, settings)
        state = [x.tolist() for x in (q, v, a)]
        tau = pybullet.calculateInverseDynamics(run.bodies[0], *state, physicsClientId=run.client)
        assert low <= deviation(tau) < high
        run.close()


@pytest.mark.parametrize("name", OTHERS)
def test_torques_are_taken_as_they_are(name):
    """Gravity is held, so the arm stays."""
    from course import kinematics

    scene = scenes.arm()
    run = engine(name).build(scene, 1e-3)
    still = np.zeros(7)
    assert scene.chain
    start = run.state()
    tau = kinematics.inverse_dynamics(scene.chain, start.q, still, still, gravity=scene.gravity)
    run.set_torque(tau)
    run.run(100)
    assert np.abs(run.state().q - start.q).max() < 1e-9
    assert run.contacts() is NO_CONTACTS
    run.close()


# --- contact --------------------------------------------------------------------------------------


@pytest.mark.optional
def test_a_stiff_contact_that_has_not_settled_brakes_at_once_with_lagged_and_hops_with_sap():
    """Put down just touching and sent off: the first impacts are hundreds of weights.

    `lagged` makes friction of them, and hardly any speed is left; `sap` gives it back in a hop, so
    that the way is right. Settled before, the same block is stopped by the law with both.
    """
    one, scene, dt = engine("Drake"), scenes.brake(), 2e-3
    path = scene.truth(10.0)[0, 0]
    for approximation, short, hop in (("lagged", (0.5, 1.0), None), ("sap", (-0.02, 0.02), 0.01)):
        settings = FAIR.using(approximation=approximation, modulus=1e8)
        run = one.build(scene, dt, settings)
        run.run(30)
        if hop:
            assert run.state().q[2, 0] - scene.start.q[2, 0] > hop
        run.run(400)
        assert short[0] < 1.0 - run.state().q[0, 0] / path < short[1], approximation
        settled = 1.0 - measures.stop(one, 0.0, dt, settings).distance / path
        assert settled == pytest.approx(0.5 * scenes.GRAVITY * dt / 2.0, rel=0.3)


@pytest.mark.parametrize("name", OTHERS)
def test_reported_contacts_carry_the_weight_and_oppose_the_slip(name):
    scene = scenes.tower(2)
    run = engine(name).build(scene, 1e-3)
    assert run.contacts() is NO_CONTACTS
    run.run(300)
    result = run.contacts()
    for lower, weight in ((-1, 2.0), (0, 1.0)):
        pair = result.bodies[0] == lower
        assert set(result.bodies[1, pair]) == {lower + 1}
        assert result.normal[2, pair] == pytest.approx(1.0, abs=1e-4)
        assert result.force[2, pair].sum() == pytest.approx(weight * scenes.GRAVITY, rel=1e-2)
    assert (result.gap < 0.0).all() and result.gap.min() > -1e-3
    assert run.energy() == pytest.approx(scene.energy(run.state()), rel=1e-12)
    run.close()
    run = prepared(engine(name), scenes.brake(0.3), 1e-3)
    run.run(50)
    result = run.contacts()
    assert result.force[:, :].sum(axis=1) == pytest.approx(
        scenes.GRAVITY * np.array([-0.5 * np.cos(0.3), -0.5 * np.sin(0.3), 1.0]), rel=0.05
    )
    assert (np.sum(result.slip * result.tangential_force, axis=0) <= 0.0).all()
    run.close()


@pytest.mark.parametrize("name", OTHERS)
def test_a_guided_finger_stays_on_its_rail_and_feels_its_force(name):
    """Apart, 50 g under 3 N: half a t squared, and a step's first order."""
    scene = scenes.grasp(3.0)
    far = [scenes.replace(b, pose=(5.0 * b.pose[0], *b.pose[1:])) for b in scene.bodies]
    run = engine(name).build(scenes.replace(scene, bodies=tuple(far)), 1e-4)
    run.run(500)
    first, second = run.state().q[:3, 1:].T
    assert first[0] + 0.15 == pytest.approx(0.5 * 60.0 * 0.05**2, rel=5e-3)
    assert second == pytest.approx(-first, abs=1e-12) and not first[1:].any()
    assert run.energy() == pytest.approx(run.scene.energy(run.state()), rel=1e-9)
    run.close()


@pytest.mark.optional
def test_pybullet_puts_the_load_of_a_face_on_one_corner_and_the_part_turns_about_it():
    """Four points can share a load in any way: its sweeps end where the first one has it all."""
    scene = scenes.grasp(1.3 * 0.2 * scenes.GRAVITY)
    for name, least, largest, spins in (
        ("MuJoCo", 0.24, 0.26, False),
        ("PyBullet", 0.8, 1.0, True),
    ):
        settings = FAIR.using(numSolverIterations=500) if name == "PyBullet" else FAIR
        run = engine(name).build(scene, 1e-3, settings)
        run.run(30)
        result = run.contacts()
        for finger in (1, 2):
            load = result.normal_force[result.bodies[1] == finger]
            assert len(load) == 4 and least < load.max() / load.sum() < largest, name
        assert (abs(run.state().v[3, 0]) > 1.0) == spins
        run.close()


@pytest.mark.optional
def test_pybullet_as_shipped_drops_the_part_because_motors_hold_the_fingers_back():
    bullet, free = engine("PyBullet"), AS_SHIPPED.using(but=("motors",))
    for ratio in (1.5, 2.5, 3.0, 6.0):
        assert not measures.squeezed(bullet, ratio, 2e-3, AS_SHIPPED)[0]
        # Without motors the product of two coefficients of 0.5 is left: a threshold of 2.
        assert measures.squeezed(bullet, ratio, 2e-3, free)[0] == (ratio > 2.0)


@pytest.mark.optional
def test_pybullet_says_nothing_and_gives_back_its_client(capfd):
    one = engine("PyBullet")
    import pybullet

    runs = [one.build(scenes.arm(), 1e-3) for _ in range(2)]
    assert runs[0].client != runs[1].client
    runs[0].run(1)
    assert runs[1].state().same(one.build(scenes.arm(), 1e-3).state())
    for run in runs:
        run.close()
        run.close()
        assert not pybullet.isConnected(run.client)
    assert capfd.readouterr() == ("", "")
    with quiet() as text:
        os.write(1, b"heard")
    assert text == ["heard"]


@pytest.mark.optional
def test_pybullet_as_shipped_takes_0_04_v_1_plus_v_from_what_is_free():
    """The damping that the hunt leaves in; how engines mix friction is a claim."""
    body = scenes.box("cube", (0.1,) * 3, 1.0, (0.0,) * 3, velocity=(2.0, *(0.0,) * 5))
    free = scenes.replace(scenes.tumble(), bodies=(body,))
    run, right = engine("PyBullet").build(free, 1e-3, AS_SHIPPED), 2.0
    run.run(500)
    for _ in range(500):
        right -= 1e-3 * 0.04 * right * (1.0 + right)
    assert run.state().v[0, 0] == pytest.approx(right, abs=1e-4)
    run.close()


@pytest.mark.parametrize("name", OTHERS)
def test_settings_that_an_engine_lacks_are_refused(name):
    with pytest.raises(ValueError, match=r"settings\.options"):
        engine(name).build(scenes.drop(), 1e-3, FAIR.using(solimp=1))
    with pytest.raises(ValueError, match="dt must be"):
        engine(name).build(scenes.drop(), 0.0)


@pytest.mark.parametrize("name", OTHERS)
def test_only_a_number_of_steps_is_run(name):
    """Drake itself ends the interpreter where time goes backwards."""
    run = engine(name).build(scenes.tumble(), 1e-3)
    run.run(3)
    before = run.state()
    for steps in (-1, 2.5):
        with pytest.raises(ValueError, match=r"steps must be a non-negative integer"):
            run.run(steps)
    assert run.state().same(before) and run.state().time == before.time
    run.close()


@pytest.mark.prove
@pytest.mark.parametrize("name", ["MuJoCo", *OTHERS])
def test_what_an_install_costs_is_measured_in_a_fresh_process(name):
    engine(name)
    result = installs.install(name, processes=1)
    assert result.size and result.size > {"MuJoCo": 30.0, "Drake": 150.0, "PyBullet": 200.0}[name]
    assert result.import_time and result.load_time and result.memory and result.memory > 1.0
