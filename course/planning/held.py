"""Collisions of an arm of capsules with itself, and an object that its hand holds.

Both are rows of a world's `body`: a held object is capsules on the tool's frame, and each pair of
capsules that must not meet is a row of its own. The compiled functions of `capsules` read them, so
every planner, shortcut and stored edge that checks the world checks them too.

Which pairs are checked is settled once, by sampling postures, as MoveIt's setup assistant does.
Capsules on one frame never move against each other. A pair that touches in every sample overlaps
at a joint that both share. A pair that is never closer than `MARGIN` is taken to be out of reach:
samples make that likely and prove nothing, so the proof of an edge covers the other pairs only.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of
from course.compiled import MATRIX, compiled
from course.contact.shapes import Shape
from course.kinematics.chain import PARENT, WIDTH
from course.planning.capsules import (
    COMMON,
    FRAME,
    ONE,
    OTHER,
    PAIR,
    REACH,
    _pair_gap,
    _postured,
    capsule_rows,
)
from course.planning.worlds import World
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import poses

Array = NDArray[np.float64]

MARGIN = 0.02  # m; a pair that no sample brings closer than this is not checked
SAMPLES = 10_000
GAPS = MATRIX(MATRIX, MATRIX, types.int64)

# A cup of the size that the chapter's hand can hold, in the middle between its fingers, upright
# where the hand points ahead with its wide side level: half sizes [m], pose in the tool's frame.
CUP = (0.04, 0.04, 0.06)
GRASP = (0.0, 0.0, 0.13, 0.5**0.5, 0.0, 0.5**0.5, 0.0)


def with_self_collision(world: World, samples: int = SAMPLES, seed: int = 0) -> World:
    """Return the world with the arm's own pairs of capsules checked as well.

    Args:
        world: of `capsule_arm`; what its hand holds is checked too.
        samples: postures that settle which pairs are checked, see the top.
        seed: of the samples.

    Raises:
        ValueError: for another kind of world.
    """
    body, last = _capsules(world)
    first = world.dim + 1
    candidates = itertools.combinations(range(first, last + 1), 2)
    return replace(world, body=_with_pairs(world, body, list(candidates), samples, seed))


def holding(
    world: World,
    shape: Shape,
    pose: ArrayLike = GRASP,
    *,
    columns: int = 2,
    samples: int = SAMPLES,
    seed: int = 0,
) -> World:
    """Return the world with an object in the hand, checked against obstacles and the other links.

    Contact between the object and the capsules on the tool's frame is allowed: they hold it.

    Args:
        world: of `capsule_arm`, with or without self-collision.
        shape: of chapter 2: a sphere, a capsule, or a box, which `covering` replaces by capsules.
        pose: of the shape in the tool's frame, (7,).
        columns: see `covering`.
        samples: as for `with_self_collision`.
        seed: of the samples.

    Raises:
        ValueError: for another kind of world or another shape.
    """
    body, last = _capsules(world)
    n = world.dim
    pose = poses("pose", pose, 3)[:, 0]
    turn = to_matrix(pose[3:])
    capsules = [
        (n, pose[:3] + turn @ a, pose[:3] + turn @ b, radius)
        for a, b, radius in covering(shape, columns)
    ]
    rows = capsule_rows(body[: n + 1], world.bounds, capsules)
    links = [i for i in range(n + 1, last + 1) if body[i, FRAME] != n]
    new = range(last + 1, last + 1 + len(rows))
    body = np.vstack((body, rows))
    extended = _with_pairs(world, body, list(itertools.product(links, new)), samples, seed)
    # The pairs that the world already has name rows before the new ones, and stay.
    before = world.body[last + 1 :]
    return replace(world, body=np.vstack((extended[: len(body)], before, extended[len(body) :])))


def covering(shape: Shape, columns: int = 2) -> list[tuple[Array, Array, float]]:
    """Return capsules that together contain a shape: of each both ends (3,) and the radius [m].

    A box is cut into `columns` x `columns` columns along its longest side, with one capsule around
    each. Its ends are pulled in by the column's smaller half width w. Where the column is square,
    the capsules reach (sqrt(3) - 1) w beyond the box at its faces and ends.

    Raises:
        ValueError: for another shape than a sphere, a capsule or a box in space.
    """
    one_of("shape", shape.name, ("sphere", "capsule", "box"))
    if shape.dim != 3:
        raise invalid("shape.dim", shape.dim, "3")
    m = count("columns", columns, 1)
    half = np.asarray(shape.half, dtype=float)
    if shape.name != "box":
        return [(-half, half, float(shape.radius))]
    across, sideways, along = np.argsort(half, kind="stable")
    cell = half / m
    inset = float(min(cell[across], half[along]))
    radius = float(np.sqrt(cell[across] ** 2 + cell[sideways] ** 2 + inset**2)) + shape.radius
    result = []
    for i, j in itertools.product(range(m), repeat=2):
        middle, end = np.zeros(3), np.zeros(3)
        middle[across] = (2 * i + 1 - m) * cell[across]
        middle[sideways] = (2 * j + 1 - m) * cell[sideways]
        end[along] = half[along] - inset
        result.append((middle - end, middle + end, radius))
    return result


def pairs_of(world: World) -> NDArray[np.int64]:
    """Return the pairs that are checked, as numbers of capsules in their order, shape (m, 2)."""
    _, last = _capsules(world)
    return np.asarray(world.body[last + 1 :, [ONE, OTHER]], dtype=np.int64) - (world.dim + 1)


def _capsules(world: World) -> tuple[Array, int]:
    """Return the rows of the chain and the capsules, and the number of the last of them."""
    one_of("world.kind", world.kind, ("capsule arm",))
    last = int(np.flatnonzero(world.body[:, FRAME] != PAIR)[-1])
    return world.body[: last + 1], last


def _with_pairs(
    world: World, body: Array, candidates: list[tuple[int, int]], samples: int, seed: int
) -> Array:
    """Return the body with a row for each candidate that can meet, by the samples."""
    frames, n = body[:, FRAME], world.dim
    rows = np.array(
        [_pair(body, i, j, n) for i, j in candidates if frames[i] != frames[j]]
    ).reshape(-1, WIDTH)
    everything = np.ascontiguousarray(np.vstack((body, rows)))
    number = count("samples", samples, 1)
    states = np.random.default_rng(seed).uniform(world.bounds[0], world.bounds[1], (number, n))
    gaps = compiled(_gaps, GAPS)(everything, states, len(body))
    meeting = (gaps.min(axis=0) < MARGIN) & (gaps.max(axis=0) > 0.0)
    return np.ascontiguousarray(np.vstack((body, rows[meeting])))


def _pair(body: Array, i: int, j: int, n: int) -> Array:
    """Return the row of a pair."""
    row = np.zeros(WIDTH)
    one, other = (_joints(body, int(body[k, FRAME]), n) for k in (i, j))
    row[FRAME], row[ONE], row[OTHER] = PAIR, i, j
    row[COMMON] = max(set(one) & set(other), default=-1)
    for k in set(one) ^ set(other):
        row[REACH + k] = body[i if k in one else j, REACH + k]
    return row


def _joints(body: Array, frame: int, n: int) -> list[int]:
    """Return the joints that move a frame, the last one first."""
    result, k = [], min(frame, n - 1)
    while k >= 0:
        result.append(k)
        k = int(body[k, PARENT])
    return result


def _gaps(body, states, first):
    pose = np.empty((states.shape[1] + 1, 7))
    result = np.empty((states.shape[0], body.shape[0] - first))
    for s in range(states.shape[0]):
        _postured(body, states[s], pose)
        for r in range(first, body.shape[0]):
            result[s, r - first] = _pair_gap(body, r, pose)
    return result


def warm() -> None:
    """Compile, or load from the cache, the gaps of pairs."""
    compiled(_gaps, GAPS)
