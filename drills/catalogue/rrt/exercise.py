"""RRT among discs: every run is replayed from its targets, every edge judged exactly."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt, Place
from drills.catalogue.rrt.replay import PROPERTIES, Fault, Run, drawn_from, faults
from drills.catalogue.rrt.slips import SLIPS
from drills.catalogue.rrt.worlds import (
    GOAL,
    HIGH,
    LOW,
    START,
    World,
    clutter,
    invalid_queries,
    worlds,
)
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise
from drills.grade_report import LEVELS, Shown
from drills.reasons import Reason
from drills.sandbox import Limits, Raised
from drills.values import Mismatch, as_float64, describe

Array = NDArray[np.float64]

GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")
BIAS = 0.1
SIGMAS = 4.75  # a right answer is beyond them once in 500 000 gradings
CELLS = 4  # along each axis, for the uniformity of the targets
LARGEST_CHI2 = 60.0  # 15 degrees of freedom: a right answer is above it once in 4 million
# Of several slips that let an edge pass, the grossest explains the others.
GROSSEST = (
    "start_for_parent",
    "nothing_checked",
    "vertices_only",
    "coarse_sampling",
    "last_edge_unchecked",
)
MOST_TWICE = 0.05
PARTS = ("path", "nodes", "parents", "samples")


def judge(attempt: Attempt) -> None:
    """Check one run in each world, replayed; then the targets, and queries that must be refused."""
    wrong = invalid_queries(attempt.rng)
    drawn = sorted(worlds(attempt.rng), key=lambda world: LEVELS.index(world.level))
    attempt.plan(
        [(world.level, world.label) for world in drawn]
        + [("core", "the targets"), ("edge", "where the numbers come from")]
        + [("edge", world.label) for world in wrong]
    )
    made: list[tuple[World, Run]] = []
    for index, world in enumerate(drawn):
        with attempt.part(index):
            run = _run(attempt, world)
        if run is None:
            return
        made.append((world, run))
    _report(attempt, made)
    if not attempt.failed:  # the targets of a run that is wrong tell nothing about the drawing
        with attempt.part(len(drawn)):
            _report_targets(attempt, made)
    if not attempt.failed:
        with attempt.part(len(drawn) + 1):
            _report_generator(attempt, made)
    for index, world in enumerate(wrong, len(drawn) + 2):
        with attempt.part(index):
            _refuses(attempt, world)
    if not attempt.failed:
        _report_cost(attempt, max(drawn, key=lambda world: world.closed * world.max_samples))


def _refuses(attempt: Attempt, world: World) -> None:
    try:
        answer, raised = _ask(attempt, world), None
    except Raised as error:
        answer, raised = None, error

    def outcome() -> Any:
        if raised is not None:
            raise raised
        return answer

    missing = "bounds_unchecked" if "bounds" in world.label else "collision_accepted"
    observed = isinstance(answer, list | tuple) and len(answer) == len(PARTS)
    if answer is None or (observed and answer[0] is None and not np.size(answer[3])):
        missing = "none_instead_of_an_error"  # it did notice
    elif not observed or attempt.failed:
        missing = ""
    attempt.require_error(
        world.label,
        outcome,
        sentence=f"The query must be refused with ValueError: {world.label}.",
        call=_typed(world),
        slip="" if raised else missing,
    )


def _ask(attempt: Attempt, world: World, seed: int | None = None) -> Any:
    chosen = int(attempt.rng.integers(1 << 31)) if seed is None else seed
    rng = attempt.learner.given_new("generator", chosen)
    return attempt.call(*world.arguments(), rng)


def _typed(world: World) -> str:
    values = [describe(argument, 40) for argument in world.arguments()]
    return f"rrt({', '.join(values)}, rng)"


def _run(attempt: Attempt, world: World, seed: int | None = None) -> Run | None:
    """Run the submission once; return the run as arrays, or None after a failed check."""
    got = _ask(attempt, world, seed)
    call = _typed(world)
    parts = attempt.parts(got, PARTS, call=call)
    if parts is None:
        return None
    try:
        path = None if parts[0] is None else _table(parts[0], "the path")
        nodes, samples = _table(parts[1], "the tree"), _table(parts[3], "samples")
        parents = as_float64(parts[2], None, "parents")
        parents = np.clip(parents, -2.0, 1e9)  # what is beyond is no index either
        if not np.array_equal(parents, parents.round()):
            raise Mismatch(Reason.WRONG_TYPE, "parents holds numbers that are not whole.")
        if parents.ndim != 1:
            raise Mismatch(
                Reason.WRONG_SHAPE,
                f"parents has shape {parents.shape}; integers of shape (m,) are asked for.",
            )
    except Mismatch as wrong:
        text = wrong.sentence[0].upper() + wrong.sentence[1:]
        attempt.require(world.label, False, sentence=text, call=call, reason=wrong.reason)
        return None
    return Run(path, nodes, parents.astype(np.int64), samples)


def _table(value: Any, what: str) -> Array:
    """Return rows (x, y); an empty list is no rows."""
    array = as_float64(value, None, what)
    if array.size == 0:
        return np.zeros((0, 2))
    if array.ndim != 2 or array.shape[1] != 2:
        raise Mismatch(
            Reason.WRONG_SHAPE, f"{what} has shape {array.shape}; rows (x, y) are asked for."
        )
    return array


def _report(attempt: Attempt, made: list[tuple[World, Run]]) -> None:
    """Check one check for each property in each world."""
    result = [faults(world, run) for world, run in made]
    everything = [fault for some in result for fault in some]
    ambiguous = len({fault.slip for fault in everything}) > 1
    for of in PROPERTIES:
        slip = _telling([fault for fault in everything if fault.of == of])
        # A refused step looks like this slip now and then; all of them together must.
        slip = "" if slip == "line_for_segment" and ambiguous else slip
        for index, ((world, run), some) in enumerate(zip(made, result, strict=True)):
            fault = next((fault for fault in some if fault.of == of), None)
            with attempt.part(index):
                attempt.require(
                    of,
                    fault is None,
                    sentence=f"{fault.sentence} (world: {world.label})" if fault else "",
                    call=_typed(world) if fault else "",
                    slip=slip,
                )
            if fault and attempt.report.shown is None:
                attempt.report.shown = Shown(world.label, world.arguments(), run, None)


def _telling(result: list[Fault]) -> str:
    """Return the most telling failure: the grossest of the edges, else the first named."""
    named = [fault.slip for fault in result if fault.slip]
    return next((slip for slip in GROSSEST if slip in named), next(iter(named), ""))


def _report_targets(attempt: Attempt, made: list[tuple[World, Run]]) -> None:
    """Check the share of goals and the evenness of the others, where all targets are drawn."""
    closed = [(world, run) for world, run in made if world.closed and len(run.samples)]
    goals = [(run.samples == world.goal).all(axis=1) for world, run in closed]
    total = sum(len(mask) for mask in goals)
    if total == 0:
        return
    share = sum(int(mask.sum()) for mask in goals) / total
    # Standard deviation of a binomial share.
    allowed = SIGMAS * math.sqrt(BIAS * (1.0 - BIAS) / total)
    attempt.require(
        "one target in ten is the goal",
        abs(share - BIAS) <= allowed,
        sentence=f"Of {total} targets, {100.0 * share:.3g} % are the goal; 10 % are asked for.",
        got=f"{share:.3g}",
        expected=f"{BIAS:g}",
        error=abs(share - BIAS),
        tolerance=allowed,
        unit="1",
        why=f"{SIGMAS:g} standard deviations of {total} draws",
        slip={0.0: "no_goal_bias", 1.0: "always_goal"}.get(share, ""),
    )
    if not attempt.failed:
        _report_chance(attempt, goals)
    # Scaled to the unit square, so that worlds of all sizes can be pooled.
    places = [
        (run.samples[~mask] - world.bounds[0]) / (world.bounds[1] - world.bounds[0])
        for (world, run), mask in zip(closed, goals, strict=True)
    ]
    even = _chi2(np.vstack(places))
    attempt.require(
        "other targets are uniform",
        even <= LARGEST_CHI2,
        sentence="The targets are not spread evenly over the world.",
        error=even,
        tolerance=LARGEST_CHI2,
        unit="1",
        why="chi-squared of the counts in 16 equal parts of the world",
        slip=drawn_from([(world, run.samples) for world, run in closed]),
    )
    points = np.vstack(places)
    twice = max(1.0 - len(np.unique(column)) / max(len(column), 1) for column in points.T)
    attempt.require(
        "other targets are new ones",
        twice <= MOST_TWICE,
        slip="own_generator" if _alike(closed) else "",
        sentence=f"Of the targets that are not the goal, {twice:.1%} have a coordinate that came "
        "before: they are drawn from a few values, or pushed onto the border.",
        got=f"{twice:.3g}",
        expected="0",
        error=twice,
        tolerance=MOST_TWICE,
        unit="1",
        why="a uniform number of 24 bits comes twice in one draw of 10 000",
    )


def _alike(closed: list[tuple[World, Run]]) -> bool:
    """Return whether runs with generators of their own sampled the same targets."""
    first = [run.samples[:9] for world, run in closed if np.array_equal(world.bounds, [LOW, HIGH])]
    return len(first) > 1 and all(np.array_equal(first[0], other) for other in first[1:])


def _report_chance(attempt: Attempt, goals: list[NDArray[np.bool_]]) -> None:
    """Check whether the goal comes by chance: then the waiting times differ."""
    waits = np.concatenate([np.diff(np.flatnonzero(mask)) for mask in goals])
    attempt.require(
        "the goal is drawn by chance",
        bool(len(np.unique(waits)) > 1),
        sentence=f"The goal comes regularly, every {waits[0] if len(waits) else 0} targets. Draw "
        "each time whether it is the goal.",
    )


def _chi2(places: Array) -> float:
    """Return how uneven the counts of points in CELLS x CELLS parts of the unit square are."""
    if len(places) == 0:
        return 0.0
    cells = np.clip((places * CELLS).astype(int), 0, CELLS - 1)
    counts = np.bincount(cells[:, 0] * CELLS + cells[:, 1], minlength=CELLS**2)
    expected = len(places) / CELLS**2
    return float(((counts - expected) ** 2).sum() / expected)


def _report_generator(attempt: Attempt, made: list[tuple[World, Run]]) -> None:
    """Check another generator must draw other targets, and the same one the same."""
    if attempt.failed:
        return
    world = min((w for w, _ in made if w.closed), key=lambda w: w.max_samples)
    before = next(run for w, run in made if w is world)
    again = _run(attempt, world)
    if again is None:
        return
    attempt.require(
        "random numbers come from rng",
        not np.array_equal(before.samples, again.samples),
        sentence="Two generators with different seeds led to the same targets.",
        call=_typed(world),
        slip="own_generator",
    )
    seed = int(attempt.rng.integers(1 << 31))
    same = [_run(attempt, world, seed) for _ in range(2)]
    if same[0] is None or same[1] is None:
        return
    attempt.require(
        "nothing but rng decides",
        np.array_equal(same[0].samples, same[1].samples)
        and np.array_equal(same[0].nodes, same[1].nodes),
        sentence="The same query with the same seed of rng gave another tree. Every random number "
        "has to come from rng: none from a generator of your own, numpy.random or random.",
        call=_typed(world),
        reason=Reason.NOT_DETERMINISTIC,
    )


def _report_cost(attempt: Attempt, world: World) -> None:
    """Time the longest run, here and there, with the same random numbers."""
    seed = int(attempt.rng.integers(1 << 31))
    child, reference = attempt.learner.child, attempt.reference
    rng = child.given_new("generator", seed)
    child.call(attempt.card.entry, *world.arguments(), rng)
    yours = child.elapsed
    reference.call(attempt.card.entry, *world.arguments(), reference.given_new("generator", seed))
    attempt.cost(
        f"time for {world.max_samples} targets", "s", yours=yours, reference=reference.elapsed
    )


def tree(figure: Any, shown: Shown) -> None:
    """Plot the world, the tree that came back and its path."""
    from matplotlib.patches import Circle, Rectangle

    start, goal, discs, bounds, _, _ = shown.args
    run: Run = shown.got
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    axes.add_patch(Rectangle(bounds[0], *(bounds[1] - bounds[0]), fill=False, lw=1.0))
    for x, y, radius in discs:
        axes.add_patch(Circle((x, y), radius, color="0.75"))
    for i, parent in enumerate(run.parents[: len(run.nodes)]):
        if 0 <= parent < len(run.nodes):
            axes.plot(*run.nodes[[parent, i]].T, color="tab:blue", lw=0.6)
    if run.path is not None:
        axes.plot(*run.path.T, **picture.YOURS | {"label": "your path"})
    axes.plot(*start, "o", color="tab:green", label="start")
    axes.plot(*goal, "*", color="tab:orange", ms=10, label="goal")
    axes.legend(loc="upper left")


def queries(attempt: Attempt) -> Plan:
    """Return queries left unsolved against the targets that one may draw, beside OMPL's RRT."""
    from course.oracles import ompl

    discs = clutter(np.random.default_rng(attempt.report.seed), 40, 0.3, 0.6)
    step, seeds = 0.5, list(range(1, 21))
    query = START, GOAL, discs, np.array([LOW, HIGH]), step
    budgets = {1.0 / n: n for n in (50, 100, 200, 400, 800)}

    def result(solved: int, drawn: int) -> tuple[list[float], float]:
        # Laplace's estimate: none unsolved of twenty is no proof that none ever will be.
        return [(len(seeds) - solved + 1) / (len(seeds) + 2)], drawn / len(seeds)

    def ask(place: Place, setting: float) -> tuple[list[float], float]:
        return result(*map(int, place.given("drive", *query, budgets[setting], seeds)))

    def library(setting: float) -> tuple[list[float], float]:
        plans = [ompl.rrt(*query, budgets[setting], seed) for seed in seeds]
        return result(sum(p.path is not None for p in plans), sum(p.samples for p in plans))

    return Plan(list(budgets), ask, truth=[0.0], check=[0.0], libraries={"OMPL RRT": library})


EXERCISE = Exercise(
    judge=judge,
    given=GIVEN,
    limits=Limits(load=10.0, call=10.0, total=90.0),
    examples=(
        "rrt([0, 0], [0.4, 0.3], [], [[-1, -1], [1, 1]], 0.5, 100, np.random.default_rng(4))[0]",
        "rrt([0, 0], [0, 0], [], [[-1, -1], [1, 1]], 0.5, 100, np.random.default_rng(1))[0]",
        "rrt([-2, 0], [2, 0], [[0, 0, 1]], [[-3, -3], [3, 3]], 1.5, 500, "
        "np.random.default_rng(3))[0].round(3)",
    ),
    picture=tree,
    chart=chart_of(
        "RRT among discs, 20 runs; setting: 1 / targets allowed",
        queries,
        unit="targets drawn, mean of 20 runs",
        tolerance=0.1,
        error_unit="share unsolved",
        repeats=2,
        converges=False,
    ),
    slips=SLIPS,
)
