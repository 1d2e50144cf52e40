"""MuJoCo asked about a randomised model by ways that share nothing with the randomiser.

- `recompiled` builds the model anew: the masses of the *shapes* are changed in the specification,
  and MuJoCo's compiler computes inertias and every constant from them.
- `sliding_friction` measures the friction of a contact from motion, by momentum.
- `swing_period` measures a pendulum; the closed form of its period needs mass and inertia.
- `actuator_delay` runs MuJoCo's own delay of an actuator.
"""

import copy
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid
from course.oracles.mujoco.kit import library

# What mj_setConst computes from masses and inertias; no other array of a model depends on them,
# but for the damping of a position actuator that was given as a ratio (the compiler resolves it).
DERIVED = (
    "actuator_acc0",
    "body_invweight0",
    "body_subtreemass",
    "dof_M0",
    "dof_invweight0",
    "tendon_invweight0",
)

# One of each thing that a randomiser meets: joints with damping and without, a free and a ball
# joint, bodies given by shapes and by numbers, several shapes in one body, an explicit contact
# pair, a geom with priority, actuators, a spring, a tendon. The sled can only slide and rise, so
# that its motion is that of a point with friction. The reference pose of the springs is not qpos0.
SCENE = """
<mujoco model="randomise">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 0.1" friction="0.9 0.005 0.0001"/>
    <site name="post" pos="0.4 2 1"/>
    <body name="sled" pos="0 0 0.05">
      <joint name="sled_x" type="slide" axis="1 0 0"/>
      <joint name="sled_z" type="slide" axis="0 0 1"/>
      <geom name="sled" type="box" size="0.1 0.1 0.05" mass="1.5" friction="0.5 0.005 0.0001"/>
    </body>
    <body name="box" pos="3 0 0.06">
      <freejoint/>
      <geom name="box" type="box" size="0.1 0.08 0.06" mass="0.8" priority="1"/>
    </body>
    <body name="puck" pos="-3 0 0.05">
      <freejoint/>
      <geom name="puck" type="cylinder" size="0.1 0.05" density="700"/>
    </body>
    <body name="upper" pos="0 2 1.5">
      <joint name="shoulder" axis="0 1 0" damping="0.2" armature="0.01"/>
      <geom name="upper" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" density="500"/>
      <body name="fore" pos="0 0 -0.4">
        <joint name="elbow" axis="0 1 0" stiffness="1.5" springref="0.3"/>
        <geom name="fore" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" density="500"/>
        <geom name="hand" type="sphere" pos="0 0 -0.33" size="0.05" mass="0.4"/>
        <site name="tip" pos="0 0 -0.3"/>
        <body name="tool" pos="0 0 -0.35">
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
    <motor name="push" joint="sled_x"/>
    <position name="lift" joint="shoulder" kp="30" kv="2"/>
    <motor name="pull" tendon="cord"/>
  </actuator>
</mujoco>
"""


def arrays(model: Any) -> dict[str, NDArray[Any]]:
    """Return copies of all arrays of a model, by name."""
    fields = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    return {name: v.copy() for name, v in fields.items() if isinstance(v, np.ndarray)}


def recompiled(
    xml: str, factors: ArrayLike, friction: float | None = None, damping: ArrayLike | None = None
) -> Any:
    """Return the model as MuJoCo's compiler builds it with other values.

    Args:
        xml: MJCF text.
        factors: on the mass of each body's shapes, or on its mass and inertia where those are
            given as numbers, shape (nbody,) [-].
        friction: sliding coefficient of all geoms and contact pairs [-]; None leaves them.
        damping: of each joint, shape (njnt,) [N m s/rad or N s/m]; None leaves them.

    Returns:
        `mujoco.MjModel`.
    """
    mujoco = library()
    spec = mujoco.MjSpec.from_string(xml)
    spec.compile()  # numbers the elements
    factors = np.asarray(factors, dtype=float)
    for body in spec.bodies:
        factor = float(factors[body.id])
        # A body has its mass from an inertial element or from its shapes, and both are scaled.
        if body.explicitinertial:
            body.mass *= factor
            body.inertia = factor * body.inertia
            body.fullinertia = factor * body.fullinertia
        for geom in body.geoms:  # one of the two is in force, the other is not a number
            geom.mass *= factor
            geom.density *= factor
    # An explicit contact pair overrides the friction of its geoms.
    if friction is not None:
        for geom in spec.geoms:
            geom.friction[0] = friction
        for pair in spec.pairs:
            pair.friction[:2] = friction
    if damping is not None:
        given = np.asarray(damping, dtype=float)
        for joint in spec.joints:
            joint.damping[0] = given[joint.id]
    return spec.compile()


def different(model: Any, truth: Any) -> set[str]:
    """Return the names of all arrays in which two models of the same structure differ."""
    have, want = arrays(model), arrays(truth)
    return {
        name
        for name in have
        if have[name].dtype.kind in "fiub"
        and not np.allclose(have[name], want[name], rtol=1e-9, atol=1e-12)
    }


