"""A tool follows a target that a camera observes: camera, link, queue, vision, loop, drive."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Line:
    """The chain from the camera to the tool; times in seconds.

    Attributes:
        speed: of the target [m/s].
        frame: from one image of the camera to the next.
        transfer: of an image over the link.
        depth: number of images that the queue holds; a new one replaces the oldest.
        vision: from one run of the vision node to the next; it takes the oldest image.
        boot: when the vision node starts.
        tau: time constant of the filter in the loop.
        period: from one run of the loop to the next.
        stall, every: the loop is blocked for `stall` about once in each `every`.
        buffer: from a command to the drive's input.
        servo: time constant of the drive.
    """

    speed: float
    frame: float
    transfer: float
    depth: int
    vision: float
    boot: float
    tau: float
    period: float
    stall: float
    every: float
    buffer: float
    servo: float


TICK = 1e-3  # s
# One row per tick: positions of target and tool [m], age of the newest image on its arrival [s],
# images in the queue after a run of the vision node, runs of the loop so far, images so far.
ROW = np.dtype([(name, float) for name in ("target", "tool", "age", "waiting", "loops", "frames")])


def filtered(line: Line, before: float, measured: float) -> float:
    """Return the filter's output after one run of the loop."""
    return measured + (before - measured) * float(np.exp(-line.period / line.tau))


def driven(line: Line, tool: float, command: float) -> float:
    """Return the tool's position after one tick."""
    return command + (tool - command) * float(np.exp(-TICK / line.servo))


def simulate(line: Line, ticks: int) -> NDArray[np.void]:
    """Simulate a number of ticks and return a `ROW` for each."""
    log, commands = [], [0.0] * (ticks + 1)
    link: list[tuple[float, float, float]] = []  # arrival, position, when it was taken
    queue: list[float] = []
    measured = output = tool = age = 0.0
    waiting = loops = frames = 0
    next_frame = next_loop = 0.0
    next_vision, next_stall = line.boot, line.every
    late = round(line.buffer / TICK)
    for i in range(ticks):
        now = (i + 0.5) * TICK
        target = line.speed * now
        if now > next_frame:
            next_frame += line.frame
            frames += 1
            link.append((now + line.transfer, target, now))
        if link and link[0][0] <= now:
            _, position, taken = link.pop(0)
            queue = [*queue, position][-line.depth :]
            age = now - taken
        if now > next_vision:
            next_vision += line.vision
            if queue:
                measured, queue = queue[0], queue[1:]
            waiting = len(queue)
        fresh = filtered(line, output, measured)
        if now > next_loop:
            next_loop += line.period
            loops += 1
            output = fresh
            if now > next_stall:
                next_stall += line.every
                next_loop += line.stall
        commands[i] = output
        tool = driven(line, tool, commands[i - late] if i >= late else 0.0)
        log.append((target, tool, age, waiting, loops, frames))
    return np.array(log, dtype=ROW)
