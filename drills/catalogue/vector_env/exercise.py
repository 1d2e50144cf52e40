"""The vectorised environment: all that it returns is determined, so the worked answer judges it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np

from drills.attempt import Attempt
from drills.case_judge import Stage, staged
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, slips
from drills.inprocess import Local
from drills.reasons import Reason
from drills.sandbox import Handle
from drills.values import describe

ENTRY = "VectorizedEnv"
ROUNDING = 1e-12
WHY = "the values are handed through, not computed"
NAMES = ("observations", "rewards", "terminated", "truncated", "infos")
STEPS = 14


class Pair:
    """The same environments twice: the submission's in the child, the worked answer's here."""

    def __init__(self, attempt: Attempt, num_envs: int, ends: int, clock: int) -> None:
        self.attempt, self.num_envs = attempt, num_envs
        self.factory: Handle = attempt.learner.given_new("factory", ends, clock)
        self.factory_here: Local = attempt.reference.given_new("factory", ends, clock)
        self.envs = attempt.learner.new(ENTRY, self.factory, num_envs)
        self.envs_here = attempt.reference.new(ENTRY, self.factory_here, num_envs)

    def reset(self, seed: int | None) -> bool:
        """Reset both and compare."""
        attempt = self.attempt
        seeds = () if seed is None else (seed,)
        got = attempt.learner.method(self.envs, "reset", *seeds)
        expected = attempt.reference.method(self.envs_here, "reset", *seeds)
        self.first_infos = expected[1]
        call = f"reset({seed})"
        if isinstance(got, np.ndarray):  # not one row for each of two results
            got = [got]
        parts = attempt.parts(got, ("observations", "infos"), call=call)
        return parts is not None and (
            self.values("first observations", parts[0], expected[0], call)
            and self.infos("infos of the reset", parts[1], expected[1], call)
        )

    def step(self, actions: Any) -> bool:
        """Step both the submission and the solution; return whether the results agree."""
        attempt = self.attempt
        got = attempt.learner.method(self.envs, "step", actions)
        expected = attempt.reference.method(self.envs_here, "step", actions)
        return self.step_is_right(got, expected, "step(actions)")

    def step_is_right(self, got: Any, expected: Any, call: str) -> bool:
        """Compare what one step returned."""
        parts = self.attempt.parts(got, NAMES, call=call)
        return parts is not None and (
            self.values("observations", parts[0], expected[0], call)
            and self.values("rewards", parts[1], expected[1], call)
            and self.flags("terminated", parts[2], expected[2], call)
            and self.flags("truncated", parts[3], expected[3], call)
            and self.infos("infos", parts[4], expected[4], call)
        )

    def values(self, name: str, got: Any, expected: Any, call: str) -> bool:
        """Compare numbers."""
        return self.attempt.compare(
            name, got, expected, tolerance=ROUNDING, unit="1", why=WHY, call=call
        )

    def flags(self, name: str, got: Any, expected: Any, call: str) -> bool:
        """Compare bools; an array or a list of them."""
        if isinstance(got, np.ndarray):
            got = got.tolist()
        if isinstance(got, list | tuple):
            scalars = [isinstance(x, np.ndarray | np.generic) and x.ndim == 0 for x in got]
            got = [x.item() if scalar else x for x, scalar in zip(got, scalars, strict=True)]
        desired = expected.tolist()
        if not isinstance(got, list) or [type(x) for x in got] != [bool] * len(desired):
            return self.attempt.require(
                name,
                False,
                sentence=f"{name} must be {len(desired)} bools.",
                got=describe(got),
                expected=f"{len(desired)} bools",
                call=call,
                reason=Reason.WRONG_TYPE if not isinstance(got, list) else Reason.WRONG_SHAPE,
            )
        i = next((i for i, (a, b) in enumerate(zip(got, desired, strict=True)) if a != b), 0)
        return self.attempt.require(
            name,
            got == desired,
            sentence=f"{name} is {got[i]} for environment {i}, and should be {desired[i]}.",
            got=describe(got),
            expected=describe(desired),
            call=call,
        )

    def infos(self, name: str, got: Any, expected: list[dict[str, Any]], call: str) -> bool:
        """Compare the dicts, entry by entry."""
        if not isinstance(got, list | tuple) or len(got) != len(expected):
            sentence = f"The infos must be a list of {len(expected)} dicts."
            return self.attempt.require(
                name,
                False,
                sentence=sentence,
                got=describe(got),
                call=call,
                reason=Reason.WRONG_SHAPE,
            )
        for i, (mine, right) in enumerate(zip(got, expected, strict=True)):
            if not self.info(f"info of environment {i}", mine, right, call):
                return False
        return True

    def info(self, name: str, got: Any, expected: dict[str, Any], call: str) -> bool:
        """Compare one dict."""
        if not isinstance(got, dict) or set(got) != set(expected):
            result = f"has the keys {sorted(got)}" if isinstance(got, dict) else "is no dict"
            result = "is None" if got is None else result
            return self.attempt.require(
                name,
                False,
                sentence=f"It {result}, and should have the keys {sorted(expected)}.",
                got=describe(got),
                expected=describe(expected),
                call=call,
            )
        for key, value in expected.items():
            if isinstance(value, dict):
                good = self.info(f"{name}, {key}", got[key], value, call)
            else:
                good = self.values(f"{name}, {key}", got[key], value, call)
            if not good:
                return False
        return True

    def actions(self, *steps: int) -> Any:
        """Return random actions, shape (*steps, n, 2)."""
        return self.attempt.rng.uniform(-1.0, 1.0, (*steps, self.num_envs, 2))


def _first_step(attempt: Attempt) -> None:
    """Check a reset and a step in which no episode ends."""
    pair = Pair(attempt, 3, 50, 50)
    while pair.reset(int(attempt.rng.integers(0, 10**6))):
        if min(info["length"] for info in pair.first_infos) > 1:
            pair.step(pair.actions())
            return


def _by_step(attempt: Attempt, num_envs: int = 0) -> None:
    rng = attempt.rng
    pair = Pair(attempt, num_envs or int(rng.integers(3, 6)), 5, 4)
    if not pair.reset(int(rng.integers(1, 10**6))):
        return
    for _ in range(STEPS):
        if not pair.step(pair.actions()):
            return
    pair.reset(None)


def _seed_zero(attempt: Attempt) -> None:
    """Check zero is a seed: the same episodes again."""
    pair = Pair(attempt, 3, 5, 4)
    if pair.reset(7) and pair.reset(0):
        pair.step(pair.actions())


def _results_are_copies(attempt: Attempt) -> None:
    """Check the rollout's results travel after its last step: an array that changed later shows."""
    pair = Pair(attempt, int(attempt.rng.integers(3, 6)), 4, 3)
    if not pair.reset(int(attempt.rng.integers(0, 10**6))):
        return
    actions = pair.actions(STEPS)
    got = attempt.learner.given("rollout", pair.envs, actions)
    expected = attempt.reference.given("rollout", pair.envs_here, actions)
    for step, (mine, right) in enumerate(zip(got, expected, strict=True), 1):
        call = f"step {step} of {STEPS}, looked at after the last one"
        if not pair.step_is_right(mine, right, call):
            return


