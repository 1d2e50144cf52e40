"""Parts that call a library for the same job, on request: `--part SLOT=LIBRARY`.

They are texts, as all parts are: beside a part of the learner's they run in the child process,
which can't read `course.oracles`. OMPL and Open3D sample random numbers of their own, so that a run
with them is not repeated to the last digit.
"""

from __future__ import annotations

import importlib.util

from drills.robot.slots import NAMED, Part

# Two uniform rods in a vertical plane.
_ARM = """
import numpy as np
import pinocchio

ARMS = {}


def arm(lengths, masses, gravity):
    key = (*lengths, *masses, gravity)
    if key not in ARMS:
        model, parent, at = pinocchio.Model(), 0, 0.0
        for i, (length, mass) in enumerate(zip(lengths, masses)):
            placement = pinocchio.SE3(np.eye(3), np.array([at, 0.0, 0.0]))
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), placement, f"joint {i}")
            spread = mass * length**2 / 12.0
            middle = np.array([0.5 * length, 0.0, 0.0])
            rod = pinocchio.Inertia(mass, middle, np.diag([0.0, spread, spread]))
            model.appendBodyToJoint(parent, rod, pinocchio.SE3.Identity())
            at = length
        model.gravity.linear = np.array([0.0, -gravity, 0.0])
        ARMS.clear()
        ARMS[key] = model, model.createData()
    return ARMS[key]
"""

