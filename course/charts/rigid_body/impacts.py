"""Where it fails, at a contact: tunnelling, chatter at rest, and events that are not handled."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.charts import chart, save
from course.measure.stability import limit
from course.measure.work_precision import PALETTE
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import kit as mujoco_kit
from course.rigid_body import events, planar, problems
from course.rigid_body.integrators import Array, explicit_euler

BLUE, ORANGE, GREEN, PINK, SKY, YELLOW, GREY, _ = PALETTE


# --- RK4 with events handled and not -------------------------------------------------------------


@dataclass(frozen=True)
class EventOrder:
    """Error against step of one integrator on a pendulum that bounces off a wall.

    Attributes:
        integrator: its name.
        handled: whether the event's time was found within the step.
        dt: steps [s], shape (n,), descending.
        error: of the angle at the end [rad], shape (n,), root mean square over the phases.
        order: slope of the fit of log error against log step.
    """

    integrator: str
    handled: bool
    dt: Array
    error: Array
    order: float


def event_orders(
    integrators: Sequence[str] = ("rk4", "velocity_verlet"),
    steps: Sequence[int] = (100, 200, 400, 800),
    phases: int = 8,
) -> list[EventOrder]:
    """Observed order with events handled and not, against the closed form.

    A late impact is late by the part of the step that is left, which is anything from 0 to dt; so
    each step is tried with several phases, by a few steps more, and the mean is taken.

    Args:
        integrators: names.
        steps: numbers of steps of the run of 2.5 s.
        phases: runs per step.

    Returns:
        For every integrator the handled and the late events.
    """
    problem = events.bouncing_pendulum()
    found = []
    for name in integrators:
        for handled in (True, False):
            errors = np.empty((len(steps), phases))
            for i, n in enumerate(steps):
                for j in range(phases):
                    end, _ = events.simulate_with_events(
                        problem.system, name, problem.duration / (n + j), n + j,
                        events.wall_gap, events.elastic_wall, handled,
                    )  # fmt: skip
                    errors[i, j] = problem.error(end.q[-1])
            # The mean step of the phases belongs to the mean error.
            dts = problem.duration / (np.array(steps) + 0.5 * (phases - 1))
            error = np.sqrt(np.mean(errors**2, axis=1))
            slope = float(np.polyfit(np.log(dts), np.log(error), 1)[0])
            found.append(EventOrder(name, handled, dts, error, slope))
    return found


@chart
def events_order() -> str:
    """RK4 with events handled and not: the order drops from four to one."""
    import matplotlib.pyplot as plt

    found = event_orders()
    figure, ax = plt.subplots(figsize=(8.0, 5.0), layout="constrained")
    colours = {"rk4": BLUE, "velocity_verlet": ORANGE}
    names = {"rk4": "RK4", "velocity_verlet": "velocity Verlet"}
    lines = []
    for item in found:
        text = "impact time found in the step" if item.handled else "impact at the end of the step"
        ax.loglog(
            item.dt * 1e3,
            item.error,
            "-" if item.handled else "--",
            marker="o" if item.handled else "x" if item.integrator == "rk4" else "+",
            markersize=7,
            color=colours[item.integrator],
            label=f"{names[item.integrator]}, {text}: order {item.order:.2f}",
        )
        lines.append(
            f"{item.integrator:<16} {'handled' if item.handled else 'late':<8}"
            f" order {item.order:5.2f}"
            f"   error at {item.dt[-1] * 1e3:.1f} ms: {item.error[-1]:.1e} rad"
        )
    ax.set(
        xlabel="step [ms]",
        ylabel="rms error of the angle after 2.5 s [rad]",
        title="An impact applied at the end of its step makes every integrator first order",
    )
    ax.set_xticks([3, 6, 12, 24], ["3", "6", "12", "24"])
    ax.minorticks_off()
    ax.set_ylim(1e-11, 1e2)
    ax.grid(True, which="major", alpha=0.3)
    ax.legend(loc="upper left", fontsize="small")
    save(
        "events_order",
        figure,
        [{**vars(item), "dt": item.dt.tolist(), "error": item.error.tolist()} for item in found],
    )
    return "\n".join(lines)


# --- tunnelling ----------------------------------------------------------------------------------


def miss_probability(travel: float | Array, thickness: float) -> Array:
    """Share of phases in which no sample falls into the wall: 1 - d / (v dt), not below 0.

    Args:
        travel: way made in one step, v dt [m].
        thickness: d [m].
    """
    return np.maximum(0.0, 1.0 - thickness / np.asarray(travel, dtype=float))


def point_misses(ratio: float, samples: int, rng: np.random.Generator) -> float:
    """Share of point balls that a check at the end of every step does not see in the wall.

    Args:
        ratio: travel per step over the wall's thickness.
        samples: balls, each with its own phase.
        rng: source of the phases.
    """
    start = -ratio * (1.0 + rng.random(samples))
    inside = np.zeros(samples, dtype=bool)
    for n in range(4 + math.ceil(2.0 / ratio)):
        x = start + ratio * n
        inside |= (x >= 0.0) & (x <= 1.0)
    return float(1.0 - np.mean(inside))


def swept_misses(ratio: float, samples: int, rng: np.random.Generator) -> float:
    """As `point_misses`, but the impact is an event within the step: nothing gets through."""

    def free(q: Array, v: Array, params: Array) -> Array:
        return np.zeros_like(v)

    def gap(q: Array) -> float:
        return -float(q[0])

    def bounce(q: Array, v: Array) -> tuple[Array, Array]:
        return q, -np.abs(v)

    through = 0
    none = np.zeros(0)
    for _ in range(samples):
        q, v = np.array([-ratio * (1.0 + rng.random())]), np.array([ratio])
        for _ in range(4):
            q, v, _ = events.step_with_event(q, v, explicit_euler, free, 1.0, none, gap, bounce)
        through += bool(q[0] > 0.0)
    return through / samples


def mujoco_wall(
    thickness: float, radius: float, speed: float, dt: float, one_step: bool
) -> mujoco_kit.Runner:
    """A ball on a slide that flies at a wall, in MuJoCo.

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
    """Share of the phases in which MuJoCo's ball comes out on the far side of the wall.

    Args:
        thickness, radius, speed, dt, one_step: as for `mujoco_wall`.
        phases: where in a step the ball reaches the wall, numbers from 0 to 1.
    """
    runner = mujoco_wall(thickness, radius, speed, dt, one_step)
    touch = 0.5 * thickness + radius
    steps = 4 + math.ceil(5.0 * touch / (speed * dt)) + (0 if one_step else math.ceil(0.2 / dt))
    through = 0
    shares = np.asarray(phases, dtype=float)
    for phase in shares:
        runner.q0[0] = -touch - speed * dt * (1.0 + phase)
        q, _ = runner.run(steps)
        through += bool(q[0] > 0.0)
    return through / shares.size


