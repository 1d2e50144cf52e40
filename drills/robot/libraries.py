"""Parts that call a library for the same job."""

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
    "dbscan": {
        "open3d": """
import numpy as np
import open3d as o3d


def dbscan(points, eps, least):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.T))
    return np.asarray(cloud.cluster_dbscan(eps, int(least)))
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
