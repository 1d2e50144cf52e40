"""PPO learns to push a point to a disc while you watch, one iteration per frame.

A change of a control computes all iterations, which takes about a second, and then plays them.
Every policy is tested on the same starts: its mean actions, one episode each.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numba import objmode
from numba.extending import register_jitable

from course.learning import Diverged, Settings, evaluate, first_finished, one_thread, ppo
from course.measure.success import wilson
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch
from course.vector_env import PointReachVector
from course.vector_env.point import DISCOUNT, MAX_STEPS, NEAR, RADIUS, optimum

ITERATIONS, POINTS = 24, 32  # of a run; that learn side by side
HORIZON, PARTS = 64, 4  # steps of each point in an iteration; minibatches
STARTS, FIRST, SHOWN = 64, 1000, 12  # episodes that judge, seed of the first, those drawn
PICTURE, PAUSE = 0.5, 2.0  # s
REWARDS = ("sparse", "distance", "potential", "hover")
SPARSE, DISTANCE, POTENTIAL, HOVER = range(4)
LEFT_OUT: tuple[dict[str, Any], ...] = (
    {},
    {"trace": 0.0},
    {"discount": 0.9},
    {"scale_rewards": False},
)
# What is reported of each iteration: success rate and its interval, the same rate estimated from
# the first episodes to finish, mean return, share of the largest possible prize, divergence from
# the previous policy, and standard deviation of the actions.
SUCCESS, LOW, HIGH, READ, RETURN, SHARE, MOVED, SPREAD = range(8)

CONTROLS = Record(
    rate=slider("Step size [1e-3]", 5.0, 0.5, 20.0, 0.5, "", 1),
    epochs=slider("Epochs per batch", 10, 1, 15, 1),
    seed=slider("Random seed", 0, 0, 9, 1),
    reward=menu(
        "Reward",
        (
            "only for reaching the disc",
            "minus the distance",
            "difference of a potential",
            "a bonus for each step nearby",
        ),
        POTENTIAL,
    ),
    left_out=menu("What is broken", ("nothing", "lambda 0", "discount 0.9", "no reward scaling")),
    first=switch("Also count the first to finish", False),
)
STATE = Record(
    report=Field(0.0, shape=(ITERATIONS, 8)),
    best=Field(0.0),
    time=Field(0.0, unit="s"),
    paths=Field(0.0, shape=(ITERATIONS, SHOWN, 2, MAX_STEPS + 1), unit="m"),
    steps=Field(0, shape=(ITERATIONS, SHOWN)),
    arrived=Field(0, shape=(ITERATIONS, SHOWN)),
)


def judged(policy, envs):
    """Return one episode per environment and the paths in the goal's frame, (2, n, steps + 1)."""
    observed = []

    # The policy is observed while it acts, so that paths need no second run.
    def act(observations):
        observed.append(observations[:, :2].copy())
        return policy(observations)

    played = evaluate(act, envs, FIRST, discount=DISCOUNT)
    last = envs.task.goal - envs.task.p  # of those whose episode ended with the last step of all
    # Observations hold the vector to the goal; its negative is the position seen from the goal.
    rows = -np.stack([*observed, last.T], axis=-1).transpose(1, 0, 2)
    paths = np.empty((2, envs.num_envs, MAX_STEPS + 1))
    # Vectorised episodes end at different steps: from there the path stays at its last point.
    for i, n in enumerate(played.steps):
        paths[:, i, : n + 1], paths[:, i, n + 1 :] = rows[:, i, : n + 1], rows[:, i, n, None]
    return played, paths


