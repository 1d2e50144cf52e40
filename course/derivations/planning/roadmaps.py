"""Claims of chapter 5: roadmaps, samplers, what OMPL does unasked, and the space of joints."""

import functools
import itertools

import numpy as np

from course.derivations import claim
from course.derivations.planning import runs


@claim(
    "Among obstacles, lazy collision checking usually tests only the edges of the final path.",
    "It checks the edges of every path that the search proposes, until one of these paths is "
    "free. Among discs that is {lazy:.0f} edges in the median for a final path of {path:.0f}; an "
    "ordinary roadmap checks {eager:.0f}. Through a narrow gap it is {slit:.0f}, and "
    "{slit_eager:.0f} for the ordinary one. The price is another graph search for each proposal. "
    "Only without obstacles is the first proposal always the final path.",
    source="Bohlin and Kavraki, Path planning using lazy PRM, ICRA 2000",
)
def lazy_tests_the_final_path(result):
    def edges(scene, method, *place):
        return np.array([x.edge_checks for x in runs(scene, method, 40, *place, budget=20_000)])

    lazy, eager = edges("discs", "lazy_prm"), edges("discs", "prm")
    final = np.array([x.path.shape[1] - 1 for x in runs("discs", "lazy_prm", 40, budget=20_000)])
    result.measure("lazy", np.median(lazy), 0.15)
    result.measure("path", np.median(final), 0.2)
    result.measure("eager", np.median(eager), 0.15)
    result.measure("slit", np.median(edges("gap", "lazy_prm", 0.02, 0.5)), 0.3)
    result.measure("slit_eager", np.median(edges("gap", "prm", 0.02, 0.5)), 0.3)
    result.statement = "40 seeds, ten neighbours per node as in OMPL's PRM; its lazy one has five."
    open_ones = runs("empty", "lazy_prm", 40, budget=20_000)
    result.statement_holds(np.mean(lazy == final) > 0.5)
    middle = np.median(lazy)
    result.correction_holds(
        all(lazy >= final),
        3 * np.median(final) < middle < 0.8 * np.median(eager),
        # Without obstacles the first proposal is free.
        all(x.edge_checks == x.path.shape[1] - 1 for x in open_ones),
    )


@functools.cache
def _bay_to_bay():
    """Return the 7-R arm at the open shelf, and 30 queries from one bay to another."""
    from course.planning import shelf

    requested, rng = shelf("open"), np.random.default_rng(0)
    return requested.world, [requested.query(rng) for _ in range(30)]


@claim(
    "RRT takes seconds at a cluttered shelf: make the collision checks faster.",
    "First do fewer of them. From one compartment to another, with the same edge check and a step "
    "size of {short} rad, RRT solves {rrt:.0f} of {asked:.0f} queries within {budget:.0f} "
    "samples, and {rrt_more:.0f} within {more:,.0f}. RRT-Connect solves {connect:.0f}, with a "
    "median of {middle:.0f} samples. A longer step does as much: with {long} rad RRT solves "
    "{rrt_long:.0f}, with a median of {middle_rrt:.0f} samples; RRT-Connect needs "
    "{middle_long:.0f}.",
)
def both_ends_first(result):
    from course.planning import plan

    world, queries = _bay_to_bay()
    budget, some = result.input("budget", 2000), queries[: result.input("asked", 20)]
    steps, solved, middle = (result.input("short", 1.0), result.input("long", 5.0)), {}, {}
    for method in ("rrt", "rrt_connect"):
        for step in steps:
            # Counted in samples and solved queries, so that no machine's speed enters.
            x = [plan(world, *q, method=method, rng=1, budget=budget, step=step) for q in some]
            solved[method, step] = sum(answer.solved for answer in x)
            middle[method, step] = np.median([answer.samples for answer in x])
    short, long = steps
    more = result.input("more", 5 * budget)
    further = [plan(world, *q, method="rrt", rng=1, budget=more, step=short).solved for q in some]
    result.measure("rrt_more", sum(further), 0.3)
    result.measure("rrt", solved["rrt", short], 0.3)
    result.measure("connect", solved["rrt_connect", short], 0.1)
    result.measure("middle", middle["rrt_connect", short], 0.2)
    result.measure("rrt_long", solved["rrt", long], 0.1)
    result.measure("middle_rrt", middle["rrt", long], 0.3)
    result.measure("middle_long", middle["rrt_connect", long], 0.3)
    result.statement = "20 queries of the 7-R arm; the chart of the ladder has the times."
    result.statement_holds(solved["rrt", short] == len(some))
    result.correction_holds(
        solved["rrt", short] < 0.7 * len(some),
        sum(further) < 0.8 * len(some),
        solved["rrt", long] > 0.9 * len(some),
        all(solved["rrt_connect", step] == len(some) for step in steps),
        middle["rrt", long] < 2.0 * middle["rrt_connect", long],
    )