def worst_constant(model: Any, truth: Any) -> tuple[float, str]:
    """Return how far the derived constants of a model are from those of another.

    Args:
        model: `mujoco.MjModel` to judge.
        truth: one of the same structure.

    Returns:
        The largest relative error of all entries of `DERIVED`, and the name of the array.
    """
    worst, name = 0.0, ""
    for field in DERIVED:
        have, want = getattr(model, field), getattr(truth, field)
        # Relative differences; a constant that should be 0 and is not counts as infinite.
        gap = np.abs(have - want)
        errors = np.divide(gap, np.abs(want), out=np.where(gap > 0.0, np.inf, 0.0), where=want != 0)
        if errors.size and errors.max() > worst:
            worst, name = float(errors.max()), field
    return worst, name


def sliding_friction(
    model: Any, along: str = "sled_x", up: str = "sled_z", speed: float = 3.0, steps: int = 100
) -> float:
    """Return friction coefficient of a sled on a level floor, from its motion.

    While it slides, friction is mu times the normal force at every moment, so that the momentum
    it takes is mu times the momentum that the floor gives, even if the sled chatters: mu = -dvx /
    (g T + dvz). Damping is switched off in the model that is simulated, which is a copy.

    Args:
        model: `mujoco.MjModel` with gravity along z and a body on two slide joints; left as it is.
        along: name of the slide joint along x.
        up: name of the one along z.
        speed: at the start [m/s]; it must not come to rest.
        steps: how many to measure.

    Returns:
        The coefficient [-].

    Raises:
        ValueError: if the sled comes to rest.
    """
    mujoco = library()
    model = copy.copy(model)
    model.dof_damping[:] = 0.0
    data = mujoco.MjData(model)
    x, z = (model.joint(name).dofadr[0] for name in (along, up))
    mujoco.mj_step(model, data, nstep=200)  # settles
    data.qvel[x] = speed
    rise = data.qvel[z]
    mujoco.mj_step(model, data, nstep=steps)
    if data.qvel[x] <= 0.05 * speed:
        raise invalid("speed", speed, f"one that is enough to slide for {steps} steps")
    time = steps * model.opt.timestep
    # Friction impulse over normal impulse, as the sled may press less or more than its weight.
    return float((speed - data.qvel[x]) / (-model.opt.gravity[2] * time + data.qvel[z] - rise))


def contact_friction(model: Any, geom: str, other: str = "floor") -> float:
    """Return sliding coefficient that MuJoCo gives to the contacts of two geoms in the pose qpos0.

    Args:
        model: `mujoco.MjModel`.
        geom: name of a geom.
        other: name of the other.

    Returns:
        The coefficient [-].

    Raises:
        ValueError: if they don't touch, or differ from point to point.
    """
    mujoco = library()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pair = {model.geom(geom).id, model.geom(other).id}
    result = {float(mu) for c in data.contact if set(c.geom) == pair for mu in c.friction[:2]}
    if len(result) != 1:
        raise invalid("(geom, other)", (geom, other), "two that touch with one coefficient")
    return result.pop()


def swing_period(model: Any, joint: str, angle: float, swings: int = 3) -> float:
    """Return period of a pendulum released from rest, by the moments at which it passes the bottom.

    Args:
        model: `mujoco.MjModel` in which nothing but this joint moves much; left as it is.
        joint: name of a hinge whose zero is the bottom.
        angle: of the release [rad].
        swings: how many periods to average.

    Returns:
        The period [s], interpolated within a step.

    Raises:
        ValueError: if it does not swing that often within 100 s.
    """
    mujoco = library()
    data = mujoco.MjData(model)
    q = model.joint(joint).qposadr[0]
    data.qpos[q] = angle
    passes: list[float] = []
    while len(passes) < 2 * swings + 1:
        if data.time > 100.0:
            raise invalid("angle", angle, "one from which the pendulum swings")
        before = data.qpos[q], data.time
        mujoco.mj_step(model, data)
        # Linear interpolation of the time at which the angle changes sign.
        if before[0] * data.qpos[q] < 0.0:
            fraction = before[0] / (before[0] - data.qpos[q])
            passes.append(before[1] + fraction * (data.time - before[1]))
    # An odd number of passes: whole periods from the first to the last.
    return (passes[-1] - passes[0]) / swings


def actuator_delay(actions: ArrayLike, steps: int) -> NDArray[np.float64]:
    """Return the forces of a motor of gear 1 whose actions MuJoCo itself delays.

    Args:
        actions: one a step, shape (n,) [N].
        steps: delay in whole steps, not negative.

    Returns:
        Force in each step, shape (n,) [N].
    """
    mujoco = library()
    h = 0.01
    delay = f'nsample="{steps}" delay="{steps * h}"' if steps else ""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{h}"/><worldbody><body><joint name="j" type="slide"/>'
        f'<geom size="0.1"/></body></worldbody><actuator><motor joint="j" {delay}/></actuator>'
        "</mujoco>"
    )
    data = mujoco.MjData(model)
    forces = []
    for action in np.asarray(actions, dtype=float):
        data.ctrl[0] = action
        mujoco.mj_step(model, data)
        # The actuator's force of this step, before the joint has moved by it.
        forces.append(float(data.actuator_force[0]))
    return np.array(forces)
