"""The project as a whole: imports, who may import whom, the set-up, the README."""

import ast
import functools
import os
import pty
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from course import CHAPTERS, charts, contents
from tests import budget
from tools import front, gallery

pytestmark = pytest.mark.smoke


ROOT = Path(__file__).resolve().parent.parent
PRESENT = [chapter for chapter in CHAPTERS if chapter.ready]
TOPICS = [chapter.topic for chapter in CHAPTERS]

# --- The table of contents ------------------------------------------------------------------------


def test_the_chapters_are_numbered_from_0_to_12() -> None:
    assert [chapter.number for chapter in CHAPTERS] == list(range(13))
    assert len(set(TOPICS)) == 13


@pytest.mark.parametrize("chapter", CHAPTERS, ids=TOPICS)
def test_a_chapter_has_the_title_of_its_page(chapter) -> None:
    source = ROOT / "notebooks" / "source" / f"{Path(chapter.notebook).stem}.py"
    first = re.search(r"^# # (.*)$", source.read_text(encoding="utf-8"), re.M)
    assert first is not None and first[1] == f"{chapter.number} · {chapter.title}"


def test_the_front_page_counts_what_is_there() -> None:
    """Its numbers are at most what the folders hold, and not a whole step less."""
    chapters, simulations, claims, pictures, exercises = map(
        int, re.findall(r"\d+", front.counts())
    )
    folders = ROOT / "course", ROOT / "docs" / "charts", ROOT / "drills" / "catalogue"
    models = [
        p
        for p in (folders[0] / "simulations").rglob("*.py")
        if re.search(r"^MODEL\b.* = ", p.read_text(encoding="utf-8"), re.M)
    ]
    records = (folders[0] / "derivations" / "record").glob("*.toml")
    recorded = sum(len(tomllib.loads(p.read_text(encoding="utf-8"))) for p in records)
    assert chapters == len(list((ROOT / "notebooks" / "source").glob("[0-9]*.py")))
    assert simulations == len(models)
    assert 0 <= recorded - claims < 100
    assert 0 <= len(list(folders[1].glob("*.png"))) - pictures < 10
    assert 0 <= len(list(folders[2].glob("*/card.toml"))) - exercises < 10


@pytest.mark.parametrize("chapter", CHAPTERS, ids=TOPICS)
def test_a_chapter_says_truly_whether_it_is_there(chapter) -> None:
    def is_module(name: str) -> bool:
        path = ROOT / name.replace(".", "/")
        return path.with_suffix(".py").exists() or (path / "__init__.py").exists()

    rooms = {
        chapter.module: is_module(chapter.module),
        chapter.notebook: (ROOT / chapter.notebook).exists(),
        chapter.simulation_module: is_module(chapter.simulation_module),
    }
    if chapter.ready:
        assert all(rooms.values()), rooms
    else:
        assert not rooms[chapter.notebook], "it has a notebook: set `there` in course/__init__.py"


# --- Importing ------------------------------------------------------------------------------------

# Numba itself imports SciPy's bare package, so its parts are looked for.
HEAVY = (
    "scipy.linalg scipy.special scipy.integrate matplotlib sympy torch mujoco ipywidgets anywidget"
    " IPython open3d small_gicp pinocchio ompl cyclonedds zenoh"
)


@pytest.mark.parametrize(
    "module", ["course", "course.vector_env", *(chapter.module for chapter in PRESENT)]
)
def test_importing_is_light_and_silent(module: str) -> None:
    program = (
        f"import sys, {module}\nprint(*[name for name in {HEAVY!r}.split() if name in sys.modules])"
    )
    environment = {k: v for k, v in os.environ.items() if "DISPLAY" not in k}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout.split() == []


# --- The doors: who may import whom ---------------------------------------------------------------

# The oracles. An adapter asks one of them for a chapter; a claim may be about one of them; the
# drill on randomisation, in course.drills, is about a MuJoCo model.
BIG = {
    "mujoco",
    "pinocchio",
    "ompl",
    "gymnasium",
    "open3d",
    "small_gicp",
    "pydrake",
    "pybullet",
    "cyclonedds",
    "zenoh",
}
VIEWS = {"matplotlib", "ipywidgets", "anywidget", "IPython", "traitlets"}
NUMERIC = {"numpy", "numba"}
# Chapter 3 sets the course's own code beside the simulators, that of arms, chapter 4, among it.
AHEAD = {("platforms", "kinematics")}
# Rooms that chapter 12 asks for what was measured, inside a function.
COLLECTED = {"measure", "derivations"}


