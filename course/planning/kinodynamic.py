"""Kinodynamic planning: an RRT whose edges come from simulated controls, and two bounds to test it.

The robot is a **double integrator** in the plane: a point with a velocity, whose control is its
acceleration, at most `acceleration` along each axis. It can't turn a corner at speed, so a straight
edge between two states means nothing. `kinodynamic_rrt` applies random constant accelerations to
the node nearest to a sampled state and adds what ends nearest to it (LaValle and Kuffner, 2001).

Two closed forms judge the result:

- No trajectory between its two ends is faster than `minimum_time`: each axis alone needs at least
  full acceleration one way and then the other (bang-bang).
- Between two simulated points dt apart the motion leaves the chord by at most |a| dt^2 / 8, and the
  distances of a point of the chord from both ends sum to its length L. So where the clearances at
  both ends have a mean above L / 2 + |a| dt^2 / 8, nothing between them touches (`step_margin`).

Source: LaValle and Kuffner (2001), Randomized kinodynamic planning.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, compiled
from course.planning.problem import GOAL_BLOCKED, NO_SAMPLES, SOLVED, START_BLOCKED

Array = NDArray[np.float64]
METRICS = ("minimum time", "Euclidean")
TRIES = 8  # controls tried for each sample
STEPS = 10  # of a control, at most
BIAS = 0.1  # share of the samples that are the goal


# --- the double integrator ------------------------------------------------------------------------


def propagate(state: ArrayLike, control: ArrayLike, t: ArrayLike) -> Array:
    """Return the state after a constant acceleration, in closed form.

    Args:
        state: position and velocity, shape (4,) [m, m/s].
        control: acceleration, shape (2,) [m/s^2].
        t: duration, a number or (N,) [s].

    Returns:
        The state, shape (4,) or (4, N).
    """
    s, a, t = np.asarray(state, float), np.asarray(control, float), np.asarray(t, float)
    if t.ndim:
        s, a = s[:, None], a[:, None]
    return np.concatenate((s[:2] + s[2:] * t + 0.5 * a * t**2, s[2:] + a * t))


@register_jitable
def _axis_time(distance, v, w, limit):
    """Return the least time for one axis to go a distance from speed v to speed w."""
    best = np.inf
    for sign in (1.0, -1.0):
        # First full acceleration with this sign, then against it; mirrored, the sign is plus.
        d, a, b = sign * distance, sign * v, sign * w
        # The peak p: (p^2 - a^2) / 2 limit there and (p^2 - b^2) / 2 limit back make the distance.
        square = limit * d + 0.5 * (a * a + b * b)
        if square < 0.0:
            continue
        root = math.sqrt(square)
        for peak in (-root, root):
            # Rounding may put the peak of a motion with one phase just below an end.
            if peak >= max(a, b) - 1e-12 * (1.0 + abs(a) + abs(b)):
                best = min(best, max(2.0 * peak - a - b, abs(a - b)) / limit)
    return best


@register_jitable
def _minimum_time(s, g, limit):
    """Return the larger of both axes' least times."""
    x = _axis_time(g[0] - s[0], s[2], g[2], limit)
    return max(x, _axis_time(g[1] - s[1], s[3], g[3], limit))


def minimum_time(start: ArrayLike, goal: ArrayLike, acceleration: float = 1.0) -> float:
    """Return a lower bound of the time between two states, obstacles or not [s].

    It is the time of the slower axis, which reaches its end by full acceleration one way and then
    the other. The faster axis can't do it in less, though it may need longer to arrive together.

    Args:
        start: position and velocity, shape (4,) [m, m/s].
        goal: likewise.
        acceleration: limit of each axis [m/s^2].
    """
    ends = (np.ascontiguousarray(vector(*p, (4,))) for p in (("start", start), ("goal", goal)))
    return float(_minimum_time(*ends, positive("acceleration", acceleration)))


# --- an edge --------------------------------------------------------------------------------------


@register_jitable
def _clearance(discs, x, y):
    least = np.inf
    for i in range(discs.shape[0]):
        gap = math.sqrt((x - discs[i, 0]) ** 2 + (y - discs[i, 1]) ** 2) - discs[i, 2]
        least = min(least, gap)
    return least


@register_jitable
def _margin(p, q, ax, ay, dt):
    """Return half of what both clearances of a step must sum to."""
    chord = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2)
    return 0.5 * chord + 0.125 * dt * dt * math.sqrt(ax * ax + ay * ay)


def step_margin(state: ArrayLike, control: ArrayLike, dt: float) -> float:
    """Return the mean clearance at both ends of a step that proves it free [m].

    Half the chord, plus |a| dt^2 / 8 by which the motion leaves the chord at most.

    Args:
        state: at the beginning, shape (4,) [m, m/s].
        control: constant acceleration, shape (2,) [m/s^2].
        dt: duration of the step [s].
    """
    begin, a = vector("state", state, (4,)), vector("control", control, (2,))
    return float(_margin(begin, propagate(begin, a, dt), a[0], a[1], positive("dt", dt)))


