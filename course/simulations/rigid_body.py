"""Chapter 1's simulation: a box falls, tumbles and bounces, and its energy is watched.

The physics is that of `course.rigid_body.planar`; here is what can be set, how a state becomes a
picture and numbers, and the presets that show one failure each.
"""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.rigid_body.integrators import INTEGRATORS, STANDARD_GRAVITY
from course.rigid_body.planar import FLIGHT_COEFFICIENT, PARAMETERS, box_parameters, prepare
from course.rigid_body.planar_contact import flight
from course.simulations.canvas import (
    BLUE,
    FAINT,
    GREEN,
    GREY,
    INK,
    ORANGE,
    RED,
    Arrow,
    Axes,
    Disc,
    Frame,
    Item,
    Line,
    Pointer,
    Polygon,
    Text,
)
from course.simulations.panel import Model, Panel, Preset, Slider

Array = NDArray[np.float64]

MASS, WIDTH, HEIGHT = 1.0, 0.6, 0.4  # of the box [kg, m, m]

SLIDERS = {
    "gravity": Slider("Gravity", 0.0, 20.0, 0.1, "m/s²", ".1f"),
    "restitution": Slider("Restitution", 0.0, 1.0, 0.01),
    "timestep": Slider("Timestep", 0.5, 50.0, 0.5, "ms", ".1f"),
    "friction": Slider("Friction", 0.0, 2.0, 0.05),
    "rest_speed": Slider("Rest speed", 0.0, 0.2, 0.01, "m/s"),
}
MENU = {INTEGRATORS[name].label: name for name in FLIGHT_COEFFICIENT}

TUMBLING = (0.0, 2.5, -0.35, -0.5, 0.0, 1.0)
FLAT = (0.0, 2.5, 0.0, 0.5, 0.0, 0.0)

_PREVIEW = 3.0  # how much of the motion ahead is drawn [s]
_SAMPLE = 0.01  # time between two points of a path; at least one step [s]
_MEMORY = 10.0  # how much of the energy's past is shown [s]
_REFERENCE_STEP = 0.5  # [ms]


@dataclass(frozen=True)
class Controls:
    """What can be set.

    Attributes:
        gravity: downwards [m/s^2].
        restitution: of an impact, 0 to 1.
        timestep: of the integration [ms].
        friction: Coulomb coefficient of the ground.
        rest_speed: an impact slower than this does not bounce [m/s].
        integrator: a key of `FLIGHT_COEFFICIENT`.
        resolve_impacts: find impacts within a step; else contact is noticed at its end.
        start: x, y, angle, vx, vy, omega [m, rad, m/s, rad/s].
    """

    gravity: float = round(STANDARD_GRAVITY, 1)  # a value of the slider
    restitution: float = 0.70
    timestep: float = 2.0
    friction: float = 0.5
    rest_speed: float = 0.01
    integrator: str = "semi_implicit_euler"
    resolve_impacts: bool = True
    start: tuple[float, float, float, float, float, float] = TUMBLING

    def __post_init__(self) -> None:
        for name, slider in SLIDERS.items():
            slider.check(name, getattr(self, name))
        if self.integrator not in FLIGHT_COEFFICIENT:
            raise ValueError(
                f"integrator is {self.integrator!r}, allowed is {list(FLIGHT_COEFFICIENT)}"
            )
        if len(self.start) != 6 or not np.isfinite(self.start).all():
            raise ValueError(f"start is {self.start}, allowed are 6 finite numbers")
        if _lowest(self.start[1], self.start[2]) < -1e-9:
            raise ValueError(f"start is {self.start}, allowed is a box above the ground y = 0")


@dataclass(frozen=True, eq=False)
class State:
    """Where the experiment stands.

    Attributes:
        box: x, y, angle, vx, vy, omega, (6,).
        steps: made so far.
        impacts: so far.
        unresolved: steps with more impacts than are followed within one step.
        deepest: how far below the ground a corner was found at the end of a step [m].
        peak: greatest height of the centre so far [m].
        energy: total energy at the start [J].
        owed: time that is less than a step and was not yet made [s].
        history: time, kinetic, potential, total energy, (4, M), of the last ten seconds.
    """

    box: Array
    energy: float
    peak: float
    history: Array
    steps: int = 0
    impacts: int = 0
    unresolved: int = 0
    deepest: float = 0.0
    owed: float = field(default=0.0)


