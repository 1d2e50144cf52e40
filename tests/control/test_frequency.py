"""The loop in the frequency domain: against SciPy's sampled systems, and the exact margins."""

import itertools
import math

import numpy as np
import pytest
from scipy import integrate, signal

from course.control import frequency, sampled

DT = 2e-3
# kp, ki, kd, delay in samples, inertia, damping: stable loops of some bandwidths.
LOOPS = [
    (20.0, 0.0, 4.0, 0, 0.5, 0.5),
    (20.0, 20.0, 8.0, 3, 0.5, 0.5),
    (150.0, 300.0, 12.0, 2, 0.3, 0.1),
    (2.0, 1.0, 0.3, 5, 0.05, 0.2),
]


def transfer(kp, ki, kd, delay, inertia, damping):
    """Return the open loop as SciPy has it: numerator and denominator in z."""
    plant = ([1.0], [inertia, damping, 0.0])
    top, bottom, _ = signal.cont2discrete(plant, DT, "zoh")
    # kp + ki dt z / (z - 1) + kd (z - 1) / (z dt): backward Euler and backward difference.
    law = np.polyadd(
        np.polyadd(kp * np.array([1.0, -1.0, 0.0]), ki * DT * np.array([1.0, 0.0, 0.0])),
        kd / DT * np.array([1.0, -2.0, 1.0]),
    )
    over = np.polymul([1.0, -1.0, 0.0], [1.0] + [0.0] * delay)
    return np.polymul(np.ravel(top), law), np.polymul(bottom, over)


def loop(kp, ki, kd, delay, inertia, damping):
    plant = sampled.held(*sampled.joint_system(inertia, damping), DT, delay * DT)
    return plant, sampled.pid_law(kp, ki, kd, dt=DT)


@pytest.mark.parametrize("case", LOOPS)
def test_the_open_and_the_closed_loop_are_those_of_scipy(case) -> None:
    # Three decades: further down the poles at z = 1 cancel digits of SciPy's polynomials.
    plant, law = loop(*case)
    response = frequency.response(plant, law, frequency.frequencies(DT, 300, 3.0)[:-1])
    top, bottom = transfer(*case)
    _, L = signal.dfreqresp(signal.dlti(top, bottom, dt=DT), response.w * DT)
    assert response.loop == pytest.approx(L, rel=1e-6)
    # The closed loop as a system of its own, whose numerator and denominator are added up.
    closed = signal.dlti(top, np.polyadd(bottom, top), dt=DT)
    _, T = signal.dfreqresp(closed, response.w * DT)
    assert response.complementary == pytest.approx(T, rel=1e-6)
    assert response.sensitivity + response.complementary == pytest.approx(np.ones(response.w.size))


@pytest.mark.parametrize("case", LOOPS)
def test_margins_at_the_crossover_are_the_exact_ones(case) -> None:
    plant, law = loop(*case)
    shape = frequency.loop_shape(plant, law)
    margins = sampled.margins(*sampled.joint_system(*case[4:]), law, DT, case[3] * DT)
    at = frequency.response(plant, law, shape.crossover)
    assert at.size[0] == pytest.approx(1.0, abs=1e-9)
    assert at.phase[0] + math.pi == pytest.approx(margins.phase, abs=1e-9)
    # A hold of a part of a sample is no pure delay, so a twentieth is allowed.
    assert (at.phase[0] + math.pi) / shape.crossover == pytest.approx(margins.delay, rel=0.05)


@pytest.mark.parametrize("case", LOOPS)
def test_the_peak_is_the_inverse_of_the_distance_to_minus_one(case) -> None:
    plant, law = loop(*case)
    shape = frequency.loop_shape(plant, law)
    w = np.linspace(1e-6, 1.0, 100_001)[:-1] * math.pi / DT
    response = frequency.response(plant, law, w)
    assert shape.peak == pytest.approx(1.0 / np.min(np.abs(1.0 + response.loop)), rel=1e-6)
    assert shape.peak >= np.max(np.abs(response.sensitivity)) - 1e-12
    assert shape.resonance == pytest.approx(np.max(np.abs(response.complementary)), rel=1e-6)
    assert abs(frequency.response(plant, law, shape.peak_at).sensitivity[0]) == pytest.approx(
        shape.peak
    )
    below = w[np.argmax(np.abs(response.complementary) < math.sqrt(0.5))]
    assert shape.bandwidth == pytest.approx(below, abs=w[1] - w[0])


@pytest.mark.parametrize("case", LOOPS)
def test_the_logarithm_of_the_sensitivity_averages_to_zero(case) -> None:
    plant, law = loop(*case)

    def log_size(turn):
        return math.log(abs(frequency.response(plant, law, turn / DT).sensitivity[0]))

    parts = [0.0, 1e-4, 1e-3, 1e-2, 0.1, 0.5, math.pi]
    total = sum(integrate.quad(log_size, a, b, limit=200)[0] for a, b in itertools.pairwise(parts))
    assert total / math.pi == pytest.approx(0.0, abs=1e-6)


def test_a_sine_through_the_closed_loop_is_scaled_by_t() -> None:
    """A run of the loop in time, at one frequency: the set-point's share that arrives."""
    kp, ki, kd, delay, inertia, damping = LOOPS[0]
    top, bottom = transfer(kp, ki, kd, delay, inertia, damping)
    w = 9.0
    t = DT * np.arange(6000)
    closed = signal.dlti(top, np.polyadd(bottom, top), dt=DT)
    _, y = signal.dlsim(closed, np.sin(w * t))
    late = np.linalg.lstsq(
        np.column_stack([np.sin(w * t), np.cos(w * t)])[3000:], np.ravel(y)[3000:], rcond=None
    )[0]
    plant, law = loop(*LOOPS[0])
    T = frequency.response(plant, law, w).complementary[0]
    assert complex(*late) == pytest.approx(T, rel=1e-6)


def test_bode_phase_has_no_jumps_and_begins_at_an_integrators_lag() -> None:
    response = frequency.response(*loop(*LOOPS[0]))
    assert response.phase[0] == pytest.approx(-0.5 * math.pi, abs=0.02)
    assert np.max(np.abs(np.diff(response.phase[:-1]))) < 0.5
    assert response.size[0] > 1.0 > response.size[-1]


def test_an_unstable_loop_has_no_shape() -> None:
    with pytest.raises(ValueError, match="stable"):
        frequency.loop_shape(*loop(20.0, 0.0, 4.0, 200, 0.5, 0.5))


def test_a_loop_without_crossover_says_so() -> None:
    """A gain so low that |L| is above 1 nowhere on the grid, on a plant with a spring."""
    plant = sampled.held(np.array([[0.0, 1.0], [-100.0, -4.0]]), np.array([0.0, 1.0]), DT)
    shape = frequency.loop_shape(plant, sampled.pid_law(5.0, dt=DT))
    assert shape.crossover == 0.0
    assert shape.bandwidth == 0.0
    assert shape.peak < 1.5
