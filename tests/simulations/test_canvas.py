"""The display list: what goes to the browser, what matplotlib draws, what comes back."""

import struct
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.simulations.canvas import (
    Arrow,
    Axes,
    Canvas,
    Disc,
    Frame,
    Key,
    Line,
    Pointer,
    Polygon,
    Text,
    encode,
    primitives,
    ticks,
    to_png,
)

WINDOW = (-1.0, 3.0, 0.0, 2.0)
SHAPES = (
    Line([[0, 1, np.nan, 2], [0, 1, 0, 1]], "#ff0000", 3.0, (4.0, 2.0)),
    Polygon([[0, 1, 1], [0, 0, 1]], "#00ff00"),
    Disc((0.5, 1.5), 0.25, "#0000ff"),
    Arrow((0.0, 0.0), (1.0, 1.0)),
    Text((2.0, 1.0), "E = $ m v² < 1", size=14.0),
)


def points_of(frame):
    """The coordinates of the message, item by item, read without NumPy."""
    header, data = encode(frame)
    values = struct.unpack(f"<{len(data) // 4}f", data)
    result, start = [], 0
    for _, count, *_ in header["items"]:
        part = values[2 * start : 2 * (start + count)]
        result.append(list(zip(part[::2], part[1::2], strict=True)))
        start += count
    assert 2 * start == len(values)
    return header, result


def test_message_has_every_item_with_its_points():
    header, points = points_of(Frame(WINDOW, SHAPES, label="shapes", numbers={"time": "1 s"}))
    assert [item[0] for item in header["items"]] == ["line", "polygon", "disc", "arrow", "text"]
    assert [len(part) for part in points] == [4, 3, 1, 2, 1]
    assert points[1] == [(0, 0), (1, 0), (1, 1)]
    assert points[3] == [(0, 0), (1, 1)]
    assert np.isnan(points[0][2]).any()  # the gap
    assert header["window"] == list(WINDOW)
    assert header["numbers"] == [("time", "1 s")]
    assert header["items"][0][2:] == ["#ff0000", 3.0, [4.0, 2.0], 1.0]


@given(st.lists(st.tuples(*2 * [st.floats(allow_nan=False)]), min_size=1, max_size=20))
def test_any_line_reaches_the_browser_as_finite_points_or_gaps(points):
    _, (sent,) = points_of(Frame(WINDOW, (Line(np.array(points).T),)))
    for (x, y), (a, b) in zip(points, sent, strict=True):
        if np.isfinite([x, y]).all():
            assert a == np.float32(np.clip(x, -1e7, 1e7))
            assert b == np.float32(np.clip(y, -1e7, 1e7))
        else:
            assert np.isnan(a) or np.isnan(b)


def test_items_keep_a_copy_of_their_points():
    points = np.zeros((2, 3))
    line = Line(points)
    points[:] = 7.0
    assert (line.points == 0.0).all()


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Polygon([[0, np.nan], [0, 1]]), "points"),
        (lambda: Line([0, 1, 2]), "points"),
        (lambda: Disc((0, 0), -1.0), "radius"),
        (lambda: Disc((0, np.inf), 1.0), "centre"),
        (lambda: Arrow((0, 0), (0, 0, 1)), "tip"),
        (lambda: Text((0, 0), "x", align="middle"), "align"),
        (lambda: Text((0, 0), "x", baseline="low"), "baseline"),
        (lambda: Axes((0, 0, 0, 1)), "rectangle"),
        (lambda: Axes((0, 1, 0, 1), y_range=(2, 1)), "y_range"),
        (lambda: Frame((0, 1, 1, 1), ()), "window"),
        (lambda: Frame((0, 1, 0, np.inf), ()), "window"),
        (lambda: Frame(WINDOW, (), width=0.0), "width"),
    ],
)
def test_bad_items_are_named(make, named):
    with pytest.raises(ValueError, match=named):
        make()


