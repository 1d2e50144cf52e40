"""What logs tell: joints whose numbers nobody knows, causes of error, and what a model lacks."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.charts import chart
from course.charts.control import tracking
from course.compiled import MATRIX, VECTOR, compiled
from course.control import JointModel, Log, diagnose, identify, track
from course.control.identify import CAUSES
from course.control.residual import Learned, learn
from course.measure.figure import Panel, Series

Array = NDArray[np.float64]
NOMINAL = JointModel(0.1, 0.15, 0.12, 0.8)
FLAT = JointModel(0.1)


@numba.extending.register_jitable
def _acceleration(m, q, v, u):
    return (m[4] * u - m[1] * v - m[2] * math.tanh(v / 1e-3) - m[3] * math.cos(q)) / m[0]


def _driven(observed, sent, target, rate, joints, dt):
    """The loop of `record`: `observed` holds the noise and gets the angles, `sent` the commands."""
    h = dt / 10
    for j in range(joints.shape[1]):
        m, q, v = joints[:, j], target[0], rate[0]
        late, whole = m[6] / dt, math.floor(m[6] / dt + 1e-9)
        for k in range(len(observed)):
            observed[k, j] += q
            slow = (observed[k, j] - observed[max(0, k - 5), j]) / (dt * max(1, min(k, 5)))
            sent[k, j] = 12.0 * (target[k] - observed[k, j]) + 1.2 * (rate[k] - slow)
            for i in range(10):
                # Before the switch the command of one sample earlier is still on its way.
                at = k - whole - int((i + 0.5) / 10 < late - whole)
                u = min(max(sent[at, j], -m[5]), m[5]) if at >= 0 else 0.0
                a1 = _acceleration(m, q, v, u)
                s2 = v + 0.5 * h * a1
                a2 = _acceleration(m, q + 0.5 * h * v, s2, u)
                s3 = v + 0.5 * h * a2
                a3 = _acceleration(m, q + 0.5 * h * s2, s3, u)
                s4 = v + h * a3
                a4 = _acceleration(m, q + h * s3, s4, u)
                q += h / 6.0 * (v + 2.0 * s2 + 2.0 * s3 + s4)
                v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def record(
    models: Sequence[JointModel],
    seconds: float = 6.0,
    dt: float = 2e-3,
    noise: ArrayLike = 3e-5,
    seed: int = 0,
    speed: float = 1.0,
) -> list[Log]:
    """Record one log for each model, all under the same PD loop on the same motion.

    The truth is stepped by Runge-Kutta ten times finer than the log; Coulomb friction turns round
    within 1 mrad/s. The loop sees noisy angles; `noise` is one number or one for each joint.
    """
    names = ("inertia", "damping", "coulomb", "gravity", "constant", "limit", "delay")
    joints = np.array([[getattr(m, name) for m in models] for name in names], dtype=float)
    rng, T, N = np.random.default_rng(seed), round(seconds / dt), len(models)
    t = dt * np.arange(T + 1)
    w = speed * np.array([1.3, 3.1, 5.7])
    target = (np.array([0.9, 0.5, 0.25]) * np.sin(np.outer(t, w) + [0.1, 1.0, 2.0])).sum(1)
    rate = (np.array([0.9, 0.5, 0.25]) * w * np.cos(np.outer(t, w) + [0.1, 1.0, 2.0])).sum(1)
    observed, sent = np.asarray(noise) * rng.normal(size=(T + 1, N)), np.zeros((T + 1, N))
    signature = numba.void(MATRIX, MATRIX, VECTOR, VECTOR, MATRIX, numba.float64)
    compiled(_driven, signature)(observed, sent, target, rate, joints, dt)
    return [Log(dt, observed[:, i], sent[:-1, i]) for i in range(N)]


def twice_differentiated(log: Log, model: JointModel) -> float:
    """Return the inertia the usual way.

    The torque that is left over second differences of the angle.
    """
    a = np.diff(log.q, 2) / log.dt**2
    v = 0.5 * (log.q[2:] - log.q[:-2]) / log.dt
    known = model.damping * v + model.coulomb * np.sign(v) + model.gravity * np.cos(log.q[1:-1])
    return float(a @ (0.5 * (log.command[1:] + log.command[:-1]) - known) / (a @ a))


def low_passed(log: Log, cutoff: float) -> float:
    """Return the inertia by the filtered equation of motion.

    All terms pass the same filter, which has no lag because it runs forwards and backwards; then
    least squares over all samples gives inertia, both frictions and gravity.

    Args:
        log: of the joint.
        cutoff: of the filter [Hz].
    """
    from scipy.signal import butter, filtfilt

    parts = butter(2, 2.0 * cutoff * log.dt)
    smooth = np.diff(filtfilt(*parts, log.q))
    terms = [
        np.diff(log.q, 2) / log.dt**2,
        0.5 * (log.q[2:] - log.q[:-2]) / log.dt,
        np.sign(smooth[1:] + smooth[:-1]),
        np.cos(log.q[1:-1]),
        0.5 * (log.command[1:] + log.command[:-1]),
    ]
    # The filter's start and end are no part of the fit.
    rows = filtfilt(*parts, np.column_stack(terms), axis=0)[100:-100]
    answer, *_ = np.linalg.lstsq(rows[:, :4], rows[:, 4], rcond=None)
    return float(answer[0])


def changed(rng: np.random.Generator, cause: str) -> tuple[JointModel, JointModel]:
    """Return a believed model, and what the joint is: one number other than believed."""
    ranges = ((0.08, 0.3), (0.1, 0.4), (0.08, 0.3), (0.4, 1.5))
    model = JointModel(*(float(rng.uniform(*r)) for r in ranges))
    factor = 1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.1, 0.3)
    value = {"delay": rng.uniform(0.002, 0.015), "limit": 0.0}.get(
        cause, getattr(model, cause) * factor
    )
    if cause == "limit":
        value = 0.75 * np.abs(record([model], seconds=2.0)[0].command).max()
    return model, replace(model, **{cause: float(value)})


@chart
def what_a_log_tells(
    noises: Sequence[float] = (1e-5, 3e-5, 1e-4, 3e-4, 1e-3), joints: int = 8, causes: int = 6
) -> Iterator[Panel]:
    """Chart inertia out of a log over the noise of its angles, and which cause is named.

    Args:
        noises: deviations of the measured angles [rad].
        joints: drawn for a point of the left panel.
        causes: drawn for each of the seven of the right one.
    """
    rng = np.random.default_rng(3)
    panel = Panel(
        "Integrate, do not differentiate",
        "noise of the angle [rad]",
        "error of the inertia",
        scale="log",
    )
    models = [changed(rng, "inertia")[1] for _ in range(joints)]
    methods: dict[str, Callable[[Log, JointModel], float]] = {
        "integral form": lambda log, _: identify(log).model.inertia,
        "second differences": twice_differentiated,
        "all terms filtered, 10 Hz": lambda log, _: low_passed(log, 10.0),
        "all terms filtered, 40 Hz": lambda log, _: low_passed(log, 40.0),
    }
    deviation: dict[str, list[Array]] = {name: [] for name in methods}
    for noise in noises:
        pairs = list(zip(record(models, noise=noise, seed=1), models, strict=True))
        for name, inertia in methods.items():
            deviation[name].append(np.array([abs(inertia(*p) / p[1].inertia - 1.0) for p in pairs]))
    for name, rows in deviation.items():
        y = [float(np.median(row)) for row in rows]
        panel.series.append(
            Series(
                name,
                noises,
                y,
                low=[row.min() for row in rows],
                high=[r.max() for r in rows],
                note=f"{name:<26} error of the inertia {y[0]:.1e} at {noises[0]:.0e} rad of "
                f"noise, {y[-1]:.1e} at {noises[-1]:.0e}",
            )
        )
    yield panel

    panel = Panel(
        "Is the true cause the only one named?",
        "noise of the angle [rad]",
        "share of logs",
        scale="log x",
    )
    cases = [(cause, *changed(rng, cause)) for cause in CAUSES for _ in range(causes)]
    named: dict[str, list[float]] = {cause: [] for cause in CAUSES}
    for noise in noises:
        logs = record([truth for *_, truth in cases], noise=noise, seed=2)
        right = np.array(
            [
                diagnose(log, model).causes == (cause,)
                for log, (cause, model, _) in zip(logs, cases, strict=True)
            ]
        )
        for cause, share in zip(CAUSES, right.reshape(len(CAUSES), -1).mean(axis=1), strict=True):
            named[cause].append(float(share))
    for cause, y in named.items():
        row = ", ".join(f"{100 * share:.0f}" for share in y)
        panel.series.append(
            Series(
                cause,
                noises,
                y,
                extra=cause == "limit",
                note=f"{cause:<10} named alone, % over the noise: {row}",
            )
        )
    yield panel


@chart
def learned_beside_adaptive(
    rounds: int = 6, seeds: int = 7, dt: float = 4e-3, outside: float = 1.6
) -> Iterator[Panel]:
    """Chart a learned residual inside and outside its training motion, next to the adaptive law.

    Args:
        rounds: of collecting and fitting.
        seeds: draws of the waves.
        dt: sample time [s].
        outside: size of the other motion, the trained one's being 1.
    """
    first = Learned(tracking.WRONG, tracking.KP, tracking.KD)
    data = tracking.SECONDS * np.arange(rounds + 1)
    panel = Panel("Learned or adapted", "seconds of data", "largest error [rad]", scale="log y")
    result: dict[str, list[list[float]]] = {"trained motion": [], "a larger one": []}
    for seed in range(seeds):
        laws = learn(
            first,
            lambda law: track(tracking.ARM, law, tracking.motion, dt, 4.0),
            np.random.default_rng(seed),
            rounds,
        )
        for name, size in zip(result, (1.0, outside), strict=True):
            result[name].append([min(tracking.error(law, dt, size=size), 9.0) for law in laws])
    for name, rows in result.items():
        y = np.median(rows, axis=0)
        panel.series.append(
            Series(
                f"learned, {name}",
                data,
                y,
                low=np.min(rows, axis=0),
                high=np.max(rows, axis=0),
                note=f"learned, {name}: {y[0]:.2g} rad, after {rounds} rounds {y[-1]:.2g} "
                f"({np.min(rows, axis=0)[-1]:.2g} to {np.max(rows, axis=0)[-1]:.2g})",
            )
        )
    for name, size in zip(result, (1.0, outside), strict=True):
        law = tracking.adaptive(tracking.WRONG, dt)
        error = tracking.error(law, dt, size=size)
        panel.lines = [*panel.lines, ("y", error, f"adaptive, {name}")]
        panel.notes.append(f"adaptive law, seven parameters, {name}: {error:.2g} rad")
    yield panel