def _refusals(attempt: Attempt) -> None:
    pair = Pair(attempt, 3, 5, 4)
    if not pair.reset(0):
        return
    count = attempt.rng.uniform(-1.0, 1.0, (4, 2))
    for actions, word in ((count, "too many"), (count[:2], "too few")):
        attempt.require_error(
            f"{word} actions",
            functools.partial(attempt.learner.method, pair.envs, "step", actions),
            sentence=f"{len(actions)} rows of actions for 3 environments are a mistake of the "
            "caller, which must not pass in silence.",
            call=f"step(actions) with {len(actions)} rows",
        )
    attempt.require_error(
        "no environment at all",
        lambda: attempt.learner.new(ENTRY, pair.factory, 0),
        sentence="num_envs must be at least 1.",
        call="VectorizedEnv(env_fn, 0)",
    )


def _closing(attempt: Attempt) -> None:
    pair = Pair(attempt, 3, 5, 4)
    attempt.learner.method(pair.envs, "close")
    closed = attempt.learner.given("closings", pair.factory)
    attempt.require(
        "every environment is closed",
        closed == [1, 1, 1],
        sentence="After close() each environment should have been closed once.",
        got=describe(closed),
        expected="[1, 1, 1]",
        call="close()",
    )


def _time(attempt: Attempt) -> None:
    """Check 100 steps of 16 environments, here and there."""
    actions = np.zeros((100, 16, 2))
    attempt.learner.child.given("drive", 16, actions)
    yours = attempt.learner.child.elapsed
    envs = attempt.reference.new(ENTRY, attempt.reference.given_new("factory", 5, 4), 16)
    attempt.reference.method(envs, "reset", 0)
    attempt.reference.given("rollout", envs, actions)
    attempt.cost(
        "100 steps of 16 environments", "s", yours=yours, reference=attempt.reference.elapsed
    )


