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
        limit, rise: of the drive, its largest force [N] and its time constant [s].
        ring: natural frequency of the force sensor on its mount [rad/s].
        scale: reading of the sensor for one newton.
        period: of the loop, as it is meant [s].
        periods: from one tick of the loop to the next [s], over and over.
        delay: ticks from a measurement to the command that uses it.
        target: the force to press with [N].
        gain, integral, brake: of the force error [-, 1/s] and of the speed [N s/m].
        smooth: time constant of the filter of the speed [s].
        room: the integral stays within plus and minus so much [N].
        dt: step of the simulation [s].
        start: height above the plate at the beginning [m].
    """

    mass: float
    stiffness: float
    damping: float
    limit: float
    rise: float
    ring: float
    scale: float
    period: float
    periods: Sequence[float]
    delay: int
    target: float
    gain: float
    integral: float
    brake: float
    smooth: float
    room: float
    dt: float
    start: float


# One row a step: depth [m], speed [m/s] and as filtered, force of the plate, reading, command,
# force of the drive [N], ticks of the loop so far.
NAMES = ("x", "v", "speed", "force", "reading", "command", "drive", "ticks")
ROW = np.dtype([(name, float) for name in NAMES])


def simulate(machine: Machine, steps: int) -> NDArray[np.void]:
    """Let the arm come down and return what happens in that many steps, a `ROW` each."""
    log = []
    x, v, speed, drive = -machine.start, 0.0, 0.0, 0.0
    reading, rate = 0.0, 0.0  # of the sensor, a mass on a spring
    total, applied = 0.0, 0.0
    commands = [0.0] * machine.delay
    ticks, due = 0, 0.0
    for i in range(steps):
        force = max(0.0, machine.stiffness * x + machine.damping * v) * (x > 0.0)
        error = machine.target - reading
        desired = machine.target + machine.gain * error + total - machine.brake * speed
        command = min(max(desired, -machine.limit), machine.limit)
        added = total + machine.integral * error * machine.period
        bounded = min(max(added, -machine.room), machine.room)
        if (i + 0.5) * machine.dt > due:  # a tick of the loop: it takes what is there now
            due += machine.periods[ticks % len(machine.periods)]
            total = bounded
            commands.append(command)
            applied = commands[ticks]
            ticks += 1
        drive += machine.dt * (applied - drive) / machine.rise
        log.append((x, v, speed, force, reading, applied, drive, ticks))
        v += machine.dt * (drive - force) / machine.mass
        x += machine.dt * v
        speed += machine.dt * (v - speed) / machine.smooth
        true = machine.scale * force
        rate += machine.dt * machine.ring * (machine.ring * (true - reading) - 1.4 * rate)
        reading += machine.dt * rate
    return np.array(log, dtype=ROW)
