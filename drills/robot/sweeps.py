"""One setting of the robot as a job of `course.measure.sweep.sweep`, for any executor.

docs/howto/robot_planner.md has an example.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from drills.robot import report
from drills.robot.holders import Holder, chosen, course_part
from drills.robot.levels import exact_world
from drills.robot.levels import level as level_of
from drills.robot.play import play
from drills.robot.slots import NAMES


class Row(NamedTuple):
    """The result of a job.

    Attributes:
        level, seed, tasks: of the job.
        success: share of the tasks.
        low, high: its 95 % interval.
        cycle: median cycle time [s], NaN without a placed part.
        distance: root mean square of the placed part's distance from its slot [m].
        failure: the part that stopped the run and why; "" if none did.
    """

    level: int
    seed: int
    tasks: int
    success: float
    low: float
    high: float
    cycle: float
    distance: float
    failure: str


def evaluate(
    level: int,
    seed: int,
    tasks: int,
    choices: tuple[str, ...] = (),
    own: tuple[str, ...] = (),
    gap: float | None = None,
    work: str = ".",
) -> Row:
    """Play one setting.

    Args:
        level: 1 to 5.
        seed: of the tasks.
        tasks: how many.
        choices: "SLOT=HOLDER" or "STAGE=HOLDER", as for `drills robot run --part`; the course holds
            all other slots.
        own: "FUNCTION=FILE", as for `--own`.
        gap: of the imperfect arm, as for `--gap`; None for the exact one.
        work: the folder of your answers.

    Returns:
        The row.

    Raises:
        Misuse: for a slot, a holder or a file that does not exist.
    """
    from drills.robot.twin import imperfect_world

    held = {name: Holder(course_part(name), "", "") for name in NAMES}
    parts = chosen(Path(work), held, choices, own)
    world = exact_world() if gap is None else imperfect_world(gap)
    played = play(parts, level_of(level), tasks, seed=seed, world=world)
    one = report.summarise(played)
    failure = played.failure
    return Row(
        level,
        seed,
        tasks,
        one.rate,
        one.low,
        one.high,
        one.quartiles()[1],
        one.total[1],
        "" if failure is None else f"{failure.part}: {failure.text}",
    )
