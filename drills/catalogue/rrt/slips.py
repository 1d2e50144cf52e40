"""Plausible wrong planners, as edits of the worked answer."""

from __future__ import annotations

from drills.exercise import Slip

_EDGE = "        if not edge_is_free(nodes[near], new, discs):\n"
_JOIN = (
    "        if not found and np.hypot(*(goal - new)) <= step and edge_is_free(new, goal, discs):\n"
)
_JOINED = """            nodes[len(parents)] = goal
            parents.append(len(parents) - 1)
            found = True
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
_PATH = "    path = trace(nodes, parents) if found else None\n"

SLIPS = (
    Slip(
        "vertices_only",
        "Only the ends of an edge are checked, so edges cut through discs. The edge has to be free "
        "from end to end: find its point nearest to each centre.",
        edits=(
            (_EDGE, "        if not edge_is_free(new, new, discs):\n"),
            ("and edge_is_free(new, goal, discs)", "and edge_is_free(goal, goal, discs)"),
        ),
    ),
    Slip(
        "coarse_sampling",
        "Edges are checked at points along them, and a disc fits between two points. However fine "
        "the points, a shallow cut lies between: solve for the nearest point of the edge instead.",
        edits=((_CLOSED_FORM, _SAMPLED),),
    ),
    Slip(
        "nothing_checked",
        "New nodes lie in discs: neither they nor the edges are checked.",
        edits=((_EDGE, "        if False:\n"), (" and edge_is_free(new, goal, discs)", "")),
    ),
    Slip(
        "last_edge_unchecked",
        "The edge that joins the goal is not checked. It may cut a disc as any other does.",
        edits=((" and edge_is_free(new, goal, discs)", ""),),
    ),
    Slip(
        "line_for_segment",
        "Free edges are refused: the distance is taken to the endless line through the edge. Keep "
        "the nearest point on the edge, that is, clip its parameter to 0 ... 1.",
        edits=(
            (
                "np.clip(to_centres @ along / length_squared, 0.0, 1.0)",
                "to_centres @ along / length_squared",
            ),
        ),
    ),
    Slip(
        "goal_never_appended",
        "The path ends near the goal, not at it: the goal itself was never added. Near is not "
        "there; join the last node to the goal if that edge is free.",
        edits=((_JOIN + _JOINED, "        found = found or np.hypot(*(goal - new)) <= step\n"),),
    ),
    Slip(
        "partial_path",
        "A path came back although the goal was not reached. Half a path is worse than none, as "
        "the robot would drive it: return None.",
        edits=((_PATH, "    path = trace(nodes, parents)\n"),),
    ),
    Slip(
        "path_reversed",
        "The path runs from goal to start. Going from parent to parent finds it backwards: turn it "
        "around.",
        edits=(("    return nodes[chain[::-1]]\n", "    return nodes[chain]\n"),),
    ),
    Slip(
        "all_nodes_as_path",
        "The path is the whole tree in the order it grew. Follow the parents back from the goal: "
        "only these nodes are the path.",
        edits=((_PATH, "    path = nodes[: len(parents)].copy() if found else None\n"),),
    ),
    Slip(
        "no_goal_bias",
        "The goal is never drawn as a target. One draw in ten should be the goal: the tree then "
        "leans towards it and still explores.",
        edits=((_TARGET, "rng.uniform(low, high)"),),
    ),
    Slip(
        "always_goal",
        "Every target is the goal, so the tree runs into the first disc and stays there. Nine "
        "draws in ten should be anywhere.",
        edits=((_TARGET, "goal"),),
    ),
    Slip(
        "no_steering",
        "The new node is put at the target however far it is. Go at most one step from the nearest "
        "node towards it.",
        edits=(("        new = steer(nodes[near], target, step)\n", "        new = target\n"),),
    ),
    Slip(
        "newest_for_nearest",
        "The tree grows from its newest node, not from the one nearest to the target: that is a "
        "random walk, not a tree that explores.",
        edits=(
            (
                "        near = int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))\n",
                "        near = len(offsets) - 1\n",
            ),
        ),
    ),
    Slip(
        "bounds_from_zero",
        "Targets are not drawn over the whole world, or beyond it. Draw uniformly between both "
        "corners of the bounds, each axis by its own; the lower corner need not be zero.",
        edits=((_TARGET, "goal if rng.random() < GOAL_BIAS else rng.uniform(0.0, high)"),),
    ),
    Slip(
        "collision_accepted",
        "A start or a goal inside a disc, or outside the bounds, is accepted. There is no path "
        "then: refuse it with ValueError before you search.",
        edits=(
            (
                '    for name, point in (("start", start), ("goal", goal)):\n',
                "    for name, point in ():\n",
            ),
        ),
    ),
    Slip(
        "bounds_unchecked",
        "A start or a goal outside the rectangle is accepted. No path may lead there: refuse it "
        "with ValueError before you search, as one inside a disc.",
        edits=(
            (
                "if point.shape != (2,) or not ((low <= point) & (point <= high)).all():",
                "if point.shape != (2,):",
            ),
        ),
    ),
    Slip(
        "own_generator",
        "The generator handed in is not used: other generators give the same tree. Draw every "
        "random number from rng, and leave seeding to the caller.",
        edits=(
            (
                "    nodes[0] = start\n",
                "    nodes[0] = start\n    rng = np.random.default_rng(0)\n",
            ),
        ),
    ),
)
