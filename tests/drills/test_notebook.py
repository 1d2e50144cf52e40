"""Exercises in a notebook: what a cell borrows, and `check` in a real kernel."""

import json
import linecache
import os
import sys
import time
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from jupyter_client.manager import KernelManager

from drills import cards as catalogue
from drills import notebook
from drills.cell_source import Borrowed, Unusable, assemble
from drills.reasons import Reason

RIGHT = """
def verlet_step(q, v, a, acceleration, dt):
    half = v + 0.5 * dt * a
    q = q + dt * half
    a = acceleration(q)
    return q, half + 0.5 * dt * a, a
"""

# --- What a definition borrows --------------------------------------------------------------------


class Notebook:
    """Cells that are run one after the other in one namespace, as a kernel does."""

    def __init__(self) -> None:
        self.names: dict[str, Any] = {"__name__": "__main__"}
        self.files: list[str] = []

    def cell(self, text: str) -> None:
        name = f"ipykernel_test/{len(self.files)}.py"
        self.files.append(name)
        linecache.cache[name] = (len(text), None, text.splitlines(True), name)
        exec(compile(text, name, "exec"), self.names)

    def source(self, name: str) -> str:
        return assemble(self.names[name]).source

    def call(self, name: str, *arguments: object) -> Any:
        """What the assembled text gives when it is run alone."""
        module = types.ModuleType("alone")
        sys.modules["alone"] = module
        exec(compile(self.source(name), "<alone>", "exec"), module.__dict__)
        return getattr(module, name)(*arguments)


@pytest.fixture
def cells() -> Iterator[Notebook]:
    book = Notebook()
    yield book
    for name in book.files:
        linecache.cache.pop(name)


def test_imports_constants_and_helpers_come_along(cells: Notebook) -> None:
    cells.cell("import numpy as np\nfrom math import sin as sine\nK = 3\nLIMIT = float('inf')")
    cells.cell("def twice(x):\n    return K * x - x\n")
    cells.cell("def f(x):\n    return min(np.abs(twice(x)) + sine(0.0), LIMIT)\n")
    assert cells.call("f", -2.0) == 4.0
    carried = assemble(cells.names["f"]).carried
    assert sorted(carried) == ["K = 3", "LIMIT = float('inf')", "twice"]


def test_the_lines_of_the_cell_are_kept(cells: Notebook) -> None:
    cells.cell("import numpy as np\nK = 3\ndef helper(): return K")
    text = "# my answer\n\nz = 1; print(end='')\n\ndef f(x):\n    return x + z + K + helper()\nf(0)"
    cells.cell(text)
    lines = cells.source("f").splitlines()
    assert lines[4:6] == ["def f(x):", "    return x + z + K + helper()"]
    assert cells.call("f", 1) == 8
    cells.cell("def f(x):\n    return np.sum(x) + helper()")
    assert cells.source("f").startswith("def f(x):\n    return np.sum(x)")
    assert cells.call("f", [1, 2]) == 6


def test_only_what_is_used_is_taken(cells: Notebook) -> None:
    cells.cell("secret = object()\nx = 1")
    cells.cell("a = 1; ran.append(1) if 'ran' in dir() else None\nb = 2\ndef f():\n    return a\n")
    source = cells.source("f")
    assert "secret" not in source and "ran" not in source and "b = 2" not in source
    assert cells.call("f") == 1


def test_what_is_needed_at_once_comes_first(cells: Notebook) -> None:
    cells.cell("K = 2\ndef double(g):\n    return lambda x: K * g(x)\ndef five():\n    return 5")
    cells.cell("@double\ndef f(x=five()):\n    return x")
    module = types.ModuleType("alone")
    wrapper = cells.names["f"]
    with pytest.raises(Unusable, match="inside another function"):
        assemble(wrapper)  # what is graded is the inner function, which has no name of its own
    cells.cell("def g(x=five()):\n    return x + K")
    exec(cells.source("g"), module.__dict__)
    assert module.g() == 7


