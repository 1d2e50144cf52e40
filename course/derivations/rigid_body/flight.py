"""Claims about free fall, the bouncing ball, its bounce rule, and bodies that fly through walls."""

import functools
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from course.derivations import Finding, Formula, Verdict, claim
from course.derivations.answer import Symbol

GRAVITY, HEIGHT, STEP = 9.81, 5.0, 0.01  # the worked example: 1 kg, 5 m, 10 ms, restitution 1
_START = GRAVITY * HEIGHT  # J

_FALL = {
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "h": Symbol("step [s]", 0.01, 1.0),
}


def _falling(q: np.ndarray, v: np.ndarray, params: object) -> np.ndarray:
    return np.full_like(v, -GRAVITY)


def _energy(q: np.ndarray, v: np.ndarray) -> float:
    return float(GRAVITY * q[0] + 0.5 * v[0] ** 2)


@dataclass(frozen=True)
class Bounces:
    """A ball under the usual bounce rule: below the floor, y becomes 0 and v becomes -e v.

    Attributes:
        q, v: height and velocity after each step, shape (steps + 1,) [m, m/s].
        energy: after each step, shape (steps + 1,) [J].
        bounced: indices of the steps at which the rule acted.
        by_rule: energy that putting the ball back on the floor has added [J].
        by_restitution: energy that the restitution has taken, negative [J].
        by_flight: energy that the integrator has changed between bounces [J].
    """

    q: np.ndarray
    v: np.ndarray
    energy: np.ndarray
    bounced: np.ndarray
    by_rule: float
    by_restitution: float
    by_flight: float


def _parabola(q: Any, v: Any, acceleration: Any, dt: Any, params: Any) -> tuple[Any, Any]:
    """A step of exact flight, which is what every second-order method takes in free fall."""
    a = acceleration(q, v, params)
    return q + dt * v + dt * dt * a / 2, v + dt * a


@functools.cache
def bouncing(
    method: str,
    steps: int,
    bounces: int | None = None,
    dt: str = "0.01",
    restitution: str = "1",
    height: str = "5",
) -> Bounces:
    """Drop the ball of the worked example and let the bounce rule act after each step.

    In exact fractions: with this example's round numbers a rebound lands *exactly* on the floor at
    the end of a step, so in floating point the last digit would decide whether the ball is below.

    Args:
        method: "explicit_euler", "semi_implicit_euler", or "exact_flight".
        steps: steps at most.
        bounces: stop after so many bounces, or None.
        dt: step [s]; this and the next two as decimal text.
        restitution: e of the rule.
        height: [m].
    """
    from course.rigid_body.integrators import INTEGRATORS

    step = _parabola if method == "exact_flight" else INTEGRATORS[method].step
    h, e, g = Fraction(dt), Fraction(restitution), Fraction(str(GRAVITY))

    def falling(q: Any, v: Any, params: Any) -> Any:
        return np.array([-g], dtype=object)

    def energy(q: Any, v: Any) -> Fraction:
        return g * q[0] + v[0] * v[0] / 2

    q, v = np.array([Fraction(height)], dtype=object), np.array([Fraction(0)], dtype=object)
    qs, vs, energies, bounced = [q[0]], [v[0]], [energy(q, v)], []
    by_rule = by_restitution = by_flight = Fraction(0)
    for i in range(1, steps + 1):
        q, v = step(q, v, falling, h, None)
        by_flight += energy(q, v) - energies[-1]
        if q[0] < 0:
            by_rule -= g * q[0]
            by_restitution -= (1 - e * e) * v[0] * v[0] / 2
            q, v = 0 * q, -e * v
            bounced.append(i)
        qs.append(q[0])
        vs.append(v[0])
        energies.append(energy(q, v))
        if bounces is not None and len(bounced) == bounces:
            break
    return Bounces(
        np.array(qs, dtype=float), np.array(vs, dtype=float), np.array(energies, dtype=float),
        np.array(bounced), float(by_rule), float(by_restitution), float(by_flight),
    )  # fmt: skip


