"""The one picture of all simulations: a display list, drawn by the browser or by matplotlib.

A model returns a `Frame`: a window of the world and the things in it, in world units. The browser
draws it on a canvas (`canvas.js`), matplotlib draws the same list as a PNG, so a saved notebook
shows the last picture where no kernel runs. Lengths on paper (line widths, letters, arrow heads)
are in pixels of a picture that is `Frame.width` pixels wide, and scale with it.

Coordinates are arrays with the components along axis 0: points are (2, N).
"""

import io
import math
import pathlib
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import anywidget
import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Colours that a colour-blind reader can tell apart (Wong, Nature Methods 8, 2011), and greys.
BLUE, ORANGE, GREEN, RED, PURPLE = "#0072b2", "#d55e00", "#00815a", "#c1272d", "#8a4f9e"
INK, GREY, FAINT = "#222222", "#767676", "#dddddd"

# What an item is given may be lists or tuples; what it keeps is an array of its own.
Coordinates = Any

# Farther away than this a point is drawn here: canvas coordinates are single precision.
_FAR = 1e7

# Room for one number below the picture, wide and high [pixels].
_CELL = (122.0, 44.0)

# Frames that may be on their way at a time: one drawn by the browser while the next one travels.
_IN_FLIGHT = 2

# A picture that the browser has not confirmed for this long is given up [s].
_PATIENCE = 0.5


def _points(name: str, value: Any, gaps: bool = False) -> Array:
    points = np.array(value, dtype=float)
    if points.ndim != 2 or points.shape[0] != 2:
        raise ValueError(f"{name} has the shape {points.shape}, allowed is (2, N)")
    if not gaps and not np.isfinite(points).all():
        raise ValueError(f"{name} is {value}, allowed are finite numbers")
    points.setflags(write=False)
    return points


