"""Every checkable claim of the course, as a check that runs.

A claim is a statement that is often made, what is true instead, and a function that settles it by
algebra or by measurement. `python -m course.derivations` settles all of them and prints them.

    from course import derivations
    derivations.figure("semi_implicit_limit", "limit_ms")    # a number for the text
    derivations.show("semi_implicit_limit")                  # a card for a notebook
    derivations.more_claims("verlet_frequency", "rk4_energy_factor")  # a fold-out of further ones
    derivations.answer("semi_implicit_limit", "2/omega")     # checks a learner's formula

How one is written (`course/derivations/rigid_body/time_step.py` holds examples):

    SYMBOLS = {"m": Symbol("mass [kg]"), "k": Symbol("stiffness [N/m]")}   # one table a file

    @claim(
        "The claim as it is commonly made.",
        "What is true, with numbers from the figures: {limit_ms:.2f} ms, {formula}.",
        ask=("The question?", "dt < 2*sqrt(m/k)", {"2*m/k": "The root is missing.", ...}),
        source="Author, Title, year, section",
        needs=("Drake",),                                # only what `make setup` does not install
    )
    def claim_id(result):
        stiffness = result.input("stiffness_n_per_m", 1e5)  # goes in; the texts may quote it
        result.measure("limit_ms", 1000 * limit(stiffness), tolerance=1e-6)  # came out
        result.statement = "What was computed or measured, in one or two sentences."
        result.formula = derived  # SymPy; only where there is an ask
        result.statement_holds(stable(dt))  # HOLDS or FALSE; or, with a condition:
        result.statement_holds(
            False_or_true,
            only_if="omega dt < 2, here {limit_ms:.2f} ms",
            inside=[stable(x) for x in draws_inside],
            outside=[...],
        )
        result.correction_holds(fact, another)  # bools that settle the correction

- The id is the function's name, the chapter the file's topic, the verdict follows.
- `ask` is (question, "left names < expression", {wrong expression: what that is}). "dt < ..." (h is
  understood for dt), "phi, angle = ..." or only the expression. Symbols are the names in it that
  `SYMBOLS` knows. `Ask(...)` takes `also`, `tolerance` and `symbols` besides.
- `measure(name, value, tolerance)`: relative, absolute where the value on record is 0. Both `input`
  and `measure` return the value.
- A condition is tried at 8 or more random draws inside it (all must hold) and just outside (some
  must fail); `cases=True` where it names cases instead of a range. `result.rng` draws the same at
  every run.
- Refused as constant: a fact, verdict, draw or figure that cannot be traced in the check's source
  to a call that computes; a literal True or False in one; x == x. `result` is not handed on.
- Refused as typed, in the corrected sentence and in the condition: a number with a decimal point,
  a power of ten, a percentage, a unit, or two digits. Write `{name:.3g}`. Whole numbers of one
  digit, and those beside * / ^ or a bracket, belong to words and formulas. `{formula}` is the
  right side of the ask. Literal braces are doubled.
- What came out is on record, in `record/<file>.toml`. A run that contradicts it fails. After a
  change, `python -m course.derivations rigid_body.flight --record` (or a chapter, a topic,
  `--id ID`) prints the differences and writes them; it writes nothing for a claim that fails by
  itself.

Checks import what they need (SymPy, MuJoCo, the chapters) when they run: importing this package
costs nothing.

Examples:
    >>> from course import derivations
    >>> claim = derivations.claims()[0]
    >>> claim.id, claim.chapter
    ('chain_age', 0)
"""

import ast
import difflib
import functools
import importlib
import inspect
import os
import pkgutil
import re
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from course import CHAPTERS
from course.derivations import honest, markup, records
from course.derivations.answer import Answer, Formula, Symbol, answer_formula, equivalent, parse
from course.derivations.result import Result, Verdict

__all__ = [
    "ANSWERS",
    "CLAIMS",
    "Answer",
    "Ask",
    "Block",
    "Claim",
    "Formula",
    "Outcome",
    "Result",
    "Symbol",
    "Verdict",
    "answer",
    "claim",
    "claims",
    "figure",
    "formula",
    "more_claims",
    "recorded",
    "run",
    "settle",
    "show",
    "unmet",
]


def _engine_missing(name: str) -> str:
    from course.oracles.engines import engines

    return engines()[name].missing()


