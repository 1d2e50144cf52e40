"""What each part promises, checked on its own calls while the robot runs.

A promise is a property that every correct answer has, whatever the method: points project back
onto their pixels, a gain satisfies the Riccati equation, a motion keeps its limits. None compares
with a worked answer, so a different and correct part breaks no promise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from drills.robot.cell import World, acceleration, clearance, tip_of
from drills.robot.records import Array

Args = tuple[Any, ...]
Promise = Callable[[Args, Any], str]


def _beyond(what: str, value: float, limit: float, unit: str = "") -> str:
    """Return the sentence on a broken promise, or nothing."""
    if value <= limit:
        return ""
    return f"{what}: off by {value:.3g}{unit and ' ' + unit}, allowed is {limit:.2g}"


def _first(*texts: str) -> str:
    return next((text for text in texts if text), "")


def back_project(args: Args, points: Any) -> str:
    """Check that points project back onto the measured pixels, in their order."""
    picture, fx, fy, cx, cy, unit = args
    v, u = np.nonzero(np.nan_to_num(picture) > 0.0)
    if points.shape[1] != u.size:
        return f"one point for each measured pixel: {points.shape[1]} points, {u.size} pixels"
    if not u.size:
        return ""
    depth = float(np.max(np.abs(points[2] - picture[v, u] * unit)))
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = fx * points[0] / points[2] + cx - u, fy * points[1] / points[2] + cy - v
    pixel = float(np.max(np.nan_to_num(np.hypot(x, y), nan=np.inf)))
    return _first(
        _beyond("depth of a point is that of its pixel", depth, 1e-9, "m"),
        _beyond("a point projects onto its pixel", pixel, 1e-6, "px"),
    )


def plane_ransac(args: Args, result: Any) -> str:
    """Check the plane: unit normal, least squares of its points, and that it is the table."""
    points, triples, tolerance, confidence = args
    plane, near, tried = result
    distance = plane[:3] @ points + plane[3]
    inside = np.flatnonzero(np.abs(distance) <= tolerance)
    close = np.abs(np.abs(distance) - tolerance) < 1e-9
    listed = np.unique(near).astype(int)
    if listed.size and not 0 <= listed[0] <= listed[-1] < points.shape[1]:
        return "the indices of near points exist: an index is out of range"
    differ = np.setxor1d(listed, inside)
    differ = differ[~close[differ]]
    if inside.size < 0.4 * points.shape[1]:
        text = f"most points lie near the table's plane: {inside.size} of {points.shape[1]} do"
        return (
            _beyond("normal of length 1", abs(float(np.linalg.norm(plane[:3])) - 1.0), 1e-6) or text
        )
    if not 1 <= tried <= len(triples):
        return f"the number of triples tried lies between 1 and {len(triples)}: it is {tried:g}"
    # Stop as soon as the confidence is reached, and not before. The refit may change the share.
    share = inside.size / points.shape[1]
    enough = math.log1p(-confidence) / math.log1p(-(min(share, 0.999999) ** 3))
    early = tried < len(triples) and tried < 0.7 * enough - 1.0
    late = tried > 2.5 * enough + 6.0
    middle = points[:, inside].mean(axis=1)
    scatter = (points[:, inside] - middle[:, None]) @ (points[:, inside] - middle[:, None]).T
    tilt = scatter @ plane[:3] - (plane[:3] @ scatter @ plane[:3]) * plane[:3]
    # The fit rests on those near the best triple, which differ a little from those near the fit.
    spread = float(np.linalg.norm(tilt)) / float(np.trace(scatter))
    mean = abs(float(np.mean(distance[inside])))
    return _first(
        _beyond("normal of length 1", abs(float(np.linalg.norm(plane[:3])) - 1.0), 1e-6),
        "" if not differ.size else f"the near points are listed: {differ.size} are wrong",
        _beyond("the plane fits its points by least squares", spread, 0.004),
        _beyond("the plane goes through the mean of its points", mean, 0.1 * tolerance, "m"),
        f"enough triples are tried, about {enough:.0f}: {tried:g} were" if early else "",
        f"the search stops when it is confident, after about {enough:.0f} triples: {tried:g} were"
        if late
        else "",
    )


def plane_ransac_rule(args: Args, result: Any) -> str:
    """Check the exercise's rule as well: the best triple so far decides when to stop."""
    points, triples, tolerance, confidence = args
    wrong = plane_ransac(args, result)
    if wrong:
        return wrong
    a, b, c = (points[:, triples[:, k]] for k in range(3))
    normals = np.cross((b - a).T, (c - a).T)
    sizes = np.linalg.norm(normals, axis=1)
    units = normals / np.where(sizes > 0.0, sizes, 1.0)[:, None]
    away = np.abs(units @ points - np.sum(units * a.T, axis=1)[:, None])
    counts = np.where(sizes > 0.0, np.sum(away <= tolerance, axis=1), 0)
    shares = np.minimum(np.maximum.accumulate(counts) / points.shape[1], 1.0 - 1e-12)
    tried = np.arange(1, len(triples) + 1)
    enough = tried * np.log1p(-(shares**3)) <= math.log1p(-confidence)
    last = int(tried[enough][0]) if enough.any() else len(triples)
    if round(float(result[2])) != last:
        return f"the search stops after {last} triples: it tried {result[2]:g}"
    # Least squares of the points near the best triple.
    near = points[:, away[int(np.argmax(counts[:last]))] <= tolerance]
    middle = near.mean(axis=1)
    normal = np.linalg.eigh((near - middle[:, None]) @ (near - middle[:, None]).T)[1][:, 0]
    tilt = float(np.linalg.norm(np.cross(normal, result[0][:3])))
    return _beyond("the plane is that of the best triple's points", tilt, 1e-5, "rad")


