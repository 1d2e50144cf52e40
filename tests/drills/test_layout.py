"""The drills' room: what it imports, and that its parts stay light."""

from __future__ import annotations

import ast
import itertools
import json
import re
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drills import cards as catalogue
from drills import exercise as exercises
from drills.cards import UnknownExercise, definitions
from drills.exercise import Slip, coarse_slips, slips
from tests.prove.drills.test_natural import answers
from tests.test_project import BIG, imports

pytestmark = pytest.mark.smoke


ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "drills").rglob("*.py"))
NATURAL = ROOT / "tests" / "prove" / "drills" / "natural.toml"
JUDGES = sorted((ROOT / "drills" / "catalogue").glob("*/exercise.py"))


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_big_library_is_asked_through_its_oracle(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    result = [(name, late) for name, late in imports(tree, "drills") if name.split(".")[0] in BIG]
    if path.parent.name == "randomize":  # this drill is about a MuJoCo model
        child = path.name in ("given.py", "starter.py")  # runs where the course isn't
        result = [(name, late) for name, late in result if name != "mujoco" or not (late or child)]
    assert result == []


@pytest.mark.slow
@pytest.mark.parametrize("path", JUDGES, ids=lambda path: path.parent.name)
def test_a_judge_imports_nothing_heavy_at_its_top(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    tops = {name.partition(".")[0] for name, deferred in imports(tree, "drills") if not deferred}
    assert tops <= {"numpy", "drills", "__future__"} | sys.stdlib_module_names


@pytest.mark.parametrize("path", JUDGES, ids=lambda path: path.parent.name)
def test_an_exercise_has_its_files(path: Path) -> None:
    for name in ("card.toml", "prompt.md"):
        assert (path.parent / name).stat().st_size > 0
    one = catalogue.card(path.parent.name)
    assert bool(one.start) != (path.parent / "starter.py").exists(), (
        f"{one.name} needs `start` in card.toml or a file starter.py, and not both"
    )


def function(text: str, name: str) -> ast.FunctionDef:
    """Return a definition, without the types of its arguments."""
    match = next(
        n for n in ast.parse(text).body if isinstance(n, ast.FunctionDef) and n.name == name
    )
    for argument in ast.walk(match.args):
        if isinstance(argument, ast.arg):
            argument.annotation = None
    return match


@pytest.mark.parametrize(
    "one", [c for c in catalogue.cards() if c.kind == "function"], ids=lambda one: one.name
)
def test_a_starter_has_the_signature_of_the_worked_answer(one: catalogue.Card) -> None:
    starter, solution = (function(t, one.entry) for t in (one.starter(), one.solution_text()))
    assert ast.dump(starter.args) == ast.dump(solution.args)
    if one.start:
        text = ast.get_docstring(starter) or ""
        assert set(text.split("\n\n")) <= set((ast.get_docstring(solution) or "").split("\n\n"))
        body = ast.parse(f"def f():\n{textwrap.indent(one.start, '    ')}").body[0]
        assert isinstance(body, ast.FunctionDef)
        assert [ast.dump(node) for node in starter.body[1:]] == [ast.dump(n) for n in body.body]
    assert max(map(len, one.starter().splitlines())) <= 100


def test_a_starter_leaves_the_explanation_and_the_types_out() -> None:
    """Written out here once: what a learner gets for the regulator."""
    assert catalogue.card("lqr").starter() == (
        "import numpy as np\n\n\n"
        "def lqr(A, B, Q, R):\n"
        '    """Return the gain of the discrete linear quadratic regulator.\n\n'
        "    Args:\n"
        "        A: of x[k+1] = A x[k] + B u[k], shape (n, n).\n"
        "        B: shape (n, m).\n"
        "        Q: weights of the states, symmetric, shape (n, n).\n"
        "        R: weights of the commands, symmetric and positive definite, shape (m, m).\n\n"
        "    Returns:\n"
        "        K with u = -K x, shape (m, n).\n"
        '    """\n'
        "    # Only the next sample counts.\n"
        "    return np.linalg.solve(R + B.T @ Q @ B, B.T @ Q @ A)\n"
    )


@pytest.mark.parametrize("module", ["drills", "drills.cards", "drills.reasons"])
def test_what_the_list_needs_does_not_import_numpy(module: str) -> None:
    program = f"import sys, {module}; print('numpy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert done.stdout.split() == ["False"], done.stderr


def test_entries_are_unique_so_that_a_function_finds_its_exercise() -> None:
    entries = [card.entry for card in catalogue.cards()]
    assert len(set(entries)) == len(entries)


def test_the_interview_drills_are_there() -> None:
    drills = {card.name for card in catalogue.cards() if card.drill}
    assert {"fk3", "rrt", "pid", "randomize", "vector_env"} <= drills


def test_an_unknown_name_gets_the_nearest() -> None:
    with pytest.raises(UnknownExercise) as caught:
        catalogue.card("fk33")
    assert caught.value.nearest[0] == "fk3"


def test_definitions_bring_what_they_use(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "import math\nimport os\n\nSCALE = 2.0\n\n\ndef helper(x):\n    return SCALE * x\n\n\n"
        "def unused():\n    return os.sep\n\n\n@staticmethod\ndef wanted(x):\n"
        "    return helper(math.sin(x))\n"
    )
    text = definitions(module, ["wanted"])
    names: dict[str, object] = {}
    exec(text, names)
    assert "unused" not in names and "os" not in names and "SCALE" in names
    assert text.index("helper") < text.index("wanted") and "@staticmethod" in text
    with pytest.raises(ValueError, match="does not define missing"):
        definitions(module, ["missing"])


def test_a_slip_that_no_longer_fits_its_solution_says_so() -> None:
    assert Slip("s", "S.", edits=(("a", "b"),)).text("x = a") == "x = b"
    with pytest.raises(ValueError, match="stands 2 times"):
        Slip("s", "S.", edits=(("a", "b"),)).text("a = a")
    with pytest.raises(ValueError, match="does not differ"):
        Slip("s", "S.", edits=(("a", "a"),)).text("a")


def test_a_table_of_slips_says_pairs_or_a_whole_answer() -> None:
    one, two, whole = slips(
        one=("a", "b", "A is b."), two=("a", "b", "c", "d", "Two."), whole=("x = 1", "Whole.")
    )
    assert (one.name, one.text("x = a"), one.sentence) == ("one", "x = b", "A is b.")
    assert two.text("a + c") == "b + d" and whole.text("x = a") == "x = 1"
    for row in (("told",), ("a", "b", "c", "told")):
        with pytest.raises(ValueError, match="pairs"):
            slips(bad=row)


def test_coarse_slips_give_the_worked_answer_with_fewer_digits() -> None:
    kinds: tuple[Any, Any] = np.float32, np.round
    for single, count in (("0.123456789123", "0.123456789123, [2.0]"), ("1 / 3", "1 / 3, 0.5")):
        for slip, value in zip(coarse_slips("f", "S."), kinds, strict=True):
            for body in (single, count):
                names: dict[str, Any] = {}
                exec(slip.text(f"def f(x):\n    return {body}\n"), names)
                got = names["f"](0)
                first = got[0] if body is count else got
                expected = np.round(eval(single), 6) if value is np.round else value(eval(single))
                assert first == expected and isinstance(got, tuple) is (body is count)


@pytest.mark.parametrize("path", JUDGES, ids=lambda path: path.parent.name)
def test_a_prompt_states_how_exact_an_answer_must_be(path: Path) -> None:
    assert re.search(r"\b1e-\d+", (path.parent / "prompt.md").read_text(encoding="utf-8")), (
        f"{path.parent.name}/prompt.md must say how exact an answer has to be, written like 1e-9"
    )


@pytest.mark.parametrize("one", catalogue.cards(), ids=lambda one: one.name)
def test_an_exercise_has_one_name_and_its_entry_holds_it(one: catalogue.Card) -> None:
    """Folder, command, card and progress: one name, whose words stand in the name graded."""
    assert one.folder.name == one.name and one.signatures[0].name == one.entry
    assert all(word in one.entry.lower() for word in one.name.split("_"))
    with pytest.raises(UnknownExercise) as caught:
        catalogue.card(one.entry + "x")
    if one.entry != one.name:
        with pytest.raises(UnknownExercise) as caught:
            catalogue.card(one.entry)
    assert caught.value.nearest[0] == one.name


def test_a_task_about_a_faulty_program_first_says_where_it_is() -> None:
    """On a page of the course the program is in the cell below the card, as the task says."""
    faulty = [one for one in catalogue.cards() if one.faulty]
    assert faulty == [one for one in catalogue.cards() if one.title.startswith("Silent bug")]
    below: dict[str, str] = {}
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        cells = ["".join(c["source"]) for c in json.loads(path.read_text("utf-8"))["cells"]]
        below |= {cell.strip(): after for cell, after in itertools.pairwise(cells)}
    for one in faulty:
        first = one.prompt().split("\n\n")[1]
        assert first.startswith(f"`drills start {one.name}` writes the faulty program")
        assert f"def {one.entry}(" in below[f'card("{one.name}")']


def test_no_start_of_the_wrist_is_farther_from_its_goal_than_the_prompt_says() -> None:
    """The checked starts and the examples; with integers, the nearest angles are (pi, 0, 0)."""
    from drills.catalogue.wrist_ik.exercise import EXERCISE, cases

    prompt = " ".join(catalogue.card("wrist_ik").prompt().split())
    assert "each joint is at most 1 rad from the nearest angles" in prompt
    solve = exercises.worked_answer("wrist_ik")
    starts = [case.args for case in cases(np.random.default_rng(5))]
    for text in EXERCISE.examples:
        eval(text.removesuffix(".round(6)"), {"np": np, "wrist_ik": lambda *a: starts.append(a)})
    for start, target, _, steps in starts:
        if steps:
            away = np.abs(solve(start, target, 0.05, 200) - start)
            assert away.max() <= 1.0, (start, target)


def test_a_range_that_is_refused_is_refused_in_the_prompt() -> None:
    """Friction and mass may not begin at zero, damping and delay may: the prompt says both."""
    prompt = catalogue.card("randomize").prompt()
    assert "Friction and mass begin **above** zero, damping and delay at zero" in prompt


@pytest.mark.prove
def test_natural_wrong_answers_still_fit_the_worked_answers() -> None:
    """Each exercise has eight or more; `tests/prove/drills/test_natural.py` grades them."""
    counts = {}
    for card in catalogue.cards():
        rows = answers(card)
        counts[card.name] = len(rows)
        for row in rows:
            ast.parse(row.text)
    few = {name: n for name, n in counts.items() if n < 8}
    assert not few, f"fewer than eight in natural.toml: {few}"
    assert set(tomllib.loads(NATURAL.read_text(encoding="utf-8"))) == set(counts)


def test_the_sample_of_an_exercise_in_contributing_is_complete() -> None:
    """As printed there, with the card and the worked answer that the text describes."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.S | re.M)
    sample: dict[str, Any] = {}
    exec(code, sample)
    cases = sample["cases"](np.random.default_rng(0))
    assert list(dict.fromkeys(case.level for case in cases)) == ["simple", "core", "edge"]
    solution = (
        "import math\n\nTURN = 2.0 * math.pi\n\n\n"
        "def wrap_angle(angle):\n    return (angle + math.pi) % TURN - math.pi\n"
    )
    edits = [slip for slip in sample["EXERCISE"].slips if slip.edits]
    assert len(edits) >= 1
    for slip in edits:
        assert slip.text(solution) != solution