def _lowest(y: float, angle: float) -> float:
    """Height of the lowest corner [m]."""
    return y - 0.5 * (WIDTH * abs(math.sin(angle)) + HEIGHT * abs(math.cos(angle)))


def _corners(box: Array) -> Array:
    a = 0.5 * WIDTH * np.array([-1.0, 1.0, 1.0, -1.0])
    b = 0.5 * HEIGHT * np.array([-1.0, -1.0, 1.0, 1.0])
    s, c = np.sin(box[2]), np.cos(box[2])
    return np.array([box[0] + c * a - s * b, box[1] + s * a + c * b])


@lru_cache(maxsize=32)
def _parameters(restitution: float, friction: float, rest_speed: float) -> Array:
    return box_parameters(
        MASS, WIDTH, HEIGHT, restitution=restitution, friction=friction, rest_speed=rest_speed
    )


_INERTIA = float(_parameters(0.0, 0.0, 0.0)[PARAMETERS.index("inertia"), 0])


def energies(box: Array, gravity: float) -> Array:
    """Kinetic, potential and total energy [J] of states (6,) or (6, M)."""
    kinetic = 0.5 * MASS * (box[3] ** 2 + box[4] ** 2) + 0.5 * _INERTIA * box[5] ** 2
    potential = MASS * gravity * box[1]
    return np.array([kinetic, potential, kinetic + potential])


def initial(controls: Controls) -> State:
    """The state at time zero."""
    box = np.array(controls.start)
    energy = energies(box, controls.gravity)
    return State(
        box=box, energy=float(energy[2]), peak=float(box[1]),
        history=np.concatenate([[0.0], energy]).reshape(4, 1),
    )  # fmt: skip


def advance(state: State, controls: Controls, seconds: float) -> State:
    """The state after as many whole steps as fit into the time; the rest is owed.

    Args:
        state: where to start from; it is left as it is.
        controls: the settings.
        seconds: simulated time, not negative [s].

    Raises:
        ValueError: seconds is negative or not finite.
    """
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise ValueError(f"seconds is {seconds}, allowed is a number that is not negative")
    dt = 1e-3 * controls.timestep
    parameters = _parameters(controls.restitution, controls.friction, controls.rest_speed)
    coefficient = FLIGHT_COEFFICIENT[controls.integrator]
    count = math.floor((state.owed + seconds) / dt + 1e-9)
    owed = max(state.owed + seconds - count * dt, 0.0)
    per_sample = max(1, round(_SAMPLE / dt))
    box, deepest, peak = state.box, state.deepest, state.peak
    impacts, unresolved, steps = state.impacts, state.unresolved, state.steps
    samples: list[Any] = []
    run = prepare(
        1, parameters, dt,
        gravity=controls.gravity, integrator=controls.integrator,
        resolve_impacts=controls.resolve_impacts,
    )  # fmt: skip
    end = steps + count
    while steps < end:
        many = min(per_sample - steps % per_sample, end - steps)
        if not controls.resolve_impacts:
            reach = many * dt * (abs(box[4]) + many * dt * controls.gravity)
            if box[1] - reach < 0.5 * math.hypot(WIDTH, HEIGHT):
                many = 1  # step by step, to see how deep it gets before it is pushed out
                y = flight(box[1], box[4], -controls.gravity, dt, coefficient)
                deepest = max(deepest, -_lowest(y, box[2] + dt * box[5]))
        new, counts = run(np.ascontiguousarray(box).reshape(6, 1), many)
        box = new[:, 0]
        impacts += int(counts[0, 0])
        unresolved += int(counts[1, 0])
        peak = max(peak, float(box[1]))
        steps += many
        if steps % per_sample == 0:
            samples.append((steps * dt, *energies(box, controls.gravity)))
    history = state.history
    if samples:
        history = np.hstack([history, np.array(samples).T])
        history = history[:, history[0] >= history[0, -1] - _MEMORY - 1e-9]
    return State(
        box=box, energy=state.energy, peak=peak, history=history, steps=steps, impacts=impacts,
        unresolved=unresolved, deepest=deepest, owed=owed,
    )  # fmt: skip


