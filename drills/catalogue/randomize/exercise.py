"""Domain randomisation: the arrays of the learner's model are judged on a model of this side."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drills.attempt import Attempt, Place
from drills.catalogue.randomize.bench import (
    ALLOWED,
    ENTRY,
    Arrays,
    Bench,
    Unreadable,
    alike,
    draw_setting,
    move_data,
    same_arrays,
)
from drills.catalogue.randomize.many_draws import (
    defaults,
    distributions,
    equal_ends,
    noise_added,
    refusals,
    repeated,
    reused_actions,
    undelayed,
)
from drills.catalogue.randomize.one_draw import one_draw
from drills.catalogue.randomize.slips import SLIPS
from drills.exercise import Exercise
from drills.inprocess import InProcess, Local
from drills.sandbox import Limits

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")

ROUNDED = float(np.finfo(float).eps)  # the least error that the chart shows


def judge(attempt: Attempt) -> None:
    """Check one draw in every detail, then what must be true of many.

    That is repetition, restoring, distributions, delay and noise.
    """
    try:
        _judge(attempt)
    except Unreadable as lost:
        attempt.require(
            "the model can be read",
            False,
            sentence=f"The drill's own function {lost} gave something else than it does: leave the "
            "module `given` and MuJoCo's as they are.",
        )


def _judge(attempt: Attempt) -> None:
    seeds = [int(seed) for seed in attempt.rng.integers(1 << 32, size=6)]
    attempt.plan([(level, label) for level, label, _, _ in STAGES])
    drawn: list[Arrays | None] = []
    bench: Bench | None = None
    for index, (_, _, goes_on, run) in enumerate(STAGES):
        if attempt.failed and not goes_on:
            return
        with attempt.part(index):
            bench = bench or Bench(attempt, draw_setting(attempt.rng))
            run(bench, drawn, seeds)
        if drawn and drawn[0] is None:
            return
    if bench is not None and not attempt.failed:
        _time(bench)


def _untouched(bench: Bench, drawn: list[Arrays | None], seeds: list[int]) -> None:
    result = bench.arrays()
    same_arrays(bench.attempt, "the constructor leaves the model", bench.before, result)
    undelayed(bench, "before the first draw")
    move_data(bench)


# Level, label, whether it is tried after a failure, and what is done with what was drawn first.
STAGES: tuple[tuple[str, str, bool, Callable[[Bench, list[Any], list[int]], object]], ...] = (
    ("simple", "a new randomizer", True, _untouched),
    ("simple", "one draw", True, lambda b, drawn, s: drawn.append(one_draw(b, s[0]))),
    ("core", "many draws, and back", True, lambda b, drawn, s: repeated(b, drawn[0], s)),
    ("core", "distributions", False, lambda b, drawn, s: distributions(b, drawn[0], s[2])),
    ("core", "actions in one array", True, lambda b, drawn, s: reused_actions(b, s[3])),
    ("core", "noise", True, lambda b, drawn, s: noise_added(b, s[4])),
    ("edge", "ranges of one value", False, lambda b, drawn, s: equal_ends(b, s[5])),
    ("edge", "the defaults", False, lambda b, drawn, s: defaults(b, s[5])),
    ("edge", "what is refused", True, lambda b, drawn, s: refusals(b)),
)


def _time(bench: Bench) -> None:
    """Time one randomisation."""

    def sampler(place: Any) -> Callable[[int], float]:
        model = place.given_new("build", bench.setting.xml, 1.0)
        data, rng = place.given_new("fresh", model), place.given_new("generator", 1)
        randomizer = place.new(ENTRY, model)

        def run(n: int) -> float:
            place.given("timed", randomizer, data, rng, n)
            return float(place.elapsed)

        return run

    attempt = bench.attempt
    attempt.time(
        "time per randomisation", sampler(attempt.learner.child), sampler(attempt.reference)
    )


def chart(attempt: Attempt, answer: Place) -> WorkPrecision:
    """Plot the time of 50 randomisations and the worst derived constant over the model's size."""
    import mujoco

    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco.randomize import recompiled, worst_constant

    count = 50
    sizes = {1.0 / n: n for n in (2, 8, 32)}  # a larger parameter means less work
    texts = {parameter: _chain(n) for parameter, n in sizes.items()}
    defaults = {p: mujoco.MjModel.from_xml_string(xml) for p, xml in texts.items()}

    def error(parameter: float, model: Any) -> float:
        one = np.ones(model.nbody)
        one[1:] = model.body_mass[1:] / defaults[parameter].body_mass[1:]
        if not (np.isfinite(one).all() and (one > 0.0).all()):
            return np.inf
        return max(worst_constant(model, recompiled(texts[parameter], one))[0], ROUNDED)

    def randomized(name: str, style: str, side: Any, given: Callable[..., Any]) -> Method:
        prepared, errors = {}, {}
        for parameter, xml in texts.items():
            model = side.given_new("build", xml, 1.0)
            data, rng = side.given_new("fresh", model), side.given_new("generator", 1)
            prepared[parameter] = side.new(ENTRY, model), data, rng
            given("timed", *prepared[parameter], 1)
            here = copy.copy(defaults[parameter])
            arrays, like = given("arrays", model), attempt.reference.given("arrays", Local(here))
            if not alike(arrays, like):
                errors[parameter] = np.inf
                continue
            for field in ALLOWED & arrays.keys():
                getattr(here, field)[...] = arrays[field]
            errors[parameter] = error(parameter, here)

        def run(parameter: float) -> Result:
            given("timed", *prepared[parameter], count)
            return Result(errors[parameter], count * sizes[parameter])

        return Method(name, run, list(sizes), style=style, unit="bodies drawn")

    def compiled(parameter: float) -> Result:
        rng = np.random.default_rng(2)
        for _ in range(count):
            factors = rng.uniform(0.7, 1.3, size=defaults[parameter].nbody)
            recompiled(texts[parameter], factors, friction=0.5)
        return Result(check[parameter], count * sizes[parameter])

    def constants_of(parameter: float) -> float:
        """Return a compiled model against one whose constants were recomputed."""
        rng = np.random.default_rng(2)
        factors = rng.uniform(0.7, 1.3, size=defaults[parameter].nbody)
        model = copy.copy(defaults[parameter])
        model.body_mass[:] *= factors
        model.body_inertia[:] *= factors[:, None]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return max(worst_constant(recompiled(texts[parameter], factors), model)[0], ROUNDED)

    slip = next(slip for slip in SLIPS if slip.name == "constants_not_recomputed")
    stale = InProcess(slip.text(attempt.card.solution_text()), GIVEN)
    check = {parameter: constants_of(parameter) for parameter in sizes}
    return measure(
        [
            randomized("yours", "yours", attempt.learner.child, attempt.learner.child.given),
            randomized("reference", "ours", attempt.reference, attempt.reference.given),
            randomized("without mj_setConst", "ours", stale, stale.given),
            Method("MjSpec compiled anew", compiled, list(sizes), "oracle", "bodies drawn"),
        ],
        0.0,
        reference_check=0.0,
        tolerance=1e-9,
        failed_above=1e3,
        repeats=3,
        question="50 randomisations of a chain of 2 to 32 bodies",
        error_unit="relative, worst constant",
    )


def _chain(bodies: int) -> str:
    """Return a hanging chain of capsules, every second joint damped, with a motor at the top."""
    inside = ""
    for number in range(bodies, 0, -1):
        damping = 0.1 if number % 2 else 0.0
        inside = (
            f'<body pos="0 0 {-0.2 if number > 1 else 8}"><joint name="j{number}" axis="0 1 0" '
            f'damping="{damping}"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.03"/>'
            f"{inside}</body>"
        )
    return (
        '<mujoco><worldbody><geom type="plane" size="5 5 0.1"/>'
        f'{inside}</worldbody><actuator><motor joint="j1"/></actuator></mujoco>'
    )


EXERCISE = Exercise(
    judge=judge,
    given=GIVEN,
    limits=Limits(call=8.0, total=90.0),
    examples=(
        "given.drawn(DomainRandomizer, mass=(2, 2), damping=(0.2, 0.2), friction=(0.5, 0.5))",
        "given.delayed(DomainRandomizer, [1, 2, 3, 4, 5], delay=(2, 2), idle=-1.0)",
        "given.delayed(DomainRandomizer, [1, 2, 3], delay=(0, 0))",
    ),
    chart=chart,
    slips=SLIPS,
)
