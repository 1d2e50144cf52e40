"""Chapter 7's simulation: a table under a depth camera, from the picture to the poses of parts.

The chain is that of `course.perception`. Each part is looked for in the cluster that has most of
its pixels, which the truth tells. One picture is processed in portions: the plane, the clusters,
then part by part.
"""

import math
import time

import numpy as np
from numba.extending import overload, register_jitable

from course.kinematics.chain import compose
from course.perception import camera
from course.perception.camera import STILL, Lens, Noise, Solids, depth_deviation, rays_of, view
from course.perception.cloud import (
    best_plane,
    connected,
    dense_clusters,
    heights,
    means_in_cells,
    plane_of_pixels,
    unproject,
)
from course.perception.linear import apply
from course.perception.pose import NONE, STANDING, STATUS, apart, settle, some_of
from course.perception.registration import DIRECTIONS
from course.perception.tree import nearest_in, tree_of
from course.rigid_body.quaternion import exp, from_matrix, to_matrix
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

CAMERA = Lens(160, 120, 300.0, 300.0, 79.5, 59.5)
BASELINE, TILT, RATE = 0.075, 0.6, 4.0  # [m]; of the table to the picture [rad]; pictures a second
PARTS, ROOM, EDGE = 6, 160 * 120, 49  # parts and points at most; points of an outline
NOTHING, BOX, CAN = range(3)
BELOW, PLANE, NOISE = -3, -2, -1  # kinds of points; from 0 on the number of a cluster
LOST = len(STATUS)
NOT_YET = LOST + 1  # a part that is still to be looked for
# What `told` holds, where the plane is in the table's frame, and `found` of each part.
PIXELS, VOXELS, ABOVE, CLUSTERED, CLUSTERS, NORMAL, OFF = 0, 1, 2, 3, 4, 5, 8
SHIFT, TURN, SHIFT_SIGMA, TURN_SIGMA, THROUGH, TRUST, X, Y, YAW = range(9)


def _placed(*pieces):
    """Return the field of parts.

    Kind, half lengths (of a can its radius twice), x, y [m], yaw [rad].
    """
    return np.array([*pieces, *[(0.0,) * 7] * (PARTS - len(pieces))])


_BLOCK, _THIN, _SMALL = (BOX, 0.04, 0.025, 0.02), (BOX, 0.04, 0.015, 0.003), (BOX, 0.02, 0.012)
_ROUND, _FLAT = (CAN, 0.025, 0.025, 0.03), (CAN, 0.035, 0.035, 0.009)
_THREE = (*_BLOCK, -0.08, 0.02, 0.5), (*_ROUND, 0.09, 0.07, 0.0), (*_FLAT, 0.08, -0.07, 0.0)
CONTROLS = Record(
    voxel=slider("Voxel size", 5.0, 2.0, 20.0, 0.5, "mm", 1),
    tolerance=slider("Plane tolerance", 8.0, 1.0, 30.0, 0.5, "mm", 1),
    eps=slider("DBSCAN eps", 15.0, 3.0, 50.0, 0.5, "mm", 1),
    least=slider("Neighbours", 12, 1, 80, 1),
    distance=slider("Camera distance", 0.8, 0.5, 1.5, 0.05, "m"),
    noise=slider("Noise", 0.05, 0.0, 0.3, 0.01, "px"),
    window=slider("Correlated over", 1, 1, 7, 1, "px"),
    scale=slider("Depth scale", 1.0, 0.98, 1.02, 0.005, "", 3),
    clusters=menu("Clusters by", ("DBSCAN", "pixels")),
    plane=menu("Plane by", ("RANSAC", "linear fit")),
    pick=menu("Picked", tuple(f"part {k + 1}" for k in range(PARTS)), live=True),
    pieces=Field(_placed(*_THREE), low=-4.0, high=4.0, unit="m, rad"),
)
STATE = Record(
    points=Field(0.0, shape=(3, ROOM), unit="m"),  # voxels in the table's frame
    kinds=Field(0, shape=(ROOM,)),
    report=Field(0.0, shape=(9,)),
    result=Field(0.0, shape=(PARTS, 9)),
    time=Field(0.0, unit="s"),
    # What the portions hand on: the picture, whose pixels are whose, their clusters, and the plane.
    remaining=Field(0),
    depths=Field(0.0, shape=(CAMERA.height, CAMERA.width), unit="m"),
    ids=Field(0, shape=(CAMERA.height, CAMERA.width)),
    labels=Field(0, shape=(ROOM,)),
    table=Field(0.0, shape=(4,)),
    held=Field(0),  # 1 the picked part, -1 its knob; 0 nothing
    grip=Field(0.0, shape=(2,), unit="m"),
)
MILLISECONDS: dict[str, float] = {}  # of each stage of the last picture