@claim(
    "A cached roadmap answers any query in its world with a graph search, within a millisecond.",
    "A graph search does not connect a new start to the roadmap; that takes edge checks. From one "
    "compartment of a shelf to another, a query of the seven-joint arm needs {median:.0f} edge "
    "checks in the median, and one query in ten needs {tail:.0f} or more. And a roadmap covers "
    "only what it has sampled: of ten roadmaps with {few:.0f} samples, {joined:.0f} have a path "
    "through an opening of {slit:.0%} of a wall; with {many:.0f} samples all do.",
)
def cached_roadmap(result):
    from course.planning import build_roadmap, plan, scenes

    world, queries = _bay_to_bay()
    cached = build_roadmap(world, 500, 0)
    answers = [plan(world, *q, method="roadmap", roadmap=cached, rng=1, step=1.0) for q in queries]
    requested = np.array([x.edge_checks for x in answers])
    result.measure("median", np.median(requested), 0.3)
    result.measure("tail", np.percentile(requested, 90), 0.4)
    slit = result.input("slit", 0.02)

    def joined(samples, seed):
        scene = scenes.gap(slit)
        graph = build_roadmap(scene.world, samples, seed)
        in_left_half = graph.nodes[:, 0] < 5.0
        # An edge whose ends lie on both sides of the wall goes through the slit.
        crossing = in_left_half[graph.pairs[:, 0]] != in_left_half[graph.pairs[:, 1]]
        return bool((graph.status[crossing] == 1).any())

    sizes = result.input("few", 100), result.input("many", 2000)
    counts = [sum(joined(size, seed) for seed in range(10)) for size in sizes]
    result.measure("joined", counts[0], 0.4)
    result.statement = "30 queries; uniform samples, seeds 0 to 9."
    result.statement_holds(np.percentile(requested, 90) == 0 and counts[0] == 10)
    result.correction_holds(
        requested.min() > 0,
        np.percentile(requested, 90) > 4 * np.median(requested),
        counts[0] < 10,
        counts[1] == 10,
        all(x.solved for x in answers),
    )


@claim(
    "The bridge test samples near the boundaries of obstacles.",
    "It keeps the free midpoint between two colliding configurations: a point in a passage, if "
    "the bridge is long enough to span it. Of its samples {bridge:.0%} lie in a corridor of "
    "{gap:.0%} of the wall with a spread of {spread} m, and {short:.0%} with {little} m; of "
    "Gaussian samples {gaussian:.0%}, of uniform ones {uniform:.0%}. Near a single disc it finds "
    "no second obstacle to bridge to, gives up each time and samples uniformly, {far_m:.1f} m "
    "from the disc in the median. A Gaussian sample is {near_m:.2f} m from it.",
    source="Hsu, Jiang, Reif and Sun, The bridge test, ICRA 2003",
)
def bridge_test(result):
    from course.planning import clearance, plan, plane, scenes
    from course.planning.samplers import TRIES

    scene, disc = scenes.gap(result.input("gap", 0.05), 4.0), plane(scenes.SQUARE, [[5, 5, 2]])

    spread, little = result.input("spread", 0.5), result.input("little", 0.2)

    def drawn(world, sampler, spread=spread):
        answer = plan(
            world,
            scenes.START,
            scenes.GOAL,
            method="prm_star",
            sampler=sampler,
            budget=2000,
            rng=1,
            spread=spread,
        )
        return answer.nodes.T[2:], answer.state_checks / answer.samples

    inside = {}
    for name in ("bridge", "gaussian", "uniform"):
        inside[name] = np.mean(np.abs(drawn(scene.world, name)[0][:, 0] - 5.0) < 2.0)
        result.measure(name, inside[name], 0.3)
    short = np.mean(np.abs(drawn(scene.world, "bridge", little)[0][:, 0] - 5.0) < 2.0)
    result.measure("short", short, 0.3)
    # A single disc has no second pier: the case in which the test cannot succeed.
    by_disc = {name: drawn(disc, name) for name in ("gaussian", "bridge", "uniform")}
    away = [np.median([clearance(disc, q) for q in states]) for states, _ in by_disc.values()]
    result.measure("near_m", away[0], 0.1)
    result.measure("far_m", away[1], 0.1)
    result.statement = "2000 samples each; the bridge test gives up after 100 tries of two states."
    result.statement_holds(away[1] < 2 * away[0])
    result.correction_holds(
        inside["bridge"] > 1.2 * inside["gaussian"],
        inside["gaussian"] > 4 * inside["uniform"],
        away[1] > 0.5 * away[2],
        by_disc["bridge"][1] > 2 * TRIES,
        short < 0.3 * inside["bridge"],
    )


