"""Claims about the gyroscopic term, tops and tumbling bodies."""

import numpy as np

from course.derivations import Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol


@claim(
    "euler_equation_point",
    1,
    "Torque is I alpha + omega x (I omega).",
    verdict=Verdict.CONDITIONAL,
    condition="moments are taken about the centre of mass or a point fixed in space",
    corrected="About another point of a moving body the term m c x a_P is missing. And I, alpha "
    "and "
    "omega must be in one frame: I is constant in the body frame alone.",
    figures={"torque_found_about_p_nm": (0.7186407, 1e-6)},
    source="Featherstone, Rigid Body Dynamics Algorithms (2008), sec. 2.15",
)
def _euler_equation_point() -> Finding:
    from course.rigid_body import problems, quaternion

    moments, mass, offset = np.array([1.0, 2.0, 3.0]), 2.0, np.array([0.5, 0.0, 0.3])
    omega = np.array([1.0, 2.0, -1.0])
    alpha = problems.tumble_acceleration(np.array([1.0, 0, 0, 0]), omega, moments)
    about_centre = moments * alpha + np.cross(omega, moments * omega)
    # A point P of the body with the centre at P + offset; no force acts, so no torque about P.
    shift = mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    inertia = np.diag(moments) + shift
    about_p = inertia @ alpha + np.cross(omega, inertia @ omega)
    a_p = -(np.cross(alpha, offset) + np.cross(omega, np.cross(omega, offset)))
    with_term = about_p + mass * np.cross(offset, a_p)
    # Along a true run the world frame's L = R I omega is constant only with I from the body.
    run = problems.tumble(duration=1.0)
    q0, v0 = run.truth(0.0)
    q1, v1 = run.truth(1.0)
    change = quaternion.rotate(q1, run.system.params * v1) - quaternion.rotate(
        q0, run.system.params * v0
    )
    wrong = float(np.linalg.norm(about_p))
    return Finding(
        {"torque_found_about_p_nm": wrong},
        f"A body without any force: {wrong:.3g} N m appear about a point 0.58 m off its centre, "
        f"{np.linalg.norm(about_centre):.0e} about the centre.",
        holds=wrong < 1e-9,
        holds_if=bool(np.linalg.norm(about_centre) < 1e-12),
        corrected=bool(np.linalg.norm(with_term) < 1e-12 and np.linalg.norm(change) < 1e-12),
    )


@claim(
    "gyroscopic_term_always_there",
    1,
    "Every turning body has a gyroscopic term omega x (I omega).",
    verdict=Verdict.CONDITIONAL,
    condition="omega is not along a principal axis",
    corrected="It is zero for a turn about a principal axis, and for every turn of a body with "
    "three equal moments, which is any cube as much as a ball.",
    figures={
        "general_nm": (8.717798, 1e-6),
        "cube_nm": (0, 1e-6),
        "about_principal_axis_nm": (0, 1e-6),
    },
)
def _gyroscopic_term_always_there() -> Finding:
    def term(inertia: np.ndarray, omega: np.ndarray) -> float:
        return float(np.linalg.norm(np.cross(omega, inertia @ omega)))

    general, cube = np.diag([1.0, 2.0, 3.0]), np.eye(3) * 2.0
    omega = np.array([1.0, 2.0, 3.0])
    about_axes = max(term(general, axis) for axis in np.eye(3))
    found = term(general, omega)
    return Finding(
        {"general_nm": found, "cube_nm": term(cube, omega), "about_principal_axis_nm": about_axes},
        "The term for moments (1, 2, 3) and (2, 2, 2) at omega = (1, 2, 3).",
        holds=about_axes > 0 and term(cube, omega) > 0,
        holds_if=found > 0,
        corrected=about_axes == 0 and term(cube, omega) < 1e-12,
    )


def _top_run(inertia: tuple[float, float], spin: float, tilt: float, duration: float):
    """Cosines of the tilt along a run of a heavy top with m g l = 1 N m, and the states."""
    from course.rigid_body import integrators, problems

    system = problems.heavy_top(inertia, 1.0, tilt, spin, duration).system
    steps = round(duration / 5e-4)
    run = integrators.simulate(system, "rk4", 5e-4, steps, every=10)
    return problems.top_height(run.q.T), run, system


