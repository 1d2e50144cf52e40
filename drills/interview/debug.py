"""The command `drills debug`: a program misbehaves; probe it, name the cause, repair it.

It reads lines, from a person or a pipe, until the cause is named or they end.
"""

from __future__ import annotations

import contextlib
import secrets
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from typing import Any

import click

from course.interview import scenarios
from drills.interview import listen, read_line
from drills.session import RIGHT, WRONG, Session, body, options
from drills.terminal import Terminal

WORDS = {
    "probe NAME": "run a probe: prints its figure and the minutes spent",
    "probes": "what can be run",
    "program": "the listing",
    "causes": "what it may be, and what can be changed",
    "conclude CAUSE REPAIR": "name both, and get the answer with its evidence",
    "quit": "leave it open",
}


@click.command("debug")
@click.argument("name", required=False)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="The same case again.")
@options
@body
def command(session: Session, name: str | None, seed: int | None) -> int:
    """Debug a scenario: run probes, name the cause, repair it; without NAME, list them.

    A line is: probe NAME, probes, program, causes, conclude CAUSE REPAIR, or quit.
    """
    if name is None:
        result = [scenarios.scenario(one) for one in scenarios.scenario_names()]
        for one in result:
            session.say(f"  {one.name:<10}{one.title}")
        session.say()
        session.say("  drills debug NAME   begins")
        listed = [{"scenario": one.name, "title": one.title} for one in result]
        return session.finish(RIGHT, {"scenarios": listed})
    try:
        case = scenarios.diagnose(name, secrets.randbelow(1000) if seed is None else seed)
    except ValueError as error:
        raise click.BadParameter(f"{error}.") from None
    rejected: list[str] = []
    verdict = talk(session, case, rejected, _lines(session.terminal))
    payload: dict[str, Any] = {
        "scenario": name,
        "seed": case.case.seed,
        "findings": [asdict(finding) for finding in case.findings],
        "minutes": case.minutes,
        "refused": rejected,
        "verdict": verdict and _data(verdict),
    }
    if verdict is None:
        session.say(f"Left open. drills debug {name} --seed {case.case.seed} begins it again.")
    done = verdict is None or (verdict.right and verdict.cured)
    return session.finish(RIGHT if done else WRONG, payload)


def talk(
    session: Session, case: scenarios.Diagnosis, rejected: list[str], lines: Iterable[str]
) -> scenarios.Verdict | None:
    """Do what the lines say, until one of them concludes; return the verdict, None if none does.

    Args:
        session: where it writes.
        case: what is debugged.
        rejected: gets what is said of lines that mean nothing.
        lines: what is typed.
    """
    one = scenarios.scenario(case.case.name)
    head = session.terminal.paint(one.title, "head")
    session.say(f"{head} (seed {case.case.seed})")
    session.wrap(one.prompt)
    session.say()
    probes = [(f"{probe.name} ({probe.minutes} min)", probe.what) for probe in one.probes]
    named = [(cause.name, cause.words) for cause in scenarios.offered(case.case)]
    named += [(scenarios.NONE, scenarios.NONE_WORDS)]
    repairs = [(repair.name, repair.words) for repair in one.repairs]

    def show_causes() -> None:
        for title, rows in (("What it may be", named), ("What can be changed", repairs)):
            session.say(session.terminal.paint(title, "head"))
            _rows(session, rows)

    shown: dict[str, Callable[[], None]] = {
        "probes": lambda: _rows(session, probes),
        "program": lambda: session.say(one.listing()),
        "causes": show_causes,
    }
    shown["probes"]()
    session.say()
    _rows(session, list(WORDS.items()))
    for line in lines:
        try:
            match line.split():
                case ["quit"]:
                    return None
                case ["probe", name]:
                    session.say(str(case.probe(name)))
                case ["conclude", cause, repair]:
                    verdict = case.conclude(cause, repair)
                    _print_verdict(session, verdict)
                    return verdict
                case [word] if word in shown:
                    shown[word]()
                case []:
                    pass
                case _:
                    raise click.BadParameter(f"{line.strip()!r} is none of: {', '.join(WORDS)}")
        except (ValueError, click.BadParameter) as error:
            rejected.append(str(error))
            session.wrap(f"{error}.")
    return None


def _lines(terminal: Terminal) -> Iterator[str]:
    listen()
    prompt = "> " * (sys.stdin.isatty() and not terminal.json)
    with contextlib.suppress(EOFError):
        while True:
            yield read_line(prompt)


def _rows(session: Session, rows: list[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows) + 4
    for name, text in rows:
        session.wrap(text, " " * width, f"  {name:<{width - 2}}")


def _print_verdict(session: Session, verdict: scenarios.Verdict) -> None:
    for sentence in verdict.sentences():
        session.wrap(sentence)
    for title, rows in (
        (f"Your {verdict.minutes} minutes", verdict.rows),
        (f"The model answer, {verdict.model_minutes} minutes", verdict.model),
    ):
        session.say()
        session.say(session.terminal.paint(title, "head"))
        if not rows:
            session.say("  no probe: nothing is ruled out")
        for row in rows:
            _print_evidence(session, row)


def _print_evidence(session: Session, row: scenarios.Row) -> None:
    """Print what a probe showed, and what it would have shown under each cause."""
    figure = f"{row.figure if abs(row.figure) > 1e-12 else 0.0:.3g} {row.unit}".rstrip()
    session.say(f"  {session.terminal.paint(row.probe, 'head')} {figure}")
    width = max((len(one.cause) for one in row.ranges), default=0)
    for one in row.ranges:
        fits = "fits" if one.explains(row.figure) else "ruled out"
        session.say(f"    {one.cause:<{width}}  {scenarios.span(one):<20}  {fits}")
    session.wrap(f"left: {', '.join(row.remaining) or scenarios.NONE}", "    ", "    ")


def _data(verdict: scenarios.Verdict) -> dict[str, Any]:
    marks = {name: getattr(verdict, name) for name in ("right", "supported", "cured", "points")}
    return {**asdict(verdict), **marks, "sentences": verdict.sentences()}
