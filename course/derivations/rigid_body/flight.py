"""Claims about free fall, the bouncing ball, its bounce rule, and bodies that fly through walls."""

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from course.derivations import Symbol, claim

GRAVITY, HEIGHT, STEP = 9.81, 5.0, 0.01  # the worked example: 1 kg, 5 m, 10 ms, restitution 1
START = GRAVITY * HEIGHT  # J
METHODS = ("explicit_euler", "semi_implicit_euler", "exact_flight")

SYMBOLS = {
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "h": Symbol("step [s]", 0.01, 1.0),
}


def falling(q: np.ndarray, v: np.ndarray, params: Any) -> np.ndarray:
    return np.full_like(v, -GRAVITY if params is None else params)


def step_of(method: str) -> Any:
    """Return the step of a method.

    Exact flight is what every second-order method takes in free fall.
    """
    from course.rigid_body import INTEGRATORS

    def parabola(q: Any, v: Any, acceleration: Any, dt: Any, params: Any) -> tuple[Any, Any]:
        a = acceleration(q, v, params)
        return q + dt * v + dt * dt * a / 2, v + dt * a

    return parabola if method == "exact_flight" else INTEGRATORS[method].step


@dataclass(frozen=True)
class Bounces:
    """Balls under the usual bounce rule: below the floor, y becomes 0 and v becomes -e v.

    Attributes:
        q, v, energy: after each step, shape (steps + 1, N) [m, m/s, J].
        bounced: whether the rule acted in a step, shape (steps + 1, N).
        by_rule: energy that putting the ball back on the floor has added, shape (N,) [J].
        by_restitution: energy that the restitution has taken, negative.
        by_flight: energy that the integrator has changed between bounces.
    """

    q: np.ndarray
    v: np.ndarray
    energy: np.ndarray
    bounced: np.ndarray
    by_rule: np.ndarray
    by_restitution: np.ndarray
    by_flight: np.ndarray

    def percent(self) -> Any:
        """Change of the energy from start to end, shape (N,), or a number for one ball."""
        change = 100 * (self.energy[-1] / self.energy[0] - 1)
        return change if change.size > 1 else float(change[0])


def drop(
    method: str,
    steps: int = 20_000,
    bounces: int = 10,
    dt: float | np.ndarray = STEP,
    e: float | np.ndarray = 1.0,
    height: float | np.ndarray = HEIGHT,
    speed: float | np.ndarray = 0.0,
) -> Bounces:
    """Drop balls side by side and let the bounce rule act after each step.

    Lengths are counted in g dt^2 / 981, a micrometre at 10 ms, and times in steps: then the worked
    example is whole numbers and its arithmetic exact. That matters, since its rebounds land
    *exactly* on the floor at the end of a step: in metres the last digit would decide whether the
    ball is below. Start heights are rounded to whole units.

    Args:
        method: "explicit_euler", "semi_implicit_euler", or "exact_flight".
        steps: steps at most.
        bounces: number of bounces after which a ball stops.
        dt: step [s], one for all or one each, as the next three.
        e: restitution.
        height: at the start [m].
        speed: at the start, upwards [m/s].
    """
    step, unit, g = step_of(method), GRAVITY * np.square(dt) / 981, 981.0
    q, v, unit, dt, e = np.broadcast_arrays(
        np.rint(np.divide(height, unit)), np.divide(speed, unit) * dt, unit, dt, e
    )
    q, v = np.atleast_2d(q), np.atleast_2d(v)
    rule = restitution = flight = np.zeros(q.shape)
    qs, vs, hits, count = [q], [v], [q < 0], np.zeros(q.shape)
    for _ in range(steps):
        if (count >= bounces).all():
            break
        q1, v1 = step(q, v, falling, 1.0, -g)
        # A ball that has done its bounces is frozen.
        q1, v1 = np.where(count < bounces, q1, q), np.where(count < bounces, v1, v)
        # Energy bookkeeping: what flight, contact rule and restitution each add must sum to the
        # change.
        flight = flight + g * (q1 - q) + (v1 * v1 - v * v) / 2
        hit = q1 < 0
        rule = rule - g * np.where(hit, q1, 0)
        restitution = restitution - (1 - e * e) * np.where(hit, v1 * v1 / 2, 0)
        q, v = np.where(hit, 0, q1), np.where(hit, -e * v1, v1)
        qs.append(q)
        vs.append(v)
        hits.append(hit)
        count = count + hit
    y, w = np.array(qs)[:, 0], np.array(vs)[:, 0]
    # Back from the integer units to joules.
    joule = np.square(unit / dt)
    energy = joule * (g * y + w * w / 2)
    parts = (joule * part[0] for part in (rule, restitution, flight))
    return Bounces(y * unit, w * unit / dt, energy, np.array(hits)[:, 0], *parts)


