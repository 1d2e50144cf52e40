"""Frames, Jacobians and dynamics beside Pinocchio and MuJoCo, and models there and back."""

import mujoco
import numpy as np
import pytest

from course import kinematics
from course.kinematics import planar
from course.oracles.mujoco import chain as mujoco_chain
from tests.kinematics.arms import drawn, named, states
from tests.kinematics.compare import beside_mujoco, beside_pinocchio, poses_apart, too_far


@pytest.mark.parametrize("library", [beside_pinocchio, beside_mujoco])
@pytest.mark.parametrize("which", [*named(), *range(40)])
def test_chains_and_trees_agree_with_the_library(which, library) -> None:
    chain = named()[which] if isinstance(which, str) else drawn(which)
    result = library(chain, np.random.default_rng(5))
    assert not too_far(result, max(1.0, chain.reach[1]))


@pytest.mark.parametrize("which", [*named(), 2, 3, 5])
def test_a_chain_goes_to_mujoco_and_comes_back(which) -> None:
    """As the same arm: the tip's link comes last, the others in MuJoCo's order."""
    chain = named()[which] if isinstance(which, str) else drawn(which)
    model = mujoco_chain.model(chain)
    back = mujoco_chain.chain(model)
    names = [model.joint(i).name for i in range(chain.n)]
    order = np.argsort(mujoco_chain.addresses(model, chain)).tolist()
    order = [i for i in order if i != chain.n - 1] + [chain.n - 1]
    assert sorted(names) == sorted(f"joint {i}" for i in range(chain.n))
    q, v, a = states(chain, np.random.default_rng(1))
    other = kinematics.frames(back, q[order])
    assert poses_apart(other, kinematics.frames(chain, q)[:, order]) < 1e-13
    np.testing.assert_allclose(kinematics.tip(back, q[order]), kinematics.tip(chain, q), atol=1e-12)
    np.testing.assert_allclose(
        kinematics.inverse_dynamics(back, q[order], v[order], a[order]),
        kinematics.inverse_dynamics(chain, q, v, a)[order],
        rtol=1e-10,
        atol=1e-10,
    )
    for name in ("slides", "lower", "upper", "armature", "damping", "mass"):
        np.testing.assert_allclose(getattr(back, name), getattr(chain, name)[order], rtol=1e-14)


MJCF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="shelf" pos="0 0 1"><body pos="0 0.1 0" quat="0.6 0.8 0 0">
  <joint name="shoulder" axis="1 2 3" pos="0.1 0 0.2" damping="0.3" armature="0.02"
    range="-2 1" limited="true"/>
  <inertial pos="0.1 0.2 0" mass="2" fullinertia="0.03 0.04 0.05 0.001 0.002 0.003"/>
  <body pos="0.4 0 0" euler="0.3 0.2 0.1"><joint name="wrist" type="slide" axis="0 -1 0"/>
    <inertial pos="0 0.1 0" mass="1" diaginertia="0.01 0.02 0.02"/>
    <body pos="0 0 0.2" euler="1 0 0"><inertial pos="0.05 0 0" mass="0.5"
      diaginertia="0.01 0.01 0.01"/><site name="tip" pos="0 0 0.1" euler="0 1 0"/></body></body>
