"""Claims of chapter 8 about vectorised environments: ends of episodes, seeds, processes."""

import functools
import os

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "r": Symbol("time to wake the workers and hear from them [s]"),
    "N": Symbol("number of environments", 1.0, 100.0),
    "W": Symbol("number of workers", 2.0, 16.0),
}


class _Clocked:
    """Reward 1 at every step, for ever; only a clock cuts the episodes."""

    def __init__(self, clock):
        self.clock = clock
        self.steps = 0

    def reset(self, seed=None):
        self.steps = 0
        self.start = np.random.default_rng(seed).random()
        return np.array([0.0, self.start]), {}

    def step(self, action):
        self.steps += 1
        late = self.steps == self.clock
        return np.array([float(self.steps), self.start]), 1.0, False, late, {}


def _asserted(kind, clock, seed):
    """Return whether the assertion passes after one step, and whether it looked at anything."""
    envs = kind(lambda: _Clocked(clock), 4)
    envs.reset(seed=seed)
    _, _, terminated, truncated, infos = envs.step(np.zeros((4, 1)))
    done = terminated | truncated
    return bool("final_obs" in infos[0] if done[0] else True), bool(done[0])


def _stepped(kind, environments, actions):
    """Return the environments that were stepped and the actions that were used."""
    envs = kind(lambda: _Clocked(100), environments)
    envs.reset(seed=0)
    results = envs.step(np.zeros((actions, 1)))
    return sum(env.steps for env in envs.envs), len(results)


@claim(
    "A vectorised environment may return one flag `done` for the end of an episode.",
    "An episode that the clock cuts off (truncated) still has a future, one that is over "
    "(terminated) has none. With reward 1 for ever and discount {discount:.1f} a state is worth "
    "{value:.0f}. Learned with one flag and a clock of {clock_steps:.0f} steps it is worth "
    "{learned_with_one_flag:.2f}; with both flags, and the last observation to bootstrap from, "
    "{learned_with_two:.0f}.",
    source="F. Pardo et al., Time limits in reinforcement learning, 2018",
)
def vector_one_done_flag(result):
    from course.drills import VectorizedEnv

    discount, clock = result.input("discount", 0.9), result.input("clock_steps", 10)

    class Over(_Clocked):
        """Is over after its last step, instead of cut off."""

        def step(self, action):
            observation, reward, _, late, info = super().step(action)
            return observation, reward, late, False, info

    def learned(clock, merged, gamma=discount, kind=_Clocked):
        """Return the value equal to the mean of its targets, for a learner without a clock."""
        envs = VectorizedEnv(lambda: kind(clock), 4)
        envs.reset(seed=0)
        rewards, goes_on = [], []
        for _ in range(200):
            _, reward, terminated, truncated, _ = envs.step(np.zeros((4, 1)))
            rewards.append(reward)
            goes_on.append(~(terminated | truncated) if merged else ~terminated)
        # v = mean(reward + gamma * goes_on * v), solved for v
        return np.mean(rewards) / (1.0 - gamma * np.mean(goes_on))

    def right(clock, merged, gamma):
        return abs(learned(clock, merged, gamma) * (1.0 - gamma) - 1.0) < 1e-9

    result.measure("value", learned(10**6, False), tolerance=1e-9)
    one = result.measure("learned_with_one_flag", learned(clock, True))
    result.measure("learned_with_two", learned(clock, False))
    result.statement = "The fixed point of the targets over 200 steps of 4 environments."
    draws = list(zip(result.rng.integers(2, 190, 8), result.rng.uniform(0.5, 0.99, 8), strict=True))
    result.statement_holds(
        right(clock, True, discount),
        only_if="no episode is cut off, by a clock or by anything else",
        inside=[right(200 + int(n), True, gamma) for n, gamma in draws]
        # Chosen to break it: episodes that are over, after 1, 2 or 5 steps; a step then goes on
        # with the probability 1 - 1/n.
        + [
            abs(learned(n, True, gamma, Over) * (1.0 - gamma * (1.0 - 1.0 / n)) - 1.0) < 1e-9
            for n, (_, gamma) in zip((1, 2, 5), draws, strict=False)
        ],
        outside=[right(int(n), True, gamma) for n, gamma in draws],
    )
    result.correction_holds(
        abs(one - 1.0 / 0.19) < 1e-9, all(right(int(n), False, gamma) for n, gamma in draws)
    )


