"""Claims of chapter 9 about several ways of doing a task: heads, samplers, chunks."""

import functools
from dataclasses import replace
from itertools import pairwise
from statistics import NormalDist

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "p": Symbol("share that passes left, at +w", 0.05, 0.45),
    "w": Symbol("distance from the middle at which they pass [m]"),
    "s": Symbol("standard deviation of the disturbance in a step [m]"),
    "k": Symbol("steps executed without an observation", 1.5, 50.0),
    "K": Symbol("number of chunks that are averaged", 1.5, 50.0),
    "h": Symbol("step size of the sampler", 0.05, 0.9),
    "z": Symbol("noise at the start"),
    "m": Symbol("mean of the data"),
}


@functools.cache
def policy(name):
    """Return a policy on record.

    "nearest" and "zero" are the nearest step shown, and ACT's code of 0.
    """
    from course.learning import TwoWays, nearest, recorded, windows

    if name == "nearest":
        return nearest(*windows(TwoWays().demonstrate(100, 0), 8))
    return replace(policy("autoencoder"), zero=True) if name == "zero" else recorded(name)


@functools.cache
def aside(name, **how):
    """Return where 2,000 first chunks lead, half way: how far aside [m]."""
    from course.learning import TwoWays

    # The same starts and the same noise for every policy: differences are the policies' own.
    rng = np.random.default_rng(5)
    start = TwoWays().starts(2000, rng)
    return (start + replace(policy(name), **how)(start, rng).sum(axis=1))[:, 1]


def between(name, **how):
    """Return the share of them that lead into the obstacle."""
    # 0.2 m aside or less half way leads into the obstacle.
    return np.mean(np.abs(aside(name, **how)) < 0.2)


def passed(act, noise=0.0, seed=3, n=400):
    """Return the share of n runs that pass the obstacle and arrive."""
    from course.learning import TwoWays, roll

    task, rng = TwoWays(noise=noise), np.random.default_rng(seed)
    ran = roll(task, act, task.starts(n, rng), 16, rng)
    return np.mean(task.sides(ran.states) != 0)


def two_modes():
    """Return half at -1 and half at 1, each with a deviation of a tenth."""
    from course.learning import Mixture

    return Mixture(np.array([0.5, 0.5]), np.array([[-1.0], [1.0]]), np.array([0.1, 0.1]))


@claim(
    "Behaviour cloning averages the different ways of doing a task.",
    "The squared error does this, not cloning as such. It is smallest at the mean of the "
    "demonstrations, {formula}, which nobody showed. A policy trained with it leads into the "
    "obstacle with {mean:.2%} of its first chunks. A mixture, trained on the same demonstrations "
    "with the likelihood, does so with {mixture:.2%}, and the nearest demonstration with "
    "{nearest:.2%}.",
    ask=(
        "A share p of the demonstrations passes at +w, the others pass at -w. Which single "
        "prediction has the smallest mean squared error?",
        "(2*p - 1)*w",
        {
            "0*w": "This is right only if both sides are equally frequent.",
            "p*w": "The others count as -w, not as 0.",
            "w": "For p above 1/2 this minimises the absolute error, not the squared error.",
        },
    ),
)
def cloning_averages(result):
    import sympy

    from course.learning import TwoWays

    p, w, x = sympy.symbols("p w x", positive=True)
    # Minimise the expected squared error over a single prediction.
    error = p * (x - w) ** 2 + (1 - p) * (x + w) ** 2
    result.formula = sympy.factor(sympy.solve(sympy.diff(error, x), x)[0])
    mean, *others = (result.measure(n, between(n), 0.1) for n in ("mean", "mixture", "nearest"))
    result.statement = "2,000 first chunks of 8 steps, from policies trained on 100 demonstrations."
    averages = [mean > 0.5, *(share > 0.5 for share in others)]
    # Chosen to break it: states that show which side was begun, and samples of the fitted normal
    # distribution instead of its mean.
    states = TwoWays().demonstrate(400, 7).states
    begun = states[:, 6] + policy("mean")(states[:, 6], result.rng)[:, :2].sum(axis=1)
    middle, spread = states[:, 8, 1].mean(), states[:, 8, 1].std()
    drawn = middle + spread * result.rng.standard_normal(2000)
    result.statement_holds(
        all(averages),
        only_if="the state does not show which way was begun, and the policy returns the mean: its "
        "loss is smallest there, like the squared error, or it returns the mean of a single normal "
        "distribution that was fitted with the likelihood",
        inside=[*averages[:1], bool(abs(middle) < 0.2)],
        outside=[
            *averages[1:],
            *(bool(np.mean(np.abs(y) < 0.2) > 0.5) for y in (begun[:, 1], drawn)),
        ],
        cases=True,
    )
    shown = policy("nearest")(np.zeros((1, 2)), result.rng)
    result.correction_holds(mean > 0.95, max(others) < 0.01, shown.shape == (1, 8, 2))


