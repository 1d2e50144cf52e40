"""An arm hammers on the plate that it should press: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs.touch import Machine, simulate

Run = Callable[[str, int], float]
Rows = NDArray[np.void]
Change = Callable[[Machine], Machine]

TICKS = 750  # that are looked at, the swing in the second half of them
STILL = 6.0  # a swing [N] that is no symptom
RING = 3.0  # of a sensor on a stiff mount: natural frequency times a tick


@dataclass(frozen=True)
class Tune:
    """Numbers that make an arm hammer with about the same swing; times are in ticks.

    Attributes:
        gain, integral: of the force error; the integral for one tick.
        delay: ticks.
        ring: natural frequency of the sensor times a tick.
        late: the most that a tick is late, in ticks.
        room, limit: of the integral and of the drive [N].
    """

    gain: float
    integral: float = 0.04
    delay: int = 1
    ring: float = RING
    late: float = 0.0
    room: float = 2.0
    limit: float = 20.0


TUNES = {
    "late_loop": Tune(2.25, delay=4),
    "windup": Tune(1.0, integral=0.224, room=36.0, limit=15.0),
    "uneven_ticks": Tune(2.2, late=12.0),
    "soft_sensor": Tune(2.05, ring=0.17),
}


def lateness(at_most: float) -> NDArray[np.float64]:
    """Return a hundred ticks of which some are late by up to `at_most`.

    Ticks behind a late one catch up.
    """
    draw = np.random.default_rng(4)
    late = np.where(draw.random(100) < 0.2, draw.random(100), 0.0) * at_most
    late[-int(at_most) - 1 :] = 0.0
    return np.diff(np.maximum.accumulate(np.arange(100) + late), append=100.0)


def machine(cause: str, seed: int) -> Machine:
    """Return the machine of a seed that has a fault."""
    draw, tune = np.random.default_rng([3, seed]), TUNES[cause]
    mass, tick, near = draw.uniform((0.8, 1.6e-3, 0.9), (1.5, 2.5e-3, 1.1)).tolist()
    return Machine(
        mass=mass,
        stiffness=mass * (0.2 / tick) ** 2,
        damping=0.04 * mass / tick,
        limit=tune.limit,
        ring=tune.ring / tick,
        period=tick,
        periods=(tick * np.roll(lateness(tune.late), int(draw.integers(100)))).tolist(),
        delay=tune.delay,
        target=10.0,
        gain=tune.gain,
        integral=tune.integral / tick,
        brake=0.12 * mass / tick,
        room=tune.room,
        dt=tick / 8,
        start=near * 0.05 * (tick / 2e-3) ** 2,
    )


def even(one: Machine) -> Machine:
    """Return a loop that is never late."""
    return replace(one, periods=[one.period])


REPAIRS: dict[str, Change] = {
    "shorten_delay": lambda one: replace(one, delay=1),
    "bound_integral": lambda one: replace(one, room=2.0),
    "even_ticks": even,
    "stiff_mount": lambda one: replace(one, ring=RING / one.period),
    "soften": lambda one: replace(one, gain=one.gain / 4),
    "pad": lambda one: replace(one, stiffness=one.stiffness / 10),
}


def logged(one: Machine) -> Rows:
    """Return what an arm does."""
    return simulate(one, 8 * TICKS)


def swing(one: Machine) -> float:
    """Swing of the force [N]: peak to peak of the sine with its standard deviation."""
    force = logged(one)["force"]
    return float(np.sqrt(8.0) * force[len(force) // 2 :].std())


@cache
def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return the swing of the force [N] in the second half of the touch."""
    one = machine(cause, seed)
    return swing(REPAIRS[repair](one) if repair else one)


def price(cause: str, seed: int, repair: str) -> float:
    """Return the larger growth of two errors that a repair causes: force error and sag.

    The force error is the one that a sudden load makes, load / (1 + gain); the sag is inversely
    proportional to the stiffness.
    """
    one = machine(cause, seed)
    after = REPAIRS[repair](one)
    return max((1.0 + one.gain) / (1.0 + after.gain), one.stiffness / after.stiffness)


def calmer(change: Change) -> Run:
    """Return the probe that changes the machine: its swing over that before."""

    def run(cause: str, seed: int) -> float:
        one = machine(cause, seed)
        return swing(change(one)) / symptom(cause, seed, None)

    return run


def read(figure: Callable[[Rows, Machine], float]) -> Run:
    """Return the probe that reads a log."""

    def run(cause: str, seed: int) -> float:
        one = machine(cause, seed)
        return float(figure(logged(one), one))

    return run


