"""Claims of chapter 6: the loop in the frequency domain."""

import math

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {"M": Symbol("peak sensitivity M_s", 1.1, 4.0)}


def _loop(kp, ki, kd, late, dt=1e-3):
    """Return (plant, law) of PID around the chapter's joint, the command late by so much [s]."""
    from course.control import sampled

    system = sampled.joint_system(0.5, 0.5)
    return sampled.held(*system, dt, late), sampled.pid_law(kp, ki, kd, dt=dt)


def _stable_loops(rng, n):
    """Return gains and delays of n stable PID loops, over decades of each gain."""
    from course.control import sampled

    result: list[tuple[float, float, float, float]] = []
    while len(result) < n:
        kp, ki, kd = 10.0 ** rng.uniform([0.0, -1.0, -1.0], [3.0, 3.0, 2.0])
        row = (float(kp), float(ki), float(kd), float(rng.uniform(0.0, 10e-3)))
        if sampled.growth(sampled.loop_matrix(*_loop(*row))) < 1.0:
            result.append(row)
    return result


@claim(
    "In a stable loop, a peak sensitivity of at most 2 guarantees a gain margin of at least 2 and "
    "a phase margin of at least 29 degrees.",
    "Let M be the peak sensitivity. The Nyquist curve stays at least 1/M away from -1. So the gain "
    "margin is at least M/(M - 1) and the phase margin at least {formula}, which is "
    "{phase_deg:.1f} degrees for M = {limit:g}. Of {draws:.0f} random stable PID loops with a "
    "delay, {inside:.0f} have an M of at most {limit:g}; their smallest margins are "
    "{gain:.2f} and {least_deg:.0f} degrees.",
    ask=(
        "The Nyquist curve is never closer to -1 than 1/M. Where it crosses the unit circle, which "
        "phase margin does it have at least?",
        "phi, phase > 2*asin(1/(2*M))",
        {
            "asin(1/M)": "That is the angle of a tangent. The distance is a chord of the circle.",
            "1/M": "That is the length of the chord, not its angle.",
            "2*asin(1/M)": "Half of the chord is opposite to half of the angle.",
        },
    ),
    source="K. J. Astrom, R. M. Murray, Feedback Systems, 2008, chapters 9 and 11",
)
def peak_sensitivity_bounds_margins(result):
    import sympy

    from course.control import frequency, sampled

    M, phi = sympy.symbols("M phi", positive=True)
    # On the unit circle, with the phase margin phi, L is -e^(i phi): its distance from -1.
    distance = 2 * sympy.sin(phi / 2)
    circle = sympy.sqrt((1 - sympy.cos(phi)) ** 2 + sympy.sin(phi) ** 2)
    result.formula = min(sympy.solve(sympy.Eq(distance, 1 / M), phi), key=lambda x: x.subs(M, 2.0))
    limit = result.input("limit", 2)
    bound = sympy.lambdify(M, result.formula)
    result.measure("phase_deg", math.degrees(bound(limit)))
    rows = _stable_loops(result.rng, int(result.input("draws", 60)))
    shapes = [frequency.loop_shape(*_loop(*row)) for row in rows]
    margins = [sampled.crossings(*_loop(*row)) for row in rows]

    def growth(row, times):
        """Return the growth of a loop per sample with its gains multiplied by a factor."""
        kp, ki, kd, late = row
        return sampled.growth(sampled.loop_matrix(*_loop(times * kp, times * ki, times * kd, late)))

    inside = [m for s, m in zip(shapes, margins, strict=True) if s.peak <= limit]
    result.measure("inside", len(inside) + 0.0 * shapes[0].peak, 1e-6)
    result.measure("gain", min(m.gain for m in inside), 1e-3)
    result.measure("least_deg", math.degrees(min(m.phase for m in inside)), 1e-3)
    result.statement = (
        "Margins of random PID loops, against the peak of their |S|, and the eigenvalues."
    )
    result.statement_holds(
        len(inside) > 10 and all(m.gain >= 2.0 and m.phase > math.radians(28.9) for m in inside)
    )
    result.correction_holds(
        abs(float((distance - circle).subs(phi, 0.7))) < 1e-12,
        all(
            m.gain >= s.peak / (s.peak - 1.0) - 1e-6 and m.phase >= bound(s.peak) - 1e-6
            for s, m in zip(shapes, margins, strict=True)
        ),
        # A second route to the gain margin, by the eigenvalues of the loop with higher gains.
        all(
            growth(row, 0.999 * s.peak / (s.peak - 1.0)) <= 1.0
            for row, s in zip(rows, shapes, strict=True)
            if s.peak < 20.0
        ),
        # Somewhere the bound on the phase is reached almost: it can't be raised.
        min(m.phase / bound(s.peak) for s, m in zip(shapes, margins, strict=True)) < 1.05,
    )