def dbscan(args: Args, labels: Any) -> str:
    """Check the definition: chains of core points are clusters, border points join one in reach."""
    points, eps, least = args
    if labels.size != points.shape[1]:
        return f"one label for each point: {labels.size} labels, {points.shape[1]} points"
    distance = np.linalg.norm(points[:, :, None] - points[:, None, :], axis=0)
    if np.any(np.abs(distance - eps) < 1e-9):
        return ""
    near = distance <= eps
    core = near.sum(axis=1) >= least
    # Connected components of the core points: the smallest number spreads.
    number = np.arange(core.size)
    both = near & core[:, None] & core[None, :]
    while True:
        spread = np.where(both, number[None, :], core.size).min(axis=1, initial=core.size)
        spread = np.where(core, np.minimum(spread, number), number)
        if np.array_equal(spread, number):
            break
        number = spread
    joined = labels[:, None] == labels[None, :]
    same = number[:, None] == number[None, :]
    pairs = core[:, None] & core[None, :]
    reached = (near & core[None, :]).any(axis=1)
    beside = (near & core[None, :] & joined).any(axis=1)
    if np.any(labels[core] < 0):
        return "a core point belongs to a cluster: one is labelled as noise"
    if np.any(pairs & same & ~joined):
        return "core points joined by a chain have the same label: two have not"
    if np.any(pairs & ~same & joined):
        return "core points that no chain of core points joins have different labels: two have not"
    if np.any(~core & reached & ~beside):
        return "a border point has the label of a core point in reach: one has not"
    if np.any(labels[~core & ~reached] != -1):
        return "a point that no core point reaches is noise, -1: one is not"
    return ""


def dbscan_rule(args: Args, labels: Any) -> str:
    """Check the definition of DBSCAN, and the two rules by which the exercise makes it unique.

    The definition (Ester et al., 1996) leaves two choices open: the cluster of a border point that
    several clusters reach, and the numbers of the clusters. The exercise demands the cluster of the
    nearest core point, and numbers from 0 in the order of each cluster's first core point.

    Args:
        args: points (3, N) [m], radius eps [m], and how many points within it, itself included,
            make a core point.
        labels: the answer, (N,): number of the cluster, -1 for noise.

    Returns:
        The sentence on the first broken promise; nothing if there is none, or if rounding decides.
    """
    points, eps, least = args
    wrong = dbscan(args, labels)
    distance = np.linalg.norm(points[:, :, None] - points[:, None, :], axis=0)
    # At a distance of eps to within rounding, a correct answer may count the point in or out.
    if wrong or np.any(np.abs(distance - eps) < 1e-9):
        return wrong
    near = distance <= eps
    core = near.sum(axis=1) >= least
    border = ~core & (near & core[None, :]).any(axis=1)
    # Two core points may be equally near, such as on a grid: then either label is right.
    reach = np.where(near & core[None, :], distance, np.inf)
    nearest = reach <= reach.min(axis=1, keepdims=True, initial=np.inf) + 1e-9
    allowed = (nearest & (labels[:, None] == labels[None, :])).any(axis=1)
    if np.any(border & ~allowed):
        return "a border point has the label of the nearest core point: one has not"
    clusters, first = np.unique(labels[core], return_index=True)
    if clusters.tolist() != list(range(len(clusters))) or np.any(np.diff(first) < 0):
        return "clusters are numbered from 0 in the order of their first core points: they are not"
    return ""