def test_a_wrapper_that_says_what_it_wraps_is_looked_through(cells: Notebook) -> None:
    cells.cell("import functools\nimport numba")
    cells.cell("@functools.lru_cache\ndef f(x):\n    return x + 1")
    cells.cell("@numba.njit\ndef g(x):\n    return x + 2")
    cells.cell("def both(x):\n    return f(x) + g(x)")
    assert cells.call("f", 1) == 2
    assert "@numba.njit\ndef g(x)" in cells.source("g")
    assert cells.call("both", 1) == 5


def test_a_class_brings_its_base_and_its_decorator(cells: Notebook) -> None:
    cells.cell("from dataclasses import dataclass, field\nclass Base:\n    unit = 'm'\n")
    cells.cell(
        "@dataclass\nclass Thing(Base):\n    kept: list = field(default_factory=list)\n\n"
        "    def grow(self, x) -> int:\n        self.kept.append(x)\n"
        "        return len(self.kept)\n"
    )
    thing = cells.call("Thing")
    assert (thing.grow(3), thing.unit, thing.kept) == (1, "m", [3])


def test_annotations_need_not_be_there(cells: Notebook) -> None:
    cells.cell("from typing import Any\nArray = list[float]")
    cells.cell("def f(x: Array, y: 'Anything' = 2) -> Any:\n    z: Array = x\n    return z + y")
    assert "list[float]" not in cells.source("f")
    assert cells.call("f", 1) == 3


def test_functions_that_call_each_other_come_once(cells: Notebook) -> None:
    cells.cell("def even(n):\n    return n == 0 or odd(n - 1)")
    cells.cell("def odd(n):\n    return n != 0 and even(n - 1)")
    assert cells.call("even", 10) is True
    assert cells.source("even").count("def ") == 2


def test_the_definition_that_was_run_last_counts(cells: Notebook) -> None:
    cells.cell("def f():\n    return 1\n\ndef f():\n    return 2\n")
    assert cells.call("f") == 2
    cells.cell("def h():\n    return 1")
    cells.cell("def g():\n    return h()")
    cells.cell("def h():\n    return 5")
    assert cells.call("g") == 5


def test_builtins_are_left_alone_unless_they_were_replaced(cells: Notebook) -> None:
    cells.cell("def f(x):\n    return max(x), len(x)")
    assert cells.call("f", [1, 2]) == (2, 2)
    cells.cell("def max(x):\n    return 'mine'\nlen = lambda x: 'mine too'")
    assert cells.call("f", [1, 2]) == ("mine", "mine too")


def test_what_is_reached_through_a_package_is_imported(cells: Notebook) -> None:
    cells.cell("import xml.dom.minidom\nimport xml")
    cells.cell("def f():\n    return xml.dom.minidom.Document().nodeName")
    assert "import xml.dom" in cells.source("f")


CANNOT = {
    "an array": ("import numpy as np\ntable = np.zeros(3)", "table", "ndarray"),
    "a generator": ("import numpy as np\ntable = np.random.default_rng(0)", "table", "Generator"),
    "a list": ("table = [1, 2]", "table", "list"),
    "a long text": ("table = 'x' * 10_000", "table", "str"),
    "the course": ("from course import rigid_body as table", "table", "course.rigid_body"),
    "its function": ("from course.derivations import answer as table", "table", "course"),
}


@pytest.mark.parametrize("kind", CANNOT)
def test_what_cannot_come_along_is_named(cells: Notebook, kind: str) -> None:
    text, name, message = CANNOT[kind]
    cells.cell(text)
    cells.cell(f"def f():\n    return {name}")
    with pytest.raises(Borrowed, match=f"f uses {name}.*{message}"):
        assemble(cells.names["f"])


def test_a_constant_of_the_same_cell_may_be_anything(cells: Notebook) -> None:
    cells.cell("import numpy as np")
    cells.cell("TABLE = np.arange(3)\n\ndef f():\n    return int(TABLE.sum())")
    assert cells.call("f") == 3


def test_a_module_of_ones_own_is_named(
    cells: Notebook, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my_helpers.py").write_text("def half(x):\n    return x / 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    cells.cell("import my_helpers\nfrom my_helpers import half")
    cells.cell("def f(x):\n    return my_helpers.half(x)")
    with pytest.raises(Borrowed, match="a module of your own"):
        assemble(cells.names["f"])
    cells.cell("def g(x):\n    return half(x)")  # its source is there: it comes along
    assert cells.call("g", 3.0) == 1.5


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3.0, "not a value of type float"),
        (None, "not a value of type NoneType"),
        (len, "not a value of type builtin"),
        (lambda x: x, "lambda"),
    ],
)
def test_what_has_no_source_is_said(value: object, text: str) -> None:
    with pytest.raises(Unusable, match=text):
        assemble(value)


