"""Does a policy transfer: over gap and range, for what robot time, and how late is too late."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course import sim_to_real
from course.charts import chart
from course.charts.sim_to_real import logs
from course.control import Adaptive, Gains, joint_system, margins
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.oracles.mujoco.twin import PLAIN, Twin, judged
from course.sim_to_real import only, plants, real, recorded, rollouts, tasks, tune
from course.sim_to_real.identify import arm
from course.sim_to_real.transfer import PARTS
from course.sim_to_real.tune import GRID

Array = NDArray[np.float64]
SEEN, LATE = 41, 0.01  # seed of tasks that no tuning saw; delay of the real arm [s]
ELBOW = 1.6  # a typical bend of the elbow at the end of a reach [rad]


def banded(label: str, x: Sequence[float], rates: Sequence[float], n: int, key: str = "") -> Series:
    """Return shares of n trials over x, with Wilson's interval."""
    low, high = wilson(n * np.array(rates), n)
    message = ", ".join(f"{rate:.2f}" for rate in rates)
    return Series(label, x, rates, key, low=low, high=high, note=f"{label}: {message}")


@chart
def success_over_gap(n: int = 1000, observed: int = 256) -> Iterator[Panel]:
    """Chart success on n tasks over the gap and the width of the tuning range, with the twin."""
    # One set of tasks for all policies, which no tuning has seen.
    record, posed = recorded(), tasks(n, SEEN)
    panel = Panel("Success on the real arm, 10 ms of delay", "gap", "success")
    for label, kind, k in (
        ("no range", "range", 0),
        ("range 0.4", "range", 4),
        ("range 1", "range", 10),
    ):
        rows = np.array([rollouts(real(g, LATE), record[kind][k].T, posed).rate for g in GRID])
        message = ", ".join(f"{rate:.2f}" for rate in rows.mean(axis=1))
        panel.series.append(
            Series(
                label,
                GRID,
                rows.mean(axis=1),
                low=rows.min(axis=1),
                high=rows.max(axis=1),
                note=f"{label}: {message}",
            )
        )
    for label, kind in (("true parameters", "known"), ("true, range 0.4", "both")):
        rates = [
            float(rollouts(real(g, LATE), record[kind][k, 0], posed).rate)
            for k, g in enumerate(GRID)
        ]
        panel.series.append(banded(label, GRID, rates, n))
    yield panel
    panel = Panel("Success by the range of the tuning", "randomisation range", "success")
    cases = {"simulator's own arm": (0.0, 0.0)}
    cases |= {
        f"gap {gap:g}, {ms} ms": (gap, 1e-3 * ms) for gap, ms in ((0.3, 10), (0.3, 20), (1, 10))
    }
    for label, (gap, delay) in cases.items():
        rows = np.array([rollouts(real(gap, delay), s.T, posed).rate for s in record["range"]])
        panel.series.append(banded(label, GRID, rows.mean(axis=1), n))
    twin = Twin()
    rates = [float(twin.rollouts(s[0], tasks(observed, SEEN)).rate) for s in record["range"]]
    panel.series.append(banded("MuJoCo's twin", GRID, rates, observed, "MuJoCo"))
    yield panel


def from_log(twin: Twin, seconds: float, seed: int, without: Sequence[str] = ()) -> Array:
    """Return columns of an arm (12, 1) identified from one log under two sines.

    The columns named in `without` remain 0.
    """
    # Deliberately wrong starts, so that the fit has to find the parameters.
    start = {name: 2.0 * logs.TRUTH[name] for name in "abd"} | {"c1": 0.1, "c2": 0.1, "f1": 0.3}
    start |= {"f2": 0.15, "delay": 0.005, "bias1": 0.0, "bias2": 0.0, "q1": 0.3, "q2": 1.2}
    start |= dict.fromkeys(without, 0.0)
    log = twin.log(1.5 * logs.plan("two sines", seconds, plants.DT).T, [0.3, 1.2], seed)
    free = {name: bounds for name, bounds in logs.ALL.items() if name not in without}
    result = sim_to_real.fit(arm, log, start, free)
    columns = np.zeros((len(plants.ROWS), 1))
    columns[[plants.ROWS.index(name) for name in result.names], 0] = result.value
    columns[[7, 11], 0] = 1.0, 1e-3
    return columns


