"""Claims of chapter 6: which gain does what, tuning by rule, and what no gain mends."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "J": Symbol("inertia [kg m^2]"),
    "b": Symbol("viscous friction [N m s/rad]"),
    "kp": Symbol("gain [N m/rad]"),
    "zeta": Symbol("damping ratio", 0.1, 2.0),
    "u": Symbol("torque limit [N m]", 0.1, 0.9),
    "m": Symbol("mass [kg]", 1.0, 3.0),
    "g": Symbol("gravity [m/s^2]", 1.0, 10.0),
    "l": Symbol("distance of the mass [m]", 1.0, 2.0),
}
J, B = 0.5, 0.5  # the joint of the worked example [kg m^2, N m s/rad]


def _step(gains, *, joint=None, delay=0.0, dt=1e-3, seconds=8.0, target=1.0, bits=0, **more):
    """Return (record, metrics) of a step."""
    from course.control import Actuator, Encoder, Joint, run_joint, step_metrics

    run = run_joint(
        joint or Joint(J, B),
        Actuator(delay=delay),
        Encoder(bits),
        gains,
        target,
        dt,
        seconds,
        **more,
    )
    return run, step_metrics(run.times, run.q, target)


def _overshoot(kp, ki, kd, **loop):
    from course.control import Gains

    return _step(Gains(kp, ki, kd, rate="exact"), **loop)[1].overshoot


def _growth(kp, ki, kd, delay=0.0, dt=1e-3, tau=0.0):
    """Return growth per sample of a set of gains on the joint."""
    from course.control import sampled

    # Zero-order hold, discretised exactly; growth is the spectral radius of the closed loop.
    plant = sampled.held(*sampled.joint_system(J, B), dt, delay)
    return sampled.growth(sampled.loop_matrix(plant, sampled.pid_law(kp, ki, kd, dt=dt, tau=tau)))


@claim(
    "P alone overshoots.",
    "From rest and without delay the friction alone prevents overshoot below {formula}. With "
    "J = {inertia:g} and b = {damping:g} a gain of {low_n_m_per_rad:.3f} N m/rad approaches "
    "the target from one side, and {high:.0f} overshoots by {over:.0%}. Below that gain, a joint "
    "that already moves overshoots only if it starts towards the target faster than its distance "
    "times the decay rate of the faster pole. A delay lowers the gain. A load or dry friction can "
    "stop the joint short of the target at a higher gain too.",
    ask=(
        "J q'' + b q' = kp (q_d - q), continuous. Up to which kp is there no overshoot?",
        "kp < b^2/(4*J)",
        {
            "b/(2*J)": "That is the decay rate.",
            "b^2/J": "Critical damping is b = 2 sqrt(kp J): square the 2 as well.",
            "b^2/(2*J)": "Critical damping is b = 2 sqrt(kp J): the 2 becomes 4.",
        },
    ),
)
def p_alone_overshoots(result):
    import sympy

    from course.control import Joint

    s, kp, inertia, friction = sympy.symbols("s kp J b", positive=True)
    # No overshoot from rest means real poles: the discriminant is not negative.
    bare = sympy.discriminant(inertia * s**2 + friction * s + kp, s)
    result.formula = sympy.solve(bare, kp)[0]

    def over(J, b, share, late=0.0, speed=0.0, load=0.0, dry=0.0):
        """Return the overshoot at a share of the formula's gain; load and dry friction over kp."""
        kp = share * float(result.formula.subs({inertia: J, friction: b}))
        # Times in units of J / b, so that every drawn joint is sampled equally finely.
        joint, slow = Joint(J, b, load * kp, dry * kp), J / b
        more = {"delay": late * slow, "start": (0.0, speed / slow, 0.0)}
        return _overshoot(kp, 0, 0, joint=joint, dt=2e-3 * slow, seconds=60 * slow, **more)

    def faster(share):
        """Return the decay rate of the faster pole at a share of the formula's gain [b/J]."""
        return 0.5 * (1.0 + np.sqrt(1.0 - share))

    def allowed(late):
        """Return the share of the formula's gain up to which a delay [J/b] leaves a real pole."""
        # At the decay rate x b/J the characteristic equation needs this share of the gain.
        x = np.linspace(0.0, 1.0, 2001)
        return float(np.max(4.0 * x * (1.0 - x) * np.exp(-x * late)))

    mine, own = result.input("inertia", J), result.input("damping", B)
    result.measure("low_n_m_per_rad", result.formula.subs({inertia: mine, friction: own}))
    high = result.input("high", 20)
    result.measure("over", _overshoot(high, 0, 0))
    result.statement = "Steps of the exact joint at gains on both sides of critical damping."
    draws = result.rng.uniform([0.1, 0.1], [2, 2], (8, 2))
    # Shares of the critical gain: 1.6 and more overshoot visibly within the run.
    above, below = (1.6, 1.8, 2, 4, 8, 20, 50, 90), np.linspace(0.2, 0.98, 8)
    # Chosen to break it: starts away from the target, or a little slower than the faster pole
    # needs; gains just below the limit that a delay sets; loads and dry friction at high gains.
    starts = list(
        zip(draws, result.rng.uniform(0.2, 0.95, 4), (-3.0, 0.3, 0.9, 0.99), strict=False)
    )
    delays = list(zip(draws, result.rng.uniform(0.5, 3.0, 4), strict=False))
    calm = [over(d[0], d[1], share, speed=x * faster(share)) for d, share, x in starts]
    calm += [over(d[0], d[1], 0.95 * allowed(late), late) for d, late in delays]
    calm += [over(draws[0, 0], draws[0, 1], share, load=-0.6) for share in (2.0, 20.0)]
    calm += [over(draws[0, 0], draws[0, 1], share, dry=0.6) for share in (2.0, 20.0)]
    result.statement_holds(
        over(J, B, 0.9) > 0,
        only_if="kp is above b^2/(4*J) (less with a delay) or the joint starts fast enough towards "
        "the target, and neither a load nor dry friction stops it short",
        inside=[over(d[0], d[1], share) > 0 for d, share in zip(draws, above, strict=True)]
        + [over(d[0], d[1], 0.95, late=1.0) > 0 for d in draws[:4]]
        + [over(d[0], d[1], 0.9, speed=2.0) > 0 for d in draws[:4]]
        + [over(d[0], d[1], share, speed=1.05 * faster(share)) > 0 for d, share, _ in starts]
        + [over(d[0], d[1], 1.2 * allowed(late), late) > 0 for d, late in delays],
        outside=[over(d[0], d[1], share) > 0 for d, share in zip(draws, below, strict=True)]
        + [overshoot > 0 for overshoot in calm],
    )
    result.correction_holds(
        over(mine, own, 0.99) < 1e-12, over(mine, own, 2.0) > 1e-3, max(calm) < 1e-12
    )


