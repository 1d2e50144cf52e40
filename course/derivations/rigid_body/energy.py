"""Claims about what integrators do to energy and to phase-space area."""

import numpy as np

from course.derivations import Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol

_OSCILLATOR = {
    "omega": Symbol("angular frequency [rad/s]"),
    "h": Symbol("step [s]", 0.01, 1.0),
}


@claim(
    "explicit_energy_factor",
    1,
    "Explicit Euler adds energy to an oscillator.",
    verdict=Verdict.HOLDS,
    corrected="It multiplies the energy of an undamped oscillator by exactly 1 + (omega h)^2 at "
    "every step, whatever the state.",
    figures={"factor_1_hz_10_ms": (1.003948, 1e-6)},
    formula=Formula(
        "By which factor does explicit Euler multiply the energy of an undamped oscillator at "
        "each step of length h?",
        "1 + omega^2*h^2",
        _OSCILLATOR,
        left=("factor", "E"),
        slips={
            "1 + omega*h": "The first-order terms of kinetic and potential energy cancel.",
            "1 - omega^2*h^2": "It gains: look at the sign of the determinant's second term.",
            "sqrt(1 + omega^2*h^2)": "That is the factor of the amplitude; energy is its square.",
            "1 + omega^2*h^2/2": "Both position and velocity contribute a half.",
        },
    ),
)
def _explicit_energy_factor() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols

    h, omega, _ = symbols()
    A = step_matrix("explicit_euler")
    energy = sympy.diag(omega**2 / 2, sympy.Rational(1, 2))
    ratio = sympy.simplify(A.T * energy * A * energy.inv())
    factor = ratio[0, 0]
    value = float(factor.subs({omega: 2 * sympy.pi, h: sympy.Rational(1, 100)}))
    return Finding(
        {"factor_1_hz_10_ms": value},
        f"A^T E A = ({factor}) E for the matrix A of the step.",
        holds=value > 1,
        corrected=ratio == factor * sympy.eye(2),
        formula=sympy.expand(factor),
    )


@claim(
    "explicit_growth_proportional_to_dt",
    1,
    "The energy that explicit Euler adds is proportional to dt.",
    verdict=Verdict.CONDITIONAL,
    condition="it is counted per second and omega dt is small",
    corrected="Per step it is (omega dt)^2, so halving dt quarters it; there are then twice as "
    "many "
    "steps, so per second the energy grows by the factor exp(omega^2 dt).",
    figures={
        "power_of_dt_per_step": (2.0, 1e-3),
        "power_of_dt_per_second": (0.9999991, 1e-3),
        "per_second_1_hz_1_ms": (1.040267, 1e-3),
    },
    formula=Formula(
        "By which factor does explicit Euler multiply an oscillator's energy in one second, to "
        "leading order of a small step h?",
        "exp(omega^2*h)",
        _OSCILLATOR,
        left=("factor", "E"),
        slips={
            "1 + omega^2*h^2": "That is the factor of one step; there are 1/h of them in a second.",
            "exp(omega*h)": "The exponent per step is (omega h)^2.",
            "exp(omega^2*h^2)": "That is one step; a second has 1/h steps.",
        },
    ),
)
def _explicit_growth_proportional_to_dt() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import symbols
    from course.rigid_body import integrators, problems

    system = problems.oscillator().system

    def growth(dt: float, steps: int) -> float:
        run = integrators.simulate(system, "explicit_euler", dt, steps)
        e0, e1 = (
            float(problems.oscillator_energy(q, v, system.params))
            for q, v in zip(run.q, run.v, strict=True)
        )
        return e1 / e0

    per_step = np.log2((growth(2e-4, 1) - 1) / (growth(1e-4, 1) - 1))
    per_second = np.log2(np.log(growth(2e-4, 5000)) / np.log(growth(1e-4, 10_000)))
    h, omega, _ = symbols()
    lead = sympy.series(sympy.log(1 + omega**2 * h**2) / h, h, 0, 3).removeO()
    return Finding(
        {
            "power_of_dt_per_step": per_step,
            "power_of_dt_per_second": per_second,
            "per_second_1_hz_1_ms": growth(1e-3, 1000),
        },
        "Growth of the energy of a 1 Hz oscillator, at two steps.",
        holds=abs(per_step - 1) < 0.1,
        holds_if=abs(per_second - 1) < 0.01,
        corrected=abs(per_step - 2) < 0.01,
        formula=sympy.exp(lead),
    )