@claim(
    "OMPL plans with RRT-Connect by default, and if solve() returns true there is a path to the "
    "goal.",
    "For a goal state in a box of real numbers, OMPL {version} selects {planner} as its default "
    "planner. And solve() also returns true for an approximate solution: with the goal walled in, "
    "its RRT returned {said} for a path that ends {short:.1f} sides of the square away from the "
    "goal. Ask for an exact solution.",
    source="OMPL, SelfConfig::getDefaultPlanner and PlannerStatus",
)
def ompl_defaults(result):
    from importlib.metadata import version

    from course.oracles import ompl as oracle

    chosen = {oracle.defaults(dim)["planner"] for dim in (2, 3, 7)}
    text, exact, short = oracle.approximate()
    result.measure("version", version("ompl"))
    result.measure("planner", " or ".join(sorted(chosen)))
    result.measure("said", str(text).lower())
    result.measure("short", short, 0.05)
    result.statement = (
        "OMPL's choice in 2, 3 and 7 dimensions; its RRT with a budget of 200 samples."
    )
    result.statement_holds(chosen == {"RRTConnect"} and not text)
    result.correction_holds("RRTConnect" not in chosen, text, not exact, short > 0.49)


@claim(
    "The configuration space of an arm with six joints has six dimensions.",
    "An open chain on a fixed base has one dimension per joint, {six:.0f} here. Joints that are "
    "coupled count once, and a base that drives about on a floor adds {base:.0f}. The coordinates "
    "of the tip's pose don't matter: the seven-joint arm has {seven:.0f} dimensions, although a "
    "pose has 6. But the space is not simply a box. A joint without limits wraps around, and a "
    "planner that takes its angle for a plain number turns by {way_deg:.0f} degrees to get from "
    "{from_deg} to {to_deg}.",
)
def one_dimension_a_joint(result):
    from course import planning
    from course.kinematics import panda

    dims = [planning.planar_arm(np.ones(n)).dim for n in range(1, 9)]
    result.measure("six", dims[5])
    result.measure("seven", panda().n)
    ends = result.input("from_deg", 170), result.input("to_deg", -170)
    answer = planning.plan(planning.planar_arm([1.0]), *np.radians([ends]).T)
    result.measure("way_deg", np.degrees(answer.cost))

    def freedom(coupled=0, wheels=False):
        """Return in how many independent ways a planar arm with six joints can move.

        Args:
            coupled: how many joints turn in proportion to the one before, as in a finger.
            wheels: whether the base moves on the floor.
        """
        # A shift along x, one along y, and the turns of the base and of the joints.
        free = np.eye(9)[:, 0 if wheels else 3 :]
        for k in range(9 - coupled, 9):
            free[k] = result.rng.uniform(0.5, 2.0) * free[k - 1]
        headings = np.tril(np.ones((7, 7))) @ free[2:]  # of the base and of each link
        angles = np.cumsum(result.rng.uniform(-np.pi, np.pi, 7))
        ends = np.exp(1j * angles) * result.rng.uniform(0.2, 1.0, 7)
        moves = free[0] + 1j * free[1] + np.cumsum(1j * ends[:, None] * headings, axis=0)
        return int(np.linalg.matrix_rank(np.vstack((headings, moves.real, moves.imag))))

    result.measure("base", freedom(wheels=True) - freedom())
    # Chosen to break it: a finger whose last joints are coupled, and an arm on wheels.
    others = [freedom(coupled=k) == 6 for k in (1, 1, 2, 2)]
    others += [freedom(wheels=True) == 6 for _ in range(4)]
    result.statement = "Arms with one to eight links; one joint without obstacles."
    result.statement_holds(
        all(others),
        only_if="the base is fixed, and each joint has one axis and moves on its own",
        inside=[freedom() == 6 for _ in range(8)],
        outside=others,
    )
    result.correction_holds(
        dims == list(range(1, 9)),
        np.degrees(answer.cost) > 300,
        all(freedom(coupled=k) == 6 - k for k in range(6)),
    )


