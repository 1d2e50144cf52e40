"""Claims of chapter 8 about vectorised environments: ends of episodes, seeds, processes."""

from typing import Any

import numpy as np

from course.derivations import Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol


class _Clocked:
    """Reward 1 at every step, for ever; only a clock cuts the episodes."""

    def __init__(self, clock: int) -> None:
        self.clock = clock

    def reset(self, seed: int | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        self.steps = 0
        self.start = np.random.default_rng(seed).random()
        return np.array([0.0, self.start]), {}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        late = self.steps == self.clock
        return np.array([float(self.steps), self.start]), 1.0, False, late, {}


@claim(
    "vector_one_done_flag",
    8,
    "A vectorised environment may return one flag `done` for the end of an episode.",
    verdict=Verdict.CONDITIONAL,
    condition="no episode is cut off by a clock",
    corrected="An episode that the clock cuts off (truncated) still has a future, one that is over "
    "(terminated) has none. With reward 1 for ever and discount 0.9 a state is worth 10. Learned "
    "with one flag and a clock of 10 steps it is worth 5.26; with both flags, and the last "
    "observation to bootstrap from, 10.",
    figures={
        "value": (10.0, 1e-9),
        "learned_with_one_flag": (1.0 / 0.19, 1e-6),
        "learned_with_two": (10.0, 1e-6),
    },
    source="F. Pardo et al., Time limits in reinforcement learning, 2018",
)
def _one_done_flag() -> Finding:
    from course.drills import VectorizedEnv

    gamma = 0.9

    def learned(clock: int, merged: bool) -> float:
        """The value that agrees with the mean of its targets, of a learner without a clock."""
        envs = VectorizedEnv(lambda: _Clocked(clock), 4)
        envs.reset(seed=0)
        rewards, goes_on = [], []
        for _ in range(200):
            _, reward, terminated, truncated, _ = envs.step(np.zeros((4, 1)))
            rewards.append(reward)
            goes_on.append(~(terminated | truncated) if merged else ~terminated)
        # v = mean(reward + gamma * goes_on * v), solved for v
        return float(np.mean(rewards) / (1.0 - gamma * np.mean(goes_on)))

    value = 1.0 / (1.0 - gamma)
    one, two = learned(10, True), learned(10, False)
    return Finding(
        {"value": value, "learned_with_one_flag": one, "learned_with_two": two},
        "The fixed point of the targets over 200 steps of 4 environments.",
        holds=abs(one - value) < 1e-9,
        holds_if=abs(learned(10**6, True) - value) < 1e-9,
        corrected=abs(two - value) < 1e-9 and abs(one - 1.0 / 0.19) < 1e-9,
    )


@claim(
    "vector_one_step_test",
    8,
    "One step, and `assert 'terminal_obs' in info[0] if done[0] else True`, tests that the last "
    "observation is kept.",
    verdict=Verdict.FALSE,
    corrected="After one step hardly any episode is over, and then the line asserts True. A class "
    "that throws the last observation away passes it. A test must run until an episode ends and "
    "compare the observation with that of a single environment.",
    figures={"ends_seen_in_100_runs": (0.0, 0.0), "wrong_class_passes": (100.0, 0.0)},
)
def _one_step_test() -> Finding:
    from course.drills import VectorizedEnv

    class Forgetful(VectorizedEnv):
        def step(self, actions: Any) -> Any:
            *rest, infos = super().step(actions)
            kept = [{k: v for k, v in i.items() if not k.startswith("final")} for i in infos]
            return *rest, kept

    def one_step(kind: Any, clock: int, seed: int) -> tuple[bool, bool]:
        """Whether the assertion passes, and whether it looked at anything."""
        envs = kind(lambda: _Clocked(clock), 4)
        envs.reset(seed=seed)
        _, _, terminated, truncated, infos = envs.step(np.zeros((4, 1)))
        done = terminated | truncated
        return bool("final_obs" in infos[0] if done[0] else True), bool(done[0])

    runs = [one_step(Forgetful, 100, seed) for seed in range(100)]
    passes, ends = sum(p for p, _ in runs), sum(e for _, e in runs)
    at_an_end = one_step(Forgetful, 1, 0)
    return Finding(
        {"ends_seen_in_100_runs": ends, "wrong_class_passes": passes},
        "Run on a class that drops the last observation, with episodes of 100 steps.",
        holds=passes < 100,
        corrected=ends == 0 and at_an_end == (False, True) and one_step(VectorizedEnv, 1, 0)[0],
    )


@claim(
    "vector_zip_of_actions",
    8,
    "for env, action in zip(envs, actions) steps every environment with its action.",
    verdict=Verdict.CONDITIONAL,
    condition="there are as many actions as environments",
    corrected="zip stops at the shorter one. With 3 actions for 4 environments the fourth is not "
    "stepped; with 5, one action is dropped; neither is reported. The number must be checked, or "
    "zip told to be strict.",
    figures={
        "stepped_of_4_with_3_actions": (3.0, 0.0),
        "used_of_5_actions": (4.0, 0.0),
        "checked": ("ValueError", 0),
    },
)
def _zip_of_actions() -> Finding:
    from course.vector_env import ArmReach, VectorizedEnv

    envs, checked = range(4), "nothing"
    few = len([env for env, _ in zip(envs, range(3), strict=False)])
    many = len([env for env, _ in zip(envs, range(5), strict=False)])
    right = len([env for env, _ in zip(envs, range(4), strict=False)])
    ours = VectorizedEnv(ArmReach, 4)
    ours.reset(seed=0)
    try:
        ours.step(np.zeros((3, 2)))
    except ValueError as error:
        checked = type(error).__name__
    return Finding(
        {"stepped_of_4_with_3_actions": few, "used_of_5_actions": many, "checked": checked},
        "Counted.",
        holds=few == 4,
        holds_if=right == 4,
        corrected=(few, many, checked) == (3, 4, "ValueError"),
    )


@claim(
    "vector_same_step_reset",
    8,
    "The step that ends an episode returns the first observation of the next one.",
    verdict=Verdict.CONDITIONAL,
    condition="the autoreset mode is SAME_STEP",
    corrected="Gymnasium's vector environments start the next episode in the next step by default "
    "(NEXT_STEP): the step that ends an episode returns its last observation, and the next one "
    "ignores its action and has reward 0. metadata['autoreset_mode'] says which it is.",
    figures={
        "default": ("NextStep", 0),
        "last_shown_next_step": (1.0, 0.0),
        "last_shown_same_step": (0.0, 0.0),
        "reward_of_the_resetting_step": (0.0, 1e-12),
    },
    source="Gymnasium documentation, Vector environments, autoreset modes",
)
def _same_step_reset() -> Finding:
    import gymnasium

    from course.vector_env import ArmReach

    def build() -> ArmReach:
        return ArmReach(max_steps=1)

    def last_shown(**mode: Any) -> tuple[bool, float, str]:
        envs = gymnasium.vector.SyncVectorEnv([build], **mode)
        envs.reset(seed=0)
        single = build()
        single.reset(seed=0)
        action = np.full((1, 2), 0.5, np.float32)
        last = single.step(action[0])[0]
        shown = bool(np.array_equal(envs.step(action)[0][0], last))
        reward = float(envs.step(action)[1][0])
        return shown, reward, envs.metadata["autoreset_mode"].value

    later, reward, name = last_shown()
    same, other, _ = last_shown(autoreset_mode="SameStep")
    return Finding(
        {
            "default": name,
            "last_shown_next_step": later,
            "last_shown_same_step": same,
            "reward_of_the_resetting_step": reward,
        },
        "Gymnasium's SyncVectorEnv over an environment that ends after one step.",
        holds=not later,
        holds_if=not same,
        corrected=later and not same and reward == 0.0 and other != 0.0 and name == "NextStep",
    )


@claim(
    "vector_one_seed",
    8,
    "Resetting N environments with a fixed seed gives N different, repeatable episodes.",
    verdict=Verdict.CONDITIONAL,
    condition="each of them gets a seed of its own",
    corrected="With one seed for all they are copies: N times the work, one environment's "
    "experience. Seeds s, s + 1, ... give different ones, and repeat as well.",
    figures={"different_of_8_with_one_seed": (1.0, 0.0), "different_of_8_with_own": (8.0, 0.0)},
)
def _one_seed() -> Finding:
    from course.vector_env import ArmReachVector

    def different(seed: Any) -> int:
        envs = ArmReachVector(8)
        observations, _ = envs.reset(seed=seed)
        return len({row.tobytes() for row in observations})

    one, own = different([5] * 8), different(5)
    return Finding(
        {"different_of_8_with_one_seed": one, "different_of_8_with_own": own},
        "Distinct first observations of the reaching task.",
        holds=one == 8,
        holds_if=own == 8,
        corrected=(one, own) == (1, 8),
    )


@claim(
    "vector_processes_pay",
    8,
    "Stepping N environments in W processes is faster than stepping them in a loop.",
    verdict=Verdict.CONDITIONAL,
    condition="one environment's step costs more than r / (N (1 - 1 / W))",
    corrected="A loop takes N c for a step, W processes on as many free processors N c / W and r, "
    "the time of waking them and hearing from them. They pay from c = r / (N (1 - 1 / W)) on. "
    "With r = 200 us, 8 environments and 2 workers that is 50 us, several times what a small "
    "MuJoCo model costs; the chart vector_env measures it.",
    figures={"break_even_us": (50.0, 1e-9), "ratio_at_10_us": (0.3333333, 1e-6)},
    formula=Formula(
        "From which cost c of one environment's step do W processes beat a loop over N "
        "environments, when waking the workers and hearing from them takes r?",
        "r/(N*(1 - 1/W))",
        {
            "r": Symbol("time to wake the workers and hear from them [s]"),
            "N": Symbol("number of environments", 1.0, 100.0),
            "W": Symbol("number of workers", 2.0, 16.0),
        },
        slips={
            "r/N": "That is where the loop's time equals r alone. The processes also compute: they "
            "take N c / W beside r.",
            "r/(N*(1 + 1/W))": "The sign: the processes save N c (1 - 1 / W) and pay r for it.",
            "r*W/N": "That compares r with the processes' own computing, N c / W, not with what "
            "they save.",
            "r/(1 - 1/W)": "This forgets that the saving is that of all N environments.",
        },
        left=("c",),
        relation=">",
    ),
)
def _processes_pay() -> Finding:
    import sympy

    c, r, n, w = sympy.symbols("c r N W", positive=True)
    loop, processes = n * c, n * c / w + r
    (even,) = sympy.solve(sympy.Eq(loop, processes), c)
    numbers = {r: 200, n: 8, w: 2}

    def ratio(cost: float) -> float:
        return float((loop / processes).subs(numbers | {c: cost}))

    break_even = float(even.subs(numbers))
    return Finding(
        {"break_even_us": break_even, "ratio_at_10_us": ratio(10)},
        "By algebra; times in microseconds.",
        holds=ratio(10) > 1.0,
        holds_if=ratio(1.01 * break_even) > 1.0,
        corrected=sympy.simplify(even - r / (n * (1 - 1 / w))) == 0 and ratio(49) < 1.0,
        formula=even,
    )
