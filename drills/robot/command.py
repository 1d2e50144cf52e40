"""The command `drills robot`: look at your robot, run it, film it, and see what changed."""

from __future__ import annotations

import math
import secrets
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np

from course import json_store
from course.json_store import Problem
from drills import progress, task_text, workspace
from drills.progress import NOT_ATTEMPTED, SOLVED
from drills.robot import chapters, inside, report, store
from drills.robot.cell import World
from drills.robot.chapters import GAP
from drills.robot.holders import (
    Holder,
    chosen,
    course_part,
    digest_of,
    holders,
    stage_holders,
)
from drills.robot.levels import LEVELS, exact_world, level
from drills.robot.play import Played, part_names, play
from drills.robot.report import Summary
from drills.robot.slots import COURSE, NAMED, NAMES, SLOTS, STAGES, YOURS, Part, of_stage, stage_of
from drills.robot.store import Stored
from drills.session import RIGHT, WRONG, Session, body, options
from drills.terminal import bar
from drills.workspace import Misuse

TASKS = 200
INLINE = 300  # characters of a call that a terminal shows
LEVEL = click.IntRange(1, len(LEVELS))
HIDDEN = 6  # the level with a hidden fault
IN_A_ROW = 3  # hidden faults to name; by chance one in 216 would


@click.group("robot", invoke_without_command=True)
@options
@click.pass_context
def command(context: click.Context, as_json: bool, work: str | None) -> int:
    """Build a robot from your answers, and measure it.

    Each solved exercise becomes a part of a pick-and-place robot; the course's parts fill the
    other slots.
    """
    if context.invoked_subcommand is None:
        return body(_status)(as_json=as_json, work=work)
    return RIGHT


@command.command()
@options
@body
def status(session: Session) -> int:
    """Draw the robot with its slots: who holds each, and which levels are passed."""
    return _status(session)


def _status(session: Session) -> int:
    session.command = "robot"
    stored, held = _load(session)
    terminal = session.terminal
    mine = sum(holder.part.holder == YOURS for holder in held.values())
    session.say(terminal.paint(f"Your robot: {mine} of {len(SLOTS)} slots hold your parts", "head"))
    session.say("  image -> perception -> estimation -> kinematics -> planning")
    session.say("        -> control -> physics -> the part in its slot")
    session.say()
    for stage in STAGES:
        session.say(terminal.paint(stage, "head"))
        for slot in of_stage(stage):
            _say_slot(session, held[slot.name])
    session.say()
    for one in LEVELS:
        passed = stored.passed.get(str(one.number))
        mark = task_text.sign(SOLVED if passed else NOT_ATTEMPTED, terminal)
        when = f"passed {str(passed.get('at', ''))[:10]}" if passed else ""
        session.say(f"  {mark} level {one.number}: {one.title:<34} {when}".rstrip())
    session.say()
    empty = [name for name in NAMES if held[name].part.holder != YOURS]
    # A stage without a part of the learner's first: a level counts once every stage has one.
    stages = _stages_without([holder.part for holder in held.values()])
    first = [name for name in empty if stage_of(name) in stages] or empty
    if first:
        session.say(f"  drills start {first[0]}   the next slot to fill")
    session.say(f"  drills robot run --level {_next_level(stored)}   plays {TASKS} tasks")
    payload = {
        "action": "status",
        "slots": [
            {
                "slot": name,
                "stage": NAMED[name].stage,
                "holder": holder.part.holder,
                "hash": holder.digest,
                "changed": holder.changed,
            }
            for name, holder in held.items()
        ],
        "passed": sorted(int(number) for number in stored.passed),
    }
    return session.finish(RIGHT, payload)


def _say_slot(session: Session, holder: Holder) -> None:
    terminal, name = session.terminal, holder.part.slot
    yours = holder.part.holder == YOURS
    mark = task_text.sign(SOLVED if yours else holder.state, terminal)
    label = terminal.paint("yours      ", "good") if yours else "the course's"[:12]
    if holder.missing:
        note = f"solved; put your answer into {name}.py"
    elif holder.wrong:
        note = "its last grading was not right"
    elif holder.changed:
        note = "changed since it was graded"
    else:
        note = NAMED[name].does
    gap = " " if yours else ""
    session.say(
        f"  {mark} {name:<20} {label}{gap} {holder.digest if yours else '':<8}  {note}".rstrip()
    )


