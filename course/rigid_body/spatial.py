"""A rigid body in space: 13 numbers, Newton and Euler, any inertia tensor, forces at points.

State as in MuJoCo's free joint: q = (x, y, z, qw, qx, qy, qz), v = (velocity of the centre of mass
in the world, angular velocity in the body frame). The gyroscopic term -omega x (I omega) appears
because the equation is written in the turning frame, where I is constant.
"""

from dataclasses import dataclass, field

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike

from course.check import invalid, one_of, positive, vector
from course.rigid_body.integrators import INTEGRATORS, STANDARD_GRAVITY, Array, compiled_parts
from course.rigid_body.quaternion import conjugate, normalise, rotate, unit_quaternion

DOWNWARDS = (0.0, 0.0, -STANDARD_GRAVITY)  # m/s^2
FARTHEST = 1e150  # m; the square of a number ten thousand times as large is no float any more


def poses(name: str, value: ArrayLike, dim: int) -> Array:
    """Return poses from outside as poses in space, one a column.

    Args:
        name: of the argument.
        value: shape (7,) or (7, N) where `dim` is 3, (3,) or (3, N) where it is 2.
        dim: 2 or 3.

    Returns:
        Shape (7, N), contiguous.

    Raises:
        ValueError: for another shape, a NaN, a position beyond `FARTHEST`, or a quaternion that is
            not of unit length.
    """
    rows = {2: 3, 3: 7}[dim]
    given = vector(name, value, (rows,), (rows, None)).reshape(rows, -1)
    if np.any(np.abs(given[:dim]) > FARTHEST):
        allowed = f"positions within {FARTHEST:g} m, as a distance is a root of squares"
        raise invalid(name, float(np.abs(given[:dim]).max()), allowed)
    if dim == 2:
        # A turn about z as a quaternion: cosine and sine of half the angle.
        zero, half = np.zeros_like(given[0]), given[2] / 2
        return np.stack((given[0], given[1], zero, np.cos(half), zero, zero, np.sin(half)))
    turned = unit_quaternion(given[3:], f"{name}[3:]")
    return np.concatenate((given[:3], normalise(turned)))


@register_jitable
def free_flight_acceleration(q, v, params):
    """Return accelerations of bodies in free flight, in principal axes.

    params = (gx, gy, gz [m/s^2], I1, I2, I3 [kg m^2]).

    Args:
        q: positions, shape (7,) or (7, N).
        v: velocities, shape (6,) or (6, N).
        params: as above; mass drops out.

    Returns:
        Rates of v, shape of v.
    """
    result = np.empty_like(v)
    result[0] = params[0]
    result[1] = params[1]
    result[2] = params[2]
    # Euler's equations in principal axes, without a torque: only the gyroscopic terms remain.
    result[3] = (params[4] - params[5]) / params[3] * v[4] * v[5]
    result[4] = (params[5] - params[3]) / params[4] * v[5] * v[3]
    result[5] = (params[3] - params[4]) / params[5] * v[3] * v[4]
    return result


@register_jitable
def newton_euler_acceleration(q, v, params):
    """Return Newton's and Euler's equations for any inertia tensor under a constant wrench.

    Args:
        q: positions, shape (7,) or (7, N).
        v: velocities, shape (6,) or (6, N).
        params: (acceleration of the centre of mass (3) [m/s^2, world], torque about it (3)
            [N m, world], inertia tensor (9) and its inverse (9) [kg m^2, body frame, row by row]).

    Returns:
        Rates of v, shape of v.
    """
    result = np.empty_like(v)
    momentum = np.empty_like(v[3:])
    torque = np.empty_like(v[3:])
    for i in range(3):
        result[i] = params[i]
        torque[i] = params[3 + i]
        momentum[i] = params[6 + 3 * i] * v[3] + params[7 + 3 * i] * v[4] + params[8 + 3 * i] * v[5]
    # The inertia is constant in the body frame only, so the torque goes there.
    torque = rotate(conjugate(q[3:]), torque)
    # The body turns under its angular momentum: less omega x (I omega), the gyroscopic term.
    net_x = torque[0] - (v[4] * momentum[2] - v[5] * momentum[1])
    net_y = torque[1] - (v[5] * momentum[0] - v[3] * momentum[2])
    net_z = torque[2] - (v[3] * momentum[1] - v[4] * momentum[0])
    # Angular acceleration: the inverse inertia times the net torque, in the body frame.
    for i in range(3):
        row = 15 + 3 * i
        result[3 + i] = params[row] * net_x + params[row + 1] * net_y + params[row + 2] * net_z
    return result