@functools.cache
def modules() -> dict[str, Path]:
    """Every module under course/, by its import path."""
    result = {}
    for path in sorted((ROOT / "course").rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        result[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return result


def imports(tree: ast.AST, package: str, deferred: bool = False) -> Iterator[tuple[str, bool]]:
    """Every import under `tree`: its full name, and whether it waits for a call.

    What stands under `if TYPE_CHECKING` is never run and doesn't count.
    """
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            for child in node.orelse:
                yield from imports(child, package, deferred)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, deferred
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                stem = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*stem, base] if base else stem)
            for alias in node.names:
                yield f"{base}.{alias.name}", deferred
        else:
            inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            yield from imports(node, package, deferred or inside)


def room(module: str) -> str:
    """The second part of an import path under course: "oracles" of "course.oracles.mujoco"."""
    return module.split(".")[1] if module.count(".") else ""


def faults(module: str, source: str, is_package: bool = False) -> list[str]:
    """What `module` imports against the rules of the house."""
    package = module if is_package else module.rpartition(".")[0]
    here = room(module)
    known = {
        *TOPICS,
        "check",
        "compiled",
        "measure",
        "oracles",
        "simulations",
        "charts",
        "derivations",
    }
    result = []
    for name, deferred in imports(ast.parse(source), package):
        top = name.partition(".")[0]
        other = room(name) if top == "course" else ""
        ours = other if other in known else ""

        def refuse(reason: str, name: str = name) -> None:
            result.append(f"{module} imports {name}: {reason}")

        if top in {"tests", "drills", "solutions"}:
            refuse("the course stands on its own")
        about = here in {"oracles", "derivations"} or (here == "drills" and top == "mujoco")
        # Its classes are Gymnasium's: a base class is needed where they are defined.
        derived = here == "vector_env" and top == "gymnasium"
        if top in BIG and not derived and not (about and deferred):
            refuse("only an adapter in course.oracles or a claim does, inside a function")
        if top == "torch" and not deferred:
            refuse("it takes seconds: import it inside a function")
        if here in TOPICS:
            if top == "course":
                later = ours in TOPICS and TOPICS.index(ours) > TOPICS.index(here)
                later = later and (here, ours) not in AHEAD
                # The last chapter collects what was measured, when it is asked for.
                collects = here == "interview" and deferred and ours in COLLECTED
                if later or (ours and ours not in {*TOPICS, "check", "compiled"} and not collects):
                    refuse(
                        "a chapter knows earlier chapters, course.check and course.compiled only"
                    )
            elif top in VIEWS | {"sympy"}:
                refuse("a chapter has no picture and no widget")
            elif not deferred and top not in NUMERIC | sys.stdlib_module_names:
                refuse("a chapter needs NumPy and Numba to import, nothing else")
        elif here == "measure":
            if top == "course" and ours not in {"", "check", "measure"}:
                refuse("measuring is generic, it is handed functions")
            elif top not in {"course", "numpy", "matplotlib"} | sys.stdlib_module_names:
                refuse("measuring needs NumPy and matplotlib only")
        elif here == "oracles":
            if top == "course" and ours not in {"", "check", "oracles", "compiled", *TOPICS}:
                refuse("an oracle knows the chapters only")
            elif top in VIEWS:
                refuse("an oracle has no picture")
        elif here == "simulations":
            rooms = {"", "simulations", "check", "measure", "compiled", *TOPICS}
            if top == "course" and ours not in rooms:
                refuse("a simulation knows the chapters and course.measure only")
        elif here in {"check", "compiled"}:
            if top == "course" or top not in NUMERIC | sys.stdlib_module_names:
                refuse("it is under every chapter, so it needs NumPy and Numba only")
    return result