def about(columns: Array) -> Callable[[int, np.random.Generator], Array]:
    """Return arms about an identified one (12, 1): inertias, friction and delay 20 % up or down."""

    def draw(n: int, rng: np.random.Generator) -> Array:
        factor = np.ones((12, n))
        factor[:9] = rng.uniform(0.8, 1.2, (9, n))
        # The inertial parameters scale together.
        factor[1:3] = factor[0]
        return columns * factor

    return draw


def adaptive(twin: Twin, posed: plants.Tasks, rate: float) -> float:
    """Return the success of chapter 6's adaptive law along smooth paths of 0.5 s.

    It starts from the simulator's parameters.

    The setting was seen on the twin, one of eight slopes and dampings and of three rates: all never
    fail on `PLAIN`, and on the twin they gave 0.69 to 1.00, not adapting 0.78 to 0.92.
    """
    laws = [
        Adaptive(plants.ARM, 10.0, np.diag([4.0, 1.0]), rate, plants.DT, plants.ARM.parameters)
        for _ in range(posed.size)
    ]
    last, v, distance = posed.start, np.zeros(posed.start.shape), posed.reference - posed.start

    def law(k: int, observed: Array) -> Array:
        nonlocal last, v
        # Filtered difference: the twin measures angles only.
        v, last = v + 0.5 * ((observed - last) / plants.DT - v), observed.copy()
        s, T = min(1.0, k * plants.DT / 0.5), 0.5
        # Minimum-jerk (quintic) path from rest to rest.
        p, dp = s**3 * (10.0 - 15.0 * s + 6.0 * s * s), 30.0 * (s * (1.0 - s)) ** 2 / T
        desired = (
            posed.start + p * distance,
            dp * distance,
            60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / T**2 * distance,
        )
        return np.array(
            [
                one(observed[:, i], v[:, i], *(x[:, i] for x in desired))
                for i, one in enumerate(laws)
            ]
        ).T

    angles, _, _ = twin.run(law, posed.start, round(plants.SECONDS / plants.DT), posed.seed)
    return float(judged(angles, posed).rate)


@chart
def robot_time(
    n: int = 256,
    seeds: int = 3,
    counts: Sequence[int] = (1, 3, 10),
    rounds: Sequence[int] = (1, 2, 4),
) -> Iterator[Panel]:
    """Chart success on MuJoCo's twin over seconds of its time used: ranges, logs, fine-tuning.

    Args:
        n: tasks.
        seeds: of logs and tuning.
        counts: numbers of logs.
        rounds: numbers of rounds of 96 episodes of fine-tuning.
    """
    twin, posed, record = Twin(), tasks(n, SEEN), recorded()["range"]
    panel = Panel(
        "Success on the twin by the robot time used",
        "robot time [s]",
        "success on the twin",
        scale="log x",
    )
    for label, k in (("no range", 0), ("range 0.4", 4), ("range 1", 10)):
        rate = np.mean([twin.rollouts(gains, posed).rate for gains in record[k]])
        panel.lines = [*panel.lines, ("y", float(rate), label)]
        panel.notes.append(f"{label}, no robot time: {rate:.2f}")
    for label, pace in (("its law, not adapting", 1e-9), ("adaptive law", 0.005)):
        share = adaptive(twin, posed, pace)
        panel.lines = [*panel.lines, ("y", share, label)]
        panel.notes.append(f"{label}, setting seen on the twin: {share:.2f}")
    x = [plants.SECONDS * k for k in counts]
    arms = [[from_log(twin, s, seed) for seed in range(seeds)] for s in x]
    for label, draws in (("identified from a log", only), ("identified, and a range", about)):
        rows = np.array(
            [
                [
                    twin.rollouts(tune(draws(each), seed).gains, posed).rate
                    for seed, each in enumerate(row)
                ]
                for row in arms
            ]
        )
        panel.series.append(banded(label, x, rows.mean(axis=1), n))

    def trial(sets: Array, turn: int) -> sim_to_real.Outcome:
        # New tasks in every round, the same for all candidates.
        some = [twin.rollouts(gains, tasks(8, 1000 + turn)) for gains in sets.T]
        names = ("success", "inside", "error", "reason")
        return sim_to_real.Outcome(*(np.array([getattr(one, x) for one in some]) for x in names))

    how: dict[str, Any] = {"start": record[10, 0], "samples": 12, "elites": 3, "spread": 0.3}
    result = [sim_to_real.improve(trial, np.random.default_rng(0), rounds=r, **how) for r in rounds]
    rates = [float(twin.rollouts(one.gains, posed).rate) for one in result]
    panel.series.append(
        banded("fine-tuned", [plants.SECONDS * f.episodes for f in result], rates, n)
    )
    yield panel


