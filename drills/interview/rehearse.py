"""The command `drills interview`: ask, take answers and marks, and store every line at once."""

from __future__ import annotations

import contextlib
import json
import re
import secrets
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from course import CHAPTERS
from course.derivations.records import figure
from course.interview import rehearsal, scenarios
from course.interview.rehearsal import MARKS, PARTS, Entry, Interview, Item
from drills import cards as catalogue
from drills import commands, json_store, task_text, workspace
from drills.chapters import notebook_of
from drills.feedback import clean
from drills.interview import LONGEST_LINE, deck, listen, read_line, store, was_cut
from drills.interview import debug as debugging
from drills.plain_math import plain
from drills.progress import SOLVED
from drills.session import RIGHT, Session, body, options
from drills.terminal import OutputLost, listed
from drills.workspace import Misuse

_TYPED = ("answer", "clarified", "reply")  # texts of an entry that come line by line
EVERY = frozenset(chapter.number for chapter in CHAPTERS)
NONE_OPEN = "You have no unfinished interview. drills interview starts one."
ASSUME = (
    "I have no answer to that as you word it. Ask it in other words, or make an assumption and "
    "state it."
)
WHITEBOARD = "Write the code here, as you would at a whiteboard, and explain it. It is not run."
QUIT = "stop without a conclusion; the interview continues"
MEANING = {  # of each mark
    "missing": "you did not mention it",
    "named": "you mentioned it",
    "quantified": "you also gave a number or a reason",
    "defended": "you also said what would change your mind",
}


@dataclass
class Past:
    """The unfinished interviews, by the time of their start, and the results of the others.

    Attributes:
        open: unfinished interviews, which can be resumed.
        scores: key of an item -> share of the marks, the last time.
        last: keys of the last interview's questions.
    """

    open: dict[str, Interview] = field(default_factory=dict)
    scores: dict[str, float] = field(default_factory=dict)
    last: list[str] = field(default_factory=list)


def _parse(content: dict[str, Any]) -> Past:
    try:
        opened = {
            name: Interview(**(one | {"items": [Entry(**entry) for entry in one["items"]]}))
            for name, one in content["open"].items()
        }
        return Past(opened, {k: float(v) for k, v in content["scores"].items()}, content["last"])
    except (TypeError, KeyError, ValueError, AttributeError):
        raise json_store.Damaged from None


FORM = json_store.Form("drills-interviews/1", "interviews", Past, _parse, asdict)


def pool(chosen: frozenset[int] = EVERY) -> dict[str, Item]:
    """Return the items of the chosen chapters, by key."""
    items = rehearsal.spoken([c.topic for c in CHAPTERS if c.number in chosen])
    for card in catalogue.cards():
        if card.chapter in chosen:
            rest = (card.chapter, card.minutes, card.title, (card.teaches,), (), card.insight)
            items.append(Item(f"drill/{card.name}", "coding", *rest))
    return {item.key: item for item in items}


LONGEST = 50_000  # characters of an answer; an hour of speech has about as many
OPEN = 5  # largest number of unfinished interviews


def waiting_input() -> bool:
    """Return whether a terminal has more input already, as after a pasted text."""
    import select

    if not sys.stdin.isatty():
        return False
    return bool(select.select([sys.stdin], [], [], 0.1)[0])