def _compiler_missing() -> str:
    from course.middleware import controller

    return "" if controller.compiler() else controller.NO_COMPILER


# What some checks need and a machine may lack: how it is installed, and a function that returns why
# it cannot be used here, or "".
NEEDS: dict[str, tuple[str, Callable[[], str]]] = {
    "Drake": ("make platforms", functools.partial(_engine_missing, "Drake")),
    "PyBullet": ("make platforms", functools.partial(_engine_missing, "PyBullet")),
    "a C++ compiler": ("apt-get install g++", _compiler_missing),
}


@dataclass(frozen=True)
class Ask:
    """A question to which a formula is the answer.

    Attributes:
        question: in words.
        expression: the right answer, in the syntax of learners, with what may stand on its left:
            "dt < 2*sqrt(m/k)", "phi, angle = omega*h", or without a left side.
        slips: plausible wrong expression -> what that is; at least three.
        also: further names a learner may use -> their meaning as an expression in the symbols.
        tolerance: relative; 0 asks for the exact form, more admits a rounded number.
        symbols: symbols that mean something else here than in the file's table.
    """

    question: str
    expression: str
    slips: Mapping[str, str]
    also: Mapping[str, str] = field(default_factory=dict)
    tolerance: float = 0.0
    symbols: Mapping[str, Symbol] = field(default_factory=dict)

    def formula(self, table: Mapping[str, Symbol]) -> Formula:
        """Return what `answer_formula` works with.

        Args:
            table: the file's symbols by name; those that occur here are the formula's.

        Raises:
            ValueError: if the expression does not read as a formula in these symbols.
        """
        parts = re.fullmatch(r"\s*([\w\s,]*?)\s*([<>=])(.*)", self.expression)
        left = tuple(re.findall(r"\w+", parts[1])) if parts else ()
        if "dt" in left and "h" not in left:
            left = ("h", *left)
        right = parts[3].strip() if parts else self.expression
        named = set(re.findall(r"[A-Za-z]\w*", " ".join([right, *self.slips, *self.also.values()])))
        symbols = {
            name: symbol
            for name, symbol in {**table, **self.symbols}.items()
            if name in named and name not in self.also
        }
        relation = parts[2] if parts else "="
        try:
            parse(right, frozenset(symbols))
        except ValueError as problem:
            raise ValueError(
                f"expression must be a formula, got {self.expression!r}: {problem}"
            ) from None
        return Formula(
            self.question, right, symbols, self.also, left, relation, self.tolerance, self.slips
        )


@dataclass(frozen=True)
class Claim:
    """One statement of the course, and the function that settles it.

    Attributes:
        id: short name in snake_case, unique in the course.
        file: the file it stands in, such as "rigid_body.flight".
        chapter: number of the chapter; 0 in a registry of one's own.
        claim: the statement as it is commonly made.
        corrected: what is true, with fields for the figures. A claim that holds is repeated there
            more precisely.
        source: where that can be read up, or "".
        check: settles the claim by filling what it is handed.
        formula: the formula that a learner can be asked for, or None.
        needs: what the check needs beyond what `make setup` installs; names in `NEEDS`.
    """

    id: str
    file: str
    chapter: int
    claim: str
    corrected: str
    source: str
    check: Callable[[Result], None] = field(repr=False)
    formula: Formula | None = None
    needs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.id.isidentifier() or self.id != self.id.lower():
            raise ValueError(f"id is {self.id!r}; it must be a name in snake_case")
        if not self.claim or not self.corrected:
            raise ValueError(f"{self.id}: claim and corrected must both have text")
        if unknown := sorted(set(self.needs) - set(NEEDS)):
            raise ValueError(f"needs must be among {', '.join(NEEDS)}, got {unknown[0]!r}")

    @property
    def topic(self) -> str:
        """The name of its chapter's topic, such as "rigid_body"."""
        return self.file.partition(".")[0]

    def entry(self, result: Result) -> dict[str, Any]:
        """Return what goes on record."""
        return {
            "verdict": result.verdict.value,
            "condition": result.condition,
            "formula": self.formula.expression if self.formula else "",
            "texts": self.fingerprint,
            "inputs": dict(result.inputs),
            "figures": {
                name: [value, result.tolerances[name]] for name, value in result.figures.items()
            },
        }

    @property
    def fingerprint(self) -> str:
        """The hash of the texts that a record belongs to."""
        formula = self.formula.expression if self.formula else ""
        return records.fingerprint(self.claim, self.corrected, formula, self.source)

    def filled(
        self, template: str, result: Result, figures: Mapping[str, float | str] | None = None
    ) -> str:
        """Return a text with what was found in place of its fields, or with these figures of it.

        Raises:
            KeyError: for a field that is neither a figure nor an input.
        """
        formula = {"formula": self.formula.expression} if self.formula else {}
        shown = result.figures if figures is None else figures
        return template.format(**result.inputs, **shown, **formula)


