"""One run of a command: its options, its output, and how every way to fail is reported.

Exit codes: 0 right (or done), 1 wrong, 2 misuse, 3 the grader itself could not run, 130 stopped.
"""

from __future__ import annotations

import functools
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from course.libraries import import_error, missing_shared_library
from drills import interrupts, progress, workspace
from drills.cards import UnknownExercise
from drills.json_store import Problem
from drills.terminal import SCHEMA, OutputLost, Terminal, listed
from drills.workspace import Misuse

RIGHT, WRONG, MISUSE, FAILED, STOPPED = 0, 1, 2, 3, 130


@dataclass
class Session:
    """What a command works with.

    Attributes:
        command: its name, as it stands in the JSON.
        terminal: where it writes.
        work: the folder of the answers.
        seed, drill: of the grading that runs, for the report of a failure of ours.
        standard_input: what was read from it; it can be read only once.
        notices: what the learner should know besides the result.
    """

    command: str
    terminal: Terminal
    work: Path
    seed: int | None = None
    drill: str = ""
    standard_input: bytes | None = None
    notices: list[str] = field(default_factory=list)

    @property
    def progress_file(self) -> Path | None:
        """Where the progress is kept, None to keep none."""
        return workspace.progress_file(self.work)

    def records(self) -> progress.Loaded:
        """Return the progress; what is wrong with its file is said."""
        loaded = progress.load(self.progress_file)
        self.notices += loaded.notices
        return loaded

    def record(self, name: str, edit: Callable[[progress.Record], None]) -> progress.Record | None:
        """Change the record of an exercise; None, and a notice, where that is not possible."""
        loaded = self._changed(lambda: progress.change(self.progress_file, name, edit))
        return loaded.of(name) if loaded else None

    def record_chapter(self, number: int, edit: Callable[[progress.Reading], None]) -> None:
        """Change the record of a chapter; a notice says where that is not possible."""
        self._changed(lambda: progress.change_chapter(self.progress_file, number, edit))

    def _changed(self, change: Callable[[], progress.Loaded]) -> progress.Loaded | None:
        try:
            loaded = change()
        except Problem as problem:
            self.notices.append(str(problem))
            return None
        self.notices += loaded.notices
        return loaded

    def say(self, text: str = "") -> None:
        """Write a text."""
        self.terminal.say(text)

    def wrap(self, text: str, indent: str = "", first: str | None = None) -> None:
        """Write a paragraph."""
        self.terminal.wrap(text, indent, first)

    def finish(self, code: int, payload: dict[str, Any]) -> int:
        """Print the notices and, if requested, the line of JSON; return the exit code."""
        for notice in self.notices:
            self.terminal.complain(f"Note: {notice}")
        head = {"schema": SCHEMA, "command": self.command, "exit": code}
        self.terminal.line_of_json({**head, **payload, "notices": self.notices})
        self.notices = []
        return code

    def may_replace(self, question: str) -> bool:
        """Ask a person; false where there is nobody to ask."""
        if self.terminal.json or sys.stdin is None or not sys.stdin.isatty():
            return False
        from drills.interview import read_line  # which most commands don't need

        while True:
            line = read_line(f"{question} [y/N]: ").strip().lower()
            if line in ("", "n", "no", "y", "yes"):
                return line in ("y", "yes")
            self.say("Answer y or n.")


Body = Callable[..., int]


