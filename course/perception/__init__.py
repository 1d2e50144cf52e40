"""Chapter 7: perception. From a depth picture to the pose of a part, with an honest covariance.

A picture is an array (H, W) of depths along z [m], 0 where there is no measurement; the camera
looks along z, y is down. Points are columns, shape (3, N) [m]. A pose is
(x, y, z, qw, qx, qy, qz), components along axis 0. Each name lives in the file of its section.

The chapter's algorithms, and the functions of their steps:

- RANSAC (Fischler and Bolles, 1981): `cloud._ransac` samples, counts and stops, `fit_plane`
  refits.
- DBSCAN (Ester, Kriegel, Sander and Xu, 1996): `cloud._dbscan`: core points, joined cells, border
  points; `_near` lists the neighbouring cells.
- ICP (Besl and McKay, 1992; Chen and Medioni, 1992): `registration._icp` matches with
  `tree.nearest_row` or `_onto`, and moves with `rigid.rotation` (point to point) or `_solve` (point
  to plane).
- Absolute orientation (Kabsch, 1978; Umeyama, 1991): `rigid.rigid_fit`, whose core is `rotation`.
- Hand-eye calibration (Park and Martin, 1994): `calibrate.hand_eye`.

Examples:
    >>> from course import perception
    >>> import math
    >>> math.ceil(perception.draws_needed(share=0.5, confidence=0.99))  # of RANSAC for a plane
    35
"""

from course.perception.calibrate import Calibration, HandEye, camera_to_base, hand_eye, target_error
from course.perception.camera import (
    STEREO,
    Camera,
    Sensor,
    Shapes,
    render,
    sense,
    shape,
    together,
)
from course.perception.cloud import (
    back_project,
    components,
    dbscan,
    draws_needed,
    fit_plane,
    inverse_depth_plane,
    radius_search,
    ransac_plane,
    voxel_mean,
)
from course.perception.pose import Estimate, locate, pose_distance, see_through, stand_in
from course.perception.registration import Fit, icp, known
from course.perception.rigid import rigid_fit
from course.perception.track import Tracker, averaged_error, steady_gains
from course.perception.tree import Cloud

__all__ = [
    "STEREO",
    "Calibration",
    "Camera",
    "Cloud",
    "Estimate",
    "Fit",
    "HandEye",
    "Sensor",
    "Shapes",
    "Tracker",
    "averaged_error",
    "back_project",
    "camera_to_base",
    "components",
    "dbscan",
    "draws_needed",
    "fit_plane",
    "hand_eye",
    "icp",
    "inverse_depth_plane",
    "known",
    "locate",
    "pose_distance",
    "radius_search",
    "ransac_plane",
    "render",
    "rigid_fit",
    "see_through",
    "sense",
    "shape",
    "stand_in",
    "steady_gains",
    "target_error",
    "together",
    "voxel_mean",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    from course.perception import camera, cloud, linear, outline, pose, registration, rigid, tree

    for module in (camera, linear, cloud, tree, rigid, registration, outline, pose):
        module.warm()
