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
        rise, smooth: time constants of the drive and of the filter of the speed, in ticks.
        scale: reading of the sensor for one newton.
        slowed: length of a tick of the loop, by what it is meant to be.
        brake: of the speed, times tick / mass.
    """

    gain: float
    integral: float = 0.04
    delay: int = 1
    ring: float = RING
    late: float = 0.0
    room: float = 2.0
    limit: float = 20.0
    rise: float = 0.125
    smooth: float = 0.125
    scale: float = 1.0
    slowed: float = 1.0
    brake: float = 0.12


TUNES = {
    "late_loop": Tune(2.0, delay=4),
    "windup": Tune(1.0, integral=0.216, room=36.0, limit=15.0),
    "uneven_ticks": Tune(2.2, late=12.0),
    "soft_sensor": Tune(1.7, ring=0.17),
    "slow_drive": Tune(2.0, rise=4.0),
    "slow_speed": Tune(0.85, smooth=15.0),
    "low_rate": Tune(2.0, slowed=3.0),
    "other_unit": Tune(2.1, scale=4.448, brake=0.08),
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
        rise=tune.rise * tick,
        ring=tune.ring / tick,
        scale=tune.scale,
        period=tick,
        periods=(
            tune.slowed * tick * np.roll(lateness(tune.late), int(draw.integers(100)))
        ).tolist(),
        delay=tune.delay,
        target=10.0,
        gain=tune.gain,
        integral=tune.integral / tick,
        brake=tune.brake * mass / tick,
        smooth=tune.smooth * tick,
        room=tune.room,
        dt=tick / 8,
        start=near * 0.05 * (tick / 2e-3) ** 2,
    )


def even(one: Machine) -> Machine:
    """Return a loop that is never late, at the rate at which it runs on average."""
    return replace(one, periods=[float(np.mean(one.periods))])


def full_rate(one: Machine) -> Machine:
    """Return a loop that runs at the rate that it is meant to have, as unevenly as before."""
    faster = one.period / np.mean(one.periods)
    return replace(one, periods=[float(faster * length) for length in one.periods])


REPAIRS: dict[str, Change] = {
    "shorten_delay": lambda one: replace(one, delay=1),
    "bound_integral": lambda one: replace(one, room=2.0),
    "even_ticks": even,
    "stiff_mount": lambda one: replace(one, ring=RING / one.period),
    "fast_drive": lambda one: replace(one, rise=one.dt),
    "raw_speed": lambda one: replace(one, smooth=one.dt),
    "full_rate": full_rate,
    "read_newtons": lambda one: replace(one, scale=1.0),
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


def rate(log: Rows, one: Machine) -> float:
    """Return the ticks of the loop over those that it should have had."""
    return float(log["ticks"][-1] * one.period / (len(log) * one.dt))


def scale(log: Rows, one: Machine) -> float:
    """Return the mean reading over the mean force."""
    return float(log["reading"].mean() / log["force"].mean())


def lag(log: Rows, behind: str, signal: str) -> float:
    """Return by how many nominal ticks one column of the log is behind another."""
    ahead, largest = log[signal], 160
    later = log[behind][largest:] - log[behind][largest:].mean()
    shifts = np.lib.stride_tricks.sliding_window_view(ahead, len(later))[largest:0:-1]
    return float(np.argmax(shifts @ later / shifts.std(axis=1))) / 8


def lag_of(behind: str, signal: str) -> Run:
    """Return the probe that reads such a lag from a log."""
    return read(lambda log, one: lag(log, behind, signal))


def first_command(log: Rows, one: Machine) -> float:
    """Return ticks of the loop before the drive first gets a command."""
    return float(log["ticks"][np.argmax(log["command"] != 0.0)] - 1)


SCENARIO = Scenario(
    name="touch",
    title="The arm oscillates when it touches",
    prompt="The tip of an arm comes down on a steel plate and should press on it with ten "
    "newtons. In the air it is calm. As soon as it touches, it hammers and does not stop. You may "
    "read the program; the parameters of the machine are on a controller on which you can only run "
    "things. What is it, and what do you change?",
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
        Cause(
            "slow_drive",
            "The drive needs some ticks to build up the commanded force: the loop always acts on "
            "an error that is gone.",
            "fast_drive",
        ),
        Cause(
            "slow_speed",
            "The speed that the brake uses comes from a slow filter. The brake pulls when the "
            "arm has turned round already, and takes no energy out of the swing.",
            "raw_speed",
        ),
        Cause(
            "low_rate",
            "The loop was started at a third of its rate. Each command is held for three times as "
            "long, although the gains were chosen for the full rate.",
            "full_rate",
        ),
        Cause(
            "other_unit",
            "The sensor reports pounds and the loop reads them as newtons: the gain of the loop "
            "is 4.4 times what it was tuned for.",
            "read_newtons",
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
            "log_ticks",
            "longest tick of the loop divided by the shortest",
            "",
            5,
            read(tick_spread),
            5.0,
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
            lag_of("reading", "force"),
            1.0,
        ),
        Probe(
            "log_rate", "ticks of the loop over those it should have had", "", 3, read(rate), 0.1
        ),
        Probe(
            "log_scale",
            "mean reading over the mean of a gauge under the plate",
            "",
            6,
            read(scale),
            0.2,
        ),
        Probe(
            "log_drive",
            "ticks by which the force of the drive is behind the command",
            "ticks",
            7,
            lag_of("drive", "command"),
            0.5,
        ),
        Probe(
            "log_speed",
            "ticks by which the speed that the brake uses is behind the arm",
            "ticks",
            7,
            lag_of("speed", "v"),
            0.5,
        ),
        Probe(
            "fixed_rate",
            "the loop on a clock that is never late: swing with this change divided by swing "
            "without",
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
        Repair("fast_drive", "A drive that builds up its force within a tick."),
        Repair("raw_speed", "The brake uses the speed without the filter."),
        Repair("full_rate", "The loop runs at the rate that it was tuned for."),
        Repair("read_newtons", "The reading is converted to newtons."),
        Repair("soften", "A quarter of the force gain."),
        Repair("pad", "A pad with a tenth of the stiffness on the plate."),
    ),
    popular="soften",
    price=price,
    price_words="error under a sudden load or sag, whichever is more, against the design",
    affordable=1.5,
    path=8,
)
