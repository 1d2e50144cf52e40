"""The tip of an arm comes down on a plate and should press on it with a constant force."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Machine:
    """What is built, and how it is controlled.

    Attributes:
        mass: of the arm at its tip [kg].
        stiffness, damping: of the plate [N/m, N s/m].
        limit: of the drive [N].
        ring: natural frequency of the force sensor on its mount [rad/s].
        period: of the loop, as it is meant [s].
        periods: from one tick of the loop to the next [s], over and over.
        delay: ticks from a measurement to the command that uses it.
        target: the force to press with [N].
        gain, integral, brake: of the force error [-, 1/s] and of the speed [N s/m].
        room: the integral stays within plus and minus so much [N].
        dt: step of the simulation [s].
        start: height above the plate at the beginning [m].
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    ring: float
    period: float
    periods: Sequence[float]
    delay: int
    target: float
    gain: float
    integral: float
    brake: float
    room: float
    dt: float
    start: float


# One row a step: depth [m], force of the plate, reading, command [N], ticks of the loop so far.
ROW = np.dtype([(name, float) for name in ("x", "force", "reading", "command", "ticks")])


def simulate(machine: Machine, steps: int) -> NDArray[np.void]:
    """Let the arm come down; what happened in so many steps, a `ROW` each."""
    log = []
    x, v = -machine.start, 0.0
    reading, rate = 0.0, 0.0  # of the sensor, a mass on a spring
    total, applied = 0.0, 0.0
    commands = [0.0] * machine.delay
    ticks, due = 0, 0.0
    for i in range(steps):
        force = max(0.0, machine.stiffness * x + machine.damping * v) * (x > 0.0)
        if (i + 0.5) * machine.dt > due:
            due += machine.periods[ticks % len(machine.periods)]
            error = machine.target - reading
            desired = machine.target + machine.gain * error + total - machine.brake * v
            total += machine.integral * error * machine.period
            total = min(max(total, -machine.room), machine.room)
            commands.append(min(max(desired, -machine.limit), machine.limit))
            applied = commands[ticks]
            ticks += 1
        log.append((x, force, reading, applied, ticks))
        v += machine.dt * (applied - force) / machine.mass
        x += machine.dt * v
        rate += machine.dt * machine.ring * (machine.ring * (force - reading) - 1.4 * rate)
        reading += machine.dt * rate
    return np.array(log, dtype=ROW)
