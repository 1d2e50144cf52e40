"""Nearest neighbours in a growing tree: by exhaustive search, or with a k-d tree.

Nodes are inserted into the k-d tree (Bentley, Comm. ACM 18, 1975) one at a time, without
rebalancing: a planner's nodes come from random targets, which keeps the tree shallow. `links` holds
one row per node: its two children and the axis along which it splits. Up to `brute_below(n)` nodes
no k-d tree is built. It would still visit one node in twenty to one in five there (a test counts
them), and visiting a node in memory order costs several times less than following a link.

Everything here is for use inside compiled loops.
"""

import numpy as np
from numba.extending import register_jitable

LEFT, RIGHT, AXIS, CHILD, SIBLING, WIDTH = 0, 1, 2, 3, 4, 5


@register_jitable
def brute_below(n):
    """Return the number of nodes below which looking at all is faster, in n dimensions."""
    return 40 + 10 * n**3


@register_jitable
def squared(a, b):
    """Return squared distance of two states."""
    total = 0.0
    for i in range(a.size):
        total += (a[i] - b[i]) ** 2
    return total


@register_jitable
def to_node(nodes, i, q):
    """Return the squared distance of node i from q.

    It indexes the array directly, as creating a view of the row would cost more than the sum.
    """
    total = 0.0
    for k in range(q.size):
        total += (nodes[i, k] - q[k]) ** 2
    return total


@register_jitable
def _enter(nodes, links, i):
    """Insert node i into the k-d tree of the nodes before it; node 0 is the root."""
    links[i, LEFT] = links[i, RIGHT] = -1
    links[i, AXIS] = 0
    at = 0
    # Descend to the first empty child. The splitting axes take turns with depth (Bentley, 1975).
    while i > 0:
        axis = links[at, AXIS]
        half = LEFT if nodes[i, axis] < nodes[at, axis] else RIGHT
        if links[at, half] < 0:
            links[at, half] = i
            links[i, AXIS] = (axis + 1) % nodes.shape[1]
            break
        at = links[at, half]


@register_jitable
def _divisor(a, b):
    """Return the greatest common divisor (Euclid)."""
    while b > 0:
        a, b = b, a % b
    return a


@register_jitable
def entered(nodes, links, count, done):
    """Insert the new nodes into the k-d tree, unless exhaustive search is still faster.

    Args:
        nodes: states, one a row; the first `count` rows are in use.
        links: rows of the k-d tree, written here.
        count: number of nodes.
        done: how many of them are in the k-d tree already.

    Returns:
        How many are in it now; 0 while exhaustive search is faster.
    """
    if count <= brute_below(nodes.shape[1]):
        return 0
    # Nodes of a chain lie in order on a line: hung in that order, they would make the tree as deep
    # as the chain is long. Steps of the golden ratio take them in an order that keeps it shallow.
    new = count - done
    stride = max(int(0.6180339887498949 * new), 1)
    # A stride without a common divisor with the count visits each new node exactly once.
    while _divisor(stride, new) > 1:
        stride += 1
    at = 0
    for _ in range(new):
        _enter(nodes, links, done + at)
        at = (at + stride) % new
    return count


@register_jitable
def nearest(nodes, links, count, done, q, stack, gaps):
    """Return the index of the node nearest to q, the lowest one of several.

    Args:
        nodes: see `entered`.
        links: see `entered`.
        count: see `entered`.
        done: see `entered`; below `count` the search is exhaustive.
        q: a state.
        stack: room for as many integers as there are nodes.
        gaps: room for as many floats: squared distances of q from the postponed half-spaces.
    """
    # Before there is a k-d tree, exhaustive search.
    near, best = 0, np.inf
    if done < count:
        for i in range(count):
            square = to_node(nodes, i, q)
            if square < best:
                near, best = i, square
        return near
    stack[0], gaps[0], top = 0, 0.0, 1
    while top > 0:
        top -= 1
        at = stack[top] if gaps[top] <= best else -1  # prune: that half-space is too far away
        while at >= 0:
            square = to_node(nodes, at, q)
            # Ties go to the lowest index, so the answer does not depend on the shape of the tree.
            if square < best or (square == best and at < near):
                near, best = at, square
            across = q[links[at, AXIS]] - nodes[at, links[at, AXIS]]
            # Descend on q's side; the other half-space waits on the stack.
            here, other = (LEFT, RIGHT) if across < 0.0 else (RIGHT, LEFT)
            if links[at, other] >= 0 and across * across <= best:
                stack[top], gaps[top] = links[at, other], across * across
                top += 1
            at = links[at, here]
    return near


@register_jitable
def within(nodes, links, count, done, q, radius, stack, result):
    """Fill `result` with all nodes within a radius of q, in no particular order.

    Args:
        nodes: see `entered`.
        links: see `entered`.
        count: see `entered`.
        done: see `nearest`.
        q: a state.
        radius: the largest distance.
        stack: room for as many integers as there are nodes.
        result: room for as many integers as there are nodes; filled.

    Returns:
        How many there are.
    """
    hits, limit = 0, radius * radius
    # Before there is a k-d tree, exhaustive search.
    if done < count:
        for i in range(count):
            if to_node(nodes, i, q) <= limit:
                result[hits] = i
                hits += 1
        return hits
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        at = stack[top]
        if to_node(nodes, at, q) <= limit:
            result[hits] = at
            hits += 1
        # Visit both half-spaces, except one that the ball does not reach.
        across = q[links[at, AXIS]] - nodes[at, links[at, AXIS]]
        for half in (LEFT, RIGHT):
            beyond = across > 0.0 if half == LEFT else across < 0.0
            if links[at, half] >= 0 and not (beyond and abs(across) > radius):
                stack[top] = links[at, half]
                top += 1
    return hits
