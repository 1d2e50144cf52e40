"""The commands that grade: one answer, all of them, at every save, and the chart of one."""

from __future__ import annotations

import os
import secrets
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drills import cards as catalogue
from drills import progress, workspace
from drills.cards import Card
from drills.progress import Record
from drills.reasons import Reason
from drills.session import RIGHT, WRONG, Session
from drills.terminal import listed
from drills.workspace import Misuse

if TYPE_CHECKING:
    from drills.grade_report import Report

STANDARD_INPUT = "-"
UNCOUNTED = (Reason.NOT_ATTEMPTED, Reason.UNREADABLE)  # nothing was graded
_LOOKS = 0.2  # s between two looks at a watched file


def check(
    session: Session,
    target: str | None,
    file: str | None,
    seed: int | None,
    rendered: bool = False,
    called: str | None = None,
    case: bool = False,
) -> int:
    """Grade one answer and say what was found; with `case`, only the failed case as code."""
    card, path = _exercise_and_file(session, target, file)
    report = graded(session, card, path, seed, called=called)
    if case and report.case:
        session.say(report.case.rstrip("\n"))
        return session.finish(WRONG, {**_data(session, card, report, path), "picture": None})
    code, payload = report_result(session, card, report, path)
    if called and report.passed:
        put_into_robot(session, card, report.source)
    if rendered:
        from drills import feedback

        plain = feedback.text(report, card, colour=False, unicode=True, width=80)
        html = feedback.html(report, card, _drawn(payload))
        if report.passed and fits_robot(card):
            html += f"<p>Put it into your robot: <code>{fits_robot(card)}</code></p>"
        payload |= {"text": plain, "html": html}
    return session.finish(code, payload)


def check_all(session: Session, seed: int | None) -> int:
    """Grade every answer that is in the work folder; one line each."""
    results: list[dict[str, Any]] = []
    width = max((len(card.name) for card in catalogue.cards()), default=0)
    for card in catalogue.cards():
        path = workspace.answer(session.work, card.name)
        if not os.path.lexists(path):
            continue
        report = graded(session, card, str(path), seed)
        results.append(_data(session, card, report, str(path)))
        word, style, note = "wrong", "bad", report.diagnosis or report.sentence
        if report.passed:
            word, style, note = "right", "good", f"all {len(report.checks)} checks hold"
        elif report.reason is Reason.NOT_ATTEMPTED:
            word, style, note = "open ", "warn", "the starter, untouched"
        word = session.terminal.paint(word, style)
        session.wrap(note, " " * (width + 9), f"{word}  {card.name:<{width}}  ")
    if not results:
        raise Misuse(
            f"There is no answer in {workspace.shown(session.work)} yet. drills start NAME begins."
        )
    right = sum(result["verdict"] == "pass" for result in results)
    session.say()
    session.say(f"{right} of {len(results)} right")
    passed = right == len(results)
    payload = {
        "verdict": "pass" if passed else "fail",
        "right": right,
        "total": len(results),
        "results": results,
    }
    return session.finish(RIGHT if passed else WRONG, payload)


def watch(session: Session, card: Card, file: str | None, seed: int | None) -> int:
    """Grade at once and again at every save; ends by an interrupt only."""
    if file == STANDARD_INPUT:
        raise Misuse("Standard input can't be watched. Give a file.")
    path = _answer_path(session, card, file)
    session.say(f"Watching {workspace.shown(Path(path))}; Ctrl-C ends it.")
    observed: object = None
    while True:
        now = _settled(Path(path))
        if now != observed:
            observed = now
            session.say()
            session.say(session.terminal.paint(f"--- {datetime.now():%H:%M:%S} ---", "dim"))
            if now is None:
                session.say(f"{workspace.shown(Path(path))} is gone; it is graded when it is back.")
            else:
                session.finish(
                    *report_result(session, card, graded(session, card, path, seed), path)
                )
        time.sleep(_LOOKS)