@lru_cache(maxsize=128)
def learned(rate, epochs, seed, reward, left_out, first):
    """Return the reports of all iterations, the best return, and the paths that are shown."""
    settings = Settings(
        horizon=HORIZON,
        minibatches=PARTS,
        hidden=(16, 16),
        rate=1e-3 * rate,
        epochs=epochs,
        **LEFT_OUT[left_out],
    )
    kind = REWARDS[reward]
    # Training resets finished environments within the step; the test plays each start once.
    envs = PointReachVector(POINTS, kind, autoreset_mode="SameStep")
    test = PointReachVector(STARTS, kind)
    starts, _ = test.reset(seed=FIRST)
    # The exact optimum from the same starts; for the plain distance as a reward it is not known.
    prize = optimum(starts).mean()
    best = 0.0 if reward == DISTANCE else optimum(starts, kind).mean()
    report, paths = np.zeros((ITERATIONS, 8)), np.zeros((ITERATIONS, SHOWN, 2, MAX_STEPS + 1))
    steps, arrived = np.zeros((2, ITERATIONS, SHOWN), dtype=np.int64)
    k = -1
    # One thread of the linear algebra, for the same sums on every run.
    with one_thread():
        try:
            for k, now in enumerate(
                ppo(envs, settings, steps=ITERATIONS * POINTS * HORIZON, seed=seed)
            ):
                played, routes = judged(now.policy, test)
                good = int(played.success.sum())
                # Counting the first episodes to finish favours short ones, which mostly succeed: a
                # biased estimate next to one episode for each start.
                read = (
                    first_finished(now.policy, test, STARTS, FIRST).success.mean() if first else 0.0
                )
                # Discounted success over the best possible: early arrivals are worth more.
                worth = np.where(played.success, DISCOUNT ** (played.steps - 1.0), 0.0).mean()
                report[k] = (
                    good / STARTS,
                    *wilson(good, STARTS),
                    read,
                    played.returns.mean(),
                    worth / prize,
                    now.kl,
                    now.spread,
                )
                paths[k] = routes[:, :SHOWN].transpose(1, 0, 2)
                steps[k], arrived[k] = played.steps[:SHOWN], played.success[:SHOWN]
        except Diverged:  # the last good one stays
            for each in (report, paths, steps, arrived):
                each[k + 1 :] = each[k]
    return report, best, paths, steps, arrived


@register_jitable
def initial(controls, state):
    """Learn."""
    # Training is Python with matrices; compiled code gets its results from object mode.
    c = controls
    values = np.array(
        [
            c["rate"],
            1.0 * c["epochs"],
            1.0 * c["seed"],
            1.0 * c["reward"],
            1.0 * c["left_out"],
            1.0 * c["first"],
        ]
    )
    with objmode(
        report="float64[:,:]",
        best="float64",
        paths="float64[:,:,:,:]",
        steps="int64[:,:]",
        arrived="int64[:,:]",
    ):
        report, best, paths, steps, arrived = learned(float(values[0]), *map(int, values[1:]))
    state["report"][:], state["best"], state["paths"][:] = report, best, paths
    state["steps"][:], state["arrived"][:] = steps, arrived


def advance(state, controls, seconds):
    """Advance the simulation: the run is shown again and again."""
    state["time"] = (state["time"] + seconds) % (ITERATIONS * PICTURE + PAUSE)


TITLE = "A point learns to reach a disc"
word, colour = draw.words_table(), draw.colours_table()
_SAND = colour("#f7f5ef")[0]
_WAYS, _ITERATION, _PERCENT_OF, _RETURN, _OPTIMUM, _TRUE, _FIRST = word(
    "test runs, seen from the goal",
    "iteration",
    "success rate [%]",
    "return",
    "exact optimum",
    "one per start",
    "first to finish",
)
_STEPS, _GOOD, _READ, _WORTH, _BEST, _KL, _STD = word(
    "environment steps",
    "success",
    "first to finish",
    "return",
    "optimum",
    "divergence",
    "action spread",
)
_BAND, _TO, _CLOSE, _PERCENT, _NOT, _NONE, _NUMBER = word(
    " % (", "-", ")", " %", "not counted", "not known", "iteration "
)
_SCENE = (0.1, 4.4, 0.35, 4.65)
_UPPER, _LOWER = (5.35, 8.85, 3.05, 4.6), (5.35, 8.85, 0.55, 2.1)


