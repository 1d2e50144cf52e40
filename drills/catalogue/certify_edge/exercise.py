"""Edges of a capsule among discs: no collision missed, and the evaluations are counted here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drills.attempt import Attempt
from drills.cards import definitions
from drills.case_judge import WHOLE, Answer, Case, judge_of
from drills.catalogue.certify_edge.scene import capsule_gaps
from drills.exercise import Exercise, slips, value_slips
from drills.inprocess import InProcess
from drills.values import numbers

Array = NDArray[np.float64]
SCENE = Path(__file__).with_name("scene.py")
LIMIT = 1000  # evaluations of one edge
ALLOWANCE = 1.2  # evaluations of an answer over those of the worked answer
MARGIN = 2e-3  # [m] of clearance or overlap: no verdict is close
SAMPLES = 801


class Clearance:
    """The distance function of an edge, which the grader evaluates and counts in its own process.

    Attributes:
        shares: where along the edge it was evaluated, in order.
        copies: of this function that were made, each with its own list.
    """

    __name__ = "clearance"

    def __init__(self, half: float, radius: float, discs: ArrayLike, a: Array, b: Array) -> None:
        self.half, self.radius, self.discs = half, radius, np.array(discs, dtype=float)
        self.a, self.move = np.array(a, dtype=float), np.subtract(b, a).astype(float)
        self.shares: list[float] = []
        self.copies: list[Clearance] = []

    def fresh(self) -> Clearance:
        """Return the same function with nothing counted."""
        return Clearance(self.half, self.radius, self.discs, self.a, self.a + self.move)

    def __deepcopy__(self, memo: Any) -> Clearance:
        """Return a function of its own for the worked answer, whose evaluations do not count."""
        copy = self.fresh()
        self.copies.append(copy)
        return copy

    def code(self) -> str:
        """Return the clearance as a function that a learner can run."""
        source = definitions(SCENE, ["capsule_gaps"])
        call = f"capsule_gaps([pose], {self.half!r}, {self.radius!r}, {self.discs.tolist()!r})"
        return f"{source}\n\ndef clearance(pose):\n    return float({call}[0])\n"

    def __call__(self, pose: Any) -> float:
        """Return the clearance at a pose and count the evaluation, after checking its shape."""
        value = numbers(pose, "the pose")
        if value.shape != (3,):
            raise ValueError(f"clearance takes poses of shape (3,), got {value.shape}")
        if len(self.shares) == LIMIT:
            raise ValueError(f"clearance was evaluated more than {LIMIT} times for one edge")
        length = float(self.move @ self.move)
        share = float((value - self.a) @ self.move) / length if length else 0.0
        self.shares.append(share)
        return float(capsule_gaps(value[None], self.half, self.radius, self.discs)[0])


def certain(clearance: Clearance) -> bool | None:
    """Return whether an edge is certainly free, certainly not, or None where it is close.

    Independent of any answer: samples along the edge, and between two of them no point of the
    capsule moves by more than half the spacing from the nearer one.
    """
    shares = np.linspace(0.0, 1.0, SAMPLES)
    poses = clearance.a + shares[:, None] * clearance.move
    lowest = float(capsule_gaps(poses, clearance.half, clearance.radius, clearance.discs).min())
    x, y, turn = clearance.move
    between = 0.5 * (math.hypot(x, y) + clearance.half * abs(turn)) / (SAMPLES - 1)
    if lowest < -MARGIN:
        return False
    return True if lowest > MARGIN + between else None


def cases(rng: np.random.Generator) -> list[Case]:
    """Return edges among posts and discs; then edges that only move, only turn, or touch late."""

    def edge(
        label: str, a: Sequence[float], b: Sequence[float], discs: ArrayLike, **more: Any
    ) -> Case:
        half, radius = more.get("half", 0.4), more.get("radius", 0.05)
        start, end = np.array(a), np.array(b)
        clearance = Clearance(half, radius, discs, start, end)
        return Case((clearance, half, start, end), label, more.get("level", "core"))

    def among(label: str, free: bool, turn: float, thick: tuple[float, float]) -> Case:
        while True:
            heading, half = float(rng.uniform(-3.0, 3.0)), float(rng.uniform(0.2, 0.5))
            a = np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])
            b = a + [3.0 * math.cos(heading), 3.0 * math.sin(heading), rng.uniform(-turn, turn)]
            discs = np.column_stack((rng.uniform(-4.0, 4.0, (25, 2)), rng.uniform(*thick, 25)))
            case = edge(label, a.tolist(), b.tolist(), discs, half=half)
            if certain(case.args[0]) is free:
                return case

    def post(label: str, a: Sequence[float], b: Sequence[float], share: float) -> Case:
        """Return an edge on which the tip of the capsule hits a thin post at one share."""
        x, y, turn = np.asarray(a) + share * np.subtract(b, a)
        tip = [x + 0.4 * math.cos(turn), y + 0.4 * math.sin(turn), 0.01]
        far = [[x + 9.0, y, 0.3]]
        return edge(label, a, b, [tip, *far], radius=0.02)

    turn, side = rng.uniform(-3.0, 3.0), float(rng.choice([-1.0, 1.0]))
    here = [float(rng.uniform(-1.0, 1.0)), float(rng.uniform(-1.0, 1.0))]
    gate = [[x, s * (0.05 + 0.02 + 6e-3), 0.02] for x in (0.7, 1.5) for s in (-1.0, 1.0)]
    thin, discs = (0.01, 0.03), (0.05, 0.2)
    return [
        edge("far from everything", [0, 0, 0.1], [1, 0.5, 0.4], [[5, 5, 0.3]], level="simple"),
        edge("a disc in the way", [0, 0, 0.0], [3, 0, 0.2], [[1.6, 0, 0.5]], level="simple"),
        edge("no motion", [0, 0, 0.3], [0, 0, 0.3], [[2, 2, 0.3]], level="simple"),
        *(among("posts, free", True, turns, thin) for turns in (0.5, 0.5, 2.5, 2.5, 2.5)),
        *(among("posts in the way", False, turns, thin) for turns in (0.5, 0.5, 2.5, 2.5, 2.5)),
        *(among("discs, free", True, turns, discs) for turns in (0.5, 0.5, 2.5, 2.5, 2.5)),
        *(among("discs in the way", False, turns, discs) for turns in (0.5, 0.5, 2.5, 2.5, 2.5)),
        *(
            post("only turns", [*here, turn], [*here, turn + 2.4 * side], share)
            for share in (0.2, 0.35, 0.7, 0.85)
        ),
        *(
            post("only moves", [0, 0, side * 1.5], [2.5, 0.5, side * 1.5], share)
            for share in rng.uniform(0.1, 0.9, 5).tolist()
        ),
        *(
            post("more than a turn", [*here, turn], [*here, turn + 7.0 * side], share)
            for share in (0.22, 0.28, 0.68, 0.72)
        ),
        post("the start touches", [0, 0, turn], [2, 1, turn + 1.0], 0.004),
        post("the end touches", [0, 0, turn], [2, 1, turn + 1.0], 0.996),
        edge("through two gates", [0, 0, 0.0], [2.2, 0, 0.0], gate, half=0.02, level="edge"),
        Case(
            (
                Clearance(
                    0.75, 0.125, [[1, 2, 0.5], [3, -1, 0.25]], np.zeros(3), np.array([3, 0, 1])
                ),
                0.75,
                np.array([0, 0, 0]),
                np.array([3, 0, 1]),
            ),
            WHOLE,
            "edge",
        ),
    ]


def evaluations(solution: str, case: Case) -> int:
    """Return how often the worked answer evaluates the clearance of an edge."""
    clearance = case.args[0].fresh()
    InProcess(solution, "").call("certify_edge", clearance, *case.args[1:])
    return sum(len(copy.shares) for copy in [clearance, *clearance.copies])


def explain(answers: Sequence[Answer]) -> str:
    """Name what the evaluated shares show: the same poses on every edge, or too much work."""
    moving = [a for a in answers if a.case.args[0].move.any()]
    rows = [np.round(a.case.args[0].shares, 6) for a in moving]
    longest: Any = max(rows, key=len, default=np.zeros(0))
    # Where no collision ends the search, the same poses are evaluated on every edge.
    free = [row for a, row in zip(moving, rows, strict=True) if np.all(np.equal(a.parts[0], 1))]
    if len(longest) and all(np.isin(row, longest).all() for row in rows):
        if all(len(row) == len(longest) for row in free):
            return "fixed_spacing" if len(longest) > 1 else "middle_only"
    if not all(all(a.right) for a in answers):
        return ""
    long = [row for row in rows if len(row) > 3]
    if not long:
        return ""
    if all(len(np.unique(row)) <= 0.6 * len(row) for row in long):
        return "evaluated_twice"
    steps = [np.diff(row) for row in long]
    if all((step >= 0.0).all() for step in steps) or all((step <= 0.0).all() for step in steps):
        return "from_one_end"
    # No interval has to be shorter than a 2,000th of its edge: the margin over the longest motion.
    dyadic = [np.abs(row * 2.0**12 - np.round(row * 2.0**12)).max() < 4e-3 for row in long]
    return "halved_blindly" if all(dyadic) else ""


def work(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Compare the number of evaluations with that of the worked answer, and report both."""
    solution = attempt.card.solution_text()
    used = sum(len(a.case.args[0].shares) for a in answers)
    ours = sum(evaluations(solution, a.case) for a in answers)
    mean, limit = used / len(answers), ALLOWANCE * ours / len(answers)
    attempt.cost("evaluations per edge", "1", yours=mean, reference=ours / len(answers))
    attempt.require(
        "evaluations",
        mean <= limit,
        sentence=f"You evaluated the clearance {mean:.3g} times per edge. At most {limit:.3g} are "
        "allowed.",
        got=f"{mean:.3g}",
        expected=f"at most {limit:.3g}",
        error=mean,
        tolerance=limit,
        unit="1",
        why=f"{ALLOWANCE} times the worked answer's number, on the same edges",
        slip=explain(answers),
    )


