"""Worked answers of chapter 7, perception: complete, of the size of an interview."""

import numpy as np
from numpy.typing import ArrayLike


def back_project(
    picture: ArrayLike, fx: float, fy: float, cx: float, cy: float, unit: float
) -> np.ndarray:
    """Return the points that a depth picture shows, row by row.

    Args:
        picture: depth along z in counts, shape (H, W); 0 and NaN are no measurement.
        fx, fy: focal lengths [px].
        cx, cy: where the optical axis meets the picture [px].
        unit: length of a count [m].

    Returns:
        Points in the camera's frame, shape (3, n) [m].
    """
    depth = np.asarray(picture) * float(unit)
    v, u = np.nonzero(depth > 0.0)
    z = depth[v, u]
    x, y = (u - cx) / fx, (v - cy) / fy
    return np.array([x * z, y * z, z])


def rigid_fit(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return the least-squares rigid motion of paired points (Kabsch, 1978; Umeyama, 1991).

    Args:
        source, target: partners, shape (3, n) [m].
        weights: shape (n,), not negative.

    Returns:
        (R, p), the rotation and the shift of the least sum of w |R source + p - target|^2.
    """
    a, b, w = (np.asarray(value, dtype=float) for value in (source, target, weights))
    w = w / w.sum()
    start, end = a @ w, b @ w
    spread = (a - start[:, None]) * w @ (b - end[:, None]).T
    U, _, Vt = np.linalg.svd(spread)
    # Of a mirror image the direction that says least is turned back: that costs least.
    handed = np.sign(np.linalg.det(U @ Vt))
    R = Vt.T @ np.diag([1.0, 1.0, handed]) @ U.T
    return R, end - R @ start


def plane_ransac(
    points: ArrayLike, triples: ArrayLike, tolerance: float, confidence: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return the plane with most inliers, refitted to them (RANSAC, Fischler and Bolles, 1981).

    Args:
        points: shape (3, n) [m].
        triples: of indices, in the order in which they are to be tried, shape (m, 3).
        tolerance: largest distance of a point that is near [m].
        confidence: of having tried three points of the plane, below 1.

    Returns:
        (plane, near, tried): unit normal and offset; indices of near points; triples tried.
    """
    points = np.asarray(points, dtype=float)
    best, tried = np.zeros(0, dtype=int), 0
    for triple in np.asarray(triples):
        tried += 1
        a, b, c = points[:, triple].T
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal)
        if area > 0.0:
            distance = normal @ (points - a[:, None]) / area
            near = np.flatnonzero(np.abs(distance) <= tolerance)
            if len(near) > len(best):
                best = near
        share = len(best) / points.shape[1]
        if share == 1.0 or tried * np.log1p(-(share**3)) <= np.log1p(-confidence):
            break
    middle = points[:, best].mean(axis=1)
    U, _, _ = np.linalg.svd(points[:, best] - middle[:, None], full_matrices=False)
    normal = U[:, 2]
    plane = np.append(normal, -normal @ middle)
    return plane, np.flatnonzero(np.abs(plane[:3] @ points + plane[3]) <= tolerance), tried


