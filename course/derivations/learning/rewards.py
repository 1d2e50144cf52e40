"""Claims of chapter 9 about reinforcement learning: rewards, evaluation, normalisation."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "gamma": Symbol("discount", 0.1, 0.99),
    "p": Symbol("true success rate", 0.05, 0.9),
    "R": Symbol("radius of the disc [m]", 0.01, 0.2),
    "L": Symbol("length of the path [m]", 0.5, 5.0),
    "S": Symbol("area in which the goal may be [m^2]", 1.0, 10.0),
    "P": Symbol("prize for finishing"),
}


@claim(
    "The first N episodes to finish in N environments estimate the success rate.",
    "If failures last much longer than successes, they finish too late to be counted. For very "
    "long failures the estimate of a success rate p below 1/2 is {formula}, and for a larger p "
    "it is 1. On the point task a policy that solves {true:.2f} of the starts, each counted once, "
    "was estimated at {read:.2f}, and another one that solves {true_more:.2f} at {read_more:.2f}.",
    ask=(
        "N environments restart by themselves. An episode succeeds with probability p, and then "
        "takes no time; a failure takes very long. All environments run until the first failure "
        "ends. How many successes has each had by then, on average?",
        "p/(1 - p)",
        {
            "p": (
                "An environment that succeeds starts another episode at once, and may succeed "
                "again."
            ),
            "p + p^2": "The second episode may be followed by a third success, and so on.",
            "1 - p": "This is the share of first episodes that fail.",
        },
    ),
)
def first_to_finish(result):
    import sympy

    from course.learning import evaluate, first_finished
    from course.vector_env import PointReachVector
    from course.vector_env.point import plan

    p, x = sympy.symbols("p x")
    # Expected successes before the first failure: those of a geometric distribution.
    result.formula = sympy.solve(sympy.Eq(x, p * (1 + x)), x)[0]  # one success, then as before

    def played(edge, N=128, clock=100, always=False):
        """Return true and estimated value of a policy that ignores goals too far left."""

        def act(observed):
            return np.where(observed[:, :1] > edge, plan(observed)[1], 0.0).astype(np.float32)

        envs = PointReachVector(N, max_steps=clock)
        true = evaluate(act, envs, 0).success.mean()
        return true, first_finished(act, envs, N, 0).success.mean()

    (true, read), (more, read_more) = played(0.1), played(-0.5)
    for name, value in (
        ("true", true),
        ("read", read),
        ("true_more", more),
        ("read_more", read_more),
    ):
        result.measure(name, value, 0.05)

    def shows(share, slow, quick=None):
        """Return a longer game in whole steps: successes take one step, failures `slow` steps.

        With `quick`, failures take `slow` or `quick` steps equally often, and successes the mean.
        """
        usual = 1 if quick is None else (slow + quick) // 2
        observed: list[bool] = []
        remaining = np.zeros(2000, dtype=int)
        wins = np.zeros(2000, dtype=bool)
        while len(observed) < 2000:
            new = remaining == 0
            wins[new] = result.rng.random(new.sum()) < share
            lengths = slow if quick is None else result.rng.choice([quick, slow], new.sum())
            remaining[new] = np.where(wins[new], usual, lengths)
            remaining -= 1
            observed += wins[remaining == 0].tolist()
        return abs(np.mean(observed[:2000]) - share) < 0.05

    result.statement = (
        "Two policies in 128 environments with a time limit of 100 steps; then games with random "
        "success rates."
    )
    # Equal durations as the control, and failures thirty times as long.
    inside, outside = ([shows(s, n) for s in result.rng.uniform(0.2, 0.8, 8)] for n in (1, 30))
    # Failures that take as long on average, but half of them are over at once.
    spread = [shows(s, 59, 1) for s in (0.2, 0.35, 0.5)]

    def few(share, N=5, times=400):
        """Return whether few environments agree on average, with lengths of a heavy tail."""
        wins = result.rng.random((times, N, N)) < share
        # Each environment's episodes end one after another; the first N of all count.
        ends = np.cumsum(result.rng.pareto(0.7, (times, N, N)), axis=2).reshape(times, -1)
        first = np.argsort(ends, axis=1)[:, :N]
        read = np.take_along_axis(wins.reshape(times, -1), first, axis=1).mean()
        return bool(abs(read - share) < 0.05)

    result.statement_holds(
        abs(read_more - more) < 0.05,
        only_if="the lengths of failures and successes have the same distribution",
        # Chosen to break it: few environments, some episodes a thousand times as long as others.
        inside=inside + [few(x) for x in (0.1, 0.3, 0.7, 0.9)],
        outside=outside + spread,
    )
    law = float(result.formula.subs(p, true))
    result.correction_holds(abs(read - law) < 0.1, read_more == 1.0, more < 0.8)


@claim(
    "From the start, each environment can normalise with running statistics of its own.",
    "The goal is the same during a whole episode, so the environment's own mean contains the "
    "goal, and subtracting it removes what the policy needs to know. After one episode, "
    "statistics per environment flipped the sign of the distance to the next goal in {own:.0%} "
    "of the environments, and after {n:.0f} episodes in {later:.0%}. Shared statistics flipped "
    "it in {shared:.0%}.",
)
def own_normaliser(result):
    from course.learning import Normaliser
    from course.vector_env import PointReachVector

    n = int(result.input("n", 4))

    def turned(episodes, shared, N=512):
        """Return the share of environments whose path along x to a new goal has the wrong sign."""
        envs, rows = PointReachVector(N, autoreset_mode="SameStep"), []
        observed, _ = envs.reset(seed=0)
        for _ in range(100 * episodes):
            rows.append(observed)
            push = np.clip(result.rng.standard_normal((N, 2)), -1.0, 1.0).astype(np.float32)
            observed = envs.step(push)[0]
        # One column per feature for shared statistics, one per feature and environment otherwise.
        table = np.array(rows).reshape(-1, 4 if shared else 4 * N)
        normaliser = Normaliser.blank(table.shape[1])
        normaliser.update(table)
        new, _ = envs.reset(seed=9000)
        report = normaliser(new.reshape(-1, table.shape[1])).reshape(N, 4)
        # Normalised and true distance of opposite sign: the policy would push away from the goal.
        return np.mean(report[:, 0] * new[:, 0] < 0.0)

    own, later = (result.measure(x, turned(k, False), 0.1) for x, k in (("own", 1), ("later", n)))
    shared = result.measure("shared", turned(1, True), 0.5)
    result.statement = "512 points with random actions, then a new goal for each."
    result.statement_holds(own < 0.05)
    result.correction_holds(own > later + 0.03, later > shared + 0.05, shared < 0.05)


@claim(
    "Random actions find a sparse reward in less than one episode in a hundred.",
    "You can estimate the chance before you train. All points within R of a path of length L form "
    "a strip of width 2 R, so with the goal anywhere in an area S the path meets it with "
    "probability "
    "{formula}. For random actions on the point task the estimate is {law:.1%} of the episodes, "
    "and {measured:.1%} succeeded. With a disc a quarter as wide the estimate is "
    "{small_law:.2%}, and {small:.2%} succeeded.",
    ask=(
        "A path of length L does not cross itself. The goal lies anywhere in an area S, all "
        "places equally likely. With what probability does the path come within R of the goal, "
        "if you ignore the ends of the path?",
        "2*R*L/S",
        {
            "R*L/S": "The path sweeps a strip on both of its sides.",
            "pi*R^2/S": "This is the probability for a point that does not move.",
            "2*R*L": "This is the swept area. Divide it by the area in which the goal may be.",
        },
    ),
)
def sparse_chance(result):
    import sympy

    from course.learning import evaluate
    from course.vector_env import PointReachVector

    R, L, S = sympy.symbols("R L S", positive=True)
    result.formula = sympy.integrate(2 * R, (sympy.Symbol("x"), 0, L)) / S
    N, rng = 20_000, np.random.default_rng(1)

    def pushes(*shape):
        return np.clip(rng.standard_normal((*shape, 2)), -1.0, 1.0).astype(np.float32)

    speed = 0.05 * np.cumsum(pushes(N, 100), axis=1)
    path, lengths = 0.05 * np.cumsum(speed, axis=1), 0.05 * np.hypot(*np.moveaxis(speed, 2, 0))
    # Start and goal are uniform in a square of 2 m, so the goal relative to the start has a
    # triangular density on each axis.
    dense = np.prod(np.clip(2.0 - np.abs(path), 0.0, None), axis=2) / 16.0  # of goals there, 1/S

    def law(radius):
        """Return the swept share for dense goals, for sparse ones, and on the start's disc."""
        swept = float(result.formula.subs({R: radius, L: 1, S: 1})) * np.sum(lengths * dense, 1)
        # The goals that the start's own disc already covers; the density there is 1/4.
        return swept.mean() + np.pi * radius**2 / 4.0

    def measured(radius, steps=100):
        envs = PointReachVector(N, radius=radius, max_steps=steps)
        return evaluate(lambda observed: pushes(N), envs, 0).success.mean()

    small = result.measure("small_law", law(0.0125), 0.05)
    report = result.measure("law", law(0.05), 0.05)
    observed = result.measure("measured", measured(0.05), 0.1)
    few = result.measure("small", measured(0.0125), 0.2)
    result.statement = "20,000 episodes of 100 steps each."
    inside, outside = (
        [bool(measured(x) < 0.01) for x in result.rng.uniform(*some, 8)]
        for some in ((0.001, 0.015), (0.03, 0.2))
    )
    # A single step sweeps nearly nothing, but the disc around the start counts too.
    still = [bool(measured(x, 1) < 0.01) for x in result.rng.uniform(0.13, 0.2, 4)]
    # Chosen to break it: goals that are mostly near the start.
    goals = 0.1 * result.rng.standard_normal((2000, 1, 2))
    met = np.hypot(*np.moveaxis(path[:2000] - goals, 2, 0)).min(axis=1) < 0.0125
    # Chosen to break it: the goal is equally likely anywhere, but each episode starts near it.
    area = result.rng.uniform(-1.0, 1.0, (2000, 1, 2))
    near = area + 0.1 * result.rng.standard_normal((2000, 1, 2))
    found = np.hypot(*np.moveaxis(near + path[:2000] - area, 2, 0)).min(axis=1) < 0.0125
    result.statement_holds(
        observed < 0.01,
        only_if="the goal is equally likely anywhere in its area, wherever the path starts, and "
        "a path and the disc around its start together sweep less than 1/100 of this area "
        "({formula} is the share of the path alone)",
        inside=inside,
        outside=[*outside, *still, bool(met.mean() < 0.01), bool(found.mean() < 0.01)],
    )
    result.correction_holds(
        # 30 %: a random path crosses itself, so the swept strip is an upper estimate, and 20,000
        # episodes leave some noise.
        abs(report / observed - 1.0) < 0.3,
        abs(measured(0.1) / law(0.1) - 1.0) < 0.3,
        0.6 < few / small < 1.3,
    )


