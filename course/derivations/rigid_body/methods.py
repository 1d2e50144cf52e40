"""Claims about orders, costs and rotations under the integrators."""

from dataclasses import replace

import numpy as np

from course.derivations import claim


def _order(problem, integrator, steps):
    """Return observed order of an integrator (a name, or a step) from `steps` and twice as many."""
    from course.rigid_body.integrators import simulate

    errors = [
        problem.error(simulate(problem.system, integrator, problem.duration / n, n).q[-1])
        for n in (steps, 2 * steps)
    ]
    # Observed order: the binary logarithm of the error ratio for half the step.
    return float(np.log2(errors[0] / errors[1]))


def _evaluations(problem, name, tolerance, steps):
    """Force evaluations to follow a problem to a tolerance, by the order.

    From the error at `steps` steps; velocity Verlet keeps its last evaluation for the next step.
    """
    from course.rigid_body.integrators import INTEGRATORS, evaluations_per_step, simulate

    run = simulate(problem.system, name, problem.duration / steps, steps)
    needed = steps * (problem.error(run.q[-1]) / tolerance) ** (1 / INTEGRATORS[name].order)
    cost = evaluations_per_step(problem.system, name, problem.duration / steps)
    return max(4, round(needed)) * (1 if name == "velocity_verlet" else cost)


