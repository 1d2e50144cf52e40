"""Whether a model run by its module is the model run by Python: state, numbers and picture."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from hypothesis import strategies as st

from course.simulations import pen as draw
from course.simulations.model import KEYS, Experiment, Model
from course.simulations.record import Field

# They count thousands of reaches, train, render depth images or draw whole curves: many seconds in
# Python or in the host of modules here, and a blink in a browser.
MINUTES = {
    "control.nyquist",
    "kinematics.elbow",
    "learning.denoising",
    "learning.point",
    "learning.two_ways",
    "perception",
    "sim_to_real.arms",
    "sim_to_real.faults",
}

WITHIN = 1e-9  # of a number in the state or the picture, or of its size where that is above 1


def away(one: Any, other: Any) -> float:
    """The largest difference of two arrays; infinite where only one has a number."""
    a, b = np.asarray(one, float), np.asarray(other, float)
    if a.shape != b.shape or (np.isfinite(a) != np.isfinite(b)).any():
        return np.inf
    here = np.isfinite(a)
    return float((abs(a - b)[here] / np.maximum(abs(a[here]), 1.0)).max(initial=0.0))


def assert_same(plain: Experiment, module: Experiment) -> float:
    """Counts are equal, numbers within 1e-9, pictures of the same items; the largest difference."""
    worst = 0.0
    for kind in ("controls", "state"):
        record = getattr(plain.model, kind)
        for name in record.fields:
            a, b = getattr(plain, kind)[name], getattr(module, kind)[name]
            if record.dtype[name].base.kind == "f":
                worst = max(worst, away(a, b))
                assert worst <= WITHIN, (name, worst)
            else:
                assert np.array_equal(a, b), name
    one, other = plain.picture(), module.picture()
    items = [list(draw.decode(each)) for each in (one, other)]
    assert [(i.kind, i.points.shape) for i in items[0]] == [
        (i.kind, i.points.shape) for i in items[1]
    ]
    assert [len(i.words) for i in items[0]] == [len(i.words) for i in items[1]]
    worst = max(worst, away(one.data, other.data))
    assert worst <= WITHIN, worst
    return worst


def assert_same_run(
    model: Model, hosted: Any, values: dict[str, Any], seconds: tuple[float, ...]
) -> float:
    """The same start, the same after each time, a drag and a key; the largest difference."""
    plain, module = Experiment(model, **values), Experiment(hosted, **values)
    worst = assert_same(plain, module)
    for passed in seconds:
        for each in (plain, module):
            each.advance(passed)
        worst = max(worst, assert_same(plain, module))
    xmin, xmax, ymin, ymax = model.paper.window
    place = xmin + 0.4 * (xmax - xmin), ymin + 0.6 * (ymax - ymin)
    for each in (plain, module):
        each.grab(*place)
        each.drag(place[0] + 0.3, place[1] - 0.2)
        each.press(KEYS[1])
        each.press(KEYS[4])
        each.advance(0.04)
    return max(worst, assert_same(plain, module))


def ends(model: Model) -> Iterator[dict[str, Any]]:
    """Every end, choice and switch of the panel: all controls at once, in few runs."""
    panel = {name: field.ends for name, field in model.controls.panel()}
    for k in range(max(map(len, panel.values()), default=0)):
        yield {name: each[k % len(each)] for name, each in panel.items()}


def any_controls(model: Model) -> st.SearchStrategy[dict[str, Any]]:
    """Any values of the panel within their limits."""
    return st.fixed_dictionaries({name: _any(field) for name, field in model.controls.panel()})


def _any(field: Field) -> st.SearchStrategy[Any]:
    if field.switch or field.choices:
        return st.sampled_from(field.ends)
    if isinstance(field.default, int):
        return st.integers(int(field.low), int(field.high))
    return st.floats(field.low, field.high)