def point_to_plane_step(
    points: ArrayLike, model: ArrayLike, normals: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return one step of ICP from points to planes (Chen and Medioni, 1992).

    Args:
        points: measured, shape (3, n) [m].
        model: points of the part, shape (3, k) [m].
        normals: of its surface there, unit vectors, shape (3, k).

    Returns:
        (R, p): the motion x -> R x + p of the measured points, rotation and shift [m].
    """
    points, model, normals = (np.asarray(v, dtype=float) for v in (points, model, normals))
    distance = np.linalg.norm(points[:, :, None] - model[:, None, :], axis=0)
    match = distance.argmin(axis=1)
    n = normals[:, match]
    gap = np.sum(n * (model[:, match] - points), axis=0)
    middle = points.mean(axis=1)
    arms = points - middle[:, None]
    # n . (t + w x arm) = n . t + (arm x n) . w
    rows = np.hstack((n.T, np.cross(arms.T, n.T)))
    t, w = np.split(np.linalg.lstsq(rows, gap, rcond=None)[0], 2)
    angle = np.linalg.norm(w)
    K = np.cross(np.eye(3), w)
    # Rodrigues; sinc so that no turn is no division by zero.
    half = np.sinc(angle / (2.0 * np.pi))
    R = np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * K @ K
    return R, middle - R @ middle + t


def dbscan(points: ArrayLike, eps: float, least: int) -> np.ndarray:
    """Return the cluster of each point (Ester, Kriegel, Sander and Xu, 1996), -1 for noise.

    Args:
        points: shape (3, n) [m].
        eps: largest distance of neighbours [m].
        least: neighbours of a core point, itself among them.

    Returns:
        Labels, shape (n,), numbered in the order of the clusters' first core points.
    """
    points = np.asarray(points, dtype=float)
    distance = np.linalg.norm(points[:, :, None] - points[:, None, :], axis=0)
    near = distance <= eps
    core = near.sum(axis=1) >= least
    labels, clusters = np.full(len(core), -1), 0
    for seed in np.flatnonzero(core):
        if labels[seed] >= 0:
            continue
        labels[seed], queue = clusters, [seed]
        while queue:  # only core points hand a cluster on
            for j in np.flatnonzero(near[queue.pop()] & core & (labels < 0)):
                labels[j] = clusters
                queue.append(j)
        clusters += 1
    for i in np.flatnonzero(~core & (near & core).any(axis=1)):
        labels[i] = labels[np.argmin(np.where(near[i] & core, distance[i], np.inf))]
    return labels


def blind_directions(
    points: ArrayLike, normals: ArrayLike, lever: float, least: float
) -> tuple[int, np.ndarray]:
    """Return the motions of a part that its measured points do not determine.

    Args:
        points: seen on the part, in its frame, shape (3, n) [m].
        normals: of its surface there, unit vectors, shape (3, n).
        lever: by which turns are made lengths [m/rad].
        least: of a seen unit motion, the root mean square gap along the normals.

    Returns:
        (count, projector) of the blind motions (shift, lever times turn), int and (6, 6).
    """
    x, n = (np.asarray(value, dtype=float).T for value in (points, normals))
    rows = np.hstack((n, np.cross(x, n) / lever))
    values, motions = np.linalg.eigh(rows.T @ rows / len(rows))
    blind = motions[:, values < least**2]
    return blind.shape[1], blind @ blind.T


def point_in_base(
    pixels: ArrayLike, stamp: float, camera: ArrayLike, mount: ArrayLike, log: ArrayLike
) -> np.ndarray:
    """Return the positions in the base of points that a moving camera saw.

    Args:
        pixels: columns (u, v, z), shape (3, n) [px, px, m].
        stamp: when the picture was exposed [s].
        camera: fx, fy, cx, cy [px].
        mount: x, y, z and turn about z of the camera in the flange's frame [m, rad].
        log: rows (time, x, y, z, turn about z) of the flange in the base, shape (m, 5).

    Returns:
        Points in the base, shape (3, n) [m].
    """
    u, v, z = np.asarray(pixels, dtype=float)
    fx, fy, cx, cy = np.asarray(camera, dtype=float)
    in_camera = np.array([(u - cx) / fx * z, (v - cy) / fy * z, z])
    rows = np.asarray(log, dtype=float).T
    rows = np.vstack((rows[:4], np.unwrap(rows[4])))
    flange = np.array([np.interp(stamp, rows[0], row) for row in rows[1:]])

    def moved(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
        c, s = np.cos(pose[3]), np.sin(pose[3])
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return R @ points + pose[:3, None]

    return moved(flange, moved(np.asarray(mount, dtype=float), in_camera))


def hopper_filter(
    force: ArrayLike,
    length: ArrayLike,
    offset: ArrayLike,
    contact: ArrayLike,
    start: ArrayLike,
    spread: ArrayLike,
    noise: ArrayLike,
    rest: float,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate height and vertical velocity of a one-legged hopper at every sample.

    Args:
        force: specific force, the mean over the interval that ends at the sample, shape (n,).
        length: leg encoder, shape (n,) [m].
        offset: horizontal distance from the hip to the foot, shape (n,) [m].
        contact: contact sensor, 0 or 1, late and sometimes wrong, shape (n,).
        start: expected height, velocity and bias at the first sample, shape (3,).
        spread: their standard deviations, shape (3,).
        noise: standard deviations of force and length, shape (2,).
        rest: length of the leg in flight [m].
        dt: time between samples [s].

    Returns:
        Height and velocity (n, 2), and their covariance (n, 2, 2).

    The state also contains the bias of the accelerometer. The leg carries load only while the foot
    touches, and the accelerometer shows this at once, so it replaces the contact sensor. A gate on
    the innovation rejects the readings for which even the load was misjudged.
    """
    force, length, offset, noise = (
        np.asarray(a, dtype=float) for a in (force, length, offset, noise)
    )
    x, P = np.array(start, dtype=float), np.diag(np.asarray(spread, dtype=float) ** 2)
    A = np.array([[1.0, dt, -0.5 * dt * dt], [0.0, 1.0, -dt], [0.0, 0.0, 1.0]])
    B = np.array([0.5 * dt * dt, dt, 0.0])
    Q = noise[0] ** 2 * np.outer(B, B)
    R = noise[1] ** 2
    estimates, covariances = np.zeros((force.size, 2)), np.zeros((force.size, 2, 2))
    for i in range(force.size):
        if i > 0:
            x = A @ x + B * (force[i] - 9.81)
            P = A @ P @ A.T + Q
        # In flight the specific force is zero but for bias and noise, both uncertain. One false
        # alarm of thousands of samples would lose the height for good, so the margin is wide.
        if force[i] - x[2] > 6.0 * np.sqrt(noise[0] ** 2 + P[2, 2]):
            expected = np.hypot(x[0], offset[i])
            H = np.array([x[0] / expected, 0.0, 0.0])
            S = H @ P @ H + R
            innovation = length[i] - expected
            if innovation**2 < 16.0 * S:
                K = P @ H / S
                x = x + K * innovation
                J = np.eye(3) - np.outer(K, H)
                P = J @ P @ J.T + R * np.outer(K, K)
        estimates[i], covariances[i] = x[:2], P[:2, :2]
    return estimates, covariances