_SPEED = "speed = math.hypot(move[0], move[1]) + half * abs(move[2])"
_REACH = "reach = gap / speed if speed > 0.0 else 1.0"
_MIDDLE = "middle = 0.5 * (low + high)"
# The evaluated shares show these two (`explain`). Equal verdicts don't: a search with a wrong reach
# can miss the same obstacles as poses at a fixed spacing do.
_BY_SHARES = ("fixed_spacing", "middle_only")

SLIPS = slips(
    fixed_spacing=(
        _REACH,
        "reach = 0.1",
        "You check poses at a fixed spacing. Anything thinner than the distance between two of "
        "them is missed: let the clearance decide how far you may go.",
    ),
    middle_only=(
        _REACH,
        "reach = 1.0",
        "You check one pose of the edge. It says nothing about the motion far away from it.",
    ),
    turn_forgotten=(
        _SPEED,
        "speed = math.hypot(move[0], move[1])",
        "Your bound on the motion neglects the turn. The ends of the capsule also move by up to "
        "half times the angle.",
    ),
    translation_forgotten=(
        _SPEED,
        "speed = half * abs(move[2])",
        "Your bound on the motion neglects the translation. Every point of the capsule moves with "
        "its middle.",
    ),
    shorter_turn=(
        "move = np.asarray(b, dtype=float) - a",
        "move = np.asarray(b, dtype=float) - a\n"
        "    move[2] = math.remainder(move[2], 2.0 * math.pi)",
        "The capsule turns the shorter way round. It has to turn from a to b as they are given.",
    ),
    clearance_for_share=(
        _REACH,
        "reach = gap",
        "You treat the clearance as a share of the edge. Divide it by the bound on the motion over "
        "the whole edge, speed.",
    ),
    both_sides_counted_twice=(
        _REACH,
        "reach = 2.0 * gap / speed if speed > 0.0 else 1.0",
        "You skip twice the clearance on each side. A clearance g certifies g / speed to the left "
        "and g / speed to the right.",
    ),
    near_is_a_collision=(
        "if gap <= 0.0:",
        "if gap <= 0.02:",
        "You reject an edge when the capsule is near an obstacle. Only a clearance of at most 0 is "
        "a collision.",
    ),
    verdict_inverted=(
        "    return 1.0\n",
        "    return 0.0\n",
        "            return 0.0\n",
        "            return 1.0\n",
        "Your verdict is the wrong way round: return 1 for an edge that is free.",
    ),
    from_one_end=(
        _MIDDLE,
        "middle = low",
        "if gap <= 0.0:",
        "if gap <= 1e-6:",
        "You advance from one end of the edge. Each clearance also certifies the other side of its "
        "pose, and the steps shrink in front of an obstacle. Start in the middle.",
    ),
    halved_blindly=(
        _REACH,
        "reach = gap / speed if gap >= 0.5 * speed * (high - low) else 0.0",
        "You halve an interval until a clearance covers it as a whole. An evaluation that doesn't "
        "cover its interval still certifies a part of it: only the rest is left to check.",
    ),
    evaluated_twice=(
        "gap = float(clearance(a + middle * move))",
        "gap = float(min(clearance(a + middle * move), clearance(a + middle * move)))",
        "You evaluate the clearance of the same pose more than once. Store it.",
    ),
)
SLIPS = tuple(replace(slip, generic=slip.name in _BY_SHARES) for slip in SLIPS)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-9,
        "a verdict is 0 or 1",
        explain=explain,
        last=work,
        then=("core", "number of evaluations"),
        timed=lambda attempt, drawn: None,
    ),
    examples=(
        "certify_edge(lambda pose: 1.5 - abs(pose[0]), 0.5, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0])",
        "certify_edge(lambda pose: 1.5 - abs(pose[0]), 0.5, [0.0, 0.0, 0.0], [4.0, 0.0, 0.0])",
    ),
    slips=SLIPS + value_slips("certify_edge", in_part=False, whole=False),
)
