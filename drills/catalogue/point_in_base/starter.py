import numpy as np


def point_in_base(pixels, stamp, camera, mount, log):
    """Return the positions in the base of points that a moving camera saw, shape (3, n) [m]."""
    u, v, z = np.asarray(pixels, dtype=float)
    fx, fy, cx, cy = camera
    in_camera = np.array([(u + 0.5 - cx) / fx * z, (v + 0.5 - cy) / fy * z, z])
    rows = np.asarray(log, dtype=float).T
    rows = np.vstack((rows[:4], np.unwrap(rows[4])))
    flange = np.array([np.interp(stamp + 0.1, rows[0], row) for row in rows[1:]])

    def moved(pose, points):
        c, s = np.cos(pose[3]), np.sin(pose[3])
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return R @ points + pose[:3, None]

    turned = np.asarray(mount, dtype=float) * np.array([1.0, 1.0, 1.0, -1.0])
    return moved(flange, moved(turned, in_camera))
