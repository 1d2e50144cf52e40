"""`make lab`: the copies and the home page before the server, and where its words go."""

import base64
import contextlib
import json
import os
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import nbformat
import pytest
from nbformat.sign import NotebookNotary

from course.simulations import LIVE_TAG, declaration
from course.simulations.kinematics import arm
from drills import progress
from drills.chapters import ROOT
from tools import lab

# `python -m tools.lab`, on another folder than the project's.
PROGRAM = """
import pathlib, sys
import drills.chapters
drills.chapters.ROOT = pathlib.Path(sys.argv[1])
from tools import lab
lab.LOG = drills.chapters.ROOT / "build" / "lab.log"
sys.exit(lab.main(["--no-browser", "--ServerApp.port=0", "--ServerApp.ip=127.0.0.1"]))
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project folder with the course's index and a chapter of two cells."""
    monkeypatch.setenv("JUPYTER_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("JUPYTER_CONFIG_DIR", str(tmp_path / "config"))
    monkeypatch.setenv("DRILLS_PROGRESS", str(tmp_path / "progress.json"))
    folder = tmp_path / "notebooks"
    folder.mkdir()
    index = ROOT / "notebooks" / "index.ipynb"
    (folder / index.name).write_bytes(index.read_bytes())
    cells = [nbformat.v4.new_code_cell("1 + 1", id="one"), nbformat.v4.new_markdown_cell("two")]
    nbformat.write(nbformat.v4.new_notebook(cells=cells), folder / "01_rigid_body.ipynb")
    return tmp_path


def home_page(folder: Path) -> str:
    book = nbformat.read(folder / "work" / "index.ipynb", as_version=4)
    (home,) = [cell for cell in book.cells if lab.HOME_TAG in cell.metadata.get("tags", ())]
    assert home.source.endswith("home()")
    return home.outputs[0].data["text/markdown"]


@pytest.mark.slow
def test_a_copy_names_the_kernel_as_jupyterlab_does_on_opening_it(project: Path) -> None:
    """Asked of a kernel that runs, by the protocol; JupyterLab writes down its answer."""
    from jupyter_client.manager import start_new_kernel

    list(lab.copies(project / "work", project / "notebooks"))
    manager, client = start_new_kernel(kernel_name="python3")
    try:
        report = client.kernel_info(reply=True, timeout=60)["content"]["language_info"]
    finally:
        client.stop_channels()
        manager.shutdown_kernel(now=True)
    metadata = json.loads((project / "work" / "01_rigid_body.ipynb").read_text())["metadata"]
    assert metadata["language_info"] == report
    assert manager.kernel_spec is not None
    assert metadata["kernelspec"]["display_name"] == manager.kernel_spec.display_name
    # A second start changes nothing more.
    copies = {path: path.read_bytes() for path in (project / "work").glob("*.ipynb")}
    list(lab.copies(project / "work", project / "notebooks"))
    assert copies == {path: path.read_bytes() for path in (project / "work").glob("*.ipynb")}


def test_the_home_page_is_written_anew_from_the_progress(project: Path) -> None:
    states = [copy.state for copy in lab.copies(project / "work", project / "notebooks")]
    assert states == ["made", "made"]
    before = home_page(project)
    assert "Go on here" in before and "●" not in before.splitlines()[-3]
    progress.change(
        project / "progress.json", "fk3", lambda record: progress.note_attempt(record, True, {})
    )
    states = [copy.state for copy in lab.copies(project / "work", project / "notebooks")]
    assert states == ["as it was", "as it was"]
    after = home_page(project)
    assert after != before and after.count("●") == before.count("●") + 1


def test_the_home_page_has_a_simulation_that_runs_without_a_kernel(project: Path) -> None:
    """Its output has the whole panel: the picture, the compiled model, and what runs it."""
    list(lab.copies(project / "work", project / "notebooks"))
    book = nbformat.read(project / "work" / "index.ipynb", as_version=4)
    (cell,) = [c for c in book.cells if LIVE_TAG in c.metadata.get("tags", ())]
    data = cell.outputs[0].data
    html = data["text/html"]
    assert html.startswith('<div class="course-live" data-simulation="kinematics.arm" data-plays')
    wasm = base64.b64encode(declaration.module("kinematics.arm").read_bytes()).decode()
    assert wasm in html and "course-live" in declaration.script()
    assert html.count("<script>") == html.count("</script>") == 2
    assert data["image/png"] in html and data["text/plain"].startswith(arm.TITLE)


def test_what_is_recorded_runs_nowhere_by_itself() -> None:
    with pytest.raises(ValueError, match=r"^name must be a live simulation, got 'pipeline'"):
        declaration.inline("pipeline", "")


def test_a_copy_is_trusted_and_one_that_others_changed_is_not(project: Path) -> None:
    made = [copy.path for copy in lab.copies(project / "work", project / "notebooks")]
    with NotebookNotary() as notary:
        books = [nbformat.read(path, as_version=4) for path in made]
        assert all(notary.check_signature(book) for book in books)
        books[0].cells[0].source = "import os"
        assert not notary.check_signature(books[0])


@pytest.mark.parametrize("display", ["", ":0"])
def test_a_browser_opens_where_there_is_a_display(
    monkeypatch: pytest.MonkeyPatch, display: str
) -> None:
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.setattr(sys, "platform", "linux")
    options = lab.server_options(Path("log"), ["--port=1"])
    assert ("--no-browser" in options) is (not display)
    assert options[-1] == "--port=1"
    assert "--LabApp.default_url=/lab/tree/work/index.ipynb" in options
    assert f"--ServerApp.root_dir={ROOT}" in options


def address(project: Path, server: subprocess.Popen[str]) -> tuple[str, str]:
    """Where the server is, and its token, once it answers."""
    end = time.monotonic() + 90
    while time.monotonic() < end:
        assert server.poll() is None, server.communicate()
        for file in (project / "runtime").glob("jpserver-*.json"):
            with contextlib.suppress(OSError, ValueError):
                text = json.loads(file.read_text())
                with urllib.request.urlopen(f"{text['url']}api", timeout=5):
                    return text["url"], text["token"]
        time.sleep(0.1)
    raise AssertionError("JupyterLab did not start in 90 s")


@pytest.mark.prove
def test_the_terminal_gets_the_address_and_the_file_the_rest(project: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(project)],
        env=os.environ | {"JUPYTER_CONFIG_PATH": str(ROOT / ".jupyter"), "DISPLAY": ""},
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as server:
        try:
            url, token = address(project, server)
            page = f"{url}api/contents/work/index.ipynb?token={token}"
            with urllib.request.urlopen(page, timeout=60) as answer:
                cells = json.load(answer)["content"]["cells"]
        finally:
            server.terminate()
        out, errors = server.communicate(timeout=60)
    assert all(one["metadata"]["trusted"] for one in cells if one["cell_type"] == "code")
    lines = [line for line in out.splitlines() if line.strip()]
    assert "opening JupyterLab; Ctrl-C twice ends it" in lines
    assert any("/lab/tree/work/index.ipynb?token=" in line for line in lines)
    assert len(lines) < 14 and errors == "", (lines, errors)
    log = project / "build" / "lab.log"
    assert "INFO ServerApp: Serving notebooks from local directory" in log.read_text()
    assert log.stat().st_mode & 0o077 == 0
