"""Roadmaps: PRM, PRM*, lazy PRM, and a cached roadmap that answers while obstacles move.

A roadmap is free states and the edges between neighbours; of each edge it is known that it is free,
that it is blocked, or not yet. A search asks only the edges on the way that it is about to answer
with (Bohlin and Kavraki, 2000), so a new obstacle costs the checks of a few edges, not of all.
If an obstacle has gone, what was blocked counts as not known again.

Sources: PRM Kavraki, Svestka, Latombe and Overmars (1996); PRM* Karaman and Frazzoli (2011).
"""

from __future__ import annotations

import functools
import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, one_of
from course.compiled import MATRIX, VECTOR, compiled
from course.planning.neighbours import WIDTH, brute_below, entered, nearest, squared
from course.planning.problem import (
    GOAL_BLOCKED,
    LOOPS,
    METHODS,
    NO_SAMPLES,
    NO_TIME,
    SOLVED,
    Budget,
    Plan,
    Query,
    number,
)
from course.planning.samplers import (
    EDGE_CHECKS,
    SAMPLERS,
    SAMPLES,
    STATE_CHECKS,
    UNIFORM,
    draw,
    uniform,
)
from course.planning.trees import _chain
from course.planning.worlds import DISC, EDGE, STATE, World

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# What is known of an edge. AGAIN: it was free, and only obstacles that have come since are asked.
BLOCKED, UNKNOWN, FREE, AGAIN = -1, 0, 1, 2
# Further counts: nodes and edges of the roadmap; nodes of the two trees that grow onto it, and the
# places where they hang on it.
NODES, EDGES, TREES, HOOKS = 4, 5, 6, 8
# Slots of the settings of a loop, an array of floats. NEAREST: neighbours of a node, 0 for as many
# as PRM* takes. MIX: share of the states that come from SAMPLER, the rest is uniform; SPREAD: of
# its pairs of neighbours. LAZY, STOP: flags, see `_grow`. STEP, NEAR: of `_attach` only.
NEAREST, SAMPLER, MIX, SPREAD, LAZY, STOP, STEP, NEAR = range(8)
LIST = 10  # nodes of the roadmap that an end tries to be joined to by a straight edge


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def _closest(nodes, count, q, desired, result, gaps):
    """Fill `result` with the `desired` nodes nearest to q among the first `count`; return how many.

    They are in order of their distance. `gaps` receives the squared distances (insertion sort).
    """
    hits = 0
    # Insertion into a sorted list of at most `desired` hits.
    for i in range(count):
        square = squared(nodes[i], q)
        if hits == desired and square >= gaps[hits - 1]:
            continue
        at = hits if hits < desired else hits - 1
        hits = min(hits + 1, desired)
        while at > 0 and gaps[at - 1] > square:
            gaps[at], result[at] = gaps[at - 1], result[at - 1]
            at -= 1
        gaps[at], result[at] = square, i
    return hits


@register_jitable
def _part(parts, i):
    """Return the representative of node i's connected component (union-find, path halving)."""
    while parts[i] != i:
        parts[i] = parts[parts[i]]
        i = parts[i]
    return i