def _rotation(R: Array) -> str:
    wrong = float(np.max(np.abs(R.T @ R - np.eye(3))))
    if np.linalg.det(R) < 0.0 and wrong < 1e-6:
        return "R is a rotation: it is a mirror image"
    return _beyond("R is a rotation", wrong, 1e-7)


def rigid_fit(args: Args, result: Any) -> str:
    """Check the best rigid motion: means match, and the turned spread is symmetric."""
    source, target, weights = args
    R, p = result
    w = weights / weights.sum()
    a, b = source - (source @ w)[:, None], target - (target @ w)[:, None]
    spread = R @ ((a * w) @ b.T)
    size = float(np.trace((a * w) @ a.T) + np.trace((b * w) @ b.T))
    mean = float(np.linalg.norm(R @ (source @ w) + p - target @ w))
    skew = float(np.max(np.abs(spread - spread.T))) / size
    # Of the rotations that satisfy this the best one has the largest trace.
    values = np.linalg.svd(spread)[1]
    best = values[0] + values[1] + math.copysign(values[2], np.linalg.det(spread))
    return _first(
        _rotation(R),
        _beyond("the shift takes one mean to the other", mean, 1e-7, "m"),
        _beyond("no small turn makes the fit better", skew, 1e-7),
        _beyond(
            "no large turn makes the fit better", (best - float(np.trace(spread))) / size, 1e-7
        ),
    )


def point_to_plane_step(args: Args, result: Any) -> str:
    """Check that the step solves the linear least squares of point-to-plane ICP."""
    points, model, normals = args
    R, p = result
    wrong = _rotation(R)
    if wrong:
        return wrong
    distance = np.linalg.norm(points[:, :, None] - model[:, None, :], axis=0)
    order = np.partition(distance, 1, axis=1)
    match = distance.argmin(axis=1)
    if np.any(order[:, 1] - order[:, 0] < 1e-9):
        # Two model points are as near: both are right where their normals agree.
        alike = np.isclose(distance, order[:, :1], atol=1e-9)
        if any(np.ptp(normals[:, row], axis=1).max() > 1e-9 for row in alike):
            return ""
    n, gap = normals[:, match], np.sum(normals[:, match] * (model[:, match] - points), axis=0)
    middle = points.mean(axis=1)
    arms = (points - middle[:, None]).T
    rows = np.hstack((n.T, np.cross(arms, n.T)))
    # The rotation vector of R, and the shift of the mean.
    cosine = min(max(0.5 * (float(np.trace(R)) - 1.0), -1.0), 1.0)
    twist = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = 0.5 * float(np.linalg.norm(twist))
    w = 0.5 * twist * (math.atan2(sine, cosine) / sine if sine > 1e-12 else 1.0)
    t = R @ middle + p - middle
    gradient = rows.T @ (rows @ np.concatenate((t, w)) - gap)
    scale = np.linalg.norm(rows, axis=0) * (float(np.linalg.norm(gap)) + 1e-9)
    return _beyond(
        "the step solves its least squares", float(np.max(np.abs(gradient) / scale)), 1e-4
    )


def to_the_present(args: Args, result: Any) -> str:
    """Check the newest message's prediction, entry by entry."""
    states, covariances, captured, arrived, now, noise = args
    state, P = result
    here = np.flatnonzero(arrived <= now)
    if not here.size:
        return ""
    newest = here[np.argmax(captured[here])]
    T = now - captured[newest]
    x, C = states[newest], covariances[newest]
    moved = float(np.max(np.abs(state[:2] - (x[:2] + T * x[2:]))))
    drift = float(np.max(np.abs(state[2:] - x[2:])))
    scale = float(np.max(np.abs(C))) + noise * (T + T**3) + 1e-15
    worst = float(np.max(np.abs(P - P.T)))
    for i in (0, 1):
        var = C[i, i] + T * (C[i, i + 2] + C[i + 2, i]) + T * T * C[i + 2, i + 2]
        worst = max(worst, abs(P[i, i] - var - noise * T**3 / 3.0))
        worst = max(worst, abs(P[i + 2, i + 2] - C[i + 2, i + 2] - noise * T))
        cross = C[i, i + 2] + T * C[i + 2, i + 2] + 0.5 * noise * T * T
        worst = max(worst, abs(P[i, i + 2] - cross))
    return _first(
        _beyond("the newest position moves on by age times velocity", moved, 1e-9, "m"),
        _beyond("the velocity stays that of the newest message", drift, 1e-9, "m/s"),
        _beyond("the covariance grows by that of velocity and noise", worst / scale, 1e-9),
    )