@lru_cache(maxsize=16)
def preview(controls: Controls, seconds: float = _PREVIEW) -> Array:
    """The motion from the start: rows time, x, y, angle, total energy, (5, M)."""
    dt = 1e-3 * controls.timestep
    parameters = _parameters(controls.restitution, controls.friction, controls.rest_speed)
    many = max(1, round(_SAMPLE / dt))
    box = np.array(controls.start).reshape(6, 1)
    run = prepare(
        1, parameters, dt,
        gravity=controls.gravity, integrator=controls.integrator,
        resolve_impacts=controls.resolve_impacts,
    )  # fmt: skip
    steps = 0
    times, boxes = [0.0], [box]
    while steps < max(1, math.floor(seconds / dt + 1e-9)):
        # In flight, clear of the ground, a smooth curve needs fewer points.
        leap = 4 * many * dt
        fall = leap * (max(-box[4, 0], 0.0) + leap * controls.gravity)
        count = 4 * many if box[1, 0] - fall > 0.5 * math.hypot(WIDTH, HEIGHT) else many
        box, _ = run(box, count)
        steps += count
        times.append(steps * dt)
        boxes.append(box)
    states = np.hstack(boxes)
    path = np.vstack([times, states[:3], energies(states, controls.gravity)[2]])
    path.setflags(write=False)
    return path


def reference(controls: Controls) -> Array:
    """The same drop computed well: exact flight, impacts found in time, short steps."""
    return preview(
        replace(
            controls, integrator="velocity_verlet", resolve_impacts=True,
            timestep=_REFERENCE_STEP, rest_speed=min(controls.rest_speed, 0.01) or 0.01,
        )
    )  # fmt: skip


def _signed(value: float, decimals: int, unit: str) -> str:
    rounded = round(value, decimals) + 0.0  # no minus zero
    return f"{rounded:+.{decimals}f} {unit}".replace("-", "\N{MINUS SIGN}")


def numbers(state: State, controls: Controls) -> dict[str, str]:
    """What is printed beside the picture."""
    kinetic, potential, total = energies(state.box, controls.gravity)
    change = total - state.energy
    relative = "\N{EN DASH}"
    if state.energy > 1e-9:
        relative = _signed(100.0 * change / state.energy, 2, "%")
    return {
        "time": f"{state.steps * 1e-3 * controls.timestep:.3f} s",
        "kinetic": f"{kinetic:.3f} J",
        "potential": f"{potential:.3f} J",
        "total": f"{total:.3f} J",
        "energy change": relative,
        "height": f"{state.box[1]:.3f} m",
        "highest so far": f"{state.peak:.3f} m",
        "impacts": f"{state.impacts}",
        "steps not resolved": f"{state.unresolved}",
        "deepest in ground": f"{1e3 * state.deepest:.1f} mm",
    }


_WINDOW = (0.0, 9.0, 0.0, 5.0)  # in units of its own, not metres
_SCENE = (0.62, 5.42, 0.62, 4.62)
_METRES = 0.8  # per unit of the window, before zooming out


def scene_axes(state: State, controls: Controls) -> Axes:
    """Where the world is in the picture: zooms out in powers of two, follows the box sideways."""
    wide = _METRES * (_SCENE[1] - _SCENE[0])
    high = _METRES * (_SCENE[3] - _SCENE[2])
    top = max(state.peak, float(preview(controls)[2].max())) + 0.5 * math.hypot(WIDTH, HEIGHT)
    zoom = 2.0 ** max(0, math.ceil(math.log2(top / (high - 0.25))))
    wide, high = zoom * wide, zoom * high
    x = float(state.box[0])
    left = min(max(-0.25 * wide, x - 0.85 * wide), x - 0.15 * wide)
    return Axes(
        _SCENE, (left, left + wide), (-0.2 * zoom, high - 0.2 * zoom), "x [m]", "height [m]",
    )  # fmt: skip


def _inside(axes: Axes, points: Array) -> Array:
    """Points (2, N) of the world in the window, with a gap for those outside of the axes."""
    (x0, x1), (y0, y1) = axes.x_values, axes.y_values
    x, y = points
    outside = (x < x0) | (x > x1) | (y < y0) | (y > y1)
    return np.where(outside, np.nan, axes.place(points, clip=False))


