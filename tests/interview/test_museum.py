"""The museum: every slip is caught, its right twin is not, and what still lives is shown live."""

from __future__ import annotations

import inspect
import math
import os
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.interview import invariants, museum
from course.oracles import ompl
from tests import optional
from tests.budget import examples

EXHIBITS = pytest.mark.parametrize("one", museum.EXHIBITS, ids=lambda one: one.name)
SEEDS = st.integers(0, 2**32 - 1)


def library(name: str):
    """A library of the project; a test is skipped where it is not installed."""
    try:
        return __import__(name)
    except ModuleNotFoundError as error:
        optional.skip(f"the museum was NOT compared with {name}: {error}")


@pytest.mark.prove
@EXHIBITS
@examples(5)
@given(seed=SEEDS)
def test_the_slip_is_caught_and_the_right_one_is_not(one: museum.Exhibit, seed: int) -> None:
    assert one.evidence(False, seed) <= one.tolerance
    assert one.evidence(True, seed) > 2.0 * one.tolerance


@pytest.mark.parametrize("one", [e for e in museum.EXHIBITS if e.naive], ids=lambda one: one.name)
@examples(5)
@given(seed=SEEDS)
def test_the_naive_check_passes_both(one: museum.Exhibit, seed: int) -> None:
    assert one.naive is not None
    for wrong in (False, True):
        assert one.naive(wrong, seed) < 1e-9


@EXHIBITS
def test_an_exhibit_is_whole_and_small(one: museum.Exhibit) -> None:
    assert museum.exhibit(one.name) is one
    assert len(one.threads) == len(one.years)
    assert all(re.fullmatch(r"[\w.-]+/[\w.-]+#\d+", thread) for thread in one.threads)
    assert all(2016 <= year <= 2026 for year in one.years)
    assert one.finding.endswith(".") and one.report.endswith(".")
    assert inspect.isfunction(getattr(invariants, one.invariant))
    assert f"invariants.{one.invariant}" in inspect.getsource(one.evidence)
    assert "wrong" in inspect.signature(one.mechanism).parameters
    assert len(inspect.getsource(one.mechanism).splitlines()) < 30


def test_there_are_fourteen_and_no_other_name_is_taken() -> None:
    assert len({one.name for one in museum.EXHIBITS}) == 14
    with pytest.raises(
        ValueError, match=r"name must be one of contact forces of zero, .*, got 'none'"
    ):
        museum.exhibit("none")


@examples(5)
@given(st.floats(0.5, 2.5), st.floats(1.0, 3.0))
def test_the_order_of_updates_is_no_slip(angle: float, rate: float) -> None:
    state = np.array([0.0, 0.0, angle, rate])
    for first in (False, True):
        one, other = (museum.cart_pole_drift(state, first, False, h) for h in (2e-3, 5e-4))
        assert other == pytest.approx(one / 4.0, rel=0.05)


# --- Live -----------------------------------------------------------------------------------------

BOX = """
<mujoco><worldbody>
  <geom type="plane" size="5 5 1"/>
  <body pos="0 0 0.1"><freejoint/><geom type="box" size=".1 .1 .1" mass="2"/></body>
</worldbody></mujoco>
"""


def test_mujoco_tells_contact_forces_only_when_it_is_asked() -> None:
    mujoco = library("mujoco")
    model = mujoco.MjModel.from_xml_string(BOX)
    data = mujoco.MjData(model)
    for _ in range(1000):
        mujoco.mj_step(model, data)
    assert data.ncon and not data.cfrc_ext.any()
    assert invariants.weight_error(data.cfrc_ext[1, 5], [2.0]) == 1.0
    mujoco.mj_rnePostConstraint(model, data)
    assert invariants.weight_error(data.cfrc_ext[1, 5], [2.0]) < 1e-3


@examples(5)
@given(SEEDS)
def test_mujoco_reads_and_writes_an_angular_velocity_in_two_frames(seed: int) -> None:
    mujoco = library("mujoco")
    model = mujoco.MjModel.from_xml_string(BOX)
    data = mujoco.MjData(model)
    data.qpos[3:7], rate = museum.drawn(np.random.default_rng(seed))

    def read(rate: np.ndarray, local: int = 0) -> np.ndarray:
        data.qvel[3:], shown = rate, np.zeros(6)
        mujoco.mj_forward(model, data)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, 1, shown, local)
        return shown[:3]

    assert invariants.gap(read(rate), museum.turned(data.qpos[3:7], rate)) < 1e-9
    assert invariants.write_read_error(read, lambda _, shown: shown, rate) > 1e-6
    assert invariants.write_read_error(lambda r: read(r, 1), lambda _, shown: shown, rate) < 1e-9


# Speed over g t of a box that falls in PyBullet 3.2.7 with its defaults, at 240 steps a second.
FALLS = {1: 0.87193, 5: 0.30812, 10: 0.15462}


