"""Claims about the state of a body, Euler angles and quaternions."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from course.derivations import claim

_AXES = np.eye(3)


def _orders() -> list[Any]:
    """Return the orders of three turns about body axes."""
    return [o for o in itertools.product(range(3), repeat=3) if o[0] != o[1] != o[2]]


def _state_rank(spatial: bool) -> tuple[int, int]:
    """Return (numbers stored, independent directions among them) of a body's state.

    Two states differ if they move four marked points of the body differently, so the rank of the
    map from the state to the points' positions and velocities counts what is independent.
    """
    from course.rigid_body import quaternion

    # Four points that aren't in a plane: their motion determines the body's.
    marks = np.column_stack((np.zeros(3), _AXES))

    def observed(state: np.ndarray) -> np.ndarray:
        if not spatial:
            x, y, angle, vx, vy, rate = state
            c, s = np.cos(angle), np.sin(angle)
            arms = np.array([[c, -s], [s, c]]) @ marks[:2]
            turning = rate * np.array([-arms[1], arms[0]])
            return np.concatenate([(arms.T + [x, y]).ravel(), (turning.T + [vx, vy]).ravel()])
        q = quaternion.normalise(state[3:7])
        arms = quaternion.rotate(q, marks)
        turning = quaternion.rotate(q, np.cross(state[10:], marks.T).T)
        return np.concatenate([(arms.T + state[:3]).ravel(), (turning.T + state[7:10]).ravel()])

    # A generic state; at a special one the rank could be lower.
    base = np.random.default_rng(1).uniform(0.1, 1.0, 13 if spatial else 6)
    if spatial:
        base[3:7] = quaternion.normalise(base[3:7])
    moves = 1e-6 * np.eye(base.size)
    jacobian = [(observed(base + e) - observed(base - e)) / 2e-6 for e in moves]
    return base.size, int(np.linalg.matrix_rank(np.array(jacobian), tol=1e-6))


def _turns(order: Sequence[int], middle: float) -> np.ndarray:
    """Return the body axes of the three rates of an order, as rows, at a middle angle [rad].

    The last turn is left at zero: it rotates all three axes alike.
    """
    from course.rigid_body import quaternion

    a, b, c = order
    # The first axis as seen from the body, after the middle turn.
    back = quaternion.conjugate(quaternion.exp(middle * _AXES[b]))
    return np.array([quaternion.rotate(back, _AXES[a]), _AXES[b], _AXES[c]])


def _rank(rows: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-12))


def _spun(
    rate: np.ndarray, h: float, steps: int, after: Callable[[np.ndarray], np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return quaternions after `steps` of a steady spin, by adding the rate and by the exponential.

    Args:
        rate: body rate [rad/s].
        h: step [s].
        steps: number of steps.
        after: what is done to the first after each step, or None.
    """
    from course.rigid_body import quaternion

    added = retained = quaternion.identity()
    turn = quaternion.exp(h * rate)
    for _ in range(steps):
        added = added + h * quaternion.derivative(added, rate)
        added = after(added) if after else added
        retained = quaternion.product(retained, turn)
    return added, retained


