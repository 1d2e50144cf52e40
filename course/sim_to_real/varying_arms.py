"""Arms whose load and friction differ in every episode: fixed gains, adaptation, and memory.

One joint swings a load in the vertical plane. All methods share one control law, that of Slotine
and Li (1987). They differ in where its estimate of the arm comes from:

- fixed gains: the estimate is the middle of the family and never changes;
- the adaptive law: the estimate moves with the tracking error;
- the teacher: the estimate is the truth, which only a simulator knows;
- the student: a small network computes the estimate from a short history of angle, speed and
  torque. It learns from the teacher's truth on its own rollouts: the second phase of RMA (Kumar,
  Fu, Pathak and Malik, Rapid motor adaptation for legged robots, 2021).

The best of a list of fixed gain sets, chosen for each arm after the fact, bounds the sets in that
list and no others.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.libraries import one_thread, pytorch

Array = NDArray[np.float64]
CUBE = types.Array(numba.float64, 3, "C")

# The link without its load: a uniform rod.
LINK, LENGTH, GRAVITY = 1.0, 0.5, 9.81  # kg, m, m/s^2
TORQUE = 80.0  # limit of the motor [N m]
SLIP = 0.03  # speed at which dry friction has reached three quarters of its value [rad/s]

DT = 2e-3  # period of the controller [s]
SUBSTEPS = 2  # of the plant in one period
DELAY = 5  # periods between a command and its torque
FILTER = 1e-2  # time constant of the measured speed [s]
NOISE = 3e-4  # standard deviation of the measured angle [rad]
WINDOW = 10  # periods averaged in one entry of the history
CAP = 1.0  # a run that diverges counts with this error [rad]

# Lowest and highest load [kg], viscous friction [N m s/rad] and dry friction [N m] of the family.
LOW, HIGH = np.array([0.0, 0.05, 0.1]), np.array([2.0, 0.6, 1.5])
MIDDLE = 0.5 * (LOW + HIGH)
SCALES = np.array([1.0, 3.0, 10.0])  # of one entry of the history: cos q, speed, torque


class Gains(NamedTuple):
    """Feedback of the law: slope [1/s], damping [1/s] and integral [1/s].

    With the tracking speed s = de + slope e, the feedback torque is the estimated inertia times
    damping (s + integral times the integral of s).
    """

    slope: float
    damping: float
    integral: float = 0.0


class Student(NamedTuple):
    """The network: three matrices, each with its bias as the last column.

    Attributes:
        first: shape (h, 3 n + 1), n entries of the history.
        second: shape (h, h + 1).
        last: shape (3, h + 1); the outputs are load and frictions, -1 and 1 at the family's ends.
    """

    first: Array
    second: Array
    last: Array


class Run(NamedTuple):
    """What n arms did.

    Attributes:
        error: root of the mean squared tracking error of each arm, at most `CAP` [rad], shape (n,).
        angle: the true angle error q_d - q at each period [rad], shape (n, steps).
        estimate: inertia, viscous, dry friction and gravity torque at the end of each window,
            shape (n, windows, 4).
        history: cos q, speed and torque of each window, averaged (speed: at its end), divided by
            `SCALES`, shape (n, windows, 3).
    """

    error: Array
    angle: Array
    estimate: Array
    history: Array


def family(n: int, rng: np.random.Generator, low: Array = LOW, high: Array = HIGH) -> Array:
    """Sample n arms: load [kg], viscous [N m s/rad] and dry friction [N m], shape (n, 3).

    Args:
        n: number of arms.
        rng: source of randomness.
        low: smallest values, shape (3,).
        high: largest values, shape (3,).
    """
    return np.asarray(rng.uniform(low, high, (count("n", n, 1), 3)))


def coefficients(arms: ArrayLike) -> Array:
    """Return inertia, viscous friction, dry friction and gravity torque, shape (n, 4).

    The torque is linear in them: tau = I a + b v + c tanh(v / SLIP) + G cos q.

    Args:
        arms: load, viscous and dry friction, shape (n, 3).
    """
    load, viscous, dry = vector("arms", arms, (None, 3), low=0.0).T
    inertia = LINK * LENGTH**2 / 3.0 + load * LENGTH**2
    return np.stack([inertia, viscous, dry, GRAVITY * LENGTH * (0.5 * LINK + load)], axis=1)


def references(n: int, rng: np.random.Generator, seconds: float = 4.0) -> Array:
    """Sample n smooth references: angle, speed and acceleration, shape (n, steps, 3).

    Each is a sum of three sines with frequencies from 0.2 to 1.2 Hz.

    Args:
        n: number of references.
        rng: source of randomness.
        seconds: length of each [s].
    """
    times = DT * np.arange(round(positive("seconds", seconds, unit="s") / DT))
    rate = 2.0 * np.pi * rng.uniform(0.2, 1.2, (count("n", n, 1), 3, 1))
    phase = rng.uniform(0.0, 2.0 * np.pi, (n, 3, 1))
    size = np.array([0.7, 0.35, 0.2])[:, None]
    angle = rate * times + phase
    parts = (size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle))
    return np.ascontiguousarray(np.stack([part.sum(axis=1) for part in parts], axis=2))


def _infer(net: Array, x: Array, size: int, out: Array, curved: bool) -> None:
    """Write one layer's output: net's last column is the bias."""
    for i in range(net.shape[0]):
        total = net[i, size]
        for j in range(size):
            total += net[i, j] * x[j]
        out[i] = np.tanh(total) if curved else total


_infer_loop = loop(_infer, types.void(MATRIX, VECTOR, numba.int64, VECTOR, numba.boolean))


def _track(
    true: Array,
    gains: Array,
    theta: Array,
    rate: Array,
    box: Array,
    reference: Array,
    noise: Array,
    first: Array,
    second: Array,
    last: Array,
    family_box: Array,
    angle: Array,
    estimate: Array,
    history: Array,
) -> None:
    """Run the law on every arm; theta is the estimate and changes in place."""
    n, steps = angle.shape
    entries = (first.shape[1] - 1) // 3
    inputs = np.zeros(max(first.shape[1], 1))
    hidden, deeper = np.zeros(first.shape[0]), np.zeros(second.shape[0])
    latent, pending = np.zeros(3), np.zeros(DELAY + 1)
    Y = np.zeros(4)
    h = DT / SUBSTEPS
    decay = FILTER / (FILTER + DT)
    for i in range(n):
        inertia, viscous, dry, weight = true[i]
        slope, damping, integral = gains[i]
        q, v = reference[i, 0, 0], reference[i, 0, 1]
        speed, previous, summed = v, q - DT * v, 0.0
        mean_cos, mean_torque = 0.0, 0.0
        for d in range(DELAY + 1):
            # The arm starts on its reference, held by the torque that the estimate predicts.
            pending[d] = (
                theta[i, 0] * reference[i, 0, 2]
                + theta[i, 1] * v
                + theta[i, 2] * np.tanh(v / SLIP)
                + theta[i, 3] * np.cos(q)
            )
        for k in range(steps):
            angle[i, k] = reference[i, k, 0] - q
            if not abs(angle[i, k]) < 50.0:
                angle[i, k:] = np.inf
                break
            # Measure: a noisy angle, and its filtered difference.
            reading = q + noise[i, k]
            speed = decay * speed + (1.0 - decay) * (reading - previous) / DT
            previous = reading
            # The student: at the end of each window the network reads its history.
            if k % WINDOW == 0 and k > 0:
                w = k // WINDOW - 1
                history[i, w, 0] = mean_cos / WINDOW / SCALES[0]
                history[i, w, 1] = speed / SCALES[1]
                history[i, w, 2] = mean_torque / WINDOW / SCALES[2]
                mean_cos, mean_torque = 0.0, 0.0
                if entries > 0:
                    inputs[:] = 0.0
                    for j in range(min(entries, w + 1)):
                        inputs[3 * j : 3 * j + 3] = history[i, w - j]
                    _infer_loop(first, inputs, 3 * entries, hidden, True)
                    _infer_loop(second, hidden, hidden.size, deeper, True)
                    _infer_loop(last, deeper, deeper.size, latent, False)
                    for j in range(3):
                        middle = 0.5 * (family_box[0, j] + family_box[1, j])
                        half = 0.5 * (family_box[1, j] - family_box[0, j])
                        latent[j] = max(middle + half * latent[j], 0.0)
                    theta[i, 0] = LINK * LENGTH**2 / 3.0 + latent[0] * LENGTH**2
                    theta[i, 1], theta[i, 2] = latent[1], latent[2]
                    theta[i, 3] = GRAVITY * LENGTH * (0.5 * LINK + latent[0])
                estimate[i, w] = theta[i]
            # The law: feed-forward of the estimate at the reference speed, and feedback of s.
            e, de = reference[i, k, 0] - reading, reference[i, k, 1] - speed
            s = de + slope * e
            summed += DT * s
            v_r = reference[i, k, 1] + slope * e
            Y[0] = reference[i, k, 2] + slope * de
            Y[1], Y[2], Y[3] = v_r, np.tanh(v_r / SLIP), np.cos(reading)
            torque = theta[i, 0] * damping * (s + integral * summed)
            for j in range(4):
                torque += Y[j] * theta[i, j]
            torque = min(max(torque, -TORQUE), TORQUE)
            # The adaptive law: the estimate moves along rate Y s and is projected onto the box.
            for j in range(4):
                moved = theta[i, j] + DT * rate[i, j] * Y[j] * s
                if rate[i, j] > 0.0:
                    theta[i, j] = min(max(moved, box[0, j]), box[1, j])
            # The plant: the torque commanded DELAY periods ago is held for one period.
            for d in range(DELAY):
                pending[d] = pending[d + 1]
            pending[DELAY] = torque
            applied = pending[0]
            mean_cos += np.cos(reading)
            mean_torque += applied
            for _ in range(SUBSTEPS):
                load = viscous * v + dry * np.tanh(v / SLIP) + weight * np.cos(q)
                v += h * (applied - load) / inertia
                q += h * v


_track_loop = loop(_track, types.void(*[MATRIX] * 5, CUBE, *[MATRIX] * 6, CUBE, CUBE))

NOBODY = Student(np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((3, 1)))


def track(
    arms: ArrayLike,
    gains: ArrayLike,
    reference: Array,
    *,
    estimate: ArrayLike | None = None,
    rate: ArrayLike = 0.0,
    student: Student = NOBODY,
    noise: float = NOISE,
    seed: int = 0,
) -> Run:
    """Run the law on arms that follow references.

    Args:
        arms: load, viscous and dry friction, shape (n, 3).
        gains: see `Gains`, shape (3,) or (n, 3).
        reference: from `references`, shape (n, steps, 3).
        estimate: load and frictions that the law assumes at the start, shape (3,) or (n, 3); None
            for the middle of the family. The teacher assumes `arms`.
        rate: of adaptation, 0 for none; it is scaled by the squared width of the family.
        student: the network that computes the estimate; by default none.
        noise: standard deviation of the measured angle [rad].
        seed: of the noise.

    Raises:
        ValueError: for shapes that disagree or numbers out of range.
    """
    true = coefficients(arms)
    n = len(true)
    reference = np.ascontiguousarray(reference, dtype=float)
    if reference.ndim != 3 or reference.shape[0] != n or reference.shape[2] != 3:
        raise invalid("reference.shape", reference.shape, f"({n}, steps, 3)")
    steps = reference.shape[1]
    law = np.array(np.broadcast_to(np.asarray(gains, dtype=float), (n, 3)), order="C")
    if not (np.isfinite(law).all() and (law[:, :2] > 0.0).all() and (law[:, 2] >= 0.0).all()):
        raise invalid("gains", gains, "positive slope and damping and an integral of at least 0")
    start = np.broadcast_to(MIDDLE if estimate is None else np.asarray(estimate), (n, 3))
    low, high = coefficients([LOW, HIGH])
    # The box is wider than the family, so that adaptation may leave the range of training.
    box = np.stack([0.5 * low, 3.0 * high])
    rates = np.tile(finite("rate", rate, 0.0) * (high - low) ** 2, (n, 1))
    spread = finite("noise", noise, 0.0, unit="rad")
    blur = spread * np.random.default_rng(seed).standard_normal((n, steps))
    angle, windows = np.empty((n, steps)), (steps - 1) // WINDOW
    estimates, history = np.zeros((n, windows, 4)), np.zeros((n, windows, 3))
    _track_loop(
        true,
        law,
        coefficients(start),
        rates,
        box,
        reference,
        blur,
        *student,
        np.stack([LOW, HIGH]),
        angle,
        estimates,
        history,
    )
    error = np.sqrt(np.mean(np.minimum(np.abs(angle), CAP) ** 2, axis=1))
    return Run(error, angle, estimates, history)


def spectral_radius(load: float, assumed: float, gains: Gains, viscous: float = 0.0) -> float:
    """Return the spectral radius of the sampled loop at rest; above 1 a disturbance grows.

    The arm has no dry friction, and neither has the estimate; gravity has no slope where the link
    is horizontal. What remains is linear: the arm, the filtered difference, the delay and the law
    without its integral.

    Args:
        load: of the arm [kg].
        assumed: load in the law's estimate [kg].
        gains: slope and damping.
        viscous: friction of arm and estimate [N m s/rad].
    """
    true, estimate = coefficients([[load, viscous, 0.0], [assumed, viscous, 0.0]])
    decay, h, n = FILTER / (FILTER + DT), DT / SUBSTEPS, 4 + DELAY
    q, v, speed, previous = np.eye(n)[:4]
    # Rows that turn the state (angle, speed, filtered speed, last angle, torques on their way from
    # the oldest to the newest) into what the next period needs.
    speed = decay * speed + (1.0 - decay) * (q - previous) / DT
    s = -speed - gains.slope * q
    torque = estimate[0] * (gains.damping * s - gains.slope * speed)
    torque = torque - estimate[1] * gains.slope * q
    applied, last = np.eye(n)[4], q
    for _ in range(SUBSTEPS):
        v = v + h * (applied - true[1] * v) / true[0]
        q = q + h * v
    step = np.stack([q, v, speed, last, *np.eye(n)[5:], torque])
    return float(np.abs(np.linalg.eigvals(step)).max())


def largest_damping(load: float, assumed: float, slope: float, viscous: float = 0.0) -> float:
    """Return the damping at which the sampled loop becomes unstable [1/s].

    Args:
        load: of the arm [kg].
        assumed: load in the law's estimate [kg].
        slope: of the law [1/s].
        viscous: friction of arm and estimate [N m s/rad].
    """
    low, high = 0.0, 1e4
    for _ in range(50):
        middle = 0.5 * (low + high)
        grows = spectral_radius(load, assumed, Gains(slope, middle), viscous) > 1.0
        low, high = (low, middle) if grows else (middle, high)
    return low


def candidates() -> list[Gains]:
    """Return the gain sets that `tune_methods` and the bound in hindsight try, 9 x 6 x 4."""
    return [
        Gains(slope, damping, integral)
        for slope in np.geomspace(4.0, 120.0, 9).tolist()
        for damping in np.geomspace(4.0, 40.0, 6).tolist()
        for integral in (0.0, 4.0, 16.0, 64.0)
    ]


def evaluate(arms: ArrayLike, reference: Array, sets: list[Gains], **law: object) -> Array:
    """Return the error of every gain set on every arm, shape (sets, n).

    Args:
        arms: shape (n, 3).
        reference: shape (n, steps, 3).
        sets: gain sets.
        law: further arguments of `track`.
    """
    return np.array([track(arms, g, reference, **law).error for g in sets])  # type: ignore[arg-type]


def best(errors: Array) -> int:
    """Return the index of the gain set whose mean error over the arms is smallest."""
    return int(np.argmin(errors.mean(axis=1)))


class Methods(NamedTuple):
    """Tuned settings: gains of each method and the adaptation rate.

    Attributes:
        nominal: gains tuned on the middle of the family, with the middle's model.
        randomised: gains tuned over sampled arms, with the middle's model.
        adaptive: gains of the adaptive law.
        rate: its adaptation rate.
        teacher: gains tuned for the teacher; the student uses them too.
    """

    nominal: Gains
    randomised: Gains
    adaptive: Gains
    rate: float
    teacher: Gains


RATES = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)


def tune_methods(seed: int, n: int = 24) -> Methods:
    """Tune every method on n arms of the family, all by search over the same grid of gains.

    Args:
        seed: of arms and references.
        n: number of arms.
    """
    rng = np.random.default_rng([seed, 1])
    arms, paths, sets = family(n, rng), references(n, rng), candidates()
    nominal = sets[best(evaluate(np.tile(MIDDLE, (n, 1)), paths, sets))]
    randomised = sets[best(evaluate(arms, paths, sets))]
    teacher = sets[best(evaluate(arms, paths, sets, estimate=arms))]
    # The adaptive law needs no integral, which would fight its estimate for the same offset.
    plain = [g for g in sets if g.integral == 0.0]
    trials = {rate: evaluate(arms, paths, plain, rate=rate) for rate in RATES}
    rate = min(RATES, key=lambda r: float(trials[r].mean(axis=1).min()))
    return Methods(nominal, randomised, plain[best(trials[rate])], rate, teacher)


@one_thread()
def train_student(
    gains: Gains,
    seed: int,
    *,
    entries: int = 20,
    rounds: int = 4,
    n: int = 128,
    updates: int = 600,
    hidden: int = 48,
    noise: float = NOISE,
) -> Student:
    """Train a network to compute the teacher's knowledge from a history, on its own rollouts.

    In round 0 the teacher drives, afterwards the student. Every round adds its histories, labelled
    with the true load and frictions, to the data and trains further (Ross, Gordon and Bagnell,
    A reduction of imitation learning to no-regret online learning, 2011).

    Args:
        gains: of the law.
        seed: of arms, references and weights.
        entries: windows of the history, 20 ms each.
        rounds: of rollout and training.
        n: arms in a round.
        updates: steps of Adam in a round.
        hidden: units of each hidden layer.
        noise: of the measured angle in training [rad].
    """
    torch = pytorch()
    count("entries", entries, 1)
    rng = np.random.default_rng([seed, 2])
    generator = torch.Generator().manual_seed(seed)
    shapes = [(hidden, 3 * entries + 1), (hidden, hidden + 1), (3, hidden + 1)]
    weights = [
        (torch.randn(shape, generator=generator) / shape[1] ** 0.5).requires_grad_()
        for shape in shapes
    ]
    adam = torch.optim.Adam(weights, lr=2e-3)

    def forward(x: Any) -> Any:
        for i, w in enumerate(weights):
            x = x @ w[:, :-1].T + w[:, -1]
            x = torch.tanh(x) if i < 2 else x
        return x

    inputs, labels, student = [], [], NOBODY
    for round_ in range(count("rounds", rounds, 1)):
        arms, paths = family(n, rng), references(n, rng)
        truth = arms if round_ == 0 else None
        seed_of_noise = int(rng.integers(2**31))
        run = track(
            arms, gains, paths, estimate=truth, student=student, noise=noise, seed=seed_of_noise
        )
        inputs.append(stack_history(run.history, entries).astype(np.float32))
        z = (arms - MIDDLE) / (0.5 * (HIGH - LOW))
        labels.append(np.repeat(z, run.history.shape[1], axis=0).astype(np.float32))
        x, y = torch.from_numpy(np.concatenate(inputs)), torch.from_numpy(np.concatenate(labels))
        for step in range(updates):
            if round_ == rounds - 1:  # anneal, so that the last weights are not those of a jump
                adam.param_groups[0]["lr"] = 2e-3 * (1.0 - step / updates) + 1e-5
            batch = torch.randint(len(x), (512,), generator=generator)
            loss = ((forward(x[batch]) - y[batch]) ** 2).mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
        student = Student(*(w.detach().numpy().astype(float) for w in weights))
    return student


def stack_history(history: Array, entries: int) -> Array:
    """Return the network's input at the end of each window, shape (n windows, 3 entries).

    The newest entry comes first. Before the history is full, the missing entries are 0.

    Args:
        history: shape (n, windows, 3).
        entries: windows in one input.
    """
    n, windows, _ = history.shape
    padded = np.concatenate([np.zeros((n, entries - 1, 3)), history], axis=1)
    late = [padded[:, entries - 1 - j : entries - 1 - j + windows] for j in range(entries)]
    return np.concatenate(late, axis=2).reshape(n * windows, 3 * entries)


def compare(
    methods: Methods,
    student: Student,
    arms: Array,
    reference: Array,
    *,
    noise: float = NOISE,
    seed: int = 0,
) -> dict[str, Array]:
    """Return the error of every method on the same arms, references and noise, each shape (n,).

    Args:
        methods: from `tune_methods`.
        student: from `train_student`.
        arms: shape (n, 3).
        reference: shape (n, steps, 3).
        noise: standard deviation of the measured angle [rad].
        seed: of the noise.
    """
    shared = {"noise": noise, "seed": seed}

    def run(gains: Gains, **law: object) -> Array:
        return track(arms, gains, reference, **{**shared, **law}).error  # type: ignore[arg-type]

    sets = [*candidates(), methods.nominal, methods.randomised]
    return {
        "one tuned gain set": run(methods.nominal),
        "randomised gains": run(methods.randomised),
        "best gains in hindsight": evaluate(arms, reference, sets, **shared).min(axis=0),
        "adaptive law": run(methods.adaptive, rate=methods.rate),
        "student with history": run(methods.teacher, student=student),
        "teacher": run(methods.teacher, estimate=arms),
    }
