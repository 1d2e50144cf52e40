"""The command `drills debug`: a program misbehaves; probe it, name the cause, repair it.

It reads lines, from a person or a pipe, until the cause is named or they end.
"""

from __future__ import annotations

import contextlib
import secrets
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import click

from course.interview import scenarios
from drills import json_store
from drills.interview import listen, read_line
from drills.session import RIGHT, WRONG, Session, body, options
from drills.task_text import fitted
from drills.terminal import Terminal

WORDS = {
    "probe NAME": "run a probe and print its result and the minutes spent so far",
    "probes": "list the probes",
    "program": "print the program",
    "causes": "list the possible causes and the repairs",
    "conclude CAUSE REPAIR": "give your diagnosis and repair, and see the answer with its evidence",
    "quit": "stop here; the case stays open",
}
OPEN = 50  # cases that are stored, the newest


@dataclass
class Left:
    """The open cases: "NAME/SEED" -> the probes that were run; the last case comes last."""

    probes: dict[str, list[str]] = field(default_factory=dict)


def _parse(content: dict[str, Any]) -> Left:
    probes = content.get("probes")
    if not isinstance(probes, dict):
        raise json_store.Damaged
    for key, names in probes.items():
        name, _, seed = key.partition("/")
        if name not in scenarios.scenario_names() or not seed.isdecimal():
            raise json_store.Damaged
        known = {probe.name for probe in scenarios.scenario(name).probes}
        if not isinstance(names, list) or not all(one in known for one in names):
            raise json_store.Damaged
    return Left(probes)


FORM = json_store.Form("drills-debug/1", "open cases", Left, _parse, asdict)


def last_seed(saved: Left, name: str) -> int | None:
    """Return the seed of the scenario's last open case, None if there is none."""
    seeds = [int(key.partition("/")[2]) for key in saved.probes if key.partition("/")[0] == name]
    return seeds[-1] if seeds else None


class Log:
    """The probes of a case, written to the file after each probe.

    Args:
        session: of the command; its notices say what is wrong with the file.
        case: to debug; the probes of the file are run again.
    """

    def __init__(self, session: Session, case: scenarios.Diagnosis, saved: Left) -> None:
        self.session, self.case = session, case
        self.key = f"{case.case.name}/{case.case.seed}"
        for name in saved.probes.get(self.key, []):
            case.probe(name)

    def update(self, over: bool = False) -> None:
        """Write the probes so far; drop a case that is over."""

        def edit(saved: Left) -> None:
            saved.probes.pop(self.key, None)
            if not over:
                saved.probes[self.key] = [finding.probe for finding in self.case.findings]
            for key in list(saved.probes)[:-OPEN]:
                del saved.probes[key]

        try:
            _, notices = json_store.change(path_of(self.session), FORM, edit)
        except json_store.Problem as problem:
            notices = (str(problem),)
        report = self.session.notices
        report += [one for one in notices if one not in report]


def path_of(session: Session) -> Path | None:
    """Return the file of the open cases, None where no progress is stored."""
    return session.progress_file and session.progress_file.with_name("debug.json")


@click.command("debug")
@click.argument("name", required=False)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Repeat the case with this seed.")
@click.option("--new", is_flag=True, help="Begin a new case even if one is open.")
@options
@body
def command(session: Session, name: str | None, seed: int | None, new: bool) -> int:
    """Find the fault of a program: run probes, name the cause, repair it.

    Without NAME, list the scenarios. A case that you left open continues, with its probes.

    What you can type: probe NAME, probes, program, causes, conclude CAUSE REPAIR, or quit.
    """
    if name is None:
        result = [scenarios.scenario(one) for one in scenarios.scenario_names()]
        saved, notices = json_store.load(path_of(session), FORM)
        session.notices += notices
        for one in result:
            is_open = "  (open)" * (last_seed(saved, one.name) is not None)
            session.say(f"  {one.name:<10}{one.title}{is_open}")
        session.say()
        session.say("  drills debug NAME   starts a case, or continues an open one")
        listed = [{"scenario": one.name, "title": one.title} for one in result]
        return session.finish(RIGHT, {"scenarios": listed})
    saved, notices = json_store.load(path_of(session), FORM)
    session.notices += notices
    if seed is None and not new:
        seed = last_seed(saved, name)
    try:
        case = scenarios.diagnose(name, secrets.randbelow(1000) if seed is None else seed)
    except ValueError as error:
        raise click.BadParameter(f"{error}.") from None
    rejected: list[str] = []
    if new:
        saved.probes.pop(f"{name}/{case.case.seed}", None)
    log = Log(session, case, saved)
    listen()
    read = session.terminal.paged(read_line)
    try:
        verdict = talk(session, case, rejected, _lines(session.terminal, read), log.update)
    except KeyboardInterrupt:
        session.notices.append(_stays_open(session, case))
        raise
    if verdict is not None:
        log.update(over=True)
    payload: dict[str, Any] = {
        "scenario": name,
        "seed": case.case.seed,
        "findings": [asdict(finding) for finding in case.findings],
        "minutes": case.minutes,
        "refused": rejected,
        "verdict": verdict and _data(verdict),
    }
    if verdict is None:
        session.wrap(_stays_open(session, case))
    done = verdict is None or (verdict.right and verdict.cured)
    return session.finish(RIGHT if done else WRONG, payload)


