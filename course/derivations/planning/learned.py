"""Claims of chapter 5: planners that have learned, as the chart `learned_planners` has them."""

import functools
import re
from typing import Any

import numpy as np

from course.derivations import claim

CHART = "learned_planners"


@functools.cache
def _panels() -> list[Any]:
    from course.charts import stored

    return stored(CHART)


def numbers_in(words: str) -> list[float]:
    """Return the numbers in a line of the chart's table."""
    from course.charts import read

    result = re.search(f"^{words}", read(CHART), re.MULTILINE)
    assert result is not None
    return [float(x) for x in result.groups()]


def within(panel: int, name: str, share: float) -> float:
    """Return the cost within which that share is solved, between points of a curve.

    It is infinite beyond the curve.
    """
    series = _panels()[panel][name]
    if max(series.y) < share:
        return float("inf")
    k = int(np.argmax(np.asarray(series.y) >= share))
    return float(np.interp(share, series.y[k - 1 : k + 1], series.x[k - 1 : k + 1]))


@claim(
    "A sampler that has learned where solutions lie speeds up a planner on easy and hard queries.",
    "In worlds of the family that it was trained on, the planner checks {learned:.0f} "
    "configurations and edges in the median, against {uniform:.0f} with uniform samples; with "
    "samples along a grid search of the same occupancy grid, {search:.0f}. If no camera provides "
    "that grid, filling it takes {picture:.0f} checks, more than the median query saves; only "
    "hard queries still gain. With all walls rotated by a quarter turn, "
    "the learned sampler is the slower one, {turned:.0f} against {turned_uniform:.0f}.",
    source="Ichter, Harrison and Pavone, Learning sampling distributions, ICRA 2018",
)
def learned_sampler_speeds_up(result):
    from course.charts.planning.learned import sampled
    from course.planning import learned

    costs = {}
    for name, label in (
        ("learned", "learned"),
        ("uniform", "uniform"),
        ("search", "grid search"),
        ("turned", "turned: learned"),
        ("turned_uniform", "turned: uniform"),
    ):
        costs[name] = result.measure(name, *numbers_in(rf"{label} +median +(\d+) checks"))
    worlds = [learned.slits(result.rng) for _ in range(40)]
    picture = result.measure("picture", learned.picture(worlds[0])[0].size)
    # What needs no training is asked again, in other worlds.
    untrained = sampled([None], worlds, "uniform", "grid search")
    again = {x.name: x.budget()[0] for x in untrained}
    result.statement = (
        "200 held-out worlds, three networks; the methods without a network again in 40 others."
    )

    def fewer(panel, name="learned"):
        """Return whether the learned one asks less, at several shares of the worlds."""
        some = (0.25, 0.5, 0.75, 0.9)
        return [within(panel, name, x) < within(panel, "uniform", x) for x in some]

    filled = fewer(1, "learned, grid counted")

    result.statement_holds(
        all(fewer(1) + fewer(2)),
        only_if="the worlds resemble those of the training, and the occupancy grid costs nothing",
        # Chosen to break it: from the easiest quarter of the queries to nine in ten; outside, the
        # same worlds turned, and an occupancy grid that the planner has to fill itself.
        inside=fewer(1),
        outside=fewer(2) + filled,
        cases=True,
    )
    result.correction_holds(
        2 * costs["learned"] < costs["uniform"],
        costs["turned"] > 1.3 * costs["turned_uniform"],
        costs["learned"] < costs["search"] < costs["uniform"],
        picture > costs["uniform"],
        # With the grid filled by checks: slower up to the median, faster at the 90th percentile.
        not any(filled[:2]),
        filled[3],
        0.6 < again["uniform"] / costs["uniform"] < 1.6,
        again["grid search"] < 0.75 * again["uniform"],
    )


@claim(
    "A diffusion planner returns collision-free plans.",
    "It returns proposals. In the one world that it was trained in, {raw:.0%} of them collide, of "
    "randomly bent lines {bare:.0%}; after a step that pushes them out of the discs, "
    "{raw_pushed:.0%} and {bare_pushed:.0%}. Only the collision check turns proposals into plans: "
    "with eight proposals per query and no pushing, {solved:.0%} of the queries are solved. "
    "RRT-Connect with shortcuts solves all of them, and half of them in a time {times:.1f} times "
    "shorter.",
    source="Janner and others, Planning with diffusion, ICML 2022",
)
def diffusion_is_collision_free(result):
    from course.charts.planning import learned as chart
    from course.planning import check_path, learned, scenes

    # Shares of first proposals that collide, as they come and pushed.
    (raw, raw_pushed), (bare, bare_pushed) = (
        np.array(numbers_in(rf"{name}, pushed out +(\d+)% collide, +(\d+)% once pushed")) / 100.0
        for name in ("diffusion", "bent lines")
    )
    shares = {"raw": raw, "bare": bare, "raw_pushed": raw_pushed, "bare_pushed": bare_pushed}
    for name, share in shares.items():
        result.measure(name, share)
    curves = _panels()[3]
    solved = result.measure("solved", max(curves["diffusion, checked"].y), 0.1)
    paths = [
        numbers_in(rf"{name}.* median ([\d.]+) ms")[0]
        for name in ("diffusion, checked", "RRT-Connect")
    ]
    times = result.measure("times", paths[0] / paths[1])
    world = scenes.discs(count=chart.DISCS).world
    requested = learned.questions(learned.grown(world), 40, result.rng)
    lines = [scenes.Scene("discs", world, q.start, q.goal, 1.0) for q in requested]
    first = [(q, chart.bent(q, 2, result.rng)[0]) for q in lines]
    again = np.mean([not check_path(world, path) for _, path in first])
    pushed = np.mean([not check_path(world, chart.pushed(q, path)) for q, path in first[:20]])
    result.statement = (
        "100 held-out queries, three networks; the bent lines again for 40 other queries."
    )
    result.statement_holds(raw == 0.0)
    result.correction_holds(
        raw > 0.4,
        raw < bare,
        raw_pushed < bare_pushed < 0.5 * bare,
        solved < 0.95,
        times > 1.0,
        max(curves["RRT-Connect"].y) == 1.0 == max(curves["diffusion, pushed out"].y),
        abs(again - bare) < 0.15,
        pushed < again - 0.3,
    )
