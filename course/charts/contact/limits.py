"""Chapter 2, limits of contact models: the penalty's step, recovery from overlap, sweeps needed."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.contact import scenes, solve
from course.contact.models import gauss_seidel, penalty_force, penalty_step_limit
from course.contact.problem import MAX_RECOVERY_SPEED
from course.contact.scenes import GRAVITY, Scene, run
from course.measure.figure import Panel, Series
from course.measure.stability import amplification, limit, spectral_radius, stability_map
from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import Options

Array = NDArray[np.float64]
Theory = Callable[[float], float]

# --- the penalty step -----------------------------------------------------------------------------


def penalty_step(zeta: float, scheme: str, dt: float) -> Callable[[Array], Array]:
    """Return one step (x, v) -> (x, v) of 1 kg pulled into a penalty contact with omega = 1.

    Args:
        zeta: damping ratio.
        scheme: "explicit" or "semi-implicit".
        dt: omega dt.
    """

    def step(state: Array) -> Array:
        force = np.zeros(1)
        x, v = state
        # Shifted by a large depth, so that the contact never opens: its force is then linear.
        penalty_force(1e3 - x, np.array([v]), 1.0, 2.0 * zeta, np.zeros(0), 1.0, True, force)
        # A constant load balances the shift, so that the state is the deviation from rest.
        new = v + dt * (force[0] - 1e3)
        return np.array([x + dt * (v if scheme == "explicit" else new), new])

    return step


def growth(scheme: str, dt: float, zeta: float) -> float:
    """Return growth per step of `penalty_step`."""
    return spectral_radius(amplification(penalty_step(zeta, scheme, dt), 2))


def step_limit(zeta: float, scheme: str) -> float:
    """Return the largest stable omega dt by theory.

    Explicit Euler: 2 zeta up to critical damping, then 2 (zeta - sqrt(zeta^2 - 1)). Semi-implicit,
    the damper taken from the old velocity: 2 (sqrt(1 + zeta^2) - zeta).
    """
    if scheme == "explicit":
        return 2.0 * (zeta - math.sqrt(zeta**2 - 1.0)) if zeta > 1.0 else 2.0 * zeta
    return float(penalty_step_limit(zeta))


def measured_limit(zeta: float, scheme: str) -> float:
    """Return the same by bisection on the step's matrix."""

    def stable(dt: float) -> bool:
        return growth(scheme, dt, zeta) <= 1.0 + 1e-10

    return limit(stable, 1e-4, 8.0, rel=1e-8)


def calm(zeta: float, ratio: float, refsafe: bool, time: float = 0.02) -> bool:
    """Return whether a ball of 1 kg in MuJoCo's contact, a thousandth off its rest, comes to rest.

    For a damping ratio, a step over the time constant, the flag and the time constant [s].
    """
    options = Options(
        ratio * time,
        condim=1,
        solref=(time, zeta),
        solimp=(0.9, 0.9, 0.001, 0.5, 2.0),
        refsafe=refsafe,
    )
    runner = mujoco_contact.tower(options, [1.0])
    # Of constant impedance d: (1 - d) g = d k d r.
    stiffness = options.softness().stiffness(options.solref, options.dt)[0]
    rest = -0.1 * GRAVITY / (0.9**2 * stiffness)
    # A small deviation: within the contact, so that the system stays linear.
    runner.q0[:] = 1.001 * rest
    return bool(abs(runner.run(400)[0][0] / rest - 1.0) < 1e-3)


def soft_limit(zeta: float) -> float:
    """Return the largest stable step over time constant T of MuJoCo's contact without refsafe.

    One body's, of constant impedance, is a spring and damper of omega = 1 / (T zeta) and the ratio
    zeta.
    """
    return zeta * step_limit(zeta, "semi-implicit")


SAVED = 1.0 / math.sqrt(8.0)  # damping ratio from which `soft_limit` is above refsafe's 1/2


def _clamped(zetas: Sequence[float]) -> Panel:
    """Return MuJoCo's limit with refsafe and without."""
    panel = Panel(
        "MuJoCo's soft contact: the largest stable step",
        "damping ratio",
        "step / time constant",
        theory="formula for a spring and damper",
        ylim=(0.0, 1.2),
        lines=[("y", 0.5, "limit that refsafe sets"), ("x", SAVED, "ratio 1/sqrt 8")],
    )

    def limited(zeta: float, safe: bool) -> float:
        near = soft_limit(zeta)
        # Bisection from half to one and a half times the theory.
        return limit(lambda ratio: calm(zeta, ratio, safe), 0.5 * near, 1.5 * near, rel=1e-2)

    for safe in (False, True):
        selected = [z for z in zetas if not (safe and calm(z, 20.0, safe))]
        y = [limited(z, safe) for z in selected]
        name = "MuJoCo, refsafe" + ("" if safe else " off")
        message = ", ".join(f"{z:g}: {r:.3f}" for z, r in zip(selected, y, strict=True))
        note = f"{name:<19} zeta: largest step over time constant {message}"
        law = None if safe else soft_limit
        panel.series.append(Series(name, selected, y, name, theory=law, note=note))
    return panel


