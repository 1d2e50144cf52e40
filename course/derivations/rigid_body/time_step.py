"""The derivation of the largest stable time step of a stiff contact, line by line."""

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.rigid_body.linear import (
    measured_limit,
    numeric_matrix,
    spectral_radius,
    step_matrix,
    symbols,
)

SYMBOLS = {
    "m": Symbol("mass [kg]"),
    "k": Symbol("stiffness [N/m]"),
    "omega": Symbol("angular frequency [rad/s]"),
    "h": Symbol("step [s]"),
    "zeta": Symbol("damping ratio", 0.01, 0.99),
}
STABLE = 1 + 1e-7  # a largest modulus below this is 1 but for rounding


def _penalty_omega(stiffness: float, mass: float = 1.0) -> float:
    """Return angular frequency [rad/s] of a mass [kg] on a contact's spring [N/m]."""
    return float(np.sqrt(stiffness / mass))


@claim(
    "Explicit Euler is stable on an undamped spring while dt < 2 sqrt(m / k).",
    "It is unstable at every step: both eigenvalues have the modulus sqrt(1 + (omega dt)^2) > 1. "
    "The limit 2 sqrt(m / k) belongs to semi-implicit Euler.",
)
def explicit_undamped_limit(result):
    from course.rigid_body import integrators, problems

    system = problems.oscillator(omega=1.0).system
    tenth = integrators.simulate(system, "explicit_euler", 0.2, 1000)  # a tenth of the limit said
    grown = result.measure(
        "amplitude_after_1000_at_0_2", np.hypot(tenth.q[-1, 0], tenth.v[-1, 0]), tolerance=1e-6
    )
    result.measure("radius_at_0_1", spectral_radius("explicit_euler", 0.1))
    # Log-uniform below the quoted limit: at small steps the growth is hardest to tell from 1.
    steps = np.exp(result.rng.uniform(np.log(1e-3), np.log(2), 30))
    radii = np.array([spectral_radius("explicit_euler", x) for x in steps])
    result.statement = (
        f"At omega dt = 0.2 the amplitude is {grown:.2e} of the start after 1000 steps."
    )
    result.statement_holds(max(radii) <= 1)
    result.correction_holds(
        min(radii) > 1,
        # The numerical eigenvalues against the closed form, which is derived independently below.
        np.allclose(radii, np.sqrt(1 + steps**2), rtol=1e-12),
        abs(measured_limit("semi_implicit_euler") - 2) < 1e-6,
    )


@claim(
    "The eigenvalues of explicit Euler's step are 1 - dt^2 k/(2m) +- i dt sqrt(k/m - dt^2 "
    "k^2/(4m^2)).",
    "They are 1 +- i omega dt, from the matrix [[1, h], [-h k/m, 1]]. Those quoted are those of "
    "semi-implicit Euler, [[1 - h^2 k/m, h], [-h k/m, 1]]; their modulus is 1 below its limit.",
    ask=(
        "What is the modulus of the eigenvalues of explicit Euler's step on an undamped spring?",
        "r, modulus, lambda = sqrt(1 + omega^2*h^2)",
        {
            "1 + omega^2*h^2": "Yours is its square, which is also the determinant.",
            "1": "Yours is semi-implicit Euler below its limit.",
            "1 + omega*h": "The eigenvalues are 1 +- i omega h; take the modulus of that.",
        },
    ),
)
def explicit_eigenvalues(result):
    import sympy

    h, omega, _ = symbols()
    right = {1 + sympy.I * omega * h, 1 - sympy.I * omega * h}
    root = sympy.sqrt(omega**2 - h**2 * omega**4 / 4)
    quoted = 1 - h**2 * omega**2 / 2 + sympy.I * h * root
    explicit, semi = step_matrix("explicit_euler"), step_matrix("semi_implicit_euler")

    # A value is an eigenvalue if it makes the characteristic polynomial vanish identically.
    def solves(matrix: sympy.Matrix, value: sympy.Expr) -> bool:
        return bool(sympy.simplify((matrix - value * sympy.eye(2)).det()) == 0)

    at = {omega: 1, h: sympy.Rational(1, 2)}
    result.formula = sympy.sqrt(sympy.expand((1 + sympy.I * omega * h) * (1 - sympy.I * omega * h)))
    result.measure("modulus_at_half", result.formula.subs(at))
    result.measure("quoted_modulus_at_half", abs(quoted.subs(at)))
    result.statement = "Characteristic polynomial of the step's matrix, by algebra."
    result.statement_holds(solves(explicit, quoted))
    result.correction_holds(
        set(explicit.eigenvals()) == right,
        solves(semi, quoted),
        explicit == sympy.Matrix([[1, h], [-h * omega**2, 1]]),
        semi == sympy.Matrix([[1 - (h * omega) ** 2, h], [-h * omega**2, 1]]),
    )