@dataclass(frozen=True)
class Outcome:
    """A claim, what its check found now, and what is wrong.

    Attributes:
        claim: the claim.
        finding: what the check found.
        faults: what is wrong whatever is on record, one sentence each; empty if all is well.
        changes: where the finding and the record disagree, one sentence each.
        shown: the figures as texts and cards print them, see `settle`; default: those found.
    """

    claim: Claim
    finding: Result
    faults: tuple[str, ...]
    changes: tuple[str, ...]
    shown: Mapping[str, float | str] = field(default_factory=dict)

    @property
    def figures(self) -> dict[str, float | str]:
        """The figures as texts and cards print them."""
        return {**self.finding.figures, **self.shown}

    @property
    def disagreements(self) -> tuple[str, ...]:
        """All that is wrong."""
        return self.faults + self.changes

    @property
    def agrees(self) -> bool:
        """True if the check holds and agrees with the record."""
        return not self.disagreements

    @property
    def corrected(self) -> str:
        """The corrected statement with its numbers."""
        return self._text(self.claim.corrected)

    @property
    def condition(self) -> str:
        """The condition with its numbers, or ""."""
        return self._text(self.finding.condition)

    def _text(self, template: str) -> str:
        try:
            return self.claim.filled(template, self.finding, self.figures)
        except (LookupError, ValueError):
            return template  # among the faults


# Filled by `claim`; read it through `claims`, which loads the files first.
CLAIMS: dict[str, Claim] = {}
Check = Callable[[Result], None]
_FIGURES = 3  # on a card
_NUMBERS = {chapter.topic: chapter.number for chapter in CHAPTERS}


def _one_line(text: str) -> str:
    return " ".join(text.split())


def claim(
    received: str,
    corrected: str,
    *,
    ask: Ask | tuple[str, str, Mapping[str, str]] | None = None,
    source: str = "",
    needs: tuple[str, ...] = (),
    registry: dict[str, Claim] | None = None,
) -> Callable[[Check], Check]:
    """Return the decorator that registers a check as a claim; see the top of this file.

    Args:
        received: the claim as it is commonly stated.
        corrected: what is true, with fields for the figures.
        ask: the formula that a learner can be asked for.
        source: where it can be read up.
        needs: what the check needs beyond what `make setup` installs; names in `NEEDS`.
        registry: where to put it; default: the claims of the course.

    Returns:
        A decorator that leaves the function as it is.

    Raises:
        ValueError: for an id that is taken, an ask that cannot be read, a need that is unknown, or
            a file of no chapter.
    """
    target = CLAIMS if registry is None else registry

    def register(check: Check) -> Check:
        id, file = check.__name__, check.__module__.removeprefix(f"{__name__}.")
        chapter = _NUMBERS.get(file.split(".")[0], 0 if registry is not None else -1)
        if chapter < 0:
            raise ValueError(f"{id} stands in {file}, which is no chapter's")
        try:
            requested = Ask(*ask) if isinstance(ask, tuple) else ask
            formula = requested.formula(check.__globals__.get("SYMBOLS", {})) if requested else None
        except ValueError as problem:
            raise ValueError(f"{id}: {problem}") from None
        if id in target:
            raise ValueError(f"id is {id!r}, which is taken; ids must be unique")
        target[id] = Claim(
            id,
            file,
            chapter,
            _one_line(received),
            _one_line(corrected),
            _one_line(source),
            check,
            formula,
            needs,
        )
        return check

    return register