@claim(
    "Of two clones, choose the one with the smaller error on held-out demonstrations.",
    "The mean has the smallest squared error possible, and a policy that samples as the "
    "demonstrators do has twice that. Held out, the mean has an error of {low:.4f} m and passes "
    "in {mean:.1%} of its runs. The mixture has {high:.4f} m, squared {ratio:.2f} times as "
    "much, and passes in {mixture:.1%}.",
    ask=(
        "A share p of the demonstrations passes at w, the others pass at -w. A policy samples a "
        "side with the same probabilities. What is the mean squared distance between its sample "
        "and a held-out demonstration?",
        "8*p*(1 - p)*w^2",
        {
            "4*p*(1 - p)*w^2": "This is the error of the mean, which is the variance.",
            "2*p*(1 - p)*w^2": (
                "They disagree with probability 2 p (1 - p), and then they are 2 w apart."
            ),
            "4*p^2*w^2 + 4*(1 - p)^2*w^2": "This counts the cases in which both agree.",
        },
    ),
)
def held_out_error(result):
    import sympy

    from course.learning import Commit, TwoWays

    p, w = sympy.symbols("p w", positive=True)
    sides = ((p, w), (1 - p, -w))
    # Two independent draws of the same two sides: sampled chunk and demonstration.
    result.formula = sum(a * b * (x - y) ** 2 for a, x in sides for b, y in sides)
    # Demonstrations of another seed than those of the training.
    held = TwoWays().demonstrate(1000, 77)

    def error(name):
        deviation = policy(name)(held.states[:, 0], np.random.default_rng(1)) - held.actions[:, :8]
        return np.sqrt(np.mean(deviation**2))

    low, high = (
        result.measure("low", error("mean"), 0.05),
        result.measure("high", error("mixture"), 0.05),
    )
    mean, mixture = (
        result.measure(n, passed(Commit(policy(n), 8), n=4000), 0.5 if n == "mean" else 0.02)
        for n in ("mean", "mixture")
    )
    ratio = result.measure("ratio", (high / low) ** 2, 0.1)
    result.statement = (
        "1,000 held-out demonstrations at their start, where the two sides separate; 4,000 runs of "
        "each policy."
    )
    result.statement_holds((low < high) == (mean > mixture))
    result.correction_holds(low < high, mean < 0.1, mixture > 0.8, abs(ratio - 2.0) < 0.2)


@claim(
    "A diffusion policy samples one mode or the other, never a point between them.",
    "The sampler is a continuous map from normal noise to actions. Noise between two starting "
    "points that lead left and right has to end somewhere between, so the share between the modes "
    "is not zero. How large it is depends on the network and on the number of steps. Of first "
    "chunks {ten:.1%} lead into the obstacle with ten sampler steps, {fifty:.1%} with {most:.0f}; "
    "an exact denoiser leaves far fewer (next claims), so most of them are this network's error. "
    "Of a mixture, "
    "which selects one component, {mixture:.2%}. The shares of the sides are right: {left:.0%} "
    "pass left, and {shown:.0%} did in the data.",
)
def diffusion_between(result):
    from course.learning import TwoWays

    largest = int(result.input("most", 50))
    ten, fifty = (
        result.measure(name, between("diffusion", steps=n), 0.2)
        for name, n in (("ten", 10), ("fifty", largest))
    )
    mixture = result.measure("mixture", between("mixture"))
    # The control: the shares of the sides are right, so the samples in between are no training
    # failure.
    remaining = result.measure("left", np.mean(aside("diffusion", steps=largest) > 0.0), 0.05)
    shown = result.measure("shown", np.mean(TwoWays().demonstrate(100, 0).states[:, 8, 1] > 0.0))
    result.statement = "2,000 first chunks with DDIM from the stored network, 64 units per layer."
    result.statement_holds(fifty == 0.0)
    result.correction_holds(ten > fifty, fifty > mixture, abs(remaining - shown) < 0.1)


