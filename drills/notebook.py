"""Exercises in a notebook: cards, badges, `check` for what a cell defines, and the home page.

    from drills.notebook import badges, card, check, home

    check(my_function)

The kernel only reads the source. It is graded by a fresh process, which runs the submission in a
process of its own, so nothing that a submission does can reach the kernel.
"""

from __future__ import annotations

import difflib
import functools
import html as markup
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from course import CHAPTERS
from course.check import one_of
from drills import agenda, chapters, json_store, progress, task_text, workspace
from drills import cards as catalogue
from drills.cards import Card
from drills.cell_source import Assembled, Borrowed, Unusable, assemble, defined_by, own_source
from drills.chapters import Section
from drills.progress import ATTEMPTED, NOT_ATTEMPTED, SOLVED
from drills.reasons import Reason
from drills.robot.slots import NAMES as SLOT_NAMES
from drills.terminal import listed

if TYPE_CHECKING:
    from course.cards import Gate

TRIED = ("derivation", "lab", "design")
_CELL = "your cell"
_GRACE = 5.0  # s that an interrupted grader has to end its child
# Text and ground are both set, so that a light and a dark page show the same contrast.
_BADGE_COLOURS = {
    NOT_ATTEMPTED: ("#5f6368", "#ffffff"),
    ATTEMPTED: ("#8a5300", "#ffffff"),
    SOLVED: ("#1b6e35", "#ffffff"),
}


class Shown:
    """Something to look at: HTML or Markdown in a notebook, plain text elsewhere."""

    def __init__(self, text: str, html: str = "", markdown: str = "", png: bytes = b"") -> None:
        self._bundle = {"text/plain": text}
        if html:
            self._bundle["text/html"] = html
        if markdown:
            self._bundle["text/markdown"] = markdown
        self._png = png

    def __repr__(self) -> str:
        return self._bundle["text/plain"]

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return {**self._bundle, **({"image/png": self._png} if self._png else {})}


class Result(Shown):
    """The verdict on what a cell defines.

    Attributes:
        drill: name of the exercise, "" when none fits.
        passed: whether it is right.
        reason: a `drills.reasons.Reason`; None if the grader itself could not run.
        sentence: what that means here.
        carried: what came along from other cells.
        details: the whole report, as `drills check --json` gives it; {} when nothing was graded.
    """

    def __init__(
        self,
        drill: str,
        reason: Reason | None,
        sentence: str,
        text: str,
        html: str,
        carried: list[str] | None = None,
        details: dict[str, Any] | None = None,
        source: str = "",
    ) -> None:
        super().__init__(text, html)
        self.drill = drill
        self.reason = reason
        self.passed = reason is Reason.RIGHT
        self.sentence = sentence
        self.carried = carried or []
        self.details = details or {}
        self._source = source

    @property
    def case(self) -> str:
        """The first case that failed as code, to paste into a cell; "" where there is none."""
        return self.details.get("case") or ""

    def chart(self) -> Shown:
        """Return the speed against accuracy: this answer beside the reference and a library."""
        if not self.passed:
            return Shown("Only a right answer goes on the chart.")
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "chart.png"
            options = ["--file", "-", "-o", str(picture), "--json"]
            data = _run(["chart", self.drill, *options], self._source)
            if "error" in data:
                return Shown(data["error"]["message"])
            if not picture.exists():
                return Shown(data.get("sentence", "There is no picture."))
            return Shown(data["table"], png=picture.read_bytes())


def check(obj: Any, name: str | None = None, seed: int | None = None) -> Result:
    """Grade a function or a class that a cell defines.

    Args:
        obj: the function or class itself.
        name: of the exercise; found by the name of `obj` if None.
        seed: of the hidden cases, to repeat a run; drawn afresh if None.

    Returns:
        The verdict; its last line in a cell shows it. A mistake of the learner never raises.

    Raises:
        KeyboardInterrupt: when the cell is interrupted; the grading has then ended.
    """
    try:
        card = _card_for(obj, name)
    except (Unusable, catalogue.UnknownExercise) as error:
        return _ungraded(None, Reason.MISSING_NAME, str(error))
    try:
        parts = assemble(obj)
    except Unusable as error:
        return _ungraded(card, Reason.UNREADABLE, str(error))
    except Borrowed as error:
        return _untouched(card, obj) or _ungraded(card, Reason.BORROWED_NAME, str(error))
    return _untouched(card, parts) or _graded(card, parts, seed)


