"""Claims of chapter 11: runs that fail, a reward by the step, and what shapes cost."""

import functools
from dataclasses import replace
from itertools import combinations, permutations
from typing import Any

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "h": Symbol("step [s]", 0.01, 0.5),
    "H": Symbol("time constant of the discount [s]", 0.5, 5.0),
}


@claim(
    "90 of 100 runs worked, then 95 of 100: this shows that the change helped.",
    "The change may have helped, or this was chance. {worked:.0f} of {n:.0f} fits any rate between "
    "{low:.0%} and {high:.0%}. To detect this "
    "difference four times in five takes {own:.0f} runs of each. On the same seeds it takes "
    "{same:.0f}, if every run that worked before still works.",
    source="E. B. Wilson, 1927; Fleiss, Levin and Paik, Statistical methods for rates, 2003",
)
def ninety_or_ninety_five(result):
    from course.measure.success import trials, wilson

    n, answer = int(result.input("n", 100)), int(result.input("worked", 90))
    low, high = (float(end) for end in wilson(answer, n))
    result.measure("low", low)
    result.measure("high", high)
    own = int(result.measure("own", trials(0.9, 0.95), 0.0))
    same = int(result.measure("same", trials(0.9, 0.95, together=0.9), 0.0))

    def observed(first, second, n):
        middle = 0.5 * (first + second)
        return np.abs(second - first) / np.sqrt(2.0 * middle * (1.0 - middle) / n) > 1.96

    first, second = (result.rng.binomial(own, rate, 20_000) / own for rate in (0.9, 0.95))
    power = observed(first, second, own)
    # On the same seeds only those count that one wins and the other loses: here none is lost.
    paired = 2.0 * 0.5 ** result.rng.binomial(same, 0.05, 20_000) < 0.05
    result.statement = "Wilson's interval, and 20,000 experiments of each kind, tested at 5 %."
    result.statement_holds(bool(observed(answer / n, 0.95, n)))
    result.correction_holds(
        low < 0.85,
        high < 0.95,
        bool(abs(power.mean() - 0.8) < 0.02),
        bool(abs(paired.mean() - 0.8) < 0.05),
        own > 2.5 * same,
    )


@claim(
    "Every failed run succeeds once the right single stage is ideal.",
    "Often it does. But behind a moving target, a late camera and a lagging arm point the same"
    " way: of {n:.0f} such runs {pairs:.0f} needed two ideal stages. Finding them took {runs:.0f} "
    "replays.",
)
def one_repair_cures(result):
    from course.pipeline import STAGES, Scenario
    from course.pipeline.blame import CASE, FAULTS, Fault, confusion

    late = Fault("late", "age", disturb=lambda f, s: replace(f, arrived=f.arrived + 500_000))
    case = Scenario(velocity=(-0.04, 0.03)), replace(CASE[1], kd=12.0)
    n = result.input("n", 5)
    text, taken, _ = confusion(n, (late,), case)
    pairs = result.measure("pairs", text[0, len(STAGES)], 0.3)
    result.measure("runs", np.mean(taken[0]), 0.3)
    single, *_ = confusion(2, (FAULTS[0],))
    result.statement = (
        "Frames half a second late, Kd = 12, a target at 50 mm/s; replays of each run."
    )
    result.statement_holds(text[0, : len(STAGES)].sum() == n)
    result.correction_holds(pairs >= 3, single[0, 0] == 2)