@claim(
    "Paying minus the distance at every step is a shaping reward that leaves the best policy "
    "unchanged.",
    "The distances add up along the path, so this reward prefers paths that stay near the goal "
    "during the trip. In {plain:.0f} of {n:.0f} random tasks with two possible paths it changed "
    "which of them is best. Paying the difference of a potential, here minus the distance, "
    "changed it in {potential:.0f}.",
)
def minus_distance(result):
    from course.sim_to_real import Process, evaluate_policy, shaped, value_iteration

    def tried(n=12):
        """Return two ways of drawn lengths and distances: do these rewards keep the best one?"""
        last, ends = result.rng.integers(1, n - 2), np.arange(n) == n - 1
        P = np.repeat(np.eye(n, k=1)[:, None], 2, axis=1)
        # Two corridors to the same prize: both actions differ in the first state only.
        P[0, 1], P[last], P[-1] = np.eye(n)[last + 1], np.eye(n)[-1], np.eye(n)[-1]
        near, far = result.rng.uniform(0.1, 2.0, 2)
        deviation = np.where(np.arange(n) <= last, near, far) * ~ends
        prize = np.zeros((n, 2, n))
        prize[:-1, :, -1] = 1.0
        sparse, dense = (
            Process(P, x, 0.95, ends) for x in (prize, prize - deviation[:, None, None])
        )
        # Each reward's optimal policy, judged by the sparse reward that defines the task.
        policies = (value_iteration(x).policy for x in (sparse, dense, shaped(sparse, -deviation)))
        best, *others = (evaluate_policy(sparse, policy)[0] for policy in policies)
        return np.isclose(others, best)

    n = int(result.input("n", 60))
    retained = np.array([tried() for _ in range(n)])
    result.measure("tasks", len(retained))
    plain = result.measure("plain", np.sum(~retained[:, 0]))
    potential = result.measure("potential", np.sum(~retained[:, 1]), 0.0)
    result.statement = "Tasks with two paths of up to ten steps to the same prize, solved exactly."
    result.statement_holds(plain == 0)
    result.correction_holds(plain > 0.05 * n, potential == 0)