@register_jitable
def _grow(
    state_free,
    edge_free,
    obstacles,
    body,
    bounds,
    numbers,
    shift,
    nodes,
    parts,
    pairs,
    status,
    counts,
    rng,
    samples,
):
    """Draw `samples` states and join those that are free to their neighbours.

    With numbers[STOP] it ends, and says so, as soon as nodes 0 and 1 are joined; lazily no edge is
    asked.
    """
    n = bounds.shape[1]
    q, result, gaps = np.empty(n), np.empty(64, np.int64), np.empty(64)
    for _ in range(samples):
        i = counts[NODES]
        counts[SAMPLES] += 1
        kind = int(numbers[SAMPLER])
        # A share of uniform samples covers what a biased sampler never reaches.
        if numbers[MIX] < 1.0 and rng.random() >= numbers[MIX]:
            kind = UNIFORM
        # SampleFree: a roadmap stores free states only.
        draw(kind, state_free, obstacles, body, bounds, numbers[SPREAD], shift, counts, rng, q)
        counts[STATE_CHECKS] += 1
        if not state_free(obstacles, body, q):
            continue
        nodes[i], parts[i] = q, i
        counts[NODES] += 1
        # k-PRM* (Karaman and Frazzoli, 2011, sec. 3.3): e (1 + 1 / n) log m neighbours suffice for
        # almost sure convergence to the optimum.
        desired = int(numbers[NEAREST])
        if desired == 0:
            desired = min(64, math.ceil(math.e * (1.0 + 1.0 / n) * math.log(i + 1.0)))
        # Neighbours are searched among the earlier nodes only, so each pair is joined at most once.
        for k in range(_closest(nodes, i, q, desired, result, gaps)):
            j, e = result[k], counts[EDGES]
            pairs[e, 0], pairs[e, 1], status[e] = j, i, UNKNOWN
            counts[EDGES] += 1
            # PRM checks edges at once; lazy PRM leaves them unknown until a query's path uses them.
            if numbers[LAZY] == 0.0:
                counts[EDGE_CHECKS] += 1
                status[e] = FREE if edge_free(obstacles, body, nodes[j], q) else BLOCKED
                # Union of the two components: PRM's test of connectivity needs no graph search.
                if status[e] == FREE:
                    parts[_part(parts, i)] = _part(parts, j)
        # Nodes 0 and 1 are start and goal: one component contains both once there is a path.
        if numbers[STOP] > 0.0 and _part(parts, 0) == _part(parts, 1):
            return True
    return False


@register_jitable
def _resolve(edge_free, obstacles, fresh, body, nodes, pairs, status, chosen, counts):
    """Ask about the chosen edges what is not known of them; whether all are free."""
    free = True
    for e in chosen:
        # Each edge is checked at most once; the answer stays in `status` for later queries.
        if status[e] == UNKNOWN or status[e] == AGAIN:
            counts[EDGE_CHECKS] += 1
            rows = fresh if status[e] == AGAIN else obstacles
            a, b = nodes[pairs[e, 0]], nodes[pairs[e, 1]]
            status[e] = FREE if edge_free(rows, body, a, b) else BLOCKED
        if status[e] == BLOCKED:
            free = False
    return free


@register_jitable
def _search(
    edge_free,
    obstacles,
    fresh,
    body,
    nodes,
    pairs,
    status,
    first,
    paths,
    begins,
    ends,
    goal,
    came,
    counts,
):
    """Search with lazy A* until a path is proved free; return its last node, -1 without a path.

    A* (Hart, Nilsson and Raphael, 1968) runs over the edges that are free or unknown. The edges of
    its best path are then checked, and the search runs again without those that are blocked. A path
    enters the roadmap at node i with cost begins[i] and leaves it with cost ends[i], both infinite
    for most nodes. `came` holds the edge through which each node was reached, -1 for a first node.
    """
    count = first.size - 1
    cost, chosen = np.empty(count), np.empty(count, np.int64)
    while True:
        # A*: the heuristic is the straight distance to the goal, which never overestimates, so the
        # first pop above the best known cost ends the search.
        heap = [(0.0, 0)]  # an empty list would leave Numba without the type of its entries
        heap.pop()
        last, best = -1, np.inf
        # A* with several sources: every node that is joined to the start enters with its cost so
        # far.
        for i in range(count):
            cost[i], came[i] = begins[i], -1
            if begins[i] < np.inf:
                heapq.heappush(heap, (begins[i] + math.sqrt(squared(nodes[i], goal)), i))
        while len(heap) > 0:
            bound, i = heapq.heappop(heap)
            if bound >= best:
                break
            # Lazy deletion: a node is pushed again when its cost falls, and outdated entries are
            # skipped.
            if bound > cost[i] + math.sqrt(squared(nodes[i], goal)):
                continue  # it was reached on a shorter way since
            # Through a node that is joined to the goal the path is complete: ends[i] is what
            # remains.
            if cost[i] + ends[i] < best:
                last, best = i, cost[i] + ends[i]
            for w in range(first[i], first[i + 1]):
                e = paths[w]
                if status[e] == BLOCKED:
                    continue
                # The sum of an edge's ends minus one of them is the other one.
                j = pairs[e, 0] + pairs[e, 1] - i
                far = cost[i] + math.sqrt(squared(nodes[i], nodes[j]))
                if far < cost[j]:
                    cost[j], came[j] = far, e
                    heapq.heappush(heap, (far + math.sqrt(squared(nodes[j], goal)), j))
        if last < 0:
            return -1
        # Trace the path back to its first node, then check its edges.
        i, steps = last, 0
        while came[i] >= 0:
            chosen[steps] = came[i]
            steps += 1
            i = pairs[came[i], 0] + pairs[came[i], 1] - i
        # Lazy collision checking (Bohlin and Kavraki, 2000): a blocked edge causes another search,
        # which then avoids it.
        if _resolve(
            edge_free, obstacles, fresh, body, nodes, pairs, status, chosen[:steps], counts
        ):
            return last


