"""Claims on solvers: what they solve, how long they take, how large a step they bear."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "r": Symbol("mass on top over the mass below"),
    "e": Symbol("tolerance, relative", 1e-9, 0.1),
    "mu": Symbol("coefficient of friction"),
    "v": Symbol("sliding speed [m/s]"),
    "g": Symbol("gravity [m/s^2]"),
    "h": Symbol("step [s]"),
}


def _stack(**options):
    """Return four boxes in MuJoCo after 30 steps, the lowest pushed."""
    from course.oracles.mujoco import contact

    runner = contact.box(contact.Options(**options), (0.3, 0.0), 4)
    runner.run(30)
    return runner


@claim(
    "MuJoCo's contact problem is convex and has a unique solution. (The optional extra sweeps "
    "called noslip are not part of it.)",
    "On a stack of boxes and on a table, whose rigid forces are not unique, Newton from "
    "any start and CG (conjugate gradients) agree to {digits:.0f} digits or more if they are run "
    "to convergence. Unique does not mean that every solver finds it: on a sliding impact, PGS "
    "with elliptic cones returns no force where Newton finds {newton_n:.0f} N.",
)
def mujoco_is_convex_and_unique(result):
    import mujoco

    from course.contact import scenes, solve
    from course.oracles.mujoco import contact

    def forces(made, solver, start=0.0):
        """Return the contact forces that a solver computes from this warm start."""
        made.model.opt.solver = ("PGS", "CG", "Newton").index(solver)
        made.model.opt.iterations = 3000
        made.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_WARMSTART)
        # A strictly convex problem must reach the same minimum from any start.
        made.data.qacc_warmstart[:] = start
        state = contact.contact_state(made)
        return np.zeros(1) if state is None else state.force

    table = contact.table(contact.Options(condim=1), (0.1, 0.05))
    table.run(200)
    spreads = []
    for made in (_stack(), table):
        truth = forces(made, "Newton")
        # Warm starts of tens of m/s^2, far from the solution, could reveal a second minimum.
        starts = result.rng.normal(0.0, 50.0, (8, made.model.nv))
        others = [forces(made, "Newton", start) for start in starts]
        others.append(forces(made, "CG"))
        spreads.append(max(np.abs(f - truth).max() for f in others) / np.abs(truth).max())
    spread = max(spreads)
    result.measure("digits", min(9, np.floor(-np.log10(max(spread, 1e-16)))), tolerance=0.2)
    same = scenes.table((0.1, 0.05)).problem(0.01)
    # The control: on the same table two rigid solvers return different force distributions.
    rigid = [solve(model, same).impulses[:, 0] for model in ("lcp", "pgs")]

    def sliding(solver, steps):
        """Return forces of a block that comes down sliding, after `steps` of Newton's steps."""
        made = contact.block(contact.Options(), 0.0, (2.0, 0.5), 0.01)
        made.v0[2] = -1.0
        made.run(steps)
        return forces(made, solver)

    # The largest force of Newton among the states where PGS returns none.
    lost = max(
        sliding("Newton", n)[0] for n in range(5, 30) if not np.abs(sliding("PGS", n)).max() > 1e-9
    )
    result.measure("newton_n", lost, tolerance=1e-3)
    result.statement = f"8 random warm starts and CG differ by {spread:.1e} of the largest force."
    result.statement_holds(spread < 1e-6)
    result.correction_holds(np.abs(rigid[0] - rigid[1]).max() > 0.01, lost > 1.0)


@claim(
    "A contact scene needs 50 to 100 iterations, whatever the solver and the masses.",
    "That depends on the solver, the masses and the start. MuJoCo's Newton solver takes at most "
    "{newton:.0f} on a stack of boxes. In another scene, with rigid contacts, projected "
    "Gauss-Seidel needs {sweeps:.0f} sweeps from zero for two bodies, if the upper one has "
    "{ratio:.0f} times the mass of the lower one.",
)
def iterations_50_to_100(result):
    from course.charts.contact.limits import sweeps_needed

    runner = _stack(tolerance=1e-8)
    taken = []
    # Every step is looked at, since the first impacts need the most iterations.
    for steps in range(1, 60):
        runner.run(steps)
        taken.append(int(runner.data.solver_niter[0]))
    newton = result.measure("newton", max(taken), tolerance=0.3)
    ratio = result.input("ratio", 1000.0)
    sweeps = result.measure("sweeps", sweeps_needed([1.0, ratio]), tolerance=1e-2)
    result.statement = f"Newton: {newton} at most over 60 steps; sweeps {sweeps}."
    result.statement_holds(50 <= newton <= 100 and 50 <= sweeps <= 100)
    result.correction_holds(newton < 30, sweeps > 1000)