def card(name: str) -> Shown:
    """Return the card of an exercise: what it is about, the task, the hints to unfold.

    Raises:
        UnknownExercise: with the nearest names.
    """
    one = catalogue.card(name)
    facts = f"difficulty {one.difficulty} of 5, about {one.minutes} minutes"
    parts = [
        f"### {one.title}",
        f"*{facts}. It teaches: {one.teaches}.*",
        task_text.task(one).strip(),
    ]
    pairs = task_text.examples(one)
    if pairs:
        lines = [line for call, answer in pairs for line in (f">>> {call}", answer)]
        parts.append("```python\n" + "\n".join(lines) + "\n```")
    for number, hint in enumerate(one.hints, 1):
        parts.append(
            f"<details><summary>Hint {number}: {_escaped(hint.symptom)}</summary>\n\n"
            f"{hint.text}\n\n</details>"
        )
    plain = [f"{one.title} ({facts})", "", task_text.task(one).strip(), ""]
    plain += [f"Hint {number}: {hint.symptom}" for number, hint in enumerate(one.hints, 1)]
    return Shown("\n".join(plain), markdown="\n\n".join(parts))


def badges(chapter: int) -> Shown:
    """Return a row with the state of each exercise of a chapter: not attempted, attempted, solved.

    Derivations, labs and designs join it once they were tried. While progress is kept, the answers
    to the cards of the notebook are kept as well, and their score stands below.

    It stands at the top of a chapter, so the chapter counts as opened.
    """

    def opened(reading: progress.Reading) -> None:
        reading.opened = progress.timestamp()

    loaded = _noted(chapter, opened)
    spans, words = [], []
    here = [
        (one.name, one.title, loaded.of(one.name).state)
        for one in catalogue.cards()
        if one.chapter == chapter
    ]
    here += [(key, key, state) for key, state in sorted(loaded.reading(chapter).tried.items())]
    for name, title, state in here:
        ground, ink = _BADGE_COLOURS[state]
        sign, word = task_text.STATE_SIGNS[state], task_text.STATE_WORDS[state]
        spans.append(
            f'<span title="{_escaped(title)}" style="display:inline-block;'
            f"margin:2px 6px 2px 0;padding:2px 10px;border-radius:10px;background:{ground};"
            f'color:{ink};white-space:nowrap">{sign} {_escaped(name)}: {word}</span>'
        )
        words.append(f"{sign} {name}: {word}")
    if not words:
        return Shown(f"Chapter {chapter} has no graded exercises.")
    notes = "".join(f"<p>{_escaped(notice)}</p>" for notice in loaded.notices)
    html = f"<div>{''.join(spans)}</div>{notes}"
    if _progress_file() is None:
        return Shown("\n".join([*words, *loaded.notices]), html=html)
    return Badges(chapter, "\n".join([*words, *loaded.notices]), html, loaded.reading(chapter))


class Badges(Shown):
    """The state of the exercises of a chapter, and the score of its cards, kept at every click."""

    def __init__(self, chapter: int, text: str, html: str, reading: progress.Reading) -> None:
        from drills import answered

        def store(card: str, answer: int) -> progress.Reading:
            return _noted(chapter, lambda r: answered.note(r, card, answer)).reading(chapter)

        score = answered.score(reading)
        super().__init__(
            "\n".join(filter(None, [text, score])), f"{html}<p>{score}</p>" if score else html
        )
        self._html, self._reading, self._store = html, reading, store

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        import ipywidgets

        from drills import answered

        view = ipywidgets.VBox(
            [ipywidgets.HTML(self._html), answered.Listener(self._reading, self._store)]
        )
        return {**view._repr_mimebundle_(), **super()._repr_mimebundle_()}