@claim(
    "The stage with the largest error at the end of a run is the one at fault.",
    "This rule can answer only perception or the arm, so it can be right for at most "
    "{possible:.0%} of ten kinds of faults. In one run of each kind it named {last:.0%} correctly. "
    "It blames perception in {perception:.0%} of the cases and has no answer for age, planning or "
    "physics. "
    "Contracts from the camera downwards, then replays with one "
    "ideal stage, name {ours:.0%}. That takes a simulator: one of the contracts needs the true "
    "target. The contracts alone name {alone:.0%} with it and {blind:.0%} without it.",
)
def last_error_blames(result):
    from course.pipeline import STAGES
    from course.pipeline.blame import FAULTS, confusion, contracts_alone

    text, _, last = confusion(1)
    alone, blind = contracts_alone(1).sum(axis=1) / text.sum()
    result.measure("alone", alone, 0.05)
    result.measure("blind", blind, 0.05)
    # Its two answers are perception and the arm, which counts as control.
    answers = [fault.stage in ("perceive", "control") for fault in FAULTS]
    possible = result.measure("possible", np.mean(answers))
    right = np.arange(len(FAULTS)), [STAGES.index(fault.stage) for fault in FAULTS]
    ours = result.measure("ours", text[right].sum() / text.sum(), 0.05)
    theirs = result.measure("last", last[right].sum() / last.sum(), 0.2)
    result.measure("perception", last[:, 0].sum() / last.sum(), 0.2)
    result.statement = "One failing run of each of ten injected faults."
    result.statement_holds(theirs > 0.9)
    result.correction_holds(
        ours > 0.8, theirs <= possible, possible < 0.5, bool(blind < 0.8 < alone)
    )


@claim(
    "Whatever the noise of a frame, as long as its variance is the promised one, limits of five or "
    "six standard deviations practically never raise an alarm in a run without a fault.",
    "That is right for noise that is Gaussian and independent from frame to frame. With the heavy "
    "tails of Student's t with {tails:.0f} degrees of freedom, the limit on single frames is "
    "exceeded in {heavy:.0%} of the runs without a fault. With a correlation of {memory:.1f} "
    "between neighbouring frames, the limit on the mean is exceeded in {alike:.0%}. The variance "
    "of a frame is the same in all three.",
    source="G. E. P. Box, G. M. Jenkins, Time series analysis, 1970",
)
def same_variance_same_alarms(result):
    from course.pipeline import Scenario, Settings
    from course.pipeline.blame import contracts
    from course.pipeline.noise import Noise, alarms_of_frames, alarms_of_mean, run_many_with

    tails, memory = result.input("tails", 3.0), result.input("memory", 0.9)
    scene, settings, runs = Scenario(), Settings(), 60

    def alarms(noise):
        """Return how many runs break a contract of perception, and the frames of a run."""
        records = run_many_with(scene, settings, noise, range(runs))
        stages = [{one.stage for one in contracts(record, settings)} for record in records]
        return sum("perceive" in some for some in stages), len(records[0].pictures)

    white, n = alarms(Noise())
    counts = [alarms(noise)[0] for noise in (Noise(tails=tails), Noise(memory=memory))]
    rates = [
        result.measure("heavy", alarms_of_frames(n, tails)),
        result.measure("alike", alarms_of_mean(n, memory)),
    ]
    result.statement = "Sixty runs of each kind without a fault, and the rates in closed form."
    result.statement_holds(max(counts) <= 1)
    result.correction_holds(
        white == 0,
        max(alarms_of_frames(n), alarms_of_mean(n)) < 1e-4,
        all(
            abs(k - runs * rate) < 3.5 * np.sqrt(runs * rate * (1.0 - rate))
            for k, rate in zip(counts, rates, strict=True)
        ),
    )


WORST: dict[str, dict[str, Any]] = {
    "perceive": {"noise": 0.2},
    "age": {"latency": 1.5},
    "plan": {"step": 0.03, "margin": 0.0, "check_cost": 2e-3},
    "control": {"kp": 2000.0, "kd": 0.0},
    "move": {"physics": 0.03, "control": 0.03},
}


