"""Where it fails: stability limits, ours and MuJoCo's, and what a stiff spring costs.

Every limit is measured on the course's own step functions, or MuJoCo's, and set beside theory.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from course.charts import chart, save
from course.measure import stability
from course.measure.stability import Map
from course.measure.work_precision import PALETTE
from course.oracles.mujoco import kit as mujoco_kit
from course.oracles.mujoco import oscillator as mujoco_oscillator
from course.rigid_body import oscillator, problems
from course.rigid_body.integrators import INTEGRATORS, Array

NAMES = oscillator.METHODS
COLOURS = dict(zip(NAMES, PALETTE, strict=False))
LABELS = dict(
    zip(
        NAMES,
        (
            "explicit Euler",
            "semi-implicit Euler",
            "velocity Verlet",
            "explicit midpoint",
            "implicit midpoint",
            "RK4",
        ),
        strict=True,
    )
)
BLUE, ORANGE, GREEN, PINK, SKY, YELLOW, GREY, _ = PALETTE

NO_LIMIT = 1e3  # omega dt up to which a method without a limit was tried


# --- limits on the damped oscillator -------------------------------------------------------------


@dataclass(frozen=True)
class Limit:
    """One measured stability limit and its theory.

    Attributes:
        method: name; MuJoCo's begin with "MuJoCo".
        zeta: damping ratio.
        measured: largest stable omega dt; 0 for none, infinity for none found up to `NO_LIMIT`.
        theory: the same from theory.
    """

    method: str
    zeta: float
    measured: float
    theory: float

    @property
    def deviation(self) -> float:
        """Relative, 0 where both say 0 or both say infinity."""
        if self.measured == self.theory:
            return 0.0
        return abs(self.measured / self.theory - 1.0) if self.theory > 0.0 else math.inf


Linear = Callable[[Array], Array]


def measured_limit(step_at: Callable[[float], Linear], rel: float = 1e-4) -> float:
    """Largest stable omega dt of a family of linear steps, found without knowing the theory.

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

    values = np.append(np.arange(0.0, math.log(NO_LIMIT / 0.05), math.log(1.2)), math.log(2e4))
    low = 0.0
    for value in 0.05 * np.exp(values):
        if not is_stable(float(value)):
            return stability.limit(is_stable, low, float(value), rel) if low > 0.0 else 0.0
        low = float(value)
    return math.inf


_MUJOCO_VARIANTS: tuple[tuple[str, str, bool], ...] = (
    ("MuJoCo Euler", "Euler", True),
    ("MuJoCo Euler, eulerdamp off", "Euler", False),
    ("MuJoCo implicitfast", "implicitfast", True),
    ("MuJoCo implicit", "implicit", True),
    ("MuJoCo RK4", "RK4", True),
    ("MuJoCo discrete", "discrete", True),
)


def mujoco_theory(integrator: str, zeta: float, implicit_damping: bool = True) -> float:
    """What the stability limit of MuJoCo's integrators should be on a damped spring.

    Args:
        integrator: MuJoCo's name.
        zeta: damping ratio.
        implicit_damping: False for the flag eulerdamp off.
    """
    if integrator == "discrete":
        return math.inf
    if integrator == "RK4":
        return oscillator.limit("rk4", zeta)
    if integrator == "Euler" and not implicit_damping:
        return oscillator.limit("semi_implicit_euler", zeta)
    return oscillator.implicit_damping_limit(zeta)


def limits(
    zetas: Sequence[float] = (0.0, 0.1, 0.5, 1.0, 1.5),
    methods: Sequence[str] = NAMES,
    mujoco: bool = True,
) -> list[Limit]:
    """Measured and theoretical limits.

    Args:
        zetas: damping ratios.
        methods: of the course.
        mujoco: whether to ask MuJoCo's integrators as well.
    """
    found = [
        Limit(
            method,
            zeta,
            measured_limit(functools.partial(oscillator.stepper, method, zeta=zeta)),
            oscillator.limit(method, zeta),
        )
        for method in methods
        for zeta in zetas
    ]
    if mujoco:
        for name, integrator, damping in _MUJOCO_VARIANTS:
            for zeta in zetas:
                measured = measured_limit(
                    functools.partial(
                        mujoco_oscillator.oscillator_step,
                        integrator,
                        damping_ratio=zeta,
                        implicit_damping=damping,
                    )
                )
                found.append(Limit(name, zeta, measured, mujoco_theory(integrator, zeta, damping)))
    return found


