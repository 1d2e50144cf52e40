"""The charts of the course and the data behind them: `python -m course.charts [name ...]`.

Each chart is an experiment, a generator function decorated with `chart` that measures and yields
panels (see `course.measure.figure`). From them come `docs/charts/NAME.png`, the data behind it in
`NAME.json`, and the text of its key figures in `NAME.txt`. A test calls the same experiment with
smaller sizes, by `build`, and looks at the series.
"""

import functools
import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from course.check import one_of, refused
from course.measure.figure import Panel, document, draw, json_text, text, write, write_picture

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "charts"

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
        import matplotlib.pyplot as plt

        figure = draw(panels, **_known(name)[1])
        write_picture(figure, FOLDER / f"{name}.png")
        plt.close(figure)
        write(FOLDER / f"{name}.json", json_text(document(panels)))
    found = text(panels)
    write(FOLDER / f"{name}.txt", found + "\n")
    return found


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
    """The key figures of a chart as they were when it was last built.

    Args:
        name: name of the chart.

    Raises:
        ValueError: for a chart that has not been built.
    """
    path = FOLDER / f"{name}.txt"
    if not path.is_file():
        known = sorted(p.stem for p in FOLDER.glob("*.txt"))
        raise refused("name", name, f"{', '.join(known) or 'none'} (`make charts` builds them)")
    return path.read_text(encoding="utf-8").rstrip("\n")
