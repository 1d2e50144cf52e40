"""What is said where a library cannot be imported: the real cause, and what installs it."""

import ctypes
import importlib.util
import re
import sys
from pathlib import Path

import pytest

from course import libraries
from course.oracles import (
    coal,
    cyclonedds,
    drake,
    gymnasium,
    mink,
    ompl,
    open3d,
    opencv,
    pink,
    pinocchio,
    pybullet,
    sb3,
    small_gicp,
    vamp,
    zenoh,
)
from course.oracles.mujoco import kit
from drills import doctor
from tools import libraries as tool

ROOT = Path(__file__).parents[1]
GOMP = "libgomp.so.1: cannot open shared object file: No such file or directory"
# The module that an adapter imports, and the function of the adapter that imports it.
ADAPTERS = {
    "cv2": opencv.library,
    "cyclonedds": cyclonedds.library,
    "coal": coal._coal,
    "gymnasium": gymnasium._gymnasium,
    "mink": mink.library,
    "mujoco": kit.library,
    "ompl": ompl._ompl,
    "open3d": open3d.library,
    "pink": pink.library,
    "pinocchio": pinocchio._pinocchio,
    "pybullet": pybullet.library,
    "pydrake": drake.library,
    "small_gicp": small_gicp.library,
    "stable_baselines3": lambda: sb3.vec_env(None),
    "torch": libraries.pytorch,
    "vamp": vamp.library,
    "zenoh": zenoh.library,
}


@pytest.fixture
def fake(tmp_path, monkeypatch):
    """Put a package in place of a real one, for one test: its text is all that it has."""

    def make(name, text):
        name = name.partition(",")[0]
        for module in [m for m in sys.modules if m.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, module)
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)

    return make


@pytest.fixture(autouse=True)
def nothing_absent(monkeypatch):
    monkeypatch.setattr(libraries, "absent_packages", lambda: [])
    monkeypatch.setattr(tool, "absent_packages", lambda: [])


@pytest.mark.parametrize("name", ADAPTERS)
def test_an_adapter_names_the_shared_library_that_is_missing(name, fake):
    fake(name, f"raise ImportError({GOMP!r})")
    with pytest.raises(ImportError) as caught:
        ADAPTERS[name]()
    assert re.fullmatch(
        r"[\w -]+(, a part of Pinocchio)? is installed, but the system library libgomp\.so\.1 is "
        r"missing: apt-get install --no-install-recommends libgomp1",
        str(caught.value),
    )
    assert GOMP in str(caught.value.__cause__)


@pytest.mark.parametrize("name", ADAPTERS)
def test_an_adapter_says_what_pip_installs(name, monkeypatch):
    module = name.partition(",")[0]
    for known in [m for m in sys.modules if m.partition(".")[0] == module]:
        monkeypatch.delitem(sys.modules, known)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError, match=r"^this needs .*pip install '[\w.-]+>=[\d.]+"):
        ADAPTERS[name]()


def test_drills_doctor_imports_what_it_reports(fake):
    fake("pinocchio", f"raise ImportError({GOMP!r})")
    row = doctor._library("pinocchio", "pin", "the comparison of fk3", "oracles")
    assert not row["ok"] and "the system library libgomp.so.1 is missing" in row["detail"]
    assert doctor._library("numpy", "numpy", "everything", "")["ok"]


def test_another_cause_is_reported_as_it_is(fake):
    fake("pinocchio", "raise ImportError('undefined symbol: boost\\nand a page more')")
    with pytest.raises(ImportError) as caught:
        pinocchio._pinocchio()
    expected = "Pinocchio is installed, but importing it fails: undefined symbol: boost"
    assert str(caught.value) == expected


def test_a_package_that_lacks_another_one_is_told_apart(fake):
    fake("pinocchio", "import surely_not_here")
    with pytest.raises(ModuleNotFoundError, match="there is no module surely_not_here"):
        pinocchio._pinocchio()


