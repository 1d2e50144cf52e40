"""Back of the envelope: what an interviewer expects to be worked out before anything is drawn.

Each is a plain function with the unit of every number in its name; `ESTIMATES`, from
`estimates.toml`, holds cases that an answer quotes as `{estimate.NAME:.3g}`, and their inputs as
`{estimate.NAME.INPUT}`.

    from course.interview.estimates import ESTIMATES
    print(ESTIMATES["night_workers"])                       # inputs, result and unit
    ESTIMATES["night_workers"].value(scenario_s=120.0)      # with another input

The mechanics here is a free body, a straight line and a constant brake. Limits of standards stay
out: they depend on edition, clause and part of the body.
"""

import itertools
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.check import count, finite, invalid, one_of, positive, vector

GRAVITY_M_PER_S2 = 9.81


def readings_per_s(
    robots: int, sensors_each: int, readings_each: float, hertz: float, times_real_time: float = 1.0
) -> float:
    """Return the readings to process each second for a fleet.

    They are rays of scanners, or frames with one each.
    """
    sensors = count("robots", robots, 1) * count("sensors_each", sensors_each, 1)
    each = positive("readings_each", readings_each) * positive("hertz", hertz)
    return sensors * each * positive("times_real_time", times_real_time)


def workers(
    scenarios: int,
    scenario_s: float,
    start_s: float,
    times_real_time: float,
    night_h: float,
    repeats: int = 1,
) -> int:
    """Return how many workers get through all scenarios in a night; one run is not divided.

    Args:
        scenarios: number of scenarios.
        scenario_s: simulated length of one run [s].
        start_s: real time to start one run [s].
        times_real_time: simulated over real time of one worker.
        night_h: length of the night [h].
        repeats: runs of each scenario.
    """
    runs = count("scenarios", scenarios, 1) * count("repeats", repeats, 1)
    faster = positive("times_real_time", times_real_time)
    each = positive("scenario_s", scenario_s) / faster + finite("start_s", start_s, 0.0)
    # The small factor keeps a whole number of runs from being rounded down by one.
    turns = math.floor(3600.0 * positive("night_h", night_h) / each * (1.0 + 2e-12))
    if turns < 1:
        raise invalid(
            "night_h", night_h, f"{each / 3600.0:.3g} or more, as one scenario takes that long [h]"
        )
    return math.ceil(runs / turns)


def half_width(share: float, trials: int) -> float:
    """Return half the width of Wilson's 95 % interval for this share of successful trials."""
    from course.measure.success import wilson

    trials = count("trials", trials, 1)
    low, high = wilson(finite("share", share, 0.0, 1.0) * trials, trials)
    return 0.5 * float(high - low)


def trials_for_width(share: float, half: float) -> int:
    """Return the least number of trials whose Wilson 95 % interval is no wider than +- `half`."""
    finite("half", half, 0.01, 0.5)
    return next(n for n in itertools.count(1) if half_width(share, n) <= half)


def trials_each(
    first_share: float, second_share: float, power: float = 0.8, together: float | None = None
) -> int:
    """Return trials of each of two policies that tell their shares apart, two-sided at 5 %.

    On the same scenes, `together` is the share of them that both solve.
    """
    from course.measure.success import trials

    return trials(first_share, second_share, power=power, together=together)


def trials_for_gate(gate_share: float, true_share: float, power: float = 0.8) -> int:
    """Return trials of one policy that show it to be above a gate, one-sided at 5 %.

    The normal approximation (Fleiss, Levin and Paik, Statistical Methods for Rates and Proportions,
    2003).
    """
    from statistics import NormalDist

    gate, true = finite("gate_share", gate_share, 0.0, 1.0), finite("true_share", true_share, 0, 1)
    if true <= gate:
        raise invalid("true_share", true, f"a share above the gate, {gate}")
    a, b = (NormalDist().inv_cdf(q) for q in (0.95, finite("power", power, 0.5, 1 - 1e-9)))
    # Normal approximation of the binomial: spread under the gate for size, under the truth for
    # power.
    root = a * math.sqrt(gate * (1.0 - gate)) + b * math.sqrt(true * (1.0 - true))
    return max(1, math.ceil((root / (true - gate)) ** 2))


