"""The real arm and the simulated one: a batch of two-link arms that differ in what is not known.

Chapter 4's two links in a horizontal plane under chapter 6's controller, with what separates a
robot from its simulator: mass and payload, viscous and dry friction, a weak motor, a late command,
an encoder with an offset and noise. A plant is a column of numbers, so a batch of different ones
costs no more than a batch of the same. Six gains are the policy: the least that can be fitted to a
simulator too well.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, positive, vector
from course.control import Gains, Record
from course.kinematics import TwoLink, two_link_ik
from course.kinematics.two_link import branches
from course.sim_to_real.motion import episodes

Array = NDArray[np.float64]

ARM = TwoLink(torques=(6.0, 3.0))  # what the simulator believes in
DT, SECONDS = 0.01, 0.9  # of the control loop and of an episode [s]
STEP = 0.005  # longest step of the integrator [s]
FILTER = 0.005  # time constant of the estimated rate [s]
RADIUS, HOLD = 0.02, 0.1  # the target [m], and how long the tip stays in it [s]
FASTEST = 1e3  # a joint this fast has diverged [rad/s]
GAINS = ("kp1", "ki1", "kd1", "kp2", "ki2", "kd2")

# Why an episode ended as it did; the index is what `Outcome.reason` holds.
REASONS = ("held", "late", "left", "never there", "diverged")
# Rows of `Plants.columns`.
ROWS = ("a", "b", "d", "c1", "c2", "f1", "f2", "torque", "delay", "bias1", "bias2", "noise")


@dataclass(frozen=True)
class Plants:
    """N arms; each field is a number for all or an array (N,), and is kept as (N,).

    Attributes:
        mass: factor on the masses of both links.
        payload: a point mass at the tip [kg].
        viscous: factor on the damping of both joints.
        coulomb: dry friction of joint 1, in motion and at rest; joint 2 has half of it [N m].
        torque: factor from the commanded torque to the motor's.
        delay: from the measurement to the motor, any length [s].
        bias: offset of both encoders [rad].
        noise: standard deviation of an encoder's reading [rad].
    """

    mass: Any = 1.0
    payload: Any = 0.0
    viscous: Any = 1.0
    coulomb: Any = 0.0
    torque: Any = 1.0
    delay: Any = 0.0
    bias: Any = 0.0
    noise: Any = 0.0

    def __post_init__(self) -> None:
        low = {"mass": POSITIVE, "torque": POSITIVE, "bias": -np.inf}
        given = {
            name: vector(name, getattr(self, name), (), (None,), low=low.get(name, 0.0))
            for name in FIELDS
        }
        n = max(row.size for row in given.values())
        for name, row in given.items():
            if row.size not in (1, n):
                raise invalid(f"{name}.shape", row.shape, f"() or ({n},)")
            object.__setattr__(self, name, np.broadcast_to(row.reshape(-1), (n,)).copy())

    @property
    def size(self) -> int:
        """How many arms."""
        return np.size(self.mass)

    def columns(self) -> Array:
        """Return what the equations of motion read, shape (12, N), rows as in `ROWS`.

        A, b, d of `course.kinematics.two_link` [kg m^2], damping c [N m s/rad], dry friction f [N
        m], then torque factor, delay [s], offsets and noise [rad].
        """
        return columns_of(np.array([getattr(self, name) for name in FIELDS]))

    def take(self, index: ArrayLike) -> Plants:
        """Return some of these arms, by a whole number each or a mask."""
        rows = {name: np.atleast_1d(getattr(self, name)[index]) for name in FIELDS}
        return Plants(**rows)


FIELDS = tuple(field.name for field in dataclasses.fields(Plants))
_PARAMETERS, _LENGTHS = tuple(map(float, ARM.parameters)), tuple(map(float, ARM.lengths))


@register_jitable
def columns_of(fields):
    """Return `Plants.columns` of arms whose fields are the rows of an array (8, N), as `FIELDS`."""
    a, b, d, c1, c2 = _PARAMETERS
    l1, l2 = _LENGTHS
    mass, payload = fields[0], fields[1]
    result = np.empty((12, fields.shape[1]))
    # The payload is a point mass at the tip: it adds to the three inertia parameters a, b and d.
    result[0] = mass * a + payload * (l1 * l1 + l2 * l2)
    result[1] = mass * b + payload * l1 * l2
    result[2] = mass * d + payload * l2 * l2
    result[3], result[4] = c1 * fields[2], c2 * fields[2]
    result[5], result[6] = fields[3], 0.5 * fields[3]
    result[7], result[8] = fields[4], fields[5]
    result[9], result[10] = fields[6], fields[6]
    result[11] = fields[7]
    return result


# How far gap 1 is from the simulator: the direction along which `real` moves.
DIRECTION = {
    "mass": 0.1,
    "payload": 0.5,
    "viscous": -0.8,
    "coulomb": 0.6,
    "torque": -0.2,
    "bias": 0.004,
    "noise": 0.001,
}
# The simulator's arm and that direction, as columns in the order of `FIELDS`.
HOME = np.array([getattr(Plants(), name) for name in FIELDS])
CHANGE = np.array([DIRECTION.get(name, 0.0) for name in FIELDS])[:, None]


@register_jitable
def fields_of(gap, delay):
    """Return the fields (8, N) of `real` at gaps, rows as in `FIELDS`; numbers or arrays (N,)."""
    fields = HOME + gap * CHANGE
    fields[5] = delay
    return fields


def nominal(n: int = 1) -> Plants:
    """Return n copies of the simulator's arm.

    It has no payload, no dry friction, no delay, and a perfect encoder.
    """
    return Plants(mass=np.ones(count("n", n, 1)))


def real(gap: ArrayLike, delay: ArrayLike = 0.0) -> Plants:
    """Return the arm at a distance from the simulator's, all parameters moved along `DIRECTION`.

    Args:
        gap: 0 for the simulator's, 1 for `DIRECTION`; a number or (N,), from 0 to 1.25.
        delay: of the command, on its own [s].
    """
    g = vector("gap", gap, (), (None,), low=0.0, high=1.25)
    late = vector("delay", delay, (), (None,), low=0.0, unit="s")
    fields = dict(zip(FIELDS, fields_of(np.atleast_1d(g), 0.0), strict=True))
    return Plants(**fields | {"delay": late})


@dataclass(frozen=True)
class Tasks:
    """Where E episodes start and where the tip has to go.

    Attributes:
        start: angles at rest, shape (2, E) [rad].
        goal: of the tip, shape (2, E) [m].
        seed: of the encoders' noise.
    """

    start: Array
    goal: Array
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "start", vector("start", self.start, (2, None), unit="rad"))
        object.__setattr__(self, "goal", vector("goal", self.goal, self.start.shape, unit="m"))
        result = two_link_ik(ARM.lengths, self.goal)
        if not np.all(result.reached):
            at = int(np.argmin(result.reached))
            low, high = abs(np.subtract(*ARM.lengths)), sum(ARM.lengths)
            allowed = f"a point {low:.3g} to {high:.3g} m from the base"
            raise invalid(f"goal[:, {at}]", self.goal[:, at], allowed)
        reference = reference_angles(self.start, self.goal)
        object.__setattr__(self, "reference", reference)
        rng = np.random.default_rng(self.seed)
        # Drawn once for the tasks, so that every policy meets the same noise.
        noise = rng.standard_normal((round(SECONDS / DT) + 1, 2, self.size))
        object.__setattr__(self, "unit_noise", noise)

    reference: Array = dataclasses.field(init=False)  # angles that put the tip there, (2, E) [rad]
    unit_noise: Array = dataclasses.field(init=False)  # of variance 1, (samples, 2, E)

    @property
    def size(self) -> int:
        """How many episodes."""
        return self.start.shape[1]


@register_jitable
def reference_angles(start, goal):
    """Return the angles nearest to the start that put the tip at its goal, all (2, E) [rad, m].

    The goals are within reach.
    """
    left, right, bend, _ = branches(*_LENGTHS, goal[0], goal[1])
    # Both branches, each with the turn of joint 1 that is nearest to the start.
    left = left + 2.0 * np.pi * np.rint((start[0] - left) / (2.0 * np.pi))
    right = right + 2.0 * np.pi * np.rint((start[0] - right) / (2.0 * np.pi))
    far = np.maximum(np.abs(left - start[0]), np.abs(bend - start[1]))
    other = np.maximum(np.abs(right - start[0]), np.abs(-bend - start[1])) < far
    result = np.empty(start.shape)
    result[0], result[1] = np.where(other, right, left), np.where(other, -bend, bend)
    return result


def tip(q: ArrayLike) -> Array:
    """Return where the tip is [m] at angles [rad], both (2, ...)."""
    q = np.asarray(q, dtype=float)
    (l1, l2), both = ARM.lengths, q[0] + q[1]
    return np.array([l1 * np.cos(q[0]) + l2 * np.cos(both), l1 * np.sin(q[0]) + l2 * np.sin(both)])


def tasks(n: int, seed: int) -> Tasks:
    """Return n reaches of 0.3 to 0.8 rad a joint, drawn alike for each plant that is asked."""
    rng = np.random.default_rng(count("seed", seed))
    start = rng.uniform([[-np.pi], [0.7]], [[np.pi], [2.3]], (2, count("n", n, 1)))
    move = rng.uniform(0.3, 0.8, (2, n)) * rng.choice([-1.0, 1.0], (2, n))
    end = start + move
    # Where the elbow would leave its range it turns the other way.
    end[1] = np.where((end[1] < 0.3) | (end[1] > 2.7), start[1] - move[1], end[1])
    return Tasks(start, tip(end), seed)


@dataclass(frozen=True)
class Outcome:
    """What became of the episodes; arrays (E,), or (K, E) for K sets of gains.

    Attributes:
        success: whether the tip was in the target for the last `HOLD` seconds.
        inside: time in the target [s].
        error: distance from it at the end [m]; infinite for one that diverged.
        reason: index into `REASONS`.
    """

    success: NDArray[np.bool_]
    inside: Array
    error: Array
    reason: NDArray[np.int64]

    @property
    def rate(self) -> Array:
        """Share of the episodes that succeeded, shape () or (K,)."""
        return np.mean(self.success, axis=-1)

    def reasons(self) -> dict[str, int]:
        """Return how many episodes ended in each way, those that did not occur left out."""
        counts = np.bincount(self.reason.reshape(-1), minlength=len(REASONS)).tolist()
        return {name: n for name, n in zip(REASONS, counts, strict=True) if n}


# What `motion.episodes` has to know of an episode.
SIZES = np.array(
    [round(SECONDS / DT), DT, STEP, RADIUS, round(HOLD / DT), FASTEST, *ARM.lengths], dtype=float
)


def controller_numbers(gains: Array) -> Array:
    """Return `Gains.numbers` of each set and joint, shape (K, 2, 13)."""
    rows = [Gains(0.0, tau=FILTER, u_min=-u, u_max=u).numbers(DT) for u in ARM.torques]
    numbers = np.repeat(np.array(rows)[None], gains.shape[1], axis=0)
    numbers[:, :, :3] = gains.reshape(2, 3, -1).transpose(2, 0, 1)
    return numbers


def _columns(plants: Plants | ArrayLike) -> Array:
    if isinstance(plants, Plants):
        return plants.columns()
    arms = np.ascontiguousarray(vector("columns", plants, (len(ROWS), None)))
    # The loop divides by the inertias a and d, and looks back by the delay.
    for row in (0, 2, 8):
        vector(f"columns[{row}]", arms[row], low=0.0 if row == 8 else POSITIVE)
    return arms


def _run(
    plants: Plants | ArrayLike, gains: ArrayLike, posed: Tasks, traced: bool
) -> tuple[Array, Array]:
    sets, arms = vector("gains", gains, (6,), (6, None), low=0.0), _columns(plants)
    E, T = max(arms.shape[1], posed.size), round(SECONDS / DT)
    for name, size in (("plants", arms.shape[1]), ("tasks", posed.size)):
        if size not in (1, E):
            raise invalid(f"{name}.size", size, f"1 or {E}, one for each episode")
    K = 1 if sets.ndim == 1 else sets.shape[1]
    start = np.zeros((4, E))
    start[:2] = posed.start
    wide = [np.broadcast_to(x, (2, E)).copy() for x in (posed.reference, posed.goal)]
    out = np.empty((4, K * E))
    trace = np.zeros((10 if traced else 0, K * E, T + 1))
    episodes(
        arms,
        controller_numbers(sets.reshape(6, -1)),
        start,
        *wide,
        posed.unit_noise,
        np.empty((0, 2, 1)),
        SIZES,
        out,
        trace,
    )
    return out.reshape((4, E) if sets.ndim == 1 else (4, K, E)), trace


def rollouts(plants: Plants | ArrayLike, gains: ArrayLike, tasks: Tasks) -> Outcome:
    """Try gains on arms, compiled: one episode an arm and task, one arm or task standing for all.

    Args:
        plants: 1 or E of them, or the columns of such, (12, 1) or (12, E), as identified ones are.
        gains: shape (6,) or (6, K), rows as in `GAINS` [N m/rad, N m/(rad s), N m s/rad].
        tasks: 1 or E.

    Raises:
        ValueError: for negative gains, or numbers of arms and tasks that disagree.
    """
    out, _ = _run(plants, gains, tasks, False)
    return Outcome(out[0] > 0.0, out[1], out[2], out[3].astype(np.int64))


def watch(plants: Plants | ArrayLike, gains: ArrayLike, tasks: Tasks) -> Record:
    """Return the motion of `rollouts` with one set of gains (6,); arrays (2, E, T + 1)."""
    _, trace = _run(plants, vector("gains", gains, (6,), low=0.0), tasks, True)
    return _record(trace, DT, tasks.reference)


def driven(
    columns: ArrayLike, torques: ArrayLike, start: ArrayLike, dt: float = DT, noise: ArrayLike = 0.0
) -> Record:
    """Return arms under torques that are known beforehand: what a log is compared with.

    Args:
        columns: of the arms, shape (12, N), as `Plants.columns` makes them.
        torques: that are sent, shape (T, 2) or (T, 2, N), each held for a sample [N m].
        start: angles and rates, shape (4,) or (4, N) [rad, rad/s].
        dt: sample time [s].
        noise: unit normals for the encoders, a number or shape (T + 1, 2, N).
    """
    arms = _columns(columns)
    N = arms.shape[1]
    plan = vector("torques", torques, (None, 2), (None, 2, N), unit="N m")
    T = count("len(torques)", plan.shape[0], 1)
    plan = np.ascontiguousarray(plan.reshape(T, 2, -1))
    first = vector("start", start, (4,), (4, N)).reshape(4, -1)
    first = np.broadcast_to(first, (4, N)).copy()
    given = vector("noise", noise, (), (T + 1, 2, N))
    wide = np.broadcast_to(given, (T + 1, 2, N if given.ndim else 1)).copy()
    sizes = np.array([T, positive("dt", dt), min(STEP, dt), RADIUS, T, FASTEST, *ARM.lengths])
    out, trace = np.empty((4, N)), np.full((10, N, T + 1), np.nan)
    empty = np.zeros((2, N))
    episodes(arms, np.zeros((1, 2, 13)), first, empty, empty, wide, plan, sizes, out, trace)
    return _record(trace, dt, empty)


def _record(trace: Array, dt: float, reference: Array) -> Record:
    T = trace.shape[2] - 1
    q, v, torque, measured, command = (trace[i : i + 2] for i in (0, 2, 4, 6, 8))
    desired = np.broadcast_to(reference[:, :, None], command[:, :, :T].shape)
    times = np.linspace(0.0, T * dt, T + 1)
    return Record(times, q, v, torque, command[:, :, :T], measured, desired)