@claim(
    "explicit_adds_always",
    1,
    "Explicit Euler adds energy at every step of every system.",
    verdict=Verdict.FALSE,
    corrected="In a potential V it changes the energy per unit of mass by h^2 (V'' v^2 + V'^2) "
    "/ 2, "
    "to second order. A pendulum that swings over the top loses energy there, because V'' is "
    "negative.",
    figures={"bottom_over_h2": (22.9363, 1e-3), "top_over_h2": (-19.03619, 1e-3)},
)
def _explicit_adds_always() -> Finding:
    from course.rigid_body import integrators, problems

    system = problems.pendulum().system
    g_over_l, h = system.params[0], 1e-4

    def change(theta: float, rate: float) -> float:
        q, v = np.array([theta]), np.array([rate])
        q1, v1 = integrators.explicit_euler(q, v, system.acceleration, h, system.params)
        return float(
            problems.pendulum_energy(q1, v1, system.params)
            - problems.pendulum_energy(q, v, system.params)
        )

    def law(theta: float, rate: float) -> float:
        slope, curve = g_over_l * np.sin(theta), g_over_l * np.cos(theta)
        return 0.5 * h * h * (curve * rate**2 + slope**2)

    bottom, top = change(0.3, 2.0), change(np.pi - 0.1, 2.0)
    close = all(abs(change(a, 2.0) / law(a, 2.0) - 1) < 1e-2 for a in (0.3, 1.0, np.pi - 0.1))
    return Finding(
        {"bottom_over_h2": bottom / h**2, "top_over_h2": top / h**2},
        "Change of a pendulum's energy in one step, near the bottom and near the top.",
        holds=bottom > 0 and top > 0,
        corrected=close and top < 0,
    )


@claim(
    "semi_implicit_dissipates",
    1,
    "Semi-implicit Euler dissipates energy, which is why it is stable.",
    verdict=Verdict.FALSE,
    corrected="It dissipates nothing. On an oscillator it conserves v^2/2 + omega^2 x^2/2 - "
    "omega^2 h x v/2 exactly, so the energy swings within a fixed band and comes back.",
    figures={
        "lowest": (0.952381, 1e-4),
        "highest": (1.052632, 1e-4),
        "explicit_after_1000": (20959.16, 1e-4),
    },
    formula=Formula(
        "Semi-implicit Euler (velocity first) conserves v^2/2 + omega^2 x^2/2 + c x v on the "
        "oscillator. What is c?",
        "-omega^2*h/2",
        _OSCILLATOR,
        left=("c",),
        slips={
            "omega^2*h/2": "The sign is that of the other order, position first.",
            "-omega*h/2": "Check the units: c times x v must be a velocity squared.",
            "-omega^2*h": "Twice too much: half of it comes from each of the two squares.",
        },
    ),
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. IX.3",
)
def _semi_implicit_dissipates() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols
    from course.rigid_body import integrators, problems

    omega = symbols()[1]
    c = sympy.Symbol("c")
    A = step_matrix("semi_implicit_euler")
    form = sympy.Matrix([[omega**2 / 2, c / 2], [c / 2, sympy.Rational(1, 2)]])
    solution = sympy.solve(list((A.T * form * A - form).applyfunc(sympy.expand)), c, dict=True)
    system = problems.oscillator(omega=1.0).system
    run = integrators.simulate(system, "semi_implicit_euler", 0.1, 1_000_000, every=10)
    energy = problems.oscillator_energy(run.q.T, run.v.T, system.params)
    drift = float(abs(energy[-10_000:].mean() / energy[:10_000].mean() - 1))
    low, high = float(energy.min() / energy[0]), float(energy.max() / energy[0])
    explicit = integrators.simulate(system, "explicit_euler", 0.1, 1000)
    gain = float(
        problems.oscillator_energy(explicit.q[-1], explicit.v[-1], system.params) / energy[0]
    )
    return Finding(
        {"lowest": low, "highest": high, "explicit_after_1000": gain},
        f"omega h = 0.1, a million steps: the mean energy moves by {drift:.0e} of itself.",
        holds=drift > 1e-3,
        corrected=len(solution) == 1 and drift < 1e-5,
        formula=solution[0][c],
    )


