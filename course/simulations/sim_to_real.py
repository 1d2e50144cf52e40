"""Chapter 8's simulation: one policy on the arm it was tuned for and on the real one.

Both rates of success are counted on common tasks at every change. What a policy was tuned on is on
record (`course.sim_to_real.recorded`), but for a simulator with one part mended: that is tuned when
it is asked for.
"""

import math
from functools import lru_cache

import numpy as np
from numba import objmode
from numba.extending import register_jitable

from course import sim_to_real as chapter
from course.control import Gains, joint_system
from course.control.sampled import crossings, held
from course.measure.success import wilson
from course.sim_to_real import plants, transfer
from course.sim_to_real.tune import GRID, KNOWN_DELAY
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

COUNTED, SHARED, SEED, PAUSE = 256, 128, 17, 0.6  # episodes; of each part alone; pause [s]
SAMPLES = round(plants.SECONDS / plants.DT)
NEAREST, FARTHEST = 0.15, 0.85  # of a target [m]
START = (0.3, 1.6)  # where the shown episode starts [rad]
PARTS, _LENGTHS = tuple(transfer.PARTS), tuple(map(float, plants.ARM.lengths))
NOMINAL, RANGE, IDENTIFIED, BOTH, DELAY, LOAD = range(6)
SIMULATED, REAL = range(2)
# What `told` holds: of both arms share, ends of its band, and how the shown episode ended; then
# the latest command that is stable [s], the gain margin, the part that costs most and what.
SHARE, LOW, HIGH, ENDED = range(4)
LIMIT, GAIN, PART, COSTS = range(8, 12)

CONTROLS = Record(
    gap=slider("Reality Gap", 0.3, 0.0, 1.0, 0.1, "", 1),
    width=slider("DR Range", 0.2, 0.0, 1.0, 0.1, "", 1),
    delay=slider("Actuator Delay", 10.0, 0.0, 40.0, 1.0, "ms", 0),
    policy=menu(
        "Tuned on",
        (
            "the simulator as it was",
            "a range about it",
            "the arm, identified at 10 ms",
            "a range about that",
            "the simulator, delay mended",
            "the simulator, load mended",
        ),
    ),
    aim=Field((-0.28, 0.56), low=-1.0, high=1.0, unit="m"),
)
STATE = Record(
    q=Field(0.0, shape=(2, 2, SAMPLES + 1), unit="rad"),
    report=Field(0.0, shape=(12,)),
    time=Field(0.0, unit="s"),
)


@lru_cache(maxsize=64)
def policy(kind, gap, width, delay):
    """Return gains, and the arm that they were tuned on: of a range its middle."""
    # Policies that were tuned beforehand: nominal or domain randomisation about it, system
    # identification, or both.
    at, record = round(10.0 * gap), chapter.recorded()
    if kind in (NOMINAL, RANGE):
        return record["range"][round(10.0 * width) if kind == RANGE else 0, 0], chapter.nominal()
    if kind in (IDENTIFIED, BOTH):
        known = chapter.real(GRID[at], KNOWN_DELAY)
        return record["known" if kind == IDENTIFIED else "both"][at, 0], known
    # What-if policies are tuned now, on the simulator with one part taken from the real arm.
    arm = transfer.mended(chapter.real(gap, delay), ("delay" if kind == DELAY else "load",))
    result = chapter.tune(chapter.only(arm), 0, rounds=16, samples=32, elites=8, episodes=24)
    return result.gains, arm


def stability(arm, gains):
    """Return the latest command at which each joint alone is stable [s], and the gain margin."""
    # Each joint alone is a linear loop, the inertia that of the start posture: delay and gain
    # margins from its crossover frequencies.
    a, b, d, c1, c2, *_, torque, delay, _, _, _ = arm.columns()[:, 0].tolist()
    limit = gain = 99.0
    for k, (inertia, damping) in enumerate(((a + 2.0 * b * math.cos(START[1]), c1), (d, c2))):
        kp, ki, kd = torque * gains[3 * k : 3 * k + 3]
        law = Gains(kp, ki, kd, plants.FILTER).law(plants.DT)
        system = joint_system(inertia, damping)
        limit = min(limit, crossings(held(*system, plants.DT), law).delay)
        gain = min(gain, crossings(held(*system, plants.DT, delay), law).gain)
    return limit, gain if delay < limit else 0.0