@claim(
    "free_fall_energy_error",
    1,
    "In its first step of free fall explicit Euler leaves the energy as it is.",
    verdict=Verdict.FALSE,
    corrected="It adds m g^2 h^2 / 2 at every step, the first one included: the position has not "
    "moved and the velocity has.",
    figures={"energy_after_step_1_j": (49.05481, 1e-6), "added_mj": (4.811805, 1e-6)},
    formula=Formula(
        "How much energy does explicit Euler add in each step of free fall?",
        "m*g^2*h^2/2",
        _FALL,
        left=("dE", "E"),
        slips={
            "m*g*h": "That would be a potential energy, with h a height; here h is the step.",
            "m*g^2*h^2": "Twice too much: expand (v - g h)^2 / 2 and the term in v cancels.",
            "-m*g^2*h^2/2": "That is semi-implicit Euler; explicit Euler gains.",
        },
    ),
)
def _free_fall_energy_error() -> Finding:
    import sympy

    from course.rigid_body import integrators

    m, g, h = sympy.symbols("m g h", positive=True)
    y, v = sympy.symbols("y v", real=True)

    def gain(step: Any) -> Any:
        q1, v1 = step(
            np.array([y], dtype=object), np.array([v], dtype=object),
            lambda q, v, p: np.array([-g], dtype=object), h, None,
        )  # fmt: skip
        return sympy.expand(m * g * (q1[0] - y) + m * (v1[0] ** 2 - v**2) / 2)

    added = gain(integrators.explicit_euler)
    first = bouncing("explicit_euler", 1).energy
    return Finding(
        {"energy_after_step_1_j": first[1], "added_mj": 1000 * (first[1] - first[0])},
        f"Whatever the state, a step adds {added}.",
        holds=first[1] == first[0],
        corrected=sympy.simplify(added - m * g**2 * h**2 / 2) == 0,
        formula=sympy.nsimplify(added, rational=True),
    )


@claim(
    "semi_implicit_free_fall",
    1,
    "The energy that semi-implicit Euler loses in free fall is dissipation.",
    verdict=Verdict.FALSE,
    corrected="A step changes the energy by exactly -m g^2 h^2 / 2, up or down alike, but "
    "m g y + m v^2 / 2 - m g h v / 2 is conserved exactly: the error is m g h (change of v) / 2, "
    "and run backwards it comes back.",
    figures={"after_100_steps_j": (-0.4811805, 1e-6), "after_running_back_j": (0, 1e-6)},
    formula=Formula(
        "By how much does semi-implicit Euler change the energy in each step of free fall?",
        "-m*g^2*h^2/2",
        _FALL,
        left=("dE", "E"),
        slips={
            "m*g^2*h^2/2": "That is explicit Euler; the sign is the other one here.",
            "0": "It is symplectic, but symplectic does not mean that energy is conserved.",
            "-m*g^2*h^2": "Twice too much: the kinetic part gives back half.",
        },
    ),
)
def _semi_implicit_free_fall() -> Finding:
    import sympy

    from course.rigid_body import integrators

    m, g, h = sympy.symbols("m g h", positive=True)
    y, v = sympy.symbols("y v", real=True)
    q1, v1 = integrators.semi_implicit_euler(
        np.array([y], dtype=object), np.array([v], dtype=object),
        lambda q, v, p: np.array([-g], dtype=object), h, None,
    )  # fmt: skip

    def energy(y: Any, v: Any) -> Any:
        return m * g * y + m * v**2 / 2

    change = sympy.expand(energy(q1[0], v1[0]) - energy(y, v))
    kept = sympy.expand(change - m * g * h * (v1[0] - v) / 2)
    run = bouncing("semi_implicit_euler", 100)
    q, v_back = np.array([run.q[100]]), np.array([run.v[100]])
    for _ in range(100):  # the inverse of the step: position first, with -h
        q = q - STEP * v_back
        v_back = v_back - STEP * _falling(q, v_back, None)
    lost, back = float(run.energy[100] - _START), _energy(q, v_back) - _START
    return Finding(
        {"after_100_steps_j": lost, "after_running_back_j": round(back, 9)},
        f"100 steps of 10 ms lose {-lost:.4f} J; 100 inverse steps bring back all but "
        f"{back:.0e} J.",
        holds=abs(back) > 1e-6,
        corrected=kept == 0 and abs(back) < 1e-9,
        formula=sympy.nsimplify(change, rational=True),
    )


