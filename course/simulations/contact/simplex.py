"""GJK and EPA in the plane, one iteration at a time, in the Minkowski difference of two polygons.

The GJK is that of `course.contact.narrow`, stopped after each of its iterations. Its EPA works on
triangles in space; in the plane the polytope is a polygon and its faces are edges.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.contact.narrow import _A, _EPS, _P, _R, _SIZE, _gjk, _support
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

# Corners in the frames of the shapes, counter-clockwise, (3, n) [m].
A_SHAPE = np.array(
    [[0.5, 0.15, -0.4, -0.55, 0.1], [0.05, 0.5, 0.35, -0.25, -0.5], [0.0, 0.0, 0.0, 0.0, 0.0]]
)
B_SHAPES = (
    np.array([[0.5, -0.35, -0.2], [0.0, 0.4, -0.45], [0.0, 0.0, 0.0]]),
    np.array([[0.4, 0.4, -0.4, -0.4], [-0.3, 0.3, 0.3, -0.3], [0.0] * 4]),
    np.array(
        [[0.45, 0.1, -0.35, -0.45, -0.1, 0.3], [0.1, 0.42, 0.3, -0.1, -0.42, -0.32], [0.0] * 6]
    ),
)
_NAMES = ("triangle", "rectangle", "hexagon")
_REACH = 0.95  # of the centre of b along each axis [m]
LAST = 24  # steps on the slider
_PACE = 1.0  # s from one step to the next
_CORNERS = 32  # room of EPA's polygon, more than the Minkowski difference has corners

CONTROLS = Record(
    step=slider("Step", 0, 0, LAST, 1),
    shape=menu("Shape B", _NAMES),
    turn=slider("Turn of B", 20.0, -180.0, 180.0, 5.0, "°", 0),
    position=Field((0.95, 0.45), low=-_REACH, high=_REACH, unit="m"),
)
STATE = Record(time=Field(0.0, unit="s"))


@register_jitable
def pair_of(controls, vb):
    """Return what `narrow` keeps of a pair of shapes: that of polygons without thickness (28,)."""
    pair = np.zeros(28)
    angle = math.radians(controls["turn"])
    c, s = math.cos(angle), math.sin(angle)
    x, y = controls["position"][0], controls["position"][1]
    pair[_A : _A + 6] = 0.0
    # The pose of b in the frame of a: position and rotation in the plane, embedded in three
    # dimensions.
    pair[_P], pair[_P + 1] = x, y
    pair[_R], pair[_R + 1], pair[_R + 3], pair[_R + 4], pair[_R + 8] = c, -s, s, c, 1.0
    # A bound on the extent of the Minkowski difference: tolerances for rounding are relative to it.
    size = math.hypot(x, y)
    size += math.sqrt(np.max(A_SHAPE[0] ** 2 + A_SHAPE[1] ** 2))
    pair[_SIZE] = size + math.sqrt(np.max(vb[0] ** 2 + vb[1] ** 2))
    return pair


@register_jitable
def gjk(vb, pair, most):
    """Return the simplex after at most `most` iterations.

    Returns:
        Rows (8, 9) as in `narrow`, the shares of the nearest point (4,), how many rows there are,
        the distance of the nearest point [m], its lower bound, and the iterations made.
    """
    s, share = np.zeros((8, 9)), np.zeros(4)
    n, core, low, count, _ = _gjk(A_SHAPE, vb, pair, s, share, most)
    return s, share, n, core, low, count


@register_jitable
def nearest(s, share, n):
    """Return the nearest point of the simplex (x, y), then its points on both shapes, (6,)."""
    result = np.zeros(6)
    # The nearest point as a convex combination of the simplex's corners (barycentric coordinates);
    # the same shares give the witness points on both shapes.
    for i in range(n):
        for k in range(3):
            result[2 * k] += share[i] * s[i, 3 * k]
            result[2 * k + 1] += share[i] * s[i, 3 * k + 1]
    return result


@register_jitable
def overlap(pair, core):
    """Return whether GJK has found the origin inside: no distance is left but rounding."""
    # The square of the distance to an interior point cancels to rounding, which scales with the
    # size.
    return core <= 40.0 * _EPS * pair[_SIZE]


@register_jitable
def _add(polygon, count, at, row):
    """Insert a row into the polygon before the corner `at`, unless a corner is there already."""
    for i in range(count):
        if polygon[i, 0] == row[0] and polygon[i, 1] == row[1]:
            return count
    for i in range(count, at, -1):
        polygon[i] = polygon[i - 1]
    polygon[at] = row
    return count + 1


@register_jitable
def _first_polygon(vb, pair, s, n, polygon):
    """Write the polygon that EPA starts from, counter-clockwise; return how many corners it has."""
    count = 0
    if n == 2:
        # The origin lies on this edge: add what lies farthest to either side of it.
        ex, ey = s[1, 0] - s[0, 0], s[1, 1] - s[0, 1]
        _support((ey, -ex, 0.0), A_SHAPE, vb, pair, s, 2)
        _support((-ey, ex, 0.0), A_SHAPE, vb, pair, s, 3)
        for k in (0, 2, 1, 3):
            count = _add(polygon, count, count, s[k])
        return count
    for k in range(n):
        count = _add(polygon, count, count, s[k])
    # EPA needs outward normals, hence a counter-clockwise order: a negative cross product swaps two
    # corners.
    if count == 3:
        ax, ay = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1]
        bx, by = polygon[2, 0] - polygon[0, 0], polygon[2, 1] - polygon[0, 1]
        if ax * by - ay * bx < 0.0:
            middle = polygon[1].copy()
            polygon[1] = polygon[2]
            polygon[2] = middle
    return count


@register_jitable
def nearest_edge(polygon, count):
    """Return the edge nearest to the origin.

    Returns:
        Its first corner, its distance from the origin [m] and its outward unit normal (x, y).
    """
    best, far, normal = 0, math.inf, (1.0, 0.0)
    for i in range(count):
        j = (i + 1) % count
        ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
        length = math.hypot(ex, ey)
        if length > 0.0:
            # The outward normal of a counter-clockwise edge; an edge of no length has none.
            nx, ny = ey / length, -ex / length
            here = nx * polygon[i, 0] + ny * polygon[i, 1]
            if here < far:
                best, far, normal = i, here, (nx, ny)
    return best, far, normal


@register_jitable
def epa(vb, pair, s, n, most):
    """Return EPA's polygon after at most `most` expansions, from GJK's last simplex.

    Returns:
        Corners as rows (_CORNERS, 9), how many there are, how many expansions were made, and
        whether it has ended: no point of the difference lies beyond its nearest edge.
    """
    polygon = np.zeros((_CORNERS, 9))
    count = _first_polygon(vb, pair, s, n, polygon)
    made, rounding = 0, 16.0 * _EPS * pair[_SIZE]
    new = np.zeros((1, 9))
    while count >= 3:
        # Expanding polytope algorithm (van den Bergen, 2001): the support point beyond the nearest
        # edge replaces this edge by two; without progress the edge is on the boundary.
        i, far, normal = nearest_edge(polygon, count)
        _support((normal[0], normal[1], 0.0), A_SHAPE, vb, pair, new, 0)
        beyond = normal[0] * new[0, 0] + normal[1] * new[0, 1] - far
        if beyond <= rounding:
            return polygon, count, made, True
        if made == most or count == _CORNERS:
            return polygon, count, made, False
        before = count
        count = _add(polygon, count, i + 1, new[0])
        made += 1
        if count == before:  # rounding alone: nothing new can be added
            return polygon, count, made, True
    return polygon, count, made, True


@register_jitable
def result(controls, vb):
    """Return signed distance of the shapes [m], and the nearest or deepest points on both, (5,)."""
    pair, out = pair_of(controls, vb), np.zeros(5)
    # GJK (Gilbert, Johnson and Keerthi, 1988) to its end; apart, its witness points are the answer.
    s, share, n, core, _, _ = gjk(vb, pair, 1000)
    if not overlap(pair, core):
        at = nearest(s, share, n)
        out[0] = core
        out[1:] = at[2:]
        return out
    polygon, count, _, _ = epa(vb, pair, s, n, 1000)
    # Touching cores have no polygon with an area: the depth is zero.
    if count < 3:
        out[1:] = nearest(s, share, n)[2:]
        return out
    # Project the origin on the nearest edge; the same share along it interpolates the deepest
    # points on both shapes.
    i, far, _ = nearest_edge(polygon, count)
    j = (i + 1) % count
    ex, ey = polygon[j, 0] - polygon[i, 0], polygon[j, 1] - polygon[i, 1]
    part = -(polygon[i, 0] * ex + polygon[i, 1] * ey) / (ex * ex + ey * ey)
    for k in range(2):
        out[1 + k] = polygon[i, 3 + k] + part * (polygon[j, 3 + k] - polygon[i, 3 + k])
        out[3 + k] = polygon[i, 6 + k] + part * (polygon[j, 6 + k] - polygon[i, 6 + k])
    out[0] = -far
    return out


@register_jitable
def counts(controls, vb):
    """Return how many iterations of GJK and expansions of EPA this pair takes, -1 without EPA."""
    pair = pair_of(controls, vb)
    s, _, n, core, _, iterations = gjk(vb, pair, 1000)
    if not overlap(pair, core):
        return iterations, -1
    return iterations, epa(vb, pair, s, n, 1000)[2]


@register_jitable
def step_of(controls, state, vb):
    """Return the step that is shown, and the last one."""
    # Steps of both algorithms in one count: GJK's iterations, then the expansions and the final
    # check of EPA.
    iterations, expansions = counts(controls, vb)
    last = iterations + expansions + 1
    return min(int(controls["step"]) + int(state["time"] / _PACE + 1e-9), last), last


def initial(controls, state):
    """Begin at the step of the slider."""
    state["time"] = 0.0


def advance(state, controls, seconds):
    """Let the steps follow each other."""
    state["time"] = min(state["time"] + seconds, (LAST + 1) * _PACE)


TITLE = "GJK and EPA, step by step"
word, colour = draw.words_table(), draw.colours_table()
_PALE, _SAND, _CLOUD, _TINT = colour("#cfe3f2", "#f8dcc4", "#eeeeee", "#d6efe5")
_WORLD, _DIFFERENCE, _A_NAME, _B_NAME = word(
    "two shapes: drag B", "Minkowski difference A − B", "A", "B"
)
_SIMPLEX, _DIRECTION, _SUPPORT, _ORIGIN = word(
    "simplex", "search direction", "support point", "origin"
)
_POLYTOPE = word("EPA’s polygon")[0]
_ALGORITHM, _STEPS, _UPPER, _LOWER, _SIGNED = word(
    "algorithm", "step", "upper bound", "lower bound", "signed distance"
)
_GJK, _DONE, _EPA, _OF, _M, _UNKNOWN = word("GJK", "done", "EPA", " of ", " m", "not yet")
_SAY_START, _SAY_SEARCH, _SAY_APART, _SAY_INSIDE, _SAY_GROW, _SAY_DEEP = word(
    "start with one point of the difference",
    "search from the nearest point towards the origin",
    "nothing lies farther that way: this is the distance",
    "the origin is inside: the shapes overlap, EPA starts",
    "push the edge nearest to the origin outwards",
    "nothing lies beyond this edge: this is the depth",
)
_LEFT, _LEFT_VIEW = (0.15, 4.15, 0.45, 4.3), (-1.5, 1.5, -1.444, 1.444)
_RIGHT, _RIGHT_VIEW = (4.75, 8.85, 0.45, 4.3), (-1.95, 1.95, -1.831, 1.831)


@register_jitable
def _polygon(pen, x, y, fill, edge, width=2.0, alpha=1.0):
    draw.polygon(pen, fill, edge, width, alpha)
    draw.points(pen, x, y)


@register_jitable
def _turned(pair, vb):
    """Return the corners of b in the world (2, m)."""
    x = pair[_R] * vb[0] + pair[_R + 1] * vb[1] + pair[_P]
    y = pair[_R + 3] * vb[0] + pair[_R + 4] * vb[1] + pair[_P + 1]
    return x, y


@register_jitable
def outline(pair, vb):
    """Return the corners of the Minkowski difference, counter-clockwise, (2, n + m).

    Its edges are those of a and those of -b in the order of their angles.
    """
    # Minkowski sum of two convex polygons in linear time but for the sort: both edge sequences
    # merged by angle.
    bx, by = _turned(pair, vb)
    n, m = A_SHAPE.shape[1], vb.shape[1]
    px, py = np.empty(n + m), np.empty(n + m)
    px[:n], py[:n] = np.roll(A_SHAPE[0], -1) - A_SHAPE[0], np.roll(A_SHAPE[1], -1) - A_SHAPE[1]
    px[n:], py[n:] = bx - np.roll(bx, -1), by - np.roll(by, -1)
    order = np.argsort(np.arctan2(py, px) % (2.0 * math.pi), kind="mergesort")
    # The edge with the least angle begins at the lowest corner, of equally low ones the left one.
    # That of -b is the highest corner of b, of equally high ones the right one.
    ka = kb = 0
    for k in range(n):
        low, best = A_SHAPE[1, k], A_SHAPE[1, ka]
        if low < best or (low == best and A_SHAPE[0, k] < A_SHAPE[0, ka]):
            ka = k
    for k in range(m):
        if by[k] > by[kb] or (by[k] == by[kb] and bx[k] > bx[kb]):
            kb = k
    # From the first corner, which is the sum of those two corners, edge follows edge.
    corners = np.empty((2, n + m))
    x, y = A_SHAPE[0, ka] - bx[kb], A_SHAPE[1, ka] - by[kb]
    for k in range(n + m):
        corners[0, k], corners[1, k] = x, y
        x += px[order[k]]
        y += py[order[k]]
    return corners


@register_jitable
def _world(pen, pair, vb, support, final, ended):
    """Draw both shapes, the corners of the support point, and the answer once it is there."""
    draw.area(pen, _LEFT, _LEFT_VIEW)
    bx, by = _turned(pair, vb)
    _polygon(pen, A_SHAPE[0], A_SHAPE[1], _PALE, draw.BLUE)
    _polygon(pen, bx, by, _SAND, draw.ORANGE, 2.0, 0.75)
    draw.text(pen, 0.0, 0.0, _A_NAME, draw.BLUE, 15.0, draw.CENTRE, draw.MIDDLE, 0.0, 0.0, 0.0, 1.0)
    draw.text(
        pen,
        pair[_P],
        pair[_P + 1],
        _B_NAME,
        draw.ORANGE,
        15.0,
        draw.CENTRE,
        draw.MIDDLE,
        0.0,
        0.0,
        0.0,
        1.0,
    )
    # At the end the nearest or deepest points, before it the corners that the support point
    # consists of.
    if ended:
        draw.segment(pen, final[1], final[2], final[3], final[4], draw.RED, 3.5)
        for k in (1, 3):
            draw.spot(pen, final[k], final[k + 1], 0.045, draw.RED, draw.INK)
    else:
        draw.spot(pen, support[3], support[4], 0.055, draw.GREEN, draw.INK)
        draw.spot(pen, support[6], support[7], 0.055, draw.GREEN, draw.INK)
    draw.window(pen)
    draw.title(pen, _LEFT[0] + 0.05, _LEFT[3], _WORLD)


@register_jitable
def _search(pen, x, y, dx, dy, support):
    """Draw the search direction from a point, and the support point that it finds."""
    size = math.hypot(dx, dy)
    if size > 0.0:
        draw.arrow(pen, x, y, x + 0.55 * dx / size, y + 0.55 * dy / size, draw.GREEN, 3.0)
    draw.spot(pen, support[0], support[1], 0.075, draw.GREEN, draw.INK)


def frame(pen, state, controls):
    """Draw the shapes, and the simplex or polygon of this step in their Minkowski difference."""
    vb = B_SHAPES[0]
    if controls["shape"] == 1:
        vb = B_SHAPES[1]
    elif controls["shape"] == 2:
        vb = B_SHAPES[2]
    pair, final = pair_of(controls, vb), result(controls, vb)
    # The algorithms run again up to the step that is shown, so that the state needs no memory of
    # them.
    iterations, expansions = counts(controls, vb)
    step, last = step_of(controls, state, vb)
    s, share, n, core, low, _ = gjk(vb, pair, min(step, iterations))
    at = nearest(s, share, n)
    new, high = np.zeros((1, 9)), core
    ended, expanding = step == last, step > iterations
    corners = outline(pair, vb)
    draw.area(pen, _RIGHT, _RIGHT_VIEW)
    _polygon(pen, corners[0], corners[1], _CLOUD, draw.GREY, 1.5)
    say = _SAY_SEARCH
    if expanding:
        # EPA: the polygon, its nearest edge, and what lies beyond it.
        low, high = 0.0, 0.0  # corners that touch have no polygon
        polygon, count, _, _ = epa(vb, pair, s, n, step - iterations - 1)
        _polygon(pen, polygon[:count, 0], polygon[:count, 1], _TINT, draw.PURPLE, 2.5, 0.8)
        draw.spots(pen, polygon[:count, 0], polygon[:count, 1], 0.05, draw.PURPLE)
        if count >= 3:
            i, far, normal = nearest_edge(polygon, count)
            j = (i + 1) % count
            draw.segment(
                pen, polygon[i, 0], polygon[i, 1], polygon[j, 0], polygon[j, 1], draw.RED, 4.0
            )
            _support((normal[0], normal[1], 0.0), A_SHAPE, vb, pair, new, 0)
            low, high = far, normal[0] * new[0, 0] + normal[1] * new[0, 1]
            if ended:
                draw.segment(pen, 0.0, 0.0, far * normal[0], far * normal[1], draw.RED, 2.5)
            else:
                _search(pen, 0.0, 0.0, normal[0], normal[1], new[0])
        say = _SAY_DEEP if ended else _SAY_GROW
    else:
        # GJK: the simplex, its point nearest to the origin, and the search from there.
        _polygon(pen, s[:n, 0], s[:n, 1], _TINT, draw.PURPLE, 2.5, 0.8)
        draw.spots(pen, s[:n, 0], s[:n, 1], 0.06, draw.PURPLE)
        if step == 0:
            say = _SAY_START
        if expansions >= 0 and step == iterations:
            say = _SAY_INSIDE
            new[0] = s[0]
        else:
            _support((-at[0], -at[1], 0.0), A_SHAPE, vb, pair, new, 0)
            if ended:
                say = _SAY_APART
                draw.segment(pen, 0.0, 0.0, at[0], at[1], draw.RED, 3.5)
            else:
                draw.segment(pen, 0.0, 0.0, at[0], at[1], draw.INK, 1.2, 0.8, 4.0, 4.0)
                _search(pen, at[0], at[1], -at[0], -at[1], new[0])
            draw.spot(pen, at[0], at[1], 0.045, draw.RED)
    draw.spot(pen, 0.0, 0.0, 0.05, draw.INK)
    draw.text(pen, 0.0, 0.0, _ORIGIN, draw.INK, 11.5, draw.LEFT, draw.TOP, 7.0, -5.0)
    draw.window(pen)
    draw.title(pen, _RIGHT[0] + 0.05, _RIGHT[3], _DIFFERENCE)
    _world(pen, pair, vb, new[0], final, ended)
    draw.text(pen, 4.5, 0.2, say, draw.INK, 13.0, draw.CENTRE)
    draw.key(pen, 0.2, 4.8, _POLYTOPE if expanding else _SIMPLEX, draw.PURPLE, 3.0)
    draw.key(pen, 2.0, 4.8, _DIRECTION, draw.GREEN, 3.0)
    draw.spot(pen, 4.3, 4.8, 0.06, draw.GREEN, draw.INK)
    draw.text(pen, 4.48, 4.8, _SUPPORT, draw.INK, 11.5)
    draw.readout(pen, _ALGORITHM)
    draw.words(pen, _DONE if ended else _EPA if expanding else _GJK)
    draw.readout(pen, _STEPS)
    draw.number(pen, step, 0, _OF)
    draw.number(pen, last, 0)
    # In GJK the nearest point of the simplex bounds the distance from above, the support plane from
    # below; a negative lower bound says nothing.
    draw.reading(pen, _UPPER, high, 4, _M)
    if step == 0 or (low < 0.0 and not expanding):
        draw.reading(pen, _LOWER, 0.0, 4, _M, _UNKNOWN)
    else:
        draw.reading(pen, _LOWER, low, 4, _M)
    if ended:
        draw.reading(pen, _SIGNED, final[0], draw.SIGNED + 4, _M)
    else:
        draw.reading(pen, _SIGNED, 0.0, 0, _M, _UNKNOWN)


def drag(controls, state, x, y):
    """Move B, or in the other picture the Minkowski difference, to the pointer."""
    if x < 0.5 * (_LEFT[1] + _RIGHT[0]):
        to = draw.values_at(_LEFT, _LEFT_VIEW, x, y)
    else:
        # The difference A - B moves against B.
        to = draw.values_at(_RIGHT, _RIGHT_VIEW, x, y)
        to = (-to[0], -to[1])
    for axis in range(2):
        controls["position"][axis] = min(max(to[axis], -_REACH), _REACH)


def press(controls, state, key):
    """Handle a key: left and right turn B, up and down go a step on or back."""
    if key < 2:
        turn = controls["turn"] + (5.0 if key == 0 else -5.0)
        controls["turn"] = (turn + 180.0) % 360.0 - 180.0
    elif key < 4:
        step = controls["step"] + (1 if key == 2 else -1)
        controls["step"] = min(max(step, 0), LAST)


PRESETS = {
    "Apart: GJK": Preset(
        {},
        "Press play, or move the step. GJK holds one to three points of the Minkowski "
        "difference, and looks for another one from their nearest point towards the origin. It "
        "ends when nothing lies farther that way.",
    ),
    "Overlapping: GJK, then EPA": Preset(
        {"position": (0.35, 0.15), "shape": 2},
        "The origin lies inside, so GJK ends with a triangle around it. EPA then pushes the "
        "nearest edge outwards, again and again, until that edge belongs to the boundary. Its "
        "distance is the depth.",
    ),
    "Drag and see the answer": Preset(
        {"step": LAST, "shape": 1, "position": (0.8, -0.5)},
        "The last step is shown at once. Drag B, or the grey shape on the right, and turn B with "
        "the arrow keys. The red line is the distance or the depth in both pictures.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "algorithm": "Which algorithm this step belongs to.",
    "step": "Number of the step, and how many this pair of shapes takes.",
    "upper bound": "The distance, or the depth once EPA runs, is at most this.",
    "lower bound": "The distance, or the depth once EPA runs, is at least this.",
    "signed distance": "The result: the distance, or minus the depth if the shapes overlap.",
}

PAPER = draw.Paper(TITLE, word, colour)
MODEL = Model(
    TITLE,
    PAPER,
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    press=press,
    readouts=READOUTS,
)
