"""Claims of chapter 9 about reinforcement: advantages, the clip, evaluation, rewards, cost."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "d0": Symbol("error of the critic at this step"),
    "d1": Symbol("error one step later"),
    "d2": Symbol("error two steps later"),
    "gamma": Symbol("discount", 0.1, 0.99),
    "lam": Symbol("lambda of the trace", 0.1, 0.95),
    "r": Symbol("ratio of the new to the old probability", 1.3, 5.0),
    "A": Symbol("advantage, below 0 here", -5.0, -0.1),
    "clip": Symbol("how far from 1 the ratio counts", 0.05, 0.25),
    "p": Symbol("true share of successes, below 1/2", 0.05, 0.45),
    "R": Symbol("radius of the disc [m]", 0.01, 0.2),
    "L": Symbol("length of the way [m]", 0.5, 5.0),
    "S": Symbol("area in which the goal is, evenly [m^2]", 1.0, 10.0),
    "P": Symbol("prize for the end"),
    "d": Symbol("inputs of the network", 2.0, 50.0),
    "h": Symbol("width of each of two hidden layers", 8.0, 256.0),
    "m": Symbol("outputs of the network", 1.0, 20.0),
}


def drawn(rng, cut=0.0, T=40):
    """Return rewards, values, value after each step, ends and cuts of a run.

    The value after a step is that of the next row.
    """
    rewards, values, later = rng.normal(size=(3, T))
    ended, late = rng.random((2, T)) < [[0.1], [cut]]
    late &= ~ended
    late[T // 2], ended[T // 2] = cut > 0.0, False
    row = np.append(values[1:], later[-1])  # an episode that is cut has a last observation
    return rewards, values, np.where(late, later, row), ended, late, row


@claim(
    "Lambda mixes what n steps say of an advantage, for all n.",
    "The sum of the critic's errors, discounted by gamma lambda, with {formula} for three, is the "
    "mean of all n-step estimates with weights (1 - lambda) lambda^(n-1). Computed backwards it "
    "agrees with that double sum to {worst:.0e}, with episodes that end and that are cut.",
    ask=(
        "Three steps are left; d0, d1, d2 are the errors of the critic. Generalised advantage of "
        "the first?",
        "d0 + gamma*lam*d1 + gamma^2*lam^2*d2",
        {
            "d0 + gamma*d1 + gamma^2*d2": "That is for lambda = 1.",
            "d0 + lam*d1 + lam^2*d2": "Later errors are discounted too.",
            "d0": "That is for lambda = 0.",
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

    def double(rewards, values, after, ended, late):
        """Return every n-step estimate of every step, with its weight."""
        each = np.zeros(len(values))
        for t in range(len(values)):
            total, n, weight = -values[t], 0, 1.0
            while True:
                total += gamma**n * rewards[t + n]
                last = ended[t + n] or late[t + n] or t + n + 1 == len(values)
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
    result.statement = "20 drawn runs of 40 steps."
    result.statement_holds(np.abs(deviation).max() < 1e-12)
    result.correction_holds(np.abs(deviation).max() < 1e-12)


@claim(
    "In a batch of steps the value of the next row is that of what follows.",
    "Where an environment resets within the step that the clock cut off, the next row is another "
    "episode's start. Taken for what follows, it makes an advantage wrong by {worst:.1f} where "
    "values have a deviation of 1. Where the reset takes a step of its own, the next row is right, "
    "and the row after it is none to learn from.",
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
        right = gae(rewards, values, after, ended, late)
        return np.abs(gae(rewards, values, row, ended, late) - right).max()

    ended, cut = ([deviation(c) for _ in range(10)] for c in (0.0, 0.1))
    result.measure("worst", max(cut))
    result.statement = "Drawn runs of 40 steps, a tenth of them ends; without or with cuts."
    inside, outside = ([x < 1e-12 for x in some] for some in (ended, cut))
    result.statement_holds(
        all(outside),
        inside=inside,
        outside=outside,
        only_if="no episode is cut off and reset within the step",
    )
    result.correction_holds(
        min(cut) > 1e-3, max(ended) < 1e-12, follows("NextStep"), not follows("SameStep")
    )


@claim(
    "Where the ratio is beyond the clip there is no gradient.",
    "There is where the action has to come back: an advantage below 0 and a ratio above, or one "
    "above 0 and a ratio below. The objective takes the smaller one: there it is {formula}.",
    ask=(
        "Ratio r above 1 + clip, advantage A below 0: PPO's clipped objective?",
        "r*A",
        {
            "(1 + clip)*A": "That is the larger of the two.",
            "(1 - clip)*A": "The ratio is above.",
            "0*A": "A mistake that has become likelier is corrected.",
        },
    ),
    source="J. Schulman et al., Proximal policy optimization algorithms, 2017",
)
def beyond_the_clip(result):
    import sympy

    from course.learning import objective

    r, A, clip = sympy.symbols("r A clip", real=True)
    both, beyond = (r * A, (1 + clip) * A), {r: 1.5, A: -1, clip: 0.2}
    result.formula = min(both, key=lambda x: x.subs(beyond))

    def flat(ratio, advantage):
        """Return whether a small change of the ratio changes nothing, and the slope says so."""
        value, slope = objective(np.array([ratio, ratio + 1e-6]), np.full(2, advantage))
        return bool(abs(value[1] - value[0]) < 1e-12 and slope[0] == 0.0)

    size, over = result.rng.uniform(0.1, 3.0, 10), result.rng.uniform(0.21, 0.9, 10)
    signs = np.resize([1.0, -1.0], 10)
    result.measure("slope", objective(np.array([1.5]), np.array([-1.0]))[1][0])
    result.statement = "Finite differences of the objective, clip 0.2, at drawn ratios."
    inside, outside = (
        [flat(1.0 + s * k * x, s * y) for s, x, y in zip(signs, over, size, strict=True)]
        for k in (1.0, -1.0)
    )
    result.statement_holds(
        all(outside),
        only_if="it has moved the way its advantage pushes",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        not any(outside),
        abs(objective(np.array([1.5]), np.array([-2.0]))[0][0] + 3.0) < 1e-12,
        not flat(1.1, 1.0),
        not flat(0.9, -1.0),
    )


@claim(
    "PPO's clip keeps the new policy within 1 - eps and 1 + eps of the old one.",
    "It takes the reward away for going further, and steps go on: after an iteration on the point "
    "{share:.0%} of the actions have ratios beyond it, a mean divergence of {kl:.3f}. The first "
    "step of a batch, where all ratios are 1, is the plain policy gradient's.",
)
def clip_keeps(result):
    from course.learning import Settings, objective, ppo
    from course.vector_env import PointReachVector

    envs = PointReachVector(64, "potential", autoreset_mode="SameStep")
    settings = Settings(hidden=(16, 16), rate=1e-3, anneal=False)
    report = list(ppo(envs, settings, steps=64 * 32 * 3, seed=0))
    share = result.measure("share", np.mean([x.clipped for x in report]), 0.5)
    result.measure("kl", np.mean([x.kl for x in report]), 0.5)
    result.statement = (
        "Three iterations of 2,048 steps, five epochs, two layers 16 wide, rate 0.001, clip 0.2."
    )
    advantage = result.rng.normal(size=100)
    first = objective(np.ones(100), advantage)[1]
    result.statement_holds(share == 0.0)
    result.correction_holds(share > 0.02, np.array_equal(first, advantage))


@claim(
    "The first N episodes to finish in N environments tell how often a policy succeeds.",
    "If failures take far longer they come too late: one reads {formula} for a share p below 1/2, "
    "and 1 above. On the point a policy that ignores some goals succeeds in {true:.2f} and reads "
    "{read:.2f}; another {true_more:.2f} and {read_more:.2f}.",
    ask=(
        "Successes take a moment, failures for ever so long; N environments start anew by "
        "themselves. Successes by the time the first failures end, over N?",
        "p/(1 - p)",
        {
            "p": "Who succeeds plays again at once.",
            "p + p^2": "And again.",
            "1 - p": "That is the share of first episodes that fail.",
        },
    ),
)
def first_to_finish(result):
    import sympy

    from course.learning import evaluate, first_finished
    from course.vector_env import PointReachVector
    from course.vector_env.point import plan

    p, x = sympy.symbols("p x")
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

    def shows(share, slow):
        """Return a longer game in whole steps: successes take one step, failures `slow` steps."""
        observed: list[bool] = []
        remaining = np.zeros(2000, dtype=int)
        wins = np.zeros(2000, dtype=bool)
        while len(observed) < 2000:
            new = remaining == 0
            wins[new] = result.rng.random(new.sum()) < share
            remaining[new] = np.where(wins[new], 1, slow)
            remaining -= 1
            observed += wins[remaining == 0].tolist()
        return abs(np.mean(observed[:2000]) - share) < 0.05

    result.statement = "128 environments, 100 steps at most; then games of drawn shares."
    inside, outside = ([shows(s, n) for s in result.rng.uniform(0.2, 0.8, 8)] for n in (1, 30))
    result.statement_holds(
        abs(read_more - more) < 0.05,
        only_if="failures take as long as successes",
        inside=inside,
        outside=outside,
    )
    law = float(result.formula.subs(p, true))
    result.correction_holds(abs(read - law) < 0.1, read_more == 1.0, more < 0.8)


@claim(
    "Every environment may normalise its own observations.",
    "Its goal is the same all episode long, so it takes away what is to be learned. After one "
    "episode each an own normaliser turns the sign of the way to the next goal in {own:.0%} of "
    "environments, after {n:.0f} in {later:.0%}; a shared one in {shared:.0%}.",
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
        table = np.array(rows).reshape(-1, 4 if shared else 4 * N)
        normaliser = Normaliser.blank(table.shape[1])
        normaliser.update(table)
        new, _ = envs.reset(seed=9000)
        report = normaliser(new.reshape(-1, table.shape[1])).reshape(N, 4)
        return np.mean(report[:, 0] * new[:, 0] < 0.0)

    own, later = (result.measure(x, turned(k, False), 0.1) for x, k in (("own", 1), ("later", n)))
    shared = result.measure("shared", turned(1, True), 0.5)
    result.statement = "512 points pushed at random, new goals for all."
    result.statement_holds(own < 0.05)
    result.correction_holds(own > later + 0.03, later > shared + 0.05, shared < 0.05)


@claim(
    "Chance finds a sparse reward less than once in a hundred episodes.",
    "How often it does can be told: a way of length L sweeps {formula} of the goals. Random pushes "
    "of the point should get there in {law:.1%} of the episodes, {measured:.1%} do; into a disc a "
    "quarter as wide {small:.2%} of them.",
    ask=(
        "A point's way has length L and does not cross itself, the goal is anywhere in an area S: "
        "chance to pass within R of it, ends left out?",
        "2*R*L/S",
        {
            "R*L/S": "It sweeps to both sides.",
            "pi*R^2/S": "That is for a point that stays.",
            "2*R*L": "That is the area swept.",
        },
    ),
)
def sparse_chance(result):
    import sympy

    from course.learning import evaluate
    from course.vector_env import PointReachVector

    R, L, S = sympy.symbols("R L S", positive=True)
    result.formula = sympy.integrate(2 * R, (sympy.Symbol("x"), 0, L)) / S
    N, rng = 2000, np.random.default_rng(1)

    def pushes(*shape):
        return np.clip(rng.standard_normal((*shape, 2)), -1.0, 1.0).astype(np.float32)

    speed = 0.05 * np.cumsum(pushes(N, 100), axis=1)
    path, lengths = 0.05 * np.cumsum(speed, axis=1), 0.05 * np.hypot(*np.moveaxis(speed, 2, 0))
    dense = np.prod(np.clip(2.0 - np.abs(path), 0.0, None), axis=2) / 16.0  # of goals there, 1/S

    def law(radius):
        """Return the swept share for dense goals, for sparse ones, and on the start's disc."""
        swept = float(result.formula.subs({R: radius, L: 1, S: 1})) * np.sum(lengths * dense, 1)
        return swept.mean() + np.pi * radius**2 / 4.0

    def measured(radius):
        envs = PointReachVector(N, radius=radius)
        return evaluate(lambda observed: pushes(N), envs, 0).success.mean()

    report = result.measure("law", law(0.05), 0.05)
    observed = result.measure("measured", measured(0.05), 0.1)
    result.measure("small", measured(0.0125), 0.2)
    result.statement = "2,000 episodes of 100 steps each."
    inside, outside = (
        [bool(measured(x) < 0.01) for x in result.rng.uniform(*some, 8)]
        for some in ((0.001, 0.015), (0.03, 0.2))
    )
    result.statement_holds(
        observed < 0.01,
        only_if="{formula}, taken where goals are dense, is below 1/100",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        abs(report / observed - 1.0) < 0.3, abs(measured(0.1) / law(0.1) - 1.0) < 0.3
    )