@register_jitable
def _hook(edge_free, obstacles, body, nodes, trees, hooks, counts, side, i, node):
    """Join node i of a tree to a node of the roadmap, where the edge is free."""
    counts[EDGE_CHECKS] += 1
    if not edge_free(obstacles, body, trees[side, i], nodes[node]):
        return False
    hooks[side, counts[HOOKS + side], 0], hooks[side, counts[HOOKS + side], 1] = i, node
    counts[HOOKS + side] += 1
    return True


def _attach(
    edge_free,
    obstacles,
    body,
    bounds,
    numbers,
    nodes,
    links,
    trees,
    parents,
    hooks,
    counts,
    side,
    rng,
    samples,
    stack,
    gaps,
):
    """Grow one end's tree until it hangs on the roadmap once more, or meets the other end's tree.

    A share numbers[NEAR] of the targets lies around the end, where the way out is; each new node
    tries the nearest node of the roadmap and of the other tree. Returns 1 for a hook, 2 for a
    meeting of the last node with node hooks[side, 0, 1] of the other tree, 0 for neither.
    """
    n, count, other = bounds.shape[1], nodes.shape[0], 1 - side
    target, new = np.empty(n), np.empty(n)
    # `entered` has built the roadmap's k-d tree only above this size. The small trees of the two
    # ends are searched exhaustively.
    built = count if count > brute_below(n) else 0
    for _ in range(samples):
        if counts[TREES + side] >= trees.shape[1]:
            return 0
        counts[SAMPLES] += 1
        # Sample everywhere, or with probability NEAR around this end, where the roadmap was missed.
        uniform(bounds[0], bounds[1], rng, target)
        if rng.random() < numbers[NEAR]:
            for k in range(n):
                target[k] = trees[side, 0, k] + numbers[SPREAD] * rng.standard_normal()
                target[k] = min(max(target[k], bounds[0, k]), bounds[1, k])
        # Extend the tree of this end by one step, as RRT does.
        at = nearest(trees[side], links, counts[TREES + side], 0, target, stack, gaps)
        far = math.sqrt(squared(trees[side, at], target))
        if far == 0.0:
            continue
        share = min(1.0, numbers[STEP] / far)
        for k in range(n):
            new[k] = trees[side, at, k] + share * (target[k] - trees[side, at, k])
        counts[EDGE_CHECKS] += 1
        if not edge_free(obstacles, body, trees[side, at], new):
            continue
        i = counts[TREES + side]
        trees[side, i], parents[side, i] = new, at
        counts[TREES + side] += 1
        # The trees of both ends meet: a path without the roadmap.
        near = nearest(trees[other], links, counts[TREES + other], 0, new, stack, gaps)
        counts[EDGE_CHECKS] += 1
        if edge_free(obstacles, body, new, trees[other, near]):
            hooks[side, 0, 1] = near
            return 2
        if count == 0:
            continue
        # Else join the new node to the nearest node of the roadmap.
        near = nearest(nodes, links, count, built, new, stack, gaps)
        if counts[HOOKS + side] < hooks.shape[1] and _hook(
            edge_free, obstacles, body, nodes, trees, hooks, counts, side, i, near
        ):
            return 1
    return 0


