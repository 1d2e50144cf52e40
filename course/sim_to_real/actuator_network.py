"""An actuator network: what a drive's torque will be, learnt from a recording of it.

A drive is commanded an angle and produces a torque. Between the two lie a delay, the lag of the
current, a voltage that limits torque at speed, and friction in the gear. Hwangbo and others
(Learning agile and dynamic motor skills for legged robots, 2019) recorded such a drive and fitted a
small network from a short history of position error and speed to torque. The recorded drive is
simulated here, so that its torque is known and its supply and temperature can be changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from course.check import count, finite, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.libraries import one_thread, pytorch

Array = NDArray[np.float64]

DT = 2.5e-3  # period of a recording [s]
KP, KD = 60.0, 1.0  # of the drive's own controller [N m/rad], [N m s/rad]
TORQUE = 20.0  # limit of the current, as a torque [N m]
INERTIA = 0.25  # of the load on the drive during a recording [kg m^2]
SLIP = 0.05  # speed at which dry friction has reached three quarters of its value [rad/s]
STRIBECK = 0.4  # speed at which the extra friction at rest has mostly gone [rad/s]
AT_REST = 1.6  # ratio of friction at rest to friction in motion
NETWORK_INPUTS = (0, 4, 8)  # ages of position error and speed in the network's input [periods]


@dataclass(frozen=True)
class Drive:
    """A drive as it is.

    Attributes:
        delay: between command and current [periods].
        lag: time constant of the current [s].
        free_speed: speed at which the voltage is used up [rad/s].
        dry: friction of the gear in motion [N m].
        viscous: friction of the gear [N m s/rad].
        strength: torque per unit of commanded torque; falls as the magnets get warm.
    """

    delay: int = 3
    lag: float = 8e-3
    free_speed: float = 12.0
    dry: float = 0.8
    viscous: float = 0.15
    strength: float = 1.0

    def __post_init__(self) -> None:
        count("delay", self.delay)
        positive("lag", self.lag, unit="s")
        positive("free_speed", self.free_speed, unit="rad/s")
        for name in ("dry", "viscous"):
            finite(name, getattr(self, name), 0.0)
        positive("strength", self.strength)


class Recording(NamedTuple):
    """Position error [rad], speed [rad/s] and torque [N m] of n runs, each shape (n, steps)."""

    error: Array
    speed: Array
    torque: Array


class Fitted(NamedTuple):
    """A parametric model: delay, lag, dry and viscous friction, in the units of `Drive`."""

    delay: int
    lag: float
    dry: float
    viscous: float


def friction(speed: Array, dry: float, viscous: float, at_rest: float = AT_REST) -> Array:
    """Return the friction torque of the gear [N m], with Stribeck's extra at low speed.

    Args:
        speed: of the joint [rad/s].
        dry: friction in motion [N m].
        viscous: [N m s/rad].
        at_rest: ratio of friction at rest to friction in motion; 1 for Coulomb's law.
    """
    extra = 1.0 + (at_rest - 1.0) * np.exp(-((speed / STRIBECK) ** 2))
    return np.asarray(dry * extra * np.tanh(speed / SLIP) + viscous * speed)


def _record(drive: Array, target: Array, error: Array, speed: Array, torque: Array) -> None:
    """Move a load with the drive; `drive` holds its six numbers in the order of `Drive`."""
    delay, lag, free_speed, dry, viscous, strength = drive
    n, steps = target.shape
    late = int(delay)
    substeps = 5
    h = DT / substeps
    for i in range(n):
        q, v, current = target[i, 0], 0.0, 0.0
        for k in range(steps):
            error[i, k], speed[i, k] = target[i, k] - q, v
            j = max(k - late, 0)
            command = min(max(KP * error[i, j] - KD * speed[i, j], -TORQUE), TORQUE)
            total = 0.0
            for _ in range(substeps):
                # The current lags behind, and the voltage limits it where the joint turns fast.
                current += h / lag * (command - current)
                high = TORQUE * min(max(1.0 - v / free_speed, 0.0), 1.0)
                low = -TORQUE * min(max(1.0 + v / free_speed, 0.0), 1.0)
                motor = strength * min(max(current, low), high)
                extra = 1.0 + (AT_REST - 1.0) * np.exp(-((v / STRIBECK) ** 2))
                out = motor - dry * extra * np.tanh(v / SLIP) - viscous * v
                v += h * out / INERTIA
                q += h * v
                total += out
            torque[i, k] = total / substeps


_record_loop = loop(_record, types.void(VECTOR, *[MATRIX] * 4))


def record(drive: Drive, target: Array) -> Recording:
    """Record a drive that follows target angles with a load.

    Args:
        drive: the actuator.
        target: commanded angles, shape (n, steps) [rad].

    Returns:
        The recording; its torque is the mean over each period, at the output of the gear.
    """
    angles = np.ascontiguousarray(vector("target", target, (None, None)))
    numbers = np.array(
        [drive.delay, drive.lag, drive.free_speed, drive.dry, drive.viscous, drive.strength]
    )
    out = Recording(*(np.zeros(angles.shape) for _ in range(3)))
    _record_loop(numbers, angles, *out)
    return out


def targets(
    n: int,
    rng: np.random.Generator,
    *,
    frequency: tuple[float, float] = (0.2, 2.0),
    amplitude: tuple[float, float] = (0.05, 0.4),
    seconds: float = 4.0,
) -> Array:
    """Sample n target angles, each the sum of two sines, shape (n, steps) [rad].

    Args:
        n: number of targets.
        rng: source of randomness.
        frequency: lowest and highest [Hz].
        amplitude: lowest and highest of one sine [rad].
        seconds: length of each [s].
    """
    if not 0.0 < frequency[0] <= frequency[1]:
        raise invalid("frequency", frequency, "0 < lowest <= highest")
    times = DT * np.arange(round(positive("seconds", seconds, unit="s") / DT))
    shape = (count("n", n, 1), 2, 1)
    rate = 2.0 * np.pi * np.exp(rng.uniform(math.log(frequency[0]), math.log(frequency[1]), shape))
    phase = rng.uniform(0.0, 2.0 * np.pi, shape)
    return np.asarray((rng.uniform(*amplitude, shape) * np.sin(rate * times + phase)).sum(axis=1))


def ideal(recording: Recording) -> Array:
    """Return the torque of an ideal drive [N m]: the controller's law, limited, without delay."""
    return np.clip(KP * recording.error - KD * recording.speed, -TORQUE, TORQUE)