@functools.cache
def worked_example(method: str) -> Bounces:
    """Return the ball of the worked example, ten bounces."""
    return drop(method)


@functools.cache
def near(method: str, n: int = 500) -> Bounces:
    """Return ten bounces from starts up to 1 mm and one step's speed from the worked example's."""
    heights, speeds = np.random.default_rng(10).uniform(-1, 1, (2, n)) * [[1e-3], [GRAVITY * STEP]]
    return drop(method, height=HEIGHT + heights, speed=speeds)


def _tied(run: Bounces) -> np.ndarray:
    """Return whether the ball is exactly on the floor by chance before its last bounce.

    Positions that the contact rule itself puts on the floor don't count.
    """
    remaining = np.cumsum(run.bounced, axis=0) < run.bounced.sum(axis=0)
    return ((run.q == 0) & ~run.bounced & remaining).any(axis=0)


def _energy(y: float, v: float) -> float:
    return GRAVITY * y + v * v / 2


def _spread(run: Bounces) -> str:
    ends = run.energy[-1]
    return f"{ends.min():.2f} to {ends.max():.2f} J, on average {ends.mean():.2f} J"


def _change(method: str) -> tuple[Any, Any]:
    """Return (change of m g y + m v^2 / 2, change of v) in a step of free fall from any y and v."""
    import sympy

    m, g, h = sympy.symbols("m g h", positive=True)
    y, v = sympy.symbols("y v", real=True)
    # The integrator's own code runs on symbols, so the formula is of what is simulated.
    q1, v1 = step_of(method)(np.array([y]), np.array([v]), falling, h, -g)
    change = sympy.expand(m * g * (q1[0] - y) + m * (v1[0] ** 2 - v**2) / 2)
    return sympy.nsimplify(change, rational=True), sympy.expand(v1[0] - v)


@claim(
    "In its first step of free fall explicit Euler leaves the energy as it is.",
    "It adds {formula} at every step, the first one included: the position has not moved and the "
    "velocity has. Of {energy_at_start_j:.2f} J the worked example has {energy_after_step_1_j:.4f} "
    "J after a step.",
    ask=(
        "How much energy does explicit Euler add in each step of free fall?",
        "dE, E = m*g^2*h^2/2",
        {
            "m*g*h": "That would be a potential energy, with h a height; here h is the step.",
            "m*g^2*h^2": "Twice too much: expand (v - g h)^2 / 2 and the term in v cancels.",
            "-m*g^2*h^2/2": "Yours is semi-implicit Euler; explicit Euler gains.",
        },
    ),
)
def free_fall_energy_error(result):
    result.formula = _change("explicit_euler")[0]
    run = worked_example("explicit_euler")
    start, first = run.energy[0, 0], run.energy[1, 0]
    result.measure("energy_at_start_j", start)
    result.measure("energy_after_step_1_j", first)
    result.measure("added_mj", 1000 * (first - start))
    result.statement = f"Whatever the state, a step adds {result.formula}."
    result.statement_holds(first == start)
    result.correction_holds(
        abs(run.q[1, 0] - HEIGHT) < 1e-12, abs(run.v[1, 0] + GRAVITY * STEP) < 1e-15, first > start
    )


@claim(
    "The energy that semi-implicit Euler loses in free fall is dissipation.",
    "A step changes the energy by exactly {formula}, up or down alike, but m g y + m v^2 / 2 - m g "
    "h v / 2 is conserved exactly, and no area is lost in the plane of y and v. The error is m g h "
    "/ 2 times the change of v: it depends on how fast the ball is, not on how long it flew.",
    ask=(
        "By how much does semi-implicit Euler change the energy in each step of free fall?",
        "dE, E = -m*g^2*h^2/2",
        {
            "m*g^2*h^2/2": "Yours is explicit Euler; the sign is the other one here.",
            "0": "It is symplectic, but symplectic does not mean that energy is conserved.",
            "-m*g^2*h^2": "Twice too much: the kinetic part gives back half.",
        },
    ),
)
def semi_implicit_free_fall(result):
    import sympy

    result.formula, dv = _change("semi_implicit_euler")
    y, v, g, h = (sympy.Symbol(n, real=True) for n in "yvgh")
    end = step_of("semi_implicit_euler")(np.array([y]), np.array([v]), falling, h, -g)
    # Determinant of the Jacobian of one step: 1 means symplectic.
    area = sympy.Matrix([end[0][0], end[1][0]]).jacobian([y, v]).det()
    m, g, h = sympy.symbols("m g h", positive=True)
    # From 90 m up, so that no ball meets the floor within 3 s.
    heights, speeds = result.rng.uniform((90, -9), (150, 9), (50, 2)).T
    run = drop("semi_implicit_euler", 300, height=heights, speed=speeds)
    retained = run.energy - GRAVITY * STEP * run.v / 2
    lost = worked_example("semi_implicit_euler").energy[100, 0] - START
    result.measure("after_100_steps_j", lost)
    result.statement = (
        f"100 steps of 10 ms from rest lose {-lost:.4f} J. Over 50 throws up and down of 3 s the "
        f"conserved sum moves by {np.ptp(retained, axis=0).max():.0e} J."
    )
    result.statement_holds(bool(abs(area) < 1))
    result.correction_holds(
        area == 1,
        sympy.simplify(result.formula - m * g * h * dv / 2) == 0,
        np.ptp(retained, axis=0).max() < 1e-9 < 1 < np.ptp(run.energy, axis=0).max(),
    )


