"""Numbers of a chart's data, by the name of the chart and steps into it, as `fields` describes."""

import functools
import math
import re
from typing import Any

import numpy as np

from course.check import invalid

_INNER = ("panels", "curves", "series", "points")
_NAMES = ("title", "label", "name")


def chart(path: str) -> float | str:
    """Return a number or a word from the data of a chart, by the steps above."""
    name, *steps = path.split("/")
    result = data = _data(name)
    for step in steps:
        result = _step(result, step, data, path)
    if isinstance(result, str):
        return result
    if isinstance(result, bool) or not isinstance(result, int | float):
        raise invalid("chart", path, f"steps to a number or a word, such as {_offered(result)}")
    return float(result)


@functools.cache
def _data(name: str) -> Any:
    from course.measure import data

    path = data.FOLDER / f"{name}.json"
    if not path.is_file():
        raise invalid("chart", name, "a chart with data (`make charts` builds them)")
    return data.from_json(path.read_text(encoding="utf-8"))


def _step(here: Any, step: str, data: Any, path: str) -> Any:
    column, at, place = step.partition("@")
    if isinstance(here, dict):
        if step in here:
            return here[step]
        if at and column in here:
            return _read_off(here, column, place, path)
        inner = next((here[key] for key in _INNER if key in here), None)
        if inner is not None:
            return _step([here] if step == "pick" and "points" in here else inner, step, data, path)
    elif isinstance(here, list):
        if re.fullmatch(r"-?\d+", step) and -len(here) <= int(step) < len(here):
            return here[int(step)]
        if step in ("min", "max") and here and not isinstance(here[0], dict):
            return {"min": min, "max": max}[step](here)
        entries = [entry for entry in here if isinstance(entry, dict)]
        if styled := [entry for entry in entries if entry.get("style") == step]:
            return styled
        if step == "pick" and (points := _good(entries, data)):
            return min(points, key=lambda point: float(point["time"]))
        names = [_name(entry) for entry in entries]
        begun = [i for i, n in enumerate(names) if n == step] or [
            i for i, n in enumerate(names) if n.startswith(step)
        ]
        if len(begun) == 1:
            return entries[begun[0]]
    raise invalid(f"step of {path}", step, _offered(here))


def _good(curves: list[Any], data: Any) -> list[dict[str, Any]]:
    limit = data.get("tolerance")
    return [
        {**point, "name": curve["name"]}
        for curve in curves
        for point in curve.get("points", ())
        if limit is not None and not point["failure"] and point["error"] <= limit
    ]


def _read_off(series: dict[str, Any], column: str, place: str, path: str) -> float:
    """Return a column at an x between its ends.

    With column "x" it returns where y first passes a number.
    """
    kind, _, place = place.rpartition("=")
    x, y = series["x"], series[kind if kind in series else "y"]
    if column != "x" and place in x:  # names instead of numbers
        return float(series[column][x.index(place)])
    try:
        desired = float(place)
        if column != "x":
            if min(x) <= desired <= max(x) and (np.diff(x) > 0).all():
                return float(np.interp(desired, x, series[column]))
            raise invalid(path, desired, f"an x from {min(x):g} to {max(x):g}, rising")
        deviation = np.asarray(y, dtype=float) - desired
    except (TypeError, ValueError) as problem:
        raise invalid(f"place of {path}", place, f"a number ({problem})") from None
    if math.isfinite(deviation[0]) and deviation[0] == 0.0:
        return float(x[0])
    passed = np.flatnonzero((deviation[:-1] < 0.0) != (deviation[1:] < 0.0))
    if not passed.size:
        raise invalid(path, desired, f"a y between {min(y):g} and {max(y):g}, which are passed")
    i = int(passed[0])
    return float(x[i] + (x[i + 1] - x[i]) * deviation[i] / (deviation[i] - deviation[i + 1]))


def _name(entry: dict[str, Any]) -> str:
    return next((str(entry[key]) for key in _NAMES if key in entry), "")


def _offered(here: Any) -> str:
    """Return what may stand behind this place, for a message."""
    if isinstance(here, dict):
        return ", ".join([*here, *(_offered(here[key]) for key in _INNER if key in here)])
    if not isinstance(here, list):
        return "nothing further"
    names = [_name(entry) for entry in here if isinstance(entry, dict)]
    return ", ".join([f"0 to {len(here) - 1}", *filter(None, names)])
