"""Messages in fragments: one, a few, a picture; links from very good to very bad."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import Answer, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return sizes that fill the last fragment and that don't."""

    def sent(
        label: str, level: str = "core", *, n: float = 600.0, p: float = -3.0, full: bool = False
    ) -> Case:
        """Return a message whose fragment count is near n and whose loss is near 10^p."""
        payload = int(rng.choice([1344, 1472, 8192, 65000]))
        fragments = max(round(n * rng.uniform(0.7, 1.4)), 2 if n > 1.0 else 1)
        short = 0 if full else int(rng.integers(1, payload))
        loss = float(10.0 ** (p + rng.uniform(-0.2, 0.2)))
        return Case((fragments * payload - short, payload, loss), label, level)

    return [
        sent("one fragment", "simple", n=1.0, p=-1.0),
        sent("two", "simple", n=2.0, p=-0.7),
        sent("a full last one", "simple", n=4.0, p=-1.0, full=True),
        *(sent("a picture") for _ in range(2)),
        sent("a picture, a good link", p=-4.0),
        sent("a picture, a bad link", p=-0.5),
        sent("a large picture", n=2000.0, p=-3.5),
        *(sent("a few", n=10.0, p=-2.0) for _ in range(2)),
        sent("a few, full", n=8.0, full=True),
        sent("a cable", "edge", p=-12.0),
        sent("a message on a cable", "edge", n=1.0, p=-13.0),
        Case((921600, 1472, 0.0), "nothing is lost", "edge"),
        Case((100, 1472, 0.9), "nine of ten are lost", "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9 of each value."""
    return [1e-9 * max(float(value), 1e-15) for value in truth]


def explain(answers: Sequence[Answer]) -> str:
    """Return coarse values.

    Those wrong by what a difference of numbers near 1 leaves, and only these.
    """
    wrong = [a for a in answers if not all(a.right)]
    if all(
        largest_error(part, t) < 1e-12
        for a in wrong
        for part, t in zip(a.parts, a.truth, strict=True)
    ):
        return "digits_cancelled" if wrong else ""
    return coarse(answers)


def over_loss(figure: Any, shown: Shown) -> None:
    """Plot the three values, each in parts of what is right."""
    axes = picture.plane(figure, "value: lost, rounds, sent", "in parts of the right one")
    for values, style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        right = np.maximum(np.asarray(shown.expected, dtype=float), 1e-15)
        axes.plot(np.asarray(values, dtype=float) / right, "o", **style | {"ls": "-"})
    axes.legend()


_COUNT = "n = -(-size // payload)"
_LOST = "lost = -math.expm1(n * math.log1p(-loss))"
_MORE = "rounds -= math.expm1(n * math.log1p(-missing))"
_WHILE = "while n * missing > 1e-18 * rounds:"
_RETURN = "return lost, rounds, n / (1.0 - loss)"

SLIPS = slips(
    one_fragment=(
        _COUNT,
        "n = 1",
        "The message is treated as one fragment. It is complete only if all its fragments arrive.",
    ),
    rounded_down=(
        _COUNT,
        "n = max(size // payload, 1)",
        "The short fragment at the end is not counted: round up.",
    ),
    one_too_many=(
        _COUNT,
        "n = size // payload + 1",
        "There is one fragment too many if the last one is full.",
    ),
    a_part_of_a_fragment=(
        _COUNT,
        "n = size / payload",
        "The number of fragments must be an integer: the short one at the end is lost as easily "
        "as any other.",
    ),
    proportional=(
        _LOST,
        "lost = min(n * loss, 1.0)",
        "The probabilities of the losses are added. That is right only while the sum is small; "
        "multiply the probabilities that each fragment arrives.",
    ),
    all_must_be_lost=(
        _LOST,
        "lost = loss**n",
        "That is the probability that every fragment is lost. One is enough.",
    ),
    digits_cancelled=(
        _LOST,
        "lost = 1.0 - (1.0 - loss) ** n",
        "1 - (1 - p)^n loses digits on a good link, because 1 - p has only sixteen of them. "
        "-expm1(n log1p(-p)) preserves the digits of p.",
    ),
    whole_message_again=(
        _WHILE,
        "rounds = math.exp(-n * math.log1p(-loss))\n    while False:",
        _RETURN,
        "return lost, rounds, n * rounds",
        "The whole message is sent again until one copy is complete. Only the missing fragments "
        "must be sent again.",
    ),
    rounds_of_a_message=(
        _WHILE,
        "rounds = math.exp(-n * math.log1p(-loss))\n    while False:",
        "These rounds would send everything again. The second round sends only the missing "
        "fragments, so it nearly always succeeds.",
    ),
    rounds_of_one=(
        _WHILE,
        "rounds = 1.0 / (1.0 - loss)\n    while False:",
        "These are the rounds of one fragment. The message needs the largest number of rounds "
        "among its n fragments.",
    ),
    two_rounds=(
        _WHILE,
        "rounds += lost\n    while False:",
        "A second round is counted but no third. Fragments that are sent again are lost as often "
        "as the first time.",
    ),
    first_round_forgotten=(
        "rounds, missing = 1.0, loss",
        "rounds, missing = 0.0, loss",
        "Only the repetitions are counted. The first round counts too.",
    ),
    sent_each_round=(
        _RETURN,
        "return lost, rounds, n * rounds",
        "All fragments are counted in every round. Only the missing ones are sent again.",
    ),
    sent_once_more=(
        _RETURN,
        "return lost, rounds, n * (1.0 + loss)",
        "A fragment that is sent again may be lost again: n (1 + p + p^2 + ...).",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a sum of a few terms: rounding", explain=explain),
    examples=("fragment_loss(921600, 1472, 1e-3)", "fragment_loss(100, 1472, 0.5)"),
    picture=over_loss,
    slips=SLIPS
    + coarse_slips("fragment_loss", "A cable loses one in a million million.")
    + value_slips("fragment_loss", swapped=True, whole=False),
)
