"""The museum: public slips of well-known projects, each small again beside its right twin.

An exhibit is a mechanism that does it right or, with `wrong=True`, as it was done; and evidence: a
world drawn by a seed, in which an invariant of `invariants` measures the mechanism. The right one
stays within the tolerance, the wrong one doesn't. Where a naive check passes both, it is there too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from course import check

from . import invariants

Array = NDArray[np.float64]
Evidence = Callable[[bool, int], float]
GRAVITY = 9.81


@dataclass(frozen=True)
class Exhibit:
    """A slip.

    Attributes:
        name: short, unique.
        threads: where it was reported, as "owner/repository#number".
        years: of the threads.
        finding: what the thread says, in our words.
        report: what the maintainers said or did, as far as it could be looked up.
        open: what could not be looked up, empty if nothing.
        live: where a library that is used here still behaves so, empty if nowhere.
        invariant: name of the function in `invariants` that catches it.
        tolerance: up to which the invariant holds.
        mechanism: the code, with an argument `wrong`.
        evidence: (wrong, seed) -> what the invariant measures.
        naive: (wrong, seed) -> what a check measures that the slip passes too, if one is known.
    """

    name: str
    threads: tuple[str, ...]
    years: tuple[int, ...]
    finding: str
    report: str
    invariant: str
    tolerance: float
    mechanism: Callable[..., object]
    evidence: Evidence
    open: str = ""
    live: str = ""
    naive: Evidence | None = None


# --- 1: contact forces that nobody computes -------------------------------------------------------


def rest_on_ground(masses: Array, wrong: bool) -> tuple[Array, Array]:
    """Return heights and reported forces of bodies that have come to rest on a soft ground."""
    stiffness, damping, step = 2000.0 * masses, 60.0 * masses, 1e-3
    height, speed, reported = (np.zeros(len(masses)) for _ in range(3))
    for _ in range(1500):
        push = np.maximum(-stiffness * height - damping * speed, 0.0)
        speed += step * (push / masses - GRAVITY)
        height += step * speed
        if not wrong:  # the pass that a newer engine leaves to the caller
            reported[:] = push
    return height, reported


def rest_evidence(wrong: bool, seed: int) -> float:
    """Return how far the ground's reported force is from the weight, for five random bodies."""
    masses = np.random.default_rng(seed).uniform(0.1, 10.0, 5)
    return invariants.weight_error(rest_on_ground(masses, wrong)[1], masses)


def rest_naive(wrong: bool, seed: int) -> float:
    """Return whether the bodies stand as deep as they should.

    The motion is right without the report.
    """
    masses = np.random.default_rng(seed).uniform(0.1, 10.0, 5)
    return invariants.gap(rest_on_ground(masses, wrong)[0], np.full(5, -GRAVITY / 2000.0))


# --- 2: feet that are not alike -------------------------------------------------------------------


def push_off(state: Array, pushes: Array, wrong: bool) -> Array:
    """Return speed forwards and of yaw after a step in which the left and the right foot push."""
    friction = np.array([1.9, 0.9]) if wrong else np.array([1.9, 1.9])
    bound = friction * GRAVITY / 2.0  # of a unit mass on two feet
    left, right = np.clip(pushes, -bound, bound)
    return state + 0.01 * np.array([left + right, right - left])


def push_evidence(wrong: bool, seed: int) -> float:
    """Return how far a random push off the ground violates mirror symmetry."""
    rng = np.random.default_rng(seed)
    state, pushes = rng.normal(size=2), rng.uniform(1.0, 1.8, 2) * GRAVITY / 2.0
    step = partial(push_off, wrong=wrong)
    return invariants.mirror_error(
        step, lambda s: s * [1.0, -1.0], lambda u: u[::-1], state, pushes
    )


# --- 3: cart and pole -----------------------------------------------------------------------------

CART, POLE, HALF = 1.0, 0.1, 0.5  # kg, kg, m


def cart_pole(state: Array, step: float, velocity_first: bool, wrong: bool) -> Array:
    """Return one step of (position, speed, angle, rate) without a force.

    The order of the updates is the right or the wrong one.
    """
    x, v, angle, rate = state
    sin, cos, total = np.sin(angle), np.cos(angle), CART + POLE
    lever = total + POLE if wrong else POLE * HALF
    share = total if wrong else POLE
    push = lever * rate**2 * sin / total
    turn = (GRAVITY * sin - cos * push) / (HALF * (4.0 / 3.0 - share * cos**2 / total))
    pull = push - lever * turn * cos / total
    new_v, new_rate = v + step * pull, rate + step * turn
    if velocity_first:
        v, rate = new_v, new_rate
    return np.array([x + step * v, new_v, angle + step * rate, new_rate])


