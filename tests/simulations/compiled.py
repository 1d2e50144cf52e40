"""Models whose functions are compiled, held against the same functions as plain Python."""

from typing import Any

import numba
import numpy as np
from numba import types

from course.simulations.model import KEYS, Experiment


class Compiled:
    """A model whose functions are compiled for its records, as an experiment wants it."""

    def __init__(self, model: Any) -> None:
        self.given = model
        controls, state = (numba.from_dtype(each.dtype) for each in (model.controls, model.state))
        pen, real = types.Array(numba.float64, 1, "C"), numba.float64
        takes = {
            "initial": (controls, state),
            "advance": (state, controls, real),
            "frame": (pen, state, controls),
            "drag": (controls, state, real, real),
            "grab": (controls, state, real, real),
            "press": (controls, state, numba.int64),
            "complete": (controls, state),
        }
        for name, arguments in takes.items():
            function = getattr(self.given, name)
            made = function and numba.njit(numba.void(*arguments), error_model="numpy")(function)
            setattr(self, name, made)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.given, name)


def assert_same(plain: Experiment, fast: Experiment) -> None:
    """State and picture are equal but for rounding: NumPy's sums and its sine are not in the order
    and not to the last digit those of compiled code."""
    for name in plain.model.state.fields:
        assert np.allclose(plain.state[name], fast.state[name], rtol=1e-9, atol=1e-12), name
    a, b = plain.picture(), fast.picture()
    assert np.allclose(a.data, b.data, rtol=1e-9, atol=1e-9, equal_nan=True)
    assert a.text == b.text


def assert_compiled_is_plain(
    model: Any, fast: Any, runs: Any, drags: Any = (0.2, 0.5, 0.8)
) -> None:
    """From these controls both run, are dragged and pressed, to the same state and picture."""
    xmin, xmax, ymin, ymax = model.paper.window
    for values in runs:
        both = Experiment(model, **values), Experiment(fast, **values)
        assert_same(*both)
        for seconds in (0.03, 0.4, 0.9):
            for experiment in both:
                experiment.advance(seconds)
            assert_same(*both)
        for share in drags:
            place = xmin + share * (xmax - xmin), ymin + share * (ymax - ymin)
            for experiment in both:
                experiment.grab(*place)
                experiment.drag(place[0] + 0.3, place[1] + 0.2)
            assert_same(*both)
        for key in KEYS:
            for experiment in both:
                experiment.press(key)
            assert_same(*both)
