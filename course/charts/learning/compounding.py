"""When the errors of a copied policy add up, and to what power of the time."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from course import learning
from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.stability import stability_map

ALLOWED = 0.1  # of the cost, by which the square law may be too high


def summed(a: float, error: float, steps: float) -> float:
    """Return closed form of `accumulated` after all of its steps."""
    if a == 1.0:
        return error * steps * (steps + 1.0) / 2.0
    return error / (1.0 - a) * (steps - a * (1.0 - a**steps) / (1.0 - a))


@chart(columns=2)
def compounding(
    n: int = 20_000,
    horizons: Sequence[int] = (5, 10, 20, 40, 80, 160, 320),
    wrong: int = 5,
    points: int = 60,
    growth: Sequence[float] = (0.9, 1.0, 1.05),
    circle: int = 20,
) -> Iterator[Panel]:
    """Chart cost over the horizon with and without recovery.

    Where the square law holds, three plants.

    Args:
        n: episodes.
        horizons: lengths of the episodes.
        wrong: of 1,000 contexts, those whose action was copied wrongly.
        points: of the map on each axis.
        growth: factors of an error from step to step.
        circle: runs that are shown of circling.
    """
    table, rng, eps = np.arange(1000) < wrong, np.random.default_rng(11), wrong / 1000.0
    panel = Panel(
        f"One action in {1 / eps:.0f} is wrong, {n:,} runs",
        "length of the task [steps]",
        "wrong steps in a run, mean",
        scale="log",
        theory="lines: exact expectation",
        lines=[("x", 1.0 / eps, "1 / error rate")],
    )
    for label, back in (("never recovers", False), ("recovers", True)):
        cost = [learning.context_costs(table, T, n, rng, recovers=back) for T in horizons]
        mean = np.array([c.mean() for c in cost])
        half = np.array([1.96 * c.std() / np.sqrt(n) for c in cost])
        exact = learning.expected_cost(eps, np.array(horizons), recovers=back)
        power = np.log(exact[2] / exact[0]) / np.log(horizons[2] / horizons[0])
        last = np.log(exact[-1] / exact[-2]) / np.log(horizons[-1] / horizons[-2])
        panel.series.append(
            Series(
                label,
                horizons,
                mean,
                low=mean - half,
                high=mean + half,
                style="",
                theory=partial(learning.expected_cost, eps, recovers=back),
                note=f"{label}: exponent {power:.2f} over {horizons[0]} to {horizons[2]} steps, "
                f"{last:.2f} at the end; {np.abs(mean / exact - 1.0).max():.1%} off at most",
            )
        )
    yield panel
    count, rates = np.geomspace(2, 1000, points), np.geomspace(1e-4, 0.3, points)

    def over(T: float, share: float) -> float:
        law = share * T * (T + 1.0) / 2.0
        return (law / float(learning.expected_cost(share, T, recovers=False)) - 1.0) / ALLOWED

    grid = stability_map(
        over, count, rates, quantity=f"excess of the square law / {100 * ALLOWED:.0f} %"
    )
    grid = replace(grid, edge=f"{100 * ALLOWED:.0f} % too high")
    edge = grid.boundary() * rates
    observed = edge[np.isfinite(edge) & (edge > 0.0) & (rates < 0.03)]
    yield Panel(
        "How much too high the square law is",
        "length of the task [steps]",
        "error rate per step",
        scale="log",
        grid=grid,
        notes=[
            f"the law is {ALLOWED:.0%} too high at rate times steps = {observed.min():.2f} to "
            f"{observed.max():.2f}, predicted {3 * ALLOWED:g}"
        ],
    )
    at = np.array(horizons[:-1] if len(horizons) > 2 else horizons)
    panel = Panel(
        "Loop x' = a x + e: simulated",
        "steps",
        "sum of |x|, divided by e",
        scale="log",
        ticks=[int(T) for T in at],
        theory="lines: closed form",
    )
    for a in growth:
        y = learning.accumulated(a, 1.0, int(at[-1]))[at - 1]
        power = np.log(y[-1] / y[-2]) / np.log(at[-1] / at[-2])
        panel.series.append(
            Series(
                f"a = {a:g}",
                at,
                y,
                theory=partial(summed, a, 1.0),
                style="",
                note=f"a = {a:g}: exponent {power:.2f} at the end",
            )
        )
    yield panel
    yield circling(circle)


def circling(number: int = 20, horizon: int = 160) -> Panel:
    """Return clone and DAgger at equal labels on the circle, which forgives."""
    task, at = learning.Circle(), np.array([10, 20, 40, 80, 160])
    at = at[at <= horizon]
    learn = partial(learning.clone, seed=0, width=32, steps=600, rate=3e-3)
    panel = Panel(
        "Circle task, equally many labels",
        "steps",
        "summed distance from the circle [m]",
        scale="log",
        ticks=[int(T) for T in at],
    )
    for label, rounds in (("cloned", 0), ("DAgger, two rounds", 2)):
        rng = np.random.default_rng(4)
        shown = 3 * number if not rounds else number
        *_, last = learning.dagger(
            task, task.expert, learn, task.starts, 40, rng, number=shown, rounds=rounds
        )
        ran = learning.roll(
            task, last.policy, task.starts(200, np.random.default_rng(9)), horizon, rng
        )
        cost = np.cumsum(task.cost(ran.states[:, 1:]), axis=1)[:, at - 1]
        y = cost.mean(axis=0)
        half = 1.96 * cost.std(axis=0) / np.sqrt(len(cost))
        power = np.polyfit(np.log(at[1:]), np.log(y[1:]), 1)[0]
        panel.series.append(
            Series(
                label,
                at,
                y,
                low=y - half,
                high=y + half,
                note=f"{label}, {len(last.labels):,} labels: exponent {power:.2f}, {y[-1]:.2f} m",
            )
        )
    return panel
