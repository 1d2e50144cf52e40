"""`drills robot history` and `film`: a chart over the versions, and an animation."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from drills import workspace
from drills.robot import state, tables
from drills.robot.arguments import (
    level_option,
    output_option,
    parts_options,
    seed_option,
    tasks_option,
)
from drills.robot.holders import chosen
from drills.robot.levels import level
from drills.robot.play import play
from drills.robot.slots import YOURS
from drills.robot.state import HIDDEN
from drills.session import RIGHT, WRONG, Session, body, options
from drills.workspace import Misuse


@click.command()
@level_option(HIDDEN - 1, "the last that ran")
@output_option("PNG", "chart")
@options
@body
def history(session: Session, number: int | None, output: str | None) -> int:
    """Show your robot's versions: success and cycle time of each, and a chart."""
    from drills.robot import history as past

    session.command = "robot"
    stored, _ = state.load(session)
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
    course, other = (past.longest(one, number) for one in (stored.course, stored.libraries))
    for name, one in (("course", course), ("libraries", other)):
        if one is not None:
            interval = f"{100 * one.low:.1f} to {100 * one.high:.1f}"
            session.say(
                f"  {name:<28}{'':>4}{one.tasks:>7}{100 * one.rate:>8.1f} %   {interval:<15}"
                f"{one.quartiles()[1]:.2f} s"
            )
    path = Path(output) if output else session.work / "robot_history.png"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        past.draw(listed, path, course, other)
    except OSError as error:
        raise Misuse(f"{workspace.shown(path)} can't be written: {error.strerror}.") from None
    session.say()
    session.say(f"A chart: {workspace.shown(path)}")
    payload = {"action": "history", "level": number, "versions": listed}
    return session.finish(RIGHT, {**payload, "picture": str(path.absolute())})


@click.command("film")
@level_option(HIDDEN - 1, "the first that is not passed")
@tasks_option(1, 200, 20)
@parts_options
@seed_option
@output_option("HTML", "animation")
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
    stored, held = state.load(session)
    number = number or min(state.next_level(stored), HIDDEN - 1)
    parts = chosen(session.work, held, choices, own, session.notices)
    every = frozenset(range(tasks))
    progress_bar = state.progress_bar(session, "yours")
    if all(part.holder != YOURS for part in parts):
        state.compile_known(session)
    played = play(parts, level(number), tasks, seed=seed, filmed=every, progress=progress_bar)
    if played.failure is not None:
        return tables.stopped(session, played, parts, {"action": "film", "level": number})
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