@claim(
    "Six quantities describe the state of a rigid body completely.",
    "The state has {independent:g} independent numbers: 3 for the position, 3 for the orientation "
    "and 6 for their rates. Six numbers give the pose alone, or the state of a planar body.",
)
def state_is_six_quantities(result):
    rank = result.measure("independent", _state_rank(spatial=True)[1])
    pose = result.measure("pose", rank // 2)
    result.statement = (
        f"The motion of four marked points tells {rank} directions of the state apart."
    )
    result.statement_holds(rank == 6)
    result.correction_holds(rank == 12, pose == 6 == _state_rank(spatial=False)[1])


@claim(
    "With a quaternion the state of a rigid body is 13 numbers.",
    "{stored:g} numbers are stored, {independent:g} are independent: one goes to the unit length. "
    "MuJoCo's free joint stores {mujoco_nq:g} positions and {mujoco_nv:g} velocities.",
)
def state_with_quaternion(result):
    import mujoco

    stored, rank = _state_rank(spatial=True)
    free = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(free)
    result.measure("stored", stored)
    result.measure("independent", rank)
    result.measure("mujoco_nq", model.nq)
    result.measure("mujoco_nv", model.nv)
    result.statement = f"{stored} numbers stored, rank {rank}; MuJoCo has {model.nq} + {model.nv}."
    result.statement_holds(stored == 13 == model.nq + model.nv)
    result.correction_holds(rank == stored - 1, (model.nq, model.nv) == (7, 6))


@claim(
    "A rigid body that moves in a plane has six state numbers.",
    "Two for the position, one angle, and their three rates; all six are independent.",
)
def planar_state(result):
    from course.rigid_body import PlanarBody

    stored, rank = _state_rank(spatial=False)
    result.measure("stored", PlanarBody().state.size)
    result.measure("independent", rank)
    result.statement = f"{stored} numbers stored, rank {rank}."
    result.statement_holds(stored == PlanarBody().state.size == 6)
    result.correction_holds(rank == 6)


@claim(
    "There is an orientation at which Euler angles lose a degree of freedom.",
    "At a pitch of +-{lock_deg:g} degrees, whatever the other two, the matrix from ZYX angle rates "
    "to angular velocity has rank {rank_at_90:g}. Near it the smallest singular value is sqrt(1 - "
    "|sin(pitch)|), so the trouble begins long before: one orientation in a hundred lies within "
    "{hundredth_deg:.1f} degrees of the lock.",
    source="Diebel, Representing attitude (2006)",
)
def gimbal_lock_rank(result):
    from course.rigid_body import quaternion

    def smallest(pitch: float, roll: float = 0.4) -> float:
        matrix = quaternion.euler_zyx_rate_matrix(np.radians(pitch), roll)
        return float(np.linalg.svd(matrix)[1][-1])

    def rank(pitch: float, roll: float = 0.4) -> int:
        return _rank(quaternion.euler_zyx_rate_matrix(np.radians(pitch), roll))

    lock = result.input("lock_deg", 90.0)
    result.measure("rank_at_90", rank(lock))
    result.measure("rank_at_89", rank(89.0))
    result.measure("smallest_at_89", smallest(89.0))
    q = quaternion.normalise(result.rng.normal(size=(4, 100_000)))
    # Uniform orientations, by normalising Gaussian quaternions; then sin(pitch) is uniform.
    sines = np.abs(np.sin(quaternion.to_euler_zyx(q)[1]))
    near = result.measure("hundredth_deg", np.degrees(np.arccos(0.99)))
    result.statement = (
        "Rank and smallest singular value of the chapter's rate matrix; of 100,000 random "
        f"orientations {np.mean(sines > 0.99):.2%} have a pitch within {near:.1f} degrees of the "
        "lock."
    )
    # Up to 0.1 degree from the lock, where a rank with a loose tolerance would drop.
    draws = result.rng.uniform((-89.9, -3), (89.9, 3), (50, 2))
    result.statement_holds(rank(-lock) == rank(lock) == 2)
    result.correction_holds(
        all(rank(side * lock, roll) == 2 for side in (-1, 1) for _, roll in draws),
        all(rank(*d) == 3 for d in draws),
        all(abs(smallest(*d) - np.sqrt(1 - abs(np.sin(np.radians(d[0]))))) < 1e-9 for d in draws),
        abs(np.mean(sines > 0.99) - 0.01) < 0.002,
    )


@claim(
    "Euler angles are singular at one attitude.",
    "At two circles of attitudes: nose straight up or straight down, and then any heading. There "
    "yaw and roll turn about the same line, so their difference (their sum) is all that counts and "
    "one of them can be chosen freely.",
)
def gimbal_lock_at_one_attitude(result):
    from course.rigid_body import quaternion

    def locked(yaw: float, side: int, roll: float) -> np.ndarray:
        return quaternion.from_euler_zyx(yaw, side * np.pi / 2, roll)

    up, down = [locked(0.0, 1, 0.0), locked(0.0, -1, 0.0)]
    angles = result.rng.uniform(-np.pi, np.pi, (100, 3))
    # Adding d to the yaw and +-d to the roll must move nothing, for any d.
    same = max(
        float(quaternion.angle_between(locked(y, s, r), locked(y + d, s, r + s * d)))
        for y, r, d in angles
        for s in (-1, 1)
    )
    headings = [float(quaternion.angle_between(up, locked(y, 1, 0.0))) for y in angles[:, 0]]
    result.measure("furthest_apart_rad", max(headings), 0.05)
    result.measure("up_to_down_rad", quaternion.angle_between(up, down))
    result.statement = (
        f"Locked attitudes with one nose direction are up to {max(headings):.2f} rad apart; adding "
        f"the same to yaw and roll moves nothing ({same:.0e} rad)."
    )
    result.statement_holds(max(headings) < 1e-6)
    result.correction_holds(same < 1e-7, max(headings) > 3)


@claim(
    "Point straight up, and turning left and rolling become the same motion.",
    "They become the same motion of two angles, not of the body: it can still turn about three "
    "axes. And where that happens is a choice: of the twelve orders of angles {locked_up:g} lock "
    "after one turn about y points the x axis straight up, the others elsewhere. Only yaw, pitch, "
    "roll, in this order, locks there with every heading.",
)
def pointing_up_locks(result):
    from course.rigid_body import quaternion

    up = quaternion.exp(np.array([0.0, -np.pi / 2, 0.0]))  # takes the body's x axis to z

    def locks(order: Sequence[int], heading: float = 0.0, roll: float = 0.0) -> bool:
        """Return whether the order is singular with the nose up, by its direction cosines.

        An order a-b-c locks where its first axis, fixed in the world, and its last, fixed in the
        body, are parallel.
        """
        turned = quaternion.product(quaternion.exp(heading * _AXES[2]), up)
        turned = quaternion.product(turned, quaternion.exp(roll * _AXES[0]))
        return bool(abs(quaternion.rotate(turned, _AXES[order[2]])[order[0]]) > 1 - 1e-12)

    # All twelve orders, so the number is counted and not sampled.
    locked = [order for order in _orders() if locks(order)]
    zyx = quaternion.euler_zyx_rate_matrix(np.pi / 2, 0.3)
    headings = result.rng.uniform(0.1, 1.4, (8, 2))
    result.measure("locked_up", len(locked))
    result.measure("rank_of_zyx", _rank(zyx))
    result.statement = f"Locked there: {', '.join(''.join('xyz'[i] for i in o) for o in locked)}."
    result.statement_holds(
        len(locked) == len(_orders()),
        only_if="yaw, about the vertical, is the first of the angles and roll, about the nose, the "
        "last",
        # Chosen to break it: the nose is up, but with any heading and any roll.
        inside=[locks((2, 1, 0), *angles) for angles in headings],
        outside=[
            locks(order, *angles)
            for order in _orders()
            if order != (2, 1, 0)
            for angles in headings
        ],
        cases=True,
    )
    result.correction_holds(
        _rank(zyx) == 2,
        0 < len(locked) < len(_orders()),
        [o for o in _orders() if all(locks(o, *angles) for angles in headings)] == [(2, 1, 0)],
        locks((0, 1, 2)) and not locks((0, 1, 2), *headings[0]),
    )


@claim(
    "A body floats freely, and three angles describe it. In gimbal lock it can no longer turn "
    "about one of its axes.",
    "The body can rotate about every axis; only the three angles cannot follow. (If it hung in "
    "three real rings, as drawn above, these would block it.) To turn at one rad/s about the "
    "lost axis, the yaw rate has to be 1 / cos(pitch). At a pitch of {pitch_deg} degrees that "
    "is {yaw_rate_at_89_9:.0f} rad/s.",
)
def gimbal_lock_is_physical(result):
    from course.rigid_body import quaternion

    lost = np.array([0.0, 0.0, 1.0])  # body z, at roll 0: yaw and roll both turn about others
    start = quaternion.from_euler_zyx(0.3, np.pi / 2, 0.0)
    end = quaternion.product(start, quaternion.exp(0.5 * lost))
    turned = result.measure("turned_rad", float(quaternion.angle_between(start, end)))

    def yaw_rate(pitch: float) -> float:
        # The angle rates that a unit rate about the lost axis needs.
        return float(np.linalg.solve(quaternion.euler_zyx_rate_matrix(pitch, 0.0), lost)[0])

    result.measure("yaw_rate_at_89", yaw_rate(np.radians(89.0)))
    result.measure("yaw_rate_at_89_9", yaw_rate(np.radians(result.input("pitch_deg", 89.9))))
    result.statement = f"At the lock a quaternion turns by {turned:g} rad about the lost axis."
    result.statement_holds(turned < 0.4)
    result.correction_holds(
        abs(turned - 0.5) < 1e-12,
        all(abs(yaw_rate(p) * np.cos(p) - 1) < 1e-9 for p in result.rng.uniform(-1.57, 1.57, 50)),
    )


@claim(
    "Gimbal lock goes away with a better choice of the three angles.",
    "Each of the {sequences:g} sequences has it, at a middle angle of +-{lock_deg:g} degrees with "
    "three different axes and at 0 or {half_turn_deg:g} with a repeated one. No three numbers "
    "cover all orientations smoothly.",
    source="Stuelpnagel, On the parametrization of the three-dimensional rotation group (1964)",
)
def another_order_of_angles(result):
    lock, half = result.input("lock_deg", 90), result.input("half_turn_deg", 180)
    repeated = {order: order[0] == order[2] for order in _orders()}
    # A repeated axis locks where first and last axis coincide: at 0 and half a turn.
    places = {True: np.radians([0, half]), False: np.radians([-lock, lock])}
    singular = [
        order
        for order, again in repeated.items()
        if all(_rank(_turns(order, angle)) == 2 for angle in places[again])
    ]
    result.measure("sequences", len(repeated))
    result.measure("singular", len(singular))
    result.statement = (
        f"{sum(repeated[o] for o in singular)} of the {len(singular)} repeat an axis."
    )
    result.statement_holds(len(singular) < len(repeated))
    result.correction_holds(len(singular) == len(repeated) == 12)


@claim(
    "A quaternion has no gimbal lock, although it needs one more number than three angles.",
    "The map from the angular velocity to the quaternion's rate is equally good everywhere: all "
    "three singular values are 1/2 at every orientation. The price: a fourth number, a constraint "
    "on the length, and q and -q are the same orientation.",
)
def quaternion_has_no_lock(result):
    from course.rigid_body import quaternion

    values = []
    for q in quaternion.normalise(result.rng.normal(size=(4, 200))).T:
        # Columns of the map from body rates to the quaternion's rate.
        values.append(np.linalg.svd([quaternion.derivative(q, e) for e in _AXES])[1])
    low, high = float(np.min(values)), float(np.max(values))
    result.measure("smallest", low)
    result.measure("largest", high)
    result.statement = "Singular values over 200 random orientations."
    result.statement_holds(low > 0.1)
    result.correction_holds(abs(low - 0.5) < 1e-12, abs(high - 0.5) < 1e-12)


@claim(
    "Every orientation has exactly one unit quaternion.",
    "It has two, q and -q. A full turn takes q to -q, and comparing quaternions needs the nearer "
    "sign: half way between two orientations {apart_rad} rad apart the wrong sign lands "
    "{detour_rad:.2f} rad away.",
)
def quaternion_is_unique(result):
    from course.rigid_body import quaternion

    q = quaternion.normalise(np.array([0.3, -0.5, 0.7, 0.2]))
    same = float(np.abs(quaternion.to_matrix(q) - quaternion.to_matrix(-q)).max())
    # 360 turns of one degree: half the angle, so a full turn ends at -q.
    full = float(q @ quaternion.product(q, _spun(np.array([0.0, 0.0, np.pi / 180]), 1.0, 360)[1]))
    angle = result.input("apart_rad", 0.2)
    near = quaternion.product(q, quaternion.exp(np.array([angle, 0.0, 0.0])))
    middle = quaternion.normalise(0.5 * (q - near))  # with the wrong sign
    detour = float(quaternion.angle_between(q, middle))
    result.measure("dot_after_full_turn", full)
    result.measure("detour_rad", detour)
    result.statement = f"The matrices of q and -q differ by {same:g}."
    result.statement_holds(same > 1e-3)
    result.correction_holds(
        same == 0, abs(full + 1) < 1e-12, abs(detour - (np.pi - angle / 2)) < 1e-9
    )


@claim(
    "The exact equation keeps the quaternion's length, so an integrator keeps it too.",
    "Explicit Euler on the four numbers multiplies the length by sqrt(1 + (omega h / 2)^2) at "
    "every step: {length_after_10_s:.3f} after {steps:g} steps of {step_ms:g} ms at {rate:g} "
    "rad/s. The exponential map keeps it to rounding.",
)
def quaternion_norm_keeps_itself(result):
    spin = np.array([0.0, 0.6, 0.8]) * result.input("rate", 10.0)
    h, steps = result.input("step_ms", 1.0) / 1000, result.input("steps", 10_000)
    added, retained = (np.linalg.norm(q) for q in _spun(spin, h, steps))
    result.measure("length_after_10_s", added)
    result.statement = f"Length {added:.6f}; by the exponential map {abs(retained - 1):.1e} off 1."

    def deviation(rate: np.ndarray, step: float) -> float:
        # The added rate is orthogonal to q (Pythagoras), 50 steps of the root.
        grown = (1 + (np.linalg.norm(rate) * step / 2) ** 2) ** 25
        return float(np.linalg.norm(_spun(rate, step, 50)[0]) / grown - 1)

    result.statement_holds(abs(added - 1) < 1e-6)
    result.correction_holds(
        abs(retained - 1) < 1e-11,
        all(
            abs(deviation(5 * rate, step)) < 1e-12
            for *rate, step in result.rng.uniform(0, 0.3, (20, 4))
            for rate in [np.array(rate)]
        ),
    )


@claim(
    "Scaling the quaternion back to length one repairs the step that added its rate.",
    "The length is right again, the angle is not: a steady spin advances by 2 atan(omega h / 2) "
    "instead of omega h per step, short by (omega h)^3 / 12 to leading order: {behind_rad:.3f} rad "
    "after {steps:g} steps of {step_ms:g} ms at {rate:g} rad/s. The exponential map is exact "
    "there.",
)
def renormalising_repairs(result):
    import sympy

    from course.rigid_body import quaternion

    def behind(rate: np.ndarray, h: float, steps: int) -> tuple[float, float, float]:
        """Return how far (rescaled, by exponential, by the law) fall behind the true turn [rad]."""
        truth = quaternion.exp(rate * h * steps)
        ends = _spun(rate, h, steps, quaternion.normalise)
        angle = np.linalg.norm(rate) * h
        # Adding the rate moves q along a tangent; scaled back, it has turned by 2 atan(omega h /
        # 2).
        law = steps * (angle - 2 * np.arctan(angle / 2))
        first, second = (float(quaternion.angle_between(truth, end)) for end in ends)
        return first, second, law

    rate, h = result.input("rate", 10.0), result.input("step_ms", 10.0) / 1000
    rescaled, exact, law = behind(rate * _AXES[2], h, result.input("steps", 1000))
    u = sympy.Symbol("u", positive=True)
    lead = sympy.series(u - 2 * sympy.atan(u / 2), u, 0, 5).removeO().coeff(u, 3)
    result.measure("behind_rad", rescaled, 1e-4)
    result.measure("leading_coefficient", lead, 1e-4)
    result.statement = f"{rescaled:.4f} rad behind, by the exponential map {exact:.1e} rad."
    draws = [behind(x[:3] * 5, x[3], 20) for x in result.rng.uniform(0.01, 0.3, (20, 4))]
    result.statement_holds(rescaled < 1e-6)
    result.correction_holds(
        abs(rescaled / law - 1) < 1e-8,
        exact < 1e-11,
        lead == sympy.Rational(1, 12),
        all(abs(a / c - 1) < 1e-6 and b < 1e-7 for a, b, c in draws),
    )


@claim(
    "A quaternion that was added up instead of multiplied makes the energy of a free body grow.",
    "It turns the picture wrong, and its length is off; but a free body's energy is a matter of "
    "its body rates, and Euler's equations for those do not contain the quaternion: with the added "
    "one they come out the same to the last bit. (An engine that keeps world rates takes the "
    "inertia "
    "from the quaternion, and there it matters.)",
)
def added_quaternion_adds_energy(result):
    from course.rigid_body import problems, quaternion, rk4

    system, h = problems.tumble().system, 0.01
    a, params = system.acceleration, system.params
    right, wrong, v = system.q0, system.q0, system.v0
    wrong_v = v
    for _ in range(1000):
        wrong = wrong + h * quaternion.derivative(wrong, wrong_v)
        wrong_v = rk4(wrong, wrong_v, a, h, params)[1]
        right, v = rk4(right, v, a, h, params)
    angle = float(quaternion.angle_between(quaternion.normalise(wrong), right))
    gain = problems.tumble_energy(wrong, wrong_v, params) / problems.tumble_energy(
        system.q0, system.v0, params
    )
    result.measure("attitude_off_rad", angle, 1e-3)
    result.measure("energy_gained", round(float(gain) - 1, 6), 1e-6)
    result.statement = (
        f"1000 steps of RK4 at 10 ms: the attitudes are {angle:.4f} rad apart, the length is "
        f"{np.linalg.norm(wrong):.3f}, and the energy has changed by {gain - 1:.0e} of itself."
    )
    result.statement_holds(gain > 1.001)
    # Equal to the last bit, because the body rates' equation does not read the quaternion.
    result.correction_holds(np.array_equal(v, wrong_v), angle > 1e-3, abs(gain - 1) < 1e-6)