@claim(
    "gyroscopic_term_holds_the_top_up",
    1,
    "A spinning top stays up because of the term omega x (I omega).",
    verdict=Verdict.FALSE,
    corrected="In the body's own frame, where the equation holds, a top with three equal moments "
    "has no such term at any time and stays up just the same. What holds it is the spin's angular "
    "momentum, which the torque of gravity turns sideways instead of tipping the top over. (Seen "
    "from a frame that precesses with the axis, that turning is the term Omega x L.)",
    figures={
        "largest_term_nm": (0, 1e-4),
        "largest_tilt_deg": (17.67862, 1e-4),
        "without_spin_cos": (-0.9997165, 1e-4),
    },
    source="Goldstein, Classical Mechanics, sec. 5.7",
)
def _gyroscopic_term_holds_the_top_up() -> Finding:
    tilt = 0.3
    spinning, run, system = _top_run((0.02, 0.02), 60.0, tilt, 4.0)
    resting, _, _ = _top_run((0.02, 0.02), 0.0, tilt, 1.0)
    moments = system.params[:3]
    term = float(np.abs(np.cross(run.v, moments * run.v)).max())
    lowest, fallen = float(np.degrees(np.arccos(spinning.min()))), float(resting.min())
    return Finding(
        {
            "largest_term_nm": round(term, 12),
            "largest_tilt_deg": lowest,
            "without_spin_cos": fallen,
        },
        f"Equal moments, 60 rad/s: the term is {term:g} N m, the tilt stays below {lowest:.2f} "
        f"degrees for 4 s (it starts at {np.degrees(tilt):.2f}); without spin it falls over.",
        holds=lowest > 60,
        corrected=term < 1e-12 and lowest < 25 and fallen < -0.9,
    )


@claim(
    "top_condition",
    1,
    "A spinning top stands upright.",
    verdict=Verdict.CONDITIONAL,
    condition="I3^2 spin^2 > 4 I1 m g l",
    corrected="An upright top is stable above the spin 2 sqrt(I1 m g l) / I3 and falls below it.",
    figures={
        "critical_rad_per_s": (70.71068, 1e-3),
        "largest_tilt_above_rad": (0.007121745, 1e-3),
        "largest_tilt_below_rad": (0.2831663, 1e-3),
    },
    formula=Formula(
        "Above which spin does an upright symmetric top stand? I1, I3 are about the tip.",
        "2*sqrt(I1*m*g*l)/I3",
        {
            "I1": Symbol("moment across the axis [kg m^2]"),
            "I3": Symbol("moment along the axis [kg m^2]"),
            "m": Symbol("mass [kg]"),
            "g": Symbol("gravity [m/s^2]"),
            "l": Symbol("tip to centre of mass [m]"),
        },
        left=("spin", "omega", "w"),
        relation=">",
        slips={
            "sqrt(I1*m*g*l)/I3": "The factor 2 is missing: the condition is I3^2 w^2 > 4 I1 m g l.",
            "2*sqrt(m*g*l/I3)": "It takes both moments: I1 resists the fall, I3 carries the spin.",
            "4*I1*m*g*l/I3^2": "That is the square of the spin.",
        },
    ),
    source="Goldstein, Classical Mechanics, sec. 5.7 (the sleeping top)",
)
def _top_condition() -> Finding:
    import sympy

    i1, i3, m, g, length, w = sympy.symbols("I1 I3 m g l w", positive=True)
    # Small horizontal displacement z = x + i y of the axis: I1 z'' - i I3 w z' - m g l z = 0.
    rate = sympy.Symbol("rate")
    characteristic = -i1 * rate**2 + i3 * w * rate - m * g * length  # z = exp(i rate t)
    critical = sympy.solve(sympy.discriminant(characteristic, rate), w)[0]
    inertia, weight = (0.02, 0.004), 1.0
    spin = 2 * np.sqrt(inertia[0] * weight) / inertia[1]
    above, _, _ = _top_run(inertia, 1.01 * spin, 1e-3, 8.0)
    below, _, _ = _top_run(inertia, 0.99 * spin, 1e-3, 8.0)
    stands, falls = float(np.arccos(above.min())), float(np.arccos(below.min()))
    return Finding(
        {
            "critical_rad_per_s": spin,
            "largest_tilt_above_rad": stands,
            "largest_tilt_below_rad": falls,
        },
        f"From a tilt of 0.001 rad: 1 % above {spin:.2f} rad/s it reaches {stands:.4f} rad, 1 % "
        f"below it reaches {falls:.2f} rad.",
        holds=falls < 0.05,
        holds_if=stands < 0.05,
        corrected=stands < 0.05 and falls > 0.2,
        formula=critical,
    )


