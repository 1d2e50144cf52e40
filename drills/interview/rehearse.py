"""The command `drills interview`: asked, answered, marked by oneself, and kept after every line."""

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

from course import CHAPTERS, json_store
from course.derivations.records import figure
from course.interview import rehearsal, scenarios
from course.interview.rehearsal import MARKS, PARTS, Entry, Interview, Item
from drills import cards as catalogue
from drills import commands, task_text, workspace
from drills.chapters import notebook_of
from drills.feedback import clean
from drills.interview import LONGEST_LINE, deck, listen, read_line, store, was_cut
from drills.interview import debug as debugging
from drills.plain_math import plain
from drills.progress import SOLVED
from drills.session import RIGHT, Session, body, options
from drills.terminal import OutputLost
from drills.workspace import Misuse

_TYPED = ("answer", "clarified", "reply")  # texts of an entry that come line by line
EVERY = frozenset(chapter.number for chapter in CHAPTERS)


@dataclass
class Past:
    """The interviews that are not over, by when they began, and what was asked in others.

    Attributes:
        open: those that can go on.
        scores: key of an item -> share of the marks, the last time.
        last: keys of the last interview's questions.
    """

    open: dict[str, Interview] = field(default_factory=dict)
    scores: dict[str, float] = field(default_factory=dict)
    last: list[str] = field(default_factory=list)


def _parse(content: dict[str, Any]) -> Past:
    try:
        opened = {
            name: Interview(**{**one, "items": [Entry(**entry) for entry in one["items"]]})
            for name, one in content["open"].items()
        }
        return Past(opened, {k: float(v) for k, v in content["scores"].items()}, content["last"])
    except (TypeError, KeyError, ValueError, AttributeError):
        raise json_store.Damaged from None


FORM = json_store.Form("drills-interviews/1", "interviews", Past, _parse, asdict)


def pool(chosen: frozenset[int] = EVERY) -> dict[str, Item]:
    """Return all that can be asked of the chosen chapters, by key."""
    items = rehearsal.spoken([c.topic for c in CHAPTERS if c.number in chosen])
    for card in catalogue.cards():
        if card.chapter in chosen:
            rest = (card.chapter, card.minutes, card.title, (card.teaches,), (), card.insight)
            items.append(Item(f"drill/{card.name}", "coding", *rest))
    return {item.key: item for item in items}


LONGEST = 50_000  # characters of an answer; an hour of speech has about as many
OPEN = 5  # interviews that are not over and can still be resumed


