"""Claims of chapter 6: laws that follow a motion, and what a wrong model leaves."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "r": Symbol("true over modelled inertia, I/I^", 1.1, 2.0),
    "p": Symbol("both poles at -p [1/s]"),
    "w": Symbol("angular frequency of the motion [rad/s]"),
}


@claim(
    "With an exact model and exact measurements, and without delay, hold or torque limit, "
    "tau = M(q) (q_d'' + Kd e' + Kp e) + C(q, q') q' + g(q) makes the error obey "
    "e'' + Kd e' + Kp e = 0.",
    "C and g are those of the measured state, and the gains stand inside M. A hold makes it true "
    "only at the instant of the measurement. If the PD terms are added outside M, an error of one "
    "joint also accelerates the others: by {outside:.0%} of its own acceleration, in the "
    "median of some random arms.",
)
def computed_torque_law(result):
    from course.control import computed_torque, pd
    from course.kinematics import forward_dynamics, random_chain

    inside, outside = [], []
    for _ in range(12):
        arm = random_chain(int(result.rng.integers(2, 7)), result.rng)
        q, v, q_ref, v_ref, a_ref = result.rng.normal(size=(5, arm.n))
        tau = computed_torque(arm, q, v, q_ref, v_ref, a_ref, 100.0, 20.0)
        requested = a_ref + 20 * (v_ref - v) + 100 * (q_ref - q)
        # Forward dynamics of the same arm under the law: the acceleration must be the requested
        # one.
        deviation = forward_dynamics(arm, q, v, tau) - requested
        inside.append(np.abs(deviation).max() / np.abs(requested).max())
        deviation = q + np.eye(arm.n)[0]  # an error of the first joint alone
        # Gains outside of M: feedforward plus a plain PD torque.
        tau = computed_torque(arm, q, v, deviation, v, a_ref, 0.0, 0.0) + pd(
            q, v, deviation, v, 100.0, 20.0
        )
        a = forward_dynamics(arm, q, v, tau) - a_ref
        outside.append(np.abs(a[1:]).max() / np.abs(a[0]))
    result.measure("outside", np.median(outside), 1e-6)
    result.statement = "Accelerations of twelve drawn arms under the law, against those asked for."
    result.statement_holds(max(inside) < 1e-9)
    result.correction_holds(np.median(outside) > 0.1)


@claim(
    "With a perfect model, a sampled computed torque controller tracks without error.",
    "The hold leaves an error, as a held command is right only at the beginning of its sample: "
    "{plain:.1e} rad at {rate:.0f} Hz on the chapter's motion, of first order in dt. "
    "With model and reference evaluated half a sample ahead, {ahead:.1e} rad are left, of "
    "second order in dt.",
)
def perfect_model_perfect_tracking(result):
    from course.charts.control import tracking

    law = tracking.LAWS
    rate = result.input("rate", 1000)

    def errors(name, **how):
        return [
            tracking.error(law[name](tracking.ARM, dt), dt, **how) for dt in (4 / rate, 2 / rate)
        ]

    draws = [{"size": s, "speed": w} for s, w in result.rng.uniform([0.3, 0.5], [1.3, 1.5], (8, 2))]
    plain, ahead = (
        np.array([errors(name, **how) for how in draws])
        for name in ("computed torque", "half-sample preview")
    )
    for name, key in (("plain", "computed torque"), ("ahead", "half-sample preview")):
        result.measure(name, tracking.error(law[key](tracking.ARM, 1 / rate), 1 / rate), 1e-3)
    result.statement = "Largest error at the samples, at two sample times and eight drawn motions."
    result.statement_holds(np.max(plain) < 1e-6)
    # Observed order from two sample times, for eight motions.
    orders = [np.log2(x[:, 0] / x[:, 1]) for x in (plain, ahead)]
    result.correction_holds(
        np.abs(orders[0] - 1).max() < 0.1,
        np.abs(orders[1] - 2).max() < 0.2,
        (ahead < plain / 20).all(),
    )


@claim(
    "If the inertia in the model is too small, the error of computed torque follows the "
    "acceleration: its slope over q'' is the relative error of the inertia, over Kp.",
    "The error obeys e'' + Kd e' + Kp e = (r - 1) q'', with r the true over the modelled "
    "inertia. The slope is that only for slow motion. With both poles at {p:g} rad/s it is "
    "{formula}: {tenth:.0%} of it at a tenth of that frequency, {share:.0%} at {w:g} rad/s.",
    ask=(
        "e'' + 2 p e' + p^2 e = (r - 1) q'' and q = sin(w t). Which multiple of q'' is the "
        "component of e in phase with q''?",
        "slope = (r - 1)*(p^2 - w^2)/(p^2 + w^2)^2",
        {
            "(r - 1)/p^2": "That is for w = 0.",
            "(r - 1)/(p^2 + w^2)": "That is the size of e, lag and all.",
            "(r - 1)/(p^2 - w^2)": "That is without damping.",
        },
    ),
)
def error_follows_acceleration(result):
    from dataclasses import replace

    import sympy

    from course.control import JointLaw, track
    from course.kinematics import TwoLink

    r, p, w = sympy.symbols("r p w", positive=True)
    # Frequency response of the error dynamics; its real part is in step with q''.
    answer = (r - 1) / (p**2 - w**2 + 2 * sympy.I * p * w)
    result.formula = sympy.simplify(sympy.re(sympy.expand_complex(answer)))
    fast, pole = result.input("w", 4.0), result.input("p", 10.0)
    one = TwoLink(masses=(1.0, 1e-6), damping=(0.0, 0.0))  # next to nothing on the second joint

    def share(ratio, rate, pole, dt=2e-3, gravity=0.0):
        """Return the plain slope of e over q'' in a run, over (r - 1)/p^2.

        Gravity [m/s^2] is that of the arm; the model knows none.
        """
        period = 2 * np.pi / rate
        model = replace(one, masses=(1 / ratio, 1e-6 / ratio))
        law = JointLaw("computed_torque", model, pole**2, 2 * pole, dt)

        def wave(t):
            rows = np.sin(rate * t), rate * np.cos(rate * t), -(rate**2) * np.sin(rate * t)
            return [np.array([row, 0 * row]) for row in rows]

        run = track(
            replace(one, gravity=gravity), law, wave, dt, dt * round((period + 12 / pole) / dt), 4
        )
        # A full period after 12 time constants, when the transient is gone.
        last = slice(-round(period / dt), None)
        q, e = run.q[0, :-1][last], (run.setpoint[0] - run.q[0, :-1])[last]
        # Least-squares slope of e over q'' = -w^2 q.
        return -(e @ q) / (rate**2 * (q @ q)) / ((ratio - 1) / pole**2)

    result.measure("share", share(1.2, fast, pole), 0.01)
    result.measure("tenth", share(1.2, 0.1 * pole, pole), 0.01)
    draws = result.rng.uniform([0.75, 5], [1.3, 15], (8, 2))
    slow = [
        share(a, s * b, b)
        for (a, b), s in zip(draws, result.rng.uniform(0.02, 0.1, 8), strict=True)
    ]
    quick = [
        share(a, s * b, b) for (a, b), s in zip(draws, result.rng.uniform(0.3, 0.9, 8), strict=True)
    ]
    # Chosen to break the condition: a load that hangs, whose error follows q, and so q'' as well.
    loaded = [share(a, 0.05 * b, b, gravity=0.5) for a, b in draws]
    theory = float(result.formula.subs({r: 1.2, p: pole, w: fast})) / (0.2 / pole**2)
    result.statement = (
        "A joint whose model is wrong, followed over a period; slopes of eight draws."
    )
    result.statement_holds(
        abs(share(1.2, fast, pole) - 1) < 0.1,
        only_if="the motion is much slower than the poles and only the inertia of the model "
        "is wrong",
        inside=[abs(x - 1) < 0.1 for x in slow],
        outside=[abs(x - 1) < 0.1 for x in quick] + [abs(x - 1) < 0.1 for x in loaded],
    )
    result.correction_holds(abs(share(1.2, fast, pole) / theory - 1) < 0.03)


@claim(
    "Good tracking alone proves that adaptive control has found the true parameters.",
    "It finds torques that track, and tracking does not need the true parameters. After "
    "{seconds:.0f} s at a constant target the angles are right and the parameters "
    "{still:.0%} off. On the chapter's motion the error falls to {error_mrad:.1f} mrad, "
    "compared with {fixed_mrad:.0f} mrad without adaptation, and the parameters are "
    "{moving:.0%} off.",
)
def adaptive_finds_parameters(result):
    from course.charts.control import tracking
    from course.control import track

    seconds, truth = result.input("seconds", 20.0), tracking.ARM.parameters

    def run(motion, rate=5.0, dt=5e-3):
        law = tracking.adaptive(tracking.WRONG, dt, rate)
        done = track(tracking.ARM, law, motion, dt, seconds)
        error = np.linalg.norm(law.estimate - truth) / np.linalg.norm(truth)
        return error, 1e3 * np.abs(done.q[:, :-1] - done.setpoint)[:, -500:].max()

    # A target that stands still excites nothing.
    still = run(lambda t: [x * (k == 0) for k, x in enumerate(tracking.motion(0 * t))])
    # A rate of 1e-9 switches the adaptation off.
    moving, fixed = run(tracking.motion), run(tracking.motion, 1e-9)
    result.measure("still", still[0], 0.02)
    result.measure("moving", moving[0], 0.02)
    result.measure("error_mrad", moving[1], 0.02)
    result.measure("fixed_mrad", fixed[1], 0.02)
    result.statement = "Estimates and errors at the end, from the numbers of a lighter arm on."
    result.statement_holds(still[0] < 0.05 and moving[0] < 0.05)
    result.correction_holds(
        still[1] < 1e-3, still[0] > 0.1, moving[0] > 0.1, moving[1] < fixed[1] / 20
    )


@claim(
    "Adaptive control is proved stable: a sum of squares, of the tracking error and of the "
    "parameter error, can only fall.",
    "In continuous time it can only fall. A sampled controller corrects its estimate with "
    "the error of the last sample. And the hold leaves a small tracking error: if the arm starts "
    "closer to the motion than that, the sum grows. From {far:.1f} rad off the motion, with the "
    "true parameters as a start, the sum grows {coarse:.1f} times within the first second at "
    "{coarse_hz:.0f} Hz. At {fine_hz:.0f} Hz it falls to {fine:.2f} of its start. At "
    "{slow_hz:.0f} Hz an offset of {near:.1f} rad is enough to lose control of the arm. With "
    "the estimate limited to between half and twice the true parameters, control is lost in "
    "none of these cases, and the error ends within {kept_mrad:.1f} mrad.",
    source="Slotine and Li, On the adaptive control of robot manipulators, 1987; Ioannou and Sun, "
    "Robust adaptive control, 1996, section 3.10",
)
def adaptive_sum_can_only_fall(result):
    from course.charts.control import tracking
    from course.control import track

    truth = tracking.ARM.parameters

    largest = [0.0, 0.0]  # |Y|^2 of the last run that was watched for it: on the way, at the start

    def run(offset, hz, seconds=1.0, bounds=None, at=0.0, watch=False, rate=5.0):
        """Return the largest and the last sum over the first, and the error at the end [mrad].

        The run begins `at` a time of the motion [s].
        """
        law = tracking.adaptive(tracking.ARM, 1.0 / hz, rate, bounds)

        def motion(times):
            return tracking.motion(np.asarray(times) + at)

        q, v, _ = motion(np.zeros(1))
        sums, step = [], law.__call__
        largest[:] = [0.0, 0.0]

        def watched(q, v, q_ref, v_ref, a_ref):
            _, _, s = law.parts(q, v, q_ref, v_ref, a_ref)
            if watch:
                aimed = v_ref + 10.0 * (q_ref - q)
                Y = tracking.ARM.regressor(q, v, a_ref + 10.0 * (v_ref - v), aimed)
                # Squared spectral norm of the regressor: the gain of one sampled update.
                size = float(np.linalg.norm(Y, 2)) ** 2
                largest[:] = [max(largest[0], size), largest[1] or size]
            wrong = law.estimate - truth
            # Slotine and Li's Lyapunov function: s^T M s / 2 plus the parameter error over the
            # rate.
            sums.append(s @ tracking.ARM.mass_matrix(q) @ s / 2 + wrong @ wrong / (2 * rate))
            return step(q, v, q_ref, v_ref, a_ref)

        start = np.asarray(q)[:, 0] + offset, np.asarray(v)[:, 0]
        done = track(tracking.ARM, watched, motion, 1.0 / hz, seconds, 10, start)
        error = 1e3 * np.abs(done.q[:, -2] - done.setpoint[:, -1]).max()
        return max(sums) / sums[0], sums[-1] / sums[0], error

    far, near = result.input("far", 0.3), result.input("near", 0.1)
    slow, coarse, fine = (
        result.input(f"{name}_hz", hz)
        for name, hz in (("slow", 125.0), ("coarse", 1e3), ("fine", 2e4))
    )
    grown = result.measure("coarse", run(far, coarse)[0], 0.1)
    fallen = result.measure("fine", run(far, fine)[1], 0.1)
    # Projection of the estimate onto a box around the true parameters.
    box = np.array([[0.5], [2.0]]) * truth
    bounded = [run(offset, hz, 5.0, box) for offset in (near, far) for hz in (slow, coarse)]
    result.measure("kept_mrad", max(end for _, _, end in bounded), 0.2)
    lost = run(near, slow, 5.0)[2]
    result.statement = (
        "The sum on the chart's arm and motion; the estimate starts as the truth, so it is the "
        "error of the motion alone at first."
    )

    def falls(offset, hz, at):
        """Return whether the sum never grows, and dt rate |Y|^2 over the damping.

        The largest on the way, and at the start.
        """
        good = run(offset, hz, 0.2, at=at, watch=True)[0] <= 1.0 + 1e-9
        return good, 5.0 * largest[0] / (2.5 * hz), 5.0 * largest[1] / (2.5 * hz)

    # Chosen to break it: starts on either side, anywhere on the motion, so that |Y| may grow on the
    # way.
    draws = [
        falls(offset, hz, at)
        for offset, hz, at in zip(
            np.concatenate([result.rng.uniform(-0.15, 0.15, (14, 2)), far * np.ones((8, 2))])
            * np.where(np.arange(22) % 2, 1.0, -1.0)[:, None],
            np.concatenate([np.full(14, 8e3), result.rng.uniform(700.0, 2500.0, 8)]),
            result.rng.uniform(0.0, 6.0, 22),
            strict=True,
        )
    ]
    # Also chosen to break it: starts closer to the motion than the error that the hold leaves.
    close = []
    for at in result.rng.uniform(0.0, 6.0, 3):
        rose = run(np.full(2, 1e-5), coarse, 0.1, at=at, watch=True)[0] > 1.0
        close.append(rose and 5.0 * largest[0] / (2.5 * coarse) < 1.0)
    fell, grew = ([start for good, _, start in draws if good == kind] for kind in (True, False))
    # Also chosen to break it: adaptation so slow that it does nothing, at rates too low for the law
    # itself.
    slow_rates = []
    for offset, hz, at in zip(
        result.rng.uniform(0.2, 0.4, (16, 2)) * [1.0, -1.0],
        result.rng.uniform(40.0, 80.0, 16),
        result.rng.uniform(0.0, 6.0, 16),
        strict=True,
    ):
        good = run(offset, hz, 0.3, at=at, watch=True, rate=1e-6)[0] <= 1.0 + 1e-9
        slow_rates.append((good, 1e-6 * largest[0] / (2.5 * hz)))
    unstable = [good for good, measure in slow_rates if measure < 1.0 and not good]
    result.statement_holds(
        grown <= 1.0,
        only_if="dt times the adaptation gain times |Y|^2 stays below the damping during the whole "
        "motion, not only at its start, the sum also falls at this sample time without adaptation, "
        "and the start is farther off the motion than the error that the hold leaves",
        inside=[good for good, measure, _ in draws if measure < 1.0],
        outside=[good for good, measure, _ in draws if not measure < 1.0]
        + [not rose for rose in close]
        + unstable,
    )
    result.correction_holds(
        # What |Y| is at the start decides nothing.
        min(grew) < max(fell),
        all(close),
        len(unstable) > 0,
        grown > 1.5,
        fallen < 1.0,
        not lost < 1e3,
        all(end < 100.0 for _, _, end in bounded),
    )


@claim(
    "A residual policy corrects the torque as a function of the state, tau = tau_0 + pi(q, q').",
    "The torque that is missing for an unknown payload also depends on the acceleration. "
    "Fitted to (q, q') over {seconds:.0f} s of a motion, {seen:.1%} of the missing torque is "
    "left on these data and {later:.0%} in the following seconds. With the acceleration as a "
    "further input, {whole:.1%} is left there.",
)
def residual_of_the_state(result):
    from course.charts.control import tracking
    from course.control import track
    from course.control.residual import fit, lacking

    def motion(t):
        parts = (tracking.motion(t, 0.5, speed) for speed in (0.6, 1.0, 1.5))
        return [sum(rows) for rows in zip(*parts, strict=True)]

    def log(start, seconds, dt=8e-3):
        law = tracking.LAWS["half-sample preview"](tracking.ARM, dt)
        return lacking(
            tracking.WRONG, track(tracking.ARM, law, lambda t: motion(t + start), dt, seconds)
        )

    end = result.input("seconds", 8.0)
    logs = {"seen": log(0.0, end), "later": log(end, 4.0)}

    def remaining(rows, tried):
        """Return shares of the torque of a log that are left, with five draws of the waves."""
        # Fitted on the first seconds; the later log is held out.
        x, torque = logs["seen"]
        waves = [fit(x[:rows], torque, np.random.default_rng(seed)) for seed in range(5)]
        x, torque = logs[tried]
        return [np.std(torque - w.weights @ w.waves(x[:rows])) / np.std(torque) for w in waves]

    # Four rows are the state (q, q'), six add the acceleration.
    observed, later, whole = remaining(4, "seen"), remaining(4, "later"), remaining(6, "later")
    result.measure("seen", np.median(observed), 0.1)
    result.measure("later", np.median(later), 0.1)
    result.measure("whole", np.median(whole), 0.1)
    result.statement = (
        "Torques that a lighter model lacks, fitted by 200 waves, five draws of them."
    )
    result.statement_holds(max(later) < 0.1)
    result.correction_holds(max(observed) < 0.05, min(later) > 3 * max(whole))


@claim(
    "Learning a correction to a model converges much faster than learning the whole torque.",
    "That depends on the model. With one that lacks payload and friction it takes at most "
    "{near:.0f} rounds of data collection until the error is below {bar:g} rad. With "
    "{light:.0%} of the masses none of {draws:.0f} runs gets there in {rounds:.0f} rounds, "
    "and none does without a model: the gains act through the model, so the arm falls and "
    "never visits the motion. With first data from the better model, learning the whole "
    "torque takes at most {shown:.0f} rounds.",
)
def residual_learning_is_faster(result):
    from dataclasses import replace

    from course.charts.control import tracking

    bar, draws, rounds = (
        result.input("bar", 0.02),
        result.input("draws", 2),
        result.input("rounds", 4),
    )
    # No model at all: almost no mass, no damping.
    empty = replace(tracking.WRONG, masses=(1e-6, 1e-6), damping=(0.0, 0.0))
    light = result.input("light", 0.1)
    masses = tracking.WRONG.masses
    weak = replace(tracking.WRONG, masses=(light * masses[0], light * masses[1]))

    def needed(model, at_most=rounds, shown=None):
        return [tracking.rounds_until(bar, model, seed, at_most, shown) for seed in range(draws)]

    near, far, alone = needed(tracking.WRONG), needed(weak), needed(empty)
    report = needed(empty, rounds + 1, tracking.WRONG)
    result.measure("near", np.max(near), 1e-6)
    result.measure("shown", np.max(report), 1e-6)
    result.statement = "Rounds of collecting and fitting, with each draw of the waves."
    result.statement_holds(max(np.max(near), np.max(far)) < np.min(alone))
    result.correction_holds(
        np.max(near) < np.min(alone),
        np.isinf(far).all(),
        np.isinf(alone).all(),
        np.isfinite(near).all(),
        np.max(report) <= rounds,
    )


@claim(
    "On a surface, control position along the normal and force along the tangent.",
    "The other way round. A rigid, smooth surface blocks motion along its normal and gives "
    "no force along its tangent. So you can choose the force along the normal and the motion "
    "along the tangent; both then come out as requested, to {right:.0e}. With the axes "
    "swapped the normal force is {swapped:.0f} N off, and the motion along the tangent is "
    "not the one requested.",
)
def axes_of_a_surface(result):
    from course.control import hybrid
    from course.kinematics import bias, jacobian, jacobian_rate, mass_matrix, planar, tip

    arm, push = planar([0.5, 0.4, 0.3], damping=0.1), 12.0

    def deviation(swapped):
        """Return errors of push [N] and of the acceleration along a drawn hard surface [m/s^2]."""
        angle, q = result.rng.uniform(-3, 3), result.rng.uniform([-1, 0.5, 0.5], [1, 1.2, 1.2])
        c, s = np.cos(angle), np.sin(angle)
        frame, n, along = np.array([[c, -s], [s, c]]), np.array([c, s]), np.array([-s, c])
        J, M = jacobian(arm, q)[:2], mass_matrix(arm, q)
        v = result.rng.normal(size=3)
        # Remove the normal velocity, so that the surface is not penetrated.
        v -= np.linalg.pinv(J) @ n * (n @ J @ v)  # it slides
        drift, goal = (jacobian_rate(arm, q, v) @ v)[:2], result.rng.normal(size=3)
        forced = np.array([not swapped, swapped])
        tau = hybrid(
            arm, q, v, goal, 0.0, 0.0, 100.0, 20.0, push * forced, 0.0, frame, forced, rows=(0, 1)
        )
        # KKT system of the constrained arm: accelerations and the reaction of the hard surface.
        K = np.block([[M, -(n @ J)[:, None]], [(n @ J)[None], np.zeros((1, 1))]])
        a = np.linalg.solve(K, np.append(tau - bias(arm, q, v), -(n @ drift)))
        requested = 100 * (goal - tip(arm, q)[:3])[:2] - 20 * (J @ v)
        return abs(-a[3] - push), abs(along @ (J @ a[:3] + drift - requested))

    right, swapped = (np.array([deviation(s) for _ in range(12)]) for s in (False, True))
    result.measure("right", max(np.max(right), 1e-9))
    result.measure("swapped", np.median(swapped[:, 0]), 1e-6)
    result.statement = "Reaction and acceleration of a hard, smooth surface at twelve drawn angles."
    result.statement_holds(np.max(swapped) < 1e-6)
    result.correction_holds(np.max(right) < 1e-7, np.min(swapped) > 0.1)


@claim(
    "An impedance controller with its set-point inside the wall holds a force as well as a force "
    "controller, also at a wall whose position is not known exactly.",
    "The force depends on how deep the set-point is inside the wall. A surface {off_mm:g} mm "
    "nearer changes the force by {soft:+.1f} N with K = {K:g} N/m and by {stiff:+.1f} N with "
    "{K_stiff:g} N/m, as two springs in series do. Admittance control with a virtual spring "
    "does the same: {virtual:+.1f} N with a spring of {hold:g} N/m. With force control, and with "
    "admittance control that has a desired force and no virtual spring, the change is at most "
    "{loop:.0e} N.",
)
def impedance_holds_a_force(result):
    from dataclasses import replace

    from course.charts.control import touch
    from course.control import TouchLaw

    deviation = result.input("off_mm", 2.0) / 1000
    soft, stiff = (touch.REGIMES[name] for name in ("soft impedance", "stiff position"))
    given = result.measure("soft", touch.surface_error(soft, deviation), 1e-3)
    pushed = result.measure("stiff", touch.surface_error(stiff, deviation), 1e-3)
    # The stiffness that the force tells: the law's spring and the wall's yield one after the other.
    result.measure("K", 1.0 / (deviation / given - 1.0 / touch.WALL))
    result.measure("K_stiff", 1.0 / (deviation / pushed - 1.0 / touch.WALL))
    loops = [abs(touch.surface_error(touch.REGIMES[n], deviation)) for n in ("force", "admittance")]
    result.measure("loop", np.max(loops) // 1e-3 * 1e-3 + 1e-3)
    # Chosen to break it: a virtual spring between the set-point and the virtual mass. Such an
    # admittance rests where its spring, the inner loop's and the wall's carry one force.
    give = touch.REGIMES["admittance"]
    springs = (result.input("hold", 200.0), 1000.0, 4000.0)
    held = [touch.surface_error(replace(give, hold=k), deviation) for k in springs]
    series = [deviation / (1 / k + 1 / give.stiffness + 1 / touch.WALL) for k in springs]
    result.measure("virtual", held[0], 1e-3)
    # Stiffnesses over two decades against two springs in series.
    draws = 10 ** result.rng.uniform(1.7, 3.6, 8)
    laws = [TouchLaw(k, 2 * np.sqrt(k * touch.ARM.mass)) for k in draws]
    result.statement = "Steady forces of the exact probe, its surface moved, at drawn stiffnesses."
    result.statement_holds(abs(touch.surface_error(soft, deviation)) < 0.01)
    result.correction_holds(
        all(
            abs(touch.surface_error(law, deviation) / touch.series_stiffness(law, deviation) - 1)
            < 1e-3
            for law in laws
        ),
        np.max(loops) < 0.1 * touch.surface_error(soft, deviation),
        np.allclose(held, series, rtol=1e-3),
    )
