"""Claims of chapter 5: the shortest path, and what is done to a path that is found."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.planning import runs

SYMBOLS = {
    "c": Symbol("length of the path that is known [m]", 2.0, 4.0),
    "d": Symbol("distance of start and goal [m]", 0.5, 2.0),
}


def _past_disc(radius, method, budget, seed):
    """Return a plan from one side of a disc to the other, and the shortest way [m]."""
    from course.planning import plan, plane, scenes

    # Two tangents and the arc between them.
    best = 2 * np.sqrt(16 - radius**2) + radius * (np.pi - 2 * np.arccos(radius / 4))
    world, ends = plane(scenes.SQUARE, [[5.0, 5.0, radius]]), ([1.0, 5.0], [9.0, 5.0])
    # Start and goal are 4 m from the centre of the disc, on both sides.
    return plan(world, *ends, method=method, budget=budget, rng=seed, step=1.0), best


@claim(
    "If the radius of RRT* does not shrink too fast, and paths with some clearance come "
    "arbitrarily close to the shortest one, then its path never gets longer as samples are added, "
    "and converges to the shortest one with probability one.",
    "But the convergence is slow. Around one disc the path is {early:.3f} times the shortest after "
    "{few:.0f} samples and {late:.4f} times after {many:.0f}, as medians of ten seeds. No cost "
    "ever rose, and none fell below the shortest.",
    source="Karaman and Frazzoli, Sampling-based algorithms, 2011, theorem 38; a gap in its proof: "
    "Solovey and others, Revisiting the asymptotic optimality of RRT*, ICRA 2020",
)
def rrt_star_converges(result):
    few, more = result.input("few", 1000), result.input("many", 20_000)
    late = [_past_disc(2.0, "rrt_star", more, seed) for seed in range(10)]
    early = [_past_disc(2.0, "rrt_star", few, seed) for seed in range(10)]
    ratios = np.array([[x.cost / best for x, best in some] for some in (early, late)]).T
    result.measure("early", np.median(ratios[:, 0]), 0.01)
    result.measure("late", np.median(ratios[:, 1]), 2e-3)
    errors = []
    for answer, _ in late:
        edges = np.linalg.norm(answer.nodes[:, 1:] - answer.nodes[:, answer.parents[1:]], axis=0)
        # Each node's cost must be its parent's plus the edge: rewiring has to update all
        # descendants.
        errors.append(np.abs(answer.costs[1:] - answer.costs[answer.parents[1:]] - edges).max())
    result.measure("error", max(errors), 0.5)
    result.statement = "Ten seeds past a disc of 2 m, its shortest path in closed form."
    result.statement_holds(
        all((np.diff(answer.history[2]) <= 0).all() for answer, _ in late)
        and np.median(ratios[:, 1]) - 1 < 0.3 * (np.median(ratios[:, 0]) - 1)
    )
    result.correction_holds(
        ratios.min() >= 1.0, max(errors) < 1e-12, np.median(ratios[:, 1]) < 1.01
    )


@claim(
    "Informed RRT* speeds up planning.",
    "It does not find a first path sooner: until then it is RRT*, sample for sample. From then on "
    "it samples only in the ellipse from which the path can be shortened. Around a disc it is "
    "{informed:.2%} above the shortest path after {budget:.0f} samples, RRT* {star:.2%}.",
    source="Gammell, Srinivasa and Barfoot, Informed RRT*, IROS 2014",
)
def informed_rrt_star(result):
    budget = result.input("budget", 3000)

    def pair(seed, radius=2.0, count=budget):
        return [_past_disc(radius, x, count, seed) for x in ("rrt_star", "informed_rrt_star")]

    def shorter(scene, seed):
        star, informed = (
            runs(scene, x, 8, budget=budget)[seed].cost for x in ("rrt_star", "informed_rrt_star")
        )
        return informed < star

    def ellipse(length):
        """Return the ellipse's share of the square; the ends are 8 m apart."""
        return np.pi / 4 * length * np.sqrt(length**2 - 64.0) / 100.0

    pairs = [pair(seed) for seed in range(10)]
    over = np.array([[answer.cost / best - 1 for answer, best in row] for row in pairs])
    star, informed = np.median(over, axis=0)
    result.measure("star", star, 0.1)
    result.measure("informed", informed, 0.1)
    draws = zip(result.rng.uniform(0.3, 1.6, 10), result.rng.integers(1000, 4000, 10), strict=True)
    inside = [pair(k, radius, int(count)) for k, (radius, count) in enumerate(draws)]

    def crowded(seed):
        """Return the plans of both through forty small discs, start and goal 8 m apart."""
        from course.planning import plan, plane, scenes

        discs = result.rng.uniform((1.5, 1.5, 0.1), (8.5, 8.5, 0.4), (40, 3))
        clear = [np.hypot(discs[:, 0] - x, discs[:, 1] - 5.0) > discs[:, 2] + 0.2 for x in (1, 9)]
        world, ends = plane(scenes.SQUARE, discs[np.all(clear, axis=0)]), ([1.0, 5.0], [9.0, 5.0])
        return [
            plan(world, *ends, method=x, budget=2000, rng=seed, step=1.0)
            for x in ("rrt_star", "informed_rrt_star")
        ]

    # Chosen to break it: many obstacles, so that the first path is rarely near the shortest one.
    crowds = [crowded(seed) for seed in range(6)]
    shortened = [b.cost < a.cost for a, b in crowds if ellipse(a.cost) < 0.25]
    result.statement = "Ten seeds past a disc of 2 m, ten discs of other sizes, eight bug traps."
    outside = [shorter("bug_trap", seed) for seed in range(8)]
    before = [runs("gap", x, 50, 0.02, 0.5, budget=200) for x in ("rrt_star", "informed_rrt_star")]
    # Until a path is known, both must have drawn the same tree.
    unsolved = [pair for pair in zip(*before, strict=True) if not pair[0].solved]
    result.statement_holds(
        all(outside),
        only_if="a path is known and its ellipse excludes most of the world, with many samples "
        "to come (here: an ellipse below a quarter of the square, a thousand samples or more)",
        inside=[b[0].cost < a[0].cost and ellipse(a[1]) < 0.25 for a, b in inside] + shortened,
        outside=outside,
    )
    result.correction_holds(
        all(np.array_equal(a.nodes, b.nodes) for a, b in unsolved),
        len(unsolved) > 10,
        informed < 0.6 * star,
        len(shortened) > 2,
    )


