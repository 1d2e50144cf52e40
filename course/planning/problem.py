"""A question to a planner, its answer, and the one door to all planners: `plan`.

A method is a function of a `Query` that gives a `Plan`; `METHODS` holds them by name. A bad
argument is an error; a start in collision is no mistake of the caller, and gives a status.
"""

from __future__ import annotations

import functools
import math
import operator
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, vector
from course.planning.samplers import EDGE_CHECKS, STATE_CHECKS, TRIES
from course.planning.worlds import World, function_behind

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

# What became of a question. The first is the only one with a path.
SOLVED, NO_SAMPLES, NO_TIME = "solved", "out of samples", "out of time"
START_BLOCKED, GOAL_BLOCKED = "start in collision", "goal in collision"
START_OUT, GOAL_OUT = "start out of bounds", "goal out of bounds"

NONE, NOBODY = np.empty((3, 0)), np.empty((2, 0), dtype=np.int64)

_TELL_AFTER = 2.0  # s; a run that takes longer says how far it is, and again after as long


@dataclass(frozen=True)
class Budget:
    """What a planner may spend; whichever ends first.

    Attributes:
        samples: targets drawn.
        seconds: wall-clock time; checked after each chunk of samples, of some milliseconds.
    """

    samples: int = 10_000
    seconds: float = float("inf")

    def __post_init__(self) -> None:
        count("budget.samples", self.samples, 1)
        if not (isinstance(self.seconds, Real) and self.seconds > 0.0):
            raise invalid("budget.seconds", self.seconds, "a positive number [s]")


@dataclass(frozen=True, eq=False)
class Region:
    """A goal that is a box of states: any free one of them will do.

    Attributes:
        low, high: its corners, shape (n,), low nowhere above high.
    """

    low: Array
    high: Array


@dataclass(eq=False)
class Plan:
    """What a planner answered.

    Attributes:
        status: "solved", "out of samples", "out of time", or what is wrong with start or goal.
        method: the planner's name in `METHODS`.
        path: from the start to the goal, exactly, shape (n, k); (n, 1) where start is goal; None
            unless solved.
        cost: length of the path, infinite without one.
        samples: targets drawn.
        state_checks, edge_checks: how often the world was queried; in a world of kind "function"
            state_checks are the calls of the function, those along edges among them.
        seconds: for everything, the checks of the arguments included [s].
        nodes: of the tree or graph, shape (n, m); of both trees, one after the other.
        parents: of each node, shape (m,), -1 for a root; empty for a graph.
        costs: from its root to each node along the tree, shape (m,); empty without a tree.
        history: length of the best path so far against work, rows samples, seconds, cost: (3, h).
        edges: of a graph, pairs of nodes, shape (2, e); empty for a tree.
    """

    status: str
    method: str
    path: Array | None = None
    cost: float = float("inf")
    samples: int = 0
    state_checks: int = 0
    edge_checks: int = 0
    seconds: float = 0.0
    nodes: Array = field(default_factory=lambda: NONE[:, :0])
    parents: Ints = field(default_factory=lambda: NOBODY[0])
    costs: Array = field(default_factory=lambda: NONE[0])
    history: Array = field(default_factory=lambda: NONE)
    edges: Ints = field(default_factory=lambda: NOBODY)

    @property
    def solved(self) -> bool:
        """True if there is a path."""
        return self.path is not None


@dataclass(eq=False)
class Query:
    """A question that is in order: what a method is handed.

    Attributes:
        world, start: the start is free, shape (n,).
        goal: corners of the goal's box, rows, shape (2, n); equal where the goal is a state.
        budget, rng: as for `plan`.
        method, options: what the caller chose.
        begun: when, by `time.perf_counter` [s].
        counts: what compiled loops count (`samplers.SAMPLES`, ...), shape (16,).
    """

    world: World
    start: Array
    goal: Array
    budget: Budget
    rng: np.random.Generator
    method: str
    options: dict[str, Any]
    begun: float
    progress: Callable[[str], None] | None = None
    counts: Ints = field(default_factory=lambda: np.zeros(16, dtype=np.int64))
    calls: int = 0  # of a user's function, before this question
    _last_report: float = 0.0
    _names: set[str] = field(default_factory=set)  # of the options that the method has read

    def option(self, name: str, default: Any = None) -> Any:
        """Return an option of the caller, or the default, and take it out of `options`."""
        self._names.add(name)
        return self.options.pop(name, default)

    def reject_unknown(self) -> None:
        """Raise an error that names the options that the method has, if others are left."""
        if self.options:
            names, known = (", ".join(sorted(names)) for names in (self.options, self._names))
            raise invalid(f"options of {self.method}", names, f"among {known}")

    @property
    def seconds(self) -> float:
        """Since the question was put [s]."""
        return time.perf_counter() - self.begun

    @functools.cached_property
    def one_goal(self) -> bool:
        """True if the goal is a single state."""
        low, high = self.goal.tolist()
        return bool(low == high)

    def is_free(self, q: Array) -> bool:
        """Return whether a state is free, counted."""
        self.counts[STATE_CHECKS] += 1
        free = bool(self.world.kernels[0](self.world.obstacles, self.world.body, q))
        self.report_progress("begins")
        return free

    def goal_root(self) -> Array | None:
        """Return a free state of the goal; None where some draws found none."""
        if self.one_goal:
            return self.goal[0].copy()
        draws = (np.asarray(self.rng.uniform(*self.goal)) for _ in range(TRIES))
        return next((q for q in draws if self.is_free(q)), None)

    def report_progress(self, done: str) -> None:
        """Say how far a long run is, every two seconds; and pass on what a function raised."""
        # A compiled loop can't raise: an exception of the user's function comes out here, between
        # chunks.
        function = function_behind(self.world)
        if function is not None and function.raised is not None:
            error, q = function.raised
            function.raised = None
            # An interrupt or an exit is not the function's mistake and passes through unchanged.
            if not isinstance(error, Exception):
                raise error
            message = f"a function that answers; it raised {error!r} at {q.tolist()}"
            raise invalid("valid", function.valid, message) from error
        if self.seconds - self._last_report > _TELL_AFTER:
            self._last_report = self.seconds
            text = f"{self.method}: {done} after {self._last_report:.0f} s"
            if self.progress is not None:
                self.progress(text)
            elif os.environ.get("COURSE_QUIET") != "1":
                print(text, file=sys.stderr)

    def answer(self, status: str, path: Array | None = None, **result: Any) -> Plan:
        """Return the plan, from what was counted; `path` is of rows, shape (k, n)."""
        samples, states, edges = self.counts[: EDGE_CHECKS + 1].tolist()
        function = function_behind(self.world)
        if function is not None:
            states = function.calls - self.calls
        if path is not None:
            result.setdefault("cost", length(path.T))
            result["path"] = np.ascontiguousarray(path.T)
        return Plan(
            status,
            self.method,
            samples=samples,
            state_checks=states,
            edge_checks=edges,
            seconds=self.seconds,
            **result,
        )