@claim(
    "Minus the distance at each step is shaping that does not dictate the way.",
    "It pays for being near on the way. Of {n:.0f} drawn tasks with two ways the best one differs "
    "in {plain:.0f}; with the difference of the potential, minus the distance, in {potential:.0f}.",
)
def minus_distance(result):
    from course.sim_to_real import Process, evaluate_policy, shaped, value_iteration

    def tried(n=12):
        """Return two ways of drawn lengths and distances: do these rewards keep the best one?"""
        last, ends = result.rng.integers(1, n - 2), np.arange(n) == n - 1
        P = np.repeat(np.eye(n, k=1)[:, None], 2, axis=1)
        P[0, 1], P[last], P[-1] = np.eye(n)[last + 1], np.eye(n)[-1], np.eye(n)[-1]
        near, far = result.rng.uniform(0.1, 2.0, 2)
        deviation = np.where(np.arange(n) <= last, near, far) * ~ends
        prize = np.zeros((n, 2, n))
        prize[:-1, :, -1] = 1.0
        sparse, dense = (
            Process(P, x, 0.95, ends) for x in (prize, prize - deviation[:, None, None])
        )
        policies = (value_iteration(x).policy for x in (sparse, dense, shaped(sparse, -deviation)))
        best, *others = (evaluate_policy(sparse, policy)[0] for policy in policies)
        return np.isclose(others, best)

    n = int(result.input("n", 60))
    retained = np.array([tried() for _ in range(n)])
    plain = result.measure("plain", np.sum(~retained[:, 0]))
    potential = result.measure("potential", np.sum(~retained[:, 1]), 0.0)
    result.statement = "Two ways of up to ten steps to one end with a prize, solved exactly."
    result.statement_holds(plain == 0)
    result.correction_holds(plain > 0.05 * n, potential == 0)