@claim(
    "Semi-implicit Euler, step 1 of the worked fall: y = 4.999 m, v = -0.0981 m/s, E = 49.05 J.",
    "So it is in the digits shown. With more of them the energy has fallen to {energy_j:.4f} J, as "
    "far as explicit Euler's rises.",
)
def worked_step_1_semi_implicit(result):
    run = worked_example("semi_implicit_euler")
    y, v, e = (float(x[1, 0]) for x in (run.q, run.v, run.energy))
    gained = worked_example("explicit_euler").energy[1, 0] - START
    result.measure("y_m", y)
    result.measure("v_m_per_s", v)
    result.measure("energy_j", e)
    result.statement = "One step of 10 ms from rest at 5 m."
    # Rounded to the digits quoted.
    result.statement_holds((round(y, 3), round(v, 4), round(e, 2)) == (4.999, -0.0981, 49.05))
    result.correction_holds(abs(START - e - gained) < 1e-9, e < START)


@claim(
    "Explicit Euler, step 100 of the worked fall: y = 4.51 m, v = -0.981 m/s, E = 49.70 J.",
    "After a hundred steps a second has passed: the ball is at {y_m:.3f} m with {v_m_per_s:.2f} "
    "m/s and {energy_j:.2f} J ({gain_percent:.2f} % too much). The three numbers do not even "
    "belong together: at that height and speed the energy is {of_that_state_j:.2f} J, and the "
    "speed is that of step {step_of_that_speed:g}.",
)
def worked_step_100(result):
    run = worked_example("explicit_euler")
    y, v, e = (float(x[100, 0]) for x in (run.q, run.v, run.energy))
    result.measure("y_m", y)
    result.measure("v_m_per_s", v)
    result.measure("energy_j", e)
    result.measure("gain_percent", 100 * (e / START - 1))
    of_that_state = result.measure("of_that_state_j", _energy(4.51, -0.981))
    step = result.measure("step_of_that_speed", np.abs(run.v[:100, 0] + 0.981).argmin())
    result.statement = "100 steps of explicit Euler by the course's integrator."
    result.statement_holds(abs(y - 4.51) < 0.01)
    result.correction_holds(
        # Closed form of explicit Euler: the sum of 0 to n - 1 is n (n - 1) / 2.
        abs(y - (HEIGHT - GRAVITY * STEP**2 * 100 * 99 / 2)) < 1e-10,
        abs(v + GRAVITY) < 1e-10,
        abs(of_that_state - 49.70) > 4,
        abs(run.q[step, 0] - 4.51) > 0.4,
    )


@claim(
    "Explicit Euler, step 500 of the worked fall: the first bounce, E = 52.3 J (+6.6 %).",
    "The first bounce comes at step {first_bounce_step:g}, just after one second. By step {step:g} "
    "there have been {bounces_by_step_500:g}, the rule that puts the ball back on the floor has "
    "added energy too, and the gain is {gain_percent:.1f} %.",
)
def worked_step_500(result):
    run, step = worked_example("explicit_euler"), result.input("step", 500)
    steps = np.flatnonzero(run.bounced)
    first = result.measure("first_bounce_step", steps[0])
    before = result.measure("bounces_by_step_500", (steps <= step).sum())
    result.measure("y_m", run.q[step, 0])
    result.measure("energy_j", run.energy[step, 0])
    result.measure("gain_percent", 100 * (run.energy[step, 0] / START - 1))
    result.statement = f"The rule acts at steps {', '.join(str(i) for i in steps)}."
    result.statement_holds(first == step)
    # Nearby starts as well, so that the result does not hang on a tie.
    early = near("explicit_euler").bounced.argmax(axis=0)
    result.correction_holds(100 < first < 110, before >= 2, (abs(early - first) < 5).all())


