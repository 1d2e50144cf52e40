"""The sandbox layer by layer: what travels, what is refused, what is ended and cleaned up."""

from __future__ import annotations

import contextlib
import gc
import math
import struct
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from drills.reasons import Reason
from drills.sandbox import (
    Child,
    Ended,
    Foreign,
    Limits,
    MissingName,
    Raised,
    StartFailed,
    SyntaxProblem,
    wire,
)
from tests.budget import examples
from tests.drills.sandbox_children import PLAIN, child, loaded

LINUX = sys.platform.startswith("linux")


@pytest.fixture(scope="module")
def echo() -> Iterator[Child]:
    """One child that gives back what it gets."""
    with loaded(PLAIN, "same", limits=Limits(total=300)) as running:
        yield running


# What travels

SCALARS = st.none() | st.booleans() | st.integers(-(2**200), 2**200) | st.floats() | st.text()
VALUES = st.recursive(
    SCALARS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.lists(inner, max_size=4).map(tuple)
        | st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=12,
)


def exactly_equal(a: Any, b: Any) -> bool:
    """Equal with the same types, bit for bit, NaN included."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float):
        return (math.isnan(a) and math.isnan(b)) or struct.pack("d", a) == struct.pack("d", b)
    if isinstance(a, dict):
        return list(a) == list(b) and all(exactly_equal(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(exactly_equal, a, b))
    return a == b


@examples(100)
@given(value=VALUES)
def test_plain_values_come_back_exactly(echo: Child, value: Any) -> None:
    assert exactly_equal(echo.call("same", value), value)
    assert not echo.changed


@examples(50)
@given(
    value=npst.arrays(
        dtype=npst.boolean_dtypes()
        | npst.integer_dtypes()
        | npst.unsigned_integer_dtypes()
        | npst.floating_dtypes(sizes=(16, 32, 64)),
        shape=npst.array_shapes(min_dims=0, min_side=0),
    )
)
def test_arrays_come_back_exactly(echo: Child, value: np.ndarray) -> None:
    native = value.astype(value.dtype.newbyteorder("="))
    assert exactly_equal(echo.call("same", value), native)


def test_layout_of_an_array_does_not_matter(echo: Child) -> None:
    grid = np.arange(24.0).reshape(4, 6)
    for value in (grid.T, grid[::2, ::-1], np.asfortranarray(grid), np.broadcast_to(1.5, (3, 2))):
        assert np.array_equal(echo.call("same", value), value)


def test_numpy_scalars_are_arrays_of_no_dimension() -> None:
    source = "import numpy as np\ndef f(): return [np.float32(1.5), np.int8(-3), np.bool_(True)]"
    with loaded(source) as running:
        values = running.call("f")
    assert [(v.shape, v.dtype.name) for v in values] == [
        ((), "float32"),
        ((), "int8"),
        ((), "bool"),
    ]
    assert [v.item() for v in values] == [1.5, -3, True]


@pytest.mark.prove
@pytest.mark.parametrize(
    ("expression", "name"),
    [
        ("1j", "complex"),
        ("np.array([1j])", "array of dtype complex128"),
        ("np.array([None])", "array of dtype object"),
        ("np.array(['a'])", "array of dtype str"),
        ("np.ma.masked_array([1.0], [True])", "MaskedArray"),
        ("np.matrix([[1.0]])", "matrix"),
        ("type('Sly', (float,), {})(1.0)", "Sly"),
        ("type('Sly', (np.float64,), {})(1.0)", "Sly"),
        ("type('Sly', (np.ndarray,), {})((2,))", "Sly"),
        ("(i for i in ())", "generator"),
        ("{1: 2.0}", "dict with keys of type int"),
        ("{1.0}", "set"),
        ("b'x'", "bytes"),
        ("f", "function"),
        ("10**5000", "int of"),
        ("np.zeros(2 * 10**6)", "too large"),
        ("np.broadcast_to(1.0, (10**6, 10**6))", "too large"),
        ("[0.0] * 10**6", "too large"),
        ("'x' * 10**6", "too large"),
        ("endless()", "nested"),
    ],
)
def test_other_types_do_not_travel(expression: str, name: str) -> None:
    source = f"""
import numpy as np
def endless():
    a = []
    a.append(a)
    return a
def f(): return {expression}
"""
    with loaded(source) as running:
        value = running.call("f")
        assert isinstance(value, Foreign)
        assert name in value.type_name
        assert len(value.type_name) < 300


def test_answer_within_every_bound_but_that_of_a_message() -> None:
    source = """