def _list(edge_free, obstacles, body, nodes, trees, hooks, counts, side, at_most):
    """Join an end to its nearest nodes of the roadmap, as many as are free of `LIST`."""
    result, gaps = np.empty(LIST, np.int64), np.empty(LIST)
    for k in range(_closest(nodes, nodes.shape[0], trees[side, 0], LIST, result, gaps)):
        if counts[HOOKS + side] < at_most:
            _hook(edge_free, obstacles, body, nodes, trees, hooks, counts, side, 0, result[k])
    return counts[HOOKS + side]


def _enter(nodes, links):
    entered(nodes, links, nodes.shape[0], 0)


@functools.cache
def _compiled_once(function: Any) -> Any:
    """Compile one of the loops once for every world.

    What a world answers (`STATE`, `EDGE`) is handed in as function pointers, so that a new world
    compiles nothing.
    """
    state, edge = types.FunctionType(STATE), types.FunctionType(EDGE)
    one, two, three = (types.Array(numba.int64, k, "C") for k in (1, 2, 3))
    cube, M, V, integer = types.Array(numba.float64, 3, "C"), MATRIX, VECTOR, numba.int64
    rng = types.npy_rng
    signature = {
        _grow: types.boolean(state, edge, M, M, M, V, V, M, one, two, one, one, rng, integer),
        _resolve: types.boolean(edge, M, M, M, M, two, one, one, one),
        _search: integer(edge, M, M, M, M, two, one, one, one, V, V, V, one, one),
        _attach: integer(
            edge, M, M, M, V, M, two, cube, two, three, one, integer, rng, integer, one, V
        ),
        _list: integer(edge, M, M, M, cube, three, one, integer, integer),
        _enter: types.void(M, two),
    }[function]
    return compiled(function, signature)


# --- the roadmap ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Roadmap:
    """Free states and edges between neighbours, those that are blocked among them.

    Attributes:
        world: in which the edges were checked.
        nodes: one a row, shape (m, n).
        pairs: the two nodes of each edge, shape (e, 2).
        status: of each edge: `FREE`, `BLOCKED`, `UNKNOWN`, `AGAIN`, shape (e,).
        fresh: rows of obstacles that edges with `AGAIN` were not checked against.
        first, edges: the edges at node i are edges[first[i] : first[i + 1]].
        links: the k-d tree of the nodes.
    """

    world: World
    nodes: Array
    pairs: Ints
    status: Ints
    fresh: Array
    first: Ints
    edges: Ints
    links: Ints

    @property
    def memory(self) -> int:
        """Bytes of its arrays."""
        return sum(x.nbytes for x in vars(self).values() if isinstance(x, np.ndarray))


def _roadmap(world: World, nodes: Array, pairs: Ints, status: Ints) -> Roadmap:
    # Adjacency in compressed rows: edges of node i are edges[first[i]:first[i + 1]].
    ends = pairs.T.ravel()
    order = np.argsort(ends, kind="stable")
    first = np.concatenate(([0], np.cumsum(np.bincount(ends, minlength=len(nodes)))))
    links = np.zeros((len(nodes), WIDTH), dtype=np.int64)
    _compiled_once(_enter)(nodes, links)
    # Edge e has its two ends at e and e + len(pairs) of `ends`; the remainder is its number.
    edges = order % max(len(pairs), 1)
    # Tables of its own: whoever changes those of a world in place has changed the world.
    own = replace(
        world, bounds=world.bounds.copy(), obstacles=world.obstacles.copy(), body=world.body.copy()
    )
    return Roadmap(own, nodes, pairs, status, own.obstacles[:0], first, edges, links)