def parametric(recording: Recording, model: Fitted) -> Array:
    """Return the torque of a drive with a delay, a first-order lag and Coulomb friction [N m].

    Args:
        recording: position error and speed.
        model: its parameters.
    """
    from scipy.signal import lfilter

    command = ideal(recording)
    late = np.concatenate([np.repeat(command[:, :1], model.delay, axis=1), command], axis=1)[
        :, : command.shape[1]
    ]
    decay = math.exp(-DT / positive("model.lag", model.lag, unit="s"))
    # The exact first-order response to a command that is held for a period, at the period's start.
    after = lfilter([1.0 - decay], [1.0, -decay], late, axis=1)
    current = np.concatenate([np.zeros((len(late), 1)), after[:, :-1]], axis=1)
    out = late + (current - late) * (1.0 - decay) * model.lag / DT  # mean over the period
    # The speed of the middle of the period.
    middle = recording.speed.copy()
    middle[:, :-1] = 0.5 * (recording.speed[:, :-1] + recording.speed[:, 1:])
    return out - friction(middle, model.dry, model.viscous, 1.0)


def fit_parametric(recording: Recording, longest: int = 6) -> Fitted:
    """Fit the parametric model: least squares for each delay, the best of them.

    Args:
        recording: what is fitted.
        longest: largest delay that is tried [periods].
    """
    from scipy.optimize import least_squares

    results = []
    for delay in range(count("longest", longest) + 1):

        def residual(x: Array, delay: int = delay) -> Array:
            lag, dry, viscous = np.exp(x)
            model = Fitted(delay, float(lag), float(dry), float(viscous))
            return (parametric(recording, model) - recording.torque).ravel()

        result = least_squares(residual, np.log([1e-2, 0.5, 0.1]))
        results.append((float(result.cost), Fitted(delay, *np.exp(result.x).tolist())))
    return min(results)[1]


class Network(NamedTuple):
    """Weights of two hidden layers and the output, each with its bias as the last column."""

    layers: tuple[Array, Array, Array]


