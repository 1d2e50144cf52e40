"""Claims about orders, costs and rotations under the integrators."""

import numpy as np

from course.derivations import Finding, Verdict, claim


def _order(problem_name: str, integrator: str, n: int) -> float:
    """Observed order from n and 2 n steps."""
    from course.rigid_body import integrators, problems

    problem = problems.all_problems()[problem_name]
    errors = []
    for steps in (n, 2 * n):
        run = integrators.simulate(problem.system, integrator, problem.duration / steps, steps)
        errors.append(problem.error(run.q[-1]))
    return float(np.log2(errors[0] / errors[1]))


@claim(
    "orders_of_accuracy",
    1,
    "Both Euler methods are of first order, RK4 of fourth.",
    verdict=Verdict.HOLDS,
    corrected="Explicit and semi-implicit Euler 1; velocity Verlet and both midpoint rules 2; "
    "RK4 4, "
    "on a smooth motion.",
    figures={
        "explicit_euler": (1.000085, 0.02),
        "semi_implicit_euler": (0.9999055, 0.02),
        "velocity_verlet": (1.999993, 0.02),
        "explicit_midpoint": (2.046612, 0.02),
        "implicit_midpoint": (2.000003, 0.02),
        "rk4": (4.031742, 0.02),
    },
)
def _orders_of_accuracy() -> Finding:
    from course.rigid_body.integrators import INTEGRATORS

    orders = {
        name: _order("pendulum", name, 20_000 if item.order == 1 else 1500)
        for name, item in INTEGRATORS.items()
        if name != "rk4_renormalised"
    }
    right = {n: abs(o - INTEGRATORS[n].order) < 0.1 for n, o in orders.items()}
    return Finding(
        orders,
        "Observed on a pendulum with a swing of 2.5 rad, against the elliptic closed form.",
        holds=right["explicit_euler"] and right["semi_implicit_euler"] and right["rk4"],
        corrected=all(right.values()),
    )


@claim(
    "evaluations_per_step",
    1,
    "RK4 needs four force evaluations per step, Euler one.",
    verdict=Verdict.HOLDS,
    corrected="Euler 1, velocity Verlet 2 (1 where the last one is kept for the next step), "
    "explicit "
    "midpoint 2, RK4 4; the implicit midpoint rule iterates, so its count depends on the problem.",
    figures={
        "explicit_euler": (1, 0.05),
        "semi_implicit_euler": (1, 0.05),
        "velocity_verlet": (2, 0.05),
        "explicit_midpoint": (2, 0.05),
        "implicit_midpoint": (4.8, 0.05),
        "rk4": (4, 0.05),
    },
)
def _evaluations_per_step() -> Finding:
    from course.rigid_body import integrators, problems

    system = problems.pendulum().system
    counts = {
        name: integrators.evaluations_per_step(system, name, 0.01)
        for name in integrators.INTEGRATORS
        if name != "rk4_renormalised"
    }
    return Finding(
        counts,
        "Counted on a pendulum at 10 ms.",
        holds=counts["rk4"] == 4 and counts["explicit_euler"] == counts["semi_implicit_euler"] == 1,
        corrected=counts["velocity_verlet"] == counts["explicit_midpoint"] == 2
        and counts["implicit_midpoint"] > 2,
    )


@claim(
    "rk4_costs_four_times",
    1,
    "RK4 costs four times as much as Euler.",
    verdict=Verdict.CONDITIONAL,
    condition="both take the same step",
    corrected="At the same accuracy it is far cheaper on a smooth motion: for an error of 1e-6 it "
    "needs thousands of times fewer force evaluations than semi-implicit Euler.",
    figures={
        "semi_implicit_euler": (6872031, 0.05),
        "velocity_verlet": (10936, 0.05),
        "rk4": (1068, 0.05),
        "euler_over_rk4": (6434.486, 0.05),
    },
)
def _rk4_costs_four_times() -> Finding:
    from course.rigid_body import integrators, problems

    problem, tolerance = problems.oscillator(), 1e-6

    def evaluations(name: str, order: int, cost: int, n: int) -> float:
        for _ in range(2):  # the error is a power of n: two corrections find the target
            run = integrators.simulate(problem.system, name, problem.duration / n, n)
            n = max(4, round(n * (problem.error(run.q[-1]) / tolerance) ** (1 / order)))
        return float(n * cost)

    euler = evaluations("semi_implicit_euler", 1, 1, 50_000)
    verlet = evaluations("velocity_verlet", 2, 1, 4000)
    rk4 = evaluations("rk4", 4, 4, 400)
    return Finding(
        {"semi_implicit_euler": euler, "velocity_verlet": verlet, "rk4": rk4,
         "euler_over_rk4": euler / rk4},
        "Force evaluations to follow a 1 Hz oscillator for 2.3 s to 1e-6 m (Verlet keeps its "
        "last).",
        holds=abs(rk4 / euler - 4) < 1,
        holds_if=integrators.evaluations_per_step(problem.system, "rk4", 0.01) == 4,
        corrected=euler / rk4 > 1000,
    )  # fmt: skip


