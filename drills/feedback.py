"""The words of a verdict: as plain text, as HTML for a notebook, as data.

A text that comes from the submission (its output, its exceptions, its results) is cleaned of
control characters first, so that it cannot move the terminal's cursor or paint a verdict.
"""

from __future__ import annotations

import base64
import html as markup
import math
import textwrap
import unicodedata
from dataclasses import replace
from typing import Any

from drills.cards import Card
from drills.grade_report import Check, Cost, Report
from drills.reasons import Reason
from drills.terminal import painted

SHOWN_CASES = 6
SHOWN_LINES = 12

_MARKS = {True: ("\N{CHECK MARK}", "ok"), False: ("\N{MULTIPLICATION X}", "x ")}


def clean(text: str) -> str:
    """Return text without control characters and directional marks.

    Tabs become spaces, line ends stay.
    """
    retained = []
    for character in text.replace("\r\n", "\n").replace("\r", "\n").expandtabs(4):
        odd = unicodedata.category(character) in ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")
        retained.append(f"\\x{ord(character):02x}" if odd and character != "\n" else character)
    return "".join(retained)


def text(
    report: Report, card: Card, *, colour: bool = False, unicode: bool = True, width: int = 80
) -> str:
    """Return the feedback on one attempt as lines of text.

    Args:
        report: what the grader found.
        card: of the exercise.
        colour: use ANSI colours.
        unicode: False to write nothing but ASCII.
        width: longest line.
    """
    page = _Page(colour, unicode, width)
    page.verdict(report, card)
    if report.reason is Reason.NOT_ATTEMPTED:
        page.wrapped(
            f"Write {card.signatures[0].text} in {clean(report.filename)}, then check again."
        )
    if report.call:
        page.labelled("call", report.call)
    if report.problem:
        page.problem(report)
    failed = [check for check in report.checks if not check.passed]
    if failed:
        page.failure(failed[0])
    if report.diagnosis:
        page.heading("Likely cause")
        page.wrapped(report.diagnosis)
    if report.checks or report.parts:
        page.cases(report)
    for note in report.notes:
        page.lines.append("")
        page.wrapped(note)
    if report.costs:
        page.costs(report.costs)
    if report.output:
        page.output(report.output)
    page.foot(report, card)
    return page.done()