@claim(
    "In MuJoCo, increase nconmax and njmax if contacts stick or the solver does not converge.",
    "These were sizes of memory, and MuJoCo Warp still needs them. Where they are large enough, "
    "increasing them changes nothing. MuJoCo 4 itself ignores them: with {allowed:.0f} contacts "
    "allowed, a box rests on {contacts:.0f}, and its final position is the same as without the "
    "limit, to the last bit.",
    source="MuJoCo 4.0 documentation, XML reference, size",
)
def nconmax_helps(result):
    import mujoco

    def end(size, speed, warned):
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><size {size}/><worldbody><geom type="plane" size="9 9 1"/><body pos="0 0 .3">'
            '<freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>'
        )
        data = mujoco.MjData(model)
        data.qvel[:] = speed
        mujoco.mj_step(model, data, 300)
        return data.qpos.copy() if not warned else int(data.ncon)

    allowed = result.input("allowed", 2)
    small = f'njmax="6" nconmax="{allowed}"'
    sizes = ("", small, 'njmax="2000" nconmax="500"', 'memory="10M"')
    # Tumbling boxes: a box that falls flat would need the same contacts in every run.
    speeds = result.rng.uniform(-1.0, 1.0, (8, 6))
    same = [
        all(np.array_equal(end(sizes[0], v, False), end(s, v, False)) for s in sizes[1:])
        for v in speeds
    ]
    touching = result.measure("contacts", max(end(small, v, True) for v in speeds))
    result.statement = f"{sum(same)} of {len(same)} boxes end alike with any size."
    result.statement_holds(not all(same))
    result.correction_holds(all(same), touching > allowed)


@claim(
    "Projected Gauss-Seidel converges equally fast whatever the masses.",
    "A light body on a heavy one takes a few sweeps, a heavy body on a light one {formula}: the "
    "error of two bodies falls by a factor of r/(1 + r) per sweep. At a mass ratio of "
    "{ratio:.0f}, one part in a million takes {sweeps:.0f} sweeps; with the masses swapped it "
    "takes {upside:.0f}.",
    ask=(
        "A mass r stands on a mass 1 that stands on the ground. Each sweep multiplies the relative "
        "error of the forces by r/(1 + r). For large r, about how many sweeps n reduce it to e, a "
        "number far below 1?",
        "n = (1 + r)*log(1/e)",
        {
            "r*log(e)": "The logarithm of a tolerance below 1 is negative.",
            "log(1/e)/(1 + r)": "That is upside down: a heavier top takes more sweeps.",
            "sqrt(r)*log(1/e)": "That is how conjugate gradients would scale.",
            "log(1/e)/log(1 + r)": "That is for a factor of 1/(1 + r) per sweep: light on heavy.",
        },
    ),
)
def sweeps_and_masses(result):
    import sympy

    from course.charts.contact.limits import sweeps_needed

    r, e = sympy.symbols("r e", positive=True)
    # ln(1 / e) / ln((1 + r) / r), its leading term for large r.
    exact = sympy.log(1 / e) / sympy.log((1 + r) / r)
    result.formula = (1 + r) * sympy.log(1 / e)
    # The leading term is right if the quotient tends to 1.
    ratio_of_both = sympy.limit(exact / result.formula, r, sympy.oo)
    ratio = result.input("ratio", 300.0)
    sweeps = result.measure("sweeps", sweeps_needed([1.0, ratio]), tolerance=1e-2)
    upside = result.measure("upside", sweeps_needed([ratio, 1.0]), tolerance=0.01)
    ratios = result.rng.uniform(50.0, 2000.0, 6)
    # Sweeps counted with the solver itself; the leading term is off by about 1 / (2 r), at most 1 %
    # here.
    counted = [sweeps_needed([1.0, x]) / ((1 + x) * np.log(1e6)) for x in ratios]
    result.statement = f"Counted over (1 + r) ln(1/e): {min(counted):.3f} to {max(counted):.3f}."
    result.statement_holds(sweeps < 2 * upside)
    result.correction_holds(
        bool(ratio_of_both == 1), np.allclose(counted, 1.0, atol=0.03), upside < 10
    )


