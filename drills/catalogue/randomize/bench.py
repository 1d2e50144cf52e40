"""The model of this drill, in the child and on this side, and what is asked in one run."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt

Array = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]

ENTRY = "DomainRandomizer"
DRAWS = 400
# A right answer is outside once in 1e9 draws of a distribution: 2 exp(-2 n d^2) = 1e-9.
FAR = float(np.sqrt(np.log(2e9) / (2 * DRAWS)))
CONSTANTS = (
    "actuator_acc0",
    "body_invweight0",
    "body_subtreemass",
    "dof_M0",
    "dof_invweight0",
    "tendon_invweight0",
)
PRIMARY = ("geom_friction", "pair_friction", "body_mass", "body_inertia", "dof_damping")
ALLOWED = {*PRIMARY, *CONSTANTS, "geom_priority"}
ROUNDING = "a product and a sum: rounding, and nothing else"
CHANCE = "a right answer is farther off once in 1e9 checks"


@dataclass(frozen=True)
class Setting:
    """What is asked in this run: the model's text, the ranges, and a constant set by hand."""

    xml: str
    tuned: float
    friction: tuple[float, float]
    mass: tuple[float, float]
    damping: tuple[float, float]
    delay: tuple[int, int]
    noise: float
    idle: float
    left_out: bool = False  # these are the defaults, and the constructor is not told

    @property
    def ranges(self) -> tuple[Any, ...]:
        """The constructor's arguments after the model."""
        if self.left_out:
            return ()
        return self.friction, self.mass, self.damping, self.delay, self.noise, self.idle


def draw_setting(rng: np.random.Generator) -> Setting:
    """Draw a random scene, and ranges in which each mistake shows by itself."""
    low = float(rng.uniform(0.2, 0.5))
    high = low + float(rng.uniform(0.6, 1.0))
    # The floor is rougher than any draw, so that a draw for the other geom alone never shows.
    return Setting(
        xml=_scene(rng, floor=high + float(rng.uniform(0.1, 0.5))),
        tuned=float(rng.uniform(1.1, 1.4)),
        friction=(low, high),
        mass=(float(rng.uniform(0.4, 0.7)), float(rng.uniform(1.3, 2.0))),
        damping=(float(rng.uniform(0.05, 0.1)), float(rng.uniform(0.4, 0.6))),
        delay=(1, 4),
        noise=float(rng.uniform(0.02, 0.3)),
        idle=float(rng.uniform(-9.0, -5.0)),
    )


def _scene(rng: np.random.Generator, floor: float) -> str:
    """Return a sled, a box, a puck with a contact pair of its own, and an arm.

    Their parameters are random.
    """
    sled, box, link, hand = (f"{value:.6f}" for value in rng.uniform(0.4, 2.5, size=4))
    slide, shoulder = (f"{value:.6f}" for value in rng.uniform(0.3, 0.9, size=2))
    a, b = rng.uniform(0.2, 0.45, size=2)
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001" cone="elliptic"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1" friction="{floor:.6f} 0.005 0.0001"/>
    <site name="post" pos="0.4 2 1"/>
    <body name="sled" pos="0 0 0.05">
      <joint name="sled_x" type="slide" axis="1 0 0"/>
      <joint name="sled_z" type="slide" axis="0 0 1"/>
      <geom name="sled" type="box" size="0.1 0.1 0.05" mass="{sled}"
        friction="{slide} 0.005 0.0001"/>
    </body>
    <body name="box" pos="3 0 0.06">
      <freejoint name="box"/>
      <geom name="box" type="box" size="0.1 0.08 0.06" mass="{box}" priority="1"/>
    </body>
    <body name="puck" pos="-3 0 0.05">
      <freejoint name="puck"/>
      <geom name="puck" type="cylinder" size="0.2 0.05" density="700"/>
    </body>
    <body name="upper" pos="0 2 1.5">
      <joint name="shoulder" axis="0 1 0" damping="{shoulder}" armature="0.01"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0 0 {-a:.6f}" size="0.04" mass="{link}"/>
      <body name="fore" pos="0 0 {-a:.6f}">
        <joint name="elbow" axis="0 1 0" stiffness="1.5" springref="0.3"/>
        <geom name="fore" type="capsule" fromto="0 0 0 0 0 {-b:.6f}" size="0.03" density="500"/>
        <geom name="hand" type="sphere" pos="0 0 {-b - 0.03:.6f}" size="0.05" mass="{hand}"/>
        <site name="tip" pos="0 0 {-b:.6f}"/>
        <body name="tool" pos="0 0 {-b - 0.05:.6f}">
          <joint name="wrist" type="ball" damping="0.03"/>
          <inertial mass="0.3" pos="0 0.02 -0.05" fullinertia="0.004 0.005 0.003 0.0003 0.0002 0"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cord" stiffness="3"><site site="post"/><site site="tip"/></spatial>
  </tendon>
  <contact><pair geom1="floor" geom2="puck" friction="0.7 0.7 0.005 0.0001 0.0001"/></contact>
  <actuator>
    <motor joint="sled_x"/>
    <position joint="shoulder" kp="30" kv="2"/>
    <motor tendon="cord"/>
  </actuator>
