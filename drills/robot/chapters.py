"""What a chapter changes in your robot: two robots, or two worlds, on the same tasks.

Chapters with slots compare your parts with the course's. Chapter 8 compares the exact arm with its
imperfect twin, chapter 10 fresh images with late ones, both for your robot as it is. Chapter 9 has
no slot: its button compares your whole robot with the course's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from drills import cards as catalogue
from drills.robot import report
from drills.robot.cell import World
from drills.robot.holders import Holder, course_part
from drills.robot.levels import exact_world, level
from drills.robot.play import Played, play
from drills.robot.slots import NAMES, YOURS, Part
from drills.terminal import listed

TASKS = 40
TWIN, LEARNING, MESSAGES = 8, 9, 10
FRESH, LATE = 2, 3  # levels that differ in latency alone
GAP = 0.25  # of chapter 8's twin: at 1, its far end, no part reaches its slot


class Side(NamedTuple):
    """One of the two robots of a comparison.

    Attributes:
        name: a few words.
        parts: one for each slot.
        level: number of the level.
        world: the arm as it is.
    """

    name: str
    parts: list[Part]
    level: int
    world: World


class Compared(NamedTuple):
    """Both sides on the same tasks and noise.

    Attributes:
        before, after: what was played.
        runs: of both.
        change: from before to after; None where a part stopped the run.
    """

    before: Side
    after: Side
    runs: tuple[Played, Played]
    change: report.Change | None


def slots_of(chapter: int) -> list[str]:
    """Return the slots that exercises of a chapter fill, in the order of the data."""
    return [name for name in NAMES if catalogue.card(name).chapter == chapter]


def sides(chapter: int, held: dict[str, Holder], number: int) -> tuple[Side, Side] | str:
    """Return what a chapter's button compares, or a sentence on what is missing for it.

    Args:
        chapter: its number.
        held: who holds the slots.
        number: of the level, where the chapter does not decide it.
    """
    mine = [holder.part for holder in held.values()]
    world = exact_world()
    if chapter == TWIN:
        from drills.robot.twin import imperfect_world

        return (
            Side("the exact arm", mine, number, world),
            Side("the imperfect arm of chapter 8", mine, number, imperfect_world(GAP)),
        )
    if chapter == MESSAGES:
        return (
            Side("fresh images", mine, FRESH, world),
            Side("images that arrive 0.1 s late", mine, LATE, world),
        )
    names = slots_of(chapter) if chapter != LEARNING else list(NAMES)
    own = [name for name in names if held[name].part.holder == YOURS]
    if not own:
        if not names:
            return f"No exercise of chapter {chapter} fills a slot of the robot."
        where = f"No slot of chapter {chapter}" if chapter != LEARNING else "No slot"
        return f"{where} holds a part of yours yet. drills start {names[0]} begins."
    without = [course_part(part.slot) if part.slot in own else part for part in mine]
    return (
        Side(f"with the course's {listed(own)}", without, number, world),
        Side(f"with your {listed(own)}", mine, number, world),
    )


def compare(
    pair: tuple[Side, Side],
    tasks: int,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> Compared:
    """Play both sides on the same tasks and the same noise.

    Args:
        pair: as `sides` returns it.
        tasks: of each side.
        seed: of the tasks.
        progress: called with the tasks done and their number, of both sides together.
    """
    runs: list[Played] = []
    for k, side in enumerate(pair):

        def show(done: int, of: int, before: int = k * tasks) -> None:
            if progress is not None:
                progress(before + done, 2 * of)

        runs.append(
            play(side.parts, level(side.level), tasks, seed=seed, world=side.world, progress=show)
        )
    first, second = runs
    stopped = first.failure or second.failure
    change = None
    if stopped is None:
        change = report.compare(report.summarise(first), report.summarise(second))
    return Compared(*pair, (first, second), change)
