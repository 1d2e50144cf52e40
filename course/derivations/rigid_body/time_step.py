"""Claims of chapter 2: the derivation of the largest stable time step of a stiff contact."""

import numpy as np

from course.derivations import Ask, Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol

SYMBOLS = {
    "m": Symbol("mass [kg]"),
    "k": Symbol("stiffness [N/m]"),
    "omega": Symbol("angular frequency [rad/s]"),
    "h": Symbol("step [s]"),
    "zeta": Symbol("damping ratio", 0.01, 0.99),
}
_OMEGA = {"omega": Symbol("angular frequency [rad/s]")}
_OMEGA_H = _OMEGA | {"h": Symbol("step [s]")}
_DAMPED = _OMEGA | {"zeta": Symbol("damping ratio", 0.01, 0.99)}
_LIMIT = ("h", "dt")


@claim(
    "explicit_undamped_limit",
    1,
    "Explicit Euler is stable on an undamped spring while dt < 2 sqrt(m / k).",
    verdict=Verdict.FALSE,
    corrected="It is unstable at every step: both eigenvalues have the modulus "
    "sqrt(1 + (omega dt)^2) > 1. The limit 2 sqrt(m / k) belongs to semi-implicit Euler.",
    figures={"amplitude_after_1000_at_0_2": (328601600.0, 1e-6), "radius_at_0_1": (1.004988, 1e-6)},
)
def _explicit_undamped_limit() -> Finding:
    from course.derivations.rigid_body.linear import spectral_radius
    from course.rigid_body import integrators, problems

    system = problems.oscillator(omega=1.0).system
    tenth = integrators.simulate(system, "explicit_euler", 0.2, 1000)  # a tenth of the limit said
    grown = float(np.hypot(tenth.q[-1, 0], tenth.v[-1, 0]))
    radii = [spectral_radius("explicit_euler", x) for x in (1e-3, 0.1, 1.9)]
    return Finding(
        {"amplitude_after_1000_at_0_2": grown, "radius_at_0_1": radii[1]},
        f"At omega dt = 0.2 the amplitude is {grown:.2e} of the start after 1000 steps.",
        holds=max(radii) <= 1,
        corrected=min(radii) > 1 and abs(radii[1] - np.sqrt(1.01)) < 1e-12,
    )


@claim(
    "explicit_eigenvalues",
    1,
    "The eigenvalues of explicit Euler's step are 1 - dt^2 k/(2m) +- i dt sqrt(k/m - dt^2 "
    "k^2/(4m^2)).",
    verdict=Verdict.FALSE,
    corrected="They are 1 +- i omega dt. The eigenvalues quoted are those of semi-implicit Euler, "
    "whose modulus is 1 below its limit.",
    figures={"modulus_at_half": (1.118034, 1e-6), "quoted_modulus_at_half": (1, 1e-6)},
    formula=Formula(
        "What is the modulus of the eigenvalues of explicit Euler's step on an undamped spring?",
        "sqrt(1 + omega^2*h^2)",
        {"omega": Symbol("sqrt(k/m) [rad/s]"), "h": Symbol("step [s]")},
        left=("r", "modulus", "lambda"),
        slips={
            "1 + omega^2*h^2": "That is its square, which is also the determinant.",
            "1": "That is semi-implicit Euler below its limit.",
            "1 + omega*h": "The eigenvalues are 1 +- i omega h; take the modulus of that.",
        },
    ),
)
def _explicit_eigenvalues() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols

    h, omega, _ = symbols()
    explicit = set(step_matrix("explicit_euler").eigenvals())
    right = {1 + sympy.I * omega * h, 1 - sympy.I * omega * h}
    root = sympy.sqrt(omega**2 - h**2 * omega**4 / 4)
    quoted = 1 - h**2 * omega**2 / 2 + sympy.I * h * root

    def solves(matrix: sympy.Matrix, value: sympy.Expr) -> bool:
        return bool(sympy.simplify((matrix - value * sympy.eye(2)).det()) == 0)

    at = {omega: 1, h: sympy.Rational(1, 2)}
    modulus = sympy.sqrt(sympy.expand((1 + sympy.I * omega * h) * (1 - sympy.I * omega * h)))
    return Finding(
        {"modulus_at_half": float(modulus.subs(at)),
         "quoted_modulus_at_half": float(abs(quoted.subs(at)))},
        "Characteristic polynomial of the step's matrix, by algebra.",
        holds=solves(step_matrix("explicit_euler"), quoted),
        corrected=explicit == right and solves(step_matrix("semi_implicit_euler"), quoted),
        formula=modulus,
    )  # fmt: skip


