"""The robot's loop: one task from the first image to the part at rest in its slot.

Look, plan, move, track, grip, plan, move, let go. Everything happens in ticks of the cell's clock.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from drills.robot import cell as scene
from drills.robot.cell import Level, Task, World, tip_of, tip_rate
from drills.robot.engine import PLAIN, Engine
from drills.robot.parts import Bench, PartFailed
from drills.robot.records import (
    Array,
    Cell,
    Command,
    Correction,
    Image,
    Loop,
    Messages,
    Motion,
    Outcome,
    Reach,
    Release,
    Route,
    Stages,
    Tick,
)
from drills.robot.slots import STAGES

LOOKS = (4, 8)  # images before the first plan: of a still part, of a moving one
TRACK = 14  # frames of correction before the gripper closes
SETTLE, CLOSE = 8, 20  # ticks
DAMPING = 0.02  # m/rad
DRIFT = 1e-4  # m^2/s^3, density of the part's acceleration as the tracker believes it
PLANNED = 0.008  # m, clearance that a plan keeps
RUNAWAY = 60.0  # rad/s, of both joints together
# Positions in the base that the log of a task holds, each as x and y [m].
SIGNALS = (
    "part_at_grip",
    "seen_at_grip",
    "command_at_grip",
    "reference_at_grip",
    "encoder_at_grip",
    "tip_at_grip",
    "slot",
    "goal_at_release",
    "reference_at_release",
    "encoder_at_release",
    "tip_at_release",
    "part_at_rest",
)


class Stopped(Exception):
    """The task ended early; the text says why. No part has failed, the robot has."""


class Arm:
    """The arm, its clock and its log during one task."""

    def __init__(
        self,
        cell: Cell,
        world: World,
        stages: Stages,
        bench: Bench,
        task: Task,
        filmed: bool,
        engine: Engine,
    ) -> None:
        self.cell, self.world, self.stages, self.bench = cell, world, stages, bench
        self.engine = engine
        self.task, self.filmed = task, filmed
        self.q, self.v = np.array(cell.home), np.zeros(2)
        self.reference = np.array(cell.home)  # where the arm should be now
        self.ticks = 0
        self.log: list[Array] = []
        self.kp, self.kd = stages.gains(cell.tick)
        self.queue = [np.zeros(2)] * world.delay  # torques on their way
        self.readings = scene.stream(task.seed, task.number, scene.ENCODER)
        self.posts = task.posts + np.array([0.0, 0.0, cell.width])
        self.closest = math.inf

    @property
    def now(self) -> float:
        """Time since the start of the task [s]."""
        return self.ticks * self.cell.tick

    def follow(self, q: Array, v: Array, a: Array, hold: bool = False) -> None:
        """Follow a reference, one row of each array a tick; then the reference is at the end."""
        positions = np.empty((len(q), 2))
        noise = self._noise(len(q))
        if self.engine.drive is not None:
            self._drive(np.stack((q, v, a), axis=1), noise, positions)
        else:
            self._tick(q, v, a, hold, noise, positions)
        self._watch(positions)

    def _noise(self, ticks: int) -> Array:
        """Return the errors of the encoders' readings, shape (ticks, 2) [rad]."""
        if not self.world.noise:
            return np.full((ticks, 2), self.world.bias)
        drawn = self.readings.standard_normal((ticks, 2))
        return np.asarray(self.world.bias + self.world.noise * drawn)

    def _tick(self, q: Array, v: Array, a: Array, hold: bool, noise: Array, out: Array) -> None:
        """Call the control part and the physics part at each tick; write the angles into out."""
        cell, world, gravity = self.cell, self.world, self.cell.gravity
        limits = np.array(cell.torques)
        for i in range(len(q)):
            self.bench.tick = self.ticks
            reference = np.array((q[i], v[i], a[i]))
            measured = self.q + noise[i]
            tau = self.stages.control(Command(measured, self.v, reference, self.kp, self.kd, hold))
            tau = np.minimum(np.maximum(tau, -limits), limits)
            if self.queue:
                self.queue.append(tau)
                tau = self.queue.pop(0)
            tau, rate = world.motor * tau, self.v

            def acceleration(x: Array, tau: Array = tau, rate: Array = rate) -> Array:
                return np.array(scene.acceleration(world, gravity, tau, rate, x))

            self.q, self.v = self.stages.move(Tick(self.q, self.v, acceleration, cell.tick))
            self.ticks += 1
            out[i] = self.q
            if not abs(self.v[0]) + abs(self.v[1]) < RUNAWAY:
                raise Stopped("the arm ran away")

    def _drive(self, references: Array, noise: Array, out: Array) -> None:
        """Play all ticks at once: the law and the integrator are compiled into one loop."""
        assert self.engine.drive is not None
        self.bench.tick = self.ticks
        self.q, self.v, self.queue, spent = self.engine.drive(self, references, noise, out)
        self.ticks += len(references)
        for stage, seconds in spent.items():
            self.bench.seconds[stage] += seconds
        if not abs(self.v[0]) + abs(self.v[1]) < RUNAWAY:
            raise Stopped("the arm ran away")

    def _watch(self, positions: Array) -> None:
        """Note the clearance of the motion, and stop at a collision."""
        if self.filmed:
            self.log.extend(positions[::4])
        gaps = self.engine.clearance(self.world.lengths, self.posts, positions[::2])
        self.closest = min(self.closest, float(np.min(gaps, initial=math.inf)))
        if self.closest <= 0.0:
            raise Stopped("the arm touched a post")

    def hold(self, ticks: int) -> None:
        """Stay at the reference."""
        zero = np.zeros((ticks, 2))
        self.follow(np.tile(self.reference, (ticks, 1)), zero, zero, hold=True)

    def encoder(self) -> Array:
        """Return the joint angles as the encoders read them on average, shape (2,) [rad]."""
        return np.asarray(self.q + self.world.bias)

    def tip(self) -> Array:
        """Return where the tip really is, shape (2,) [m]."""
        return tip_of(self.world.lengths, self.q)


