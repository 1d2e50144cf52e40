"""Chapter 6's simulation: one joint, its gains and a step; all of the answer at every change."""

import math

import numba
import numpy as np
from numba.extending import register_jitable

from course.compiled import VECTOR, loop
from course.control import joint as chapter
from course.control import sampled, touch
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

INERTIA, DAMPING = 0.5, 0.5  # [kg m^2], [N m s/rad]
SECONDS, STEP, JAM, PUSH = 5.0, 0.25, 1.5, (3.0, 3.1)  # the run, its step, how long [s], when [s]
_MOST = 5000  # samples of a run
BITS = (0, 14, 12, 10, 8)

CONTROLS = Record(
    kp=slider("Kp", 20.0, 0.0, 120.0, 0.5, "N m/rad", 1),
    ki=slider("Ki", 2.0, 0.0, 150.0, 0.5, "N m/(rad s)", 1),
    kd=slider("Kd", 8.0, 0.0, 40.0, 0.1, "N m s/rad", 1),
    limit=slider("Torque limit", 50.0, 1.0, 50.0, 0.5, "N m", 1),
    delay=slider("Delay", 0.0, 0.0, 100.0, 1.0, "ms", 0),
    dt=slider("Sample time", 1.0, 1.0, 50.0, 1.0, "ms", 0),
    load=slider("Load", 0.0, -5.0, 5.0, 0.5, "N m", 1),
    friction=slider("Coulomb friction", 0.0, 0.0, 3.0, 0.1, "N m", 1),
    static=slider("Static / Coulomb", 1.0, 1.0, 3.0, 0.1, "", 1),
    encoder=menu("Encoder", ("exact", "14 bits", "12 bits", "10 bits", "8 bits")),
    conditional=switch("anti-windup", True),
    on_error=switch("derivative of the error", False),
    target=Field(1.0, low=-2.0, high=2.0, unit="rad"),
    jam=switch("", False),
    push=Field(0.0, low=-50.0, high=50.0, unit="N m"),
)
STATE = Record(
    time=Field(0.0, unit="s"),
    samples=Field(0),
    run=Field(0.0, shape=(2, _MOST + 1)),  # angle [rad], torque [N m]
    report=Field(0.0, shape=(7,)),  # as `judged` gives it; below 0 where there is no number
)


def judged(kp, ki, kd, dt, delay, target, q):
    """Return overshoot, settling [s], error [rad], growth, gain, phase and delay margin.

    The phase margin is in rad, the delay margin in s.
    """
    # The step comes after STEP seconds; the response is judged from the first sample at or after
    # it.
    first, whole = math.ceil(STEP / dt), math.floor(delay / dt + 1e-9)
    times = dt * np.arange(q.size - first)
    observed = chapter._metrics(times, q[first:], target, chapter.BAND, chapter.REST)
    # Zero-order hold of inertia and viscous damping, with the fractional part of the delay; its
    # whole samples are states of the loop's matrix.
    plant = touch.held_mass(INERTIA, DAMPING, 0.0, dt, max(0.0, delay - whole * dt))
    parts = (*plant, whole, *sampled._pid(kp, ki, kd, dt, 0, 0.0))
    # Growth per sample is the spectral radius of the closed loop's matrix: asymptotically stable
    # below 1.
    growth, remaining = sampled.growth_by_squares(sampled._closed(*parts)), (0.0, 0.0, 0.0, 0.0)
    # Margins are defined for a stable loop with a controller only.
    if growth <= sampled.STABLE and max(kp, ki, kd) > 0.0:
        at, lags, _, reals = sampled._gain_crossover(*parts)
        remaining = sampled._margins(at, lags, reals, dt)
    gain, _, phase, later = remaining
    report = np.array([observed[0], observed[1], observed[2], growth, gain, phase, later])
    # Infinities and NaN have no place in the page's readouts: -1 stands for them.
    return np.where(np.isfinite(report), report, -1.0)