def frame(pen, state, controls):
    """Draw the paths of this iteration's policy, and the curves of all iterations up to it."""
    report, now = state["report"], int(min(state["time"] / PICTURE + 1e-9, ITERATIONS - 1.0))
    # The paths are drawn within 5/7 of a picture's time, and stand for the rest.
    phase = min(1.4 * max(state["time"] / PICTURE - now, 0.0), 1.0)
    reach = 1.2 * NEAR if controls["reward"] == HOVER else 2.1
    draw.area(pen, _SCENE, (-reach, reach, -reach, reach))
    draw.box(pen, -reach, reach, -reach, reach, _SAND, draw.GREY)
    draw.title(pen, -reach, reach, _WAYS)
    if controls["reward"] == HOVER:
        draw.spot(pen, 0.0, 0.0, NEAR, draw.NONE, draw.GREY, 1.2)
    draw.spot(pen, 0.0, 0.0, RADIUS, draw.GREEN, draw.INK, 1.0, 0.8)
    for i in range(SHOWN):
        x, y = state["paths"][now, i, 0], state["paths"][now, i, 1]
        count = int(phase * state["steps"][now, i]) + 1
        ink = draw.BLUE if state["arrived"][now, i] else draw.ORANGE
        draw.curve(pen, x[:count], y[:count], ink, 1.6, 0.8)
        draw.spot(pen, x[0], y[0], 0.008 * reach, draw.GREY)
        draw.spot(pen, x[count - 1], y[count - 1], 0.01 * reach, ink)
    draw.text(pen, -0.96 * reach, -0.94 * reach, _NUMBER, draw.INK, 13.0)
    draw.number(pen, now + 1.0, 0)
    at, rows = np.arange(1.0, now + 2.0), report[: now + 1]
    # Success rates with Wilson's interval (1927) as pale bars, up to the present iteration.
    draw.chart(pen, _UPPER, (0.0, 1.0 * ITERATIONS, 0.0, 100.0), 0, _PERCENT_OF, 0, 6, 5)
    for k in range(now + 1):
        draw.segment(
            pen,
            k + 1.0,
            100.0 * report[k, LOW],
            k + 1.0,
            100.0 * report[k, HIGH],
            draw.BLUE,
            4.0,
            0.3,
        )
    draw.curve(pen, at, 100.0 * rows[:, SUCCESS], draw.BLUE, 2.2)
    if controls["first"]:
        draw.curve(pen, at, 100.0 * rows[:, READ], draw.ORANGE, 2.0, 1.0, 5.0, 3.0)
    # The axes hold all iterations from the start on, so that they stay still during playback.
    low = min(0.0, 1.1 * np.min(report[:, RETURN]))
    high = max(max(state["best"], np.max(report[:, RETURN])), 0.0) - 0.1 * low
    draw.chart(pen, _LOWER, (0.0, 1.0 * ITERATIONS, low, 1.15 * high), _ITERATION, _RETURN, 0, 6, 4)
    if controls["reward"] != DISTANCE:
        draw.segment(
            pen, 0.0, state["best"], 1.0 * ITERATIONS, state["best"], draw.GREEN, 2.0, 1.0, 5.0, 3.0
        )
    draw.curve(pen, at, rows[:, RETURN], draw.BLUE, 2.2)
    draw.window(pen)
    draw.key(pen, 5.35, 4.82, _TRUE, draw.BLUE, 2.2)
    if controls["first"]:
        draw.key(pen, 7.2, 4.82, _FIRST, draw.ORANGE, 2.0, 1.0, 5.0, 3.0)
    if controls["reward"] != DISTANCE:
        draw.key(pen, 5.35, 2.32, _OPTIMUM, draw.GREEN, 2.0, 1.0, 5.0, 3.0)
    draw.reading(pen, _STEPS, (now + 1.0) * POINTS * HORIZON, 0)
    draw.reading(pen, _GOOD, 100.0 * report[now, SUCCESS], 0)
    draw.words(pen, _BAND)
    draw.number(pen, 100.0 * report[now, LOW], 0, _TO)
    draw.number(pen, 100.0 * report[now, HIGH], 0, _CLOSE)
    draw.reading(
        pen, _READ, 100.0 * report[now, READ], 0, _PERCENT, 0 if controls["first"] else _NOT
    )
    draw.reading(pen, _WORTH, report[now, RETURN], 2)
    draw.reading(pen, _BEST, state["best"], 2, 0, _NONE if controls["reward"] == DISTANCE else 0)
    draw.reading(pen, _KL, report[now, MOVED], 3)
    draw.reading(pen, _STD, report[now, SPREAD], 2)


