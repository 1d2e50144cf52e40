"""PPO learns to push a point to a disc while you watch, one iteration per half second.

The policy trains as time passes, minibatch by minibatch, with the learner of `learner.py`. Every
policy is tested on the same starts: its mean actions, one episode each.
"""

import numba
import numpy as np
from numba.extending import register_jitable

from course.compiled import loop
from course.measure.success import wilson
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.learning import learner
from course.simulations.learning.learner import (
    ACTIONS,
    HIDDEN,
    HORIZON,
    INPUTS,
    ITERATIONS,
    LOG_STD,
    PARTS,
    POINTS,
)
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch
from course.vector_env.point import (
    BONUS,
    DISCOUNT,
    DT,
    MAX_STEPS,
    NEAR,
    RADIUS,
    move_points,
    optimum,
    start_points,
)

STARTS, FIRST, SHOWN = 64, 1000, 12  # episodes that judge, seed of the first, those drawn
PICTURE, PAUSE = 0.5, 2.0  # s
REWARDS = ("sparse", "distance", "potential", "hover")
SPARSE, DISTANCE, POTENTIAL, HOVER = range(4)
NO_TRACE, SHORT_DISCOUNT, UNSCALED = 1, 2, 3  # what is broken
# What is reported of each policy: success rate and its interval, the same rate estimated from
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
    **learner.FIELDS,
    # A row of each policy: the first one is untrained, the next ones follow an iteration each.
    report=Field(0.0, shape=(ITERATIONS + 1, 8)),
    paths=Field(0.0, shape=(ITERATIONS + 1, SHOWN, 2, MAX_STEPS + 1), unit="m"),
    steps=Field(0, shape=(ITERATIONS + 1, SHOWN)),
    arrived=Field(0, shape=(ITERATIONS + 1, SHOWN)),
    trained=Field(0),  # iterations
    part=Field(0),  # what is done of the present one
    owed=Field(0.0),  # parts that are due
    time=Field(0.0, unit="s"),
)

# --- the test -------------------------------------------------------------------------------------

# The four draws of each start, those of a `PointReachVector` that is reset with seed FIRST.
DRAWS = np.array([np.random.default_rng(FIRST + i).random(4) for i in range(STARTS)])
# Wilson's interval of each count of successes.
_BANDS = np.array([wilson(good, STARTS) for good in range(STARTS + 1)])


def _numbers(reward):
    """Return the task's numbers, as `move_points` takes them."""
    return np.array([DT, RADIUS, 1.0 * MAX_STEPS, 1.0 * reward, 1.0, BONUS, 1.0, 0.0])


def starts(reward):
    """Return the observations from which every policy is tested, (STARTS, 4)."""
    state = np.zeros((3, 2, STARTS))
    clock = np.zeros(STARTS, dtype=np.int64)
    return start_points(DRAWS, np.arange(STARTS), *state, clock, _numbers(reward))


# What the prize is worth at best, and the largest return; unknown for the distance as a reward.
PRIZES = np.array([optimum(starts(kind)).mean() for kind in range(4)])
BEST = np.array(
    [0.0 if k == DISTANCE else optimum(starts(k), kind).mean() for k, kind in enumerate(REWARDS)]
)
numbers_of = register_jitable(_numbers)


@register_jitable
def _actions(state, observed, out):
    """Write the mean actions of the present policy."""
    row, first, second = np.empty(INPUTS), np.empty(HIDDEN), np.empty(HIDDEN)
    for i in range(len(observed)):
        learner.normalise(state, observed[i], row)
        learner.forward(state["weights"], 0, row, first, second, out[i])


