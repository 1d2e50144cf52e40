"""Claims about what integrators do to energy and to phase-space area."""

from collections.abc import Callable
from typing import Any

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "omega": Symbol("true angular frequency [rad/s]", 0.1, 1.5),
    "h": Symbol("step [s]", 0.01, 1.0),
}


def _energies(problem: Any, method: str, dt: float, steps: int, every: int = 1) -> np.ndarray:
    """Return the energies along a run of one of the chapter's problems, shape (records + 1,)."""
    from course.rigid_body import simulate

    system = problem.system
    run = simulate(system, method, dt, steps, every=every)
    return np.asarray(system.energy(run.q.T, run.v.T, system.params)).ravel()


def _steps(method: str, system: Any, q: np.ndarray, v: np.ndarray, dt: Any, steps: int) -> Any:
    """Run many trajectories in parallel, each with its own start and step.

    It returns q and v, (steps + 1, nq, N).

    Args:
        method: name of an integrator.
        system: (acceleration, params).
        q: positions at the start, shape (nq, N).
        v: velocities at the start, shape (nq, N).
        dt: one step for all, or one each, shape (N,).
        steps: number of steps.
    """
    from course.rigid_body import INTEGRATORS

    states = [(q, v)]
    for _ in range(steps):
        states.append(INTEGRATORS[method].step(*states[-1], system[0], dt, system[1]))
    return np.array([s[0] for s in states]), np.array([s[1] for s in states])


def _spring(omega: float = 1.0) -> tuple[Any, np.ndarray]:
    from course.rigid_body.problems import oscillator

    system = oscillator(omega=omega).system
    return system.acceleration, system.params


def _pendulum() -> tuple[Any, np.ndarray]:
    from course.rigid_body.problems import pendulum

    system = pendulum().system
    return system.acceleration, system.params


def _matrix(name: str) -> tuple[Any, Any, Any]:
    """Return (matrix of one step on the free oscillator, h, omega) as SymPy expressions."""
    from course.derivations.rigid_body.linear import step_matrix, symbols

    return step_matrix(name), *symbols()[:2]


def _energy_ratio(name: str) -> Any:
    """Return a^T E A E^-1 for the oscillator's energy E.

    It is a multiple of 1 if all states gain alike.
    """
    import sympy

    A, _, omega = _matrix(name)
    # The energy is the quadratic form s^T E s, so one step changes it to s^T (A^T E A) s.
    energy = sympy.diag(omega**2 / 2, sympy.Rational(1, 2))
    return sympy.simplify(A.T * energy * A * energy.inv())


@claim(
    "Explicit Euler adds energy to an oscillator.",
    "It multiplies the energy of an undamped oscillator by exactly {formula} at every step, "
    "whatever the state.",
    ask=(
        "By which factor does explicit Euler multiply the energy of an undamped oscillator at "
        "each step of length h?",
        "factor, E = 1 + omega^2*h^2",
        {
            "1 + omega*h": "The first-order terms of kinetic and potential energy cancel.",
            "1 - omega^2*h^2": "It gains: look at the sign of the determinant's second term.",
            "sqrt(1 + omega^2*h^2)": "Yours is the factor of the amplitude; energy is its square.",
            "1 + omega^2*h^2/2": "Both position and velocity contribute a half.",
        },
    ),
)
def explicit_energy_factor(result):
    import sympy

    _, h, omega = _matrix("explicit_euler")
    ratio = _energy_ratio("explicit_euler")
    result.formula = sympy.expand(ratio[0, 0])
    value = result.formula.subs({omega: 2 * sympy.pi, h: sympy.Rational(1, 100)})
    result.measure("factor_1_hz_10_ms", value)
    result.statement = f"A^T E A = ({ratio[0, 0]}) E for the matrix A of the step."
    result.statement_holds(float(value) > 1)
    # "Whatever the state" means that A^T E A is a scalar multiple of E, not only that one state
    # gains.
    result.correction_holds(ratio == ratio[0, 0] * sympy.eye(2))


