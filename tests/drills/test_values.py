"""Rebuilding answers as float64: type, shape, finite, in that order; nothing odd gets through."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drills import cards as catalogue
from drills import task_text
from drills.reasons import Reason
from drills.values import (
    Mismatch,
    as_float64,
    close,
    describe,
    identical,
    without_rounding,
    worst,
)

pytestmark = pytest.mark.smoke


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.slow
@given(st.lists(st.lists(FINITE, min_size=2, max_size=2), min_size=1, max_size=8))
def test_a_list_of_floats_is_as_good_as_an_array(rows: list[list[float]]) -> None:
    shape = (len(rows), 2)
    assert identical(as_float64(rows, shape), as_float64(np.array(rows), shape))
    assert identical(as_float64(tuple(map(tuple, rows)), shape), np.array(rows))


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (None, Reason.NOTHING_RETURNED),
        ("1.0", Reason.WRONG_TYPE),
        (True, Reason.WRONG_TYPE),
        ([1.0, True, 2.0], Reason.WRONG_TYPE),
        (np.array([True, False, True]), Reason.WRONG_TYPE),
        ({"a": 1.0}, Reason.WRONG_TYPE),
        ([1.0, None, 2.0], Reason.WRONG_TYPE),
        ([1.0, 2.0], Reason.WRONG_SHAPE),
        ([[1.0, 2.0, 3.0]], Reason.WRONG_SHAPE),
        ([1.0, [2.0], 3.0], Reason.WRONG_SHAPE),
        ([], Reason.WRONG_SHAPE),
        (1.0, Reason.WRONG_SHAPE),
        ([1.0, math.nan, 3.0], Reason.NOT_FINITE),
        ([1.0, math.inf, 3.0], Reason.NOT_FINITE),
        ([1, 10**400, 3], Reason.NOT_FINITE),
        ([math.nan, 1.0], Reason.WRONG_SHAPE),  # the shape is looked at before the values
        ([math.nan, "x", 1.0], Reason.WRONG_TYPE),  # and the type before the shape
    ],
)
def test_what_is_not_the_answer_is_named(value: Any, reason: Reason) -> None:
    with pytest.raises(Mismatch) as caught:
        as_float64(value, (3,))
    assert caught.value.reason is reason
    assert caught.value.sentence.endswith((".", "?"))


@pytest.mark.parametrize(
    ("shape", "text"), [((2, 4), "transposed"), ((3, 2), "1 too few rows"), ((8,), "arrangement")]
)
def test_a_wrong_shape_has_its_own_sentence(shape: tuple[int, ...], text: str) -> None:
    with pytest.raises(Mismatch, match=text) as caught:
        as_float64(np.zeros(shape), (4, 2))
    assert str(shape) in caught.value.sentence


def test_a_list_of_no_rows_fits_any_length_of_a_row() -> None:
    assert as_float64([], (0, 3)).shape == (0, 3)
    assert as_float64(np.zeros(0), (0, 3, 3)).shape == (0, 3, 3)
    for value, shape in (([], (3, 0)), ([], (2, 3)), (np.zeros((0, 2)), (0, 3)), ([1.0], (0, 3))):
        with pytest.raises(Mismatch):
            as_float64(value, shape)


def test_narrow_and_whole_numbers_become_float64() -> None:
    for dtype in (np.float32, np.float16, np.int8, np.uint64):
        assert as_float64(np.array([1, 2, 3], dtype=dtype), (3,)).dtype == np.float64


def test_the_worst_component_is_found() -> None:
    got = np.zeros((3, 2))
    got[2, 1] = -5.0
    assert worst(got, np.ones((3, 2))) == (6.0, (2, 1))


NESTED = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=12,
)


@given(NESTED)
def test_anything_can_be_described_and_is_identical_to_itself(value: Any) -> None:
    assert len(describe(value)) <= 72
    assert identical(value, value)


@given(NESTED, NESTED)
def test_rounding_is_close_and_types_are_not_mixed(a: Any, b: Any) -> None:
    assert close(a, b) == close(b, a)
    if type(a) is not type(b):
        assert not identical(a, b)


def test_a_huge_integer_can_be_described() -> None:
    assert "bits" in describe(10**6000)
    assert "bits" in describe([10**6000])


def test_signed_zero_counts_as_equal_and_nan_as_itself() -> None:
    assert identical([0.0], [-0.0])
    assert identical(math.nan, math.nan)
    assert not identical(np.array([0.0]), np.array([0.0], dtype=np.float32))


def test_rounding_errors_of_an_example_are_shown_as_zero() -> None:
    R = np.array([[1.0, 2e-16], [-3e-17, 1.0]])
    assert describe(without_rounding((R, [0.0, -1e-16]))) == "([[1, 0], [0, 1]], [0, 0])"
    # A small answer is an answer, as long as nothing large stands beside it.
    for retained in (
        2e-16,
        [1e-300, 3e-300],
        (np.array([1.0, 1e-13]), 5),
        np.nan,
        "text",
        None,
        True,
    ):
        assert identical(without_rounding(retained), retained)
    assert describe(without_rounding([np.inf, 1e-3])) == "[inf, 0.001]"
    assert without_rounding([1.0, 7, 1e-20]) == [1.0, 7, 0.0]


@pytest.mark.slow
def test_no_example_shows_rounding_noise() -> None:
    """A number far below the largest of its answer is read as a value, and is none."""
    for card in catalogue.cards():
        for call, result in task_text.examples(card):
            sizes = [abs(float(text)) for text in re.findall(r"-?\d[\d.]*(?:e[+-]\d+)?", result)]
            noise = [size for size in sizes if 0.0 < size < 1e-8 * max(sizes)]
            tiny = [size for size in sizes if 0.0 < size < 1e-9]
            assert not noise and not tiny, (card.name, call, result)
