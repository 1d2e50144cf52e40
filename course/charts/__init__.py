"""The charts of the course and the data behind them: `python -m course.charts [name ...]`.

Each chart is an experiment, a generator function decorated with `chart` that measures and yields
panels (see `course.measure.figure`). From them come the data and the key figures, `data/NAME.json`
and `data/NAME.txt` of this package, and a picture, `docs/charts/NAME.png` of the project. A test
calls the same experiment with smaller sizes, by `build`, and looks at the series.
"""

import functools
import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from course.check import invalid, one_of
from course.measure import colours, data, figure, labels
from course.measure.data import FOLDER, document, from_json, json_text, panels_of
from course.measure.figure import Panel, draw, text, write, write_picture
from course.measure.work_precision import WorkPrecision

# The files whose code draws a picture from its data.
DRAWN_BY = tuple(Path(module.__file__ or "") for module in (figure, colours, labels, data))
PICTURES = Path(__file__).resolve().parents[2] / "docs" / "charts"

Experiment = Callable[..., Iterator[Panel]]
CHARTS: dict[str, tuple[Experiment, dict[str, Any]]] = {}


def chart(experiment: Experiment | None = None, *, name: str = "", **layout: Any) -> Any:
    """Register an experiment as a chart; the function stays as it is.

    Args:
        experiment: a generator of panels that runs without arguments.
        name: of the chart; default: the function's.
        **layout: of the whole figure, see `course.measure.figure.draw`.
    """
    if experiment is None:
        return functools.partial(chart, name=name, **layout)
    CHARTS[name or experiment.__name__] = experiment, layout
    return experiment


def build(name: str, **sizes: Any) -> list[Panel]:
    """Run the experiment of a chart and give its panels; nothing is drawn or written.

    Args:
        name: of the chart.
        **sizes: arguments of the experiment, smaller ones than its own in a test.
    """
    return list(_known(name)[0](**sizes))


def make(name: str) -> str:
    """Measure a chart in full, write picture, data and text, and return the text."""
    panels = build(name)
    if any(panel.drawn for panel in panels):
        _write_picture(name, panels)
        write(FOLDER / f"{name}.json", json_text(document(panels)))
    result = text(panels)
    write(FOLDER / f"{name}.txt", result + "\n")
    return result


def stored(name: str) -> list[Panel]:
    """Return the panels of a chart as they were measured last, from its data; without their notes.

    Raises:
        ValueError: for a chart that has no data.
    """
    path = FOLDER / f"{name}.json"
    if not path.is_file():
        drawn = sorted(p.stem for p in FOLDER.glob("*.json"))
        raise invalid("name", name, f"{', '.join(drawn) or 'none'} (`make charts` builds them)")
    contents = from_json(path.read_text(encoding="utf-8"))
    return WorkPrecision.from_json(path).panels() if "curves" in contents else panels_of(contents)


def redraw(name: str) -> None:
    """Draw the picture of a chart anew from its data; nothing is measured."""
    _write_picture(name, stored(name))


def narrow_figure(name: str, canvas: Any) -> Any:
    """Draw a chart from its data as narrow as a phone, one panel below the other.

    Args:
        name: of a chart with stored data.
        canvas: an empty matplotlib figure, which is filled and returned.

    Raises:
        ValueError: there are no such data.
    """
    return draw(stored(name), narrow=True, figure=canvas)


def _write_picture(name: str, panels: list[Panel]) -> None:
    from matplotlib.figure import Figure

    figure = draw(panels, figure=Figure(layout="constrained"), **_known(name)[1])
    write_picture(figure, PICTURES / f"{name}.png")


def _known(name: str) -> tuple[Experiment, dict[str, Any]]:
    load()
    return CHARTS[one_of("name", name, sorted(CHARTS))]


def load() -> None:
    """Import every module of this folder, so that all charts are registered."""
    folder = Path(__file__).parent
    for path in sorted(folder.rglob("[a-z]*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        importlib.import_module(".".join(("course.charts", *parts)))


def read(name: str) -> str:
    """Return the key figures of a chart as they were when it was last built.

    Args:
        name: name of the chart.

    Raises:
        ValueError: for a chart that has not been built.
    """
    path = FOLDER / f"{name}.txt"
    if not path.is_file():
        known = sorted(p.stem for p in FOLDER.glob("*.txt"))
        raise invalid("name", name, f"{', '.join(known) or 'none'} (`make charts` builds them)")
    return path.read_text(encoding="utf-8").rstrip("\n")
