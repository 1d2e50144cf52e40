"""The command `drills`: pick a drill, write the answer, have it graded in a second or two.

Every command ends with one line of JSON when it is given `--json`; `schema.json` describes it.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from drills import agenda, chapters, commands, interrupts, progress, task_text, workspace
from drills import cards as catalogue
from drills.cards import Card
from drills.progress import ATTEMPTED, NOT_ATTEMPTED, SOLVED, Reading, Record
from drills.reasons import SENTENCES
from drills.session import FAILED, RIGHT, WRONG, Commands, Later, Session, body, options
from drills.terminal import bar, wrapped
from drills.workspace import Misuse

SEED = click.IntRange(0, 2**32 - 1)
NAME = click.argument("name")
FEW = 3  # how many `next` names


def chosen(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the options that choose among the exercises; a command gets the cards that fit."""
    chapter = click.option("--chapter", type=int, multiple=True, help="Only this chapter.")
    level = click.option(
        "--level", type=click.IntRange(1, 5), multiple=True, help="Only this difficulty."
    )
    minutes = click.option(
        "--minutes", type=click.IntRange(1), help="Only tasks of at most this many minutes."
    )
    return chapter(level(minutes(function)))


def _fitting(chapter: tuple[int, ...], level: tuple[int, ...], minutes: int | None) -> list[Card]:
    known = sorted({card.chapter for card in catalogue.cards()})
    for number in chapter:
        if number not in known:
            numbers = ", ".join(map(str, known))
            raise Misuse(f"No exercise is of chapter {number}. There are some of: {numbers}.")
    return [
        card
        for card in catalogue.cards()
        if (not chapter or card.chapter in chapter)
        and (not level or card.difficulty in level)
        and (minutes is None or card.minutes <= minutes)
    ]


def main() -> None:
    """Run the console script."""
    for stream in range(3):  # where one was closed, the next file to be opened would take its place
        try:
            os.fstat(stream)
        except OSError:
            os.open(os.devnull, os.O_RDWR)

    def stop(number: int, frame: object) -> None:
        sys.exit(128 + number)

    # Ended from outside, the with blocks still clear up: no process and no folder stays behind.
    signal.signal(signal.SIGTERM, stop)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, stop)
    interrupts.note()
    try:
        cli.main(prog_name="drills")
    finally:
        interrupts.ignore()


@click.group(
    cls=Commands,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80},
    epilog="Exit codes: 0 right, 1 wrong, 2 misuse, 3 the grader itself could not run, 130 stopped "
    "by Ctrl-C. drills/README.md says what is protected, and describes the JSON.",
)
@options
@click.pass_context
def cli(context: click.Context, as_json: bool, work: str | None) -> int:
    """Solve coding drills and exercises, graded in a second or two."""
    if context.invoked_subcommand is None:
        return body(_welcome)(as_json=as_json, work=work)
    return RIGHT


def _welcome(session: Session) -> int:
    terminal = session.terminal
    session.say(terminal.paint("Drills", "head") + ": write an answer, have it graded in seconds.")
    drills = [card for card in catalogue.cards() if card.drill] or list(catalogue.cards())
    name = drills[0].name if drills else "NAME"
    session.say()
    commands = [
        "To begin with:",
        f"  {'drills next':<27}says what to do next",
        f"  {'drills start ' + name:<27}puts a starter into your work folder",
        f"  {'drills check ' + name:<27}grades what you wrote",
        f"  {'drills hint ' + name:<27}helps a little; ask again for more",
        f"  {'drills --help':<27}lists every command",
    ]
    # The list fills several screens: what comes last is what a newcomer sees.
    return _list(session, list(catalogue.cards()), last=commands)


@cli.command("list")
@chosen
@options
@body
def list_(
    session: Session, chapter: tuple[int, ...], level: tuple[int, ...], minutes: int | None
) -> int:
    """List the drills and exercises, and where you stand."""
    return _list(session, _fitting(chapter, level, minutes))


