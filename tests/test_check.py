"""Bad input is refused in one wording, which names argument, value and what is allowed."""

import math
import re
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from course import check

pytestmark = pytest.mark.smoke


ROOT = Path(__file__).resolve().parent.parent


POSITIVE = "a positive finite number"


@pytest.mark.parametrize(
    ("kind", "arguments", "value", "rule", "place"),
    [
        (check.positive, (0.0,), "0.0", POSITIVE, ""),
        (check.positive, (-math.inf,), "-inf", POSITIVE, ""),
        (check.positive, (np.float64("nan"),), "nan", POSITIVE, ""),
        (check.positive, (None,), "None", POSITIVE, ""),
        (check.positive, ("1",), "'1'", POSITIVE, ""),
        (check.positive, ([1.0],), "[1.0]", POSITIVE, ""),
        (check.positive, (10**400,), f"{10**400}", POSITIVE, ""),
        (check.finite, (math.inf,), "inf", "a finite number", ""),
        (check.finite, (-1, 0.0), "-1", "a non-negative finite number", ""),
        (check.finite, (1.5, 0.0, 1.0), "1.5", "a number from 0 to 1", ""),
        (check.finite, (math.nan, 0.0, 1.0), "nan", "a number from 0 to 1", ""),
        (check.count, (-1,), "-1", "a non-negative integer", ""),
        (check.count, (2.0, 1), "2.0", "a positive integer", ""),
        (check.count, (True,), "True", "a non-negative integer", ""),
        (check.count, (4, 1, 3), "4", "an integer from 1 to 3", ""),
        (check.one_of, ("mass", ("time", "count")), "'mass'", "one of 'time', 'count'", ""),
        (check.vector, ("north",), "'north'", "an array of real numbers", ""),
        (check.vector, ([1.0 + 1e-20j],), "[(1+1e-20j)]", "an array of real numbers", ""),
        (check.bounds, (1.0 + 0.0j, 3), "(1+0j)", "an array of numbers, which may be infinite", ""),
        (check.vector, ([1.0, 2.0], (3,)), "(2,)", "(3,)", ".shape"),
        (check.vector, (1.0, (4,), (4, None)), "()", "(4,) or (4, N)", ".shape"),
        (check.vector, ([1.0], ()), "(1,)", "()", ".shape"),
        (check.vector, ([[1.0, math.nan]],), "nan", "a finite number", "[0, 1]"),
        (check.vector, (math.inf, (), (2,)), "inf", "a finite number", ""),
        (check.bounds, ([1.0, 2.0], 3), "(2,)", "() or (3,)", ".shape"),
        (check.bounds, (math.nan, 3), "nan", "an array of numbers, which may be infinite", ""),
    ],
)
def test_the_error_states_argument_rule_and_value(kind, arguments, value, rule, place) -> None:
    text = f"x{place} must be {rule}, got {value}"
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        kind("x", *arguments)


def test_one_bound_is_that_of_all_and_none_is_handed_back() -> None:
    given = np.array([1.0, math.inf])
    result = check.bounds("limit", given, 2)
    assert result is not given and result.tolist() == [1.0, math.inf]
    assert check.bounds("limit", math.inf, 2).tolist() == [math.inf] * 2


def test_a_unit_is_named() -> None:
    with pytest.raises(ValueError, match=r"^dt must be a positive finite number \[s\], got 0$"):
        check.positive("dt", 0, unit="s")
    with pytest.raises(
        ValueError, match=r"^c\[1\] must be a non-negative finite number \[N\], got -1.0$"
    ):
        check.vector("c", [0.0, -1.0], low=0.0, unit="N")


def test_a_long_array_is_shown_by_its_shape() -> None:
    text = str(check.invalid("q", np.zeros((3, 40)), "shorter"))
    assert text == "q must be shorter, got an array of shape (3, 40)"


def test_what_is_allowed_comes_back_as_a_plain_number() -> None:
    assert check.positive("dt", Fraction(1, 2)) == 0.5
    assert type(check.positive("dt", np.float32(2.0))) is float
    assert check.finite("e", 0, 0.0, 1.0) == 0.0 and check.finite("e", 1, 0.0, 1.0) == 1.0
    assert type(check.count("n", np.int64(3), 3, 3)) is int
    array = np.ones((4, 2))
    assert check.vector("q", array, (4, None)) is array
    assert check.one_of("by", "time", {"time": 1}) == "time"


# The answers of the drills stand for themselves, in the same wording; the others refuse files,
# formulas and fields of a form.
APART = {"drills.py", "derivations", "simulations", "interview"}


def test_no_other_wording_is_in_use() -> None:
    result = []
    for path in sorted((ROOT / "course").rglob("*.py")):
        if path.relative_to(ROOT / "course").parts[0] not in APART:
            text = path.read_text(encoding="utf-8")
            result += [str(path.relative_to(ROOT))] * text.count("raise ValueError")
    assert result == []


def test_the_answers_of_the_drills_use_the_same_wording() -> None:
    text = (ROOT / "course" / "drills.py").read_text(encoding="utf-8")
    message = re.findall(r"raise ValueError\((.+)\)", text)
    assert len(message) == text.count("raise ValueError") > 10
    assert [words for words in message if not re.search(r" must be .*, got \{", words)] == []
