"""Where it fails: stability limits, ours and MuJoCo's, and what a stiff spring costs.

Every limit is measured on the course's own step functions, or MuJoCo's, and set beside theory.
"""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from course.charts import chart
from course.measure import stability
from course.measure.figure import Panel, Series
from course.measure.stability import Map
from course.oracles.mujoco.kit import MUJOCO_INTEGRATORS
from course.oracles.mujoco.oscillator import oscillator_step as mujoco_step
from course.rigid_body import oscillator, problems
from course.rigid_body.integrators import INTEGRATORS, Array

LABELS = {name: INTEGRATORS[name].label for name in oscillator.METHODS}
NO_LIMIT = 1e3  # omega dt up to which a method without a limit was tried

Linear = Callable[[Array], Array]


# --- limits on the damped oscillator -------------------------------------------------------------


def measured_limit(step_at: Callable[[float], Linear], rel: float = 1e-4) -> float:
    """Return largest stable omega dt of a family of linear steps, found without knowing the theory.

    The range from 0.05 to `NO_LIMIT` is searched upwards in steps of 20 % for the first value that
    grows; bisection follows.

    Args:
        step_at: omega dt -> one step.
        rel: relative width of the last bracket.

    Returns:
        The limit; 0 if 0.05 is unstable already, infinity if nothing grew.
    """

    def is_stable(omega_dt: float) -> bool:
        return stability.is_stable_by_matrix(step_at(omega_dt), 2)

    # Upwards in steps of 20 %: a bisection alone could miss an unstable range in between.
    low = 0.0
    values = np.append(np.arange(0.0, math.log(NO_LIMIT / 0.05), math.log(1.2)), math.log(2e4))
    for value in 0.05 * np.exp(values):
        if not is_stable(float(value)):
            return stability.limit(is_stable, low, float(value), rel) if low > 0.0 else 0.0
        low = float(value)
    return math.inf


def mujoco_theory(zeta: float, integrator: str, implicit_damping: bool = True) -> float:
    """Return what the stability limit of MuJoCo's integrators should be on a damped spring.

    Args:
        zeta: damping ratio.
        integrator: MuJoCo's name.
        implicit_damping: False for the flag eulerdamp off.
    """
    if integrator == "discrete":
        return math.inf
    if integrator == "RK4":
        return oscillator.limit("rk4", zeta)
    if integrator == "Euler" and not implicit_damping:
        return oscillator.limit("semi_implicit_euler", zeta)
    return oscillator.implicit_damping_limit(zeta)


@dataclass(frozen=True)
class Contender:
    """A method on the damped spring.

    Attributes:
        step: (omega dt, zeta) -> one step.
        theory: zeta -> the largest stable omega dt; 0 for none, infinity for no limit.
    """

    step: Callable[[float, float], Linear]
    theory: Callable[[float], float]

    def limit(self, zeta: float) -> float:
        """Return the measured one."""
        return measured_limit(lambda omega_dt: self.step(omega_dt, zeta))


def contenders() -> dict[str, Contender]:
    """Return the course's methods and MuJoCo's, by their keys on a chart."""
    result = {
        name: Contender(
            functools.partial(oscillator.stepper, name), functools.partial(oscillator.limit, name)
        )
        for name in LABELS
    }
    for name, integrator, damping in (
        ("Euler", "Euler", True),
        ("Euler, eulerdamp off", "Euler", False),
        ("implicitfast", "implicitfast", True),
        ("implicit", "implicit", True),
        ("RK4", "RK4", True),
        ("discrete", "discrete", True),
    ):
        result[f"MuJoCo {name}"] = Contender(
            functools.partial(mujoco_step, integrator, implicit_damping=damping),
            functools.partial(mujoco_theory, integrator=integrator, implicit_damping=damping),
        )
    return result


def deviation(measured: float, theory: float) -> float:
    """Return relative, 0 where both say 0 or both say infinity."""
    if measured == theory:
        return 0.0
    return abs(measured / theory - 1.0) if theory > 0.0 else math.inf