@claim(
    "A convex friction cone gives Coulomb's friction.",
    "It does while the contact sticks. What slides at v also separates, at mu v, so a block that "
    "touches, with a gap of exactly 0, hops to {formula}: {hop_mm:.2f} mm at {speed:.0f} m/s. "
    "MuJoCo's compliance nearly removes that hop: at the same speed its block rises by "
    "{soft_mm:.1f} mm. Braking distances hardly change: at a step of {dt_ms:.0f} ms that block "
    "stops within {soft_stop:.1%} of Coulomb's distance. {blocks:.0f} faster blocks, at {slow:.0f} "
    "to {fast:.0f} m/s, all stopped within {stop:.1%}, although they were off the ground on "
    "{off:.0%} of their steps, up to {high_mm:.0f} mm high.",
    ask=(
        "A block touches the ground and slides at v. In one step of the convex model it takes off "
        "with the normal speed mu v/(1 + mu^2). How high does it rise afterwards, in free flight? "
        "(h is the step. You do not need every symbol.)",
        "H = (mu*v/(1 + mu^2))^2/(2*g)",
        {
            "(mu*v)^2/(2*g)": "The same step also brakes the block, so it slides at v/(1 + mu^2) "
            "afterwards.",
            "mu*v/(1 + mu^2)/g": "That is the time it takes to the highest point.",
            "mu*v*h": "That is the gap while the block slides steadily.",
            "v^2/(2*mu*g)": "That is the braking distance.",
        },
    ),
    source="Anitescu, Optimization-based simulation of nonsmooth rigid multibody dynamics, 2006",
)
def convex_cone_is_coulomb(result):
    import sympy

    from course.contact import scenes, solve
    from course.oracles.mujoco import contact

    mu, v, g = sympy.symbols("mu v g", positive=True)
    # One block: minimise |v - v_free|^2 with u_n = mu u_t: u_t = v / (1 + mu^2).
    u = sympy.Symbol("u", positive=True)
    slid = sympy.solve(sympy.diff((u - v) ** 2 + (mu * u) ** 2, u), u)[0]
    result.formula = sympy.factor((mu * slid) ** 2 / (2 * g))
    speed = result.input("speed", 1.0)
    dt = 1e-4
    hop = scenes.run(scenes.block(0.0, 0.5, (speed, 0.0)), "convex", dt, 1000).q[2].max()
    result.measure("hop_mm", 1e3 * hop, tolerance=1e-3)
    theory = float(result.formula.subs({mu: 0.5, v: speed, g: scenes.GRAVITY}))
    blocks, deviation, high, stops = result.input("blocks", 12), [], [], []
    step = 1e-3 * result.input("dt_ms", 2.0)
    slow, fast = result.input("slow", 2.0), result.input("fast", 8.0)

    def slid_in_mujoco(speed):
        """Return the motion of a block, and its stopping distance over Coulomb's, less 1."""
        runner = contact.block(contact.Options(step), 0.0, (speed, 0.0))
        # The block stops after about v / (mu g) = 0.2 s per m/s; the run takes half as long again.
        path = runner.samples(round(speed / (3.25 * step)))
        # Coulomb's distance v^2 / (2 mu g) with mu = 0.5 is v^2 / g.
        return path, abs(path.q[0, -1] / (speed**2 / scenes.GRAVITY) - 1.0)

    for v0 in result.rng.uniform(slow, fast, blocks):
        path, missed = slid_in_mujoco(v0)
        stops.append(missed)
        # Only steps on which the block still slides: at rest it touches.
        deviation.append(np.mean(path.q[2, path.v[0] > 0.05] > 0.0))
        high.append(path.q[2].max())
    soft, soft_stop = slid_in_mujoco(speed)
    result.measure("soft_mm", 1e3 * soft.q[2].max(), tolerance=0.05)
    result.measure("soft_stop", soft_stop, tolerance=0.1)
    result.measure("off", np.mean(deviation), tolerance=0.05)
    result.measure("high_mm", 1e3 * max(high), tolerance=0.05)
    stop = result.measure("stop", max(stops), tolerance=0.1)
    sticks = solve("convex", scenes.block(0.2, 0.5).problem(0.01)).velocity
    result.statement = f"Hop {1e3 * hop:.3f} mm, theory {1e3 * theory:.3f} mm."
    result.statement_holds(hop < 1e-6)
    result.correction_holds(
        abs(hop / theory - 1) < 0.02,
        np.abs(sticks).max() < 1e-9,
        abs(stop) < 0.01,
        soft_stop < 0.01,
        soft.q[2].max() < 0.1 * hop,
    )