def cart_pole_drift(state: Array, velocity_first: bool, wrong: bool, step: float) -> float:
    """Return the largest change of energy in half a second, J."""

    def energy(s: Array) -> float:
        _, v, angle, rate = s
        moving = (CART + POLE) * v**2 / 2.0 + POLE * HALF * v * rate * np.cos(angle)
        return moving + POLE * HALF * (2.0 / 3.0 * HALF * rate**2 + GRAVITY * np.cos(angle))

    start, worst = energy(state), 0.0
    for _ in range(round(0.5 / step)):
        state = cart_pole(state, step, velocity_first, wrong)
        worst = max(worst, abs(energy(state) - start))
    return worst


def cart_pole_evidence(wrong: bool, seed: int) -> float:
    """Return the worse of the two orders of updates: neither is the slip."""
    rng = np.random.default_rng(seed)
    state = np.array([0.0, rng.uniform(-1, 1), rng.uniform(0.5, 2.5), rng.uniform(1.0, 3.0)])
    drifts = [partial(cart_pole_drift, state, first, wrong) for first in (False, True)]
    return max(invariants.refined_ratio(drift, 2e-3) for drift in drifts)


# --- 4: free fall that is none --------------------------------------------------------------------


def fall(mass: float, seconds: float, step: float, wrong: bool) -> float:
    """Return the speed gained in a free fall, m/s.

    Wrong is PyBullet's default: a damping of 0.04 that acts on the speed and on its square, so that
    nothing falls faster than 15 m/s, and a limit of 100 m/s, which only a body without damping
    ever meets.
    """
    speed = 0.0
    for _ in range(round(seconds / step)):
        damping = 0.04 * speed * (1.0 + abs(speed)) if wrong else 0.0
        speed += step * ((mass * GRAVITY) / mass - damping)
        if wrong:
            speed = min(speed, 100.0)
    return speed


def fall_evidence(wrong: bool, seed: int) -> float:
    """Return how far a random free fall departs from gravity times time."""
    rng = np.random.default_rng(seed)
    seconds = float(rng.integers(1, 20))
    mass, step = float(rng.uniform(0.1, 100.0)), 1.0 / int(rng.integers(20, 200))
    return invariants.fall_error(fall(mass, seconds, step, wrong), seconds, GRAVITY)


def fall_naive(wrong: bool, seed: int) -> float:
    """Return galileo's check alone: a light and a heavy body fall alike."""
    light, heavy = np.random.default_rng(seed).uniform([0.1, 10.0], [1.0, 100.0])
    return invariants.gap(fall(light, 2.0, 0.01, wrong), fall(heavy, 2.0, 0.01, wrong))


# --- 5, 6: quaternions ----------------------------------------------------------------------------


def product(p: Array, q: Array) -> Array:
    """Return the product of two quaternions (w, x, y, z)."""
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.append(w, p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))


def turned(q: Array, v: Array) -> Array:
    """Return a vector of the body, turned by a unit quaternion into the world."""
    return product(product(q, np.append(0.0, v)), q * [1, -1, -1, -1])[1:]