def _list(session: Session, cards: list[Card], last: Sequence[str] = ()) -> int:
    """List exercises by chapter, then print the lines `last`."""
    loaded, terminal = session.records(), session.terminal
    groups = {"Interview drills": [card for card in cards if card.drill]}
    for card in cards:
        if not card.drill:
            title = f"Exercises of chapter {card.chapter}: {task_text.chapter_title(card.chapter)}"
            groups.setdefault(title, []).append(card)
    for title, members in groups.items():
        if not members:
            continue
        name_width = max(len(card.name) for card in members)
        session.say(terminal.paint(title, "head"))
        for card in members:
            mark = task_text.sign(loaded.of(card.name).state, terminal)
            right = f"{card.difficulty}/5 {card.minutes:>3} min"
            right = f"ch {card.chapter:>2}  {right}" if card.drill else right
            title_width = terminal.width - len(right) - name_width - (8 if terminal.unicode else 10)
            first, *more = wrapped(card.title, title_width)
            session.say(f"  {mark} {card.name:<{name_width}}  {first:<{title_width}}  {right}")
            indent = " " * (terminal.width - title_width - len(right) - 2)
            for line in more:
                session.say(f"{indent}{line}")
        session.say()
    states = (NOT_ATTEMPTED, ATTEMPTED, SOLVED)
    legend = "   ".join(f"{task_text.sign(s, terminal)} {task_text.STATE_WORDS[s]}" for s in states)
    if cards:
        session.wrap(f"{legend}  1/5 easy, 5/5 hard", "  ", "  ")
    else:
        session.say("Nothing fits.")
    for line in ("", *last) if last else ():
        session.say(line)
    entries = [_card_data(card, loaded.of(card.name)) for card in cards]
    reasons = [{"reason": str(r), "meaning": text} for r, text in SENTENCES.items()]
    return session.finish(RIGHT, {"exercises": entries, "reasons": reasons})


@cli.command("next")
@chosen
@options
@body
def next_(
    session: Session, chapter: tuple[int, ...], level: tuple[int, ...], minutes: int | None
) -> int:
    """Suggest the next unsolved task, in the order of the chapters."""
    loaded, terminal = session.records(), session.terminal
    unsolved = agenda.to_solve(loaded, _fitting(chapter, level, minutes))
    reading = agenda.to_read(loaded, agenda.standings(loaded))
    if unsolved:
        card = unsolved[0]
        tried = loaded.of(card.name).state == ATTEMPTED
        verb = "Go on with" if tried else "Next:"
        session.wrap(terminal.paint(f"{verb} {card.name}: {card.title}", "head"))
        session.wrap(task_text.facts(card), "  ", "  ")
        session.wrap(f"It teaches: {card.teaches}", "  ", "  ")
        session.say()
        session.say(f"  drills {'check' if tried else 'start'} {card.name}")
        session.say()
        if unsolved[1:FEW]:
            session.say("Or")
        for card in unsolved[1:FEW]:
            lead = f"  {card.name}: "
            right = f"{card.difficulty}/5 {card.minutes:>3} min"
            room = terminal.width - len(lead) - len(right) - 2
            session.say(f"{lead}{task_text.cut(card.title, room):<{room}}  {right}")
        time = agenda.duration(sum(card.minutes for card in unsolved))
        session.say(f"{len(unsolved)} to solve, about {time}.")
    else:
        chose = chapter or level or minutes
        session.say("Nothing that fits is unsolved." if chose else "All solved.")
    if reading:
        where, part = reading
        session.wrap(
            f"To read: chapter {where.number}, section {part.number}: {part.title} (about "
            f"{agenda.duration(part.about)}). drills start {where.number} copies it."
        )
    payload = {
        "exercises": [_card_data(card, loaded.of(card.name)) for card in unsolved],
        "minutes": sum(card.minutes for card in unsolved),
        "reading": {"chapter": reading[0].number, "section": reading[1].number}
        if reading
        else None,
    }
    return session.finish(RIGHT, payload)


@cli.command(short_help="Copy a starter, or the notebook of a chapter, to work on.")
@NAME
@click.option("--force", is_flag=True, help="Replace an answer; it is kept under a numbered name.")
@options
@body
def start(session: Session, name: str, force: bool) -> int:
    """Copy the starter of NAME, or the notebook of chapter NAME, into your work folder."""
    if name.isdigit():
        return _start_chapter(session, int(name))
    return _start(session, catalogue.card(name), force, "start")


