"""The set-up: what `make` installs and checks, run with a stand-in for Python that takes notes."""

import os
import pty
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.test_project import targets

pytestmark = pytest.mark.smoke

ROOT = Path(__file__).resolve().parent.parent

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
    # The packages of the course, and what builds the site.
    installed = (tree.folder / "installs").read_text().splitlines()
    assert [line.partition("-e ")[2] for line in installed] == [
        ".[learning,oracles,lab,test]",
        ".[site]",
    ]
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
    assert tree.installs == 3  # the one that failed, and two


DURATION = r"(?:\d+ min )?\d+ s"


def test_a_step_is_a_line_with_its_duration_and_the_first_reports_what_it_costs(tree: Tree) -> None:
    first = tree.make("setup")
    assert first.stderr == ""
    lines = first.stdout.splitlines()
    _, sizes, made, installing, installed, checked, ready, adding, added, compiling = lines
    announced = r"about \d+ packages: about [\d.]+ GB to download, [\d.]+ GB on disk"
    assert re.match(announced, sizes)
    assert re.fullmatch(f"made .venv in {DURATION}", made)
    assert "build/setup.log" in installing
    assert re.fullmatch(f"installed 2 packages in {DURATION}", installed)
    assert re.fullmatch(f"checked the packages in {DURATION}", checked)
    assert re.fullmatch(f".venv is ready after {DURATION}", ready)
    assert adding == "adding what builds the site to .venv; build/setup.log has the details"
    assert re.fullmatch(f"installed 2 packages in {DURATION}", added)
    assert compiling.startswith("compiling the hot loops of the chapters")
    assert (tree.folder / "runs").read_text().splitlines()[-1] == "-m tools.warm"
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
    assert log == ["0 Using pip", "Successfully installed numpy-2.0 scipy-1.15"] * 2
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
    assert tree.installs == 2 and tree.stamp.exists()  # the packages, and what builds the site
    assert "up to date" in tree.make("setup").stdout
    (tree.folder / "constraints.txt").write_text("numpy==2.1\n")
    assert tree.make("setup", FAKE_LIBRARY="1").returncode != 0
    assert "checking .venv again" in tree.make("setup", FAKE_LIBRARY="1").stdout
    (tree.folder / "constraints.txt").write_text("numpy==2.2\n")
    assert "updating .venv" in tree.make("setup").stdout
    assert tree.installs == 5  # the packages twice more, and what builds the site once more


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