@claim(
    "The energy that explicit Euler adds is proportional to dt.",
    "Per step it is (omega dt)^2, so halving dt quarters it; there are then twice as many steps, "
    "so for small steps the energy grows by the factor {formula} per second: proportional to dt is "
    "the exponent, not the energy that a second adds.",
    ask=(
        "By which factor does explicit Euler multiply an oscillator's energy in one second? Give "
        "the leading form for small steps, exp(...) with h in the exponent.",
        "factor, E = exp(omega^2*h)",
        {
            "1 + omega^2*h^2": "Yours is the factor of one step; a second has 1/h of them.",
            "exp(omega*h)": "The exponent per step is (omega h)^2.",
            "exp(omega^2*h^2)": "Yours is one step; a second has 1/h steps.",
        },
    ),
)
def explicit_growth_per_second(result):
    import sympy

    from course.rigid_body import problems

    def growth(dt: float, steps: int, omega: float = 2 * np.pi) -> float:
        energy = _energies(problems.oscillator(omega), "explicit_euler", dt, steps, steps)
        return float(np.log(energy[1] / energy[0]))

    def power(dt: float, omega: float = 2 * np.pi) -> float:
        """Return the power of dt in the growth of the logarithm over the same time."""
        # Same duration at both steps: 1000 steps of 2 dt, 2000 of dt.
        return float(np.log2(growth(2 * dt, 1000, omega) / growth(dt, 2000, omega)))

    def together(dt: float) -> float:
        """Return the same power for two oscillators whose energies are added."""

        def grown(h: float, steps: int) -> float:
            runs = [
                _energies(problems.oscillator(w), "explicit_euler", h, steps, steps)
                for w in (0.5, 1.0)
            ]
            return float(np.log(sum(e[1] for e in runs) / sum(e[0] for e in runs)))

        return float(np.log2(grown(2 * dt, 1000) / grown(dt, 2000)))

    def lifted(dt: float) -> float:
        """Return the same power for a mass whose energy is counted from just below its start."""

        def grown(h: float, steps: int) -> float:
            energy = _energies(problems.oscillator(1.0), "explicit_euler", h, steps, steps)
            return float(np.log((energy[1] - 0.99 * energy[0]) / (0.01 * energy[0])))

        return float(np.log2(grown(2 * dt, 1000) / grown(dt, 2000)))

    def swung(dt: float) -> float:
        """Return the same power for a pendulum that is released at 3 rad, over 10 s."""
        problem = problems.pendulum(3.0)
        system: Any = problem.system
        bottom = float(system.energy(0 * system.q0, 0 * system.v0, system.params))

        def grown(h: float) -> float:
            steps = round(10 / h)
            energy = _energies(problem, "explicit_euler", h, steps, steps) - bottom
            return float(np.log(energy[1] / energy[0]))

        return float(np.log2(grown(2 * dt) / grown(dt)))

    _, h, omega = _matrix("explicit_euler")
    # expm1 turns the growth of ln E back into the relative gain of one step.
    per_step = np.log2(np.expm1(growth(2e-4, 1)) / np.expm1(growth(1e-4, 1)))
    small = result.input("small", 0.05)
    result.measure("power_of_dt_per_step", per_step, 1e-3)
    result.measure("power_of_dt_per_second", power(1e-4), 1e-3)
    result.measure("per_second_1_hz_1_ms", np.exp(growth(1e-3, 1000)), 1e-3)
    result.formula = sympy.exp(sympy.series(sympy.log(1 + omega**2 * h**2) / h, h, 0, 3).removeO())
    result.statement = (
        "Growth of an oscillator's energy at dt and 2 dt, over a step and over a time."
    )
    result.statement_holds(
        abs(per_step - 1) < 0.1,
        only_if="it is the growth of ln E per second, of one undamped linear oscillator whose "
        "energy E is zero at rest, and omega dt stays below {small}",
        # Samples below the bound are proportional to dt within 1 %. Those up to four times it reach
        # the next term of ln(1 + (omega h)^2), so that some fail.
        inside=[abs(power(x / 2, 1.0) - 1) < 0.01 for x in result.rng.uniform(0.01, 1, 12) * small],
        outside=[abs(power(x / 2, 1.0) - 1) < 0.01 for x in result.rng.uniform(1, 4, 12) * small]
        # Chosen to break it: two frequencies, of which the higher one takes over with time.
        + [abs(together(x / 2) - 1) < 0.01 for x in result.rng.uniform(0.5, 1, 4) * small]
        # Chosen to break it: a hung mass whose energy is counted from another zero, and a pendulum.
        + [abs(lifted(x / 2) - 1) < 0.01 for x in result.rng.uniform(0.5, 1, 4) * small]
        + [abs(swung(x) - 1) < 0.01 for x in (1e-3, 5e-4)],
    )
    result.correction_holds(abs(per_step - 2) < 0.01)


@claim(
    "Explicit Euler adds energy at every step of every system.",
    "In a potential V it changes the energy per unit of mass by h^2 (V'' v^2 + V'^2) / 2, to "
    "second order. A pendulum that swings over the top loses energy there, because V'' is "
    "negative.",
)
def explicit_adds_always(result):
    from course.rigid_body import problems

    g_over_l, h = _pendulum()[1][0], 1e-4

    def change(angle: Any, rate: Any) -> np.ndarray:
        q, v = _steps("explicit_euler", _pendulum(), np.array([angle]), np.array([rate]), h, 1)
        start, end = (problems.pendulum_energy(*s, _pendulum()[1]) for s in zip(q, v, strict=True))
        return (end - start) / h**2

    # States of every angle: V'' = (g / l) cos q changes its sign at the horizontal, so that a
    # sample from small swings alone would confirm the claim.
    draws = result.rng.uniform((-np.pi, -5.0), (np.pi, 5.0), (200, 2)).T
    law = (g_over_l * np.cos(draws[0]) * draws[1] ** 2 + (g_over_l * np.sin(draws[0])) ** 2) / 2
    bottom, top = float(change(0.3, 2.0)), float(change(np.pi - 0.1, 2.0))
    result.measure("bottom_over_h2", bottom, 1e-3)
    result.measure("top_over_h2", top, 1e-3)
    result.statement = (
        "Change of a pendulum's energy in one step, near the bottom and near the top."
    )
    result.statement_holds(bottom > 0 and top > 0)
    # The law is the second-order term in h; what it neglects is of relative size h = 1e-4.
    result.correction_holds(top < 0, np.abs(change(*draws) - law).max() < 1e-3 * np.abs(law).max())


