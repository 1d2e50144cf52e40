"""An arm hammers on the plate that it should press on: causes, probes, repairs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from course.interview.scenarios import Cause, Probe, Repair, Scenario
from course.interview.scenarios.programs.touch import Machine, simulate

Run = Callable[[str, int], float]
Rows = NDArray[np.void]
Change = Callable[[Machine], Machine]

TICKS = 750  # of a run; the oscillation is evaluated in its second half
STILL = 6.0  # N, the largest oscillation that counts as steady
RING = 3.0  # of a sensor on a stiff mount: natural frequency times a tick


@dataclass(frozen=True)
class Tune:
    """Parameters that make an arm hammer with about the same amplitude; times are in ticks.

    Attributes:
        gain, integral: of the force error; the integral for one tick.
        delay: ticks.
        ring: natural frequency of the sensor times a tick.
        late: largest delay of a tick, in ticks.
        room, limit: largest magnitude of the integral and of the drive's force [N].
        rise, smooth: time constants of the drive and of the velocity filter, in ticks.
        scale: reading that the loop uses, per newton of force.
        slowed: length of a tick of the loop, divided by its design value.
        brake: gain of the velocity, times tick / mass.
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
    """Return the lengths of a hundred ticks of which some are late by up to `at_most`.

    The ticks after a late one catch up.
    """
    draw = np.random.default_rng(4)
    late = np.where(draw.random(100) < 0.2, draw.random(100), 0.0) * at_most
    late[-int(at_most) - 1 :] = 0.0
    return np.diff(np.maximum.accumulate(np.arange(100) + late), append=100.0)


def machine(cause: str, seed: int) -> Machine:
    """Return the machine of a seed that has a fault.

    The contact is scaled with the sampled mass and tick: its natural frequency times the tick is
    0.2, and its damping ratio is 0.1 (0.04 is 2 times 0.1 times 0.2).
    """
    draw, tune = np.random.default_rng([3, seed]), TUNES[cause]
    # Mass [kg], tick [s], and a factor of the distance at the start.
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
        # About 50 mm at a tick of 2 ms. With the square of the tick, as the distance that a given
        # acceleration covers in a given number of ticks.
        start=near * 0.05 * (tick / 2e-3) ** 2,
    )


def even(one: Machine) -> Machine:
    """Return a loop that is never late, at the rate at which it runs on average."""
    return replace(one, periods=[float(np.mean(one.periods))])


def full_rate(one: Machine) -> Machine:
    """Return a loop that runs at its design rate, as unevenly as before."""
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
    """Return the log of a run."""
    return simulate(one, 8 * TICKS)


@lru_cache(maxsize=64)  # the reference runs, of which every probe of a log reads another figure
def original(cause: str, seed: int) -> Rows:
    """Return the log of a machine on which nothing is changed."""
    return logged(machine(cause, seed))


