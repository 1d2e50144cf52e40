"""Real claims, changed on purpose in their source: each change is noticed, by what it says."""

import ast
import importlib.util
import inspect
import sys
import textwrap
from pathlib import Path

import pytest

from course import derivations
from course.derivations import Result, claims, honest, records, run, settle, unmet
from tests import optional
from tests.budget import PROVE
from tests.derivations.test_derivations import each

pytestmark = pytest.mark.slow


ALL = claims()
CONDITIONAL = [
    item for item in ALL if records.load(item.file).get(item.id, {}).get("condition", "")
]


def _mutated(item, tmp_path, monkeypatch, *changes):
    """The claim out of its own source with some text replaced; registered nowhere else."""
    module = f"course.derivations.{item.file}"
    text = Path(str(sys.modules[module].__file__)).read_text(encoding="utf-8")
    (tree,) = [
        node
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef) and node.name == item.id
    ]
    lines = text.splitlines(keepends=True)
    start, end = tree.decorator_list[0].lineno - 1, tree.end_lineno
    own = "".join(lines[start:end])
    for old, new in changes:
        assert own.count(old) >= 1, f"{item.id} has no {old!r}"
        own = own.replace(old, new, 1)
    path = tmp_path / f"{item.id}.py"
    path.write_text("".join([*lines[:start], own, *lines[end:]]), encoding="utf-8")
    monkeypatch.setattr(derivations, "CLAIMS", {})
    spec = importlib.util.spec_from_file_location(module, path)
    assert spec and spec.loader
    spec.loader.exec_module(importlib.util.module_from_spec(spec))
    return derivations.CLAIMS[item.id]


def _item(id):
    return next(item for item in ALL if item.id == id)


@pytest.mark.parametrize(
    ("id", "old", "new", "expected"),
    [
        # A false corrected text.
        ("semi_implicit_unconditional", "while omega dt < 2", "while omega dt < 3", "texts on"),
        ("verlet_limit", "have the limit", "have no limit,", "texts on record"),
        ("contact_limit_explicit", "{semi_implicit_limit_ms:.2f} ms", "9.32 ms", "is typed"),
        ("contact_limit_explicit", "{explicit_gain_per_step_1_ms:.0%}", "12 %", "is typed"),
        ("semi_implicit_limit", "{formula}", "{formulae}", "cannot be filled"),
        # A false condition: its text, and what is tried.
        ("determinant_one_is_stable", "lies between -2 and 2", "is below 2", "condition on record"),
        (
            "determinant_one_is_stable",
            "uniform(-1.999, 1.999, 50)",
            "uniform(-9, 1.999, 50)",
            "condition is not enough",
        ),
        (
            "determinant_one_is_stable",
            "outside=[on_circle(drawn(trace)) for trace in outside]\n"
            "        + [on_circle(two(trace)) for trace in result.rng.uniform(-1.999, -0.8, 8)]",
            "outside=[on_circle(drawn(trace)) for trace in result.rng.uniform(-0.5, 0.5, 20)]",
            "condition is not needed",
        ),
        (
            "explicit_midpoint_limit",
            "uniform(0.1, 0.99) * x",
            "uniform(1.1, 1.99) * x",
            "condition is not enough",
        ),
        (
            "symplectic_removes_stiffness",
            "alike(x) <",
            "radius(_partitioned(*LOBATTO, x)) <",
            "condition is not enough",
        ),
        (
            "contact_stable_at_1_khz",
            "for n in limited]",
            "for n in METHODS]",
            "condition is not enough",
        ),
        # A negated claim.
        ("semi_implicit_unconditional", "is stable for any", "is unstable for any", "texts on"),
        (
            "stable_at_the_limit",
            "result.statement_holds(after[2] < 10)",
            "result.statement_holds(after[2] >= 10)",
            "verdict on record",
        ),
        (
            "rk4_limit",
            "result.statement_holds(abs(measured - 8) < 0.1)",
            "result.statement_holds(measured < 8)",
            "verdict on record",
        ),
        # A constant that settles the correction.
        (
            "rk4_limit",
            "result.correction_holds(abs(measured / np.sqrt(8) - 1) < 1e-4)",
            "result.correction_holds(True)",
            "constant, not computed: True",
        ),
        ("verlet_limit", "abs(verlet - 2) < 1e-6,", "2 - 2 == 0,", "constant, not computed"),
        (
            "stable_at_the_limit",
            "np.allclose(along, along[0])",
            "bool(along is not None or True)",
            "constant, not computed",
        ),
        (
            "explicit_damped_limit",
            "np.allclose(ratios, 1, rtol=1e-6)",
            "np.allclose([1.0, 1.0], 1)",
            "constant, not computed",
        ),
        ("semi_implicit_limit", 'measured_limit("semi_implicit_euler")', "2.0", "is typed"),
        # A formula, a figure, a fact.
        ("explicit_damped_limit", "dt < 2*zeta/omega", "dt < 2.001*zeta/omega", "derived"),
        ("semi_implicit_limit", "1000 * float", "1001 * float", "on record is 6.32"),
        ("verlet_limit", "abs(verlet - 2) < 1e-6", "abs(verlet - 3) < 1e-6", "is false"),
        # A grid twice as fine: the fact itself says so, not only the figures on record.
        (
            "encoder_ripple",
            "line = Encoder(bits).line\n\n    def ripple(tau, kd=kd, target=0.3, bits=bits)",
            "line = Encoder(bits + 1).line\n\n"
            "    def ripple(tau, kd=kd, target=0.3, bits=bits + 1)",
            "fact 3 of 4 is false",
        ),
    ],
)
def test_a_changed_claim_is_noticed(id, old, new, expected, tmp_path, monkeypatch):
    outcome = settle(_mutated(_item(id), tmp_path, monkeypatch, (old, new)))
    assert any(expected in text for text in outcome.disagreements), outcome.disagreements


