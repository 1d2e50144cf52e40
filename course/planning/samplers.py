"""Where planners draw states from: everywhere, in a low-discrepancy order, near what is in the way.

A sampler other than `UNIFORM` and `HALTON` looks for a free state near obstacles and asks the state
test while it does; after `TRIES` without one it draws uniformly. Each counts its questions in
`counts[STATE_CHECKS]`. Sources: Halton (1960), shifted at random (Cranley and Patterson, 1976);
Gaussian (Boor, Overmars and van der Stappen, 1999); bridge test (Hsu, Jiang, Reif and Sun, 2003);
obstacle-based (Amato, Bayazit, Dale, Jones and Vallejo, 1998).
"""

import numpy as np
from numba.extending import register_jitable

UNIFORM, HALTON, GAUSSIAN, BRIDGE, OBSTACLE = range(5)
LISTED = 5  # states of the caller, one after the other; of trees only
SAMPLERS = {
    "uniform": UNIFORM,
    "halton": HALTON,
    "gaussian": GAUSSIAN,
    "bridge": BRIDGE,
    "obstacle": OBSTACLE,
}
TRIES = 100
HALVINGS = 10  # of the way to an obstacle's surface
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29)  # bases of Halton's sequence: at most ten dimensions

# What a compiled loop counts, in one array of whole numbers that it is handed; the rest is its own.
SAMPLES, STATE_CHECKS, EDGE_CHECKS, DRAWN = 0, 1, 2, 3


@register_jitable
def uniform(low, high, rng, out):
    """Draw a state between two corners; where they are equal no number is drawn."""
    for i in range(out.size):
        out[i] = low[i]
        if high[i] > low[i]:
            out[i] += (high[i] - low[i]) * rng.random()


@register_jitable
def _halton(index, bounds, shift, out):
    """Term `index` of Halton's sequence, each coordinate shifted around the unit interval."""
    for i in range(out.size):
        # Radical inverse in base p: mirror the digits of the index behind the point.
        value, digit, k = shift[i], 1.0, index
        while k > 0:
            digit /= PRIMES[i]
            value += digit * (k % PRIMES[i])
            k //= PRIMES[i]
        out[i] = bounds[0, i] + (bounds[1, i] - bounds[0, i]) * (value % 1.0)


@register_jitable
def _nearby(q, bounds, spread, rng, out):
    """Draw a state at a normally distributed distance from q, clipped to the bounds."""
    for i in range(out.size):
        out[i] = min(max(q[i] + spread * rng.standard_normal(), bounds[0, i]), bounds[1, i])


@register_jitable
def draw(kind, state_free, obstacles, body, bounds, spread, shift, counts, rng, out):
    """Draw one state into `out`.

    Args:
        kind: one of the numbers of `SAMPLERS`.
        state_free: the compiled check of a state.
        obstacles: the obstacles that it reads.
        body: the robot that it reads.
        bounds: lowest and highest states, shape (2, n).
        spread: standard deviation of the partner of a Gaussian, the half bridge.
        shift: of Halton's sequence, shape (n,), from 0 to 1.
        counts: counters, see the top of the module; DRAWN is the position in Halton's sequence.
        rng: random numbers.
        out: a state, filled.
    """
    if kind == HALTON:
        counts[DRAWN] += 1
        _halton(counts[DRAWN], bounds, shift, out)
        return
    uniform(bounds[0], bounds[1], rng, out)
    if kind == UNIFORM:
        return
    other = np.empty(out.size)
    # Gaussian sampling keeps a free state next to a blocked one, the bridge test the free middle of
    # two blocked ones, obstacle sampling the surface between them.
    for _ in range(TRIES):
        counts[STATE_CHECKS] += 2
        free = state_free(obstacles, body, out)
        if kind == OBSTACLE:
            uniform(bounds[0], bounds[1], rng, other)
        else:
            _nearby(out, bounds, spread, rng, other)
        partner = state_free(obstacles, body, other)
        if kind == BRIDGE and not free and not partner:  # both piers blocked, the middle free
            counts[STATE_CHECKS] += 1
            out[:] = 0.5 * (out + other)
            if state_free(obstacles, body, out):
                return
        if kind != BRIDGE and free != partner:
            # The pair has a free and a blocked state in either order: make `out` the free one.
            if partner:
                for i in range(out.size):
                    out[i], other[i] = other[i], out[i]
            # Bisection towards the obstacle; `out` stays the free end of the interval.
            for _ in range(HALVINGS if kind == OBSTACLE else 0):  # up to the obstacle's surface
                counts[STATE_CHECKS] += 1
                middle = 0.5 * (out + other)
                if state_free(obstacles, body, middle):
                    out[:] = middle
                else:
                    other[:] = middle
            return
        # This pair does not qualify: begin again. After `TRIES` pairs the last uniform state is the
        # answer.
        uniform(bounds[0], bounds[1], rng, out)
