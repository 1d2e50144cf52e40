"""Claims of chapter 6: what sampling, delay and the estimate of the rate cost."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "J": Symbol("inertia [kg m^2]", 1.0, 3.0),
    "b": Symbol("viscous friction [N m s/rad]"),
    "w": Symbol("angular frequency of the oscillation [rad/s]"),
    "T": Symbol("delay [s]"),
    # With these ranges, kd stays below 2 J/dt, where a stable kp exists.
    "kd": Symbol("rate gain [N m s/rad]", 0.1, 1.0),
    "dt": Symbol("sample time [s]", 0.1, 1.9),
    "c": Symbol("kd dt / (2 J)", 0.05, 0.9),
    "V": Symbol("kd dt / J", 0.05, 0.9),
}


def _growth(kp, kd, *, dt=1.0, delay=0.0, rate="exact", inertia=1.0, damping=0.0, tau=0.0):
    """Return growth per sample of PD on a joint."""
    from course.control import sampled

    plant = sampled.held(*sampled.joint_system(inertia, damping), dt, delay)
    law = sampled.pid_law(kp, 0.0, kd, dt=dt, rate=rate, tau=tau)
    return sampled.growth(sampled.loop_matrix(plant, law))


def _edge(kp, kd, **loop):
    """Return whether the loop is stable just inside of kp and grows just outside."""
    return _growth(kp * (1 - 1e-6), kd, **loop) <= 1 + 1e-9 < _growth(kp * (1 + 1e-5), kd, **loop)


@claim(
    "A joint with friction is stable under P control at any gain.",
    "That is true in continuous time without a delay. A held command is half a sample late. With w "
    "from w tan(w (D + dt/2)) = b/J the largest gain is {formula}: {held_n_m_per_rad:.0f} N m/rad "
    "for J = {inertia:g}, b = {damping:g} at {rate_hz:.0f} Hz, and {late_n_m_per_rad:.1f} "
    "with {delay_ms:g} ms of delay. The rule agrees with the eigenvalue of the exact loop to "
    "{worst:.1e} here. Without delay it is {coarse:.0%} off where a sample is as long as J/b.",
    ask=(
        "J q'' + b q' = -K q(t - T) oscillates for ever at the angular frequency w. What is K?",
        "K, gain = w*sqrt((J*w)^2 + b^2)",
        {
            "J*w^2": "That is without friction.",
            "w*(J*w + b)": "Inertia and friction are a right angle apart: add their squares.",
            "b/T": "That is the limit of a long delay only.",
        },
    ),
    source="G. F. Franklin, J. D. Powell, M. L. Workman, Digital Control, 1998, sec. 4.3",
)
def p_at_any_gain(result):
    import sympy

    from course.control import sampled

    J, b, w = sympy.symbols("J b w", positive=True)
    # K e^(-i w T) = J w^2 - i b w: its size is the gain, its angle the delay
    result.formula = sympy.simplify(sympy.sqrt((J * w**2) ** 2 + (b * w) ** 2))
    inertia, damping = result.input("inertia", 0.5), result.input("damping", 0.5)
    dt, late = 1 / result.input("rate_hz", 1000), result.input("delay_ms", 10) / 1000
    system = sampled.joint_system(inertia, damping)
    # Delays of whole and of fractional samples, short and long.
    gains = {D: sampled.ultimate_gain(*system, dt, D) for D in (0.0, dt, 3.7 * dt, late, 100 * dt)}
    result.measure("held_n_m_per_rad", gains[0.0][0])
    result.measure("late_n_m_per_rad", gains[late][0])
    theory = {D: sampled.delay_limit(inertia, damping, D + dt / 2) for D in gains}
    result.measure("worst", max(abs(gains[D][0] / theory[D][0] - 1) for D in gains), 0.01)
    coarse = sampled.ultimate_gain(*sampled.joint_system(1.0, 1.0), 1.0)[0]
    result.measure("coarse", coarse / sampled.delay_limit(1.0, 1.0, 0.5)[0] - 1, 0.01)
    edges = [
        _edge(gains[D][0], 0.0, dt=dt, delay=D, inertia=inertia, damping=damping) for D in gains
    ]
    result.statement = "Ultimate gain of the exact sampled joint at five delays."
    result.statement_holds(_growth(1e5, 0.0, dt=dt, inertia=inertia, damping=damping) <= 1)
    # Three routes: the matrix on both sides, the transcendental equation, and the closed form.
    result.correction_holds(
        all(edges),
        max(abs(gains[D][0] / theory[D][0] - 1) for D in gains) < 1e-4,
        all(
            abs(
                theory[D][0]
                / float(result.formula.subs({J: inertia, b: damping, w: 2 * np.pi / theory[D][1]}))
                - 1
            )
            < 1e-9
            for D in gains
        ),
    )


def _coefficients(open_loop):
    """Return coefficients of the closed loop's polynomial in z, from z^0 up, the last one 1."""
    import sympy

    z = sympy.Symbol("z")
    top, _ = sympy.fraction(sympy.cancel(sympy.together(1 + open_loop)))
    # Characteristic polynomial of the closed loop, made monic for Jury's conditions.
    poly = sympy.Poly(top, z)
    return [sympy.expand(c / poly.LC()) for c in reversed(poly.all_coeffs())]


