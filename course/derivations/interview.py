"""Claims of chapter 12: statements about trials, cycles, contacts and losses in interviews."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "p": Symbol("probability", 0.05, 0.95),
    "d": Symbol("half width of the interval", 0.01, 0.2),
    "D": Symbol("distance [m]"),
    "a": Symbol("acceleration [m/s^2]"),
    "b": Symbol("bias of the accelerometer [m/s^2]"),
    "t": Symbol("time [s]"),
    "v": Symbol("speed [m/s]"),
    "m": Symbol("mass [kg]"),
    "k": Symbol("stiffness [N/m]"),
    "g": Symbol("gravity [m/s^2]"),
    "c": Symbol("side of a cell [m]"),
    "s": Symbol("standard deviation of a sample"),
    "h": Symbol("sample time [s]"),
    "r1": Symbol("reward of the first action"),
    "r2": Symbol("reward of the second action"),
    "L1": Symbol("length of the first link [m]"),
    "L2": Symbol("length of the second link [m]"),
    "L3": Symbol("length of the third link [m]"),
    "q1": Symbol("first angle [rad]"),
    "q2": Symbol("second angle, against the first link [rad]"),
    "q3": Symbol("third angle, against the second link [rad]"),
}


@claim(
    "A policy that reaches a gate of 70 % in a hundred trials has a true success rate of at least "
    "70 %.",
    "A policy with a true rate of {worse:.2f} passes with probability {lucky:.2f}, and one whose "
    "true rate equals the gate with {fair:.2f}. After {passed:.0f} successes in {n:.0f} trials "
    "Wilson's interval at two standard deviations is {low:.2f} to {high:.2f}. An interval of half "
    "width d at two standard deviations takes about {formula} trials.",
    ask=(
        "A true success rate is p. About how many trials does an interval of half width d take, at "
        "two standard deviations?",
        "n = 4*p*(1 - p)/d^2",
        {
            "p*(1 - p)/d^2": "That is one standard deviation.",
            "2*p*(1 - p)/d^2": "The factor of two is squared together with the standard deviation.",
            "4*p/d^2": "The variance of a trial is p (1 - p).",
            "4*p*(1 - p)/d": "The width falls with the square root of n.",
        },
    ),
    source="E. Wilson, Probable inference, the law of succession, 1927",
)
def hundred_trials(result):
    import sympy
    from scipy.stats import binom

    from course.measure.success import wilson

    p, d, n = sympy.symbols("p d n", positive=True)
    result.formula = sympy.solve(sympy.Eq(d, 2 * sympy.sqrt(p * (1 - p) / n)), n)[0]
    gate, worse = result.input("gate", 0.7), result.input("worse", 0.65)
    tried = int(result.input("n", 100))
    passed = result.measure("passed", round(gate * tried))
    # Exact binomial tail: at least `passed` successes.
    lucky = result.measure("lucky", binom.sf(passed - 1, tried, worse))
    fair = result.measure("fair", binom.sf(passed - 1, tried, gate))
    low, high = (float(x) for x in wilson(passed, tried))
    result.measure("low", low)
    result.measure("high", high)
    observed = np.mean(result.rng.binomial(tried, worse, 40_000) >= passed)
    needed = int(result.formula.subs({p: gate, d: 0.05}))
    draws = result.rng.binomial(needed, gate, 40_000) / needed
    # The normal approximation's own promise, 95 % within the half width, checked by sampling.
    inside = np.mean(np.abs(draws - gate) < 0.05)
    result.statement = "Binomial sums, and 40,000 draws of a hundred trials."
    result.statement_holds(lucky < 0.025)
    result.correction_holds(
        abs(observed - lucky) < 0.01, 0.5 < fair < 0.6, low < worse < high, 0.94 < inside < 0.97
    )


@claim(
    "A simulated accelerometer returns the acceleration of its body, plus noise.",
    "It returns the specific force: acceleration minus gravity, in the axes of the sensor. At rest "
    "MuJoCo's accelerometer reads {rest:.2f} m/s^2 upward, in free fall zero. If you integrate the "
    "reading twice to get the position, a constant bias b causes the error {formula}: "
    "{drift:.1f} m after {seconds:.0f} s at {bias:g} m/s^2.",
    ask=(
        "An accelerometer at rest has a constant bias b. You integrate it twice. What is the "
        "error of the position after the time t?",
        "b*t^2/2",
        {
            "b*t": "That is the error of the speed.",
            "b*t^2": "Integrating t once more brings a factor of one half.",
            "b*t^2/4": "The mean speed error is half of the final one: halve once.",
        },
    ),
    source="D. Titterton and J. Weston, Strapdown Inertial Navigation Technology, 2004, ch. 2",
)
def imu_reads_acceleration(result):
    import mujoco
    import sympy

    b, t, w = sympy.symbols("b t w", positive=True)
    result.formula = sympy.integrate(sympy.integrate(b, (w, 0, w)), (w, 0, t))
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='2 2 .1'/><body pos='0 0 .1'><freejoint/>"
        "<geom type='box' size='.1 .1 .1' mass='1'/><site name='s'/></body></worldbody>"
        "<sensor><accelerometer site='s'/></sensor></mujoco>"
    )

    def read(height, seconds, turn=(1.0, 0.0, 0.0, 0.0)):
        data = mujoco.MjData(model)
        data.qpos[2], data.qpos[3:7] = height, turn
        while data.time < seconds:
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        return data.sensordata.copy(), data.qacc[:3].copy(), data.xmat[1].reshape(3, 3)

    at_rest, still, _ = read(0.1, 1.0)
    rest = result.measure("rest", at_rest[2], 1e-3)
    fall = np.linalg.norm(read(5.0, 0.2)[0])
    deviation = 0.0
    for turn in result.rng.normal(size=(6, 4)):
        # Specific force: acceleration less gravity, rotated into the sensor's frame.
        felt, acceleration, axes = read(5.0, 0.0, turn / np.linalg.norm(turn))
        deviation = max(deviation, np.abs(felt - axes.T @ (acceleration - model.opt.gravity)).max())
    bias, seconds = result.input("bias", 0.05), result.input("seconds", 10)
    dt = 1e-3
    drift = np.cumsum(np.cumsum(np.full(round(seconds / dt), bias)) * dt)[-1] * dt
    result.measure("drift", drift, 1e-3)
    result.statement = "MuJoCo's sensor on a box at rest, falling, and turned at random."
    result.statement_holds(abs(rest - still[2]) < 0.1)
    report = float(result.formula.subs({b: bias, t: seconds}))
    result.correction_holds(
        abs(rest - 9.81) < 0.01, fall < 1e-9, deviation < 1e-9, abs(drift / report - 1) < 1e-3
    )


@claim(
    "An arm that starts to stop as soon as its sensor reads 10 N presses with about 10 N at most.",
    "Detecting the force does not stop the arm. A mass m that runs into a stiffness k with the "
    "speed v presses with {formula} if nothing brakes: {free:.0f} N at {speed:g} m/s, {mass:g} kg "
    "and {stiff:.0f} N/m. With a brake of {brake:.0f} N that acts {late_ms:.0f} ms after the "
    "sensor reads {felt:.0f} N, the peak is {braked:.0f} N. To stay at {felt:.0f} N without a "
    "brake, the arm may arrive with {slow:.3f} m/s at most.",
    ask=(
        "A mass m runs into a spring of stiffness k with speed v; no other force acts. What is the "
        "largest force?",
        "F = v*sqrt(k*m)",
        {
            "v*sqrt(k/m)": "That is an acceleration.",
            "k*v": "Stiffness times speed is not a force: a spring multiplies a distance.",
            "m*v^2/2": "That is the kinetic energy.",
            "v*k*m": "Solve k x^2 = m v^2 for x first, then multiply by k.",
        },
    ),
    source="S. Haddadin and others, Robot collisions, IEEE Transactions on Robotics, 2017",
)
def stop_at_ten_newtons(result):
    import sympy

    m, k, v, x = sympy.symbols("m k v x", positive=True)
    result.formula = k * sympy.solve(sympy.Eq(k * x**2 / 2, m * v**2 / 2), x)[0]
    mass, speed = result.input("mass", 4), result.input("speed", 0.25)
    stiff, brake = result.input("stiff", 25_000), result.input("brake", 100)
    late, limit = result.input("late_ms", 8) / 1000, result.input("felt", 10)

    def peak(start, braking):
        # 1 us is far below the contact's period, so that the peak is not missed between steps.
        place, rate, felt, largest, now, dt = 0.0, start, None, 0.0, 0.0, 1e-6
        while rate > 0:
            force = stiff * place
            felt = now if felt is None and force >= limit else felt
            # The brake acts only after the detection delay.
            on = braking and felt is not None and now >= felt + late
            rate -= dt * (force + (brake if on else 0.0)) / mass
            place += dt * rate
            largest, now = max(largest, force), now + dt
        return largest

    free = result.measure("free", peak(speed, False), 1e-4)
    braked = result.measure("braked", peak(speed, True), 1e-4)
    slow = result.measure("slow", limit / np.sqrt(stiff * mass))
    report = float(result.formula.subs({m: mass, k: stiff, v: speed}))
    result.statement = "A mass that runs into a spring, with and without a brake."
    result.statement_holds(braked < 1.5 * limit)
    result.correction_holds(
        abs(free / report - 1) < 1e-3, braked < free, abs(peak(slow, False) / limit - 1) < 1e-3
    )


@claim(
    "An impedance controller of 2000 N/m holds a payload as precisely as position control.",
    "It behaves like a spring: an unmodelled payload of mass m pulls it down by {formula}, "
    "{sag:.1f} mm for {mass:g} kg. A position controller with an integral term removes this "
    "steady-state error: {left:.0e} mm remain after {seconds:.0f} s.",
    ask=(
        "A spring of stiffness k holds a hand. By how much does a payload of mass m pull it down?",
        "m*g/k",
        {
            "m/k": "A mass is not a force: multiply it by gravity.",
            "m*g/(2*k)": "One half belongs to the energy of a spring, not to its force.",
            "k/(m*g)": "Upside down: a stiffer spring gives way less.",
        },
    ),
    source="N. Hogan, Impedance control, 1985",
)
def stiff_is_position(result):
    import sympy

    m, g, k, x = sympy.symbols("m g k x", positive=True)
    result.formula = sympy.solve(sympy.Eq(k * x, m * g), x)[0]
    stiff, mass = result.input("stiff", 2000), result.input("mass", 1)
    seconds, hand, dt = result.input("seconds", 5), 3.0, 1e-4

    # The same hand twice, as a pure spring and damper and with an integral in the law.
    def remaining(integral):
        place, rate, total = 0.0, 0.0, 0.0
        for _ in range(round(seconds / dt)):
            total += integral * -place * dt
            force = -stiff * place - 150.0 * rate + total - mass * 9.81
            rate += dt * force / (hand + mass)
            place += dt * rate
        return 1000 * abs(place)

    sag = result.measure("sag", remaining(0.0), 1e-3)
    removed = result.measure("left", remaining(8000.0), 0.2)
    result.statement = "A hand under a payload, with and without an integral."
    result.statement_holds(sag < 1)
    result.correction_holds(
        abs(sag / float(result.formula.subs({m: mass, g: 9.81, k: stiff})) / 1000 - 1) < 1e-3,
        removed < 1e-3 * sag,
    )


@claim(
    "A PID controller always has to filter its derivative term.",
    "It should do so where samples are noisy: the derivative from two samples has the noise "
    "{formula}. A first-order filter with the smoothing factor {alpha:.2f} leaves {quiet:.2f} of "
    "this noise. But the filter is also a delay: a loop without noise then settles in {soft:.0f} "
    "ms instead of {sharp:.0f} ms.",
    ask=(
        "Samples y at intervals of h have white noise with standard deviation s. What is the "
        "standard deviation of (y[i] - y[i-1])/h?",
        "sqrt(2)*s/h",
        {
            "s/h": "Both samples are noisy, not only one.",
            "2*s/h": "Variances add up, standard deviations do not.",
            "sqrt(2)*s*h": "The difference is divided by h.",
            "sqrt(2)*s": "Check the unit: a derivative is per second.",
        },
    ),
    source="K. Astrom and T. Hagglund, Advanced PID Control, 2006, sec. 3.3",
)
def derivative_is_filtered(result):
    import sympy

    s, h = sympy.symbols("s h", positive=True)
    result.formula = sympy.sqrt(s**2 + s**2) / h
    dt, noise, alpha = 1e-3, 1e-4, result.input("alpha", 0.04)
    samples = result.rng.normal(0, noise, 200_000)
    rates, state = np.diff(samples) / dt, 0.0
    smooth = np.empty_like(rates)
    for i, rate in enumerate(rates):
        # First-order low-pass (exponential smoothing).
        state += alpha * (rate - state)
        smooth[i] = state
    report = float(result.formula.subs({s: noise, h: dt}))
    quiet = result.measure("quiet", smooth.std() / rates.std(), 0.03)

    def settled(share):
        """Return after which time a step stays within a thousandth of its goal [ms]."""
        place, rate, last, slope, away = 0.0, 0.0, -1.0, 0.0, 0.0
        for i in range(2000):
            error = place - 1.0
            slope += share * ((error - last) / dt - slope)
            last = error
            rate += dt * (-900.0 * error - 40.0 * slope)
            place += dt * rate
            away = i if abs(place - 1.0) > 1e-3 else away
        return 1000 * away * dt

    sharp, soft = result.measure("sharp", settled(1.0)), result.measure("soft", settled(alpha))
    result.statement = "200,000 noisy samples, and a step of a loop that has no noise."
    result.statement_holds(soft < sharp)
    result.correction_holds(
        abs(rates.std() / report - 1) < 0.01,
        soft > 1.1 * sharp,
        abs(quiet / (alpha / np.sqrt(2 - alpha)) - 1) < 0.05,
    )


@claim(
    "Energy that grows all the time shows that the time integration is unstable.",
    "A force or an impact rule may feed energy in. To tell them apart, halve the time step. The "
    "growth of ln E per second that explicit Euler causes is halved, from {whole:.2f} to "
    "{half:.2f}, and Heun's scheme loses more than half of it. The growth that friction with the "
    "wrong sign causes stays, {fed:.2f} and {fed_half:.2f}. An impact rule can feed energy in "
    "although the flight between impacts is exact: a ball that is put back on the ground whenever "
    "it is found below gains {bounced:.0%} in {bounces:.0f} bounces.",
)
def growing_energy(result):
    def growth(step, dt, damping):
        """Return the growth of ln E per second of an oscillator with 10 rad/s over 4 s."""
        state = np.array([1.0, 0.0])

        def rate(x, v):
            return -100.0 * x - damping * v

        for _ in range(round(4 / dt)):
            state = step(state, dt, rate)
        return np.log((100 * state[0] ** 2 + state[1] ** 2) / 100) / 4

    def explicit(state, dt, rate):
        return state + dt * np.array([state[1], rate(*state)])

    def heun(state, dt, rate):
        ahead = explicit(state, dt, rate)
        return (state + explicit(ahead, dt, rate)) / 2

    def verlet(state, dt, rate):
        middle = state[1] + dt / 2 * rate(*state)
        place = state[0] + dt * middle
        return np.array([place, middle + dt / 2 * rate(place, middle)])

    # Halving the step separates the integrator's growth, which falls, from a force's, which stays.
    whole, half = (growth(explicit, dt, 0.0) for dt in (4e-3, 2e-3))
    fed, fed_half = (growth(verlet, dt, -0.4) for dt in (4e-3, 2e-3))
    result.measure("whole", whole)
    result.measure("half", half)
    result.measure("fed", fed)
    result.measure("fed_half", fed_half)
    result.statement = "An oscillator at two steps: explicit Euler, and a damper that drives."

    def report(step, damping, dt):
        """Return whether the energy grows, and clearly less at half the step."""
        rate = growth(step, dt, damping)
        return rate > 0 and growth(step, dt / 2, damping) < 0.75 * rate

    def bouncing(dt, bounces):
        """Return the shares of energy gained in elastic bounces, in all and in flight alone."""
        state, remaining, flown = np.array([1.0, 0.0]), bounces, 0.0
        pull = np.array([-9.81 * dt * dt / 2, -9.81 * dt])

        def energy(state):
            return float(9.81 * state[0] + state[1] ** 2 / 2)

        start = energy(state)
        while remaining:
            before = energy(state)
            state = np.array([[1.0, dt], [0.0, 1.0]]) @ state + pull
            # Energy change in flight alone, so that a gain can be attributed to the contact rule.
            flown = max(flown, abs(energy(state) - before) / start)
            if state[0] < 0.0:
                state, remaining = np.array([0.0, -state[1]]), remaining - 1
        return energy(state) / start - 1.0, flown

    bounces = int(result.input("bounces", 10))
    gains = [bouncing(float(dt), bounces) for dt in result.rng.uniform(5e-3, 2e-2, 6)]
    bounced = result.measure("bounced", bouncing(result.input("step", 0.01), bounces)[0], 1e-4)
    steps = result.rng.uniform(2e-3, 8e-3, 8)
    result.statement_holds(
        fed < 0.1,
        only_if="neither a force nor an impact rule adds energy",
        inside=[report(explicit, 0.2 * 100 * h, h) for h in steps],
        outside=[
            *(report(verlet, d, 4e-3) for d in result.rng.uniform(-1, -0.1, 8)),
            # Chosen to break it: the flight is exact, and the energy grows all the same.
            *(bool(gain > 0.01 and flight > 1e-9) for gain, flight in gains),
        ],
        cases=True,
    )
    result.correction_holds(
        abs(whole / half - 2) < 0.05,
        abs(fed / fed_half - 1) < 0.05,
        abs(fed - 0.4) < 0.02,
        bounced > 0.05,
        all(gain > 0.01 and flight < 1e-12 for gain, flight in gains),
        0 < 4 * growth(heun, 2e-3, 0.0) < growth(heun, 4e-3, 0.0),
    )


@claim(
    "When recorded commands are replayed in simulation, an error at the start means latency, and "
    "an error that grows means friction.",
    "It depends on what is replayed. If the commands are torques, a growing error may come from a "
    "wrong friction or a wrong inertia: here it grows {rough:.0f} and {heavy:.1f} times from the "
    "first fifth of the run to the last. If they are positions of a repeating motion, the error "
    "of a wrong friction hardly grows: {rough_held:.1f} times. Latency shows where the joint is "
    "fast, not at the start: the error is the delay times the speed, to within {off:.0%}, and "
    "zero at a start from rest.",
)
def error_by_its_shape(result):
    dt, n = 1e-3, 3000
    turn = 2 * np.pi * np.arange(n) * dt
    torque, desired = np.sin(turn) + 0.5 * np.sin(2.3 * turn), 1 - np.cos(turn)

    def replay(law, inertia=0.1, friction=0.05, delay=0):
        """Return places and rates of a joint under a law of sample, place and rate."""
        place = rate = 0.0
        observed = np.empty((2, n))
        for i in range(n):
            given = law(i - delay, place, rate) if i >= delay else 0.0
            rate += dt * (given - friction * rate) / inertia
            place += dt * rate
            observed[:, i] = place, rate
        return observed

    def torques(i, place, rate):
        return torque[i]

    def positions(i, place, rate):
        return 50.0 * (desired[i] - place) - 3.0 * rate

    def grown(law, **wrong):
        """Return how many times larger the error's root mean square is in the last fifth."""
        deviation = (replay(law, **wrong)[0] - replay(law)[0]) ** 2
        return np.sqrt(deviation[-n // 5 :].mean() / deviation[: n // 5].mean())

    rough = result.measure("rough", grown(torques, friction=0.07))
    heavy = result.measure("heavy", grown(torques, inertia=0.12))
    held = result.measure("rough_held", grown(positions, friction=0.07))
    places, rates = replay(torques)
    late = 10
    error = places - replay(torques, delay=late)[0]
    report = late * dt * rates
    deviation = result.measure(
        "off", np.sqrt(((error - report) ** 2).mean() / (report**2).mean()), 0.05
    )
    result.statement = "Torques and positions replayed on a joint with one parameter off at a time."
    result.statement_holds(rough > 2 and held > 2)
    result.correction_holds(rough > 2, heavy > 2, held < 1.5, deviation < 0.1)


@claim(
    "A* finds a path through a gap wherever there is one.",
    "A* is complete only on its graph. Take a grid with cells of side c that count as free only if "
    "no obstacle touches them. With cells of {cell:g} m, a straight gap of {narrow:g} m along the "
    "grid was open at {open_narrow:.0%} of the random positions of the grid, and a gap of "
    "{wide:g} m at {open_wide:.0%}. The width {formula} is enough at any position. A gap of "
    "{wide:g} m that was rotated against the grid was open in {turned:.0%} of the samples, and "
    "one of {safe:g} m in all.",
    ask=(
        "Cells of side c count as free only if no obstacle touches them. What is the smallest "
        "width of a gap along the grid that is open at any position of the grid?",
        "2*c",
        {
            "c": "Both sides of the gap may cut through a cell.",
            "c/2": "Not even one cell fits.",
            "3*c": "Less is enough: between two cut cells only one has to be whole.",
        },
    ),
    source="S. LaValle, Planning Algorithms, 2006, sec. 5.1",
)
def complete_planners(result):
    import sympy
    from scipy.ndimage import label

    cell = result.input("cell", 0.1)
    narrow, wide = result.input("narrow", 0.15), result.input("wide", 0.2)

    def open_share(gap, places=200):
        """Return the share of places of the grid for which its free cells join the two halves."""
        found_open = 0
        for shift in result.rng.uniform(0, cell, places):
            edges = np.arange(-10, 11) * cell + shift
            # A cell of the gap is free only if both of its edges are inside.
            rows = (edges[:-1] >= -1e-12) & (edges[1:] <= gap + 1e-12)  # wholly within the gap
            free = np.ones((20, 9), dtype=bool)
            free[:, 4] = rows
            # Connected components of free cells: what A* can reach on its grid.
            areas, _ = label(free)
            found_open += areas[0, 0] == areas[0, 8]
        return found_open / places

    def turned_share(gap, angles, half=0.25):
        """Return the share of places at which a gap in a wall of twice the half thickness is open.

        Args:
            gap: its width [m].
            angles: by which it is turned to the grid, a place for each [rad].
            half: half the thickness of the wall [m].
        """
        n, found_open = 40, 0
        for angle in angles:
            edges, (across, along) = (np.arange(n) - n / 2) * cell, result.rng.uniform(0, cell, 2)
            x, y = np.meshgrid(edges + across, edges + along, indexing="ij")
            cos, sin = np.cos(angle), np.sin(angle)
            corners = [(x + i * cell, y + j * cell) for i in (0, 1) for j in (0, 1)]
            u = np.array([cos * a + sin * b for a, b in corners])  # through the gap
            w = np.array([cos * b - sin * a for a, b in corners])  # along the wall
            free = np.ones((n, n), dtype=bool)
            for side in (-1.0, 1.0):
                # Cell and half of the wall are convex: apart if an axis of either parts them.
                ends = [(a, side * b) for a in (-half, half) for b in (gap / 2, 10.0)]
                xs = [cos * a - sin * b for a, b in ends]
                ys = [sin * a + cos * b for a, b in ends]
                # Separating axis test of two rectangles: the wall's axes, then the grid's.
                separation = [u.min(0) - half, -half - u.max(0), gap / 2 - (side * w).max(0)]
                separation += [x - max(xs), min(xs) - x - cell, y - max(ys), min(ys) - y - cell]
                free &= np.max(separation, axis=0) >= -1e-12
            areas, _ = label(free)
            costs = [
                np.where(free, (u.mean(0) + s) ** 2 + w.mean(0) ** 2, 1e9) for s in (1.2, -1.2)
            ]
            first, second = (areas.flat[int(np.argmin(cost))] for cost in costs)
            found_open += first == second
        return found_open / len(angles)

    # The first edge lies x < c above the lower side of the gap; a whole cell above it has to fit.
    c, x = sympy.symbols("c x", positive=True)
    result.formula = sympy.limit(x + c, x, c, "-")
    tight = result.measure("open_narrow", open_share(narrow), 0.3)
    roomy = result.measure("open_wide", open_share(wide), 0.0)
    shut = open_share(0.09)
    safe = result.input("safe", 0.29)
    angles = np.radians(result.rng.uniform(10.0, 40.0, 60))
    turned = result.measure("turned", turned_share(wide, angles), 0.5)
    every = np.radians(result.rng.uniform(0.0, 90.0, 60))
    fitting = 2.0 * np.sqrt(2.0) * cell * result.rng.uniform(1.0, 1.3, 4)
    wider, closer = result.rng.uniform(2 * cell, 4 * cell, 8), result.rng.uniform(0, 2 * cell, 8)
    result.statement = "Free cells of a grid, joined, at drawn places of the grid over a gap."
    result.statement_holds(
        tight == 1,
        only_if="a gap along the grid is at least two cells wide, and a gap at any other angle at "
        "least 2 sqrt(2) cells, where A* searches a grid of wholly free cells",
        # Chosen to break it: gaps that are turned to the grid.
        inside=[
            *(open_share(gap) == 1 for gap in wider),
            *(turned_share(float(gap), every[:20]) == 1 for gap in fitting),
        ],
        outside=[
            *(open_share(gap) == 1 for gap in closer),
            *(turned_share(x * cell, angles[:20]) == 1 for x in (2.0, 2.1, 2.2)),
        ],
    )
    result.correction_holds(
        0.3 < tight < 0.7, roomy == 1, shut == 0, turned < 0.3, turned_share(safe, every) == 1
    )


@claim(
    "A planner that is twice as fast makes a pick-and-place cycle more than ten per cent shorter.",
    "It saves half of the time that the arm waits for a plan. A move over the distance D "
    "takes {formula} if the arm reaches its top speed v with the acceleration a. With "
    "{moves:.0f} moves of {move:.2f} s, {grip:g} s of gripping and {compute_ms:.0f} ms of "
    "computing, {plan_ms:.0f} ms of it planning, a planner that is twice as fast shortens the "
    "cycle by {won:.1%}. Twice the acceleration shortens it by {quick:.0%}.",
    ask=(
        "A hand moves from rest to rest over the distance D. It accelerates and brakes with a and "
        "reaches its top speed v. How long does the move take?",
        "T = D/v + v/a",
        {
            "D/v": "The hand also has to speed up and to brake.",
            "D/v + 2*v/a": "While it speeds up and brakes, it moves at half of v on average.",
            "D/v + v/(2*a)": "That counts only one of the two ramps.",
            "2*sqrt(D/a)": "That is the time if the top speed is not reached.",
        },
    ),
    source="Chapter 5 derives the trapezoid",
)
def computing_and_cycle(result):
    import sympy

    D, v, a, T = sympy.symbols("D v a T", positive=True)
    result.formula = sympy.expand(sympy.solve(sympy.Eq(v * (T - v / a), D), T)[0])
    far, fast, hard = 0.6, 1.0, result.input("acceleration", 2)

    def taken(limit):
        """Return the time from rest to rest [s], by small steps.

        The motion is as fast as allowed and brakes as late as possible.
        """
        place, rate, now, dt = 0.0, 0.0, 0.0, 1e-5
        while place < far - 1e-7 and now < 10:
            # Bang-bang: brake once the stopping distance v^2 / (2 a) equals what is left.
            brakes = far - place <= rate * rate / (2 * limit)
            rate = max(rate - limit * dt, 1e-4) if brakes else min(rate + limit * dt, fast)
            place, now = place + rate * dt, now + dt
        return now

    move = result.measure("move", taken(hard), 5e-3)
    report = float(result.formula.subs({D: far, v: fast, a: hard}))
    moves, grip = result.input("moves", 4), result.input("grip", 0.6)
    computing = result.input("compute_ms", 170) / 1000
    plan = result.input("plan_ms", 100) / 1000
    cycle = moves * move + grip + computing
    won = result.measure("won", plan / 2 / cycle, 0.01)
    quick = result.measure("quick", moves * (move - taken(2 * hard)) / cycle, 0.01)
    result.statement = "A move from rest to rest in small steps, and a cycle of four."

    def shorter(waits):
        """Return by how much half the planning shortens cycles, simulated over random moves.

        Args:
            waits: what planning takes, as shares of the cycles.
        """
        for share in waits:
            rest = result.rng.uniform(0.3, 1.5) + sum(
                taken(limit) for limit in result.rng.uniform(1.0, 6.0, 2)
            )
            waiting = rest * share / (1.0 - share)
            yield 1.0 - (rest + waiting / 2.0) / (rest + waiting)

    result.statement_holds(
        won > 0.1,
        only_if="planning takes more than a fifth of the cycle while the arm waits",
        inside=[part > 0.1 for part in shorter(result.rng.uniform(0.201, 0.8, 8))],
        outside=[part > 0.1 for part in shorter(result.rng.uniform(0.05, 0.199, 8))],
    )
    result.correction_holds(abs(move / report - 1) < 0.01, won < 0.03, quick > 5 * won)


@claim(
    "While a policy gets better, the policy-gradient loss -E[A log pi] falls.",
    "Only the gradient of this loss has a meaning, and only at the policy that collected the "
    "data: there it is minus the gradient of the return, which for two actions is {formula}. With "
    "scores half a unit away it differs by {away:.0%} on average. Whether the value of the loss "
    "falls depends on the baseline. Behaviour cloning uses the same expression with A = 1 on the "
    "actions of a demonstrator. There it is a negative log-likelihood, which may be minimised.",
    ask=(
        "A policy has two actions with rewards r1 and r2. It chooses the first with probability p, "
        "the logistic function of a score. What is the derivative of the mean reward with respect "
        "to this score?",
        "p*(1 - p)*(r1 - r2)",
        {
            "p*(r1 - r2)": "The derivative of the logistic function is p (1 - p).",
            "r1 - r2": "That is the derivative with respect to p, not to the score.",
            "p*(1 - p)*r1": "The other action loses the probability that this one gains.",
        },
    ),
    source="R. Williams, Simple statistical gradient-following algorithms, 1992",
)
def loss_of_a_policy(result):
    import sympy

    r1, r2, z = sympy.symbols("r1 r2 z")
    p = sympy.symbols("p", positive=True)
    logistic = 1 / (1 + sympy.exp(-z))
    slope = sympy.diff(logistic * r1 + (1 - logistic) * r2, z)
    result.formula = sympy.simplify(slope.subs(z, sympy.log(p / (1 - p))))

    def share(scores):
        weights = np.exp(scores - scores.max())
        return weights / weights.sum()

    def gradient(f, scores, step=1e-6):
        return np.array(
            [
                (f(scores + step * e) - f(scores - step * e)) / (2 * step)
                for e in np.eye(len(scores))
            ]
        )

    def deviation(away):
        """Return how far the two slopes are apart, as a share of the return's."""
        rewards, scores = result.rng.normal(size=(2, 4))
        drawn = share(scores)
        # Expected value of A log pi with the actions weighted as the data were drawn.
        gain = drawn * (rewards - drawn @ rewards)
        at = scores + away * result.rng.normal(size=4)
        loss = gradient(lambda x: -gain @ np.log(share(x)), at)
        true = gradient(lambda x: share(x) @ rewards, at)
        return np.linalg.norm(loss + true) / np.linalg.norm(true)

    def fell(baseline):
        """Return how much the loss on its own data falls as a policy of two actions gets better."""
        rewards = np.array([1.0, 0.0])
        even, better = (
            -(p * (rewards - baseline)) @ np.log(p) for p in np.array([[0.5, 0.5], [0.9, 0.1]])
        )
        return even - better

    result.statement = "Gradients of policies over four actions, by differences."
    result.statement_holds(fell(0.0) > 0 and fell(1.0) > 0)
    away = result.measure("away", np.mean([deviation(0.5) for _ in range(40)]), 0.2)
    result.correction_holds(max(deviation(0.0) for _ in range(8)) < 1e-6, away > 0.05)


@claim(
    "In a planar arm, the position of each joint is that of the joint before, plus a link vector "
    "whose direction is the sum of the joint angles so far.",
    "This is true for angles that are measured against the link before. The tip of three links is "
    "at the height {formula}, and a product of transforms agrees to {digits:.0f} digits. If the "
    "angles are absolute, measured against the ground, sum the link vectors, but not the angles.",
    ask=(
        "A planar arm has three links, and each angle is measured against the link before. What is "
        "the height of the tip?",
        "L1*sin(q1) + L2*sin(q1 + q2) + L3*sin(q1 + q2 + q3)",
        {
            "L1*sin(q1) + L2*sin(q2) + L3*sin(q3)": "Here the angles are absolute.",
            "L1*cos(q1) + L2*cos(q1 + q2) + L3*cos(q1 + q2 + q3)": "That is the other axis.",
            "(L1 + L2 + L3)*sin(q1 + q2 + q3)": "Each link has its own sum of angles.",
        },
    ),
)
def joints_by_sums(result):
    import sympy

    lengths = sympy.symbols("L1 L2 L3", positive=True)
    angles = sympy.symbols("q1 q2 q3", real=True)
    whole = sympy.eye(3)
    for length, angle in zip(lengths, angles, strict=True):
        c, s = sympy.cos(angle), sympy.sin(angle)
        # Homogeneous transforms: turn about the joint, then move along the link.
        whole = whole * sympy.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        whole = whole * sympy.Matrix([[1, 0, length], [0, 1, 0], [0, 0, 1]])
    result.formula = sympy.simplify(whole[1, 2])
    deviation = 0.0
    for _ in range(20):
        links, turns = result.rng.uniform(0.1, 1, 3), result.rng.uniform(-3, 3, 3)
        sums = np.cumsum(turns)
        tip = np.cumsum(links * np.array([np.cos(sums), np.sin(sums)]), axis=1)[:, -1]
        frame = np.eye(3)
        for length, turn in zip(links, turns, strict=True):
            c, s = np.cos(turn), np.sin(turn)
            frame = frame @ [[c, -s, length * c], [s, c, length * s], [0, 0, 1]]
        deviation = max(deviation, np.abs(tip - frame[:2, 2]).max())
    result.measure("digits", np.floor(-np.log10(deviation + 1e-17)), 0.1)
    result.statement = "Twenty drawn arms, against products of homogeneous transforms."
    result.statement_holds(deviation < 1e-14)
    result.correction_holds(deviation < 1e-14)


@claim(
    "If one world in a hundred, chosen at random, is in contact, the contact code of a batch "
    "costs about a hundredth of the full price.",
    "Lanes that share their instructions run a branch together, so a group skips it only if all of "
    "its lanes do. A group of four runs it with the probability {formula}. With {p:.0%} of the "
    "worlds in contact and {lanes:.0f} lanes, {groups:.0%} of the groups run it, so {ratio:.0f} "
    "times as many lanes are occupied as need it. Arms of this course behind a wall, in random "
    "order, gave {measured:.0f} times; the same arms sorted by contact gave {sorted:.2f} times.",
    ask=(
        "Each world is in contact with probability p, independently. With which probability does a "
        "group of four lanes execute the contact branch?",
        "1 - (1 - p)^4",
        {
            "4*p": "That counts groups with two contacts twice.",
            "p^4": "That is the probability that all of them are in contact.",
            "(1 - p)^4": "That is the probability that none is.",
        },
    ),
    source="NVIDIA, CUDA C++ Programming Guide, SIMT architecture, 2024",
)
def rare_contact_is_cheap(result):
    import sympy

    from course.charts.sim_to_real.layouts import executed, touching

    p, n, k = sympy.symbols("p n k", positive=True)
    chance = sympy.binomial(n, k) * p**k * (1 - p) ** (n - k)
    executes = 1 - chance.subs(k, 0)
    result.formula = sympy.simplify(executes.subs(n, 4))
    share, lanes = result.input("p", 0.01), int(result.input("lanes", 32))

    def theory(share, lanes):
        return float(executes.subs({p: share, n: lanes}))

    groups = result.measure("groups", theory(share, lanes), 1e-9)
    ratio = result.measure("ratio", groups / share, 1e-9)
    arms = touching(share)
    measured = result.measure("measured", executed(arms, lanes), 0.1)
    after = result.measure("sorted", executed(np.sort(arms), lanes), 0.1)

    def gap(share, lanes, count=400_000):
        """Return how far random lanes are from theory, in standard deviations of the groups."""
        flags = result.rng.random(count // lanes * lanes) < share
        chance = theory(share, lanes)
        observed = executed(flags, lanes) * flags.sum() / flags.size
        return (observed - chance) / np.sqrt(chance * (1.0 - chance) * lanes / flags.size)

    draws = [
        (0.5 * 10.0 ** (-3.0 * u), int(2 ** (1 + 5.99 * w))) for u, w in result.rng.random((24, 2))
    ]
    # Chosen to break it: contacts in runs of neighbours are not independent.
    runs = np.repeat(result.rng.random(6400) < 10 * share, lanes)[: 64 * 3200]
    result.statement = "Random lanes, and 65,536 arms of which some reach beyond a wall."
    result.statement_holds(ratio < 2.0)
    result.correction_holds(
        max(abs(gap(*draw)) for draw in draws) < 4.5,
        abs(measured / ratio - 1.0) < 0.12,
        after < 1.2,
        executed(runs, lanes) < 0.5 * theory(10 * share, lanes) / (10 * share),
    )


@claim(
    "A pass that reads four of seventeen numbers moves 17/4 times as many bytes if they lie in an "
    "array of structures.",
    "Memory moves in cache lines. Of a structure of {size:.0f} bytes the pass reads {read:.0f}, "
    "and touches {touched:.0f} bytes of lines of {line:.0f} bytes on average, since some "
    "structures begin so that the numbers straddle a line. A structure of arrays touches "
    "{dense:.0f}: {factor:.2f} times fewer instead of {naive:.2f}. A pass that reads all "
    "numbers moves the same in both layouts. Measured times can differ more, since a "
    "processor also fetches lines in advance.",
    source="U. Drepper, What every programmer should know about memory, 2007",
)
def bytes_by_fields(result):
    from course.charts.sim_to_real import layouts

    arms, line = layouts.start(8192), int(result.input("line", 64))
    size, read = result.input("size", layouts.BYTES), int(result.input("read", 32))

    def touched(numbers, width=256):
        """Return bytes of lines per arm: structures, then blocks of arrays."""
        return [
            layouts.lines_touched(make(arms, width), numbers, line)
            for make in (layouts.structures, layouts.blocks)
        ]

    loose, dense = touched(read // 8)
    result.measure("touched", loose, 1e-6)
    result.measure("dense", dense, 1e-6)
    factor = result.measure("factor", loose / dense, 1e-6)
    naive = result.measure("naive", size / (8 * len(arms[: read // 8])), 1e-6)

    def expected(numbers):
        """Return the average over all eight places in a line at which a structure can begin."""
        ends = [(8 * start + 8 * numbers - 1) // line + 1 for start in range(line // 8)]
        return line * float(np.mean(ends))

    # Neighbours share a line where the numbers read are nearly all: no more than all lines count.
    some = [(touched(k)[0], min(expected(k), size)) for k in range(1, 10)]
    every = touched(layouts.NUMBERS)
    result.statement = "Counted from the addresses of 8,192 arms in both layouts."
    result.statement_holds(abs(factor / naive - 1.0) < 0.05)
    result.correction_holds(
        all(abs(a - b) < 1.0 for a, b in some),
        abs(every[0] / every[1] - 1.0) < 1e-3,
        abs(dense - read) < 1e-9,
        # Chosen to break it: one structure as wide as the batch is a structure of arrays.
        abs(layouts.lines_touched(layouts.blocks(arms, 8192), read // 8, line) - read) < 1e-9,
    )
