"""A slide between two stops is lost after about a thousand steps: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs.explodes import GRAVITY, Machine, contact_force, simulate

Run = Callable[[str, int], float]
Rows = NDArray[np.void]

LIMIT = 2e-3  # as far as the slide may be off the middle [m]
WINDOW = 3000  # steps that are simulated; a slide that is not lost in them counts as never lost
SURVIVES = 3.0  # the time ratio at which a probe stops its run


@dataclass(frozen=True)
class Tune:
    """Numbers without units that make a machine lose the slide after a thousand steps.

    The growth of a step is about log(1000) / 1000 = 0.007. With a = omega dt of one stop:
    explicit Euler grows by (a^2 - 2 zeta a - rub) / 2; a brake that is late by tau grows where
    cos(omega tau) < 0; friction of the wrong sign by (rub - 2 zeta a) / 2; twice the stiffness
    turns -1 into an eigenvalue at 2 a^2 + 4 sqrt(2) zeta' a = 4, zeta' = zeta / sqrt(2); a brake
    that acts twice does so near 4 zeta a = 2; a depth that is held for n steps is old by
    (n - 1) / 2 of them and grows by about a^2 (n - 1) / 4, less the damping; a drive that pushes
    outward harder than the stops push back grows without a swing; an integral grows where it
    exceeds Routh's limit, damping * (stiffness + gain) / mass.

    Attributes:
        a: sqrt(stiffness / mass) dt.
        zeta: damping / (2 sqrt(stiffness mass)).
        rub: friction * gravity * dt / slow.
        points: number of stops that touch at once.
        age: delay of the brake's measurement, in steps.
        turned: whether the friction has the wrong sign.
        blend: weight of the new velocity in the position update.
        brakes: number of brakes that act.
        every: steps from one contact detection to the next.
        gain: of the drive, as a share of the stiffness.
        encoder: direction in which the drive measures.
        integral: of the drive, times dt^3 / mass.
    """

    a: float
    zeta: float
    rub: float = 0.001
    points: int = 1
    age: int = 0
    turned: bool = False
    blend: float = 1.0
    brakes: int = 1
    every: int = 1
    gain: float = 0.05
    encoder: float = 1.0
    integral: float = 0.0


TUNES = {
    "double_contact": Tune(0.9, 0.6517, points=2),
    "explicit_step": Tune(0.1222, 0.002, blend=0.0),
    "late_brake": Tune(0.15, 0.06514, age=16),
    "wrong_friction": Tune(0.15, 0.01, 0.01758, turned=True),
    "double_brake": Tune(0.3, 1.6353, brakes=2),
    "held_contact": Tune(0.09916, 0.02, every=5),
    "turned_encoder": Tune(0.014585, 0.1, gain=1.4, encoder=-1.0),
    "eager_integral": Tune(0.15, 0.02, integral=5.08e-4),
}


def machine(cause: str, seed: int) -> Machine:
    """Return a machine with a fault, of random size.

    `Tune` holds numbers without units, in which the fault's growth is the same for every machine;
    here they get the units of the mass, step and friction that the seed draws. So each seed is
    another machine, and all lose the slide after about a thousand steps.

    Args:
        cause: name of the fault, a key of `TUNES`.
        seed: of mass, step, friction, side of the rail and start.
    """
    draw, tune = np.random.default_rng([1, seed]), TUNES[cause]
    # Mass [kg], step [s] and coefficient of friction.
    mass, dt, friction = draw.uniform((1.0, 0.8e-3, 0.2), (4.0, 1.25e-3, 0.4)).tolist()
    guide, start = float(draw.choice((-1.0, 1.0))), 2e-6 * float(draw.uniform(0.8, 1.25))
    # Natural frequency of the slide on one stop [rad/s]; all gains follow from it.
    omega = tune.a / dt
    return Machine(
        mass=mass,
        stiffness=mass * omega**2,
        # A stop on either side of the middle; a contact that is detected twice is there twice.
        stops=((0.0, 1.0), (0.0, -1.0)) * tune.points,
        every=tune.every,
        damping=2.0 * tune.zeta * omega * mass,
        brakes=tune.brakes,
        age=tune.age,
        friction=friction,
        slow=friction * GRAVITY * dt / tune.rub,
        # The axis of the force is opposite to that of the speed: friction then drives the slide.
        rail=-guide if tune.turned else guide,
        guide=guide,
        gain=tune.gain * mass * omega**2,
        integral=tune.integral * mass / dt**3,
        encoder=tune.encoder,
        blend=tune.blend,
        dt=dt,
        start=start,
    )


def halved(one: Machine) -> Machine:
    """Return half the step; what is late by milliseconds stays late by them."""
    return replace(one, dt=one.dt / 2, age=2 * one.age)


REPAIRS = {
    "share_stiffness": lambda one: replace(one, stiffness=2 * one.stiffness / len(one.stops)),
    "new_speed_first": lambda one: replace(one, blend=1.0),
    "fresh_speed": lambda one: replace(one, age=0),
    "one_axis": lambda one: replace(one, rail=one.guide),
    "damp_once": lambda one: replace(one, brakes=1),
    "detect_each_step": lambda one: replace(one, every=1),
    "turn_encoder": lambda one: replace(one, encoder=1.0),
    "no_integral": lambda one: replace(one, integral=0.0),
    "halve_step": halved,
    "soften": lambda one: replace(one, stiffness=one.stiffness / 4),
}


def lost(one: Machine, dt: float, window: float = WINDOW) -> float:
    """Count the steps of `dt` until the slide is lost, at most `window`; never fewer are run."""
    steps = round(window * dt / one.dt)
    away = ~(np.abs(simulate(one, steps)["x"]) < LIMIT)
    return float(np.argmax(away) if away.any() else steps) * one.dt / dt


@cache
def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Count the steps until the slide is lost, in units of the machine's original step."""
    one = machine(cause, seed)
    return lost(REPAIRS[repair](one) if repair else one, one.dt)