def _stays_open(session: Session, case: scenarios.Diagnosis) -> str:
    """Return sentences on how to continue a case without a conclusion."""
    count = len(case.findings)
    stored = path_of(session) is not None
    what = f"Your {count} probe{'s are' if count != 1 else ' is'} " * bool(count)
    what += ("stored. " if stored else "not stored. ") * bool(count)
    again = "continues the case" if stored and count else "starts the case again"
    return (
        f"The case stays open. {what}drills debug {case.case.name} --seed {case.case.seed} {again}."
    )


def talk(
    session: Session,
    case: scenarios.Diagnosis,
    rejected: list[str],
    lines: Iterable[str],
    probed: Callable[[], object] = lambda: None,
    quits: str = WORDS["quit"],
) -> scenarios.Verdict | None:
    """Carry out the lines until one of them concludes; return the verdict, None if none does.

    Args:
        session: of the command, for the output.
        case: to debug.
        rejected: receives the messages on invalid lines.
        lines: as typed.
        probed: called after each probe.
        quits: the effect of `quit`, for the list of commands.
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
        for title, rows in (("Possible causes", named), ("Repairs", repairs)):
            session.say(session.terminal.paint(title, "head"))
            _rows(session, rows)

    shown: dict[str, Callable[[], None]] = {
        "probes": lambda: _rows(session, probes),
        "program": lambda: session.say(fitted(one.listing(), session.terminal.width)),
        "causes": show_causes,
    }
    shown["probes"]()
    session.say()
    _rows(session, list({**WORDS, "quit": quits}.items()))
    if case.findings:
        session.say()
        session.say(session.terminal.paint("You are continuing this case. Results so far:", "head"))
        for finding in case.findings:
            session.say(str(finding))
    for line in lines:
        try:
            match line.split():
                case ["quit"]:
                    return None
                case ["probe", name]:
                    finding = case.probe(name)
                    probed()
                    session.say(str(finding))
                case ["conclude", cause, repair]:
                    if cause in dict(named) and repair in dict(repairs):
                        session.say("Computing what each probe shows under each cause ...")
                    verdict = case.conclude(cause, repair)
                    _print_verdict(session, verdict)
                    return verdict
                case [word] if word in shown:
                    shown[word]()
                case []:
                    pass
                case _:
                    raise click.BadParameter(
                        f"{line.strip()!r} is not a command. The commands are: {', '.join(WORDS)}"
                    )
        except (ValueError, click.BadParameter) as error:
            rejected.append(str(error))
            session.wrap(f"{error}.")
    return None


def prompt_in(terminal: Terminal) -> str:
    """Return what asks a person for a command; "" in a pipe."""
    return "> " * is_person(terminal)


def is_person(terminal: Terminal) -> bool:
    """Return whether a person types and sees prompts, not a pipe."""
    return sys.stdin.isatty() and not terminal.json


def _lines(terminal: Terminal, read: Callable[..., str]) -> Iterator[str]:
    prompt = prompt_in(terminal)
    with contextlib.suppress(EOFError):
        while True:
            yield read(prompt)


def _rows(session: Session, rows: list[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows) + 4
    for name, text in rows:
        session.wrap(text, " " * width, f"  {name:<{width - 2}}")


def _print_verdict(session: Session, verdict: scenarios.Verdict) -> None:
    for sentence in verdict.sentences():
        session.wrap(sentence)
    for title, rows in (
        (f"Your probes ({scenarios.in_minutes(verdict.minutes)})", verdict.rows),
        (f"The model answer ({scenarios.in_minutes(verdict.model_minutes)})", verdict.model),
    ):
        session.say()
        session.say(session.terminal.paint(title, "head"))
        if not rows:
            session.say("  You ran no probe, so no cause is ruled out.")
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
    session.wrap(f"still possible: {', '.join(row.remaining) or scenarios.NONE}", "    ", "    ")


def _data(verdict: scenarios.Verdict) -> dict[str, Any]:
    marks = {name: getattr(verdict, name) for name in ("right", "supported", "cured", "points")}
    return {**asdict(verdict), **marks, "sentences": verdict.sentences()}
