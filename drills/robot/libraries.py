"""Parts that call a library for the same job.

They are texts, as all parts are: they run in the child process, which can't read `course.oracles`.
OMPL draws random numbers of its own, so that a run with it is not repeated to the last digit.
"""

from __future__ import annotations

from drills.robot.slots import NAMED, Part

# By slot and library: the text of a part. It runs in the child process like any other part.
TEXTS: dict[str, dict[str, str]] = {
    "lqr": {
        "scipy": """
import numpy as np
from scipy.linalg import solve_discrete_are


def lqr(A, B, Q, R):
    P = solve_discrete_are(A, B, Q, R)
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
"""
    },
    "rigid_fit": {
        "scipy": """
import numpy as np
from scipy.spatial.transform import Rotation


def rigid_fit(source, target, weights):
    w = weights / weights.sum()
    a, b = source @ w, target @ w
    found, _ = Rotation.align_vectors((target - b[:, None]).T, (source - a[:, None]).T, weights)
    R = found.as_matrix()
    return R, b - R @ a
"""
    },
    "rrt_connect": {
        "ompl": """
import numpy as np
from ompl import base, geometric, util

util.setLogLevel(util.LogLevel.LOG_NONE)
util.RNG.setSeed(1)


def rrt_connect(start, goal, discs, samples, step):
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis, size in enumerate((3.2, 2.9)):
        bounds.setLow(axis, -size)
        bounds.setHigh(axis, size)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)

    class Motions(base.MotionValidator):
        def checkMotion(self, one, other, last=None):
            a = np.array([one[0], one[1]])
            along = np.array([other[0], other[1]]) - a
            off = discs[:, :2] - a
            share = np.clip(off @ along / max(along @ along, 1e-300), 0.0, 1.0)
            gap = off - share[:, None] * along
            return bool(np.all(np.hypot(gap[:, 0], gap[:, 1]) > discs[:, 2]))

    motions = Motions(information)
    information.setMotionValidator(motions)
    information.setStateValidityChecker(lambda state: True)
    information.setup()
    problem = base.ProblemDefinition(information)
    first, last = space.allocState(), space.allocState()
    for axis in range(2):
        first[axis], last[axis] = float(start[axis]), float(goal[axis])
    problem.addStartState(first)
    region = base.GoalState(information)
    region.setState(last)
    problem.setGoal(region)
    planner = geometric.RRTConnect(information)
    planner.setRange(float(step))
    planner.setProblemDefinition(problem)
    planner.setup()
    polls = 0

    def enough():
        nonlocal polls
        polls += 1
        return polls > len(samples)

    planner.solve(base.PlannerTerminationCondition(enough))
    tree = base.PlannerData(information)
    planner.getPlannerData(tree)
    sizes = np.array([1, max(1, tree.numVertices() - 1)])
    if not problem.hasExactSolution():
        return np.zeros((0, 2)), sizes
    path = problem.getSolutionPath()
    states = [path.getState(i) for i in range(path.getStateCount())]
    return np.array([[state[0], state[1]] for state in states]), sizes
"""
    },
}


def offers(name: str) -> list[str]:
    """Return the libraries that can hold a slot."""
    return list(TEXTS.get(name, {}))


def part(name: str, library: str) -> Part | None:
    """Return a library's part for a slot, or None where it has none."""
    text = TEXTS.get(name, {}).get(library)
    if text is None:
        return None
    return Part(name, library, text.lstrip(), NAMED[name].entry, f"{library}'s {name}")
