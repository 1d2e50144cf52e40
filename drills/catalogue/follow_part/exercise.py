"""The silent-bug hunt of chapter 10: days on which one mistake shows, then all together."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a camera at 30 Hz, a controller at 100 Hz.

    A part that is moved by hand at each image.
    """

    def day(
        label: str,
        level: str = "core",
        *,
        drift: float = 0.0,
        every: float = 0.01,
        late: float = 0.0,
        save: float = 0.0,
        gap: bool = False,
        n: int = 20,
        work: float = 0.02,
    ) -> Case:
        captured = np.arange(n) / 30.0 + rng.uniform(0.0, 0.01)
        if gap:
            captured[n // 2 :] += 0.4  # somebody stands in front of the camera
        # Where something disturbs the rig, the images differ, so that a wrong one is noticed.
        moved = 0.3 + 0.02 * rng.normal(size=n) * (every > 0.01 or save > 0.0 or work > 0.02)
        received = captured + rng.uniform(0.004, 0.012, n)
        frames = np.column_stack((captured, received, moved + drift * captured))
        saves = np.array([[0.11, save], [0.42, save]])[: 2 * (save > 0.0)].reshape(-1, 2)
        cycles = int(100 * captured[-1] + 20) if n else 30
        lateness = late * rng.uniform(0.2, 1.0, cycles)
        ticks = every * np.arange(int(cycles / (100.0 * every))) + 0.0097
        args = frames, saves, work, lateness, 0.01, 150.0, drift, ticks
        return Case(args, label, level)

    whole = (
        np.array([[0, 1, 4], [5, 6, 9], [9, 11, 2]]),
        np.array([[4, 3]]),
        1,
        np.zeros(9, int),
        2,
        9000,
        0.75,
        np.array([2, 3, 5, 9, 15]),
    )
    return [
        day("the bench", "simple"),
        day("the bench, shortly", "simple", n=6),
        *(day("the part moves", drift=drift) for drift in (0.2, -0.3)),
        *(day("a slow drive", every=every) for every in (0.025, 0.04)),
        *(day("cycles begin late", drift=0.2, late=late) for late in (0.003, 0.006)),
        *(day("a log is saved", save=save) for save in (0.1, 0.2)),
        day("a slow callback", work=0.045, n=12),
        *(day("the camera stops", drift=drift, gap=True) for drift in (0.2, -0.1)),
        *(
            day("all together", drift=drift, every=0.025, late=0.004, save=0.15, gap=True)
            for drift in (0.1, -0.2, 0.3)
        ),
        day("no images", "edge", n=0),
        Case(whole, WHOLE, "edge"),
    ]


def over_time(figure: Any, shown: Shown) -> None:
    """Draw what the drive is commanded and where the part was seen."""
    axes = picture.plane(figure, "time [s]", "place [m]")
    frames = np.asarray(shown.args[0], dtype=float)
    axes.plot(frames[:, 0], frames[:, 2], "s", color="0.7", ms=4, label="seen")
    for (driven,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(shown.args[-1], np.asarray(driven, dtype=float), marker=".", **style)
    axes.legend()


_STAMP = ("(free[group], rows[number, 0],", "(free[group], free[group],")
_GROUP = ("group = kind", "group = 0")
_SLEEP = ("wake_up = (cycle + 1) * period", "wake_up = now + period")
_UNIT = ("<= 1e-3 * deadline", "<= deadline")
_DEPTH = ("depth, command, came = 1,", "depth, command, came = 10,")

SLIPS = slips(
    stamp_at_publishing=(
        *_STAMP,
        "The timestamp is still the time of publishing, which is right only for a part that "
        "stands still. A position belongs to the time at which the image was taken.",
    ),
    deep_queue=(
        *_DEPTH,
        "The drive's queue still has depth ten, which is right only if the drive is as fast as "
        "the controller. A slower drive uses commands that are ten periods old.",
    ),
    relative_sleep=(
        *_SLEEP,
        "The loop still sleeps for a period after each cycle, which is right only if no cycle "
        "begins late. Every lateness moves all later cycles.",
    ),
    one_callback_group=(
        *_GROUP,
        "Images still wait while a log is saved, which is right only if no log is saved. Give "
        "each of the two callbacks its own group.",
    ),
    unit_of_the_deadline=(
        *_UNIT,
        "The deadline is in milliseconds and is compared with seconds. So it never applies, which "
        "is right only while the camera sees the part.",
    ),
    stamp_and_deadline=(
        *_STAMP,
        *_UNIT,
        "Queue, sleep and groups are right. Timestamp and deadline are still wrong: with the time "
        "of publishing as the timestamp, no position looks old.",
    ),
    queue_and_sleep=(
        *_DEPTH,
        *_SLEEP,
        "The camera node is right. The drive's queue and the controller's sleep are still wrong.",
    ),
    all_still_there=(
        *_STAMP,
        *_GROUP,
        *_SLEEP,
        *_UNIT,
        *_DEPTH,
        "All five mistakes are still there: timestamp, group, sleep, unit, queue.",
    ),
    stamp_of_reception=(
        _STAMP[0],
        "(free[group], rows[number, 1],",
        "The timestamp is the time at which the image was received. The part has moved since the "
        "capture.",
    ),
    newest_and_then_older=(
        "command = queue.pop(0)",
        "command = queue.pop()",
        *_DEPTH,
        "The newest command is taken, and older ones stay in the queue. Without a new command, "
        "the drive goes back to an older one.",
    ),
    sleep_from_waking=(
        _SLEEP[0],
        "wake_up = wake_up + period + 0.5 * lateness",
        "The grid still moves with the lateness of the cycles.",
    ),
    every_call_a_group=(
        _GROUP[0],
        "group = kind\n        free[group] = -np.inf",
        "No callback waits for any other. Images are in one group, so they are processed one at a "
        "time.",
    ),
    silent_without_news=(
        "        if queue:\n            command = queue.pop(0)\n",
        "        command = queue.pop(0) if queue else 0.0\n",
        "Without a new command the drive uses 0. It must keep the last command.",
    ),
    deadline_from_publishing=(
        "if here and now - here[-1][1] <=",
        "if here and now - here[-1][0] <=",
        "The deadline is counted from publishing. The age of a position counts from its capture.",
    ),
    belt_backwards=(
        "here[-1][2] + drift",
        "here[-1][2] - drift",
        "The position is moved against the belt. Add the velocity times the age.",
    ),
    oldest_position=(
        "sent.append((now, here[-1][2] + drift * (now - here[-1][1])))",
        "sent.append((now, here[0][2] + drift * (now - here[0][1])))",
        "The command comes from the first position that was ever published. Take the newest one.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "a few products: rounding", explain=coarse),
    examples=(
        "follow_part([[0.0, 0.01, 0.3]], [[0.02, 0.1]], 0.02, np.zeros(6), 0.01, 100, 0.2, "
        "[0.015, 0.035, 0.055])",
    ),
    picture=over_time,
    slips=SLIPS
    + coarse_slips("follow_part", "A place that jumps by a digit is a blow to a stiff drive.")
    + value_slips("follow_part", in_part=False),
)