def _point(name: str, value: Any) -> Array:
    point = np.array(value, dtype=float)
    if point.shape != (2,):
        raise ValueError(f"{name} has the shape {point.shape}, allowed is (2,)")
    return _points(name, point.reshape(2, 1))


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points (2, N); a point that is not finite leaves a gap.

    `width` in pixels, `dash` pixels on and off in turn.
    """

    points: Coordinates
    colour: str = INK
    width: float = 1.5
    dash: tuple[float, ...] = ()
    alpha: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _points("points", self.points, gaps=True))


@dataclass(frozen=True, eq=False)
class Polygon:
    """A closed polygon with corners (2, N), filled and outlined; no edge if `edge` is empty."""

    points: Coordinates
    fill: str = FAINT
    edge: str = ""
    width: float = 1.5
    alpha: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _points("points", self.points))


@dataclass(frozen=True, eq=False)
class Disc:
    """Discs of one radius (world units) at the centres (2,) or (2, N)."""

    centre: Coordinates
    radius: float
    fill: str = BLUE
    edge: str = ""
    width: float = 1.5
    alpha: float = 1.0

    def __post_init__(self) -> None:
        centre = np.array(self.centre, dtype=float)
        if centre.ndim == 1:
            centre = centre.reshape(-1, 1)
        object.__setattr__(self, "centre", _points("centre", centre))
        if not (math.isfinite(self.radius) and self.radius >= 0.0):
            raise ValueError(f"radius is {self.radius}, allowed is a number that is not negative")


@dataclass(frozen=True, eq=False)
class Arrow:
    """An arrow from tail (2,) to tip (2,) with a head of `head` pixels."""

    tail: Coordinates
    tip: Coordinates
    colour: str = INK
    width: float = 2.0
    head: float = 9.0
    alpha: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "tail", _point("tail", self.tail))
        object.__setattr__(self, "tip", _point("tip", self.tip))


@dataclass(frozen=True, eq=False)
class Text:
    """Words at a point (2,), moved by `offset` pixels (right, up) and turned by `turn` degrees."""

    position: Coordinates
    text: str
    colour: str = INK
    size: float = 12.0
    align: str = "left"  # or center, right
    baseline: str = "middle"  # or top, bottom
    offset: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    bold: bool = False
    alpha: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _point("position", self.position))
        if self.align not in ("left", "center", "right"):
            raise ValueError(f"align is {self.align!r}, allowed are left, center, right")
        if self.baseline not in ("top", "middle", "bottom"):
            raise ValueError(f"baseline is {self.baseline!r}, allowed are top, middle, bottom")


@dataclass(frozen=True)
class Axes:
    """Labelled axes over a rectangle of the window, with a scale of their own.

    `rectangle` (left, right, bottom, top) is where they stand, in units of the window; `x_range`
    and `y_range` are the values at its edges (the same as the rectangle where left out).
    `place` takes values to the window. A direction with `ticks` 0 has no ticks.
    """

    rectangle: tuple[float, float, float, float]
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    x_label: str = ""
    y_label: str = ""
    title: str = ""
    x_ticks: int = 5
    y_ticks: int = 5
    grid: bool = True
    size: float = 12.0

    def __post_init__(self) -> None:
        for name, (low, high) in (
            ("rectangle", self.rectangle[:2]),
            ("rectangle", self.rectangle[2:]),
            ("x_range", self.x_values),
            ("y_range", self.y_values),
        ):
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"{name} has ({low}, {high}), allowed is finite and increasing")

    @property
    def x_values(self) -> tuple[float, float]:
        """Values at the left and right edge."""
        return self.x_range or (self.rectangle[0], self.rectangle[1])

    @property
    def y_values(self) -> tuple[float, float]:
        """Values at the lower and upper edge."""
        return self.y_range or (self.rectangle[2], self.rectangle[3])

    def place(self, values: ArrayLike, clip: bool = True) -> Array:
        """Values (2, N) or (2,) on these axes as points of the window.

        Args:
            values: x and y.
            clip: keep what is beyond the edges on the edge.
        """
        x, y = np.asarray(values, dtype=float)
        left, right, bottom, top = self.rectangle
        (x0, x1), (y0, y1) = self.x_values, self.y_values
        x = left + (x - x0) * ((right - left) / (x1 - x0))
        y = bottom + (y - y0) * ((top - bottom) / (y1 - y0))
        if clip:
            x, y = np.clip(x, left, right), np.clip(y, bottom, top)
        return np.array([x, y])

    def values(self, point: ArrayLike) -> Array:
        """The inverse of `place`: a point (2,) of the window as values on these axes."""
        x, y = np.asarray(point, dtype=float)
        left, right, bottom, top = self.rectangle
        (x0, x1), (y0, y1) = self.x_values, self.y_values
        return np.array(
            [x0 + (x - left) * (x1 - x0) / (right - left),
             y0 + (y - bottom) * (y1 - y0) / (top - bottom)]
        )  # fmt: skip


Item = Line | Polygon | Disc | Arrow | Text | Axes


@dataclass(frozen=True)
class Frame:
    """One picture: a window (xmin, xmax, ymin, ymax) with equal scales, and what is in it.

    Attributes:
        window: edges of the picture in world units.
        items: drawn in this order.
        width: pixels across for which line widths and letters are given.
        label: what the picture shows, in words; together with the numbers it is what those who
            cannot see the picture are told.
        numbers: printed below the picture, by name.
        background: colour.
    """

    window: tuple[float, float, float, float]
    items: tuple[Item, ...]
    width: float = 900.0
    label: str = ""
    numbers: Mapping[str, str] = field(default_factory=dict)
    background: str = "#ffffff"

    def __post_init__(self) -> None:
        xmin, xmax, ymin, ymax = self.window
        if not (np.isfinite(self.window).all() and xmin < xmax and ymin < ymax):
            raise ValueError(
                f"window is {self.window}, allowed is (xmin, xmax, ymin, ymax), finite, increasing"
            )
        if not (math.isfinite(self.width) and self.width > 0.0):
            raise ValueError(f"width is {self.width}, allowed is a positive number of pixels")

    @property
    def text(self) -> str:
        """The label and the numbers, a line each."""
        return "\n".join([self.label, *(f"  {k}: {v}" for k, v in self.numbers.items())])


def ticks(low: float, high: float, count: int) -> list[float]:
    """About `count` round numbers (1, 2 or 5 times a power of ten apart) from low to high."""
    if count < 1:
        return []
    rough = (high - low) / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= rough * (1.0 - 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def _tick_label(value: float) -> str:
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _axes_items(axes: Axes) -> list[Item]:
    """The lines and words that axes are made of."""
    left, right, bottom, top = axes.rectangle
    items: list[Item] = []
    for x in ticks(*axes.x_values, axes.x_ticks):
        place = float(axes.place((x, axes.y_values[0]))[0])
        if axes.grid:
            items.append(Line(np.array([[place, place], [bottom, top]]), FAINT, 1.0))
        items.append(Text(np.array([place, bottom]), _tick_label(x), GREY, axes.size,
                          "center", "top", (0.0, -5.0)))  # fmt: skip
    widest = 0
    for y in ticks(*axes.y_values, axes.y_ticks):
        place = float(axes.place((axes.x_values[0], y))[1])
        if axes.grid:
            items.append(Line(np.array([[left, right], [place, place]]), FAINT, 1.0))
        words = _tick_label(y)
        widest = max(widest, len(words))
        items.append(Text(np.array([left, place]), words, GREY, axes.size,
                          "right", "middle", (-6.0, 0.0)))  # fmt: skip
    frame = np.array([[left, left, right], [top, bottom, bottom]])
    items.append(Line(frame, GREY, 1.2))
    if axes.x_label:
        below = -(8.0 + 1.15 * axes.size) if axes.x_ticks else -6.0
        items.append(Text(np.array([0.5 * (left + right), bottom]), axes.x_label, INK, axes.size,
                          "center", "top", (0.0, below)))  # fmt: skip
    if axes.y_label:
        beside = -(12.0 + 0.6 * axes.size * widest) if axes.y_ticks else -8.0
        items.append(Text(np.array([left, 0.5 * (bottom + top)]), axes.y_label, INK, axes.size,
                          "center", "bottom", (beside, 0.0), turn=90.0))  # fmt: skip
    if axes.title:
        items.append(Text(np.array([left, top]), axes.title, INK, axes.size + 1.0,
                          "left", "bottom", (0.0, 6.0), bold=True))  # fmt: skip
    return items


def primitives(frame: Frame) -> list[Line | Polygon | Disc | Arrow | Text]:
    """The items of a frame with axes taken apart into lines and words, in drawing order."""
    result: list[Any] = []
    for item in frame.items:
        result += _axes_items(item) if isinstance(item, Axes) else [item]
    return result


def encode(frame: Frame) -> tuple[dict[str, Any], bytes]:
    """A frame as it goes to the browser: how to draw (JSON) and where (single precision).

    Returns:
        (header, coordinates): each entry of `header["items"]` is [kind, number of points, style
        ...]; the coordinates are little-endian float32 pairs x, y, of all items in turn.
    """
    items: list[list[Any]] = []
    blocks: list[Array] = []
    for item in primitives(frame):
        match item:
            case Line():
                points = item.points
                style = ["line", item.colour, item.width, list(item.dash), item.alpha]
            case Polygon():
                points = item.points
                style = ["polygon", item.fill, item.edge, item.width, item.alpha]
            case Disc():
                points = item.centre
                style = ["disc", item.radius, item.fill, item.edge, item.width, item.alpha]
            case Arrow():
                points = np.hstack([item.tail, item.tip])
                style = ["arrow", item.colour, item.width, item.head, item.alpha]
            case Text():
                points = item.position
                style = ["text", item.text, item.colour, item.size, item.align, item.baseline,
                         *item.offset, item.turn, item.bold, item.alpha]  # fmt: skip
        items.append([style[0], points.shape[1], *style[1:]])
        blocks.append(points)
    joined = np.hstack(blocks) if blocks else np.empty((2, 0))
    joined = np.where(np.isfinite(joined), np.clip(joined, -_FAR, _FAR), np.nan)
    header = {
        "window": [float(edge) for edge in frame.window],
        "width": frame.width,
        "label": frame.label,
        "numbers": list(frame.numbers.items()),
        "background": frame.background,
        "items": items,
    }
    return header, np.ascontiguousarray(joined.T, dtype="<f4").tobytes()


def draw(frame: Frame, axes: Any) -> None:
    """Draw a frame on matplotlib axes, as the browser draws it on the canvas."""
    from matplotlib import patches
    from matplotlib.transforms import ScaledTranslation

    xmin, xmax, ymin, ymax = frame.window
    axes.set_xlim(xmin, xmax)
    axes.set_ylim(ymin, ymax)
    axes.set_aspect("equal")
    axes.set_axis_off()
    figure = axes.figure
    # Points on paper for one pixel of the frame.
    size = axes.get_window_extent().width / figure.dpi * 72.0 / frame.width
    for order, item in enumerate(primitives(frame)):
        common: dict[str, Any] = {"zorder": order, "alpha": item.alpha}
        match item:
            case Line():
                width = max(item.width * size, 1e-6)
                style: Any = "-"
                if item.dash:
                    style = (0, tuple(part * size for part in item.dash))
                x, y = np.where(np.isfinite(item.points), item.points, np.nan)
                axes.plot(x, y, color=item.colour, linewidth=width, linestyle=style,
                          solid_capstyle="butt", solid_joinstyle="round", **common)  # fmt: skip
            case Polygon():
                axes.add_patch(
                    patches.Polygon(
                        item.points.T, closed=True, facecolor=item.fill or "none",
                        edgecolor=item.edge or "none", linewidth=item.width * size, **common,
                    )
                )  # fmt: skip
            case Disc():
                for centre in item.centre.T:
                    axes.add_patch(
                        patches.Circle(
                            (float(centre[0]), float(centre[1])), item.radius,
                            facecolor=item.fill or "none", edgecolor=item.edge or "none",
                            linewidth=item.width * size, **common,
                        )
                    )  # fmt: skip
            case Arrow():
                head = item.head * size
                axes.annotate(
                    "", xy=item.tip[:, 0], xytext=item.tail[:, 0], zorder=order,
                    arrowprops={
                        "arrowstyle": f"-|>,head_length={head},head_width={0.4 * head}",
                        "mutation_scale": 1.0, "color": item.colour, "alpha": item.alpha,
                        "linewidth": item.width * size, "shrinkA": 0.0, "shrinkB": 0.0,
                    },
                )  # fmt: skip
            case Text():
                shift = ScaledTranslation(
                    item.offset[0] * size / 72.0, item.offset[1] * size / 72.0,
                    figure.dpi_scale_trans,
                )  # fmt: skip
                axes.text(
                    float(item.position[0, 0]), float(item.position[1, 0]), item.text,
                    transform=axes.transData + shift, color=item.colour,
                    fontsize=item.size * size * 0.94, ha=item.align,
                    va={"middle": "center_baseline"}.get(item.baseline, item.baseline),
                    rotation=item.turn, rotation_mode="anchor" if item.turn else "default",
                    fontweight="bold" if item.bold else "normal", parse_math=False,
                    clip_on=False, **common,
                )  # fmt: skip


def to_png(frame: Frame, sharpness: float = 1.5) -> bytes:
    """A frame and its numbers as a PNG, `sharpness` dots for each pixel of the frame.

    The same frame gives the same bytes.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    xmin, xmax, ymin, ymax = frame.window
    width = frame.width
    picture = width * (ymax - ymin) / (xmax - xmin)
    columns = max(1, int((width - 16.0) // _CELL[0]))
    height = picture + _CELL[1] * math.ceil(len(frame.numbers) / columns)
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0 * sharpness)
    FigureCanvasAgg(figure)
    figure.set_facecolor(frame.background)
    draw(frame, figure.add_axes((0.0, 1.0 - picture / height, 1.0, picture / height)))
    for k, (name, value) in enumerate(frame.numbers.items()):
        x = (8.0 + _CELL[0] * (k % columns)) / width
        top = height - picture - _CELL[1] * (k // columns)
        for words, below, colour, size in ((name, 2.0, GREY, 11.0), (value, 17.0, INK, 14.0)):
            figure.text(x, (top - below) / height, words, color=colour, va="top",
                        fontsize=0.68 * size, parse_math=False)  # fmt: skip
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


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
    """Shows frames in the browser: `show(frame)` as often as one likes.

    Two frames at most are on their way. One that comes while the browser is still busy with those
    waits, and a newer one takes its place. So the newest frame is always shown in the end, and a
    slow browser slows down nobody.
    """

    _esm = pathlib.Path(__file__).with_suffix(".js")
    _pointer = traitlets.Bool(False).tag(sync=True)
    _keys = traitlets.List(traitlets.Unicode()).tag(sync=True)

    def __init__(self, frame: Frame, **options: Any) -> None:
        super().__init__(**options)
        self._frame = frame
        self._traffic = _Traffic()
        self._lock = threading.RLock()
        self._pointer_callbacks: list[Callable[[Pointer], None]] = []
        self._key_callbacks: list[Callable[[Key], None]] = []
        self.on_msg(self._receive)

    @property
    def frame(self) -> Frame:
        """The newest frame."""
        return self._frame

    @property
    def traffic(self) -> Mapping[str, int]:
        """How many frames were sent, drawn by the browser, and dropped for a newer one."""
        t = self._traffic
        return {"sent": t.sent, "drawn": t.drawn, "dropped": t.dropped}

    @property
    def watched(self) -> bool:
        """Whether a browser shows this canvas and has drawn a picture within the last 2 s."""
        t = self._traffic
        busy = t.sent > t.drawn and time.monotonic() - t.drawn_at > 2.0
        return t.views > 0 and not busy

    def show(self, frame: Frame) -> None:
        """Make this the picture; it is sent as soon as the browser keeps up with those before."""
        with self._lock:
            self._frame = frame
            traffic = self._traffic
            if traffic.views == 0:
                return
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

    def _transmit(self) -> None:
        header, coordinates = encode(self._frame)
        traffic = self._traffic
        traffic.sent += 1
        traffic.sent_at = time.monotonic()
        traffic.waiting = False
        self.send({"type": "frame", "id": traffic.sent, **header}, [coordinates])

    def _receive(self, _widget: Any, content: Any, _buffers: Any) -> None:
        """Messages of the browser: data, so looked at before use."""
        kind = content.get("type") if isinstance(content, dict) else None
        traffic = self._traffic
        if kind == "ready":
            with self._lock:
                traffic.views += 1
                traffic.drawn_at = time.monotonic()
                self._transmit()
        elif kind == "gone":
            with self._lock:
                traffic.views = max(traffic.views - 1, 0)
        elif kind == "drawn":
            number = content.get("id")
            with self._lock:
                if isinstance(number, int) and traffic.drawn < number <= traffic.sent:
                    traffic.drawn = number
                    traffic.drawn_at = time.monotonic()
                    if traffic.waiting and traffic.sent - traffic.drawn < _IN_FLIGHT:
                        self._transmit()
        elif kind in ("down", "move", "up"):
            x, y = content.get("x"), content.get("y")
            numbers = all(isinstance(value, int | float) for value in (x, y))
            if numbers and math.isfinite(x) and math.isfinite(y):
                for pointer_callback in self._pointer_callbacks:
                    pointer_callback(Pointer(kind, float(x), float(y)))
        elif kind == "key" and content.get("key") in self._keys:
            for key_callback in self._key_callbacks:
                key_callback(Key(content["key"]))

    def __repr__(self) -> str:
        return self._frame.text

    def _repr_mimebundle_(self, **_options: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return bundle(self, self._frame)


def bundle(widget: Any, frame: Frame) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a notebook keeps of a widget: the widget, its last picture, and its numbers as text."""
    import base64

    data: dict[str, Any] = {
        "text/plain": frame.text,
        "image/png": base64.b64encode(to_png(frame)).decode("ascii"),
        "application/vnd.jupyter.widget-view+json": {
            "version_major": 2,
            "version_minor": 0,
            "model_id": widget.model_id,
        },
    }
    return data, {"image/png": {"width": int(frame.width)}}