@claim(
    "semi_implicit_stability_per_cost",
    1,
    "Nothing beats the stability of semi-implicit Euler per force evaluation.",
    verdict=Verdict.CONDITIONAL,
    condition="only explicit methods on undamped oscillations are compared",
    corrected="Among explicit ones its omega h = 2 per evaluation is the most, and velocity Verlet "
    "ties it with one order more. The implicit midpoint rule has no limit at all.",
    figures={
        "explicit_euler": (0, 1e-6),
        "semi_implicit_euler": (2.0, 1e-6),
        "velocity_verlet": (2, 1e-6),
        "explicit_midpoint": (0, 1e-6),
        "rk4": (0.7071068, 1e-6),
        "implicit_midpoint_radius_at_100": (1, 1e-6),
    },
    source="Chawla, On the order and attainable intervals of periodicity of explicit Nystrom "
    "methods (1985)",
)
def _semi_implicit_stability_per_cost() -> Finding:
    from course.derivations.rigid_body.linear import measured_limit, spectral_radius

    cost = {"explicit_euler": 1, "semi_implicit_euler": 1, "velocity_verlet": 1,
            "explicit_midpoint": 2, "rk4": 4}  # fmt: skip
    # A method that grows at omega h = 0.05 already has no limit but zero.
    limits = {
        n: measured_limit(n) / c if spectral_radius(n, 0.05) <= 1 + 1e-10 else 0.0
        for n, c in cost.items()
    }
    implicit = max(spectral_radius("implicit_midpoint", x) for x in (1.0, 10.0, 100.0))
    best = max(limits.values())
    return Finding(
        {**limits, "implicit_midpoint_radius_at_100": round(implicit, 9)},
        "omega h at the limit over evaluations per step (Verlet keeps its last evaluation).",
        holds=implicit > 1 + 1e-6,
        holds_if=abs(limits["semi_implicit_euler"] - best) < 1e-6,
        corrected=abs(limits["velocity_verlet"] - best) < 1e-6 and implicit < 1 + 1e-6,
    )


@claim(
    "semi_implicit_is_verlet",
    1,
    "Semi-implicit Euler is only of first order, so velocity Verlet is a better method.",
    verdict=Verdict.CONDITIONAL,
    condition="it is started with the velocity at the same time as the position",
    corrected="Started with the velocity half a step earlier it visits the very positions of "
    "velocity Verlet, and so has second order at no cost.",
    figures={"order_plain": (0.9990512, 0.02), "order_staggered": (1.999983, 0.02)},
    source="Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), sec. I.3",
)
def _semi_implicit_is_verlet() -> Finding:
    from course.rigid_body import integrators, problems

    problem = problems.pendulum()
    system = problem.system

    def run(n: int, staggered: bool) -> tuple[float, float]:
        """(error at the end, largest distance from Verlet's positions)"""
        dt = problem.duration / n
        q, v = system.q0, system.v0
        if staggered:
            v = v - 0.5 * dt * system.acceleration(q, v, system.params)
        qv, vv = system.q0, system.v0
        gap = 0.0
        for _ in range(n):
            q, v = integrators.semi_implicit_euler(q, v, system.acceleration, dt, system.params)
            qv, vv = integrators.velocity_verlet(qv, vv, system.acceleration, dt, system.params)
            gap = max(gap, float(abs(q - qv)[0]))
        return problem.error(q), gap

    plain = np.log2(run(2000, False)[0] / run(4000, False)[0])
    (coarse, gap), (fine, _) = run(1000, True), run(2000, True)
    staggered = float(np.log2(coarse / fine))
    return Finding(
        {"order_plain": float(plain), "order_staggered": staggered},
        f"On a pendulum the staggered start follows Verlet's positions to {gap:.0e} rad.",
        holds=gap > 1e-9,
        holds_if=abs(plain - 1) < 0.1,
        corrected=gap < 1e-11 and abs(staggered - 2) < 0.1,
    )


