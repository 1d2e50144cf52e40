"""What the derivative of a bounce costs, and how wrong it is: our event times, and MuJoCo."""

import functools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import kit as mujoco_kit
from course.rigid_body.differentiable import (
    Setup,
    drop_gradients,
    naive_drop_gradients,
    trajectory,
)
from course.rigid_body.integrators import STANDARD_GRAVITY

RESTITUTION, DURATION = 0.6, 0.8  # [-], [s]
# Of MuJoCo's soft contact: half a period without damping [s], and the depth over which it sets in
# [m]. A shorter contact or a shallower onset makes the derivative worse, a softer one the bounce.
_CONTACT_TIME, _ONSET = 0.02, 0.05
Gradient = Callable[[float], float]
"""Drop height [m] -> derivative of the height at the end with respect to it [-]."""


def exact_gradient(height: float) -> float:
    """Return the derivative of the height after one bounce, in closed form.

    It is -e at the impact and grows by (1 + e) g / v per second, with v the speed of the impact.
    """
    v = math.sqrt(2.0 * STANDARD_GRAVITY * height)
    since = DURATION - v / STANDARD_GRAVITY
    return -RESTITUTION + (1.0 + RESTITUTION) * STANDARD_GRAVITY / v * since


def event_differences(height: float, h: float = 1e-5) -> float:
    """Return a central difference of two runs from event to event, on plain numbers."""
    high, low = (
        trajectory((RESTITUTION, 0.0, 1.0), Setup(position=(0.0, z)), [DURATION])[1, 0]
        for z in (height + h, height - h)
    )
    return float(high - low) / (2.0 * h)


def mujoco_chain(runner: mujoco_kit.Runner, height: float) -> float:
    """Return the product of MuJoCo's derivatives of every step (mjd_transitionFD, centred)."""
    runner.q0[0] = height
    return float(runner.sensitivity(round(DURATION / runner.dt), (1.0, 0.0))[0])


def mujoco_differences(runner: mujoco_kit.Runner, h: float, height: float) -> float:
    """Return a central difference of two whole runs of MuJoCo, each one compiled call."""
    ends = []
    for z in (height + h, height - h):
        runner.q0[0] = z
        ends.append(float(runner.run(round(DURATION / runner.dt))[0][0]))
    return (ends[0] - ends[1]) / (2.0 * h)


def error(gradient: Gradient, heights: Sequence[float]) -> float:
    """Return the root mean square error over drop heights, at least 1e-17.

    Where in a step the ball lands depends on its height, so one height could be right by luck.
    """
    wrong = [gradient(height) - exact_gradient(height) for height in heights]
    return max(float(np.sqrt(np.mean(np.square(wrong)))), 1e-17)


@chart
def gradient_precision(
    steps: Sequence[float] = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4),
    differences: Sequence[float] = (1e-3, 1e-2, 2e-2, 3e-2, 5e-2, 0.1),
    starts: int = 16,
    repeats: int = 15,
) -> Iterator[Panel]:
    """Chart error and cost of d(height at 0.8 s) / d(drop height) of a ball that bounces once.

    MuJoCo's runs take the best of several differences, at every step the one with the least error.

    Args:
        steps: of the programs with a fixed step [s].
        differences: half the distance of two drop heights that MuJoCo's runs try [m].
        starts: drop heights from 1 m to 1.05 m over which the error is averaged.
        repeats: rounds of the timer.
    """
    heights = [1.0 + 0.05 * (k + 0.5) / starts for k in range(starts)]
    speed = math.sqrt(2.0 * STANDARD_GRAVITY * 1.025)
    soft = mujoco_box.soft_reference(RESTITUTION, speed, _CONTACT_TIME, _ONSET)

    def ball(dt: float, contact: str) -> mujoco_kit.Runner:
        # "impulse": one step turns v into -e v exactly, MuJoCo's best bounce.
        reference = (0.0, (1.0 + RESTITUTION) / dt) if contact == "impulse" else soft
        onset = 0.0 if contact == "impulse" else _ONSET
        return mujoco_box.ball_drop(1.0, dt, reference, onset=onset, gravity=STANDARD_GRAVITY)

    def best_differences(dt: float) -> Gradient:
        runner = ball(dt, "impulse")
        tried = [functools.partial(mujoco_differences, runner, h) for h in differences]
        return min(tried, key=lambda gradient: error(gradient, heights))

    def end_of_step(dt: float) -> Gradient:
        return lambda z: naive_drop_gradients(z, RESTITUTION, dt, DURATION).by_height

    methods: dict[str, tuple[str, list[Gradient]]] = {
        "course, impact times, autograd": (
            "event in the step",
            [lambda z: drop_gradients(z, RESTITUTION, DURATION).by_height],
        ),
        "course, impact times, two runs": ("course", [event_differences]),
        "course, end of step, autograd": (
            "semi-implicit, end of step",
            [end_of_step(dt) for dt in steps if dt >= 1e-3],
        ),
        "MuJoCo, impulse, two runs": ("MuJoCo Euler", [best_differences(dt) for dt in steps]),
        "MuJoCo, impulse, step derivatives": (
            "MuJoCo implicitfast",
            [functools.partial(mujoco_chain, ball(dt, "impulse")) for dt in steps],
        ),
        "MuJoCo, soft, step derivatives": (
            "MuJoCo Euler (spring)",
            [functools.partial(mujoco_chain, ball(dt, "soft")) for dt in steps],
        ),
    }
    every = [gradient for _, several in methods.values() for gradient in several]
    timed = iter(interleaved([calls(g, heights[0]) for g in every], repeats=repeats, sample=5e-3))
    rows = {
        name: [(next(timed), error(g, heights)) for g in several]
        for name, (_, several) in methods.items()
    }
    panel = Panel(
        "The derivative of a bounce: impact times make it exact",
        "time of one derivative [s]",
        "rms error of the derivative (it is 0.6)",
        scale="log",
        footer=machine(max(t.busy for row in rows.values() for t, _ in row)),
    )
    for name, (key, several) in methods.items():
        times, errors = zip(*rows[name], strict=True)
        oracle = name.startswith("MuJoCo")
        panel.series.append(
            Series(
                name,
                [t.median for t in times],
                errors,
                key,
                ("--" if oracle else "-") if len(several) > 1 else "",
                low=[t.low for t in times],
                high=[t.high for t in times],
                across=True,
                hollow=oracle,
                note=f"{name:<34} error {errors[0]:.1e}"
                + (
                    f" at {1e3 * steps[0]:g} ms, {errors[-1]:.1e} at "
                    f"{1e3 * steps[len(several) - 1]:g} ms"
                    if len(several) > 1
                    else ""
                ),
            )
        )
    yield panel
