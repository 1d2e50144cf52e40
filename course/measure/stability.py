"""Where does a method fail? Limits by bisection, maps, and what theory says about them.

Two detectors. `amplification` builds the matrix of one step by applying it to unit vectors:
exact, but for linear methods. `is_stable_by_iteration` steps a black box many times and watches
it grow: for anything that steps, a foreign simulator included.

The theory is that of the damped oscillator x'' = -w^2 x - 2 zeta w x'. One step is a matrix
whose entries are polynomials in w h. It is stable while both eigenvalues lie in the closed unit
disc, which for trace T and determinant D means |T| <= 1 + D and D <= 1 (Jury's criterion for a
2 x 2 matrix), so each limit is the smallest root of three polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, one_of, positive, refused

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Step = Callable[[Array], ArrayLike]

OSCILLATOR_METHODS = (
    "explicit_euler",
    "semi_implicit_euler",
    "velocity_verlet",
    "explicit_midpoint",
    "implicit_midpoint",
    "rk4",
)


# --- detectors and the search ---------------------------------------------------------------------


def limit(is_stable: Callable[[float], bool], low: float, high: float, rel: float = 1e-4) -> float:
    """The largest stable value between `low` and `high`, by bisection.

    Args:
        is_stable: the question; must be yes at `low` and no at `high`, and turn once between.
        low, high: the bracket, 0 <= low < high.
        rel: relative width at which to stop.

    Returns:
        The middle of the last bracket.

    Raises:
        ValueError: for a bracket that holds no limit, naming the end that is wrong.
    """
    if not 0.0 <= low < high < math.inf:
        raise refused("(low, high)", (low, high), "0 <= low < high")
    positive("rel", rel)
    if not is_stable(low):
        raise refused("low", low, "a stable one, which it is not")
    if is_stable(high):
        raise refused("high", high, "an unstable one, which it is not")
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
    """The matrix of one step of a linear method, from its action on unit vectors.

    Args:
        step: state (n,) -> state (n,).
        n: size of the state.

    Returns:
        The matrix, shape (n, n); infinite entries where the step overflows.

    Raises:
        ValueError: if the step is not linear (then its matrix means nothing).
    """
    count("n", n, 1)
    matrix = np.stack([np.asarray(step(unit), dtype=float) for unit in np.eye(n)], axis=1)
    if matrix.shape != (n, n):
        raise refused("step(x).shape", matrix.shape[:1], f"({n},)")
    probe = 1.0 + np.arange(n) / n
    scale = 1.0 + np.abs(matrix) @ probe
    if np.all(np.isfinite(matrix)):
        difference = np.abs(np.asarray(step(probe), dtype=float) - matrix @ probe)
        if not np.all(difference <= 1e-9 * scale):
            raise refused(
                "step",
                step,
                "a linear function: its value at a sum is not the sum of its values "
                f"(off by {np.max(difference / scale):.1e} of the size)",
            )
    return matrix


def spectral_radius(step_matrix: ArrayLike) -> float:
    """The largest modulus of an eigenvalue: growth per step in the long run (inf if not finite)."""
    matrix = np.asarray(step_matrix, dtype=float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise refused("step_matrix.shape", matrix.shape, "that of a square matrix")
    if not np.all(np.isfinite(matrix)):
        return math.inf
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def is_stable_by_matrix(step: Step, n: int, slack: float = 1e-9) -> bool:
    """Whether a linear step has no growing mode: spectral radius at most 1 + slack."""
    return spectral_radius(amplification(step, n)) <= 1.0 + slack


def grows(sizes: ArrayLike, factor: float = 1.2) -> bool:
    """Whether a recorded size (a norm, an energy) grows: its second half tops its first.

    Args:
        sizes: non-negative numbers in time order; a NaN or infinity counts as growth.
        factor: how much higher the highest of the second half must be. Near a limit a bounded
            motion beats, so the record must be long enough to show one beat in each half.
    """
    record = np.asarray(sizes, dtype=float)
    if record.ndim != 1 or record.size < 4:
        raise refused("sizes.shape", record.shape, "(n,) with n from 4 on")
    if not np.all(np.isfinite(record)):
        return True
    half = record.size // 2
    return bool(np.max(record[half:]) > factor * np.max(record[:half]))


def is_stable_by_iteration(
    step: Step, n: int, steps: int = 4000, factor: float = 1.2, ceiling: float = 1e6
) -> bool:
    """Whether many steps of a black box stay bounded, started from each unit vector.

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


