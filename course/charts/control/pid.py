"""The PID drill: where its loop becomes unstable, and what a jam does to its integral."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.check import invalid
from course.control import PID, ExactJoint, closed_loop, sampled
from course.measure import stability
from course.measure.figure import Panel, Series
from course.measure.scene import LeftOut, Modelled, Scene, Tolerance
from course.oracles.mujoco.joint import MotorJoint

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Loop:
    """A joint and its controller's numbers.

    Attributes:
        inertia, damping, load: of the joint [kg m^2, N m s/rad, N m].
        kp, ki, kd: gains [N m/rad, N m/(rad s), N m s/rad].
        tau: time constant of the derivative's filter [s].
        dt: sample time [s].
        limit: the motor's largest torque, both ways [N m].
        friction: dry friction [N m], which only MuJoCo's joint has.
    """

    inertia: float = 0.05
    damping: float = 0.1
    load: float = 0.3
    kp: float = 6.4
    ki: float = 25.6
    kd: float = 0.7
    tau: float = 0.01
    dt: float = 0.005
    limit: float = 2.0
    friction: float = 0.0

    def scaled(self, gain: float) -> "Loop":
        """Return the same with all three gains times a factor."""
        return replace(self, kp=gain * self.kp, ki=gain * self.ki, kd=gain * self.kd)

    def controller(self, kind: type[PID] = PID, limit: float | None = None) -> PID:
        """Return a new controller; `limit` replaces the motor's torque [N m]."""
        top = self.limit if limit is None else limit
        return kind(self.kp, self.ki, self.kd, self.dt, -top, top, self.tau)

    def joint(self) -> ExactJoint:
        """Return the exact joint."""
        return ExactJoint(self.inertia, self.damping, self.dt, self.load)

    def mujoco(self, substeps: int = 10, integrator: str = "implicitfast") -> MotorJoint:
        """Return MuJoCo's joint."""
        return MotorJoint(
            self.inertia,
            self.damping,
            self.dt,
            self.load,
            substeps=substeps,
            friction=self.friction,
            integrator=integrator,
        )


# With these gains three poles of the continuous loop lie at -8 rad/s, the filter left out.
LOOP = Loop()


class WindingPID(PID):
    """The same controller without anti-windup: it integrates at the limit as well."""

    def update(self, setpoint: float, measurement: float) -> float:
        """See `PID.update`."""
        # Integrated in any case: the base class may freeze it at the limit.
        integral = self.integral + self.ki * (setpoint - measurement) * self.dt
        command = super().update(setpoint, measurement)
        self.integral = integral
        return command


# --- stability ------------------------------------------------------------------------------------


def theoretical_growth(loop: Loop, steps: int = 0) -> float:
    """Return growth per sample by the loop's matrix (`course.control.sampled`).

    Args:
        loop: joint and gains.
        steps: semi-implicit Euler steps in a sample, as MuJoCo takes them; 0 for the exact joint.
    """
    law = sampled.pid_law(loop.kp, loop.ki, loop.kd, dt=loop.dt, tau=loop.tau)
    plant = sampled.held(*sampled.joint_system(loop.inertia, loop.damping), loop.dt)
    if steps:
        # The plant as a simulator steps it, instead of the exact one.
        plant = sampled.stepped(loop.inertia, loop.damping, loop.dt, steps)
    return sampled.growth(sampled.loop_matrix(plant, law))


def loop_step(loop: Loop, joint: ExactJoint | MotorJoint) -> Callable[[Array], Array]:
    """Return one sample of the real controller on a joint, as a map of its state.

    The set-point is 0, the limits are off. The state is (angle, speed, integral, filtered rate,
    last angle), shape (5,); what `course.measure.stability` takes.
    """
    controller = loop.controller(limit=math.inf)

    def step(state: Array) -> Array:
        # Angle, speed and all of the controller's memory: the full state of the sampled loop.
        q, v, controller.integral, controller.rate, controller.last = state.tolist()
        joint.reset(q, v)
        joint.step(controller.update(0.0, q))
        return np.array([joint.q, joint.v, controller.integral, controller.rate, q])

    return step


def measured_growth(loop: Loop, mujoco: bool = False) -> float:
    """Return the same, measured on the controller's class, with the exact joint or MuJoCo's."""
    free = replace(loop, load=0.0)
    joint = free.mujoco() if mujoco else free.joint()
    return stability.spectral_radius(stability.amplification(loop_step(loop, joint), 5))