def tick_spread(log: Rows, one: Machine) -> float:
    """Return the longest tick by the shortest."""
    ticks = np.diff(np.flatnonzero(np.diff(log["ticks"])))
    return float(ticks.max() / ticks.min())


def sensor_lag(log: Rows, one: Machine) -> float:
    """Return by how many nominal ticks the reading is behind the force."""
    force, largest = log["force"], 160
    reading = log["reading"][largest:] - log["reading"][largest:].mean()
    shifts = np.lib.stride_tricks.sliding_window_view(force, len(reading))[largest:0:-1]
    return float(np.argmax(shifts @ reading / shifts.std(axis=1))) / 8


def first_command(log: Rows, one: Machine) -> float:
    """Return ticks of the loop before the drive first gets a command."""
    return float(log["ticks"][np.argmax(log["command"] != 0.0)] - 1)


SCENARIO = Scenario(
    name="touch",
    title="The arm oscillates when it touches",
    prompt="The tip of an arm comes down on a steel plate and should press on it with ten "
    "newtons. In the air it is calm. As soon as it touches it hammers, and does not stop. The "
    "program is what you may read; the numbers of the machine are on a controller that you can "
    "only run things on. What is it, and what do you change?",
    symptom_words="swing of the force",
    unit="N",
    symptom=symptom,
    spread=0.15,
    removed=lambda figure: figure < STILL,
    causes=(
        Cause(
            "late_loop",
            "The command uses a measurement that is some ticks old. Delay times the "
            "stiffness that the force gain adds to the plate is more than the brake can take.",
            "shorten_delay",
        ),
        Cause(
            "windup",
            "The integral grows while the drive is at its limit and the arm is in the "
            "air; what it stored throws the arm off the plate, and it grows again.",
            "bound_integral",
        ),
        Cause(
            "uneven_ticks",
            "The loop is late now and then: an old command is held, and then "
            "several follow at once.",
            "even_ticks",
        ),
        Cause(
            "soft_sensor",
            "The sensor sits on a soft mount: its reading is behind the force.",
            "stiff_mount",
        ),
    ),
    probes=(
        Probe(
            "hold_command",
            "a constant command instead of the loop: ratio of the swings, after to before",
            "",
            2,
            calmer(lambda one: replace(one, gain=0.0, integral=0.0)),
            0.1,
        ),
        Probe(
            "quarter_gain",
            "a quarter of the force gain: ratio of the swings, after to before",
            "",
            2,
            calmer(REPAIRS["soften"]),
            0.15,
        ),
        Probe(
            "soft_plate",
            "a plate with a tenth of the stiffness: ratio of the swings, after to before",
            "",
            3,
            calmer(REPAIRS["pad"]),
            0.15,
        ),
        Probe(
            "gentle_start",
            "from a hundredth of the height: ratio of the swings, after to before",
            "",
            3,
            calmer(lambda one: replace(one, start=one.start / 100)),
            0.15,
        ),
        Probe(
            "integral_off",
            "no integral: ratio of the swings, after to before",
            "",
            3,
            calmer(lambda one: replace(one, integral=0.0)),
            0.3,
        ),
        Probe(
            "double_drive",
            "a drive with twice the limit: ratio of the swings, after to before",
            "",
            4,
            calmer(lambda one: replace(one, limit=2 * one.limit)),
            0.15,
        ),
        Probe(
            "log_ticks", "longest tick of the loop, by the shortest", "", 5, read(tick_spread), 5.0
        ),
        Probe(
            "log_switch_on",
            "ticks from switching on to the first command",
            "ticks",
            5,
            read(first_command),
            0.25,
        ),
        Probe(
            "log_sensor",
            "ticks by which the reading is behind a gauge under the plate",
            "ticks",
            6,
            read(sensor_lag),
            1.0,
        ),
        Probe(
            "fixed_rate",
            "the loop on a clock that is never late: ratio of the swings, after to before",
            "",
            8,
            calmer(even),
            0.15,
        ),
    ),
    repairs=(
        Repair("shorten_delay", "The loop runs beside the drive: one tick of delay."),
        Repair("bound_integral", "The integral stays within a fifth of the target."),
        Repair("even_ticks", "The loop gets a core and a clock of its own."),
        Repair("stiff_mount", "The sensor sits on a stiff mount."),
        Repair("soften", "A quarter of the force gain."),
        Repair("pad", "A pad with a tenth of the stiffness on the plate."),
    ),
    popular="soften",
    price=price,
    price_words="error under a sudden load or sag, whichever is more, against the design",
    affordable=1.5,
    path=4,
)
