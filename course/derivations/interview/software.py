"""Claims of chapter 12: trials, planners, policies, cycles and bytes, as interviewers ask."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "p": Symbol("probability", 0.05, 0.95),
    "d": Symbol("half width of the interval", 0.01, 0.2),
    "D": Symbol("distance [m]"),
    "a": Symbol("acceleration [m/s^2]"),
    "v": Symbol("speed [m/s]"),
    "c": Symbol("side of a cell [m]"),
    "r1": Symbol("reward of the first action"),
    "r2": Symbol("reward of the second action"),
}


@claim(
    "If a policy succeeds in 70 of 100 trials, this proves that its true success rate is at least "
    "70 %.",
    "A policy with a true rate of {worse:.2f} passes with probability {lucky:.2f}, and one whose "
    "true rate equals the gate with {fair:.2f}. After {passed:.0f} successes in {n:.0f} trials "
    "Wilson's interval at two standard deviations is {low:.2f} to {high:.2f}. An interval of half "
    "width d at two standard deviations takes about {formula} trials.",
    ask=(
        "A true success rate is p. About how many trials does an interval of half width d take, at "
        "two standard deviations?",
        "n = 4*p*(1 - p)/d^2",
        {
            "p*(1 - p)/d^2": "That is one standard deviation.",
            "2*p*(1 - p)/d^2": "The factor of two is squared together with the standard deviation.",
            "4*p/d^2": "The variance of a trial is p (1 - p).",
            "4*p*(1 - p)/d": "The width falls with the square root of n.",
        },
    ),
    source="E. Wilson, Probable inference, the law of succession, 1927",
)
def hundred_trials(result):
    import sympy
    from scipy.stats import binom

    from course.measure.success import wilson

    p, d, n = sympy.symbols("p d n", positive=True)
    result.formula = sympy.solve(sympy.Eq(d, 2 * sympy.sqrt(p * (1 - p) / n)), n)[0]
    gate, worse = result.input("gate", 0.7), result.input("worse", 0.65)
    tried = int(result.input("n", 100))
    passed = result.measure("passed", round(gate * tried))
    # Exact binomial tail: at least `passed` successes.
    lucky = result.measure("lucky", binom.sf(passed - 1, tried, worse))
    fair = result.measure("fair", binom.sf(passed - 1, tried, gate))
    low, high = (float(x) for x in wilson(passed, tried))
    result.measure("low", low)
    result.measure("high", high)
    observed = np.mean(result.rng.binomial(tried, worse, 40_000) >= passed)
    needed = int(result.formula.subs({p: gate, d: 0.05}))
    draws = result.rng.binomial(needed, gate, 40_000) / needed
    # The normal approximation's own promise, 95 % within the half width, checked by sampling.
    inside = np.mean(np.abs(draws - gate) < 0.05)
    result.statement = "Binomial sums, and 40,000 draws of a hundred trials."
    result.statement_holds(lucky < 0.025)
    result.correction_holds(
        abs(observed - lucky) < 0.01, 0.5 < fair < 0.6, low < worse < high, 0.94 < inside < 0.97
    )


@claim(
    "A* finds a path through a gap wherever there is one.",
    "A* is complete only on its graph. Take a grid with cells of side c that count as free only if "
    "no obstacle touches them. With cells of {cell:g} m, a straight gap of {narrow:g} m along the "
    "grid was open at {open_narrow:.0%} of the random positions of the grid, and a gap of "
    "{wide:g} m at {open_wide:.0%}. The width {formula} is enough at any position. A gap of "
    "{wide:g} m that was rotated against the grid was open in {turned:.0%} of the samples, and "
    "one of {safe:g} m in all.",
    ask=(
        "Cells of side c count as free only if no obstacle touches them. What is the smallest "
        "width of a gap along the grid that is open at any position of the grid?",
        "2*c",
        {
            "c": "Both sides of the gap may cut through a cell.",
            "c/2": "Not even one cell fits.",
            "3*c": "Less is enough: between two cut cells only one has to be whole.",
        },
    ),
    source="S. LaValle, Planning Algorithms, 2006, sec. 5.1",
)
def complete_planners(result):
    import sympy
    from scipy.ndimage import label

    cell = result.input("cell", 0.1)
    narrow, wide = result.input("narrow", 0.15), result.input("wide", 0.2)

    def open_share(gap, places=200):
        """Return the share of places of the grid for which its free cells join the two halves."""
        found_open = 0
        for shift in result.rng.uniform(0, cell, places):
            edges = np.arange(-10, 11) * cell + shift
            # A cell of the gap is free only if both of its edges are inside.
            rows = (edges[:-1] >= -1e-12) & (edges[1:] <= gap + 1e-12)  # wholly within the gap
            free = np.ones((20, 9), dtype=bool)
            free[:, 4] = rows
            # Connected components of free cells: what A* can reach on its grid.
            areas, _ = label(free)
            found_open += areas[0, 0] == areas[0, 8]
        return found_open / places

    def turned_share(gap, angles, half=0.25):
        """Return the share of places at which a gap in a wall of twice the half thickness is open.

        Args:
            gap: its width [m].
            angles: by which it is turned to the grid, a place for each [rad].
            half: half the thickness of the wall [m].
        """
        n, found_open = 40, 0
        for angle in angles:
            edges, (across, along) = (np.arange(n) - n / 2) * cell, result.rng.uniform(0, cell, 2)
            x, y = np.meshgrid(edges + across, edges + along, indexing="ij")
            cos, sin = np.cos(angle), np.sin(angle)
            corners = [(x + i * cell, y + j * cell) for i in (0, 1) for j in (0, 1)]
            u = np.array([cos * a + sin * b for a, b in corners])  # through the gap
            w = np.array([cos * b - sin * a for a, b in corners])  # along the wall
            free = np.ones((n, n), dtype=bool)
            for side in (-1.0, 1.0):
                # Cell and half of the wall are convex: apart if an axis of either parts them.
                ends = [(a, side * b) for a in (-half, half) for b in (gap / 2, 10.0)]
                xs = [cos * a - sin * b for a, b in ends]
                ys = [sin * a + cos * b for a, b in ends]
                # Separating axis test of two rectangles: the wall's axes, then the grid's.
                separation = [u.min(0) - half, -half - u.max(0), gap / 2 - (side * w).max(0)]
                separation += [x - max(xs), min(xs) - x - cell, y - max(ys), min(ys) - y - cell]
                free &= np.max(separation, axis=0) >= -1e-12
            areas, _ = label(free)
            costs = [
                np.where(free, (u.mean(0) + s) ** 2 + w.mean(0) ** 2, 1e9) for s in (1.2, -1.2)
            ]
            first, second = (areas.flat[int(np.argmin(cost))] for cost in costs)
            found_open += first == second
        return found_open / len(angles)

    # The first edge lies x < c above the lower side of the gap; a whole cell above it has to fit.
    c, x = sympy.symbols("c x", positive=True)
    result.formula = sympy.limit(x + c, x, c, "-")
    tight = result.measure("open_narrow", open_share(narrow), 0.3)
    roomy = result.measure("open_wide", open_share(wide), 0.0)
    shut = open_share(0.09)
    safe = result.input("safe", 0.29)
    angles = np.radians(result.rng.uniform(10.0, 40.0, 60))
    turned = result.measure("turned", turned_share(wide, angles), 0.5)
    every = np.radians(result.rng.uniform(0.0, 90.0, 60))
    fitting = 2.0 * np.sqrt(2.0) * cell * result.rng.uniform(1.0, 1.3, 4)
    wider, closer = result.rng.uniform(2 * cell, 4 * cell, 8), result.rng.uniform(0, 2 * cell, 8)
    result.statement = "Free cells of a grid, joined, at drawn places of the grid over a gap."
    result.statement_holds(
        tight == 1,
        only_if="a gap along the grid is at least two cells wide, and a gap at any other angle at "
        "least 2 sqrt(2) cells, where A* searches a grid of wholly free cells",
        # Chosen to break it: gaps that are turned to the grid.
        inside=[
            *(open_share(gap) == 1 for gap in wider),
            *(turned_share(float(gap), every[:20]) == 1 for gap in fitting),
        ],
        outside=[
            *(open_share(gap) == 1 for gap in closer),
            *(turned_share(x * cell, angles[:20]) == 1 for x in (2.0, 2.1, 2.2)),
        ],
    )
    result.correction_holds(
        0.3 < tight < 0.7, roomy == 1, shut == 0, turned < 0.3, turned_share(safe, every) == 1
    )


@claim(
    "A planner that is twice as fast makes a pick-and-place cycle more than ten per cent shorter.",
    "It saves at most half of the time that the arm waits for a plan. A move over the distance D "
    "takes {formula} if the arm reaches its top speed v with the acceleration a. With "
    "{moves:.0f} moves of {move:.2f} s, {grip:g} s of gripping and {compute_ms:.0f} ms of "
    "computing, {plan_ms:.0f} ms of it planning, a planner that is twice as fast shortens the "
    "cycle by {won:.1%}. Twice the acceleration shortens it by {quick:.0%}.",
    ask=(
        "A hand moves from rest to rest over the distance D. It accelerates and brakes with a and "
        "reaches its top speed v. How long does the move take?",
        "T = D/v + v/a",
        {
            "D/v": "The hand also has to speed up and to brake.",
            "D/v + 2*v/a": "While it speeds up and brakes, it moves at half of v on average.",
            "D/v + v/(2*a)": "That counts only one of the two ramps.",
            "2*sqrt(D/a)": "That is the time if the top speed is not reached.",
        },
    ),
    source="Chapter 5 derives the trapezoid",
)
def computing_and_cycle(result):
    import sympy

    D, v, a, T = sympy.symbols("D v a T", positive=True)
    result.formula = sympy.expand(sympy.solve(sympy.Eq(v * (T - v / a), D), T)[0])
    far, fast, hard = 0.6, 1.0, result.input("acceleration", 2)

    def taken(limit):
        """Return the time from rest to rest [s], by small steps.

        The motion is as fast as allowed and brakes as late as possible.
        """
        place, rate, now, dt = 0.0, 0.0, 0.0, 1e-5
        while place < far - 1e-7 and now < 10:
            # Bang-bang: brake once the stopping distance v^2 / (2 a) equals what is left.
            brakes = far - place <= rate * rate / (2 * limit)
            rate = max(rate - limit * dt, 1e-4) if brakes else min(rate + limit * dt, fast)
            place, now = place + rate * dt, now + dt
        return now

    move = result.measure("move", taken(hard), 5e-3)
    report = float(result.formula.subs({D: far, v: fast, a: hard}))
    moves, grip = result.input("moves", 4), result.input("grip", 0.6)
    computing = result.input("compute_ms", 170) / 1000
    plan = result.input("plan_ms", 100) / 1000
    cycle = moves * move + grip + computing
    won = result.measure("won", plan / 2 / cycle, 0.01)
    quick = result.measure("quick", moves * (move - taken(2 * hard)) / cycle, 0.01)
    result.statement = "A move from rest to rest in small steps, and a cycle of four."

    def shorter(waits):
        """Return by how much half the planning shortens cycles, simulated over random moves.

        Args:
            waits: what planning takes, as shares of the cycles.
        """
        for share in waits:
            rest = result.rng.uniform(0.3, 1.5) + sum(
                taken(limit) for limit in result.rng.uniform(1.0, 6.0, 2)
            )
            waiting = rest * share / (1.0 - share)
            yield 1.0 - (rest + waiting / 2.0) / (rest + waiting)

    def fed(share, spare):
        """Return by how much half the planning shortens a cycle to which a feeder brings parts.

        Args:
            share: of the cycle that planning takes.
            spare: by what share the arm's cycle is longer than the feeder's.
        """
        feeder = 1.0 - spare
        return 1.0 - max(1.0 - share / 2.0, feeder)

    def paced(plan, motion, feed):
        """Return by how much half the planning shortens a cycle for which parts arrive on time.

        Args:
            plan: time that planning takes [s].
            motion: time that moving takes [s].
            feed: time between two parts [s].
        """

        def mean_cycle(waiting, parts=20):
            now = 0.0
            for part in range(parts):
                now = max(now, part * feed) + waiting + motion
            return now / parts

        return 1.0 - mean_cycle(plan / 2.0) / mean_cycle(plan)

    result.statement_holds(
        won > 0.1,
        only_if="for more than a fifth of the cycle the arm waits only for its planner, and "
        "nothing else, such as the arrival of parts, limits how short the cycle can become",
        inside=[part > 0.1 for part in shorter(result.rng.uniform(0.201, 0.8, 8))],
        outside=[part > 0.1 for part in shorter(result.rng.uniform(0.05, 0.199, 8))]
        # Chosen to break it: the next part comes only a little before the plan.
        + [fed(share, 0.05) > 0.1 for share in (0.25, 0.5, 0.8)]
        # A line brings a part each 5 s, and the arm is faster with either planner.
        + [paced(plan, 3.0, 5.0) > 0.1 for plan in (1.2, 1.6, 2.0)],
    )
    result.correction_holds(abs(move / report - 1) < 0.01, won < 0.03, quick > 5 * won)


@claim(
    "While a policy gets better, the policy-gradient loss -E[A log pi] falls.",
    "Only the gradient of this loss has a meaning, and only at the policy that collected the "
    "data: there it is minus the gradient of the return, which for two actions is {formula}. With "
    "scores half a unit away it differs by {away:.0%} on average. Whether the value of the loss "
    "falls depends on the baseline. Behaviour cloning uses the same expression with A = 1 on the "
    "actions of a demonstrator. There it is a negative log-likelihood, which may be minimised.",
    ask=(
        "A policy has two actions with rewards r1 and r2. It chooses the first with probability p, "
        "the logistic function of a score. What is the derivative of the mean reward with respect "
        "to this score?",
        "p*(1 - p)*(r1 - r2)",
        {
            "p*(r1 - r2)": "The derivative of the logistic function is p (1 - p).",
            "r1 - r2": "That is the derivative with respect to p, not to the score.",
            "p*(1 - p)*r1": "The other action loses the probability that this one gains.",
        },
    ),
    source="R. Williams, Simple statistical gradient-following algorithms, 1992",
)
def loss_of_a_policy(result):
    import sympy

    r1, r2, z = sympy.symbols("r1 r2 z")
    p = sympy.symbols("p", positive=True)
    logistic = 1 / (1 + sympy.exp(-z))
    slope = sympy.diff(logistic * r1 + (1 - logistic) * r2, z)
    result.formula = sympy.simplify(slope.subs(z, sympy.log(p / (1 - p))))

    def share(scores):
        weights = np.exp(scores - scores.max())
        return weights / weights.sum()

    def gradient(f, scores, step=1e-6):
        return np.array(
            [
                (f(scores + step * e) - f(scores - step * e)) / (2 * step)
                for e in np.eye(len(scores))
            ]
        )

    def deviation(away):
        """Return how far the two slopes are apart, as a share of the return's."""
        rewards, scores = result.rng.normal(size=(2, 4))
        drawn = share(scores)
        # Expected value of A log pi with the actions weighted as the data were drawn.
        gain = drawn * (rewards - drawn @ rewards)
        at = scores + away * result.rng.normal(size=4)
        loss = gradient(lambda x: -gain @ np.log(share(x)), at)
        true = gradient(lambda x: share(x) @ rewards, at)
        return np.linalg.norm(loss + true) / np.linalg.norm(true)

    def fell(baseline):
        """Return how much the loss on its own data falls as a policy of two actions gets better."""
        rewards = np.array([1.0, 0.0])
        even, better = (
            -(p * (rewards - baseline)) @ np.log(p) for p in np.array([[0.5, 0.5], [0.9, 0.1]])
        )
        return even - better

    result.statement = "Gradients of policies over four actions, by differences."
    result.statement_holds(fell(0.0) > 0 and fell(1.0) > 0)
    away = result.measure("away", np.mean([deviation(0.5) for _ in range(40)]), 0.2)
    result.correction_holds(max(deviation(0.0) for _ in range(8)) < 1e-6, away > 0.05)