@claim(
    "In a simulator, a light box sinks under a heavy one because the solver has not converged.",
    "With {sweeps:.0f} sweeps of Gauss-Seidel that is the reason: {swept_mm:.0f} mm after "
    "{steps:.0f} steps of {dt_ms:.0f} ms (far less at the shorter steps of section 6). With its "
    "default settings, MuJoCo lets it sink even if the solver is exact, because the softness of a "
    "contact is scaled with the inverse masses. The light body determines the softness, and the "
    "heavy one loads it: a light body sinks by {deep_mm:.1f} mm under {heavy:.0f} times its mass, "
    "whatever the solver, and by {equal_mm:.2f} mm under its equal. Under {huge:.0f} times its "
    "mass it is swallowed: the heavy body reaches the ground, {swallowed_mm:.0f} mm deep "
    "inside a light body of {radius_mm:.0f} mm radius. Converged rigid models leave "
    "{rigid_mm:.0e} mm.",
)
def heavy_on_light_sinks(result):
    from course.contact import scenes
    from course.oracles.mujoco import contact

    heavy = result.input("heavy", 100.0)

    def depths(mass, solver="Newton"):
        """Return how deep the light box is in the ground, and the heavy in the light [mm]."""
        options = contact.Options(condim=1, solver=solver, iterations=2000)
        q = -1e3 * contact.tower(options, [1.0, mass]).run(4000)[0]
        return q[0], q[1] - q[0]

    def depth(mass, solver="Newton"):
        return depths(mass, solver)[0]

    # Three solvers run to convergence: a depth that all share is a property of the model.
    newton, others = depth(heavy), [depth(heavy, solver) for solver in ("CG", "PGS")]
    huge, radius = result.input("huge", 10_000.0), result.input("radius_mm", 100.0)
    swallowed = [depths(huge, solver) for solver in contact.SOLVERS]
    result.measure("swallowed_mm", swallowed[0][1], tolerance=1e-3)
    result.measure("deep_mm", newton, tolerance=1e-3)
    equal = result.measure("equal_mm", depth(1.0), tolerance=1e-3)
    steps, sweeps = result.input("steps", 50), result.input("sweeps", 10)
    dt = 1e-3 * result.input("dt_ms", 10.0)

    def sunk(mass, model, **options):
        return np.abs(scenes.run(scenes.tower([1.0, mass]), model, dt, steps, **options).q).max()

    def warm(mass):
        """Return how far the boxes are from their positions after so few sweeps a step [m]."""
        q, _, _ = scenes.march(scenes.tower([1.0, mass]), dt, steps, sweeps=sweeps)
        return np.abs(q).max()

    rigid = sunk(heavy, "coulomb")
    swept = result.measure("swept_mm", 1e3 * sunk(heavy, "pgs", sweeps=sweeps), tolerance=1e-2)
    masses = result.rng.uniform(50.0, 500.0, 8)
    result.measure("rigid_mm", max(1e3 * rigid, 1e-12), tolerance=0.5)
    result.statement = f"Newton {newton:.4f} mm, CG and PGS {others[0]:.4f}, {others[1]:.4f} mm."
    result.statement_holds(
        np.abs(np.array(others) / newton - 1).max() > 1e-3,
        only_if="the contact is rigid and the sweeps are cut short",
        inside=[sunk(m, "pgs", sweeps=sweeps) > 1e-3 > 1e3 * sunk(m, "lcp") for m in masses]
        # Chosen to break it: each step starts from the impulses of the step before.
        + [warm(m) > 1e-3 > 1e3 * sunk(m, "lcp") for m in masses],
        # The same towers with the sweeps they need, which must not sink.
        outside=[sunk(m, "pgs", sweeps=20000) > 1e-3 for m in masses],
    )
    result.correction_holds(
        newton > 10 * equal,
        rigid < 1e-9,
        swept > 1.0,
        sunk(huge, "lcp") < 1e-9,
        # The heavy one's lowest point, which began a diameter up, is at the ground or below it.
        all(sum(deep) > 2 * radius and deep[1] > 0.99 * radius for deep in swallowed),
        np.ptp(swallowed, axis=0).max() < 1e-3,
    )