@claim(
    "The square of that modulus is |lambda|^2 = 1 + dt^2 (dt^2 k/m - 4) k/(4m), so dt^2 k/m <= 4.",
    "That expression is the square of the real part alone. With the imaginary part the modulus is "
    "1 wherever the root is real; and for explicit Euler's own eigenvalues it is 1 + dt^2 k/m.",
)
def quoted_modulus(result):
    import sympy

    h, omega, _ = symbols()
    u = (omega * h) ** 2
    text, real, imaginary = 1 + u * (u - 4) / 4, 1 - u / 2, u * (1 - u / 4)
    explicit = step_matrix("explicit_euler").det()
    half = {omega: 1, h: sympy.Rational(1, 2)}
    result.measure("said_at_half", text.subs(half))
    result.measure("of_the_quoted_at_half", (real**2 + imaginary).subs(half))
    result.measure("of_explicit_euler_at_half", explicit.subs(half))
    result.statement = "Both expanded in omega dt, by algebra."
    result.statement_holds(sympy.expand(text - explicit) == 0)
    # Shows where the quoted expression comes from: the imaginary part was dropped.
    result.correction_holds(
        sympy.expand(text - real**2) == 0,
        sympy.expand(real**2 + imaginary - 1) == 0,
        sympy.expand(explicit - 1 - u) == 0,
    )


@claim(
    "Explicit Euler's matrix has the determinant 1 + dt^2 k/m, so the energy grows at each step; "
    "hence dt <= 2 sqrt(m / k) keeps it stable.",
    "The premise is right and says the opposite: a determinant above 1 puts an eigenvalue outside "
    "the unit circle, so no step is stable. Determinant and energy grow by the same factor, "
    "{energy_factor_at_half:.2f} at omega dt = 1/2.",
)
def growing_determinant_has_a_limit(result):
    from course.rigid_body import oscillator

    steps = result.rng.uniform(0.001, 2, 30)
    matrices = [numeric_matrix("explicit_euler", x) for x in steps]
    starts = result.rng.normal(size=(30, 2))
    # With omega = 1 the energy is |s|^2 / 2. Random states show that the factor is the same for all
    # of them, as A is a rotation times a scale.
    factors = [np.sum((A @ s) ** 2) / np.sum(s**2) for A, s in zip(matrices, starts, strict=True)]
    half = oscillator.stepper("explicit_euler", 0.5)(np.array([1.0, 0.0]))
    result.measure("energy_factor_at_half", np.sum(half**2))
    result.statement = "30 random steps from random states of the oscillator, omega dt below 2."
    result.statement_holds(all(np.abs(np.linalg.eigvals(A)).max() <= 1 for A in matrices))
    result.correction_holds(
        np.allclose(factors, [np.linalg.det(A) for A in matrices]),
        np.allclose(factors, 1 + steps**2),
        min(factors) > 1,
    )


@claim(
    "Semi-implicit Euler is stable for any step, because its determinant is 1.",
    "It is stable on a spring while omega dt < 2. Above this limit the two eigenvalues are real. "
    "Their product is still 1, but one of them lies below -1.",
)
def semi_implicit_unconditional(result):
    from course.rigid_body import integrators, problems

    system = problems.oscillator(omega=_penalty_omega(1e5)).system

    def largest(dt: float) -> float:
        run = integrators.simulate(system, "semi_implicit_euler", dt, 100, every=1)
        return float(np.abs(run.q).max())

    # 6.3 and 6.5 ms bracket the limit of 6.32 ms.
    inside = result.measure("largest_6_3_ms_m", largest(0.0063))
    outside = result.measure("largest_6_5_ms_m", largest(0.0065))
    below, above = result.rng.uniform(0.001, 1.999, 30), result.rng.uniform(2.001, 8, 30)
    radii = [[spectral_radius("semi_implicit_euler", x) for x in xs] for xs in (below, above)]
    result.statement = "100 kN/m on 1 kg, released at 1 m, 100 steps."
    result.statement_holds(outside < 100)
    # 100 times the release separates a bounded swing from exponential growth within 100 steps.
    result.correction_holds(
        inside < 100 < outside,
        max(radii[0]) < STABLE,
        min(radii[1]) > 1.01,
        all(
            np.isreal(np.linalg.eigvals(numeric_matrix("semi_implicit_euler", x))).all()
            for x in above
        ),
    )


@claim(
    "Semi-implicit Euler is stable on an undamped spring while dt < 2 sqrt(m / k).",
    "Its eigenvalues leave the unit circle where the trace 2 - (omega dt)^2 reaches -2, at "
    "omega dt = 2 with omega = sqrt(k / m): {formula}, which is {limit_ms:.2f} ms for "
    "{stiffness_n_per_m:.0f} N/m on {mass_kg:.0f} kg.",
    ask=Ask(
        "What is the largest stable step of semi-implicit Euler for a mass m on a spring k?",
        "dt < 2*sqrt(m/k)",
        {
            "sqrt(m/k)": "The factor 2 is missing: the trace reaches -2 at omega h = 2.",
            "2*sqrt(k/m)": "Yours is 2 omega, a rate; a stiffer spring needs a smaller step.",
            "2*m/k": "The root is missing: check the units.",
            "4*m/k": "Yours is the square of the limit.",
        },
        also={"omega": "sqrt(k/m)"},
    ),
)
def semi_implicit_limit(result):
    import sympy

    h, omega, _ = symbols()
    m, k = sympy.symbols("m k", positive=True)
    A = step_matrix("semi_implicit_euler")
    heavy = {m: result.input("mass_kg", 1), k: result.input("stiffness_n_per_m", 100_000)}
    # Jury criterion at -1: with determinant 1 the eigenvalue -1 appears where 1 + trace + det = 0.
    limit = sympy.solve(A.trace() + 1 + A.det(), h)[0].subs(omega, sympy.sqrt(k / m))
    measured = result.measure("omega_h", measured_limit("semi_implicit_euler"))
    result.measure("limit_ms", 1000 * float(limit.subs(heavy)))
    result.statement = f"By bisection on the eigenvalues omega dt = {measured:.6f}."
    result.formula = sympy.simplify(limit)
    result.statement_holds(abs(measured - 2) < 1e-6)
    result.correction_holds(sympy.simplify(A.trace() - (2 - (omega * h) ** 2)) == 0)