</body></body></worldbody>{extra}</mujoco>"""

URDF = """<robot name="arm"><link name="base"/><link name="upper"><inertial><origin xyz="0.2 0 0"/>
<mass value="2"/><inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial>
</link><link name="fore"><inertial><origin xyz="0 0 0.1"/><mass value="1"/><inertia ixx="0.01"
iyy="0.01" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<origin xyz="0 0 0.3" rpy="0.1 0.2 0.3"/>
<limit lower="-1" upper="2" effort="5" velocity="3"/></joint>
<joint name="b" type="prismatic"><parent link="upper"/><child link="fore"/><axis xyz="1 0 1"/>
<origin xyz="0.4 0 0"/><limit lower="0" upper="0.5" effort="5" velocity="3"/></joint></robot>"""


@pytest.mark.parametrize("text", [MJCF.format(extra=""), URDF], ids=["MJCF", "URDF"])
def test_what_mujoco_parses_becomes_a_chain(text) -> None:
    """With slanted axes, anchors off the origin, and bodies that are fixed to others."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    model.opt.gravity[:] = kinematics.dynamics.DOWNWARDS
    chain, data = mujoco_chain.chain(model), mujoco.MjData(model)
    q, v, a = states(chain, np.random.default_rng(3))
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    mujoco.mj_inverse(model, data)
    last = np.concatenate([data.xpos[-1], data.xquat[-1]])
    if model.nsite:
        last[:3] = data.site("tip").xpos
        assert np.abs(last[:3] - kinematics.tip(chain, q)[:3]).max() < 1e-13
    else:
        assert poses_apart(last, kinematics.tip(chain, q)) < 1e-13
    np.testing.assert_allclose(
        kinematics.inverse_dynamics(chain, q, v, a), data.qfrc_inverse, rtol=1e-12, atol=1e-12
    )
    assert chain.lower[0] == model.jnt_range[0, 0] and chain.slides.tolist() == [False, True]


ROPE = '<tendon><fixed name="rope"><joint joint="wrist" coef="1"/></fixed></tendon>'
LOOP = '<equality><joint name="loop" joint1="wrist" joint2="shoulder"/></equality>'
SERVO = '<actuator><position name="servo" joint="shoulder" kp="30"/></actuator>'


def _with(old: str, new: str) -> str:
    text = MJCF.format(extra="")
    assert old in text
    return text.replace(old, new)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            _with('name="shoulder" axis="1 2 3"', 'name="shoulder" type="ball"').replace(
                'range="-2 1" limited="true"', ""
            ),
            "joint 'shoulder', a ball joint",
        ),
        (_with('type="slide" axis="0 -1 0"', 'stiffness="2"'), "joint 'wrist' with a spring"),
        (_with('type="slide" axis="0 -1 0"', 'frictionloss="2"'), "joint 'wrist' with a spring"),
        (_with('type="slide" axis="0 -1 0"', 'ref="1"'), "joint 'wrist' with a spring"),
        (
            _with('<joint name="wrist"', '<joint name="twin"/><joint name="wrist"'),
            "joint 'twin' beside another",
        ),
        (_with('<body pos="0.4 0 0"', '<body gravcomp="1" pos="0.4 0 0"'), "gravcomp"),
        (MJCF.format(extra=ROPE), "tendon 'rope'"),
        (MJCF.format(extra=LOOP), r"equality 'loop' \(joint\)"),
        (MJCF.format(extra=SERVO), r"must be an arm without actuators.*actuator 'servo'"),
        (
            MJCF.format(extra='<option density="1000"/>'),
            r"option density of the model must be .*, got 1000",
        ),
        (
            MJCF.format(extra='<option viscosity="0.9"/>'),
            r"option viscosity of the model must be .*, got 0.9",
        ),
        ("<mujoco><worldbody/></mujoco>", "without a joint"),
    ],
)
def test_what_a_chain_lacks_is_refused_by_name(text, message) -> None:
    with pytest.raises(ValueError, match=message):
        mujoco_chain.chain(mujoco.MjModel.from_xml_string(text))


def test_a_free_joint_and_a_tip_elsewhere_are_refused_by_name() -> None:
    free = (
        '<mujoco><worldbody><body><freejoint name="f"/><geom size="1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(ValueError, match="joint 'f', a free joint"):
        mujoco_chain.chain(mujoco.MjModel.from_xml_string(free))
    model = mujoco_chain.model(planar([1.0]))
    with pytest.raises(ValueError, match=r"tip must be a site of the model: tip.*, got 'hand'"):
        mujoco_chain.chain(model, "hand")
    middle = _with('<body pos="0.4 0 0"', '<site name="s"/><body pos="0.4 0 0"')
    with pytest.raises(ValueError, match=r"on the link of joint .*shoulder"):
        mujoco_chain.chain(mujoco.MjModel.from_xml_string(middle), "s")
