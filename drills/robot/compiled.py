"""The course's parts and the world around them, compiled, as the engine of a robot.

A robot without a part of the learner's needs no sandbox. Its parts are then the compiled functions
of chapters 1 to 11 in `course.pipeline.robot_parts`, and so are the camera and the clearances. The
same 200 tasks take seconds.
"""

from __future__ import annotations

import functools
import math
import time
from typing import TYPE_CHECKING

import numpy as np

from course.pipeline.robot_parts import (
    FUNCTIONS,
    arm_column,
    clearance,
    command_arm,
    drive_arm,
    friction_rows,
    nearest,
    on_a_face,
    render_depths,
)
from drills.robot import cell as scene
from drills.robot.cell import Level, Task
from drills.robot.engine import Engine
from drills.robot.parts import load_part
from drills.robot.records import Array, Cell
from drills.robot.slots import COURSE, YOURS, Part

if TYPE_CHECKING:
    from drills.robot.loop import Arm

# The cost of one tick is measured over this many, to split the time of a motion among two stages.
_TICKS = 2000


def render(cell: Cell, level: Level, task: Task, frame: int, seconds: float) -> Array:
    """Return what `cell.render` returns."""
    rays, eye = scene.rays_of(cell), scene.eye_of(cell, task)
    bodies = scene.bodies_of(cell, task, seconds)
    planes = np.array([faces for *_, faces in bodies])
    poses = np.empty((len(bodies), 5))
    for row, (x, y, turn, faces) in zip(poses, bodies, strict=True):
        # No body is wider than its bottom, which lies at z = 0.
        half = faces[2, 3] / faces[2, 0], faces[3, 3] / faces[3, 1]
        row[:] = x, y, math.cos(turn), math.sin(turn), math.hypot(*half) + 1e-6
    depth = np.full(rays.shape[1], eye[2]) / -rays[2]
    render_depths(rays, eye, poses, planes, depth)
    return scene.sense(cell, level, task, frame, depth)


@functools.cache
def _share_of_the_law() -> float:
    """Return the share of a tick's time that the control law takes, measured once."""
    cell = Cell()
    model = arm_column(cell.lengths, cell.masses, (0.0, 0.0), 0.0, cell.gravity)
    references, out = np.zeros((_TICKS, 3, 2)), np.empty((_TICKS, 2))
    gains, limits, nothing = np.ones((2, 2)), np.array(cell.torques), np.zeros((0, 2))
    known = friction_rows(cell.coulomb, cell.viscous, cell.transition)
    state, noise = np.zeros((4, 1)), np.zeros((_TICKS, 2))
    for _ in range(2):
        begun = time.perf_counter()
        command_arm(model, known, gains, references, out)
        law = time.perf_counter()
        drive_arm(
            model,
            known,
            model,
            known,
            1.0,
            gains,
            limits,
            cell.tick,
            references,
            noise,
            state,
            nothing,
            out,
        )
        end = time.perf_counter()
    return min((law - begun) / (end - law), 0.9)


def drive(
    arm: Arm, references: Array, noise: Array, out: Array
) -> tuple[Array, Array, list[Array], dict[str, float]]:
    """Play the ticks of a motion in one compiled loop.

    Control is computed torque with friction compensation, physics is velocity Verlet.

    Args:
        arm: at its start; it is not changed.
        references: angles, rates and accelerations of each tick, shape (n, 3, 2).
        noise: errors of the encoders, shape (n, 2) [rad].
        out: receives the angles after each tick, shape (n, 2) [rad].

    Returns:
        Angles and rates at the end, each shape (2,); torques on their way; the time that the stages
        "control" and "physics" took [s].
    """
    cell, world = arm.cell, arm.world
    model = arm_column(cell.lengths, cell.masses, (0.0, 0.0), 0.0, cell.gravity)
    body = arm_column(world.lengths, world.masses, world.damping, world.payload, cell.gravity)
    known = friction_rows(cell.coulomb, cell.viscous, cell.transition)
    dry = friction_rows(world.coulomb, (0.0, 0.0), world.transition)
    state = np.concatenate((arm.q, arm.v))[:, None]
    queue = np.array(arm.queue).reshape(len(arm.queue), 2)
    begun = time.perf_counter()
    drive_arm(
        model,
        known,
        body,
        dry,
        world.motor,
        np.array((arm.kp, arm.kd)),
        np.array(cell.torques),
        cell.tick,
        np.ascontiguousarray(references),
        noise,
        state,
        queue,
        out,
    )
    spent = time.perf_counter() - begun
    if len(queue):
        queue = np.roll(queue, -(len(references) % len(queue)), axis=0)
    law = spent * _share_of_the_law()
    times = {"control": law, "physics": spent - law}
    return state[:2, 0].copy(), state[2:, 0].copy(), list(queue), times


DRIVEN = ("computed_torque", "rnea_planar", "friction_torque", "verlet")


def engine_of(parts: list[Part]) -> Engine:
    """Return the engine for parts of the course and of libraries.

    Raises:
        ValueError: for a part of the learner's, which belongs into the sandbox.
        PartFailed: for a part that can't be loaded.
    """
    own = [part.slot for part in parts if part.holder == YOURS]
    if own:
        raise ValueError(f"parts must be the course's or a library's, got your {', '.join(own)}")
    held = {part.slot: part for part in parts if part.holder == COURSE}
    functions = {name: FUNCTIONS.get(name) or load_part(part) for name, part in held.items()}
    whole = all(name in held for name in DRIVEN)
    return Engine(functions, render, clearance, nearest, on_a_face, drive if whole else None)


def warm() -> None:
    """Compile every loop of this module and of the chapters it calls, by playing one task."""
    from drills.robot.holders import course_part
    from drills.robot.inside import Robot
    from drills.robot.levels import exact_world, level
    from drills.robot.slots import NAMES

    parts = [course_part(name) for name in NAMES]
    robot = Robot(parts, level(5), exact_world(), 0, 0.0, engine=engine_of(parts))
    robot.play(0)
