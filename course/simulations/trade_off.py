"""The tolerance of a work-precision chart as a control: what it picks, and what that costs.

    from course.simulations.trade_off import TradeOff

    TradeOff(accuracy.work_precision("pendulum"))

Dragging the slider (or the arrow keys on it) moves the tolerance over the chart, the pick goes
along, and a sentence says the price. The buttons switch on the curves that are not among the first
six.
"""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Sequence
from typing import Any

import ipywidgets
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from course.measure.figure import draw
from course.measure.work_precision import WorkPrecision

COSTS = ("count", "time")


class Chart:
    """The picture of a chart on which the tolerance moves; drawn once, then painted over.

    Args:
        measured: the chart, with a tolerance of its own.
        also: names of curves that are switched on.
    """

    def __init__(self, measured: WorkPrecision, also: Sequence[str] = ()) -> None:
        self.measured = measured
        self.figure = Figure(layout="constrained")
        self._canvas = FigureCanvasAgg(self.figure)
        panels = measured.panels(pick=False)
        labels = [name for name in panels[0].others if name.partition(",")[0] in also]
        draw(panels, height=4.2, also=labels, figure=self.figure)
        self._moving: list[Any] = []
        # Two artists move over each chart: the line of the tolerance and the ring around the pick.
        for ax in self.figure.axes:
            limits = ax.get_ylim()
            line = ax.axhline(limits[0], color="0.3", linestyle=":", linewidth=1.6, animated=True)
            (ring,) = ax.plot(
                [],
                [],
                marker="o",
                markersize=13,
                markerfacecolor="none",
                color="black",
                linestyle="none",
                animated=True,
            )
            ax.set_ylim(limits)
            self._moving.append((line, ring))
        # Animated artists are not part of the drawn figure: it is rendered once and saved as a
        # background (matplotlib's blitting).
        self._canvas.draw()
        self._empty = self._canvas.copy_from_bbox(self.figure.bbox)

    def png(self, tolerance: float) -> bytes:
        """Return the picture at a tolerance: its line, and a ring around each pick."""
        from PIL import Image

        # Restore the background, then draw the moving artists over it.
        self._canvas.restore_region(self._empty)
        for ax, by, (line, ring) in zip(self.figure.axes, COSTS, self._moving, strict=True):
            pick = self.measured.pick(tolerance, by)
            line.set_ydata([tolerance, tolerance])
            at = ([], []) if pick is None else ([pick.point.cost(by)], [pick.point.error])
            ring.set_data(*at)
            ax.draw_artist(line)
            ax.draw_artist(ring)
        buffer = io.BytesIO()
        Image.fromarray(np.asarray(self._canvas.buffer_rgba())).convert("RGB").save(buffer, "PNG")
        return buffer.getvalue()


class TradeOff(ipywidgets.VBox):
    """A work-precision chart whose tolerance is dragged.

    Args:
        measured: the chart; it needs a tolerance of its own to start from.
    """

    def __init__(self, measured: WorkPrecision) -> None:
        self.measured = measured
        low, high = measured.range()
        self.slider = ipywidgets.FloatLogSlider(
            value=measured.tolerance,
            base=10.0,
            min=math.log10(low),
            max=math.log10(high),
            step=0.05,
            readout_format=".1e",
            description=f"tolerance [{measured.error_unit}]",
            style={"description_width": "120px"},
            layout={"width": "98%"},
        )
        self.switches = {
            name: ipywidgets.ToggleButton(description=name, layout={"width": "auto"})
            for name in (curve.name for curve in measured.curves)
            if name not in measured.shown()
        }
        self.sentence = ipywidgets.HTML()
        self.picture = ipywidgets.Image(format="png", layout={"max_width": "100%"})
        self._redraw()
        self.slider.observe(lambda _: self._show(), "value")
        for switch in self.switches.values():
            switch.observe(lambda _: self._redraw(), "value")
        more = ipywidgets.Box(
            [ipywidgets.Label("also:"), *self.switches.values()],
            layout={"display": "flex", "flex_flow": "row wrap"},
        )
        rows = [self.picture, self.slider, self.sentence, *([more] if self.switches else [])]
        super().__init__(rows)
        self.add_class("course-trade-off")

    def _redraw(self) -> None:
        on = [name for name, switch in self.switches.items() if switch.value]
        self._chart = Chart(self.measured, on)
        self._show()

    def _show(self) -> None:
        tolerance = float(self.slider.value)
        self.picture.value = self._chart.png(tolerance)
        # One sentence for each cost, as the cheapest method depends on what is counted.
        words = (self.measured.price(tolerance, by) for by in ("time", "count"))
        self.sentence.value = "<br>".join(html.escape(line) for line in words)

    def __repr__(self) -> str:
        """Return the price in counts, which are the same on every machine."""
        return self.measured.price(float(self.slider.value), "count")

    def _repr_mimebundle_(self, **_options: Any) -> dict[str, Any]:
        return {
            "text/plain": repr(self),
            "image/png": base64.b64encode(self.picture.value).decode("ascii"),
            "application/vnd.jupyter.widget-view+json": {
                "version_major": 2,
                "version_minor": 0,
                "model_id": self.model_id,
            },
        }
