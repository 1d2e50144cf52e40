"""Claims of chapter 5: edges of a tree, and the last one, to the goal."""

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.planning import runs

SYMBOLS = {
    "w": Symbol("thickness of the wall [m]", 0.01, 0.1),
    "s": Symbol("distance of the points [m]", 0.2, 2.0),
    "r": Symbol("radius of a disc [m]", 1.1, 3.0),
}


@claim(
    "To check an edge of a tree for collisions, check ten or more points along it.",
    "Ten points inside an edge leave gaps of an eleventh of its length. A disc with a radius "
    "below 1/22 of the edge fits into such a gap, even where the edge crosses its middle. A "
    "larger disc is missed where the edge cuts off less than a gap. Of random edges of "
    "{edge_m:.0f} m that hit a disc with a radius of {large_m:.1f} m, ten points miss "
    "{large_share:.1%}, up to {deepest_mm:.0f} mm deep; with a radius of {small_m:.2f} m they "
    "miss {small_share:.0%}. The distance from a disc's centre to the segment has a closed form "
    "and misses none.",
    source="C. Ericson, Real-Time Collision Detection, 2005, sec. 5.1.2",
    ask=Ask(
        "Check points along an edge are s apart. How deep, at most, can the edge enter a disc of "
        "radius r > s/2 with no check point inside?",
        "d = r - sqrt(r^2 - s^2/4)",
        {
            "s^2/(8*r)": "That is the limit for a disc that is large compared with s.",
            "r - sqrt(r^2 - s^2)": "The deepest point lies s/2 from both check points, not s.",
            "s/2": "That is the distance along the edge from a check point to the deepest point.",
        },
    ),
)
def edge_by_ten_points(result):
    import sympy

    from course.drills import edge_is_free

    r, s, d = sympy.symbols("r s d", positive=True)
    chord = sympy.sqrt(r**2 - (r - d) ** 2)  # half of it, of depth d
    result.formula = min(sympy.solve(4 * chord**2 - s**2, d), key=lambda x: x.subs({r: 2, s: 1}))
    edge = result.input("edge_m", 1.0)
    gap, tried = edge / 11, np.linspace(0.0, edge, 12)  # ten and the ends

    def unseen(discs, growth=0.0, points=tried):
        """Return whether no point is in the disc, grown by a share of what the gaps need."""
        radii = np.sqrt(discs[:, 2:] ** 2 + growth * (np.diff(points).max() / 2) ** 2)
        return np.all(np.hypot(points - discs[:, :1], discs[:, 1:2]) > radii, axis=1)

    def hit(radius, count):
        """Return discs that the edge hits, and how deep it cuts into each."""
        centres = result.rng.uniform((-radius, -radius), (edge + radius, radius), (count, 2))
        outside = centres[:, 0] - np.clip(centres[:, 0], 0.0, edge)
        depth = radius - np.hypot(outside, centres[:, 1])
        return np.column_stack((centres, np.full(count, radius)))[depth >= 0], depth[depth >= 0]

    large, small = result.input("large_m", 0.1), result.input("small_m", 0.03)
    (wide, deep), (narrow, _) = hit(large, 100_000), hit(small, 100_000)
    share = result.measure("large_share", np.mean(unseen(wide)), tolerance=0.02)
    result.measure("small_share", np.mean(unseen(narrow)), tolerance=0.02)
    deepest = 1e-3 * result.measure("deepest_mm", 1000 * deep[unseen(wide)].max(), tolerance=0.05)
    middles = np.array([[4.5 * gap, 0.0, x * gap / 2] for x in (0.999, 1.001)])
    sample = [*wide[unseen(wide)][:300], *narrow[:300], middles[0]]
    wrong = sum(edge_is_free(np.zeros(2), np.array([edge, 0.0]), disc[None]) for disc in sample)
    result.statement = (
        f"100,000 discs of each size; the closed form passes {wrong} of {len(sample)} that hit."
    )

    def none_missed(growth, points=tried):
        discs = hit(10 ** result.rng.uniform(-2, 0.5), 20_000)[0]
        return not np.any(unseen(discs, growth, points))

    inside = [none_missed(1.0) for _ in range(10)]
    outside = [none_missed(0.9) for _ in range(10)]
    # Chosen to break it: points at uneven distances. Outside: the ends of the edge are no points.
    ends = np.array([0.0, edge])
    inside += [
        none_missed(1.0, np.sort(np.append(ends, result.rng.uniform(0.0, edge, 10))))
        for _ in range(4)
    ]
    open_ended = [none_missed(1.0, tried[1:-1]) for _ in range(4)]

    def none_missed_on_an_arc(count, radius=1e-3):
        """Return whether points on half a circle see a small disc at the arc's widest bulge."""
        turns = np.linspace(0.0, np.pi, count)
        points, middle = np.exp(1j * turns), np.exp(0.5j * turns[1])
        grown = np.hypot(radius, np.abs(points[1] - points[0]) / 2)
        return bool(np.abs(points - (1 + 0.9 * radius) * middle).min() <= grown)

    def none_rejected_wrongly(radius):
        """Return whether the enlarged discs reject no edge that is free."""
        centres = result.rng.uniform((-0.2, -0.2), (edge + 0.2, 0.2), (20_000, 2))
        discs = np.column_stack((centres, np.full(len(centres), radius)))
        away = np.hypot(centres[:, 0] - np.clip(centres[:, 0], 0.0, edge), centres[:, 1])
        return not np.any(~unseen(discs, 1.0) & (away > radius))

    # Chosen to break it: edges that are arcs, as a car's, and free edges near a disc.
    other = [none_missed_on_an_arc(count) for count in (3, 5, 11)]
    other += [none_rejected_wrongly(radius) for radius in (0.02, 0.05)]
    result.statement_holds(
        share == 0.0,
        only_if="the edge is straight, both of its ends are check points, every disc is enlarged "
        "to the radius sqrt(r^2 + s^2 / 4), and free edges that pass a disc closely may be "
        "rejected (s is the largest distance between neighbouring check points)",
        inside=inside,
        outside=outside + open_ended + other,
    )
    result.correction_holds(
        wrong == 0,
        bool(unseen(middles)[0]),
        not unseen(middles)[1],
        not any(open_ended),
        not any(other),
        deepest <= float(result.formula.subs({r: large, s: gap})),
    )