def _scene(state: State, controls: Controls) -> list[Item]:
    axes = scene_axes(state, controls)
    path, good = preview(controls), reference(controls)
    left, right = axes.x_values
    ground = axes.place([[left, right, right, left], [0.0, 0.0, -1e9, -1e9]])
    items: list[Item] = [
        Polygon(ground, "#ece7df"),
        axes,
        Line(axes.place([[left, right], [0.0, 0.0]]), "#8c7a5c", 2.0),
        Line(_inside(axes, good[1:3]), INK, 1.4, (5.0, 4.0), 0.75),
        Line(_inside(axes, path[1:3]), BLUE, 2.0, alpha=0.55),
    ]
    for k in np.unique(np.searchsorted(path[0], np.arange(0.25, _PREVIEW, 0.25))):
        ghost = _inside(axes, _corners(path[1:, k]))
        if np.isfinite(ghost).all():
            items.append(Polygon(ghost, "", BLUE, 1.0, alpha=0.22))
    corners = axes.place(_corners(state.box), clip=False)
    centre = axes.place(state.box[:2], clip=False)
    items += [
        Polygon(corners, "#f4b183", ORANGE, 2.0, alpha=0.95),
        Line(np.stack([centre, 0.5 * (corners[:, 1] + corners[:, 2])], axis=1), ORANGE, 1.5),
        Disc(centre, 0.035, ORANGE),
    ]
    tip = axes.place(state.box[:2] + 0.12 * state.box[3:5], clip=True)
    if np.linalg.norm(tip - centre) > 0.15:
        items.append(Arrow(centre, tip, INK, 1.8))
    x, y = _SCENE[1] - 2.55, _SCENE[3] - 0.12
    for words, colour, dash, low in (
        ("path with these settings, 3 s", BLUE, (), 0.0),
        ("the same box computed finely", INK, (5.0, 4.0), 0.2),
    ):
        sample = np.array([[x, x + 0.3], [y - low, y - low]])
        items += [
            Line(sample, colour, 2.0, dash, 0.7),
            Text(np.array([x + 0.38, y - low]), words, INK, 11.5),
        ]
    title = f"{INTEGRATORS[controls.integrator].label}, {controls.timestep:g} ms"
    title += ", impacts found in time" if controls.resolve_impacts else ", impacts noticed late"
    items.append(Text(np.array([_SCENE[0], _SCENE[3]]), title, INK, 13.0, "left", "bottom",
                      (0.0, 8.0), bold=True))  # fmt: skip
    return items


def _bars(state: State, controls: Controls, top: float) -> list[Item]:
    axes = Axes((6.4, 8.82, 2.98, 4.62), (0.0, 3.0), (0.0, top), "", "energy [J]",
                x_ticks=0, y_ticks=4)  # fmt: skip
    items: list[Item] = [
        Text(np.array([6.4, 4.62]), "energy now", INK, 13.0, "left", "bottom", (0.0, 8.0),
             bold=True),
        axes,
    ]  # fmt: skip
    for k, (words, value, colour) in enumerate(
        zip(_ENERGIES, energies(state.box, controls.gravity), _COLOURS, strict=True)
    ):
        sides = [k + 0.2, k + 0.8, k + 0.8, k + 0.2]
        items.append(Polygon(axes.place([sides, [0.0, 0.0, value, value]]), colour))
        items.append(Text(axes.place((k + 0.5, 0.0)), words, INK, 12.0, "center", "top",
                          (0.0, -5.0)))  # fmt: skip
        items.append(Text(axes.place((k + 0.5, value)), f"{value:.1f}", INK, 12.0, "center",
                          "bottom", (0.0, 2.0)))  # fmt: skip
    start = axes.place([[0.0, 3.0], [state.energy, state.energy]])
    items.append(Line(start, GREY, 1.2, (2.0, 3.0)))
    items.append(Text(axes.place((0.0, state.energy)), "at start", GREY, 11.0, "left", "bottom",
                      (3.0, 2.0)))  # fmt: skip
    return items


def _strip(state: State, controls: Controls, top: float) -> list[Item]:
    now = state.history[0, -1]
    begin = max(0.0, now - _MEMORY)
    axes = Axes((6.4, 8.82, 0.62, 2.22), (begin, begin + _MEMORY), (0.0, top), "time [s]",
                "energy [J]", "energy over time", y_ticks=4)  # fmt: skip
    start = axes.place([[begin, begin + _MEMORY], [state.energy, state.energy]])
    items: list[Item] = [axes, Line(start, GREY, 1.2, (2.0, 3.0))]
    path = preview(controls)
    ahead = path[:, path[0] >= begin]
    if ahead.shape[1] > 1:
        items.append(Line(axes.place(ahead[[0, 4]]), GREEN, 2.0, alpha=0.3))
    for row, colour in enumerate(_COLOURS, start=1):
        width = 2.2 if row == 3 else 1.2
        items.append(Line(axes.place(state.history[[0, row]]), colour, width))
    return items