@claim(
    "For a contact of 100 kN/m on 1 kg explicit Euler may step up to 6.3 ms.",
    "{semi_implicit_limit_ms:.2f} ms is the limit of semi-implicit Euler. Explicit Euler has none "
    "without damping: at {step_ms:.0f} ms it gains {explicit_gain_per_step_1_ms:.0%} of the energy "
    "at every step.",
    ask=Ask(
        "k = 100,000 N/m, m = 1 kg, no damping: the largest stable step of semi-implicit Euler, "
        "in milliseconds?",
        "dt, limit < 2000*sqrt(1/100000)",
        {
            "1000*sqrt(1/100000)": "The factor 2 is missing.",
            "2*sqrt(1/100000)": "Yours is in seconds; milliseconds are asked.",
            "1000*2*sqrt(100000)": "m / k stands under the root, not k / m.",
        },
        tolerance=2e-3,
    ),
)
def contact_limit_explicit(result):
    import sympy

    omega = _penalty_omega(1e5)
    semi = 1000 * measured_limit("semi_implicit_euler") / omega
    step = result.input("step_ms", 1)
    # An amplitude grows by the spectral radius, the energy by its square.
    gain = spectral_radius("explicit_euler", omega * step / 1000) ** 2 - 1
    result.measure("semi_implicit_limit_ms", semi)
    result.measure("explicit_gain_per_step_1_ms", gain)
    result.statement = (
        f"Semi-implicit: {semi:.4f} ms. Explicit Euler at 1 ms: {100 * gain:.0f} % more energy at "
        "every step."
    )
    result.formula = 2000 * sympy.sqrt(sympy.Rational(1, 100_000))
    result.statement_holds(gain <= 0)
    result.correction_holds(abs(semi - 2000 / omega) < 1e-6, abs(gain - 0.1) < 1e-9)


@claim(
    "A contact of 100 kN/m on 1 kg is stable at 1 kHz and explodes at 100 Hz.",
    "As an undamped spring, for semi-implicit Euler, velocity Verlet and RK4, yes. Explicit Euler, "
    "for which it is said, explodes at both rates, the implicit midpoint rule at neither, and two "
    "half steps of semi-implicit Euler taken as one method at neither.",
)
def contact_stable_at_1_khz(result):
    from course.rigid_body.oscillator import METHODS

    omega = _penalty_omega(1e5)
    radii = {n: [spectral_radius(n, omega * dt) for dt in (1e-3, 1e-2)] for n in METHODS}
    as_said = {name: fast <= 1 + 1e-6 < slow for name, (fast, slow) in radii.items()}
    limited = ("semi_implicit_euler", "velocity_verlet", "rk4")
    result.measure("at_1_khz", omega * 1e-3)
    result.measure("at_100_hz", omega * 1e-2)
    # Chosen to break it: two half steps composed are a method of their own, with omega dt = 1.6
    # per half at 100 Hz.
    halves = numeric_matrix("semi_implicit_euler", omega * 1e-2 / 2)
    twice = np.abs(np.linalg.eigvals(halves @ halves)).max()
    result.measure("explicit_1_khz", radii["explicit_euler"][0], tolerance=1e-4)
    result.measure("semi_implicit_100_hz", radii["semi_implicit_euler"][1], tolerance=1e-4)
    result.measure("implicit_midpoint_100_hz", radii["implicit_midpoint"][1], tolerance=1e-4)
    result.statement = "Largest growth factor of the amplitude per step."
    result.statement_holds(
        all(as_said.values()),
        only_if="the integrator's stability limit lies between the two values of omega dt, "
        "{at_1_khz:.2f} and {at_100_hz:.2f}, as for semi-implicit Euler, velocity Verlet and RK4",
        inside=[as_said[n] for n in limited],
        outside=[as_said[n] for n in METHODS if n not in limited],
        cases=True,
    )
    result.correction_holds(
        radii["explicit_euler"][0] > 1, radii["implicit_midpoint"][1] < 1 + 1e-6, twice < STABLE
    )


