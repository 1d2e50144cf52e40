"""Claims of chapter 9 about reinforcement learning: advantages, the clip, rewards, evaluation."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "d0": Symbol("one-step error of the critic at this step"),
    "d1": Symbol("one-step error one step later"),
    "d2": Symbol("one-step error two steps later"),
    "gamma": Symbol("discount", 0.1, 0.99),
    "lam": Symbol("lambda", 0.1, 0.95),
    "rho": Symbol("probability ratio, new over old", 1.3, 5.0),
    "A": Symbol("advantage, negative here", -5.0, -0.1),
    "clip": Symbol("half-width of the clip range", 0.05, 0.25),
    "p": Symbol("true success rate", 0.05, 0.9),
    "R": Symbol("radius of the disc [m]", 0.01, 0.2),
    "L": Symbol("length of the path [m]", 0.5, 5.0),
    "S": Symbol("area in which the goal may be [m^2]", 1.0, 10.0),
    "P": Symbol("prize for finishing"),
    "d": Symbol("number of inputs", 2.0, 50.0),
    "h": Symbol("units in each of two hidden layers", 8.0, 254.0),
    "m": Symbol("number of outputs", 1.0, 20.0),
    "u": Symbol("sampled action", -3.0, 3.0),
    "mu": Symbol("mean of the policy", -2.0, 2.0),
    "sigma": Symbol("standard deviation of the policy", 0.2, 2.0),
}


def drawn(rng, cut=0.0, T=40):
    """Return rewards, values, value after each step, ends and cuts of a run.

    The value after a step is that of the next row.
    """
    rewards, values, later = rng.normal(size=(3, T))
    ended, late = rng.random((2, T)) < [[0.1], [cut]]
    late &= ~ended
    # At least one cut-off row in each run with time limits.
    late[T // 2], ended[T // 2] = cut > 0.0, False
    row = np.append(values[1:], later[-1])  # an episode that is cut has a last observation
    return rewards, values, np.where(late, later, row), ended, late, row


@claim(
    "Subtracting a baseline that does not depend on the action leaves the expected policy gradient "
    "unchanged.",
    "A constant times the derivative of the log-probability is zero on average, for a Gaussian "
    "policy because {formula} has mean zero. In {n:.0f} random one-step tasks the expected "
    "gradient agrees with the exact derivative to {worst:.0e}, with and without a baseline. Only "
    "the noise changes: with the expected return as the baseline, the standard deviation of one "
    "estimate is {share:.0%} of that without, in the median.",
    ask=(
        "A policy samples an action u from a normal distribution with mean mu and standard "
        "deviation sigma. What is the derivative of the logarithm of its probability density "
        "with respect to mu?",
        "(u - mu)/sigma^2",
        {
            "(u - mu)/sigma": "The exponent is (u - mu)^2 / (2 sigma^2): the square stays below.",
            "(mu - u)/sigma^2": "A larger mean makes an action above the mean likelier.",
            "(u - mu)^2/sigma^2": "This is twice the exponent itself, not its derivative.",
        },
    ),
    source="R. Williams, Simple statistical gradient-following algorithms, 1992",
)
def baseline_is_free(result):
    import sympy

    u, mu, sigma = sympy.symbols("u mu sigma", real=True)
    result.formula = sympy.diff(-((u - mu) ** 2) / (2 * sigma**2), mu)
    # Gauss-Hermite quadrature: expectations under the Gaussian policy without sampling noise.
    nodes, weights = np.polynomial.hermite_e.hermegauss(12)
    weights = weights / weights.sum()  # exact for polynomials up to degree 23
    n = int(result.input("n", 40))
    deviation, noise = [], []
    for _ in range(n):
        mean, goal, level, baseline = result.rng.uniform(-3.0, 3.0, 4)
        spread = result.rng.uniform(0.2, 2.0)
        action = mean + spread * nodes
        paid, score = level - (action - goal) ** 2, (action - mean) / spread**2
        exact = -2.0 * (mean - goal)  # of the expected reward, level - (mean - goal)^2 - spread^2

        def moments(b, paid=paid, score=score):
            # Score-function estimator (REINFORCE) with a baseline b.
            sample = score * (paid - b)
            first = weights @ sample
            return first, np.sqrt(weights @ sample**2 - first**2)

        # Random baselines too: the claim is about any that does not depend on the action.
        deviation += [abs(moments(b)[0] - exact) for b in (0.0, baseline)]
        noise.append(moments(weights @ paid)[1] / moments(0.0)[1])
    worst = result.measure("worst", max(deviation), 0.5)
    share = result.measure("share", np.median(noise), 0.01)
    result.statement = "Random one-step tasks with a quadratic reward, integrated exactly."
    result.statement_holds(worst < 1e-9)
    result.correction_holds(worst < 1e-9, share < 0.9)


@claim(
    "Generalised advantage estimation is a weighted mean of all n-step advantage estimates, whose "
    "weights are (1 - lambda) times 1, lambda, lambda^2 and so on; the longest estimate gets "
    "the rest, so that the weights add up to 1.",
    "The same number is easier to compute from the critic's one-step errors d0, d1 and so on: "
    "it is their sum, with one more factor of gamma lambda for each step ahead. With three "
    "steps left it is {formula}. Both computations agree to {worst:.0e}, also where episodes "
    "end or are cut off by a time limit.",
    ask=(
        "Three steps of an episode are left. The critic's one-step errors are d0, d1 and d2. "
        "What is the generalised advantage of the first step?",
        "d0 + gamma*lam*d1 + gamma^2*lam^2*d2",
        {
            "d0 + gamma*d1 + gamma^2*d2": "This is the estimate for lambda = 1.",
            "d0 + lam*d1 + lam^2*d2": "Later errors are discounted by gamma as well.",
            "d0": "This is the estimate for lambda = 0.",
        },
    ),
    source="J. Schulman et al., High-dimensional continuous control, 2016",
)
def lambda_mixes(result):
    import sympy

    from course.learning import gae

    d = sympy.symbols("d0:3")
    g, lam = sympy.symbols("gamma lam")
    ahead = [sum(g**i * d[i] for i in range(n)) for n in (1, 2, 3)]  # of one, two, three steps
    mixed = (1 - lam) * (ahead[0] + lam * ahead[1]) + lam**2 * ahead[2]
    result.formula = sympy.expand(mixed)
    gamma, trace = 0.97, 0.9

    # The definition by n-step estimates, O(T^2), independent of the backward recursion in `gae`.
    def double(rewards, values, after, ended, late):
        """Return every n-step estimate of every step, with its weight."""
        each = np.zeros(len(values))
        for t in range(len(values)):
            total, n, weight = -values[t], 0, 1.0
            while True:
                total += gamma**n * rewards[t + n]
                # An end, a time limit and the end of the batch each stop the sum.
                last = ended[t + n] or late[t + n] or t + n + 1 == len(values)
                # Bootstrapping: a terminal state is worth 0, a cut-off one what the critic says.
                rest = 0.0 if ended[t + n] else gamma ** (n + 1) * after[t + n]
                each[t] += weight * (1.0 if last else 1.0 - trace) * (total + rest)
                if last:
                    break
                weight, n = weight * trace, n + 1
        return each

    deviation = [
        gae(a, b, c, e, f, gamma, trace) - double(a, b, c, e, f)
        for a, b, c, e, f, _ in (drawn(result.rng, 0.1) for _ in range(20))
    ]
    result.measure("worst", np.abs(deviation).max(), 0.5)
    result.statement = "20 random runs of 40 steps, with ends and time limits."
    result.statement_holds(np.abs(deviation).max() < 1e-12)
    result.correction_holds(np.abs(deviation).max() < 1e-12)


@claim(
    "In a batch of steps, GAE may take the value of the next row as the value of the state that "
    "the step led to.",
    "If the environment resets within the step that reaches the time limit, the next row "
    "already belongs to the next episode. Using its value made an advantage wrong by "
    "{worst:.1f}, where values have a standard deviation of 1. If the reset takes a step of its "
    "own, the next row is right, but the step that only resets has to be left out of the batch. "
    "Where an episode terminates, the next row does no harm: GAE counts this value as 0.",
)
def next_row(result):
    from course.learning import gae
    from course.vector_env import PointReachVector

    def follows(mode):
        """Return whether the row after a truncated one holds this mode's next position."""
        envs = PointReachVector(8, max_steps=5, autoreset_mode=mode)
        before, late = envs.reset(seed=0)[0], np.zeros(8, bool)
        while not late.any():
            last, (observed, _, _, late, _) = before, envs.step(np.zeros((8, 2), np.float32))
            before = observed
        return bool(np.array_equal(observed, last))  # nobody pushes: a point stays where it is

    def deviation(cut):
        rewards, values, after, ended, late, row = drawn(result.rng, cut)
        # The same batch with the true successor values and with those of the next row.
        right = gae(rewards, values, after, ended, late)
        return np.abs(gae(rewards, values, row, ended, late) - right).max()

    def mixed():
        """Return the error where two environments' rows take turns in the batch."""
        runs = [drawn(result.rng) for _ in range(2)]
        values, other = runs[0][1], runs[1][1]
        rewards, _, after, ended, late, _ = runs[0]
        right = gae(rewards, values, after, ended, late)
        return np.abs(gae(rewards, values, other, ended, late) - right).max()

    ended, cut = ([deviation(c) for _ in range(10)] for c in (0.0, 0.1))
    result.measure("worst", max(cut))
    result.statement = (
        "Random runs of 40 steps in which a tenth of the steps end an episode, with and without "
        "time limits."
    )
    inside, outside = ([x < 1e-12 for x in some] for some in (ended, cut))
    result.statement_holds(
        all(outside),
        inside=inside,
        outside=outside + [mixed() < 1e-12 for _ in range(4)],
        only_if="the rows are one environment's, in order, and no episode is cut off by a time "
        "limit and reset within the same step",
    )
    result.correction_holds(
        min(cut) > 1e-3, max(ended) < 1e-12, follows("NextStep"), not follows("SameStep")
    )