@claim(
    "With one Euler step, a flow policy returns the mean of the demonstrations.",
    "If noise and data are paired at random, the sample at time 0 tells nothing about the data, so "
    "the exact velocity points to the mean of the data for the same observation. If each path is "
    "straight and run at constant speed, a step of size h ends at {formula}, a full step at m. A "
    "trained network smooths the field near time 0: with one step {net:.0%} of its first chunks "
    "lead into the obstacle, of the mean's {mean:.0%}. Two steps are too few: even with the exact "
    "field {between:.0%} of the samples of two narrow modes end between them. A few more separate "
    "the modes but get their width wrong: with ten steps a mode of width {exact:.3f} comes out "
    "{ten:.3f} wide.",
    ask=(
        "A sample starts as noise z at time 0. Noise and data are paired at random, the data have "
        "mean m, and the velocity field of flow matching is exact. Where does one Euler step of "
        "size h end?",
        "(1 - h)*z + h*m",
        {
            "z + h*m": "The velocity is the mean of data minus noise, so z is subtracted too.",
            "h*z + (1 - h)*m": "For h = 0 the sample has to stay at z.",
            "m": "This is a full step, h = 1.",
        },
    ),
)
def one_euler_step(result):
    import sympy

    from course.learning import Mixture, integrate

    z, m, h = sympy.symbols("z m h")
    result.formula = z + h * (m - z)

    def deviation(parts, size):
        """Return how far from their mean single steps end, for a drawn mixture."""
        rng = result.rng
        # Random mixtures with the exact velocity field, so that no network's error interferes.
        made = Mixture(
            rng.dirichlet(np.ones(parts)),
            rng.normal(0, 2, (parts, size)),
            rng.uniform(0.1, 1.0, parts),
        )
        noise = rng.standard_normal((50, size))
        return np.abs(integrate(made.velocity, noise, 1, "euler") - made.weights @ made.means).max()

    # Quantiles of the noise, not a random sample: the exact flow then ends at a width of 0.1.
    start = np.array([NormalDist().inv_cdf(x) for x in (np.arange(20_000) + 0.5) / 20_000])[:, None]

    def spread(steps, solver):
        end = integrate(two_modes().velocity, start, steps, solver)
        return end[end > 0.0].std()

    ten = result.measure("ten", spread(10, "euler"), 1e-3)
    exact = result.measure("exact", spread(160, "rk4"), 1e-3)
    # Up to four components in up to four dimensions.
    worst = max(deviation(*result.rng.integers(1, 5, 2)) for _ in range(20))
    half = integrate(two_modes().velocity, start, 2, "euler")  # its first step is 1/2 of a step
    # Between them: nearer to the middle than to either mode.
    remaining = result.measure("between", np.mean(np.abs(half) < 0.5), 0.02)
    first = 0.5 * start + 0.5 * two_modes().velocity(0.5 * start, 0.5)
    result.statement = (
        "20 random mixtures with exact fields, two modes of width 0.1, and the stored flow network."
    )
    # Paired in order, as optimal transport pairs them in one dimension: each noise has its own end.
    data = np.where(result.rng.random(20_000) < 0.5, -1.0, 1.0)
    data = np.sort(data + 0.1 * result.rng.standard_normal(20_000))
    noise = np.sort(start[:, 0])
    paired = noise + 1.0 * (data - noise)
    net = result.measure("net", between("flow", steps=1), 0.15)
    mean = result.measure("mean", between("mean"), 0.15)
    # Chosen to break it: many modes in many dimensions, and paths that are quarter circles.
    many = max(deviation(8, 20) for _ in range(4))
    t = sympy.Symbol("t")
    curved = z + sympy.diff(m * sympy.sin(sympy.pi * t / 2) + z * sympy.cos(sympy.pi * t / 2), t)
    # Chosen to break it: straight paths at a speed that changes, and one that ends beside the data.
    straight = [
        z + part * (m - z) for part in (t**2, 3 * t**2 - 2 * t**3, sympy.sin(sympy.pi * t / 2))
    ]
    straight.append((1 - 0.9 * t) * z + t * m)
    result.statement_holds(
        net > 0.9,
        only_if="the velocity field is exact, noise and data were paired at random, and each path "
        "runs straight and at constant speed from the noise to the data",
        cases=True,
        inside=[worst < 1e-9, many < 1e-9],
        outside=[
            net > 0.9,
            bool(np.abs(paired - data.mean()).max() < 1e-9),
            bool(sympy.simplify(curved.subs(t, 0) - m) == 0),
            *(bool(sympy.simplify(z + x.diff(t).subs(t, 0) - m) == 0) for x in straight),
        ],
    )
    result.correction_holds(
        np.allclose(half, first),
        remaining > 0.3,
        abs(exact - 0.1) < 2e-4,
        ten < 0.9 * exact,
        net < 0.9 * mean,
    )