# MuJoCo's default contact: solref = (0.02 s, 1), solimp = (0.9, 0.95, 1 mm).
_TIME_CONSTANT, _IMPEDANCE = 0.02, 0.95


def soft_contact_depth() -> float:
    """Depth that a ball sinks into MuJoCo's default contact, per unit of its speed [s].

    Beyond 1 mm the contact is r'' + d b r' + d k r = 0 with the impedance d = 0.95, b = 2 / (d T)
    and k = 1 / (d T)^2, T = 20 ms (MuJoCo documentation, Solver parameters). Its deepest point is
    v / w exp(-z acos(z) / sqrt(1 - z^2)), with w^2 = d k and 2 z w = d b.
    """
    omega = math.sqrt(_IMPEDANCE) / (_IMPEDANCE * _TIME_CONSTANT)
    zeta = 1.0 / (_TIME_CONSTANT * omega)
    return math.exp(-zeta * math.acos(zeta) / math.sqrt(1.0 - zeta**2)) / omega


def penetration_speed(
    thickness: float, radius: float, dt: float, one_step: bool, phases: int = 16
) -> float:
    """The speed above which MuJoCo's ball gets through the wall in some phase [m/s].

    Args:
        thickness, radius, dt, one_step: as for `mujoco_wall`.
        phases: how many to try, evenly spread from one sample on the surface to the next.
    """
    spread = np.linspace(0.001, 0.999, phases)
    touch = 0.5 * thickness + radius

    def stopped(speed: float) -> bool:
        return mujoco_through(thickness, radius, speed, dt, spread, one_step) == 0.0

    high = (2.0 if one_step else 1.2) * touch / (dt if one_step else soft_contact_depth())
    return limit(stopped, 0.2 * high, high, rel=5e-3)