@claim(
    "semi_implicit_energy_swing",
    1,
    "Under semi-implicit Euler the energy swings about the true value.",
    verdict=Verdict.HOLDS,
    corrected="It swings about the conserved value by a relative omega h / 2 to either side, to "
    "leading order; the mean differs only by order (omega h)^2.",
    figures={
        "swing_over_omega_h": (0.5003127, 2e-3),
        "power_of_swing": (1.002709, 2e-3),
        "power_of_mean": (2.006498, 2e-3),
    },
)
def _semi_implicit_energy_swing() -> Finding:
    from course.rigid_body import integrators, problems

    system = problems.oscillator(omega=1.0).system

    def swing(h: float) -> tuple[float, float]:
        run = integrators.simulate(system, "semi_implicit_euler", h, 100_000, every=1)
        energy = problems.oscillator_energy(run.q.T, run.v.T, system.params)
        kept = 0.5 * run.v[:, 0] ** 2 + 0.5 * run.q[:, 0] ** 2 - 0.5 * h * run.q[:, 0] * run.v[:, 0]
        relative = energy / kept - 1
        return float(np.ptp(relative) / 2), float(relative.mean())

    (large, mean_large), (small, mean_small) = swing(0.1), swing(0.05)
    return Finding(
        {
            "swing_over_omega_h": small / 0.05,
            "power_of_swing": np.log2(large / small),
            "power_of_mean": np.log2(mean_large / mean_small),
        },
        f"Half the range of the relative energy: {large:.5f} at omega h = 0.1, {small:.5f} at "
        "0.05.",
        holds=abs(mean_small) < 0.1 * small,
        corrected=abs(small / 0.05 - 0.5) < 1e-3
        and abs(np.log2(large / small) - 1) < 0.05
        and abs(np.log2(mean_large / mean_small) - 2) < 0.05,
    )


@claim(
    "swapping_two_lines",
    1,
    "Moving the velocity update before the position update stops the growth of energy.",
    verdict=Verdict.CONDITIONAL,
    condition="omega h < 2",
    corrected="The swap makes the step area-preserving; below omega h = 2 the energy is then "
    "bounded, above it the swapped version explodes as well, and faster.",
    figures={"inside": (1.0, 1e-4), "outside": (4, 1e-4), "explicit_outside": (2.692582, 1e-4)},
)
def _swapping_two_lines() -> Finding:
    from course.derivations.rigid_body.linear import spectral_radius

    inside = spectral_radius("semi_implicit_euler", 1.9)
    outside = spectral_radius("semi_implicit_euler", 2.5)
    explicit = spectral_radius("explicit_euler", 2.5)
    return Finding(
        {"inside": inside, "outside": outside, "explicit_outside": explicit},
        "Largest growth factor of the amplitude per step, at omega h = 1.9 and 2.5.",
        holds=outside <= 1 + 1e-9,
        holds_if=inside <= 1 + 1e-9,
        corrected=outside > explicit > 1,
    )