@claim(
    "Once a path is known, Informed RRT* samples only in a small part of the world.",
    "It samples in the ellipse that contains every path of that length between start and goal. "
    "Its area in the plane is {formula}, where d is the distance between start and goal and c the "
    "length of the path. In a square of ten, with the two {d_m:.1f} m apart, that is {tight:.0%} "
    "of the square for a path {near} times as long as d, and {loose:.0%} for one {far} times as "
    "long.",
    ask=Ask(
        "Start and goal in a plane are a distance d apart, and a path of length c is known. You "
        "know only d and c. In which region must every path shorter than c lie? Give its area.",
        "A = pi*c*sqrt(c^2 - d^2)/4",
        {
            "pi*c*sqrt(c^2 - d^2)": "Those are full axes; an ellipse's area takes half of each.",
            "pi*c*d/4": "d is between the foci; it is not the ellipse's width.",
            "pi*c^2/4": "A disc around the middle reaches further than the path's length allows.",
        },
    ),
    source="Gammell, Srinivasa and Barfoot, Informed RRT*, IROS 2014",
)
def informed_area(result):
    import sympy

    from course.planning import scenes

    c, d, x = sympy.symbols("c d x", positive=True)
    height = sympy.sqrt((c**2 - d**2) / 4) * sympy.sqrt(1 - x**2)  # over x in halves of c
    result.formula = sympy.simplify(sympy.integrate(2 * height, (x, -1, 1)) * c / 2)
    area = sympy.lambdify((c, d), result.formula)

    def share(start, goal, length, low, high):
        """Return the share of uniform states by which a path of that length could pass."""
        q = result.rng.uniform(low, high, (200_000, 2))
        return np.mean(
            np.linalg.norm(q - start, axis=1) + np.linalg.norm(q - goal, axis=1) < length
        )

    low, high = np.asarray(scenes.SQUARE)
    distance = result.measure("d_m", np.linalg.norm(scenes.GOAL - scenes.START))
    times = result.input("near", 1.02), result.input("far", 2.0)
    tight, loose = (share(scenes.START, scenes.GOAL, k * distance, low, high) for k in times)
    result.measure("tight", tight, 0.03)
    result.measure("loose", loose, 0.03)
    errors = []
    for length in result.rng.uniform(1.0, 4.0, 20):
        p = share(np.array([-0.5, 0.0]), np.array([0.5, 0.0]), length, -length, length)
        truth = area(length, 1.0) / (2 * length) ** 2
        # In binomial standard errors; 4 of them are exceeded once in thousands of draws.
        errors.append((p - truth) / np.sqrt(truth * (1 - truth) / 200_000))
    result.statement = "200,000 uniform states a length; twenty lengths from 1 to 4 times d."
    result.statement_holds(loose < 0.3)
    result.correction_holds(np.abs(errors).max() < 4.0, tight < 0.3, loose > 0.9)


