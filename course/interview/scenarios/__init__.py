"""Debugging scenarios that run: one symptom, several causes, and probes that tell them apart.

A scenario is a program in `programs/NAME.py`, which the learner reads, and a table in `NAME.py`:
its causes, probes and repairs. The program reads a record of numbers (a machine), and a cause is
one wrong number in it, so that the listing is the same whichever was drawn.

    case = diagnose("explodes", seed=3)
    case.show(); case.probe("halve_step"); case.conclude("double_contact", "share_stiffness")

What a figure rules out is computed: the probe is run on other machines of every cause, and a cause
is out if the figure is further from its figures than the probe's noise.

Each case offers all causes but one, and `NONE`, which is right where the one that is not offered is
at work. So none of the answers is likelier than another, and a list that has been learned by heart
is no help.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import TypeVar

import numpy as np

from course import check

HERE = Path(__file__).parent
NAMES = ("explodes", "policy", "touch", "gap", "late", "sure")
NONE = "none_of_these"
NONE_WORDS = "The cause is not in this list: the probes rule out every cause listed here."
REFERENCE = tuple(range(2**30, 2**30 + 6))  # seeds of the other machines, which no case has


@dataclass(frozen=True)
class Cause:
    """What can be wrong: its name, a sentence, and the name of the repair that removes it."""

    name: str
    words: str
    repair: str


@dataclass(frozen=True)
class Probe:
    """Something to try: it returns one finite figure and costs minutes.

    Attributes:
        name, what: how it is called, and what is done.
        unit: of the figure; "" for a ratio or a count.
        minutes: what it costs to somebody who has to write it.
        run: (cause, seed) -> the figure; it takes as many steps whatever the cause.
        noise: how far the figure of a machine may lie outside those of others with the same cause.
    """

    name: str
    what: str
    unit: str
    minutes: int
    run: Callable[[str, int], float]
    noise: float


@dataclass(frozen=True)
class Repair:
    """What can be changed, and a sentence."""

    name: str
    words: str


Named = TypeVar("Named", Cause, Probe, Repair)


@dataclass(frozen=True)
class Scenario:
    """One symptom with several causes.

    Attributes:
        name: one of `NAMES`.
        title, prompt: the text for the learner, in Markdown.
        symptom_words, unit: what the figure of the symptom is.
        symptom: (cause, seed, repair or None) -> the figure.
        spread: how far the figures of the causes may lie apart, as a share of their mean.
        removed: figure -> whether the symptom is gone.
        causes, probes, repairs: at least eight, eight to fourteen, and one for each cause at least.
        popular: name of the repair that many try first.
        price: (cause, seed, repair) -> what the repair costs, in `price_words`.
        price_words: what the price is; 1 is what the machine without a fault costs.
        affordable: the highest price that is no new fault.
        path: how many probes tell all causes apart, in the order of the model answer.
        on_model: name of a probe -> its figure on the model, where there is one to compare with.
    """

    name: str
    title: str
    prompt: str
    symptom_words: str
    unit: str
    symptom: Callable[[str, int, str | None], float]
    spread: float
    removed: Callable[[float], bool]
    causes: tuple[Cause, ...]
    probes: tuple[Probe, ...]
    repairs: tuple[Repair, ...]
    popular: str
    price: Callable[[str, int, str], float]
    price_words: str
    affordable: float
    path: int
    on_model: Callable[[str], float] | None = None

    def cause(self, name: str) -> Cause:
        """Return the cause of that name; ValueError for another."""
        return _named("cause", name, self.causes)

    def a_probe(self, name: str) -> Probe:
        """Return the probe of that name; ValueError for another."""
        return _named("probe", name, self.probes)

    def repair(self, name: str) -> Repair:
        """Return the repair of that name; ValueError for another."""
        return _named("repair", name, self.repairs)

    def listing(self) -> str:
        """Return the program, as the learner reads it."""
        return (HERE / "programs" / f"{self.name}.py").read_text(encoding="utf-8")


def _named(what: str, name: str, members: tuple[Named, ...]) -> Named:
    check.one_of(what, name, [one.name for one in members])
    return next(one for one in members if one.name == name)


def scenario_names() -> tuple[str, ...]:
    """Return the names of the scenarios that are written."""
    return tuple(name for name in NAMES if (HERE / f"{name}.py").exists())


@cache
def scenario(name: str) -> Scenario:
    """Return the scenario of that name; ValueError for another."""
    check.one_of("name", name, scenario_names())
    result: Scenario = import_module(f"{__name__}.{name}").SCENARIO
    return result


# --- What figures say ---------------------------------------------------------------------------


@cache
def figure(name: str, probe: str, cause: str, seed: int) -> float:
    """Return the figure of a probe on one machine, kept."""
    return float(scenario(name).a_probe(probe).run(cause, seed))


@cache
def symptom(name: str, repair: str | None, cause: str, seed: int) -> float:
    """Return the symptom of one machine, repaired or not, kept."""
    return float(scenario(name).symptom(cause, seed, repair))


@cache
def price(name: str, repair: str, cause: str, seed: int) -> float:
    """Return what a repair of one machine costs, kept."""
    return float(scenario(name).price(cause, seed, repair))


@cache
def expected(name: str, probe: str, cause: str) -> tuple[float, float]:
    """Return the lowest and highest figure that a cause explains.

    They come from the figures of `REFERENCE` and the noise.
    """
    noise = scenario(name).a_probe(probe).noise
    figures = [figure(name, probe, cause, seed) for seed in REFERENCE]
    return min(figures) - noise, max(figures) + noise


def ruled_out(name: str, probe: str, value: float) -> tuple[str, ...]:
    """Return the causes that do not explain the figure of a probe."""
    ranges = {one.name: expected(name, probe, one.name) for one in scenario(name).causes}
    return tuple(cause for cause, (low, high) in ranges.items() if not low <= value <= high)


def tells_apart(name: str, probe: str, one: str, other: str) -> bool:
    """Return whether no figure of a probe is explained by both causes."""
    (low, high), (lower, higher) = (expected(name, probe, cause) for cause in (one, other))
    return high < lower or higher < low


def nominal(name: str, probe: str) -> float | None:
    """Return the figure of a probe on the model, None where the scenario has no model."""
    one = scenario(name)
    return None if one.on_model is None else float(one.on_model(probe))


@cache
def model_path(name: str) -> tuple[str, ...]:
    """Return the probes that tell all causes apart, in the order of the model answer.

    The model answer stops as soon as one cause is left. Greedy: next comes the probe that tells the
    most pairs of causes apart for its minutes. A pair counts half for every probe before that told
    it apart: one figure is no proof, and a second witness is worth something.
    """
    one = scenario(name)
    pairs = list(combinations([cause.name for cause in one.causes], 2))
    apart = {p.name: [tells_apart(name, p.name, *pair) for pair in pairs] for p in one.probes}
    observed = np.zeros(len(pairs))
    path: list[str] = []
    for _ in range(one.path):
        remaining = [p for p in one.probes if p.name not in path]
        best = max(remaining, key=lambda p: float(0.5**observed @ apart[p.name]) / p.minutes)
        path.append(best.name)
        observed += apart[best.name]
    return tuple(path)


@dataclass(frozen=True)
class Finding:
    """One probe that was run.

    Attributes:
        probe, figure, unit: what came out.
        minutes, spent: what it cost, and all that was spent so far.
        model: the same figure on the model, None where there is none.
    """

    probe: str
    figure: float
    unit: str
    minutes: int
    spent: int
    model: float | None = None

    @property
    def result(self) -> str:
        """The figure with its unit, beside that of the model."""
        beside = "" if self.model is None else f", on the model: {_number(self.model, self.unit)}"
        return f"{_number(self.figure, self.unit)}{beside}"

    def __str__(self) -> str:
        return f"{self.probe}: {self.result} ({self.spent} min spent)"

    def _repr_markdown_(self) -> str:
        return f"**{self.probe}**: {self.result} *({self.spent} min spent)*"


@dataclass(frozen=True)
class Range:
    """The figures of a probe that a cause explains, from `low` to `high`."""

    cause: str
    low: float
    high: float

    def explains(self, value: float) -> bool:
        """Return whether a figure lies in the range."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Row:
    """A line of evidence.

    Attributes:
        probe, figure, unit: what came out.
        ruled_out, remaining: the causes that the figure rules out, and those that are left.
        ranges: what the probe would have shown under each cause.
    """

    probe: str
    figure: float
    unit: str
    ruled_out: tuple[str, ...]
    remaining: tuple[str, ...]
    ranges: tuple[Range, ...] = ()


