"""The scenes and the engines that are always there: the course's own code and MuJoCo."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from course import kinematics
from course.oracles.engines import engines
from course.oracles.mujoco import chain as reader
from course.oracles.mujoco.kit import library
from course.platforms import AS_SHIPPED, FAIR, SCENES, ContactReport, Settings, State
from course.platforms.bodies import step_of
from course.platforms.contract import prepared, reported, slip_of
from course.platforms.scenes import GRAVITY, HALF, arm, brake, chain, field, grasp, slope, tower
from course.rigid_body import quaternion
from course.rigid_body.integrators import retract

OWN, MUJOCO = (engines()[name] for name in ("own code", "MuJoCo"))
BOTH = pytest.mark.parametrize("engine", [OWN, MUJOCO], ids=["own", "mujoco"])


def ran(engine, scene, dt, steps=None, settings=FAIR):
    run = prepared(engine, scene, dt, settings)
    run.run(round(scene.duration / dt) if steps is None else steps)
    return run


# --- scenes ---------------------------------------------------------------------------------------


def test_the_urdf_text_is_the_arm_of_chapter_4() -> None:
    scene = arm(damping=0.5)
    result = reader.chain(library().MjModel.from_xml_string(scene.urdf))
    for name in ("parent", "placement", "mass", "centre", "inertia", "slides", "damping"):
        ours, theirs = getattr(scene.chain, name), getattr(result, name)
        np.testing.assert_allclose(theirs, ours, atol=1e-14, err_msg=name)


def test_pinocchio_reads_the_same_arm_from_the_text() -> None:
    reason = "Pinocchio did NOT read the arm: pip install 'pin>=4.0'"
    pinocchio = pytest.importorskip("pinocchio", reason=reason)
    rng, scene = np.random.default_rng(0), arm()
    model = pinocchio.buildModelFromXML(scene.urdf)
    q, v, a = rng.normal(size=(3, 7))
    # A continuous joint is (cos, sin) there.
    turned = np.column_stack((np.cos(q), np.sin(q))).ravel()
    theirs = pinocchio.rnea(model, model.createData(), turned, v, a)
    assert scene.chain
    ours = kinematics.inverse_dynamics(scene.chain, q, v, a, gravity=scene.gravity)
    np.testing.assert_allclose(ours, theirs, atol=1e-11)


def test_limits_stand_in_the_text() -> None:
    from course.platforms.scenes import urdf

    robot = kinematics.panda()
    result = reader.chain(library().MjModel.from_xml_string(urdf(robot)))
    np.testing.assert_allclose((result.lower, result.upper), (robot.lower, robot.upper))


@pytest.mark.parametrize(("scene", "dt"), [(chain(6), 2.5e-4), (arm(), 2.5e-4)])
def test_the_truth_of_joints_is_where_runge_kutta_in_mujoco_goes(scene, dt) -> None:
    rough, fine = (
        ran(MUJOCO, scene, step, settings=FAIR.using("RK4")).state() for step in (2 * dt, dt)
    )
    # Of fourth order: a fifteenth of the difference is what the finer run still errs.
    best = fine.q + (fine.q - rough.q) / 15.0
    assert np.max(np.abs(best - scene.truth(scene.duration))) < 1e-10


def test_energy_in_the_closed_forms() -> None:
    block = brake(0.3, 2.0)
    assert block.energy(block.start) == pytest.approx(0.5 * 4.0 + GRAVITY * 0.02)
    part = grasp(3.0)  # fingers at 3 cm, pressed inwards: each has 0.09 J to lose
    assert part.energy(part.start) == pytest.approx(0.18)


def test_degrees_of_freedom_and_units() -> None:
    result = {name: (make().dof, make().unit) for name, make in SCENES.items()}
    assert result == {
        "tumble": (6, "rad"),
        "chain": (6, "rad"),
        "arm": (7, "rad"),
        "drop": (6, "m"),
        "rest": (6, "m"),
        "slide": (6, "m"),
        "brake": (6, "m"),
        "tower": (30, "m"),
        "grasp": (8, "m"),
        "field": (384, "m"),
    }


def test_what_is_no_scene_is_refused() -> None:
    with pytest.raises(ValueError, match=r"n must be an integer from 1 to 64.*, got 65"):
        chain(65)
    with pytest.raises(ValueError, match=r"angle must be .*, got 2"):
        slope(2.0)
    with pytest.raises(ValueError, match=r"squeeze must be .*, got 0"):
        grasp(0.0)


# --- the same scheme, the same error --------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("scheme", ["rk4", "implicit_midpoint"])
def test_other_schemes_of_chapter_1(scheme: str) -> None:
    scene = SCENES["tumble"]()
    errors = [
        scene.error(ran(OWN, scene, dt, settings=FAIR.using(scheme)).state()) for dt in (2e-2, 1e-2)
    ]
    order = {"rk4": 4, "implicit_midpoint": 2}[scheme]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.2)


@BOTH
def test_a_thrown_spinning_body_keeps_to_the_conventions(engine) -> None:
    """Spin in the body's frame, velocity in the world, about a body that is turned: by hand."""
    half = math.sqrt(0.5)  # a quarter turn about x: the body's z axis points along -y
    body = replace(
        SCENES["tumble"]().bodies[0],
        moments=(1.0, 1.0, 1.5),
        pose=(0.0, 0.0, 0.0, half, half, 0.0, 0.0),
        velocity=(1.0, 2.0, 3.0, 0.0, 0.0, 0.5),
    )
    scene = replace(SCENES["tumble"](), bodies=(body,), gravity=(0.0, 0.0, -GRAVITY))
    state = ran(engine, scene, 1e-3, 1000).state()
    np.testing.assert_allclose(state.q[:3, 0], [1, 2, 3 - 0.5 * GRAVITY], atol=6e-3)
    np.testing.assert_allclose(state.v[:, 0], [1, 2, 3 - GRAVITY, 0, 0, 0.5], atol=1e-9)
    turn = np.array([math.cos(0.25), 0.0, -math.sin(0.25), 0.0])  # half a radian about -y
    w, x, y, z = turn
    expected = np.array(
        [w * half - x * half, w * half + x * half, y * half + z * half, z * half - y * half]
    )
    result = state.q[3:, 0] * np.sign(state.q[3, 0] * expected[0])
    np.testing.assert_allclose(result, expected, atol=1e-9)