@dataclass
class Talk:
    """One interview in a terminal or a pipe.

    Attributes:
        session: where it writes, and the work folder.
        read_line: returns the next line that is typed; EOFError at the end.
        clock: the time, aware.
        editor: whether an editor can be opened.
        waiting: whether there is input that was typed or pasted before the prompt.
    """

    session: Session
    read_line: Callable[..., str] = read_line
    clock: Callable[[], datetime] = lambda: datetime.now(UTC)
    editor: bool = False
    waiting: Callable[[], bool] = waiting_input

    def __post_init__(self) -> None:
        self.last_look = self.clock()
        self.folder = self.session.work / "interview"
        progress = self.session.progress_file
        self.file = progress and progress.with_name("interviews.json")

    def draw(
        self, minutes: int, seed: int | None, chosen: frozenset[int], parts: tuple[str, ...]
    ) -> None:
        """Draw the items of a new interview."""
        past, records = self.past(), self.session.records().records.items()
        weak = {key for key, score in past.scores.items() if score < rehearsal.WEAK}
        weak |= {card.key for card in self.due()}
        weak |= {f"drill/{n}" for n, r in records if r.attempts and r.state != SOLVED}
        seed = secrets.randbits(32) if seed is None else seed
        items, last = list(pool(chosen).values()), set(past.last)
        if past.open:
            last |= {entry.key for entry in past.open[max(past.open)].items}
            for text in self.describe_open(past):
                self.session.wrap(text)
                self.session.notices += [text] * self.session.terminal.json
        items = rehearsal.usual(items, minutes, parts, last)
        try:
            drawn = rehearsal.draw(items, parts, minutes, weak, last, seed)
        except ValueError:
            raise Misuse(
                "These chapters and kinds have no questions besides those of the last interview."
            ) from None
        entries = [
            Entry(i.key, i.part, i.chapter, i.minutes, i.title.partition("\n")[0]) for i in drawn
        ]
        if left_out := [part for part in parts if part not in {item.part for item in drawn}]:
            what = ", ".join(left_out)
            self.session.notices.append(
                f"This interview has no part of the kind {what}: the time is too short, or no "
                "other question is left."
            )
        self.interview = Interview(
            self.last_look.isoformat(timespec="milliseconds"), seed, minutes, entries
        )

    def announce(self) -> None:
        """Print what comes: the number of items, and the kind and the minutes of each."""
        items = self.interview.items
        planned = sum(entry.minutes for entry in items)
        forms = [f"{rehearsal.form(entry)} ({entry.minutes} min)" for entry in items]
        self.session.wrap(
            f"{questions(len(items))}, planned for {planned} of your {self.interview.minutes} "
            f"minutes: {listed(forms, 'and')}."
        )

    def describe_open(self, past: Past) -> list[str]:
        """Return sentences on the interviews that were stopped before they were finished."""
        ended = [name for name in past.open if is_ended(past.open[name])]
        texts = [
            f"Your interview of {local_time(name)} was stopped before its report was complete: "
            "nothing is lost, and drills interview --resume NUMBER shows it. The list (drills "
            "interview --list) has the number."
            for name in ended
        ]
        if count := len(past.open) - len(ended):
            what = "one unfinished interview" if count == 1 else f"{count} unfinished interviews"
            shows = "it with its number" if count == 1 else "them with their numbers"
            texts.append(
                f"You have {what}: drills interview --list shows {shows}, and drills interview "
                f"--resume NUMBER continues {'it' if count == 1 else 'one'}."
            )
        return texts

    def past(self) -> Past:
        """Return what is stored; a notice says what is wrong with the file."""
        past, notices = json_store.load(self.file, FORM)
        self.session.notices += notices
        return past

    def due(self) -> list[deck.Entry]:
        """Return the cards that are due now."""
        reviews, notices = store.load(store.beside(self.session.progress_file))
        self.session.notices += notices
        return store.due(deck.deck(), reviews, self.last_look)

    def list_open(self) -> int:
        """List the unfinished interviews with their numbers, the newest first."""
        session, rows = self.session, []
        past = self.past()
        for number, name in enumerate(sorted(past.open, reverse=True), 1):
            one = past.open[name]
            self.read_journal(one)
            done = sum(entry.done for entry in one.items)
            title = next((e.title for e in one.items if not e.done), "the report")
            spent = one.seconds / 60
            session.wrap(
                f"{local_time(name)}, {spent:.0f} of {one.minutes} minutes, {done} of "
                f"{questions(len(one.items))} done. Next: {title}",
                "      ",
                f"  {number:>2}. ",
            )
            rows.append({"number": number, "started": name, "done": done, "next": title})
        if rows:
            session.say()
            session.say("  drills interview --resume NUMBER   continues one of them")
        else:
            session.say(NONE_OPEN)
        return session.finish(RIGHT, {"open": rows})

    def resume(self, number: int = 1) -> None:
        """Continue an unfinished interview, including the lines of its journal.

        Args:
            number: 1 for the newest one, 2 for the one before, as `list_open` counts them.
        """
        names = sorted((past := self.past()).open, reverse=True)
        if not names:
            raise Misuse(NONE_OPEN)
        if not 1 <= number <= len(names):
            what = "one unfinished interview" if len(names) == 1 else f"{len(names)} of them"
            raise Misuse(
                f"There is no unfinished interview {number}: you have {what}, and drills "
                "interview --list shows the numbers."
            )
        self.interview = past.open[names[number - 1]]
        self.read_journal(self.interview)
        items, when = self.interview.items, local_time(self.interview.started)
        done = sum(entry.done for entry in items)
        text = f"You continue the interview of {when}; {done} of {questions(len(items))} done."
        if is_ended(self.interview):
            text = (
                f"The interview of {when} was stopped before its report was complete; here it is."
            )
        if len(names) > 1:
            others = "One other is" if len(names) == 2 else f"{len(names) - 1} others are"
            text += f" {others} unfinished: drills interview --list shows the numbers."
        self.session.wrap(text)

    def read_journal(self, interview: Interview) -> None:
        """Add the lines that were typed after the whole interview was last written."""
        journal = self.journal_of(interview)
        entries = {entry.key: entry for entry in interview.items}
        with contextlib.suppress(OSError):
            for row in journal.read_text("utf-8").splitlines() if journal else ():
                with contextlib.suppress(ValueError, KeyError, TypeError):
                    line = json.loads(row)  # the last one is cut if the machine has stopped
                    entry, name = entries[line["key"]], str(line["name"])
                    before = getattr(entry, name)
                    if name in _TYPED and line["at"] == len(before):
                        setattr(entry, name, f"{before}{line['line']}\n")
                        entry.seconds = float(line["seconds"])

    @property
    def journal(self) -> Path | None:
        """The file to which each line is appended until the interview is written as a whole."""
        return self.journal_of(self.interview)

    def journal_of(self, interview: Interview) -> Path | None:
        """Return the file with the lines of an interview, None where nothing is stored."""
        return self.file and self.file.with_name(f"interviews-{digits(interview)}.lines")

    def store(self, edit: Callable[[Past], object]) -> None:
        """Change the file of the interviews; where that fails, one notice says so."""
        try:
            _, notices = json_store.change(self.file, FORM, edit)
            if self.journal:
                self.journal.unlink(missing_ok=True)  # its lines are in the file now
        except (json_store.Problem, OSError) as problem:
            notices = (str(problem),)
        self.session.notices += [one for one in notices if one not in self.session.notices]

    def begin(self) -> None:
        """Store the new interview before its first line is typed."""
        closed: list[Interview] = []

        def edit(past: Past) -> None:
            past.open[self.interview.started] = self.interview
            closed[:] = [past.open.pop(name) for name in sorted(past.open)[:-OPEN]]
            for one in closed:  # before it leaves the file
                self.read_journal(one)
                self.write_report(one)

        self.store(edit)
        for one in closed:
            if journal := self.journal_of(one):
                journal.unlink(missing_ok=True)
            path = workspace.shown(self.report_path(one).with_suffix(".md"))
            self.session.wrap(
                f"At most {OPEN} interviews stay unfinished. The oldest one is now closed, and its "
                f"report is {path}."
            )

    def report_path(self, interview: Interview) -> Path:
        """Return the file of a report, as JSON."""
        return self.folder / f"report-{digits(interview)[:17]}.json"

    def write_report(self, interview: Interview) -> dict[str, Any]:
        """Write the report as JSON and as Markdown; return its data."""
        path = self.report_path(interview)
        result = {**asdict(interview), "seconds": interview.seconds}
        workspace.write_over(path, json.dumps(result, indent=2, ensure_ascii=False) + "\n")
        workspace.write_over(path.with_suffix(".md"), rehearsal.markdown(interview))
        return result

    def add_time(self, entry: Entry) -> None:
        """Add the time since the last look to an entry."""
        now = self.clock()
        entry.seconds += max((now - self.last_look).total_seconds(), 0.0)  # clocks are set back
        self.last_look = now
        interview = self.interview
        if interview.seconds > 60 * interview.minutes and not interview.over:
            interview.over = entry.title
            self.session.wrap(
                f"Your {interview.minutes} minutes are over. You can still finish; the report "
                "says which question you were answering."
            )

    def book_time(self, entry: Entry) -> None:
        """Add the time since the last look to an entry, and store the interview."""
        self.add_time(entry)
        self.store(lambda past: past.open.update({self.interview.started: self.interview}))

    def add(self, entry: Entry, name: str, line: str) -> None:
        """Add a line to a text and to the journal; reject one that is too long."""
        if was_cut(line):
            self.session.wrap(
                f"A terminal passes on at most {LONGEST_LINE:,} bytes of a line, and your line "
                "reached this limit, so its end may be missing. The part that arrived is stored. "
                "Type the rest in shorter lines."
            )
        line = clean(line[: LONGEST + 1].rstrip())
        text = getattr(entry, name)
        if len(text) + len(line) >= LONGEST:
            self.session.wrap(_too_long(len(text)))
            return
        setattr(entry, name, f"{text}{line}\n")
        self.add_time(entry)
        if self.journal is None:
            return
        row = {"key": entry.key, "name": name, "at": len(text), "line": line}
        try:
            self.journal.parent.mkdir(parents=True, exist_ok=True)
            with self.journal.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**row, "seconds": entry.seconds}) + "\n")
        except OSError as error:
            problem = f"{workspace.shown(self.journal)} can't be written: {error.strerror}."
            self.session.notices += [problem] * (problem not in self.session.notices)

    def ask(self, text: str) -> None:
        """Print a question and the time that remains."""
        self.show_time()
        self.session.wrap(self.session.terminal.paint(plain(text), "head"))

    def show_time(self) -> None:
        """Print the time that remains."""
        remaining = self.interview.minutes - self.interview.seconds / 60
        self.session.say(f"\n{remaining:.0f} min left" if remaining > 0 else "")

    def show(self, markdown: str) -> None:
        """Write Markdown."""
        if not self.session.terminal.json:
            for line in task_text.markdown_lines(markdown, self.session.terminal):
                self.session.say(line)

    def show_typed(self, text: str) -> None:
        """Write what was typed as it is: its signs are no Markdown."""
        for line in text.splitlines():
            self.session.wrap(line)

    def take(self, entry: Entry, name: str) -> None:
        """Read an answer: lines up to a dot, or the text from an editor; blank lines belong to it.

        Lines that were pasted after the dot belong to the answer too and are never taken as marks.
        """
        if typed := getattr(entry, name):  # before the interview was stopped
            self.session.wrap("Your answer so far:")
            self.show_typed(typed)
        opens = " Type e as the first line to open your editor." * self.editor
        how = f"A line with only a dot (.) ends your answer, which may have blank lines.{opens}"
        self.session.wrap(how)
        blank = 0
        while (line := self.read_line()).strip() != ".":
            blank = 0 if line.strip() else blank + 1
            if blank % 100 == 0 < blank:
                self.session.wrap(how)  # also detects that the output has no reader any more
            if blank > 2:
                continue
            if self.editor and line.strip() == "e" and not getattr(entry, name).strip():
                self.edit(entry, name)
                self.book_time(entry)
                return
            self.add(entry, name, line)
        while self.waiting():
            self.add(entry, name, self.read_line())
        setattr(entry, name, getattr(entry, name).lstrip("\n"))
        self.book_time(entry)

    def edit(self, entry: Entry, name: str) -> None:
        """Read an answer from an editor; one that is too long stays in its file."""
        draft = self.folder / f"{digits(self.interview)}.md"
        draft.touch()  # an existing draft is kept: an editor that was killed may have saved it
        click.edit(filename=str(draft))
        text = draft.read_text(encoding="utf-8", errors="replace")
        if len(text) >= LONGEST:
            self.session.wrap(
                f"{_too_long(0)} Your text is in {workspace.shown(draft)}; shorten it there."
            )
            return
        setattr(entry, name, clean(text))
        draft.unlink()

    def clarify(self, item: Item, entry: Entry) -> None:
        """Read clarifying questions and reply; a question without a reply needs an assumption."""
        if entry.clarified:
            self.session.wrap("Your questions so far:")
            self.show(entry.clarified)
        self.session.wrap(
            "First ask what you need to know, one question per line. A line with only a dot (.) "
            "ends your questions."
        )
        while (line := self.read_line().strip()) != ".":
            if not line:
                continue
            self.add(entry, "clarified", f"* {line}")  # stored before anything else happens
            text = rehearsal.reply(item, clean(line[:LONGEST]))
            text = item.fill(text, figure) or ASSUME
            self.session.wrap(plain(text), "  ", "  ")
            self.add(entry, "clarified", f"  *{text}*")
        self.book_time(entry)

    def speak(self, item: Item, entry: Entry) -> None:
        """Ask one question: the answer, its marks, the follow-up, then the model answer."""
        if not entry.answered:
            self.ask(item.title)
            if item.part == "coding":
                self.session.wrap(WHITEBOARD)
            if item.clarify and not entry.answer:
                self.clarify(item, entry)
            self.take(entry, "answer")
            entry.answered = True
            entry.rubric = [item.fill(line, figure) for line in item.rubric]
            self.book_time(entry)
        else:  # resumed: what the marks are about
            self.ask(item.title)
            self.session.wrap("Your answer:")
            self.show_typed(entry.answer)
        self.session.say()
        self.session.wrap("How good was that? Give each of the following lines a mark:")
        for i, mark in enumerate(MARKS):
            self.session.wrap(f"{mark}: {MEANING[mark]}", "    ", f"  {i} ")
        hints = [f" [your words suggest: {mark}]" for mark in item.aid(entry.answer)]
        for at in range(len(entry.marks), len(item.rubric)):
            line = item.fill(item.rubric[at], figure) + (hints[at] if hints else "")
            self.session.wrap(plain(line), "      ", f"  {at + 1:>2}. ")
            prompt = [f"      mark 0-{len(MARKS) - 1}: "] * debugging.is_person(
                self.session.terminal
            )
            while (mark := self.read_line(*prompt).strip()) not in tuple("0123"):
                self.session.say(f"      Type a mark from 0 to {len(MARKS) - 1}.")
            entry.marks.append(MARKS[int(mark)])
            self.book_time(entry)
        entry.score = rehearsal.share(entry.marks)
        requested = rehearsal.follow_up(item, entry.marks, self.interview.seed)
        entry.weakest, entry.asked = (item.fill(text, figure) for text in requested)
        self.ask(entry.asked)
        self.take(entry, "reply")
        entry.model = self.model(item)
        self.show(f"---\n\n{entry.model}")

    def model(self, item: Item) -> str:
        """Return the model answer, with questions to ask first and possible follow-ups."""
        first = "\n".join(f"* {line}" for line in item.clarify)
        after = "\n".join(f"* {line}" for line in item.follow_ups)
        text = f"Questions to ask first:\n\n{first}\n\n" * bool(first) + item.answer
        text += f"\n\nPossible follow-ups:\n\n{after}"
        return item.fill(text, figure)

    def debug(self, item: Item, entry: Entry) -> None:
        """Run a scenario, as `drills debug` does.

        After a stop the probes are run again, and so is a conclusion that was not judged yet.
        """
        name, seed = item.key.removeprefix("scenario/"), self.interview.seed % 1000
        self.show_time()
        case = scenarios.diagnose(name, seed)
        typed = [line.split() for line in entry.answer.splitlines()]
        known = {probe.name for probe in scenarios.scenario(name).probes}
        for line in typed:
            if len(line) == 2 and line[0] == "probe" and line[1] in known:
                case.probe(line[1])

        def lines() -> Iterator[str]:
            if typed and typed[-1][:1] in (["conclude"], ["quit"]):
                yield " ".join(typed[-1])
            while True:
                prompt = debugging.prompt_in(self.session.terminal)
                line = clean(self.read_line(*[prompt] * bool(prompt))[:LONGEST])
                self.add(entry, "answer", line)
                yield line

        verdict = debugging.talk(self.session, case, [], lines(), quits=QUIT)
        entry.answered = True
        again = f"drills debug {name} --seed {seed}"
        self.session.say(f"{again}   starts this case again")
        if verdict is None:
            entry.weakest = f"debugging: {item.title}"
            entry.model = f"You stopped without a conclusion. `{again}` starts this case again."
            return
        sentences = verdict.sentences()
        done = "pass" if verdict.points == 3 else "fail"
        entry.attempts.append({"verdict": done, "sentence": sentences[-1]})
        entry.score, entry.weakest = verdict.points / 3, sentences[0]
        entry.model = verdict._repr_markdown_()

    def code(self, item: Item, entry: Entry) -> None:
        """Set a drill, which is graded any number of times, in a file of the interviews."""
        card = catalogue.card(item.key.removeprefix("drill/"))
        path = self.folder / f"{card.name}.py"
        if not entry.answered:
            workspace.write_start(path, card, replace=True)  # backs up an existing file
            entry.answered = True
            self.book_time(entry)
        self.ask(card.title)
        self.session.wrap(f"Write {card.entry} in {workspace.shown(path)}.")
        self.session.say()
        entry.task = task_text.task(card)
        self.show(entry.task)
        verdicts: list[str] = [attempt["verdict"] for attempt in entry.attempts]
        while "pass" not in verdicts:
            editor = "e opens your editor, " * self.editor
            self.session.say(f"A blank line grades your answer, {editor}n ends this task.")
            line = self.read_line().strip().lower()
            if line == "n":
                break
            if line == "e" and self.editor:
                click.edit(filename=str(path))
            elif not line:
                report = commands.graded(self.session, card, str(path), None)
                commands.report_result(self.session, card, report, str(path))
                if report.reason not in commands.UNCOUNTED:
                    entry.attempts.append({"verdict": report.verdict, "sentence": report.sentence})
                    verdicts.append(report.verdict)
            self.book_time(entry)
        with contextlib.suppress(OSError):
            entry.code = clean(path.read_text(encoding="utf-8", errors="replace")[:LONGEST])
        entry.score = 1 / len(verdicts) if "pass" in verdicts else 0.0
        entry.weakest = item.rubric[0]
        if "pass" in verdicts:
            entry.model = f"```python\n{card.solution_text()}```"
        else:
            give_up = f"`drills solution {card.name} --give-up`"
            entry.model = f"`drills hint {card.name}` gives hints; {give_up} shows the answer."

    def run(self) -> int:
        """Ask the remaining questions, and report."""
        items, session = pool(), self.session
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            entry = next(iter(self.interview.items), Entry("", "", 0, 0, ""))
            self.begin()
            for entry in self.interview.items:
                item = items.get(entry.key)
                entry.task = entry.task or (item.title.partition("\n")[2] if item else "")
                if item and not entry.done:
                    kind = item.key.partition("/")[0]
                    runners = {"drill": self.code, "scenario": self.debug}
                    runners.get(kind, self.speak)(item, entry)
                elif item is None:
                    session.notices.append(
                        f"This question is no longer in the course: {entry.title}"
                    )
                entry.read = to_read(entry)
                entry.done = True
                self.book_time(entry)
            self.interview.cards_due = [card.key for card in self.due()]
            path = self.report_path(self.interview)
            result = self.write_report(self.interview)
            self.show_report(path)
        except (KeyboardInterrupt, EOFError, OutputLost, click.ClickException):
            if self.file:
                self.book_time(entry)
                names = sorted(self.past().open, reverse=True)
                later = (
                    names.index(self.interview.started) if self.interview.started in names else 0
                )
                number = f" {later + 1}" * bool(later)
                session.notices.append(
                    f"All that you typed is stored: drills interview --resume{number} continues."
                )
            raise
        except OSError as error:
            why = f"{workspace.shown(self.folder)} can't be written: {error.strerror}."
            raise Misuse(why) from None

        def close(past: Past) -> None:
            past.open.pop(self.interview.started, None)
            past.scores |= {entry.key: entry.score for entry in self.interview.items}
            past.last = [entry.key for entry in self.interview.items]

        self.store(close)  # last: whatever ends the command before, --resume reports again
        return session.finish(RIGHT, {"report": str(path.absolute()), **result})

    def show_report(self, path: Path) -> None:
        """Print the scores, what to read, and where the report is."""
        session = self.session
        session.say()
        session.say(session.terminal.paint("Your scores", "head"))
        for one in self.interview.items:
            lead = f"{one.score:>4.0%} {one.seconds / 60:>3.0f} min  "
            session.wrap(one.title, " " * len(lead), lead)
            if one.read:
                session.wrap(rehearsal.sentence(f"Read {one.read}"), " " * len(lead))
        if due := self.interview.cards_due:
            cards = "1 card is" if len(due) == 1 else f"{len(due)} cards are"
            session.say(f"{cards} due: drills review")
        report = workspace.shown(path.with_suffix(".md"))
        session.wrap(f"The report is {report}; the .json file next to it has the same as data.")