class Observation(NamedTuple):
    """An image after perception.

    Attributes:
        captured, arrived: [s].
        position: of the part as perceived, shape (2,) [m].
        truth: of the part then, shape (2,) [m].
        tip: as the camera measures it then, shape (2,) [m].
        tip_truth: where it was, shape (2,) [m].
    """

    captured: float
    arrived: float
    position: Array
    truth: Array
    tip: Array
    tip_truth: Array


class Tracker:
    """The camera's computer: perception, and a Kalman filter whose states go onto the bus."""

    def __init__(self, level: Level, arm: Arm) -> None:
        self.level, self.arm = level, arm
        self.frames = 0
        self.observations: list[Observation] = []
        self.states: list[Array] = []
        self.covariances: list[Array] = []
        # A belt that stands still is known to stand still.
        rate = 0.05 if level.speed else 1e-4
        self.state, self.covariance = np.zeros(4), np.diag([1.0, 1.0, rate**2, rate**2])
        self.last = 0.0

    def observe(self) -> None:
        """Take an image now; its message arrives later, or never."""
        cell, level, task, arm = self.arm.cell, self.level, self.arm.task, self.arm
        number, now = self.frames, arm.now
        self.frames += 1
        arm.bench.tick = arm.ticks
        depth = arm.engine.render(cell, level, task, number, now)
        latency = scene.make_latency(level, task, number)
        if not math.isfinite(latency):
            return
        triples = scene.triples(cell, task, number)
        sighting = arm.stages.perceive(Image(depth, now, triples, level.noise))
        if sighting is None:
            return
        truth = task.at(now)
        # The calibration's error shifts all that the camera measures: the part and the tip.
        tip = arm.tip() - task.offset + scene.marker_noise(level, task, number)
        self._update(sighting.position, now)
        one = Observation(now, now + latency, sighting.position, truth, tip, arm.tip())
        self.observations.append(one)

    def _update(self, position: Array, now: float) -> None:
        age, self.last = now - self.last, now
        F = np.eye(4)
        F[0, 2] = F[1, 3] = age
        state, P = F @ self.state, F @ self.covariance @ F.T
        if self.level.speed:
            # White noise of the acceleration, the same along x and y.
            for i in (0, 1):
                P[i, i] += DRIFT * age**3 / 3.0
                P[i, i + 2] += DRIFT * age**2 / 2.0
                P[i + 2, i] += DRIFT * age**2 / 2.0
                P[i + 2, i + 2] += DRIFT * age
        # A centimetre of noise per pixel would still give a millimetre in the pose.
        S = P[:2, :2] + (0.5 * self.level.noise + 1e-5) ** 2 * np.eye(2)
        K = np.linalg.solve(S, P[:2]).T
        self.state = state + K @ (position - state[:2])
        P = P - K @ P[:2]
        self.covariance = 0.5 * (P + P.T)
        self.states.append(self.state)
        self.covariances.append(self.covariance)

    def messages(self) -> Messages | None:
        """Return all messages that have been sent, or None before the first has arrived."""
        now = self.arm.now
        if not any(one.arrived <= now + 1e-9 for one in self.observations):
            return None
        captured = np.array([one.captured for one in self.observations])
        arrived = np.array([one.arrived for one in self.observations])
        noise = DRIFT if self.level.speed else 0.0
        states, covariances = np.array(self.states), np.array(self.covariances)
        return Messages(states, covariances, captured, arrived, now + 1e-9, noise)

    def newest(self) -> Observation | None:
        """Return the image captured last among those that have arrived."""
        now = self.arm.now
        here = [one for one in self.observations if one.arrived <= now + 1e-9]
        return max(here, key=lambda one: one.captured, default=None)


