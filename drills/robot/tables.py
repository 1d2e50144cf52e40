"""What the commands of the robot write: tables, changes, blamed parts, and calls to repeat."""

from __future__ import annotations

import math
import re
import textwrap
from pathlib import Path
from typing import Any

import numpy as np

from drills import interrupts, workspace
from drills.robot import records, report
from drills.robot.play import Played
from drills.robot.report import Summary
from drills.robot.slots import NAMED, STAGES, YOURS, Part
from drills.session import WRONG, Session

INLINE = 300  # characters of a call that a terminal shows


def say_summary(
    session: Session, mine: Summary, course: Summary | None, other: Summary | None
) -> None:
    """Write success, cycle time, error budget and processor time, of up to three robots.

    Args:
        session: of the command.
        mine: your robot.
        course: with the course's parts on the same tasks, unless that is your robot.
        other: with the libraries' parts on the same tasks, or None.
    """
    session.say()
    pairs = (("your robot", mine), ("the course's", course), ("libraries", other))
    robots = [(name, one) for name, one in pairs if one is not None]

    def cycle(one: Summary) -> str:
        low, middle, high = one.quartiles()
        return "none" if math.isnan(middle) else f"{middle:.2f} s ({low:.2f}, {high:.2f})"

    def row(head: str, *cells: str) -> None:
        session.say(f"  {head:<17}{''.join(f'{cell:<20}' for cell in cells)}".rstrip())

    row("", *(name for name, _ in robots))
    row("success", *(f"{int(one.success.sum())}/{one.tasks}" for _, one in robots))
    row("95 % interval", *(f"{100 * o.low:.1f} to {100 * o.high:.1f} %" for _, o in robots))
    row("cycle, quartiles", *(cycle(one) for _, one in robots))
    for name, one in robots[1:]:
        change = report.compare(one, mine)
        owner = "the libraries'" if name == "libraries" else name
        session.say(f"  yours minus {owner}, same tasks and noise, 95 % intervals:")
        say_change(session, change)
    session.say()
    if not np.isfinite(mine.rms).all():
        session.wrap("No task was finished, so there is no error to divide among the stages.", "  ")
        return
    names = {"your robot": "yours", "the course's": "course", "libraries": "library"}
    short = "".join(f"{names[name]:>8}" for name, _ in robots)
    width = 8 * len(robots)
    head = f"  {'error by stage [mm]':<27}{'its rms [mm]':>{width}}{'time [ms/task]':>{width + 2}}"
    session.say(session.terminal.paint(head, "head"))
    session.say(f"  {'':<11}{'mean x':>8}{'mean y':>8}{short}  {short}")
    for i, stage in enumerate(STAGES):
        line = f"  {stage:<11}{1e3 * mine.mean[i, 0]:>+8.2f}{1e3 * mine.mean[i, 1]:>+8.2f}"
        line += "".join(f"{1e3 * one.rms[i]:>8.2f}" for _, one in robots) + "  "
        line += "".join(f"{1e3 * one.processor[i]:>8.1f}" for _, one in robots)
        session.say(line)
    x, y = mine.total[0]
    line = f"  {'their sum':<11}{1e3 * x:>+8.2f}{1e3 * y:>+8.2f}"
    session.say(line + "".join(f"{1e3 * one.total[1]:>8.2f}" for _, one in robots))
    session.say()


def say_change(session: Session, change: report.Change) -> None:
    """Write the differences of two robots with their intervals."""
    session.say(f"    success {percent(change.success)}; cycle {spread(change.seconds, 1.0, 's')}")
    session.say(f"    distance from the slot {spread(change.distance, 1e3, 'mm')}")


def percent(change: tuple[float, float, float]) -> str:
    """Return a change of the success with its interval."""
    value, low, high = (100.0 * x for x in change)
    return f"{value:+.1f} % [{low:+.1f}, {high:+.1f}]"


def spread(change: tuple[float, float, float], scale: float, unit: str) -> str:
    """Return a change with its interval, in a unit."""
    if math.isnan(change[0]):
        return "unknown"
    value, low, high = (scale * x for x in change)
    return f"{value:+.2f} {unit} [{low:+.2f}, {high:+.2f}]"


