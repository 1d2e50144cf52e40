"""The silent-bug hunt of chapter 11: scenes in which one mistake shows, then all together."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a part on a belt.

    Standing or moving, left alone or pushed, the camera straight or turned.
    """

    def scene(
        label: str,
        level: str = "core",
        *,
        turn: float = 0.0,
        speed: float = 0.0,
        push: float = 0.0,
        along: tuple[float, float] = (0.6, -0.8),
        jitter: float = 0.7,
        n: int = 20,
        noise: float = 1.0,
    ) -> Case:
        c, s = np.cos(turn), np.sin(turn)
        R, t = np.array([[c, -s], [s, c]]), rng.uniform(-0.3, 0.3, 2)
        belt = speed * rng.normal(size=2)
        captured = 0.1 * np.arange(n) + 0.013
        place = rng.uniform(-0.3, 0.3, 2) + np.outer(captured, belt)
        place[captured > 0.6] += push * np.array(along)
        # At most half of what would make it plan anew: no close calls.
        place += 1e-3 * noise * rng.uniform(-jitter, jitter, place.shape)
        arrived = captured + rng.uniform(0.05, 0.09, n)
        frames = np.column_stack((captured, arrived, (place - t) @ R))
        args = frames, noise, np.column_stack((R, t)), belt, rng.uniform(-0.3, 0.3, 2)
        return Case((*args, 0.05 * np.arange(50)), label, level)

    whole = (
        np.array([[0, 1, 2, 1], [2, 3, 2, 1], [3, 4, 5, 1]]),
        2,
        np.array([[0, -1, 1], [1, 0, 2]]),
        np.array([1, 0]),
        np.array([0, 0]),
        np.arange(7),
    )
    return [
        scene("a quiet day", "simple"),
        scene("one frame", "simple", n=1),
        *(scene("a turned camera", turn=turn) for turn in (0.5, -1.6, 2.5)),
        *(scene("a moving belt", speed=0.2) for _ in range(2)),
        *(scene("pushed", push=push) for push in (0.04, 0.1, -0.2)),
        # 2.4 noise in x and in y are 3.4 noise in length: only the length is beyond 3 noise.
        scene("pushed a little, in x and y", push=2.4e-3, along=(1.0, -1.0), jitter=0.0),
        scene("pushed on a belt", speed=0.1, push=0.1),
        scene("turned and pushed", turn=1.0, push=0.1),
        *(scene("a fine camera, pushed far", noise=0.02, push=push) for push in (0.6, -0.5)),
        *(scene("all together", turn=turn, speed=0.1, push=0.1) for turn in (0.8, -2.0)),
        scene("no frames", "edge", n=0),
        Case(whole, WHOLE, "edge"),
    ]


def paths(figure: Any, shown: Shown) -> None:
    """Plot both references from above."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    for (reference,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(*np.asarray(reference, dtype=float).T, marker=".", **style)
    axes.legend()


_TURN = ("recent[:, 2:] @ R.T", "recent[:, 2:] @ R")
_STAMP = ("ages = now - recent[:, :1]", "ages = now - recent[:, 1:2]")
_UNIT = ("3.0 * 1e-3 * noise", "3.0 * noise")
_STALE = (
    "origin, began = command, now",
    "began = now if began == -math.inf else began",
    "goal = target + seconds * belt",
    "goal = target + (began + seconds - now) * belt",
)

SLIPS = slips(
    calibration_transposed=(
        *_TURN,
        "The rotation of the calibration is on the wrong side or not transposed: right for a "
        "camera that is mounted straight. Points are rows here, so multiply by the transpose "
        "of R from the right.",
    ),
    stamp_of_arrival=(
        *_STAMP,
        "The age of a frame is counted from its arrival: right while the belt stands still. "
        "The frame shows the part where it was at the capture.",
    ),
    unit_of_noise=(
        *_UNIT,
        "No new plan is ever made, which is right while nobody touches the part. Look at both "
        "sides of the comparison: the noise comes in millimetres and the distance is in metres, "
        "and the estimate must come from the last five frames, so that it changes.",
    ),
    stale_reference=(
        *_STALE,
        "A new plan continues from the old one's start and clock, so the reference jumps. It "
        "must start now, from the position that the tip was last told to take.",
    ),
    stale_and_unit=(
        *_STALE,
        *_UNIT,
        "Frames and time stamps are right. Unit and reference are left: one hides the other, "
        "because no second plan is ever made.",
    ),
    turn_and_stamp=(
        *_TURN,
        *_STAMP,
        "Planning is right. Two mistakes of perception are left: a rotation and a time stamp.",
    ),
    all_still_there=(
        *_TURN,
        *_STAMP,
        *_UNIT,
        *_STALE,
        "All four are still there: a rotation, a time stamp, a unit, a reference.",
    ),
    stale_clock=(
        "origin, began = command, now",
        "origin, began = command, now if began == -math.inf else began",
        "goal = target + seconds * belt",
        "goal = target + (began + seconds - now) * belt",
        "A new plan starts from the right position, but with the old one's clock: it is half "
        "done when it begins.",
    ),
    stale_start=(
        "origin, began = command, now",
        "origin, began = (command if began == -math.inf else origin), now",
        "A new plan starts at the right time, but from the old one's start: the reference "
        "jumps back.",
    ),
    age_twice=(
        _STAMP[0],
        "ages = 2.0 * (now - recent[:, :1])",
        "The age is counted twice: the estimate is ahead by as much as it was behind.",
    ),
    larger_component=(
        "math.dist(target, goal + (now - began - seconds) * belt)",
        "np.max(np.abs(target - goal - (now - began - seconds) * belt))",
        "The larger component of the difference decides about a new plan. It must be the distance: "
        "the length of the difference, from both components.",
    ),
    at_every_tick=(
        _UNIT[0],
        "-1.0",
        "A new plan is made at every tick: it is always at its slow beginning, and the arm waits.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "sums over fifty ticks: rounding", explain=coarse),
    examples=(
        "reach_target([[0.0, 0.1, 0.2, 0.0]], 1.0, [[0, -1, 0.1], [1, 0, 0]], [0.1, 0.0], "
        "[0.0, 0.0], [0.0, 0.1, 0.6, 1.1, 2.1])",
    ),
    picture=paths,
    slips=SLIPS
    + coarse_slips("reach_target", "The next plan begins where this one was.")
    + value_slips("reach_target", in_part=False),
)