@functools.cache
def _load() -> None:
    """Import every file of claims: `<topic>.py` or `<topic>/*.py`, in the order of the chapters."""
    folder = Path(__file__).parent
    for chapter in CHAPTERS:
        if (folder / f"{chapter.topic}.py").exists():
            importlib.import_module(f"{__name__}.{chapter.topic}")
        elif (folder / chapter.topic).is_dir():
            package = importlib.import_module(f"{__name__}.{chapter.topic}")
            for module in sorted(m.name for m in pkgutil.iter_modules(package.__path__)):
                importlib.import_module(f"{package.__name__}.{module}")


def claims(chapter: int | None = None) -> list[Claim]:
    """Return all claims, or those of one chapter, by file and in the order of writing.

    Args:
        chapter: number of a chapter, or None for all.

    Raises:
        ValueError: for a chapter that has no claims.
    """
    _load()
    # The sort is stable, and a file that was imported on its own came first.
    ordered = sorted(CLAIMS.values(), key=lambda item: (item.chapter, item.file))
    if chapter is None:
        return ordered
    known = sorted({item.chapter for item in ordered})
    if chapter not in known:
        raise ValueError(f"chapter is {chapter!r}; chapters with claims are {known}")
    return [item for item in ordered if item.chapter == chapter]


def defining(ids: Sequence[str]) -> list[Claim]:
    """Return the claims of the files that define one of these ids; only those are imported."""
    folder = Path(__file__).parent
    topics = {chapter.topic for chapter in CHAPTERS}
    for path in sorted(folder.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if path.parent != folder or path.stem in topics:
            if any(f"\ndef {id}(" in text for id in ids):
                name = ".".join(path.relative_to(folder).with_suffix("").parts)
                importlib.import_module(f"{__name__}.{name}")
    return sorted(CLAIMS.values(), key=lambda item: (item.chapter, item.file))


def _get(id: str) -> Claim:
    if id not in CLAIMS:
        _load()
    if id not in CLAIMS:
        near = difflib.get_close_matches(str(id), CLAIMS, 3)
        intended = f"; did you mean {' or '.join(near)}?" if near else ""
        raise ValueError(
            f"id is {id!r}{intended or '; there is no such claim'} "
            "(`python -m course.derivations` lists the ids there are)"
        )
    return CLAIMS[id]


def _faults(item: Claim, result: Result) -> list[str]:
    """Return the faults of a claim, whatever its record says."""
    wrong = [*honest.constants(item.check), *result.problems()]
    for what, text in (("corrected statement", item.corrected), ("condition", result.condition)):
        for number in honest.typed_numbers(text):
            wrong.append(f"{number!r} in the {what} is typed; fill it from a figure")
        try:
            item.filled(text, result)
        except (LookupError, ValueError) as problem:
            wrong.append(f"the {what} cannot be filled: {problem!r}")
    if (item.formula is None) != (result.formula is None):
        wrong.append("the ask and the check must both have a formula, or neither")
    elif item.formula is not None and not equivalent(item.formula, result.formula):
        wrong.append(f"derived {result.formula}, asked for is {item.formula.expression}")
    return wrong


def settle(claim: Claim, record: Mapping[str, Any] | None = None) -> Outcome:
    """Run the check of a claim and compare what it found with the record.

    A figure that agrees with the record within its tolerance is shown with the digits on record.
    Its last digits differ from CPU to CPU, and a page must not. One that disagrees is shown as
    found, and named among the changes.

    Args:
        claim: the claim.
        record: its entry on record; default: the one in the file.

    Returns:
        The outcome, with one sentence for each thing that is wrong.
    """
    result = Result(claim.id)
    recorded = records.load(claim.file).get(claim.id) if record is None else record
    claim.check(result)
    entry = claim.entry(result)
    changes = records.differences(recorded, entry)
    shown = {name: value for name, (value, _) in records.merged(recorded, entry)["figures"].items()}
    return Outcome(claim, result, tuple(_faults(claim, result)), tuple(changes), shown)


@functools.cache
def run(id: str) -> Outcome:
    """Settle the claim with this id; computed once per process.

    Args:
        id: id of a claim.

    Raises:
        ValueError: for an unknown id.
    """
    return settle(_get(id))


def figure(id: str, name: str) -> float | str:
    """Return a figure of a claim, computed by its check, or on record where the claim has `needs`.

    Args:
        id: id of a claim.
        name: name of the figure.

    Returns:
        The number, or the text.

    Raises:
        ValueError: for an unknown id or name.
    """
    item = _get(id)
    figures = (_on_record(item, "") if item.needs else _settled(item)).figures
    if name not in figures:
        raise ValueError(f"name is {name!r}; figures of {id} are {', '.join(figures)}")
    return figures[name]


def figure_text(value: float | str) -> str:
    """Return a figure as it is printed: text as it is, numbers with five digits."""
    return value if isinstance(value, str) else f"{value:.5g}"


# What a card offers as answers, and the verdict that each stands for.
ANSWERS = {
    "True": Verdict.HOLDS,
    "False": Verdict.FALSE,
    "Only under a condition": Verdict.CONDITIONAL,
}


@dataclass(frozen=True)
class Block:
    """A claim as a card of a notebook.

    It asks whether the claim is true, false, or true only under a condition, and folds the verdict.
    """

    outcome: Outcome

    @property
    def verdict(self) -> str:
        """The verdict in a sentence."""
        verdict, condition = self.outcome.finding.verdict, self.outcome.condition
        if verdict is Verdict.CONDITIONAL:
            return f"It is true only if {condition}."
        return "It is true." if verdict is Verdict.HOLDS else "It is false."

    def _figures(self) -> list[str]:
        shown = [f"{k} = {figure_text(v)}" for k, v in self.outcome.figures.items()]
        return shown[:_FIGURES]

    def _disagreements(self) -> list[str]:
        return [f"DISAGREES: {text}" for text in self.outcome.disagreements]

    def __repr__(self) -> str:
        result = self.outcome.finding.verdict.value
        lines = [
            f'Common claim: "{self.outcome.claim.claim}" True, false, or only under a condition?',
            f"Verdict: {result} {self.outcome.condition}".rstrip(),
            *self._figures(),
            *self._disagreements(),
        ]
        return "\n".join(textwrap.fill(line, markup.WIDTH) for line in lines)

    def _why(self) -> str:
        """Return the verdict, the correction and how it was settled, as Markdown."""
        outcome = self.outcome
        topic = outcome.claim.topic
        verdict, corrected = (markup.tex(x, topic) for x in (self.verdict, outcome.corrected))
        settled = [
            markup.tex(outcome.finding.statement, topic),
            *(f"`{x}`" for x in self._figures()),
        ]
        if outcome.claim.source:
            settled.append(f"*{outcome.claim.source}*")
        how = markup.folded("How it was settled", "  \n".join(filter(None, settled)))
        return f"**{verdict}** {corrected}\n\n{how}"

    def _card(self, answers: Sequence[markup.Answer], head: str = "", after: str = "") -> str:
        claim = self.outcome.claim
        topic = claim.topic
        question = f"“{markup.tex(claim.claim, topic)}”{after}"
        made = markup.card(
            f"{topic}.{claim.id}", head, question, answers, self._why(), f"claim-{claim.id}"
        )
        return "\n\n".join([made, *self._disagreements()])

    def compact(self) -> str:
        """Return the card without answers to choose from, for a fold-out; Markdown."""
        return self._card(())

    def _repr_markdown_(self) -> str:
        verdict = self.outcome.finding.verdict
        answers = [
            markup.Answer(
                label, meaning is verdict, "**Right.**" if meaning is verdict else "**No.**"
            )
            for label, meaning in ANSWERS.items()
        ]
        return self._card(answers, "Common claim:")


def more_claims(*ids: str) -> markup.Shown:
    """Return a fold-out with further claims about a section, as compact cards.

    Verdicts and figures are those on record, so that a page with many claims opens at once; the
    tests compare every check with the record.

    Args:
        *ids: of the claims, in the order of reading.

    Raises:
        ValueError: for no id, an unknown one, or one that comes twice.
    """
    if not ids or len(set(ids)) < len(ids):
        raise ValueError(f"ids must be one or more, each once, got {ids}")
    blocks = [Block(_on_record(item, _recorded_statement(item))) for item in map(_get, ids)]
    cards = "\n\n".join(block.compact() for block in blocks)
    summary = "<summary>More claims about this</summary>"
    made = f'<details class="more-claims">{summary}\n\n{cards}\n\n</details>'
    return markup.Shown("\n".join(["More claims about this:", *(f"  {id}" for id in ids)]), made)


def _recorded_statement(item: Claim) -> str:
    """Return how a claim on record was settled, and how to run its check."""
    needs = f" It needs {' and '.join(item.needs)}." if item.needs else ""
    run_it = f"`python -m course.derivations --id {item.id}` runs the check.{needs}"
    return f"{_stated(item.check)} {run_it}".strip()


def show(id: str) -> Block:
    """Return the claim with this id as a card for a notebook, with figures computed now.

    A claim with `needs` is shown from the record on every machine, so that a page looks the same
    whether or not they are installed; the card says so. Where a library that `make setup` installs
    is missing, the figures are those on record too, and the card says what to install.

    Args:
        id: id of a claim.

    Raises:
        ValueError: for an unknown id.
    """
    item = _get(id)
    if item.needs:
        how = " and ".join(dict.fromkeys(f"`{NEEDS[need][0]}`" for need in item.needs))
        source = (
            f"{_stated(item.check)} These figures are from the stored record: the check needs "
            f"{' and '.join(item.needs)} ({how}). `python -m course.derivations --id {id}` runs it."
        )
        return Block(_on_record(item, source))
    try:
        return Block(_settled(item))
    except ImportError as missing:
        return Block(_on_record(item, f"From the record, not run here: {missing}."))


def _settled(item: Claim) -> Outcome:
    """Return a claim as its check settles it, or as it is on record where COURSE_CLAIMS says so.

    The tests of the pages set COURSE_CLAIMS to "recorded": the tests of the claims compare each
    check with its record, so a page that agrees with the record agrees with the check. A claim
    whose sentence is put together from what was computed is always run.
    """
    statement = _stated(item.check)
    if os.environ.get("COURSE_CLAIMS") == "recorded" and statement:
        return _on_record(item, statement)
    return run(item.id)


def _on_record(item: Claim, statement: str) -> Outcome:
    """Return a claim with the verdict and the figures on record, and a statement of where from."""
    result, entry = Result(item.id), records.load(item.file)[item.id]
    result.inputs, result.statement = dict(entry.get("inputs", {})), statement
    result.figures = {name: value for name, (value, _) in entry["figures"].items()}
    result.tolerances = {name: tolerance for name, (_, tolerance) in entry["figures"].items()}
    result.holds = entry["verdict"] == Verdict.HOLDS.value
    result.condition, result.inside = entry.get("condition", ""), [True]
    return Outcome(item, result, (), ())


def recorded(id: str, file: str) -> Outcome:
    """Return a claim with the verdict and the figures on record, which takes no time.

    Args:
        id: id of a claim.
        file: the one that it stands in, such as "rigid_body.flight"; only this one is imported.

    Raises:
        ValueError: for an unknown id.
    """
    importlib.import_module(f"{__name__}.{file}")
    return _on_record(_get(id), "From the record.")


def unmet(item: Claim) -> str:
    """Return why the check of a claim cannot run on this machine, or ""."""
    return next((reason for need in item.needs if (reason := NEEDS[need][1]())), "")


def _stated(check: Check) -> str:
    """Return the texts in a check's source that state what was computed or measured."""
    for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(check)))):
        match node:
            case ast.Assign(
                targets=[ast.Attribute(attr="statement")], value=ast.Constant(str(text))
            ):
                return text
    return ""


def answer(id: str, text: str) -> Answer:
    """Check a learner's formula against the claim's.

    Any equivalent form is right: `2*sqrt(m/k)`, `2 sqrt(m/k)`, `dt < 2/omega`, `(4 m/k)^0.5`. A
    wrong one gets numbers at which the two differ. The text is read by a small parser that knows
    numbers, the claim's symbols and a few functions, and nothing else; no code is run.

    Args:
        id: id of a claim that has a formula.
        text: the learner's formula.

    Returns:
        Whether it is right, a message, and a counter-example if it is wrong.

    Raises:
        ValueError: for an unknown id, one without a formula, or a text that is not a str.
    """
    requested = formula(id)
    result = answer_formula(requested, text)
    prompt = "" if requested.prompt() in result.message else requested.prompt()
    return replace(result, question=prompt, typed=text, topic=_get(id).topic)


def formula(id: str) -> Formula:
    """Return what a claim asks a learner for.

    Raises:
        ValueError: for an unknown id, or one without a formula.
    """
    requested = _get(id).formula
    if requested is None:
        answerable = ", ".join(item.id for item in claims() if item.formula)
        raise ValueError(f"id is {id!r}, which asks for no formula; these do: {answerable}")
    return requested