@claim(
    "A contact of 100 kN/m on 1 kg is stable up to 6.3 ms; this is why contact is simulated at "
    "1 to 10 kHz.",
    "That limit asks for {rate_needed_hz:.0f} Hz, and is one of a spring that stays in touch. A "
    "ball leaves it: at {slow_ms:.0f} ms, below the limit, it comes back off an elastic contact "
    "with an error of up to {worst_rebound_5_ms:.0%} of its speed and with {energy_5_ms:.2f} times "
    "its energy on average, at {fast_ms:.0f} ms with an error of {worst_rebound_1_ms:.1%}. The "
    "limit is necessary, not sufficient; it asks for {fast_ms:.0f} ms from "
    "{stiffness_for_1_khz_mn_per_m:.0f} MN/m on.",
)
def contact_rate_by_stability(result):
    omega = _penalty_omega(1e5)
    limit = measured_limit("semi_implicit_euler") / omega

    def rebound(dt: float) -> np.ndarray:
        """Return speeds after an elastic contact, entered at 1 m/s, the phase of the step drawn."""
        # Touch falls anywhere within a step, so the position at the start of the step is uniform.
        v, x = np.full(2000, -1.0), result.rng.uniform(0, dt, 2000)
        flying = np.zeros(2000, dtype=bool)
        for _ in range(int(0.05 / dt)):
            v = np.where(flying, v, v - dt * omega**2 * np.minimum(x, 0))
            x = x + dt * v
            # Only the first contact counts: whatever has left the spring flies on without force.
            flying |= (x > 0) & (v > 0)
        return v

    fast, slow = result.input("fast_ms", 1) / 1000, result.input("slow_ms", 5) / 1000
    rate = result.measure("rate_needed_hz", 1 / limit)
    stiff = result.measure("stiffness_for_1_khz_mn_per_m", (limit * omega / fast) ** 2 / 1e6)
    error, near = (float(np.abs(rebound(dt) - 1).max()) for dt in (slow, fast))
    result.measure("worst_rebound_5_ms", error, tolerance=0.02)
    result.measure("worst_rebound_1_ms", near, tolerance=0.02)
    energy = result.measure("energy_5_ms", float(np.mean(rebound(slow) ** 2)), tolerance=0.05)
    result.statement = "Semi-implicit Euler, 1 kg at 1 m/s on 100 kN/m; 2000 phases of the step."
    result.statement_holds(rate >= 1000)
    # One part in a thousand on both sides of the stiffness whose limit is the fast step.
    result.correction_holds(
        slow < limit,
        rate < 200,
        error > 20 * near,
        energy > 1.1,
        spectral_radius("semi_implicit_euler", 0.999 * fast * np.sqrt(1e6 * stiff)) < STABLE,
        spectral_radius("semi_implicit_euler", 1.001 * fast * np.sqrt(1e6 * stiff)) > 1.01,
    )


@claim(
    "A penalty contact with k = 5,000 N/m and a damper of 50 N s/m on 1 kg is stable below 2 "
    "sqrt(m / k), about 30 ms; with 50,000 N/m below 9 ms, with 500,000 N/m below 3 ms.",
    "2 sqrt(m / k) is the limit without the damper. With the damping force taken from the old "
    "velocity it is {soft_ms:.1f} ms, {stiff_ms:.1f} ms and {steel_ms:.2f} ms; explicit Euler's is "
    "{soft_explicit_ms:.0f} ms, {stiff_explicit_ms:.1f} ms and {steel_explicit_ms:.2f} ms.",
)
def penalty_listing_limits(result):
    damper = 50.0

    def limit_ms(method: str, stiffness: float) -> float:
        omega = _penalty_omega(stiffness)
        # The damper is fixed, so the damping ratio falls as the spring stiffens.
        zeta = damper / (2 * omega)
        return 1000 * measured_limit(method, zeta, low=1e-3) / omega

    stiffness = {"soft": 5e3, "stiff": 5e4, "steel": 5e5}
    semi = {name: limit_ms("semi_implicit_euler", k) for name, k in stiffness.items()}
    explicit = {name: limit_ms("explicit_euler", k) for name, k in stiffness.items()}
    for name in stiffness:
        result.measure(f"{name}_ms", semi[name])
        result.measure(f"{name}_explicit_ms", explicit[name])
    result.statement = "Both bisected on the eigenvalues of the step with the damper."
    message = {"soft": 30.0, "stiff": 9.0, "steel": 3.0}
    result.statement_holds(all(semi[name] >= message[name] for name in message))
    # Explicit Euler's limit 2 zeta / omega is damper / stiffness for 1 kg.
    result.correction_holds(
        all(semi[n] < 2000 / _penalty_omega(k) for n, k in stiffness.items()),
        all(abs(explicit[n] / (1000 * damper / k) - 1) < 1e-6 for n, k in stiffness.items()),
    )