# The planners by name, filled by the files that hold them: function (query) -> Plan.
METHODS: dict[str, Callable[[Query], Plan]] = {}
# What compiles the loops of each, or loads them from the cache: done before the clock starts.
LOOPS: dict[str, Callable[[], Any]] = {}


def length(path: ArrayLike) -> float:
    """Return the length of a path of states, shape (n, k), in the unit of a state."""
    states = np.asarray(path, dtype=float).T.tolist()  # a path is short: lists are faster
    return math.fsum(map(math.dist, states, states[1:]))


def plan(
    world: World,
    start: ArrayLike,
    goal: ArrayLike | Region,
    *,
    method: str = "rrt_connect",
    budget: Budget | int = 10_000,
    rng: np.random.Generator | int = 0,
    progress: Callable[[str], None] | None = None,
    **options: Any,
) -> Plan:
    """Return a path from start to goal that touches nothing, or why there is none.

    Args:
        world: where, see `worlds` and `scenes`.
        start: state, shape (n,).
        goal: state, shape (n,), or a `Region` of them.
        method: one of `METHODS`: "rrt", "rrt_connect", "rrt_star", "informed_rrt_star", ...
        budget: a `Budget`, or just how many samples. An RRT* uses all of it; the others stop at the
            first path.
        rng: random numbers, or a seed. The same seed gives the same answer, unless time ends it.
        progress: called every two seconds with the state of a long run. Without it the state goes
            to standard error, unless the environment variable COURSE_QUIET is 1.
        options: of the method. For trees: step (longest edge, a fifth of the bounds' diagonal),
            goal_bias (share of targets drawn from the goal, 0.05; not of RRT-Connect), sampler
            ("uniform", "halton", "gaussian", "bridge", "obstacle", or your own states (n, m), drawn
            in this order, uniform ones after them), mix (share of targets from it, the rest
            uniform, 1), spread (of the last three names, a twentieth of the diagonal).

    Returns:
        The plan; its path is the states from start to goal, both exactly, joined by straight edges.

    Raises:
        ValueError: for a wrong shape, a NaN, an empty budget, an unknown method or option, or where
            a user's validity function raises.
    """
    one_of("method", method, METHODS)
    if not isinstance(world, World):
        raise invalid("world", world, "a World")
    # A time limit is meant for the planner, not for the compiler at the first call.
    _ = world.kernels
    LOOPS.get(method, _nothing)()
    begun = time.perf_counter()
    spend = budget if isinstance(budget, Budget) else Budget(count("budget", budget, 1))
    here, begins = _state("start", start, world)
    if isinstance(goal, Region):
        box = vector("goal", [goal.low, goal.high], (2, world.dim))
        if (box[0] > box[1]).any():
            raise invalid("goal.low", box[0], f"nowhere above goal.high, {box[1]}")
        ends = world.within(box[0]) and world.within(box[1])
    else:
        aim, ends = _state("goal", goal, world)
        box = np.array((aim, aim))
    generator = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)
    function = function_behind(world)
    query = Query(world, here, box, spend, generator, method, options, begun, progress)
    if function is not None:
        query.calls = function.calls
    if not begins:
        return query.answer(START_OUT)
    if not ends:
        return query.answer(GOAL_OUT)
    if not query.is_free(here):
        return query.answer(START_BLOCKED)
    if query.one_goal and not query.is_free(box[0]):
        return query.answer(GOAL_BLOCKED)
    # The start already satisfies the goal: the path is a single state.
    (low, high), state = box.tolist(), here.tolist()
    if all(map(operator.le, low, state)) and all(map(operator.le, state, high)):
        return query.answer(SOLVED, here[None])
    return METHODS[method](query)


def _nothing() -> None:
    """Compile nothing: a method of the user is plain Python."""


def _state(name: str, value: ArrayLike, world: World) -> tuple[Array, bool]:
    """Return a caller's state, and whether it is in bounds.

    A state in bounds skips the slower check.
    """
    if isinstance(value, np.ndarray) and value.shape == (world.dim,) and value.dtype == float:
        if world.within(value):
            return np.ascontiguousarray(value), True
    state = np.ascontiguousarray(vector(name, value, (world.dim,)))
    return state, world.within(state)


def number(query: Query, name: str, usual: float, low: float, high: float = np.inf) -> float:
    """Return an option of a method that is a number from `low` to `high`."""
    given = query.option(name)
    return usual if given is None else finite(name, given, low, high)
