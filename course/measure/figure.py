"""Charts as data: an experiment gives panels of series, and one door draws, writes and says them.

A `Series` is what one method gave, a `Panel` what belongs on one pair of axes. From the panels come
the picture (`draw`), the text of key figures (`text`) and the data file (`course.measure.data`). A
method has one colour and one marker in the whole course: the row of its key in
`course.measure.colours.KEYS`.

What an author need not care for: a picture is as wide as a page shows it, so that no letter is
smaller than 8 px there; every curve, line and region has its name at its end, in its colour, where
no other name and no curve is (`course.measure.labels`). What an author says: which curves matter.
A panel shows six; the others are `Series(..., extra=True)`, are named under the picture and in the
text, and are switched on by `draw(panels, also=[...])`, in a notebook by a control
(`course.simulations.trade_off`). Keep a label short: it is broken after 24 letters.
"""

from __future__ import annotations

import math
import os
import tempfile
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from course.check import invalid, one_of
from course.measure.colours import KEYS, MARKERS, PALETTE
from course.measure.labels import FILLED, HOLLOW, SMALL, STROKES, Words, arrange

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from course.measure.stability import Map

Array = NDArray[np.float64]

SIX = 6  # curves of a panel, before others are switched on
# A page shows a picture this wide: a notebook on a screen of 1280 px between both side bars, and a
# README. At that size the smallest capitals of a picture have 8 px.
SHOWN = 840  # px
WIDTH = 8.4  # inches of every picture
TICKS, NORMAL, LARGE = 8.5, 9.0, 10.0  # points
REACH = 0.5  # decimal logarithm of the values at both ends of a map's colours
SCALES = ("linear", "log", "log x", "log y")


@dataclass
class Series:
    """What one method gave.

    Attributes:
        label: its name, at its end; empty for none.
        x, y: the points, shapes (n,); an infinite y is a triangle at the upper edge, a zero on a
            logarithmic axis one at the lower edge, a NaN is not drawn. For bars x holds the lengths
            and y their names.
        key: row of `colours.KEYS`; empty for the next colour that nobody on the panel has.
        style: line as matplotlib's "-", "--", ":"; "" for markers alone, "steps", "bar".
        theory: x -> what y should be; drawn as a thin dark line, never used to measure.
        low, high: bounds of y, a band; of x for bars and where `across` is set, drawn as error
            bars.
        note: a line of the chart's text.
        marker: None for the key's own, "" for none.
        hollow: markers drawn empty and large, so that others show through.
        width, size: of the line and the markers [points]; size 0 for the usual.
        tags: words beside the points, in their order: at most one for each point, "" for a point
            without one.
        failed: how many runs failed: crosses at the upper edge, where a cost is infinite.
        failed_at: x of their crosses, where it is known; else they are spread along the edge.
        extra: not among the six curves that a panel shows before others are switched on.
    """

    label: str
    x: Any
    y: Any
    key: str = ""
    style: str = "-"
    theory: Callable[[Any], Any] | None = None
    low: Any = None
    high: Any = None
    note: str = ""
    marker: str | None = None
    hollow: bool = False
    width: float = 1.4
    size: float = 0.0
    tags: Sequence[str] = ()
    across: bool = False
    failed: int = 0
    failed_at: Sequence[float] = ()
    extra: bool = False

    def __post_init__(self) -> None:
        if self.key and self.key not in KEYS:
            raise invalid("key", self.key, f"one of {', '.join(KEYS)}")
        if len(self.x) != len(self.y):
            raise invalid("len(y)", len(self.y), f"that of x, {len(self.x)}")
        if len(self.tags) > len(self.x):
            raise invalid("len(tags)", len(self.tags), f"at most that of x, {len(self.x)}")

    @property
    def counts(self) -> bool:
        """True if it is a curve of its own, not a theory, a mark or the rest of one."""
        return bool(self.label) and self.key not in ("theory", "theory on a map", "chosen")

    @property
    def expected(self) -> Array:
        """Theory at every x, shape (n,)."""
        if self.theory is None:
            raise invalid("theory", None, f"a function, which {self.label!r} has not")
        return np.array([float(self.theory(x)) for x in self.x])