@claim(
    "Twice as many sampler steps halve the error.",
    "Euler and DDIM are of first order: twice the steps divide their error by {euler:.2f} and "
    "{ddim:.2f}, once a step is short compared with the width of the modes. Before that Euler "
    "gains a factor of {few:.1f}, from two to four steps on narrow modes. Heun's method takes "
    "two evaluations per step and gains {heun:.2f}; the fourth-order Runge-Kutta method gains "
    "{rk4:.1f}.",
)
def sampler_orders(result):
    from course.learning import Mixture, denoise, integrate

    noise = np.linspace(-2.0, 2.0, 41)[:, None]

    def gain(solver, weights, means, deviations, n=80):
        """Return the error of n steps over that of twice as many, on the exact field."""
        made, ends = Mixture(weights, means, deviations), []
        for steps in (n, 2 * n):
            if solver == "ddim":
                ends.append(denoise(made.clean, noise, steps, result.rng))
            else:
                ends.append(integrate(made.velocity, noise, steps, solver))
        # The reference has four times the steps of a fourth-order method.
        exact = integrate(made.velocity, noise, max(4 * n, 100), "rk4")
        return np.divide(*(np.sqrt(np.mean((end - exact) ** 2)) for end in ends))

    first = (np.array([0.3, 0.7]), np.array([[-1.0], [1.0]]), np.array([0.4, 0.5]))
    euler, ddim, heun, rk4 = (
        result.measure(x, gain(x, *first, 20 if x == "rk4" else 80), 0.02)
        for x in ("euler", "ddim", "heun", "rk4")
    )
    rng = result.rng
    drawn = [
        (rng.dirichlet([3, 3]), rng.normal(0.0, 1.5, (2, 1)), rng.uniform(0.3, 1.0, 2))
        for _ in range(8)
    ]
    # Modes of width 0.1 with two steps: the asymptotic order does not hold yet.
    narrow = (np.full(2, 0.5), first[1], np.full(2, 0.1))
    few = result.measure("few", gain("euler", *narrow, 2), 0.02)
    inside, outside = (
        [abs(gain(x, *made) - 2.0) < 0.1 for made in drawn] for x in ("euler", "heun")
    )
    outside.append(abs(few - 2.0) < 0.1)
    # Chosen to break it: modes far narrower than the others, with long and with short steps.
    thin = (np.full(2, 0.5), first[1], np.full(2, 0.02))
    inside += [bool(abs(gain(x, *thin, 640) - 2.0) < 0.1) for x in ("euler", "ddim")]
    outside.append(bool(abs(gain("ddim", *thin) - 2.0) < 0.1))
    result.statement = "Mixtures of two normal distributions with exact fields, 80 and 160 steps."
    result.statement_holds(
        all(outside),
        only_if="the sampler is of first order and its steps are short compared with the width of "
        "the modes",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        abs(euler - 2.0) < 0.1,
        abs(ddim - 2.0) < 0.1,
        # Powers of two of the order; the tolerances grow with it as fewer steps are taken.
        abs(heun - 4.0) < 0.4,
        abs(rk4 - 16.0) < 3.0,
        few > 3.0,
    )


