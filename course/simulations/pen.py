"""The display list of all simulations: one float64 array that a model writes and painters read.

A model's `frame(pen, state, controls)` calls the functions below. They are in the subset of Python
that Numba compiles, and run as plain Python too. A pen is an array from `Paper.pen()`: `HEADER`
numbers that say where it stands, then items one after the other, each its kind, how many numbers
follow, a style and points (x, y in turn) in units of the paper's window. Words and colours stand in
tables on the paper. `canvas.js` and `painter.py` draw the items, `decode` reads them.

Lengths on paper (line widths, letters, arrow heads) are in pixels of a picture that is
`Paper.width` pixels wide, and scale with it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.check import invalid, positive, vector

Array = NDArray[np.float64]

# Kinds of items, and how many numbers of each are its style; what follows are points or words.
CUT, LINE, POLYGON, DISC, ARROW, TEXT, READOUT = range(7)
STYLE = {CUT: 0, LINE: 5, POLYGON: 4, DISC: 5, ARROW: 4, TEXT: 11, READOUT: 1}

# Colours that a colour-blind reader can tell apart (Wong, Nature Methods 8, 2011), and greys.
BLUE, ORANGE, GREEN, RED, PURPLE, INK, GREY, FAINT = range(8)
PALETTE = (
    "#0072b2",
    "#d55e00",
    "#00815a",
    "#c1272d",
    "#8a4f9e",
    "#222222",
    "#767676",
    "#dddddd",
)
NONE = -1  # no fill, or no edge

# How a number is written: decimals (0 to 15), plus SIGNED for a sign always, or EXPONENT for
# powers of ten. WORD stands where a number's format would: a word of the table.
WORD, SIGNED, EXPONENT = -1, 20, 40

LEFT, CENTRE, RIGHT = BOTTOM, MIDDLE, TOP = 0.0, 0.5, 1.0

# Where a pen stands: the next free place, the item begun last, the rectangle of the window that is
# drawn in, the values at its edges, and what takes a value to the window.
HEADER = 12
_FREE, _ITEM, _RECTANGLE, _VALUES, _SCALE_X, _SCALE_Y = 0, 1, 2, 6, 10, 11


class Table:
    """Words or colours, known to compiled functions by their number."""

    def __init__(self, *entries: str) -> None:
        self.entries = list(entries)

    def __call__(self, *entries: str) -> tuple[int, ...]:
        """Append entries and return their numbers."""
        self.entries += entries
        return tuple(range(len(self.entries) - len(entries), len(self.entries)))


def words_table() -> Table:
    """Return a table of words whose number 0 is empty."""
    return Table("")


def colours_table() -> Table:
    """Return a table of colours that begins with those of the course, `BLUE` to `FAINT`."""
    return Table(*PALETTE)


@dataclass(frozen=True)
class Paper:
    """What all pictures of a model have in common.

    Attributes:
        label: what the pictures show, in words, for those who cannot see them.
        words, colours: the tables that the items refer to.
        window: xmin, xmax, ymin, ymax of a picture, with equal scales.
        width: pixels across for which line widths and letters are given.
        background: colour.
        room: how many numbers a picture may have.
    """

    label: str
    words: Table = field(default_factory=words_table)
    colours: Table = field(default_factory=colours_table)
    window: tuple[float, float, float, float] = (0.0, 9.0, 0.0, 5.0)
    width: float = 760.0
    background: str = "#ffffff"
    room: int = 20_000

    def __post_init__(self) -> None:
        xmin, xmax, ymin, ymax = vector("window", self.window, (4,))
        if not (xmin < xmax and ymin < ymax):
            raise invalid("window", self.window, "xmin < xmax, ymin < ymax")
        positive("width", self.width, unit="pixels")

    def declaration(self) -> dict[str, Any]:
        """Return what a browser has to know once."""
        return {
            "label": self.label,
            "window": list(self.window),
            "width": self.width,
            "background": self.background,
            "words": self.words.entries,
            "colours": self.colours.entries,
        }

    def pen(self) -> Array:
        """Return a new pen with nothing drawn."""
        pen = np.zeros(HEADER + self.room)
        clear(pen)
        return pen


# --- What a model calls ---------------------------------------------------------------------------


@register_jitable
def clear(pen):
    """Begin a new picture; what is drawn is in units of the window."""
    pen[_FREE] = HEADER
    pen[_ITEM] = HEADER
    pen[_RECTANGLE : _RECTANGLE + 8] = 0.0
    pen[_SCALE_X] = 1.0
    pen[_SCALE_Y] = 1.0


@register_jitable
def _full(kind):
    """Say what had no room; compiled code can raise only sentences that it was compiled with."""
    if kind == CUT:
        raise ValueError("no room left on the paper for an area")
    if kind == LINE:
        raise ValueError("no room left on the paper for a line")
    if kind == POLYGON:
        raise ValueError("no room left on the paper for a polygon")
    if kind == DISC:
        raise ValueError("no room left on the paper for discs")
    if kind == ARROW:
        raise ValueError("no room left on the paper for an arrow")
    if kind == TEXT:
        raise ValueError("no room left on the paper for a text")
    raise ValueError("no room left on the paper for a readout")


@register_jitable
def _more(pen, count):
    """Reserve `count` more numbers for the item begun last; return where they go."""
    at, item = int(pen[_FREE]), int(pen[_ITEM])
    if at == HEADER:
        raise ValueError("points or words before the item that they belong to")
    if at + count > pen.size:
        _full(pen[item])
    # Items are stored one after the other as (kind, count, numbers ...); here the count grows.
    pen[_FREE] = at + count
    pen[item + 1] += count
    return at


@register_jitable
def _begin(pen, kind, count):
    """Begin an item with `count` numbers; return where they go."""
    at = int(pen[_FREE])
    if at + 2 + count > pen.size:
        _full(kind)
    pen[_ITEM] = at
    pen[_FREE] = at + 2 + count
    pen[at] = kind
    pen[at + 1] = count
    return at + 2


@register_jitable
def _place(pen, at, x, y):
    """Write a point, given in values of the area, in units of the window."""
    pen[at] = pen[_RECTANGLE] + (x - pen[_VALUES]) * pen[_SCALE_X]
    pen[at + 1] = pen[_RECTANGLE + 2] + (y - pen[_VALUES + 2]) * pen[_SCALE_Y]


@register_jitable
def area(pen, rectangle, values):
    """Show values in a rectangle from now on, and cut shapes off at its edges.

    Args:
        pen: as everywhere.
        rectangle: left, right, bottom, top in units of the window.
        values: x and y at these edges: x_left, x_right, y_bottom, y_top.
    """
    for k in range(4):
        pen[_RECTANGLE + k] = rectangle[k]
        pen[_VALUES + k] = values[k]
    # One scale and one offset for each axis take values to the window (`_place`).
    pen[_SCALE_X] = (rectangle[1] - rectangle[0]) / (values[1] - values[0])
    pen[_SCALE_Y] = (rectangle[3] - rectangle[2]) / (values[3] - values[2])
    at = _begin(pen, CUT, 4)
    pen[at], pen[at + 2] = rectangle[0], rectangle[1]
    pen[at + 1], pen[at + 3] = rectangle[2], rectangle[3]


@register_jitable
def window(pen):
    """Take points in units of the window again from now on, and cut nothing off."""
    area(pen, (0.0, 1.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0))
    # The cut's four numbers are dropped again: a cut without numbers ends the cutting.
    pen[_FREE] -= 4
    pen[int(pen[_ITEM]) + 1] = 0.0


@register_jitable
def values_at(rectangle, values, x, y):
    """Return the point (x, y) of the window in the values of an area."""
    return (
        values[0] + (x - rectangle[0]) * (values[1] - values[0]) / (rectangle[1] - rectangle[0]),
        values[2] + (y - rectangle[2]) * (values[3] - values[2]) / (rectangle[3] - rectangle[2]),
    )


@register_jitable
def line(pen, colour, width=1.5, alpha=1.0, on=0.0, gap=0.0):
    """Begin a line, dashed with `on` and `gap` pixels; a point that is NaN interrupts it."""
    at = _begin(pen, LINE, 5)
    pen[at] = colour
    pen[at + 1] = width
    pen[at + 2] = alpha
    pen[at + 3] = on
    pen[at + 4] = gap


@register_jitable
def polygon(pen, fill, edge=NONE, width=1.5, alpha=1.0):
    """Begin a closed polygon; its corners follow."""
    at = _begin(pen, POLYGON, 4)
    pen[at] = fill
    pen[at + 1] = edge
    pen[at + 2] = width
    pen[at + 3] = alpha


@register_jitable
def disc(pen, radius, fill, edge=NONE, width=1.5, alpha=1.0):
    """Begin discs of one radius, in x values of the area; their centres follow."""
    at = _begin(pen, DISC, 5)
    pen[at] = radius * pen[_SCALE_X]
    pen[at + 1] = fill
    pen[at + 2] = edge
    pen[at + 3] = width
    pen[at + 4] = alpha


@register_jitable
def point(pen, x, y):
    """Add a point to the line, polygon or discs begun last."""
    _place(pen, _more(pen, 2), x, y)


@register_jitable
def points(pen, x, y):
    """Add points, arrays (N,), to the line, polygon or discs begun last."""
    count = 2 * len(x)
    at = _more(pen, count)
    remaining, low = pen[_RECTANGLE], pen[_RECTANGLE + 2]
    pen[at : at + count : 2] = remaining + (x - pen[_VALUES]) * pen[_SCALE_X]
    pen[at + 1 : at + count : 2] = low + (y - pen[_VALUES + 2]) * pen[_SCALE_Y]


@register_jitable
def curve(pen, x, y, colour, width=1.5, alpha=1.0, on=0.0, gap=0.0):
    """Draw a line through points, arrays (N,)."""
    line(pen, colour, width, alpha, on, gap)
    points(pen, x, y)


@register_jitable
def spot(pen, x, y, radius, fill, edge=NONE, width=1.5, alpha=1.0):
    """Draw one disc around a point."""
    disc(pen, radius, fill, edge, width, alpha)
    point(pen, x, y)


@register_jitable
def spots(pen, x, y, radius, fill, edge=NONE, width=1.5, alpha=1.0):
    """Draw discs around points, arrays (N,)."""
    disc(pen, radius, fill, edge, width, alpha)
    points(pen, x, y)


@register_jitable
def segment(pen, x0, y0, x1, y1, colour, width=1.5, alpha=1.0, on=0.0, gap=0.0):
    """Draw a line from one point to another."""
    line(pen, colour, width, alpha, on, gap)
    point(pen, x0, y0)
    point(pen, x1, y1)


@register_jitable
def segments(pen, a, b, colour, width=1.5, alpha=1.0):
    """Draw lines from points to points, rows of arrays (N, 2), as one line with gaps."""
    # Two ends and a NaN for each segment, so that one line item draws all of them.
    ends = np.full((len(a), 3, 2), np.nan)
    ends[:, 0], ends[:, 1] = a, b
    flat = ends.reshape(-1, 2)
    curve(pen, flat[:, 0], flat[:, 1], colour, width, alpha)


@register_jitable
def box(pen, left, right, bottom, top, fill, edge=NONE, width=1.5, alpha=1.0):
    """Draw a rectangle with sides along the axes."""
    polygon(pen, fill, edge, width, alpha)
    point(pen, left, bottom)
    point(pen, right, bottom)
    point(pen, right, top)
    point(pen, left, top)


@register_jitable
def arrow(pen, x0, y0, x1, y1, colour, width=2.0, head=9.0, alpha=1.0):
    """Draw an arrow from (x0, y0) to its tip (x1, y1), with a head of `head` pixels."""
    at = _begin(pen, ARROW, 8)
    pen[at] = colour
    pen[at + 1] = width
    pen[at + 2] = head
    pen[at + 3] = alpha
    _place(pen, at + 4, x0, y0)
    _place(pen, at + 6, x1, y1)


@register_jitable
def text(
    pen,
    x,
    y,
    word=0,
    colour=INK,
    size=12.0,
    align=LEFT,
    baseline=MIDDLE,
    right=0.0,
    up=0.0,
    turn=0.0,
    bold=0.0,
    alpha=1.0,
):
    """Begin a text at a point, moved by pixels and turned by degrees.

    It is a word of the table, or what is added to it by `words` and `number`, or both.
    """
    at = _begin(pen, TEXT, 11)
    _place(pen, at, x, y)
    pen[at + 2] = colour
    pen[at + 3] = size
    pen[at + 4] = align
    pen[at + 5] = baseline
    pen[at + 6] = right
    pen[at + 7] = up
    pen[at + 8] = turn
    pen[at + 9] = bold
    pen[at + 10] = alpha
    if word != 0:
        words(pen, word)


@register_jitable
def title(pen, x, y, word=0):
    """Begin a title that stands on a point, such as the upper left corner of axes."""
    text(pen, x, y, word, INK, 13.0, LEFT, BOTTOM, 0.0, 8.0, 0.0, 1.0)


@register_jitable
def key(pen, x, y, word, colour, width=1.5, alpha=1.0, on=0.0, gap=0.0):
    """Draw what a line means: a sample of it and a word.

    The point is given in units of the window.
    """
    segment(pen, x, y, x + 0.3, y, colour, width, alpha, on, gap)
    text(pen, x + 0.38, y, word, INK, 11.5)


@register_jitable
def theory(pen, x, y):
    """Draw what theory says, dashed: a line through points, arrays (N,)."""
    curve(pen, x, y, INK, 1.6, 0.8, 5.0, 4.0)


@register_jitable
def theory_key(pen, x, y, word):
    """Draw what the dashed line means."""
    key(pen, x, y, word, INK, 1.6, 0.8, 5.0, 4.0)


BUTTON, BUTTON_HIGH, _BUTTON_GAP = 1.1, 0.32, 0.08  # from one to the next; height; between two


@register_jitable
def buttons(pen, x, y, word, count):
    """Draw a row of buttons with words that follow each other in the table.

    (x, y) is their corner.
    """
    for k in range(count):
        remaining = x + BUTTON * k
        box(pen, remaining, remaining + BUTTON - _BUTTON_GAP, y, y + BUTTON_HIGH, FAINT, GREY)
        middle = remaining + 0.5 * (BUTTON - _BUTTON_GAP)
        text(pen, middle, y + 0.5 * BUTTON_HIGH, word + k, INK, 13.0, CENTRE)


@register_jitable
def button_at(x, y, count, u, v):
    """Return the number of the button at the point (u, v) of the window, -1 for none.

    See `buttons`.
    """
    # The gap between two buttons belongs to none.
    k = int(np.floor((u - x) / BUTTON))
    inside = 0 <= k < count and u - x - BUTTON * k <= BUTTON - _BUTTON_GAP
    return k if inside and y <= v <= y + BUTTON_HIGH else -1


@register_jitable
def readout(pen, name):
    """Begin a number below the picture, by the word that names it; `words`, `number` follow."""
    pen[_begin(pen, READOUT, 1)] = name


@register_jitable
def words(pen, word):
    """Add a word of the table to the text or readout begun last."""
    at = _more(pen, 2)
    pen[at] = WORD
    pen[at + 1] = word


@register_jitable
def number(pen, value, form, unit=0):
    """Add a number, and a word after it, to the text or readout begun last.

    Args:
        pen: as everywhere.
        value: finite.
        form: decimals, plus SIGNED or EXPONENT.
        unit: a word of the table.
    """
    at = _more(pen, 2)
    pen[at] = form
    pen[at + 1] = value
    if unit != 0:
        words(pen, unit)


@register_jitable
def reading(pen, name, value, form, unit=0, instead=0):
    """Draw a number below the picture; or a word instead, where there is none to tell."""
    readout(pen, name)
    if instead != 0:
        words(pen, instead)
    else:
        number(pen, value, form, unit)


@register_jitable
def remember(history, count, now):
    """Make room for one more sample of a history (rows, N), whose row 0 is the time.

    When it is full the older half is dropped.

    Returns:
        How many samples there are now; the last one has its time, the other rows are to be filled.
    """
    size = history.shape[1]
    if count == size:
        # Full: the older half is dropped, so that the copy costs little on average.
        count -= size // 2
        history[:, :count] = history[:, size - count :].copy()
    history[0, count] = now
    return count + 1


@register_jitable
def copy(pen, data):
    """Draw what is in `Picture.data` of another picture on the same paper."""
    at = int(pen[_FREE])
    if at + data.size > pen.size:
        raise ValueError("no room left on the paper for a copy")
    # Only whole items are copied, so the list stays well-formed.
    pen[at : at + data.size] = data
    pen[_FREE] = at + data.size


@register_jitable
def tick(k, factor, power):
    """Return the tick k * factor * 10^power, as near as a float can be (powers from -22 to 22)."""
    if power < 0.0:
        return k * factor / 10.0**-power
    return k * factor * 10.0**power


@register_jitable
def ticks(low, high, count):
    """Return about `count` round numbers from low to high: 1, 2 or 5 times a power of ten apart.

    Returns:
        (first, last, factor, power): the ticks are `tick(k, factor, power)` for k from first to
        last; none (last < first) where floats are too coarse to tell the ticks apart.
    """
    span = high - low
    if count < 1 or not 0.0 < span < np.inf:
        return 1.0, 0.0, 1.0, 0.0
    rough = span / count
    power = np.floor(np.log10(rough))
    # The smallest of 1, 2, 5 and 10 times a power of ten that yields at most `count` intervals.
    factor = 10.0
    for smaller in (5.0, 2.0, 1.0):
        if tick(1.0, smaller, power) >= rough * (1.0 - 1e-9):
            factor = smaller
    if factor == 10.0:
        factor, power = 1.0, power + 1.0
    step = tick(1.0, factor, power)
    # A double has 53 bits: beyond this ratio neighbouring ticks can't be told apart.
    if max(abs(low), abs(high)) > 1e15 * step:
        return 1.0, 0.0, 1.0, 0.0
    # The quotient is off by less than one; then each tick itself is compared with the edges.
    first = np.floor(low / step) - 1.0
    while tick(first, factor, power) < low - 1e-9 * step:
        first += 1.0
    last = first - 1.0
    while tick(last + 1.0, factor, power) <= high + 1e-9 * step:
        last += 1.0
    return first, last, factor, power


@register_jitable
def tick_form(largest, power):
    """Return the number format that keeps ticks up to `largest` apart, and its length."""
    # The bound keeps the logarithm finite where all ticks are zero.
    before = np.floor(np.log10(max(abs(largest), 1e-300)))
    if -9.0 <= power and before < 7.0:
        decimals = int(max(-power, 0.0))
        return decimals, max(before, 0.0) + 1.0 + decimals + (decimals > 0)
    digits = int(max(before - power, 0.0))
    return EXPONENT + digits, digits + 5.0


@register_jitable
def axes(pen, x_label=0, y_label=0, heading=0, x_ticks=5, y_ticks=5, size=12.0, grid=True):
    """Draw the axes of the area: grid, ticks, labels; without ticks there is no grid either."""
    # Rectangle and values of the area, which `window` replaces for the labels.
    left, right, bottom, top = pen[2], pen[3], pen[4], pen[5]
    x0, x1, y0, y1 = pen[6], pen[7], pen[8], pen[9]
    window(pen)
    first, last, factor, power = ticks(x0, x1, x_ticks)
    form, _ = tick_form(max(abs(x0), abs(x1)), power)
    for k in range(int(last - first) + 1):
        value = tick(first + k, factor, power)
        # Rounding may put the outermost ticks just beyond the edge: they are moved onto it.
        x = min(max(left + (value - x0) * ((right - left) / (x1 - x0)), left), right)
        if grid:
            segment(pen, x, bottom, x, top, FAINT, 1.0)
        text(pen, x, bottom, 0, GREY, size, CENTRE, TOP, 0.0, -5.0)
        number(pen, value, form)
    first, last, factor, power = ticks(y0, y1, y_ticks)
    form, letters = tick_form(max(abs(y0), abs(y1)), power)
    if y0 < 0.0:
        # A minus sign needs room beside the axis too.
        letters += 1.0
    for k in range(int(last - first) + 1):
        value = tick(first + k, factor, power)
        y = min(max(bottom + (value - y0) * ((top - bottom) / (y1 - y0)), bottom), top)
        if grid:
            segment(pen, left, y, right, y, FAINT, 1.0)
        text(pen, left, y, 0, GREY, size, RIGHT, MIDDLE, -6.0)
        number(pen, value, form)
    line(pen, GREY, 1.2)
    point(pen, left, top)
    point(pen, left, bottom)
    point(pen, right, bottom)
    if x_label:
        below = -(8.0 + 1.15 * size) if x_ticks else -6.0
        text(pen, 0.5 * (left + right), bottom, x_label, INK, size, CENTRE, TOP, 0.0, below)
    if y_label:
        beside = -(12.0 + 0.6 * size * letters) if y_ticks else -8.0
        middle = 0.5 * (bottom + top)
        text(pen, left, middle, y_label, INK, size, CENTRE, BOTTOM, beside, 0.0, 90.0)
    if heading:
        title(pen, left, top, heading)
    # The labels were placed in the window; what follows is in values again.
    area(pen, (left, right, bottom, top), (x0, x1, y0, y1))


@register_jitable
def chart(pen, rectangle, values, x_label=0, y_label=0, heading=0, x_ticks=5, y_ticks=5):
    """Set the rectangle to draw in, with these values at its edges (`area`), and draw its axes."""
    area(pen, rectangle, values)
    axes(pen, x_label, y_label, heading, x_ticks, y_ticks)


@register_jitable
def gauge(pen, rectangle, high, value, colour, name, limit, mark):
    """Draw a value as a bar on a scale from 0 to `high`, and a limit with a marker's text."""
    chart(pen, rectangle, (0.0, high, 0.0, 1.0), name, 0, 0, 6, 0)
    box(pen, 0.0, value, 0.0, 1.0, colour)
    if limit < high:
        segment(pen, limit, -0.25, limit, 1.3, INK, 2.5)
        # The mark's text goes to the side with more room.
        side = LEFT if limit < 0.5 * high else RIGHT
        text(pen, limit, 1.3, mark, INK, 11.5, side, BOTTOM)


