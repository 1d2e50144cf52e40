"""Claims about the loop, the choice of the step, drift, and differentiable simulation."""

import itertools
from fractions import Fraction

import numpy as np

from course.derivations import Finding, Verdict, claim


@claim(
    "steps_per_picture",
    1,
    "With physics at 1 kHz and pictures at 60 Hz every picture shows a finished physics step.",
    verdict=Verdict.CONDITIONAL,
    condition="the picture rate divides the physics rate",
    corrected="A picture falls due every 16 2/3 steps (33 1/3 at 30 Hz). Without interpolation it "
    "shows a state up to a whole step old, in a pattern of 16 and 17 steps that is seen as "
    "judder.",
    figures={
        "steps_per_picture_60_hz": (16.66667, 1e-6),
        "steps_per_picture_30_hz": (33.33333, 1e-6),
        "fewest": (16, 1e-6),
        "most": (17, 1e-6),
        "oldest_state_ms": (0.6666667, 1e-6),
    },
)
def _steps_per_picture() -> Finding:
    step = Fraction(1, 1000)

    def pattern(rate: int) -> list[int]:
        shown = [(Fraction(i, rate)) // step for i in range(61)]
        return [int(b - a) for a, b in itertools.pairwise(shown)]

    at_60, at_50 = pattern(60), pattern(50)
    oldest = max(Fraction(i, 60) % step for i in range(60))
    return Finding(
        {
            "steps_per_picture_60_hz": float(Fraction(1, 60) / step),
            "steps_per_picture_30_hz": float(Fraction(1, 30) / step),
            "fewest": min(at_60),
            "most": max(at_60),
            "oldest_state_ms": float(1000 * oldest),
        },
        "Counted in exact fractions over a second.",
        holds=len(set(at_60)) == 1,
        holds_if=len(set(at_50)) == 1,
        corrected=set(at_60) == {16, 17} and Fraction(1, 60) / step == Fraction(50, 3),
    )


@claim(
    "clock_by_adding_dt",
    1,
    "Adding dt to the clock at each step keeps the time.",
    verdict=Verdict.FALSE,
    corrected="0.001 is not a binary fraction, and the rounding of each addition stays. The error "
    "is small, grows faster than the number of steps, and is avoided by counting steps.",
    figures={"after_10_s": (1.030287e-13, 1e-2), "after_1_h": (2.746669e-07, 1e-2)},
)
def _clock_by_adding_dt() -> Finding:
    def error(steps: int) -> float:
        return abs(float(np.cumsum(np.full(steps, 1e-3))[-1]) - steps * 1e-3)

    short, long = error(10_000), error(3_600_000)
    return Finding(
        {"after_10_s": short, "after_1_h": long},
        f"At 1 kHz the clock is off by {short:.1e} s after 10 s and by {long:.1e} s after an hour.",
        holds=long == 0.0,
        corrected=long > 360 * short,
    )


@claim(
    "step_sweet_spot",
    1,
    "A step of 10 ms is unstable; 1 to 4 ms is right for rigid robots.",
    verdict=Verdict.CONDITIONAL,
    condition="the fastest undamped oscillation lies between 200 and 500 rad/s",
    corrected="No step is good or bad by itself: the limit is 2 over the fastest angular "
    "frequency. "
    "10 ms is fine for 100 N/m on 1 kg, and 4 ms explodes for 1 MN/m on 1 kg.",
    figures={"limit_100_n_per_m_ms": (200, 1e-6), "limit_1_mn_per_m_ms": (2, 1e-6)},
)
def _step_sweet_spot() -> Finding:
    from course.derivations.rigid_body.linear import spectral_radius

    def stable(stiffness: float, dt: float) -> bool:
        return spectral_radius("semi_implicit_euler", np.sqrt(stiffness) * dt) <= 1 + 1e-9

    window = all(not stable(w**2, 0.010) and stable(w**2, 0.00399) for w in (201.0, 350.0, 500.0))
    return Finding(
        {
            "limit_100_n_per_m_ms": 1000 * 2 / np.sqrt(100),
            "limit_1_mn_per_m_ms": 1000 * 2 / np.sqrt(1e6),
        },
        "Semi-implicit Euler on 1 kg and an undamped spring, by the eigenvalues of its step.",
        holds=not stable(100.0, 0.010) and stable(1e6, 0.004),
        holds_if=window,
        corrected=stable(100.0, 0.010) and not stable(1e6, 0.004),
    )


@claim(
    "tenth_of_the_step",
    1,
    "A tenth of the step costs ten times as much.",
    verdict=Verdict.HOLDS,
    corrected="It takes ten times the evaluations, and the error falls by 10 to the power of the "
    "method's order: by 10 for semi-implicit Euler, by 100 for velocity Verlet.",
    figures={
        "evaluations": (10, 0.02),
        "error_semi_implicit_euler": (10.06802, 0.02),
        "error_velocity_verlet": (100.0001, 0.02),
    },
)
def _tenth_of_the_step() -> Finding:
    from course.rigid_body import integrators, problems

    problem = problems.oscillator()
    gains, calls = {}, []
    for name in ("semi_implicit_euler", "velocity_verlet"):
        errors = []
        for dt in (1e-3, 1e-4):
            steps = round(problem.duration / dt)
            errors.append(
                problem.error(integrators.simulate(problem.system, name, dt, steps).q[-1])
            )
            calls.append(steps * integrators.evaluations_per_step(problem.system, name, dt))
        gains[name] = errors[0] / errors[1]
    ratio = calls[1] / calls[0]
    return Finding(
        {"evaluations": ratio, **{f"error_{n}": g for n, g in gains.items()}},
        "A 1 Hz oscillator over 2.3 s at 1 ms and 0.1 ms: how evaluations grow and errors shrink.",
        holds=abs(ratio - 10) < 1e-9,
        corrected=abs(gains["semi_implicit_euler"] / 10 - 1) < 0.05
        and abs(gains["velocity_verlet"] / 100 - 1) < 0.05,
    )


@claim(
    "halving_dt_finds_the_culprit",
    1,
    "If halving dt cures an explosion, the integrator was explicit Euler.",
    verdict=Verdict.FALSE,
    corrected="Halving cures any method with a limit, semi-implicit Euler among them. What it "
    "never "
    "cures is explicit Euler without damping; from 10 to 5 ms it even explodes faster here.",
    figures={
        "semi_implicit_10_ms": (89.61393, 1e-6),
        "semi_implicit_5_ms": (0, 1e-6),
        "explicit_10_ms": (52.06963, 1e-6),
        "explicit_5_ms": (54.4068, 1e-6),
        "explicit_0_1_ms": (2.170387, 1e-6),
    },
)
def _halving_dt_finds_the_culprit() -> Finding:
    from course.derivations.rigid_body.linear import spectral_radius

    omega = np.sqrt(1e5)

    def growth(name: str, dt: float, seconds: float = 1.0) -> float:
        """Decades of amplitude gained in the time."""
        return float(np.log10(spectral_radius(name, omega * dt)) * seconds / dt)

    before, after = growth("semi_implicit_euler", 0.010), growth("semi_implicit_euler", 0.005)
    explicit = [growth("explicit_euler", dt) for dt in (0.010, 0.005, 0.0001)]
    return Finding(
        {
            "semi_implicit_10_ms": before,
            "semi_implicit_5_ms": round(after, 9) + 0.0,
            "explicit_10_ms": explicit[0],
            "explicit_5_ms": explicit[1],
            "explicit_0_1_ms": explicit[2],
        },
        "Powers of ten by which the amplitude grows in a second; 100 kN/m on 1 kg.",
        holds=before <= 0 and explicit[1] <= 0,
        corrected=before > 1 and abs(after) < 1e-6 and min(explicit) > 1,
    )


def _arm(gravity_compensation: float, timestep: float, integrator: str = "Euler") -> float:
    """How far a two-link arm's shoulder moves in 10 s without commanded torque [rad]."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{timestep}" integrator="{integrator}"/>
        <default><joint axis="0 1 0" damping="2"/></default><worldbody>
        <body gravcomp="{gravity_compensation}"><joint/><geom type="capsule" size=".04"
          fromto="0 0 0 .4 0 0" mass="2"/>
        <body pos=".4 0 0" gravcomp="{gravity_compensation}"><joint/><geom type="capsule" size=".03"
          fromto="0 0 0 .4 0 0" mass="1" contype="0" conaffinity="0"/></body></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, round(10 / timestep))
    return float(abs(data.qpos[0]))


@claim(
    "arm_drift_is_numerical",
    1,
    "An arm whose joints drift without torque suffers from its integrator.",
    verdict=Verdict.FALSE,
    corrected="The usual cause is a force that is not balanced: gravity compensation with a mass a "
    "percent wrong. With an exact balance even a first-order integrator stays where it is. A "
    "drift that does not shrink with the step is not numerical.",
    figures={
        "gravity_off_by_1_percent_rad": (0.4605138, 0.01),
        "at_a_quarter_of_the_step_rad": (0.4605103, 0.01),
    },
)
def _arm_drift_is_numerical() -> Finding:
    balanced, off = _arm(1.0, 0.002), _arm(0.99, 0.002)
    finer = _arm(0.99, 0.0005)
    return Finding(
        {"gravity_off_by_1_percent_rad": off, "at_a_quarter_of_the_step_rad": finer},
        f"A horizontal arm in MuJoCo for 10 s: {balanced:.0e} rad when gravity is balanced, "
        f"{off:.3f} rad when one percent is missing.",
        holds=balanced > 1e-6,
        corrected=balanced < 1e-12 and off > 0.1 and abs(finer / off - 1) < 0.01,
    )


@claim(
    "gradient_search_is_linear",
    1,
    "Gradients turn a search that is exponential in the parameters into one that is linear.",
    verdict=Verdict.CONDITIONAL,
    condition="it starts in the valley of the answer",
    corrected="A grid of k points takes k^n simulations and a gradient method a few iterations. "
    "But "
    "the error of a trajectory has many valleys, and a start two periods off ends in a wrong one.",
    figures={
        "valleys_3_to_7": (6, 1e-3),
        "from_5_1": (5, 1e-3),
        "iterations": (4, 1e-3),
        "from_6_3": (6.416819, 1e-3),
    },
)
def _gradient_search_is_linear() -> Finding:
    t = np.linspace(0.0, 10.0, 200)
    recorded = np.cos(5.0 * t)

    def loss(omega: float) -> float:
        return float(((np.cos(omega * t) - recorded) ** 2).mean())

    def fit(omega: float) -> tuple[float, int]:
        iterations, step = 0, 1.0
        while abs(step) > 1e-10 and iterations < 100:
            gradient = -t * np.sin(omega * t)
            step = gradient @ (np.cos(omega * t) - recorded) / (gradient @ gradient)
            while abs(step) > 1e-12 and loss(omega - step) > loss(omega):
                step *= 0.5
            omega -= step
            iterations += 1
        return float(omega), iterations

    grid = np.linspace(3.0, 7.0, 4001)
    values = np.array([loss(w) for w in grid])
    valleys = int(((values[1:-1] < values[:-2]) & (values[1:-1] < values[2:])).sum())
    (near, count), (far, _) = fit(5.1), fit(6.3)
    return Finding(
        {"valleys_3_to_7": valleys, "from_5_1": near, "iterations": count, "from_6_3": far},
        f"Gauss-Newton finds the frequency 5 rad/s of a recorded oscillation from 5.1 in {count} "
        f"iterations; from 6.3 it stops at {far:.3f}.",
        holds=abs(far - 5) < 1e-6,
        holds_if=abs(near - 5) < 1e-8,
        corrected=valleys > 1 and count < 20,
    )


@claim(
    "gradient_by_differences",
    1,
    "The cost of a gradient grows with the number of parameters.",
    verdict=Verdict.CONDITIONAL,
    condition="it is taken by finite differences or forward differentiation",
    corrected="n parameters take n + 1 simulations by differences. The adjoint (reverse mode) "
    "takes "
    "one run forward and one back for any n, and keeps the states of the forward run.",
    figures={
        "adjoint_runs_40": (2, 1e-6),
        "difference_runs_40": (41, 1e-6),
        "adjoint_runs_80": (2, 1e-6),
        "difference_runs_80": (81, 1e-6),
    },
    source="Griewank and Walther, Evaluating Derivatives (2008), ch. 4",
)
def _gradient_by_differences() -> Finding:
    counts: dict[str, int] = {}
    worst = 0.0
    rng = np.random.default_rng(3)
    n, dt = 40, 0.01
    runs = {"forward": 0}

    def forward(forces: np.ndarray) -> np.ndarray:
        """A pendulum pushed by one force per step; semi-implicit Euler; all angles."""
        runs["forward"] += 1
        q, v, states = 0.3, 0.0, [0.3]
        for f in forces:
            v += dt * (f - 9.81 * np.sin(q))
            q += dt * v
            states.append(q)
        return np.array(states)

    for parameters in (n, 2 * n):
        forces = rng.normal(size=parameters)
        runs["forward"] = 0
        states = forward(forces)
        loss = 0.5 * (states[-1] - 1) ** 2
        gradient, adjoint_q, adjoint_v = np.empty(parameters), states[-1] - 1, 0.0
        for i in range(parameters - 1, -1, -1):
            adjoint_v += dt * adjoint_q
            gradient[i] = dt * adjoint_v
            adjoint_q -= dt * 9.81 * np.cos(states[i]) * adjoint_v
        counts[f"adjoint_runs_{parameters}"] = runs["forward"] + 1  # one forward, one back
        runs["forward"] = 1
        for i in range(parameters):
            moved = forces.copy()
            moved[i] += 1e-6
            difference = (0.5 * (forward(moved)[-1] - 1) ** 2 - loss) / 1e-6
            worst = max(worst, abs(difference - gradient[i]))
        counts[f"difference_runs_{parameters}"] = runs["forward"]
    adjoint_grows = counts[f"adjoint_runs_{2 * n}"] > counts[f"adjoint_runs_{n}"]
    differences_grow = counts[f"difference_runs_{2 * n}"] > counts[f"difference_runs_{n}"]
    return Finding(
        counts,
        f"Runs of a pendulum for the gradient of its last angle; the two agree to {worst:.0e}.",
        holds=adjoint_grows,
        holds_if=differences_grow,
        corrected=worst < 1e-6 and counts[f"difference_runs_{n}"] == n + 1 and not adjoint_grows,
    )


@claim(
    "every_recording_identifies",
    1,
    "A recorded trajectory identifies friction and restitution.",
    verdict=Verdict.CONDITIONAL,
    condition="the body slides and bounces in it",
    corrected="A vertical drop says nothing of friction, a block that sticks says only that "
    "friction "
    "is above a bound: there the gradient is exactly zero.",
    figures={"vertical_drop": (0, 1e-6), "sticking": (0, 1e-6), "sliding_m_per_s": (5.1, 1e-6)},
)
def _every_recording_identifies() -> Finding:
    def landed(vx: float, vy: float, mu: float, e: float) -> np.ndarray:
        """Velocity of a point after one impact with Coulomb friction (impulse ratio <= mu)."""
        impulse = (1 + e) * -vy
        return np.array([vx - np.sign(vx) * min(abs(vx), mu * impulse), -e * vy])

    def by_friction(vx: float, vy: float) -> float:
        up, down = landed(vx, vy, 0.3 + 1e-6, 0.7), landed(vx, vy, 0.3 - 1e-6, 0.7)
        return float(np.abs(up - down).max() / 2e-6)

    drop, sticks, slides = by_friction(0.0, -3.0), by_friction(0.5, -3.0), by_friction(4.0, -3.0)
    return Finding(
        {"vertical_drop": drop, "sticking": sticks, "sliding_m_per_s": slides},
        "Derivative of the velocity after an impact with respect to friction.",
        holds=drop > 0 and sticks > 0,
        holds_if=slides > 1,
        corrected=drop == 0 and sticks == 0,
    )