@claim(
    "One step, and `assert 'terminal_obs' in info[0] if done[0] else True`, tests that the last "
    "observation is kept.",
    "After one step hardly any episode is over, and then the line asserts True. A class that "
    "throws the last observation away passed it {wrong_class_passes:.0f} times of {runs:.0f}. A "
    "test must run until an episode ends and compare the observation with that of a single "
    "environment.",
)
def vector_one_step_test(result):
    from course.drills import VectorizedEnv

    class Forgetful(VectorizedEnv):
        def step(self, actions):
            *rest, infos = super().step(actions)
            selected = [{k: v for k, v in i.items() if not k.startswith("final")} for i in infos]
            return *rest, selected

    count = result.input("runs", 100)
    runs = np.array([_asserted(Forgetful, 100, seed) for seed in range(count)])
    passes = result.measure("wrong_class_passes", runs[:, 0].sum())
    result.measure("ends_seen_in_100_runs", runs[:, 1].sum())
    result.statement = "Run on a class that drops the last observation, with episodes of 100 steps."
    result.statement_holds(passes < count)
    result.correction_holds(
        runs[:, 1].sum() == 0,
        not _asserted(Forgetful, 1, 0)[0],
        _asserted(Forgetful, 1, 0)[1],
        _asserted(VectorizedEnv, 1, 0)[0],
    )


@claim(
    "for env, action in zip(envs, actions) steps every environment with its action.",
    "zip stops at the shorter one. With 3 actions for 4 environments "
    "{stepped_of_4_with_3_actions:.0f} are stepped; with 5, {used_of_5_actions:.0f} are used; "
    "neither is reported. The number must be checked, or zip told to be strict: this course's two "
    "classes answer with a {checked}.",
)
def vector_zip_of_actions(result):
    from course import drills, vector_env

    class Zipped(drills.VectorizedEnv):
        def step(self, actions):
            return [env.step(action) for env, action in zip(self.envs, actions, strict=False)]

    def answer(envs, actions):
        envs.reset(seed=0)
        try:
            envs.step(actions)
        except ValueError as error:
            return type(error).__name__
        return "nothing"

    few = result.measure("stepped_of_4_with_3_actions", _stepped(Zipped, 4, 3)[0])
    count = result.measure("used_of_5_actions", _stepped(Zipped, 4, 5)[1])
    ours = vector_env.VectorizedEnv(vector_env.ArmReach, 4)
    checked = result.measure("checked", answer(ours, np.zeros((3, 2))))
    drill = drills.VectorizedEnv(lambda: _Clocked(100), 4)
    result.statement = "Counted by the environments."

    class Noted(_Clocked):
        """Remembers the action it got."""

        def step(self, action):
            self.action = np.copy(action)
            return super().step(action)

    def own(n, form):
        """Return whether each of n environments got its row, from actions in another form."""
        envs, actions = Zipped(lambda: Noted(100), n), result.rng.normal(size=(n, n))
        envs.reset(seed=0)
        envs.step(form(actions))
        return all(
            np.array_equal(env.action, row) for env, row in zip(envs.envs, actions, strict=True)
        )

    def every(environments, actions):
        return _stepped(Zipped, environments, actions) == (environments, actions)

    counts = [int(n) for n in result.rng.integers(1, 20, 10)]
    result.statement_holds(
        every(4, 3),
        only_if="there are as many actions as environments, in the environments' order",
        inside=[every(n, n) for n in counts]
        # Chosen to break it: lists, tuples, iterators that can be used once, one environment.
        + [own(n, form) for n in (1, 2, 7) for form in (list, tuple, iter, np.asfortranarray)],
        outside=[every(n, n + (-1) ** i) for i, n in enumerate(counts)]
        # As many columns as environments: transposed, the number is right and the order is not.
        + [own(n, form) for n in (2, 7) for form in (np.transpose, np.flipud)],
    )
    result.correction_holds(
        few == 3,
        count == 4,
        checked == "ValueError",
        all(answer(drill, np.zeros((n, 1))) == "ValueError" for n in (3, 5)),
    )


