"""A second build of the site makes anew what has changed, and leaves every other file alone."""

import os
import sys
from pathlib import Path

import pytest

from course.site import build

pytestmark = pytest.mark.slow

PAGES = {
    "index.md": "# Home\n\n```{toctree}\na\nb\ncode_one\ncode_two\n```\n",
    "a.md": "# A\n\nThe first text, $x^2$.\n",
    "b.md": "# B\n\nSee [A](a.md).\n",
    "code_one.rst": "One\n===\n\n.. automodule:: site_again_one\n   :members:\n",
    "code_two.rst": "Two\n===\n\n.. automodule:: site_again_two\n   :members:\n",
}
MODULES = ("site_again_one", "site_again_two")


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of two modules that can be imported."""
    folder = tmp_path / "modules"
    folder.mkdir()
    for name in MODULES:
        (folder / f"{name}.py").write_text(f'"""About {name}."""\n')
    monkeypatch.syspath_prepend(str(folder))
    return folder


def built(place: Path, pages: dict[str, str], key: str = "") -> dict[str, tuple[int, int]]:
    """Build a small site; for each page, what changes when its file is written again."""
    for name in MODULES:
        sys.modules.pop(name, None)  # another build is another process
    fresh, target = place / "work" / "fresh", place / "site"
    (fresh / "_static").mkdir(parents=True)
    for name in ("course.css", "page.js"):
        (fresh / "_static" / name).touch()
    for name, text in pages.items():
        (fresh / name).write_text(text)
    build.render(fresh, target, place / "work", {}, key)
    states = {path.name: path.stat() for path in target.glob("*.html")}
    return {name: (state.st_ino, state.st_mtime_ns) for name, state in states.items()}


def changed(before: dict[str, tuple[int, int]], after: dict[str, tuple[int, int]]) -> set[str]:
    return {name for name in before.keys() | after if before.get(name) != after.get(name)}


def test_only_what_has_changed_is_written_again(tmp_path: Path, modules: Path) -> None:
    first = built(tmp_path, PAGES)
    assert set(first) == {"search.html", *(f"{Path(name).stem}.html" for name in PAGES)}
    # Nothing changed.
    assert changed(first, built(tmp_path, PAGES)) == set()
    # A text.
    pages = PAGES | {"a.md": "# A\n\nAnother text, $x^3$.\n"}
    second = built(tmp_path, pages)
    assert changed(first, second) == {"a.html"}
    assert "Another text" in (tmp_path / "site" / "a.html").read_text("utf-8")
    assert "anoth" in (tmp_path / "site" / "searchindex.js").read_text("utf-8")
    # A module.
    path = modules / f"{MODULES[1]}.py"
    path.write_text('"""About something longer."""\n')
    os.utime(path, ns=(path.stat().st_mtime_ns + 10**10,) * 2)
    third = built(tmp_path, pages)
    assert changed(second, third) == {"code_two.html"}
    assert "something longer" in (tmp_path / "site" / "code_two.html").read_text("utf-8")
    # A page that is gone, and the list that named it.
    del pages["b.md"]
    pages["index.md"] = pages["index.md"].replace("b\n", "")
    fourth = built(tmp_path, pages, key="another list of pages")
    assert "b.html" not in fourth and not (tmp_path / "site" / "b.html").exists()


def test_what_all_pages_show_makes_all_of_them_anew(tmp_path: Path, modules: Path) -> None:
    built(tmp_path, PAGES)
    source = tmp_path / "work" / "html" / "b.html"
    before = source.stat().st_mtime_ns
    built(tmp_path, PAGES, key="another theme")
    assert source.stat().st_mtime_ns != before


def test_a_site_with_a_fault_leaves_the_one_that_is_there(tmp_path: Path, modules: Path) -> None:
    first = built(tmp_path, PAGES)
    with pytest.raises(build.Unbuildable, match="nowhere"):
        built(tmp_path, PAGES | {"a.md": '# A\n\n<a href="nowhere.html">x</a>\n'})
    states = {path.name: path.stat() for path in (tmp_path / "site").glob("*.html")}
    assert first == {name: (state.st_ino, state.st_mtime_ns) for name, state in states.items()}
    # What was wrong is made anew, although its source is not changed again.
    built(tmp_path, PAGES)
    assert "first text" in (tmp_path / "site" / "a.html").read_text("utf-8")
