"""Claims about the loop, the choice of the step, drift, and differentiable simulation."""

import itertools
from fractions import Fraction
from typing import Any

import numpy as np

from course.derivations import claim


def _pictures(physics_hz, picture_hz):
    """Return a second of the loop.

    For each picture (steps done, share of a step since the newest).
    """
    from course.rigid_body.loop import FixedStepLoop, Phases

    shown = []
    phases = Phases(
        integrate=lambda state, force, dt: state + 1,
        interpolate=lambda before, newest, alpha: shown.append((newest, alpha)),
        render=lambda state, time: None,
    )
    # Exact fractions, so that no rounding decides whether a picture falls on a step.
    physics, picture = Fraction(1, physics_hz), Fraction(1, picture_hz)
    FixedStepLoop(
        0,
        phases,
        physics,
        control_period=physics,
        camera_period=physics,
        render_period=picture,
        max_frame=None,
    ).advance(1.0)
    return shown


@claim(
    "With physics at 1 kHz and pictures at 60 Hz every picture falls on a physics step.",
    "A picture falls due every {steps_per_picture_60_hz:.2f} steps ({steps_per_picture_30_hz:.2f} "
    "at {slow_hz:.0f} Hz). Without interpolation it shows a state up to {oldest_state_ms:.2f} ms "
    "old, in a pattern of {fewest:.0f} and {most:.0f} steps that is seen as judder.",
    source="Fiedler, Fix Your Timestep! (2004)",
)
def steps_per_picture(result):
    def finished(physics_hz, picture_hz):
        return max(share for _, share in _pictures(physics_hz, picture_hz)) == 0

    def between(physics_hz, picture_hz):
        """Return whether every second picture at twice the rate, from the first, is on a step."""
        return max(share for _, share in _pictures(physics_hz, 2 * picture_hz)[::2]) == 0

    slow = result.input("slow_hz", 30)
    at_60, at_slow = _pictures(1000, 60), _pictures(1000, slow)
    steps = [after[0] - before[0] for before, after in itertools.pairwise(at_60)]
    result.measure("steps_per_picture_60_hz", at_60[-1][0] / len(at_60))
    result.measure("steps_per_picture_30_hz", 1000 / len(at_slow))
    result.measure("fewest", min(steps))
    result.measure("most", max(steps))
    result.measure("oldest_state_ms", max(share for _, share in at_60))
    result.statement = "Counted over a second of the course's loop, whose time is exact."
    physics = result.rng.integers(200, 900, 10)

    def summed(picture_hz):
        """Return whether pictures at 1 kHz are equally many steps apart if times are summed."""
        time, due = (np.cumsum(np.full(n, 1 / hz)) for n, hz in ((20_000, 1000), (900, picture_hz)))
        return np.ptp(np.diff(np.searchsorted(time, due))) == 0

    result.statement_holds(
        finished(1000, 60),
        only_if="the picture rate divides the physics rate, the first picture falls on a step, and "
        "both are counted in whole steps of one clock",
        inside=[
            finished(int(n * rate), int(rate))
            for n, rate in zip(
                result.rng.integers(2, 15, 10), result.rng.integers(20, 60, 10), strict=True
            )
        ],
        # rate // 7 - 1 lies strictly between an eighth and a seventh of the rate, so it never
        # divides it.
        outside=[finished(int(rate), int(rate) // 7 - 1) for rate in physics]
        # Chosen to break it: rates that divide, but pictures that start half a period off.
        + [between(odd * rate, rate) for odd, rate in ((3, 40), (5, 50), (17, 60))]
        # Chosen to break it: both times are sums of floating-point periods.
        + [summed(rate) for rate in (50, 100, 125)],
    )
    result.correction_holds(set(steps) == {16, 17}, len(at_60) == 60, at_60[2][0] == 50)


@claim(
    "The cameras are read in the same step as the encoders.",
    "A camera runs on a clock of its own: in a second of physics at {physics_hz:.0f} Hz this loop "
    "reads the encoders {encoder_readings:.0f} times and takes {images:.0f} images. With "
    "{delay_ms:.0f} ms from exposure to arrival the image that control sees is {mean_age_ms:.0f} "
    "ms old on average and {oldest_ms:.0f} ms at the worst, while the encoders are of this step.",
    source="Isaac Sim 6.0 documentation (2026), Multi-Tick Rendering: a rate for each sensor, "
    "where before every camera rendered at the frame rate; MuJoCo 4.0 documentation (2026), "
    "Modeling, Sensors: interval and delay",
)
def cameras_in_every_step(result):
    from course.rigid_body.loop import FixedStepLoop, Phases

    physics = result.input("physics_hz", 1000)
    delay = result.input("delay_ms", 20)

    def ages(camera_hz, delay_ms):
        """Return the ages of what each control tick after the first sees, and the images.

        Ages are (encoders, image) [ms].
        """
        observed = []

        def control(measured, image, time):
            if image is not None:
                # Age at the control tick: time now less the time of the measurement or exposure.
                observed.append((1000 * (time - measured), 1000 * (time - image.time)))

        phases = Phases(
            integrate=lambda state, force, dt: state,
            sense=lambda state, time: time,
            control=control,
        )
        loop = FixedStepLoop(
            0.0,
            phases,
            Fraction(1, physics),
            control_period=Fraction(1, physics),
            camera_period=Fraction(1, camera_hz),
            camera_delay=Fraction(delay_ms, 1000),
            max_frame=None,
        )
        done = loop.advance(1.0)
        return np.array(observed), done

    observed, done = ages(30, delay)
    result.measure("encoder_readings", done.controls)
    result.measure("images", done.images)
    result.measure("mean_age_ms", observed[:, 1].mean(), tolerance=1e-3)
    result.measure("oldest_ms", observed[:, 1].max())
    result.statement = "Run through the course's loop with a camera at 30 Hz."

    def alike(camera_hz, delay_ms):
        aged, _ = ages(int(camera_hz), int(delay_ms))
        return np.abs(aged[:, 0] - aged[:, 1]).max() < 1e-9

    result.statement_holds(
        # Each camera breaks one part of the condition: its rate, its delay, or both.
        any(alike(hz, ms) for hz, ms in ((30, delay), (30, 0), (60, 5), (1000, 5)))
    )
    result.correction_holds(
        done.images < done.controls / 20,
        observed[:, 0].max() == 0.0,
        observed[:, 1].min() > delay - 1e-6,
        alike(physics, 0),
    )


@claim(
    "Adding dt to the clock at each step keeps the time.",
    "{dt_s:g} is not such a number, and the rounding of each addition stays: the clock is "
    "off by {after_10_s:.1e} s after ten seconds and by {after_1_h:.1e} s after an hour. The error "
    "is small, grows faster than the number of steps, and is avoided by counting steps.",
)
def clock_by_adding_dt(result):
    from course.rigid_body.loop import float_clock_error

    dt = result.input("dt_s", 1e-3)
    short = result.measure("after_10_s", abs(float_clock_error(dt, 10_000)), tolerance=1e-2)
    long = result.measure("after_1_h", abs(float_clock_error(dt, 3_600_000)), tolerance=1e-2)
    result.statement = (
        f"At 1 kHz the clock is off by {short:.1e} s after 10 s and by {long:.1e} s after an hour."
    )
    # Multiples of 1/1024 s are exact in binary, multiples of 1/1000 s are not.
    periods = result.rng.choice(np.arange(3, 999), 10, replace=False)

    def late(start, n, steps=1000):
        """Return how wrong a clock is that starts at `start` and adds n/1024 s a step [s]."""
        reading = float(np.cumsum(np.append(start, np.full(steps, n / 1024)))[-1])
        # A sequential sum, as a loop computes it; np.sum would add pairwise and hide the rounding.
        return (reading - start) - steps * n / 1024

    result.statement_holds(
        long == 0.0,
        only_if="dt is a multiple of a short binary fraction of a second, such as 1/1024, and the "
        "clock stays below 2^53 of these fractions",
        inside=[float_clock_error(n / 1024, 50_000) == 0.0 for n in periods]
        + [late(2.0**42, n) == 0.0 for n in periods],
        outside=[float_clock_error(n / 1000, 50_000) == 0.0 for n in periods]
        # Chosen to break it: a clock that starts far away, where doubles are wider apart than dt.
        + [late(2.0**44, n) == 0.0 for n in 2 * periods + 1],
    )
    result.correction_holds(long > 360 * short)


@claim(
    "A step of 10 ms is unstable; 1 to 4 ms is right for rigid robots.",
    "No step is good or bad by itself: without damping, semi-implicit Euler's limit is 2 over the "
    "fastest angular frequency. It is "
    "{limit_100_n_per_m_ms:.0f} ms for {soft_n_per_m:.0f} N/m on {mass_kg:.0f} kg and "
    "{limit_1_mn_per_m_ms:.0f} ms for {stiff_n_per_m:.0f} N/m. Nor is a stable step accurate: at "
    "{near_step_ms:g} ms an oscillation of {near_rad_per_s:.0f} rad/s swings to {near_swing:.1f} "
    "times its start.",
)
def step_sweet_spot(result):
    from course.derivations.rigid_body.linear import measured_limit, spectral_radius
    from course.rigid_body import simulate
    from course.rigid_body.problems import oscillator

    mass = result.input("mass_kg", 1.0)
    soft, stiff = result.input("soft_n_per_m", 1e2), result.input("stiff_n_per_m", 1e6)
    omega_h = measured_limit("semi_implicit_euler")

    def stable(omega, dt, zeta=0.0):
        return spectral_radius("semi_implicit_euler", omega * dt, zeta) <= 1 + 1e-9

    def right(omega, zeta=0.0):
        fine = all(stable(omega, dt, zeta) for dt in (1e-3, 2e-3, 4e-3))
        return fine and not stable(omega, 0.010, zeta)

    result.measure("limit_100_n_per_m_ms", 1000 * omega_h / np.sqrt(soft / mass))
    result.measure("limit_1_mn_per_m_ms", 1000 * omega_h / np.sqrt(stiff / mass))
    slow = result.measure("slowest_rad_per_s", omega_h / 0.010)
    fast = result.measure("fastest_rad_per_s", omega_h / 0.004)
    result.statement = (
        "Semi-implicit Euler on 1 kg and an undamped spring, by the eigenvalues of its step."
    )

    # Chosen to break it: a step that is stable, but near the limit.
    near, step = result.input("near_rad_per_s", 490.0), result.input("near_step_ms", 4.0) / 1000
    run = simulate(oscillator(near).system, "semi_implicit_euler", step, 2000, every=1)
    swing = result.measure("near_swing", np.abs(run.q / run.q[0]).max(), 1e-3)
    # Within 10 % outside both ends of the range.
    beside = [*result.rng.uniform(0.9 * slow, slow, 6), *result.rng.uniform(fast, 1.1 * fast, 6)]
    result.statement_holds(
        right(np.sqrt(soft / mass)) and right(np.sqrt(stiff / mass)),
        only_if="right only means stable, the integrator is semi-implicit Euler, nothing damps, "
        "and the fastest oscillation lies between {slowest_rad_per_s:.0f} and "
        "{fastest_rad_per_s:.0f} rad/s",
        inside=[right(w) for w in result.rng.uniform(slow, fast, 12)],
        outside=[right(w) for w in beside]
        # Chosen to break it: damping from the old velocity lowers the limit.
        + [right(w, result.rng.uniform(0.3, 0.9)) for w in np.linspace(0.85, 0.99, 6) * fast],
    )
    result.correction_holds(
        stable(np.sqrt(soft / mass), 0.010),
        not stable(np.sqrt(stiff / mass), 0.004),
        not any(right(w) for w in beside),
        right(near) and swing > 2,
    )


@claim(
    "A deformable body needs a step of 0.1 ms.",
    "The limit of an explicit step is a share of the time that sound takes through one element: "
    "{limit_10_kpa_ms:.1f} ms for foam of {foam_kpa:.0f} kPa in elements of {spacing_cm:.0f} cm, "
    "{limit_100_mpa_ms:.3f} ms for plastic of {plastic_mpa:.0f} MPa, half of it for elements half "
    "as long. MuJoCo's discrete integrator takes elasticity implicitly and is stable at any step "
    "tried, up to {largest_discrete_ms:.0f} ms.",
    source="MuJoCo 4.0 documentation (2026), Modeling, Deformable objects: Euler needs steps below "
    "a millisecond, 1 to 4 ms are typical with discrete",
)
def deformables_need_a_tenth(result):
    import mujoco

    foam, plastic = 1e3 * result.input("foam_kpa", 10), 1e6 * result.input("plastic_mpa", 100)
    spacing = 1e-2 * result.input("spacing_cm", 5)

    def stable(young, dt, integrator="Euler", length=spacing):
        """Return whether a free block of 2 x 2 x 2 cells stays where it is for 300 steps."""
        # MuJoCo warns of an elastic block that nothing else holds together.
        mujoco.set_mju_user_warning(lambda text: None)
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{dt}" integrator="{integrator}" gravity="0 0 0">'
            '<flag autoreset="disable" contact="disable"/></option><worldbody>'
            f'<flexcomp name="block" type="grid" dim="3" count="3 3 3" radius="1e-3" '
            f'spacing="{length} {length} {length}" mass="{1000 * (2 * length) ** 3}">'
            f'<elasticity young="{young}" poisson="0.3"/><contact selfcollide="none"/>'
            "</flexcomp></worldbody></mujoco>"
        )
        mujoco.set_mju_user_warning(None)
        data = mujoco.MjData(model)
        # A perturbation that excites all modes, so that the stiffest one can grow.
        data.qpos[:] = np.random.default_rng(0).normal(size=model.nq) * 1e-5
        for _ in range(300):
            if np.abs(data.qpos).max() < 1e-2:  # far from what MuJoCo would complain about
                mujoco.mj_step(model, data)
        return np.abs(data.qpos).max() < 1e-2

    def limit(young, length=spacing):
        # Speed of sound sqrt(E / rho) with 1000 kg/m^3: the CFL time brackets the limit.
        high = 4 * length / np.sqrt(young / 1000)  # four times what sound takes along an edge
        low = high / 100
        while high / low > 1.01:
            # Bisection in the logarithm, as the limit may lie anywhere in two decades.
            middle = np.sqrt(low * high)
            low, high = (middle, high) if stable(young, middle, length=length) else (low, middle)
        return low

    soft, stiff = limit(foam), limit(plastic)
    result.measure("limit_10_kpa_ms", 1000 * soft, tolerance=0.03)
    result.measure("limit_100_mpa_ms", 1000 * stiff, tolerance=0.03)
    half_as_long = limit(plastic, spacing / 2) / stiff
    result.measure("half_as_long", half_as_long, tolerance=0.03)
    steps = np.array([1e-3, 1e-2, 1e-1])
    free = [stable(young, dt, "discrete") for young in (foam, plastic) for dt in steps]
    result.measure("largest_discrete_ms", 1000 * steps[np.flatnonzero(free[:3])[-1]])
    result.statement = (
        f"MuJoCo's Euler on an elastic block, by bisection: {1e3 * soft:.2f} and {1e3 * stiff:.3f} "
        "ms, as the root of the stiffness says."
    )
    result.statement_holds(soft < 2e-4 and 5e-5 < stiff)
    result.correction_holds(
        soft > 1e-3 and stiff < 1e-4,
        # The limit falls with the root of the stiffness, independent of the shape of the elements.
        abs(soft / stiff / np.sqrt(plastic / foam) - 1) < 0.05,
        abs(half_as_long - 0.5) < 0.02,
        all(free),
    )


@claim(
    "A tenth of the step costs ten times as much.",
    "An explicit method then takes ten times the evaluations, and the error falls by ten to the "
    "power of the method's order: {error_semi_implicit_euler:.0f} times for semi-implicit Euler, "
    "{error_velocity_verlet:.0f} times for velocity Verlet. Whether it is more than needed is for "
    "the tolerance to say: with a step of {dt_ms:.0f} ms semi-implicit Euler is off by "
    "{off_at_1_ms_mm:.2g} mm here.",
)
def tenth_of_the_step(result):
    from course.rigid_body import integrators, problems

    problem = problems.oscillator()
    dt = result.input("dt_ms", 1) / 1000

    def error(name, dt):
        steps = round(problem.duration / dt)
        return problem.error(integrators.simulate(problem.system, name, dt, steps).q[-1])

    def ten_times(name, dt, system=problem.system):
        coarse, fine = (integrators.evaluations_per_step(system, name, h) for h in (dt, dt / 10))
        return abs(fine / coarse - 1) < 1e-9

    # The implicit midpoint rule iterates, so its number of evaluations depends on the step.
    explicit = [n for n in integrators.INTEGRATORS if n != "implicit_midpoint"]
    coarse, fine = (
        integrators.evaluations_per_step(problem.system, "semi_implicit_euler", step) / step
        for step in (dt, dt / 10)
    )
    result.measure("evaluations", fine / coarse, tolerance=0.02)
    semi, verlet = (
        result.measure(f"error_{name}", error(name, dt) / error(name, dt / 10), tolerance=0.02)
        for name in ("semi_implicit_euler", "velocity_verlet")
    )
    result.measure("off_at_1_ms_mm", 1000 * error("semi_implicit_euler", dt), tolerance=0.01)
    result.statement = (
        "A 1 Hz oscillator over 2.3 s at 1 ms and 0.1 ms: how evaluations grow and errors shrink. "
        "The implicit midpoint rule needs fewer corrections at the finer step."
    )
    steps = 10 ** result.rng.uniform(-3, -1, 10)
    result.statement_holds(
        all(ten_times("implicit_midpoint", dt) for dt in steps),
        only_if="the method is explicit",
        inside=[ten_times(explicit[i % len(explicit)], dt) for i, dt in enumerate(steps)]
        # Chosen to break it: forces that are not linear, and bodies that turn.
        + [
            ten_times(name, 0.02, other.system)
            for name in ("explicit_euler", "velocity_verlet", "rk4")
            for other in (problems.pendulum(), problems.double_pendulum(), problems.tumble())
        ],
        outside=[ten_times("implicit_midpoint", dt) for dt in steps],
    )
    result.correction_holds(
        abs(fine / coarse - 10) < 1e-9,
        abs(semi / 10 - 1) < 0.05,
        abs(verlet / 100 - 1) < 0.05,
    )


@claim(
    "If halving dt cures an explosion, the integrator was explicit Euler.",
    "Halving, often enough, cures any method with a limit, semi-implicit Euler among them. What "
    "it never cures is "
    "explicit Euler without damping; from ten to {half_ms:.0f} ms it even explodes faster here.",
)
def halving_dt_finds_the_culprit(result):
    from course.derivations.rigid_body.linear import spectral_radius

    half = result.input("half_ms", 5)
    omega = np.sqrt(1e5)

    def growth(name, ms):
        """Return decades of amplitude gained in a second."""
        # Per second and not per step, or the smaller step would look better for having less time.
        return np.log10(spectral_radius(name, omega * ms / 1000)) * 1000 / ms

    before = result.measure("semi_implicit_10_ms", growth("semi_implicit_euler", 10))
    after = result.measure(
        "semi_implicit_5_ms", round(growth("semi_implicit_euler", half), 9) + 0.0
    )
    slow = result.measure("explicit_10_ms", growth("explicit_euler", 10))
    fast = result.measure("explicit_5_ms", growth("explicit_euler", half))
    result.measure("explicit_0_1_ms", growth("explicit_euler", 0.1))
    result.statement = (
        "Powers of ten by which the amplitude grows in a second; 100 kN/m on 1 kg. Explicit Euler "
        "grew at each of 50 random steps, too."
    )
    result.statement_holds(before <= 0 and fast <= 0)
    result.correction_holds(
        before > 1 and abs(after) < 1e-6,
        fast > slow,
        min(growth("explicit_euler", ms) for ms in 10 ** result.rng.uniform(-3, 2, 50)) > 0,
        # With damping explicit Euler has a limit, 2 zeta / omega, and halving does cure it.
        spectral_radius("explicit_euler", 0.5, 0.3)
        <= 1
        < spectral_radius("explicit_euler", 1, 0.3),
    )


@claim(
    "An arm whose joints drift without torque suffers from its integrator.",
    "A common cause is a force that is not balanced: with gravity compensated for "
    "{compensated:.2f} of the mass this arm sinks by {gravity_off_by_1_percent_rad:.2f} rad, at a "
    "quarter of the step as much. With an exact balance even a first-order integrator stays where "
    "it is. A drift that does not shrink with the step is not the integrator's.",
)
def arm_drift_is_numerical(result):
    import mujoco

    compensated = result.input("compensated", 0.99)

    def drift(share, timestep):
        """Return how far a two-link arm's shoulder moves in 10 s without commanded torque [rad]."""
        model = mujoco.MjModel.from_xml_string(
            f"""<mujoco><option timestep="{timestep}"/>
            <default><joint axis="0 1 0" damping="2"/></default><worldbody>
            <body gravcomp="{share}"><joint/><geom type="capsule" size=".04"
              fromto="0 0 0 .4 0 0" mass="2"/>
            <body pos=".4 0 0" gravcomp="{share}"><joint/><geom type="capsule" size=".03"
              fromto="0 0 0 .4 0 0" mass="1" contype="0" conaffinity="0"/></body></body>
            </worldbody></mujoco>"""
        )
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, round(10 / timestep))
        return abs(data.qpos[0])

    # The control: with an exact balance the same integrator at the same step must not move.
    balanced, deviation = drift(1.0, 0.002), drift(compensated, 0.002)
    finer = drift(compensated, 0.0005)
    result.measure("gravity_off_by_1_percent_rad", deviation, tolerance=0.01)
    result.measure("at_a_quarter_of_the_step_rad", finer, tolerance=0.01)
    result.statement = (
        f"A horizontal arm in MuJoCo for 10 s: {balanced:.0e} rad when gravity is balanced, "
        f"{deviation:.3f} rad when one percent is missing."
    )
    result.statement_holds(balanced > 1e-6)
    result.correction_holds(balanced < 1e-12, deviation > 0.1, abs(finer / deviation - 1) < 0.01)