class RobotButton(Shown):
    """Some of the robot's slots, and a button that lets the robot play tasks.

    Attributes:
        button: runs a command of `drills robot` when it is pressed.
        result: what the command reports.
    """

    def __init__(self, command: list[str], label: str, text: str, html: str, slots: str) -> None:
        import ipywidgets

        super().__init__(text, html=html)
        self._command = command
        self.button = ipywidgets.Button(description=label, layout=ipywidgets.Layout(width="auto"))
        self.result = ipywidgets.HTML()
        self.button.on_click(self._pressed)
        self._view = ipywidgets.VBox([ipywidgets.HTML(slots), self.button, self.result])

    def _pressed(self, button: Any) -> None:
        button.disabled = True
        self.result.value = "<p>The robot is playing its tasks. That takes up to two minutes.</p>"
        try:
            data = _run(["robot", *self._command, "--json"], "")
            lines = [data["error"]["message"]] if "error" in data else data["lines"]
            lines += data.get("notices", [])
            self.result.value = "".join(f"<p>{_escaped(line)}</p>" for line in lines)
        finally:
            button.disabled = False

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return {**self._view._repr_mimebundle_(), **super()._repr_mimebundle_()}


_ROBOT_TEXT = {
    8: "This chapter adds no part to your robot. It adds the flag --twin: "
    "with it, the arm that your robot drives differs from its model by a gap of 0.25. (This arm is "
    "not the MuJoCo twin of section 3.) The button plays your robot with the exact arm and with "
    "that one.",
    9: "Put it into your robot. None of this chapter's exercises is a part of it. But you can run "
    "any of its parts from a file of yours, such as a trained policy in place of the controller: "
    "drills robot run --own control=FILE.py. The button compares your whole robot with the "
    "course's.",
    10: "The button plays your robot with fresh images and with images that arrive late.",
}


def your_robot(chapter: int | None = None) -> Shown:
    """Return the slots that a chapter fills in the robot, and a button that tries your parts there.

    Where no kernel runs or no progress is stored, the command to type stands there instead.

    Args:
        chapter: its number; None for the whole robot, with a button that plays its next level.
    """
    from drills.robot.chapters import slots_of
    from drills.robot.slots import NAMED

    if chapter is None:
        return _whole_robot()
    command = f"drills robot compare --chapter {chapter}"
    names = slots_of(chapter)
    about = _ROBOT_TEXT.get(
        chapter, "The button compares your parts with the course's on the same tasks and noise."
    )
    listing = "".join(
        f"<li><code>{name}</code>: {_escaped(NAMED[name].does)}</li>" for name in names
    )
    slots = f"<p>In your robot this chapter fills:</p><ul>{listing}</ul>" if names else ""
    # Without a kernel there is no button, so the sentence names what does the same.
    typed = about.replace("The button", f"<code>{command}</code>, typed in a terminal,")
    plain = [f"{name}: {NAMED[name].does}" for name in names]
    text = "\n".join([*plain, about.replace("The button", f"{command}, typed in a terminal,")])
    html = f"{slots}<p>{typed}</p>"
    if _progress_file() is None:
        return Shown(text, html=html)
    states = progress.load(_progress_file())
    rows = "".join(
        f"<li><code>{name}</code>: {_escaped(NAMED[name].does)}, "
        f"{_escaped(task_text.STATE_WORDS[states.of(name).state])}</li>"
        for name in names
    )
    head = f"<p>In your robot this chapter fills:</p><ul>{rows}</ul>" if names else ""
    arguments = ["compare", "--chapter", str(chapter)]
    shown = f"{head}<p>{_escaped(about)}</p>"
    return RobotButton(arguments, "Put it into your robot", text, html, shown)


def _whole_robot() -> Shown:
    """Return who holds the robot's slots, the levels that are passed, and a button to play."""
    from drills.robot import store
    from drills.robot.levels import LEVELS
    from drills.robot.slots import STAGES, of_stage

    loaded = progress.load(_progress_file())
    rows = []
    for stage in STAGES:
        names = [slot.name for slot in of_stage(stage)]
        mine = [name for name in names if loaded.of(name).state == SOLVED]
        open_ = [name for name in names if name not in mine]
        rows.append((stage, f"{len(mine)} of {len(names)} parts are yours", open_[:1]))
    path = store.path_of(workspace.folder(), _progress_file())
    stored, notices = json_store.load(path, store.FORM)
    passed = [str(one.number) for one in LEVELS if str(one.number) in stored.passed]
    levels = f"Levels passed: {', '.join(passed) or 'none yet'} of {len(LEVELS)}."
    start = "drills robot, typed in a terminal, shows your robot; drills robot run lets it work."
    lines = [
        f"{stage}: {count}{f'; next: drills start {names[0]}' if names else ''}"
        for stage, count, names in rows
    ]
    text = "\n".join([*lines, levels, *loaded.notices, *notices])
    html = "".join(f"<li>{_escaped(line)}</li>" for line in lines)
    html = f"<ul>{html}</ul><p>{levels}</p>"
    if _progress_file() is None:
        return Shown(f"{text}\n{start}", html=f"{html}<p>{start}</p>")
    label = "Play 200 tasks at the next level"
    return RobotButton(["run", "--no-libraries"], label, f"{text}\n{start}", html, html)