@claim(
    "A step whose determinant is 1, like semi-implicit Euler's, has its eigenvalues on the unit "
    "circle.",
    "Determinant 1 only says that the two multiply to 1. With a trace outside -2 to 2 they are "
    "real, lambda and 1 / lambda, and one of them is off the circle.",
)
def determinant_one_is_stable(result):
    def on_circle(matrix: np.ndarray) -> bool:
        return np.allclose(np.abs(np.linalg.eigvals(matrix)), 1)

    def drawn(trace: float) -> np.ndarray:
        """Return a matrix of this trace and determinant 1."""
        a, b = result.rng.uniform(-3, 3), result.rng.uniform(0.5, 2)
        # The lower left entry is solved from the determinant.
        return np.array([[a, b], [(a * (trace - a) - 1) / b, trace - a]])

    def two(trace: float) -> np.ndarray:
        """Return the step of two oscillators: determinant 1 and a trace of 2.5 more than this."""
        matrix = np.zeros((4, 4))
        matrix[:2, :2], matrix[2:, 2:] = np.diag([2.0, 0.5]), drawn(trace)
        assert abs(np.linalg.det(matrix) - 1) < 1e-9 and -2 < np.trace(matrix) < 2
        return matrix

    outer, inner = np.sort(np.linalg.eigvals(numeric_matrix("semi_implicit_euler", 2.1)).real)
    result.measure("outer_at_2_1", outer)
    result.measure("inner_at_2_1", inner)
    result.statement = "Semi-implicit Euler at omega dt = 2.1: both real, product 1."
    # Close to the traces 2 and -2, where the eigenvalues are only just real. The last samples
    # are chosen to break a condition on the trace alone: in four dimensions it does not bound the
    # moduli.
    outside = result.rng.uniform(2.001, 2.2, 20) * result.rng.choice([-1, 1], 20)
    result.statement_holds(
        on_circle(numeric_matrix("semi_implicit_euler", 2.1)),
        only_if="it is that of one oscillator, 2 by 2, and its trace lies between -2 and 2",
        inside=[on_circle(drawn(trace)) for trace in result.rng.uniform(-1.999, 1.999, 50)],
        outside=[on_circle(drawn(trace)) for trace in outside]
        + [on_circle(two(trace)) for trace in result.rng.uniform(-1.999, -0.8, 8)],
    )
    result.correction_holds(
        step_matrix("semi_implicit_euler").det() == 1,
        abs(outer * inner - 1) < 1e-9,
        abs(outer) > 1.1,
    )


@claim(
    "At omega dt = 2 exactly, semi-implicit Euler is still just stable: dt <= 2 / omega.",
    "-1 is then a double eigenvalue with a single eigenvector. Unless it starts along that one, "
    "the state alternates in sign and grows linearly, without bound.",
)
def stable_at_the_limit(result):
    from course.rigid_body import integrators, oscillator, problems

    h, omega, _ = symbols()
    ((value, multiplicity, vectors),) = (
        step_matrix("semi_implicit_euler").subs({omega: 1, h: 2}).eigenvects()
    )
    system = problems.oscillator(omega=1.0).system
    run = integrators.simulate(system, "semi_implicit_euler", 2.0, 1000, every=500)
    after = np.abs(run.q[:, 0])
    result.measure("after_500_m", after[1])
    result.measure("after_1000_m", after[2])
    step = oscillator.stepper("semi_implicit_euler", 2.0)

    def grown(start: np.ndarray) -> np.ndarray:
        sizes, state = [], start
        for _ in range(400):
            # The minus removes the alternation that the eigenvalue -1 causes.
            state = -step(state)
            sizes.append(state)
        return np.array(sizes)

    along = grown(np.array(vectors[0], dtype=float).ravel())
    drawn = [np.diff(grown(start), axis=0) for start in result.rng.normal(size=(20, 2))]
    result.statement = f"Eigenvalue {value} of multiplicity {multiplicity}; released at 1 m."
    result.statement_holds(after[2] < 10)
    result.correction_holds(
        # Algebraic multiplicity 2 with one eigenvector is a Jordan block, so the growth is linear:
        # constant differences from one step to the next.
        (value, multiplicity, len(vectors)) == (-1, 2, 1),
        np.allclose(along, along[0]),
        all(np.allclose(d, d[0]) and np.abs(d[0]).max() > 1e-3 for d in drawn),
    )


@claim(
    "Damping does not help explicit Euler.",
    "With a damping ratio below 1 it is stable up to dt = 2 zeta / omega, which for light damping "
    "is a small fraction of semi-implicit Euler's limit.",
    ask=(
        "x'' = -omega^2 x - 2 zeta omega x' with zeta < 1: the largest stable step of explicit "
        "Euler?",
        "dt < 2*zeta/omega",
        {
            "2/omega": "Yours is the limit of semi-implicit Euler without damping.",
            "zeta/omega": "The factor 2 is missing: |lambda|^2 = 1 - 2 zeta omega h + (omega h)^2.",
            "1/(zeta*omega)": "Yours is the limit of the decay alone, without the oscillation.",
        },
    ),
)
def explicit_damped_limit(result):
    import sympy

    # Below zeta = 1 the eigenvalues are a complex pair, so that |lambda|^2 is the determinant.
    h = symbols()[0]
    squared = sympy.expand(step_matrix("explicit_euler", damped=True).det())
    result.formula = sympy.solve(sympy.cancel((squared - 1) / h), h)[0]
    measured = result.measure("omega_h_at_zeta_0_1", measured_limit("explicit_euler", 0.1, low=0.1))
    # Underdamped only: from zeta = 1 on the eigenvalues are real and another limit applies.
    zetas = result.rng.uniform(0.01, 0.99, 12)
    # The bisection on numerical eigenvalues knows nothing of the symbolic root it is compared with.
    ratios = [measured_limit("explicit_euler", z, low=z) / (2 * z) for z in zetas]
    result.statement = f"|lambda|^2 = {squared}."
    result.statement_holds(measured < 1e-3)
    result.correction_holds(
        np.allclose(ratios, 1, rtol=1e-6),
        measured < 0.12 * measured_limit("semi_implicit_euler", 0.1, low=0.1),
    )


