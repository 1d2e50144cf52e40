"""Worked answers of chapter 2, contact: complete, of the size of an interview."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def aabb_contact(a: ArrayLike, b: ArrayLike) -> tuple[float, np.ndarray]:
    """Return overlap of two axis-aligned boxes, and the shortest way out of it along an axis.

    Args:
        a: corners of the first box, rows low and high, shape (2, d) [m].
        b: corners of the second box, shape (2, d) [m].

    Returns:
        (depth, push): the length of the shortest move along one axis that parts the boxes [m],
        negative (minus the largest gap along an axis) when they are apart; the move of b itself,
        shape (d,) [m], zero when they are apart.
    """
    (low_a, high_a), (low_b, high_b) = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    up, down = high_a - low_b, high_b - low_a
    overlap = np.minimum(up, down)
    axis = int(np.argmin(overlap))
    depth, push = float(overlap[axis]), np.zeros(overlap.size)
    if depth > 0.0:
        push[axis] = depth if up[axis] < down[axis] else -depth
    return depth, push


def circle_contact(
    centre_a: ArrayLike, radius_a: float, centre_b: ArrayLike, radius_b: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return gap, normal and point of contact of two circles, at any distance of their centres.

    Args:
        centre_a: of the first circle, shape (2,) [m].
        radius_a: of the first circle [m].
        centre_b: of the second circle, shape (2,) [m].
        radius_b: of the second circle [m].

    Returns:
        (gap, normal, point): negative when they overlap [m]; the unit vector from a to b, (1, 0)
        where the centres coincide, shape (2,); half way between the two surfaces, (2,) [m].
    """
    p, q = np.asarray(centre_a, dtype=float), np.asarray(centre_b, dtype=float)
    x, y = q - p
    distance = math.hypot(x, y)
    # Scaled before it is divided: two tiny numbers keep their ratio.
    size = max(abs(x), abs(y))
    normal = np.array([1.0, 0.0])
    if size > 0.0:
        normal = np.array([x / size, y / size])
        normal = normal / math.hypot(*normal)
    gap = distance - (radius_a + radius_b)
    point = p + (radius_a + 0.5 * gap) * normal
    return gap, normal, point


def pgs_sweep(impulses: ArrayLike, A: ArrayLike, b: ArrayLike, mu: float) -> np.ndarray:
    """Return the impulses after one sweep of projected Gauss-Seidel with friction cones.

    Args:
        impulses: of each contact: normal, then two tangents, shape (n, 3) [N s].
        A: velocity at the contacts by unit impulses, shape (3 n, 3 n) [1/kg].
        b: velocity at the contacts without impulses, shape (3 n,) [m/s].
        mu: coefficient of friction.

    Returns:
        The impulses after the sweep, shape (n, 3) [N s].
    """
    g, A = np.array(impulses, dtype=float), np.asarray(A, dtype=float)
    for i in range(len(g)):
        rows = slice(3 * i, 3 * i + 3)
        velocity = A[rows] @ g.ravel() + np.asarray(b, dtype=float)[rows]
        step = 1.0 / np.linalg.eigvalsh(A[rows, rows])[-1]
        normal, *tangent = g[i] - step * velocity
        slip = math.hypot(*tangent)
        if slip <= mu * normal:
            g[i] = normal, *tangent
        elif mu * slip <= -normal:
            g[i] = 0.0
        else:
            on_cone = (normal + mu * slip) / (1.0 + mu * mu)
            g[i] = on_cone, *(mu * on_cone / slip * np.array(tangent))
    return g


def impact_time(
    place: ArrayLike, velocity: ArrayLike, other: ArrayLike, other_velocity: ArrayLike, reach: float
) -> float:
    """Return when two balls in straight flight touch for the first time.

    Args:
        place: of the first ball's centre, shape (d,) [m].
        velocity: of the first ball, shape (d,) [m/s].
        other: of the second ball's centre, shape (d,) [m].
        other_velocity: of the second ball, shape (d,) [m/s].
        reach: both radii together [m].

    Returns:
        The time [s]; 0 when they overlap now, -1 when they never touch.
    """
    d = np.asarray(other, dtype=float) - np.asarray(place, dtype=float)
    v = np.asarray(other_velocity, dtype=float) - np.asarray(velocity, dtype=float)
    distance = math.sqrt(d @ d)
    c = (distance - reach) * (distance + reach)
    if c <= 0.0:
        return 0.0
    closing, speed_squared = float(-(d @ v)), float(v @ v)
    if closing <= 0.0:
        return -1.0
    # The part of d across v says whether they pass; closing^2 - speed_squared c would cancel.
    across = d + (closing / speed_squared) * v
    root = speed_squared * (reach * reach - float(across @ across))
    if root < 0.0:
        return -1.0
    # The smaller root of speed_squared t^2 - 2 closing t + c = 0.
    return c / (closing + math.sqrt(root))