def checkpoint(
    topic: str, answers: Sequence[str] | None = None, seed: int = 1, **formulas: str
) -> Gate:
    """Return the checkpoint at the end of a chapter, `course.cards.checkpoint`.

    A chapter's first pass is kept, whatever the draw.

    Raises:
        ValueError: for a topic without a checkpoint, or answers that do not fit its questions.
    """
    from course import cards

    shown = cards.checkpoint(topic, answers, seed, **formulas)
    if shown.passed:
        (number,) = [chapter.number for chapter in CHAPTERS if chapter.topic == topic]
        notices = _noted(number, progress.note_checkpoint).notices
        shown.text = "\n".join([shown.text, *notices])
        shown.markdown = "\n\n".join([shown.markdown, *notices])
    return shown


def answer(claim: str, text: str) -> Any:
    """Check a formula, `course.derivations.answer`; the attempt is kept, unless it is blank.

    Raises:
        ValueError: for an unknown claim, or one that asks for no formula.
    """
    from course import derivations

    result = derivations.answer(claim, text)
    if text.strip():
        tried("derivation", claim, derivations.CLAIMS[claim].chapter, result.correct)
    return result


def tried(kind: str, name: str, chapter: int, passed: bool = False) -> None:
    """Keep an attempt at something that is no exercise, for the badges of its chapter.

    Args:
        kind: "derivation", "lab" or "design".
        name: of it.
        chapter: its number.
        passed: whether it was solved.

    Raises:
        ValueError: for another kind.
    """
    key = f"{one_of('kind', kind, TRIED)}/{name}"
    _noted(chapter, lambda reading: progress.note_tried(reading, key, passed))


def home() -> Shown:
    """Return the home page: where to go on, what is read and solved, and the time that is left."""
    loaded = progress.load(_progress_file())
    standing = agenda.standings(loaded)
    reading = agenda.to_read(loaded, standing)
    solving = agenda.to_solve(loaded, list(catalogue.cards()))
    lines = []
    if reading:
        chapter, part = reading
        link = chapter.notebook.removeprefix("notebooks/")
        minutes = agenda.duration(part.about)
        lines.append(
            f"**Go on here:** [chapter {chapter.number}, section {part.number}: {part.title}]"
            f"({link}), about {minutes}."
        )
    if solving:
        one = solving[0]
        lines.append(
            f"**Next exercise:** `{one.name}`, {one.title} (chapter {one.chapter}, difficulty "
            f"{one.difficulty} of 5, about {one.minutes} min)."
        )
    if not lines:
        lines.append("**All is read and solved.**")
    slots = [name for name in SLOT_NAMES if loaded.of(name).state == SOLVED]
    lines.append(
        f"**Your robot:** {len(slots)} of {len(SLOT_NAMES)} parts are yours. `drills robot` in a "
        "terminal shows it, and lets it work."
    )
    table = [
        "| | chapter | read | solved | left to read | left to solve | checkpoint |",
        "|---:|---|---|---|---:|---:|---|",
    ]
    for row in standing:
        chapter = row.chapter
        link = chapter.notebook.removeprefix("notebooks/")
        title = f"[{chapter.title}]({link})" if row.sections else chapter.title
        read = f"{len(row.sections) - len(row.unread)} of {len(row.sections)} sections"
        signs = "".join(task_text.STATE_SIGNS[loaded.of(card.name).state] for card in row.cards)
        passed = f"passed on {row.checkpoint[:10]}" if row.checkpoint else "open"
        table.append(
            f"| {chapter.number} | {title} | {read if row.sections else 'coming'} | {signs} "
            f"| {agenda.duration(row.reading_minutes) if row.sections else ''} "
            f"| {agenda.duration(row.exercise_minutes)} | {passed if row.sections else ''} |"
        )
    signs = ", ".join(
        f"{task_text.STATE_SIGNS[s]} {task_text.STATE_WORDS[s]}" for s in progress.STATES
    )
    other = [row for row in standing if row.sections]
    to_read = agenda.duration(sum(row.reading_minutes for row in other))
    to_solve = agenda.duration(sum(row.exercise_minutes for row in other))
    foot = f"In the chapters that are there: about {to_read} to read and {to_solve} to solve."
    page = "\n\n".join([*lines, "\n".join(table), f"{foot} {signs}.", *loaded.notices])
    return Shown(re.sub(r"\]\([^)]*\)|[*`\[]", "", page), markdown=page)


