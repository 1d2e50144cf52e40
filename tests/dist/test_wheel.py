"""The package as it is installed: a wheel, in an environment that holds what it depends on alone.

The environment is empty but for links to the packages that the wheel's own metadata ask for, and
to those that these ask for, so that no extra is there and nothing of the project's tree.
"""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

from course import CHAPTERS, charts

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("course", "drills", "solutions", "notebooks")
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
    "optional-dependencies"
]
FROM = {"SOURCE_DATE_EPOCH": "1700000000"}


def tracked() -> list[str]:
    """Files that git knows or would add, as far as they are there."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def build(source: Path, target: Path, *which: str) -> Path:
    """Build in `source`, as `make dist` does; gives the wheel."""
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(target), *which]
    done = subprocess.run(
        command, cwd=source, env={**os.environ, **FROM}, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    return next(target.glob("*.whl"))


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Path]]:
    """A clean copy of the tree, and the wheel that was made of its sdist."""
    folder = tmp_path_factory.mktemp("dist")
    tree = folder / "tree"
    for name in tracked():
        if name.startswith(ROOMS) or "/" not in name:
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tree / name)
    yield tree, build(tree, folder / "dist")
    shutil.rmtree(folder, ignore_errors=True)


def needed(requirements: list[str], extra: str = "") -> set[str]:
    """The distributions that these ask for, with those that they ask for in turn.

    What is not installed is left out: the set-up takes two of JupyterLab's away again.
    """
    result: set[str] = set()
    requested = [(Requirement(text), extra) for text in requirements]
    while requested:
        expected, of = requested.pop()
        if expected.marker and not expected.marker.evaluate({"extra": of}):
            continue
        for part in ["", *expected.extras]:
            if (key := f"{expected.name}[{part}]") not in result:
                try:
                    other = importlib.metadata.requires(expected.name) or ()
                except importlib.metadata.PackageNotFoundError:
                    continue
                result.add(key)
                requested += [(Requirement(text), part) for text in other]
    return {key.partition("[")[0] for key in result}


def link(distribution: str, site: Path) -> None:
    """Have a distribution in another environment as well."""
    known = importlib.metadata.distribution(distribution)
    for name in {file.parts[0] for file in known.files or ()} - {"..", "__pycache__"}:
        if not (site / name).exists():
            (site / name).symlink_to(Path(str(known.locate_file(name))).resolve())


@pytest.fixture(scope="module")
def place(built: tuple[Path, Path]) -> Path:
    """A folder outside the tree, with an environment in which the wheel is installed."""
    _, wheel = built
    folder = wheel.parents[1] / "elsewhere"
    environment = folder / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (site,) = environment.glob("lib/python*/site-packages")
    install = ["install", "-q", "--no-deps", "--no-index", "--no-compile", str(wheel)]
    pip = [sys.executable, "-m", "pip", "--python", str(environment / "bin" / "python")]
    subprocess.run([*pip, *install], check=True)
    (metadata,) = importlib.metadata.distributions(
        name="robotics-simulation-course", path=[str(site)]
    )
    for one in needed(metadata.requires or []):
        link(one, site)
    return folder


def newcomer(place: Path, what: str) -> dict[str, Any]:
    """Run the program of that name there; what it installed."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "DRILLS"))}
    program = [str(place / "env" / "bin" / "python"), "-P", "-c"]
    text = Path(__file__).with_name("newcomer.py").read_text(encoding="utf-8")
    done = subprocess.run(
        [*program, text, what],
        cwd=place,
        env={**clean, "COURSE_QUIET": "1", "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    result = json.loads(done.stdout.splitlines()[-1])
    assert isinstance(result, dict)
    return result


@pytest.fixture(scope="module")
def installed(place: Path) -> dict[str, Any]:
    return newcomer(place, "core")


# --- What is in it --------------------------------------------------------------------------------


def test_the_wheel_holds_what_git_knows_of_its_rooms(built: tuple[Path, Path]) -> None:
    inside = {n for n in zipfile.ZipFile(built[1]).namelist() if ".dist-info/" not in n}
    ours = {name for name in tracked() if name.split("/")[0] in ROOMS}
    assert inside == {name for name in ours if not name.startswith("notebooks/source/")}


def test_two_builds_are_equal_byte_for_byte(built: tuple[Path, Path]) -> None:
    tree, wheel = built
    # As in another clone, made by another person: neither age nor rights of a file are git's.
    for path in [tree / "README.md", *(tree / "course").glob("*.py")]:
        path.chmod(0o664)
        os.utime(path, (1, 1))
    again = build(tree, wheel.parents[1] / "again", "--sdist", "--wheel")
    pairs = {path: again.with_name(path.name) for path in wheel.parent.iterdir()}
    assert sorted(path.suffix for path in pairs) == [".gz", ".whl"]
    assert [a.name for a, b in pairs.items() if a.read_bytes() != b.read_bytes()] == []


# --- What one does with it ------------------------------------------------------------------------


def test_nothing_comes_from_the_tree_and_nothing_needs_an_extra(
    place: Path, installed: dict[str, Any]
) -> None:
    assert all(path.startswith(str(place)) for path in installed["places"])
    assert installed["unimportable"] == {}
    chapters = {name for c in CHAPTERS for name in (c.module, c.simulation_module)}
    assert chapters <= {*installed["imported"]}
    extras = ("torch", "pinocchio", "ompl", "open3d", "fsrs", "sphinx", "pytest")
    assert {*extras}.isdisjoint(installed["imported"])


def test_the_figures_of_every_chart_are_there(installed: dict[str, Any]) -> None:
    built = {Path(name).stem for name in tracked() if name.startswith("course/charts/data/")}
    assert {*installed["charts"]} == {*installed["registered"]} == built
    assert all(installed["charts"].values()) and all(installed["drawn"].values())
    pictures = {path.stem for path in charts.PICTURES.glob("*.png")}
    assert {*installed["drawn"]} == pictures


def test_a_claim_is_settled_and_a_formula_checked(installed: dict[str, Any]) -> None:
    assert len(installed["claims"]) == len(CHAPTERS) and all(installed["claims"].values())
    assert all(isinstance(value, float | int | str) for value in installed["claim"].values())
    right, wrong, message = installed["formula"]
    assert (right, wrong) == (True, False) and message.startswith("With m = 1")


def test_a_drill_is_started_failed_and_solved(installed: dict[str, Any]) -> None:
    code, listed, text = installed["list"]
    assert (code, text) == (0, "") and "verlet" in listed and "Exercises of chapter 12" in listed
    assert installed["start"][0] == 0
    assert installed["starter"][0] == 1 and "NOT ATTEMPTED" in installed["starter"][1]
    assert installed["wrong"][0] == 1 and installed["hint"][0] == 0 and installed["hint"][1]
    assert installed["right"][0] == 0 and "RIGHT" in installed["right"][1], installed["right"]


def test_an_interview_is_held(installed: dict[str, Any]) -> None:
    code, text, errors = installed["interview"]
    assert code == 0, errors
    words = " ".join(text.split())
    assert "45 min left" in words and "The report is work/interview/report-" in words


def test_the_notebooks_are_copied_without_the_pictures_that_are_not_there(
    place: Path, installed: dict[str, Any]
) -> None:
    for chapter in CHAPTERS:
        code, message, errors = installed["chapter"][chapter.topic]
        name = Path(chapter.notebook).name
        assert (code, errors) == (0, "") and f"jupyter lab work/{name}" in message
        text = (place / "work" / name).read_text(encoding="utf-8")
        assert "docs/charts" not in text
        pictures = (ROOT / chapter.notebook).read_text("utf-8").count("](../docs/charts/")
        assert text.count("(the picture is in the project's tree)") == pictures


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("torch", "learning"), ("pin", "oracles"),
        ("coal", "oracles"), ("ompl", "oracles"), ("open3d", "oracles"),
        ("small_gicp", "oracles"), ("cyclonedds", "oracles"), ("zenoh", "oracles"), ("sysid", "oracles"),
        ("drake", "platforms"), ("pybullet", "platforms"), ("sb3", "sb3"),
        ("mink", "ik"), ("pink", "ik"), ("opencv", "vision"), ("vamp", "simd"),
    ],
)
def test_one_sentence_says_what_an_extra_adds(installed: dict[str, Any], name: str, extra: str) -> None:
    message = installed["refusals"][name]
    assert message.startswith("this needs ") and "\n" not in message
    requested = re.findall(r"'([^']+)'", message)
    bounds = [text.partition(";")[0] for text in EXTRAS[extra]]
    assert requested and {*requested} <= {*bounds}, message


def test_cards_need_an_extra_and_then_review(place: Path, installed: dict[str, Any]) -> None:
    code, message = installed["review"][0], " ".join(installed["review"][2].split())
    assert code == 3
    assert message.startswith("The package fsrs is not installed, and this command needs it. ")
    assert "pip install 'robotics-simulation-course[lab]'" in message
    (site,) = place.glob("env/lib/python*/site-packages")
    for one in needed(EXTRAS["lab"]):
        link(one, site)
    after = newcomer(place, "lab")
    assert after["review"][0] == 0 and "rated 2 cards" in after["review"][1], after["review"]
    assert all(after[Path(chapter.notebook).name] > 3 for chapter in CHAPTERS)
