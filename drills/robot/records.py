"""The records that cross the interfaces of the robot's stages, and the cell that they describe.

A stage is a function of one record that returns another. All are in SI units. The frame "base" has
its origin at the arm's base, x to the right and y up the tilted table, z away from the table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Cell(NamedTuple):
    """The robot, its table and its camera, as the robot's own programs believe them to be.

    Attributes:
        lengths: of the two links [m].
        masses: of the links, each a thin uniform rod [kg].
        tilt: of the table [rad]; the arm moves parallel to it.
        width: half the width of a link [m].
        torques: limit of each joint [N m].
        coulomb: dry friction of each joint [N m].
        viscous: friction of each joint per speed [N m s/rad].
        transition: speed at which dry friction is tanh(1) = 76 % of its full size [rad/s].
        rates: limit of each joint in a plan [rad/s].
        accelerations: the same [rad/s^2].
        home: joint angles at the start [rad].
        tick: period of control and physics [s].
        frame: period of the camera in ticks.
        pixels: of the depth picture, rows and columns.
        focal: lengths of the camera along the columns and the rows [px].
        axis: column and row where the optical axis meets the picture [px].
        camera: position of the camera in the base [m].
        turn: rotation matrix from the camera's frame to the base, row by row.
        unit: length of one count of the depth picture [m].
        base: half the length and half the width of the part's bottom [m].
        top: the same of its top [m].
        height: of the part [m].
        mu: coefficient of friction between part and table.
        drop: height above the table at which the gripper lets go [m].
        cup: radius of the suction cup: the largest grasp error that still holds the part [m].
        tolerance: largest distance of the placed part from its slot [m].
        seconds: longest cycle time that counts as a success [s].
    """

    lengths: tuple[float, float] = (0.5, 0.4)
    masses: tuple[float, float] = (3.0, 2.0)
    tilt: float = 0.35
    width: float = 0.03
    torques: tuple[float, float] = (60.0, 25.0)
    coulomb: tuple[float, float] = (1.0, 0.25)
    viscous: tuple[float, float] = (0.5, 0.1)
    transition: float = 0.05
    rates: tuple[float, float] = (2.0, 2.5)
    accelerations: tuple[float, float] = (6.0, 8.0)
    home: tuple[float, float] = (-1.2, 1.8)
    tick: float = 0.004
    frame: int = 12
    pixels: tuple[int, int] = (48, 64)
    focal: tuple[float, float] = (90.0, 93.0)
    axis: tuple[float, float] = (30.5, 24.2)
    camera: tuple[float, float, float] = (0.6, 0.2, 0.9)
    turn: tuple[float, ...] = (0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0)
    unit: float = 1e-4
    base: tuple[float, float] = (0.055, 0.04)
    top: tuple[float, float] = (0.025, 0.015)
    height: float = 0.04
    mu: float = 0.6
    drop: float = 0.003
    cup: float = 0.01
    tolerance: float = 0.006
    seconds: float = 15.0

    @property
    def gravity(self) -> float:
        """Gravity along the table, down along -y [m/s^2]."""
        return 9.81 * float(np.sin(self.tilt))


# --- perception -----------------------------------------------------------------------------------


class Image(NamedTuple):
    """What the camera hands to perception.

    Attributes:
        depth: along the optical axis in counts, shape (rows, columns); 0 and NaN are no
            measurement.
        captured: when it was taken [s].
        triples: indices to try for the table's plane, shape (m, 3); random numbers of this image.
        noise: standard deviation of a pixel's depth [m].
    """

    depth: Array
    captured: float
    triples: NDArray[np.int64]
    noise: float


class Sighting(NamedTuple):
    """What perception hands to estimation.

    Attributes:
        position: of the part in the base, shape (2,) [m].
        heading: of the part's long side, modulo pi [rad].
        points: number of points that the pose rests on.
    """

    position: Array
    heading: float
    points: int


# --- estimation -----------------------------------------------------------------------------------


class Messages(NamedTuple):
    """What has arrived from the camera so far; n messages.

    Attributes:
        states: position and velocity, shape (n, 4) [m, m/s].
        covariances: of the states, shape (n, 4, 4).
        captured: time at which each image was taken, shape (n,) [s].
        arrived: time at which each message arrives, shape (n,) [s].
        now: the time of the request [s].
        noise: density of the part's unknown acceleration [m^2/s^3].
    """

    states: Array
    covariances: Array
    captured: Array
    arrived: Array
    now: float
    noise: float


class Estimate(NamedTuple):
    """What estimation hands on.

    Attributes:
        position: of the part now, shape (2,) [m].
        velocity: of the part now, shape (2,) [m/s].
        covariance: of both, shape (4, 4).
    """

    position: Array
    velocity: Array
    covariance: Array


class Loop(NamedTuple):
    """What the choice of the tracking gain rests on.

    Attributes:
        delay: age of an image when it is used, in frames.
        noise: standard deviation of one image's error [m].
        offset: size of the error at the start [m].
        frames: length of the correction.
    """

    delay: int
    noise: float
    offset: float
    frames: int


# --- kinematics -----------------------------------------------------------------------------------


class Reach(NamedTuple):
    """A position that the tip has to reach.

    Attributes:
        target: shape (2,) [m].
    """

    target: Array


class Correction(NamedTuple):
    """A small motion of the tip.

    Attributes:
        q: joint angles now, shape (2,) [rad].
        error: desired motion of the tip, shape (2,) [m].
        damping: of the step [m/rad].
    """

    q: Array
    error: Array
    damping: float


# --- planning -------------------------------------------------------------------------------------


class Route(NamedTuple):
    """A request to the planner.

    Attributes:
        start: joint angles, shape (2,) [rad].
        goals: joint angles that would all do, one in each row, shape (g, 2) [rad].
        posts: obstacles, widened by the link and a margin, rows (x, y, radius), shape (m, 3) [m].
        shadows: discs in the plane of the two joint angles that cover the outline of all postures
            that touch a post, rows (q1, q2, radius), shape (n, 3) [rad].
        samples: random postures for the trees, shape (s, 2) [rad].
        draws: random pairs of fractions for the shortcuts, shape (d, 2).
        step: longest edge of the trees [rad].
    """

    start: Array
    goals: Array
    posts: Array
    shadows: Array
    samples: Array
    draws: Array
    step: float


class Motion(NamedTuple):
    """A planned motion.

    Attributes:
        waypoints: shape (k, 2) [rad]; no rows if there is no way.
        duration: [s].
        q: angles at each tick from the start, shape (n, 2) [rad].
        v: rates, shape (n, 2) [rad/s].
        a: accelerations, shape (n, 2) [rad/s^2].
    """

    waypoints: Array
    duration: float
    q: Array
    v: Array
    a: Array


# --- control and physics --------------------------------------------------------------------------


class Command(NamedTuple):
    """What the control law is called with at each tick.

    Attributes:
        q, v: measured angles and rates, shape (2,) [rad, rad/s].
        reference: desired angles, rates and accelerations, shape (3, 2).
        kp, kd: gains of both joints, shape (2,) [1/s^2, 1/s].
        hold: whether the arm only has to stay where it is.
    """

    q: Array
    v: Array
    reference: Array
    kp: Array
    kd: Array
    hold: bool


class Tick(NamedTuple):
    """What the physics is called with at each tick.

    Attributes:
        q, v: angles and rates, shape (2,) [rad, rad/s].
        acceleration: of the joints as a function of q, with torques and rates of this tick.
        step: [s].
    """

    q: Array
    v: Array
    acceleration: Callable[[Array], Array]
    step: float


class Release(NamedTuple):
    """The part at the moment at which the gripper lets go.

    Attributes:
        position: down along the slope and above the table, shape (2,) [m].
        velocity: along the same axes, shape (2,) [m/s].
        slope: of the table [rad].
        mu: coefficient of friction.
    """

    position: Array
    velocity: Array
    slope: float
    mu: float


class Stages(NamedTuple):
    """The six stages of the robot. Each function may be replaced by your own.

    Attributes:
        perceive: Image -> Sighting, or None where the part is not in the image.
        estimate: Messages -> Estimate.
        choose_gain: Loop -> number, the fraction of an observed error that is corrected per frame.
        reach: Reach -> rows of joint angles, shape (g, 2) [rad].
        correct: Correction -> step of the joints, shape (2,) [rad].
        plan: Route -> Motion.
        gains: period [s] -> (kp, kd), each shape (2,).
        control: Command -> torques, shape (2,) [N m]; those against friction included.
        move: Tick -> (q, v), each shape (2,).
        release: Release -> position at rest, shape (2,) [m].
    """

    perceive: Callable[[Image], Sighting | None]
    estimate: Callable[[Messages], Estimate]
    choose_gain: Callable[[Loop], float]
    reach: Callable[[Reach], Array]
    correct: Callable[[Correction], Array]
    plan: Callable[[Route], Motion]
    gains: Callable[[float], tuple[Array, Array]]
    control: Callable[[Command], Array]
    move: Callable[[Tick], tuple[Array, Array]]
    release: Callable[[Release], Array]


class Failure(NamedTuple):
    """A part that stopped a run.

    Attributes:
        part: name of the slot, or of the stage.
        kind: "raised", "not finite", "wrong shape", "wrong type" or "too slow".
        text: what happened.
        tick: of the task.
        task: number of the task.
        line: in the part's file, 0 where unknown.
        call: the call as code that can be pasted.
    """

    part: str
    kind: str
    text: str
    tick: int
    task: int
    line: int
    call: str


class Breach(NamedTuple):
    """A promise that a part broke, and by how much.

    Attributes:
        part: name of the slot, or of the stage.
        text: the promise, as a sentence about this call.
        tick: of the task.
        task: number of the task.
        call: as code that can be pasted.
    """

    part: str
    text: str
    tick: int
    task: int
    call: str


Outcome = dict[str, Any]  # of one task, plain data: see `drills.robot.loop.run_task`
