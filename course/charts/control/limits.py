"""Limits of one joint: theory beside the exact loop beside MuJoCo."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.charts import chart
from course.control import Actuator, Encoder, Gains, Joint, run_joint, sampled, step_metrics
from course.control.pid import rates
from course.measure import stability
from course.measure.figure import Panel, Series
from course.oracles.mujoco.joint import MotorJoint

Array = NDArray[np.float64]
J, B, DT = 0.5, 0.5, 1e-3  # the joint of the tuning example [kg m^2, N m s/rad], its sample time


def largest(growth: Callable[[float], float], low: float, high: float) -> float:
    """Return the largest gain with which a growth per sample stays within 1, by bisection.

    `high` if all do.
    """
    # No limit within the range.
    if growth(high) <= sampled.STABLE:
        return high
    return stability.limit(lambda gain: growth(gain) <= sampled.STABLE, low, high, 1e-6)


def loop_growth(plant: sampled.Held, kp: float, kd: float = 0.0, rate: str = "exact") -> float:
    """Return growth per sample of PD on a held plant."""
    law = sampled.pid_law(kp, 0.0, kd, dt=plant.dt, rate=rate)
    return sampled.growth(sampled.loop_matrix(plant, law))


def mujoco_growth(
    joint: MotorJoint, command: Callable[[float, float], float], unit: float = 1.0
) -> float:
    """Return growth per sample of MuJoCo's joint under a linear law of angle and speed."""

    def step(state: Array) -> Array:
        # A linear law on a linear joint: one step from each unit state gives the matrix.
        joint.reset(unit * state[0], unit * state[1])
        joint.step(command(joint.q, joint.v))
        return np.array([joint.q, joint.v]) / unit

    return stability.spectral_radius(stability.amplification(step, 2))


# --- delay, the hold, and what a simulator makes of it --------------------------------------------


@chart
def delay_limit(
    delays: int = 40, steps: tuple[int, ...] = (1, 2, 5, 10, 20, 50)
) -> Iterator[Panel]:
    """Chart how much P a joint stands: over its delay, and over a simulator's steps in a sample.

    Args:
        delays: points of the left panel.
        steps: simulator steps in a sample.
    """
    late = np.geomspace(1e-4, 0.1, delays)
    system = sampled.joint_system(J, B)
    exact = [sampled.ultimate_gain(*system, DT, D)[0] for D in late]
    panel = Panel(
        "Every millisecond of delay costs gain", "delay [s]", "largest kp [N m/rad]", scale="log"
    )

    def theory(D: float) -> float:
        # A zero-order hold delays by half a sample on average.
        return sampled.delay_limit(J, B, D + 0.5 * DT)[0]

    # The approximation of the hold by half a sample, judged by the exact matrix.
    error = max(abs(k / theory(D) - 1.0) for D, k in zip(late, exact, strict=True))
    panel.series = [
        Series(
            "the loop's matrix",
            late,
            exact,
            "",
            "",
            theory=theory,
            note=f"P with delay: w tan(w (D + dt/2)) = b/J is within {error:.1e} of the matrix",
        ),
    ]
    yield panel

    panel = Panel(
        "A simulator's own steps hide the hold",
        "physics steps per sample",
        "largest kp [N m/rad]",
        scale="log",
        ticks=steps,
    )

    def by_matrix(n: int) -> float:
        plant = sampled.stepped(J, B, DT, n)
        return largest(lambda k: loop_growth(plant, k), 1.0, 1e8)

    def by_mujoco(n: int) -> float:
        joint = MotorJoint(J, B, DT, substeps=n)
        return largest(lambda k: mujoco_growth(joint, lambda q, _: -k * q), 1.0, 1e8)

    matrix, result = [by_matrix(n) for n in steps], [by_mujoco(n) for n in steps]
    real = sampled.ultimate_gain(*system, DT)[0]
    error = max(abs(a / b - 1.0) for a, b in zip(matrix, result, strict=True))
    panel.lines = [("y", real, "the joint itself")]
    panel.series = [
        Series("MuJoCo", steps, result, "MuJoCo", "", hollow=True),
        Series(
            "its steps as a matrix",
            steps,
            matrix,
            "",
            "--",
            note=f"limit of P at {1 / DT:g} Hz: exact {real:.0f} N m/rad; MuJoCo with one step "
            f"a sample {result[0]:.3g}, with ten {result[steps.index(10)]:.0f}; the matrix of its "
            f"steps within {error:.1e}",
        ),
    ]
    yield panel


