"""One draw in every detail: masses, dampings, constants, friction and the state of the data."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills.catalogue.randomize.bench import (
    ALLOWED,
    CONSTANTS,
    ROUNDING,
    Array,
    Arrays,
    Bench,
    same_arrays,
)
from drills.values import describe


def one_draw(bench: Bench, seed: int) -> Arrays | None:
    """Judge one draw; None if the rest would make no sense."""
    attempt = bench.attempt
    state, computed = bench.state(), bench.computed()
    arrays = bench.randomize(seed)
    now = bench.state()
    if not same_arrays(attempt, "nothing else changes", bench.before, arrays, ALLOWED):
        return None
    sane = all(np.isfinite(arrays[name]).all() for name in ALLOWED & arrays.keys())
    if not attempt.require(
        "what was drawn is finite", sane, sentence="An array of the model holds NaN or infinity."
    ):
        return None
    if not (_mass(bench, arrays) and _damping(bench, arrays)):
        return None
    check_constants(bench, arrays)
    _friction(bench, arrays)
    check_state(bench, arrays, state, now, "randomize", computed)
    return arrays


def _mass(bench: Bench, arrays: Arrays) -> bool:
    attempt, (low, high) = bench.attempt, bench.setting.mass
    factors = bench.factors(arrays["body_mass"])
    excess = float(max(low - factors.min(), factors.max() - high, 0.0))
    world = arrays["body_mass"][0] == 0.0 and not arrays["body_inertia"][0].any()
    attempt.require("mass of the world", bool(world), sentence="Body 0, the world, got a mass.")
    inside = attempt.require(
        "mass factors",
        bool(excess <= 1e-9),
        sentence=f"A body's mass is {factors[_worst(factors, low, high)]:.4g} times its default.",
        got=describe(factors),
        expected=f"between {low:.4g} and {high:.4g}",
        error=excess,
        tolerance=1e-9,
        unit="1",
        why=ROUNDING,
    )
    if not inside:
        return False
    ratios = arrays["body_inertia"][1:] / bench.default.body_inertia[1:]
    gap = float(np.max(np.abs(ratios - factors[:, None])))
    retained = np.array_equal(arrays["body_inertia"], bench.default.body_inertia)
    return attempt.require(
        "inertia follows mass",
        gap <= 1e-9,
        sentence="A body's inertia is not multiplied by the factor of its mass: off by "
        f"{gap:.3g} times the default.",
        got=describe(ratios[:, 0]),
        expected=describe(factors),
        error=gap,
        tolerance=1e-9,
        unit="1",
        why=ROUNDING,
        slip="inertia_not_scaled" if retained else "",
    )


def _worst(values: Array, low: float, high: float) -> Any:
    return np.unravel_index(np.argmax(np.maximum(low - values, values - high)), values.shape)


def _damping(bench: Bench, arrays: Arrays) -> bool:
    attempt, (low, high) = bench.attempt, bench.setting.damping
    default, damped = bench.default.dof_damping, bench.damped
    added = arrays["dof_damping"] - default
    zero = damped & (default == 0.0)
    dead = bool(np.all(arrays["dof_damping"][zero] == 0.0))
    touched = bool(np.any(added[damped & ~zero] != 0.0))
    drew = not np.array_equal(arrays["body_mass"], bench.default.body_mass)
    slip = "no_joint_damped" if drew and not np.any(added) else ""
    slip = "zero_damping_stays" if touched else slip
    fine = attempt.require(
        "damping that is zero by default",
        not dead,
        sentence="The joints whose default damping is zero still have none.",
        got="0",
        expected=f"between {low:.4g} and {high:.4g}",
        unit="N m s/rad",
        slip=slip,
    )
    excess = float(max(low - added[damped].min(), added[damped].max() - high, 0.0))
    fine &= attempt.require(
        "damping of hinges and slides",
        bool(excess <= 1e-9),
        sentence=f"What was added to a joint is outside of the range by {excess:.3g} N m s/rad.",
        got=describe(added[damped]),
        expected=f"between {low:.4g} and {high:.4g}",
        error=excess,
        tolerance=1e-9,
        unit="N m s/rad",
        why=ROUNDING,
    )
    other = float(np.max(np.abs(added[~damped])))
    fine &= attempt.require(
        "damping of free and ball joints",
        other == 0.0,
        sentence="A free or ball joint got another damping. On a free body that is a drag which no "
        "joint has.",
        got=describe(arrays["dof_damping"][~damped]),
        expected=describe(default[~damped]),
        error=other,
        tolerance=0.0,
        unit="N m s/rad",
        why="they are not to be touched",
        slip="free_joints_damped" if np.all((added >= low) & (added <= high)) else "",
    )
    return fine


def check_constants(bench: Bench, arrays: Arrays) -> None:
    """Check the derived constants against those computed here from the primary values."""
    truth = bench.here(arrays)
    worst, where = 0.0, ""
    for name in CONSTANTS:
        want = getattr(truth, name)
        with np.errstate(over="ignore"):
            gap = np.abs(arrays[name] - want) / np.maximum(np.abs(want), 1e-12)
        if gap.max() > worst:
            worst, where = float(gap.max()), name
    stale = all(np.array_equal(arrays[name], bench.before[name]) for name in CONSTANTS)
    bench.attempt.require(
        "derived constants",
        worst <= 1e-9,
        sentence=f"{where} is off by {worst:.3g} of its value: it is not that of the new masses.",
        got=f"{worst:.3g}",
        expected="0",
        error=worst,
        tolerance=1e-9,
        unit="1",
        why="mj_setConst in another process differs by rounding at most",
        slip="constants_not_recomputed" if stale else "",
    )


def _friction(bench: Bench, arrays: Arrays) -> None:
    """Check the friction that contacts get, and that a sliding sled feels, computed here."""
    from course.oracles.mujoco.randomize import sliding_friction

    attempt, (low, high) = bench.attempt, bench.setting.friction
    model = bench.here(arrays)
    result = contact_frictions(model)
    values = np.array(list(result.values()))
    spread, excess = float(np.ptp(values)), max(low - values.min(), values.max() - high, 0.0)
    text = ", ".join(f"{name}: {mu:.4g}" for name, mu in result.items())
    fine = attempt.require(
        "friction of all contacts",
        bool(spread <= 1e-12 and excess <= 1e-9),
        sentence="The coefficients that MuJoCo gives to the contacts are not one draw: " + text,
        got=text,
        expected=f"one value between {low:.4g} and {high:.4g}",
        error=float(max(spread, excess)),
        tolerance=1e-9,
        unit="1",
        why=ROUNDING,
        slip=friction_slip(bench, arrays),
    )
    others = np.array_equal(
        arrays["geom_friction"][:, 1:], bench.default.geom_friction[:, 1:]
    ) and np.array_equal(arrays["pair_friction"][:, 2:], bench.default.pair_friction[:, 2:])
    attempt.require(
        "torsional and rolling friction",
        others,
        sentence="Torsional or rolling friction changed: the second and third column of "
        "geom_friction, the third to fifth of pair_friction.",
    )
    if not fine:
        return
    felt = sliding_friction(model, speed=9.0, steps=100)
    attempt.compare(
        "friction of a sled that slides",
        felt,
        values[0],
        tolerance=1e-6,
        unit="1",
        why="momentum taken over momentum given, which is exact but for rounding",
    )


def friction_slip(bench: Bench, arrays: Arrays) -> str:
    """Return the slip behind contacts that do not have one draw."""
    geoms, default = arrays["geom_friction"][:, 0], bench.default.geom_friction[:, 0]
    if np.unique(geoms).size == 1:
        retained = np.array_equal(arrays["pair_friction"], bench.before["pair_friction"])
        return "pair_forgotten" if retained else ""
    if (geoms == default).any():
        return "one_geom_only" if (geoms != default).any() else ""
    return "each_geom_by_itself" if np.unique(geoms).size > 2 else ""


def contact_frictions(model: Any) -> dict[str, float]:
    """Check the friction of contacts, that of the box on the puck included."""
    import mujoco

    result: dict[str, float] = {}
    data = mujoco.MjData(model)
    box, puck = (model.joint(name).qposadr[0] for name in ("box", "puck"))
    for stacked in (False, True):
        if stacked:
            data.qpos[box : box + 3] = data.qpos[puck : puck + 3] + [0.0, 0.0, 0.1099]
        mujoco.mj_forward(model, data)
        for contact in data.contact:
            names = sorted(model.geom(int(geom)).name for geom in contact.geom)
            for mu in contact.friction[:2]:
                key = " on ".join(names)
                result[key] = float(mu) if key not in result else max(result[key], float(mu))
    return result


def check_state(
    bench: Bench, arrays: Arrays, state: Any, now: Any, method: str, before: Arrays
) -> None:
    """Check that the state is kept, and that what follows from it is the present model's."""
    import mujoco

    attempt = bench.attempt
    selected = state.keys() == now.keys() and all(np.array_equal(state[k], now[k]) for k in state)
    reference = np.array_equal(now["qpos"], bench.default.qpos_spring)
    attempt.require(
        f"{method} keeps the state",
        selected,
        sentence=f"{method} changed time, qpos, qvel or ctrl of the data.",
        got=describe(now["qpos"]),
        expected=describe(state["qpos"]),
        slip="reference_pose" if reference else "",
    )
    if not selected:
        return
    data = mujoco.MjData(bench.here(arrays))
    data.qpos[:], data.qvel[:], data.ctrl[:] = state["qpos"], state["qvel"], state["ctrl"]
    mujoco.mj_forward(data.model, data)
    computed = bench.computed()
    for name, got in computed.items():
        want = getattr(data, name)
        gap = float(np.max(np.abs(got - want)))
        scale = max(1.0, float(np.max(np.abs(want))))
        stale = all(np.array_equal(computed[key], before[key]) for key in computed)
        attempt.require(
            f"{name} after {method}",
            gap <= 1e-9 * scale,
            sentence=f"data.{name} is not that of the model as it is now: mj_forward is missing, "
            "or comes before the last change.",
            error=gap,
            tolerance=1e-9 * scale,
            why="the same function of the same numbers",
            slip="data_not_refreshed" if stale else "",
        )