class _Page:
    """Lines of text of limited width."""

    def __init__(self, colour: bool, unicode: bool, width: int) -> None:
        self.colour, self.unicode, self.width = colour, unicode, width
        self.lines: list[str] = []

    def done(self) -> str:
        out = "\n".join(self.lines).rstrip() + "\n"
        return out if self.unicode else out.encode("ascii", "backslashreplace").decode()

    def paint(self, text: str, style: str) -> str:
        return painted(text, style) if self.colour else text

    def mark(self, good: bool) -> str:
        return self.paint(_MARKS[good][0 if self.unicode else 1], "right" if good else "wrong")

    def heading(self, text: str) -> None:
        self.lines += ["", self.paint(text, "head")]

    def wrapped(self, text: str, indent: str = "  ") -> None:
        for line in clean(text).split("\n"):
            self.lines += textwrap.wrap(
                line, self.width, initial_indent=indent, subsequent_indent=indent
            ) or [""]

    def labelled(self, label: str, text: str) -> None:
        head = f"  {label:<10}"
        self.lines += textwrap.wrap(
            clean(text), self.width, initial_indent=head, subsequent_indent=" " * len(head)
        ) or [head]

    def cut(self, text: str, width: int) -> str:
        text = clean(text).replace("\n", " ")
        return text if len(text) <= width else text[: max(width - 3, 0)] + "..."

    def verdict(self, report: Report, card: Card) -> None:
        if report.passed:
            word = self.paint("RIGHT", "right")
        elif report.reason is Reason.NOT_ATTEMPTED:
            word = self.paint("NOT ATTEMPTED YET", "head")
        else:
            word = self.paint("NOT RIGHT", "wrong")
        self.lines.append(f"{word}  {self.cut(f'{card.name}: {card.title}', self.width - 20)}")
        if report.passed:
            self.wrapped(f"All {len(report.checks)} checks hold.")
        elif report.reason is not Reason.NOT_ATTEMPTED:
            self.wrapped(report.sentence)

    def problem(self, report: Report) -> None:
        problem = report.problem
        assert problem is not None
        self.heading("Where")
        source = report.source.splitlines()
        frames = problem.frames[-5:]
        for frame in frames:
            self.lines.append(
                self.cut(f"  {report.filename}:{frame.line} in {frame.function}", self.width)
            )
            if 0 < frame.line <= len(source):
                self.lines.append(self.cut(f"    {source[frame.line - 1].strip()}", self.width))
        if problem.line:
            self.lines.append(self.cut(f"  {report.filename}:{problem.line}", self.width))
            if problem.line <= len(source):
                shown = source[problem.line - 1]
                indent = len(shown) - len(shown.lstrip())
                self.lines.append(self.cut(f"    {shown.strip()}", self.width))
                caret = 4 + max(problem.column - 1 - indent, 0)
                if 0 < problem.column and caret < self.width:
                    self.lines.append(" " * caret + "^")
        message = f"{problem.type}: {problem.message}" if problem.message else problem.type
        self.wrapped(message)

    def failure(self, check: Check) -> None:
        self.heading(self.cut(f"First failed check: {check.name}", self.width))
        if check.call:
            self.labelled("call", check.call)
        if check.got:
            self.labelled("got", check.got)
        if check.expected:
            self.labelled("expected", check.expected)
        if not math.isnan(check.error):
            allowed = f", {check.tolerance:.3g} allowed" if not math.isnan(check.tolerance) else ""
            self.labelled("error", f"{quantity(check.error, check.unit, 3)}{allowed}")
        if check.why and not math.isnan(check.error):
            self.labelled("tolerance", check.why)

    def cases(self, report: Report) -> None:
        self.lines.append("")
        tally = textwrap.wrap(tally_text(report), self.width, subsequent_indent="  ")
        self.lines += [self.paint(line, "head") for line in tally]
        rows = grouped(report.checks)
        for worst, count in rows[:SHOWN_CASES]:
            times = f" ({count} cases)" if count > 1 else ""
            note = check_note(worst)
            if count > 1 and note == report.sentence:
                note = "as said above"
            line = f"{worst.name}{times}: {note}" if note else f"{worst.name}{times}"
            self.lines.append(f"  {self.mark(worst.passed)} {self.cut(line, self.width - 5)}")
        if len(rows) > SHOWN_CASES:
            self.lines.append(f"    and {len(rows) - SHOWN_CASES} more kinds of check")

    def costs(self, costs: list[Cost]) -> None:
        self.heading("Cost beside the reference")
        for cost in costs:
            self.lines.append(self.cut(f"  {cost_text(cost)}", self.width))

    def output(self, output: str) -> None:
        lines = clean(output).rstrip("\n").split("\n")
        self.heading("It printed")
        self.lines += [self.cut(f"  | {line}", self.width) for line in lines[:SHOWN_LINES]]
        if len(lines) > SHOWN_LINES:
            self.lines.append(f"  | ... and {len(lines) - SHOWN_LINES} more lines")

    def foot(self, report: Report, card: Card) -> None:
        if report.passed:
            self.heading("Remember")
            self.wrapped(card.insight)
        if report.checks or report.call:  # else no case was drawn
            note = f"seed {report.seed} (the same cases again: --seed {report.seed})"
            if len(note) > self.width:
                note = f"--seed {report.seed}"
            self.lines += ["", self.paint(note, "dim")]


def tally_text(report: Report) -> str:
    """Return what holds, level by level: "Cases: simple 2 of 2, core 9 of 9, edge 2 of 4"."""
    parts = [f"{level} {hold} of {requested}" for level, hold, requested in report.tally()]
    if report.unreached:
        parts.append(f"{report.unreached} not reached")
    if parts:
        return f"Cases: {', '.join(parts)}"
    good = sum(check.passed for check in report.checks)
    return f"Checks: {good} of {len(report.checks)} hold"


def grouped(checks: list[Check]) -> list[tuple[Check, int]]:
    """Return checks of one name and reason together: the worst, and their number; failures first.

    What is said of several in the same words is said once.
    """
    groups: dict[tuple[str, Reason], list[Check]] = {}
    for check in checks:
        message = check.name if check.passed or not check.sentence else f"\0{check.sentence}"
        key = (message, check.reason)
        if not check.passed and math.isfinite(check.error):
            key = (check.name, check.reason)  # its sentence tells its own error
        groups.setdefault(key, []).append(check)

    def badness(check: Check) -> float:
        return -math.inf if math.isnan(check.error) else check.error

    rows = [(max(group, key=badness), len(group)) for group in groups.values()]
    rows = [
        (replace(worst, name=f"{worst.name} and others"), count)
        if len({check.name for check in group}) > 1
        else (worst, count)
        for (worst, count), group in zip(rows, groups.values(), strict=True)
    ]
    return sorted(rows, key=lambda row: row[0].passed)