def _start_chapter(session: Session, number: int) -> int:
    source = chapters.notebook_of(chapters.of_number(number))
    copy = chapters.bring(source, session.work)
    session.wrap(copy.sentence() or f"{workspace.shown(copy.path)} is your copy, and up to date.")
    session.say()
    opens = "make lab" if workspace.in_tree() else f"jupyter lab {workspace.shown(copy.path)}"
    session.say(f"  {opens:<15}  opens it in JupyterLab")
    session.say(f"  drills read {number}    its sections; marks what you have read")
    session.say(f"  drills list --chapter {number}   its exercises")
    payload = {
        "chapter": number,
        "file": str(copy.path.absolute()),
        "state": copy.state,
        "kept": copy.preserved,
        "backup": str(copy.aside.absolute()) if copy.aside else None,
    }
    return session.finish(RIGHT, payload)


@cli.command(short_help="Mark sections of a chapter as read, or show which are.")
@click.argument("chapter", type=int)
@click.argument("section", type=int, nargs=-1)
@click.option("--all", "everything", is_flag=True, help="Mark every section.")
@click.option("--checkpoint", is_flag=True, help="Mark the checkpoint as passed.")
@click.option("--undo", is_flag=True, help="Take the marks away again.")
@options
@body
def read(
    session: Session,
    chapter: int,
    section: tuple[int, ...],
    everything: bool,
    checkpoint: bool,
    undo: bool,
) -> int:
    """Mark sections of a CHAPTER as read; without one, show which are."""
    parts = chapters.sections(chapters.notebook_of(chapters.of_number(chapter)))
    numbers = [part.number for part in parts]
    for number in section:
        if number not in numbers:
            raise Misuse(f"Chapter {chapter} has no section {number}. It has {numbers}.")

    def mark(reading: Reading) -> None:
        progress.note_read(reading, numbers if everything else list(section), undo)
        if checkpoint:
            progress.note_checkpoint(reading, undo)

    if section or everything or checkpoint:
        session.record_chapter(chapter, mark)
    reading = session.records().reading(chapter)
    terminal = session.terminal
    session.say(terminal.paint(f"Chapter {chapter}: {task_text.chapter_title(chapter)}", "head"))
    for part in parts:
        mark_of = task_text.sign(SOLVED if part.number in reading.read else NOT_ATTEMPTED, terminal)
        right = f"{part.about:>3} min"
        lead = f"  {mark_of} {part.number:>2}  "
        room = terminal.width - len(right) - (11 if terminal.unicode else 13)
        session.say(f"{lead}{task_text.cut(part.title, room):<{room}}  {right}")
    unread = [part for part in parts if part.number not in reading.read]
    session.say()
    time = agenda.duration(round(sum(part.minutes for part in unread)))
    passed = f"passed on {reading.checkpoint[:10]}" if reading.checkpoint else "open"
    session.say(
        f"{len(unread)} of {len(parts)} sections to read, about {time}; checkpoint {passed}"
    )
    payload = {
        "chapter": chapter,
        "sections": [{**asdict(part), "read": part.number in reading.read} for part in parts],
        "checkpoint": reading.checkpoint or None,
    }
    return session.finish(RIGHT, payload)


def _start(session: Session, card: Card, force: bool, command: str) -> int:
    path = workspace.answer(session.work, card.name)
    other = workspace.is_untouched(path, card)
    backup = None
    if not other:
        try:
            backup = workspace.write_start(path, card, replace=force)
        except FileExistsError:
            question = f"{workspace.shown(path)} is there already. Keep a copy and start over?"
            if not session.may_replace(question):
                raise Misuse(
                    f"{workspace.shown(path)} is there already and was left as it is. "
                    f"drills {command} {card.name} --force starts over and keeps a copy."
                ) from None
            backup = workspace.write_start(path, card, replace=True)
    if backup:
        session.wrap(f"Your answer is kept in {workspace.shown(backup)}.")
    verb = "is the untouched starter already" if other else "is yours to edit"
    session.wrap(f"{workspace.shown(path)} {verb}: {card.title}")
    session.say()
    session.say(f"  drills show {card.name}    the task")
    session.say(f"  drills check {card.name}   grade it")
    session.say(f"  drills watch {card.name}   grade it at every save")
    payload = {
        "drill": card.name,
        "file": str(path.absolute()),
        "created": not other,
        "backup": str(backup.absolute()) if backup else None,
    }
    return session.finish(RIGHT, payload)


