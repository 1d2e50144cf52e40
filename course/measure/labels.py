"""Words on a chart: names at the ends of curves, and notes where nothing is drawn.

Nothing is printed over a curve. The name of a curve stands right of the axes at the height at which
the curve ends, that of a line across x above them; names that would meet are moved apart, and a
thin line leads from the end to a name that had to go. A note beside a point (a setting, the pick)
takes the nearest place that is free. Both need the places of the axes in pixels, so `arrange` is
called once the layout is known.
"""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.text import Annotation
    from matplotlib.transforms import Bbox, Transform

Array = NDArray[np.float64]

# Before a name stands what it names: its marker, filled or hollow, or the stroke of its line.
FILLED: dict[str, str] = dict(zip("osDv^P*Xpdhx", "●■◆▼▲✚★✖⬟♦⬢✕", strict=True))
HOLLOW: dict[str, str] = dict(zip("osDv^P*Xpdhx", "○□◇▽△✛☆✕⬠♢⬡✕", strict=True))
STROKES = {"-": "━", "--": "╍", ":": "┈", "steps": "━"}
SMALL = 8.0  # points, the smallest letters
COLUMNS = 24  # of a name, before it is broken into lines
SPACE = 3.0  # pixels around a note
_AWAY = (
    5.0,
    8.0,
    12.0,
    18.0,
    26.0,
    38.0,
    54.0,
    76.0,
    104.0,
    130.0,
    160.0,
)  # pixels from a point to its note
_TURNS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False) + 0.25 * np.pi


def spread(desired: ArrayLike, sizes: ArrayLike, low: float, high: float) -> Array:
    """Return centres of boxes along a line: none overlap, and the squares of the moves are least.

    Where the boxes have room between `low` and `high`, they stay there. This is isotonic
    regression of the places that are left when the boxes are shrunk to points, by pooling adjacent
    violators (Ayer et al., 1955).

    Args:
        desired: centres as they should be, shape (n,).
        sizes: of the boxes, shape (n,).
        low: lower bound of the line.
        high: upper bound of the line.
    """
    desired, sizes = np.asarray(desired, dtype=float), np.asarray(sizes, dtype=float)
    order = np.argsort(desired, kind="stable")
    # Shrink every box to a point at its start: the order of the points is the only constraint left.
    before = np.cumsum(sizes[order]) - sizes[order]
    pools: list[tuple[float, int]] = []
    for value in desired[order] - 0.5 * sizes[order] - before:
        pools.append((float(value), 1))
        # Pool adjacent violators: two pools out of order merge into their weighted mean.
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (b, n), (a, m) = pools.pop(), pools.pop()
            pools.append(((a * m + b * n) / (m + n), m + n))
    starts = np.repeat([value for value, _ in pools], [n for _, n in pools])
    centres = np.empty(desired.size)
    # Grow the boxes again, and shift what would leave the line.
    centres[order] = (
        np.clip(starts, low, max(low, high - float(np.sum(sizes)))) + before + 0.5 * sizes[order]
    )
    return centres


def free_place(
    size: ArrayLike, anchor: ArrayLike, points: Array, boxes: Array, room: Sequence[float]
) -> tuple[float, float]:
    """Return the centre of a box near a point that covers nothing, or the least.

    Args:
        size: width and height of the box [pixels], its margin with it.
        anchor: the point, shape (2,).
        points: what must not be covered, shape (n, 2).
        boxes: what it must not meet, rows of (x0, y0, x1, y1), shape (m, 4).
        room: (x0, y0, x1, y1) in which it has to be.
    """
    half, anchor = 0.5 * np.asarray(size), np.asarray(anchor)
    # Candidates on rings around the point, from near to far; the last resort is a grid over the
    # room.
    around = [
        anchor + (half + away) * (np.cos(turn), np.sin(turn)) for away in _AWAY for turn in _TURNS
    ]
    # Where nothing near is free: anywhere in the room, the nearest first.
    first, last = np.asarray(room[:2]) + half, np.asarray(room[2:]) - half
    across, up = np.meshgrid(*np.linspace(first, last, 25).T)
    anywhere = np.column_stack((across.ravel(), up.ravel()))
    order = np.argsort(np.hypot(*(anywhere - anchor).T), kind="stable")
    best, least = (0.0, 0.0), np.inf
    for centre in itertools.chain(around, anywhere[order]):
        low, high = centre - half, centre + half
        if np.any(low < room[:2]) or np.any(high > room[2:]):
            continue
        covered = np.sum(np.all((points > low) & (points < high), axis=1))
        met = np.sum(np.all((boxes[:, :2] < high) & (boxes[:, 2:] > low), axis=1))
        # Meeting another box is nine times as bad as covering a point of a curve.
        if covered + 9 * met < least:
            best, least = (float(centre[0]), float(centre[1])), covered + 9 * met
        if least == 0:
            return best
    return best