def drag(controls, state, x, y):
    """Handle a drag: the pointer selects the iteration on either chart.

    Its paths are shown to their ends.
    """
    # The end of the iteration's time, when its paths are complete.
    now = (x - _UPPER[0]) / (_UPPER[1] - _UPPER[0]) * ITERATIONS - 1.0
    state["time"] = (min(max(round(now), 0.0), ITERATIONS - 1.0) + 0.9) * PICTURE


# The presets' texts are about the median of ten seeds: tests/learning/presets.py.
PRESETS = {
    "Potential": Preset(
        {},
        "Every step that comes closer is paid, by a potential that does not change which policy is "
        "best. The first policy pushes at random. After about fifty thousand environment steps "
        "more than nine starts in ten arrive, in the median of ten seeds; some seeds need longer. "
        "Select a point of either chart to see that iteration.",
        "Every step that comes closer is paid, by a potential that does not change which policy is "
        "best. The first policy pushes at random. After about fifty thousand environment steps "
        "more than nine starts in ten arrive, in the median of ten seeds; some seeds need longer.",
    ),
    "Only the disc": Preset(
        {"reward": SPARSE},
        "A prize for arriving, and nothing else. Random pushes find the disc in a few of a hundred "
        "episodes, so there is hardly anything to learn from. After the same number of steps no "
        "seed brings a third of the starts to the disc.",
    ),
    "Minus the distance": Preset(
        {"reward": DISTANCE},
        "Each step costs the distance, so being near the goal early pays as well as arriving. The "
        "rewards are rescaled, as in every preset but one. When the potential has brought nine "
        "starts in ten to the disc, this reward has brought about one in ten, in the median of "
        "ten seeds.",
    ),
    "Lambda 0": Preset(
        {"left_out": 1},
        "The advantage of an action is computed from the next reward and the critic's value one "
        "step later, and the critic knows nothing yet. None of ten seeds learns anything. A larger "
        "lambda also counts rewards further ahead.",
    ),
    "One epoch": Preset(
        {"epochs": 1},
        "Each batch is used once and thrown away. An iteration then moves the policy by about a "
        "quarter of the divergence of ten epochs, and none of ten seeds brings half of the starts "
        "to the disc.",
    ),
    "Discount 0.9": Preset(
        {"left_out": 2},
        "This discount counts about ten steps ahead, and reaching the disc takes twenty or more. "
        "In the median of ten seeds it learns faster at first: after a third of the iterations "
        "most starts arrive, against one in ten with a discount of 0.99. At the end about one "
        "start in ten still fails.",
    ),
    "No reward scaling": Preset(
        {"left_out": 3},
        "The potential changes by a few hundredths per step. From such small rewards most of ten "
        "seeds learn nothing, and one or two learn the whole task (try seed 1). A single seed says "
        "little about a method.",
        "The potential changes by a few hundredths per step. From such small rewards most of ten "
        "seeds learn nothing, and one or two learn the whole task. A single seed says little about "
        "a method.",
    ),
    "Hovering": Preset(
        {"reward": HOVER},
        "Every step inside the circle pays a bonus of 0.02, which is worth more in the long run "
        "than the prize that ends the episode. The return rises in every seed as it should, and "
        "most starts never reach the disc. The reward is wrong, not the learner.",
    ),
    "First to finish": Preset(
        {"first": True, "seed": 2},
        "64 environments restart by themselves. The first 64 episodes to finish are mostly "
        "successes, because a failure takes a hundred steps. The orange curve counts these "
        "episodes, the blue curve one episode of each start, for the same policies. In most seeds "
        "the orange curve is at times a tenth too high.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "environment steps": "Environment steps used for training so far.",
    "success": "Evaluation episodes that reach the disc, with a 95 % confidence interval.",
    "first to finish": (
        "Success rate counted over the first 64 episodes to finish. It is biased: failures take "
        "longer."
    ),
    "return": "Mean return of the evaluation episodes.",
    "optimum": "Return of the best possible policy for this reward.",
    "divergence": "Mean KL divergence between the policy before and after this iteration.",
    "action spread": "Standard deviation of the policy's actions: how much it explores.",
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour, room=30_000),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