@claim(
    "The step that ends an episode returns the first observation of the next one.",
    "Gymnasium's vector environments start the next episode in the next step by default (NEXT_STEP)"
    ": the step that ends an episode returns its last observation, and the next one ignores its "
    "action and has reward {reward_of_the_resetting_step:.0f}. metadata['autoreset_mode'] says "
    "which it is.",
    source="Gymnasium 1.x documentation, Vector environments, autoreset modes",
)
def vector_same_step_reset(result):
    import gymnasium

    from course.vector_env import ArmReach

    def build():
        return ArmReach(max_steps=1)

    def last_shown(seed=0, **mode):
        """Return whether the last step shows its own observation, next reward, and mode."""
        envs = gymnasium.vector.SyncVectorEnv([build], **mode)
        envs.reset(seed=seed)
        single = build()
        single.reset(seed=seed)
        action = np.full((1, 2), 0.5, np.float32)
        shown = np.array_equal(envs.step(action)[0][0], single.step(action[0])[0])
        return shown, envs.step(action)[1][0], envs.metadata["autoreset_mode"].value

    later, reward, name = last_shown()
    same, other, _ = last_shown(autoreset_mode="SameStep")
    result.measure("default", name)
    result.measure("last_shown_next_step", later)
    result.measure("last_shown_same_step", same)
    result.measure("reward_of_the_resetting_step", reward)
    result.statement = "Gymnasium's SyncVectorEnv over an environment that ends after one step."
    seeds = [int(seed) for seed in result.rng.integers(0, 10**6, 8)]

    def first_shown(lengths):
        """Return whether each end shows the first observation of the next episode."""
        kinds = [functools.partial(ArmReach, max_steps=n) for n in lengths]
        envs = gymnasium.vector.SyncVectorEnv(kinds, autoreset_mode="SameStep")
        starts: list[int | None] = list(range(len(lengths)))
        single = [kind() for kind in kinds]
        envs.reset(seed=starts)
        for env, start in zip(single, starts, strict=True):
            env.reset(seed=start)
        right = []
        for _ in range(8):
            action = np.full((len(lengths), 2), 0.3, np.float32)
            shown = envs.step(action)[0]
            for env, row in zip(single, shown, strict=True):
                if any(env.step(action[0])[2:4]):
                    right.append(np.array_equal(row, env.reset()[0]))
        return len(right) > 4 and all(right)

    result.statement_holds(
        not later,
        only_if="the autoreset mode is SAME_STEP",
        inside=[not last_shown(seed, autoreset_mode="SameStep")[0] for seed in seeds]
        # Chosen to break it: several environments, which end at different steps.
        + [first_shown(lengths) for lengths in ((1, 1), (1, 2, 3), (3, 1, 4))],
        outside=[not last_shown(seed)[0] for seed in seeds],
    )
    result.correction_holds(reward == 0.0, other != 0.0, name == "NextStep")