@register_jitable
def test_policy(state, reward, first):
    """Play one episode of each start, and report on the present policy.

    Environments restart by themselves if the first to finish are counted too; a step that resets
    counts for nothing.
    """
    now, numbers = int(state["trained"]), numbers_of(reward)
    p, v, goal = np.zeros((2, STARTS)), np.zeros((2, STARTS)), np.zeros((2, STARTS))
    clock, actions = np.zeros(STARTS, np.int64), np.empty((STARTS, ACTIONS))
    observed = learner.place(DRAWS, np.arange(STARTS), p, v, goal, clock, numbers)
    worth, over = np.zeros(STARTS), np.zeros(STARTS, np.bool_)
    lengths, success = np.zeros(STARTS, np.int64), np.zeros(STARTS, np.bool_)
    again, one, draws = np.array([np.uint64(FIRST)]), np.empty(1, np.int64), np.empty(4)
    finished = arrived = running = 0
    factor, paths = 1.0, state["paths"][now]
    # Every episode ends by the clock, so that this many steps are enough for all.
    for t in range(MAX_STEPS):
        for i in range(SHOWN):
            if lengths[i] == 0:
                paths[i, 0, t], paths[i, 1, t] = -observed[i, 0], -observed[i, 1]
        _actions(state, observed, actions)
        observed, rewards, ended, late = move_points(p, v, goal, clock, actions, numbers)
        running = 0
        for i in range(STARTS):
            if over[i]:
                # Its episode is over: this step only resets it.
                if first:
                    one[0] = i
                    splitmix.uniform(again, draws)
                    observed[i] = learner.place(
                        draws.reshape(1, 4), one, p, v, goal, clock, numbers
                    )[0]
                    over[i] = False
                continue
            if lengths[i] == 0:
                worth[i] += factor * rewards[i]
                running += 1
            over[i] = ended[i] or late[i]
            if over[i]:
                if finished < STARTS:
                    finished += 1
                    arrived += 1 if ended[i] else 0
                if lengths[i] == 0:
                    lengths[i], success[i] = t + 1, ended[i]
                    if i < SHOWN:
                        # From its end on the path stays at its last point.
                        paths[i, 0, t + 1 :] = -observed[i, 0]
                        paths[i, 1, t + 1 :] = -observed[i, 1]
        factor *= DISCOUNT
        if running == 0:
            break
    good, share, total = 0, 0.0, 0.0
    for i in range(STARTS):
        total += worth[i] / STARTS
        if success[i]:
            good += 1
            # Discounted success over the best possible: early arrivals are worth more.
            share += DISCOUNT ** (lengths[i] - 1.0) / (STARTS * PRIZES[reward])
    report = state["report"][now]
    report[SUCCESS], report[LOW], report[HIGH] = good / STARTS, _BANDS[good, 0], _BANDS[good, 1]
    # Counting the first episodes to finish favours short ones, which mostly succeed: a biased
    # estimate next to one episode for each start.
    report[READ] = arrived / STARTS if first else 0.0
    report[RETURN], report[SHARE] = total, share
    report[MOVED] = state["kl"]
    for j in range(ACTIONS):
        report[SPREAD] += learner.exp(state["weights"][LOG_STD + j]) / ACTIONS
    state["steps"][now], state["arrived"][now] = lengths[:SHOWN], success[:SHOWN]


# --- training -------------------------------------------------------------------------------------


@register_jitable
def parts_of(controls):
    """Return the parts of an iteration: the batch, each minibatch, the test."""
    return 2 + controls["epochs"] * PARTS


def _start(state, controls):
    """Make the first policy and test it."""
    learner.begin(state, controls["seed"], numbers_of(controls["reward"]))
    test_policy(state, controls["reward"], controls["first"])


