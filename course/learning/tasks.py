"""Tasks for imitation, each the smallest that shows one point, and what is known of it exactly.

All are driven by `roll`: states are what a policy sees, one row for each run, as in the vector
environments and in PyTorch. An expert is a method of its task.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.compiled import loop

Array = NDArray[np.float64]
Act = Callable[[Array, np.random.Generator], Array]


class Task(Protocol):
    """What `roll` needs."""

    def step(self, states: Array, actions: Array, rng: np.random.Generator) -> Array:
        """Return states (N, d) and actions (N, a) -> states (N, d) one step later."""


class Runs(NamedTuple):
    """Runs of one task, all of T steps: demonstrations, or what a policy did.

    Attributes:
        states: from the start to the end, shape (N, T + 1, d).
        actions: that were taken, or labels of the expert in their place, shape (N, T, a).
    """

    states: Array
    actions: Array


def runs(states: Sequence[ArrayLike], actions: Sequence[ArrayLike]) -> Runs:
    """Return demonstrations out of two lists, a run each.

    Raises:
        ValueError: for fewer than two (one shows no spread), unequal length, or no finite number.
    """
    if len(states) < 2 or len(actions) != len(states):
        sizes = (len(states), len(actions))
        raise invalid("numbers of states and actions", sizes, "two runs or more, as many of both")
    for name, each in (("states", states), ("actions", actions)):
        for k, run in enumerate(each):
            vector(f"{name}[{k}]", run, np.shape(each[0]))
    table = Runs(np.array(states, dtype=float), np.array(actions, dtype=float))
    if table.states.shape[1] != table.actions.shape[1] + 1 or not table.actions.size:
        raise invalid("steps", table.actions.shape[1], "one fewer than the states, and at least 1")
    return table


def windows(shown: Runs, length: int) -> tuple[Array, Array]:
    """Return what is seen at each step, and the chunk of actions that follows.

    Where a run ends within a chunk, it goes on with zeros: an action is a displacement, so it
    stands still. A chunk is at most as long as a demonstration.

    Returns:
        States (N T, d) and chunks (N T, length, a), those of the first run first.
    """
    number, steps, size = shown.actions.shape
    if number < 2:
        raise invalid("demonstrations", number, "two or more: one shows no spread")
    count("length", length, 1, steps)
    filled = np.concatenate((shown.actions, np.zeros((number, length - 1, size))), axis=1)
    # Overlapping windows as a view: nothing is copied here.
    cut = np.lib.stride_tricks.sliding_window_view(filled, length, axis=1)  # (N, T, a, length)
    chunks = np.swapaxes(cut, 2, 3).reshape(number * steps, length, size)
    return shown.states[:, :-1].reshape(number * steps, -1), chunks


def roll(
    task: Task,
    act: Act,
    starts: ArrayLike,
    steps: int,
    rng: np.random.Generator,
    *,
    injected: float = 0.0,
) -> Runs:
    """Let a policy drive; what is recorded are its own actions, without what was injected.

    Args:
        task: the dynamics.
        act: states (N, d), generator -> actions (N, a). What remembers (an executor of chunks)
            has `reset()`, called before the first step.
        starts: states, (N, d).
        injected: deviation of noise on each action (DART; Laskey et al., CoRL 2017).
        steps: of a run.
        rng: source of the noise.

    Raises:
        ValueError: for an action that is not finite, with its step.
    """
    state = vector("starts", starts, (None, None))
    count("steps", steps, 1)
    getattr(act, "reset", lambda: None)()
    states, actions = [state], []
    for k in range(steps):
        action = vector(f"action at step {k}", act(state, rng), (len(state), None))
        # DART (Laskey et al., 2017): the motion is disturbed, the recorded action is not.
        noise = injected * rng.standard_normal(action.shape) if injected else 0.0
        state = task.step(state, action + noise, rng)
        states.append(state)
        actions.append(action)
    return Runs(np.stack(states, axis=1), np.stack(actions, axis=1))


# --- two ways round an obstacle -------------------------------------------------------------------


@dataclass(frozen=True)
class TwoWays:
    """A point goes from (0, 0) to (1, 0), left or right of a disc; an action is a displacement.

    Attributes:
        noise: deviation of what disturbs each step [m].
        steps: of a way without pauses.
        centre, radius: of the disc [m].
        width, scatter, jitter: how far aside demonstrations pass, how much that differs between
            them, and how much each point of a way is off [m].
        reach: a run has to end so near to (1, 0) [m].
    """

    noise: float = 0.0
    steps: int = 16
    centre: float = 0.5
    radius: float = 0.2
    width: float = 0.35
    scatter: float = 0.03
    jitter: float = 0.005
    reach: float = 0.15

    def starts(self, number: int, rng: np.random.Generator) -> Array:
        """Return places about (0, 0), shape (number, 2) [m]."""
        return 0.02 * rng.standard_normal((count("number", number, 1), 2))

    def step(self, states: Array, actions: Array, rng: np.random.Generator) -> Array:
        """Return the places a step later [m]."""
        disturbed = self.noise * rng.standard_normal(states.shape) if self.noise else 0.0
        return states + actions + disturbed

    def demonstrate(
        self,
        number: int,
        seed: int,
        *,
        left: float = 0.5,
        pause: int = 0,
        injected: float = 0.0,
    ) -> Runs:
        """Return demonstrations that pass left or right, with a pause after a quarter of the path.

        Args:
            number: how many demonstrations.
            seed: of the random numbers.
            left: chance that one passes left, at positive y.
            pause: steps without motion, after a quarter of the others.
            injected: deviation of noise that pushes the point off its way at each step [m]; the
                label is what brings it back.
        """
        rng = np.random.default_rng((count("seed", seed), 91))
        start = self.starts(number, rng)
        side = np.where(rng.random(number) < finite("left", left, 0.0, 1.0), 1.0, -1.0)
        width = side * (self.width + self.scatter * rng.standard_normal(number))
        part = np.linspace(0.0, 1.0, self.steps + 1)
        # A straight line to (1, 0) with half a sine wave to the side.
        distance = start[:, None] * (1.0 - part)[:, None]
        distance[..., 0] += part
        distance[..., 1] += width[:, None] * np.sin(np.pi * part)
        distance[:, 1:] += self.jitter * rng.standard_normal(distance[:, 1:].shape)
        distance = np.insert(distance, [self.steps // 4] * count("pause", pause), 0.0, axis=1)
        if pause:
            # A pause repeats the position at which it begins.
            first = self.steps // 4
            distance[:, first : first + pause] = distance[:, [first + pause]]
        pushed = distance.copy()
        pushed[:, 1:] += finite("injected", injected, 0.0) * rng.standard_normal(
            distance[:, 1:].shape
        )
        # The label leads from the disturbed position to the next undisturbed one.
        return Runs(pushed, distance[:, 1:] - pushed[:, :-1])

    def sides(self, states: ArrayLike) -> NDArray[np.int64]:
        """Return +1 for each run that passed left, -1 right, 0 if it collided or did not arrive.

        Args:
            states: positions, shape (N, T + 1, 2); a path is the polyline through them.
        """
        path = vector("states", states, (None, None, 2))
        return sides(np.ascontiguousarray(path), self.centre, self.radius, self.reach)


def _sides(path, centre, radius, reach):
    """Return `TwoWays.sides` of positions (N, T + 1, 2), shape (N,)."""
    result = np.zeros(len(path), np.int64)
    for i in range(len(path)):
        clear, beside = True, 0
        for k in range(path.shape[1]):
            x, y = path[i, k, 0] - centre, path[i, k, 1]
            # The side is that of the waypoint closest to the disc along x.
            if abs(x) < abs(path[i, beside, 0] - centre):
                beside = k
            if k + 1 < path.shape[1]:
                # Nearest point of this step's segment to the middle of the disc.
                u, v = path[i, k + 1, 0] - path[i, k, 0], path[i, k + 1, 1] - y
                along = -(x * u + y * v) / max(u * u + v * v, 1e-12)
                along = min(max(along, 0.0), 1.0)
                clear = clear and math.hypot(x + along * u, y + along * v) >= radius
        if clear and math.hypot(path[i, -1, 0] - 1.0, path[i, -1, 1]) <= reach:
            result[i] = np.sign(path[i, beside, 1])
    return result


# A compiled loop: for plain Python and for compiled callers.
_REAL = numba.float64
sides = loop(_sides, numba.int64[::1](numba.float64[:, :, ::1], _REAL, _REAL, _REAL))


# --- contexts: one right action a step ------------------------------------------------------------


def context_costs(
    wrong: ArrayLike, steps: int, number: int, rng: np.random.Generator, *, recovers: bool
) -> Array:
    """Return the number of wrong steps of a copied table in each of `number` episodes.

    Every step shows one of K contexts, drawn evenly. Without recovery the first wrong action is a
    fall: no demonstration shows what to do then, all later steps are wrong too.

    Args:
        wrong: whether the table's action is wrong in each context, shape (K,).
        steps: length of an episode.
        number: how many episodes.
        rng: random numbers.
        recovers: whether a right action is possible again after a wrong one.

    Returns:
        Cost of each episode, shape (number,).
    """
    table = np.asarray(wrong, dtype=bool)
    shape = (count("number", number, 1), count("steps", steps, 1))
    missed = table[rng.integers(len(table), size=shape)]
    # A fall is for good: after the first wrong action all are wrong.
    if not recovers:
        missed = np.logical_or.accumulate(missed, axis=1)
    return missed.sum(axis=1).astype(float)


def expected_cost(share: ArrayLike, steps: ArrayLike, *, recovers: bool) -> Array:
    """Return the mean of `context_costs` for a share of wrong contexts.

    eps T with recovery; without it the sum of 1 - (1 - eps)^t for t = 1 ... T, about eps T^2 / 2
    as long as eps T is small (Ross and Bagnell, Efficient reductions for imitation learning, 2010),
    and never more than T.
    """
    eps, T = np.asarray(share, dtype=float), np.asarray(steps, dtype=float)
    if recovers:
        return eps * T
    retained = 1.0 - eps
    # Closed form of the geometric sum; at eps = 0 it is 0 / 0.
    with np.errstate(divide="ignore", invalid="ignore"):
        summed = T - retained * (1.0 - retained**T) / eps
    return np.where(eps == 0.0, 0.0, summed)


def accumulated(a: float, error: float, steps: int) -> Array:
    """Sum of |x| up to each step of x' = a x + error from x = 0, shape (steps,)."""
    x, path = 0.0, np.empty(count("steps", steps, 1))
    for k in range(steps):
        x = a * x + error
        path[k] = abs(x)
    return np.cumsum(path)