def price(cause: str, seed: int, repair: str) -> float:
    """Return the larger price: of steps a second, or of sag under a force against one stop."""
    one = machine(cause, seed)
    after = REPAIRS[repair](one)
    sag = one.stiffness / (after.stiffness * len(after.stops) / 2)
    return max(one.dt / after.dt, sag)


def later(change: Callable[[Machine], Machine]) -> Run:
    """Return the probe that changes the machine: when the slide is lost, by when it was."""

    def run(cause: str, seed: int) -> float:
        one, before = machine(cause, seed), symptom(cause, seed, None)
        return lost(change(one), one.dt, SURVIVES * before) / before

    return run


def logged(read: Callable[[Rows], Any]) -> Run:
    """Return the probe that reads a log of the machine, until the slide is nearly lost."""

    def run(cause: str, seed: int) -> float:
        return float(read(simulate(machine(cause, seed), 900)))

    return run


def brake_lag(log: Rows) -> int:
    """Return the smallest shift [steps] at which the brake is wholly against the speed."""
    speeds = [log["v"][50 - lag : 900 - lag] for lag in range(30)]
    return int(np.argmax([np.corrcoef(log["brake"][50:], v)[0, 1] < -0.999 for v in speeds]))


def held_share(log: Rows) -> float:
    """Return the share of steps in which the stops push exactly as in the step before."""
    return float(np.mean(np.diff(log["push"]) == 0.0))


def stops_gain(cause: str, seed: int) -> float:
    """Return the share of energy gained in ten steps with no brake, friction or drive."""
    one = replace(machine(cause, seed), damping=0.0, friction=0.0, gain=0.0, integral=0.0)
    log = simulate(one, 1001)  # a thousand steps lie between its rows
    x, v, old = log["x"], log["v"], 1.0 - one.blend
    # What the scheme keeps on a spring: with the new speed first, a skewed energy.
    hooke = one.stiffness * len(one.stops) / 2
    energy = one.mass * v**2 + hooke * x**2 - (1.0 - old) * one.dt * hooke * x * v
    return float(np.log(energy[-1] / energy[0]) / 100)


def hooke(cause: str, seed: int) -> float:
    """Return the force at a tenth of a millimetre, by what one stop was ordered for."""
    one = machine(cause, seed)
    return abs(contact_force(one, 1e-4)[0]) / (one.stiffness * 1e-4)


