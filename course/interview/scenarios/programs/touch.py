"""The tip of an arm comes down on a plate and should press on it with a constant force."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Machine:
    """The parameters of the arm, the plate and the controller.

    Attributes:
        mass: of the arm at its tip [kg].
        stiffness, damping: of the plate [N/m, N s/m].
        limit, rise: largest force of the drive [N] and its time constant [s].
        ring: natural frequency of the force sensor on its mount [rad/s].
        scale: reading that the loop uses, per newton of force.
        period: design period of the loop [s].
        periods: times from one tick of the loop to the next [s], repeated cyclically.
        delay: ticks from a measurement to the command that uses it.
        target: desired contact force [N].
        gain, integral, brake: gains of the force error [-, 1/s] and of the velocity [N s/m].
        smooth: time constant of the velocity filter [s].
        room: largest magnitude of the integral [N].
        dt: step of the simulation [s].
        start: initial height above the plate [m].
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


# One row per step: depth [m], velocity and filtered velocity [m/s], force of the plate, reading,
# command, force of the drive [N], ticks of the loop so far.
NAMES = ("x", "v", "speed", "force", "reading", "command", "drive", "ticks")
ROW = np.dtype([(name, float) for name in NAMES])


def simulate(machine: Machine, steps: int) -> NDArray[np.void]:
    """Simulate the arm for a number of steps and return a `ROW` for each."""
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
        if (i + 0.5) * machine.dt > due:  # a tick of the loop: it uses the current values
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
