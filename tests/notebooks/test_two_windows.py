"""The same notebook open in two windows of JupyterLab: when a save asks, and when it does not."""

import asyncio
import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from tests.notebooks.test_browser import CHAPTER, ROOT, jupyter_lab, open_page

pytestmark = pytest.mark.slow


def book() -> Any:
    """A notebook of two cells, whose second counts how often it ran."""
    cells = [
        new_markdown_cell("# Two windows", id="title"),
        new_code_cell("runs = globals().get('runs', 0) + 1\nruns", id="counter"),
    ]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return new_notebook(cells=cells, metadata={"kernelspec": kernel})


# --- The hash -------------------------------------------------------------------------------------


def outputs(notebook: Any) -> None:
    notebook.cells[1].outputs = [new_output("stream", name="stdout", text="1")]
    notebook.cells[1].execution_count = 7


def metadata(notebook: Any) -> None:
    notebook.metadata["language_info"] = {"name": "python", "version": "3.99"}
    notebook.cells[0].metadata["collapsed"] = True
    notebook.cells[1].id = "another"


def text(notebook: Any) -> None:
    notebook.cells[0].source += "!"


def border(notebook: Any) -> None:
    """The same letters, with the border between the two cells elsewhere."""
    for cell, source in zip(notebook.cells, ("# Two", " windows"), strict=True):
        cell.source = source


def kind(notebook: Any) -> None:
    notebook.cells[1] = new_markdown_cell(notebook.cells[1].source)


def order(notebook: Any) -> None:
    notebook.cells.reverse()


def fewer(notebook: Any) -> None:
    del notebook.cells[0]


def picture(notebook: Any) -> None:
    notebook.cells[0]["attachments"] = {"a.png": {"image/png": base64.b64encode(b"a").decode()}}


def tag(notebook: Any) -> None:
    notebook.cells[1].metadata["tags"] = ["mine"]


@pytest.mark.parametrize("change", [outputs, metadata])
def test_what_a_run_changes_is_no_change_of_the_text(
    change: Callable[[Any], None], tmp_path: Path
) -> None:
    assert hashes(tmp_path, book(), changed(change))[0] is True


@pytest.mark.parametrize("change", [text, border, kind, order, fewer, picture, tag])
def test_what_a_person_writes_is_a_change(change: Callable[[Any], None], tmp_path: Path) -> None:
    assert hashes(tmp_path, book(), changed(change))[0] is False


@pytest.mark.parametrize("name", ["a.txt", "old.ipynb", "list.ipynb", "cut.ipynb"])
def test_what_is_no_notebook_of_today_has_the_hash_of_its_bytes(name: str, tmp_path: Path) -> None:
    from hashlib import sha256

    contents = {
        "a.txt": json.dumps(book()),
        "old.ipynb": '{"nbformat": 3, "nbformat_minor": 0, "metadata": {}, "worksheets": []}',
        "list.ipynb": "[1]",
        "cut.ipynb": '{"cells": [',
    }
    (tmp_path / name).write_text(contents[name])
    model = models(tmp_path, name, content=False)
    assert model["hash"] == sha256((tmp_path / name).read_bytes()).hexdigest()


def test_the_hash_is_that_of_what_was_read(tmp_path: Path) -> None:
    """With the content or without, as a notebook or as text; and only where it is requested."""
    nbformat.write(book(), tmp_path / "a.ipynb")
    whole = models(tmp_path, "a.ipynb", content=True, type="notebook")
    plain = models(tmp_path, "a.ipynb", content=True, type="file", format="text")
    assert whole["content"]["cells"] and "Two windows" in plain["content"]
    bare = models(tmp_path, "a.ipynb", content=False)
    assert whole["hash"] == plain["hash"] == bare["hash"]
    assert models(tmp_path, "a.ipynb", content=False, require_hash=False)["hash"] is None


def changed(change: Callable[[Any], None]) -> Any:
    notebook = book()
    change(notebook)
    return notebook


def hashes(folder: Path, *notebooks: Any) -> tuple[bool, list[str]]:
    """Whether the server gives all of these the same hash, and the hashes."""
    result = []
    for number, notebook in enumerate(notebooks):
        nbformat.write(notebook, folder / f"{number}.ipynb")
        result.append(models(folder, f"{number}.ipynb", content=False)["hash"])
    return len(set(result)) == 1, result


def models(folder: Path, path: str, *, require_hash: bool = True, **how: Any) -> dict[str, Any]:
    """What the server says of a file."""
    from tools.lab_contents import Contents

    manager = Contents(root_dir=str(folder))
    return asyncio.run(manager.get(path, require_hash=require_hash, **how))


# --- Two windows ----------------------------------------------------------------------------------

# Saves as autosave does. Whether a dialog asked, which is then answered with Cancel.
SAVE = """async () => {
  const context = window.panel.context;
  let asked = false;
  const look = setInterval(() => {
    const dialog = document.querySelector('.jp-Dialog');
    if (!dialog) return;
    asked ||= /changed on disk/.test(dialog.textContent);
    dialog.querySelector('button.jp-mod-reject').click();
  }, 20);
  context.model.dirty = true;
  try { await context.save(); } catch (problem) { if (!asked) throw problem; }
  clearInterval(look);
  return asked;
}"""
RUN = "() => window.jupyterapp.commands.execute('notebook:run-all-cells')"
WRITE = """text => { window.panel.content.model.sharedModel.cells[0].setSource(text); }"""
OPENED = """() => {
  const shell = window.jupyterapp?.shell;
  window.panel = shell ? [...shell.widgets('main')].find(w => w.sessionContext) : null;
  return window.panel?.sessionContext?.session?.kernel?.status === 'idle';
}"""


def opened(page: Any, address: str) -> Any:
    page.goto(address, wait_until="domcontentloaded")
    page.wait_for_function(OPENED)
    page.evaluate("() => window.jupyterapp.shell.activateById(window.panel.id)")
    return page


@pytest.mark.browser
@pytest.mark.prove
@pytest.mark.parametrize("course", [True, False], ids=["make lab", "stock"])
def test_two_windows_that_run_cells_are_not_asked_but_two_that_write_are(
    course: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stock server asks once both have run a cell; that of `make lab` where texts differ."""
    monkeypatch.setenv("JUPYTER_CONFIG_PATH", str(ROOT / ".jupyter" if course else tmp_path))
    path = tmp_path / CHAPTER.name
    nbformat.write(book(), path)

    def stored() -> Any:
        return nbformat.read(path, as_version=4)

    with jupyter_lab(tmp_path, False) as address, open_page(tmp_path / "profile") as page:
        first = opened(page, address.format("lab"))
        second = opened(page.context.new_page(), address.format("lab"))
        for window in (first, second):
            window.set_default_timeout(60_000)
            window.bring_to_front()
            window.evaluate(RUN)
        assert first.evaluate(SAVE) is False
        assert first.evaluate(SAVE) is False, "it does not ask about its own save"
        assert second.evaluate(SAVE) is not course
        assert first.evaluate(SAVE) is False
        # What one window writes is not overwritten by the other, which does not know it.
        first.evaluate(WRITE, "# Written in the first")
        assert first.evaluate(SAVE) is False
        assert second.evaluate(SAVE) is True
        assert stored().cells[0].source == "# Written in the first"
        # The same text in both is no conflict.
        second.evaluate("() => window.panel.context.revert()")
        second.evaluate(WRITE, "# Written in the second")
        assert second.evaluate(SAVE) is False
        assert first.evaluate(SAVE) is True
        assert stored().cells[0].source == "# Written in the second"