@claim(
    "Where the ratio is outside the clip range, PPO's objective has no gradient.",
    "The gradient is gone for a good action that is already likelier, and for a bad action that "
    "is already less likely. In the two opposite cases the unclipped term is the smaller one "
    "and pulls the ratio back. For a bad action that has become likelier the objective is "
    "{formula}.",
    ask=(
        "The ratio rho is above 1 + clip and the advantage A is negative. What is PPO's clipped "
        "objective for this action?",
        "rho*A",
        {
            "(1 + clip)*A": (
                "This is the clipped term. It is the larger of the two, and the objective is "
                "the smaller."
            ),
            "(1 - clip)*A": "The ratio is above the clip range, not below it.",
            "0*A": (
                "The objective is not zero: a bad action that has become likelier is corrected."
            ),
        },
    ),
    source="J. Schulman et al., Proximal policy optimization algorithms, 2017",
)
def beyond_the_clip(result):
    import sympy

    from course.learning import clipped_objective

    rho, A, clip = sympy.symbols("rho A clip", real=True)
    both, beyond = (rho * A, (1 + clip) * A), {rho: 1.5, A: -1, clip: 0.2}
    result.formula = min(both, key=lambda x: x.subs(beyond))

    def flat(ratio, advantage):
        """Return whether a small change of the ratio changes nothing, and the slope says so."""
        value, slope = clipped_objective(np.array([ratio, ratio + 1e-6]), np.full(2, advantage))
        return bool(abs(value[1] - value[0]) < 1e-12 and slope[0] == 0.0)

    # From just outside the clip range of 0.2, with advantages of both signs.
    size, over = result.rng.uniform(0.1, 3.0, 10), result.rng.uniform(0.21, 0.9, 10)
    signs = np.resize([1.0, -1.0], 10)
    result.measure("slope", clipped_objective(np.array([1.5]), np.array([-1.0]))[1][0])
    result.statement = "Finite differences of the objective at random ratios, with a clip of 0.2."
    inside, outside = (
        # k = 1: the ratio moved as its advantage pushes; k = -1: against it.
        [flat(1.0 + s * k * x, s * y) for s, x, y in zip(signs, over, size, strict=True)]
        for k in (1.0, -1.0)
    )
    result.statement_holds(
        all(outside),
        only_if="the ratio moved in the direction in which its advantage pushes",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        not any(outside),
        abs(clipped_objective(np.array([1.5]), np.array([-2.0]))[0][0] + 3.0) < 1e-12,
        # Inside the range the gradient exists, so "flat" isn't true of every input.
        not flat(1.1, 1.0),
        not flat(0.9, -1.0),
    )


