"""The six stages, built from parts: adapters between a stage's records and an exercise's arguments.

A stage of your own replaces one of these functions; `records.Stages` says what goes in and out.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from drills.robot.engine import PLAIN, Engine
from drills.robot.parts import Bench
from drills.robot.records import (
    Array,
    Cell,
    Command,
    Correction,
    Estimate,
    Image,
    Loop,
    Messages,
    Motion,
    Reach,
    Release,
    Route,
    Sighting,
    Stages,
    Tick,
)

TABLE = 0.006  # m, tolerance of the table's plane without noise
EPS = 0.022  # m, distance of neighbours in a cluster
LEAST = 4  # neighbours of a core point
POINTS = 130  # largest number of points above the table that are clustered
CREASE = 0.005  # m, points nearer to an edge of the part do not enter the pose
GAINS = tuple(np.round(np.linspace(0.05, 1.0, 20), 3).tolist())  # that the tracker may choose
# Cost of the joint loops: of angle and rate, and of the acceleration that corrects them.
STATE_COST = ((90_000.0, 300.0), (300.0, 90.0))
COMMAND_COST = 1.5


def build(cell: Cell, bench: Bench, engine: Engine = PLAIN) -> Stages:
    """Return the stages that call the parts of a bench.

    Args:
        cell: what the robot's programs believe.
        bench: with a part for each slot, or for a whole stage.
        engine: what computes the adapters' own arithmetic.
    """
    model, normals, spare = part_model(cell)

    def perceive(image: Image) -> Sighting | None:
        points = bench.call("back_project", image.depth, *cell.focal, *cell.axis, cell.unit)
        if points.shape[1] < 100:
            return None
        # The table: on every third point, so that a plain loop over points stays fast.
        thin = points[:, ::3].copy()
        tolerance = TABLE + 2.5 * image.noise
        tries = image.triples % thin.shape[1]
        plane, _, _ = bench.call("plane_ransac", thin, tries, tolerance, 0.999)
        height = plane[:3] @ points + plane[3]
        height *= 1.0 if plane[3] > 0.0 else -1.0  # the camera is above the table
        above = points[:, height > TABLE + 4.0 * image.noise]
        tall = height[height > TABLE + 4.0 * image.noise]
        # The tallest part comes first: of too many points every second one stays.
        every = 1 + above.shape[1] // POINTS
        above, tall = above[:, ::every].copy(), tall[::every]
        if above.shape[1] < 2 * LEAST:
            return None
        labels = bench.call("dbscan", above, EPS * math.sqrt(every), LEAST)
        # Into the base, with the height above the plane that was found.
        R = np.array(cell.turn).reshape(3, 3)
        cloud = R @ above + np.array(cell.camera)[:, None]
        cloud[2] = tall
        cluster = _of_the_part(cell, cloud, labels)
        if cluster is None:
            return None
        return _pose(cluster)

    def _pose(cloud: Array) -> Sighting:
        middle = cloud[:2].mean(axis=1)
        xx, xy, yy = _spread(cloud)
        # Along the direction of the largest variance.
        R = _about_z(0.5 * math.atan2(2.0 * xy, xx - yy))
        p = np.append(middle, 0.0)
        # Low points are close to the table, where the cluster may have lost some.
        weights = np.where(cloud[2] > 0.4 * cell.height, 1.0, 0.5)
        # Point to point first: robust far away, slow near by.
        for _ in range(2):
            source = engine.nearest(R.T @ (cloud - p[:, None]), model)
            R, p = bench.call("rigid_fit", source, cloud, weights)
            R, p = _flat(R, p)
        # Point to plane near by, without what lies on an edge.
        for _ in range(3):
            inside = R.T @ (cloud - p[:, None])
            inside = inside[:, engine.on_a_face(inside, model, spare, CREASE)]
            if inside.shape[1] < 8:
                break
            dR, dp = bench.call("point_to_plane_step", inside, model, normals)
            # The step moves the points onto the model: the part moves the other way.
            R, p = R @ dR.T, p - R @ dR.T @ dp
        heading = math.remainder(math.atan2(R[1, 0], R[0, 0]), math.pi)
        return Sighting(p[:2].copy(), heading, cloud.shape[1])

    def estimate(messages: Messages) -> Estimate:
        state, covariance = bench.call(
            "to_the_present",
            messages.states.copy(),
            messages.covariances.copy(),
            messages.captured.copy(),
            messages.arrived.copy(),
            messages.now,
            messages.noise,
        )
        return Estimate(state[:2], state[2:], covariance)

    def choose_gain(loop: Loop) -> float:
        # What is left of the offset, and what the noise adds.
        best, chosen = math.inf, 0.0
        for gain in GAINS:
            limit, variance = bench.call("visual_gain", gain, loop.delay)
            # Half of the limit: beyond it the correction oscillates.
            if variance < 0.0 or gain > 0.5 * limit:
                continue
            remaining = loop.offset * math.exp(-gain * (loop.frames - loop.delay))
            cost = variance * loop.noise**2 + remaining**2
            if cost < best:
                best, chosen = cost, gain
        return chosen

    def reach(request: Reach) -> Array:
        l1, l2 = cell.lengths
        # Inside the ring that the arm reaches, whatever the stages before have said.
        distance = math.hypot(*request.target)
        inner, outer = abs(l1 - l2) + 1e-3, l1 + l2 - 1e-3
        inside = min(max(distance, inner), outer) / max(distance, 1e-9)
        return np.asarray(
            bench.call("two_link_ik", np.array(cell.lengths), inside * request.target)
        )

    placements = np.stack((np.eye(4), np.eye(4)))
    placements[1, 0, 3] = cell.lengths[0]
    tool = np.array([cell.lengths[1], 0.0, 0.0])

    def correct(request: Correction) -> Array:
        J = bench.call("jacobian", placements.copy(), request.q.copy(), tool.copy())[:2]
        return np.asarray(bench.call("damped_step", J, request.error.copy(), request.damping))

    def plan(route: Route) -> Motion:
        posts = route.posts
        goals = [np.array([math.remainder(g[0], math.tau), g[1]]) for g in route.goals]
        goals.sort(key=lambda g: float(np.max(np.abs(g - route.start) / cell.rates)))

        def is_free(path: Array) -> bool:
            return all(
                bench.call("edge_check", np.array(cell.lengths), posts, a.copy(), b.copy()) >= 1.0
                for a, b in itertools.pairwise(path)
            )

        for goal in goals:
            straight = np.array([route.start, goal])
            if is_free(straight):
                return timed(straight)
        for part in np.array_split(route.samples, 2):
            for goal in goals:
                path, _ = bench.call(
                    "rrt_connect", route.start.copy(), goal, route.shadows, part, route.step
                )
                if len(path) < 2:
                    continue
                path = bench.call("shortcut", path, route.shadows, route.draws)
                if is_free(path):
                    return timed(path)
        nothing = np.zeros((0, 2))
        return Motion(nothing, 0.0, nothing, nothing, nothing)

    def timed(path: Array) -> Motion:
        rates, limits = np.array(cell.rates), np.array(cell.accelerations)
        qs, vs, accelerations, total = [], [], [], 0.0
        for a, b in itertools.pairwise(path):
            duration, _, _ = bench.call("trapezoid", a, b, rates, limits, np.zeros(1))
            n = max(1, math.ceil(min(max(duration, 0.0), 20.0) / cell.tick - 1e-9))
            times = cell.tick * np.arange(n + 1)
            _, q, v = bench.call("trapezoid", a, b, rates, limits, times)
            qs.append(q[:, :-1].T)
            vs.append(v[:, :-1].T)
            accelerations.append(np.diff(v, axis=1).T / cell.tick)
            total += n * cell.tick
        return Motion(path, total, np.vstack(qs), np.vstack(vs), np.vstack(accelerations))

    def gains(period: float) -> tuple[Array, Array]:
        A, B = np.array([[1.0, period], [0.0, 1.0]]), np.array([[0.5 * period**2], [period]])
        K = bench.call("lqr", A, B, np.array(STATE_COST), np.array([[COMMAND_COST]]))
        return np.full(2, K[0, 0]), np.full(2, K[0, 1])

    lengths, masses = np.array(cell.lengths), np.array(cell.masses)
    coulomb, viscous = np.array(cell.coulomb), np.array(cell.viscous)
    gravity = cell.gravity

    def control(command: Command) -> Array:
        q, v, reference, kp, kd, hold = command
        # Feed-forward at the rates of the reference: near rest, the sign of a measured rate
        # changes with every disturbance, and the torque with it.
        friction = bench.call(
            "friction_torque", reference[1].copy(), coulomb, viscous, cell.transition
        )
        if not hold:
            arguments = (lengths, masses, gravity, q, v, reference, kp, kd)
            return np.asarray(bench.call("computed_torque", *arguments) + friction)
        # Inverse dynamics of the acceleration that brings the arm back to rest where it was.
        back = kp * (reference[0] - q) - kd * v
        torque = bench.call("rnea_planar", lengths, masses, q, v, back, gravity)
        return np.asarray(torque + friction)

    def move(tick: Tick) -> tuple[Array, Array]:
        q, v, acceleration, step = tick
        q, v, _ = bench.call("verlet", q, v, acceleration(q), acceleration, step)
        return q, v

    def release(part: Release) -> Array:
        position, velocity = part.position.copy(), part.velocity.copy()
        arguments = (position, velocity, part.slope, part.mu, 1e-3, 300)
        return np.asarray(bench.call("contact_step", *arguments)[0])

    return Stages(
        perceive, estimate, choose_gain, reach, correct, plan, gains, control, move, release
    )


def part_model(cell: Cell) -> tuple[Array, Array, Array]:
    """Return points on the visible faces of the part, their normals, and the face of each.

    Returns:
        Points (3, k) [m] and unit normals (3, k) in the part's frame, face numbers (k,).
    """
    (a, b), (c, d), height = cell.base, cell.top, cell.height
    # Inside of each face, so that no sample belongs to two.
    shares = np.linspace(0.07, 0.93, 7)
    s, t = (x.ravel() for x in np.meshgrid(2.0 * shares - 1.0, shares))
    points, normals, faces = [], [], []
    across, along = b + t * (d - b), a + t * (c - a)
    for face, sign in enumerate((1.0, -1.0)):
        # Slopes at both ends, then along both sides.
        points.append(np.array([sign * along, s * across, t * height]))
        normals.append(np.array([sign * height, 0.0, a - c]))
        points.append(np.array([s * along, sign * across, t * height]))
        normals.append(np.array([0.0, sign * height, b - d]))
        faces += [2 * face, 2 * face + 1]
    points.append(np.array([s * c, (2.0 * t - 1.0) * d, np.full(s.size, height)]))
    normals.append(np.array([0.0, 0.0, 1.0]))
    faces.append(4)
    units = [np.repeat((n / np.linalg.norm(n))[:, None], s.size, axis=1) for n in normals]
    return np.hstack(points), np.hstack(units), np.repeat(np.array(faces), s.size)


def _of_the_part(cell: Cell, cloud: Array, labels: Array) -> Array | None:
    """Return the points of the cluster that looks most like the part, shape (3, n), or None."""
    best, chosen = math.inf, None
    for label in np.unique(labels[labels >= 0]):
        cluster = cloud[:, labels == label]
        if cluster.shape[1] < 10:
            continue
        tall = np.sort(cluster[2])
        top = float(tall[round(0.9 * (tall.size - 1))])
        size = math.sqrt(float(np.sum(_spread(cluster)[[0, 2]])))
        # As tall as the part, and as wide: a tenth of the height counts as much as 4 mm.
        unlike = abs(top - 0.95 * cell.height) + abs(size - 0.032)
        if unlike < best:
            best, chosen = unlike, cluster
    return chosen if best < 0.03 else None


def _spread(cloud: Array) -> Array:
    """Return the variance along x, the covariance, and the variance along y [m^2]."""
    x, y = cloud[:2] - cloud[:2].mean(axis=1, keepdims=True)
    return np.array([x @ x, x @ y, y @ y]) / (x.size - 1)


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _flat(R: Array, p: Array) -> tuple[Array, Array]:
    """Return a pose with the part upright on the table."""
    return _about_z(math.atan2(R[1, 0], R[0, 0])), np.array([p[0], p[1], 0.0])
