"""Stored pictures of simulations were made with the settings that are the defaults now."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import nbformat
import pytest

from course import CHAPTERS
from course.simulations.contact import soft_contact
from course.site.notebooks import called
from tools import notebooks, settings

PAGES = [
    *(
        pytest.param(Path(c.notebook).stem, id=c.topic, marks=pytest.mark.topic(c.topic))
        for c in CHAPTERS
        if c.ready
    ),
    "index",
]


def cells(page: str) -> list[Any]:
    return list(nbformat.read(notebooks.FOLDER / f"{page}.ipynb", as_version=4).cells)


@pytest.mark.parametrize("page", PAGES)
def test_the_pictures_of_a_page_were_made_with_the_settings_of_today(page: str) -> None:
    """A changed default fails here, with the control, both values, and the command to run."""
    before, now = settings.stored()[page], settings.of_page(cells(page))
    fault = settings.out_of_date(page, before, now)
    assert not fault, fault


def test_the_film_of_the_readme_was_made_with_the_settings_of_today() -> None:
    before, now = settings.stored()[settings.README], settings.of_readme()
    fault = settings.out_of_date(settings.README, before, now)
    assert not fault, fault


@pytest.mark.parametrize("page", PAGES)
def test_no_picture_of_a_page_is_without_settings(page: str) -> None:
    """Counted by what the page stores: outputs of simulations, and films."""
    before, stills, films = settings.stored()[page], set(), 0
    for cell in cells(page):
        films += len(cell.get("attachments", {}))
        if cell.cell_type == "code" and called(cell.source)[0] == "simulation":
            assert any("text/plain" in output.get("data", {}) for output in cell.outputs)
            stills.add(cell.source.rpartition("simulation(")[2])
    assert len(before) == len(stills) + films


def test_every_page_and_nothing_else_is_stored() -> None:
    pages = {source.stem for source in notebooks.sources()}
    assert set(settings.stored()) == pages | {settings.README}


def test_a_changed_default_is_named_with_the_command_that_shows_the_new_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a simulation far down its page, which no film shows."""
    page = "02_contact"
    before = settings.of_page(cells(page))
    fields = soft_contact.MODEL.controls.fields
    name, field = next((n, f) for n, f in fields.items() if isinstance(f.default, float))
    other = field.low if field.default != field.low else field.high
    monkeypatch.setitem(fields, name, replace(field, default=other))
    fault = settings.out_of_date(page, before, settings.of_page(cells(page)))
    assert fault == (
        f"{page}: the picture of contact.soft_contact was made with {name} {field.default}, "
        f"now {other}.\nRun `.venv/bin/python -m tools.notebooks {page}`."
    )


@pytest.mark.parametrize(
    ("before", "now", "fault"),
    [
        ({"a": {"x": 0.1}}, {"a": {"x": 0.1 * (1.0 + 1e-12)}}, ""),
        ({"a": {"x": 1}}, {"a": {"x": 2}}, "README: the picture of a was made with x 1, now 2."),
        ({"a": {}}, {"a": {"x": 2}}, "README: the picture of a was made with x absent, now 2."),
        ({}, {"a": {}}, "README: the picture of a is new."),
        ({"a": {}}, {}, "README: the picture of a is no longer shown."),
    ],
)
def test_what_differs_is_said(before: Any, now: Any, fault: str) -> None:
    command = "\nRun `.venv/bin/python -m tools.gallery`." if fault else ""
    assert settings.out_of_date(settings.README, before, now) == fault + command


def test_calls_are_read_with_all_their_arguments() -> None:
    code = nbformat.v4.new_code_cell
    page = [
        code("%matplotlib inline"),
        code('from course.simulations import simulation\n\nsimulation("touch", still=0.15)'),
        code('simulation("touch", "Slip")'),
        nbformat.v4.new_markdown_cell("![A title](attachment:contact.touch.png)"),
    ]
    assert {name: values["timestep"] for name, values in settings.of_page(page).items()}.keys() == {
        "contact.touch, still 0.15",
        "contact.touch, Slip",
        "contact.touch film",
    }