@dataclass
class Word:
    """One text, and the transform to pixels of what it belongs to."""

    text: Annotation
    of: Transform

    @property
    def end(self) -> Array:
        """What it belongs to [pixels], shape (2,)."""
        return np.asarray(self.of.transform(self.text.xy), dtype=float)

    @property
    def box(self) -> Bbox:
        """The place of the text alone, without the line that leads to it [pixels]."""
        from matplotlib.text import Text

        return Text.get_window_extent(self.text)

    def put(self, across: float, up: float, leader: bool) -> None:
        """Move it to a place on the axes [shares], with or without a line that leads there."""
        assert self.text.arrow_patch is not None
        self.text.set_position((across, up))
        self.text.arrow_patch.set_visible(leader)


@dataclass
class Words:
    """The words of one pair of axes, until they get their places.

    Attributes:
        right: names at the right of the axes, at the heights of their points.
        top: names above the axes.
        notes: words beside points.
    """

    ax: Axes
    right: list[Word] = field(default_factory=list)
    top: list[Word] = field(default_factory=list)
    notes: list[Word] = field(default_factory=list)

    def name(self, words: str, end: Any, of: Transform, colour: Any, glyph: str = "") -> None:
        """Put a name at the right of the axes.

        Args:
            words: the name.
            end: of what is named, shape (2,).
            of: transform of `end` to pixels.
            colour: of what is named.
            glyph: what it looks like.
        """
        text = textwrap.fill(f"{glyph} {words}".strip(), COLUMNS, subsequent_indent="    ")
        self.right.append(self._add(text, end, of, colour, (0.0, 0.5), va="center"))

    def above(self, words: str, x: float) -> None:
        """Put a name above the axes, for what is at x."""
        of = self.ax.get_xaxis_transform()
        self.top.append(self._add(words, (x, 1.0), of, "0.3", (0.5, 0.0), ha="center", va="bottom"))

    def note(self, words: str, x: float, y: float, colour: Any = "black") -> None:
        """Words beside a point."""
        of = self.ax.transData
        self.notes.append(
            self._add(words, (x, y), of, colour, (0.5, 0.5), ha="center", va="center")
        )
        self.notes[-1].text.set_in_layout(False)

    def _add(
        self, words: str, end: Any, of: Transform, colour: Any, start: Any, **how: Any
    ) -> Word:
        from matplotlib.colors import to_rgb

        dark = tuple(0.8 * part for part in to_rgb(colour))  # a pale colour is hard to read
        line = {
            "arrowstyle": "-",
            "lw": 0.6,
            "color": dark,
            "alpha": 0.6,
            "shrinkA": 1.0,
            "relpos": start,
        }
        text = self.ax.annotate(
            words,
            end,
            xycoords=of,
            xytext=(1.03, 1.03),
            textcoords="axes fraction",
            color=dark,
            fontsize=SMALL,
            linespacing=1.0,
            annotation_clip=False,
            arrowprops=line,
            **how,
        )
        return Word(text, of)