@claim(
    "A diffusion policy needs at least ten denoising steps.",
    "That depends on the sampler and on how many samples may fall between the modes. For two "
    "narrow modes and the exact denoiser, DDIM with steps of equal time leaves {five:.1%} of the "
    "samples there with five steps, {nine:.1%} with nine and {ten:.1%} with ten. A solver of "
    "second order, DPM-Solver++, with nine steps of equal ratio of the noise levels leaves "
    "{second:.2%}.",
    source="C. Lu et al., DPM-Solver++, 2022",
)
def ten_denoising_steps(result):
    from course.learning import Mixture, denoise

    noise = np.random.default_rng(1).standard_normal((20_000, 1))

    def remaining(steps):
        return np.mean(np.abs(denoise(two_modes().clean, noise, steps, result.rng)) < 0.5)

    five, ten = (
        result.measure("five", remaining(5), 0.05),
        result.measure("ten", remaining(10), 0.1),
    )
    nine = result.measure("nine", remaining(9), 0.1)
    result.statement = (
        "20,000 samples of two modes at -1 and 1 of width 0.1; between them means within 0.5 of 0."
    )
    # Ten steps are needed exactly if no smaller number keeps to the tolerated share.
    fewer = [remaining(steps) for steps in range(1, 10)]
    inside, outside = (
        [bool(min(fewer) > share) for share in result.rng.uniform(*some, 8)]
        for some in ((ten, 0.99 * nine), (1.01 * nine, five))
    )
    # Chosen to break it: a mode that is rare, and modes that are farther apart.
    other = [
        Mixture(np.array([x, 1.0 - x]), np.array([[-y], [y]]), np.array([0.1 * y, 0.1 * y]))
        for x, y in ((0.95, 1.0), (0.5, 2.0))
    ]
    least = [
        min(
            np.mean(np.abs(denoise(made.clean, noise, steps, result.rng)) < 0.5 * y)
            for steps in range(1, 10)
        )
        for made, y in zip(other, (1.0, 2.0), strict=True)
    ]

    def second_order(steps):
        """Return what DPM-Solver++(2M) leaves (algorithm 2), on ratios s / a of equal ratio."""
        levels = np.append(np.geomspace(20.0, 0.02, steps), 0.0)
        x, old, before = levels[0] * noise, 0.0, np.inf
        for level, after in pairwise(levels):
            # The course's time and scale of a sample with this ratio of noise and signal.
            time = 2.0 / np.pi * np.arctan(1.0 / level)
            clean = two_modes().clean(x / np.hypot(1.0, level), time)
            # Extrapolated from the last two predictions; the first and the last step are DDIM's.
            ahead = 0.0
            if after > 0.0 and np.isfinite(before):
                ahead = 0.5 * np.log(level / after) / np.log(before / level)
            best = (1.0 + ahead) * clean - ahead * old
            x, old, before = best + after / level * (x - best), clean, level
        return np.mean(np.abs(x) < 0.5)

    # Chosen to break it: a sampler of second order.
    second = result.measure("second", second_order(9), 0.2)
    result.statement_holds(
        nine > five,
        only_if="the sampler is DDIM with steps of equal time on a cosine schedule, and less than "
        "{nine:.1%} of the samples may fall between two equally frequent modes at plus and "
        "minus one, each with a deviation of a tenth",
        inside=inside,
        outside=[*outside, *(bool(x > 0.99 * nine) for x in least), bool(second > ten)],
    )
    one_mode = Mixture(np.array([1.0]), np.array([[1.0]]), np.array([0.1]))
    single = denoise(one_mode.clean, noise, 1, result.rng)
    result.correction_holds(
        five > 5.0 * ten, ten < 0.005, np.abs(single - 1.0).max() < 0.5, second < 0.8 * ten
    )


@claim(
    "Temporal ensembling destroys modes, because it averages chunks that take different sides.",
    "If K chunks each choose a side independently, their mean deviates by {formula} (root mean "
    "square). If the state shows which side was begun, the chunks agree: the stored mixture "
    "passes in {mixture:.1%} of the runs with ensembling, and in {alone:.1%} without. A policy "
    "that tosses a coin for the side at every step passes in {coin:.1%} with equal weights, but in "
    "{whole:.1%} if it executes whole chunks.",
    ask=(
        "K chunks propose +w or -w, each decided by its own coin toss. What is the root mean "
        "square of their mean?",
        "w/sqrt(K)",
        {
            "w": "This is the root mean square of a single chunk.",
            "w/K": "Variances add, standard deviations do not.",
            "w*sqrt(K)": "This is the root mean square of the sum, not of the mean.",
        },
    ),
)
def ensembling_averages(result):
    import sympy

    from course.learning import Commit, Ensemble

    w, K = sympy.symbols("w K", positive=True)
    result.formula = sympy.sqrt(K * w**2) / K
    part = np.linspace(0.0, 1.0, 17)

    def coin(states, rng, odds=None, length=16):
        """Return the right chunk for a side that is drawn anew at each call."""
        phase = np.clip(np.rint(16 * states[:, :1]), 0, 15).astype(int)
        later = part[np.minimum(phase + np.arange(17), 16)]
        side = rng.choice([-0.35, 0.35], (len(states), 1), p=odds) * np.sin(np.pi * later)
        return np.diff(np.stack((later, side), axis=2), axis=1)[:, :length]

    acts = {
        "mixture": Ensemble(policy("mixture")),
        "alone": Commit(policy("mixture"), 1),
        "coin": Ensemble(coin, 0.0),
        "whole": Commit(coin, 16),
    }
    mixture, _, tossed, whole = (result.measure(n, passed(a), 0.2) for n, a in acts.items())
    result.statement = "400 runs each of the two-route task without disturbances."
    selected = [passed(Ensemble(policy(n))) > 0.7 for n in ("flow", "diffusion", "mixture")]
    # Weights that fall quickly with the chunk's number leave nearly only the oldest chunk.
    oldest = passed(Ensemble(coin, 3.0))
    # Chosen to break it: few chunks in a mean, and a coin that nearly always falls on one side.
    short = [passed(Ensemble(functools.partial(coin, length=n), 0.0)) for n in (1, 2, 4)]
    biased = passed(Ensemble(functools.partial(coin, odds=[0.1, 0.9]), 0.0))
    # Chosen to break it: chunks that take no notice of the state, but share one toss of a run.
    shared = passed(Ensemble(lambda states, rng: coin(states, np.random.default_rng(0)), 0.0))
    result.statement_holds(
        mixture < 0.2,
        only_if="each new chunk chooses its side independently of the others and of the side that "
        "was begun, both about equally often, and all have similar weights",
        inside=[tossed < 0.2, passed(Ensemble(coin)) < 0.2, *(bool(x < 0.2) for x in short)],
        outside=[*(not x for x in selected), oldest < 0.2, bool(biased < 0.2), bool(shared < 0.2)],
        cases=True,
    )
    # The formula by sampling: means of eight coin tosses.
    mean = np.mean(result.rng.choice([-1.0, 1.0], (20_000, 8)), axis=1)
    result.correction_holds(all(selected), whole > 0.95, abs(mean.std() * np.sqrt(8) - 1) < 0.03)


