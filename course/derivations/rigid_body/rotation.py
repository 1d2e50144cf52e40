"""Claims about the state of a body, Euler angles and quaternions."""

import numpy as np

from course.derivations import Finding, Verdict, claim


def _state_rank(spatial: bool) -> tuple[int, int]:
    """(numbers stored, independent directions among them) of a body's state.

    Two states differ if they move four marked points of the body differently, so the rank of the
    map from the state to the points' positions and velocities counts what is independent.
    """
    from course.rigid_body import quaternion

    marks = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

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

    if spatial:
        base = np.array([0.1, 0.2, 0.3, 0.5, -0.5, 0.1, 0.7, 1.0, 2.0, 3.0, 0.4, 0.5, 0.6])
        base[3:7] = quaternion.normalise(base[3:7])
    else:
        base = np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0])
    size = 1e-6
    jacobian = [
        (observed(base + size * e) - observed(base - size * e)) / (2 * size)
        for e in np.eye(base.size)
    ]
    return base.size, int(np.linalg.matrix_rank(np.array(jacobian), tol=1e-6))


@claim(
    "state_is_six_quantities",
    1,
    "Six quantities describe the state of a rigid body completely.",
    verdict=Verdict.FALSE,
    corrected="The state has 12 independent numbers: 3 for the position, 3 for the orientation and "
    "6 for their rates. Six numbers give the pose alone, or the state of a planar body.",
    figures={"independent": (12, 0), "pose": (6, 0)},
)
def _state_is_six_quantities() -> Finding:
    rank = _state_rank(spatial=True)[1]
    return Finding(
        {"independent": rank, "pose": rank // 2},
        f"The motion of four marked points tells {rank} directions of the state apart.",
        holds=rank == 6,
        corrected=rank == 12,
    )


@claim(
    "state_with_quaternion",
    1,
    "With a quaternion the state of a rigid body is 13 numbers.",
    verdict=Verdict.HOLDS,
    corrected="13 numbers are stored, 12 are independent: one goes to the unit length. MuJoCo's "
    "free joint stores 7 positions and 6 velocities.",
    figures={"stored": (13, 0), "independent": (12, 0), "mujoco_nq": (7, 0), "mujoco_nv": (6, 0)},
)
def _state_with_quaternion() -> Finding:
    import mujoco

    stored, rank = _state_rank(spatial=True)
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    return Finding(
        {"stored": stored, "independent": rank, "mujoco_nq": model.nq, "mujoco_nv": model.nv},
        f"{stored} numbers stored, rank {rank}; MuJoCo has nq + nv = {model.nq + model.nv}.",
        holds=stored == 13 == model.nq + model.nv,
        corrected=rank == 12 and (model.nq, model.nv) == (7, 6),
    )


@claim(
    "planar_state",
    1,
    "A rigid body that moves in a plane has six state numbers.",
    verdict=Verdict.HOLDS,
    corrected="Two for the position, one angle, and their three rates; all six are independent.",
    figures={"stored": (6, 0), "independent": (6, 0)},
)
def _planar_state() -> Finding:
    stored, rank = _state_rank(spatial=False)
    return Finding(
        {"stored": stored, "independent": rank},
        f"{stored} numbers stored, rank {rank}.",
        holds=stored == 6,
        corrected=rank == 6,
    )


@claim(
    "gimbal_lock_rank",
    1,
    "There is an orientation at which Euler angles lose a degree of freedom.",
    verdict=Verdict.HOLDS,
    corrected="At a pitch of +-90 degrees the matrix from ZYX angle rates to angular velocity has "
    "rank 2. Near it the smallest singular value is sqrt(1 - |sin(pitch)|), so the trouble "
    "begins long before.",
    figures={
        "rank_at_90": (2, 1e-6),
        "rank_at_89": (3, 1e-6),
        "smallest_at_89": (0.01234118, 1e-6),
    },
    source="Diebel, Representing attitude (2006)",
)
def _gimbal_lock_rank() -> Finding:
    from course.rigid_body.quaternion import euler_zyx_rate_matrix

    def smallest(pitch: float) -> float:
        return float(np.linalg.svd(euler_zyx_rate_matrix(np.radians(pitch), 0.4))[1][-1])

    ranks = [
        int(np.linalg.matrix_rank(euler_zyx_rate_matrix(np.radians(p), 0.4), tol=1e-12))
        for p in (-90.0, 89.0, 90.0)
    ]
    law = max(
        abs(smallest(p) - np.sqrt(1 - np.sin(np.radians(p)))) for p in (0.0, 30.0, 60.0, 85.0, 89.0)
    )
    return Finding(
        {"rank_at_90": ranks[2], "rank_at_89": ranks[1], "smallest_at_89": smallest(89.0)},
        "Rank and smallest singular value of the rate matrix that the chapter uses.",
        holds=ranks[0] == ranks[2] == 2 and ranks[1] == 3,
        corrected=law < 1e-9,
    )


@claim(
    "gimbal_lock_is_physical",
    1,
    "In gimbal lock the body can no longer turn about one of its axes.",
    verdict=Verdict.FALSE,
    corrected="The body turns as it likes; only the three angles cannot follow. A turn at 1 rad/s "
    "about the lost axis asks for a yaw rate of 1 / cos(pitch).",
    figures={
        "turned_rad": (0.5, 1e-6),
        "yaw_rate_at_89": (57.29869, 1e-6),
        "yaw_rate_at_89_9": (572.9581, 1e-6),
    },
)
def _gimbal_lock_is_physical() -> Finding:
    from course.rigid_body import quaternion

    lost = np.array([0.0, 0.0, 1.0])  # body z, at roll 0: yaw and roll both turn about others
    start = quaternion.from_euler_zyx(0.3, np.pi / 2, 0.0)
    end = quaternion.product(start, quaternion.exp(0.5 * lost))
    turned = float(quaternion.angle_between(start, end))
    rates = [
        float(np.linalg.solve(quaternion.euler_zyx_rate_matrix(np.radians(p), 0.0), lost)[0])
        for p in (89.0, 89.9)
    ]
    expected = [1 / np.cos(np.radians(p)) for p in (89.0, 89.9)]
    return Finding(
        {"turned_rad": turned, "yaw_rate_at_89": rates[0], "yaw_rate_at_89_9": rates[1]},
        f"At a pitch of 90 degrees a quaternion turns by {turned:g} rad about the lost axis.",
        holds=turned < 0.4,
        corrected=abs(turned - 0.5) < 1e-12 and np.allclose(rates, expected, rtol=1e-9),
    )


@claim(
    "another_order_of_angles",
    1,
    "Gimbal lock goes away with a better choice of the three angles.",
    verdict=Verdict.FALSE,
    corrected="Each of the twelve sequences has it, at a middle angle of +-90 degrees with three "
    "different axes and at 0 or 180 with a repeated one. No three numbers cover all "
    "orientations smoothly.",
    figures={"sequences": (12, 0), "singular": (12, 0)},
    source="Stuelpnagel, On the parametrization of the three-dimensional rotation group (1964)",
)
def _another_order_of_angles() -> Finding:
    from course.rigid_body import quaternion

    axes = np.eye(3)
    singular = {"three axes": 0, "repeated axis": 0}
    sequences = [(a, b, c) for a in range(3) for b in range(3) for c in range(3) if a != b != c]
    for a, b, c in sequences:
        lock = 0.0 if a == c else np.pi / 2
        back = quaternion.conjugate(quaternion.exp(lock * axes[b]))
        # Body axes about which the three rates turn, after the middle turn (the last is free).
        rates = np.array([quaternion.rotate(back, axes[a]), axes[b], axes[c]])
        if np.linalg.matrix_rank(rates, tol=1e-12) == 2:
            singular["repeated axis" if a == c else "three axes"] += 1
    total = singular["three axes"] + singular["repeated axis"]
    return Finding(
        {"sequences": len(sequences), "singular": total},
        f"{singular['three axes']} sequences of three axes and {singular['repeated axis']} with a "
        "repeated one, each of rank 2 at its lock.",
        holds=total < len(sequences),
        corrected=total == len(sequences) == 12,
    )


@claim(
    "quaternion_has_no_lock",
    1,
    "A quaternion has no gimbal lock; the price is one more number and a constraint.",
    verdict=Verdict.HOLDS,
    corrected="The map from angular velocity to quaternion rate has all three singular values "
    "equal to 1/2 at every orientation.",
    figures={"smallest": (0.5, 1e-6), "largest": (0.5, 1e-6)},
)
def _quaternion_has_no_lock() -> Finding:
    from course.rigid_body import quaternion

    points = np.random.default_rng(1).normal(size=(200, 4))
    values = []
    for q in points:
        q = quaternion.normalise(q)
        rates = np.array([quaternion.derivative(q, e) for e in np.eye(3)])
        values.append(np.linalg.svd(rates)[1])
    low, high = float(np.min(values)), float(np.max(values))
    return Finding(
        {"smallest": low, "largest": high},
        "Singular values over 200 random orientations.",
        holds=low > 0.1,
        corrected=abs(low - 0.5) < 1e-12 and abs(high - 0.5) < 1e-12,
    )


@claim(
    "quaternion_is_unique",
    1,
    "Every orientation has exactly one unit quaternion.",
    verdict=Verdict.FALSE,
    corrected="It has two, q and -q. A full turn takes q to -q, and comparing quaternions needs "
    "the nearer sign: a straight line from q to -q' goes the long way round.",
    figures={"dot_after_full_turn": (-1.0, 1e-6), "detour_rad": (3.041593, 1e-6)},
)
def _quaternion_is_unique() -> Finding:
    from course.rigid_body import quaternion

    q = quaternion.normalise(np.array([0.3, -0.5, 0.7, 0.2]))
    same = float(np.abs(quaternion.to_matrix(q) - quaternion.to_matrix(-q)).max())
    turned = q
    for _ in range(360):
        turned = quaternion.product(turned, quaternion.exp(np.array([0.0, 0.0, np.pi / 180])))
    full = float(q @ turned)
    near = quaternion.product(q, quaternion.exp(np.array([0.2, 0.0, 0.0])))
    naive = quaternion.normalise(0.5 * (q - near))  # midpoint with the wrong sign
    detour = float(quaternion.angle_between(q, naive))
    return Finding(
        {"dot_after_full_turn": full, "detour_rad": detour},
        f"The matrices of q and -q differ by {same:g}. Half way between two orientations 0.2 rad "
        f"apart, the wrong sign lands {detour:.2f} rad away.",
        holds=same > 1e-3,
        corrected=same == 0.0 and abs(full + 1) < 1e-12 and detour > 1.0,
    )


@claim(
    "quaternion_norm_keeps_itself",
    1,
    "The exact equation keeps the quaternion's length, so an integrator keeps it too.",
    verdict=Verdict.FALSE,
    corrected="Explicit Euler on the four numbers multiplies the length by "
    "sqrt(1 + (omega h / 2)^2) at every step. The exponential map keeps it to rounding.",
    figures={"length_after_10_s": (1.133147, 1e-6)},
)
def _quaternion_norm_keeps_itself() -> Finding:
    from course.rigid_body import quaternion

    spin, h, steps = np.array([0.0, 6.0, 8.0]), 1e-3, 10_000
    added = kept = np.array([1.0, 0.0, 0.0, 0.0])
    turn = quaternion.exp(h * spin)
    for _ in range(steps):
        added = added + h * quaternion.derivative(added, spin)
        kept = quaternion.product(kept, turn)
    length, drift = float(np.linalg.norm(added)), abs(float(np.linalg.norm(kept)) - 1)
    law = (1 + (10 * h / 2) ** 2) ** (steps / 2)
    return Finding(
        {"length_after_10_s": length},
        f"10 rad/s at 1 ms for 10 s: length {length:.6f}; by the exponential map {drift:.1e} "
        "off 1.",
        holds=abs(length - 1) < 1e-6,
        corrected=abs(length / law - 1) < 1e-9 and drift < 1e-11,
    )


@claim(
    "renormalising_repairs",
    1,
    "Scaling the quaternion back to length one repairs the step that added its rate.",
    verdict=Verdict.FALSE,
    corrected="The length is right again, the angle is not: a steady spin advances by "
    "2 atan(omega h / 2) instead of omega h per step, short by (omega h)^3 / 12. The "
    "exponential map is exact there.",
    figures={"behind_rad": (0.08320856, 1e-4), "leading_coefficient": (0.08333333, 1e-4)},
)
def _renormalising_repairs() -> Finding:
    import sympy

    from course.rigid_body import quaternion

    rate, h, steps = 10.0, 1e-2, 1000
    spin = np.array([0.0, 0.0, rate])
    added = kept = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(steps):
        added = quaternion.normalise(added + h * quaternion.derivative(added, spin))
        kept = quaternion.product(kept, quaternion.exp(h * spin))
    truth = quaternion.exp(np.array([0.0, 0.0, rate * h * steps]))
    behind = float(quaternion.angle_between(truth, added))
    exact = float(quaternion.angle_between(truth, kept))
    u = sympy.Symbol("u", positive=True)
    lead = sympy.series(u - 2 * sympy.atan(u / 2), u, 0, 5).removeO().coeff(u, 3)
    predicted = steps * (rate * h - 2 * np.arctan(rate * h / 2))
    return Finding(
        {"behind_rad": behind, "leading_coefficient": float(lead)},
        f"10 rad/s at 10 ms for 10 s: {behind:.4f} rad behind, by exponential {exact:.1e} rad.",
        holds=behind < 1e-6,
        corrected=abs(behind / predicted - 1) < 1e-8
        and exact < 1e-11
        and lead == sympy.Rational(1, 12),
    )