def motion_s(legs_m: ArrayLike, top_m_per_s: float, rise_m_per_s2: float) -> float:
    """Return the time of straight legs, each from rest to rest by a trapezoid of speed."""
    from course.planning.trajectory import trapezoid

    top, rise = positive("top_m_per_s", top_m_per_s), positive("rise_m_per_s2", rise_m_per_s2)
    return float(np.sum(trapezoid(vector("legs_m", legs_m, (None,), low=0.0), top, rise)[0]))


def cycle_s(
    legs_m: ArrayLike, top_m_per_s: float, rise_m_per_s2: float, still_s: float, computing_s: float
) -> float:
    """Return the time of one pick: its legs, standing still, and computing while the arm waits."""
    waits = finite("still_s", still_s, 0.0) + finite("computing_s", computing_s, 0.0)
    return motion_s(legs_m, top_m_per_s, rise_m_per_s2) + waits


def leg_s(distance_m: float, top_m_per_s: float, rise_m_per_s2: float) -> float:
    """Return the time of one straight leg from rest to rest."""
    return motion_s([distance_m], top_m_per_s, rise_m_per_s2)


def part_s(success: float, **cycle: Any) -> float:
    """Return the mean time for one placed part if a miss costs a cycle, that of `cycle_s`."""
    return cycle_s(**cycle) / positive("success", success)


def computing_share(computing_s: float, **others: Any) -> float:
    """Return the share of `cycle_s`, with the same arguments, saved if computing takes no time."""
    return computing_s / positive("cycle_s", cycle_s(computing_s=computing_s, **others))


def error_mm(spreads_mm: ArrayLike, biases_mm: ArrayLike, spreads_counted: float = 2.0) -> float:
    """Return the error to one side along an axis.

    Biases add up linearly, independent standard deviations in squares.

    With two of them counted 2.3 % of all errors are larger on that side.
    """
    root = float(np.linalg.norm(vector("spreads_mm", spreads_mm, (None,), low=0.0)))
    bias = abs(float(np.sum(vector("biases_mm", biases_mm, (None,)))))
    return bias + positive("spreads_counted", spreads_counted) * root


def finger_error_mm(
    range_m: float,
    pixel_spread_px: float,
    focal_px: float,
    hand_eye_spread_mrad: float,
    arm_spread_mm: float,
    speed_m_per_s: float,
    delay_ms: float,
) -> float:
    """Return the error at the finger, across the camera's line of sight [mm].

    The result adds two standard deviations of the random errors to the bias that the age of the
    picture causes.

    A pixel is range / focal length wide, a milliradian of the hand-eye rotation as many millimetres
    as the range has metres, and what moves has gone on for the age of its picture.
    """
    range_m = positive("range_m", range_m)
    pixel = 1e3 * range_m * pixel_spread_px / positive("focal_px", focal_px)
    spreads = (pixel, range_m * hand_eye_spread_mrad, arm_spread_mm)
    return error_mm(spreads, (tracking_error_mm(speed_m_per_s, delay_ms),))


def grip_force_n(
    mass_kg: float,
    friction: float,
    rise_m_per_s2: float = 0.0,
    safety: float = 2.0,
    fingers: int = 2,
) -> float:
    """Return the force of each finger on a load that is lifted and carried by friction alone.

    Upwards is the worst direction of the acceleration. The fingers press across it.
    """
    # The load presses down with its weight and its acceleration; each finger carries mu N.
    felt = GRAVITY_M_PER_S2 + finite("rise_m_per_s2", rise_m_per_s2, 0.0)
    held = count("fingers", fingers, 1) * positive("friction", friction)
    return finite("safety", safety, 1.0) * positive("mass_kg", mass_kg) * felt / held


