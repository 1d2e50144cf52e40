"""Chapter 0: the stack as a graph, and how old the information is that its commands rest on.

*Data age* looks back: from a moment to the capture of the measurement behind the command then in
force. *Reaction time* looks ahead: from an event to the first command that rests on a measurement
taken after it. If nothing is lost, queued or late, the sum of periods and executions bounds both:
A. Davare and others, Period optimization, DAC 2007; M. Duerr and others, End-to-end timing
analysis, ACM TECS 18, 2019.

The chapter's algorithms, and the functions of their steps:

- Data age of a chain in closed form (Davare et al., 2007): `age`, link by link in `_links`.
- The chain event by event: `simulate`, with `read` for queues and `serve` for stages that are busy.
- Greedy improvement of a chain: `spend` ranks single changes by the time that they save per core.

Examples:
    >>> from course import role
    >>> camera = role.Stage("camera", execution=0.010, period=0.030)
    >>> control = role.Stage("control", execution=0.001, period=0.002)
    >>> print(f"{1e3 * role.age([camera, control]).mean:.1f} ms")  # C1 + C2 + (T1 + T2) / 2
    27.0 ms
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import count, finite, invalid, one_of, positive, vector

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """A stage that turns one sample into the next.

    Attributes:
        execution: C, from start to result [s].
        period: T of its clock [s]; None: it starts when a sample arrives.
        depth: length of the keep-last queue that it reads; 1 holds the newest value only.
        overload: what becomes of a start while it is busy. "": an execution above the period is
            rejected; "skip": the start is lost; "queue": the sample waits (on arrival);
            "pipelined": another worker takes it.
        jitter: executions are spread evenly over C - jitter to C + jitter [s].
        lost: share of results that never arrive.
    """

    name: str
    execution: float
    period: float | None = None
    depth: int = 1
    overload: str = ""
    jitter: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        at = f"of {self.name}"
        positive(f"execution time {at}", self.execution, unit="s")
        count(f"depth {at}", self.depth, 1)
        one_of(f"overload {at}", self.overload, ("", "skip", "queue", "pipelined"))
        finite(f"jitter {at}", self.jitter, 0.0, self.execution, unit="s")
        finite(f"lost {at}", self.lost, 0.0, 0.99)
        if self.period is not None:
            positive(f"period {at}", self.period, unit="s")
            if self.overload == "queue":
                raise invalid(f"overload {at}", "queue", "skip or pipelined under a clock")
            self.interval(self.period)

    def interval(self, period: float, early: float = 0.0) -> float:
        """Return the interval of results [s] if starts come once a period, or up to `early` sooner.

        ValueError if that is overload, and there is no rule for it.
        """
        longest, rule = self.execution + self.jitter, self.overload
        # No overload, or a worker for every start: one result a period.
        if longest <= (period - early) * (1.0 + 1e-9) or rule == "pipelined":
            return period
        if rule == "queue" and not self.jitter and self.execution >= period + early:
            return self.execution  # always busy
        # Starts that find it busy are lost. The results are regular only if the shortest and the
        # longest execution take equally many periods.
        least, largest = (
            math.ceil(x / period - 1e-9) for x in (longest - 2 * self.jitter, longest)
        )
        if rule == "skip" and least == largest and not early:
            return period * largest
        allowed = f"at most its period {period:.3g} s"
        if rule:
            allowed += ", as its results are not regular with this rule for overload"
        else:
            allowed += " without a rule for overload"
        raise invalid(f"execution time of {self.name}", longest, allowed)


@dataclass(frozen=True)
class Age:
    """How old the information behind the command in force is [s].

    Bounds (the greatest a supremum, inf with losses), mean and standard deviation over time and
    phases; mean wait after each.
    """

    least: float
    mean: float
    greatest: float
    std: float
    waits: tuple[float, ...]


def _links(stages: Sequence[Stage]) -> list[tuple[float, float, float, float]]:
    """Return four numbers of the link after each stage, from which `age` follows.

    The interval of its results [s], the share of them that arrives, the interval that a result may
    wait for the next stage [s], and what a full queue adds to that [s].
    """
    if not stages or stages[0].period is None:
        raise invalid("stages", [s.name for s in stages], "a chain whose first stage has a period")
    result: list[tuple[float, float, float, float]] = []
    # T: interval so far; retained: share not lost; early: how much sooner than T a result may come.
    T, retained, early = 0.0, 1.0, 0.0
    for stage in stages:
        before, clocked = T, stage.period is not None
        # Under a clock starts are regular; on arrival, the jitter so far can bring them early.
        T = stage.interval(stage.period or before, 0.0 if clocked else early)
        waits = clocked or (stage.overload == "queue" and before < T)
        if result:
            full = waits and before < T * (1.0 - 1e-9)
            if retained < 1.0 and ((full and stage.depth > 1) or (before < T and not clocked)):
                raise invalid("lost", 1.0 - retained, f"0 before {stage.name}, which loses others")
            result[-1] = (before, retained, before * waits, (stage.depth - 1) * before * full)
        # A clock runs whether or not something new came: losses before it cost age, not results.
        retained = (1.0 if clocked else retained) * (1.0 - stage.lost)
        odd = bool(result) and waits and stage.depth > 1 and early > abs(T - before)
        early = (0.0 if waits else early) + 2.0 * stage.jitter
        if odd or early > T * (1.0 + 1e-9):
            allowed = "less: results overtake others, or a queue is full at times only"
            raise invalid(f"jitter up to {stage.name}", sum(s.jitter for s in stages), allowed)
        result.append((T, retained, T, 0.0))
    return result


def age(stages: Sequence[Stage]) -> Age:
    """Return data age of a chain in closed form, for independent phases.

    A clock reads at any time what came last: it is old by anything from 0 to the *producer's*
    interval; the last command is in force for the last one; a start on arrival waits for nothing.
    So the age is the sum of all C and of independent even spreads. A queue of depth d on a faster
    producer is always full, and adds (d - 1) of its intervals. Jitter of the executions leaves the
    mean as it is; lost samples (share p) lengthen a wait by (1 + p) / (1 - p).

    Args:
        stages: from the sensor, whose start is the capture, to the last before the actuator.

    Raises:
        ValueError: the first has no period; one is overloaded without a rule, or at times only;
            samples are lost before a full queue or a stage that skips, or overtaken.
    """
    links = _links(stages)
    C, spread = (sum(getattr(s, name) for s in stages) for name in ("execution", "jitter"))
    # Executions are uniform over +-J, which has the variance J^2 / 3.
    variance, waits = sum(s.jitter**2 for s in stages) / 3.0, []
    for _, q, T, behind in links:
        # The interval that one falls into is T times a geometric number, drawn by its length.
        # Inspection paradox: moments E[L^2] / (2 E[L]) and E[L^3] / (3 E[L]) of its length L.
        mean = T * (2.0 - q) / (2.0 * q)
        variance += (T / q) ** 2 * (q * q - 6.0 * q + 6.0) / 3.0 - mean**2
        waits.append(mean + behind)
    behind = sum(link[3] for link in links)
    # Where samples can be lost, no wait has a bound.
    greatest = behind + C + spread + sum(T if q == 1.0 else math.inf for _, q, T, _ in links)
    return Age(C - spread + behind, C + sum(waits), greatest, math.sqrt(variance), tuple(waits))


def read(times: Array, ticks: Array, depth: int) -> NDArray[np.int64]:
    """Return which sample of a queue a reader gets at each tick, (M,); -1 where none has arrived.

    Samples arrive at `times` (N,). The queue holds the last `depth` of them. The reader gets the
    oldest one that it has not read, and from an empty queue the last one again.
    """
    # The newest sample that has arrived at each tick.
    index = np.searchsorted(times, ticks, side="right") - 1
    last = np.int64(-1)
    # With a depth of 1 the newest sample is the answer.
    if depth == 1:
        return index
    for k in range(index.size):
        # The next unread sample if it has arrived, else the last one again (min). But what is older
        # than the last `depth` samples has been dropped (max).
        last = max(min(last + 1, index[k]), index[k] - depth + 1)
        index[k] = last
    return index


def free(ticks: Array, durations: Array) -> NDArray[np.bool_]:
    """Return which ticks find the stage free, if ticks that do not are lost.

    Both arrays have shape (M,) [s].
    """
    retained, until = np.zeros(ticks.size, np.bool_), -np.inf
    for k in range(ticks.size):
        # A start within rounding of the last end finds the stage free.
        if ticks[k] >= until - 1e-12:
            retained[k], until = True, ticks[k] + durations[k]
    return retained


def serve(times: Array, durations: Array, depth: int) -> tuple[NDArray[np.int64], Array]:
    """Return which samples are taken, one after the other, and when: (K,) each; see `read`."""
    taken, starts = np.empty(times.size, np.int64), np.empty(times.size)
    last, jobs, now = -1, 0, -np.inf
    while last + 1 < times.size:
        # What has arrived when the stage is free; idle, it begins with the next arrival.
        arrived = int(np.searchsorted(times, now + 1e-12, side="right")) - 1
        if arrived <= last:
            arrived, now = last + 1, times[last + 1]
        # The oldest unread sample that a queue of this depth still holds.
        last = max(last + 1, arrived - depth + 1)
        taken[jobs], starts[jobs] = last, now
        now, jobs = now + durations[jobs], jobs + 1
    return taken[:jobs], starts[:jobs]


@dataclass(frozen=True)
class Trace:
    """Commands of one run: when each came into force, when its measurement was taken, (N,) [s]."""

    published: Array
    captured: Array

    def age(self, times: Array) -> Array:
        """Return data age at these times, NaN before the first command [s]."""
        index = np.searchsorted(self.published, times, side="right")
        # `index` counts the commands up to each time. With a NaN in front, number k is command k,
        # and number 0 means that there was none yet.
        return times - np.append(np.nan, self.captured)[index]

    def reaction(self, events: Array) -> Array:
        """Return reaction time to events at these times, NaN where the run ended before it [s]."""
        # The first measurement that is not older than the event: `captured` never decreases.
        index = np.searchsorted(self.captured, events)
        return np.append(self.published, np.nan)[index] - events


def simulate(
    stages: Sequence[Stage], phases: Array | Sequence[float], seed: int = 0, seconds: float = 10.0
) -> Trace:
    """Simulate a chain event by event; queues are empty at time 0, and fill.

    Args:
        stages: as for `age`; ValueError as there, but for losses and jitter.
        phases: of each stage's first start, shares of its period, shape (n,).
        seed: of jitter and losses.
        seconds: how long stages are started [s].
    """
    _links([replace(stage, lost=0.0, jitter=0.0) for stage in stages])
    phases = vector("phases", phases, (len(stages),))
    rng, seconds = np.random.default_rng(seed), positive("seconds", seconds, unit="s")
    times = captured = np.empty(0)
    # Stage by stage to the end of time, as each needs only the results of the one before it.
    for k, stage in enumerate(stages):
        # A clock starts a stage at its ticks; without one, each arrival does.
        starts = times if (T := stage.period) is None else T * np.arange(phases[k], seconds / T)
        durations = rng.uniform(-1.0, 1.0, starts.size) * stage.jitter + stage.execution
        if stage.overload == "queue":
            taken, starts = serve(times, durations, stage.depth)
            durations = durations[: taken.size]
        else:
            # A start that finds the stage busy is lost, unless workers run in parallel.
            runs = free(starts, durations) | (stage.overload == "pipelined")
            starts, durations = starts[runs], durations[runs]
            taken = read(times, starts, stage.depth if stage.period else 1)
        captured = starts if k == 0 else np.append(captured, np.nan)[taken]  # -1: none yet
        arrived = (rng.random(starts.size) >= stage.lost) & ~np.isnan(captured)
        times = (starts + durations)[arrived]
        order = np.argsort(times, kind="stable")
        # What is overtaken stays behind: a late result of an older sample is not newer.
        times, captured = times[order], np.maximum.accumulate(captured[arrived][order])
    return Trace(times, captured)


class Option(NamedTuple):
    """One change of one stage: what it saves in the mean [s], cores it adds, and the chain then."""

    stage: str
    change: str
    gain: float
    load: float
    stages: tuple[Stage, ...]


def load(stages: Sequence[Stage]) -> float:
    """Return how many cores a chain keeps busy: the sum of execution over interval."""
    return sum(s.execution / link[0] for s, link in zip(stages, _links(stages), strict=True))


def spend(stages: Sequence[Stage]) -> list[Option]:
    """Return what each change of one stage would save, best per core first.

    Twice the rate, with more workers where an execution is longer than that; a start on arrival, by
    each rule where that is overload; parallel workers where starts are lost; the newest value of a
    queue. What overloads a stage or breaks a hard deadline is left out.
    """
    links = _links(stages)
    before, busy, result = age(stages).mean, load(stages), []
    for k, stage in enumerate(stages):
        T, rule, longest = stage.period, stage.overload, stage.execution + stage.jitter
        changes: dict[str, Any] = {
            "pipelined": rule == "skip" and {"overload": "pipelined"},
            "newest value": {"depth": 1},
        }
        if T:
            more = longest > T / 2.0
            changes["twice the rate" + ", more workers" * more] = {
                "period": T / 2.0,
                "overload": "pipelined" if more else rule,
            }
        if T and k:
            # A stage that its input would overload needs a rule, and the rules differ.
            over = longest > links[k - 1][0] * (1.0 + 1e-9)
            for start in ("skip", "queue", "pipelined") if over else ("",):
                changes["on arrival" + f": {start}" * over] = {
                    "period": None,
                    "depth": 1,
                    "overload": start,
                }
        for change, fields in changes.items():
            try:
                chain = (*stages[:k], replace(stage, **fields or {}), *stages[k + 1 :])
                saved, added = before - age(chain).mean, load(chain) - busy
            except ValueError:
                continue  # overloaded
            # No change may miss a hard deadline that was met before.
            if chain != tuple(stages) and set(missed(chain)) <= set(missed(stages)):
                result.append(Option(stage.name, change, saved, added, chain))
    return sorted(result, key=lambda o: -o.gain / max(o.load, 1e-9))


class Cost(NamedTuple):
    """Errors of position [m] and phase lost [rad]. Held: the value taken as it is.

    Predicted: at constant velocity over the known age. Unstamped: over the mean age, the true one
    unknown.
    """

    held: float
    predicted: float
    unstamped: float
    phase: float


def cost(age: Age | float, speed: float, acceleration: float = 0.0, bandwidth: float = 0.0) -> Cost:
    """Return what an age, or one single age [s], costs a motion.

    Errors in the mean (unstamped: rms), of what moves with a speed and acceleration [m/s, m/s^2],
    in a loop of some bandwidth [Hz].
    """
    mean, std = (age.mean, age.std) if isinstance(age, Age) else (finite("age", age, 0.0), 0.0)
    speed, acceleration = finite("speed", speed, 0.0), finite("acceleration", acceleration, 0.0)
    turn = 2.0 * math.pi * finite("bandwidth", bandwidth, 0.0)
    # Prediction at constant velocity misses a age^2 / 2, whose mean contains the variance of the
    # age.
    return Cost(speed * mean, acceleration * (mean**2 + std**2) / 2.0, speed * std, turn * mean)


BOXES = ("robot", "simulation", "middleware", "perception", "planning", "control", "learning")


@dataclass(frozen=True)
class Edge:
    """What flows from one box to another.

    Rate [Hz], bytes a sample, depth of the queue it is read from, and whether its deadline is
    "hard", "soft" or "none".
    """

    source: str
    target: str
    flow: str
    rate: float
    size: int
    depth: int = 1
    deadline: str = "soft"

    def __post_init__(self) -> None:
        for box in (self.source, self.target):
            one_of(f"box of {self.flow}", box, BOXES)
        positive(f"rate of {self.flow}", self.rate, unit="Hz")
        count(f"size or depth of {self.flow}", min(self.size, self.depth), 1)
        one_of(f"deadline of {self.flow}", self.deadline, ("hard", "soft", "none"))

    @property
    def bandwidth(self) -> float:
        """What it carries [bytes/s]."""
        return self.rate * self.size


_IMAGE, _STATE, _TORQUE = 640 * 480 * 2, 7 * 3 * 8, 7 * 8  # depth in mm; q, v, tau; torques
STACK = (
    Edge("robot", "middleware", "depth image", 30.0, _IMAGE),
    Edge("simulation", "middleware", "simulated image", 30.0, _IMAGE, 1, "none"),
    Edge("middleware", "perception", "depth image", 30.0, _IMAGE),
    Edge("middleware", "learning", "log of images", 30.0, _IMAGE, 100, "none"),
    Edge("perception", "planning", "poses and covariances", 30.0, (7 + 36) * 8),
    Edge("planning", "control", "trajectory of 50 points", 10.0, 50 * 14 * 8),
    Edge("robot", "control", "joint state", 1000.0, _STATE, 1, "hard"),
    Edge("simulation", "control", "simulated joint state", 1000.0, _STATE, 1, "none"),
    Edge("control", "robot", "torques", 1000.0, _TORQUE, 1, "hard"),
    Edge("control", "simulation", "simulated torques", 1000.0, _TORQUE, 1, "none"),
    Edge("simulation", "learning", "episodes", 1.0, 200 * _STATE, 100, "none"),
    Edge("learning", "simulation", "ranges of parameters", 0.01, 20 * 8, 1, "none"),
    Edge("learning", "control", "weights of a policy", 0.001, 50_000 * 4, 1, "none"),
)
CHAIN = (
    Stage("perception", 0.045, 1.0 / 30.0, overload="pipelined"),
    Stage("planning", 0.060, 0.1),
    Stage("control", 0.0002, 0.001),
)


def around(box: str, edges: Sequence[Edge] = STACK) -> tuple[list[Edge], list[Edge]]:
    """Return what flows into a box, and what flows out of it."""
    one_of("box", box, BOXES)
    return [e for e in edges if e.target == box], [e for e in edges if e.source == box]


def missed(stages: Sequence[Stage], edges: Sequence[Edge] = STACK) -> list[str]:
    """Return the flows from these stages that may miss a hard deadline.

    A flow may be lost, or come later than a period of its edge after the one before, or later than
    that after its start.
    """
    chain = zip(stages, _links(stages), strict=True)
    return [
        e.flow
        for s, (T, retained, *_) in chain
        for e in edges
        if e.source == s.name
        and e.deadline == "hard"
        and (retained < 1.0 or max(T, s.execution + s.jitter) * e.rate > 1.0 + 1e-9)
    ]


def check_stack(edges: Sequence[Edge]) -> None:
    """Raise ValueError if a box has nothing in or out, or a loop runs through no plant."""
    for box in BOXES:
        if not all(around(box, edges)):
            raise invalid("edges", f"nothing into or out of {box}", "both for each box")
    # Feedback through the plant is what control is; only other loops are faults.
    remaining = [e for e in edges if not {e.source, e.target} & {"robot", "simulation"}]
    while remaining:
        # Kahn, 1962: take away edges from boxes that nothing flows into; what cannot go is a loop.
        rest = [e for e in remaining if e.source in {other.target for other in remaining}]
        if len(rest) == len(remaining):
            loop = "a loop among " + ", ".join(sorted({e.source for e in remaining}))
            raise invalid("edges", loop, "loops through the robot only")
        remaining = rest