@pytest.mark.slow
@pytest.mark.parametrize("module", modules())
def test_imports_go_one_way(module: str) -> None:
    path = modules()[module]
    assert faults(module, path.read_text(encoding="utf-8"), path.name == "__init__.py") == []


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("course.rigid_body.planar", "import matplotlib.pyplot"),
        ("course.rigid_body.planar", "def f():\n    from ipywidgets import VBox"),
        ("course.rigid_body.planar", "import scipy.optimize"),
        ("course.rigid_body.planar", "import torch"),
        ("course.rigid_body.planar", "def f():\n    import mujoco"),
        ("course.rigid_body.planar", "from course import contact"),
        ("course.platforms.scenes", "from course import planning"),
        ("course.rigid_body.planar", "from course.oracles import mujoco"),
        ("course.rigid_body.planar", "from ..measure import stability"),
        ("course.rigid_body.planar", "def f():\n    import course.charts"),
        ("course.measure.stability", "from course import rigid_body"),
        ("course.measure.stability", "import scipy"),
        ("course.oracles.mujoco", "import mujoco"),
        ("course.vector_env.reach", "import mujoco"),
        ("course.drills", "import mujoco"),
        ("course.drills", "def f():\n    import ompl"),
        ("course.oracles.mujoco", "from course.simulations import canvas"),
        ("course.simulations.rigid_body", "from course.oracles import mujoco"),
        ("course.simulations.rigid_body", "import mujoco"),
        ("course.check", "from course import compiled"),
        ("course.check", "import scipy"),
        ("course.compiled", "from course import rigid_body"),
        ("course.charts.rigid_body.accuracy", "import drills"),
        ("course.interview.fields", "from course import charts"),
        ("course.interview.fields", "def f():\n    from course.charts import FOLDER"),
        ("course.interview.fields", "def f():\n    from course.oracles import mujoco"),
    ],
)
def test_a_forbidden_import_is_found(module: str, source: str) -> None:
    assert faults(module, source)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("course.rigid_body.planar", "import math\nimport numba\nfrom course import compiled"),
        ("course.rigid_body.planar", "from .quaternion import rotate"),
        ("course.rigid_body.planar", "from course.check import positive"),
        ("course.measure.scene", "from course.check import positive"),
        ("course.contact", "from course import rigid_body"),
        ("course.platforms.scenes", "from course import kinematics"),
        ("course.rigid_body.problems", "def f():\n    from scipy.special import ellipj"),
        ("course.drills", "def f():\n    import mujoco"),
        ("course.oracles.mujoco", "def f():\n    import mujoco\nfrom course import rigid_body"),
        ("course.measure.scene", "if TYPE_CHECKING:\n    import scipy\nimport numpy"),
        ("course.simulations.canvas", "import anywidget\nfrom course.measure import scene"),
        ("course.interview.fields", "def f():\n    from course.measure import data"),
    ],
)
def test_an_allowed_import_is_not_found(module: str, source: str) -> None:
    assert faults(module, source) == []


# --- The set-up -----------------------------------------------------------------------------------

# Stands for Python and for the Python of the .venv that it makes; writes down what is installed.
FAKE_PYTHON = """#!/bin/sh
case "$*" in
    *"version_info[:3]"*) echo "${FAKE_VERSION:-3.11.9}" ;;
    *"version_info < (3, 14)"*) [ -z "$FAKE_OLD" ] ;;
    "--version") echo "Python ${FAKE_VERSION:-3.11.9}" ;;
    *"import venv"*) [ -z "$FAKE_NO_VENV" ] ;;
    "-m venv "*) mkdir -p "$3/bin" && cp "$0" "$3/bin/python" ;;
    "-m tools."*)
        echo "$*" >> runs
        [ "$*" != "-m tools.libraries" ] || [ -z "$FAKE_LIBRARY" ] || {
            echo "libGL.so.1 is missing" >&2; exit 1; } ;;
    "-m pip install "*)
        echo "$*" >> installs
        [ ! -t 1 ] || echo "a progress bar"
        echo "Collecting numpy, and a hundred lines more"
        touch .venv/half-made
        case "$*" in
            *"--log "*) log=${*#*--log }; log=${log%% *} ;;
            *) log=/dev/stdout ;;
        esac
        printf '0 Found link numpy-1.0\n0   Skipping link: numpy-1.0.zip\n0 Using pip\n' >> "$log"
        [ -z "$FAKE_FAIL" ] || { echo "no such package" >&2; exit 1; }
        echo "Successfully installed numpy-2.0 scipy-1.15" >> "$log" ;;
esac
"""


