"""Claims of chapter 11: what a pipeline can bear, and what it does beyond."""

from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "k": Symbol("largest stiffness over inertia [1/s^2]"),
    "d": Symbol("largest damping over inertia [1/s]"),
    "m": Symbol("eigenvalue of the inverse inertia [1/(kg m^2)]"),
    "kp": Symbol("proportional gain [N m/rad]"),
    "kd": Symbol("derivative gain [N m s/rad]"),
    "c": Symbol("friction of the joint [N m s/rad]"),
    "n": Symbol("frames by which an image is late", 1.0, 8.0),
    "g": Symbol("fraction of the observed error that is corrected", 0.1, 1.9),
    "r": Symbol("replanning distance [m]"),
    "s": Symbol("standard deviation of each axis [m]", 0.3, 3.0),
    "L": Symbol("processing time of a frame [s]"),
    "t": Symbol("angle by which a path bends [rad]", 0.1, 3.0),
    "b": Symbol("clearance [m]", 0.2, 2.0),
    "T": Symbol("period of the camera [s]"),
}


def swung(q, kp, kd, dt, steps, offset):
    """Return angles (steps, 2, N) of N arms under PD from an offset at rest.

    They are integrated by semi-implicit Euler.

    Args:
        q: postures at which the arms are held, (2, N) [rad].
        kp: stiffness, (N,) or one for all.
        kd: damping, (N,) or one for all.
        dt: step [s], (N,) or one for all.
        steps: number of steps.
        offset: deviations from q at the start, (2, N) [rad].
    """
    from course.kinematics.two_link import TwoLink, acceleration

    column = np.repeat(TwoLink().column(), q.shape[1], axis=1)
    at, v, observed = q + offset, np.zeros(q.shape), np.empty((steps, *q.shape))
    for i in range(steps):
        column[11:] = kp * (q - at) - kd * v
        # The torque is of the old state, so damping is explicit; the position takes the new
        # velocity.
        v = v + dt * acceleration(at, v, column)
        at = at + dt * v
        observed[i] = at
    return observed


def drawn(rng, n=12):
    """Return postures (2, n), springs and dampers (n,) by chance."""
    q = np.stack([rng.uniform(-3.0, 3.0, n), rng.uniform(0.0, 3.0, n)])
    return q, rng.uniform(10.0, 100.0, n), rng.uniform(1.0, 10.0, n)


def limits(q, kp, kd):
    """Return the largest stable steps (N,) [s]."""
    from course.kinematics import TwoLink
    from course.pipeline import theory

    return np.array([theory.step_limit(TwoLink(), *x) for x in zip(q.T, kp, kd, strict=True)])


def leaves(q, kp, kd, dt):
    """Return which of the arms swing far away from where they begin, 2e-6 rad beside."""
    with np.errstate(over="ignore", invalid="ignore"):
        # Microradians keep the nonlinear arm within its linearisation; a 15-fold growth is a
        # verdict.
        observed = swung(q, kp, kd, dt, 800, np.array([[1e-6], [-2e-6]]))
        return np.nanmax(np.abs(observed - q), axis=(0, 1)) > 3e-5


@claim(
    "A physics step that is stable in one posture of the arm is stable in all.",
    "The limit is {formula}, where k and d contain the largest eigenvalue of the inverse "
    "inertia matrix. That eigenvalue depends on the elbow: with the same gains the limit is "
    "{stretched:.2f} ms stretched and {folded:.2f} ms nearly folded.",
    ask=(
        "Semi-implicit Euler integrates x'' = -k x - d x' with the acceleration from the old "
        "state. What is the largest stable step?",
        "dt < (sqrt(d^2 + 4*k) - d)/k",
        {
            "2/sqrt(k)": "That is the limit without damping, which lowers it.",
            "d/k": "That is the limit of explicit Euler for an oscillation.",
            "(sqrt(d^2 + 4*k) + d)/k": "Damping lowers the limit here.",
            "2/d": "That is the limit without a spring.",
        },
    ),
)
def step_by_posture(result):
    import sympy

    h, k, d = sympy.symbols("h k d", positive=True)
    step = sympy.Matrix([[1 - h * h * k, h - h * h * d], [-h * k, 1 - h * d]])
    # Jury criterion: with damping and a growing step the eigenvalue -1 leaves the unit circle
    # first.
    edge = (step + sympy.eye(2)).det()  # the first eigenvalue to leave is -1
    result.formula = sympy.solve(sympy.expand(edge), h)[0]
    both = np.array([[0.3, 0.3], [0.0, 2.9]])
    gains = np.full(2, 25.0), np.full(2, 8.0)
    far, near = 1e3 * limits(both, *gains)
    result.measure("stretched", far)
    result.measure("folded", near)
    q, kp, kd = drawn(result.rng)
    at = limits(q, kp, kd)
    result.statement = (
        "The simulated arm, started 1e-6 rad away, 3 % on both sides of twelve limits."
    )
    # The geometric mean of both limits is stable in one of the postures only.
    result.statement_holds(not leaves(both, *gains, 1e-3 * np.sqrt(far * near)).any())
    result.correction_holds(
        bool(leaves(q, kp, kd, 1.03 * at).all()),
        not leaves(q, kp, kd, 0.97 * at).any(),
        near > 2.0 * far,
    )


