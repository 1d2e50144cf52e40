"""Where it fails in the long run: energy, phase, varying steps, and the length of a quaternion."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np

from course.charts import chart, save
from course.charts.rigid_body.failures import COLOURS, LABELS, NAMES
from course.check import one_of
from course.compiled import VECTOR, compiled
from course.measure.work_precision import PALETTE
from course.rigid_body import problems, quaternion
from course.rigid_body.integrators import INTEGRATORS, Array, semi_implicit_euler, simulate

BLUE, ORANGE, GREEN, PINK, SKY, YELLOW, GREY, _ = PALETTE


# --- a million steps ------------------------------------------------------------------------------


@dataclass(frozen=True)
class EnergyRun:
    """Energy error of a long run of the pendulum.

    Attributes:
        method: integrator.
        steps: ends of intervals that grow by a constant factor, shape (n,).
        error: largest relative error of the energy up to each, shape (n,).
        first, last: largest error within the first and the last hundredth of the run.
    """

    method: str
    steps: Array
    error: Array
    first: float
    last: float


def long_energy(
    method: str, steps: int = 1_000_000, dt: float = 0.02, amplitude: float = 1.0
) -> EnergyRun:
    """The pendulum over many steps.

    Args:
        method: a name in INTEGRATORS.
        steps: how many, at least 1000.
        dt: step [s].
        amplitude: angle of release [rad].
    """
    system = problems.pendulum(amplitude).system
    path = simulate(system, method, dt, steps, every=1)
    with np.errstate(over="ignore", invalid="ignore"):
        energy = problems.pendulum_energy(path.q.T, path.v.T, system.params)
        error = np.abs(energy / energy[0] - 1.0)
    error[~np.isfinite(error)] = math.inf
    ends = np.unique(np.geomspace(10, steps, 120).astype(int))
    largest = np.array(
        [np.max(error[a + 1 : b + 1]) for a, b in zip([0, *ends[:-1]], ends, strict=True)]
    )
    largest = np.maximum.accumulate(largest)
    hundredth = steps // 100
    return EnergyRun(
        method, ends, largest, float(np.max(error[:hundredth])), float(np.max(error[-hundredth:]))
    )


@chart
def long_run_energy() -> str:
    """Energy of the pendulum over a million steps, by all six integrators."""
    import matplotlib.pyplot as plt

    runs = [long_energy(name) for name in NAMES]
    figure, ax = plt.subplots(figsize=(9, 5.2), layout="constrained")
    lines = []
    for run in runs:
        symplectic = INTEGRATORS[run.method].symplectic
        ax.loglog(
            run.steps, run.error, "-" if symplectic else "--", color=COLOURS[run.method],
            lw=2.0, label=LABELS[run.method] + (", symplectic" if symplectic else ""),
        )  # fmt: skip
        lines.append(
            f"{run.method:<20} largest relative energy error: first 1 % {run.first:.2e}, "
            f"last 1 % {run.last:.2e}, ratio {run.last / run.first:.3g}"
        )
    ax.set(
        xlabel="steps of 20 ms (period 2.1 s)",
        ylabel="largest relative energy error so far",
        title="Symplectic methods keep their first error; RK4's grows without end",
        xlim=(10, runs[0].steps[-1]),
    )
    ax.grid(True, alpha=0.3)
    ax.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(
        "long_run_energy",
        figure,
        [{**vars(r), "steps": r.steps.tolist(), "error": r.error.tolist()} for r in runs],
    )
    return "\n".join(lines)


# --- symplectic is not enough ---------------------------------------------------------------------


def pattern_trace(a: float | Array, b: float | Array) -> Array:
    """Trace of a step a followed by a step b of semi-implicit Euler on x'' = -x.

    Each is [[1 - h^2, h], [-h, 1]], of determinant 1; so is the product, and its trace is
    2 - (a + b)^2 + a^2 b^2. It is bounded while |trace| <= 2; beyond, one eigenvalue is larger
    than 1 although every step alone keeps area and is stable.

    Args:
        a, b: omega times the two steps.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return 2.0 - (a + b) ** 2 + (a * b) ** 2


def pattern_growth(steps: Sequence[float]) -> float:
    """Growth per cycle of a repeated pattern of steps, from the product of their matrices.

    Args:
        steps: omega times each step of the cycle.

    Returns:
        The modulus of the largest eigenvalue: 1 where bounded.
    """
    product = np.eye(2)
    for h in steps:
        product = np.array([[1.0 - h * h, h], [-h, 1.0]]) @ product
    trace = abs(float(np.trace(product)))
    return 0.5 * trace + math.sqrt(0.25 * trace**2 - 1.0) if trace > 2.0 else 1.0