_judged = loop(judged, VECTOR(*6 * (numba.float64,), VECTOR))


def warm() -> None:
    """Compile, or load from the cache, what the model calls from Python."""
    _judged(1.0, 0.0, 1.0, 1e-2, 0.0, 1.0, np.zeros(200))


@register_jitable
def numbers_of(controls):
    """Return the gains as the chapter's loop takes them: `course.control.Gains.numbers`."""
    limit, top = controls["limit"], math.inf
    return np.array(
        [
            controls["kp"],
            controls["ki"],
            controls["kd"],
            1e-3 * controls["dt"],
            -limit,
            limit,
            0.0,
            top,
            1.0,
            1.0 * controls["on_error"],
            0.0,
            2.0 - 2.0 * controls["conditional"],
            0.1,
        ]
    )


def initial(controls, state):
    """Compute the whole run, and what it and its loop's matrix say."""
    dt, late, target = 1e-3 * controls["dt"], 1e-3 * controls["delay"], controls["target"]
    n, dry = round(SECONDS / dt), controls["friction"]
    times = dt * np.arange(n)
    bits, line = BITS[controls["encoder"]], 0.0
    # An encoder of n bits rounds the angle to 2π / 2^n.
    if bits > 0:
        line = 2.0 * math.pi / 2.0**bits
    # A delay is split into whole samples, a queue of commands, and a rest within a sample.
    whole = math.floor(late / dt + 1e-9)
    drive = np.array([math.inf, math.inf, math.inf, whole, max(0.0, late - whole * dt), line])
    parts = np.array([INERTIA, DAMPING, -controls["load"], dry, controls["static"] * dry])
    # Profiles over time: the step of the target, a push, and a jam that holds the joint.
    desired = np.where(times > STEP - 1e-9, target, 0.0)
    extra = np.where((times > PUSH[0]) & (times < PUSH[1]), controls["push"], 0.0)
    jam = (times < STEP + JAM) & (controls["jam"] != 0)
    # The closed loop of the chapter with all effects: quantisation, delay, saturation, dry
    # friction.
    out = np.zeros((5, n + 1))
    chapter._run_loop(
        parts, drive, numbers_of(controls), np.zeros(3), desired, extra, jam, np.zeros(n), out
    )
    state["samples"] = n
    state["run"][0, : n + 1], state["run"][1, : n + 1] = out[0], out[2]
    q, kp, ki, kd = out[0].copy(), controls["kp"], controls["ki"], controls["kd"]
    state["report"][:] = _judged(kp, ki, kd, dt, late, target, q)


def advance(state, controls, seconds):
    """Advance the simulation: the arm goes on along its run, to the end of it."""
    state["time"] = min(state["time"] + seconds, SECONDS)


TITLE = "A joint that tracks a step"
word, colour = draw.words_table(), draw.colours_table()
_TIME, _ANGLE, _TORQUE, _WANTED = word("time [s]", "angle [rad]", "torque [N m]", "target")
_OVER, _SETTLED, _ERROR, _GROWTH = word(
    "overshoot", "settled after", "error at the end", "growth a sample"
)
_GAIN, _PHASE, _DELAY = word("gain margin", "phase margin", "delay margin")
_PERCENT, _S, _MRAD, _DEGREES, _MS, _TIMES = word(" %", " s", " mrad", "°", " ms", "×")
_NEVER, _ANY, _NONE = word("not settled", "no limit", "unstable")
_SCENE, _UPPER, _LOWER = (0.2, 3.1, 0.9, 4.5), (3.9, 8.8, 2.5, 4.75), (3.9, 8.8, 0.6, 1.85)
_VIEW = (-1.25, 1.25, -1.3, 1.8034)


@register_jitable
def _margin(pen, name, value, growth, form, unit):
    """Draw a margin; none of an unstable loop, and no limit where it is infinite."""
    instead = _NONE if growth > sampled.STABLE else (_ANY if value <= 0.0 else 0)
    draw.reading(pen, name, value, form, unit, instead)


