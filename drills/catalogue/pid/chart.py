"""The PID drill's chart: a sampled loop against the same loop in continuous time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.chart_plan import Plan
from drills.values import as_float64

Array = NDArray[np.float64]

WIDE = 1e4  # N m: limits that are never reached
SETPOINT = 0.5  # rad


def sampled(attempt: Attempt) -> Plan:
    """Return the same loop, sampled ever faster, against the loop in continuous time."""
    from course.control import PID, closed_loop
    from course.oracles.mujoco.joint import MotorJoint

    inertia, damping, tau, every, looks, speed = 0.05, 0.1, 0.02, 0.04, 30, 8.0
    gains = 3.0 * speed**2 * inertia, speed**3 * inertia, 3.0 * speed * inertia - damping
    steps = {every / n: n for n in (2, 4, 8, 16, 32)}  # samples between two looks
    loop = gains, tau, inertia, damping, SETPOINT, every, looks

    def ask(place: Any, dt: float) -> tuple[Array, float]:
        arguments, count = (gains, dt, WIDE, tau, inertia, damping, SETPOINT), looks * steps[dt]
        angles = as_float64(place.given("drive", *arguments, count), None)
        return angles[:: steps[dt]], count

    def library(dt: float) -> tuple[Array, float]:
        controller, count = PID(*gains, dt, -WIDE, WIDE, tau), looks * steps[dt]
        joint = MotorJoint(inertia, damping, dt)
        angles, _ = closed_loop(controller, joint, np.full(count, SETPOINT))
        return angles[:: steps[dt]], count

    return Plan(
        settings=list(steps),
        ask=ask,
        truth=_continuous(*loop),
        check=_continuous(*loop, 2),
        libraries={"worked answer, MuJoCo's joint": library},
    )


def _continuous(
    gains: tuple[float, float, float],
    tau: float,
    inertia: float,
    damping: float,
    setpoint: float,
    every: float,
    looks: int,
    halves: int = 1,
) -> Array:
    """Return angles of the linear loop in continuous time, (looks + 1,).

    They come from the matrix exponential.
    """
    from scipy.linalg import expm

    kp, ki, kd = gains
    # angle, speed, integral of the error, low-passed angle, 1
    torque = np.array([-kp - kd / tau, 0.0, ki, kd / tau, kp * setpoint])
    rates = np.zeros((5, 5))
    rates[0, 1] = 1.0
    rates[1] = torque / inertia
    rates[1, 1] -= damping / inertia
    rates[2, [0, 4]] = -1.0, setpoint
    rates[3, [0, 3]] = 1.0 / tau, -1.0 / tau
    advance = expm(rates * every / halves)
    state = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    result = [0.0]
    for _ in range(looks):
        for _ in range(halves):
            state = advance @ state
        result.append(float(state[0]))
    return np.array(result)