@cli.command(short_help="Show a task: its inputs, its outputs and their units.")
@NAME
@options
@body
def show(session: Session, name: str) -> int:
    """Show the task of NAME: what goes in, what comes out, in which units."""
    card = catalogue.card(name)
    terminal = session.terminal
    record = session.records().of(card.name)
    session.wrap(terminal.paint(f"{card.name}: {card.title}", "head"))
    session.wrap(f"{task_text.facts(card)}; {task_text.STATE_WORDS[record.state]}")
    session.wrap(f"It teaches: {card.teaches}", "  ", "")
    session.say()
    if not terminal.json:
        for line in task_text.markdown_lines(task_text.task(card), terminal):
            session.say(line)
        task_text.say_examples(card, terminal)
    session.say()
    path = workspace.answer(session.work, card.name)
    begin = f"Your answer: {workspace.shown(path)}" if path.exists() else f"drills start {name}"
    session.wrap(begin)
    session.say(f"drills check {name}   drills hint {name}")
    pairs = [{"call": call, "answer": answer} for call, answer in task_text.examples(card)]
    payload = {**_card_data(card, record), "prompt": card.prompt(), "examples": pairs}
    return session.finish(RIGHT, payload)


@cli.command(short_help="Grade an answer: an exercise by NAME, or a FILE.")
@click.argument("target", required=False)
@click.option("--file", "file", metavar="PATH", help="Grade this file (- for standard input).")
@click.option("--seed", type=SEED, help="Draw the hidden cases from this seed, to replay a run.")
@click.option("--all", "everything", is_flag=True, help="Check every answer in the work folder.")
@click.option("--case", is_flag=True, help="Print the first case that failed, as code to run.")
@click.option("--rendered", is_flag=True, help="Add the feedback as text and HTML to the JSON.")
@click.option("--called", metavar="TEXT", help="Name of the file in messages.")
@options
@body
def check(
    session: Session,
    target: str | None,
    file: str | None,
    seed: int | None,
    everything: bool,
    case: bool,
    rendered: bool,
    called: str | None,
) -> int:
    """Grade an answer: NAME of a drill, a FILE, or - for standard input."""
    if everything:
        if target or file or case:
            raise Misuse("Check one answer or --all of them, not both.")
        return commands.check_all(session, seed)
    return commands.check(session, target, file, seed, rendered, called, case)


@cli.command(short_help="Grade an answer again each time its file is saved.")
@NAME
@click.option("--file", "file", metavar="PATH", help="Watch this file.")
@click.option("--seed", type=SEED, help="Draw the hidden cases from this seed every time.")
@options
@body
def watch(session: Session, name: str, file: str | None, seed: int | None) -> int:
    """Grade NAME again each time its file is saved, until Ctrl-C."""
    return commands.watch(session, catalogue.card(name), file, seed)


@cli.command()
@NAME
@options
@body
def hint(session: Session, name: str) -> int:
    """Show the next hint for NAME."""
    card = catalogue.card(name)
    count = len(card.hints)

    def one_more(record: Record) -> None:
        record.hints = min(record.hints + 1, count)

    known = session.records().of(card.name)
    before, hints = known.hints, task_text.ladder(card.hints, known.found)
    record = session.record(card.name, one_more)
    if known.found:
        session.wrap(f"Your last check found: {known.found}")
        session.say()
    if record is None or session.progress_file is None:  # it can't be counted: show the ladder
        numbers = range(1, count + 1)
    else:
        numbers = range(record.hints, record.hints + 1)
    for number in numbers:
        task_text.say_hint(number, count, hints[number - 1], session.terminal)
    session.say()
    last = numbers[-1]
    if before >= count:
        session.wrap(f"That is the last hint. drills solution {name} --give-up shows the answer.")
    elif last < count:
        session.wrap(f"drills hint {name} gives the next one.")
    shown = [{"number": n, "of": count, **asdict(hints[n - 1])} for n in numbers]
    return session.finish(RIGHT, {"drill": card.name, "hints": shown, "left": count - last})


