"""The sampled loop in Bode plot, Nyquist plot and step response: drag its gain and its delay."""

import math

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable

from course.compiled import MATRIX, VECTOR, loop
from course.control import frequency, sampled, touch
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

INERTIA, DAMPING = 0.5, 0.5  # of the joint [kg m^2], [N m s/rad]
HORIZONS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # of the step response [s]
_N, _STORED = 480, 1000  # frequencies of a curve; samples of a step response that are drawn
_LOW, _HIGH = -0.5, 3.5  # decades of the frequency axis, in rad/s
_PLAYED = 10.0  # how long the cursor takes for all frequencies [s]
_GONE = 1e3  # how far off a step response is not followed any more
AT_LIMIT = 1e-6  # so close to 1 is the growth of a loop at its limit
GAIN, PHASE, NYQUIST, NOTHING = range(4)  # what a drag moves

CONTROLS = Record(
    kp=slider("Kp", 20.0, 1.0, 400.0, 1.0, "N m/rad", 0),
    kd=slider("Kd / Kp", 0.4, 0.0, 1.0, 0.01, "s", 2),
    ki=slider("Ki / Kp", 0.0, 0.0, 10.0, 0.1, "1/s", 1),
    delay=slider("Delay", 5.0, 0.0, 100.0, 0.5, "ms", 1),
    dt=slider("Sample time", 1.0, 1.0, 50.0, 1.0, "ms", 0),
    held=Field(GAIN, low=GAIN, high=NOTHING),
)
STATE = Record(
    time=Field(0.0, unit="s"),
    curve=Field(0.0, shape=(4, _N)),  # log10 of the frequency, L (two rows), its phase [degrees]
    step=Field(0.0, shape=(2, _STORED + 1)),  # time [s], angle over the set-point
    samples=Field(0),  # of the step response that are stored
    horizon=Field(1.0, unit="s"),
    growth=Field(0.0),  # a sample
    # Below 0 or, for the real value of L, 0 where there is none; all margins of a stable loop only.
    gain_margin=Field(0.0),
    phase_margin=Field(0.0, unit="rad"),
    delay_margin=Field(0.0, unit="s"),
    crossover=Field(0.0, unit="rad/s"),
    bandwidth=Field(0.0, unit="rad/s"),
    peak=Field(0.0),
    peak_at=Field(0.0, unit="rad/s"),
    phase_crossover=Field(0.0, unit="rad/s"),  # where L is real and negative
    crossing=Field(0.0),  # L there
    swing=Field(0.0, unit="rad/s"),  # measured in the step response
)


@register_jitable
def parts_of(kp, ki, kd, dt, delay):
    """Return plant and law as `course.control.sampled` takes them; the gains are absolute."""
    whole = math.floor(delay / dt + 1e-9)
    plant = touch.held_mass(INERTIA, DAMPING, 0.0, dt, max(0.0, delay - whole * dt))
    return (*plant, whole, *sampled._pid(kp, ki, kd, dt, 0, 0.0))


def judged(kp, ki, kd, dt, delay):
    """Return the numbers of a loop, in the order of `STATE` from `growth` to `crossing`."""
    parts = parts_of(kp, ki, kd, dt, delay)
    growth = sampled.growth_by_squares(sampled._closed(*parts))
    at, lags, flat, reals = sampled._gain_crossover(*parts)
    # The highest gain crossover; it exists for an unstable loop too.
    crossover = np.max(at) / dt if at.size else -1.0
    # Of all crossings of the negative real axis the one that is closest to -1 as a factor; of a
    # stable loop it is the one that a higher gain takes there.
    phase_crossover, real = -1.0, 0.0
    for w, value in zip(flat, reals):  # noqa: B905, the compiled subset has no strict
        if value >= 0.0 or (growth <= sampled.STABLE and value < -1.0 - 1e-4):
            continue
        if real == 0.0 or abs(math.log(-value)) < abs(math.log(-real)):
            phase_crossover, real = w / dt, value
    if growth > sampled.STABLE:
        return growth, -1.0, -1.0, -1.0, crossover, -1.0, -1.0, -1.0, phase_crossover, real
    if abs(growth - 1.0) < AT_LIMIT:
        # Rounding must not put a loop at its limit on the far side of it, a full turn away.
        lags = np.where(lags > 2.0 * math.pi - 1e-4, 0.0, lags)
        reals = np.where(np.abs(reals + 1.0) < 1e-4, -1.0, reals)
    gain, _, phase, later = sampled._margins(at, lags, reals, dt)
    _, bandwidth, peak, peak_at, _ = frequency._shape(*parts)
    gain = gain if gain < math.inf else -1.0
    if not at.size:
        phase, later = -1.0, -1.0
    bandwidth = bandwidth / dt if bandwidth < math.inf else -1.0
    return (
        growth,
        gain,
        phase,
        later,
        crossover,
        bandwidth,
        peak,
        peak_at / dt,
        phase_crossover,
        real,
    )