@claim(
    "The top of a tower of n equal boxes sags by n (n + 1)/2 times what the topmost contact does.",
    "If the springs stiffen with the depth, as between two balls (Hertz), the lower contacts sink "
    "by less: {hertz:.2f} of it for {few:.0f} boxes. In MuJoCo a contact is softer, the larger the "
    "sum of the inverse masses of its bodies. The contact with the ground counts one body and the "
    "others two, so these are twice as soft. With constant impedance the top then sags by n^2 "
    "times the depth of a single body on the ground. The default impedance grows with the depth, "
    "and then there is no simple law: {few:.0f} boxes sag by {share_few:.3f} of n (n + 1)/2 times "
    "their topmost contact, {n:.0f} boxes by {share:.3f} of it.",
)
def tower_sags(result):
    from course.contact import scenes
    from course.oracles.mujoco import contact

    def depths(n, **options):
        """Return how deep the top is [m], and that over n (n + 1)/2 times its own contact's."""
        q = contact.tower(contact.Options(condim=1, **options), [1.0] * n).run(6000)[0]
        return -q[-1], q[-1] / (q[-1] - q[-2]) / (n * (n + 1) / 2)

    def springs(n, stiffness):
        options = {"stiffness": stiffness, "damping": 3.0 * np.sqrt(stiffness)}
        q = scenes.run(scenes.tower([1.0] * n), "penalty", 1e-3, 5000, **options).q[:, -1]
        return q[-1] / (q[-1] - q[-2]) / (n * (n + 1) / 2)

    def piled(n, power, stiffness=1e5, dt=1e-3):
        """Return the same for springs whose force is the stiffness times depth to a power."""
        q, v = np.zeros(n), np.zeros(n)
        for _ in range(3000):
            depth = np.maximum(0.0, -np.diff(q, prepend=0.0))
            force = stiffness * depth**power - 100.0 * np.diff(v, prepend=0.0)
            force = np.where(depth > 0.0, np.maximum(0.0, force), 0.0)
            v += dt * (force - np.append(force[1:], 0.0) - scenes.GRAVITY)
            q += dt * v
        return q[-1] / (q[-1] - q[-2]) / (n * (n + 1) / 2)

    n, few = result.input("n", 10), result.input("few", 3)
    # On the ground (1 - d) g = d k d r for one body, k = 1/(d T)^2.
    ground, constant = 0.1 * scenes.GRAVITY * 0.02**2, (0.9, 0.9, 0.001, 0.5, 2.0)
    # The independent truth with constant impedance: n^2 times the depth of a single body.
    square = [depths(m, solimp=constant)[0] / (m**2 * ground) for m in (few, 5, n)]
    shares = {m: depths(m)[1] for m in (few, 5, n)}
    big, small = (
        result.measure("share", shares[n], 1e-3),
        result.measure("share_few", shares[few], 1e-3),
    )
    hertz = result.measure("hertz", piled(few, 1.5), 1e-3)
    result.statement = f"Constant impedance over n^2 ground units: {np.round(square, 9)}."
    result.statement_holds(
        abs(big - 1) < 0.02,
        only_if="all contacts are equal springs whose force is proportional to the depth",
        inside=[abs(springs(m, k) - 1) < 1e-4 for m, k in ((3, 3e4), (6, 1e4), (n, 1e4))]
        + [abs(piled(few, 1.0) - 1) < 1e-3],
        outside=[abs(share - 1) < 0.02 for share in shares.values()]
        # Chosen to break it: springs that are equal and stiffen with the depth, as between balls.
        + [abs(piled(m, 1.5) - 1) < 0.02 for m in (few, 6)],
        cases=True,
    )
    result.correction_holds(
        np.allclose(square, 1.0, atol=1e-9),
        big < 0.7,
        abs(big / small - 1) > 0.02,
        # Each depth is the load above it to the power 2/3.
        abs(hertz / np.mean(np.arange(1, few + 1) ** (2 / 3)) * (few + 1) / 2 - 1) < 1e-2,
    )