</mujoco>
"""


class Unreadable(Exception):
    """What came back from the given module is not what it sends: the submission changed it."""


def alike(value: Any, like: Any) -> bool:
    """Return whether a value has the keys, types, shapes and dtypes of another one."""
    if type(value) is not type(like):
        return False
    if isinstance(like, dict):
        return value.keys() == like.keys() and all(alike(value[key], like[key]) for key in like)
    if isinstance(like, np.ndarray):
        return value.dtype == like.dtype and value.shape == like.shape
    return True


class Bench:
    """One model in the child with its randomizer, and the same model on this side."""

    def __init__(self, attempt: Attempt, setting: Setting) -> None:
        import mujoco

        self.attempt, self.setting, self.learner = attempt, setting, attempt.learner
        self.default = mujoco.MjModel.from_xml_string(setting.xml)
        self.default.dof_invweight0[:] *= setting.tuned
        self.model = self.learner.given_new("build", setting.xml, setting.tuned)
        self.data = self.learner.given_new("fresh", self.model)
        self.own = self.attempt.reference.given_new("build", setting.xml, setting.tuned)
        self.own_data = self.attempt.reference.given_new("fresh", self.own)
        self.before: Arrays = self.attempt.reference.given("arrays", self.own)
        single = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
        self.damped = np.isin(self.default.jnt_type, single)[self.default.dof_jntid]
        self.randomizer = self.learner.new(ENTRY, self.model, *setting.ranges)

    def generator(self, seed: int) -> Any:
        """Return a generator in the child."""
        return self.learner.given_new("generator", seed)

    def read(self, name: str, *args: Any, like: Any) -> Any:
        """Return what a function of the given module reads in the child.

        Raises:
            Unreadable: if it is not like what the same function reads here.
        """
        value = self.learner.given(name, *args)
        if not alike(value, like):
            raise Unreadable(name)
        return value

    def arrays(self) -> Arrays:
        """Return the arrays of the model as it is in the child."""
        return self.read("arrays", self.model, like=self.before)

    def state(self) -> dict[str, Any]:
        """Return the state of the data in the child."""
        like = self.attempt.reference.given("state", self.own_data)
        return self.read("state", self.data, like=like)

    def computed(self) -> Arrays:
        """Return what MuJoCo computed in the data in the child."""
        like = self.attempt.reference.given("computed", self.own_data)
        return self.read("computed", self.data, like=like)

    def randomize(self, seed: int) -> Arrays:
        """Return one draw; returns the arrays of the model after it."""
        self.learner.method(self.randomizer, "randomize", self.data, self.generator(seed))
        return self.arrays()

    def draw(self, count: int, seed: int, actions: list[Array]) -> dict[str, Any]:
        """Draw many times, each draw followed by these actions."""
        like: dict[str, Any] = {k: np.repeat(self.before[k][None], count, axis=0) for k in PRIMARY}
        like["delayed"] = []
        args = self.randomizer, self.model, self.data, self.generator(seed), count, actions
        return self.read("draw", *args, like=like)

    def here(self, arrays: Arrays) -> Any:
        """Return a model of this side with these masses, frictions and so on.

        Its derived constants are computed here.
        """
        import mujoco

        model = copy.copy(self.default)
        for name in ALLOWED - {*CONSTANTS}:
            getattr(model, name)[...] = arrays[name]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def factors(self, mass: Array) -> Array:
        """Return mass over default mass of the bodies that have one, shape (..., nbody - 1)."""
        return mass[..., 1:] / self.default.body_mass[1:]


def move_data(bench: Bench) -> None:
    """Put a state into the data that is not the reference pose."""
    model, rng = bench.default, bench.attempt.rng
    qpos = model.qpos0.copy()
    for joint in ("sled_x", "shoulder", "elbow"):
        qpos[model.joint(joint).qposadr[0]] = rng.uniform(0.2, 0.9)
    qvel, ctrl = rng.normal(size=model.nv), rng.normal(size=model.nu)
    bench.learner.given("move", bench.data, qpos, qvel, ctrl, float(rng.uniform(1.0, 9.0)))


def same_arrays(
    attempt: Attempt,
    name: str,
    before: Arrays,
    after: Arrays,
    allowed: set[str] | frozenset[str] = frozenset(),
    slip: Callable[[list[str]], str] = lambda changed: "",
    sentence: str = "Changed, and should be as before: ",
) -> bool:
    """Require that no array but the allowed ones differs in any byte; return whether it is so."""
    changed = [
        key
        for key in before
        if key not in allowed and after[key].tobytes() != before[key].tobytes()
    ]
    return attempt.require(
        name,
        not changed,
        sentence=sentence + ", ".join(changed[:5]) + ".",
        got=f"{len(changed)} arrays differ",
        expected="none",
        slip=slip(changed) if changed else "",
    )
