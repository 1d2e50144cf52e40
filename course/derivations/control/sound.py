"""Claims of chapter 6: rules of thumb that hold, and how far."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "d": Symbol("depth of the set-point [m]"),
    "K": Symbol("stiffness of the controller [N/m]"),
    "ke": Symbol("stiffness of the wall [N/m]"),
    "F": Symbol("static friction [N m]"),
    "kp": Symbol("gain [N m/rad]"),
}


@claim(
    "For motions that are slow compared with the sample rate, a command that is held for a sample "
    "acts as if it were half a sample late.",
    "For a pure inertia the phase lag is exactly that. With friction it also depends on J/b, "
    "inertia divided by friction. Over all J/b, the lag of a motion of {turn:g} rad per sample "
    "differs from half a sample by {off_rad:.3f} rad at most. At {fast:g} rad per sample, near the "
    "highest frequency there is, the largest difference is {fast_rad:.1f} rad.",
)
def hold_is_half_a_sample(result):
    from course.control import sampled

    turn, fast = result.input("turn", 1), result.input("fast", 3)

    def deviation(inertia, damping, dt, turn=turn):
        """Return phase of the held joint, against the continuous one half a sample late [rad]."""
        system, w = sampled.joint_system(inertia, damping), turn / dt
        held = sampled.open_loop(sampled.held(*system, dt), sampled.pid_law(1.0, dt=dt), [w])[0]
        late = np.exp(-0.5j * w * dt) / (1j * w * (1j * w * inertia + damping))
        return abs(np.angle(held / late))

    # Only the ratio J/b to the sample time matters; the largest difference lies near a fifth.
    ratios = np.logspace(-2, 3, 101)

    def worst(turn):
        return max(deviation(ratio, 1.0, 1.0, turn) for ratio in ratios)

    largest = result.measure("off_rad", worst(turn), 0.01)
    result.measure("fast_rad", worst(fast), 0.01)
    drawn = [deviation(*10 ** result.rng.uniform([-2, -2, -4], [1, 0, -2])) for _ in range(20)]
    result.statement = "Phase of the held loop, against the continuous one times a delay."
    # A motion that is ten times slower: the difference is a thousandth.
    result.statement_holds(largest < 0.05 * turn and worst(turn / 10) < 2e-3 * largest)
    result.correction_holds(
        deviation(1.0, 0.0, 1e-3) < 1e-9,
        max(drawn) < 1.01 * largest,
        1e-3 < largest < 0.1 * worst(fast),
    )


@claim(
    "A rate that is low-passed with a time constant tau is late by tau.",
    "Under constant acceleration it is late by tau and the half sample of the difference: "
    "{filtered_ms:.2f} ms with {tau_ms:g} ms at {rate_hz:.0f} Hz. After a start from rest, the lag "
    "needs a few tau to grow to this. In a motion at the angular "
    "frequency w a filter delays by about atan(w tau)/w, and the difference by half a sample: at "
    "w = 1/tau, the rate of this sampled filter is only {sine_ms:.1f} ms late. A tracking observer "
    "with the same time constant is late by {observer_ms:.2f} ms "
    "under constant acceleration, and its noise is {share:.0%} of the filter's.",
)
def filtered_rate_is_late(result):
    from course.control.pid import rates

    dt, tau = 1 / result.input("rate_hz", 1000), result.input("tau_ms", 10) / 1000
    t = dt * np.arange(4000)
    noise = result.rng.standard_normal(40_000)

    def lag(kind, tau):
        return t[-1] - rates(0.5 * t**2, dt, kind, tau)[-1]

    def sine_lag(turn, tau):
        """Return the lag of a filtered rate in a motion at the frequency turn / tau [s]."""
        w = turn / tau
        time = dt * np.arange(round((20 * tau + 6 * np.pi / w) / dt))
        rate = rates(np.sin(w * time), dt, "filtered", tau)
        late = time > 20 * tau  # the transient is gone
        basis = np.stack([np.cos(w * time[late]), np.sin(w * time[late])], axis=1)
        inphase, quadrature = np.linalg.lstsq(basis, rate[late], rcond=None)[0]
        return np.arctan2(quadrature, inphase) / w

    result.measure("filtered_ms", 1000 * lag("filtered", tau))
    result.measure("sine_ms", 1000 * sine_lag(1.0, tau), 1e-3)
    result.measure("observer_ms", 1000 * lag("observer", tau))
    spreads = [np.std(rates(noise, dt, kind, tau)[4000:]) for kind in ("observer", "filtered")]
    result.measure("share", spreads[0] / spreads[1], 0.05)
    taus = result.rng.uniform(10 * dt, 0.1, 8)
    slow, fast = result.rng.uniform(0.02, 0.2, 8), result.rng.uniform(0.8, 3.0, 8)

    def since_start(after, tau):
        """Return the lag under constant acceleration, a multiple of tau after a start [s]."""
        k = round(after * tau / dt)
        return t[k] - rates(0.5 * t[: k + 1] ** 2, dt, "filtered", tau)[-1]

    # Chosen to break it: the time just after a start, before the filter has followed.
    early, later = result.rng.uniform(0.2, 1.2, 8), result.rng.uniform(4.0, 8.0, 8)
    started = [since_start(after, x) / x for after, x in zip(early, taus, strict=True)]
    result.statement = "Lag under a steady acceleration and in sines, and what white noise becomes."
    result.statement_holds(
        abs(sine_lag(1.0, tau) / tau - 1) < 0.06,
        only_if="the motion has been slow compared with 1/tau for at least four tau, and tau is "
        "long compared with the sample",
        inside=[abs(lag("filtered", x) / x - 1) < 0.06 for x in taus]
        + [abs(sine_lag(turn, x) / x - 1) < 0.06 for turn, x in zip(slow, taus, strict=True)]
        + [abs(since_start(after, x) / x - 1) < 0.06 for after, x in zip(later, taus, strict=True)],
        outside=[abs(ratio - 1) < 0.06 for ratio in started]
        + [abs(sine_lag(turn, x) / x - 1) < 0.06 for turn, x in zip(fast, taus, strict=True)]
        + [abs(lag("filtered", x) / x - 1) < 0.06 for x in result.rng.uniform(0.5, 5.0, 8) * dt],
    )
    result.correction_holds(
        all(
            abs(sine_lag(turn, x) - np.arctan(turn) * x / turn - dt / 2) < 0.5 * dt
            for turn, x in zip(fast, taus, strict=True)
        ),
        all(abs(lag("filtered", x) - x - dt / 2) < 1e-9 for x in taus / 20),
        lag("observer", tau) > 1.9 * lag("filtered", tau),
        # The part of the lag that has built up since the start.
        all(
            abs(ratio - (1.0 - np.exp(-after))) < 0.06
            for ratio, after in zip(started, early, strict=True)
        ),
    )


@claim(
    "With P alone, half of the ultimate gain leaves a gain margin of two.",
    "But it leaves little phase margin. For delays of {low:g} to {high:g} times J/b the "
    "smallest phase margin is {phase_deg:.0f} degrees, and a step overshoots by {least:.0%} "
    "to {most:.0%}.",
)
def half_the_ultimate_gain(result):
    from course.charts.control.limits import ziegler_nichols
    from course.control import sampled

    shares = np.geomspace(result.input("low", 0.01), result.input("high", 10), 5)
    rows = [ziegler_nichols("P", x) for x in shares]
    margins = [row.margins() for row in rows]
    over = [row.overshoot for row in rows]
    result.measure("phase_deg", np.degrees(min(m.phase for m in margins)), 1e-3)
    # The delay as long as the time constant J / b, for comparison: sampled as the rows are, and in
    # continuous time, where the loop with half of the ultimate gain crosses 1 at w.
    equal = ziegler_nichols("P", 1.0).margins()
    result.measure("equal_deg", np.degrees(equal.phase), 1e-3)
    crossing = 0.5 * sampled.delay_limit(1.0, 1.0, 1.0)[0]
    w = np.sqrt(0.5 * (np.sqrt(1.0 + 4.0 * crossing**2) - 1.0))
    smooth = np.pi / 2 - np.arctan(w) - w
    result.measure("smooth_deg", np.degrees(smooth), 1e-3)
    result.measure("least", min(over), 1e-3)
    result.measure("most", max(over), 1e-3)
    result.statement = "Margins of the row for P at five delays, and its steps."
    result.statement_holds(all(abs(m.gain - 2) < 1e-3 for m in margins))
    result.correction_holds(
        min(m.phase for m in margins) < 0.1,
        max(over) > 0.5,
        # Sampling a dozen times in the delay hardly changes the margin.
        abs(np.degrees(equal.phase - smooth)) < 1.0,
    )


@claim(
    "Without an I term and without a load, dry friction leaves an error of up to the static "
    "friction over kp.",
    "The error can be anything up to {formula}, with the static friction F. In {runs:.0f} random "
    "steps the largest was {worst:.1%} of that, and the median {median:.0%}. Where static "
    "friction exceeded Coulomb friction, some errors were larger than Coulomb friction over kp.",
    ask=(
        "A joint with the static friction F and no load comes to rest under PD with the gain kp. "
        "How far can it be from its target?",
        "e, error < F/kp",
        {
            "F*kp": "More gain pulls it nearer.",
            "2*F/kp": "It sticks on one side: what counts is one F.",
            "F": "A torque is no angle.",
        },
    ),
)
def friction_leaves_an_error(result):
    import sympy

    from course.control import Actuator, Encoder, Gains, Joint, run_joint

    F, kp, e = sympy.symbols("F kp e", positive=True)
    result.formula = sympy.solve(kp * e - F, e)[0]
    share, beyond = [], []
    for k in range(int(result.input("runs", 40))):
        friction, gain, ratio, target = result.rng.uniform([0.1, 5, 0.1, 0.2], [1, 60, 1.5, 1.5])
        gains = Gains(gain, 0.0, 2 * ratio * np.sqrt(0.5 * gain), rate="exact")
        # Every second joint slides with less friction than it holds at rest.
        sliding = friction * (result.rng.uniform(0.4, 0.9) if k % 2 else 1.0)
        joint = Joint(0.5, 0.1, 0.0, sliding, friction)
        run = run_joint(joint, Actuator(), Encoder(), gains, target, 1e-3, 12.0)
        allowed = float(result.formula.subs({F: friction, kp: gain}))
        share.append(abs(target - run.q[-1]) / allowed)
        if k % 2:
            beyond.append(share[-1] * friction > 1.01 * sliding)
    result.measure("worst", max(share), 1e-3)
    result.measure("median", np.median(share), 0.02)
    result.statement = "Steps of drawn joints and gains, with exact sticking."
    result.statement_holds(max(share) <= 1 + 1e-3)
    result.correction_holds(max(share) > 0.9, any(beyond))


@claim(
    "With its set-point inside a wall, an impedance controller without torque limit and dry "
    "friction presses, once at rest, as two springs in series would: its own and the wall's.",
    "The force is {formula}. A set-point {deep_mm:g} mm deep in a wall of {ke:.0e} "
    "N/m presses with {soft_n:.2f} N at a stiffness of {soft:g} N/m, and with {stiff_n:.1f} "
    "N at {stiff:g} N/m. The simulated runs agree to {worst:.0e}.",
    ask=(
        "An impedance controller of stiffness K has its set-point at the depth d in a wall of "
        "stiffness ke. With which force does it press at rest?",
        "F, force = d*K*ke/(K + ke)",
        {
            "d*K": "The wall gives way as well.",
            "d*(K + ke)": "They are in series, not side by side.",
            "d*ke": "That is without the give of the controller's own spring.",
        },
    ),
)
def wall_in_series(result):
    import sympy

    from course.control import Probe, TouchLaw, run_touch

    d, K, ke, x = sympy.symbols("d K ke x", positive=True)
    result.formula = sympy.factor(ke * sympy.solve(K * (d - x) - ke * x, x)[0])
    deep, wall = result.input("deep_mm", 20) / 1000, result.input("ke", 1e4)

    def pressed(stiffness, wall, deep):
        law = TouchLaw(stiffness, 2 * np.sqrt(stiffness * 4.0))
        probe = Probe(4.0, 20.0, wall, 50.0)
        return run_touch(probe, law, deep, 1e-3, 12.0, delay=1e-3).torque[-1]

    def theory(stiffness, wall, deep):
        return float(result.formula.subs({d: deep, K: stiffness, ke: wall}))

    result.measure("soft_n", pressed(result.input("soft", 500), wall, deep), 1e-3)
    result.measure("stiff_n", pressed(result.input("stiff", 4000), wall, deep), 1e-3)
    draws = np.exp(result.rng.uniform(*np.log([[50, 500, 1e-3], [5e3, 5e4, 0.05]]), (12, 3)))
    error = [abs(pressed(*row) / theory(*row) - 1) for row in draws]
    result.measure("worst", max(max(error), 1e-9), 0.5)
    result.statement = "Steady forces of the exact probe at drawn stiffnesses and depths."
    result.statement_holds(max(error) < 0.01)
    result.correction_holds(max(error) < 1e-4)
