"""PPO of `course.learning.ppo` for one task, in the subset of Python that Numba compiles.

The page trains with it, one minibatch after another, while the picture moves. The method and its
settings are those of the chapter; the networks are loops in float64 instead of PyTorch's float32.
Training amplifies a rounding error until another policy comes out. So everything that a weight
depends on is made of sums, products, quotients and square roots, which every machine rounds alike:
`exp` below takes the place of the C library's, and what comes from its logarithm and cosine is
rounded to multiples of 2^-20. A seed then gives the same run in a notebook and in any browser.

The state is a record with the fields of `FIELDS`. Weights have the order of
`course.learning.network.flatten`: actor, critic, logarithm of the actions' deviations.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.learning.ppo import RUNAWAY, Settings, clipped_objective
from course.simulations import splitmix
from course.simulations.record import Field
from course.vector_env.point import move_points, start_points

ITERATIONS, POINTS = 24, 32  # of a run; that learn side by side
HORIZON, PARTS = 64, 4  # steps of each point in an iteration; minibatches
INPUTS, ACTIONS, HIDDEN = 4, 2, 16
ROWS = HORIZON * POINTS
SIZE = ROWS // PARTS
_USUAL = Settings()
CLIP, VALUE_WEIGHT, LONGEST = _USUAL.clip, _USUAL.value_weight, _USUAL.longest_gradient
GAMMA, TRACE = _USUAL.discount, _USUAL.trace
_BELOW = HIDDEN * (INPUTS + 1) + HIDDEN * (HIDDEN + 1)  # weights below the last layer
CRITIC = _BELOW + ACTIONS * (HIDDEN + 1)  # where the critic's weights begin
LOG_STD = CRITIC + _BELOW + HIDDEN + 1
WEIGHTS = LOG_STD + ACTIONS
_LIMIT, _SMALL = 10.0, 1e-8  # of normalised numbers; added to a variance
_MOMENTS, _ADAM_SMALL = (0.9, 0.999), 1e-5  # of Adam

FIELDS = {
    "random": Field(np.uint64(0), shape=(1,)),
    "weights": Field(0.0, shape=(WEIGHTS,)),
    "good": Field(0.0, shape=(WEIGHTS,)),  # as they were when the iteration began
    "moments": Field(0.0, shape=(2, WEIGHTS)),  # Adam's means of gradient and of its square
    "decays": Field((1.0, 1.0)),  # their factors, to the power of the steps so far
    # Running statistics: mean and variance of each observation, then of the discounted rewards.
    "mean": Field(0.0, shape=(INPUTS + 1,)),
    "variance": Field((1.0,) * (INPUTS + 1)),
    "counted": Field((0.0, 0.0)),  # rows of observations, and of rewards
    "p": Field(0.0, shape=(2, POINTS), unit="m"),
    "v": Field(0.0, shape=(2, POINTS), unit="m/s"),
    "goal": Field(0.0, shape=(2, POINTS), unit="m"),
    "clock": Field(0, shape=(POINTS,)),  # steps of the running episodes
    "observed": Field(0.0, shape=(POINTS, INPUTS)),
    "worth": Field(0.0, shape=(POINTS,)),  # discounted rewards of the running episodes
    # The batch: observations as they came and normalised, actions, and what is learned from.
    "raw": Field(0.0, shape=(ROWS, INPUTS)),
    "rows": Field(0.0, shape=(ROWS, INPUTS)),
    "actions": Field(0.0, shape=(ROWS, ACTIONS)),
    "means": Field(0.0, shape=(ROWS, ACTIONS)),
    "log_prob": Field(0.0, shape=(ROWS,)),
    "advantages": Field(0.0, shape=(ROWS,)),
    "targets": Field(0.0, shape=(ROWS,)),
    "order": Field(0, shape=(ROWS,)),
    "kl": Field(0.0),
    "diverged": Field(0),
}

# --- numbers that every machine rounds alike ------------------------------------------------------

LARGEST_EXPONENT = 88.0  # above it a number of float32 is infinite
_POWERS = 2.0 ** np.arange(-130, 131)
_LOG2E, _LN2 = 1.4426950408889634, (0.6931471803691238, 1.9082149292705877e-10)
_TAYLOR = 1.0 / np.array([math.factorial(k) for k in range(10)], dtype=float)


@register_jitable
def exp(x):
    """Return the exponential to 1e-11, infinite above 88 and as of -88 below it."""
    if not x <= LARGEST_EXPONENT:
        return math.inf
    x = max(x, -LARGEST_EXPONENT)
    # x = k ln 2 + r with |r| below 0.35: a Taylor polynomial, times a power of two.
    k = math.floor(x * _LOG2E + 0.5)
    r = (x - k * _LN2[0]) - k * _LN2[1]
    value = _TAYLOR[9]
    for n in range(8, -1, -1):
        value = value * r + _TAYLOR[n]
    return value * _POWERS[int(k) + 130]


@register_jitable
def tanh(x):
    """Return the hyperbolic tangent to 1e-11."""
    return 1.0 - 2.0 / (exp(min(max(2.0 * x, -40.0), 40.0)) + 1.0)


@register_jitable
def round_off(values):
    """Round an array (N,) to multiples of 2^-20: libraries differ in digits far behind these."""
    for k in range(values.size):
        values[k] = math.floor(values[k] * 1048576.0 + 0.5) / 1048576.0


@register_jitable
def normal(random, count):
    """Return standard normal numbers (count,)."""
    out = np.empty(count)
    splitmix.normal(random, out)
    round_off(out)
    return out


@register_jitable
def place(draws, ids, p, v, goal, steps, numbers):
    """Put the points `ids` at rest, as `start_points`; return their observations (ids, 4)."""
    observed = start_points(draws, ids, p, v, goal, steps, numbers)
    for k in range(ids.size):
        i = ids[k]
        # A goal on a ring comes from sine and cosine.
        for j in range(2):
            goal[j, i] = math.floor(goal[j, i] * 1048576.0 + 0.5) / 1048576.0
            observed[k, j] = goal[j, i] - p[j, i]
    return observed


# --- networks -------------------------------------------------------------------------------------


@register_jitable
def _orthogonal(random, rows, columns, gain, out):
    """Write a random matrix with orthonormal rows or columns, whichever are fewer, times `gain`."""
    count, length = min(rows, columns), max(rows, columns)
    basis = normal(random, count * length).reshape(count, length)
    for i in range(count):
        # Gram and Schmidt, twice, so that rounding leaves the vectors orthogonal.
        for _ in range(2):
            for k in range(i):
                along = 0.0
                for j in range(length):
                    along += basis[i, j] * basis[k, j]
                for j in range(length):
                    basis[i, j] -= along * basis[k, j]
        size = 0.0
        for j in range(length):
            size += basis[i, j] * basis[i, j]
        size = math.sqrt(size)
        for j in range(length):
            basis[i, j] /= size
    for i in range(rows):
        for j in range(columns):
            out[i * columns + j] = gain * (basis[i, j] if rows <= columns else basis[j, i])


@register_jitable
def initialise(weights, random):
    """Write the first weights: orthogonal, offsets 0, the actor's last layer small."""
    weights[:] = 0.0
    root, second = math.sqrt(2.0), HIDDEN * (INPUTS + 1)
    for start, outputs, last in ((0, ACTIONS, 0.01), (CRITIC, 1, 1.0)):
        _orthogonal(random, HIDDEN, INPUTS, root, weights[start:])
        _orthogonal(random, HIDDEN, HIDDEN, root, weights[start + second :])
        _orthogonal(random, outputs, HIDDEN, last, weights[start + _BELOW :])