@claim(
    "worked_step_1_semi_implicit",
    1,
    "Semi-implicit Euler, step 1 of the worked fall: y = 4.999 m, v = -0.0981 m/s, E = 49.05 J.",
    verdict=Verdict.HOLDS,
    corrected="So it is in the digits shown. With more of them the energy has fallen by 4.8 mJ, as "
    "much as explicit Euler gains.",
    figures={"y_m": (4.999019, 1e-6), "v_m_per_s": (-0.0981, 1e-6), "energy_j": (49.04519, 1e-6)},
)
def _worked_step_1_semi_implicit() -> Finding:
    run = bouncing("semi_implicit_euler", 1)
    y, v, e = run.q[1], run.v[1], run.energy[1]
    gained = bouncing("explicit_euler", 1).energy[1] - _START
    return Finding(
        {"y_m": y, "v_m_per_s": v, "energy_j": e},
        "One step of 10 ms from rest at 5 m.",
        holds=(round(y, 3), round(v, 4), round(e, 2)) == (4.999, -0.0981, 49.05),
        corrected=bool(abs(_START - e - gained) < 1e-9 and e < _START),
    )


@claim(
    "worked_step_100",
    1,
    "Explicit Euler, step 100 of the worked fall: y = 4.51 m, v = -0.981 m/s, E = 49.70 J.",
    verdict=Verdict.FALSE,
    corrected="After 100 steps of 10 ms a second has passed: the ball has fallen nearly 5 m.",
    figures={
        "y_m": (0.14405, 1e-6),
        "v_m_per_s": (-9.81, 1e-6),
        "energy_j": (49.53118, 1e-6),
        "gain_percent": (0.981, 1e-6),
    },
)
def _worked_step_100() -> Finding:
    run = bouncing("explicit_euler", 500)
    y, v, e = run.q[100], run.v[100], run.energy[100]
    closed = HEIGHT - GRAVITY * STEP**2 * 100 * 99 / 2
    return Finding(
        {"y_m": y, "v_m_per_s": v, "energy_j": e, "gain_percent": 100 * (e / _START - 1)},
        "100 steps of explicit Euler by the course's integrator.",
        holds=abs(y - 4.51) < 0.01,
        corrected=abs(y - closed) < 1e-10 and abs(v + GRAVITY) < 1e-10,
    )


@claim(
    "worked_step_500",
    1,
    "Explicit Euler, step 500 of the worked fall: the first bounce, E = 52.3 J (+6.6 %).",
    verdict=Verdict.FALSE,
    corrected="The first bounce comes just after one second. By step 500 there have been two, and "
    "the rule that puts the ball back on the floor has added energy too.",
    figures={
        "first_bounce_step": (102, 1e-6),
        "bounces_by_step_500": (2, 1e-6),
        "y_m": (1.600992, 1e-6),
        "energy_j": (52.96835, 1e-6),
        "gain_percent": (7.98848, 1e-6),
    },
)
def _worked_step_500() -> Finding:
    run = bouncing("explicit_euler", 500)
    first, before = int(run.bounced[0]), int((run.bounced <= 500).sum())
    return Finding(
        {
            "first_bounce_step": first,
            "bounces_by_step_500": before,
            "y_m": run.q[500],
            "energy_j": run.energy[500],
            "gain_percent": 100 * (run.energy[500] / _START - 1),
        },
        f"The rule acts at steps {', '.join(str(i) for i in run.bounced)}.",
        holds=first == 500,
        corrected=100 < first < 110 and before >= 2,
    )


@claim(
    "worked_ten_bounces_explicit",
    1,
    "Explicit Euler after ten bounces of the worked example: 78 J, 59 % too much.",
    verdict=Verdict.FALSE,
    corrected="The energy does grow, by the figure below; flight and bounce rule each give a part.",
    figures={
        "energy_j": (69.28999, 1e-6),
        "gain_percent": (41.264, 1e-6),
        "by_flight_j": (10.10479, 1e-6),
        "by_rule_j": (10.1352, 1e-6),
    },
)
def _worked_ten_bounces_explicit() -> Finding:
    run = bouncing("explicit_euler", 20_000, 10)
    gain = 100 * (run.energy[-1] / _START - 1)
    return Finding(
        {
            "energy_j": run.energy[-1],
            "gain_percent": gain,
            "by_flight_j": run.by_flight,
            "by_rule_j": run.by_rule,
        },
        f"Ten bounces take {len(run.q) - 1} steps.",
        holds=abs(gain - 59) < 1,
        corrected=run.by_flight > 0 and run.by_rule > 0
        and abs(run.by_flight + run.by_rule - (run.energy[-1] - _START)) < 1e-9,
    )  # fmt: skip