@claim(
    "On a smooth motion, both Euler methods are of first order, RK4 of fourth.",
    "Explicit and semi-implicit Euler 1; velocity Verlet and both midpoint rules 2; RK4 4.",
)
def orders_of_accuracy(result):
    from course.rigid_body import integrators, problems

    right = {}
    for name, item in integrators.INTEGRATORS.items():
        if name != "rk4_renormalised":
            steps = 20_000 if item.order == 1 else 1500
            order = _order(problems.pendulum(), name, steps)
            result.measure(name, order, tolerance=0.02)
            # A second amplitude and step, so that the order is no coincidence of one run.
            other = _order(problems.pendulum(1.5), name, steps // 5)
            right[name] = max(abs(order - item.order), abs(other - item.order)) < 0.1
    result.statement = (
        "Observed on a pendulum with a swing of 2.5 rad (and 1.5), against the elliptic closed "
        "form."
    )
    result.statement_holds(
        right["explicit_euler"] and right["semi_implicit_euler"] and right["rk4"]
    )
    result.correction_holds(*right.values())


@claim(
    "RK4 needs four force evaluations per step, Euler one.",
    "Euler 1, velocity Verlet 2 (1 where the last one is kept for the next step), explicit "
    "midpoint 2, RK4 4; the implicit midpoint rule iterates, so its count depends on the problem "
    "and the step: {implicit_midpoint:.1f} here.",
)
def evaluations_per_step(result):
    from course.rigid_body import integrators, problems

    system = problems.pendulum().system
    counts = {}
    for name in integrators.INTEGRATORS:
        if name != "rk4_renormalised":
            counts[name] = integrators.evaluations_per_step(system, name, 0.01)
            result.measure(name, counts[name], tolerance=0.05)
    finer = integrators.evaluations_per_step(system, "implicit_midpoint", 0.001)
    result.statement = "Counted on a pendulum at 10 ms."
    result.statement_holds(counts["rk4"] == 4 and counts["explicit_euler"] == 1)
    result.correction_holds(
        counts["semi_implicit_euler"] == 1,
        counts["velocity_verlet"] == counts["explicit_midpoint"] == 2,
        counts["implicit_midpoint"] > finer > 2,
    )


@claim(
    "RK4 costs four times as much as Euler.",
    "Where a smooth motion is wanted to a small error it is far cheaper: for 1 part in a million "
    "it needs {euler_over_rk4:.0f} times fewer force evaluations than semi-implicit Euler.",
)
def rk4_costs_four_times(result):
    from course.rigid_body import integrators, problems

    problem = problems.oscillator()

    def ratio(tolerance):
        """Return evaluations of RK4 over those of semi-implicit Euler for the same error."""
        euler = _evaluations(problem, "semi_implicit_euler", tolerance, 50_000)
        return _evaluations(problem, "rk4", tolerance, 400) / euler

    def same_step(dt, system=problem.system):
        rk4, euler = (
            integrators.evaluations_per_step(system, name, dt)
            for name in ("rk4", "semi_implicit_euler")
        )
        return abs(rk4 / euler - 4) < 0.01

    # Chosen to break it: forces that are not linear, and bodies that turn.
    others = (problems.pendulum(), problems.double_pendulum(), problems.tumble())

    for name, steps in (("semi_implicit_euler", 50_000), ("velocity_verlet", 4000), ("rk4", 400)):
        result.measure(name, _evaluations(problem, name, 1e-6, steps), tolerance=0.05)
    result.measure("euler_over_rk4", 1 / ratio(1e-6), tolerance=0.05)
    result.statement = (
        "Force evaluations to follow a 1 Hz oscillator of 1 m for 2.3 s to 1e-6 m (Verlet keeps "
        "its last)."
    )
    result.statement_holds(
        abs(ratio(1e-6) - 4) < 1,
        only_if="both take the same step",
        inside=[same_step(dt) for dt in 10 ** result.rng.uniform(-4, -1, 12)]
        + [same_step(dt, other.system) for dt in (1e-3, 0.1) for other in others],
        outside=[abs(ratio(t) - 4) < 1 for t in 10 ** result.rng.uniform(-7, -3, 12)],
    )
    result.correction_holds(ratio(1e-6) < 1e-3)


@claim(
    "Nothing beats the stability of semi-implicit Euler per force evaluation.",
    "Among explicit ones without damping its omega h = 2 per evaluation is the most, and velocity "
    "Verlet ties it with one order more. The implicit midpoint rule has no limit at all, and "
    "neither has an exponential integrator, which is explicit but has to know the frequency. With "
    "a damping ratio above 1 / sqrt(3) even explicit Euler allows a larger step.",
    source="Chawla, On the order and attainable intervals of periodicity of explicit Nystrom "
    "methods (1985)",
)
def semi_implicit_stability_per_cost(result):
    from scipy.linalg import expm

    from course.derivations.rigid_body.linear import measured_limit, spectral_radius

    cost = {
        "explicit_euler": 1,
        "semi_implicit_euler": 1,
        "velocity_verlet": 1,
        "explicit_midpoint": 2,
        "rk4": 4,
    }
    limits = {}
    for name, evaluations in cost.items():
        # A method that grows at omega h = 0.05 already has no limit but zero.
        stable = spectral_radius(name, 0.05) <= 1 + 1e-10
        limits[name] = result.measure(name, measured_limit(name) / evaluations if stable else 0.0)
    implicit = max(spectral_radius("implicit_midpoint", x) for x in (1.0, 10.0, 100.0))
    result.measure("implicit_midpoint_radius_at_100", round(implicit, 9))

    def beaten(evaluations, alike=4.0):
        """Return whether a random explicit splitting is stable beyond omega h = 2 per force."""
        # Random compositions of kicks and drifts: all explicit splittings of this kind.
        kicks, drifts = result.rng.dirichlet(np.full(evaluations, alike), size=2)
        radii = []
        for x in np.linspace(0.05, 2.02, 400) * evaluations:
            A = np.eye(2)
            for kick, drift in zip(kicks, drifts, strict=True):
                A = np.array([[1, drift * x], [0, 1]]) @ np.array([[1, 0], [-kick * x, 1]]) @ A
            radii.append(np.abs(np.linalg.eigvals(A)).max())
        return np.max(radii) <= 1 + 1e-9

    def damped_best(zeta):
        semi, explicit = (
            measured_limit(name, zeta, low=1e-3)
            for name in ("semi_implicit_euler", "explicit_euler")
        )
        return semi >= explicit

    def exponential(x):
        """Return the growth per step of the method that uses the exact turn of the spring."""
        return np.abs(np.linalg.eigvals(expm(np.array([[0.0, x], [-x, 0.0]])))).max()

    def coriolis(rate, x=0.05):
        """Return whether RK4 grows, or semi-implicit Euler does not, at x per evaluation.

        The oscillator is a Foucault pendulum on a table that turns at rate, with omega = 1.
        """
        still, one = np.zeros((2, 2)), np.eye(2)
        turn = 2 * rate * np.array([[0.0, 1.0], [-1.0, 0.0]])
        kick = np.block([[one, still], [-x * one, one + x * turn]])
        euler = np.block([[one, x * one], [still, one]]) @ kick
        A = 4 * x * np.block([[still, one], [-one, turn]])
        rk4 = np.eye(4) + A @ (np.eye(4) + A / 2 @ (np.eye(4) + A / 3 @ (np.eye(4) + A / 4)))
        radii = [np.abs(np.linalg.eigvals(step)).max() for step in (euler, rk4)]
        return radii[0] <= 1 + 1e-10 or radii[1] > 1 + 1e-10

    best = max(limits.values())
    result.statement = (
        "omega h at the limit over evaluations per step (Verlet keeps its last evaluation); "
        "random splittings into 2 and 3 kicks, and damping ratios, were tried too."
    )
    result.statement_holds(
        implicit > 1 + 1e-6,
        only_if="explicit methods that use nothing but the forces are compared, on undamped "
        "oscillations, and the forces depend on positions alone",
        inside=[not beaten(n) for n in (2, 3) * 6]
        # Chosen to break it: weights so nearly equal that the splitting almost ties.
        + [not beaten(n, 1e4) for n in (2, 3, 4) * 2],
        outside=[damped_best(z) for z in result.rng.uniform(0.3, 0.9, 12)]
        # Chosen to break it: the exponential of the linear part is explicit, too.
        + [exponential(x) > 1 + 1e-9 for x in (3.0, 30.0, 300.0)]
        # Chosen to break it: Coriolis and gyroscopic forces do not damp, but need the velocity.
        + [coriolis(rate) for rate in result.rng.uniform(0.05, 0.5, 8)],
    )
    result.correction_holds(
        abs(limits["semi_implicit_euler"] - best) < 1e-6,
        abs(limits["velocity_verlet"] - best) < 1e-6,
        implicit < 1 + 1e-6,
        damped_best(0.99 / np.sqrt(3)) and not damped_best(1.01 / np.sqrt(3)),
    )


@claim(
    "Semi-implicit Euler is only of first order, so velocity Verlet is a better method.",
    "Where forces depend on positions alone: started with the velocity half a step earlier it "
    "visits the very positions of velocity Verlet, and so has second order at no cost. Where no "
    "force acts at the start, as in the middle of a swing, it does so without that shift.",
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. I.3",
)
def semi_implicit_is_verlet(result):
    from scipy.linalg import expm

    from course.rigid_body import problems
    from course.rigid_body.integrators import simulate

    def run(amplitude, n, staggered):
        """Return the error at the end and the largest distance from Verlet's positions."""
        problem = problems.pendulum(amplitude)
        system, dt = problem.system, problem.duration / n
        # Half a kick back: the velocities of the leapfrog lie between the positions.
        before = 0.5 * dt * system.acceleration(system.q0, system.v0, system.params)
        start = replace(system, v0=system.v0 - before) if staggered else system
        path = simulate(start, "semi_implicit_euler", dt, n, every=1).q
        verlet = simulate(system, "velocity_verlet", dt, n, every=1).q
        return problem.error(path[-1]), float(np.abs(path - verlet).max())

    def order(amplitude, n, staggered):
        return np.log2(run(amplitude, n, staggered)[0] / run(amplitude, 2 * n, staggered)[0])

    plain, half_kick = order(2.5, 2000, False), order(2.5, 1000, True)
    result.measure("order_plain", plain, tolerance=0.02)
    result.measure("order_staggered", half_kick, tolerance=0.02)
    amplitudes = result.rng.uniform(0.3, 2.9, 10)
    gaps = [run(a, 1000, True)[1] for a in amplitudes]

    def from_the_bottom(speed):
        """Return the largest distance from Verlet's positions, started where no force acts."""
        system = problems.pendulum().system
        start = replace(system, q0=0 * system.q0, v0=system.v0 + speed)
        ours, theirs = (
            simulate(start, name, 2e-3, 1000, every=1).q
            for name in ("semi_implicit_euler", "velocity_verlet")
        )
        return float(np.abs(ours - theirs).max())

    # Chosen to break it: velocity and position start together, and half a kick is nothing.
    unforced = [from_the_bottom(speed) for speed in result.rng.uniform(0.5, 6, 8)]

    def order_with_damper(damping):
        """Return the order of Verlet with the damper's force from the velocity at half a step."""
        exact = (expm(2 * np.array([[0.0, 1.0], [-1.0, -damping]])) @ [1.0, 0.0])[0]
        errors = []
        for n in (200, 400):
            x, v, dt = 1.0, 0.0, 2 / n
            force = -x - damping * v
            for _ in range(n):
                half = v + dt / 2 * force
                x = x + dt * half
                force = -x - damping * half
                v = half + dt / 2 * force
            errors.append(abs(x - exact))
        return np.log2(errors[0] / errors[1])

    # Chosen to break it: with a damper Verlet, as most programs have it, is of first order, too.
    result.statement = (
        f"On a pendulum with ten random swings the staggered start follows Verlet's positions to "
        f"{max(gaps):.0e} rad."
    )
    result.statement_holds(
        min(gaps) > 1e-9,
        only_if="forces depend on positions alone, it is started with the velocity at the same "
        "time as the position, and a force acts at the start",
        inside=[run(a, 1000, False)[1] > 1e-4 for a in amplitudes],
        outside=[gap > 1e-9 for gap in gaps + unforced]
        + [order_with_damper(x) > 1.5 for x in result.rng.uniform(0.2, 1, 4)],
    )
    result.correction_holds(
        max(gaps) < 1e-11,
        max(unforced) < 1e-11,
        abs(plain - 1) < 0.1,
        abs(half_kick - 2) < 0.1,
    )


@claim(
    "RK4 for rotations may average the stages' angular velocities like vectors.",
    "Each stage's velocity lives in the frame of its own orientation. Added as they are, the order "
    "drops from 4 to 2; brought to one frame by the inverse differential of exp (Munthe-Kaas) it "
    "is 4.",
    source="Munthe-Kaas, High order Runge-Kutta methods on manifolds (1999)",
)
def rotation_stages_add(result):
    from course.rigid_body import integrators, problems

    def added(q, v, acceleration, dt, params):
        half = 0.5 * dt
        a1 = acceleration(q, v, params)
        v2 = v + half * a1
        a2 = acceleration(q, v2, params)  # free rotation: the orientation does not enter
        v3 = v + half * a2
        a3 = acceleration(q, v3, params)
        v4 = v + dt * a3
        a4 = acceleration(q, v4, params)
        # Body rates of four different frames, averaged as if they were of one.
        mean = (v + 2 * (v2 + v3) + v4) / 6
        return integrators.retract(q, dt * mean), v + dt / 6 * (a1 + 2 * (a2 + a3) + a4)

    problem = problems.tumble(duration=2.0)
    naive = result.measure("order_added", _order(problem, added, 200), tolerance=0.02)
    proper = result.measure("order_munthe_kaas", _order(problem, "rk4", 200), tolerance=0.02)
    other = _order(problems.tumble((2.0, 2.5, 4.0), (0.7, 2.2), 2.0), added, 200)
    result.statement = (
        "Observed on the tumble of a body with moments 1:2:3 against Jacobi's closed form."
    )
    result.statement_holds(naive > 3.5)
    result.correction_holds(abs(naive - 2) < 0.1, abs(other - 2) < 0.1, abs(proper - 4) < 0.1)


@claim(
    "RK4 on the four numbers of a quaternion, scaled back to length one, loses its order.",
    "It keeps order 4. What it loses is the steady spin, which the exponential map does exactly "
    "and it does not.",
)
def renormalised_rk4_order(result):
    from course.rigid_body import integrators, problems, quaternion

    order = _order(problems.tumble(), "rk4_renormalised", 2000)
    result.measure("order", order, tolerance=0.05)
    spin = integrators.System(
        "spin",
        problems.tumble_acceleration,
        np.ones(3),
        quaternion.identity(),
        np.array([0.0, 0.0, 10.0]),
    )
    # A steady spin: the exponential map is exact, whatever the step.
    truth = quaternion.exp(np.array([0.0, 0.0, 100.0]))
    exact, scaled = (
        quaternion.angle_between(truth, integrators.simulate(spin, name, 0.02, 500).q[-1])
        for name in ("rk4", "rk4_renormalised")
    )
    result.measure("steady_spin_error_rad", scaled, tolerance=0.05)
    result.statement = (
        f"10 rad/s at 20 ms for 10 s: {scaled:.1e} rad off, the exponential map {exact:.0e} rad."
    )
    result.statement_holds(order < 3.5)
    result.correction_holds(abs(order - 4) < 0.15, exact < 1e-11 < scaled)
