"""The smallest scenes that the contact models are asked about.

All of them have a constant mass matrix and a constant contact Jacobian, so a gap is linear in q:
what differs between models is the contact alone. `run` steps one with a model, semi-implicitly.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from course.check import POSITIVE, count, finite, positive, vector
from course.compiled import MATRIX, VECTOR, compiled
from course.contact.models import solve, sweep_until
from course.contact.problem import MAX_RECOVERY_SPEED, Problem, Solution, least_speed

Array = NDArray[np.float64]
GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class Scene:
    """Bodies with linear gaps under a constant force.

    Attributes:
        mass: (nv, nv).
        jacobian: (n, d, nv), as in `Problem`.
        distance: gaps at q = 0, shape (n,) [m].
        force: generalised, (nv,).
        friction: (n, d - 1).
        q, v: state at the start, (nv,).
        restitution: Newton's coefficient.
        recovery, max_recovery_speed: share of a penetration that a step takes back, and the speed
            that it may use for it [m/s], as in `Problem`.
    """

    mass: Array
    jacobian: Array
    distance: Array
    force: Array
    friction: Array
    q: Array
    v: Array
    restitution: float = 0.0
    recovery: float = 0.2
    max_recovery_speed: float = MAX_RECOVERY_SPEED

    @functools.cached_property
    def _first(self) -> Problem:
        return Problem(
            self.mass,
            self.jacobian,
            self.v,
            self.v,
            self.distance,
            self.friction,
            1.0,
            self.restitution,
            self.recovery,
            self.max_recovery_speed,
        )

    @functools.cached_property
    def _acceleration(self) -> Array:
        return np.asarray(np.linalg.solve(self.mass, self.force), dtype=np.float64)

    def problem(self, dt: float, q: Array | None = None, v: Array | None = None) -> Problem:
        """Return one step of `dt` from (q, v), or from the start."""
        q, v = self.q if q is None else q, self.v if v is None else v
        positive("dt", dt, unit="s")
        # The Jacobian is constant, so the gaps are linear in q.
        gap = self.distance + self.jacobian[:, 0] @ q
        step = self._first.moved(v, v + dt * self._acceleration, gap)
        # Past the frozen class: `replace` would check everything again.
        object.__setattr__(step, "dt", dt)
        return step


@dataclass(frozen=True)
class Run:
    """Record of a motion.

    It holds times (k,), q and v (nv, k), impulses (n, d, k - 1), the iterations of all steps, the
    number of steps that were not solved, and the worst residual [m/s].
    """

    times: Array
    q: Array
    v: Array
    impulses: Array
    iterations: int
    unsolved: int
    worst: float


def run(scene: Scene, model: str, dt: float, steps: int, **options: Any) -> Run:
    """Run so many steps of `dt` [s].

    Impulses from one of `MODELS` with its options, then the position with the new velocity.
    """
    count("steps", steps, 1)
    q, v = scene.q.copy(), scene.v.copy()
    path_q, path_v = [q], [v]
    result: list[Solution] = []
    for _ in range(steps):
        # Semi-implicit Euler: the model's impulses give the new velocity, which moves the position.
        result.append(solve(model, scene.problem(dt, q, v), **options))
        v = result[-1].velocity
        q = q + dt * v
        path_q.append(q)
        path_v.append(v)
    return Run(
        np.arange(steps + 1, dtype=float) * dt,
        np.array(path_q).T,
        np.array(path_v).T,
        np.stack([s.impulses for s in result], axis=-1),
        sum(s.iterations for s in result),
        sum(not s.converged for s in result),
        max(s.residual for s in result),
    )


def march(
    scene: Scene, dt: float, steps: int, *, sweeps: int = 1000, tolerance: float = 1e-10
) -> tuple[Array, Array, int]:
    """Simulate as `run` with "pgs" does, in one compiled loop with a warm start.

    Each step's projected Gauss-Seidel starts from the impulses of the step before. In a resting
    stack they hardly change, so that later steps need fewer sweeps than the first.

    Args:
        scene: bodies, contacts and the state at the start.
        dt: step [s].
        steps: number of steps.
        sweeps: largest number of sweeps over all contacts in one step.
        tolerance: a step ends once a sweep corrects no contact velocity by more [m/s].

    Returns:
        Positions q (nv,) and velocities v (nv,) at the end, and the sweeps of all steps together.

    Raises:
        ValueError: for an argument that is not positive.
    """
    count("steps", steps, 1)
    count("sweeps", sweeps, 1)
    positive("tolerance", tolerance, unit="m/s")
    # A scene's Jacobian and mass are constant, so the matrices of the first step serve them all.
    first = scene.problem(dt)
    q, v = scene.q.copy(), scene.v.copy()
    # In the order in which `_march` unpacks them.
    bounds = np.array([dt, scene.restitution, first.recovery, first.max_recovery_speed, tolerance])
    sweeps_made = compiled(_march, _MARCH)(
        first.scaled,
        first.scale,
        first.rows,
        np.ascontiguousarray(first.response),
        scene.distance,
        scene._acceleration,
        q,
        v,
        first.jacobian.shape[1],
        steps,
        sweeps,
        bounds,
    )
    # The loop has changed q and v in place.
    return q, v, int(sweeps_made)


def _march(A, scale, rows, response, distance, acceleration, q, v, d, steps, sweeps, bounds):
    """Advance q and v in place by all steps of `march`; return the sweeps that this took.

    With m = n d rows of contacts, d a contact: `rows` (m, nv) is the Jacobian J, `response`
    (nv, m) is M^-1 J^T, `A` (m, m) the Delassus matrix J M^-1 J^T with rows and columns times
    `scale` (m,): 1 for a normal row, the friction coefficient for the others. `distance` (n,) are
    the gaps at q = 0 [m], and `acceleration` (nv,) is the one without contacts.
    """
    dt, restitution, recovery, fastest, tolerance = bounds
    m, nv = rows.shape
    g, b, free = np.zeros(m), np.zeros(m), np.zeros(nv)
    sweeps_made = 0
    for _ in range(steps):
        # Free velocity: gravity and other forces, without contact.
        for j in range(nv):
            free[j] = v[j] + dt * acceleration[j]
        # Contact velocity without contact, in scaled rows, minus the least speed (Stewart and
        # Trinkle).
        for i in range(m):
            b[i] = 0.0
            before, gap = 0.0, distance[i // d]
            for j in range(nv):
                b[i] += scale[i] * rows[i, j] * free[j]
                before += rows[i, j] * v[j]
                gap += rows[i, j] * q[j]
            if i % d == 0:
                b[i] -= least_speed(gap, b[i], before, dt, restitution, recovery, fastest)
        # Warm start: g still holds the impulses of the last step.
        sweeps_made += sweep_until(A, b, g, d, False, sweeps, tolerance)
        # Semi-implicit Euler: the new velocity moves the position.
        for j in range(nv):
            # v = v_free + M^-1 J^T f, with f back from scaled rows.
            v[j] = free[j]
            for i in range(m):
                v[j] += response[j, i] * scale[i] * g[i]
            q[j] += dt * v[j]
    return sweeps_made


_MARCH = numba.int64(
    MATRIX,
    VECTOR,
    MATRIX,
    MATRIX,
    VECTOR,
    VECTOR,
    VECTOR,
    VECTOR,
    numba.int64,
    numba.int64,
    numba.int64,
    VECTOR,
)


# --- the scenes -----------------------------------------------------------------------------------


def ball_drop(height: float = 0.1, mass: float = 1.0, restitution: float = 0.0) -> Scene:
    """Return a ball above the ground: one degree of freedom, q = height of its lowest point [m]."""
    finite("height", height)
    positive("mass", mass, unit="kg")
    return Scene(
        np.array([[mass]]),
        np.ones((1, 1, 1)),
        np.zeros(1),
        np.array([-mass * GRAVITY]),
        np.zeros((1, 0)),
        np.array([height]),
        np.zeros(1),
        restitution,
    )


def block(
    angle: float = 0.0,
    friction: float = 0.5,
    velocity: Sequence[float] = (0.0, 0.0),
    mass: float = 1.0,
) -> Scene:
    """Return a block on an incline, which slides and does not turn.

    q = (along the slope, across, off it).

    The slope has an angle [rad], down along x; the velocity is along it and across [m/s].
    """
    finite("angle", angle, -0.5 * math.pi, 0.5 * math.pi, unit="rad")
    finite("friction", friction, 0.0)
    positive("mass", mass, unit="kg")
    vx, vy = vector("velocity", velocity, (2,), unit="m/s")
    # The normal first, then the tangents along the slope and across it.
    rows = np.array([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    force = mass * GRAVITY * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    return Scene(
        mass * np.eye(3),
        rows,
        np.zeros(1),
        force,
        np.full((1, 2), friction),
        np.zeros(3),
        np.array([vx, vy, 0.0]),
    )


def spinning_disc(spin: float = 10.0, friction: float = 0.5, torsion: float = 0.01) -> Scene:
    """Return a disc of 1 kg and 10 cm that spins [rad/s] on a point: q = (x, y, z, angle about z).

    Torsion is the coefficient against spin [m]; 0 is what a contact of three rows has.
    """
    base = block(0.0, friction)
    rows = np.zeros((1, 4, 4))
    rows[0, :3, :3] = base.jacobian[0]
    rows[0, 3, 3] = 1.0
    return Scene(
        # A disc about its axis: m r^2 / 2.
        np.diag([1.0, 1.0, 1.0, 0.005]),
        rows,
        np.zeros(1),
        np.append(base.force, 0.0),
        np.array([[friction, friction, finite("torsion", torsion, 0.0)]]),
        np.zeros(4),
        np.array([0.0, 0.0, 0.0, finite("spin", spin, unit="rad/s")]),
    )


def tower(masses: Sequence[float]) -> Scene:
    """Return boxes on top of each other, the lowest first.

    q_i = how far each is above its place [m].
    """
    weights = vector("masses", masses, (None,), low=POSITIVE, unit="kg")
    n = count("len(masses)", len(weights), 1)
    # Each gap is the height of a box less that of the box below it.
    rows = (np.eye(n) - np.eye(n, k=-1))[:, None]
    return Scene(
        np.diag(weights),
        rows,
        np.zeros(n),
        -GRAVITY * weights,
        np.zeros((n, 0)),
        np.zeros(n),
        np.zeros(n),
    )


def table(load: Sequence[float] = (0.0, 0.0), side: float = 1.0, mass: float = 10.0) -> Scene:
    """Return a stiff table on four legs, q = (height, roll, pitch).

    Its weight acts at the point `load`.

    Three equations and four legs: one combination, (1, -1, 1, -1) in turn around the table, can be
    added to the forces and nothing moves.

    Args:
        load: where the weight acts, from the middle, within the legs [m].
        side: between the legs [m].
        mass: [kg].
    """
    half = 0.5 * positive("side", side, unit="m")
    x, y = vector("load", load, (2,), low=-half, high=half, unit="m")
    positive("mass", mass, unit="kg")
    legs = np.array([(half, half), (-half, half), (-half, -half), (half, -half)])
    # Height of each leg for small angles: z + y roll - x pitch.
    rows = np.column_stack((np.ones(4), legs[:, 1], -legs[:, 0]))[:, None]
    moment = mass * side**2 / 6.0
    weight = mass * GRAVITY
    return Scene(
        np.diag([mass, moment, moment]),
        rows,
        np.zeros(4),
        np.array([-weight, -weight * y, weight * x]),
        np.zeros((4, 0)),
        np.zeros(3),
        np.zeros(3),
    )


def pinch(squeeze: float = 5.0, friction: float = 0.5, mass: float = 0.2) -> Scene:
    """Return a glass of a given mass [kg] between two fingers.

    q holds x of both fingers, then x and z of the glass.

    The fingers of 50 g squeeze with a force each [N]; it is held from mu = m g / (2 squeeze) on.
    """
    positive("squeeze", squeeze, unit="N")
    finite("friction", friction, 0.0)
    positive("mass", mass, unit="kg")
    # For each finger the gap to the glass, then the glass's vertical slip.
    left = [[-1.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    right = [[0.0, 1.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return Scene(
        np.diag([0.05, 0.05, mass, mass]),
        np.array([left, right]),
        np.zeros(2),
        np.array([squeeze, -squeeze, 0.0, -mass * GRAVITY]),
        np.full((2, 1), friction),
        np.zeros(4),
        np.zeros(4),
    )


def rod(angle: float, friction: float, speed: float = 1.0, spin: float = 0.0) -> Scene:
    """Return Painleve's rod: 1 kg, 2 m, its end on the ground; q = (x, z, angle) of the middle.

    The end is below the middle and to the right of it, and slides to the right. Where
    mu > (1 + 3 cos^2) / (3 sin cos) a normal force, with the friction that it makes, turns the end
    into the ground faster than it lifts the rod.

    Args:
        angle: from the ground [rad].
        friction: coefficient.
        speed: of the end [m/s].
        spin: [rad/s]; its arc lifts the end by sin spin^2.
    """
    finite("angle", angle, 0.0, 0.5 * math.pi, unit="rad")
    s, c = math.sin(angle), math.cos(angle)
    # The end is at (c, -s) from the middle, so the spin adds spin (s, c) to its velocity.
    rows = np.array([[[0.0, 1.0, c], [1.0, 0.0, s]]])
    # Such that the end slides at `speed` and neither rises nor sinks.
    v = np.array([speed - s * spin, -c * spin, spin])
    # A turning rod moves its end along an arc: that acceleration, spin^2 (-c, s), acts too.
    force = np.array([-c * spin**2, -GRAVITY + s * spin**2, 0.0])
    return Scene(
        # A uniform rod about its middle: m l^2 / 12, with 2 m and 1 kg.
        np.diag([1.0, 1.0, 1.0 / 3.0]),
        rows,
        np.zeros(1),
        force,
        np.full((1, 1), finite("friction", friction, 0.0)),
        np.zeros(3),
        v,
    )


def warm() -> None:
    """Compile, or load from the cache, what is compiled here."""
    march(block(), 1e-3, 1)