@claim(
    "MuJoCo's refsafe, on by default, keeps a contact stable at any step.",
    "It raises the time constant T to at least two steps. A single body's contact with constant "
    "impedance is a spring and damper with omega = 1/(T zeta) and the ratio zeta. It is stable "
    "below 2 zeta T (sqrt(1 + zeta^2) - zeta), which is above T/2 only if zeta is above "
    "1/sqrt(8). Below that, refsafe does not help: at a ratio of {zeta:.1f} all steps above "
    "{measured:.3f} T fail, with it and without. Bodies that touch at several points need more "
    "damping. At a ratio of {several:.2f} a single ball comes to rest, while a box on its four "
    "corners and a tower of three still move at more than {moving:.0f} m/s or rad/s after "
    "{steps:.0f} steps. At {rests:.1f} all of them come to rest. These figures belong to an "
    "impedance of {hard:.1f}. At {soft:.1f} towers of two and three still move at the default "
    "ratio of 1 and come to rest at {damped:.0f}. Keep the default ratio, and an impedance of at "
    "least {hard:.1f}, the default.",
    source="MuJoCo 4.0 documentation, Modeling, Solver parameters",
)
def refsafe_keeps_it_stable(result):
    from course.charts.contact.limits import SAVED, calm, soft_limit
    from course.measure.stability import limit
    from course.oracles.mujoco import contact

    low = result.input("zeta", 0.3)
    # Bisection in units of T; the theory below is from the eigenvalues of one spring and damper.
    measured = limit(lambda ratio: calm(low, ratio, True), 0.3, 0.6, rel=1e-3)
    result.measure("measured", measured, tolerance=1e-2)
    # Damping ratios on both sides of 1/sqrt(8) by 0.02, where the verdict changes.
    high, shares = result.rng.uniform(SAVED + 0.02, 2.0, 8), result.rng.uniform(1.05, 20.0, 8)
    below = result.rng.uniform(0.1, SAVED - 0.02, 8)
    several, rests = result.input("several", 0.38), result.input("rests", 0.6)
    steps = result.input("steps", 2000)

    hard, soft = result.input("hard", 0.9), result.input("soft", 0.5)
    damped = result.input("damped", 2.0)

    def moves(ratio, count, dt=0.002, impedance=hard):
        """Return the largest speed of free boxes on each other that should be at rest."""
        # A time constant of a quarter step forces refsafe to act.
        limits = (impedance, impedance, 0.001, 0.5, 2.0)
        options = contact.Options(dt, solref=(dt / 4, ratio), solimp=limits)
        return np.abs(contact.box(options, (0.5, 0.2), count).run(steps)[1]).max()

    def heavy_on_light(ratio, mass=100.0, dt=0.002):
        """Return the speed of a heavy ball on a light one, two contacts on one line."""
        options = contact.Options(
            dt, condim=1, solref=(dt / 4, ratio), solimp=(0.9, 0.9, 0.001, 0.5, 2.0)
        )
        return np.abs(contact.tower(options, [1.0, mass]).run(steps)[1]).max()

    # What is left of a motion that does not die out is chaotic, so a bound is on record.
    moving = result.input("moving", 1.0)
    more = [moves(z, n) < 1e-3 for z in (0.36, 0.37) for n in (1, 3)]
    yielding = [moves(1.0, n, impedance=soft) < 1e-3 for n in (2, 3)]
    draws = [
        (float(z), int(n), float(d))
        for z, n, d in zip(
            result.rng.uniform(rests, 2.0, 6),
            result.rng.integers(1, 5, 6),
            result.rng.uniform(hard, 0.99, 6),
            strict=True,
        )
    ]
    result.statement = f"In theory {soft_limit(low):.4f}, with refsafe {measured:.4f} T."
    result.statement_holds(
        calm(low, 1.0, True),
        only_if="the damping ratio is above 1/sqrt(8), and larger still where a body touches at "
        "several points or its impedance is low",
        inside=[calm(z, s * soft_limit(z), True) for z, s in zip(high, shares, strict=True)]
        + [moves(rests, n) < 1e-3 for n in (1, 3)]
        + [moves(z, n, impedance=d) < 1e-3 for z, n, d in draws],
        outside=[calm(z, s * soft_limit(z), True) for z, s in zip(below, shares, strict=True)]
        + more
        # Chosen to break it: the default ratio, above all of these, and a soft contact.
        + yielding,
    )
    result.correction_holds(
        abs(measured / soft_limit(low) - 1) < 0.01,
        # Without refsafe the limit is that of the theory, within 2 % on both sides.
        not any(calm(z, 1.02 * soft_limit(z), False) for z in high),
        all(calm(z, 0.98 * soft_limit(z), False) for z in (*high, *below)),
        not any(more),
        not any(yielding),
        max(moves(damped, n, impedance=soft) for n in (2, 3)) < 1e-3,
        calm(several, 4.0, True),
        min(moves(several, 1), moves(several, 3), heavy_on_light(several)) > moving,
        max(moves(z, n, dt) for z in (rests, 1.0) for n in (1, 3) for dt in (0.002, 0.02)) < 1e-3,
        max(heavy_on_light(z) for z in (rests, 1.0)) < 1e-3,
    )


@claim(
    "MuJoCo's contact forces are accurate to many digits.",
    "With the default tolerance, for a sliding box with elliptic cones and no warm start, "
    "Newton's forces are off by up to "
    "{Newton:.0e} of the largest force, those of CG by {CG:.0e}, and those of PGS by {PGS:.0e}.",
    source="MuJoCo 4.0 documentation, XML reference, option",
)
def default_tolerance(result):
    import mujoco

    from course.contact.soft import soft_forces
    from course.oracles.mujoco import contact

    def box(options):
        return contact.box(options, (0.5, 0.2))

    def stack(options):
        return contact.box(options, (0.3, 0.0), 4)

    def heavy_on_light(options):
        return contact.tower(replace(options, condim=1), [1.0, 1e6])

    def worst(solver, tolerance, ls_tolerance, make=box, until=150, **more):
        """Return the largest difference from our forces over the largest force, on the way."""
        options, deviation = contact.Options(solver=solver, tolerance=tolerance, **more), []
        runner = make(options)
        runner.model.opt.ls_tolerance = ls_tolerance
        # States along the whole motion, as the error depends on which contacts slide.
        for steps in range(5, until, 5):
            runner.run(steps)
            state = contact.contact_state(runner)
            if state is not None:
                # An independent solver of the same convex problem, for MuJoCo's own rows and
                # compliances.
                ours = soft_forces(state.problem, options.softness(state.weight))[0]
                deviation.append(np.abs(state.force - ours).max() / np.abs(ours).max())
        return max(deviation)

    usual = mujoco.MjModel.from_xml_string("<mujoco/>").opt
    given, solvers = (usual.tolerance, usual.ls_tolerance), contact.SOLVERS
    deviation = [result.measure(solver, worst(solver, *given), tolerance=0.5) for solver in solvers]
    tight = worst("Newton", 0.0, 1e-6)
    result.statement = f"Tolerance {given[0]:g}; at 0 Newton is off by {tight:.0e}."
    result.statement_holds(
        max(deviation) < 1e-9,
        only_if="the solver is run to convergence, as Newton's is with its tolerance set to zero",
        # Chosen to break it: a stack, a heavy body on a light one, a pyramid, stiff friction rows,
        # and MuJoCo's own tolerance of the line search.
        inside=[tight < 1e-9]
        + [worst("Newton", 0.0, given[1], make, 25) < 1e-9 for make in (stack, heavy_on_light)]
        + [worst("CG", 0.0, given[1], heavy_on_light, 25) < 1e-9]
        + [worst("Newton", 0.0, given[1], box, 25, cone="pyramidal") < 1e-9]
        + [worst("Newton", 0.0, given[1], box, 25, impratio=x) < 1e-9 for x in (0.01, 1e4)],
        # With a tolerance of zero PGS ends at the default limit of iterations, not at convergence.
        outside=[x < 1e-9 for x in deviation] + [worst("PGS", 0.0, given[1], box, 25) < 1e-9],
        cases=True,
    )
    result.correction_holds(tight < 1e-9, 1e-6 < min(deviation), max(deviation) < 1e-2)