import numpy as np
def f():
    thirds = [1 / 3 + i * 1e-9 for i in range(190_000)]
    return [np.zeros(10**6), "\\U0001f600" * 250_000, thirds]
"""
    with loaded(source) as running:
        value = running.call("f", seconds=20)
        assert isinstance(value, Foreign) and "too large" in value.type_name
        assert not running.changed


def test_foreign_value_inside_a_list() -> None:
    with loaded("def f(): return [1.0, 2j, (3, {4})]") as running:
        assert running.call("f") == [1.0, Foreign("complex"), (3, Foreign("set"))]


def test_arguments_of_other_types_are_the_callers_mistake(echo: Child) -> None:
    for value in ({1, 2}, 1j, np.array([1j]), object()):
        with pytest.raises(TypeError, match="can't be sent"):
            echo.call("same", value)
    assert echo.call("same", 1) == 1


def no_special(tag: str, content: Any) -> Any:
    raise wire.Malformed(tag)


@pytest.mark.parametrize(
    "data",
    [
        {"a": ["float64", [2], "AAAAAAAAAAA="]},
        {"a": ["float64", [1], "AAAAAAAAAAA"]},
        {"a": ["float64", [True], "AAAAAAAAAAA="]},
        {"a": ["float64", [-1], ""]},
        {"a": ["float64", [0, 2**39, 2**39], ""]},
        {"a": ["float64", [1] * 40, "AAAAAAAAAAA="]},
        {"a": ["object", [1], "AAAAAAAAAAA="]},
        {"a": ["O", [1], "AAAAAAAAAAA="]},
        {"a": ["<f8", [1], "AAAAAAAAAAA="]},
        {"a": ["bool", [1], "Ag=="]},
        {"a": ["float64", [1], "AAAAAAAAAAA=\n"]},
        {"a": ["float64", [1], "ä" * 12]},
        {"a": ["float64", [1], None]},
        {"a": [["float64"], [1], "AAAAAAAAAAA="]},
        {"a": "float64"},
        {"i": "0x" + "f" * 3000},
        {"i": "twelve"},
        {"i": 12},
        {"f": "1.0"},
        {"f": ["nan"]},
        {"t": 1},
        {"d": []},
        {"d": {"k": {"z": 1}}},
        {},
        {"a": [], "t": []},
        {"x": 1, "t": []},
        {"h": 1},
        2**60,
        math.inf,
    ],
)
def test_malformed_values_are_refused(data: Any) -> None:
    with pytest.raises(wire.Malformed):
        wire.decode(data, no_special)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"null",
        b"[]",
        b"{",
        b'{"a": NaN}',
        b'{"a": -Infinity}',
        b'{"a": "\xff"}',
        b"[" * 100_000,
        b'{"a":' * 50_000,
        b'{"a":[' + b"[]," * 1_000_000 + b"[]]}",
        b'{"a": ' + b"9" * 10_000 + b"}",
    ],
)
def test_malformed_messages_are_refused(payload: bytes) -> None:
    with pytest.raises(wire.Malformed):
        wire.unpack(payload)


def test_a_number_beyond_float_is_refused() -> None:
    with pytest.raises(wire.Malformed):
        wire.decode(wire.unpack(b'{"ok": 1e999}')["ok"], no_special)


def test_nesting_has_a_bound() -> None:
    deep: Any = 1.0
    for _ in range(wire.DEPTH + 1):
        deep = [deep]
    with pytest.raises(wire.Malformed):
        wire.decode(deep, no_special)
    with pytest.raises(wire.TooLarge):
        wire.encode(deep, no_special)


# Loading


@pytest.mark.slow
def test_signature_is_described() -> None:
    source = "def f(a, /, b, *c, d=1, **e): pass\nclass K:\n    def __init__(self, n=3): pass"
    with child(source) as running:
        observed = running.load()
    assert observed.callable and not observed.is_class and observed.parameters is not None
    assert [(p.name, p.kind, p.has_default) for p in observed.parameters] == [
        ("a", "positional_only", False),
        ("b", "positional_or_keyword", False),
        ("c", "var_positional", False),
        ("d", "keyword_only", True),
        ("e", "var_keyword", False),
    ]
    with child(source, "K") as running:
        observed = running.load()
    assert observed.is_class and observed.parameters is not None
    assert [p.name for p in observed.parameters] == ["n"]
    with child("f = 3") as running:
        assert running.load().parameters is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "line"),
    [
        ("def f(:\n    pass", 1),
        ("def f():\nreturn 1", 2),
        ("def f():\n\tif 1:\n        pass", 3),
        ("x = (" + "(" * 300 + ")" * 300 + ")", 1),
        ("nonlocal x", 1),
        ("x = '" + "\\ud800" + "'\ndef g(): yield (", 2),
    ],
)
def test_invalid_python_is_located(source: str, line: int) -> None:
    with child(source) as running, pytest.raises(SyntaxProblem) as caught:
        running.load()
    assert caught.value.line == line
    assert caught.value.message


@pytest.mark.slow
@pytest.mark.parametrize("source", ["-" * 200_000 + "1", "1" + "+1" * 200_000, "[" * 150_000])
def test_code_nested_beyond_the_compiler_is_no_crash(source: str) -> None:
    with child(source) as running, pytest.raises((SyntaxProblem, MissingName, Ended)) as caught:
        running.load()
    assert not isinstance(caught.value, Ended) or caught.value.reason is Reason.CRASHED


def test_syntax_error_at_run_time_is_an_exception() -> None:
    with loaded("def f(): eval('1 +')") as running:
        with pytest.raises(Raised) as caught:
            running.call("f")
    assert caught.value.type == "SyntaxError"


def test_missing_name_lists_what_there_is() -> None:
    source = "from math import sin\ndef g(): pass\nclass H: pass\n_private = 1"
    with child(source) as running, pytest.raises(MissingName) as caught:
        running.load()
    assert (caught.value.entry, caught.value.defined) == ("f", ["g", "H"])


def test_main_block_does_not_run_and_argv_is_the_file() -> None:
    source = (
        "import sys\nif __name__ == '__main__':\n    raise SystemExit\ndef f(): return sys.argv"
    )
    with loaded(source) as running:
        assert running.call("f") == ["answer.py"]


def test_source_is_there_for_inspect_dataclasses_and_tracebacks() -> None:
    source = """
