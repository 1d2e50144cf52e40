"""The question that every contact model answers: one step of bodies that touch."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, positive, vector

Array = NDArray[np.float64]

MAX_RECOVERY_SPEED = 1.0  # m/s


@register_jitable
def least_speed(gap, free, before, dt, restitution, recovery, fastest):
    """Return the separating speed that a contact must have after the step [m/s].

    It follows from the gap and the normal velocities without contact and before the step: an open
    gap may just close, and a closing one bounces.
    """
    # Baumgarte stabilisation: a share of the depth a step, at a bounded speed. Without the bound a
    # shorter step would throw out what starts deep all the faster.
    desired = -gap / dt if gap > 0.0 else min(-recovery * gap / dt, fastest)
    # Newton's restitution, where the gap would close in this step and the bodies approach.
    if gap + dt * free <= 0.0 and restitution * before < 0.0:
        desired = max(desired, -restitution * before)
    return desired


@dataclass(frozen=True)
class Problem:
    """One step of some bodies with n contacts of d rows each, and nv degrees of freedom.

    Attributes:
        mass: M, shape (nv, nv), symmetric and positive definite.
        jacobian: J, shape (n, d, nv): generalised velocity -> velocity of the contact; row 0 along
            the normal (positive: apart) [m/s], then tangents, then spin and rolling [rad/s].
        velocity: generalised velocity before the step, shape (nv,).
        free: what it would be after the step without contact, shape (nv,).
        gap: signed distance before the step, shape (n,) [m].
        friction: coefficient of each row after the first, shape (n, d - 1) [1, or m for rotations].
        dt: step [s].
        restitution: Newton's coefficient, 0 to 1.
        recovery: share of a penetration that is to be taken back in the step, 0 to 1 (Baumgarte
            stabilisation).
        max_recovery_speed: at most, whatever the share asks for [m/s].

    Raises:
        ValueError: for numbers or shapes that are none of this.
    """

    mass: Array
    jacobian: Array
    velocity: Array
    free: Array
    gap: Array
    friction: Array
    dt: float
    restitution: float = 0.0
    recovery: float = 0.2
    max_recovery_speed: float = MAX_RECOVERY_SPEED

    def __post_init__(self) -> None:
        # The class is frozen: checked arrays are set past it.
        selected = functools.partial(object.__setattr__, self)
        selected("jacobian", vector("jacobian", self.jacobian, (None, None, None)))
        n, d, nv = self.jacobian.shape
        if not n or not d:
            raise invalid("jacobian.shape", self.jacobian.shape, "one or more contacts with rows")
        selected("mass", vector("mass", self.mass, (nv, nv)))
        try:
            # Cholesky's factorisation exists exactly for a positive definite matrix.
            np.linalg.cholesky(self.mass)
        except np.linalg.LinAlgError:
            raise invalid("mass", self.mass, "a positive definite matrix") from None
        # The factorisation reads one triangle only, so symmetry needs its own check.
        if np.max(np.abs(self.mass - self.mass.T)) > 1e-9 * np.max(np.abs(self.mass)):
            raise invalid("mass", self.mass, "a symmetric matrix")
        selected("friction", vector("friction", self.friction, (n, d - 1), low=0.0))
        positive("dt", self.dt, unit="s")
        finite("restitution", self.restitution, 0.0, 1.0)
        finite("recovery", self.recovery, 0.0, 1.0)
        if not self.max_recovery_speed >= 0.0:  # infinite where there is none
            raise invalid("max_recovery_speed", self.max_recovery_speed, "0 or more [m/s]")
        for name, size in (("velocity", nv), ("free", nv), ("gap", n)):
            selected(name, vector(name, getattr(self, name), (size,)))

    def moved(self, velocity: ArrayLike, free: ArrayLike, gap: ArrayLike) -> Problem:
        """Return the same bodies and contacts in another state.

        Whatever depends on M and J alone is reused.
        """
        # Past `__init__`: M and J are not checked again, and what was computed from them comes
        # along.
        other = object.__new__(Problem)
        nv, n = self.mass.shape[0], self.gap.size
        other.__dict__.update(
            self.__dict__,
            velocity=vector("velocity", velocity, (nv,)),
            free=vector("free", free, (nv,)),
            gap=vector("gap", gap, (n,)),
        )
        return other

    @functools.cached_property
    def rows(self) -> Array:
        """J with all rows below each other, shape (n d, nv)."""
        return np.ascontiguousarray(self.jacobian.reshape(-1, self.mass.shape[0]))

    @functools.cached_property
    def response(self) -> Array:
        """M^-1 J^T: generalised velocity for an impulse on each row, shape (nv, n d)."""
        # A solve with M for each row of J; M is not inverted.
        return np.asarray(np.linalg.solve(self.mass, self.rows.T), dtype=np.float64)

    @functools.cached_property
    def delassus(self) -> Array:
        """A = J M^-1 J^T, shape (n d, n d)."""
        return self.rows @ self.response

    @functools.cached_property
    def scale(self) -> Array:
        """1 for a normal row, the friction coefficient for the others, shape (n d,)."""
        n = self.gap.size
        return np.hstack((np.ones((n, 1)), self.friction)).ravel()

    @functools.cached_property
    def scaled(self) -> Array:
        """A in scaled rows."""
        return self.scale[:, None] * self.delassus * self.scale

    @property
    def target_velocity(self) -> Array:
        """Least normal velocity after the step, shape (n,) [m/s]."""
        free, before = self.jacobian[:, 0] @ self.free, self.jacobian[:, 0] @ self.velocity
        how = self.dt, self.restitution, self.recovery, self.max_recovery_speed
        rows = zip(self.gap, free, before, strict=True)
        return np.array([least_speed(*row, *how) for row in rows])

    @property
    def offset(self) -> Array:
        """b: contact velocity without contact, less what is wanted, in scaled rows, (n d,)."""
        b = self.scale * (self.rows @ self.free)
        # Normal rows are measured from the least separating speed: Signorini's condition on
        # velocities.
        b[:: self.jacobian.shape[1]] -= self.target_velocity
        return b

    def after(self, impulses: ArrayLike) -> Array:
        """Return generalised velocity after the step, (nv,), for impulses (n, d)."""
        velocity: Array = self.free + self.response @ np.asarray(impulses, dtype=float).ravel()
        return velocity


@dataclass(frozen=True)
class Solution:
    """What a model answers.

    Attributes:
        model: its name.
        impulses: shape (n, d), in the rows of J [N s, N m s].
        velocity: generalised velocity after the step, shape (nv,).
        iterations: pivots, sweeps or Newton steps.
        residual: how far its own law is missed, see the model [m/s].
        converged: whether the residual is within the requested tolerance. If not, the
            impulses are the last ones there were, and no solution.
    """

    model: str
    impulses: Array
    velocity: Array
    iterations: int
    residual: float
    converged: bool

    def __str__(self) -> str:
        how = "solved" if self.converged else "NOT solved"
        return f"{self.model}: {how} in {self.iterations}, residual {self.residual:.1e} m/s"


def answer(
    name: str, problem: Problem, scaled: Array, iterations: int, missed: float, tolerance: float
) -> Solution:
    """Return a solution from impulses in scaled rows (n d,)."""
    n, d, _ = problem.jacobian.shape
    # Back from scaled rows: friction gets its coefficients again.
    impulses = (problem.scale * scaled).reshape(n, d)
    velocity = problem.after(impulses)
    return Solution(name, impulses, velocity, iterations, missed, missed <= tolerance)


def in_scaled_rows(problem: Problem, impulses: ArrayLike | None) -> Array:
    """Return impulses (n, d) in scaled rows, (n d,); zeros where there are none."""
    n, d, _ = problem.jacobian.shape
    if impulses is None:
        return np.zeros(n * d)
    f, scale = vector("start", impulses, (n, d)).ravel(), problem.scale
    # A row without friction has no scaled impulse; 0 / 0 is taken as 0.
    return np.divide(f, scale, out=np.zeros_like(f), where=scale > 0.0)