@claim(
    "A bonus for being near the goal makes a robot hover there instead of finishing.",
    "Waiting one more step earns the bonus once more but delays the prize P by a step. This "
    "pays off only if the bonus is above {formula} per step. This holds if the arriving step earns "
    "the bonus as well as the prize. If it earns the prize only, a smaller bonus is enough. Note "
    "also how often a bonus is "
    "paid: as a term of the step reward it is paid at every step near the goal, {paid:.0f} "
    "times in {steps:.0f} steps, not once.",
    ask=(
        "Near the goal every step pays a bonus b. The last step also pays the prize P and ends "
        "the episode. Above which b does it pay to wait for another step?",
        "b > (1 - gamma)*P/gamma",
        {
            "(1 - gamma)*P": "The additional bonus comes a step later, so it is discounted too.",
            "P": "Waiting does not cost the whole prize. It only delays it by a step.",
            "gamma*P/(1 - gamma)": (
                "This is the prize times the sum of all later discounts, not the cost of one "
                "step of delay."
            ),
        },
    ),
)
def hovering(result):
    import sympy

    from course.sim_to_real import Process, value_iteration
    from course.vector_env import PointReachVector

    gamma, P, b = sympy.symbols("gamma P b", positive=True)
    # Indifference: prize now, or the bonus now and the same choice a step later.
    result.formula = sympy.solve(sympy.Eq(b + P, b + gamma * (b + P)), b)[0]

    def hovers(share, discount, prize, last=1.0, risk=0.0, cost=0.0):
        """Return whether it is best to wait, solved exactly.

        Args:
            share: of the bonus at which waiting starts to pay off.
            discount: of a step.
            prize: for going.
            last: share of the bonus that the step to the prize is paid.
            risk: that the episode ends while waiting.
            cost: of each step, as a share of the bonus.
        """
        bonus = share * float(result.formula.subs({gamma: discount, P: prize}))
        net = bonus * (1.0 - cost)
        moves = np.array([[[1.0 - risk, risk], [0.0, 1.0]], [[0.0, 1.0], [0.0, 1.0]]])
        pays = np.array([[[net, net], [0.0, (last - cost) * bonus + prize]], np.zeros((2, 2))])
        return bool(
            value_iteration(Process(moves, pays, discount, np.array([False, True]))).policy[0] == 0
        )

    def goes_on(what, discount, prize, n=6):
        """Return whether it never finishes, with a bonus 5 % above the threshold.

        Here the "bonus" is paid for ever after the prize, or a new "goal" follows n steps later, or
        the "limit" of n steps is known.
        """
        bonus = 1.05 * float(result.formula.subs({gamma: discount, P: prize}))
        # State 0 is near the goal; action 0 waits, action 1 goes.
        if what == "limit":
            moves = np.repeat(np.eye(n + 1, k=1)[:, None], 2, axis=1)
            moves[:n, 1], moves[n] = np.eye(n + 1)[n], np.eye(n + 1)[n]
            pays = np.zeros((n + 1, 2, n + 1))
            pays[:n, 0], pays[:n, 1] = bonus, bonus + prize
            made = Process(moves, pays, discount, np.arange(n + 1) == n)
            return not np.any(value_iteration(made).policy[:n])
        moves = np.repeat(np.roll(np.eye(n), 1, axis=1)[:, None], 2, axis=1)
        pays = np.zeros((n, 2, n))
        moves[0, 0], pays[0, 0], pays[0, 1] = np.eye(n)[0], bonus, bonus + prize
        if what == "bonus":
            moves[1], pays[1] = np.eye(n)[1], bonus
        return bool(
            value_iteration(Process(moves, pays, discount, np.zeros(n, bool))).policy[0] == 0
        )

    steps = int(result.input("steps", 30))
    envs = PointReachVector(1, "hover", bonus=1.0)
    envs.reset(seed=0)
    still = np.zeros((1, 2), np.float32)
    result.measure("paid", np.sum([envs.step(still)[1][0] for _ in range(steps)]), 0.0)
    tasks = list(
        zip(result.rng.uniform(0.6, 0.98, 10), result.rng.uniform(0.5, 20.0, 10), strict=True)
    )
    result.statement = (
        "A task with two states, random discounts and prizes, solved exactly; and a point at rest "
        "near its goal."
    )
    # 5 % on both sides of the threshold, with random discounts and prizes.
    inside, outside = ([hovers(x, *task) for task in tasks] for x in (1.05, 0.95))
    result.statement_holds(
        all(outside),
        only_if="the prize ends the episode, steps cost nothing, waiting is safe, the robot knows "
        "of no time limit, and the bonus per step is above (1 - gamma) / gamma times the prize, "
        "where the step that wins the prize is paid the bonus as well",
        inside=inside,
        # Chosen to break it: an accident may happen while waiting, each step has a cost, the bonus
        # or the task goes on after the prize, or the robot can wait until its last step.
        outside=[
            *(goes_on(what, *task) for what in ("bonus", "goal", "limit") for task in tasks),
            *outside,
            *(hovers(1.05, *task, risk=0.2) for task in tasks),
            *(hovers(1.05, *task, cost=0.2) for task in tasks),
        ],
    )
    result.correction_holds(
        not any(outside),
        not any(goes_on(what, *task) for what in ("bonus", "limit") for task in tasks),
        result.figures["paid"] == steps,
        # The last step pays the prize only: 5 % above (1 - gamma) times the prize is enough.
        all(hovers(1.05 * x, x, prize, 0.0) for x, prize in tasks),
    )


