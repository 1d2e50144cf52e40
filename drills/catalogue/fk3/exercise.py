"""Forward kinematics: every position of random and special arms."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from drills.exercise import Exercise, Slip
from drills.grade import Attempt, Case, judge_function

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

WHY = "rounding of three cosines and sums of up to 10 m; float32 would be off by 1e-7 m"


def judge(attempt: Attempt) -> None:
    """Values only: the task has one right answer."""
    judge_function(attempt, _cases(attempt.rng), tolerance=1e-10, unit="m", why=WHY)


def _cases(rng: np.random.Generator) -> list[Case]:
    def arm() -> np.ndarray:
        return rng.uniform(0.05, 2.0, size=3)

    cases = [Case((arm(), rng.uniform(-np.pi, np.pi, size=3))) for _ in range(12)]
    folded = np.array([rng.uniform(-np.pi, np.pi), np.pi, -np.pi])
    cases += [
        Case((arm(), np.zeros(3)), "straight along x"),
        Case((arm(), np.array([rng.uniform(0.3, 1.2), 0.0, 0.0])), "straight"),
        Case((arm(), folded), "folded back"),
        Case((arm() * [1.0, 0.0, 1.0], rng.uniform(-3.0, 3.0, size=3)), "a link of no length"),
        Case((arm(), rng.uniform(-300.0, 300.0, size=3)), "many turns"),
        Case((arm(), rng.choice([-0.5, 0.5, 1.0], size=3) * np.pi), "right angles"),
        Case((rng.uniform(0.5, 2.0, 3).tolist(), rng.uniform(-2.0, 2.0, 3).tolist()), "lists"),
        Case((arm(), rng.uniform(-1.0, 1.0, size=3)), "one more"),
    ]
    return cases


SLIPS = (
    Slip(
        "degrees_for_radians",
        "The angles were taken as degrees: they are in rad already, so sin and cos need no "
        "conversion.",
        edits=(("np.cumsum(thetas)", "np.radians(np.cumsum(thetas))"),),
    ),
    Slip(
        "absolute_angles",
        "Each angle was taken from the x axis. They are relative: link i points along the sum of "
        "the first i angles.",
        edits=(("np.cumsum(thetas)", "thetas"),),
    ),
    Slip(
        "last_joint_forgotten",
        "The last angle has no effect: the third link has the direction of the second.",
        edits=(("np.cumsum(thetas)", "np.cumsum([thetas[0], thetas[1], 0.0])"),),
    ),
    Slip(
        "elbow_sign",
        "Angles grow clockwise here: y has the wrong sign. Counter-clockwise is positive.",
        edits=(("np.sin(directions)", "-np.sin(directions)"),),
    ),
    Slip(
        "sine_and_cosine_swapped",
        "x and y are swapped: x goes with the cosine, y with the sine.",
        edits=(
            ("np.cos(directions), np.sin(directions)", "np.sin(directions), np.cos(directions)"),
        ),
    ),
    Slip(
        "tip_forgotten",
        "The tip is missing: the last row has to be the end of the third link.",
        edits=(
            (
                "np.vstack((np.zeros(2), np.cumsum(links, axis=0)))",
                "np.vstack((np.zeros(2), np.cumsum(links, axis=0)))[:3]",
            ),
        ),
    ),
    Slip(
        "base_forgotten",
        "The base is missing: the first row has to be (0, 0).",
        edits=(("np.vstack((np.zeros(2), np.cumsum(links, axis=0)))", "np.cumsum(links, axis=0)"),),
    ),
    Slip(
        "links_not_summed",
        "These are the links themselves. A position is the sum of all links before it.",
        edits=(
            (
                "np.vstack((np.zeros(2), np.cumsum(links, axis=0)))",
                "np.vstack((np.zeros(2), links))",
            ),
        ),
    ),
)

EXAMPLES = (
    "fk3([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])",
    "fk3([1.0, 1.0, 1.0], [np.pi / 2, 0.0, 0.0])",
    "fk3([1.0, 0.5, 0.25], [0.0, np.pi / 2, -np.pi / 2])",
)


def chart(attempt: Attempt) -> WorkPrecision:
    """Error of all positions against time per call, beside the worked answer and Pinocchio."""
    import mpmath

    from course.measure.work_precision import Method, Result, measure
    from course.oracles.pinocchio import PlanarChain

    lengths, thetas = attempt.rng.uniform(0.2, 1.5, 3), attempt.rng.uniform(-3.0, 3.0, 3)
    with mpmath.workdps(40):
        turn = [mpmath.fsum(map(mpmath.mpf, thetas[: i + 1])) for i in range(3)]
        links = [
            (mpmath.mpf(r) * mpmath.cos(s), mpmath.mpf(r) * mpmath.sin(s))
            for r, s in zip(map(float, lengths), turn, strict=True)
        ]
        exact = [
            [float(mpmath.fsum(link[k] for link in links[:i])) for k in (0, 1)] for i in range(4)
        ]
    turns = np.exp(1j * np.cumsum(np.asarray(thetas, dtype=np.longdouble)))
    second = np.concatenate([[0.0], np.cumsum(lengths * turns)])
    chain, many = PlanarChain(lengths), 1000

    def yours(_: float) -> Result:
        answer = attempt.learner.child.call(attempt.card.entry, lengths, thetas, repeat=many)
        return Result(answer, many)

    def ours(_: float) -> Result:
        return Result(attempt.reference.call("fk3", lengths, thetas, repeat=many), many)

    def library(_: float) -> Result:
        for _ in range(many):
            answer = chain.positions(thetas)
        return Result(answer, many)

    return measure(
        [
            Method("yours", yours, [1.0], style="yours", unit="calls"),
            Method("worked answer", ours, [1.0], unit="calls"),
            Method("Pinocchio", library, [1.0], style="oracle", unit="calls"),
        ],
        exact,
        reference_check=np.stack([second.real, second.imag], axis=1).astype(float),
        tolerance=1e-10,
        question=f"Positions of a three-link arm, {many} calls",
        error_unit="m",
    )


EXERCISE = Exercise(judge=judge, slips=SLIPS, examples=EXAMPLES, chart=chart)