# --- Cards and badges -----------------------------------------------------------------------------


def bundle(shown: notebook.Shown) -> dict[str, Any]:
    return shown._repr_mimebundle_()


@pytest.mark.slow
@pytest.mark.parametrize("name", catalogue.names())
def test_a_card_says_what_one_needs(name: str) -> None:
    card = catalogue.card(name)
    data = bundle(notebook.card(name))
    text = data["text/markdown"]
    assert card.title in text and f"difficulty {card.difficulty} of 5" in text
    assert f"{card.minutes} minutes" in text and card.teaches in text
    assert all(signature.text in text for signature in card.signatures)
    assert text.count("<details>") == text.count("</details>") == 3
    assert ">>> " in text
    assert data == bundle(notebook.card(name))  # the same in every run
    assert card.title in data["text/plain"] and "<details>" not in data["text/plain"]


def test_badges_say_the_state_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "progress.json"
    entries = {"verlet": {"state": "solved"}, "bounce": {"state": "attempted"}}
    file.write_text(json.dumps({"schema": "drills-progress/1", "exercises": entries}))
    monkeypatch.setenv("DRILLS_PROGRESS", str(file))
    data = bundle(notebook.badges(1))
    for kind in ("text/plain", "text/html"):
        assert "verlet: solved" in data[kind]
        assert "bounce: attempted" in data[kind]
        assert "tumble: not attempted" in data[kind]
    monkeypatch.setenv("DRILLS_PROGRESS", "none")
    assert "solved" not in repr(notebook.badges(1))
    assert "no graded exercises" in repr(notebook.badges(77))


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb (WCAG 2.1)."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_badges_are_readable() -> None:
    for ground, ink in notebook._BADGE_COLOURS.values():
        low, high = sorted((luminance(ground), luminance(ink)))
        assert (high + 0.05) / (low + 0.05) >= 4.5


# --- In a kernel ----------------------------------------------------------------------------------


