"""Play many tasks, with a progress bar.

A robot with a part of the learner's runs in two child processes of the sandbox, a task at a time:
the learner's parts never run in this process, and what comes back is plain data, checked by shape.
A robot of the course's and libraries' parts runs here, compiled.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

import numpy as np

from course.check import count
from drills import interrupts
from drills.robot import inside
from drills.robot.cell import Level, World
from drills.robot.levels import exact_world
from drills.robot.parts import PartFailed
from drills.robot.records import Array, Breach, Failure, Outcome
from drills.robot.slots import NAMED, STAGES, YOURS, Part
from drills.sandbox import Child, Ended, Limits, Raised

CHILDREN = 2
TASK = 12.0  # s of processor time of one task, in all parts
HANG = 6.0  # s, when a task that did not return is played again to name the part
Progress = Callable[[int, int], object]


class Played(NamedTuple):
    """The outcomes of a robot's tasks, as arrays over n tasks.

    Attributes:
        numbers: of the tasks, shape (n,).
        success: shape (n,).
        why: what ended each task early, "" for a success.
        seconds: cycle time, infinite without a placed part, shape (n,) [s].
        error: of the placed part, NaN without one, shape (n, 2) [m].
        grasp: error of the grasp, shape (n, 2) [m].
        budget: the share of each stage in the error, shape (n, stages, 2) [m].
        processor: time of each stage, shape (n, stages) [s].
        moments: of grip and release, NaN where they did not come, shape (n, 2) [s].
        signals: positions in the log of each task, shape (n, signals, 2) [m].
        breaches: promises that parts broke.
        failure: the part that stopped the run, or None.
        logs: motions of the filmed tasks, by number: joint angles, shape (k, 2) [rad].
    """

    numbers: Array
    success: Array
    why: tuple[str, ...]
    seconds: Array
    error: Array
    grasp: Array
    budget: Array
    processor: Array
    moments: Array
    signals: Array
    breaches: tuple[Breach, ...]
    failure: Failure | None
    logs: dict[int, Array]


def play(
    parts: list[Part],
    level: Level,
    tasks: int,
    *,
    seed: int = 0,
    world: World | None = None,
    fault: tuple[str, float] | None = None,
    filmed: frozenset[int] = frozenset(),
    progress: Progress | None = None,
) -> Played:
    """Play tasks 0 to n - 1 with a set of parts.

    Args:
        parts: one for each slot; functions of `records.Stages` that are replaced come after them.
        level: what the robot has to do.
        tasks: n.
        seed: of all tasks.
        world: the arm as it is; exactly as the robot believes by default.
        fault: a stage with a hidden fault, and its direction.
        filmed: numbers of tasks whose motion is recorded.
        progress: called with the tasks done and their number.

    Returns:
        All outcomes; up to the failure where a part stops the run.
    """
    count("tasks", tasks, 1)
    world = world or exact_world()
    if all(part.holder != YOURS for part in parts):
        with interrupts.heeded(ends_process=True):
            return _known(parts, level, tasks, seed, world, fault, filmed, progress)
    with interrupts.heeded():
        return _own(parts, level, tasks, seed, world, fault, filmed, progress)


def _own(
    parts: list[Part],
    level: Level,
    tasks: int,
    seed: int,
    world: World,
    fault: tuple[str, float] | None,
    filmed: frozenset[int],
    progress: Progress | None,
) -> Played:
    """Play with a part of the learner's, in child processes."""
    outcomes: list[Outcome] = []
    stop, lock, remaining = threading.Event(), threading.Lock(), iter(range(tasks))
    source = inside.bundle()
    settings = _settings(parts, level, world, seed, fault)
    opened: list[Child] = []
    abandoned = threading.Event()
    workers = min(CHILDREN, tasks, os.cpu_count() or 1)

    def worker() -> None:
        with _child(source) as child:
            opened.append(child)
            failed = None if abandoned.is_set() else _prepare(child, settings)
            if failed is not None:
                stop.set()
                with lock:
                    outcomes.append(_stopped(failed))
                return
            while not stop.is_set():
                with lock:
                    number = next(remaining, None)
                if number is None:
                    return
                outcome = _one(child, settings, number, number in filmed)
                if isinstance(outcome, Ended):
                    if abandoned.is_set():
                        return  # the command has ended the child itself: no part is to blame
                    stop.set()
                    outcome = _stopped(_culprit(source, settings, number, outcome, opened))
                with lock:
                    outcomes.append(outcome)
                if outcome["failure"]:
                    stop.set()
                    return

    with ThreadPoolExecutor(workers) as pool:
        futures = {pool.submit(worker) for _ in range(workers)}
        try:
            pending = futures
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for future in done:
                    future.result()
                if progress is not None:
                    progress(len(outcomes), tasks)
        except BaseException:
            abandoned.set()  # first, so that a child that starts now is seen by its worker
            for child in list(opened):
                child.kill()
            raise
        finally:
            stop.set()
    interrupts.check()
    return gather(outcomes)