class Ticks(Shown):
    """The sections of a chapter to tick off, and how long the others take; kept at every click.

    Attributes:
        boxes: the check boxes by number of the section.
        status: the label that says what remains to be read.
    """

    def __init__(self, chapter: int, parts: list[Section]) -> None:
        import ipywidgets

        self._chapter, self._parts = chapter, parts
        self.status = ipywidgets.Label()
        read = progress.load(_progress_file()).reading(chapter).read
        self.boxes = {
            part.number: ipywidgets.Checkbox(
                value=part.number in read,
                description=f"{part.number} · {part.title} (about {part.about} min)",
                indent=False,
                layout=ipywidgets.Layout(width="auto"),
            )
            for part in parts
        }
        for number, one in self.boxes.items():
            one.observe(functools.partial(self._clicked, number), names="value")
        self._show_status(())
        self._view = ipywidgets.VBox([self.status, *self.boxes.values()])
        super().__init__(f"The sections of chapter {chapter}: run this cell to tick them off.")

    def _clicked(self, number: int, change: dict[str, Any]) -> None:
        loaded = _noted(
            self._chapter,
            lambda reading: progress.note_read(reading, [number], undo=not change["new"]),
        )
        self._show_status(loaded.notices)

    def _show_status(self, notices: Sequence[str]) -> None:
        unread = [part.minutes for part in self._parts if not self.boxes[part.number].value]
        time = agenda.duration(round(sum(unread)))
        remaining = f"{len(unread)} of {len(self._parts)} sections left, about {time}."
        self.status.value = " ".join([f"Chapter {self._chapter}: {remaining}", *notices])

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        return {**self._view._repr_mimebundle_(), **super()._repr_mimebundle_()}


def ticks(chapter: int | None = None) -> Shown:
    """Return the sections of a chapter to tick off as read; of the one to go on with if None."""
    if chapter is None:
        loaded = progress.load(_progress_file())
        place = agenda.to_read(loaded, agenda.standings(loaded))
        if place is None:
            return Shown("Every section is read.")
        chapter = place[0].number
    return Ticks(chapter, chapters.sections(chapters.notebook_of(chapters.of_number(chapter))))


def solution(name: str, give_up: bool = False) -> Shown:
    """Return the worked answer of an exercise, after a pass or with `give_up=True`.

    Raises:
        UnknownExercise: with the nearest names.
    """
    one = catalogue.card(name)
    arguments = ["solution", one.name, "--json", *(["--give-up"] if give_up else [])]
    data = _run(arguments, "")
    if "error" in data:
        if data["error"]["kind"] != "misuse":
            return Shown(data["error"]["message"])
        return Shown(
            f"{one.name} is not solved yet. solution({one.name!r}, give_up=True) shows the answer, "
            "and your progress will say so."
        )
    text = data["solution"]
    return Shown(text, markdown=f"```python\n{text}```\n\n{one.insight}")


def _card_for(obj: Any, name: str | None) -> Card:
    if name is not None:
        return catalogue.card(name)
    cards = catalogue.cards()
    if isinstance(obj, str):
        raise Unusable(f"check takes the function itself, not its name: check({obj}).")
    defined = defined_by(obj)
    if not defined:
        raise Unusable(
            f"check takes the function or the class itself, not a value of type "
            f"{type(obj).__name__}: check(my_function), without calling it."
        )
    for one in cards:
        if one.entry == defined:
            return one
    near = difflib.get_close_matches(defined, [one.entry for one in cards], n=3, cutoff=0.7)
    intended = f" Did you mean {listed(near)}?" if near else ""
    raise Unusable(f"No exercise asks for {defined}.{intended}")