# --- theory: the damped oscillator ----------------------------------------------------------------


def _polynomial_matrix(method: str, zeta: float) -> tuple[Any, Any, Any, Any]:
    """Entries (a, b, c, d) of one step on (q, v / w) as polynomials in x = w h."""
    x = Polynomial([0.0, 1.0])
    one = Polynomial([1.0])
    if method == "semi_implicit_euler":
        # v1 = v + x (-q - 2 zeta v), q1 = q + x v1
        c, d = -x, 1.0 - 2.0 * zeta * x
        return one + x * c, x * d, c, d
    if method == "velocity_verlet":
        # a0 = -q - 2 zeta v; q1 = q + x v + x^2 a0 / 2; a1 at q1 and at the predicted v + x a0
        a, b = one - 0.5 * x**2, x - zeta * x**2
        a1_q = -a + 2.0 * zeta * x
        a1_v = -b - 2.0 * zeta * (1.0 - 2.0 * zeta * x)
        return a, b, 0.5 * x * (a1_q - 1.0), one + 0.5 * x * (a1_v - 2.0 * zeta)
    degree = {"explicit_euler": 1, "explicit_midpoint": 2, "rk4": 4}[method]
    # Runge-Kutta with as many stages as its order: the exponential series of x A, cut off.
    generator = np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
    powers = [np.linalg.matrix_power(generator, k) / math.factorial(k) for k in range(degree + 1)]
    a, b, c, d = (Polynomial([p[i, j] for p in powers]) for i in (0, 1) for j in (0, 1))
    return a, b, c, d


def step_matrix(method: str, omega_dt: float, zeta: float) -> Array:
    """One step of a method on the oscillator, as a matrix acting on (q, v / omega).

    Args:
        method: one of `OSCILLATOR_METHODS`.
        omega_dt: natural frequency times step.
        zeta: damping ratio.
    """
    _check(method, zeta)
    if method == "implicit_midpoint":
        half = 0.5 * omega_dt * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
        solved = np.linalg.solve(np.eye(2) - half, np.eye(2) + half)
        return np.asarray(solved, dtype=float)
    entries = _polynomial_matrix(method, zeta)
    return np.array([float(entry(omega_dt)) for entry in entries]).reshape(2, 2)


def theoretical_limit(method: str, zeta: float) -> float:
    """Largest stable omega * dt of a method on x'' = -w^2 x - 2 zeta w x'.

    Closed forms among them: explicit Euler 2 zeta, or 2 / (zeta + sqrt(zeta^2 - 1)) when
    overdamped; semi-implicit Euler with the damper explicit 2 (sqrt(1 + zeta^2) - zeta); velocity
    Verlet, undamped, 2; RK4, undamped, 2 sqrt(2); implicit midpoint none.

    Args:
        method: one of `OSCILLATOR_METHODS`; velocity Verlet with the velocity predicted by an
            Euler step where the force needs it.
        zeta: damping ratio, not negative.

    Returns:
        The limit; 0 where no step is stable, infinity where every step is.
    """
    _check(method, zeta)
    if method == "implicit_midpoint":
        return math.inf
    a, b, c, d = _polynomial_matrix(method, zeta)
    trace, determinant = a + d, a * d - b * c
    conditions = (1.0 - determinant, 1.0 + determinant + trace, 1.0 + determinant - trace)
    return min(_first_negative(condition) for condition in conditions)


def implicit_damping_limit(zeta: float) -> float:
    """Semi-implicit Euler with the damper taken implicitly: 2 (sqrt(1 + zeta^2) + zeta).

    v1 = (v - x q) / (1 + 2 zeta x), q1 = q + x v1 has D = 1 / (1 + 2 zeta x) and
    T = 1 + (1 - x^2) D, and 1 + T + D >= 0 gives x^2 - 4 zeta x - 4 <= 0.
    """
    _check("semi_implicit_euler", zeta)
    return 2.0 * (math.sqrt(1.0 + zeta**2) + zeta)


def _check(method: str, zeta: float) -> None:
    one_of("method", method, OSCILLATOR_METHODS)
    finite("zeta", zeta, 0.0)