def _train(state, controls, parts):
    """Train for a number of parts of an iteration, at most to the end."""
    broken, minibatches = controls["left_out"], parts_of(controls) - 2
    for _ in range(parts):
        if state["trained"] == ITERATIONS:
            return
        part = state["part"]
        state["part"] += 1
        if part == 0:
            discount = 0.9 if broken == SHORT_DISCOUNT else learner.GAMMA
            trace = 0.0 if broken == NO_TRACE else learner.TRACE
            numbers = numbers_of(controls["reward"])
            learner.collect(state, numbers, discount, trace, broken != UNSCALED)
        elif part <= minibatches:
            if (part - 1) % PARTS == 0:
                learner.shuffle(state)
            # The step size falls to 0 along a straight line.
            rate = 1e-3 * controls["rate"] * (1.0 - state["trained"] / ITERATIONS)
            learner.step(state, (part - 1) % PARTS, rate)
        else:
            learner.finish(state)
        if state["diverged"] > 0:
            # The last good policy stays.
            now = int(state["trained"])
            for k in range(now + 1, ITERATIONS + 1):
                state["report"][k], state["paths"][k] = state["report"][now], state["paths"][now]
                state["steps"][k], state["arrived"][k] = state["steps"][now], state["arrived"][now]
            state["trained"] = ITERATIONS
        elif part > minibatches:
            state["trained"] += 1
            state["part"] = 0
            test_policy(state, controls["reward"], controls["first"])


_STATE, _CONTROLS = numba.from_dtype(STATE.dtype), numba.from_dtype(CONTROLS.dtype)
start = loop(_start, numba.void(_STATE, _CONTROLS))
train = loop(_train, numba.void(_STATE, _CONTROLS, numba.int64))


def warm() -> None:
    """Compile, or load from the cache, what the model calls from Python."""
    state, controls = STATE.new(), CONTROLS.new()
    start(state, controls)
    train(state, controls, 0)


def initial(controls, state):
    """Begin with a policy that has learned nothing."""
    start(state, controls)


def advance(state, controls, seconds):
    """Advance the simulation: an iteration is trained in the time of one picture.

    The policies are shown again and again.
    """
    state["owed"] += seconds / PICTURE * parts_of(controls)
    due = int(state["owed"])
    state["owed"] -= due
    train(state, controls, due)
    state["time"] = (state["time"] + seconds) % ((ITERATIONS + 1) * PICTURE + PAUSE)


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
_TRAINING, _TRAINED, _STOPPED = word("training", "trained", "diverged")
_BAND, _TO, _CLOSE, _PERCENT, _NOT, _NONE, _NUMBER = word(
    " % (", "-", ")", " %", "not counted", "not known", "iteration "
)
_SCENE = (0.1, 4.4, 0.35, 4.65)
_PROGRESS = (0.1, 3.5, 0.1, 0.2)
_UPPER, _LOWER = (5.35, 8.85, 3.05, 4.6), (5.35, 8.85, 0.55, 2.1)