def run_task(
    cell: Cell,
    world: World,
    level: Level,
    stages: Stages,
    bench: Bench,
    task: Task,
    filmed: bool = False,
    engine: Engine = PLAIN,
) -> Outcome:
    """Play one task.

    Args:
        cell: what the robot believes.
        world: the arm as it is.
        level: noise, latency and so on.
        stages: the robot.
        bench: its parts, for times, failures and broken promises.
        task: one part.
        filmed: whether to record the motion for an animation.
        engine: what computes the world; compiled for a robot of known parts.

    Returns:
        Plain data: "success", "why" (empty for a success), "seconds" of the cycle, "error" of the
        placed part [m], "moments" of grip and release [s], "budget" (rows of `STAGES`, columns x
        and y) [m], which adds up to the error, "processor" of each stage [s], "closest" clearance
        [m], "signals" (rows of `SIGNALS`) [m], "failure", "breaches", "log".
    """
    bench.begin(task.number)
    begun = time.perf_counter()
    outcome: Outcome = {
        "task": task.number,
        "success": False,
        "why": "",
        "seconds": math.inf,
        "error": [math.nan, math.nan],
        "grasp": [math.nan, math.nan],
        "budget": [[math.nan, math.nan] for _ in STAGES],
        "moments": [math.nan, math.nan],
        "signals": [[math.nan, math.nan] for _ in SIGNALS],
        "closest": math.inf,
        "failure": None,
    }
    arm = None
    try:
        arm = Arm(cell, world, stages, bench, task, filmed, engine)
        _play(arm, level, outcome)
    except Stopped as stop:
        outcome["why"] = str(stop)
    except PartFailed as failed:
        outcome["why"] = f"{failed.failure.part} {failed.failure.kind}"
        outcome["failure"] = list(failed.failure)
    outcome["success"] = not outcome["why"]
    outcome["breaches"] = [list(one) for one in bench.breaches.values()]
    outcome["processor"] = [bench.seconds[stage] for stage in STAGES]
    outcome["wall"] = time.perf_counter() - begun
    if arm is not None:
        outcome["closest"] = arm.closest
        outcome["log"] = [q.tolist() for q in arm.log]
    return outcome