@claim(
    "Explicit Euler makes the energy of a body grow even with no applied forces.",
    "Without forces a flight straight on is exact. What grows is the energy of a tumbling body, by "
    "h^2 alpha . (I alpha) / 2 at every step, as alpha = -I^-1 (omega x (I omega)) depends on the "
    "velocity; and there the usual cure, to swap the two lines, does nothing: semi-implicit Euler "
    "computes the same rates. At {rate_rad_per_s:.2g} rad/s and {step_ms:g} ms the moments 1 : 2 : "
    "3 gain {gain_percent:.1f} % in {seconds:g} s.",
)
def explicit_adds_without_forces(result):
    from course.rigid_body import problems, quaternion
    from course.rigid_body.spatial import free_flight_acceleration as flight

    n, h, names = 50, result.input("step_ms", 1.0) / 1000, ("explicit_euler", "semi_implicit_euler")
    # Sorted, at least 0.1 apart, and each below the sum of the other two, as for a physical body.
    moments = np.sort(result.rng.uniform(1.0, 1.8, (3, n)), axis=0) + [[0.0], [0.1], [0.2]]
    omega, velocity = result.rng.normal(size=(2, 3, n))
    weights = np.vstack((np.ones((3, n)), moments))
    params = np.vstack((np.zeros((3, n)), moments))
    q = np.vstack((np.zeros((3, n)), np.tile(quaternion.identity()[:, None], n)))

    def gains(method: str, spin: np.ndarray, steps: int = 200) -> np.ndarray:
        """Return the energy of free bodies after some steps minus that at the start."""
        v = _steps(method, (flight, params), q, np.vstack((velocity, spin)), h, steps)[1]
        return (weights * (v[-1] ** 2 - v[0] ** 2)).sum(axis=0) / 2

    tumbling = [gains(name, omega) for name in names]
    # Spin about a principal axis has omega x (I omega) = 0: Euler's equations leave it unchanged.
    about_axis = omega * np.eye(3)[result.rng.integers(0, 3, n)].T
    steady, straight = (gains(names[0], spin) for spin in (about_axis, 0 * omega))
    alpha = flight(q, np.vstack((velocity, omega)), params)[3:]
    # omega . (I alpha) vanishes, because the gyroscopic torque does no work; the square in h
    # remains.
    law = h * h * (moments * alpha**2).sum(axis=0) / 2
    tumble, seconds = problems.tumble(), result.input("seconds", 20.0)
    energy = _energies(tumble, names[0], h, round(seconds / h))
    # Chosen to break it: two equal moments, and spins that are almost about a principal axis.
    equal = np.vstack((params[:3], params[[3, 3, 5]]))
    nearly = about_axis + 1e-3 * omega

    def gain_of(bodies: np.ndarray, spin: np.ndarray) -> np.ndarray:
        """Return the energy that 200 steps of explicit Euler add to these bodies."""
        v = _steps(names[0], (flight, bodies), q, np.vstack((0 * spin, spin)), h, 200)[1]
        return (bodies[3:] * (v[-1, 3:] ** 2 - v[0, 3:] ** 2)).sum(axis=0) / 2

    hostile = np.concatenate((gain_of(equal, omega), gain_of(params, nearly)))
    # With two equal moments, every axis across the third one is a principal axis.
    across = gain_of(equal, omega * [[1.0], [1.0], [0.0]])
    result.measure("rate_rad_per_s", np.linalg.norm(tumble.system.v0))
    result.measure("gain_percent", 100 * (energy[-1] / energy[0] - 1), 1e-3)
    result.statement = "50 random bodies that tumble, spin about an axis, or only fly, 200 steps."
    result.statement_holds(
        (straight > 0).all(),
        only_if="it turns, and not about a principal axis",
        inside=np.concatenate((tumbling[0], hostile)) > 0,
        outside=np.concatenate((straight, steady, across)) > 0,
    )
    result.correction_holds(
        # Bit for bit: the acceleration reads only the velocity, so the order of the lines is
        # irrelevant.
        np.array_equal(tumbling[0], tumbling[1]),
        not straight.any(),
        (np.diff(energy) > 0).all(),
        np.allclose(gains(names[0], omega, 1), law, rtol=1e-6, atol=1e-14),
    )


@claim(
    "The listing `v += a*dt; x += v*dt` is explicit Euler.",
    "The second line reads the velocity that the first line has just changed, so this is "
    "semi-implicit Euler, to the last bit. Explicit Euler needs `x += v*dt` first. What matters is "
    "which velocity the position update uses.",
)
def usual_listing_is_explicit(result):
    from course.rigid_body import explicit_euler, semi_implicit_euler

    pull, params = _pendulum()

    def listing(x: float, v: float, dt: float) -> tuple[float, float]:
        v += pull(np.array([x]), v, params)[0] * dt
        x += v * dt
        return x, v

    def swapped(x: float, v: float, dt: float) -> tuple[float, float]:
        a = pull(np.array([x]), v, params)[0]
        x += v * dt
        v += a * dt
        return x, v

    # Random states and steps of a nonlinear system: on a special state, such as x = 0 at rest, the
    # two orders could agree.
    def largest_difference(lines: Any, method: Any) -> float:
        draws = [tuple(float(z) for z in row) for row in result.rng.uniform(0.01, 2, (100, 3))]
        steps = [
            np.ravel(method(np.array([x]), np.array([v]), pull, h, params)) for x, v, h in draws
        ]
        return float(np.abs(np.array([lines(*draw) for draw in draws]) - steps).max())

    result.measure("from_semi_implicit", largest_difference(listing, semi_implicit_euler), 1e-15)
    result.measure("from_explicit_m", largest_difference(listing, explicit_euler), 0.5)
    result.statement = "Largest difference over 100 random states and steps of a pendulum."
    result.statement_holds(largest_difference(listing, explicit_euler) < 1e-12)
    # The same operations in the same order give the same bits, so no tolerance is needed.
    result.correction_holds(
        largest_difference(listing, semi_implicit_euler) == 0,
        largest_difference(swapped, explicit_euler) == 0,
    )


@claim(
    "Semi-implicit Euler dissipates energy, which is why it is stable.",
    "On an oscillator it dissipates nothing: it conserves v^2/2 + omega^2 x^2/2 - omega^2 h x v/2 "
    "exactly. Below omega h = 2 the energy then swings within a fixed band and comes back: from "
    "rest between {lowest:.3f} and {highest:.3f} of it at omega h = {omega_h}, where explicit "
    "Euler has "
    "{explicit_after_1000:.3g} times the energy after {steps:g} steps.",
    ask=(
        "Semi-implicit Euler (velocity first) conserves v^2/2 + omega^2 x^2/2 + c x v on the "
        "oscillator. What is c?",
        "c = -omega^2*h/2",
        {
            "omega^2*h/2": "The sign is that of the other order, position first.",
            "-omega*h/2": "Check the units: c times x v must be a velocity squared.",
            "-omega^2*h": "Twice too much: half of it comes from each of the two squares.",
        },
    ),
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. IX.3",
)
def semi_implicit_dissipates(result):
    import sympy

    from course.rigid_body import problems

    A, _, omega = _matrix("semi_implicit_euler")
    c = sympy.Symbol("c")
    # Modified energy (backward error analysis): the quadratic form that A leaves unchanged.
    form = sympy.Matrix([[omega**2 / 2, c / 2], [c / 2, sympy.Rational(1, 2)]])
    (solution,) = sympy.solve(list((A.T * form * A - form).applyfunc(sympy.expand)), c, dict=True)
    u, steps = result.input("omega_h", 0.1), result.input("steps", 1000)
    spring = problems.oscillator(omega=1.0)
    energy = _energies(spring, "semi_implicit_euler", u, 200 * steps)
    # Means over 20,000 steps, some 300 periods, average the swing out of the drift.
    drift = abs(energy[-20_000:].mean() / energy[:20_000].mean() - 1)
    explicit = _energies(spring, "explicit_euler", u, steps, steps)
    result.formula = solution[c]
    result.measure("lowest", energy.min() / energy[0], 1e-4)
    result.measure("highest", energy.max() / energy[0], 1e-4)
    result.measure("explicit_after_1000", explicit[1] / explicit[0], 1e-4)
    result.statement = f"200,000 steps: the mean energy moves by {drift:.0e} of itself."
    # An independent test of the algebra: 50 steps up to close to the limit 2, from random states.
    h, start = result.rng.uniform(0.05, 1.9, 50), result.rng.normal(size=(2, 1, 50))
    x, v = _steps("semi_implicit_euler", _spring(), start[0], start[1], h, 500)
    retained = v**2 / 2 + x**2 / 2 - h * x * v / 2
    result.statement_holds(drift > 1e-3)
    # 1e-9 is rounding over 500 steps. The true energy would swing by several per cent.
    result.correction_holds(drift < 1e-5, np.ptp(retained, axis=0).max() < 1e-9 * retained.max())