@register_jitable
def _layer(weights, start, x, y, bend):
    """Write the outputs of a layer with inputs x, its weights from `start` on; where they end."""
    offsets = start + y.size * x.size
    for j in range(y.size):
        value = weights[offsets + j]
        for i in range(x.size):
            value += weights[start + j * x.size + i] * x[i]
        y[j] = tanh(value) if bend else value
    return offsets + y.size


@register_jitable
def forward(weights, start, x, first, second, out):
    """Write both hidden layers and the output of the network whose weights begin at `start`."""
    at = _layer(weights, start, x, first, True)
    at = _layer(weights, at, first, second, True)
    _layer(weights, at, second, out, False)


@register_jitable
def _layer_back(weights, gradient, start, x, slope, below):
    """Add a layer's gradient; write the slope of the loss by its inputs."""
    offsets = start + slope.size * x.size
    below[:] = 0.0
    for j in range(slope.size):
        gradient[offsets + j] += slope[j]
        for i in range(x.size):
            gradient[start + j * x.size + i] += slope[j] * x[i]
            below[i] += slope[j] * weights[start + j * x.size + i]


@register_jitable
def _backward(weights, gradient, start, x, first, second, slope, work):
    """Add the gradient of a network, from the slope of the loss by its outputs."""
    _layer_back(weights, gradient, start + _BELOW, second, slope, work[1])
    # The derivative of tanh follows from its value: 1 - y^2.
    for j in range(HIDDEN):
        work[1, j] *= 1.0 - second[j] * second[j]
    _layer_back(weights, gradient, start + HIDDEN * (INPUTS + 1), first, work[1], work[0])
    for j in range(HIDDEN):
        work[0, j] *= 1.0 - first[j] * first[j]
    _layer_back(weights, gradient, start, x, work[0], work[2, :INPUTS])


