"""What crosses an interface, the camera's timetable, and the four stages of the course."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.compiled import compiled
from course.kinematics import two_link_ik
from course.kinematics.two_link import TORQUES
from course.pipeline.drive import FRAME, LEAST, SETTINGS, law, step
from course.pipeline.scenario import LAWS, Scenario, Settings, microseconds
from course.planning import Trajectory, World, clearance, length, plan, shortcut, time_parameterise
from course.planning.worlds import EDGE
from course.role import free

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# --- what crosses an interface --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Crossing:
    """What one stage hands to the next.

    Attributes:
        value: a place (2,) [m], a `Path`, torques (2,) [N m], or a state (4,) [rad, rad/s].
        covariance: of the value, (2, 2), or None where the stage states none.
        frame: in which the value is: "base" or "joints".
        captured: stamp of the picture that it rests on [us]; -1 for none.
        arrived: when the next stage had it [us].
    """

    value: Any
    covariance: Array | None
    frame: str
    captured: int
    arrived: int


@dataclass(frozen=True, eq=False)
class Sight:
    """What a camera has before it when it takes a picture.

    Attributes:
        number, captured: of the frame, and when it is taken [us].
        target: true place (2,) [m], moved by what disturbs this frame.
        q: joint angles of the arm (2,) [rad].
        draws: standard normal numbers of this frame, (2,); a library may seed its own with them.
        scale: of the noise in this frame, 1 where nothing disturbs it.
    """

    number: int
    captured: int
    target: Array
    q: Array
    draws: Array
    scale: float


@dataclass(frozen=True, eq=False)
class Path:
    """What a planner answered.

    Attributes:
        status: "solved", or as in chapter 5.
        motion: the timed path, or None.
        goal: its last posture (2,) [rad]; NaN without a path.
        side: 0 where the elbow bends to the left there, 1 to the right.
        checks: collision checks, those of the shortcuts among them.
        waypoints: (2, k) [rad].
        margin: its clearance from the discs [m].
    """

    status: str
    motion: Trajectory | None = None
    goal: Array = field(default_factory=lambda: np.full(2, np.nan))
    side: int = 0
    checks: int = 0
    waypoints: Array = field(default_factory=lambda: np.empty((2, 0)))
    margin: float = 0.0


@dataclass(frozen=True, eq=False)
class Frames:
    """The timetable of the camera, and what disturbs each frame; N frames in the order of capture.

    Attributes:
        captured, arrived: shape (N,) [us].
        stamp: capture time in each message [us].
        shift: by which the target seems to be elsewhere, (N, 2) [m].
        scale: of each frame's noise, (N,).
        draws: standard normal numbers, (N, 2), by number of the frame whatever the settings are.
    """

    captured: Ints
    arrived: Ints
    stamp: Ints
    shift: Array
    scale: Array
    draws: Array

    def where(self, retained: NDArray[np.bool_]) -> Frames:
        """Return those frames only."""
        return Frames(*(getattr(self, name)[retained] for name in self.__dataclass_fields__))


def frames(settings: Settings, seconds: float, seed: int) -> Frames:
    """Return when each picture is taken and arrives; random numbers are those of the seed.

    Args:
        settings: period, phase, latency and overrun of the camera, losses.
        seconds: length of the run.
        seed: of the noise and of the losses, each a stream of its own.
    """
    period, late = microseconds(settings.frame), microseconds(settings.latency)
    taken = np.arange(microseconds(settings.phase), microseconds(seconds), period, dtype=np.int64)
    draws = np.random.default_rng([seed, 0]).standard_normal((taken.size, 2))
    retained = np.ones(taken.size, dtype=np.bool_)
    if settings.lost > 0.0:
        retained &= np.random.default_rng([seed, 1]).random(taken.size) >= settings.lost
    arrived = taken + late
    # What the camera does while it is busy: drop the image, delay the capture, or queue it.
    if settings.overrun == "drop":
        retained &= free(taken.astype(float), np.full(taken.size, float(late)))
    elif settings.overrun == "block":
        # The camera waits for its worker, so that later captures are delayed.
        taken = taken[0] + np.arange(taken.size) * max(period, late)
        arrived = taken + late
    elif settings.overrun == "queue":
        # A single server with constant times: frames leave it one after the other.
        arrived = taken[0] + late + np.arange(taken.size) * max(period, late)
    # A capture that is delayed beyond the end does not happen.
    retained &= taken < microseconds(seconds)
    zero = np.zeros((taken.size, 2))
    whole = Frames(taken, arrived, taken.copy(), zero, np.ones(taken.size), draws)
    return whole if retained.all() else whole.where(retained)


# --- the stages -----------------------------------------------------------------------------------

Perceive = Callable[[Sight, Scenario, Settings], tuple[Array, Array, str, int]]
Planner = Callable[[Array, Array, Scenario, Settings, np.random.Generator], Path]
Control = Callable[[Array, Array, Array, Scenario, Settings], Array]
Move = Callable[[Array, Array, Array, float, Scenario], tuple[Array, Array]]


def perceive(sight: Sight, scenario: Scenario, settings: Settings) -> tuple[Array, Array, str, int]:
    """Return what chapter 7's `stand_in` leaves of a picture: its bias, and its noise.

    Returns:
        The place (2,) and its covariance (2, 2) [m], the frame that they are in, and the stamp of
        the picture [us].
    """
    sigma = settings.noise * sight.scale
    place = sight.target + np.asarray(settings.bias) + sigma * sight.draws
    return place, max(sigma, LEAST) ** 2 * np.eye(2), FRAME, sight.captured


TRIES, DETOUR = 3, 2.0  # searches, while a path is longer than this multiple of the straight one

Search = Callable[[World, Array, Array, Settings, np.random.Generator], tuple[Any, int, str]]


def search(
    world: World, start: Array, goal: Array, settings: Settings, rng: np.random.Generator
) -> tuple[Array | None, int, str]:
    """Return waypoints (2, k) by RRT-Connect or None, the checks that they took, and a status."""
    result = plan(world, start, goal, budget=settings.samples, rng=rng, step=settings.step)
    return result.path, result.state_checks + result.edge_checks, result.status


def plan_path(
    start: Array,
    goal: Array,
    scenario: Scenario,
    settings: Settings,
    rng: np.random.Generator,
    search: Search = search,
) -> Path:
    """Return a timed path of the joints from a posture to a place of the tip.

    The nearer of the two postures comes first, the other where there is no way to it. A path that
    is a detour is searched anew, the shortest is taken. Where start or goal are nearer to a disc
    than twice the margin, the margin is half of that.

    Args:
        start: posture (2,) [rad].
        goal: place of the tip (2,) [m]; out of reach, the nearest place in reach.
        scenario: the task.
        settings: of the planner.
        rng: the only source of random numbers.
        search: who finds the waypoints; another one may be a library's.
    """
    world, status = scenario.world(), "goal in collision"
    requested = [0]
    postures = two_link_ik(scenario.arm.lengths, goal).q
    # Wrap the angles to -pi to pi.
    postures = (postures + math.pi) % (2.0 * math.pi) - math.pi
    here = clearance(world, start)
    # The nearer elbow first; the other one only if no path is found to it.
    for side in np.argsort(
        np.linalg.norm(postures - start[:, None], axis=0), kind="stable"
    ).tolist():
        other = postures[:, side]
        # A margin that start or goal does not have cannot be asked of the path.
        room = 0.5 * min(here, clearance(world, other))
        if room <= 0.0:
            continue
        margin = min(settings.margin, room)
        wide = scenario.world(margin)
        test = compiled(wide.edge_free, EDGE)

        def free(a: Array, b: Array, test: Any = test, wide: World = wide) -> bool:
            # Checks for shortcuts cost time in the story as well.
            requested[0] += 1
            return bool(test(wide.obstacles, wide.body, a, b))

        paths: list[Array] = []
        # RRT-Connect sometimes returns a detour: a few searches, and the shortest of them.
        for _ in range(TRIES):
            waypoints, checks, status = search(wide, start, other, settings, rng)
            requested[0] += checks
            if waypoints is None:
                break
            paths.append(shortcut(waypoints, free, rng, rounds=20))
            if length(paths[-1]) < DETOUR * math.dist(start, other):
                break
        if paths:
            path = min(paths, key=length)
            motion = time_parameterise(path, (settings.rate, settings.acceleration))
            return Path("solved", motion, other, side, requested[0], path, margin)
    return Path(status, checks=requested[0])


def control(q: Array, v: Array, desired: Array, scenario: Scenario, settings: Settings) -> Array:
    """Return torques (2,) of a law of chapter 6 [N m].

    Args:
        q: joint angles, shape (2,) [rad].
        v: joint rates, shape (2,) [rad/s].
        desired: angles, rates and accelerations of the reference, shape (3, 2).
        scenario: the arm.
        settings: the law, its gains, and the arm that it believes in.
    """
    # The law reads these three settings only.
    numbers = np.zeros((), SETTINGS)[()]
    numbers["law"] = LAWS.index(settings.law)
    numbers["kp"], numbers["kd"] = settings.kp, settings.kd
    row = np.concatenate((q, v, np.zeros(4)))[None]
    law(numbers, scenario.arm.column(), row, 0, desired)
    return row[0, 6:]


def move(q: Array, v: Array, tau: Array, dt: float, scenario: Scenario) -> tuple[Array, Array]:
    """Return the state after a step [s] under a torque (2,): semi-implicit Euler."""
    body, row = scenario.plant.column(), np.concatenate((q, v))[None]
    body[TORQUES, 0] = tau
    step(row, 0, dt, body)
    return row[0, :2], row[0, 2:]


@dataclass(frozen=True)
class Stages:
    """The four functions of the pipeline, each of which may be a library's or a learner's.

    Attributes:
        perceive, plan, control, move: called as those of this file.
    """

    perceive: Perceive = perceive
    plan: Planner = plan_path
    control: Control = control
    move: Move = move


OURS = Stages()