@chart
def pd_triangles(points: int = 60) -> Iterator[Panel]:
    """Chart where PD on a free inertia is stable: three loops, and MuJoCo's position servo.

    Args:
        points: of each curve.
    """
    # Dimensionless gains: in units of J / dt and J / dt^2 all joints have the same triangle.
    V = np.linspace(0.02, 1.98, points)
    panel = Panel(
        "Delay shrinks the triangle",
        "kd dt / J",
        "kp dt^2 / J",
        theory="closed form",
        ylim=(0.0, 4.2),
    )
    for words, kind, rate, late in (
        ("rate exact", "exact", "exact", 0.0),
        ("rate by difference", "difference", "filtered", 0.0),
        ("rate exact, a sample late", "late", "exact", 1.0),
        ("difference, a sample late", "", "filtered", 1.0),
    ):
        plant = sampled.held(*sampled.joint_system(1.0), 1.0, late)
        top = [
            largest(functools.partial(loop_growth, plant, kd=kd, rate=rate), 1e-9, 8.0)
            if loop_growth(plant, 1e-9, kd, rate) <= sampled.STABLE
            else math.nan
            for kd in V
        ]
        closed = functools.partial(sampled.pd_limit, inertia=1.0, dt=1.0, rate=kind)
        panel.series.append(
            Series(
                words,
                V,
                top,
                "",
                "",
                theory=closed if kind else None,
                note=f"PD on an inertia, {words:<26} tip at {np.nanmax(top):.3f} J/dt^2",
            )
        )
    yield panel
    panel = Panel(
        "MuJoCo's position servo is another loop", "kv dt / J", "kp dt^2 / J", ylim=(0.0, 8.0)
    )
    kvs = np.linspace(0.0, 1.9, 9)
    for integrator in ("Euler", "implicitfast", "discrete"):
        top = [largest(functools.partial(servo_growth, integrator, kv=kv), 1e-6, 1e4) for kv in kvs]
        words = "no limit below 1e4" if min(top) >= 1e4 else f"{top[0]:.0f} {top[-1] - top[0]:+.1f}"
        panel.series.append(
            Series(
                f"MuJoCo {integrator}",
                kvs,
                np.where(np.array(top) >= 1e4, np.inf, top),
                f"MuJoCo {integrator}",
                note=f"position servo, {integrator:<13} {words}",
            )
        )
    panel.series.append(
        Series(
            "sampled PD, rate exact",
            kvs,
            [sampled.pd_limit(k, 1.0, 1.0) for k in kvs],
            "theory",
            "--",
        )
    )
    yield panel


def servo_growth(integrator: str, kp: float, kv: float) -> float:
    """Return growth per step of MuJoCo's position servo on a free inertia, in units of its own."""
    servo = f'<position kp="{kp:.17g}" kv="{kv:.17g}" {{}}/>'
    joint = MotorJoint(1.0, 0.0, 1.0, substeps=1, integrator=integrator, actuator=servo)
    return mujoco_growth(joint, lambda q, v: 0.0)


@chart
def rate_estimates(samples: int = 40_000) -> Iterator[Panel]:
    """Chart noise of a rate against its lag: the difference, its filter, and the tracking observer.

    Args:
        samples: of white noise behind each point.
    """
    noise = np.random.default_rng(3).standard_normal(samples)
    t = DT * np.arange(4000)
    panel = Panel(
        "A rate costs lag or noise",
        "lag under a steady acceleration [s]",
        "noise of the rate, per noise of the angle [1/s]",
        scale="log",
    )
    for words, kind, taus in (
        ("difference", "filtered", (0.0,)),
        ("filtered difference", "filtered", np.geomspace(5e-4, 0.05, 9)),
        ("tracking observer", "observer", np.geomspace(5e-4, 0.05, 9)),
    ):
        # A steady acceleration: the lag is what the estimate is behind at the end.
        lag = [t[-1] - rates(0.5 * t**2, DT, kind, tau)[-1] for tau in taus]
        # After 2,000 samples, when the filter has forgotten its start.
        result = [float(np.std(rates(noise, DT, kind, tau)[2000:])) for tau in taus]
        panel.series.append(
            Series(
                words,
                lag,
                result,
                note=f"{words:<20} lag {1e3 * lag[0]:.2f} to "
                f"{1e3 * lag[-1]:.1f} ms, noise {result[0]:.0f} to {result[-1]:.1f} /s",
            )
        )
    yield panel


# --- saturation -----------------------------------------------------------------------------------


