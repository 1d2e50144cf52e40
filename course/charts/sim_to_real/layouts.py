"""How N arms lie in memory: arrays of structures, structures of arrays, blocks; and divergence.

An arm is 17 numbers: two angles, two rates, and the 13 parameters of `TwoLink.column`. All layouts
are stepped by the same source, `advance`, which calls chapter 1's Runge-Kutta step with chapter 4's
equations of the two-link arm. Only the memory differs:

- an *array of structures* stores the 17 numbers of an arm next to each other;
- a *structure of arrays* stores the first number of all arms, then the second of all arms;
- *blocks* store a structure of arrays for each w arms (w = 1 is an array of structures, w = N is a
  structure of arrays).
"""

import functools
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import process_time
from typing import Any

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from course.charts import chart
from course.check import count, invalid
from course.compiled import compiled
from course.kinematics.two_link import TwoLink, acceleration
from course.measure.figure import Panel, Series
from course.measure.timing import Timing, calls, interleaved, pairwise_ratios
from course.measure.work_precision import machine
from course.oracles.mujoco import reach as mujoco_arms
from course.rigid_body.integrators import rk4

Array = NDArray[np.float64]

NUMBERS = 17  # of an arm: angles, rates, parameters
BYTES = 8 * NUMBERS
STEP = 0.02  # s, as in the reaching task
SIZES = tuple(4**k for k in range(9))  # 1 to 65,536
LIGHT_SIZES = tuple(4**k for k in range(11))  # to a million
WIDTH = 256  # arms of a block
WIDTHS = (1, 4, 16, 64, 256, 1024, 4096, 16_384, 65_536)
ROLLED = 10  # steps of a call of `mujoco.rollout`
RIVALS_UP_TO = 4096  # arms; their time per arm no longer changes by then, and a call takes 0.3 s
SHARES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
GROUPS = (8, 32, 128)  # lanes: a vector of floats, a warp of NVIDIA's GPUs, four warps

# --- compiled -------------------------------------------------------------------------------------


def advance(arms, dt):
    """Advance arms (B, 17, w) by one Runge-Kutta step, block after block, in place."""
    for b in range(arms.shape[0]):
        q, v, column = arms[b, 0:2], arms[b, 2:4], arms[b, 4:17]
        x, w = rk4(q, v, acceleration, dt, column)
        q[:] = x
        v[:] = w


def drift(arms, dt):
    """Turn arms (B, 17, w) on by dt times their rates: a pass that reads 4 of the 17 numbers."""
    for b in range(arms.shape[0]):
        for c in range(2):
            for i in range(arms.shape[2]):
                arms[b, c, i] += dt * arms[b, 2 + c, i]


@functools.cache
def kernels(contiguous: bool) -> tuple[Any, Any]:
    """Return `advance` and `drift`, compiled for contiguous or for strided memory."""
    array = types.Array(numba.float64, 3, "C" if contiguous else "A")
    signature = types.void(array, numba.float64)
    return compiled(advance, signature), compiled(drift, signature)


# --- layouts --------------------------------------------------------------------------------------


def start(n: int, seed: int = 0) -> Array:
    """Return N arms at random angles, rates and torques, shape (17, N)."""
    rng = np.random.default_rng(seed)
    result = np.tile(TwoLink().column(), (1, count("n", n, 1)))
    state = np.concatenate([rng.uniform(-np.pi, np.pi, (2, n)), rng.normal(0.0, 1.0, (2, n))])
    result[-2:] = rng.uniform(-1.0, 1.0, (2, n)) * result[7:9]
    return np.concatenate([state, result])


def blocks(arms: Array, width: int) -> Array:
    """Return arms (17, N) as blocks that are structures of arrays, shape (N / width, 17, width)."""
    n = _whole(arms, width)
    return np.array(arms.reshape(NUMBERS, n, width).transpose(1, 0, 2), order="C")


def structures(arms: Array, width: int) -> Array:
    """Return the same shape as `blocks`, but with the 17 numbers of each arm next to each other."""
    n = _whole(arms, width)
    return np.array(arms.T, order="C").reshape(n, width, NUMBERS).transpose(0, 2, 1)