def digits(interview: Interview) -> str:
    """Return the name of an interview in the names of its files."""
    return re.sub("[^0-9]", "", interview.started)


def is_ended(interview: Interview) -> bool:
    """Return whether all questions are done, so that only the report is missing."""
    return all(entry.done for entry in interview.items)


def local_time(started: str) -> str:
    """Return the start of an interview in local time, to the minute."""
    return datetime.fromisoformat(started).astimezone().strftime("%Y-%m-%d %H:%M")


def questions(count: int) -> str:
    """Return a number of questions in words."""
    return "1 question" if count == 1 else f"{count} questions"


def _too_long(length: int) -> str:
    """Return the message for a line that is too long after `length` characters of an answer."""
    stored = f"Its first {length:,} characters are stored, this line is not."
    return (
        f"An answer has at most {LONGEST:,} characters. "
        f"{stored if length else 'This text is longer and is not stored.'}"
    )


def to_read(entry: Entry) -> str:
    """Return the chapter section closest to the weakest line, or "" after a good answer."""
    chapter = next(chapter for chapter in CHAPTERS if chapter.number == entry.chapter)
    path = notebook_of(chapter)
    if entry.score >= rehearsal.WEAK or not path.is_file():
        return ""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells)
    parts = re.split(r"^## (?=\d+ · )", text, flags=re.M)[1:]
    parts = [part for part in parts if not re.match(r"\d+ · (Exercises|Interview)\b", part)]
    # What a design or a scenario lacks is in the section on them, whatever words it has.
    kind = {"design": "Design:", "scenario": "Debug:"}.get(entry.key.partition("/")[0])
    named = [at for at, part in enumerate(parts) if kind and f"· {kind}" in part.splitlines()[0]]
    result = named[0] if named else rehearsal.nearest(entry.weakest, parts)
    title = "" if result is None else parts[result].splitlines()[0].replace(" · ", ": ")
    return f"chapter {entry.chapter}, {chapter.title}" + f", section {title}" * bool(title)