def caught(
    theta: ArrayLike, speed: ArrayLike, share: float, gain: float = 30.0, linear: bool = False
) -> NDArray[np.bool_]:
    """Return whether saturated feedback of the unstable mode catches a falling inverted pendulum.

    In units of m g l and sqrt(l / g): theta'' = sin(theta) - u, |u| <= share, and
    u = gain (theta + theta'), which is what LQR tends to as torque gets dear.

    Args:
        theta: angle at the start [rad], an array.
        speed: rate at the start, an array of the same shape.
        share: largest torque over m g l.
        gain: above 1.
        linear: replaces sin(theta) with theta.
    """
    q, v = (np.array(x, dtype=float) for x in np.broadcast_arrays(theta, speed))
    h = min(0.02, 1.0 / gain)

    def turn(q: Array, v: Array) -> Array:
        pull = q if linear else np.sin(q)
        return pull - np.clip(gain * (q + v), -share, share)

    for _ in range(round(30.0 / h)):
        # Explicit midpoint rule with the saturated torque.
        a = turn(q, v)
        b = turn(q + 0.5 * h * v, v + 0.5 * h * a)
        lost = np.abs(q) > 1.5  # beyond the horizontal it is swinging up, another question
        q, v = np.where(lost, q, q + h * (v + 0.5 * h * a)), np.where(lost, v, v + h * b)
    return np.abs(q) + np.abs(v) < 0.1


def edge_of_rest(share: float, gain: float = 30.0, linear: bool = False) -> float:
    """Return the largest angle from which a pendulum at rest is caught.

    Three grids, each finer than the last, bracket it.
    """
    low, high = 0.0, 1.5
    for _ in range(4):
        grid = np.linspace(low, high, 41)
        # The last caught angle of the grid and the next one bracket the edge.
        good = caught(grid, 0.0, share, gain, linear)
        last = int(np.argmin(good)) - 1
        low, high = float(grid[last]), float(grid[last + 1])
    return 0.5 * (low + high)


@chart
def saturation_region(points: int = 81, share: float = 0.5) -> Iterator[Panel]:
    """Chart from where a pendulum with a weak motor is caught, over angle and speed.

    Args:
        points: along each axis.
        share: the motor's torque over m g l.
    """
    theta, speed = np.linspace(-1.2, 1.2, points), np.linspace(-1.2, 1.2, points)
    good = caught(theta[None, :], speed[:, None], share)
    panel = Panel(
        "A pendulum with a weak motor, feedback of angle + rate",
        "angle from upright [rad]",
        "speed [sqrt(g/l)]",
        grid=stability.Map(
            theta, speed, np.where(good, 0.5, 2.0), quantity="purple: caught, orange: lost"
        ),
    )
    edge, flat = edge_of_rest(share), edge_of_rest(share, linear=True)
    panel.series = [
        Series(
            f"upper edge, linear theory: angle + speed = {share:g}",
            theta,
            share - theta,
            "theory on a map",
            "--",
        ),
        Series("from rest, theory", [math.asin(share)], [0.0], "chosen", ""),
    ]
    panel.ylim = (-1.2, 1.2)
    panel.notes = [
        f"from rest, torque {share:g} m g l: caught up to {edge:.6f} rad, theory "
        f"{math.asin(share):.6f}; linear pendulum {flat:.6f}, theory {share:g}"
    ]
    yield panel


# --- quantisation and friction --------------------------------------------------------------------


@chart
def ripple_and_hunting(points: int = 9) -> Iterator[Panel]:
    """Chart what an encoder's count and dry friction leave at rest.

    Args:
        points: of each curve.
    """
    bits, kd, kp = 12, 2.0, 20.0
    line = Encoder(bits).line
    taus = np.geomspace(1e-4, 0.03, points)

    def ripple(tau: float) -> float:
        run = run_joint(
            Joint(0.05, 0.1, 0.4),
            Actuator(delay=DT),
            Encoder(bits, 0.2 * line),
            Gains(kp, 0.0, kd, tau),
            0.3,
            DT,
            4.0,
        )
        return float(np.ptp(run.command[2000:]))

    def bound(tau: float) -> float:
        # Peak to peak: one count through P, and through the difference in both directions.
        return line * (2.0 * kd / (tau + DT) + kp)

    result = [ripple(t) for t in taus]
    share = max(f / bound(t) for f, t in zip(result, taus, strict=True))
    panel = Panel(
        "An encoder count shakes the torque",
        "time constant of the rate filter [s]",
        "ripple of the command [N m]",
        scale="log",
        theory="upper bound: (2 kd/(tau + dt) + kp) count",
    )
    panel.series = [
        Series(
            f"{bits} bits, kd = {kd:g}",
            taus,
            result,
            "",
            theory=bound,
            note=f"ripple of {bits} bits: at most {share:.2f} of the bound",
        )
    ]
    yield panel

    panel = Panel(
        "Static friction makes an integral hunt",
        "static over Coulomb friction",
        "oscillation about the target [mrad]",
    )
    ratios = np.linspace(1.0, 3.0, points)

    def hunting(ratio: float, ki: float) -> float:
        joint = Joint(0.05, 0.05, 0.0, 0.1, 0.1 * ratio)
        run = run_joint(joint, Actuator(), Encoder(), Gains(6.4, ki, 0.7, 0.005), 0.5, DT, 60.0)
        # The last 30 of 60 s: the limit cycle, not the approach.
        return 1e3 * float(np.ptp(run.q[-30_000:]))

    for ki in (0.0, 25.6):
        swing = [hunting(r, ki) for r in ratios]
        at = swing[int(np.argmin(np.abs(ratios - 2.0)))]
        panel.series.append(
            Series(
                f"ki = {ki:g}",
                ratios,
                swing,
                note=f"hunting with ki = {ki:<5g} {swing[0]:.3f} mrad at equal friction, "
                f"{at:.1f} at twice the static",
            )
        )
    yield panel


