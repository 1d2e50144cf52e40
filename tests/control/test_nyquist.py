"""The loop that is dragged: against SciPy's sampled systems, and its limits from both sides."""

import math

import numpy as np
import pytest
from scipy import signal

from course import control
from course.control import frequency
from course.simulations.control import nyquist
from course.simulations.model import Experiment
from tests.budget import sampled


def chosen(preset="Comfortable", **values):
    experiment = Experiment(nyquist.MODEL)
    experiment.choose(preset)
    if values:
        experiment.set(**values)
    return experiment


def loop_of(controls):
    """Return the loop as the chapter has it: system, law, sample time and delay."""
    dt, kp = 1e-3 * controls["dt"], controls["kp"]
    law = control.pid_law(kp, kp * controls["ki"], kp * controls["kd"], dt=dt)
    return control.joint_system(nyquist.INERTIA, nyquist.DAMPING), law, dt, 1e-3 * controls["delay"]


def transfer(controls):
    """Return L as SciPy has it, for a delay of whole samples: numerator and denominator in z."""
    dt, kp = 1e-3 * controls["dt"], controls["kp"]
    plant = ([1.0], [nyquist.INERTIA, nyquist.DAMPING, 0.0])
    top, bottom, _ = signal.cont2discrete(plant, dt, "zoh")
    rate = controls["kd"] / dt * np.array([1.0, -1.0])
    law, over = np.polyadd([1.0, 0.0], rate), np.array([1.0, 0.0])
    # Without an integral its pole would cancel; SciPy would count it as one of the loop.
    if controls["ki"]:
        law = np.polyadd(np.polymul(law, [1.0, -1.0]), [controls["ki"] * dt, 0.0, 0.0])
        over = np.polymul(over, [1.0, -1.0])
    law, over = kp * law, np.append(over, np.zeros(round(1e-3 * controls["delay"] / dt)))
    return np.polymul(np.ravel(top), law), np.polymul(bottom, over)


SETTINGS = [
    {},
    {"kp": 160.0},
    {"kp": 60.0, "ki": 3.0, "delay": 12.0},
    {"kd": 0.0},
    {"dt": 20.0, "delay": 40.0, "ki": 0.5},
    {"kp": 400.0},
]


@pytest.mark.parametrize("values", sampled(SETTINGS, 2))
def test_curve_and_step_response_are_those_of_scipy(values):
    experiment = chosen(**values)
    state, dt = experiment.state, 1e-3 * experiment.controls["dt"]
    top, bottom = transfer(experiment.controls)
    turns = 10.0 ** state["curve"][0] * dt
    _, L = signal.dfreqresp(signal.dlti(top, bottom, dt=dt), turns)
    drawn = state["curve"][1] + 1j * state["curve"][2]
    assert np.max(np.abs(drawn - L) / (np.abs(L) + 1e-3)) < 1e-5
    phase = np.exp(1j * np.radians(state["curve"][3]))
    # At half the sample rate L of some loops is 0.
    large = np.abs(L) > 1e-6 * np.max(np.abs(L))
    assert np.max(np.abs(phase - L / np.abs(L))[large]) < 1e-4
    n = int(state["samples"])
    times, angle = state["step"][:, : n + 1]
    closed = signal.dlti(top, np.polyadd(bottom, top), dt=dt)
    _, (expected,) = signal.dstep(closed, n=round(times[-1] / dt) + 1)
    expected = expected[np.round(times / dt).astype(int), 0]
    assert np.max(np.abs(angle - expected) / (1.0 + np.abs(expected))) < 1e-5
    poles = np.max(np.abs(closed.poles))
    assert state["growth"] == pytest.approx(poles, abs=1e-5)


@pytest.mark.parametrize("values", [*SETTINGS[:-1], {"delay": 7.3}, {"dt": 5.0, "delay": 12.0}])
def test_the_numbers_are_the_exact_ones_of_the_chapter(values):
    experiment = chosen(**values)
    state = experiment.state
    (A, B), law, dt, delay = loop_of(experiment.controls)
    exact = control.margins(A, B, law, dt, delay)
    shape = frequency.loop_shape(control.held(A, B, dt, delay), law)
    assert state["gain_margin"] == pytest.approx(exact.gain, rel=1e-9)
    assert state["phase_margin"] == pytest.approx(exact.phase, rel=1e-9)
    # A hold of a part of a sample is no pure delay.
    assert state["delay_margin"] == pytest.approx(exact.delay, rel=0.01)
    assert state["crossover"] == pytest.approx(shape.crossover, rel=1e-9)
    assert state["bandwidth"] == pytest.approx(shape.bandwidth, rel=1e-9)
    assert state["peak"] == pytest.approx(shape.peak, rel=1e-9)
    # The drawn curve comes as close to -1 as the peak sensitivity says.
    near = np.min(np.hypot(1.0 + state["curve"][1], state["curve"][2]))
    assert near == pytest.approx(1.0 / state["peak"], rel=2e-3)