def frame(pen, state, controls):
    """Draw the arm now, angle and torque over the whole run; numbers of the run and of the loop."""
    dt, n, target = 1e-3 * controls["dt"], state["samples"], controls["target"]
    # The present sample of a run that was computed beforehand; the addend is for rounding.
    at = min(int(state["time"] / dt + 1e-9), n)
    run, report = state["run"], state["report"]
    draw.area(pen, _SCENE, _VIEW)
    draw.segment(pen, 0.0, 0.0, math.cos(target), math.sin(target), draw.INK, 1.6, 0.8, 5.0, 4.0)
    x, y = math.cos(run[0, at]), math.sin(run[0, at])
    draw.segment(pen, 0.0, 0.0, x, y, draw.BLUE, 9.0)
    draw.spot(pen, x, y, 0.08, draw.ORANGE, draw.INK)
    draw.spot(pen, 0.0, 0.0, 0.14, draw.FAINT, draw.INK)
    draw.window(pen)
    draw.theory_key(pen, 0.4, 4.72, _WANTED)
    # Long runs are thinned to about 1000 points for drawing.
    step, u = max(1, n // 1000), run[1, : n + 1]
    times, q = dt * np.arange(n + 1), run[0, : n + 1]
    # The chart ignores excursions beyond 4 rad, so that an unstable loop doesn't flatten the rest.
    low, high = min(0.0, 1.4 * target, max(np.min(q), -4.0)), max(0.0, min(np.max(q), 4.0))
    high = max(high, 1.4 * target) + 0.05
    draw.chart(pen, _UPPER, (0.0, SECONDS, low - 0.05, high), _TIME, _ANGLE, 0, 5, 4)
    # The reference as a dashed step; below it the torque with a cursor at the present time.
    draw.theory(pen, np.array([0.0, STEP, STEP, SECONDS]), np.array([0.0, 0.0, target, target]))
    draw.curve(pen, times[::step], q[::step], draw.BLUE, 2.0)
    draw.spot(pen, dt * at, run[0, at], 0.07, draw.ORANGE, draw.INK)
    top = max(1.0, 1.1 * np.max(np.abs(u)))
    draw.chart(pen, _LOWER, (0.0, SECONDS, -top, top), _TIME, _TORQUE, 0, 5, 5)
    draw.curve(pen, times, u, draw.ORANGE, 1.4)
    draw.segment(pen, dt * at, -top, dt * at, top, draw.GREY, 1.0)
    draw.window(pen)
    draw.reading(pen, _OVER, 100.0 * report[0], 1, _PERCENT)
    draw.reading(pen, _SETTLED, report[1], 2, _S, _NEVER if report[1] < 0.0 else 0)
    draw.reading(pen, _ERROR, 1000.0 * report[2], 1, _MRAD)
    draw.reading(pen, _GROWTH, report[3], 5)
    _margin(pen, _GAIN, report[4], report[3], 2, _TIMES)
    _margin(pen, _PHASE, math.degrees(report[5]), report[3], 0, _DEGREES)
    _margin(pen, _DELAY, 1000.0 * report[6], report[3], 1, _MS)


def drag(controls, state, x, y):
    """Handle a drag: the target is where the pointer is, as the joint sees it."""
    to = draw.values_at(_SCENE, _VIEW, x, y)
    controls["target"] = min(max(math.atan2(to[1], to[0]), -2.0), 2.0)
    # A target of zero would be no step: overshoot is relative to its size.
    if abs(controls["target"]) < 0.05:
        controls["target"] = 0.05


_LATE = 20.0  # ms: the delay of the presets that have one
_KU, _TU = sampled.delay_limit(INERTIA, DAMPING, 1e-3 * (_LATE + 0.5))
_BARE = {"ki": 0.0, "kd": 0.0, "delay": _LATE}
PRESETS = {
    "Default": Preset(
        {},
        "After five seconds the integral is still unwinding. Set Ki to zero, then drag the "
        "target, or press Play and watch the arm.",
    ),
    "P at its limit": Preset(
        {**_BARE, "kp": _KU},
        f"P alone with {_LATE:g} ms of delay, at the gain from w tan(w (D + dt/2)) = b/J: it "
        "oscillates for ever, and the growth is 1.",
    ),
    "P past its limit": Preset(
        {**_BARE, "kp": 1.1 * _KU},
        "A tenth more gain, and the oscillation grows until the torque limit holds it.",
    ),
    "PD at its limit": Preset(
        {"ki": 0.0, "kd": 19.5, "dt": 50.0},
        "Too much damping: Kd must stay below 2 J/dt if the rate is a difference. Lower it, or "
        "shorten the sample time.",
    ),
    "Derivative kick": Preset(
        {"on_error": True},
        "The target jumps, so the derivative of the error has a spike, and the torque too. "
        "Switch it off: the margins stay the same.",
    ),
    "A kick": Preset(
        {"push": 40.0, "ki": 0.0}, "A push of 40 N m for a tenth of a second, at 3 s."
    ),
    "A jam": Preset(
        {
            "kp": 40.0,
            "kd": 6.0,
            "ki": 40.0,
            "limit": 8.0,
            "load": 2.0,
            "jam": True,
            "conditional": False,
        },
        "The joint is blocked while the integral grows. Switch anti-windup on.",
    ),
    "A weak motor": Preset(
        {"limit": 2.0, "kd": 3.0},
        "At its limit the motor ignores the gains. The margins describe a loop that is open at "
        "that time.",
    ),
    "A coarse encoder": Preset(
        {"encoder": 4, "ki": 0.0, "dt": 10.0},
        "One count per sample, times Kd: the torque rattles though the arm hardly moves. A "
        "shorter sample time makes it worse.",
    ),
    "Dry friction": Preset(
        {"friction": 1.0, "ki": 0.0},
        "The joint stops where Kp times the error is smaller than the friction. Then try Ki.",
    ),
    "Hunting": Preset(
        {"friction": 2.0, "static": 3.0, "kp": 40.0, "ki": 150.0, "kd": 6.0},
        "It sticks, jumps past the target, and sticks again. Set Static / Coulomb to one.",
    ),
    "Z-N, P": Preset({**_BARE, "kp": 0.5 * _KU}, "Half of the ultimate gain for the stated delay."),
    "Z-N, PI": Preset(
        {**_BARE, "kp": 0.45 * _KU, "ki": 0.54 * _KU / _TU},
        "The joint is an integrator already. With one integral more, this delay and no D, it is "
        "unstable.",
    ),
    "Z-N, PID": Preset(
        {**_BARE, "kp": 0.6 * _KU, "ki": 1.2 * _KU / _TU, "kd": 0.075 * _KU * _TU},
        "Stable, but with little margin. Raise Kd.",
    ),
    "The quoted gains": Preset(
        {"kp": 27.0, "ki": 120.0, "kd": 1.5},
        "Often quoted with 15 % overshoot. But (b + Kd) Kp is less than J Ki: unstable, even "
        "without delay.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "overshoot": "How far the joint goes beyond the target, as a fraction of the step.",
    "settled after": "Time after which the error stays within the settling band.",
    "error at the end": "Target minus angle at the end of the run. It may still be decaying.",
    "growth a sample": (
        "Spectral radius of the closed loop: the factor by which its slowest mode changes per "
        "sample. Above 1 it is unstable."
    ),
    "gain margin": "Factor by which the loop gain can rise before the loop becomes unstable.",
    "phase margin": "Extra phase lag at the crossover frequency that makes the loop unstable.",
    "delay margin": "Extra delay that makes the loop unstable.",
}

MODEL = Model(
    TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, drag, readouts=READOUTS
)