def drawn(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return an orientation, a unit quaternion, and a vector of length 2."""
    q, v = rng.normal(size=4), rng.normal(size=3)
    return q / np.linalg.norm(q), 2.0 * v / np.linalg.norm(v)


def write_rate(q: Array, world: Array, wrong: bool) -> Array:
    """Return the stored rate, in the body's frame, for one that is given in the world's."""
    return world if wrong else turned(q * [1, -1, -1, -1], world)


def write_evidence(wrong: bool, seed: int) -> float:
    """Return how far a rate that was written differs from the rate that is read back."""
    q, rate = drawn(np.random.default_rng(seed))
    return invariants.write_read_error(
        partial(turned, q), lambda _, shown: write_rate(q, shown, wrong), rate
    )


def quaternion_rate(q: Array, world: Array, wrong: bool) -> Array:
    """Rate of a quaternion from the angular velocity in the world; wrong takes it as the body's."""
    w = np.append(0.0, world)
    return 0.5 * (product(q, w) if wrong else product(w, q))


def angular_velocity(q: Array, rate: Array, wrong: bool) -> Array:
    """Return the inverse of `quaternion_rate`, with the same slip."""
    back = q * [1, -1, -1, -1]
    return 2.0 * (product(back, rate) if wrong else product(rate, back))[1:]


def momentum_evidence(wrong: bool, seed: int) -> float:
    """Return the angular momentum, in the world, of a body that turns freely for half a second."""
    q, rate = drawn(np.random.default_rng(seed))
    inertia, step = np.array([1.0, 2.0, 3.0]), 0.01

    def slope(s: Array) -> Array:
        q, w = s[:4], s[4:]
        turn = quaternion_rate(q, turned(q, w), wrong)
        return np.append(turn, np.cross(inertia * w, w) / inertia)

    state, momenta = np.append(q, rate), [turned(q, inertia * rate)]
    for _ in range(50):
        one = slope(state)
        two = slope(state + step / 2 * one)
        three = slope(state + step / 2 * two)
        state = state + step / 6 * (one + 2 * two + 2 * three + slope(state + step * three))
        unit = state[:4] / np.linalg.norm(state[:4])
        momenta.append(turned(unit, inertia * state[4:]))
    return invariants.kept_error(momenta)


def quaternion_naive(wrong: bool, seed: int) -> float:
    """Return there and back: two maps that are wrong in the same way are inverses all the same."""
    q, rate = drawn(np.random.default_rng(seed))
    forward, back = (partial(f, q, wrong=wrong) for f in (quaternion_rate, angular_velocity))
    return invariants.round_trip_error(forward, back, rate)


# --- 7: the acceleration of a point ---------------------------------------------------------------


def wheel(t: float, radius: float, rate: float, wrong: bool) -> tuple[Array, Array]:
    """Return the velocity of a point of a wheel that starts to turn, and its acceleration."""
    angle, turn, more = rate * t + t * t, rate + 2.0 * t, 2.0
    along = radius * np.array([-np.sin(angle), np.cos(angle)])
    inwards = -radius * np.array([np.cos(angle), np.sin(angle)])
    # The spatial acceleration is of whatever passes there: it lacks the part to the axis.
    return turn * along, more * along + (0.0 if wrong else 1.0) * turn**2 * inwards


def wheel_evidence(wrong: bool, seed: int) -> float:
    """Return how far the stated acceleration is from the derivative of the velocity."""
    radius, rate, t = np.random.default_rng(seed).uniform(0.5, 2.0, 3)
    return invariants.derivative_error(
        lambda s: wheel(s, radius, rate, wrong)[0], lambda s: wheel(s, radius, rate, wrong)[1], t
    )


# --- 8: a rotation that mirrors -------------------------------------------------------------------


def align(source: Array, target: Array, wrong: bool) -> Array:
    """Return the rotation that turns the vectors of one set onto those of another, shape (n, 3)."""
    u, _, vt = np.linalg.svd(target.T @ source)
    flip = 1.0 if wrong else np.sign(np.linalg.det(u @ vt))
    return u @ np.diag([1.0, 1.0, flip]) @ vt


def align_pairs(seed: int) -> list[tuple[Array, Array]]:
    """Return sets of two vectors and their images.

    Two vectors leave the sign of the third axis to chance.
    """
    rng, pairs = np.random.default_rng(seed), []
    for _ in range(40):
        source, (q, _) = rng.normal(size=(2, 3)), drawn(rng)
        pairs.append((source, np.array([turned(q, v) for v in source])))
    return pairs


def align_evidence(wrong: bool, seed: int) -> float:
    """Return how far the alignments of the random pairs are from rotations."""
    return max(invariants.rotation_error(align(*pair, wrong)) for pair in align_pairs(seed))


def align_naive(wrong: bool, seed: int) -> float:
    """Return whether the vectors are met: those of a mirror are, too."""
    return max(invariants.gap(a @ align(a, b, wrong).T, b) for a, b in align_pairs(seed))


# --- 9, 10: trees of a planner --------------------------------------------------------------------

START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])


