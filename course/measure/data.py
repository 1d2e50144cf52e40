"""The data behind a chart as a file: what was measured, and all that is needed to draw it again."""

from __future__ import annotations

import base64
import json
import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np

from course.measure.figure import REACH, Array, Panel, Series, log_values, theory_line
from course.measure.stability import Map

# Data and key figures of every chart, as they were measured last.
FOLDER = Path(__file__).resolve().parents[1] / "charts" / "data"


def document(panels: Sequence[Panel]) -> Any:
    """Return what a data file holds: all that is drawn, numbers to six digits.

    Of a line of more than 200 points no more are kept, of points alone all. `panels_of` gives the
    panels back, so that a picture is drawn anew without measuring.
    """
    # Data that a panel brings along is more complete than what is drawn of it.
    for panel in panels:
        if panel.data is not None:
            return panel.data
    return {"panels": [_panel_document(panel) for panel in panels if panel.drawn]}


def _panel_document(panel: Panel) -> dict[str, Any]:
    result = _fields_of(panel, "series", "grid", "notes", "data")
    # A map stores its colours instead of its values, with the boundary in numbers.
    if panel.grid is not None:
        grid = panel.grid
        numbers = {"x": grid.x, "y": grid.y, "boundary": grid.boundary()}
        texts = {"quantity": grid.quantity, "unit": grid.unit, "edge": grid.edge}
        result["grid"] = texts | {"values": _packed(grid)}
        result["grid"] |= {name: _six(values) for name, values in numbers.items()}
    log_x = panel.scale in ("log", "log x")
    result["series"] = [_series_document(series, log_x) for series in panel.series]
    return result


def _series_document(series: Series, log_x: bool) -> dict[str, Any]:
    size = len(series.x)
    # Evenly as they are seen.
    even = np.geomspace(1, size, 200) - 1 if log_x else np.linspace(0, size - 1, 200)
    thinned = size > 200 and series.style != ""
    few = np.unique(even.round().astype(int)).tolist() if thinned else range(size)
    columns = {"x": series.x, "y": series.y, "low": series.low, "high": series.high}
    columns["theory"] = series.expected if series.theory else None
    result: dict[str, Any] = {"label": series.label, "key": series.key}
    result |= _fields_of(series, *columns, "note")
    result |= {k: _six([v[i] for i in few]) for k, v in columns.items() if v is not None}
    # Theory is a function, which a file cannot hold: it becomes a polyline.
    if series.theory is not None:
        x, y = theory_line(series, 60, log_x)
        result["line"] = {"x": _six(x), "y": _six(y)}
    return result


def _fields_of(record: Panel | Series, *but: str) -> dict[str, Any]:
    """Return a record's fields that differ from their defaults, without the excluded ones."""
    return {
        f.name: getattr(record, f.name)
        for f in fields(record)
        if f.name not in but and getattr(record, f.name) != f.default
        if f.default_factory is MISSING
    }


def panels_of(data: Any) -> list[Panel]:
    """Return the panels of a data file, as `document` wrote it and `from_json` read it."""
    result = []
    for entry in data["panels"]:
        text = {k: v for k, v in entry.items() if k not in ("series", "grid")}
        text |= {k: tuple(text[k]) for k in ("xlim", "ylim") if k in text}
        text |= {k: [tuple(row) for row in text[k]] for k in ("lines", "spans") if k in text}
        grid = _unpacked(entry["grid"]) if "grid" in entry else None
        result.append(Panel(**text, grid=grid, series=[_series_of(s) for s in entry["series"]]))
    return result


def _series_of(entry: dict[str, Any]) -> Series:
    text = {k: v for k, v in entry.items() if k not in ("theory", "line")}
    if "line" not in entry:
        return Series(**text)
    x, y = entry["line"]["x"], entry["line"]["y"]
    return Series(**text, theory=lambda value: float(np.interp(value, x, y)))


# A map is drawn in 256 steps: below 128 it is within its bound.
def _packed(grid: Map) -> str:
    # Both sides of the bound get 128 steps each, so that rounding cannot move a point across it.
    size = np.abs(log_values(grid)) / REACH
    step = np.where(grid.within(), 127.0 - np.floor(127.0 * size), 128.0 + np.floor(127.0 * size))
    return base64.b85encode(zlib.compress(step.astype(np.uint8).tobytes(), 9)).decode("ascii")


def _unpacked(entry: dict[str, Any]) -> Map:
    x, y = np.array(entry["x"]), np.array(entry["y"])
    step = np.frombuffer(zlib.decompress(base64.b85decode(entry["values"])), dtype=np.uint8)
    values: Array = np.power(10.0, REACH * (step.reshape(y.size, x.size) - 127.5) / 127.5)
    texts = {name: entry[name] for name in ("quantity", "unit", "edge") if name in entry}
    return Map(x, y, values, **texts)


def _six(values: Any) -> list[Any]:
    return [v if isinstance(v, str) else float(f"{v:.6g}") for v in values]


def json_text(data: Any) -> str:
    """Return valid JSON, with a list of numbers on one line.

    A number that is not finite becomes {"float": "inf"}.
    """
    result = json.dumps(_plain(data), indent=1, allow_nan=False)
    lists = re.compile(r"\[[^\[\]{}\"]*\]")
    return lists.sub(lambda match: " ".join(match[0].split()), result) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        # JSON has no infinity and no NaN.
        return {"float": repr(value)}
    return value


def from_json(content: str) -> Any:
    """Return what `json_text` wrote."""

    def number(result: dict[str, Any]) -> Any:
        return float(result["float"]) if set(result) == {"float"} else result

    return json.loads(content, object_hook=number)
