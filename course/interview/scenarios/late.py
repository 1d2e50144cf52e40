"""A tool lags behind a moving target: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs.late import TICK, Line, driven, filtered, simulate

Run = Callable[[str, int], float]
Rows = NDArray[np.void]

TICKS = 4000  # of a run; the lag is evaluated in its second half
LAGGING = 22.0  # mm: the gripper tolerates a smaller lag
NOMINAL = Line(
    speed=0.4,
    frame=0.02,
    transfer=0.008,
    depth=1,
    vision=0.02,
    boot=0.3,
    tau=0.006,
    period=0.004,
    stall=0.0,
    every=0.4,
    buffer=0.002,
    servo=0.008,
)


@dataclass(frozen=True)
class Fault:
    """Parameters that are not nominal, and the repair that removes the fault.

    Each fault adds about 60 ms of lag.
    """

    numbers: dict[str, Any]
    repair: str


# A queue that stays full adds depth - 1 images; a slow clock half of what its period grows by; a
# loop that stalls for s in every e holds its command, which adds s^2 / (2 e) on average.
FAULTS = {
    "slow_link": Fault({"transfer": 0.068}, "faster_link"),
    "full_queue": Fault({"depth": 4}, "newest_only"),
    "heavy_filter": Fault({"tau": 0.066}, "light_filter"),
    "slow_loop": Fault({"period": 0.124}, "raise_rate"),
    "blocked_loop": Fault({"stall": 0.215}, "own_core"),
    "long_buffer": Fault({"buffer": 0.062}, "short_buffer"),
    "soft_drive": Fault({"servo": 0.068}, "stiff_drive"),
    "slow_camera": Fault({"frame": 0.14}, "more_frames"),
}
SLOWED = 0.5  # of the speed, by the popular repair


def line(cause: str, seed: int) -> Line:
    """Return the line of a seed that has a fault."""
    draw = np.random.default_rng([14, seed])
    speed, servo, transfer = draw.uniform((0.39, 7.5e-3, 7.5e-3), (0.41, 8.5e-3, 8.5e-3)).tolist()
    near = replace(NOMINAL, speed=speed, servo=servo, transfer=transfer)
    return replace(near, **FAULTS[cause].numbers)


def repaired(cause: str, seed: int, repair: str | None) -> Line:
    """Return the line after a repair."""
    one = line(cause, seed)
    if repair == "slow_down":
        return replace(one, speed=SLOWED * one.speed)
    for fault in FAULTS.values():
        if fault.repair == repair:
            return replace(one, **{name: getattr(NOMINAL, name) for name in fault.numbers})
    return one


def lags(one: Line) -> NDArray[np.float64]:
    """Return the lag of the tool in the second half of a run [mm]."""
    log = simulate(one, TICKS)[TICKS // 2 :]
    return np.asarray(1e3 * (log["target"] - log["tool"]))


@cache
def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return the mean lag [mm]."""
    return float(lags(repaired(cause, seed, repair)).mean())


def price(cause: str, seed: int, repair: str) -> float:
    """Return the time per part after a repair, divided by the time before."""
    return line(cause, seed).speed / repaired(cause, seed, repair).speed


# --- Probes ---------------------------------------------------------------------------------------


