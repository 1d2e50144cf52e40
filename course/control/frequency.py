"""The sampled loop in the frequency domain: Bode and Nyquist data, sensitivity, bandwidth.

Feed a sine into the loop, cut at the command: what comes back, with the minus sign of the feedback
taken off, is the open loop L. Once the loop is closed, S = 1 / (1 + L) says what is left of a
disturbance, and T = L / (1 + L) what arrives of a set-point. Both come from the exact response of
the sampled loop (`course.control.sampled.open_loop`), with its hold and its delay.

Astrom and Murray, Feedback Systems, describes the loop and its sensitivities; Sung and Hara,
Properties of sensitivity and complementary sensitivity functions in single-input single-output
digital control systems, 1988, the integral of the logarithm of S.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid
from course.control.sampled import STABLE, Held, Law, growth, loop_matrix, open_loop

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


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
    # Log spacing for the low end, linear for narrow peaks near half the sample rate.
    half = math.pi / plant.dt
    w = np.union1d(frequencies(plant.dt), np.linspace(1e-3, 1.0, 1000) * half)
    grid = response(plant, law, w)

    def closer(low: float, high: float) -> Response:
        return response(plant, law, np.linspace(low, high, 40))

    def fall(read: Callable[[Response], Array], level: float, last: bool) -> float:
        """Return where a curve falls through a level: bracketed on ever finer grids."""
        y = read(grid)
        falls = np.flatnonzero((y[:-1] >= level) & (y[1:] < level))
        if not falls.size:
            return math.inf if y[-1] >= level else 0.0
        k = falls[-1 if last else 0]
        low, high = float(w[k]), float(w[k + 1])
        for _ in range(8):
            fine = closer(low, high)
            k = int(np.argmax(read(fine) < level))
            low, high = float(fine.w[max(k - 1, 0)]), float(fine.w[k])
        return 0.5 * (low + high)

    def top(read: Callable[[Response], Array]) -> tuple[float, float]:
        """Return the largest value of a curve and where it is, likewise."""
        fine = grid
        for _ in range(6):
            k = int(np.argmax(read(fine)))
            fine = closer(float(fine.w[max(k - 1, 0)]), float(fine.w[min(k + 1, fine.w.size - 1)]))
        k = int(np.argmax(read(fine)))
        return float(read(fine)[k]), float(fine.w[k])

    def sensitivity(x: Response) -> Array:
        return np.abs(x.sensitivity)

    def complementary(x: Response) -> Array:
        return np.abs(x.complementary)

    peak, peak_at = top(sensitivity)
    return LoopShape(
        crossover=fall(lambda x: x.size, 1.0, True),
        bandwidth=fall(complementary, math.sqrt(0.5), False),
        peak=peak,
        peak_at=peak_at,
        resonance=top(complementary)[0],
    )