def walked(attempt: Attempt) -> Plan:
    """Check walks of more and more environments."""
    from course.oracles.gymnasium import sync_vector_env, wrapped

    steps = 20
    walk: Any = attempt.reference.evaluate("given.Walk")

    def ask(place: Any, n: float) -> tuple[Any, float]:
        return [place.given("drive", int(n), np.zeros((steps, int(n), 2)))], steps * n

    def library(n: float) -> tuple[Any, float]:
        envs = sync_vector_env(wrapped(lambda: walk(5, 4), 3, 2), int(n), "SameStep")
        envs.reset(seed=0)
        actions = np.zeros((int(n), 2))
        return [np.mean([envs.step(actions)[1] for _ in range(steps)])], steps * n

    return Plan(
        settings=[4.0, 16.0, 64.0, 256.0],
        ask=ask,
        truth=[0.0],
        check=[0.0],
        libraries={"Gymnasium SyncVectorEnv": library},
    )


_OVER = """                first, reset_info = self._auto_reset(i)
                info = {**reset_info, "final_obs": observation, "final_info": info}
                observation = first
"""

SLIPS = slips(
    final_obs_lost=(
        _OVER,
        "                observation, info = self._auto_reset(i)\n",
        "The last observation of a finished episode is nowhere: the reset took its place. Where "
        "the clock ran out a learner needs it, to add the value of what would have come.",
    ),
    final_obs_overwritten=(
        _OVER,
        _OVER.replace('"final_obs": observation', '"final_obs": first'),
        "final_obs holds the first observation of the new episode. The environment writes all "
        "its observations into one array: copy the last one before the reset.",
    ),
    terminated_merged_with_truncated=(
        "            if terminated[i] or truncated[i]:\n",
        "            terminated[i] = truncated[i] = terminated[i] or truncated[i]\n"
        "            if terminated[i]:\n",
        "Terminated and truncated are one flag here. A learner then counts an episode that the "
        "clock cut off as one without a future, and values every state too low.",
    ),
    truncated_is_not_reset=(
        "if terminated[i] or truncated[i]:",
        "if terminated[i]:",
        "An environment whose clock ran out is not reset: its episode goes on beyond its end. It "
        "needs a reset as much as one that is terminated.",
    ),
    seed_zero_for_none=(
        "None if seed is None else seed + i",
        "seed + i if seed else None",
        "The seed 0 is taken for none: `if seed` is false for it. Ask `seed is None`.",
    ),
    reset_info_lost=(
        "{**reset_info, ",
        "{",
        "What the reset of a finished environment says in its info is lost. The info of that step "
        "is the reset's, with final_obs and final_info added.",
    ),
    final_info_lost=(
        ', "final_info": info}',
        "}",
        "The last info of a finished episode is lost: it belongs under final_info.",
    ),
    flags_swapped=(
        "rewards, terminated, truncated, infos\n",
        "rewards, truncated, terminated, infos\n",
        "Terminated and truncated come back in the wrong order. Terminated first: the task is "
        "over; truncated: the clock ran out.",
    ),
    whole_numbers=(
        "rewards = np.zeros(self.num_envs)",
        "rewards = np.zeros(self.num_envs, dtype=int)",
        "The rewards lose the digits behind the point: they are written into an array of integers. "
        "Let it be of floats.",
    ),
    reward_lost=(
        "                observation = first\n",
        "                observation = first\n                rewards[i] = 0.0\n",
        "The reward of an episode's last step is lost. Reset what belongs to the new episode only: "
        "the reward is that of the step just made.",
    ),
    seed_times_index=(
        "None if seed is None else seed + i",
        "None if seed is None else seed * i",
        "The seed is multiplied by the number of the environment, so the first always gets 0. "
        "Environment i gets seed + i.",
    ),
    rewards_of_all=(
        "rewards[i], terminated[i]",
        "rewards[:], terminated[i]",
        "Every environment's reward is written into all rows: the last one stays. Write row i.",
    ),
    first_action_for_all=(
        "env.step(actions[i])",
        "env.step(actions[0])",
        "All environments get the action of the first row. Environment i gets row i.",
    ),
    reset_twice=(
        "        observation, info = self.envs[i].reset()\n",
        "        self.envs[i].reset()\n        observation, info = self.envs[i].reset()\n",
        "A finished environment is reset twice: an episode is thrown away. Reset it once.",
    ),
    seed_shared_by_all=(
        "None if seed is None else seed + i",
        "seed",
        "All environments get the same seed, so they are copies of one another: n times the work "
        "for the experience of one. Environment i gets seed + i.",
    ),
    seeded_again_at_every_reset=(
        "        observations, infos = [], []\n        for i, env",
        "        self.seed = seed\n        observations, infos = [], []\n        for i, env",
        "self.envs[i].reset()",
        "self.envs[i].reset(seed=None if self.seed is None else self.seed + i)",
        "The reset within step seeds again, so each environment plays the same episode for ever. "
        "Seed it once; then it goes on with its generator.",
    ),
    reset_obs_not_returned=(
        "                observation = first\n",
        "",
        "A finished environment's row holds the last observation of the old episode, and its "
        "first one of the new episode is never seen. The next action would be chosen for a state "
        "that is gone.",
    ),
    buffer_reused_between_steps=(
        "        return np.stack(observations), rewards,",
        "        if not hasattr(self, 'buffer'):\n"
        "            self.buffer = np.stack(observations)\n"
        "        self.buffer[:] = observations\n"
        "        return self.buffer, rewards,",
        "The observations of every step are the same array, so those of earlier steps change "
        "while the caller keeps them. Return a new array each time.",
    ),
    one_environment_for_all=(
        "[env_fn() for _ in range(num_envs)]",
        "[env_fn()] * num_envs",
        "All rows are one environment: the factory was called once. It is then stepped n times "
        "in a step. Call env_fn once for each.",
    ),
    actions_not_counted=(
        "if len(actions) != self.num_envs:",
        "if self.num_envs < 0:",
        "enumerate(self.envs):\n            observation, rewards[i]",
        "enumerate(self.envs[: len(actions)]):\n            observation, rewards[i]",
        "A wrong number of actions goes unnoticed: with too many the rest is dropped, and with "
        "too few some environments are not stepped.",
    ),
)

EXERCISE = Exercise(
    judge=staged(
        Stage("simple", "a reset and a step", _first_step),
        Stage("core", "episodes that end", _by_step),
        Stage("core", "arrays that the caller keeps", _results_are_copies),
        Stage("core", "closing", _closing),
        Stage("edge", "one environment", functools.partial(_by_step, num_envs=1)),
        Stage("edge", "the seed 0", _seed_zero),
        Stage("edge", "wrong use", _refusals),
        timed=_time,
    ),
    chart=chart_of(
        "Mean reward of a random walk, 20 steps of n environments",
        walked,
        unit="environment steps",
        tolerance=0.1,
        error_unit="1",
        failed_above=10.0,
    ),
    given=Path(__file__).with_name("given.py").read_text(encoding="utf-8"),
    examples=(
        "VectorizedEnv(given.factory(5, 4), 2).reset(7)[0].shape",
        "VectorizedEnv(given.factory(5, 4), 3).reset(7)[1]",
    ),
    slips=SLIPS,
)
