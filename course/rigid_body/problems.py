"""Problems with an independent answer, on which every integrator of chapter 1 is judged.

Each problem is a `System`, how long to run it, and the truth: a closed form where there is one,
otherwise a reference at tolerance 1e-13 made by a method that is not in the course (SciPy's DOP853)
and checked in the tests by halving the step of another one.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba.extending import register_jitable

from course.check import invalid
from course.rigid_body import quaternion
from course.rigid_body.integrators import STANDARD_GRAVITY, Array, System, _coordinate_rate


@dataclass(frozen=True)
class Problem:
    """A system, a duration and the truth.

    Attributes:
        system: what to integrate.
        duration: length of the run [s].
        truth: function t -> (q, v) at one time [s]; a closed form or a tight reference.
        closed_form: whether `truth` is a closed form.
        unit: unit of `error`: "rad" or "m".
    """

    system: System
    duration: float
    truth: Callable[[float], tuple[Array, Array]]
    closed_form: bool
    unit: str

    def error(self, q: Array, t: float | None = None) -> float:
        """Return the distance of positions q from the truth at time t (default: the end).

        Args:
            q: positions, shape (nq,).
            t: time [s].

        Returns:
            For orientations the angle of the turn that is missing [rad]; otherwise the largest
            difference of a component. Infinity where q is not finite.
        """
        # A run that blew up has an infinite error, so it is never taken for an accurate one.
        if not np.all(np.isfinite(q)):
            return float("inf")
        true_q, _ = self.truth(self.duration if t is None else t)
        if self.system.q0.shape[0] == self.system.v0.shape[0]:
            return float(np.max(np.abs(q - true_q)))
        # Error on the manifold: the angle of the rotation that is missing, not a difference of
        # components.
        return float(quaternion.angle_between(quaternion.normalise(q[-4:]), true_q[-4:]))


def tight_reference(system: System, t: float, rtol: float = 1e-13) -> tuple[Array, Array]:
    """Return the state at time t by SciPy's DOP853 at a tolerance near the rounding limit.

    Args:
        system: what to integrate, one body.
        t: time [s].
        rtol: relative tolerance per step; the absolute one is a tenth of it.

    Returns:
        (q, v) at t; quaternions normalised.
    """
    from scipy.integrate import solve_ivp

    nq = system.q0.shape[0]

    # First-order form: positions and velocities in one vector, the quaternion as four plain
    # numbers.
    def rate(_: float, y: Array) -> Array:
        q, v = y[:nq], y[nq:]
        return np.concatenate([_coordinate_rate(q, v), system.acceleration(q, v, system.params)])

    start = np.concatenate([system.q0, system.v0])
    if t == 0.0:
        return system.q0.copy(), system.v0.copy()
    end = solve_ivp(rate, (0.0, t), start, method="DOP853", rtol=rtol, atol=0.1 * rtol).y[:, -1]
    q, v = end[:nq], end[nq:]
    if nq > system.v0.shape[0]:
        q[-4:] = quaternion.normalise(q[-4:])
    return q, v


def _reference(system: System) -> Callable[[float], tuple[Array, Array]]:
    """Return `tight_reference` as the truth of a problem; each time is computed once."""
    return functools.lru_cache(maxsize=256)(functools.partial(tight_reference, system))


# --- linear oscillator -------------------------------------------------------------------------


@register_jitable
def oscillator_acceleration(q, v, params):
    """Return x'' = -omega^2 x - 2 zeta omega x'; params = (omega [rad/s], zeta)."""
    return -params[0] * params[0] * q - 2.0 * params[1] * params[0] * v


def oscillator_energy(q: Array, v: Array, params: Array) -> Array:
    """Return the energy per unit of mass [J/kg] of the oscillator, shape q.shape[1:]."""
    return 0.5 * v[0] ** 2 + 0.5 * (params[0] * q[0]) ** 2


def oscillator(
    omega: float = 2.0 * np.pi, zeta: float = 0.0, duration: float = 2.3, x0: float = 1.0
) -> Problem:
    """Return a mass on a spring, released at x0 [m] at rest.

    Args:
        omega: undamped angular frequency [rad/s].
        zeta: damping ratio, 0 <= zeta < 1.
        duration: length of the run [s].
        x0: initial position [m].

    Returns:
        The problem with its closed form.
    """
    system = System(
        "oscillator",
        oscillator_acceleration,
        np.array([omega, zeta]),
        np.array([x0]),
        np.array([0.0]),
        oscillator_energy,
    )
    # Angular frequency of the damped oscillation.
    damped = omega * np.sqrt(1.0 - zeta**2)

    # Closed form of the underdamped oscillator.
    def truth(t: float) -> tuple[Array, Array]:
        decay = x0 * np.exp(-zeta * omega * t)
        c, s = np.cos(damped * t), np.sin(damped * t)
        x = decay * (c + zeta * omega / damped * s)
        v = -decay * (omega**2 / damped) * s
        return np.array([x]), np.array([v])

    return Problem(system, duration, truth, True, "m")


# --- pendulum ----------------------------------------------------------------------------------


@register_jitable
def pendulum_acceleration(q, v, params):
    """Return theta'' = -(g/l) sin theta; params = (g / l [1/s^2],)."""
    return -params[0] * np.sin(q)


def pendulum_energy(q: Array, v: Array, params: Array) -> Array:
    """Return the energy per m l^2 [1/s^2] of the pendulum, zero when it hangs at rest."""
    return 0.5 * v[0] ** 2 + params[0] * (1.0 - np.cos(q[0]))


def pendulum(
    amplitude: float = 2.5,
    length: float = 1.0,
    gravity: float = STANDARD_GRAVITY,
    duration: float = 2.0,
) -> Problem:
    """Return a point pendulum released at rest at a large angle.

    Closed form: sin(theta/2) = k cd(w t | k^2) with k = sin(amplitude / 2) and w = sqrt(g / l)
    (Whittaker, Analytical Dynamics, 1904, sec. 44).

    Args:
        amplitude: initial angle from hanging [rad], below pi.
        length: [m].
        gravity: [m/s^2].
        duration: length of the run [s].
    """
    rate = np.sqrt(gravity / length)
    # Modulus of the elliptic functions; the pendulum starts at rest at its amplitude.
    k = np.sin(0.5 * amplitude)
    system = System(
        "pendulum",
        pendulum_acceleration,
        np.array([gravity / length]),
        np.array([amplitude]),
        np.array([0.0]),
        pendulum_energy,
    )

    def truth(t: float) -> tuple[Array, Array]:
        from scipy.special import ellipj

        # cd = cn / dn starts at 1, since the pendulum is released at the end of its swing.
        sn, cn, dn, _ = ellipj(rate * t, k * k)
        theta = 2.0 * np.arcsin(k * cn / dn)
        theta_rate = -2.0 * rate * k * np.sqrt(1.0 - k * k) * sn / dn
        return np.array([theta]), np.array([theta_rate])

    return Problem(system, duration, truth, True, "rad")


# --- torque-free asymmetric body ---------------------------------------------------------------


@register_jitable
def tumble_acceleration(q, v, params):
    """Return Euler's equations without torque in principal axes; params = (I1, I2, I3) [kg m^2]."""
    result = np.empty_like(v)
    # Euler's equations: in the turning frame the gyroscopic terms remain without any torque.
    result[0] = (params[1] - params[2]) / params[0] * v[1] * v[2]
    result[1] = (params[2] - params[0]) / params[1] * v[2] * v[0]
    result[2] = (params[0] - params[1]) / params[2] * v[0] * v[1]
    return result


@register_jitable
def tumble_energy(q: Array, v: Array, params: Array) -> Array:
    """Return kinetic energy [J] of a turning body, shape v.shape[1:]."""
    return 0.5 * (params[0] * v[0] ** 2 + params[1] * v[1] ** 2 + params[2] * v[2] ** 2)


def angular_momentum(q: Array, v: Array, params: Array) -> Array:
    """Return angular momentum in the world frame [kg m^2/s], shape (3,) or (3, N)."""
    scale = params[:3].reshape((3,) + (1,) * (v.ndim - 1))
    return quaternion.rotate(q[-4:], scale * v[-3:])


def _incomplete_pi(n: float, u: float, m: float) -> float:
    """Return the integral of 1 / (1 - n sn^2) from 0 to u.

    It is computed from Carlson's symmetric forms (DLMF 19.25).
    """
    from scipy.special import ellipj, ellipk, elliprf, elliprj

    # K(m), the quarter period of the elliptic functions.
    quarter = ellipk(m)
    # Half periods are taken off first: Carlson's forms hold within a quarter period of zero.
    turns = np.round(u / (2.0 * quarter))
    sn, cn, _, _ = ellipj(u - 2.0 * quarter * turns, m)

    def from_zero(s: float, c: float) -> float:
        # The integral in Carlson's forms: s R_F + n s^3 R_J / 3.
        x, y, p = c * c, 1.0 - m * s * s, 1.0 - n * s * s
        return s * elliprf(x, y, 1.0) + n / 3.0 * s**3 * elliprj(x, y, 1.0, p)

    # Each half period that was taken off adds twice the complete integral.
    return float(from_zero(sn, cn) + 2.0 * turns * from_zero(1.0, 0.0))


def tumble(
    inertia: tuple[float, float, float] = (1.0, 2.0, 3.0),
    rates: tuple[float, float] = (1.0, 1.5),
    duration: float = 20.0,
) -> Problem:
    """Return a body with three different moments of inertia that turns freely.

    The world's z axis is the fixed angular momentum L. Rates are Jacobi's elliptic functions; the
    angle about L is an elliptic integral of the third kind (Jacobi 1849; Landau and Lifshitz,
    Mechanics, sec. 37).

    Args:
        inertia: principal moments I1 < I2 < I3 [kg m^2].
        rates: first and third body rate at the start, the second is zero; both positive, with
            L^2 > 2 T I2, so that the third axis circles L [rad/s].
        duration: length of the run [s].

    Raises:
        ValueError: when the moments or the rates are outside that case.
    """
    i1, i2, i3 = inertia
    w1, w3 = rates
    if not 0.0 < i1 < i2 < i3 <= i1 + i2:
        raise invalid("inertia", inertia, "0 < I1 < I2 < I3 <= I1 + I2")
    # Twice the kinetic energy and the squared angular momentum, both conserved.
    two_t = i1 * w1**2 + i3 * w3**2
    square = (i1 * w1) ** 2 + (i3 * w3) ** 2
    if not (w1 > 0.0 and w3 > 0.0 and square > two_t * i2):
        raise invalid("rates", rates, "two positive numbers with L^2 > 2 T I2")
    momentum = np.sqrt(square)
    # Closed form by Jacobi's elliptic functions (Landau and Lifshitz, Mechanics, sec. 37).
    pace = np.sqrt((i3 - i2) * (square - two_t * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (two_t * i3 - square) / ((i3 - i2) * (square - two_t * i1))
    w2 = np.sqrt((two_t * i3 - square) / (i2 * (i3 - i2)))
    # The squared momentum across the third axis is d at the start and d (1 + beta sn^2) later.
    d = (i1 * w1) ** 2
    beta = (i3 * w3) ** 2 * m / d

    def truth(t: float) -> tuple[Array, Array]:
        from scipy.special import ellipj, ellipk

        u = pace * t
        quarter = ellipk(m)
        # sn, cn and dn share the period 4 K: reducing the argument by it keeps their accuracy.
        sn, cn, dn, _ = ellipj(u - 4.0 * quarter * np.round(u / (4.0 * quarter)), m)
        v = np.array([w1 * cn, w2 * sn, w3 * dn])
        # Precession about L: a steady part, and the elliptic integral of the third kind.
        turn = momentum * (
            t / i3 + (two_t - square / i3) / (d * pace) * _incomplete_pi(-beta, u, m)
        )
        body = np.array([i1, i2, i3]) * v / momentum
        # Attitude: the angular momentum is fixed in space; its direction in the body gives two
        # angles, the integral above the third.
        tilt = np.arctan2(np.hypot(body[0], body[1]), body[2])
        z = np.array([0.0, 0.0, 1.0])
        # The attitude as z-x-z Euler angles: precession, tilt, then the turn about the body's own
        # axis.
        q = quaternion.product(
            quaternion.exp(turn * z),
            quaternion.product(
                quaternion.exp(np.array([tilt, 0.0, 0.0])),
                quaternion.exp(np.arctan2(body[0], body[1]) * z),
            ),
        )
        return q, v

    q0, v0 = truth(0.0)
    system = System("tumble", tumble_acceleration, np.array(inertia), q0, v0, tumble_energy)
    return Problem(system, duration, truth, True, "rad")


# --- heavy symmetric top -----------------------------------------------------------------------


@register_jitable
def top_acceleration(q, v, params):
    """Return a top on a fixed point under gravity; params = (I1, I2, I3 [kg m^2], m g l [N m]).

    Moments are about the fixed point; the centre of mass lies on the body's z axis.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    up_x = 2.0 * (x * z - w * y)  # the world's vertical, seen from the body
    up_y = 2.0 * (y * z + w * x)
    # Gravity's torque about the fixed point is m g l times up x z = (up_y, -up_x, 0).
    result = np.empty_like(v)
    result[0] = ((params[1] - params[2]) * v[1] * v[2] + params[3] * up_y) / params[0]
    result[1] = ((params[2] - params[0]) * v[2] * v[0] - params[3] * up_x) / params[1]
    result[2] = (params[0] - params[1]) * v[0] * v[1] / params[2]
    return result


@register_jitable
def top_height(q: Array) -> Array:
    """Return the cosine of the tilt of the body's z axis from the vertical, shape q.shape[1:]."""
    return 1.0 - 2.0 * (q[-3] ** 2 + q[-2] ** 2)


@register_jitable
def top_energy(q: Array, v: Array, params: Array) -> Array:
    """Return kinetic plus potential energy [J] of the heavy top."""
    return tumble_energy(q, v, params) + params[3] * top_height(q)


@register_jitable
def nutation_limits(inertia: tuple[float, float], weight: float, tilt: float, spin: float) -> Array:
    """Return cosines of the two tilts between which a top released at rest nods.

    Roots of (1 - u^2)(alpha - beta u) - (b - a u)^2 (Goldstein, Classical Mechanics, sec. 5.7).
    One is the tilt at release, as the top rests there; what is left is u^2 - 2 h u + 2 h u0 - 1.

    Args:
        inertia: (I1 = I2, I3) about the fixed point [kg m^2].
        weight: m g l [N m].
        tilt: tilt at release [rad].
        spin: spin about the body's own axis [rad/s].

    Returns:
        All three roots in ascending order, shape (3,); the motion is between the first two.
    """
    i1, i3 = inertia
    u0 = np.cos(tilt)
    # Half the sum of the other two roots, which solve the quadratic of the docstring.
    h = (i3 * spin) ** 2 / (4.0 * i1 * weight)
    high = h + np.sqrt(h * h - 2.0 * h * u0 + 1.0)
    # The smaller of them from their product (Vieta): h minus the root cancels for a fast spin.
    return np.array([(2.0 * h * u0 - 1.0) / high, u0, high])


def heavy_top(
    inertia: tuple[float, float] = (0.02, 0.004),
    weight: float = 1.0,
    tilt: float = 0.5,
    spin: float = 80.0,
    duration: float = 2.0,
) -> Problem:
    """Return a symmetric top released with its axis at rest.

    Args:
        inertia: (I1 = I2, I3) about the fixed point [kg m^2].
        weight: m g l [N m].
        tilt: initial tilt from the vertical [rad].
        spin: spin about its own axis [rad/s].
        duration: length of the run [s].

    Returns:
        The problem; its truth is a tight reference, whose height `top_height_truth` checks.
    """
    i1, i3 = inertia
    system = System(
        "heavy_top",
        top_acceleration,
        np.array([i1, i1, i3, weight]),
        quaternion.exp(np.array([tilt, 0.0, 0.0])),
        np.array([0.0, 0.0, spin]),
        top_energy,
    )
    return Problem(system, duration, _reference(system), False, "rad")


def top_height_truth(
    t: float, inertia: tuple[float, float], weight: float, tilt: float, spin: float
) -> float:
    """Return closed form of the cosine of the tilt of a top released at rest (Goldstein, sec. 5.7).

    Args:
        t: time [s].
        inertia: as for `nutation_limits`.
        weight: as for `nutation_limits`.
        tilt: as for `nutation_limits`.
        spin: as for `nutation_limits`.

    Returns:
        u1 + (u2 - u1) cd^2(p t | m), between the nutation limits.
    """
    from scipy.special import ellipj

    # The nutation is a cubic's motion between two roots, an elliptic function again.
    u1, u2, u3 = nutation_limits(inertia, weight, tilt, spin)
    pace = 0.5 * np.sqrt(2.0 * weight / inertia[0] * (u3 - u1))
    _, cn, dn, _ = ellipj(pace * t, (u2 - u1) / (u3 - u1))
    return float(u1 + (u2 - u1) * (cn / dn) ** 2)


# --- double pendulum ---------------------------------------------------------------------------


@register_jitable
def double_pendulum_acceleration(q, v, params):
    """Return angular accelerations of two point masses on massless rods.

    q holds both angles from the vertical [rad]; params = (m1, m2 [kg], l1, l2 [m], g [m/s^2]).
    """
    m1, m2, l1, l2, g = params[0], params[1], params[2], params[3], params[4]
    difference = q[0] - q[1]
    c, s = np.cos(difference), np.sin(difference)
    # M qdd = f with M = [[(m1 + m2) l1, m2 l2 c], [l1 c, l2]]
    f1 = -m2 * l2 * s * v[1] * v[1] - (m1 + m2) * g * np.sin(q[0])
    f2 = l1 * s * v[0] * v[0] - g * np.sin(q[1])
    # Two equations for two accelerations, by Cramer's rule.
    determinant = l1 * l2 * (m1 + m2 - m2 * c * c)
    result = np.empty_like(v)
    result[0] = (l2 * f1 - m2 * l2 * c * f2) / determinant
    result[1] = ((m1 + m2) * l1 * f2 - l1 * c * f1) / determinant
    return result


def double_pendulum_energy(q: Array, v: Array, params: Array) -> Array:
    """Return kinetic plus potential energy [J]; zero potential at the pivot's height."""
    m1, m2, l1, l2, g = params
    kinetic = 0.5 * (m1 + m2) * (l1 * v[0]) ** 2 + 0.5 * m2 * (l2 * v[1]) ** 2
    kinetic = kinetic + m2 * l1 * l2 * v[0] * v[1] * np.cos(q[0] - q[1])
    return kinetic - (m1 + m2) * g * l1 * np.cos(q[0]) - m2 * g * l2 * np.cos(q[1])


def double_pendulum(angles: tuple[float, float] = (2.0, 1.0), duration: float = 3.0) -> Problem:
    """Return two equal point masses, 1 kg on rods of 1 m, released at rest.

    Args:
        angles: initial angles from hanging [rad].
        duration: length of the run [s].

    Returns:
        The problem with a tight reference as its truth.
    """
    system = System(
        "double_pendulum",
        double_pendulum_acceleration,
        np.array([1.0, 1.0, 1.0, 1.0, STANDARD_GRAVITY]),
        np.array(angles),
        np.zeros(2),
        double_pendulum_energy,
    )
    return Problem(system, duration, _reference(system), False, "rad")


# --- bouncing ball -----------------------------------------------------------------------------


def bounce_times(
    height: float, restitution: float, bounces: int, gravity: float = STANDARD_GRAVITY
) -> Array:
    """Return impact times of a point dropped from rest [s], shape (bounces,).

    t_k = t_1 (1 + 2 (e + ... + e^(k-1))) with t_1 = sqrt(2 h / g).

    Args:
        height: drop height [m].
        restitution: e, ratio of speed after to speed before.
        bounces: number of impacts.
        gravity: [m/s^2].
    """
    # After the first fall each flight lasts e times the one before: a geometric series.
    powers = restitution ** np.arange(1, bounces)
    first = np.sqrt(2.0 * height / gravity)
    return first * np.concatenate([[1.0], 1.0 + 2.0 * np.cumsum(powers)])


def bounce_height(
    t: float, height: float, restitution: float, gravity: float = STANDARD_GRAVITY
) -> float:
    """Return the height [m] at time t [s] of a point dropped from rest on a rigid floor.

    Zero from the moment at which infinitely many bounces have come to their end.

    Args:
        t: time since the drop [s].
        height: as for `bounce_times`.
        restitution: as for `bounce_times`.
        gravity: as for `bounce_times`.
    """
    first = np.sqrt(2.0 * height / gravity)
    if t < first:
        return float(height - 0.5 * gravity * t * t)
    speed, start = gravity * first * restitution, first
    # From parabola to parabola, until the speed has all but vanished (Zeno's point).
    while speed > 1e-9 * gravity * first:
        flight = 2.0 * speed / gravity
        if t < start + flight:
            s = t - start
            return float(speed * s - 0.5 * gravity * s * s)
        start += flight
        speed *= restitution
    return 0.0


def frictionless_box(
    t: float,
    state: Array,
    width: float,
    height: float,
    restitution: float,
    gravity: float = STANDARD_GRAVITY,
) -> Array:
    """Return a tumbling box on a smooth rigid floor, from one impact to the next.

    Flight is a parabola and a steady turn; the impact time is a root found by Brent's method on a
    bracket from dense samples of the lowest corner; the impulse of a smooth corner is
    -(1 + e) v_n / (1/m + r_x^2 / I) (Brach, Mechanical Impact Dynamics, 1991). Written apart from
    `planar`, as its judge. Valid until contact lasts.

    Args:
        t: time [s].
        state: start (x, y, angle, vx, vy, omega), shape (6,).
        width: of the uniform box [m].
        height: of the uniform box [m].
        restitution: e, between 0 and 1.
        gravity: [m/s^2].

    Returns:
        The state at t, shape (6,).
    """
    from scipy.optimize import brentq

    moment = (width**2 + height**2) / 12.0  # per unit of mass
    arm = 0.5 * np.hypot(width, height)
    # The corners as angles about the centre, so that their heights are sines.
    opening = np.arctan2(height, width)
    corners = np.array([opening, np.pi - opening, np.pi + opening, -opening])
    x, y, angle, vx, vy, omega = (float(value) for value in state)

    def heights(s: Array) -> Array:
        centre = y + vy * s - 0.5 * gravity * s * s
        return centre[:, None] + arm * np.sin(angle + omega * s[:, None] + corners)

    def corner_height(s: float, corner: int) -> float:
        return float(heights(np.array([s]))[0, corner])

    # Event to event: sample the corners' heights, bracket the first crossing, refine it with Brent.
    remaining, struck = t, -1
    while True:
        times = np.append(np.arange(0.0, remaining, 1e-4), remaining)
        sampled = heights(times)
        if struck >= 0:
            # The corner that has just been hit is at zero but for rounding, and rises.
            sampled[0, struck] = 0.0
        crossings = np.argwhere((sampled[:-1] >= 0.0) & (sampled[1:] < 0.0))
        flight = remaining
        if crossings.size:
            k, struck = (int(index) for index in crossings[0])
            if times[k] == 0.0 and sampled[0, struck] == 0.0:
                raise invalid("t", t, "a time before bounces get shorter than 0.1 ms")
            flight = brentq(corner_height, times[k], times[k + 1], (struck,), 1e-15, 1e-15)
        x, y = x + vx * flight, y + vy * flight - 0.5 * gravity * flight**2
        angle, vy = angle + omega * flight, vy - gravity * flight
        remaining -= flight
        if not crossings.size:
            return np.array([x, y, angle, vx, vy, omega])
        # Newton's law at the corner: the lever reduces its effective mass.
        lever = arm * np.cos(angle + corners[struck])
        normal = vy + omega * lever
        impulse = -(1.0 + restitution) * normal / (1.0 + lever**2 / moment)
        vy, omega = vy + impulse, omega + lever * impulse / moment


def all_problems() -> dict[str, Problem]:
    """Return the smooth problems of chapter 1 by name."""
    problems = (oscillator(), pendulum(), tumble(), heavy_top(), double_pendulum())
    return {problem.system.name: problem for problem in problems}