@claim(
    "semi_implicit_unconditional",
    1,
    "Semi-implicit Euler is stable for any step, because its determinant is 1.",
    verdict=Verdict.FALSE,
    corrected="It is stable while omega dt < 2. Beyond it the eigenvalues are real and one of them "
    "is larger than 1.",
    figures={"largest_6_3_ms_m": (11.3588, 1e-6), "largest_6_5_ms_m": (6.886e20, 1e-6)},
)
def _semi_implicit_unconditional() -> Finding:
    from course.rigid_body import integrators, problems

    system = problems.oscillator(omega=np.sqrt(1e5)).system

    def largest(dt: float) -> float:
        run = integrators.simulate(system, "semi_implicit_euler", dt, 100, every=1)
        return float(np.abs(run.q).max())

    inside, outside = largest(0.0063), largest(0.0065)
    return Finding(
        {"largest_6_3_ms_m": inside, "largest_6_5_ms_m": outside},
        "100 kN/m on 1 kg, released at 1 m, 100 steps.",
        holds=outside < 100,
        corrected=inside < 100 < outside,
    )


@claim(
    "Semi-implicit Euler's largest stable step on an undamped spring is 2 sqrt(m / k).",
    "Its eigenvalues leave the unit circle where the trace 2 - (omega dt)^2 reaches -2, at "
    "omega dt = 2 with omega = sqrt(k / m): {formula}, which is {limit_ms:.2f} ms for "
    "{stiffness_n_per_m:.0f} N/m on {mass_kg:.0f} kg.",
    ask=Ask(
        "What is the largest stable step of semi-implicit Euler for a mass m on a spring k?",
        "dt < 2*sqrt(m/k)",
        {
            "sqrt(m/k)": "The factor 2 is missing: the trace reaches -2 at omega dt = 2.",
            "2*sqrt(k/m)": "That is 2 omega, a rate; a stiffer spring needs a smaller step.",
            "2*m/k": "The root is missing: check the units.",
            "4*m/k": "That is the square of the limit.",
        },
        also={"omega": "sqrt(k/m)"},
    ),
)
def semi_implicit_limit(found):
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, step_matrix, symbols

    h, omega, _ = symbols()
    m, k = sympy.symbols("m k", positive=True)
    A = step_matrix("semi_implicit_euler")
    heavy = {m: found.given("mass_kg", 1), k: found.given("stiffness_n_per_m", 100_000)}
    limit = sympy.solve(A.trace() + 1 + A.det(), h)[0].subs(omega, sympy.sqrt(k / m))
    measured = found.figure("omega_h", measured_limit("semi_implicit_euler"))
    found.figure("limit_ms", 1000 * float(limit.subs(heavy)))
    found.statement = f"By bisection on the eigenvalues omega dt = {measured:.6f}."
    found.formula = sympy.simplify(limit)
    found.heard(abs(measured - 2) < 1e-6)
    found.corrected(sympy.simplify(A.trace() - (2 - (omega * h) ** 2)) == 0)


