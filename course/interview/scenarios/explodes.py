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
WINDOW = 3000  # steps that are looked at; who is not lost in them counts as never lost


@dataclass(frozen=True)
class Tune:
    """Numbers without units that make a machine lose the slide after a thousand steps.

    The growth of a step is about log(1000) / 1000 = 0.007. With a = omega dt of one stop:
    explicit Euler grows by (a^2 - 2 zeta a - rub) / 2; a brake that is late by tau grows where
    cos(omega tau) < 0; friction of the wrong sign by (rub - 2 zeta a) / 2; twice the stiffness
    turns -1 into an eigenvalue at 2 a^2 + 4 sqrt(2) zeta' a = 4, zeta' = zeta / sqrt(2).

    Attributes:
        a: sqrt(stiffness / mass) dt.
        zeta: damping / (2 sqrt(stiffness mass)).
        rub: friction * gravity * dt / slow.
        points: number of stops that touch at once.
        age: delay of the brake's measurement, in steps.
        turned: whether the friction has the wrong sign.
        blend: weight of the new velocity in the position update.
    """

    a: float
    zeta: float
    rub: float
    points: int = 1
    age: int = 0
    turned: bool = False
    blend: float = 1.0


TUNES = {
    "double_contact": Tune(0.9, 0.66303, 0.001, points=2),
    "explicit_step": Tune(0.126, 0.002, 0.001, blend=0.0),
    "late_brake": Tune(0.15, 0.0676, 0.001, age=16),
    "wrong_friction": Tune(0.15, 0.01, 0.01734, turned=True),
}


def machine(cause: str, seed: int) -> Machine:
    """Return the machine of a seed that has a fault."""
    draw, tune = np.random.default_rng([1, seed]), TUNES[cause]
    mass, dt, friction = draw.uniform((1.0, 0.8e-3, 0.2), (4.0, 1.25e-3, 0.4)).tolist()
    guide, start = float(draw.choice((-1.0, 1.0))), 2e-6 * float(draw.uniform(0.8, 1.25))
    omega = tune.a / dt
    return Machine(
        mass=mass,
        stiffness=mass * omega**2,
        stops=((0.0, 1.0), (0.0, -1.0)) * tune.points,
        damping=2.0 * tune.zeta * omega * mass,
        age=tune.age,
        friction=friction,
        slow=friction * GRAVITY * dt / tune.rub,
        rail=-guide if tune.turned else guide,
        guide=guide,
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
    "halve_step": halved,
    "soften": lambda one: replace(one, stiffness=one.stiffness / 4),
}


def lost(one: Machine, dt: float) -> float:
    """Count the steps of `dt` until the slide is lost, at most `WINDOW`; never fewer are run."""
    steps = round(WINDOW * dt / one.dt)
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
        one = machine(cause, seed)
        return lost(change(one), one.dt) / symptom(cause, seed, None)

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


def stops_gain(cause: str, seed: int) -> float:
    """Return the share of energy gained in ten steps with neither brake nor friction."""
    one = replace(machine(cause, seed), damping=0.0, friction=0.0)
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
    prompt="A slide on a rail rests between two elastic stops. A brake and friction should take "
    "away what little motion it has at the start. Instead it swings out further and further, and "
    "after about a thousand steps it is lost. A run lasts three times as long; if the slide is not "
    "lost by then, the end of the run is entered, so a ratio of times is at most about three. You "
    "may read the program; the parameters of the machine are on a computer on which you can only "
    "run things. What is it, and what do you change?",
    symptom_words="lost after",
    unit="steps",
    symptom=symptom,
    spread=0.1,
    removed=lambda figure: figure >= WINDOW,
    causes=(
        Cause(
            "double_contact",
            "Each stop touches with two points at once, each with the "
            "stiffness that one was chosen for. Twice the stiffness is beyond what the step "
            "bears.",
            "share_stiffness",
        ),
        Cause(
            "explicit_step",
            "The place moves with the old speed: explicit Euler, which gains "
            "energy on a spring at every step, however small.",
            "new_speed_first",
        ),
        Cause(
            "late_brake",
            "The brake gets its speed late, by more than a quarter of a swing: it "
            "pushes where it should pull.",
            "fresh_speed",
        ),
        Cause(
            "wrong_friction",
            "The speed is told along one axis and the friction applied along "
            "the opposite one: friction drives the slide.",
            "one_axis",
        ),
    ),
    probes=(
        Probe(
            "halve_step",
            "half the step: ratio of the times until it is lost",
            "",
            3,
            later(halved),
            0.1,
        ),
        Probe(
            "double_mass",
            "twice the mass: ratio of the times until it is lost",
            "",
            3,
            later(lambda one: replace(one, mass=2 * one.mass)),
            0.1,
        ),
        Probe(
            "start_closer",
            "a tenth of the start: ratio of the times until it is lost",
            "",
            2,
            later(lambda one: replace(one, start=one.start / 10)),
            0.1,
        ),
        Probe(
            "brake_off",
            "no brake: ratio of the times until it is lost",
            "",
            3,
            later(lambda one: replace(one, damping=0.0)),
            0.1,
        ),
        Probe(
            "friction_off",
            "no friction: ratio of the times until it is lost",
            "",
            3,
            later(lambda one: replace(one, friction=0.0)),
            0.1,
        ),
        Probe(
            "count_contacts",
            "most contact points that push in one step",
            "",
            4,
            logged(lambda log: log["touching"].max()),
            0.25,
        ),
        Probe(
            "count_turns",
            "changes of direction in a step, while it grows",
            "",
            4,
            logged(lambda log: np.mean(log["v"][401:] * log["v"][400:-1] < 0)),
            0.02,
        ),
        Probe(
            "log_friction",
            "share of steps in which friction pushes with the speed, less the "
            "share in which it pushes against it",
            "",
            6,
            logged(lambda log: np.mean(np.sign(log["rub"] * log["v"])[1:])),
            0.1,
        ),
        Probe(
            "log_brake",
            "steps by which the brake is behind the speed",
            "steps",
            6,
            logged(brake_lag),
            1.0,
        ),
        Probe(
            "log_energy",
            "neither brake nor friction: share of energy gained in ten steps",
            "",
            5,
            stops_gain,
            0.01,
        ),
        Probe(
            "push_by_hand",
            "ratio of the force at a fixed depth to that of the ordered stop",
            "",
            8,
            hooke,
            0.1,
        ),
    ),
    repairs=(
        Repair("share_stiffness", "The contact points of a stop share its stiffness."),
        Repair("new_speed_first", "The place moves with the new speed: semi-implicit Euler."),
        Repair("fresh_speed", "The brake uses the speed of this step."),
        Repair("one_axis", "Speed and friction are told along the same axis."),
        Repair("halve_step", "Half the step."),
        Repair("soften", "A quarter of the stiffness."),
    ),
    popular="halve_step",
    price=price,
    price_words="steps a second or sag, whichever is more, against the design",
    affordable=1.5,
    path=4,
)