def measured_pattern(steps: Sequence[float], cycles: int) -> tuple[Array, float]:
    """Run the course's semi-implicit Euler on x'' = -x through a repeated pattern of steps.

    Args:
        steps: omega times each step of the cycle.
        cycles: how many.

    Returns:
        (energy after each cycle over the first, shape (cycles + 1,); growth of the amplitude per
        cycle over the second half).
    """
    params = np.array([1.0, 0.0])
    q, v = np.array([1.0]), np.array([0.3])
    energy = np.empty(cycles + 1)
    energy[0] = 0.5 * float(q[0] ** 2 + v[0] ** 2)
    with np.errstate(over="ignore", invalid="ignore"):
        for i in range(cycles):
            for h in steps:
                q, v = semi_implicit_euler(q, v, problems.oscillator_acceleration, h, params)
            energy[i + 1] = 0.5 * float(q[0] ** 2 + v[0] ** 2)
    half = cycles // 2
    growth = (energy[-1] / energy[half]) ** (0.5 / (cycles - half))
    return energy / energy[0], float(growth)


def resonant_pattern(long: float = 0.3, short: float = 0.1) -> list[float]:
    """A quarter of a turn in long steps, a quarter in short ones: both far below the limit of 2.

    Args:
        long, short: omega times the two steps.
    """
    quarter = 0.5 * math.pi
    count = [round(quarter / (2.0 * math.asin(0.5 * h))) for h in (long, short)]
    return [long] * count[0] + [short] * count[1]


def phase_error(method: str, periods: int = 1000, omega_dt: float = 0.1) -> tuple[Array, Array]:
    """Phase error of the undamped oscillator against time.

    Args:
        method: a name in INTEGRATORS.
        periods: length of the run.
        omega_dt: step.

    Returns:
        (times in periods, phase error [rad]), positive where the method runs ahead.
    """
    system = problems.oscillator(omega=1.0).system
    every = 10
    records = math.ceil(periods * 2.0 * math.pi / omega_dt / every)
    path = simulate(system, method, omega_dt, records * every, every)
    phase = np.unwrap(np.arctan2(-path.v[:, 0], path.q[:, 0]))
    return path.t / (2.0 * math.pi), phase - path.t


