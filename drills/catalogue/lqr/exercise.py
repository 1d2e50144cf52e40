"""The gain of a discrete LQR: that the loop comes to rest first, then its values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]
SLOW = "a slow loop"


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one state, joints, drawn systems; slow loops, cheap commands, nothing to do."""

    def weights(n: int, least: float) -> Array:
        root = rng.normal(size=(n, n))
        return np.asarray(root @ root.T + least * np.eye(n))

    def drawn(n: int, m: int) -> Case:
        A, B = rng.normal(size=(n, n)), rng.normal(size=(n, m))
        return Case((A, B, weights(n, 0.1), weights(m, 0.3)), f"{n} states, {m} commands")

    def joint(dt: float, place: float, label: str, level: str = "core", fall: float = 0.0) -> Case:
        """Return a free inertia, or a pendulum upside down, whose place and rate have weights."""
        A = np.array([[1.0, dt], [dt * fall, 1.0]])
        B = np.array([[0.5 * dt * dt], [dt]]) * rng.uniform(0.5, 2.0)
        Q = np.diag([place, rng.uniform(0.05, 0.2) * place])
        return Case((A, B, Q, np.eye(1)), label, level)

    one, slow = np.ones((1, 1)), 0.999 + 0.0009 * rng.uniform()
    turn = rng.uniform(0.5, 1.0)
    spin = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    blind = np.array([[1.2, 0.5, 0.0], [0.0, 0.9, 0.4], [0.0, 0.0, 0.5]])  # the last lives alone
    whole = (
        np.array([[1, 1], [0, 1]]),
        np.array([[0], [1]]),
        np.array([[2, 0], [0, 1]]),
        np.array([[3]]),
    )
    a, b, q, r = rng.uniform([1.1, 0.5, 0.5, 0.5], 2.0)
    return [
        Case((one, one, one, one), "one state, all ones", "simple"),
        Case((a * one, b * one, q * one, r * one), "one state", "simple"),
        joint(0.1, 3.0, "a free inertia", "simple"),
        joint(0.05, 5.0, "an upright pendulum", fall=15.0),
        *(drawn(n, m) for n, m in ((2, 1), (3, 2), (4, 2), (6, 3))),
        Case((0.9 * spin, np.eye(2), np.eye(2), weights(2, 0.3)), "two commands, coupled in R"),
        Case((1.1 * spin, np.array([[1.0], [0.0]]), weights(2, 0.1), one), "turning outwards"),
        joint(1e-3, 1e-4, SLOW, "edge"),
        Case((one, 1e-2 * one, 1e-4 * one, one), SLOW, "edge"),
        Case((slow * one, one, 1e-9 * one, one), SLOW, "edge"),
        Case((spin, np.eye(2), np.eye(2), 1e-6 * np.eye(2)), "cheap commands", "edge"),
        Case(
            (blind, np.array([[0.0], [1.0], [0.0]]), np.diag([1.0, 0.0, 0.0]), one),
            "a state that no command reaches",
            "edge",
        ),
        Case((0.5 * spin, np.eye(2), np.zeros((2, 2)), np.eye(2)), "nothing to do", "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-8 of the largest entry."""
    return 1e-8 * float(np.abs(truth[0]).max()) + 1e-12


def at_rest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether the loop comes to rest: that says more than the values."""
    A, B, *_ = (np.asarray(value, dtype=float) for value in case.args)
    try:
        K = as_float64(parts[0], B.T.shape)
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        loop = A - B @ K
        growth = float(np.abs(np.linalg.eigvals(loop)).max()) if np.isfinite(loop).all() else np.inf
    attempt.require(
        f"{case.label}: the loop",
        growth < 1.0,
        sentence=f"With u = -K x the loop does not come to rest: it grows by {growth:.4g} a "
        "sample in the long run.",
        got=f"{growth:.6g}",
        expected="below 1",
        call=call,
    )


def explain(answers: Sequence[Answer]) -> str:
    """Return gains that are wrong where the loop is slow, and elsewhere right or nearly so."""
    slow = [a for a in answers if a.case.label == SLOW]
    near = [
        largest_error(a.parts[0], a.truth[0]) <= 1e-3 * (1e-9 + float(np.abs(a.truth[0]).max()))
        for a in answers
        if a.case.label != SLOW
    ]
    stopped = bool(slow) and not any(a.right[0] for a in slow) and all(near)
    return coarse(answers) or ("not_converged" if stopped else "")


def responses(figure: Any, shown: Shown) -> None:
    """Plot the first state over the samples, from one in all states."""
    axes = picture.plane(figure, "sample", "first state")
    A, B = (np.asarray(value, dtype=float) for value in shown.args[:2])
    for (K,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        x, path = np.ones(len(A)), []
        for _ in range(30):
            path.append(x[0])
            x = A @ x - B @ (np.asarray(K) @ x)
        axes.plot(np.clip(path, -5.0, 5.0), marker="o", ms=3, **style)
    axes.legend()


_RETURN = "return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)"

SLIPS = slips(
    continuous_for_discrete=(
        _RETURN,
        "return np.linalg.solve(R, B.T @ P)",
        "R^-1 B'P is the gain of the continuous problem. Here a command acts through a whole "
        "sample: K = (R + B'PB)^-1 B'PA.",
    ),
    sign_of_the_gain=(
        _RETURN,
        _RETURN.replace("return ", "return -"),
        "The gain has the wrong sign: the task uses u = -K x.",
    ),
    not_converged=(
        "range(60)",
        "range(6)",
        "It is right for fast loops but not for slow ones: the recursion stopped before P "
        "had converged. A fixed number of rounds, or a change that is small compared with 1, "
        "proves nothing. Continue until P no longer changes.",
    ),
    command_not_charged=(
        _RETURN,
        "return np.linalg.solve(R, B.T @ P @ A)",
        "B'PB is missing next to R: the command is charged for its own cost, but not for the "
        "cost of the state that it leads to.",
    ),
    state_one_sample_late=(
        _RETURN,
        "return np.linalg.solve(R + B.T @ P @ B, B.T @ P)",
        "A is missing at the end: the command has to act against A x, where the state goes "
        "by itself, not against x.",
    ),
    one_sample_only=(
        "range(60)",
        "range(0)",
        "Only the next sample counts: P is Q. The cost of all samples to come solves the Riccati "
        "equation.",
    ),
    transposed_system=(
        "B.T @ P @ A)",
        "B.T @ P @ A.T)",
        "step, G, P = A, B",
        "step, G, P = A.T, B",
        "A is transposed throughout. That solves the dual problem, the gain of an estimator.",
    ),
    transposed_in_the_equation=(
        "step, G, P = A, B",
        "step, G, P = A.T, B",
        "P solves the Riccati equation of the transposed A, as an estimator needs it. The cost of "
        "a regulator comes from A itself.",
    ),
    weights_of_commands_ignored=(
        "R = np.asarray(Q, dtype=float), np.asarray(R, dtype=float)",
        "R = np.asarray(Q, dtype=float), np.eye(len(R))",
        "R is taken to be the identity.",
    ),
    diagonal_of_the_weights=(
        "R = np.asarray(Q, dtype=float), np.asarray(R, dtype=float)",
        "R = np.diag(np.diag(Q)) * 1.0, np.diag(np.diag(R)) * 1.0",
        "Only the diagonals of Q and R are used. Commands and states may be weighted together.",
    ),
    half_of_the_weights=(
        "B @ np.linalg.solve(R, B.T), Q\n",
        "B @ np.linalg.solve(R, B.T), 0.5 * Q\n",
        "Only half of the state cost is used.",
    ),
    value_returned=(
        _RETURN,
        "return P",
        "This is P, the matrix of the cost-to-go. K follows from it: (R + B'PB)^-1 B'PA.",
    ),
    gain_transposed=(
        _RETURN,
        f"{_RETURN}.T",
        "The gain is transposed: it has a row for each command and a column for each state.",
    ),
    loop_returned=(
        _RETURN,
        _RETURN.replace("return ", "return A - B @ "),
        "This is the closed-loop matrix, A - B K. The task asks for the gain K.",
    ),
    cost_of_the_command_only=(
        "step, G, P = A, B @ np.linalg.solve(R, B.T), Q",
        "step, G, P = A, B @ B.T, Q",
        "The recursion for P leaves R out, though the gain has it.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "these Riccati equations are solved to 1e-10 in double precision",
        first=at_rest,
        explain=explain,
    ),
    examples=(
        "lqr(np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.ones((1, 1)))",
        "lqr(np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[0.005], [0.1]]), np.eye(2), np.eye(1))",
        "lqr(np.array([[0.5]]), np.eye(1), np.zeros((1, 1)), np.eye(1))",
    ),
    picture=responses,
    slips=SLIPS
    + coarse_slips("lqr", "A loop near its limit then comes out on the other side of it.")
    + value_slips("lqr", in_part=False),
)