@claim(
    "worked_ten_bounces_semi_implicit",
    1,
    "Semi-implicit Euler after ten bounces of the worked example: 48.5 J, slowly decaying.",
    verdict=Verdict.FALSE,
    corrected="Each flight takes m g h times the impact speed, the bounce rule gives back a part "
    "that depends on where in the step the impact falls. What is left is the figure below, and "
    "another step or height gives another.",
    figures={
        "energy_j": (49.08522, 1e-6),
        "change_percent": (0.07181, 1e-6),
        "by_flight_j": (-9.233854, 1e-6),
        "by_rule_j": (9.269077, 1e-6),
    },
)
def _worked_ten_bounces_semi_implicit() -> Finding:
    run = bouncing("semi_implicit_euler", 20_000, 10)
    e = float(run.energy[-1])
    return Finding(
        {
            "energy_j": e,
            "change_percent": 100 * (e / _START - 1),
            "by_flight_j": run.by_flight,
            "by_rule_j": run.by_rule,
        },
        f"Ten bounces take {len(run.q) - 1} steps.",
        holds=abs(e - 48.5) < 0.1,
        corrected=run.by_flight < 0 < run.by_rule
        and abs(run.by_flight + run.by_rule - (e - _START)) < 1e-9,
    )  # fmt: skip


@claim(
    "worked_ten_bounces_rk4",
    1,
    "RK4 keeps the energy of the worked example within 0.001 % over ten bounces.",
    verdict=Verdict.CONDITIONAL,
    condition="the impact is resolved inside the step",
    corrected="In flight RK4 is exact, as any second-order method is. All of its error comes from "
    "the bounce rule, which adds m g times the depth at each bounce; with the impact placed at "
    "its time the error is rounding.",
    figures={
        "energy_j": (58.22284, 1e-6),
        "gain_percent": (18.701, 1e-6),
        "by_rule_j": (9.17284, 1e-6),
    },
)
def _worked_ten_bounces_rk4() -> Finding:
    from course.rigid_body import integrators

    run = bouncing("exact_flight", 20_000, 10)
    state = np.array([HEIGHT]), np.array([-3.0])
    exact = _parabola(*state, _falling, STEP, None)
    off = max(
        abs(float(a[0] - b[0]))
        for name in ("rk4", "velocity_verlet", "explicit_midpoint", "implicit_midpoint")
        for a, b in zip(integrators.INTEGRATORS[name].step(*state, _falling, STEP, None), exact,
                        strict=True)
    )  # fmt: skip
    q, v, impacts = np.array([HEIGHT]), np.array([0.0]), 0
    while impacts < 10:
        end = integrators.rk4(q, v, _falling, STEP, None)
        if end[0][0] < 0.0:  # the root of the parabola, then the rest of the step
            before = (v[0] + np.sqrt(v[0] ** 2 + 2 * GRAVITY * q[0])) / GRAVITY
            q, v = integrators.rk4(q, v, _falling, before, None)
            end = integrators.rk4(np.array([0.0]), -v, _falling, STEP - before, None)
            impacts += 1
        q, v = end
    resolved = abs(_energy(q, v) / _START - 1)
    gain = float(run.energy[-1] / _START - 1)
    return Finding(
        {"energy_j": run.energy[-1], "gain_percent": 100 * gain, "by_rule_j": run.by_rule},
        f"With the bounce rule {100 * gain:.2f} % too much; with resolved impacts "
        f"{100 * resolved:.0e} %. One step of each second-order method is the parabola to "
        f"{off:.0e}.",
        holds=abs(gain) < 1e-5,
        holds_if=resolved < 1e-5,
        corrected=resolved < 1e-12 and run.by_flight == 0 and off < 1e-12,
    )


@claim(
    "worked_table_belongs_to_the_method",
    1,
    "The energies after ten bounces are a property of the integrator.",
    verdict=Verdict.FALSE,
    corrected="They hang on the last digit. The example's numbers make every rebound land "
    "exactly on "
    "the floor at the end of a step, so one rounding of the velocity decides whether the rule acts "
    "then or a full step deeper. Average over heights before comparing methods.",
    figures={
        "explicit_euler_e_below_1_j": (59.28625, 1e-6),
        "explicit_euler_e_1_j": (69.28999, 1e-6),
        "explicit_euler_e_above_1_j": (69.28999, 1e-6),
        "semi_implicit_euler_e_below_1_j": (44.34559, 1e-6),
        "semi_implicit_euler_e_1_j": (49.08522, 1e-6),
        "semi_implicit_euler_e_above_1_j": (45.27427, 1e-6),
        "exact_flight_e_below_1_j": (49.08522, 1e-6),
        "exact_flight_e_1_j": (58.22284, 1e-6),
        "exact_flight_e_above_1_j": (58.22284, 1e-6),
    },
)
def _worked_table_belongs_to_the_method() -> Finding:
    figures: dict[str, float | str] = {}
    spreads = []
    for name in ("explicit_euler", "semi_implicit_euler", "exact_flight"):
        ends = [
            float(bouncing(name, 20_000, 10, restitution=e).energy[-1])
            for e in ("0.999999999", "1", "1.000000001")
        ]
        for label, value in zip(("below_1", "1", "above_1"), ends, strict=True):
            figures[f"{name}_e_{label}_j"] = value
        spreads.append(max(ends) - min(ends))
    return Finding(
        figures,
        "Energy after ten bounces in exact arithmetic, with a restitution of 1 and of 1e-9 less "
        "and "
        f"more: up to {max(spreads):.1f} J apart.",
        holds=max(spreads) < 1e-6,
        corrected=max(spreads) > 1.0,
    )