@claim(
    "area_preserved",
    1,
    "Semi-implicit Euler is symplectic and RK4 is not.",
    verdict=Verdict.HOLDS,
    corrected="For forces that depend on positions alone, semi-implicit Euler, velocity Verlet and "
    "the implicit midpoint rule keep phase-space area exactly. RK4 shrinks it by "
    "(omega h)^6 / 72 per step, the explicit midpoint rule grows it by (omega h)^4 / 4, "
    "explicit Euler by (omega h)^2.",
    figures={
        "explicit_euler_at_half": (0.25, 1e-6),
        "semi_implicit_euler_at_half": (0, 1e-6),
        "velocity_verlet_at_half": (0, 1e-6),
        "explicit_midpoint_at_half": (0.015625, 1e-6),
        "implicit_midpoint_at_half": (0, 1e-6),
        "rk4_at_half": (-0.0002102322, 1e-6),
    },
)
def _area_preserved() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols
    from course.rigid_body.integrators import INTEGRATORS

    h, omega, _ = symbols()
    names = [n for n in INTEGRATORS if n != "rk4_renormalised"]
    excess = {n: sympy.expand(sympy.simplify(step_matrix(n).det()) - 1) for n in names}
    kept = {n for n in names if excess[n] == 0}
    half = {omega: 1, h: sympy.Rational(1, 2)}
    leading = {"rk4": -((omega * h) ** 6) / 72, "explicit_midpoint": (omega * h) ** 4 / 4,
               "explicit_euler": (omega * h) ** 2}  # fmt: skip
    return Finding(
        {f"{n}_at_half": float(excess[n].subs(half)) for n in names},
        "Determinant of one step less 1, at omega h = 0.5.",
        holds="semi_implicit_euler" in kept and "rk4" not in kept,
        corrected=kept == {n for n in names if INTEGRATORS[n].symplectic}
        and all(sympy.limit(excess[n] / term, h, 0) == 1 for n, term in leading.items()),
    )


@claim(
    "symplectic_conserves_energy",
    1,
    "A symplectic integrator conserves energy.",
    verdict=Verdict.FALSE,
    corrected="It conserves area. Its energy error stays bounded over very long times, of the size "
    "of its order in h; it does not vanish.",
    figures={
        "relative_error": (0.0007493328, 5e-3),
        "late_over_early": (1.0, 5e-3),
        "power_of_h": (2.000189, 5e-3),
    },
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), ch. IX",
)
def _symplectic_conserves_energy() -> Finding:
    from course.rigid_body import integrators, problems

    system = problems.pendulum(amplitude=2.0).system

    def energies(h: float, steps: int) -> np.ndarray:
        run = integrators.simulate(system, "velocity_verlet", h, steps, every=1)
        energy = problems.pendulum_energy(run.q.T, run.v.T, system.params)
        return energy / energy[0] - 1

    coarse, fine = energies(0.02, 500_000), energies(0.01, 1000)
    early, late = float(np.abs(coarse[:5000]).max()), float(np.abs(coarse[-5000:]).max())
    return Finding(
        {"relative_error": early, "late_over_early": late / early,
         "power_of_h": np.log2(early / float(np.abs(fine).max()))},
        f"Velocity Verlet on a pendulum, 20 ms: energy off by up to {early:.1e} in the first 5000 "
        "steps and as much in the last of 500,000.",
        holds=early < 1e-9,
        corrected=abs(late / early - 1) < 0.05,
    )  # fmt: skip


@claim(
    "symplectic_with_varying_step",
    1,
    "A symplectic integrator stays good when the step follows the motion.",
    verdict=Verdict.FALSE,
    corrected="Choosing the step from the state makes a map that is not symplectic: the energy "
    "then drifts steadily. With a fixed step it does not.",
    figures={"varying_drift": (0.01194543, 0.02)},
    source="Calvo and Sanz-Serna, The development of variable-step symplectic integrators (1993)",
)
def _symplectic_with_varying_step() -> Finding:
    from course.rigid_body import integrators

    def attraction(q: np.ndarray, v: np.ndarray, params: np.ndarray) -> np.ndarray:
        return -q / (q[0] * q[0] + q[1] * q[1]) ** 1.5

    def drift(follows: bool) -> float:
        # A Kepler orbit of eccentricity 0.5; the mean energy over its first and last orbits.
        q, v = np.array([0.5, 0.0]), np.array([0.0, np.sqrt(3.0)])
        energies, times, t = [], [], 0.0
        while t < 60 * 2 * np.pi:
            r = np.hypot(q[0], q[1])
            h = 0.1 * r**1.5 if follows else 0.05
            q, v = integrators.velocity_verlet(q, v, attraction, h, None)
            t += h
            times.append(t)
            energies.append(0.5 * v @ v - 1.0 / np.hypot(q[0], q[1]))
        e, when = np.array(energies), np.array(times)
        first, last = when < 4 * np.pi, when > 56 * 2 * np.pi
        return float(abs(np.median(e[last]) - np.median(e[first])))

    fixed, varying = drift(False), drift(True)
    return Finding(
        {"varying_drift": varying},
        f"A planet over 60 orbits: the energy drifts by {varying:.1e} with the step that follows "
        f"the distance, by {fixed:.1e} with a fixed one (the energy is -0.5).",
        holds=varying < 3 * fixed,
        corrected=varying > 10 * fixed,
    )


