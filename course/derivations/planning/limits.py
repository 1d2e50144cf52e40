"""Claims of chapter 5: steps, ends that are blocked, heavy tails, and what a model leaves out."""

import functools
import itertools
from typing import Any

import numpy as np

from course.derivations import claim
from course.derivations.planning import samples


@claim(
    "A narrow passage needs a small step size.",
    "Through an opening of {slit:.0%} of a wall RRT takes {slit_short:.0f} samples with steps of "
    "{short} m, {slit_middle:.0f} with {middle:.0f} m and {slit_long:.0f} with {long:.0f} m; "
    "among discs {discs_short:.0f}, {discs_middle:.0f} and {discs_long:.0f}. Which step size is "
    "best depends on the planner too. In a bug trap, the change from {middle:.0f} m to {long:.0f} "
    "m takes RRT from {cage_middle:.0f} samples to {cage_long:.0f}, and RRT-Connect from "
    "{trap_middle:.0f} to {trap_long:.0f}.",
)
def step_through_a_passage(result):
    steps = {"short": 0.1, "middle": 1.0, "long": 10.0}
    steps = {name: result.input(name, step) for name, step in steps.items()}
    slit, middles = result.input("slit", 0.02), {}
    for place, method, *at in (
        ("gap", "rrt", slit, 0.5),
        ("discs", "rrt"),
        ("bug_trap", "rrt"),
        ("bug_trap", "rrt_connect"),
    ):
        name = {"gap": "slit", "bug_trap": "cage" if method == "rrt" else "trap"}.get(place, place)
        for size, step in steps.items():
            if (name, size) == ("cage", "short"):
                continue
            drawn = np.median(
                samples(place, method, 40 if size == "short" else 150, *at, step=step)
            )
            middles[name, size] = result.measure(f"{name}_{size}", drawn, 0.1)
    result.statement = "Medians of 150 seeds, with the short step 40; a square of ten metres."
    result.statement_holds(middles["slit", "short"] < middles["slit", "middle"])
    result.correction_holds(
        middles["slit", "long"] < middles["slit", "short"],
        middles["discs", "short"] > 5.0 * middles["discs", "middle"],
        middles["trap", "long"] > 4.0 * middles["trap", "middle"],
        middles["cage", "long"] < 0.1 * middles["cage", "middle"],
    )


@claim(
    "A planner reports at once that its start or its goal is in collision.",
    "All {methods:.0f} methods of this chapter name the end that is in collision, without a "
    "single sample. OMPL's RRT and RRT-Connect also stop at once if the start is in collision. If "
    "the goal is, RRT takes all of its {budget:.0f} samples and grows {grown:.0f} nodes, because "
    "it only measures its distance to the goal; RRT-Connect waits for another goal state until "
    "its budget is used up. Check both ends yourself.",
)
def blocked_ends_are_named(result):
    from course.oracles import ompl
    from course.planning import METHODS, build_roadmap, plan, scenes

    requested, inside = scenes.gap(0.1), np.array([5.0, 1.0])
    ends = {"start": (inside, requested.goal), "goal": (requested.start, inside)}
    cached: dict[str, dict[str, Any]] = {
        "roadmap": {"roadmap": build_roadmap(requested.world, 50, 0)}
    }
    ours = {
        end: [plan(requested.world, *pair, method=x, **cached.get(x, {})) for x in METHODS]
        for end, pair in ends.items()
    }
    budget = result.input("budget", 300)
    theirs = {
        (end, x): ompl.solve(
            requested.world.bounds, *pair, x, 1.0, budget, 1, *ompl.tests(requested.world)
        )
        for end, pair in ends.items()
        for x in ("rrt", "rrt_connect")
    }
    result.measure("methods", len(ours["start"]))
    named = all(x.status == f"{end} in collision" for end, some in ours.items() for x in some)
    spent = {x: theirs["goal", x].samples for x in ("rrt", "rrt_connect")}
    grown = result.measure("grown", len(theirs["goal", "rrt"].nodes), 0.3)
    result.statement = "Each method of `plan`, and OMPL's RRT and RRT-Connect, in front of a wall."
    result.statement_holds(named and max(spent.values()) < budget)
    result.correction_holds(
        named,
        not any(x.samples or x.nodes.size for some in ours.values() for x in some),
        all(theirs["start", x].samples == 0 for x in ("rrt", "rrt_connect")),
        grown > budget / 3,
        min(spent.values()) == budget,
        len(theirs["goal", "rrt_connect"].nodes) <= 1,
        all(x.path is None for x in theirs.values()),
    )


@functools.cache
def _tight():
    """Return the tight shelf, 36 queries, and samples of RRT-Connect with 5 seeds each, (36, 5)."""
    from course.planning import plan, shelf

    requested, rng = shelf("tight"), np.random.default_rng(0)
    queries = [requested.query(rng) for _ in range(36)]
    plans = [
        [plan(requested.world, *q, rng=k, step=1.0, budget=50_000) for k in range(5)]
        for q in queries
    ]
    return (
        requested,
        queries,
        np.array([[x.samples if x.solved else np.inf for x in p] for p in plans]),
    )