@claim(
    "Integral action removes the steady error.",
    "It removes that of a constant load if the loop is stable and the command is within its limits "
    "in the end: {left_with_p:.3f} rad with P become {left_with_i:.0e} rad. A load that grows by "
    "{slope:g} N m/s leaves {ramp:.3f} rad with a Ki of {ki:g} N m/(rad s). A load above the "
    "torque limit drives the joint away, here by {limited:.2f} rad within {seconds:.0f} s. A loop "
    "whose I term goes on summing at a limit can swing between its limits for ever, although the "
    "motor could carry the load. Static friction above Coulomb friction can make a joint hunt: "
    "with twice the Coulomb friction one hunts by {hunting:.3f} rad. An error of the encoder "
    "remains, because the I term removes what is measured.",
)
def integral_removes_the_error(result):
    from dataclasses import replace

    from course.control import Gains, Joint

    gains = Gains(20, result.input("ki", 20), 6, rate="exact")
    held = Joint(J, B, -2.0)
    slope, seconds = result.input("slope", 0.1), result.input("seconds", 30)

    def remaining(gains=gains, joint=held, **more):
        return abs(_step(gains, joint=joint, seconds=seconds, dt=2e-3, **more)[1].error)

    def limited(gains, limit):
        """Return the same gains with a limited command."""
        return replace(gains, u_min=-limit, u_max=limit)

    n = round(seconds / 2e-3)
    # Stable without its limit; with it, the integral winds up alternately on both sides.
    wound = Gains(20, 100, 6, rate="exact", u_min=-1.5, u_max=1.5, windup="none")
    endless = _step(wound, joint=Joint(J, B, 0.25), seconds=60.0, dt=2e-3)[0].q
    # Static friction above Coulomb's: the stick-slip limit cycle that is called hunting.
    sticky = Joint(0.05, 0.05, 0.0, 0.1, 0.2)
    swing = _step(Gains(6.4, 25.6, 0.7, 0.005), joint=sticky, target=0.5, seconds=40.0)[0].q
    calm = Gains(20, 20, 4, rate="exact")
    result.measure("left_with_p", remaining(Gains(20, 0, 6, rate="exact")))
    result.measure("left_with_i", remaining(), 0.5)
    ramp = result.measure("ramp", remaining(extra=-slope * 2e-3 * np.arange(n)), 1e-3)
    result.measure(
        "limited",
        remaining(
            Gains(20, 20, 6, rate="exact", u_min=-1.5, u_max=1.5), joint=Joint(J, B, -2.0, 0.0)
        ),
        1e-3,
    )
    result.measure("hunting", np.ptp(swing[-15_000:]), 0.05)
    result.statement = "Steps of 1 rad, 30 s long; hunting over the last 15 of 40 s."
    loads = result.rng.uniform(-3, 3, 8)
    sets = [
        # Shares of Routh's limit (b + kd) kp / J on ki, so that every loop is stable.
        Gains(kp, share * (B + kd) * kp / J, kd, rate="exact")
        for kp, kd, share in result.rng.uniform([10, 2, 0.2], [40, 8, 0.5], (8, 3))
    ]
    # Chosen to break it: loops that are almost too slow or almost unstable, run for twenty of their
    # slowest time constants; and encoders with few lines.
    patient = []
    for share in (0.01, 0.03, 0.95):
        kp, kd = result.rng.uniform([10, 2], [40, 8])
        ki = share * (B + kd) * kp / J
        slowest = -np.roots([J, B + kd, kp, ki]).real.max()
        late = _step(Gains(kp, ki, kd, rate="exact"), joint=held, seconds=20.0 / slowest, dt=2e-3)[
            1
        ]
        patient.append(abs(late.error) < 1e-4)
    coarse = [remaining(joint=Joint(J, B, x), bits=8) for x in loads[:4]]
    result.statement_holds(
        remaining(extra=-slope * 2e-3 * np.arange(n)) < 1e-3,
        only_if="the loop is stable, load and set-point are constant, the command is within its "
        "limits in the end, the joint does not hunt, and the encoder shows the true angle",
        inside=[remaining(g, Joint(J, B, x)) < 1e-4 for g, x in zip(sets, loads, strict=True)]
        # At the limit for a while, and with anti-windup back within it.
        + [
            remaining(limited(g, abs(x) + 0.5), Joint(J, B, x)) < 1e-4
            for g, x in zip(sets, loads, strict=True)
        ]
        + patient,
        outside=[remaining(extra=-abs(load) * 2e-3 * np.arange(n)) < 1e-4 for load in loads]
        # The same loops with ki above Routh's limit.
        + [remaining(replace(g, ki=3 * g.ki / 0.5)) < 1e-4 for g in sets[:3]]
        # A load above the limit, with anti-windup too.
        + [
            remaining(limited(g, 0.9 * abs(x)), Joint(J, B, x)) < 1e-4
            for g, x in zip(sets[:3], loads, strict=False)
        ]
        + [error < 1e-4 for error in coarse],
    )
    result.correction_holds(
        remaining(Gains(20, 0, 6, rate="exact")) > 0.05,
        remaining() < 1e-6,
        abs(ramp / (slope / gains.ki) - 1) < 1e-3,
        np.ptp(swing[-15_000:]) > 0.01,
        # Static friction above Coulomb's need not make a joint hunt: these gains bring it to rest.
        abs(_step(calm, joint=Joint(J, B, 0.0, 2.0, 3.0), seconds=20.0)[0].q[-1] - 1.0) < 1e-4,
        # Without anti-windup: the limit is six times the load, and the swing does not end.
        np.ptp(endless[-10_000:]) > 1.0 and _growth(20, 100, 6, dt=2e-3) < 1.0,
        min(coarse) > 1e-4,
    )


