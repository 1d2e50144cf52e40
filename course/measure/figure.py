"""Charts as data: an experiment gives panels of series, and one door draws, writes and says them.

A `Series` is what one method gave, a `Panel` what belongs on one pair of axes. From the panels come
the picture (`draw`), the data file (`document`) and the text of key figures (`text`). A method has
one colour and one marker in the whole course: the row of its key in `KEYS`.
"""

from __future__ import annotations

import json
import math
import os
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from course.check import one_of, refused

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from course.measure.stability import Map

Array = NDArray[np.float64]

# Okabe and Ito (2008), distinguishable with any colour vision; yellow is too pale for a thin line.
BLUE, VERMILION, GREEN, PINK = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
SKY, AMBER, GREY, PURPLE = "#56B4E9", "#E69F00", "#7F7F7F", "#5D3A9B"
BROWN, LIME, WINE = "#7A4B00", "#8FBC3B", "#882255"
PALETTE = (BLUE, VERMILION, GREEN, PINK, SKY, AMBER, GREY, PURPLE)
MARKERS = "osDv^P*X"

# Colour and marker of every method of the course, one row each. MuJoCo's Euler and RK4 are the
# course's semi-implicit Euler and RK4 and have their colours; an oracle's markers are hollow.
KEYS: dict[str, tuple[str, str]] = {
    # integrators
    "explicit_euler": (BLUE, "o"),
    "semi_implicit_euler": (VERMILION, "s"),
    "velocity_verlet": (GREEN, "D"),
    "explicit_midpoint": (PINK, "v"),
    "implicit_midpoint": (SKY, "^"),
    "rk4": (AMBER, "P"),
    "rk4_renormalised": (GREY, "*"),
    "MuJoCo Euler": (VERMILION, "s"),
    "MuJoCo Euler, eulerdamp off": (WINE, "p"),
    "MuJoCo RK4": (AMBER, "P"),
    "MuJoCo implicitfast": (PURPLE, "X"),
    "MuJoCo implicit": (BROWN, "d"),
    "MuJoCo discrete": (LIME, "h"),
    # contact
    "exact flight, impact times": (BLUE, "o"),
    "semi-implicit, impact times": (GREEN, "D"),
    "exact flight, end of step": (SKY, "^"),
    "semi-implicit, end of step": (PINK, "v"),
    "MuJoCo Euler (spring)": (WINE, "p"),
    "checked once a step": (BLUE, "o"),
    "event in the step": (GREEN, "^"),
    "MuJoCo, one-step contact": (VERMILION, "s"),
    "MuJoCo, default contact": (PURPLE, "o"),
    # quaternions
    "added": (VERMILION, "s"),
    "added and renormalised": (GREY, "*"),
    "exponential map": (AMBER, "P"),
    # engines
    "course": (BLUE, "o"),
    "mujoco.batch": (PURPLE, "X"),
    "closed form": (BLUE, "o"),
    "mujoco.batch, Euler": (VERMILION, "s"),
    "mujoco.batch, RK4": (AMBER, "P"),
    "mujoco.batch, implicitfast": (PURPLE, "X"),
    "processes": (GREEN, "D"),
    "loop": (PINK, "v"),
    "Gymnasium, loop": (SKY, "^"),
    "Gymnasium, processes": (WINE, "p"),
    "Gymnasium, loop, closed form": (GREY, "*"),
    # control
    "conditional integration": (BLUE, "o"),
    "no anti-windup": (VERMILION, "s"),
    "MuJoCo": (PURPLE, "X"),
    # kinematics
    "forward": (BLUE, "o"),
    "central": (VERMILION, "s"),
    "complex step": (GREEN, "D"),
    "autograd": (PINK, "v"),
    "analytic": (AMBER, "P"),
    "null space": (BLUE, "o"),
    "re-projected": (GREEN, "D"),
    "damped": (VERMILION, "s"),
    # drawn black
    "yours": ("black", "s"),
    "theory": ("black", ""),
    "theory on a map": ("white", ""),
    "chosen": ("black", "o"),
}