def build_roadmap(
    world: World,
    samples: int = 3000,
    rng: np.random.Generator | int = 0,
    *,
    neighbours: int = 0,
    lazy: bool = False,
) -> Roadmap:
    """Return a roadmap for many questions in one world.

    Args:
        world: the world; what moves later is better left out.
        samples: states drawn; those that are free become nodes.
        rng: random numbers, or a seed.
        neighbours: edges from each new node, to the nearest before it; 0 for as many as PRM* takes,
            e (1 + 1 / n) log m.
        lazy: whether edges are checked only when a path needs them.
    """
    rng = np.random.default_rng(rng)
    # There is no start or goal yet: the bounds fill these fields, which growing does not read.
    budget = Budget(samples)
    query = Query(world, world.bounds[0], world.bounds, budget, rng, "roadmap", {}, perf_counter())
    numbers, growing = _numbers(query, neighbours, lazy, False), _Growing(query, [])
    while query.counts[SAMPLES] < samples:
        growing.more(numbers, min(256, samples - int(query.counts[SAMPLES])))
    return growing.roadmap()


def adapted(roadmap: Roadmap, world: World) -> Roadmap:
    """Return the same roadmap in a world with other obstacles; nothing is checked yet.

    An edge that was free is checked again against the obstacles that have come, one that was
    blocked against all of them if some have gone. What a function of the user answers may have
    changed without a trace, so each of its edges is checked again.

    Raises:
        ValueError: the roadmap was built for another kind of world, another body or other bounds.
            Its nodes and edges say nothing about those.
    """
    built = roadmap.world
    if built.kind != world.kind:
        raise invalid("kind of the world", world.kind, f"that of the roadmap, {built.kind}")
    for name, now, then in (
        ("bounds", world.bounds, built.bounds),
        ("body", world.body, built.body),
    ):
        if not np.array_equal(now, then):
            raise invalid(
                f"{name} of the world", now.tolist(), f"that of the roadmap, {then.tolist()}"
            )
    # Obstacles are compared row by row as bytes: what is new decides which edges are stale.
    old, new = ({row.tobytes() for row in w.obstacles} for w in (roadmap.world, world))
    if old == new and world.kind != "function":
        return replace(roadmap, world=world)  # with the same table of what is known of edges
    come = np.array([row.tobytes() not in old for row in world.obstacles], dtype=bool)
    fresh = np.ascontiguousarray(world.obstacles[come])
    # A side of a polygon means nothing without the others, a function is one thing.
    single = world.kind == "capsule arm" or (fresh[:, 0] == DISC).all()
    fresh = fresh if single and world.kind != "function" else world.obstacles
    status = roadmap.status.copy()
    if world.kind == "function":
        status[:] = UNKNOWN
    if come.any():
        # A free edge can only be blocked by obstacles that have come since; a blocked edge can only
        # be freed by obstacles that have gone.
        status[status == FREE] = AGAIN
    if old - new:
        status[status == BLOCKED] = UNKNOWN
    if (status == AGAIN).any() and (roadmap.status == AGAIN).any():
        status[status == AGAIN] = UNKNOWN  # asked about neither world yet
    return replace(roadmap, world=world, status=status, fresh=fresh)


def revalidated(roadmap: Roadmap, world: World) -> tuple[Roadmap, int]:
    """Return the roadmap in a world with other obstacles, and how many edges were checked.

    All its edges are checked again.
    """
    now, counts = adapted(roadmap, world), np.zeros(16, dtype=np.int64)
    _compiled_once(_resolve)(
        world.kernels[1],
        world.obstacles,
        now.fresh,
        world.body,
        now.nodes,
        now.pairs,
        now.status,
        np.arange(len(now.pairs)),
        counts,
    )
    return now, int(counts[EDGE_CHECKS])


def _numbers(query: Query, neighbours: int, lazy: bool, stop: bool) -> Array:
    numbers, extent = np.zeros(8), query.world.extent
    numbers[NEAREST] = count("neighbours", neighbours, 0, 64)
    numbers[LAZY], numbers[STOP] = lazy, stop
    sampler = one_of("sampler", query.option("sampler", "uniform"), SAMPLERS)
    numbers[SAMPLER] = SAMPLERS[sampler]
    numbers[MIX] = number(query, "mix", 1.0, 0.0, 1.0)
    numbers[SPREAD] = number(query, "spread", 0.05 * extent, POSITIVE)
    query.reject_unknown()
    return numbers


