"""The command `drills robot`: show your robot. Its subcommands are in neighbouring modules."""

from __future__ import annotations

import click

from drills import task_text
from drills.progress import NOT_ATTEMPTED, SOLVED
from drills.robot import state
from drills.robot.hidden import blame
from drills.robot.holders import Holder
from drills.robot.levels import LEVELS
from drills.robot.pictures import film_, history
from drills.robot.running import compare, run
from drills.robot.slots import NAMED, NAMES, SLOTS, STAGES, YOURS, of_stage, stage_of
from drills.robot.state import TASKS
from drills.session import RIGHT, Session, body, options


@click.group("robot", invoke_without_command=True)
@options
@click.pass_context
def command(context: click.Context, as_json: bool, work: str | None) -> int:
    """Build a robot from your answers, and measure it.

    Each solved exercise becomes a part of a pick-and-place robot. The course's parts fill the other
    slots.
    """
    if context.invoked_subcommand is None:
        return body(_status)(as_json=as_json, work=work)
    return RIGHT


@command.command()
@options
@body
def status(session: Session) -> int:
    """Show which slots hold your parts, and which levels your robot has passed."""
    return _status(session)


def _status(session: Session) -> int:
    session.command = "robot"
    stored, held = state.load(session)
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
    # Stages without a part of the learner's come first: a level counts once every stage has one.
    stages = state.stages_without([holder.part for holder in held.values()])
    first = [name for name in empty if stage_of(name) in stages] or empty
    if first:
        session.say(f"  drills start {first[0]}   fills the next slot")
    session.say(f"  drills robot run --level {state.next_level(stored)}   plays {TASKS} tasks")
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
        note = f"solved; save your answer as {name}.py"
    elif holder.wrong:
        note = "failed its last check"
    elif holder.changed:
        note = "changed since its last check"
    else:
        note = NAMED[name].does
    gap = " " if yours else ""
    session.say(
        f"  {mark} {name:<20} {label}{gap} {holder.digest if yours else '':<8}  {note}".rstrip()
    )


for _one in (run, compare, blame, history, film_):
    command.add_command(_one)
