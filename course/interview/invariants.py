"""Invariants: what must hold of right code whatever it computes, each as one figure.

Every function returns how far something is from what must hold: zero where it holds, and infinity
where the numbers are not finite. What is small enough is for the caller to say. They need no
reference solution, so they can be asked of any code: the learner's own, and that of `museum`.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course import check

Array = NDArray[np.float64]
Mapped = Callable[..., ArrayLike]
# Rewards, values, ends of episodes and the value after the last step -> advantages.
Advantages = Callable[[Array, Array, NDArray[np.bool_], float], Array]


def gap(one: ArrayLike, other: ArrayLike) -> float:
    """Return the largest difference of two arrays of one shape; infinite if a number is not finite.

    Raises:
        ValueError: for arrays of two shapes.
    """
    a, b = np.asarray(one, dtype=float), np.asarray(other, dtype=float)
    if a.shape != b.shape:
        raise check.invalid("other.shape", b.shape, f"that of one, {a.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        return np.inf
    return float(np.abs(a - b).max(initial=0.0))


def rotation_error(matrix: ArrayLike) -> float:
    """Return by how much a matrix fails to keep lengths and handedness.

    Its columns are orthonormal, its determinant is 1.

    Args:
        matrix: shape (n, n).
    """
    turn = np.asarray(matrix, dtype=float)
    if turn.ndim != 2 or turn.shape[0] != turn.shape[1]:
        raise check.invalid("matrix.shape", turn.shape, "(n, n)")
    if not np.isfinite(turn).all():
        return np.inf
    return max(gap(turn.T @ turn, np.eye(len(turn))), abs(float(np.linalg.det(turn)) - 1.0))


def norm_error(vectors: ArrayLike) -> float:
    """Return how far the lengths of unit vectors, such as quaternions, are from 1.

    Args:
        vectors: shape (n,), or (n, count) with one vector in each column.
    """
    units = np.asarray(vectors, dtype=float)
    if units.ndim not in (1, 2):
        raise check.invalid("vectors.shape", units.shape, "(n,) or (n, count)")
    return gap(np.linalg.norm(units, axis=0), np.ones(units.shape[1:]))


def inertia_error(inertia: ArrayLike) -> float:
    """Return by how much a tensor fails to be the inertia of any body.

    It is symmetric, and no principal moment exceeds the sum of the two others. (With the moments
    J1, J2, J3 about the axes, J1 + J2 - J3 is twice the integral of z^2 over the mass.) A tensor
    that is only positive definite may still belong to no body. Source: Traversaro and others,
    Identification of fully physical consistent inertial parameters, 2016.

    Args:
        inertia: about the centre of mass, shape (3, 3) [kg m^2].

    Returns:
        The larger of both violations, as a share of the largest moment.
    """
    tensor = np.asarray(inertia, dtype=float)
    if tensor.shape != (3, 3):
        raise check.invalid("inertia.shape", tensor.shape, "(3, 3)")
    if not np.isfinite(tensor).all():
        return np.inf
    moments = np.linalg.eigvalsh(0.5 * (tensor + tensor.T))
    excess = float((2.0 * moments - moments.sum()).max())
    return max(gap(tensor, tensor.T), excess, 0.0) / (float(np.abs(moments).max()) or 1.0)


def shift_error(step: Mapped, state: ArrayLike, shift: ArrayLike) -> float:
    """Return how far a step depends on where the origin of the world is.

    The invariant: far from fixed objects a motion that begins elsewhere is the same motion, moved.

    Args:
        step: state -> the next state.
        state: where to try it, shape (n,).
        shift: what moves a state, shape (n,): the same for all positions along an axis, and 0 for
            angles and velocities.
    """
    begin, moved = np.asarray(state, dtype=float), np.asarray(shift, dtype=float)
    return gap(step(begin + moved), np.asarray(step(begin), dtype=float) + moved)


def saturation_error(
    make: Callable[[], Callable[[float], float]],
    pushed: float,
    after: Sequence[float],
    samples: tuple[int, int] = (50, 500),
) -> float:
    """Return how much commands depend on how long the actuator was at its limit before.

    A controller whose integral grows while the command is clipped (windup) has to unwind first, for
    as long as it was at the limit. The invariant: how long that was makes no difference.

    Args:
        make: returns a new controller, error -> clipped command, called once a sample.
        pushed: error that holds the command at its limit.
        after: errors of the samples that follow.
        samples: with the error `pushed`, a short and a long time [samples].
    """
    commands = []
    for count in samples:
        control = make()
        for _ in range(check.count("samples", count, 1)):
            control(pushed)
        commands.append([control(error) for error in after])
    return gap(*commands)


def derivative_error(value: Mapped, derivative: Mapped, at: ArrayLike, step: float = 1e-5) -> float:
    """Return the difference of a derivative from the limit of difference quotients.

    The error is relative where they are above 1.

    Args:
        value: of shape (m,) or a number, at a point.
        derivative: at a point; shape (m, n) for a point of n numbers, that of value for a number.
        at: the point, a number or of shape (n,).
        step: of the central difference, in the units of the point.
    """
    check.positive("step", step)
    point = np.asarray(at, dtype=float)
    directions = np.eye(point.size).reshape(point.size, *point.shape) * step
    # Central differences: their error is of second order in the step.
    columns = [np.subtract(value(point + d), value(point - d)) / (2 * step) for d in directions]
    slope = np.stack(columns, axis=-1) if point.ndim else np.asarray(columns[0])
    return gap(derivative(point), slope) / max(1.0, float(np.abs(slope).max()))


def write_read_error(read: Mapped, write: Mapped, state: ArrayLike) -> float:
    """Return how much a state changes when what was read from it is written back.

    Args:
        read: state -> what is shown of it.
        write: (state, what is shown) -> the new state.
        state: where to try it.
    """
    return gap(write(state, read(state)), state)


def round_trip_error(present: Mapped, back: Mapped, value: ArrayLike) -> float:
    """Return how far a value is from itself after a map and its inverse.

    Two wrong maps that are inverses of each other pass it too.
    """
    return gap(back(present(value)), value)


def mirror_error(
    step: Mapped, mirror: Mapped, mirror_input: Mapped, state: ArrayLike, given: ArrayLike
) -> float:
    """Return how far the step violates mirror symmetry.

    The invariant: the mirrored state with the mirrored input moves as the mirror image of the
    motion.

    Args:
        step: (state, input) -> the next state.
        mirror: reflection of a state.
        mirror_input: reflection of an input.
        state: state at which the symmetry is tested.
        given: input with which the symmetry is tested.
    """
    return gap(step(mirror(state), mirror_input(given)), mirror(step(state, given)))


def unit_error(
    formula: Mapped, values: Sequence[float], factors: Sequence[float], factor: float
) -> float:
    """Return how far results in other units are from the same quantity.

    The inputs times their factors give the result times its own.

    Args:
        formula: of the values.
        values: in the first units.
        factors: from the first units to the others, one a value.
        factor: from the first unit of the result to the other.

    Returns:
        The error relative to the result where that is above 1.
    """
    if len(values) != len(factors):
        raise check.invalid("factors", len(factors), f"{len(values)} factors")
    # Dimensional homogeneity: scaled inputs must scale the result by the stated factor.
    other = np.asarray(formula(*(v * f for v, f in zip(values, factors, strict=True)))) / factor
    same = np.asarray(formula(*values), dtype=float)
    return gap(other, same) / max(1.0, float(np.abs(same).max()))


def turn_error(function: Mapped, angle: float, turns: int = 1) -> float:
    """Return by how much a whole turn changes a value that depends on an orientation.

    Args:
        function: of an angle in radians.
        angle: where to try it.
        turns: how many turns are added.
    """
    return gap(function(angle + 2.0 * np.pi * turns), function(angle))


def weight_error(forces: ArrayLike, masses: ArrayLike, gravity: float = 9.81) -> float:
    """Return how far the ground's force at rest is from the weight, as a share of the weight.

    Args:
        forces: upwards, of the ground on the bodies, N.
        masses: of the bodies, kg.
        gravity: m/s^2.
    """
    weight = gravity * float(np.sum(check.vector("masses", masses, low=check.POSITIVE)))
    return gap(np.sum(forces), weight) / weight


def fall_error(gained: float, seconds: float, gravity: float = 9.81) -> float:
    """Return how far the speed gained in free fall is from g t, as a share of g t.

    Args:
        gained: downwards, m/s.
        seconds: since the start.
        gravity: m/s^2.
    """
    due = check.positive("gravity", gravity) * check.positive("seconds", seconds)
    return gap(gained, due) / due


def kept_error(series: ArrayLike) -> float:
    """Return how far a conserved quantity drifts, as a share of its first value.

    Args:
        series: shape (steps,) or (steps, components).
    """
    retained = np.asarray(series, dtype=float)
    first = float(np.abs(retained[0]).max())
    return gap(retained, np.broadcast_to(retained[0], retained.shape)) / (first or 1.0)


def refined_ratio(error: Callable[[float], float], step: float, parts: int = 4) -> float:
    """Return the error of a finer step over that of the step.

    A right equation has about 1 / parts^order, a wrong one about 1 however fine the step: what
    the step does not cure is no error of the integrator.

    Args:
        error: of a step.
        step: the coarse one.
        parts: into which the fine one cuts it.
    """
    check.count("parts", parts, 2)
    coarse, fine = error(step), error(step / parts)
    if not np.isfinite([coarse, fine]).all():
        return np.inf
    return fine / coarse if coarse else float(fine > 0.0)


def ends_error(path: ArrayLike | None, start: ArrayLike, goal: ArrayLike) -> float:
    """Return how far a path that is called solved misses the start or the goal.

    Args:
        path: shape (states, dim), or None for a planner that reports that it found none.
        start: shape (dim,).
        goal: shape (dim,).
    """
    if path is None:
        return 0.0
    states = np.asarray(path, dtype=float)
    if not len(states):
        return np.inf
    return max(gap(states[0], start), gap(states[-1], goal))


def tree_error(points: ArrayLike, parents: Sequence[int], costs: ArrayLike) -> float:
    """Return how far the costs of nodes differ from the lengths of their paths from the root.

    Args:
        points: shape (nodes, dim).
        parents: of each node its parent, -1 for the root.
        costs: of each node.

    Returns:
        The largest difference; infinite where the parents lead in a circle.
    """
    places, lengths = np.asarray(points, dtype=float), np.zeros(len(parents))
    for node in range(len(parents)):
        at, observed = node, 0
        while parents[at] >= 0:
            lengths[node] += np.linalg.norm(places[at] - places[parents[at]])
            at, observed = parents[at], observed + 1
            # More steps than nodes: the parents form a cycle.
            if observed > len(parents):
                return np.inf
    return gap(costs, lengths)


def episodes_error(advantages: Advantages, episodes: Sequence[tuple[Array, Array]]) -> float:
    """Return how much an episode that has ended affects the next one's advantages.

    In one buffer each is as it is alone.

    Args:
        advantages: of rewards, values, ends and the value after the last step.
        episodes: of each the rewards and the values, shape (steps,) both.
    """
    ends = [np.arange(len(rewards)) == len(rewards) - 1 for rewards, _ in episodes]
    alone = [advantages(r, v, e, 0.0) for (r, v), e in zip(episodes, ends, strict=True)]
    rewards, values = (np.concatenate(parts) for parts in zip(*episodes, strict=True))
    together = advantages(rewards, values, np.concatenate(ends), 0.0)
    return gap(together, np.concatenate(alone))


def forever_error(value: float, discount: float, reward: float = 1.0) -> float:
    """Return the relative error of an endless reward's value, reward / (1 - discount).

    Args:
        value: that was learned.
        discount: a step, from 0 to below 1.
        reward: of every step.
    """
    check.finite("discount", discount, 0.0, 1.0 - 1e-12)
    due = reward / (1.0 - discount)
    return gap(value, due) / abs(due)


def stored_error(before: ArrayLike, after: ArrayLike, lengths: Sequence[int]) -> float:
    """Return by how many steps a replay buffer violates the order or the count of its steps.

    The invariant: a stored step never goes back in time, and the buffer holds as many steps as the
    episodes have.

    Args:
        before: time within the episode at the start of each stored step.
        after: time within the episode at the end of each stored step.
        lengths: of the episodes, in steps.

    Returns:
        How many steps go back, and how many are too many or too few, added.
    """
    back = np.count_nonzero(np.asarray(after) <= np.asarray(before))
    return float(back + abs(np.size(before) - sum(lengths)))


def idle_parameters(gradients: Mapping[str, ArrayLike]) -> list[str]:
    """Return the parameters that have no gradient.

    The names of those with none anywhere, or not a finite one.

    Args:
        gradients: by the name of the parameter.
    """
    arrays = {name: np.asarray(gradient, dtype=float) for name, gradient in gradients.items()}
    return [name for name, g in arrays.items() if not (np.any(g) and np.isfinite(g).all())]