class Kernel:
    """A kernel of its own, with a work folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.work = folder / "work"
        selected = {k: v for k, v in os.environ.items() if not k.startswith("DRILLS")}
        self.manager = KernelManager()
        environment = {**selected, "DRILLS_WORK": str(self.work)}
        self.manager.start_kernel(env=environment, cwd=str(folder))
        self.client = self.manager.client()
        self.client.start_channels()
        self.client.wait_for_ready(timeout=120)
        self.run("from drills.notebook import badges, card, check, solution")

    def run(self, code: str, after_start: Callable[[], None] | None = None) -> dict[str, Any]:
        """The last output of a cell: its data, its text, or its error."""
        result: dict[str, Any] = {}

        def hook(message: dict[str, Any]) -> None:
            kind, content = message["msg_type"], message["content"]
            if kind == "execute_input" and after_start is not None:
                after_start()
            if kind in ("execute_result", "display_data"):
                result.update(content["data"])
            elif kind == "stream":
                result["stream"] = result.get("stream", "") + content["text"]
            elif kind == "error":
                result["error"] = content["ename"]
                result["traceback"] = "\n".join(content["traceback"])

        self.client.execute_interactive(code, output_hook=hook, timeout=300)
        return result

    def record(self, name: str = "verlet") -> dict[str, Any]:
        file = self.work / "progress.json"
        return json.loads(file.read_text())["exercises"].get(name, {}) if file.exists() else {}

    def stop(self) -> None:
        self.client.stop_channels()
        self.manager.shutdown_kernel(now=True)


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Kernel]:
    one = Kernel(tmp_path_factory.mktemp("notebook"))
    yield one
    one.stop()


def test_an_untouched_starter_is_not_attempted_and_not_recorded(kernel: Kernel) -> None:
    kernel.run(catalogue.card("verlet").starter())
    shown = kernel.run("check(verlet_step)")
    assert "error" not in shown
    assert shown["text/plain"].startswith("verlet: not attempted yet")
    assert "Not attempted yet" in shown["text/html"]
    assert kernel.record() == {}


def test_a_wrong_answer_then_a_right_one(kernel: Kernel) -> None:
    kernel.run("def verlet_step(q, v, a, acceleration, dt):\n    return q, v, a")
    wrong = kernel.run("r = check(verlet_step); r")
    assert wrong["text/plain"].startswith("NOT RIGHT")
    assert "<table>" in wrong["text/html"] and "expected" in wrong["text/html"]
    assert kernel.run("print(r.passed, r.reason)")["stream"] == "False wrong_value\n"
    assert kernel.record()["state"] == "attempted"
    assert "not solved yet" in kernel.run("solution('verlet')")["text/plain"]

    kernel.run("from numpy import asarray\nhalf_of = 0.5\ndef moved(q, v, dt): return q + dt * v")
    kernel.run(
        "def verlet_step(q, v, a, acceleration, dt):\n"
        "    half = v + half_of * dt * asarray(a)\n"
        "    q = moved(q, half, dt)\n"
        "    a = acceleration(q)\n"
        "    return q, half + half_of * dt * asarray(a), a\n"
    )
    right = kernel.run("r = check(verlet_step, seed=5)\nr")
    assert right["text/plain"].startswith("RIGHT"), right
    assert "from other cells: half_of = 0.5, moved" in right["text/plain"]
    assert kernel.run("print(r.passed, r.details['seed'])")["stream"] == "True 5\n"
    assert kernel.record()["state"] == "solved"
    assert "verlet: solved" in kernel.run("badges(1)")["text/html"]
    assert "def verlet_step" in kernel.run("solution('verlet')")["text/markdown"]


def test_a_class_without_methods_of_its_own_is_found(kernel: Kernel) -> None:
    kernel.run("class verlet_step:\n    pass")
    shown = kernel.run("check(verlet_step)")
    assert "must be a function; yours is a class" in " ".join(shown["text/plain"].split())


def test_the_line_in_a_message_is_the_line_in_the_cell(kernel: Kernel) -> None:
    kernel.run("import numpy as np")
    kernel.run(
        "# my answer\n\n"
        "def verlet_step(q, v, a, acceleration, dt):\n    return np.array(q)[99], v, a"
    )
    shown = kernel.run("check(verlet_step)")
    assert "your cell:4 in verlet_step" in shown["text/plain"]
    assert "IndexError" in shown["text/html"]


def test_a_borrowed_name_is_named_and_nothing_is_graded(kernel: Kernel) -> None:
    before = kernel.record()
    kernel.run("import numpy as np\nrng = np.random.default_rng(1)")
    kernel.run("def verlet_step(q, v, a, acceleration, dt):\n    return q, v, rng.normal()")
    shown = kernel.run("r = check(verlet_step)\nr")
    assert "verlet_step uses rng" in shown["text/plain"]
    assert "Not graded" in shown["text/html"]
    assert kernel.run("print(r.reason)")["stream"] == "borrowed_name\n"
    assert kernel.record() == before


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("check(3)", "not a value of type int"),
        ("check('verlet')", "not its name"),
        ("def verlet_stp(): pass\ncheck(verlet_stp)", "Did you mean verlet_step?"),
        ("check(len)", "No exercise asks for len"),
        ("check(lambda x: x)", "No exercise asks for <lambda>"),
        ("def g(): pass\ncheck(g, 'verlt')", "did you mean verlet"),
        ("def g(): pass\ncheck(g, 'verlet')", "verlet_step is not defined. The code defines g"),
    ],
)
def test_a_mistake_is_a_sentence_and_never_raises(kernel: Kernel, code: str, text: str) -> None:
    shown = kernel.run(code)
    assert "error" not in shown, shown.get("traceback")
    assert text in " ".join(shown["text/plain"].split())
    assert "text/html" in shown


def below(pid: int) -> set[int]:
    """The processes below one, by /proc."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        try:
            parents[int(entry.name)] = int(
                (entry / "stat").read_text().rpartition(")")[2].split()[1]
            )
        except (ValueError, OSError):
            continue
    result: set[int] = set()
    while more := {child for child, parent in parents.items() if parent in {pid, *result}} - result:
        result |= more
    return result


