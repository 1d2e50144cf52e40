"""OMPL's planners, asked what the course's are: same world, step, goal rule, start.

OMPL does the sampling, the search for the nearest node and the tree. What is replaced, through
classes that its bindings let one derive:

- the motion validator, by a test of ours. OMPL's own, `DiscreteMotionValidator`, tries states along
  the edge at a resolution, each by a state test of ours;
- RRT's goal, so that joining a new node to it is checked: OMPL's own goal region would call a node
  within the step of the goal a solution whatever stands between;
- the condition to stop, which counts samples instead of time: OMPL asks it once before each.

These parts run in Python, called from OMPL's loop. `Plan.callback_seconds` is their share of the
time, so that OMPL is not charged for it unawares; what the binding adds to each call is not in it.

OMPL's random numbers come from one seed a process; it is set anew before each plan, and the random
generators made for the plan follow it.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of
from course.libraries import import_error
from course.planning import World
from course.planning.worlds import DISC, LAST_SIDE

Array = NDArray[np.float64]
PLANNERS = {
    "rrt": "RRT",
    "rrt_connect": "RRTConnect",
    "rrt_star": "RRTstar",
    "informed_rrt_star": "InformedRRTstar",
    "bit_star": "BITstar",
}
# A test of ours on states of OMPL, which are read by index.
StateTest = Callable[[Any], bool]
EdgeTest = Callable[[Any, Any], bool]


@dataclass(frozen=True)
class Plan:
    """What OMPL answered.

    Attributes:
        path: from start to goal, shape (k, n), or None if none was found.
        nodes: the tree, shape (m, n), in no particular order, the goal with it if reached.
        samples: how many targets were drawn, those of the goal included.
        checks: how many edges were checked by a test of ours.
        state_checks: how many states were.
        seconds: time in OMPL's `solve`, that of the callbacks included [s].
        callback_seconds: time in the parts written in Python [s].
    """

    path: Array | None
    nodes: Array
    samples: int
    checks: int
    seconds: float
    callback_seconds: float
    state_checks: int = 0

    @property
    def own_seconds(self) -> float:
        """Time in OMPL itself and in its binding [s]."""
        return self.seconds - self.callback_seconds


def _ompl() -> tuple[Any, Any, Any]:
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise import_error("OMPL", "pip install 'ompl>=2.0'", error) from error
    util.setLogLevel(
        util.LogLevel.LOG_NONE
    )  # it reports every plan, and every seed after the first
    return base, geometric, util


def defaults(dim: int = 2) -> dict[str, Any]:
    """Return OMPL's default settings, read from OMPL itself on the unit cube.

    Returns:
        The planner it takes for a plain query, its longest edge and its resolution as shares of the
        diagonal, and the goal bias of RRT.
    """
    base, geometric, _ = _ompl()
    information = _information(base, np.array([[0.0] * dim, [1.0] * dim]))
    information.setup()
    setup = geometric.SimpleSetup(information)
    # OMPL settles its defaults only once a query has a start and a goal.
    first = information.getStateSpace().allocState()
    for i in range(dim):
        first[i] = 0.5
    setup.setStartAndGoalStates(first, first)
    setup.setup()
    connect, rrt_planner = geometric.RRTConnect(information), geometric.RRT(information)
    connect.setProblemDefinition(setup.getProblemDefinition())
    connect.setup()
    return {
        "planner": setup.getPlanner().getName(),
        "range": connect.getRange() / math.sqrt(dim),
        "resolution": information.getStateValidityCheckingResolution(),
        "goal_bias": rrt_planner.getGoalBias(),
    }


def approximate(samples: int = 200, seed: int = 1) -> tuple[bool, bool, float]:
    """Return an RRT of OMPL asked for a state behind a wall that has no opening.

    Returns:
        Whether its answer counts as true, whether the problem has an exact solution, and by how
        much the path ends short of the goal.
    """
    base, geometric, util = _ompl()
    util.RNG.setSeed(count("seed", seed, 1))
    information = _information(base, np.array([[0.0, 0.0], [1.0, 1.0]]))
    information.setStateValidityChecker(lambda q: abs(q[0] - 0.5) > 0.1)
    setup = geometric.SimpleSetup(information)
    ends = [information.getStateSpace().allocState() for _ in range(2)]
    for q, x in zip(ends, (0.1, 0.9), strict=True):
        q[0], q[1] = x, 0.5
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRT(information))
    # The budget is counted in calls of the condition, one for each iteration, not in time.
    requested = itertools.count(1)
    status = setup.solve(base.PlannerTerminationCondition(lambda: next(requested) > samples))
    problem = setup.getProblemDefinition()
    return bool(status), problem.hasExactSolution(), problem.getSolutionDifference()


def _information(base: Any, bounds: Array) -> Any:
    space = base.RealVectorStateSpace(bounds.shape[1])
    limits = base.RealVectorBounds(bounds.shape[1])
    for axis, (low, high) in enumerate(bounds.T.tolist()):
        limits.setLow(axis, low)
        limits.setHigh(axis, high)
    space.setBounds(limits)
    return base.SpaceInformation(space)


def solve(
    bounds: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    method: str,
    step: float,
    max_samples: int,
    seed: int,
    state: StateTest | None,
    edge: EdgeTest | None,
    *,
    goal_bias: float = 0.05,
    resolution: float = 0.01,
) -> Plan:
    """Plan once with OMPL (Sucan, Moll and Kavraki, 2012) and return the path.

    Args:
        bounds: rows low and high, shape (2, n).
        start: free state, shape (n,).
        goal: free state, shape (n,).
        method: a key of `PLANNERS`. RRT* takes its neighbours by radius, as ours, and uses the
            whole budget, as do Informed RRT* and BIT* (Gammell, Srinivasa and Barfoot, 2015), both
            with OMPL's settings; RRT joins the goal by a checked edge of at most a step.
        step: the longest edge, OMPL's `range`.
        max_samples: how many targets to draw at most; of BIT* how many edges of its queue to take.
        seed: of OMPL's random numbers, positive.
        state: whether a state is free; without it all are, and OMPL calls no Python for it.
        edge: whether an edge is; without it OMPL tries states along it.
        goal_bias: probability that a target is the goal, of "rrt" and "rrt_star".
        resolution: spacing of states along an edge, as a share of the diagonal.

    Raises:
        ValueError: for an unknown method or a seed that is not positive.
        ImportError: if OMPL is not installed.
    """
    base, geometric, util = _ompl()
    one_of("method", method, PLANNERS)
    # Before anything is allocated: the random generators of the plan are seeded when they are made.
    util.RNG.setSeed(count("seed", seed, 1))  # for 0 OMPL draws one of its own
    information = _information(base, np.asarray(bounds, dtype=float))
    begin, end = np.asarray(start, dtype=float).tolist(), np.asarray(goal, dtype=float).tolist()
    n = len(begin)
    # Set-up calls of the callbacks are not charged to the plan.
    polls, checks, states, spent = 0, 0, 0, 0.0
    motion_validator: Any = base.MotionValidator
    sampleable_region: Any = base.GoalSampleableRegion

    def edge_test(a, b) -> bool:
        return information.checkMotion(a, b) if edge is None else edge(a, b)

    # OMPL calls this for every edge, except those that `distanceGoal` tests itself.
    class Motions(motion_validator):
        def checkMotion(self, a, b) -> bool:
            nonlocal checks, spent
            begun = time.perf_counter()
            checks += 1
            free = edge_test(a, b)
            spent += time.perf_counter() - begun
            return free

    class JoinedGoal(sampleable_region):
        # OMPL ends at distance 0: so a node that an edge can join to the goal counts as there.
        def distanceGoal(self, state) -> float:
            nonlocal checks, spent
            begun = time.perf_counter()
            distance = math.dist([state[i] for i in range(n)], end)
            if distance <= step:
                checks += 1
                if edge_test(state, aim):
                    distance = 0.0
            spent += time.perf_counter() - begun
            return distance

        def sampleGoal(self, state) -> None:
            for i in range(n):
                state[i] = end[i]

        def maxSampleCount(self) -> int:
            return 1

    def is_valid(q) -> bool:
        nonlocal spent, states
        begun = time.perf_counter()
        states += 1
        assert state is not None
        free = state(q)
        spent += time.perf_counter() - begun
        return free

    def enough() -> bool:
        nonlocal polls
        # OMPL polls this once an iteration, which counts the samples.
        polls += 1
        return polls > max_samples

    if state is not None:
        information.setStateValidityChecker(is_valid)
    if edge is not None:
        information.setMotionValidator(Motions(information))
    else:
        information.setStateValidityCheckingResolution(resolution)
    information.setup()
    problem = base.ProblemDefinition(information)
    first, aim = (information.getStateSpace().allocState() for _ in range(2))
    for i in range(n):
        first[i], aim[i] = begin[i], end[i]
    problem.addStartState(first)
    if method == "rrt":
        region = JoinedGoal(information)
        # Only the distance 0 that `JoinedGoal` gives counts: the next edge is part of the solution.
        region.setThreshold(float(np.finfo(float).tiny))
    else:
        # RRT-Connect and RRT* join the goal by an edge that OMPL checks anyway.
        region = base.GoalState(information)
        region.setState(aim)
    problem.setGoal(region)
    planner = getattr(geometric, PLANNERS[method])(information)
    if method != "bit_star":  # BIT* joins all samples of a batch within a radius, at any length
        planner.setRange(float(step))
    if method not in ("rrt_connect", "bit_star"):
        planner.setGoalBias(float(goal_bias))
    if method == "rrt_star":
        # Neighbours within a shrinking radius, as in our RRT*.
        planner.setKNearest(False)
    planner.setProblemDefinition(problem)
    planner.setup()
    polls, checks, states, spent = 0, 0, 0, 0.0

    begun = time.perf_counter()
    planner.solve(base.PlannerTerminationCondition(enough))
    # Only `solve` is timed: building the problem and reading the tree are outside.
    seconds = time.perf_counter() - begun

    tree = base.PlannerData(information)
    planner.getPlannerData(tree)

    def row(q: Any) -> list[float]:
        return [q[i] for i in range(n)]

    nodes = [row(tree.getVertex(i).getState()) for i in range(tree.numVertices())]
    path = None
    # Approximate solutions also count as solved in OMPL.
    if problem.hasExactSolution():
        solution = problem.getSolutionPath()
        path = [row(solution.getState(i)) for i in range(solution.getStateCount())]
        # The edge to the goal was tested in `distanceGoal`, and is not part of OMPL's tree.
        if path[-1] != end:
            path.append(end)
            nodes.append(end)
    return Plan(
        path=None if path is None else np.array(path),
        nodes=np.array(nodes),
        samples=min(polls, max_samples),
        checks=checks,
        seconds=seconds,
        callback_seconds=spent,
        state_checks=states,
    )


def roadmap(
    bounds: ArrayLike, milestones: int, seed: int, state: StateTest, edge: EdgeTest
) -> tuple[Array, NDArray[np.int64]]:
    """Return a roadmap by OMPL's PRM (Kavraki et al., 1996) with ten nearest neighbours.

    Only grown: `solve` would expand it in turns that are limited by time, so that no two are alike.

    Returns:
        Its free states, shape (m, n), and the pairs of them that are joined, shape (e, 2).
    """
    base, geometric, util = _ompl()
    util.RNG.setSeed(count("seed", seed, 1))
    information = _information(base, np.asarray(bounds, dtype=float))
    motion_validator: Any = base.MotionValidator

    class Motions(motion_validator):
        def checkMotion(self, a, b) -> bool:
            return edge(a, b)

    information.setStateValidityChecker(state)
    information.setMotionValidator(Motions(information))
    information.setup()
    planner = geometric.PRM(information)
    planner.setProblemDefinition(base.ProblemDefinition(information))
    planner.setup()
    # Ended by the number of states, not by time.
    grown = base.PlannerTerminationCondition(lambda: planner.milestoneCount() >= milestones)
    planner.growRoadmapPtc(grown)
    graph = base.PlannerData(information)
    planner.getPlannerData(graph)
    n, number = np.shape(bounds)[1], graph.numVertices()
    states = [graph.getVertex(i).getState() for i in range(number)]
    # The graph stores every edge in both directions.
    pairs = [(i, j) for i in range(number) for j in graph.getEdges(i) if i < j]
    return np.array([[q[k] for k in range(n)] for q in states]), np.array(pairs).reshape(-1, 2)


def points_along(bounds: ArrayLike, state: StateTest, resolution: float) -> EdgeTest:
    """Return OMPL's own test of an edge: states along it, of which `state` is asked.

    Args:
        bounds: rows low and high, shape (2, n).
        state: whether a state is free.
        resolution: their spacing at most, as a share of the diagonal.
    """
    base, _, _ = _ompl()
    information = _information(base, np.asarray(bounds, dtype=float))
    information.setStateValidityChecker(state)
    information.setStateValidityCheckingResolution(resolution)
    information.setup()
    # Allocated once: the test is called in a loop.
    ends = [information.getStateSpace().allocState() for _ in range(2)]

    def edge(a: Any, b: Any) -> bool:
        for end, q in zip(ends, (a, b), strict=True):
            for i in range(np.shape(bounds)[1]):
                end[i] = float(q[i])
        return bool(information.checkMotion(*ends))

    return edge


# --- a world of the course ------------------------------------------------------------------------


def tests(world: World) -> tuple[StateTest, EdgeTest]:
    """Return the compiled tests of a world, for states of OMPL."""
    n, (free, joined) = world.dim, world.kernels
    # Reused buffers, so that a call allocates nothing.
    here, other = np.empty(n), np.empty(n)
    obstacles, body = world.obstacles, world.body

    def state(q: Any) -> bool:
        for i in range(n):
            here[i] = q[i]
        return bool(free(obstacles, body, here))

    def edge(a: Any, b: Any) -> bool:
        for i in range(n):
            here[i], other[i] = a[i], b[i]
        return bool(joined(obstacles, body, here, other))

    return state, edge


def plain(world: World) -> StateTest:
    """Return the state test of a world in pure Python: what most who use OMPL from Python write.

    Of the plane and of planar arms over lists, of an arm of capsules the course's source, not
    compiled.

    Raises:
        ValueError: for a world of another kind.
    """
    one_of("world.kind", world.kind, ("plane", "planar arm", "capsule arm"))
    if world.kind == "capsule arm":
        n, tables = world.dim, (world.obstacles, world.body)
        return lambda q: bool(world.state_free(*tables, np.array([q[i] for i in range(n)])))
    rings: list[list[tuple[float, float]]] = [[]]
    round_ones = []
    for kind, x, y, u, _ in world.obstacles.tolist():
        if kind == DISC:
            round_ones.append((x, y, u))
            continue
        rings[-1].append((x, y))
        if kind == LAST_SIDE:
            rings.append([])
    # Each ring closed: the last corner is joined to the first.
    sides = [list(zip(ring, ring[1:] + ring[:1], strict=True)) for ring in rings[:-1]]
    links = world.body.tolist()

    def inside(x: float, y: float, ring: list[Any]) -> bool:
        odd = False
        for (ax, ay), (bx, by) in ring:
            # Ray casting: an odd number of crossings is inside.
            if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
                odd = not odd
        return odd

    def point(q: Any) -> bool:
        x, y = q[0], q[1]
        for u, v, radius in round_ones:
            if (x - u) ** 2 + (y - v) ** 2 <= radius * radius:
                return False
        return not any(inside(x, y, ring) for ring in sides)

    def to_segment(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
        dx, dy = bx - ax, by - ay
        # Projection onto the segment, clamped to its ends.
        t = min(max(((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        return math.hypot(x - ax - t * dx, y - ay - t * dy)

    def meet(a: Any, b: Any, c: Any, d: Any) -> bool:
        def left_turn(p: Any, q: Any, r: Any) -> bool:
            # Segments cross if each separates the ends of the other: signs of cross products.
            return (q[0] - p[0]) * (r[1] - p[1]) > (q[1] - p[1]) * (r[0] - p[0])

        one = left_turn(a, b, c) != left_turn(a, b, d)
        return one and left_turn(c, d, a) != left_turn(c, d, b)

    def arm(q: Any) -> bool:
        x = y = angle = 0.0
        for i, (length, radius) in enumerate(links):
            angle += q[i]
            u, v = x + length * math.cos(angle), y + length * math.sin(angle)
            for cx, cy, size in round_ones:
                if to_segment(cx, cy, x, y, u, v) <= size + radius:
                    return False
            for ring in sides:
                # A link may lie inside a polygon without crossing a side.
                if inside(u, v, ring):
                    return False
                for a, b in ring:
                    near = min(
                        to_segment(*a, x, y, u, v),
                        to_segment(x, y, *a, *b),
                        to_segment(u, v, *a, *b),
                    )
                    if near <= radius or meet((x, y), (u, v), a, b):
                        return False
            x, y = u, v
        return True

    return point if world.kind == "plane" else arm


# --- the question of the drill --------------------------------------------------------------------


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
    """Return one plan by `ompl::geometric::RRT` (LaValle and Kuffner, 2001; Sucan et al., 2012).

    Args:
        start: where the path begins, shape (2,) [m].
        goal: where it ends, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (n, 3) [m]; touching one is a collision.
        bounds: the world, rows (xmin, ymin) and (xmax, ymax), shape (2, 2) [m].
        step: the longest edge, OMPL's `range` [m].
        max_samples: how many targets to draw at most; of BIT* how many edges of its queue to take.
        seed: of OMPL's random numbers, positive.
        goal_bias: probability that a target is the goal.
        exact: check edges exactly, in pure Python, or by OMPL's points along the edge.
        resolution: spacing of those points, as a share of the world's diagonal.

    Returns:
        The plan.

    Raises:
        ValueError: if start or goal is in collision or out of bounds, or the seed is not positive.
        ImportError: if OMPL is not installed.
    """
    low, high = np.asarray(bounds, dtype=float)
    obstacles = [tuple(row) for row in np.asarray(discs, dtype=float).reshape(-1, 3).tolist()]

    def edge(a: Any, b: Any) -> bool:
        return _is_free(a[0], a[1], b[0], b[1], obstacles)

    for name, point in (("start", start), ("goal", goal)):
        place = np.asarray(point, dtype=float)
        if not ((low <= place) & (place <= high)).all() or not edge(place, place):
            raise invalid(name, place, "a free point within the bounds")
    return solve(
        bounds,
        start,
        goal,
        "rrt",
        step,
        max_samples,
        seed,
        lambda q: edge(q, q),
        edge if exact else None,
        goal_bias=goal_bias,
        resolution=resolution,
    )


def _is_free(ax: float, ay: float, bx: float, by: float, discs: list[tuple[float, ...]]) -> bool:
    """Return whether the segment touches no disc, by the roots of the distance as a quadratic."""
    dx, dy = bx - ax, by - ay
    # |from + t d - centre|^2 - r^2 = a t^2 + 2 b t + c, to be positive for all t in [0, 1].
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


# --- on a constraint manifold, and with controls --------------------------------------------------


def _no_clock() -> float:
    return 0.0


def carry(
    world: World,
    axis: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    step: float,
    max_samples: int,
    seed: int,
    *,
    reach: float = 2.0,
    split: bool = False,
) -> Plan:
    """Plan once on the manifold of an upright cup: RRT-Connect in OMPL's `ProjectedStateSpace`.

    The constraint, its Jacobian and the state test are Python functions that call the compiled ones
    of the course. OMPL checks states along a motion, projected, and not what lies between them.
    Times are those of this thread.

    Args:
        world: of `capsule_arm`.
        axis: of the cup in the tool's frame, shape (3,).
        start: upright configuration, shape (n,) [rad].
        goal: likewise.
        step: spacing of the states along a motion, OMPL's `delta` [rad].
        max_samples: how many targets to draw at most.
        seed: of OMPL's random numbers, positive.
        reach: the longest motion, OMPL's `range` [rad].
        split: whether to measure `callback_seconds`. Two readings of the clock for each call make
            `seconds` longer.

    Raises:
        ImportError: if OMPL is not installed.
    """
    from course.planning import manifold

    base, geometric, util = _ompl()
    util.RNG.setSeed(count("seed", seed, 1))
    measure, n = manifold.kernels()[2], world.dim
    a, J, here = np.array(axis, dtype=float), np.empty((3, n)), np.empty(n)
    free = world.kernels[0]
    clock = time.thread_time if split else _no_clock
    polls, states, spent = 0, 0, 0.0
    constraint_class: Any = base.Constraint

    class Upright(constraint_class):
        def __init__(self) -> None:
            super().__init__(n, 2, manifold.PROJECTED)

        def function(self, q, out) -> None:
            nonlocal spent
            begun = clock()
            here[:] = q
            measure(world.body, here, a, J)
            out[0], out[1] = -J[2, 0], -J[2, 1]
            spent += clock() - begun

        def jacobian(self, q, out) -> None:
            nonlocal spent
            begun = clock()
            here[:] = q
            measure(world.body, here, a, J)
            out[:] = J[:2]
            spent += clock() - begun

    low, high = world.bounds
    ambient = base.RealVectorStateSpace(n)
    limits = base.RealVectorBounds(n)
    for k in range(n):
        limits.setLow(k, float(low[k]))
        limits.setHigh(k, float(high[k]))
    ambient.setBounds(limits)
    constraint = Upright()
    space = base.ProjectedStateSpace(ambient, constraint)
    information = base.ConstrainedSpaceInformation(space)
    space.setDelta(float(step))

    def is_valid(q) -> bool:
        nonlocal spent, states
        begun = clock()
        states += 1
        for k in range(n):
            here[k] = q[k]
        inside = bool((here >= low).all() and (here <= high).all())
        result = inside and bool(free(world.obstacles, world.body, here))
        spent += clock() - begun
        return result

    def enough() -> bool:
        nonlocal polls
        polls += 1
        return polls > max_samples

    information.setStateValidityChecker(is_valid)
    information.setup()
    first, aim = space.allocState(), space.allocState()
    first.copy(np.array(start, dtype=float))
    aim.copy(np.array(goal, dtype=float))
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(first, aim)
    planner = geometric.RRTConnect(information)
    planner.setRange(float(reach))
    planner.setProblemDefinition(problem)
    planner.setup()
    polls, states, spent = 0, 0, 0.0
    begun = time.thread_time()
    planner.solve(base.PlannerTerminationCondition(enough))
    seconds, callbacks, tried = time.thread_time() - begun, spent, states
    path = None
    if problem.hasExactSolution():
        solution = problem.getSolutionPath()
        solution.interpolate()  # the states along its motions
        rows = range(solution.getStateCount())
        path = np.array([[solution.getState(i)[k] for k in range(n)] for i in rows])
    return Plan(path, np.empty((0, n)), min(polls, max_samples), 0, seconds, callbacks, tried)


def controls(
    discs: ArrayLike,
    bounds: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    reach: float,
    acceleration: float,
    dt: float,
    steps: int,
    max_samples: int,
    seed: int,
) -> tuple[Plan, Array, Array]:
    """Plan once for a double integrator among discs with `ompl::control::RRT`.

    OMPL simulates by a Python function and checks the simulated points by another one. It tries one
    control for each sample: the binding has no constructor for a sampler that takes the best of
    several, and none for `SST`. Times are those of this thread.

    Args:
        discs: rows (x, y, radius), shape (m, 3) [m].
        bounds: rows low and high of positions and speeds, shape (2, 4) [m, m/s].
        start: position and velocity, shape (4,) [m, m/s].
        goal: likewise.
        reach: Euclidean distance of states at which the goal counts as reached.
        acceleration: limit of each axis [m/s^2].
        dt: between simulated points [s].
        steps: of a control, at most.
        max_samples: how many targets to draw at most.
        seed: of OMPL's random numbers, positive.

    Returns:
        The plan; the controls, shape (k - 1, 2) [m/s^2]; how long each lasts, shape (k - 1,) [s].

    Raises:
        ImportError: if OMPL is not installed.
    """
    base, _, util = _ompl()
    from ompl import control

    util.RNG.setSeed(count("seed", seed, 1))
    low, high = np.asarray(bounds, dtype=float).tolist()
    round_ones = np.asarray(discs, dtype=float).T
    space = base.RealVectorStateSpace(4)
    limits = base.RealVectorBounds(4)
    for k in range(4):
        limits.setLow(k, low[k])
        limits.setHigh(k, high[k])
    space.setBounds(limits)
    inputs = control.RealVectorControlSpace(space, 2)
    box = base.RealVectorBounds(2)
    box.setLow(-float(acceleration))
    box.setHigh(float(acceleration))
    inputs.setBounds(box)
    information = control.SpaceInformation(space, inputs)

    def simulate(s, a, t, out) -> None:
        for k in range(2):
            x, v, pull = s[k], s[2 + k], a[k]
            out[k], out[2 + k] = x + v * t + 0.5 * pull * t * t, v + pull * t

    def is_valid(s) -> bool:
        if any(not low[k] <= s[k] <= high[k] for k in range(4)):
            return False
        x, y, r = round_ones
        return bool((np.hypot(x - s[0], y - s[1]) > r).all())

    polls = itertools.count(1)
    information.setStatePropagator(simulate)
    information.setStateValidityChecker(is_valid)
    information.setPropagationStepSize(float(dt))
    information.setMinMaxControlDuration(1, steps)
    information.setup()
    first, aim = space.allocState(), space.allocState()
    for k in range(4):
        first[k], aim[k] = float(np.asarray(start)[k]), float(np.asarray(goal)[k])
    problem = base.ProblemDefinition(information)
    problem.addStartState(first)
    region = base.GoalState(information)
    region.setState(aim)
    region.setThreshold(float(reach))
    problem.setGoal(region)
    planner = control.RRT(information)
    planner.setGoalBias(0.1)
    planner.setProblemDefinition(problem)
    planner.setup()
    begun = time.thread_time()
    planner.solve(base.PlannerTerminationCondition(lambda: next(polls) > max_samples))
    seconds = time.thread_time() - begun
    drawn = min(next(polls) - 1, max_samples)
    path, pulls, lasted = None, np.empty((0, 2)), np.empty(0)
    if problem.hasExactSolution():
        solution = problem.getSolutionPath()
        number = solution.getControlCount()
        rows = range(solution.getStateCount())
        path = np.array([[solution.getState(i)[k] for k in range(4)] for i in rows])
        pulls = np.array([[solution.getControl(i)[k] for k in range(2)] for i in range(number)])
        lasted = np.array([solution.getControlDuration(i) for i in range(number)])
    return Plan(path, np.empty((0, 4)), drawn, 0, seconds, 0.0), pulls, lasted
