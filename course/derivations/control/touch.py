"""Claims of chapter 6: one mass and a wall."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "m": Symbol("mass of the arm [kg]"),
    "b": Symbol("the arm's own friction [N s/m]"),
    "ke": Symbol("stiffness of the wall [N/m]"),
    "K": Symbol("stiffness of the controller [N/m]"),
    "D": Symbol("delay [s]"),
    "dt": Symbol("sample time [s]"),
    "v": Symbol("speed at touch [m/s]"),
}
WALLS = np.geomspace(1e2, 1e6, 9)  # N/m


def _damping_ratio(stiffness, damping, wall, mass=4.0):
    """Return damping ratio of a law in contact, from the poles of the loop at a megahertz."""
    from course.control import Probe, TouchLaw, sampled

    probe, dt = Probe(mass, 0.0, wall), 1e-6
    law = TouchLaw(stiffness, damping).linear(probe, dt)
    roots = np.linalg.eigvals(sampled.loop_matrix(sampled.held(*probe.system(), dt), law)).astype(
        complex
    )
    poles = np.log(roots) / dt
    return float(-np.sum(poles.real) / 2 / np.sqrt(np.abs(np.prod(poles))))


@claim(
    "A force loop needs no more care than a position loop: raise its gain until it is fast.",
    "The wall's stiffness multiplies its gain. With P on the measured force the loop's "
    "stiffness is the gain times ke, and only the arm's own friction damps it. While the "
    "delay is short compared with the oscillation, the largest gain is {formula}. At "
    "{ke:.0e} N/m it is {hard:.3f} for an arm with b = {b:g} N s/m and {delay_ms:.0f} ms of "
    "delay. At {stiff:.0e} N/m, where the oscillation is fast, the formula is {off:.0%} too "
    "low.",
    ask=(
        "m x'' + b x' + ke x = -g ke x(t - D), held for dt, and the delay is short compared with "
        "the oscillation. What is the largest stable g?",
        "g < b/(ke*(D + dt/2))",
        {
            "b/(ke*D)": "The hold is half a sample of delay more.",
            "b/(D + dt/2)": "That is the stiffness g ke: divide by the wall's.",
            "b/(ke*(D + dt))": "A hold is half a sample late, not a whole one.",
        },
    ),
)
def force_gain_is_free(result):
    import sympy

    from course.charts.control import touch
    from course.control import sampled

    b, ke, D, dt, g, w, T = sympy.symbols("b ke D dt g w T", positive=True)
    # At the limit the loop oscillates at w. The imaginary part of its equation, with the total
    # delay T (dead time D and half a hold dt), says b w = g ke sin(w T); w T is small.
    balance = b * w - g * ke * sympy.series(sympy.sin(w * T), w, 0, 2).removeO()
    result.formula = sympy.solve(balance, g)[0].subs(T, D + dt / 2)
    late, wall = result.input("delay_ms", 2) / 1000, result.input("ke", 1e5)
    friction = result.input("b", 20)
    assert friction == touch.ARM.damping
    theory = [sampled.force_limit(friction, k, late + touch.DT / 2) for k in WALLS[:7]]
    exact = [touch.force_edge(k, late) for k in WALLS[:7]]
    result.measure("hard", touch.force_edge(wall, late))
    stiff = result.input("stiff", 1e6)
    # At this wall the oscillation is fast, so that the formula's small w T no longer holds.
    formula, edge = (
        sampled.force_limit(friction, stiff, late + touch.DT / 2),
        touch.force_edge(stiff, late),
    )
    result.measure("off", 1 - formula / edge, 1e-2)
    result.statement = "Largest gain by the loop's matrix, at walls of 100 N/m to 100 kN/m."
    result.statement_holds(min(exact) > 0.5)
    result.correction_holds(
        all(-1e-6 < x / t - 1 < 0.05 for x, t in zip(exact, theory, strict=True)),
        exact[0] > 100 * exact[-1],
    )


@claim(
    "For an impedance controller without damping, the largest stable stiffness depends mainly "
    "on the wall.",
    "It depends mainly on friction and delay. Any stiffness up to {formula} is stable at every "
    "passive wall. For a friction b of {b:g} N s/m at {rate_hz:.0f} Hz that bound is {bound:.0f} "
    "N/m, and {late:.0f} N/m with {delay_ms:.0f} ms of delay. At walls from {soft:.0e} to "
    "{stiff:.0e} N/m the exact limit is at most {spread:.0%} above the bound without delay. With "
    "the delay it is at most {late_soft:.0%} above it up to {middle:.0e} N/m, and "
    "{late_stiff:.0%} at the stiffest wall.",
    ask=(
        "An arm with friction b is controlled as a spring of stiffness K. Commands are held for dt "
        "and come D late. The controller has no damping. Up to which K does passivity guarantee "
        "stability at every passive wall?",
        "K < 2*b/(dt + 2*D)",
        {
            "2*b/dt": "The delay counts as well, and double: a hold is half a sample.",
            "b/(dt + D)": "A hold is half a sample late, not a whole one.",
            "b/(dt + 2*D)": "That is half of it: b over dt/2 + D.",
        },
    ),
    source="J. E. Colgate, G. G. Schenkel, Passivity of a class of sampled-data systems, 1997",
)
def stiffness_depends_on_the_wall(result):
    import sympy

    from course.charts.control import touch
    from course.control import sampled

    b, D, hold, K = sympy.symbols("b D dt K", positive=True)
    result.formula = sympy.together(sympy.solve(K * (D + hold / 2) - b, K)[0])
    friction = result.input("b", 20)
    dt, late = 1 / result.input("rate_hz", 1000), result.input("delay_ms", 2) / 1000
    assert (friction, dt) == (touch.ARM.damping, touch.DT)
    result.measure("bound", sampled.passive_stiffness(friction, dt))
    result.measure("late", sampled.passive_stiffness(friction, dt, late))
    limits = {D: np.array([touch.stiffest(k, D) for k in WALLS]) for D in (0.0, late)}
    bounds = {D: sampled.passive_stiffness(friction, dt, D) for D in limits}
    soft, middle, stiff = (
        result.input(name, wall)
        for name, wall in (("soft", WALLS[0]), ("middle", WALLS[6]), ("stiff", WALLS[-1]))
    )
    assert (soft, stiff) == (WALLS[0], WALLS[-1])
    above = {D: limits[D] / bounds[D] - 1 for D in limits}
    result.measure("spread", np.max(above[0.0]), 0.05)
    result.measure("late_soft", np.max(above[late][WALLS <= 1.001 * middle]), 0.05)
    result.measure("late_stiff", above[late][-1], 0.05)
    result.statement = "Largest stiffness by the loop's matrix at nine walls."
    result.statement_holds(any(np.ptp(limits[D]) > 0.5 * bounds[D] for D in limits))
    result.correction_holds(
        all(np.all(limits[D] > bounds[D]) for D in limits),
        all(np.max(limits[D][:5]) < 1.05 * bounds[D] for D in limits),
        all(
            abs(float(result.formula.subs({b: friction, hold: dt, D: x})) / bounds[x] - 1) < 1e-9
            for x in bounds
        ),
    )


@claim(
    "With enough damping in its impedance controller, an arm is stable at a wall with any "
    "stiffness of the controller.",
    "Damping raises the limit only up to a point, and less with a delay. At a wall of {soft:.0e} "
    "N/m the best active damping raises the largest stable stiffness from {own:.0f} to "
    "{active:.1e} N/m, the tip of the triangle of stable PD gains. With {delay_ms:.0f} ms of delay "
    "it reaches {late_soft:.1e} N/m there and {late_hard:.1e} N/m at a wall of {hard:.0e} N/m. "
    "With that delay, a damping of {too_much:.0f} N s/m is unstable even with next to "
    "no stiffness.",
)
def damping_is_safe(result):
    from course.charts.control import touch

    late = result.input("delay_ms", 2) / 1000
    soft, hard = result.input("soft", 1e2), result.input("hard", 1e6)
    own, active = touch.stiffest(soft, 0.0), touch.stiffest_damped(soft, 0.0)
    late_soft, late_hard = (touch.stiffest_damped(k, late) for k in (soft, hard))

    def held(damping):
        return touch.growth(touch.TouchLaw(1.0, damping), 1e4, late) <= 1 + 1e-9

    edge = next(d for d in np.geomspace(100, 1e5, 400) if not held(d))
    result.measure("own", own)
    result.measure("active", active, 0.01)
    result.measure("late_soft", late_soft, 0.01)
    result.measure("late_hard", late_hard, 0.01)
    result.measure("too_much", edge, 0.02)
    result.statement = "Largest stiffness by the loop's matrix, the damping varied."
    # Ten times the best limit, without delay: some damping would have to make this stable.
    stiff = [
        touch.growth(touch.TouchLaw(10.0 * active, float(d)), soft, 0.0) <= 1 + 1e-9
        for d in np.geomspace(20, 1e5, 100)
    ]
    result.statement_holds(any(stiff))
    result.correction_holds(
        active > 50 * own,
        # The largest Kp of the triangle of PD gains with the exact rate.
        abs(active * touch.DT**2 / (4.0 * touch.ARM.mass) - 1) < 0.02,
        late_hard < late_soft / 3,
        not held(2 * edge),
        held(0.5 * edge),
    )


@claim(
    "Admittance control can make an arm feel as light as you like.",
    "In free space it can. At a wall, the smallest stable virtual mass grows with the wall's "
    "stiffness: {soft:.1e} kg at {soft_wall:.0e} N/m, {middle:.2f} kg at {middle_wall:.0e} "
    "N/m, and {hard:.1f} kg at {hard_wall:.0e} N/m, nearly the arm's own {own:.0f} kg. The "
    "virtual damping is low here. Ten times that damping, which a hand also feels, reduces "
    "the last value to {damped:.1f} kg.",
)
def admittance_is_light(result):
    from course.charts.control import touch

    names = ("soft_wall", "middle_wall", "hard_wall")
    walls = [result.input(n, k) for n, k in zip(names, (1e2, 1e3, 1e5), strict=True)]
    soft, middle, hard = (touch.lightest(k) for k in walls)
    result.measure("soft", soft, 0.02)
    result.measure("middle", middle, 0.02)
    result.measure("hard", hard, 0.02)
    damped = result.measure("damped", touch.lightest(walls[2], damping=10.0), 0.02)
    result.measure("own", touch.ARM.mass * float(np.sign(hard)))
    result.statement = "Least stable virtual mass by the loop's matrix, over a stiff inner loop."
    result.statement_holds(hard < 0.1)
    result.correction_holds(
        soft < 0.01 < middle < 1 < hard < touch.ARM.mass,
        damped < hard / 2,
        np.all(np.diff([touch.lightest(k) for k in WALLS[2:]]) > 0),
    )


@claim(
    "Vibration at contact: reduce the stiffness.",
    "This fixes a loop whose stiffness is too high: that of an impedance controller, or of "
    "the inner loop of admittance control. A force loop vibrates because of its gain on the "
    "force, which a lower stiffness does not touch. Admittance control also vibrates if its "
    "virtual mass is too small.",
)
def vibration_needs_softness(result):
    from course.charts.control import touch
    from course.control import TouchLaw

    edge = 2 * touch.stiffest(1e4)
    gain = 2 * touch.force_edge(1e4)
    light = touch.lightest(1e4, touch.DELAY) / 3

    def calmed(law, wall=1e4):
        """Return whether a twentieth of the stiffness stops a loop that vibrates."""
        from dataclasses import replace

        soft = replace(law, stiffness=law.stiffness / 20, hold=law.hold / 20)
        return touch.growth(law, wall) > 1 >= touch.growth(soft, wall) - 1e-9

    force = TouchLaw(200.0, 0.0, force_gain=gain)
    give = TouchLaw(4e4, 800.0, mass=light, give=1.0, hold=2000.0)
    result.measure("growth_force", touch.growth(force, 1e4))
    result.measure("growth_admittance", touch.growth(give, 1e4))
    result.measure("growth_impedance", touch.growth(TouchLaw(edge), 1e4))
    result.statement = (
        "Growth per sample at a wall of 10 kN/m, and with a twentieth of the stiffness."
    )
    result.statement_holds(
        calmed(force) and calmed(give),
        only_if="what is too high is a stiffness, that of an impedance controller or of an inner "
        "loop",
        inside=[
            calmed(TouchLaw(x * edge), k)
            for x, k in zip(
                result.rng.uniform(1, 5, 8), result.rng.uniform(1e3, 1e5, 8), strict=True
            )
        ]
        + [
            calmed(TouchLaw(x, 800.0, mass=8.0, give=400.0))
            for x in result.rng.uniform(4e5, 8e5, 8)
        ]
        # Chosen to break it: soft and hard walls, with active damping that moves the limit.
        + [
            calmed(TouchLaw(x * touch.stiffest(k, damping=d), d), k)
            for x, k, d in zip(
                result.rng.uniform(1.05, 15.0, 6),
                (1e2, 1e2, 1e4, 1e4, 1e6, 1e6),
                (100.0, 2000.0, 100.0, 2000.0, 100.0, 800.0),
                strict=True,
            )
        ],
        outside=[calmed(force), calmed(give)]
        + [calmed(TouchLaw(100.0, 0.0, force_gain=x * gain)) for x in result.rng.uniform(1, 4, 6)],
    )
    result.correction_holds(
        touch.growth(force, 1e4) > 1,
        touch.growth(give, 1e4) > 1,
        touch.growth(TouchLaw(0.0, 0.0, force_gain=gain), 1e4) > 1,
    )


@claim(
    "B = 2 sqrt(K M) gives critical damping in contact.",
    "In free space it does. In contact, the wall's stiffness adds to the controller's, and "
    "the damping ratio is {formula}, {ratio:.2f} for K = {K:g} at {ke:.0e} N/m. Critical "
    "damping there needs B = 2 sqrt((K + ke) M), {needed:.0f} N s/m instead of {said:.0f}, "
    "if the delay allows it.",
    ask=(
        "M x'' + B x' + (K + ke) x = 0 with B = 2 sqrt(K M): what is the damping ratio?",
        "zeta = sqrt(K/(K + ke))",
        {
            "1": "That is in free space, without ke.",
            "K/(K + ke)": "The ratio scales with the square root of the stiffness.",
            "sqrt(K/ke)": "Both springs act at once.",
        },
    ),
)
def critical_in_contact(result):
    import sympy

    M, K, ke = sympy.symbols("M K ke", positive=True)
    result.formula = sympy.simplify(2 * sympy.sqrt(K * M) / (2 * sympy.sqrt((K + ke) * M)))
    stiff, wall, mass = result.input("K", 100.0), result.input("ke", 1e4), 4.0
    text, needed = (2 * float(sympy.sqrt(x * mass)) for x in (stiff, stiff + wall))
    result.measure("ratio", _damping_ratio(stiff, text, wall), 1e-3)
    result.measure("needed", needed)
    result.measure("said", text)
    draws = 10 ** result.rng.uniform([1.5, 2], [3.5, 6], (8, 2))
    ratios = [_damping_ratio(k, 2 * np.sqrt(k * mass), w) for k, w in draws]
    result.statement = "Poles of the law and the wall at a megahertz, eight drawn pairs."
    result.statement_holds(min(ratios) > 0.9)
    result.correction_holds(
        all(
            abs(r / float(result.formula.subs({K: k, ke: w})) - 1) < 5e-3
            for r, (k, w) in zip(ratios, draws, strict=True)
        ),
        abs(_damping_ratio(stiff, needed, wall) - 1) < 0.01,
    )


@claim(
    "A stiff controller hurts people; a compliant one gives way.",
    "Not at the first impact with something harder than the controller's spring. Before the "
    "controller has moved anything, the arm's mass meets the body's stiffness, and the peak "
    "is {formula}: {peak_n:.0f} N for {mass:g} kg at {speed:g} m/s into {ke:.0e} N/m. A "
    "stiffness of {soft_k:g} instead of {stiff_k:g} N/m changes it by {change:.1%}, if the "
    "set-point moves in with the hand. If it waits {deep_mm:g} mm inside, the stiff controller's "
    "peak is {fixed:.0%} higher without damping, and {damped:.0%} lower with critical damping. "
    "What falls is the force held afterwards, from {held_stiff:.0f} to {held_soft:.1f} N. A "
    "controller stiffer than the body has no separate impact: it pushes the hand in until the "
    "set-point stops, and one twice as stiff peaks {harder:.0%} higher.",
    ask=(
        "A mass m meets a spring ke at the speed v, nothing else acts. The largest force?",
        "F, peak = v*sqrt(m*ke)",
        {
            "m*v*ke": "Energy: m v^2/2 = F^2/(2 ke).",
            "v*sqrt(m*ke)/2": "Both energies carry the half.",
            "sqrt(m*ke)": "It grows with the speed.",
        },
    ),
    source="S. Haddadin, A. Albu-Schaeffer, G. Hirzinger, Requirements for safe robots, 2009",
)
def stiff_control_hurts(result):
    import sympy

    from course.control import Probe, TouchLaw, run_touch

    m, ke, v, F = sympy.symbols("m ke v F", positive=True)
    result.formula = sympy.solve(m * v**2 / 2 - F**2 / (2 * ke), F)[0]
    mass, speed, wall = (
        result.input("mass", 4.0),
        result.input("speed", 0.5),
        result.input("ke", 1e5),
    )

    deep = result.input("deep_mm", 20.0) / 1000

    def run(stiffness, wall=wall, ratio=0.1, waits=False):
        """Return (first peak, force held) [N].

        The set-point moves in with the hand and stops deep in the wall, or waits there.
        """
        aim = np.minimum(speed * 1e-3 * np.arange(12_000), deep)
        aim = np.full_like(aim, deep) if waits else aim
        law = TouchLaw(stiffness, 2 * ratio * np.sqrt(stiffness * mass))
        probe = Probe(mass, 0.0, wall, 40.0)
        force = run_touch(probe, law, aim, 1e-3, 12.0, start=(0.0, speed)).torque
        return force[np.argmax(np.diff(force) < 0)], np.mean(force[-500:])

    stiff, soft = run(result.input("stiff_k", 2000.0)), run(result.input("soft_k", 20.0))
    hard = run(2e4, 1e4)[0] / run(20.0, 1e4)[0] - 1
    theory = float(result.formula.subs({m: mass, ke: wall, v: speed}))
    result.measure("peak_n", theory)
    result.measure("change", abs(stiff[0] / soft[0] - 1), 0.05)
    result.measure("harder", hard, 0.02)
    fixed, damped = (
        run(2000.0, ratio=ratio, waits=True)[0] / run(20.0, ratio=ratio, waits=True)[0] - 1
        for ratio in (0.0, 1.0)
    )
    result.measure("fixed", fixed, 0.02)
    result.measure("damped", -damped, 0.02)
    result.measure("held_stiff", stiff[1], 0.02)
    result.measure("held_soft", soft[1], 0.05)
    result.statement = "The exact probe at 1 kHz, a law of 2000 and of 20 N/m."
    result.statement_holds(soft[0] < 0.5 * stiff[0])
    result.correction_holds(
        abs(soft[0] / theory - 1) < 0.1,
        abs(stiff[0] / theory - 1) < 0.1,
        soft[1] < stiff[1] / 20,
        hard > 0.5,
        # Even a set-point that waits inside hardly shows in the peak.
        max(abs(fixed), abs(damped)) < 0.15,
    )


@claim(
    "The impedance controller commands F = M x'' + B x' + K (x - x0).",
    "That is the external force that moves such an arm. The controller's command has the "
    "opposite sign. With the printed sign the stiffness pushes away from x0, and the motion "
    "grows {wrong:.4f} times per sample. With the sign reversed it decays, {right:.4f} times "
    "per sample.",
)
def impedance_sign(result):
    from course.control import sampled

    def growth(sign, K, B):
        plant = sampled.held(*sampled.joint_system(4.0, 20.0), 1e-3)
        law = sampled.pid_law(1.0, 0.0, 1.0, dt=1e-3, rate="exact")
        law = sampled.Law(law.A, law.B, law.C, sign * np.array([K, B]))
        return sampled.growth(sampled.loop_matrix(plant, law))

    result.measure("wrong", growth(1, 200.0, 50.0))
    result.measure("right", growth(-1, 200.0, 50.0))
    draws = result.rng.uniform([50, 10], [2000, 200], (8, 2))
    result.statement = "Growth per sample in free space with both signs, at drawn gains."
    result.statement_holds(growth(1, 200.0, 50.0) < 1)
    result.correction_holds(all(growth(1, K, B) > 1 > growth(-1, K, B) for K, B in draws))