@claim(
    "Gradients turn a search that is exponential in the parameters into one that is linear.",
    "A grid of k points takes k^n simulations and a gradient method a few iterations, here "
    "{iterations:.0f}. But the error of a trajectory has many valleys, {valleys_3_to_7:.0f} "
    "between {from_rad_per_s:.0f} and {to_rad_per_s:.0f} rad/s, and a start two periods off ends "
    "in a wrong one.",
)
def gradient_search_is_linear(result):
    from course.rigid_body import problems

    t: Any = np.linspace(0.0, 10.0, 200)

    def motion(omega):
        return problems.oscillator(omega=omega).truth(t)[0][0]

    recorded = motion(5.0)

    def loss(omega):
        return ((motion(omega) - recorded) ** 2).mean()

    def fit(omega):
        """Return Gauss-Newton with a line search; the derivative by central differences."""
        iterations, step = 0, 1.0
        while abs(step) > 1e-9 and iterations < 100:
            gradient = (motion(omega + 1e-5) - motion(omega - 1e-5)) / 2e-5
            # Gauss-Newton step for one parameter.
            step = gradient @ (motion(omega) - recorded) / (gradient @ gradient)
            # Backtracking: halve the step until the loss no longer rises.
            while abs(step) > 1e-11 and loss(omega - step) > loss(omega):
                step *= 0.5
            omega -= step
            iterations += 1
        return omega, iterations

    ends = result.input("from_rad_per_s", 3.0), result.input("to_rad_per_s", 7.0)
    grid = np.linspace(*ends, 4001)
    values = np.array([loss(w) for w in grid])
    valleys = (values[1:-1] < values[:-2]) & (values[1:-1] < values[2:])
    # The maxima of the loss beside the true frequency bound its valley.
    tops = grid[1:-1][(values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])]
    low = result.measure("valley_from_rad_per_s", tops[tops < 5].max(), tolerance=1e-3)
    high = result.measure("valley_to_rad_per_s", tops[tops > 5].min(), tolerance=1e-3)
    (near, count), (far, _) = fit(5.1), fit(6.3)
    result.measure("valleys_3_to_7", valleys.sum())
    result.measure("from_5_1", near, tolerance=1e-3)
    result.measure("iterations", count)
    result.measure("from_6_3", far, tolerance=1e-3)
    result.statement = (
        f"Gauss-Newton finds the frequency 5 rad/s of a recorded oscillation from 5.1 in {count} "
        f"iterations; from 6.3 it stops at {far:.3f}."
    )
    result.statement_holds(
        abs(far - 5) < 1e-6,
        only_if="it starts in the valley of the answer, here between {valley_from_rad_per_s:.2f} "
        "and {valley_to_rad_per_s:.2f} rad/s",
        inside=[abs(fit(w)[0] - 5) < 1e-6 for w in result.rng.uniform(low, high, 10)]
        # Chosen to break it: starts at the edge, where a long first step could leave the valley.
        + [abs(fit(w)[0] - 5) < 1e-6 for gap in (0.003, 0.03) for w in (low + gap, high - gap)],
        outside=[abs(fit(w)[0] - 5) < 1e-6 for w in (low - 0.1, high + 0.1) * 4],
    )
    result.correction_holds(valleys.sum() > 1, count < 20, abs(far - 5) > 1)