@claim(
    "contact_limit_explicit",
    1,
    "For a contact of 100 kN/m on 1 kg explicit Euler may step up to 6.3 ms.",
    verdict=Verdict.FALSE,
    corrected="6.32 ms is the limit of semi-implicit Euler. Explicit Euler has none without "
    "damping: "
    "at 1 ms it gains a tenth of the energy per step.",
    figures={
        "semi_implicit_limit_ms": (6.324555, 1e-6),
        "explicit_gain_per_step_1_ms": (0.1, 1e-6),
    },
    formula=Formula(
        "k = 100,000 N/m, m = 1 kg, no damping: the largest stable step of semi-implicit Euler, "
        "in milliseconds?",
        "2000*sqrt(1/100000)",
        {},
        left=(*_LIMIT, "limit"),
        relation="<",
        tolerance=2e-3,
        slips={
            "1000*sqrt(1/100000)": "The factor 2 is missing.",
            "2*sqrt(1/100000)": "That is in seconds; milliseconds are asked.",
            "1000*2*sqrt(100000)": "m / k stands under the root, not k / m.",
        },
    ),
)
def _contact_limit_explicit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, spectral_radius

    omega = np.sqrt(1e5)
    semi = 1000 * measured_limit("semi_implicit_euler") / omega
    gain = spectral_radius("explicit_euler", omega * 1e-3) ** 2 - 1
    return Finding(
        {"semi_implicit_limit_ms": semi, "explicit_gain_per_step_1_ms": gain},
        f"Semi-implicit: {semi:.4f} ms. Explicit Euler at 1 ms: {100 * gain:.0f} % more energy at "
        "every step.",
        holds=gain <= 0,
        corrected=abs(semi - 6.3246) < 1e-3 and abs(gain - 0.1) < 1e-9,
        formula=2000 * sympy.sqrt(sympy.Rational(1, 100_000)),
    )


@claim(
    "A contact of 100 kN/m on 1 kg is stable at 1 kHz and explodes at 100 Hz.",
    "For semi-implicit Euler, velocity Verlet and RK4, yes. Explicit Euler explodes at both rates, "
    "the implicit midpoint rule at neither.",
)
def contact_stable_at_1_khz(found):
    from course.derivations.rigid_body.linear import spectral_radius

    omega = np.sqrt(1e5)
    names = ("explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4", "implicit_midpoint")
    radii = {n: [spectral_radius(n, omega * dt) for dt in (1e-3, 1e-2)] for n in names}
    as_said = {name: fast <= 1 + 1e-6 < slow for name, (fast, slow) in radii.items()}
    limited = ("semi_implicit_euler", "velocity_verlet", "rk4")
    found.figure("explicit_1_khz", radii["explicit_euler"][0], tolerance=1e-4)
    found.figure("semi_implicit_100_hz", radii["semi_implicit_euler"][1], tolerance=1e-4)
    found.figure("implicit_midpoint_100_hz", radii["implicit_midpoint"][1], tolerance=1e-4)
    found.statement = "Largest growth factor of the amplitude per step."
    found.heard(
        all(as_said.values()),
        only_if="the integrator is semi-implicit Euler or another explicit one with a real limit",
        inside=[as_said[n] for n in limited],
        outside=[as_said[n] for n in names if n not in limited],
        cases=True,
    )
    found.corrected(radii["explicit_euler"][0] > 1, radii["implicit_midpoint"][1] < 1 + 1e-6)


@claim(
    "A step whose determinant is 1 has its eigenvalues on the unit circle.",
    "Determinant 1 only says that the two multiply to 1. With a larger trace they are real, lambda "
    "and 1 / lambda, and one of them is outside.",
)
def determinant_one_is_stable(found):
    from course.derivations.rigid_body.linear import numeric_matrix

    def on_circle(matrix: np.ndarray) -> bool:
        return np.allclose(np.abs(np.linalg.eigvals(matrix)), 1)

    def drawn(trace: float) -> np.ndarray:
        """A matrix of this trace and determinant 1."""
        a, b = found.rng.uniform(-3, 3), found.rng.uniform(0.5, 2)
        return np.array([[a, b], [(a * (trace - a) - 1) / b, trace - a]])

    outer, inner = np.sort(np.linalg.eigvals(numeric_matrix("semi_implicit_euler", 2.1)).real)
    found.figure("outer_at_2_1", outer)
    found.figure("inner_at_2_1", inner)
    found.statement = "Semi-implicit Euler at omega dt = 2.1: both real, product 1."
    outside = found.rng.uniform(2.001, 2.2, 20) * found.rng.choice([-1, 1], 20)
    found.heard(
        on_circle(numeric_matrix("semi_implicit_euler", 2.1)),
        only_if="its trace lies between -2 and 2",
        inside=[on_circle(drawn(trace)) for trace in found.rng.uniform(-1.999, 1.999, 50)],
        outside=[on_circle(drawn(trace)) for trace in outside],
    )
    found.corrected(abs(outer * inner - 1) < 1e-9, abs(outer) > 1.1)