def _play(arm: Arm, level: Level, outcome: Outcome) -> None:
    cell, task, stages = arm.cell, arm.task, arm.stages
    tracker = Tracker(level, arm)
    # 1. Look, until enough images have arrived.
    looks = LOOKS[level.speed > 0.0]
    for _ in range(40):
        tracker.observe()
        arm.hold(cell.frame)
        if sum(one.arrived <= arm.now for one in tracker.observations) >= looks:
            break
    # 2. Plan to where the part will be on arrival: the second plan knows how long the first takes.
    messages = tracker.messages()
    if messages is None:
        raise Stopped("perception never saw the part")
    shadow = scene.shadows(task.free)
    ahead = 0.0
    for attempt in range(1 if level.speed == 0.0 else 3):
        estimate = stages.estimate(messages)
        target = estimate.position + ahead * estimate.velocity
        motion, _ = plan_to(arm, target, shadow, attempt)
        if abs(motion.duration - ahead) < 0.02:
            break
        ahead = motion.duration
    # 3. Move. The camera starts again shortly before the arrival.
    late = round(level.latency / cell.tick) + 4 * cell.frame
    pause = max(0, len(motion.q) - late) if level.speed else len(motion.q)
    _advance(arm, tracker, motion, pause)
    arm.reference = motion.waypoints[-1].copy()
    # 4. Track: correct a fraction of the observed error in each frame.
    perceived, command = _track(arm, tracker, level)
    # 5. Grip.
    tip, part = arm.tip(), task.at(arm.now)
    grasp = tip - part
    outcome["grasp"] = grasp.tolist()
    grip = _shares(arm, grasp, perceived, command - part)
    aimed, measured = tip_of(cell.lengths, arm.reference), tip_of(cell.lengths, arm.encoder())
    signals = [part, part + perceived, command, aimed, measured, tip]
    outcome["signals"][:6] = [x.tolist() for x in signals]
    if math.hypot(*grasp) > cell.cup:
        raise Stopped("the gripper missed the part")
    carried = part - tip
    outcome["moments"][0] = arm.now
    arm.hold(CLOSE)
    # 6. Plan and move to the slot.
    motion, goal = plan_to(arm, task.slot, shadow, 7)
    arm.follow(motion.q, motion.v, motion.a)
    arm.reference = motion.waypoints[-1].copy()
    arm.hold(SETTLE + CLOSE)
    # 7. Let go: the part falls a little, and slides until friction stops it.
    tip, rate = arm.tip(), tip_rate(arm.world.lengths, arm.q, arm.v)
    start = np.array([-(tip + carried)[1], cell.drop])
    rest = stages.release(Release(start, np.array([-rate[1], 0.0]), cell.tilt, cell.mu))
    slide = np.array([0.0, -(rest[0] - start[0])])
    error = tip + carried + slide - task.slot
    outcome["error"] = error.tolist()
    outcome["seconds"] = outcome["moments"][1] = arm.now
    # The part is off by what the grasp was off, the other way round, and by what came after it.
    place = dict.fromkeys(STAGES, np.zeros(2))
    believed, aimed = tip_of(cell.lengths, arm.encoder()), tip_of(cell.lengths, arm.reference)
    signals = [task.slot, goal, aimed, believed, tip, tip + carried + slide]
    outcome["signals"][6:] = [x.tolist() for x in signals]
    place["kinematics"] = goal - task.slot
    place["planning"] = aimed - goal
    place["control"] = believed - aimed
    place["physics"] = tip - believed + slide
    outcome["budget"] = [(place[stage] - grip[stage]).tolist() for stage in STAGES]
    if not math.hypot(*error) <= cell.tolerance:
        raise Stopped("the part is beside its slot")
    if arm.now > cell.seconds:
        raise Stopped("the cycle took too long")


def _advance(arm: Arm, tracker: Tracker, motion: Motion, pause: int) -> None:
    """Follow a motion; take images after a pause."""
    frame = arm.cell.frame
    arm.follow(motion.q[:pause], motion.v[:pause], motion.a[:pause])
    for i in range(pause, len(motion.q), frame):
        tracker.observe()
        arm.follow(motion.q[i : i + frame], motion.v[i : i + frame], motion.a[i : i + frame])


