"""Attacks on the judges by other means than the hostile suite: holes that were found stay shut.

Answers are edits of the worked ones: right in another style, wrong in a way that was once
overlooked, or wrong in one way and once named as another.
"""

from __future__ import annotations

from typing import Any, cast

import pytest

from drills import cards as catalogue
from drills.reasons import Reason
from tests.drills.here import grade_here

pytestmark = pytest.mark.slow


def edited(name: str, *edits: tuple[str, str]) -> str:
    text = catalogue.card(name).solution_text()
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return text


OWN = ("class DomainRandomizer", "RNG = np.random.default_rng(1)\n\n\nclass DomainRandomizer")
TARGET = "goal if rng.random() < GOAL_BIAS else rng.uniform(low, high)"
STEPPED = """
_step = VectorizedEnv.step


def step(self, actions):
    o, r, t, u, i = _step(self, actions)
    return {}


VectorizedEnv.step = step
"""

WRONG = {
    "bounce: another default gravity": ("bounce_step", ("gravity: float = 9.81", "gravity=9.8")),
    "bounce: hops of a micrometre cut off": (
        "bounce_step",
        (
            "    up = restitution * impact\n",
            "    up = restitution * impact\n    if up < 0.01:\n        return 0.0, 0.0\n",
        ),
    ),
    "observed_order: another default ratio": (
        "observed_order",
        ("ratio: float = 2.0", "ratio: float = 3.0"),
    ),
    "observed_order: differences that stay": (
        "observed_order",
        ("0.0 < second < first < math.inf", "0.0 < second <= first"),
        ("(growth - 1.0)", "(growth - 1.0 + 1e-300)"),
    ),
    "rrt: a generator of its own": (
        "rrt",
        ("GOAL_BIAS = 0.1", "GOAL_BIAS = 0.1\nRNG = np.random.default_rng(3)"),
        (TARGET, TARGET.replace("rng.", "RNG.")),
    ),
    "rrt: numpy.random beside rng": (
        "rrt",
        ("GOAL_BIAS = 0.1", "GOAL_BIAS = 0.1\nnp.random.seed(3)"),
        ("rng.random() < GOAL_BIAS", "np.random.random() < GOAL_BIAS"),
    ),
    "rrt: every tenth target is the goal": (
        "rrt",
        ("rng.random() < GOAL_BIAS", "len(samples) % 10 == 9"),
    ),
    "rrt: targets pushed onto the border": (
        "rrt",
        (
            "rng.uniform(low, high)",
            "np.clip(rng.normal((low + high) / 2, (high - low) / 3), low, high)",
        ),
    ),
    "pid: an integral that knows the upper limit only": (
        "PID",
        (" or (desired < self.u_min and error < 0.0)", ""),
    ),
    "pid: an integral that knows the lower limit only": (
        "PID",
        ("(desired > self.u_max and error > 0.0) or ", ""),
    ),
    "randomize: noise from a generator of its own": (
        "DomainRandomizer",
        OWN,
        ("observation + rng.normal", "observation + RNG.normal"),
    ),
    "randomize: delay from a generator of its own": (
        "DomainRandomizer",
        OWN,
        ("int(rng.integers", "int(RNG.integers"),
    ),
    "randomize: mass factors even in their logarithm": (
        "DomainRandomizer",
        (
            "rng.uniform(*self.mass, size=model.nbody)",
            "np.exp(rng.uniform(*np.log(self.mass), size=model.nbody))",
        ),
    ),
    "randomize: other default masses": ("DomainRandomizer", ("(0.7, 1.3)", "(0.8, 1.2)")),
    "randomize: another default delay": (
        "DomainRandomizer",
        ("delay: tuple[int, int] = (0, 3)", "delay=(0, 2)"),
    ),
    "randomize: another default noise": (
        "DomainRandomizer",
        ("noise: float = 0.01", "noise: float = 0.02"),
    ),
    "randomize: torsional friction of a pair": (
        "DomainRandomizer",
        ("pair_friction[:, :2]", "pair_friction[:, :3]"),
    ),
    "randomize: a delay before the first draw": (
        "DomainRandomizer",
        ("self.steps = 0", "self.steps = 1"),
    ),
}


def exercise_of(entry: str) -> str:
    return next(card.name for card in catalogue.cards() if card.entry == entry)