def _as_printed(seconds, steps=1000):
    """Run the usual listing's controller and plant, step by step.

    It returns (times, angles, commands, speeds).

    Derivative of the error by a difference, the sum of errors clamped to 10, the command to 50;
    friction taken from the acceleration, speed before angle.
    """
    dt, n = 1 / steps, round(seconds * steps)
    q, v, total, last = 0.0, 0.0, 0.0, 0.0
    angles, speeds, sent = [q], [v], []
    for _ in range(n):
        error = 1.0 - q
        total = min(max(total + error * dt, -10.0), 10.0)
        u = min(max(20 * error + 5 * total + 8 * (error - last) / dt, -50.0), 50.0)
        last = error
        v += (u / 0.5 - 0.5 * v) * dt
        q += v * dt
        angles.append(q)
        speeds.append(v)
        sent.append(u)
    return dt * np.arange(n + 1), np.array(angles), np.array(sent), np.array(speeds)


@claim(
    "Subtracting 0.5 omega from torque/inertia is viscous friction of 0.5 N m s/rad.",
    "This term acts on the acceleration, so the friction is that number times the inertia: "
    "{friction:.3f} N m s/rad for J = {inertia:g}. A joint with this friction follows the "
    "tutorial's code to {same:.0e} rad. One with the number itself is {off:.3f} rad away.",
)
def listing_friction(result):
    from course.control import sampled

    inertia = result.input("inertia", 0.5)
    times, angles, sent, _ = _as_printed(1.0)

    def distance(damping):
        """Return the largest distance of the exact joint driven by the listing's commands [rad]."""
        plant = sampled.held(*sampled.joint_system(inertia, damping), times[1])
        x, worst = np.zeros(2), 0.0
        # Open loop: the exact plant gets the listing's commands, so only the friction can differ.
        for u, q in zip(sent, angles, strict=False):
            worst = max(worst, abs(x[0] - q))
            x = plant.transition @ x + plant.now * u
        return worst

    # A fit by search, which does not presume the answer b = 0.5 J.
    trial = np.linspace(0.1, 0.6, 501)
    result.measure("friction", trial[np.argmin([distance(b) for b in trial])], 0.02)
    result.measure("same", distance(0.5 * inertia), 0.2)
    result.measure("off", distance(0.5), 1e-3)
    result.statement = "The exact joint under the same commands, friction varied."
    result.statement_holds(distance(0.5) < distance(0.5 * inertia))
    result.correction_holds(distance(0.5) > 20 * distance(0.5 * inertia))


@claim(
    "The PID code of many tutorials (kp 20, ki 5, kd 8) has settled at the target after "
    "three seconds.",
    "It is {error_mrad:.0f} mrad {side} the target and creeping back. The slowest part of "
    "the error has a time constant of {slow_s:.1f} s, and the joint is within a fiftieth of "
    "the step only {settled}. The first command is {first_n_m:.0f} N m, the torque limit, "
    "because of the derivative of the error.",
)
def listing_settles(result):
    from course.control import step_metrics

    _, angles, sent, _ = _as_printed(3.0)
    long = _as_printed(60.0)
    metrics = step_metrics(long[0], long[1], 1.0)
    # Characteristic polynomial J s^3 + (b + kd) s^2 + kp s + ki with the effective b of 0.25.
    roots = np.roots([0.5, 0.25 + 8, 20, 5])
    error = 1.0 - angles[-1]
    result.measure("error_mrad", 1000 * abs(error), 1e-3)
    result.measure("side", "short of" if error > 0 else "past")
    result.measure("slow_s", -1 / np.max(roots.real))
    result.measure("first_n_m", sent[0])
    late = metrics.settling > 3.0
    result.measure("settled", f"after {metrics.settling:.1f} s" if late else "within them")
    result.statement = "The listing's own arithmetic, 3 s and 60 s; its roots without sampling."
    result.statement_holds(abs(error) < 1e-3)
    result.correction_holds(
        abs(error) > 1e-3, -1 / np.max(roots.real) > 2, sent[0] > 49, abs(long[1][-1] - 1) < 1e-6
    )


