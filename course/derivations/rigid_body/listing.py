"""Claims on the usual first listing, a square that falls and bounces, and on thin walls."""

from typing import Any

import numpy as np

from course.derivations import Ask, Symbol, claim
from course.derivations.rigid_body.flight import GRAVITY, METHODS, START, drop, falling, step_of


def _listing(method: str, e: float = 0.6, spin: float = 0.0, dt: float = 1e-3) -> Any:
    """Run the usual first listing of a planar box.

    It has a state of six numbers, gravity, and a bounce rule.

    Below the floor y becomes 0, vy becomes -e vy and omega is scaled by 0.95; then comes the step,
    with the force of gravity and no torque. 1 kg, 0.1 kg m^2, from 5 m at 0.3 rad, 5 s.

    Returns:
        (q, v, energy) after each step: (x, y, angle), their rates, and J.
    """
    q, v = np.array([0.0, 5.0, 0.3]), np.array([0.0, 0.0, spin])
    states = [(q, v)]
    for _ in range(round(5 / dt)):
        if q[1] < 0:
            q = q * [1, 0, 1]
            v = v * [1, -e, 0.95]
        q, v = step_of(method)(q, v, lambda q, v, g: np.array([0.0, -g, 0.0]), dt, GRAVITY)
        states.append((q, v))
    qs, vs = (np.array([s[i] for s in states]) for i in (0, 1))
    return qs, vs, GRAVITY * qs[:, 1] + (vs**2 * [1.0, 1.0, 0.1]).sum(axis=1) / 2


@claim(
    "The usual first listing simulates a tumbling box, with friction at the ground.",
    "Its box cannot tumble: nothing in it makes a torque, so the angle stays what it was for all "
    "five seconds, and only the centre meets the floor, half the box below it. Its friction scales "
    "the spin once a step, so what is left depends on the step: of 1 rad/s {left_1_ms:.0e} at "
    "{step_ms:g} ms and {left_4_ms:.0e} at four times that. A box of the same mass and moment that "
    "hits with its corner turns at {tumbles_rad_per_s:.1f} rad/s after the first impact.",
)
def listing_box_tumbles(result):
    from course.rigid_body import PlanarBody

    step = result.input("step_ms", 1.0) / 1000
    q, v, _ = _listing("semi_implicit_euler")
    remaining = [
        _listing("semi_implicit_euler", spin=1.0, dt=h)[1][-1, 2] for h in (step, 4 * step)
    ]
    side = np.sqrt(0.6)  # 1 kg and 0.1 kg m^2 as a square
    box = PlanarBody(width=side, height=side, restitution=0.6)
    box.state[:3] = 0.0, 5.0, 0.3
    while not box.impacts:
        box.step(step, GRAVITY)
    result.measure("angle_moves_rad", np.ptp(q[:, 2]))
    result.measure("left_1_ms", remaining[0], 1e-3)
    result.measure("left_4_ms", remaining[1], 1e-3)
    tumbles = result.measure("tumbles_rad_per_s", abs(box.omega), 1e-3)
    result.statement = "The listing run as it is usually printed, and the chapter's planar body."
    result.statement_holds(np.ptp(q[:, 2]) > 0.01)
    result.correction_holds(
        not v[:, 2].any(),
        np.ptp(q[:, 2]) == 0,
        tumbles > 1,
        remaining[1] > 10 * remaining[0],
        np.abs(q[-500:, 1]).max() < side / 4,
    )


@claim(
    "A ball with restitution 0.6, simulated with semi-implicit Euler in steps of 1 ms, loses most "
    "of its energy through the integrator.",
    "It loses nearly all of it through the restitution. The integrator's share, at {step_ms:g} ms "
    "over five seconds, is {integrator_percent:.1f} % of the loss, and the bounce rule gives as "
    "much back.",
)
def listing_energy_decay(result):
    step = result.input("step_ms", 1.0)
    run = drop("semi_implicit_euler", 5000, 10**9, step / 1000, 0.6)
    total = START - float(run.energy[-1, 0])
    restitution, flight, rule = (
        -float(part[0]) / total for part in (run.by_restitution, run.by_flight, run.by_rule)
    )
    result.measure("lost_j", total, 1e-4)
    result.measure("share_of_restitution", restitution, 1e-4)
    result.measure("share_of_integrator", flight, 1e-4)
    result.measure("share_of_rule", rule, 1e-4)
    result.measure("integrator_percent", 100 * flight, 1e-4)
    listing = _listing("semi_implicit_euler")[2]
    result.statement = f"The printed listing ends with {listing[-1]:.4f} J of {listing[0]:.2f} J."
    result.statement_holds(flight > 0.5)
    result.correction_holds(
        restitution > 0.98,
        0 < flight < 0.02,
        abs(flight + rule) < 0.2 * flight,
        abs(listing[0] - listing[-1] - total) < 0.01,
    )