ORDER = ("delay", "friction", "motor", "load", "encoder")  # of the worked trace
FINDINGS = (
    "nothing corrected:",
    "time stamps differ; delay:",
    "stops short of the target; friction:",
    "less torque than commanded; motor:",
    "fitted mass above simulated; load:",
    "rests beside the target, seen from outside; encoder:",
)


@chart
def mending(n: int = 1000, seeds: int = 2, rounds: int = 20) -> Iterator[Panel]:
    """Chart what fixing each parameter of the simulator does to success on the real arm.

    All subsets of parameters are tried.
    """
    other, posed = real(1.0, LATE), tasks(n, SEEN)

    def rate(some: frozenset[str]) -> float:
        home = only(sim_to_real.mended(other, some))
        sets = [tune(home, seed, rounds=rounds).gains for seed in range(seeds)]
        return float(rollouts(other, np.array(sets).T, posed).rate.mean())

    # All 2^5 subsets, so that order effects and Shapley's average can be computed.
    value = {some: rate(some) for some in sim_to_real.subsets(PARTS)}
    panel = Panel(
        "Success with all 32 sets of corrections",
        "number of parameters corrected",
        "success on the real arm, gap 1",
    )
    # The text speaks of this dot.
    tags = ["load first" if some == {"load"} else "" for some in value]
    panel.series.append(
        Series("", [len(some) for some in value], list(value.values()), style="", tags=tags)
    )
    trace = [frozenset(ORDER[:k]) for k in range(len(ORDER) + 1)]
    y, count = np.array([value[some] for some in trace]), n * seeds
    panel.series.append(Series("delay first", range(len(y)), y, tags=["", *ORDER]))
    panel.notes += [
        "row {}, {:<36} {:.2f} [{:.2f}, {:.2f}] of {}".format(k, text, v, *band, count)
        for k, (text, v, band) in enumerate(
            zip(FINDINGS, y, np.transpose(wilson(count * y, count)), strict=True)
        )
    ]
    worse = sim_to_real.harmful_corrections(value)
    before, part, change = worse[0]
    panel.notes.append(
        f"{len(worse)} of 80 corrections hurt; worst: {part} after "
        f"{' '.join(sorted(before)) or 'none'}, {change:+.2f}"
    )
    yield panel
    shares = sim_to_real.attribution(value)
    panel = Panel(
        "Value of correcting a parameter, by its turn",
        "when the parameter is corrected",
        "change of the success rate",
        xlim=(-0.4, 2.4),
        ticks=(0, 1, 2),
        tick_names=("as the first", "average", "as the last"),
        lines=[("y", 0.0, "")],
    )
    for part in ORDER:
        message = ", ".join(f"{change:+.2f}" for change in shares[part])
        panel.series.append(
            Series(
                part,
                (0, 1, 2),
                shares[part],
                style="",
                note=f"{part}: alone, average, last {message}",
            )
        )
    yield panel


def delay_limit(gains: Array, factor: float = 1.0) -> float:
    """Return delay [s] that joint 2's loop stands, joint 1 held, by chapter 6's margins."""
    _, _, d, _, c = plants.ARM.parameters.tolist()
    kp, ki, kd = (factor * gains[3:]).tolist()
    law = Gains(kp, ki, kd, plants.FILTER).law(plants.DT)
    return margins(*joint_system(d, c), law, plants.DT).delay


