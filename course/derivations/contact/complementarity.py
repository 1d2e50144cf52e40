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
    "However short the step, a rigid contact that closes stops the whole approach within the step. "
    "A rigid contact at rest has nothing to stop, so nothing jumps there. What slides can jump "
    "although nothing approaches: the end of Painlevé's rod (section 7) jams and stops, and the "
    "convex friction law lifts a sliding block. A spring, a damper or MuJoCo's soft contact "
    "changes the velocity over a certain time, so a short step changes it only a little: by "
    "{soft_share:.1%} of the approach speed in {dt_us:.0f} µs.",
)
def contact_velocity_jumps(result):
    from course.contact import scenes, solve

    dt = result.input("dt_us", 100.0) * 1e-6

    def lost(model, speed, step):
        v = solve(model, _ball(-1e-9, -speed, step)).velocity[0]
        return (v + speed) / speed > 0.5

    def changes(model, scene, velocity, step):
        """Return the contacts' normal velocities before a step, and by how much it changes them."""
        problem = scene.problem(step, v=np.array(velocity))
        normal = problem.jacobian[:, 0]
        before = normal @ problem.velocity
        return before, normal @ solve(model, problem).velocity - before

    def all_stop(model, scene, velocity, step):
        """Return whether each contact that closes takes more than half of its approach speed."""
        before, change = changes(model, scene, velocity, step)
        return bool(np.all(change[before < 0.0] > -0.5 * before[before < 0.0]))

    def jumps(model, scene, velocity, step):
        """Return whether some contact's velocity changes by more than a tenth of 1 m/s."""
        return bool(np.abs(changes(model, scene, velocity, step)[1]).max() > 0.1)

    def slips(model, scene, step):
        """Return whether a step changes a contact velocity, sliding included, by 0.1 m/s."""
        problem = scene.problem(step)
        rows = problem.jacobian.reshape(-1, problem.velocity.size)
        change = rows @ (solve(model, problem).velocity - problem.velocity)
        return bool(np.abs(change).max() > 0.1)

    # Steps over three decades: a velocity that jumps must do so however short the step is.
    speeds, steps = result.rng.uniform(0.5, 3.0, 8), 10 ** result.rng.uniform(-7, -4, 8)
    # At 60 degrees the rod jams above 1.347.
    jammed = list(zip(result.rng.uniform(1.4, 1.75, 4), steps[:4], strict=True))
    sliding = list(zip(speeds[:4], steps[:4], strict=True))
    law = ("lcp", "pgs", "coulomb")
    soft = solve("soft", _ball(-1e-9, -1.0, dt)).velocity[0] + 1.0
    result.measure("soft_share", soft, tolerance=1e-3)
    result.statement = f"A ball at 1 m/s, a step of {dt:g} s: the soft model takes {soft:.4f} m/s."
    result.statement_holds(
        lost("soft", 1.0, dt),
        only_if="the bodies are rigid and approach each other where they touch, or slide and jam "
        "(Painlevé's rod), or slide in the convex model",
        # Chosen to break it: several contacts that close at once, and one that also slides.
        inside=[lost(m, *row) for m in RIGID for row in zip(speeds, steps, strict=True)]
        + [
            all_stop(m, scene, v, h)
            for m in RIGID
            for h in steps[:2]
            for scene, v in (
                (scenes.tower([1.0, 5.0, 2.0]), [-1.0, -1.0, -2.0]),
                (scenes.table((0.3, 0.1)), [-1.0, 0.5, 0.3]),
                (scenes.block(0.2, 0.5), [1.0, 0.5, -0.7]),
            )
        ]
        # Nothing approaches: rods above the friction at which they jam, and a sliding block.
        + [slips(m, scenes.rod(np.radians(60.0), mu), h) for m in RIGID for mu, h in jammed]
        + [slips("convex", scenes.block(0.0, 0.5, (v, 0.0)), h) for v, h in sliding],
        outside=[
            lost(m, *row) for m in ("soft", "penalty") for row in zip(speeds, steps, strict=True)
        ]
        # Rigid contacts at rest, and one that opens.
        + [
            jumps(m, scene, v, h)
            for m in RIGID
            for h in steps[:2]
            for scene, v in (
                (scenes.tower([1.0, 5.0]), [0.0, 0.0]),
                (scenes.ball_drop(0.0), [1.0]),
            )
        ]
        # Chosen to break it: what slides without jamming, also a rod below that friction.
        + [slips(m, scenes.rod(np.radians(60.0), 0.75 * mu), h) for m in law for mu, h in jammed]
        + [slips(m, scenes.block(0.0, 0.5, (v, 0.0)), h) for m in law for v, h in sliding],
    )
    # A smooth force changes the velocity in proportion to the step.
    shorter = solve("soft", _ball(-1e-9, -1.0, 0.1 * dt)).velocity[0] + 1.0
    result.correction_holds(abs(shorter / soft - 0.1) < 0.02)


