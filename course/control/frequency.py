"""The sampled loop in the frequency domain: Bode and Nyquist data, sensitivity, bandwidth.

Feed a sine into the loop, cut at the command: what comes back, with the minus sign of the feedback
taken off, is the open loop L. Once the loop is closed, S = 1 / (1 + L) says what is left of a
disturbance, and T = L / (1 + L) how much of the sensor's noise the joint follows, and of the
set-point if P, I and D all act on the error. Both come from the exact response of the sampled loop
(`course.control.sampled.open_loop`), with its hold and its delay.

Astrom and Murray, Feedback Systems, describes the loop and its sensitivities; Sung and Hara,
Properties of sensitivity and complementary sensitivity functions in single-input single-output
digital control systems, 1988, the integral of the logarithm of S.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid
from course.compiled import loop
from course.control.sampled import (
    _PARTS,
    STABLE,
    Held,
    Law,
    _parts,
    _response,
    _responses,
    growth,
    loop_matrix,
    open_loop,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LOOP, _SENSITIVITY, _COMPLEMENTARY = range(3)  # the curves of `_height`


@dataclass(frozen=True)
class Response:
    """Response of a loop to sines.

    Attributes:
        w: angular frequencies, shape (n,) [rad/s].
        loop: the open loop L at these, complex, shape (n,).
    """

    w: Array
    loop: Complex

    @property
    def size(self) -> Array:
        """The open-loop gain |L|, shape (n,)."""
        return np.abs(self.loop)

    @property
    def phase(self) -> Array:
        """The phase of L without jumps, shape (n,) [rad]; the first one is in (-2 pi, 0]."""
        phase = np.unwrap(np.angle(self.loop))
        return np.asarray(phase - 2.0 * math.pi * math.ceil(phase[0] / (2.0 * math.pi)))

    @property
    def sensitivity(self) -> Complex:
        """S = 1 / (1 + L), shape (n,)."""
        return np.asarray(1.0 / (1.0 + self.loop))

    @property
    def complementary(self) -> Complex:
        """T = L / (1 + L), shape (n,); S + T is 1."""
        return np.asarray(self.loop / (1.0 + self.loop))


@dataclass(frozen=True)
class LoopShape:
    """Key figures of a stable loop in the frequency domain.

    Attributes:
        crossover: the highest frequency at which |L| falls through 1 [rad/s].
        bandwidth: the lowest frequency at which |T| falls through 1 / sqrt(2) [rad/s]; infinite if
            it does not up to half the sample rate.
        peak: the largest |S|, called M_s; 1 / peak is the distance of L from -1.
        peak_at: the frequency of that [rad/s].
        resonance: the largest |T|, called M_t.
    """

    crossover: float
    bandwidth: float
    peak: float
    peak_at: float
    resonance: float


def frequencies(dt: float, points: int = 2000, decades: float = 5.0) -> Array:
    """Return angular frequencies up to half the sample rate, evenly spaced on a log scale [rad/s].

    Args:
        dt: sample time [s].
        points: how many, at least 2.
        decades: the lowest is this many powers of ten below the highest.
    """
    return np.asarray(np.geomspace(10.0**-decades, 1.0, count("points", points, 2)) * math.pi / dt)


def response(plant: Held, law: Law, w: ArrayLike | None = None) -> Response:
    """Return the response of a loop to sines.

    Args:
        plant: with its hold and delay, see `course.control.held`.
        law: the controller, made for the same sample time.
        w: angular frequencies [rad/s], or None for those of `frequencies`.
    """
    at = frequencies(plant.dt) if w is None else np.atleast_1d(np.asarray(w, dtype=float))
    return Response(at, open_loop(plant, law, at))


def loop_shape(plant: Held, law: Law) -> LoopShape:
    """Return crossover, bandwidth and the peaks of S and T of a stable loop.

    Raises:
        ValueError: the closed loop is unstable, so that it has no response to sines.
    """
    if growth(loop_matrix(plant, law)) > STABLE:
        raise invalid("law", law, "a controller with which the loop is stable")
    crossover, bandwidth, peak, peak_at, resonance = _shaped(*_parts(plant, law))
    return LoopShape(
        crossover=float(crossover / plant.dt),
        bandwidth=float(bandwidth / plant.dt),
        peak=float(peak),
        peak_at=float(peak_at / plant.dt),
        resonance=float(resonance),
    )


@register_jitable
def _height(value, curve):
    """Return |L|, |S| or |T| of an open loop L."""
    # A loop at its limit may meet -1 exactly.
    away = max(abs(1.0 + value), 1e-300)
    if curve == _LOOP:
        return abs(value)
    return 1.0 / away if curve == _SENSITIVITY else abs(value) / away


@register_jitable
def _fall(turns, values, curve, level, last, parts):
    """Return where a curve falls through a level, the first or the last time [rad a sample].

    It is 0 if the curve is below the level throughout, infinity if it stays above.
    """
    k, above = -1, _height(values[0], curve) >= level
    for i in range(turns.size - 1):
        higher, above = above, _height(values[i + 1], curve) >= level
        if higher and not above and (last or k < 0):
            k = i
    if k < 0:
        return math.inf if above else 0.0
    low, high = turns[k], turns[k + 1]
    for _ in range(50):
        middle = 0.5 * (low + high)
        if _height(_response(*parts, middle), curve) >= level:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@register_jitable
def _top(turns, values, curve, parts):
    """Return the largest value of a curve and where it is [rad a sample], on ever finer grids."""
    for _ in range(6):
        heights = np.array([_height(value, curve) for value in values])
        k = np.argmax(heights)
        turns = np.linspace(turns[max(k - 1, 0)], turns[min(k + 1, turns.size - 1)], 40)
        values = _responses(*parts, turns)
    heights = np.array([_height(value, curve) for value in values])
    k = np.argmax(heights)
    return heights[k], turns[k]


@register_jitable
def _shape(transition, now, before, whole, A, B, C, D):
    """Return the five of `LoopShape`, with frequencies in rad a sample."""
    parts = (transition, now, before, whole, A, B, C, D)
    # Log spacing for the low end, linear for narrow peaks near half the sample rate.
    low, high = 10.0 ** np.linspace(-5.0, -1.3, 1500), np.linspace(10.0**-1.3, 1.0, 950)
    turns = math.pi * np.concatenate((low, high[1:]))
    values = _responses(*parts, turns)
    peak, peak_at = _top(turns, values, _SENSITIVITY, parts)
    return (
        _fall(turns, values, _LOOP, 1.0, True, parts),
        _fall(turns, values, _COMPLEMENTARY, math.sqrt(0.5), False, parts),
        peak,
        peak_at,
        _top(turns, values, _COMPLEMENTARY, parts)[0],
    )


_shaped = loop(_shape, types.UniTuple(numba.float64, 5)(*_PARTS))