def visual_gain(args: Args, result: Any) -> str:
    """Check limit and variance with the loop's own poles and impulse response."""
    gain, delay = args
    limit, variance = result

    def radius(g: float) -> float:
        # e[n+1] = e[n] - g e[n-d]: the roots of z^(d+1) - z^d + g.
        polynomial = np.zeros(delay + 2)
        polynomial[0], polynomial[1] = 1.0, -1.0
        polynomial[-1] += g
        return float(np.max(np.abs(np.roots(polynomial)), initial=0.0))

    if not limit > 0.0 or radius(0.99 * limit) >= 1.0 or radius(1.01 * limit) <= 1.0:
        return f"the limit separates loops that settle from others: {limit:.4g} does not"
    if gain >= limit:
        return "" if variance == -1.0 else "a loop that does not settle has the variance -1"
    errors = np.zeros(600)
    errors[0] = -gain
    for n in range(1, errors.size):
        errors[n] = errors[n - 1] - (gain * errors[n - 1 - delay] if n > delay else 0.0)
    true = float(errors @ errors)
    return _beyond("variance of the settled loop", abs(variance / true - 1.0), 1e-3)


def two_link_ik(args: Args, rows: Any) -> str:
    """Check both postures by forward kinematics."""
    lengths, target = args
    pair = (float(lengths[0]), float(lengths[1]))
    wrong = max(math.dist(tip_of(pair, q), target) for q in rows)
    bends = [math.remainder(q[1], math.tau) for q in rows]
    order = bends[0] >= -1e-6 and bends[1] <= 1e-6
    return _beyond("forward kinematics leads back to the target", wrong, 1e-7, "m") or (
        "" if order else "the first row bends the elbow to the left, the second to the right"
    )


