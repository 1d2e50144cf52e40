"""Claims on force against gap: what the law says, what follows, what is differentiable."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    # The ranges obey the law: the spring alone does not hold the mass, and what touches approaches.
    "m": Symbol("mass [kg]", 0.9, 10.0),
    "g": Symbol("gravity [m/s^2]", 5.0, 15.0),
    "k": Symbol("stiffness of a spring that holds it [N/m]", 0.5, 10.0),
    "c": Symbol("distance from the spring's rest position down to the ground [m]", 0.01, 0.4),
    "h": Symbol("step [s]", 0.001, 0.1),
    "v": Symbol("separating velocity of the contact before the step [m/s]", -5.0, -0.1),
    "a": Symbol("its acceleration without contact [m/s^2]", -15.0, -0.1),
}
RIGID = ("lcp", "pgs", "coulomb", "convex")


def _ball(gap, speed, dt):
    """Return one step of a ball of 1 kg at this gap [m] with this upward speed [m/s]."""
    from course.contact import scenes

    return scenes.ball_drop().problem(dt, np.array([gap]), np.array([speed]))


@claim(
    "At a contact the velocity jumps.",
    "However short the step, a rigid contact has taken the whole approach speed at its end. "
    "A spring, a damper or MuJoCo's soft contact changes the velocity over a certain "
    "time, so a short step changes it only a little: by {soft_share:.1%} of the approach speed in "
    "{dt_us:.0f} us.",
)
def contact_velocity_jumps(result):
    from course.contact import solve

    dt = result.input("dt_us", 100.0) * 1e-6

    def lost(model, speed, step):
        v = solve(model, _ball(-1e-9, -speed, step)).velocity[0]
        return (v + speed) / speed > 0.5

    # Steps over three decades: a velocity that jumps must do so however short the step is.
    speeds, steps = result.rng.uniform(0.5, 3.0, 8), 10 ** result.rng.uniform(-7, -4, 8)
    soft = solve("soft", _ball(-1e-9, -1.0, dt)).velocity[0] + 1.0
    result.measure("soft_share", soft, tolerance=1e-3)
    result.statement = f"A ball at 1 m/s, a step of {dt:g} s: the soft model takes {soft:.4f} m/s."
    result.statement_holds(
        lost("soft", 1.0, dt),
        only_if="the bodies are rigid",
        inside=[lost(m, *row) for m in RIGID for row in zip(speeds, steps, strict=True)],
        outside=[
            lost(m, *row) for m in ("soft", "penalty") for row in zip(speeds, steps, strict=True)
        ],
    )
    # A smooth force changes the velocity in proportion to the step.
    shorter = solve("soft", _ball(-1e-9, -1.0, 0.1 * dt)).velocity[0] + 1.0
    result.correction_holds(abs(shorter / soft - 0.1) < 0.02)


@claim(
    "Exactly one of contact force and gap is zero at any time.",
    "For rigid bodies at least one of them is zero, and both may be. All four legs of a table "
    "touch the floor, and yet an exact solver leaves {idle:.0f} of them without force. A ball that "
    "is thrown straight up has neither gap nor force at the moment it leaves. In a soft contact "
    "at rest neither is zero: the ball is {sunk_mm:.2f} mm deep and pushed.",
)
def one_of_force_and_gap_is_zero(result):
    from course.contact import scenes, solve

    # Four legs, three equations of balance: statically indeterminate, so a basic solution leaves
    # one idle.
    table = solve("lcp", scenes.table((0.1, 0.05)).problem(0.01))
    end = np.abs(table.velocity).max()
    idle = result.measure("idle", np.sum(np.abs(table.impulses[:, 0]) < 1e-9))
    # Gap zero and separating: the case in which gap and force both vanish.
    thrown = [solve(m, _ball(0.0, v, 1e-3)).impulses[0, 0] for m in RIGID for v in (0.1, 1.0)]
    result.statement = f"The table stays (velocity {end:.0e}) and {idle} of its touching legs idle."
    soft = scenes.run(scenes.ball_drop(0.0), "soft", 2e-3, 500)
    sunk = result.measure("sunk_mm", -1e3 * soft.q[0, -1], tolerance=1e-4)
    result.statement_holds(idle == 0)
    result.correction_holds(
        idle >= 1, end < 1e-9, max(np.abs(thrown)) == 0.0, sunk > 0.1, soft.impulses[0, 0, -1] > 0
    )


@claim(
    "Contact force and gap are never both positive.",
    "In the rigid law they are not. But a soft contact with a margin already pushes before the "
    "bodies touch: with {force_n:.2f} N at a gap of {gap_mm:.0f} mm, for a margin of "
    "{margin_mm:.0f} mm. And a time step applies an impulse to a contact whose gap would close "
    "within the step.",
)
def never_both_positive(result):
    from course.contact import solve

    gap, margin = result.input("gap_mm", 5.0) * 1e-3, result.input("margin_mm", 10.0) * 1e-3

    def both(model, gap, **options):
        return bool(solve(model, _ball(gap, 0.0, 1e-3), **options).impulses[0, 0] > 0)

    force = solve("soft", _ball(gap, 0.0, 1e-3), margin=margin).impulses[0, 0] / 1e-3
    result.measure("force_n", force, tolerance=1e-6)
    # Gaps within the margin of 10 mm, at rest, so that none of them closes within the step.
    gaps = result.rng.uniform(1e-3, 8e-3, 8)
    # 0.1 mm above the ground at 1 m/s and 1 ms: the gap closes within the step.
    closing = solve("lcp", _ball(1e-4, -1.0, 1e-3)).impulses[0, 0]
    result.statement = f"MuJoCo's model, 1 kg at rest {gap:g} m above the ground: {force:.3f} N."
    result.statement_holds(
        not both("soft", gap, margin=margin),
        only_if="the model has no margin and the gap is not about to close",
        inside=[not both(m, x) for m in (*RIGID, "soft", "penalty") for x in gaps],
        outside=[not both("soft", x, margin=margin) for x in gaps],
    )
    result.correction_holds(force > 0, closing > 0)


@claim(
    "Complementarity follows from minimising the contact's potential energy U = f phi with f >= 0 "
    "and phi >= 0.",
    "f phi is not an energy. Its minima are all pairs with f phi = 0, so the law only comes out "
    "because it was put in. The load does not appear in it: at gap zero every force is a minimum. "
    "Instead, minimise the bodies' own potential subject to phi >= 0; the contact force is the "
    "multiplier of that constraint. A mass that hangs on a spring and rests on the ground is held "
    "up by f = {formula}.",
    ask=(
        "A mass m hangs on a spring k that is relaxed when the mass is at the height c. The "
        "mass touches the ground, at q = -c. Minimise V = k q^2/2 + m g q subject to "
        "phi = q + c >= 0. What is the multiplier f, the contact force?",
        "f = m*g - k*c",
        {
            "m*g": "The spring carries part of the weight.",
            "k*c": "That is the force of the spring. The contact carries the rest of the weight.",
            "m*g + k*c": "The spring is stretched downwards, so it pulls up: k q + m g - f = 0 "
            "at q = -c.",
            "k*c - m*g": "The sign of the multiplier is reversed: L = V - f phi, with f >= 0.",
        },
    ),
    source="Signorini 1933; Moreau 1988",
)
def potential_of_contact(result):
    import sympy

    from course.contact import scenes, solve

    m, g, k, c = sympy.symbols("m g k c", positive=True)
    q, f = sympy.symbols("q f", real=True)
    # KKT conditions of minimising V subject to phi >= 0; f is the multiplier.
    lagrangian = k * q**2 / 2 + m * g * q - f * (q + c)
    result.formula = sympy.solve(sympy.diff(lagrangian, q).subs(q, -c), f)[0]
    # Minima of U = f phi: the gradient (phi, f) vanishes or points inwards at any f if phi = 0.
    phi = sympy.Symbol("phi", nonnegative=True)
    slope = sympy.diff(f * phi, f).subs(phi, 0)
    idle = [float(sympy.sympify(f * phi).subs({phi: 0, f: x})) for x in (0.0, 1.0, 50.0)]
    # The course's own models give the multiplier: 2 kg, 100 N/m, 5 cm.
    base = scenes.ball_drop(0.0, 2.0)
    pulled = replace(base, force=base.force + 100.0 * 0.05)
    force = solve("coulomb", pulled.problem(1e-3)).impulses[0, 0] / 1e-3
    desired = float(result.formula.subs({m: 2, g: scenes.GRAVITY, k: 100, c: 0.05}))
    result.measure("force_n", force, tolerance=1e-9)
    result.statement = (
        f"U at phi = 0 for forces of 0, 1, 50 N: {idle}; the load asks for {force:.2f}."
    )
    result.statement_holds(slope != 0)
    result.correction_holds(abs(force - desired) < 1e-9, max(np.abs(idle)) == 0.0)


@claim(
    "At gap zero the law of rigid contact allows every force from zero upwards: it is set-valued.",
    "The law alone allows any of these forces. The load decides which one occurs: under loads "
    "from {low_n:.0f} to {high_n:.0f} N, a body at gap zero stays where it is, each time with a "
    "different contact force.",
)
def contact_law_is_set_valued(result):
    from course.contact import scenes, solve

    low, high = result.input("low_n", 1.0), result.input("high_n", 1000.0)
    # Three decades of load at the same gap and the same velocity.
    loads = np.geomspace(low, high, 12)
    base = scenes.ball_drop(0.0)
    answers = [solve("coulomb", replace(base, force=np.array([-x])).problem(1e-3)) for x in loads]
    forces = np.array([answer.impulses[0, 0] for answer in answers]) / 1e-3
    still = max(abs(answer.velocity[0]) for answer in answers)
    result.measure("largest_over_least", forces.max() / forces.min(), tolerance=1e-9)
    result.statement = f"Forces from {forces.min():.3g} to {forces.max():.3g} N, all at gap zero."
    result.statement_holds(np.ptp(forces) > 1.0 and still < 1e-12)
    result.correction_holds(np.allclose(forces, loads, rtol=1e-9))


@claim(
    "The contact problem is a linear complementarity problem.",
    "With the round cone, friction is a nonlinear condition. For a block that slides at "
    "{degrees:.1f} degrees to an edge with a friction coefficient of {mu:.1f}, the pyramid's "
    "velocity after a single step of {step_ms:.0f} ms is off by {missed_mm_s:.0f} mm/s.",
)
def contact_is_an_lcp(result):
    from course.contact import scenes, solve
    from course.contact.models import defect

    def linear(angle, mu, degrees):
        t = np.radians(degrees)
        problem = scenes.block(angle, mu, (np.cos(t), np.sin(t))).problem(0.01)
        # The defect measures the violation of Coulomb's law with the round cone, which the LCP does
        # not know.
        return defect(problem, solve("lcp", problem).impulses)

    def planar(seed):
        # Row 2 left out: sliding in one direction only.
        problem = scenes.pinch(5.0, seed).problem(0.01)
        return defect(problem, solve("lcp", problem).impulses) < 1e-9

    degrees, mu = result.input("degrees", 22.5), result.input("mu", 0.5)
    step = result.input("step_ms", 10.0)
    between = linear(0.0, mu, degrees)
    t = np.radians(degrees)
    problem = scenes.block(0.0, mu, (np.cos(t), np.sin(t))).problem(1e-3 * step)
    beside = solve("lcp", problem).velocity - solve("coulomb", problem).velocity
    missed = result.measure("missed_mm_s", 1e3 * np.linalg.norm(beside), tolerance=1e-6)
    result.statement = f"Sliding at {degrees} degrees to an edge: {missed:.2f} mm/s."
    mus = result.rng.uniform(0.05, 1.0, 10)
    result.statement_holds(
        between < 1e-9,
        only_if="there is no friction, friction in one direction only, or a pyramid instead of "
        "the cone",
        inside=[planar(mu) for mu in mus] + [linear(0.0, 0.0, a) < 1e-9 for a in 90 * mus],
        # Directions between the pyramid's edges; along an edge cone and pyramid coincide.
        outside=[linear(0.0, mu, a) < 1e-9 for mu, a in zip(mus, 10 + 70 * mus, strict=True)],
    )
    result.correction_holds(between > 1e-3, missed > 1.0)


@claim(
    "f >= 0, J v + h J M^-1 (f_ext + J^T f) >= 0, one of them zero, governs the contact.",
    "The gap is missing, so the condition also "
    "acts on bodies that are apart: a ball that falls {height_m:.0f} m above the ground would stop "
    "in the air. Nor does it push out a body that has sunk in. With the gap, phi / h is added to "
    "the velocity. At gap zero the force over the step is {formula}, and zero if that is negative.",
    ask=(
        "A body of mass m touches (phi = 0). Its velocity is v (negative: approaching) and its "
        "acceleration without contact is a. Which constant force f over a step h makes its "
        "velocity 0 at the end of the step?",
        "f = -m*(v/h + a)",
        {
            "-m*a": "That holds a body at rest. Here the approach has to be stopped too.",
            "-m*v/h": "The free acceleration acts during the step as well.",
            "m*(v/h + a)": "The sign is reversed: v + h (a + f / m) = 0.",
            "-m*(v + a)": "That mixes a force and an impulse, which differ by the factor h.",
        },
    ),
)
def velocity_lcp_without_gap(result):
    import sympy

    from course.contact import scenes, solve
    from course.contact.models import lemke

    m, v, a, h, f = sympy.symbols("m v a h f", real=True)
    result.formula = sympy.factor(sympy.solve(v + h * (a + f / m), f)[0])
    height = result.input("height_m", 1.0)

    def stops(gap):
        """Return whether the printed law, without a gap, and the step disagree with free fall."""
        problem = _ball(gap, -1.0, 1e-3)
        # Lemke's pivoting solves the law as printed, with the velocity alone on the right side.
        z = lemke(problem.delassus, problem.rows @ problem.free)[0]
        return abs(problem.after(z[:, None])[0]) < 1e-12

    air = solve("lcp", _ball(height, -1.0, 1e-3)).velocity[0]
    result.measure("speed_with_gap_m_s", air, tolerance=1e-9)
    touching = solve("lcp", _ball(0.0, -1.0, 1e-3)).impulses[0, 0] / 1e-3
    desired = result.formula.subs({m: 1, v: -1, a: -scenes.GRAVITY, h: 1e-3})
    gaps, speeds = result.rng.uniform(0.1, 2.0, (2, 8))

    def agrees(gap, speed, restitution=0.0):
        """Return whether the printed law has the velocity of a step from touch."""
        ball = replace(
            scenes.ball_drop(gap), v=np.array([-speed]), restitution=restitution
        ).problem(1e-3)
        z = lemke(ball.delassus, ball.rows @ ball.free)[0]
        # 1e-5 m/s covers the gaps of up to 2 nm, which phi / h turns into 2e-6 m/s.
        return abs(ball.after(z[:, None])[0] - solve("lcp", ball).velocity[0]) < 1e-5

    result.statement = (
        f"Falling at 1 m/s {height:g} m up: with the gap it goes on at {air:.4f} m/s."
    )
    result.statement_holds(
        not stops(height),
        only_if="the gap is zero and the contact does not bounce",
        inside=[stops(-1e-9 * x) for x in gaps]
        + [agrees(-1e-9 * x, speed) for x, speed in zip(gaps, speeds, strict=True)],
        # Chosen to break it: a restitution, which the law has no place for.
        outside=[not stops(x) for x in gaps]
        + [agrees(-1e-9 * x, speed, 0.5) for x, speed in zip(gaps, speeds, strict=True)]
        # And a gap below zero, of 0.1 to 2 mm: a step also takes back a share of the depth.
        + [agrees(-1e-3 * x, speed) for x, speed in zip(gaps, speeds, strict=True)],
    )
    result.correction_holds(
        air < -1.0,
        abs(touching - float(desired)) < 1e-6,
        not any(agrees(-1e-3 * x, 0.0) for x in gaps),
    )


@claim(
    "The penalty force max(0, -k phi) is a step function of the gap.",
    "It is a ramp: continuous, with a kink at gap zero, where the slope changes from 0 to -k. "
    "What jumps at touch is the damper's force, by the damping times the approach speed: "
    "{jump_n:.0f} N at {speed:.0f} m/s and {damping:.0f} N s/m.",
)
def penalty_is_a_step(result):
    from course.contact import solve

    speed, damping = result.input("speed", 1.0), result.input("damping", 50.0)

    def force(gap, u, b):
        problem = _ball(gap, u, 1e-3)
        return solve("penalty", problem, stiffness=5000.0, damping=b).impulses[0, 0] / 1e-3

    # Ever closer to touch: a step would keep its height, a ramp falls with the distance.
    tiny = 10 ** result.rng.uniform(-12, -7, 8)
    ramp = max(force(-x, 0.0, 0.0) - force(x, 0.0, 0.0) for x in tiny)
    jump = result.measure("jump_n", force(-1e-12, -speed, damping) - force(1e-12, -speed, damping))
    result.statement = (
        f"Across gap zero the spring's force changes by {ramp:.1e} N, the damper's {jump}."
    )
    result.statement_holds(ramp > 1.0)
    result.correction_holds(ramp < 1e-2, abs(jump - damping * speed) < 1e-6)


@claim(
    "Backpropagation through contact gives zero or undefined gradients.",
    "Exactly at touch it has two one-sided values. After touch it is an ordinary number: "
    "a finger that reaches the block moves it {after_s:.3f} m farther for each m/s more. (Both "
    "have equal mass, there is no restitution, and the run lasts half a second.) What goes "
    "wrong is another thing. Let a ball bounce at a wall, without loss, at the end of a step. The "
    "derivative of its last position (counted towards the wall) by the distance at the start is "
    "{stepped:.0f} at every step size; the truth is 1.",
)
def contact_gradients_vanish(result):
    from course.charts.contact.models import pushed, rebound, slope

    def push(p):
        return slope(lambda s: pushed(s, "rigid"), p, 1e-5)

    # Central differences on either side of the speed at which the finger reaches the block.
    before = [push(p) for p in result.rng.uniform(0.05, 0.19, 4)]
    after = [push(p) for p in result.rng.uniform(0.21, 0.5, 4)]
    result.measure("after_s", np.median(after), tolerance=1e-2)
    starts = result.rng.uniform(0.3, 0.5, 9)

    def bounce(dt):
        """Return the median over the starts; at one of them the last step may miss the wall."""
        return np.median([slope(lambda s: rebound(s, dt), start, 1e-7) for start in starts])

    slopes = [bounce(dt) for dt in (0.05, 0.02, 0.01, 0.005, 0.002)]
    stepped = result.measure("stepped", np.max(slopes), tolerance=1e-5)
    result.statement = (
        f"Derivatives before touch {np.round(before, 4)}, behind it {np.round(after, 4)}."
    )
    slow, fast = result.rng.uniform(0.05, 0.19, 8), result.rng.uniform(0.21, 0.5, 8)
    result.statement_holds(
        max(np.abs(after)) < 1e-6,
        only_if="nothing rubs, and the bodies do not touch, or just touch, in the run",
        inside=[abs(push(p)) < 1e-9 for p in slow],
        outside=[abs(push(p)) < 1e-9 for p in fast],
    )
    result.correction_holds(
        max(np.abs(before)) < 1e-9,
        # Equal masses without restitution: both move on at half the finger's speed.
        abs(np.median(after) - 0.5 * 0.5) < 0.01,
        stepped < -0.9,
    )


@claim(
    "Penalty contact is differentiable.",
    "The force is continuous, but its slope is 0 on one side of touch and -k on the other, and "
    "with a damper the force itself jumps. A simulation inherits this. The final position of a "
    "pushed block has a local slope of {slope_s:.2f} m per m/s (median), but on average over the "
    "range it rises by only {rise_s:.2f} m per m/s. The difference is in jumps that no gradient "
    "sees (steps of {step_ms:.0f} ms; damping ratio {zeta:.2f} for the reduced mass of both "
    "bodies, which leaves a restitution of {restitution:.2f}).",
    source="Suh, Simchowitz, Zhang and Tedrake, Do differentiable simulators give better policy "
    "gradients?, 2022",
)
def penalty_is_differentiable(result):
    from course.charts.contact.models import PUSH, pushed, slope
    from course.contact import solve

    step = result.input("step_ms", 5.0)
    k, b, m = PUSH["stiffness"], PUSH["damping"], 0.5  # reduced mass of two bodies of 1 kg
    zeta = result.measure("zeta", b / (2.0 * np.sqrt(k * m)), tolerance=1e-6)
    # Restitution of spring and damper that never pull, in fine steps.
    x, v, dt = 0.0, -1.0, 1e-6
    while v < 0.0 or -k * x - b * v > 0.0:
        v += dt * max(-k * x - b * v, 0.0) / m
        x += dt * v
    result.measure("restitution", v, tolerance=1e-3)
    # The same in closed form: the force ends at the angle at which spring and damper cancel.
    root = np.sqrt(1.0 - zeta**2)
    rebound = np.exp(-zeta / root * np.arctan2(2.0 * zeta * root, 2.0 * zeta**2 - 1.0))

    def end(speed):
        return pushed(speed, "penalty", 1e-3 * step)

    # The median ignores the few samples whose differences straddle a jump.
    slopes = [slope(end, p, 1e-5) for p in result.rng.uniform(0.3, 0.5, 15)]
    along = result.measure("slope_s", np.median(slopes), tolerance=0.02)
    # The secant over the range contains the jumps that the local slopes miss.
    whole = result.measure("rise_s", (end(0.5) - end(0.3)) / 0.2, tolerance=0.02)

    def force(gap):
        return solve("penalty", _ball(gap, 0.0, 1e-3), stiffness=5000.0).impulses[0, 0] / 1e-3

    one, other = (force(1e-6) - force(0.0)) / 1e-6, (force(0.0) - force(-1e-6)) / 1e-6
    result.statement = f"Slopes of the force at touch: {one:.0f} and {other:.0f} N/m."
    result.statement_holds(abs(one - other) < 1.0)
    result.correction_holds(
        abs(one) < 1.0, abs(other + 5000) < 1.0, along > 1.5 * whole, abs(v - rebound) < 1e-3
    )