@claim(
    "With everything at its worst, contracts lead back sooner than turning sliders.",
    "Resetting a single stage is not enough. Resetting the stage with the broken contract nearest "
    "to the camera, then the next, took {contracts:.1f} runs on average, the failed one counted. "
    "Resetting one stage after the other in random order took {kept:.1f}: no clear difference. "
    "Only trying every combination of stages, from one stage up, is slow, with {sliders:.0f} runs. "
    "Contracts save guessing here, hardly any runs.",
)
def contracts_before_sliders(result):
    from course.pipeline import Scenario, Settings, run
    from course.pipeline.blame import contracts

    scene, agreed = Scenario(), replace(Settings(), noise=0.01)

    @functools.cache
    def tried(good, seed):
        worst = [value for stage, value in WORST.items() if stage not in good]
        report = {name: x for value in worst for name, x in value.items()}
        return run(scene, replace(agreed, **report), seed=seed)

    def by_contracts(seed):
        good: frozenset[str] = frozenset()
        runs = 1
        while not (record := tried(good, seed)).success and runs < 9:
            broken = [one.stage for one in contracts(record, agreed) if one.stage not in good]
            good, runs = good.union(broken[:1]), runs + 1
        return runs

    def first_that_works(choices, seed):
        return next(i for i, some in enumerate(choices) if tried(frozenset(some), seed).success) + 1

    seeds = range(10)
    ours = result.measure("contracts", np.mean([by_contracts(seed) for seed in seeds]), 0.2)
    every = [some for n in range(6) for some in combinations(WORST, n)]
    theirs = result.measure("sliders", np.mean([first_that_works(every, k) for k in seeds]), 0.4)
    retained = result.measure(
        "kept",
        np.mean(
            [
                first_that_works([order[:n] for n in range(6)], k)
                for order in permutations(WORST)
                for k in seeds
            ]
        ),
        0.2,
    )
    result.statement = "Five stages at their worst, ten seeds; all orders of the sliders."
    result.statement_holds(ours < 0.8 * retained)
    result.correction_holds(
        ours <= len(WORST) + 1,
        theirs > 1.5 * ours,
        retained < 1.25 * ours,
        not any(tried(frozenset([one]), k).success for one in WORST for k in seeds),
    )


@claim(
    "A reward of -1 per step until the goal asks for the same behaviour at any step.",
    "At a tenth of the step, with the same discount and reward per step, the best behaviour "
    "changes from {before} to {after}. Converting the discount to {formula} is not enough "
    "({half}). If the reward of a step is converted to its shorter time as well, the best "
    "behaviour is the old one ({mended}).",
    ask=(
        "A task has a discount with the time constant H. What is the discount for a step h?",
        "gamma = exp(-h/H)",
        {
            "1 - h/H": "That is the first-order approximation for short steps.",
            "exp(-H/h)": "A shorter step discounts less.",
            "1/(1 + h/H)": "That is the rule of a random end, the same to first order only.",
            "exp(-h*H)": "A longer horizon discounts less.",
        },
    ),
    source="K. Doya, Reinforcement learning in continuous time and space, 2000",
)
def reward_by_the_step(result):
    import sympy

    from course.pipeline.timestep import Way, chain, prefers

    h, H, a = sympy.symbols("h H a", positive=True)
    # What is kept over one step of a decay at the rate 1 / H.
    f = sympy.Function("f")
    decay = sympy.dsolve(sympy.Eq(f(a).diff(a), -f(a) / H), f(a), ics={f(0): 1})
    result.formula = decay.rhs.subs(a, h)
    path, old, new = Way(), 0.01, 0.001
    retained = float(result.formula.subs({h: old, H: path.horizon}))
    paid = path.horizon * (1.0 - retained)
    before = prefers(chain(path, old))
    after = prefers(chain(path, new, gamma=retained, per_step=paid))
    half = prefers(chain(path, new, per_step=paid))
    mended = prefers(chain(path, new))
    for name, value in (("before", before), ("after", after), ("half", half), ("mended", mended)):
        result.measure(name, value[0])
    result.statement = "A walker's chain of 20 and of 200 steps, solved exactly."
    result.statement_holds(after[0] == before[0])
    result.correction_holds(
        mended[0] == before[0], after[0] != before[0], abs(mended[1] / before[1] - 1.0) < 0.1
    )


