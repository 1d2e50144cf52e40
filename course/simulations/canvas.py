"""The one widget that shows the pictures of all simulations in a browser.

The tables of a `Paper` go to the browser once, then a picture is one message: the numbers that the
pen wrote, as they are (little-endian float64). `canvas.js` draws them.
"""

import base64
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anywidget
import traitlets

from course.simulations.declaration import joined
from course.simulations.pen import Picture

# Frames that may be on their way at a time: one drawn by the browser while the next one travels.
_IN_FLIGHT = 2

# A picture that the browser has not confirmed for this long is given up [s].
_PATIENCE = 0.5


@dataclass(frozen=True)
class Pointer:
    """A pointer (mouse, pen or finger) on the picture.

    `kind` is down, move (while it is down) or up; (x, y) is where, in units of the window.
    """

    kind: str
    x: float
    y: float


@dataclass(frozen=True)
class Key:
    """A key pressed while the picture has the focus; `key` as the browser names it."""

    key: str


@dataclass
class _Traffic:
    """What was sent and what the browser has drawn."""

    sent: int = 0
    drawn: int = 0
    dropped: int = 0
    views: int = 0
    sent_at: float = -math.inf
    drawn_at: float = -math.inf
    waiting: bool = field(default=False)  # a newer frame waits for one to be drawn


