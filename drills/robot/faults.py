"""Faults for level 6: each wraps one stage of a robot. No part fails, but the log shows it."""

from __future__ import annotations

import math

import numpy as np

from drills.robot.records import (
    Array,
    Command,
    Correction,
    Estimate,
    Image,
    Messages,
    Motion,
    Release,
    Route,
    Sighting,
    Stages,
)

SIZE = 0.006  # m, how much a fault adds to the error


def with_fault(stages: Stages, stage: str, direction: float) -> Stages:
    """Return the robot with a fault in one stage.

    Args:
        stages: the healthy robot.
        stage: one of `drills.robot.slots.STAGES`.
        direction: of the error it causes, where it has one [rad].
    """
    offset = SIZE * np.array([math.cos(direction), math.sin(direction)])

    def perceive(image: Image) -> Sighting | None:
        sighting = stages.perceive(image)
        return sighting and sighting._replace(position=sighting.position + offset)

    def estimate(messages: Messages) -> Estimate:
        estimate = stages.estimate(messages)
        return estimate._replace(position=estimate.position - offset)

    def correct(correction: Correction) -> Array:
        # As if the second link were shorter than it is.
        return 0.35 * stages.correct(correction._replace(error=correction.error - 0.5 * offset))

    def plan(route: Route) -> Motion:
        motion = stages.plan(route)
        if len(motion.waypoints) < 2:
            return motion
        # The path ends short of its goal.
        short, start = 0.994, motion.waypoints[0]
        return motion._replace(
            waypoints=start + short * (motion.waypoints - start),
            q=start + short * (motion.q - start),
            v=short * motion.v,
            a=short * motion.a,
        )

    def control(command: Command) -> Array:
        return np.asarray(
            stages.control(command) + np.array([3.0, -1.0]) * math.copysign(1.0, offset[0])
        )

    def release(part: Release) -> Array:
        # A table with less friction.
        return stages.release(part._replace(mu=0.38, velocity=part.velocity + np.array([0.1, 0.0])))

    match stage:
        case "perception":
            return stages._replace(perceive=perceive)
        case "estimation":
            return stages._replace(estimate=estimate)
        case "kinematics":
            return stages._replace(correct=correct)
        case "planning":
            return stages._replace(plan=plan)
        case "control":
            return stages._replace(control=control)
        case "physics":
            return stages._replace(release=release)
    raise ValueError(f"stage must be a stage of the robot, got {stage!r}")