def _held_inertia():
    """Return (z, torque to angle, torque to speed) of a free inertia, in units J = dt = 1."""
    import sympy

    z = sympy.Symbol("z")
    return z, (z + 1) / (2 * (z - 1) ** 2), 1 / (z - 1)


@claim(
    "PD on an inertia is stable for all positive gains.",
    "With a command held for dt, kp must stay below {formula} and kd below twice J/dt, even "
    "if angle and rate are exact. These gains form a triangle, whose tip is at kp = "
    "{tip:.0f} J/dt^2. P alone is unstable at any gain.",
    ask=(
        "A free inertia J under PD with the exact angle and rate; each command is held for dt. "
        "What is the largest stable kp for a given kd < 2 J/dt?",
        "kp < 2*kd/dt",
        {
            "4*J/dt^2": "That is the tip of the triangle, where kd = 2 J/dt.",
            "kd^2/(4*J)": "That is critical damping, not the limit.",
            "kd/dt": "A hold is half a sample late, not a whole one.",
        },
    ),
)
def pd_exact_rate(result):
    import sympy

    from course.control import sampled

    kp, V, J, kd, dt = sympy.symbols("kp V J kd dt", positive=True)
    _, angle, speed = _held_inertia()
    # Jury for second order: the product of the roots below 1, and no root at -1.
    product, middle, _ = _coefficients(kp * angle + V * speed)
    limit = sympy.solve(sympy.Eq(product, 1), kp)[0]  # in units of J / dt^2
    result.formula = limit.subs(V, kd * dt / J) * J / dt**2
    draws = result.rng.uniform(0.05, 1.95, 20)
    highest = sympy.solve(sympy.Eq(1 - middle + product, 0), V)[0]
    result.measure("tip", limit.subs(V, highest))
    result.statement = "Jury's conditions, and the loop's matrix at twenty gains on both sides."
    result.statement_holds(max(_growth(3 * V, V) for V in draws) <= 1)
    result.correction_holds(
        all(_edge(sampled.pd_limit(V, 1, 1), V) for V in draws),
        all(abs(sampled.pd_limit(v, 1, 1) - float(limit.subs(V, v))) < 1e-12 for v in draws),
        _growth(1e-3, float(highest) + 1e-3) > 1,
        # Even a tiny P grows without D: a hold is a delay.
        _growth(1e-6, 0.0) > 1,
    )