def _whole(arms: Array, width: int) -> int:
    if width < 1 or arms.shape[1] % width:
        raise invalid("width", width, f"a divisor of the number of arms, {arms.shape[1]}")
    return arms.shape[1] // width


def flat(arms: Array) -> Array:
    """Return arms of any layout as (17, N)."""
    return arms.transpose(1, 0, 2).reshape(NUMBERS, -1)


def lines_touched(arms: Array, numbers: int, line: int = 64) -> float:
    """Return how many bytes of cache lines a pass over the first `numbers` touches per arm.

    Counted from the addresses of these numbers, with memory that starts at a line.

    Args:
        arms: any layout, shape (B, 17, w).
        numbers: how many of the 17 the pass reads.
        line: bytes of a cache line.
    """
    b, c, i = np.ogrid[: arms.shape[0], :numbers, : arms.shape[2]]
    address = b * arms.strides[0] + c * arms.strides[1] + i * arms.strides[2]
    return line * np.unique(address // line).size / (arms.shape[0] * arms.shape[2])


def caches() -> list[tuple[str, int]]:
    """Return names and bytes of the data caches that Linux reports; empty elsewhere."""
    sizes = {}
    folder = "/sys/devices/system/cpu/cpu0/cache"
    for name in sorted(os.listdir(folder)) if os.path.isdir(folder) else ():
        try:
            kind, level, size = (
                Path(folder, name, part).read_text(encoding="utf-8").strip()
                for part in ("type", "level", "size")
            )
        except OSError:
            continue
        if kind != "Instruction":
            sizes[f"L{level}"] = int(size[:-1]) * {"K": 1024, "M": 1024**2}[size[-1]]
    return list(sizes.items())


# --- divergence -----------------------------------------------------------------------------------


def touching(share: float, n: int = 65_536, seed: int = 0, steps: int = 50) -> NDArray[np.bool_]:
    """Return which of N arms reach beyond a wall after they moved for a second, shape (N,).

    The wall is where this share of the tips is beyond it.
    """
    arms = blocks(start(n, seed), min(WIDTH, n))
    for _ in range(steps):
        kernels(True)[0](arms, STEP)
    moved = flat(arms)
    reach = moved[9] * np.cos(moved[0]) + moved[10] * np.cos(moved[0] + moved[1])
    return np.asarray(reach > np.quantile(reach, 1.0 - share))


def executed(contact: NDArray[np.bool_], group: int) -> float:
    """Return lanes that are occupied by the contact branch, over the lanes that need it.

    A group of lanes shares its instructions: if one lane is in contact, all of them pay.
    """
    inside = np.append(contact, np.zeros(-len(contact) % group, dtype=bool)).reshape(-1, group)
    return float(group * inside.any(axis=1).sum() / contact.sum())


def expected(share: float, group: int) -> float:
    """Return the same for independent lanes: (1 - (1 - p)^w) / p."""
    return (1.0 - (1.0 - share) ** group) / share


# --- the chart ------------------------------------------------------------------------------------

Run = Callable[[], Any]
CALL, STRUCTURES, ARRAYS, BLOCKS = (
    "a call per arm",
    "array of structures",
    "structure of arrays",
    "blocks of arrays",
)
BATCH, ROLLOUT = "mujoco.batch", "mujoco.rollout"


def layouts(n: int, light: bool = False) -> dict[str, Run]:
    """Return one step of N arms in each layout, the rivals not counted."""
    arms, width = start(n), min(WIDTH, n)
    which = int(light)
    whole, strided, some = blocks(arms, n), structures(arms, width), blocks(arms, width)
    return {
        STRUCTURES: functools.partial(kernels(False)[which], strided, STEP),
        ARRAYS: functools.partial(kernels(True)[which], whole, STEP),
        BLOCKS: functools.partial(kernels(True)[which], some, STEP),
    }


def contenders(n: int) -> dict[str, tuple[Run, int]]:
    """Return what steps N arms, each with the number of steps that a call takes."""
    arms = start(n)
    rows: dict[str, tuple[Run, int]] = {name: (run, 1) for name, run in layouts(n).items()}
    if n <= 1024:
        single = [np.ascontiguousarray(column[None, :, None]) for column in arms.T]
        step = kernels(True)[0]

        def one_by_one() -> None:
            for arm in single:
                step(arm, STEP)

        rows = {CALL: (one_by_one, 1), **rows}
    if n <= RIVALS_UP_TO:
        given = TwoLink(), arms[:2], arms[2:4], arms[-2:], STEP
        rows[BATCH] = mujoco_arms.stepper(*given), 1
        rows[ROLLOUT] = mujoco_arms.rollout(*given, ROLLED), ROLLED
    return rows


def disagreement(n: int = 4096) -> tuple[float, float]:
    """Return the largest difference of an angle after one step [rad].

    Between the three layouts, and between them and `mujoco.batch`.
    """
    arms, width = start(n), min(WIDTH, n)
    every = [blocks(arms, n), structures(arms, width), blocks(arms, width)]
    for place, memory in enumerate(every):
        kernels(place != 1)[0](memory, STEP)
    whole, *others = (flat(memory)[:2] for memory in every)
    theirs = mujoco_arms.stepper(TwoLink(), arms[:2], arms[2:4], arms[-2:], STEP)()
    return (
        max(float(np.abs(other - whole).max()) for other in others),
        float(np.abs(theirs.T - whole).max()),
    )


def _marks(largest: int) -> list[tuple[str, float, str]]:
    """Return at how many arms each cache is full, as lines across."""
    return [("x", size / BYTES, name) for name, size in caches() if size / BYTES < largest]


def _series(name: str, x: Sequence[int], rows: Sequence[Timing], per: Sequence[float]) -> Series:
    """Return nanoseconds per arm and step, with quartiles."""
    middle, low, high = (
        [1e9 * value / work for value, work in zip(column, per, strict=True)]
        for column in zip(*((t.median, t.low, t.high) for t in rows), strict=True)
    )
    return Series(name, list(x), middle, name, low=low, high=high)


def _measured(
    sizes: Sequence[int], make: Callable[[int], dict[str, tuple[Run, int]]], repeats: int
) -> tuple[list[Series], float]:
    """Return the times of all contenders at all sizes, and the largest share of busy rounds."""
    times: dict[str, list[tuple[int, Timing, float]]] = {}
    for n in sizes:
        row = make(n)
        samplers = [calls(run, clock=process_time) for run, _ in row.values()]
        timed = interleaved(samplers, repeats=repeats, sample=2e-3, warm_up=1e-3)
        for (name, (_, steps)), timing in zip(row.items(), timed, strict=True):
            times.setdefault(name, []).append((n, timing, float(n * steps)))
    series = [_series(name, *zip(*points, strict=True)) for name, points in times.items()]
    return series, max(t.busy for points in times.values() for _, t, _ in points)


def _table(sizes: Sequence[int], series: Sequence[Series], title: str) -> list[str]:
    rows = [f"{title:<34}" + "".join(f"{n:>9}" for n in sizes)]
    for one in series:
        cells = dict(zip(one.x, one.y, strict=True))
        text = (f"{cells[n]:>9.3g}" if n in cells else f"{'-':>9}" for n in sizes)
        rows.append(f"{one.label:<34}" + "".join(text))
    return rows


def _ratio(slow: Run, fast: Run, repeats: int, work: float = 1.0) -> str:
    (ratio,) = pairwise_ratios(
        [calls(run, clock=process_time) for run in (fast, slow)], pairs=repeats, sample=2e-3
    )
    return str(type(ratio)(*(value / work for value in ratio)))


@chart
def batch_layout(
    sizes: Sequence[int] = SIZES,
    light: Sequence[int] = LIGHT_SIZES,
    widths: Sequence[int] = WIDTHS,
    shares: Sequence[float] = SHARES,
    repeats: int = 21,
) -> Iterator[Panel]:
    """Chart the time of a step of N arms by their layout in memory, and what divergence wastes.

    Everything runs on one thread, so processor time is measured: what other programs do counts only
    as far as they empty the caches.

    Args:
        sizes: numbers of arms.
        light: numbers of arms of the pass that reads 4 numbers.
        widths: arms of a block, divisors of the last one.
        shares: of the arms that are in contact.
        repeats: rounds.
    """
    series, busy = _measured(sizes, contenders, repeats)
    step = Panel(
        "A Runge-Kutta step: all 17 numbers",
        "number of arms N",
        "time per arm and step [ns]",
        series,
        scale="log",
        lines=_marks(max(sizes)),
    )
    step.footer = machine(busy) + "; one core"
    same, theirs = disagreement(min(4096, max(sizes)))
    step.notes = _table(sizes, series, "ns per arm and step at N =")
    for n in sorted({min(RIVALS_UP_TO, max(sizes)), max(sizes)}):
        row = contenders(n)
        for slow in (STRUCTURES, ARRAYS, BATCH, ROLLOUT):
            if slow in row:
                ratio = _ratio(row[slow][0], row[BLOCKS][0], repeats, row[slow][1])
                step.notes.append(f"step, N = {n}, {slow} takes {ratio} the time of {BLOCKS}")
    step.notes.append(
        f"largest difference after a step: {same:.1e} rad between layouts, {theirs:.1e} rad to "
        "MuJoCo's RK4"
    )
    yield step

    series, busy = _measured(
        light, lambda n: {name: (run, 1) for name, run in layouts(n, True).items()}, repeats
    )
    passed = Panel(
        "A light pass: 4 of 17 numbers",
        "number of arms N",
        "time per arm and pass [ns]",
        series,
        scale="log",
        lines=_marks(max(light)),
    )
    passed.footer = machine(busy) + "; one core"
    passed.notes = _table(light, series, "ns per arm and light pass at N =")
    for n in sorted({min(16_384, max(light)), max(light)}):
        runs = layouts(n, True)
        ratio = _ratio(runs[STRUCTURES], runs[BLOCKS], repeats)
        passed.notes.append(f"light pass, N = {n}, {STRUCTURES} takes {ratio} the time of {BLOCKS}")
    arms = start(4096)
    touched = [lines_touched(make(arms, WIDTH), 4) for make in (structures, blocks)]
    passed.notes.append(
        f"light pass, bytes of cache lines touched per arm: {touched[0]:.0f} as structures, "
        f"{touched[1]:.0f} in blocks, ratio {touched[0] / touched[1]:.2f}"
    )
    yield passed

    arms = start(max(widths))
    timed = [
        interleaved(
            [
                calls(kernels(True)[0], blocks(arms, width), STEP, clock=process_time),
                calls(kernels(False)[0], structures(arms, width), STEP, clock=process_time),
            ],
            repeats=repeats,
            sample=2e-3,
        )
        for width in widths
    ]
    per = [float(max(widths))] * len(widths)
    rows = [
        _series(name, widths, [pair[k] for pair in timed], per)
        for k, name in enumerate((BLOCKS, STRUCTURES))
    ]
    size = Panel(
        f"The step by width of a block, N = {max(widths):,}",
        "arms of a block w",
        "time per arm and step [ns]",
        rows,
        scale="log",
        lines=_marks(max(widths)),
        notes=_table(widths, rows, "ns per arm and step at w ="),
    )
    yield size

    flags = [touching(share) for share in shares]
    wasted = Panel(
        "Contact in some lanes of a group",
        "share of arms in contact",
        "lanes occupied by contact / lanes that need it",
        scale="log",
    )
    for group in GROUPS:
        y = [executed(contact, group) for contact in flags]
        wasted.series.append(
            Series(
                f"groups of {group}",
                shares,
                y,
                theory=functools.partial(expected, group=group),
                note=f"lanes occupied over needed, groups of {group}: "
                + ", ".join(f"{p:g}: {value:.3g}" for p, value in zip(shares, y, strict=True)),
            )
        )
    y = [executed(np.sort(contact)[::-1], 32) for contact in flags]
    wasted.series.append(
        Series(
            "sorted, groups of 32",
            shares,
            y,
            "chosen",
            note="after sorting, groups of 32: "
            + ", ".join(f"{p:g}: {value:.3g}" for p, value in zip(shares, y, strict=True)),
        )
    )
    yield wasted
