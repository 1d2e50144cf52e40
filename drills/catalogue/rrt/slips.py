"""Plausible wrong planners, as edits of the worked answer."""

from __future__ import annotations

from drills.exercise import slips

_EDGE = "        if not edge_is_free(nodes[near], new, discs):\n"
_JOIN = (
    "        if not result and np.hypot(*(goal - new)) <= step "
    "and edge_is_free(new, goal, discs):\n"
)
_JOINED = """            nodes[len(parents)] = goal
            parents.append(len(parents) - 1)
            result = True
"""
_TARGET = "goal if rng.random() < GOAL_BIAS else rng.uniform(low, high)"
_CLOSED_FORM = """    along = b - a
    to_centres = discs[:, :2] - a
    length_squared = np.maximum(along @ along, np.finfo(float).tiny)  # an edge may have no length
    fraction = np.clip(to_centres @ along / length_squared, 0.0, 1.0)
    gaps = to_centres - fraction[:, None] * along
    return bool(np.all(np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]))
"""
_SAMPLED = """    for t in np.linspace(0.0, 1.0, 10):
        gaps = discs[:, :2] - (a + t * (b - a))
        if np.any(np.hypot(gaps[:, 0], gaps[:, 1]) <= discs[:, 2]):
            return False
    return True
"""
_PATH = "    path = trace(nodes, parents) if result else None\n"