class _Growing:
    """Arrays of a roadmap that grows, with room for more."""

    def __init__(self, query: Query, roots: list[Array]) -> None:
        self.query, n = query, query.world.dim
        self.nodes, self.parts = np.empty((0, n)), np.empty(0, dtype=np.int64)
        self.pairs, self.status = np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int64)
        self.shift = query.rng.random(n)
        self._room(1024)
        self.nodes[: len(roots)] = np.reshape(roots, (-1, n))
        query.counts[NODES] = len(roots)

    def _room(self, size: int) -> None:
        # A node brings at most 64 edges, one for each neighbour.
        for name, rows in (("nodes", 1), ("parts", 1), ("pairs", 64), ("status", 64)):
            old = getattr(self, name)
            new = np.zeros((rows * size, *old.shape[1:]), dtype=old.dtype)
            new[: len(old)] = old
            setattr(self, name, new)
        # Each row beyond the present nodes starts as a component of its own (union-find).
        count = self.query.counts[NODES]
        self.parts[count:] = np.arange(count, size)

    def more(self, numbers: Array, samples: int) -> bool:
        """Draw `samples` states; return whether nodes 0 and 1 are joined if that ends it."""
        world, counts = self.query.world, self.query.counts
        if counts[NODES] + samples > len(self.nodes):
            self._room(2 * len(self.nodes))
        return bool(
            _compiled_once(_grow)(
                *world.kernels,
                world.obstacles,
                world.body,
                world.bounds,
                numbers,
                self.shift,
                self.nodes,
                self.parts,
                self.pairs,
                self.status,
                counts,
                self.query.rng,
                samples,
            )
        )

    def roadmap(self) -> Roadmap:
        """Return what has grown so far."""
        m, e = self.query.counts[NODES], self.query.counts[EDGES]
        return _roadmap(
            self.query.world, self.nodes[:m].copy(), self.pairs[:e].copy(), self.status[:e].copy()
        )


def with_paths(roadmap: Roadmap, paths: Sequence[ArrayLike], neighbours: int = 5) -> Roadmap:
    """Return the roadmap and free paths of its world, each (n, k), as further states and edges.

    Experience (Phillips, Cohen, Chitta and Likhachev, 2012). Each state has neighbours, not asked
    yet.
    """
    m = len(roadmap.nodes)
    rows = [np.asarray(path, dtype=float).T for path in paths]
    nodes = np.vstack([roadmap.nodes, *rows])
    ends = m + np.cumsum([len(row) for row in rows])
    # The last state of a path is not joined to the first state of the next one.
    inner = np.setdiff1d(np.arange(m, len(nodes) - 1), ends - 1)
    steps = np.stack((inner, inner + 1), axis=1)
    near = [
        (int(j), i)
        for i in range(m, len(nodes))
        for j in np.argsort(np.sum((nodes[:i] - nodes[i]) ** 2, axis=1), kind="stable")[:neighbours]
    ]
    pairs = np.vstack((roadmap.pairs, steps, np.array(near, dtype=np.int64).reshape(-1, 2)))
    # Edges along the given paths are known to be free; edges to neighbours wait for a lazy search.
    known = (roadmap.status, np.full(len(steps), FREE), np.full(len(near), UNKNOWN))
    return _roadmap(roadmap.world, nodes, pairs, np.concatenate(known))


# --- methods --------------------------------------------------------------------------------------