@lru_cache(maxsize=64)
def counted(kind, gap, width, delay):
    """Return all of `told` except how the shown episode ended; both arms get the same tasks."""
    gains, believed = policy(kind, gap, width, delay)
    report, arm = np.zeros(12), chapter.real(gap, delay)
    posed, fewer = chapter.tasks(COUNTED, SEED), chapter.tasks(SHARED, SEED)
    # The same tasks on the arm in simulation and on the real one: the difference is the reality
    # gap.
    for k, one in enumerate((believed, arm)):
        good = int(chapter.rollouts(one, gains, posed).success.sum())
        report[4 * k : 4 * k + 3] = good / COUNTED, *wilson(good, COUNTED)
    report[[LIMIT, GAIN]] = stability(arm, gains)
    # Attribute the gap: the nominal arm with a single part taken from the real one, and the success
    # that this costs alone. These costs need not add up.
    home = chapter.rollouts(chapter.nominal(), gains, fewer).rate
    alone = [
        home - chapter.rollouts(transfer.mended(arm, (part,)), gains, fewer).rate for part in PARTS
    ]
    report[[PART, COSTS]] = int(np.argmax(alone)), max(alone)
    return report


def measure(values):
    """Return angles of both arms in the shown episode, shape (2, 2, samples), and `told`."""
    gap, width, delay, x, y = values[:5].tolist()
    setting = int(values[5]), round(gap, 9), round(width, 9), round(1e-3 * delay, 9)
    gains, believed = policy(*setting)
    # The shown episode is a single task with fixed start and target.
    posed = chapter.Tasks(np.reshape(START, (2, 1)), np.array([[x], [y]]), SEED)
    report = counted(*setting).copy()
    arms = believed, chapter.real(setting[1], setting[3])
    for k, arm in enumerate(arms):
        report[4 * k + ENDED] = chapter.rollouts(arm, gains, posed).reason[0]
    return np.stack([chapter.watch(arm, gains, posed).q[:, 0] for arm in arms]), report


@register_jitable
def _target(controls):
    """Return where the tip has to go: as near to where the pointer was as the arm reaches well."""
    x, y = controls["aim"]
    r = math.hypot(x, y)
    # The target is pulled into the annulus that the arm reaches well.
    factor = min(max(r, NEAREST), FARTHEST) / r if r > 1e-9 else 0.0
    return (x * factor, y * factor) if r > 1e-9 else (NEAREST, 0.0)


@register_jitable
def initial(controls, state):
    """Count both rates on the common tasks, and run the shown episode on both arms."""
    c = controls
    x, y = _target(controls)
    values = np.array([c["gap"], c["width"], c["delay"], x, y, 1.0 * c["policy"]])
    with objmode(q="float64[:,:,:]", report="float64[:]"):
        q, report = measure(values)
    state["q"][:], state["report"][:] = q, report


def advance(state, controls, seconds):
    """Advance the simulation: the episode is shown again and again."""
    state["time"] += seconds


TITLE = "One policy, two arms"
word, colour = draw.words_table(), draw.colours_table()
_SAND = colour("#f7f5ef")[0]
_ARM, _HEADING = word("the arm it was tuned on", "the real arm")[0], word("simulated", "real")[0]
_REASON, _PART = word(*plants.REASONS)[0], word(*PARTS)[0]
_RATE, _FAR, _TIME, _TARGET, _LATE, _LIMIT = word(
    "successes [%]", "tip to target [cm]", "time [s]", "target", "actuator delay [ms]", "limit"
)
_SUCCESS, _SHOWN = word("success, simulated", "success, real")[0], word("this one, simulated")[0]
_BAND, _TO, _CLOSE, _PERCENT, _MS, _NONE, _COMMA = word(" % (", "-", ")", " %", " ms", "none", ", ")
_REALLY, _STABLE, _GAIN, _WORST, _LEFT = word(
    "this one, real", "limit, joint alone", "gain margin", "costs most alone", "left of that"
)
_COLOUR = (draw.BLUE, draw.ORANGE)
_SCENES, _VIEW = ((0.1, 3.0, 1.7, 4.6), (3.15, 6.05, 1.7, 4.6)), (-0.95, 0.95, -0.95, 0.95)
_RATES = ((0.25, 2.85, 0.75, 1.05), (3.3, 5.9, 0.75, 1.05))
_CHART, _GAUGE = (6.75, 8.85, 2.3, 4.4), (6.75, 8.85, 0.75, 1.05)


