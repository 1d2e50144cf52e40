"""Measures: one number with a unit from one run, the same formula for every engine.

Time is not taken here: `course.measure.timing` is handed `run.run`, interleaved over engines.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from course import kinematics
from course.check import POSITIVE, count, invalid, positive, vector
from course.contact import Residuals, residuals
from course.platforms import theory
from course.platforms.bodies import free_velocity, step_of
from course.platforms.contract import AS_SHIPPED, FAIR, Engine, Settings, State, prepared
from course.platforms.scenes import GRAVITY, Scene, arm, brake, grasp


def position_error(engine: Engine, scene: Scene, dt: float, settings: Settings = FAIR) -> float:
    """Return `Scene.error` at the end of the motion [m or rad]."""
    run = prepared(engine, scene, dt, settings)
    try:
        # Whole steps; the truth is taken at the time that was really reached.
        steps = max(1, round(scene.duration / dt))
        run.run(steps)
        return scene.error(run.state(), steps * dt)
    finally:
        run.close()


@dataclass(frozen=True)
class PathError:
    """The error of a whole motion.

    Attributes:
        final: `Scene.error` at the end [m or rad].
        largest: the largest error at any of the times that were looked at, height included.
        airborne: share of the steps in which some free body had no contact that pushes; 0 in
            scenes without contact. A body that is dropped is in the air for a share of its own.
    """

    final: float
    largest: float
    airborne: float


def path_error(
    engine: Engine,
    scene: Scene,
    dt: float,
    settings: Settings = FAIR,
    samples: int = 20,
    moving: float = math.inf,
) -> PathError:
    """Return the errors along the motion, not only at its end.

    A block that hops stops where it should: the impulses are right in the sum, and the error at the
    end does not see the hops.

    Args:
        engine: the simulator that runs the scene.
        scene: the scene.
        dt: step [s].
        settings: of the simulator.
        samples: equal times at which a scene without contact is compared with its truth; with
            contact it is compared after each step.
        moving: time [s] up to which steps count for `airborne`, such as until a block should rest.
    """
    free = [i for i, body in enumerate(scene.bodies) if body.half and not body.guide]
    steps = max(1, round(scene.duration / dt))
    # Hops last for single steps, so scenes with contact are looked at after each.
    every = 1 if free else max(1, steps // count("samples", samples, 1))
    run, largest, airborne, taken = prepared(engine, scene, dt, settings), 0.0, 0, 0
    counted = steps if math.isinf(moving) else count("moving / dt", round(moving / dt), 1, steps)
    try:
        while taken < steps:
            run.run(min(every, steps - taken))
            taken = min(taken + every, steps)
            final = scene.error(run.state(), taken * dt)
            largest = max(largest, final)
            if free and taken <= counted:
                # A body is airborne if no contact presses on it.
                report = run.contacts()
                held = report.bodies[:, report.normal_force > 0.0]
                airborne += not all(np.any(held == i) for i in free)
    finally:
        run.close()
    return PathError(final, largest, airborne / counted)


def slope(x: ArrayLike, y: ArrayLike) -> float:
    """Return the exponent p of y = c x^p, by least squares in logarithms.

    The order of a scheme for steps and errors; how a cost grows for sizes and costs.
    """
    x, y = (vector(name, value, (None,), low=POSITIVE) for name, value in (("x", x), ("y", y)))
    if x.size != y.size or x.size < 2:
        raise invalid("(x.size, y.size)", (x.size, y.size), "two equal sizes of at least 2")
    # A power law is a straight line in log-log axes, and its exponent the slope.
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


@dataclass(frozen=True)
class Drift:
    """Energy of a motion that conserves it: a straight line, and what goes to and fro about it.

    Attributes:
        rate: slope of the line [J/s]; a swing biases it a little, even over whole periods.
        swing: largest distance from the line [J].
        change: end less start [J].
    """

    rate: float
    swing: float
    change: float


def energy_drift(
    engine: Engine, scene: Scene, dt: float, settings: Settings = FAIR, samples: int = 100
) -> Drift:
    """Return drift and oscillation of the energy that the engine reports at equal times."""
    run = prepared(engine, scene, dt, settings)
    # A whole number of steps between samples, so that they are equally spaced.
    every = max(1, round(scene.duration / dt / count("samples", samples, 2)))
    energies = [run.energy()]
    for _ in range(samples):
        run.run(every)
        energies.append(run.energy())
    run.close()
    times, result = np.arange(samples + 1) * every * dt, np.array(energies)
    # A straight line is the drift; the deviation from it is the oscillation of a symplectic method.
    rate, start = np.polyfit(times, result, 1)
    swing = np.max(np.abs(result - start - rate * times))
    return Drift(float(rate), float(swing), float(result[-1] - result[0]))


@dataclass(frozen=True)
class Judged:
    """Chapter 2's residuals of what an engine reports.

    Attributes:
        residuals: penetration, complementarity (signorini), cone, dissipation, energy.
        unexplained: how far the reported forces miss the velocities that the engine reached [m/s].
        contacts: how many.
    """

    residuals: Residuals
    unexplained: float
    contacts: int


def judged(
    engine: Engine, scene: Scene, dt: float, steps: int, settings: Settings = FAIR
) -> Judged:
    """Return the contacts of the last of `steps` steps, judged as one step of chapter 2.

    Raises:
        ValueError: where nothing touches in that step.
    """
    run = prepared(engine, scene, dt, settings)
    # All steps but the last: the judged one needs the state before it.
    run.run(count("steps", steps, 1) - 1)
    before = run.state()
    run.run(1)
    after, report = run.state(), run.contacts()
    run.close()
    if not report.gap.size:
        raise invalid("steps", steps, "a number after which something touches")
    # Recompute the step with chapter 2's equations and compare its velocities with the engine's.
    step = step_of(scene, before, free_velocity(scene, before, dt), report, dt)
    impulses = step.impulses(report.force)
    reached = step.spread(step.problem.after(impulses))
    return Judged(
        residuals(step.problem, impulses),
        float(np.max(np.abs(reached - after.v)[:3])),
        int(report.gap.size),
    )


def creep(engine: Engine, scene: Scene, dt: float, settings: Settings = FAIR) -> float:
    """Return how fast the first body, which should rest, moves [m/s].

    The speed is averaged over the second half of the run.
    """
    run = prepared(engine, scene, dt, settings)
    half = max(1, round(0.5 * scene.duration / dt))
    # The first half lets the contact settle into its steady creep.
    run.run(half)
    first = run.state().q[:3, 0]
    run.run(half)
    last = run.state().q[:3, 0]
    run.close()
    return float(np.linalg.norm(last - first) / (half * dt))


def largest_step(
    engine: Engine, scene: Scene, steps: Iterable[float], settings: Settings = FAIR
) -> float:
    """Return the largest step [s] up to which every tried step meets the tolerance, or 0."""
    best = 0.0
    for dt in sorted(steps):
        # The first step that fails ends the search, even if a larger one would pass by luck.
        if position_error(engine, scene, dt, settings) > scene.tolerance:
            break
        best = dt
    return best


@dataclass(frozen=True)
class Repeat:
    """Largest difference of any number of the state between two runs that should be equal.

    Attributes:
        fresh: two worlds built alike.
        reset: the same world, put back to its start.
        saved: the second half, from a state that was saved and put back.
    """

    fresh: float
    reset: float
    saved: float


def repeatability(
    engine: Engine, scene: Scene, dt: float, steps: int, settings: Settings = FAIR
) -> Repeat:
    """Return by how much repeated runs differ: 0 where all bits are equal."""
    first, second = (engine.build(scene, dt, settings) for _ in range(2))
    half = count("steps", steps, 2) // 2
    # The same half run three times: continued, from the saved state, and from a new build.
    first.run(half)
    saved = first.save()
    first.run(half)
    end = first.state()
    first.restore(saved)
    first.run(half)
    again = first.state()
    second.run(2 * half)
    fresh = second.state()
    first.reset()
    first.run(2 * half)
    # The world is reset after it has been used: leftovers of the first run would show.
    reset = first.state()
    first.close()
    second.close()
    return Repeat(*(_difference(end, other) for other in (fresh, reset, again)))


def _difference(a: State, b: State) -> float:
    # Equality of all bits first; a NaN equal to itself has no distance.
    if a.same(b):
        return 0.0
    return float(max(np.max(np.abs(a.q - b.q)), np.max(np.abs(a.v - b.v))))


@dataclass(frozen=True)
class Stop:
    """Where a block came to rest: the distance [m], and its direction less its heading [rad]."""

    distance: float
    turn: float


def stop(
    engine: Engine,
    heading: float,
    dt: float,
    settings: Settings = FAIR,
    speed: float = 2.0,
    friction: float = 0.5,
) -> Stop:
    """Return the braking block, to be set beside `theory.stop` and `theory.braking_distance`."""
    scene = brake(heading, speed, friction)
    run = prepared(engine, scene, dt, settings)
    start = run.state().q[:2, 0]
    run.run(round(scene.duration / dt))
    x, y = run.state().q[:2, 0] - start
    run.close()
    # The difference of two angles, wrapped to -pi to pi.
    turn = (math.atan2(y, x) - heading + math.pi) % (2.0 * math.pi) - math.pi
    return Stop(math.hypot(x, y), turn)


def squeezed(
    engine: Engine, ratio: float, dt: float, settings: Settings = FAIR, friction: float = 0.5
) -> tuple[bool, float]:
    """Return whether two fingers hold the part, and how far it sinks [m].

    They press with a share of the force m g / (2 mu) that friction needs.

    What slips is fast and gains speed: over 0.02 m/s in the last third of 0.5 s, and 0.005 g over
    the last two. What creeps moves evenly, and a part that turns about a corner comes to rest:
    both are held. Where an engine puts the force on one corner this is no threshold but a scatter:
    scan it.
    """
    scene = grasp(ratio * theory.grasp_threshold(friction=friction), friction)
    run = prepared(engine, scene, dt, settings)
    third = round(scene.duration / dt / 3.0)
    heights = []
    for _ in range(3):
        run.run(third)
        heights.append(run.state().q[2, 0])
    run.close()
    # Slipping accelerates; creeping moves evenly.
    first, last = -np.diff(heights) / (third * dt)
    # Held if it is slow in the last third, or if it no longer accelerates.
    held = last <= 0.02 or last - first <= 0.005 * GRAVITY * third * dt
    return bool(held), float(-heights[-1])


def grasp_limit(
    engine: Engine, dt: float, settings: Settings = FAIR, rounds: int = 10, friction: float = 0.5
) -> float:
    """Return the least squeeze that holds the part, over m g / (2 mu), by bisection from 0.5 to 2.

    By Coulomb's law alone it is 1, and 0.995 is the least that `squeezed` can return for it. Less
    than that is an engine whose contact bears more than Coulomb's cone: with Drake's patches the
    part sinks evenly, and is held, down to 0.98. Infinite where twice the threshold doesn't hold; 0
    where half of it does.
    """

    def held(ratio: float) -> bool:
        return squeezed(engine, ratio, dt, settings, friction)[0]

    low, high = 0.5, 2.0
    # The interval must contain the threshold before it is halved.
    if held(low):
        return 0.0
    if not held(high):
        return math.inf
    # Bisection assumes that a part held at one squeeze is held at any larger one.
    for _ in range(count("rounds", rounds, 1)):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if held(middle) else (middle, high)
    return high


@dataclass(frozen=True)
class Effect:
    """What one change between as shipped and fair does to a scene's error.

    Attributes:
        key: of the change.
        shipped, fair: the error with each of the two settings.
        alone: as shipped with this change.
        without: fair without it.
    """

    key: str
    shipped: float
    fair: float
    alone: float
    without: float


def effects(engine: Engine, scene: Scene, dt: float) -> list[Effect]:
    """Return each change of an engine that acts on this kind of scene, by itself."""
    kind = "joints" if scene.chain else "bodies"
    shipped, fair = (position_error(engine, scene, dt, s) for s in (AS_SHIPPED, FAIR))
    keys = [change.key for change in engine.changes if change.kind in ("all", kind)]
    # Each change switched alone, from both ends: as shipped with it, and fair without it.
    turned = [
        [position_error(engine, scene, dt, s.using(but=(key,))) for s in (AS_SHIPPED, FAIR)]
        for key in keys
    ]
    return [Effect(key, shipped, fair, *pair) for key, pair in zip(keys, turned, strict=True)]


# --- sim to sim: a controller tuned on one engine, run on all ------------------------------------

# Tuned on the course's own arm: critically damped, it leaves (1 + 8 t) exp(-8 t) of the way, which
# after 1.5 s is under a tenth of a thousandth.
PACE = 8.0  # [rad/s]
GOAL = (0.8, 0.1, -0.3, -1.2, 0.2, 1.9, 0.6)  # [rad]


@dataclass(frozen=True)
class Reach:
    """How a reach ended.

    Attributes:
        error: of the tip [m].
        speed: of the tip [m/s].
        success: whether it is within 5 mm and slower than 5 cm/s.
    """

    error: float
    speed: float
    success: bool


def reach(
    engine: Engine,
    dt: float = 1e-3,
    settings: Settings = FAIR,
    duration: float = 1.5,
    damping: float = 0.5,
    modelled: float | None = None,
) -> Reach:
    """Run a reach of the 7-R arm under computed torque, once a step.

    The law uses chapter 4's model of the arm.

    The model knows all that the URDF text says, so that an engine fails by what it leaves out or
    adds: a damping that is not read, a motor that holds a joint.

    Args:
        engine: the simulator that runs the arm.
        dt: step [s].
        settings: of the simulator.
        duration: of the reach [s].
        damping: of each joint, in the text and in the model [N m s/rad].
        modelled: the model's own, where the two differ.
    """
    scene = arm(duration, damping=damping)
    chain = arm(duration, damping=damping if modelled is None else modelled).chain
    assert chain is not None
    goal = np.array(GOAL)
    run = prepared(engine, scene, positive("dt", dt, unit="s"), settings)
    now = run.state()
    for _ in range(round(duration / dt)):
        # Computed torque with critical damping: acceleration w^2 e - 2 w v.
        # The torque is of the state before the step, as in a sampled controller.
        desired = PACE * (PACE * (goal - now.q) - 2.0 * now.v)
        run.set_torque(
            kinematics.inverse_dynamics(chain, now.q, now.v, desired, gravity=scene.gravity)
        )
        run.run(1)
        now = run.state()
        # Diverged (also NaN, which compares as false).
        if not np.max(np.abs(now.q)) < 1e3:
            run.close()
            return Reach(math.inf, math.inf, False)
    run.close()
    # Errors of the hand, not of the joints: place [m] and speed [m/s].
    other, aim = kinematics.tip(chain, now.q), kinematics.tip(chain, goal)
    error = float(np.linalg.norm(other[:3] - aim[:3]))
    speed = float(np.linalg.norm(kinematics.jacobian(chain, now.q)[:3] @ now.v))
    return Reach(error, speed, error <= 5e-3 and speed <= 5e-2)