_MOBILE, _NO_STARTS = np.isin(DIRECTIONS, STANDING), np.zeros((0, 7))
_STARTS, _DRAWS, _CONFIDENCE = 4, 1000, 0.99  # turns of a part; of RANSAC
_FIRST = 1  # seed of the first image, which shows what most images show
_STAGES = ("grid", "plane", "clusters", "poses")
# When the last stage ended [s]. A dictionary, as what a stale module is recognised by counts lists.
_clock: dict[str, float] = {}


def _mark(stage, add=False):
    """Note how long a stage of the image took; a page in a browser has no clock for it."""
    now = time.perf_counter()
    if stage >= 0:
        before = MILLISECONDS[_STAGES[stage]] if add else 0.0
        MILLISECONDS[_STAGES[stage]] = before + 1e3 * (now - _clock["ended"])
    _clock["ended"] = now


@overload(_mark)
def _unmarked(stage, add=False):
    return lambda stage, add=False: None


@register_jitable
def scene(pieces, distance):
    """Return table and parts before the camera, the table's shape first."""
    # The camera looks down at the table, tilted; poses compose as table, then part on the table.
    chosen = np.flatnonzero(pieces[:, 0] != NOTHING)
    n = chosen.size + 1
    kinds, sizes, poses = np.full(n, camera.PLANE), np.zeros((3, n)), np.zeros((7, n))
    poses[2, 0] = distance
    poses[3:, 0] = exp(np.array([math.pi - TILT, 0.0, 0.0]))
    for i in range(1, n):
        p = pieces[chosen[i - 1]]
        stands = np.zeros(7)
        stands[0], stands[1], stands[2] = p[4], p[5], p[3]
        stands[3:] = exp(np.array([0.0, 0.0, p[6]]))
        poses[:, i] = compose(poses[:, 0], stands)
        sizes[:, i] = p[1:4]
        kinds[i] = camera.BOX
        if p[0] == CAN:
            kinds[i], sizes[1, i], sizes[2, i] = camera.CYLINDER, p[3], 0.0
    return Solids(kinds, sizes, poses)


@register_jitable
def part_of(shapes, i):
    """Return one of several shapes about its own origin."""
    sizes = np.empty((3, 1))
    sizes[:, 0] = shapes.sizes[:, i]
    return Solids(shapes.kinds[i : i + 1], sizes, STILL.reshape(7, 1).copy())


@register_jitable
def sensor_of(controls):
    """Return the sensor that the controls set."""
    return Noise(BASELINE, controls["noise"], controls["window"], 0.0, 0.0, 0.1, 10.0)


@register_jitable
def take_image(shapes, controls, picture):
    """Return depths (H, W) [m], numbers of the shapes (H, W) and the seed of what follows.

    The image's number is the seed of its noise: the same moment always gives the same image.
    """
    exact, ids = view(shapes, CAMERA)
    seed, more = np.full(1, np.uint64(picture + _FIRST)), controls["window"] - 1
    noise = np.empty((exact.shape[0] + more) * (exact.shape[1] + more))
    splitmix.normal(seed, noise)
    # Logarithm and cosine differ between libraries in digits far behind these.
    noise = np.rint(noise * 1048576.0) / 1048576.0
    noise = noise.reshape(exact.shape[0] + more, exact.shape[1] + more)
    noise = camera.shared_noise(noise, controls["window"])
    z = camera.measure(exact, noise, CAMERA, sensor_of(controls))
    return controls["scale"] * z, ids, seed