@claim(
    "Damping lets semi-implicit Euler take larger steps.",
    "With the damping force taken from the old velocity the limit falls to "
    "2 (sqrt(1 + zeta^2) - zeta) / omega. Taken implicitly, as in MuJoCo, it rises to "
    "2 (sqrt(1 + zeta^2) + zeta) / omega. A damper that acts only on a slower oscillation changes "
    "nothing, nor does one that acts on only one of two equally fast ones.",
    ask=(
        "x'' = -omega^2 x - 2 zeta omega x', both forces from the old state: the largest stable "
        "step of semi-implicit Euler?",
        "dt < 2*(sqrt(1 + zeta^2) - zeta)/omega",
        {
            "2/omega": "Yours is without damping.",
            "2*zeta/omega": "Yours is explicit Euler.",
            "2*(sqrt(1 + zeta^2) + zeta)/omega": "Yours is with the damping taken implicitly.",
            "2*sqrt(1 - zeta^2)/omega": "The damped frequency is not what counts: -1 becomes an "
            "eigenvalue where 1 + trace + det = 0.",
        },
    ),
)
def semi_implicit_damped_limit(result):
    import sympy

    from course.measure import stability

    h, omega, zeta = symbols()
    A = step_matrix("semi_implicit_euler", damped=True)
    roots = sympy.solve(sympy.expand(1 + A.trace() + A.det()), h)
    result.formula = next(root for root in roots if root.subs({omega: 1, zeta: 1}) > 0)
    theory = sympy.lambdify(zeta, result.formula.subs(omega, 1))

    def implicit(z: float) -> float:
        def stable(x: float) -> bool:
            # The step solved for the new velocity, with velocities scaled by omega.
            d = 1 / (1 + 2 * z * x)
            return stability.spectral_radius([[1 - x * x * d, x * d], [-x * d, d]]) < 1 + 1e-10

        return stability.limit(stable, 0.01, 50.0, rel=1e-10)

    # Over- and underdamped, as the formulas hold for both.
    zetas = np.append(0.5, result.rng.uniform(0.01, 3, 10))
    fallen = [measured_limit("semi_implicit_euler", z, low=0.01) for z in zetas]
    risen = [implicit(z) for z in zetas]
    measured = result.measure("omega_h_explicit_damping", fallen[0])
    result.measure("omega_h_implicit_damping", risen[0])

    def coupled(damping: np.ndarray, stiffness: np.ndarray) -> float:
        """Return the largest stable step of unit masses, damping taken implicitly [s]."""
        one = np.eye(len(stiffness))

        def stable(h: float) -> bool:
            velocity = np.linalg.solve(one + h * damping, np.hstack((-h * stiffness, one)))
            position = np.hstack((one, 0 * one)) + h * velocity
            return stability.spectral_radius(np.vstack((position, velocity))) < 1 + 1e-7

        return stability.limit(stable, 1e-3, 1e3, rel=1e-6)

    # Chosen to break it: three masses that are coupled, and a damper at the slow one of two.
    springs, dampers = result.rng.normal(size=(2, 6, 3, 3))
    pairs = [(d @ d.T, s @ s.T + np.eye(3)) for d, s in zip(dampers, springs, strict=True)]
    several = [coupled(d, k) / coupled(0 * d, k) for d, k in pairs]
    elsewhere = [coupled(np.diag([d, 0.0]), np.diag([1.0, 4.0])) for d in (0.1, 1.0, 3.0)]
    # Chosen to break it: two equally fast oscillations, of which one or both are damped.
    alike = [coupled(np.diag([d, 0.0]), np.diag([4.0, 4.0])) for d in (0.1, 1.0, 3.0)]
    both = [coupled(np.diag([d, d]), np.diag([4.0, 4.0])) for d in (0.1, 1.0, 3.0)]
    result.statement = (
        f"zeta = 0.5: {measured:.6f} measured, {theory(0.5):.6f} by 1 + trace + det = 0."
    )
    result.statement_holds(
        measured > 2,
        only_if="the damping force is taken implicitly and acts on the fastest oscillation, or on "
        "all of them if several are equally fast",
        inside=[limit > 2 for limit in risen] + [x > 1.001 for x in several + both],
        outside=[limit > 2 for limit in fallen] + [limit > 1.001 for limit in elsewhere + alike],
    )
    result.correction_holds(
        np.allclose(fallen, theory(zetas), rtol=1e-6),
        np.allclose(risen, 2 * (np.sqrt(1 + zetas**2) + zetas), rtol=1e-6),
        np.allclose(elsewhere + alike, 1, rtol=1e-4),
    )


@claim(
    "Velocity Verlet, being of second order, is stable for larger steps than semi-implicit Euler.",
    "Without damping both have the limit omega dt = 2: their steps differ by a shift of half a "
    "step in the velocity, and have the same trace and determinant.",
)
def verlet_limit(result):
    import sympy

    h, omega, _ = symbols()
    a, b = step_matrix("velocity_verlet"), step_matrix("semi_implicit_euler")
    shift = sympy.Matrix([[1, 0], [-h * omega**2 / 2, 1]])  # half a step of the velocity
    verlet = result.measure("verlet_omega_h", measured_limit("velocity_verlet"))
    result.measure("semi_implicit_omega_h", measured_limit("semi_implicit_euler"))
    result.statement = "By bisection on the eigenvalues; trace and determinant by algebra."
    result.statement_holds(verlet > 2.001)
    result.correction_holds(
        sympy.simplify(a.trace() - b.trace()) == 0,
        sympy.simplify(a.det() - b.det()) == 0,
        # Similar matrices: shift b = a shift, so the eigenvalues agree, not only trace and
        # determinant.
        (shift * b - a * shift).applyfunc(sympy.expand) == sympy.zeros(2),
        abs(verlet - 2) < 1e-6,
    )