@claim(
    "Slow plans at the tight shelf are slow more because of the query than because of the seed.",
    "There {between:.0%} of the variance of the logarithm of the samples of RRT-Connect lies "
    "between queries, the rest between seeds. So another seed helps somewhat: the slowest tenth "
    "of the runs took {slow:.0f} samples in the median, and with other seeds the same queries "
    "take {again:.0f}. But that is still far above the median of all runs, {all:.0f}. What makes "
    "a query hard is the way out of the compartment. Take the end that is harder to leave, and "
    "count how many random steps of one radian are free there: the fewer, the more samples (rank "
    "correlation {out:.2f}; for the clearance there {clear:.2f}). The half of the queries with "
    "fewer free steps takes {hard:.0f} samples in the median, the other half {easy:.0f}.",
)
def slow_plans_are_slow_questions(result):
    from scipy import stats

    from course.planning import clearance, edge_free

    requested, queries, spent = _tight()
    targets = result.rng.uniform(*requested.world.bounds, (100, 7))

    def way_out(q):
        along = targets - q
        along /= np.maximum(np.linalg.norm(along, axis=1), 1.0)[:, None]
        return np.mean([edge_free(requested.world, q, q + step) for step in along])

    share = np.array([min(way_out(q) for q in ends) for ends in queries])
    gaps = [min(clearance(requested.world, q) for q in ends) for ends in queries]
    middles, logs = np.median(spent, axis=1), np.log(spent)
    # What the scatter of five seeds adds to the means of questions is taken off.
    within = logs.var(axis=1, ddof=1).mean()
    between = logs.mean(axis=1).var(ddof=1) - within / spent.shape[1]
    part = result.measure("between", between / (between + within), 0.1)
    out = result.measure("out", stats.spearmanr(share, middles).statistic, 0.1)
    clear = result.measure("clear", stats.spearmanr(gaps, middles).statistic, 0.3)
    narrow = share <= np.median(share)
    hard = result.measure("hard", np.median(middles[narrow]), 0.2)
    easy = result.measure("easy", np.median(middles[~narrow]), 0.2)
    tail = spent[:, 0] >= np.percentile(spent[:, 0], 90)
    slow = result.measure("slow", np.median(spent[tail, 0]), 0.2)
    again = result.measure("again", np.median(spent[tail, 1:]), 0.2)
    usual = result.measure("all", np.median(spent), 0.2)
    result.statement = "36 queries of the seven-joint arm, five seeds each."
    result.statement_holds(part > 0.5)
    result.correction_holds(
        out < -0.6, abs(clear) < abs(out), hard > 2.0 * easy, 3.0 * usual < again < slow
    )


@claim(
    "The joint limits of an arm keep it from hitting itself.",
    "With its links as capsules, the seven-joint arm collides with itself in {uniform:.0%} of the "
    "configurations within its limits, by the distances of the library Coal. For paths that a "
    "planner finds without checking this, it depends on the longest edge. Of {asked:.0f} paths "
    "between compartments with edges of at most {short:.0f} rad, {open:.1%} touch the arm itself "
    "at the open shelf and {tight:.1%} at the tight one. With the default of {default:.1f} rad "
    "they are {open_default:.0%} and {tight_default:.0%}, and links overlap by up to {deep_mm:.0f} "
    "mm. The paths were checked at points, which can miss contacts, so the true shares may be "
    "higher. Check every edge against the arm itself.",
)
def limits_keep_an_arm_from_itself(result):
    from course import contact
    from course.kinematics import compose, frames, panda, tip, turn_to
    from course.oracles import coal
    from course.planning import plan, shelf
    from course.planning.capsules import HAND

    arm, shapes, places = panda(), [], []
    for _, a, b, radius in HAND:
        along = np.subtract(b, a)
        shapes.append(contact.capsule(radius, 0.5 * float(np.linalg.norm(along))))
        places.append(np.append(0.5 * np.add(a, b), turn_to(along))[:, None])
    # The next two overlap at their joints in any posture.
    pairs = [(i, j) for i, j in itertools.combinations(range(len(HAND)), 2) if j > i + 2]
    tests = [coal.Pair(shapes[i], shapes[j]) for i, j in pairs]

    def gaps(states):
        """Return the least distance of two non-adjacent capsules, states (7, m) -> (m,) [m]."""
        at = np.concatenate((frames(arm, states), tip(arm, states)[:, None]), axis=1)
        poses = [
            coal.transforms(compose(at[:, row[0]], x)) for row, x in zip(HAND, places, strict=True)
        ]
        distances = [x.loop(poses[i], poses[j]) for x, (i, j) in zip(tests, pairs, strict=True)]
        return np.min(distances, axis=0)

    states = result.rng.uniform(arm.lower, arm.upper, (500, 7)).T
    number, share, deepest = result.input("asked", 60), {}, 0.0
    short = result.input("short", 1.0)
    default = result.measure("default", 0.2 * shelf("open").world.extent, 1e-9)
    # Of a record of 0 a tolerance is absolute.
    for suffix, step, tolerances in (("", short, (0.05, 0.5)), ("_default", default, (0.4, 0.4))):
        for name, tolerance in zip(("open", "tight"), tolerances, strict=True):
            place, rng = shelf(name), np.random.default_rng(0)
            touching = []
            for k in range(number):
                path = plan(place.world, *place.query(rng), rng=k, step=step, budget=200_000).path
                assert path is not None
                edges = [
                    np.linspace(a, b, 2 + int(10.0 * np.linalg.norm(b - a)))
                    for a, b in itertools.pairwise(path.T)
                ]
                touching.append(gaps(np.vstack(edges).T).min())
            measured = np.mean(np.array(touching) < 0.0)
            share[name + suffix] = result.measure(name + suffix, measured, tolerance)
            deepest = min(deepest, *touching)
    result.measure("deep_mm", -1000.0 * deepest, 0.3)
    hits = result.measure("uniform", np.mean(gaps(states) < 0.0), 0.1)
    result.statement = (
        "500 configurations; paths of RRT-Connect at each shelf, at points 0.1 rad apart or less."
    )
    result.statement_holds(hits == 0.0)
    result.correction_holds(
        hits > 0.1,
        *(share[name] < 0.5 * hits for name in ("open", "tight")),
        *(share[f"{name}_default"] > 2.0 * share[name] for name in ("open", "tight")),
    )