@claim(
    "With higher gains a loop rejects disturbances better at every frequency.",
    "What it gains at low frequencies it loses at high ones. Averaged over all frequencies up to "
    "half the sample rate, the logarithm of |S| is zero, here to {worst:.0e} in {draws:.0f} random "
    "stable loops. With {factor:g} times the gains, |S| of the chapter's loop at {slow:g} rad/s "
    "falls from {slow_before:.3f} to {slow_after:.3f}, and its peak rises from {peak_before:.2f} "
    "to {peak_after:.2f}.",
    source="H. Sung, S. Hara, Properties of sensitivity and complementary sensitivity functions "
    "in single-input single-output digital control systems, 1988",
)
def more_gain_rejects_everywhere(result):
    from course.control import frequency

    factor, slow = result.input("factor", 8), result.input("slow", 2)
    kp, kd, late = result.input("kp", 20.0), result.input("kd", 8.0), result.input("late_ms", 5)

    def sensitivity(times, w):
        """Return |S| of the chapter's loop with its gains multiplied by a factor."""
        plant, law = _loop(times * kp, 0.0, times * kd, late / 1000)
        return np.abs(frequency.response(plant, law, w).sensitivity)

    before, after = (
        frequency.loop_shape(*_loop(x * kp, 0.0, x * kd, late / 1000)) for x in (1, factor)
    )
    result.measure("slow_before", sensitivity(1, slow)[0])
    result.measure("slow_after", sensitivity(factor, slow)[0])
    result.measure("peak_before", before.peak, 1e-4)
    result.measure("peak_after", after.peak, 1e-4)

    def mean(row):
        """Return the average of log |S| over the frequencies, in the turn of a sample."""
        # Gauss-Legendre, each decade by itself: the logarithm has a pole at 0, and S has peaks.
        ends = np.array([0.0, *np.geomspace(1e-5, math.pi, 24)])
        at, weights = np.polynomial.legendre.leggauss(100)
        half = 0.5 * np.diff(ends)[:, None]
        turns = ends[:-1, None] + half * (1.0 + at)
        plant, law = _loop(*row)
        S = frequency.response(plant, law, turns.ravel() / 1e-3).sensitivity
        return float(np.sum(half * weights * np.log(np.abs(S)).reshape(turns.shape)) / math.pi)

    rows = _stable_loops(result.rng, int(result.input("draws", 8)))
    worst = max(abs(mean(row)) for row in rows)
    result.measure("worst", max(worst, 1e-7), 0.5)
    result.statement = "The exact response of the sampled loop; its logarithm by quadrature."
    w = frequency.frequencies(1e-3)
    result.statement_holds(np.all(sensitivity(factor, w) <= sensitivity(1, w)))
    result.correction_holds(
        worst < 1e-5,
        sensitivity(factor, slow)[0] < sensitivity(1, slow)[0] / 4,
        after.peak > 1.5 * before.peak > 1.5,
    )