def samples_h(samples: float, samples_per_s: float) -> float:
    """Return the hours that it takes to collect `samples` samples."""
    return finite("samples", samples, 0.0) / positive("samples_per_s", samples_per_s) / 3600.0


def tracking_error_mm(speed_m_per_s: float, delay_ms: float) -> float:
    """Return how far a measurement lags behind a target that moves at constant speed [mm].

    Metres a second by milliseconds is millimetres.
    """
    return finite("speed_m_per_s", speed_m_per_s) * finite("delay_ms", delay_ms, 0.0)


def sine_error_mm(amplitude_mm: float, frequency_hz: float, delay_ms: float) -> float:
    """Return the largest difference of a sine and its late copy: 2 A |sin(pi f delay)|."""
    turn = math.pi * positive("frequency_hz", frequency_hz) * finite("delay_ms", delay_ms, 0) / 1e3
    return 2.0 * finite("amplitude_mm", amplitude_mm, 0.0) * abs(math.sin(turn))


def stopping_m(speed_m_per_s: float, reaction_s: float, braking_m_per_s2: float) -> float:
    """Return the way to a stand: on at full speed while nothing has reacted, then an even brake."""
    speed = finite("speed_m_per_s", speed_m_per_s, 0.0)
    braking = 0.5 * speed**2 / positive("braking_m_per_s2", braking_m_per_s2)
    return speed * finite("reaction_s", reaction_s, 0.0) + braking


def separation_m(
    person_m_per_s: float,
    robot_m_per_s: float,
    reaction_s: float,
    braking_m_per_s2: float,
    uncertain_m: float,
) -> float:
    """Return the gap at which a robot must begin to stop while a person walks on towards it."""
    robot = stopping_m(robot_m_per_s, reaction_s, braking_m_per_s2)
    # The person walks on until the robot stands (ISO/TS 15066, speed and separation).
    stop_s = reaction_s + robot_m_per_s / braking_m_per_s2
    person = finite("person_m_per_s", person_m_per_s, 0.0) * stop_s
    return person + robot + finite("uncertain_m", uncertain_m, 0.0)


def contact_force_n(
    speed_m_per_s: float, stiffness_n_per_m: float, robot_kg: float, body_kg: float = math.inf
) -> float:
    """Return the peak force of two masses that meet through a spring.

    It is V sqrt(k m), with m their reduced mass.

    The speed is the closing speed: that of the robot plus that of a person who walks towards it.
    The robot's mass is its effective mass at the contact; the body's is infinite where it is
    clamped.
    """
    if not body_kg > 0.0:
        raise invalid("body_kg", body_kg, "a positive number, or infinite")
    # Two bodies on a spring move like one reduced mass; all its energy goes into the spring.
    reduced = 1.0 / (1.0 / positive("robot_kg", robot_kg) + 1.0 / body_kg)
    stiffness = positive("stiffness_n_per_m", stiffness_n_per_m)
    return finite("speed_m_per_s", speed_m_per_s, 0.0) * math.sqrt(stiffness * reduced)


def wilson_low(solved: int, trials: int) -> float:
    """Return the lower end of Wilson's two-sided 95 % interval after `solved` successes."""
    from course.measure.success import wilson

    return float(wilson(count("solved", solved, 0), count("trials", trials, 1))[0])


def wilson_high(solved: int, trials: int) -> float:
    """Return the upper end of Wilson's two-sided 95 % interval after `solved` successes."""
    from course.measure.success import wilson

    return float(wilson(count("solved", solved, 0), count("trials", trials, 1))[1])


def chance_at_gate(gate_share: float, solved: int, trials: int) -> float:
    """Return the exact probability of at least `solved` successes for a policy at the gate."""
    from scipy.stats import binom

    gate = finite("gate_share", gate_share, 0.0, 1.0)
    return float(binom.sf(count("solved", solved, 0) - 1, count("trials", trials, 1), gate))