@register_jitable
def normalise(state, observed, row):
    """Write an observation (4,) as the networks take it."""
    for j in range(INPUTS):
        scaled = (observed[j] - state["mean"][j]) / math.sqrt(state["variance"][j] + _SMALL)
        row[j] = min(max(scaled, -_LIMIT), _LIMIT)


@register_jitable
def _update(state, column, mean, variance, rows, before):
    """Take the statistics of some rows into those of a column, which knows `before` rows (Chan)."""
    share, ahead = rows / (before + rows), mean - state["mean"][column]
    within = (1.0 - share) * state["variance"][column] + share * variance
    state["variance"][column] = within + share * (1.0 - share) * ahead * ahead
    state["mean"][column] += share * ahead


@register_jitable
def _moments(values):
    """Return mean and variance of the numbers of an array (N,)."""
    mean = square = 0.0
    for value in values:
        mean += value
    mean /= values.size
    for value in values:
        square += (value - mean) * (value - mean)
    return mean, square / values.size


# --- an iteration ---------------------------------------------------------------------------------


@register_jitable
def begin(state, seed, numbers):
    """Make the networks and put the points at their starts; the other fields have defaults."""
    state["random"][0] = seed
    initialise(state["weights"], state["random"])
    draws = np.empty(4 * POINTS)
    splitmix.uniform(state["random"], draws)
    ids = np.arange(POINTS)
    p, v, goal = state["p"], state["v"], state["goal"]
    state["observed"][:] = place(draws.reshape(POINTS, 4), ids, p, v, goal, state["clock"], numbers)


