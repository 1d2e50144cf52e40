"""Long computations of the pages, on record, so that the tests of the pages need not repeat them.

A page computes what it shows. Some of its cells run hundreds of cases, which takes up to half a
minute each. Such a cell passes its cases to `from_record`, and COURSE_CLAIMS says what happens:

* unset, as for a reader, or `computed` (`make prove`): every case is computed;
* `stored` (`make notebooks`): every case is computed, and the record is written;
* `recorded` (`make test`): a few cases are computed and compared with the record, the others are
  read from it.

The records are in `notebooks/records`, one JSON file a topic. What a page prints comes from them or
from the computation, so `make prove` compares the two when it compares the page.
"""

import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from course.check import count, invalid, one_of

FOLDER = Path(__file__).resolve().parents[1] / "notebooks" / "records"
MODES = ("", "recorded", "computed", "stored")
# Processors differ in the last digits, which an iteration may amplify; a page prints three or four.
CLOSE = 1e-3

T = TypeVar("T")


def from_record(
    name: str,
    compute: Callable[[T], Any],
    cases: Iterable[T],
    checked: int = 1,
    close: float = CLOSE,
) -> list[Any]:
    """Return `compute(case)` for each case, computed or read from the record.

    Args:
        name: of the record, with the topic of its page: "pipeline.other_seeds".
        compute: function of one case. It returns numbers, texts, arrays, or lists, tuples and
            dictionaries of them; whichever mode is set, arrays and tuples come back as lists.
        cases: what it is called with. What it returns must not depend on the cases before.
        checked: how many cases are computed and compared where the others are read, evenly
            spaced from the first one on.
        close: largest relative difference of a computed number from the one on record; larger for a
            share of runs, of which another processor may decide one or two differently.

    Returns:
        One result for each case.

    Raises:
        ValueError: a computed result is not the one on record, or there is no such record.
    """
    mode = one_of("COURSE_CLAIMS", os.environ.get("COURSE_CLAIMS", ""), MODES)
    every = list(cases)
    count("checked", checked, 1, max(1, len(every)))
    if mode != "recorded":
        result = [_plain(compute(case)) for case in every]
        if mode == "stored":
            _store(name, result)
        return result
    result = _load(name)
    if len(result) != len(every):
        raise invalid(f"record {name}", len(result), f"{len(every)} results: `make notebooks`")
    for index in (k * len(every) // checked for k in range(checked)):
        made = _plain(compute(every[index]))
        if not _agree(made, result[index], close):
            where = f"case {index} of {name}"
            raise invalid(where, made, f"as on record, {result[index]!r}: `make notebooks`")
    return result


def _file(name: str) -> Path:
    """Return the file of a record."""
    return FOLDER / f"{name.partition('.')[0]}.json"


def _load(name: str) -> list[Any]:
    path = _file(name)
    records = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    one_of("name", name, records)
    result: list[Any] = records[name]
    return result


def _store(name: str, result: list[Any]) -> None:
    """Write a record beside the others of its topic, one line each; the file changes in one go."""
    path = _file(name)
    path.parent.mkdir(exist_ok=True)
    records = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    records[name] = result
    lines = [f"{json.dumps(key)}: {json.dumps(records[key])}" for key in sorted(records)]
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", newline="\n", dir=path.parent, suffix=".part", delete=False
    ) as part:
        part.write("{\n" + ",\n".join(lines) + "\n}\n")
    os.chmod(part.name, 0o644)
    os.replace(part.name, path)


def _plain(value: Any) -> Any:
    """Return a result as JSON would give it back."""
    if isinstance(value, dict):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _agree(one: Any, other: Any, close: float) -> bool:
    """Return whether two results are the same but for the last digits of their numbers."""
    if isinstance(one, list) and isinstance(other, list):
        pairs = zip(one, other, strict=False)
        return len(one) == len(other) and all(_agree(*pair, close) for pair in pairs)
    if isinstance(one, dict) and isinstance(other, dict):
        same = one.keys() == other.keys()
        return same and all(_agree(one[key], other[key], close) for key in one)
    if isinstance(one, float) and isinstance(other, float):
        both_missing = math.isnan(one) and math.isnan(other)
        return both_missing or math.isclose(one, other, rel_tol=close, abs_tol=1e-9)
    return type(one) is type(other) and bool(one == other)