@claim(
    "The cost of a gradient grows with the number of parameters.",
    "n parameters take n + 1 simulations by differences. The adjoint (reverse mode) takes one run "
    "forward and one back for any n: {adjoint_work_8:.1f} times the operations of a run for "
    "{few:.0f} parameters, {adjoint_work_16:.1f} times for twice as many. It keeps the states of "
    "the forward run.",
    source="Griewank and Walther, Evaluating Derivatives (2008), ch. 4",
)
def gradient_by_differences(result):
    import torch
    from torch.autograd import forward_ad
    from torch.utils._python_dispatch import TorchDispatchMode

    from course.rigid_body import differentiable

    class Counted(TorchDispatchMode):
        """Counts the operations on tensors."""

        done = 0

        def __torch_dispatch__(self, function, types, args=(), kwargs=None):
            self.done += 1
            return function(*args, **(kwargs or {}))

    def end(forces):
        """Return where a block ends that is pushed by one force after the other, 20 ms each [m]."""
        push = tuple((0.02 * i, 0.02 * (i + 1), force) for i, force in enumerate(forces))
        scene = differentiable.Setup((0.0, 0.0), (5.0, 0.0), push)
        parameters = torch.tensor([0.5, 0.1, 1.0], dtype=torch.float64)
        return differentiable.trajectory(parameters, scene, [0.02 * len(forces)])[0, -1]

    def gradients(n):
        """Work of a run, and of a gradient by each method over it; how far they are apart."""
        start = torch.tensor(result.rng.uniform(1.0, 3.0, n))
        work = {}
        with Counted() as counted:
            here = end(start)
        work["run"] = counted.done
        with Counted() as counted:
            leaf = start.clone().requires_grad_()
            (adjoint,) = torch.autograd.grad(end(leaf), leaf)
        work["adjoint"] = counted.done
        with Counted() as counted:
            moved = [end(start + 1e-6 * row) for row in torch.eye(n, dtype=torch.float64)]
        # n perturbed runs and the reference run.
        work["differences"] = counted.done + work["run"]
        with Counted() as counted, forward_ad.dual_level():
            for row in torch.eye(n, dtype=torch.float64):
                # Forward mode: one run with dual numbers for each parameter.
                forward_ad.unpack_dual(end(forward_ad.make_dual(start, row)))
        work["forward"] = counted.done
        # Check of the adjoint: one-sided differences with 1e-6 agree with it to about that size.
        gap = np.abs((np.array([float(x - here) for x in moved]) / 1e-6) - adjoint.numpy()).max()
        return {k: v / work["run"] for k, v in work.items()}, gap

    few = result.input("few", 8)
    (small, gap), (large, _) = gradients(few), gradients(2 * few)
    for name, work in (("8", small), ("16", large)):
        result.measure(f"adjoint_work_{name}", work["adjoint"], tolerance=0.2)
        result.measure(f"difference_runs_{name}", round(work["differences"]), tolerance=0.1)
    result.statement = (
        "Operations on tensors for the gradient of a pushed block's last position by its forces, "
        f"over those of one run; adjoint and differences agree to {gap:.0e}."
    )

    def grows(method):
        return large[method] > 1.5 * small[method]

    result.statement_holds(
        grows("adjoint"),
        only_if="it is taken by finite differences or forward differentiation",
        inside=[grows("differences"), grows("forward")],
        outside=[grows("adjoint")],
        cases=True,
    )
    result.correction_holds(
        gap < 1e-6,
        abs(small["differences"] / (few + 1) - 1) < 0.1,
        abs(large["adjoint"] / small["adjoint"] - 1) < 0.1,
    )


