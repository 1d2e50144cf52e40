"""OMPL's RRT asked for a path of a point among discs in the plane.

The question is that of the `rrt` drill, and the algorithm is the same one: goal bias, nearest node,
a step of at most `range`, one edge check, and a solution as soon as a new node can be joined to the
goal by a free edge no longer than the step. OMPL does the sampling, the search for the nearest node
and the tree; three of its parts are replaced, through classes that its bindings let one derive:

- the motion validator, by an exact test of the segment against the discs (`exact=True`). OMPL's
  own, `DiscreteMotionValidator`, tries points along the edge (`exact=False`, at `resolution`);
- the goal, so that joining a new node to it is checked: OMPL's own goal region would call a node
  within the step of the goal a solution whatever stands between;
- the condition to stop, which counts samples instead of time: OMPL asks it once before each.

These parts run in Python, called from OMPL's loop. `Plan.callback_seconds` is their share of the
time, so that OMPL is not charged for it unawares.

OMPL's random numbers come from one seed a process; it is set anew before each plan, and the random
generators made for the plan follow it.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, refused

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """What OMPL answered.

    Attributes:
        path: from start to goal, shape (k, 2) [m], or None if none was found.
        nodes: the tree, shape (m, 2) [m], in no particular order, the goal with it if reached.
        samples: how many targets were drawn, those of the goal included.
        checks: how many edges were checked.
        seconds: time in OMPL's `solve`, that of the callbacks included [s].
        callback_seconds: time in the parts written in Python [s].
    """

    path: Array | None
    nodes: Array
    samples: int
    checks: int
    seconds: float
    callback_seconds: float


def _ompl() -> tuple[Any, Any, Any]:
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise ImportError("this needs OMPL: pip install 'ompl>=2.0'") from error
    util.setLogLevel(
        util.LogLevel.LOG_NONE
    )  # it reports every plan, and every seed after the first
    return base, geometric, util


def rrt(
    start: ArrayLike,
    goal: ArrayLike,
    discs: ArrayLike,
    bounds: ArrayLike,
    step: float,
    max_samples: int,
    seed: int,
    goal_bias: float = 0.1,
    exact: bool = True,
    resolution: float = 0.01,
) -> Plan:
    """One plan by `ompl::geometric::RRT` (LaValle and Kuffner, 2001; Sucan et al., 2012).

    Args:
        start: where the path begins, shape (2,) [m].
        goal: where it ends, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (n, 3) [m]; touching one is a collision.
        bounds: the world, rows (xmin, ymin) and (xmax, ymax), shape (2, 2) [m].
        step: the longest edge, OMPL's `range` [m].
        max_samples: how many targets to draw at most.
        seed: of OMPL's random numbers, positive.
        goal_bias: probability that a target is the goal.
        exact: check edges exactly, or by OMPL's points along the edge.
        resolution: spacing of those points, as a share of the world's diagonal.

    Returns:
        The plan.

    Raises:
        ValueError: if start or goal is in collision or out of bounds, or the seed is not positive.
        ImportError: if OMPL is not installed.
    """
    base, geometric, util = _ompl()
    count("seed", seed, 1)  # for 0 OMPL draws one of its own
    start, goal = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    low, high = np.asarray(bounds, dtype=float)
    obstacles = [tuple(row) for row in np.asarray(discs, dtype=float).reshape(-1, 3).tolist()]
    for name, point in (("start", start), ("goal", goal)):
        inside = bool(((low <= point) & (point <= high)).all())
        x, y = point.tolist()
        if not inside or not _is_free(x, y, x, y, obstacles):
            raise refused(name, point, "a free point within the bounds")

    util.RNG.setSeed(seed)
    space = base.RealVectorStateSpace(2)
    limits = base.RealVectorBounds(2)
    for axis in range(2):
        limits.setLow(axis, float(low[axis]))
        limits.setHigh(axis, float(high[axis]))
    space.setBounds(limits)
    information = base.SpaceInformation(space)
    goal_x, goal_y = goal.tolist()
    asked, checks, spent = 0, 0, 0.0
    motion_validator: Any = base.MotionValidator
    sampleable_region: Any = base.GoalSampleableRegion

    class ExactMotions(motion_validator):
        def checkMotion(self, a, b) -> bool:
            nonlocal checks, spent
            begun = time.perf_counter()
            checks += 1
            free = _is_free(a[0], a[1], b[0], b[1], obstacles)
            spent += time.perf_counter() - begun
            return free

    class JoinedGoal(sampleable_region):
        def distanceGoal(self, state) -> float:
            nonlocal checks, spent
            begun = time.perf_counter()
            x, y = state[0], state[1]
            distance = math.hypot(goal_x - x, goal_y - y)
            if distance <= step:
                checks += 1
                if _is_free(x, y, goal_x, goal_y, obstacles):
                    distance = 0.0
            spent += time.perf_counter() - begun
            return distance

        def sampleGoal(self, state) -> None:
            state[0], state[1] = goal_x, goal_y

        def maxSampleCount(self) -> int:
            return 1

    def is_valid(state) -> bool:
        nonlocal spent
        begun = time.perf_counter()
        free = _is_free(state[0], state[1], state[0], state[1], obstacles)
        spent += time.perf_counter() - begun
        return free

    def enough() -> bool:
        nonlocal asked
        asked += 1
        return asked > max_samples

    information.setStateValidityChecker(is_valid)
    if exact:
        information.setMotionValidator(ExactMotions(information))
    else:
        information.setStateValidityCheckingResolution(resolution)
    information.setup()
    problem = base.ProblemDefinition(information)
    first = space.allocState()
    first[0], first[1] = start.tolist()
    problem.addStartState(first)
    region = JoinedGoal(information)
    region.setThreshold(float(np.finfo(float).tiny))
    problem.setGoal(region)
    planner = geometric.RRT(information)
    planner.setRange(float(step))
    planner.setGoalBias(float(goal_bias))
    planner.setProblemDefinition(problem)
    planner.setup()

    begun = time.perf_counter()
    planner.solve(base.PlannerTerminationCondition(enough))
    seconds = time.perf_counter() - begun

    found = problem.hasExactSolution()
    tree = base.PlannerData(information)
    planner.getPlannerData(tree)
    nodes = [_xy(tree.getVertex(i).getState()) for i in range(tree.numVertices())]
    path = None
    if found:
        states = problem.getSolutionPath()
        path = [_xy(states.getState(i)) for i in range(states.getStateCount())]
        if path[-1] != (goal_x, goal_y):
            path.append((goal_x, goal_y))
            nodes.append((goal_x, goal_y))
    return Plan(
        path=None if path is None else np.array(path),
        nodes=np.array(nodes),
        samples=min(asked, max_samples),
        checks=checks,
        seconds=seconds,
        callback_seconds=spent,
    )


def _xy(state) -> tuple[float, float]:
    return state[0], state[1]


def _is_free(ax: float, ay: float, bx: float, by: float, discs: list[tuple[float, ...]]) -> bool:
    """Whether the segment touches no disc, by the roots of the distance as a quadratic."""
    dx, dy = bx - ax, by - ay
    a = dx * dx + dy * dy
    for x, y, radius in discs:
        fx, fy = ax - x, ay - y
        c = fx * fx + fy * fy - radius * radius
        if c <= 0.0:
            return False  # begins inside
        b = fx * dx + fy * dy
        if b >= 0.0 or a == 0.0:
            continue  # moves away
        if a + 2.0 * b + c <= 0.0:
            return False  # ends inside
        if -b < a and b * b >= a * c:
            return False  # enters and leaves in between
    return True