@register_jitable
def collect(state, numbers, discount, trace, scale_rewards):
    """Act for `HORIZON` steps, and judge all that was done: the rows of a batch are filled."""
    weights = state["weights"]
    state["good"][:] = weights
    p, v, goal, clock = state["p"], state["v"], state["goal"], state["clock"]
    noise = normal(state["random"], ROWS * ACTIONS).reshape(ROWS, ACTIONS)
    first, second, value, actions = (
        np.empty(HIDDEN),
        np.empty(HIDDEN),
        np.empty(1),
        np.empty((POINTS, ACTIONS)),
    )
    row, one, draws = np.empty(INPUTS), np.empty(1, np.int64), np.empty(4)
    rewards, sums, over = np.empty(ROWS), np.empty(ROWS), np.empty((ROWS, 2), np.bool_)
    values, following = np.empty(ROWS + POINTS), np.empty(ROWS)
    for t in range(HORIZON):
        for i in range(POINTS):
            k = t * POINTS + i
            state["raw"][k] = state["observed"][i]
            normalise(state, state["observed"][i], state["rows"][k])
            forward(weights, 0, state["rows"][k], first, second, state["means"][k])
            forward(weights, CRITIC, state["rows"][k], first, second, value)
            values[k] = value[0]
            state["log_prob"][k] = 0.0
            for j in range(ACTIONS):
                spread = exp(weights[LOG_STD + j])
                actions[i, j] = state["actions"][k, j] = state["means"][k, j] + spread * noise[k, j]
                state["log_prob"][k] -= 0.5 * noise[k, j] * noise[k, j] + weights[LOG_STD + j]
        observed, paid, ended, late = move_points(p, v, goal, clock, actions, numbers)
        for i in range(POINTS):
            k = t * POINTS + i
            rewards[k], over[k, 0], over[k, 1] = paid[i], ended[i], late[i]
            # Rewards are scaled by the deviation of their discounted sums.
            state["worth"][i] = discount * state["worth"][i] + paid[i]
            sums[k] = state["worth"][i]
            following[k] = 0.0
            if ended[i] or late[i]:
                # The clock cut it off: the value of its last observation follows.
                if not ended[i]:
                    normalise(state, observed[i], row)
                    forward(weights, CRITIC, row, first, second, value)
                    following[k] = value[0]
                state["worth"][i] = 0.0
                one[0] = i
                splitmix.uniform(state["random"], draws)
                observed[i] = place(draws.reshape(1, 4), one, p, v, goal, clock, numbers)[0]
            state["observed"][i] = observed[i]
    for i in range(POINTS):
        normalise(state, state["observed"][i], row)
        forward(weights, CRITIC, row, first, second, value)
        values[ROWS + i] = value[0]
    unit = 1.0
    if scale_rewards:
        mean, variance = _moments(sums)
        _update(state, INPUTS, mean, variance, ROWS, state["counted"][1])
        state["counted"][1] += ROWS
        unit = math.sqrt(state["variance"][INPUTS] + _SMALL)
    # Generalised advantages, backwards (Schulman et al., 2016).
    ahead = np.zeros(POINTS)
    for k in range(ROWS - 1, -1, -1):
        i, end = k % POINTS, over[k, 0] or over[k, 1]
        after = following[k] if end else values[k + POINTS]
        delta = rewards[k] / unit + discount * after - values[k]
        ahead[i] = delta + (0.0 if end else discount * trace * ahead[i])
        state["advantages"][k], state["targets"][k] = ahead[i], ahead[i] + values[k]
    # The advantages are learned from with mean 0 and deviation 1.
    mean, variance = _moments(state["advantages"])
    for k in range(ROWS):
        state["advantages"][k] = (state["advantages"][k] - mean) / (math.sqrt(variance) + _SMALL)


@register_jitable
def shuffle(state):
    """Put the rows of the batch into a random order (Fisher and Yates)."""
    draws, order = np.empty(ROWS), state["order"]
    splitmix.uniform(state["random"], draws)
    for k in range(ROWS):
        order[k] = k
    for k in range(ROWS - 1, 0, -1):
        other = int(draws[k] * (k + 1))
        order[k], order[other] = order[other], order[k]