@cli.command(short_help="Show a worked answer: after a pass, or with --give-up.")
@NAME
@click.option("--give-up", is_flag=True, help="Show it before you have solved it.")
@options
@body
def solution(session: Session, name: str, give_up: bool) -> int:
    """Show the worked answer of NAME, after a pass or with --give-up."""
    card = catalogue.card(name)
    record = session.records().of(card.name)
    if record.state != SOLVED and not record.gave_up:
        if not give_up:
            raise Misuse(
                f"{name} is not solved yet. drills hint {name} helps; drills solution {name} "
                "--give-up shows the answer, and your progress will say so."
            )

        def surrender(one: Record) -> None:
            one.gave_up = one.state != SOLVED

        session.record(card.name, surrender)
    text = card.solution_text()
    session.say(session.terminal.paint(f"# {card.name}: {card.title}", "head"))
    session.say()
    session.say(text)
    session.wrap(f"# {card.insight}", "# ", "")
    return session.finish(RIGHT, {"drill": card.name, "solution": text, "stands_in": card.solution})


@cli.command(short_help="Start an exercise over; your answer is kept.")
@NAME
@click.option("--force", is_flag=True, help="Do it without asking.")
@click.option("--progress", "forget", is_flag=True, help="Delete its recorded progress as well.")
@options
@body
def reset(session: Session, name: str, force: bool, forget: bool) -> int:
    """Start NAME over; your answer is kept under a numbered name."""
    card = catalogue.card(name)
    code = RIGHT
    if forget:
        path = workspace.answer(session.work, card.name)
        blocked = path.exists() and not workspace.is_untouched(path, card) and not force
        if blocked and not session.may_replace(f"Start {name} over and forget its progress?"):
            raise Misuse(
                f"{workspace.shown(path)} was left as it is. drills reset {name} --progress "
                "--force starts over and keeps a copy."
            )
        progress.forget(session.progress_file, card.name)
        force = True
        session.say(f"The progress of {name} is forgotten.")
    code = _start(session, card, force, "reset")
    return code


@cli.command()
@options
@body
def status(session: Session) -> int:
    """Show your progress, chapter by chapter."""
    loaded, terminal = session.records(), session.terminal
    cards = catalogue.cards()
    rows: list[dict[str, Any]] = []
    standings = agenda.standings(loaded)
    for one in standings:
        here, number = one.cards, one.chapter.number
        states = [loaded.of(card.name).state for card in here]
        solved = states.count(SOLVED)
        rows.append(
            {
                "chapter": number,
                "title": one.chapter.title,
                "exercises": len(here),
                "solved": solved,
                "attempted": states.count(ATTEMPTED),
                "sections": len(one.sections),
                "read": len(one.sections) - len(one.unread),
                "reading_minutes": one.reading_minutes,
                "exercise_minutes": one.exercise_minutes,
                "checkpoint": one.checkpoint or None,
                "tried": loaded.reading(number).tried,
            }
        )
        label = f"Chapter {number}: {one.chapter.title}"
        room = terminal.width - 10 - 2 - 16
        label = task_text.cut(label, room)
        drawn = terminal.paint(bar(solved, len(here)), "good")
        session.say(f"{label:<{room}}  {drawn} {solved:>2} of {len(here):<2} solved")
        if one.sections:
            passed = f"passed on {one.checkpoint[:10]}" if one.checkpoint else "open"
            session.say(
                f"      {len(one.sections) - len(one.unread)} of {len(one.sections)} sections "
                f"read, checkpoint {passed}"
            )
        for key, state in sorted(loaded.reading(number).tried.items()):
            session.say(f"        {task_text.sign(state, terminal)} {key}")
        for card in here:
            record = loaded.of(card.name)
            if record.attempts or record.hints or record.gave_up:
                session.wrap(_story(card, record), "      ", f"  {_sign(session, record)} ")
    total = sum(row["solved"] for row in rows)
    session.say()
    reading = agenda.duration(sum(one.reading_minutes for one in standings))
    solving = agenda.duration(sum(one.exercise_minutes for one in standings))
    session.say(
        f"{total} of {len(cards)} solved; left: about {reading} to read, {solving} to solve"
    )
    remaining = agenda.to_solve(loaded, list(cards))
    following = remaining[0] if remaining else None
    if following:
        state = loaded.of(following.name).state
        command = "start" if state == NOT_ATTEMPTED else "check"
        session.say(f"Next: drills {command} {following.name}")
    elif cards:
        session.say("All solved.")
    records = {card.name: asdict(loaded.of(card.name)) for card in cards}
    file = session.progress_file
    payload = {
        "chapters": rows,
        "exercises": records,
        "solved": total,
        "total": len(cards),
        "next": following.name if following else None,
        "progress_file": str(file.absolute()) if file else None,
    }
    return session.finish(RIGHT, payload)