@chart(height=4.2)
def stability_limits(
    zetas: Sequence[float] = (0.0, 0.1, 0.25, 0.5, 1.0, 1.5), names: Sequence[str] = ()
) -> Iterator[Panel]:
    """Chart the limit of every integrator on the damped oscillator, ours and MuJoCo's.

    Args:
        zetas: damping ratios.
        names: keys of `contenders`; all by default.
    """
    shared: dict[str, Any] = {
        "xlim": (-0.03, 1.6),
        "ylim": (0.0, 7.0),
    }
    ours, mujocos = (
        Panel(title, "damping ratio", "largest stable omega dt", **shared)
        for title in (
            "A damper taken explicitly costs stability",
            "MuJoCo: taken implicitly, it buys some",
        )
    )
    lines = [f"{'limit of omega dt':<28}" + "".join(f"  zeta {z:<4g}" for z in zetas) + "  worst"]
    for name, contender in contenders().items():
        if names and name not in names:
            continue
        result = [contender.limit(z) for z in zetas]
        endless = all(map(math.isinf, result))
        series = Series(
            LABELS.get(name, name) + (f": none up to {NO_LIMIT:g}" if endless else ""),
            zetas,
            result,
            name,
            "",
            contender.theory,
            hollow="MuJoCo" in name,
        )
        (mujocos if "MuJoCo" in name else ours).series.append(series)
        worst = max(map(deviation, result, series.expected))
        cells = "".join(f"  {'none' if math.isinf(m) else format(m, '.4f'):<9}" for m in result)
        lines.append(f"{name:<28}{cells}  {worst:.3%}")
    lines.append(f"none: stable at every omega dt tried, up to {NO_LIMIT:g}; 0: at no step")
    mujocos.notes = lines
    yield from (ours, mujocos)


# --- maps ----------------------------------------------------------------------------------------


def growth_map(method: str, omega_dt: Array, zeta: Array) -> Map:
    """Return measured growth per step over step and damping, all points stepped as one batch.

    Args:
        method: a name in INTEGRATORS.
        omega_dt: ascending values, shape (nx,).
        zeta: ascending values, shape (ny,).
    """

    def step(q: Array, v: Array, x: Array, z: Array) -> tuple[Array, Array]:
        # A step of 1 s at the natural frequency x.
        # Frequency and damping vary over the map, with the step fixed at 1 s.
        params = np.concatenate([x, z])
        return INTEGRATORS[method].step(q, v, problems.oscillator_acceleration, 1.0, params)

    return stability.batch_map(step, omega_dt, zeta)


def boundary_error(result: Map, method: str) -> float:
    """Return the largest distance of a map's boundary from theory.

    In cells of the map (0.5 is perfect).
    """
    cell = float(result.x[1] - result.x[0])
    worst = 0.0
    for edge, zeta in zip(result.boundary(), result.y, strict=True):
        theory = oscillator.limit(method, float(zeta))
        # A limit below the map counts as 0, as the measured boundary does.
        if theory < result.x[0]:
            theory = 0.0
        if edge != theory and not (math.isinf(edge) and theory >= result.x[-1]):
            worst = max(worst, abs(edge - theory) / cell)
    return worst


@chart(
    columns=3,
    share_y=True,
    height=2.7,
    title="Where a step decays and where it grows: measured boundary black, theory white, dashed",
)
def stability_maps(nx: int = 200, ny: int = 101) -> Iterator[Panel]:
    """Chart growth per step over step and damping, with the theoretical boundary."""
    omega_dt, zeta = np.linspace(0.02, 4.0, nx), np.linspace(0.0, 2.0, ny)
    for method, label in LABELS.items():
        result = growth_map(method, omega_dt, zeta)
        panel = Panel(
            label, "omega dt", "damping ratio", grid=result, xlim=(0.0, 4.0), legend=False
        )
        theory = [oscillator.limit(method, float(z)) for z in zeta]
        panel.series.append(Series("theory", theory, zeta, "theory on a map", "--"))
        panel.notes.append(
            f"{method:<20} stable on {np.mean(result.within()):6.1%} of the map; boundary within "
            f"{boundary_error(result, method):.2f} cells"
        )
        if method == "rk4":
            panel.notes.append(
                f"a cell is {omega_dt[1] - omega_dt[0]:.2f} wide; 0.5 is the best it can resolve"
            )
        yield panel


# --- the stiff spring in MuJoCo ------------------------------------------------------------------


@dataclass(frozen=True)
class Mode:
    """How one step treats an undamped oscillation.

    Attributes:
        growth: modulus of the eigenvalue, per step.
        damping: numerical damping ratio, -ln|z| / |ln z|; the true one is 0.
        phase: relative error of the frequency, arg(z) / (omega dt) - 1.
    """

    growth: float
    damping: float
    phase: float

    @classmethod
    def of(cls, z: complex, omega_dt: float) -> "Mode":
        """Return that of the eigenvalue z of a step omega dt."""
        log = complex(np.log(z))
        return cls(abs(z), -log.real / abs(log), abs(log.imag) / omega_dt - 1.0)