@claim(
    "If one world in a hundred, chosen at random, is in contact, the contact code of a batch "
    "costs about a hundredth of the full price.",
    "Lanes that share their instructions run a branch together, so a group skips it only if all of "
    "its lanes do. A group of four runs it with the probability {formula}. With {p:.0%} of the "
    "worlds in contact and {lanes:.0f} lanes, {groups:.0%} of the groups run it, so {ratio:.0f} "
    "times as many lanes are occupied as need it. Arms of this course behind a wall, in random "
    "order, gave {measured:.0f} times; the same arms sorted by contact gave {sorted:.2f} times.",
    ask=(
        "Each world is in contact with probability p, independently. With which probability does a "
        "group of four lanes execute the contact branch?",
        "1 - (1 - p)^4",
        {
            "4*p": "That counts groups with two contacts twice.",
            "p^4": "That is the probability that all of them are in contact.",
            "(1 - p)^4": "That is the probability that none is.",
        },
    ),
    source="NVIDIA, CUDA C++ Programming Guide, SIMT architecture, 2024",
)
def rare_contact_is_cheap(result):
    import sympy

    from course.charts.sim_to_real.layouts import executed, touching

    p, n, k = sympy.symbols("p n k", positive=True)
    chance = sympy.binomial(n, k) * p**k * (1 - p) ** (n - k)
    executes = 1 - chance.subs(k, 0)
    result.formula = sympy.simplify(executes.subs(n, 4))
    share, lanes = result.input("p", 0.01), int(result.input("lanes", 32))

    def theory(share, lanes):
        return float(executes.subs({p: share, n: lanes}))

    groups = result.measure("groups", theory(share, lanes), 1e-9)
    ratio = result.measure("ratio", groups / share, 1e-9)
    arms = touching(share)
    measured = result.measure("measured", executed(arms, lanes), 0.1)
    after = result.measure("sorted", executed(np.sort(arms), lanes), 0.1)

    def gap(share, lanes, count=400_000):
        """Return how far random lanes are from theory, in standard deviations of the groups."""
        flags = result.rng.random(count // lanes * lanes) < share
        chance = theory(share, lanes)
        observed = executed(flags, lanes) * flags.sum() / flags.size
        return (observed - chance) / np.sqrt(chance * (1.0 - chance) * lanes / flags.size)

    draws = [
        (0.5 * 10.0 ** (-3.0 * u), int(2 ** (1 + 5.99 * w))) for u, w in result.rng.random((24, 2))
    ]
    # Chosen to break it: contacts in runs of neighbours are not independent.
    runs = np.repeat(result.rng.random(6400) < 10 * share, lanes)[: 64 * 3200]
    result.statement = "Random lanes, and 65,536 arms of which some reach beyond a wall."
    result.statement_holds(ratio < 2.0)
    result.correction_holds(
        max(abs(gap(*draw)) for draw in draws) < 4.5,
        abs(measured / ratio - 1.0) < 0.12,
        after < 1.2,
        executed(runs, lanes) < 0.5 * theory(10 * share, lanes) / (10 * share),
    )


@claim(
    "A pass that reads four of seventeen numbers moves 17/4 times as many bytes if they lie in an "
    "array of structures.",
    "Memory moves in cache lines. Of a structure of {size:.0f} bytes the pass reads {read:.0f}, "
    "and touches {touched:.0f} bytes of lines of {line:.0f} bytes on average, since some "
    "structures begin so that the numbers straddle a line. A structure of arrays touches "
    "{dense:.0f}: {factor:.2f} times fewer instead of {naive:.2f}. A pass that reads all "
    "numbers moves the same in both layouts. Measured times can differ more, since a "
    "processor also fetches lines in advance.",
    source="U. Drepper, What every programmer should know about memory, 2007",
)
def bytes_by_fields(result):
    from course.charts.sim_to_real import layouts

    arms, line = layouts.start(8192), int(result.input("line", 64))
    size, read = result.input("size", layouts.BYTES), int(result.input("read", 32))

    def touched(numbers, width=256):
        """Return bytes of lines per arm: structures, then blocks of arrays."""
        return [
            layouts.lines_touched(make(arms, width), numbers, line)
            for make in (layouts.structures, layouts.blocks)
        ]

    loose, dense = touched(read // 8)
    result.measure("touched", loose, 1e-6)
    result.measure("dense", dense, 1e-6)
    factor = result.measure("factor", loose / dense, 1e-6)
    naive = result.measure("naive", size / (8 * len(arms[: read // 8])), 1e-6)

    def expected(numbers):
        """Return the average over all eight places in a line at which a structure can begin."""
        ends = [(8 * start + 8 * numbers - 1) // line + 1 for start in range(line // 8)]
        return line * float(np.mean(ends))

    # Neighbours share a line where the numbers read are nearly all: no more than all lines count.
    some = [(touched(k)[0], min(expected(k), size)) for k in range(1, 10)]
    every = touched(layouts.NUMBERS)
    result.statement = "Counted from the addresses of 8,192 arms in both layouts."
    result.statement_holds(abs(factor / naive - 1.0) < 0.05)
    result.correction_holds(
        all(abs(a - b) < 1.0 for a, b in some),
        abs(every[0] / every[1] - 1.0) < 1e-3,
        abs(dense - read) < 1e-9,
        # Chosen to break it: one structure as wide as the batch is a structure of arrays.
        abs(layouts.lines_touched(layouts.blocks(arms, 8192), read // 8, line) - read) < 1e-9,
    )