@claim(
    "PPO's clip keeps every probability ratio between 1 - eps and 1 + eps.",
    "The clip removes the incentive to go further, but it does not hold the ratio. After an "
    "iteration on the point task {share:.0%} of the ratios were outside the range, at a mean KL "
    "divergence of {kl:.3f}. With large steps the clip still matters: in the first three "
    "iterations with a step size of {large} and {many:.0f} epochs the divergence was "
    "{strong:.3f}, and {free:.1f} without the clip. In "
    "the first gradient step of a batch all ratios are 1, so the clip does nothing and the step "
    "is that of the plain policy gradient.",
)
def clip_keeps(result):
    from course.learning import Settings, clipped_objective, ppo
    from course.vector_env import PointReachVector

    # A real training run, since only several epochs on one batch move the ratios.
    envs = PointReachVector(64, "potential", autoreset_mode="SameStep")
    settings = Settings(hidden=(16, 16), rate=1e-3, anneal=False)
    report = list(ppo(envs, settings, steps=64 * 32 * 3, seed=0))
    share = result.measure("share", np.mean([x.clipped for x in report]), 0.5)
    result.measure("kl", np.mean([x.kl for x in report]), 0.5)

    large, epochs = result.input("large", 0.01), int(result.input("many", 20))

    def moved(clip):
        """Return the median divergence per iteration with large steps and many epochs."""
        how = replace(settings, rate=large, epochs=epochs, clip=clip)
        runs = [ppo(envs, how, steps=64 * 32 * 3, seed=seed) for seed in range(3)]
        return np.median([x.kl for run in runs for x in run])

    strong = result.measure("strong", moved(0.2), 0.5)
    free = result.measure("free", moved(np.inf), 0.5)
    result.statement = (
        "Three iterations of 2,048 steps with five epochs, two layers of 16 units, a step size of "
        "0.001 and a clip of 0.2; then three seeds with 20 epochs and a step size of 0.01."
    )
    advantage = result.rng.normal(size=100)
    first = clipped_objective(np.ones(100), advantage)[1]
    result.statement_holds(share == 0.0)
    result.correction_holds(share > 0.02, np.array_equal(first, advantage), free > 10.0 * strong)


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
    result.statement_holds(
        abs(read_more - more) < 0.05,
        only_if="the lengths of failures and successes have the same distribution",
        inside=inside,
        outside=outside + spread,
    )
    law = float(result.formula.subs(p, true))
    result.correction_holds(abs(read - law) < 0.1, read_more == 1.0, more < 0.8)