@register_jitable
def find_table(z, cells, tolerance, linear, seed):
    """Return the table, by one of two ways.

    For the fit what stands on it is left out, bit by bit.
    """
    if not linear:
        uniform = np.empty(3 * _DRAWS)
        splitmix.uniform(seed, uniform)
        triples = (uniform * cells.shape[1]).astype(np.int64).reshape(_DRAWS, 3)
        return best_plane(cells, tolerance, triples, math.log1p(-_CONFIDENCE), 1)[0]
    # The linear fit starts with all pixels and trims what is far from the plane, in narrowing
    # bands, as least squares has no resistance to outliers.
    x, y = rays_of(CAMERA)
    used = z > 0.0
    plane = plane_of_pixels(z, CAMERA, used)[0]
    for width in (8.0, 4.0, 2.0, 1.0):
        high = z * (plane[0] * x + plane[1] * y.reshape(y.size, 1) + plane[2]) + plane[3]
        near = used & (np.abs(high) < width * tolerance)
        if np.count_nonzero(near) > 100:
            plane = plane_of_pixels(z, CAMERA, near)[0]
    return plane


@register_jitable
def select(points, flags):
    """Return the points (3, M) that have a flag, of (3, N)."""
    numbers = np.flatnonzero(flags)
    some = np.empty((3, numbers.size))
    for x in range(3):
        some[x] = points[x][numbers]
    return some


@register_jitable
def nearest_of(points, queries):
    """Return the number of the point (3, N) nearest to each query (3, M)."""
    rows = points.T.copy()
    order, axes, cuts = tree_of(rows)
    return nearest_in((rows, order, axes, cuts), queries.T.copy(), math.inf)[1]


@register_jitable
def find_clusters(z, points, pixels, cells, above, over, controls):
    """Return the clusters of the voxels and of all pixels, -1 for none.

    Args:
        z: the image, (H, W) [m].
        points: of its pixels, (3, N) [m].
        pixels: their numbers, (N,).
        cells: voxel means, (3, M) [m].
        above: which of them are above the plane, (M,).
        over: which of the points are, (N,).
        controls: eps, least and clusters count.
    """
    kinds, labels = np.full(above.size, NOISE), np.full(z.size, NOISE)
    some, inner = select(cells, above), select(points, over)
    if some.shape[1] == 0 or inner.shape[1] == 0:
        return kinds, labels
    eps, least, own = 1e-3 * controls["eps"], controls["least"], pixels[over]
    # Connected components of the depth image: neighbours in the picture whose depths differ
    # little.
    if controls["clusters"] == 1:
        high = np.zeros(z.size)
        high[own] = inner[2]
        labels = connected(high.reshape(z.shape), eps).ravel()
        # Small components become noise, and the rest is numbered anew without gaps.
        enough = np.bincount(labels[labels >= 0]) >= least
        names = np.append(np.where(enough, np.cumsum(1 * enough) - 1, NOISE), NOISE)
        labels = names[np.where(labels >= 0, labels, names.size - 1)]
        # Each voxel gets the label of the point nearest to it; with DBSCAN (Ester et al., 1996)
        # it is the other way round.
        kinds[above] = labels[own][nearest_of(inner, some)]
    else:
        clusters = dense_clusters(some, eps, least)[0]
        kinds[above] = clusters
        labels[own] = clusters[nearest_of(some, inner)]
    return kinds, labels