@claim(
    "rotation_stages_add",
    1,
    "RK4 for rotations may average the stages' angular velocities like vectors.",
    verdict=Verdict.FALSE,
    corrected="Each stage's velocity lives in the frame of its own orientation. Added as they are, "
    "the order drops from 4 to 2; brought to one frame by the inverse differential of exp "
    "(Munthe-Kaas) it is 4.",
    figures={"order_added": (2.000034, 0.02), "order_munthe_kaas": (4.006995, 0.02)},
    source="Munthe-Kaas, High order Runge-Kutta methods on manifolds (1999)",
)
def _rotation_stages_add() -> Finding:
    from course.rigid_body import integrators, problems

    problem = problems.tumble(duration=2.0)
    acceleration, params = problem.system.acceleration, problem.system.params

    def added(q, v, acceleration, dt, params):
        half = 0.5 * dt
        a1 = acceleration(q, v, params)
        v2 = v + half * a1
        a2 = acceleration(q, v2, params)  # free rotation: the orientation does not enter
        v3 = v + half * a2
        a3 = acceleration(q, v3, params)
        v4 = v + dt * a3
        a4 = acceleration(q, v4, params)
        mean = (v + 2 * (v2 + v3) + v4) / 6
        return integrators.retract(q, dt * mean), v + dt / 6 * (a1 + 2 * (a2 + a3) + a4)

    def order(step: integrators.Step) -> float:
        errors = []
        for n in (200, 400):
            q, v = problem.system.q0, problem.system.v0
            for _ in range(n):
                q, v = step(q, v, acceleration, problem.duration / n, params)
            errors.append(problem.error(q))
        return float(np.log2(errors[0] / errors[1]))

    naive, proper = order(added), order(integrators.rk4)
    return Finding(
        {"order_added": naive, "order_munthe_kaas": proper},
        "Observed on the tumble of a body with moments 1:2:3 against Jacobi's closed form.",
        holds=naive > 3.5,
        corrected=abs(naive - 2) < 0.1 and abs(proper - 4) < 0.1,
    )


@claim(
    "renormalised_rk4_order",
    1,
    "RK4 on the four numbers of a quaternion, scaled back to length one, loses its order.",
    verdict=Verdict.FALSE,
    corrected="It keeps order 4. What it loses is the steady spin, which the exponential map does "
    "exactly and it does not.",
    figures={"order": (4.026979, 0.05), "steady_spin_error_rad": (8.303591e-05, 0.05)},
)
def _renormalised_rk4_order() -> Finding:
    from course.rigid_body import integrators, problems, quaternion

    order = _order("tumble", "rk4_renormalised", 2000)
    spin = integrators.System(
        "spin", problems.tumble_acceleration, np.ones(3), quaternion.identity(),
        np.array([0.0, 0.0, 10.0]),
    )  # fmt: skip
    truth = quaternion.exp(np.array([0.0, 0.0, 100.0]))
    error = {}
    for name in ("rk4", "rk4_renormalised"):
        run = integrators.simulate(spin, name, 0.02, 500)
        error[name] = float(quaternion.angle_between(truth, run.q[-1]))
    return Finding(
        {"order": order, "steady_spin_error_rad": error["rk4_renormalised"]},
        f"10 rad/s at 20 ms for 10 s: {error['rk4_renormalised']:.1e} rad off, the exponential "
        f"map {error['rk4']:.0e} rad.",
        holds=order < 3.5,
        corrected=abs(order - 4) < 0.15 and error["rk4"] < 1e-11 < error["rk4_renormalised"],
    )