@claim(
    "semi_implicit_arm_energy",
    1,
    "With a fixed step semi-implicit Euler has no energy drift, for an arm as for a spring.",
    verdict=Verdict.CONDITIONAL,
    condition="forces depend on the position alone and the mass matrix is constant",
    corrected="In joint angles and rates an arm's Coriolis terms depend on the velocity, and so "
    "does omega x (I omega) of a turning body: the step is not symplectic there, and the energy "
    "drifts steadily. Symplectic methods for arms and turning bodies work with momenta.",
    figures={
        # The motion is chaotic: another processor takes another path.
        "double_pendulum_lost_j": (6.7, 0.4),
        "of_energy_above_hanging_j": (32.3, 0.01),
        "pendulum_drift": (0.0, 1e-4),
    },
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. VI.3",
)
def _semi_implicit_arm_energy() -> Finding:
    from course.rigid_body import integrators, problems

    def energies(problem: problems.Problem) -> np.ndarray:
        run = integrators.simulate(problem.system, "semi_implicit_euler", 1e-3, 100_000, every=10)
        energy = problem.system.energy
        assert energy is not None
        return np.asarray(energy(run.q.T, run.v.T, problem.system.params))

    arm, one = problems.double_pendulum(), problems.pendulum()
    total, single = energies(arm), energies(one)
    hanging = problems.double_pendulum_energy(np.zeros(2), np.zeros(2), arm.system.params)
    # Means over the first and the last tenth, so that the swing of the energy is not in it.
    lost = float(np.mean(total[:1000]) - np.mean(total[-1000:]))
    drift = float(np.mean(single[-1000:]) / np.mean(single[:1000]) - 1.0)
    return Finding(
        {
            "double_pendulum_lost_j": lost,
            "of_energy_above_hanging_j": float(total[0] - hanging),
            "pendulum_drift": round(drift, 4),
        },
        f"100 s at 1 ms: the double pendulum loses {lost:.1f} J, the pendulum's mean energy stays "
        f"within {abs(drift):.0e} of itself.",
        holds=abs(lost) < 0.1,
        holds_if=abs(drift) < 1e-3,
        corrected=lost > 1.0,
    )


@claim(
    "semi_implicit_keeps_area_always",
    1,
    "Semi-implicit Euler preserves phase-space area.",
    verdict=Verdict.CONDITIONAL,
    condition="the forces do not depend on velocity",
    corrected="With viscous damping its determinant is 1 - 2 zeta omega h per step, an "
    "approximation "
    "of the true exp(-2 zeta omega h). Symplecticity says nothing about systems that "
    "dissipate.",
    figures={"determinant": (0.9, 1e-6), "true_contraction": (0.9048374, 1e-6)},
)
def _semi_implicit_keeps_area_always() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols

    h, omega, zeta = symbols()
    free = sympy.simplify(step_matrix("semi_implicit_euler").det())
    damped = sympy.simplify(step_matrix("semi_implicit_euler", damped=True).det())
    at = {h: sympy.Rational(1, 10), omega: 1, zeta: sympy.Rational(1, 2)}
    found, true = float(damped.subs(at)), float(sympy.exp(-2 * zeta * omega * h).subs(at))
    return Finding(
        {"determinant": found, "true_contraction": true},
        "omega h = 0.1 and zeta = 0.5.",
        holds=damped == 1,
        holds_if=free == 1,
        corrected=sympy.expand(damped - (1 - 2 * zeta * omega * h)) == 0,
    )