@claim(
    "Each environment can normalise its observations with its own running statistics.",
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
    result.statement_holds(
        observed < 0.01,
        only_if="the share of the goal's area that a path sweeps, {formula} and the disc at its "
        "start, is below 1/100",
        inside=inside,
        outside=outside + still,
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
    "pays off only if the bonus is above {formula} per step, where the next step can win the prize "
    "and is paid the bonus, too; else a smaller one is enough. Note also how often a bonus is "
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

    def hovers(share, discount, prize, last=1.0):
        """Return near (0) or over (1): wait or go, solved exactly; the last step's share of it."""
        bonus = share * float(result.formula.subs({gamma: discount, P: prize}))
        moves = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [0.0, 1.0]]])
        pays = np.array([[[bonus, 0.0], [0.0, last * bonus + prize]], np.zeros((2, 2))])
        return bool(
            value_iteration(Process(moves, pays, discount, np.array([False, True]))).policy[0] == 0
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
        only_if="the bonus per step is above (1 - gamma) / gamma times the prize, if the step that "
        "wins the prize is paid the bonus as well",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        not any(outside),
        result.figures["paid"] == steps,
        # The last step pays the prize only: 5 % above (1 - gamma) times the prize is enough.
        all(hovers(1.05 * x, x, prize, 0.0) for x, prize in tasks),
    )