def frame(pen, state, controls):
    """Draw the paths of this iteration's policy, and the curves of all iterations up to it."""
    # A policy is shown once it is trained.
    report, trained = state["report"], int(state["trained"])
    now = min(int(state["time"] / PICTURE + 1e-9), trained)
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
    draw.number(pen, now, 0)
    at, rows = np.arange(0.0, now + 1.0), report[: now + 1]
    # Success rates with Wilson's interval (1927) as pale bars, up to the present iteration.
    draw.chart(pen, _UPPER, (0.0, 1.0 * ITERATIONS, 0.0, 100.0), 0, _PERCENT_OF, 0, 6, 5)
    for k in range(now + 1):
        draw.segment(
            pen,
            1.0 * k,
            100.0 * report[k, LOW],
            1.0 * k,
            100.0 * report[k, HIGH],
            draw.BLUE,
            4.0,
            0.3,
        )
    draw.curve(pen, at, 100.0 * rows[:, SUCCESS], draw.BLUE, 2.2)
    if controls["first"]:
        draw.curve(pen, at, 100.0 * rows[:, READ], draw.ORANGE, 2.0, 1.0, 5.0, 3.0)
    # The axes hold all policies that are trained so far.
    best, returns = BEST[controls["reward"]], report[: trained + 1, RETURN]
    low = min(0.0, 1.1 * np.min(returns))
    high = max(max(best, np.max(returns)), 0.0) - 0.1 * low
    draw.chart(pen, _LOWER, (0.0, 1.0 * ITERATIONS, low, 1.15 * high), _ITERATION, _RETURN, 0, 6, 4)
    if controls["reward"] != DISTANCE:
        draw.segment(pen, 0.0, best, 1.0 * ITERATIONS, best, draw.GREEN, 2.0, 1.0, 5.0, 3.0)
    draw.curve(pen, at, rows[:, RETURN], draw.BLUE, 2.2)
    draw.window(pen)
    # How much of the training is done.
    left, right, bottom, top = _PROGRESS
    done = min((trained + state["part"] / parts_of(controls)) / ITERATIONS, 1.0)
    draw.box(pen, left, right, bottom, top, _SAND, draw.GREY)
    draw.box(pen, left, left + done * (right - left), bottom, top, draw.BLUE)
    ended = _STOPPED if state["diverged"] > 0 else _TRAINED
    draw.text(
        pen, right + 0.1, 0.5 * (bottom + top), _TRAINING if done < 1.0 else ended, draw.INK, 11.0
    )
    draw.key(pen, 5.35, 4.82, _TRUE, draw.BLUE, 2.2)
    if controls["first"]:
        draw.key(pen, 7.2, 4.82, _FIRST, draw.ORANGE, 2.0, 1.0, 5.0, 3.0)
    if controls["reward"] != DISTANCE:
        draw.key(pen, 5.35, 2.32, _OPTIMUM, draw.GREEN, 2.0, 1.0, 5.0, 3.0)
    draw.reading(pen, _STEPS, 1.0 * now * POINTS * HORIZON, 0)
    draw.reading(pen, _GOOD, 100.0 * report[now, SUCCESS], 0)
    draw.words(pen, _BAND)
    draw.number(pen, 100.0 * report[now, LOW], 0, _TO)
    draw.number(pen, 100.0 * report[now, HIGH], 0, _CLOSE)
    draw.reading(
        pen, _READ, 100.0 * report[now, READ], 0, _PERCENT, 0 if controls["first"] else _NOT
    )
    draw.reading(pen, _WORTH, report[now, RETURN], 2)
    draw.reading(pen, _BEST, best, 2, 0, _NONE if controls["reward"] == DISTANCE else 0)
    draw.reading(pen, _KL, report[now, MOVED], 3)
    draw.reading(pen, _STD, report[now, SPREAD], 2)


def drag(controls, state, x, y):
    """Handle a drag: the pointer selects the iteration on either chart.

    Its paths are shown to their ends.
    """
    # The end of the iteration's time, when its paths are complete.
    now = (x - _UPPER[0]) / (_UPPER[1] - _UPPER[0]) * ITERATIONS
    state["time"] = (min(max(round(now), 0.0), 1.0 * state["trained"]) + 0.9) * PICTURE


# The presets' texts are about the ten seeds of the slider: tests/learning/presets.py.
PRESETS = {
    "Potential": Preset(
        {},
        "Every step that comes closer is paid, by a potential that does not change which policy is "
        "best. The first policy pushes at random. After about fifty thousand environment steps "
        "more than nine starts in ten arrive, in the median of ten seeds; some seeds need longer. "
        "The policy trains while you watch; the bar shows how much is done. Select a point of "
        "either chart to see that iteration.",
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
        "starts in ten to the disc, this reward has brought fewer than one in ten, in the median "
        "of ten seeds.",
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
        "fifth of the divergence of ten epochs. After the same number of steps none of ten seeds "
        "brings a third of the starts to the disc.",
    ),
    "Discount 0.9": Preset(
        {"left_out": 2},
        "This discount counts about ten steps ahead, and reaching the disc takes twenty or more. "
        "The potential is still paid with 0.99. "
        "In the median of ten seeds it learns faster at first: after a third of the iterations "
        "more than a third of the starts arrive, against less than a fifth with a discount of "
        "0.99. At the end about one start in ten still fails.",
    ),
    "No reward scaling": Preset(
        {"left_out": 3},
        "The potential changes by a few hundredths per step. From such small rewards six of ten "
        "seeds learn hardly anything, and two learn the whole task (try seed 1). A single seed "
        "says little about a method.",
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
