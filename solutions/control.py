"""Worked answers of chapter 6, control: complete, of the size of an interview."""

import math

import numpy as np
from numpy.typing import ArrayLike


def ultimate_gain(inertia: float, damping: float, dt: float, delay: float) -> tuple[float, float]:
    """Return the gain at which a sampled P loop around a joint oscillates forever, and the period.

    Args:
        inertia: of the joint [kg m^2].
        damping: viscous friction [N m s/rad].
        dt: sample time; the torque is held between samples [s].
        delay: from a measurement to its torque, any length [s].

    Returns:
        (gain, period) [N m/rad, s].
    """
    rate = damping / inertia
    whole = int(delay // dt)
    rest = delay - whole * dt

    def driven(t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what a time does to (q, v), and what a torque of one adds meanwhile."""
        lost = -math.expm1(-rate * t)
        return (
            np.array([[1.0, lost / rate], [0.0, 1.0 - lost]]),
            np.array([t - lost / rate, lost]) / damping,
        )

    first, late = driven(rest)
    second, now = driven(dt - rest)
    before = second @ late

    def loop(gain: float) -> np.ndarray:
        """Return the loop as a matrix over q, v and the last commands, the newest first."""
        F = np.eye(whole + 3, k=-1)
        F[:3] = 0.0
        F[:2, :2] = second @ first
        F[2, 0] = -gain
        if whole:
            F[:2, whole + 1] = now
        else:
            F[:2, 0] -= gain * now
        F[:2, whole + 2] += before
        return F

    def growth(gain: float) -> float:
        return float(np.abs(np.linalg.eigvals(loop(gain))).max())

    high = damping / (delay + dt)
    while growth(high) < 1.0:
        high *= 2.0
    low = 0.0
    for _ in range(48):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(middle) < 1.0 else (low, middle)
    values = np.linalg.eigvals(loop(high))
    swinging = values[np.argmax(np.abs(values))]
    return high, 2.0 * math.pi * dt / abs(float(np.angle(swinging)))


def computed_torque(
    lengths: ArrayLike,
    masses: ArrayLike,
    gravity: float,
    q: ArrayLike,
    v: ArrayLike,
    reference: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
) -> np.ndarray:
    """Return torques that make two links in a vertical plane follow a reference.

    Args:
        lengths: of the two uniform rods, shape (2,) [m].
        masses: of the rods, shape (2,) [kg].
        gravity: along -y [m/s^2].
        q: joint angles, each relative to the link before, shape (2,) [rad].
        v: their rates, shape (2,) [rad/s].
        reference: wanted angles, rates and accelerations, rows of shape (3, 2).
        kp: gains of the error, shape (2,) [1/s^2].
        kd: gains of its rate, shape (2,) [1/s].

    Returns:
        Torques at the joints, shape (2,) [N m].
    """
    (l1, l2), (m1, m2) = np.asarray(lengths, dtype=float), np.asarray(masses, dtype=float)
    q, v = np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    q_ref, v_ref, a_ref = np.asarray(reference, dtype=float)
    coupling, tip = 0.5 * m2 * l1 * l2, m2 * l2**2 / 3.0
    across = tip + coupling * math.cos(q[1])
    base = (m1 / 3.0 + m2) * l1**2 + tip + 2.0 * coupling * math.cos(q[1])
    M = np.array([[base, across], [across, tip]])
    spin = coupling * math.sin(q[1])
    coriolis = spin * np.array([-2.0 * v[0] * v[1] - v[1] ** 2, v[0] ** 2])
    outer = 0.5 * m2 * l2 * math.cos(q[0] + q[1])
    weight = gravity * np.array([(0.5 * m1 + m2) * l1 * math.cos(q[0]) + outer, outer])
    a = a_ref + np.asarray(kd) * (v_ref - v) + np.asarray(kp) * (q_ref - q)
    return M @ a + coriolis + weight


def friction_torque(
    v: ArrayLike, coulomb: ArrayLike, viscous: ArrayLike, transition: float
) -> np.ndarray:
    """Return the torques that motors add so that they cancel the friction of their joints.

    The Coulomb term is smooth through zero: coulomb tanh(v / transition). At rest it is zero, with
    the slope coulomb / transition; far above the transition speed it has its full size.

    Args:
        v: desired rate of each joint, shape (n,) [rad/s].
        coulomb: Coulomb friction, (n,) [N m].
        viscous: viscous friction, (n,) [N m s/rad].
        transition: speed at which Coulomb friction is tanh(1) of its full size [rad/s].

    Returns:
        Torques in the direction of the motion, (n,) [N m].
    """
    v = np.asarray(v, dtype=float)
    share = np.tanh(v / transition) if transition > 0.0 else np.sign(v)
    return np.asarray(coulomb) * share + np.asarray(viscous) * v


def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> np.ndarray:
    """Return the gain of the discrete linear quadratic regulator.

    By doubling: each round turns P of k samples into P of 2k.

    Args:
        A: of x[k+1] = A x[k] + B u[k], shape (n, n).
        B: shape (n, m).
        Q: weights of the states, symmetric, shape (n, n).
        R: weights of the commands, symmetric and positive definite, shape (m, m).

    Returns:
        K with u = -K x, shape (m, n).
    """
    A, B = np.asarray(A, dtype=float), np.asarray(B, dtype=float)
    Q, R = np.asarray(Q, dtype=float), np.asarray(R, dtype=float)
    one = np.eye(len(A))
    # After k rounds P is the cost of 2^k steps (Chu, Fan, Lin and Wang, 2004).
    step, G, P = A, B @ np.linalg.solve(R, B.T), Q
    for _ in range(60):
        left = np.linalg.solve(one + G @ P, step)
        right = np.linalg.solve(one + G @ P, G)
        more = step.T @ P @ left
        G = G + step @ right @ step.T
        step = step @ left
        P = P + 0.5 * (more + more.T)
        if np.abs(more).max() <= 1e-16 * np.abs(P).max():
            break
    return np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)


def hybrid_torque(
    J: ArrayLike,
    frame: ArrayLike,
    forced: ArrayLike,
    error: ArrayLike,
    velocity: ArrayLike,
    force: ArrayLike,
    wanted: ArrayLike,
    gains: ArrayLike,
) -> np.ndarray:
    """Return joint torques that press along some axes of a surface and move along the others.

    Args:
        J: Jacobian of the tip, velocity in the world by joint rates, shape (3, n).
        frame: axes of the surface in the world, as columns, shape (3, 3).
        forced: of each of these axes, 1 where a force is wanted, 0 where a place is, shape (3,).
        error: goal less place of the tip, in the world, shape (3,) [m].
        velocity: of the tip, in the world, shape (3,) [m/s].
        force: that the tip exerts, measured, in the world, shape (3,) [N].
        wanted: force that the tip shall exert, along the axes of the surface, shape (3,) [N].
        gains: stiffness [N/m], damping [N s/m] and force gain [1].

    Returns:
        Torques at the joints, shape (n,) [N m].
    """
    axes, push = np.asarray(frame, dtype=float), np.asarray(wanted, dtype=float)
    stiffness, damping, gain = np.asarray(gains, dtype=float)
    pressing = push + gain * (push - axes.T @ np.asarray(force))
    following = stiffness * (axes.T @ np.asarray(error))
    along = np.where(np.asarray(forced) > 0.5, pressing, following)
    command = axes @ along - damping * np.asarray(velocity)
    return np.asarray(J, dtype=float).T @ command


def inertia_from_log(q: ArrayLike, tau: ArrayLike, dt: float) -> float:
    """Return the inertia of a joint with friction and gravity, from a log of angles and torques.

    The equation of motion is integrated twice, so that nothing has to be differentiated.

    Args:
        q: measured angle at each sample, shape (n,) [rad].
        tau: torque, held from this sample to the next, shape (n,) [N m].
        dt: sample time [s].

    Returns:
        The inertia [kg m^2].
    """
    q, tau = np.asarray(q, dtype=float), np.asarray(tau, dtype=float)

    def integral(y: np.ndarray) -> np.ndarray:
        """Return the integral from the first sample, by the trapezoidal rule."""
        return np.concatenate(([0.0], np.cumsum(0.5 * dt * (y[1:] + y[:-1]))))

    pushed = np.concatenate(([0.0], np.cumsum(dt * tau[:-1])))  # a held torque's own integral
    t = dt * np.arange(q.size)
    # I (q - q0 - v0 t) + b int(q - q0) + w int int cos q = int int tau, q0 and v0 unknown.
    columns = (q, integral(q), integral(integral(np.cos(q))), t, np.ones(q.size))
    fitted = np.linalg.lstsq(np.column_stack(columns), integral(pushed), rcond=None)[0]
    return float(fitted[0])


def mppi_step(
    plan: ArrayLike,
    noise: ArrayLike,
    costs: ArrayLike,
    temperature: float,
    low: ArrayLike,
    high: ArrayLike,
) -> tuple[np.ndarray, float]:
    """Return a plan of commands after one step of model predictive path integral control.

    Args:
        plan: commands, shape (steps, m).
        noise: what was added to the plan in each rollout, shape (k, steps, m).
        costs: of the rollouts, shape (k,); NaN or infinite where one failed.
        temperature: of the weights, positive, in the unit of the costs.
        low, high: limits of the commands, which the rollouts kept, shape (m,) each.

    Returns:
        (plan, effective): the new plan, shape (steps, m), and how many rollouts counted.
    """
    plan, costs = np.asarray(plan, dtype=float), np.asarray(costs, dtype=float)
    tried = np.clip(plan + np.asarray(noise), low, high)
    good = np.isfinite(costs)
    if not good.any():
        return np.clip(plan, low, high), 0.0
    weights = np.zeros(costs.size)
    weights[good] = np.exp(-(costs[good] - costs[good].min()) / temperature)
    weights = weights / weights.sum()
    return np.tensordot(weights, tried, axes=1), float(1.0 / (weights @ weights))


def hold_joint(
    q: float, target: float, pole: float, load: float, dt: float, steps: int
) -> tuple[float, float, float]:
    """Return a link in a vertical plane under computed torque with an integral, from rest.

    Args:
        q: angle at the start, from the horizontal [rad].
        target: angle to hold [rad].
        pole: the error must have three poles there, at -pole [1/s].
        load: torque that the controller does not know of [N m].
        dt: sample time and step [s].
        steps: how many.

    Returns:
        (q, v, total): angle, rate and integral of the error at the end [rad, rad/s, rad s].
    """
    inertia, weight = 0.5, 9.0  # kg m^2; N m, times the cosine of the angle
    kp, ki, kd = 3.0 * pole**2, pole**3, 3.0 * pole
    q, v, total = float(q), 0.0, 0.0
    for _ in range(steps):
        error = target - q
        total = total + dt * error
        torque = inertia * (kp * error + ki * total - kd * v) + weight * math.cos(q)
        v = v + dt * (torque + load - weight * math.cos(q)) / inertia
        q = q + dt * v
    return q, v, total


def pd_gains(
    inertia: ArrayLike, friction: ArrayLike, frequency: ArrayLike, ratio: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return the PD gains with which joints have a desired frequency and damping ratio.

    Args:
        inertia: of each joint, shape (n,) [kg m^2].
        friction: viscous, of its own, (n,) [N m s/rad].
        frequency: undamped natural frequency, (n,) [Hz].
        ratio: damping ratio, (n,).

    Returns:
        (kp (n,) [N m/rad], kd (n,) [N m s/rad]).
    """
    J = np.asarray(inertia, dtype=float)
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)
    kd = 2.0 * np.asarray(ratio, dtype=float) * omega * J - np.asarray(friction, dtype=float)
    return omega**2 * J, kd


def nonnegative_least_squares(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return x of least |A x - b| with x >= 0 (Lawson and Hanson's active sets)."""
    x, free = np.zeros(A.shape[1]), np.zeros(A.shape[1], dtype=bool)
    useless = np.zeros(x.size, dtype=bool)

    def minimum(free: np.ndarray) -> np.ndarray:
        z = np.zeros(x.size)
        z[free] = np.linalg.lstsq(A[:, free], b, rcond=None)[0]
        return z

    for _ in range(10 * x.size):
        slope = np.where(free | useless, -np.inf, A.T @ (b - A @ x))
        released = np.argmax(slope)
        if slope[released] <= 1e-12:
            break
        # Release the variable that promises most. One that turns negative at once promised only
        # rounding.
        free[released] = True
        z = minimum(free)
        if z[released] <= 0.0:
            free[released], useless[released] = False, True
            continue
        useless[:] = False
        # Step back to the first that turns negative, and hold that one at zero.
        while (negative := free & (z <= 0.0)).any():
            x = x + np.min(x[negative] / (x[negative] - z[negative])) * (z - x)
            free &= x > 1e-14
            z = minimum(free)
        x = z
    return x


def standing_qp(
    mass: float,
    mu: float,
    slope: float,
    com: ArrayLike,
    joints: ArrayLike,
    contacts: ArrayLike,
    limit: float,
    weight: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return contact forces and joint torques with which a planar biped stands on an incline.

    Args:
        mass: of the biped [kg].
        mu: coefficient of friction.
        slope: of the ground, which rises along x [rad].
        com: centre of mass, shape (2,) [m].
        joints: hip, knee and ankle of each leg, shape (2, 3, 2) [m].
        contacts: heel and toe of each leg, shape (2, 2, 2) [m].
        limit: largest torque of a joint [N m].
        weight: of the forces in the cost.

    Returns:
        Tangential and normal force on each heel and toe (2, 2, 2), torques of hips, knees and
        ankles (2, 3), and 1.0; or zeros and 0.0 where no forces are allowed.

    The balance is eliminated with a basis of its null space. A change of variables makes the cost a
    squared length, and the shortest vector that meets inequalities is a nonnegative least squares
    problem, whose residual vanishes if nothing meets them.
    """
    com, joints, contacts = (np.asarray(a, dtype=float) for a in (com, joints, contacts))
    c, s = np.cos(slope), np.sin(slope)
    axes = np.array([[c, s], [-s, c]])
    heavy = mass * 9.81

    def moments(levers: np.ndarray) -> np.ndarray:
        return np.asarray(levers[..., :1] * axes[:, 1] - levers[..., 1:] * axes[:, 0])

    # Forces in units of the weight, torques in units of their limit.
    E = np.vstack((np.tile(axes.T, 4), moments(contacts.reshape(4, 2) - com).ravel()))
    e = np.array([0.0, 1.0, 0.0])
    by_leg = np.zeros((2, 3, 2, 2, 2))
    for leg in (0, 1):
        by_leg[leg, :, leg] = moments(contacts[leg] - joints[leg][:, None])
    T = by_leg.reshape(6, 8) * heavy / limit
    cones = np.kron(np.eye(4), [[1.0, -mu], [-1.0, -mu]])
    G = np.vstack((cones, T, -T))
    h = np.concatenate((np.zeros(8), np.ones(12)))
    root = np.vstack((T, np.sqrt(weight) * np.eye(8)))
    # x = x0 + Z y meets E x = e. In u = R y + Q^T root x0 the cost is |u|^2 and a constant.
    x0 = np.linalg.pinv(E) @ e
    Z = np.linalg.svd(E)[2][len(e) :].T
    Q, R = np.linalg.qr(root @ Z)
    centre = Q.T @ (root @ x0)
    A = np.linalg.solve(R.T, (G @ Z).T).T
    b = h - G @ x0 + A @ centre
    size = np.linalg.norm(A, axis=1)
    stacked = -np.vstack((A.T, b)) / size
    target = np.eye(len(stacked))[-1]
    r = stacked @ nonnegative_least_squares(stacked, target) - target
    # At the minimum, r[-1] is minus the squared length of r.
    if -r[-1] < 1e-6:
        return np.zeros((2, 2, 2)), np.zeros((2, 3)), 0.0
    u = -r[:-1] / r[-1]
    x = x0 + Z @ np.linalg.solve(R, u - centre)
    forces, torques = x * heavy, T @ x * limit
    return forces.reshape(2, 2, 2), torques.reshape(2, 3), 1.0
