"""MuJoCo's contact model: soft, convex, with forces that are unique.

The acceleration a minimises |a - a0|_M^2 / 2 + s(J a - a_ref): it stays near the free one, a0, and
pays for each row that moves otherwise than a spring and damper want, a_ref = -b v - k d r (MuJoCo
4.0 documentation, Computation, Constraint model, and Modeling, Solver parameters). The forces are
-ds. A row's weight is 1 / R; R, (1 - d) / d times the diagonal of A, is a compliance, and the
impedance d says which part of the load is not left to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, one_of, positive, vector
from course.contact.problem import Array, Problem, Solution

_LEAST, _MOST = 1e-4, 0.9999  # mjMINIMP, mjMAXIMP
_TINY, _SMOOTH = 1e-15, 1e-5  # mjMINVAL, mjMINMU: no contact of friction rows is smoother
CONES = ("pyramidal", "elliptic")


@register_jitable
def impedance_at(r, low, high, width, middle, power):
    """Return MuJoCo's impedance d at residuals r: a sigmoid of two powers over the width.

    Args:
        r: gap less margin, shape (n,) [m].
        low: d at r = 0.
        high: d from |r| = width on.
        width: [m].
        middle: share of the width at which both powers meet.
        power: of both, at least 1.

    Returns:
        Shape (n,); between 0.0001 and 0.9999, as MuJoCo clips it.
    """
    # MuJoCo clips its impedance parameters like this.
    low, high = min(max(low, _LEAST), _MOST), min(max(high, _LEAST), _MOST)
    middle, power = min(max(middle, _LEAST), _MOST), max(1.0, power)
    if low == high or width <= _TINY:
        return np.full(r.shape, 0.5 * (low + high))
    x = np.minimum(np.abs(r) / width, 1.0)
    # Two powers that meet at `middle` with the same value and the same slope.
    below = x**power / middle ** (power - 1.0)
    above = 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1.0)
    return low + np.where(x <= middle, below, above) * (high - low)


@register_jitable
def reference_gains(first, second, largest, least):
    """Return (k [1/s^2], b [1/s]) of the reference acceleration from MuJoCo's solref.

    Args:
        first: time constant [s]; zero or less: stiffness with a minus sign [1/s^2].
        second: damping ratio; where first is not positive, damping with a minus sign [1/s].
        largest: impedance beyond the width.
        least: the time constant is at least this [s].
    """
    # MuJoCo's direct format: stiffness and damping themselves, scaled by the impedance.
    if first <= 0.0:
        return -first / largest**2, -second / largest
    # MuJoCo's standard format: a mass-spring-damper with this time constant and damping ratio.
    time = max(first, least)
    return 1.0 / max(_TINY, (largest * time * second) ** 2), 2.0 / max(_TINY, largest * time)


@dataclass(frozen=True)
class Softness:
    """What MuJoCo calls solver parameters, the same for all contacts of a problem.

    Attributes:
        solref: (time constant [s], damping ratio); negative: (-stiffness, -damping) by unit of
            effective mass [1/s^2, 1/s].
        solimp: (d at r = 0, d at r = width, width [m], midpoint, power).
        impratio: how much harder friction is than the normal.
        cone: one of `CONES`.
        margin: distance at which a contact begins to push [m].
        refsafe: whether a positive time constant is raised to 2 dt at least.
        weight: inverse weights of each contact for translation and rotation, (n, 2) [1/kg,
            1/kg m^2], as MuJoCo takes them, from the start pose; None for the diagonal of A as it
            is, which is its flag `diagexact`.
    """

    solref: ArrayLike = (0.02, 1.0)
    solimp: ArrayLike = (0.9, 0.95, 0.001, 0.5, 2.0)
    impratio: float = 1.0
    cone: str = "pyramidal"
    margin: float = 0.0
    refsafe: bool = True
    weight: ArrayLike | None = None

    def __post_init__(self) -> None:
        pair = vector("solref", self.solref, (2,))
        if pair[0] * pair[1] < 0.0 or not pair.any():
            raise invalid("solref", pair, "two positive numbers or two negative ones")
        vector("solimp", self.solimp, (5,), low=0.0)
        positive("impratio", self.impratio)
        one_of("cone", self.cone, CONES)
        finite("margin", self.margin, 0.0, unit="m")

    def impedance(self, r: Array) -> Array:
        """Return d at the residual r = gap - margin [m], shape (n,)."""
        low, high, width, middle, power = np.asarray(self.solimp, dtype=float).tolist()
        return np.asarray(impedance_at(r, low, high, width, middle, power))

    def stiffness(self, solref: ArrayLike, dt: float) -> tuple[float, float]:
        """Return (k [1/s^2], b [1/s]) of the reference acceleration."""
        first, second = np.asarray(solref, dtype=float).tolist()
        largest = float(np.clip(np.asarray(self.solimp, dtype=float)[1], _LEAST, _MOST))
        # refsafe: at least two steps. One contact is stable at a step h below
        # 2 zeta T (sqrt(1 + zeta^2) - zeta), so two steps are enough if zeta is above 1/sqrt(8).
        k, b = reference_gains(first, second, largest, 2.0 * dt if self.refsafe else 0.0)
        return float(k), float(b)


@dataclass(frozen=True)
class Rows:
    """What MuJoCo sees of a problem.

    Rows (m, nv), `reference` and `compliance` R (m,), the contacts that touch, `touching`, `mu` of
    the scaled cone, and `back` (n d, m), row forces -> contact frame.
    """

    rows: Array
    reference: Array
    compliance: Array
    touching: NDArray[np.int64]
    mu: Array
    back: Array


def rows_of(problem: Problem, softness: Softness) -> Rows:
    """Return the rows of the contacts nearer than the margin.

    A pyramid has two for each friction row.
    """
    n, d, nv = problem.jacobian.shape
    touching = np.flatnonzero(problem.gap < softness.margin).astype(np.int64)
    r = (problem.gap - softness.margin)[touching]
    jacobian, mu = problem.jacobian[touching], np.maximum(problem.friction[touching], _SMOOTH)
    impedance = softness.impedance(r)
    k, b = softness.stiffness(softness.solref, problem.dt)
    split = softness.cone == "pyramidal" and d > 1
    m = 2 * (d - 1) if split else d
    frame = np.zeros((touching.size, m, d))  # contact frame -> rows
    # Pyramidal cone: each edge is normal plus or minus mu times a tangent, a row of its own.
    if split:
        frame[:, :, 0] = 1.0
        for j in range(d - 1):
            frame[:, 2 * j, j + 1], frame[:, 2 * j + 1, j + 1] = mu[:, j], -mu[:, j]
    else:
        frame[:] = np.eye(d)
    J = np.einsum("cmd,cdv->cmv", frame, jacobian)
    if softness.weight is None:
        # Diagonal of J M^-1 J^T for the first row of each contact: its inverse effective mass.
        whitened = np.linalg.solve(problem.mass, J.reshape(-1, nv).T).T.reshape(J.shape)
        first = np.sum(J[:, 0] * whitened[:, 0], axis=1)
    else:
        # MuJoCo's own approximation of that diagonal, from the inverse weights of the bodies.
        translation = vector("weight", softness.weight, (n, 2), low=0.0)[touching, 0]
        first = translation * (1.0 + mu[:, 0] ** 2) if split else translation
    # Regularisation R: a row with impedance d takes the share d of the force of a rigid one.
    R = np.maximum(_TINY, (1.0 - impedance) / impedance * first)[:, None] * np.ones(m)
    speed = J @ problem.velocity
    # The reference acceleration of a spring and damper; the impedance scales the stiffness.
    reference = -b * speed - (k * impedance * r)[:, None]
    if split:
        R *= 2.0 * mu[:, :1] ** 2 / softness.impratio
    elif d > 1:
        # Friction rows have no stiffness, and R mu^2 in common.
        reference[:, 1:] = -b * speed[:, 1:]
        R[:, 1:] = R[:, :1] / softness.impratio * (mu[:, :1] / mu) ** 2
    # Forces of the rows to contact frames: the transposed maps, as blocks of one matrix.
    back = np.zeros((n * d, touching.size * m))
    for c, i in enumerate(touching):
        back[i * d : i * d + d, c * m : c * m + m] = frame[c].T
    return Rows(J.reshape(-1, nv), reference.ravel(), R.ravel(), touching, mu, back)


def _forces(rows: Rows, x: Array, elliptic: bool, impratio: float) -> tuple[Array, Array]:
    """Return -ds and its derivative -> (f (m,), H (m, m)) at x = J a - a_ref."""
    D = 1.0 / rows.compliance
    if not elliptic:
        # Every row on its own: a spring that pushes while it accelerates less than its reference.
        pushed = x < 0.0
        return np.where(pushed, -D * x, 0.0), np.diag(np.where(pushed, D, 0.0))
    d = x.size // rows.touching.size
    f, H = np.zeros(x.size), np.zeros((x.size, x.size))
    for c in range(rows.touching.size):
        here = slice(c * d, c * d + d)
        # Scaled so that the cone is round: N along the normal, T the length of the tangential part.
        mu = rows.mu[c, 0] / math.sqrt(impratio)
        scale = np.concatenate(([mu], rows.mu[c]))
        N, *U = (scale * x[here]).tolist()
        T = math.hypot(*U)
        # The three zones of the elliptic cone (Todorov, 2014): free, sticking, sliding.
        if N >= mu * T:  # leaves the cone's dual: no force
            continue
        if mu * N + T <= 0.0:  # sticks: every row a spring
            f[here] = -D[here] * x[here]
            H[here, here] = np.diag(D[here])
            continue
        # It slides: the cost is weight (N - mu T)^2 / 2, and force and Hessian are its derivatives.
        weight = D[c * d] / (mu * mu * (1.0 + mu * mu))
        short, u = N - mu * T, np.array(U) / T
        f[here] = -weight * short * scale * np.concatenate(([1.0], -mu * u))
        block = np.empty((d, d))
        block[0, 0] = 1.0
        block[0, 1:] = block[1:, 0] = -mu * u
        block[1:, 1:] = mu * mu * np.outer(u, u)
        block[1:, 1:] -= mu * short / T * (np.eye(d - 1) - np.outer(u, u))
        H[here, here] = weight * scale[:, None] * block * scale
    return f, H


def soft_forces(
    problem: Problem, softness: Softness, iterations: int = 100
) -> tuple[Array, Array, int, float]:
    """Return Newton's method with a line search on the slope, until rounding stops it.

    Returns:
        Forces of MuJoCo's rows (m,) [N], forces in the contact frames (n, d), the iterations, and
        the velocity that the last step still changed [m/s].
    """
    n, d, _ = problem.jacobian.shape
    rows = rows_of(problem, softness)
    M, J = problem.mass, rows.rows
    elliptic = softness.cone == "elliptic" and d > 1
    free = (problem.free - problem.velocity) / problem.dt
    if not rows.touching.size:
        return np.zeros(0), np.zeros((n, d)), 0, 0.0

    def slope(a: Array) -> tuple[Array, Array, Array]:
        # Gradient of the cost; it vanishes where M (a - a0) = J^T f, the equation of motion.
        f, H = _forces(rows, J @ a - rows.reference, elliptic, softness.impratio)
        return M @ (a - free) - J.T @ f, f, H

    # Newton on the convex cost of the accelerations, from the unconstrained ones.
    a = free
    g, f, H = slope(a)
    small = 1e-16 * (1.0 + float(np.max(np.abs(problem.free))))
    best, remaining, taken, stalled = math.inf, math.inf, 0, 0
    while taken < iterations:
        step = -np.linalg.solve(M + J.T @ H @ J, g)
        remaining = float(np.max(np.abs(step))) * problem.dt
        # A step that is not half as long as the shortest so far brings no progress.
        stalled = stalled + 1 if remaining >= 0.5 * best else 0
        best = min(best, remaining)
        # Near the end only rounding keeps a step from shrinking; before, rows that come and go.
        if remaining <= small or stalled > (2 if remaining < 1e5 * small else 15):
            break
        taken += 1
        # Line search on the slope: double the step until the slope changes sign, then bisect.
        low, high, share, start = 0.0, math.inf, 1.0, float(g @ step)
        for _ in range(40):  # the slope along the step rises with the share: find its zero
            new = slope(a + share * step)
            along = float(new[0] @ step)
            if abs(along) <= 0.1 * abs(start):
                break
            low, high = (share, high) if along < 0.0 else (low, share)
            share = 0.5 * (low + high) if high < math.inf else 2.0 * share
        a, (g, f, H) = a + share * step, new
    return f, (rows.back @ f).reshape(n, d), taken, remaining


def soft(problem: Problem, *, tolerance: float = 1e-9, **options: Any) -> Solution:
    """Return MuJoCo's contact forces, held for the step, from the state before it.

    Args:
        problem: the contacts and their response.
        tolerance: of the residual, the last change of the velocity [m/s].
        **options: fields of `Softness`.
    """
    _, force, taken, remaining = soft_forces(problem, Softness(**options))
    impulses = problem.dt * force
    velocity = problem.after(impulses)
    return Solution("soft", impulses, velocity, taken, remaining, remaining <= tolerance)
