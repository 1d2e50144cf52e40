"""A slide on a rail between elastic stops: released off center, it should come to rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Machine:
    """The parameters of the slide and of its simulation.

    Attributes:
        mass: of the slide [kg].
        stiffness: of one stop [N/m].
        stops: (position [m], direction in which it pushes, +1 or -1) of every contact point.
        every: steps from one contact detection to the next; in between, the depth is held.
        damping: of one brake, which acts on the measured velocity [N s/m].
        brakes: number of brakes.
        age: number of steps from a measurement to its use.
        friction: coefficient between slide and rail.
        slow: velocity below which friction is proportional to the velocity [m/s].
        rail, guide: directions of the axes of force and velocity, +1 or -1.
        gain, integral: of the drive that centres the slide [N/m, N/(m s)].
        encoder: direction in which the drive measures, +1 or -1.
        blend: share of the new velocity in the position update, from 0 to 1.
        dt: step [s].
        start: initial position [m].
    """

    mass: float
    stiffness: float
    stops: Sequence[tuple[float, float]]
    every: int
    damping: float
    brakes: int
    age: int
    friction: float
    slow: float
    rail: float
    guide: float
    gain: float
    integral: float
    encoder: float
    blend: float
    dt: float
    start: float


# One row per step: position [m], velocity [m/s], forces [N], contact points that pushed.
ROW = np.dtype([(name, float) for name in ("x", "v", "push", "brake", "rub", "drive", "touching")])
GRAVITY = 9.81


def contact_force(machine: Machine, x: float) -> tuple[float, int]:
    """Return the force of the stops [N], and how many contact points push."""
    force, touching = 0.0, 0
    for position, direction in machine.stops:
        depth = direction * (position - x)
        if depth > 0.0:
            force += direction * machine.stiffness * depth
            touching += 1
    return force, touching


def friction_force(machine: Machine, v: float) -> float:
    """Return the friction of the rail [N]: Coulomb friction, smoothed at low velocity."""
    slip = machine.guide * v
    share = min(max(slip / machine.slow, -1.0), 1.0)
    return -machine.rail * machine.friction * machine.mass * GRAVITY * share


def simulate(machine: Machine, steps: int) -> NDArray[np.void]:
    """Simulate the slide for a number of steps and return a `ROW` for each."""
    log = []
    x, v, total = machine.start, 0.0, 0.0
    detected = x
    measured = [0.0] * machine.age
    for i in range(steps):
        measured.append(v)
        if i % machine.every == 0:
            detected = x
        push, touching = contact_force(machine, detected)
        brake = -machine.brakes * machine.damping * measured[i]
        rub = friction_force(machine, v)
        error = machine.encoder * x
        total += machine.dt * error
        drive = -machine.gain * error - machine.integral * total
        log.append((x, v, push, brake, rub, drive, touching))
        faster = v + machine.dt * (push + brake + rub + drive) / machine.mass
        x += machine.dt * (machine.blend * faster + (1.0 - machine.blend) * v)
        v = faster
    return np.array(log, dtype=ROW)