def _first_negative(condition: Polynomial) -> float:
    """The smallest x >= 0 above which a polynomial is negative; infinity if never."""
    scale = float(np.max(np.abs(condition.coef)))
    if scale == 0.0:
        return math.inf
    # What cancels in theory leaves rounding behind, which would make roots near zero.
    coefficients = np.where(np.abs(condition.coef) > 1e-14 * scale, condition.coef, 0.0)
    lowest = int(np.flatnonzero(coefficients)[0])
    if coefficients[lowest] < 0.0:
        return 0.0
    reduced = Polynomial(coefficients[lowest:]).trim()
    roots = reduced.roots()
    real = np.sort(roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)])
    for root in real[real > 0.0]:
        if reduced(root * (1.0 + 1e-5)) < 0.0:
            return float(root)
    return math.inf


# --- maps -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Map:
    """Growth per step over two parameters.

    Attributes:
        x, y: the values, shapes (nx,) and (ny,), ascending.
        growth: shape (ny, nx); at most 1 where stable, infinite where the run overflowed.
        slack: how far above 1 still counts as stable (rounding).
    """

    x: Array
    y: Array
    growth: Array
    slack: float = 1e-9

    def stable(self) -> NDArray[np.bool_]:
        """Where nothing grows, shape (ny, nx)."""
        return self.growth <= 1.0 + self.slack

    def boundary(self) -> Array:
        """For every y the middle between the last stable x and the first unstable one.

        Shape (ny,); 0 where the first x is unstable already, infinity where every x is stable.
        """
        edge = np.empty(self.y.size)
        for i, row in enumerate(self.stable()):
            if np.all(row):
                edge[i] = math.inf
            else:
                first = int(np.argmin(row))
                edge[i] = 0.0 if first == 0 else 0.5 * (self.x[first - 1] + self.x[first])
        return edge

    def plot(
        self,
        ax: Axes,
        boundaries: Mapping[str, tuple[ArrayLike, ArrayLike]] | None = None,
        *,
        x_label: str = "omega dt",
        y_label: str = "damping ratio",
        title: str = "",
    ) -> None:
        """Draw the measured growth, its boundary, and theory over it.

        Args:
            ax: where to draw.
            boundaries: theoretical curves by label, each (x values, y values).
            x_label, y_label, title: texts.
        """
        with np.errstate(divide="ignore"):
            shown = np.clip(np.log10(np.maximum(self.growth, 1e-300)), -0.5, 0.5)
        # Blue decays, orange grows: told apart by any colour vision.
        image = ax.pcolormesh(
            self.x, self.y, shown, cmap="PuOr_r", vmin=-0.5, vmax=0.5, shading="nearest"
        )
        ax.figure.colorbar(image, ax=ax, label="log10(growth per step)")
        stable = self.stable()
        if np.any(stable) and not np.all(stable):
            ax.contour(self.x, self.y, stable.astype(float), levels=[0.5], colors="black")
            ax.plot([], [], color="black", label="measured")
        for label, (x, y) in (boundaries or {}).items():
            ax.plot(
                np.asarray(x, dtype=float),
                np.asarray(y, dtype=float),
                linestyle="--",
                linewidth=2.0,
                color="#D55E00",
                label=label,
            )
        ax.set(
            xlim=(self.x[0], self.x[-1]),
            ylim=(self.y[0], self.y[-1]),
            xlabel=x_label,
            ylabel=y_label,
            title=title,
        )
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize="small", loc="upper right")


def stability_map(
    f: Callable[[float, float], float],
    x_values: Sequence[float] | Array,
    y_values: Sequence[float] | Array,
    slack: float = 1e-9,
) -> Map:
    """Growth per step at every point of a grid.

    Args:
        f: (x, y) -> growth per step, for instance the spectral radius of the step's matrix.
        x_values, y_values: ascending.
        slack: how far above 1 counts as stable.

    Returns:
        The `Map`; what is not finite becomes infinity.
    """
    x, y = np.asarray(x_values, dtype=float), np.asarray(y_values, dtype=float)
    for name, values in (("x_values", x), ("y_values", y)):
        if values.ndim != 1 or values.size < 2 or not np.all(np.diff(values) > 0.0):
            raise refused(name, values, "two or more ascending numbers")
    growth = np.array([[f(float(a), float(b)) for a in x] for b in y], dtype=float)
    growth[~np.isfinite(growth)] = math.inf
    return Map(x, y, growth, slack)