import dataclasses, inspect, traceback, warnings
@dataclasses.dataclass
class P:
    x: "float" = 1.0
def f():
    try:
        1 / 0
    except ZeroDivisionError:
        text = traceback.format_exc()
    return [inspect.getsource(f)[:8], "1 / 0" in text, dataclasses.asdict(P())]
"""
    with loaded(source) as running:
        assert running.call("f") == ["def f():", True, {"x": 1.0}]


def test_given_module_is_there_first_and_its_fault_is_the_graders() -> None:
    given_text = "def make(n): return list(range(n))\ndef total(x): return sum(x)"
    source = "import given\ndef f(x): x.append(10); return given.total(x)"
    with loaded(source, given=given_text) as running:
        retained = running.given_new("make", 3)
        assert running.call("f", retained) == 13
        assert running.fetch(retained) == [0, 1, 2, 10]
        assert running.given("total", retained) == 13
        with pytest.raises(MissingName):
            running.given("absent")
    with child("def f(): pass", given="1 / 0") as running:
        with pytest.raises(StartFailed, match="ZeroDivisionError"):
            running.load()


def test_objects_stay_in_the_child() -> None:
    source = """
class Counter:
    def __init__(self, start): self.n = start
    def add(self, k=1): self.n += k; return self.n
"""
    with loaded(source, "Counter") as running:
        one, two = running.new("Counter", 5), running.new("Counter", start=7)
        assert running.method(one, "add") == 6
        assert running.method(two, "add", k=3) == 10
        assert running.fetch(one) == Foreign("Counter")
        with loaded(source, "Counter") as other, pytest.raises(ValueError, match="another child"):
            other.fetch(one)


@pytest.mark.prove
def test_handles_given_up_are_freed() -> None:
    source = """
import gc
class K:
    pass
def f():
    gc.collect()
    return sum(type(x) is K for x in gc.get_objects())