@claim(
    "Without a penalty for time, a robot has no reason to move fast.",
    "A discount is a penalty for time: at {discount} per step a slow controller is worth "
    "{slow:.2f} and a fast one {fast:.2f}. Without a discount both are worth the same, as long "
    "as both arrive before a time limit or an accident, and nothing but arriving, once, is "
    "rewarded: a reward of minus the distance at every step is a penalty for time, too. And if a "
    "new goal follows each arrival, the fast one collects more rewards in the same time.",
)
def no_time_penalty(result):
    from course.learning import evaluate
    from course.vector_env import PointReachVector

    def worth(gain, gamma, reward="sparse"):
        def act(observed):
            # Critically damped PD law with the poles at -gain.
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        envs = PointReachVector(64, reward, max_steps=1000)
        return evaluate(act, envs, 0, discount=gamma).returns.mean()

    def interrupted(gain):
        """Return the mean return where each step ends the episode with a chance of 1 per cent."""

        def act(observed):
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        episodes = evaluate(act, PointReachVector(64, max_steps=1000), 0)
        limit = np.random.default_rng(0).geometric(0.01, (200, episodes.steps.size))
        return np.mean((limit > episodes.steps) * episodes.returns)

    def collected(gain):
        """Return the rewards in 1,000 steps where a new goal appears at each arrival."""

        def act(observed):
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        return np.mean(1000 // evaluate(act, PointReachVector(64, max_steps=1000), 0).steps)

    discount = result.input("discount", 0.99)
    slow, fast = (
        result.measure(x, worth(gain, discount), 1e-3) for x, gain in (("slow", 0.3), ("fast", 2.0))
    )
    same = [bool(abs(worth(0.3, x) - worth(2.0, x)) < 1e-9) for x in (1.0, 0.999, 0.95)]
    result.statement = (
        "64 starts, up to 1,000 steps, critically damped controllers with 0.3 / s and 2 / s."
    )
    # Chosen to break it: minus the distance at each step is no penalty for time by name only.
    dense = bool(abs(worth(0.3, 1.0, "distance") - worth(2.0, 1.0, "distance")) < 1e-9)
    # Chosen to break it: no discount, but arriving is rewarded again and again.
    repeated = bool(collected(0.3) > 0.9 * collected(2.0))
    result.statement_holds(
        all(same[1:]),
        only_if="nothing but arriving is rewarded, once and without a discount, and the slow robot "
        "arrives as surely as the fast one: no time limit, accident or departing goal comes first, "
        "and no slope needs a run-up",
        inside=same[:1],
        outside=[*same[1:], bool(interrupted(0.3) > 0.9 * interrupted(2.0)), dense, repeated],
        cases=True,
    )
    result.correction_holds(fast > slow + 0.1, not any(same[1:]))


@claim(
    "Reinforcement learning needs no data, only a network trained with PPO.",
    "Environment steps are its data, and the policy need not be a network. On the point task "
    "the best of {laws:.0f} random pairs of gains reaches {share:.0%} of the exact optimum in "
    "the median of {n:.0f} searches, and {least:.0%} in the worst. One search takes {steps:.0f} "
    "steps, which would be {hours:.1f} h of motion on a robot, without resets.",
)
def two_gains(result):
    from course.learning import evaluate
    from course.vector_env import PointReachVector
    from course.vector_env.point import optimum

    def played(gains, first, n):
        """Return the mean return of each law (k, 2) over n common starts, and all steps."""
        each = np.repeat(gains, n, axis=0)

        def act(observed):
            push = each[:, :1] * observed[:, :2] - each[:, 1:] * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        seeds = list(range(first, first + n)) * len(gains)
        episodes = evaluate(act, PointReachVector(len(each)), seeds)
        return episodes.returns.reshape(len(gains), n).mean(axis=1), episodes.steps.sum()

    laws, n = int(result.input("laws", 24)), int(result.input("n", 10))
    best, each = [], []
    for seed in range(n):
        some = np.random.default_rng(seed).uniform(0.0, 5.0, (laws, 2))
        worth, steps = played(some, 0, 32)
        best.append(some[np.argmax(worth)])
        each.append(steps)
    # Test starts with other seeds than the search: the best of 24 is biased on its own starts.
    starts, _ = PointReachVector(500).reset(seed=9000)
    shares = played(np.array(best), 9000, 500)[0] / optimum(starts).mean()
    share = result.measure("share", np.median(shares), 0.02)
    least = result.measure("least", shares.min(), 0.02)
    hours = result.measure(
        "hours", result.measure("steps", np.median(each), 0.02) * 0.05 / 3600, 0.02
    )
    result.statement = (
        "32 starts for each pair of gains, a test on 500 other starts, steps of 0.05 s; medians."
    )
    result.statement_holds(share < 0.5 and hours == 0.0)
    result.correction_holds(share > 0.8, least > 0.7, hours > 0.2)