def evidence(
    name: str, findings: list[Finding], causes: tuple[Cause, ...] | None = None
) -> tuple[Row, ...]:
    """Return what findings say one after the other, of some causes or of all."""
    names = [one.name for one in (scenario(name).causes if causes is None else causes)]
    remaining = tuple(names)
    rows = []
    for one in findings:
        ranges = tuple(Range(cause, *expected(name, one.probe, cause)) for cause in names)
        out = tuple(r.cause for r in ranges if not r.explains(one.figure))
        remaining = tuple(cause for cause in remaining if cause not in out)
        rows.append(Row(one.probe, one.figure, one.unit, out, remaining, ranges))
    return tuple(rows)


# --- A case -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """One draw. It holds no cause: that is drawn anew from name and seed where a probe is run."""

    name: str
    seed: int


def drawn(name: str, seed: int) -> Case:
    """Return the case of a seed; ValueError for an unknown name or a seed below 0."""
    return Case(scenario(name).name, check.count("seed", seed))


def _run_for_all(case: Case, probe: str) -> float:
    """Run a probe for every cause, whichever is at work, so that its time gives nothing away."""
    return sum(figure(case.name, probe, one.name, case.seed) for one in scenario(case.name).causes)


def _sealed(case: Case, act: Callable[[str, int], float]) -> float:
    """Return what `act` returns for the sampled cause.

    An error in it is reported without its lines.
    """
    stopped: type[BaseException] | None = None
    try:
        return float(act(_cause(case), case.seed))
    except (Exception, KeyboardInterrupt) as error:
        stopped = type(error)
    if stopped is KeyboardInterrupt:
        raise KeyboardInterrupt
    raise RuntimeError(f"{case}: the program ended with {stopped.__name__}")