@chart
def contact_penalty_limit(
    size: int = 60, zetas: Sequence[float] = (0.1, 0.2, 0.3, 0.34, 0.37, 0.5, 0.7, 1.0, 1.5, 2.0)
) -> Iterator[Panel]:
    """Chart largest step of penalty contact: growth per step over step and damping, theory on it.

    Maps of `size` by `size` points. And of MuJoCo's soft contact, with its clamp and without.
    """
    x, y = np.linspace(0.02, 2.6, size), np.linspace(0.02, 2.0, size)
    for scheme in ("explicit", "semi-implicit"):
        grown = stability_map(functools.partial(growth, scheme), x, y, slack=1e-9)
        grown = replace(grown, edge="growth 1, computed")
        edge = np.array([step_limit(zeta, scheme) for zeta in y])
        panel = Panel(
            f"{scheme} Euler: damping {'helps up to 1' if scheme == 'explicit' else 'hurts'}",
            "step times natural frequency, ω h",
            "damping ratio",
            grid=grown,
            xlim=(x[0], x[-1]),
            ylim=(y[0], y[-1]),
        )
        panel.series.append(
            Series("growth 1, formula", edge, y, "theory on a map", "--", marker="")
        )
        for zeta in (0.1, 0.5, 1.0, 1.5):
            result = measured_limit(zeta, scheme)
            panel.notes.append(
                f"{scheme:<14} zeta {zeta:.1f}: omega dt {result:.5f}, theory "
                f"{step_limit(zeta, scheme):.5f}"
            )
        if scheme != "explicit":
            share = cube_limit() / cube_limit(1)
            panel.notes.append(
                f"a cube on two springs, semi-implicit: {share:.4f} of one spring's limit, theory "
                f"{1.0 / math.sqrt(3.0):.4f}: pitch decides"
            )
        yield panel
    yield _clamped(zetas)


def cube_limit(springs: int = 2, stiffness: float = 1e4) -> float:
    """Return the largest stable step [s] of a square of 1 kg on springs under its corners.

    The step is found by bisection.

    Two of them turn it with omega^2 = 2 k a^2 / (2 m a^2 / 3) = 3 k / m, faster than they lift it;
    one is under its middle.
    """
    side = np.array([-0.5, 0.5]) if springs == 2 else np.zeros(1)
    rows = np.column_stack((np.ones(springs), side))[:, None]
    load = np.array([-10.0 * springs * stiffness, 0.0])  # at rest 10 deep: no spring lets go
    scene = Scene(
        np.diag([1.0, 1.0 / 6.0]),
        rows,
        np.full(springs, -10.0),
        load,
        np.zeros((springs, 0)),
        np.zeros(2),
        np.zeros(2),
    )

    def stable(dt: float) -> bool:
        def step(state: Array) -> Array:
            problem = scene.problem(dt, state[:2], state[2:])
            v = solve("penalty", problem, stiffness=stiffness, damping=0.0).velocity
            return np.concatenate((state[:2] + dt * v, v))

        # Amplification matrix of the real step, by columns; its spectral radius decides.
        return spectral_radius(amplification(step, 4)) <= 1.0 + 1e-7

    return limit(stable, 1e-4, 1.0, rel=1e-7)


# --- recovery -------------------------------------------------------------------------------------


def ejected(dt: float, model: str = "pgs", depth: float = 0.01, cap: float = math.inf) -> float:
    """Return how fast a ball that starts at rest and too deep leaves the ground [m/s].

    The largest upward speed within 50 ms.

    Args:
        dt: step [s].
        model: one of ours, or "MuJoCo" for its contact at default softness.
        depth: at the start [m].
        cap: on the speed of recovery, of ours [m/s].
    """
    # 50 ms at any step, so that all have the same time to leave.
    steps = max(2, round(0.05 / dt))
    if model == "MuJoCo":
        runner = mujoco_contact.tower(Options(dt, condim=1), [1.0])
        runner.q0[:] = -depth
        return float(np.max(runner.samples(steps).v))
    scene = replace(scenes.ball_drop(-depth), max_recovery_speed=cap)
    return float(np.max(run(scene, model, dt, steps).v))