class Tree:
    """A project folder whose Python is a script."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        shutil.copy(ROOT / "Makefile", folder)
        (folder / "tools").mkdir()
        shutil.copy(ROOT / "tools" / "setup.sh", folder / "tools")
        (folder / "pyproject.toml").write_text("[project]\n")
        (folder / "constraints.txt").write_text("numpy==2.0\n")
        (folder / "python").write_text(FAKE_PYTHON)
        (folder / "python").chmod(0o755)

    def make(self, *arguments: str, python: str | None = "./python", **environment: str):
        """Run make with both streams in pipes."""
        command = ["make", *arguments, *([f"PYTHON={python}"] if python else [])]
        return subprocess.run(
            command,
            cwd=self.folder,
            env=self.environment(environment),
            capture_output=True,
            text=True,
            timeout=60,
        )

    def make_in_a_terminal(self, *arguments: str, **environment: str) -> tuple[int, list[str]]:
        """Run make in a terminal and return its exit code and the lines on the screen."""
        ours, theirs = pty.openpty()
        try:
            done = subprocess.run(
                ["make", *arguments, "PYTHON=./python"],
                cwd=self.folder,
                env=self.environment(environment),
                stdin=subprocess.DEVNULL,
                stdout=theirs,
                stderr=theirs,
                timeout=60,
            )
            # The screen holds a few hundred bytes, which fit into the terminal's buffer.
            return done.returncode, os.read(ours, 1 << 16).decode().splitlines()
        finally:
            os.close(ours)
            os.close(theirs)

    @staticmethod
    def environment(more: dict[str, str]) -> dict[str, str]:
        clean = {k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k != "PYTHON"}
        return clean | more

    @property
    def installs(self) -> int:
        log = self.folder / "installs"
        return len(log.read_text().splitlines()) if log.exists() else 0

    @property
    def stamp(self) -> Path:
        return self.folder / ".venv" / "installed"


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path / "a tree")


def test_a_second_set_up_does_nothing(tree: Tree) -> None:
    first = tree.make("setup")
    assert first.returncode == 0, first.stderr
    assert "making .venv: there is none yet" in first.stdout
    second = tree.make("setup")
    assert second.returncode == 0
    assert "up to date" in second.stdout
    assert tree.installs == 1
    # Without PYTHON= the .venv that is there is used, whatever `python3` is.
    assert "up to date" in tree.make("setup", python=None).stdout


def test_the_pins_are_used(tree: Tree) -> None:
    tree.make("setup")
    log = (tree.folder / "installs").read_text()
    assert "install -c constraints.txt -e .[learning,oracles,lab,test]" in log


def test_a_failed_install_is_not_trusted(tree: Tree) -> None:
    failed = tree.make("setup", FAKE_FAIL="1")
    assert failed.returncode != 0
    assert "no such package" in failed.stderr
    assert "installing failed: the last lines are above, all of it is in build/setup.log" in (
        failed.stderr
    )
    assert "no such package" in (tree.folder / "build" / "setup.log").read_text()
    assert not tree.stamp.exists()
    (tree.folder / ".venv" / "left-over").touch()
    again = tree.make("setup")
    assert again.returncode == 0
    assert "making .venv: the last install did not finish" in again.stdout
    assert not (tree.folder / ".venv" / "left-over").exists()
    assert tree.installs == 2


DURATION = r"(?:\d+ min )?\d+ s"


def test_a_step_is_a_line_with_its_duration_and_the_first_reports_what_it_costs(tree: Tree) -> None:
    first = tree.make("setup")
    assert first.stderr == ""
    _, sizes, made, installing, installed, checked, ready = first.stdout.splitlines()
    announced = r"about \d+ packages: about [\d.]+ GB to download, [\d.]+ GB on disk"
    assert re.match(announced, sizes)
    assert re.fullmatch(f"made .venv in {DURATION}", made)
    assert "build/setup.log" in installing
    assert re.fullmatch(f"installed 2 packages in {DURATION}", installed)
    assert re.fullmatch(f"checked the packages in {DURATION}", checked)
    assert re.fullmatch(f".venv is ready after {DURATION}", ready)
    assert "a hundred lines more" in (tree.folder / "build" / "setup.log").read_text()
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    assert "on disk" not in tree.make("setup").stdout


@pytest.mark.parametrize(
    ("seconds", "words"), [(0, "0 s"), (59, "59 s"), (60, "1 min 0 s"), (3725, "62 min 5 s")]
)
def test_a_duration_is_in_minutes_and_seconds(seconds: int, words: str) -> None:
    script = (ROOT / "tools" / "setup.sh").read_text(encoding="utf-8")
    (function,) = re.findall(r"^elapsed\(\) .*?^}$", script, re.M | re.S)
    clock = f"date() {{ echo {1_700_000_000 + seconds}; }}"
    program = f"{clock}\n{function}\nelapsed 1700000000"
    done = subprocess.run(["sh", "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == f"{words}\n"


def test_a_terminal_shows_the_progress_of_pip_and_the_log_has_it_too(tree: Tree) -> None:
    code, screen = tree.make_in_a_terminal("setup")
    assert code == 0 and "a progress bar" in screen
    assert any(re.fullmatch(f"installed 2 packages in {DURATION}", line) for line in screen)
    # Without what pip logs about every file of an index.
    log = (tree.folder / "build" / "setup.log").read_text().splitlines()
    assert log == ["0 Using pip", "Successfully installed numpy-2.0 scipy-1.15"]
    assert [path.name for path in (tree.folder / "build").iterdir()] == ["setup.log"]
    code, screen = tree.make_in_a_terminal("platforms")
    assert code == 0 and "a progress bar" in screen
    # What failed is on the screen already: it isn't shown twice.
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    code, screen = tree.make_in_a_terminal("setup", FAKE_FAIL="1")
    assert code != 0 and screen.count("no such package") == 1
    assert any(line.startswith("installing failed: the last lines are above") for line in screen)


def test_a_missing_library_of_the_system_stops_the_set_up_but_not_the_installation(
    tree: Tree,
) -> None:
    failed = tree.make("setup", FAKE_LIBRARY="1")
    assert failed.returncode != 0
    assert failed.stderr.startswith("libGL.so.1 is missing\n.venv is not ready\n")
    assert not tree.stamp.exists()
    # Once it is there, only the check is repeated; with other pins the packages are installed.
    again = tree.make("setup")
    assert again.returncode == 0
    assert again.stdout.startswith("checking .venv again")
    assert tree.installs == 1 and tree.stamp.exists()
    assert "up to date" in tree.make("setup").stdout
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    assert tree.make("setup", FAKE_LIBRARY="1").returncode != 0
    assert "checking .venv again" in tree.make("setup", FAKE_LIBRARY="1").stdout
    (tree.folder / "constraints.txt").write_text("numpy==2.2\n")
    assert "updating .venv" in tree.make("setup").stdout
    assert tree.installs == 3


def test_lab_compiles_in_the_background_and_then_opens(tree: Tree) -> None:
    done = tree.make("lab")
    assert done.returncode == 0, done.stderr
    runs = (tree.folder / "runs").read_text().splitlines()
    assert runs == ["-m tools.libraries", "-m tools.warm --background", "-m tools.lab"]
    assert done.stderr == ""
    assert done.stdout.splitlines()[-1] == "compiling the chapters in the background"


def test_the_other_simulators_are_added_once_and_lab_does_without(tree: Tree) -> None:
    assert tree.make("lab").returncode == 0
    log = tree.folder / "installs"
    assert "platforms" not in log.read_text()
    failed = tree.make("platforms", FAKE_FAIL="1")
    assert failed.returncode != 0
    assert "no such package" in failed.stderr and "installing failed" in failed.stderr
    for again in range(2):
        done = tree.make("platforms")
        assert done.returncode == 0, done.stderr
        assert ("adding the other simulators" in done.stdout) == (not again)
    assert log.read_text().splitlines()[-1].endswith("install -c constraints.txt -e .[platforms]")
    assert tree.installs == 3
    assert "up to date" in tree.make("setup").stdout
    # With other pins, or in a new environment, they are added anew.
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    assert "adding the other simulators" in tree.make("platforms").stdout
    moved = tree.folder.rename(tree.folder.with_name("moved"))
    tree.folder = moved
    assert "adding the other simulators" in tree.make("platforms").stdout


def test_the_readme_announces_what_the_set_up_announces() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    sizes = dict(re.findall(r"^(PACKAGES|DOWNLOAD|DISK) := (.*)$", makefile, re.M))
    text = "about {PACKAGES} pinned packages: {DOWNLOAD} to download and {DISK} on disk"
    assert text.format(**sizes) in readme


def test_changed_pins_are_installed_and_a_failure_then_is_not_trusted(tree: Tree) -> None:
    tree.make("setup")
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    failed = tree.make("setup", FAKE_FAIL="1")
    assert failed.returncode != 0
    assert "updating .venv" in failed.stdout
    assert not tree.stamp.exists()
    assert "did not finish" in tree.make("setup").stdout
    (tree.folder / "constraints.txt").write_text("numpy==2.2\n")
    assert "updating .venv" in tree.make("setup").stdout
    assert "up to date" in tree.make("setup").stdout


def test_a_cut_stamp_is_not_trusted(tree: Tree) -> None:
    tree.make("setup")
    tree.stamp.write_text("\n".join(tree.stamp.read_text().splitlines()[:2]) + "\n")
    assert "did not finish" in tree.make("setup").stdout


def test_a_moved_tree_gets_a_new_environment(tree: Tree) -> None:
    tree.make("setup")
    moved = tree.folder.rename(tree.folder.with_name("moved"))
    tree.folder = moved
    assert "making .venv: the one here was made in" in tree.make("setup").stdout
    assert "up to date" in tree.make("setup").stdout


def test_another_python_gets_a_new_environment(tree: Tree) -> None:
    tree.make("setup")
    other = tree.folder / "python3.12"
    other.write_text(FAKE_PYTHON.replace("3.11.9", "3.12.1"))
    other.chmod(0o755)
    again = tree.make("setup", python="./python3.12")
    assert "it has Python 3.11.9 and ./python3.12 is 3.12.1" in again.stdout
    assert "up to date (Python 3.12.1)" in tree.make("setup", python="./python3.12").stdout


def test_a_missing_or_old_python_leaves_what_is_there(tree: Tree) -> None:
    tree.make("setup")
    for python, environment, sentence in (
        ("./nowhere", {}, "'./nowhere' was not found. The course needs Python 3.11"),
        ("./old", {"FAKE_OLD": "1"}, "'./old' is Python 3.9.2. The course needs Python 3.11"),
        ("./old", {"FAKE_NO_VENV": "1"}, "has no venv module"),
    ):
        old = tree.folder / "old"
        old.write_text(FAKE_PYTHON.replace("3.11.9", "3.9.2"))
        old.chmod(0o755)
        done = tree.make("setup", python=python, **environment)
        assert done.returncode != 0
        assert sentence in done.stderr
        assert tree.stamp.exists()


def test_help_is_the_default_and_names_every_target(tree: Tree) -> None:
    named = set(re.findall(r"^  make (\w+) ", tree.make().stdout, re.M))
    assert {"lab", "check", "test", "charts", "notebooks", "warm", "clean", "setup"} <= named
    assert named == targets()


# --- The files ------------------------------------------------------------------------------------


def tracked() -> list[Path]:
    """Files that git knows or would add, as far as they are there."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    paths = [ROOT / name for name in done.stdout.split("\0") if name]
    return [path for path in paths if path.is_file()]