def _next_level(stored: Stored) -> int:
    return next((one.number for one in LEVELS if str(one.number) not in stored.passed), HIDDEN)


def _load(session: Session) -> tuple[Stored, dict[str, Holder]]:
    """Return what is stored and who holds the slots."""
    path = store.path_of(session.work, session.progress_file)
    stored, notices = json_store.load(path, store.FORM)
    session.notices += notices
    before = {name: dict(row) for name, row in stored.graded.items()}
    held = holders(session.work, session.records(), stored)
    if stored.graded != before:

        def remember(new: Stored) -> None:
            new.graded = stored.graded

        _change(session, remember)
    return stored, held


def _change(session: Session, edit: Any) -> None:
    path = store.path_of(session.work, session.progress_file)
    try:
        _, notices = json_store.change(path, store.FORM, edit)
        session.notices += notices
    except Problem as problem:
        session.notices.append(str(problem))


@command.command()
@click.option("--level", "number", type=LEVEL, help="1 to 6; else the first that is not passed.")
@click.option("--tasks", type=click.IntRange(1, 5000), default=TASKS, show_default=True)
@click.option("--part", "choices", multiple=True, metavar="SLOT=WHO", help="Who holds a slot or a "
              "stage: yours, course, or a library.")  # fmt: skip
@click.option(
    "--own", multiple=True, metavar="FUNCTION=FILE", help="A stage's function of your own."
)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option(
    "--twin", is_flag=True, help="The imperfect arm of chapter 8 instead of the exact one."
)
@click.option(
    "--gap",
    type=click.FloatRange(0.0, 1.25),
    help="How far the twin is from what the robot believes: chapter 8's gap, usually "
    f"{GAP:g}. Implies --twin.",
)
@options
@body
def run(
    session: Session,
    number: int | None,
    tasks: int,
    choices: tuple[str, ...],
    own: tuple[str, ...],
    seed: int,
    twin: bool,
    gap: float | None,
) -> int:
    """Play tasks, and compare with the course's parts on the same tasks and noise."""
    session.command = "robot"
    stored, held = _load(session)
    number = number or _next_level(stored)
    if number == HIDDEN:
        return _run_hidden(session, stored, held, tasks)
    parts = chosen(session.work, held, choices, own, session.notices)
    if gap is None and twin:
        gap = GAP
    one, world = level(number), _world(gap)
    terminal = session.terminal
    session.say(terminal.paint(f"Level {number}: {one.title}", "head"))
    session.wrap(f"What usually breaks: {one.breaks}", "  ", "  ")
    for stage, counts in stage_holders(parts).items():
        session.say(f"  {stage:<11} {counts}")
    played = play(parts, one, tasks, seed=seed, world=world, progress=_progress(session, "yours"))
    payload: dict[str, Any] = {"action": "run", "level": number, "tasks": tasks, "seed": seed}
    if played.failure is not None:
        return _stopped(session, played, parts, payload)
    mine = report.summarise(played)
    all_course = all(part.holder == COURSE for part in parts)
    course = mine if all_course else _course(session, stored, number, tasks, seed, gap)
    _say_summary(session, mine, None if all_course else course)
    named = report.diagnose(played, mine, None if all_course else course)
    _say_named(session, named, parts, played)
    empty = _stages_without(parts)
    broken = [row.part for row in named if row.breach is not None]
    passed = mine.low > one.threshold
    it_counts = passed and gap is None and not empty and not broken
    lower = f"{100 * mine.low:.1f} %"
    rule = f"its success rate must exceed {100 * one.threshold:.0f} % with 95 % confidence"
    if passed:
        word = terminal.paint(f"Level {number} passed", "right")
        session.wrap(f"{word}: {rule}, and the interval begins at {lower}.")
        if empty:
            session.wrap(
                f"It does not count yet: a robot of yours has a part of yours in every stage. "
                f"Missing: {', '.join(empty)}."
            )
        if broken:
            session.wrap(f"It does not count yet: {', '.join(broken)} broke a promise.")
    else:
        need = report.tasks_needed(mine.rate, one.threshold)
        more = f" More tasks narrow the interval: at this rate, {need} are enough." if need else ""
        word = terminal.paint(f"Level {number} not passed", "wrong")
        session.wrap(f"{word}: {rule}, and the interval begins at {lower}.{more}")
    entry = _entry(mine, parts, number, tasks, seed, gap)
    previous = _previous(stored, entry)
    if previous is not None:
        _say_change(session, previous, mine, entry)
    _remember(session, entry, it_counts, number)
    payload |= {
        "passed": passed,
        "counts": it_counts,
        "success": mine.rate,
        "low": mine.low,
        "high": mine.high,
        "parts": part_names(parts),
        "named": [row.part for row in named],
        "budget": {s: [float(x) for x in mine.mean[i]] for i, s in enumerate(STAGES)}
        if np.isfinite(mine.mean).all()
        else None,
    }
    return session.finish(RIGHT if passed else WRONG, payload)