@claim(
    "Taking the derivative of the error, not of the measurement, avoids a spike in the "
    "torque when the set-point jumps.",
    "It causes the spike. A set-point step r adds kd r/(tau + dt) to the first command, "
    "where tau is the filter's time constant: {kick_n_m:.0f} N m for kd = {kd:g} at "
    "{rate_hz:.0f} Hz and a step of one radian without a filter. The derivative of the "
    "measurement adds {none_n_m:.0f}.",
)
def error_derivative_kick(result):
    from course.control import Controller, Gains

    dt = 1 / result.input("rate_hz", 1000)

    def kick(kd, tau, step, weight):
        controller = Controller(Gains(2.0, 0, kd, tau, rate_weight=weight), dt)
        controller.update(0.0, 0.0)
        # The proportional part is subtracted, so that only the derivative's kick is left.
        return controller.update(step, 0.0) - 2.0 * step

    kd = result.input("kd", 8)
    result.measure("kick_n_m", kick(kd, 0.0, 1.0, 1.0))
    result.measure("none_n_m", kick(kd, 0.0, 1.0, 0.0), 1e-9)
    draws = result.rng.uniform([0.1, 0, 0.1], [9, 0.1, 2], (9, 3))
    result.statement = "First command after a step, at drawn gains, filters and steps."
    result.statement_holds(abs(kick(kd, 0.0, 1.0, 1.0)) < abs(kick(kd, 0.0, 1.0, 0.0)))
    result.correction_holds(
        all(abs(kick(d[0], d[1], d[2], 1.0) - d[0] * d[2] / (d[1] + dt)) < 1e-9 for d in draws),
        all(abs(kick(d[0], d[1], d[2], 0.0)) < 1e-12 for d in draws),
    )


@claim(
    "Overshoot means that P is too high or D too low.",
    "For a step from rest under PD with little delay that is true, at the torque limit too. With "
    "an I term, a lower P makes the overshoot larger: {low_p:.0%} at kp = {p_low:g} and "
    "{high_p:.0%} at {p_high:g}, all else equal. If P acts on the measurement only, the first case "
    "has {weighted:.0%}. Where the delay limits kd, more D makes the overshoot larger. Where a "
    "strong load or the speed at the start carries the joint past the target, a lower P lets it go "
    "farther.",
)
def overshoot_means_p(result):
    from course.control import Gains, Joint

    ki, kd, limits = 30.0, 4.0, (1, 2, 4, 8, 16, np.inf, np.inf, np.inf)
    low, high = result.input("p_low", 12), result.input("p_high", 60)
    result.measure("low_p", _overshoot(low, ki, kd), 1e-3)
    result.measure("high_p", _overshoot(high, ki, kd), 1e-3)

    gentle = Gains(low, ki, kd, rate="exact", weight=0.0)
    result.measure("weighted", _step(gentle)[1].overshoot, 1e-3)

    def overshoots(kp, ki, kd, delay=0.0, at_most=np.inf, load=0.0, start=(0.0, 0.0)):
        """Return the overshoots of a loop, with a fifth less P, and with a fifth more D."""
        loop = {"delay": delay, "joint": Joint(J, B, load), "start": (*start, 0.0)}
        return [
            _step(Gains(p, ki, d, rate="exact", u_min=-at_most, u_max=at_most), **loop)[1].overshoot
            for p, d in ((kp, kd), (0.8 * kp, kd), (kp, 1.2 * kd))
        ]

    def mended(*loop, **more):
        """Return whether less P and more D both lower a loop's overshoot."""
        now, *changed = overshoots(*loop, **more)
        return max(changed) < now

    # PD loops inside, some at a torque limit; outside the same with an integral or a long delay.
    draws = result.rng.uniform([20, 0.5], [80, 3], (8, 2))
    result.statement = "Steps of the joint with the exact rate."
    # Chosen to break it: loads that pull back; and, outside, what pushes the joint past the target,
    # a load or a speed close to it, against which P is the spring.
    pulls = -draws[:4, 0] * result.rng.uniform(0.0, 0.05, 4)
    pushed = [overshoots(kp, 0, kd, load=0.4 * kp) for kp, kd in draws[:3]]
    pushed += [overshoots(kp, 0, kd, start=(0.95, 3.0)) for kp, kd in draws[:3]]
    result.statement_holds(
        mended(low, ki, kd),
        only_if="the joint starts at rest, no load pushes it past the target, there is no I term, "
        "and the delay is far from limiting kd",
        inside=[mended(kp, 0, kd, at_most=x) for (kp, kd), x in zip(draws, limits, strict=True)]
        + [mended(kp, 0, kd, load=x) for (kp, kd), x in zip(draws, pulls, strict=False)],
        outside=[mended(0.4 * kp, 1.2 * kp, kd + 1) for kp, kd in draws]
        + [mended(kp, 0, 5.0, 0.1) for kp, _ in draws[:3]]
        + [less < now for now, less, _ in pushed],
    )
    result.correction_holds(
        _overshoot(low, ki, kd) > 1.5 * _overshoot(high, ki, kd),
        all(less > now for now, less, _ in pushed),
    )