def limits_table(found: Sequence[Limit]) -> str:
    """The limits as text: method by damping ratio, and the worst deviation from theory."""
    zetas = sorted({item.zeta for item in found})
    lines = [f"{'limit of omega dt':<28}" + "".join(f"  zeta {z:<4g}" for z in zetas) + "  worst"]
    for name in dict.fromkeys(item.method for item in found):
        row = {item.zeta: item for item in found if item.method == name}
        cells = "".join(
            f"  {'none' if math.isinf(row[z].measured) else format(row[z].measured, '.4f'):<9}"
            for z in zetas
        )
        lines.append(f"{name:<28}{cells}  {max(i.deviation for i in row.values()):.3%}")
    lines.append(f"none: stable at every omega dt tried, up to {2e4 * 0.05:g}; 0: at no step")
    return "\n".join(lines)


@chart
def stability_limits() -> str:
    """The limit of every integrator on the damped oscillator, ours and MuJoCo's."""
    import matplotlib.pyplot as plt

    found = limits((0.0, 0.1, 0.25, 0.5, 1.0, 1.5))
    dense = np.linspace(0.0, 1.6, 129)
    curves: dict[str, Callable[[float], float]] = {
        name: functools.partial(oscillator.limit, name) for name in NAMES
    }
    for name, integrator, damping in _MUJOCO_VARIANTS:
        curves[name] = functools.partial(mujoco_theory, integrator, implicit_damping=damping)
    figure, axes = plt.subplots(1, 2, figsize=(12, 5.0), layout="constrained", sharey=True)
    top = 7.0
    for ax, ours in zip(axes, (True, False), strict=True):
        names = [name for name in curves if name.startswith("MuJoCo") != ours]
        for i, (name, colour) in enumerate(zip(names, PALETTE, strict=False)):
            line = [curves[name](float(z)) for z in dense]
            if not math.isinf(line[0]):
                ax.plot(dense, line, color=colour, lw=1.2)
            rows = [item for item in found if item.method == name]
            endless = math.isinf(rows[0].measured)
            label = LABELS.get(name, name)
            ax.plot(
                [item.zeta for item in rows],
                [top - 0.15 if endless else item.measured for item in rows],
                linestyle="none",
                marker="^" if endless else "osDvPX"[i],
                markersize=7 if ours or endless else 11 - 1.6 * i,
                mfc="none" if not ours else colour,
                color=colour,
                label=label + (f": none up to {NO_LIMIT:g}" if endless else ""),
            )
        ax.set(xlabel="damping ratio", ylim=(0.0, top), xlim=(-0.03, 1.6))
        ax.plot([], [], color="black", lw=1.2, label="theory")
        ax.grid(True, alpha=0.3)
        ax.legend(fontsize="small", loc="upper left", bbox_to_anchor=(0.0, 0.95))
    axes[0].set(
        ylabel="largest stable omega dt",
        title="A damper taken explicitly costs stability",
    )
    axes[1].set(title="MuJoCo: taken implicitly, it buys some")
    save("stability_limits", figure, [vars(item) for item in found])
    return limits_table(found)


# --- maps ----------------------------------------------------------------------------------------


def growth_map(method: str, omega_dt: Array, zeta: Array) -> Map:
    """Measured growth per step over step and damping, all points stepped as one batch.

    Args:
        method: a name in INTEGRATORS.
        omega_dt, zeta: ascending values, shapes (nx,) and (ny,).
    """
    x, z = (grid.ravel() for grid in np.meshgrid(omega_dt, zeta))
    # A step of 1 s at the natural frequency x; speeds in units of it, so that the matrix is the
    # one of (q, v / omega).
    params = np.stack([x, z])
    columns = []
    for q0, v0 in ((1.0, 0.0), (0.0, 1.0)):
        q, v = INTEGRATORS[method].step(
            np.full((1, x.size), q0), v0 * x[None], problems.oscillator_acceleration, 1.0, params
        )
        columns.append(np.stack([q[0], v[0] / x]))
    matrices = np.stack(columns, axis=1).transpose(2, 0, 1)
    growth = np.max(np.abs(np.linalg.eigvals(matrices)), axis=1)
    return Map(omega_dt, zeta, growth.reshape(zeta.size, omega_dt.size))