@register_jitable
def slopes(state, rows, gradient):
    """Add the gradient of the loss over some rows of the batch; return the loss.

    Args:
        state: with weights and batch.
        rows: their numbers, (n,).
        gradient: of all weights, (WEIGHTS,).
    """
    weights, n = state["weights"], rows.size
    hidden, mean, value = np.empty((n, 4, HIDDEN)), np.empty((n, ACTIONS)), np.empty((n, 1))
    deviation, ratio, advantage = np.empty((n, ACTIONS)), np.empty(n), np.empty(n)
    spread = np.empty(ACTIONS)
    for j in range(ACTIONS):
        spread[j] = exp(weights[LOG_STD + j])
    for r in range(n):
        k, h = rows[r], hidden[r]
        forward(weights, 0, state["rows"][k], h[0], h[1], mean[r])
        forward(weights, CRITIC, state["rows"][k], h[2], h[3], value[r])
        # Log-probability of the action under the new policy, less that under the one that acted.
        change = -state["log_prob"][k]
        for j in range(ACTIONS):
            deviation[r, j] = (state["actions"][k, j] - mean[r, j]) / spread[j]
            change -= 0.5 * deviation[r, j] * deviation[r, j] + weights[LOG_STD + j]
        ratio[r], advantage[r] = exp(change), state["advantages"][k]
    gain, slope = clipped_objective(ratio, advantage, CLIP)
    loss, down, work = 0.0, np.empty(ACTIONS), np.empty((3, HIDDEN))
    pull = np.empty(1)
    for r in range(n):
        k, h = rows[r], hidden[r]
        error = value[r, 0] - state["targets"][k]
        push = -slope[r] * ratio[r] / n  # by the logarithm of the probability
        for j in range(ACTIONS):
            down[j] = push * deviation[r, j] / spread[j]
            gradient[LOG_STD + j] += push * (deviation[r, j] * deviation[r, j] - 1.0)
        pull[0] = 2.0 * VALUE_WEIGHT / n * error
        _backward(weights, gradient, 0, state["rows"][k], h[0], h[1], down, work)
        _backward(weights, gradient, CRITIC, state["rows"][k], h[2], h[3], pull, work)
        loss += (VALUE_WEIGHT * error * error - gain[r]) / n
    return loss


@register_jitable
def step(state, part, rate):
    """Take one step of Adam down the loss of a minibatch; without a finite loss, diverge."""
    gradient, size = np.zeros(WEIGHTS), 0.0
    loss = slopes(state, state["order"][part * SIZE : (part + 1) * SIZE], gradient)
    for k in range(WEIGHTS):
        size += gradient[k] * gradient[k]
    size = math.sqrt(size)
    if not math.isfinite(loss + size):
        state["weights"][:] = state["good"]
        state["diverged"] = 1
        return
    # A gradient that is too long is cut (Pascanu, Mikolov and Bengio, 2013).
    cut = LONGEST / size if size > LONGEST else 1.0
    moments, decays = state["moments"], state["decays"]
    for k in range(2):
        decays[k] *= _MOMENTS[k]
    root = math.sqrt(1.0 - decays[1])
    for k in range(WEIGHTS):
        slope = cut * gradient[k]
        moments[0, k] += (1.0 - _MOMENTS[0]) * (slope - moments[0, k])
        moments[1, k] += (1.0 - _MOMENTS[1]) * (slope * slope - moments[1, k])
        length = math.sqrt(moments[1, k]) / root + _ADAM_SMALL
        state["weights"][k] -= rate / (1.0 - decays[0]) * moments[0, k] / length


@register_jitable
def finish(state):
    """Measure how far the policy has moved, and update the statistics of the observations."""
    weights, good = state["weights"], state["good"]
    first, second, mean = np.empty(HIDDEN), np.empty(HIDDEN), np.empty(ACTIONS)
    kl = 0.0
    for k in range(ROWS):
        forward(weights, 0, state["rows"][k], first, second, mean)
        # Divergence of normal distributions, the old one from the new one.
        for j in range(ACTIONS):
            before, after = good[LOG_STD + j], weights[LOG_STD + j]
            away = state["means"][k, j] - mean[j]
            moved = (away * away + exp(2.0 * before)) * exp(-2.0 * after)
            kl += (after - before + 0.5 * moved - 0.5) / ROWS
    if not kl < RUNAWAY:
        weights[:] = good
        state["diverged"] = 1
        return
    state["kl"] = kl
    for j in range(INPUTS):
        mean_of, variance = _moments(state["raw"][:, j])
        _update(state, j, mean_of, variance, ROWS, state["counted"][0])
    state["counted"][0] += ROWS
