"""What the gap is made of, what mending a part of it does, and a bound of what transfers.

A mended parameter is one that the simulator takes over from the real arm. Whether that helps
depends on what else is mended: errors cancel. So what counts is all subsets, and an attribution
that averages over them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from course.check import POSITIVE, finite, invalid, one_of, positive
from course.sim_to_real.plants import Plants, nominal

Array = NDArray[np.float64]
Subset = frozenset[str]

# The parameters that are found together, and the three kinds of them.
PARTS = {
    "load": ("mass", "payload"),
    "friction": ("viscous", "coulomb"),
    "motor": ("torque",),
    "encoder": ("bias", "noise"),
    "delay": ("delay",),
}
KINDS = {"dynamics": ("load", "friction", "motor"), "sensing": ("encoder",), "timing": ("delay",)}


def mended(actual: Plants, parts: Iterable[str]) -> Plants:
    """Return the simulator after some of its parts were taken from the real arm.

    Args:
        actual: the real arms.
        parts: names in `PARTS` or `KINDS`; none for the simulator as it was.
    """
    fields: set[str] = set()
    for name in parts:
        one_of("part", name, (*PARTS, *KINDS))
        for part in KINDS.get(name, (name,)):
            fields.update(PARTS[part])
    return replace(nominal(actual.size), **{name: getattr(actual, name) for name in fields})


def subsets(names: Iterable[str]) -> list[Subset]:
    """Return all subsets, the empty one first, then by size and in the order of the names."""
    known = list(names)
    return [frozenset(some) for n in range(len(known) + 1) for some in combinations(known, n)]


def attribution(value: Mapping[Subset, float]) -> dict[str, tuple[float, float, float]]:
    """Return what each change adds to a value.

    It may be made alone, in the average over all orders, or last.

    The average is Shapley's (A value for n-person games, 1953): the only split that adds up to the
    whole change and treats parts alike that do the same. Where alone and last have other signs, no
    single number says what a part does.

    Args:
        value: of every subset of the parts, such as the success on the real arm.

    Returns:
        part -> (alone, average, last), all as changes of the value.
    """
    whole = max(value, key=len)
    missing = [some for some in subsets(sorted(whole)) if some not in value]
    if missing:
        raise invalid("value", f"without {sorted(missing[0])}", "a number for each subset")
    n, empty = len(whole), frozenset[str]()
    result = {}
    for part in sorted(whole):
        average = 0.0
        for some in subsets(sorted(whole - {part})):
            # Shapley's weight: the share of orders in which exactly `some` come before this part.
            weight = math.factorial(len(some)) * math.factorial(n - len(some) - 1)
            average += weight / math.factorial(n) * (value[some | {part}] - value[some])
        alone, last = value[frozenset({part})] - value[empty], value[whole] - value[whole - {part}]
        result[part] = (alone, average, last)
    return result


def harmful_corrections(value: Mapping[Subset, float]) -> list[tuple[Subset, str, float]]:
    """Return every correction that lowers the value, worst first: (corrected before, now, change).

    Args:
        value: of every subset of the parts.
    """
    result = [
        (some, part, value[some | {part}] - value[some])
        for some in value
        for part in sorted(max(value, key=len) - some)
    ]
    return sorted((row for row in result if row[2] < 0.0), key=lambda row: row[2])


# --- a bound --------------------------------------------------------------------------------------


def transfer_bound(gamma: float, eps: float, reward: float = 1.0) -> float:
    """Return gamma eps R / (1 - gamma)^2, a bound on a policy's value difference in two processes.

    With rewards in [0, R] no value is above R / (1 - gamma), so an expectation over the next state
    differs by eps R / (1 - gamma) at most, at every step anew (the simulation lemma: Kearns and
    Singh, Near-optimal reinforcement learning in polynomial time, 2002).

    Args:
        gamma: discount, in [0, 1).
        eps: largest total variation distance of the next state's distributions, 0 to 1: half of
            the summed differences.
        reward: R, positive.
    """
    discount(gamma)
    return gamma * finite("eps", eps, 0.0, 1.0) * positive("reward", reward) / (1.0 - gamma) ** 2


def share_of_bound(gamma: float, eps: float) -> float:
    """Return the share of the bound that the worst chain of two states reaches.

    It pays in the first, where the simulator stays for ever and the real one leaves for good with
    probability eps.
    """
    discount(gamma)
    return (1.0 - gamma) / (1.0 - gamma * (1.0 - finite("eps", eps, POSITIVE, 1.0)))


def discount(gamma: float) -> float:
    """Return a discount in [0, 1); anything else raises ValueError."""
    if not 0.0 <= finite("gamma", gamma) < 1.0:
        raise invalid("gamma", gamma, "at least 0 and below 1")
    return gamma
