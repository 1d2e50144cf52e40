"""The project as a whole: imports, who may import whom, its files, the README."""

import ast
import functools
import graphlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from course import CHAPTERS, PREREQUISITES, charts
from tests import budget
from tools import contents, front, gallery

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


# What a chapter needs, and how the front page calls it.
MATHEMATICS = {
    "vector|matri|least squares": "Linear algebra",
    "derivative": "derivatives",
    "eigenvalue": "eigenvalues",
    "differential equation": "differential equations",
    "probability|expectation|variance|distribution": "probability",
}


def test_the_front_page_names_the_mathematics_that_the_chapters_need() -> None:
    """Each chapter says at its top what it needs, as the front page promises."""
    named = set()
    for chapter in CHAPTERS:
        source = ROOT / "notebooks" / "source" / f"{Path(chapter.notebook).stem}.py"
        text = re.sub(r"\s*\n#? ?", " ", source.read_text(encoding="utf-8"))
        needs = re.search(r"(?:\*\*Know first:\*\*|You need) ([^.]+)\.", text[:8000])
        assert needs, chapter.topic
        named |= {name for words, name in MATHEMATICS.items() if re.search(words, needs[1])}
    assert named >= {"eigenvalues", "derivatives", "probability"}
    assert [name for name in sorted(named) if name not in PREREQUISITES] == []


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


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    ["course", *budget.sampled(["course.vector_env", *(chapter.module for chapter in PRESENT)], 3)],
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
def modules(*folders: str) -> dict[str, Path]:
    """Every module under course/, or under these folders, by its import path."""
    result = {}
    for path in sorted(p for one in folders or ("course",) for p in (ROOT / one).rglob("*.py")):
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


def circle(sources: dict[str, str], packages: set[str]) -> list[str]:
    """Return modules that import each other in a circle, empty if there is none.

    An import counts wherever it stands: in a function, and under `if TYPE_CHECKING`.
    """
    needs: dict[str, set[str]] = {}
    for module, source in sources.items():
        package = module if module in packages else module.rpartition(".")[0]
        tree = ast.parse(source)
        guarded = [n.body for n in ast.walk(tree) if isinstance(n, ast.If)]
        trees = [tree, *(ast.Module(body, []) for body in guarded)]
        names = [name for each in trees for name, _ in imports(each, package)]
        # `from a import b` may name the module a.b, or something in the module a.
        known = {n if n in sources else n.rpartition(".")[0] for n in names}
        needs[module] = (known & set(sources)) - {module}
    try:
        graphlib.TopologicalSorter(needs).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def test_no_modules_import_each_other_in_a_circle() -> None:
    paths = modules("course", "drills", "solutions", "tools")
    sources = {module: path.read_text(encoding="utf-8") for module, path in paths.items()}
    packages = {module for module, path in paths.items() if path.name == "__init__.py"}
    assert circle(sources, packages) == []


@pytest.mark.parametrize(
    "back",
    ["import p.a", "from p import a", "from . import a", "from p.a import x", "from .a import x"],
)
@pytest.mark.parametrize("form", ["{}", "def f():\n    {}", "if TYPE_CHECKING:\n    {}"])
def test_a_circle_of_imports_is_found(back: str, form: str) -> None:
    sources = {"p": "", "p.a": "from p.b import y", "p.b": form.format(back), "p.c": "import p.a"}
    assert set(circle(sources, {"p"})) == {"p.a", "p.b"}
    assert circle(sources | {"p.b": "from p import z"}, {"p"}) == []


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
    # Options for the outer run, such as -v, would change how the list is printed.
    plain = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
    done = subprocess.run(
        [*command, "-m", "not slow", "tests"],
        cwd=ROOT,
        env=plain,
        capture_output=True,
        text=True,
        timeout=300,
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


def test_contributing_names_a_field_of_a_chapter() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (field,) = re.findall(r"Set `(\w+)=True`", text)
    assert getattr(CHAPTERS[0], field) is True


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