@register_jitable
def _step(s, ax, ay, t, out):
    out[0] = s[0] + s[2] * t + 0.5 * ax * t * t
    out[1] = s[1] + s[3] * t + 0.5 * ay * t * t
    out[2], out[3] = s[2] + ax * t, s[3] + ay * t


@register_jitable
def _simulate(discs, bounds, s, ax, ay, dt, steps, proved, here, out):
    """Apply a control while it is free; write the last free state, return its number of steps."""
    done, out[:] = 0, s
    # Between two points inside the room the motion leaves their chord by at most this.
    inside = 0.125 * dt * dt * math.sqrt(ax * ax + ay * ay) if proved else 0.0
    before = _clearance(discs, s[0], s[1])
    for k in range(1, steps + 1):
        _step(s, ax, ay, k * dt, here)
        for i in range(4):
            spare = inside if i < 2 else 0.0
            if here[i] < bounds[0, i] + spare or here[i] > bounds[1, i] - spare:
                return done
        gap = _clearance(discs, here[0], here[1])
        if gap <= 0.0:
            return done
        if proved and 0.5 * (gap + before) <= _margin(out, here, ax, ay, dt):
            return done
        done, out[:], before = k, here, gap
    return done


def _edge(discs, bounds, s, control, dt, steps, proved):
    out = np.empty(4)
    return _simulate(discs, bounds, s, control[0], control[1], dt, steps, proved, np.empty(4), out)


# --- the planner ----------------------------------------------------------------------------------


@register_jitable
def _distance(s, g, limit, timed):
    if timed:
        return _minimum_time(s, g, limit)
    square = 0.0
    for i in range(4):
        square += (s[i] - g[i]) ** 2
    return math.sqrt(square)


def _grow(
    discs,
    bounds,
    goal,
    reach,
    limit,
    dt,
    proved,
    timed,
    targets,
    controls,
    steps,
    nodes,
    parents,
    applied,
    lasted,
):
    """Grow the tree; return how many nodes it has, the one at the goal or -1, and the samples."""
    size, here, out, best = 1, np.empty(4), np.empty(4), np.empty(4)
    for sample in range(targets.shape[0]):
        # The node from which the sampled state is nearest.
        near, least = 0, np.inf
        for i in range(size):
            distance = _distance(nodes[i], targets[sample], limit, timed)
            if distance < least:
                near, least = i, distance
        # Of some random controls the one that ends nearest to the sampled state.
        chosen, least, duration = -1, np.inf, 0
        for c in range(controls.shape[1]):
            ax, ay = controls[sample, c, 0], controls[sample, c, 1]
            longest = steps[sample, c]
            done = _simulate(discs, bounds, nodes[near], ax, ay, dt, longest, proved, here, out)
            if done > 0:
                distance = _distance(out, targets[sample], limit, timed)
                if distance < least:
                    chosen, least, duration = c, distance, done
                    best[:] = out
        if chosen < 0:
            continue
        nodes[size], parents[size], lasted[size] = best, near, duration
        applied[size] = controls[sample, chosen]
        size += 1
        if _distance(best, goal, limit, False) <= reach:
            return size, size - 1, sample + 1
    return size, -1, targets.shape[0]


@functools.cache
def _kernels() -> tuple[Any, Any]:
    """Return the compiled loop and the check of one edge."""
    real, flag, integer = numba.float64, types.boolean, numba.int64
    three = types.Array(real, 3, "C")
    grow = compiled(
        _grow,
        types.UniTuple(integer, 3)(
            *(MATRIX, MATRIX, VECTOR, real, real, real, flag, flag),
            *(MATRIX, three, types.Array(integer, 2, "C")),
            *(MATRIX, types.Array(integer, 1, "C"), MATRIX, types.Array(integer, 1, "C")),
        ),
    )
    edge = compiled(_edge, integer(MATRIX, MATRIX, VECTOR, VECTOR, real, integer, flag))
    return grow, edge