def _stages_without(parts: list[Part]) -> list[str]:
    """Return the stages in which no part is the learner's."""
    own = {stage_of(part.slot) for part in parts if part.holder == YOURS}
    return [stage for stage in STAGES if stage not in own]


def _world(gap: float | None) -> World:
    if gap is None:
        return exact_world()
    from drills.robot.twin import imperfect_world

    return imperfect_world(gap=gap)


def _progress(session: Session, robot: str) -> Any:
    """Return what draws the bar, where somebody is watching."""
    if session.terminal.json or sys.stderr is None or not sys.stderr.isatty():
        return None

    def draw(done: int, of: int) -> None:
        end = "\r" + " " * 60 + "\r" if done == of else ""
        text = bar(done, of, 30)
        text = text if session.terminal.unicode else text.replace("█", "#").replace("░", ".")
        sys.stderr.write(f"\r  {robot:<12} {text} {done}/{of}{end}")
        sys.stderr.flush()

    return draw


def _version() -> str:
    """Return a hash of the robot and the course's parts: results of another version don't count."""
    compiled = Path(inside.__file__).with_name("compiled.py").read_text(encoding="utf-8")
    parts = (course_part(name).source for name in NAMES)
    return digest_of("".join((inside.bundle(), compiled, *parts)))


def _course(
    session: Session, stored: Stored, number: int, tasks: int, seed: int, gap: float | None
) -> Summary:
    """Return how the course's parts do on the same tasks; they are played once."""
    world = "exact" if gap is None else f"twin {gap:g}"
    key = f"{number}/{tasks}/{seed}/{world}/{_version()}"
    try:
        return report.restored(stored.course[key])
    except (KeyError, TypeError, ValueError):
        pass
    parts = [course_part(name) for name in NAMES]
    played = play(
        parts, level(number), tasks, seed=seed, world=_world(gap),
        progress=_progress(session, "the course's"),
    )  # fmt: skip
    summary = report.summarise(played)

    def update(new: Stored) -> None:
        # Of each level only the newest version stays.
        ours = f"{number}/"
        others = {k: v for k, v in new.course.items() if not k.startswith(ours)}
        same = {k: v for k, v in new.course.items() if k.startswith(ours) and _version() in k}
        new.course = {**others, **dict(list(same.items())[-4:]), key: summary.plain()}

    _change(session, update)
    return summary


def _stopped(session: Session, played: Played, parts: list[Part], payload: dict[str, Any]) -> int:
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
        _say_call(session, failure.part, failure.text, failure.call, parts)
    payload |= {"failure": failure._asdict(), "passed": False}
    return session.finish(WRONG, payload)