@pytest.mark.prove
@pytest.mark.parametrize("label", WRONG)
def test_a_wrong_answer_that_once_passed_fails_and_is_not_named_as_another(label: str) -> None:
    entry, *edits = cast(tuple[Any, ...], WRONG[label])
    name = exercise_of(entry)
    report = grade_here(name, edited(name, *edits), seed=4242)
    true = ("default_gravity", "rests_too_early", "end_excluded", "no_order_not_refused")
    # That one of two results is right everywhere is counted, so it is true of any mistake.
    allowed = ("", "integral_not_stopped", "one_part_right", *true)
    assert not report.passed and report.slip in allowed, report.sentence
    assert report.reason not in (Reason.RAISED, Reason.WRONG_SIGNATURE), report.sentence


RIGHT = {
    "observed_order: an exception of its own that is a ValueError": edited(
        exercise_of("observed_order"),
        ("def observed_order", "class NoOrder(ValueError):\n    pass\n\n\ndef observed_order"),
        ("raise ValueError", "raise NoOrder"),
    ),
    "rrt: draws by integers": edited("rrt", ("rng.random() < GOAL_BIAS", "rng.integers(10) == 0")),
    "orientation: the negative of the quaternion": edited(
        "orientation", ("return turned /", "return -turned /")
    ),
    "tumble: the negative of the quaternion": edited(
        "tumble", ("return q, omega", "return -q, omega")
    ),
    "vector_env: flags as lists and tuples": edited("vector_env")
    + STEPPED.format("o, r, list(t), tuple(u), tuple(i)"),
}


@pytest.mark.parametrize("label", RIGHT)
def test_a_right_answer_in_another_style_passes(label):
    report = grade_here(label.partition(":")[0], RIGHT[label], seed=1)
    assert report.passed, report.sentence


NAMED_BEFORE = {
    "fk3: off by a nanometre, not rounded": edited(
        "fk3", ("np.cumsum(links, axis=0)))", "np.cumsum(links, axis=0))) + 1e-9")
    ),
    "observed_order: extrapolated from the wrong run": edited(
        "observed_order", ("return order, fine +", "return order, medium +")
    ),
    "observed_order: refused with another exception": edited(
        "observed_order", ('raise ValueError(f"the diff', 'raise RuntimeError(f"the diff')
    ),
    "rrt: targets that led to nothing are not listed": edited(
        "rrt",
        ("        samples.append(target)\n", ""),
        ("            continue\n", "            continue\n        samples.append(target)\n"),
        ("len(samples) < max_samples", "tries < max_samples"),
        ("        target =", "        tries += 1\n        target ="),
        (
            "    result = np.array_equal(start, goal)\n",
            "    result = np.array_equal(start, goal)\n    tries = 0\n",
        ),
    ),
}


@pytest.mark.prove
@pytest.mark.parametrize("label", NAMED_BEFORE)
def test_a_mistake_is_not_named_as_one_that_it_is_not(label):
    report = grade_here(label.partition(":")[0], NAMED_BEFORE[label], seed=4242)
    assert not report.passed and report.slip in ("", "one_part_right"), report.slip


def test_swapped_results_of_a_bounce_are_a_wrong_value_not_an_exception():
    text = edited("bounce") + "\n_right = bounce_step\n\n\ndef bounce_step(y, v, dt, restitution, "
    text += "gravity=9.81):\n    return _right(y, v, dt, restitution, gravity)[::-1]\n"
    assert grade_here("bounce", text, seed=4242).reason is Reason.WRONG_VALUE


def test_indices_and_numbers_beyond_all_bounds_make_no_noise(recwarn):
    huge = edited("rrt", ("np.array(parents),", "np.array(parents) * 1e300,"))
    large = "def tumble(q, omega, inertia, dt, steps):\n    return [1e308] * 4, [1e308] * 3\n"
    for text, name in ((huge, "rrt"), (large, "tumble")):
        assert grade_here(name, text, seed=1).reason is Reason.WRONG_PROPERTY
    assert not recwarn.list


@pytest.mark.prove
@pytest.mark.parametrize("name", catalogue.names())
def test_the_first_and_the_last_seed_are_fair(name):
    for seed in (0, 2**32 - 1):
        report = grade_here(name, catalogue.card(name).solution_text(), seed=seed)
        assert report.passed, report.sentence


def test_a_generator_function_is_not_told_that_it_accepts_collisions():
    text = edited("rrt") + "\n_right = rrt\n\n\ndef rrt(*args):\n    yield from _right(*args)\n"
    report = grade_here("rrt", text, seed=4242)
    assert not report.passed and report.slip == ""