@register_jitable
def judge_part(z, ids, labels, shapes, number, plane, on_table, sensor, row):
    """Write the row of a part's result: its pose against the truth, and what is said of it."""
    # The cluster that most of the part's own pixels belong to is judged as the part.
    votes = labels[(ids.ravel() == number) & (labels >= 0)]
    if votes.size == 0:
        return
    cluster = (labels == np.bincount(votes).argmax()).reshape(z.shape)
    # Refine the pose of the part from the points of its cluster; none of them, no pose.
    part = part_of(shapes, number)
    best = settle(z, CAMERA, sensor, part, cluster, plane, on_table, _MOBILE, _STARTS, _NO_STARTS)
    if best.status == NONE:
        return
    table = shapes.poses[:, 0]
    back = to_matrix(table[3:]).T
    pose = np.empty(7)
    pose[:3], pose[3:] = best.p, from_matrix(best.R)
    row[SHIFT], row[TURN] = apart(part, shapes.poses[:, number].copy(), pose)
    # Position and yaw with their deviations in theory, from the covariance of the estimate. An
    # infinite one means that nothing constrains this direction.
    C = np.diag(best.covariance)
    shift, turn = math.sqrt(C[0] + C[1] + C[2]), math.sqrt(C[5])
    row[SHIFT_SIGMA] = shift if shift < math.inf else -1.0
    row[TURN_SIGMA] = turn if turn < math.inf else -1.0
    row[THROUGH], row[TRUST] = best.through, best.status
    place, along = apply(back, best.p - table[:3]), apply(back, best.R[:, 0].copy())
    row[X], row[Y], row[YAW] = place[0], place[1], math.atan2(along[1], along[0])


@register_jitable
def measure(controls, state):
    """Take the picture of this moment and find the table in it; the rest follows in portions."""
    shapes = scene(controls["pieces"], controls["distance"])
    picture = math.floor(RATE * state["time"])
    z, ids, seed = take_image(shapes, controls, picture)
    state["depths"][:], state["ids"][:] = z, ids
    _mark(-1)
    # Pipeline: back-project the depth, average in voxels, fit the plane, cluster what lies above
    # it, estimate a pose for each cluster.
    points, pixels = unproject(z, CAMERA)
    cells, _ = means_in_cells(points, 1e-3 * controls["voxel"])
    _mark(0)
    tolerance = 1e-3 * controls["tolerance"]
    plane = find_table(z, cells, tolerance, controls["plane"] == 1, seed)
    height, n, kinds = heights(plane, cells), cells.shape[1], state["kinds"]
    _mark(1)
    above = height > tolerance
    kinds[:n] = np.where(above, NOISE, np.where(height < -tolerance, BELOW, PLANE))
    # The table's frame is known exactly here, so errors of the plane can be stated in it.
    table, report = shapes.poses[:, 0].copy(), state["report"]
    back = to_matrix(table[3:]).T
    report[PIXELS], report[VOXELS], report[ABOVE] = pixels.size, n, np.count_nonzero(above)
    report[CLUSTERED], report[CLUSTERS] = 0.0, 0.0
    report[NORMAL : NORMAL + 3] = apply(back, plane[:3])
    report[OFF] = heights(plane, table[:3])
    state["table"][:] = plane
    state["points"][:, :n] = apply(back, cells - table[:3].reshape(3, 1))
    # Nothing remains of a picture that had more voxels.
    state["points"][:, n:], kinds[n:] = 0.0, 0
    state["result"][:] = 0.0
    state["result"][:, TRUST] = NOT_YET
    state["remaining"] = 1 + PARTS


@register_jitable
def _cluster(controls, state):
    """Find the clusters in the picture of the state."""
    z, plane, tolerance = (
        state["depths"].copy(),
        state["table"].copy(),
        1e-3 * controls["tolerance"],
    )
    points, pixels = unproject(z, CAMERA)
    cells, _ = means_in_cells(points, 1e-3 * controls["voxel"])
    height, high = heights(plane, cells), heights(plane, points)
    _mark(-1)
    above = height > tolerance
    groups, labels = find_clusters(z, points, pixels, cells, above, high > tolerance, controls)
    _mark(2)
    state["labels"][:] = labels
    state["kinds"][: height.size][above] = groups[above]
    report = state["report"]
    report[CLUSTERED], report[CLUSTERS] = np.count_nonzero(groups >= 0), max(labels.max() + 1, 0)