def chart(session: Session, card: Card, file: str | None, seed: int, target: Path) -> int:
    """Measure a right answer against the worked one and a library; write a work-precision diagram.

    Args:
        session: where to print, and how to end.
        card: the exercise.
        file: the answer; by default the one in the work folder.
        seed: of the cases by which it is graded first.
        target: file of the picture; its folder is created.

    Returns:
        The exit code: that of grading for an answer that fails, else `RIGHT`.

    Raises:
        Misuse: for an exercise without a chart, or a file that can't be written.
    """
    path = _answer_path(session, card, file)
    report = graded(session, card, path, seed, quietly=True)
    # A wrong answer has no place on the chart: its error would not shrink with the work.
    if not report.passed:
        session.wrap(f"Only a right answer goes on the chart. {report.sentence}")
        other = "" if file is None else f" --file {workspace.shown(Path(path))}"
        session.say(f"The feedback: drills check {card.name}{other} --seed {seed}")
        return session.finish(WRONG, {**_data(session, card, report, path), "picture": None})
    from drills import chart as charts  # here, as it loads the grader, which other commands spare

    session.seed, session.drill = seed, card.name
    # The answer runs in its sandbox, as it did when it was graded.
    try:
        measured = charts.chart(card.name, report.source, report.filename, seed)
    except charts.NoChart as error:
        raise Misuse(f"{error}.") from None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        picture = charts.picture(measured, target)
    except OSError as error:
        raise Misuse(f"{workspace.shown(target)} can't be written: {error.strerror}.") from None
    table = measured.table()
    session.say(table)
    session.say()
    session.say(f"Wrote {workspace.shown(picture)}")
    payload = {"drill": card.name, "picture": str(picture.absolute()), "table": table, "seed": seed}
    return session.finish(RIGHT, payload)


def _exercise_and_file(session: Session, target: str | None, file: str | None) -> tuple[Card, str]:
    """Return which exercise is meant, and the file of its answer ("-" for standard input)."""
    if target is None and file is None:
        started = [
            card.name
            for card in catalogue.cards()
            if os.path.lexists(workspace.answer(session.work, card.name))
        ]
        other = f" You have started {listed(started, 'and')}." if started else ""
        raise Misuse(f"Say which: drills check NAME, a file, or --all.{other}")
    names = catalogue.names()
    if target is None or (file is None and target not in names and _is_file_like(target)):
        path = file if target is None else target
        assert path is not None
        _must_be_there(path)
        source, why = _read(session, path)
        if source is None and Path(path).stem not in names:
            raise Misuse(f"{why} Say which drill it answers: drills check NAME --file {path}")
        return workspace.chosen_card(path, source), path
    card = catalogue.card(target)
    return card, _answer_path(session, card, file)


def _is_file_like(target: str) -> bool:
    return target == STANDARD_INPUT or "/" in target or "." in target or os.path.lexists(target)


def _answer_path(session: Session, card: Card, file: str | None) -> str:
    if file is not None:
        _must_be_there(file)
        return file
    path = workspace.answer(session.work, card.name)
    if not os.path.lexists(path):
        raise Misuse(
            f"There is no {workspace.shown(path)} yet. drills start {card.name} puts the starter "
            f"there; --file PATH names another file."
        )
    return str(path)


def _must_be_there(path: str) -> None:
    if path == STANDARD_INPUT or os.path.lexists(path):
        return
    stem = Path(path).stem
    known = stem in catalogue.names()
    intended = f" drills check {stem} grades the answer in your work folder." if known else ""
    raise Misuse(f"There is no file {workspace.shown(Path(path))}.{intended}", [stem] * known)


def _read(session: Session, path: str) -> tuple[str | None, str]:
    """Return the text of a submission, or None and why it can't be used."""
    from drills.sandbox.submission import SIZE, Unreadable, decode_submission, read_submission

    try:
        if path != STANDARD_INPUT:
            return read_submission(path), ""
        if session.standard_input is None:
            stream = sys.stdin.buffer if sys.stdin is not None else None
            session.standard_input = stream.read(SIZE + 1) if stream else b""
        return decode_submission(session.standard_input), ""
    except Unreadable as error:
        return None, error.sentence