@claim(
    "A bonus for being near the goal makes a robot hover there.",
    "Only one above {formula} a step: else the prize, put off by a step, loses more. And a bonus "
    "in the reward of a step is paid at every step near, {paid:.0f} times in {steps:.0f} steps, "
    "not once.",
    ask=(
        "Near the goal each step pays b, the last one the prize P besides and ends it. From which "
        "b on does it pay to wait?",
        "b > (1 - gamma)*P/gamma",
        {
            "(1 - gamma)*P": "The bonus won is one of the step after.",
            "P": "That compares a step with the whole prize.",
            "gamma*P/(1 - gamma)": "That is all bonuses to come over one.",
        },
    ),
)
def hovering(result):
    import sympy

    from course.sim_to_real import Process, value_iteration
    from course.vector_env import PointReachVector

    gamma, P, b = sympy.symbols("gamma P b", positive=True)
    result.formula = sympy.solve(sympy.Eq(b + P, b + gamma * (b + P)), b)[0]

    def hovers(share, discount, prize):
        """Return near (0) or over (1): wait or go, solved exactly."""
        bonus = share * float(result.formula.subs({gamma: discount, P: prize}))
        moves = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 1.0], [0.0, 1.0]]])
        pays = np.array([[[bonus, 0.0], [0.0, bonus + prize]], np.zeros((2, 2))])
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
    result.statement = "Two states with drawn discounts and prizes; a point that rests near."
    inside, outside = ([hovers(x, *task) for task in tasks] for x in (1.05, 0.95))
    result.statement_holds(
        all(outside),
        only_if="the bonus is above (1 - gamma) / gamma of the prize",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(not any(outside), result.figures["paid"] == steps)


@claim(
    "Without a penalty for time a robot moves as slowly as it likes.",
    "A discount is one: at {discount} a step a slow law is worth {slow:.2f}, a fast one "
    "{fast:.2f}. Without it both are worth the same as long as the clock leaves them time.",
)
def no_time_penalty(result):
    from course.learning import evaluate
    from course.vector_env import PointReachVector

    def worth(gain, gamma):
        def act(observed):
            push = gain**2 * observed[:, :2] - 2.0 * gain * observed[:, 2:]
            return np.clip(push, -1.0, 1.0).astype(np.float32)

        envs = PointReachVector(64, max_steps=1000)
        return evaluate(act, envs, 0, discount=gamma).returns.mean()

    discount = result.input("discount", 0.99)
    slow, fast = (
        result.measure(x, worth(gain, discount), 1e-3) for x, gain in (("slow", 0.3), ("fast", 2.0))
    )
    same = [bool(abs(worth(0.3, x) - worth(2.0, x)) < 1e-9) for x in (1.0, 0.999, 0.95)]
    result.statement = "64 starts, up to 1,000 steps, critically damped laws of 0.3 / s and 2 / s."
    result.statement_holds(
        all(same[1:]),
        only_if="nothing is discounted and no clock runs out",
        inside=same[:1],
        outside=same[1:],
        cases=True,
    )
    result.correction_holds(fast > slow + 0.1, not any(same[1:]))


@claim(
    "Reinforcement learning needs no data, and a network trained by PPO.",
    "It needs steps. On the point a law of two gains, the best of {laws:.0f} drawn ones, gets "
    "{share:.0%} of the exact optimum, {least:.0%} in the worst of {n:.0f} such searches; one took "
    "{steps:.0f} steps, {hours:.1f} h on a robot.",
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
    starts, _ = PointReachVector(500).reset(seed=9000)
    shares = played(np.array(best), 9000, 500)[0] / optimum(starts).mean()
    share = result.measure("share", np.median(shares), 0.02)
    least = result.measure("least", shares.min(), 0.02)
    hours = result.measure(
        "hours", result.measure("steps", np.median(each), 0.02) * 0.05 / 3600, 0.02
    )
    result.statement = "32 starts a law, tested on 500 others, steps of 0.05 s; medians."
    result.statement_holds(share < 0.5 and hours == 0.0)
    result.correction_holds(share > 0.8, least > 0.7, hours > 0.2)


@claim(
    "The gradient by all weights costs no more than two times what the output costs.",
    "Of products of a network of two hidden layers the backward pass takes {formula}, in PyTorch "
    "{ratio:.2f} times the forward one's for {width:.0f} units a layer. What autograd adds are "
    "calls: {calls:.0f} operators in one step, whatever the width.",
    ask=(
        "d inputs, two hidden layers of h, m outputs. A forward pass takes d h + h h + h m "
        "products a row; how many the backward pass, by all weights?",
        "d*h + 2*h^2 + 2*h*m",
        {
            "d*h + h^2 + h*m": "That is for the weights, or for what comes in, not both.",
            "2*d*h + 2*h^2 + 2*h*m": "Nobody asks for the slope by the inputs.",
            "3*d*h + 3*h^2 + 3*h*m": "That is with the forward pass, and by the inputs.",
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
        return *(x.get_total_flops() / (2 * rows) for x in (forward, backward)), calls.number

    width, widths = int(result.input("width", 64)), (8, 64, 256)
    forward, back, calls = counted(width)
    result.measure("ratio", back / forward)
    result.measure("calls", calls, 0.3)
    each = [counted(x) for x in widths]
    law = [float(result.formula.subs({d: 4, h: x, m: 2})) for x in widths]
    result.statement = "PyTorch's own count of products and calls, 4 inputs and 2 outputs."
    result.statement_holds(all(b <= 2.0 * f for f, b, _ in each))
    result.correction_holds(
        np.allclose([b for _, b, _ in each], law), len({c for *_, c in each}) == 1
    )