def arrange(figure: Figure, every: Sequence[Words]) -> None:
    """Give all words of a figure their places."""
    engine = figure.get_layout_engine()
    # Only a laid out figure knows its pixels.
    if engine is not None:
        engine.execute(figure)  # of a drawing only the layout: from here on pixels are known
    for words in every:
        words.ax.apply_aspect()
        room = words.ax.get_window_extent()
        sizes = [name.box.height + 2.0 for name in words.right]
        # Names of curves keep their order at the right, moved apart; a line leads to those that
        # moved.
        heights = spread([name.end[1] for name in words.right], sizes, room.y0, room.y1)
        for name, height in zip(words.right, heights, strict=True):
            moved = max(room.x1 - name.end[0], abs(height - name.end[1])) > 8.0
            name.put(1.03, (height - room.y0) / room.height, moved)
        sizes = [name.box.width + 8.0 for name in words.top]
        places = spread([name.end[0] for name in words.top], sizes, room.x0, room.x1)
        for name, place in zip(words.top, places, strict=True):
            name.put((place - room.x0) / room.width, 1.03, abs(place - name.end[0]) > 8.0)
        # Notes are placed one after the other, each avoiding the curves and the notes before it.
        points, boxes = drawn_points(words.ax), np.empty((0, 4))
        for note in words.notes:
            size = np.asarray(note.box.size) + 2.0 * SPACE
            x, y = free_place(size, note.end, points, boxes, room.extents)
            boxes = np.vstack(
                (boxes, [x - size[0] / 2, y - size[1] / 2, x + size[0] / 2, y + size[1] / 2])
            )
            far = math.dist(note.end, (x, y)) > 0.5 * math.hypot(*size) + 12.0
            note.put((x - room.x0) / room.width, (y - room.y0) / room.height, far)


def drawn_points(ax: Axes, spacing: float = 3.0) -> Array:
    """Return points covered by the lines and markers of axes, shape (n, 2) [pixels].

    Args:
        ax: the axes, whose place is known.
        spacing: largest distance of two points along a line [pixels].
    """
    from matplotlib.collections import LineCollection

    result = [np.empty((0, 2))]
    for line in ax.lines:
        points = line.get_transform().transform(line.get_xydata())
        points = points[np.all(np.isfinite(points), axis=1)]
        # A line is sampled densely, since a note must not cover the parts between its data points.
        if line.get_linestyle() not in ("None", "none", "") and len(points) > 1:
            points = _dense(_steps(line, points), spacing)
        result.append(points)
        if line.get_marker() not in ("None", "none", ""):
            # A marker is represented by points around its rim.
            radius = 0.5 * line.get_markersize() * ax.figure.dpi / 72.0
            marks = line.get_transform().transform(line.get_xydata())
            result += [marks + radius * np.array([np.cos(turn), np.sin(turn)]) for turn in _TURNS]
    for bars in ax.collections:
        if isinstance(bars, LineCollection):
            for bar in map(bars.get_transform().transform, bars.get_segments()):
                result += [_dense(bar, spacing)] if np.all(np.isfinite(bar)) else []
    points = np.concatenate(result)
    points = points[np.all(np.isfinite(points), axis=1)]
    room = ax.get_window_extent().padded(0.5)
    return points[np.all((points >= room.min) & (points <= room.max), axis=1)]


def _steps(line: Line2D, points: Array) -> Array:
    """Return the corners of a staircase; other lines as they are."""
    if line.get_drawstyle() != "steps-post":
        return points
    corners = np.column_stack((points[1:, 0], points[:-1, 1]))
    return np.insert(points, np.arange(1, len(points)), corners, axis=0)


def _dense(points: Array, spacing: float) -> Array:
    # Chebyshev length: enough samples along the longer axis.
    far = np.max(np.abs(np.diff(points, axis=0)), axis=1)
    # A line that leaves the picture may go on for ever.
    count = np.clip(np.ceil(far / spacing), 1, 2000).astype(int)
    at = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)] + [[len(far)]])
    index = np.arange(len(points))
    return np.column_stack([np.interp(at, index, points[:, i]) for i in (0, 1)])