def _shares(arm: Arm, grasp: Array, perceived: Array, commanded: Array) -> dict[str, Array]:
    """Return which stage owns how much of the grasp error; the parts add up to it."""
    shares = dict.fromkeys(STAGES, np.zeros(2))
    lengths = arm.cell.lengths
    aimed, believed = tip_of(lengths, arm.reference), tip_of(lengths, arm.encoder())
    part = arm.tip() - grasp
    shares["perception"] = perceived
    shares["estimation"] = commanded - perceived
    shares["kinematics"] = aimed - (commanded + part)
    shares["control"] = believed - aimed
    shares["physics"] = arm.tip() - believed
    return shares


def plan_to(arm: Arm, target: Array, shadow: Array, attempt: int) -> tuple[Motion, Array]:
    """Return a motion from the reference to a position of the tip, and the tip at its goal [m].

    Raises:
        Stopped: if there is none.
    """
    cell, task = arm.cell, arm.task
    arm.bench.tick = arm.ticks
    rng = scene.stream(task.seed, task.number, scene.PLANNER, attempt)
    samples = np.column_stack(
        (rng.uniform(-math.pi, math.pi, 400), rng.uniform(-scene.ELBOW, scene.ELBOW, 400))
    )
    posts = task.posts + np.array([0.0, 0.0, cell.width + PLANNED])
    goals = np.asarray(arm.stages.reach(Reach(np.array(target))), dtype=float)
    draws = rng.random((30, 2))
    route = Route(arm.reference.copy(), goals, posts, shadow, samples, draws, 0.4)
    motion = arm.stages.plan(route)
    if len(motion.waypoints) < 2 or not len(motion.q):
        raise Stopped("the planner found no way")
    # Of the postures that reach the position, the one that the planner chose.
    turns = goals - motion.waypoints[-1]
    chosen = int(np.argmin(np.hypot(*(np.remainder(turns + math.pi, math.tau) - math.pi).T)))
    return motion, tip_of(cell.lengths, goals[chosen])


def _track(arm: Arm, tracker: Tracker, level: Level) -> tuple[Array, Array]:
    """Correct the tip with fresh images, a fraction of the observed error in each frame.

    Returns:
        Mean error of perception while tracking, relative to the tip; commanded tip at the end,
        each shape (2,) [m].
    """
    cell, stages = arm.cell, arm.stages
    period = cell.frame * cell.tick
    delay = math.ceil((level.latency + 0.5 * level.jitter) / period - 1e-9)
    offset = max(level.offset, 1e-3)
    gain = stages.choose_gain(Loop(delay, max(0.5 * level.noise, 1e-6), offset, TRACK))
    began = arm.now
    command = tip_of(cell.lengths, arm.reference)
    errors: list[Array] = []
    shares = (np.arange(cell.frame) / cell.frame)[:, None]
    for _ in range(TRACK):
        tracker.observe()
        newest, messages = tracker.newest(), tracker.messages()
        velocity = np.zeros(2)
        if newest is not None and messages is not None:
            arm.bench.tick = arm.ticks
            estimate = stages.estimate(messages)
            velocity = estimate.velocity
            # Both at the present: the part by estimation, the tip by the feedforward since then.
            tip = newest.tip + (arm.now - newest.captured) * velocity
            # An image from before shows the tip on its way here.
            if newest.captured >= began - 1e-9:
                command = command + gain * (estimate.position - tip)
            errors.append(newest.position - newest.truth - (newest.tip - newest.tip_truth))
        command = command + period * velocity
        believed = tip_of(cell.lengths, arm.reference)
        step = stages.correct(Correction(arm.reference.copy(), command - believed, DAMPING))
        start, end = arm.reference, arm.reference + step
        rates = np.tile(step / period, (cell.frame, 1))
        arm.follow(start + shares * step, rates, np.zeros((cell.frame, 2)))
        arm.reference = end
    return np.mean(errors, axis=0) if errors else np.zeros(2), command