def bar_for_gate(gate_share: float, trials: int) -> int:
    """Return the least successes that a policy at the gate reaches in at most 5 % of tests."""
    from scipy.stats import binom

    gate = finite("gate_share", gate_share, 0.0, 1.0)
    return int(binom.isf(0.05, count("trials", trials, 1), gate)) + 1


def gate_power(gate_share: float, true_share: float, trials: int) -> float:
    """Return the exact probability that a policy passes the one-sided 5 % test of a gate."""
    return chance_at_gate(true_share, bar_for_gate(gate_share, trials), trials)


def objects_for_gate(
    gate_share: float, true_share: float, trials_each: int, likeness: float
) -> int:
    """Return objects to test, with several trials each, that show a policy to be above a gate.

    Trials of one object resemble each other, so they count less than trials of new objects
    (design effect of a cluster sample: L. Kish, Survey Sampling, 1965).

    Args:
        gate_share: success rate to exceed, one-sided at 5 %.
        true_share: assumed success rate, shown with a power of 80 %.
        trials_each: trials of each object.
        likeness: correlation of two trials of the same object, 0 to 1.
    """
    each = count("trials_each", trials_each, 1)
    counted = 1.0 + (each - 1) * finite("likeness", likeness, 0.0, 1.0)
    return math.ceil(trials_for_gate(gate_share, true_share) * counted / each - 1e-9)


def pairs_not_worse(margin: float, disagree: float, power: float = 0.8) -> int:
    """Return paired runs that show a new version to be at most `margin` worse, one-sided at 5 %.

    Non-inferiority, with the normal approximation. The power holds for two versions that are
    equally good.

    Args:
        margin: loss of the success rate that is still accepted.
        disagree: share of the pairs in which only one of the two versions succeeds.
        power: probability that two equal versions pass.
    """
    from statistics import NormalDist

    quantiles = sum(NormalDist().inv_cdf(q) for q in (0.95, finite("power", power, 0.5, 1 - 1e-9)))
    spread = math.sqrt(finite("disagree", disagree, 0.0, 1.0))
    return max(1, math.ceil((quantiles * spread / positive("margin", margin)) ** 2))


def faultless_trials(failing_share: float) -> int:
    """Return trials without a failure that show fewer to fail than this, one-sided at 5 %."""
    share = finite("failing_share", failing_share, 1e-9, 1.0 - 1e-9)
    return math.ceil(math.log(0.05) / math.log(1.0 - share))


def times_more(powers: float) -> float:
    """Return ten to the power `powers`."""
    return 10.0 ** finite("powers", powers)


def most_unseen(trials: int) -> float:
    """Return the largest share that may still fail after no failure, one-sided at 5 %."""
    return 1.0 - 0.05 ** (1.0 / count("trials", trials, 1))


def faultless_h(desired_h: float) -> float:
    """Return hours without an event that show a mean time between events, one-sided at 5 %.

    Events come at a constant rate and independently, so none in T has the chance exp(-T / mean).
    """
    return -math.log(0.05) * positive("desired_h", desired_h)


def mean_time_h(run_h: float, chance: float) -> float:
    """Return the mean time between events with which a run has none with this chance."""
    return positive("run_h", run_h) / -math.log(finite("chance", chance, 1e-9, 1.0 - 1e-9))


def detectable(share: float, trials: int, power: float = 0.8) -> float:
    """Return by how much a share must differ from a known one to be noticed, two-sided at 5 %."""
    from statistics import NormalDist

    p = finite("share", share, 0.0, 1.0)
    quantiles = sum(NormalDist().inv_cdf(q) for q in (0.975, finite("power", power, 0.5, 0.999)))
    return quantiles * math.sqrt(p * (1.0 - p) / count("trials", trials, 1))


def success_needed(allowed_s: float, **cycle: Any) -> float:
    """Return the share of picks that must succeed for one part in `allowed_s`.

    A miss costs a whole cycle; the other arguments are those of `cycle_s`.
    """
    return cycle_s(**cycle) / positive("allowed_s", allowed_s)


