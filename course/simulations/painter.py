"""Pictures by matplotlib, as the browser draws them: what a saved notebook shows.

`to_png` is one picture, `film` a recording that moves without a kernel and without a script.
"""

import io
import itertools
import math
from typing import Any

import numpy as np
from matplotlib import patches
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox, IdentityTransform, ScaledTranslation, TransformedBbox
from numpy.typing import NDArray
from PIL import Image

from course.check import positive
from course.simulations import pen
from course.simulations.model import Experiment, Model
from course.simulations.pen import Picture, decode

# Farther away than this a point is drawn here, as in the browser.
_FAR = 1e7

# What is cut off may stand out of its rectangle by this much: half of a line [pixels].
_SLACK = 2.0

# Colours of a film; one more would not fit beside "unchanged" into six bits.
_COLOURS = 63

# More discs than this are a cloud of points, whose edges nobody compares.
_CLOUD = 100

# Room for one number below the picture, wide and high [pixels].
_CELL = (122.0, 44.0)

_ALIGN = {pen.LEFT: "left", pen.CENTRE: "center", pen.RIGHT: "right"}
_BASELINE = {pen.BOTTOM: "bottom", pen.MIDDLE: "center_baseline", pen.TOP: "top"}


def draw(picture: Picture, axes: Any) -> None:
    """Draw a picture on matplotlib axes."""
    paper = picture.paper
    xmin, xmax, ymin, ymax = paper.window
    axes.set_xlim(xmin, xmax)
    axes.set_ylim(ymin, ymax)
    axes.set_aspect("equal")
    axes.set_axis_off()
    figure = axes.figure
    # Points on paper for one pixel of the picture.
    size = axes.get_window_extent().width / figure.dpi * 72.0 / paper.width
    slack = _SLACK * (xmax - xmin) / paper.width
    cut = axes.bbox

    def colour(index: float) -> str:
        return "none" if index == pen.NONE else paper.colours.entries[int(index)]

    def shape(artist: Any) -> None:
        axes.add_patch(artist)
        artist.set_clip_box(cut)

    # Items are painted in their order, which matplotlib keeps by `zorder`.
    for order, item in enumerate(decode(picture)):
        points = np.clip(item.points, -_FAR, _FAR)
        if item.kind == pen.CUT:
            cut = axes.bbox
            if points.size:
                (left, low), (right, high) = points.T
                edges = Bbox.from_extents(left - slack, low - slack, right + slack, high + slack)
                cut = TransformedBbox(edges, axes.transData)
        elif item.kind == pen.LINE:
            ink, width, alpha, on, deviation = item.style
            # matplotlib multiplies dashes by the width of the line.
            style: Any = (0, (on / width, deviation / width)) if on else "-"
            (artist,) = axes.plot(
                *points,
                color=colour(ink),
                linewidth=max(width * size, 1e-6),
                linestyle=style,
                solid_capstyle="butt",
                solid_joinstyle="round",
                zorder=order,
                alpha=alpha,
            )
            artist.set_clip_box(cut)
        elif item.kind in (pen.POLYGON, pen.DISC):
            fill, edge, width, alpha = item.style[-4:]
            view = {
                "facecolor": colour(fill),
                "edgecolor": colour(edge),
                "linewidth": width * size,
                "zorder": order,
                "alpha": alpha,
            }
            if item.kind == pen.POLYGON:
                shape(patches.Polygon(points.T, closed=True, **view))
            elif points.shape[1] > _CLOUD:
                # One artist for all: one for each of ten thousand discs takes minutes.
                # Their centres are those of pixels, so that all look alike and compress well.
                across = 2.0 * item.style[0]
                pixels = np.floor(axes.transData.transform(points.T)) + 0.5
                where = {"offsets": pixels, "offset_transform": IdentityTransform()}
                discs = EllipseCollection(across, across, 0.0, units="xy", **where, **view)
                axes.add_collection(discs, autolim=False)
                discs.set_clip_box(cut)
            else:
                for x, y in points.T:
                    shape(patches.Circle((x, y), item.style[0], **view))
        elif item.kind == pen.ARROW:
            ink, width, head, alpha = item.style
            tail, tip = points.T
            distance = float(np.hypot(*(tip - tail)))
            if distance > 0.0:
                # The head is given in pixels, and is never longer than the arrow.
                long = min(head * (xmax - xmin) / paper.width, distance)
                back = long * (tip - tail) / distance
                side = 0.4 * np.array([-back[1], back[0]])
                (artist,) = axes.plot(
                    *zip(tail, tip - back, strict=True),
                    color=colour(ink),
                    alpha=alpha,
                    linewidth=width * size,
                    solid_capstyle="butt",
                    zorder=order,
                )
                artist.set_clip_box(cut)
                corners = [tip, tip - back + side, tip - back - side]
                shape(patches.Polygon(corners, color=colour(ink), lw=0, zorder=order, alpha=alpha))
        elif item.kind == pen.TEXT:
            x, y, ink, letters, align, baseline, right, up, turn, bold, alpha = item.style
            shift = ScaledTranslation(right * size / 72.0, up * size / 72.0, figure.dpi_scale_trans)
            axes.text(
                x,
                y,
                item.words,
                transform=axes.transData + shift,
                color=colour(ink),
                fontsize=letters * size * 0.94,
                ha=_ALIGN[align],
                va=_BASELINE[baseline],
                rotation=turn,
                rotation_mode="anchor" if turn else "default",
                zorder=order,
                fontweight="bold" if bold else "normal",
                parse_math=False,
                clip_on=False,
                alpha=alpha,
            )