def inputs(recording: Recording) -> Array:
    """Return the network's input: position error and speed now and earlier, shape (n steps, 6).

    Before the start of a recording, its first values are repeated. Errors are divided by 0.3 rad,
    speeds by 3 rad/s.
    """
    columns = []
    for values, scale in ((recording.error, 0.3), (recording.speed, 3.0)):
        for age in NETWORK_INPUTS:
            past = np.concatenate([np.repeat(values[:, :1], age, axis=1), values], axis=1)
            columns.append(past[:, : values.shape[1]] / scale)
    return np.stack(columns, axis=-1).reshape(-1, len(columns))


@one_thread()
def fit_network(
    recording: Recording, seed: int = 0, *, updates: int = 3000, hidden: int = 32
) -> Network:
    """Fit the network with softsign units, as Hwangbo and others (2019), by Adam.

    Args:
        recording: what is fitted.
        seed: of weights and batches.
        updates: steps of Adam.
        hidden: units of each hidden layer.
    """
    torch = pytorch()
    generator = torch.Generator().manual_seed(seed)
    x = torch.from_numpy(inputs(recording).astype(np.float32))
    y = torch.from_numpy((recording.torque.reshape(-1, 1) / TORQUE).astype(np.float32))
    shapes = [(hidden, x.shape[1] + 1), (hidden, hidden + 1), (1, hidden + 1)]
    weights = [
        (torch.randn(shape, generator=generator) / shape[1] ** 0.5).requires_grad_()
        for shape in shapes
    ]
    adam = torch.optim.Adam(weights, lr=5e-3)
    for step in range(count("updates", updates, 1)):
        adam.param_groups[0]["lr"] = 5e-3 * (1.0 - step / updates) + 1e-5
        batch = torch.randint(len(x), (512,), generator=generator)
        out = x[batch]
        for i, w in enumerate(weights):
            out = out @ w[:, :-1].T + w[:, -1]
            out = torch.nn.functional.softsign(out) if i < 2 else out
        loss = ((out - y[batch]) ** 2).mean()
        adam.zero_grad()
        loss.backward()
        adam.step()
    first, second, last = (w.detach().numpy().astype(float) for w in weights)
    return Network((first, second, last))


def predict_torque(network: Network, recording: Recording) -> Array:
    """Return the network's torque, in the shape of the recording [N m]."""
    out = inputs(recording)
    for i, w in enumerate(network.layers):
        out = out @ w[:, :-1].T + w[:, -1]
        out = out / (1.0 + np.abs(out)) if i < 2 else out
    return np.asarray(TORQUE * out.reshape(recording.torque.shape))


def torque_error(predicted: Array, recording: Recording) -> Array:
    """Return the root of the mean squared torque error of each run [N m], shape (n,)."""
    return np.asarray(np.sqrt(np.mean((predicted - recording.torque) ** 2, axis=1)))


# Where the models are tried: how the drive and the targets differ from the recording.
CASES: dict[str, tuple[dict[str, float], dict[str, tuple[float, float]]]] = {
    "as recorded": ({}, {}),
    "twice the amplitude": ({}, {"amplitude": (0.4, 0.8)}),
    "faster, 3 to 6 Hz": ({}, {"frequency": (3.0, 6.0)}),
    "half the voltage": ({"free_speed": 6.0}, {}),
    "warm motor": ({"strength": 0.85, "viscous": 0.08}, {}),
}


def compare(seed: int, n: int = 24, updates: int = 3000) -> dict[str, dict[str, Array]]:
    """Fit both models on one recording and return the torque errors on others.

    Args:
        seed: of targets and weights.
        n: runs of the recording and of each case.
        updates: of the network's fit.

    Returns:
        case -> model -> error of each run [N m], shape (n,).
    """
    rng = np.random.default_rng([seed, 4])
    training = record(Drive(), targets(n, rng))
    network, model = fit_network(training, seed, updates=updates), fit_parametric(training)
    result = {}
    for case, (changes, span) in CASES.items():
        drive = Drive(**changes)  # type: ignore[arg-type]
        test = record(drive, targets(n, rng, **span))  # type: ignore[arg-type]
        result[case] = {
            "ideal drive": torque_error(ideal(test), test),
            "lag and friction": torque_error(parametric(test, model), test),
            "network": torque_error(predict_torque(network, test), test),
        }
    return result