def waiting_input() -> bool:
    """Return whether a terminal has more input already, as behind a text that was pasted."""
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
        waiting: whether there is input that was typed or pasted before it was asked for.
    """

    session: Session
    read_line: Callable[[], str] = read_line
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
        """Begin a new interview."""
        past, records = self.past(), self.session.records().records.items()
        weak = {key for key, score in past.scores.items() if score < rehearsal.WEAK}
        weak |= {card.key for card in self.due()}
        weak |= {f"drill/{n}" for n, r in records if r.attempts and r.state != SOLVED}
        seed = secrets.randbits(32) if seed is None else seed
        items, last = list(pool(chosen).values()), set(past.last)
        if past.open:
            last |= {entry.key for entry in past.open[max(past.open)].items}
            count = len(past.open)
            what = "One earlier interview is" if count == 1 else f"{count} earlier interviews are"
            text = f"{what} not over: drills interview --list shows them, --resume goes on."
            self.session.wrap(text)  # now, when it can still be chosen
            self.session.notices += [text] * self.session.terminal.json
        items = rehearsal.usual(items, minutes, parts, last)
        try:
            drawn = rehearsal.draw(items, parts, minutes, weak, last, seed)
        except ValueError:
            raise Misuse("Of these chapters and kinds there is only what was just asked.") from None
        entries = [
            Entry(i.key, i.part, i.chapter, i.minutes, i.title.partition("\n")[0]) for i in drawn
        ]
        if left_out := [part for part in parts if part not in {item.part for item in drawn}]:
            what = ", ".join(left_out)
            self.session.notices.append(f"Left out for lack of time or of choice: {what}.")
        self.interview = Interview(
            self.last_look.isoformat(timespec="milliseconds"), seed, minutes, entries
        )

    def past(self) -> Past:
        """Return what is kept; what is wrong with its file is said."""
        past, notices = json_store.load(self.file, FORM)
        self.session.notices += notices
        return past

    def due(self) -> list[deck.Entry]:
        """Return the cards that are due now."""
        reviews, notices = store.load(store.beside(self.session.progress_file))
        self.session.notices += notices
        return store.due(deck.deck(), reviews, self.last_look)

    def list_open(self) -> int:
        """Say which interviews are not over, the last one first, each with its number."""
        session, rows = self.session, []
        past = self.past()
        for number, name in enumerate(sorted(past.open, reverse=True), 1):
            one = past.open[name]
            self.read_journal(one)
            done = sum(entry.done for entry in one.items)
            title = next((e.title for e in one.items if not e.done), "the report")
            spent = one.seconds / 60
            when = datetime.fromisoformat(name).astimezone().strftime("%Y-%m-%d %H:%M")
            session.wrap(
                f"{when}, {spent:.0f} of {one.minutes} minutes, {done} of "
                f"{len(one.items)} done. Next: {title}",
                "      ",
                f"  {number:>2}. ",
            )
            rows.append({"number": number, "started": name, "done": done, "next": title})
        if rows:
            session.say()
            session.say("  drills interview --resume NUMBER   goes on")
        else:
            session.say("No interview is waiting to go on. drills interview begins one.")
        return session.finish(RIGHT, {"open": rows})

    def resume(self, number: int = 1) -> None:
        """Go on with an interview that is not over, with the lines that came after it.

        Args:
            number: 1 for the last one, 2 for the one before, as `list_open` counts them.
        """
        names = sorted((past := self.past()).open, reverse=True)
        if not names:
            raise Misuse("No interview is waiting to go on. drills interview begins one.")
        if not 1 <= number <= len(names):
            raise Misuse(
                f"There is no open interview {number}. drills interview --list shows "
                f"{'all ' * (len(names) > 1)}{len(names)}."
            )
        self.interview = past.open[names[number - 1]]
        self.read_journal(self.interview)
        if len(names) > 1:
            others = "one other is" if len(names) == 2 else f"{len(names) - 1} others are"
            self.session.wrap(
                f"This is the interview of {self.interview.started[:16].replace('T', ', ')} UTC; "
                f"{others} open: drills interview --list shows them."
            )

    def read_journal(self, interview: Interview) -> None:
        """Enter the lines that were typed after the interview was last written as a whole."""
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
        """Change the file of the interviews; where that is not possible, it is said once."""
        try:
            _, notices = json_store.change(self.file, FORM, edit)
            if self.journal:
                self.journal.unlink(missing_ok=True)  # its lines are in the file now
        except (json_store.Problem, OSError) as problem:
            notices = (str(problem),)
        self.session.notices += [one for one in notices if one not in self.session.notices]

    def begin(self) -> None:
        """Write the draw, so that it is there whatever happens before the first line."""
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
                f"{OPEN} interviews stay open. The oldest one is closed, with its report: {path}"
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
            self.session.wrap("The time is over. This is noted, and nothing is cut off: go on.")

    def book_time(self, entry: Entry) -> None:
        """Book the time since the last look on an entry, and write all that was said."""
        self.add_time(entry)
        self.store(lambda past: past.open.update({self.interview.started: self.interview}))

    def add(self, entry: Entry, name: str, line: str) -> None:
        """Add a line to a text and to the journal; one that is too long is refused."""
        if was_cut(line):
            self.session.wrap(
                f"A terminal passes on at most {LONGEST_LINE:,} bytes of a line. Yours is as long, "
                "so its end may be lost. It is stored as far as it came; give the rest in shorter "
                "lines."
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
        """Put a question, with the time that is left."""
        remaining = self.interview.minutes - self.interview.seconds / 60
        self.session.say(f"\n{remaining:.0f} min left" if remaining > 0 else "")
        self.session.wrap(self.session.terminal.paint(plain(text), "head"))

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
        """Take an answer: lines up to a dot, or what an editor leaves; blank lines belong to it.

        What was pasted behind the dot belongs to it too, and is taken for nothing else.
        """
        self.show_typed(getattr(entry, name))  # before the terminal was killed
        opens = " A first line of e opens your editor." * self.editor
        how = f"A line with nothing but a dot ends your answer; blank lines belong to it.{opens}"
        self.session.wrap(how)
        blank = 0
        while (line := self.read_line()).strip() != ".":
            blank = 0 if line.strip() else blank + 1
            if blank % 100 == 0 < blank:
                self.session.wrap(how)  # also notices that nobody reads this any more
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
        """Take an answer from an editor; one that is too long stays in its file."""
        draft = self.folder / f"{digits(self.interview)}.md"
        draft.touch()  # what an editor that was killed has saved is there
        click.edit(filename=str(draft))
        text = draft.read_text(encoding="utf-8", errors="replace")
        if len(text) >= LONGEST:
            self.session.wrap(f"{_too_long(0)} Your text is in {workspace.shown(draft)}.")
            return
        setattr(entry, name, clean(text))
        draft.unlink()

    def clarify(self, item: Item, entry: Entry) -> None:
        """Have a candidate ask first, and reply; what has no reply is the candidate's to assume."""
        self.show(entry.clarified)
        self.session.wrap(
            "First ask what you need to know, a question a line. A line with nothing but a dot "
            "ends your questions."
        )
        while (line := self.read_line().strip()) != ".":
            if not line:
                continue
            text = rehearsal.reply(item, clean(line[:LONGEST]))
            text = item.fill(text, figure) or "That is yours to assume. Say what you assume."
            self.session.wrap(plain(text), "  ", "  ")
            self.add(entry, "clarified", f"* {line} *{text}*")
        self.book_time(entry)

    def speak(self, item: Item, entry: Entry) -> None:
        """Ask one question: the answer, its marks, the follow-up, and then the model answer."""
        if not entry.answered:
            self.ask(item.title)
            if item.clarify and not entry.answer:
                self.clarify(item, entry)
            self.take(entry, "answer")
            entry.answered = True
            entry.rubric = [item.fill(line, figure) for line in item.rubric]
            self.book_time(entry)
        levels = ", ".join(f"{i} {mark}" for i, mark in enumerate(MARKS))
        self.session.say(f"\nHow good was that? {levels}")
        hints = [f" [your words suggest: {mark}]" for mark in item.aid(entry.answer)]
        for at in range(len(entry.marks), len(item.rubric)):
            line = item.fill(item.rubric[at], figure) + (hints[at] if hints else "")
            self.session.wrap(plain(line), "      ", f"  {at + 1:>2}. ")
            while (mark := self.read_line().strip()) not in tuple("0123"):
                self.session.say(f"      0 to {len(MARKS) - 1}")
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
        """Return the model answer, with what a candidate could have asked and what comes next."""
        first = "\n".join(f"* {line}" for line in item.clarify)
        after = "\n".join(f"* {line}" for line in item.follow_ups)
        text = f"Ask first:\n\n{first}\n\n" * bool(first) + item.answer
        text += f"\n\nWhat comes next:\n\n{after}" * (not item.paired)
        return item.fill(text, figure)

    def debug(self, item: Item, entry: Entry) -> None:
        """Run a scenario, as `drills debug` does; what was typed before is done again."""
        name, seed = item.key.removeprefix("scenario/"), self.interview.seed % 1000
        self.ask(entry.title)
        case = scenarios.diagnose(name, seed)

        def lines() -> Iterator[str]:
            yield from entry.answer.splitlines()
            while True:
                line = clean(self.read_line()[:LONGEST])
                self.add(entry, "answer", line)
                yield line

        verdict = debugging.talk(self.session, case, [], lines())
        entry.answered = True
        self.session.say(f"drills debug {name} --seed {seed} runs it again.")
        if verdict is None:
            entry.model = f"Left open: `drills debug {name} --seed {seed}` runs it again."
            return
        sentences = verdict.sentences()
        done = "pass" if verdict.points == 3 else "fail"
        entry.attempts.append({"verdict": done, "sentence": sentences[-1]})
        entry.score, entry.weakest = verdict.points / 3, sentences[0]
        entry.model = verdict._repr_markdown_()

    def code(self, item: Item, entry: Entry) -> None:
        """Set a drill, graded as often as one likes, in a file of the interviews."""
        card = catalogue.card(item.key.removeprefix("drill/"))
        path = self.folder / f"{card.name}.py"
        if not entry.answered:
            workspace.write_start(path, card, replace=True)  # keeps what is there
            entry.answered = True
            self.book_time(entry)
        self.ask(f"{card.title}: write {card.entry} in {workspace.shown(path)}.")
        self.show(task_text.task(card))
        verdicts: list[str] = [attempt["verdict"] for attempt in entry.attempts]
        while "pass" not in verdicts:
            editor = "e opens your editor, " * self.editor
            self.session.say(f"A blank line grades it, {editor}n goes on without.")
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
            entry.model = f"`drills hint {card.name}` helps; {give_up} shows the answer."

    def run(self) -> int:
        """Ask what is not over yet, and report."""
        items, session = pool(), self.session
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            entry = next(iter(self.interview.items), Entry("", "", 0, 0, ""))
            self.begin()
            for entry in self.interview.items:
                item = items.get(entry.key)
                if item and not entry.done:
                    kind = item.key.partition("/")[0]
                    runners = {"drill": self.code, "scenario": self.debug}
                    runners.get(kind, self.speak)(item, entry)
                elif item is None:
                    session.notices.append(f"The course no longer asks: {entry.title}")
                entry.read = to_read(entry)
                entry.done = True
                self.book_time(entry)
            self.interview.cards_due = [card.key for card in self.due()]
            path = self.report_path(self.interview)
            result = self.write_report(self.interview)
        except (KeyboardInterrupt, EOFError, OutputLost, click.ClickException):
            if self.file:
                self.book_time(entry)
                session.notices.append("What you said is kept: drills interview --resume goes on.")
            raise
        except OSError as error:
            why = f"{workspace.shown(self.folder)} can't be written: {error.strerror}."
            raise Misuse(why) from None

        def close(past: Past) -> None:
            past.open.pop(self.interview.started, None)
            past.scores |= {entry.key: entry.score for entry in self.interview.items}
            past.last = [entry.key for entry in self.interview.items]

        self.store(close)
        session.say()
        for one in self.interview.items:
            lead = f"{one.score:>4.0%} {one.seconds / 60:>3.0f} min  "
            session.wrap(one.title, " " * len(lead), lead)
            if one.read:
                session.wrap(f"Read {one.read}.", " " * len(lead))
        if due := self.interview.cards_due:
            session.say(f"{len(due)} cards are due: drills review")
        session.wrap(f"The report: {workspace.shown(path.with_suffix('.md'))}, also as .json")
        return session.finish(RIGHT, {"report": str(path.absolute()), **result})


def digits(interview: Interview) -> str:
    """Return the name of an interview in the names of its files."""
    return re.sub("[^0-9]", "", interview.started)


def _too_long(length: int) -> str:
    """Return the sentence for a text that is refused behind so many characters."""
    notice = f"The first {length:,} characters are kept, and this line is not."
    return (
        f"An answer has at most {LONGEST:,} characters. {notice if length else 'It is not kept.'}"
    )


def to_read(entry: Entry) -> str:
    """Return the chapter section nearest to the weakest line, or "" after a good answer."""
    chapter = next(chapter for chapter in CHAPTERS if chapter.number == entry.chapter)
    path = notebook_of(chapter)
    if entry.score >= rehearsal.WEAK or not path.is_file():
        return ""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells)
    parts = re.split(r"^## (?=\d+ · )", text, flags=re.M)[1:]
    parts = [part for part in parts if not re.match(r"\d+ · (Exercises|Interview)\b", part)]
    result = rehearsal.nearest(entry.weakest, parts)
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
    return talk.run()
