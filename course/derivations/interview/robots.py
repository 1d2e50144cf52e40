"""Claims of chapter 12: sensors, joints and contacts, as interviewers ask about them."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "a": Symbol("acceleration [m/s^2]"),
    "b": Symbol("bias of the accelerometer [m/s^2]"),
    "t": Symbol("time [s]"),
    "v": Symbol("speed [m/s]"),
    "m": Symbol("mass [kg]"),
    "k": Symbol("stiffness [N/m]"),
    "g": Symbol("gravity [m/s^2]"),
    "s": Symbol("standard deviation of a sample"),
    "h": Symbol("sample time [s]"),
    "L1": Symbol("length of the first link [m]"),
    "L2": Symbol("length of the second link [m]"),
    "L3": Symbol("length of the third link [m]"),
    "q1": Symbol("first angle [rad]"),
    "q2": Symbol("second angle, against the first link [rad]"),
    "q3": Symbol("third angle, against the second link [rad]"),
}


@claim(
    "A correct model of an accelerometer returns the acceleration of its body, plus noise.",
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
        "A robot's hand is controlled like a spring of stiffness k. By how much does a payload of "
        "mass m pull it down?",
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
    "If the energy grows all the time, the time integration is unstable.",
    "A force or an impact rule may feed energy in. To tell them apart, halve the time step. At "
    "small steps, the growth of ln E per second that explicit Euler causes is halved, from "
    "{whole:.2f} to {half:.2f}, and Heun's scheme loses more than half of it. (Where angular "
    "frequency times step is 3 or more, explicit Euler's growth even rises with half the step.) "
    "The growth that friction with the wrong sign causes stays, {fed:.2f} and {fed_half:.2f}. An "
    "impact rule can feed energy in although the flight between impacts is exact: a ball that is "
    "put back on the ground whenever it is found below gains {bounced:.0%} in {bounces:.0f} "
    "bounces.",
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
        # Chosen to break "halved": large steps, and 0.3 s is 3 over the angular frequency.
        all(growth(explicit, h / 2, 0.0) > growth(explicit, h, 0.0) for h in (0.3, 0.4, 0.5, 1.0)),
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
    "If each joint angle of a planar arm is measured against the previous link, and the first "
    "against the horizontal, the sum of all angles up to a link is its direction, measured against "
    "the horizontal.",
    "The tip of three links is at the height {formula}, and a product of transforms agrees to "
    "{digits:.0f} digits. If the angles are absolute, measured against the horizontal, sum the "
    "link vectors, but not the angles.",
    ask=(
        "A planar arm has three links. The first angle is measured against the horizontal, each "
        "other one against the link before. What is the height of the tip?",
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
