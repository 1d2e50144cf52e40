"""Claims of chapter 5: what a tree finds, and after how many samples."""

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.planning import runs, samples, through_gap

SYMBOLS = {"w": Symbol("width of the opening [1]", 0.001, 0.2)}
BOTH = ("rrt", "rrt_connect")
GAPS = {"wide": 0.5, "narrow": 0.1, "slit": 0.02}  # share of the wall that is open


@claim(
    "RRT repeats one loop: draw a state, take the nearest node, go a step towards the state, keep "
    "the new node if the edge to it is free.",
    "Written out, this loop grows the chapter's trees node by node, {nodes:.0f} nodes in "
    "{worlds:.0f} worlds of discs. Two things go unsaid: a state nearer than a step is itself the "
    "new node, so {short:.0%} of the edges are shorter; and the goal needs a free edge of its own.",
    source="LaValle, Rapidly-exploring random trees, 1998",
)
def rrt_loop(result):
    from course.drills import rrt
    from course.planning import plan, scenes

    same, nodes, edges = [], 0, []
    for seed in range(result.input("worlds", 20)):
        requested = scenes.discs(seed)
        world, discs = requested.world, requested.world.obstacles[:, 1:4]
        ours = plan(
            world,
            requested.start,
            requested.goal,
            method="rrt",
            budget=500,
            rng=seed,
            step=1.0,
            goal_bias=0.1,
        )
        rng = np.random.default_rng(seed)
        _, tree, parents, _ = rrt(
            requested.start, requested.goal, discs, world.bounds, 1.0, 500, rng
        )
        same.append(np.array_equal(parents, ours.parents) and np.allclose(tree.T, ours.nodes))
        nodes += len(tree)
        edges.append(np.linalg.norm(tree[1:] - tree[parents[1:]], axis=1))
    result.measure("nodes", nodes, 0.02)
    result.measure("short", np.mean(np.concatenate(edges) < 1.0 - 1e-9), 0.05)
    result.statement = "The loop in plain Python against the compiled planner, with the same draws."
    result.statement_holds(all(same))
    result.correction_holds(
        all(same),
        any((x < 1.0 - 1e-9).any() for x in edges),
        max(x.max() for x in edges) < 1.0 + 1e-9,
    )


