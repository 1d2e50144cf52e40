"""Motions of a planar arm among posts: the share up to the first touch, judged by looking there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, judge_of, largest_error
from drills.catalogue.rrt.worlds import paths
from drills.exercise import Exercise, slips, value_slips

Array = NDArray[np.float64]
SHARES = np.linspace(0.0, 1.0, 401)
CLEAR, PACE = 1e-3, 0.1  # [m]; of the gap before a touch [m by share]


def swept(args: tuple[Any, ...], shares: Array) -> Array:
    """Return base, joints and tip along the motion, shape (shares, n + 1, 2)."""
    lengths, _, a, b = (np.asarray(value, dtype=float) for value in args)
    angle = np.cumsum(a + shares[:, None] * (b - a), axis=1)
    links = lengths[:, None] * np.stack((np.cos(angle), np.sin(angle)), axis=2)
    return np.concatenate((np.zeros((len(shares), 1, 2)), np.cumsum(links, axis=1)), axis=1)


def gaps(args: tuple[Any, ...], shares: Array) -> Array:
    """Return the distance of the arm to the nearest disc, shape (shares,)."""
    at, discs = swept(args, shares)[:, :, None], np.asarray(args[1], dtype=float)
    p, along = at[:, :-1], np.diff(at, axis=1)
    to = discs[:, :2] - p
    t = np.clip((to * along).sum(axis=3) / (along * along).sum(axis=3), 0.0, 1.0)
    distance = np.linalg.norm(to - t[..., None] * along, axis=3) - discs[:, 2]
    return np.asarray(distance.min(axis=(1, 2)))


def fair(args: tuple[Any, ...], hit: bool) -> bool:
    """Return whether the motion is clearly free or clearly hits, at a good speed."""
    lengths, _, a, b = args
    result, speed = gaps(args, SHARES), float(np.abs(b - a) @ np.cumsum(lengths[::-1])[::-1])
    near = result < CLEAR + 0.5 * speed / (len(SHARES) - 1)
    if not near.any() or not hit:
        return not near.any() and not hit
    first = max(int(np.argmax(near)), 1)
    last = first + int(np.argmax(result[first:] < 0.0))
    pace = np.diff(result[first - 1 : last + 1]) * (len(SHARES) - 1)
    return bool(result[0] > CLEAR and result[last] < 0.0 and np.all(pace < -PACE))


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one link first; then arms of up to five among posts of 1 cm and discs of 20 cm.

    A thin post is what samples at fixed steps pass by, and what a bound on the speed of the links
    can't miss (conservative advancement; Mirtich, 1996).
    """

    def arm(
        label: str,
        n: int,
        hit: bool,
        radius: float = 0.01,
        level: str = "core",
        turning: tuple[float, ...] = (),
        count: int = 6,
    ) -> Case:
        """Return a random motion that clearly hits or clearly is free.

        Args:
            label: of the case.
            n: number of links.
            hit: whether the arm is to touch a disc.
            radius: of each disc [m].
            level: simple, core or edge.
            turning: size of each joint's turn [rad], before it is scaled at random.
            count: number of discs.
        """
        # Rejection sampling: a near miss, or a touch at a tangent, would make the answer depend on
        # rounding, so `fair` discards both.
        while True:
            lengths, a = rng.uniform(0.4, 1.0, n), rng.uniform(-0.5, 0.5, n)
            a[0] = rng.uniform(-3.0, 3.0)
            move = np.array(turning or (1.2,) * n) * rng.uniform(0.7, 1.3, n)
            move *= rng.choice([-1.0, 1.0], n)
            # Uniform over the annulus within reach, hence the root; not at the base, where a disc
            # touches from the start.
            far, direction = np.sqrt(rng.uniform(0.05, 1.0, count)), rng.uniform(0.0, 6.3, count)
            spots = lengths.sum() * far * np.array([np.cos(direction), np.sin(direction)])
            args = lengths, np.column_stack((spots.T, np.full(count, radius))), a, a + move
            if fair(args, hit):
                return Case(args, label, level)

    def bent(n: int) -> Case:
        """Return a stretched arm whose joints all turn one way: its tip is as fast as the bound."""
        args = rng.uniform(0.4, 1.0, n), np.zeros((0, 3)), np.zeros(n), rng.uniform(0.7, 1.0, n)
        # A thin post where the tip is after a tenth of the motion: a step that is even a little too
        # long passes it.
        post = np.array([[*swept(args, np.array([0.1]))[0, -1], 0.005]])
        return Case((args[0], post, *args[2:]), "all joints turn one way")

    whole = tuple(map(np.array, ([1, 1], [[-1, 1, 1], [1, 2, 0]], [0, 0], [2, 0])))
    # Its discs and postures serve three edge cases: touching at the start, no disc, no motion.
    inside = arm("", 2, True).args
    return [
        arm("one link, in the way", 1, True, 0.2, "simple"),
        arm("one link, free", 1, False, 0.2, "simple"),
        arm("two links, in the way", 2, True, 0.2, "simple"),
        *(arm("posts in the way", n, True) for n in (2, 3, 5)),
        *(arm("posts, free", n, False) for n in (3,)),
        *(
            arm("the first joint alone turns", n, True, turning=(1.5, *(0.0,) * (n - 1)))
            for n in (4,)
        ),
        bent(2),
        bent(4),
        arm("the last joint alone turns", 3, True, turning=(0.0, 0.0, 2.0)),
        arm("more than a turn", 2, True, turning=(9.0, 3.0), count=1),
        Case(
            (inside[0], np.vstack((inside[1], [*swept(inside, SHARES)[0, 2], 0.1])), *inside[2:]),
            "the start touches",
            "edge",
        ),
        Case((inside[0], np.zeros((0, 3)), *inside[2:]), "no disc", "edge"),
        Case((*inside[:3], inside[2].copy()), "no motion", "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def honest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether the arm is free as far as it is said to be: looked at closely."""
    text = 0.0 if largest_error(parts[0], 0.0) > 1.0 else float(parts[0])
    if not text > 0.0 or not len(case.args[1]):
        return  # the comparison of the values says what is wrong with it
    shares = np.linspace(0.0, text, 301)
    result = gaps(case.args, shares)
    deep, where = -float(result.min()), float(shares[result.argmin()])
    attempt.require(
        f"{case.label}: free as far as it is said to be",
        deep <= 1e-6,
        sentence=f"The motion is said to be free up to s = {text:.6g}. At s = {where:.6g} a link "
        f"is {1000.0 * deep:.3g} mm deep in a disc.",
        call=call,
    )


_REACH = "reach = np.cumsum(lengths[::-1])[::-1]"
_SPEED = "speed = float(np.abs(move) @ reach)"
_NEAREST = "np.clip(along, 0.0, lengths[:, None])"
_ON = "        share += gap / speed"

SLIPS = slips(
    sampled=(
        _ON,
        "        share += 0.1\n        if share > 1.0:\n            return 1.0",
        "gap >= speed * (1.0 - share)",
        "speed == 0.0",
        "You check some points along the motion, ten or so. Anything thinner than the distance "
        "between two of them is missed.",
    ),
    ends_only=(
        _ON,
        "        share = 1.0",
        "Only the start and the end are checked. Free ends say nothing about the motion between "
        "them.",
    ),
    own_link_only=(
        _REACH,
        "reach = lengths",
        "Your bound assumes that each joint moves only its own link. It carries all links from "
        "there to the tip, so its reach is the sum of their lengths.",
    ),
    fastest_joint_only=(
        _SPEED,
        "speed = float(np.max(np.abs(move) * reach))",
        "Your bound counts only one joint. All joints turn at the same time, and their "
        "contributions add up.",
    ),
    far_enough_now=(
        "gap >= speed * (1.0 - share)",
        "gap >= 0.1 * speed * (1.0 - share)",
        "The rest of the motion is declared free too early. The gap must be at least as large "
        "as what is left of the bound, speed (1 - s).",
    ),
    joints_only=(
        _NEAREST,
        "(along > 0.5 * lengths[:, None]) * lengths[:, None]",
        "Only the joints and the tip are checked. The links between them touch discs, too.",
    ),
    far_ends_only=(
        _NEAREST,
        "np.broadcast_to(lengths[:, None], along.shape)",
        "Only the far end of each link is checked. The rest of the link touches discs, too: take "
        "its point nearest to each centre.",
    ),
    centres_for_discs=(
        "distance - discs[:, 2]",
        "distance",
        "Your gap is the distance to the centres of the discs. Subtract the radius.",
    ),
    angles_from_the_x_axis=(
        "angle = np.cumsum(a + share * move)",
        "angle = a + share * move",
        "The angles are measured from the x axis. Each one is relative to the link before it.",
    ),
    shorter_way_round=(
        "move = np.asarray(b, dtype=float) - a",
        "move = np.arctan2(np.sin(np.asarray(b) - a), np.cos(np.asarray(b) - a))",
        "The motion takes the shorter way round. It has to go from a to b as they are given.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-6, "a gap of 1e-9 m, closing at 0.1 m a motion", first=honest),
    examples=(
        "edge_check([1.0], [[0.0, 0.8, 0.1]], [0.0], [2.0])",
        "edge_check([1.0, 1.0], [[0.0, 1.9, 0.01]], [0.0, 0.0], [2.0, 0.0])",
        "edge_check([1.0, 1.0], [[0.0, 1.9, 0.01]], [0.0, 1.0], [2.0, 1.0])",
    ),
    picture=lambda figure, shown: paths(
        figure,
        shown.args[1],
        *(
            swept(shown.args, np.array([float(share)]))[0]
            for share in (0.0, shown.got[0], shown.expected[0])
        ),
    ),
    # A share that is wrongly 1 or 0 is an integer, too, so truncation is caught but can't be named.
    slips=SLIPS + value_slips("edge_check", in_part=False, whole=False),
)