@claim(
    "MuJoCo, Drake and Bullet all solve contact at the level of velocities.",
    "MuJoCo's standard integrators solve for forces and accelerations, so the force of a given "
    "state does not depend on the step: it changes by {change:.0e} from {short_ms:.1f} to "
    "{long_ms:.0f} ms. (Only if the step exceeds half the contact's time constant does refsafe "
    "soften it.) The impulse of a velocity-level model stops the approach within the step, "
    "however short it is, so its force grows as 1/h. With MuJoCo's integrator called discrete "
    "the force does depend on the step, by {discrete:.0%} here.",
    source="MuJoCo 4.0 documentation, Computation; Drake documentation, Contact modeling",
)
def mujoco_is_velocity_level(result):
    from course.contact import scenes, solve
    from course.oracles.mujoco import contact

    short, long = result.input("short_ms", 0.5), result.input("long_ms", 4.0)

    def force(ms, integrator="Euler"):
        # The same penetrating and approaching state for every step, so that only dt differs.
        runner = contact.block(contact.Options(1e-3 * ms, integrator), 0.0, (0.0, 0.0), -0.001)
        runner.data.qvel[2] = -0.5
        state = contact.contact_state(runner)
        assert state is not None
        return state.force[0]

    def rigid(ms):
        dt = 1e-3 * ms
        problem = scenes.ball_drop().problem(dt, np.array([-0.001]), np.array([-0.5]))
        return solve("lcp", problem).impulses[0, 0] / dt

    change = abs(force(long) / force(short) - 1)
    result.measure("change", max(change, 1e-12), tolerance=0.5)
    grown = rigid(short) / rigid(long)
    result.measure("rigid_growth", grown, tolerance=1e-6)
    result.statement = (
        f"{force(short):.4f} and {force(long):.4f} N; rigid ones differ {grown:.2f}-fold."
    )
    standard = ("Euler", "RK4", "implicit", "implicitfast")
    selected = [abs(force(long, i) / force(short, i) - 1) < 1e-9 for i in standard]
    other = 1 - force(long, "discrete") / force(short, "discrete")
    discrete = result.measure("discrete", other, tolerance=1e-3)
    result.statement_holds(change > 0.1)
    result.correction_holds(
        all(selected),
        grown > 5,
        discrete > 0.1,
        # refsafe acts once 2 dt exceeds the default time constant of 20 ms: 9.9 ms is just below.
        force(15.0) < 0.9 * force(9.9),
        force(9.9) > 0,
        abs(force(9.9) / force(long) - 1) < 1e-9,
    )