@claim(
    "Resetting N environments with a fixed seed gives N different, repeatable episodes.",
    "With one seed for all they are copies: N times the work, one environment's experience. Seeds "
    "s, s + 1, ... give different ones if there are many possible starts, and repeat as well if "
    "each environment samples from a generator that its seed starts and the actions repeat too. "
    "But the next run needs a seed that is "
    "N "
    "or more away: runs with s and s + 1 share all episodes but one.",
)
def vector_one_seed(result):
    import gymnasium

    from course.vector_env import ArmReachVector

    envs = ArmReachVector(8)

    def rows(seed):
        return [row.tobytes() for row in envs.reset(seed=seed)[0]]

    def good(seed):
        """Return whether the eight are different, and the same again."""
        return len(set(rows(seed))) == 8 and rows(seed) == rows(seed)

    def repeats(kind, seeds):
        """Return whether environments start in different states, and in the same ones again."""
        some = gymnasium.vector.SyncVectorEnv([kind] * len(seeds))
        a, b = ([row.tobytes() for row in some.reset(seed=seeds)[0]] for _ in range(2))
        return len(set(a)) == len(seeds) and a == b

    class Start(gymnasium.Env):
        """Starts where its own generator says, which the seed starts."""

        observation_space = gymnasium.spaces.Box(-1.0, 1.0, (2,))
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,))

        def start(self):
            return self.np_random.uniform(-1.0, 1.0, 2)

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            return self.start().astype(np.float32), {}

    class Fixed(Start):
        """Always starts in the same state."""

        def start(self):
            return np.zeros(2)

    class Global(Start):
        """Starts where a generator says that its seed does not reach."""

        def start(self):
            return result.rng.uniform(-1.0, 1.0, 2)

    class Few(Start):
        """Starts at one of twelve places."""

        def start(self):
            return np.array([self.np_random.integers(12), 0.0]) / 12.0

    def again(rng, other):
        """Return whether the second step repeats with actions from these generators."""
        seen = []
        for actions in (rng, other):
            envs.reset(seed=5)
            seen.append(envs.step(actions.uniform(-1.0, 1.0, envs.action_space.shape))[0])
        return bool(np.array_equal(*seen))

    result.measure("different_of_8_with_one_seed", np.size(list(set(rows([5] * 8)))))
    result.measure("different_of_8_with_own", np.size(list(set(rows(5)))))
    result.statement = "Distinct first observations of the reaching task."
    seeds = [int(seed) for seed in result.rng.integers(0, 10**6, 10)]
    first = [rows([seed] * 8) for seed in seeds]
    result.statement_holds(
        good([5] * 8),
        only_if="each of them gets a seed of its own, starts at random in one of so many states "
        "that two rarely coincide, and samples from a generator that this seed starts, and the "
        "actions repeat, too",
        inside=[good(seed) for seed in seeds]
        # Chosen to break it: seeds in another order, far apart, and many.
        + [good([2**31, 0, 7, 6, 5, 1, 2**40, 3]), repeats(Start, list(range(300)))]
        + [again(*(np.random.default_rng(0) for _ in range(2)))],
        outside=[good([seed] * 8) for seed in seeds]
        # Chosen to break it: few possible starts, and actions that nobody has seeded.
        + [repeats(kind, list(range(8))) for kind in (Fixed, Global, Few)]
        + [again(*result.rng.spawn(2))],
    )
    result.correction_holds(
        all(len(set(rows([seed] * 8))) == 1 for seed in seeds),
        first == [rows([seed] * 8) for seed in seeds],
        all(len(set(rows(seed)) & set(rows(seed + 1))) == 7 for seed in seeds),
        all(not set(rows(seed)) & set(rows(seed + 8)) for seed in seeds),
    )