def boundary_error(found: Map, method: str) -> float:
    """Largest distance of a map's boundary from theory, in cells of the map (0.5 is perfect)."""
    cell = float(found.x[1] - found.x[0])
    worst = 0.0
    for edge, zeta in zip(found.boundary(), found.y, strict=True):
        theory = oscillator.limit(method, float(zeta))
        if theory < found.x[0]:
            theory = 0.0
        if edge != theory and not (math.isinf(edge) and theory >= found.x[-1]):
            worst = max(worst, abs(edge - theory) / cell)
    return worst


@chart
def stability_maps() -> str:
    """Growth per step over step and damping, with the theoretical boundary on the measured one."""
    import matplotlib.pyplot as plt

    omega_dt, zeta = np.linspace(0.02, 4.0, 200), np.linspace(0.0, 2.0, 101)
    figure, axes = plt.subplots(
        2, 3, figsize=(12, 7.4), layout="constrained", sharex=True, sharey=True
    )
    lines, data = [], {}
    for ax, method in zip(axes.flat, NAMES, strict=True):
        found = growth_map(method, omega_dt, zeta)
        with np.errstate(divide="ignore"):
            shown = np.clip(np.log10(found.growth), -0.5, 0.5)
        image = ax.pcolormesh(
            omega_dt, zeta, shown, cmap="PuOr_r", vmin=-0.5, vmax=0.5, shading="nearest",
            rasterized=True,
        )  # fmt: skip
        stable = found.stable()
        if stable.any() and not stable.all():
            ax.contour(
                omega_dt, zeta, stable.astype(float), levels=[0.5], colors="black", linewidths=2.5
            )
        theory = np.array([oscillator.limit(method, float(z)) for z in zeta])
        ax.plot(theory, zeta, "--", color="white", lw=1.3)
        ax.set(title=LABELS[method], xlim=(0.0, 4.0), ylim=(0.0, 2.0))
        share = float(np.mean(stable))
        worst = boundary_error(found, method)
        lines.append(
            f"{method:<20} stable on {share:6.1%} of the map; boundary within {worst:.2f} cells"
        )
        data[method] = {"stable_share": share, "boundary": found.boundary().tolist()}
    for ax in axes[1]:
        ax.set_xlabel("omega dt")
    for ax in axes[:, 0]:
        ax.set_ylabel("damping ratio")
    bar = figure.colorbar(image, ax=axes, shrink=0.8, extend="both")
    bar.set_label("log10(growth per step): purple decays, orange grows")
    figure.suptitle(
        "Where a step decays and where it grows: measured boundary black, theory white and dashed"
    )
    save("stability_maps", figure, {"omega_dt": omega_dt.tolist(), "zeta": zeta.tolist(), **data})
    lines.append(f"a cell is {omega_dt[1] - omega_dt[0]:.2f} wide; 0.5 is the best it can resolve")
    return "\n".join(lines)


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


def mode(step: Linear, omega_dt: float) -> Mode:
    """Growth, numerical damping and phase error of a linear step on x'' = -x.

    Args:
        step: (x, x') -> (x, x').
        omega_dt: its step.
    """
    values = np.linalg.eigvals(stability.amplification(step, 2))
    z = values[int(np.argmax(np.abs(values)))]
    log = np.log(complex(z))
    return Mode(float(abs(z)), float(-log.real / abs(log)), float(abs(log.imag) / omega_dt - 1.0))


def implicit_euler_mode(omega_dt: float) -> Mode:
    """Theory of "discrete" on an undamped spring: z = 1 / (1 - i x), x = omega dt.

    It is implicit Euler, v1 = (v - x q) / (1 + x^2) and q1 = q + x v1, so |z| = (1 + x^2)^-1/2 and
    arg z = atan(x): a damping ratio of x / 2 and a frequency too low by x^2 / 3 where x is small
    (Hairer, Wanner, Solving Ordinary Differential Equations II, 1996, sec. IV.3).
    """
    log = -0.5 * math.log1p(omega_dt**2) + 1j * math.atan(omega_dt)
    return Mode(math.exp(log.real), -log.real / abs(log), log.imag / omega_dt - 1.0)


def stiff_spring(omega_dt: Sequence[float] | Array, integrator: str) -> list[Mode]:
    """Measured modes of MuJoCo's undamped spring.

    Args:
        omega_dt: steps times natural frequency.
        integrator: MuJoCo's name.
    """
    return [
        mode(mujoco_oscillator.oscillator_step(integrator, float(x)), float(x)) for x in omega_dt
    ]


