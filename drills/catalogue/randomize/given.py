"""The child's side of the drill: builds the model and reads everything back as plain numbers."""

import copy

import mujoco
import numpy as np


def build(xml, tuned):
    """Return a model in which somebody has set one constant by hand.

    It is `tuned` times the compiled one.
    """
    model = mujoco.MjModel.from_xml_string(xml)
    model.dof_invweight0[:] *= tuned
    return model


def fresh(model):
    """Return new simulation data of a model."""
    return mujoco.MjData(model)


def generator(seed):
    """Return a generator that lives in the child and is passed by handle."""
    return np.random.default_rng(seed)


def arrays(model):
    """Return copies of all arrays of a model, by name."""
    fields = {name: getattr(model, name) for name in dir(model) if not name.startswith("_")}
    result = {name: value for name, value in fields.items() if isinstance(value, np.ndarray)}
    plain = {name: v.astype(np.uint8) if v.dtype == bool else v for name, v in result.items()}
    return {name: value.copy() for name, value in plain.items() if value.size}


def move(data, qpos, qvel, ctrl, time):
    """Put a state into the data."""
    data.qpos[:], data.qvel[:], data.ctrl[:], data.time = qpos, qvel, ctrl, time


def state(data):
    """Return what must stay."""
    parts = np.ravel(data.qpos), np.ravel(data.qvel), np.ravel(data.ctrl)
    return {"qpos": parts[0], "qvel": parts[1], "ctrl": parts[2], "time": float(data.time)}


def computed(data):
    """Return what must be that of the model as it is now."""
    return {
        name: np.array(getattr(data, name)) for name in ("qfrc_bias", "qfrc_passive", "subtree_com")
    }


def draw(randomizer, model, data, rng, count, actions):
    """Return the arrays that were written, and the delayed actions after each write."""
    names = "geom_friction", "pair_friction", "body_mass", "body_inertia", "dof_damping"
    written: dict[str, list[np.ndarray]] = {name: [] for name in names}
    sent = []
    for number in range(count):
        randomizer.randomize(data, rng)
        for name, values in written.items():
            values.append(getattr(model, name).copy())
        own = [np.array(action) + 100.0 * number for action in actions]
        sent.append([copy.deepcopy(randomizer.delay(action)) for action in own])
    return {name: np.array(values) for name, values in written.items()} | {"delayed": sent}


def delay_reused(randomizer, actions):
    """Return the actions handed over in one array, which is written again and again."""
    buffer = np.empty_like(actions[0])
    back = []
    for action in actions:
        buffer[...] = action
        back.append(copy.deepcopy(randomizer.delay(buffer)))
    return back


def observe(randomizer, observation, rng):
    """Return one observation.

    The array that was handed over, afterwards, and whether it came back.
    """
    handed = np.array(observation)
    back = randomizer.observe(handed, rng)
    shared = isinstance(back, np.ndarray) and bool(np.shares_memory(back, handed))
    return {"handed": handed.copy(), "shared": shared}


def observe_often(randomizer, observation, rng, count):
    """Return `count` noisy copies of one observation, copied before the next call."""
    handed = np.array(observation)
    return [copy.deepcopy(randomizer.observe(handed, rng)) for _ in range(count)]


def timed(randomizer, data, rng, count):
    """Randomise `count` times; the judge times the call."""
    for _ in range(count):
        randomizer.randomize(data, rng)


# For the public examples: a block of 1 kg on a floor and an undamped pendulum of 0.5 kg.
EXAMPLE = """
<mujoco>
  <worldbody>
    <geom type="plane" size="2 2 0.1" friction="0.9"/>
    <body pos="0 0 0.1"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="1"/></body>
    <body pos="1 0 1"><joint axis="0 1 0"/>
      <geom type="sphere" pos="0 0 -0.4" size="0.05" mass="0.5"/></body>
  </worldbody>
</mujoco>
"""


def drawn(randomizer_class, **ranges):
    """Return one draw with these ranges.

    [friction, both masses, damping of the hinge], and restored.
    """
    model = mujoco.MjModel.from_xml_string(EXAMPLE)
    data, randomizer = mujoco.MjData(model), randomizer_class(model, **ranges)
    result = []
    for change in (
        lambda: randomizer.randomize(data, generator(0)),
        lambda: randomizer.restore(data),
    ):
        change()
        numbers = [model.geom_friction[0, 0], *model.body_mass[1:], model.dof_damping[6]]
        result.append([round(float(number), 6) for number in numbers])
    return result


def delayed(randomizer_class, actions, **ranges):
    """Return what comes back for these actions."""
    model = mujoco.MjModel.from_xml_string(EXAMPLE)
    randomizer = randomizer_class(model, **ranges)
    randomizer.randomize(mujoco.MjData(model), generator(0))
    return [float(np.ravel(randomizer.delay(np.array([action])))[0]) for action in actions]