def test_a_box_that_touches_nothing_tumbles_like_a_body_without_a_shape() -> None:
    free = SCENES["tumble"]()
    boxed = replace(free, bodies=(replace(free.bodies[0], half=(0.1, 0.2, 0.3)),))
    one, other = (ran(OWN, scene, 1e-3, 300).state() for scene in (free, boxed))
    np.testing.assert_allclose(other.q, one.q, atol=1e-12)
    assert free.error(other, 0.3) < 1e-3


# --- contact --------------------------------------------------------------------------------------


@BOTH
def test_contacts_of_a_tower_carry_what_stands_above(engine) -> None:
    run = ran(engine, tower(3), 1e-3, 40 if engine is OWN else 300)
    report = run.contacts()
    below = {(-1, 0): 3, (0, 1): 2, (1, 2): 1}
    assert set(map(tuple, report.bodies.T)) == set(below)
    for pair, cubes in below.items():
        mine = report.only(np.all(report.bodies.T == pair, axis=1))
        assert np.sum(mine.normal_force) == pytest.approx(cubes * GRAVITY, rel=1e-3)
        up = np.tile([[0.0], [0.0], [1.0]], mine.gap.size)
        np.testing.assert_allclose(mine.normal, up, atol=1e-9)
        height = 2 * HALF * (3 - cubes)
        np.testing.assert_allclose(mine.point[2], height, atol=1e-4)
    assert np.all(report.gap < 1e-9)
    np.testing.assert_allclose(report.tangential_force, 0.0, atol=1e-6)


@pytest.mark.prove
@BOTH
def test_friction_on_a_slope_holds_the_weight_and_brakes_by_mu(engine) -> None:
    held = ran(engine, slope(0.2), 1e-3, 200).contacts()
    down = GRAVITY * math.sin(0.2)
    np.testing.assert_allclose(np.sum(held.tangential_force, axis=1), [-down, 0, 0], atol=1e-4)
    run = ran(engine, brake(0.5), 1e-3, 100)
    while not run.contacts().gap.size:  # MuJoCo's block hops: what slides also leaves
        run.run(1)
    sliding, speed = run.contacts(), np.linalg.norm(run.state().v[:3, 0])
    slow, push = np.sum(sliding.slip, axis=1), np.sum(sliding.tangential_force, axis=1)
    assert np.linalg.norm(push) == pytest.approx(0.5 * np.sum(sliding.normal_force), rel=1e-4)
    assert push @ slow == pytest.approx(-np.linalg.norm(push) * np.linalg.norm(slow), rel=2e-3)
    assert np.linalg.norm(slow) / sliding.gap.size == pytest.approx(speed, rel=5e-2)
    assert speed == pytest.approx(2.0 - 0.05 * GRAVITY, rel=0.02)