def gain_limit(loop: Loop, growth: Callable[[Loop], float]) -> float:
    """Return the largest factor on all gains with which the loop is stable, by bisection."""
    return stability.limit(lambda gain: growth(loop.scaled(gain)) <= 1.0 + 1e-9, 1.0, 1e3)


def rate_limit(loop: Loop, growth: Callable[[Loop], float]) -> float:
    """Return the largest sample time with which the loop is stable [s], by bisection."""
    return stability.limit(
        lambda dt: growth(replace(loop, dt=dt)) <= 1.0 + 1e-9, 0.1 * loop.dt, 100.0 * loop.dt
    )


@chart
def pid_stability(nx: int = 125, ny: int = 117) -> Iterator[Panel]:
    """Chart where the sampled PID loop is stable, measured and in theory.

    Args:
        nx: points of the map along the sample time.
        ny: points of the map along the gain.
    """
    dt, gain = np.linspace(0.003, 0.065, nx), np.linspace(1.0, 30.0, ny)
    result = stability.stability_map(
        lambda x, y: measured_growth(replace(LOOP, dt=x).scaled(y)), dt, gain
    )

    def theory(x: float) -> float:
        return gain_limit(replace(LOOP, dt=x), theoretical_growth)

    few = [0.004, 0.006, 0.008, 0.012, 0.02, 0.03, 0.045, 0.06]
    marks = [
        gain_limit(replace(LOOP, dt=x), lambda loop: measured_growth(loop, mujoco=True))
        for x in few
    ]
    panel = Panel(
        "A slower loop allows less gain",
        "sample time [s]",
        "factor on all gains",
        grid=result,
    )
    panel.series = [
        Series(
            "theory: the loop's matrix", dt, [theory(float(x)) for x in dt], "theory on a map", "--"
        ),
        Series("MuJoCo, ten steps a sample", few, marks, "MuJoCo", ""),
    ]
    by_gain = theory(LOOP.dt), gain_limit(LOOP, measured_growth)
    by_rate = rate_limit(LOOP, theoretical_growth), rate_limit(LOOP, measured_growth)
    error = max(abs(mark / theory(x) - 1.0) for x, mark in zip(few, marks, strict=True))
    steps = [
        gain_limit(replace(LOOP, dt=x), lambda loop: theoretical_growth(loop, 10)) for x in few
    ]
    own = max(abs(mark / step - 1.0) for mark, step in zip(marks, steps, strict=True))
    panel.notes = [
        f"largest factor on the gains at {1e3 * LOOP.dt:g} ms: "
        f"theory {by_gain[0]:.3f}, measured {by_gain[1]:.3f}",
        f"largest sample time with the gains as they are: "
        f"theory {1e3 * by_rate[0]:.2f} ms, measured {1e3 * by_rate[1]:.2f} ms",
        f"MuJoCo's limit (implicitfast, ten steps a sample) is within {error:.1%} of theory, and "
        f"within {own:.0e} of what its steps give as a matrix",
    ]
    yield panel


# --- windup ---------------------------------------------------------------------------------------

STEP = 0.25  # rad: the set-point's step
BAND = 0.02 * STEP  # rad: settled within 2 %
JAM = 2.0  # s, from the start
DURATION = 8.0  # s


@dataclass(frozen=True)
class Recovery:
    """After the jam: how far past the set-point [rad], and the time until it is settled [s]."""

    overshoot: float
    time: float


def jammed(
    loop: Loop = LOOP,
    joint: ExactJoint | MotorJoint | None = None,
    kind: type[PID] = PID,
    jam: float = JAM,
) -> tuple[Array, Array, Array]:
    """Return times, angles and commands of a set-point step whose joint is jammed at the start.

    Args:
        loop: joint and controller.
        joint: another joint than the exact one.
        kind: the controller's class.
        jam: how long [s].

    Returns:
        Times (n + 1,) [s], angles (n + 1,) [rad] and commands (n,) [N m].
    """
    n = round(DURATION / loop.dt)
    times = np.linspace(0.0, n * loop.dt, n + 1)
    # A hair less than the jam, so that rounding of the times does not add a jammed sample.
    angles, commands = closed_loop(
        loop.controller(kind), joint or loop.joint(), np.full(n, STEP), times[:n] < jam - 1e-9
    )
    return times, angles, commands


