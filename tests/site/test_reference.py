"""The reference: every public module has a place, its docstrings lose nothing, its examples run."""

import doctest
import functools
import importlib
import re
from pathlib import Path
from typing import Any

import pytest
from bs4 import BeautifulSoup

from course import CHAPTERS
from course.site import build, modules
from tests.budget import ROOT

# Rooms of the course whose modules people import, each file of which is public.
PUBLIC = [c.topic for c in CHAPTERS] + ["vector_env", "measure", "oracles", "check", "compiled"]
PUBLIC += ["libraries"]


def files() -> list[str]:
    """The import paths of the files in these rooms, but for what is run or private."""
    result = []
    for room in PUBLIC:
        single = ROOT / "course" / f"{room}.py"
        paths = [single] if single.is_file() else sorted((ROOT / "course" / room).rglob("*.py"))
        for path in paths:
            parts = path.relative_to(ROOT).with_suffix("").parts
            if not any(p.startswith("_") and p != "__init__" for p in parts) and "cpp" not in parts:
                result.append(".".join(p for p in parts if p != "__init__"))
    return result


LISTED = [name for group in modules.GROUPS for name in modules.of_group(group)]


def test_every_public_module_is_on_one_page() -> None:
    assert len(LISTED) == len(set(LISTED))
    assert set(files()) <= set(LISTED)


@pytest.mark.slow
@pytest.mark.parametrize("name", LISTED)
def test_the_examples_run(name: str) -> None:
    module = importlib.import_module(name)
    runner = doctest.DocTestRunner()
    for test in doctest.DocTestFinder().find(module, name):
        report: list[str] = []
        runner.run(test, out=report.append)
        assert runner.failures == 0, "".join(report)


# What an adapter returns depends on which libraries are there, so the oracles have no examples.
SHOWN = [group for group in modules.GROUPS if group.page != "code_oracles"]


@pytest.mark.parametrize("group", SHOWN, ids=lambda group: group.page)
def test_a_page_has_an_example(group: modules.Group) -> None:
    finder = doctest.DocTestFinder()
    tests = [
        test
        for name in modules.of_group(group)
        for test in finder.find(importlib.import_module(name), name)
        if test.examples
    ]
    assert tests


# --- Docstrings as reStructuredText ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("Return `a` and `b.c`.", "Return :py:obj:`a` and :py:obj:`b.c`."),
        ("`matrix()`, then `rows`", ":py:obj:`matrix()`, then :py:obj:`rows`"),
        ("`x + 1`s of |v|", r"``x + 1``\ s of \|v\|"),
        ("a * b_ and snake_case", r"a \* b\_ and snake_case"),
        ("    **sizes: of all *three*", r"    **sizes: of all \*three\*"),
        (">>> a * b", ">>> a * b"),
        ("    lower, upper: limits", "    lower,upper: limits"),
    ],
)
def test_a_line_keeps_its_words(line: str, expected: str) -> None:
    assert modules.prepared([line]) == [expected]


def test_an_indented_block_after_a_colon_is_code() -> None:
    lines = ["Use it:", "", "    f(*a_)  # `x`", "", "Then `stop`.", "", "Args:", "    a_: it."]
    expected = ["Use it::", "", "    f(*a_)  # `x`", "", "Then :py:obj:`stop`.", "", "Args:"]
    assert modules.prepared(lines) == [*expected, r"    a\_: it."]


# --- The pages ------------------------------------------------------------------------------------


def soup(page: Path) -> Any:
    return BeautifulSoup(page.read_text("utf-8"), "html.parser")


@pytest.mark.slow
@pytest.mark.parametrize("group", modules.GROUPS, ids=lambda group: group.page)
def test_a_page_documents_its_modules(site: Path, group: modules.Group) -> None:
    """Each module, and each public function and class with a docstring, with its source."""
    page = soup(site / f"{group.page}.html")
    anchors = {tag["id"] for tag in page.select("[id]")}
    for name in modules.of_group(group):
        assert f"module-{name}" in anchors, name
        module = importlib.import_module(name)
        if hasattr(module, "__path__") and name not in modules.ALONE:
            continue
        names = getattr(module, "__all__", vars(module))
        for key, thing in ((key, vars(module)[key]) for key in names):
            mine = getattr(thing, "__module__", None) == name and callable(thing)
            if mine and not key.startswith("_") and thing.__doc__ and thing.__name__ == key:
                assert f"{name}.{key}" in anchors, key
    addresses = [a["href"] for a in page.select("a.reference.external[href*='/blob/main/']")]
    assert addresses
    for address in addresses:
        path, _, line = address.partition("/blob/main/")[2].partition("#L")
        assert int(line) <= len((ROOT / path).read_text("utf-8").splitlines()), address
    text = page.article.get_text()
    assert "_SupportsArray" not in text and "Alias for field" not in text
    assert not re.search(r":py:\w+:|``", text)


@pytest.mark.slow
def test_text_and_reference_lead_to_each_other(site: Path) -> None:
    forth = back = 0
    anchors = functools.cache(lambda page: build.read(page).anchors)
    for chapter in CHAPTERS:
        text = site / f"{Path(chapter.notebook).stem}.html"
        article = text.read_text("utf-8").partition("<article")[2].partition("</article>")[0]
        for page, anchor in re.findall(r'href="(code_\w+\.html)#([^"]*)"', article):
            assert anchor.removeprefix("module-").startswith("course."), anchor
            assert anchor in anchors(site / page), (page, anchor)
            forth += 1
        reference = (site / f"code_{chapter.topic}.html").read_text("utf-8")
        for page, anchor in re.findall(r'href="([^"#]*\.html)#(code-[^"]*)"', reference):
            assert page == text.name and anchor in anchors(text)
            back += 1
    assert forth > 30 and back > 15, (forth, back)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "links"),
    [
        (
            "environments",
            {"course.vector_env.sequential.VectorizedEnv", "module-course.vector_env"},
        ),
        ("modules", {"course.kinematics.chain.Chain"}),
        ("your_method", {"course.measure.work_precision.measure"}),
    ],
)
def test_a_page_of_a_door_leads_to_the_functions_that_it_names(
    site: Path, page: str, links: set[str]
) -> None:
    article = (site / f"{page}.html").read_text("utf-8").partition("<article")[2]
    references = re.findall(r'href="(code_\w+\.html)#([^"]*)"', article.partition("</article>")[0])
    assert {anchor for _, anchor in references} >= links
    for target, anchor in references:
        assert anchor in build.read(site / target).anchors, (target, anchor)