def chapters_of(context: object, option: object, text: str | None) -> frozenset[int]:
    """Return the chapters of an option such as "1,5", all if it is not given."""
    chosen = EVERY if text is None else {int(n) for n in re.findall(r"\d+", text)}
    if not chosen or not EVERY.issuperset(chosen):
        raise click.BadParameter(f"{text!r} is not a list of chapters such as 1,5.")
    return frozenset(chosen)


@click.command("interview")
@click.option("--minutes", default=45, show_default=True, type=click.IntRange(1, 480))
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Seed of the random draw.")
@click.option("--chapters", metavar="1,5", callback=chapters_of, help="Only these chapters.")
@click.option("--kind", multiple=True, type=click.Choice(PARTS), help="Only this kind of question.")
@click.option("--list", "listing", is_flag=True, help="List unfinished interviews.")
@click.option(
    "--resume",
    type=click.IntRange(1),
    is_flag=False,
    flag_value=1,
    metavar="[NUMBER]",
    help="Continue the last unfinished interview, or the one with this number in --list.",
)
@options
@body
def command(
    session: Session,
    minutes: int,
    seed: int | None,
    chapters: frozenset[int],
    kind: tuple[str, ...],
    listing: bool,
    resume: int | None,
) -> int:
    """Rehearse an interview against the clock. You mark your answers; code is graded."""
    listen()
    person = sys.stdin.isatty() and sys.stdout.isatty() and not session.terminal.json
    talk = Talk(session, session.terminal.paged(read_line), editor=person)
    if listing:
        return talk.list_open()
    if resume:
        talk.resume(resume)
    else:
        talk.draw(minutes, seed, chapters, tuple(p for p in PARTS if p in (kind or PARTS)))
        talk.announce()
    return talk.run()