def quantity(value: float, unit: str, digits: int = 2) -> str:
    """Return a number with its unit; the unit 1 is not written."""
    return f"{value:.{digits}g}" if unit in ("", "1") else f"{value:.{digits}g} {unit}"


def check_note(check: Check) -> str:
    """Return what is to be said of one check in a line."""
    if check.passed and not math.isnan(check.error):
        return f"error {quantity(check.error, check.unit)}, {check.tolerance:.2g} allowed"
    return check.sentence


def cost_text(cost: Cost) -> str:
    """Return one line: yours, the reference's, and their ratio."""
    ratio = f" ({cost.yours / cost.reference:.2g} times)" if cost.reference > 0.0 else ""
    yours, reference = _figure(cost.yours, cost.unit), _figure(cost.reference, cost.unit)
    return f"{cost.what}: yours {yours}, reference {reference}{ratio}"


def _figure(value: float, unit: str) -> str:
    if unit != "s":
        return f"{value:.4g} {unit}".rstrip()
    for scale, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if abs(value) >= scale:
            return f"{value / scale:.3g} {name}"
    return f"{value / 1e-9:.3g} ns"


def as_dict(report: Report, card: Card) -> dict[str, Any]:
    """Return the attempt as plain data: what `--json` prints.

    Programs of others read it, so a key is never renamed, and one without a value is there as null.

    Args:
        report: the graded attempt.
        card: the exercise's card.

    Returns:
        A dictionary of strings, numbers, lists and dictionaries that JSON can hold. A number that
        is not finite becomes null, as JSON has no NaN. All text that an answer may have written is
        cleaned of control characters, which would otherwise act on the reader's terminal.
    """
    problem = report.problem
    return {
        "drill": report.drill,
        "title": card.title,
        "verdict": report.verdict,
        "reason": str(report.reason),
        "sentence": clean(report.sentence),
        "seed": report.seed,
        "file": clean(report.filename),
        "slip": report.slip or None,
        "diagnosis": report.diagnosis or None,
        "call": clean(report.call) or None,
        "case": report.case or None,
        # An exception of the answer. Without a line of its own, it is the innermost frame's.
        "problem": problem
        and {
            "type": clean(problem.type),
            "message": clean(problem.message),
            "line": problem.line or (problem.frames[-1].line if problem.frames else None),
            "frames": [
                {"line": frame.line, "function": clean(frame.function)} for frame in problem.frames
            ],
        },
        "checks": [
            {
                "name": clean(check.name),
                "passed": check.passed,
                "reason": str(check.reason),
                "sentence": clean(check.sentence),
                "call": clean(check.call),
                "got": clean(check.got),
                "expected": clean(check.expected),
                "error": _finite(check.error),
                "tolerance": _finite(check.tolerance),
                "unit": check.unit,
                "why": check.why,
                "slip": check.slip or None,
                "level": report.parts[check.part].level if check.part >= 0 else None,
            }
            for check in report.checks
        ],
        # Seconds per call, or counts, with those of the worked answer.
        "costs": [
            {
                "what": cost.what,
                "unit": cost.unit,
                "yours": _finite(cost.yours),
                "reference": _finite(cost.reference),
            }
            for cost in report.costs
        ],
        # How many cases of each level hold, of those that were requested.
        "cases": [
            {"level": level, "hold": hold, "asked": requested}
            for level, hold, requested in report.tally()
        ],
        "not_reached": report.unreached,
        "notes": list(report.notes),
        "output": clean(report.output),
        "seconds": report.seconds,
    }