SCENES = {"empty": (), "gap": (0.02, 0.5), "bug_trap": (), "discs": (), "arm": ()}


@functools.cache
def _cut(scene, method, kind="partial"):
    """Return twelve paths of a scene before and after shortcutting, and its world."""
    from course.planning import scenes, shortcut

    world = getattr(scenes, scene)(*SCENES[scene]).world
    paths = [answer.path for answer in runs(scene, method, 12, *SCENES[scene])]
    cuts = [shortcut(x, world, np.random.default_rng(k), kind=kind) for k, x in enumerate(paths)]
    return paths, cuts, world


@claim(
    "Shortcutting joins two points of a path with a straight edge if that edge is free. It never "
    "lengthens the path and never makes it collide.",
    "This was so for all {paths:.0f} paths tried, in five scenes, verified by other code; the new "
    "edges have to be checked exactly and not at points. A variant straightens only one joint "
    "between the two points. It has to interpolate that joint by arc length: by the number of the "
    "waypoint, {longer:.0%} of the cuts lengthen the path.",
    source="Geraerts and Overmars, Creating high-quality paths for motion planning, 2007",
)
def shortcut_never_lengthens(result):
    from course.planning import check_path, length

    retained = []
    for scene in SCENES:
        for kind in ("vertex", "partial"):
            paths, cuts, world = _cut(scene, "rrt", kind)
            # Length and freedom by functions that shortcutting does not use.
            retained += [
                length(b) < length(a) * (1 + 1e-12) and check_path(world, b, *a.T[[0, -1]]).free
                for a, b in zip(paths, cuts, strict=True)
            ]
    result.measure("paths", len(retained))
    walks = result.rng.uniform(0.0, 1.0, (2000, 4, 3)).cumsum(axis=2)  # one joint is straightened
    # Random corners: differences of monotone paths, in two joints.
    walks = walks[:, :2] - walks[:, 2:]

    def longer(walk, place):
        line = np.interp(place, place[[0, -1]], walk[0, [0, -1]])
        return length([line, walk[1]]) > length(walk) * (1 + 1e-12)

    arcs = np.insert(np.linalg.norm(np.diff(walks), axis=1).cumsum(axis=1), 0, 0.0, axis=1)
    by_arc = [longer(walk, arc) for walk, arc in zip(walks, arcs, strict=True)]
    by_number = [longer(walk, np.arange(3.0)) for walk in walks]
    result.measure("longer", np.mean(by_number), 0.1)
    result.statement = "Paths of RRT before and after; 2000 random corners of two joints."
    result.statement_holds(all(retained))
    result.correction_holds(not any(by_arc), any(by_number))


