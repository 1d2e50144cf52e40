"""What a model's functions are compiled to is what their source says; all models: tests/prove."""

from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.simulations import pen as draw
from course.simulations.model import Experiment
from tests.budget import examples
from tests.simulations.compiled import Compiled, assert_compiled_is_plain
from tests.simulations.models import WALK

pytestmark = pytest.mark.prove  # it compiles a model

NAMES = ("an area", "a line", "a polygon", "discs", "an arrow", "a text", "a readout")


@pytest.fixture(scope="module")
def compiled() -> Any:
    return Compiled(WALK)


def test_compiled_is_plain(compiled: Any) -> None:
    assert_compiled_is_plain(WALK, compiled, [dict(each.values) for each in WALK.presets.values()])


@examples(20)
@given(st.floats(0.0, 2.0), st.integers(0, 99), st.integers(0, 1), st.booleans())
def test_compiled_is_plain_for_any_controls(compiled, speed, seed, walk, tail) -> None:
    values = {"speed": speed, "seed": seed, "walk": walk, "tail": tail}
    assert_compiled_is_plain(WALK, compiled, [values], drags=(0.3,))


def test_a_full_pen_names_what_has_no_room_and_nothing_is_written_past_its_end(compiled) -> None:
    """For every room up to enough, in plain Python and compiled, where no index is checked."""
    run = Experiment(WALK)
    data = run.picture().data
    ends, at = [], 0
    while at < data.size:
        kind, count = int(data[at]), int(data[at + 1])
        # What ends an area takes as much room as an area, and gives it back.
        ends.append((NAMES[kind], at + 2 + max(count, 4 * (kind == draw.CUT))))
        at += 2 + count
    assert {name for name, _ in ends} == set(NAMES)
    expected = [next((name for name, end in ends if end > n), "") for n in range(data.size + 1)]
    for model in (WALK, compiled):
        report = []
        for room in range(data.size + 1):
            memory = np.full(draw.HEADER + data.size + 50, 1e300)
            pen = memory[: draw.HEADER + room]
            draw.clear(pen)
            try:
                model.frame(pen, run.state, run.controls)
                report.append("")
            except ValueError as error:
                report.append(str(error).removeprefix("no room left on the paper for "))
            assert (memory[draw.HEADER + room :] == 1e300).all(), room
            assert draw.HEADER <= pen[0] <= pen.size
        assert report == expected


def test_a_copy_and_stray_points_are_refused_compiled() -> None:
    copy = numba.njit("(float64[::1], float64[::1])", error_model="numpy")(draw.copy)
    point = numba.njit("(float64[::1], float64, float64)", error_model="numpy")(draw.point)
    memory = np.full(draw.HEADER + 20, 1e300)
    pen = memory[: draw.HEADER + 8]
    draw.clear(pen)
    with pytest.raises(ValueError, match="before the item"):
        point(pen, 0.0, 0.0)
    with pytest.raises(ValueError, match="a copy"):
        copy(pen, np.zeros(9))
    assert (memory[draw.HEADER :] == 1e300).all()
    copy(pen, np.zeros(8))
    assert (pen[draw.HEADER :] == 0.0).all() and (memory[draw.HEADER + 8 :] == 1e300).all()