@claim(
    "A recorded trajectory identifies friction and restitution.",
    "A drop without spin or slip says nothing of friction, and a block that sticks says only that "
    "friction is above a bound: there the gradient is exactly zero. A tilted box that drops "
    "straight down does tell it, as its corner slides when it hits.",
)
def every_recording_identifies(result):
    from course.rigid_body import differentiable, planar, problems

    times = np.linspace(0.0, 2.0, 60)

    def by_friction(velocity):
        """Return the derivative of the velocity after an impact by friction's coefficient."""
        scene = differentiable.Setup((0.0, 0.0), velocity)
        return np.abs(differentiable.jacobian((0.7, 0.3, 1.0), scene, [0.1])[2:, 0, 1]).max()

    def report(share, low=0.2, high=1.5):
        """Return whether a thrown block shows both, its slip a share of what the impact stops."""
        e, friction, height = result.rng.uniform((0.3, 0.05, low), (0.9, 0.8, high))
        # Coulomb's bound mu (1 + e) v_n on the slip that an impact can stop; a share above 1
        # slides.
        stopped = friction * (1 + e) * np.sqrt(2 * problems.STANDARD_GRAVITY * height)
        scene = differentiable.Setup((0.0, height), (share * stopped, 0.0))
        return all(differentiable.information((e, friction, 1.0), scene, times).identified[:2])

    def dropped(angle, friction):
        """Return the angle of a box 0.6 s after it was dropped without speed [rad]."""
        state = np.array([0.0, 0.6, angle, 0.0, 0.0, 0.0])[:, None]
        return planar.advance_boxes(state, planar.box_parameters(friction=friction), 1e-3, 600)[0][
            2, 0
        ]

    def shows(angle):
        # Central difference with respect to friction.
        return abs(dropped(angle, 0.3 + 1e-5) - dropped(angle, 0.3 - 1e-5)) / 2e-5

    def rod(tilt, share, e=0.6):
        """Return whether each friction changes a rod's impact in its own way.

        The end of the rod slides in at 1 m/s down. The impact stops the slip and reverses it.

        Args:
            tilt: of the rod [rad].
            share: slip at the start, by the one that a frictionless impact just stops.
            e: restitution.
        """
        # Velocity of the end per impulse (tangent, normal): mass 1 kg, length 1 m, inertia 1 / 12.
        arm = np.array([np.sin(tilt), np.cos(tilt)]) / 2
        (tangent, coupling), (_, normal) = np.eye(2) + 12 * np.outer(arm, arm)
        slip = share * coupling * (1 + e) / normal
        # Less friction than what would hold the end once it has stopped.
        friction = np.linspace(0.0, 0.99 * coupling / tangent, 100)
        until_stop = slip / (coupling + friction * tangent)
        # Newton's rule: the normal velocity changes by 1 + e in all.
        total = (1 + e - 2 * coupling * friction * until_stop) / (normal - coupling * friction)
        # Forward until the slip stops, backward after it.
        change = np.diff(friction * (2 * until_stop - total))
        return bool(np.all(change > 0) or np.all(change < 0))

    # Chosen to break it: slip that reverses, where two frictions may give the same impact.
    drop = result.measure("vertical_drop", by_friction((0.0, -3.0)))
    sticking = result.measure("sticking", by_friction((0.5, -3.0)))
    result.measure("sliding_m_per_s", by_friction((4.0, -3.0)))
    tilted = result.measure("tilted_drop_rad", shows(0.3), tolerance=0.01)
    result.statement = (
        "Derivatives by the coefficient of friction: of the velocity after an impact, and of the "
        f"angle of a box dropped at 0.3 rad, {tilted:.1f} rad."
    )
    result.statement_holds(
        drop > 0 and sticking > 0,
        only_if="the body bounces during the recording, and its point of contact slides in one "
        "direction until the impact ends",
        inside=[report(share) for share in result.rng.uniform(1.02, 2.0, 10)],
        # Below a share of 1 the point slides at first, too, and sticks before the impact ends.
        outside=[report(share) for share in result.rng.uniform(0.5, 0.98, 10)]
        # Chosen to break it: an impact that comes after the last sample.
        + [report(share, 20.0, 30.0) for share in result.rng.uniform(1.02, 2.0, 3)]
        + [rod(*x) for x in result.rng.uniform((0.8, 0.55), (1.1, 0.9), (8, 2))],
    )
    # Exactly zero: where nothing slides, the coefficient is not in the computation's result.
    result.correction_holds(drop == 0.0, sticking == 0.0, shows(0.0) == 0.0, tilted > 1.0)