def jacobian(args: Args, J: Any) -> str:
    """Check against difference quotients of the chain of transforms."""
    placements, q, tool = args

    def pose(angles: Array) -> tuple[Array, Array]:
        frame = np.eye(4)
        for placement, angle in zip(placements, angles, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            turn = np.eye(4)
            turn[:2, :2] = [[c, -s], [s, c]]
            frame = frame @ placement @ turn
        return frame[:3, :3] @ tool + frame[:3, 3], frame[:3, :3]

    worst, h, R = 0.0, 1e-5, pose(q)[1]
    for i in range(len(q)):
        step = np.zeros(len(q))
        step[i] = h
        (ahead, R1), (behind, R0) = pose(q + step), pose(q - step)
        W = (R1 - R0) / (2.0 * h) @ R.T
        column = np.concatenate(((ahead - behind) / (2.0 * h), [W[2, 1], W[0, 2], W[1, 0]]))
        worst = max(worst, float(np.max(np.abs(J[:, i] - column))))
    return _beyond("a column is what its joint does to the tool", worst, 1e-6, "m/rad")


def damped_step(args: Args, dq: Any) -> str:
    """Check the normal equations of damped least squares."""
    J, error, damping = args
    if dq.shape != (J.shape[1],):
        return f"a step for each joint: {dq.size} numbers"
    wrong = J.T @ (J @ dq - error) + damping**2 * dq
    scale = float(np.linalg.norm(J) * np.linalg.norm(error)) + 1e-12
    return _beyond("the step minimises its cost", float(np.max(np.abs(wrong))) / scale, 1e-7)


def edge_check(args: Args, share: Any) -> str:
    """Check with postures along the motion: free before the share, touching at it."""
    lengths, posts, a, b = args
    pair = (float(lengths[0]), float(lengths[1]))
    if not 0.0 <= share <= 1.0:
        return f"the share lies between 0 and 1: it is {share:.4g}"
    along = np.linspace(0.0, 1.0, 120)[:, None]
    gaps = clearance(pair, posts, a + share * along * (b - a))
    deepest = -float(np.min(gaps[:-1] if share < 1.0 else gaps, initial=np.inf))
    if deepest > 1e-6:
        return (
            f"the motion is free up to the share {share:.4g}: it goes {1e3 * deepest:.2g} mm deep"
        )
    if share < 1.0 and abs(gaps[-1]) > 1e-4:
        return (
            f"a post is touched at the share {share:.4g}: the gap is {1e3 * gaps[-1]:.2g} mm there"
        )
    return ""


def _touches(a: Array, b: Array, discs: Array) -> bool:
    along, offset = b - a, discs[:, :2] - a
    share = np.clip(offset @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    gap = offset - share[:, None] * along
    return bool(np.any(np.hypot(gap[:, 0], gap[:, 1]) < discs[:, 2] - 1e-9))


def _path(path: Array, ends: tuple[Array, Array], discs: Array) -> str:
    if not np.allclose(path[0], ends[0], atol=1e-9) or not np.allclose(
        path[-1], ends[1], atol=1e-9
    ):
        return "the path leads from the start to the goal: its ends differ"
    hits = [i for i in range(len(path) - 1) if _touches(path[i], path[i + 1], discs)]
    return f"no edge of the path touches a disc: edge {hits[0] + 1} does" if hits else ""


def rrt_connect(args: Args, result: Any) -> str:
    """Check the path: its ends, its edges, its steps; and the count of nodes."""
    start, goal, discs, _, step = args
    path, sizes = result
    if np.any(sizes < 1):
        return "each tree has a root"
    if not len(path):
        if not _touches(start, goal, discs):
            return "a goal in plain view is reached: no path came back"
        # Each sample adds at most one node to one tree, and connects with the other.
        return ""
    longest = float(np.max(np.linalg.norm(np.diff(path, axis=0), axis=1), initial=0.0))
    nodes = len(np.unique(np.round(path, 9), axis=0))
    return _first(
        _path(path, (start, goal), discs),
        _beyond("no edge is longer than the step", longest - step, 1e-9, "rad"),
        "no point appears twice in the path" if nodes < len(path) else "",
        "the trees hold the path: it has more points than they have nodes"
        if len(path) > sizes.sum() - 1
        else "",
    )


def rrt_connect_rule(args: Args, result: Any) -> str:
    """Check the exercise's rule as well: with the samples given, the trees can grow in one way."""
    start, goal, discs, samples, step = args
    wrong = rrt_connect(args, result)
    if wrong:
        return wrong
    trees = [[np.array(start)], [np.array(goal)]]

    def steps(tree: list[Array], target: Array, limit: int) -> bool:
        nodes = np.array(tree)
        here = nodes[int(np.argmin(np.hypot(*(nodes - target).T)))]
        for _ in range(limit):
            rest = target - here
            distance = math.hypot(*rest)
            expected = target if distance <= step else here + step / distance * rest
            if _touches(here, expected, discs):
                return False
            tree.append(expected)
            here = expected
            if distance <= step:
                return True
        return limit == 1

    for i, sample in enumerate(samples):
        one, other = trees[i % 2], trees[1 - i % 2]
        if steps(one, sample, 1) and steps(other, one[-1], 10_000):
            break
    grown = [len(tree) for tree in trees]
    if [round(float(n)) for n in result[1]] == grown:
        return ""
    had = " and ".join(f"{n:g}" for n in result[1])
    return f"the trees grow by the rule to {grown[0]} and {grown[1]} nodes: they have {had}"


def shortcut(args: Args, path: Any) -> str:
    """Check that the path keeps its ends, stays free and becomes no longer."""
    before, discs, _ = args
    if len(path) < 2:
        return "a path has two points or more"

    def length(points: Array) -> float:
        return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))

    longer = length(path) - length(before)
    return _first(
        _path(path, (before[0], before[-1]), discs),
        _beyond("the path becomes no longer", longer, 1e-9, "rad"),
    )