SCALES = ("linear", "log", "log x", "log y")


def key_of(name: str) -> str:
    """The key of a method's name: "MuJoCo RK4 (spring)" and "compiled rk4" find theirs, else ""."""
    plain = name.removeprefix("compiled ")
    for candidate in (plain, plain.partition(" (")[0], plain.partition(",")[0]):
        if candidate in KEYS:
            return candidate
    return ""


@dataclass
class Series:
    """What one method gave.

    Attributes:
        label: in the legend; empty for none.
        x, y: the points, shapes (n,); an infinite y is a triangle at the upper edge, a NaN is not
            drawn. For bars x holds the lengths and y their names.
        key: row of `KEYS`; empty for the next colour that nobody on the panel has.
        style: line as matplotlib's "-", "--", ":"; "" for markers alone, "steps", "bar".
        theory: x -> what y should be; drawn as a thin dark line, never used to measure.
        low, high: bounds of y, a band; of x where `across` is set, drawn as bars.
        note: a line of the chart's text.
        marker: None for the key's own, "" for none.
        hollow: markers drawn empty and large, so that others show through.
        width, size: of the line and the markers [points]; size 0 for the usual.
        tags: a word beside each point.
        failed: how many runs failed: crosses at the upper edge, where a cost is infinite.
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

    def __post_init__(self) -> None:
        if self.key and self.key not in KEYS:
            raise refused("key", self.key, f"one of {', '.join(KEYS)}")
        if len(self.x) != len(self.y):
            raise refused("len(y)", len(self.y), f"that of x, {len(self.x)}")

    @property
    def expected(self) -> Array:
        """Theory at every x, shape (n,)."""
        if self.theory is None:
            raise refused("theory", None, f"a function, which {self.label!r} has not")
        return np.array([float(self.theory(x)) for x in self.x])


@dataclass
class Panel:
    """What belongs on one pair of axes.

    Attributes:
        title, x, y: texts; a panel without series and grid is text alone.
        series: drawn in order.
        scale: one of `SCALES`.
        lines: straight lines across, ("x" or "y", value, words).
        spans: grey regions, ("x" or "y", low, high, words for the legend).
        grid: a quantity over x and y, drawn as a map with its measured boundary.
        ticks: the labelled values of x; for bars () leaves the names out.
        xlim, ylim: limits of the axes, either end None for matplotlib's.
        legend: matplotlib's place for it, "outside", or "" for none.
        theory: words for theory's line in the legend.
        notes: lines of the chart's text, before those of the series.
        footer: small print under the figure.
        data: what the data file holds in place of the series.
    """

    title: str
    x: str = ""
    y: str = ""
    series: list[Series] = field(default_factory=list)
    scale: str = "linear"
    lines: Sequence[tuple[str, float, str]] = ()
    spans: Sequence[tuple[str, float, float, str]] = ()
    grid: Map | None = None
    ticks: Sequence[float] | None = None
    xlim: tuple[float | None, float | None] = (None, None)
    ylim: tuple[float | None, float | None] = (None, None)
    legend: str = "best"
    theory: str = "theory"
    notes: list[str] = field(default_factory=list)
    footer: str = ""
    data: Any = None

    def __post_init__(self) -> None:
        one_of("scale", self.scale, SCALES)

    def __getitem__(self, label: str) -> Series:
        """The series of that label, or whose label begins so.

        Raises:
            ValueError: if there is none, or more than one.
        """
        found = [s for s in self.series if s.label == label] or [
            s for s in self.series if s.label.startswith(label)
        ]
        if len(found) != 1:
            raise refused(
                "label", label, f"the beginning of one of {[s.label for s in self.series]}"
            )
        return found[0]

    @property
    def drawn(self) -> bool:
        """Whether there is something to draw."""
        return bool(self.series) or self.grid is not None


def text(panels: Sequence[Panel]) -> str:
    """The key figures: the notes of every panel and of its series, in order."""
    lines: list[str] = []
    for panel in panels:
        lines += panel.notes + [series.note for series in panel.series if series.note]
    return "\n".join(lines)


# --- drawing --------------------------------------------------------------------------------------


def draw(
    panels: Sequence[Panel],
    *,
    title: str = "",
    columns: int = 0,
    size: tuple[float, float] | None = None,
    share_y: bool = False,
    figure: Figure | None = None,
) -> Figure:
    """Draw the panels side by side.

    Args:
        panels: what to draw; those of text alone are left out.
        title: over all of them.
        columns: panels in a row; 0 for all in one.
        size: width and height [inches]; None for what suits the number of panels.
        share_y: one y axis for a row.
        figure: an empty figure to draw on; None for a new one of pyplot's.
    """
    shown = [panel for panel in panels if panel.drawn]
    across = columns or len(shown)
    rows = math.ceil(len(shown) / across)
    if figure is None:
        import matplotlib.pyplot as plt

        width = {1: 8.0, 2: 12.0}.get(across, 4.4 * across)
        figure = plt.figure(figsize=size or (width, 4.8 * rows), layout="constrained")
    axes = figure.subplots(rows, across, squeeze=False, sharey=share_y)
    for i, (ax, panel) in enumerate(zip(axes.flat, shown, strict=False)):
        _draw_panel(ax, panel)
        if share_y and i % across:
            ax.set_ylabel("")
        if rows > 1 and i + across < len(shown):
            ax.set_xlabel("")
    maps = [
        (ax, panel.grid.label)
        for ax, panel in zip(axes.flat, shown, strict=False)
        if panel.grid is not None
    ]
    if maps:
        owners = [ax for ax, _ in maps]
        bar = figure.colorbar(owners[0].collections[0], ax=owners, extend="both", shrink=0.85)
        bar.set_label(maps[0][1], fontsize="small")
    if title:
        figure.suptitle(title)
    footers = [panel.footer for panel in shown if panel.footer]
    if footers:
        # Not a plain text: with the constrained layout this one gets its own space.
        figure.supxlabel(footers[0], x=0.01, ha="left", fontsize=6, color="0.4")
    return figure


def _draw_panel(ax: Axes, panel: Panel) -> None:
    if panel.scale in ("log", "log x"):
        ax.set_xscale("log")
    if panel.scale in ("log", "log y"):
        ax.set_yscale("log")
    if panel.grid is not None:
        _draw_grid(ax, panel.grid)
    for axis, low, high, words in panel.spans:
        (ax.axvspan if axis == "x" else ax.axhspan)(low, high, color="0.91", zorder=0, label=words)
    taken = {KEYS[series.key][0] for series in panel.series if series.key}
    free = [colour for colour in PALETTE if colour not in taken] or list(PALETTE)
    unkeyed, crosses = 0, []
    names: set[str] = set()
    for series in panel.series:
        if series.key:
            colour, marker = KEYS[series.key]
        else:
            colour, marker = free[unkeyed % len(free)], MARKERS[unkeyed % len(MARKERS)]
            unkeyed += 1
        crosses += [colour] * series.failed
        if series.style == "bar":
            _draw_bars(ax, series, colour, 0.4 if names & {*series.y} else 0.75)
            names |= {*series.y}
        else:
            own = marker if series.marker is None else series.marker
            _draw_series(ax, series, colour, own, panel.scale in ("log", "log x"))
    if names:
        ax.invert_yaxis()
        ax.tick_params(axis="y", labelleft=panel.ticks is None, labelsize="small")
    if any(series.theory for series in panel.series):
        ax.plot([], [], color="black", linewidth=1.0, label=panel.theory)
    # A failure costs infinitely much, so it has no place on a finite axis: the top edge.
    for k, colour in enumerate(crosses):
        share = 0.5 if len(crosses) == 1 else 0.03 + 0.94 * k / (len(crosses) - 1)
        ax.plot([share], [1.0], marker="x", markersize=7, color=colour, transform=ax.transAxes,
                clip_on=False)  # fmt: skip
    if panel.ticks and not names:
        ax.set_xticks(panel.ticks, [f"{value:g}" for value in panel.ticks])
        ax.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    ax.set(xlabel=panel.x, ylabel=panel.y, title=panel.title)
    if panel.xlim != (None, None):
        ax.set_xlim(*panel.xlim)
    if panel.ylim != (None, None):
        ax.set_ylim(*panel.ylim)
    if panel.scale in ("log", "log x") and not panel.ticks:
        _few_labels(ax)
    for i, (axis, value, words) in enumerate(panel.lines):
        _draw_line(ax, axis, value, words, 0.98 - 0.06 * i)
    if panel.grid is None:
        ax.grid(True, which="major", alpha=0.3, axis="x" if names else "both")
    if panel.legend and ax.get_legend_handles_labels()[0]:
        endless = any(not isinstance(y, str) and np.isposinf(y) for s in panel.series for y in s.y)
        room = (0.0, 0.0, 1.0, 0.96 if endless else 1.0)
        place: dict[str, Any] = {"loc": panel.legend, "bbox_to_anchor": room}
        if panel.legend == "outside":
            place = {"loc": "center left", "bbox_to_anchor": (1.02, 0.5)}
        ax.legend(fontsize="small", facecolor="white" if panel.grid is None else "0.8", **place)


def _draw_series(ax: Axes, series: Series, colour: str, marker: str, log_x: bool) -> None:
    from matplotlib.colors import to_rgb

    x, y = np.asarray(series.x, dtype=float), np.asarray(series.y, dtype=float)
    shown = np.isfinite(x) & np.isfinite(y)
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
        ax.plot(x[endless], np.full(np.sum(endless), 0.98), linestyle="none", marker="^",
                color=colour, label="_" if shown.any() else series.label, markersize=7,
                transform=ax.get_xaxis_transform())  # fmt: skip
    if series.key == "yours":
        # A ring on top: a right answer often lies exactly under the worked one.
        ax.plot(x[shown], y[shown], linestyle="none", marker="s", markersize=8, zorder=5,
                markerfacecolor="none", markeredgecolor=colour)  # fmt: skip
    if series.low is not None and series.high is not None:
        low, high = np.asarray(series.low, dtype=float), np.asarray(series.high, dtype=float)
        if series.across:
            bars = np.abs(np.stack([x - low, high - x]))[:, shown]
            ax.errorbar(x[shown], y[shown], xerr=bars, fmt="none", ecolor=colour, lw=0.8)
        else:
            ax.fill_between(x, low, high, color=colour, alpha=0.2, linewidth=0)
    if series.theory is not None and x.size:
        ends = float(np.min(x)), float(np.max(x))
        dense = np.geomspace(*ends, 300) if log_x else np.linspace(*ends, 300)
        # Over many points only black is seen.
        dark = tuple((0.6 if x.size <= 40 else 0.0) * part for part in to_rgb(colour))
        ax.plot(dense, [series.theory(v) for v in dense], color=dark, linewidth=1.0, zorder=4)
    for word, a, b in zip(series.tags, x, y, strict=False):
        if math.isfinite(a) and math.isfinite(b):
            offset = (8, -12) if series.key == "chosen" else (4, 3)
            ax.annotate(word, (a, b), fontsize=7, xytext=offset, textcoords="offset points")


def _draw_bars(ax: Axes, series: Series, colour: str, height: float) -> None:
    names = [str(name) for name in series.y]
    ax.barh(names, series.x, height=height, color=colour, label=series.label or "_")
    ax.set_axisbelow(True)
    for word, name, length in zip(series.tags, names, series.x, strict=False):
        # On a log axis nothing has length 0: its word stands at the axis.
        where = ("data", "data") if length > 0.0 else ("axes fraction", "data")
        ax.annotate(word, (length, name), xycoords=where, fontsize="small", va="center",
                    xytext=(4, 0), textcoords="offset points")  # fmt: skip


def _draw_grid(ax: Axes, grid: Map) -> None:
    with np.errstate(divide="ignore"):
        shown = np.clip(np.log10(np.maximum(grid.values, 1e-300)), -0.5, 0.5)
    # Purple below the bound, orange above: told apart by any colour vision.
    ax.pcolormesh(grid.x, grid.y, shown, cmap="PuOr_r", vmin=-0.5, vmax=0.5, shading="nearest",
                  rasterized=True)  # fmt: skip
    within = grid.within()
    if within.any() and not within.all():
        ax.contour(grid.x, grid.y, within.astype(float), levels=[0.5], colors="black",
                   linewidths=2.5)  # fmt: skip
        ax.plot([], [], color="black", linewidth=2.5, label="measured")
    ax.set(xlim=(grid.x[0], grid.x[-1]), ylim=(grid.y[0], grid.y[-1]))


def _draw_line(ax: Axes, axis: str, value: float, words: str, height: float) -> None:
    if axis == "x":
        ax.axvline(value, color="0.3", linestyle=":", linewidth=1.2)
        ax.annotate(words, (value, height), xycoords=("data", "axes fraction"), fontsize=7,
                    va="top", xytext=(2, 0), textcoords="offset points")  # fmt: skip
    else:
        ax.axhline(value, color="0.3", linestyle=":", linewidth=1.2)
        ax.annotate(words, (0.01, value), xycoords=("axes fraction", "data"), fontsize=7,
                    va="top")  # fmt: skip


def _few_labels(ax: Axes) -> None:
    """On a short axis matplotlib labels most minor ticks, one over the other: 2 and 5 do."""
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator

    low, high = ax.get_xlim()
    if 0.6 < math.log10(high / low) < 1.7:
        ax.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        ax.xaxis.set_minor_formatter(
            LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(10.0, 10.0))
        )


# --- files ----------------------------------------------------------------------------------------


def document(panels: Sequence[Panel]) -> Any:
    """What a data file holds: every panel with its series, numbers to six digits.

    Of a curve of more than 200 points every second, third, ... is kept.
    """
    for panel in panels:
        if panel.data is not None:
            return panel.data
    return {"panels": [_panel_document(panel) for panel in panels if panel.drawn]}


def _panel_document(panel: Panel) -> dict[str, Any]:
    found: dict[str, Any] = {"title": panel.title, "x": panel.x, "y": panel.y}
    if panel.grid is not None:
        grid = panel.grid
        found["grid"] = {"x": _six(grid.x), "y": _six(grid.y), "boundary": _six(grid.boundary())}
    found["series"] = [_series_document(series) for series in panel.series]
    return found


def _series_document(series: Series) -> dict[str, Any]:
    few = slice(None, None, math.ceil(len(series.x) / 200) or 1)
    columns = {"x": series.x, "y": series.y, "low": series.low, "high": series.high}
    columns["theory"] = series.expected if series.theory else None
    found: dict[str, Any] = {"label": series.label, "key": series.key, "failed": series.failed}
    return found | {k: _six(v[few]) for k, v in columns.items() if v is not None}


def _six(values: Any) -> list[Any]:
    return [v if isinstance(v, str) else float(f"{v:.6g}") for v in values]


def json_text(data: Any) -> str:
    """Valid JSON, a list of numbers on one line; what is not finite becomes {"float": "inf"}."""
    found = json.dumps(_plain(data), indent=1, allow_nan=False)
    lists = re.compile(r"\[[^\[\]{}\"]*\]")
    return lists.sub(lambda match: " ".join(match[0].split()), found) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return {"float": repr(value)}
    return value


def from_json(content: str) -> Any:
    """What `json_text` wrote."""

    def number(found: dict[str, Any]) -> Any:
        return float(found["float"]) if set(found) == {"float"} else found

    return json.loads(content, object_hook=number)


def write(target: str | Path, content: str | Callable[[Path], Any]) -> Path:
    """Write a file whole or not at all: beside the target first, then renamed.

    Args:
        target: its path, whose folder is made if it isn't there.
        content: its text, or a function that writes into the path it is given.
    """
    path = Path(target)
    path.parent.mkdir(parents=True, exist_ok=True)
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
    return write(
        target, lambda path: figure.savefig(path, format="png", dpi=110, bbox_inches="tight")
    )