@dataclass
class Panel:
    """What belongs on one pair of axes.

    Attributes:
        title, x, y: texts; a panel without series and grid is text alone.
        series: drawn in order.
        scale: one of `SCALES`.
        equal: one scale for both axes, where both are lengths.
        lines: straight lines across, ("x" or "y", value, words).
        spans: grey regions, ("x" or "y", low, high, words).
        grid: a quantity over x and y, drawn as a map with its measured boundary.
        ticks: the labelled values of x; for bars () leaves the names out.
        tick_names: what stands at the ticks instead of their values: the names of cases.
        rows: names of the rows at y = 0, -1, -2, ... instead of values; empty ones leave y bare.
        xlim, ylim: limits of the axes, either end None for matplotlib's.
        legend: whether curves and lines have names; those of maps and bars stand above the axes.
        theory: name of theory's lines.
        notes: lines of the chart's text, before those of the series.
        footer: small print under the figure.
        data: what the data file holds in place of the series.
    """

    title: str
    x: str = ""
    y: str = ""
    series: list[Series] = field(default_factory=list)
    scale: str = "linear"
    equal: bool = False
    lines: Sequence[tuple[str, float, str]] = ()
    spans: Sequence[tuple[str, float, float, str]] = ()
    grid: Map | None = None
    ticks: Sequence[float] | None = None
    tick_names: Sequence[str] = ()
    rows: Sequence[str] = ()
    xlim: tuple[float | None, float | None] = (None, None)
    ylim: tuple[float | None, float | None] = (None, None)
    legend: bool = True
    theory: str = "theory"
    notes: list[str] = field(default_factory=list)
    footer: str = ""
    data: Any = None

    def __post_init__(self) -> None:
        one_of("scale", self.scale, SCALES)

    def __getitem__(self, label: str) -> Series:
        """Return the series of that label, or whose label begins so.

        Raises:
            ValueError: if there is none, or more than one.
        """
        result = [s for s in self.series if s.label == label] or [
            s for s in self.series if s.label.startswith(label)
        ]
        if len(result) != 1:
            raise invalid(
                "label", label, f"the beginning of exactly one of {[s.label for s in self.series]}"
            )
        return result[0]

    @property
    def drawn(self) -> bool:
        """True if there is something to draw."""
        return bool(self.series) or self.grid is not None

    def shown(self, also: Sequence[str] = ()) -> list[Series]:
        """Return the series that are drawn: six curves, and what is no curve of its own.

        Args:
            also: labels of those that are switched on as well.
        """
        first = [series for series in self.series if series.counts and not series.extra][:SIX]
        return [s for s in self.series if not s.counts or s.label in also or s in first]

    @property
    def others(self) -> list[str]:
        """Labels of the curves that are measured, and drawn only when they are switched on."""
        shown = self.shown()
        return [series.label for series in self.series if series not in shown]


def text(panels: Sequence[Panel]) -> str:
    """Return the key figures: the notes of every panel and of its series, in order."""
    lines: list[str] = []
    for panel in panels:
        lines += panel.notes + [series.note for series in panel.series if series.note]
    return "\n".join([*lines, *_switched_off(panels)])


def _switched_off(panels: Sequence[Panel], also: Sequence[str] = ()) -> list[str]:
    """Return lines that name the curves that are measured, but drawn nowhere or not everywhere."""
    hidden = dict.fromkeys(name for panel in panels for name in panel.others if name not in also)
    drawn = {series.label for panel in panels for series in panel.shown(also)}
    return [
        f"{words}: {'; '.join(names)}"
        for words, names in (
            ("measured, not drawn", [name for name in hidden if name not in drawn]),
            ("drawn in some of the panels only", [name for name in hidden if name in drawn]),
        )
        if names
    ]