@claim(
    "Shortcutting makes a path 30 to 50 per cent shorter.",
    "It depends on the problem. RRT-Connect's paths get {least:.0%} shorter in an empty square "
    "and {most:.0%} for a four-link arm, RRT's {rrt_least:.0%} and {rrt_most:.0%}. The number of "
    "edges is at least the length over the step size, and up to {edges:.1f} times that in the "
    "median of a scene. RRT-Connect's median path has {discs_points:.0f} waypoints among discs "
    "and {gap_points:.0f} through a narrow gap; after shortcutting, {after_points:.0f} and "
    "{after_gap:.0f}. Start and goal count as waypoints.",
)
def shortcut_share(result):
    from course.planning import length, scenes

    shares, points, edges = {}, {}, {}
    for method in ("rrt", "rrt_connect"):
        for scene in SCENES:
            paths, cuts, _ = _cut(scene, method)
            pairs = list(zip(paths, cuts, strict=True))
            shares[method, scene] = np.median([1 - length(b) / length(a) for a, b in pairs])
            step = getattr(scenes, scene)(*SCENES[scene]).step
            edges[method, scene] = np.median([(a.shape[1] - 1) * step / length(a) for a in paths])
            points[scene] = np.median([[a.shape[1], b.shape[1]] for a, b in pairs], axis=0)
    for name, key in (
        ("least", ("rrt_connect", "empty")),
        ("most", ("rrt_connect", "arm")),
        ("rrt_least", ("rrt", "empty")),
        ("rrt_most", ("rrt", "arm")),
    ):
        result.measure(name, shares[key], 0.1)
    for name, scene, k in (
        ("discs_points", "discs", 0),
        ("gap_points", "gap", 0),
        ("after_points", "discs", 1),
        ("after_gap", "gap", 1),
    ):
        result.measure(name, points[scene][k], 0.1)
    result.measure("edges", max(edges.values()), 0.1)
    result.statement = "Medians of 12 seeds, up to 200 rounds of partial shortcuts."
    result.statement_holds(all(0.3 <= share <= 0.5 for share in shares.values()))
    result.correction_holds(
        shares["rrt_connect", "empty"] == min(shares.values()),
        shares["rrt", "arm"] > 0.5,
        shares["rrt_connect", "empty"] < 0.02,
        all(before < 30 for before, _ in points.values()),
        min(edges.values()) >= 1.0,
        max(edges.values()) > 1.3,
    )


@claim(
    "Trajectory optimisers such as CHOMP and TrajOpt can get stuck in local minima.",
    "In a scene crowded with {discs:.0f} discs, {starts:.0f} initial guesses were tried, each two "
    "straight lines through a random point of the square, also inside a disc. With covariant "
    "gradient steps, as in CHOMP, {chomp:.0%} of them ended in collision; with sequential convex "
    "steps, as in TrajOpt, {trajopt:.0%}. After twice as many further iterations {still:.0%} of "
    "these results still collide. In the median they cost at least {worse:.2f} times as much as "
    "the result that started from a planner's path, which stays free with both. So check what an "
    "optimiser returns.",
    source="Zucker et al., CHOMP, 2013; Schulman et al., 2014",
)
def optimisers_get_stuck(result):
    from course.planning import check_path, covariant_gradient, plan, scenes, sequential_convex

    requested = scenes.discs()
    planned = plan(requested.world, requested.start, requested.goal, rng=3, step=1.0).path
    assert planned is not None
    vias = result.rng.uniform(0.5, 9.5, (result.input("starts", 20), 2))
    free, known, worse, later = {}, [], [], []
    optimisers: tuple[tuple[str, Callable[..., Any], dict[str, Any], dict[str, Any]], ...] = (
        (
            "chomp",
            covariant_gradient,
            {"iterations": 600, "weight": 100.0, "rate": 0.005},
            {"iterations": 1200, "rate": 0.001},  # smaller steps: those above oscillate
        ),
        ("trajopt", sequential_convex, {"iterations": 40}, {"iterations": 80}),
    )
    for name, optimise, options, more in optimisers:
        ends = [
            optimise(path, requested.world, margin=0.1, points=20, **options)
            for path in (
                planned,
                *(np.column_stack((requested.start, x, requested.goal)) for x in vias),
            )
        ]
        # Judged afterwards: an optimiser's own cost does not say whether the path is free.
        passed = np.array([bool(check_path(requested.world, end.path)) for end in ends])
        free[name], costs = passed[1:], np.array([end.costs[-1] for end in ends])
        known.append(passed[0])
        worse.append(np.median(costs[1:][~free[name]]) / costs[0])
        result.measure(name, 1 - free[name].mean(), 0.15)
        # Continued from where they stopped: a result that is only unfinished would become free.
        for end, good in zip(ends, passed, strict=True):
            if not good:
                again = optimise(
                    end.path, requested.world, margin=0.1, points=20, **(options | more)
                )
                later.append(not check_path(requested.world, again.path))
    result.measure("discs", len(requested.world.obstacles))
    result.measure("still", np.mean(later), 0.1)
    result.measure("worse", min(worse), 0.1)
    result.statement = "One world of discs that RRT-Connect solves from every seed."
    result.statement_holds(not all(x.all() for x in free.values()))
    result.correction_holds(
        all(x.any() and not x.all() for x in free.values()),
        all(known),
        min(worse) > 1.3,
        np.mean(later) > 0.75,
        all(answer.solved for answer in runs("discs", "rrt_connect", 200)),
    )


