"""The limit of a sampled loop: gain and period, compared with the eigenvalues of its matrix."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return joints with friction from almost none to almost nothing else."""

    def joint(late: float, label: str, level: str = "core", *, friction: float = 0.0) -> Case:
        """Return a delay in samples, and damping dt / inertia, drawn when it is 0."""
        dt = float(rng.choice([1e-3, 2e-3, 5e-3, 1e-2]))
        inertia = float(rng.uniform(0.05, 3.0))
        share = friction or 10.0 ** rng.uniform(-2.5, -0.7)
        return Case((inertia, share * inertia / dt, dt, late * dt), label, level)

    return [
        joint(0.0, "no delay", "simple"),
        joint(1.0, "a delay of one sample", "simple"),
        joint(3.0, "a delay of three samples", "simple"),
        *(joint(late, "a part of a sample") for late in rng.uniform(0.15, 0.85, 3)),
        *(joint(late, "samples and a part") for late in rng.uniform(1.1, 1.9, 2)),
        *(joint(late + rng.uniform(0.2, 0.8), "a long delay") for late in (4, 9)),
        joint(2.0, "a delay of two samples"),
        joint(0.5, "hardly any friction", "edge", friction=2e-3),
        joint(0.0, "almost friction alone, no delay", "edge", friction=rng.uniform(4.0, 8.0)),
        joint(0.4, "almost friction alone", "edge", friction=rng.uniform(2.0, 5.0)),
        joint(rng.uniform(18.0, 20.0), "twenty samples", "edge"),
        joint(1e-9, "a delay of nearly nothing", "edge"),
        Case((2, 1, 1, 3), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Any, ...]) -> list[float]:
    """Return 1e-8 of each value."""
    return [1e-8 * float(value) for value in truth]


def swings(figure: Any, shown: Shown) -> None:
    """Plot the joint under the gain that came back, and under the right one."""
    axes = picture.plane(figure, "time [s]", "angle at the samples")
    inertia, damping, dt, delay = shown.args
    parts = 20
    h, period = dt / parts, float(shown.expected[1])
    late, count = round(delay / h), int(min(6.0 * period / dt, 400.0)) + 2
    for (gain, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        commands, q, v, path = np.zeros(late + count * parts + parts), 1.0, 0.0, []
        lost = -math.expm1(-damping / inertia * h)
        for i in range(count * parts):
            if i % parts == 0:
                path.append(q)
                commands[i + late : i + late + parts] = -gain * q
            steady = commands[i] / damping
            q, v = q + steady * h + (v - steady) * lost * inertia / damping, v + (steady - v) * lost
        axes.plot(dt * np.arange(count), np.clip(path, -5.0, 5.0), marker="o", ms=2, **style)
    axes.legend()


_RULE = """import math


def ultimate_gain(inertia, damping, dt, delay):
    late, rate = {late}, damping / inertia
    if late == 0.0:
        return math.inf, 0.0
    low, high = 0.0, 0.5 * math.pi / late
    for _ in range(100):
        w = 0.5 * (low + high)
        low, high = (w, high) if w * math.tan(w * late) < rate else (low, w)
    return w * math.hypot(inertia * w, damping), 2.0 * math.pi / w
"""
_SPLIT = "    whole = int(delay // dt)\n    rest = delay - whole * dt\n"
_RETURN = "return high, 2.0 * math.pi * dt / abs(float(np.angle(swinging)))"

SLIPS = slips(
    hold_forgotten=(
        _RULE.format(late="delay"),
        "The hold is missing: a torque that is held for a sample is half a sample late on "
        "average, even without any other delay. Your limit is too high, and infinite without "
        "delay.",
    ),
    whole_sample_for_half=(
        _RULE.format(late="delay + dt"),
        "The hold is counted as a whole sample of delay. On average it is half of one: a command "
        "is new at the start of its sample and dt old at the end.",
    ),
    half_sample_rule=(
        _RULE.format(late="delay + 0.5 * dt"),
        "This is the rule that counts the hold as half a sample of delay. It is accurate to "
        "three digits where friction and sample time are small, and far off elsewhere. Solve "
        "the motion from sample to sample instead, and use the matrix.",
    ),
    delay_forgotten=(
        _SPLIT,
        "    whole, rest = 0, 0.0\n",
        "The delay has no effect: this is the limit of the hold alone.",
    ),
    part_of_a_sample_dropped=(
        _SPLIT,
        "    whole, rest = int(delay / dt + 1e-6), 0.0\n",
        "Only whole samples of the delay are counted. The rest of a sample matters too: for "
        "that time the older torque still acts.",
    ),
    delay_rounded=(
        _SPLIT,
        "    whole, rest = round(delay / dt), 0.0\n",
        "The delay is rounded to whole samples. But within a sample the torque changes once, "
        "after the rest of the delay.",
    ),
    delay_rounded_up=(
        _SPLIT,
        "    whole, rest = math.ceil(delay / dt - 1e-6), 0.0\n",
        "The delay is rounded up to whole samples. But within a sample the torque changes "
        "once, after the rest of the delay.",
    ),
    parts_swapped=(
        "first, late = driven(rest)",
        "first, late = driven(dt - rest)",
        "second, now = driven(dt - rest)",
        "second, now = driven(rest)",
        "The two torques within a sample act for each other's time. The older one acts "
        "first, for the rest of the delay, then the newer one.",
    ),
    one_sample_more=(
        "whole = int(delay // dt)",
        "whole = int(delay // dt) + 1",
        "rest = delay - whole * dt",
        "rest = delay - (whole - 1) * dt",
        "There is one sample of delay too many, as if the command were computed from the "
        "previous measurement. It is computed from the measurement of this sample.",
    ),
    euler_between_samples=(
        "np.array([[1.0, lost / rate], [0.0, 1.0 - lost]])",
        "np.array([[1.0, t], [0.0, 1.0 - rate * t]])",
        "np.array([t - lost / rate, lost]) / damping",
        "np.array([0.0, t / inertia])",
        "Between samples the joint moves by an Euler step. The task asks for the exact "
        "solution of its equation, with exponentials.",
    ),
    torque_moves_only_the_rate=(
        "np.array([t - lost / rate, lost]) / damping",
        "np.array([0.0, lost]) / damping",
        "In your matrix a held torque changes only the rate. Within the same sample it also "
        "moves the angle.",
    ),
    frequency_for_period=(
        _RETURN,
        "return high, abs(float(np.angle(swinging))) / dt",
        "The second value is the frequency in rad/s. The period is 2 pi over it.",
    ),
    hertz=(
        _RETURN,
        "return high, abs(float(np.angle(swinging))) / (2.0 * math.pi * dt)",
        "The second value is the frequency in hertz. The period is one over it.",
    ),
    half_a_period=(
        _RETURN,
        "return high, math.pi * dt / abs(float(np.angle(swinging)))",
        "This is half of the period, from one side to the other.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases, allowed, "eigenvalues of the loop's matrix give both to 1e-10", explain=coarse
    ),
    examples=(
        "ultimate_gain(1.0, 2.0, 0.01, 0.0)",
        "ultimate_gain(1.0, 2.0, 0.01, 0.02)",
        "ultimate_gain(0.1, 0.5, 0.001, 0.0025)",
    ),
    picture=swings,
    slips=SLIPS
    + coarse_slips("ultimate_gain", "A gain at the limit then grows or doesn't, by luck.")
    + value_slips("ultimate_gain", swapped=True),
)