@claim(
    "Computing the rate as the difference of the last two angles adds noise, but leaves the "
    "stability limits unchanged.",
    "The difference is half a sample late. With c = kd dt/J/2, kp dt^2/J/2 must stay below "
    "{formula}. The largest stable kp falls from {exact_tip:.0f} to {tip:.3f} J/dt^2.",
    ask=(
        "The same joint, but the rate is the difference of the last two angles over dt. What is "
        "the largest stable p = kp dt^2/(2 J) in terms of c = kd dt/(2 J)?",
        "p < 2*c*(1 - c)/(1 + c)",
        {
            "2*c": "That is with the exact rate.",
            "2*c*(1 - c)": "kp sees that delay as well: divide by 1 + c.",
            "2*c/(1 + c)": "Then no kd would be too large.",
        },
    ),
)
def pd_difference(result):
    import sympy

    from course.control import sampled

    p, c = sympy.symbols("p c", positive=True)
    z, angle, _ = _held_inertia()
    a0, a1, a2, _ = _coefficients(2 * (p + c * (z - 1) / z) * angle)
    # Jury's condition for third order: 1 - a0^2 = a1 - a0 a2 on the edge.
    limit = sympy.solve(sympy.Eq(1 - a0**2, a1 - a0 * a2), p)[0]
    result.formula = sympy.factor(limit)
    best = sympy.solve(sympy.diff(limit, c), c)
    tip = max(float(2 * limit.subs(c, x)) for x in best if x > 0)
    result.measure("tip", tip)
    result.measure("exact_tip", sampled.pd_limit(2 - 1e-12, 1, 1))
    draws = result.rng.uniform(0.05, 1.95, 20)
    result.statement = "Jury's last condition, and the loop's matrix on both sides of it."
    result.statement_holds(all(_edge(2 * V, V, rate="filtered") for V in draws))
    result.correction_holds(
        all(_edge(sampled.pd_limit(V, 1, 1, "difference"), V, rate="filtered") for V in draws),
        all(
            abs(sampled.pd_limit(2 * x, 1, 1, "difference") - 2 * float(limit.subs(c, x))) < 1e-12
            for x in draws / 2
        ),
        abs(tip - 4 * float(sympy.sqrt(2) - 1) ** 2) < 1e-12,
    )


@claim(
    "At a kilohertz, a command that comes one sample late costs little.",
    "In units of J/dt^2 it costs the same at every rate. With V = kd dt/J, P = kp dt^2/J/2 "
    "must stay below {formula}. The largest stable kp falls from {exact_tip:.0f} to "
    "{tip:.2f} J/dt^2, and to {both:.3f} if the rate is a difference as well.",
    ask=(
        "PD with the exact angle and rate, but each command comes one sample late. What is the "
        "largest stable P = kp dt^2/(2 J) in terms of V = kd dt/J?",
        "P < (2*V - 3 + sqrt(9 - 8*V))/2",
        {
            "V": "That is without the delay.",
            "V/3": "That is the beginning of it, for small V.",
            "2*V - 3 + sqrt(9 - 8*V)": "That is kp dt^2/J, twice P.",
        },
    ),
)
def pd_sample_late(result):
    import sympy

    from course.control import sampled

    P, V = sympy.symbols("P V", positive=True)
    z, angle, speed = _held_inertia()
    a0, a1, a2, _ = _coefficients((2 * P * angle + V * speed) / z)
    roots = sympy.solve(sympy.Eq(1 - a0**2, a1 - a0 * a2), P)  # Jury's last condition
    limit = max(roots, key=lambda r: float(r.subs(V, sympy.Rational(1, 2))))
    result.formula = limit
    draws = result.rng.uniform(0.02, 0.98, 20)
    result.measure("exact_tip", sampled.pd_limit(2 - 1e-12, 1, 1))
    result.measure("tip", sampled.pd_limit(0.625, 1, 1, "late"))
    # The best rate gain is searched: the tip of the stable region.
    grid = np.linspace(0.3, 0.6, 61)
    both = max(
        _largest_gain(lambda k, v=v: _growth(k, v, delay=1.0, rate="filtered"), 1.0) for v in grid
    )
    result.measure("both", both, 1e-3)
    result.statement = "Jury's last condition, and the loop's matrix on both sides of it."
    result.statement_holds(
        sampled.pd_limit(0.625, 1, 1, "late") > sampled.pd_limit(0.625, 1, 1) / 2
    )
    result.correction_holds(
        all(_edge(sampled.pd_limit(V, 1, 1, "late"), V, delay=1.0) for V in draws),
        all(
            _edge(1e6 * sampled.pd_limit(V, 1, 1, "late"), 1e3 * V, dt=1e-3, delay=1e-3)
            for V in draws
        ),
        max(sampled.pd_limit(V, 1, 1, "late") for V in draws) <= 0.25,
    )


