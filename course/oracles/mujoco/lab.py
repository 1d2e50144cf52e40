"""The break-it lab: a gripper on a gantry lifts a box, and what a wrong number in the model does.

A servo lowers two coupled fingers around a box, they close with a given force, it lifts them. A
policy is that force and the servo's gains, tuned where the model is right; then step, friction,
mass or camera are wrong. The solver's options stay MuJoCo's defaults.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from course.check import finite, positive
from course.oracles.mujoco.kit import GRAVITY, library

HALF = 0.02  # of the box [m]
HIGH = 0.03  # half the length of a pad [m]
ABOVE = 0.06  # how far the palm comes down [m]
CLOSE, REST = 0.5, 0.3  # seconds between going down and up, and at the end
PALM, FINGER = 1.0, 0.1  # masses [kg]
KEPT = 0.01  # a box is held if it slid less than this in the jaw [m]
WARNINGS = ("inertia", "contact full", "constraint full", "bad qpos", "bad qvel", "bad qacc")


@dataclass(frozen=True)
class Lab:
    """The scene and the policy.

    Attributes:
        force: of each finger [N].
        kp, kv, ki: gains of the lift [N/m, N s/m, N/(m s)].
        friction: between pads and box.
        mass: of the box [kg].
        offset: of the jaw's middle from the box, what a camera is wrong by [m].
        opening: free width on each side of the box, with the jaw open [m].
        height, acceleration: of the lift [m, m/s^2].
        dt: step of the simulation, and of the servo [s].
        solref: of pads and box, MuJoCo's: time constant and damping ratio, or minus stiffness and
            minus damping, both for a unit of effective mass.
    """

    force: float = 4.0
    kp: float = 600.0
    kv: float = 60.0
    ki: float = 0.0
    friction: float = 1.0
    mass: float = 0.5
    offset: float = 0.0
    opening: float = 0.025
    height: float = 0.2
    acceleration: float = 2.0
    dt: float = 0.002
    solref: tuple[float, float] = (0.02, 1.0)

    def __post_init__(self) -> None:
        for name in ("friction", "mass", "opening", "height", "acceleration", "dt", "kp"):
            positive(name, getattr(self, name))
        for name in ("force", "kv", "ki"):
            finite(name, getattr(self, name), 0.0)
        finite("offset", self.offset, unit="m")

    @property
    def grasped(self) -> float:
        """When the lift begins [s]."""
        return 2.0 * math.sqrt(ABOVE / self.acceleration) + CLOSE

    @property
    def needed(self) -> float:
        """The least force of a finger that holds: m (g + a) / (2 mu) [N]."""
        return self.mass * (GRAVITY + self.acceleration) / (2.0 * self.friction)


class Lifted(NamedTuple):
    """What came of it.

    Attributes:
        held: whether the box is in the jaw and off the ground at the end, and never flew.
        slid: how far it slid down in the jaw [m].
        sunk, pressed: how deep a pad is in it at most, at all and once it is lifted [m].
        error: of the palm's height at the end [m].
        peak: largest acceleration of the palm [m/s^2].
        fastest: of the box [m/s].
        warnings: that MuJoCo gave.
    """

    held: bool
    slid: float
    sunk: float
    pressed: float
    error: float
    peak: float
    fastest: float
    warnings: tuple[str, ...]


@functools.lru_cache(64)
def _model(mass: float, friction: float, opening: float, solref: tuple[float, float]) -> Any:
    fingers = "".join(
        f'<body pos="{side * (HALF + opening + 0.005):.17g} 0 0" gravcomp="1">'
        f'<joint name="{name}" type="slide" axis="{-side} 0 0" damping="2" range="0 1"/>'
        f'<geom name="{name}" type="box" size="0.005 0.02 {HIGH}" mass="{FINGER}" '
        'contype="0" conaffinity="0"/></body>'
        for name, side in (("left", -1), ("right", 1))
    )
    touch = "".join(
        f'<pair geom1="{name}" geom2="box" condim="4" solref="{solref[0]:.17g} {solref[1]:.17g}" '
        f'friction="{friction:.17g} {friction:.17g} 0.005 0.0001 0.0001"/>'
        for name in ("left", "right")
    )
    return library().MjModel.from_xml_string(
        '<mujoco><option integrator="implicitfast" cone="elliptic"/><worldbody>'
        '<geom type="plane" size="1 1 0.1"/><body name="palm" pos="0 0 0.04" gravcomp="1">'
        f'<joint name="lift" type="slide" axis="0 0 1"/><geom size="0.02" pos="0 0 0.1" '
        f'mass="{PALM}" contype="0" conaffinity="0"/>{fingers}</body>'
        f'<body name="box" pos="0 0 {HALF}"><freejoint/><geom name="box" type="box" '
        f'size="{HALF} {HALF} {HALF}" mass="{mass:.17g}"/></body></worldbody>'
        f"<contact>{touch}</contact><equality><joint joint1='left' joint2='right' "
        "solref='0.004 1'/></equality><actuator><motor joint='left'/><motor joint='right'/>"
        "<motor joint='lift'/></actuator></mujoco>"
    )


def path(lab: Lab, t: float) -> tuple[float, float, float]:
    """Return height of the palm above its grasp, speed and acceleration at a time [m, m/s, m/s^2].

    Down, a wait, and up; half of each way with the acceleration, half with its opposite.
    """
    down, t = t < lab.grasped - CLOSE, t if t < lab.grasped - CLOSE else t - lab.grasped
    path, a = (-ABOVE, -lab.acceleration) if down else (lab.height, lab.acceleration)
    # Bang-bang profile: half of the way at +a, half at -a.
    start, half = ABOVE if down else 0.0, math.sqrt(path / a)
    if t <= 0.0:
        return start, 0.0, 0.0
    if t < half:
        return start + 0.5 * a * t * t, a * t, a
    remaining = max(0.0, 2.0 * half - t)
    return start + path - 0.5 * a * remaining**2, a * remaining, -a if remaining > 0.0 else 0.0


def lift(lab: Lab, believed: float | None = None) -> Lifted:
    """Close, lift, wait.

    Args:
        lab: scene and policy.
        believed: mass of the box that the servo's feed-forward carries [kg]; default: `Lab.mass`
            as the class has it, what the policy was tuned for.
    """
    mujoco, model = library(), _model(lab.mass, lab.friction, lab.opening, lab.solref)
    model.opt.timestep = lab.dt
    data = mujoco.MjData(model)
    data.qpos[0], data.qpos[3] = ABOVE, -lab.offset
    box = Lab.mass if believed is None else believed
    end = lab.grasped + 2.0 * math.sqrt(lab.height / lab.acceleration) + REST
    total = sunk = pressed = peak = fastest = below = 0.0
    for k in range(round(end / lab.dt)):
        t = k * lab.dt
        z, v, a = path(lab, t)
        deviation, up = z - data.qpos[0], t >= lab.grasped
        total += deviation * lab.dt
        servo = lab.kp * deviation + lab.kv * (v - data.qvel[0]) + lab.ki * total
        # Until the jaw closes the fingers are pushed open.
        grip = lab.force if t >= lab.grasped - CLOSE else -1.0
        # Feedforward of inertia, and of the box's weight once it is lifted.
        carried = (PALM + 2.0 * FINGER) * a + up * box * (GRAVITY + a)
        data.ctrl[:] = grip, grip, servo + carried
        mujoco.mj_step(model, data)
        pads = data.contact.geom[:, 0] > 0
        depth = -float(np.min(data.contact.dist, initial=0.0, where=pads))
        sunk = max(sunk, depth)
        if up:
            pressed = max(pressed, depth)
            peak = max(peak, float(data.qacc[0]))
        else:
            # Last height of the box in the jaw before the lift; the slip is measured from it.
            below = float(data.qpos[5] - data.qpos[0])
        fastest = max(fastest, float(np.linalg.norm(data.qvel[3:6])))
    slid = below - float(data.qpos[5] - data.qpos[0])
    sound = bool(np.isfinite(data.qpos).all())
    held = sound and abs(slid) < KEPT and data.qpos[5] > 0.5 * lab.height and fastest < 3.0
    text = tuple(name for i, name in enumerate(WARNINGS) if data.warning[i].number)
    error = float(lab.height - data.qpos[0]) if sound else math.inf
    return Lifted(held, slid, sunk, pressed, error, peak, fastest, text)


def tuned(lab: Lab, margin: float = 1.2) -> Lab:
    """Return the lab with the least force that holds in it, by halving, times a margin."""
    # Bisection between a fifth and five times the force of Coulomb's law.
    low, high = 0.2 * lab.needed, 5.0 * lab.needed
    for _ in range(9):
        middle = 0.5 * (low + high)
        if lift(replace(lab, force=middle), lab.mass).held:
            high = middle
        else:
            low = middle
    return replace(lab, force=margin * high)


def trials(lab: Lab, n: int, seed: int = 0) -> int:
    """Return how many of n lifts hold a box whose position and mass are uncertain.

    The box lies up to 15 mm off and weighs up to 5 % more or less than `Lab.mass` says, under a
    servo that believes in the class's own value.
    """
    rng = np.random.default_rng(seed)
    draws = rng.uniform([-0.015, 0.95], [0.015, 1.05], (n, 2)).tolist()
    return sum(lift(replace(lab, offset=lab.offset + x, mass=lab.mass * m)).held for x, m in draws)