def read(figure: Callable[[Rows], Any]) -> Run:
    """Return the probe that reads a log of the second half."""
    return lambda cause, seed: float(figure(simulate(line(cause, seed), TICKS)[TICKS // 2 :]))


def loop_gaps(log: Rows) -> NDArray[np.float64]:
    """Return the times between runs of the loop [ms]."""
    return np.asarray(1e3 * TICK * np.diff(np.flatnonzero(np.diff(log["loops"]))))


def ripple(cause: str, seed: int) -> float:
    """Return the standard deviation of the lag, divided by its mean."""
    behind = lags(line(cause, seed))
    return float(behind.std() / behind.mean())


def direct(cause: str, seed: int) -> float:
    """Return the lag when the true position replaces camera, link and vision, as a ratio."""
    one = line(cause, seed)
    exact = replace(one, frame=TICK, transfer=0.0, depth=1, vision=TICK, boot=0.0)
    return float(lags(exact).mean()) / symptom(cause, seed, None)


def half_speed(cause: str, seed: int) -> float:
    """Return the lag at half the speed, divided by the original lag."""
    return symptom(cause, seed, "slow_down") / symptom(cause, seed, None)


def filter_step(cause: str, seed: int) -> float:
    """Return the number of loop runs until the filter reaches 63 % of a step."""
    one, value, count = line(cause, seed), 0.0, 0
    for run in range(60):
        value = filtered(one, value, 1.0)
        count = count or (run + 1) * (value > 0.63)
    return float(count)


def drive_step(cause: str, seed: int) -> float:
    """Return the time until the drive reaches 63 % of a step [ms]."""
    one, tool, count = line(cause, seed), 0.0, 0
    for tick in range(300):
        tool = driven(one, tool, 1.0)
        count = count or (tick + 1) * (tool > 0.63)
    return 1e3 * TICK * count


def echo(cause: str, seed: int) -> float:
    """Return the time from a command to the drive's input, read to a millisecond [ms]."""
    noise = float(np.random.default_rng([15, seed]).normal(0.0, 0.3))
    return 1e3 * line(cause, seed).buffer + noise


SCENARIO = Scenario(
    name="late",
    title="The tool lags behind the target",
    prompt="A camera observes parts on a moving belt, and a tool follows them. Each image goes "
    "over a link into a queue. A vision node takes it from there and computes the position of the "
    "part. A control loop filters the positions and sends commands to the drive of the tool. At "
    f"this belt speed the tool should lag by less than {LAGGING:g} mm, which the gripper "
    "tolerates. It lags by nearly twice as much. You can read the program, but not the parameters "
    "of the line, which are on its controller; you can only run the probes below. What causes the "
    "lag, and what do you change?",
    symptom_words="lag of the tool",
    unit="mm",
    symptom=symptom,
    spread=0.15,
    removed=lambda figure: figure < LAGGING,
    causes=(
        Cause(
            "slow_link",
            "The link needs a long time to transfer an image, so every image is old when it "
            "arrives.",
            "faster_link",
        ),
        Cause(
            "full_queue",
            "Images accumulated in the queue while the vision node started. The node takes one "
            "image for each new one that arrives, so the queue never empties, and the node always "
            "processes the oldest image.",
            "newest_only",
        ),
        Cause(
            "heavy_filter",
            "The filter in the loop has a long time constant. When the target moves at constant "
            "speed, the filter's output lags by that time.",
            "light_filter",
        ),
        Cause(
            "slow_loop",
            "The loop runs too rarely, and each command is held until the next run.",
            "raise_rate",
        ),
        Cause(
            "blocked_loop",
            "A lock or another process blocks the loop from time to time, and the last command is "
            "held until it runs again.",
            "own_core",
        ),
        Cause(
            "long_buffer",
            "Commands wait in an interpolation buffer before they reach the drive.",
            "short_buffer",
        ),
        Cause("soft_drive", "The drive follows its command slowly.", "stiff_drive"),
        Cause(
            "slow_camera",
            "The camera has a low frame rate. Until the next image arrives, the tool follows the "
            "last one.",
            "more_frames",
        ),
    ),
    probes=(
        Probe(
            "lag_ripple",
            "standard deviation of the lag, divided by its mean",
            "",
            2,
            ripple,
            0.03,
        ),
        Probe(
            "half_speed",
            "the lag at half the belt speed, divided by the lag at the original speed",
            "",
            2,
            half_speed,
            0.03,
        ),
        Probe(
            "image_age",
            "age of an image when it arrives at the queue",
            "ms",
            4,
            read(lambda log: 1e3 * np.median(log["age"])),
            2.0,
        ),
        Probe(
            "count_waiting",
            "number of images still in the queue after a run of the vision node",
            "",
            4,
            read(lambda log: np.median(log["waiting"])),
            0.25,
        ),
        Probe(
            "frame_rate",
            "number of images per second",
            "Hz",
            3,
            read(lambda log: np.ptp(log["frames"]) / (len(log) * TICK)),
            2.0,
        ),
        Probe(
            "mean_period",
            "mean time between two runs of the loop",
            "ms",
            4,
            read(lambda log: loop_gaps(log).mean()),
            1.0,
        ),
        Probe(
            "longest_period",
            "longest time between two runs of the loop",
            "ms",
            5,
            read(lambda log: loop_gaps(log).max()),
            5.0,
        ),
        Probe(
            "filter_step",
            "number of loop runs until the filter has followed 63 % of a sudden jump",
            "",
            5,
            filter_step,
            0.5,
        ),
        Probe(
            "exact_target",
            "the lag with the true position instead of camera, link and vision, divided by the "
            "original lag",
            "",
            8,
            direct,
            0.05,
        ),
        Probe(
            "command_echo",
            "time from a command until it reaches the drive's input",
            "ms",
            8,
            echo,
            1.5,
        ),
        Probe(
            "drive_step",
            "time until the drive has followed 63 % of a sudden jump",
            "ms",
            10,
            drive_step,
            1.5,
        ),
    ),
    repairs=(
        Repair("faster_link", "Images are sent over a link of their own."),
        Repair("newest_only", "The queue holds only one image, the newest."),
        Repair("light_filter", "The filter gets the time constant that it was designed with."),
        Repair("raise_rate", "The loop runs at the rate that it was designed for."),
        Repair("own_core", "The loop gets a processor core of its own and takes no locks."),
        Repair("short_buffer", "The drive interpolates over a single loop period."),
        Repair("stiff_drive", "The drive gets the gains that it was designed with."),
        Repair("more_frames", "The camera runs at the frame rate that it was designed for."),
        Repair("slow_down", "The belt runs at half its speed."),
    ),
    popular="slow_down",
    price=price,
    price_words="time per part, relative to the original speed",
    affordable=1.5,
    path=9,
)