def test_what_the_loader_writes_is_understood():
    with pytest.raises(OSError) as caught:
        ctypes.CDLL("libsurely-not-here.so.7")
    assert libraries.missing_shared_library(caught.value) == "libsurely-not-here.so.7"
    message = str(libraries.import_error("Lib", "pip install lib", caught.value))
    assert "the system library libsurely-not-here.so.7 is missing" in message
    assert "`apt-file search libsurely-not-here.so.7`" in message
    assert libraries.missing_shared_library(ImportError("libgomp.so.1 is fine")) == ""


def test_one_line_installs_all_that_is_absent(monkeypatch):
    monkeypatch.undo()
    monkeypatch.setitem(libraries.SYSTEM_PACKAGES, "libsurely-not-here.so.7", "libnothing7")
    assert "libnothing7" in libraries.absent_packages()
    message = str(libraries.import_error("Pinocchio", "pip install 'pin'", ImportError(GOMP)))
    assert re.search(
        r"apt-get install --no-install-recommends .*\blibgomp1 .*\blibnothing7$", message
    )


# --- python -m tools.libraries --------------------------------------------------------------------


def test_every_import_is_tried_and_each_cause_is_named():
    failed = tool.failures(
        {
            "fine": "import json; print('noise')",
            "gomp": f"raise ImportError({GOMP!r})",
            "egl": "raise OSError('libEGL.so.1: cannot open shared object file: No such file')",
            "own": "raise ImportError('libown.so.3: cannot open shared object file: No such file')",
            "value": "raise ValueError('something else')",
            "crash": "import os; os.abort()",
        }
    )
    assert failed == {
        "gomp": "libgomp.so.1: cannot open shared object file",
        "egl": "libEGL.so.1: cannot open shared object file",
        "own": "libown.so.3: cannot open shared object file",
        "value": "ValueError: something else",
        "crash": "the import ended with signal 6",
    }
    lines = tool.report(failed).splitlines()
    assert lines[0] == (
        "gomp is installed, but importing it fails: libgomp.so.1: cannot open shared object file"
    )
    assert "  apt-get install --no-install-recommends libegl1 libgomp1" in lines
    assert lines[-1] == "`apt-file search libown.so.3` finds the package that contains libown.so.3."


def test_exit_code_and_output(monkeypatch, capsys):
    monkeypatch.setattr(tool, "installed", lambda: ["numpy", "click"])
    assert tool.main() == 0
    assert capsys.readouterr() == ("2 libraries can be imported\n", "")
    monkeypatch.setitem(tool.STATEMENTS, "click", f"raise ImportError({GOMP!r})")
    assert tool.main() == 1
    out, error = capsys.readouterr()
    assert out == "" and error.splitlines()[-1].strip() == libraries.install_line(["libgomp1"])


def test_every_library_of_the_project_is_among_them():
    names = set(tool.requirements())
    assert set(tool.STATEMENTS) <= names
    assert {"numpy", "torch", "pin", "open3d", "drake", "jupyterlab", "sphinx"} <= names
    assert {"numpy", "pin", "open3d", "mujoco"} <= set(tool.installed()) <= names
    assert tool.statement("pin") == "import pinocchio, coal"
    assert tool.statement("some-name") == "import some_name"


def test_the_readme_names_the_packages_in_one_line():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (line,) = re.findall(r"^apt-get install --no-install-recommends (.*)$", text, re.MULTILINE)
    tools = {"ca-certificates", "git", "make", "python3-venv"}
    assert set(line.split()) == tools | set(libraries.SYSTEM_PACKAGES.values())


@pytest.mark.optional
def test_the_statement_of_each_installed_library_names_a_module_that_is_there():
    """A name that differs from the distribution's would stop every later set-up."""
    for name in tool.installed():
        for module in re.findall(r"import ([\w., ]+)", tool.statement(name)):
            for part in module.split(", "):
                top = part.partition(".")[0]
                assert importlib.util.find_spec(top), (name, top)
