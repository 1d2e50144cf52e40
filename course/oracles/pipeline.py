"""Real libraries in the places of the pipeline's stages: `Stages` with one of them, or with all.

Open3D finds the part in a picture, MuJoCo's rays take the picture, OMPL plans, Pinocchio's inverse
dynamics command, MuJoCo moves. Each is called as the course's own stage is, so none of them knows
of the others.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.kinematics import TwoLink
from course.oracles import ompl, open3d, pinocchio
from course.oracles.mujoco import camera as rays
from course.oracles.mujoco import chain, kit
from course.perception import Camera, Sensor, Shapes
from course.pipeline import Path, Scenario, Settings, Stages, plan_path
from course.pipeline.eye import NOTHING, Eye
from course.planning import World

Array = NDArray[np.float64]


# --- perceive -------------------------------------------------------------------------------------


@functools.cache
def _model(radius: float, spacing: float = 0.004) -> open3d.Cloud:
    """Return the upper half of a ball about the origin, as points with normals.

    The camera looks along -z.
    """
    n = round(2.0 * math.pi * radius**2 / spacing**2)
    height, turn = (np.arange(n) + 0.5) / n, math.pi * (1.0 + math.sqrt(5.0)) * np.arange(n)
    wide = np.sqrt(1.0 - height**2)
    normals = np.stack((wide * np.cos(turn), wide * np.sin(turn), -height))
    cloud = open3d.Cloud(radius * normals)
    cloud.set_normals(normals)
    return cloud


def find(
    depth: Array, camera: Camera, sensor: Sensor, part: Shapes, table: Array
) -> tuple[Array, Array]:
    """Return a ball's place (2,) and its covariance (2, 2), as `course.pipeline.eye.find` does.

    What one writes with Open3D: a cloud, the known table taken off, clusters, point-to-plane
    registration of each to a model. The covariance is that of as many measurements as the noise,
    which neighbours share over a window, leaves independent.
    """
    radius, best = float(part.sizes[0, 0]), (0.0, np.zeros(7), NOTHING)
    points = open3d.Picture(depth, camera).points()
    noise = float(sensor.sigma(float(table[3]), camera))
    above = open3d.Cloud(points[:, table[:3] @ points + table[3] > 3.0 * noise])
    points = above.array(above.handle)
    labels = above.dbscan(max(0.015, 2.0 * noise), 10)
    for some in (points[:, labels == label] for label in range(labels.max(initial=-1) + 1)):
        if some.shape[1] < 40:
            continue
        start = np.array([*-some.mean(axis=1)[:2], radius - table[3], 1.0, 0.0, 0.0, 0.0])
        # The picture moves onto the model, whose normals are exact.
        fit = open3d.Cloud(some).icp(_model(radius), start, 0.5 * radius, to_plane=True)
        if fit.matched > max(0.7, best[0]):
            spread = fit.residual**2 * sensor.window**2 / some.shape[1] * np.eye(2)
            best = fit.matched, fit.pose, spread
    place = -open3d.matrix(best[1])[:3, :3].T @ best[1][:3] if best[0] else np.zeros(3)
    return place[:2], best[2]


def picture(shapes: Shapes, camera: Camera) -> Array:
    """Return the exact depth picture (H, W) by MuJoCo's rays [m]."""
    return rays.Rays(shapes, camera).picture()[0]


# --- plan, control, move --------------------------------------------------------------------------


def _search(
    world: World, start: Array, goal: Array, settings: Settings, rng: np.random.Generator
) -> tuple[Array | None, int, str]:
    state, edge = ompl.tests(world)
    result = ompl.solve(
        world.bounds,
        start,
        goal,
        "rrt_connect",
        settings.step,
        settings.samples,
        int(rng.integers(1, 2**31)),
        state,
        edge,
    )
    path = None if result.path is None else np.ascontiguousarray(result.path.T)
    return path, result.checks + result.state_checks, "solved" if path is not None else "unsolved"


def plan(
    start: Array, goal: Array, scenario: Scenario, settings: Settings, rng: np.random.Generator
) -> Path:
    """Plan like `course.pipeline.plan_path`, with waypoints from OMPL's RRT-Connect."""
    return plan_path(start, goal, scenario, settings, rng, _search)


@functools.lru_cache(maxsize=16)
def _pinocchio(arm: TwoLink) -> pinocchio.Arm:
    return pinocchio.Arm(arm.chain(), (0.0, -arm.gravity, 0.0))


def control(q: Array, v: Array, desired: Array, scenario: Scenario, settings: Settings) -> Array:
    """Return computed torque by Pinocchio's recursive Newton-Euler, (2,) [N m]."""
    a = desired[2] + settings.kp * (desired[0] - q) + settings.kd * (desired[1] - v)
    return _pinocchio(scenario.arm).inverse_dynamics(q, v, a)


@functools.lru_cache(maxsize=16)
def _mujoco(arm: TwoLink, integrator: str) -> tuple[Any, Any, Any]:
    mujoco = kit.library()
    model = chain.model(arm.chain(), (0.0, -arm.gravity, 0.0))
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    return mujoco.mj_step, model, mujoco.MjData(model)


def move(
    q: Array, v: Array, tau: Array, dt: float, scenario: Scenario, integrator: str = "EULER"
) -> tuple[Array, Array]:
    """Return the state after a step by `mj_step`.

    MuJoCo's Euler takes the joints' damping implicitly.
    """
    step, model, data = _mujoco(scenario.plant, integrator)
    model.opt.timestep = dt
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
    step(model, data)
    return data.qpos.copy(), data.qvel.copy()


def swaps(eye: Eye) -> dict[str, tuple[Stages, Stages]]:
    """Name -> the pipeline with a library in one place, and that with the course's own there.

    Args:
        eye: with which both take pictures where perception is what differs.
    """
    ours, cast = Stages(), replace(eye, picture=picture)
    every = Stages(replace(cast, find=find), plan, control, move)
    return {
        "Open3D perceives": (Stages(perceive=replace(eye, find=find)), Stages(perceive=eye)),
        "MuJoCo's rays": (Stages(perceive=cast), Stages(perceive=eye)),
        "OMPL plans": (Stages(plan=plan), ours),
        "Pinocchio commands": (Stages(control=control), ours),
        "MuJoCo moves": (Stages(move=move), ours),
        "all of them": (every, Stages(perceive=eye)),
    }
