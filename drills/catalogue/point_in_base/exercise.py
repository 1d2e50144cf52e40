"""The silent-bug hunt of chapter 7: one frame at a time, then a camera on an arm that moves."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]
CAMERA = np.array([600.0, 590.0, 319.5, 239.5])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return where each mistake shows by itself, then all together."""

    def shot(
        label: str,
        level: str = "core",
        *,
        n: int = 8,
        speed: float = 0.0,
        turn: float = 0.0,
        mounted: float = 0.0,
        yaw: float | None = None,
        middle: bool = False,
        stamp: float = 0.43,
    ) -> Case:
        """Return a picture of an arm at a speed [m/s, rad/s], with a camera mounted at an angle."""
        wide = 0.0 if middle else 300.0
        pixels = np.vstack(
            (
                CAMERA[2:, None] + rng.uniform(-wide, wide, (2, n)) * [[1.0], [0.7]],
                rng.uniform(0.4, 1.2, n),
            )
        )
        times = np.arange(0.0, 1.05, 0.1)
        direction = rng.normal(size=3)
        log = np.column_stack(
            (
                times,
                rng.uniform(-0.5, 0.5, 3) + np.outer(times, speed * direction),
                (rng.uniform(-3.0, 3.0) if yaw is None else yaw) + turn * times,
            )
        )
        log[:, 1:4] += 0.1 * speed * rng.normal(size=(len(times), 3))
        log[:, 4] = (log[:, 4] + np.pi) % (2.0 * np.pi) - np.pi
        mount = np.append(rng.uniform(-0.1, 0.1, 3), mounted)
        return Case((pixels, stamp, CAMERA, mount, log), label, level)

    whole = (
        np.array([[4, 0], [1, 5], [2, 3]]),
        1,
        np.array([2, 2, 1, 1]),
        np.array([1, 0, 2, 1]),
        np.array([[0, 0, 0, 5, 0], [2, 3, 1, 5, 1], [4, 2, 2, 5, 0]]),
    )
    return [
        shot("a target on the axis, at rest", "simple", n=1, middle=True, yaw=0.0),
        shot("at rest, nothing turned", "simple", yaw=0.0),
        shot("at rest, turned", "simple"),
        *(shot("mounted at an angle, at rest", mounted=angle) for angle in (0.5, -1.5, 2.5)),
        *(shot("moving straight", speed=0.5) for _ in range(2)),
        *(shot("turning", turn=rate, stamp=0.67) for rate in (1.0, -2.0)),
        shot("turning above a target", n=1, middle=True, turn=1.5),
        *(
            shot("mounted at an angle, in motion", speed=0.5, turn=rate, mounted=rate)
            for rate in (0.8, -1.6)
        ),
        *(
            shot("turning past pi", turn=rate, yaw=yaw, mounted=0.3, stamp=0.55)
            for rate, yaw in ((1.0, 2.6), (-1.0, -2.6))
        ),
        shot("at a row of the log", speed=0.5, turn=1.0, stamp=0.5, level="edge"),
        shot("nothing seen", n=0, speed=0.5, level="edge"),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-10 m, or of the largest coordinate."""
    return 1e-10 * max(1.0, float(np.abs(truth[0]).max(initial=0.0)))


def from_above(figure: Any, shown: Shown) -> None:
    """Plot both sets of points from above."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    for (points,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(*np.asarray(points)[:2], "o", **style | {"ls": ""})
    axes.legend()


_PIXEL = (
    "(u - cx) / fx * z, (v - cy) / fy * z",
    "(u + 0.5 - cx) / fx * z, (v + 0.5 - cy) / fy * z",
)
_TIME = ("np.interp(stamp,", "np.interp(stamp + 0.1,")
_MOUNT = ("np.asarray(mount, dtype=float)", "np.asarray(mount, dtype=float) * [1, 1, 1, -1]")

SLIPS = slips(
    all_still_there=(
        *_PIXEL,
        *_TIME,
        *_MOUNT,
        "All three are still there: a pixel, a time, a turn.",
    ),
    turn_inverted=(
        *_MOUNT,
        "The camera's mount turns the wrong way: right in the middle of the picture, wrong at its "
        "edge. It leads from the camera's frame to the flange's.",
    ),
    half_a_pixel=(
        *_PIXEL,
        "Half a pixel is left: everything is off by half of z / f. Here a pixel's centre is at the "
        "whole number.",
    ),
    stamp_of_arrival=(
        *_TIME,
        "The arm's pose is that of when the picture arrived. At rest nobody sees it; in motion "
        "take the pose of when it was exposed.",
    ),
    turn_and_pixel=(
        *_MOUNT,
        *_PIXEL,
        "The time is right now. A turn and a fraction of a pixel are left.",
    ),
    turn_and_time=(*_MOUNT, *_TIME, "The pixels are right now. A turn and a time are left."),
    pixel_and_time=(
        *_PIXEL,
        *_TIME,
        "The turn is right now. A fraction of a pixel and a time are left.",
    ),
    both_turns_inverted=(
        "[[c, -s, 0.0], [s, c, 0.0]",
        "[[c, s, 0.0], [-s, c, 0.0]",
        "Now both turns go backwards. That of the flange was right: mend the mount's alone.",
    ),
    earlier_by_the_delay=(
        "np.interp(stamp,",
        "np.interp(stamp - 0.1,",
        "The delay is taken off the stamp. It is the stamp of the exposure already.",
    ),
    the_long_way_round=(
        "np.unwrap(rows[4])",
        "rows[4]",
        "The turn is interpolated across the jump from pi to -pi: half way it points backwards. "
        "That was right before.",
    ),
    nearest_row=(
        "np.array([np.interp(stamp, rows[0], row) for row in rows[1:]])",
        "rows[1:, np.argmin(np.abs(rows[0] - stamp))]",
        "The pose of the flange is that of the nearest row of the log. It moves between two rows: "
        "interpolate.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "two turns and shifts: rounding", explain=coarse),
    examples=(
        "point_in_base([[1], [0], [2]], 0.0, [1, 1, 0, 0], [0, 0, 0, 0], [[0, 0, 0, 0, 0]])",
        "point_in_base([[1], [0], [2]], 0.5, [1, 1, 0, 0], [0, 0, 0, np.pi / 2], "
        "[[0, 0, 0, 0, 0], [1, 4, 0, 0, 0]])",
    ),
    picture=from_above,
    slips=SLIPS
    + coarse_slips("point_in_base", "Two such chains are then apart by as much.")
    + value_slips("point_in_base", in_part=False),
)
