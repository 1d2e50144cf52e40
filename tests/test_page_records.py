"""What takes a page long is computed, compared or read, as COURSE_CLAIMS says."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course import page_records
from course.page_records import from_record
from tests.budget import ROOT

pytestmark = pytest.mark.smoke

SOURCES = sorted((ROOT / "notebooks" / "source").glob("*.py"))


class Counted:
    """A function that notes its cases."""

    def __init__(self, function: Callable[[int], Any]) -> None:
        self.function, self.cases = function, []  # type: Callable[[int], Any], list[int]

    def __call__(self, case: int) -> Any:
        self.cases.append(case)
        return self.function(case)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(page_records, "FOLDER", tmp_path / "records")
    return tmp_path / "records"


@pytest.fixture
def mode(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    return lambda name: monkeypatch.setenv("COURSE_CLAIMS", name)


@pytest.mark.parametrize("chosen", ["", "computed"])
def test_a_reader_and_the_long_tier_compute_every_case_and_leave_no_record(
    folder: Path, mode: Callable[[str], None], chosen: str
) -> None:
    mode(chosen)
    square = Counted(lambda k: k * k)
    assert from_record("topic.squares", square, range(5)) == [0, 1, 4, 9, 16]
    assert square.cases == [0, 1, 2, 3, 4] and not folder.exists()


def test_the_tests_of_a_page_compute_a_few_cases_and_read_the_others(
    mode: Callable[[str], None],
) -> None:
    mode("stored")
    first = from_record("topic.roots", math.sqrt, range(100), checked=4)
    mode("recorded")
    root = Counted(math.sqrt)
    assert from_record("topic.roots", root, range(100), checked=4) == first
    assert root.cases == [0, 25, 50, 75]
    root = Counted(math.sqrt)
    assert from_record("topic.roots", root, range(100)) == first
    assert root.cases == [0]


def test_a_case_that_is_computed_anew_is_the_one_on_record(mode: Callable[[str], None]) -> None:
    mode("stored")
    from_record("topic.roots", math.sqrt, range(7))
    mode("recorded")
    with pytest.raises(ValueError, match=re.escape("case 3 of topic.roots")):
        from_record("topic.roots", lambda k: math.sqrt(k) + 0.01 * (k == 3), range(7), checked=2)


@pytest.mark.parametrize(
    ("was", "now", "same"),
    [
        (1.0, 1.0 + 1e-12, True),
        (1.0, 1.01, False),
        (0.0, 1e-17, True),
        (math.nan, math.nan, True),
        (math.nan, 0.0, False),
        (math.inf, math.inf, True),
        (math.inf, -math.inf, False),
        (3, 4, False),
        (True, False, False),
        (True, 1, False),
        ("found", "lost", False),
        (np.array([1.0, 2.0]), (1.0, 2.0), True),
        (np.array([1.0, 2.0]), [1.0], False),
        ({"a": np.float64(2.0)}, {"a": 2.0}, True),
        ({"a": 2.0}, {"b": 2.0}, False),
        (([1.0, "x"], None), ([1.0, "x"], None), True),
    ],
)
def test_results_are_compared_up_to_the_last_digits(
    mode: Callable[[str], None], was: Any, now: Any, same: bool
) -> None:
    mode("stored")
    stored = from_record("topic.one", lambda _: was, [0])
    mode("recorded")
    if same:
        read = from_record("topic.one", lambda _: now, [0])
        assert json.dumps(read) == json.dumps(stored)
    else:
        with pytest.raises(ValueError, match="as on record"):
            from_record("topic.one", lambda _: now, [0])


def test_a_share_of_runs_may_differ_by_as_much_as_it_says(mode: Callable[[str], None]) -> None:
    mode("stored")
    from_record("topic.share", lambda _: 0.5, [0])
    mode("recorded")
    assert from_record("topic.share", lambda _: 0.504, [0], close=0.01) == [0.5]
    with pytest.raises(ValueError, match="as on record"):
        from_record("topic.share", lambda _: 0.506, [0], close=0.01)


def test_a_number_comes_back_to_its_last_bit(mode: Callable[[str], None]) -> None:
    numbers = np.random.default_rng(0).standard_normal(50) * 10.0 ** np.arange(-25, 25)
    mode("stored")
    assert from_record("topic.numbers", lambda k: numbers[k], range(50)) == numbers.tolist()
    mode("recorded")
    assert from_record("topic.numbers", lambda k: numbers[k], range(50)) == numbers.tolist()


def test_records_of_a_topic_are_lines_of_one_file(
    folder: Path, mode: Callable[[str], None]
) -> None:
    mode("stored")
    for name in ("topic.b", "topic.a", "other.c", "topic.b"):
        from_record(name, float, range(3))
    lines = (folder / "topic.json").read_text("utf-8").splitlines()
    assert [line.partition(":")[0] for line in lines] == ["{", '"topic.a"', '"topic.b"', "}"]
    assert sorted(path.name for path in folder.iterdir()) == ["other.json", "topic.json"]


def test_bad_use_is_refused(mode: Callable[[str], None]) -> None:
    mode("recorded")
    with pytest.raises(ValueError, match=r"name must be .*topic\.none"):
        from_record("topic.none", float, range(3))
    mode("stored")
    from_record("topic.three", float, range(3))
    mode("recorded")
    with pytest.raises(ValueError, match=r"record topic\.three .*4 results.*got 3"):
        from_record("topic.three", float, range(4))
    with pytest.raises(ValueError, match="checked"):
        from_record("topic.three", float, range(3), checked=4)
    mode("guessed")
    with pytest.raises(ValueError, match="COURSE_CLAIMS"):
        from_record("topic.three", float, range(3))


def test_every_record_belongs_to_a_page_and_every_page_has_its_records() -> None:
    names = re.findall(
        r"from_record\(\s*\"([\w.]+)\"", "".join(path.read_text("utf-8") for path in SOURCES)
    )
    assert len(names) == len(set(names)) > 10
    files = (ROOT / "notebooks" / "records").glob("*.json")
    stored = {name for path in files for name in json.loads(path.read_text("utf-8"))}
    assert stored == set(names)
    for path in SOURCES:
        topics = re.findall(r"from_record\(\s*\"(\w+)\.", path.read_text("utf-8"))
        assert set(topics) <= {path.stem.partition("_")[2]}