@claim(
    "semi_implicit_bouncing_decays",
    1,
    "A ball that bounces elastically under semi-implicit Euler slowly loses energy.",
    verdict=Verdict.FALSE,
    corrected="Averaged over drop heights, what the flight takes and what the bounce rule gives "
    "back "
    "nearly cancel; single runs end above or below the start.",
    figures={
        "lowest_percent": (-0.9237139, 1e-6),
        "highest_percent": (1.022396, 1e-6),
        "mean_percent": (0.2186058, 1e-6),
        "flight_alone_percent": (-19.79465, 1e-6),
    },
)
def _semi_implicit_bouncing_decays() -> Finding:
    heights = [f"{4 + i * 0.0997:.4f}" for i in range(12)]
    changes, flights = [], []
    for height in heights:
        run = bouncing("semi_implicit_euler", 20_000, 10, height=height)
        changes.append(float(run.energy[-1] / run.energy[0] - 1))
        flights.append(run.by_flight / float(run.energy[0]))
    low, high, mean = min(changes), max(changes), float(np.mean(changes))
    return Finding(
        {
            "lowest_percent": 100 * low,
            "highest_percent": 100 * high,
            "mean_percent": 100 * mean,
            "flight_alone_percent": 100 * float(np.mean(flights)),
        },
        "Change over ten bounces from 12 heights between 4 m and 5.1 m, 10 ms.",
        holds=high < 0,
        corrected=low < 0 < high and abs(mean) < 0.2 * abs(float(np.mean(flights))),
    )


@claim(
    "elastic_bounce_rule",
    1,
    "Putting the ball back on the floor and reversing its velocity is elastic.",
    verdict=Verdict.FALSE,
    corrected="Reversing is; putting it back lifts it by the depth d and adds m g d. The depth "
    "is up "
    "to one step's travel, so a bounce adds at most m g v h, whatever the integrator.",
    figures={"added_in_ten_bounces_j": (9.17284, 1e-6), "bound_j": (10.15291, 1e-6)},
)
def _elastic_bounce_rule() -> Finding:
    run = bouncing("exact_flight", 20_000, 10)
    speeds = np.abs(run.v[run.bounced])
    bound = float((GRAVITY * speeds * STEP).sum())
    return Finding(
        {"added_in_ten_bounces_j": run.by_rule, "bound_j": bound},
        "Exact flight, so that all the energy comes from the rule.",
        holds=run.by_rule < 1e-9,
        corrected=0 < run.by_rule < bound,
    )


@claim(
    "order_survives_bounces",
    1,
    "RK4 is a fourth-order method.",
    verdict=Verdict.CONDITIONAL,
    condition="the motion is smooth within each step",
    corrected="Across an impact that the step does not resolve, the error is of first order in the "
    "step, for RK4 as for Euler.",
    figures={"order_smooth": (3.942261, 0.02), "order_with_bounce": (1.008538, 0.02)},
)
def _order_survives_bounces() -> Finding:
    from course.rigid_body import integrators, problems

    def error(n: int) -> float:
        """Mean error 1.8 s after the drop over many heights: one bounce each."""
        heights = np.linspace(3.0, 5.0, 200)
        q, v, dt = heights[None].copy(), np.zeros((1, 200)), 1.8 / n
        for _ in range(n):
            q, v = integrators.rk4(q, v, _falling, dt, None)
            below = q < 0.0
            q, v = np.where(below, 0.0, q), np.where(below, -v, v)
        true = [problems.bounce_height(1.8, x, 1.0, GRAVITY) for x in heights]
        return float(np.abs(q[0] - true).mean())

    with_bounce = float(np.log2(error(250) / error(2000)) / 3)
    pendulum = problems.pendulum()
    smooth = []
    for n in (1000, 2000):
        run = integrators.simulate(pendulum.system, "rk4", 2.0 / n, n)
        smooth.append(pendulum.error(run.q[-1]))
    order = float(np.log2(smooth[0] / smooth[1]))
    return Finding(
        {"order_smooth": order, "order_with_bounce": with_bounce},
        "RK4 on a pendulum, and on a ball that bounces once, over 200 heights.",
        holds=with_bounce > 3.5,
        holds_if=abs(order - 4) < 0.1,
        corrected=abs(with_bounce - 1) < 0.1,
    )