@claim(
    "stable_at_the_limit",
    1,
    "At omega dt = 2 exactly, semi-implicit Euler is still just stable.",
    verdict=Verdict.FALSE,
    corrected="-1 is then a double eigenvalue with a single eigenvector: the state alternates in "
    "sign and grows linearly, without bound.",
    figures={"after_500_m": (1001, 1e-6), "after_1000_m": (2001, 1e-6)},
)
def _stable_at_the_limit() -> Finding:
    from course.derivations.rigid_body.linear import step_matrix, symbols
    from course.rigid_body import integrators, problems

    h, omega, _ = symbols()
    A = step_matrix("semi_implicit_euler").subs({omega: 1, h: 2})
    ((value, multiplicity, vectors),) = A.eigenvects()
    system = problems.oscillator(omega=1.0).system
    run = integrators.simulate(system, "semi_implicit_euler", 2.0, 1000, every=500)
    after = np.abs(run.q[:, 0])
    return Finding(
        {"after_500_m": float(after[1]), "after_1000_m": float(after[2])},
        f"Eigenvalue {value} of multiplicity {multiplicity}; released at 1 m.",
        holds=after[2] < 10,
        corrected=(value, multiplicity, len(vectors)) == (-1, 2, 1)
        and abs((after[2] - after[1]) - (after[1] - after[0])) < 3,
    )


@claim(
    "explicit_damped_limit",
    1,
    "Damping does not help explicit Euler.",
    verdict=Verdict.FALSE,
    corrected="With a damping ratio below 1 it is stable up to dt = 2 zeta / omega, which for "
    "light "
    "damping is a small fraction of semi-implicit Euler's limit.",
    figures={"omega_h_at_zeta_0_1": (0.2, 1e-6)},
    formula=Formula(
        "x'' = -omega^2 x - 2 zeta omega x' with zeta < 1: the largest stable step of explicit "
        "Euler?",
        "2*zeta/omega",
        _DAMPED,
        left=_LIMIT,
        relation="<",
        slips={
            "2/omega": "That is semi-implicit Euler without damping.",
            "zeta/omega": "The factor 2 is missing: |lambda|^2 = 1 - 2 zeta omega h + (omega h)^2.",
            "1/(zeta*omega)": "That is the limit of the decay alone, without the oscillation.",
        },
    ),
)
def _explicit_damped_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, step_matrix, symbols

    h = symbols()[0]
    # Below zeta = 1 the eigenvalues are a complex pair, so that |lambda|^2 is the determinant.
    squared = sympy.expand(step_matrix("explicit_euler", damped=True).det())
    limit = sympy.solve(sympy.cancel((squared - 1) / h), h)[0]
    measured = measured_limit("explicit_euler", 0.1, low=0.1)
    close = [
        abs(measured_limit("explicit_euler", z, low=z) / (2 * z) - 1) for z in (0.05, 0.3, 0.7)
    ]
    return Finding(
        {"omega_h_at_zeta_0_1": measured},
        f"|lambda|^2 = {squared}.",
        holds=measured < 1e-3,
        corrected=max(close) < 1e-6,
        formula=limit,
    )