@claim(
    "On the two-route task with random disturbances of 5 cm a step, a policy that executes eight "
    "steps before it "
    "observes again succeeds less often than one that executes two.",
    "Over k steps without an observation, disturbances of standard deviation s add up to "
    "{formula}. With disturbances of {size} m the stored mixture passes in {two:.1%} of the "
    "runs if it observes every second step, and in {eight:.1%} at every eighth; undisturbed in "
    "{quiet_two:.1%} and {quiet_eight:.1%}. Observing at every step is slightly worse than at "
    "every second one, {each:.1%}; that some runs change sides may be a part of the reason. With "
    "disturbances of "
    "only {little} m the nearest demonstration does better with eight steps, {near_eight:.1%} "
    "against {near_two:.1%}.",
    ask=(
        "Each step adds an independent disturbance of standard deviation s. How far off is the "
        "state after k steps without a correction (root mean square)?",
        "s*sqrt(k)",
        {
            "s*k": "Independent disturbances partly cancel: variances add.",
            "s": "This is the deviation after a single step.",
            "s/sqrt(k)": "This is the root mean square of their mean, not of their sum.",
        },
    ),
)
def react_less(result):
    import sympy

    from course.learning import Commit, TwoWays, roll

    s, k = sympy.symbols("s k", positive=True)
    result.formula = sympy.sqrt(k * s**2)
    size = result.input("size", 0.05)
    steps, runs = {"two": 2, "eight": 8}, 8000
    two, eight = (
        result.measure(n, passed(Commit(policy("mixture"), k), size, n=runs), 0.1)
        for n, k in steps.items()
    )
    for name, each in steps.items():
        result.measure(f"quiet_{name}", passed(Commit(policy("mixture"), each), n=runs), 0.02)
    always = result.measure("each", passed(Commit(policy("mixture"), 1), size, n=runs), 0.1)
    little = result.input("little", 0.01)
    near = [passed(Commit(policy("nearest"), k), little, n=2000) for k in (8, 2)]
    near_eight = result.measure("near_eight", near[0], 0.01)
    near_two = result.measure("near_two", near[1], 0.01)
    heads = ("mixture", "flow", "diffusion", "nearest")
    # Four kinds of policy and two seeds, so that it is no property of the mixture.
    less = [
        np.mean([passed(Commit(policy(n), 8), size, x) for x in (3, 4)])
        < np.mean([passed(Commit(policy(n), 2), size, x) for x in (3, 4)])
        for n in heads
    ]
    task, rng = TwoWays(noise=size), np.random.default_rng(2)
    # A policy that does nothing isolates the sum of the disturbances.
    still = roll(task, lambda states, rng: 0.0 * states, np.zeros((4000, 2)), 8, rng).states
    deviation = still[:, 8, 0].std() / float(result.formula.subs({s: size, k: 8}))
    result.statement = (
        "8,000 runs each of the mixture and 2,000 each of the nearest demonstration; then 800 runs "
        "for each of four policies."
    )
    result.statement_holds(all(less))
    result.correction_holds(
        abs(deviation - 1.0) < 0.05, eight < two - 0.04, always < two, near_eight > near_two
    )