@register_jitable
def _look_for(controls, state, k):
    """Look for a part in the picture of the state."""
    row, number = state["result"][k], np.count_nonzero(controls["pieces"][: k + 1, 0] != NOTHING)
    row[TRUST] = LOST
    if controls["pieces"][k, 0] == NOTHING:
        return
    _mark(-1)
    shapes, sensor = scene(controls["pieces"], controls["distance"]), sensor_of(controls)
    z, plane = state["depths"].copy(), state["table"].copy()
    points, _ = unproject(z, CAMERA)
    on = select(points, np.abs(heights(plane, points)) < 1e-3 * controls["tolerance"])
    on_table = some_of(on, np.maximum(depth_deviation(on[2], CAMERA, sensor), 1e-7))
    ids, labels = state["ids"].copy(), state["labels"].copy()
    judge_part(z, ids, labels, shapes, number, plane, on_table, sensor, row)
    _mark(3, number > 1)


@register_jitable
def complete(controls, state):
    """Find the clusters, then one part after another."""
    if state["remaining"] > PARTS:
        _cluster(controls, state)
    else:
        _look_for(controls, state, PARTS - state["remaining"])
    state["remaining"] -= 1
    # Nothing has to be computed for places without a part.
    while 0 < state["remaining"] <= PARTS:
        k = PARTS - state["remaining"]
        if controls["pieces"][k, 0] != NOTHING:
            break
        state["result"][k, TRUST] = LOST
        state["remaining"] -= 1


def advance(state, controls, seconds):
    """Advance the simulation: the camera takes pictures at its rate; the newest one counts."""
    before = math.floor(RATE * state["time"])
    state["time"] += seconds
    # A new picture only when its time has come; several missed ones are one. While one is still
    # being processed, none is taken.
    if math.floor(RATE * state["time"]) > before and state["remaining"] == 0:
        measure(controls, state)


def spent():
    """Return the computing times of the last image as a text."""
    return "one picture: " + ", ".join(f"{stage} {ms:.1f} ms" for stage, ms in MILLISECONDS.items())


TITLE = "A table under a depth camera"
word, colour = draw.words_table(), draw.colours_table()
_SKY, _GOLD, _PINK, _SAND, _PALE, _STONE = colour(
    "#56b4e9", "#e69f00", "#cc79a7", "#f7f5ef", "#d4d4d4", "#9a9a9a"
)
_INKS = (_PALE, _STONE, draw.INK, draw.BLUE, _GOLD, _PINK, _SKY, draw.PURPLE)  # from BELOW on
_FOUND = (draw.GREEN, draw.ORANGE, draw.ORANGE, draw.RED)
_TRUST = word(*STATUS, "lost", "being looked for")[0]
_COUNTS = word("pixels measured", "voxels", "above the plane", "in clusters", "clusters")[0]
_PLANE_OFF, _PICKED, _MM, _AND, _DEGREES, _PERCENT, _BLIND, _NONE = word(
    "plane is off", "picked part", " mm", ", ", "°", " %", "not seen", "none"
)
_OF_PART = word("error, place", "error, turn", "predicted", "predicted turn", "see-through")[0]
_UNITS = ((1e3, _MM), (180.0 / math.pi, _DEGREES)) * 2 + ((100.0, _PERCENT),)
_Y, _HEIGHT, _SIDE, _TOP = word("y [m]", "height [mm]", "from the side", "from above")
_KEYS = word("below", "plane", "noise", "a cluster", "true", "found")[0]
_SCENE, _VIEW = (0.1, 5.6, 0.1, 4.6), (-0.32, 0.32, -0.23, 0.2936)
_PROFILE, _HEIGHTS = (6.25, 8.85, 2.5, 4.4), (-0.23, 0.2936, -30.0, 90.0)


@register_jitable
def _outline(pen, p, x, y, yaw, ink, width, on):
    """Draw a part from above, dashed or not."""
    c, s = math.cos(yaw), math.sin(yaw)
    t = np.linspace(0.0, 2.0 * math.pi, EDGE)
    # A square from a circle: dividing by the larger of |cos| and |sin| puts the points on its
    # sides.
    wide = np.maximum(np.abs(np.cos(t)), np.abs(np.sin(t))) if p[0] == BOX else np.ones(EDGE)
    a, b = p[1] * np.cos(t) / wide, p[2] * np.sin(t) / wide
    draw.curve(pen, x + c * a - s * b, y + s * a + c * b, ink, width, 1.0, on, 4.0)