def plan(rng: np.random.Generator, closed: bool, wrong: bool) -> Array | None:
    """Return a path through a wall at the middle of the unit square, or None if none was found."""
    nodes, parents = [START], [-1]
    for n in range(400):
        sample = GOAL if n % 10 == 0 else rng.uniform(0.0, 1.0, 2)
        near = int(np.argmin([np.linalg.norm(sample - node) for node in nodes]))
        route = sample - nodes[near]
        new = nodes[near] + route * min(1.0, 0.1 / (np.linalg.norm(route) or 1.0))
        if abs(new[0] - 0.5) < 0.1 and (closed or new[1] < 0.7):
            continue
        nodes.append(new)
        parents.append(near)
        if np.array_equal(new, GOAL):
            break
    at = int(np.argmin([np.linalg.norm(node - GOAL) for node in nodes]))
    if not (wrong or np.array_equal(nodes[at], GOAL)):
        return None
    path = [at]
    while parents[path[-1]] >= 0:
        path.append(parents[path[-1]])
    return np.array([nodes[i] for i in reversed(path)])


def plan_evidence(wrong: bool, seed: int, closed: bool = True) -> float:
    """Return how far a planned path misses its start or its goal."""
    path = plan(np.random.default_rng(seed), closed, wrong)
    return invariants.ends_error(path, START, GOAL)


def plan_naive(wrong: bool, seed: int) -> float:
    """Return the same in a world with a way: there both of them reach the goal."""
    return plan_evidence(wrong, seed, closed=False)


def rewired(points: Array, wrong: bool) -> tuple[list[int], Array]:
    """Return the parents and costs of a tree that new nodes shorten.

    The wrong version does not update the branches.
    """
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    parents, costs = [-1], np.zeros(len(points))
    for new in range(1, len(points)):
        near = int(np.argmin(distance[new, :new]))
        parents.append(near)
        costs[new] = costs[near] + distance[near, new]
        for node in range(1, new):
            gain = costs[node] - costs[new] - distance[new, node]
            if distance[new, node] < 0.4 and gain > 0.0:
                parents[node] = new
                costs[node] -= gain
                branch = [] if wrong else [node]
                while branch:
                    above = branch.pop()
                    below = [i for i, parent in enumerate(parents) if parent == above]
                    costs[below] -= gain
                    branch += below
    return parents, costs


def rewired_evidence(wrong: bool, seed: int) -> float:
    """Return the worst node of a growing tree.

    A branch with a stale cost may be rewired, and so corrected, later.
    """
    # Large enough that a node with a branch is rewired: of 80 nodes one tree in 250 has none.
    points = np.random.default_rng(seed).uniform(0.0, 1.0, (160, 2))
    grown = [points[:n] for n in range(10, 161, 5)]
    return max(invariants.tree_error(part, *rewired(part, wrong)) for part in grown)


# --- 11, 12, 13: episodes -------------------------------------------------------------------------


def advantages(rewards: Array, values: Array, ends: Array, last: float, wrong: bool) -> Array:
    """Return generalised advantages (Schulman et al., 2016).

    Wrong asks the next step for the end.
    """
    going = 1.0 - np.asarray(ends, dtype=float)
    if wrong:
        going = np.append(going[1:], going[-1])
    result, after, ahead = np.zeros(len(rewards)), 0.0, last
    for t in reversed(range(len(rewards))):
        error = rewards[t] + 0.99 * ahead * going[t] - values[t]
        result[t] = after = error + 0.99 * 0.95 * going[t] * after
        ahead = values[t]
    return result


def advantages_evidence(wrong: bool, seed: int) -> float:
    """Return how far advantages of episodes in one batch differ from those of each alone."""
    rng = np.random.default_rng(seed)
    episodes = [tuple(rng.normal(size=(2, n))) for n in rng.integers(2, 10, 3)]
    return invariants.episodes_error(partial(advantages, wrong=wrong), episodes)


def learned_value(discount: float, limit: int, wrong: bool) -> float:
    """Return the value that temporal differences learn for a reward of 1 a step.

    Episodes have a step limit.
    """
    value = 0.0
    for step in range(1, 4001):
        over = step % limit == 0
        value += 0.1 * (1.0 + (0.0 if over and wrong else discount * value) - value)
    return value


def learned_evidence(wrong: bool, seed: int) -> float:
    """Return how far a value learned under a time limit is from that of an endless task."""
    rng = np.random.default_rng(seed)
    discount, limit = float(rng.uniform(0.5, 0.95)), int(rng.integers(5, 20))
    return invariants.forever_error(learned_value(discount, limit, wrong), discount)


def stored(lengths: Sequence[int], wrong: bool) -> tuple[Array, Array]:
    """Return clocks before and after each stored step of an environment with next-step reset."""
    steps, clock, ended = [], 0, False
    for length in lengths:
        while True:
            after = 0 if ended else clock + 1
            if wrong or not ended:
                steps.append((clock, after))
            clock, ended = after, not ended and after == length
            if ended:
                break
    before, after = np.array(steps, dtype=float).T
    return before, after