@chart
def symplectic_not_enough() -> str:
    """Steps that vary turn a stable symplectic method unstable; phase is never protected."""
    import matplotlib.pyplot as plt

    h = np.linspace(0.0, 2.0, 161)[1:]
    # Measured: one cycle from each unit vector by the step function itself, the grid as a batch.
    a, b = (grid.ravel() for grid in np.meshgrid(h, h))
    columns = []
    for q0, v0 in ((1.0, 0.0), (0.0, 1.0)):
        q, v = np.full((1, a.size), q0), np.full((1, a.size), v0)
        for step in (a, b):
            q, v = semi_implicit_euler(
                q, v, problems.oscillator_acceleration, step, np.array([1.0, 0.0])
            )
        columns.append(np.concatenate([q, v]))
    matrices = np.stack(columns, axis=1).transpose(2, 0, 1)
    growth = np.max(np.abs(np.linalg.eigvals(matrices)), axis=1).reshape(h.size, h.size)

    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.8), layout="constrained")
    image = left.pcolormesh(
        h, h, np.log10(np.maximum(growth, 1.0)), cmap="Oranges", shading="nearest", rasterized=True
    )
    left.contour(h, h, growth > 1.0 + 1e-6, levels=[0.5], colors="black", linewidths=2.5)
    left.contour(
        h, h, np.abs(pattern_trace(*np.meshgrid(h, h))), levels=[2.0], colors="white",
        linestyles="--", linewidths=1.2,
    )  # fmt: skip
    left.plot([1.7], [1.2], "o", color=BLUE)
    figure.colorbar(image, ax=left, label="log10(growth per pair of steps)", shrink=0.75)
    left.set(
        xlabel="omega h1",
        ylabel="omega h2",
        title="h1 and h2 in turn: unstable below 2\n(measured black, |trace| = 2 white)",
        aspect="equal",
    )
    lines = []
    patterns = {
        "1.7 and 1.2 in turn": [1.7, 1.2],
        "5 of 0.3, 16 of 0.1": resonant_pattern(),
        "0.3 only": [0.3] * 10,
    }
    rows = []
    for (name, pattern), colour in zip(patterns.items(), (BLUE, ORANGE, GREEN), strict=True):
        energy, measured = measured_pattern(pattern, 100)
        theory = pattern_growth(pattern)
        middle.semilogy(np.arange(energy.size), energy, color=colour, label=f"omega h = {name}")
        if theory > 1.0:
            middle.semilogy(
                np.arange(101), energy[50] * theory ** (2.0 * (np.arange(101) - 50)), "--",
                color="black", lw=1,
            )  # fmt: skip
        rows.append({"pattern": pattern, "measured": measured, "theory": theory})
        lines.append(
            f"omega h = {name:<20} largest {max(pattern):.1f} of the limit 2: amplitude per cycle "
            + (f"x {measured:.5f}, theory {theory:.5f}" if theory > 1.0 else "bounded, theory 1")
        )
    middle.plot([], [], "--", color="black", lw=1, label="eigenvalue of the cycle")
    middle.set(
        xlabel="cycles of the pattern",
        ylabel="energy over the first",
        title="Far below the limit too,\nif the steps vary in tune with the motion",
        ylim=(1e-2, 1e20),
    )
    middle.legend(fontsize="small", loc="upper right", bbox_to_anchor=(1.0, 0.78))
    for name in ("semi_implicit_euler", "velocity_verlet", "implicit_midpoint", "rk4"):
        periods, error = phase_error(name)
        right.loglog(
            periods[1:], np.abs(error[1:]), color=COLOURS[name], label=LABELS[name],
            ls="--" if name == "velocity_verlet" else "-",
        )  # fmt: skip
        rate = error[-1] / periods[-1]
        lines.append(f"{name:<20} phase {rate:+.3e} rad per period at omega dt = 0.1")
    right.axhline(math.pi, color=GREY, lw=1, ls=":")
    right.text(periods[1], math.pi * 1.15, "half a period wrong", fontsize="small", color="0.3")
    right.set(
        xlabel="periods",
        ylabel="phase error [rad]",
        title="Energy bounded, phase not:\nits error grows linearly",
    )
    right.grid(True, alpha=0.3)
    right.legend(fontsize="small", loc="lower right")
    share = float(np.mean(growth > 1.0 + 1e-6))
    lines.insert(
        0,
        f"h1, h2 in turn, both below the limit: unstable on {share:.1%} of the square; measured "
        f"and theoretical growth differ by {_pair_deviation(growth, h):.1e} at most",
    )
    save("symplectic_not_enough", figure, rows)
    return "\n".join(lines)


def _pair_deviation(growth: Array, h: Array) -> float:
    trace = np.abs(pattern_trace(*np.meshgrid(h, h)))
    theory = 0.5 * trace + np.sqrt(np.maximum(0.25 * trace**2 - 1.0, 0.0))
    clear = np.abs(trace - 2.0) > 1e-6  # on the boundary itself rounding decides
    return float(np.max(np.abs(growth - np.maximum(theory, 1.0))[clear]))


# --- quaternion drift -----------------------------------------------------------------------------

UPDATES = ("added", "added and renormalised", "exponential map")


def _spin(q, omega, h, steps, update):
    """Steps of a constant body rate; update: 0 adds, 1 renormalises as well, 2 multiplies exp."""
    for _ in range(steps):
        if update == 2:
            q = quaternion.product(q, quaternion.exp(h * omega))
        else:
            q = q + h * quaternion.derivative(q, omega)
            if update == 1:
                q = quaternion.normalise(q)
    return q


def spin_errors(update: str, angle: float, steps: Sequence[int]) -> tuple[Array, Array]:
    """Errors of a quaternion that turns at a constant rate.

    Args:
        update: one of `UPDATES`.
        angle: turn per step, h w [rad].
        steps: numbers of steps, ascending.

    Returns:
        (| |q| - 1 |, angle of the missing turn [rad]) after each number of steps.
    """
    one_of("update", update, UPDATES)
    run = compiled(_spin, VECTOR(VECTOR, VECTOR, numba.float64, numba.int64, numba.int64))
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    q = np.array([1.0, 0.0, 0.0, 0.0])
    length, attitude = [], []
    done = 0
    for n in steps:
        with np.errstate(over="ignore", invalid="ignore"):
            q = run(q, axis, angle, n - done, UPDATES.index(update))
        done = n
        size = float(np.sqrt(np.sum(q * q)))
        # Whole turns are taken off before the angle is halved: they change q's sign at most.
        truth = quaternion.exp(axis * math.remainder(angle * n, 2.0 * math.pi))
        length.append(abs(size - 1.0))
        attitude.append(float(quaternion.angle_between(q / size, truth)))
    return np.array(length), np.array(attitude)


