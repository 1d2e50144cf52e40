"""The narrow charts of a phone: what they show, and when they are drawn anew."""

import io
import itertools
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from course import charts as stored
from course.measure import figure
from course.site import charts

SOME = ("pid_windup", "work_precision_tumble", "events_order")


@pytest.mark.prove
@pytest.mark.parametrize("name", SOME)
def test_panels_stand_below_each_other_and_no_word_leaves_the_picture(name: str) -> None:
    panels = [panel for panel in stored.stored(name) if panel.drawn]
    made = figure.draw(panels, narrow=True, figure=Figure(layout="constrained"))
    assert made.get_figwidth() == figure.WIDTH / 2
    made.draw_without_rendering()
    places = [ax.get_window_extent() for ax in made.axes[: len(panels)]]
    assert len(places) == len(panels)
    for above, below in itertools.pairwise(places):
        assert below.y1 < above.y0, "one below the other"
    page = made.bbox
    for ax in made.axes:
        for words in (ax.title, ax.xaxis.label, ax.yaxis.label, *ax.texts):
            if words.get_text() and words.get_visible():
                box = words.get_window_extent()
                assert box.x0 >= page.x0 - 2 and box.x1 <= page.x1 + 2, words.get_text()
                # On a phone 358 px wide: letters of 8 points have 9.5 px.
                assert float(words.get_fontsize()) >= 8.0


def test_an_svg_is_the_same_each_time_and_has_its_size() -> None:
    text = charts.svg(SOME[0])
    assert text == charts.svg(SOME[0])
    root = ElementTree.fromstring(text)
    assert root.get("width") == "302.4pt"
    assert "http" not in text.replace("http://www.w3.org", "").partition("<defs>")[2]
    # Letters are paths: no font is needed.
    assert not list(root.iter("{http://www.w3.org/2000/svg}text"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [SOME[0], *(pytest.param(name, marks=pytest.mark.prove) for name in SOME[1:])]
)
def test_a_picture_is_the_one_that_matplotlib_saves(name: str) -> None:
    """The shorter way of drawing leaves nothing out and moves nothing, not by a digit."""
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": name}):
        made = figure.draw(stored.stored(name), narrow=True, figure=Figure(layout="constrained"))
        made.set_layout_engine("none")
        saved = io.StringIO()
        made.savefig(saved, format="svg", metadata={"Date": None, "Creator": None})
    assert charts.svg(name) == saved.getvalue()


def test_a_chart_is_drawn_once_until_its_data_change(monkeypatch: Any, tmp_path: Path) -> None:
    drawn: list[str] = []
    monkeypatch.setattr(charts, "CACHE", tmp_path / "cache")

    def svg(name: str) -> str:
        drawn.append(name)
        return f"<svg>{len(drawn)}</svg>"

    monkeypatch.setattr(charts, "svg", svg)
    monkeypatch.setattr(stored, "FOLDER", tmp_path)
    data = tmp_path / "some.json"
    data.write_text("{}")
    assert charts.narrow("some") == charts.narrow("some") == "<svg>1</svg>"
    data.write_text('{"panels": []}')
    assert charts.narrow("some") == "<svg>2</svg>"
    assert len(list((tmp_path / "cache").iterdir())) == 1, "what is old goes away"
    monkeypatch.setattr(charts, "_drawn_with", lambda: b"other code")
    assert charts.narrow("some") == "<svg>3</svg>"