def shortcut_rule(args: Args, path: Any) -> str:
    """Check the exercise's rule as well: every draw whose edge is free is used, in their order."""
    before, discs, draws = args
    wrong = shortcut(args, path)
    if wrong:
        return wrong
    points = before
    for pair in draws:
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        low, high = np.sort(pair) * along[-1]
        i, j = (int(np.searchsorted(along, s, side="right")) for s in (low, high))
        if i == j:
            continue
        ends = [np.array([np.interp(s, along, points[:, k]) for k in (0, 1)]) for s in (low, high)]
        if not _touches(ends[0], ends[1], discs):
            points = np.vstack((points[:i], *ends, points[j:]))
    if len(points) != len(path):
        return f"the draws leave {len(points)} vertices: the path has {len(path)}"
    return _beyond("vertices are at the draws", float(np.max(np.abs(points - path))), 1e-7, "rad")


def trapezoid(args: Args, result: Any) -> str:
    """Check that the motion is straight, at rest at its ends, within its limits, and fast."""
    start, end, speed, limit, times = args
    duration, q, v = result
    move = end - start
    size = float(np.max(np.abs(move)))
    if size < 1e-12:
        return _beyond("a motion of no length takes no time", abs(duration), 1e-9, "s")
    # The fastest straight motion, by its closed form.
    ratios = np.abs(move) > 1e-12
    rate = float(np.min(speed[ratios] / np.abs(move[ratios])))
    push = float(np.min(limit[ratios] / np.abs(move[ratios])))
    fastest = 1.0 / rate + rate / push if rate * rate < push else 2.0 / math.sqrt(push)
    axis = int(np.argmax(np.abs(move)))
    s, ds = (q[axis] - start[axis]) / move[axis], v[axis] / move[axis]
    straight = float(np.max(np.abs(q - start[:, None] - move[:, None] * s)))
    also = float(np.max(np.abs(v - move[:, None] * ds)))
    slow = abs(duration - fastest) > 1e-7
    texts = [
        f"the motion takes {duration:.6g} s; the shortest time within the limits of speed and "
        f"acceleration is {fastest:.6g} s"
        if slow
        else "",
        _beyond("the joints stay on the straight line", max(straight, also), 1e-8, "rad"),
    ]
    late, early = times >= duration + 1e-12, times <= 0.0
    for mask, value, name in ((late, 1.0, "end"), (early, 0.0, "start")):
        if mask.any():
            deviation = float(np.max(np.abs(s[mask] - value)) + np.max(np.abs(ds[mask])))
            texts.append(_beyond(f"the arm rests at the {name}", deviation, 1e-7))
    step = np.diff(times)
    if times.size > 2 and np.all(step > 0.0):
        # Position is the integral of the rate: exact on a ramp or a plateau, close on its corners.
        integral = np.concatenate(([s[0]], s[0] + np.cumsum(0.5 * (ds[1:] + ds[:-1]) * step)))
        drift = float(np.max(np.abs(integral - s)))
        texts.append(
            _beyond("rates are those of the angles", drift, 2.0 * push * float(step[0]) ** 2)
        )
        over = float(np.max(np.abs(v) / speed[:, None])) - 1.0
        texts.append(_beyond("no joint exceeds its speed", over, 1e-7))
        bend = float(np.max(np.abs(np.diff(v, axis=1)) / step / limit[:, None])) - 1.0
        texts.append(_beyond("no joint exceeds its acceleration", bend, 1e-6))
    return _first(*texts)


def computed_torque(args: Args, tau: Any) -> str:
    """Check the closed loop: under the torques the error obeys e'' + kd e' + kp e = 0."""
    lengths, masses, gravity, q, v, reference, kp, kd = args
    world = World(tuple(lengths.tolist()), tuple(masses.tolist()))
    got = np.array(acceleration(world, gravity, tau, v, q))
    wish = reference[2] + kd * (reference[1] - v) + kp * (reference[0] - q)
    scale = float(np.max(np.abs(wish))) + 1.0
    return _beyond(
        "the joints accelerate as the gains demand", float(np.max(np.abs(got - wish))) / scale, 1e-6
    )


def lqr(args: Args, K: Any) -> str:
    """Check that the loop is stable, and that its gain is the best answer to its own cost."""
    A, B, Q, R = args
    closed = A - B @ K
    if float(np.max(np.abs(np.linalg.eigvals(closed)))) >= 1.0:
        return "the closed loop settles: it does not"
    # Cost of this loop, by doubling; then one step of policy iteration must change nothing.
    P, step = Q + K.T @ R @ K, closed
    for _ in range(60):
        P, step = P + step.T @ P @ step, step @ step
    better = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    wrong = float(np.max(np.abs(better - K))) / float(np.max(np.abs(K)))
    return _beyond("no other gain costs less", wrong, 1e-6)