def say_named(
    session: Session, named: list[report.Named], parts: list[Part], played: Played
) -> None:
    """Write why tasks failed, and who is to blame."""
    for why, n in report.reasons(played)[:3]:
        session.say(f"  {n} tasks failed: {why}")
    broken = any(row.breach is not None for row in named)
    for row in named:
        word = session.terminal.paint(row.part, "bad")
        if row.breach is None and broken:
            session.wrap(
                f"The error of {word} is larger too, perhaps as a consequence of that: {row.text}."
            )
        elif row.breach is None:
            session.wrap(f"Look at {word}: {row.text}.")
        else:
            where = f"task {row.breach.task}, tick {row.breach.tick}"
            session.wrap(
                f"{word} broke a promise in {row.tasks} tasks, first in {where}: {row.text}."
            )
    if named and named[0].breach is not None:
        breach = named[0].breach
        say_call(session, breach.part, breach.text, breach.call, parts)
    if named or any(played.why):
        session.say()


def say_call(session: Session, name: str, text: str, call: str, parts: list[Part]) -> None:
    """Show a call as code, and write a file that repeats it beside the expected result."""
    if len(call) <= INLINE:
        session.say("The call:")
        wrapper = textwrap.TextWrapper(
            session.terminal.width,
            initial_indent="  ",
            subsequent_indent="      ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        for line in call.splitlines():
            # A line break after a comma inside of parentheses changes nothing.
            for short in wrapper.wrap(line):
                session.say(short)
    part = next(part for part in parts if part.slot == name)
    interrupts.check()
    path = session.work / "robot_call.py"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workspace.write_over(path, call_file(part, text, call))
    except OSError as error:
        session.notices.append(f"{workspace.shown(path)} can't be written: {error.strerror}.")
        return
    also = " and prints the expected result" if name in NAMED else ""
    session.wrap(f"python {workspace.shown(path)} repeats the call{also}.")


def call_file(part: Part, text: str, call: str) -> str:
    """Return a program that repeats a call.

    Args:
        part: that was called.
        text: what was wrong.
        call: as code; lines before the last one define what it uses.

    Returns:
        The program. For a slot it first prints what the course's part returns.
    """
    *before, last = call.splitlines()
    used = sorted(set(re.findall(r"\b[A-Z]\w+(?=\()", call)) & set(vars(records)))
    lines = [f"# {part.slot}: {text}", "import numpy as np", ""]
    if used:
        lines += [f"from drills.robot.records import {', '.join(used)}"]
    if part.slot in NAMED:
        lines += ["from drills.robot.holders import course_function"]
    if part.holder == YOURS:
        if part.slot not in NAMED:
            # A file of your own need not be in the folder of this program.
            folder = str(Path(part.filename).resolve().parent)
            lines += ["import sys", "", f"sys.path.insert(0, {folder!r})"]
        lines += [f"from {Path(part.filename).stem} import {part.entry}", ""]
    else:
        lines += ["", part.source]
    lines += ["", f"def call({part.entry}):", *(f"    {line}" for line in before)]
    lines += [f"    return {last}", "", ""]
    if part.slot in NAMED:
        lines += [f'print("expected:", call(course_function("{part.slot}")))']
    return "\n".join([*lines, f'print("yours:   ", call({part.entry}))', ""])


def stopped(session: Session, played: Played, parts: list[Part], payload: dict[str, Any]) -> int:
    """Report the part that stopped a run."""
    failure = played.failure
    assert failure is not None
    session.say()
    where = f" in line {failure.line}" if failure.line else ""
    when = (
        f" at task {failure.task}, tick {failure.tick}" if failure.task >= 0 else " while loading"
    )
    head = session.terminal.paint(f"{failure.part} stopped the robot{when}", "wrong")
    session.wrap(f"{head}: {failure.kind}{where}. {failure.text}")
    if failure.call and failure.task >= 0:
        say_call(session, failure.part, failure.text, failure.call, parts)
    lines = [f"{failure.part} stopped the robot{when}: {failure.text}"]
    payload = {"lines": lines, **payload, "failure": failure._asdict(), "passed": False}
    return session.finish(WRONG, payload)


def say_replaced(
    session: Session, previous: dict[str, Any], mine: Summary, entry: dict[str, Any]
) -> None:
    """Report what replacing parts has changed, on the same tasks and noise."""
    try:
        change = report.compare(report.restored(previous), mine)
        before = previous["parts"]
        replaced = [name for name in entry["parts"] if before.get(name) != entry["parts"][name]]
    except (KeyError, TypeError, ValueError):
        return
    session.say()
    session.wrap(
        f"Since your last robot you replaced {', '.join(replaced) or 'nothing'}. What this "
        "changed on the same tasks and noise, with 95 % intervals:"
    )
    say_change(session, change)
