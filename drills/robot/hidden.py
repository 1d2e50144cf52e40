"""Level 6: a hidden fault, and the command that names its stage."""

from __future__ import annotations

import math
import secrets
from typing import Any

import click
import numpy as np

from drills import progress, workspace
from drills.robot import report, state
from drills.robot.holders import course_part
from drills.robot.levels import level
from drills.robot.play import play
from drills.robot.slots import NAMES, STAGES
from drills.robot.state import HIDDEN
from drills.robot.store import Stored
from drills.session import RIGHT, WRONG, Session, body, options
from drills.workspace import Misuse

IN_A_ROW = 3  # hidden faults to name; by chance one in 216 would
MOST = 60  # tasks of a log


def run_hidden(session: Session, stored: Stored, tasks: int) -> int:
    """Play with a hidden fault and write the log."""
    from drills.robot.loop import SIGNALS

    one, terminal = level(HIDDEN), session.terminal
    case = stored.hidden.get("case")
    if not isinstance(case, int):
        case = secrets.randbelow(1 << 31)

    def update(new: Stored) -> None:
        new.hidden["case"] = case

    state.change(session, update)  # before the log: its fault can then always be named
    stage, direction = fault_of(case)
    parts = [course_part(name) for name in NAMES]
    session.say(terminal.paint(f"Level {HIDDEN}: {one.title}", "head"))
    session.wrap(
        "The robot has the course's parts, and one stage has a fault. Each task's log says where "
        "the part was and where each stage believed it, or the tip, to be."
    )
    state.compile_known(session)
    bar = state.progress_bar(session, "tasks")
    fault = stage, direction
    played = play(parts, one, tasks, seed=case, fault=fault, progress=bar)
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
    summary = report.summarise(played)
    session.say(f"  success {int(summary.success.sum())}/{summary.tasks}")
    for why, n in report.reasons(played)[:3]:
        session.say(f"  {n} tasks failed: {why}")
    session.say()
    session.say(f"  the log: {workspace.shown(path)}, positions in m")
    session.say("  drills robot blame STAGE   names the stage: " + ", ".join(STAGES[:3]) + ",")
    session.say("                             " + ", ".join(STAGES[3:]))
    lines = [
        f"Level {HIDDEN} hides a fault in one stage. The log: {workspace.shown(path)}.",
        "drills robot blame STAGE, typed in a terminal, names the stage.",
    ]
    payload: dict[str, Any] = {
        "action": "run",
        "level": HIDDEN,
        "log": str(path.absolute()),
        "passed": False,
    }
    payload["lines"] = lines
    return session.finish(RIGHT, payload)


def fault_of(case: int) -> tuple[str, float]:
    """Return the stage of a hidden fault and the direction of its error [rad]."""
    rng = np.random.default_rng([case, HIDDEN])
    return STAGES[int(rng.integers(len(STAGES)))], float(rng.uniform(0.0, math.tau))


@click.command()
@click.argument("stage", required=False)
@options
@body
def blame(session: Session, stage: str | None) -> int:
    """Name the STAGE that has the hidden fault of level 6."""
    session.command = "robot"
    if stage not in STAGES:
        wrong = "" if stage is None else f"There is no stage {stage!r}. "
        raise Misuse(f"{wrong}drills robot blame takes one of: {', '.join(STAGES)}.")
    stored, _ = state.load(session)
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

    state.change(session, edit)
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