@chart
def tunnelling() -> str:
    """Which balls pass a thin wall: a law for checks per step, another for soft contact."""
    import matplotlib.pyplot as plt

    rng = np.random.default_rng(2)
    ratios = np.array([0.5, 0.8, 0.95, 1.05, 1.25, 1.6, 2.0, 2.6, 3.5, 5.0, 7.0, 10.0])
    thickness, radius = 0.02, 0.01
    touch = 0.5 * thickness + radius
    checked = np.array([point_misses(r, 20_000, rng) for r in ratios])
    swept = np.array([swept_misses(r, 100, rng) for r in ratios])
    dt = 1e-3
    stiff = np.array(
        [
            mujoco_through(
                thickness, radius, r * touch / dt, dt, (np.arange(400) + rng.random()) / 400.0, True
            )
            for r in ratios
        ]
    )
    walls = ((0.02, 0.01), (0.005, 0.0025))
    steps = np.array([2e-4, 5e-4, 1e-3, 2e-3, 5e-3])
    soft = {wall: [penetration_speed(*wall, h, False) for h in steps] for wall in walls}
    hard = {wall: [penetration_speed(*wall, h, True) for h in steps] for wall in walls}

    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.8), layout="constrained")
    dense = np.geomspace(0.4, 11.0, 300)
    left.plot(
        dense, miss_probability(dense, 1.0), color="black", lw=1, label="theory: 1 - D / (v dt)"
    )
    left.plot(
        dense, miss_probability(dense, 2.0), "--", color=GREY, lw=1,
        label="MuJoCo if every overlap pushed back: D = d + 2r",
    )  # fmt: skip
    left.plot(ratios, checked, "o", color=BLUE, label="point, checked once a step: D = d")
    left.plot(
        ratios, stiff, "s", color=ORANGE, mfc="none", label="MuJoCo, one-step contact: D = d/2 + r"
    )
    left.plot(ratios, swept, "^", color=GREEN, label="impact as an event in the step")
    left.set_xscale("log")
    left.set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
    left.set(
        xlabel="travel per step over effective thickness, v dt / D",
        ylabel="share of balls that get through",
        title="Checks per step: one fast ball in two gets through at v dt = 2 D",
    )
    left.legend(fontsize="small", loc="upper left")
    for colour, wall in zip((BLUE, ORANGE), walls, strict=True):
        reach = 0.5 * wall[0] + wall[1]
        name = f"d/2 + r = {reach * 1e3:g} mm"
        right.loglog(steps * 1e3, soft[wall], "o", color=colour, label=f"default contact, {name}")
        right.axhline(reach / soft_contact_depth(), color=colour, lw=1)
        right.loglog(
            steps * 1e3,
            hard[wall],
            "s",
            color=colour,
            mfc="none",
            label=f"one-step contact, {name}",
        )
        right.loglog(steps * 1e3, reach / steps, "--", color=colour, lw=1)
    right.plot([], [], color="black", lw=1, label="theory: (d/2 + r) / 7.29 ms, no dt in it")
    right.plot([], [], "--", color="black", lw=1, label="theory: (d/2 + r) / dt")
    right.set(
        xlabel="step [ms]",
        ylabel="speed that gets through in some phase [m/s]",
        title="MuJoCo's default contact: a smaller step does not help",
    )
    right.set_xticks([0.2, 0.5, 1, 2, 5], ["0.2", "0.5", "1", "2", "5"])
    right.minorticks_off()
    right.set_ylim(top=1e3)
    right.grid(True, alpha=0.3)
    right.legend(fontsize="small", loc="upper right")
    left.grid(True, alpha=0.3)
    save(
        "tunnelling",
        figure,
        {
            "ratio": ratios.tolist(),
            "checked": checked.tolist(),
            "swept": swept.tolist(),
            "mujoco_one_step": stiff.tolist(),
            "dt": steps.tolist(),
            "soft": [soft[wall] for wall in walls],
            "one_step": [hard[wall] for wall in walls],
            "walls": walls,
        },
    )
    theory = miss_probability(ratios, 1.0)
    lines = [
        "checked once a step: worst deviation from 1 - d/(v dt) "
        f"{np.max(np.abs(checked - theory)):.3f} over 20000 phases",
        f"MuJoCo, one-step contact: worst deviation from 1 - (d/2 + r)/(v dt) "
        f"{np.max(np.abs(stiff - theory)):.3f} over 400 phases",
        f"impact as an event: {np.max(swept):.0%} get through",
        f"MuJoCo, default contact: sinks in by {soft_contact_depth() * 1e3:.2f} ms times the speed"
        " (theory)",
    ]
    for wall in walls:
        reach = 0.5 * wall[0] + wall[1]
        lines.append(
            f"  d/2 + r = {reach * 1e3:4.1f} mm: theory {reach / soft_contact_depth():.2f} m/s,"
            " measured "
            + ", ".join(
                f"{v:.2f} at {h * 1e3:g} ms" for h, v in zip(steps, soft[wall], strict=True)
            )
        )
        lines.append(
            "    one-step contact: speed times dt over (d/2 + r) "
            + ", ".join(f"{v * h / reach:.2f}" for h, v in zip(steps, hard[wall], strict=True))
        )
    return "\n".join(lines)


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
    """A box dropped on its corner, 5 s later: impacts and speeds over `duration` seconds.

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
    state, _ = planar.rollout(state, box, dt, round(5.0 / dt), **options)
    steps = round(duration / dt)
    v = np.empty((3, steps))
    impacts = unresolved = 0
    for i in range(steps):
        state, counts = planar.rollout(state, box, dt, 1, **options)
        v[:, i] = state[3:, 0]
        impacts += int(counts[0, 0])
        unresolved += int(counts[1, 0])
    where = "in the step" if resolve_impacts else "end of step"
    name = f"{integrator}, {where}, rest speed {rest_speed:g}"
    return Rest(name, impacts / duration, _noise(v), unresolved / steps)


def mujoco_box_at_rest(
    integrator: str, contact: str, duration: float = 10.0, dt: float = 2e-3
) -> Rest:
    """The same box in MuJoCo; an impact is a corner passing the ground downwards.

    Args:
        integrator: MuJoCo's name of it.
        contact: "impulse" or "spring", see `course.oracles.mujoco.box.box_drop`.
        duration: recorded time [s].
        dt: step [s].
    """
    runner = mujoco_box.box_drop(
        (0.5 * _BOX[0], 0.5 * _BOX[1]), 1.0, [0.0, 0.3, 0.3], [0.0, 0.0, 0.0], dt, integrator,
        restitution=0.7, friction=0.5, gravity=problems.STANDARD_GRAVITY, contact=contact,
    )  # fmt: skip
    path = runner.samples(round((5.0 + duration) / dt))
    after = path.times > 5.0
    q, v = path.q[:, after], path.v[:, after]
    impacts = 0
    for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        corner = q[1] + 0.5 * (a * _BOX[0] * np.sin(q[2]) + b * _BOX[1] * np.cos(q[2]))
        impacts += int(np.sum((corner[:-1] > 0.0) & (corner[1:] <= 0.0)))
    return Rest(f"MuJoCo {integrator}, {contact}", impacts / duration, _noise(v))


def boxes_at_rest(duration: float = 10.0) -> list[Rest]:
    """Who lies still: ours with and without a rest speed, beside MuJoCo.

    Args:
        duration: recorded time [s].
    """
    return [
        our_box_at_rest(0.0, duration=duration),
        our_box_at_rest(0.0, integrator="velocity_verlet", duration=duration),
        our_box_at_rest(0.01, duration=duration),
        our_box_at_rest(0.0, False, duration=duration),
        our_box_at_rest(0.01, False, duration=duration),
        mujoco_box_at_rest("Euler", "impulse", duration),
        mujoco_box_at_rest("Euler", "spring", duration),
        mujoco_box_at_rest("discrete", "spring", duration),
    ]


def zeno_end(
    height: float, restitution: float, gravity: float = problems.STANDARD_GRAVITY
) -> float:
    """When the last of infinitely many bounces is over: sqrt(2 h / g) (1 + e) / (1 - e) [s]."""
    return math.sqrt(2.0 * height / gravity) * (1.0 + restitution) / (1.0 - restitution)


def zeno_counts(
    times: Array, height: float = 1.0, restitution: float = 0.7, rest_speed: float = 0.0
) -> Array:
    """Impacts of a flat box, dropped from rest, until each of the times, found as events.

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
    for t in times:
        _, found = planar.rollout(
            start, box, float(t), 1, integrator="velocity_verlet", max_events=1000
        )
        counts.append(int(found[0, 0]))
    return np.array(counts)