@claim(
    "Explicit Euler after ten bounces of the worked example: 78 J, 59 % too much.",
    "The energy does grow, but not so far: {energy_j:.1f} J ({gain_percent:.0f} % too much), and "
    "that is a worst case, since with the example's numbers every rebound lands exactly on the "
    "floor and the rule acts a full step too deep. From starts a hair off it is "
    "{near_lowest_j:.1f} to {near_highest_j:.1f} J. Flight and bounce rule each give a part.",
)
def worked_ten_bounces_explicit(result):
    run, others = worked_example("explicit_euler"), near("explicit_euler")
    end, gain = run.energy[-1, 0], run.percent()
    result.measure("energy_j", end)
    result.measure("gain_percent", gain)
    flight = result.measure("by_flight_j", float(run.by_flight[0]))
    rule = result.measure("by_rule_j", float(run.by_rule[0]))
    result.measure("near_lowest_j", others.energy[-1].min())
    result.measure("near_highest_j", others.energy[-1].max())
    result.statement = f"Ten bounces take {len(run.q) - 1} steps; near by: {_spread(others)}."
    result.statement_holds(abs(gain - 59) < 1)
    # The parts must sum to the change of the energy: nothing is left unaccounted.
    result.correction_holds(
        flight > 0 and rule > 0,
        abs(flight + rule - (end - START)) < 1e-9,
        (others.percent() > 0).all() and others.energy[-1].max() < end < 78,
    )


@claim(
    "Semi-implicit Euler after ten bounces of the worked example: 48.5 J, slowly decaying.",
    "It decays, by much more: {near_lowest_j:.1f} to {near_highest_j:.1f} J are left from starts a "
    "hair off the example's. The example itself, {energy_j:.2f} J in exact arithmetic, is an "
    "exception: every rebound lands exactly on the floor, and the bounce rule, a full step too "
    "deep, gives back what the flight took.",
)
def worked_ten_bounces_semi_implicit(result):
    run, others = worked_example("semi_implicit_euler"), near("semi_implicit_euler")
    end = run.energy[-1, 0]
    result.measure("energy_j", end)
    result.measure("change_percent", run.percent())
    flight = result.measure("by_flight_j", float(run.by_flight[0]))
    rule = result.measure("by_rule_j", float(run.by_rule[0]))
    result.measure("near_lowest_j", others.energy[-1].min())
    result.measure("near_highest_j", others.energy[-1].max())
    result.statement = f"Ten bounces take {len(run.q) - 1} steps; near by: {_spread(others)}."
    result.statement_holds(
        abs(end - 48.5) < 0.1 or bool((abs(others.energy[-1] - 48.5) < 0.1).any())
    )
    result.correction_holds(
        flight < 0 < rule,
        abs(flight + rule - (end - START)) < 1e-9,
        others.energy[-1].max() < 46 < START < end,
    )


def _resolved(method: str, start: Any, handled: bool = True) -> float:
    """Return the energy right after ten elastic bounces over that at the start, for one ball.

    Args:
        method: name of an integrator.
        start: height [m], speed upwards [m/s], and step [s].
        handled: whether the impact is placed at its time inside the step.
    """
    from course.rigid_body import events

    height, speed, dt = start
    advance = events.step_with_event if handled else events.step_with_late_event
    q, v, bounces = np.array([height]), np.array([speed]), 0
    while bounces < 10:
        q, v, hits = advance(
            q,
            v,
            step_of(method),
            falling,
            dt,
            None,
            lambda q: q[0],
            lambda q, v: (0 * q, np.abs(v)),
        )
        bounces += hits
    return _energy(q[0], v[0]) / _energy(height, speed)