@claim(
    "Start with D = 0.1 P.",
    "This ratio is a time, a tenth of a second, and suits loops of one speed only. The "
    "damping ratio is {soft:.2f} at kp = {p_soft:g}, {middle:.2f} at {p_middle:g} and "
    "{stiff:.1f} at {p_stiff:g}. For a damping ratio zeta choose kd = {formula}.",
    ask=(
        "J q'' + (b + kd) q' + kp q = 0: which kd gives the damping ratio zeta?",
        "kd = 2*zeta*sqrt(kp*J) - b",
        {
            "2*zeta*sqrt(kp*J)": "The joint's own friction helps: take it off.",
            "zeta*sqrt(kp*J) - b": "Critical damping is 2 sqrt(kp J).",
            "2*zeta*kp*J - b": "The root is missing.",
        },
    ),
)
def tenth_of_p(result):
    import sympy

    from course.control import sampled

    s, J_, b, kp, kd, zeta, w = sympy.symbols("s J b kp kd zeta w", positive=True)
    # Compare coefficients with the standard form s^2 + 2 zeta omega s + omega^2.
    desired = sympy.Poly(s**2 + 2 * zeta * w * s + w**2, s).all_coeffs()
    got = sympy.Poly(s**2 + (b + kd) / J_ * s + kp / J_, s).all_coeffs()
    speed = sympy.solve(desired[2] - got[2], w)[0]
    result.formula = sympy.solve((desired[1] - got[1]).subs(w, speed), kd)[0]

    def ratio(kp, kd):
        """Return damping ratio, from the eigenvalue of the sampled loop."""
        law = sampled.pid_law(kp, 0, kd, dt=1e-6, rate="exact")
        roots = np.linalg.eigvals(
            sampled.loop_matrix(sampled.held(*sampled.joint_system(J, B), 1e-6), law)
        ).astype(complex)
        # Continuous poles s = ln(z) / dt; the damping ratio from their sum and product is also
        # right when both are real.
        poles = np.log(roots) / 1e-6
        return float(-np.sum(poles.real) / 2 / np.sqrt(np.abs(np.prod(poles))))

    stiffness = [
        result.input(f"p_{n}", p) for n, p in (("soft", 5), ("middle", 70), ("stiff", 2000))
    ]
    for name, kp_ in zip(("soft", "middle", "stiff"), stiffness, strict=True):
        result.measure(name, ratio(kp_, 0.1 * kp_), 1e-3)
    result.statement = "Poles of the loop at a megahertz, where sampling no longer shows."
    result.statement_holds(all(0.4 < ratio(p, 0.1 * p) < 1.2 for p in stiffness))
    numbers = {J_: J, b: B, zeta: 0.7}
    result.correction_holds(
        all(
            abs(ratio(p, float(result.formula.subs(numbers).subs(kp, p))) - 0.7) < 1e-3
            for p in stiffness
        ),
    )


@claim(
    "Critical damping settles fastest.",
    "Slightly less damping settles faster into a band. For {band_percent:.0f} % of a step "
    "the fastest damping ratio is zeta = {best:.3f}. It needs {share:.0%} of the time of "
    "critical damping.",
)
def critical_settles_fastest(result):
    from course.control import Actuator, Encoder, Gains, Joint, run_joint, step_metrics

    band = result.input("band_percent", 2) / 100

    def settling(zeta):
        """Return the settling time in units of 1/omega, with J = 1 and kp = 1."""
        run = run_joint(
            Joint(1.0),
            Actuator(),
            Encoder(),
            Gains(1.0, 0, 2 * zeta, rate="exact"),
            1.0,
            2e-3,
            20.0,
        )
        return step_metrics(run.times, run.q, 1.0, band=band).settling

    # A fine grid: settling into a band jumps where an overshoot leaves the band again.
    ratios = np.linspace(0.6, 1.2, 601)
    times = np.array([settling(z) for z in ratios])
    result.measure("best", ratios[np.argmin(times)], 5e-3)
    result.measure("share", times.min() / settling(1.0), 0.01)
    result.statement = "Settling time over the damping ratio, every thousandth."
    result.statement_holds(settling(1.0) <= times.min() + 0.01)
    result.correction_holds(0.5 < times.min() / settling(1.0) < 0.8, settling(1.2) > settling(1.0))