@claim(
    "RRT finds a path eventually if there is one.",
    "So it is proved for open sets: a path must keep some clearance. Eventually is no number: "
    "through a slit of {slit:.0%} of the wall half the runs take {half:.0f} samples, one in twenty"
    " {late:.0f} or more. And without a path it never says so: a walled-in goal spends any budget,"
    " in the same words as {failed:.0%} of the runs through the slit with {budget:.0f} samples.",
    source="LaValle and Kuffner, Randomized kinodynamic planning, 2001, theorem 3",
)
def rrt_complete(result):
    from course import planning
    from course.planning import plan, plane, scenes

    slit, budget = result.input("slit", 0.02), result.input("budget", 500)
    spent = samples("gap", "rrt", 300, slit, 0.5)
    result.measure("half", np.median(spent), 0.1)
    result.measure("late", np.percentile(spent, 95), 0.2)
    early = runs("gap", "rrt", 200, slit, 0.5, budget=budget)
    result.measure("failed", np.mean([not x.solved for x in early]), 0.1)
    ring = [[8, 8, 10, 8.2], [8, 9.8, 10, 10], [8, 8, 8.2, 10], [9.8, 8, 10, 10]]
    ends = plane(scenes.SQUARE, boxes=ring), scenes.START, scenes.GOAL
    # A way without any width: one line through the wall.
    line = planning.from_function(
        lambda q: abs(q[0] - 5.0) > 0.25 or q[1] == 5.0, scenes.SQUARE, 0.1
    )
    by_line = [
        plan(line, [1.0, 2.0], [9.0, 2.0], method="rrt", budget=3000, rng=k, step=1.0).solved
        for k in range(8)
    ]
    walled = [plan(*ends, method=x, budget=5000).status for x in ("rrt", "rrt_connect", "prm")]

    def answered(scene, at_most, **options):
        return plan(
            scene.world,
            scene.start,
            scene.goal,
            method="rrt",
            budget=at_most,
            rng=result.rng,
            **options,
        ).solved

    def solved(bias, at_most):
        scene = scenes.gap(result.rng.uniform(0.05, 0.6), result.rng.uniform(0.05, 3.0))
        return answered(scene, at_most, step=result.rng.uniform(0.3, 3), goal_bias=bias)

    def turned():
        """Return a thin wall with an opening, at any angle through the middle of the square."""
        angle = result.rng.uniform(0.0, np.pi)
        along, across = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        half = result.rng.uniform(0.2, 0.5)
        walls = [
            [5.0 + s * along + t * across for s, t in ((a, -0.1), (b, -0.1), (b, 0.1), (a, 0.1))]
            for a, b in ((-9.0, -half), (half, 9.0))
        ]
        side = 2.0 * across + 1.5 * along
        world = plane(scenes.SQUARE, polygons=walls)
        return scenes.Scene("turned", world, 5.0 - side, 5.0 + side, 1.0)

    # Chosen to break the condition: a trap in which nine targets of ten are the goal behind its
    # back, walls at any angle, short and long steps, an arm, a sequence instead of random targets.
    attacked = [
        *(answered(scenes.bug_trap(), 300_000, step=x, goal_bias=0.9) for x in (0.3, 1.0, 10.0)),
        *(answered(turned(), 300_000, step=x, goal_bias=0.5) for x in (0.1, 0.5, 3.0, 10.0)),
        *(answered(scenes.arm(), 300_000, step=x, goal_bias=0.5) for x in (0.3, 1.0)),
        answered(scenes.bug_trap(), 300_000, step=1.0, sampler="halton"),
    ]
    # Targets on the start's side of the wall only: the tree has no reason to look for the gap.
    half_square = result.rng.uniform((0.0, 0.0), (4.0, 10.0), (500, 2)).T
    one_sided = [answered(scenes.gap(0.05), 3000, step=0.5, sampler=half_square) for _ in range(4)]
    result.statement = (
        "300 seeds through the slit; random gaps, steps and biases; a trap, turned walls, an arm."
    )
    result.statement_holds(
        solved(1.0, 5000),
        only_if="a path keeps clear, and targets come from everywhere: a goal bias below 1",
        inside=[solved(bias, 300_000) for bias in result.rng.uniform(0.0, 0.8, 20)] + attacked,
        outside=[solved(1.0, 5000) for _ in range(16)] + by_line + one_sided,
    )
    result.correction_holds(
        all(x.solved for x in runs("gap", "rrt", 300, slit, 0.5)),
        {x.status for x in early if not x.solved} == set(walled),
        not any(by_line),
        np.percentile(spent, 95) > 3 * np.median(spent),
    )


@claim(
    "RRT-Connect is two RRTs, one from the start and one from the goal.",
    "The second half of the name counts: the other tree goes on towards the new node, step after "
    "step, until it is there or blocked. Among nothing one sample is enough, in {open:.0f} of "
    "{questions:.0f} random questions; two RRTs that add an edge each a sample need d / (2 step) "
    "of them, here {least:.0f}. One sample adds {added:.0f} nodes.",
    source="Kuffner and LaValle, RRT-Connect, ICRA 2000",
)
def connect_is_two_rrts(result):
    from course.planning import plan, scenes

    empty = scenes.empty()
    questions = result.rng.uniform(*empty.world.bounds, (result.input("questions", 200), 2, 2))
    one = [
        plan(empty.world, a, b, rng=k, step=result.rng.uniform(0.05, 3.0)).samples == 1
        for k, (a, b) in enumerate(questions)
    ]
    least = np.ceil(np.linalg.norm(empty.goal - empty.start) / (2 * empty.step))
    result.measure("open", sum(one))
    result.measure("least", least)
    # The two roots are there before, and the state where the trees meet is in both.
    added = [x.nodes.shape[1] - 3 for x in runs("empty", "rrt_connect", 200)]
    result.measure("added", np.median(added), 0.1)
    result.statement = "200 random questions in an empty square, 200 seeds of one."
    result.statement_holds(min(samples("empty", "rrt_connect", 200)) >= least)
    result.correction_holds(all(one), least > 1, np.median(added) > 2)


