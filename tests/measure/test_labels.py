"""Words on charts: where they go, and that every stored chart can be read where it is shown."""

import functools
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.mathtext import MathTextParser
from matplotlib.text import Text

from course import charts
from course.measure.figure import SHOWN, SIX, WIDTH, Panel, Series, draw
from course.measure.labels import drawn_points, free_place, spread
from tests.budget import ROOT, examples, topic_of

charts.load()
DRAWN = sorted(path.stem for path in charts.FOLDER.glob("*.json"))
# The same powers of ten stand on all axes: each is set once, not once a figure.
_formula = functools.cache(
    functools.partial(vars(MathTextParser)["_parse_cached"].__wrapped__, MathTextParser("agg"))
)


@pytest.fixture(autouse=True)
def _formulas_are_set_once(monkeypatch):
    monkeypatch.setattr(MathTextParser, "_parse_cached", lambda self, *what: _formula(*what))


def _topic(name: str) -> str:
    """What a chart counts for: the chapter in whose folder its experiment is."""
    return topic_of(charts.CHARTS[name][0].__module__.replace(".", "/") + ".py")


def _box(text: Text):
    return Text.get_window_extent(text)


def _drawn(panels, **layout):
    figure = draw(panels, figure=Figure(layout="constrained"), **layout)
    figure.draw_without_rendering()
    return figure


def _words(figure):
    """All words, as (artist, box, whether it names a tick)."""
    ticks = set()
    for ax in figure.axes:
        ticks |= {*ax.get_xticklabels(which="both"), *ax.get_yticklabels(which="both")}
    words = [w for w in figure.findobj(Text) if w.get_visible() and w.get_text().strip()]
    return [(text, _box(text), text in ticks) for text in words]


def covered(figure, words):
    """Texts that lie on a point of a curve, as (text, how many points)."""
    result = []
    for ax in figure.axes:
        points = drawn_points(ax)
        for text, box, _ in words:
            inside = np.all((points > box.min) & (points < box.max), axis=1)
            result += [(text.get_text(), int(inside.sum()))] if inside.any() else []
    return result


def meeting(words):
    """Pairs of words that lie on each other."""
    result = []
    placed = [(text.get_text(), box) for text, box, tick in words if not tick]
    for k, (name, box) in enumerate(placed):
        for other, place in placed[:k]:
            width = min(box.x1, place.x1) - max(box.x0, place.x0)
            height = min(box.y1, place.y1) - max(box.y0, place.y0)
            result += [(name, other)] if width > 1.0 and height > 1.0 else []
    return result


def readable(figure) -> bool:
    """Whether no word lies on a curve or on another word."""
    words = _words(figure)
    return covered(figure, words) == [] == meeting(words)


# --- places -----------------------------------------------------------------------------------


@examples(60)
@given(st.lists(st.tuples(st.floats(-20, 120), st.integers(1, 12)), min_size=1, max_size=8))
def test_names_move_apart_as_little_as_they_can(boxes) -> None:
    expected, sizes = np.array(boxes).T
    result = spread(expected, sizes, 0.0, 100.0)
    order = np.lexsort((np.arange(expected.size), expected))
    low, high = (result + side * 0.5 * sizes for side in (-1, 1))
    assert np.all(low[order][1:] >= high[order][:-1] - 1e-9)
    assert low.min() >= -1e-9 and high.max() <= 100.0 + 1e-9
    # Optimal: of names that touch none would rather part from those above it, or below it, and all
    # together would rather be elsewhere only beyond the end that stops them.
    for block in np.split(order, np.flatnonzero(low[order][1:] - high[order][:-1] > 1e-9) + 1):
        moves = result[block] - expected[block]
        if low[block[0]] > 1e-9:
            assert np.cumsum(moves).max() <= 1e-6
        if high[block[-1]] < 100.0 - 1e-9:
            assert np.cumsum(moves[::-1]).min() >= -1e-6


