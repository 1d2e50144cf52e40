"""Which simulator for a job: needs in, a ranking with the rows that decide it out.

A table says of each engine what was measured or documented, row by row. A need is met by a fact, or
not; what the table doesn't say is unknown, and unknown meets nothing. The engines that meet all
needs are ranked by one row. Nothing is added up: there is no rating.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real

from course.check import invalid, one_of

SENSES = ("at most", "at least", "is")


@dataclass(frozen=True)
class Fact:
    """One entry of the table.

    Attributes:
        value: a number, or whether it is so; None is unknown.
        unit: of a number.
        source: "measured", or what documents it, with its year.
    """

    value: float | bool | None = None
    unit: str = ""
    source: str = "measured"

    @property
    def known(self) -> bool:
        """True if there is a value; NaN counts as unknown."""
        return self.value is not None and not math.isnan(self.value)


UNKNOWN = Fact(None, "", "not measured here")
Table = Mapping[str, Mapping[str, Fact]]  # engine -> row -> fact


@dataclass(frozen=True)
class Need:
    """What a job asks of a row: a tolerance ("at most", "at least"), or that it "is" so."""

    row: str
    limit: float | bool = True
    sense: str = "is"

    def __post_init__(self) -> None:
        one_of("sense", self.sense, SENSES)
        if self.sense == "is":
            right = isinstance(self.limit, bool)
        else:
            number = isinstance(self.limit, Real) and not isinstance(self.limit, bool)
            right = number and not math.isnan(self.limit)
        if not right:
            raise invalid("limit", self.limit, "true or false for 'is', else a number")

    def met(self, fact: Fact) -> bool:
        """Return whether a fact is known to meet it."""
        if not fact.known or isinstance(fact.value, bool) != (self.sense == "is"):
            return False
        assert fact.value is not None
        if self.sense == "is":
            return fact.value == self.limit
        return fact.value <= self.limit if self.sense == "at most" else fact.value >= self.limit


@dataclass(frozen=True)
class Candidate:
    """An engine judged: the needs that it fails, and those of which nothing is known."""

    engine: str
    failed: tuple[str, ...]
    unknown: tuple[str, ...]
    cost: float

    @property
    def meets(self) -> bool:
        """True if it is known to meet all needs and to have a place in the ranking."""
        return not self.failed and not self.unknown


@dataclass(frozen=True)
class Turn:
    """The pick becomes another one, or none, once the limit of a row is changed to this."""

    row: str
    limit: float
    pick: str | None
    factor: float
    side: str = "of"  # "below" or "above" where the pick still meets its own fact as a limit
    unit: str = ""

    def __str__(self) -> str:
        """Return the change in a sentence; its number, as printed, already changes the pick."""
        text = f"{self.limit:.3g}"
        # Rounded away from the pick: down for "below", up for "above".
        missing = self.limit - float(text)
        if (self.side == "below" and missing < 0.0) or (self.side == "above" and missing > 0.0):
            unit = 10.0 ** (math.floor(math.log10(abs(self.limit))) - 2)
            text = f"{float(text) + math.copysign(unit, missing):.3g}"
        amount = f"{text} {self.unit}".strip()
        pick = self.pick or "no engine"
        return f"With a limit {self.side} {amount} for {self.row}, {pick} would be picked"


@dataclass(frozen=True)
class Choice:
    """What `choose` says.

    Attributes:
        pick: the first of the ranking, None where no engine is known to meet all needs.
        ranking: the engines that meet all, cheapest first.
        out: the others, with what they fail.
        deciding: the rows by which the others are out, and the row of the ranking if it had to
            choose among several.
        turn: the tolerance whose smallest change, as a factor, changes the pick; None where none
            does.
    """

    pick: str | None
    ranking: tuple[Candidate, ...]
    out: tuple[Candidate, ...]
    deciding: tuple[str, ...]
    turn: Turn | None

    def __str__(self) -> str:
        pick = self.pick or "none is known to meet all needs"
        lines = [f"Pick: {pick}; decided by " + ", ".join(self.deciding)]
        for one in self.out:
            why = [*(f"fails {r}" for r in one.failed), *(f"{r} unknown" for r in one.unknown)]
            lines.append(f"  Out: {one.engine}, " + "; ".join(why))
        if self.turn:
            lines.append(f"  {self.turn}")
        return "\n".join(lines)


def choose(table: Table, needs: Sequence[Need], by: str) -> Choice:
    """Rank the engines of a table for a job.

    Args:
        table: what is known; a row that an engine lacks, and another has, is unknown of it. Write
            `UNKNOWN` for a row of which nothing is known of any engine.
        needs: at most one for each row and sense.
        by: the row to rank by, smallest first; an engine of which it is unknown is out.

    Raises:
        ValueError: for two needs of the same row and sense, and for a row that no engine has: that
            is a typing mistake.
    """
    keys = [(need.row, need.sense) for need in needs]
    for key in keys:
        if keys.count(key) > 1:
            raise invalid("needs", key, "each row and sense once")
    rows = list(dict.fromkeys(row for facts in table.values() for row in facts))
    for need in needs:
        one_of("row of a need", need.row, rows)
    one_of("by", by, rows)
    ranking, out = _ranked(table, needs, by)
    pick = ranking[0].engine if ranking else None
    decisive = [row for one in out for row in (*one.failed, *one.unknown)]
    decisive += [by] if len(ranking) > 1 else []
    return Choice(pick, ranking, out, tuple(dict.fromkeys(decisive)), _turn(table, needs, by, pick))


def _ranked(
    table: Table, needs: Sequence[Need], by: str
) -> tuple[tuple[Candidate, ...], tuple[Candidate, ...]]:
    judged = []
    for engine, rows in table.items():
        facts = [(need, rows.get(need.row, UNKNOWN)) for need in needs]
        failed = [need.row for need, fact in facts if fact.known and not need.met(fact)]
        unknown = [need.row for need, fact in facts if not fact.known]
        cost = rows.get(by, UNKNOWN)
        value = float(cost.value) if cost.known and cost.value is not None else math.inf
        unknown += [] if cost.known else [by]
        once = [tuple(dict.fromkeys(names)) for names in (failed, unknown)]
        judged.append(Candidate(engine, once[0], once[1], value))
    ranking = sorted((one for one in judged if one.meets), key=lambda one: one.cost)
    return tuple(ranking), tuple(one for one in judged if not one.meets)


def _turn(table: Table, needs: Sequence[Need], by: str, pick: str | None) -> Turn | None:
    """Try each tolerance at each value of its row: there, and only there, the pick can change."""
    best: Turn | None = None
    for i, need in enumerate(needs):
        if need.sense == "is":
            continue
        for rows in table.values():
            fact = rows.get(need.row, UNKNOWN)
            if not fact.known or isinstance(fact.value, bool):
                continue
            assert fact.value is not None
            # The exact value, and the nearest number beyond it: the pick can change on either side.
            beyond = "below" if need.sense == "at most" else "above"
            both = (("of", fact.value), (beyond, _beyond(fact.value, need.sense)))
            for side, value in both:
                tried = [*needs[:i], replace(need, limit=value), *needs[i + 1 :]]
                ranking, _ = _ranked(table, tried, by)
                other = ranking[0].engine if ranking else None
                factor = _factor(value, float(need.limit))
                if other != pick and (best is None or factor < best.factor):
                    best = Turn(need.row, value, other, factor, side, fact.unit)
    return best


def _beyond(value: float, sense: str) -> float:
    """Return the next number that this value doesn't meet."""
    return math.nextafter(value, -math.inf if sense == "at most" else math.inf)


def _factor(a: float, b: float) -> float:
    """Return by how many times two limits differ, from 1 on; infinite across zero."""
    if a == b:
        return 1.0
    return max(a / b, b / a) if a * b > 0.0 else math.inf