def _tip_world(rng, radius):
    """Return a two-link arm among five discs, and its tip alone among them."""
    from course.planning import planar_arm, plane

    turn = rng.uniform(-np.pi, np.pi, 5)
    away = rng.uniform(0.6, 1.8, 5)
    discs = np.column_stack((away * np.cos(turn), away * np.sin(turn), rng.uniform(0.1, 0.3, 5)))
    return planar_arm([1.0, 0.8], radius, discs), plane([[-2.0, -2.0], [2.0, 2.0]], discs)


@claim(
    "It is enough to plan a path for the tip and to solve the inverse kinematics at each point of "
    "it.",
    "A free tip says little about the links. Among random configurations whose tip is free, "
    "{thin:.0%} collide although the links have no thickness, and {thick:.0%} with links of "
    "{radius_m} m radius. Take problems that a planner in configuration space solves and whose "
    "straight tip path is free. In {one:.0%} of them only one of the two elbow solutions can "
    "follow that path, and in {neither:.0%} neither can.",
)
def tip_path_then_ik(result):
    from course.kinematics import planar, tip, two_link_ik
    from course.planning import edge_free, plan, scenes, state_free

    lengths = [1.0, 0.8]
    chain = planar(lengths)

    def hits(radius):
        arm, point = _tip_world(result.rng, radius)
        q = result.rng.uniform(-np.pi, np.pi, (200, 2))
        free = [x for x, p in zip(q, tip(chain, q.T)[:2].T, strict=True) if state_free(point, p)]
        return np.mean([not state_free(arm, x) for x in free])

    radius = result.input("radius_m", 0.05)
    thin, thick = (np.mean([hits(x) for _ in range(10)]) for x in (0.0, radius))
    result.measure("thin", thin, 0.1)
    result.measure("thick", thick, 0.1)
    blocked: list[list[bool]] = []
    while len(blocked) < 100:
        arm, point = _tip_world(result.rng, 0.0)
        ends = [scenes.free_state(arm, result.rng) for _ in range(2)]
        a, b = (tip(chain, q)[:2] for q in ends)
        line = a[:, None] + (b - a)[:, None] * np.linspace(0, 1, 60)
        near = np.linalg.norm(line, axis=0).min()  # around the base is out of reach
        if near < 0.25 or not edge_free(point, a, b) or not plan(arm, *ends, budget=3000).solved:
            continue
        # Both elbow branches, followed without jumps of a full turn.
        paths = np.unwrap(np.moveaxis(two_link_ik(lengths, line).q, 2, 0), axis=0)
        blocked.append(
            [
                not all(edge_free(arm, p, q) for p, q in itertools.pairwise(path))
                for path in np.moveaxis(paths, 2, 0)
            ]
        )
    neither, one = np.all(blocked, axis=1), np.sum(blocked, axis=1) == 1
    result.measure("neither", neither.mean(), 0.3)
    result.measure("one", one.mean(), 0.2)
    result.statement = "Two links among five random discs; 100 such problems."
    result.statement_holds(thin == 0.0 and not neither.any())
    result.correction_holds(thin > 0.1, thick < 2 * thin, neither.mean() > 0.01, one.mean() > 0.1)