_judged = loop(judged, types.UniTuple(numba.float64, 10)(*5 * (numba.float64,)))


def response(kp, ki, kd, dt, delay):
    """Return the rows of `STATE["curve"]`, shape (4, N)."""
    curve = np.empty((4, _N))
    curve[0] = np.linspace(_LOW, math.log10(math.pi / dt), _N)
    transition, now, before, whole, A, B, C, D = parts_of(kp, ki, kd, dt, delay)
    turns = 10.0 ** curve[0] * dt
    # Half the sample rate itself, where L is real, has no phase without a rounding error.
    turns[_N - 1] *= 1.0 - 1e-9
    # Whole samples of delay may turn the phase by more than half a turn from one point to the next.
    # Without them the phase is followed from point to point; then they are added.
    values = sampled._responses(transition, now, before, 0, A, B, C, D, turns)
    phase = math.atan2(values[0].imag, values[0].real)
    # An integrator lags by a quarter turn, two of them by a half: never ahead.
    total = phase - 2.0 * math.pi * math.ceil(phase / (2.0 * math.pi))
    for k in range(_N):
        last, phase = phase, math.atan2(values[k].imag, values[k].real)
        total += (phase - last + math.pi) % (2.0 * math.pi) - math.pi
        late = -turns[k] * whole
        value = values[k] * complex(math.cos(late), math.sin(late))
        curve[1, k], curve[2, k] = value.real, value.imag
        curve[3, k] = math.degrees(total + late)
    return curve


_curve = loop(response, MATRIX(*5 * (numba.float64,)))


def stepped(kp, ki, kd, dt, delay, samples):
    """Return the angle after a step of the set-point to 1, at each sample.

    The law acts on the error, D included, so this is the step response of T. It ends early where
    the angle is far off.
    """
    transition, now, before, whole, A, B, C, D = parts_of(kp, ki, kd, dt, delay)
    x, v, c, angle = 0.0, 0.0, np.zeros(C.size), np.zeros(samples + 1)
    # Commands of all samples, after those that were under way when the step came.
    u = np.zeros(samples + whole + 1)
    for k in range(samples):
        error = x - 1.0
        u[k + whole + 1] = D[0] * error + D[1] * v
        for i in range(C.size):
            u[k + whole + 1] += C[i] * c[i]
        moved = B[:, 0] * error + B[:, 1] * v
        for i in range(C.size):
            for j in range(C.size):
                moved[i] += A[i, j] * c[j]
        c = moved
        # Of a delay the whole samples queue the command, and the rest keeps the older one.
        new, old = u[k + 1], u[k]
        x, v = (
            transition[0, 0] * x + transition[0, 1] * v + now[0] * new + before[0] * old,
            transition[1, 0] * x + transition[1, 1] * v + now[1] * new + before[1] * old,
        )
        angle[k + 1] = x
        if not abs(x) < _GONE:
            return angle[: k + 1].copy()
    return angle


_stepped = loop(stepped, VECTOR(*5 * (numba.float64,), numba.int64))


def warm() -> None:
    """Compile, or load from the cache, what the model calls from Python."""
    loop_of = (1.0, 0.0, 1.0, 1e-2, 0.0)
    _judged(*loop_of)
    _curve(*loop_of)
    _stepped(*loop_of, 1)