@chart
def mujoco_stiff_spring() -> str:
    """Limits of MuJoCo's integrators on a stiff spring, and what having none costs."""
    import matplotlib.pyplot as plt

    x = np.geomspace(0.01, 1e3, 121)
    names = mujoco_kit.MUJOCO_INTEGRATORS
    modes = {name: stiff_spring(x, name) for name in names}
    found = {
        name: measured_limit(functools.partial(mujoco_oscillator.oscillator_step, name))
        for name in names
    }
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.8), layout="constrained")
    for name, colour, width in zip(names, PALETTE, (7.0, 2.0, 4.5, 2.0, 2.0), strict=False):
        left.loglog(
            x, [m.growth for m in modes[name]], color=colour, lw=width,
            ls="--" if name == "implicitfast" else "-", label=name,
        )  # fmt: skip
    for value, text in ((2.0, "2"), (2.0 * math.sqrt(2.0), "2 sqrt(2)")):
        left.axvline(value, color="black", ls=":", lw=1)
        left.text(
            value, 3e-4 if value == 2.0 else 1e-3, text + " ",
            ha="right" if value == 2.0 else "left", fontsize="small",
        )  # fmt: skip
    left.set(
        xlabel="omega dt",
        ylabel="growth per step",
        ylim=(1e-4, 1e4),
        title="Only discrete survives any step",
    )
    left.legend(fontsize="small", loc="upper left")
    theory = [implicit_euler_mode(float(value)) for value in x]
    middle.loglog(x, [m.damping for m in modes["discrete"]], "o", ms=4, color=SKY, label="discrete")
    middle.loglog(
        x, [m.damping for m in theory], color="black", lw=1, label="theory: implicit Euler"
    )
    middle.loglog(x, 0.5 * x, ":", color=GREY, label="omega dt / 2")
    middle.set(
        xlabel="omega dt",
        ylabel="damping ratio (the true one is 0)",
        ylim=(3e-3, 3.0),
        title="It pays with damping of its own",
    )
    middle.legend(fontsize="small", loc="lower right")
    for name, colour, marker in (
        ("discrete", SKY, "o"),
        ("Euler", BLUE, "s"),
        ("RK4", ORANGE, "^"),
    ):
        stable = x < found[name]
        right.loglog(
            x[stable], np.abs([m.phase for m in modes[name]])[stable], marker, ms=4, color=colour,
            label=f"{name} ({'too low' if modes[name][40].phase < 0.0 else 'too high'})",
        )  # fmt: skip
    right.loglog(x, [-m.phase for m in theory], color="black", lw=1, label="1 - atan(x) / x")
    euler = x[x < 2.0]
    right.loglog(euler, 2.0 * np.arcsin(0.5 * euler) / euler - 1.0, "--", color="black", lw=1,
                 label="2 asin(x / 2) / x - 1")  # fmt: skip
    right.set(
        xlabel="omega dt",
        ylabel="relative error of the frequency",
        ylim=(1e-9, 3.0),
        title="and with the frequency of the motion",
    )
    right.legend(fontsize="small", loc="lower right")
    for ax in (left, middle, right):
        ax.grid(True, alpha=0.3)
    save(
        "mujoco_stiff_spring",
        figure,
        {
            "omega_dt": x.tolist(),
            "limit": found,
            "modes": {name: [vars(m) for m in modes[name]] for name in names},
        },
    )
    lines = []
    for name in names:
        expected = mujoco_theory(name, 0.0)
        text = "none up to 1000" if math.isinf(found[name]) else f"{found[name]:.4f}"
        wanted = "none" if math.isinf(expected) else f"{expected:.4f}"
        lines.append(f"{name:<13} limit of omega dt {text}, theory {wanted}")
    lines.append("what discrete does to an undamped spring:")
    for value in (0.01, 0.1, 0.3, 1.0):
        (m,) = stiff_spring([value], "discrete")
        t = implicit_euler_mode(value)
        left_over = m.growth ** (2.0 * math.pi / value)
        lines.append(
            f"  omega dt {value:5g}: damping ratio {m.damping:.4f} (theory {t.damping:.4f}), "
            f"frequency {m.phase:+.2%} ({t.phase:+.2%}), amplitude left after a period "
            f"{left_over:.1%}"
        )
    return "\n".join(lines)