@claim(
    "A second-order explicit method cures the instability of explicit Euler.",
    "The explicit midpoint rule, like every explicit Runge-Kutta method of second order with two "
    "stages, also grows at every step on an undamped spring, only by (omega dt)^4 / 4 in energy "
    "instead of (omega dt)^2. A third stage can cure it, and velocity Verlet, which is symplectic, "
    "does. Per step, a Runge-Kutta method with up to four stages multiplies the state by 1 + z + "
    "z^2/2 + c z^3 + d z^4 with z = i omega dt. For small steps it grows if c is below 1/8 + d. "
    "RK4, with 1/6 and 1/24, does not.",
    ask=(
        "By which factor does the explicit midpoint rule multiply an undamped oscillator's energy "
        "per step?",
        "factor, E = 1 + (omega*h)^4/4",
        {
            "1 + (omega*h)^2": "Yours is explicit Euler.",
            "1 + (omega*h)^4/8": "Yours is the amplitude, to leading order.",
            "1 - (omega*h)^4/4": "It grows: (1 - u^2/2)^2 + u^2 = 1 + u^4/4.",
        },
    ),
)
def explicit_midpoint_limit(result):
    import sympy

    def grows(x: float, third: float, fourth: float = 0.0) -> bool:
        """Return whether 1 + z + z^2/2 + third z^3 + fourth z^4 leaves the unit circle at z = i x.

        Its square is 1 + (1/4 - 2 third + 2 fourth) x^4 and terms of higher order.
        """
        # Stability polynomial on the imaginary axis, which is where an undamped spring lies.
        return bool(abs(np.polyval([fourth, third, 0.5, 1, 1], 1j * x)) > 1)

    result.formula = sympy.expand(step_matrix("explicit_midpoint").det())
    tenth = spectral_radius("explicit_midpoint", 0.1) ** 2 - 1
    result.measure("gain_at_0_1", tenth)
    result.measure("euler_gain_at_0_1", spectral_radius("explicit_euler", 0.1) ** 2 - 1)
    result.statement = f"Energy per step times {result.formula}."
    # Weights on both sides of 1/8, where the coefficient of x^4 changes its sign.
    heavy, light = result.rng.uniform(0.13, 0.5, 30), result.rng.uniform(0, 0.12, 30)
    limits = np.sqrt(2 * heavy - 0.25) / heavy  # (1 - x^2/2)^2 + (x - c x^3)^2 = 1
    verlet = [
        spectral_radius("velocity_verlet", x) < STABLE for x in result.rng.uniform(0, 1.99, 8)
    ]
    result.statement_holds(
        tenth <= 0,
        only_if="it is symplectic, as velocity Verlet is, or a Runge-Kutta method of three or four "
        "stages whose third-order term is large enough, c > 1/8 + d (RK4's is)",
        inside=[
            *verlet,
            *(
                not grows(result.rng.uniform(0.1, 0.99) * x, c)
                for x, c in zip(limits, heavy, strict=True)
            ),
        ],
        outside=[not grows(result.rng.uniform(0.1, 1), c) for c in light]
        # Chosen to break it: z^3 has its weight, and a fourth stage takes the cure away.
        + [not grows(0.1, c, c - 0.12) for c in heavy],
    )
    result.correction_holds(
        abs(tenth / (0.1**4 / 4) - 1) < 1e-6,
        all(spectral_radius("explicit_midpoint", x) > 1 for x in result.rng.uniform(0.01, 3, 20)),
        all(grows(x, 0) for x in result.rng.uniform(0.01, 3, 20)),
    )


@claim(
    "RK4, needing four evaluations, is stable for four times the step.",
    "On an undamped spring its limit is 2 sqrt(2) / omega, {over_semi_implicit:.2f} times "
    "semi-implicit Euler's at four times the cost.",
    ask=(
        "What is the largest stable step of RK4 on an undamped oscillator?",
        "dt < 2*sqrt(2)/omega",
        {
            "2/omega": "Yours is the limit of semi-implicit Euler.",
            "2*sqrt(2)": "Yours is omega dt; asked is dt itself.",
            "8/omega": "Four evaluations do not give four times the step.",
            "2.785/omega": "Yours is the limit on the real axis, for pure decay.",
            "sqrt(2)/omega": "A factor 2 is missing: 1 - u^6/72 + u^8/576 = 1 at u^2 = 8.",
        },
    ),
)
def rk4_limit(result):
    import sympy

    h = symbols()[0]
    squared = sympy.expand(step_matrix("rk4").det())
    # Below x^6 all terms of |lambda|^2 - 1 cancel, so dividing by h^6 leaves the root wanted.
    result.formula = next(root for root in sympy.solve(sympy.cancel((squared - 1) / h**6), h))
    measured = result.measure("omega_h", measured_limit("rk4"))
    result.measure("over_semi_implicit", measured / measured_limit("semi_implicit_euler"))
    result.statement = f"|lambda|^2 = {squared}."
    result.statement_holds(abs(measured - 8) < 0.1)
    result.correction_holds(abs(measured / np.sqrt(8) - 1) < 1e-4)


