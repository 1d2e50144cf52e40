"""The widget: which picture goes to the browser when, and what comes back."""

import struct
import subprocess
import sys
from typing import Any, cast

import pytest

from course.simulations import pen as draw
from course.simulations.canvas import Canvas, Key, Pointer

PAPER = draw.Paper("Shapes", room=50)
(TIME,) = PAPER.words("time")


class Browser:
    """Stands for the browser: keeps what is sent, answers when asked to."""

    def __init__(self, canvas):
        self.canvas = canvas
        self.frames: list[Any] = []
        self.pictures: list[float] = []  # the number that each picture carries
        canvas.send = self.get

    def get(self, content, buffers):
        assert content["type"] == "frame"
        self.frames.append(content)
        self.pictures.append(struct.unpack(f"<{len(buffers[0]) // 8}d", buffers[0])[-1])

    def message(self, **content):
        self.canvas._handle_custom_msg(content, [])


def numbered(k):
    pen = PAPER.pen()
    draw.reading(pen, TIME, k, 0)
    return draw.picture(PAPER, pen)


def test_nothing_is_sent_before_a_browser_looks_then_the_newest():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    canvas.show(numbered(1))
    assert browser.frames == [] and not canvas.watched
    browser.message(type="ready")
    assert browser.pictures == [1]
    browser.message(type="gone")
    canvas.show(numbered(2))
    assert len(browser.frames) == 1 and not canvas.watched


def test_a_slow_browser_gets_the_newest_frame_and_no_flood():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    browser.message(type="ready")
    for k in range(1, 50):
        canvas.show(numbered(k))
    assert browser.pictures == [0, 1]
    browser.message(type="drawn", id=browser.frames[-1]["id"])
    assert browser.pictures[-1] == 49
    assert canvas.traffic == {"sent": 3, "drawn": 2, "dropped": 47}
    browser.message(type="drawn", id=3)
    assert len(browser.frames) == 3
    browser.message(type="drawn", id=99)  # never sent
    assert canvas.traffic["drawn"] == 3


def test_a_browser_that_never_answers_does_not_stop_the_pictures(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("course.simulations.canvas.time.monotonic", lambda: clock[0])
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    browser.message(type="ready")
    canvas.show(numbered(1))
    canvas.show(numbered(2))
    assert len(browser.frames) == 2
    clock[0] = 1.0
    canvas.show(numbered(3))
    assert browser.pictures[-1] == 3
    assert canvas.watched
    clock[0] = 3.0
    assert not canvas.watched


def test_pointer_and_keys_reach_the_callbacks():
    canvas = Canvas(numbered(0))
    browser = Browser(canvas)
    observed: list[Any] = []
    browser.message(type="down", x=1.0, y=2.0)
    assert not canvas._pointer
    canvas.on_pointer(observed.append)
    canvas.on_key(["r"], observed.append)
    assert canvas._pointer and canvas._keys == ["r"]
    browser.message(type="down", x=1.0, y=2)
    browser.message(type="key", key="r")
    assert observed == [Pointer("down", 1.0, 2.0), Key("r")]


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
    observed: list[Any] = []
    canvas.on_pointer(observed.append)
    canvas.on_key(["r"], observed.append)
    canvas._handle_custom_msg(content, [])
    assert observed == [] and canvas.traffic["sent"] == 0


def test_what_the_browser_is_told_once():
    canvas = Canvas(numbered(3))
    report, first = cast(dict[str, Any], canvas._paper), cast(bytes, canvas._first)
    assert struct.unpack(f"<{len(first) // 8}d", first)[-1] == 3
    assert report["label"] == "Shapes" and report["window"] == list(PAPER.window)
    assert report["words"] == ["", "time"] and report["colours"][draw.RED] == "#c1272d"


def test_what_a_notebook_keeps():
    canvas = Canvas(numbered(3))
    data, _ = canvas._repr_mimebundle_()
    assert data["text/plain"] == repr(canvas) == "Shapes\n  time: 3"
    assert data["image/png"].startswith("iVBORw0KGgo")
    assert data["application/vnd.jupyter.widget-view+json"]["model_id"] == canvas.model_id


def test_import_does_not_load_matplotlib():
    code = "import course.simulations.panel, sys; print('matplotlib' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "False", result.stderr