@claim(
    "Collision checks at points along an edge find a thin wall if there are enough points.",
    "Points a distance s apart miss a wall of thickness w that the edge crosses head on with "
    "probability {formula}. Turned away from head on by an angle, the edge has w / cos(angle) of "
    "its length in the wall. Of edges checked every {spacing_m} m, {missed:.1%} pass through a "
    "wall of {wall_m} m at {angle_deg} degrees from head on. OMPL's default spacing, a hundredth "
    "of the diagonal, is {ompl_m:.3f} m in a square of ten: of its paths past such a "
    "wall, {refused:.0%} go through it if {open:.0%} of the wall is open, and {refused_half:.0%} "
    "if {half:.0%} is. A spacing below the thickness of the thinnest "
    "wall is enough, except for corners, which an edge can cut off at any spacing. A test in "
    "closed form misses neither.",
    ask=Ask(
        "Check points along an edge are s apart. The edge crosses a wall of thickness w < s head "
        "on, and where the points fall is random. What is the probability that no point lies in "
        "the wall?",
        "P = 1 - w/s",
        {
            "w/s": "That is the probability that a point lies in the wall.",
            "1 - w/(2*s)": "The wall lies anywhere within one spacing s: one interval, not two.",
            "(s - w)^2/s^2": "One position decides it, not two independent ones.",
        },
    ),
)
def thin_wall_missed(result):
    import sympy

    from course import planning
    from course.oracles import ompl

    w, s, x = sympy.symbols("w s x", positive=True)
    result.formula = sympy.expand(sympy.integrate(1 / s, (x, w, s)))  # x: from point to wall's end
    spacing, wall = result.input("spacing_m", 0.14), result.input("wall_m", 0.05)
    angle = np.deg2rad(result.input("angle_deg", 30))

    def missed(width, count, turn=0.0):
        """Return the share of edges of twenty spacings that pass though they cross the wall."""

        def valid(q):
            return not 0.0 <= q[0] <= width

        tried = planning.from_function(valid, [[-2.0, -2.0], [2.0, 2.0]], spacing)
        exact = planning.plane(tried.bounds, boxes=[[0.0, -2.0, width, 2.0]])
        along = 20 * spacing * np.array([np.cos(turn), np.sin(turn)])
        starts = -along * result.rng.uniform(0.3, 0.7, (count, 1))
        assert not any(planning.edge_free(exact, a, a + along) for a in starts)
        return np.mean([planning.edge_free(tried, a, a + along) for a in starts])

    def law(width):
        return max(0.0, float(result.formula.subs({w: width, s: spacing})))

    share = result.measure("missed", missed(wall, 1500, angle), 0.03)
    resolution = ompl.defaults()["resolution"]

    def through(opening, name):
        requested = planning.scenes.gap(opening, wall)
        paths = [
            ompl.solve(
                requested.world.bounds,
                requested.start,
                requested.goal,
                "rrt_connect",
                2.8,
                5000,
                seed,
                ompl.tests(requested.world)[0],
                None,
                resolution=resolution,
            ).path
            for seed in range(1, 41)
        ]
        bad = [
            not planning.check_path(requested.world, path.T) for path in paths if path is not None
        ]
        return result.measure(name, np.mean(bad), 0.3)

    def oblique():
        """Return whether points find a wall that an edge crosses at any angle.

        There are 2 to 4 dimensions. The edge may begin just in front of the wall and end just
        behind it.
        """
        n, width = int(result.rng.integers(2, 5)), 10 ** result.rng.uniform(-2, 0)
        along = result.rng.normal(size=n)
        along[0] = max(abs(along[0]), 0.1)
        before, after = 10 ** result.rng.uniform(-6, 0.5, 2)
        # The first coordinate goes from just in front of the wall to just behind it.
        a, b = (x * width * along / along[0] for x in (-before, 1.0 + after))
        limits = np.array([[-100.0], [100.0]]) * np.ones(n)
        fine = result.rng.uniform(0.5, 0.999) * width
        return not planning.edge_free(
            planning.from_function(lambda q: not 0.0 <= q[0] <= width, limits, fine), a, b
        )

    result.measure("ompl_m", resolution * planning.scenes.empty().world.extent)
    slit = through(result.input("open", 0.02), "refused")
    half = through(result.input("half", 0.5), "refused_half")
    result.statement = "1500 edges across a wall; 40 seeds of OMPL's RRT-Connect at each."
    result.statement_holds(
        share == 0.0,
        only_if="the spacing is below the thickness of the wall, and the edge crosses it from side "
        "to side",
        # Chosen to break it: oblique edges that begin or end close to the wall, more dimensions.
        inside=[missed(spacing * x, 60) == 0.0 for x in result.rng.uniform(1.001, 2.0, 8)]
        + [oblique() for _ in range(12)],
        outside=[missed(spacing * x, 60) == 0.0 for x in result.rng.uniform(0.5, 0.9, 8)],
    )
    block = planning.plane([[-2, -2], [2, 2]], boxes=[[-1, -1, 0, 0]])
    fine = planning.from_function(lambda q: planning.state_free(block, q), block.bounds, 0.001)
    cut = np.array([-1.0, 1.0002]), np.array([1.0002, -1.0])  # to the diagonal side of a corner
    cuts = [(a - 0.0004, b - 0.0004 + x) for x in np.linspace(0, 1e-3, 9) for a, b in [cut]]
    result.correction_holds(
        any(planning.edge_free(fine, *c) > planning.edge_free(block, *c) for c in cuts),
        abs(share - law(wall / np.cos(angle))) < 0.03,
        slit > 0.8,
        0.0 < half < 0.5 * slit,
        all(abs(missed(x * spacing, 500) - law(x * spacing)) < 0.08 for x in (0.1, 0.5, 0.9)),
    )


