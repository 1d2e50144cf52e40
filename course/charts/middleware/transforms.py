"""What a lookup of a transform costs between the stamps and after the newest one."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved, pairwise_ratios
from course.measure.work_precision import machine
from course.middleware.transforms import (
    SwingingFrame,
    hold_bound,
    interpolation_bound,
    linear_bound,
    sample,
)


def worst_error(
    motion: SwingingFrame, period: float, ahead: float, beyond: str, ends: Sequence[float]
) -> float:
    """Return the largest error of a position looked up so long after the newest stamp [m]."""
    largest = 0.0
    for end in ends:
        buffer = sample(motion, period, end, cache=3.5 * period)
        result = buffer.lookup(end + ahead, beyond)
        true = motion.at(end + ahead).position[:, 0]
        largest = max(largest, float(np.linalg.norm(result.position - true)))
    return largest


@chart(columns=2)
def transform_lookups(
    aheads: Sequence[float] = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0),
    periods: Sequence[float] = (0.004, 0.01, 0.02, 0.05, 0.1, 0.2),
    ends: int = 150,
    repeats: int = 15,
) -> Iterator[Panel]:
    """Chart the error of transforms looked up after the newest stamp, and between two stamps.

    Args:
        aheads: times after the newest stamp [s].
        periods: between two transforms [s].
        ends: how many newest stamps are tried, spread over one period of the motion.
        repeats: of the timing.
    """
    from scipy.spatial.transform import Rotation, Slerp

    motion, period = SwingingFrame(), 0.02
    moments = np.linspace(4.0, 6.0, ends, endpoint=False).tolist()
    x = 1e3 * np.array(aheads)
    after = Panel(
        "After the newest stamp (50 transforms/s)",
        "look-ahead [ms]",
        "largest error [mm]",
        scale="log",
        theory="bound",
        footer=machine(0.0, libraries=("scipy",)),
        notes=[
            f"a camera {motion.radius} m from a swinging axis, at most {motion.speed:.3f} m/s and "
            f"{motion.acceleration:.2f} m/s^2; tf2 refuses every look-ahead"
        ],
    )
    bounds = {
        "hold": lambda h: 1e3 * hold_bound(1e-3 * np.asarray(h), motion.speed),
        "linear": lambda h: 1e3 * linear_bound(1e-3 * np.asarray(h), motion.acceleration, period),
    }
    for name, label in (("hold", "hold the newest"), ("linear", "continue linearly")):
        errors = [1e3 * worst_error(motion, period, h, name, moments) for h in aheads]
        report = ", ".join(
            f"{a:g}: {e:.3g} ({float(bounds[name](a)):.3g})" for a, e in zip(x, errors, strict=True)
        )
        after.series.append(
            Series(
                label,
                x,
                errors,
                style="",
                theory=bounds[name],
                note=f"{label}: largest error [mm] by look-ahead [ms] (bound): {report}",
            )
        )
    # Frequent transforms: the curves of a sine cross where w h = 2 sin(w h).
    after.lines = [("x", 1e3 * 1.8954942 / motion.rate, "0.3 of a swing")]
    yield after
    between = Panel(
        "Between two stamps",
        "time between transforms [ms]",
        "largest error [mm]",
        scale="log",
        theory="bound",
    )
    # Within one swing, away from the newest stamp.
    times = np.linspace(5.0, 7.0, 8001)
    truth = motion.at(times)
    ours, scipys = [], []
    for step in periods:
        buffer = sample(motion, step, 8.0)
        stamps = np.array([8.0 - step * k for k in range(int(8.0 / step + 1e-9), -1, -1)])
        stored = motion.at(stamps)
        turns = Slerp(stamps, Rotation.from_quat(stored.quaternion.T, scalar_first=True))

        def library(turns=turns, stamps=stamps, stored=stored):
            # SciPy has no lookup of poses: np.interp for the position, Slerp for the orientation.
            place = np.stack([np.interp(times, stamps, row) for row in stored.position])
            return place, turns(times).as_quat(scalar_first=True)

        def own(buffer=buffer):
            return buffer.lookup(times)

        ours.append(1e3 * np.linalg.norm(own().position - truth.position, axis=0).max())
        scipys.append(1e3 * np.linalg.norm(library()[0] - truth.position, axis=0).max())
        if step == periods[0]:
            pair = [calls(own), calls(library)]
            (ratio,) = pairwise_ratios(pair, pairs=repeats, sample=0.02)
            clocks = interleaved(pair, repeats=repeats, sample=0.02, warm=True)
            each = [1e6 * one.median / len(times) for one in clocks]
            between.notes.append(
                f"time of a lookup in a batch of {len(times)}, {len(buffer)} stored: "
                f"{each[0]:.2f} us here, {each[1]:.2f} us with SciPy, {ratio}"
            )
    y = 1e3 * np.array(periods)
    for label, errors, hollow in (("this buffer", ours, False), ("SciPy's Slerp", scipys, True)):
        report = ", ".join(f"{a:g}: {e:.3g}" for a, e in zip(y, errors, strict=True))
        between.series.append(
            Series(
                label,
                y,
                errors,
                style="",
                hollow=hollow,
                theory=None if hollow else partial(_interpolated, motion=motion),
                note=f"{label}: largest error [mm] by period [ms]: {report}",
            )
        )
    yield between


def _interpolated(period: float, motion: SwingingFrame) -> np.ndarray:
    """Return the bound of interpolation [mm] by the period [ms]."""
    return 1e3 * interpolation_bound(1e-3 * np.asarray(period), motion.acceleration)