# --- drawing --------------------------------------------------------------------------------------


def draw(
    panels: Sequence[Panel],
    *,
    title: str = "",
    columns: int = 0,
    height: float = 0.0,
    share_y: bool = False,
    also: Sequence[str] = (),
    narrow: bool = False,
    figure: Figure | None = None,
) -> Figure:
    """Draw the panels, two in a row; those of a last row that is not full are wider.

    Args:
        panels: what to draw; those of text alone are left out.
        title: over all of them.
        columns: panels in a row; 0 for one or two.
        height: of a row [inches]; 0 for what suits the number of columns.
        share_y: one y axis for a row.
        also: labels of the curves that are switched on, see `Panel.shown`.
        narrow: one panel below the other, half as wide, for a phone.
        figure: an empty figure to draw on; None for a new one of pyplot's.
    """
    import matplotlib as mpl

    shown = [panel for panel in panels if panel.drawn]
    # A narrow picture has the letters of a wide one, at half the width.
    across = 1 if narrow else columns or min(2, len(shown))
    rows = math.ceil(len(shown) / across)
    halves = 2 if narrow else across  # how often a panel fits into `WIDTH`
    if figure is None:
        import matplotlib.pyplot as plt

        figure = plt.figure(layout="constrained")
    wide = WIDTH / 2 if narrow else WIDTH
    figure.set_size_inches(wide, rows * (height or (3.6 if halves > 1 else 4.2)))
    with mpl.rc_context(
        {
            "font.size": NORMAL,
            "axes.titlesize": LARGE,
            "figure.titlesize": LARGE,
            "xtick.labelsize": TICKS,
            "ytick.labelsize": TICKS,
        }
    ):
        # The grid has as many columns as rows of both lengths can share, so that a short last row
        # is wider.
        last = len(shown) - across * (rows - 1)
        cells = figure.add_gridspec(rows, across * last)
        axes: list[Axes] = []
        for i in range(len(shown)):
            row, k = divmod(i, across)
            span = across if row == rows - 1 else last
            first = axes[row * across] if share_y and k else None
            place = cells[row, k * span : (k + 1) * span]
            axes.append(figure.add_subplot(place, sharey=first))
            axes[-1].tick_params(labelleft=first is None)
        every = [_draw_panel(*pair, also, halves) for pair in zip(axes, shown, strict=True)]
        for i, ax in enumerate(axes):
            # Inner labels are omitted where neighbours share them.
            if share_y and i % across:
                ax.set_ylabel("")
            if i + across < len(shown) and last == across and shown[i].x == shown[i + across].x:
                ax.set_xlabel("")
        # One colour bar for all maps, as they share their scale.
        maps = [(ax, p.grid) for ax, p in zip(axes, shown, strict=True) if p.grid]
        if maps:
            owners, label = [ax for ax, _ in maps], maps[0][1].label
            # Colours below the bound are left out of the bar where no map comes near them.
            above = min(float(log_values(grid).min()) for _, grid in maps) > -0.1 * REACH
            bar = figure.colorbar(
                owners[0].collections[0],
                ax=owners,
                extend="max" if above else "both",
                shrink=0.85,
            )
            if above:
                bar.ax.set_ylim(0.0, REACH)
                label = label.replace("purple below 1, orange above", "orange above 1")
            if label == maps[0][1].quantity:  # two sides only: its numbers would mean nothing
                bar.set_ticks([])
            bar.set_label(textwrap.fill(label, 44), fontsize=SMALL)
        if title:
            figure.suptitle(textwrap.fill(title, 48 if narrow else 96))
        footers = [panel.footer for panel in shown if panel.footer][:1]
        footers += _switched_off(shown, also)
        if footers:
            # Not a plain text: with the constrained layout this one gets its own space.
            small = "\n".join(textwrap.fill(line, 60 if narrow else 120) for line in footers)
            figure.supxlabel(small, x=0.01, ha="left", fontsize=SMALL, color="0.4")
        arrange(figure, every)
    return figure


