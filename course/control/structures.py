"""Structures around a joint's PID loop: cascade, notch, disturbance observer, delay predictor.

Each is a linear law of `course.control.sampled`, so the loop's matrix, its margins and its
frequency response come from there. Two of them are a PID controller with other names for its gains,
and are returned as `Gains`: the cascade of position and velocity loop, and the disturbance observer
with a filter of first order. `respond` simulates any of them with a load, a feed-forward and noise.

Ellis, Control System Design Guide, 2012, describes the cascade and the notch; Ohnishi, Shibata and
Murakami, Motion control for advanced mechatronics, 1996, the disturbance observer; Smith, Closer
control of loops with dead time, 1957, and Manitius and Olbrot, Finite spectrum assignment problem
for systems with delays, 1979, the predictor and its form with a measured state.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.control.pid import Gains
from course.control.sampled import Held, Law, System, held, joint_system, loop_matrix

Array = NDArray[np.float64]

TURN = 2.0 * math.pi


# --- angles that wrap -----------------------------------------------------------------------------


def wrap(angle: ArrayLike) -> Array:
    """Return angles between -pi and pi that differ from the given ones by whole turns [rad].

    The error of a joint that turns endlessly is `wrap(set_point - angle)`. The rate from an encoder
    that starts again after each turn is `wrap(angle - last) / dt`, which is right for speeds below
    pi / dt. A joint with stops must not wrap its error: the short path can lead through a stop.

    Args:
        angle: any shape [rad].
    """
    return np.asarray(np.remainder(vector("angle", angle) + math.pi, TURN) - math.pi)


# --- the cascade ----------------------------------------------------------------------------------


def cascade(position: float, velocity: float, integral: float = 0.0) -> Gains:
    """Return the P controller of position around a PI controller of velocity, as PID gains.

    The outer loop requests the speed position (q_d - q). The inner loop commands the torque
    velocity (speed error) + integral (sum of the speed error). As the sum of a rate from
    differences is the angle, this is a PID controller whose P term takes only a share of the
    set-point.

    Args:
        position: gain of the outer loop [1/s].
        velocity: gain of the inner loop [N m s/rad].
        integral: gain of its I term [N m/rad].

    Returns:
        Gains for `course.control.run_joint` and `Gains.law`.
    """
    positive("position", position, unit="1/s")
    positive("velocity", velocity, unit="N m s/rad")
    finite("integral", integral, 0.0, unit="N m/rad")
    kp = velocity * position + integral
    return Gains(kp, integral * position, velocity, weight=velocity * position / kp)


# --- the disturbance observer ---------------------------------------------------------------------


def observer_share(bandwidth: float, dt: float) -> float:
    """Return the share of a new disturbance that the observer's filter takes over in a sample.

    Args:
        bandwidth: of the filter [rad/s].
        dt: sample time [s].
    """
    return -math.expm1(-positive("bandwidth", bandwidth) * positive("dt", dt, unit="s"))


def _rate_model(inertia: float, damping: float, dt: float) -> tuple[float, float]:
    """Return decay and gain of the rate over a sample with a held torque."""
    transition, added = _free(inertia, damping, dt)
    return float(transition[1, 1]), float(added[1])


def _free(inertia: float, damping: float, dt: float) -> System:
    plant = held(*joint_system(inertia, damping), dt)
    return plant.transition, plant.now


def disturbance_observer(
    kp: float, kd: float, bandwidth: float, *, dt: float, inertia: float, damping: float = 0.0
) -> Gains:
    """Return PD with a disturbance observer of first order as PID gains.

    The observer solves the joint's equation for the load, smooths it with a low-pass filter and
    subtracts it from the command. That is exactly the PID controller returned here, where the rate
    is the difference of angles and the observer is passed the command without a delay.

    Args:
        kp: [N m/rad].
        kd: [N m s/rad].
        bandwidth: of the observer's filter [rad/s].
        dt: sample time [s].
        inertia: of the observer's model [kg m^2].
        damping: of the observer's model [N m s/rad].
    """
    share = observer_share(bandwidth, dt)
    _, gain = _rate_model(inertia, damping, dt)
    total = (1.0 - share) * kp + share * (kd + damping) / dt
    rate = (1.0 - share) * kd + share / gain - share * damping
    return Gains(total, share * kp / dt, rate, weight=(1.0 - share) * kp / total if total else 1.0)


def observer_law(
    kp: float,
    kd: float,
    bandwidth: float,
    *,
    dt: float,
    inertia: float,
    damping: float = 0.0,
    late: int = 0,
    rate: str = "difference",
) -> Law:
    """Return PD with a disturbance observer that delays the command like the joint's drive does.

    Args:
        kp: [N m/rad].
        kd: [N m s/rad].
        bandwidth: of the observer's filter [rad/s].
        dt: sample time [s].
        inertia: of the observer's model [kg m^2].
        damping: of the observer's model [N m s/rad].
        late: samples by which the observer delays the command; 0 for none.
        rate: "difference" of the last two angles over dt, or "exact", v itself.
    """
    one_of("rate", rate, ("difference", "exact"))
    n = count("late", late)
    share = observer_share(bandwidth, dt)
    decay, gain = _rate_model(inertia, damping, dt)
    # Rows over (w, last angle, commands sent, newest first), and over the measurement (q, v).
    size = 2 + n
    rated, measured = np.zeros(size), np.array([0.0, 1.0])
    if rate == "difference":
        rated[1], measured = -1.0 / dt, np.array([1.0 / dt, 0.0])
    scale = share / gain
    # Estimated load: scale v - w. The law takes it off the PD command.
    C, D = -(kd + scale) * rated, -(kd + scale) * measured
    C[0] += 1.0
    D[0] -= kp
    A, B = np.zeros((size, size)), np.zeros((size, 2))
    A[0] = scale * (share - 1.0 + decay) * rated
    B[0] = scale * (share - 1.0 + decay) * measured
    A[0, 0] += 1.0 - share
    B[1, 0] = 1.0
    if n == 0:
        A[0] += share * C
        B[0] += share * D
    else:
        A[0, -1] += share
        A[2], B[2] = C, D
        A[3:, 2:-1] = np.eye(n - 1)
    return Law(A, B, C, D, dt)


def observer_limit(dt: float, late: int = 0) -> float:
    """Return the largest stable share of an observer alone, without friction, on a late command.

    Its model has the right inertia and the exact rate but not the delay, so the loop is an
    integrator with n samples of delay, z^(n + 1) - z^n + share = 0 (Levin and May, A note on
    difference-delay equations, 1976).

    Args:
        dt: sample time [s].
        late: samples of delay, n.

    Returns:
        The share of `observer_share` at the limit; above 1 there is none.
    """
    positive("dt", dt, unit="s")
    return 2.0 * math.sin(0.5 * math.pi / (2 * count("late", late) + 1))


# --- the predictor --------------------------------------------------------------------------------


def predictor_law(
    kp: float,
    kd: float,
    *,
    dt: float,
    inertia: float,
    damping: float = 0.0,
    late: int = 0,
    rate: str = "difference",
) -> Law:
    """Return PD on the state that the joint will have when the command arrives.

    The model carries the measured state over the delay, with the commands under way (the Smith
    predictor in the form of Manitius and Olbrot, 1979). If model and delay are exact, the loop has
    the eigenvalues of the loop without a delay and otherwise zeros.

    Args:
        kp: [N m/rad].
        kd: [N m s/rad].
        dt: sample time [s].
        inertia: of the model [kg m^2].
        damping: of the model [N m s/rad].
        late: samples of delay that the model assumes.
        rate: "exact" for v itself, or "difference": the rate that the model needs to get from the
            last angle to this one under the command of that sample.
    """
    one_of("rate", rate, ("difference", "exact"))
    n = count("late", late)
    transition, added = _free(inertia, damping, dt)
    # Over (last angle, commands sent, newest first); n + 1 of them.
    size = 2 + n
    state, measured = np.zeros((2, size)), np.zeros((2, 2))
    measured[0, 0] = 1.0
    if rate == "exact":
        measured[1, 1] = 1.0
    else:
        # v before this sample from q = last + phi v + gamma u, then over the sample.
        share = transition[1, 1] / transition[0, 1]
        measured[1, 0], state[1, 0] = share, -share
        state[1, -1] = added[1] - share * added[0]
    # Carry the state over the commands under way, the oldest first.
    for k in range(n, 0, -1):
        state, measured = transition @ state, transition @ measured
        state[:, k] += added
    gains = np.array([kp, kd], dtype=float)
    C, D = -gains @ state, -gains @ measured
    A, B = np.zeros((size, size)), np.zeros((size, 2))
    B[0, 0] = 1.0
    A[1], B[1] = C, D
    A[2:, 1:-1] = np.eye(n)
    return Law(A, B, C, D, dt)


# --- the notch ------------------------------------------------------------------------------------


def elastic_joint(
    motor: float, link: float, stiffness: float, damping: float = 0.0, loss: float = 0.0
) -> System:
    """Return a motor and a link with a spring between them; the motor is measured and driven.

    Args:
        motor: inertia of the motor [kg m^2].
        link: inertia of the link [kg m^2].
        stiffness: of the spring [N m/rad].
        damping: viscous friction of the motor [N m s/rad].
        loss: damping of the spring [N m s/rad].

    Returns:
        A, shape (4, 4), and B, shape (4,), of the state (motor angle, rate, link angle, rate).
    """
    J, L = positive("motor", motor), positive("link", link)
    k, c = positive("stiffness", stiffness), finite("loss", loss, 0.0)
    b = finite("damping", damping, 0.0)
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-k / J, -(b + c) / J, k / J, c / J],
            [0.0, 0.0, 0.0, 1.0],
            [k / L, c / L, -k / L, -c / L],
        ]
    )
    return A, np.array([0.0, 1.0 / J, 0.0, 0.0])


def resonance(motor: float, link: float, stiffness: float) -> float:
    """Return the angular frequency at which motor and link swing against each other [rad/s]."""
    return math.sqrt(positive("stiffness", stiffness) * (1.0 / motor + 1.0 / link))


def notch(w: float, dt: float, width: float = 0.5, floor: float = 0.05) -> tuple[Array, Array]:
    """Return the sampled filter (s^2 + 2 floor width w s + w^2) / (s^2 + 2 width w s + w^2).

    Tustin's rule, warped so that the smallest gain is at w exactly.

    Args:
        w: frequency to suppress [rad/s], below pi / dt.
        dt: sample time [s].
        width: damping ratio of the denominator.
        floor: gain that is left at w.

    Returns:
        Numerator and denominator in falling powers of z, shape (3,) each.
    """
    finite("w", w, 0.0, math.pi / positive("dt", dt, unit="s"), unit="rad/s")
    t = math.tan(0.5 * w * dt)
    finite("floor", floor, 0.0, 1.0)

    def quadratic(ratio: float) -> Array:
        return np.array(
            [1.0 + 2.0 * ratio * t + t * t, 2.0 * (t * t - 1.0), 1.0 - 2.0 * ratio * t + t * t]
        )

    under = quadratic(positive("width", width))
    return quadratic(floor * width) / under[0], under / under[0]


def behind(law: Law, top: ArrayLike, under: ArrayLike) -> Law:
    """Return a law whose command goes through a filter of second order.

    Args:
        law: the controller.
        top: numerator in falling powers of z, shape (3,).
        under: denominator, shape (3,), its first number 1.
    """
    b, a = vector("top", top, (3,)), vector("under", under, (3,))
    if a[0] != 1.0:
        raise invalid("under[0]", float(a[0]), "1")
    # Transposed direct form: states are what the past adds to the next two outputs.
    m = law.C.size
    A, B = np.zeros((m + 2, m + 2)), np.zeros((m + 2, 2))
    A[:m, :m], B[:m] = law.A, law.B
    for row in (1, 2):
        gain = b[row] - a[row] * b[0]
        A[m + row - 1, :m], B[m + row - 1] = gain * law.C, gain * law.D
        A[m + row - 1, m] = -a[row]
    A[m, m + 1] = 1.0
    return Law(A, B, np.concatenate([b[0] * law.C, [1.0, 0.0]]), b[0] * law.D, law.dt)


# --- the loop with a load, a feed-forward and noise -----------------------------------------------


class Motion(NamedTuple):
    """Angle error from the set-point, shape (n + 1,) [rad], and command, shape (n,) [N m]."""

    error: Array
    command: Array


def respond(
    plant: Held,
    law: Law,
    load: ArrayLike = 0.0,
    added: ArrayLike = 0.0,
    noise: ArrayLike = 0.0,
    *,
    samples: int,
    start: ArrayLike | None = None,
) -> Motion:
    """Simulate a linear loop about its set-point, or about a planned motion.

    About a motion q_d the angle is q - q_d, and the torque that the motion takes is a load of the
    opposite sign. A feed-forward is added to the command and comes as late as the command.

    Args:
        plant: with its hold and its delay.
        law: the feedback.
        load: torque beside the motor's, a number or shape (samples,) [N m].
        added: to the command of the feedback, likewise [N m].
        noise: of the measured angle, likewise [rad].
        samples: length of the run.
        start: state of the plant, shape (n,); zeros by default.
    """
    size = count("samples", samples, 1)
    push, plus, blur = (
        np.full(size, 1.0) * vector(name, value, (), (size,))
        for name, value in (("load", load), ("added", added), ("noise", noise))
    )
    A, B, C, D = law.matrices(plant)
    x = np.zeros(plant.now.size) if start is None else np.array(vector("start", start, (None,)))
    c, sent = np.zeros(C.size), np.zeros(plant.whole + 2)
    full = plant.now + plant.before
    error, command = np.empty(size + 1), np.empty(size)
    for k in range(size):
        error[k] = x[0]
        y = x[:2] + (blur[k], 0.0)
        u = C @ c + D @ y
        c = A @ c + B @ y
        # The newest command first; the drive acts on those that have waited.
        sent[1:], sent[0] = sent[:-1].copy(), u + plus[k]
        x = (
            plant.transition @ x
            + plant.now * sent[plant.whole]
            + plant.before * sent[plant.whole + 1]
            + full * push[k]
        )
        command[k] = sent[0]
    error[size] = x[0]
    return Motion(error, command)


def torque_noise(plant: Held, law: Law) -> float:
    """Return the deviation of the command per radian of white noise of the angle [N m/rad].

    The covariance of the loop's state solves a Lyapunov equation.

    Args:
        plant: with its hold and its delay.
        law: with which the loop is stable.
    """
    from scipy.linalg import solve_discrete_lyapunov

    F = loop_matrix(plant, law)
    _, B, C, D = law.matrices(plant)
    n, m = plant.now.size, C.size
    waiting = F.shape[0] - n - m
    # The noise enters as the measured angle does, and adds D[0] of itself to the command.
    entry = np.zeros(F.shape[0])
    if waiting:
        entry[n] = D[0]
    if not plant.whole:
        entry[:n] = plant.now * D[0]
    entry[n + waiting :] = B[:, 0]
    row = np.zeros(F.shape[0])
    row[:2], row[n + waiting :] = D, C
    covariance = solve_discrete_lyapunov(F, np.outer(entry, entry), method="bilinear")
    return math.sqrt(float(row @ covariance @ row) + D[0] ** 2)