def _untouched(card: Card, what: Any) -> Result | None:
    """Return the result for a starter that is as it was, else None.

    It is no attempt: nothing is kept.
    """
    from drills.grader import is_starter

    source = what.source if isinstance(what, Assembled) else own_source(what)
    if not is_starter(card, source):
        return None
    from drills import feedback
    from drills.grade_report import Report
    from drills.reasons import SENTENCES

    reason = Reason.NOT_ATTEMPTED
    report = Report(card.name, 0, _CELL, source, reason, SENTENCES[reason])
    text = f"{card.name}: not attempted yet. Write {card.entry} above, then run this cell again."
    return Result(card.name, reason, SENTENCES[reason], text, feedback.html(report, card))


def _ungraded(card: Card | None, reason: Reason | None, sentence: str) -> Result:
    """Return a verdict that needs no grading."""
    title = _escaped(card.title) if card else ""
    html = (
        '<div style="border-left:4px solid #c62828;padding:2px 0 2px 12px"><p><span style="'
        'background:#c62828;color:#fff;border-radius:4px;padding:1px 8px;font-weight:600">'
        f"Not graded</span> <b>{title}</b></p><p>{_escaped(sentence)}</p></div>"
    )
    name = card.name if card else ""
    return Result(name, reason, sentence, f"{name}: {sentence}" if name else sentence, html)


def _graded(card: Card, parts: Assembled, seed: int | None) -> Result:
    command = ["check", card.name, "--file", "-", "--json", "--rendered", "--called", _CELL]
    command += ["--seed", str(seed)] if seed is not None else []
    data = _run(command, parts.source)
    if "error" in data:
        return _ungraded(card, None, data["error"]["message"])
    text, html = data.pop("text"), data.pop("html")
    if parts.carried:
        note = f"Graded with what it uses from other cells: {', '.join(parts.carried)}."
        text += f"\n{note}\n"
        html += f"<p><small>{_escaped(note)}</small></p>"
    for notice in data["notices"]:
        text += f"\nNote: {notice}\n"
        html += f"<p><small>Note: {_escaped(notice)}</small></p>"
    reason = Reason(data["reason"])
    return Result(
        card.name, reason, data["sentence"], text, html, parts.carried, data, parts.source
    )


def _run(arguments: list[str], text: str) -> dict[str, Any]:
    """Run a command in a fresh process and return its line of JSON.

    An interrupt ends the process, and with it what it has started, and is then raised on.
    """
    # Without -P the notebook's folder would come first, and a file numpy.py there be imported.
    command = [sys.executable, "-P", "-m", "drills", *arguments]
    search = [str(workspace.ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,  # the interrupt of a cell reaches the kernel alone
        env={**os.environ, "PYTHONPATH": os.pathsep.join(search), "PYTHONIOENCODING": "utf-8"},
    )
    try:
        out, errors = process.communicate(text.encode("utf-8", "surrogatepass"))
    except BaseException:
        _end(process)
        raise
    lines = out.decode("utf-8", "replace").strip().splitlines()
    try:
        data = json.loads(lines[-1])
    except (IndexError, ValueError):
        reported = errors.decode("utf-8", "replace").strip().splitlines()
        what = reported[-1] if reported else f"exit code {process.returncode}"
        message = f"The grader itself could not run ({what}). drills doctor may say why."
        return {"error": {"kind": "grader", "message": message}}
    assert isinstance(data, dict)
    return data


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the grader: asked first, so that it ends its own child, then killed."""
    for number in (signal.SIGINT, signal.SIGKILL):
        try:
            process.send_signal(number)
            process.wait(_GRACE)
            break
        except subprocess.TimeoutExpired:
            continue
    for pipe in (process.stdin, process.stdout, process.stderr):
        if pipe is not None:
            pipe.close()


def _escaped(text: str) -> str:
    # Dollar signs would start a formula in a notebook.
    return markup.escape(text).replace("$", "&#36;")


def _noted(chapter: int, edit: Callable[[progress.Reading], None]) -> progress.Loaded:
    """Enter something on a chapter; where that can't be written, what there is and why."""
    try:
        return progress.change_chapter(_progress_file(), chapter, edit)
    except json_store.Problem as problem:
        loaded = progress.load(_progress_file())
        return progress.Loaded(loaded.records, loaded.chapters, (*loaded.notices, str(problem)))


def _progress_file() -> Path | None:
    return workspace.progress_file(workspace.folder())