@claim(
    "Through a gap of 50, 10 and 2 per cent of a wall RRT takes about 80, 2,500 and 60,000 "
    "samples for a path 1.4, 1.8 and 2.5 times the shortest; RRT-Connect 30, 400 and 8,000 for "
    "1.3, 1.5 and 2.0.",
    "In a square of {side_m:.0f} m with a wall of {wall_m} m and a step of {step_m:.0f} m the "
    "medians are {rrt_wide:.0f}, {rrt_narrow:.0f} and {rrt_slit:.0f} for RRT, {connect_wide:.0f}, "
    "{connect_narrow:.0f} and {connect_slit:.0f} for RRT-Connect, with half of RRT's runs in the "
    "slit from {low:.0f} to {high:.0f}; a step of {short_m} m makes {short_wide:.0f} of the first. "
    "A gap that is hard to find doesn't bend RRT's path: {rrt_wide_length:.2f}, "
    "{rrt_narrow_length:.2f} and {rrt_slit_length:.2f} times the shortest, against "
    "{connect_wide_length:.2f}, {connect_narrow_length:.2f} and {connect_slit_length:.2f}, all of "
    "it waste: after shortcutting the slit's are within {after:.1%}.",
)
def gap_table(result):
    from course.planning import length, scenes, shortcut

    wall, short = result.input("wall_m", 0.5), result.input("short_m", 0.1)
    scene = scenes.gap(0.02, wall)
    result.measure("side_m", scene.world.bounds[1, 0])
    result.measure("step_m", scene.step)
    report = {"rrt": (80, 2500, 60_000), "rrt_connect": (30, 400, 8000)}
    ratios, over, after = [], {}, []
    for method in BOTH:
        tag = method.split("_")[-1]
        for (name, share), number in zip(GAPS.items(), report[method], strict=True):
            answers, best = runs("gap", method, 300, share, wall), through_gap(share, wall)
            middle = np.median([x.samples for x in answers])
            ratios.append(result.measure(f"{tag}_{name}", middle, 0.1) / number)
            over[tag, name] = np.median([x.cost for x in answers]) / best
            result.measure(f"{tag}_{name}_length", over[tag, name], 0.02)
        after += [length(shortcut(x.path, scene.world, result.rng)) / best for x in answers[:25]]
    result.measure("after", np.median(after) - 1, 0.3)
    low, high = np.percentile(samples("gap", "rrt", 300, 0.02, wall), (25, 75))
    result.measure("low", low, 0.2)
    result.measure("high", high, 0.2)
    shorter = result.measure(
        "short_wide", np.median(samples("gap", "rrt", 60, 0.5, wall, step=short)), 0.1
    )
    result.statement = "300 seeds of each; the shortest path goes around two corners of the gap."
    result.statement_holds(all(0.5 < ratio < 2.0 for ratio in ratios))
    result.correction_holds(
        all(ratio < 0.5 for ratio in ratios),
        high > 3 * low,
        min(after) > 1 - 1e-9,
        abs(over["rrt", "slit"] - over["rrt", "wide"]) < 0.1,
        np.median(after) < 1.02,
        shorter > 5 * np.median(samples("gap", "rrt", 300, 0.5, wall)),
    )