def test_names_that_do_not_meet_stay() -> None:
    assert spread([10.0, 50.0, 30.0], [5.0, 5.0, 5.0], 0.0, 100.0).tolist() == [10.0, 50.0, 30.0]
    assert spread([20.0, 20.0], [10.0, 10.0], 0.0, 100.0).tolist() == [15.0, 25.0]


def test_a_note_takes_the_nearest_place_that_is_free() -> None:
    room, nothing = (0.0, 0.0, 200.0, 100.0), np.empty((0, 4))
    wall = np.column_stack((np.full(100, 100.0), np.arange(100.0)))
    x, y = free_place((30.0, 10.0), (90.0, 50.0), wall, nothing, room)
    assert abs(x - 100.0) >= 15.0 and np.hypot(x - 90.0, y - 50.0) < 40.0
    taken = np.array([[60.0, 0.0, 95.0, 100.0]])
    x, _ = free_place((30.0, 10.0), (90.0, 50.0), wall, taken, room)
    assert x <= 45.0 or x >= 115.0


def test_equal_ends_have_names_side_by_side_and_a_line_to_the_one_that_went() -> None:
    x = np.linspace(0.0, 1.0, 5)
    series = [Series(f"method {k}", x, x * (1.0 + 1e-6 * k)) for k in range(6)]
    figure = _drawn([Panel("t", "x", "y", series, lines=[("y", 1.0, "tolerance")])])
    assert readable(figure)
    (ax,) = figure.axes
    assert all(_box(name).x0 > ax.get_window_extent().x1 for name in ax.texts)
    moved = [name.arrow_patch.get_visible() for name in ax.texts]
    assert moved[1:] == [True] * 6  # a curve ends inside the axes, the tolerance at their edge


def test_names_above_move_apart_and_the_title_stands_over_them() -> None:
    lines = [("x", 1.0, "first limit"), ("x", 1.1, "second,\nof two lines")]
    figure = _drawn(
        [Panel("A title", "x", "y", [Series("s", [0.0, 2.0], [0.0, 1.0])], lines=lines)]
    )
    assert readable(figure)


# --- every chart ------------------------------------------------------------------------------


# Drawing all of them takes long: `make test` draws those that the README shows.
SHOWN_FIRST = set(re.findall(r"^!\[(\w+)\]", (ROOT / "README.md").read_text("utf-8"), re.M))


def _marks(name: str) -> list[pytest.MarkDecorator]:
    tier = pytest.mark.slow if name in SHOWN_FIRST else pytest.mark.prove
    return [pytest.mark.topic(_topic(name)), tier]


def test_the_charts_of_the_readme_are_drawn() -> None:
    assert SHOWN_FIRST and set(DRAWN) >= SHOWN_FIRST


@pytest.mark.parametrize("name", [pytest.param(n, marks=_marks(n)) for n in DRAWN])
def test_a_chart_can_be_read_where_it_is_shown(name: str) -> None:
    """From its data: letters, names, curves, and that no word lies on a curve or another word."""
    panels = charts.stored(name)
    figure = _drawn(panels, **charts.CHARTS[name][1])
    assert figure.get_figwidth() == WIDTH
    words = _words(figure)
    letters = {text.get_text(): text.get_fontsize() / 72.0 * SHOWN / WIDTH for text, *_ in words}
    # Capitals are 0.73 of a font's size: those have 8 px.
    assert min(letters.values()) * 0.73 >= 8.0, min(letters, key=lambda text: letters[text])
    for panel in panels:
        curves = [series for series in panel.shown() if series.counts]
        assert len(curves) <= SIX
        first = [series for series in panel.series if series.counts and not series.extra]
        assert len(first) <= SIX, "say which six matter: Series(..., extra=True) for the others"
    assert covered(figure, words) == [] and meeting(words) == []
    inside = figure.bbox.padded(1.0)
    corners = [(w.get_text(), at) for w, box, tick in words if not tick for at in box.get_points()]
    assert [text for text, at in corners if not inside.contains(*at)] == []