def free_steps(
    discs: ArrayLike,
    bounds: ArrayLike,
    state: ArrayLike,
    control: ArrayLike,
    dt: float,
    steps: int,
    proved: bool = True,
) -> int:
    """Return how many steps of a constant control are free, counted from the beginning.

    Args:
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        bounds: rows low and high of positions and speeds, shape (2, 4) [m, m/s].
        state: at the beginning, shape (4,).
        control: acceleration, shape (2,) [m/s^2].
        dt: between simulated points [s].
        steps: how many to try.
        proved: whether the margin of `step_margin` must hold, which proves what lies between the
            points; otherwise only the points are checked.
    """
    return int(
        _kernels()[1](
            np.ascontiguousarray(vector("discs", discs, (None, 3))),
            np.ascontiguousarray(vector("bounds", bounds, (2, 4))),
            np.ascontiguousarray(vector("state", state, (4,))),
            np.ascontiguousarray(vector("control", control, (2,))),
            positive("dt", dt),
            count("steps", steps, 1),
            bool(proved),
        )
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """What the planner answered.

    Attributes:
        status: "solved", "out of samples", or what is wrong with start or goal.
        states: where a control begins and ends, shape (4, k); (4, 0) unless solved.
        controls: acceleration between them, shape (2, k - 1) [m/s^2].
        durations: of each, shape (k - 1,) [s].
        samples: states sampled.
        nodes: of the tree, shape (4, m).
        parents: of each node, shape (m,), -1 for the root.
    """

    status: str
    states: Array
    controls: Array
    durations: Array
    samples: int
    nodes: Array
    parents: NDArray[np.int64]

    @property
    def solved(self) -> bool:
        """True if there is a trajectory."""
        return self.status == SOLVED

    @property
    def seconds(self) -> float:
        """Duration of the trajectory [s]."""
        return float(self.durations.sum())

    def points(self, dt: float) -> Array:
        """Return states along the trajectory at most dt apart, both ends included, (4, N)."""
        pieces = []
        for s, a, t in zip(self.states.T, self.controls.T, self.durations, strict=False):
            pieces.append(propagate(s, a, np.linspace(0.0, t, math.ceil(t / dt) + 1)))
        return np.concatenate(pieces, axis=1)


def kinodynamic_rrt(
    discs: ArrayLike,
    bounds: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    reach: float = 0.5,
    acceleration: float = 1.0,
    dt: float = 0.1,
    proved: bool = True,
    metric: str = "minimum time",
    tries: int = TRIES,
    samples: int = 5000,
    rng: np.random.Generator | int = 0,
) -> Motion:
    """Plan for a double integrator among discs (RRT of LaValle and Kuffner, 2001).

    Args:
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        bounds: rows low and high of positions and speeds, shape (2, 4) [m, m/s].
        start: position and velocity, shape (4,) [m, m/s].
        goal: likewise.
        reach: Euclidean distance of states at which the goal counts as reached.
        acceleration: limit of each axis [m/s^2].
        dt: between simulated points [s]; a control lasts up to `STEPS` of them.
        proved: whether edges carry the margin of `step_margin`, which proves them free.
        metric: which node is nearest: "minimum time" from it to the sample, or "Euclidean".
        tries: random controls for each sample, of which the one that ends nearest to it is taken.
        samples: at most.
        rng: random numbers, or a seed.

    Returns:
        The motion.

    Raises:
        ValueError: for wrong shapes, numbers out of range, or an unknown metric.
    """
    obstacles = np.ascontiguousarray(vector("discs", discs, (None, 3)))
    box = np.ascontiguousarray(vector("bounds", bounds, (2, 4)))
    begin, end = (
        np.ascontiguousarray(vector(*pair, (4,))) for pair in (("start", start), ("goal", goal))
    )
    near, limit = positive("reach", reach), positive("acceleration", acceleration)
    tick, most = positive("dt", dt), count("samples", samples, 1)
    choices = count("tries", tries, 1)
    timed = one_of("metric", metric, METRICS) == METRICS[0]
    generator = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)
    nodes, applied = np.empty((most + 1, 4)), np.zeros((most + 1, 2))
    parents, lasted = np.full(most + 1, -1), np.zeros(most + 1, dtype=np.int64)
    nodes[0] = begin
    size, last, drawn, status = 1, -1, 0, NO_SAMPLES
    for q, blocked in ((begin, START_BLOCKED), (end, GOAL_BLOCKED)):
        outside = (q < box[0]).any() or (q > box[1]).any()
        if outside or _clearance(obstacles, q[0], q[1]) <= 0.0:
            status = blocked
            break
    else:
        # All that is random, before the loop: a sampled state, controls and how long each lasts.
        targets = generator.uniform(box[0], box[1], (most, 4))
        targets[generator.random(most) < BIAS] = end
        controls = generator.uniform(-limit, limit, (most, choices, 2))
        steps = generator.integers(1, STEPS + 1, (most, choices))
        size, last, drawn = _kernels()[0](
            *(
                obstacles,
                box,
                end,
                near,
                limit,
                tick,
                bool(proved),
                timed,
                targets,
                controls,
                steps,
            ),
            *(nodes, parents, applied, lasted),
        )
    branch = []
    if last >= 0:
        status, node = SOLVED, last
        while node >= 0:
            branch.append(node)
            node = int(parents[node])
    branch = branch[::-1]
    return Motion(
        status,
        nodes[branch].T.copy(),
        applied[branch[1:]].T.copy(),
        np.asarray(tick * lasted[branch[1:]], dtype=float),
        int(drawn),
        nodes[:size].T.copy(),
        parents[:size].copy(),
    )


def warm() -> None:
    """Compile, or load from the cache, the planner's loop and the check of an edge."""
    _kernels()