class Canvas(anywidget.AnyWidget):
    """Shows pictures of one paper in the browser: `show(picture)` as often as one likes.

    Two frames at most are on their way. One that comes while the browser is still busy with those
    waits, and a newer one takes its place. So the newest frame is always shown in the end, and a
    slow browser slows down nobody.
    """

    _esm = f"{joined('canvas', 'live', 'widget')}\nexport default {{ render }};\n"
    _css = (Path(__file__).parent / "panel.css").read_text(encoding="utf-8")
    _paper = traitlets.Dict().tag(sync=True)
    _first = traitlets.Bytes().tag(sync=True)  # to be drawn while the kernel is still busy
    _bundle = traitlets.Dict().tag(sync=True)  # with which the page can run it, or nothing
    _pointer = traitlets.Bool(False).tag(sync=True)
    _upright = traitlets.Bool(True).tag(sync=True)
    _keys: Any = traitlets.List(traitlets.Unicode()).tag(sync=True)

    def __init__(
        self,
        frame: Picture,
        *,
        readouts: Mapping[str, str] | None = None,
        upright: bool = True,
        **options: Any,
    ) -> None:
        """Show a first picture.

        Args:
            frame: the picture.
            readouts: what each number below it means, by its name.
            upright: whether something is dragged up or down, see `Model`.
            **options: of the widget.
        """
        paper = frame.paper.declaration() | {"readouts": dict(readouts or {})}
        super().__init__(_paper=paper, _first=_buffer(frame), _upright=upright, **options)
        self._frame = frame
        self._traffic = _Traffic()
        self._lock = threading.RLock()
        self._pointer_callbacks: list[Callable[[Pointer], None]] = []
        self._key_callbacks: list[Callable[[Key], None]] = []
        self._run_callbacks: list[Callable[[Mapping[str, Any], list[Any]], None]] = []
        self.on_msg(self._receive)

    @property
    def frame(self) -> Picture:
        """The newest frame."""
        return self._frame

    @property
    def traffic(self) -> Mapping[str, int]:
        """How many frames were sent, drawn by the browser, and dropped for a newer one."""
        t = self._traffic
        return {"sent": t.sent, "drawn": t.drawn, "dropped": t.dropped}

    @property
    def watched(self) -> bool:
        """True if a browser shows this canvas and has drawn a frame within the last 2 s."""
        t = self._traffic
        # A browser that confirms nothing for two seconds is hidden or gone: no need to compute for
        # it.
        busy = t.sent > t.drawn and time.monotonic() - t.drawn_at > 2.0
        return t.views > 0 and not busy

    def show(self, frame: Picture) -> None:
        """Make this the picture; it is sent as soon as the browser keeps up with those before."""
        with self._lock:
            self._frame = frame
            traffic = self._traffic
            if traffic.views == 0:
                return
            # Flow control: with two frames unconfirmed the newest waits, unless the browser has
            # been silent for so long that a confirmation must have been lost.
            full = traffic.sent - traffic.drawn >= _IN_FLIGHT
            if full and time.monotonic() - traffic.sent_at < _PATIENCE:
                traffic.dropped += traffic.waiting
                traffic.waiting = True
            else:
                self._transmit()

    def on_pointer(self, callback: Callable[[Pointer], None]) -> None:
        """Call back for every pointer event; from now on touching does not scroll the page."""
        self._pointer_callbacks.append(callback)
        self._pointer = True

    def on_key(self, keys: list[str], callback: Callable[[Key], None]) -> None:
        """Call back when one of these keys is pressed on the canvas (names as in the browser)."""
        self._key_callbacks.append(callback)
        self._keys = sorted({*self._keys, *keys})

    def on_run(self, callback: Callable[[Mapping[str, Any], list[Any]], None]) -> None:
        """Call back with message and buffers when it is to run in the page, or here again."""
        self._run_callbacks.append(callback)

    def _transmit(self) -> None:
        traffic = self._traffic
        traffic.sent += 1
        traffic.sent_at = time.monotonic()
        traffic.waiting = False
        content = {"type": "frame", "id": traffic.sent}
        self.send(content, [_buffer(self._frame)])

    def _receive(self, _widget: Any, content: Any, buffers: Any) -> None:
        """Messages of the browser: data, so looked at before use."""
        kind = content.get("type") if isinstance(content, dict) else None
        traffic = self._traffic
        if kind == "ready":
            with self._lock:
                # A view that has just opened gets the present picture at once.
                traffic.views += 1
                traffic.drawn_at = time.monotonic()
                self._transmit()
        elif kind == "gone":
            with self._lock:
                traffic.views = max(traffic.views - 1, 0)
        elif kind == "drawn":
            number = content.get("id")
            with self._lock:
                # Only confirmations of frames that were sent count, each once: messages may repeat
                # or be wrong.
                if isinstance(number, int) and traffic.drawn < number <= traffic.sent:
                    traffic.drawn = number
                    traffic.drawn_at = time.monotonic()
                    if traffic.waiting and traffic.sent - traffic.drawn < _IN_FLIGHT:
                        self._transmit()
        elif kind in ("down", "move", "up"):
            x, y = content.get("x"), content.get("y")
            numbers = all(isinstance(value, int | float) for value in (x, y))
            # Coordinates come from outside: NaN and infinity would spread through the model's
            # state.
            if numbers and math.isfinite(x) and math.isfinite(y):
                for pointer_callback in self._pointer_callbacks:
                    pointer_callback(Pointer(kind, float(x), float(y)))
        elif kind == "key" and content.get("key") in self._keys:
            for key_callback in self._key_callbacks:
                key_callback(Key(content["key"]))
        elif kind == "runs":
            for run_callback in self._run_callbacks:
                run_callback(content, buffers)

    def __repr__(self) -> str:
        return self._frame.text

    def _repr_mimebundle_(self, **_options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return bundle(self, self._frame, self._frame)


def _buffer(frame: Picture) -> bytes:
    return frame.data.astype("<f8", copy=False).tobytes()


def bundle(widget: Any, frame: Picture, still: Picture) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a notebook's copy of a widget.

    It holds the widget, its last numbers as text, and a still picture.
    """
    from course.simulations.painter import to_png

    data: dict[str, Any] = {
        "text/plain": frame.text,
        "image/png": base64.b64encode(to_png(still)).decode("ascii"),
        "application/vnd.jupyter.widget-view+json": {
            "version_major": 2,
            "version_minor": 0,
            "model_id": widget.model_id,
        },
    }
    return data, {"image/png": {"width": int(frame.paper.width)}}