# --- What a painter reads -------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Item:
    """An item of a picture: its kind, its style, and its points (2, N) or its words."""

    kind: int
    style: tuple[float, ...]
    points: Array
    words: str = ""


@dataclass(frozen=True, eq=False)
class Picture:
    """What a pen has drawn: the paper, and the numbers of all items in turn."""

    paper: Paper
    data: Array

    @property
    def numbers(self) -> dict[str, str]:
        """The readouts by name, as they are written."""
        table = self.paper.words.entries
        return {
            table[int(item.style[0])]: item.words for item in decode(self) if item.kind == READOUT
        }

    @property
    def text(self) -> str:
        """The label and the readouts, a line each."""
        return "\n".join([self.paper.label, *(f"  {k}: {v}" for k, v in self.numbers.items())])


def picture(paper: Paper, pen: Array) -> Picture:
    """Return a copy of what a pen has drawn."""
    data = pen[HEADER : int(pen[_FREE])].copy()
    data.setflags(write=False)
    return Picture(paper, data)


def written(value: float, form: int) -> str:
    """Return a number as both painters write it.

    Halves are rounded away from zero, as browsers do.
    """
    sign = "+" if SIGNED <= form < EXPONENT else ""
    # Infinities and NaN as JavaScript writes them: both painters show the same text.
    if not np.isfinite(value):
        return (sign if value != -np.inf else MINUS) + ("NaN" if value != value else "Infinity")
    # Decimal represents the double exactly, so that halves are true halves.
    size, digits, tail = abs(Decimal(float(value))), form % 20, ""
    # JavaScript's toFixed changes to powers of ten at 1e21.
    if form >= EXPONENT or size >= 10**21:
        size = Context(digits + 1, ROUND_HALF_UP).plus(size)
        power = size.adjusted()
        size = size.scaleb(-power, _WIDE)
        tail = f"e{power}".replace("-", MINUS)
    shown = size.quantize(Decimal(1).scaleb(-digits), context=_WIDE)
    if value < 0.0 and shown:
        # No minus before a number that rounds to zero.
        sign = MINUS
    return f"{sign}{shown:f}{tail}"


