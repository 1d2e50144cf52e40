"""The films in the notebooks show the simulations as they are now."""

import base64
import importlib
import re
from pathlib import Path

import nbformat
import pytest

from course import CHAPTERS
from course.simulations.painter import film
from tests.simulations.films import is_out_of_date
from tools import notebooks

ROOT = Path(notebooks.__file__).parents[1]


@pytest.mark.parametrize(
    "chapter",
    [pytest.param(c, id=c.topic, marks=pytest.mark.topic(c.topic)) for c in CHAPTERS if c.ready],
)
def test_the_films_of_a_notebook_are_up_to_date(chapter) -> None:
    cells = nbformat.read(ROOT / chapter.notebook, as_version=4).cells
    stored = {n: a for cell in cells for n, a in cell.get("attachments", {}).items()}
    shown = {name for cell in cells for name in re.findall(r"\(attachment:(.+?)\)", cell.source)}
    assert stored.keys() == shown  # chapter 12 shows none
    for name, attachment in stored.items():
        model = importlib.import_module(f"course.simulations.{name.removesuffix('.png')}").MODEL
        assert not is_out_of_date(base64.b64decode(attachment["image/png"]), film(model)), (
            f"the film {name} is out of date: .venv/bin/python -m tools.notebooks "
            f"{Path(chapter.notebook).stem}"
        )