def targets() -> set[str]:
    """The targets of the Makefile that carry a description."""
    return set(re.findall(r"^(\w+):.*## ", (ROOT / "Makefile").read_text(), re.M))


@pytest.mark.prove
def test_no_file_names_a_machine() -> None:
    paths = re.compile(r"(?<![\w.~/-])/(?:work|tmp|home|root|Users)/\w")
    hosts = re.compile("pypi" + r"\.org|pythonhosted" + r"\.org|download\.py" + "torch")
    result = []
    for path in tracked():
        data = path.read_bytes()
        if b"\0" in data:
            continue
        for number, line in enumerate(data.decode("utf-8").splitlines(), 1):
            if '"image/' in line:  # a picture, in base 64
                continue
            if paths.search(line) or hosts.search(line):
                result.append(f"{path.relative_to(ROOT)}:{number}: {line[:100]}")
    assert result == []


def test_no_file_is_large() -> None:
    large = [str(path.relative_to(ROOT)) for path in tracked() if path.stat().st_size > 1.5e6]
    assert large == []


@pytest.mark.parametrize(
    "path", sorted((ROOT / "notebooks" / "source").glob("*.py")), ids=lambda p: p.stem
)
def test_no_line_of_a_notebook_is_long(path: Path) -> None:
    """Lines have at most 120 columns, but for the rows of a Markdown table."""
    lines = path.read_text(encoding="utf-8").splitlines()
    long = [f"{n}: {line}" for n, line in enumerate(lines, 1) if len(line) > 120]
    assert [line for line in long if not re.match(r"\d+: # \|", line)] == []