def options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the options that every command has."""
    work = click.option(
        "--work", metavar="FOLDER", help="Folder with your answers (default: DRILLS_WORK, or work)."
    )
    as_json = click.option(
        "--json", "as_json", is_flag=True, help="Print one line of JSON at the end."
    )
    return as_json(work(function))


def body(function: Body) -> Callable[..., int]:
    """Hand a command its session in place of the common options."""

    @functools.wraps(function)
    def run(*args: Any, as_json: bool, work: str | None, **kwargs: Any) -> int:
        context = click.get_current_context()
        above = context.parent.params if context.parent else {}
        as_json = as_json or bool(above.get("as_json"))
        name = context.info_name or "drills"
        name = "list" if context.parent is None else name
        session = Session(name, Terminal(as_json), workspace.folder(work or above.get("work")))
        context.find_root().meta["session"] = session
        return function(session, *args, **kwargs)

    return run


class Later(click.Command):
    """A command whose module is imported when it is used, so that `drills` starts as fast.

    Args:
        name: of the command.
        module: its module, which defines it as `command`.
        summary: its line in `drills --help`.
    """

    def __init__(self, name: str, module: str, summary: str) -> None:
        super().__init__(name, short_help=summary)
        self.module = module

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """Return the context of the command itself."""
        command: click.Command = importlib.import_module(self.module).command
        return command.make_context(*args, **kwargs)


class Commands(click.Group):
    """The group of commands; it turns every way to end into an exit code and a sentence."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order in which they are defined, the order of use."""
        return list(self.commands)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command of that name; a mistyped one gets the nearest."""
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith("-"):
            import difflib

            near = difflib.get_close_matches(args[0], list(self.commands), n=3, cutoff=0.5)
            intended = f" Did you mean {listed(near)}?" if near else ""
            raise Misuse(f"There is no command {args[0]!r}.{intended} See drills --help.", near)
        return super().resolve_command(ctx, args)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
        **extra: Any,
    ) -> Any:
        """Run a command and exit with its code."""
        given = list(sys.argv[1:] if args is None else args)
        try:
            code = self._code(given, prog_name or "drills", extra)
        except OutputLost:  # not even that could be said
            code = FAILED
        if standalone_mode:
            sys.exit(code)
        return code

    def _code(self, args: list[str], prog_name: str, extra: dict[str, Any]) -> int:
        known: dict[str, Any] = {}

        def start() -> int:
            with self.make_context(prog_name, list(args), **extra) as context:
                try:
                    result = self.invoke(context)
                finally:
                    known.update(context.meta)
                return result if isinstance(result, int) else RIGHT

        try:
            return start()
        except click.exceptions.Exit as stop:
            return stop.exit_code
        except (KeyboardInterrupt, click.Abort, EOFError):
            return self._end(args, known, STOPPED, "interrupted", "Stopped.")
        except OutputLost as error:
            text = f"The output can't be written: {error.strerror}."
            return self._end(args, known, FAILED, "grader", text)
        except (Misuse, UnknownExercise) as error:
            text = str(error)
            if isinstance(error, UnknownExercise):
                text = text[:1].upper() + text[1:]
                text += "" if error.nearest else ". drills list shows them all."
            return self._end(args, known, MISUSE, "misuse", text, error.nearest)
        except click.ClickException as error:
            text = error.format_message()
            path = (
                error.ctx.command_path if isinstance(error, click.UsageError) and error.ctx else ""
            )
            text += f" See {path} --help." if path else ""
            return self._end(args, known, MISUSE, "misuse", text)
        except Exception as error:
            if interrupts.came():  # what Ctrl-C has broken is no fault of ours
                return self._end(args, known, STOPPED, "interrupted", "Stopped.")
            if os.environ.get("DRILLS_DEBUG"):
                import traceback

                traceback.print_exc()
            return self._end(args, known, FAILED, "grader", _failure(error, known.get("session")))

    def _end(
        self,
        args: list[str],
        known: dict[str, Any],
        code: int,
        kind: str,
        message: str,
        nearest: list[str] | None = None,
    ) -> int:
        session = known.get("session")
        if session is None:
            before_end = args[: args.index("--")] if "--" in args else args
            terminal = Terminal("--json" in before_end)
            name = next((word for word in args if word in self.commands), "drills")
            session = Session(name, terminal, Path())
        if code == STOPPED and sys.stderr is not None and sys.stderr.isatty():
            session.terminal.complain("")  # behind a prompt, a bar or ^C
        session.terminal.complain(message)
        error: dict[str, Any] = {"kind": kind, "message": message, "nearest": nearest or []}
        if code == FAILED:
            error |= {"drill": session.drill or None, "seed": session.seed}
        return session.finish(code, {"error": error})


def _failure(error: Exception, session: Session | None) -> str:
    """Return one sentence on a failure of ours, and how to report it."""
    message = " ".join(str(error).split())[:200]
    what = f"{type(error).__name__}: {message}" if message else type(error).__name__
    if isinstance(error, ModuleNotFoundError):
        return (
            f"The package {error.name} is not installed, and this command needs it. "
            f"Set everything up with: {workspace.set_up()}"
        )
    if isinstance(error, ImportError) and missing_shared_library(error.__cause__ or error):
        return str(error if error.__cause__ else import_error("A library", "", error))
    again = "drills " + " ".join(sys.argv[1:]) if len(sys.argv) > 1 else "drills"
    on = ""
    if session and session.drill:
        on = f" on {session.drill} with seed {session.seed}"
        again = f"drills check {session.drill} --seed {session.seed}"
    return (
        f"The grader itself failed{on} ({what}). That is our fault, not yours, and nothing was "
        f"recorded. Please report what this prints: DRILLS_DEBUG=1 {again}"
    )