@claim(
    "Cloned from people who pause, a policy without memory gets stuck where they paused.",
    "During a pause the same state has two labels, wait and go. With pauses of {pause:.0f} "
    "steps, the nearest demonstration gets stuck in {stuck:.0%} of the runs if it executes "
    "{pause:.0f} steps of a chunk, and in {through:.0%} if it executes one step more. A policy "
    "that samples from all actions shown at that state leaves sooner or later ({drawn:.0%} "
    "stuck), and so does one that takes their mean. Small disturbances free the robot as well.",
)
def pauses(result):
    from course.learning import Commit, TwoWays, nearest, roll, windows

    def drawing(states, chunks):
        """Return one of the chunks shown at the nearest state, each as likely."""

        def act(observed, rng):
            far = np.hypot(*(observed[:, None] - states).transpose(2, 0, 1))
            # All chunks shown at the nearest state, up to rounding, are equally likely.
            ties = far < far.min(axis=1, keepdims=True) + 1e-9
            return chunks[np.argmax(ties * rng.random(far.shape), axis=1)]

        return act

    def averaging(states, chunks):
        """Return the mean of the chunks shown at the nearest state."""

        def act(observed, rng):
            far = np.hypot(*(observed[:, None] - states).transpose(2, 0, 1))
            ties = far < far.min(axis=1, keepdims=True) + 1e-9
            return np.einsum("ij,jkl->ikl", ties / ties.sum(axis=1, keepdims=True), chunks)

        return act

    def stuck(pause, executed, seed, answer=nearest, noise=0.0):
        shown = TwoWays().demonstrate(30, seed, pause=pause)
        act = Commit(answer(*windows(shown, 8)), executed)
        ran = roll(TwoWays(noise=noise), act, shown.states[:, 0], 60, np.random.default_rng(0))
        return np.mean(ran.states[:, :, 0].max(axis=1) < 0.9)

    pause = int(result.input("pause", 4))
    within = result.measure("stuck", stuck(pause, pause, 0))
    over = result.measure("through", stuck(pause, pause + 1, 0))
    drawn = result.measure("drawn", stuck(pause, 1, 0, drawing))
    pairs = [(result.rng.integers(1, 8), result.rng.random()) for _ in range(8)]
    result.statement = "30 demonstrations, chunks of 8 steps, a time limit of 60 steps."
    # Random pauses, executing at most as many steps as the pause has; outside, at least one more.
    inside = [stuck(n, 1 + int(part * n), j) == 1.0 for j, (n, part) in enumerate(pairs)]
    outside = [stuck(n, n + 1 + int(part * (8 - n)), j) == 1.0 for j, (n, part) in enumerate(pairs)]
    outside.append(drawn == 1.0)
    mean = stuck(pause, 1, 0, averaging)
    shaken = stuck(pause, 1, 0, noise=0.02)
    # Chosen to break it: of the chunks recorded at a state always the one recorded last.
    final = stuck(pause, 1, 0, lambda states, chunks: nearest(states[::-1], chunks[::-1]))
    outside += [mean == 1.0, shaken == 1.0, bool(final == 1.0)]

    def halts(first, speed, executed):
        """Return whether a point on a line stops where the last of its demonstrations pauses.

        Args:
            first: the pauses of the demonstrations, in the order of their recording [steps].
            speed: whether the state holds the measured speed besides the position.
            executed: steps of a chunk that are executed.
        """
        recorded = dict[tuple[int, int], list[int]]()
        for wait in first:
            actions = [1] * 3 + [0] * wait + [1] * 4
            for k in range(len(actions)):
                state = sum(actions[:k]), int(speed and k and actions[k - 1])
                recorded.setdefault(state, (actions[k:] + [0] * executed)[:executed])
        place, rate = 0, 0
        for _ in range(40):
            for action in recorded.get((place, rate if speed else 0), [0]):
                place, rate = place + action, action
            if place >= 7:
                return False
        return True

    # Chosen to break it: the state shows the speed, so a pause has a second state of its own; and
    # the demonstration that was recorded first does not pause.
    inside += [halts([5], False, n) for n in (1, 3, 5)]
    outside += [halts([5], True, 5), *(halts([0, 5], False, n) for n in (1, 3, 5))]
    only_if = (
        "the state shows the position without the speed, it always returns the chunk that was "
        "recorded first at a state, by a demonstration that paused there, it begins where a "
        "demonstration began, executes no more steps than a pause has, and nothing disturbs it"
    )
    result.statement_holds(over == 1.0, only_if=only_if, inside=inside, outside=outside)
    result.correction_holds(
        within == 1.0, over == 0.0, drawn < 0.1, not any(outside), mean == 0.0, shaken < 0.2
    )