def picks_to_call(success: float, in_row: int) -> float:
    """Return the mean number of independent picks until `in_row` misses come in a row."""
    miss = 1.0 - finite("success", success, 1e-9, 1.0 - 1e-9)
    runs = miss ** count("in_row", in_row, 1)
    return (1.0 - runs) / ((1.0 - miss) * runs)


def machines(
    samples: float,
    samples_per_s: float,
    slower_powers: float,
    scene_times: float,
    runs: int,
    hours: float,
) -> int:
    """Return the number of machines for `runs` trainings within `hours`.

    Args:
        samples: of one training.
        samples_per_s: measured rate of one machine, without contacts.
        slower_powers: powers of ten that contacts cost.
        scene_times: further factor by which the scene is slower.
        runs: trainings in all.
        hours: hours that each machine computes.
    """
    slower = 10.0**slower_powers * positive("scene_times", scene_times)
    each = samples_h(samples, positive("samples_per_s", samples_per_s) / slower)
    return math.ceil(count("runs", runs, 1) * each / positive("hours", hours))


def cores(robots: int, cores_each: float, times_real_time: float, workers: int = 1) -> float:
    """Return the processor cores that the robots' own software takes at this speed."""
    each = positive("cores_each", cores_each) * positive("times_real_time", times_real_time)
    return count("robots", robots, 1) * each * count("workers", workers, 1)


def reaction_s(
    scans: int, scanner_hz: float, output_ms: float, controller_ms: float, drive_ms: float
) -> float:
    """Return the worst time from entering a scanner's field until the brake acts."""
    seeing = count("scans", scans, 1) / positive("scanner_hz", scanner_hz)
    return seeing + 1e-3 * sum(
        finite(name, value, 0.0)
        for name, value in (
            ("output_ms", output_ms),
            ("controller_ms", controller_ms),
            ("drive_ms", drive_ms),
        )
    )


def walked_m(
    person_m_per_s: float, robot_m_per_s: float, reaction_s: float, braking_m_per_s2: float
) -> float:
    """Return how far a person walks until the robot stands."""
    stop_s = reaction_s + robot_m_per_s / positive("braking_m_per_s2", braking_m_per_s2)
    return finite("person_m_per_s", person_m_per_s, 0.0) * stop_s


def tipping_m_per_s2(half_base_m: float, height_m: float) -> float:
    """Return the braking at which a rigid robot begins to tip about its front edge."""
    return GRAVITY_M_PER_S2 * positive("half_base_m", half_base_m) / positive("height_m", height_m)


Input = float | str | list[float]


def _measured(place: str) -> float | str:
    """Return what was measured, from a chart's data or the record of a claim."""
    from course.derivations.records import figure
    from course.interview.chart_data import chart

    source, _, name = place.partition(".")
    return chart(name) if source == "chart" else figure(source, name)


@dataclass(frozen=True)
class Estimate:
    """One case: what it says, the unit of the result ("" for a count or share), and the inputs.

    An input that is a text is what was measured: `chart.NAME/STEPS`, or `CLAIM.FIGURE`.
    """

    statement: str
    unit: str
    function: Callable[..., float]
    inputs: Mapping[str, Input]

    def given(self, **changes: Input) -> dict[str, Any]:
        """Return the inputs, with others where they are given."""
        for name in changes:
            one_of("input", name, self.inputs)
        every = {**self.inputs, **changes}
        return {k: _measured(v) if isinstance(v, str) else v for k, v in every.items()}

    def value(self, **changes: Input) -> float:
        """Return the result, with other inputs where they are given."""
        return float(self.function(**self.given(**changes)))

    def __str__(self) -> str:
        rows = [f"  {name:<24} {value}" for name, value in self.given().items()]
        return "\n".join([self.statement, *rows, f"  -> {self.value():.3g} {self.unit}".rstrip()])


def _cases() -> dict[str, Estimate]:
    cases = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    named = {name: globals()[case.pop("function")] for name, case in cases.items()}
    return {name: Estimate(function=named[name], **case) for name, case in cases.items()}


ESTIMATES = _cases()