"""
    with loaded(source) as running:
        retained = [running.new("K") for _ in range(5)]
        assert running.call("f") == 5
        del retained[1:]
        gc.collect()
        assert running.call("f") == 1


def test_changed_arguments_are_noticed() -> None:
    source = "def f(a, b=None):\n    a[0] = 5\n    return a\ndef g(a): return a[::-1]"
    with loaded(source) as running:
        for value in (np.zeros(2), [0.0, 1.0], {"x": [1]}):
            if isinstance(value, dict):
                continue
            running.call("f", value)
            assert running.changed
            running.call("g", value)
            assert not running.changed
        running.call("g", np.array([np.nan, -0.0]))
        assert not running.changed


def test_repeat_calls_that_often() -> None:
    with loaded("n = 0\ndef f():\n    global n\n    n += 1\n    return n") as running:
        assert running.call("f", repeat=250) == 250
        assert running.elapsed > 0


# Exceptions


def test_exceptions_carry_the_frames_of_the_file_only() -> None:
    source = "import json\ndef inner():\n    json.loads('{')\ndef f():\n    inner()"
    with loaded(source) as running:
        with pytest.raises(Raised) as caught:
            running.call("f")
        assert caught.value.type == "JSONDecodeError"
        assert [(x.line, x.function) for x in caught.value.frames] == [(5, "f"), (3, "inner")]
        with pytest.raises(Raised, match="argument"):
            running.call("f", 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "body",
    [
        "class E(Exception):\n        def __str__(self): raise ValueError\n    raise E",
        "class E(Exception):\n        def __str__(self): return 3\n    raise E",
        "raise ValueError('x' * 10**7)",
        "raise ValueError('\\x1b[31m\\ud800\\x00')",
        "raise KeyboardInterrupt",
        "raise GeneratorExit",
        "raise BaseException('end')",
        "raise type('N' * 10**6, (Exception,), {})",
        "raise ExceptionGroup('both', [ValueError(1), TypeError(2)])",
        "def g(n): return g(n + 1)\n    g(0)",
        "raise StopIteration",
        "import sys; sys.setrecursionlimit(10)",
    ],
)
def test_any_exception_is_reported_and_the_child_lives_on(body: str) -> None:
    with loaded(f"def f():\n    {body}\ndef g(): return 1") as running:
        with contextlib.suppress(Raised):
            running.call("f")
            assert "recursionlimit" in body
        try:
            assert running.call("g") == 1
        except Raised as error:
            assert error.type == "RecursionError"
    with loaded(f"def f():\n    {body}") as running:
        try:
            running.call("f")
        except Raised as error:
            assert len(error.message) < 20_000 and len(error.type) <= 200
            assert (error.type + error.message).isprintable()


# --- Functions that stay in the grader ------------------------------------------------------------

ASKING = """\
import threading

def twice(function, x):
    return function(x) + function(2 * x)

def keep(function):
    global kept
    kept = function
    return function(1.0)

def later():
    return kept(3.0)

def forever(function):
    while True:
        function(1.0)

def from_threads(function):
    found = []
    threads = [threading.Thread(target=lambda i=i: found.append(function(i))) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return sorted(found)

"""


@pytest.mark.prove
def test_a_function_argument_is_answered_by_the_grader() -> None:
    requested: list[Any] = []

    def square(x: Any) -> Any:
        requested.append(x)
        return np.asarray(x, dtype=float) ** 2

    with Child(ASKING, filename="a.py", entry="twice") as child:
        child.load()
        assert child.call("twice", square, np.array([1.0, 3.0])).tolist() == [5.0, 45.0]
        assert len(requested) == 2 and not child.changed
        assert child.call("from_threads", square) == [float(i * i) for i in range(8)]
        with pytest.raises(Raised) as raised:
            child.call("twice", square, "text")
        assert raised.value.type == "TypeError" and "could not convert" in raised.value.message
        assert child.call("keep", square) == 1.0
        assert child.call("later") == 9.0
        with pytest.raises(Ended) as ended:
            child.call("forever", square, seconds=0.5)
        assert ended.value.reason is Reason.TIMED_OUT and "0.5 s" in ended.value.sentence


@pytest.mark.parametrize(
    "forged", ['{"ask": 7, "args": []}', '{"ask": 0, "args": 1}', '{"ask": "0"}']
)
def test_a_question_that_makes_no_sense_is_garbled(forged: str) -> None:
    source = (
        "import json, os, sys\n\n"
        "def f(function):\n"
        "    frame = sys._getframe()\n"
        "    while frame and 'request' not in frame.f_locals:\n"
        "        frame = frame.f_back\n"
        "    identity = frame.f_locals['request']['id']\n"
        f"    data = json.dumps({{'id': identity, **json.loads({forged!r})}}).encode()\n"
        "    for number in range(3, 64):\n"
        "        try:\n"
        "            os.write(number, len(data).to_bytes(4, 'big') + data)\n"
        "        except OSError:\n"
        "            pass\n"
        "    return 1\n"
    )
    with Child(source, filename="a.py", entry="f") as child:
        child.load()
        with pytest.raises(Ended) as ended:
            child.call("f", lambda: 0)
        assert ended.value.reason is Reason.GARBLED