@claim(
    "TrajOpt minimises jerk under collision constraints.",
    "The published version minimises the sum of squared steps between waypoints, which means a "
    "short path at an even pace. Around a disc its path is {shorter:.1%} shorter than a parabola "
    "that keeps the same margin. That parabola has no jerk at all; TrajOpt's path has third "
    "differences of up to {third_mm:.0f} mm.",
    source="Schulman et al., Motion planning with sequential convex optimization, 2014, sec. II",
)
def trajopt_minimises_jerk(result):
    from course.planning import check_path, length, plane, scenes, sequential_convex

    world, margin = plane(scenes.SQUARE, [[5.0, 5.0, 2.0]]), 0.1
    t = np.linspace(-1.0, 1.0, 32)
    # A parabola has a third difference of zero: nothing can have less jerk.
    arch = np.stack((5 + 4 * t, 5 + 3.6 * (1 - t**2)))
    shaped = sequential_convex(arch, world, margin=margin, points=30).path
    third = [np.linalg.norm(np.diff(path, 3), axis=0).max() for path in (arch, shaped)]
    keeps = [np.linalg.norm(path - 5.0, axis=0).min() - 2.0 for path in (arch, shaped)]
    result.measure("shorter", 1 - length(shaped) / length(arch), 0.05)
    result.measure("third_mm", 1000 * third[1], 0.2)
    free = plane(scenes.SQUARE, [[0.5, 0.5, 0.1]])
    steps = sequential_convex(arch, free, margin=margin, points=30).path
    result.statement = "30 waypoints around a disc of 2 m; then with no obstacle near."
    result.statement_holds(third[1] <= third[0])
    result.correction_holds(
        third[0] < 1e-12 < 1e-3 < third[1],
        min(keeps) > 0.99 * margin,
        length(shaped) < length(arch),
        np.allclose(np.diff(steps), [[8 / 31], [0.0]], atol=1e-4),
        all(bool(check_path(world, path)) for path in (arch, shaped)),
    )


def _turns(path):
    """Return the angle of each corner of a path [deg]."""
    edges = np.diff(path) / np.linalg.norm(np.diff(path), axis=0)
    return np.degrees(np.arccos(np.clip(np.sum(edges[:, 1:] * edges[:, :-1], axis=0), -1.0, 1.0)))


@claim(
    "Shortcutting takes the jerks out of an RRT path.",
    "It takes out corners: of the {before:.0f} of RRT's median path among discs {after:.0f} are "
    "left, and the sharpest turn "
    "goes from {sharp:.0f} to {kept:.0f} degrees. But each corner that is left forces a stop or "
    "an infinite acceleration. Three subdivisions towards a B-spline leave a turn of {round:.0f} "
    "degrees, and {bare:.0f} if no obstacle forbids it: corners next to an obstacle stay.",
)
def shortcut_leaves_corners(result):
    from course.planning import plane, scenes, smooth, time_parameterise

    paths, cuts, world = _cut("discs", "rrt")
    rounded = [smooth(path, world) for path in cuts]
    # The same paths without obstacles: what smoothing could do.
    nothing = [smooth(path, plane(scenes.SQUARE)) for path in cuts]
    sharpest = [
        np.median([_turns(x).max() for x in some]) for some in (paths, cuts, rounded, nothing)
    ]
    for name, value in zip(("sharp", "kept", "round", "bare"), sharpest, strict=True):
        result.measure(name, value, 0.1)
    for name, some in (("before", paths), ("after", cuts)):
        result.measure(name, np.median([x.shape[1] - 2 for x in some]), 0.1)
    stops = [
        int((np.abs(time_parameterise(x, (1.0, 1.0)).speeds[1:-1]) < 1e-9).sum()) for x in cuts
    ]
    result.statement = "12 seeds; speeds by the time parameterisation without rounding."
    result.statement_holds(sharpest[1] < 1.0)
    result.correction_holds(
        stops == [x.shape[1] - 2 for x in cuts],
        sharpest[1] > 0.2 * sharpest[0],
        1.0 < sharpest[2] < sharpest[1],
        sharpest[3] < 0.6 * sharpest[2],
    )