@claim(
    "An RRT that comes within one step of the goal has a path to the goal.",
    "It has a path to that node, which is {short_m:.2f} m from the goal in the median run among "
    "discs with a step size of {step_m:.0f} m. A check that compares the last configuration with "
    "the goal rejects it. And a node near the goal can be on the wrong side of a wall: with the "
    "goal {behind_m} m behind a wall, the first node within a step is there in {across:.0%} of "
    "the runs. The last edge has to be added, and checked.",
)
def near_the_goal(result):
    from course import planning
    from course.planning import scenes

    requested, step = scenes.discs(), result.input("step_m", 1.0)

    def first_near(answer, goal):
        away = np.linalg.norm(answer.nodes - goal[:, None], axis=0)
        return answer.nodes[:, np.flatnonzero(away < step)[0]]

    ends = np.array([first_near(answer, requested.goal) for answer in runs("discs", "rrt", 100)])
    result.measure("short_m", np.median(np.linalg.norm(ends - requested.goal, axis=1)), 0.02)
    wall = scenes.gap(0.1, 0.05)
    goal = np.array([5.025 + result.input("behind_m", 0.3), 2.0])
    ask = {"world": wall.world, "start": wall.start, "goal": goal, "method": "rrt", "step": step}
    firsts = [first_near(planning.plan(**ask, rng=seed), goal) for seed in range(100)]
    across = np.mean([not planning.edge_free(wall.world, first, goal) for first in firsts])
    result.measure("across", across, 0.05)

    def all_joined(here, aim, radius):
        """Return whether all free states in a ball around a goal have a free edge to it."""
        turned = result.rng.standard_normal((100, aim.size))
        turned *= radius / np.linalg.norm(turned, axis=1, keepdims=True)
        around = aim + turned * result.rng.uniform(size=(100, 1)) ** (1.0 / aim.size)
        around = np.clip(around, here.bounds[0], here.bounds[1])
        free = [q for q in around if planning.state_free(here, q)]
        return all(planning.edge_free(here, q, aim) for q in free)

    def among(here, low, high, per_metre=1.0):
        """Return `all_joined` around a random goal, within `low` to `high` of its clearance."""
        aim = scenes.free_state(here, result.rng)
        clear = per_metre * planning.clearance(here, aim)
        return all_joined(here, aim, result.rng.uniform(low, high) * clear)

    def discs():
        return scenes.discs(int(result.rng.integers(1000))).world

    # Chosen to break the condition: thin walls, a trap's sharp corners, and an arm, where metres of
    # clearance are not radians of step. No point of four links of 1 m moves farther than
    # sqrt(4^2 + 3^2 + 2^2 + 1^2) m for each radian that the posture moves.
    corners = [scenes.gap(0.02, 0.01).world, wall.world, scenes.bug_trap().world]
    arm, radians = scenes.arm().world, 1.0 / np.sqrt(30.0)
    result.statement = (
        "100 seeds each; random goals among discs, at walls, in a trap and of an arm, 100 states "
        "around each."
    )
    result.statement_holds(
        across == 0.0,
        only_if="that node is connected to it, and every configuration within a step of the goal "
        "is free",
        inside=[among(discs(), 0.5, 0.999) for _ in range(12)]
        + [among(here, 0.9, 0.999) for here in corners for _ in range(6)]
        + [among(arm, 0.9, 0.999, radians) for _ in range(8)],
        outside=[among(discs(), 1.2, 3.0) for _ in range(12)]
        + [among(here, 1.2, 3.0) for here in corners for _ in range(6)]
        + [among(arm, 0.9, 0.999) for _ in range(8)],
    )
    verdicts = [
        planning.check_path(requested.world, end[:, None], end, requested.goal) for end in ends
    ]
    result.correction_holds(across > 0.1, not any(bool(verdict) for verdict in verdicts))