def stored_evidence(wrong: bool, seed: int) -> float:
    """Return how many stored steps go back in time, are missing or are too many."""
    lengths = np.random.default_rng(seed).integers(1, 10, 4).tolist()
    return invariants.stored_error(*stored(lengths, wrong), lengths)


# --- 14: layers that nobody reads -----------------------------------------------------------------


def decoded(layers: Array, x: Array, wrong: bool) -> Array:
    """Return what a head reads from layers (7, n, n) of which each hands out its output."""
    outputs = []
    for layer in layers:
        x = x + np.tanh(layer @ x)
        outputs.append(x)
    return outputs[0] if wrong else outputs[-1]


def decoded_evidence(wrong: bool, seed: int) -> float:
    """Return how many of the seven layers have no gradient."""
    rng = np.random.default_rng(seed)
    layers, x = rng.normal(size=(7, 2, 2)) / 2.0, rng.normal(size=2)
    gradients = {f"layer {k}": np.zeros((2, 2)) for k in range(7)}
    for k, i, j in np.ndindex(layers.shape):
        more = layers.copy()
        more[k, i, j] += 1e-4
        change = decoded(more, x, wrong) - decoded(layers, x, wrong)
        gradients[f"layer {k}"][i, j] = change.sum() / 1e-4
    return float(len(invariants.idle_parameters(gradients)))


# --- The exhibits ---------------------------------------------------------------------------------