@chart
def contact_recovery(
    steps: Sequence[float] = (1e-2, 5e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4), depth: float = 0.01
) -> Iterator[Panel]:
    """Chart how fast a ball that starts 1 cm deep is thrown out, over the step, capped and not.

    A rigid contact takes back a share of the depth in each step (Baumgarte stabilisation): without
    a cap on the speed a shorter step throws the ball out faster.
    """
    panel = Panel(
        "A ball starts 1 cm deep: a shorter step ejects it faster",
        "step [s]",
        "largest upward speed [m/s]",
        scale="log",
        theory="share of the depth / step",
    )
    share = scenes.ball_drop().recovery
    rows: dict[str, tuple[str, dict[str, Any], Theory | None]] = {
        "recovery, no cap": ("pgs", {}, lambda dt: share * depth / dt),
        "recovery, speed capped": (
            "pgs",
            {"cap": MAX_RECOVERY_SPEED},
            lambda dt: min(share * depth / dt, MAX_RECOVERY_SPEED),
        ),
        "MuJoCo, default": ("MuJoCo", {}, None),
    }
    for name, (model, options, law) in rows.items():
        y = [ejected(dt, model, depth, **options) for dt in steps]
        message = ", ".join(f"{1e3 * dt:g} ms: {v:.2f}" for dt, v in zip(steps, y, strict=True))
        note = f"{name:<23} largest upward speed [m/s] {message}"
        panel.series.append(
            Series(name, steps, y, name, theory=law, hollow=model == "MuJoCo", note=note)
        )
    yield panel


# --- sweeps ---------------------------------------------------------------------------------------


def sweeps_needed(masses: Sequence[float], tolerance: float = 1e-6, at_most: int = 10**7) -> int:
    """Return sweeps of projected Gauss-Seidel until a tower's forces are right to the tolerance."""
    problem = scenes.tower(masses).problem(0.01)
    A, b, g = problem.scaled, problem.offset, np.zeros(len(masses))
    # Each contact carries all the weight above it: impulses of one step of 10 ms.
    truth = 0.01 * GRAVITY * np.cumsum(np.asarray(masses)[::-1])[::-1]

    def error(sweeps: int) -> float:
        result = g.copy()
        # Always from zero, with a tolerance that never stops the sweeps early.
        gauss_seidel(A, b, result, 1, associated=False, sweeps=sweeps, tolerance=1e-300)
        return float(np.max(np.abs(result / truth - 1.0)))

    high = 1
    while error(high) > tolerance and high < at_most:
        high *= 2
    low = high // 2
    # Bisection to 1 in 500: the error falls monotonically with the sweeps.
    while high - low > max(1, high // 500):
        middle = (low + high) // 2
        low, high = (low, middle) if error(middle) <= tolerance else (middle, high)
    return high


@chart
def contact_sweeps(
    ratios: Sequence[float] = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0),
    heights: Sequence[int] = (3, 5, 10, 20, 40),
    tolerance: float = 1e-6,
) -> Iterator[Panel]:
    """Chart sweeps of projected Gauss-Seidel until forces are right to the tolerance.

    By the ratio of top to bottom mass, and by the number of equal bodies, with theory.
    """
    log = math.log(1.0 / tolerance)
    panel = Panel(
        "Heavy on light: sweeps grow with the ratio",
        "mass ratio",
        "sweeps until the error is 1e-6",
        scale="log",
        theory="theory, thin lines",
    )
    towers: list[tuple[str, str, Callable[[float], list[float]], Theory | None]] = [
        (
            "two bodies, heavy on light",
            "sweeps, true cone",
            lambda x: [1.0, x],
            lambda x: (1.0 + x) * log,
        ),
        (
            "tower of 10, the top heavy",
            "exact pyramid (LCP)",
            lambda x: [1.0] * 9 + [x],
            lambda x: 9.0 * x * log,
        ),
        ("two bodies, light on heavy", "convex cone", lambda x: [x, 1.0], None),
    ]

    def series(
        label: str, key: str, x: Sequence[float], result: list[int], last: int, law: Theory | None
    ) -> Series:
        # Slope of the large ratios only, where the asymptotic law holds.
        slope = np.polyfit(np.log(x[-last:]), np.log(result[-last:]), 1)[0]
        note = f"{label:<28} slope {slope:6.3f}, at {x[-1]:g}: {result[-1]:.0f} sweeps"
        return Series(label, x, result, key, theory=law, note=note)

    last = sum(x >= 30.0 for x in ratios)
    for label, key, masses, law in towers:
        result = [sweeps_needed(masses(x), tolerance) for x in ratios]
        panel.series.append(series(label, key, ratios, result, last, law))
    yield panel
    result = [sweeps_needed([1.0] * n, tolerance) for n in heights]
    equal = series(
        "equal tower",
        "sweeps, true cone",
        [float(n) for n in heights],
        result,
        3,
        lambda m: (2.0 * m / math.pi) ** 2 * log,
    )
    yield Panel(
        "Equal towers: sweeps grow with the square",
        "bodies",
        "sweeps until the error is 1e-6",
        [equal],
        theory="theory, thin line",
        scale="log",
        ticks=[float(n) for n in heights],
    )
