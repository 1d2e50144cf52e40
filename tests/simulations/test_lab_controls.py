"""The controls of all simulations in JupyterLab: labels stand above sliders, none is cut."""

from pathlib import Path
from typing import Any

import nbformat
import pytest

from tests.notebooks import test_browser as lab

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# One panel brings the style; of the others only the inputs are made, as some models take long.
PANEL = 'from course.simulations import simulation\n\nsimulation("double_cover")'
INPUTS = """import ipywidgets
from course.simulations import declaration
from course.simulations.panel import _input

made = []
for name in declaration.names():
    fields = declaration.model(name).controls.panel()
    side = ipywidgets.VBox([_input(field) for _, field in fields], layout={"width": "230px"})
    side.add_class("course-side")
    made.append(side)
every = ipywidgets.HBox(made, layout={"flex_flow": "row wrap"})
every.add_class("course-simulation")
every"""

CUT = """() => {
  const cut = [];
  for (const side of document.querySelectorAll('.course-side')) {
    const edge = side.getBoundingClientRect().right;
    for (const words of side.querySelectorAll('.widget-label, .widget-label-basic, button')) {
      if (!words.clientWidth) continue;
      if (words.scrollWidth > words.clientWidth + 1) cut.push(words.innerText);
      if (words.getBoundingClientRect().right > edge + 1) cut.push(words.innerText + ' (outside)');
    }
    for (const slider of side.querySelectorAll('.widget-slider')) {
      const words = slider.querySelector('.widget-label').getBoundingClientRect();
      const track = slider.querySelector('.slider-container').getBoundingClientRect();
      if (words.bottom > track.top + 6) cut.push(slider.innerText + ' (beside)');
    }
  }
  return cut;
}"""


@pytest.mark.prove
def test_no_label_is_cut_in_jupyterlab(tmp_path: Path, monkeypatch: Any) -> None:
    cells = [nbformat.v4.new_code_cell(text) for text in (PANEL, INPUTS)]
    made = nbformat.v4.new_notebook(cells=cells)
    made.metadata["kernelspec"] = {"name": "python3", "display_name": "Python 3"}
    nbformat.write(made, tmp_path / lab.CHAPTER.name)
    # There is no film to wait for in this notebook.
    monkeypatch.setattr(lab, "SHOWN", "window.shown = [[0, 'film '], TITLE].slice(0, 1);")
    with lab.jupyter_lab(tmp_path, False) as address, lab.open_page(tmp_path / "profile") as page:
        lab.open_notebook(page, address.format("lab"))
        lab.run_notebook(page)
        page.locator(".course-side .widget-slider").nth(40).wait_for(state="attached")
        for wide in (1440, 1280, 1024):
            page.set_viewport_size({"width": wide, "height": 800})
            page.wait_for_timeout(500)
            assert page.evaluate(CUT) == [], wide
        count = page.locator(".course-side .widget-label").count()
        assert count > 80, "the controls of all simulations"
        page.add_style_tag(content=".course-side .widget-label { white-space: nowrap !important; }")
        assert page.evaluate(CUT) != [], "a label that is cut is found"
