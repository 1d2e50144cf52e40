"""Tuning a policy on simulated arms: on one, on a range of them, on ranges that open by themselves.

The learner is the simplest there is, cross-entropy search over six gains, so that what a policy
loses on the real arm comes from the arms that it was tuned on, apart from the luck of the search.
What it lowers is the share of failures plus the share of the time outside the target: towards the
fastest policy that succeeds in its simulator, which is how a policy overfits to a simulator.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.control import cem
from course.sim_to_real.plants import (
    DIRECTION,
    DT,
    FIELDS,
    SECONDS,
    Outcome,
    Plants,
    nominal,
    real,
    rollouts,
    tasks,
)
from course.sim_to_real.transfer import mended

Array = NDArray[np.float64]
Sampler = Callable[[int, np.random.Generator], Plants | Array]
KINDS = ("uniform", "log", "whole")

DEFAULT_KINDS = {"mass": "log", "torque": "log"}

GUESS = np.array([50.0, 3.0, 7.0, 25.0, 2.0, 1.3])  # where a search starts, rows of `plants.GAINS`
# Of the logarithm of a gain: the spread of the first tries, and the farthest from GUESS.
SPREAD, FURTHEST = 0.5, 3.0
# How far a range of width 1 reaches to both sides of the simulator's value: as far as gap 1.
WIDTH = {**{name: abs(change) for name, change in DIRECTION.items()}, "delay": 0.03}


@dataclass(frozen=True)
class Ranges:
    """Between what each parameter of an arm is drawn, anew for each episode: a `Sampler`.

    Attributes:
        bounds: name of a field of `Plants` -> (low, high); a field that is not named stays nominal.
        kinds: name of one of the bounds -> "uniform", "log" (uniform in the logarithm, for a
            factor) or "whole" (of a delay: whole samples of the control loop only). Those that are
            not named are `DEFAULT_KINDS`, "log" for mass and torque, and "uniform" for the others.
    """

    bounds: Mapping[str, tuple[float, float]]
    kinds: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.kinds:
            one_of("name in kinds", name, self.bounds)
        object.__setattr__(self, "kinds", {**DEFAULT_KINDS, **self.kinds})
        for name, bound in self.bounds.items():
            one_of("name of a range", name, FIELDS)
            kind = one_of(f"kinds[{name!r}]", self.kinds.get(name, "uniform"), KINDS)
            low, high = vector(name, bound, (2,))
            if low > high or (kind == "log" and low <= 0.0):
                text = "(low, high), the low end first" + ", above 0" * (kind == "log")
                raise invalid(name, tuple(bound), text)
            Plants(**{name: np.array([low, high])})

    def __call__(self, n: int, rng: np.random.Generator) -> Plants:
        """Draw n arms, one by one."""
        drawn: dict[str, Any] = {"mass": np.ones(count("n", n, 1))}
        for name, (low, high) in self.bounds.items():
            kind = self.kinds.get(name, "uniform")
            if kind == "log":
                # Uniform in the logarithm: halving and doubling are equally likely.
                drawn[name] = np.exp(rng.uniform(np.log(low), np.log(high), n))
            elif kind == "whole":
                # The tolerance keeps a bound that is itself a multiple of the sample time.
                first, last = np.ceil(low / DT - 1e-9), np.floor(high / DT + 1e-9)
                if first > last:
                    raise invalid(name, (low, high), f"a range with a multiple of {DT} s in it")
                drawn[name] = DT * rng.integers(int(first), int(last) + 1, n)
            else:
                drawn[name] = rng.uniform(low, high, n)
        return Plants(**drawn)


def around(centre: Plants, width: float) -> Ranges:
    """Return parameter ranges around one arm.

    With width 1 they reach as far to both sides as gap 1 moves an arm. A parameter that cannot be
    negative stops at 0.

    Args:
        centre: one arm, `nominal()` or an identified one.
        width: 0 for that arm alone.
    """
    finite("width", width, 0.0)
    bounds = {}
    for name, half in WIDTH.items():
        (middle,) = np.asarray(getattr(centre, name)).tolist()
        low = {"mass": 0.05, "torque": 0.05, "bias": -np.inf}.get(name, 0.0)
        bounds[name] = (max(low, middle - width * half), middle + width * half)
    return Ranges(bounds)


def only(plants: Plants | Array) -> Sampler:
    """Return one arm for every episode, or some that are taken in turn; may be columns of arms."""
    if isinstance(plants, Plants):
        return lambda n, rng: plants.take(np.arange(n) % plants.size)
    return lambda n, rng: plants[:, np.arange(n) % plants.shape[1]]


def cost(outcome: Outcome) -> Array:
    """Return the cost that the search minimises, for each set of gains.

    It counts failures, and time outside the target.
    """
    # (1 - success rate) + (1 - share of the time in the target).
    return 2.0 - outcome.rate - np.mean(outcome.inside, axis=-1) / SECONDS


class Tuned(NamedTuple):
    """Gains (6,), the cost that the best tries had, and the episodes that it took."""

    gains: Array
    cost: float
    episodes: int


def improve(
    trial: Callable[[Array, int], Outcome],
    rng: np.random.Generator,
    *,
    start: ArrayLike = GUESS,
    rounds: int = 20,
    samples: int = 48,
    elites: int = 12,
    spread: float = SPREAD,
) -> Tuned:
    """Return cross-entropy search over the logarithms of the gains, by anything that can be tried.

    With few rounds and a small spread it is the fine-tuning of gains on a real arm, whose episodes
    are counted.

    Args:
        trial: (sets of gains (6, K), number of the round) -> their outcomes (K, E).
        rng: who draws the tries.
        start: gains to start from, positive.
        rounds: of the search, see `course.control.cem`.
        samples: tries in a round.
        elites: best tries of a round, to which the next one is fitted.
        spread: of the logarithm of a gain in the first round.
    """
    # Search the logarithms relative to GUESS: gains stay positive, and a step is a factor.
    first = np.log(vector("start", start, (6,), low=1e-6) / GUESS)
    tried = [0, 0]

    def costs(plans: Array) -> Array:
        got = trial(GUESS[:, None] * np.exp(plans[:, 0].T), tried[0])
        tried[0] += 1
        tried[1] += got.success.size
        return cost(got)

    result = cem(
        costs,
        first[None],
        rng,
        rounds=rounds,
        samples=samples,
        elites=elites,
        spread=positive("spread", spread),
        limit=FURTHEST,
    )
    return Tuned(GUESS * np.exp(result.plan[0]), result.cost, tried[1])


def tune(sampler: Sampler, seed: int, *, episodes: int = 32, **search: Any) -> Tuned:
    """Return gains for the arms that a sampler draws; each round has arms and tasks of its own.

    Args:
        sampler: `Ranges`, `only(plants)`, or any function (n, rng) -> `Plants`.
        seed: of the tries, the arms and the tasks.
        episodes: for each set of gains in a round, the same for all sets.
        search: `start`, `rounds`, `samples`, `elites` and `spread` of `improve`.
    """
    rng = np.random.default_rng((count("seed", seed), 8))

    def trial(sets: Array, turn: int) -> Outcome:
        # Common random numbers: all sets of a round meet the same arms and tasks.
        plants = sampler(count("episodes", episodes, 1), rng)
        return rollouts(plants, sets, tasks(episodes, int(rng.integers(2**31))))

    return improve(trial, rng, **search)


# --- ranges that open by themselves ---------------------------------------------------------------


class Automatic(NamedTuple):
    """What automatic randomisation came to.

    Attributes:
        ranges: at the end.
        gains: tuned on them, shape (6,).
        history: the moves in order: (round, name, side, share of successes there, new boundary).
        episodes: that it took in all.
    """

    ranges: Ranges
    gains: Array
    history: list[tuple[int, str, int, float, float]]
    episodes: int


def automatic(
    seed: int,
    *,
    rounds: int = 40,
    buffer: int = 128,
    thresholds: tuple[float, float] = (0.8, 0.9),
    step: float = 0.1,
    at_most: float = 2.0,
) -> Automatic:
    """Widen the ranges with automatic domain randomisation (OpenAI, arXiv 1910.07113, sec. 5).

    Each boundary of each parameter has a buffer of its own with the outcomes of episodes in which
    that parameter stands on it and the others are drawn. Once it is full its mean decides: above
    the upper threshold the boundary moves out, below the lower one in, never past the simulator's
    value. There a boundary is picked at random for half of the episodes; here every one is tried in
    every round, between two rounds of the search.

    Args:
        seed: of everything that is drawn.
        rounds: of the search; one fills a quarter of each buffer.
        buffer: episodes that decide.
        thresholds: shares of success, (lower, upper).
        step: by which a boundary moves, in widths as of `around`.
        at_most: farthest position of a boundary, in the same unit.
    """
    low, high = vector("thresholds", thresholds, (2,), low=0.0, high=1.0).tolist()
    if low >= high:
        raise invalid("thresholds", thresholds, "(lower, upper), the lower one first")
    positive("step", step)
    positive("at_most", at_most)
    quarter = count("buffer", buffer, 4) // 4
    rng = np.random.default_rng((count("seed", seed), 5))
    # Begin with gains that suit the simulator's own arm.
    result = tune(only(nominal()), seed, rounds=6)
    episodes, centre, farthest = result.episodes, around(nominal(), 0.0), around(nominal(), at_most)
    bounds = {name: list(bound) for name, bound in centre.bounds.items()}
    buffers: dict[tuple[str, int], list[bool]] = {}
    history = []
    for turn in range(count("rounds", rounds, 1)):
        ranges = Ranges({name: (bound[0], bound[1]) for name, bound in bounds.items()})
        # One round of the search on the present ranges, from the present gains.
        result = tune(ranges, seed + turn, start=result.gains, rounds=1, spread=0.15)
        episodes += result.episodes
        for name, side in ((name, side) for name in bounds for side in (0, 1)):
            start, end = centre.bounds[name][side], farthest.bounds[name][side]
            if start == end:  # nothing below no friction
                continue
            # Boundary sampling: this parameter stands on its boundary, the others are drawn.
            arms = replace(ranges(quarter, rng), **{name: bounds[name][side]})
            tried = rollouts(arms, result.gains, tasks(quarter, int(rng.integers(2**31))))
            episodes += quarter
            filled = buffers.setdefault((name, side), [])
            filled += tried.success.tolist()
            # A full buffer decides, and is then emptied.
            if len(filled) < 4 * quarter:
                continue
            mean = float(np.mean(filled))
            filled.clear()
            # 1 moves the boundary outwards, -1 inwards, 0 not at all.
            move = (mean >= high) - (mean <= low)
            if move:
                moved = bounds[name][side] + move * (2 * side - 1) * step * WIDTH[name]
                bounds[name][side] = float(np.clip(moved, min(start, end), max(start, end)))
                history.append((turn, name, 2 * side - 1, mean, bounds[name][side]))
    # The boundaries may have moved since the last round of the search.
    ranges = Ranges({name: (bound[0], bound[1]) for name, bound in bounds.items()})
    return Automatic(ranges, result.gains, history, episodes)


# --- the gains on record --------------------------------------------------------------------------

RECORD = Path(__file__).with_name("tuned.toml")
GRID = tuple(k / 10 for k in range(11))  # of widths, and of gaps
SEEDS, KNOWN_DELAY, KNOWN_WIDTH = (0, 1, 2), 0.01, 0.4
DELAYS = tuple(k / 1000 for k in range(41))  # [s]
# What each row of a kind stands for: a width, a gap, or a delay.
ROWS = {"range": GRID, "known": GRID, "both": GRID, "load": GRID, "delay": DELAYS}


def remake(kind: str, at: float, seed: int = 0) -> Array:
    """Tune the gains of one entry of the record `tuned.toml` again.

    Args:
        kind: the arms that the gains are tuned on. "range": arms sampled around the simulator's
            own; "known": the real arm with a delay of 10 ms, as if it were identified; "both": arms
            sampled around that one, in a range of width 0.4; "load" or "delay": the simulator's
            arm with this one part as the real arm has it.
        at: what the entry varies: the width of the range ("range"), the gap of the real arm
            ("known", "both", "load"), or the delay [s] ("delay").
        seed: of the search.

    Returns:
        Three PID gains for each joint, shape (6,).
    """
    one_of("kind", kind, ROWS)
    width = {"range": at, "both": KNOWN_WIDTH}.get(kind, 0.0)
    if kind == "range":
        centre = nominal()
    elif kind in ("load", "delay"):
        centre = mended(real(at) if kind == "load" else real(0.0, at), (kind,))
    else:
        centre = real(at, KNOWN_DELAY)
    return tune(around(centre, width) if width else only(centre), seed).gains


def recorded() -> dict[str, Array]:
    """Return the gains on record: kind -> shape (rows, seeds, 6), a row for each of `ROWS`."""
    text = RECORD.read_text(encoding="utf-8")
    return {kind: np.array(rows) for kind, rows in tomllib.loads(text).items()}


def write_record() -> None:
    """Tune everything on record anew, some minutes of one core."""
    lines = ["# Written by `python -m course.sim_to_real`: gains, see course.sim_to_real.tune."]
    for kind, each in ROWS.items():
        lines.append(f"{kind} = [")
        for at in each:
            rows = [remake(kind, at, seed) for seed in (SEEDS if kind == "range" else (0,))]
            texts = ["[" + ", ".join(f"{g:.6g}" for g in row) + "]" for row in rows]
            lines.append("  [" + ", ".join(texts) + "],")
        lines.append("]")
    RECORD.write_text("\n".join(lines) + "\n", encoding="utf-8")
