"""A braking block under three cones: along an axis, where all agree, then at every angle."""

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
    """Return launches by their angle from the contact's first axis.

    In contacts that are turned or not.
    """

    def launch(label: str, level: str = "core", *, degrees: float, turn: float = 0.0) -> Case:
        speed, mu = rng.uniform(0.5, 4.0), rng.uniform(0.2, 1.0)
        return Case((speed, turn + np.deg2rad(degrees), turn, mu), label, level)

    def any_turn() -> float:
        return float(rng.uniform(0.3, 1.2) * rng.choice([-1.0, 1.0]))

    return [
        launch("along the first axis", "simple", degrees=0.0),
        launch("along the diagonal", "simple", degrees=45.0),
        *(launch("nearer to the first axis", degrees=rng.uniform(8.0, 40.0)) for _ in range(2)),
        *(launch("nearer to the second axis", degrees=rng.uniform(50.0, 82.0)) for _ in range(2)),
        *(launch("backwards", degrees=rng.uniform(100.0, 130.0) + 180.0 * k) for k in range(2)),
        *(
            launch("a turned contact", degrees=rng.uniform(10.0, 35.0), turn=any_turn())
            for _ in range(3)
        ),
        launch("nearly along the diagonal", "edge", degrees=45.0 - 1e-3, turn=any_turn()),
        launch("nearly along an axis", "edge", degrees=1e-3, turn=any_turn()),
        Case((0.0, 0.4, 0.1, 0.5), "it stands", "edge"),
        Case((3, 1, 0, 1), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9, of distances above 1 m as much of them."""
    return [1e-9 * max(1.0, float(truth[0].max())), 1e-9]


def stops(figure: Any, shown: Shown) -> None:
    """Plot the three stops from above, the launch along x."""
    axes = picture.plane(figure, "along the launch [m]", "to its left [m]", equal=True)
    for (distance, turned), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        r, a = np.asarray(distance, dtype=float), np.asarray(turned, dtype=float)
        axes.plot(r * np.cos(a), r * np.sin(a), marker="o", **style)
        for name, x, y in zip(
            ("circle", "inscribed", "around"), r * np.cos(a), r * np.sin(a), strict=True
        ):
            axes.annotate(name, (x, y), fontsize=8, color=style["color"])
    axes.legend()


_ROWS, _DIRECTION = "[circle, inscribed, around]", "np.cos(angle - frame), np.sin(angle - frame)"
_AROUND, _SECOND = "around = u**2 / (2.0 * slowing)", "first + slow**2 / slowing"
_FIRST = "first = np.where(u == fast, (fast**2 - slow**2) / 2.0, slow * (fast - slow)) / slowing"
_RETURN = "return np.hypot(x, y), turned"

SLIPS = slips(
    stops_with_the_first_axis=(
        _AROUND,
        "around = (u - slow / 2.0) * slow / slowing",
        "Under the pyramid around the cone the block is taken to stop when its slower axis does. "
        "The other one still has speed: a second phase, along that axis alone.",
    ),
    second_phase_forgotten=(
        _SECOND,
        "first",
        "Under the inscribed pyramid only the first phase is there, until both axes are equally "
        "fast. From there on it slides along the diagonal.",
    ),
    second_phase_in_full=(
        _SECOND,
        "first + slow**2 / (2.0 * slowing)",
        "In the second phase of the inscribed pyramid each axis is slowed by all of mu g. The two "
        "shares sum to mu g: each has half of it.",
    ),
    cones_mixed=(
        _ROWS,
        "[circle, around, inscribed]",
        "The two pyramids are mixed up. The inscribed one has less friction than the circle and "
        "lets the block go farther; the one around it has more.",
    ),
    scalar_friction=(
        _ROWS,
        "[circle, circle * u.sum() / max(speed, 1e-300), circle * fast / max(speed, 1e-300)]",
        "Friction is taken as a number here, against the velocity, as large as the shape is in "
        "that direction. The force that takes away the most power is a corner of the square: it "
        "is not against the velocity, and steers.",
    ),
    all_circles=(
        _ROWS,
        "[circle, circle, circle]",
        "All three are taken for circles. That is right along an axis only.",
    ),
    circle_of_the_other_size=(
        _ROWS,
        "[circle / np.sqrt(2.0), inscribed, around]",
        "The circle is too strong: its radius is mu N, what the corners of the inscribed square "
        "have, too.",
    ),
    inscribed_by_halves=(
        _FIRST,
        "first = (u**2 - slow**2) / slowing",
        "In its first phase the inscribed pyramid has all its friction on the faster axis, and the "
        "other one goes on at its speed: mu g on one, zero on the other.",
    ),
    degrees_for_radians=(
        _DIRECTION,
        "np.cos(np.deg2rad(angle - frame)), np.sin(np.deg2rad(angle - frame))",
        "The angles are taken as degrees. They come in radians, as np.cos wants them.",
    ),
    turned_in_degrees=(
        _RETURN,
        "return np.hypot(x, y), np.rad2deg(turned)",
        "The angles come back in degrees; radians are asked for.",
    ),
    frame_forgotten=(
        _DIRECTION,
        "np.cos(angle), np.sin(angle)",
        "The pyramids are laid out along the world's axes. They stand along the contact's, which "
        "may be turned: that is why the same launch ends elsewhere after a new contact frame.",
    ),
    frame_added=(
        _DIRECTION,
        "np.cos(angle + frame), np.sin(angle + frame)",
        "The contact's angle is added. The direction in its frame is the angle less that of the "
        "frame.",
    ),
    turned_from_the_axis=(
        _RETURN,
        "return np.hypot(x, y), np.arctan2(y, x)",
        "The angle is counted from the contact's first axis; asked is how far the block has left "
        "the direction of its launch.",
    ),
    turned_clockwise=(
        _RETURN,
        "return np.hypot(x, y), -turned",
        "The sign of the angle is turned: counterclockwise is positive.",
    ),
    first_quadrant_only=(
        "np.sign(start) * np",
        "np",
        "Right for launches between the two axes only. Friction is against each axis's own speed, "
        "so the signs of the launch come back at the end.",
    ),
    half_forgotten=(
        "circle = speed * u / (2.0 * slowing)",
        "circle = speed * u / slowing",
        "The circle's distance is twice too long: v^2 / (2 mu g).",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a closed form: rounding", explain=coarse),
    examples=("sliding_stop(2.0, 0.0, 0.0, 0.5)", "sliding_stop(2.0, 0.3, 0.0, 0.5)"),
    picture=stops,
    slips=SLIPS
    + coarse_slips("sliding_stop", "Near an axis the block is hardly turned at all.")
    + value_slips("sliding_stop", swapped=True),
)
