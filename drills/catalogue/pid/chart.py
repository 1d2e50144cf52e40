"""The PID drill's chart: a sampled loop against the same loop in continuous time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place
from drills.values import as_float64

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]

WIDE = 1e4  # N m: limits that are never reached


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """The same loop, sampled ever faster, against the loop in continuous time."""
    from course.drills import PID, closed_loop
    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco.joint import MotorJoint

    inertia, damping, setpoint, tau, every, end = 0.05, 0.1, 0.5, 0.02, 0.04, 1.2
    speed = 8.0
    gains = 3.0 * speed**2 * inertia, speed**3 * inertia, 3.0 * speed * inertia - damping
    apart = (2, 4, 8, 16, 32)  # samples between two looks
    steps = {every / n: n for n in apart}
    looks = round(end / every)

    def driven(child: Place) -> Any:
        def run(dt: float) -> Result:
            n, arguments = steps[dt], (gains, dt, WIDE, tau, inertia, damping, setpoint)
            angles = as_float64(child.given("drive", *arguments, looks * steps[dt]), None)
            return Result(angles[::n], looks * n)

        return run

    def library(dt: float) -> Result:
        n = steps[dt]
        controller = PID(*gains, dt, -WIDE, WIDE, tau)
        joint = MotorJoint(inertia, damping, dt)
        angles, _ = closed_loop(controller, joint, np.full(looks * n, setpoint))
        return Result(angles[::n], looks * n)

    truth = _continuous(gains, tau, inertia, damping, setpoint, every, looks)
    unit, all_steps = "updates", list(steps)
    return measure(
        [
            Method("yours", driven(attempt.learner.child), all_steps, "yours", unit),
            Method("worked answer", driven(worked), all_steps, unit=unit),
            Method("worked answer, MuJoCo's joint", library, all_steps, "oracle", unit),
        ],
        truth,
        reference_check=_continuous(gains, tau, inertia, damping, setpoint, every, looks, 2),
        tolerance=0.01 * setpoint,
        failed_above=setpoint,
        repeats=3,
        question="Angle of a joint under PID control, against the loop in continuous time",
        error_unit="rad",
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
    """Angles of the linear loop in continuous time, by the matrix exponential, (looks + 1,)."""
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
    found = [0.0]
    for _ in range(looks):
        for _ in range(halves):
            state = advance @ state
        found.append(float(state[0]))
    return np.array(found)