def _say_call(session: Session, name: str, text: str, call: str, parts: list[Part]) -> None:
    """Show a call as code; a long one goes into a file that can be run."""
    if len(call) <= INLINE:
        session.say("The call:")
        for line in call.splitlines():
            session.say(f"  {line}")
        return
    part = next(part for part in parts if part.slot == name)
    *before, last = call.splitlines()
    lines = [f"# {name}: {text}", "import numpy as np", ""]
    if part.holder == YOURS:
        lines += [f"from {Path(part.filename).stem} import {part.entry}", ""]
    else:
        lines += [part.source]
    lines += [*before, f"print({last})", ""]
    path = session.work / "robot_call.py"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workspace.write_over(path, "\n".join(lines))
    except OSError as error:
        session.notices.append(f"{workspace.shown(path)} can't be written: {error.strerror}.")
        return
    session.wrap(f"The call, ready to run: python {workspace.shown(path)}")


def _say_summary(session: Session, mine: Summary, course: Summary | None) -> None:
    terminal = session.terminal
    session.say()

    def success(one: Summary) -> str:
        return f"{int(one.success.sum())}/{one.tasks}"

    def percent(low: float, high: float) -> str:
        return f"{100 * low:.1f} to {100 * high:.1f} %"

    def cycle(one: Summary) -> str:
        low, middle, high = one.quartiles()
        return "none" if math.isnan(middle) else f"{middle:.2f} s ({low:.2f} to {high:.2f})"

    other = "" if course is None else "the course's"
    rows = [
        ("", "your robot", other),
        ("success", success(mine), success(course) if course else ""),
        (
            "95 % interval",
            percent(mine.low, mine.high),
            percent(course.low, course.high) if course else "",
        ),
        ("cycle, quartiles", cycle(mine), cycle(course) if course else ""),
    ]
    for name, left, right in rows:
        session.say(f"  {name:<18}{left:<26}{right}".rstrip())
    if course is not None:
        change = report.compare(course, mine)
        session.say("  yours minus the course's, same tasks, with 95 % intervals:")
        session.say(
            f"    success {_percent(change.success)}; cycle {_spread(change.seconds, 1.0, 's')}"
        )
        session.say(f"    distance from the slot {_spread(change.distance, 1e3, 'mm')}")
    session.say()
    if not np.isfinite(mine.rms).all():
        session.wrap("No task was finished, so there is no error to divide among the stages.", "  ")
        return
    head = f"  {'error by stage [mm]':<21}{'mean x':>8}{'mean y':>8}{'rms':>7}"
    head += f"{'course':>8}{'ms/task':>10}{'course':>8}" if course else f"{'ms/task':>10}"
    session.say(terminal.paint(head, "head"))
    for i, stage in enumerate(STAGES):
        line = f"  {stage:<21}{1e3 * mine.mean[i, 0]:>+8.2f}{1e3 * mine.mean[i, 1]:>+8.2f}"
        line += f"{1e3 * mine.rms[i]:>7.2f}"
        line += f"{1e3 * course.rms[i]:>8.2f}" if course else ""
        line += f"{1e3 * mine.processor[i]:>10.1f}"
        line += f"{1e3 * course.processor[i]:>8.1f}" if course else ""
        session.say(line)
    (x, y), rms = mine.total
    line = f"  {'their sum':<21}{1e3 * x:>+8.2f}{1e3 * y:>+8.2f}{1e3 * rms:>7.2f}"
    session.say(line + (f"{1e3 * course.total[1]:>8.2f}" if course else ""))
    session.say()


def _percent(change: tuple[float, float, float]) -> str:
    value, low, high = (100.0 * x for x in change)
    return f"{value:+.1f} % [{low:+.1f}, {high:+.1f}]"


def _spread(change: tuple[float, float, float], scale: float, unit: str) -> str:
    if math.isnan(change[0]):
        return "unknown"
    value, low, high = (scale * x for x in change)
    return f"{value:+.2f} {unit} [{low:+.2f}, {high:+.2f}]"


def _say_named(
    session: Session, named: list[report.Named], parts: list[Part], played: Played
) -> None:
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
        _say_call(session, breach.part, breach.text, breach.call, parts)
    if named or any(played.why):
        session.say()


def _entry(
    mine: Summary, parts: list[Part], number: int, tasks: int, seed: int, gap: float | None
) -> dict[str, Any]:
    """Return what is stored of a run."""
    return {
        "at": progress.timestamp(),
        "level": number,
        "tasks": tasks,
        "seed": seed,
        "twin": False if gap is None else gap,
        "parts": {part.slot: [part.holder, digest_of(part.source)] for part in parts},
        "robot": digest_of("".join(sorted(part.slot + part.source for part in parts))),
        "version": _version(),
        **mine.plain(),
    }