@claim(
    "Stepping N environments in W processes is faster than stepping them in a loop.",
    "A loop takes N c for a step, W processes on as many free processors N c / W and r, the time "
    "of waking them and hearing from them. They pay from c = {formula} on. With r = "
    "{wake_us:.0f} us, {environments:.0f} environments and {workers:.0f} workers that is "
    "{break_even_us:.0f} us, several times what a small MuJoCo model costs; the chart vector_env "
    "measures it.",
    ask=(
        "From which cost c of one environment's step do W processes beat a loop over N "
        "environments, when waking the workers and hearing from them takes r?",
        "c > r/(N*(1 - 1/W))",
        {
            "r/N": "That is where the loop's time equals r alone. The processes also compute: they "
            "take N c / W beside r.",
            "r/(N*(1 + 1/W))": "The sign: the processes save N c (1 - 1 / W) and pay r for it.",
            "r*W/N": "That compares r with the processes' own computing, N c / W, not with what "
            "they save.",
            "r/(1 - 1/W)": "This forgets that the saving is that of all N environments.",
        },
    ),
)
def vector_processes_pay(result):
    import sympy

    from course.charts.vector_env import predicted_crossing
    from course.vector_env import ArmReach, ProcessVectorEnv

    class Located(ArmReach):
        """Says in which process it lives."""

        @property
        def process(self):
            return os.getpid()

    c, r, n, w = sympy.symbols("c r N W", positive=True)
    (result.formula,) = sympy.solve(sympy.Eq(n * c, n * c / w + r), c)
    environments, workers = result.input("environments", 8), result.input("workers", 2)
    wake = result.input("wake_us", 200)
    envs = ProcessVectorEnv(Located, environments, num_workers=workers)
    homes = envs.get_attr("process")
    envs.close()
    each = [homes.count(home) for home in set(homes)]  # steps that a worker makes, one by one

    def ratio(cost, waking=wake, n=environments, w=workers):
        """Time of a loop over that of processes, of which the slowest makes ceil(n / w) steps."""
        return n * cost / (np.ceil(n / w) * cost + waking)

    def paying(costs, waking, w, free):
        """Return whether w workers on `free` processors beat the loop, over any costs.

        The workers take consecutive shares. They end with the slowest of them, and no sooner than
        the free processors get through all of the work.
        """
        slowest = max(share.sum() for share in np.array_split(costs, w))
        return costs.sum() > max(slowest, costs.sum() / min(free, w)) + waking

    def even(waking=wake, n=environments, w=workers):
        return predicted_crossing(0.0, waking, n, w, 0.0)

    break_even = result.measure("break_even_us", even(), tolerance=1e-9)
    result.measure("ratio_at_10_us", ratio(even() / 5))
    result.statement = (
        f"By algebra, with the shares counted in {workers} processes: each steps {max(each)} of "
        f"{environments} environments. Times in microseconds."
    )
    draws = [
        (result.rng.uniform(20, 500), int(w * k), int(w))
        for w, k in zip(result.rng.integers(2, 9, 12), result.rng.integers(1, 9, 12), strict=True)
    ]
    beyond, short = result.rng.uniform(1.01, 3, 12), result.rng.uniform(0.3, 0.99, 12)
    # Chosen to break the condition: a worker for each environment, many environments, barely paid.
    attacks = [(200.0, 8, 8), (20.0, 64, 64), (500.0, 4096, 2), (0.1, 2, 2)]
    # Outside: one environment takes nearly all the time; one processor is free for all workers.
    uneven, crowded = [], []
    for r_, n_, w_ in draws[:8]:
        costs = np.full(n_, 3.0 * even(r_, n_, w_))
        crowded.append(paying(costs, r_, w_, 1))
        costs[1:] *= 1e-3
        costs[0] = 3.0 * n_ * even(r_, n_, w_) - costs[1:].sum()
        uneven.append(paying(costs, r_, w_, w_))
    result.statement_holds(
        ratio(0.2 * break_even) > 1.0,
        only_if="all environments cost the same, more than r / (N (1 - 1 / W)) a step, W divides "
        "N, and W processors are free",
        inside=[ratio(x * even(*d), *d) > 1 for x, d in zip(beyond, draws, strict=True)]
        + [paying(np.full(d[1], 1.001 * even(*d)), d[0], d[2], d[2]) for d in attacks],
        outside=[ratio(x * even(*d), *d) > 1 for x, d in zip(short, draws, strict=True)]
        + uneven
        + crowded,
    )
    values = [float(result.formula.subs({r: a, n: b, w: k})) for a, b, k in draws]
    result.correction_holds(
        set(each) == {environments // workers} and len(each) == workers,
        all(abs(even(*d) / value - 1) < 1e-12 for d, value in zip(draws, values, strict=True)),
        ratio(0.99 * break_even) < 1.0 < ratio(1.01 * break_even),
        not any(uneven),
        not any(crowded),
    )
