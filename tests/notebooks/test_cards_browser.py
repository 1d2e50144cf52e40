"""A card in JupyterLab: what is clicked is remembered, and the code that made it is not seen."""

import json
import os
import time
from pathlib import Path

import nbformat
import pytest

from tests.notebooks.test_browser import CHAPTER, jupyter_lab, open_page, run_all_cells

pytestmark = [pytest.mark.browser, pytest.mark.slow]

CELLS = [
    ("from course.cards import predict\n\npredict('energy_of_a_fall')", True),
    ("from drills.notebook import badges\n\nbadges(1)", True),
    ("from course.derivations import more_claims, show\n\nshow('top_condition')", True),
    ("more_claims('planar_state', 'planar_torque')", True),
    ("1 + 1", False),
]


def test_a_card_remembers_its_first_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = []
    for source, hidden in CELLS:
        cell = nbformat.v4.new_code_cell(source)
        if hidden:
            cell.metadata["jupyter"] = {"source_hidden": True}
        cells.append(cell)
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook = nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": kernel})
    nbformat.write(notebook, tmp_path / CHAPTER.name)
    file = tmp_path / "progress.json"
    monkeypatch.setenv("DRILLS_PROGRESS", str(file))
    with jupyter_lab(tmp_path, False) as address, open_page(tmp_path / "profile") as page:
        page.goto(address.format("doc"), wait_until="domcontentloaded")
        page.wait_for_function(
            """() => {
              const shell = window.jupyterapp?.shell;
              window.panel = shell ? [...shell.widgets('main')].find(w => w.sessionContext) : null;
              return window.panel?.sessionContext?.session?.kernel?.status === 'idle';
            }"""
        )
        page.evaluate("() => window.jupyterapp.shell.activateById(window.panel.id)")
        run_all_cells(page)
        card = page.locator("#claim-top_condition").first
        card.wait_for()
        page.locator(".jp-Notebook .widget-html-content").first.wait_for()  # the badges
        assert page.locator(".jp-Cell .cm-content:visible").count() == 1  # of 1 + 1

        def answers():
            return json.loads(file.read_text())["chapters"]["1"]["cards"] if file.exists() else {}

        def answer(place, count: int) -> dict[str, dict[str, object]]:
            place.locator("summary").first.click()
            end = time.monotonic() + 30
            while len(answers()) < count and time.monotonic() < end:
                page.wait_for_timeout(100)
            return answers()

        explanation = card.locator("details.why > p").first
        assert not explanation.is_visible()
        wrong, right = (card.locator("details.answer").nth(k) for k in (1, 2))
        assert answer(wrong, 1) == {"rigid_body.top_condition": {"answer": "False", "right": False}}
        assert explanation.is_visible()
        card.get_by_text("(your first answer)").wait_for()
        answer(right, 1)
        prompt = page.locator("#card-energy_of_a_fall details.answer").first
        stored = answer(prompt, 2)
        assert stored["rigid_body.top_condition"]["right"] is False  # the first answer counts
        assert set(stored) == {"rigid_body.top_condition", "rigid_body.energy_of_a_fall"}
        number = sum(bool(one["right"]) for one in stored.values())
        page.get_by_text(f"Cards: {number} of 2 answered right at the first try.").wait_for()
        assert page.get_by_text("(your first answer)").count() == 2
        fold = page.locator("details.more-claims")
        assert not page.locator("#claim-planar_state").is_visible()
        fold.locator("summary").first.click()
        assert page.locator("#claim-planar_state").is_visible()
        if os.environ.get("COURSE_SCREENSHOTS") == "1":
            page.screenshot(path=str(tmp_path / "cards.png"))