@claim(
    "free_body_keeps_angular_velocity",
    1,
    "A body without torque keeps its angular velocity.",
    verdict=Verdict.CONDITIONAL,
    condition="it turns about a principal axis",
    corrected="Without torque the angular momentum in space stays; the angular velocity "
    "wanders, in "
    "the body and in space.",
    figures={"wander_deg": (42.2533, 1e-4)},
)
def _free_body_keeps_angular_velocity() -> Finding:
    from course.rigid_body import integrators, problems, quaternion

    problem = problems.tumble()
    run = integrators.simulate(problem.system, "rk4", 1e-3, 20_000, every=20)
    omega = quaternion.rotate(run.q.T, run.v.T)
    direction = omega / np.linalg.norm(omega, axis=0)
    wander = float(np.degrees(np.arccos(np.clip(direction[:, 0] @ direction, -1, 1)).max()))
    momentum = problems.angular_momentum(run.q.T, run.v.T, problem.system.params)
    size = np.linalg.norm(momentum[:, 0])
    drift = float(np.abs(momentum - momentum[:, :1]).max() / size)
    axis = np.array([0.0, 2.0, 0.0])
    steady = float(
        np.abs(problems.tumble_acceleration(run.q[0], axis, problem.system.params)).max()
    )
    return Finding(
        {"wander_deg": wander},
        f"Moments (1, 2, 3): the axis of rotation wanders by {wander:.1f} degrees in space, the "
        f"angular momentum by {drift:.0e} of its size.",
        holds=wander < 1e-6,
        holds_if=steady == 0.0,
        corrected=wander > 1 and drift < 1e-9,
    )


@claim(
    "principal_axis_is_stable",
    1,
    "Spin about a principal axis is steady.",
    verdict=Verdict.CONDITIONAL,
    condition="it is the axis of the largest or the smallest moment",
    corrected="About the middle axis a disturbance grows at the rate "
    "omega sqrt((I2 - I1)(I3 - I2) / (I1 I3)), and the body turns over again and again.",
    figures={"rate_per_s": (1.732162, 2e-3), "theory_per_s": (1.732051, 2e-3)},
    formula=Formula(
        "At which rate does a disturbance of a spin about the middle axis grow?",
        "omega*sqrt((I2-I1)*(I3-I2)/(I1*I3))",
        {
            "omega": Symbol("spin [rad/s]"),
            "I1": Symbol("smallest moment [kg m^2]", 1.0, 2.0),
            "I2": Symbol("middle moment [kg m^2]", 2.0, 3.0),
            "I3": Symbol("largest moment [kg m^2]", 3.0, 4.0),
        },
        left=("rate", "lambda", "s"),
        slips={
            "omega^2*(I2-I1)*(I3-I2)/(I1*I3)": "That is the square of the rate.",
            "omega*sqrt((I2-I1)*(I3-I2))/I2": "Euler's equations 1 and 3 divide by I1 and I3.",
            "omega*sqrt((I2-I1)*(I3-I1)/(I2*I3))": "That belongs to a spin about axis 1, and "
            "there it is a frequency, not a growth.",
        },
    ),
    source="Landau and Lifshitz, Mechanics, sec. 37",
)
def _principal_axis_is_stable() -> Finding:
    import sympy

    from course.rigid_body import integrators, problems, quaternion

    i1, i2, i3, w = sympy.symbols("I1 I2 I3 omega", positive=True)
    # Linearised about omega = (0, w, 0): d(w1) = (I2-I3)/I1 w w3, d(w3) = (I1-I2)/I3 w w1.
    grown = (i2 - i3) / i1 * w * (i1 - i2) / i3 * w  # the rate's square
    moments = np.array([1.0, 2.0, 3.0])
    grows = []
    for axis in range(3):
        start = np.full(3, 1e-7)
        start[axis] = 3.0
        system = integrators.System(
            "spin", problems.tumble_acceleration, moments, quaternion.identity(), start
        )
        run = integrators.simulate(system, "rk4", 1e-3, 4000, every=1000)
        grows.append(np.abs(np.delete(run.v, axis, axis=1)).max(axis=1))
    theory = 3.0 * np.sqrt(1.0 / 3.0)
    rate = float(np.log(grows[1][4] / grows[1][3]))  # between 3 s and 4 s
    others = max(float(grows[0].max()), float(grows[2].max()))
    return Finding(
        {"rate_per_s": rate, "theory_per_s": theory},
        f"At 3 rad/s about the middle axis a disturbance grows at {rate:.4f} per second; about the "
        f"other two it stays below {others:.1e} rad/s.",
        holds=grows[1][4] < 1e-6,
        holds_if=others < 1e-6,
        corrected=abs(rate / theory - 1) < 2e-3,
        formula=sympy.sqrt(sympy.factor(grown)),
    )