@claim(
    "RRT-Connect is 3 to 8 times faster in narrow passages, as each tree finds half of them.",
    "In samples, means of {seeds:.0f} seeds, it is {wide:.0f} times faster through half a wall, "
    "{narrow:.1f} times through a tenth and {slit:.1f} times through a slit of a fiftieth; in "
    "edges checked there {edges:.1f} times. Halves of a passage are not why: through a tenth of "
    "a wall of {thin_m} m it is {thin:.1f} times faster, of {thick_m} m it is {thick:.1f}. What it "
    "saves is the way to the passage: {trap:.0f} times in a bug trap, {empty:.0f} in the open. All "
    "with a step of {step_m:.0f} m; with {long_m:.0f} m one tree sees as far, and in the trap RRT "
    "takes {trap_long:.0%} of RRT-Connect's samples.",
)
def connect_in_narrow_passages(result):
    from course.planning import scenes

    seeds = result.input("seeds", 300)
    walls = result.input("thin_m", 0.05), result.input("thick_m", 6.0)

    def gain(*place, scene="gap", what="samples", count=seeds, **options):
        rrt, connect = (
            np.mean([getattr(x, what) for x in runs(scene, y, count, *place, **options)])
            for y in BOTH
        )
        return rrt / connect

    gains = {name: result.measure(name, gain(share, 0.5), 0.1) for name, share in GAPS.items()}
    edges = result.measure("edges", gain(0.02, 0.5, what="edge_checks"), 0.1)
    trap = result.measure("trap", gain(scene="bug_trap"), 0.15)
    empty = result.measure("empty", gain(scene="empty"), 0.15)
    thin = result.measure("thin", gain(0.1, walls[0]), 0.1)
    thick = result.measure("thick", gain(0.1, walls[1]), 0.1)
    result.measure("step_m", scenes.bug_trap().step)
    far = {"count": 100, "step": result.input("long_m", 10.0)}
    trap_long = result.measure("trap_long", gain(scene="bug_trap", **far), 0.3)
    # With other steps a passage a hundred times as long gains a little, not a multiple.
    others = [
        gain(0.1, walls[1], count=100, step=x) / gain(0.1, walls[0], count=100, step=x)
        for x in (0.3, 3.0)
    ]
    result.statement = "RRT with a goal bias of 5 %, a step of a tenth of the square."
    result.statement_holds(all(3.0 <= gains[name] <= 8.0 for name in ("narrow", "slit")))
    result.correction_holds(
        gains["slit"] < gains["narrow"] < gains["wide"],
        gains["slit"] < 3.0,
        edges < gains["slit"],
        min(trap, empty) > gains["narrow"],
        thick < 1.3 * thin,
        max(others) < 2.0,
        trap_long < 0.5,
    )


@claim(
    "Raising the goal bias from 5 to 20 per cent helps where passages are narrow.",
    "It helps where little is in the way: {empty_5:.0f} samples become {empty_20:.0f} in an empty "
    "square, {tenth_5:.0f} {tenth_20:.0f} where a tenth of a wall is open. Through a slit "
    "{slit_5:.0f} become {slit_20:.0f}, in a bug trap {trap_5:.0f} {trap_20:.0f}, and at "
    "{most:.0%} {trap_most:.0f}: what is drawn at the goal is not drawn at the way out.",
)
def goal_bias_in_passages(result):
    largest, middles = result.input("most", 0.5), {}
    places = {
        "empty": ("empty",),
        "tenth": ("gap", 0.1, 0.5),
        "slit": ("gap", 0.02, 0.5),
        "trap": ("bug_trap",),
    }
    needed = {}  # samples that are not the goal, in the mean
    for name, (scene, *place) in places.items():
        for bias, tag in ((0.05, "5"), (0.2, "20"), (largest, "most"))[
            : 3 if name == "trap" else 2
        ]:
            runs_of = samples(scene, "rrt", 300, *place, goal_bias=bias)
            needed[name, tag] = (1.0 - bias) * runs_of.mean()
            middles[name, tag] = np.median(runs_of)
            result.measure(f"{name}_{tag}", middles[name, tag], 0.1)
    result.statement = "Medians of 300 seeds."
    result.statement_holds(
        all(middles[name, "20"] < middles[name, "5"] for name in ("slit", "trap"))
    )
    result.correction_holds(
        all(middles[x, "20"] < middles[x, "5"] for x in ("empty", "tenth")),
        all(
            abs(drawn / needed[x, "5"] - 1) < 0.25
            for (x, _), drawn in needed.items()
            if x in ("slit", "trap")
        ),
        all(middles[x, "5"] < middles[x, "20"] for x in ("slit", "trap")),
        middles["trap", "20"] < middles["trap", "most"],
    )