@pytest.mark.slow
@BOTH
def test_fingers_hold_the_part_and_stay_on_their_guides(engine) -> None:
    run = ran(engine, grasp(3.0), 1e-3, 50 if engine is OWN else 300)
    report, state = run.contacts(), run.state()
    assert np.sum(report.normal_force) == pytest.approx(6.0, rel=1e-2)
    part = np.where(report.bodies[1] == 0, 1.0, -1.0)  # whether the force acts on the part
    lift = np.sum(part * report.force[2])
    assert lift == pytest.approx(0.2 * GRAVITY, rel=1e-2)
    np.testing.assert_allclose(state.q[1:3, 1:], 0.0, atol=1e-15)
    slips = ran(engine, replace(grasp(1.5), duration=0.1), 1e-3)
    fall = 0.5 * (GRAVITY - 2 * 0.5 * 1.5 / 0.2) * 0.1**2
    # Nobody says how the force is shared among the corners: Newton's answer turns the part, and a
    # tenth of the friction goes into that.
    assert fall < -slips.state().q[2, 0] < (1.15 if engine is OWN else 1.02) * fall


def test_cubes_of_a_field_don_t_know_of_each_other() -> None:
    more, one = ran(OWN, field(4), 1e-3, 20), ran(OWN, field(1), 1e-3, 20)
    for k in range(4):
        np.testing.assert_allclose(more.state().q[2:, k], one.state().q[2:, 0], atol=1e-12)


def test_slip_by_hand() -> None:
    """A disc that rolls doesn't slip; one that spins in place slips by omega r."""
    q = np.array([[0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0]]).T
    point, normal, pair = np.zeros((3, 1)), np.array([[0.0], [0.0], [1.0]]), np.array([[-1], [0]])
    rolls = np.array([[1.0, 0.0, 0.2, 0.0, 2.0, 0.0]]).T
    np.testing.assert_allclose(slip_of(q, rolls, pair, point, normal), 0.0, atol=1e-15)
    spins = np.array([[0.0, 0.0, 0.0, 0.0, 2.0, 0.0]]).T
    result = slip_of(q, spins, pair, point, normal)[:, 0]
    np.testing.assert_allclose(result, [-1.0, 0.0, 0.0], atol=1e-15)


def test_rows_of_contacts_are_the_speed_of_the_point_on_the_body() -> None:
    """For bodies in any posture: by moving each a little and watching its point."""
    rng, scene = np.random.default_rng(1), tower(2)
    q = np.vstack([rng.normal(size=(3, 2)), quaternion.normalise(rng.normal(size=(4, 2)))])
    v, point = rng.normal(size=(6, 2)), rng.normal(size=(3, 1))
    normal = rng.normal(size=(3, 1))
    normal /= np.linalg.norm(normal)
    nothing = np.zeros((3, 1))
    report = ContactReport(np.array([[0], [1]]), point, normal, np.zeros(1), nothing, nothing)
    step = step_of(scene, State(0.0, q, v), v, report, 1e-3)
    result = step.frame[:, :, 0].T @ (step.problem.jacobian[0] @ step.problem.velocity)
    small, moved = 1e-7, []
    for sign in (1.0, -1.0):
        other = retract(q, sign * small * v)
        local = quaternion.rotate(quaternion.conjugate(q[3:]), point - q[:3])
        moved.append(other[:3] + quaternion.rotate(other[3:], local))
    speed = (moved[0] - moved[1]) / (2.0 * small)
    np.testing.assert_allclose(result, speed[:, 1] - speed[:, 0], atol=1e-7)
    slip = slip_of(q, v, report.bodies, point, normal)[:, 0]
    np.testing.assert_allclose(slip, result - normal[:, 0] * (result @ normal[:, 0]), atol=1e-12)


def test_contacts_are_the_same_whichever_body_is_told_first() -> None:
    up, one = np.tile([[0.0], [0.0], [1.0]], 2) * [1, -1], np.ones((3, 2))
    report = np.array([[0, 1], [1, 0]]), one, up, np.zeros(2), up + [[2.0, -2.0]]
    result = reported(tower(2).start, *report)
    assert result.bodies.tolist() == [[0, 0], [1, 1]] and result.normal_force.tolist() == [3.0, 3.0]
    for each in (result.normal, result.force, result.slip):
        np.testing.assert_array_equal(each[:, 0], each[:, 1])


def test_forces_are_told_by_their_parts() -> None:
    one = np.ones((3, 1))
    report = ContactReport(
        np.array([[-1], [0]]),
        one,
        np.array([[0.0], [0.0], [1.0]]),
        np.zeros(1),
        np.array([[3.0], [4.0], [-2.0]]),
        0.0 * one,
    )
    assert report.normal_force == [-2.0]
    np.testing.assert_allclose(report.tangential_force[:, 0], [3.0, 4.0, 0.0])
    assert report.only(np.array([False])).gap.size == 0


# --- settings -------------------------------------------------------------------------------------