@register_jitable
def _tips(q):
    """Return elbow and tip of angles (2, ...) [m]."""
    l1, l2 = _LENGTHS
    x, y = l1 * np.cos(q[0]), l1 * np.sin(q[0])
    return x, y, x + l2 * np.cos(q[0] + q[1]), y + l2 * np.sin(q[0] + q[1])


@register_jitable
def _links(pen, q, ink, width, alpha):
    """Draw an arm as two lines, its joints and its tip."""
    x, y, u, v = _tips(q)
    draw.curve(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), ink, width, alpha)
    draw.spots(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), 0.022, ink, draw.NONE, 1.5, alpha)


def frame(pen, state, controls):
    """Draw both arms, the simulated one as a ghost over the real, and their numbers."""
    report = state["report"]
    x, y = _target(controls)
    # Time runs through the episode and a pause, then again.
    now = int(min(state["time"] % (plants.SECONDS + PAUSE), plants.SECONDS) / plants.DT + 1e-9)
    t = np.linspace(0.0, plants.SECONDS, SAMPLES + 1)
    for k in range(2):
        draw.area(pen, _SCENES[k], _VIEW)
        draw.box(pen, *_VIEW, _SAND, draw.GREY)
        draw.title(pen, _VIEW[0], _VIEW[3], _ARM + k)
        draw.spot(pen, x, y, plants.RADIUS, draw.GREEN, draw.INK, 1.0, 0.7)
        if k == REAL:
            # The simulated arm as a ghost over the real one, at the same moment.
            _links(pen, state["q"][SIMULATED, :, now], _COLOUR[SIMULATED], 4.0, 0.3)
        _, _, u, v = _tips(state["q"][k, :, : now + 1])
        draw.curve(pen, u, v, _COLOUR[k], 1.4, 0.8)
        _links(pen, state["q"][k, :, now], _COLOUR[k], 5.0, 1.0)
        share, low, high = (
            100.0 * report[4 * k],
            100.0 * report[4 * k + 1],
            100.0 * report[4 * k + 2],
        )
        # Success rates as bars with Wilson's interval.
        draw.chart(pen, _RATES[k], (0.0, 100.0, 0.0, 1.0), _RATE, 0, 0, 5, 0)
        draw.box(pen, 0.0, share, 0.0, 1.0, _COLOUR[k])
        draw.segment(pen, low, 0.5, high, 0.5, draw.INK, 3.0)
        for end in (low, high):
            draw.segment(pen, end, 0.15, end, 0.85, draw.INK, 2.0)
    draw.chart(pen, _CHART, (0.0, plants.SECONDS, 0.0, 50.0), _TIME, 0, _FAR, 3, 5)
    draw.segment(
        pen,
        0.0,
        100.0 * plants.RADIUS,
        plants.SECONDS,
        100.0 * plants.RADIUS,
        draw.GREEN,
        1.5,
        1.0,
        4.0,
        3.0,
    )
    for k in range(2):
        _, _, u, v = _tips(state["q"][k, :, : now + 1])
        draw.curve(pen, t[: now + 1], 100.0 * np.hypot(u - x, v - y), _COLOUR[k], 2.0)
    # The delay against the latest one at which a joint alone is stable.
    draw.gauge(pen, _GAUGE, 40.0, controls["delay"], draw.GREY, _LATE, 1e3 * report[LIMIT], _LIMIT)
    draw.window(pen)
    for k in range(2):
        draw.key(pen, 6.75 + 1.15 * k, 1.62, _HEADING + k, _COLOUR[k], 4.0)
        draw.reading(pen, _SUCCESS + k, 100.0 * report[4 * k], 0)
        draw.words(pen, _BAND)
        draw.number(pen, 100.0 * report[4 * k + LOW], 0, _TO)
        draw.number(pen, 100.0 * report[4 * k + HIGH], 0, _CLOSE)
    for k in range(2):
        ended = _REASON + int(report[4 * k + ENDED])
        draw.reading(pen, _SHOWN if k == SIMULATED else _REALLY, 0.0, 0, 0, ended)
    draw.reading(pen, _STABLE, 1e3 * report[LIMIT], 1, _MS)
    draw.reading(pen, _LEFT, 1e3 * report[LIMIT] - controls["delay"], draw.SIGNED + 1, _MS)
    draw.reading(pen, _GAIN, report[GAIN], 2, 0, 0 if report[GAIN] > 0.0 else _NONE)
    draw.reading(
        pen, _WORST, 0.0, 0, 0, _PART + int(report[PART]) if report[COSTS] > 0.0 else _NONE
    )
    if report[COSTS] > 0.0:
        draw.words(pen, _COMMA)
        draw.number(pen, 100.0 * report[COSTS], 0, _PERCENT)


