"""The charts of the course and the data behind them: `python -m course.charts [name ...]`.

Each chart is a function that measures, writes `docs/charts/NAME.png` with `docs/charts/NAME.json`
beside it, and returns the text of its key figures, which is kept as `docs/charts/NAME.txt`.
"""

import functools
import importlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from course.check import refused

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "charts"

Chart = Callable[[], str]
CHARTS: dict[str, Chart] = {}


def chart(function: Chart) -> Chart:
    """Register a chart under its function's name; its text is written when it is built."""

    @functools.wraps(function)
    def build() -> str:
        text = function()
        FOLDER.mkdir(parents=True, exist_ok=True)
        _replace(
            FOLDER / f"{function.__name__}.txt",
            lambda path: path.write_text(text + "\n", encoding="utf-8"),
        )
        return text

    CHARTS[function.__name__] = build
    return build


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


def save(name: str, figure: "Figure", data: Any) -> None:
    """Write the picture and its data, each whole or not at all.

    Args:
        name: file name without ending.
        figure: the drawn figure; it is closed.
        data: what the figure shows, as JSON takes it.
    """
    import matplotlib.pyplot as plt

    FOLDER.mkdir(parents=True, exist_ok=True)
    text = json.dumps(data, indent=1, allow_nan=True) + "\n"
    _replace(FOLDER / f"{name}.json", lambda path: path.write_text(text, encoding="utf-8"))
    _replace(
        FOLDER / f"{name}.png",
        lambda path: figure.savefig(path, format="png", dpi=110, bbox_inches="tight"),
    )
    plt.close(figure)


def _replace(target: Path, write: Callable[[Path], Any]) -> None:
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=target.name, suffix=".part")
    os.close(handle)
    try:
        write(Path(name))
        os.chmod(name, 0o644)
        os.replace(name, target)
    except BaseException:
        Path(name).unlink()
        raise