_WIDE, MINUS = Context(60, ROUND_HALF_UP), "\N{MINUS SIGN}"


def _parts(paper: Paper, parts: Array) -> str:
    return "".join(
        paper.words.entries[int(value)] if form == WORD else written(value, int(form))
        for form, value in parts.reshape(-1, 2)
    )


def decode(picture: Picture) -> Iterator[Item]:
    """Yield the items of a picture, in drawing order.

    Raises:
        ValueError: the numbers are not a list of items.
    """
    data, at = picture.data, 0
    while at < data.size:
        kind, count = int(data[at]), int(data[at + 1])
        own = STYLE.get(kind, -1)
        rest = count - own
        # A list that the painter cannot read must not be skipped silently: counts and kinds are
        # checked.
        if own < 0 or rest < 0 or rest % 2 or at + 2 + count > data.size:
            raise ValueError(f"item at {at} has kind {kind} and {count} numbers: no such item")
        block = data[at + 2 : at + 2 + count]
        style = tuple(block[:own].tolist())
        if kind in (TEXT, READOUT):
            where = block[:2].reshape(2, 1) if kind == TEXT else np.empty((2, 0))
            yield Item(kind, style, where, _parts(picture.paper, block[own:]))
        else:
            yield Item(kind, style, block[own:].reshape(-1, 2).T)
        at += 2 + count