@claim(
    "An overdamped, sluggish joint needs less D or more P.",
    "True while the limits of sampling, delay and torque are far away. Where kd is near the limit "
    "that the delay sets, the same cure ends in oscillation: a loop with kd dt/J = {V:.1f}, "
    "one sample late, is sluggish at P = {low:g} and unstable at {high:g}, in units of "
    "J/dt^2. A joint that has to brake at its torque limit settles later with less D or more "
    "P, because it overshoots. Where a load or dry friction holds the joint away from the target, "
    "less D changes nothing.",
)
def overdamped_cure(result):
    from course.control import Gains, Joint, sampled

    V, low, high = result.input("V", 0.85), result.input("low", 0.02), result.input("high", 0.3)
    unit = J / 1e-3**2

    def settling(kp, kd, delay=0.0, seconds=6.0, at_most=np.inf, joint=None):
        gains = Gains(kp, 0, kd, rate="exact", u_min=-at_most, u_max=at_most)
        return _step(gains, delay=delay, seconds=seconds, joint=joint)[1].settling

    def growth(P):
        # Units of a sample and of J: V and P are the dimensionless gains.
        plant = sampled.held(*sampled.joint_system(1.0), 1.0, 1.0)
        law = sampled.pid_law(P, 0, V, dt=1.0, rate="exact")
        return sampled.growth(sampled.loop_matrix(plant, law))

    def cured(kp, kd, *loop, **more):
        now = settling(kp, kd, *loop, **more)
        changed = settling(1.5 * kp, kd, *loop, **more), settling(kp, kd / 1.5, *loop, **more)
        return max(changed) < now

    result.measure("slow_samples", -1 / np.log(growth(low)))
    result.measure("growth_high", growth(high))
    result.statement = "Growth per sample of PD on an inertia, one sample late, and steps without."
    # Damping ratios of 1.5 to 2, well away from the sampling limits.
    slow = result.rng.uniform([20, 1.5], [80, 2.0], (8, 2))
    fast = result.rng.uniform(0.22, 0.32, 8)
    # Chosen to break it: a torque limit that makes the braking slow; loads and dry friction that
    # hold the joint outside the band of its target.
    held = []
    for kp, z in slow[:3]:
        kd = 2 * z * np.sqrt(kp * J)
        held.append(cured(kp, kd, seconds=30.0, at_most=0.25, joint=Joint(J)))
        stopped = Joint(J, B, -0.1 * kp), Joint(J, B, 0.0, 0.1 * kp)
        held += [cured(kp, kd, joint=joint) for joint in stopped]
    result.statement_holds(
        cured(0.24 * unit, V * J / 1e-3, 1e-3, 0.2),
        only_if="the loop is far from the limits that sampling, delay and torque set, and neither "
        "a load nor dry friction holds the joint away from its target",
        inside=[cured(kp, 2 * z * np.sqrt(kp * J)) for kp, z in slow],
        outside=[cured(P * unit, V * J / 1e-3, 1e-3, 0.2) for P in fast] + held,
    )
    result.correction_holds(growth(low) < 1 < growth(high), not any(held))


@claim(
    "Raise P until the loop oscillates at a constant amplitude: every joint has such a gain.",
    "A rigid joint has one only with a delay: a hold, communication, or a motor that lags. "
    "Under a hold and without friction no P gain is stable. With friction and without delay none "
    "is too high. "
    "At {rate_hz:.0f} Hz the hold alone makes it {gain:.0f} N m/rad, with a period of "
    "{period_s:.3f} s. With a torque limit, twice and ten times that gain also end in a "
    "constant amplitude, so a constant amplitude does not prove that the gain is the "
    "ultimate one.",
)
def every_joint_has_ku(result):
    from course.control import Gains, sampled

    dt = 1 / result.input("rate_hz", 1000)
    gain, period = sampled.ultimate_gain(*sampled.joint_system(J, B), dt)
    result.measure("gain", gain)
    result.measure("period_s", period)

    def swing(factor):
        run = _step(Gains(factor * gain, u_min=-5, u_max=5), dt=dt, seconds=20.0, target=0.05)[0]
        # Two windows of five seconds: a constant amplitude is the same in both.
        a, b = (np.ptp(run.q[part]) for part in (slice(10_000, 15_000), slice(15_000, 20_000)))
        return abs(b / a - 1)

    steady = [swing(f) for f in (2, 10)]
    # Without a hold no ultimate gain: it must grow without bound as the period shrinks.
    fast = [sampled.ultimate_gain(*sampled.joint_system(J, B), x)[0] for x in (1e-3, 1e-4, 1e-5)]
    result.statement = "Exact ultimate gains at three rates; swings under a limited torque."
    result.statement_holds(_growth(1e-3, 0, 0) < 1 and abs(fast[2] / fast[0] - 1) < 0.1)
    result.correction_holds(
        max(steady) < 0.05, fast[2] > 90 * fast[0], _growth(0.99 * gain, 0, 0) < 1
    )


@claim(
    "For a joint with J = 0.5 and friction 0.5 the ultimate gain is 45 and the period 0.45 s.",
    "No delay gives this pair. A gain of {said:.0f} has the period {period:.2f} s, at a "
    "total delay of {late_ms:.1f} ms. A period of {said_s:.2f} s belongs to a gain of "
    "{gain:.0f}. At a kilohertz without further delay the pair is {held:.0f} and "
    "{held_s:.2f} s.",
)
def quoted_ku_tu(result):
    from course.control import sampled

    text, said_s = result.input("said", 45), result.input("said_s", 0.45)
    # The delay is unknown, so all of them are tried, from 0.3 ms to 1 s.
    lateness = np.geomspace(3e-4, 1, 4000)
    table = np.array([sampled.delay_limit(J, B, T) for T in lateness])
    i = int(np.argmin(np.abs(table[:, 0] - text)))
    k = int(np.argmin(np.abs(table[:, 1] - said_s)))
    result.measure("period", table[i, 1], 2e-3)
    result.measure("late_ms", 1000 * lateness[i], 2e-3)
    result.measure("gain", table[k, 0], 2e-3)
    held, held_s = sampled.ultimate_gain(*sampled.joint_system(J, B), 1e-3)
    result.measure("held", held)
    result.measure("held_s", held_s)
    # Best match of both numbers at one delay: the worse of the two logarithmic ratios.
    error = np.min(np.abs(np.log(table / [text, said_s])).max(axis=1))
    result.statement = "Gain and period at 4000 delays, and the exact loop."
    result.statement_holds(error < 0.02)
    result.correction_holds(error > 0.15, abs(held - text) > 900)