# --- a regulator with a perfect expert ------------------------------------------------------------


@dataclass(frozen=True)
class Regulator:
    """An inverted pendulum near the top, x = (angle, rate), and a linear expert u = -K x.

    x'' = stiffness x + u in steps of dt, by the exact solution with u held. The expert's closed
    loop has the real eigenvalues exp(-slow dt) and exp(-fast dt).

    Attributes:
        stiffness: gravity over length [1/s^2].
        dt: step [s].
        slow, fast: rates of decay [1/s].
        A, B, K: of the step x' = A x + B u (2, 2), (2,), and of the expert (2,).
    """

    stiffness: float = 4.0
    dt: float = 0.05
    slow: float = 1.0
    fast: float = 4.0
    A: Array = field(init=False)
    B: Array = field(init=False)
    K: Array = field(init=False)

    def __post_init__(self) -> None:
        w, h = np.sqrt(positive("stiffness", self.stiffness)), positive("dt", self.dt)
        # Exact discretisation: the exponential of [[0, 1], [w^2, 0]] dt, and its integral.
        c, s = np.cosh(w * h), np.sinh(w * h)
        A, B = np.array([[c, s / w], [w * s, c]]), np.array([(c - 1.0) / w**2, s / w])
        poles = np.exp(-h * np.array([self.slow, self.fast]))
        desired = A @ A - poles.sum() * A + poles.prod() * np.eye(2)  # Ackermann's formula
        # The last row of the inverse controllability matrix, times the desired polynomial of A.
        K = np.linalg.solve(np.stack((B, A @ B)), np.array([0.0, 1.0])) @ desired
        for name, value in (("A", A), ("B", B), ("K", K)):
            object.__setattr__(self, name, value)

    def closed(self, gain: ArrayLike) -> Array:
        """Return the loop A - B gain, shape (2, 2)."""
        return self.A - np.outer(self.B, vector("gain", gain, (2,)))

    def radius(self, gain: ArrayLike) -> float:
        """Return spectral radius of the loop; unstable above 1."""
        return float(np.abs(np.linalg.eigvals(self.closed(gain))).max())

    def slow_mode(self) -> Array:
        """Return the direction in which the expert's loop decays most slowly.

        It is a unit vector, shape (2,).
        """
        values, vectors = np.linalg.eig(self.closed(self.K))
        return vectors[:, np.argmax(np.abs(values))].real

    def starts(self, number: int, rng: np.random.Generator) -> Array:
        """Return states on the slow mode.

        As a loop is that has run for a while, shape (number, 2).
        """
        return rng.uniform(0.5, 1.5, (count("number", number, 1), 1)) * self.slow_mode()

    def step(self, states: Array, actions: Array, rng: np.random.Generator) -> Array:
        """Return the states a step later."""
        return states @ self.A.T + actions * self.B

    def expert(self, states: Array, rng: np.random.Generator) -> Array:
        """Return -K x of each row, shape (N, 1)."""
        return -(states @ self.K)[:, None]