@claim(
    "A motion that respects its acceleration limits at every point of a fine grid respects them in "
    "between.",
    "On a line, or a parabola in its own parameter s, q'' is constant between two grid points. So "
    "the joint acceleration is linear in s there, and largest at an end. With both ends "
    "constrained, its largest ratio to the limit over {times:.0f} times is {both:.4f}. With only "
    "the first end of each interval constrained, it exceeds the limit by {over:.0%} with "
    "{coarse:.0f} intervals per rounded corner, and by {over_fine:.1%} with {fine:.0f}. On other "
    "curves both ends are not enough. On a circular arc q'' turns: the excess is up to "
    "{over_arc:.1%} with {few:.0f} intervals per quarter circle. On a parabola in its arc length "
    "q'' is not constant either: the excess is {over_even:.0%} at even speed, over an interval "
    "around the vertex that turns by a right angle. Rates need a bound of their own: on a "
    "parabola a rate that is at its limit at both ends can exceed it in between, by "
    "{over_rate:.0%} in one example.",
    source="Pham and Pham, A new approach to time-optimal path parameterization (TOPP-RA), 2018",
)
def limits_between_grid_points(result):
    from course.planning import time_parameterise

    path = np.array([[0.0, 1.0, 1.2, 0.3, 2.0], [0.0, 0.2, 1.0, 1.5, 2.0]])
    times = np.linspace(0.0, 1.0, result.input("times", 20_001))

    def peaks(grid):
        """Return the largest acceleration, limit 1, of the motion, and with one end constrained."""
        motion = time_parameterise(path, (9.0, 1.0), blend=0.3, grid=grid)
        h, f, c = np.diff(motion.stations), motion.first, motion.second

        def pushes(i, x, ahead):
            """Return the range of path acceleration at the beginning of interval i alone."""
            with np.errstate(divide="ignore"):
                ends = np.sort([(-1 - c[i] * x) / f[i], (1 - c[i] * x) / f[i]], axis=0)
            return max(*ends[0], -x / (2 * h[i])), min(*ends[1], (ahead - x) / (2 * h[i]))

        x, worst = np.zeros(len(h) + 1), 0.0
        for i in range(len(h) - 1, -1, -1):  # the largest squared speed from which one can go on
            low, high = 0.0, 81.0
            for _ in range(50):
                x[i] = 0.5 * (low + high)
                least, largest = pushes(i, x[i], x[i + 1])
                low, high = (x[i], high) if least <= largest else (low, x[i])
            x[i] = low
        x[0] = 0.0
        for i in range(len(h)):
            u = pushes(i, x[i], x[i + 1])[1]
            x[i + 1] = x[i] + 2 * h[i] * u
            # Acceleration at the end of the interval, which the usual constraint leaves free.
            worst = max(worst, np.abs((f[i] + h[i] * c[i]) * u + c[i] * x[i + 1]).max())
        return np.abs(motion(times * motion.duration)[2]).max(), worst

    coarse = peaks(result.input("coarse", 16))
    fine = peaks(result.input("fine", 128))
    result.measure("over", coarse[1] - 1, 0.05)
    result.measure("over_fine", fine[1] - 1, 0.05)
    result.measure("both", max(coarse[0], fine[0]), 1e-4)

    def both_ends(corners):
        """Return whether a random rounded path with both ends constrained is within its limits."""
        draw = result.rng.uniform(-1.0, 1.0, (2, corners + 2))
        motion = time_parameterise(
            draw,
            (1.0, 1.0),
            blend=result.rng.uniform(0.05, 0.5),
            grid=int(result.rng.integers(2, 20)),
        )
        _, rate, push = motion(np.linspace(0.0, motion.duration, 4001))
        return max(np.abs(rate).max(), np.abs(push).max()) < 1 + 1e-9

    def hard(kind):
        """Return whether a path of many joints, chosen to break it, is within unequal limits."""
        n, k = int(result.rng.integers(3, 8)), int(result.rng.integers(3, 7))
        draw = result.rng.uniform(-1.0, 1.0, (n, k))
        if kind == 0:  # corners that turn by half a turn, on one line
            draw = draw[:, :1] + np.outer(draw[:, 1], np.cumsum(result.rng.choice([-1.0, 1.0], k)))
        elif kind == 1:  # joints of very different travel
            draw *= 10 ** result.rng.uniform(-4, 2, (n, 1))
        else:  # neighbouring edges of very different length
            draw *= 10 ** result.rng.uniform(-4, 2, k)
        limits = 10 ** result.rng.uniform(-2, 2, (2, n, 1))
        motion = time_parameterise(draw, limits[:, :, 0], blend=2.0, grid=2)
        moved = motion(np.linspace(0.0, motion.duration, 2001))[1:]
        return (np.abs(moved) / limits).max() < 1 + 1e-9

    def on_arc(angle, turn):
        """Return the largest acceleration on an arc at even speed, limit 1 at both of its ends."""
        ends, between = (turn + np.linspace(-0.5, 0.5, k) * angle for k in (2, 1001))
        at_ends, inside = (
            np.abs([np.cos(x), np.sin(x)]).max() for x in (ends, between)
        )  # of the centripetal acceleration, in units of v^2 / r
        return inside / at_ends

    steps = result.input("few", 4)
    arcs = [on_arc(0.5 * np.pi / steps, x) for x in np.linspace(0.0, 0.5 * np.pi, 91)]
    result.measure("over_arc", max(arcs) - 1, 0.01)

    def on_parabola(reach):
        """Return the largest acceleration on y = x^2 from -reach to reach at even speed.

        The limit is 1 at both ends. The derivatives by arc length are -4 x / k^2 and 2 / k^2 with
        k = 1 + 4 x^2.
        """
        x = np.linspace(-reach, reach, 1001)
        push = np.abs([-4.0 * x, 2.0 * np.ones_like(x)]) / (1.0 + 4.0 * x**2) ** 2
        return push.max() / push[:, [0, -1]].max()

    by_length = on_parabola(0.5)  # its tangent turns from -45 to 45 degrees
    result.measure("over_even", by_length - 1, 0.01)

    # One joint on a parabola, q' = 1 - s / 2, at a constant path acceleration of 1.5: the squared
    # path speed is 1 + 3 s. The rate is 1 at both ends, s = 0 and s = 1.
    s = np.linspace(0.0, 1.0, 9001)
    rate = (1.0 - 0.5 * s) * np.sqrt(1.0 + 3.0 * s)
    push = np.abs(1.5 * (1.0 - 0.5 * s) - 0.5 * (1.0 + 3.0 * s))
    result.measure("over_rate", rate.max() - 1, 0.01)
    result.statement = (
        "Two joints, three rounded corners, ten random paths; arcs and a parabola at even speed; "
        "limits at both ends of an interval, compared with those in between."
    )
    result.statement_holds(
        fine[1] < 1 + 1e-6,
        only_if="both ends of each interval are constrained, and the path between them is a line, "
        "or a parabola in its own parameter",
        # Chosen to break it: up to seven joints, reversals, lengths and limits of many sizes.
        inside=[both_ends(corners) for corners in result.rng.integers(1, 5, 10)]
        + [hard(k % 3) for k in range(12)],
        outside=[x < 1 + 1e-9 for x in (coarse[1], fine[1], *arcs, by_length)],
    )
    result.correction_holds(
        max(coarse[0], fine[0]) < 1 + 1e-9,
        1 < fine[1] < coarse[1],
        # The farthest that an arc's acceleration turns between its ends is half its angle.
        abs(max(arcs) - 1 / np.cos(0.25 * np.pi / steps)) < 1e-6,
        # In the middle 2, at the ends 2 / 4.
        abs(by_length - 4.0) < 1e-9,
        # The squared rate is a cubic with its largest value 343 / 243 at s = 4 / 9, while the
        # acceleration is largest at an end.
        max(abs(rate[0] - 1), abs(rate[-1] - 1)) < 1e-12,
        abs(rate.max() ** 2 - 343 / 243) < 1e-6,
        push.max() <= max(push[0], push[-1]) + 1e-12,
    )
