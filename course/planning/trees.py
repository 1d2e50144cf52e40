"""Trees of states: RRT, RRT-Connect, RRT*, Informed RRT*.

Two compiled loops over arrays, each fed a chunk of samples at a time, so that time, progress and
an interrupt are seen between chunks and nothing is lost. RRT* is RRT with two more steps, informed
RRT* draws its targets elsewhere; so one loop is all three.

Sources: RRT LaValle (1998); RRT-Connect Kuffner and LaValle (2000); RRT* Karaman and Frazzoli
(2011), with the delayed collision checks of Perez et al. (2011); Informed RRT* Gammell et al.
(2014).
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.check import POSITIVE, invalid, one_of, vector
from course.compiled import MATRIX, VECTOR, address_of, compiled, from_address
from course.planning.neighbours import CHILD, SIBLING, WIDTH, entered, nearest, squared, within
from course.planning.problem import (
    GOAL_BLOCKED,
    LOOPS,
    METHODS,
    NO_SAMPLES,
    NO_TIME,
    SOLVED,
    Plan,
    Query,
    number,
)
from course.planning.samplers import (
    DRAWN,
    EDGE_CHECKS,
    LISTED,
    PRIMES,
    SAMPLERS,
    SAMPLES,
    STATE_CHECKS,
    TRIES,
    UNIFORM,
    draw,
    uniform,
)
from course.planning.worlds import EDGE, STATE

Array = NDArray[np.float64]

# Further counts, of both trees where there are two: nodes, those in the k-d tree; the node at the
# goal, or where the trees meet; how many states of the goal were drawn; nodes on the way from there
# back to the root, whose settings are in room[1] and room[2].
NODES, DONE, LAST, ROOTS, WAY = 4, 6, 8, 10, 11
# Of a chain of RRT-Connect that is not at its end: the node that it goes on from, plus one (0 where
# there is none); the node of the other tree that it goes to; the side whose turn it was.
CHAIN, MEETING, TURN = 13, 14, 15
# Nodes of a chain before it counts as another sample, so that both budgets hold for any step.
LONGEST = 1000
# What a loop ends with: the chunk is done, a path is found, the arrays are full.
GO_ON, FOUND, FULL = 0, 1, 2


class Settings(NamedTuple):
    """Parameters of a loop: the options of the caller, and what RRT* computes from the world.

    Attributes:
        step: longest edge [units of the states].
        goal_bias: share of the targets that are drawn from the goal, 0 to 1; RRT-Connect has none.
        sampler: number of the sampler, a value of `SAMPLERS`, or `LISTED` for given states.
        mix: share of the other targets that come from that sampler, 0 to 1; the rest is uniform.
        spread: standard deviation of the samplers that draw a pair of neighbours [units].
        gamma: factor of RRT*'s radius, gamma (log m / m)^(1/n) [units]; 0 is plain RRT.
        informed: whether RRT* draws its targets in the ellipsoid once there is a path.
        shortest: straight distance from start to goal, the informed one's lower bound [units].
    """

    step: float
    goal_bias: float
    sampler: int
    mix: float
    spread: float
    gamma: float
    informed: bool
    shortest: float


# The same record as the compiled loop's argument.
SETTINGS = types.NamedTuple(
    (
        types.float64,
        types.float64,
        types.int64,
        types.float64,
        types.float64,
        types.float64,
        types.boolean,
        types.float64,
    ),
    Settings,
)


@register_jitable
def _add(nodes, parents, links, costs, counts, side, state, parent, cost):
    """Add a node under its parent and return its number."""
    i = counts[NODES + side]
    counts[NODES + side] += 1
    nodes[side, i] = state
    parents[side, i], costs[side, i] = parent, cost
    links[side, i, CHILD] = links[side, i, SIBLING] = -1
    # Children of a node form a linked list (first child, next sibling): rewiring and the update of
    # a whole branch then need no search for the nodes below.
    if parent >= 0:
        links[side, i, SIBLING] = links[side, parent, CHILD]
        links[side, parent, CHILD] = i
    return i


@register_jitable
def _near(nodes, links, counts, side, q, stack, gaps):
    """Return the node of one tree nearest to q."""
    count = counts[NODES + side]
    # Nodes added since the last query enter the k-d tree now, as one batch, which `entered` can
    # order so that the tree stays shallow.
    counts[DONE + side] = entered(nodes[side], links[side], count, counts[DONE + side])
    return nearest(nodes[side], links[side], count, counts[DONE + side], q, stack, gaps)


@register_jitable
def _steer(origin, target, step, out):
    """Write the state at most a step from the origin towards the target into `out`.

    It returns the distance of that state from the origin.
    """
    # Steer of Karaman and Frazzoli (2011). Within a step the target is copied exactly, so that two
    # trees can meet without a tolerance.
    distance = math.sqrt(squared(origin, target))
    if distance <= step:
        out[:] = target
        return distance
    for i in range(out.size):
        out[i] = origin[i] + step / distance * (target[i] - origin[i])
    return step


@register_jitable
def _move(parents, links, costs, nodes, i, parent, stack):
    """Rewire node i to another parent, and update the costs of all nodes below it."""
    # Unlink i from the old parent's list of children.
    old = parents[i]
    if links[old, CHILD] == i:
        links[old, CHILD] = links[i, SIBLING]
    else:
        at = links[old, CHILD]
        while links[at, SIBLING] != i:
            at = links[at, SIBLING]
        links[at, SIBLING] = links[i, SIBLING]
    # Link it at the head of the new parent's list.
    parents[i], links[i, SIBLING] = parent, links[parent, CHILD]
    links[parent, CHILD] = i
    # Propagate the new cost through the branch, depth first. Costs are summed afresh from the
    # parent, so rounding does not accumulate over rewirings.
    stack[0], top = i, 1
    while top > 0:
        top -= 1
        at = stack[top]
        costs[at] = costs[parents[at]] + math.sqrt(squared(nodes[parents[at]], nodes[at]))
        below = links[at, CHILD]
        while below >= 0:
            stack[top] = below
            top += 1
            below = links[below, SIBLING]


@register_jitable
def _ellipsoid(centre, axes, shortest, best, bounds, rng, out):
    """Sample a state through which a path could be shorter than `best` (Gammell et al., 2014).

    It is uniform in the ellipsoid whose foci are start and goal. Returns False where none of
    `TRIES` samples is within the bounds.
    """
    # Semi-axis across: points of the ellipsoid have distances to start and goal that sum to `best`.
    # The maximum guards a `best` that rounding has put below the shortest length.
    across = 0.5 * math.sqrt(max(best * best - shortest * shortest, 0.0))
    ball = np.empty(out.size)
    for _ in range(TRIES):
        square = 0.0
        for i in range(out.size):
            ball[i] = rng.standard_normal()
            square += ball[i] * ball[i]
        # A normal direction and the n-th root of a uniform number are uniform in the unit ball.
        radius = rng.random() ** (1.0 / out.size) / math.sqrt(square)
        inside = True
        for i in range(out.size):
            out[i] = centre[i]
            for j in range(out.size):
                half = 0.5 * best if j == 0 else across
                out[i] += axes[i, j] * half * radius * ball[j]
            inside = inside and bounds[0, i] <= out[i] <= bounds[1, i]
        if inside:
            return True
    return False


@register_jitable
def _target(state_free, obstacles, body, bounds, settings, frame, counts, rng, out):
    """Draw a state from the sampler, or for the share that is not mixed in, from everywhere.

    Listed states are the last rows of the frame; after them comes uniform too.
    """
    kind = settings.sampler
    # A share of uniform targets preserves probabilistic completeness, which a biased sampler alone
    # may lose.
    if settings.mix < 1.0 and rng.random() >= settings.mix:
        kind = UNIFORM
    if kind == LISTED:
        row = out.size + 2 + counts[DRAWN]
        if row < frame.shape[0]:
            counts[DRAWN] += 1
            out[:] = frame[row]
            return
        kind = UNIFORM
    spread, shift = settings.spread, frame[0]
    draw(kind, state_free, obstacles, body, bounds, spread, shift, counts, rng, out)


@register_jitable
def _grow(
    state_free,
    edge_free,
    obstacles,
    body,
    bounds,
    goal,
    settings,
    frame,
    nodes,
    parents,
    links,
    costs,
    room,
    gaps,
    counts,
    rng,
    samples,
):
    """Grow one tree from the start: RRT, and with a gamma RRT*, which goes on after a path.

    It returns a code: why it stopped.

    `frame` holds Halton's shift, the centre between start and goal, the axes of the ellipsoid, and
    the states of a list; `room` is scratch for stacks. counts[LAST] is the best node at the goal,
    -1 before.
    """
    n = bounds.shape[1]
    step, star = settings.step, settings.gamma > 0.0
    target, new, joint = np.empty(n), np.empty(n), np.empty(n)
    tree, parent_of, link, cost = nodes[0], parents[0], links[0], costs[0]
    stack, result, known, goals = room[0], room[1], room[2], room[3]
    for _ in range(samples):
        # Two free rows are needed: the new node, and perhaps a state of the goal.
        if counts[NODES] + 2 > tree.shape[0]:
            return FULL
        counts[SAMPLES] += 1
        # SampleFree: a goal state with the bias, else the informed set once there is a path.
        best = cost[counts[LAST]] if counts[LAST] >= 0 else np.inf
        if settings.goal_bias > 0.0 and rng.random() < settings.goal_bias:
            uniform(goal[0], goal[1], rng, target)
        elif not (
            settings.informed
            and best < np.inf
            and _ellipsoid(frame[1], frame[2:], settings.shortest, best, bounds, rng, target)
        ):
            _target(state_free, obstacles, body, bounds, settings, frame, counts, rng, target)
        # Nearest and Steer: extend the nearest node by at most a step.
        near = _near(nodes, links, counts, 0, target, stack, gaps)
        length = _steer(tree[near], target, step, new)
        # The target is a node already, a goal state drawn twice for example: there is no edge to
        # add.
        if length == 0.0:
            continue
        counts[EDGE_CHECKS] += 1
        if not edge_free(obstacles, body, tree[near], new):
            continue
        hits = 0
        if star:  # the parent is the neighbour through which the way is shortest
            # Near: the ball shrinks with log m / m, so that each new node has O(log m) neighbours.
            count = counts[NODES] + 1
            radius = min(step, settings.gamma * (math.log(count) / count) ** (1.0 / n))
            hits = within(tree, link, counts[NODES], counts[DONE], new, radius, stack, result)
            for k in range(hits):
                gaps[k] = math.sqrt(squared(tree[result[k]], new))
                known[k] = 1 if result[k] == near else 0
            # choose_parent: try the neighbours from the cheapest on, each edge only if it would be
            # better than the best free one so far (delayed collision checks, Perez et al., 2011).
            while True:
                better, through = -1, cost[near] + length
                for k in range(hits):
                    if known[k] == 0 and cost[result[k]] + gaps[k] < through:
                        better, through = k, cost[result[k]] + gaps[k]
                if better < 0:
                    break
                counts[EDGE_CHECKS] += 1
                known[better] = -1
                if edge_free(obstacles, body, tree[result[better]], new):
                    known[better] = 1
                    near, length = result[better], gaps[better]
        # rewire: the new node becomes the parent of each neighbour that it brings a shorter path.
        i = _add(nodes, parents, links, costs, counts, 0, new, near, cost[near] + length)
        for k in range(hits):  # neighbours to which the way through the new node is shorter
            j = result[k]
            if known[k] >= 0 and cost[i] + gaps[k] < cost[j]:
                if known[k] == 0:
                    counts[EDGE_CHECKS] += 1
                if known[k] == 1 or edge_free(obstacles, body, new, tree[j]):
                    _move(parent_of, link, cost, tree, j, i, stack)
        # Join the goal: the state of its box that is nearest to the new node.
        for k in range(n):
            joint[k] = min(max(new[k], goal[0, k]), goal[1, k])
        length = math.sqrt(squared(new, joint))
        last = counts[LAST]
        at = -1
        # The new node itself lies in the goal's box.
        if length == 0.0:
            at = i
        elif length <= step and (last < 0 or cost[i] + length < cost[last]):
            counts[EDGE_CHECKS] += 1
            if edge_free(obstacles, body, new, joint):
                # The best goal node is this very state: rewire it instead of adding a duplicate.
                if last >= 0 and squared(tree[last], joint) == 0.0:
                    _move(parent_of, link, cost, tree, last, i, stack)
                else:
                    at = _add(nodes, parents, links, costs, counts, 0, joint, i, cost[i] + length)
        if at >= 0:
            goals[counts[ROOTS]] = at
            counts[ROOTS] += 1
            if not star:
                counts[LAST] = at
                return FOUND
        for k in range(counts[ROOTS]):  # rewiring may have made another one the best
            if counts[LAST] < 0 or cost[goals[k]] < cost[counts[LAST]]:
                counts[LAST] = goals[k]
    return GO_ON


@register_jitable
def _connect(
    state_free,
    edge_free,
    obstacles,
    body,
    bounds,
    goal,
    settings,
    frame,
    nodes,
    parents,
    links,
    costs,
    room,
    gaps,
    counts,
    rng,
    samples,
):
    """Grow two trees, which take turns; return whether they met, or the arrays are full.

    One extends by a step towards a sample, the other connects: it goes on towards that new node for
    as long as it is free to. A chain may take any number of steps, so it is left and taken up again
    where the arrays are full, and after each `LONGEST` nodes, which count as a sample. Arguments as
    of `_grow`.
    """
    n = bounds.shape[1]
    step = settings.step
    target, new, here = np.empty(n), np.empty(n), np.empty(n)
    stack = room[0]
    region = False
    for k in range(n):
        region = region or goal[0, k] < goal[1, k]
    began = counts[SAMPLES]
    while counts[CHAIN] > 0 or counts[SAMPLES] - began < samples:
        # Free rows for a root in the goal's box, the extension and one node of a chain. The chain
        # checks for more room itself.
        if max(counts[NODES], counts[NODES + 1]) + 3 > nodes.shape[1]:
            return FULL
        if counts[CHAIN] == 0:
            # Swap: the trees take turns, by the parity of the samples (Kuffner and LaValle, 2000).
            side = counts[SAMPLES] % 2
            counts[SAMPLES] += 1
            # Draw further states of a goal region as roots, about one for every two nodes of that
            # tree: a single root could lie in a dead end.
            if region and counts[ROOTS] <= counts[NODES + 1] // 2:  # another state of the goal
                counts[ROOTS] += 1
                counts[STATE_CHECKS] += 1
                uniform(goal[0], goal[1], rng, target)
                if state_free(obstacles, body, target):
                    _add(nodes, parents, links, costs, counts, 1, target, -1, 0.0)
            _target(state_free, obstacles, body, bounds, settings, frame, counts, rng, target)
            # Extend: one step of this tree towards the sample.
            at = _near(nodes, links, counts, side, target, stack, gaps)
            for k in range(n):  # a copy costs less than a view
                here[k] = nodes[side, at, k]
            length = _steer(here, target, step, new)
            if length > 0.0:
                counts[EDGE_CHECKS] += 1
                # An edge of the goal's tree is driven towards its root.
                a, b = (here, new) if side == 0 else (new, here)
                if not edge_free(obstacles, body, a, b):
                    continue  # trapped
                cost = costs[side, at] + length
                meeting = _add(nodes, parents, links, costs, counts, side, new, at, cost)
                # The chain begins at the other tree's node nearest to the new one.
                target[:] = new
                at = _near(nodes, links, counts, 1 - side, target, stack, gaps)
                counts[CHAIN], counts[MEETING], counts[TURN] = at + 1, meeting, side
            if counts[CHAIN] == 0:
                continue
        # Connect: the other tree goes on towards the new node until something is in the way.
        side, meeting, at = counts[TURN], counts[MEETING], counts[CHAIN] - 1
        target[:] = nodes[side, meeting]
        free = reached = False
        for _ in range(LONGEST):
            for k in range(n):
                here[k] = nodes[1 - side, at, k]
            length = _steer(here, target, step, new)
            # Steer has copied the target if it was less than a step away; the second test catches a
            # target exactly one step away.
            reached = length < step or squared(new, target) == 0.0
            free = True
            if length > 0.0:
                counts[EDGE_CHECKS] += 1
                a, b = (here, new) if side == 1 else (new, here)
                free = edge_free(obstacles, body, a, b)
                if free:
                    cost = costs[1 - side, at] + length
                    at = _add(nodes, parents, links, costs, counts, 1 - side, new, at, cost)
            # Store the front of the chain, so that the next call can resume it.
            counts[CHAIN] = at + 1
            if reached or not free:
                break
            if counts[NODES + 1 - side] == nodes.shape[1]:
                return FULL
        # Trapped: drop the chain. The next sample begins another one.
        if not free:
            counts[CHAIN] = 0
        elif reached:
            counts[CHAIN] = 0
            # The trees share this state: store its node in each, where tracing the path begins.
            counts[LAST + side], counts[LAST + 1 - side] = meeting, at
            return FOUND
        else:
            # A chain still under way is charged as one more sample, so that the budget ends it too.
            counts[SAMPLES] += 1
            if counts[SAMPLES] - began >= samples:
                break
    return GO_ON


CUBE = types.Array(numba.float64, 3, "C")

_state_at, _edge_at = (from_address(types.FunctionType(kind)) for kind in (STATE, EDGE))
_rng_at = from_address(types.npy_rng)


def _run(
    state,
    edge,
    rng,
    obstacles,
    body,
    bounds,
    goal,
    settings,
    frame,
    nodes,
    parents,
    links,
    costs,
    room,
    gaps,
    counts,
    samples,
):
    """Run a chunk of either loop and return its exit code.

    The world's functions and the random generator are passed as addresses. The root of each tree is
    its node 0. After a solution `room` holds the nodes of the path of each tree.
    """
    # First call: enter the roots, which the caller has stored in row 0 of each tree.
    if counts[NODES] == 0:
        counts[LAST] = counts[LAST + 1] = -1
        for side in range(nodes.shape[0]):
            _add(nodes, parents, links, costs, counts, side, nodes[side, 0], -1, 0.0)
    state_free, edge_free, draws = _state_at(state), _edge_at(edge), _rng_at(rng)
    if nodes.shape[0] == 2:
        code = _connect(
            state_free,
            edge_free,
            obstacles,
            body,
            bounds,
            goal,
            settings,
            frame,
            nodes,
            parents,
            links,
            costs,
            room,
            gaps,
            counts,
            draws,
            samples,
        )
    else:
        code = _grow(
            state_free,
            edge_free,
            obstacles,
            body,
            bounds,
            goal,
            settings,
            frame,
            nodes,
            parents,
            links,
            costs,
            room,
            gaps,
            counts,
            draws,
            samples,
        )
    # Trace the path back from the goal node, or from the meeting in both trees, to the roots.
    for side in range(nodes.shape[0] if counts[LAST] >= 0 else 0):
        at, steps = counts[LAST + side], 0
        while at >= 0:
            room[1 + side, steps] = at
            steps += 1
            at = parents[side, at]
        counts[WAY + side] = steps
    return code


@functools.cache
def _kernel() -> Any:
    """Return `_run` compiled, with one signature for every world, robot and method."""
    ints, whole = [types.Array(numba.int64, k, "C") for k in range(1, 4)], types.int64
    # The world's two functions and the generator come as addresses, so another world compiles
    # nothing. Obstacles, body, bounds and goal follow.
    world = (types.uintp,) * 3 + (MATRIX,) * 4
    # In the order of the arguments: settings, frame; nodes, parents, links and costs of the trees;
    # room, gaps, counts.
    arrays = (SETTINGS, MATRIX, CUBE, ints[1], ints[2], MATRIX, ints[1], VECTOR, ints[0])
    return compiled(_run, whole(*world, *arrays, whole))


def _options(query: Query) -> tuple[Settings, Array]:
    """Take the options of a tree out of the query, checked.

    Returns:
        The settings of the loop, without what only RRT* needs, and the targets of a sampler that
        is a list of states, shape (n of them, dim); no row for a sampler with a name.

    Raises:
        ValueError: for an option out of its range, a state out of bounds, or an unknown option.
    """
    world = query.world
    sampler = query.option("sampler", "uniform")
    listed = np.empty((world.dim, 0))
    kind = LISTED
    if isinstance(sampler, str):
        kind = SAMPLERS[one_of("sampler", sampler, SAMPLERS)]
    else:
        listed = vector("sampler", sampler, (world.dim, None))
        if not ((listed.T >= world.bounds[0]) & (listed.T <= world.bounds[1])).all():
            raise invalid("sampler", sampler, "states within the bounds of the world")
    settings = Settings(
        step=number(query, "step", 0.2 * world.extent, POSITIVE),
        # A few targets at the goal itself pull the tree there. Many would make it push against
        # whatever stands between (LaValle, 2006, sec. 5.5.3). The second tree of RRT-Connect does
        # this job, so it takes no bias.
        goal_bias=0.0
        if query.method == "rrt_connect"
        else number(query, "goal_bias", 0.05, 0.0, 1.0),
        sampler=kind,
        # Below 1, the remaining targets are uniform: a biased sampler alone may never reach some
        # part of the free space.
        mix=number(query, "mix", 1.0, 0.0, 1.0),
        spread=number(query, "spread", 0.05 * world.extent, POSITIVE),
        gamma=0.0,
        informed=False,
        shortest=0.0,
    )
    if kind == SAMPLERS["halton"] and world.dim > len(PRIMES):
        raise invalid("sampler", sampler, f"up to {len(PRIMES)} dimensions")
    # Each option that was read has been removed, so what remains has no meaning here.
    query.reject_unknown()
    return settings, listed.T


def _search(query: Query, settings: Settings, frame: Array, *roots: Array) -> Plan:
    """Grow one tree or two, chunk by chunk, until there is a path or the budget is spent."""
    world, counts, budget = query.world, query.counts, query.budget
    samples, seconds = budget.samples, budget.seconds
    n, sides = world.dim, len(roots)
    arrays = _arrays(sides, 256, n)
    for side in range(sides):
        arrays[0][side, 0] = roots[side]
    kernel, timed, rng = _kernel(), seconds < math.inf, address_of(query.rng)
    tables = (world.obstacles, world.body, world.bounds, query.goal, settings, frame)
    # The clock is read only between chunks, so with a time limit the first chunks are small.
    chunk, star, history, best = 4 if timed else 64, settings.gamma > 0.0, [], math.inf
    code, done, now = GO_ON, 0, 0.0
    while code != FOUND and done < samples and now < seconds:
        code = kernel(*world.addresses, rng, *tables, *arrays, counts, min(chunk, samples - done))
        last, now, done = now, query.seconds, int(counts[SAMPLES])
        if code == FULL:
            # Double the arrays, so that growth costs O(1) per node, and call again: all state of
            # the loop is in these arrays and in `counts`.
            larger = _arrays(sides, 2 * len(arrays[5]), n)
            for old, new in zip(arrays, larger, strict=True):
                new[tuple(slice(k) for k in old.shape)] = old
            arrays = larger
        if star and counts[LAST] >= 0 and arrays[3][0, counts[LAST]] < best:
            best = arrays[3][0, counts[LAST]]
            history.append((done, now, best))
        # Only where time is limited do the chunks depend on a clock.
        if code == GO_ON and chunk < 1024 and not (timed and now - last >= 1e-3):
            chunk *= 2
        query.report_progress(f"{done} of {samples} samples")
    nodes, parents, _, costs, room, _ = arrays
    _, _, _, _, count, others, _, _, end, _, _, far, onward, *_ = counts.tolist()
    tree = {"nodes": nodes[0, :count], "parents": parents[0, :count], "costs": costs[0, :count]}
    if sides == 2:
        # The plan has one list of nodes: parents in the second tree are shifted by the size of the
        # first, and its roots stay at -1.
        above = parents[1, :others]
        rest = (nodes[1, :others], above + count * (above >= 0), costs[1, :others])
        for name, more in zip(("nodes", "parents", "costs"), rest, strict=True):
            tree[name] = np.concatenate((tree[name], more))
    tree["nodes"] = tree["nodes"].T
    if star:
        tree["history"] = np.array(history).reshape(-1, 3).T
    if end < 0:
        return query.answer(NO_SAMPLES if done >= samples else NO_TIME, **tree)
    path = nodes[0, room[1, :far][::-1]]
    if sides == 2:  # the state where the trees meet is in both
        path = np.concatenate((path, nodes[1, room[2, 1:onward]]))
    return query.answer(SOLVED, path, **tree)


def _arrays(sides: int, size: int, n: int) -> tuple[Any, ...]:
    """Allocate nodes, parents, links and costs of each tree, and stacks of integers and floats."""
    return (
        np.empty((sides, size, n)),
        np.empty((sides, size), dtype=np.int64),
        np.empty((sides, size, WIDTH), dtype=np.int64),
        np.empty((sides, size)),
        np.empty((4, size), dtype=np.int64),
        np.empty(size),
    )


def _chain(parents: NDArray[np.int64], last: int) -> list[int]:
    """Return a node and all above it, up to the root."""
    chain = [last]
    while parents[chain[-1]] >= 0:
        chain.append(int(parents[chain[-1]]))
    return chain


def _frame(query: Query, settings: Settings, listed: Array) -> tuple[Settings, Array]:
    """Return the settings with the shortest distance, and the rows that the samplers need.

    The rows have the shape (n + 2 + listed, n).

    Row 0 is the random shift of Halton's sequence. Row 1 is the centre of the informed ellipsoid,
    and the next n rows are its axes: an orthogonal matrix whose first column points from start to
    goal, computed as a Householder reflection of the first axis. Listed states come last.
    """
    n = query.world.dim
    frame = np.zeros((n + 2 + len(listed), n))
    frame[n + 2 :] = listed
    if settings.sampler == SAMPLERS["halton"]:
        frame[0] = query.rng.random(n)
    if settings.informed:
        along = query.goal[0] - query.start
        settings = settings._replace(shortest=float(np.linalg.norm(along)))
        # Householder reflection of the first axis to the direction of the goal, up to its sign,
        # which does not matter to an ellipsoid. Equal signs in the pivot avoid cancellation.
        mirror = along / settings.shortest
        frame[1] = 0.5 * (query.start + query.goal[0])
        frame[2 : n + 2] = np.eye(n)
        sign = -1.0 if mirror[0] < 0.0 else 1.0
        mirror[0] += sign
        frame[2 : n + 2] -= 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    return settings, frame


def rrt(query: Query) -> Plan:
    """Grow a tree from the start until an edge of at most a step joins a node to the goal.

    In a world of discs this is the drill's RRT: the same draws give the same tree.
    """
    settings, listed = _options(query)
    return _search(query, *_frame(query, settings, listed), query.start)


def rrt_star(query: Query) -> Plan:
    """Grow a tree as RRT does, choose each new node's best parent and rewire its neighbours.

    The new node gets the parent through which its path is shortest, and becomes the parent of each
    neighbour whose path it shortens. The best path's length never rises, and falls towards the
    optimum.

    The neighbours are those within gamma (log m / m)^(1/n), at most a step, of m nodes, with gamma
    1.1 times the least that theorem 38 of Karaman and Frazzoli (2011) asks for, the whole box taken
    as free. Its proof has a gap; what is proved is a radius that shrinks with 1 / (n + 1) instead
    of 1 / n (Solovey et al., 2020). That this one converges too is measured.
    The informed one draws in the ellipsoid that can shorten the best path.
    """
    settings, listed = _options(query)
    n = query.world.dim
    # Volume of the unit ball in n dimensions.
    ball = math.pi ** (n / 2) / math.gamma(n / 2 + 1)
    volume = float(np.prod(query.world.bounds[1] - query.world.bounds[0]))
    settings = settings._replace(
        gamma=1.1 * (2.0 * (1.0 + 1.0 / n) * volume / ball) ** (1.0 / n),
        informed=query.method == "informed_rrt_star",
    )
    if settings.informed and not query.one_goal:
        raise invalid("goal", "a region", f"a state, for {query.method}")
    return _search(query, *_frame(query, settings, listed), query.start)


def rrt_connect(query: Query) -> Plan:
    """Grow two trees, from the start and from the goal, until they meet; there is no goal bias."""
    settings, listed = _options(query)
    root = query.goal_root()
    if root is None:
        return query.answer(GOAL_BLOCKED)
    query.counts[ROOTS] = not query.one_goal
    return _search(query, *_frame(query, settings, listed), query.start, root)


METHODS.update(rrt=rrt, rrt_connect=rrt_connect, rrt_star=rrt_star, informed_rrt_star=rrt_star)
LOOPS.update(dict.fromkeys(("rrt", "rrt_connect", "rrt_star", "informed_rrt_star"), _kernel))


def warm() -> None:
    """Compile, or load from the cache, the loops of the trees."""
    _kernel()