@claim(
    "Under semi-implicit Euler the energy swings about the true value.",
    "It swings about a conserved value, by a relative omega h / 2 to either side, to leading "
    "order, and the energy of the start can lie anywhere in that band. Started at x = v / omega it "
    "is the top of it: at omega h = {omega_h} the energy stays between {low:.3f} and {high:.3f} of "
    "it.",
)
def semi_implicit_energy_swing(result):
    from course.rigid_body import problems

    def energies(phase: Any, h: Any) -> np.ndarray:
        """Return energy along runs with omega = 1 from (cos, sin) of a phase, shape (3001, N)."""
        x, v = np.array([np.cos(phase)]), np.array([np.sin(phase)])
        q, w = _steps("semi_implicit_euler", _spring(), x, v, h, 3000)
        return (q**2 + w**2)[:, 0] / 2

    def about(phase: Any, h: Any) -> np.ndarray:
        """Return whether the start is in the middle half of the band."""
        energy = energies(phase, h)
        middle = (energy.max(axis=0) + energy.min(axis=0)) / 2
        return np.abs(energy[0] - middle) < 0.25 * np.ptp(energy, axis=0)

    u, spring = result.input("omega_h", 0.1), problems.oscillator(omega=1.0)
    # Released at rest, where the conserved value is the energy of the start.
    runs = [_energies(spring, "semi_implicit_euler", x, 100_000) for x in (u, u / 2)]
    swing, mean = np.array([[np.ptp(e) / e[0] / 2, e.mean() / e[0] - 1] for e in runs]).T
    # x = v / omega maximises x v, hence the difference between the energy and the modified energy.
    top = energies(np.full(1, np.pi / 4), u)[:, 0]
    result.measure("swing_over_omega_h", swing[1] / (u / 2), 2e-3)
    result.measure("power_of_swing", np.log2(swing[0] / swing[1]), 2e-3)
    result.measure("power_of_mean", np.log2(mean[0] / mean[1]), 2e-3)
    result.measure("low", top.min() / top[0], 1e-4)
    result.measure("high", top.max() / top[0], 1e-4)
    result.statement = f"Half the range of the relative energy: {swing[0]:.5f} at omega h = {u}, "
    result.statement += f"{swing[1]:.5f} at half of it."
    h, phase = result.rng.uniform((0.02, 0), (0.9, 2 * np.pi), (40, 2)).T
    outside = about(phase, h)
    quarter = np.round(phase / (np.pi / 2)) * np.pi / 2
    # Chosen to break it: steps at which the run returns to its start after 7 to 26 steps.
    resonant = 2 * np.sin(np.pi / np.arange(7, 27))
    result.statement_holds(
        outside.all(),
        only_if="the run starts where x v = 0, at a turning point or in the middle, and omega h is "
        "below 1",
        # The nearest quarter turn, where x v = 0 and the energy equals the conserved form.
        # The last ten: steps just below 1.
        inside=np.concatenate(
            (about(quarter, h), about(quarter[:20], resonant))
            + (about(quarter[:10], np.linspace(0.9, 0.99, 10)),)
        ),
        # Chosen to break it: steps of more than 1, whose band lies mostly above the start, and the
        # step of 1, which returns after six steps and never falls below the start.
        outside=np.concatenate(
            (outside, about(quarter, result.rng.uniform(1.05, 1.95, 40)))
            + (about(np.arange(4) * np.pi / 2, 1.0),)
        ),
    )
    result.correction_holds(
        abs(swing[1] / (u / 2) - 0.5) < 1e-3,
        abs(mean[1]) < 0.1 * swing[1],
        abs(top.max() / top[0] - 1) < 1e-12,
    )


@claim(
    "Moving the velocity update before the position update stops the growth of energy.",
    "Where forces depend on positions alone, the swap makes the step area-preserving. Below omega "
    "h = 2 a spring's energy is then bounded; above, the swapped version explodes as well, and "
    "from omega h = {faster_from:.4f} on faster than the other. A pendulum needs a smaller step: "
    "at omega h = {pendulum_omega_h} the energy of {pendulum_share:.0%} of random swings grew more "
    "than tenfold. Where the force depends on the velocity alone, as in a free tumble, it changes "
    "nothing "
    "(`explicit_adds_without_forces`).",
)
def swapping_two_lines(result):
    from scipy.optimize import brentq

    from course.derivations.rigid_body.linear import spectral_radius

    def faster(u: float) -> float:
        return spectral_radius("semi_implicit_euler", u) - spectral_radius("explicit_euler", u)

    def bounded(u: float) -> bool:
        return spectral_radius("semi_implicit_euler", u) <= 1 + 1e-9

    # Above 2 the swapped step overtakes the other: equal spectral radii mark the crossing.
    crossing = brentq(faster, 2.01, 2.5)
    result.measure("inside", spectral_radius("semi_implicit_euler", 1.9), 1e-4)
    result.measure("outside", spectral_radius("semi_implicit_euler", 2.5), 1e-4)
    result.measure("explicit_outside", spectral_radius("explicit_euler", 2.5), 1e-4)
    result.measure("faster_from", crossing)
    result.statement = "Largest growth factor of an oscillator's amplitude per step."
    # From just above the limit, where the growth per step is smallest.
    above = result.rng.uniform(2.0001, 2.2, 20)
    pull, params = _pendulum()
    large = result.input("pendulum_omega_h", 1.5)

    def share(u: float) -> float:
        """Return the share of swings whose energy above the bottom grows tenfold in 2000 steps."""
        rate = np.sqrt(params[0])
        # Amplitudes up to 3 rad: the resonances that let the energy diffuse need a nonlinear force.
        start = result.rng.uniform(-1, 1, (2, 1, 200)) * np.reshape((3, rate), (2, 1, 1))
        q, v = _steps("semi_implicit_euler", (pull, params), start[0], start[1], u / rate, 2000)
        energy = (v / rate) ** 2 / 2 + 1 - np.cos(q)
        return float((energy.max(axis=0) > 10 * energy[0]).mean())

    diffuses = result.measure("pendulum_share", share(large), 0.2)
    result.statement_holds(
        bounded(2.5),
        only_if="it is an undamped spring and omega h < 2",
        inside=[bounded(u) for u in result.rng.uniform(0, 2, 50)]
        # Chosen to break it: steps that return to the start, and steps just below the limit.
        + [bounded(u) for u in (*np.sqrt((1, 2, 3)), *(2 - np.logspace(-4, -1, 8)))],
        outside=[bounded(u) for u in above],
    )
    result.correction_holds(
        all(faster(u) < 0 for u in np.linspace(2.001, 0.999 * crossing, 20)),
        all(faster(u) > 0 for u in np.linspace(1.001 * crossing, 6, 40)),
        all(spectral_radius("explicit_euler", u) > 1 for u in result.rng.uniform(0.01, 3, 50)),
        diffuses > 0.2,
        share(0.2) < 0.01,
    )


