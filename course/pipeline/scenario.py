"""What is asked, and of what settings: the scene of the chapter, checked before anything runs.

A two-link arm in a horizontal plane, discs that it must not touch, a target that stands or drifts.
Is the tip within the tolerance, half the opening of a gripper, when the time is over?
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from course.check import POSITIVE, count, finite, invalid, one_of, positive, vector
from course.control import Actuator
from course.kinematics import TwoLink, two_link_ik
from course.planning import World, clearance, planar_arm

Array = NDArray[np.float64]

Discs = tuple[tuple[float, float, float], ...]

# Whose part of an error can be mended alone, in the order of the data.
STAGES = ("perceive", "age", "plan", "control", "move")
LAWS = ("pd", "computed_torque")
OVERRUNS = ("pipelined", "drop", "queue", "block")
GRAVITY = 9.81  # m/s^2, of which a tilted table shows its sine


@dataclass(frozen=True)
class Scenario:
    """What is to be done, and in what world.

    Attributes:
        arm: as it is; the law believes the same without gravity.
        start: joint angles at rest [rad].
        target: where it is at time 0, and its velocity, constant [m, m/s].
        discs: rows (x, y, radius) [m].
        radius: of the links, half their width [m].
        tolerance: largest distance from tip to target at the end that will do [m].
        seconds: length of a run [s].
        tilt: of the table, down along -y [rad].
    """

    arm: TwoLink = field(default_factory=TwoLink)
    start: tuple[float, float] = (-0.6, 1.2)
    target: tuple[float, float] = (0.15, 0.60)
    velocity: tuple[float, float] = (-0.008, 0.006)
    discs: Discs = ((0.62, 0.36, 0.07), (-0.25, 0.30, 0.08))
    radius: float = 0.02
    tolerance: float = 0.02
    seconds: float = 4.0
    tilt: float = 0.0

    def __post_init__(self) -> None:
        vector("start", self.start, (2,), unit="rad")
        vector("target", self.target, (2,), unit="m")
        vector("velocity", self.velocity, (2,), unit="m/s")
        finite("tilt", self.tilt, -0.5 * math.pi, 0.5 * math.pi, unit="rad")
        positive("tolerance", self.tolerance, unit="m")
        positive("seconds", self.seconds, unit="s")
        if self.arm.gravity:
            raise invalid("arm.gravity", self.arm.gravity, "0: what the table's tilt shows is it")
        for when in self._critical_times():
            place = self.at(when)
            reach = two_link_ik(self.arm.lengths, place)
            if not reach.reached:
                raise invalid(f"target at {when:g} s", place, "a place that the tip can reach")
            for x, y, size in self.discs:
                if math.dist(place, (x, y)) <= size:
                    raise invalid(f"target at {when:g} s", place, "a place outside of the discs")
        if clearance(self.world(0.0), self.start) <= 0.0:
            raise invalid("start", self.start, "a posture that touches nothing")

    def _critical_times(self) -> list[float]:
        """Return both ends and the times at which the target is nearest to the base or a disc."""
        start, velocity = np.asarray(self.target), np.asarray(self.velocity)
        square, times = float(velocity @ velocity), [0.0, self.seconds]
        for x, y in [(0.0, 0.0), *((x, y) for x, y, _ in self.discs)] if square else ():
            # Time of the closest approach, within the run.
            nearest = float((np.array([x, y]) - start) @ velocity) / square
            times.append(min(max(nearest, 0.0), self.seconds))
        return times

    def at(self, seconds: float) -> Array:
        """Return where the target is, shape (2,) [m]."""
        return np.asarray(self.target) + seconds * np.asarray(self.velocity)

    def world(self, margin: float = 0.0) -> World:
        """Return the arm among the discs, its links wider by a margin [m]."""
        return _world(self.arm.lengths, self.radius + margin, self.discs)

    @property
    def plant(self) -> TwoLink:
        """The arm on the tilted table."""
        return replace(self.arm, gravity=GRAVITY * math.sin(self.tilt))


@dataclass(frozen=True)
class Settings:
    """How it is done. Times are rounded to whole microseconds.

    Attributes:
        noise, bias: of one picture's place: standard deviation of each axis [m], and mean [m].
        frame: period of the camera [s].
        phase: of its first capture [s].
        latency: from the capture of an image to its arrival [s].
        overrun: of a frame that takes longer than a period. "pipelined": another worker takes it;
            "drop": lost where the worker is busy; "queue": it waits; "block": the camera waits.
        lost: share of frames that never arrive.
        filtered: whether a Kalman filter stands between picture and plan.
        carried: whether its estimate is carried forward from its capture to now.
        drift: what the filter believes: standard deviation of the target's acceleration [m/s^2]
            and of its speed at first [m/s].
        step: longest edge of the planner's trees [rad].
        samples: budget of a plan.
        check_cost: time that a collision check takes in the story; a plan arrives after its checks.
        margin: clearance that a plan keeps [m].
        replan: distance that the goal must have moved before the arm replans [m].
        hysteresis: whether the arm follows its old plan while a new one is made, from where the
            arm was when it was requested; else it waits there.
        rate, acceleration: limits of a plan, of each joint [rad/s, rad/s^2].
        law: "pd": kp (reference - q) - kd v; "computed_torque": with the model and the rates.
        kp, kd: gains, of pd [N m/rad, N m s/rad], of computed torque before the inertia.
        control: period of the law [s]; at most one command a physics step.
        actuator: what stands between a command and the torque, beside the arm's limits.
        physics: step of the simulation [s].
        ideal: whose part is ideal, of `STAGES`; see `repair`.
    """

    noise: float = 0.05
    bias: tuple[float, float] = (-0.003, 0.002)
    frame: float = 0.02
    phase: float = 0.0
    latency: float = 0.1
    overrun: str = "pipelined"
    lost: float = 0.0
    filtered: bool = True
    carried: bool = False
    drift: tuple[float, float] = (0.002, 0.01)
    step: float = 0.3
    samples: int = 20_000
    check_cost: float = 20e-6
    margin: float = 0.05
    replan: float = 0.1
    hysteresis: bool = False
    rate: float = 1.5
    acceleration: float = 4.0
    law: str = "pd"
    kp: float = 25.0
    kd: float = 8.0
    control: float = 0.002
    actuator: Actuator = field(default_factory=Actuator)
    physics: float = 0.002
    ideal: frozenset[str] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        for name in ("frame", "control", "physics"):
            finite(name, getattr(self, name), 1e-6, unit="s")
        for name in ("noise", "phase", "latency", "check_cost", "margin", "kp", "kd"):
            finite(name, getattr(self, name), 0.0)
        for name in ("step", "rate", "acceleration", "replan"):
            positive(name, getattr(self, name))
        vector("bias", self.bias, (2,), unit="m")
        vector("drift", self.drift, (2,), low=POSITIVE)
        finite("lost", self.lost, 0.0, 1.0)
        count("samples", self.samples, 1)
        one_of("overrun", self.overrun, OVERRUNS)
        one_of("law", self.law, LAWS)
        for name in self.ideal:
            one_of("ideal", name, STAGES)
        if microseconds(self.control) < microseconds(self.physics):
            allowed = (
                f"a period of at least the physics step, {self.physics:g} s (of several commands "
                "in one step only the last would act)"
            )
            raise invalid("control", self.control, allowed)


# A run asks for the same worlds again and again.
@functools.lru_cache(maxsize=64)
def _world(lengths: tuple[float, float], radius: float, discs: Discs) -> World:
    return planar_arm(lengths, radius, discs=np.array(discs, dtype=float).reshape(-1, 3))


def microseconds(seconds: float) -> int:
    """Return a time in s on the clock of a run, in integer microseconds."""
    return round(1e6 * seconds)


def repair(settings: Settings, *stages: str) -> Settings:
    """Return the same settings with some stages ideal.

    The noise drawn and all else stay as they are.

    "perceive": no noise and no bias. "age": what was seen arrives at once, none is lost, and is
    carried forward by the target's true motion. "plan": no time for a check, the fastest of three
    ways, and a margin of 30 mm at least. "control": the arm is where the reference is. "move":
    steps of a quarter millisecond; a law that has its turn at every step has it at each of these.
    """
    for stage in stages:
        one_of("stage", stage, STAGES)
    return replace(settings, ideal=settings.ideal | frozenset(stages))


def subsets(stages: Iterable[str] = STAGES) -> list[tuple[str, ...]]:
    """Return all choices among the stages, the empty one first: 2^n of them."""
    every = tuple(stages)
    # The bits of a number choose the stages.
    return [
        tuple(name for i, name in enumerate(every) if bits >> i & 1)
        for bits in range(1 << len(every))
    ]