@claim(
    "Fifty demonstrations are enough to contain the rarer way.",
    "A way that each demonstration uses with probability p, independently, is missing from n of "
    "them with probability (1 - p)^n: {rare:.0%} for n of {n:.0f} and p of {share:.0%}. Operators "
    "who each always go the same way count once. If a share p uses one of two ways and the others "
    "use the second, five demonstrations miss one of them with probability {formula}.",
    ask=(
        "A share p of people passes left, the others pass right. With what probability do five "
        "demonstrations by different people show only one side?",
        "p^5 + (1 - p)^5",
        {
            "(1 - p)^5": "The other side may be missing as well.",
            "2*p^5": "This is right for p = 1/2.",
            "5*p*(1 - p)^4": "This is the probability of exactly one demonstration on the left.",
        },
    ),
)
def ways_missed(result):
    import sympy

    from course.learning import TwoWays

    p = sympy.Symbol("p", positive=True)
    result.formula = p**5 + (1 - p) ** 5

    def missed(share, number, sets, seed):
        """Return share of sets of demonstrations in which nobody went left, and one side only."""
        ends = TwoWays().demonstrate(number * sets, seed, left=share).states[:, 8, 1]
        remaining = (ends.reshape(sets, number) > 0.0).sum(axis=1)
        return np.mean(remaining == 0), np.mean((remaining == 0) | (remaining == number))

    n, share = int(result.input("n", 50)), result.input("share", 0.02)
    rare = result.measure("rare", missed(share, n, 1000, 0)[0], 0.1)
    result.statement = "1,000 sets of demonstrations, then 300 for each of several random shares."
    # The share at which a way is missing from n demonstrations with probability 1 / 100.
    limit = 1.0 - 0.01 ** (1.0 / n)
    inside, outside = (
        [bool(missed(x, n, 300, j)[0] < 0.03) for j, x in enumerate(result.rng.uniform(*some, 8))]
        for some in ((limit, 0.5), (0.1 * limit, 0.5 * limit))
    )

    def by_operators(share, operators=5):
        """Return whether it is rarely missed where each of five operators always goes one way."""
        # Five independent choices, however many demonstrations each operator gives.
        return bool(np.mean(~(result.rng.random((300, operators)) < share).any(axis=1)) < 0.03)

    operators = [by_operators(x) for x in result.rng.uniform(limit, 0.3, 4)]

    def mixed(number):
        """Return whether it is rarely missed where each demonstration has its own probability."""
        least = 1.0 - 0.01 ** (1.0 / number)
        each = result.rng.uniform(least, min(1.0, 1.5 * least), number)
        return bool(np.mean(~(result.rng.random((2000, number)) < each).any(axis=1)) < 0.03)

    result.statement_holds(
        rare < 0.03,
        only_if="each demonstration uses it independently with probability above 1 - (1/100)^(1/n)",
        # Chosen to break it: few and many demonstrations, with unequal probabilities.
        inside=inside + [mixed(number) for number in (1, 2, 7, 300)],
        outside=outside + operators,
    )
    five = missed(0.3, 5, 4000, 1)[1]
    result.correction_holds(
        abs(rare - (1.0 - share) ** n) < 0.05, abs(five - float(result.formula.subs(p, 0.3))) < 0.03
    )


@claim(
    "Run with its code at zero, as ACT is, a conditional variational autoencoder does not "
    "choose among several ways.",
    "With the code fixed, a state has exactly one chunk. In our small autoencoder {zero:.0%} of "
    "these first chunks lead into the obstacle. With a sampled code {drawn:.0%} do, and of a "
    "mixture {mixture:.2%}.",
    source="T. Zhao et al., Learning fine-grained bimanual manipulation, 2023",
)
def code_of_zero(result):
    zero, drawn, _ = (
        result.measure(n, between(name), 0.15)
        for n, name in (("zero", "zero"), ("drawn", "autoencoder"), ("mixture", "mixture"))
    )
    # A hundred copies of one state: any spread of the chunks is the code's.
    same = policy("zero")(np.zeros((100, 2)), np.random.default_rng(0))
    free = policy("autoencoder")(np.zeros((100, 2)), np.random.default_rng(0))
    result.statement = "The stored autoencoder, with a code of one number."
    result.statement_holds(same.std(axis=0).max() < 1e-9)
    result.correction_holds(
        same.std(axis=0).max() < 1e-9, free.std(axis=0).max() > 1e-3, zero > drawn
    )