@claim(
    "rk4_energy_factor",
    1,
    "RK4 gains energy over time, as every explicit method does.",
    verdict=Verdict.FALSE,
    corrected="On an undamped oscillator it loses energy, by the factor "
    "1 - (omega h)^6/72 + (omega h)^8/576 per step, until omega h passes 2 sqrt(2).",
    figures={
        "left_after_1000_at_half": (0.8103781, 1e-6),
        "amplitude_coefficient": (-0.006944444, 1e-6),
    },
    formula=Formula(
        "By which factor does RK4 multiply the energy of an undamped oscillator at each step?",
        "1 - (omega*h)^6/72 + (omega*h)^8/576",
        _OSCILLATOR,
        left=("factor", "E"),
        slips={
            "1 - (omega*h)^6/72": "That is the leading term; the exact factor has one more.",
            "1 - (omega*h)^6/144": "That is the leading term of the amplitude's factor.",
            "1 + (omega*h)^6/72 - (omega*h)^8/576": "The signs are the other way round.",
        },
    ),
)
def _rk4_energy_factor() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols
    from course.rigid_body import integrators, problems

    h, omega, _ = symbols()
    A = step_matrix("rk4")
    energy = sympy.diag(omega**2 / 2, sympy.Rational(1, 2))
    factor = sympy.expand(sympy.simplify((A.T * energy * A * energy.inv())[0, 0]))
    amplitude = sympy.series(sympy.sqrt(factor), h, 0, 7).removeO()
    system = problems.oscillator(omega=1.0).system
    run = integrators.simulate(system, "rk4", 0.5, 1000)
    kept = float(problems.oscillator_energy(run.q[-1], run.v[-1], system.params) / 0.5)
    predicted = float(factor.subs({h: 0.5, omega: 1})) ** 1000
    return Finding(
        {"left_after_1000_at_half": kept,
         "amplitude_coefficient": float(amplitude.coeff(h, 6).subs(omega, 1))},
        f"omega h = 0.5: {kept:.4f} of the energy is left after 1000 steps.",
        holds=kept > 1,
        corrected=abs(kept / predicted - 1) < 1e-9,
        formula=factor,
    )  # fmt: skip


@claim(
    "verlet_frequency",
    1,
    "A symplectic integrator follows the oscillator in step.",
    verdict=Verdict.FALSE,
    corrected="Energy is bounded, phase is not: semi-implicit Euler and velocity Verlet oscillate "
    "at (2/h) asin(omega h / 2), too fast by the share (omega h)^2 / 24.",
    figures={"ahead_after_1000_rad": (0.4171361, 1e-4), "leading_share": (0.04166667, 1e-4)},
    formula=Formula(
        "At which angular frequency does velocity Verlet oscillate, for omega h < 2?",
        "2/h*asin(omega*h/2)",
        {"omega": Symbol("true angular frequency [rad/s]", 0.1, 1.5),
         "h": Symbol("step [s]", 0.1, 1.3)},
        left=("Omega", "w"),
        slips={
            "omega": "That is the true one; the numerical one is higher.",
            "asin(omega*h)/h": "cos(Omega h) = 1 - (omega h)^2 / 2, and half angles come out.",
            "2/h*atan(omega*h/2)": "That is the implicit midpoint rule, which lags.",
            "omega*(1+(omega*h)^2/24)": "That is the start of the series; the exact one is asked.",
        },
    ),
)  # fmt: skip
def _verlet_frequency() -> Finding:
    import sympy

    from course.derivations.rigid_body.linear import step_matrix, symbols
    from course.rigid_body import integrators, problems

    h, omega, _ = symbols()
    half_trace = sympy.simplify(step_matrix("velocity_verlet").trace() / 2)
    frequency = 2 / h * sympy.asin(omega * h / 2)
    consistent = sympy.simplify(sympy.expand_trig(sympy.cos(frequency * h)) - half_trace) == 0
    share = sympy.series(frequency / omega, h, 0, 4).removeO().coeff(h, 2)
    problem = problems.oscillator(omega=1.0)
    run = integrators.simulate(problem.system, "velocity_verlet", 0.1, 10_000)
    angle = 1000.0 * float(frequency.subs({omega: 1, h: sympy.Rational(1, 10)}))
    ahead = angle - 1000.0
    return Finding(
        {"ahead_after_1000_rad": ahead, "leading_share": float(share.subs(omega, 1))},
        f"omega h = 0.1, 10,000 steps: {ahead:.3f} rad ahead of the true motion.",
        holds=abs(ahead) < 1e-3,
        corrected=consistent and abs(run.q[-1, 0] - np.cos(angle)) < 1e-9,
        formula=frequency,
    )
