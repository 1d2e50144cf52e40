"""A round of DAgger: one state, several, data that do not determine K, an expert that saturates."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return plants that grow a little by themselves.

    The expert's law bends where actions are large.
    """

    def task(
        label: str, level: str = "core", *, n: int = 2, m: int = 1, k: int = 8, steps: int = 6
    ) -> Case:
        A = 1.1 * np.linalg.qr(rng.normal(size=(n, n)))[0]
        B = rng.normal(size=(n, m)) + np.eye(n, m)
        G = 0.7 * np.linalg.pinv(B) @ A

        def expert(x: Any) -> Any:
            return -np.tanh(G @ np.asarray(x, dtype=float)) - 0.1

        states, start = rng.normal(size=(n, k)), 2.0 * rng.normal(size=n)
        labels = np.column_stack([expert(x) for x in states.T])
        return Case((A, B, expert, states, labels, start, steps), label, level)

    def brake(x: Any) -> Any:
        speed = np.asarray(x, dtype=float)[1:]
        return np.where(np.abs(speed) < 0.2, 0.0, -np.sign(speed))

    # K is [-2/7, -3/7]: the second components visited are 2, 0.857 and -0.367, all of them far from
    # the edges of the dead band, so rounding in the answer can't change a label.
    whole = (
        np.array([[1, 1], [0, 1]]),
        np.array([[0], [1]]),
        brake,
        np.array([[2, -1], [1, 3]]),
        np.array([[-1, -1]]),
        np.array([1, 2]),
        3,
    )
    return [
        task("one state, one action", "simple", n=1, steps=1),
        task("one state", "simple", n=1),
        task("one action", "simple", steps=1),
        *(task("two states") for _ in range(3)),
        *(task("three states, two actions", n=3, m=2, k=12, steps=8) for _ in range(3)),
        task("fewer data than states", "edge", n=3, k=1),
        task("no steps", "edge", steps=0),
        Case(whole, WHOLE, "edge"),
    ]


def labelled(figure: Any, shown: Shown) -> None:
    """Plot the first component of all labels."""
    axes = picture.plane(figure, "sample", "label, first component")
    for (_, part, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(part)[0], marker="o", ms=4, **style)
    axes.axvline(np.shape(shown.args[4])[1] - 0.5, color="0.6", ls=":", label="the round begins")
    axes.legend()


_STORE = (
    "        visited, labelled = np.column_stack((visited, x)), "
    "np.column_stack((labelled, expert(x)))\n"
)
_MOVE = "        x = plant @ x + push @ (K @ x)\n"
_RETURN = "return visited, labelled, fit(visited, labelled)"
_OLD = "np.shape(states)[1]"

SLIPS = slips(
    learners_labels=(
        "labelled, expert(x)",
        "labelled, K @ x",
        "The new labels are the learner's own actions, so it learns to do what it does already. "
        "Ask the expert what to do in the states that the learner visited.",
    ),
    data_replaced=(
        _RETURN,
        f"visited, labelled = visited[:, {_OLD}:], labelled[:, {_OLD}:]\n    {_RETURN}",
        "The old data are missing. DAgger aggregates: a fit to the last round alone forgets what "
        "was learned before.",
    ),
    fitted_to_the_new_alone=(
        _RETURN,
        f"return visited, labelled, fit(visited[:, {_OLD}:], labelled[:, {_OLD}:])",
        "The fit uses only the new data. DAgger fits to all data, or it forgets what was learned "
        "before.",
    ),
    expert_drives=(
        _MOVE,
        _MOVE.replace("(K @ x)", "expert(x)"),
        "The expert drives, so the new states are of the kind that the data contain already. The "
        "learner has to drive.",
    ),
    states_one_late=(
        _STORE + _MOVE,
        _MOVE + _STORE,
        "Each state is stored after the action, so the start is missing and there is one state "
        "too many at the end.",
    ),
    not_fitted_again=(
        _RETURN,
        "return visited, labelled, K",
        "The data are right, but K still belongs to the old data: fit again.",
    ),
    fitted_after_each_step=(
        _MOVE,
        _MOVE + "        K = fit(visited, labelled)\n",
        "The learner is fitted again within the round. It drives unchanged until the round is "
        "over.",
    ),
    both_drive=(
        _MOVE,
        _MOVE.replace("(K @ x)", "(0.5 * K @ x + 0.5 * expert(x))"),
        "Half of each action is the expert's. In this round the learner drives alone.",
    ),
    sign_of_the_loop=(
        _MOVE,
        "        x = plant @ x - push @ (K @ x)\n",
        "The action enters the plant with a minus. The learner's law is u = K x, not u = -K x.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-8, "least squares of well spread data", explain=coarse),
    examples=(
        "dagger_round([[1.1]], [[1.0]], lambda x: -np.tanh(x), [[1.0]], [[-0.8]], [2.0], 2)",
    ),
    picture=labelled,
    slips=SLIPS
    + coarse_slips(
        "dagger_round", "A control law close to the stability limit can then become unstable."
    )
    + value_slips("dagger_round"),
)
