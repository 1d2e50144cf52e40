"""Pictures of one part with known truth, and how far a pose is from it."""

import numpy as np

from course.kinematics.chain import compose
from course.perception.camera import Camera, Sensor, Shapes, render, sense, shape, together
from course.rigid_body.quaternion import exp, from_matrix, log, product, rotate, to_matrix

CAMERA = Camera.symmetric(320, 240, 1.0)
# At 0.7 m a depth is known to 1.1 mm.
SENSOR = Sensor(baseline=0.075, noise=0.05)
BOX = shape("box", 0.08, 0.05, 0.03)
CYLINDER = shape("cylinder", 0.04, 0.05)
SPHERE = shape("sphere", 0.04)


def visible_pose(place=(0.02, 0.03, 0.7), yaw=0.5, tilt=0.7):
    """A pose in front of the camera: z of the part is `tilt` off the line towards the eye."""
    q = product(exp(np.array([np.pi - tilt, 0.0, 0.0])), exp(np.array([0.0, 0.0, yaw])))
    return np.concatenate((place, q))


def nudged(pose, rng, shift, turn):
    """A pose nearby: shifted and turned in its own frame by normal errors [m, rad]."""
    d, t = shift * rng.standard_normal(3), turn * rng.standard_normal(3)
    return np.concatenate((pose[:3] + rotate(pose[3:], d), product(pose[3:], exp(t))))


def points_of(depth, camera=CAMERA):
    x, y = camera.rays()
    v, u = np.nonzero(depth)
    z = depth[v, u]
    return np.stack((x[u] * z, y[v] * z, z))


def measured(part: Shapes, pose, sensor=SENSOR, rng=None, camera=CAMERA):
    """Points of the picture of a part that stands alone, and their depths' standard deviations."""
    depth, _ = render(part.moved(pose), camera)
    if rng is not None:
        depth = sense(depth, camera, sensor, rng)
    points = points_of(depth, camera)
    return points, sensor.sigma(points[2], camera)


def error(R, p, pose):
    """The six directions, in the part's frame, from the true pose to a found one [m, rad]."""
    true = to_matrix(pose[3:])
    return np.concatenate((true.T @ (p - pose[:3]), log(from_matrix(true.T @ R))))


def on_surface(half, count, rng):
    """Points of a box with half lengths (3,), and their normals."""
    half = np.asarray(half)
    faces = rng.choice(3, count, p=np.prod(half) / half / np.sum(np.prod(half) / half))
    normals = np.zeros((3, count))
    normals[faces, np.arange(count)] = rng.choice([-1.0, 1.0], count)
    points = rng.uniform(-1.0, 1.0, (3, count)) * half[:, None]
    return np.where(normals != 0.0, normals * half[:, None], points), normals


# The table that a camera looks down on, 0.8 m away.
TABLE = np.concatenate(((0.0, 0.0, 0.8), exp(np.array([np.pi - 0.6, 0.0, 0.0]))))


def on_table(parts, roll=0.0):
    """Table and parts (shape, x, y, height, yaw) in the camera's frame; and the parts' poses."""
    shapes, poses = [shape("plane").moved(TABLE)], []
    for part, x, y, z, yaw in parts:
        turn = product(exp(np.array([0.0, 0.0, yaw])), exp(np.array([roll, 0.0, 0.0])))
        at = np.concatenate(((x, y, z), turn))
        poses.append(compose(TABLE[:, None], at[:, None])[:, 0])
        shapes.append(part.moved(poses[-1]))
    return together(shapes), poses