def test_a_claim_that_is_only_copied_agrees(tmp_path, monkeypatch):
    """Else what is noticed above would be the copying."""
    assert settle(_mutated(_item("rk4_limit"), tmp_path, monkeypatch)).agrees


def _handed_over(check):
    """Source of a check, and the places in it of every fact, verdict, draws and figure."""
    text = textwrap.dedent(inspect.getsource(check))
    lines = text.splitlines(keepends=True)

    def place(node):
        starts = [
            sum(len(line.encode()) for line in lines[: n - 1])
            for n in (node.lineno, node.end_lineno)
        ]
        return starts[0] + node.col_offset, starts[1] + node.end_col_offset

    places = []
    for call in ast.walk(ast.parse(text)):
        if not isinstance(call, ast.Call):
            continue
        name = getattr(call.func, "attr", "")
        if name in ("correction_holds", "statement_holds"):
            draws = [k.value for k in call.keywords if k.arg in ("inside", "outside")]
            places += [(place(value), b"[True] * 9") for value in draws]
            places += [(place(value), b"True") for value in call.args]
        elif name == "measure" and len(call.args) > 1:
            places.append((place(call.args[1]), b"1.25"))
    return text.encode(), places


# Every tenth claim; all of them in the long tier.
@pytest.mark.parametrize("item", ALL if PROVE else ALL[::10], ids=lambda item: item.id)
def test_no_fact_can_be_replaced_by_a_constant(item, tmp_path):
    """Every fact, verdict, draws and figure of the claim, one at a time; nothing is run."""
    assert not honest.constants(item.check)
    text, places = _handed_over(item.check)
    assert len(places) >= 3
    for number, ((start, end), constant) in enumerate(places):
        path = tmp_path / f"{number}.py"
        path.write_bytes(text[:start] + constant + text[end:])
        names = dict(item.check.__globals__, claim=lambda *texts, **more: lambda check: check)
        exec(compile(path.read_bytes(), path, "exec"), names)
        assert honest.constants(names[item.id]), text[start:end].decode()


def condition_is_tried(item, outcome):
    """What came out inside is put outside, and the other way about: that fails."""
    result, swapped = outcome.finding, Result(item.id)
    swapped.statement_holds(
        result.holds,
        only_if="not " + result.condition,
        inside=result.outside,
        outside=result.inside,
        cases=True,
    )
    assert any("condition is not enough" in text for text in swapped.problems())


def entry_is_compared(item, outcome):
    """Every text and every figure of the record's entry is changed, one at a time: that is seen."""
    result, record = outcome.finding, records.load(item.file)[item.id]
    entry = item.entry(result)
    for name in ("verdict", "condition", "formula", "texts"):
        changed = record | {name: record.get(name, "") + " not"}
        assert list(records.differences(changed, entry)), name
    given = record.get("inputs", {})
    for name, value in given.items():
        other = value + " not" if isinstance(value, str) else 2.0 * value + 1.0
        inputs = given | {name: other}
        assert list(records.differences(record | {"inputs": inputs}, entry)), name
    for name, (value, tolerance) in record["figures"].items():
        other = (
            value + " not"
            if isinstance(value, str)
            else value + (abs(value) + 1) * 4 * (tolerance + 1e-9)
        )
        if value in (float("inf"), float("-inf")):
            other = 1.0
        figures = record["figures"] | {name: [other, tolerance]}
        assert list(records.differences(record | {"figures": figures}, entry)), name


# The long tier tries each claim in one test, since to run its check is what takes time.
@pytest.mark.parametrize("item", each(ALL if PROVE else CONDITIONAL[::4]))
def test_no_entry_of_the_record_can_change_and_no_condition_be_swapped(item):
    if reason := unmet(item):
        # Where the check cannot run here, the record itself is what is changed and compared.
        entry_is_compared(item, derivations.show(item.id).outcome)
        optional.skip(f"the condition of {item.id} was NOT swapped: {reason}")
    entry_is_compared(item, run(item.id))
    if item in CONDITIONAL:
        condition_is_tried(item, run(item.id))
