"""A stand-in for a child answers as the child does: values, exceptions, handles, changes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from drills.inprocess import InProcess, StandIn
from drills.sandbox import Child, MissingName, Raised
from drills.values import identical

GIVEN = """
import numpy as np

def numbers(n):
    return np.arange(n)

def applied(n):
    import submission
    return submission.same(n)
"""
SOURCE = """
from math import sqrt
import numpy as np
import given

class Counter:
    def __init__(self, start=0):
        self.count = start
    def add(self, n):
        self.count += n
        return self.count

def same(x):
    return x

def inner(n):
    return [1][n]

def fails(n):
    print("asked", n)
    return inner(n)

def changes(a, b):
    a[0] = 7
    return b

def twice(function, x):
    return function(x), function([x, 2 * x])

def total(handle, more=0):
    return handle.sum() + more

def odd():
    return [1j, {1}, {2: 3}, np.float32(1.5), np.array([None]), np.ma.masked_array([1.0]), Counter]

def deep():
    x = []
    for _ in range(50):
        x = [x]
    return x
"""


def squared(x: Any) -> Any:
    return np.asarray(x, dtype=float) ** 2


REQUESTS: dict[str, Callable[[Any], Any]] = {
    "plain values": lambda c: c.call("same", {"a": [1, (2.5, None)], "b": np.eye(2), "c": "x"}),
    "numbers that JSON lacks": lambda c: c.call("same", [float("nan"), float("inf"), 2**70, -0.0]),
    "what does not travel": lambda c: [str(item) for item in c.call("odd")],
    "too deep": lambda c: str(c.call("deep")),
    "an exception": lambda c: c.call("fails", 5),
    "what was printed": lambda c: (c.call("fails", 0), c.output),
    "a changed argument": lambda c: (c.call("changes", [1.0], 2), c.changed),
    "a changed array": lambda c: (c.call("changes", np.zeros(2), 2), c.changed),
    "no changed argument": lambda c: (c.call("same", np.array([np.nan])), c.changed),
    "an object that stays": lambda c: _counted(c),
    "an object of the given module": lambda c: c.call("total", c.given_new("numbers", 5), more=2),
    "the given module asks the submission": lambda c: c.given("applied", 3),
    "the value of a handle": lambda c: c.fetch(c.given_new("numbers", 3)),
    "a function of the grader": lambda c: c.call("twice", squared, 3.0),
    "a function of the grader that refuses": lambda c: c.call("twice", squared, "text"),
    "a name that is missing": lambda c: c.call("absent"),
    "a method that is missing": lambda c: c.method(c.new("Counter"), "absent"),
    "arguments that do not fit": lambda c: c.new("Counter", 1, 2, 3),
    "repeated": lambda c: c.call("same", 4, repeat=3),
}


def _counted(place: Any) -> Any:
    one, two, missing = (place.new("Counter", start=start) for start in (5, 7, 9))
    del missing
    return place.method(one, "add", 1), place.method(two, "add", n=3), place.method(one, "add", 1)


def answer(place: Any, request: Callable[[Any], Any]) -> Any:
    """What a request gives, or what is raised, with all that is known of it."""
    try:
        return request(place)
    except Raised as raised:
        frames = [(frame.line, frame.function) for frame in raised.frames]
        return [raised.type, str(raised), frames, list(raised.kinds)]
    except MissingName as missing:
        return [missing.entry, missing.defined]


def test_a_stand_in_answers_as_a_child_does() -> None:
    def start(kind: Any) -> Any:
        return kind(SOURCE, filename="answer.py", entry="Counter", given=GIVEN)

    with start(Child) as child, start(StandIn) as stand_in:
        assert child.load() == stand_in.load()
        for label, request in REQUESTS.items():
            theirs, ours = answer(child, request), answer(stand_in, request)
            assert identical(theirs, ours), (label, theirs, ours)
        assert stand_in.used > 0.0


def test_a_text_that_fails_at_the_top_or_lacks_the_name_is_told_so() -> None:
    for source, error in (("1 / 0", Raised), ("def other(): pass", MissingName)):
        places = [kind(source, filename="answer.py", entry="f") for kind in (Child, StandIn)]
        report = []
        for place in places:
            with place, pytest.raises(error) as caught:
                place.load()
            report.append(str(caught.value))
        assert report[0] == report[1]


def test_what_is_remembered_is_what_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "seen = []\ndef f(x):\n    seen.append(x)\n    return sum(seen) if x else 1 / x\n"
    monkeypatch.setattr(InProcess, "memory", {})
    for report in ([1, 2, 3], [1, 2, 3], [1, 3], [1, 2, 3, 4, 4]):
        module = InProcess(text)
        assert [module.call("f", x) for x in report] == list(np.cumsum(report))
    monkeypatch.setattr(InProcess, "_run", None)
    assert [InProcess(text).call("f", 1) for _ in range(2)] == [1, 1]