def contact_step(
    position: ArrayLike, velocity: ArrayLike, slope: float, mu: float, dt: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate a block on an inclined plane by time stepping with one frictional contact.

    Args:
        position: along the slope downwards, and above the plane, shape (2,) [m].
        velocity: along the same axes, shape (2,) [m/s].
        slope: inclination of the plane [rad].
        mu: coefficient of friction.
        dt: step [s].
        steps: how many.

    Returns:
        (position, velocity) at the end, each shape (2,).
    """
    x, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    gravity = 9.81 * np.array([math.sin(slope), -math.cos(slope)])
    for _ in range(steps):
        v = v + dt * gravity
        # Impulses per kilogram: the normal one lets the block just touch at the end of the step.
        normal = max(0.0, -(v[1] + x[1] / dt))
        friction = min(max(-v[0], -mu * normal), mu * normal)
        v = v + np.array([friction, normal])
        x = x + dt * v
    return x, v


def solve_stack(
    product: Callable[..., np.ndarray],
    diagonal: ArrayLike,
    b: ArrayLike,
    mu: ArrayLike,
    layer: ArrayLike,
) -> np.ndarray:
    """Return impulses at the contacts of a stack that obey Coulomb's law.

    Args:
        product: product(x) is A x, shape (2 n,); product(x, rows) is only those rows of it.
        diagonal: of A, the Delassus matrix, shape (2 n,) [1/kg].
        b: velocity at the contacts without impulses, shape (2 n,): for each contact the normal,
            then the tangential component [m/s].
        mu: coefficient of friction of each contact, shape (n,).
        layer: number of the box that rests on each contact, 0 for the lowest box, shape (n,).

    Returns:
        Impulses, shape (n, 2): normal and tangential [N s].
    """
    A = read_by_colours(product, np.repeat(np.asarray(layer), 2))
    size = 1.0 / np.sqrt(np.asarray(diagonal, dtype=float))  # A has a unit diagonal after scaling
    N, T = slice(0, None, 2), slice(1, None, 2)
    friction = np.asarray(mu, dtype=float) * size[N] / size[T]
    A, free = A * np.outer(size, size), np.asarray(b, dtype=float) * size
    scale = float(np.max(np.abs(free)))
    free = free / scale
    # Coulomb's law in the plane as one complementarity problem: 0 <= z, 0 <= M z + q, z (M z + q)
    # = 0. The unknowns are normal impulses, friction to the right and to the left, slip speeds.
    identity, zeros = np.eye(len(friction)), np.zeros((len(friction), len(friction)))
    M = np.block(
        [
            [A[N, N], A[N, T], -A[N, T], zeros],
            [A[T, N], A[T, T], -A[T, T], identity],
            [-A[T, N], -A[T, T], A[T, T], identity],
            [np.diag(friction), -identity, -identity, zeros],
        ]
    )
    q = np.concatenate((free[N], free[T], -free[T], np.zeros(len(friction))))
    normal, right, left, _ = lemke(M, q).reshape(4, -1) * scale
    return np.column_stack((normal * size[N], (right - left) * size[T]))


def read_by_colours(product: Callable[..., np.ndarray], layers: np.ndarray) -> np.ndarray:
    """Return the matrix behind products, whose entries are zero unless layers are neighbours.

    Columns in layers 0, 3, 6, ... have no row in common, so that one product reads one of each
    (Curtis, Powell and Reid 1974).

    Args:
        product: x -> A x.
        layers: of each unknown, integers, shape (m,).

    Returns:
        A, shape (m, m).
    """
    A = np.zeros((len(layers), len(layers)))
    for colour in range(3):
        columns = [np.flatnonzero(layers == k) for k in range(colour, max(layers) + 1, 3)]
        for j in range(max(map(len, columns), default=0)):
            together = [c[j] for c in columns if j < len(c)]
            x = np.zeros(len(layers))
            x[together] = 1.0
            read = product(x)
            for column in together:
                near = np.abs(layers - layers[column]) <= 1
                A[near, column] = read[near]
    return A


def lemke(M: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return z with 0 <= z, 0 <= w = M z + q and z . w = 0, by Lemke's method.

    An artificial variable, whose column is the cover, makes z = 0 feasible. Each pivot lets the
    partner of the variable that left enter, until the artificial one leaves (Lemke 1965; for
    friction Stewart and Trinkle 1996). Where rounding decides a tie wrongly and the method ends on
    a ray, another cover leads along other pivots.

    Args:
        M: copositive, shape (k, k).
        q: shape (k,), with a negative element.

    Returns:
        z, shape (k,).

    Raises:
        ArithmeticError: when the method ends on a ray with every cover.
    """
    k = len(q)
    for spread in (1.0, 2.0, 0.5, 4.0, 0.25):
        cover = 1.0 + np.linspace(0.0, spread, k)  # unequal, so that few ratios are tied
        columns = np.hstack((np.eye(k), -M, -cover[:, None], q[:, None]))  # w, z, artificial, q
        basis = pivot(columns, int(np.argmax(-q / cover)))
        if basis is not None:
            z = np.zeros(2 * k + 1)
            z[basis] = np.linalg.solve(columns[:, basis], q)
            return z[k : 2 * k]
    raise ArithmeticError("Lemke's method ended on a ray with every cover")


def pivot(columns: np.ndarray, row: int) -> np.ndarray | None:
    """Return the basis without the artificial variable, or None after a ray.

    Args:
        columns: of w, of z, of the artificial variable, and the right side, shape (k, 2 k + 2).
        row: of the first variable that leaves for the artificial one.
    """
    k = len(columns)
    table, basis, enter = columns.copy(), np.arange(k), 2 * k
    for count in range(1, 20 * k):
        leave, basis[row] = basis[row], enter
        if leave == 2 * k:
            return basis
        if count % 10 == 0:  # from scratch: otherwise rounding errors grow with mass ratios
            table = np.linalg.solve(columns[:, basis], columns)
        else:
            top = table[row] / table[row, enter]
            table -= np.outer(table[:, enter], top)
            table[row] = top
        enter = int(leave + k) % (2 * k)
        rate, level = table[:, enter], np.maximum(table[:, -1], 0.0)
        ratio = np.full(k, np.inf)
        np.divide(level, rate, out=ratio, where=rate > 1e-9)
        if not np.isfinite(ratio.min()):
            return None
        tied = np.flatnonzero(ratio <= ratio.min() * (1.0 + 1e-9) + 1e-13)
        # Of tied rows the artificial one leaves, else the largest pivot, as it divides.
        row = int(tied[np.argmax(np.where(basis[tied] == 2 * k, np.inf, rate[tied]))])
    return None