def _drawn_causes(case: Case) -> tuple[str, str]:
    """Return the cause that is at work and the one that is not offered; they may be the same."""
    causes = scenario(case.name).causes
    draw = np.random.default_rng([zlib.crc32(case.name.encode()), case.seed])
    first, other = (causes[int(draw.integers(len(causes)))].name for _ in range(2))
    return first, other


def _cause(case: Case) -> str:
    return _drawn_causes(case)[0]


def offered(case: Case) -> tuple[Cause, ...]:
    """Return the causes that can be named, besides `NONE`."""
    missing = _drawn_causes(case)[1]
    return tuple(one for one in scenario(case.name).causes if one.name != missing)


@dataclass(frozen=True)
class Tried:
    """A repair that was made: the symptom after it, whether it is gone, and the price."""

    repair: str
    symptom: float
    removed: bool
    price: float
    affordable: bool


@dataclass(frozen=True)
class Verdict:
    """The answer to a diagnosis; the cause is told here and nowhere before.

    Attributes:
        case, diagnosis: the draw, and the cause that was named, or `NONE`.
        cause: the one that was drawn.
        before: the figure of the symptom.
        tried, popular: the repair that was named, and the one that many try first.
        rows, minutes: the evidence of the probes that were run, and what they cost.
        model, model_minutes: the same of the model answer, which stops when one cause is left.
        answer: what had to be named: the cause, or `NONE` where it was not offered.
    """

    case: Case
    diagnosis: str
    cause: str
    before: float
    tried: Tried
    popular: Tried
    rows: tuple[Row, ...]
    minutes: int
    model: tuple[Row, ...]
    model_minutes: int
    answer: str

    @property
    def right(self) -> bool:
        """True if the cause was named, or `NONE` where it was not offered."""
        return self.diagnosis == self.answer

    @property
    def supported(self) -> bool:
        """True if the answer was right and the probes left no other."""
        expected = () if self.answer == NONE else (self.answer,)
        return self.right and bool(self.rows) and self.rows[-1].remaining == expected

    @property
    def cured(self) -> bool:
        """True if the repair removes the symptom at an acceptable price."""
        return self.tried.removed and self.tried.affordable

    @property
    def points(self) -> int:
        """Points out of three: for the cause, its evidence, and the repair."""
        return self.right + self.supported + self.cured

    def sentences(self) -> tuple[str, ...]:
        """Return the verdict in words."""
        one = scenario(self.case.name)
        named = "Correct" if self.right else f"{self.diagnosis} is wrong"
        what = f"{self.cause}, which was not in the list" if self.answer == NONE else self.cause
        message = [f"{named}. The cause is {what}. {one.cause(self.cause).words}"]
        if not self.right:
            against = [row.probe for row in self.rows if self.diagnosis in row.ruled_out]
            if against:
                message.append(f"Your own probes had ruled it out: {', '.join(against)}.")
        names = tuple(cause.name for cause in offered(self.case))
        remaining = self.rows[-1].remaining if self.rows else names
        causes = "this cause remains" if len(remaining) == 1 else "these causes remain"
        message.append(
            f"After {in_minutes(self.minutes)} of probes, {causes} possible: "
            f"{', '.join(remaining) or NONE}."
        )
        message.append(self._of(self.tried, "Your repair,"))
        if self.popular.repair != self.tried.repair:
            message.append(self._of(self.popular, "The repair that many try first,"))
        repair = one.repair(one.cause(self.cause).repair)
        if repair.name != self.tried.repair:
            message.append(f"The repair of {self.cause} is {repair.name}. {repair.words}")
        message.append(
            f"You get {self.points} of 3 points: one each for the cause, the evidence "
            "and the repair."
        )
        return tuple(message)

    def _of(self, tried: Tried, lead: str) -> str:
        one = scenario(self.case.name)
        outcome = "the symptom is gone" if tried.removed else "the symptom remains"
        limit = "" if tried.affordable else ", which is too high"
        return (
            f"{lead} {tried.repair}: {one.symptom_words} {self.before:.4g} before and "
            f"{_number(tried.symptom, one.unit)} after, so {outcome}. The price "
            f"({one.price_words}) is {tried.price:.3g}{limit}."
        )

    def __str__(self) -> str:
        return "\n".join(self.sentences())

    def _repr_markdown_(self) -> str:
        model = f"**The model answer** ({self.model_minutes} min)\n\n{table(self.model)}"
        return "\n\n".join((*self.sentences(), table(self.rows), model))