def _known(
    parts: list[Part],
    level: Level,
    tasks: int,
    seed: int,
    world: World,
    fault: tuple[str, float] | None,
    filmed: frozenset[int],
    progress: Progress | None,
) -> Played:
    """Play with parts of the course and of libraries, in this process and compiled."""
    from drills.robot.compiled import engine_of

    try:
        robot = inside.Robot(parts, level, world, seed, 0.0, fault, engine_of(parts))
    except PartFailed as failed:
        return gather([_stopped(failed.failure)])
    outcomes: list[Outcome] = []
    for number in range(tasks):
        outcomes.append(robot.play(number, number in filmed))
        interrupts.check()
        if progress is not None:
            progress(len(outcomes), tasks)
        if outcomes[-1]["failure"]:
            break
    return gather(outcomes)


def _settings(
    parts: list[Part], level: Level, world: World, seed: int, fault: tuple[str, float] | None
) -> tuple[Any, ...]:
    plain = [list(part) for part in parts]
    hidden = list(fault) if fault else None
    return plain, list(level), [list(v) if isinstance(v, tuple) else v for v in world], seed, hidden


def _child(source: str) -> Child:
    limits = Limits(call=TASK, total=100_000.0, output=4 << 20)
    return Child(
        "def nothing(): pass", filename="robot", entry="nothing", given=source, limits=limits
    )


def _prepare(child: Child, settings: tuple[Any, ...]) -> Failure | None:
    child.load()
    try:
        answer = child.given("prepare", *settings)
    except Ended as ended:
        # Which part it was is unknown while they load; the sentence says how it ended.
        names = [part[0] for part in settings[0] if part[1] == "yours"]
        text = f"{ended.sentence} One of: {', '.join(names)}."
        return Failure(names[0] if names else "", "too slow", text, 0, -1, 0, "")
    return None if answer is None else _failure(answer)


def _one(child: Child, settings: tuple[Any, ...], number: int, filmed: bool) -> Outcome | Ended:
    """Play one task; return how the child ended where it does not survive the task."""
    try:
        outcome = child.given("play", number, filmed)
    except Ended as ended:
        return ended
    return _checked(outcome, number)


def _culprit(
    source: str, settings: tuple[Any, ...], number: int, ended: Ended, opened: list[Child]
) -> Failure:
    """Play a task again in a new child that reports each call before it makes it."""
    last: list[Any] = ["", 0, ""]

    def entering(name: str, tick: int, call: str) -> None:
        last[:] = [str(name), int(tick), str(call)]

    try:
        with _child(source) as child:
            opened.append(child)
            if _prepare(child, settings) is None:
                child._value(child._call("given", "trace", (number, entering), {}, 0, 1, HANG), "")
    except (Ended, Raised):
        pass
    kind = {"timed_out": "too slow"}.get(str(ended.reason.value), "ended the process")
    name = last[0] if last[0] else "unknown"
    return Failure(name, kind, ended.sentence, last[1], number, 0, last[2])


def _failure(answer: Any) -> Failure:
    part, kind, text, tick, task, line, call = answer
    return Failure(str(part), str(kind), str(text), int(tick), int(task), int(line), str(call))


def _stopped(failure: Failure) -> Outcome:
    nothing = [math.nan, math.nan]
    return {
        "task": max(failure.task, 0),
        "why": f"{failure.part} {failure.kind}",
        "success": False,
        "seconds": math.inf,
        "error": nothing,
        "grasp": nothing,
        "budget": [nothing for _ in STAGES],
        "processor": [0.0 for _ in STAGES],
        "moments": nothing,
        "signals": [nothing for _ in range(12)],
        "failure": list(failure),
        "breaches": [],
        "log": [],
    }


def _checked(outcome: Any, number: int) -> Outcome:
    """Return what came from the child, if it is an outcome; it is not trusted to be one."""
    if not isinstance(outcome, dict) or outcome.get("task") != number:
        text = "what came back from the child process is no outcome"
        return _stopped(Failure("unknown", "wrong type", text, 0, number, 0, ""))
    return outcome


def gather(outcomes: list[Outcome]) -> Played:
    """Return the outcomes of tasks as arrays, in the order of their numbers."""
    outcomes = sorted(outcomes, key=lambda outcome: int(outcome["task"]))
    breaches = [Breach(*row) for outcome in outcomes for row in outcome["breaches"]]
    failures = [_failure(outcome["failure"]) for outcome in outcomes if outcome["failure"]]

    def column(name: str, *shape: int) -> Array:
        rows = [np.asarray(outcome[name], dtype=float).reshape(shape) for outcome in outcomes]
        return np.array(rows).reshape(len(outcomes), *shape)

    return Played(
        column("task"),
        column("success").astype(bool),
        tuple(str(outcome["why"]) for outcome in outcomes),
        column("seconds"),
        column("error", 2),
        column("grasp", 2),
        column("budget", len(STAGES), 2),
        column("processor", len(STAGES)),
        column("moments", 2),
        column("signals", 12, 2),
        tuple(breaches),
        failures[0] if failures else None,
        {int(o["task"]): np.array(o["log"]) for o in outcomes if o.get("log")},
    )


def part_names(parts: list[Part]) -> dict[str, str]:
    """Return who holds each slot."""
    return {part.slot: part.holder for part in parts if part.slot in NAMED}