@chart
def chatter() -> str:
    """A box that should lie still, and a ball that bounces infinitely often."""
    import matplotlib.pyplot as plt

    rows = boxes_at_rest()
    height, restitution = 1.0, 0.7
    end = zeno_end(height, restitution)
    to_go = np.geomspace(1.0, 1e-6, 121)
    theory = np.searchsorted(problems.bounce_times(height, restitution, 200), end - to_go)
    ours = zeno_counts(end - to_go, height, restitution)
    cut = zeno_counts(end - to_go, height, restitution, 0.01)
    total = zeno_counts(np.array([end + 1.0]), height, restitution)[0]
    total_cut = zeno_counts(np.array([end + 1.0]), height, restitution, 0.01)[0]

    figure = plt.figure(figsize=(13, 4.8), layout="constrained")
    one, two, three = figure.subplots(1, 3, width_ratios=[1.0, 1.0, 1.3])
    figure.suptitle(
        "Springs, impacts at the end of the step, and semi-implicit flight without a rest speed: "
        "all three chatter"
    )
    labels = [
        row.name.replace("_", "-")
        .replace("-euler", "")
        .replace("-verlet", " Verlet")
        .replace(", rest", ",\nrest")
        for row in rows
    ]
    labels = [label + " m/s" if "rest speed" in label else label for label in labels]
    y = np.arange(len(rows))[::-1]
    colours = [ORANGE if "MuJoCo" in row.name else BLUE for row in rows]
    for ax, values, floor, unit in (
        (one, [row.impacts_per_second for row in rows], 1.0, "impacts per second"),
        (two, [row.noise * 1e3 for row in rows], 1e-4, "rms speed [mm/s]"),
    ):
        ax.barh(y, [max(v, floor) if v > 0.0 else 0.0 for v in values], color=colours, height=0.6)
        ax.set_xscale("log")
        ax.set_xlim(floor, 30.0 * max(values))
        for position, value in zip(y, values, strict=True):
            ax.text(
                max(value, floor) * 1.3, position, f"{value:.3g}", va="center", fontsize="small"
            )
        ax.set_yticks(y, labels if ax is one else [""] * len(y), fontsize="small")
        ax.set_xlabel(unit)
    one.set_title("Impacts of a box that should lie still")
    two.set_title("Its speed")
    three.step(
        to_go, theory, where="post", color="black", lw=1, label="theory: ln(time left) / ln(e)"
    )
    three.plot(
        to_go[::4], ours[::4], "o", color=BLUE, ms=4, label="rest speed 0: every impact an event"
    )
    three.plot(to_go[::4], cut[::4], "x", color=ORANGE, label="rest speed 0.01 m/s")
    three.set_xscale("log")
    three.invert_xaxis()
    three.set(
        xlabel="time left to the end of the bouncing [s]",
        ylabel="impacts so far",
        title="Infinitely many bounces in a finite time",
    )
    three.grid(True, alpha=0.3)
    three.legend(fontsize="small", loc="upper left")
    save(
        "chatter",
        figure,
        {
            "rest": [vars(row) for row in rows],
            "zeno": {
                "time_left": to_go.tolist(),
                "theory": theory.tolist(),
                "rest_speed_0": ours.tolist(),
                "rest_speed_0.01": cut.tolist(),
            },
        },
    )
    lines = [
        f"{row.name:<56} {row.impacts_per_second:>8.1f} impacts/s {row.noise * 1e3:>10.4f} mm/s rms"
        + (f"  ({row.unresolved:.0%} of the steps gave up)" if row.unresolved else "")
        for row in rows
    ]
    lines.append(
        f"bouncing ball, e = {restitution}: all bounces over at {end:.4f} s; "
        f"{np.max(np.abs(ours - theory))} impacts off the theory until 1 us before the end; "
        f"past it {total} with rest speed 0 (stopped by its limit of 1000), "
        f"{total_cut} with 0.01 m/s"
    )
    return "\n".join(lines)