def _previous(stored: Stored, entry: dict[str, Any]) -> dict[str, Any] | None:
    """Return the last run of another robot on the same tasks."""
    same = ("level", "tasks", "seed", "twin", "version")
    for old in reversed(stored.runs):
        alike = all(old.get(name) == entry[name] for name in same)
        if alike and old.get("robot") != entry["robot"]:
            return old
    return None


def _say_change(
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
    session.wrap(f"Since your last robot you replaced {', '.join(replaced) or 'nothing'}. Changes:")
    session.say(
        f"    success {_percent(change.success)}; cycle {_spread(change.seconds, 1.0, 's')}"
    )
    session.say(f"    distance from the slot {_spread(change.distance, 1e3, 'mm')}")


def _remember(session: Session, entry: dict[str, Any], passed: bool, number: int) -> None:
    def edit(new: Stored) -> None:
        new.runs.append(entry)
        if passed:
            row = {"at": entry["at"], "robot": entry["robot"], "seed": entry["seed"]}
            new.passed.setdefault(str(number), row)

    _change(session, edit)


# --- what a chapter changes ---------------------------------------------------------------------


@command.command()
@click.option("--chapter", type=click.IntRange(1, 11), required=True, help="Its number.")
@click.option(
    "--level", "number", type=click.IntRange(1, HIDDEN - 1), help="Else the first not passed."
)
@click.option("--tasks", type=click.IntRange(2, 200), default=chapters.TASKS, show_default=True)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@options
@body
def compare(session: Session, chapter: int, number: int | None, tasks: int, seed: int) -> int:
    """Put a chapter's parts into your robot, and see what that changes."""
    session.command = "robot"
    stored, held = _load(session)
    payload: dict[str, Any] = {
        "action": "compare",
        "chapter": chapter,
        "slots": [
            {"slot": name, "does": NAMED[name].does, "holder": held[name].part.holder}
            for name in chapters.slots_of(chapter)
        ],
        "change": None,
    }
    pair = chapters.sides(chapter, held, number or min(_next_level(stored), HIDDEN - 1))
    if isinstance(pair, str):
        session.wrap(pair)
        return session.finish(RIGHT, {**payload, "lines": [pair]})
    done = chapters.compare(pair, tasks, seed, _progress(session, "both"))
    if done.change is None:
        played = next(run for run in done.runs if run.failure is not None)
        side = done.after if played is done.runs[1] else done.before
        assert played.failure is not None
        lines = [f"{played.failure.part} stopped the robot: {played.failure.text}"]
        return _stopped(session, played, side.parts, {**payload, "lines": lines})
    before, after = (report.summarise(run) for run in done.runs)
    lines = [
        f"Level {done.after.level}, {tasks} tasks, each with the same noise; 95 % intervals.",
        f"{done.before.name}: success {100 * before.rate:.0f} %",
        f"{done.after.name}: success {100 * after.rate:.0f} %",
        f"change of the success: {_percent(done.change.success)}",
        f"change of the cycle time: {_spread(done.change.seconds, 1.0, 's')}",
        f"change of the distance from the slot: {_spread(done.change.distance, 1e3, 'mm')}",
    ]
    if chapter not in (chapters.TWIN, chapters.MESSAGES):
        named = report.diagnose(done.runs[1], after, before)
        lines += [f"Look at {row.part}: {row.text}." for row in named]
    for line in lines:
        session.wrap(line)
    payload |= {
        "lines": lines,
        "level": done.after.level,
        "tasks": tasks,
        "success": [before.rate, after.rate],
        "change": {
            name: [None if math.isnan(x) else x for x in values]
            for name, values in done.change._asdict().items()
        },
    }
    return session.finish(RIGHT, payload)


# --- level 6 --------------------------------------------------------------------------------------


def _run_hidden(session: Session, stored: Stored, held: dict[str, Holder], tasks: int) -> int:
    """Play with a hidden fault and write the log."""
    from drills.robot.loop import SIGNALS

    one, terminal = level(HIDDEN), session.terminal
    case = stored.hidden.get("case")
    if not isinstance(case, int):
        case = secrets.randbelow(1 << 31)
    stage, direction = fault_of(case)
    parts = [course_part(name) for name in NAMES]
    session.say(terminal.paint(f"Level {HIDDEN}: {one.title}", "head"))
    session.wrap(
        "The robot has the course's parts, and one stage has a fault. Each task's log says where "
        "the part was and where each stage believed it, or the tip, to be."
    )
    played = play(
        parts, one, min(tasks, 60), seed=case, fault=(stage, direction),
        progress=_progress(session, "tasks"),
    )  # fmt: skip
    path = session.work / "robot_log.csv"
    head = ",".join(["task", *(f"{name}_{axis}" for name in SIGNALS for axis in "xy")])
    rows = [
        ",".join([str(int(n)), *(f"{value:.6f}" for value in signals.ravel())])
        for n, signals in zip(played.numbers, played.signals, strict=True)
    ]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workspace.write_over(path, "\n".join([head, *rows, ""]))
    except OSError as error:
        raise Misuse(f"{workspace.shown(path)} can't be written: {error.strerror}.") from None

    def update(new: Stored) -> None:
        new.hidden["case"] = case

    _change(session, update)
    summary = report.summarise(played)
    session.say(f"  success {int(summary.success.sum())}/{summary.tasks}")
    for why, n in report.reasons(played)[:3]:
        session.say(f"  {n} tasks failed: {why}")
    session.say()
    session.say(f"  the log: {workspace.shown(path)}, positions in m")
    session.say("  drills robot blame STAGE   names the stage: " + ", ".join(STAGES[:3]) + ",")
    session.say("                             " + ", ".join(STAGES[3:]))
    payload = {"action": "run", "level": HIDDEN, "log": str(path.absolute()), "passed": False}
    return session.finish(RIGHT, payload)


def fault_of(case: int) -> tuple[str, float]:
    """Return the stage of a hidden fault and the direction of its error [rad]."""
    rng = np.random.default_rng([case, HIDDEN])
    return STAGES[int(rng.integers(len(STAGES)))], float(rng.uniform(0.0, math.tau))


@command.command()
@click.argument("stage", required=False)
@options
@body
def blame(session: Session, stage: str | None) -> int:
    """Name the STAGE that has the hidden fault of level 6."""
    session.command = "robot"
    if stage not in STAGES:
        wrong = "" if stage is None else f"There is no stage {stage!r}. "
        raise Misuse(f"{wrong}drills robot blame takes one of: {', '.join(STAGES)}.")
    stored, _ = _load(session)
    case = stored.hidden.get("case")
    if not isinstance(case, int):
        raise Misuse("No fault is hidden. drills robot run --level 6 hides one.")
    true, _ = fault_of(case)
    right = stage == true
    row = int(stored.hidden.get("row", 0)) + 1 if right else 0
    passed = row >= IN_A_ROW

    def edit(new: Stored) -> None:
        new.hidden = {"row": row}
        if passed:
            new.passed.setdefault(str(HIDDEN), {"at": progress.timestamp()})

    _change(session, edit)
    if right:
        session.wrap(f"Right: the fault was in {true}. {row} in a row.")
    else:
        session.wrap(f"No: the fault was in {true}. The count begins again.")
    if passed:
        session.say(session.terminal.paint(f"Level {HIDDEN} passed", "right"))
    else:
        session.wrap(f"Level {HIDDEN} takes {IN_A_ROW} in a row. drills robot run --level 6")
    payload = {"action": "blame", "right": right, "stage": true, "row": row, "passed": passed}
    return session.finish(RIGHT if right else WRONG, payload)


# --- versions and film ----------------------------------------------------------------------------


@command.command()
@click.option(
    "--level", "number", type=click.IntRange(1, HIDDEN - 1), help="Else the last that ran."
)
@click.option("-o", "--output", metavar="PNG", help="Where to write the chart.")
@options
@body
def history(session: Session, number: int | None, output: str | None) -> int:
    """Show your robot's versions: success and cycle time of each, and a chart."""
    from drills.robot import history as past

    session.command = "robot"
    stored, _ = _load(session)
    ran = [run["level"] for run in stored.runs if isinstance(run.get("level"), int)]
    if not ran:
        raise Misuse("Your robot has not run yet. drills robot run plays its first tasks.")
    number = number or ran[-1]
    listed = past.rows(past.versions(stored.runs, number))
    if not listed:
        raise Misuse(f"Your robot has not run at level {number} yet.")
    session.say(session.terminal.paint(f"Versions at level {number}", "head"))
    head = f"  {'version':<10}{'date':<18}{'own':>4}{'tasks':>7}{'success':>10}   {'95 %':<15}cycle"
    session.say(head)
    for row in listed:
        cycle = "" if row["cycle"] is None else f"{row['cycle']:.2f} s"
        interval = f"{100 * row['low']:.1f} to {100 * row['high']:.1f}"
        session.say(
            f"  {row['robot']:<10}{row['at'][:16].replace('T', ' '):<18}{row['own']:>4}"
            f"{row['tasks']:>7}{100 * row['success']:>8.1f} %   {interval:<15}{cycle}"
        )
    course = None
    for key, data in stored.course.items():
        if key.startswith(f"{number}/") and "/exact/" in key:
            course = report.restored(data)
    path = Path(output) if output else session.work / "robot_history.png"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        past.draw(listed, course, path)
    except OSError as error:
        raise Misuse(f"{workspace.shown(path)} can't be written: {error.strerror}.") from None
    session.say()
    session.say(f"A chart: {workspace.shown(path)}")
    payload = {"action": "history", "level": number, "versions": listed}
    return session.finish(RIGHT, {**payload, "picture": str(path.absolute())})


@command.command("film")
@click.option("--level", "number", type=click.IntRange(1, HIDDEN - 1), help="Else the next one.")
@click.option("--tasks", type=click.IntRange(1, 200), default=20, show_default=True)
@click.option("--part", "choices", multiple=True, metavar="SLOT=WHO", help="As for run.")
@click.option("--own", multiple=True, metavar="FUNCTION=FILE", help="As for run.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True)
@click.option("-o", "--output", metavar="HTML", help="Where to write the animation.")
@options
@body
def film_(
    session: Session,
    number: int | None,
    tasks: int,
    choices: tuple[str, ...],
    own: tuple[str, ...],
    seed: int,
    output: str | None,
) -> int:
    """Write an animation of a success and of the failure that teaches most."""
    from drills.robot import film

    session.command = "robot"
    stored, held = _load(session)
    number = number or min(_next_level(stored), HIDDEN - 1)
    parts = chosen(session.work, held, choices, own, session.notices)
    every = frozenset(range(tasks))
    progress_bar = _progress(session, "yours")
    played = play(parts, level(number), tasks, seed=seed, filmed=every, progress=progress_bar)
    if played.failure is not None:
        return _stopped(session, played, parts, {"action": "film", "level": number})
    worst = film.lesson(played)
    good = [int(n) for n in played.numbers[played.success] if n != worst and int(n) in played.logs]
    numbers = [n for n in [*good[:1], worst] if n in played.logs]
    if not numbers:
        session.say("The arm did not move in any task, so there is nothing to show.")
        return session.finish(WRONG, {"action": "film", "level": number, "file": None})
    html = film.page(film.film(played, level(number), seed, numbers))
    path = Path(output) if output else session.work / "robot_film.html"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        workspace.write_over(path, html)
    except OSError as error:
        raise Misuse(f"{workspace.shown(path)} can't be written: {error.strerror}.") from None
    for n in numbers:
        i = int(np.flatnonzero(played.numbers == n)[0])
        session.say(f"  task {n}: {played.why[i] or 'a success'}")
    session.wrap(f"Wrote {workspace.shown(path)}. Open it in a browser, or in a notebook:")
    session.say("  from drills.robot import film")
    session.say(f'  film.show("{workspace.shown(path)}")')
    payload = {"action": "film", "level": number, "file": str(path.absolute()), "shown": numbers}
    return session.finish(RIGHT, payload)
