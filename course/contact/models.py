"""Contact models: from masses, contacts and a free velocity to the impulses of one step.

A `Problem` is one step: mass matrix M, Jacobian J of the contacts, the velocity v_free that the
bodies would have without contact, gaps, friction. A model answers with one impulse for each row of
J, f, so that v = v_free + M^-1 J^T f. With A = J M^-1 J^T the contacts then move at
u = J v_free + A f.

Coulomb's law asks of each contact f_n >= 0, w_n = u_n - wanted >= 0, f_n w_n = 0, and friction
within |f_t| <= mu f_n that takes out as much as it can. What the models make of it:

- "penalty": spring, damper, friction regularised by a slip speed. Nothing is solved.
- "lcp": a pyramid for the cone, exactly, by Lemke's pivots.
- "pgs": the true cone, contact after contact, a number of sweeps.
- "coulomb": the true cone, by Newton's method on one projection.
- "convex": the cone's own (associated) law, a convex problem with one velocity for an answer; what
  slides also separates, by u_n = mu |u_t| (Anitescu 2006).
- "soft": MuJoCo's, convex and with compliance (`course.contact.soft`).

Inside, rows are scaled by the friction coefficients, g = (f_n, f_t / mu), so that every cone is
|g_t| <= g_n, and sliding, torsion and rolling need no case of their own.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, compiled
from course.contact.problem import Array, Problem, Solution, answer, in_scaled_rows
from course.contact.soft import soft

LAWS = ("coulomb", "convex")


# --- penalty --------------------------------------------------------------------------------------


@register_jitable
def penalty_force(depth, u, stiffness, damping, friction, slip, pull, force):
    """Write the force of one contact into `force` (d,), from depth [m] and velocity u (d,).

    Normal: stiffness times depth less damping times the separation speed. The damper could pull
    separating bodies back (the pull-back artefact), so the force is clipped unless `pull`. Friction
    grows with the slip up to the speed `slip`, and is Coulomb's beyond.

    Args:
        depth: penetration, positive while the bodies overlap [m].
        u: velocity of the contact, first along the normal, positive apart, then the tangents, shape
            (d,) [m/s].
        stiffness: of the spring [N/m].
        damping: of the damper [N s/m].
        friction: coefficients, one for each tangent, shape (d - 1,).
        slip: sliding speed at which friction reaches Coulomb's limit [m/s].
        pull: allow a negative normal force while the bodies part.
        force: output, shape (d,) [N].
    """
    force[:] = 0.0
    if depth <= 0.0:
        return
    force[0] = stiffness * depth - damping * u[0]
    if not pull:
        force[0] = max(force[0], 0.0)
    speed = 0.0
    for j in range(1, u.size):
        speed += (friction[j - 1] * u[j]) ** 2
    # Regularised friction: below the slip speed it grows linearly. The last bound keeps 0 / 0 away.
    if u.size > 1:
        speed = max(math.sqrt(speed), slip * friction[0], 1e-300)
    for j in range(1, u.size):
        force[j] = -max(force[0], 0.0) * friction[j - 1] ** 2 * u[j] / speed


@register_jitable
def penalty_step_limit(zeta):
    """Return the largest stable omega dt of a spring and damper with the damping ratio zeta.

    The step is semi-implicit, with the damper taken from the old velocity; omega is the natural
    frequency. The step's matrix has the determinant 1 - 2 zeta omega dt and the trace
    2 - 2 zeta omega dt - (omega dt)^2; an eigenvalue reaches -1 where trace + determinant = -1.
    """
    return 2.0 * (math.sqrt(1.0 + zeta**2) - zeta)


def penalty(
    problem: Problem,
    *,
    stiffness: float = 1e5,
    damping: float = 1e2,
    slip: float = 1e-3,
    pull: bool = False,
) -> Solution:
    """Return spring, damper and regularised friction, from the state before the step.

    Nothing is solved: the step that follows is stable only while it is short (see the claims), and
    friction that holds creeps.

    Args:
        problem: the contacts before the step.
        stiffness: [N/m].
        damping: [N s/m].
        slip: sliding speed at which friction reaches Coulomb's limit [m/s].
        pull: keep the damper's pull while the bodies part.
    """
    positive("stiffness", stiffness, unit="N/m")
    finite("damping", damping, 0.0)
    positive("slip", slip, unit="m/s")
    # An explicit model: its forces follow from the state before the step.
    u = problem.jacobian @ problem.velocity
    impulses = np.zeros_like(u)
    for i, depth in enumerate(-problem.gap):
        penalty_force(depth, u[i], stiffness, damping, problem.friction[i], slip, pull, impulses[i])
    impulses *= problem.dt
    return Solution("penalty", impulses, problem.after(impulses), 0, 0.0, True)


# --- projected Gauss-Seidel -----------------------------------------------------------------------


@register_jitable
def project(g):
    """Project g (d,) on the cone |g_t| <= g_n, in place."""
    t = 0.0
    for j in range(1, g.size):
        t += g[j] * g[j]
    t = math.sqrt(t)
    if t <= g[0]:
        return
    if t <= -g[0]:  # in the polar cone: the apex is nearest
        g[:] = 0.0
        return
    # Between cone and polar cone the nearest point is on the cone's side, 45 degrees in scaled
    # rows.
    side = 0.5 * (g[0] + t)
    for j in range(1, g.size):
        g[j] *= side / t
    g[0] = side


@register_jitable
def pgs_sweep(A, g, w, d, associated):
    """Return one visit to every contact; returns the largest correction, as a velocity [m/s].

    Args:
        A: of the scaled rows, shape (n d, n d); compliance, if there is some, on its diagonal.
        g: impulses in scaled rows, (n d,), changed in place.
        w: A g + b, with b the velocity without contact; updated in place.
        d: rows of a contact.
        associated: whether the contact is one block, projected on its cone (the convex law).
            Otherwise the normal comes first and friction is cut back to it (Coulomb's law).
    """
    largest = 0.0
    new = np.empty(d)
    for i in range(0, g.size, d):
        # Gershgorin's bounds on the block's eigenvalues: exact where its rows are independent.
        whole, side = 0.0, 0.0
        for j in range(d):
            row = 0.0
            for m in range(d):
                row += abs(A[i + j, i + m])
            whole = max(whole, row)
            if j > 0:
                side = max(side, row - abs(A[i + j, i]))
        # Convex law: normal and friction rows take one gradient step together, then are projected.
        if associated:
            for j in range(d):
                new[j] = g[i + j] - w[i + j] / whole
            project(new)
        else:
            # Coulomb's law: first the normal impulse (Signorini), then friction with the new bound.
            new[0] = max(0.0, g[i] - w[i] / A[i, i])
            moved, length = new[0] - g[i], 0.0
            for j in range(1, d):
                # The change of the normal impulse has already moved the slip: Gauss-Seidel uses it
                # at once.
                slide = w[i + j] + A[i + j, i] * moved
                new[j] = g[i + j] - (slide / side if side > 0.0 else 0.0)
                length += new[j] ** 2
            # Project the friction on the disc |g_t| <= g_n.
            if length > new[0] ** 2:
                for j in range(1, d):
                    new[j] *= new[0] / math.sqrt(length)
        # Update all velocities for the change, so that the next contact sees it.
        for j in range(d):
            change = new[j] - g[i + j]
            if change != 0.0:
                g[i + j] = new[j]
                largest = max(largest, abs(change) * whole)
                for m in range(g.size):
                    w[m] += A[m, i + j] * change
    return largest


@register_jitable
def sweep_until(
    A: Array, b: Array, g: Array, d: int, associated: bool, at_most: int, small: float
) -> int:
    """Return sweeps until the correction is small; returns how many, changes g in place."""
    w = b.copy()
    for i in range(g.size):
        for j in range(g.size):
            w[i] += A[i, j] * g[j]
    for sweep in range(at_most):
        if pgs_sweep(A, g, w, d, associated) <= small:
            return sweep + 1
    return at_most


_PGS = numba.int64(MATRIX, VECTOR, VECTOR, numba.int64, numba.boolean, numba.int64, numba.float64)


def gauss_seidel(
    A: Array, b: Array, g: Array, d: int, *, associated: bool, sweeps: int, tolerance: float
) -> int:
    """Sweep over scaled contacts until no correction is above the tolerance [m/s].

    Args:
        A: scaled response of the contacts, as for `pgs_sweep`.
        b: scaled free velocity, as for `pgs_sweep`.
        g: scaled impulses; changed in place.
        d: rows of a contact.
        associated: as for `pgs_sweep`.
        sweeps: at most.
        tolerance: [m/s].

    Returns:
        How many sweeps it took.
    """
    return int(compiled(sweep_until, _PGS)(A, b, g, d, associated, sweeps, tolerance))


def _movable(problem: Problem) -> NDArray[np.bool_]:
    """Return which contacts can be moved by an impulse, shape (n,).

    A contact between two fixed bodies has rows of zeros. No impulse changes its velocity, and the
    scaled solvers would divide by its response, which is 0.
    """
    return np.any(problem.jacobian, axis=(1, 2))


def _solve_movable(
    solve_rest: Callable[[Problem, Array | None], Solution],
    name: str,
    problem: Problem,
    start: ArrayLike | None,
) -> Solution:
    """Solve without the contacts between fixed bodies, and give those an impulse of zero."""
    n, d, _ = problem.jacobian.shape
    movable = _movable(problem)
    impulses = np.zeros((n, d))
    if not movable.any():
        return Solution(name, impulses, problem.after(impulses), 0, 0.0, True)
    rest = replace(
        problem,
        jacobian=problem.jacobian[movable],
        gap=problem.gap[movable],
        friction=problem.friction[movable],
    )
    first = None if start is None else vector("start", start, (n, d))[movable]
    solution = solve_rest(rest, first)
    impulses[movable] = solution.impulses
    return replace(solution, impulses=impulses)


def pgs(
    problem: Problem,
    *,
    sweeps: int = 1000,
    tolerance: float = 1e-10,
    start: ArrayLike | None = None,
    law: str = "coulomb",
) -> Solution:
    """Solve contacts by projected Gauss-Seidel: one after the other, the other impulses held fixed.

    A sweep updates each contact once and projects its impulse onto the friction cone; sweeps repeat
    until the residual is small.

    Args:
        problem: the contacts and their response.
        sweeps: at most.
        tolerance: of the residual [m/s].
        start: impulses (n, d) to start from, such as those of the last step.
        law: "coulomb", or "convex" for the associated one.
    """
    count("sweeps", sweeps, 1)
    positive("tolerance", tolerance, unit="m/s")
    associated = one_of("law", law, LAWS) == "convex"
    # A contact between two fixed bodies has no response to divide by: solve without it.
    if not _movable(problem).all():
        options: dict[str, Any] = {"sweeps": sweeps, "tolerance": tolerance, "law": law}
        return _solve_movable(
            lambda rest, first: pgs(rest, start=first, **options), "pgs", problem, start
        )
    g = in_scaled_rows(problem, start)
    taken = gauss_seidel(
        problem.scaled,
        problem.offset,
        g,
        problem.jacobian.shape[1],
        associated=associated,
        sweeps=sweeps,
        tolerance=0.1 * tolerance,
    )
    return answer("pgs", problem, g, taken, _missed(problem, g, associated), tolerance)


# --- the linear complementarity problem -----------------------------------------------------------


@functools.cache
def _edges(d: int, edges: int, around: bool) -> Array:
    """Return directions of a pyramid's edges in the scaled friction rows, shape (edges, d - 1)."""
    if d == 3:
        angles = 2.0 * math.pi * (np.arange(edges) + 0.5 * around) / edges
        # Around the cone the sides touch it, so the edges reach beyond it.
        reach = 1.0 / math.cos(math.pi / edges) if around else 1.0
        return np.round(reach * np.column_stack((np.cos(angles), np.sin(angles))), 15)
    return np.repeat(np.eye(d - 1), 2, axis=0) * np.tile([1.0, -1.0], d - 1)[:, None]


def lemke(M: ArrayLike, q: ArrayLike, pivots: int = 1000) -> tuple[Array, int, bool]:
    """Return z >= 0 with w = M z + q >= 0 and z w = 0, by complementary pivots.

    Exact but for rounding; ends on a ray where it finds none, which for a matrix that is
    copositive plus means that there is none (Cottle, Pang and Stone 1992, alg. 4.4.5).

    Returns:
        z (n,), the pivots taken, and whether it is a solution.
    """
    q = vector("q", q, (None,))
    n = q.size
    M = vector("M", M, (n, n))
    if n == 0 or np.min(q) >= 0.0:
        return np.zeros(n), 0, True
    # Columns: w, z, the artificial z0, right side with powers of a small number beside it, by
    # which ties are broken (lexicographically), so that it cannot cycle.
    table = np.hstack((np.eye(n), -M, -np.ones((n, 1)), q[:, None], np.eye(n)))
    basis = np.arange(n)
    # The artificial variable enters at the row that is most infeasible, which makes all feasible.
    entering, row = 2 * n, int(np.argmin(q))
    small = 1e-12 * max(1.0, float(np.max(np.abs(M))))
    taken, leaving = 0, -1
    while taken < pivots:
        taken += 1
        leaving = int(basis[row])
        # Pivot: solve the row for the entering variable and eliminate it from the others.
        table[row] /= table[row, entering]
        others = np.arange(n) != row
        table[others] -= np.outer(table[others, entering], table[row])
        basis[row] = entering
        if leaving == 2 * n:
            break
        # Complementarity: the partner of the variable that has left enters next.
        entering = leaving + n if leaving < n else leaving - n
        can = np.flatnonzero(table[:, entering] > small)
        # No ratio bounds the entering variable: a secondary ray, Lemke's method fails.
        if not can.size:
            break
        # Ratio test, with lexicographic ties.
        ratios = table[can, 2 * n + 1 :] / table[can, entering][:, None]
        least = ratios[:, 0] <= np.min(ratios[:, 0]) + 1e-14 * np.max(np.abs(q))
        tied = can[least]
        # The artificial variable leaves as soon as it can.
        row = int(next((r for r in tied if basis[r] == 2 * n), tied[0]))
        if tied.size > 1 and basis[row] != 2 * n:
            row = int(tied[np.lexsort(ratios[least][:, :0:-1].T)[0]])
    z = np.zeros(2 * n + 1)
    z[basis] = table[:, 2 * n + 1]
    return z[n : 2 * n], taken, leaving == 2 * n


def lcp(
    problem: Problem, *, edges: int = 4, around: bool = False, tolerance: float = 1e-9
) -> Solution:
    """Solve Coulomb's law with a friction pyramid exactly, by Lemke's method.

    The formulation is that of Stewart and Trinkle (1996) and of Anitescu and Potra (1997).

    Unknowns: normal impulse, share on each edge, and the slip that the edges have in common.

    Args:
        problem: the contacts and their response.
        edges: of the pyramid where there are two tangents, an even number from 4 on; else each
            friction row has two.
        around: whether the pyramid stands around the cone instead of in it; with four edges
            friction then has a limit on each axis by itself, a box.
        tolerance: of the residual [m/s].
    """
    if count("edges", edges, 4) % 2:
        raise invalid("edges", edges, "an even number of at least 4")
    n, d, _ = problem.jacobian.shape
    faces = _edges(d, edges, around) if d > 1 else np.zeros((0, 0))
    m = len(faces)
    # B: normal and edges of every contact -> its scaled rows.
    one = np.zeros((d, 1 + m))
    one[0, 0], one[1:, 1:] = 1.0, faces.T
    B = np.kron(np.eye(n), one)
    # Impulses times the mean response along normals: all unknowns and residuals are speeds, and
    # the pivots don't depend on the unit of mass.
    stiff = float(np.mean(np.diag(problem.scaled)[::d])) or 1.0
    M, q, size = B.T @ problem.scaled @ B / stiff, B.T @ problem.offset, B.shape[1]
    if m:
        # The slip of a contact raises all its edges; their shares are at most its normal impulse.
        raised = np.kron(np.eye(n), np.append(0.0, np.ones(m)))
        remaining = np.kron(np.eye(n), np.append(1.0, -np.ones(m)))
        M, q = np.block([[M, raised.T], [remaining, np.zeros((n, n))]]), np.append(q, np.zeros(n))
    z, pivots, _ = lemke(M, q)
    # The natural residual min(z, w) of the complementarity problem, zero exactly at a solution.
    worst = float(np.max(np.abs(np.minimum(z, M @ z + q))))
    return answer("lcp", problem, B @ z[:size] / stiff, pivots, worst, tolerance)


# --- the round cone: Newton's method on the natural map -------------------------------------------


def natural_map(A: Array, b: Array, g: Array, d: int, associated: bool) -> tuple[Array, Array]:
    """Return the residual r (g - P(g - w / r)) of all contacts and its derivative by g.

    The residual has shape (n d,) [m/s], its derivative (n d, n d). It is 0 exactly at a solution.
    P projects each contact's part on its cone, in scaled rows the cone |g_t| <= g_n. The map is
    that of Facchinei and Pang (2003, sec. 1.5), its use for contact that of Alart and Curnier
    (1991).

    Args:
        A: scaled response, as for `pgs_sweep` [m/s for an impulse of 1].
        b: scaled free velocity, as for `pgs_sweep` [m/s].
        g: scaled impulses, (n d,).
        d: rows of a contact.
        associated: true for the convex law; Coulomb's law replaces the normal velocity w_n by w_n +
            |w_t| (De Saxce's correction).
    """
    w = A @ g + b
    value, slope = np.empty_like(g), np.empty_like(A)
    for i in range(0, g.size, d):
        here = slice(i, i + d)
        change = A[here].copy()
        raised = w[here].copy()
        if not associated and d > 1:
            # De Saxce's correction turns Coulomb's law into a complementarity over cones.
            slip = math.sqrt(w[i + 1 : i + d] @ w[i + 1 : i + d])
            raised[0] += slip
            if slip > 0.0:
                change[0] += w[i + 1 : i + d] / slip @ A[i + 1 : i + d]
        # Any r > 0 has the same zeros; the trace of the block puts both terms on one scale.
        # A contact that no impulse moves has no scale, and 1 does as well.
        r = float(np.trace(A[here, here])) or 1.0
        y = g[here] - raised / r
        t = math.sqrt(y[1:] @ y[1:])
        if t <= y[0]:  # sticks
            bend = np.eye(d)
        elif t <= -y[0]:  # lets go
            bend = np.zeros((d, d))
        else:  # slides: the projection on the cone's side
            bend = (1.0 + y[0] / t) * np.eye(d)
            bend[0, 0] = 1.0
            bend[0, 1:] = bend[1:, 0] = y[1:] / t
            bend[1:, 1:] -= y[0] / t**3 * np.outer(y[1:], y[1:])
            bend *= 0.5
        project(y)
        value[here] = r * (g[here] - y)
        slope[here] = bend @ change
        slope[here, here] += r * (np.eye(d) - bend)
    return value, slope


def defect(problem: Problem, impulses: ArrayLike, law: str = "coulomb") -> float:
    """Return the violation of one of the `LAWS` by impulses (n, d) [m/s], 0 if they solve it.

    r |g - P(g - w / r)|, the largest over the contacts, r the trace of the contact's block of A, P
    the projection on the cone (the natural map; Facchinei and Pang 2003, sec. 1.5). Coulomb's law
    has w_n + |w_t| in place of w_n (De Saxce and Feng 1998).
    """
    g = in_scaled_rows(problem, vector("impulses", impulses, problem.jacobian.shape[:2]))
    return _missed(problem, g, one_of("law", law, LAWS) == "convex")


def _missed(problem: Problem, g: Array, associated: bool) -> float:
    """Return `defect` of impulses in scaled rows."""
    d = problem.jacobian.shape[1]
    return float(np.max(np.abs(natural_map(problem.scaled, problem.offset, g, d, associated)[0])))


def _round_cone(
    name: str, problem: Problem, rounds: int, tolerance: float, start: ArrayLike | None
) -> Solution:
    """Return sweeps to come near, Newton's method to arrive; again while it does not."""
    count("rounds", rounds, 1)
    positive("tolerance", tolerance, unit="m/s")
    if not _movable(problem).all():
        return _solve_movable(
            lambda rest, first: _round_cone(name, rest, rounds, tolerance, first),
            name,
            problem,
            start,
        )
    A, b, d = problem.scaled, problem.offset, problem.jacobian.shape[1]
    associated = name == "convex"
    g = in_scaled_rows(problem, start)
    taken, best, best_g = 0, math.inf, g
    for attempt in range(rounds):
        # Semismooth Newton with a backtracking line search on the norm of the residual.
        value, slope = natural_map(A, b, g, d, associated)
        for _ in range(30):
            size = float(np.max(np.abs(value)))
            if size < best:
                best, best_g = size, g
            if size <= 0.01 * tolerance:
                break
            taken += 1
            # Least squares: at a kink, or with redundant contacts, the slope may be singular.
            step = np.linalg.lstsq(slope, -value, rcond=1e-13)[0]
            share, fell = 1.0, False
            while share > 1e-3 and not fell:
                near = g + share * step
                value_near, slope_near = natural_map(A, b, near, d, associated)
                # Armijo's condition with a tenth of the predicted decrease.
                goal = (1.0 - 0.1 * share) * np.linalg.norm(value)
                fell = bool(np.linalg.norm(value_near) < goal)
                share *= 0.5
            if not fell:
                break
            g, value, slope = near, value_near, slope_near
        if best <= tolerance:
            break
        # Newton is stuck: sweeps move it to another piece, twice as many each time.
        g = best_g.copy()
        sweeps = 20 * 2**attempt
        taken += gauss_seidel(A, b, g, d, associated=associated, sweeps=sweeps, tolerance=1e-15)
    return answer(name, problem, best_g, taken, best, tolerance)


def convex(
    problem: Problem, *, rounds: int = 12, tolerance: float = 1e-9, start: ArrayLike | None = None
) -> Solution:
    """Return the associated law: the least change of the velocity that keeps it in the dual cones.

    Args:
        problem: the contacts and their response.
        rounds: of sweeps and Newton steps, at most.
        tolerance: of the residual [m/s], and of the duality gap by the sum of normal impulses.
        start: impulses (n, d) to start from.
    """
    if not _movable(problem).all():
        return _solve_movable(
            lambda rest, first: convex(rest, rounds=rounds, tolerance=tolerance, start=first),
            "convex",
            problem,
            start,
        )
    result = _round_cone("convex", problem, rounds, tolerance, start)
    # A check beside the residual: by strong duality the gap is zero at the optimum.
    gap, outside = duality_gap(problem, result.impulses)
    small = max(abs(gap) / max(float(np.sum(result.impulses[:, 0])), 1e-12), outside) <= tolerance
    return replace(result, converged=result.converged and small)


def coulomb(
    problem: Problem, *, rounds: int = 8, tolerance: float = 1e-9, start: ArrayLike | None = None
) -> Solution:
    """Solve Coulomb's law on the true cone with a semismooth Newton method.

    The formulation is that of Alart and Curnier (1991), with De Saxce's single projection.

    Where the law has no solution there is none to find, and it says so.

    Args:
        problem: the contacts and their response.
        rounds: of sweeps and Newton steps, at most.
        tolerance: of the residual [m/s].
        start: impulses (n, d) to start from.
    """
    return _round_cone("coulomb", problem, rounds, tolerance, start)


def duality_gap(problem: Problem, impulses: ArrayLike) -> tuple[float, float]:
    """Return the duality gap of the convex problem, for impulses in their cones.

    It is the primal cost minus the bound that the dual gives.

    Returns:
        The gap f w [J], and by how much w is outside its cone [m/s]: only within it a bound.
    """
    g = in_scaled_rows(problem, impulses)
    w = problem.scaled @ g + problem.offset
    rows = w.reshape(problem.jacobian.shape[:2])
    outside = np.linalg.norm(rows[:, 1:], axis=1) - rows[:, 0]
    return float(g @ w), float(max(0.0, np.max(outside)))


# --- the door ------------------------------------------------------------------------------------

Model = Callable[..., Solution]
MODELS: dict[str, Model] = {
    "penalty": penalty,
    "lcp": lcp,
    "pgs": pgs,
    "coulomb": coulomb,
    "convex": convex,
    "soft": soft,
}


def solve(model: str, problem: Problem, **options: Any) -> Solution:
    """Return the impulses of one step by one of `MODELS`; look at `converged` before you use them.

    Options are those of the model's function.

    Raises:
        ValueError: for an unknown model.
        TypeError: for an option that the model has not.
    """
    one_of("model", model, MODELS)
    return MODELS[model](problem, **options)


def warm() -> None:
    """Compile, or load from the cache, what is compiled here."""
    gauss_seidel(np.eye(1), np.zeros(1), np.zeros(1), 1, associated=False, sweeps=1, tolerance=1.0)