@claim(
    "Exactly one of contact force and gap is zero at any time.",
    "By the rigid law at least one of them is zero, and both may be. All four legs of a table "
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
    "In the rigid law at least one is zero. But a soft contact with a margin (a gap at which it "
    "begins to act) already pushes before the bodies touch: with {force_n:.2f} N at a gap of "
    "{gap_mm:.0f} mm, for a margin of {margin_mm:.0f} mm. The convex friction law pushes on a body "
    "that slides at the speed v, up to a gap of mu v h: {lifted_mm:.2f} mm at {speed:.0f} m/s, mu "
    "= {mu:.1f} and a step h of {step_ms:.0f} ms. And a time step applies an impulse to a contact "
    "whose gap would close within the step.",
)
def never_both_positive(result):
    from course.contact import scenes, solve

    gap, margin = result.input("gap_mm", 5.0) * 1e-3, result.input("margin_mm", 10.0) * 1e-3

    def both(model, gap, **options):
        return bool(solve(model, _ball(gap, 0.0, 1e-3), **options).impulses[0, 0] > 0)

    mu, speed = result.input("mu", 0.5), result.input("speed", 3.0)
    step = 1e-3 * result.input("step_ms", 1.0)

    def slides(model, gap, speed):
        """Return whether a block that slides at this gap above the ground is pushed."""
        start = np.array([0.0, 0.0, gap]), np.array([speed, 0.0, 0.0])
        problem = scenes.block(0.0, mu).problem(step, *start)
        return bool(solve(model, problem).impulses[0, 0] > 0)

    def stopped_below(model, gap):
        """Return whether a body is pushed that falls on one which the ground stops."""
        start = np.array([0.0, gap]), np.array([-1.0, -1.0])
        return bool(solve(model, scenes.tower([1.0, 1.0]).problem(step, *start)).impulses[1, 0] > 0)

    force = solve("soft", _ball(gap, 0.0, 1e-3), margin=margin).impulses[0, 0] / 1e-3
    result.measure("force_n", force, tolerance=1e-6)
    # Gaps within the margin of 10 mm, at rest, so that none of them closes within the step.
    gaps = result.rng.uniform(1e-3, 8e-3, 8)
    # 0.1 mm above the ground at 1 m/s and 1 ms: the gap closes within the step.
    closing = solve("lcp", _ball(1e-4, -1.0, 1e-3)).impulses[0, 0]
    low, high = 0.0, 1e-2
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slides("convex", middle, speed) else (low, middle)
    lifted = 1e-3 * result.measure("lifted_mm", 1e3 * low, tolerance=1e-3)
    others = ("lcp", "pgs", "coulomb", "soft", "penalty")
    sliding = result.rng.uniform(0.5, 5.0, 8)
    result.statement = f"MuJoCo's model, 1 kg at rest {gap:g} m above the ground: {force:.3f} N."
    result.statement_holds(
        not both("soft", gap, margin=margin),
        only_if="the model has no margin, the friction law does not lift sliding bodies (the "
        "convex law does), and the gap does not close within the step",
        inside=[not both(m, x) for m in (*RIGID, "soft", "penalty") for x in gaps]
        # Chosen to break it: blocks that slide fast, at gaps at which the convex law pushes.
        + [not slides(m, 0.9 * mu * step * v, v) for m in others for v in sliding]
        + [not slides("convex", 1.1 * mu * step * v, v) for v in sliding],
        outside=[not both("soft", x, margin=margin) for x in gaps]
        + [not slides("convex", 0.9 * mu * step * v, v) for v in sliding]
        # Two bodies at one speed: the gap only closes because the ground stops the lower one.
        + [not stopped_below(m, x) for m in RIGID for x in (1e-5, 1e-4)],
    )
    result.correction_holds(force > 0, closing > 0, abs(lifted / (mu * speed * step) - 1) < 0.02)


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
    "The law alone allows any of these forces. For a single contact the load decides which one "
    "occurs: under loads from {low_n:.0f} to {high_n:.0f} N, a body at gap zero stays where it is, "
    "each time with a different contact force.",
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
    from course.contact.problem import Problem

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

    def random_contacts(d):
        """Return up to six contacts of d rows on one to six degrees of freedom."""
        n, freedoms = result.rng.integers(1, 7, 2)
        root, velocity = (
            result.rng.normal(size=(freedoms, freedoms)),
            result.rng.normal(size=freedoms),
        )
        coefficients = np.repeat(result.rng.uniform(0.05, 3.0, (n, 1)), d - 1, axis=1)
        return Problem(
            root @ root.T + 0.1 * np.eye(freedoms),
            result.rng.normal(size=(n, d, freedoms)),
            velocity,
            velocity + 0.01 * result.rng.normal(size=freedoms),
            np.zeros(n),  # what is deep and jammed between two walls has no solution at all
            coefficients,
            0.01,
        )

    def obeys_pyramid(problem):
        """Return whether the LCP's impulses obey the pyramid's law, computed without the LCP."""
        impulses = solve("lcp", problem).impulses
        normal, friction = impulses[:, 0], impulses[:, 1:]
        speed = problem.jacobian @ problem.after(impulses)
        apart = speed[:, 0] - problem.target_velocity
        limit = problem.friction[:, 0] * normal
        # Signorini, the pyramid's limit, and the largest power that friction in it can take out.
        signorini = np.abs(np.minimum(normal, apart))
        beyond = np.abs(friction).sum(axis=1) - limit
        power = np.sum(friction * speed[:, 1:], axis=1) + limit * np.abs(speed[:, 1:]).max(axis=1)
        return bool(max(signorini.max(), beyond.max(), np.abs(power).max()) < 1e-7)

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
        inside=[planar(mu) for mu in mus]
        + [linear(0.0, 0.0, a) < 1e-9 for a in 90 * mus]
        # Chosen to break it: several contacts at once, redundant ones, and high friction.
        + [obeys_pyramid(random_contacts(3)) for _ in range(12)]
        + [
            defect(problem, solve("lcp", problem).impulses) < 1e-7
            for d in (1, 2)
            for problem in (random_contacts(d) for _ in range(12))
        ],
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
    "The penalty force max(0, -k phi) is a step function of the gap phi.",
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
    "Exactly at touch the gradient has two one-sided values. After touch it is an ordinary number: "
    "a finger that reaches the block moves it {after_s:.3f} m farther for each m/s more. (Both "
    "have equal mass, there is no restitution, and the run lasts half a second.) What goes "
    "wrong is another thing. Let a ball bounce at a wall, without loss, at the end of a step. The "
    "derivative of its last position (counted towards the wall) by the distance at the start is "
    "{stepped:.0f} at every step size; the truth is 1.",
)
def contact_gradients_vanish(result):
    from course.charts.contact.models import finger_and_block, pushed, rebound, slope
    from course.contact import scenes

    def push(p):
        return slope(lambda s: pushed(s, "rigid"), p, 1e-5)

    def one_sided(width):
        """Return the slope from the speed that just touches to one side of it."""
        return (pushed(0.2 + width, "rigid") - pushed(0.2, "rigid")) / width

    def push_before(p):
        """Return the slope with MuJoCo's soft contact and a margin; no run reaches the block."""

        def end(speed):
            path = scenes.run(finger_and_block(speed), "soft", 5e-3, 100, margin=0.095)
            nearest = np.min(0.1 + path.q[1] - path.q[0])
            return path.q[1, -1] if nearest > 0.0 else 0.0

        return slope(end, p, 1e-5)

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
        only_if="the bodies do not touch, or just touch, in the run, and no force acts before they "
        "touch (as it would with a margin or a smoothed contact law)",
        inside=[abs(push(p)) < 1e-9 for p in slow]
        # At the speed that just touches, the slopes of the two sides differ.
        + [abs(one_sided(width) - one_sided(-width)) > 0.1 for width in (1e-6, 1e-5)],
        outside=[abs(push(p)) < 1e-9 for p in fast]
        # Chosen to break it: a soft contact pushes before touch, within its margin.
        + [abs(push_before(p)) < 1e-9 for p in slow[:3]],
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
