"""Logs of the flat arm, and what else than output error people do with them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from course.kinematics import TwoLink
from course.sim_to_real import plants
from course.sim_to_real.identify import BASE, Log, arm

Array = NDArray[np.float64]

DT, SECONDS, NOISE = 2e-3, 2.0, 1e-3  # of a log [s], and of its angles [rad]
TRUTH: dict[str, float] = dict(zip(BASE, plants.ARM.parameters.tolist(), strict=True))
FREE = dict.fromkeys(BASE, (1e-4, 10.0))
GUESS = {name: 1.2 * value for name, value in TRUTH.items()}
FORMS = ("differentiated", "filtered", "integral")
_BUMP = Polynomial([0.0, 1.0, -1.0]) ** 5


def plan(kind: str, seconds: float = SECONDS, dt: float = DT) -> Array:
    """Return torques of "two sines", "steps" or "one slow joint", shape (2, T) [N m]."""
    t = 2.0 * np.pi * dt * np.arange(round(seconds / dt))
    if kind == "two sines":
        return np.array(
            [
                1.5 * np.sin(0.9 * t) + np.sin(2.3 * t + 1.0),
                0.6 * np.sin(1.3 * t + 0.5) + 0.5 * np.sin(3.1 * t + 2.0),
            ]
        )
    if kind == "steps":
        side = np.where(np.sin(0.5 * t + 1e-9) > 0.0, 1.0, -1.0)
        return np.outer([1.0, 0.4], side)
    return np.outer([1.0, 0.0], 0.3 * np.sin(0.5 * t))


def record(
    kind: str = "two sines",
    noise: float = NOISE,
    seed: int = 0,
    *,
    seconds: float = SECONDS,
    dt: float = DT,
    **changed: float,
) -> Log:
    """Record a log of the arm, from rest, with some parameters changed.

    `changed` names rows of `plants.ROWS`.
    """
    sent = plan(kind, seconds, dt)
    times = dt * np.arange(sent.shape[1] + 1)
    blank = Log(times, np.zeros((2, times.size)), sent)
    truth = {name: np.array([value]) for name, value in (TRUTH | changed).items()}
    rng = np.random.default_rng(seed)
    q = arm(truth, blank)[..., 0]
    return Log(times, q + noise * rng.standard_normal(q.shape), sent)


# What one episode of a real arm tells. With the torque factor taken as 1, inertias and friction
# come out in units of what the motor gives, which is all that a controller needs.
ALL = {
    **dict.fromkeys(BASE, (1e-3, 10.0)),
    "f1": (0.0, 2.0),
    "f2": (0.0, 2.0),
    "delay": (0.0, 0.05),
    "bias1": (-0.1, 0.1),
    "bias2": (-0.1, 0.1),
}


def episode(
    real: plants.Plants, gains: Array, task: plants.Tasks
) -> tuple[Log, dict[str, float], Array]:
    """Return the log of an arm's only episode, the start of a fit of `ALL`, and the true values."""
    run = plants.watch(real, gains, task)
    q1, q2 = task.start[:, 0].tolist()
    # Too heavy, with too much dry friction: from the other side some fits end where a joint sticks.
    start = {name: 2.0 * TRUTH[name] for name in "abd"} | {"c1": 0.1, "c2": 0.1, "f1": 0.3}
    start |= {"f2": 0.15, "delay": 0.005, "bias1": 0.0, "bias2": 0.0}
    row = dict(zip(plants.ROWS, real.columns()[:, 0], strict=True))
    motor = {name: row["torque"] for name in (*BASE, "f1", "f2")}
    truth = np.array([row[name] / motor.get(name, 1.0) for name in ALL])
    log = Log(run.times, run.measured[:, 0], run.command[:, 0])
    return log, start | {"q1": q1, "q2": q2}, truth


def rods(parameters: Mapping[str, Array], log: Log) -> Array:
    """Simulate `arm` from six parameters, of which five combinations show.

    Mass m and inertia I about the centre of each link [kg, kg m^2], c1 and c2.
    """
    l1, l2 = plants.ARM.lengths
    m1, I1, m2, I2 = (parameters[name] for name in ("m1", "I1", "m2", "I2"))
    d = I2 + 0.25 * m2 * l2**2
    base = {"a": I1 + 0.25 * m1 * l1**2 + m2 * l1**2 + d, "b": 0.5 * m2 * l1 * l2, "d": d}
    return arm({**parameters, **base}, log)


