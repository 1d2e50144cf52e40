"""Every model's four functions compile as they stand, and then draw the same pictures."""

from typing import Any

import numba
import numpy as np
import pytest

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import KEYS, Experiment
from tests.simulations.models import MODELS


def same(one: Experiment, other: Experiment) -> None:
    """Equal to rounding: a compiler may order an expression's operations anew."""
    for name in one.model.state.fields:
        assert np.allclose(one.state[name], other.state[name], rtol=1e-9, atol=1e-12), name
    a, b = one.picture(), other.picture()
    assert np.allclose(a.data, b.data, rtol=1e-9, atol=1e-9, equal_nan=True)
    assert a.text == b.text


class Compiled:
    """A model whose functions are compiled, as an experiment wants it."""

    def __init__(self, model: Any) -> None:
        self.given = model
        for name in ("initial", "advance", "frame", "drag", "grab", "press"):
            function = getattr(model, name)
            setattr(self, name, function and numba.njit(function, error_model="numpy"))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.given, name)


@pytest.mark.parametrize("model", MODELS)
def test_the_functions_compile_and_draw_the_same(model: Any) -> None:
    if model.recorded:  # its functions only fetch what was drawn
        return
    compiled: Any = Compiled(model)
    for preset in model.presets.values():
        plain, fast = Experiment(model, **preset.values), Experiment(compiled, **preset.values)
        same(plain, fast)
        for seconds in (0.03, 0.4, 0.9):
            plain.advance(seconds)
            fast.advance(seconds)
            same(plain, fast)
        xmin, xmax, ymin, ymax = model.paper.window
        for share in (0.2, 0.5, 0.8):
            place = xmin + share * (xmax - xmin), ymin + share * (ymax - ymin)
            for experiment in (plain, fast):
                experiment.grab(*place)
                experiment.drag(place[0] + 0.3, place[1] + 0.2)
            same(plain, fast)
        for key in KEYS:
            plain.press(key)
            fast.press(key)
            same(plain, fast)
    assert len(compiled.frame.nopython_signatures) == 1


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
