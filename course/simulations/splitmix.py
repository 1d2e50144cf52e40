"""Random numbers that a model can draw compiled, in plain Python and in a browser alike.

SplitMix64 (Steele, Lea and Flood, Fast splittable pseudorandom number generators, OOPSLA 2014, with
the constants of Vigna's splitmix64.c): the k-th number is a hash of seed + k * GAMMA, so that as
many as are wanted come from one array expression. The seed is an array (1,) of uint64, such as a
field `Field(np.uint64(0), shape=(1,))` of the state; drawing moves it on.
"""

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import overload_method, register_jitable
from numpy.typing import NDArray

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)


@register_jitable
def integers(seed, count):
    """Return the next numbers of the stream, (count,) uint64; the seed moves on."""
    # A counter-based generator: all numbers of a call at once, without a loop.
    z = np.arange(1, count + 1).astype(np.uint64) * _GAMMA + seed
    if count > 0:
        seed[:] = z[count - 1 :]
    # The finaliser of SplitMix64 (Steele, Lea and Flood, 2014): counters become mixed bits.
    z = (z ^ (z >> _30)) * _FIRST
    z = (z ^ (z >> _27)) * _SECOND
    return z ^ (z >> _31)


@register_jitable
def uniform(seed, out):
    """Fill `out` (N,) with numbers spread evenly over [0, 1)."""
    # The upper 53 bits fill the mantissa of a double.
    out[:] = (integers(seed, out.size) >> _11) * 2.0**-53


@register_jitable
def normal(seed, out):
    """Fill `out` (N,) with numbers of a standard normal distribution (Box and Muller, 1958)."""
    u = (integers(seed, 2 * out.size) >> _11) * 2.0**-53
    # Box-Muller: a radius from the first number, an angle from the second.
    # u is below 1 but may be 0, hence the logarithm of 1 - u.
    out[:] = np.sqrt(-2.0 * np.log(1.0 - u[::2])) * np.cos(2.0 * np.pi * u[1::2])


class Stream(NamedTuple):
    """Random numbers of a seed, with the methods of a `numpy.random.Generator` that loops use.

    A loop that is passed a stream therefore runs on either.
    """

    seed: NDArray[np.uint64]

    def random(self) -> float:
        """Return a number spread evenly over [0, 1)."""
        return _one(uniform, self.seed)

    def standard_normal(self) -> float:
        """Return a number of a standard normal distribution."""
        return _one(normal, self.seed)


@register_jitable
def _one(law, seed):
    out = np.empty(1)
    law(seed, out)
    return out[0]


@overload_method(types.BaseNamedTuple, "random")
def _random(self):
    return lambda self: _one(uniform, self.seed)


@overload_method(types.BaseNamedTuple, "standard_normal")
def _standard_normal(self):
    return lambda self: _one(normal, self.seed)