@claim(
    "At a tenth of the step, repeating each action ten times keeps the best behaviour of the task.",
    "Then discount, cost and possible paths per second are the old ones. The best behaviour is "
    "still to {best}, and its value changes by {moved:.1%}, because the arrival is paid a few "
    "short steps later. If each short step costs as much as a long one did, ten of them cost ten "
    "times as much, and it is best to {summed}. In both cases the policy cannot react sooner than "
    "before. Behaviours that are almost equally good may change places.",
)
def repeated_actions(result):
    from course.pipeline.timestep import ACTIONS, Way, chain, prefers, repeated
    from course.sim_to_real.shaping import policy_iteration

    path = Way()
    old, new = chain(path, 0.01), repeated(chain(path, 0.001), 10)
    result.measure("best", prefers(new)[0])
    retained = float(
        np.abs(new.transition[0:200:10, 0][:, 0:200:10] - old.transition[:20, 0, :20]).max()
    )
    result.measure("moved", abs(prefers(new)[1] / prefers(old)[1] - 1.0), 0.5)
    draws = [
        Way(cost=float(c), fall=float(f), effort=float(e))
        for c, f, e in result.rng.uniform((20.0, 0.5, 30.0), (150.0, 3.0, 90.0), (8, 3))
    ]

    def worth(walker):
        """Return the worth of one old step: its cost, its discount and its chance of a fall."""
        discount, falls = -np.expm1([-0.01 / walker.horizon, -0.01 * walker.fall])
        late = discount * max(walker.goal, -walker.hurt, -walker.fee)
        return 0.01 * (walker.cost + walker.effort) + late + falls * (walker.goal - walker.hurt)

    def same(walker, per_step=None):
        """Return whether repeated short steps keep the best behaviour, and its value.

        Both to what one old step is worth.
        """
        first, second = chain(walker, 0.01), repeated(chain(walker, 0.001, None, per_step), 10)
        values = first.backup(policy_iteration(first).value)[0]
        action, value = prefers(second)
        lost = values.max() - values[ACTIONS.index(action)]
        return lost < worth(walker) and abs(value - values.max()) < worth(walker)

    # Chosen to break it: short horizons, odd numbers of steps, of which running takes half, and
    # behaviours that are almost equally good.
    tasks = result.rng.uniform((5, -1.3, 20, 0, 0.1), (20, 0.7, 400, 200, 5), (12, 5))
    others = [Way(round(n) / 100, 10.0**k, cost, effort, fall=f) for n, k, cost, effort, f in tasks]
    ties = [Way(0.05, cost=cost, effort=cost) for cost in (20.0, 50.0, 100.0, 200.0)]

    # What a second costs by the long step, paid at every short one.
    unconverted = path.horizon * -np.expm1(-0.01 / path.horizon)
    summed = prefers(repeated(chain(path, 0.001, None, unconverted), 10))[0]
    result.measure("summed", summed)
    result.statement = "The walker's chain at 10 ms, and at 1 ms with each action ten times."
    result.statement_holds(
        same(path, unconverted),
        only_if="the rewards of the ten short steps sum to that of one old step, and we ignore "
        "differences in value that are smaller than what one old step can change by its cost, its "
        "discount and its chance of a fall",
        inside=[same(walker) for walker in [*draws, *others, *ties]],
        outside=[same(walker, unconverted) for walker in draws],
    )
    result.correction_holds(
        prefers(new)[0] == prefers(old)[0], retained < 1e-9, abs(new.gamma / old.gamma - 1.0) < 1e-9
    )