@claim(
    "On a joint with J = 0.5 and b = 0.5, the gains kp = 27, ki = 120 and kd = 1.5 give about "
    "15 % overshoot.",
    "They are unstable on this joint, whatever the sample time. Even the continuous loop "
    "is stable only if (b + kd) kp > J ki (Routh's condition), and {left:.0f} is less than "
    "{right:.0f}. The oscillation grows {factor:.3f} times per second without delay, and "
    "{delayed:.1f} times with the "
    "{late_ms:.0f} ms for which the ultimate gain is {said:.0f}.",
)
def quoted_gains_overshoot(result):
    from course.control import Gains, sampled

    late, text = result.input("late_ms", 10.64) / 1000, result.input("said", 45)
    kp, ki, kd = (result.input(n, v) for n, v in (("kp", 27.0), ("ki", 120.0), ("kd", 1.5)))

    def per_second(delay=0.0, dt=1e-3):
        return _growth(kp, ki, kd, delay, dt) ** (1 / dt)

    # Poles of the continuous loop, independent of the sampled one.
    roots = np.roots([J, B + kd, kp, ki])
    # Routh's two products from the polynomial that has these poles.
    third, second, first, zeroth = J * np.real(np.poly(roots))
    result.measure("left", second * first)
    result.measure("right", third * zeroth)
    result.measure("factor", per_second(dt=1e-5), 1e-3)
    result.measure("delayed", per_second(late), 1e-3)
    gain = sampled.ultimate_gain(*sampled.joint_system(J, B), 1e-3, late)[0]
    result.statement = "Routh's condition, and the loop's matrix."
    result.statement_holds(_step(Gains(kp, ki, kd), delay=late, seconds=20.0)[1].settling < 20)
    result.correction_holds(
        np.max(roots.real) > 0,
        per_second(late) > 1,
        all(_growth(kp, ki, kd, dt=dt) > 1 for dt in np.geomspace(1e-5, 1, 30)),
        # The delay in question is the one that reproduces the quoted ultimate gain.
        abs(gain / text - 1) < 0.02,
    )


@claim(
    "Compared with kp = 27, ki = 120 and kd = 1.5, 70 % of P and 150 % of D with the same I "
    "are a safer set for a joint with J = 0.5 and b = 0.5.",
    "They are not safe. With the delay for which those gains are meant, {late_ms:.0f} ms, "
    "the new gains kp {kp:g}, ki {ki:g}, kd {kd:g} still grow {late_factor:.2f} times per "
    "second, after {late_before:.2f} before. Without delay it gets worse: {factor:.2f} after "
    "{before:.3f}, because P is lower and I the same. With the old kp and the new kd the "
    "loop decays with and without delay, to {late_kept:.2f} and {kept:.2f} per second.",
)
def safer_set(result):
    kp, ki, kd = (result.input(n, v) for n, v in (("kp", 18.9), ("ki", 120.0), ("kd", 2.25)))
    late = result.input("late_ms", 10.64) / 1000

    def grown(name, delay, dt=1e-4):
        """Return growth a second of the set, of the one before, and with that one's kp."""
        # The recommended set, the one before, and a third that separates less P from more D.
        sets = (kp, ki, kd), (27, 120, 1.5), (27, ki, kd)
        found_out = [_growth(p, i, d, delay, dt) ** (1 / dt) for p, i, d in sets]
        for word, value in zip(("factor", "before", "kept"), found_out, strict=True):
            result.measure(name + word, value, 1e-3)
        return found_out

    # Without delay the sample is so short that its hold does not count either.
    now, then = grown("", 0.0, 1e-5), grown("late_", late)
    result.statement = (
        "Growth of both sets by the loop's matrix, without further delay and with it."
    )
    result.statement_holds(max(now[0], then[0]) < 1)
    result.correction_holds(now[0] > now[1] > 1 > now[2], then[1] > then[0] > 1 > then[2])


@claim(
    "Whichever row of the Ziegler-Nichols table you use, a robot joint becomes stable and "
    "overshoots little.",
    "A joint integrates already, and an I term integrates once more. With its true "
    "delay, sampled {samples:.0f} times within it, the PID row is stable at {pid_ok:.0%} of the "
    "delays from {low:g} to {high:g} times J/b, and the PI row at {pi_ok:.0%} (in continuous time "
    "{pi_smooth:.0%}). The PID row overshoots by "
    "{over_low:.0%} or more. With poles placed for the stated delay the "
    "overshoot is {placed:.0%}.",
    source="J. G. Ziegler, N. B. Nichols, Optimum settings for automatic controllers, 1942",
)
def ziegler_nichols_is_safe(result):
    from course.charts.control.limits import ROWS, SAMPLES, placed, ziegler_nichols
    from course.control import sampled

    def smooth_phase(D):
        """Return the phase margin of the PI row on the continuous joint [rad]."""
        gain, period = sampled.delay_limit(1.0, 1.0, D)
        p, i, _ = ROWS["PI"]
        s = 1j * np.geomspace(1e-3, 1e4, 40_001)
        loop = gain * (p + i / period / s) * np.exp(-s * D) / (s * s + s)
        crossing = np.argmin(np.abs(np.log(np.abs(loop))))
        return np.angle(-loop[crossing])

    low, high = result.input("low", 0.01), result.input("high", 10)
    # Delays over three decades, as the tables promise gains for any lag.
    shares = np.geomspace(low, high, 25)
    rows = {name: [ziegler_nichols(name, x) for x in shares] for name in ROWS}
    stable = {name: np.mean([r.growth < 1 for r in row]) for name, row in rows.items()}
    result.measure("pid_ok", stable["PID"], 0.05)
    result.measure("pi_ok", stable["PI"], 0.05)
    result.measure("samples", SAMPLES, 1e-6)
    smooth = np.array([smooth_phase(x) for x in shares]) > 0.0
    result.measure("pi_smooth", np.mean(smooth), 0.05)
    over = min(r.overshoot for r in rows["PID"] if r.growth < 1)
    result.measure("over_low", over, 0.02)
    mine = [placed(x) for x in shares]
    result.measure("placed", max(r.overshoot for r in mine), 0.05)
    margins = [r.margins() for r in mine]
    result.measure("placed_phase_deg", np.degrees(min(m.phase for m in margins)), 1e-3)
    result.measure("placed_gain", min(m.gain for m in margins), 1e-3)
    result.statement = "Every row at 25 delays: growth, margins and a step."
    result.statement_holds(min(stable.values()) == 1 and over < 0.2)
    result.correction_holds(
        over > 0.2,
        all(r.growth < 1 for r in mine),
        max(r.overshoot for r in mine) < over,
        # Sampled and continuous disagree only at the one delay next to the limit.
        np.sum(smooth != [r.growth < 1 for r in rows["PI"]]) <= 1,
    )