def table(rows: tuple[Row, ...]) -> str:
    """Return evidence as a table in Markdown: the range of each cause, in bold where it fits."""
    lines = [
        "| probe | result | range expected for each cause | still possible |",
        "|---|---:|---|---|",
    ]
    for row in rows:
        ranges = [
            f"{'**' * r.explains(row.figure)}{r.cause} {span(r)}{'**' * r.explains(row.figure)}"
            for r in row.ranges
        ]
        remaining = ", ".join(row.remaining) or "none"
        lines.append(
            f"| {row.probe} | {_number(row.figure, row.unit)} | {'<br>'.join(ranges)} "
            f"| {remaining} |"
        )
    return "\n".join(lines)


def in_minutes(count: int) -> str:
    """Return a number of minutes in words, such as "1 minute"."""
    return f"{count} minute{'s' * (count != 1)}"


def span(one: Range) -> str:
    """Return a range in words, with three digits."""
    return f"{_plain(one.low, 3)} to {_plain(one.high, 3)}"


def _plain(value: float, digits: int = 4) -> str:
    return f"{0.0 if abs(value) < 1e-12 else value:.{digits}g}"


def _number(value: float, unit: str) -> str:
    return f"{_plain(value)} {unit}".rstrip()


@dataclass
class Diagnosis:
    """A session with one case: the probes that were run, in order."""

    case: Case
    findings: list[Finding] = field(default_factory=list)

    @property
    def minutes(self) -> int:
        """What the probes cost so far."""
        return sum(finding.minutes for finding in self.findings)

    def probe(self, name: str) -> Finding:
        """Run a probe; the same once more gives the same figure and costs again.

        Raises:
            ValueError: for a name that is no probe of the scenario.
        """
        one = scenario(self.case.name).a_probe(name)
        _sealed(self.case, lambda c, s: _run_for_all(self.case, name))
        value = _sealed(self.case, lambda c, s: figure(self.case.name, name, c, s))
        model = nominal(self.case.name, name)
        self.findings.append(
            Finding(name, value, one.unit, one.minutes, self.minutes + one.minutes, model)
        )
        return self.findings[-1]

    def conclude(self, cause: str, repair: str) -> Verdict:
        """Name the cause and the repair, and get the answer with its evidence.

        Raises:
            ValueError: for a name that is no cause or repair of the scenario.
        """
        one = scenario(self.case.name)
        names = [each.name for each in offered(self.case)]
        check.one_of("cause", cause, [*names, NONE])
        one.repair(repair)
        drawn_cause = _cause(self.case)
        model = Diagnosis(self.case)
        for name in model_path(one.name):
            model.probe(name)
            if len(evidence(one.name, model.findings)[-1].remaining) <= 1:
                break
        causes = offered(self.case)
        return Verdict(
            self.case,
            cause,
            drawn_cause,
            _sealed(self.case, lambda c, s: symptom(one.name, None, c, s)),
            self._tried(repair),
            self._tried(one.popular),
            evidence(one.name, self.findings, causes),
            self.minutes,
            evidence(one.name, model.findings, causes),
            model.minutes,
            drawn_cause if drawn_cause in names else NONE,
        )

    def _tried(self, repair: str) -> Tried:
        one = scenario(self.case.name)
        after = _sealed(self.case, lambda c, s: symptom(one.name, repair, c, s))
        dear = _sealed(self.case, lambda c, s: price(one.name, repair, c, s))
        return Tried(repair, after, one.removed(after), dear, dear <= one.affordable)

    def show(self) -> Page:
        """Return the question, the program, and what can be tried and named."""
        one = scenario(self.case.name)
        probes = "\n".join(f"| {p.name} | {p.what} | {p.minutes} |" for p in one.probes)
        named = [
            "\n".join(f"* `{entry.name}`: {entry.words}" for entry in entries)
            for entries in (offered(self.case), one.repairs)
        ]
        named[0] += f"\n* `{NONE}`: {NONE_WORDS}"
        return Page(
            f"**{one.title}**\n\n{one.prompt}\n\n<details><summary>The program</summary>\n\n"
            f"```python\n{one.listing()}```\n\n</details>\n\n"
            "| probe | what it measures | minutes |\n"
            f"|---|---|---:|\n{probes}\n\n<details><summary>Possible causes and "
            f"repairs</summary>\n\n{named[0]}\n\nRepairs\n\n{named[1]}\n\n</details>\n"
        )


class Page(str):
    """A text in Markdown that a notebook shows as one."""

    def _repr_markdown_(self) -> str:
        return str(self)


def diagnose(name: str, seed: int = 0) -> Diagnosis:
    """Begin to debug a scenario.

    Raises:
        ValueError: for an unknown name or a seed below 0.
    """
    return Diagnosis(drawn(name, seed))