@register_jitable
def _dots(pen, kinds, x, y, radius):
    """Points by their kinds, as small discs: one item a colour, however many they are."""
    # Clusters beyond the number of colours take the same colours again.
    count = len(_INKS) + BELOW
    for k in range(len(_INKS)):
        some = (kinds == k + BELOW) if k < -BELOW else ((kinds >= 0) & (kinds % count == k + BELOW))
        draw.disc(pen, radius, _INKS[k])
        draw.points(pen, x[some], y[some])


@register_jitable
def _knob(p):
    """Return where one takes a part to turn it."""
    far = p[1] + 0.022
    return p[4] + far * math.cos(p[6]), p[5] + far * math.sin(p[6])


def frame(pen, state, controls):
    """Draw points from above and from the side, true and found outlines, keys and numbers."""
    report, pieces, pick = state["report"], controls["pieces"], controls["pick"]
    n, result = int(report[VOXELS]), state["result"][pick]
    # From above: voxels in the colours of their clusters, true outlines dashed, estimates drawn
    # through.
    x, y, z = state["points"][0, :n], state["points"][1, :n], state["points"][2, :n]
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, *_VIEW, _SAND, draw.GREY)
    draw.title(pen, _VIEW[0], _VIEW[3], _TOP)
    _dots(pen, state["kinds"][:n], x, y, 0.0022)
    for k in range(PARTS):
        p, at = pieces[k], state["result"][k]
        if p[0] != NOTHING:
            _outline(pen, p, p[4], p[5], p[6], draw.INK, 1.6, 5.0)
            if at[TRUST] < LOST:
                ink, width = _FOUND[int(at[TRUST])], 3.4 if k == pick else 2.0
                _outline(pen, p, at[X], at[Y], at[YAW], ink, width, 0.0)
    # The picked part's handle for turning it.
    if pieces[pick, 0] != NOTHING:
        u, v = _knob(pieces[pick])
        draw.segment(pen, pieces[pick, 4], pieces[pick, 5], u, v, draw.INK, 1.2)
        draw.spot(pen, u, v, 0.006, _GOLD, draw.INK)
    draw.area(pen, _PROFILE, _HEIGHTS)
    draw.axes(pen, _Y, _HEIGHT, _SIDE, 4, 4)
    _dots(pen, state["kinds"][:n:2], y[::2], 1e3 * z[::2], 0.0034)  # half of them are enough
    for k in range(3):  # the plane, and what counts as on it
        up, slope = (k - 1) * controls["tolerance"] - 1e3 * report[OFF], -1e3 * report[NORMAL + 1]
        draw.segment(
            pen,
            _VIEW[2],
            up + slope * _VIEW[2],
            _VIEW[3],
            up + slope * _VIEW[3],
            draw.RED,
            1.2,
            1.0,
            4.0 * (k != 1),
            3.0,
        )
    draw.window(pen)
    for k in range(6):
        ink, width, on = (*_INKS[:4], draw.INK, draw.GREEN)[k], 5.0 - k // 4 * 2.8, 5.0 * (k == 4)
        x0, y0 = 6.2 + 1.5 * (k % 2), 1.3 - 0.35 * (k // 2)
        draw.key(pen, x0, y0, _KEYS + k, ink, width, 1.0, on, 4.0)
    for k in range(5):
        draw.reading(pen, _COUNTS + k, report[k], 0)
    draw.reading(pen, _PLANE_OFF, 1e3 * abs(report[OFF]), 1, _MM)
    draw.words(pen, _AND)
    # Rounding may take the cosine just above 1.
    draw.number(pen, math.degrees(math.acos(min(report[NORMAL + 2], 1.0))), 1, _DEGREES)
    draw.reading(pen, _PICKED, 0.0, 0, 0, _TRUST + int(result[TRUST]))
    for k in (SHIFT, SHIFT_SIGMA, TURN, TURN_SIGMA, THROUGH):
        instead = _NONE if result[TRUST] >= LOST else (_BLIND if result[k] < 0.0 else 0)
        draw.reading(pen, _OF_PART + k, _UNITS[k][0] * result[k], 2, _UNITS[k][1], instead)


@register_jitable
def _put(controls, state, x, y, yaw):
    """Move the picked part to a place, and take a new picture."""
    # Parts stay on the visible table; the angle wraps to half a turn.
    p = controls["pieces"][controls["pick"]]
    p[4], p[5] = min(max(x, _VIEW[0]), _VIEW[1]), min(max(y, _VIEW[2]), _VIEW[3])
    p[6] = (yaw + math.pi) % (2.0 * math.pi) - math.pi
    measure(controls, state)


def grab(controls, state, x, y):
    """Handle a press of the pointer: grab the picked part's knob, or a part.

    A press on the bare table starts a thin one.
    """
    u, v = draw.values_at(_SCENE, _VIEW, x, y)
    state["held"], pieces, vacant = 0, controls["pieces"], -1
    a, b = _knob(pieces[controls["pick"]])
    for k in range(PARTS - 1, -1, -1):
        p = pieces[k]
        if p[0] == NOTHING:
            vacant = k
        elif math.hypot(p[4] - u, p[5] - v) < max(p[1], p[2]):
            controls["pick"], state["held"] = k, 1
    if math.hypot(a - u, b - v) < 0.015 and pieces[controls["pick"], 0] != NOTHING:
        state["held"] = -1
    elif state["held"] == 0 and vacant >= 0 and x < _SCENE[1]:
        pieces[vacant, :4], pieces[vacant, 4], pieces[vacant, 5] = np.array(_THIN), u, v
        controls["pick"], state["held"] = vacant, 1
    # The offset of the pointer is preserved, so that the part does not jump to it.
    state["grip"][:] = pieces[controls["pick"], 4:6] - np.array([u, v])


def drag(controls, state, x, y):
    """Handle a drag: what is in hand follows the pointer, or turns to it."""
    u, v = draw.values_at(_SCENE, _VIEW, x, y)
    p = controls["pieces"][controls["pick"]]
    if state["held"] > 0:
        _put(controls, state, u + state["grip"][0], v + state["grip"][1], p[6])
    elif state["held"] < 0:
        _put(controls, state, p[4], p[5], math.atan2(v - p[5], u - p[4]))


def press(controls, state, key):
    """Handle a key: arrows move the picked part by 5 mm, + and - turn it by 5 degrees."""
    p = controls["pieces"][controls["pick"]]
    dx, dy = 0.005 * ((key == 1) - (key == 0)), 0.005 * ((key == 2) - (key == 3))
    turn = math.radians(5.0) * ((key == 4) - (key == 5))
    _put(controls, state, p[4] + dx, p[5] + dy, p[6] + turn)


PRESETS = {
    "Clean": Preset(
        {},
        "Dashed is the truth. Drag a part, turn it by its knob, click on the bare "
        "table for a thin one; arrows, + and - do it too. Then play: new noise in each picture.",
    ),
    "Small parts lost": Preset(
        {
            "tolerance": 10.0,
            "least": 50,
            "eps": 17.0,
            "pieces": _placed(
                (*_SMALL, 0.003, -0.1, 0.07, 0.5),
                (*_SMALL, 0.006, -0.1, -0.06, 0.5),
                (*_SMALL, 0.008, 0.0, 0.07, 0.9),
                (*_SMALL, 0.01, 0.0, -0.08, 0.3),
                (*_BLOCK, 0.1, 0.0, 0.3),
            ),
        },
        "The plane takes the lowest; the others have too few neighbours for a cluster, in about "
        "three of four images. Take 4 mm and 12: all are found. Then raise the noise, and see "
        "what that asks of the table.",
    ),
    "Table in clusters": Preset(
        {"tolerance": 3.0, "noise": 0.1, "window": 3},
        "Tighter than the "
        "noise: the bare table stands above the plane, in lumps where the noise is correlated. "
        "8 mm cure it, and take the thin parts along.",
    ),
    "Touching": Preset(
        {"pieces": _placed((*_BLOCK, -0.03, 0.0, 0.0), (*_BLOCK, 0.051, 0.0, 0.0))},
        "Two parts, one cluster, and the same pose fits anywhere along it. Nothing is seen through "
        "it; what tells is how much it leaves over: ambiguous. Pull them apart.",
    ),
    "Cut off": Preset(
        {"pieces": _placed((*_BLOCK, 0.22, 0.0, -0.9), (*_ROUND, -0.08, 0.05, 0.0))},
        "What is left in the picture also fits a part that lies across, and nothing is seen "
        "through it. What warns is the picture's edge: cut. Pull the part in.",
    ),
    "Symmetric part": Preset(
        {"pieces": _placed((*_ROUND, -0.06, 0.03, 0.0), (*_BLOCK, 0.08, 0.0, 0.4))},
        "The picture is the same however the can is turned, so its turn is not seen: the variance "
        "is infinite, not just large. Pick part 2.",
    ),
    "Two planes": Preset(
        {"pieces": _placed((*_BLOCK, -0.1, 0.0, 0.4), (BOX, 0.12, 0.16, 0.012, 0.12, 0.03, 0.0))},
        "A plate of 24 mm beside the table: a plane "
        "that slants through both has most points within 8 mm, and in about two of three images "
        "the block's pose is then refuted. Take 4 mm; then the linear fit.",
    ),
    "Scale error": Preset(
        {"scale": 1.01},
        "Depths 1 % too long: each pose is about 8 mm off, with "
        "less than 0.1 mm predicted and nothing seen through. Only a length known from "
        "outside tells, or the outline once it is off by a pixel.",
    ),
    "Close, too short": Preset(
        {"distance": 0.5, "scale": 0.99},
        "At 0.5 m, with depths 1 % too "
        "short, the part is about 5 mm off; at 0.8 m an error of 1 % costs 8 mm. Only a shorter "
        "distance or a calibrated scale reduces it.",
    ),
    "Far away": Preset(
        {"distance": 1.4, "noise": 0.2},
        "The error of a depth grows with the "
        "square of the distance. At 1.4 m with this noise, parts of the bare table stand above "
        "the plane and form clusters of their own, and a position is millimetres off.",
    ),
    "Far, correlated": Preset(
        {"distance": 1.4, "noise": 0.2, "window": 7},
        "The same noise, "
        "correlated over 7 pixels, does not average out within a voxel: it makes dozens of "
        "clusters out of a table with three parts.",
    ),
    "Coarse voxels": Preset(
        {"voxel": 15.0},
        "Voxels of 15 mm leave so few points that none has "
        "12 neighbours within 15 mm: no cluster forms, and all parts are lost.",
    ),
    "Coarse, wider search": Preset(
        {"voxel": 10.0, "eps": 40.0, "least": 4},
        "With voxels of "
        "10 mm, 4 neighbours within 40 mm are enough for a cluster: all three parts are found "
        "again. Parts closer together than 40 mm would now be one cluster.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "pixels measured": "Pixels of the depth image with a valid measurement.",
    "voxels": "Points left after averaging within each voxel.",
    "above the plane": "Points that are farther above the fitted table than the plane tolerance.",
    "in clusters": "Points that DBSCAN assigns to a cluster. The others count as noise.",
    "clusters": "Clusters found.",
    "plane is off": "Error of the fitted table plane: distance and angle.",
    "picked part": "What the pipeline reports about the selected part.",
    "error, place": "Distance between the estimated and the true position of the selected part.",
    "predicted": "Standard deviation of the position that the method predicts for itself.",
    "error, turn": "Angle between the estimated and the true orientation of the selected part.",
    "predicted turn": "Standard deviation of the orientation that the method predicts for itself.",
    "see-through": (
        "Fraction of pixels that look through the part in its estimated pose. A correct pose has "
        "nearly none."
    ),
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour, room=280_000),
    CONTROLS,
    STATE,
    PRESETS,
    measure,
    advance,
    frame,
    drag,
    grab,
    press,
    live_drag=True,
    complete=complete,
    aside=spent,
    readouts=READOUTS,
)