def test_a_free_fall_is_slowed_by_pybullets_own_law() -> None:
    for seconds, share in FALLS.items():
        speed = museum.fall(1.0, seconds, 1.0 / 240.0, True)
        assert speed / (museum.GRAVITY * seconds) == pytest.approx(share, abs=2e-5)
        assert speed < 15.2
    assert museum.fall(1.0, 20.0, 1.0 / 240.0, False) > 196.0


@pytest.mark.parametrize("mass", [0.2, 30.0])
def test_pybullet_slows_a_free_fall_live_and_without_damping_from_100_on(mass: float) -> None:
    bullet = library("pybullet")
    for damping, expected in ((None, FALLS), (0.0, {1: 1.0, 10: 1.0, 20: 0.5097})):
        client = bullet.connect(bullet.DIRECT)
        bullet.setGravity(0.0, 0.0, -museum.GRAVITY, physicsClientId=client)
        shape = bullet.createCollisionShape(
            bullet.GEOM_BOX, halfExtents=[0.1] * 3, physicsClientId=client
        )
        body = bullet.createMultiBody(mass, shape, physicsClientId=client)
        if damping is not None:
            bullet.changeDynamics(body, -1, linearDamping=damping, physicsClientId=client)
        for step in range(1, 240 * max(expected) + 1):
            bullet.stepSimulation(physicsClientId=client)
            if step % 240 == 0 and step // 240 in expected:
                speed = -bullet.getBaseVelocity(body, physicsClientId=client)[0][2]
                due = museum.GRAVITY * step / 240
                assert speed / due == pytest.approx(expected[step // 240], abs=1e-4)
        bullet.disconnect(physicsClientId=client)


def test_ompl_calls_a_path_short_of_the_goal_true() -> None:
    library("ompl")
    true, exact, short = ompl.approximate()
    assert true and not exact and short > 0.1


def test_pinocchio_has_two_accelerations_and_one_is_the_derivative() -> None:
    pinocchio = library("pinocchio")
    model = pinocchio.buildSampleModelManipulator()
    data, frame = model.createData(), model.nframes - 1
    rng = np.random.default_rng(3)
    q, v, a = rng.uniform(-1.0, 1.0, (3, model.nv))

    def moved(t: float, what) -> np.ndarray:
        speed = v + a * t
        place = pinocchio.integrate(model, q, v * t + a * t * t / 2.0)
        pinocchio.forwardKinematics(model, data, place, speed, a)
        pinocchio.updateFramePlacements(model, data)
        return what(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED).linear.copy()

    def error(what) -> float:
        return invariants.derivative_error(
            lambda t: moved(t, pinocchio.getFrameVelocity), lambda t: moved(t, what), 0.0
        )

    assert error(pinocchio.getFrameClassicalAcceleration) < 1e-6
    assert error(pinocchio.getFrameAcceleration) > 0.01


def test_gymnasium_ships_feet_that_are_not_alike() -> None:
    gymnasium, mujoco = library("gymnasium"), library("mujoco")
    assets = os.path.join(os.path.dirname(gymnasium.__file__), "envs", "mujoco", "assets")
    frictions = {}
    for file in ("walker2d.xml", "walker2d_v5.xml"):
        model = mujoco.MjModel.from_xml_path(os.path.join(assets, file))
        feet = (model.geom(name).friction[0] for name in ("foot_geom", "foot_left_geom"))
        frictions[file] = [float(friction) for friction in feet]
    assert frictions == {"walker2d.xml": [0.9, 1.9], "walker2d_v5.xml": [1.9, 1.9]}


def test_a_vector_environment_of_gymnasium_steps_across_a_reset() -> None:
    gymnasium = library("gymnasium")
    base: Any = gymnasium.Env

    class Clock(base):
        observation_space = gymnasium.spaces.Box(0.0, math.inf, (1,))
        action_space = gymnasium.spaces.Discrete(1)

        def reset(self, *, seed=None, options=None):
            self.clock = np.zeros(1, dtype=np.float32)
            return self.clock.copy(), {}

        def step(self, action):
            self.clock += 1.0
            return self.clock.copy(), 0.0, bool(self.clock[0] == 3.0), False, {}

    worlds = gymnasium.vector.SyncVectorEnv([Clock])
    clock, _ = worlds.reset()
    steps, first, ended = [], [], False
    for _ in range(7):
        after, _, end, _, _ = worlds.step(np.zeros(1, dtype=int))
        steps.append((clock[0, 0], after[0, 0]))
        first.append(ended)
        clock, ended = after.copy(), bool(end[0])
    before, after = np.array(steps).T
    assert invariants.stored_error(before, after, [3, 3]) == 2
    assert invariants.stored_error(before[~np.array(first)], after[~np.array(first)], [3, 3]) == 0