def inertia_tensor(value: ArrayLike) -> Array:
    """Return a checked 3 x 3 inertia tensor.

    Args:
        value: three principal moments or a symmetric 3 x 3 tensor, body frame [kg m^2].

    Returns:
        The tensor, shape (3, 3).

    Raises:
        ValueError: unless it is symmetric, positive and obeys the triangle inequality
            I1 + I2 >= I3, without which no mass distribution has it.
    """
    tensor = vector("inertia", value, (3,), (3, 3))
    if tensor.shape == (3,):
        tensor = np.diag(tensor)
    if not np.allclose(tensor, tensor.T, rtol=1e-9, atol=1e-12 * np.abs(tensor).max()):
        raise invalid("inertia", tensor, "a symmetric tensor")
    low, middle, high = np.linalg.eigvalsh(tensor)
    # The triangle inequality of principal moments, with room for rounding.
    if low <= 0.0 or low + middle < high * (1.0 - 1e-9):
        raise invalid(
            "inertia",
            tensor,
            "a tensor with positive principal moments, each at most the sum of the other two "
            f"(here {low:.6g}, {middle:.6g}, {high:.6g})",
        )
    return tensor


@dataclass
class RigidBody:
    """One rigid body in space.

    Attributes:
        mass: [kg].
        inertia: about the centre of mass in the body frame: 3 principal moments or a tensor
            (3, 3) [kg m^2].
        q: position of the centre of mass and unit quaternion, shape (7,) [m].
        v: velocity (world) and angular velocity (body frame), shape (6,) [m/s, rad/s].
        force: force gathered for the next step, world frame [N].
        torque: torque about the centre of mass gathered for the next step, world frame [N m].
    """

    mass: float
    inertia: ArrayLike
    q: Array = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    v: Array = field(default_factory=lambda: np.zeros(6))
    force: Array = field(default_factory=lambda: np.zeros(3), init=False)
    torque: Array = field(default_factory=lambda: np.zeros(3), init=False)

    def __post_init__(self) -> None:
        positive("mass", self.mass, unit="kg")
        self.inertia = inertia_tensor(self.inertia)
        self.q = vector("q", self.q, (7,)).copy()
        self.v = vector("v", self.v, (6,)).copy()
        self.q[3:] = unit_quaternion(self.q[3:])

    def apply_force(self, force: ArrayLike, point: ArrayLike | None = None) -> None:
        """Add a force for the next step.

        Args:
            force: in the world frame, shape (3,) [N].
            point: where it acts, in the world frame, shape (3,) [m]; default: the centre of mass.

        Raises:
            ValueError: for a wrong shape or a number that is not finite.
        """
        f = vector("force", force, (3,), unit="N")
        self.force = self.force + f
        if point is not None:
            # A force beside the centre of mass adds its moment about it.
            arm = vector("point", point, (3,), unit="m") - self.q[:3]
            self.torque = self.torque + np.cross(arm, f)

    def apply_torque(self, torque: ArrayLike) -> None:
        """Add a torque (world frame, shape (3,), N m) for the next step."""
        self.torque = self.torque + vector("torque", torque, (3,), unit="N m")

    def step(
        self,
        dt: float,
        gravity: ArrayLike = DOWNWARDS,
        integrator: str = "rk4",
    ) -> None:
        """Advance by dt [s] under gravity and the gathered wrench, which is then cleared.

        The wrench keeps its direction in the world during the step.

        Args:
            dt: step [s], positive.
            gravity: world frame, shape (3,) [m/s^2].
            integrator: a name in INTEGRATORS.

        Raises:
            ValueError: for a step that is not positive or an unknown integrator.
        """
        positive("dt", dt, unit="s")
        one_of("integrator", integrator, INTEGRATORS)
        unit_quaternion(self.q[3:])  # it may have been set since
        tensor = np.asarray(self.inertia)
        # What stays constant over the step: acceleration, torque in the world, inertia and its
        # inverse.
        params = np.concatenate(
            [
                self.force / self.mass + vector("gravity", gravity, (3,), unit="m/s^2"),
                self.torque,
                tensor.ravel(),
                np.linalg.inv(tensor).ravel(),
            ]
        )
        step = INTEGRATORS[integrator].step
        self.q, self.v = step(self.q, self.v, newton_euler_acceleration, dt, params)
        self.force, self.torque = np.zeros(3), np.zeros(3)

    def energy(self, gravity: ArrayLike = DOWNWARDS) -> tuple[float, float, float]:
        """Return kinetic, potential (zero at the world's origin) and total energy [J]."""
        # Koenig's theorem: energy of the centre of mass plus energy of the turn about it.
        spin = self.v[3:]
        kinetic = 0.5 * self.mass * self.v[:3] @ self.v[:3] + 0.5 * spin @ (
            np.asarray(self.inertia) @ spin
        )
        potential = -self.mass * vector("gravity", gravity, (3,), unit="m/s^2") @ self.q[:3]
        return float(kinetic), float(potential), float(kinetic + potential)

    def angular_momentum(self) -> Array:
        """Return the angular momentum about the centre of mass, shape (3,) [kg m^2/s].

        It is in the world frame.
        """
        # I omega is taken in the body frame, where I is constant, and turned into the world.
        return np.asarray(rotate(self.q[3:], np.asarray(self.inertia) @ self.v[3:]))


