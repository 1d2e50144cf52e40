"""Where it fails in the long run: energy, phase, varying steps, and the length of a quaternion."""

import math
from collections.abc import Iterator, Sequence

import numba
import numpy as np

from course.charts import chart
from course.charts.rigid_body.failures import LABELS
from course.check import one_of
from course.compiled import VECTOR, compiled
from course.measure.figure import Panel, Series
from course.measure.stability import batch_map
from course.rigid_body import problems, quaternion
from course.rigid_body.integrators import INTEGRATORS, Array, semi_implicit_euler, simulate

# --- a million steps ------------------------------------------------------------------------------


@chart
def long_run_energy(
    steps: int = 1_000_000, dt: float = 0.02, amplitude: float = 1.0, names: Sequence[str] = ()
) -> Iterator[Panel]:
    """Chart energy of the pendulum over a million steps, by all six integrators.

    Args:
        steps: how many, at least 1000.
        dt: step [s].
        amplitude: angle of release [rad].
        names: of integrators; all six by default.
    """
    system = problems.pendulum(amplitude).system
    panel = Panel(
        "Symplectic methods keep their first error; RK4's grows without end",
        "steps of 20 ms (period 2.1 s)",
        "largest relative energy error so far",
        scale="log",
        xlim=(10, steps),
    )
    ends = np.unique(np.geomspace(10, steps, 120).astype(int))
    for name in names or LABELS:
        path = simulate(system, name, dt, steps, every=1)
        with np.errstate(over="ignore", invalid="ignore"):
            energy = problems.pendulum_energy(path.q.T, path.v.T, system.params)
            error = np.abs(energy / energy[0] - 1.0)
        # A diverged run counts as infinitely wrong.
        error[~np.isfinite(error)] = math.inf
        first, last = np.max(error[: steps // 100]), np.max(error[-(steps // 100) :])
        symplectic = INTEGRATORS[name].symplectic
        panel.series.append(
            Series(
                LABELS[name] + (", symplectic" if symplectic else ""),
                ends,
                # The running maximum: a swing must not look like a recovery.
                np.maximum.accumulate(error)[ends],
                name,
                "-" if symplectic else "--",
                width=2.0,
                note=f"{name:<20} largest relative energy error: first 1 % {first:.2e}, last 1 % "
                f"{last:.2e}, ratio {last / first:.3g}",
            )
        )
    yield panel


# --- symplectic is not enough ---------------------------------------------------------------------


def pattern_growth(steps: Sequence[float]) -> float:
    """Return growth per cycle of a repeated pattern of steps of semi-implicit Euler on x'' = -x.

    A step is [[1 - h^2, h], [-h, 1]], of determinant 1, and so is their product: it is bounded
    while |trace| <= 2. Beyond, one eigenvalue is larger than 1 although every step alone keeps area
    and is stable. For two steps a and b the trace is 2 - (a + b)^2 + a^2 b^2.

    Args:
        steps: omega times each step of the cycle.

    Returns:
        The modulus of the largest eigenvalue: 1 where bounded.
    """
    product = np.eye(2)
    for h in steps:
        product = np.array([[1.0 - h * h, h], [-h, 1.0]]) @ product
    trace = abs(float(np.trace(product)))
    # Larger root of lambda^2 - trace lambda + 1.
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
    # Over the second half, when the growing direction dominates; energy is amplitude squared.
    growth = (energy[-1] / energy[half]) ** (0.5 / (cycles - half))
    return energy / energy[0], float(growth)


def resonant_pattern(long: float = 0.3, short: float = 0.1) -> list[float]:
    """Return steps that are long for a quarter of a turn and short for a quarter.

    Both are far below the limit of 2.

    Args:
        long: omega times the longer step.
        short: omega times the shorter step.
    """
    quarter = 0.5 * math.pi
    # A step of h turns by 2 asin(h / 2): as many as a quarter of a turn takes.
    count = [round(quarter / (2.0 * math.asin(0.5 * h))) for h in (long, short)]
    return [long] * count[0] + [short] * count[1]


def _pair(q: Array, v: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Return a step a and a step b of semi-implicit Euler."""
    for h in (a, b):
        q, v = semi_implicit_euler(q, v, problems.oscillator_acceleration, h, np.array([1.0, 0.0]))
    return q, v


@chart
def symplectic_not_enough(
    side: int = 160, cycles: int = 100, periods: int = 1000, omega_dt: float = 0.1
) -> Iterator[Panel]:
    """Chart steps that vary: they can turn a symplectic method unstable; phase is never protected.

    Args:
        side: points of the map, each way.
        cycles: of the patterns.
        periods: of the undamped oscillator whose phase is watched.
        omega_dt: its step.
    """
    h = np.linspace(0.0, 2.0, side + 1)[1:]
    pairs = batch_map(_pair, h, h, slack=1e-6, quantity="growth per pair of steps")
    # |trace| = 2 is h1 h2 = 2 + h1 - h2 and h1 h2 = 2 - h1 + h2.
    stability_map = Panel(
        "h1 and h2 in turn: may explode below 2",
        "omega h1",
        "omega h2",
        grid=pairs,
    )
    stability_map.series = [
        Series("|trace| = 2", (2.0 + h) / (1.0 + h), h, "theory on a map", "--"),
        Series("", h, (2.0 + h) / (1.0 + h), "theory on a map", "--"),
        Series("1.7 and 1.2", [1.7], [1.2], "", ""),
    ]
    a, b = np.meshgrid(h, h)
    trace = np.abs(2.0 - (a + b) ** 2 + (a * b) ** 2)
    theory = np.maximum(1.0, 0.5 * trace + np.sqrt(np.maximum(0.25 * trace**2 - 1.0, 0.0)))
    clear = np.abs(trace - 2.0) > 1e-6  # on the boundary itself rounding decides
    deviation = np.max(np.abs(pairs.values - theory)[clear])
    stability_map.notes.append(
        "h1, h2 in turn, both below the limit: unstable on "
        f"{np.mean(~pairs.within()):.1%} of the square; measured and theoretical growth differ by "
        f"{deviation:.1e} at most"
    )
    yield stability_map

    middle = Panel(
        "Far below the limit too,\nif the steps vary in tune with the motion",
        "cycles of the pattern",
        "energy over the first",
        scale="log y",
        ylim=(1e-2, 1e20),
        theory="eigenvalue of the cycle",
    )
    for name, pattern in {
        "1.7 and 1.2 in turn": [1.7, 1.2],
        "0.3 five times, 0.1 sixteen times": resonant_pattern(),
        "0.3 only": [0.3] * 10,
    }.items():
        energy, measured = measured_pattern(pattern, cycles)
        growth = pattern_growth(pattern)
        half = cycles // 2

        def line(n: float, at: float = energy[half], by: float = growth, half: int = half) -> float:
            return float(at * by ** (2.0 * (n - half)))

        grows = growth > 1.0
        text = f"x {measured:.5f}, theory {growth:.5f}" if grows else "bounded, theory 1"
        middle.series.append(
            Series(
                f"omega h = {name}",
                np.arange(energy.size),
                energy,
                marker="",
                theory=line if grows else None,
                note=f"omega h = {name:<32} largest {max(pattern):.1f} of the limit 2: amplitude "
                f"per cycle {text}",
            )
        )
    yield middle

    right = Panel(
        f"Phase error at omega h = {omega_dt:g}:\nit grows with every method",
        "periods",
        "phase error [rad]",
        scale="log",
        lines=[("y", math.pi, "half a period wrong")],
    )
    every = 10
    # Recorded every few steps: the phase is unwrapped, so it must not move by half a turn between.
    records = math.ceil(periods * 2.0 * math.pi / omega_dt / every)
    for name in ("semi_implicit_euler", "velocity_verlet", "implicit_midpoint", "rk4"):
        system = problems.oscillator(omega=1.0).system
        path = simulate(system, name, omega_dt, records * every, every)
        # Phase of the numerical motion less the true one, without jumps of a full turn.
        error = np.unwrap(np.arctan2(-path.v[:, 0], path.q[:, 0])) - path.t  # positive: ahead
        turns = path.t / (2.0 * math.pi)
        right.series.append(
            Series(
                LABELS[name],
                turns[1:],
                np.abs(error[1:]),
                name,
                "--" if name == "velocity_verlet" else "-",
                marker="",
                note=f"{name:<20} phase {error[-1] / turns[-1]:+.3e} rad per period at omega dt = "
                f"{omega_dt:g}",
            )
        )
    yield right


# --- quaternion drift -----------------------------------------------------------------------------

UPDATES = ("added", "added and renormalised", "exponential map")
FLOOR = 1e-17  # where an error of exactly zero is drawn


def _spin(q, omega, h, steps, update):
    """Integrate a constant body rate for some steps.

    Update 0 adds, 1 renormalises as well, 2 multiplies by the exponential.
    """
    for _ in range(steps):
        if update == 2:
            q = quaternion.product(q, quaternion.exp(h * omega))
        else:
            q = q + h * quaternion.derivative(q, omega)
            if update == 1:
                q = quaternion.normalise(q)
    return q


def spin_errors(update: str, angle: float, steps: Sequence[int]) -> tuple[Array, Array]:
    """Return errors of a quaternion that turns at a constant rate.

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
    length, orientation = [], []
    done = 0
    for n in steps:
        with np.errstate(over="ignore", invalid="ignore"):
            # Continued from the last length: one run serves all numbers of steps.
            q = run(q, axis, angle, n - done, UPDATES.index(update))
        done = n
        size = float(np.sqrt(np.sum(q * q)))
        # Whole turns are taken off before the angle is halved: they change q's sign at most.
        truth = quaternion.exp(axis * math.remainder(angle * n, 2.0 * math.pi))
        length.append(abs(size - 1.0))
        orientation.append(float(quaternion.angle_between(q / size, truth)))
    return np.array(length), np.array(orientation)


def added_length(angle: float, steps: float | Array) -> Array:
    """Return the length after n steps q + h q' / 1.

    (1 + (h w / 2)^2)^(n / 2), because q' is perpendicular.

    Args:
        angle: turn per step, h w [rad].
        steps: n.
    """
    return np.exp(0.5 * np.asarray(steps, dtype=float) * math.log1p(0.25 * angle**2))


def added_lag(angle: float, steps: float | Array) -> Array:
    """Turn that is missing after n such steps: n (h w - 2 atan(h w / 2)), about n (h w)^3 / 12."""
    return np.asarray(steps, dtype=float) * (angle - 2.0 * math.atan(0.5 * angle))


@chart
def quaternion_drift(
    at_most: int = 1_000_000,
    points: int = 26,
    angles: Sequence[float] = (1e-3, 1e-2),
    counts: Sequence[int] = (500, 1000, 2000, 4000, 8000),
) -> Iterator[Panel]:
    """Chart errors of a turning quaternion by three updates, and by RK4 in two forms.

    Args:
        at_most: steps of the longest turn.
        points: how many lengths of turns.
        angles: turns per step [rad].
        counts: steps of the tumble over 20 s.
    """
    steps = np.unique(np.geomspace(10, at_most, points).astype(int))
    norm_panel, orientation_panel = (
        Panel(title, "steps", y, scale="log", ylim=(FLOOR / 3.0, top))
        for title, y, top in (
            ("Added, a quaternion grows", "distance of |q| from 1 (0 is at 1e-17)", 1e7),
            ("Renormalising does not remove the lag", "orientation error [rad]", 1.0),
        )
    )
    for update in UPDATES:
        for angle, marker in zip(angles, "o^sD", strict=False):
            length, orientation = spin_errors(update, angle, steps.tolist())
            added = update == "added"
            text = f"{update}, {angle * 1e3:g} mrad a step"
            taken = f"{at_most:.0e}".replace("e+0", "e")
            note = f"{text:<44} after {taken} steps: length {length[-1]:.2e} off, orientation "
            note += f"{orientation[-1]:.2e} rad off"
            if added:
                note += f" (theory: {float(added_length(angle, at_most)) - 1.0:.2e}, "
                note += f"{float(added_lag(angle, at_most)):.2e})"

            def longer(n: float, angle: float = angle) -> float:
                return float(added_length(angle, n)) - 1.0

            def lag(n: float, angle: float = angle) -> float:
                return float(added_lag(angle, n))

            norm_panel.series.append(
                Series(
                    text,
                    steps,
                    np.maximum(length, FLOOR),
                    update,
                    "",
                    longer if added else None,
                    marker=marker,
                    size=4.0,
                    note=note,
                )
            )
            orientation_panel.series.append(
                Series(
                    text,
                    steps,
                    np.maximum(orientation, FLOOR),
                    update,
                    "",
                    lag if update != "exponential map" else None,
                    marker=marker,
                    hollow=added,
                    size=8.0 if added else 4.0,
                )
            )
    yield from (norm_panel, orientation_panel)

    right = Panel(
        "At fourth order it hardly matters",
        "step [ms]",
        "orientation error after 20 s of free tumbling [rad]",
        scale="log",
        ylim=(1e-11, 1e-4),
        ticks=(2.5, 5, 10, 20, 40),
    )
    problem = problems.tumble()
    dt = problem.duration / np.array(counts)
    for name, label in (
        ("rk4_renormalised", "RK4 added, renormalised"),
        ("rk4", "RK4 of Munthe-Kaas (exponential map)"),
    ):
        ends = [simulate(problem.system, name, problem.duration / n, n).q[-1] for n in counts]
        error = np.array([problem.error(q) for q in ends])
        order = np.polyfit(np.log(dt), np.log(error), 1)[0]
        middle_step = len(counts) // 2
        right.series.append(
            Series(
                f"{label}: order {order:.2f}",
                dt * 1e3,
                error,
                name,
                note=f"tumble over 20 s, {name:<17} order {order:.2f}, error at "
                f"{dt[middle_step] * 1e3:g} ms {error[middle_step]:.2e} rad",
            )
        )
    yield right