EXHIBITS = (
    Exhibit(
        "contact forces of zero",
        ("openai/gym#1541", "openai/gym#2593"),
        (2019, 2022),
        "The last 84 of the 111 numbers that an ant sees, its contact forces, are always zero.",
        "From MuJoCo 2.0 on, mj_rnePostConstraint is called by those who need the forces.",
        "weight_error",
        1e-6,
        rest_on_ground,
        rest_evidence,
        live="MuJoCo: cfrc_ext stays zero until mj_rnePostConstraint is called.",
        naive=rest_naive,
    ),
    Exhibit(
        "feet that are not alike",
        ("Farama-Foundation/Gymnasium#477", "openai/gym#1068", "openai/gym#1646"),
        (2023, 2018, 2019),
        "One foot of the walker has a friction of 0.9, the other one of 1.9.",
        "Crazy that it was not fixed for v4; 1.9 or 2.0 was meant. Version 5 has another model.",
        "mirror_error",
        1e-9,
        push_off,
        push_evidence,
        live="Gymnasium: walker2d.xml still ships; its own comment says to keep the two frictions.",
    ),
    Exhibit(
        "a cart-pole with wrong equations",
        ("PufferAI/PufferLib#447", "openai/gym#907"),
        (2026, 2018),
        "PufferLib adds masses for the lever of the pole, and takes the whole mass where the "
        "pole's belongs. In Gym the order of the updates was called wrong.",
        "Gym: the new order is valid, but so is the old one (openai/gym#1018). PufferLib gave "
        "the reporter credit.",
        "refined_ratio",
        0.4,
        cart_pole,
        cart_pole_evidence,
    ),
    Exhibit(
        "a free fall that slows down",
        ("bulletphysics/bullet3#2655", "bulletphysics/bullet3#1890"),
        (2020, 2018),
        "A robot that is loaded with default parameters accelerates less and less as it falls.",
        "There is a clamp on the velocity, 100 by default; maxJointVelocity in changeDynamics "
        "raises it. What slows the fall long before is the default damping of 0.04, which acts on "
        "the speed and on its square; linearDamping in changeDynamics sets it.",
        "fall_error",
        1e-9,
        fall,
        fall_evidence,
        live="PyBullet: by default a body falls at 15 m/s at most, -0.04 v (1 + |v|) beside g.",
        naive=fall_naive,
    ),
    Exhibit(
        "read in one frame, written in another",
        ("mujocolab/mjlab#293", "google-deepmind/mujoco#243"),
        (2025, 2022),
        "Writing the root velocity that was just read is not without effect: read in the world, "
        "the angular part is written as the body's.",
        "MuJoCo: angular velocities of a free joint live in the local frame, by design. mjlab "
        "converts since mujocolab/mjlab#297.",
        "write_read_error",
        1e-9,
        write_rate,
        write_evidence,
        live="MuJoCo: qvel of a free joint and mj_objectVelocity have two frames.",
    ),
    Exhibit(
        "the rate of a quaternion in the wrong frame",
        ("RobotLocomotion/drake#4532", "RobotLocomotion/drake#4604"),
        (2016, 2016),
        "The map from the rate of a quaternion to an angular velocity, and back, is broken.",
        "There are two versions of the map, by the frame of the angular velocity: the review asks "
        "to say which. Mended in drake#4965.",
        "kept_error",
        1e-6,
        quaternion_rate,
        momentum_evidence,
        naive=quaternion_naive,
    ),
    Exhibit(
        "an acceleration of no point",
        ("stack-of-tasks/pinocchio#2141", "stack-of-tasks/pinocchio#1395"),
        (2024, 2021),
        "The derivative of the Jacobian times the speed is not the classical acceleration.",
        "There are two accelerations, spatial and classical; a remark at "
        "getFrameClassicalAcceleration came with pinocchio#2169.",
        "derivative_error",
        1e-6,
        wheel,
        wheel_evidence,
        open="What was answered in the two threads themselves.",
        live="Pinocchio: getFrameAcceleration is the spatial one.",
    ),
    Exhibit(
        "a rotation that mirrors",
        ("scipy/scipy#10444", "isl-org/Open3D#2206"),
        (2019, 2020),
        "Matching vectors, or boxing points, sometimes gives a matrix of determinant -1.",
        "SciPy: correct and absolutely necessary (scipy#10531); the source asks for it and it was "
        "overlooked.",
        "rotation_error",
        1e-9,
        align,
        align_evidence,
        naive=align_naive,
    ),
    Exhibit(
        "solved without the goal",
        ("moveit/moveit#1920", "moveit/moveit2#2455"),
        (2020, 2023),
        "Segments of a grasp hardly moved and did not reach their goal; the arm jumped to the "
        "next one. An approximate solution had counted as success, with a warning.",
        "Such a solution is not suitable for execution: mended in moveit#3257, and in MoveIt 2 "
        "a year later, as the mending had not been carried over.",
        "ends_error",
        1e-9,
        plan,
        plan_evidence,
        live="OMPL: the status of an approximate solution counts as true.",
        naive=plan_naive,
    ),
    Exhibit(
        "costs that stay behind",
        ("AtsushiSakai/PythonRobotics#208",),
        (2019,),
        "After rewiring, the costs of the nodes below are never updated.",
        "Asked for a change, then mended: propagate_cost_to_leaves.",
        "tree_error",
        1e-9,
        rewired,
        rewired_evidence,
    ),
    Exhibit(
        "ends shifted by one",
        ("DLR-RM/stable-baselines3#105", "DLR-RM/stable-baselines3#183"),
        (2020, 2020),
        "The buffer keeps the ends of this step where the advantages expect those of the last.",
        "Off-by-one errors are hard to iron out, even when learning curves are compared. Tested "
        "since stable-baselines3#375.",
        "episodes_error",
        1e-9,
        advantages,
        advantages_evidence,
    ),
    Exhibit(
        "a time limit taken for an end",
        ("DLR-RM/stable-baselines3#284", "DLR-RM/stable-baselines3#633"),
        (2021, 2021),
        "A task without an end is cut by a limit, and what would follow counts as worth nothing.",
        "The discounted value of the last state is added to the reward (stable-baselines3#658).",
        "forever_error",
        1e-3,
        learned_value,
        learned_evidence,
    ),
    Exhibit(
        "steps across a reset",
        ("vwxyzjn/cleanrl#499",),
        (2025,),
        "With the newer reset, in the next step, a stored step may lead from an end to a start.",
        "All files would have to change; the older reset came back as a mode (Gymnasium#1227).",
        "stored_error",
        0.0,
        stored,
        stored_evidence,
        live="Gymnasium: a vector environment resets in the next step by default.",
    ),
    Exhibit(
        "layers that nobody reads",
        ("tonyzhaozh/act#25", "huggingface/lerobot#193"),
        (2024, 2024),
        "The head of a decoder of seven layers reads the output of the first.",
        "Not answered by the authors in what was seen. LeRobot keeps one layer, and says why.",
        "idle_parameters",
        0.0,
        decoded,
        decoded_evidence,
    ),
)


def exhibit(name: str) -> Exhibit:
    """Return the exhibit of a name.

    Raises:
        ValueError: for a name that there is not.
    """
    for one in EXHIBITS:
        if one.name == name:
            return one
    raise check.invalid("name", name, f"one of {', '.join(one.name for one in EXHIBITS)}")