def _largest_gain(growth, high, low=0.0):
    """Return the largest gain below `high` at which a growth stays within 1."""
    # Bisection to rounding.
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if growth(middle) <= 1 + 1e-10 else (low, middle)
    return low


@claim(
    "A first-order Pade approximation of the delay is good enough for any stability limit.",
    "It replaces e^(-s D) by (1 - s D/2)/(1 + s D/2), so that the loop has a polynomial. It is "
    "good only if the delay's phase lag is small at the limit. For a PD loop that is "
    "limited by its rate gain, where this lag is {turned:.2f} rad, the first-order "
    "approximation allows {first:.0%} too much gain and the second-order one {second:.1%}. "
    "For P it is within {slow:.1e} where friction is small and the oscillation therefore "
    "slow. It allows {heavy:.0%} too much where friction is large.",
)
def pade_is_enough(result):
    delay, turned = 1.0, result.input("turned", 1.55)
    ratio = np.tan(turned) / turned  # kd / kp with which the loop swings at w = turned / delay

    def pade(order, kp, kd, damping=0.0):
        """Return whether all roots decay with the approximation."""
        below = {1: [delay / 2, 1], 2: [delay**2 / 12, delay / 2, 1]}[order]
        above = [c * (-1) ** (len(below) - 1 - i) for i, c in enumerate(below)]
        poly = np.polyadd(np.polymul([1, damping, 0], below), np.polymul([kd, kp], above))
        return 1.0 if np.max(np.roots(poly).real) <= 1e-12 else 2.0

    dt = delay / 60
    loop = {"dt": dt, "delay": delay - dt / 2}  # a hold is the other half sample
    # 60 samples a delay, so that the hold is negligible beside it.
    exact = _largest_gain(lambda k: _growth(k, k * ratio, **loop), 5.0)
    first, second = (
        _largest_gain(lambda k, n=n: pade(n, k, k * ratio), 5.0) / exact - 1 for n in (1, 2)
    )
    slow, heavy = (
        _largest_gain(lambda k, b=b: pade(1, k, 0.0, b), 200.0)
        / _largest_gain(lambda k, b=b: _growth(k, 0.0, damping=b, **loop), 200.0)
        - 1
        for b in (0.05, 50.0)
    )
    result.measure("first", first, 0.02)
    result.measure("second", second, 0.05)
    result.measure("slow", abs(slow), 0.3)
    result.measure("heavy", heavy, 0.02)
    result.statement = "The loop's matrix at 60 samples a delay against the approximations' roots."
    result.statement_holds(first < 0.05)
    result.correction_holds(first > 0.2, 0.0 < second < 0.02, abs(slow) < 0.005, heavy > 0.2)


