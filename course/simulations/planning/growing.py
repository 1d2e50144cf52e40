"""Chapter 5's simulation: a tree or a roadmap grows, sample by sample, among movable obstacles.

The loops are those of `course.planning`, handed the numbers of a seed. An edge is tested exactly,
or at points along it, which is how one plans through a wall.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.planning import roadmaps, trees
from course.planning.neighbours import CHILD, SIBLING, WIDTH, squared
from course.planning.samplers import EDGE_CHECKS, SAMPLES, UNIFORM
from course.planning.worlds import LAST_SIDE, SIDE, segment_free
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.splitmix import Stream, uniform

RRT, CONNECT, STAR, PRM = range(4)
PIECES, ROOM, JOINED, CUTS = 9, 3100, 5, 200
BUDGET = (2500, 2500, 2500, 400)  # samples of each planner
LONG, HIGH = 17.6, 9.0  # of the world [m]
SPACINGS = (0.0, 0.5, 100.0)  # of points along an edge [m]; 0 is the exact test
BLOCKED, SEARCHING, SOLVED, SPENT = range(4)

CONTROLS = Record(
    method=menu("Planner", ("RRT", "RRT-Connect", "RRT*", "PRM")),
    step=slider("Step size", 0.40, 0.10, 3.0, 0.05, "m"),
    check=menu("Edges checked", ("exactly", "at points 0.5 m apart", "at their ends")),
    bias=slider("Goal bias", 0.05, 0.0, 0.95, 0.05),
    rate=slider("Samples per second", 40, 5, 400, 5, live=True),
    seed=slider("Seed", 1, 0, 99, 1),
    piece=menu(
        "Keys move", ("start", "goal", *(f"obstacle {k + 1}" for k in range(PIECES))), live=True
    ),
    ends=Field((1.0, 2.0, 16.0, 7.0), low=0.0, high=LONG, unit="m"),  # start, goal
    pieces=Field(0.0, shape=(PIECES, 4), low=0.0, high=LONG, unit="m"),  # centre, half sides
)
STATE = Record(
    rows=Field(0.0, shape=(4 * PIECES, 5)),  # the obstacles as a world has them
    count=Field(0),
    nodes=Field(0.0, shape=(2, ROOM, 2), unit="m"),
    parents=Field(0, shape=(2, ROOM)),
    links=Field(0, shape=(2, ROOM, WIDTH)),
    costs=Field(0.0, shape=(2, ROOM), unit="m"),
    stacks=Field(0, shape=(4, ROOM)),
    gaps=Field(0.0, shape=(ROOM,)),
    pairs=Field(0, shape=(JOINED * (BUDGET[PRM] + 2), 2)),  # edges of a roadmap
    known=Field(0, shape=(JOINED * (BUDGET[PRM] + 2),)),
    counts=Field(0, shape=(16,)),
    seed=Field(np.uint64(0), shape=(1,)),
    became=Field(SEARCHING),
    path=Field(0.0, shape=(ROOM, 2), unit="m"),
    corners=Field(0),
    length=Field(0.0, unit="m"),  # length of the path before shortcuts
    owed=Field(0.0),  # samples
    held=Field(0),  # 1 start, 2 goal, 3 + k obstacle k, -3 - k its rim; 0 nothing
    grip=Field(0.0, shape=(2,), unit="m"),
)


@register_jitable
def state_free(rows, body, q):
    """Return whether a point touches nothing."""
    return segment_free(rows, q[0], q[1], q[0], q[1])


@register_jitable
def edge_free(rows, body, a, b):
    """Return whether an edge is called free.

    Exactly, or at points body[0, 0] apart and at its ends.
    """
    if body[0, 0] == 0.0:
        return segment_free(rows, a[0], a[1], b[0], b[1])
    # Sampled collision checking: obstacles thinner than the spacing may be missed, corners be cut.
    pieces = max(1, math.ceil(math.sqrt(squared(a, b)) / body[0, 0]))
    for k in range(pieces + 1):
        if not state_free(rows, body, a + (k / pieces) * (b - a)):
            return False
    return True


@register_jitable
def initial(controls, state):
    """Set up the obstacles, and the roots of what will grow."""
    rows, counts, count = state["rows"], state["counts"], 0
    for p in controls["pieces"]:
        # Four sides in turn, the last one marked, so that the exact test knows where an obstacle
        # ends; an obstacle without size is absent.
        for i in range(4 * (p[2] > 0.0)):  # corner i and the next one, against the clock
            u, v = (-1.0, 1.0, 1.0, -1.0)[i], (-1.0, -1.0, 1.0, 1.0)[i]
            rows[count, 0] = LAST_SIDE if i == 3 else SIDE
            rows[count, 1], rows[count, 2] = p[0] + u * p[2], p[1] + v * p[3]
            rows[count, 3], rows[count, 4] = p[0] - v * p[2], p[1] + u * p[3]
            count += 1
    counts[:], counts[trees.LAST : trees.LAST + 2] = 0, -1
    state["count"], state["corners"], state["owed"], state["length"] = count, 0, 0.0, 0.0
    state["seed"][0] = controls["seed"]
    start, goal = controls["ends"][:2], controls["ends"][2:]
    # A tree grows from the start, with RRT-Connect one from the goal too; a roadmap has both as its
    # first two nodes.
    roadmap = int(controls["method"] == PRM)  # it has both ends in one table
    state["nodes"][0, 0], state["nodes"][1 - roadmap, roadmap] = start, goal
    for side in range(2):
        state["parents"][side, 0], state["costs"][side, 0] = -1, 0.0
        state["links"][side, 0, CHILD] = state["links"][side, 0, SIBLING] = -1
        state["stacks"][0, side] = side
    counts[trees.NODES] = 1 + roadmap
    counts[trees.NODES + 1] = int(controls["method"] == CONNECT)
    # An end in collision makes the question unanswerable, whatever the planner does.
    body, rows = np.zeros((1, 1)), rows[:count]
    free = state_free(rows, body, start) and state_free(rows, body, goal)
    state["became"] = SEARCHING if free else BLOCKED


@register_jitable
def _length(state):
    total, path = 0.0, state["path"]
    for k in range(state["corners"] - 1):
        total += math.sqrt(squared(path[k], path[k + 1]))
    return total


@register_jitable
def _up(state, side, node):
    """Append the path from a node up to its root; the one to the start is reversed."""
    path, first = state["path"], state["corners"]
    # Follow parents to the root. The tree of the start lists its path backwards, hence the
    # reversal.
    while node >= 0:
        path[state["corners"]] = state["nodes"][side, node]
        state["corners"] += 1
        node = state["parents"][side, node]
    if side == 0:
        path[first : state["corners"]] = path[first : state["corners"]][::-1].copy()


@register_jitable
def _route(state, rows, body):
    """Return the last node of the shortest way through the roadmap; parents lead back from it."""
    # The roadmap's edges as a compressed adjacency list (CSR): both directions sorted by their
    # first node.
    count, edges = state["counts"][roadmaps.NODES], state["counts"][roadmaps.EDGES]
    pairs, nodes = state["pairs"][:edges], state["nodes"][0, :count]
    ends = np.concatenate((pairs[:, 0], pairs[:, 1]))
    order = np.argsort(ends, kind="mergesort")
    first = np.searchsorted(ends[order], np.arange(count + 1))
    begins, leaves, came = np.full(count, np.inf), np.full(count, np.inf), np.empty(count, np.int64)
    begins[0], leaves[1] = 0.0, 0.0
    # A* between start and goal over the edges that are known to be free.
    last = roadmaps._search(
        edge_free,
        rows,
        rows[:0],
        body,
        nodes,
        pairs,
        state["known"],
        first,
        order % edges,
        begins,
        leaves,
        nodes[1],
        came,
        state["counts"],
    )
    # Edge numbers become parents: the sum of both ends less this end is the other one.
    for i in range(count):
        state["parents"][0, i] = -1 if came[i] < 0 else pairs[came[i], 0] + pairs[came[i], 1] - i
    return last


@register_jitable
def _body(controls):
    return np.full((1, 1), SPACINGS[controls["check"]])


@register_jitable
def grow(controls, state, samples):
    """Draw this number of samples, or fewer if the query is solved or the budget is spent."""
    # No more samples than the budget has left.
    counts, method, code, last = state["counts"], controls["method"], trees.GO_ON, -1
    samples = min(samples, BUDGET[method] - counts[SAMPLES])
    # Only RRT* goes on after a solution: it is asymptotically optimal and keeps improving.
    if state["became"] != SEARCHING and not (state["became"] == SOLVED and method == STAR):
        return
    rows, body, rng = state["rows"][: state["count"]], _body(controls), Stream(state["seed"])
    bounds = np.array([[0.0, 0.0], [LONG, HIGH]])
    # PRM: sample the free space and join each node to its nearest neighbours (Kavraki et al.,
    # 1996).
    if samples > 0 and method == PRM:
        numbers = np.zeros(8)
        numbers[roadmaps.NEAREST], numbers[roadmaps.STOP], numbers[roadmaps.MIX] = JOINED, 1.0, 1.0
        if roadmaps._grow(
            state_free,
            edge_free,
            rows,
            body,
            bounds,
            numbers,
            np.zeros(2),
            state["nodes"][0],
            state["stacks"][0],
            state["pairs"],
            state["known"],
            counts,
            rng,
            samples,
        ):
            last = _route(state, rows, body)
    elif samples > 0:
        # Trees: steer by at most the step size towards samples, the goal being one of them with the
        # bias.
        settings = trees.Settings(
            step=controls["step"],
            goal_bias=controls["bias"],
            sampler=UNIFORM,
            mix=1.0,
            spread=0.0,
            # The radius of RRT*: 1.1 times the least for which it converges, in the plane.
            gamma=1.1 * math.sqrt(3.0 / math.pi * LONG * HIGH) * (method == STAR),
            informed=False,
            shortest=0.0,
        )
        goal = np.stack((controls["ends"][2:], controls["ends"][2:]))
        rest = (
            rows,
            body,
            bounds,
            goal,
            settings,
            np.zeros((4, 2)),
            state["nodes"],
            state["parents"],
            state["links"],
            state["costs"],
            state["stacks"],
            state["gaps"],
            counts,
            rng,
            samples,
        )
        if method == CONNECT:
            code = trees._connect(state_free, edge_free, *rest)
        else:
            code = trees._grow(state_free, edge_free, *rest)
        last = counts[trees.LAST]
        # RRT* reports the best node each time; without a shorter path the drawn one stays.
        if method == STAR and last >= 0 and state["costs"][0, last] == state["length"]:
            last = -1  # as short as it was
    if last >= 0:
        state["corners"] = 0
        _up(state, 0, last)
        if method == CONNECT:  # the meeting point is in both trees
            _up(state, 1, state["parents"][1, counts[trees.LAST + 1]])
        state["became"] = SOLVED
        state["length"] = state["costs"][0, last] if method == STAR else _length(state)
    elif state["became"] == SEARCHING and (code == trees.FULL or counts[SAMPLES] >= BUDGET[method]):
        state["became"] = SPENT


@register_jitable
def shorten(controls, state):
    """Shortcuts between corners drawn at random, where the edge between them is free."""
    # Shortcutting (Geraerts and Overmars, 2007): replace a piece between two corners by a straight
    # edge if that is free. Corners are removed, never added.
    rows, path, draws = state["rows"][: state["count"]], state["path"], np.empty(2)
    for _ in range(CUTS):
        n = state["corners"]
        uniform(state["seed"], draws)
        i, j = int(np.min(draws) * n), int(np.max(draws) * n)
        if j > i + 1 and edge_free(rows, _body(controls), path[i], path[j]):
            path[i + 1 : n - j + i + 1] = path[j:n].copy()
            state["corners"] = n - j + i + 1


def advance(state, controls, seconds):
    """Advance the simulation: as many whole samples as fit into the time; the rest is owed."""
    due = state["owed"] + seconds * controls["rate"]
    count = math.floor(due + 1e-9)
    state["owed"] = max(due - count, 0.0)
    grow(controls, state, count)


TITLE = "A planner among obstacles that you place"
word, colour = draw.words_table(), draw.colours_table()
_YELLOW, _ROSE, _PALE = colour("#e8b700", "#e9a3a0", "#f7f7f4")
_BUTTONS = word("Step", "Plan", "Shortcut", "Reset")[0]
_STATUS = word("start or goal in collision", "searching", "solved", "budget used up")[0]
_ENDS = word("start", "goal")[0]
_METRES, _WHAT, _SAMPLES, _EDGES, _NODES, _PATH, _FIRST, _WRONG, _NONE = word(
    " m",
    "status",
    "samples",
    "edges checked",
    "nodes",
    "path length",
    "length before shortcuts",
    "path edges in collision",
    "none",
)
_SCENE, _VIEW = (0.1, 8.9, 0.45, 4.95), (0.0, LONG, 0.0, HIGH)
_CORNER = (0.1, 0.06)  # of the buttons


@register_jitable
def _grown(pen, state, controls):
    """Return the edges of the trees or of the roadmap; how many nodes there are."""
    counts = state["counts"]
    # A roadmap shows its edges that were tested and found free, trees each node with its parent.
    if controls["method"] == PRM:
        edges, nodes = counts[roadmaps.EDGES], state["nodes"][0]
        pairs = state["pairs"][:edges][state["known"][:edges] == roadmaps.FREE]
        draw.segments(pen, nodes[pairs[:, 0]], nodes[pairs[:, 1]], draw.BLUE, 1.1, 0.8)
        return counts[roadmaps.NODES]
    for side in range(2):
        count, nodes = max(counts[trees.NODES + side], 1), state["nodes"][side]
        up = state["parents"][side, 1:count]
        draw.segments(pen, nodes[1:count], nodes[up], (draw.BLUE, draw.PURPLE)[side], 1.1, 0.8)
    return counts[trees.NODES] + counts[trees.NODES + 1]


def frame(pen, state, controls):
    """Draw the obstacles, what has grown, the path, what is wrong with it; buttons and numbers."""
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, 0.0, LONG, 0.0, HIGH, _PALE, draw.GREY)
    for k in range(PIECES):
        p = controls["pieces"][k]
        if p[2] > 0.0:
            edge = draw.INK if controls["piece"] == 2 + k else draw.RED
            draw.box(pen, p[0] - p[2], p[0] + p[2], p[1] - p[3], p[1] + p[3], _ROSE, edge)
    nodes = _grown(pen, state, controls)
    rows, path, hits = state["rows"][: state["count"]], state["path"], 0
    for k in range(state["corners"] - 1):
        a, b = path[k], path[k + 1]
        # The path is tested exactly, whatever the planner's own test: sampled edges that hit are
        # red.
        wrong = not segment_free(rows, a[0], a[1], b[0], b[1])
        hits += int(wrong)
        draw.segment(pen, a[0], a[1], b[0], b[1], draw.RED if wrong else draw.GREEN, 4.0)
        if wrong:
            draw.spot(pen, 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.15, draw.RED, draw.INK)
    for k in range(2):
        x, y = controls["ends"][2 * k], controls["ends"][2 * k + 1]
        draw.spot(pen, x, y, 0.2, (draw.GREEN, _YELLOW)[k], draw.INK)
        draw.text(pen, x, y, _ENDS + k, draw.INK, 12.0, draw.CENTRE, draw.BOTTOM, 0.0, 9.0)
    draw.window(pen)
    draw.buttons(pen, *_CORNER, _BUTTONS, 4)
    draw.readout(pen, _WHAT)
    draw.words(pen, _STATUS + state["became"])
    draw.reading(pen, _SAMPLES, state["counts"][SAMPLES], 0)
    draw.reading(pen, _EDGES, state["counts"][EDGE_CHECKS], 0)
    draw.reading(pen, _NODES, nodes, 0)
    empty = 0 if state["corners"] else _NONE
    draw.reading(pen, _PATH, _length(state), 2, _METRES, empty)
    draw.reading(pen, _FIRST, state["length"], 2, _METRES, empty)
    draw.reading(pen, _WRONG, hits, 0, 0, empty)


def grab(controls, state, x, y):
    """Handle a press: a button acts; start, goal, an obstacle or its rim is grabbed.

    A press elsewhere starts a new obstacle.
    """
    state["held"], pieces, vacant = 0, controls["pieces"], -1
    u, v = draw.values_at(_SCENE, _VIEW, x, y)
    button = draw.button_at(*_CORNER, 4, x, y)
    if button == 0 or button == 1:
        grow(controls, state, BUDGET[0] if button else 1)
    elif button == 2:
        shorten(controls, state)
    elif button == 3:
        initial(controls, state)
    if not (0.0 <= u <= LONG and 0.0 <= v <= HIGH):
        return
    for k in range(PIECES - 1, -1, -1):
        p = pieces[k]
        # Signed distance in the maximum norm: near the rim it is resized, well inside it is moved.
        out = max(abs(u - p[0]) - p[2], abs(v - p[1]) - p[3])
        if p[2] == 0.0:
            vacant = k
        elif out < 0.15:
            state["held"] = 3 + k if out < -0.15 else -3 - k
            state["grip"][:] = p[:2]
    for k in range(2):
        if math.hypot(controls["ends"][2 * k] - u, controls["ends"][2 * k + 1] - v) < 0.4:
            state["held"], state["grip"][:] = 1 + k, controls["ends"][2 * k : 2 * k + 2]
    # The offset of the pointer is preserved, so that the piece does not jump to it.
    state["grip"] -= np.array([u, v])
    if state["held"] == 0 and vacant >= 0:
        pieces[vacant], state["held"] = np.array([u, v, 0.2, 0.2]), -3 - vacant
    if state["held"]:
        controls["piece"] = abs(state["held"]) - 1


@register_jitable
def _put(controls, state, held, u, v):
    """What is held goes to a place, or its rim; without size it is gone. All begins anew."""
    u, v = min(max(u, 0.0), LONG), min(max(v, 0.0), HIGH)
    if held < 0:
        p = controls["pieces"][-3 - held]
        # The rim defines the half sides; an obstacle that was shrunk to nothing is removed.
        p[2], p[3] = abs(u - p[0]), abs(v - p[1])
        if min(p[2], p[3]) < 0.02:
            p[2:] = 0.0
    elif held > 2:
        controls["pieces"][held - 3, 0], controls["pieces"][held - 3, 1] = u, v
    elif held > 0:
        controls["ends"][2 * held - 2], controls["ends"][2 * held - 1] = u, v
    # Any change of the question restarts the planner with the same seed.
    initial(controls, state)


def drag(controls, state, x, y):
    """Handle a drag: what is in hand follows the pointer."""
    u, v = draw.values_at(_SCENE, _VIEW, x, y)
    if state["held"] > 0:
        _put(controls, state, state["held"], u + state["grip"][0], v + state["grip"][1])
    elif state["held"] < 0:
        _put(controls, state, state["held"], u, v)


def press(controls, state, key):
    """Handle a key: arrows move the selection by 0.1 m, + and - change an obstacle's size.

    With start or goal selected + adds a sample and - tries shortcuts.
    """
    k, more = controls["piece"], 0.1 if key == 4 else -0.1
    p = controls["pieces"][max(k - 2, 0)]
    if key < 4:
        x, y = (p[0], p[1]) if k > 1 else (controls["ends"][2 * k], controls["ends"][2 * k + 1])
        dx, dy = 0.1 * ((key == 1) - (key == 0)), 0.1 * ((key == 2) - (key == 3))
        _put(controls, state, 1 + k, x + dx, y + dy)
    elif k > 1:
        if p[2] == 0.0:
            p[0], p[1] = 0.5 * LONG, 0.5 * HIGH
        p[2:] = np.minimum(np.maximum(p[2:] + more, 0.1), HIGH)
        initial(controls, state)
    elif key == 4:
        grow(controls, state, 1)
    else:
        shorten(controls, state)


def _placed(*pieces):
    """Return the obstacles' field."""
    return np.array([*pieces, *[(0.0,) * 4] * (PIECES - len(pieces))])