@given(
    st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.integers(1, 10)
)  # fmt: skip
def test_ticks_are_round_inside_and_not_too_many(low, span, count):
    high = low + span
    if high <= low:
        return
    values = ticks(low, high, count)
    assert len(values) <= count + 1
    slack = 1e-6 * span + 1e-9 * abs(low)
    assert all(low - slack <= value <= high + slack for value in values)
    if len(values) > 1:
        step = np.diff(values).mean()
        mantissa = step / 10.0 ** np.floor(np.log10(step) + 1e-9)
        assert np.isclose(mantissa, [1, 2, 5, 10]).any()


def test_ticks_of_a_known_axis():
    assert np.allclose(ticks(0.0, 3.07, 5), [0, 1, 2, 3])
    assert np.allclose(ticks(-0.2, 1.0, 6), [-0.2, 0, 0.2, 0.4, 0.6, 0.8, 1.0])
    assert ticks(0.0, 1.0, 0) == []


@given(st.floats(-50, 50), st.floats(-50, 50))
def test_axes_place_and_its_inverse(x, y):
    axes = Axes((1.0, 3.0, -1.0, 0.0), (-10.0, 10.0), (0.0, 5.0))
    there = axes.place((x, y), clip=False)
    assert np.allclose(axes.values(there), (x, y))
    clipped = axes.place((x, y))
    assert 1.0 <= clipped[0] <= 3.0 and -1.0 <= clipped[1] <= 0.0
    assert np.allclose(axes.place((-10.0, 5.0)), (1.0, 0.0))


def test_axes_become_lines_and_words():
    axes = Axes((0.0, 2.0, 0.0, 1.0), (0.0, 10.0), x_label="time [s]", title="t", x_ticks=2)
    items = primitives(Frame(WINDOW, (axes,)))
    words = [item.text for item in items if isinstance(item, Text)]
    assert {"0", "5", "10", "time [s]", "t"} <= set(words)
    five = next(item for item in items if isinstance(item, Text) and item.text == "5")
    assert np.allclose(five.position[:, 0], (1.0, 0.0))


def image(frame, sharpness=1.0):
    from io import BytesIO

    import matplotlib.image

    return matplotlib.image.imread(BytesIO(to_png(frame, sharpness)), format="png")


def test_png_has_the_colours_where_the_world_has_them():
    frame = Frame(
        WINDOW,
        (Polygon([[0, 1, 1, 0], [0, 0, 1, 1]], "#ff0000"), Disc((2.0, 1.0), 0.5, "#0000ff")),
        width=400.0,
    )
    picture = image(frame)
    assert picture.shape[:2] == (200, 400)

    def at(x, y):  # 100 pixels per unit, row 0 on top
        return picture[int(200 - 100 * y), int(100 * (x + 1))][:3].tolist()

    assert at(0.5, 0.5) == [1, 0, 0]
    assert at(2.0, 1.0) == at(2.4, 1.0) == at(2.0, 1.4) == [0, 0, 1]
    assert at(2.6, 1.0) == at(0.5, 1.5) == at(-0.5, 0.5) == [1, 1, 1]


def test_png_is_the_same_each_time_and_draws_every_kind():
    frame = Frame(WINDOW, (*SHAPES, Axes((0.0, 2.0, 0.5, 1.5), title="all")), width=300.0)
    assert to_png(frame) == to_png(frame)
    empty = image(Frame(WINDOW, (), width=300.0))
    assert (empty == 1.0).all()
    for item in SHAPES:
        assert (image(Frame(WINDOW, (item,), width=300.0)) != 1.0).any(), item


def test_png_has_the_numbers_below_the_picture():
    frame = Frame(WINDOW, (), width=300.0, numbers={"time": "1 s", "energy": "2 J", "h": "3 m"})
    picture = image(frame)
    assert (picture[:150] == 1.0).all()
    assert picture.shape[0] > 150 + 60  # two rows of them
    assert (picture[150:194] != 1.0).any() and (picture[194:] != 1.0).any()