@claim(
    "A stack at rest stays at rest at larger steps with rigid constraints, solved to convergence, "
    "than with an explicitly integrated penalty.",
    "A tower of three equal boxes stays at rest with rigid methods at every step tried, up to "
    "{largest_s:.0f} s, while such a penalty has a limit. (A penalty that is integrated "
    "implicitly, as with ERP and CFM, has none.) A soft contact with MuJoCo's refsafe switched "
    "off has a limit as well: its tower collapses at {soft_ms:.0f} ms. Stable is not accurate, "
    "though. At {dt_ms:.0f} ms a rigid contact keeps a tower at rest to {rest_um:.0e} um, but it "
    "misses the point where a braking block stops by {missed_mm:.0f} mm of {way_mm:.0f}, and that "
    "error is proportional to the step.",
)
def constraints_take_larger_steps(result):
    from course.charts.contact.limits import measured_limit
    from course.contact import scenes

    dt = result.input("dt_ms", 20.0) * 1e-3

    def blows_up(model, step, **options):
        path = scenes.run(scenes.tower([1.0] * 3), model, step, 60, **options)
        # A tower at rest must be at rest at the end; 1 cm/s is far above rounding.
        return bool(np.abs(path.v[:, -20:]).max() > 1e-2)

    stiff = {"stiffness": 1e5, "damping": 200.0}
    rest = np.abs(scenes.run(scenes.tower([1.0] * 3), "coulomb", dt, 200).q).max()

    def missed(step):
        end = scenes.run(scenes.block(0.0, 0.5, (1.0, 0.0)), "coulomb", step, round(0.4 / step)).q
        return abs(end[0, -1] - route)

    # v^2 / (2 mu g) for 1 m/s and mu = 0.5.
    route = 1.0 / scenes.GRAVITY
    result.measure("rest_um", max(1e6 * rest, 1e-9), tolerance=0.5)
    result.measure("missed_mm", 1e3 * missed(dt), tolerance=1e-2)
    result.measure("way_mm", 1e3 * route, tolerance=1e-6)
    limit = measured_limit(0.3, "semi-implicit") / np.sqrt(1e5)
    steps = limit * result.rng.uniform(1.5, 6.0, 6)
    worse = [blows_up("penalty", h, **stiff) for h in steps]
    result.statement = (
        f"The penalty contact's limit is {1e3 * limit:.2f} ms; rigid at {dt:g} s: {rest:.1e} m."
    )
    soft, largest = 1e-3 * result.input("soft_ms", 50.0), result.input("largest_s", 1.0)
    calm = [blows_up(m, h) for m in ("lcp", "pgs", "coulomb", "convex") for h in (dt, 0.1, largest)]
    result.statement_holds(all(worse) and not any(blows_up("coulomb", h) for h in (*steps, dt)))
    result.correction_holds(
        rest < 1e-9,
        # A first-order error: a tenth of the step leaves a tenth of the error.
        abs(missed(dt) / missed(0.1 * dt) - 10) < 2,
        not any(calm),
        blows_up("soft", soft, refsafe=False),
        not blows_up("soft", soft),
    )


@claim(
    "500 kN/m is the contact stiffness of steel.",
    "That is soft for steel. According to Hertz, a steel ball of {radius_mm:.0f} mm radius on a "
    "steel plate has {stiffness_mn_m:.0f} MN/m under {load_n:.0f} N, and more under a larger load. "
    "For one kilogram on it, without damping, semi-implicit Euler needs steps below "
    "{step_ms:.2f} ms.",
    source="Johnson, Contact Mechanics, 1985, sec. 4.2",
)
def steel_stiffness(result):
    from course.charts.contact.limits import measured_limit

    radius, load = result.input("radius_mm", 10.0) * 1e-3, result.input("load_n", 10.0)
    # Hertz's effective modulus: 1 / E* = 2 (1 - nu^2) / E for two equal materials.
    modulus = 210e9 / (1 - 0.3**2) / 2  # both of steel

    def stiffness(force):
        """Return the slope of F = 4/3 E sqrt(R) d^(3/2), by differences [N/m]."""

        def depth(f):
            return (0.75 * f / (modulus * np.sqrt(radius))) ** (2 / 3)

        # The contact stiffens with load, so its stiffness is a slope, here by central differences.
        return 2e-3 * force / (depth(1.001 * force) - depth(0.999 * force))

    k = result.measure("stiffness_mn_m", 1e-6 * stiffness(load), tolerance=1e-5)
    step = 1e3 * measured_limit(0.0, "semi-implicit") / np.sqrt(1e6 * k)
    result.measure("step_ms", step, tolerance=1e-3)
    loads = result.rng.uniform(1.0, 1e4, 8)
    result.statement = f"{k:.1f} MN/m under {load:g} N."
    result.statement_holds(any(stiffness(f) <= 5e5 for f in loads))
    result.correction_holds(k > 5, stiffness(10 * load) > 1.5e6 * k)


@claim(
    "MuJoCo has a built-in timer.",
    "mjData has one for each stage of a step; the Python package provides the clock. The "
    "time of a stage is its duration divided by its number of calls, here {calls:.0f} for "
    "{steps:.0f} steps.",
)
def mujoco_timer(result):
    import mujoco

    steps = result.input("steps", 50)
    runner = _stack()
    data = mujoco.MjData(runner.model)
    for _ in range(steps):
        mujoco.mj_step(runner.model, data)
    stage = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    collision = data.timer[mujoco.mjtTimer.mjTIMER_POS_COLLISION]
    calls = result.measure("calls", stage.number)
    result.statement = f"A step has a time above 0: {bool(stage.duration > 0)}."
    result.statement_holds(bool(stage.duration > 0) and stage.number > 0)
    result.correction_holds(calls == steps, bool(0 < collision.duration < stage.duration))