def amplitudes(experiment):
    """Return the largest distance from the set-point in the middle and at the end of the run."""
    n = int(experiment.state["samples"])
    thirds = np.array_split(np.abs(experiment.state["step"][1, : n + 1] - 1.0), 3)
    return [float(np.max(third)) for third in thirds[1:]]


@pytest.mark.parametrize(("name", "margin"), [("kp", "gain"), ("delay", "delay")])
def test_it_decays_below_a_margin_and_grows_above(name, margin):
    start = chosen()
    if margin == "gain":
        limit = start.controls["kp"] * start.state["gain_margin"]
    else:
        limit = start.controls["delay"] + 1e3 * start.state["delay_margin"]
    below, above = (chosen(**{name: factor * limit}) for factor in (0.99, 1.01))
    assert below.state["growth"] < 1.0 < above.state["growth"]
    middle, end = amplitudes(below)
    assert end < 0.99 * middle
    middle, end = amplitudes(above)
    assert end > 1.01 * middle


@pytest.mark.parametrize(
    ("preset", "predicted"),
    [("Gain at its margin", "phase_crossover"), ("Delay at its margin", "crossover")],
)
def test_at_a_margin_the_step_swings_with_the_predicted_frequency(preset, predicted):
    of_start = chosen().state[predicted]
    experiment = chosen(preset)
    state = experiment.state
    assert state["growth"] == pytest.approx(1.0, abs=1e-6)
    assert state["swing"] == pytest.approx(of_start, rel=5e-3)
    assert state["crossing"] == pytest.approx(-1.0, abs=1e-4)
    numbers = experiment.picture().numbers
    assert numbers["closed loop"] == "at its limit"
    assert (numbers["gain margin"], numbers["phase margin"]) == ("1.00×", "0.0°")
    middle, end = amplitudes(experiment)
    assert end == pytest.approx(middle, rel=0.02)


def test_the_presets_show_what_they_say():
    assert chosen("Beyond the gain margin").picture().numbers["closed loop"] == "unstable"
    high = chosen("High sensitivity")
    assert high.state["gain_margin"] > 2.0 and math.degrees(high.state["phase_margin"]) > 45.0
    assert high.state["peak"] > 2.0
    both = chosen("Half of both margins").controls
    assert chosen("Half of both margins").state["growth"] > 1.0
    assert chosen("High sensitivity", kp=both["kp"]).state["growth"] < 1.0
    assert chosen("High sensitivity", delay=both["delay"]).state["growth"] < 1.0
    alone = chosen("P alone")
    assert alone.state["peak"] > 5.0 > chosen("P alone", kd=0.1).state["peak"]
    assert alone.state["swing"] == pytest.approx(alone.state["crossover"], rel=0.02)
    integral = chosen("With an integral").state
    assert integral["curve"][3, 0] < -150.0

    def sensitivity(state):
        return 1.0 / math.hypot(1.0 + state["curve"][1, 0], state["curve"][2, 0])

    assert sensitivity(integral) < sensitivity(chosen().state)
    # Half a sample of delay has almost the same margins as the hold.
    slow, late = chosen("Slow sampling", kd=0.0).state, chosen(kd=0.0, dt=1.0, delay=9.5).state
    assert slow["phase_margin"] == pytest.approx(late["phase_margin"], rel=0.02)


@pytest.mark.parametrize("point", [(2.0, 5.9), (3.0, 4.9), (1.2, 6.4)])
def test_a_dragged_gain_curve_passes_through_the_pointer(point):
    experiment = chosen()
    experiment.grab(*point)
    experiment.drag(*point)
    curve = experiment.state["curve"]
    u, v = nyquist.draw.values_at(nyquist._UPPER, nyquist._SIZES, *point)
    sizes = np.log10(np.hypot(curve[1], curve[2]))
    assert np.interp(u, curve[0], sizes) == pytest.approx(v, abs=2e-3)
    assert experiment.controls["delay"] == 5.0


def test_a_dragged_phase_curve_passes_through_the_pointer_and_the_gain_stays():
    experiment = chosen()
    x, y = 3.1, 1.6
    experiment.grab(x, y)
    experiment.drag(x, y)
    curve = experiment.state["curve"]
    u, v = nyquist.draw.values_at(nyquist._LOWER, nyquist._LAGS, x, y)
    assert np.interp(u, curve[0], curve[3]) == pytest.approx(v, abs=0.3)
    assert 5.0 < experiment.controls["delay"] < 100.0 and experiment.controls["kp"] == 20.0


def test_a_dragged_nyquist_plot_crosses_the_axis_below_the_pointer():
    experiment = chosen()
    experiment.grab(7.0, 5.0)
    experiment.drag(7.0, 5.0)
    u, _ = nyquist.draw.values_at(nyquist._RIGHT, nyquist._PLANE, 7.0, 5.0)
    assert u < 0.0 and experiment.state["crossing"] == pytest.approx(u, rel=1e-6)
    # In the step response there is nothing to drag.
    before = experiment.picture().data.tobytes()
    experiment.grab(7.0, 2.0)
    experiment.drag(7.5, 2.5)
    assert experiment.picture().data.tobytes() == before