def swings(gains: Array, late: float, elbow: float = 1.2, dry: float = 0.0, **free: float) -> bool:
    """Return whether the swing of joint 2 after a step of a milliradian grows.

    With `f1=0` joint 1 is free of friction.
    """
    body, start = plants.nominal().columns(), np.array([[0.3], [elbow]])
    body[[5, 6, 8], 0] = free.get("f1", 1e3), dry, late
    small = plants.Tasks(start, plants.tip(start + [[0.0], [1e-3]]))
    q = sim_to_real.watch(body, gains, small).q[1, 0]
    # The swing of the second part of the run against the first.
    return bool(np.ptp(q[68:]) > min(np.ptp(q[45:68]), 5e-3))  # growing, or grown


def arm_limit(gains: Array, elbow: float = 1.2) -> float:
    """Return delay [s] from which the arm swings with both joints free, by halving from 40 ms."""
    low, high = 0.0, 0.04
    for _ in range(9):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if swings(gains, middle, elbow, f1=0.0) else (middle, high)
    return high


@chart
def late_commands(n: int = 200, points: int = 31, observed: int = 64) -> Iterator[Panel]:
    """Chart the delay at which reaches fail, by gain, with stability limits and MuJoCo's delay."""
    gains, posed = recorded()["range"][0, 0], tasks(n, SEEN)
    late, factors = np.linspace(0.0, 0.06, points), np.linspace(0.2, 1.6, 15)
    fails = np.array(
        [1.0 - rollouts(real(0.0, x), np.outer(gains, factors), posed).rate for x in late]
    ).T
    limits = np.array([delay_limit(gains, f) for f in factors])
    whole = np.array([arm_limit(f * gains, ELBOW) for f in factors])
    free = whole < 0.0399  # the search for this limit ends at 40 ms
    # The delay at which a share of the tasks fails, interpolated; the share rises with the delay.
    share = {
        x: np.array([float(np.interp(x, np.maximum.accumulate(row), late)) for row in fails])
        for x in (0.1, 0.5, 0.9)
    }
    ratio = share[0.5] / limits
    bent = {elbow: arm_limit(gains, elbow) for elbow in (0.8, 1.2, 1.6, 2.0)}
    turn = posed.reference[1]
    held = rollouts(real(0.0, 0.012), gains, posed).success
    yield Panel(
        "Delay at which half of the reaches fail",
        "factor on all gains",
        "delay [ms]",
        [
            Series(
                "half fail (band: 10 to 90 %)",
                factors,
                1e3 * share[0.5],
                low=1e3 * share[0.1],
                high=1e3 * share[0.9],
            ),
            Series("margin of joint 2, joint 1 locked", factors, 1e3 * limits, style="--"),
            Series(
                f"limit, both free, elbow {ELBOW:g} rad",
                factors[free],
                1e3 * whole[free],
                style=":",
            ),
        ],
        ylim=(0.0, 40.0),
        notes=[
            "delay at which half fail over the limit of joint 2: "
            + ", ".join(
                f"{ratio[i]:.2f} at {factors[i]:.1f} of the gains" for i in range(2, 15, 3)
            ),
            "both joints free, swings from "
            + ", ".join(f"{1e3 * x:.1f} ms at an elbow of {e:g}" for e, x in bent.items())
            + " rad",
            "success at 12 ms by the elbow: "
            + ", ".join(
                f"{held[(turn >= e) & (turn < e + 0.6)].mean():.2f} from {e:g} rad"
                for e in (0.3, 0.9, 1.5, 2.1)
            ),
        ],
    )
    panel = Panel("Success against the delay, ours and MuJoCo's", "delay [ms]", "success")
    some, ms = tasks(observed, SEEN), range(0, 33, 4)
    for label, k in (("no range", 0), ("range 1", 10)):
        sets = recorded()["range"][k, 0]
        ours = [float(rollouts(real(0.0, 1e-3 * m), sets, some).rate) for m in ms]
        theirs = [float(Twin(replace(PLAIN, delay=1e-3 * m)).rollouts(sets, some).rate) for m in ms]
        limit = 1e3 * delay_limit(sets)
        panel.series += [
            banded(label, ms, ours, observed),
            banded(f"{label}, MuJoCo", ms, theirs, observed),
        ]
        panel.lines = [*panel.lines, ("x", limit, f"{label}: {limit:.1f} ms")]
    yield panel
