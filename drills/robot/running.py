"""`drills robot run` and `compare`: play tasks, compare, and remember."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np

from drills import progress
from drills.robot import chapters, hidden, inside, report, state, tables, unfinished
from drills.robot.arguments import level_option, parts_options, seed_option, tasks_option
from drills.robot.cell import Level, World
from drills.robot.chapters import GAP
from drills.robot.holders import chosen, course_part, digest_of, library_part, stage_holders
from drills.robot.levels import LEVELS, exact_world, level
from drills.robot.play import part_names, play
from drills.robot.report import Summary
from drills.robot.slots import COURSE, NAMED, NAMES, STAGES, YOURS, Part
from drills.robot.state import HIDDEN, TASKS
from drills.robot.store import Stored
from drills.session import RIGHT, WRONG, Session, body, options

LIBRARIES = "libraries"  # the holder of a robot with a library's part wherever there is one
FIRST_NOT_PASSED = "the first that is not passed"


@click.command()
@level_option(len(LEVELS), FIRST_NOT_PASSED)
@tasks_option(1, 5000, TASKS)
@parts_options
@seed_option
@click.option(
    "--twin",
    "--sim2real",
    is_flag=True,
    help="The imperfect arm of chapter 8 instead of the exact one.",
)
@click.option(
    "--gap",
    type=click.FloatRange(0.0, 1.25),
    help="How far the twin is from what the robot believes: chapter 8's gap, usually "
    f"{GAP:g}. Implies --twin.",
)
@click.option(
    "--libraries/--no-libraries",
    "with_libraries",
    default=True,
    help="Whether a robot with the libraries' parts plays the same tasks.",
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
    with_libraries: bool,
) -> int:
    """Play tasks; the course's and the libraries' parts play the same, with the same noise."""
    session.command = "robot"
    stored, held = state.load(session)
    number = number or state.next_level(stored)
    started = progress.timestamp()
    if number == HIDDEN:
        tasks = min(tasks, hidden.MOST)
        with unfinished.noted(session, number, tasks, started):
            return hidden.run_hidden(session, stored, tasks)
    parts = chosen(session.work, held, choices, own, session.notices)
    if gap is None and twin:
        gap = GAP
    setting = Setting(number, tasks, seed, gap)
    with unfinished.noted(session, number, tasks, started):
        return _run(session, stored, parts, setting, started, with_libraries)


def _run(
    session: Session,
    stored: Stored,
    parts: list[Part],
    setting: Setting,
    started: str,
    with_libraries: bool,
) -> int:
    """Play your robot, store its result, then play the known robots, and report."""
    number, tasks, seed, gap = setting
    one, world = level(number), _world(gap)
    terminal = session.terminal
    session.say(terminal.paint(f"Level {number}: {one.title}", "head"))
    session.wrap(f"What usually breaks: {one.breaks}", "  ", "  ")
    for stage, counts in stage_holders(parts).items():
        session.say(f"  {stage:<11} {counts}")
    if not _has_own(parts):
        state.compile_known(session)
    bar = state.progress_bar(session, "yours")
    played = play(parts, one, tasks, seed=seed, world=world, progress=bar)
    payload: dict[str, Any] = {"action": "run", "level": number, "tasks": tasks, "seed": seed}
    if played.failure is not None:
        return tables.stopped(session, played, parts, payload)
    mine = report.summarise(played)
    empty = state.stages_without(parts)
    # Broken promises need no other robot, so the result is stored before any other one plays.
    broken = [row.part for row in report.diagnose(played, mine, None)]
    passed = mine.low > one.threshold
    it_counts = passed and gap is None and not empty and not broken
    entry = _entry(mine, parts, setting, started)
    _remember(session, entry, it_counts, number)
    all_course = all(part.holder == COURSE for part in parts)
    try:
        course = mine if all_course else known_result(session, stored, COURSE, setting)
        other = known_result(session, stored, LIBRARIES, setting) if with_libraries else None
        tables.say_summary(session, mine, None if all_course else course, other)
        named = report.diagnose(played, mine, None if all_course else course)
        tables.say_named(session, named, parts, played)
        verdict = _verdict(mine, one, passed, empty, broken)
        word = terminal.paint(verdict[0], "right" if passed else "wrong")
        session.wrap(f"{word}: {verdict[1]}")
        for line in verdict[2:]:
            session.wrap(line)
        previous = _previous(stored, entry)
        if previous is not None:
            tables.say_replaced(session, previous, mine, entry)
    except KeyboardInterrupt:
        session.notices.append("Your robot's result is stored: drills robot history shows it.")
        raise
    payload |= {
        "passed": passed,
        "counts": it_counts,
        "success": mine.rate,
        "low": mine.low,
        "high": mine.high,
        "course": None if course is None else course.rate,
        "libraries": None if other is None else other.rate,
        "parts": part_names(parts),
        "named": [row.part for row in named],
        "lines": [
            f"Level {number}: {int(mine.success.sum())} of {tasks} tasks, 95 % interval "
            f"{100 * mine.low:.1f} to {100 * mine.high:.1f} %.",
            f"{verdict[0]}: {verdict[1]}",
            *verdict[2:],
            *(f"Look at {row.part}: {row.text}." for row in named),
        ],
        "budget": {s: [float(x) for x in mine.mean[i]] for i, s in enumerate(STAGES)}
        if np.isfinite(mine.mean).all()
        else None,
    }
    return session.finish(RIGHT if passed else WRONG, payload)


def _verdict(
    mine: Summary, one: Level, passed: bool, empty: list[str], broken: list[str]
) -> list[str]:
    """Return whether a level is passed, why, and what is missing for it to count."""
    rule = f"its success rate must exceed {100 * one.threshold:.0f} % with 95 % confidence"
    why = f"{rule}, and the interval begins at {100 * mine.low:.1f} %."
    if not passed:
        need = report.tasks_needed(mine.rate, one.threshold)
        more = f" More tasks narrow the interval: at this rate, {need} are enough." if need else ""
        return [f"Level {one.number} not passed", why + more]
    lines = [f"Level {one.number} passed", why]
    if empty:
        lines.append(
            "It does not count yet: a robot of yours has a part of yours in every stage. "
            f"Missing: {', '.join(empty)}."
        )
    if broken:
        lines.append(f"It does not count yet: {', '.join(broken)} broke a promise.")
    return lines


def _has_own(parts: list[Part]) -> bool:
    return any(part.holder == YOURS for part in parts)


def _world(gap: float | None) -> World:
    if gap is None:
        return exact_world()
    from drills.robot.twin import imperfect_world

    return imperfect_world(gap=gap)


def _version() -> str:
    """Return a hash of the robot and the course's parts: results of another version don't count."""
    compiled = Path(inside.__file__).with_name("compiled.py").read_text(encoding="utf-8")
    parts = (course_part(name).source for name in NAMES)
    return digest_of("".join((inside.bundle(), compiled, *parts)))


class Setting(NamedTuple):
    """The tasks of a run.

    Attributes:
        level: its number.
        tasks: n.
        seed: of the tasks.
        gap: of the twin; None for the exact arm.
    """

    level: int
    tasks: int
    seed: int
    gap: float | None


def known_result(session: Session, stored: Stored, holder: str, setting: Setting) -> Summary | None:
    """Return how the course's or the libraries' parts do on the same tasks; they play them once.

    Args:
        session: of the command.
        stored: earlier results.
        holder: `COURSE` or `LIBRARIES`.
        setting: the tasks.

    Returns:
        The summary; None, and a notice, where a part of a library does not work here.
    """
    number, tasks, seed, gap = setting
    parts = [course_part(name) if holder == COURSE else library_part(name) for name in NAMES]
    version = _version()
    if holder == LIBRARIES:
        version = digest_of(version + "".join(part.holder + part.source for part in parts))
    world = "exact" if gap is None else f"twin {gap:g}"
    key = f"{number}/{tasks}/{seed}/{world}/{version}"
    try:
        return report.restored(getattr(stored, holder)[key])
    except (KeyError, TypeError, ValueError):
        pass
    state.compile_known(session)
    bar = state.progress_bar(session, f"the {holder}'s" if holder == COURSE else "libraries")
    played = play(parts, level(number), tasks, seed=seed, world=_world(gap), progress=bar)
    if played.failure is not None:
        session.notices.append(f"{played.failure.part} does not work here: {played.failure.text}")
        return None
    summary = report.summarise(played)

    def update(new: Stored) -> None:
        # Of each level only the newest version stays.
        results = getattr(new, holder)
        ours = f"{number}/"
        others = {k: v for k, v in results.items() if not k.startswith(ours)}
        same = {k: v for k, v in results.items() if k.startswith(ours) and version in k}
        setattr(new, holder, {**others, **dict(list(same.items())[-4:]), key: summary.plain()})

    state.change(session, update)
    return summary


def _entry(mine: Summary, parts: list[Part], setting: Setting, started: str) -> dict[str, Any]:
    """Return the stored form of a run."""
    number, tasks, seed, gap = setting
    return {
        "at": started,
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


def _remember(session: Session, entry: dict[str, Any], passed: bool, number: int) -> None:
    def edit(new: Stored) -> None:
        new.runs.append(entry)
        if passed:
            row = {"at": entry["at"], "robot": entry["robot"], "seed": entry["seed"]}
            new.passed.setdefault(str(number), row)

    state.change(session, edit)


@click.command()
@click.option("--chapter", type=click.IntRange(1, 11), required=True, help="Its number.")
@level_option(HIDDEN - 1, FIRST_NOT_PASSED)
@tasks_option(2, 200, chapters.TASKS)
@seed_option
@options
@body
def compare(session: Session, chapter: int, number: int | None, tasks: int, seed: int) -> int:
    """Put a chapter's parts into your robot, and see what that changes."""
    session.command = "robot"
    stored, held = state.load(session)
    payload: dict[str, Any] = {
        "action": "compare",
        "chapter": chapter,
        "slots": [
            {"slot": name, "does": NAMED[name].does, "holder": held[name].part.holder}
            for name in chapters.slots_of(chapter)
        ],
        "change": None,
    }
    pair = chapters.sides(chapter, held, number or min(state.next_level(stored), HIDDEN - 1))
    if isinstance(pair, str):
        session.wrap(pair)
        return session.finish(RIGHT, {**payload, "lines": [pair]})
    if not all(_has_own(side.parts) for side in pair):
        state.compile_known(session)
    done = chapters.compare(pair, tasks, seed, state.progress_bar(session, "both"))
    if done.change is None:
        played = next(run for run in done.runs if run.failure is not None)
        side = done.after if played is done.runs[1] else done.before
        assert played.failure is not None
        lines = [f"{played.failure.part} stopped the robot: {played.failure.text}"]
        return tables.stopped(session, played, side.parts, {**payload, "lines": lines})
    before, after = (report.summarise(run) for run in done.runs)
    lines = [
        f"Level {done.after.level}, {tasks} tasks, each with the same noise; 95 % intervals.",
        f"{done.before.name}: success {100 * before.rate:.0f} %",
        f"{done.after.name}: success {100 * after.rate:.0f} %",
        f"change of the success: {tables.percent(done.change.success)}",
        f"change of the cycle time: {tables.spread(done.change.seconds, 1.0, 's')}",
        f"change of the distance from the slot: {tables.spread(done.change.distance, 1e3, 'mm')}",
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