@claim(
    "Without a penalty for time, a robot has no reason to move fast.",
    "A discount is a penalty for time: at {discount} per step a slow controller is worth "
    "{slow:.2f} and a fast one {fast:.2f}. Without a discount both are worth the same, as long "
    "as both arrive before a time limit or an accident.",
)
def no_time_penalty(result):
    from course.learning import evaluate
    from course.vector_env import PointReachVector

    def worth(gain, gamma):
        def act(observed):
            # Critically damped PD law with the poles at -gain.
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        envs = PointReachVector(64, max_steps=1000)
        return evaluate(act, envs, 0, discount=gamma).returns.mean()

    def interrupted(gain):
        """Return the mean return where each step ends the episode with a chance of 1 per cent."""

        def act(observed):
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        episodes = evaluate(act, PointReachVector(64, max_steps=1000), 0)
        limit = np.random.default_rng(0).geometric(0.01, (200, episodes.steps.size))
        return np.mean((limit > episodes.steps) * episodes.returns)

    discount = result.input("discount", 0.99)
    slow, fast = (
        result.measure(x, worth(gain, discount), 1e-3) for x, gain in (("slow", 0.3), ("fast", 2.0))
    )
    same = [bool(abs(worth(0.3, x) - worth(2.0, x)) < 1e-9) for x in (1.0, 0.999, 0.95)]
    result.statement = (
        "64 starts, up to 1,000 steps, critically damped controllers with 0.3 / s and 2 / s."
    )
    result.statement_holds(
        all(same[1:]),
        only_if="rewards are not discounted, no time limit is reached, and nothing else can end "
        "the episode",
        inside=same[:1],
        outside=[*same[1:], bool(interrupted(0.3) > 0.9 * interrupted(2.0))],
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


@claim(
    "Computing the gradient with respect to all weights costs at most twice as many "
    "multiplications as the forward pass.",
    "With two hidden layers the backward pass takes {formula} multiplications per sample, in "
    "PyTorch {ratio:.2f} times the forward pass for {width:.0f} units per layer. Small networks "
    "probably spend their time elsewhere: one gradient step makes {calls:.0f} operator calls, "
    "whatever the width.",
    ask=(
        "A network has d inputs, two hidden layers of h units and m outputs. The forward pass "
        "takes d h + h h + h m multiplications per sample. How many does the backward pass "
        "take, for the gradient with respect to all weights?",
        "d*h + 2*h^2 + 2*h*m",
        {
            "d*h + h^2 + h*m": (
                "All layers but the first need two products: one for their weights and one to "
                "pass the error on to their inputs."
            ),
            "2*d*h + 2*h^2 + 2*h*m": (
                "The first layer need not pass the error on to the network's inputs."
            ),
            "3*d*h + 3*h^2 + 3*h*m": (
                "This includes the forward pass and the gradient with respect to the inputs."
            ),
        },
    ),
)
def gradient_cost(result):
    import sympy
    from torch.utils._python_dispatch import TorchDispatchMode
    from torch.utils.flop_counter import FlopCounterMode

    from course.learning import network, tensor

    d, h, m = sympy.symbols("d h m", positive=True)
    layers = (d * h, h * h, h * m)
    result.formula = sympy.expand(2 * sum(layers) - layers[0])  # by weights, by what comes in

    class Calls(TorchDispatchMode):
        """Counts operators."""

        number = 0

        def __torch_dispatch__(self, func, types, args=(), kwargs=None):
            self.number += 1
            return func(*args, **(kwargs or {}))

    def counted(width, rows=256):
        """Return products a row, forward and backward, and calls of both."""
        net, observed = network((4, width, width, 2), 0), tensor(np.ones((rows, 4)))
        with FlopCounterMode(display=False) as forward:
            out = net(observed).square().mean()
        with FlopCounterMode(display=False) as backward:
            out.backward()
        with Calls() as calls:
            net(observed).square().mean().backward()
        # PyTorch counts a multiplication and an addition as two operations.
        return *(x.get_total_flops() / (2 * rows) for x in (forward, backward)), calls.number

    width, widths = int(result.input("width", 64)), (8, 64, 256)
    forward, back, calls = counted(width)
    result.measure("ratio", back / forward)
    result.measure("calls", calls, 0.3)
    each = [counted(x) for x in widths]
    law = [float(result.formula.subs({d: 4, h: x, m: 2})) for x in widths]
    result.statement = (
        "PyTorch's own count of multiplications and calls, for 4 inputs and 2 outputs."
    )
    result.statement_holds(all(b <= 2.0 * f for f, b, _ in each))
    result.correction_holds(
        np.allclose([b for _, b, _ in each], law), len({c for *_, c in each}) == 1
    )