@claim(
    "RK4 keeps the energy of the worked example within 0.001 % over ten bounces.",
    "In flight RK4 is exact, as any second-order method is. All of its error comes from the bounce "
    "rule, which adds m g times the depth at each bounce: {gain_percent:.0f} % in the example, "
    "{near_lowest_percent:.0f} to {near_highest_percent:.0f} % from starts a hair off. With the "
    "impact placed at its time the error is rounding. A time that is only interpolated along a "
    "straight line between two steps is not good enough for this claim.",
)
def worked_ten_bounces_rk4(result):
    from course.rigid_body import INTEGRATORS

    run, others = worked_example("exact_flight"), near("exact_flight")
    gain = result.measure("gain_percent", run.percent())
    result.measure("energy_j", run.energy[-1, 0])
    result.measure("by_rule_j", float(run.by_rule[0]))
    result.measure("near_lowest_percent", others.percent().min())
    result.measure("near_highest_percent", others.percent().max())
    state = np.array([HEIGHT]), np.array([-3.0]), falling, STEP, None
    exact = step_of("exact_flight")(*state)
    # Constant acceleration: every second-order method integrates it exactly.
    deviation = max(
        np.abs(np.subtract(INTEGRATORS[name].step(*state), exact)).max()
        for name in ("rk4", "velocity_verlet", "explicit_midpoint", "implicit_midpoint")
    )
    # Random heights, speeds and steps, so that no start is at a tie.
    draws = result.rng.uniform((0.5, -2, 0.02), (5, 2, 0.05), (8, 3))
    resolved = [abs(_resolved("rk4", draw) - 1) for draw in draws]
    late = [abs(_resolved("rk4", draw, False) - 1) for draw in draws]

    def interpolated(height: float, speed: float) -> float:
        """Return the relative error if the impact is placed on the straight line of its step."""
        y, v, bounces = height, speed, 0
        while bounces < 10:
            y1, v1 = y + STEP * v - GRAVITY * STEP**2 / 2, v - GRAVITY * STEP
            if y1 < 0:
                part = STEP * y / (y - y1)  # where the line from y to y1 meets the floor
                rest, v = STEP - part, -(v - GRAVITY * part)
                y1, v1 = rest * v - GRAVITY * rest**2 / 2, v - GRAVITY * rest
                bounces += 1
            y, v = y1, v1
        return abs(_energy(y, v) / _energy(height, speed) - 1)

    # Chosen to break it: an impact inside the step, but only interpolated.
    starts = result.rng.uniform((4.9, -0.1), (5.1, 0.1), (8, 2))
    linear = [interpolated(*draw) for draw in starts]

    def bisected(height: float, speed: float, tolerance: float) -> float:
        """Return the relative error if the impact's time is bisected down to a tolerance [s]."""
        y, v, bounces = height, speed, 0
        while bounces < 10:
            before, after = 0.0, STEP
            if y + STEP * v - GRAVITY * STEP**2 / 2 < 0:
                while after - before > tolerance:
                    part = (before + after) / 2
                    above = y + part * v - GRAVITY * part**2 / 2 >= 0
                    before, after = (part, after) if above else (before, part)
                rest, v, y = STEP - after, -(v - GRAVITY * after), 0.0
                bounces += 1
            else:
                rest = STEP
            y, v = y + rest * v - GRAVITY * rest**2 / 2, v - GRAVITY * rest
        return abs(_energy(y, v) / _energy(height, speed) - 1)

    # Chosen to break it: a bisection that stops at ten microseconds.
    tolerance = 1e-6 * result.input("tolerance_us", 0.1)
    fine, coarse = (
        [bisected(height, speed, x) for height, speed in starts] for x in (tolerance, 1e-5)
    )
    result.statement = (
        f"With resolved impacts the energy is off by {max(resolved):.0e} at most; one step of each "
        f"second-order method is the parabola to {deviation:.0e}."
    )
    result.statement_holds(
        abs(gain) < 1e-3,
        only_if="the impact is resolved inside the step, by solving for its time to within "
        "{tolerance_us:.1f} microseconds",
        inside=[error < 1e-5 for error in resolved + fine],
        outside=[error < 1e-5 for error in late + linear + coarse],
    )
    result.correction_holds(
        max(resolved) < 1e-11,
        min(linear) > 1e-5,
        float(run.by_flight[0]) == 0,
        deviation < 1e-12,
        min(others.percent()) > 5,
    )


@claim(
    "The energies after ten bounces are a property of the integrator.",
    "In the example a last digit decides. Every rebound is at a tie: it reaches the floor exactly "
    "at the end of a step. So one rounding of the velocity decides whether the bounce rule acts "
    "then or a full step deeper, and the energies end up to {spread_j:.1f} J apart. Other drop "
    "heights do not help: after its first bounce, every ball that was dropped from rest is at a "
    "tie. Vary height and speed of the "
    "start before you compare methods: then they are {explicit_euler_near_j:.1f}, "
    "{semi_implicit_euler_near_j:.1f} and {exact_flight_near_j:.1f} J for explicit, semi-implicit "
    "Euler and exact flight, a property of integrator and bounce rule together.",
)
def worked_table_belongs_to_the_method(result):
    heights, near_by, spreads = result.rng.uniform(4, 6, 12), [], []
    for name in METHODS:
        # A restitution changed by a millionth stands for the last digit of the arithmetic.
        ends = drop(name, e=1 + 1e-6 * np.arange(-1, 2)).energy[-1]
        for label, value in zip(("below_1", "1", "above_1"), ends, strict=True):
            result.measure(f"{name}_e_{label}_j", value)
        spreads.append(np.ptp(ends))
        near_by.append(near(name).energy[-1])
        result.measure(f"{name}_near_j", near_by[-1].mean())
    spread = result.measure("spread_j", max(spreads))
    result.statement = (
        "Energy after ten bounces in exact arithmetic, with a restitution of 1 and of a millionth "
        "less and more; and the mean over 500 starts up to 1 mm and one step's speed away."
    )
    result.statement_holds(spread < 1e-6)
    result.correction_holds(
        spread > 1,
        all(_tied(drop(name, height=heights)).all() for name in METHODS),
        not any(_tied(near(name)).any() for name in METHODS),
        # The ranges of the three methods do not overlap once starts are random.
        near_by[1].max() < near_by[2].min() < near_by[2].max() < near_by[0].min(),
    )