@claim(
    "listing_energy_decay",
    1,
    "A semi-implicit simulation of a ball with restitution 0.6 loses energy because of its "
    "integrator.",
    verdict=Verdict.FALSE,
    corrected="It loses energy because the restitution takes it. The integrator's share, at 1 ms "
    "over 5 s, is half a percent of the loss, and the bounce rule gives some back.",
    figures={
        "lost_j": (49.04999, 1e-4),
        "share_of_restitution": (1.000487, 1e-4),
        "share_of_integrator": (0.004905001, 1e-4),
        "share_of_rule": (-0.00539235, 1e-4),
    },
)
def _listing_energy_decay() -> Finding:
    run = bouncing("semi_implicit_euler", 5000, None, "0.001", "0.6")
    total = _START - float(run.energy[-1])
    return Finding(
        {
            "lost_j": total,
            "share_of_restitution": -run.by_restitution / total,
            "share_of_integrator": -run.by_flight / total,
            "share_of_rule": -run.by_rule / total,
        },
        "5 m, 1 kg, 1 ms, 5 s, restitution 0.6, with the usual bounce rule.",
        holds=-run.by_flight > 0.5 * total,
        corrected=-run.by_restitution > 0.98 * total and 0 < -run.by_flight < 0.02 * total,
    )


@claim(
    "tunnelling_thickness",
    1,
    "An object flies through another when it moves farther than its own thickness in a step.",
    verdict=Verdict.FALSE,
    corrected="What counts is the sum of both thicknesses along the motion, w + d. Up to "
    "v dt = w + d some step always overlaps; beyond it the overlap is missed with probability "
    "1 - (w + d) / (v dt).",
    figures={
        "limit_m_per_s": (35, 0.02),
        "missed_below": (0, 0.02),
        "missed_at_twice": (0.5, 0.02),
    },
    formula=Formula(
        "A body of thickness d flies at a wall of thickness w; overlap is tested once per step "
        "dt. Up to which speed is an overlap certain to be seen?",
        "(w + d)/dt",
        {
            "w": Symbol("thickness of the wall [m]", 0.001, 1.0),
            "d": Symbol("thickness of the body [m]", 0.001, 1.0),
            "dt": Symbol("step [s]", 0.001, 0.1),
        },
        left=("v", "speed"),
        relation="<",
        slips={
            "w/dt": "The body has a thickness too; it overlaps for longer.",
            "d/dt": "The wall has a thickness too; it overlaps for longer.",
            "(w + d)*dt": "Check the units: a length over a time.",
        },
    ),
)
def _tunnelling_thickness() -> Finding:
    import sympy

    wall, body, dt = 0.02, 0.05, 0.002

    def missed(speed: float) -> float:
        phases = (np.arange(1000) + 0.5) / 1000 * speed * dt
        steps = np.arange(-200, 200)[:, None] * speed * dt
        nose = phases + steps  # front of the body; the wall is [0, wall]
        seen = ((nose >= 0) & (nose - body <= wall)).any(axis=0)
        return float(1 - seen.mean())

    limit = (wall + body) / dt
    inside, own = missed(0.999 * limit), missed(1.2 * body / dt)
    double, expected = missed(2 * limit), 0.5
    w, d, step = sympy.symbols("w d dt", positive=True)
    return Finding(
        {"limit_m_per_s": limit, "missed_below": inside, "missed_at_twice": double},
        f"5 cm body, 2 cm wall, 2 ms: at 1.2 times its own thickness per step {100 * own:.0f} % "
        f"are missed, at twice the limit {100 * double:.0f} %.",
        holds=own > 0,
        corrected=inside == 0 and abs(double - expected) < 0.01,
        formula=(w + d) / step,
    )