@claim(
    "Each gain cures one symptom: D the overshoot, P the settling time, I the steady error.",
    "Each gain changes overshoot and settling time. Only the steady error belongs to one "
    "gain: to I, and without I to P. On a PID loop a fifth more I adds {i_over:.1%} of "
    "overshoot, and a fifth more P removes {p_over:.1%}. Of {draws:.0f} random loops "
    "{p_later:.0%} settle later with more P.",
)
def one_gain_one_symptom(result):
    from course.control import Gains, Joint

    def metrics(kp, ki, kd, load=0.0):
        return _step(Gains(kp, ki, kd, rate="exact"), joint=Joint(J, B, load), seconds=15.0)[1]

    now, more_d = metrics(20, 30, 4), metrics(20, 30, 4.8)
    # PD under a load: the steady error depends on kp and not on kd.
    alone = [metrics(kp, 0, kd, -2.0).error for kp, kd in ((20, 4), (24, 4), (20, 4.8))]
    result.measure("i_over", metrics(20, 36, 4).overshoot - now.overshoot, 1e-2)
    result.measure("p_over", now.overshoot - metrics(24, 30, 4).overshoot, 1e-2)
    # A single loop could be a coincidence, so the effect on settling is counted over random ones.
    draws = result.rng.uniform([15, 5, 2], [60, 60, 8], (int(result.input("draws", 40)), 3))
    later = [metrics(1.2 * a, b, c).settling > metrics(a, b, c).settling for a, b, c in draws]
    result.measure("p_later", np.mean(later), 0.05)
    result.statement = "Steps of the joint, one gain changed by a fifth at a time."
    result.statement_holds(np.mean(later) == 0 and metrics(20, 36, 4).overshoot <= now.overshoot)
    result.correction_holds(
        0.05 < np.mean(later),
        metrics(20, 36, 4).overshoot > now.overshoot,
        metrics(24, 30, 4).overshoot < now.overshoot,
        abs(now.error) < 1e-6,
        more_d.overshoot < now.overshoot,
        more_d.settling > now.settling,
        abs(metrics(20, 36, 4).settling / now.settling - 1) > 0.05,
        alone[1] < 0.9 * alone[0],
        abs(alone[2] / alone[0] - 1) < 1e-6,
    )


@claim(
    "With gains that are high enough a controller catches an inverted pendulum from any angle.",
    "The motor's torque decides. From rest the pendulum can be caught within {formula} of "
    "upright and not beyond, whatever the gains: {edge_rad:.4f} rad for a torque of "
    "{share:g} m g l. The linear model says {share:g}.",
    ask=(
        "Inverted pendulum at rest at the angle theta from upright, mass m at the distance l, "
        "torque at most u < m g l. For which theta can it be caught without swinging?",
        "theta < asin(u/(m*g*l))",
        {
            "u/(m*g*l)": "That is the linear pendulum's.",
            "acos(u/(m*g*l))": "The angle is measured from upright.",
            "atan(u/(m*g*l))": "Gravity's torque is m g l sin(theta).",
        },
    ),
)
def high_gain_catches(result):
    import sympy

    from course.charts.control.limits import caught, edge_of_rest

    u, m, g, length = sympy.symbols("u m g l", positive=True)
    sine = sympy.Symbol("sine")  # of the angle at which gravity's torque is all of the motor's
    result.formula = sympy.asin(sympy.solve(u - m * g * length * sine, sine)[0])
    share = result.input("share", 0.5)

    # Three gains over a decade: the edge must not depend on them.
    edges = [edge_of_rest(share, gain) for gain in (3.0, 10.0, 30.0)]
    theory = float(result.formula.subs({u: share, m: 1, g: 1, length: 1}))
    result.measure("edge_rad", edges[1], 1e-6)
    result.statement = "Saturated feedback at three gains, the limit by bisection."
    result.statement_holds(caught(1.2, 0.0, share, 30.0).all())
    result.correction_holds(
        all(abs(x / theory - 1) < 1e-3 for x in edges),
        abs(edge_of_rest(share, linear=True) / share - 1) < 1e-3,
    )
