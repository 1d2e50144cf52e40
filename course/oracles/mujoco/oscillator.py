"""MuJoCo asked about what swings: a mass on a spring, the pendulum and the double pendulum."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, finite, positive, vector
from course.oracles.mujoco.kit import GRAVITY, Runner, inertial, library, scene_xml


def oscillator(
    mass: float,
    stiffness: float,
    damping: float,
    q0: float,
    v0: float,
    dt: float,
    integrator: str,
    *,
    implicit_damping: bool = True,
) -> Runner:
    """Return a mass on a spring and a damper: m x'' = -k x - c x', on one slide joint.

    Args:
        mass: m [kg].
        stiffness: k [N/m].
        damping: c [N s/m].
        q0: position at the start [m].
        v0: velocity at the start [m/s].
        dt: step [s].
        integrator: one of `MUJOCO_INTEGRATORS`.
        implicit_damping: False sets MuJoCo's eulerdamp flag to off: the damper is then explicit
            under "Euler" (the other integrators ignore the flag).

    Returns:
        A prepared `Runner`.
    """
    deviation: list[str] = [] if implicit_damping else ["eulerdamp"]
    finite("stiffness", stiffness, 0.0, unit="N/m")
    finite("damping", damping, 0.0, unit="N s/m")
    body = (
        f'<body><joint type="slide" stiffness="{stiffness:.17g}" damping="{damping:.17g}"/>'
        f"{inertial(mass, 0.0, np.ones(3))}</body>"
    )
    xml = scene_xml(body, dt, integrator, 0.0, springs=True, gap=deviation)
    return Runner(xml, [q0], [v0], integrator)


def oscillator_step(
    integrator: str,
    omega_dt: float,
    damping_ratio: float = 0.0,
    *,
    implicit_damping: bool = True,
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return one MuJoCo step of x'' = -x - 2 zeta x', as a function (x, x') -> (x, x').

    The function is what the detectors of `course.measure.stability` take. In theory Euler, implicit
    and implicitfast step v1 = (v - h w^2 q) / (1 + 2 zeta w h), q1 = q + h v1 and are stable while
    w h < 2 (sqrt(1 + zeta^2) + zeta): more damping, longer steps. With the damper explicit the sign
    of zeta turns: 2 (sqrt(1 + zeta^2) - zeta). RK4 has the classical region (2 sqrt(2) undamped);
    "discrete" has no limit.

    Args:
        integrator: one of `MUJOCO_INTEGRATORS`.
        omega_dt: natural frequency times step, positive.
        damping_ratio: zeta, not negative.
        implicit_damping: see `oscillator`.

    Returns:
        The step; its argument stays as it is.
    """
    damping = 2.0 * damping_ratio
    runner = oscillator(
        1.0, 1.0, damping, 0.0, 0.0, omega_dt, integrator, implicit_damping=implicit_damping
    )
    model, data, advance = runner.model, runner.data, library().mj_step

    def step(state: NDArray[np.float64]) -> NDArray[np.float64]:
        data.qpos[0], data.qvel[0] = state
        advance(model, data)
        return np.array([data.qpos[0], data.qvel[0]])

    return step


def pendulum(
    length: float, q0: float, v0: float, dt: float, integrator: str, *, gravity: float = GRAVITY
) -> Runner:
    """Return the ideal pendulum theta'' = -(g / length) sin(theta), theta = 0 hanging down.

    MuJoCo takes no body without inertia, so the bob is spread out: mass 2 at half the length with
    the moment length^2 / 2 about its own centre has the same first and second moment about the
    hinge as mass 1 at the end, and so exactly the same motion.
    """
    half = 0.5 * positive("length", length, unit="m")
    body = (
        '<body><joint type="hinge" axis="0 -1 0"/>'
        f"{inertial(2.0, -half, np.full(3, 2.0 * half**2))}</body>"
    )
    return Runner(scene_xml(body, dt, integrator, gravity), [q0], [v0], integrator)


def double_pendulum(
    masses: Sequence[float],
    lengths: Sequence[float],
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    gravity: float = GRAVITY,
) -> Runner:
    """Return two point masses on massless rods; q = (theta1, theta2 **relative to the first rod**).

    As in `pendulum`, the point masses are replaced by bodies with the same moments: the second has
    mass m2 / s at s l2, the first what is then missing. Both angles are zero hanging down. With
    absolute angles (phi1, phi2): theta1 = phi1, theta2 = phi2 - phi1.
    """
    m1, m2 = vector("masses", masses, (2,), low=POSITIVE, unit="kg").tolist()
    l1, l2 = vector("lengths", lengths, (2,), low=POSITIVE, unit="m").tolist()
    # The first body must keep a positive mass: m2 / s < m1 + m2.
    s = 0.5 * (1.0 + m2 / (m1 + m2))
    rest = m1 + m2 - m2 / s
    second = inertial(m2 / s, -s * l2, np.full(3, m2 * l2**2 * (1.0 - s)))
    first = inertial(rest / s, -s * l1, np.full(3, rest * l1**2 * (1.0 - s)))
    joint = '<joint type="hinge" axis="0 -1 0"/>'
    body = f'<body>{joint}{first}<body pos="0 0 {-l1:.17g}">{joint}{second}</body></body>'
    return Runner(scene_xml(body, dt, integrator, gravity), q0, v0, integrator)