# --- circling, which is stable by itself ----------------------------------------------------------


@dataclass(frozen=True)
class Circle:
    """A cart of speed 1 keeps to a circle of radius 1; the action is its rate of turning [rad/s].

    States are (x, y, cos, sin) of place and heading. The expert's loop, linear in the distance
    from the circle and the heading against its tangent, has a double root at -2 / s.
    """

    dt: float = 0.1

    def starts(self, number: int, rng: np.random.Generator) -> Array:
        """Return states on the circle and along it, a little off, shape (number, 4)."""
        place, turn, far = rng.standard_normal((3, count("number", number, 1)))
        place *= np.pi
        heading, r = place + 0.5 * np.pi + 0.05 * turn, 1.0 + 0.05 * far
        both = r * np.cos(place), r * np.sin(place), np.cos(heading), np.sin(heading)
        return np.stack(both, axis=1)

    def step(self, states: Array, actions: Array, rng: np.random.Generator) -> Array:
        """Return the states a step later: an arc with the rate held, exact."""
        x, y, c, s = states.T
        half = 0.5 * self.dt * actions[:, 0]
        # Chord of an arc at speed 1, which points along the heading half way; sinc is 1 at rate 0.
        chord = self.dt * np.sinc(half / np.pi)  # of the arc
        # Addition theorems advance (cos, sin) without an arctangent.
        ch, sh = np.cos(half), np.sin(half)
        mc, ms = c * ch - s * sh, s * ch + c * sh  # the heading half way
        new = x + chord * mc, y + chord * ms, mc * ch - ms * sh, ms * ch + mc * sh
        return np.stack(new, axis=1)

    def expert(self, states: Array, rng: np.random.Generator) -> Array:
        """Return the rate of turning, shape (N, 1)."""
        x, y, c, s = states.T
        # The middle of the circle has no tangent: the floor guards the divisions.
        r = np.maximum(np.hypot(x, y), 1e-3)
        inward = np.arctan2(-(x * c + y * s) / r, (x * s - y * c) / r)  # heading from the tangent
        # Rate of the tangent at this radius, plus feedback on distance and heading.
        return (np.cos(inward) / r + 4.0 * (r - 1.0) - 4.0 * inward)[:, None]

    def cost(self, states: Array) -> Array:
        """Return the distance from the circle, of states (..., 4)."""
        return np.abs(np.hypot(states[..., 0], states[..., 1]) - 1.0)
