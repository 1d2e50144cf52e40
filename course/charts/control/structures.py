"""Structures around PID and the adaptive law: what each gains, what it costs and where it ends."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.charts.control.limits import DT, B, J
from course.control import held, joint_system, loop_matrix, pid_law
from course.control import structures as shapes
from course.control.adaptive import (
    Cures,
    JointAdaptive,
    Run,
    adaptation_limit,
    adapted,
    drift_rate,
    run_adaptive,
)
from course.control.joint import Joint
from course.control.sampled import Held, Law, growth
from course.measure.figure import Panel, Series

Array = NDArray[np.float64]

LATE = 10  # samples of delay of the joint in the charts
NOISE = 1e-5  # of its encoder [rad]
LIGHT = 0.9  # share of the inertia that the feed-forward knows
MODEL: dict[str, Any] = {"dt": DT, "inertia": J, "damping": B}


# --- laws of one speed ----------------------------------------------------------------------------


def pd_gains(p: float) -> tuple[float, float]:
    """Return the gains that place both poles of the joint at -p without a delay."""
    return J * p * p, 2.0 * J * p - B


def cascade_gains(p: float) -> tuple[float, float, float]:
    """Return position, velocity and integral gain of a cascade whose outer loop has the gain p."""
    return p, 4.0 * J * p, 2.0 * J * p * p


def pd(p: float) -> Law:
    """Return PD."""
    kp, kd = pd_gains(p)
    return pid_law(kp, 0.0, kd, dt=DT)


def cascade(p: float) -> Law:
    """Return the cascade, which is a PID controller."""
    return shapes.cascade(*cascade_gains(p)).law(DT)


def observer(late: int = 0) -> Callable[[float], Law]:
    """Return PD with a disturbance observer twice as fast, for a delay that it knows."""
    return lambda p: shapes.observer_law(*pd_gains(p), 2.0 * p, late=late, **MODEL)


def predictor(late: int) -> Callable[[float], Law]:
    """Return PD on a predicted state, for the delay that it assumes."""
    return lambda p: shapes.predictor_law(*pd_gains(p), late=late, **MODEL)


def late_joint(samples: float = LATE) -> Held:
    """Return the joint of the charts with a delay in samples."""
    return held(*joint_system(J, B), DT, samples * DT)


def motion(seconds: float = 6.0) -> tuple[Array, Array, Array]:
    """Return the planned motion: angle, speed and acceleration, at rest before it begins."""
    t = DT * np.arange(round(seconds / DT))
    # A smooth begin in the first second, so that no jump of the speed is part of the error.
    w, x = np.array([2.0, 5.0]), np.minimum(t, 1.0)
    ramp = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
    wave = 0.5 * np.sin(w[0] * t) + 0.2 * np.sin(w[1] * t)
    q = ramp * wave
    v = np.gradient(q, DT, edge_order=2)
    return q, v, np.gradient(v, DT, edge_order=2)


def tracking_error(law: Law, model: float) -> float:
    """Return the root mean square error of the motion after its first second [rad].

    Args:
        law: feedback on the error, its D term too.
        model: share of the motion's torque that the feed-forward adds, early by the delay.
    """
    q, v, a = motion()
    torque = J * a + B * v
    early = np.append(torque[LATE:], np.full(LATE, torque[-1]))
    run = shapes.respond(late_joint(), law, -torque, model * early, samples=q.size)
    return float(np.sqrt(np.mean(run.error[round(1.0 / DT) : -LATE - 1] ** 2)))


def fastest(law: Callable[[float], Law], plant: Held, speeds: Array) -> Array:
    """Return those of the speeds up to the first with which the loop is unstable."""
    stable = [growth(loop_matrix(plant, law(p))) < 1.0 for p in speeds]
    return speeds[: stable.index(False)] if False in stable else speeds


@chart
def loop_structures(points: int = 22) -> Iterator[Panel]:
    """Chart how well structures track and reject a load, against the noise that they cause.

    Args:
        points: speeds of each structure, up to its limit.
    """
    speeds, plant = np.geomspace(4.0, 130.0, points), late_joint()

    panel = Panel(
        "Tracking a planned motion",
        "torque from encoder noise [N m]",
        "tracking error, RMS [rad]",
        scale="log",
        notes=[
            f"delay {LATE} ms, encoder noise {NOISE:g} rad, feed-forward with {LIGHT:.0%} of the "
            "torque; each curve ends at the fastest stable tuning"
        ],
    )
    for label, key, law, model in (
        ("PD", "PD", pd, 0.0),
        ("PD + feed-forward", "PD + feed-forward", pd, LIGHT),
        ("cascade + feed-forward", "cascade", cascade, LIGHT),
        ("observer with delay + feed-forward", "observer with delay", observer(LATE), LIGHT),
        ("predictor + feed-forward", "predictor", predictor(LATE), LIGHT),
        (
            "predictor, half the delay, + feed-forward",
            "predictor, half the delay",
            predictor(LATE // 2),
            LIGHT,
        ),
    ):
        used = fastest(law, plant, speeds)
        noise = [NOISE * shapes.torque_noise(plant, law(p)) for p in used]
        errors = [tracking_error(law(p), model) for p in used]
        note = _best(label, used, noise, errors)
        panel.series.append(Series(label, noise, errors, key, note=note))
    yield panel

    panel = Panel(
        "A load step: who removes it",
        "torque from encoder noise [N m]",
        "RMS error in the second after 1 N m [rad]",
        scale="log",
    )
    for label, key, law in (
        ("PD", "PD", pd),
        ("cascade (PID)", "cascade", cascade),
        ("observer", "observer", observer()),
        ("observer with delay", "observer with delay", observer(LATE)),
        ("predictor", "predictor", predictor(LATE)),
        ("predictor, half the delay", "predictor, half the delay", predictor(LATE // 2)),
    ):
        used = fastest(law, plant, speeds)
        noise = [NOISE * shapes.torque_noise(plant, law(p)) for p in used]
        runs = [shapes.respond(plant, law(p), 1.0, samples=1000).error for p in used]
        errors = [float(np.sqrt(np.mean(run**2))) for run in runs]
        note = _best(label, used, noise, errors)
        panel.series.append(Series(label, noise, errors, key, note=note))
    yield panel


def _best(label: str, speeds: Array, noise: list[float], errors: list[float]) -> str:
    k = int(np.argmin(errors))
    return (
        f"{label:<41} stable up to p = {speeds[-1]:5.1f} 1/s; smallest error {errors[k]:.1e} rad "
        f"at {noise[k]:.2f} N m of noise"
    )


# --- limits of the predictor and of the notch -----------------------------------------------------

MOTOR, LINK, SPRING, LOSS = 0.2, 0.3, 3000.0, 0.3  # an elastic gear, both inertias making J


def stable_interval(law: Law, late: int, longest: float = 3.0) -> tuple[float, float]:
    """Return the shortest and longest delay, over the assumed one, around it that are stable."""

    def stable(share: float) -> bool:
        return growth(loop_matrix(late_joint(share * late), law)) < 1.0

    def edge(end: float) -> float:
        # The first unstable delay on the way from the assumed one, then bisection.
        factors = np.linspace(1.0, end, 101)
        bad = next((k for k, x in enumerate(factors) if not stable(x)), 0)
        if not bad:
            return end
        low, high = factors[bad - 1], factors[bad]
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if stable(middle) else (low, middle)
        return float(low)

    return edge(0.0), edge(longest)


def elastic_limit(w: float | None, samples: float = 5.0) -> float:
    """Return the largest stable factor on PD gains of the elastic joint, with a notch at w."""
    plant = held(*shapes.elastic_joint(MOTOR, LINK, SPRING, B, LOSS), DT, samples * DT)
    filter_ = shapes.notch(w, DT) if w else None

    def stable(factor: float) -> bool:
        law = pid_law(200.0 * factor, 0.0, 20.0 * factor, dt=DT)
        law = shapes.behind(law, *filter_) if filter_ else law
        return growth(loop_matrix(plant, law)) < 1.0

    # The first factor that fails: the loop may be stable again later.
    tried = np.geomspace(0.02, 50.0, 120)
    high = next(x for x in tried if not stable(x))
    low = high * tried[0] / tried[1]
    for _ in range(25):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return float(low)


@chart
def structure_limits(points: int = 25) -> Iterator[Panel]:
    """Chart which error of the delay a predictor stands, and which of the frequency a notch.

    Args:
        points: on each curve.
    """
    late = 2 * LATE  # as in the example of the tuning rules
    speeds = np.geomspace(15.0, 200.0, points)
    edges = [stable_interval(predictor(late)(p), late) for p in speeds]
    panel = Panel(
        "Predictor: the faster, the less it stands",
        "speed p of the design [1/s]",
        "true delay / assumed delay",
        scale="log x",
        lines=[("y", 1.0, "exact delay")],
        notes=["the loop is stable for delays between the two curves"],
        ylim=(0.0, 3.0),
    )
    panel.series = [
        Series("longest stable delay", speeds, [high for _, high in edges]),
        Series("shortest stable delay", speeds, [low for low, _ in edges]),
    ]
    yield panel
    w = shapes.resonance(MOTOR, LINK, SPRING)
    shares = np.geomspace(0.4, 2.0, 2 * points)
    plain = elastic_limit(None)
    gains = [elastic_limit(share * w) for share in shares]
    helped = shares[np.array(gains) > plain]
    panel = Panel(
        "Notch: off to the high side it harms",
        "notch frequency / resonance",
        "largest stable factor on PD",
        scale="log",
        lines=[("y", plain, "without a notch")],
        notes=[
            f"resonance at {w:.0f} rad/s; a notch helps between {helped[0]:.2f} and "
            f"{helped[-1]:.2f} of it"
        ],
    )
    panel.series = [Series("with a notch", shares, gains)]
    yield panel


# --- the adaptive law -----------------------------------------------------------------------------

SLOPE, DAMP, RATE, SLOW, BLUR = 10.0, 5.0, 5.0, 2e-3, 3e-4  # 1/s, N m s/rad, -, s, rad
LOAD = 1.0  # [N m]
CURES = {
    "none": Cures(),
    "dead zone": Cures(dead_zone=0.8),
    "projection": Cures(low=(0.1, 0.0, -5.0), high=(1.0, 2.0, 5.0)),
    "leakage": Cures(leakage=1.0, nominal=(0.25, 0.25, 0.0)),
    "normalisation": Cures(normalisation=1.0),
}


def adaptive_run(cures: Cures, still: bool, seconds: float, seeds: int, rate: float = RATE) -> Run:
    """Return runs of the adaptive law, at rest or on a motion, with encoder noise."""
    t = SLOW * np.arange(round(seconds / SLOW))
    reference = np.zeros((3, t.size))
    if not still:
        for a, w in ((0.5, 2.0), (0.2, 5.0)):
            wave = a * np.sin(w * t), a * w * np.cos(w * t), -a * w * w * np.sin(w * t)
            reference += np.array(wave)
    law = JointAdaptive(SLOPE, DAMP, rate, cures)
    start = (J, B, -LOAD) if still else (0.25, 0.25, 0.0)
    return run_adaptive(
        Joint(J, B, LOAD), law, reference, SLOW, estimate=start, noise=BLUR, seeds=seeds
    )


@chart
def adaptive_cures(seconds: float = 20.0, seeds: int = 12) -> Iterator[Panel]:
    """Chart the drift of an adaptive law at rest, and what each cure costs in tracking.

    Args:
        seconds: of each run.
        seeds: of the encoder noise.
    """
    slope = drift_rate(RATE, SLOPE, BLUR, SLOW)
    drift = Panel(
        "At rest, noise drives the estimate",
        "time [s]",
        "estimated inertia [kg m²]",
        theory="predicted at first",
        notes=[
            f"true inertia {J:g} kg m^2, {seeds} seeds, median and quartiles; predicted drift "
            f"{slope:.2f} kg m^2/s; sampled limit of rate |Y|^2: "
            f"{adaptation_limit(DAMP, B, SLOW):.0f} N m/rad"
        ],
        ylim=(0.0, 30.0),
    )
    price = Panel(
        "Error on a motion with each cure",
        "inertia estimate at the end, at rest [kg m²]",
        "error on a motion, RMS [mrad]",
        scale="log",
    )

    def motion_errors(cures: Cures, rate: float = RATE) -> Array:
        """Return the quartiles of the error in the last five seconds of the motion [mrad]."""
        tail = adaptive_run(cures, False, seconds, seeds, rate).error[-round(5.0 / SLOW) :]
        squares = np.where(np.isfinite(tail), tail, np.inf) ** 2
        return 1e3 * np.percentile(np.sqrt(np.mean(squares, axis=0)), (25, 50, 75))

    unadapted = float(motion_errors(Cures(), 1e-9)[1])
    price.lines = [("y", unadapted, "adaptation off")]
    price.notes = [f"adaptation off: error on the motion {unadapted:.3g} mrad"]
    for name, cures in CURES.items():
        still = adaptive_run(cures, True, seconds, seeds)
        estimate = still.estimate[:, 0]
        estimate = np.where(np.abs(estimate) < 1e3, estimate, np.nan)
        alive = np.isfinite(estimate).all(axis=1) & (np.abs(still.error) < 1.0).all(axis=1)
        at = np.flatnonzero(alive)[:: max(1, alive.sum() // 100)]
        rows = np.percentile(estimate[at], (25, 50, 75), axis=1)
        low, middle, high = motion_errors(cures)
        end = "at the end"
        if not alive.all():
            end = f"when the first seed becomes unstable, after {SLOW * (alive.sum()):.1f} s"
        drift.series.append(
            Series(
                name,
                SLOW * at,
                rows[1],
                low=rows[0],
                high=rows[2],
                marker="",
                theory=(lambda t: J + slope * t) if name == "none" else None,
                note=f"{name:<14} at rest: inertia estimate {rows[1][-1]:.3g} {end}",
            )
        )
        price.series.append(
            Series(
                name if alive.all() else f"{name} (unstable at rest)",
                [rows[1][-1]],
                [middle],
                low=[low],
                high=[high],
                note=f"{name:<14} error on the motion, last 5 s: {middle:.3g} mrad "
                f"({low:.3g} to {high:.3g})",
            )
        )
    yield drift
    yield price


# --- both sides of the adaptive law's sampled limit -----------------------------------------------


def adapting_speed(product: float, regressor: float, dt: float, samples: int = 4000) -> Array:
    """Return s of a speed loop at rest under the adaptive law, from s = 1, shape (samples,).

    The rate is exact and the regressor constant, as `adaptation_limit` assumes.

    Args:
        product: rate of adaptation times the regressor squared [N m/rad].
        regressor: the torque per unit of the one parameter.
        dt: sample time [s].
        samples: of the run.
    """
    plant, Y = held(*joint_system(J, B), dt), np.array([[regressor]])
    decay, push = plant.transition[1, 1], plant.now[1]
    estimate, v, result = np.zeros(1), -1.0, np.empty(samples)
    for k in range(samples):
        s = -v
        result[k] = s
        torque = regressor * estimate[0] + DAMP * s
        estimate = adapted(estimate, Y, np.array([s]), product / regressor**2, dt)
        v = decay * v + push * torque
    return result


def adapting_joint(product: float, dt: float, samples: int = 4000) -> Array:
    """Return the error of a whole joint whose law adapts the load alone, shape (samples,).

    The rate is the difference of two angles, and s contains the angle's error as well.

    Args:
        product: rate of adaptation; the regressor of a load is 1 [N m/rad].
        dt: sample time [s].
        samples: of the run.
    """
    # A rate of adaptation of about zero leaves inertia and damping as they are.
    law = JointAdaptive(SLOPE, DAMP, (1e-12, 1e-12, product))
    run = run_adaptive(
        Joint(J, B), law, np.zeros((3, samples)), dt, estimate=(J, B, 0.0), start=1e-6
    )
    return run.error[:, 0]


def largest_adaptation(run: Callable[[float], Array], limit: float) -> float:
    """Return the largest product with which a run settles, by bisection around a limit."""

    def settles(product: float) -> bool:
        size = np.abs(run(product))
        quarter = size.size // 4
        # A run that grows far also moves the other estimates, and may then come back.
        far = np.max(size) > 1e6 * size[0]
        return bool(not far and np.max(size[-quarter:]) < np.max(size[quarter : 2 * quarter]))

    low, high = 0.1 * limit, 2.0 * limit
    while high / low > 1.001:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if settles(middle) else (low, middle)
    return low


@chart
def adaptation_limits(points: int = 6, sides: tuple[float, float] = (1.1, 0.9)) -> Iterator[Panel]:
    """Chart the largest rate of adaptation of a sampled law, computed and measured.

    Args:
        points: sample times.
        sides: shares of the computed limit, one above and one below it.
    """
    limit = adaptation_limit(DAMP, B, SLOW)
    panel = Panel(
        "Settles below the limit, grows above it",
        "time [s]",
        "s [rad/s]",
        notes=[f"limit at {1e3 * SLOW:g} ms: {limit:.0f} N m/rad"],
    )
    for share in sides:
        s = adapting_speed(share * limit, 1.0, SLOW, 1500)
        first, last = np.abs(s[:100]).max(), np.abs(s[-100:]).max()
        panel.series.append(
            Series(
                f"{share:g} of the limit",
                SLOW * np.arange(s.size),
                s,
                marker="",
                note=f"{share:g} of the limit: s of {last:.2f} rad/s after "
                f"{SLOW * s.size:g} s, {first:.2f} at first",
            )
        )
    yield panel

    times = np.geomspace(1e-3, 1e-2, points)
    panel = Panel(
        "The limit falls with the sample time",
        "sample time [s]",
        "largest stable Γ Y² [N m/rad]",
        scale="log",
        theory="(K + b) / dt",
    )

    def theory(dt: float) -> float:
        return adaptation_limit(DAMP, B, dt)

    for label, run, shown in (
        ("exact rate, Y = 1", lambda dt: lambda x: adapting_speed(x, 1.0, dt), theory),
        ("exact rate, Y = 3", lambda dt: lambda x: adapting_speed(x, 3.0, dt), None),
        (
            "rate from differences, with the angle",
            lambda dt: lambda x: adapting_joint(x, dt),
            None,
        ),
    ):
        measured = np.array([largest_adaptation(run(float(dt)), theory(float(dt))) for dt in times])
        over = measured / [theory(float(dt)) for dt in times]
        panel.series.append(
            Series(
                label,
                times,
                measured,
                "",
                "",
                theory=shown,
                hollow=label.endswith("3"),
                note=f"{label}: measured limit {over.min():.3f} to {over.max():.3f} of the "
                "computed one",
            )
        )
    yield panel