@claim(
    "Put explicit Euler into the usual listing and its energy grows.",
    "It decays as well: the restitution takes far more than the integrator adds, and after five "
    "seconds {explicit_left_mj:.1f} mJ of {start_j:.1f} J are left, {semi_implicit_left_mj:.2f} mJ "
    "with semi-implicit Euler. A picture of a ball with restitution tells nothing about the "
    "integrator; take e = 1 and the impacts at their time, or a spring.",
)
def explicit_in_the_listing_grows(result):
    runs = {(m, e): _listing(m, e)[2] for m in METHODS[:2] for e in (0.6, 0.7, 1.0)}
    explicit, implicit = (runs[m, 0.6] for m in METHODS[:2])
    result.measure("start_j", explicit[0])
    result.measure("explicit_left_mj", 1000 * np.abs(explicit[-500:]).max(), 0.2)
    result.measure("semi_implicit_left_mj", 1000 * np.abs(implicit[-500:]).max(), 0.2)
    elastic = runs["explicit_euler", 1.0]
    result.measure("elastic_gain_percent", 100 * (elastic[-1] / elastic[0] - 1), 0.01)
    result.statement = (
        "The listing as it is printed, 5 s, restitution 0.6 and 0.7; with 1 explicit Euler gains "
        f"{100 * (elastic[-1] / elastic[0] - 1):.1f} %."
    )
    result.statement_holds(explicit[-1] > explicit[0])
    result.correction_holds(
        all(runs[m, e][-1] < 0.1 * explicit[0] for m in METHODS[:2] for e in (0.6, 0.7)),
        elastic[-1] > elastic[0] > runs["semi_implicit_euler", 1.0][-1],
    )


@claim(
    "An object flies through another as soon as it moves farther than its own thickness in a step.",
    "What counts is the sum of both thicknesses along the motion, w + d, and the relative speed v. "
    "Up to v dt = w + d the two overlap at the end of at least one step. For {body_mm:g} mm, "
    "{wall_mm:g} mm and a step of {step_ms:g} ms that is {limit_m_per_s:g} m/s. Beyond it, a throw "
    "from a random position is missed with probability 1 - (w + d) / (v dt).",
    ask=Ask(
        "A body of thickness d flies at a wall of thickness w; overlap is tested once per step "
        "dt. Up to which speed is an overlap certain to be seen?",
        "v, speed < (w + d)/dt",
        {
            "w/dt": "The body has a thickness too; it overlaps for longer.",
            "d/dt": "The wall has a thickness too; it overlaps for longer.",
            "(w + d)*dt": "Check the units: a length over a time.",
        },
        symbols={
            "w": Symbol("thickness of the wall [m]", 0.001, 1.0),
            "d": Symbol("thickness of the body [m]", 0.001, 1.0),
            "dt": Symbol("step [s]", 0.001, 0.1),
        },
    ),
)
def tunnelling_thickness(result):
    import sympy

    def missed(wall: float, body: float, dt: float, speed: float) -> float:
        """Return share of 1000 phases of the step at which no step overlaps, by flying there."""
        nose = np.array([-2 * (wall + body) - speed * dt * (np.arange(1000) + 0.5) / 1000])
        v, observed = np.full_like(nose, speed), np.zeros(1000, dtype=bool)
        while (nose - body <= wall).any():
            nose, v = step_of("semi_implicit_euler")(nose, v, falling, dt, 0.0)
            observed |= ((nose >= 0) & (nose - body <= wall))[0]
        return float(1 - observed.mean())

    wall, body = result.input("wall_mm", 20.0) / 1000, result.input("body_mm", 50.0) / 1000
    dt = result.input("step_ms", 2.0) / 1000
    w, d, step = sympy.symbols("w d dt", positive=True)
    result.formula = (w + d) / step
    limit = float(result.formula.subs({w: wall, d: body, step: dt}))
    own = missed(wall, body, dt, 1.2 * body / dt)
    below, double = (missed(wall, body, dt, x * limit) for x in (0.999, 2))
    result.measure("limit_m_per_s", limit, 0.02)
    result.measure("missed_below", below, 0.02)
    result.measure("missed_at_twice", double, 0.02)
    result.statement = (
        f"At 1.2 times its own thickness per step {100 * own:.0f} % are missed, at twice the limit "
        f"{100 * double:.0f} %."
    )
    draws = result.rng.uniform((0.001, 0.001, 0.001, 0.2), (0.1, 0.1, 0.02, 4), (30, 4))
    error = [missed(a, b, h, x * (a + b) / h) - max(0.0, 1 - 1 / x) for a, b, h, x in draws]
    result.statement_holds(own > 0)
    result.correction_holds(below == 0, np.abs(error).max() < 0.01)
