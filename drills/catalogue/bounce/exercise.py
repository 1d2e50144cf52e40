"""A bouncing point: single steps with none, one, many or infinitely many impacts, then energy."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import (
    Exercise,
    Slip,
    coarse_slips,
    slips,
    value_slips,
    worked_answer,
)
from drills.grade_report import Shown
from drills.reasons import Reason

CLOSED_FORM = "the motion has a closed form; rounding of some dozens of flights stays below 1e-9"


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases that end in flight, on the floor, after one impact or after many."""
    bounce_step = worked_answer("bounce")

    def between(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def clear(label: str, *ranges: tuple[float, float], level: str = "core") -> Case:
        """Return a case whose end is not at the moment of an impact, where the velocity jumps."""
        while True:
            y, v, dt, e = (between(*r) for r in ranges[:4])
            gravity = between(*ranges[4]) if len(ranges) > 4 else 9.81
            ends = [bounce_step(y, v, dt * (1.0 + s), e, gravity)[1] for s in (-1e-6, 1e-6)]
            if abs(ends[1] - ends[0]) < 1e-3:
                return Case((y, v, dt, e, gravity), label, level)

    def late_hop(share: float) -> Case:
        """Return some way into all that is left after the first impact: it still bounces."""
        while True:
            y, e = between(0.3, 1.0), between(0.5, 0.8)
            impact = math.sqrt(2.0 * 9.81 * y)
            rest = 2.0 * e * impact / (9.81 * (1.0 - e))
            dt = impact / 9.81 + between(share - 0.04, share + 0.04) * rest
            ends = [bounce_step(y, 0.0, dt * (1.0 + s), e, 9.81)[1] for s in (-1e-6, 1e-6)]
            if abs(ends[1] - ends[0]) < 1e-3:
                return Case((y, 0.0, dt, e, 9.81), "near the end of its bounces")

    zero, usual = (0.0, 0.0), (0.3, 0.9)
    cases = [
        clear("falling", (1.0, 2.0), (-2.0, 0.0), (0.001, 0.1), usual, level="simple"),
        clear("rising", (0.0, 2.0), (1.0, 5.0), (0.001, 0.1), usual, level="simple"),
        clear("one impact", (0.01, 0.05), (-5.0, -3.0), (0.02, 0.05), usual),
        clear("one impact", (0.1, 1.0), (-3.0, 3.0), (0.6, 0.8), usual),
        clear("several impacts", (0.5, 2.0), (-5.0, 5.0), (1.5, 2.0), (0.6, 0.9)),
        clear("several impacts", (0.5, 2.0), (-5.0, 5.0), (1.5, 2.5), (0.6, 0.9)),
        clear("on the Moon", (0.1, 0.3), (-1.0, 1.0), (2.0, 3.0), (0.7, 0.9), (1.62, 1.63)),
        clear("many impacts", (0.2, 0.3), (-1.0, 1.0), (9.0, 10.0), (0.985, 0.99)),
        clear("elastic", (0.1, 1.0), (-3.0, 3.0), (2.0, 5.0), (1.0, 1.0)),
        clear("upwards from the floor", zero, (0.5, 2.0), (0.01, 0.05), usual, level="edge"),
        clear("upwards from the floor and back", zero, (0.5, 1.0), (0.25, 0.3), (0.8, 0.9)),
        *(late_hop(share) for share in (0.6, 0.8, 0.95)),
        clear("downwards at the floor", zero, (-2.0, -1.0), (0.01, 0.05), usual, level="edge"),
        clear("inelastic", (0.1, 0.5), (-1.0, 1.0), (0.6, 0.8), zero, level="edge"),
        clear("comes to rest", (0.05, 0.2), (-1.0, 1.0), (4.0, 6.0), (0.3, 0.5)),
        Case((0.0, 0.0, 0.01, 0.5, 9.81), "lies on the floor", "edge"),
        Case((0.0, 0.0, 1.0, 1.0, 9.81), "lies on an elastic floor", "edge"),
        Case((0.0, 1e-7, 0.01, between(*usual), 9.81), "hardly moves", "edge"),
        Case((2, -1, 1, 1, 10), WHOLE, "edge"),
        _small(between(1e-3, 4e-3), between(0.7, 0.9), between(1.2, 1.6)),
        *(_small(between(3e-7, 6e-7), e, between(1.1, 1.4)) for e in (between(0.7, 0.9), 1.0)),
    ]
    falling, bouncing = clear("falling", (1.0, 2.0), (-2.0, 0.0), (0.2, 0.3), usual), cases[3]
    cases += [Case(case.args[:4], "gravity left out", "edge") for case in (falling, bouncing)]
    return cases


def _rests(y: float, v: float, dt: float, e: float, gravity: float = 9.81, *share: float) -> bool:
    """Return whether infinitely many bounces, or a share of their time, end within the step."""
    impact = math.sqrt(v * v + 2.0 * gravity * y)
    rest = 2.0 * e * impact / (gravity * (1.0 - e)) if e < 1.0 else math.inf
    return impact == 0.0 or (v + impact) / gravity + math.prod(share) * rest <= dt


def _small(speed: float, restitution: float, flights: float) -> Case:
    """Return a ball that hops by a micrometre or less and is not at rest yet.

    It is some time into its second hop.
    """
    return Case((0.0, speed, flights * 2.0 * speed / 9.81, restitution, 9.81), "small hops", "edge")


def explain(answers: Sequence[Answer]) -> str:
    """Return what a flight, an impact or a rest is off by, where the values show it."""
    wrong = [a for a in answers if not all(a.right)]
    if wrong and all(a.case.label == "gravity left out" for a in wrong):
        return "default_gravity"
    if wrong and all(
        largest_error(a.parts[0], 0.0) == largest_error(a.parts[1], 0.0) == 0.0 for a in wrong
    ):
        halved = [_rests(*a.case.args[:4], *a.case.args[4:] or (9.81,), 0.5) for a in answers]
        still = [
            largest_error(a.parts[0], 0.0) == largest_error(a.parts[1], 0.0) == 0.0 for a in answers
        ]
        return "rest_time_halved" if halved == still else "rests_too_early"
    if wrong and all(
        _rests(*a.case.args) and largest_error(a.parts[0], -1) < largest_error(a.parts[0], 1)
        for a in wrong
    ):
        return "impacts_counted"
    if any(_start_speed(a) for a in wrong):
        return "start_speed_turned_round"
    for a in answers:
        y, v, dt, _, gravity = (*a.case.args, 9.81)[:5]
        risen = y + v * dt + 0.5 * gravity * dt * dt
        if a.case.label == "falling" and largest_error(a.parts[0], risen) <= 1e-9:
            return "gravity_upwards"
        _, _, dt, _, gravity = (*a.case.args, 9.81)[:5]
        if a.case.label == "falling" and not a.right[0]:
            drop = 0.5 * gravity * dt * dt
            if (
                min(
                    largest_error(a.parts[0], a.truth[0] + drop),
                    largest_error(a.parts[0], a.truth[0] - drop),
                )
                <= 1e-9
            ):
                return "euler_flight"
    return coarse(answers)


def _start_speed(a: Answer) -> bool:
    """Return whether the answer reverses the speed of the start instead of the impact's."""
    y, v, dt, e, gravity = (*a.case.args, 9.81)[:5]
    if a.case.label != "one impact" or v > -3.0:
        return False
    remaining, up = dt - (v + math.sqrt(v * v + 2.0 * gravity * y)) / gravity, -e * v
    ends = (
        (up * remaining - 0.5 * gravity * remaining * remaining, up - gravity * remaining),
        (0.0, up),
    )
    return any(max(map(largest_error, a.parts, end)) <= 1e-9 for end in ends)


def energy(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check the energy of an elastic ball after many steps."""
    start = float(attempt.rng.uniform(0.3, 1.0))
    y, v = start, 0.0
    for _ in range(80):
        parts = attempt.parts(attempt.call(y, v, 0.01, 1.0, 9.81), ("y", "v"))
        new = [attempt.numbers("a step of many", part, ()) for part in parts or ()]
        if not new or new[0] is None or new[1] is None:
            return
        y, v = float(new[0]), float(new[1])
        if y < -1e-9:
            attempt.require(
                "never below the floor",
                False,
                sentence=f"A step of a row of them ends at y = {y:.6g} m, below the floor.",
                error=-y,
                tolerance=1e-9,
                unit="m",
                why=CLOSED_FORM,
            )
            return
    retained = 0.5 * v * v + 9.81 * y
    ratio = retained / (9.81 * start)
    attempt.require(
        "energy of an elastic ball",
        abs(ratio - 1.0) <= 1e-9,
        sentence=f"80 steps of 10 ms with restitution 1 multiply the energy by {ratio:.6g}.",
        got=f"{ratio:.6g}",
        expected="1",
        error=abs(ratio - 1.0),
        tolerance=1e-9,
        unit="1",
        why="nothing is lost and nothing gained, in flight or at an impact",
    )


def dropped(attempt: Attempt) -> Plan:
    """Return the height of a ball 1.5 s after its drop, with five steps or with thousands."""
    from course.oracles.mujoco import box
    from course.rigid_body import problems

    time, e, g, size = 1.5, 0.7, 9.81, 0.1
    steps = {time / n: n for n in (15, 50, 150, 500, 1500, 5000)}
    start = (size, size), 1.0, (0.0, 1.0 + size, 0.0), (0.0, 0.0, 0.0)
    runners = {
        dt: box.box_drop(*start, dt, "Euler", restitution=e, friction=0.0, gravity=g)
        for dt in steps
    }

    def late(dt: float) -> tuple[list[float], float]:
        y, v = 1.0, 0.0
        for _ in range(steps[dt]):
            y, v = y + v * dt - 0.5 * g * dt * dt, v - g * dt
            if y < 0.0:
                y, v = 0.0, -e * v
        return [y], steps[dt]

    return Plan(
        settings=list(steps),
        ask=lambda place, dt: (place.given("drive", 1.0, dt, e, g, steps[dt]), steps[dt]),
        truth=[attempt.expected(1.0, 0.0, time, e, g)[0]],
        check=[problems.bounce_height(time, 1.0, e, g)],
        ours={"impact at the end of the step": late},
        libraries={
            "MuJoCo Euler, one-step contact": lambda dt: (
                runners[dt].run(steps[dt])[0][1:2] - size,
                steps[dt],
            )
        },
    )


def flight(figure: Any, shown: Shown) -> None:
    """Plot the height over the step; where it ends, and where the answer says so."""
    bounce_step = worked_answer("bounce")

    y, v, dt, e, gravity = (*shown.args, 9.81)[:5]
    axes = picture.plane(figure, "time [s]", "height [m]")
    times = np.linspace(0.0, dt, 600)
    heights = [y, *(bounce_step(y, v, float(t), e, gravity)[0] for t in times[1:])]
    axes.axhline(0.0, color="black", lw=1.0)
    axes.plot(times, heights, **picture.RIGHT)
    reach = 0.04 * dt
    for (height, speed), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(dt, height, "o", color=style["color"])
        ends = [float(height), float(height) + reach * float(speed)]
        axes.plot([dt, dt + reach], ends, **style | {"label": "_"})
    axes.plot([], [], **picture.YOURS)
    axes.legend()


_LOOP = """import math


def bounce_step(y, v, dt, restitution, gravity=9.81):
    for _ in range(2000):
        impact = math.sqrt(v * v + 2.0 * gravity * y)
        fall = (v + impact) / gravity
        if dt < fall:
            break
        y, v, dt = 0.0, {speed}, dt - fall
        {rest}
    return y + v * dt - 0.5 * gravity * dt * dt, v - gravity * dt
"""
_WITH = """

def bounce_step(y, v, dt, restitution, gravity=9.81):
    return exact({})
"""
_LAST = "    return max(up * left - 0.5 * gravity * left * left, 0.0), up - gravity * left\n"
_UPWARDS = """def bounce_step(y, v, dt, restitution, gravity=9.81):
    return y + v * dt + 0.5 * gravity * dt * dt, v + gravity * dt
"""
_PARABOLA = "y + v * dt - 0.5 * gravity * dt * dt"
_ENDLESS = """def bounce_step(y, v, dt, restitution, gravity=9.81):
    while True:
        impact = (v * v + 2.0 * gravity * y) ** 0.5
        fall = (v + impact) / gravity
        if dt < fall:
            return y + v * dt - 0.5 * gravity * dt * dt, v - gravity * dt
        y, v, dt = 0.0, restitution * impact, dt - fall
"""
_START_SPEED = """def bounce_step(y, v, dt, restitution, gravity=9.81):
    fall = (v + (v * v + 2.0 * gravity * y) ** 0.5) / gravity
    if dt > fall:
        y, v, dt = 0.0, -restitution * v, dt - fall
    return y + v * dt - 0.5 * gravity * dt * dt, v - gravity * dt
"""
_END = """def bounce_step(y, v, dt, restitution, gravity=9.81):
    y, v = {flight}, v - gravity * dt
    if y < 0.0:
        y, v = {floor}, {speed}
    return y, v
"""

SLIPS = slips(
    euler_flight=(
        _END.format(flight="y + (v - gravity * dt) * dt", floor="0.0", speed="-restitution * v"),
        "The flight itself is stepped with Euler's method and is off by g dt^2 / 2 in height. "
        "Gravity is constant, so the parabola is exact: y + v dt - g dt^2 / 2.",
    ),
    impact_at_the_end=(
        _END.format(flight=_PARABOLA, floor="0.0", speed="-restitution * v"),
        "The ball is found below the floor at the end of the step, put on it and turned round "
        "there. That moves the impact to the end of the step: a first-order error each time, and "
        "energy out of nothing (the ball was lifted by m g d).",
    ),
    restitution_on_the_position=(
        _END.format(flight=_PARABOLA, floor="-restitution * y", speed="-restitution * v"),
        "The height below the floor is mirrored and multiplied by the restitution. It is the "
        "speed at the impact that restitution multiplies, and gravity acts on the way up as on "
        "the way down.",
    ),
    whole_step_after_impact=(
        "left = dt - fall",
        "left = dt",
        "After the impact the ball flies for the whole dt again. What is left is dt less the time "
        "of the fall.",
    ),
    first_root=(
        "fall = (v + impact) / gravity",
        "fall = (v - impact) / gravity",
        "The impact is taken at the earlier root of the parabola, which lies in the past: the ball "
        "is on the floor at t = (v + sqrt(v^2 + 2 g y)) / g.",
    ),
    only_one_impact=(
        "    if elapsed * (1.0 - restitution) >= up:\n",
        "    return up * left - 0.5 * gravity * left * left, up - gravity * left\n"
        "    if elapsed * (1.0 - restitution) >= up:\n",
        "Only the first impact of the step is resolved. A long step, or a ball near rest, has "
        "more of them: your ball flies on through the floor.",
    ),
    rest_of_the_step_lost=(
        "    if elapsed * (1.0 - restitution) >= up:\n",
        "    return 0.0, up\n    if elapsed * (1.0 - restitution) >= up:\n",
        "After the impact the ball waits on the floor for the end of the step. What is left of "
        "dt must be flown too.",
    ),
    gravity_upwards=(
        _UPWARDS,
        "Gravity pulls upwards here: with the velocity counted upwards the height is "
        "y + v dt - g dt^2 / 2 and the velocity v - g dt.",
    ),
    default_gravity=(
        "gravity: float = 9.81",
        "gravity: float = 9.8",
        "It is right where gravity is handed in. Its default is 9.81 m/s^2, as the task says.",
    ),
    restitution_squared=(
        "def bounce_step(",
        "def exact(",
        _LAST,
        _LAST + _WITH.format("y, v, dt, restitution**2, gravity"),
        "The speed is multiplied by the square of the restitution. That is what the energy is "
        "multiplied by; the speed only once.",
    ),
    not_turned_round=(
        "    elapsed = left * gravity / 2.0\n",
        "    return -up * left - 0.5 * gravity * left * left, -up - gravity * left\n",
        "The ball goes on downwards after the impact, through the floor: the velocity changes its "
        "sign there.",
    ),
    restitution_of_energy=(
        "def bounce_step(",
        "def exact(",
        _LAST,
        _LAST + _WITH.format("y, v, dt, math.sqrt(restitution), gravity"),
        "The energy is multiplied by the restitution, so the speed by its square root. "
        "Restitution is the ratio of the speeds; the energy keeps its square.",
    ),
    restitution_once=(
        _LOOP.format(
            speed="impact if y == 0.0 and v > 0.0 else restitution * impact",
            rest="if v <= 0.0:\n            return 0.0, 0.0",
        ),
        "Every flight after the first impact is as high as the one before: the restitution acts "
        "at each impact, not only at the first.",
    ),
    start_velocity_ignored=(
        "impact = math.sqrt(v * v + 2.0 * gravity * y)",
        "impact = math.sqrt(2.0 * gravity * y)",
        "The speed of the impact is sqrt(2 g y), as if the ball had been dropped from rest. Its "
        "velocity at the start belongs to it: sqrt(v^2 + 2 g y).",
    ),
    start_speed_turned_round=(
        _START_SPEED,
        "The speed that is turned round is the one from the start of the step. Until the impact "
        "gravity adds to it: there it is sqrt(v^2 + 2 g y).",
    ),
    energy_gained=(
        "up = restitution * impact",
        "up = restitution * (gravity * dt - v)",
        "The ball is turned round with more speed than the impact had: the speed at the *end* of "
        "the step, gained below the floor, is used in a flight from the impact on.",
    ),
    rest_time_halved=(
        "    if elapsed * (1.0 - restitution) >= up:\n",
        "    if 2.0 * elapsed * (1.0 - restitution) >= up:\n",
        "The ball is put to rest after u / (g (1 - e)). A flight with speed u lasts 2 u / g, up "
        "and down, so all that are left last 2 u / (g (1 - e)): twice as long.",
    ),
    impacts_counted=(
        _LOOP.format(speed="restitution * impact", rest="").replace("2000", "100"),
        "The loop ends after a fixed number of impacts, and the ball falls on through the floor. "
        "One that comes to rest has infinitely many of them, in the time 2 u / (g (1 - e)): test "
        "for it.",
    ),
    rests_too_early=(
        _LOOP.format(speed="restitution * impact", rest="if v < 0.8:\n            return 0.0, 0.0"),
        "The ball is put to rest although it still bounces: a threshold on its speed cuts off "
        "bounces that are due. How long they last is a finite sum: 2 u / (g (1 - e)).",
    ),
)

ENDLESS = Slip(
    "endless_bounces",
    "It did not come to an end. A loop over the impacts never does for a ball that comes to rest: "
    "its bounces are infinitely many, each shorter than the one before, in the finite time "
    "2 u / (g (1 - e)). Beyond it, the ball lies still.",
    source=_ENDLESS,
    ends=Reason.TIMED_OUT,
    cause=lambda args: _rests(*args),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-9,
        CLOSED_FORM,
        names=("height", "velocity"),
        explain=explain,
        last=energy,
        then=("core", "a row of steps"),
    ),
    given=Path(__file__).with_name("given.py").read_text(encoding="utf-8"),
    examples=(
        "bounce_step(1.0, 0.0, 0.2, 0.5)",
        "bounce_step(1.0, 0.0, 0.6, 0.5)",
        "bounce_step(1.0, 0.0, 2.0, 0.5)",
        "bounce_step(0.0, 0.0, 0.01, 0.5)",
    ),
    picture=flight,
    chart=chart_of(
        "Height of a bouncing ball after 1.5 s",
        dropped,
        unit="steps",
        tolerance=1e-3,
        error_unit="m",
        failed_above=5.0,
    ),
    slips=(
        *SLIPS,
        ENDLESS,
        *coarse_slips("bounce_step", "A ball near rest is then at rest."),
        *value_slips("bounce_step", swapped=True),
    ),
)