@pytest.mark.slow
def test_an_interrupt_ends_the_grading_and_leaves_no_process(kernel: Kernel) -> None:
    kernel.run(
        # It sleeps: what it may take is processor time, so that a busy machine does not end it.
        "def verlet_step(q, v, a, acceleration, dt):\n    import time\n"
        "    while True:\n        time.sleep(0.01)\nimport os"
    )
    pid = int(kernel.run("print(os.getpid())")["stream"])
    before = kernel.record()
    visited: set[int] = set()

    def interrupt() -> None:
        deadline = time.monotonic() + 120
        while len(below(pid)) < 2 and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(0.3)
        visited.update(below(pid))
        kernel.manager.interrupt_kernel()

    shown = kernel.run("check(verlet_step)", after_start=interrupt)
    assert shown["error"] == "KeyboardInterrupt"
    assert len(visited) >= 2
    assert below(pid) == set()
    assert not any(Path(f"/proc/{one}").exists() for one in visited)
    assert kernel.record() == before
    kernel.run(RIGHT)
    assert kernel.run("check(verlet_step)")["text/plain"].startswith("RIGHT")


@pytest.mark.slow
def test_reasons_of_results_are_of_the_closed_list() -> None:
    shown = notebook.check(3)
    assert shown.reason is Reason.MISSING_NAME and not shown.passed
    assert repr(shown.chart()) == "Only a right answer goes on the chart."


# --- The robot's button ---------------------------------------------------------------------------


@pytest.mark.prove
def test_a_page_without_a_kernel_names_the_command_instead_of_a_button(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DRILLS_PROGRESS", "none")
    for chapter in range(4, 12):
        data = bundle(notebook.your_robot(chapter))
        for kind in ("text/plain", "text/html"):
            assert f"drills robot compare --chapter {chapter}" in data[kind]
            assert "button" not in data[kind].lower()
        assert "application/vnd.jupyter.widget-view+json" not in data
    assert "edge_check" in bundle(notebook.your_robot(5))["text/html"]
    home = bundle(notebook.your_robot())
    assert "drills robot run" in home["text/html"] and "0 of 5 parts" in home["text/plain"]
    assert "application/vnd.jupyter.widget-view+json" not in home


@pytest.mark.prove
def test_the_home_page_shows_the_robot_and_plays_its_next_level(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRILLS_PROGRESS", str(tmp_path / "progress.json"))
    monkeypatch.setenv("DRILLS_WORK", str(tmp_path))
    shown = notebook.your_robot()
    assert isinstance(shown, notebook.RobotButton)
    assert "next: drills start two_link_ik" in repr(shown) and "none yet of 6" in repr(shown)
    shown.button.click()
    # The course's parts pass level 1; it counts only for a robot with parts of one's own.
    assert "Level 1: 200 of 200 tasks" in shown.result.value
    assert "It does not count yet" in shown.result.value
    stored = json.loads((tmp_path / "robot.json").read_text(encoding="utf-8"))
    stored["passed"] = {"1": {"at": "2030-01-01"}, "2": {"at": "2030-01-02"}}
    (tmp_path / "robot.json").write_text(json.dumps(stored), encoding="utf-8")
    assert "Levels passed: 1, 2 of 6." in repr(notebook.your_robot())


@pytest.mark.prove
def test_the_button_plays_and_shows_what_a_part_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRILLS_PROGRESS", str(tmp_path / "progress.json"))
    monkeypatch.setenv("DRILLS_WORK", str(tmp_path))
    shown = notebook.your_robot(8)
    assert isinstance(shown, notebook.RobotButton)
    data = bundle(shown)
    assert "application/vnd.jupyter.widget-view+json" in data
    assert "drills robot compare --chapter 8" in data["text/html"]
    shown.button.click()
    assert "the imperfect arm of chapter 8: success" in shown.result.value
    assert "[" in shown.result.value and not shown.button.disabled
    empty = notebook.your_robot(5)
    assert isinstance(empty, notebook.RobotButton)
    empty.button.click()
    assert "drills start edge_check" in empty.result.value
