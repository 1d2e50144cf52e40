"""A planar rigid body: a box that tumbles, bounces, slides, tips over and comes to rest.

The state is (x, y, angle, vx, vy, omega): centre of mass [m], angle from the x axis, anticlockwise
[rad], and their rates. The ground is y = 0. `step_boxes` advances N boxes, `PlanarBody` is one box
on top of it: there is one algorithm, `_advance`.

Between contacts force and torque are constant over a step, and then the integrators of the course
differ in one number only, the c of x + h v + c h^2 a (`FLIGHT_COEFFICIENT`).

Contact is hybrid. Impacts are events: their time is found inside the step, and a Coulomb impact
with energetic restitution is applied there (`planar_contact.impact`). An impact slower than
`rest_speed` does not bounce. A corner that stays on the ground is treated on the level of
velocities (Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988): one
inelastic Coulomb impulse for what is left of the step.

Assumed of impacts at two corners: if both approach at the same speed (to 1e-6) the face lands as a
whole, with one impulse at its middle, so a flat drop bounces flat. Otherwise the faster corner goes
first, then the next. A face that lands with the smallest tilt lands corner by corner; in the limit
of no tilt this is not the flat landing: for rigid bodies that landing is truly discontinuous.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, one_of, positive, vector
from course.compiled import MATRIX, loop
from course.rigid_body.integrators import STANDARD_GRAVITY
from course.rigid_body.planar_contact import (
    GAP_TOLERANCE,
    HIT,
    SPEED_TOLERANCE,
    UNFINISHED,
    collide,
    collide_late,
    first_impact,
    flight,
    lies_still,
    lowest_corners,
    sustain,
)

Array = NDArray[np.float64]

# c of x + h v + c h^2 a, by integrator, for a force that is constant over the step.
FLIGHT_COEFFICIENT: dict[str, float] = {
    "explicit_euler": 0.0,
    "semi_implicit_euler": 1.0,
    "velocity_verlet": 0.5,
    "explicit_midpoint": 0.5,
    "implicit_midpoint": 0.5,
    "rk4": 0.5,
}

# Rows of the array of parameters.
PARAMETERS = ("mass", "width", "height", "inertia", "restitution", "friction", "rest_speed")


@register_jitable
def _fly(x, y, angle, vx, vy, omega, ax, ay, alpha, tau, coefficient):
    """Return the state after the time tau without contact."""
    return (
        flight(x, vx, ax, tau, coefficient),
        flight(y, vy, ay, tau, coefficient),
        flight(angle, omega, alpha, tau, coefficient),
        vx + tau * ax,
        vy + tau * ay,
        omega + tau * alpha,
    )


@register_jitable
def _advance(
    x, y, angle, vx, vy, omega, ax, ay, alpha, box, radius, dt, coefficient, resolve, limit
):
    """Advance one box near the ground by one step.

    Flight, impacts, contact, in the order they happen.

    Returns:
        The new state, the number of impacts, and 1 if the step was not resolved, else 0.
    """
    width, height, rest_speed = box[1], box[2], box[6]
    remaining = dt
    impacts = 0
    failed = 0
    bounced = False  # a corner has just bounced: it is to fly, however slowly
    passes = 0
    while resolve:
        passes += 1
        # Bounces that pile up without end would keep the loop here for ever.
        if impacts >= limit or passes > 4 * limit:
            failed = 1
            break
        corners = lowest_corners(angle, width, height)
        rx, ry, rx2, ry2 = corners
        touch = GAP_TOLERANCE * radius
        # Below the ground only by rounding, or because it was put there: no impulse undoes that.
        if y + ry < -touch:
            y = -ry
        # How far the centre can fall and the corners can swing in what is left of the step, at
        # most.
        fall = min(remaining * vy, 0.0) + min(coefficient * ay * remaining * remaining, 0.0)
        swing = radius * remaining * (abs(omega) + coefficient * abs(alpha) * remaining)
        # Too high to come down in what is left of the step, however it turns.
        if y + ry + fall - swing > touch:
            break
        # A corner touches: it hits, it is held, or it is about to leave.
        if y + ry <= touch:
            # Normal velocities of both lowest corners: that of the centre, and the spin times the
            # arm.
            vn, vn2 = vy + omega * rx, vy + omega * rx2
            flat = y + ry2 <= touch
            speed = min(vn, vn2) if flat else vn
            # It hits. Only a new look tells what touches after the impulse.
            if speed < -SPEED_TOLERANCE:
                bounced = speed < -rest_speed
                vx, vy, omega, bad = collide(vx, vy, omega, corners, box, bounced)
                impacts += 1
                failed |= bad
                continue
            # Held is what the forces press down and does not leave by itself: a corner that has
            # just bounced leaves at any speed, one that rests only above the rest speed.
            slow = SPEED_TOLERANCE if bounced else max(rest_speed, SPEED_TOLERANCE)
            first = vn <= slow
            second = flat and vn2 <= slow
            if (first and vn + remaining * (ay + alpha * rx) < 0.0) or (
                second and vn2 + remaining * (ay + alpha * rx2) < 0.0
            ):
                x, y, angle, vx, vy, omega, used, outcome = sustain(
                    x,
                    y,
                    angle,
                    vx,
                    vy,
                    omega,
                    ax,
                    ay,
                    alpha,
                    corners,
                    box,
                    remaining,
                    coefficient,
                    flat,
                    first,
                    second,
                )
                # Held up to an event: what is left of the step goes on from there.
                if outcome != 0:
                    bounced = False
                    failed |= outcome < 0
                    remaining -= used
                    if remaining <= 0.0:
                        return x, y, angle, vx, vy, omega, impacts, failed
                    continue
        # Free until the next impact, and if there is none until the end of the step.
        tau, outcome = first_impact(
            y, angle, vy, omega, ay, alpha, width, height, remaining, coefficient
        )
        # Only a corner that has not moved since its bounce counts as bounced.
        bounced = bounced and tau == 0.0
        if outcome != HIT and outcome != UNFINISHED:
            break
        # Fly to the impact, or as far as is certain to be free; the next pass decides what happens
        # there.
        x, y, angle, vx, vy, omega = _fly(
            x, y, angle, vx, vy, omega, ax, ay, alpha, tau, coefficient
        )
        remaining -= tau
        if remaining <= 0.0:
            return x, y, angle, vx, vy, omega, impacts, failed
    # What is left of the step is flight; nobody has looked for the ground in it if impacts are not
    # resolved or were too many, so it is looked for at the end.
    x, y, angle, vx, vy, omega = _fly(
        x, y, angle, vx, vy, omega, ax, ay, alpha, remaining, coefficient
    )
    if failed != 0 or not resolve:
        if failed != 0:  # too many impacts: the rest of the step does not bounce
            box = (box[0], box[1], box[2], box[3], 0.0, box[5], box[6])
        x, y, angle, vx, vy, omega, late, bad = collide_late(x, y, angle, vx, vy, omega, box)
        impacts += late
        failed |= bad
    return x, y, angle, vx, vy, omega, impacts, failed


def _step_boxes(
    out, counts, state, parameters, forces, gx, gy, dt, steps, coefficient, resolve, ground, limit
):
    """Take `steps` steps of every box, one box after the other.

    It returns the first box that failed, or -1.
    """
    each = parameters.shape[1] > 1 or forces.shape[1] > 1
    for j in range(state.shape[1]):
        # What boxes share is prepared once, with the first of them.
        if each or j == 0:
            k = min(j, parameters.shape[1] - 1)
            f = min(j, forces.shape[1] - 1)
            mass, width, height = parameters[0, k], parameters[1, k], parameters[2, k]
            inertia, restitution = parameters[3, k], parameters[4, k]
            friction, rest_speed = parameters[5, k], parameters[6, k]
            # Checked in the loop itself, where a bad box ends the run and its number is returned.
            good = mass > 0.0 and width > 0.0 and height > 0.0 and inertia > 0.0
            good = good and 0.0 <= restitution <= 1.0 and friction >= 0.0 and rest_speed >= 0.0
            # The sum is finite only if every term is: one test for all NaNs and infinities.
            finite = mass + width + height + inertia + friction + rest_speed
            finite += forces[0, f] + forces[1, f] + forces[2, f]
            if not good or not abs(finite) < np.inf:
                return j
            box = (1.0 / mass, width, height, 1.0 / inertia, restitution, friction, rest_speed)
            radius = 0.5 * np.sqrt(width * width + height * height)
            ax = gx + forces[0, f] / mass
            ay = gy + forces[1, f] / mass
            alpha = forces[2, f] / inertia
            # On a face, pressed down and pushed by nothing: at rest it stays as it is.
            settles = ground and resolve and ax == 0.0 and ay < 0.0 and alpha == 0.0
        x, y, angle = state[0, j], state[1, j], state[2, j]
        vx, vy, omega = state[3, j], state[4, j], state[5, j]
        if not abs(x + y + angle + vx + vy + omega) < np.inf:
            return j
        impacts = 0
        unresolved = 0
        for _ in range(steps):
            # At rest bit for bit: the steps that are left would not change anything.
            if settles and lies_still(y, angle, vx, vy, omega, width, height):
                break
            fall = min(dt * vy, 0.0) + min(coefficient * ay * dt * dt, 0.0)
            # High above the ground, where most steps are: no corner can reach it.
            if not ground or y + fall > radius:
                x, y, angle, vx, vy, omega = _fly(
                    x, y, angle, vx, vy, omega, ax, ay, alpha, dt, coefficient
                )
                continue
            x, y, angle, vx, vy, omega, n, failed = _advance(
                x,
                y,
                angle,
                vx,
                vy,
                omega,
                ax,
                ay,
                alpha,
                box,
                radius,
                dt,
                coefficient,
                resolve,
                limit,
            )
            impacts += n
            unresolved += failed
        out[0, j], out[1, j], out[2, j] = x, y, angle
        out[3, j], out[4, j], out[5, j] = vx, vy, omega
        counts[0, j] = impacts
        counts[1, j] = unresolved
    return -1


_SIGNATURE = types.int64(
    MATRIX,
    types.Array(types.int64, 2, "C"),
    MATRIX,
    MATRIX,
    MATRIX,
    types.float64,
    types.float64,
    types.float64,
    types.int64,
    types.float64,
    types.boolean,
    types.boolean,
    types.int64,
)


# Arguments as `_step_boxes` names them and `prepare` checks them; `out` may be `state` itself.
step_boxes_loop = loop(_step_boxes, _SIGNATURE)


def box_parameters(
    mass: ArrayLike = 1.0,
    width: ArrayLike = 0.3,
    height: ArrayLike = 0.2,
    *,
    inertia: ArrayLike | None = None,
    restitution: ArrayLike = 0.7,
    friction: ArrayLike = 0.5,
    rest_speed: ArrayLike = 0.01,
) -> Array:
    """Return the parameters of one box, or of N boxes where any of them is an array.

    Args:
        mass: [kg], positive.
        width: extent along the body's own x axis [m], positive.
        height: extent along the body's own y axis [m], positive.
        inertia: about the centre of mass [kg m^2], positive; that of a uniform box,
            m (w^2 + h^2) / 12, if left out.
        restitution: in [0, 1].
        friction: Coulomb coefficient, not negative.
        rest_speed: an impact slower than this does not bounce [m/s], not negative.

    Returns:
        Array (7, N) with the rows of `PARAMETERS`; N = 1 serves any number of boxes.

    Raises:
        ValueError: a parameter is not finite or out of its range.
    """
    mass = vector("mass", mass, low=POSITIVE, unit="kg")
    width = vector("width", width, low=POSITIVE, unit="m")
    height = vector("height", height, low=POSITIVE, unit="m")
    if inertia is None:
        # Moment of inertia of a uniform rectangle about its centre.
        inertia = mass * (width * width + height * height) / 12.0
    rows = [
        mass,
        width,
        height,
        vector("inertia", inertia, low=POSITIVE, unit="kg m^2"),
        vector("restitution", restitution, low=0.0, high=1.0),
        vector("friction", friction, low=0.0),
        vector("rest_speed", rest_speed, low=0.0, unit="m/s"),
    ]
    try:
        return np.array(np.broadcast_arrays(*[np.atleast_1d(row) for row in rows]))
    except ValueError as error:
        shapes = {name: row.shape for name, row in zip(PARAMETERS, rows, strict=True)}
        raise invalid("the shapes", shapes, "those that agree") from error


def _gravity(gravity: ArrayLike) -> tuple[float, float]:
    """Return the vector of gravity; a single number acts downwards."""
    g = vector("gravity", gravity, (), (2,), unit="m/s^2")
    return (0.0, -float(g)) if g.shape == () else (float(g[0]), float(g[1]))


Run = Callable[..., tuple[Array, NDArray[np.int64]]]


def prepare(
    n: int,
    parameters: Array,
    dt: float,
    *,
    gravity: ArrayLike = STANDARD_GRAVITY,
    forces: ArrayLike | None = None,
    integrator: str = "semi_implicit_euler",
    resolve_impacts: bool = True,
    ground: bool = True,
    max_events: int = 64,
) -> Run:
    """Return `advance_boxes` with all checked but the state, for many short runs of the same boxes.

    Args:
        n: number of boxes.
        parameters: (7, N) or (7, 1), from `box_parameters`.
        dt: step [s], positive.
        gravity: acceleration downwards, or the vector (gx, gy) [m/s^2].
        forces: (3, N) or (3,): force in world axes and torque about the centre of mass, constant
            over all the steps [N, N m].
        integrator: a name in `FLIGHT_COEFFICIENT`.
        resolve_impacts: find impacts within the step.
        ground: whether there is ground at y = 0.
        max_events: impacts of one box within one step. What is left of a step after that many
            is made without bouncing, and counted as not resolved.

    Returns:
        Function (state (6, n), steps, out=None) -> (new state, counts), as `advance_boxes` returns.

    Raises:
        ValueError: as for `advance_boxes`.
    """
    parameters = np.ascontiguousarray(parameters, dtype=float)
    if parameters.ndim != 2 or parameters.shape[0] != 7 or parameters.shape[1] not in (1, n):
        raise invalid("parameters.shape", parameters.shape, f"(7, 1) or (7, {n})")
    force = np.zeros((3, 1)) if forces is None else np.ascontiguousarray(forces, dtype=float)
    if force.ndim == 1:
        force = force.reshape(-1, 1)
    if force.shape not in ((3, 1), (3, n)):
        raise invalid("forces.shape", force.shape, f"(3,), (3, 1) or (3, {n})")
    positive("dt", dt, unit="s")
    count("max_events", max_events, 1)
    gx, gy = _gravity(gravity)
    coefficient = FLIGHT_COEFFICIENT[one_of("integrator", integrator, FLIGHT_COEFFICIENT)]

    def run(state: Array, steps: int, out: Array | None = None) -> tuple[Array, NDArray[np.int64]]:
        count("steps", steps)
        if out is None:
            out = np.empty_like(state)
        elif out.shape != state.shape or out.dtype != state.dtype or not out.flags.c_contiguous:
            raise invalid("out", (out.dtype.name, out.shape), f"C-ordered float64 {state.shape}")
        counts = np.empty((2, n), dtype=np.int64)
        # Compiled code can't raise with these values, so it returns the number of the first bad
        # box.
        bad = step_boxes_loop(
            out,
            counts,
            state,
            parameters,
            force,
            gx,
            gy,
            float(dt),
            steps,
            coefficient,
            resolve_impacts,
            ground,
            max_events,
        )
        if bad >= 0:
            k = bad if parameters.shape[1] > 1 else 0
            given = dict(zip(PARAMETERS, parameters[:, k].tolist(), strict=True))
            f = force[:, bad if force.shape[1] > 1 else 0]
            raise invalid(
                f"box {bad}",
                {"state": state[:, bad].tolist(), "force and torque": f.tolist(), **given},
                "finite numbers in the ranges of box_parameters",
            )
        return out, counts

    return run


def advance_boxes(
    state: Array,
    parameters: Array,
    dt: float,
    steps: int,
    *,
    out: Array | None = None,
    **options: Any,
) -> tuple[Array, NDArray[np.int64]]:
    """Advance N boxes by many steps in one compiled call.

    Each box makes all its steps before the next one starts, so its state stays in registers.

    With impacts resolved, impact times are exact for the flight that the integrator's
    coefficient c defines, and a flight with c = 1/2 is exact. A hop that is over within one
    step shows what c does: with c = 1 the box comes back to the ground with no speed, with
    c = 0 it does not come back within that step, so under explicit Euler hops of about g dt
    never die out. Sustained contact is of first
    order in dt, except sliding on a face with c = 1/2, which is exact. Without resolution a
    corner found below the ground at the end of a step is reflected there and pushed out. A box
    that starts below the ground is first lifted onto it.

    Args:
        state: (6, N): x, y, angle, vx, vy, omega [m, rad, m/s, rad/s].
        parameters: (7, N) or (7, 1), from `box_parameters`.
        dt: step [s], positive.
        steps: how many, not negative.
        out: (6, N) array for the result; a new one if left out.
        options: gravity, forces, integrator, resolve_impacts, ground, max_events: see `prepare`.

    Returns:
        (new state, counts): counts (2, N) has the number of impacts of each box, and how many
        of its steps were not resolved.

    Raises:
        ValueError: shapes disagree, something is not finite, or a value is out of its range.
    """
    state = np.ascontiguousarray(state, dtype=float)
    if state.ndim != 2 or state.shape[0] != 6:
        raise invalid("state.shape", state.shape, "(6, N)")
    return prepare(state.shape[1], parameters, dt, **options)(state, steps, out)


def step_boxes(
    state: Array, parameters: Array, dt: float, **options: Any
) -> tuple[Array, NDArray[np.int64]]:
    """Advance N boxes by one step: `advance_boxes` with one step, and its options."""
    return advance_boxes(state, parameters, dt, 1, **options)


@dataclass
class PlanarBody:
    """One box, with its state and the force collected for the next step.

    Attributes:
        mass, width, height, inertia, restitution, friction, rest_speed: see `box_parameters`.
            Without an inertia of its own the box is uniform, also after its mass has changed.
        state: (6,): x, y, angle, vx, vy, omega.
        ground: whether there is ground at y = 0.
        resolve_impacts: find impacts within a step (False: only at its end).
        force: (2,), collected by `apply_force` and cleared by `step` [N].
        torque: about the centre of mass, likewise [N m].
        impacts: how many impacts there were so far.
        unresolved: how many steps had more than `max_events` impacts.
    """

    mass: float = 1.0
    width: float = 0.3
    height: float = 0.2
    inertia: float | None = None
    restitution: float = 0.7
    friction: float = 0.5
    rest_speed: float = 0.01
    state: Array = field(default_factory=lambda: np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    ground: bool = True
    resolve_impacts: bool = True
    max_events: int = 64
    force: Array = field(default_factory=lambda: np.zeros(2), init=False)
    torque: float = field(default=0.0, init=False)
    impacts: int = field(default=0, init=False)
    unresolved: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        box_parameters(
            self.mass,
            self.width,
            self.height,
            inertia=self.inertia,
            restitution=self.restitution,
            friction=self.friction,
            rest_speed=self.rest_speed,
        )
        self.state = vector("state", self.state, (6,)).copy()

    @property
    def moment(self) -> float:
        """Moment of inertia about the centre of mass [kg m^2]."""
        if self.inertia is not None:
            return self.inertia
        return self.mass * (self.width**2 + self.height**2) / 12.0

    @property
    def parameters(self) -> Array:
        """(7, 1), the attributes as they are now; `step` checks them."""
        names = ("moment" if name == "inertia" else name for name in PARAMETERS)
        return np.array([[getattr(self, name)] for name in names], dtype=float)

    @property
    def position(self) -> Array:
        """Centre of mass, (2,) [m]."""
        return self.state[:2].copy()

    @property
    def angle(self) -> float:
        """[rad], anticlockwise, not wrapped."""
        return float(self.state[2])

    @property
    def velocity(self) -> Array:
        """Velocity of the centre of mass, (2,) [m/s]."""
        return self.state[3:5].copy()

    @property
    def omega(self) -> float:
        """Angular velocity [rad/s]."""
        return float(self.state[5])

    def corners(self) -> Array:
        """Return the corners in world axes, shape (2, 4) [m].

        They run anticlockwise from the body's lower left.
        """
        x, y, angle = self.state[:3]
        # Half sizes with the signs of the corners, turned by the angle and shifted to the centre.
        a = 0.5 * self.width * np.array([-1.0, 1.0, 1.0, -1.0])
        b = 0.5 * self.height * np.array([-1.0, -1.0, 1.0, 1.0])
        s, c = np.sin(angle), np.cos(angle)
        return np.array([x + c * a - s * b, y + s * a + c * b])

    def apply_force(self, force: ArrayLike, point: ArrayLike | None = None) -> None:
        """Add a force for the next step; it and its torque stay constant during that step.

        Args:
            force: (2,), in world axes [N].
            point: where it acts, (2,) in world axes [m]; the centre of mass if left out.

        Raises:
            ValueError: not two finite numbers.
        """
        f = vector("force", force, (2,), unit="N")
        p = self.state[:2] if point is None else vector("point", point, (2,), unit="m")
        # The moment about the centre is the component of arm x force along z.
        arm = p - self.state[:2]
        self.force = self.force + f
        self.torque += float(arm[0] * f[1] - arm[1] * f[0])

    def step(
        self,
        dt: float,
        gravity: ArrayLike = STANDARD_GRAVITY,
        integrator: str = "semi_implicit_euler",
    ) -> None:
        """Advance by dt and clear the collected force; see `advance_boxes` for the arguments.

        Raises:
            ValueError: an argument, or an attribute set since, is out of its range.
        """
        state, counts = advance_boxes(
            vector("state", self.state, (6,)).reshape(6, 1),
            self.parameters,
            dt,
            1,
            gravity=gravity,
            forces=np.array([self.force[0], self.force[1], self.torque]),
            integrator=integrator,
            resolve_impacts=self.resolve_impacts,
            ground=self.ground,
            max_events=self.max_events,
        )
        self.state = state[:, 0].copy()
        self.impacts += int(counts[0, 0])
        self.unresolved += int(counts[1, 0])
        self.force = np.zeros(2)
        self.torque = 0.0

    def energy(self, gravity: ArrayLike = STANDARD_GRAVITY) -> tuple[float, float, float]:
        """Return (kinetic, potential, total) [J].

        The potential is zero for the centre at the origin.
        """
        gx, gy = _gravity(gravity)
        x, y, _, vx, vy, omega = self.state.tolist()
        inertia = float(self.parameters[3, 0])
        kinetic = 0.5 * self.mass * (vx * vx + vy * vy) + 0.5 * inertia * omega * omega
        potential = -self.mass * (gx * x + gy * y)
        return kinetic, potential, kinetic + potential