def rnea_planar(args: Args, tau: Any) -> str:
    """Check inverse dynamics by forward dynamics: the torques cause the accelerations."""
    lengths, masses, q, v, a, gravity = args
    world = World(tuple(lengths.tolist()), tuple(masses.tolist()))
    got = np.array(acceleration(world, gravity, tau, v, q))
    scale = float(np.max(np.abs(a))) + 1.0
    wrong = float(np.max(np.abs(got - a))) / scale
    return _beyond("the torques cause the accelerations", wrong, 1e-7)


def friction_torque(args: Args, tau: Any) -> str:
    """Check what cancels friction, whatever the curve of its transition: direction and limits."""
    v, coulomb, viscous, transition = args
    # Along the motion: what is left without viscous friction cancels Coulomb friction.
    direction, ratio = np.sign(v), np.abs(v) / transition
    along = direction * tau
    dry = along - viscous * np.abs(v)
    # A concave curve with the slope 1 in the origin, which is tanh(1) at the transition speed.
    share = np.minimum(ratio, 1.0)
    least = np.maximum(math.tanh(1.0) * share, ratio * (1.0 - ratio**2 / 3.0))
    least = np.where(ratio >= 6.0, 1.0 - 2e-5, least)
    slack = 1e-9 * (1.0 + coulomb)
    return _first(
        _beyond("a joint at rest needs no torque", _largest(np.abs(tau[v == 0.0])), 1e-9, "N m"),
        _beyond(
            "the torque acts along with the motion, against friction",
            _largest(-along[v != 0.0]),
            1e-9,
            "N m",
        ),
        _beyond(
            "without viscous friction, at most Coulomb friction remains",
            _largest(dry - coulomb * share - slack),
            0.0,
            "N m",
        ),
        _beyond(
            "viscous friction and Coulomb friction are both cancelled",
            _largest(coulomb * least - dry - slack),
            0.0,
            "N m",
        ),
    )


def _largest(values: Array) -> float:
    return float(np.max(values, initial=0.0))


def friction_torque_rule(args: Args, tau: Any) -> str:
    """Check the exercise's curve as well: tanh, written with an exponential."""
    v, coulomb, viscous, transition = args
    wrong = friction_torque(args, tau)
    if wrong:
        return wrong
    fading = np.exp(-2.0 * np.abs(v) / transition)
    dry = coulomb * (1.0 - fading) / (1.0 + fading)
    away = np.abs(np.sign(v) * tau - dry - viscous * np.abs(v))
    return _beyond("Coulomb friction times tanh(v / transition)", _largest(away), 1e-9, "N m")


def contact_step(args: Args, result: Any) -> str:
    """Check the fall, the landing and the slide of a point by their closed forms."""
    position, velocity, slope, mu, dt, steps = args
    x, v = result
    pull, push = 9.81 * math.sin(slope), 9.81 * math.cos(slope)
    height, along, rate = float(position[1]), float(position[0]), float(velocity[0])
    fall = math.sqrt(2.0 * max(height, 0.0) / push)
    total = steps * dt
    if fall >= total or velocity[1]:
        return ""
    along, rate = along + rate * fall + 0.5 * pull * fall**2, rate + pull * fall
    # The landing is inelastic: its friction impulse is at most mu times the normal one.
    rate -= math.copysign(min(abs(rate), mu * push * fall), rate)
    remaining = total - fall
    brake = pull - math.copysign(mu * push, rate)
    if rate and brake * rate < 0.0:
        stop = min(-rate / brake, remaining)
        along, rate = along + rate * stop + 0.5 * brake * stop**2, rate + brake * stop
        remaining -= stop
    if not rate and pull > mu * push:
        excess = pull - mu * push
        along, rate = along + 0.5 * excess * remaining**2, excess * remaining
    slack = 4.0 * dt * (abs(rate) + pull * total * 0.2 + abs(float(velocity[0])) + 0.1)
    return _first(
        _beyond("the part rests on the table", abs(float(x[1])), 1e-4, "m"),
        _beyond("the part stops where friction stops it", abs(float(x[0]) - along), slack, "m"),
        _beyond("its speed at the end", abs(float(v[0]) - rate), 20.0 * dt, "m/s"),
    )