def recovery(times: Array, angles: Array, jam: float = JAM) -> Recovery:
    """Return what a record of `jammed` shows.

    Raises:
        ValueError: if the joint is not settled at the end.
    """
    # Settled after the last sample outside the band.
    outside = np.flatnonzero(np.abs(angles - STEP) > BAND)
    if outside[-1] + 1 >= times.size:
        raise invalid("angles[-1]", angles[-1], f"a number within {BAND:g} rad of {STEP:g}")
    return Recovery(float(np.max(angles) - STEP), float(times[outside[-1] + 1] - jam))


def overshoot(
    joint: ExactJoint | MotorJoint | None = None,
    kind: type[PID] = PID,
    jam: float = JAM,
    **changes: float,
) -> float:
    """Return how far the joint goes past the set-point once it is free [rad].

    Args:
        joint: as for `jammed`.
        kind: as for `jammed`.
        jam: as for `jammed`.
        **changes: fields of `Loop`; the controller keeps its gains.
    """
    loop = replace(LOOP, **changes)
    return float(np.max(jammed(loop, joint, kind, jam)[1]) - STEP)


def jam_scene() -> Scene:
    """Return the drill's scene: what the jam leaves in the integral shows as overshoot."""
    answer = overshoot()
    stepping = overshoot(LOOP.mujoco())
    rubbing = replace(LOOP, friction=0.01 * LOOP.limit)
    return Scene(
        question="How far does the joint shoot past the set-point when its jam ends?",
        tolerance=Tolerance(
            0.01, "rad", "anti-windup must show: it changes the answer by over a hundred times this"
        ),
        degrees_of_freedom=("angle",),
        modelled=(
            Modelled(
                "the jam",
                lambda: abs(overshoot(jam=0.0) - answer),
                "rad",
                against="the exact joint, never jammed",
            ),
            Modelled(
                "the torque limit",
                lambda: abs(overshoot(limit=1e6) - answer),
                "rad",
                against="the exact joint, no limit",
            ),
            Modelled(
                "damping",
                lambda: abs(overshoot(damping=0.0) - answer),
                "rad",
                against="the exact joint without",
            ),
            Modelled(
                "the load",
                lambda: abs(overshoot(load=0.0) - answer),
                "rad",
                against="the exact joint without",
            ),
        ),
        left_out=(
            LeftOut(
                "a jam that gives way",
                lambda: abs(stepping - answer),
                "rad",
                against="MuJoCo, ten steps a sample",
            ),
            LeftOut(
                "dry friction, 1 % of the motor",
                lambda: abs(overshoot(rubbing.mujoco()) - stepping),
                "rad",
                against="MuJoCo, friction loss",
            ),
        ),
    )


@chart
def pid_windup() -> Iterator[Panel]:
    """Chart a jam of two seconds with and without anti-windup.

    The joint is the exact one, and MuJoCo's.
    """
    left, right = (
        Panel(title, "time [s]", y, spans=[("x", 0.0, JAM, "jammed")], xlim=(0.0, 5.0))
        for title, y in (
            ("The integral of a jam has to be unwound", "angle [rad]"),
            ("It holds the command at the limit", "command [N m]"),
        )
    )
    left.lines = [("y", STEP, "set-point")]
    for key, kind in (("conditional integration", PID), ("no anti-windup", WindingPID)):
        for model, joint in (("exact", LOOP.joint()), ("MuJoCo", LOOP.mujoco())):
            times, angles, commands = jammed(joint=joint, kind=kind)
            result, label = recovery(times, angles), f"{key}, {model}"
            style, width = ("-", 1.2) if model == "exact" else (":", 2.5)
            left.series.append(
                Series(
                    label,
                    times,
                    angles,
                    key,
                    style,
                    marker="",
                    width=width,
                    note=f"{label:<32} {result.overshoot:.3f} rad past the set-point, settled "
                    f"{result.time:.2f} s after the jam",
                )
            )
            right.series.append(
                Series(label, times[:-1], commands, key, style, marker="", width=width)
            )
    right.notes.append(jam_scene().table())
    yield from (left, right)