def test_a_change_can_be_taken_back_alone() -> None:
    assert FAIR.applies("cone") and not AS_SHIPPED.applies("cone")
    assert not FAIR.using(but=("cone",)).applies("cone")
    assert AS_SHIPPED.using(but=("cone",)).applies("cone")

    def model(settings: Settings) -> Any:
        return MUJOCO.build(brake(), 1e-3, settings).model  # type: ignore[attr-defined]

    shipped = model(AS_SHIPPED)
    default = library().MjModel.from_xml_string("<mujoco/>").opt
    for name in ("integrator", "cone", "impratio", "disableflags", "iterations", "solver"):
        assert getattr(shipped.opt, name) == getattr(default, name), name
    fair = model(FAIR)
    assert (fair.opt.cone, fair.opt.impratio) == (1, 10.0)
    assert np.all(fair.geom_solref[:, 0] == 0.005)
    again = model(FAIR.using(but=tuple(change.key for change in MUJOCO.changes)))
    np.testing.assert_array_equal(again.geom_solref, shipped.geom_solref)
    assert again.opt.cone == 0 and again.opt.disableflags == 0


def test_every_change_says_why_and_where() -> None:
    for engine in engines().values():
        keys = [change.key for change in engine.changes]
        assert len(set(keys)) == len(keys)
        for change in engine.changes:
            assert change.shipped != change.fair
            assert len(change.reason) > 10
            assert any(f"20{year}" in change.source for year in range(10, 27)), change.source
            assert change.kind in ("bodies", "joints", "all")


@BOTH
def test_unknown_names_are_refused(engine) -> None:
    scene = SCENES["tumble"]()
    with pytest.raises(ValueError, match=r"settings\.scheme must be .*, got 'rk5'"):
        engine.build(scene, 1e-3, FAIR.using("rk5"))
    with pytest.raises(ValueError, match=r"settings\.options must be .*, got 'colour'"):
        engine.build(scene, 1e-3, FAIR.using(colour=1))
    with pytest.raises(ValueError, match=r"settings\.but must be .*, got 'cones'"):
        engine.build(scene, 1e-3, FAIR.using(but=("cones",)))
    with pytest.raises(ValueError, match=r"dt must be .*, got 0"):
        engine.build(scene, 0.0)
    with pytest.raises(ValueError, match=r"scene must be a scene of joints.*, got 'tumble'"):
        engine.build(scene, 1e-3).set_torque(np.zeros(6))
    with pytest.raises(ValueError, match=r"settings\.name must be .*, got 'best'"):
        Settings("best")


@pytest.mark.parametrize("name", ["tumble", "brake"])
@BOTH
def test_only_a_number_of_steps_is_run(engine, name: str) -> None:
    run = engine.build(SCENES[name](), 1e-3)
    run.run(3)
    before = run.state()
    for steps in (-1, 2.5, 1.0, True, None, math.nan):
        with pytest.raises(ValueError, match=r"steps must be a non-negative integer"):
            run.run(steps)  # type: ignore[arg-type]
    run.run(0)
    assert run.state().same(before) and run.state().time == before.time
    run.run(np.int64(2))
    assert run.state().time == pytest.approx(5e-3)


def test_own_code_says_what_it_cannot_do() -> None:
    with pytest.raises(ValueError, match=r"settings\.scheme must be .*, got 'rk4'"):
        OWN.build(brake(), 1e-3, FAIR.using("rk4"))
    two = replace(SCENES["tumble"](), bodies=SCENES["tumble"]().bodies * 2)
    with pytest.raises(ValueError, match="one body, where none touches"):
        OWN.build(two, 1e-3)


@BOTH
def test_torques_act_and_energy_is_what_they_put_in(engine) -> None:
    scene = chain(2)
    run = engine.build(scene, 1e-4)
    push = np.array([0.3, -0.1])
    before = run.energy()
    run.set_torque(push)
    run.run(2000)
    state = run.state()
    assert state.time == pytest.approx(0.2)
    work = push @ (state.q - scene.start.q)  # of constant torques
    assert run.energy() - before == pytest.approx(work, abs=2e-4)
    assert run.energy() == pytest.approx(scene.energy(state), abs=1e-12)


@pytest.mark.parametrize("dead", [math.nan, math.inf])
def test_what_is_not_finite_is_infinitely_wrong(dead: float) -> None:
    scene = SCENES["drop"]()
    state = scene.start
    state.q[2, 0] = dead
    assert scene.error(state) == math.inf


def test_states_are_compared_by_bits() -> None:
    q = np.zeros((7, 1))
    one = State(0.0, q, np.zeros((6, 1)))
    assert one.same(State(1.0, q.copy(), np.zeros((6, 1))))
    assert not one.same(State(0.0, q - 0.0 * 1.0 + 5e-324, np.zeros((6, 1))))