def _draw_panel(ax: Axes, panel: Panel, also: Sequence[str], across: int) -> Words:
    log_x = panel.scale in ("log", "log x")
    if log_x:
        ax.set_xscale("log")
    if panel.scale in ("log", "log y"):
        ax.set_yscale("log")
    if panel.grid is not None:
        _draw_grid(ax, panel.grid)
    words = Words(ax)
    # Looks belong to all series, shown or not: switching one on does not recolour the others.
    looks, shown = _looks(panel), panel.shown(also)
    crosses: list[str] = []
    zeros = 0  # curves that reach zero on a logarithmic axis
    names: set[str] = set()
    for series in shown:
        colour, marker = looks[id(series)]
        if series.failed_at:
            # Large behind small: the crosses of two methods may stand at the same cost.
            _draw_crosses(ax, series.failed_at, colour, ax.get_xaxis_transform(), series.hollow)
        else:
            crosses += [colour] * series.failed
        if series.style == "bar":
            _draw_bars(ax, series, colour, 0.4 if names & {*series.y} else 0.75)
            names |= {*series.y}
        else:
            zeros += _draw_series(ax, series, colour, marker, log_x, zeros)
            _add_notes(words, series)
    if names:
        # Bars are read from the top down.
        ax.invert_yaxis()
        ax.tick_params(axis="y", labelleft=panel.ticks is None)
    # Without a cost of its own a failure is somewhere on the top edge.
    for k, colour in enumerate(crosses):
        share = 0.5 if len(crosses) == 1 else 0.03 + 0.94 * k / (len(crosses) - 1)
        _draw_crosses(ax, [share], colour, ax.transAxes)
    if panel.ticks and not names:
        names_at = list(panel.tick_names) or [f"{value:g}" for value in panel.ticks]
        # Many names don't fit side by side.
        slanted: dict[str, Any] = {"rotation": 35, "ha": "right", "rotation_mode": "anchor"}
        ax.set_xticks(panel.ticks, names_at, **(slanted if len(panel.tick_names) > 3 else {}))
        ax.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    if panel.rows:
        ax.set_yticks([-row for row in range(len(panel.rows))], list(panel.rows))
    if panel.xlim != (None, None):
        ax.set_xlim(*panel.xlim)
    if panel.ylim != (None, None):
        ax.set_ylim(*panel.ylim)
    if log_x and not panel.ticks:
        _few_labels(ax)
    if panel.scale == "log y":
        _plain_labels(ax)
    if panel.equal:
        ax.set_aspect("equal", adjustable="datalim")
    _draw_marks(ax, panel, words)
    if panel.grid is None:
        ax.grid(True, which="major", alpha=0.3, axis="x" if names else "both")
    boxed = panel.grid is not None or bool(names)
    handles, labels = ax.get_legend_handles_labels() if boxed and panel.legend else ([], [])
    # As many in a row as there is room for.
    per_row = max(1, 84 // across // (6 + max(map(len, labels), default=1)))
    if handles:
        box = ax.legend(
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            ncols=per_row,
            fontsize=SMALL,
            facecolor="0.8",
            framealpha=1.0 if panel.grid else 0.0,
            borderaxespad=0.3,
            edgecolor="none",
            handlelength=1.6,
            columnspacing=1.2,
        )
        # Out of the layout, which would shrink the axes by the height of the legend.
        box.set_in_layout(False)
    elif panel.legend and not boxed:
        _name_ends(words, panel, shown, looks)
    # The title stands above the legend, the failures' crosses and the names at the top.
    above = max(
        [
            0.3 + 1.1 * math.ceil(len(handles) / per_row)
            if handles
            else 0.4 * any(series.failed for series in shown),
            *(1 + one.text.get_text().count("\n") for one in words.top),
        ]
    )
    title = textwrap.fill(panel.title, 96 // across) if "\n" not in panel.title else panel.title
    room = 4.0 + above * 1.5 * SMALL + 3.0 * bool(words.top)  # [points]
    ax.set_title(title, loc="left", pad=room)
    ax.set(xlabel=textwrap.fill(panel.x, 88 // across), ylabel=textwrap.fill(panel.y, 40))
    return words


def _looks(panel: Panel) -> dict[int, tuple[str, str]]:
    """Return colour and marker of every series, whether it is shown or not."""
    taken = {KEYS[series.key][0] for series in panel.series if series.key}
    # Series without a key take colours that no keyed one has.
    free = [colour for colour in PALETTE if colour not in taken] or list(PALETTE)
    result, unkeyed = {}, 0
    for series in panel.series:
        if series.key:
            colour, marker = KEYS[series.key]
        else:
            colour, marker = free[unkeyed % len(free)], MARKERS[unkeyed % len(MARKERS)]
            unkeyed += 1
        result[id(series)] = colour, marker if series.marker is None else series.marker
    return result


def _draw_marks(ax: Axes, panel: Panel, words: Words) -> None:
    """Draw lines across and grey regions, with their names beside the axes."""
    for axis, low, high, name in panel.spans:
        (ax.axvspan if axis == "x" else ax.axhspan)(low, high, color="0.91", zorder=0)
        if name and panel.legend and axis == "x":
            words.above(
                name, math.sqrt(low * high) if ax.get_xscale() == "log" else (low + high) / 2
            )
        elif name and panel.legend:
            words.name(name, (1.0, high), ax.get_yaxis_transform(), "0.4")
    for axis, value, name in panel.lines:
        (ax.axvline if axis == "x" else ax.axhline)(value, color="0.3", ls=":", lw=1.2)
        if axis == "x" and name and panel.legend:
            words.above(name, value)
        elif name and panel.legend:
            words.name(name, (1.0, value), ax.get_yaxis_transform(), "0.3")


def _name_ends(
    words: Words, panel: Panel, shown: Sequence[Series], looks: dict[int, tuple[str, str]]
) -> None:
    """Names of the curves, each at the point furthest to the right that is seen."""
    ax = words.ax
    theory: tuple[Any, Any] | None = None
    for series in shown:
        colour, marker = looks[id(series)]
        x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
        if not series.label or not x.size:
            continue
        (left, right), (low, high) = sorted(ax.get_xlim()), sorted(ax.get_ylim())
        # The end of a curve is its rightmost point in view; one that is infinite is named at the
        # top edge.
        observed = (x >= left) & (x <= right) & (y >= low) & (y <= high)
        endless = np.flatnonzero(np.isposinf(y) & np.isfinite(x))
        at = ax.transData.transform(np.column_stack((x, np.where(observed, y, low))))[:, 0]
        of, end = ax.transData, np.array([x[0], y[0]])
        if observed.any():
            k = int(np.argmax(np.where(observed, at, -math.inf)))
            end = np.array([x[k], y[k]])
        elif endless.size:
            of, end = ax.get_xaxis_transform(), np.array([x[endless[-1]], 0.98])
        glyph = (HOLLOW if series.hollow else FILLED).get(marker) or STROKES.get(series.style, "")
        words.name(series.label, end, of, colour, glyph)
        if series.theory is not None:
            theory = end, of
    if theory is not None:
        words.name(panel.theory, *theory, "black", STROKES["-"])


def _add_notes(words: Words, series: Series) -> None:
    for word, x, y in zip(series.tags, series.x, series.y, strict=False):
        # An empty note would still take a free place from the others.
        if word and math.isfinite(x) and math.isfinite(y):
            words.note(word, x, y)


def _draw_series(
    ax: Axes, series: Series, colour: str, marker: str, log_x: bool, rank: int = 0
) -> int:
    """Draw a curve, and return whether it has zeros that a logarithmic axis cannot show.

    They become triangles at the lower edge, for each such curve a little higher than for the `rank`
    curves before.
    """
    from matplotlib.colors import to_rgb

    x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
    # Infinite values would break the line: they become triangles at the upper edge.
    vanished = (y == 0.0) & np.isfinite(x) & (ax.get_yscale() == "log")
    shown = np.isfinite(x) & np.isfinite(y) & ~vanished
    lines = series.style not in ("", "steps")
    size = series.size or (9.0 if series.hollow else 5.0 if lines else 6.0)
    ax.plot(
        x[shown],
        y[shown],
        color=colour,
        label=series.label if series.label and shown.any() else "_",
        linestyle={"": "none", "steps": "-"}.get(series.style, series.style),
        drawstyle="steps-post" if series.style == "steps" else "default",
        linewidth=3.0 if series.key == "yours" else series.width,
        marker=marker or None,
        # Of a long line a few points are marked, of points alone all.
        markevery=max(1, x.size // 8) if lines and x.size > 40 else None,
        markersize=size,
        markerfacecolor="none" if series.hollow else colour,
    )
    endless = np.isposinf(y)
    if endless.any():
        ax.plot(
            x[endless],
            np.full(int(np.sum(endless)), 0.98),
            linestyle="none",
            marker="^",
            color=colour,
            label="_" if shown.any() else series.label,
            markersize=11 if series.hollow else 7,
            markerfacecolor="none" if series.hollow else colour,
            transform=ax.get_xaxis_transform(),
        )
    if vanished.any():
        ax.plot(
            x[vanished],
            np.full(np.sum(vanished), 0.025 + 0.05 * rank),
            linestyle="none",
            marker="v",
            color=colour,
            label="_" if shown.any() else series.label,
            markersize=7,
            transform=ax.get_xaxis_transform(),
        )
    if series.key == "yours":
        # A ring on top: a right answer often lies exactly under the worked one.
        ax.plot(
            x[shown],
            y[shown],
            linestyle="none",
            marker="s",
            markersize=8,
            zorder=5,
            markerfacecolor="none",
            markeredgecolor=colour,
        )
    if series.low is not None and series.high is not None:
        low, high = np.asarray(series.low, dtype=float), np.asarray(series.high, dtype=float)
        if series.across:
            bars = np.abs(np.stack([x - low, high - x]))[:, shown]
            ax.errorbar(x[shown], y[shown], xerr=bars, fmt="none", ecolor=colour, lw=0.8)
        else:
            ax.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    if series.theory is not None and x.size:
        # Over many points only black is seen.
        dark = tuple((0.6 if x.size <= 40 else 0.0) * part for part in to_rgb(colour))
        ax.plot(*theory_line(series, 300, log_x), color=dark, linewidth=1.0, zorder=4)
    return int(vanished.any())


def _draw_crosses(
    ax: Axes, x: Sequence[float], colour: str, transform: Any, large: bool = False
) -> None:
    """Draw failed runs as crosses on the upper edge."""
    ax.plot(
        x,
        [1.0] * len(x),
        linestyle="none",
        marker="x",
        markersize=9 if large else 5,
        color=colour,
        transform=transform,
        clip_on=False,
        label="_",
    )


def _draw_bars(ax: Axes, series: Series, colour: str, height: float) -> None:
    names = [str(name) for name in series.y]
    ax.barh(names, series.x, height=height, color=colour, label=series.label or "_")
    ax.set_axisbelow(True)
    ends = np.asarray(series.x, dtype=float)
    if series.low is not None and series.high is not None:
        low, high = np.asarray(series.low, dtype=float), np.asarray(series.high, dtype=float)
        bars = np.maximum([ends - low, high - ends], 0.0)
        ax.errorbar(ends, names, xerr=bars, fmt="none", ecolor="0.15", lw=1.0, capsize=2.0)
        ends = np.maximum(ends, high)
    # A word stands to the right of its bar and of its error bar.
    for word, name, length in zip(series.tags, names, ends, strict=False):
        if not word:
            continue
        # On a log axis nothing has length 0: its word stands at the axis.
        where = ("data", "data") if length > 0.0 else ("axes fraction", "data")
        ax.annotate(
            word,
            (length, name),
            xycoords=where,
            fontsize=SMALL,
            va="center",
            xytext=(4, 0),
            textcoords="offset points",
        )


def _draw_grid(ax: Axes, grid: Map) -> None:
    # Purple below the bound, orange above: told apart by any colour vision.
    ax.pcolormesh(
        grid.x,
        grid.y,
        log_values(grid),
        cmap="PuOr_r",
        vmin=-REACH,
        vmax=REACH,
        shading="nearest",
        rasterized=True,
    )
    # The measured boundary as the contour between both classes, if both occur.
    within = grid.within()
    if within.any() and not within.all():
        ax.contour(
            grid.x, grid.y, within.astype(float), levels=[0.5], colors="black", linewidths=2.5
        )
        ax.plot([], [], color="black", linewidth=2.5, label=grid.edge)
    ax.set(xlim=(grid.x[0], grid.x[-1]), ylim=(grid.y[0], grid.y[-1]))


def log_values(grid: Map) -> Array:
    """Return decimal logarithm of a map's values, as far as the colours go."""
    # Values of zero or below have no logarithm; the colours end at REACH anyway.
    with np.errstate(divide="ignore"):
        return np.clip(np.log10(np.maximum(grid.values, 1e-300)), -REACH, REACH)


def theory_line(series: Series, points: int, logarithmic: bool) -> tuple[Array, Array]:
    """Return theory at `points` points between the first and the last x: (x, theory)."""
    assert series.theory is not None
    ends = float(np.min(series.x)), float(np.max(series.x))
    dense = np.geomspace(*ends, points) if logarithmic else np.linspace(*ends, points)
    return dense, np.array([float(series.theory(v)) for v in dense])


def _few_labels(ax: Axes) -> None:
    """Label only the minor ticks 2 and 5 of a short axis, where matplotlib's would overlap."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator

    low, high = ax.get_xlim()
    # Within less than two decades the decimal ticks alone are too few.
    if 0.6 < math.log10(high / low) < 1.7:
        ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        ax.xaxis.set_minor_formatter(
            LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(10.0, 10.0))
        )


def _plain_labels(ax: Axes) -> None:
    """Label a y axis of one to two decades with plain numbers: 2, 5, 10, 20."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    low, high = ax.get_ylim()
    if 0.6 < math.log10(high / low) < 2.0 and low >= 0.01:
        ax.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        for place in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
            place(FuncFormatter(lambda value, _: f"{value:g}"))


# --- files ----------------------------------------------------------------------------------------


def write(target: str | Path, content: str | Callable[[Path], Any]) -> Path:
    """Write a file whole or not at all: beside the target first, then renamed.

    Args:
        target: its path, whose folder is made if it isn't there.
        content: its text, or a function that writes into the path it is given.
    """
    path = Path(target)
    path.parent.mkdir(parents=True, exist_ok=True)
    # A file in the same folder is on the same file system, where a rename is atomic.
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    os.close(handle)
    try:
        if callable(content):
            content(Path(name))
        else:
            Path(name).write_text(content, encoding="utf-8")
        os.chmod(name, 0o644)  # mkstemp's files are private
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return path


def write_picture(figure: Figure, target: str | Path) -> Path:
    """Write a drawn figure as a PNG file."""
    return write(target, lambda path: figure.savefig(path, format="png", dpi=110))