def contact_step_rule(args: Args, result: Any) -> str:
    """Check the exercise's scheme as well, step by step: gravity, normal impulse, friction."""
    position, velocity, slope, mu, dt, steps = args
    wrong = contact_step(args, result)
    if wrong:
        return wrong
    (x, height), (u, w) = (tuple(map(float, pair)) for pair in (position, velocity))
    for _ in range(int(steps)):
        u, w = u + dt * 9.81 * math.sin(slope), w - dt * 9.81 * math.cos(slope)
        push = max(0.0, -w - height / dt)
        u -= math.copysign(min(abs(u), mu * push), u)
        w += push
        x, height = x + dt * u, height + dt * w
    deviation = max(abs(float(result[0][0]) - x), abs(float(result[0][1]) - height))
    return _beyond("the scheme's own position at the end", deviation, 1e-8, "m")


def verlet(args: Args, result: Any) -> str:
    """Check that a step follows rates and accelerations to first order, whatever the method."""
    q, v, a, acceleration_of, dt = args
    new_q, new_v, new_a = result
    # The acceleration during the step lies between those of its ends, or a little beyond.
    change = np.abs(new_a - a) + 0.05 * np.abs(a) + 1e-6
    moved = float(np.max(np.abs(new_q - q - dt * v) - dt * dt * (np.abs(a) + change)))
    faster = float(np.max(np.abs(new_v - v - dt * a) - dt * change))
    wrong = float(np.max(np.abs(new_a - acceleration_of(new_q))))
    return _first(
        _beyond("the position moves by its rate", moved, 1e-12, "rad"),
        _beyond("the rate changes by the acceleration", faster, 1e-12, "rad/s"),
        _beyond("the new acceleration", wrong, 1e-8 * (float(np.max(np.abs(a))) + 1.0), "rad/s^2"),
    )


def verlet_rule(args: Args, result: Any) -> str:
    """Check the exercise's method: a Taylor series, and the mean of both accelerations."""
    q, v, a, acceleration_of, dt = args
    new_q, new_v, new_a = result
    new_acceleration = acceleration_of(new_q)
    scale = float(np.max(np.abs(a))) + 1.0
    return _first(
        _beyond(
            "the position moves by v dt + a dt^2 / 2",
            float(np.max(np.abs(new_q - q - dt * v - 0.5 * dt * dt * a))),
            1e-10 * (1.0 + scale),
            "rad",
        ),
        _beyond(
            "the velocity changes by the mean of both accelerations",
            float(np.max(np.abs(new_v - v - 0.5 * dt * (a + new_acceleration)))),
            1e-9 * (1.0 + scale),
            "rad/s",
        ),
        _beyond(
            "the new acceleration",
            float(np.max(np.abs(new_a - new_acceleration))),
            1e-8 * scale,
            "rad/s^2",
        ),
    )


PROMISES: dict[str, Promise] = {
    "back_project": back_project,
    "plane_ransac": plane_ransac,
    "dbscan": dbscan,
    "rigid_fit": rigid_fit,
    "point_to_plane_step": point_to_plane_step,
    "to_the_present": to_the_present,
    "visual_gain": visual_gain,
    "two_link_ik": two_link_ik,
    "jacobian": jacobian,
    "damped_step": damped_step,
    "edge_check": edge_check,
    "rrt_connect": rrt_connect,
    "shortcut": shortcut,
    "trapezoid": trapezoid,
    "computed_torque": computed_torque,
    "lqr": lqr,
    "rnea_planar": rnea_planar,
    "friction_torque": friction_torque,
    "contact_step": contact_step,
    "verlet": verlet,
}
# Of parts that answer the exercise; another planner has rules of its own.
RULES: dict[str, Promise] = {
    "plane_ransac": plane_ransac_rule,
    "rrt_connect": rrt_connect_rule,
    "shortcut": shortcut_rule,
    "friction_torque": friction_torque_rule,
    "contact_step": contact_step_rule,
    "dbscan": dbscan_rule,
    "verlet": verlet_rule,
}


def promises_of(slot: str, holder: str) -> Promise:
    """Return the promise of a slot's part: the exercise's rule too, unless it is a library's."""
    answers = holder in ("yours", "course") and slot in RULES
    return RULES[slot] if answers else PROMISES[slot]
