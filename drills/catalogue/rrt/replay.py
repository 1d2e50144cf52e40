"""A run of RRT judged from what it returns: the tree must follow from the targets drawn.

With the targets known, RRT leaves no choice: each one is answered by its nearest node, and the step
towards it is kept exactly if the edge is free. So the judge goes through the targets, and needs no
random numbers of its own. Only joining a node to the goal is left to the planner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drills.catalogue.rrt.worlds import World
from drills.geometry import TOLERANCE, bounds_faults, clearances, edge_faults, path_faults

Array = NDArray[np.float64]

# In the order in which they are reported: an earlier one explains those after it.
PROPERTIES = (
    "targets",
    "tree",
    "edges are free",
    "edges are no longer than the step",
    "each target is answered by the nearest node",
    "steps are as long as they may be",
    "free steps are kept",
    "path",
    "ends when it should",
)


@dataclass(frozen=True)
class Run:
    """What came back: shapes (k, 2) or None, (m, 2), (m,) and (s, 2)."""

    path: Array | None
    nodes: Array
    parents: NDArray[np.int64]
    samples: Array


@dataclass(frozen=True)
class Fault:
    """One property that does not hold, why, and the slip that it shows or ""."""

    of: str
    sentence: str
    slip: str = ""


def faults(world: World, run: Run) -> list[Fault]:
    """Return everything that is wrong with a run, by property."""
    result = [*_targets(world, run), *_tree(world, run)]
    if any(fault.of == "tree" for fault in result):
        return result
    result += _edges(world, run)
    if not result:
        result += _growth(world, run)
    return result + _path(world, run)


def _targets(world: World, run: Run) -> list[Fault]:
    result = []
    if len(run.nodes) > 1 and not len(run.samples):
        text = f"The tree has {len(run.nodes)} nodes, and no target is listed in samples."
        result.append(Fault("targets", text))
    if len(run.samples) > world.max_samples:
        text = f"{len(run.samples)} targets were drawn, {world.max_samples} are allowed."
        result.append(Fault("targets", text))
    if bounds_faults(run.samples, world.bounds):
        text = "A target lies outside the bounds. Draw between (xmin, ymin) and (xmax, ymax)."
        result.append(Fault("targets", text, drawn_from([(world, run.samples)])))
    return result


def drawn_from(runs: list[tuple[World, Array]]) -> str:
    """Return the slip of targets that fill another rectangle than the world, or ""."""
    tried: dict[str, bool] = {}
    for world, samples in runs:
        low, high = world.bounds
        points = samples[~(samples == world.goal).all(axis=1)]
        if len(points) < 60:
            continue
        for slip, first, second in (
            ("bounds_from_zero", np.zeros(2), high),
            ("symmetric_bounds", -high, high),
            ("axes_swapped", low[::-1], high[::-1]),
            ("bounds_by_axis", np.array([low[0], high[0]]), np.array([low[1], high[1]])),
        ):
            corners = np.minimum(first, second), np.maximum(first, second)
            room = 0.1 * (corners[1] - corners[0]) + TOLERANCE
            inside = ((points >= corners[0] - TOLERANCE) & (points <= corners[1] + TOLERANCE)).all()
            filled = (points.min(axis=0) <= corners[0] + room).all()
            filled &= (points.max(axis=0) >= corners[1] - room).all()
            tried[slip] = tried.get(slip, True) and bool(inside and filled)
    return next((slip for slip, fits in tried.items() if fits), "")


def _tree(world: World, run: Run) -> list[Fault]:
    if len(run.parents) != len(run.nodes):
        return [Fault("tree", f"{len(run.nodes)} nodes have {len(run.parents)} parents.")]
    if len(run.nodes) > world.max_samples + 2:
        text = f"The tree has {len(run.nodes)} nodes, of {world.max_samples} targets at most."
        return [Fault("tree", text)]
    if not len(run.nodes) or not np.array_equal(run.nodes[0], world.start):
        at_goal = len(run.nodes) and np.array_equal(run.nodes[0], world.goal)
        slip = "grown_from_the_goal" if at_goal else ""
        return [Fault("tree", "The first node is not the start.", slip)]
    if run.parents[0] != -1:
        return [Fault("tree", f"The start's parent is {run.parents[0]}, not -1.")]
    later = np.flatnonzero(
        (run.parents[1:] < 0) | (run.parents[1:] >= np.arange(1, len(run.parents)))
    )
    if len(later):
        i = int(later[0]) + 1
        text = f"Node {i} has the parent {run.parents[i]}, which is not a node before it."
        return [Fault("tree", text)]
    if bounds_faults(run.nodes, world.bounds):
        # Targets outside the bounds lead there too, in whole steps while the tree is small.
        overshot = _whole_steps(world, run) and not bounds_faults(run.samples, world.bounds)
        slip = "always_a_whole_step" if overshot else ""
        return [Fault("tree", "A node lies outside the bounds.", slip)]
    return []


def _whole_steps(world: World, run: Run) -> bool:
    """Return whether every edge has the length of the step, but for those to the goal."""
    edges = run.nodes[1:] - run.nodes[run.parents[1:]]
    lengths = np.hypot(*edges[~(run.nodes[1:] == world.goal).all(axis=1)].T)
    return lengths.size > 1 and bool(np.all(np.abs(lengths - world.step) <= TOLERANCE))


def _edges(world: World, run: Run) -> list[Fault]:
    result: list[Fault] = []
    from_start = len(run.nodes) > 4 and not run.parents[1:].any()
    from_last = len(run.nodes) > 4 and np.array_equal(
        run.parents[1:], np.arange(len(run.nodes) - 1)
    )
    tails, heads = run.nodes[run.parents[1:]], run.nodes[1:]
    suspect = np.hypot(*(heads - tails).T) > world.step
    suspect |= clearances(tails, heads, world.discs).min(axis=1, initial=1.0) < 0.0
    for i in (np.flatnonzero(suspect) + 1).tolist():  # the others have no fault
        a, b = run.nodes[run.parents[i]], run.nodes[i]
        for fault in edge_faults(a, b, world.discs, world.step, i):
            text = f"{fault.sentence[0].upper()}{fault.sentence[1:]}."
            if fault.kind == "step":
                is_target = bool((run.samples == b).all(axis=1).any())
                # A target within a step of an earlier node is reached from there: only the parent
                # that is stored is another. In a small tree each parent may be the last node by
                # chance, so a target out of reach counts first.
                in_reach = bool(np.min(np.hypot(*(run.nodes[:i] - b).T)) <= world.step)
                slip = "start_for_parent" if from_start else "last_for_parent" if from_last else ""
                slip = "no_steering" if is_target and not in_reach else slip
                result.append(Fault("edges are no longer than the step", text, slip))
            else:
                result.append(Fault("edges are free", text, _unchecked(world, a, b)))
    return result


def _unchecked(world: World, a: Array, b: Array) -> str:
    """Return the slip that lets an edge in collision pass, as far as one edge tells."""
    if clearances(b, b, world.discs).min() < -TOLERANCE:
        return "nothing_checked"
    if np.array_equal(b, world.goal):
        return "last_edge_unchecked"
    return "vertices_only" if share_inside(a, b, world.discs) > 0.3 else "coarse_sampling"


def share_inside(a: Array, b: Array, discs: Array) -> float:
    """Return the largest share of an edge that lies in one disc."""
    along = b - a
    squared = float(along @ along)
    if squared == 0.0:
        return 0.0
    middle = (discs[:, :2] - a) @ along / squared
    height = clearances(a, a, discs) + discs[:, 2]
    half = np.sqrt(np.maximum(discs[:, 2] ** 2 - height**2 + middle**2 * squared, 0.0) / squared)
    inside = np.minimum(middle + half, 1.0) - np.maximum(middle - half, 0.0)
    return float(inside.max(initial=0.0))


def _step(origin: Array, target: Array, step: float) -> Array:
    distance = float(np.hypot(*(target - origin)))
    return target if distance <= step else origin + (target - origin) * (step / distance)


def _near(p: Array, q: Array) -> bool:
    return bool(np.abs(p - q).max() <= TOLERANCE)


def _growth(world: World, run: Run) -> list[Fault]:
    """Go through the targets: what each one must have done to the tree."""
    known = 1
    for k, target in enumerate(run.samples):
        distances = np.hypot(*(run.nodes[:known] - target).T)
        nearest = np.flatnonzero(distances <= distances.min() + TOLERANCE)
        if known < len(run.nodes) and run.parents[known] in nearest:
            if _near(run.nodes[known], _step(run.nodes[run.parents[known]], target, world.step)):
                known += 1
                while known < len(run.nodes) and np.array_equal(run.nodes[known], world.goal):
                    known += 1  # joined to the goal: its edge is judged with the others
                continue
        if distances.min() <= TOLERANCE:
            continue  # the target is a node already
        ends = [_step(run.nodes[i], target, world.step) for i in nearest]
        gaps = [
            clearances(run.nodes[i], end, world.discs).min(initial=1.0)
            for i, end in zip(nearest, ends, strict=True)
        ]
        if min(gaps) > TOLERANCE:
            return [_missed(world, run, k, known, int(nearest[0]), ends[0])]
    if known < len(run.nodes):
        text = f"Node {known} is not a step from the nearest node towards any target."
        return [Fault("each target is answered by the nearest node", text)]
    return []


def _missed(world: World, run: Run, k: int, known: int, nearest: int, end: Array) -> Fault:
    """Return why target k did not add the node that it should have."""
    where = f"({run.samples[k][0]:.4g}, {run.samples[k][1]:.4g})"
    if known < len(run.nodes):
        parent = int(run.parents[known])
        explained = False
        for later in run.samples[k:]:
            distances = np.hypot(*(run.nodes[:known] - later).T)
            is_step = _near(run.nodes[known], _step(run.nodes[parent], later, world.step))
            explained |= is_step
            if is_step and distances[parent] > distances.min() + TOLERANCE:
                text = (
                    f"Node {known} steps from node {parent}, {distances[parent]:.3g} m from its "
                    f"target; node {int(np.argmin(distances))} is nearer, {distances.min():.3g} m."
                )
                slip = "newest_for_nearest" if parent == known - 1 else ""
                return Fault("each target is answered by the nearest node", text, slip)
        origin, new = run.nodes[nearest], run.nodes[known]
        length, due = float(np.hypot(*(new - origin))), float(np.hypot(*(end - origin)))
        aligned = _near((new - origin) * due, (end - origin) * length)
        if parent == nearest and aligned and not explained:
            text = f"Node {known} goes {length:.6g} m towards target {k}, not {due:.6g} m."
            slip = "always_a_whole_step" if _whole_steps(world, run) else ""
            return Fault("steps are as long as they may be", text, slip)
    text = f"Target {k}, {where}, added no node, though the step from node {nearest} is free."
    retained = [
        _line_is_free(world, run.nodes[run.parents[i]], run.nodes[i]) for i in range(1, known)
    ]
    rejected = not _line_is_free(world, run.nodes[nearest], end)
    slip = "line_for_segment" if rejected and all(retained) else ""
    larger = world.discs * [1.0, 1.0, 0.0] + np.sqrt(world.discs * [0.0, 0.0, 1.0])
    if not slip and clearances(run.nodes[nearest], end, larger).min(initial=1.0) <= 0.0:
        edges = zip(run.nodes[run.parents[1:known]], run.nodes[1:known], strict=True)
        if all(clearances(a, b, larger).min(initial=1.0) > -TOLERANCE for a, b in edges):
            slip = "square_compared_with_radius"
    return Fault("free steps are kept", text, slip)


def _line_is_free(world: World, a: Array, b: Array) -> bool:
    """Return whether the endless line through an edge touches no disc."""
    along = (b - a) / np.hypot(*(b - a)) * 100.0
    return bool(clearances(a - along, a + along, world.discs).min(initial=1.0) > -TOLERANCE)


def _path(world: World, run: Run) -> list[Fault]:
    at_goal = [i for i, node in enumerate(run.nodes) if np.array_equal(node, world.goal)]
    spent = len(run.samples) >= world.max_samples
    if run.path is None:
        if at_goal:
            return [Fault("path", "The goal is in the tree, and the path is None.")]
        if not spent:
            text = f"It gave up after {len(run.samples)} of {world.max_samples} targets."
            return [Fault("ends when it should", text)]
        return []
    if not len(run.path):
        return [Fault("path", "An empty path came back. Without a path, None is asked for.")]
    wrong = path_faults(run.path, world.start, world.goal, world.discs, world.bounds, world.step)
    if not at_goal:
        message = wrong[0].sentence if wrong else "the path ends at the goal, the tree does not"
        text = f"{message[0].upper()}{message[1:]}. Without a path, None is asked for."
        if spent:
            return [Fault("path", text, "partial_path")]
        in_reach = np.hypot(*(run.path[-1] - world.goal)) <= world.step
        return [Fault("path", text, "goal_never_appended" if in_reach else "")]
    if np.array_equal(world.start, world.goal) and len(run.samples):
        return [Fault("ends when it should", "Start is goal, and targets were drawn.")]
    traced = [run.nodes[_chain(run, i)] for i in at_goal]
    if len(traced[0]) > 1 and any(np.array_equal(run.path, path[::-1]) for path in traced):
        return [Fault("path", "The path runs from goal to start.", "path_reversed")]
    if len(run.path) > len(traced[-1]) and np.array_equal(run.path, run.nodes):
        text = f"The path holds all {len(run.nodes)} nodes; {len(traced[0])} lead to the goal."
        return [Fault("path", text, "all_nodes_as_path")]
    if wrong:
        return [Fault("path", f"{wrong[0].sentence[0].upper()}{wrong[0].sentence[1:]}.")]
    if not any(run.path.shape == path.shape and _near(run.path, path) for path in traced):
        text = f"The path has {len(run.path)} points; parents lead through {len(traced[0])}."
        return [Fault("path", text)]
    if at_goal[-1] != len(run.nodes) - 1:
        return [Fault("ends when it should", "The goal was in the tree, and it went on drawing.")]
    return []


def _chain(run: Run, index: int) -> list[int]:
    chain = [index]
    while run.parents[chain[-1]] >= 0:
        chain.append(int(run.parents[chain[-1]]))
    return chain[::-1]
