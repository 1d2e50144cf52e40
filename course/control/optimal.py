"""Optimal laws: the linear regulator, and the same with limits over a finite horizon.

x(k+1) = A x(k) + B u(k), cost sum of x^T Q x + u^T R u. Without limits the law is -K x, with K from
the discrete Riccati equation. With limits on u a plan over N samples is a quadratic programme with
a box, small enough to be solved exactly within a sample.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import bounds, count, invalid, vector
from course.compiled import MATRIX, VECTOR, loop

Array = NDArray[np.float64]


# --- Riccati --------------------------------------------------------------------------------------


@register_jitable
def _product(X, Y):
    Z = np.zeros((X.shape[0], Y.shape[1]))
    for i in range(X.shape[0]):
        for k in range(X.shape[1]):
            for j in range(Y.shape[1]):
                Z[i, j] += X[i, k] * Y[k, j]
    return Z


@register_jitable
def _eliminate(M, X):
    """M^-1 X into X, by elimination with row exchange; M is used up."""
    n = M.shape[0]
    for i in range(n):
        best = i
        for r in range(i + 1, n):
            # Partial pivoting: exchange rows so that the pivot is the largest of its column.
            if abs(M[r, i]) > abs(M[best, i]):
                best = r
        for c in range(n):
            M[i, c], M[best, c] = M[best, c], M[i, c]
        for c in range(X.shape[1]):
            X[i, c], X[best, c] = X[best, c], X[i, c]
        for r in range(i + 1, n):
            factor = M[r, i] / M[i, i]
            for c in range(i + 1, n):
                M[r, c] -= factor * M[i, c]
            for c in range(X.shape[1]):
                X[r, c] -= factor * X[i, c]
    # Back substitution.
    for i in range(n - 1, -1, -1):
        for c in range(X.shape[1]):
            for k in range(i + 1, n):
                X[i, c] -= M[i, k] * X[k, c]
            X[i, c] /= M[i, i]


@register_jitable
def _gain(A, B, R, P, K, M):
    """K = (R + B^T P B)^-1 B^T P A and M = A - B K."""
    PB = _product(P, B)
    left, right = _product(np.ascontiguousarray(B.T), PB), _product(np.ascontiguousarray(PB.T), A)
    _eliminate(left + R, right)
    K[:] = right
    M[:] = A - _product(B, K)


def _regulate(A, B, Q, R, P, K, M):
    """Return P, K and M = A - B K, and how many doublings that took; 0 where nothing settles."""
    n = A.shape[0]
    # Structure-preserving doubling algorithm: X -> A, G -> B R^-1 B^T, H -> Q at the start.
    H, X, gain = Q.copy(), A.copy(), np.ascontiguousarray(B.T)
    _eliminate(R.copy(), gain)
    G, count = _product(B, gain), 0
    for k in range(60):
        # W = (I + G H)^-1 [X, G]: one elimination for both.
        N, W = _product(G, H), np.empty((n, 2 * n))
        for i in range(n):
            N[i, i] += 1.0
        W[:, :n], W[:, n:] = X, G
        _eliminate(N, W)
        left, right = W[:, :n].copy(), W[:, n:].copy()
        turned = np.ascontiguousarray(X.T)
        after = _product(turned, _product(H, left))
        G += _product(_product(X, right), turned)
        X = _product(X, left)
        size, change = 0.0, 0.0
        for i in range(n):
            for j in range(i + 1):
                # Symmetrise H and G, so that rounding cannot drive them apart.
                step = 0.5 * (after[i, j] + after[j, i])
                G[i, j] = G[j, i] = 0.5 * (G[i, j] + G[j, i])
                H[i, j] += step
                H[j, i] = H[i, j]
                size, change = max(size, abs(H[i, j])), max(change, abs(step))
        # A mode that no input stops makes H grow without bound.
        if not size < 1e100:
            return 0
        # H has converged to the solution of the Riccati equation, quadratically.
        if change <= 1e-16 * size:
            count = k + 1
            break
    if count == 0:
        return 0
    # One Newton step takes off what the doublings rounded; its Lyapunov equation doubles too.
    _gain(A, B, R, H, K, M)
    X = M.copy()
    turned = np.ascontiguousarray(K.T)
    # Residual of the Riccati equation in the closed-loop form; the sum below is its Lyapunov
    # series, doubled.
    S = Q + _product(turned, _product(R, K)) - H
    S += _product(np.ascontiguousarray(X.T), _product(H, X))
    for _ in range(count):
        S += _product(np.ascontiguousarray(X.T), _product(S, X))
        X = _product(X, X)
    P[:] = H + 0.5 * (S + S.T)
    _gain(A, B, R, P, K, M)
    # It is stable if some power of M is small; one of 2^40 is where a radius of 1 - 1e-12 is.
    X = M.copy()
    for _ in range(42):
        X = _product(X, X)
        size = np.abs(X).max()
        if n * size < 1.0:
            return count
        if not size < 1e100:
            return 0
    return 0


_riccati = loop(_regulate, numba.int64(MATRIX, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX, MATRIX))


def _share(W, shift):
    """Return whether W is symmetric and W + shift I is positive definite, by Cholesky.

    The shift is in units of the largest entry of W.
    """
    n, L = W.shape[0], W.copy()
    size = np.abs(W).max()
    for i in range(n):
        L[i, i] += shift * size
        for j in range(i + 1):
            if abs(W[i, j] - W[j, i]) > 1e-12 * size:
                return False
            # Cholesky factorisation, row by row.
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total < 0.0 or (total == 0.0 and shift < 0.0):
                return False
            else:
                # A pivot of exactly 0 passes for a semidefinite matrix; 1 stands for it in the
                # divisions.
                L[i, i] = np.sqrt(total) if total > 0.0 else 1.0
    return True


_definite = loop(_share, numba.boolean(MATRIX, numba.float64))


class Regulator(NamedTuple):
    """The linear quadratic regulator.

    Attributes:
        K: the law is u = -K x, shape (m, n).
        P: x^T P x is the cost that is left, shape (n, n).
        closed: A - B K, shape (n, n).
        doublings: how many it took: 2^doublings samples of the horizon.
    """

    K: Array
    P: Array
    closed: Array
    doublings: int

    @property
    def radius(self) -> float:
        """Spectral radius of A - B K, below 1."""
        return float(np.abs(np.linalg.eigvals(self.closed)).max())


def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> Regulator:
    """Return the discrete regulator, its Riccati equation solved by doubling.

    Each pass doubles the horizon, so the error is squared (Chu, Fan, Lin and Wang, 2004).

    Args:
        A: state matrix of the sampled system, shape (n, n).
        B: input matrix, shape (n, m).
        Q: weight of the state, symmetric and not negative, shape (n, n).
        R: weight of the input, symmetric and positive, shape (m, m).

    Raises:
        ValueError: for weights that are not so, (A, B) that can't be stabilised, and a mode that
            does not decay and costs nothing.
    """
    A = np.ascontiguousarray(vector("A", A, (None, None)))
    B = vector("B", B, (len(A), None))
    n, m = B.shape
    if A.shape[1] != n:
        raise invalid("A.shape", A.shape, f"({n}, {n})")
    B = np.ascontiguousarray(B)
    Q, R = weight("Q", Q, n, 1e-12), weight("R", R, m, -1e-14)
    P, K, closed = np.empty((n, n)), np.empty((m, n)), np.empty((n, n))
    doublings = _riccati(A, B, Q, R, P, K, closed)
    if not doublings:
        raise _why(A, B, Q)
    return Regulator(K, P, closed, doublings)


def _why(A: Array, B: Array, Q: Array) -> ValueError:
    """Return which mode is at fault (Hautus, 1969).

    With z from 1 on, [A - z I, B] must have full rank.
    """
    n = len(A)
    # Hautus: a mode that does not decay must be seen by B and by Q.
    for z in np.linalg.eigvals(A):
        shifted, small = A - z * np.eye(n), 1e-9 * (1.0 + np.abs(A).max())
        if abs(z) >= 1.0 - 1e-9:
            if np.linalg.svd(np.hstack([shifted, B]), compute_uv=False)[-1] < small:
                text = f"an input that acts on the mode of eigenvalue {z:.4g}: no law can stop it"
                return invalid("B", B, text)
            if np.linalg.svd(np.vstack([shifted, Q]), compute_uv=False)[-1] < small:
                text = f"a weight on the mode of eigenvalue {z:.4g}, which does not decay"
                return invalid("Q", Q, text)
    return invalid("(A, B)", (A.shape, B.shape), "a system whose Riccati equation can be resolved")


def weight(name: str, value: ArrayLike, n: int, shift: float) -> Array:
    """Return a weight matrix (n, n), checked to be symmetric and positive (semi)definite.

    With `shift`, a share of the largest entry, added to its diagonal it must be positive definite:
    a shift a little above 0 admits semidefinite matrices.
    """
    W = np.ascontiguousarray(vector(name, value, (n, n)))
    if not _definite(W, shift):
        kind = "positive definite" if shift < 0.0 else "positive semidefinite"
        raise invalid(name, W, f"a symmetric, {kind} matrix")
    return W


# --- a quadratic programme with a box -------------------------------------------------------------


@register_jitable
def _newton(H, gradient, free, L, step):
    """Return -H^-1 gradient among the free coordinates by Cholesky; whether H is positive there."""
    n = free.size
    for i in range(n):
        # Cholesky on the free rows and columns only, and forward substitution.
        step[i] = 0.0
        if not free[i]:
            continue
        for j in range(i + 1):
            if free[j]:
                total = H[i, j]
                for k in range(j):
                    if free[k]:
                        total -= L[i, k] * L[j, k]
                if i > j:
                    L[i, j] = total / L[j, j]
                elif total > 1e-15 * H[i, i]:
                    L[i, i] = np.sqrt(total)
                else:
                    # The pivot is lost in the rounding of its diagonal entry.
                    return False
        total = -gradient[i]
        for k in range(i):
            if free[k]:
                total -= L[i, k] * step[k]
        step[i] = total / L[i, i]
    # Back substitution.
    for i in range(n - 1, -1, -1):
        if free[i]:
            for k in range(i + 1, n):
                if free[k]:
                    step[i] -= L[k, i] * step[k]
            step[i] /= L[i, i]
    return True


def _box(H, g, low, high, x, free):
    """Write the minimiser into x and which coordinates are free into `free`.

    It returns the iterations, or -1 if H is not positive definite.
    """
    n = x.size
    L, step, trial, gradient = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        x[i] = min(max(x[i], low[i]), high[i])
    for iteration in range(200 + 10 * n):
        # Gradient, and the active set: coordinates held at a bound by the sign of their gradient.
        worst, noise = 0.0, 0.0
        for i in range(n):
            # `size` is the sum of magnitudes, in whose rounding the gradient is lost.
            gradient[i], size = g[i], abs(g[i])
            for j in range(n):
                gradient[i] += H[i, j] * x[j]
                size += abs(H[i, j] * x[j])
            pushed = (x[i] == low[i] and gradient[i] > 0.0) or (
                x[i] == high[i] and gradient[i] < 0.0
            )
            free[i] = not pushed
            if free[i]:
                worst, noise = max(worst, abs(gradient[i])), max(noise, size)
        # Stationary within the rounding of the gradient's own sum.
        if worst <= 4e-16 * noise:
            return iteration
        if not _newton(H, gradient, free, L, step):
            return -1
        # A Newton step bent into the box; halved until the cost falls (Bertsekas, 1982).
        part = 1.0
        while True:
            slope, curve, moved = 0.0, 0.0, False
            for i in range(n):
                trial[i] = min(max(x[i] + part * step[i], low[i]), high[i])
                slope += gradient[i] * (trial[i] - x[i])
                moved = moved or trial[i] != x[i]
            for i in range(n):
                for j in range(n):
                    curve += (trial[i] - x[i]) * H[i, j] * (trial[j] - x[j])
            # Armijo's condition on the quadratic, whose change is slope + curve / 2.
            if slope + 0.5 * curve <= 0.1 * slope or not moved:
                break
            part *= 0.5
        full = part == 1.0
        for i in range(n):
            full = full and (not free[i] or trial[i] == x[i] + step[i])
            x[i] = trial[i]
        # After a whole step inside the box nothing is left but rounding, if no bound lets go.
        if (full and worst <= 1e-9 * noise) or not moved:
            return iteration + 1
    return 200 + 10 * n


_box_loop = loop(
    _box,
    numba.int64(MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, types.Array(numba.boolean, 1, "C")),
)


class BoxQP(NamedTuple):
    """The minimiser x (n,), which coordinates are between their bounds (n,), and iterations."""

    x: Array
    free: NDArray[np.bool_]
    iterations: int


def box_qp(
    H: ArrayLike, g: ArrayLike, low: ArrayLike, high: ArrayLike, start: ArrayLike | None = None
) -> BoxQP:
    """Minimise x^T H x / 2 + g^T x for low <= x <= high.

    It is a projected Newton method with an exact active set.

    Args:
        H: symmetric and positive definite, shape (n, n).
        g: shape (n,).
        low: lower bounds, a number or shape (n,); may be infinite.
        high: upper bounds, likewise.
        start: a guess, such as the last sample's answer; near it one or two steps are enough.

    Raises:
        ValueError: for bounds that cross, an H that is not positive definite, NaN.
    """
    g = np.ascontiguousarray(vector("g", g, (None,)))
    n = count("len(g)", g.size, 1)
    H = vector("H", H, (n, n))
    if np.abs(H - H.T).max() > 1e-9 * np.abs(H).max():
        raise invalid("H", H, "a symmetric matrix")
    least, largest = bounds("low", low, n), bounds("high", high, n)
    if not ((least <= largest) & (least < np.inf) & (largest > -np.inf)).all():
        raise invalid("(low, high)", (low, high), "bounds that do not cross")
    x = np.zeros(n) if start is None else np.array(vector("start", start, (n,)))
    free = np.empty(n, dtype=bool)
    iterations = _box_loop(H := np.ascontiguousarray(H), g, least, largest, x, free)
    # Without an iteration H was never factorised, so its definiteness is still unknown.
    if iterations < 0 or (iterations == 0 and not _definite(H, -1e-15)):
        raise invalid("H", H, "a positive definite matrix")
    return BoxQP(x, free, iterations)


# --- a horizon with limits ------------------------------------------------------------------------


class Horizon(NamedTuple):
    """What `mpc` needs of a system: the cost of a plan U is U^T H U / 2 + (F x)^T U + const.

    Attributes:
        H, F: shapes (N m, N m) and (N m, n).
        inputs: m.
    """

    H: Array
    F: Array
    inputs: int


def horizon(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, samples: int) -> Horizon:
    """Return the quadratic program of model predictive control, with the states eliminated.

    The cost after the last sample is that of the unconstrained regulator.

    With that end the plan is the regulator's wherever no limit binds; arguments as for `lqr`.
    """
    P = lqr(A, B, Q, R).P
    A, B, Q, R = (np.asarray(x, dtype=float) for x in (A, B, Q, R))
    N, (n, m) = count("samples", samples, 1), B.shape
    # Eliminate the states: x_i = A^i x + sum of A^(i - j - 1) B u_j (condensing).
    powers = [np.eye(n)]
    for _ in range(N):
        powers.append(A @ powers[-1])
    free = np.vstack(powers[1:])
    forced = np.zeros((N * n, N * m))
    for i in range(N):
        for j in range(i + 1):
            forced[i * n : (i + 1) * n, j * m : (j + 1) * m] = powers[i - j] @ B
    # Weights of all predicted states, as a block diagonal.
    cost = np.kron(np.eye(N), Q)
    # The terminal cost is the unconstrained regulator's value of the last state.
    cost[-n:, -n:] = P
    H = 2.0 * (forced.T @ cost @ forced + np.kron(np.eye(N), R))
    return Horizon(0.5 * (H + H.T), 2.0 * forced.T @ cost @ free, m)


def mpc(plan: Horizon, x: ArrayLike, limit: ArrayLike, last: Any = None) -> Array:
    """Return the best commands within the limits from a state on, shape (N, m); the first is sent.

    Args:
        plan: what `horizon` returns.
        x: the state, shape (n,).
        limit: of each input both ways, a number or shape (m,).
        last: the plan of the sample before, where this one starts, moved on by a sample.
    """
    m = plan.inputs
    top = bounds("limit", limit, m)
    if not (top > 0.0).all():
        raise invalid("limit", limit, "positive numbers")
    top = np.tile(top, len(plan.H) // m)
    # Warm start: the last plan, one sample later, with its last command repeated.
    start = None if last is None else np.concatenate([last[1:], last[-1:]]).ravel()
    x = vector("x", x, (plan.F.shape[1],))
    return box_qp(plan.H, plan.F @ x, -top, top, start).x.reshape(-1, m)
