"""MuJoCo asked about the bouncing box with what the planar model leaves out.

The same contact as `mujoco.box_drop`, so that two answers differ by the effect alone: the third
dimension, the air, a contact that gives way.
"""

import numpy as np

from course.oracles.mujoco import _CORNER, _IMPEDANCE, Runner, _contact_reference, _inertial, _xml
from course.rigid_body import quaternion


def spatial_box(
    size: tuple[float, float, float],
    mass: float,
    state: np.ndarray,
    tilt: float,
    dt: float,
    *,
    restitution: float,
    friction: float,
    gravity: float,
    integrator: str = "Euler",
    contact: str = "impulse",
    contact_steps: float = 40.0,
) -> Runner:
    """A box on a free joint above the ground z = 0, thrown in the x-z plane but for a tilt.

    Args:
        size: width (x), depth (y) and height (z) [m].
        mass: [kg]; the box is uniform.
        state: planar start (x, z, angle, vx, vz, omega), the angle anticlockwise as seen along y.
        tilt: turn out of the plane, about the box's own x axis [rad].
        dt: step [s].
        restitution, friction, gravity, integrator, contact, contact_steps: as for
            `mujoco.box_drop`.

    Returns:
        A prepared `Runner`; q is the free joint's.
    """
    x, z, angle, vx, vz, omega = (float(value) for value in state)
    width, depth, height = size
    moments = (
        mass / 12.0 * np.array([depth**2 + height**2, width**2 + height**2, width**2 + depth**2])
    )
    stiffness, damping = _contact_reference(contact, restitution, dt, integrator, contact_steps)
    pair = (
        f'solref="{-stiffness:.17g} {-damping:.17g}" solreffriction="0 {-1.0 / dt:.17g}" '
        f'solimp="{_IMPEDANCE} {_IMPEDANCE} 0.001" condim="3" '
        f'friction="{friction:.17g} {friction:.17g} 0.005 0.0001 0.0001"'
    )
    geoms, pairs = "", ""
    for i in range(8):
        corner = [0.5 * s * (1.0 if i >> k & 1 else -1.0) for k, s in enumerate(size)]
        place = " ".join(f"{c:.17g}" for c in corner)
        geoms += (
            f'<geom name="c{i}" type="sphere" size="{_CORNER}" pos="{place}" contype="0" '
            'conaffinity="0"/>'
        )
        pairs += f'<pair geom1="ground" geom2="c{i}" {pair}/>'
    body = (
        f'<geom name="ground" type="plane" size="0 0 1" pos="0 0 {-_CORNER}" contype="0" '
        'conaffinity="0"/>'
        f"<body><freejoint/>{_inertial(mass, 0.0, moments)}{geoms}</body>"
    )
    xml = _xml(
        body, dt, integrator, gravity, touching=True, off=["refsafe"],
        extra=f"<contact>{pairs}</contact>",
    )  # fmt: skip
    # Anticlockwise seen along y is a negative turn about y.
    turn = quaternion.exp(np.array([0.0, -angle, 0.0]))
    q = quaternion.product(turn, quaternion.exp(np.array([tilt, 0.0, 0.0])))
    spin = quaternion.rotate(quaternion.conjugate(q), np.array([0.0, -omega, 0.0]))
    q0 = np.concatenate([[x, 0.0, z], q])
    return Runner(xml, q0, np.concatenate([[vx, 0.0, vz], spin]), integrator)


def add_air(runner: Runner) -> None:
    """Put a scene into air of 20 degrees C, as MuJoCo's inertia-based fluid model takes it."""
    import mujoco

    # The adapter switches passive forces off where a scene has none.
    runner.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_DAMPER)
    runner.model.opt.density = 1.204
    runner.model.opt.viscosity = 1.82e-5