def graded(
    session: Session,
    card: Card,
    path: str,
    seed: int | None,
    quietly: bool = False,
    called: str | None = None,
) -> Report:
    """Grade, and enter the attempt into the progress."""
    from drills.grade_report import Report
    from drills.grader import grade

    session.drill = card.name
    session.seed = secrets.randbits(32) if seed is None else seed
    from_pipe = path == STANDARD_INPUT
    filename = called or ("standard input" if from_pipe else workspace.shown(Path(path)))
    source, why = _read(session, path)
    if source is None:
        report = Report(card.name, session.seed, filename, "", Reason.UNREADABLE, why)
    else:
        report = grade(card.name, source, filename=filename, seed=session.seed)
    if report.reason not in UNCOUNTED and not quietly:
        costs = {cost.what: (cost.yours, cost.unit) for cost in report.costs}

        def enter(record: Record) -> None:
            diagnosis = report.diagnosis or report.sentence
            progress.note_attempt(record, report.passed, costs, diagnosis=diagnosis)

        session.record(card.name, enter)
    return report


def report_result(
    session: Session, card: Card, report: Report, path: str
) -> tuple[int, dict[str, Any]]:
    """Print the feedback and return the exit code and payload."""
    from drills import feedback

    terminal = session.terminal
    if not terminal.json:
        text = feedback.text(
            report, card, colour=terminal.colour, unicode=terminal.unicode, width=terminal.width
        )
        session.say(text.rstrip("\n"))
        if not report.passed and report.reason not in UNCOUNTED:
            if report.case:
                file = "" if path == str(workspace.answer(session.work, card.name)) else path
                where = f" --file {workspace.shown(Path(file))}" if file else ""
                command = f"drills check {card.name}{where} --seed {report.seed} --case"
                lead = "The case as code:"
                if len(f"{lead} {command}") > terminal.width:  # the command is on a line of its own
                    session.say(lead)
                    lead = " "
                session.say(f"{lead} {command}")
            session.say(f"A hint: drills hint {card.name}")
        elif report.passed:
            session.say(f"The worked answer: drills solution {card.name}")
            if fits_robot(card):
                session.say(f"Put it into your robot: {fits_robot(card)}")
    drawn = _pictured(session, card, report)
    if drawn is not None:
        session.say(f"A picture of it: {workspace.shown(drawn)}")
    data = _data(session, card, report, path)
    data["picture"] = None if drawn is None else str(drawn.absolute())
    return (RIGHT if report.passed else WRONG), data


def fits_robot(card: Card) -> str:
    """Return the command that tries an answer in the robot, or "" where no slot takes it."""
    from drills.robot.slots import NAMED

    return "drills robot run" if card.name in NAMED else ""


def put_into_robot(session: Session, card: Card, source: str) -> None:
    """Save an answer from a notebook as the file of its slot, unless there is an answer already."""
    path = workspace.answer(session.work, card.name)
    free = not os.path.lexists(path) or workspace.is_untouched(path, card)
    if not fits_robot(card) or session.progress_file is None or not free:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workspace.write_over(path, source)
    except OSError as error:
        session.notices.append(f"{workspace.shown(path)} can't be written: {error.strerror}.")


def _pictured(session: Session, card: Card, report: Report) -> Path | None:
    """Return the picture of the case that failed, in the work folder; an older one goes."""
    from drills import picture

    target = session.work / f"{card.name}.case.png"
    try:
        drawn = picture.write(report, target)
        if drawn is None:
            target.unlink(missing_ok=True)
        return drawn
    except OSError:
        return None  # no room or no right to write there: the words are enough


def _drawn(payload: dict[str, Any]) -> bytes:
    """Return the content of the picture that was written, or nothing."""
    return Path(payload["picture"]).read_bytes() if payload["picture"] else b""


def _data(session: Session, card: Card, report: Report, path: str) -> dict[str, Any]:
    from drills import feedback

    data = feedback.as_dict(report, card)
    state = progress.load(session.progress_file).of(card.name).state
    file = None if path == STANDARD_INPUT else str(Path(path).absolute())
    return {**data, "file": file, "state": state}


def _settled(path: Path) -> object:
    """Return what identifies a version of the file, once it has stopped changing.

    It returns None if the file is gone.
    """
    before = _version(path)
    while True:
        time.sleep(_LOOKS / 4)
        now = _version(path)
        if now == before:
            return now
        before = now


def _version(path: Path) -> tuple[int, int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino
