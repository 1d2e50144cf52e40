"""Claims about Newton's and Euler's equations: the gyroscopic term, tops and tumbling bodies."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from course.derivations import Ask, Symbol, claim

Floats = Sequence[float] | np.ndarray

SYMBOLS = {
    "I1": Symbol("moment across the axis, about the tip [kg m^2]"),
    "I3": Symbol("moment along the axis, about the tip [kg m^2]"),
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "l": Symbol("tip to centre of mass [m]"),
}
_FREE = {
    "omega": Symbol("spin [rad/s]"),
    "I1": Symbol("smallest moment [kg m^2]", 1.0, 2.0),
    "I2": Symbol("middle moment [kg m^2]", 2.0, 3.0),
    "I3": Symbol("largest moment [kg m^2]", 3.0, 4.0),
}
_EXAMPLE = np.array([1.0, 2.0, 3.0])  # moments [kg m^2]


def _moments(rng: np.random.Generator) -> np.ndarray:
    """Return moments I1 < I2 < I3 of a body that exists, well apart, shape (3,) [kg m^2]."""
    # Each below the sum of the other two, as the moments of any body are.
    return np.sort(rng.uniform(1.0, 1.8, 3)) + [0.0, 0.1, 0.2]


def _spin(moments: Floats, omega: Floats, seconds: float, steps: int = 1000) -> Any:
    """Return trajectory of a free body by RK4, from the identity, at body rates `omega` [rad/s]."""
    from course.rigid_body import System, problems, quaternion, simulate

    start = quaternion.identity(), np.asarray(omega)
    system = System("spin", problems.tumble_acceleration, np.asarray(moments), *start)
    return simulate(system, "rk4", seconds / steps, steps, every=1)


def _wander(q: np.ndarray, omega: np.ndarray) -> float:
    """Return the largest angle in space of a body's axis of rotation from its start [deg]."""
    from course.rigid_body import quaternion

    axis = quaternion.rotate(q.T, omega.T)
    axis = axis / np.linalg.norm(axis, axis=0)
    return float(np.degrees(np.arccos(np.clip(axis[:, 0] @ axis, -1, 1)).max()))


def _path(moments: Floats, omega: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Return orientations and body rates of a free body along 5 s."""
    run = _spin(moments, omega, 5.0)
    return run.q, run.v


def _without_term(moments: Floats, omega: Floats, seconds: float) -> float:
    """Return the error of the attitude of a free body whose gyroscopic term is left out [rad]."""
    from course.rigid_body import quaternion

    end = _spin(moments, omega, seconds).q[-1]
    return float(quaternion.angle_between(end, quaternion.exp(seconds * np.asarray(omega))))


def _top_run(
    inertia: tuple[float, float], spin: float, tilt: float, duration: float, dt: float = 5e-4
) -> Any:
    """Run a top with m g l = 1 N m; return the cosines of its tilt, the run and the system."""
    from course.rigid_body import problems, simulate

    system = problems.heavy_top(inertia, 1.0, tilt, spin, duration).system
    run = simulate(system, "rk4", dt, round(duration / dt), every=10)
    return problems.top_height(run.q.T), run, system


def _pushed(rng: np.random.Generator, push: float = 1.0, mass: float = 2.0) -> Any:
    """Return a random body in flight under a random force; at the start its axes are the world's.

    Args:
        rng: where the draws come from.
        push: size of the force [N].
        mass: [kg].

    Returns:
        (force, path, rest, poles): the force [N]; r -> acceleration of the point at r off the
        centre, from its path, seen from a frame that turns at a given rate [m/s^2]; r -> torque
        less I alpha + omega x (I omega) about that point [N m]; the r of the point
        without acceleration and of one with an acceleration along r.
    """
    from course.rigid_body import RigidBody, quaternion
    from course.rigid_body.spatial import newton_euler_acceleration

    inertia, h = np.diag(_moments(rng)), 1e-5
    force, arm, omega = rng.normal(size=(3, 3)) * [[push], [1.0], [1.0]]
    torque, body = np.cross(arm, force), RigidBody(mass, inertia)
    body.v[3:] = omega
    wrench = force / mass, torque, inertia.ravel(), np.linalg.inv(inertia).ravel()
    alpha = newton_euler_acceleration(body.q, body.v, np.concatenate(wrench))[3:]
    # Three poses suffice for a second difference of any point's path.
    poses = [body.q]
    for _ in range(2):
        body.apply_force(force)
        body.apply_torque(torque)
        body.step(h, (0.0, 0.0, 0.0))
        poses.append(body.q)

    def path(r: np.ndarray, rate: float = 0.0) -> np.ndarray:
        p = [q[:3] + quaternion.rotate(q[3:], r) for q in poses]
        if rate:  # as a frame sees it that turns about a vertical axis a metre aside
            turn = [quaternion.exp(np.array([0.0, 0.0, -rate * h * k])) for k in range(3)]
            p = [quaternion.rotate(t, x + [1.0, 0.0, 0.0]) for t, x in zip(turn, p, strict=True)]
        return (p[2] - 2 * p[1] + p[0]) / h**2

    def rest(r: np.ndarray) -> np.ndarray:
        # Parallel-axis theorem (Steiner).
        about = inertia + mass * (r @ r * np.eye(3) - np.outer(r, r))
        return torque - np.cross(r, force) - about @ alpha - np.cross(omega, about @ omega)

    def turned(e: np.ndarray) -> np.ndarray:
        # Euler's and centripetal acceleration of a point fixed in the body.
        return np.cross(alpha, e) + np.cross(omega, np.cross(omega, e))

    field = np.array([turned(e) for e in np.eye(3)]).T
    # Points r from the centre whose acceleration, force / mass + field @ r, is share times r.
    poles = [np.linalg.solve(field - share * np.eye(3), -force / mass) for share in (0.0, -5.0)]
    return force, path, rest, poles


@claim(
    "A rigid body obeys F = m*a.",
    "The a is that of the centre of mass in an inertial frame, wherever the force acts. Any other "
    "point of the body has (alpha x r) + omega x (omega x r) besides: with m = {mass_kg:g} kg the "
    "product is up to {largest_off_n:.0f} N off the force in the draws below.",
)
def force_is_mass_times_acceleration(result):
    mass = result.input("mass_kg", 2.0)

    def deviation(scale: float, rate: float = 0.0) -> float:
        force, path, _, _ = _pushed(result.rng, mass=mass)
        return float(np.abs(mass * path(scale * result.rng.normal(size=3), rate) - force).max())

    # Scale 0 is the centre of mass itself; 1e-4 covers the second difference with h = 1e-5.
    centre, elsewhere = ([deviation(scale) for _ in range(20)] for scale in (0.0, 0.5))
    # Chosen to break it: the centre itself, seen from a frame that turns.
    turning = [deviation(0.0, rate) for rate in (0.1, 0.3, 1.0)]
    result.measure("largest_off_n", max(elsewhere), 1e-3)
    result.statement = (
        "Accelerations from the paths of the centre and of other points of 20 bodies."
    )
    result.statement_holds(
        max(elsewhere) < 1e-4,
        only_if="a is the acceleration of the centre of mass, in a frame that neither accelerates "
        "nor turns",
        inside=[x < 1e-4 for x in centre],
        outside=[x < 1e-4 for x in elsewhere + turning],
    )
    result.correction_holds(max(centre) < 1e-4 < 0.1 < max(elsewhere), min(turning) > 1e-3)


@claim(
    "In the plane the torque of a force is r_x f_y - r_y f_x.",
    "It is, with r from the centre of mass, x to the right, y up, anticlockwise positive: the z "
    "component of r x F. With r from the origin the boxes below are up to {off_from_origin_nm:.1f} "
    "N m off, and on a screen, y down, the same formula counts clockwise.",
)
def planar_torque(result):
    from course.rigid_body import PlanarBody

    def felt(place: np.ndarray, arm: np.ndarray, force: np.ndarray) -> float:
        """Return the torque on a box, from the rate it gains [N m]."""
        body = PlanarBody(ground=False)
        body.state[:2] = place
        body.apply_force(force, place + arm)
        body.step(1e-3, gravity=0.0)
        return body.omega * body.moment / 1e-3

    draws = result.rng.normal(size=(50, 3, 2))
    torque = np.array([felt(*draw) for draw in draws])
    flat = np.pad(draws, ((0, 0), (0, 0), (0, 1)))
    place, arm, force = flat.transpose(1, 0, 2)
    # The three-dimensional cross product as the truth, about the centre and about the origin.
    right, wrong = np.cross(arm, force)[:, 2], np.cross(place + arm, force)[:, 2]
    result.measure("off_from_origin_nm", np.abs(torque - wrong).max())
    result.statement = "The rate that 50 boxes gain from a random force at a random point."
    printed = arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]
    result.statement_holds(np.abs(torque - printed).max() < 1e-9)
    result.correction_holds(np.abs(torque - right).max() < 1e-9, np.abs(torque - wrong).max() > 0.1)


@claim(
    "Torque is I alpha + omega x (I omega).",
    "About another point P of the body the term m (c x a_P) is missing, c from P to the centre: a "
    "body without any force seems to need {torque_found_about_p_nm:.2f} N m. A point that is only "
    "fixed in space, while the body moves through it, is no better. And I, alpha and omega must be "
    "in one frame: I is constant in the body frame alone.",
    source="Featherstone, Rigid Body Dynamics Algorithms (2008), sec. 2.15",
)
def euler_equation_point(result):
    from course.rigid_body import problems, quaternion

    omega, offset = np.array([1.0, 2.0, -1.0]), np.array([0.5, 0.0, 0.3])
    alpha = problems.tumble_acceleration(quaternion.identity(), omega, _EXAMPLE)
    about_p = np.diag(_EXAMPLE) + 2.0 * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    wrong = np.linalg.norm(about_p @ alpha + np.cross(omega, about_p @ omega))
    inside, outside, explained = [], [], []
    for _ in range(20):
        _, path, rest, poles = _pushed(result.rng)
        r = result.rng.normal(size=3)
        # Chosen to break it: the points at which the missing term m c x a_P vanishes: centre,
        # pole, and a_P along c.
        inside += [np.linalg.norm(rest(point)) < 1e-9 for point in (0 * r, *poles)]
        outside += [np.linalg.norm(rest(point)) < 1e-9 for point in (r, poles[0] + 0.1 * r)]
        # The remainder elsewhere must be exactly that term, from the measured path.
        explained.append(np.abs(rest(r) - 2.0 * np.cross(-r, path(r))).max())
    turned = quaternion.to_matrix(_spin(_EXAMPLE, omega, 1.0).q[-1])
    observed = turned @ np.diag(_EXAMPLE) @ turned.T
    result.measure("torque_found_about_p_nm", wrong)
    result.statement = (
        "Torque less the formula, about the centres, points without acceleration or with one "
        "along the line to the centre, and other points of 20 random bodies under random forces."
    )
    result.statement_holds(
        wrong < 1e-9,
        only_if="moments are taken about the centre of mass, or about a point of the body whose "
        "acceleration is zero (a pivot) or points along the line to the centre (the contact point "
        "of a rolling wheel)",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(max(explained) < 0.01, np.abs(observed - np.diag(_EXAMPLE)).max() > 0.1)


@claim(
    "Every turning body has a gyroscopic term omega x (I omega).",
    "It is zero for a turn about a principal axis, and for every turn of a body with three equal "
    "moments, which is any cube as much as a ball.",
)
def gyroscopic_term_always_there(result):
    from course.rigid_body import problems, quaternion

    def torque(moments: np.ndarray, omega: Floats) -> np.ndarray:
        rates = problems.tumble_acceleration(quaternion.identity(), np.array(omega), moments)
        return -moments * rates

    def term(moments: np.ndarray, omega: Floats) -> float:
        return float(np.linalg.norm(torque(moments, omega)))

    cube, axes = np.full(3, 2.0), np.eye(3)
    draws = [(_moments(result.rng), result.rng.normal(size=3)) for _ in range(50)]
    result.measure("general_nm", term(_EXAMPLE, [1.0, 2.0, 3.0]))
    result.measure("cube_nm", max(term(cube, omega) for _, omega in draws))
    result.measure("about_principal_axis_nm", max(term(m, a * w) for m, w in draws for a in axes))
    result.statement = "The term of moments 1 : 2 : 3 at rates (1, 2, 3), and of 50 random bodies."
    result.statement_holds(
        all(term(cube, omega) > 0 for _, omega in draws),
        only_if="omega is not along a principal axis",
        inside=[term(*draw) > 0 for draw in draws]
        # Chosen to break it: two equal moments, and turns that are almost about an axis.
        + [term(m[[0, 0, 2]], w) > 0 for m, w in draws[:10]]
        + [term(m, a + 1e-6 * w) > 0 for m, w in draws[:3] for a in axes],
        # Of a disc every diameter is a principal axis, of a cube every line.
        outside=[term(m, a * w) > 0 for m, w in draws[:5] for a in axes]
        + [term(m[[0, 0, 2]], w * [1.0, 1.0, 0.0]) > 0 for m, w in draws[:5]],
    )
    result.correction_holds(
        max(term(cube, omega) for _, omega in draws) == 0,
        all(term(m, a * w) == 0 for m, w in draws for a in axes),
        # The term as the simulation has it against the cross product.
        all(np.allclose(torque(m, w), np.cross(w, m * w)) for m, w in draws),
    )


@claim(
    "A spinning top stays up because of the term omega x (I omega).",
    "The equation is written in the body frame. There a top with three equal moments has no such "
    "term, and it stays up all the same: in the simulated {seconds:g} s it tilts by at most "
    "{largest_tilt_deg:.1f} degrees. What holds it up is the angular momentum of the spin. The "
    "torque of gravity turns it sideways instead of tipping the top over. (In a frame that follows "
    "the axis, this turning appears as the term Omega x L.)",
    source="Goldstein, Classical Mechanics, sec. 5.7",
)
def gyroscopic_term_holds_the_top_up(result):
    # Three equal moments about the tip: omega x (I omega) vanishes identically.
    tilt, equal = 0.3, (0.02, 0.02)
    spinning, run, system = _top_run(equal, 60.0, tilt, result.input("seconds", 4.0))
    term = np.abs(np.cross(run.v, system.params[:3] * run.v)).max()
    lowest, fallen = np.degrees(np.arccos(spinning.min())), _top_run(equal, 0.0, tilt, 1.0)[0].min()
    result.measure("largest_term_nm", round(float(term), 12), 1e-4)
    result.measure("largest_tilt_deg", lowest, 1e-4)
    result.measure("without_spin_cos", fallen, 1e-4)
    result.statement = (
        f"Equal moments, 60 rad/s: the term is {term:g} N m, the tilt grows from "
        f"{np.degrees(tilt):.2f} to {lowest:.2f} degrees; without spin the top falls over."
    )
    result.statement_holds(lowest > 60)
    result.correction_holds(term < 1e-12, lowest < 25, fallen < -0.9)


@claim(
    "A spinning top stands upright.",
    "An upright top is stable above the spin {formula}, here {critical_rad_per_s:.1f} rad/s. Below "
    "it a small tilt grows: just below to {largest_tilt_below_rad:.2f} rad and back, far below "
    "until it falls.",
    ask=(
        "Above which spin does an upright symmetric top stand? I1, I3 are about the tip.",
        "spin, omega, w > 2*sqrt(I1*m*g*l)/I3",
        {
            "sqrt(I1*m*g*l)/I3": "The factor 2 is missing: the condition is I3^2 w^2 > 4 I1 m g l.",
            "2*sqrt(m*g*l/I3)": "It takes both moments: I1 resists the fall, I3 carries the spin.",
            "4*I1*m*g*l/I3^2": "Yours is the square of the spin.",
        },
    ),
    source="Goldstein, Classical Mechanics, sec. 5.7 (the sleeping top)",
)
def top_condition(result):
    import sympy

    i1, i3, m, g, length, w = sympy.symbols("I1 I3 m g l w", positive=True)
    # Small horizontal displacement z = x + i y of the axis: I1 z'' - i I3 w z' - m g l z = 0.
    rate = sympy.Symbol("rate")
    characteristic = -i1 * rate**2 + i3 * w * rate - m * g * length  # z = exp(i rate t)
    # Stable if both rates are real, so the discriminant marks the limit.
    result.formula = sympy.solve(sympy.discriminant(characteristic, rate), w)[0]

    def tilt(
        i1: float, ratio: float, share: float, seconds: float = 3.0, dt: float = 1e-3
    ) -> float:
        """Return the largest tilt, started at 0.001 rad with a share of the critical spin [rad]."""
        spin = share * 2 * np.sqrt(i1) / (ratio * i1)
        return float(np.arccos(_top_run((i1, ratio * i1), spin, 1e-3, seconds, dt)[0].min()))

    above, below = (tilt(0.02, 0.2, share, 8.0, 5e-4) for share in (1.01, 0.99))
    result.measure(
        "critical_rad_per_s",
        result.formula.subs({i1: 0.02, i3: 0.004, m: 1, g: 1, length: 1}),
        1e-3,
    )
    result.measure("largest_tilt_above_rad", above, 1e-3)
    result.measure("largest_tilt_below_rad", below, 1e-3)
    result.statement = (
        f"From a tilt of 0.001 rad: 1 % above the critical spin it reaches {above:.4f} rad, 1 % "
        f"below {below:.2f} rad."
    )
    # Flat and slender tops, from 5 to 30 % on either side of the critical spin.
    draws = result.rng.uniform((0.01, 0.2, 0.05), (0.03, 1.6, 0.3), (10, 3))
    result.statement_holds(
        below < 0.05,
        only_if="(I3 omega)^2 > 4 I1 m g l, with omega the spin",
        inside=[tilt(i, ratio, 1 + margin) < 0.05 for i, ratio, margin in draws]
        # Chosen to break it: spins that are hardly above the critical one.
        + [tilt(i, ratio, 1.001) < 0.05 for i, ratio, _ in draws[:4]],
        outside=[tilt(i, ratio, 1 - margin) < 0.05 for i, ratio, margin in draws],
    )
    result.correction_holds(above < 0.05, below > 0.2)


@claim(
    "A body without torque keeps its angular velocity.",
    "Without torque the angular momentum is constant in the world frame. The angular velocity "
    "changes its direction, in the body frame and in the world frame. For the moments 1 : 2 : 3 "
    "the axis of rotation moves by up to {wander_deg:.0f} degrees in this run.",
)
def free_body_keeps_angular_velocity(result):
    from course.rigid_body import problems, simulate

    tumbling = problems.tumble().system
    run = simulate(tumbling, "rk4", 1e-3, 20_000, every=20)
    # In the world frame, where it must be constant without torque.
    momentum = problems.angular_momentum(run.q.T, run.v.T, tumbling.params)
    drift = np.abs(momentum - momentum[:, :1]).max() / np.linalg.norm(momentum[:, 0])
    wander = result.measure("wander_deg", _wander(run.q, run.v), 1e-4)
    result.statement = (
        f"The axis of rotation wanders by {wander:.1f} degrees in space, the angular momentum by "
        f"{drift:.0e} of its size."
    )

    def keeps(axis: int, aside: float) -> bool:
        run = _spin(_moments(result.rng), 3 * np.eye(3)[axis] + aside, 5.0)
        # 0.1 rad/s aside is enough to leave the principal axis.
        return _wander(run.q, run.v) < 1e-4

    result.statement_holds(
        wander < 1e-6,
        only_if="it turns about a principal axis",
        inside=[keeps(axis, 0.0) for axis in (0, 1, 2) for _ in range(5)]
        # Chosen to break it: discs about any diameter, and cubes about any axis.
        + [
            _wander(*_path([2.0, 2.0, third], spin * [1.0, 1.0, float(third == 2.0)])) < 1e-4
            for third in (1.0, 2.0, 3.9)
            for spin in result.rng.normal(size=(3, 3))
        ],
        outside=[keeps(axis, 0.1) for axis in (0, 1, 2) for _ in range(5)],
    )
    result.correction_holds(wander > 1, drift < 1e-9, np.ptp(np.linalg.norm(run.v, axis=1)) > 0.01)


@claim(
    "The wobble of a free body comes from the gyroscopic term.",
    "In the body's frame, where the equation is usually written, it does: without the term no "
    "wobble is left. Behind it is an angular momentum that stays while the inertia turns with the "
    "body. Written as omega = R I^-1 R^T L with L at rest in space, the equation has no such term, "
    "and the body, here with another start than in the simulation above, wobbles by the same "
    "{wander_deg:.0f} degrees.",
)
def wobble_comes_from_the_term(result):
    from course.rigid_body import problems, quaternion, retract

    omega, seconds, n = np.array([1.0, 0.5, 1.5]), 5.0, 4000
    run = _spin(_EXAMPLE, omega, seconds, n)

    def with_momentum(moments, omega, n):
        """Return orientations and body rates from L in space alone, by the midpoint rule."""
        q, spins = np.empty((n + 1, 4)), np.empty((n + 1, 3))
        q[0], momentum = quaternion.identity(), moments * omega
        for i in range(n + 1):
            spins[i] = quaternion.rotate(quaternion.conjugate(q[i]), momentum) / moments
            if i < n:
                # Explicit midpoint rule on the rotation group; the momentum in space is a constant.
                half = retract(q[i], spins[i] * seconds / n / 2)
                middle = quaternion.rotate(quaternion.conjugate(half), momentum) / moments
                q[i + 1] = retract(q[i], middle * seconds / n)
        return q, spins

    def wobbles_by_the_term(moments, omega):
        """Return whether the body wobbles in its own frame, and not once the term is dropped."""
        run = _spin(moments, omega, seconds)
        times = np.linspace(0.0, seconds, 50)
        dropped = np.array([quaternion.exp(t * omega) for t in times])
        still = np.tile(omega, (len(times), 1))
        return _wander(run.q, run.v) > 1.0 > 1e3 * _wander(dropped, still)

    def stops_without_it(moments, omega):
        """Return whether a body that has no such term in its equation has no wobble."""
        return _wander(*with_momentum(moments, omega, 500)) < 1.0

    bodies = [(_moments(result.rng), result.rng.uniform(0.8, 2.0, 3)) for _ in range(8)]
    q, spins = with_momentum(_EXAMPLE, omega, n)
    wander = result.measure("wander_deg", _wander(q, spins), 1e-4)
    # Two formulations of one motion must end in the same attitude; 1e-4 covers the midpoint rule.
    angle = float(quaternion.angle_between(q[-1], run.q[-1]))
    rates = problems.tumble_acceleration(q[0], omega, np.full(3, 2.0))
    result.statement = f"With L only: {wander:.2f} degrees; {angle:.0e} rad off Euler's equations."
    result.statement_holds(
        wander < 1,
        only_if="the equation is written in the body's frame",
        inside=[wobbles_by_the_term(*body) for body in bodies]
        # Chosen to break it: bodies with two equal moments.
        + [wobbles_by_the_term(m[[0, 0, 2]], w) for m, w in bodies[:3]],
        outside=[stops_without_it(*body) for body in bodies],
    )
    result.correction_holds(
        angle < 1e-4, abs(_wander(run.q, run.v) / wander - 1) < 1e-4, not rates.any()
    )


@claim(
    "Spin about a principal axis is stable: a small disturbance stays small.",
    "About the middle axis a disturbance grows at the rate omega sqrt((I2 - I1)(I3 - I2) / (I1 "
    "I3)), {rate_per_s:.3f} per second at {spin_rad_per_s:g} rad/s and 1 : 2 : 3, and the body "
    "turns over again and again. With two equal moments it grows in proportion to time about the "
    "axes that share them.",
    ask=Ask(
        "At which rate does a disturbance of a spin about the middle axis grow?",
        "rate, lambda, s = omega*sqrt((I2-I1)*(I3-I2)/(I1*I3))",
        {
            "omega^2*(I2-I1)*(I3-I2)/(I1*I3)": "Yours is the square of the rate.",
            "omega*sqrt((I2-I1)*(I3-I2))/I2": "Euler's equations 1 and 3 divide by I1 and I3.",
            "omega*sqrt((I2-I1)*(I3-I1)/(I2*I3))": "That belongs to a spin about axis 1, and "
            "there it is a frequency, not a growth.",
        },
        symbols=_FREE,
    ),
    source="Landau and Lifshitz, Mechanics, sec. 37",
)
def principal_axis_is_stable(result):
    import sympy

    i1, i2, i3, w = sympy.symbols("I1 I2 I3 omega", positive=True)
    # Linearised about omega = (0, w, 0): d(w1) = (I2-I3)/I1 w w3, d(w3) = (I1-I2)/I3 w w1.
    result.formula = sympy.sqrt(sympy.factor((i2 - i3) / i1 * w * (i1 - i2) / i3 * w))
    spin = result.input("spin_rad_per_s", 3.0)

    def aside(moments: Floats, axis: int, seconds: float = 10.0) -> np.ndarray:
        """Return largest rate about the other axes at each step, from 1e-7 rad/s, shape (4001,)."""
        start = np.where(np.arange(3) == axis, spin, 1e-7)
        run = _spin(moments, start, seconds, 4000)
        return np.abs(np.delete(run.v, axis, axis=1)).max(axis=1)

    middle = aside(_EXAMPLE, 1, 4.0)
    # Growth over the last second, when the growing mode dominates the decaying one.
    rate = result.measure("rate_per_s", np.log(middle[4000] / middle[3000]), 2e-3)
    theory = result.measure(
        "theory_per_s", result.formula.subs({i1: 1, i2: 2, i3: 3, w: spin}), 2e-3
    )
    others = max(aside(_EXAMPLE, axis).max() for axis in (0, 2))
    shared = aside([2.0, 2.0, 3.0], 0, 20.0)
    result.statement = (
        f"A disturbance about the middle axis grows at {rate:.4f} per second; about the other two "
        f"it stays below {others:.1e} rad/s."
    )
    bodies = [_moments(result.rng) for _ in range(10)]
    result.statement_holds(
        middle[4000] < 1e-6,
        only_if="its moment is the largest or the smallest and no other axis has nearly the same, "
        "or all three are the same",
        inside=[aside(body, axis).max() < 1e-6 for body in bodies for axis in (0, 2)]
        + [aside(np.full(3, body[0]), 1).max() < 1e-6 for body in bodies[:3]],
        outside=[aside(body, 1).max() < 1e-6 for body in bodies]
        # Chosen to break it: moments that nearly agree; a disturbance grows 1/sqrt(gap)-fold.
        + [aside([1.0, 1.0 + gap, 2.0], 0, 200.0).max() < 1e-6 for gap in (1e-4, 1e-3, 3e-3)],
    )
    result.correction_holds(
        abs(rate / float(theory) - 1) < 2e-3,
        shared.max() > 1e-6,
        # With two equal moments the growth is linear: twice the time, twice the size.
        abs(shared[4000] / shared[2000] - 2) < 0.1,
    )


@claim(
    "The wobble of a free asymmetric body is irregular and cannot be foretold.",
    "It has a closed form: the body rates are Jacobi's elliptic functions, with a period that an "
    "elliptic integral gives ({period_s:.3f} s here), and the orientation follows from them.",
    source="Jacobi (1849); Landau and Lifshitz, Mechanics, sec. 37",
)
def tumbling_is_irregular(result):
    from scipy.special import ellipk

    from course.rigid_body import problems, simulate

    problem = problems.tumble()
    error = problem.error(simulate(problem.system, "rk4", 1e-3, 20_000).q[-1])
    (i1, i2, i3), (w1, _, w3) = problem.system.params, problem.system.v0
    # Twice the energy and the squared momentum fix modulus and period of the elliptic functions.
    two_t, square = i1 * w1**2 + i3 * w3**2, (i1 * w1) ** 2 + (i3 * w3) ** 2
    pace = np.sqrt((i3 - i2) * (square - two_t * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (two_t * i3 - square) / ((i3 - i2) * (square - two_t * i1))
    period = result.measure("period_s", float(4 * ellipk(m) / pace), 1e-4)
    # After one period the body rates must be those of the start.
    back = np.abs(problem.truth(period)[1] - problem.system.v0).max()
    result.statement = (
        f"RK4 at 1 ms agrees with the closed form after 20 s to {error:.1e} rad; the body rates "
        f"are back after {period:.4f} s."
    )
    result.statement_holds(error > 1e-3)
    result.correction_holds(error < 1e-9, back < 1e-9)


@claim(
    "A simulation can leave the gyroscopic term out.",
    "Without it the error of the angle grows with the spread of the moments, the spin and time: at "
    "a spread of 1 : 2 : 3 and {spin_rad_per_s:.1f} rad/s it is {after_0_1_s_rad:.4f} rad after a "
    "tenth of a second and {after_2_s_rad:.1f} rad after two seconds.",
)
def gyroscopic_term_is_negligible(result):
    omega, small = np.array([1.0, 0.5, 1.5]), result.input("small", 0.04)
    soon, later = (_without_term(_EXAMPLE, omega, t) for t in (0.1, 2.0))
    result.measure("spin_rad_per_s", np.linalg.norm(omega))
    result.measure("after_0_1_s_rad", soon, 1e-3)
    result.measure("after_2_s_rad", later, 1e-3)
    at_soon = (_EXAMPLE[2] - _EXAMPLE[0]) / _EXAMPLE[0] * (omega @ omega) * 0.1**2
    result.measure(
        "nearly_equal_after_2_s_rad", _without_term([1.0, 1.001, 1.002], omega, 2.0), 1e-3
    )
    allowed = result.input("allowed_rad", 0.01)

    def harmless(low: float, high: float) -> bool:
        """Return whether a spread x (omega t)^2 = small times low to high is harmless."""
        body, rates = _moments(result.rng) ** result.rng.uniform(0.1, 1), result.rng.normal(size=3)
        size = result.rng.uniform(low, high) * small / (body[2] / body[0] - 1)
        seconds = result.rng.uniform(0.1, 3)
        # Scaled so that spread x (omega t)^2 has the drawn size, whatever the direction.
        rates *= np.sqrt(size) / np.linalg.norm(rates) / seconds
        return _without_term(body, rates, seconds) < allowed

    # Chosen to break it: the largest term, two equal moments and the spin halfway between an equal
    # axis and the third.
    worst = [
        _without_term([1.0, 1.0, 1.0 + spread], np.sqrt(0.5 * small / spread) * axis, 1.0) < allowed
        for spread in (0.01, 0.05, 0.2, 0.5, 1.0)
        for axis in (np.array([1.0, 0.0, 1.0]), np.array([0.0, 1.0, 1.0]))
    ]
    result.statement = "Angle between runs with and without the term."
    result.statement_holds(
        later < allowed,
        only_if="you accept the error of the angle; it stays below {allowed_rad} rad while "
        "(I3 - I1) / I1 x (omega t)^2 is below {small}",
        inside=[harmless(0, 1) for _ in range(30)] + worst,
        outside=[harmless(1, 4) for _ in range(30)],
    )
    # The condition is enough, not necessary: after 0.1 s it is not met, and the error is allowed.
    result.correction_holds(at_soon > small and soon < allowed < 1 < later)


@claim(
    "Games leave the gyroscopic term out; robotics cannot.",
    "Both can, and both do. A tool that turns by less than {turned_rad} rad is off by "
    "{slow_rad:.0e} rad without the term; MuJoCo always has it; PhysX, the engine under a robotics "
    "simulator, keeps it behind a flag of each body, off unless raised, which that simulator's "
    "scene format raises. Ask what yours does before you spin something.",
    source="PhysX 5.6 SDK: PxRigidBodyFlag::eENABLE_GYROSCOPIC_FORCES, gyroscopicForces = false "
    "in PxConstructSolverBodies; Omniverse USD physics schema 104.2: "
    "physxRigidBody:enableGyroscopicForces = 1; MuJoCo 3, Computation: the bias force c(q, v)",
)
def robotics_cannot_drop_the_term(result):
    import mujoco

    free = (
        "<mujoco><option gravity='0 0 0' timestep='1e-3' "
        "integrator='RK4'/><worldbody><body><freejoint/><inertial pos='0 0 0' mass='1' "
        "diaginertia='1 2 2.9'/></body></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(free)
    data, omega = mujoco.MjData(model), np.array([1.0, 0.5, 1.5])
    data.qvel[3:] = omega
    for _ in range(2000):
        mujoco.mj_step(model, data)
    moments = np.array([1.0, 2.0, 2.9])
    # MuJoCo's body rates against our own integration of Euler's equations.
    error = np.abs(data.qvel[3:] - _spin(moments, omega, 2.0).v[-1]).max()
    turned = result.input("turned_rad", 0.05)
    slow = _without_term(moments, turned * omega / np.linalg.norm(omega), 1.0)
    result.measure("slow_rad", slow, 1e-3)
    result.measure("changed_in_mujoco_rad_per_s", np.abs(data.qvel[3:] - omega).max(), 1e-3)
    result.statement = (
        f"MuJoCo's free body: rates within {error:.0e} rad/s of Euler's equations, 2 s."
    )
    result.statement_holds(slow > 0.01)
    result.correction_holds(slow < 1e-3, error < 1e-6, np.abs(data.qvel[3:] - omega).max() > 0.1)