@claim(
    "With one degree of freedom and an acceleration that depends on the position alone, "
    "semi-implicit Euler is always symplectic and RK4, in general, is not.",
    "Semi-implicit Euler, velocity Verlet and the implicit midpoint rule then keep phase-space "
    "area. Where the acceleration is constant, RK4 is exact and keeps it, too. With several "
    "degrees of freedom the force must also come from a potential: under one that pushes around a "
    "centre, semi-implicit Euler is not symplectic. On an oscillator RK4 "
    "shrinks it by (omega h)^6 / 72 per step, the explicit midpoint rule grows it by "
    "(omega h)^4 / 4, to leading order, and explicit Euler by (omega h)^2.",
)
def area_preserved(result):
    import sympy

    from course.rigid_body.integrators import INTEGRATORS

    names = [n for n in INTEGRATORS if n != "rk4_renormalised"]
    _, h, omega = _matrix(names[0])
    excess = {n: sympy.expand(sympy.simplify(_matrix(n)[0].det()) - 1) for n in names}
    selected = {n for n in names if excess[n] == 0}
    leading = {
        "rk4": -((omega * h) ** 6) / 72,
        "explicit_midpoint": (omega * h) ** 4 / 4,
        "explicit_euler": (omega * h) ** 2,
    }
    for n in names:
        result.measure(f"{n}_at_half", excess[n].subs({omega: 1, h: sympy.Rational(1, 2)}))
    q, v, step = result.rng.uniform((-3, -4, 0.05), (3, 4, 0.3), (20, 3)).T
    # Central differences with 1e-6 leave errors near 1e-10, well below the threshold 1e-7 further
    # down.
    size = 1e-6 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]).T[:, :, None]

    def pendulum_area(name: str) -> np.ndarray:
        """Return determinant of one step at random states of a pendulum, by central differences."""
        x, w = (np.array([q, v])[:, None] + size).reshape(2, 1, -1)
        ends = _steps(name, _pendulum(), x, w, np.tile(step, 4), 1)
        e = np.array([end[1, 0].reshape(4, -1) for end in ends]) / 2e-6
        dq, dv = e[:, 0] - e[:, 1], e[:, 2] - e[:, 3]
        return dq[0] * dv[1] - dq[1] * dv[0]

    error = {n: float(np.abs(pendulum_area(n) - 1).max()) for n in names}

    def free_fall_area(name: str) -> np.ndarray:
        """Return the determinants of one step of 0.1 under a constant acceleration."""
        # The step is affine, so differences over whole units are exact except for rounding.
        x, w = np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, 1.0]])
        fall = (lambda q, v, pull: pull + 0 * q), -9.81
        ends = np.array([end[1, 0] for end in _steps(name, fall, x, w, 0.1, 1)])
        return np.linalg.det(ends[:, 1:] - ends[:, :1])

    def symplectic(stiffness):
        """Return whether semi-implicit Euler preserves the form for a = -stiffness q, step 0.1."""
        one, zero = np.eye(2), np.zeros((2, 2))
        kick = np.block([[one, zero], [-0.1 * stiffness, one]])
        move, form = (
            np.block([[one, 0.1 * one], [zero, one]]),
            np.block([[zero, one], [-one, zero]]),
        )
        step = move @ kick
        return np.allclose(step.T @ form @ step, form, atol=1e-12)

    result.statement = (
        "Determinant of one step less 1, on the oscillator and at 20 pendulum states."
    )
    result.statement_holds(
        "semi_implicit_euler" in selected and "rk4" not in selected and error["rk4"] > 1e-6
    )
    # The flags of the integrators are compared with two independent determinants: the algebra of a
    # linear step and the differences of a nonlinear one.
    result.correction_holds(
        selected == {n for n in names if INTEGRATORS[n].symplectic},
        all((error[n] < 1e-7) == (n in selected) for n in names),
        # Chosen to break it: free fall, where RK4 is exact.
        np.allclose(free_fall_area("rk4"), 1, atol=1e-12),
        # A symmetric matrix has a potential; an antisymmetric one pushes around the centre.
        symplectic(np.array([[2.0, 1.0], [1.0, 3.0]])),
        not symplectic(np.array([[0.0, 1.0], [-1.0, 0.0]])),
        all(sympy.limit(excess[n] / term, h, 0) == 1 for n, term in leading.items()),
    )


