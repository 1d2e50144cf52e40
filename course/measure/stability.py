"""Where does a method fail? Limits by bisection, and maps.

Two detectors. `amplification` builds the matrix of one step by applying it to unit vectors:
exact, but for linear methods. `is_stable_by_iteration` steps a black box many times and watches
it grow: for anything that steps, a foreign simulator included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, positive

Array = NDArray[np.float64]
Step = Callable[[Array], ArrayLike]


# --- detectors and the search ---------------------------------------------------------------------


def limit(is_stable: Callable[[float], bool], low: float, high: float, rel: float = 1e-4) -> float:
    """Return the largest stable value between `low` and `high`, by bisection.

    Args:
        is_stable: the question; must be yes at `low` and no at `high`, and turn once between.
        low: lower end of the bracket, at least 0.
        high: upper end of the bracket, above `low`.
        rel: relative width at which to stop.

    Returns:
        The middle of the last bracket.

    Raises:
        ValueError: for a bracket that holds no limit, naming the end that is wrong.
    """
    if not 0.0 <= low < high < math.inf:
        raise invalid("(low, high)", (low, high), "0 <= low < high")
    positive("rel", rel)
    if not is_stable(low):
        raise invalid("low", low, "a stable one, which it is not")
    if is_stable(high):
        raise invalid("high", high, "an unstable one, which it is not")
    # Bisection to a relative width; floats that are neighbours end it too.
    while high - low > rel * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if is_stable(middle):
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def amplification(step: Step, n: int) -> Array:
    """Return the matrix of one step of a linear method, from its action on unit vectors.

    Args:
        step: state (n,) -> state (n,).
        n: size of the state.

    Returns:
        The matrix, shape (n, n); infinite entries where the step overflows.

    Raises:
        ValueError: if the step is not linear (then its matrix means nothing).
    """
    count("n", n, 1)
    # The columns of a linear map are its values at the unit vectors.
    matrix = np.stack([np.asarray(step(unit), dtype=float) for unit in np.eye(n)], axis=1)
    if matrix.shape != (n, n):
        raise invalid("step(x).shape", matrix.shape[:1], f"({n},)")
    # A probe off the axes reveals a step that is not linear.
    probe = 1.0 + np.arange(n) / n
    scale = 1.0 + np.abs(matrix) @ probe
    if np.all(np.isfinite(matrix)):
        difference = np.abs(np.asarray(step(probe), dtype=float) - matrix @ probe)
        if not np.all(difference <= 1e-9 * scale):
            raise invalid(
                "step",
                step,
                "a linear function: its value at a sum is not the sum of its values "
                f"(off by {np.max(difference / scale):.1e} of the size)",
            )
    return matrix


def spectral_radius(step_matrix: ArrayLike) -> float:
    """Return the largest modulus of an eigenvalue.

    Growth per step in the long run (inf if not finite).
    """
    matrix = np.asarray(step_matrix, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise invalid("step_matrix.shape", matrix.shape, "that of a square matrix")
    # The eigenvalue solver would raise an error; a step that overflows has no limit to its growth.
    if not np.all(np.isfinite(matrix)):
        return math.inf
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def is_stable_by_matrix(step: Step, n: int, slack: float = 1e-9) -> bool:
    """Return whether a linear step has no growing mode: spectral radius at most 1 + slack."""
    return spectral_radius(amplification(step, n)) <= 1.0 + slack


def grows(sizes: ArrayLike, factor: float = 1.2) -> bool:
    """Return whether a recorded size (a norm, an energy) grows: its second half tops its first.

    Args:
        sizes: non-negative numbers in time order; a NaN or infinity counts as growth.
        factor: how much higher the highest of the second half must be. Near a limit a bounded
            motion beats, so the record must be long enough to show one beat in each half.
    """
    record = np.asarray(sizes, dtype=float)
    if record.ndim != 1 or record.size < 4:
        raise invalid("sizes.shape", record.shape, "(n,) with n at least 4")
    if not np.all(np.isfinite(record)):
        return True
    # A norm may oscillate, so the largest of each half is compared.
    half = record.size // 2
    return bool(np.max(record[half:]) > factor * np.max(record[:half]))


def is_stable_by_iteration(
    step: Step, n: int, steps: int = 4000, factor: float = 1.2, ceiling: float = 1e6
) -> bool:
    """Return whether many steps of a black box stay bounded, started from each unit vector.

    Args:
        step: state (n,) -> state (n,).
        n: size of the state.
        steps: how many to take; growth by less than about 1 / (2 steps) a step goes unseen.
        factor: see `grows`.
        ceiling: a state larger than this has grown; there is no need to run into infinity.
    """
    for unit in np.eye(n):
        state: Array = unit
        sizes = np.empty(steps)
        for i in range(steps):
            state = np.asarray(step(state), dtype=float)
            size = float(np.max(np.abs(state)))
            if not size < ceiling:  # true for NaN as well
                return False
            sizes[i] = size
        if grows(sizes, factor):
            return False
    return True


# --- maps -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Map:
    """A quantity over two parameters, and where it is within its bound of 1.

    Attributes:
        x, y: the parameters, shapes (nx,) and (ny,), ascending.
        values: shape (ny, nx); at most 1 where all is well, infinite where the run overflowed.
        slack: how far above 1 still counts as within (rounding).
        quantity: what the values are, such as "growth per step" or "gain over its bound".
        unit: of the values; empty for a ratio.
        edge: what the line around the points within the bound is, for the legend of a picture.
    """

    x: Array
    y: Array
    values: Array
    slack: float = 1e-9
    quantity: str = "growth per step"
    unit: str = ""
    edge: str = "measured"

    @property
    def label(self) -> str:
        """What the colours of a picture say."""
        # Two values say only on which side a point lies: there is no scale to explain.
        if np.unique(self.values).size == 2:
            return self.quantity
        unit = f" [{self.unit}]" if self.unit else ""
        return f"log10({self.quantity}{unit}): purple below 1, orange above"

    def within(self) -> NDArray[np.bool_]:
        """Return where the quantity keeps to its bound (where nothing grows), shape (ny, nx)."""
        return self.values <= 1.0 + self.slack

    def boundary(self) -> Array:
        """Return for every y the midpoint between the last x within the bound and the first beyond.

        Shape (ny,); 0 where the first x is beyond already, infinity where every x is within.
        """
        edge = np.empty(self.y.size)
        for i, row in enumerate(self.within()):
            if np.all(row):
                edge[i] = math.inf
            else:
                # The first x beyond the bound; the boundary is known to half a spacing of the grid.
                first = int(np.argmin(row))
                edge[i] = 0.0 if first == 0 else 0.5 * (self.x[first - 1] + self.x[first])
        return edge


def stability_map(
    f: Callable[[float, float], float],
    x_values: Sequence[float] | Array,
    y_values: Sequence[float] | Array,
    slack: float = 1e-9,
    quantity: str = "growth per step",
    unit: str = "",
) -> Map:
    """Return a quantity whose bound is 1 at every point of a grid, growth per step for instance.

    Args:
        f: (x, y) -> the quantity, such as the spectral radius of the step's matrix.
        x_values: ascending, shape (nx,).
        y_values: ascending, shape (ny,).
        slack: how far above 1 counts as within the bound.
        quantity: name of what f returns.
        unit: its unit.

    Returns:
        The `Map`; what is not finite becomes infinity.
    """
    x, y = np.asarray(x_values, dtype=float), np.asarray(y_values, dtype=float)
    for name, given in (("x_values", x), ("y_values", y)):
        if given.ndim != 1 or given.size < 2 or not np.all(np.diff(given) > 0.0):
            raise invalid(name, given, "two or more ascending numbers")
    values = np.array([[f(float(a), float(b)) for a in x] for b in y], dtype=float)
    # A run that overflowed grows without bound.
    values[~np.isfinite(values)] = math.inf
    return Map(x, y, values, slack, quantity, unit)


def batch_map(
    step: Callable[[Array, Array, Array, Array], Sequence[Array]],
    x_values: Array,
    y_values: Array,
    slack: float = 1e-9,
    quantity: str = "growth per step",
) -> Map:
    """Return the map of a linear step of one degree of freedom, the whole grid as one batch.

    Args:
        step: (q, v, x, y), each of shape (1, N) -> (q, v) after the step.
        x_values: as for `stability_map`.
        y_values: as for `stability_map`.
        slack: as for `stability_map`.
        quantity: as for `stability_map`.
    """
    x, y = (grid.reshape(1, -1) for grid in np.meshgrid(x_values, y_values))
    one, zero = np.ones(x.shape), np.zeros(x.shape)
    # The two columns of the step's matrix, for all points of the grid at once.
    columns = [np.concatenate(step(q, v, x, y)) for q, v in ((one, zero), (zero, one))]
    # One batched eigenvalue problem: a stack of 2 x 2 matrices.
    moduli = np.abs(np.linalg.eigvals(np.stack(columns, axis=1).transpose(2, 0, 1)))
    growth = np.max(moduli, axis=1).reshape(y_values.size, x_values.size)
    return Map(x_values, y_values, growth, slack, quantity)
