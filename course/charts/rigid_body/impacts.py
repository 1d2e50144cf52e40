"""Where it fails, at a contact: tunnelling, chatter at rest, and events that are not handled."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.charts import chart
from course.charts.rigid_body.failures import LABELS
from course.measure.figure import Panel, Series
from course.measure.stability import limit
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import kit as mujoco_kit
from course.rigid_body import events, planar, problems
from course.rigid_body.integrators import Array, explicit_euler

# --- RK4 with events handled and not -------------------------------------------------------------


@chart
def events_order(steps: Sequence[int] = (100, 200, 400, 800), phases: int = 8) -> Iterator[Panel]:
    """Chart RK4 with events handled and not: the order drops from four to one.

    Against the closed form. A late impact is late by the part of the step that is left, which is
    anything from 0 to dt; so each step is tried with several phases, by a few steps more, and the
    root mean square is taken.

    Args:
        steps: numbers of steps of the run of 2.5 s.
        phases: runs per step.
    """
    problem = events.bouncing_pendulum()
    panel = Panel(
        "An impact applied at the end of its step makes every integrator first order",
        "step [ms]",
        "rms error of the angle after 2.5 s [rad]",
        scale="log",
        ticks=(3, 6, 12, 24),
        ylim=(1e-11, 1.0),
    )
    # The mean step of the phases belongs to the mean error.
    dt = problem.duration / (np.array(steps) + 0.5 * (phases - 1))

    # The closed form of the bouncing pendulum is the truth, for every number of steps.
    def error(name: str, n: int, handled: bool) -> float:
        end, _ = events.simulate_with_events(
            problem.system,
            name,
            problem.duration / n,
            n,
            events.wall_gap,
            events.elastic_wall,
            handled,
        )
        return problem.error(end.q[-1])

    for name in ("rk4", "velocity_verlet"):
        for handled, where in ((True, "time found in the step"), (False, "at the end of the step")):
            rows = [[error(name, n + j, handled) for j in range(phases)] for n in steps]
            # Root mean square over the phases: a single phase could hit the wall at a step's end by
            # luck.
            rms = np.sqrt(np.mean(np.square(rows), axis=1))
            order = np.polyfit(np.log(dt), np.log(rms), 1)[0]
            panel.series.append(
                Series(
                    f"{LABELS[name]}, impact {where}: order {order:.2f}",
                    dt * 1e3,
                    rms,
                    name,
                    "-" if handled else "--",
                    hollow=not handled,
                    size=7.0 if handled or name == "rk4" else 11.0,
                    note=f"{name:<16} {'handled' if handled else 'late':<8} order {order:5.2f}"
                    f"   error at {dt[-1] * 1e3:.1f} ms: {rms[-1]:.1e} rad",
                )
            )
    yield panel


# --- tunnelling ----------------------------------------------------------------------------------


def miss_probability(travel: float | Array, thickness: float) -> Array:
    """Return share of phases in which no sample falls into the wall: 1 - d / (v dt), not below 0.

    Args:
        travel: way made in one step, v dt [m].
        thickness: d [m].
    """
    return np.maximum(0.0, 1.0 - thickness / np.asarray(travel, dtype=float))


def point_misses(ratio: float, samples: int, rng: np.random.Generator) -> float:
    """Return share of point balls that a check at the end of every step does not see in the wall.

    Args:
        ratio: travel per step over the wall's thickness.
        samples: balls, each with its own phase.
        rng: source of the phases.
    """
    # A random phase of the first step, before the wall.
    start = -ratio * (1.0 + rng.random(samples))
    inside = np.zeros(samples, dtype=bool)
    for n in range(4 + math.ceil(2.0 / ratio)):
        x = start + ratio * n
        inside |= (x >= 0.0) & (x <= 1.0)
    return float(1.0 - np.mean(inside))


def swept_misses(ratio: float, samples: int, rng: np.random.Generator) -> float:
    """Count misses as `point_misses` does, with the impact as an event within the step.

    Nothing passes through.
    """

    def free(q: Array, v: Array, params: Array) -> Array:
        return np.zeros_like(v)

    def gap(q: Array) -> float:
        return -float(q[0])

    def bounce(q: Array, v: Array) -> tuple[Array, Array]:
        return q, -np.abs(v)

    through = 0
    empty = np.zeros(0)
    for _ in range(samples):
        q, v = np.array([-ratio * (1.0 + rng.random())]), np.array([ratio])
        for _ in range(4):
            # The time of impact is located within the step, so that the phase does not matter.
            q, v, _ = events.step_with_event(q, v, explicit_euler, free, 1.0, empty, gap, bounce)
        through += bool(q[0] > 0.0)
    return through / samples


def mujoco_wall(
    thickness: float, radius: float, speed: float, dt: float, one_step: bool
) -> mujoco_kit.Runner:
    """Return a ball on a slide that flies at a wall, in MuJoCo.

    Args:
        thickness: of the wall, a box geom about x = 0 [m].
        radius: of the ball [m].
        speed: [m/s].
        dt: step [s].
        one_step: a contact that stops the ball within one step, instead of MuJoCo's default,
            a spring-damper with a time constant of 20 ms.
    """
    contact = f'solref="0 {-1.0 / dt:.17g}" solimp="0.9999 0.9999 0.001"' if one_step else ""
    xml = (
        f'<mujoco><option timestep="{dt:.17g}" gravity="0 0 0"><flag autoreset="disable"'
        f"{' refsafe=' + chr(34) + 'disable' + chr(34) if one_step else ''}/></option><worldbody>"
        f'<geom type="box" size="{0.5 * thickness:.17g} 1 1" {contact}/>'
        '<body><joint type="slide" axis="1 0 0"/>'
        f'<geom type="sphere" size="{radius:.17g}" mass="1" {contact}/></body></worldbody></mujoco>'
    )
    return mujoco_kit.Runner(xml, [-thickness - 2.0 * radius], [speed], "Euler")


def mujoco_through(
    thickness: float, radius: float, speed: float, dt: float, phases: ArrayLike, one_step: bool
) -> float:
    """Return the share of the phases in which MuJoCo's ball comes out on the far side of the wall.

    Args:
        thickness: as for `mujoco_wall`.
        radius: as for `mujoco_wall`.
        speed: as for `mujoco_wall`.
        dt: as for `mujoco_wall`.
        one_step: as for `mujoco_wall`.
        phases: where in a step the ball reaches the wall, numbers from 0 to 1.
    """
    runner = mujoco_wall(thickness, radius, speed, dt, one_step)
    touch = 0.5 * thickness + radius
    # Long enough to cross the wall several times over; a soft contact gets 0.2 s more to push back.
    steps = 4 + math.ceil(5.0 * touch / (speed * dt)) + (0 if one_step else math.ceil(0.2 / dt))
    through = 0
    shares = np.asarray(phases, dtype=float)
    for phase in shares:
        # The start is shifted by fractions of a step's travel: the phases of the samples.
        runner.q0[0] = -touch - speed * dt * (1.0 + phase)
        q, _ = runner.run(steps)
        through += bool(q[0] > 0.0)
    return through / shares.size


# MuJoCo's default contact: solref = (0.02 s, 1), solimp = (0.9, 0.95, 1 mm).
_TIME_CONSTANT, _IMPEDANCE = 0.02, 0.95


def stopping_time() -> float:
    """Return how deep a ball sinks into MuJoCo's default contact, per unit of its speed [s].

    The value is 7.29 ms.

    It is a way over a speed, 0.36 of solref's time constant T = 20 ms, and not a time that passes:
    the deepest point is reached later. Beyond 1 mm the contact is r'' + d b r' + d k r = 0 with the
    impedance d = 0.95, b = 2 / (d T) and k = 1 / (d T)^2 (MuJoCo documentation, Solver
    parameters). Its deepest point is v / w exp(-z acos(z) / sqrt(1 - z^2)), with w^2 = d k and
    2 z w = d b; for d = 1, critical damping, it is v T / e.
    """
    omega = math.sqrt(_IMPEDANCE) / (_IMPEDANCE * _TIME_CONSTANT)
    zeta = 1.0 / (_TIME_CONSTANT * omega)
    # Deepest point of a damped oscillator that is hit with unit speed.
    return math.exp(-zeta * math.acos(zeta) / math.sqrt(1.0 - zeta**2)) / omega


def penetration_speed(
    thickness: float, radius: float, dt: float, one_step: bool, phases: int = 16
) -> float:
    """Return the speed above which MuJoCo's ball gets through the wall in some phase [m/s].

    Args:
        thickness: as for `mujoco_wall`.
        radius: as for `mujoco_wall`.
        dt: as for `mujoco_wall`.
        one_step: as for `mujoco_wall`.
        phases: how many to try, evenly spread from one sample on the surface to the next.
    """
    spread = np.linspace(0.001, 0.999, phases)
    touch = 0.5 * thickness + radius

    def stopped(speed: float) -> bool:
        return mujoco_through(thickness, radius, speed, dt, spread, one_step) == 0.0

    # Bracket the limit by theory, with room on both sides.
    high = (2.0 if one_step else 1.2) * touch / (dt if one_step else stopping_time())
    return limit(stopped, 0.2 * high, high, rel=5e-3)


@chart
def tunnelling(
    ratios: Sequence[float] = (0.25, 0.4, 0.48, 0.55, 0.7, 0.95, 1.05, 1.4, 2.0, 3.0, 5.0, 10.0),
    balls: int = 20_000,
    swept: int = 100,
    phases: int = 400,
    steps: Sequence[float] = (2e-4, 5e-4, 1e-3, 2e-3, 5e-3),
    walls: Sequence[tuple[float, float]] = ((0.02, 0.01), (0.005, 0.0025)),
) -> Iterator[Panel]:
    """Chart which balls pass a thin wall: a law for checks per step, another for soft contact.

    Args:
        ratios: travel per step over D, the sum of both thicknesses.
        balls: how many balls are thrown at each ratio, points checked once a step.
        swept: the same for points whose impact is an event.
        phases: the same for MuJoCo's balls.
        steps: of MuJoCo, where the speed that gets through is sought [s].
        walls: (thickness, radius of the ball) [m].
    """
    rng = np.random.default_rng(2)
    thickness, radius, dt = 0.02, 0.01, 1e-3
    both = thickness + 2.0 * radius  # D

    def law(ratio: float) -> float:
        return float(miss_probability(ratio, 1.0))

    def half(ratio: float) -> float:
        # MuJoCo pushes back only up to the middle of the wall: D/2 replaces D.
        return float(miss_probability(ratio, 0.5))

    def stiff(ratio: float) -> float:
        # Evenly spread phases with a common random shift (systematic sampling).
        spread = (np.arange(phases) + rng.random()) / phases
        return mujoco_through(thickness, radius, ratio * both / dt, dt, spread, True)

    checks_panel = Panel(
        "One check per step: MuJoCo lets balls through from half the speed",
        "v dt / D, with D the sum of both thicknesses",
        "share of balls that get through",
        scale="log x",
        ticks=(0.25, 0.5, 1, 2, 5, 10),
        theory="theory: 1 - D/(v dt), MuJoCo with D/2",
    )
    checks_panel.series = [
        Series(
            "course, checked once a step",
            ratios,
            [point_misses(r, balls, rng) for r in ratios],
            "checked once a step",
            "",
            law,
        ),
        Series(
            "impact as an event in the step",
            ratios,
            [swept_misses(r, swept, rng) for r in ratios],
            "event in the step",
            "",
        ),
        Series(
            "MuJoCo, one-step contact",
            ratios,
            [stiff(r) for r in ratios],
            "MuJoCo, one-step contact",
            "",
            half,
            hollow=True,
        ),
    ]
    points, handled, mujocos = checks_panel.series
    checks_panel.notes = [
        "checked once a step: worst deviation from 1 - D/(v dt) "
        f"{np.max(np.abs(points.y - points.expected)):.3f} over {balls} start positions",
        "MuJoCo, one-step contact: worst deviation from 1 - (D/2)/(v dt) "
        f"{np.max(np.abs(mujocos.y - mujocos.expected)):.3f} over {phases} start positions",
        f"impact as an event: {np.max(handled.y):.0%} get through",
    ]
    yield checks_panel

    right = Panel(
        "MuJoCo's default contact: a smaller step does not help",
        "step [ms]",
        "lowest speed that gets through [m/s]",
        scale="log",
        ylim=(None, 1e3),
        ticks=[h * 1e3 for h in steps],
        theory=f"theory: D/2 over {stopping_time() * 1e3:.2f} ms (default) or the step (one-step)",
    )
    right.notes.append(
        "MuJoCo, default contact: sinks in by its speed times "
        f"{stopping_time() * 1e3:.2f} ms, {stopping_time() / _TIME_CONSTANT:.2f} of its time "
        f"constant of {_TIME_CONSTANT * 1e3:g} ms (theory)"
    )
    for wall in walls:
        reach = 0.5 * wall[0] + wall[1]
        name = f"D/2 = {reach * 1e3:g} mm"
        soft, hard = (
            np.array([penetration_speed(*wall, h, one_step) for h in steps])
            for one_step in (False, True)
        )

        def sunk(ms: float, reach: float = reach) -> float:
            return reach / stopping_time()

        def one(ms: float, reach: float = reach) -> float:
            return reach / (ms * 1e-3)

        step_ms, big = np.array(steps) * 1e3, wall == walls[0]
        right.series += [
            Series(
                f"default contact, {name}",
                step_ms,
                soft,
                "MuJoCo, default contact",
                "",
                sunk,
                marker="o" if big else "v",
                size=6.0,
            ),
            Series(
                f"one-step contact, {name}",
                step_ms,
                hard,
                "MuJoCo, one-step contact",
                "",
                one,
                marker="s" if big else "D",
                hollow=True,
                size=7.0,
            ),
        ]
        speeds = ", ".join(f"{v:.2f} at {h * 1e3:g} ms" for h, v in zip(steps, soft, strict=True))
        right.notes += [
            f"  D/2 = {reach * 1e3:4.1f} mm: theory {sunk(0.0):.2f} m/s, measured {speeds}",
            "    one-step contact: speed times dt over D/2 "
            + ", ".join(f"{v * h / reach:.2f}" for h, v in zip(steps, hard, strict=True)),
        ]
    yield right


# --- chatter -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rest:
    """How quiet a box is that should lie still.

    Attributes:
        name: who, and with what.
        impacts_per_second: mean over the recorded time [1/s].
        noise: root mean square of the speed of a corner about the centre, and of the centre [m/s].
        unresolved: share of the steps with more impacts than are followed.
    """

    name: str
    impacts_per_second: float
    noise: float
    unresolved: float = 0.0

    @property
    def words(self) -> str:
        """The name in two short lines."""
        short = self.name.replace("semi_implicit_euler", "semi-implicit")
        short = short.replace("velocity_verlet", "velocity Verlet")
        return short.replace(", rest", ",\nrest") + (" m/s" if "rest speed" in short else "")


_BOX = (0.3, 0.2)  # width, height [m]
_ARM = 0.5 * math.hypot(*_BOX)


def _noise(v: Array) -> float:
    return float(np.sqrt(np.mean(v[0] ** 2 + v[1] ** 2 + (_ARM * v[2]) ** 2)))


def our_box_at_rest(
    rest_speed: float,
    resolve_impacts: bool = True,
    integrator: str = "semi_implicit_euler",
    duration: float = 10.0,
    dt: float = 2e-3,
) -> Rest:
    """Return a box dropped on its corner, 5 s later: impacts and speeds over `duration` seconds.

    Args:
        rest_speed: an impact slower than this does not bounce [m/s].
        resolve_impacts: find impacts within the step.
        integrator: name.
        duration: recorded time [s].
        dt: step [s].
    """
    box = planar.box_parameters(1.0, *_BOX, restitution=0.7, friction=0.5, rest_speed=rest_speed)
    state = np.array([[0.0], [0.3], [0.3], [0.0], [0.0], [0.0]])
    options: dict[str, Any] = {"integrator": integrator, "resolve_impacts": resolve_impacts}
    # Five seconds to come to rest are not recorded.
    state, _ = planar.advance_boxes(state, box, dt, round(5.0 / dt), **options)
    steps = round(duration / dt)
    v = np.empty((3, steps))
    impacts = unresolved = 0
    for i in range(steps):
        state, counts = planar.advance_boxes(state, box, dt, 1, **options)
        v[:, i] = state[3:, 0]
        impacts += int(counts[0, 0])
        unresolved += int(counts[1, 0])
    where = "in the step" if resolve_impacts else "end of step"
    name = f"{integrator}, {where}, rest speed {rest_speed:g}"
    return Rest(name, impacts / duration, _noise(v), unresolved / steps)


def mujoco_box_at_rest(
    integrator: str, contact: str, duration: float = 10.0, dt: float = 2e-3
) -> Rest:
    """Return the same box in MuJoCo; an impact is a corner passing the ground downwards.

    Args:
        integrator: MuJoCo's name of it.
        contact: "impulse" or "spring", see `course.oracles.mujoco.box.box_drop`.
        duration: recorded time [s].
        dt: step [s].
    """
    runner = mujoco_box.box_drop(
        (0.5 * _BOX[0], 0.5 * _BOX[1]),
        1.0,
        [0.0, 0.3, 0.3],
        [0.0, 0.0, 0.0],
        dt,
        integrator,
        restitution=0.7,
        friction=0.5,
        gravity=problems.STANDARD_GRAVITY,
        contact=contact,
    )
    path = runner.samples(round((5.0 + duration) / dt))
    after = path.times > 5.0
    q, v = path.q[:, after], path.v[:, after]
    impacts = 0
    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        # Height of one corner; an impact is a change of its sign downwards.
        corner = q[1] + 0.5 * (a * _BOX[0] * np.sin(q[2]) + b * _BOX[1] * np.cos(q[2]))
        impacts += int(np.sum((corner[:-1] > 0.0) & (corner[1:] <= 0.0)))
    return Rest(f"MuJoCo {integrator}, {contact}", impacts / duration, _noise(v))


def zeno_end(
    height: float, restitution: float, gravity: float = problems.STANDARD_GRAVITY
) -> float:
    """Return the time at which infinitely many bounces have ended [s].

    It is sqrt(2 h / g) (1 + e) / (1 - e).
    """
    # Geometric series of the flight times.
    return math.sqrt(2.0 * height / gravity) * (1.0 + restitution) / (1.0 - restitution)


def zeno_counts(
    times: Array, height: float = 1.0, restitution: float = 0.7, rest_speed: float = 0.0
) -> Array:
    """Return impacts of a flat box, dropped from rest, until each of the times, found as events.

    Args:
        times: [s], shape (n,).
        height: drop height [m].
        restitution: e.
        rest_speed: an impact slower than this does not bounce [m/s].

    Returns:
        Numbers of impacts, shape (n,).
    """
    box = planar.box_parameters(
        1.0, 0.2, 0.2, restitution=restitution, friction=0.0, rest_speed=rest_speed
    )
    start = np.array([[0.0], [0.1 + height], [0.0], [0.0], [0.0], [0.0]])
    counts = []
    # One step of any length: between events the flight is exact, so only the impacts cost.
    for t in times:
        _, result = planar.advance_boxes(
            start, box, float(t), 1, integrator="velocity_verlet", max_events=1000
        )
        counts.append(int(result[0, 0]))
    return np.array(counts)


@chart(
    title="Springs tuned to bounce, impacts at the end of the step, and semi-implicit flight "
    "without a rest speed: all three chatter",
)
def chatter(duration: float = 10.0, points: int = 121) -> Iterator[Panel]:
    """Chart a box that should lie still, and a ball that bounces infinitely often.

    Args:
        duration: how long the box is watched [s].
        points: moments at which the ball's impacts are counted.
    """
    rows = [
        our_box_at_rest(0.0, duration=duration),
        our_box_at_rest(0.0, integrator="velocity_verlet", duration=duration),
        our_box_at_rest(0.01, duration=duration),
        our_box_at_rest(0.0, False, duration=duration),
        our_box_at_rest(0.01, False, duration=duration),
        mujoco_box_at_rest("Euler", "impulse", duration),
        mujoco_box_at_rest("Euler", "spring", duration),
        mujoco_box_at_rest("discrete", "spring", duration),
    ]
    impacts = [row.impacts_per_second for row in rows]
    speeds = [row.noise * 1e3 for row in rows]
    for title, unit, values, floor in (
        ("Impacts of a box that should lie still", "impacts per second", impacts, 1.0),
        ("Its speed", "rms speed [mm/s]", speeds, 1e-4),
    ):
        panel = Panel(
            title,
            unit,
            scale="log x",
            xlim=(floor, 100.0 * max(values)),
            ticks=() if values is speeds else None,
        )
        for key, part in (("course", slice(0, 5)), ("MuJoCo", slice(5, 8))):
            panel.series.append(
                Series(
                    key,
                    values[part],
                    [row.words for row in rows[part]],
                    key,
                    "bar",
                    tags=[f"{v:.3g}" for v in values[part]],
                )
            )
        if values is speeds:
            panel.notes = [
                f"{row.name:<56} {row.impacts_per_second:>8.1f} impacts/s "
                f"{row.noise * 1e3:>10.4f} mm/s rms"
                + (f"  ({row.unresolved:.0%} of the steps gave up)" if row.unresolved else "")
                for row in rows
            ]
        yield panel

    height, restitution = 1.0, 0.7
    end = zeno_end(height, restitution)
    # Log-uniform in the time left, since the bounces accumulate at the end.
    remaining = np.geomspace(1.0, 1e-6, points)
    theory = np.searchsorted(problems.bounce_times(height, restitution, 200), end - remaining)
    ours, cut = (zeno_counts(end - remaining, height, restitution, rest) for rest in (0.0, 0.01))
    late = np.array([end + 1.0])
    past = [zeno_counts(late, height, restitution, rest)[0] for rest in (0.0, 0.01)]
    bounces = Panel(
        "Infinitely many bounces in a finite time",
        "time left to the end of the bouncing [s] (time runs to the right)",
        "impacts so far",
        scale="log x",
        xlim=(2.0, 5e-7),
    )
    few = slice(None, None, max(1, points // 30))
    bounces.series = [
        Series("theory: ln(time left) / ln(e)", remaining, theory, "theory", "steps", width=1.0),
        Series("rest speed 0: every impact an event", remaining[few], ours[few], "", "", size=4.0),
        Series("rest speed 0.01 m/s", remaining[few], cut[few], "", "", marker="x"),
    ]
    bounces.notes.append(
        f"bouncing ball, e = {restitution}: all bounces over at {end:.4f} s; "
        f"{np.max(np.abs(ours - theory))} impacts off the theory until 1 us before the end; "
        f"past it {past[0]} with rest speed 0 (stopped by its limit of 1000), "
        f"{past[1]} with 0.01 m/s"
    )
    yield bounces