@claim(
    "A ball that bounces elastically under semi-implicit Euler slowly loses energy.",
    "m g y + m v^2 / 2 - m g h v / 2 never rises: the flight keeps it, and a bounce at the speed v "
    "takes m g (h v - depth), half of m g h v on average: {near_mean_percent:.1f} % in ten bounces "
    "from 5 or so metres at {step_ms:g} ms ({lowest_percent:.1f} to {highest_percent:.1f} %). Only "
    "at exact ties, where each rebound ends on the floor at the end of a step, as after a drop "
    "from rest in exact arithmetic, does the depth reach h v and nothing more is lost. A ball "
    "slower than g h flies for one step only, and its energy jumps up and down. If the bounce "
    "mirrors the ball at the floor (y = -y), about half of the balls gain energy.",
)
def semi_implicit_bouncing_decays(result):
    n, dt = 200, result.input("step_ms", 10.0) / 1000
    heights, speeds = result.rng.uniform((4, -3), (6, 3), (n, 2)).T
    run = drop("semi_implicit_euler", dt=dt, height=heights, speed=speeds)
    small, down = result.rng.uniform((0.1, -5), (10, 5), (n, 2)).T
    # Steps scaled with the root of the height: the number of steps in a flight doesn't depend on
    # it.
    steps = result.rng.uniform(0.004, 0.02, n) * np.sqrt(small)
    wide = drop("semi_implicit_euler", dt=steps, height=small, speed=down)
    # The modified energy: constant in flight, so that it shows the bounces alone.
    retained = wide.energy - GRAVITY * steps * wide.v / 2
    half = -(GRAVITY * steps * wide.v)[wide.bounced].mean() / 2
    # Drops from rest in integer units land exactly on the floor and try to break the claim.
    tied = drop("semi_implicit_euler", dt=dt, height=4 + 0.0997 * np.arange(12))
    # Chosen to break it: balls thrown up from the floor so slowly that a flight takes a few steps
    # at most, and starts within rounding of a tie.
    few, single = (
        drop("semi_implicit_euler", dt=dt, height=0.0, speed=share * GRAVITY * dt)
        for share in (result.rng.uniform(1.01, 30, n), result.rng.uniform(0.05, 0.45, n))
    )
    aside = result.rng.choice([-1, 1], n) * 10.0 ** result.rng.uniform(-9, -1, n)
    near_tied = drop("semi_implicit_euler", dt=dt, height=heights, speed=aside)

    # Chosen to break it: many bounces from so low that the ball becomes slower than g h, and a
    # bounce that mirrors the ball at the floor instead of putting it there.
    low = drop(
        "semi_implicit_euler",
        bounces=60,
        dt=dt,
        height=result.rng.uniform(0.03, 0.08, 20),
        speed=result.rng.uniform(0.1, 0.5, 20),
    )

    def never_rises(ball: int, slowest: float) -> bool:
        """Return whether the energy falls from bounce to bounce, at impacts faster than this."""
        rebounds = low.v[low.bounced[:, ball], ball]
        return bool((np.diff(rebounds)[rebounds[1:] > slowest] < 0).all())

    def mirrored() -> Any:
        """Return the change of the energy in ten bounces at a mirror, for each ball [%]."""
        y, v, count = heights.copy(), speeds.copy(), np.zeros(n)
        while (count < 10).any():
            moving = count < 10
            v = np.where(moving, v - GRAVITY * dt, v)
            y = np.where(moving, y + dt * v, y)
            hit = y < 0
            y, v, count = np.where(hit, -y, y), np.where(hit, -v, v), count + hit
        return 100 * (_energy(y, v) / _energy(heights, speeds) - 1)

    reflected = mirrored()
    result.measure("near_mean_percent", run.percent().mean())
    result.measure("lowest_percent", run.percent().min())
    result.measure("highest_percent", run.percent().max())
    result.measure("highest_tied_percent", tied.percent().max())
    result.statement = (
        "200 starts between 4 and 6 m, up to 3 m/s; 200 with other steps and heights; 12 drops "
        f"from rest in whole numbers, of which {(tied.percent() > 0).sum()} end above their start."
    )
    result.statement_holds(
        (tied.percent() < 0).all(),
        only_if="the bounce puts the ball back on the floor, no rebound ends exactly there at the "
        "end of a step, and the impacts are still faster than g h",
        inside=[
            *(np.concatenate([x.percent() for x in (run, wide, few, near_tied)]) < 0),
            *(never_rises(ball, GRAVITY * dt) for ball in range(20)),
        ],
        outside=[
            *(np.concatenate((tied.percent(), single.percent(), reflected)) < 0),
            *(never_rises(ball, 0.0) for ball in range(20)),
        ],
    )
    result.correction_holds(
        (np.diff(retained, axis=0) < 1e-9 * retained[0]).all(),
        _tied(tied).all() and not _tied(run).any(),
        abs(np.diff(retained, axis=0)[wide.bounced[1:]].mean() / half - 1) < 0.05,
        0.3 < np.mean(reflected > 0) < 0.7,
    )