def _sign(session: Session, record: Record) -> str:
    return task_text.sign(record.state, session.terminal)


def _story(card: Card, record: Record) -> str:
    parts = [f"{record.attempts} attempt{'s' * (record.attempts != 1)}"]
    if record.solved:
        parts.append(f"solved on {record.solved[:10]}")
    if record.hints:
        parts.append(f"{record.hints} hint{'s' * (record.hints != 1)}")
    if record.gave_up:
        parts.append("solution shown before")
    best = record.best.get("time per call")
    if best and best["unit"] == "s":
        parts.append(f"best {1e6 * best['value']:.3g} us per call")
    return f"{card.name}: {', '.join(parts)}"


cli.add_command(Later("review", "drills.interview.review", "Review what you learned with cards."))
cli.add_command(
    Later("interview", "drills.interview.rehearse", "Rehearse an interview against the clock.")
)


@cli.command(short_help="Check the catalogue of exercises itself.")
@click.argument("names", nargs=-1)
@click.option("--seeds", default=50, show_default=True, type=click.IntRange(1))
@options
@body
def verify(session: Session, names: tuple[str, ...], seeds: int) -> int:
    """Check that every starter fails, every worked answer passes, every known slip is named."""
    from drills.verify import Finding
    from drills.verify import verify as prove

    last = ""

    def report(finding: Finding) -> None:
        nonlocal last
        if finding.exercise != last:
            last = finding.exercise
            session.say(session.terminal.paint(last, "head"))
        word = "ok  " if finding.passed else session.terminal.paint("FAIL", "bad")
        detail = f" ({finding.detail})" if finding.detail else ""
        session.wrap(f"{finding.what}{detail}", "       ", f"  {word} ")

    findings = prove([catalogue.card(n).name for n in names] or None, seeds=seeds, progress=report)
    failed = sum(not finding.passed for finding in findings)
    session.say()
    session.say(f"{len(findings)} findings, {failed} failed" if failed else "All of it holds.")
    payload = {
        "verdict": "fail" if failed else "pass",
        "seeds": seeds,
        "findings": [asdict(finding) for finding in findings],
    }
    return session.finish(WRONG if failed else RIGHT, payload)


cli.add_command(Later("robot", "drills.robot.command", "Build a robot from your answers."))
cli.add_command(Later("debug", "drills.interview.debug", "Debug a program that misbehaves."))


@cli.command(short_help="Draw speed and accuracy of your answer beside a library.")
@NAME
@click.option("--file", "file", metavar="PATH", help="The answer (- for standard input).")
@click.option("--seed", type=SEED, default=0, show_default=True)
@click.option("-o", "--output", metavar="PNG", help="Where to write the picture.")
@options
@body
def chart(session: Session, name: str, file: str | None, seed: int, output: str | None) -> int:
    """Draw the speed and accuracy of your answer beside the reference and a library."""
    card = catalogue.card(name)
    target = Path(output) if output else session.work / f"{card.name}.png"
    return commands.chart(session, card, file, seed, target)


@cli.command(short_help="Show which protections are active, and what is installed.")
@options
@body
def doctor(session: Session) -> int:
    """Show which protections are active, and which tools and libraries are installed."""
    from drills import doctor as examination

    result = examination.examine(session.work, session.progress_file)
    terminal = session.terminal
    for title, rows in result.items():
        session.say(terminal.paint(title.capitalize(), "head"))
        width = max((len(row["name"]) for row in rows), default=0)
        for row in rows:
            good = row["ok"]
            word = terminal.paint("ok ", "good") if good else terminal.paint("off", "warn")
            lead = f"  {word} {row['name']:<{width}}  "
            session.wrap(row["detail"], " " * (width + 8), lead)
        session.say()
    broken = [row for row in result["grader"] if not row["ok"]]
    return session.finish(FAILED if broken else RIGHT, result)


def _card_data(card: Card, record: Record) -> dict[str, Any]:
    return {
        "drill": card.name,
        "title": card.title,
        "chapter": card.chapter,
        "difficulty": card.difficulty,
        "minutes": card.minutes,
        "teaches": card.teaches,
        "entry": card.entry,
        "kind": card.kind,
        "interview": card.drill,
        "state": record.state,
    }