def test_every_dependency_is_pinned() -> None:
    def normal(name: str) -> str:
        return re.sub(r"[-_.]+", "-", name).lower()

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    expected = [*project["dependencies"]]
    for extra in project["optional-dependencies"].values():
        expected += extra
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.]+", line) for line in lines)
    pinned = {normal(line.partition("==")[0]) for line in lines}
    assert {normal(re.split(r"[<>=!~ \[]", line)[0]) for line in expected} <= pinned


@pytest.mark.parametrize(
    ("path", "topic"),
    [
        ("course/contact.py", "contact"),
        ("course/charts/rigid_body/drift.py", "rigid_body"),
        ("course/derivations/contact.py", "contact"),
        ("notebooks/source/02_contact.py", "contact"),
        ("tests/prove/contact/test_gjk.py", "contact"),
        ("solutions/rigid_body.py", "rigid_body"),
        ("drills/catalogue/rrt/exercise.py", "planning"),
        ("drills/sandbox/child.py", "drills"),
        ("tests/prove/drills/test_hostile.py", "drills"),
        ("course/measure/scene.py", "measure"),
        ("course/vector_env/reach.py", "vector_env"),
        ("course/compiled.py", "project"),
    ],
)
def test_every_file_counts_for_one_topic(path: str, topic: str) -> None:
    assert budget.topic_of(path) == topic