@claim(
    "Symplectic integrators conserve the energy of every smooth system.",
    "They conserve area. With a small fixed step the energy error stays bounded for a very long "
    "time and shrinks with the step as its order says. The error is zero only in special cases, "
    "such as the midpoint rule on a spring. For velocity Verlet on a pendulum at {step_ms:g} ms "
    "the relative error is {relative_error:.1e}, early and late in the run.",
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), ch. IX",
)
def symplectic_conserves_energy(result):
    from course.rigid_body import problems

    def error(h: float, steps: int) -> np.ndarray:
        energy = _energies(problems.pendulum(2.0), "velocity_verlet", h, steps)
        return np.abs(energy / energy[0] - 1)

    h = result.input("step_ms", 20.0) / 1000
    coarse, fine = error(h, 500_000), error(h / 2, 1000)
    # The same number of steps early and late: a secular drift would make the late maximum larger.
    early, late = coarse[:5000].max(), coarse[-5000:].max()
    # Halving h must quarter the error of a second-order method.
    power = np.log2(early / fine.max())
    result.measure("relative_error", early, 5e-3)
    result.measure("late_over_early", late / early, 5e-3)
    result.measure("power_of_h", power, 5e-3)
    result.statement = (
        f"The largest error of the first 5000 of 500,000 steps is {early:.1e}, of the "
    )
    result.statement += f"last 5000 {late:.1e}."
    result.statement_holds(early < 1e-9)
    result.correction_holds(abs(late / early - 1) < 0.05, abs(power - 2) < 0.05)