@claim(
    "semi_implicit_damped_limit",
    1,
    "Damping lets semi-implicit Euler take larger steps.",
    verdict=Verdict.CONDITIONAL,
    condition="the damping force is taken implicitly",
    corrected="With the damping force taken from the old velocity the limit falls to "
    "2 (sqrt(1 + zeta^2) - zeta) / omega. Taken implicitly, as in MuJoCo, it rises to "
    "2 (sqrt(1 + zeta^2) + zeta) / omega.",
    figures={
        "omega_h_explicit_damping": (1.236068, 1e-6),
        "omega_h_implicit_damping": (3.236068, 1e-6),
    },
    formula=Formula(
        "x'' = -omega^2 x - 2 zeta omega x', both forces from the old state: the largest stable "
        "step of semi-implicit Euler?",
        "2*(sqrt(1 + zeta^2) - zeta)/omega",
        _DAMPED,
        left=_LIMIT,
        relation="<",
        slips={
            "2/omega": "That is without damping.",
            "2*zeta/omega": "That is explicit Euler.",
            "2*(sqrt(1 + zeta^2) + zeta)/omega": "That is with the damping taken implicitly.",
            "2*sqrt(1 - zeta^2)/omega": "The damped frequency is not what counts: -1 becomes an "
            "eigenvalue where 1 + trace + det = 0.",
        },
    ),
)
def _semi_implicit_damped_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, step_matrix, symbols

    h, omega, zeta = symbols()
    A = step_matrix("semi_implicit_euler", damped=True)
    limit = next(
        root
        for root in sympy.solve(sympy.expand(1 + A.trace() + A.det()), h)
        if root.subs({omega: 1, zeta: 1}) > 0
    )
    z = 0.5
    measured = measured_limit("semi_implicit_euler", z, low=0.1)
    theory = float(limit.subs({omega: 1, zeta: z}))
    close = max(
        abs(
            measured_limit("semi_implicit_euler", x, low=0.01)
            / float(limit.subs({omega: 1, zeta: x}))
            - 1
        )
        for x in (0.05, 0.3, 0.9, 2.0)
    )

    def implicit_radius(omega_h: float) -> float:
        d = 1 / (1 + 2 * z * omega_h)
        step = np.array([[1 - omega_h**2 * d, omega_h * d], [-omega_h * d, d]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    risen = 2 * (np.sqrt(1 + z * z) + z)
    implicit = implicit_radius(0.999 * risen) <= 1 < implicit_radius(1.001 * risen)
    return Finding(
        {"omega_h_explicit_damping": measured, "omega_h_implicit_damping": risen},
        f"zeta = 0.5: {measured:.6f} measured, {theory:.6f} from 1 + trace + det = 0.",
        holds=measured > 2,
        holds_if=implicit and risen > 2,
        corrected=close < 1e-6 and implicit,
        formula=limit,
    )


@claim(
    "verlet_limit",
    1,
    "Velocity Verlet, being of second order, is stable for larger steps than semi-implicit Euler.",
    verdict=Verdict.FALSE,
    corrected="Without damping both have the limit omega dt = 2: their steps differ by a shift "
    "of half "
    "a step in the velocity, and have the same trace and determinant.",
    figures={"verlet_omega_h": (2, 1e-6), "semi_implicit_omega_h": (2.0, 1e-6)},
)
def _verlet_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, step_matrix

    a, b = step_matrix("velocity_verlet"), step_matrix("semi_implicit_euler")
    same = sympy.simplify(a.trace() - b.trace()) == 0 and sympy.simplify(a.det() - b.det()) == 0
    verlet = measured_limit("velocity_verlet")
    return Finding(
        {"verlet_omega_h": verlet, "semi_implicit_omega_h": measured_limit("semi_implicit_euler")},
        "By bisection on the eigenvalues; trace and determinant by algebra.",
        holds=verlet > 2.001,
        corrected=bool(same) and abs(verlet - 2) < 1e-6,
    )


@claim(
    "explicit_midpoint_limit",
    1,
    "A second-order explicit method cures the instability of explicit Euler.",
    verdict=Verdict.CONDITIONAL,
    condition="it is velocity Verlet or another method with a real limit",
    corrected="The explicit midpoint rule also grows at every step on an undamped spring, only by "
    "(omega dt)^4 / 4 in energy instead of (omega dt)^2.",
    figures={"gain_at_0_1": (2.5e-05, 1e-6), "euler_gain_at_0_1": (0.01, 1e-6)},
    formula=Formula(
        "By which factor does the explicit midpoint rule multiply an undamped oscillator's energy "
        "per step?",
        "1 + (omega*h)^4/4",
        _OMEGA_H,
        left=("factor", "E"),
        slips={
            "1 + (omega*h)^2": "That is explicit Euler.",
            "1 + (omega*h)^4/8": "That is the amplitude, to leading order.",
            "1 - (omega*h)^4/4": "It grows: (1 - u^2/2)^2 + u^2 = 1 + u^4/4.",
        },
    ),
)
def _explicit_midpoint_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import spectral_radius, step_matrix

    factor = sympy.expand(step_matrix("explicit_midpoint").det())
    tenth = spectral_radius("explicit_midpoint", 0.1) ** 2 - 1
    verlet = spectral_radius("velocity_verlet", 1.9)
    return Finding(
        {
            "gain_at_0_1": tenth,
            "euler_gain_at_0_1": spectral_radius("explicit_euler", 0.1) ** 2 - 1,
        },
        f"Energy per step times {factor}.",
        holds=tenth <= 0,
        holds_if=verlet <= 1 + 1e-9,
        corrected=abs(tenth / (0.1**4 / 4) - 1) < 1e-6,
        formula=factor,
    )


@claim(
    "rk4_limit",
    1,
    "RK4, needing four evaluations, is stable for four times the step.",
    verdict=Verdict.FALSE,
    corrected="On an undamped spring its limit is 2 sqrt(2) / omega, 1.41 times semi-implicit "
    "Euler's at four times the cost.",
    figures={"omega_h": (2.828427, 1e-6), "over_semi_implicit": (1.414214, 1e-6)},
    formula=Formula(
        "What is the largest stable step of RK4 on an undamped oscillator?",
        "2*sqrt(2)/omega",
        _OMEGA,
        left=_LIMIT,
        relation="<",
        slips={
            "2/omega": "That is semi-implicit Euler.",
            "2*sqrt(2)": "That is omega dt; asked is dt itself.",
            "8/omega": "Four evaluations do not give four times the step.",
            "2.785/omega": "That is the limit on the real axis, for pure decay.",
            "sqrt(2)/omega": "A factor 2 is missing: 1 - u^6/72 + u^8/576 = 1 at u^2 = 8.",
        },
    ),
)
def _rk4_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import measured_limit, step_matrix, symbols

    h = symbols()[0]
    squared = sympy.expand(step_matrix("rk4").det())
    limit = next(root for root in sympy.solve(sympy.cancel((squared - 1) / h**6), h))
    measured = measured_limit("rk4")
    return Finding(
        {"omega_h": measured, "over_semi_implicit": measured / 2},
        f"|lambda|^2 = {squared}.",
        holds=abs(measured - 8) < 0.1,
        corrected=abs(measured / np.sqrt(8) - 1) < 1e-4,
        formula=limit,
    )


@claim(
    "implicit_midpoint_limit",
    1,
    "An implicit method is stable at any step, so its answer can be trusted at any step.",
    verdict=Verdict.FALSE,
    corrected="The implicit midpoint rule keeps an oscillator's energy at any step. But it "
    "turns by "
    "2 atan(omega h / 2) per step, less than half a turn however large omega h is: far beyond "
    "omega h = 1 the frequency is wrong.",
    figures={"turned_at_10_rad": (2.746802, 1e-5), "largest_radius": (1, 1e-5)},
    formula=Formula(
        "By which phase angle does the implicit midpoint rule advance an oscillator per step?",
        "2*atan(omega*h/2)",
        _OMEGA_H,
        left=("phi", "angle"),
        slips={
            "omega*h": "That is the true one.",
            "2*asin(omega*h/2)": "That is velocity Verlet, which has a limit.",
            "atan(omega*h/2)": "The factor 2 is missing: small steps must advance by omega h.",
        },
    ),
)
def _implicit_midpoint_limit() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import (
        numeric_matrix,
        spectral_radius,
        step_matrix,
        symbols,
    )

    h, omega, _ = symbols()
    phase = 2 * sympy.atan(omega * h / 2)
    half_trace = sympy.simplify(step_matrix("implicit_midpoint").trace() / 2)
    agrees = sympy.simplify(sympy.expand_trig(sympy.cos(phase)) - half_trace) == 0
    radius = max(spectral_radius("implicit_midpoint", x) for x in (0.1, 1.0, 10.0, 1000.0))
    eigenvalue = np.linalg.eigvals(numeric_matrix("implicit_midpoint", 10.0))[0]
    turned = float(abs(np.angle(eigenvalue)))
    return Finding(
        {"turned_at_10_rad": turned, "largest_radius": round(radius, 6)},
        f"omega h = 10: a step turns by {turned:.3f} rad instead of 10.",
        holds=abs(turned - 10) < 0.1,
        corrected=bool(agrees) and abs(radius - 1) < 1e-6 and abs(turned - 2 * np.arctan(5)) < 1e-6,
        formula=phase,
    )


@claim(
    "limit_scales_with_root",
    1,
    "The largest stable step scales with sqrt(m / k).",
    verdict=Verdict.HOLDS,
    corrected="Four times the stiffness halves it, for every method whose limit is a fixed "
    "omega dt; "
    "damping at a fixed damping ratio does not change that.",
    figures={"semi_implicit_euler": (2, 1e-3), "rk4": (2, 1e-3)},
)
def _limit_scales_with_root() -> Finding:
    from course.rigid_body import integrators, problems

    def limit(stiffness: float, name: str) -> float:
        """By running it: 400 steps from 1 m may not leave 1 km."""
        system = problems.oscillator(omega=float(np.sqrt(stiffness))).system
        low, high = 0.5 / np.sqrt(stiffness), 8.0 / np.sqrt(stiffness)
        while high / low > 1.0002:
            middle = float(np.sqrt(low * high))
            end = abs(integrators.simulate(system, name, middle, 400).q[-1, 0])
            low, high = (middle, high) if end < 1000 else (low, middle)
        return low

    ratios = {n: limit(100.0, n) / limit(400.0, n) for n in ("semi_implicit_euler", "rk4")}
    return Finding(
        ratios,
        "Limit at 100 N/m over limit at 400 N/m, 1 kg, by running both.",
        holds=all(abs(r - 2) < 2e-3 for r in ratios.values()),
        corrected=all(abs(r - 2) < 2e-3 for r in ratios.values()),
    )


@claim(
    "symplectic_removes_stiffness",
    1,
    "A symplectic integrator removes the limit that a stiff contact puts on the step.",
    verdict=Verdict.CONDITIONAL,
    condition="it is implicit, like the midpoint rule",
    corrected="Symplectic and explicit together keep a limit: semi-implicit Euler and velocity "
    "Verlet "
    "have omega dt = 2. It is being implicit that removes it; implicit Euler, which is not "
    "symplectic, has none either.",
    figures={
        "semi_implicit_omega_h": (2.0, 1e-5),
        "verlet_omega_h": (2, 1e-5),
        "implicit_euler_radius": (0.7071068, 1e-5),
    },
)
def _symplectic_removes_stiffness() -> Finding:
    from course.derivations.rigid_body.linear import measured_limit, spectral_radius

    explicit = {n: measured_limit(n) for n in ("semi_implicit_euler", "velocity_verlet")}
    midpoint = max(spectral_radius("implicit_midpoint", x) for x in (1.0, 30.0, 1000.0))
    # Implicit Euler: (I - h J)^-1.
    euler = max(
        float(np.abs(np.linalg.eigvals(np.linalg.inv([[1.0, -x], [x, 1.0]]))).max())
        for x in (1.0, 30.0, 1000.0)
    )
    return Finding(
        {"semi_implicit_omega_h": explicit["semi_implicit_euler"],
         "verlet_omega_h": explicit["velocity_verlet"], "implicit_euler_radius": euler},
        f"Implicit midpoint up to omega h = 1000: radius {midpoint:.6f}.",
        holds=bool(np.isinf(explicit["semi_implicit_euler"])),
        holds_if=midpoint < 1 + 1e-6,
        corrected=all(abs(x - 2) < 1e-6 for x in explicit.values()) and euler < 1,
    )  # fmt: skip