@claim(
    "What semi-implicit Euler loses in flight, the next elastic bounce gives back.",
    "The loss of a flight is m g h / 2 times the change of v, and a bounce turns v round without "
    "paying it back: with each impact placed at its time, {left_after_ten:.2f} of the energy is "
    "left after ten bounces of the worked example, m g h v less at each.",
)
def bounce_gives_the_loss_back(result):
    remaining = result.measure(
        "left_after_ten", _resolved("semi_implicit_euler", (HEIGHT, 0.0, STEP))
    )
    draws = result.rng.uniform((2, -2, 0.002), (5, 2, 0.01), (4, 3))
    ends = [_resolved("semi_implicit_euler", draw) for draw in draws]
    # First order in h: m g h v with the impact speed of the start, for ten bounces.
    expected = [
        1 - 10 * GRAVITY * h * np.sqrt(v * v + 2 * GRAVITY * y) / _energy(y, v) for y, v, h in draws
    ]
    result.statement = f"Four other starts and steps: {min(ends):.2f} to {max(ends):.2f} are left."
    result.statement_holds(remaining > 0.99)
    result.correction_holds(
        remaining < 0.9,
        # 30 %: the speed falls from bounce to bounce, which the first order ignores.
        all(abs(a - b) < 0.3 * (1 - b) for a, b in zip(ends, expected, strict=True)),
    )


@claim(
    "Putting the ball back on the floor and reversing its velocity is elastic.",
    "Reversing is; putting it back lifts it by the depth d and adds m g d. The depth is up to one "
    "step's travel, so a bounce adds at most m g v h, whatever the integrator: in the worked "
    "example {added_in_ten_bounces_j:.1f} J of at most {bound_j:.1f} J in ten bounces.",
)
def elastic_bounce_rule(result):
    run = worked_example("exact_flight")
    # One step's travel at the speed of each impact.
    bound = result.measure("bound_j", (GRAVITY * np.abs(run.v) * STEP)[run.bounced].sum())
    added = result.measure("added_in_ten_bounces_j", float(run.by_rule[0]))
    result.statement = "Exact flight, so that all the energy comes from the rule."
    result.statement_holds(added < 1e-9)
    result.correction_holds(
        0 < added < bound, all((_rule_gain(m, result.rng)[1] <= 0).all() for m in METHODS)
    )


def _rule_gain(
    method: str,
    rng: np.random.Generator,
    e: float | np.ndarray = 1.0,
    share: float | np.ndarray = 1.0,
    n: int = 200,
) -> Any:
    """Return the energy gained in one bounce of n random balls.

    Args:
        method: as for `drop`.
        rng: where step, depth and speed come from.
        e: restitution.
        share: speed of the impact over 2 g h / (1 - e^2); with e = 1 it is random.
        n: number of balls.

    Returns:
        (energy the rule adds, that less m g v h with the speed v of the impact), shape (n,) [J].
    """
    h, part, speed = rng.uniform((0.001, 0, 0.5), (0.02, 1, 9), (n, 3)).T
    if np.min(e) < 1:
        speed = share * 2 * GRAVITY * h / (1 - e * e)
    # Start one step before the impact, at a random share of that step's travel above the floor.
    before = np.array([-(speed - GRAVITY * h)])  # a step later it is -speed
    moved = -step_of(method)(np.zeros((1, n)), before, falling, h, None)[0][0]
    run = drop(method, 1, 2, h, e, part * moved, before[0])
    return run.by_rule + run.by_restitution, run.by_rule - GRAVITY * h * speed