@claim(
    "A symplectic integrator stays good when the step follows the motion.",
    "Choosing the step from the state makes a map that is not symplectic: on a Kepler orbit of "
    "eccentricity {eccentricity} the energy of velocity Verlet drifts by {varying_drift:.4f} in "
    "{orbits:g} orbits (it is -1/2). A step chosen by a rule that reads the same backwards in time "
    "wins the bounded error back: {reversible_drift:.0e}. The method must read so too, as Verlet "
    "does and semi-implicit Euler does not.",
    source="Calvo and Sanz-Serna, The development of variable-step symplectic integrators (1993); "
    "Hairer and Soderlind, Explicit, time reversible, adaptive step size control (2005)",
)
def symplectic_with_varying_step(result):
    from course.rigid_body import semi_implicit_euler, velocity_verlet

    def attraction(q: np.ndarray, v: np.ndarray, params: None) -> np.ndarray:
        return -q / (q[0] * q[0] + q[1] * q[1]) ** 1.5

    def drifts(
        eccentricity: np.ndarray, reversible: bool, anomaly: Any = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the drift of the median energy between the first two orbits and the last four.

        The second array is the swing of the energy within the first two orbits.
        """
        e, pace = eccentricity, 0.1
        # Start on a Kepler orbit with semi-major axis 1, hence the energy -1/2; at the eccentric
        # anomaly 0 it is the pericentre.
        c, s, small = np.cos(anomaly), np.sin(anomaly), np.sqrt(1 - e * e)
        q = np.array([c - e, small * s])
        v = np.array([-s + 0 * e, small * c]) / (1 - e * c)
        rate = (1 - e * c) ** -1.5  # of steps; its time derivative is integrated, half a step ahead
        times: list[Any] = []
        t, energies = 0 * e, []
        while t.min() < 2 * np.pi * orbits:
            r = np.hypot(*q)
            # Integrating controller of Hairer and Soderlind: the step density is advanced in
            # leapfrog with the state, so that the pair is time-reversible.
            change = -1.5 * pace * (q * v).sum(axis=0) / r**2
            rate = rate + (change if times else change / 2) if reversible else r**-1.5
            q, v = velocity_verlet(q, v, attraction, pace / rate, None)
            t = t + pace / rate
            times.append(t)
            energies.append((v * v).sum(axis=0) / 2 - 1 / np.hypot(*q))
        turn, energy = np.array(times) / (2 * np.pi), np.array(energies)
        first, last = turn < 2, (turn > orbits - 4) & (turn < orbits)
        # Medians ignore the short peaks of the energy error at each pericentre.
        drift = [
            np.median(energy[last[:, i], i]) - np.median(energy[first[:, i], i])
            for i in range(e.size)
        ]
        return np.abs(drift), np.array([np.ptp(energy[first[:, i], i]) for i in range(e.size)])

    def there_and_back(method: Callable[..., Any]) -> float:
        """Return how far a step and the step -h end from the start."""
        end = method(*method(*here, attraction, 0.1, None), attraction, -0.1, None)
        return float(np.abs(np.array(end) - here).max())

    here = result.rng.uniform(0.5, 1, (2, 2))
    orbits = result.input("orbits", 60)
    draws = np.append(result.input("eccentricity", 0.5), result.rng.uniform(0.2, 0.7, 11))
    (naive, swing), (reversible, width) = drifts(draws, False), drifts(draws, True)
    # Chosen to break it: starts elsewhere on the orbit, so that the motion to and fro differs, and
    # orbits whose pericentre few steps resolve. Their energy swings widely, but does not drift:
    # after ten times as many orbits it is off by about as much.
    anomalies = np.append(result.rng.uniform(0.5, 5.8, draws.size), [0.0, 0.0, 2.0, 2.0])
    elsewhere, across = drifts(np.append(draws, [0.9, 0.95, 0.9, 0.95]), True, anomalies)

    def bounded(drift: np.ndarray, swing: np.ndarray) -> np.ndarray:
        return drift < 0.2 * swing

    result.measure("varying_drift", naive[0], 0.02)
    result.measure("reversible_drift", reversible[0], 0.5)
    result.statement = (
        f"12 eccentricities: drifts of {naive.min():.1e} to {naive.max():.1e} with the step taken "
        f"from the distance, {reversible.max():.1e} at most with the reversible choice."
    )
    result.statement_holds(
        bounded(naive, swing).all(),
        only_if="the method and the rule for its step are the same backwards in time",
        inside=np.append(bounded(reversible, width), bounded(elsewhere, across)),
        outside=bounded(naive, swing),
    )
    # Time reversibility to rounding for Verlet, a visible defect for semi-implicit Euler.
    result.correction_holds(
        (naive > 10 * reversible).all(),
        there_and_back(velocity_verlet) < 1e-14 < 1e-4 < there_and_back(semi_implicit_euler),
    )


@claim(
    "With a fixed step semi-implicit Euler has no energy drift, for an arm as for a spring.",
    "In joint angles and rates an arm's Coriolis terms depend on the velocity, and so does omega x "
    "(I omega) of a turning body: the step is not symplectic there, and the energy drifts. Of "
    "{runs:g} double pendulums most lose and some gain, by up to {largest_drift_j:.0f} J in "
    "{seconds:g} s; a free tumble gains at every step. Symplectic methods for arms and turning "
    "bodies work with momenta. A contact's spring, which lets go, has no smooth potential: balls "
    "that bounce on one drift by up to {contact_drift_j:.1g} J.",
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. VI.3",
)
def semi_implicit_arm_energy(result):
    from course.rigid_body import problems
    from course.rigid_body.problems import STANDARD_GRAVITY

    def drift(problem: Any, dt: float = 1e-3) -> float:
        """Return between the means over the first and the last tenth.

        So that the swing is not in it.
        """
        energy = _energies(problem, "semi_implicit_euler", dt, round(seconds / dt), 10)
        tenth = len(energy) // 10
        return float(energy[-tenth:].mean() - energy[:tenth].mean())

    seconds, runs = result.input("seconds", 100.0), result.input("runs", 12)
    arm, one = problems.double_pendulum(), problems.pendulum()
    hanging = problems.double_pendulum_energy(np.zeros(2), np.zeros(2), arm.system.params)
    lost = -drift(arm)
    # Angles up to 2.5 rad: at small angles the Coriolis terms vanish and the arm looks like
    # springs.
    starts = result.rng.uniform(-2.5, 2.5, (runs, 2))
    arms = np.array([drift(problems.double_pendulum(tuple(a))) for a in starts])
    # Pendulums have a constant mass matrix and serve as the control group.
    singles = np.array([drift(problems.pendulum(a)) for a in result.rng.uniform(0.2, 2.9, runs)])
    tumble = np.diff(_energies(problems.tumble(), "semi_implicit_euler", 1e-3, 20_000))
    # Chosen to break it: swings that nearly reach the top.
    near_top = [drift(problems.pendulum(np.pi - gap)) for gap in (1e-8, 1e-5, 1e-2)]

    def bouncing(stiffness: float = 1e4, dt: float = 1e-3) -> np.ndarray:
        """Return the drift of balls that bounce for 20 s on a spring that lets go [J]."""
        q = result.rng.uniform(0.2, 2.0, 50)
        v, energies = 0 * q, []
        for _ in range(20_000):
            v = v - dt * (STANDARD_GRAVITY + stiffness * np.minimum(q, 0))
            q = q + dt * v
            energies.append(
                v * v / 2 + STANDARD_GRAVITY * q + stiffness * np.minimum(q, 0) ** 2 / 2
            )
        return np.mean(energies[-2000:], axis=0) - np.mean(energies[:2000], axis=0)

    # Chosen to break it: the force of a contact has a kink, so its potential is not smooth.
    bounced = bouncing()
    # The motion is chaotic: another processor takes another path.
    result.measure("double_pendulum_lost_j", lost, 0.4)
    result.measure("of_energy_above_hanging_j", _energies(arm, "rk4", 1e-3, 1)[0] - hanging, 0.01)
    result.measure("largest_drift_j", np.abs(arms).max(), 0.5)
    result.measure("pendulum_drift", round(drift(one) / _energies(one, "rk4", 1e-3, 1)[0], 4), 1e-4)
    result.measure("contact_drift_j", np.abs(bounced).max(), 0.5)
    result.statement = (
        f"At 1 ms: the double pendulum of the chapter loses {lost:.1f} J, {np.sum(arms < 0)} of "
        f"{runs} with random starts lose and {np.sum(arms > 0)} gain."
    )
    result.statement_holds(
        abs(lost) < 0.1,
        only_if="forces are the slope of a smooth potential of the positions, the mass matrix is "
        "constant and the step is small",
        inside=np.abs(np.append(singles, near_top)) < 0.01,
        outside=np.abs(np.append(arms, bounced)) < 0.01,
    )
    result.correction_holds(lost > 1, (arms < 0).sum() > (arms > 0).sum() > 0, (tumble > 0).all())


@claim(
    "Semi-implicit Euler preserves phase-space area.",
    "With viscous damping its determinant is 1 - 2 zeta omega h per step, an approximation of the "
    "true exp(-2 zeta omega h): {determinant:.3f} instead of {true_contraction:.4f} at omega h = "
    "{omega_h} and zeta = {zeta}. Symplecticity says nothing about systems that dissipate. A force "
    "that pushes several joints around a centre leaves the volume as it is, but not the areas. A "
    "mass matrix that depends on the angles breaks both: one step of {arm_step_ms:g} ms of a "
    "double pendulum can multiply the volume of angles and rates by {arm_determinant:.3f}.",
)
def semi_implicit_keeps_area_always(result):
    import sympy

    from course.derivations.rigid_body.linear import numeric_matrix, step_matrix, symbols
    from course.rigid_body import problems

    h, omega, zeta = symbols()
    damped = sympy.simplify(step_matrix("semi_implicit_euler", damped=True).det())
    at = {h: result.input("omega_h", 0.1), omega: 1, zeta: result.input("zeta", 0.5)}
    result.measure("determinant", damped.subs(at))
    result.measure("true_contraction", sympy.exp(-2 * zeta * omega * h).subs(at))
    result.statement = "Determinants of one step, symbolic and at random omega h and zeta."

    def selected(u: float, damping: float) -> bool:
        return abs(np.linalg.det(numeric_matrix("semi_implicit_euler", u, damping)) - 1) < 1e-12

    def several(stiffness: np.ndarray) -> tuple[bool, float]:
        """Step several joints with a = -stiffness q by 0.1.

        Returns:
            (whether the sum of the areas over all pairs (q, v) stays, determinant of the step).
        """
        n = len(stiffness)
        start = np.eye(2 * n)
        pull = (lambda q, v, matrix: -matrix @ q), stiffness
        q, v = _steps("semi_implicit_euler", pull, start[:n], start[n:], 0.1, 1)
        step, form = np.vstack((q[1], v[1])), np.kron([[0, 1], [-1, 0]], np.eye(n))
        return np.allclose(step.T @ form @ step, form, atol=1e-12), float(np.linalg.det(step))

    # The outside samples have damping ratios below 0.03, which already must break the area.
    draws = result.rng.uniform(0.01, 3, (20, 2))
    # Chosen to break it: three joints. An antisymmetric matrix pushes around a centre.
    forces = result.rng.normal(size=(8, 3, 3))
    around = [several(f - f.T) for f in forces]

    def volume(system: Any, state: np.ndarray, dt: Any) -> float:
        """Return the determinant of one step, from central differences.

        Args:
            system: (acceleration, params).
            state: positions, then as many velocities.
            dt: function that returns the step for positions of shape (n, N).
        """
        n = len(state) // 2
        shift = 1e-6 * np.eye(2 * n)
        s = state[:, None] + np.hstack((shift, -shift))
        q, v = _steps("semi_implicit_euler", system, s[:n], s[n:], dt(s[:n]), 1)
        ends = np.vstack((q[1], v[1]))
        return float(np.linalg.det((ends[:, : 2 * n] - ends[:, 2 * n :]) / 2e-6))

    # Chosen to break it: a double pendulum, whose mass matrix depends on its angles, and a step
    # that depends on the position.
    double = problems.double_pendulum().system
    arm, arm_step = (double.acceleration, double.params), result.input("arm_step_ms", 10.0) / 1000
    shown = volume(arm, np.array([0.5, 1.6, 3.0, -4.0]), lambda q: arm_step)
    states = result.rng.uniform(0.5, 1.5, (6, 4)) * [1, -1, 3, 3]
    arms = [volume(arm, state, lambda q: arm_step) for state in states]
    varied = [volume(_spring(10.0), s[:2], lambda q: 0.05 / (1 + np.abs(q[0]))) for s in states]
    result.measure("arm_determinant", shown, 1e-4)
    result.statement_holds(
        damped == 1,
        only_if="the mass matrix and the step are constant and the forces are the slope of a "
        "potential of the positions",
        inside=[selected(u, 0.0) for u, _ in draws] + [several(f + f.T)[0] for f in forces],
        outside=[selected(u, damping / 100) for u, damping in draws]
        + [x[0] for x in around]
        + [abs(x - 1) < 1e-6 for x in arms + varied],
    )
    result.correction_holds(
        sympy.expand(damped - (1 - 2 * zeta * omega * h)) == 0,
        not any(areas for areas, _ in around),
        all(abs(determinant - 1) < 1e-12 for _, determinant in around),
        abs(shown - 1) > 0.01,
        all(abs(x - 1) > 1e-5 for x in arms + varied),
    )


@claim(
    "RK4 gains energy over time, as every explicit method does.",
    "On an undamped oscillator it loses energy, by the factor {formula} per step, until omega h "
    "passes 2 sqrt(2).",
    ask=(
        "By which factor does RK4 multiply the energy of an undamped oscillator at each step?",
        "factor, E = 1 - (omega*h)^6/72 + (omega*h)^8/576",
        {
            "1 - (omega*h)^6/72": "Yours is the leading term; the exact factor has one more.",
            "1 - (omega*h)^6/144": "Yours is the leading term of the amplitude's factor.",
            "1 + (omega*h)^6/72 - (omega*h)^8/576": "The signs are the other way round.",
        },
    ),
)
def rk4_energy_factor(result):
    import sympy

    from course.rigid_body import problems

    _, h, omega = _matrix("rk4")
    factor = result.formula = sympy.expand(_energy_ratio("rk4")[0, 0])
    amplitude = sympy.series(sympy.sqrt(factor), h, 0, 7).removeO()
    energy = _energies(problems.oscillator(omega=1.0), "rk4", 0.5, 1000, 1000)
    retained = energy[1] / energy[0]
    # The simulation of 1000 steps must reproduce the symbolic factor to the power of 1000.
    at = sympy.lambdify(h, factor.subs(omega, 1))
    result.measure("left_after_1000_at_half", retained)
    result.measure("amplitude_coefficient", amplitude.coeff(h, 6).subs(omega, 1))
    result.statement = f"omega h = 0.5: {retained:.4f} of the energy is left after 1000 steps."
    result.statement_holds(retained > 1)
    result.correction_holds(
        abs(retained / at(0.5) ** 1000 - 1) < 1e-9,
        # 2.828 and 2.829 bracket 2 sqrt(2), where the factor passes 1.
        (at(result.rng.uniform(0.05, 2.828, 100)) < 1).all() and at(2.829) > 1,
    )


@claim(
    "A symplectic integrator follows the oscillator in step.",
    "Energy is bounded, phase is not: semi-implicit Euler and velocity Verlet oscillate at "
    "{formula}, too fast by the share (omega h)^2 / 24 to leading order. At omega h = {omega_h} "
    "that is "
    "{ahead_after_1000_rad:.2f} rad in {angle_rad:g} rad.",
    ask=(
        "At which angular frequency does velocity Verlet oscillate, for omega h < 2?",
        "Omega, w = 2/h*asin(omega*h/2)",
        {
            "omega": "Yours is the true one; the numerical one is higher.",
            "asin(omega*h)/h": "cos(Omega h) = 1 - (omega h)^2 / 2, and half angles come out.",
            "2/h*atan(omega*h/2)": "Yours is the implicit midpoint rule, which lags.",
            "omega*(1+(omega*h)^2/24)": "Yours is the start of the series, not the exact one.",
        },
    ),
)
def verlet_frequency(result):
    import sympy

    from course.rigid_body import problems, simulate

    A, h, omega = _matrix("velocity_verlet")
    result.formula = frequency = 2 / h * sympy.asin(omega * h / 2)
    # A rotation by the angle Omega h has the trace 2 cos(Omega h).
    half_trace = sympy.simplify(A.trace() / 2)
    share = sympy.series(frequency / omega, h, 0, 4).removeO().coeff(h, 2)
    u, angle = result.input("omega_h", 0.1), result.input("angle_rad", 1000.0)
    spring = problems.oscillator(omega=1.0).system
    run = simulate(spring, "velocity_verlet", u, round(angle / u))
    reached = angle * float(frequency.subs({omega: 1, h: u}))
    result.measure("ahead_after_1000_rad", reached - angle, 1e-4)
    result.measure("leading_share", share.subs(omega, 1), 1e-4)
    result.statement = (
        f"{round(angle / u)} steps: {reached - angle:.3f} rad ahead of the true motion."
    )
    result.statement_holds(abs(run.q[-1, 0] - np.cos(angle)) < 1e-3)
    # Released at rest, Verlet follows cos(Omega t) exactly at its steps, so 1e-9 is only rounding.
    result.correction_holds(
        sympy.simplify(sympy.expand_trig(sympy.cos(frequency * h)) - half_trace) == 0,
        sympy.simplify(_matrix("semi_implicit_euler")[0].trace() / 2 - half_trace) == 0,
        abs(run.q[-1, 0] - np.cos(reached)) < 1e-9,
    )