class Browser:
    """Stands for the browser: keeps what is sent, answers when asked to."""

    def __init__(self, canvas):
        self.canvas = canvas
        self.frames: list[Any] = []
        canvas.send = lambda content, buffers=None: self.frames.append(content)

    def says(self, **content):
        self.canvas._handle_custom_msg(content, [])


def numbered(k):
    return Frame(WINDOW, (), label=f"frame {k}")


def test_nothing_is_sent_before_a_browser_looks_then_the_newest():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    canvas.show(numbered(1))
    assert browser.frames == [] and not canvas.watched
    browser.says(type="ready")
    assert [f["label"] for f in browser.frames] == ["frame 1"]
    browser.says(type="gone")
    canvas.show(numbered(2))
    assert len(browser.frames) == 1 and not canvas.watched


def test_a_slow_browser_gets_the_newest_frame_and_no_flood():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    browser.says(type="ready")
    for k in range(1, 50):
        canvas.show(numbered(k))
    labels = [f["label"] for f in browser.frames]
    assert labels == ["frame 0", "frame 1"]
    browser.says(type="drawn", id=browser.frames[-1]["id"])
    assert browser.frames[-1]["label"] == "frame 49"
    assert canvas.traffic == {"sent": 3, "drawn": 2, "dropped": 47}
    browser.says(type="drawn", id=3)
    assert len(browser.frames) == 3
    browser.says(type="drawn", id=99)  # never sent
    assert canvas.traffic["drawn"] == 3


def test_a_browser_that_never_answers_does_not_stop_the_pictures(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("course.simulations.canvas.time.monotonic", lambda: clock[0])
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    browser.says(type="ready")
    canvas.show(numbered(1))
    canvas.show(numbered(2))
    assert len(browser.frames) == 2
    clock[0] = 1.0
    canvas.show(numbered(3))
    assert browser.frames[-1]["label"] == "frame 3"
    assert canvas.watched
    clock[0] = 3.0
    assert not canvas.watched


def test_pointer_and_keys_reach_the_callbacks():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    seen: list[Any] = []
    browser.says(type="down", x=1.0, y=2.0)
    assert not canvas._pointer
    canvas.on_pointer(seen.append)
    canvas.on_key(["r"], seen.append)
    assert canvas._pointer and canvas._keys == ["r"]
    browser.says(type="down", x=1.0, y=2)
    browser.says(type="key", key="r")
    assert seen == [Pointer("down", 1.0, 2.0), Key("r")]


@pytest.mark.parametrize(
    "content",
    [
        {"type": "move", "x": "1", "y": 2.0},
        {"type": "move", "x": float("nan"), "y": 2.0},
        {"type": "move"},
        {"type": "key", "key": "q"},
        {"type": "key", "key": ["r"]},
        {"type": "drawn", "id": "1"},
        {"type": "other"},
        {},
        [],
        None,
    ],
)
def test_messages_that_make_no_sense_are_ignored(content):
    canvas = Canvas(numbered(0))
    seen: list[Any] = []
    canvas.on_pointer(seen.append)
    canvas.on_key(["r"], seen.append)
    canvas._handle_custom_msg(content, [])
    assert seen == [] and canvas.traffic["sent"] == 0


def test_what_a_notebook_keeps():
    canvas = Canvas(Frame(WINDOW, SHAPES, label="Shapes", numbers={"time": "1.0 s"}))
    data, _ = canvas._repr_mimebundle_()
    assert data["text/plain"] == repr(canvas) == "Shapes\n  time: 1.0 s"
    assert data["image/png"].startswith("iVBORw0KGgo")
    assert data["application/vnd.jupyter.widget-view+json"]["model_id"] == canvas.model_id


def test_import_does_not_load_matplotlib():
    code = "import course.simulations.canvas, sys; print('matplotlib' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "False", result.stderr