@claim(
    "An implicit method is stable at any step, so its answer can be trusted at any step.",
    "The implicit midpoint rule keeps an oscillator's energy at any step. But it turns by "
    "2 atan(omega h / 2) per step, less than half a turn however large omega h is: far beyond "
    "omega h = 1 the frequency is wrong.",
    ask=(
        "By which phase angle does the implicit midpoint rule advance an oscillator per step?",
        "phi, angle = 2*atan(omega*h/2)",
        {
            "omega*h": "Yours is the true one.",
            "2*asin(omega*h/2)": "Yours is velocity Verlet, which has a limit.",
            "atan(omega*h/2)": "The factor 2 is missing: small steps must advance by omega h.",
        },
    ),
)
def implicit_midpoint_limit(result):
    import sympy

    h, omega, _ = symbols()
    result.formula = 2 * sympy.atan(omega * h / 2)
    half_trace = sympy.simplify(step_matrix("implicit_midpoint").trace() / 2)

    def turned(matrix: np.ndarray) -> float:
        return float(np.abs(np.angle(np.linalg.eigvals(matrix)[0])))

    # Log-uniform over four decades, since the claim is about any step.
    steps = 10 ** result.rng.uniform(-1, 3, 20)
    matrices = [numeric_matrix("implicit_midpoint", x) for x in steps]
    at_10 = turned(numeric_matrix("implicit_midpoint", 10.0))
    result.measure("turned_at_10_rad", at_10, tolerance=1e-5)
    result.measure("largest_radius", max(np.linalg.norm(A, 2) for A in matrices), tolerance=1e-5)
    result.statement = f"omega h = 10: a step turns by {at_10:.3f} rad instead of 10."
    result.statement_holds(abs(at_10 - 10) < 0.1)
    result.correction_holds(
        sympy.simplify(sympy.expand_trig(sympy.cos(result.formula)) - half_trace) == 0,
        # Orthogonal, hence energy is conserved exactly: the method is a Cayley transform.
        all(np.allclose(A.T @ A, np.eye(2), atol=1e-6) for A in matrices),
        np.allclose([turned(A) for A in matrices], 2 * np.arctan(steps / 2), atol=1e-5),
    )


@claim(
    "The largest stable step scales with sqrt(m / k).",
    "Four times the stiffness halves it, for every method whose limit is a fixed omega dt, and "
    "with damping at a fixed damping ratio too. With a fixed damper it does not: semi-implicit "
    "Euler's then falls by a factor of {fixed_damper:.2f}.",
)
def limit_scales_with_root(result):
    from course.measure import stability
    from course.rigid_body.oscillator import stepper

    def limit(method: str, omega: float, zeta: float) -> float:
        def stable(dt: float) -> bool:
            return stability.is_stable_by_matrix(stepper(method, dt, zeta, omega), 2)

        return stability.limit(stable, 0.01 / omega, 8 / omega, rel=1e-5)

    def fall(method: str, soft: float, stiff: float, zeta: float, damper_kept: bool) -> float:
        """Return by which factor the limit falls, over sqrt(k): 1 where it scales."""
        then = zeta * soft / stiff if damper_kept else zeta
        return limit(method, soft, zeta) / limit(method, stiff, then) * soft / stiff

    for method in ("semi_implicit_euler", "rk4"):
        # Twice omega is four times the stiffness, so a fall of 2 is the square root.
        result.measure(method, 2 * fall(method, 10, 20, 0, False), tolerance=1e-3)
    retained = result.measure(
        "fixed_damper", 2 * fall("semi_implicit_euler", 10, 20, 0.8, True), 1e-3
    )
    methods = result.rng.choice(["semi_implicit_euler", "velocity_verlet", "rk4"], 12)
    drawn = result.rng.uniform((1, 12, 0.05), (9, 90, 0.9), (12, 3))
    draws = [(method, *row) for method, row in zip(methods, drawn, strict=True)]
    result.statement = "Limit at 100 N/m over limit at 400 N/m, 1 kg, from the code's own steps."
    result.statement_holds(
        abs(retained - 2) < 0.01,
        only_if="nothing damps, or the damping ratio stays the same",
        # Ratios below 0.2 are set to zero, so that undamped springs are among the samples.
        inside=[abs(fall(m, a, b, z * (z > 0.2), False) - 1) < 1e-3 for m, a, b, z in draws]
        # Chosen to break it: strong damping, a stiffness far away, and explicit Euler.
        + [
            abs(fall(m, 1, ratio, z, False) - 1) < 1e-3
            for ratio in (1.001, 1e3)
            for m, z in (("semi_implicit_euler", 5.0), ("rk4", 3.0), ("explicit_euler", 0.3))
        ],
        outside=[abs(fall(m, a, b, z, True) - 1) < 1e-3 for m, a, b, z in draws],
    )
    result.correction_holds(
        all(abs(fall(m, w, 2 * w, z, False) - 1) < 1e-3 for m, w, _, z in draws)
    )