def drag(controls, state, x, y):
    """Handle a drag: the target of both arms follows the pointer in either picture."""
    u, v = draw.values_at(_SCENES[SIMULATED if x < _SCENES[REAL][0] else REAL], _VIEW, x, y)
    controls["aim"][:] = min(max(u, -1.0), 1.0), min(max(v, -1.0), 1.0)


PRESETS = {
    "Gap": Preset({}, "A policy that never fails in its simulator, on an arm that is not quite "
        "it. Pull the gap up; drag the target: the ghost is what the simulator promised. DR Range "
        "acts once 'Tuned on' is a range.",
        "A policy that never fails in its simulator, on an arm that differs a little from the "
        "simulated one. The ghost shows what the simulator promised."),
    "No gap": Preset({"gap": 0.0, "delay": 0.0}, "The arm it was tuned on. All succeed, and it "
        "is the only place where that says anything. Then give it 10 ms of delay.",
        "The arm that the policy was tuned on. All episodes succeed, which says nothing about any "
        "other arm."),
    "Gap and range": Preset({"width": 0.4, "policy": RANGE}, "Tuned on arms drawn anew for each "
        "episode: part of the loss comes back, and none of it costs a success at home."),
    "Wide range, far gap": Preset({"gap": 1.0, "width": 1.0, "policy": RANGE}, "The widest range "
        "at the full gap: little more than half. It costs no success at home, only time in the "
        "target; and one identified arm does far better."),
    "Delay beyond the margin": Preset({"gap": 0.0, "delay": 20.0}, "No gap but delay, later than "
        "the limit of joint 2: hardly one succeeds. At 12 ms, well below it, most do: those whose "
        "arm ends folded."),
    "Cancelling errors": Preset({"gap": 0.3, "delay": 20.0}, "The same delay on an arm that is "
        "wrong in all else too: most succeed. Its load makes it slower, and a slower arm stands a "
        "later command: see the limit. Take the gap away, and they fail.",
        "The same delay on an arm that is wrong in all else too: most episodes succeed. The load "
        "makes the arm slower, and a slower arm tolerates a later command: see the limit."),
    "Mended delay alone": Preset({"gap": 1.0, "policy": DELAY}, "The simulator learned the true "
        "delay, and the arm does worse than with the one that knew nothing: its gains are "
        "lower, and the load needs more. Mend the load.",
        "The simulator learned the true delay, and the arm does worse than with the policy that "
        "knew nothing: its gains are lower, and the load needs higher ones."),
}  # fmt: skip

# What each number below the picture means.
READOUTS = {
    "success, simulated": "Successful episodes in the simulator, with a 95 % confidence interval.",
    "success, real": (
        "Successful episodes on the arm that stands for the real one, with a 95 % confidence "
        "interval."
    ),
    "this one, simulated": "How the episode shown ended in the simulator.",
    "this one, real": "How the same episode ended on the real arm.",
    "limit, joint alone": (
        "Largest delay with which the loop of one joint is stable, according to theory."
    ),
    "left of that": "Delay margin that is left: that limit minus the actuator delay.",
    "gain margin": "Factor by which the loop gain can rise before the joint becomes unstable.",
    "costs most alone": "The modelling error that alone costs the most successes, and how many.",
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    readouts=READOUTS,
)