@claim(
    "A semi-implicit simulation that computes the damping torque from the old velocity needs "
    "smaller steps to stay stable if Kd is larger.",
    "Held for a long step, that torque reverses the velocity and makes it larger than before. With "
    "the arm stretched and Kp = {kp:.0f}, the limit falls from {none:.1f} ms without Kd to "
    "{much:.1f} ms with Kd = {kd:.0f}. Damping at the new velocity would not lower it.",
)
def damping_and_step(result):
    from course.kinematics import TwoLink
    from course.pipeline import theory

    kp, kd = result.input("kp", 25.0), result.input("kd", 8.0)
    empty, amount = (1e3 * theory.step_limit(TwoLink(), (0.3, 0.0), kp, x) for x in (0.0, kd))
    result.measure("none", empty)
    result.measure("much", amount)
    q, springs, dampers = drawn(result.rng)
    less, more = limits(q, springs, dampers), limits(q, springs, 1.2 * dampers)
    # A step that is stable with the smaller damping and above the limit with the larger.
    between = np.sqrt(less * more)

    def implicit(kp, kd, m=90.0):
        """Return growth just below 2 / omega with the damping taken at the new velocity."""
        # Just below the undamped limit: implicit damping must leave it stable.
        dt = 1.99 / np.sqrt(kp * m)
        held = 1.0 / (1.0 + dt * kd * m)
        step = np.array([[1.0 - dt * dt * kp * m * held, dt * held], [-dt * kp * m * held, held]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    new = [implicit(*x) for x in zip(springs, dampers, strict=True)]
    result.statement = "Twelve arms with random gains, and the same with a fifth more damping."
    result.statement_holds(bool(np.all(more < less)))
    result.correction_holds(
        amount < 0.5 * empty,
        max(new) < 1.0,
        bool(leaves(q, springs, 1.2 * dampers, between).sum() >= 6),
        not leaves(q, springs, dampers, 0.97 * less).any(),
    )


@claim(
    "With the chapter's gains, the arm goes unstable at the largest physics step of the slider, "
    "and energy grows.",
    "The slider ends at {slider:.0f} ms. With these gains no posture allows more than {most:.1f} "
    "ms: at the target the limit is {reach:.1f} ms, stretched {stretched:.1f} ms. Without Kd, "
    "all postures allow more than the slider has. Motors with a torque limit hold an unstable "
    "arm in a small circle: at {step:.0f} ms {share:.0%} of the runs still succeed, while the "
    "energy from nowhere rises from {calm:.3f} to {wild:.3f} of the largest energy in the run. "
    "This limit is for small motions near a posture: at {below:.0%} of it, {far:.0%} of the "
    "arms that start {turn_rad:.1f} rad away do not come back.",
)
def largest_step(result):
    from course.pipeline import Scenario, Settings, run_many, successes, theory
    from course.pipeline.blame import gained

    scene, step = Scenario(), result.input("step", 15.0)
    settings = replace(Settings(), noise=5e-3)
    goal = run_many(scene, settings, [0])[0].log[-1, :2]
    reach = result.measure("reach", 1e3 * theory.step_limit(scene.arm, goal, 25.0, 8.0), 0.02)
    result.measure("stretched", 1e3 * theory.step_limit(scene.arm, (0.3, 0.0), 25.0, 8.0))
    runs = [
        run_many(scene, replace(settings, physics=1e-3 * h, control=1e-3 * h), range(8))
        for h in (2.0, step)
    ]
    calm, wild = (float(np.mean([gained(one, 25.0, 8.0) for one in some])) for some in runs)
    result.measure("calm", calm, 0.01)
    result.measure("wild", wild, 0.2)
    share = result.measure("share", successes(runs[1]).mean(), 0.2)
    q, kp, kd = drawn(result.rng)
    at = limits(q, kp, kd)
    # Chosen to break it: gains of all sizes, steps nearer to the limit, and a start far away.
    rng = result.rng
    # Three decades of stiffness, and damping from none to heavy.
    wide = q, 10.0 ** rng.uniform(0.0, 3.0, q.shape[1]), rng.uniform(0.0, 60.0, q.shape[1])
    edge = limits(*wide)
    postures = np.stack([rng.uniform(-3.0, 3.0, 200), rng.uniform(0.0, 3.0, 200)])
    gains = rng.uniform(10.0, 100.0, 200), rng.uniform(1.0, 10.0, 200)
    below, turn = result.input("below", 0.97), result.input("turn_rad", 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        away = np.array([[0.5 * turn], [-turn]])
        ends = (
            swung(postures, *gains, below * limits(postures, *gains), 3000, away)[-50:] - postures
        )
        # Written so that NaN, from an arm that has exploded, counts as lost.
        lost = ~(np.abs(ends).max(axis=(0, 1)) < 1e-2)
    far = result.measure("far", lost.mean(), 0.3)
    # The chapter's gains at the slider's end, in postures that cover the elbow's whole range.
    slider = result.input("slider", 20.0)
    bends = np.stack([np.full(61, 0.3), np.linspace(-np.pi, np.pi, 61)])
    chosen = np.full(61, settings.kp), np.full(61, settings.kd)
    largest = result.measure("most", 1e3 * limits(bends, *chosen).max())
    bare = 1e3 * limits(bends, chosen[0], np.zeros(61))
    result.statement = "Eight runs at each step, compared with arms without torque limits."
    result.statement_holds(bool(leaves(bends, *chosen, 1e-3 * slider).all()))
    result.correction_holds(
        largest < slider < bare.min(),
        bool(leaves(q, kp, kd, 1.03 * at).all()),
        bool(leaves(*wide, 1.01 * edge).all()),
        not leaves(q, kp, kd, 0.97 * at).any(),
        not leaves(*wide, 0.99 * edge).any(),
        step > reach,
        share > 0.7,
        wild > 10.0 * max(calm, 1e-3),
        far > 0.1,
        not leaves(postures, *gains, below * limits(postures, *gains)).any(),
    )


@claim(
    "With Kp very high and Kd zero the arm overshoots wildly.",
    "At Kp = {much:.0f} it overshoots by {high:.0%} of the step. But at Kp = {little:.0f} it "
    "is {low:.0%} already. The cause is the missing Kd: with Kd = {kd:.0f} there is no "
    "overshoot.",
)
def high_gain_overshoots(result):
    from course.kinematics import TwoLink
    from course.pipeline import theory

    def beyond(kp, kd, q):
        """Return the overshoot of a small step of the slow mode, measured and as predicted."""
        # Start along the slow eigenvector of M^-1, so that only one mode moves.
        modes = theory.modes(TwoLink(), q, kp, kd)
        shapes = np.linalg.eigh(np.linalg.inv(TwoLink().mass_matrix(np.array(q))))[1]
        # 250 steps per 1 / omega, so that the integrator's own error is far below the overshoot.
        dt = 0.004 / float(modes.omega[0])
        away = 1e-5 * shapes[:, :1]
        observed = swung(np.array(q)[:, None], kp, kd, dt, 1000, away)[:, :, 0] - q
        return max(0.0, float(-(observed @ shapes[:, 0]).min()) / 1e-5), float(modes.overshoot[0])

    bent = (0.624, 1.64)
    amount, little, kd = (
        result.input(*x) for x in (("much", 400.0), ("little", 25.0), ("kd", 8.0))
    )
    high, report = beyond(amount, 0.0, bent)
    low = result.measure("low", beyond(little, 0.0, bent)[0], 0.02)
    result.measure("high", high, 0.02)
    calm = beyond(little, kd, bent)[0]
    draws = zip(result.rng.uniform(100.0, 1000.0, 6), result.rng.uniform(0.0, 3.0, 6), strict=True)
    result.statement = (
        "Small steps of the slower of the arm's two oscillations, in random postures."
    )
    result.statement_holds(all(beyond(kp, 0.0, (0.3, q2))[0] > 0.5 for kp, q2 in draws))
    result.correction_holds(abs(high / report - 1.0) < 0.02, low > 0.8, calm < 1e-3)


@claim(
    "Once an arm swings, a higher Kp does not make it come to rest sooner.",
    "The swings decay as exp(-t / tau) with tau = {formula}, which does not contain Kp. From "
    "Kp {soft:.0f} to {stiff:.0f} a swing of the slow mode decays at the same rate, to "
    "{off:.1%}. A higher Kp only makes it swing faster.",
    ask=(
        "An arm under PD control swings in a mode with inverse inertia m, with Kd and friction"
        " c. What is the time constant with which its oscillation decays?",
        "tau = 2/((kd + c)*m)",
        {
            "1/((kd + c)*m)": "Half of the energy is in the spring, which is not damped.",
            "(kd + c)/kp": "That is the slow creep of an overdamped arm.",
            "2*m/(kd + c)": "m is an inverse inertia.",
            "2/(kd*m)": "Friction damps as well.",
        },
    ),
)
def swings_die(result):
    import sympy

    from course.kinematics import TwoLink
    from course.pipeline import theory

    kp, kd, c, m, x = sympy.symbols("kp kd c m x", positive=True)
    # Outside the root the pole has the real part -(kd + c) m / 2, which contains no kp.
    root = sympy.solve(x**2 + m * (kd + c) * x + m * kp, x)[0]
    result.formula = sympy.simplify(-1 / sum(part for part in root.args if not part.has(kp)))
    bent = (0.624, 1.64)
    value, shapes = np.linalg.eigh(np.linalg.inv(TwoLink().mass_matrix(np.array(bent))))
    soft, stiff = result.input("soft", 25.0), result.input("stiff", 250.0)

    def rate(kp):
        """Return the rate of decay, fitted to the logarithms of all peaks [1/s]."""
        dt = 0.02 / np.sqrt(kp * value[0])
        away = 1e-5 * shapes[:, :1]
        observed = swung(np.array(bent)[:, None], kp, 0.0, dt, 3000, away)[:, :, 0] - bent
        y = np.abs(observed @ shapes[:, 0])
        peaks = np.flatnonzero((y[1:-1] > y[:-2]) & (y[1:-1] > y[2:])) + 1
        # Logarithmic decrement: slope of the logarithm of the peaks over time.
        return float(np.polyfit(dt * peaks, -np.log(y[peaks]), 1)[0])

    slow, fast = rate(soft), rate(stiff)
    law = float(1 / result.formula.subs({kd: 0, c: 0.2, m: value[0]}))
    ring = [theory.modes(TwoLink(), bent, x, 0.0).ring[0] for x in (soft, stiff)]
    result.measure("off", abs(fast / slow - 1.0), 0.5)
    result.statement = "Peaks of a swing of 1e-5 rad without Kd."
    result.statement_holds(fast < 1.02 * slow)
    result.correction_holds(
        abs(slow / law - 1.0) < 0.03,
        abs(fast / law - 1.0) < 0.03,
        bool(abs(ring[0] / ring[1] - 1.0) < 1e-9),
    )


def fails_to_settle(gain, *late):
    """Return whether a look-and-move loop with delayed images fails to reach its target.

    It starts at an error of 1 and fails if that error grows beyond 1e6, or still exceeds 0.5 after
    20,000 images.

    Args:
        gain: share of the observed error that each move corrects.
        late: delays of the images in frames, taken in turn.
    """
    past = [1.0] * (max(late) + 1)
    for i in range(20_000):
        # Pure integrator with delay: the observed error is `late` frames old.
        past.append(past[-1] - gain * past[-1 - late[i % len(late)]])
        if abs(past[-1]) > 1e6:
            return True
    # A loop that has neither diverged nor settled counts as a failure.
    return abs(np.array(past[-40:])).max() > 0.5


@claim(
    "The target rests, and all images are n frames late and without noise. Then the error of look "
    "and move settles at zero for any gain that is above 0 and at most 1.",
    "With fresh images it does. If all images are n frames late, the gain must stay below "
    "{formula}: {one:.2f} for one frame, {four:.2f} for four. With delays that "
    "switched between two values, the limit of the longer one was enough in all our tests. A "
    "delay that varies in another way can need a smaller gain still.",
    ask=(
        "In each frame, a fraction g of the error seen n frames earlier is corrected. Below "
        "which g does it settle?",
        "g < 2*sin(pi/(2*(2*n + 1)))",
        {
            "2*sin(pi/(2*(2*n - 1)))": "Count the frames from 0: fresh images allow 2.",
            "pi/(2*n + 1)": "That is the approximation for small angles.",
            "2*sin(pi/(2*n + 1))": "The distance on the circle takes half the angle.",
            "1/n": "That has the right trend, and is too careful.",
        },
    ),
)
def look_and_move_limit(result):
    import sympy

    from course.pipeline import theory

    n, w = sympy.symbols("n w", positive=True)
    # z^n (z - 1) = -g on the circle: the angles n w + w / 2 + pi / 2 = pi, the sizes 2 sin(w / 2).
    angle = sympy.solve(sympy.Eq(n * w + w / 2 + sympy.pi / 2, sympy.pi), w)[0]
    result.formula = 2 * sympy.sin(sympy.simplify(angle / 2))
    result.measure("one", theory.look_limit(1))
    four = result.measure("four", theory.look_limit(4))
    # Delays of 0 to 8 frames, with gains 2 % to both sides of each limit.
    late = [int(x) for x in result.rng.integers(0, 9, 12)]
    inside, outside = (
        [not fails_to_settle(x * theory.look_limit(k), k) for k in late] for x in (0.98, 1.02)
    )
    exact = [float(result.formula.subs(n, k)) / theory.look_limit(k) for k in late]
    # Chosen to break it: gains that are tiny, none, or of the wrong sign, and delays that change.
    inside += [not fails_to_settle(0.02 * theory.look_limit(k), k) for k in late]
    outside += [not fails_to_settle(x, k) for x in (0.0, -0.01) for k in late]
    # Delays that alternate, with the gain of the shorter one and of the longer one.
    jumping = [not fails_to_settle(0.98 * theory.look_limit(k), k, k, k + 4, k + 4) for k in late]
    longest = [
        not fails_to_settle(0.98 * theory.look_limit(k + 4), k, k, k + 4, k + 4) for k in late
    ]
    result.statement = "The loop itself, 2 % on both sides of the limits for 0 to 8 late frames."
    result.statement_holds(
        not any(fails_to_settle(x, 4) for x in (0.2, 0.5, 1.0)),
        inside=inside,
        outside=outside,
        only_if="the gain is above 0 and below 2 sin(pi / (2 (2 n + 1)))",
    )
    result.correction_holds(
        all(abs(x - 1.0) < 1e-9 for x in exact),
        not any(outside),
        not all(jumping),
        all(longest),
        four < 0.5,
        not fails_to_settle(0.9, 0),
    )


@claim(
    "With fresh images, correcting the whole error at once leaves no error.",
    "It leaves the noise of one image in full. A gain g lets {formula} of its variance "
    "through: {part:.2f} at g = {gain:.1f}. With images that are {late:.0f} frames late it is "
    "{more:.2f}.",
    ask=(
        "In each frame, a fraction g of the error in a fresh, noisy image is corrected. How large "
        "is the variance of the position, divided by that of one image?",
        "g/(2 - g)",
        {
            "g^2": "Earlier images still contribute: each frame keeps 1 - g of the old error.",
            "g": "That is right only at g = 1.",
            "g^2/(2 - g)": "The geometric series in (1 - g)^2 has g (2 - g) in the denominator.",
            "g/(2 + g)": "Check the sign: 1 - (1 - g)^2 is g (2 - g).",
        },
    ),
)
def look_and_move_noise(result):
    import sympy

    from course.pipeline import theory

    g, V = sympy.symbols("g V", positive=True)
    # Stationary variance of the first-order recursion: V = (1 - g)^2 V + g^2.
    result.formula = sympy.simplify(sympy.solve(sympy.Eq(V, (1 - g) ** 2 * V + g**2), V)[0])
    gain, late = result.input("gain", 0.3), int(result.input("late", 2))

    def measured(gain, late):
        """Return the variance of 2,000 loops, as a share of that of a single picture."""
        past = list(np.zeros((late + 1, 2000)))
        for _ in range(200):
            past.append(past[-1] - gain * (past[-1 - late] + result.rng.standard_normal(2000)))
        # Only the last 60 frames, after the start at zero has been forgotten.
        return float(np.var(past[-60:]))

    part = result.measure("part", theory.look_noise(gain, 0))
    more = result.measure("more", theory.look_noise(gain, late))
    observed = measured(gain, 0), measured(gain, late), measured(1.0, 0)
    result.statement = "2,000 loops with white noise, compared with the formula."
    result.statement_holds(observed[2] < 0.1)
    result.correction_holds(
        abs(observed[0] / part - 1) < 0.05,
        abs(observed[1] / more - 1) < 0.05,
        more > part,
        abs(float(result.formula.subs(g, gain)) / part - 1.0) < 1e-9,
        abs(observed[2] - 1.0) < 0.05,
    )


@claim(
    "With a clearance of two standard deviations at most one plan in forty touches the disc.",
    "A straight path touches in {wall:.1%} of the cases, as next to a wall. A path that bends "
    "around the disc by an angle t is close to it on more sides, which adds {formula}: at two "
    "standard deviations it touches in {bent:.1%} for a quarter turn and in {round:.1%} for a "
    "half turn. Between two discs it is {lane:.1%}. Only the deviation across the path counts:"
    " noise with a correlation of {together:.1f} makes it up to {slanted:.1%} on a diagonal path.",
    ask=(
        "A disc was located with noise s on each axis. A path bends around it by an angle t at"
        " the clearance b. By how much does this raise the probability of contact, compared "
        "with a straight path?",
        "t/(2*pi)*exp(-b^2/(2*s^2))",
        {
            "t/(2*pi)*exp(-b^2/s^2)": "The exponent of a normal density has the denominator 2 s^2.",
            "exp(-b^2/(2*s^2))": "That is for a full circle; the path covers the angle t.",
            "t/pi*exp(-b^2/(2*s^2))": "The full circle is 2 pi.",
            "t/(2*pi)*exp(-b/s)": "The length of a normal vector has b^2 in the exponent.",
        },
    ),
)
def clearance_and_noise(result):
    import sympy

    from course.pipeline import theory

    t, b, s, x, angle = sympy.symbols("t b s x angle", positive=True)
    density = x / (2 * sympy.pi * s**2) * sympy.exp(-(x**2) / (2 * s**2))
    # The half-plane beyond the wall, plus a sector of angle t outside the radius b (Rayleigh tail).
    result.formula = sympy.integrate(density, (x, b, sympy.oo), (angle, 0, t))
    wall = float(theory.collision_share(2.0, np.eye(2), (1.0, 0.0)))
    bends = {"wall": 0.0, "bent": 0.5 * np.pi, "round": np.pi}
    law = {
        name: wall + float(result.formula.subs({t: turn, b: 2, s: 1}))
        for name, turn in bends.items()
    }
    for name, value in law.items():
        result.measure(name, value)
    error = result.rng.standard_normal((2, 80_000))  # of the disc, in standard deviations

    def touched(turn, radius=4.0, error=error):
        """Return the share of positions where a disc touches an arc with straight ends."""
        angles, far = np.linspace(-0.5, 0.5, 41) * turn, np.linspace(0.0, 7.0, 36)
        # The path is the offset curve of the disc at two standard deviations.
        arc = (radius + 2.0) * np.exp(1j * angles)
        ends = [arc[i] + 1j * sign * far * np.exp(1j * angles[i]) for i, sign in ((0, -1), (-1, 1))]
        away = np.full(error.shape[1], np.inf)
        for x in np.concatenate((arc, *ends)):
            away = np.minimum(away, np.abs(error[0] + 1j * error[1] - x))
        return float(np.mean(away < radius))

    result.statement = "80,000 random positions of a disc, and paths around it."
    straight = [touched(0.0, x) < 1.0 / 40.0 for x in result.rng.uniform(3.0, 20.0, 8)]
    sharp = [touched(x) < 1.0 / 40.0 for x in result.rng.uniform(0.4, np.pi, 8)]
    # Chosen to break it: noise that is large along the path; on a diagonal of correlated axes,
    # where it is large across; with a mean; and a second disc on the other side.
    together = result.input("together", 0.8)
    along = [touched(0.0, 4.0, error * [[1.0], [x]]) < 1.0 / 40.0 for x in (0.3, 2.0, 3.0)]
    diagonal = error * np.sqrt([[1.0 + together], [1.0 - together]])
    slanted = result.measure(
        "slanted",
        float(theory.collision_share(2.0, np.diag([1.0 + together, 1.0]), (1.0, 0.0))),
    )
    second = result.rng.standard_normal(80_000) > 2.0
    lane = result.measure("lane", 1.0 - (1.0 - wall) ** 2)
    both = float(np.mean(second | (error[0] > 2.0)))
    biased = touched(0.0, 4.0, error + [[0.5], [0.0]])
    worse = [touched(0.0, 4.0, diagonal), both, biased]
    result.statement_holds(
        all(straight) and all(sharp),
        only_if="the path passes one disc in a straight line, and the noise is normal, with mean 0 "
        "and that standard deviation across the path",
        inside=straight + along,
        outside=sharp + [x < 1.0 / 40.0 for x in worse],
    )
    result.correction_holds(
        # 80,000 samples leave 2 % on a share of a few per cent.
        all(abs(touched(turn) / law[name] - 1.0) < 0.05 for name, turn in bends.items()),
        abs(worse[0] / slanted - 1.0) < 0.05,
        abs(both / lane - 1.0) < 0.05,
        biased > 0.05,
    )


@claim(
    "With the planner's step at its minimum the arm comes late because it waits for the plan.",
    "That is the smaller part: at {cost_us:.0f} us per collision check it waits {wait_ms:.0f} ms. "
    "The larger part is a worse path: {corners:.0f} waypoints after all shortcuts instead of "
    "{few:.0f}, and {longer_ms:.0f} ms more of motion. {paid:.0%} of the runs succeed.",
)
def planner_step(result):
    from course.pipeline import Scenario, Settings, run_many, successes

    cost = result.input("cost_us", 20.0)
    near = replace(Settings(), noise=1e-4)

    def runs(step, n=12):
        records = run_many(Scenario(), replace(near, step=step, check_cost=1e-6 * cost), range(n))
        wait = [r.plans[0].arrived - r.plan_requests[0] for r in records]
        motion = [r.plans[0].value.motion.duration for r in records]
        corners = np.median([r.plans[0].value.waypoints.shape[1] for r in records])
        return successes(records).mean(), 1e-3 * np.array(wait), 1e3 * np.array(motion), corners

    # The same queries with a small and with a large step, seed by seed.
    (paid, wait, slow, corners), (fine, at_once, quick, few) = runs(0.002), runs(0.3)
    waited, longer = np.median(wait - at_once), np.median(slow - quick)
    rows = {"paid": paid, "wait_ms": np.median(wait), "longer_ms": longer}
    for name, value in (rows | {"corners": corners, "few": few, "fine": fine}).items():
        result.measure(name, value, 0.3)
    result.statement = "12 runs with steps of 0.3 and 0.002 rad, with almost no noise."
    # It waits, and hardly anything else makes it late.
    result.statement_holds(waited > 0.9 * (waited + longer))
    result.correction_holds(0.5 * longer < waited < longer, corners > few, paid <= fine)


@claim(
    "A camera that waits until the last frame is processed delivers older data than one that "
    "runs on and drops frames meanwhile.",
    "Its data is younger, or as old if L is an integer number of periods, because it takes its"
    " next image at once. The mean age is {formula}: {block_ms:.0f} ms where dropping gives "
    "{drop_ms:.0f} ms. With a queue it is {queue_ms:.0f} ms around {seconds:.0f} s and "
    "keeps growing.",
    ask=(
        "Processing a frame takes L, longer than the camera's period, and the camera waits "
        "until it is done. What is the mean age of the newest result?",
        "3*L/2",
        {
            "L + T/2": "That takes a second worker.",
            "L": "That is its age on arrival; then it gets older.",
            "2*L": "That is its largest age.",
        },
    ),
)
def overrun_ages(result):
    import sympy

    from course.pipeline import Scenario, Settings, repair, run

    L, t = sympy.symbols("L t", positive=True)
    # Between L, when a result arrives, and 2 L, just before the next one.
    result.formula = sympy.integrate(L + t, (t, 0, L)) / L
    seconds = result.input("seconds", 3.0)
    scene = Scenario(velocity=(-0.02, 0.015), seconds=seconds)
    u = np.array(scene.velocity)
    # Without noise, bias and filter only the delay is left.
    plain = replace(Settings(), noise=0.0, bias=(0.0, 0.0), filtered=False)

    def age(rule, late, period):
        """Return the mean over the phases of what an arm without lag aims at [s]."""
        cycle = {"drop": period * np.ceil(late / period), "block": late, "queue": period}[rule]
        aimed = []
        # Mean over eight phases of the camera, since the age is a sawtooth in time.
        for phase in (seconds - late - cycle * (np.arange(8) + 0.5) / 8) % cycle:
            report = replace(plain, overrun=rule, latency=late, frame=period, phase=float(phase))
            # The goal moves at a constant velocity: the error along it over the speed is an age.
            aimed.append(-run(scene, repair(report, "plan", "control")).error @ u / (u @ u))
        return float(np.mean(aimed))

    block, drop, queue = (age(rule, 0.25, 0.1) for rule in ("block", "drop", "queue"))
    for name, value in (("block_ms", block), ("drop_ms", drop), ("queue_ms", queue)):
        result.measure(name, 1e3 * value, 0.03)
    law = float(result.formula.subs(L, 0.25))
    others = [(age("block", late, 0.1), age("drop", late, 0.1)) for late in (0.11, 0.19)]
    result.statement = (
        "Runs with eight phases of a camera at 10 Hz whose frames take 250 ms to process."
    )
    result.statement_holds(block > drop)
    result.correction_holds(
        abs(block / law - 1.0) < 0.03, all(a < b for a, b in others), queue > 3.0 * drop
    )


@claim(
    "Noise in the estimate makes the planner start again and again.",
    "Only noise that jumps by the replanning distance does. A fraction {formula} of the raw "
    "frames is that far off. At {sigma:.2f} m a run of {seconds:.1f} s makes {raw:.0f} plans, and "
    "{calm:.1f} with a filter. A camera of {slow_hz:.0f} Hz reduces them to {few:.1f}. A planner "
    "that is not done before the next frame makes {late:.1f}, because it starts nothing new while "
    "it works.",
    ask=(
        "A plan was made for one noisy frame, with noise s on each axis. What fraction of the "
        "later frames is further than r from its goal?",
        "exp(-r^2/(4*s^2))",
        {
            "exp(-r^2/(2*s^2))": "The goal of the plan was noisy as well.",
            "exp(-r^2/s^2)": "Variances add to 2 s^2; the exponent divides by twice that.",
            "exp(-r/(2*s))": "The length of a normal vector has r^2 in the exponent.",
        },
    ),
)
def raw_estimate_replans(result):
    import sympy

    from course.pipeline import Scenario, Settings, run_many

    r, s, x = sympy.symbols("r s x", positive=True)
    # Difference of two noisy pictures: variance 2 s^2 per axis, so its length is Rayleigh.
    density = x / (2 * s**2) * sympy.exp(-(x**2) / (4 * s**2))
    result.formula = sympy.integrate(density, (x, r, sympy.oo))
    settings = Settings()
    scene = Scenario(seconds=result.input("seconds", 1.5))
    sigma = result.input("sigma", settings.noise)

    def plans(noise, filtered, seeds=range(4), **changed):
        report = replace(settings, noise=float(noise), filtered=filtered, **changed)
        return np.mean([len(record.plans) for record in run_many(scene, report, seeds)])

    raw = result.measure("raw", plans(sigma, False), 0.3)
    calm = result.measure("calm", plans(sigma, True, range(8)), 0.3)
    # The same share by sampling, independent of the integral.
    jumps = np.hypot(*(sigma * result.rng.standard_normal((2, 2, 50_000)).sum(axis=0)))
    far = float(np.mean(jumps > settings.replan))
    law = float(result.formula.subs({r: settings.replan, s: sigma}))
    # The same over whole runs: each frame beyond r becomes the goal of the next plan. New goals are
    # worse than average and good ones last longer, and the two cancel (a reversible chain).
    goal, over = np.full((2, 5000), np.nan), []
    for _ in range(80):
        frame = sigma * result.rng.standard_normal(goal.shape)
        beyond = ~(np.hypot(*(frame - goal)) <= settings.replan)
        goal[:, beyond] = frame[:, beyond]
        over.append(beyond.mean())
    third, draws = settings.replan / 3.0, result.rng.uniform(0.0, 1.0, 8)
    # Chosen to break it: much more noise and other cameras; few pictures; a planner that is slow.
    hz = result.input("slow_hz", 4.0)
    few = result.measure("few", plans(sigma, False, frame=1.0 / hz), 0.3)
    late = result.measure("late", plans(sigma, False, check_cost=3e-3), 0.3)
    wild = result.rng.uniform((1.5, 0.01, 0.05), (6.0, 0.03, 0.3), (4, 3)).tolist()
    result.statement = (
        "Runs of 1.5 s with raw and filtered estimates; six plans count as 'again and again'."
    )
    result.statement_holds(
        calm > 6.0,
        only_if="the frames are unfiltered, with noise of at least a third of the replanning "
        "distance on each axis, they come tens of times a second, and a plan is ready before "
        "the next frame",
        # From 15 % above a third of the distance; outside from 15 % below it.
        inside=[
            *(bool(plans((1.15 + 0.5 * x) * third, False) > 6.0) for x in draws),
            *(bool(plans(x * third, False, frame=T, latency=L) > 6.0) for x, T, L in wild),
        ],
        outside=[
            *(bool(plans((0.85 - 0.5 * x) * third, False) > 6.0) for x in draws),
            *(bool(plans(x * third, False, frame=1.0 / hz) > 6.0) for x, *_ in wild),
            *(bool(plans(x * third, False, check_cost=3e-3) > 6.0) for x, *_ in wild),
            *(bool(plans(x * third, True) > 6.0) for x, *_ in wild),
        ],
    )
    result.correction_holds(
        raw > 5.0 * calm,
        bool(abs(far / law - 1.0) < 0.05),
        bool(abs(np.mean(over[1:]) / law - 1.0) < 0.03),
        few < 6.0,
        late < 6.0,
    )


@claim(
    "Perception, planning, control and physics all have their turn at every control step.",
    "Each stage has its own rate. In the run with seed 0, of {seconds:.0f} s, the controller runs "
    "{laws:.0f} times, the camera {pictures:.0f} times, and the planner {plans:.0f} time. The "
    "plan takes as long as {periods:.1f} control periods, and the processing of a frame as long "
    "as {ages:.0f}. Several frames are therefore processed at once.",
)
def every_stage_its_clock(result):
    from course.pipeline import Scenario, Settings, run

    scene, settings = Scenario(), Settings()
    seconds = result.input("seconds", scene.seconds)
    record = run(replace(scene, seconds=seconds), settings)
    laws = result.measure("laws", len(record.log) - 1)
    pictures = result.measure("pictures", len(record.timetable.captured))
    plans = result.measure("plans", len(record.plans))
    control = 1e6 * settings.control
    periods = (record.plans[0].arrived - record.plan_requests[0]) / control
    result.measure("periods", periods, 0.3)
    first = record.pictures[0]
    ages = result.measure("ages", (first.arrived - first.captured) / control)
    result.statement = (
        "Counted in one run with the settings of the chapter; with other seeds, noise makes the "
        "planner start again."
    )
    result.statement_holds(laws == pictures == plans)
    result.correction_holds(plans < pictures < laws, periods > 1.0, ages > 10.0)
