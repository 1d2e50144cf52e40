"""Every model's functions compile as they stand, and then draw the same pictures."""

from typing import Any

import numba
import numpy as np
import pytest

from course.simulations import pen as draw
from course.simulations import splitmix
from tests.simulations.compiled import Compiled, assert_compiled_is_plain
from tests.simulations.models import MODELS
from tests.site.same import MINUTES


# Of the others the module, which holds these compiled functions, is compared in a browser.
@pytest.mark.parametrize("model", [param for param in MODELS if param.id not in MINUTES])
def test_the_functions_compile_and_draw_the_same(model: Any) -> None:
    if model.recorded:  # its functions only fetch what was drawn
        return
    presets = [dict(preset.values) for preset in model.presets.values()]
    assert_compiled_is_plain(model, Compiled(model), presets)


def test_random_numbers_are_the_same_compiled() -> None:
    for function in (splitmix.uniform, splitmix.normal):
        drawn = []
        for draws in (function, numba.njit(function)):
            seed, out = np.array([9], np.uint64), np.empty(1000)
            draws(seed, out)
            drawn.append((seed, out))
        assert drawn[0][0] == drawn[1][0]
        assert np.allclose(drawn[0][1], drawn[1][1], rtol=1e-13, atol=1e-15)


def test_ticks_are_the_same_compiled() -> None:
    fast, rng = numba.njit(draw.ticks), np.random.default_rng(5)
    for _ in range(20_000):
        low = rng.normal() * 10.0 ** rng.uniform(-20, 20)
        high = low + 10.0 ** rng.uniform(-20, 20)
        count = int(rng.integers(0, 12))
        assert draw.ticks(low, high, count) == fast(low, high, count)