SCENARIO = Scenario(
    name="explodes",
    title="It explodes after about a thousand steps",
    prompt="A slide, which is a small carriage, moves on a rail between two elastic stops without "
    "play: off the middle, one of them pushes it back. A weak drive also pulls it to the middle. "
    "The slide starts at rest, a little off the middle. Friction and a brake, whose force grows "
    "with the speed, should damp its motion. Instead the motion grows, and after about a "
    "thousand steps the slide is lost: it has left its range. Some probes change one thing "
    "and return the time ratio: the simulated time until the slide is lost, divided by this "
    "time without the change. Each of these probes stops its run after three times the "
    "time of the unchanged run. So if the slide survives, the time ratio is three. You "
    "can read the program, but not the parameters that this simulation uses; you can only run "
    "the probes below. What is the cause, and what do you change?",
    symptom_words="steps until the slide is lost or the run ends,",
    unit="",
    symptom=symptom,
    spread=0.1,
    removed=lambda figure: figure >= WINDOW,
    causes=(
        Cause(
            "double_contact",
            "Each stop is detected as two contact points, and each point has the full "
            "stiffness that was chosen for one. At twice the stiffness, and with the brake, the "
            "time step is too long for a stable simulation.",
            "share_stiffness",
        ),
        Cause(
            "explicit_step",
            "The position is updated with the old velocity. This is explicit Euler, which "
            "gains energy on a spring in every step, however small the step is.",
            "new_speed_first",
        ),
        Cause(
            "late_brake",
            "The brake receives the velocity with a delay of more than a quarter of an "
            "oscillation, so its force mostly points along the motion.",
            "fresh_speed",
        ),
        Cause(
            "wrong_friction",
            "The velocity is measured along one axis and friction is applied along the "
            "opposite one, so friction drives the slide.",
            "one_axis",
        ),
        Cause(
            "double_brake",
            "The damping is entered both for the slide and for the rail, so the brake acts "
            "twice. The brake uses the old velocity, and with twice the damping it more than "
            "reverses the velocity in one step.",
            "damp_once",
        ),
        Cause(
            "held_contact",
            "Contacts are detected only every few steps, and in between the stops push with "
            "the depth of the last detection. An outdated depth acts like a delayed spring, "
            "which adds energy to the oscillation.",
            "detect_each_step",
        ),
        Cause(
            "turned_encoder",
            "The encoder of the drive counts in the wrong direction, so the sign of the "
            "feedback is wrong. The drive pushes the slide away from the centre harder than "
            "the stops push it back.",
            "turn_encoder",
        ),
        Cause(
            "eager_integral",
            "The integral gain of the drive is too high. Above the Routh stability limit, "
            "damping times stiffness divided by mass, the integral makes every oscillation "
            "grow.",
            "no_integral",
        ),
    ),
    probes=(
        Probe(
            "halve_step",
            "time ratio with half the time step; the brake's delay in seconds stays the same",
            "",
            3,
            later(halved),
            0.1,
        ),
        Probe(
            "double_mass",
            "time ratio with twice the mass",
            "",
            3,
            later(lambda one: replace(one, mass=2 * one.mass)),
            0.1,
        ),
        Probe(
            "start_closer",
            "time ratio with a tenth of the initial displacement",
            "",
            2,
            later(lambda one: replace(one, start=one.start / 10)),
            0.1,
        ),
        Probe(
            "brake_off",
            "time ratio with the brake off",
            "",
            3,
            later(lambda one: replace(one, damping=0.0)),
            0.1,
        ),
        Probe(
            "friction_off",
            "time ratio with friction off",
            "",
            3,
            later(lambda one: replace(one, friction=0.0)),
            0.1,
        ),
        Probe(
            "drive_off",
            "time ratio with the drive off",
            "",
            3,
            later(lambda one: replace(one, gain=0.0, integral=0.0)),
            0.1,
        ),
        Probe(
            "count_contacts",
            "largest number of contact points that push in one step",
            "",
            4,
            logged(lambda log: log["touching"].max()),
            0.25,
        ),
        Probe(
            "count_turns",
            "changes of direction per step while the motion grows",
            "",
            4,
            logged(lambda log: np.mean(log["v"][401:] * log["v"][400:-1] < 0)),
            0.02,
        ),
        Probe(
            "log_friction",
            "+1 if friction always pushes along the velocity, -1 if it always pushes against it",
            "",
            6,
            logged(lambda log: np.mean(np.sign(log["rub"] * log["v"])[1:])),
            0.1,
        ),
        Probe(
            "log_brake",
            "number of steps by which the brake force lags the velocity",
            "steps",
            6,
            logged(brake_lag),
            1.0,
        ),
        Probe(
            "log_push",
            "fraction of steps in which the force of the stops is exactly the same as in the "
            "step before",
            "",
            4,
            logged(held_share),
            0.05,
        ),
        Probe(
            "log_energy",
            "relative energy gain in ten steps with brake, friction and drive off",
            "",
            5,
            stops_gain,
            0.01,
        ),
        Probe(
            "push_by_hand",
            "force at a fixed depth, divided by the force that the specified stop would have there",
            "",
            8,
            hooke,
            0.1,
        ),
    ),
    repairs=(
        Repair("share_stiffness", "The contact points of a stop share its stiffness."),
        Repair(
            "new_speed_first",
            "The position is updated with the new velocity (semi-implicit Euler).",
        ),
        Repair("fresh_speed", "The brake uses the velocity of the current step."),
        Repair("one_axis", "The velocity is measured along the same axis as friction is applied."),
        Repair("damp_once", "The damping is entered only once, so one brake acts."),
        Repair("detect_each_step", "Contacts are detected in every step."),
        Repair(
            "turn_encoder", "The counting direction of the encoder is corrected if it is wrong."
        ),
        Repair(
            "no_integral",
            "The integral term of the drive is removed; the stops and the proportional gain "
            "centre the slide.",
        ),
        Repair("halve_step", "The time step is halved."),
        Repair("soften", "The stiffness of the stops is reduced to a quarter."),
    ),
    popular="halve_step",
    price=price,
    price_words="the larger of the steps per second and the deflection under load, each relative "
    "to the design",
    affordable=1.5,
    path=7,
)
