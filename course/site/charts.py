"""The charts of a page as a phone shows them: one panel below the other, as SVG.

A wide picture (`docs/charts/NAME.png`) shrinks to half on a phone, and its letters with it. So
each chart is drawn once more from its data (`course/charts/data`), as narrow as a phone. What
was drawn stays in `CACHE`, under a name that depends on all that it was drawn from.
"""

import functools
import gc
import hashlib
import io
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from course import charts
from course.site.notebooks import ROOT

CACHE = ROOT / "build" / "charts"


@functools.cache
def _drawn_with() -> bytes:
    """Return a hash of the code that draws."""
    import matplotlib

    state = hashlib.sha256(matplotlib.__version__.encode())
    # The code that draws belongs to the name, so that a change of it draws all pictures again.
    for path in (Path(__file__), *charts.DRAWN_BY):
        state.update(path.read_bytes())
    return state.digest()


def cached(name: str) -> Path:
    """Return where the narrow picture of a chart is kept, whether it has been drawn or not."""
    state = hashlib.sha256(_drawn_with() + (charts.FOLDER / f"{name}.json").read_bytes())
    return CACHE / f"{name}-{state.hexdigest()[:16]}.svg"


def svg(name: str) -> str:
    """Return the narrow picture of a chart.

    Args:
        name: of a chart with stored data.

    Raises:
        ValueError: there are no such data.
    """
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    # Letters are paths: no page has to have the font, and no word is wider than where it was put.
    # Without a salt of its own each file would have other ids. A title whose height is given is not
    # moved over labels at the top, which no chart has: to look for them takes a tenth of the time.
    with mpl.rc_context({"svg.fonttype": "path", "svg.hashsalt": name, "axes.titley": 1.0}):
        drawn = charts.narrow_figure(name, Figure(layout="constrained"))
        drawn.set_layout_engine("none")  # it has been laid out; a second time costs as much again
        buffer = io.StringIO()
        # `savefig` would draw everything once before, only to know what it covers.
        FigureCanvasSVG(drawn).print_svg(buffer, metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def _draw_much() -> None:
    """Prepare a process that draws one picture after the other.

    A picture is many small objects that refer to each other. To search for garbage as often as
    Python does takes a quarter of the time; here it is searched for about once a picture.
    """
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401

    gc.freeze()  # what has been imported stays
    gc.set_threshold(200_000)
    if hasattr(os, "nice"):
        os.nice(5)  # Sphinx, one process, takes as long as all charts: it goes first


def narrow(name: str) -> str:
    """Return the narrow picture of a chart, drawn now if it was not drawn before."""
    path = cached(name)
    if not path.is_file():
        # Pictures that were drawn from older data or code are removed.
        for old in CACHE.glob(f"{name}-{'[0-9a-f]' * 16}.svg"):
            old.unlink(missing_ok=True)
        charts.write(path, svg(name))
    return path.read_text(encoding="utf-8")


@contextmanager
def pictures(names: Iterable[str]) -> Iterator[Iterator[tuple[str, str]]]:
    """The narrow picture of each chart, (name, SVG), drawn beside whatever else is done meanwhile.

    Args:
        names: of charts with stored data.
    """
    ordered = sorted(set(names))
    # Only what is missing goes to the workers.
    missing = [name for name in ordered if not cached(name).is_file()]
    with ProcessPoolExecutor(mp_context=get_context("spawn"), initializer=_draw_much) as pool:
        drawn = {name: pool.submit(narrow, name) for name in missing}
        yield ((name, drawn[name].result() if name in drawn else narrow(name)) for name in ordered)