@claim(
    "Too much D only makes a joint sluggish.",
    "At first it does: the settling time rises from {fast_s:.2f} s at kd = {light:g} to "
    "{slow_s:.1f} s at kd = {heavy:g}. Then the joint shakes. With a backward difference for "
    "the rate and {late_ms:g} ms of delay the loop is unstable above {edge:.0f} N m s/rad, "
    "where it oscillates at {hertz:.0f} Hz.",
)
def too_much_d(result):
    from course.control import Actuator, Encoder, Gains, Joint, run_joint, step_metrics

    joint, dt, late = Joint(0.5, 0.5), 0.001, result.input("late_ms", 2) / 1000
    heavy, light = result.input("heavy", 60), result.input("light", 4)

    def run(kd, seconds=20.0):
        record = run_joint(
            joint, Actuator(delay=late), Encoder(), Gains(20, 0, kd), 1.0, dt, seconds
        )
        return record, step_metrics(record.times, record.q, 1.0)

    slow, fast = (run(kd)[1].settling for kd in (heavy, light))
    edge = _largest_gain(
        lambda kd: _growth(20, kd, dt=dt, delay=late, rate="filtered", inertia=0.5, damping=0.5),
        1e4,
    )
    swing = run(1.02 * edge, 1.0)[0].v[500:]
    turns = np.count_nonzero(np.diff(np.sign(swing))) / 2 / (swing.size * dt)
    result.measure("slow_s", slow)
    result.measure("fast_s", fast)
    result.measure("edge", edge)
    result.measure("hertz", turns, 0.02)
    result.statement = "A step of 1 rad with kp = 20, and the loop's matrix."
    result.statement_holds(
        max(
            _growth(20, kd, dt=dt, delay=late, rate="filtered", inertia=0.5, damping=0.5)
            for kd in (2 * edge, 10 * edge)
        )
        <= 1
    )
    result.correction_holds(
        slow > 4 * fast,
        run(0.98 * edge, 2.0)[1].overshoot < 1,
        run(1.05 * edge)[1].settling > 19,
        20 < turns < 500,
    )


@claim(
    "An encoder makes the torque ripple by kp times one count.",
    "The rate contributes most of the ripple. A count that flickers moves the D torque by at "
    "most 2 kd count/(tau + dt) from peak to peak, in addition to kp times the count. For "
    "{bits:.0f} bits, a difference at {rate_hz:.0f} Hz and kd = {kd:g} the D torque moves by "
    "up to {bound_n_m:.2f} N m. A joint at rest shows {measured_n_m:.2f} N m in all, and "
    "{filtered_n_m:.3f} N m with a filter of {tau_ms:.0f} ms.",
)
def encoder_ripple(result):
    from course.control import Actuator, Encoder, Gains, Joint, run_joint

    dt, kp, kd = 1 / result.input("rate_hz", 1000), 20.0, result.input("kd", 2.0)
    bits = int(result.input("bits", 12))
    line = Encoder(bits).line

    def ripple(tau, kd=kd, target=0.3, bits=bits):
        gains = Gains(kp, 0.0, kd, tau)
        run = run_joint(
            Joint(0.05, 0.1, 0.4),
            Actuator(delay=dt),
            Encoder(bits, 0.2 * line),
            gains,
            target,
            dt,
            3.0,
        )
        return np.ptp(run.command[2000:]), np.ptp(run.measured[2000:]) < 1.5 * line

    tau = result.input("tau_ms", 10) / 1000
    plain, soft = result.measure("measured_n_m", ripple(0.0)[0], 0.02), ripple(tau)[0]
    result.measure("bound_n_m", 2 * kd * line / dt)
    result.measure("filtered_n_m", soft, 0.02)
    draws = [
        (line * (2 * kd / (tau + dt) + kp), *ripple(tau, kd, target))
        for tau, kd, target in zip(
            result.rng.uniform(0, 0.02, 8),
            result.rng.uniform(0.5, 3, 8),
            result.rng.uniform(0.1, 1, 8),
            strict=True,
        )
    ]
    result.statement = (
        "The last second of a step with a load, the encoder's noise a fifth of a count."
    )
    result.statement_holds(plain < 3 * kp * line)
    result.correction_holds(
        all(size <= bound * (1 + 1e-9) for bound, size, flickers in draws if flickers),
        sum(flickers for *_, flickers in draws) > 3,
        # A line of our own: an encoder on another grid is noticed.
        1.5 < plain / (kd / dt * 2 * np.pi / 2**bits) < 2 * (1 + kp * dt / kd),
        soft < plain / 5,
    )