@claim(
    "tumbling_is_irregular",
    1,
    "The wobble of a free asymmetric body is irregular and cannot be foretold.",
    verdict=Verdict.FALSE,
    corrected="It has a closed form: the body rates are Jacobi's elliptic functions, with a period "
    "that an elliptic integral gives, and the orientation follows from them.",
    figures={"period_s": (4.358361, 1e-4)},
    source="Jacobi (1849); Landau and Lifshitz, Mechanics, sec. 37",
)
def _tumbling_is_irregular() -> Finding:
    from scipy.special import ellipk

    from course.rigid_body import integrators, problems

    problem = problems.tumble()
    run = integrators.simulate(problem.system, "rk4", 1e-3, 20_000)
    error = problem.error(run.q[-1])
    (i1, i2, i3), (w1, w3) = problem.system.params, (1.0, 1.5)
    two_t, square = i1 * w1**2 + i3 * w3**2, (i1 * w1) ** 2 + (i3 * w3) ** 2
    pace = np.sqrt((i3 - i2) * (square - two_t * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (two_t * i3 - square) / ((i3 - i2) * (square - two_t * i1))
    period = float(4 * ellipk(m) / pace)
    back = float(np.abs(problem.truth(period)[1] - problem.system.v0).max())
    return Finding(
        {"period_s": period},
        f"RK4 at 1 ms agrees with the closed form after 20 s to {error:.1e} rad; the body rates "
        f"are back after {period:.4f} s.",
        holds=error > 1e-3,
        corrected=error < 1e-9 and back < 1e-9,
    )


@claim(
    "gyroscopic_term_is_negligible",
    1,
    "A simulation can leave the gyroscopic term out.",
    verdict=Verdict.CONDITIONAL,
    condition="the moments are nearly equal, or the body hardly turns during the run",
    corrected="Without it the error of the angle grows with the spread of the moments, the spin "
    "and "
    "time: at a spread of 1:2:3 and 1.8 rad/s it is beyond a radian within seconds.",
    figures={
        "after_0_1_s_rad": (0.008381986, 1e-3),
        "after_2_s_rad": (1.28023, 1e-3),
        "nearly_equal_after_2_s_rad": (0.004179723, 1e-3),
    },
)
def _gyroscopic_term_is_negligible() -> Finding:
    from course.rigid_body import integrators, problems, quaternion

    def error(moments: list[float], seconds: float) -> float:
        start = np.array([1.0, 0.5, 1.5])
        system = integrators.System(
            "tumble", problems.tumble_acceleration, np.array(moments), quaternion.identity(), start
        )
        run = integrators.simulate(system, "rk4", 1e-3, round(seconds * 1000))
        without = quaternion.exp(seconds * start)
        return float(quaternion.angle_between(run.q[-1], without))

    soon, later = error([1.0, 2.0, 3.0], 0.1), error([1.0, 2.0, 3.0], 2.0)
    nearly_equal = error([1.0, 1.001, 1.002], 2.0)
    return Finding(
        {
            "after_0_1_s_rad": soon,
            "after_2_s_rad": later,
            "nearly_equal_after_2_s_rad": nearly_equal,
        },
        "Angle between runs with and without the term.",
        holds=later < 0.01,
        holds_if=nearly_equal < 0.01 and soon < 0.02,
        corrected=later > 1,
    )