@claim(
    "Setting y to zero and v to -e v is a bounce that loses energy.",
    "It takes (1 - e^2) m v^2 / 2 and gives m g times the depth, which is up to one step's travel. "
    "Slower than 2 g h / (1 - e^2), {limit_mm_per_s:.0f} mm/s at e = {e} and {step_ms:g} ms, a "
    "bounce can gain, and a ball on the floor keeps {kept_mm_per_s:.1f} mm/s for ever; with e = 1 "
    "every bounce gains.",
)
def bounce_rule_takes_energy(result):
    from scipy.optimize import brentq

    e = result.rng.uniform(0.1, 0.99, 200)
    rest, step = result.input("e", 0.6), result.input("step_ms", 1.0)
    fast, slow, full = (
        np.concatenate(
            [
                _rule_gain(m, result.rng, restitution, result.rng.uniform(*share, 200))[0]
                for m in METHODS
            ]
        )
        for restitution, share in ((e, (1, 3)), (e, (0.5, 1)), (1.0, (1, 1)))
    )

    def full_depth(speed: Any, h: Any = step / 1000, e: Any = rest) -> Any:
        """Return the energy that a bounce adds at the depth of a whole step's travel."""
        run = drop("semi_implicit_euler", 1, 2, h, e, 0.0, GRAVITY * h - speed)
        return run.by_rule + run.by_restitution

    # The root of the gain in the speed, by Brent's method, independent of the formula.
    limit = result.measure("limit_mm_per_s", 1000 * brentq(lambda v: full_depth(v)[0], 0.011, 1.0))
    late = drop("semi_implicit_euler", 4000, 10**9, step / 1000, rest, 1.0).v[-1000:, 0]
    # Chosen to break it: the greatest depth, just above and just below the speed.
    h = result.rng.uniform(0.001, 0.02, 200)
    above, below = (full_depth(x * 2 * GRAVITY * h / (1 - e * e), h, e) for x in (1.001, 0.999))
    result.measure("kept_mm_per_s", 1000 * late.min(), 1e-3)
    result.statement = (
        "200 bounces of each method, restitutions of 0.1 to 0.99, any step and depth."
    )
    result.statement_holds(
        (slow < 0).all(),
        only_if="the ball hits the floor faster than 2 g h / (1 - e^2)",
        inside=np.append(fast, above) < 0,
        outside=np.append(slow, below) < 0,
    )
    result.correction_holds(
        (full >= 0).all() and (full > 0).any(),
        (below > 0).all(),
        0 < 1000 * late.min() < limit,
    )


@claim(
    "RK4 is a fourth-order method.",
    "If the impact is noticed only at the end of a step, the error is of first order, for RK4 as "
    "for Euler. The measured order of RK4 is {order_with_bounce:.2f} with such a bounce and "
    "{order_smooth:.2f} without it.",
)
def order_survives_bounces(result):
    from course.rigid_body import problems, rk4, simulate

    # The error depends on where in the step the impact falls; 200 heights average that out.
    heights = np.linspace(3.0, 5.0, 200)
    true = [problems.bounce_height(1.8, x, 1.0, GRAVITY) for x in heights]

    def error(n: int) -> float:
        """Return the mean error 1.8 s after the drop: one bounce each."""
        run = drop("exact_flight", n, dt=1.8 / n, height=heights)
        return float(np.abs(run.q[-1] - true).mean())

    def smooth(n: int, amplitude: float) -> float:
        pendulum = problems.pendulum(amplitude)
        return pendulum.error(simulate(pendulum.system, "rk4", 2.0 / n, n).q[-1])

    def held(n: int, forces: np.ndarray) -> float:
        """Return the angle of a pendulum after 2 s of n steps; its force jumps every 0.25 s."""
        q, v, h = np.array([1.0]), np.array([0.0]), 2.0 / n
        for i in range(n):
            force = forces[min(int(i * h / 0.25 + 1e-9), 7)]
            q, v = rk4(q, v, lambda q, v, push: push - GRAVITY * np.sin(q), h, force)
        return float(q[0])

    def observed(forces: np.ndarray, steps: tuple[int, ...]) -> float:
        """Return the order, from runs with a number of steps, twice as many and four times."""
        a, b, c = (held(n, forces) for n in steps)
        return float(np.log2(abs((a - b) / (b - c))))

    # Chosen to break it: a force that jumps between two steps, or inside a step.
    pushes = result.rng.normal(size=(3, 8)) * 5
    between = [observed(push, (80, 160, 320)) for push in pushes]
    within = [observed(push, (83, 166, 332)) for push in pushes]
    ball = np.array([1.0]), np.array([-3.0]), falling, 0.01, None
    order = result.measure("order_smooth", np.log2(smooth(1000, 2.5) / smooth(2000, 2.5)), 0.02)
    # Slope over three halvings of the step.
    bounced = result.measure("order_with_bounce", np.log2(error(250) / error(2000)) / 3, 0.02)
    result.statement = "RK4 on a pendulum, and on a ball that bounces once, over 200 heights."
    result.statement_holds(
        bounced > 3.5,
        only_if="the motion is smooth within each step",
        inside=[
            np.log2(smooth(500, a) / smooth(1000, a)) > 3.5 for a in result.rng.uniform(0.5, 2.8, 8)
        ]
        + [x > 3.5 for x in between],
        outside=[np.log2(error(n) / error(4 * n)) / 2 > 3.5 for n in range(20, 60, 5)]
        + [x > 3.5 for x in within],
    )
    result.correction_holds(
        abs(order - 4) < 0.1,
        abs(bounced - 1) < 0.1,
        np.allclose(rk4(*ball), step_of("exact_flight")(*ball), rtol=1e-14),
    )