@pytest.mark.prove
def test_the_quick_tests_have_something_of_every_topic() -> None:
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(
        [*command, "-m", "not slow", "tests"], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout[-2000:]
    files = re.findall(r"^tests/(\w+)/\S+::", done.stdout, re.M)
    assert set(TOPICS) <= set(files)


# --- The README -----------------------------------------------------------------------------------

DOCUMENTS = ["README.md", "CONTRIBUTING.md"]


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_command_in_the_text_is_there(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    commands = set(re.findall(r"\bmake (?:[A-Z]+=\S+ )?([a-z]+)\b(?=`|\n| +#)", text))
    assert commands, "no command found"
    assert commands <= targets()
    for module in re.findall(r"python -m ([\w.]+)", text):
        if module.partition(".")[0] in sys.stdlib_module_names:
            continue
        path = ROOT / module.replace(".", "/")
        assert path.with_suffix(".py").exists() or (path / "__main__.py").exists(), module


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_link_in_the_text_leads_somewhere(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", text) if "://" not in link]
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_the_map_of_chapters_in_the_readme_is_the_table_of_contents() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert contents.map_of_chapters("notebooks/") in text


def test_the_readme_counts_what_moves_on_the_site() -> None:
    first, *_ = contents.moving().splitlines()
    assert first in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_says_how_long_the_course_takes() -> None:
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert front.hours() in text


def test_the_first_link_of_the_readme_is_the_site_of_pyproject() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    first = re.search(r"(?<!!)\[[^\]]+\]\(([^)]+)\)", text)
    assert first is not None and first[1] == settings["project"]["urls"]["Documentation"]
    assert gallery.readme() == text


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


def test_the_gallery_shows_every_chart_as_it_was_built() -> None:
    assert gallery.GALLERY.read_text(encoding="utf-8") == gallery.gallery()
    shown = re.findall(r"^!\[(\w+)\]", gallery.gallery(), re.M)
    assert sorted(shown) == sorted(path.stem for path in charts.PICTURES.glob("*.png"))


@pytest.mark.prove
def test_the_film_of_the_readme_is_up_to_date() -> None:
    from tests.simulations.films import is_out_of_date

    assert not is_out_of_date(gallery.FILM.read_bytes(), gallery.readme_film()), (
        "docs/film.png is out of date: .venv/bin/python -m tools.gallery"
    )


def test_the_code_on_the_first_page_runs_and_is_as_exact_as_the_chart() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    code = re.findall(r"```python\n(.*?)```", text, re.S)[0]
    result: dict[str, float] = {}
    exec(code, result)
    assert result["error"] < 1e-9