# Bodies per block: small enough that its rows stay in cache while many steps go by, large enough
# that the few allocations of a step are shared by many bodies.
BLOCK = 1024


def advance_bodies(
    q: Array,
    v: Array,
    inertia: ArrayLike,
    dt: float,
    steps: int,
    gravity: ArrayLike = DOWNWARDS,
    integrator: str = "rk4_renormalised",
) -> tuple[Array, Array]:
    """Advance many equal bodies in free flight together, by the compiled integrator.

    Args:
        q: positions, shape (7, N) [m, unit quaternions].
        v: velocities, shape (6, N) [m/s, rad/s].
        inertia: the principal moments all bodies share, shape (3,) [kg m^2].
        dt: step [s].
        steps: number of steps.
        gravity: world frame, shape (3,) [m/s^2].
        integrator: a name in INTEGRATORS. The default is of fourth order too, and in a batch less
            than half as dear as `rk4`, whose exponentials cost more than all the rest.

    Returns:
        The new (q, v); the inputs are left as they were.

    Raises:
        ValueError: for shapes that disagree or an unknown integrator.
    """
    if q.ndim != 2 or q.shape[0] != 7 or v.shape != (6, q.shape[1]):
        raise invalid("(q.shape, v.shape)", (q.shape, v.shape), "((7, N), (6, N))")
    one_of("integrator", integrator, INTEGRATORS)
    params = np.concatenate(
        [
            vector("gravity", gravity, (3,), unit="m/s^2"),
            vector("inertia", inertia, (3,), unit="kg m^2"),
        ]
    )
    run, step, acceleration = compiled_parts(free_flight_acceleration, integrator, 2)
    q_new, v_new = np.empty_like(q), np.empty_like(v)
    # All steps of a block before the next block, while its rows are in the cache.
    for start in range(0, q.shape[1], BLOCK):
        part = slice(start, start + BLOCK)
        q_new[:, part], v_new[:, part] = run(
            np.ascontiguousarray(q[:, part]),
            np.ascontiguousarray(v[:, part]),
            step,
            acceleration,
            dt,
            steps,
            params,
        )
    return q_new, v_new