def _shortest_path(
    query: Query, roadmap: Roadmap, begins: Array, ends: Array, goal: Array
) -> list[int]:
    """Return the nodes of the shortest way that is free, none where there is no way."""
    came, world = np.empty(len(roadmap.nodes), dtype=np.int64), query.world
    last = _compiled_once(_search)(
        world.kernels[1],
        world.obstacles,
        roadmap.fresh,
        world.body,
        roadmap.nodes,
        roadmap.pairs,
        roadmap.status,
        roadmap.first,
        roadmap.edges,
        begins,
        ends,
        goal,
        came,
        query.counts,
    )
    # Follow the incoming edges back. The sum of an edge's two ends less this one is the other end.
    path = [last] if last >= 0 else []
    while path and came[path[-1]] >= 0:
        path.append(int(roadmap.pairs[came[path[-1]]].sum()) - path[-1])
    return path[::-1]


def prm(query: Query) -> Plan:
    """Return PRM, which ends when start and goal are joined.

    Lazy PRM, which asks only the edges of the ways it finds; PRM*, which spends the budget.
    Options: sampler, mix, spread as of the trees; neighbours, of PRM and lazy PRM, 10 as in OMPL.
    """
    lazy, star = query.method == "lazy_prm", query.method == "prm_star"
    neighbours = 0 if star else query.option("neighbours", 10)
    numbers = _numbers(query, neighbours, lazy, not (lazy or star))
    root = query.goal_root()
    if root is None:
        return query.answer(GOAL_BLOCKED)
    growing, budget, chunk = _Growing(query, [query.start, root]), query.budget, 16
    # The straight line from start to goal is the first edge, unchecked.
    growing.pairs[0], growing.status[0], query.counts[EDGES] = (0, 1), UNKNOWN, 1
    path, spent = list[int](), False
    while not (path or spent):
        remaining = budget.samples - int(query.counts[SAMPLES])
        joined = growing.more(numbers, min(chunk, remaining))
        spent = query.counts[SAMPLES] >= budget.samples or query.seconds >= budget.seconds
        # Lazy PRM searches after each chunk, PRM once start and goal share a component, PRM* when
        # its budget is spent.
        if joined or lazy or spent:
            roadmap = growing.roadmap()
            begins, ends = np.full((2, len(roadmap.nodes)), np.inf)
            begins[0] = ends[1] = 0.0
            path = _shortest_path(query, roadmap, begins, ends, root)
            # Copy the results of the edge checks back, so that the next chunk's roadmap starts with
            # them.
            growing.status[: len(roadmap.status)] = roadmap.status
        chunk = min(2 * chunk, 256)
        query.report_progress(f"{query.counts[SAMPLES]} of {budget.samples} samples")
    graph = {"nodes": roadmap.nodes.T, "edges": roadmap.pairs[roadmap.status == FREE].T}
    if path:
        return query.answer(SOLVED, roadmap.nodes[path], **graph)
    all_drawn = query.counts[SAMPLES] >= budget.samples
    return query.answer(NO_SAMPLES if all_drawn else NO_TIME, **graph)


def _outside(roadmap: Roadmap, tree: Array, parents: Ints, hooks: Ints) -> tuple[Array, Any]:
    """Return the cost from an end to each roadmap node, (m,), and through which tree node."""
    costs, through = np.full(len(roadmap.nodes), np.inf), {}
    # Several tree nodes may hang on the same node of the roadmap: store the cheapest of them.
    for i, node in hooks.tolist():
        chain = np.vstack((roadmap.nodes[node], tree[_chain(parents, i)]))
        cost = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
        if cost < costs[node]:
            costs[node], through[node] = cost, i
    return costs, through


