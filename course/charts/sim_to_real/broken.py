"""The break-it lab with each limit from both sides, and what shaping does to learning."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.oracles.mujoco.lab import PALM, Lab, lift, trials
from course.sim_to_real import Process, grid, learning_steps, shaped, share_of_bound, transfer_bound
from course.sim_to_real.shaping import evaluate_policy, value_iteration

POLICY = replace(Lab(), force=1.2 * Lab().needed)
NO_END = np.zeros(2, dtype=bool)
STIFF = 5e4  # of the direct contact, for a unit of mass [1/s^2]


@chart(columns=2)
def break_it(
    forces: Sequence[float] = (0.4, 0.7, 0.9, 0.95, 1.0, 1.05, 1.2, 2.0, 3.6, 5.0, 7.0, 10.0),
    offsets: Sequence[float] = (0, 10, 14, 15, 16, 20, 24, 25, 26, 30, 40),
    steps: Sequence[float] = (1, 2, 3, 3.5, 4, 5, 7, 10, 15, 20, 25, 30, 35, 40),
    n: int = 10,
) -> Iterator[Panel]:
    """Chart a gripper whose model is wrong: force and friction, camera, time step.

    Args:
        forces: over m (g + a) / (2 mu).
        offsets: of the camera [mm].
        steps: of time [ms].
        n: lifts of a success rate.
    """
    panel = Panel(
        "Grip: slips below 1, knocked out far above",
        "force / needed force m (g + a) / (2 mu)",
        "slid in the jaw [mm]",
        scale="log x",
        lines=[("x", 1.0, "limit")],
        ticks=(0.4, 1, 3.6, 10),
    )
    for mu in (0.4, 0.9, 1.2):
        lab = replace(POLICY, friction=mu)
        runs = [lift(replace(lab, force=x * lab.needed)) for x in forces]
        slid = [1e3 * min(run.slid, 0.2) for run in runs]
        held = [x for x, run in zip(forces, runs, strict=True) if run.held]
        largest = max(held) * lab.needed
        message = (
            f"friction {mu:g}: holds from {min(held):g} to {max(held):g} of it, {largest:.0f} N"
        )
        panel.series.append(Series(f"friction {mu:g}", forces, slid, note=message))
    for sim, present in ((0.3, 0.9), (1.2, 0.4)):
        lab = replace(POLICY, friction=present, force=1.2 * replace(POLICY, friction=sim).needed)
        share = f"{lab.force / lab.needed:.2f} of the force, {trials(lab, n)}/{n} held"
        panel.notes.append(f"tuned for friction {sim:g}, used at {present:g}: {share}")
    yield panel
    panel = Panel("Camera: lost beyond the jaw's free width", "offset [mm]", "share of boxes held")
    for label, opening in (("jaw free by 15 mm", 0.015), ("jaw free by 25 mm", 0.025)):
        y = [float(lift(replace(POLICY, opening=opening, offset=1e-3 * x)).held) for x in offsets]
        largest = max(x for x, h in zip(offsets, y, strict=True) if h)
        panel.series.append(Series(label, offsets, y, note=f"{label}: held to {largest:g} mm"))
        panel.lines = [*panel.lines, ("x", 1e3 * opening, f"{1e3 * opening:.0f} mm")]
    yield panel
    stiff = replace(POLICY, solref=(-STIFF, -2.0 * math.sqrt(STIFF)))
    kinds = {"default contacts": POLICY, "stiff contacts": stiff}
    rows = {
        k: [trials(replace(lab, dt=1e-3 * h), n) / n for h in steps] for k, lab in kinds.items()
    }
    kp, kv = POLICY.kp, POLICY.kv
    servo = 1e3 * (math.sqrt(kv**2 + 4.0 * kp * (PALM + 0.2)) - kv) / kp
    contact = 2e3 * (math.sqrt(2.0) - 1.0) / math.sqrt(STIFF)
    panel = Panel(
        "Time step: boxes held, and two limits",
        "time step [ms]",
        "share of boxes held",
        scale="log x",
        lines=[("x", contact, "limit of the stiff contact"), ("x", servo, "of the servo")],
    )
    for k, y in rows.items():
        message = ", ".join(f"{h:g} ms {v:.1f}" for h, v in zip(steps, y, strict=True))
        panel.series.append(Series(k, steps, y, note=f"{k}: {message}"))
    yield panel
    runs = [lift(replace(POLICY, dt=1e-3 * h)) for h in steps if h <= 25]
    panel = Panel(
        "How deep a finger sinks into the box", "time step [ms]", "largest depth [mm]", scale="log"
    )
    at = [h for h in steps if h <= 25]
    warned = sum(len(run.warnings) for run in runs)
    for label, depth in (
        ("while closing", [r.sunk for r in runs]),
        ("while lifting", [r.pressed for r in runs]),
    ):
        message = (
            f"{label}: {1e3 * depth[1]:.2f} mm at {at[1]:g} ms, {1e3 * max(depth):.2f} at most"
        )
        panel.series.append(
            Series(label, at, 1e3 * np.array(depth), note=f"{message}; {warned} warnings")
        )
    yield panel


@chart
def shaping_speed(
    n: int = 10,
    seeds: int = 15,
    at_most: int = 300_000,
) -> Iterator[Panel]:
    """Chart the effect of a potential on learning in a grid.

    Args:
        n: cells of a side.
        seeds: runs of a potential.
        at_most: steps of a run.
    """
    walk, far = grid(n), 2.0 * (n - 1)
    remaining = far - (np.arange(n * n) // n + np.arange(n * n) % n)
    phis = {
        "no potential": 0.0 * remaining,
        "- distance": -remaining,
        f"{far:g} - distance": far - remaining,
        f"2 (1 - distance / {far:g})": 2.0 * (far - remaining) / far,
        f"1 - distance / {far:g}": (far - remaining) / far,
        f"(1 - distance / {far:g}) / 100": 0.01 * (far - remaining) / far,
        "true value": value_iteration(walk).value,
    }
    panel = Panel(
        "Steps to a shortest path, by potential",
        f"steps of Q-learning, median of {seeds} runs",
        scale="log x",
        xlim=(30, 3e6),
    )
    steps = []
    for phi in phis.values():
        runs = [
            learning_steps(shaped(walk, phi), np.random.default_rng(s), int(far), at_most=at_most)
            for s in range(seeds)
        ]
        steps.append(float(np.median(runs)))
    message = "; ".join(f"{k}: {s:,.0f}" for k, s in zip(phis, steps, strict=True))
    words = [f"{s:,.0f}" for s in steps]
    panel.series.append(Series("", steps, list(phis), style="bar", tags=words, note=message))
    yield panel


@chart
def bound_reached(epss: Sequence[float] = (0.1, 0.03, 0.01, 1e-3)) -> Iterator[Panel]:
    """Chart how near a chain of two states comes to the transfer bound.

    Args:
        epss: probabilities of leaving the good state.
    """
    panel = Panel(
        "Share of the bound that a chain reaches",
        "epsilon",
        "difference of values / bound",
        scale="log x",
    )
    pays = np.zeros((2, 1, 2))
    pays[0] = 1.0
    for gamma in (0.9, 0.95, 0.99):
        moves = {e: np.array([[[1.0 - e, e]], [[0.0, 1.0]]]) for e in (0.0, *epss)}
        value = {
            e: evaluate_policy(Process(P, pays, gamma, NO_END), [0, 0])[0] for e, P in moves.items()
        }
        y = [(value[0.0] - value[e]) / transfer_bound(gamma, e) for e in epss]
        message = ", ".join(f"{v:.3f}" for v in y)
        panel.series.append(
            Series(
                f"gamma {gamma:g}",
                epss,
                y,
                note=f"gamma {gamma:g}: {message}",
                theory=partial(share_of_bound, gamma),
            )
        )
    yield panel