@claim(
    "Smooth gradients through a contact come from randomised smoothing, as in the engine Dojo.",
    "They need no random draw. Dojo relaxes the complementarity of gap and force and "
    "differentiates the solver's answer by the implicit function theorem. That theorem, applied to "
    "the time of an impact, gives d height / d start = {implicit:.4f} in one run, the "
    "true one. Smoothing averages many perturbed runs and needs no derivative of the engine: "
    "{runs:.0f} runs leave a standard error of {smoothed_error:.2f}, which falls with the root of "
    "their number. "
    "Differentiating a drop with its bounce at the end of a step line by line gives {naive:.0f} "
    "instead of {truth:.2f} at any step.",
    source="Howell et al., Dojo: A Differentiable Physics Engine for Robotics (2022), abstract "
    "and the section on gradients; Suh, Pang, Tedrake, Bundled Gradients through Contact via "
    "Randomized Smoothing (2022)",
)
def smooth_gradients_by_draws(result):
    from course.rigid_body import differentiable, problems

    height, e, duration, g = 1.0, 0.6, 0.8, problems.STANDARD_GRAVITY
    runs = result.input("runs", 800)

    def bounced(h):
        """Return the height after the first bounce, in closed form [m]."""
        fall = np.sqrt(2 * h / g)
        return e * g * fall * (duration - fall) - g * (duration - fall) ** 2 / 2

    # Closed form, differentiated by central differences.
    truth = result.measure("truth", (bounced(height + 1e-6) - bounced(height - 1e-6)) / 2e-6)
    implicit = differentiable.drop_gradients(height, e, duration).by_height
    naive = np.array(
        [
            differentiable.naive_drop_gradients(height, e, dt, duration).by_height
            for dt in 10 ** result.rng.uniform(-3, -1.5, 8)
        ]
    )
    spread = 0.1  # standard deviation of the start [m]

    def slope(moved):
        """Return the difference of two perturbed fixed-step runs, weighted by the score."""
        up, down = (
            differentiable.naive_drop(height + x, e, 2e-3, duration) for x in (moved, -moved)
        )
        # Score-function estimator for Gaussian perturbations, with antithetic pairs.
        return (up - down) * moved / (2 * spread**2)

    slopes = [slope(x) for x in spread * result.rng.normal(size=runs // 2)]
    error = result.measure("smoothed_error", np.std(slopes) / np.sqrt(len(slopes)), tolerance=0.1)
    result.measure("implicit", implicit)
    result.measure("naive", np.abs(naive).max())
    result.statement = (
        f"d height / d start after a bounce is {truth:.4f}; through the event {implicit:.4f}, "
        f"smoothed {np.mean(slopes):.2f} +- {error:.2f}, line by line {naive.max():.0f}."
    )
    result.statement_holds(abs(implicit - truth) > 1e-6)
    result.correction_holds(
        abs(implicit - truth) < 1e-6,
        np.abs(naive - truth).min() > 0.5,
        # Four standard errors of the mean, and these must be small enough to tell 1 from the truth.
        abs(np.mean(slopes) - truth) < 4 * error < 0.3,
    )