def swing(log: Rows) -> float:
    """Return the oscillation of the force [N]: peak to peak of the sine with its deviation."""
    force = log["force"]
    return float(np.sqrt(8.0) * force[len(force) // 2 :].std())


@cache
def symptom(cause: str, seed: int, repair: str | None) -> float:
    """Return the oscillation of the force [N] in the second half of the run."""
    if repair is None:
        return swing(original(cause, seed))
    return swing(logged(REPAIRS[repair](machine(cause, seed))))


def price(cause: str, seed: int, repair: str) -> float:
    """Return the larger growth of two errors that a repair causes: force error and sag.

    The force error is the one that a sudden load makes, load / (1 + gain); the sag is inversely
    proportional to the stiffness.
    """
    one = machine(cause, seed)
    after = REPAIRS[repair](one)
    return max((1.0 + one.gain) / (1.0 + after.gain), one.stiffness / after.stiffness)


def calmer(change: Change) -> Run:
    """Return the probe that changes the machine and compares the oscillations."""

    def run(cause: str, seed: int) -> float:
        return swing(logged(change(machine(cause, seed)))) / symptom(cause, seed, None)

    return run


def read(figure: Callable[[Rows, Machine], float]) -> Run:
    """Return the probe that reads a log."""

    def run(cause: str, seed: int) -> float:
        return float(figure(original(cause, seed), machine(cause, seed)))

    return run


def tick_spread(log: Rows, one: Machine) -> float:
    """Return the longest tick divided by the shortest."""
    ticks = np.diff(np.flatnonzero(np.diff(log["ticks"])))
    return float(ticks.max() / ticks.min())


def rate(log: Rows, one: Machine) -> float:
    """Return the ticks of the loop divided by those that it should have had."""
    return float(log["ticks"][-1] * one.period / (len(log) * one.dt))


def scale(log: Rows, one: Machine) -> float:
    """Return the mean reading divided by the mean force."""
    return float(log["reading"].mean() / log["force"].mean())


def lag(log: Rows, behind: str, signal: str) -> float:
    """Return by how many nominal ticks one column of the log lags another."""
    ahead, largest = log[signal], 160
    later = log[behind][largest:] - log[behind][largest:].mean()
    shifts = np.lib.stride_tricks.sliding_window_view(ahead, len(later))[largest:0:-1]
    return float(np.argmax(shifts @ later / shifts.std(axis=1))) / 8


def lag_of(behind: str, signal: str) -> Run:
    """Return the probe that reads such a lag from a log."""
    return read(lambda log, one: lag(log, behind, signal))


def first_command(log: Rows, one: Machine) -> float:
    """Return the ticks of the loop before the drive receives its first command."""
    return float(log["ticks"][np.argmax(log["command"] != 0.0)] - 1)


SCENARIO = Scenario(
    name="touch",
    title="The arm oscillates in contact",
    prompt="The tip of an arm comes down on a steel plate and should press on it with ten "
    "newtons. In free motion it is steady. As soon as it touches the plate, it starts to hammer "
    "and does not stop. The loop commands the desired force, plus a gain times the force error, "
    "plus an integral of this error, minus a damping force (the brake) in proportion to the "
    "velocity. Some probes change one thing and return the oscillation ratio: the size of "
    "the oscillation of the force with the change, divided by the size without it. You can read "
    "the program, but not the parameters of the arm, which are on its controller; you can only "
    "run the probes below. What is the cause, and what do you change?",
    symptom_words="peak-to-peak oscillation of the force",
    unit="N",
    symptom=symptom,
    spread=0.15,
    removed=lambda figure: figure < STILL,
    causes=(
        Cause(
            "late_loop",
            "The command uses a measurement that is several ticks old. The force gain acts like an "
            "added stiffness, and this stiffness times the delay acts like negative damping. Here "
            "it exceeds the damping of the brake.",
            "shorten_delay",
        ),
        Cause(
            "windup",
            "While the drive is at its limit, the integral goes on growing: in the air towards the "
            "plate, during the impact away from it. So it drives the arm into the plate, then "
            "throws it off, again and again.",
            "bound_integral",
        ),
        Cause(
            "uneven_ticks",
            "The loop is late from time to time: it holds an old command and then issues several "
            "commands in quick succession.",
            "even_ticks",
        ),
        Cause(
            "soft_sensor",
            "The force sensor is on a soft mount, so its reading lags behind the force.",
            "stiff_mount",
        ),
        Cause(
            "slow_drive",
            "The drive needs several ticks to build up the commanded force, so the loop always "
            "acts on an error that has already changed.",
            "fast_drive",
        ),
        Cause(
            "slow_speed",
            "The brake uses the velocity from a slow filter. After the arm reverses, the brake "
            "still opposes the earlier motion, so it takes no energy out of the oscillation.",
            "raw_speed",
        ),
        Cause(
            "low_rate",
            "The loop was started at a third of its rate. It holds each command three times as "
            "long, although the gains were chosen for the full rate.",
            "full_rate",
        ),
        Cause(
            "other_unit",
            "The sensor reports newtons, but the loop treats the reading as pounds of force and "
            "converts it to newtons again. The gain of the loop is then 4.4 times what it was "
            "tuned for.",
            "read_newtons",
        ),
    ),
    probes=(
        Probe(
            "hold_command",
            "oscillation ratio with a constant command instead of the loop",
            "",
            2,
            calmer(lambda one: replace(one, gain=0.0, integral=0.0)),
            0.1,
        ),
        Probe(
            "quarter_gain",
            "oscillation ratio with a quarter of the force gain",
            "",
            2,
            calmer(REPAIRS["soften"]),
            0.15,
        ),
        Probe(
            "soft_plate",
            "oscillation ratio with a plate of a tenth of the stiffness",
            "",
            3,
            calmer(REPAIRS["pad"]),
            0.15,
        ),
        Probe(
            "gentle_start",
            "oscillation ratio with a start from a hundredth of the height",
            "",
            3,
            calmer(lambda one: replace(one, start=one.start / 100)),
            0.15,
        ),
        Probe(
            "integral_off",
            "oscillation ratio with the integral off",
            "",
            3,
            calmer(lambda one: replace(one, integral=0.0)),
            0.3,
        ),
        Probe(
            "double_drive",
            "oscillation ratio with a drive of twice the force limit",
            "",
            4,
            calmer(lambda one: replace(one, limit=2 * one.limit)),
            0.15,
        ),
        Probe(
            "log_ticks",
            "longest time from one run (tick) of the loop to the next, divided by the shortest",
            "",
            5,
            read(tick_spread),
            5.0,
        ),
        Probe(
            "log_switch_on",
            "number of ticks from the start of the loop to the first command",
            "ticks",
            5,
            read(first_command),
            0.25,
        ),
        Probe(
            "log_sensor",
            "number of ticks by which the reading lags a force gauge under the plate",
            "ticks",
            6,
            lag_of("reading", "force"),
            1.0,
        ),
        Probe(
            "log_rate",
            "number of ticks of the loop, divided by the number that there should be",
            "",
            3,
            read(rate),
            0.1,
        ),
        Probe(
            "log_scale",
            "mean reading that the loop uses, divided by the mean of a force gauge under the plate",
            "",
            6,
            read(scale),
            0.2,
        ),
        Probe(
            "log_drive",
            "number of ticks by which the force of the drive lags the command",
            "ticks",
            7,
            lag_of("drive", "command"),
            0.5,
        ),
        Probe(
            "log_speed",
            "number of ticks by which the velocity that the brake uses lags the arm's velocity",
            "ticks",
            7,
            lag_of("speed", "v"),
            0.5,
        ),
        Probe(
            "fixed_rate",
            "oscillation ratio with the loop on a clock that is never late",
            "",
            8,
            calmer(even),
            0.15,
        ),
    ),
    repairs=(
        Repair("shorten_delay", "The loop runs next to the drive, with one tick of delay."),
        Repair("bound_integral", "The integral is limited to a fifth of the target force."),
        Repair("even_ticks", "The loop gets a processor core and a clock of its own."),
        Repair("stiff_mount", "The sensor is put on a stiff mount."),
        Repair("fast_drive", "A drive that builds up its force within a tick replaces it."),
        Repair("raw_speed", "The brake uses the velocity without the filter."),
        Repair("full_rate", "The loop runs at the rate that it was tuned for."),
        Repair("read_newtons", "The loop uses the reading in newtons, without converting it."),
        Repair("soften", "The force gain is reduced to a quarter."),
        Repair("pad", "A pad with a tenth of the stiffness is put on the plate."),
    ),
    popular="soften",
    price=price,
    price_words="error under a sudden load, or sag, whichever is larger, relative to the design",
    affordable=1.5,
    path=8,
)
