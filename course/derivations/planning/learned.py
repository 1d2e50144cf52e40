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
    "A sampler that has learned where solutions are speeds a planner up.",
    "In worlds of the family it was trained on {learned:.0f} states and edges are asked in the "
    "median, {uniform:.0f} with uniform samples; a search of the picture that it is shown gives "
    "{search:.0f}. To ask for that picture takes {picture:.0f} states, if no camera brings it. And "
    "with all walls turned by a quarter it is the slower one, {turned:.0f} against "
    "{turned_uniform:.0f}: there only the uniform share still helps.",
    source="Ichter, Harrison and Pavone, Learning sampling distributions, ICRA 2018",
)
def learned_sampler_speeds_up(result):
    from course.charts.planning.learned import sampled
    from course.planning import learned

    costs = {}
    for name, label in (
        ("learned", "learned"),
        ("uniform", "uniform"),
        ("search", "search of the picture"),
        ("turned", "turned: learned"),
        ("turned_uniform", "turned: uniform"),
    ):
        costs[name] = result.measure(name, *numbers_in(rf"{label} +median +(\d+) checks"))
    worlds = [learned.slits(result.rng) for _ in range(40)]
    picture = result.measure("picture", learned.picture(worlds[0])[0].size)
    # What needs no training is asked again, in other worlds.
    untrained = sampled([None], worlds, "uniform", "search of the picture")
    again = {x.name: x.budget()[0] for x in untrained}
    result.statement = "200 held-out worlds, three networks; what needs none again in 40 others."

    def fewer(panel):
        """Return whether the learned one asks less, at several shares of the worlds."""
        some = (0.25, 0.5, 0.75, 0.9)
        return [within(panel, "learned", x) < within(panel, "uniform", x) for x in some]

    result.statement_holds(
        all(fewer(1) + fewer(2)),
        only_if="the world is of the family that it has learned, and its picture costs nothing",
        inside=fewer(1),
        outside=fewer(2),
        cases=True,
    )
    result.correction_holds(
        2 * costs["learned"] < costs["uniform"],
        costs["turned"] > 1.3 * costs["turned_uniform"],
        costs["learned"] < costs["search"] < costs["uniform"],
        picture > costs["uniform"],
        0.6 < again["uniform"] / costs["uniform"] < 1.6,
        again["search of the picture"] < 0.75 * again["uniform"],
    )


@claim(
    "A diffusion planner yields collision-free plans.",
    "It yields proposals. In the one world that it knows by heart {raw:.0%} of them collide, of "
    "lines that nobody has learned {bare:.0%}; pushed out of the discs, {raw_pushed:.0%} and "
    "{bare_pushed:.0%}. What makes plans of them is the check: with eight tries {solved:.0%} of "
    "the questions are solved as they come. RRT-Connect with shortcuts solves all, and half of "
    "them in {times:.1f} times less.",
    source="Janner and others, Planning with diffusion, ICML 2022",
)
def diffusion_is_collision_free(result):
    from course.charts.planning import learned as chart
    from course.planning import check_path, learned, scenes

    # Shares of first proposals that collide, as they come and pushed.
    (raw, raw_pushed), (bare, bare_pushed) = (
        np.array(numbers_in(rf"{name}, pushed out +(\d+)% collide, +(\d+)% once pushed")) / 100.0
        for name in ("noise", "bent lines")
    )
    shares = {"raw": raw, "bare": bare, "raw_pushed": raw_pushed, "bare_pushed": bare_pushed}
    for name, share in shares.items():
        result.measure(name, share)
    curves = _panels()[3]
    solved = result.measure("solved", max(curves["noise, checked"].y), 0.1)
    paths = [
        numbers_in(rf"{name}.* median ([\d.]+) ms")[0] for name in ("noise, checked", "RRT-Connect")
    ]
    times = result.measure("times", paths[0] / paths[1])
    world = scenes.discs(count=chart.DISCS).world
    requested = learned.questions(learned.grown(world), 40, result.rng)
    lines = [scenes.Scene("discs", world, q.start, q.goal, 1.0) for q in requested]
    first = [(q, chart.bent(q, 2, result.rng)[0]) for q in lines]
    again = np.mean([not check_path(world, path) for _, path in first])
    pushed = np.mean([not check_path(world, chart.pushed(q, path)) for q, path in first[:20]])
    result.statement = (
        "100 held-out questions, three networks; lines again, for 40 other questions."
    )
    result.statement_holds(raw == 0.0)
    result.correction_holds(
        raw > 0.4,
        raw < bare,
        raw_pushed < bare_pushed < 0.5 * bare,
        solved < 0.95,
        times > 1.0,
        max(curves["RRT-Connect"].y) == 1.0 == max(curves["noise, pushed out"].y),
        abs(again - bare) < 0.15,
        pushed < again - 0.3,
    )