# Open3D asks for the system's libusb when it is imported; a package brings it along.
_OPEN3D = """
import ctypes
import mimetypes
import os

mimetypes.knownfiles.clear()  # which a part in the sandbox may not read
import libusb_package
import numpy as np

os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
ctypes.CDLL(str(libusb_package.get_library_path()), ctypes.RTLD_GLOBAL)
import open3d

open3d.utility.random.seed(1)


def cloud_of(points):
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.T.copy()))
"""

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
    "jacobian": {
        "pinocchio": """
import numpy as np
import pinocchio

MODELS = {}


def model_of(placements, tool):
    key = placements.tobytes() + tool.tobytes()
    if key not in MODELS:
        model, parent = pinocchio.Model(), 0
        for i, placement in enumerate(placements):
            at = pinocchio.SE3(placement[:3, :3], placement[:3, 3])
            parent = model.addJoint(parent, pinocchio.JointModelRZ(), at, f"joint {i}")
        at = pinocchio.SE3(np.eye(3), tool)
        frame = model.addFrame(pinocchio.Frame("tool", parent, at, pinocchio.FrameType.OP_FRAME))
        MODELS.clear()
        MODELS[key] = model, model.createData(), frame
    return MODELS[key]


def geometric_jacobian(placements, q, tool):
    model, data, frame = model_of(placements, tool)
    axes = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return pinocchio.computeFrameJacobian(model, data, q, frame, axes).copy()
"""
    },
    "computed_torque": {
        "pinocchio": _ARM
        + """

def computed_torque(lengths, masses, gravity, q, v, reference, kp, kd):
    model, data = arm(lengths, masses, gravity)
    q_ref, v_ref, a_ref = reference
    a = a_ref + kd * (v_ref - v) + kp * (q_ref - q)
    return pinocchio.rnea(model, data, q, v, a).copy()
"""
    },
    "rnea_planar": {
        "pinocchio": _ARM
        + """

def rnea_planar(lengths, masses, q, v, a, gravity):
    model, data = arm(lengths, masses, gravity)
    return pinocchio.rnea(model, data, q, v, a).copy()
"""
    },
    "friction_torque": {
        "mujoco": """
import mujoco
import numpy as np

MODELS = {}


def model_of(coulomb, viscous, transition):
    key = (*coulomb, *viscous, transition)
    if key not in MODELS:
        # MuJoCo's frictionloss is linear up to a speed and constant above. At a solver impedance of
        # 0.9 and a mass of 1 the slope is 10 times the damping in solreffriction.
        joints = "".join(
            f'<body><joint type="slide" axis="1 0 0" frictionloss="{dry!r}" damping="{wet!r}" '
            f'solimpfriction="0.9 0.9 0.001 0.5 2" solreffriction="0 {-0.1 * dry / transition!r}"/>'
            '<geom size="0.1" mass="1" contype="0" conaffinity="0"/></body>'
            for dry, wet in zip(coulomb.tolist(), viscous.tolist())
        )
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option gravity="0 0 0"/><worldbody>{joints}</worldbody></mujoco>'
        )
        MODELS.clear()
        MODELS[key] = model, mujoco.MjData(model)
    return MODELS[key]


def friction_torque(v, coulomb, viscous, transition):
    model, data = model_of(coulomb, viscous, transition)
    data.qvel[:], data.qacc[:] = v, 0.0
    # Inverse dynamics at a constant speed: all of the force goes against friction.
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse.copy()
"""
    },
    "plane_ransac": {
        "open3d": _OPEN3D
        + """

def plane_ransac(points, triples, tolerance, confidence):
    cloud = cloud_of(points)
    found, _ = cloud.segment_plane(tolerance, 3, len(triples), probability=confidence)
    plane = np.array(found) / np.linalg.norm(found[:3])
    near = np.flatnonzero(np.abs(plane[:3] @ points + plane[3]) <= tolerance)
    # Open3D does not report how many triples it tried; its rule for the end needs this many.
    share = min(len(near) / points.shape[1], 1.0 - 1e-12)
    enough = np.ceil(np.log1p(-confidence) / np.log1p(-(share**3)))
    return plane, near, min(len(triples), enough)
"""
    },
    "dbscan": {
        "open3d": _OPEN3D
        + """

def dbscan(points, eps, least):
    return np.array(cloud_of(points).cluster_dbscan(eps, least))
"""
    },
    "verlet": {
        "mujoco": """
import mujoco
import numpy as np

# Two joints of unit inertia: a force on one is its acceleration.
BODY = (
    '<body><joint type="slide" axis="1 0 0"/>'
    '<geom size="0.1" mass="1" contype="0" conaffinity="0"/></body>'
)
MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><option gravity="0 0 0"/><worldbody>' + 2 * BODY + "</worldbody></mujoco>"
)
DATA = mujoco.MjData(MODEL)


def verlet_step(q, v, a, acceleration, dt):
    # MuJoCo's default integrator, semi-implicit Euler.
    MODEL.opt.timestep = dt
    DATA.qpos[:], DATA.qvel[:], DATA.qfrc_applied[:] = q, v, a
    mujoco.mj_step(MODEL, DATA)
    q, v = DATA.qpos.copy(), DATA.qvel.copy()
    return q, v, np.asarray(acceleration(q), dtype=float)
"""
    },
    "contact_step": {
        "mujoco": """
import math

import mujoco
import numpy as np

# A ball that can't turn, on a plane. Gravity is tilted instead of the plane.
MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><option cone="elliptic" impratio="100"/><worldbody>'
    '<geom type="plane" size="9 9 1" solref="0.004 1" solimp="0.99 0.999 0.001 0.5 2"/>'
    '<body pos="0 0 0.02"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
    '<geom size="0.02" mass="1" solref="0.004 1" solimp="0.99 0.999 0.001 0.5 2"/></body>'
    "</worldbody></mujoco>"
)
DATA = mujoco.MjData(MODEL)


def contact_step(position, velocity, slope, mu, dt, steps):
    MODEL.opt.timestep = dt
    MODEL.opt.gravity[:] = 9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope)
    MODEL.geom_friction[:, 0] = mu
    mujoco.mj_resetData(MODEL, DATA)
    DATA.qpos[:], DATA.qvel[:] = position, velocity
    for _ in range(int(steps)):
        mujoco.mj_step(MODEL, DATA)
    return DATA.qpos.copy(), DATA.qvel.copy()
"""
    },
}


PACKAGES = {"pinocchio": "pin"}  # where a package has another name than its module


def offers(name: str) -> list[str]:
    """Return the libraries that can hold a slot."""
    return list(TEXTS.get(name, {}))


def installed(library: str) -> bool:
    """Return whether a library can be imported."""
    return importlib.util.find_spec(library) is not None


def part(name: str, library: str) -> Part | None:
    """Return a library's part for a slot, or None where it has none."""
    text = TEXTS.get(name, {}).get(library)
    if text is None:
        return None
    return Part(name, library, text.lstrip(), NAMED[name].entry, f"{library}'s {name}")