def added_length(angle: float, steps: float | Array) -> Array:
    """Length after n steps q + h q' / 1: (1 + (h w / 2)^2)^(n / 2), because q' is perpendicular.

    Args:
        angle: turn per step, h w [rad].
        steps: n.
    """
    return np.exp(0.5 * np.asarray(steps, dtype=float) * math.log1p(0.25 * angle**2))


def added_lag(angle: float, steps: float | Array) -> Array:
    """Turn that is missing after n such steps: n (h w - 2 atan(h w / 2)), about n (h w)^3 / 12."""
    return np.asarray(steps, dtype=float) * (angle - 2.0 * math.atan(0.5 * angle))


def tumble_errors(integrator: str, steps: Sequence[int]) -> Array:
    """Attitude error of the free asymmetric body after 20 s [rad], by number of steps."""
    problem = problems.tumble()
    return np.array(
        [
            problem.error(simulate(problem.system, integrator, problem.duration / n, n).q[-1])
            for n in steps
        ]
    )


@chart
def quaternion_drift() -> str:
    """Length and attitude of a turning quaternion by three updates, and by RK4 in two forms."""
    import matplotlib.pyplot as plt

    angles = (1e-3, 1e-2)
    steps = np.unique(np.geomspace(10, 1_000_000, 26).astype(int))
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.8), layout="constrained")
    lines, data = [], []
    floor = 1e-17
    for update, colour in zip(UPDATES, (ORANGE, BLUE, GREEN), strict=True):
        for angle, marker in zip(angles, ("o", "^"), strict=True):
            length, attitude = spin_errors(update, angle, steps.tolist())
            text = f"{update}, {angle * 1e3:g} mrad a step"
            left.loglog(steps, np.maximum(length, floor), marker, ms=4, color=colour, label=text)
            middle.loglog(
                steps, np.maximum(attitude, floor), marker, color=colour,
                ms=8 if update == "added" else 4, mfc="none" if update == "added" else colour,
            )  # fmt: skip
            line = (
                f"{text:<44} after 1e6 steps: length {length[-1]:.2e} off, "
                f"attitude {attitude[-1]:.2e} rad off"
            )
            if update == "added":
                line += f" (theory: {float(added_length(angle, 1e6)) - 1.0:.2e}"
                line += f", {float(added_lag(angle, 1e6)):.2e})"
                left.loglog(steps, added_length(angle, steps) - 1.0, color="black", lw=1)
                middle.loglog(steps, added_lag(angle, steps), color="black", lw=1)
            lines.append(line)
            data.append(
                {
                    "update": update,
                    "angle": angle,
                    "length": length.tolist(),
                    "attitude": attitude.tolist(),
                }
            )
    left.plot([], [], color="black", lw=1, label="theory")
    left.set(
        xlabel="steps",
        ylabel="distance of |q| from 1 (0 drawn as 1e-17)",
        ylim=(floor / 3.0, 1e15),
        title="Added, a quaternion grows",
    )
    left.legend(fontsize="small", loc="upper left")
    middle.set(
        xlabel="steps",
        ylabel="attitude error [rad]",
        ylim=(floor / 3.0, 1e15),
        title="Renormalising does not bring the lag back",
    )
    counts = (500, 1000, 2000, 4000, 8000)
    for name, label, colour in (
        ("rk4_renormalised", "RK4 added, renormalised", BLUE),
        ("rk4", "RK4 of Munthe-Kaas (exponential map)", GREEN),
    ):
        error = tumble_errors(name, counts)
        dt = 20.0 / np.array(counts)
        order = float(np.polyfit(np.log(dt), np.log(error), 1)[0])
        right.loglog(dt * 1e3, error, "o-", color=colour, label=f"{label}: order {order:.2f}")
        lines.append(
            f"tumble over 20 s, {name:<17} order {order:.2f}, error at 10 ms {error[2]:.2e} rad"
        )
        data.append({"integrator": name, "dt": dt.tolist(), "error": error.tolist()})
    right.set(
        xlabel="step [ms]",
        ylabel="attitude error after 20 s of free tumbling [rad]",
        title="At fourth order it hardly matters",
    )
    right.set_xticks([2.5, 5, 10, 20, 40], ["2.5", "5", "10", "20", "40"])
    right.minorticks_off()
    right.set_ylim(1e-11, 1e-4)
    right.legend(fontsize="small", loc="upper left")
    for ax in (left, middle, right):
        ax.grid(True, alpha=0.3)
    save("quaternion_drift", figure, data)
    return "\n".join(lines)