PRESETS = {
    "Among obstacles": Preset(
        {
            "pieces": _placed(
                (4.5, 2.5, 0.8, 2.0),
                (8.0, 6.5, 0.5, 2.0),
                (11.5, 3.0, 1.4, 0.5),
                (13.8, 6.0, 0.4, 1.8),
                (5.5, 7.2, 1.0, 0.4),
            )
        },
        "Press Play, or Step and Plan below the picture. Drag start, goal and obstacles; drag the "
        "rim of an obstacle to resize it; click on free ground to add one. Try the other "
        "planners, and then Shortcut: this button only joins corners of the path.",
    ),
    "Narrow gap": Preset(
        {"step": 1.0, "pieces": _placed((8.8, 2.9, 0.25, 2.9), (8.8, 7.6, 0.25, 1.4))},
        "A wall with a gap of 0.4 m. Try several seeds: the number of samples varies widely. "
        "Compare RRT and RRT-Connect. Then drag the rim of a wall until the gap is half as wide.",
    ),
    "Bug trap": Preset(
        {
            "ends": (5.0, 2.6, 15.5, 4.5),
            "step": 1.0,
            "seed": 3,
            "pieces": _placed(
                (3.0, 4.5, 0.1, 3.0),
                (5.5, 1.6, 2.6, 0.1),
                (5.5, 7.4, 2.6, 0.1),
                (8.0, 2.6, 0.1, 1.1),
                (8.0, 6.4, 0.1, 1.1),
                (7.2, 3.6, 0.9, 0.1),
                (7.2, 5.4, 0.9, 0.1),
            ),
        },
        "The goal pulls the tree against the wall, and the only exit is inside the funnel. Raise "
        "the goal bias and it takes longer. A tree that grows from the goal enters through the "
        "funnel.",
    ),
    "Tunnelling edge check": Preset(
        {"check": 1, "pieces": _placed((8.8, 4.5, 0.05, 4.5))},
        "A closed wall, 0.1 m thick, and edges checked every 0.5 m: the planner reports a path. "
        "Red edges are those that an exact check finds in collision. Then switch to the exact "
        "check: there is no path, and the planner cannot know that; it only runs out of samples.",
    ),
    "Unreachable goal": Preset(
        {
            "ends": (1.5, 4.5, 14.0, 4.5),
            "method": CONNECT,
            "pieces": _placed(
                (14.0, 3.2, 1.5, 0.1),
                (14.0, 5.8, 1.5, 0.1),
                (12.6, 4.5, 0.1, 1.4),
                (15.4, 4.5, 0.1, 1.4),
            ),
        },
        "The goal is walled in. A sampling-based planner never knows that: it stops when its "
        "budget is used up. The tree of the goal shows you why. Drag a wall aside and plan again.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "status": "State of the query: still searching, solved or given up.",
    "samples": "Random configurations sampled so far.",
    "edges checked": "Straight segments checked for collisions so far.",
    "nodes": "Nodes of the tree or roadmap.",
    "path length": "Length of the present path.",
    "length before shortcuts": "Length of the path when it was found, before shortcutting.",
    "path edges in collision": (
        "Edges of the path that an exact check finds in collision: the planner's check was too "
        "coarse."
    ),
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour, room=60_000),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    grab,
    press,
    live_drag=True,
    readouts=READOUTS,
)
