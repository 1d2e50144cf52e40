"""Worked answers of chapter 3, one scene on several simulators: complete, of interview size."""

from collections.abc import Callable
from itertools import permutations

import numpy as np
from numpy.typing import ArrayLike


def sliding_stop(
    speed: float, angle: float, frame: float, mu: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a block sliding on a level floor stops, for three shapes of friction cone.

    Args:
        speed: at the start [m/s].
        angle: of its direction [rad].
        frame: angle of the contact's first axis, along which the pyramids are laid out [rad].
        mu: coefficient of friction along the axes.

    Returns:
        (straight distance from start to stop (3,) [m], angle from the launch to it, positive
        counterclockwise (3,) [rad]), for the circular cone, the pyramid inscribed in it, and the
        one around it.
    """
    slowing = 9.81 * mu
    start = speed * np.array([np.cos(angle - frame), np.sin(angle - frame)])
    u = np.abs(start)
    circle = speed * u / (2.0 * slowing)
    # Inscribed: all friction on the faster axis until both are equally fast, then half on each.
    slow, fast = np.sort(u)
    first = np.where(u == fast, (fast**2 - slow**2) / 2.0, slow * (fast - slow)) / slowing
    inscribed = first + slow**2 / slowing
    # Around it: each axis has all of its friction and stops by itself.
    around = u**2 / (2.0 * slowing)
    x, y = (np.sign(start) * np.array([circle, inscribed, around])).T
    turned = np.arctan2(start[0] * y - start[1] * x, start[0] * x + start[1] * y)
    return np.hypot(x, y), turned


def energy_drift(times: ArrayLike, energy: ArrayLike, period: float) -> tuple[float, float]:
    """Return what an energy loses or gains for good, apart from what comes back every period.

    Args:
        times: of the samples, (n,) [s].
        energy: total energy at these, (n,) [J].
        period: of the swing [s]; it has no part above its third harmonic.

    Returns:
        (drift [W], root mean square of the swing over a period [J]).
    """
    t = np.asarray(times, dtype=float)
    t = t - t.mean()
    columns = [np.ones_like(t), t]
    for k in (1, 2, 3):
        phase = 2.0 * np.pi * k * t / period
        columns += [np.cos(phase), np.sin(phase)]
    fit = np.linalg.lstsq(np.column_stack(columns), np.asarray(energy, dtype=float), rcond=None)[0]
    return float(fit[1]), float(np.sqrt(np.sum(fit[2:] ** 2) / 2.0))


def audit_model(
    ids: ArrayLike,
    masses: ArrayLike,
    inertias: ArrayLike,
    loaded_ids: ArrayLike,
    loaded_masses: ArrayLike,
    moments: ArrayLike,
    turns: ArrayLike,
    tolerance: float,
) -> np.ndarray:
    """Return which links of a file are not what the simulator has loaded.

    Args:
        ids: of the file's links, (n,).
        masses: of these, (n,) [kg].
        inertias: about their centres of mass, in the link's axes, (n, 3, 3) [kg m^2].
        loaded_ids: of the simulator's bodies, in its own order, (m,).
        loaded_masses: of these, (m,) [kg].
        moments: principal ones, (m, 3) [kg m^2].
        turns: unit quaternions (w, x, y, z), principal axes to the link's, (m, 4).
        tolerance: largest error allowed, as a part of what is compared.

    Returns:
        For each link of the file the sum of 1: other mass, 2: other inertia, 4: not there; (n,).
    """
    place = {int(one): j for j, one in enumerate(np.asarray(loaded_ids))}
    M, inertia = np.asarray(masses, dtype=float), np.asarray(inertias, dtype=float)
    marks = np.zeros(len(M), dtype=int)
    for i, one in enumerate(np.asarray(ids)):
        j = place.get(int(one))
        if j is None:
            marks[i] = 4
            continue
        w, *v = np.asarray(turns, dtype=float)[j]
        x, y, z = v
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        R = np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross
        loaded = R @ np.diag(np.asarray(moments, dtype=float)[j]) @ R.T
        if abs(np.asarray(loaded_masses)[j] - M[i]) > tolerance * M[i]:
            marks[i] += 1
        if np.abs(loaded - inertia[i]).max() > tolerance * np.abs(inertia[i]).max():
            marks[i] += 2
    return marks


def radar_areas(values: ArrayLike, worst: ArrayLike, best: ArrayLike) -> tuple[float, float]:
    """Return the smallest and the largest area of one radar chart, over the orders of its axes.

    Args:
        values: what was measured, positive, (n,), n from 3 on, each with a unit of its own.
        worst: the value at the centre of each axis, (n,).
        best: the value at its end, which may be the smaller one, (n,).

    Returns:
        (smallest, largest) area over all orders; an axis has the length 1.
    """
    value, low, high = (np.asarray(one, dtype=float) for one in (values, worst, best))
    radius = np.clip(np.log(value / low) / np.log(high / low), 0.0, 1.0)
    n = len(radius)
    orders = [(0, *others) for others in permutations(range(1, n))]
    ring = radius[np.array(orders)]
    corners = np.sum(ring * np.roll(ring, 1, axis=1), axis=1)
    areas = np.sin(2.0 * np.pi / n) / 2.0 * corners
    return float(areas.min()), float(areas.max())


def pick_engine(
    facts: ArrayLike, limits: ArrayLike, larger: ArrayLike, cost: ArrayLike
) -> tuple[int, int, float]:
    """Return the cheapest engine that meets every need, and the need that would change the pick.

    Args:
        facts: what was measured of each engine, positive, NaN where nothing was, (m, n).
        limits: the least or the most that is needed of each fact, (n,).
        larger: 1 where a larger fact is better, 0 where a smaller one is, (n,).
        cost: of each engine, NaN where it was not measured, (m,).

    Returns:
        (row of the engine, -1 for none; the need whose limit has to change least for another pick,
        -1 where no single one is enough; the factor by which it has to, 0 then).
    """
    table, limit = np.asarray(facts, dtype=float), np.asarray(limits, dtype=float)
    margins = np.where(np.asarray(larger) != 0, table / limit, limit / table)
    margins = np.where(np.isnan(margins), 0.0, margins)
    price = np.asarray(cost, dtype=float)
    price = np.where(np.isnan(price), np.inf, price)
    met = margins >= 1.0
    able = met.all(axis=1) & np.isfinite(price)
    pick = int(np.argmin(np.where(able, price, np.inf))) if able.any() else -1
    # A tighter limit loses the pick, a looser one lets in an engine that is cheaper.
    changes = [] if pick < 0 else [(float(one), need) for need, one in enumerate(margins[pick])]
    for i in np.flatnonzero(price < (price[pick] if pick >= 0 else np.inf)):
        failed = np.flatnonzero(~met[i])
        if len(failed) == 1 and margins[i, failed[0]] > 0.0:
            changes.append((1.0 / float(margins[i, failed[0]]), int(failed[0])))
    factor, need = min(changes, default=(0.0, -1))
    return pick, need, factor


def compare_engines(
    mu: float, masses: ArrayLike, place: float, speed: float, steps: ArrayLike, times: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return one scene on two engines: a block that slides over a plank, which is free itself.

    Args:
        mu: coefficient of friction between them, the same for both engines.
        masses: of the block and the plank, (2,) [kg].
        place: where both are at the start [m].
        speed: of the block at the start [m/s]; the plank stands.
        steps: of the first and the second engine, (2,) [s].
        times: whole multiples of both steps, rising, (n,) [s].

    Returns:
        (position of the block on the second engine minus that on the first, (n,) [m]; what the
        scene's energy has gained on each engine from the start to the last time, (2,) [J]).
    """
    masses, steps, times = (np.asarray(one, dtype=float) for one in (masses, steps, times))

    def engine(
        surfaces: tuple[float, float],
        combine: Callable[[float, float], float],
        damping: float,
        dt: float,
    ) -> np.ndarray:
        friction = combine(*surfaces) * masses[0] * 9.81 * dt
        x, v = np.array([place, place], dtype=float), np.array([speed, 0.0])
        log = [(*x, *v)]
        for _ in range(round(times[-1] / dt) + 1):
            v *= 1.0 - damping * dt
            stick = (v[1] - v[0]) / np.sum(1.0 / masses)
            v += np.clip(stick, -friction, friction) * np.array([1.0, -1.0]) / masses
            x += dt * v
            log.append((*x, *v))
        return np.array(log)

    def energy(state: np.ndarray) -> float:
        return float(np.sum(masses * state[2:] ** 2) / 2.0)

    first = engine((mu**0.5, mu**0.5), lambda a, b: a * b, 0.0, steps[0])
    second = engine((mu, mu), max, 0.0, steps[1])
    rows = [np.rint(times / dt).astype(int) for dt in steps]
    difference = second[rows[1], 0] - first[rows[0], 0]
    gained = [energy(a[k[-1]]) - energy(a[0]) for a, k in ((first, rows[0]), (second, rows[1]))]
    return difference, np.array(gained)


def real_time_factor(
    step: ArrayLike, steps: ArrayLike, copies: ArrayLike, wall: ArrayLike
) -> tuple[np.ndarray, float]:
    """Return how much simulated time passes per second of computing.

    Args:
        step: time step of each run, shape (n,) [s].
        steps: how many it made, (n,).
        copies: robots simulated in parallel, (n,).
        wall: what it took, (n,) [s].

    Returns:
        (factor of each run (n,), factor of all runs together).
    """
    simulated = np.asarray(step, dtype=float) * np.asarray(steps) * np.asarray(copies)
    taken = np.asarray(wall, dtype=float)
    return simulated / taken, float(simulated.sum() / taken.sum())