@claim(
    "A narrow passage is harder to hit in more dimensions.",
    "It depends on what is narrow. Two random states, one each side of a thin wall, see each other "
    "through a slab, open {width:.0%} of one direction, with probability {slab_2:.3f} in 2 "
    "dimensions and {slab_6:.3f} in 6. Through a tube, w wide in each, they do with about "
    "w^(n - 1) (2^n - 1)/n: {tube_2:.3f}, {tube_3:.4f} and {tube_4:.5f} in 2, 3 and 4.",
    ask=Ask(
        "A thin wall cuts a unit cube in the middle. It is open in a square in its middle, w "
        "by w. With which probability do two random states, one each side, see each other, for "
        "small w?",
        "P = 7*w^2/3",
        {
            "w^2": "That is the opening's share. The middle of the wall is crossed more often.",
            "9*w^2/4": "Both directions share where on the segment the wall lies.",
            "3*w/2": "That is a slab, or the plane. Both directions have to be met.",
        },
    ),
)
def passage_in_more_dimensions(result):
    import sympy

    from course.planning import edge_free, scenes

    w, n, r = sympy.symbols("w n r", positive=True)
    # The wall parts the segment as r to 1, r uniform; the middle then has the density 1 + r.
    tube = w ** (n - 1) * sympy.integrate((1 + r) ** (n - 1), (r, 0, 1))
    result.formula = tube.subs(n, 3)
    width = result.input("width", 0.1)

    def observed(dim, narrow, share=width, pairs=400_000):
        """Return the share of random pairs whose segment crosses the wall within the opening."""
        ends = result.rng.uniform(-0.5, 0.5, (2, dim, pairs))
        a, b = np.abs(ends[:, -1])
        cross = (ends[0, :-1] * b + ends[1, :-1] * a) / (a + b)
        return np.mean((np.abs(cross[:narrow]) < share / 2).all(axis=0))

    tubes = {k: result.measure(f"tube_{k}", observed(k, k - 1), 0.1) for k in (2, 3, 4)}
    slabs = {k: result.measure(f"slab_{k}", observed(k, 1), 0.05) for k in (2, 6)}
    world = scenes.gap(width, 1e-6).world
    low, high = result.rng.uniform((0, 0), (5, 10), (2, 20_000, 2))
    ours = np.mean([edge_free(world, a, b + [5, 0]) for a, b in zip(low, high, strict=True)])
    law = {k: float(tube.subs({w: width, n: k})) for k in tubes}
    result.statement = f"400,000 pairs each; the chapter's edge test in the plane: {ours:.3f}."
    draws = list(zip(result.rng.integers(2, 4, 8), result.rng.uniform(0.1, 0.3, 8), strict=True))
    result.statement_holds(
        slabs[6] < 0.9 * slabs[2],
        only_if="it is narrow in the directions that come with them: a tube, not a slab",
        inside=[observed(k + 1, k, x) < 0.9 * observed(k, k - 1, x) for k, x in draws],
        outside=[observed(k + 1, 1, x) < 0.9 * observed(k, 1, x) for k, x in draws],
    )
    result.correction_holds(
        abs(ours - law[2]) < 0.01,
        all(abs(tubes[k] / law[k] - 1) < 0.12 for k in tubes),
        abs(slabs[6] / slabs[2] - 1) < 0.05,
    )