def mujoco_mode(integrator: str, omega_dt: float) -> Mode:
    """Return measured on MuJoCo's undamped spring, the eigenvalue of larger modulus."""
    matrix = stability.amplification(mujoco_step(integrator, omega_dt), 2)
    # Eigenvalues of the measured step matrix; a complex pair has equal moduli.
    values = np.linalg.eigvals(matrix)
    return Mode.of(complex(values[int(np.argmax(np.abs(values)))]), omega_dt)


def implicit_euler_mode(omega_dt: float) -> Mode:
    """Return theory of "discrete" on an undamped spring: z = 1 / (1 - i x), x = omega dt.

    It is implicit Euler, v1 = (v - x q) / (1 + x^2) and q1 = q + x v1, so |z| = (1 + x^2)^-1/2 and
    arg z = atan(x): a damping ratio of x / 2 and a frequency too low by x^2 / 3 where x is small
    (Hairer, Wanner, Solving Ordinary Differential Equations II, 1996, sec. IV.3).
    """
    return Mode.of(1.0 / complex(1.0, -omega_dt), omega_dt)


@chart
def mujoco_stiff_spring(points: int = 121) -> Iterator[Panel]:
    """Chart limits of MuJoCo's integrators on a stiff spring, and what having none costs."""
    x = np.geomspace(0.01, NO_LIMIT, points)
    modes = {name: [mujoco_mode(name, float(v)) for v in x] for name in MUJOCO_INTEGRATORS}
    growth_panel = Panel(
        "Only discrete survives any step",
        "omega dt",
        "growth per step",
        scale="log",
        lines=[("x", 2.0, "2"), ("x", 2.0 * math.sqrt(2.0), "2 sqrt(2)")],
        ylim=(1e-4, 1e4),
    )
    widths = dict(zip(modes, (7.0, 2.0, 4.5, 2.0, 2.0), strict=True))
    for name, rows in modes.items():
        style = "--" if name == "implicitfast" else "-"
        growth_panel.series.append(
            Series(
                name,
                x,
                [m.growth for m in rows],
                f"MuJoCo {name}",
                style,
                marker="",
                width=widths[name],
            )
        )
    steps = {name: functools.partial(mujoco_step, name) for name in modes}
    result = {name: measured_limit(step) for name, step in steps.items()}
    for name, limit in result.items():
        expected = mujoco_theory(0.0, name)
        text = "none up to 1000" if math.isinf(limit) else f"{limit:.4f}"
        desired = "none" if math.isinf(expected) else f"{expected:.4f}"
        growth_panel.notes.append(f"{name:<13} limit of omega dt {text}, theory {desired}")
    yield growth_panel

    middle = Panel(
        "discrete damps a spring that has no damper",
        "omega dt",
        "damping ratio (the true one is 0)",
        scale="log",
        ylim=(3e-3, 3.0),
        theory="theory: implicit Euler",
    )
    middle.series = [
        Series(
            "discrete",
            x,
            [m.damping for m in modes["discrete"]],
            "MuJoCo discrete",
            "",
            lambda v: implicit_euler_mode(v).damping,
        ),
        Series("omega dt / 2", x, 0.5 * x, "theory", ":"),
    ]
    middle.notes.append("what discrete does to an undamped spring:")
    for value in (0.01, 0.1, 0.3, 1.0):
        m, t = mujoco_mode("discrete", value), implicit_euler_mode(value)
        # Growth per step to the power of the steps in a period.
        left_over = m.growth ** (2.0 * math.pi / value)
        middle.notes.append(
            f"  omega dt {value:5g}: damping ratio {m.damping:.4f} (theory {t.damping:.4f}), "
            f"frequency {m.phase:+.2%} ({t.phase:+.2%}), amplitude left after a period "
            f"{left_over:.1%}"
        )
    yield middle

    right = Panel(
        "The frequency is wrong, too",
        "omega dt",
        "relative error of the frequency",
        scale="log",
        ylim=(1e-9, 3.0),
        theory="theory",
    )
    theory: dict[str, Callable[[float], float]] = {
        "discrete": lambda v: -implicit_euler_mode(v).phase,
        "Euler": lambda v: 2.0 * math.asin(0.5 * v) / v - 1.0,
    }
    for name in ("discrete", "Euler", "RK4"):
        # Beyond its limit a method has no frequency to compare.
        stable = x < result[name]
        phase = np.array([m.phase for m in modes[name]])[stable]
        side = "too low" if phase[phase.size // 3] < 0.0 else "too high"
        right.series.append(
            Series(
                f"{name} ({side})",
                x[stable],
                np.abs(phase),
                f"MuJoCo {name}",
                "",
                theory.get(name),
                size=4.0,
            )
        )
    yield right