# --- Ziegler and Nichols --------------------------------------------------------------------------

ROWS = {"P": (0.5, 0.0, 0.0), "PI": (0.45, 0.54, 0.0), "PID": (0.6, 1.2, 0.075)}
SAMPLES = 12  # in a delay


@dataclass(frozen=True)
class Judged:
    """A set of gains on a joint of J = b = 1 with a delay: what its matrix and a step say."""

    gains: Gains
    delay: float
    growth: float
    overshoot: float
    settling: float

    def margins(self) -> sampled.Margins:
        """Return the gain, phase and delay margins of the loop."""
        dt = self.delay / SAMPLES
        system = sampled.joint_system(1.0, 1.0)
        return sampled.margins(*system, self.gains.law(dt), dt, self.delay)


def judged(kp: float, ki: float, kd: float, delay: float) -> Judged:
    """Judge a set of gains; sampled so often in the delay that sampling hardly shows."""
    dt, gains = delay / SAMPLES, Gains(kp, ki, kd)
    plant = sampled.held(*sampled.joint_system(1.0, 1.0), dt, delay)
    growth = sampled.growth(sampled.loop_matrix(plant, gains.law(dt)))
    # Long enough for slow and for late joints: 60 delays or 30 s.
    seconds = round(max(60.0 * delay, 30.0) / dt) * dt
    run = run_joint(Joint(1.0, 1.0), Actuator(delay=delay), Encoder(), gains, 1.0, dt, seconds)
    result = step_metrics(run.times, run.q, 1.0)
    return Judged(gains, delay, growth, result.overshoot, result.settling)


def ziegler_nichols(row: str, delay: float) -> Judged:
    """Return a row of the table on the joint with its true delay (in units of J / b)."""
    gain, period = sampled.ultimate_gain(*sampled.joint_system(1.0, 1.0), delay / SAMPLES, delay)
    p, i, d = ROWS[row]
    return judged(p * gain, i * gain / period, d * gain * period, delay)


def placed(delay: float) -> Judged:
    """Return PD with three equal poles of s^2 + s + (kd s + kp) e^(-s D), the delay stated.

    The triple root of (s^2 + s) e^(s D) + kd s + kp is where its second derivative is 0.
    """
    D = delay + delay / SAMPLES  # the hold and the difference are half a sample each
    s = (math.sqrt(D * D + 8.0) - D - 4.0) / (2.0 * D)
    # kp and kd from value and slope of the characteristic function at the triple root.
    kd = -math.exp(s * D) * (D * (s * s + s) + 2.0 * s + 1.0)
    return judged(-math.exp(s * D) * (s * s + s) - kd * s, 0.0, kd, delay)


@chart
def ziegler_nichols_rows(points: int = 15) -> Iterator[Panel]:
    """Chart Ziegler and Nichols' rules on a joint, judged by their matrix, and an alternative.

    Args:
        points: delays.
    """
    delays = np.geomspace(0.01, 10.0, points)
    panel = Panel(
        "The rows on a joint with its true delay",
        "delay [J/b]",
        "overshoot of a step (at the top: unstable)",
        scale="log x",
        ylim=(0.0, 2.0),
    )
    for name in (*ROWS, "placed"):
        result = [placed(D) if name == "placed" else ziegler_nichols(name, D) for D in delays]
        over = [f.overshoot if f.growth < 1.0 else math.inf for f in result]
        panel.series.append(
            Series(name if name != "placed" else "PD, three equal poles", delays, over)
        )
        for D, f in zip(
            delays[:: max(1, points // 3)], result[:: max(1, points // 3)], strict=True
        ):
            remaining = f.margins()
            held = (
                "unstable"
                if f.growth >= 1.0
                else (
                    f"gain margin {remaining.gain:4.2f}  phase {remaining.phase:4.2f} rad  "
                    f"overshoot {f.overshoot:4.0%}  settled after {f.settling / D:5.1f} D"
                )
            )
            panel.notes.append(f"{name:<7} delay {D:6.3g}  {held}")
    yield panel