def html(report: Report, card: Card, picture: bytes = b"") -> str:
    """Return the feedback as HTML without scripts, readable on a light and on a dark page.

    Args:
        report: what the grader found.
        card: of the exercise.
        picture: a PNG of the case that failed, if there is one.
    """
    escape = _escaped
    if report.passed:
        word, colour = "Right", "#2e7d32"
    elif report.reason is Reason.NOT_ATTEMPTED:
        word, colour = "Not attempted yet", "#757575"
    else:
        word, colour = "Not right", "#c62828"
    badge = (
        f'<span style="background:{colour};color:#fff;border-radius:4px;padding:1px 8px;'
        f'font-weight:600">{word}</span>'
    )
    parts = [f"<p>{badge} <b>{escape(card.title)}</b></p>"]
    if report.reason is Reason.NOT_ATTEMPTED:
        parts += [f"<p>{escape(note)}</p>" for note in report.notes]
        return _boxed(parts, colour)
    if report.passed:
        parts.append(f"<p>All {len(report.checks)} checks hold. {escape(card.insight)}</p>")
    else:
        parts.append(f"<p>{escape(report.sentence)}</p>")
    if report.diagnosis:
        parts.append(f"<p><b>Likely cause.</b> {escape(report.diagnosis)}</p>")
    if report.call:
        parts.append(f"<p>call <code>{escape(report.call)}</code></p>")
    if report.problem:
        parts.append(f"<pre>{escape(_problem_text(report))}</pre>")
    if report.case:
        parts.append(
            "<details><summary>The case as code, to paste into a cell below your answer</summary>"
            f"<pre>{escape(report.case)}</pre></details>"
        )
    if picture:
        data = base64.b64encode(picture).decode()
        parts.append(f'<img alt="the first case that failed" src="data:image/png;base64,{data}"/>')
    if report.checks:
        parts.append(f"<p>{escape(tally_text(report))}</p>{_table(report.checks)}")
    parts += [f"<p>{escape(note)}</p>" for note in report.notes]
    if report.costs:
        rows = "<br>".join(escape(cost_text(cost)) for cost in report.costs)
        parts.append(f"<p>{rows}</p>")
    if report.output:
        lines = clean(report.output).rstrip("\n").split("\n")
        more = [f"... and {len(lines) - SHOWN_LINES} more lines"] * (len(lines) > SHOWN_LINES)
        shown = "\n".join(lines[:SHOWN_LINES] + more)
        parts.append(f"<p>It printed:</p><pre>{escape(shown)}</pre>")
    parts.append(f'<p style="opacity:.7"><small>seed {report.seed}</small></p>')
    return _boxed(parts, colour)


def _problem_text(report: Report) -> str:
    page = _Page(colour=False, unicode=True, width=100)
    page.problem(report)
    return "\n".join(page.lines[2:])


def _table(checks: list[Check]) -> str:
    style = 'style="text-align:left;vertical-align:top"'
    heads = ("", "check", "call", "got", "expected", "error", "allowed")
    rows = ["<tr>" + "".join(f"<th {style}>{head}</th>" for head in heads) + "</tr>"]
    groups = grouped(checks)
    for check, count in groups[:SHOWN_CASES]:
        colour = "#2e7d32" if check.passed else "#c62828"
        mark = f'<b style="color:{colour}">{_MARKS[check.passed][0]}</b>'
        error = "" if math.isnan(check.error) else quantity(check.error, check.unit)
        allowed = "" if math.isnan(check.tolerance) else quantity(check.tolerance, check.unit)
        times = f" ({count} cases, the worst:)" if count > 1 else ""
        note = f"<br><small>{_escaped(check.sentence)}</small>" if check.sentence else ""
        cells = (
            mark,
            _escaped(check.name) + times + note,
            f"<code>{_escaped(check.call)}</code>" if check.call else "",
            f"<code>{_escaped(check.got)}</code>" if check.got else "",
            f"<code>{_escaped(check.expected)}</code>" if check.expected else "",
            _escaped(error),
            _escaped(allowed),
        )
        rows.append("<tr>" + "".join(f"<td {style}>{cell}</td>" for cell in cells) + "</tr>")
    rest = len(groups) - SHOWN_CASES
    more = f"<p><small>and {rest} more kinds of check</small></p>" if rest > 0 else ""
    return f"<table>{''.join(rows)}</table>{more}"


def _boxed(parts: list[str], colour: str) -> str:
    return (
        f'<div style="border-left:4px solid {colour};padding:2px 0 2px 12px">{"".join(parts)}</div>'
    )


def _escaped(text: str) -> str:
    # Dollar signs would start a formula in a notebook.
    return markup.escape(clean(text)).replace("$", "&#36;")


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
