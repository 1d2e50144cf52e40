"""Claims of chapter 9 about policy gradients: baselines, advantages, the clip, and their cost."""

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
    "If the environment resets within the step that cuts an episode off, by a time limit or "
    "otherwise, the next row already belongs to the next episode. Using its value made an "
    "advantage wrong by {worst:.1f}, where values have a standard deviation of 1. If the reset "
    "takes a step of its own, the next row is right. The step that only resets has to be left out "
    "of the batch, but only after GAE has used its value. The last row of a batch has no next row, "
    "so its value has to be computed separately. "
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

    def without_last():
        """Return the error where the batch's last row has no next row, and 0 is taken."""
        rewards, values, after, ended, late, row = drawn(result.rng)
        ended[-1] = False
        right = gae(rewards, values, after, ended, late)
        return np.abs(gae(rewards, values, np.append(row[:-1], 0.0), ended, late) - right).max()

    def with_gap():
        """Return the error where the step that only resets is dropped before GAE."""
        rewards, values, after, ended, late, row = drawn(result.rng)
        k = len(rewards) // 2
        late[k - 1], ended[k - 1] = True, False
        rewards, values, after, ended, late = (
            np.delete(x, k) for x in (rewards, values, after, ended, late)
        )
        right = gae(rewards, values, after, ended, late)
        following = np.append(values[1:], row[-1])
        return np.abs(gae(rewards, values, following, ended, late) - right).max()

    result.statement = (
        "Random runs of 40 steps in which a tenth of the steps end an episode, with and without "
        "time limits."
    )
    inside, outside = ([x < 1e-12 for x in some] for some in (ended, cut))
    result.statement_holds(
        all(outside),
        inside=inside,
        # Chosen to break it: rows of two environments in turn, the last row of a batch, and a row
        # that was dropped too early.
        outside=[
            *outside,
            *(mixed() < 1e-12 for _ in range(4)),
            *(bool(without_last() < 1e-12) for _ in range(4)),
            *(bool(with_gap() < 1e-12) for _ in range(4)),
        ],
        only_if="the rows are one environment's, in order and without gaps, each has a next row, "
        "and no episode is cut off, by a time limit or otherwise, and reset within the same step",
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

    def flat(ratio, advantage, size=0.2):
        """Return whether a small change of the ratio changes nothing, and the slope says so."""
        pair = np.array([ratio, ratio + 1e-6])
        value, slope = clipped_objective(pair, np.full(2, advantage), size)
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
        # Chosen to break it: ratios far away and right outside, narrow and wide clips.
        inside=[
            *inside,
            *(
                flat(x, y, width)
                for width in (0.01, 0.2, 0.5)
                for x, y in ((1e3, 1e-3), (1.0 + 1.001 * width, 5.0), (1e-3, -1e-3))
            ),
        ],
        outside=[*outside, flat(1e3, -1e-3), flat(1e-3, 1e-3)],
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
    "In its matrix products, the backward pass for all weights takes at most twice as many "
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