_ENERGIES = ("kinetic", "potential", "total")
_COLOURS = (RED, BLUE, GREEN)


def frame(state: State, controls: Controls) -> Frame:
    """The picture: the box in its world, its energy as bars and over time."""
    highest = max(state.energy, float(state.history[3].max()), float(preview(controls)[4].max()))
    top = 1.18 * highest if highest > 1e-9 else 1.0
    return Frame(
        _WINDOW,
        (
            *_scene(state, controls),
            *_bars(state, controls, top),
            *_strip(state, controls, top),
            Line(np.array([[5.72, 5.72], [0.2, 4.85]]), FAINT, 1.0),
        ),
        width=760.0,
        label=TITLE,
        numbers=numbers(state, controls),
    )


def drag(controls: Controls, state: State, pointer: Pointer) -> Controls:
    """The controls with the box put where the pointer is; it stays above the ground."""
    x, y = scene_axes(state, controls).values((pointer.x, pointer.y))
    y = max(float(y), 0.5 * math.hypot(WIDTH, HEIGHT))
    return replace(controls, start=(float(x), min(y, 50.0), *controls.start[2:]))


TITLE = "Rigid body simulator: bouncing box"
_ELASTIC = Controls(restitution=1.0, friction=0.0, timestep=20.0)

PRESETS = {
    "Default drop": Preset(
        Controls(),
        "Every bounce takes energy, and the box comes to rest. Drag the box to drop it from "
        "somewhere else. The dashed path is the same box computed with exact flight and short "
        "steps: after a few tumbling bounces the smallest error sends it elsewhere.",
    ),
    "Explicit Euler gains energy": Preset(
        replace(_ELASTIC, integrator="explicit_euler"),
        "Nothing takes or gives energy here, and impacts are found in time. Still every step of "
        "flight adds m g² h²/2: the box bounces higher and higher.",
    ),
    "Semi-implicit Euler loses energy": Preset(
        replace(_ELASTIC, integrator="semi_implicit_euler"),
        "The same drop with the order of two lines swapped. In flight the same m g² h²/2 is now "
        "taken at every step. Symplectic keeps the energy of a smooth oscillator near its start; "
        "it promises nothing about a constant force and bounces.",
    ),
    "Exact flight, late impacts": Preset(
        replace(_ELASTIC, integrator="rk4", resolve_impacts=False),
        "Fourth order and exact in flight. But an impact is noticed only at the end of a step, "
        "and pushing the box out of the ground lifts it: energy jumps up at bounces. A better "
        "integrator does not help, finding the impact time does.",
    ),
    "50 ms steps: deep in the ground": Preset(
        Controls(timestep=50.0, resolve_impacts=False, start=FLAT),
        "At the end of a step the box is found far inside the ground, then it is pushed out. "
        "A floor thinner than speed times step would have been missed: tunnelling.",
    ),
    "Late impacts: never at rest": Preset(
        Controls(timestep=20.0, resolve_impacts=False),
        "Lying on the ground the box falls g h in every step, is found below the ground and "
        "bounces. Impacts go on for ever and it trembles instead of resting.",
    ),
    "No rest speed: endless impacts": Preset(
        Controls(rest_speed=0.0),
        "Each bounce is a fixed share shorter than the last, so infinitely many fit into a "
        "finite time. Without a speed below which nothing bounces, steps run out of the impacts "
        "that are allowed in one step (not resolved).",
    ),
}

MODEL = Model(
    title=TITLE,
    controls=Controls(),
    sliders=SLIDERS,
    menus={"integrator": ("Integrator", MENU)},
    switches={"resolve_impacts": "find impact times within the step"},
    presets=PRESETS,
    initial=initial,
    advance=advance,
    frame=frame,
    drag=drag,
)


def simulation() -> Panel:
    """The simulation as a widget for a notebook; it starts paused."""
    return Panel(MODEL)