@register_jitable
def swing_of(angle, dt):
    """Return the angular frequency with which samples pass 1, or -1 without three passages."""
    first, last, count = 0.0, 0.0, 0
    # The first third belongs to what dies out.
    for k in range(angle.size // 3, angle.size - 1):
        if angle[k] < 1.0 <= angle[k + 1]:
            last = dt * (k + (1.0 - angle[k]) / (angle[k + 1] - angle[k]))
            if count == 0:
                first = last
            count += 1
    return 2.0 * math.pi * (count - 1) / (last - first) if count > 2 else -1.0


def initial(controls, state):
    """Compute the loop's curves and numbers, and its step response."""
    dt, delay, kp = 1e-3 * controls["dt"], 1e-3 * controls["delay"], controls["kp"]
    ki, kd = kp * controls["ki"], kp * controls["kd"]
    state["curve"][:] = _curve(kp, ki, kd, dt, delay)
    growth, gain, phase, later, crossover, bandwidth, peak, peak_at, phase_crossover, real = (
        _judged(kp, ki, kd, dt, delay)
    )
    state["growth"], state["crossover"] = growth, crossover
    state["gain_margin"], state["phase_margin"], state["delay_margin"] = gain, phase, later
    state["bandwidth"], state["peak"], state["peak_at"] = bandwidth, peak, peak_at
    state["phase_crossover"], state["crossing"] = phase_crossover, real
    # The time axis holds some periods of an oscillation at the crossover.
    horizon = HORIZONS[0]
    for longer in HORIZONS:
        horizon = longer
        if longer * max(crossover, 0.5) >= 25.0:
            break
    samples = round(horizon / dt)
    angle = _stepped(kp, ki, kd, dt, delay, samples)
    # Long runs are thinned for drawing.
    every = (samples + _STORED - 1) // _STORED
    n = (angle.size - 1) // every
    state["horizon"], state["samples"] = horizon, n
    state["step"][0, : n + 1] = dt * every * np.arange(n + 1)
    state["step"][1, : n + 1] = angle[: n * every + 1 : every]
    state["swing"] = swing_of(angle, dt)


def advance(state, controls, seconds):
    """Advance the cursor, which visits all frequencies, and the step response in slow motion."""
    state["time"] = min(state["time"] + seconds, _PLAYED)


TITLE = "A loop in Bode plot, Nyquist plot and step response"
word, colour = draw.words_table(), draw.colours_table()
_FREQUENCY, _SIZE, _ANGLE, _NYQUIST, _REAL = word(
    "frequency [rad/s]",
    "gain: drag |L| up or down",
    "phase of L [degrees]: drag it",
    "Nyquist plot: drag the curve sideways",
    "real part of L",
)
_STEP, _TIME, _L, _S, _T, _ONE, _CIRCLE = word(
    "step response of the angle", "time [s]", "|L|", "|S|", "|T|", "-1", "radius 1/Ms"
)
_MARGIN_G, _MARGIN_P, _SECOND = word("gain margin", "phase margin", " s")
_CROSSOVER, _BANDWIDTH, _DELAY, _MS, _GROWTH, _LOOP = word(
    "crossover",
    "bandwidth",
    "delay margin",
    "peak sensitivity Ms",
    "growth a sample",
    "closed loop",
)
_PHASE_CROSSOVER, _SWING = word("phase crossover", "step oscillates at")
_RAD, _TIMES, _DEGREES, _MILLI = word(" rad/s", "×", "°", " ms")
_STABLE, _LIMIT, _UNSTABLE, _ANY, _NONE, _HUGE = word(
    "stable", "at its limit", "unstable", "no limit", "none", "above 1000"
)
(_DISC,) = colour("#fbe3d3")
WINDOW = (0.0, 9.0, 0.0, 7.3)
_UPPER, _LOWER = (0.95, 4.4, 4.15, 6.65), (0.95, 4.4, 0.75, 3.25)
_RIGHT, _RUN = (5.25, 8.8, 4.15, 6.65), (5.25, 8.8, 0.75, 3.25)
_SIZES, _LAGS = (_LOW, _HIGH, -2.2, 2.2), (_LOW, _HIGH, -330.0, -30.0)
# The Nyquist plot has equal scales: 3.55 and 2.5 units of the window across and high.
_PLANE = (-2.6, 1.376, -1.6, 1.2)
_HEIGHTS = (-0.6, 2.6)  # of the step response


@register_jitable
def _bode(pen, rectangle, values, heading, first, every, count, powers):
    """Draw axes with a logarithmic frequency, and `count` lines across, at powers of ten or not."""
    draw.area(pen, rectangle, values)
    draw.axes(pen, 0, 0, heading, 0, 0)
    for k in range(4):
        draw.segment(pen, 1.0 * k, values[2], 1.0 * k, values[3], draw.FAINT, 1.0)
    for k in range(count):
        level = first + every * k
        draw.segment(pen, values[0], level, values[1], level, draw.FAINT, 1.0)
    # Letters beside the axes are cut off unless the window is the area.
    draw.window(pen)
    left, right, bottom, top = rectangle
    for k in range(4):
        x = left + (k - values[0]) * (right - left) / (values[1] - values[0])
        draw.text(pen, x, bottom, 0, draw.GREY, 12.0, draw.CENTRE, draw.TOP, 0.0, -5.0)
        draw.number(pen, 10.0**k, 0)
    for k in range(count):
        level = first + every * k
        y = bottom + (level - values[2]) * (top - bottom) / (values[3] - values[2])
        draw.text(pen, left, y, 0, draw.GREY, 12.0, draw.RIGHT, draw.MIDDLE, -6.0)
        if powers:
            draw.number(pen, 10.0**level, int(max(-level, 0.0)))
        else:
            draw.number(pen, level, 0)
    middle = 0.5 * (left + right)
    draw.text(pen, middle, bottom, _FREQUENCY, draw.INK, 12.0, draw.CENTRE, draw.TOP, 0.0, -22.0)
    draw.area(pen, rectangle, values)


@register_jitable
def _mark(pen, x, y, radius, ink):
    """Draw a mark at a point of a curve."""
    draw.spot(pen, x, y, radius, ink, draw.INK, 1.0)


@register_jitable
def _phase_at(curve, w):
    """Return the phase of L at a frequency, from the points of the curve [degrees]."""
    return np.interp(math.log10(w), curve[0], curve[3])


def frame(pen, state, controls):
    """Draw Bode plot, Nyquist plot and step response, and the numbers of the loop."""
    curve, growth, crossover = state["curve"], state["growth"], state["crossover"]
    logs, stable = curve[0], growth <= sampled.STABLE
    sizes = np.hypot(curve[1], curve[2])
    away = np.maximum(np.hypot(1.0 + curve[1], curve[2]), 1e-12)
    level = np.log10(np.maximum(sizes, 1e-12))
    phase_crossover, real, peak_at = state["phase_crossover"], state["crossing"], state["peak_at"]
    half = logs[_N - 1]
    # The cursor: the same frequency in all three plots of the loop.
    at = min(int(state["time"] / _PLAYED * (_N - 1)), _N - 1)

    # The gain, with both sensitivities where the loop is stable.
    _bode(pen, _UPPER, _SIZES, _SIZE, -2.0, 1.0, 5, True)
    draw.segment(pen, _LOW, 0.0, _HIGH, 0.0, draw.GREY, 1.4)
    draw.segment(pen, half, -2.2, half, 2.2, draw.GREY, 1.0, 1.0, 2.0, 3.0)
    if stable:
        draw.curve(
            pen, logs, np.log10(np.maximum(sizes / away, 1e-12)), draw.GREEN, 1.8, 1.0, 6.0, 4.0
        )
        draw.curve(pen, logs, -np.log10(away), draw.ORANGE, 1.8)
    draw.curve(pen, logs, level, draw.BLUE, 2.6)
    if real < 0.0:
        height = math.log10(-real)
        x = math.log10(phase_crossover)
        draw.segment(pen, x, height, x, 0.0, draw.PURPLE, 3.5)
        _mark(pen, x, height, 0.045, draw.PURPLE)
    if crossover > 0.0:
        _mark(pen, math.log10(crossover), 0.0, 0.045, draw.RED)
    if stable and state["peak"] < 100.0:
        _mark(pen, math.log10(peak_at), math.log10(state["peak"]), 0.045, draw.ORANGE)
    draw.spot(pen, logs[at], level[at], 0.055, draw.FAINT, draw.INK, 1.6)

    # The phase.
    _bode(pen, _LOWER, _LAGS, _ANGLE, -270.0, 90.0, 3, False)
    draw.segment(pen, _LOW, -180.0, _HIGH, -180.0, draw.GREY, 1.4)
    draw.segment(pen, half, -330.0, half, -30.0, draw.GREY, 1.0, 1.0, 2.0, 3.0)
    draw.curve(pen, logs, curve[3], draw.BLUE, 2.6)
    lag = -180.0
    if crossover > 0.0:
        lag = _phase_at(curve, crossover)
        x = math.log10(crossover)
        draw.segment(pen, x, lag, x, -180.0, draw.RED, 3.5)
        _mark(pen, x, lag, 0.045, draw.RED)
    if real < 0.0:
        _mark(pen, math.log10(phase_crossover), -180.0, 0.045, draw.PURPLE)
    draw.spot(pen, logs[at], curve[3, at], 0.055, draw.FAINT, draw.INK, 1.6)

    # The Nyquist plot: unit circle, -1 and the circle around it that the curve touches.
    draw.chart(pen, _RIGHT, _PLANE, _REAL, 0, _NYQUIST, 5, 4)
    turn = np.linspace(0.0, 2.0 * math.pi, 91)
    near = 1.0 / max(state["peak"], 1e-3)
    if stable:
        draw.polygon(pen, _DISC, draw.ORANGE, 1.2)
        draw.points(pen, near * np.cos(turn) - 1.0, near * np.sin(turn))
    draw.segment(pen, _PLANE[0], 0.0, _PLANE[1], 0.0, draw.GREY, 1.0)
    draw.segment(pen, 0.0, _PLANE[2], 0.0, _PLANE[3], draw.GREY, 1.0)
    draw.curve(pen, np.cos(turn), np.sin(turn), draw.GREY, 1.0, 1.0, 4.0, 4.0)
    # Points far out would only lengthen the line.
    far = 0
    while far < _N - 2 and sizes[far] > 30.0:
        far += 1
    draw.curve(pen, curve[1, far:], curve[2, far:], draw.BLUE, 2.6)
    if real < 0.0:
        draw.segment(pen, -1.0, 0.0, real, 0.0, draw.PURPLE, 3.5)
        _mark(pen, real, 0.0, 0.045, draw.PURPLE)
    if crossover > 0.0:
        arc = np.radians(np.linspace(-180.0, lag, 30))
        draw.curve(pen, np.cos(arc), np.sin(arc), draw.RED, 3.5)
        _mark(pen, math.cos(arc[29]), math.sin(arc[29]), 0.045, draw.RED)
    if stable:
        k = np.argmin(away)
        draw.segment(pen, -1.0, 0.0, curve[1, k], curve[2, k], draw.ORANGE, 2.2)
        _mark(pen, curve[1, k], curve[2, k], 0.045, draw.ORANGE)
    draw.spot(pen, curve[1, at], curve[2, at], 0.055, draw.FAINT, draw.INK, 1.6)
    draw.segment(pen, -1.08, -0.08, -0.92, 0.08, draw.INK, 2.4)
    draw.segment(pen, -1.08, 0.08, -0.92, -0.08, draw.INK, 2.4)
    draw.text(pen, -1.14, 0.1, _ONE, draw.INK, 13.0, draw.RIGHT, draw.BOTTOM)

    # The step response, up to where it has left the picture.
    n, horizon = state["samples"], state["horizon"]
    draw.chart(pen, _RUN, (0.0, horizon, *_HEIGHTS), _TIME, 0, _STEP, 5, 4)
    draw.theory(pen, np.array([0.0, horizon]), np.array([1.0, 1.0]))
    times, angle = state["step"][0, : n + 1], state["step"][1, : n + 1]
    draw.curve(pen, times, angle, draw.BLUE, 2.0)
    now = min(int(state["time"] / _PLAYED * n), n)
    draw.spot(pen, times[now], angle[now], 0.016 * horizon, draw.FAINT, draw.INK, 1.6)
    draw.window(pen)

    # What the colours mean.
    draw.key(pen, 0.95, 7.13, _L, draw.BLUE, 2.6)
    draw.key(pen, 1.95, 7.13, _S, draw.ORANGE, 1.8)
    draw.key(pen, 2.95, 7.13, _T, draw.GREEN, 1.8, 1.0, 6.0, 4.0)
    draw.key(pen, 4.2, 7.13, _MARGIN_G, draw.PURPLE, 3.5)
    draw.key(pen, 5.9, 7.13, _MARGIN_P, draw.RED, 3.5)
    draw.key(pen, 7.65, 7.13, _CIRCLE, draw.ORANGE, 2.2)

    limit = abs(growth - 1.0) < AT_LIMIT
    lost = _UNSTABLE if not stable else 0
    draw.reading(pen, _CROSSOVER, crossover, 1, _RAD, _NONE if crossover < 0.0 else 0)
    instead = lost if lost else (_NONE if state["bandwidth"] < 0.0 else 0)
    draw.reading(pen, _BANDWIDTH, state["bandwidth"], 1, _RAD, instead)
    instead = lost if lost else (_ANY if state["gain_margin"] < 0.0 else 0)
    draw.reading(pen, _MARGIN_G, state["gain_margin"], 2, _TIMES, instead)
    instead = lost if lost else (_ANY if state["phase_margin"] < 0.0 else 0)
    draw.reading(pen, _MARGIN_P, math.degrees(state["phase_margin"]), 1, _DEGREES, instead)
    draw.reading(pen, _DELAY, 1e3 * state["delay_margin"], 2, _MILLI, instead)
    huge = lost if lost else (_HUGE if state["peak"] > 1000.0 else 0)
    draw.reading(pen, _MS, state["peak"], 2, 0, huge)
    draw.reading(pen, _GROWTH, growth, 5)
    draw.reading(pen, _LOOP, 0.0, 0, 0, _LIMIT if limit else (_STABLE if stable else _UNSTABLE))
    draw.reading(pen, _PHASE_CROSSOVER, phase_crossover, 1, _RAD, _NONE if real >= 0.0 else 0)
    draw.reading(pen, _SWING, state["swing"], 1, _RAD, _NONE if state["swing"] < 0.0 else 0)


@register_jitable
def _within(rectangle, x, y):
    return rectangle[0] <= x <= rectangle[1] and rectangle[2] <= y <= rectangle[3]


def grab(controls, state, x, y):
    """Remember which plot the pointer is in."""
    controls["held"] = NOTHING
    if _within(_UPPER, x, y):
        controls["held"] = GAIN
    elif _within(_LOWER, x, y):
        controls["held"] = PHASE
    elif _within(_RIGHT, x, y):
        controls["held"] = NYQUIST


def drag(controls, state, x, y):
    """Handle a drag: the curve of the plot passes through the pointer.

    The gain moves |L| up and down and stretches the Nyquist plot, so that the curve crosses the
    real axis below the pointer. The delay lowers the phase.
    """
    curve, part = state["curve"], controls["held"]
    if part == GAIN or part == PHASE:
        rectangle, values = (_UPPER, _SIZES) if part == GAIN else (_LOWER, _LAGS)
        u, v = draw.values_at(rectangle, values, x, y)
        # Beyond the axes the pointer counts as at their ends, and L ends at half the sample rate.
        u = min(max(u, _LOW), curve[0, _N - 2])
        v = min(max(v, values[2]), values[3])
        if part == GAIN:
            size = np.interp(u, curve[0], np.hypot(curve[1], curve[2]))
            controls["kp"] = min(max(controls["kp"] * 10.0**v / max(size, 1e-9), 1.0), 400.0)
        else:
            more = math.radians(np.interp(u, curve[0], curve[3]) - v) / 10.0**u
            controls["delay"] = min(max(controls["delay"] + 1e3 * more, 0.0), 100.0)
    elif part == NYQUIST and state["crossing"] < 0.0:
        u, _ = draw.values_at(_RIGHT, _PLANE, x, y)
        u = min(max(u, _PLANE[0]), -0.02)
        controls["kp"] = min(max(controls["kp"] * u / state["crossing"], 1.0), 400.0)


# Limits of the first preset, and of the same with eight times the gain.
_KP, _LEAD, _LATE, _DT = 20.0, 0.4, 5.0, 1e-3


def limits_of(kp):
    """Return gain and delay margin [s] of the first preset with another gain."""
    at, lags, _, reals = sampled._gain_crossover(*parts_of(kp, 0.0, _LEAD * kp, _DT, 1e-3 * _LATE))
    gain, _, _, later = sampled._margins(at, lags, reals, _DT)
    return float(gain), float(later)


_TIMES_GAIN, _LATER = limits_of(_KP)
_HIGH_GAIN = limits_of(8.0 * _KP)
PRESETS = {
    "Comfortable": Preset(
        {},
        "The PD loop of the Bode plot. Drag |L| up in the first plot, and watch the curve come "
        "closer to -1 in the Nyquist plot while the step response rises faster.",
    ),
    "Gain at its margin": Preset(
        {"kp": _TIMES_GAIN * _KP},
        "Kp times its gain margin: the curve runs through -1. The step response oscillates for "
        "ever, at the phase crossover, where the curve crosses the real axis.",
    ),
    "Beyond the gain margin": Preset(
        {"kp": 1.05 * _TIMES_GAIN * _KP},
        "Five percent more: -1 is on the other side of the curve, and the oscillation grows.",
    ),
    "Delay at its margin": Preset(
        {"delay": _LATE + 1e3 * _LATER},
        "The same gains, and a delay that uses up the phase margin. Now the loop oscillates at "
        "its crossover, much more slowly.",
    ),
    "High sensitivity": Preset(
        {"kp": 8.0 * _KP},
        "A gain margin above 2 and a phase margin of 45 degrees look good, but the curve "
        "comes close to -1 between the two points: Ms is above 2.",
    ),
    "Half of both margins": Preset(
        {"kp": math.sqrt(_HIGH_GAIN[0]) * 8.0 * _KP, "delay": _LATE + 500.0 * _HIGH_GAIN[1]},
        "The loop before, with the square root of its gain margin and half of its delay margin at "
        "once. Each alone is fine; together they are too much.",
    ),
    "P alone": Preset(
        {"kd": 0.0},
        "Without Kd the curve passes -1 closely, and the step response rings for long. "
        "Raise Kd / Kp and watch the phase.",
    ),
    "With an integral": Preset(
        {"ki": 2.0},
        "The phase begins at -180 degrees, as two integrators lag by twice 90. At low frequency "
        "|S| is smaller than without Ki.",
    ),
    "Slow sampling": Preset(
        {"dt": 20.0, "delay": 0.0},
        "No delay, but a sample time of 20 ms. The hold alone lags by about half a sample, 10 ms. "
        "The dotted line is half the sample rate.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour, WINDOW)

# What each number below the picture means.
READOUTS = {
    "crossover": "The highest frequency at which |L| is 1.",
    "bandwidth": "The frequency at which |T| falls below 0.707: up to there the joint follows.",
    "gain margin": "Factor by which the gain can rise before the loop becomes unstable.",
    "phase margin": "Extra phase lag at the crossover that makes the loop unstable.",
    "delay margin": "Extra delay that makes the loop unstable.",
    "peak sensitivity Ms": "The largest |S|. The curve's smallest distance from -1 is 1 / Ms.",
    "growth a sample": (
        "Spectral radius of the closed loop's matrix: above 1 the loop is unstable. It is computed "
        "without the frequency response."
    ),
    "closed loop": "Whether the growth a sample is below 1, at 1 (to a millionth) or above it.",
    "phase crossover": (
        "Frequency at which L crosses the negative real axis, with a lag of 180 degrees. At the "
        "gain margin the loop oscillates at this frequency."
    ),
    "step oscillates at": (
        "Frequency measured in the step response, from the times at which it rises through 1."
    ),
}

MODEL = Model(
    TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, drag, grab, readouts=READOUTS
)