@claim(
    "Meshes make a simulation slow because each of their vertices has to be searched.",
    "Contacts are a second cause. A box makes {box:.1f} times as many solver rows as a sphere,"
    " and a hull of {few:.0f} points {hull:.1f} times as many. From {some:.0f} to {many:.0f} "
    "points, the rows grow by {more:.0%}, and collision detection takes about {search:.0f} times "
    "as long.",
)
def mesh_cost(result):
    from course.oracles.mujoco.heap import Heap

    few, some, several = (result.input(*x) for x in (("few", 20), ("some", 200), ("many", 2000)))

    def cost(points):
        heap = Heap(int(points), 8)
        costs = [heap.measure(40) for _ in range(5)]
        return np.mean([x.rows for x in costs]), min(x.collision for x in costs)

    sphere, box, hull, fine, finest = (cost(points) for points in (0, 1, few, some, several))
    boxes = result.measure("box", box[0] / sphere[0], 0.3)
    hulls = result.measure("hull", hull[0] / sphere[0], 0.3)
    more = result.measure("more", finest[0] / fine[0] - 1.0, 0.5)
    search = result.measure("search", finest[1] / fine[1], 0.5)
    result.statement = (
        "Eight bodies in MuJoCo on one core, measured with MuJoCo's own counters and timers; "
        "no GPU."
    )
    result.statement_holds(boxes < 1.2)
    result.correction_holds(boxes > 1.5, hulls > 1.5, more < 0.5, search > 1.0 + 2.0 * more)


@claim(
    "If cross-entropy sampling reports a failure rate with a small error, the rate is well known.",
    "The reported error covers only what was sampled. Of {n:.0f} repeats, {low:.0f} were too "
    "low by more than three reported errors, because the proposal was narrower than the "
    "failure region. With widths of at least 1 this happened {wide:.0f} times. With two "
    "failure regions it happened {sides:.0f} times even then, because the proposal found only "
    "one of them, and {mixed:.0f} times with a tenth of plain samples mixed in. "
    "Repeats that disagree reveal it; the effective number and the weights do not. "
    "Repeats that agree may all have missed the same region.",
    source="Rubinstein and Kroese, The cross-entropy method, 2004",
)
def rare_and_sure(result):
    from scipy.stats import norm

    from course.pipeline.rare import cross_entropy

    share, n = 4.9e-4, int(result.input("n", 60))
    edge, far = norm.isf(share), norm.isf(0.5 * share)

    def one_side(x):
        return 0.8 * x[0] + 0.6 * x[1] - edge

    def two_sides(x):
        return np.abs(0.8 * x[0] + 0.6 * x[1]) - far

    def repeats(severity, **options):
        return [cross_entropy(severity, 6, np.random.default_rng(k), **options) for k in range(n)]

    narrow, wide = repeats(one_side), repeats(one_side, least=1.0)
    both = repeats(two_sides, least=1.0)
    mixture = repeats(two_sides, least=1.0, defence=0.1)
    low, fair, half, mixed = (
        [one for one in some if one.share + 3.0 * one.error < share]
        for some in (narrow, wide, both, mixture)
    )
    result.measure("low", len(low), 0.5)
    result.measure("wide", len(fair), 0.5)
    result.measure("sides", len(half), 0.3)
    result.measure("mixed", len(mixed), 0.4)

    def typical(some, name):
        return float(np.median([getattr(one, name) for one in some]))

    ratios = [
        np.std([one.share for one in some]) / typical(some, "error") for some in (narrow, both)
    ]
    result.statement = "Half-spaces of known probability in six dimensions, 2,500 runs a repeat."
    result.statement_holds(len(low) <= 0.01 * n)
    result.correction_holds(
        len(low) > 3 * len(fair),
        len(half) > 0.3 * n,
        len(mixed) > 0.2 * n,
        min(ratios) > 1.5,
        all(
            typical(few, "effective") > 0.5 * typical(all_, "effective")
            and typical(few, "heaviest") < 2.0 * typical(all_, "heaviest")
            for few, all_ in ((low, narrow), (half, both))
        ),
    )