SLIPS = slips(
    vertices_only=(
        _EDGE,
        "        if not edge_is_free(new, new, discs):\n",
        "and edge_is_free(new, goal, discs)",
        "and edge_is_free(goal, goal, discs)",
        "Only the ends of an edge are checked, so edges cut through discs. The edge has to be "
        "free from end to end: find its point nearest to each centre.",
    ),
    coarse_sampling=(
        _CLOSED_FORM,
        _SAMPLED,
        "Edges are checked at points along them, and a disc fits between two points. However "
        "fine the points, a shallow cut lies between: solve for the nearest point of the edge "
        "instead.",
    ),
    nothing_checked=(
        _EDGE,
        "        if False:\n",
        " and edge_is_free(new, goal, discs)",
        "",
        "New nodes lie in discs: neither they nor the edges are checked.",
    ),
    last_edge_unchecked=(
        " and edge_is_free(new, goal, discs)",
        "",
        "The edge that joins the goal is not checked. It may cut a disc as any other does.",
    ),
    line_for_segment=(
        "np.clip(to_centres @ along / length_squared, 0.0, 1.0)",
        "to_centres @ along / length_squared",
        "Free edges are refused: the distance is taken to the endless line through the edge. "
        "Keep the nearest point on the edge, that is, clip its parameter to 0 ... 1.",
    ),
    goal_never_appended=(
        _JOIN + _JOINED,
        "        result = result or np.hypot(*(goal - new)) <= step\n",
        "The path ends near the goal, not at it: the goal itself was never added. Near is not "
        "there; join the last node to the goal if that edge is free.",
    ),
    partial_path=(
        _PATH,
        "    path = trace(nodes, parents)\n",
        "A path came back although the goal was not reached. Half a path is worse than none, as "
        "the robot would drive it: return None.",
    ),
    path_reversed=(
        "    return nodes[chain[::-1]]\n",
        "    return nodes[chain]\n",
        "The path runs from goal to start. Going from parent to parent finds it backwards: turn "
        "it around.",
    ),
    all_nodes_as_path=(
        _PATH,
        "    path = nodes[: len(parents)].copy() if result else None\n",
        "The path is the whole tree in the order it grew. Follow the parents back from the goal: "
        "only these nodes are the path.",
    ),
    no_goal_bias=(
        _TARGET,
        "rng.uniform(low, high)",
        "The goal is never drawn as a target. One draw in ten should be the goal: the tree then "
        "leans towards it and still explores.",
    ),
    always_goal=(
        _TARGET,
        "goal",
        "Every target is the goal, so the tree runs into the first disc and stays there. Nine "
        "draws in ten should be anywhere.",
    ),
    no_steering=(
        "        new = steer(nodes[near], target, step)\n",
        "        new = target\n",
        "The new node is put at the target however far it is. Go at most one step from the "
        "nearest node towards it.",
    ),
    newest_for_nearest=(
        "        near = int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))\n",
        "        near = len(offsets) - 1\n",
        "The tree grows from its newest node, not from the one nearest to the target: that is a "
        "random walk, not a tree that explores.",
    ),
    bounds_from_zero=(
        _TARGET,
        "goal if rng.random() < GOAL_BIAS else rng.uniform(0.0, high)",
        "Targets are not drawn over the whole world, or beyond it. Draw uniformly between both "
        "corners of the bounds, each axis by its own; the lower corner need not be zero.",
    ),
    symmetric_bounds=(
        _TARGET,
        "goal if rng.random() < GOAL_BIAS else rng.uniform(-high, high)",
        "Targets are drawn between minus the upper corner and the upper corner. The world has two "
        "corners of its own: draw between them.",
    ),
    axes_swapped=(
        _TARGET,
        "goal if rng.random() < GOAL_BIAS else rng.uniform(low[::-1], high[::-1])",
        "x and y of the targets are swapped: x is drawn between the ends of y. A row of bounds is "
        "a corner, (x, y).",
    ),
    bounds_by_axis=(
        _TARGET,
        "goal if rng.random() < GOAL_BIAS else rng.uniform((low[0], high[0]), (low[1], high[1]))",
        "The rows of bounds are read as the ends of x and the ends of y. They are corners: "
        "(xmin, ymin) and (xmax, ymax).",
    ),
    always_a_whole_step=(
        "target if distance <= step else origin + step / distance * offset\n",
        "origin + step / max(distance, 1e-12) * offset\n",
        "Every edge is a whole step long: a target that is nearer is overshot, and the tree leaves "
        "the world. A target within one step is reached exactly.",
    ),
    start_for_parent=(
        "        parents.append(near)\n",
        "        parents.append(0)\n",
        "Every node has the start as its parent. The parent is the node that the step began at, "
        "the nearest to the target.",
    ),
    last_for_parent=(
        "        parents.append(near)\n",
        "        parents.append(len(parents) - 1)\n",
        "Every node has the one before it as its parent, however far away. The parent is the node "
        "that the step began at, the nearest to the target.",
    ),
    square_compared_with_radius=(
        "np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]",
        "gaps[:, 0] ** 2 + gaps[:, 1] ** 2 > discs[:, 2]",
        "Free edges are refused: the square of a distance is compared with a radius. Take the "
        "root, or square the radius too.",
    ),
    grown_from_the_goal=(
        "    nodes[0] = start\n",
        "    start, goal = goal, start\n    nodes[0] = start\n",
        "Start and goal are taken for each other: the tree grows from the goal. Its first node is "
        "the start, and the order of the arguments is rrt(start, goal, ...).",
    ),
    none_instead_of_an_error=(
        "        if not edge_is_free(point, point, discs):\n",
        "        if not edge_is_free(point, point, discs):\n"
        "            return None, np.array([start]), np.array([-1]), np.zeros((0, 2))\n",
        "A query that makes no sense is answered with None, which says that the planner searched "
        "and found nothing. The caller cannot tell the two apart: raise ValueError.",
    ),
    collision_accepted=(
        '    for name, point in (("start", start), ("goal", goal)):\n',
        "    for name, point in ():\n",
        "A start or a goal inside a disc, or outside the bounds, is accepted. There is no path "
        "then: refuse it with ValueError before you search.",
    ),
    bounds_unchecked=(
        "if point.shape != (2,) or not ((low <= point) & (point <= high)).all():",
        "if point.shape != (2,):",
        "A start or a goal outside the rectangle is accepted. No path may lead there: refuse it "
        "with ValueError before you search, as one inside a disc.",
    ),
    own_generator=(
        "    nodes[0] = start\n",
        "    nodes[0] = start\n    rng = np.random.default_rng(0)\n",
        "The generator handed in is not used: other generators give the same tree. Draw every "
        "random number from rng, and leave seeding to the caller.",
    ),
)