def on_roadmap(query: Query) -> Plan:
    """Return an answer from a `Roadmap` made before, the option `roadmap`.

    Obstacles of its world may have come, gone or moved; see `adapted`.

    Option attach: "list" joins each end to its nearest nodes by straight edges, and leaves it to
    RRT-Connect where that fails; "trees" grows a tree from each end onto the whole roadmap, a share
    `near` (0.3) of its samples around the end (a standard deviation of `spread`), its edges at most
    `step` long. Edges of the roadmap are asked only where the answer needs them, and remembered.
    """
    roadmap, world, counts = query.option("roadmap"), query.world, query.counts
    if not isinstance(roadmap, Roadmap):
        raise invalid("roadmap", roadmap, "a Roadmap")
    attach = one_of("attach", query.option("attach", "trees"), ("trees", "list"))
    near = number(query, "near", 0.3, 0.0, 1.0)
    step = number(query, "step", 0.2 * world.extent, POSITIVE)
    numbers = _numbers(query, 0, False, False)
    numbers[STEP], numbers[NEAR] = step, near
    roadmap = adapted(roadmap, world)
    root = query.goal_root()
    if root is None:
        return query.answer(GOAL_BLOCKED)
    size, n, budget = min(query.budget.samples + 2, 20_000), world.dim, query.budget
    trees, parents = np.empty((2, size, n)), np.full((2, size), -1)
    hooks, count = np.empty((2, 64, 2), dtype=np.int64), size + len(roadmap.nodes)
    room, gaps = np.empty(count, dtype=np.int64), np.empty(count)
    trees[0, 0], trees[1, 0], counts[TREES : TREES + 2] = query.start, root, 1
    edge, tables = world.kernels[1], (world.obstacles, world.body)
    # "trees" begins with one edge from each end to the roadmap and grows further ones on demand.
    for side in range(2):
        largest = LIST if attach == "list" else 1
        _compiled_once(_list)(edge, *tables, roadmap.nodes, trees, hooks, counts, side, largest)
    code, side = 1, 0
    while True:
        # Both ends hang on the roadmap: search it, with the edges to the trees as outer edges.
        if code == 1 and counts[HOOKS : HOOKS + 2].all():
            outer = [
                _outside(roadmap, trees[k], parents[k], hooks[k, : counts[HOOKS + k]])
                for k in (0, 1)
            ]
            route = _shortest_path(query, roadmap, outer[0][0], outer[1][0], root)
            if route:
                chains = [_chain(parents[k], outer[k][1][route[-k]]) for k in (0, 1)]
                path = (trees[0, chains[0][::-1]], roadmap.nodes[route], trees[1, chains[1]])
                return query.answer(SOLVED, np.concatenate(path))
        if attach == "list":
            # The list found no way: a fresh search with RRT-Connect, as the option promises.
            query.method, query.options = "rrt_connect", {"step": step}
            counts[:] = 0
            return METHODS["rrt_connect"](query)
        # The end without a hook, else the one with the smaller tree.
        side = int(np.lexsort((counts[TREES : TREES + 2], counts[HOOKS : HOOKS + 2] > 0))[0])
        remaining = budget.samples - int(counts[SAMPLES])
        full = counts[TREES : TREES + 2].max() >= size
        if remaining <= 0 or full or query.seconds >= budget.seconds:
            return query.answer(NO_TIME if remaining > 0 and not full else NO_SAMPLES)
        code = _compiled_once(_attach)(
            edge,
            *tables,
            world.bounds,
            numbers,
            roadmap.nodes,
            roadmap.links,
            trees,
            parents,
            hooks,
            counts,
            side,
            query.rng,
            min(8, remaining),
            room,
            gaps,
        )
        # Both trees have met before the roadmap could join them.
        if code == 2:
            here = _chain(parents[side], int(counts[TREES + side]) - 1)
            other = _chain(parents[1 - side], int(hooks[side, 0, 1]))
            halves = [trees[side, here[::-1]], trees[1 - side, other]]
            met = np.concatenate(halves if side == 0 else [x[::-1] for x in halves[::-1]])
            return query.answer(SOLVED, met)
        query.report_progress(f"{counts[SAMPLES]} of {budget.samples} samples")


@functools.cache
def warm() -> None:
    """Compile, or load from the cache, the loops of this file."""
    for function in (_grow, _resolve, _search, _attach, _list, _enter):
        _compiled_once(function)
    LOOPS["rrt_connect"]()  # which answers where a list of neighbours does not


METHODS.update(prm=prm, prm_star=prm, lazy_prm=prm, roadmap=on_roadmap)
LOOPS.update(dict.fromkeys(("prm", "prm_star", "lazy_prm", "roadmap"), warm))