def six(model: TwoLink = plants.ARM) -> dict[str, float]:
    """Return what `rods` takes, of an arm of uniform rods."""
    (m1, m2), (I1, I2), (c1, c2) = model.masses, model.inertias, model.damping
    return {"m1": m1, "I1": I1, "m2": m2, "I2": I2, "c1": c1, "c2": c2}


def regress(log: Log, form: str, width: float | None = None, window: float = 0.3) -> Array:
    """Return the five numbers by linear least squares on the equations of motion, shape (5,).

    "differentiated" takes central differences of the angles; "filtered" the derivatives of a
    Gaussian of this `width` [s], by default 10 ms, and smooths the torques alike; "integral"
    multiplies momentum with a bump over a `window` [s] and integrates by parts, as
    `course.control.identify` does, so that only speeds within products are filtered, by 3 ms.
    """
    width = {"integral": 0.003}.get(form, 0.01) if width is None else width
    dt, q, held = log.dt, log.measured, log.command
    at = 0.5 * (held[:, 1:] + held[:, :-1])  # where the angle has neighbours on both sides
    if form == "differentiated":
        v, a = 0.5 * (q[:, 2:] - q[:, :-2]) / dt, np.diff(q, 2) / dt**2
        rows, torque = plants.ARM.regressor(q[:, 1:-1], v, a), at
        return _least(rows, torque)
    reach = round(4.0 * width / dt)
    s = dt * np.arange(-reach, reach + 1)
    bell = np.exp(-0.5 * (s / width) ** 2)
    bell /= bell.sum()
    # Exact on parabolas, as the sums of the three kernels are those of the integrals.
    rise = s * bell / np.sum(s * s * bell)
    bend = (s**2 - np.sum(s**2 * bell)) * bell
    bend *= 2.0 / np.sum(s**2 * bend)

    def through(kernel: Array, x: Array) -> Array:
        return np.array([np.correlate(row, kernel, "valid") for row in x])

    smooth, v = through(bell, q), through(rise, q)
    if form == "filtered":
        rows = plants.ARM.regressor(smooth, v, through(bend, q))
        torque = through(bell, at)
        return _least(rows[:, :, 1:-1], torque)
    n, q = round(window / dt), q[:, reach:-reach]
    sent = held[:, reach : reach + q.shape[1] - 1]
    u, length = np.linspace(0.0, 1.0, n + 1), n * dt
    bump, slope, curve = (
        dt * p(u) / length**k for k, p in enumerate((_BUMP, _BUMP.deriv(), _BUMP.deriv(2)))
    )
    area = np.diff(length * _BUMP.integ()(u))  # exact for a torque that is held
    c, sine = np.cos(smooth[1]), np.sin(smooth[1])
    starts = range(0, q.shape[1] - n, max(1, n // 8))
    rows, torque = np.zeros((2, 5, len(starts))), np.zeros((2, len(starts)))
    for k, i in enumerate(starts):
        w = slice(i, i + n + 1)
        rows[0, 0, k] = curve @ q[0, w]
        rows[0, 1, k] = -slope @ (c[w] * (2.0 * v[0, w] + v[1, w]))
        rows[1, 1, k] = -slope @ (c[w] * v[0, w]) + bump @ (sine[w] * v[0, w] * (v[0, w] + v[1, w]))
        rows[0, 2, k], rows[1, 2, k] = curve @ q[1, w], curve @ (q[0, w] + q[1, w])
        rows[0, 3, k], rows[1, 4, k] = -slope @ q[0, w], -slope @ q[1, w]
        torque[:, k] = sent[:, i : i + n] @ area
    return _least(rows, torque)


def _least(rows: Array, torque: Array) -> Array:
    """Solve (2, 5, K) rows for (2, K) torques by least squares."""
    answer, *_ = np.linalg.lstsq(rows.swapaxes(0, 1).reshape(5, -1).T, torque.ravel(), rcond=None)
    return np.asarray(answer, dtype=float)