def _page(picture: Picture, sharpness: float) -> FigureCanvasAgg:
    """Return a picture with its numbers below, `sharpness` dots for each pixel of the paper."""
    paper, numbers = picture.paper, picture.numbers
    xmin, xmax, ymin, ymax = paper.window
    width = paper.width
    drawn = width * (ymax - ymin) / (xmax - xmin)
    # Numbers stand in columns below the picture, as many as the width holds.
    columns = max(1, int((width - 16.0) // _CELL[0]))
    height = drawn + _CELL[1] * math.ceil(len(numbers) / columns)
    figure = Figure(figsize=(width / 100.0, height / 100.0), dpi=100.0 * sharpness)
    page = FigureCanvasAgg(figure)
    figure.set_facecolor(paper.background)
    draw(picture, figure.add_axes((0.0, 1.0 - drawn / height, 1.0, drawn / height)))
    grey, ink = paper.colours.entries[pen.GREY], paper.colours.entries[pen.INK]
    for k, (name, value) in enumerate(numbers.items()):
        x = (8.0 + _CELL[0] * (k % columns)) / width
        top = height - drawn - _CELL[1] * (k // columns)
        for words, below, colour, size in ((name, 2.0, grey, 11.0), (value, 17.0, ink, 14.0)):
            figure.text(
                x,
                (top - below) / height,
                words,
                color=colour,
                va="top",
                fontsize=0.68 * size,
                parse_math=False,
            )
    return page


def to_png(picture: Picture, sharpness: float = 1.5) -> bytes:
    """Return a picture and its numbers as a PNG, `sharpness` dots for each pixel of the paper.

    The same picture gives the same bytes.
    """
    buffer = io.BytesIO()
    _page(picture, sharpness).print_png(buffer, metadata={"Software": None})
    return buffer.getvalue()


def to_pixels(picture: Picture) -> NDArray[np.uint8]:
    """Return the picture as red, green and blue of each pixel, shape (height, width, 3)."""
    page = _page(picture, 1.0)
    page.draw()
    return np.asarray(page.buffer_rgba())[..., :3].copy()


def film(model: Model, seconds: float = 4.0, rate: float = 10.0) -> bytes:
    """Return the first preset of a model from its start, as an endless animated PNG.

    Args:
        model: the simulation.
        seconds: of the simulation, and of the film.
        rate: pictures per second.

    Returns:
        The file: 63 colours, and where a picture is like the one before, nothing.
    """
    count = max(2, round(positive("seconds", seconds, unit="s") * positive("rate", rate)))
    experiment = Experiment(model)
    experiment.choose(next(iter(model.presets)))
    pictures = []
    for _ in range(count):
        pictures.append(to_pixels(experiment.picture()))
        experiment.advance(1.0 / rate)
    # One palette for all, from some of them; its last place is for what has not changed.
    some = Image.fromarray(np.concatenate(pictures[:: max(1, count // 8)]))
    palette = some.quantize(_COLOURS, Image.Quantize.MAXCOVERAGE, 3, dither=Image.Dither.NONE)
    drawn = [
        np.asarray(Image.fromarray(p).quantize(palette=palette, dither=Image.Dither.NONE))
        for p in pictures
    ]
    # Pixels that did not change take the transparent colour: frames compress to their differences.
    changes = [np.where(a == b, _COLOURS, b) for a, b in itertools.pairwise(drawn)]
    frames = [Image.fromarray(numbers.astype(np.uint8), "P") for numbers in (drawn[0], *changes)]
    for frame in frames:
        frame.putpalette([*(palette.getpalette() or [])[: 3 * _COLOURS], 0, 0, 0])
        frame.info["transparency"] = _COLOURS
    buffer = io.BytesIO()
    # Each frame is blended over the one before and left there.
    frames[0].save(
        buffer,
        "PNG",
        save_all=True,
        append_images=frames[1:],
        duration=round(1000.0 / rate),
        loop=0,
        disposal=0,
        blend=1,
        transparency=_COLOURS,
        optimize=True,
    )
    return buffer.getvalue()
