"""A slider in JupyterLab: how long until the picture, from the kernel and in the page.

Both ways with the kernel idle and with a kernel that computes something else meanwhile.
"""

import statistics
from pathlib import Path
from typing import Any

import pytest

from course.simulations import declaration
from tests.notebooks.test_browser import (
    CHAPTER,
    WATCH,
    jupyter_lab,
    measure_latency,
    notebook,
    open_notebook,
    open_page,
    slider,
)

pytestmark = pytest.mark.browser

TIMES = 12
# What a cell does meanwhile: a loop in Python, beside which another thread of the kernel answers
# the widgets, and one long call that lets no other thread in, as in many a library [a few s].
LOOP = "import time\nend = time.monotonic() + 4.0\nwhile time.monotonic() < end: pass"
# Before the call, the kernel has the time to tell that it is busy.
CALL = "import time\ntime.sleep(0.2)\nsum(range(200_000_000))"


def busy(page: Any, code: str) -> None:
    """The kernel computes for a while; returns at once."""
    page.evaluate(
        "code => { window.panel.sessionContext.session.kernel.requestExecute({code}); }", code
    )
    page.wait_for_function("() => window.panel.sessionContext.session.kernel.status === 'busy'")
    page.wait_for_timeout(300)


def in_the_page(page: Any, canvas: Any) -> list[float]:
    """Milliseconds from the key to the drawn picture, the page running the simulation."""
    canvas.evaluate(WATCH)
    handle = page.locator(".course-live [data-control=gravity]")
    return measure_latency(page, canvas, handle, TIMES)


def test_a_picture_in_the_page_waits_for_no_kernel(tmp_path: Path, capsys: Any) -> None:
    assert declaration.is_live("rigid_body.bouncing_box")
    notebook(tmp_path / CHAPTER.name)
    with jupyter_lab(tmp_path, True) as address, open_page(tmp_path / "profile") as page:
        open_notebook(page, address.format("lab"))
        first_cells(page)
        canvas = page.locator("canvas.course-canvas[data-frame]").first
        canvas.evaluate(WATCH)
        result = {"kernel idle": measure_latency(page, canvas, slider(page, "Gravity"), TIMES)}
        for where, code in (("in a loop", LOOP), ("in a call", CALL)):
            busy(page, code)
            times = TIMES if code == LOOP else 1
            waits = measure_latency(page, canvas, slider(page, "Gravity"), times)
            result[f"kernel {where}"] = waits
            idle(page)
        page.get_by_label("runs in this page").check()
        page.wait_for_selector(".course-live[data-ready] canvas[data-frame]")
        canvas = page.locator(".course-live canvas")
        result["page, kernel idle"] = in_the_page(page, canvas)
        busy(page, CALL)
        result["page, kernel in a call"] = in_the_page(page, canvas)
        # The kernel goes on from where the page has come to.
        idle(page)
        words = page.locator(".course-live .course-numbers").inner_text()
        page.get_by_label("runs in this page").uncheck()
        page.wait_for_function(
            "words => document.querySelector('.course-numbers').innerText === words", arg=words
        )
    median = {where: statistics.median(waits) for where, waits in result.items()}
    with capsys.disabled():
        message = "; ".join(f"{where} {wait:.0f} ms" for where, wait in median.items())
        print(f"\nslider to picture: {message}")
    assert median["kernel in a call"] > 500.0, "the kernel was not busy"
    assert median["page, kernel in a call"] < 0.2 * median["kernel in a call"]
    assert median["page, kernel idle"] < median["kernel idle"]


def idle(page: Any) -> None:
    page.wait_for_function("() => window.panel.sessionContext.session.kernel.status === 'idle'")


def first_cells(page: Any) -> None:
    """Run the cells up to the first simulation."""
    page.evaluate(
        """async () => {
          const notebook = window.panel.content;
          for (const [k, cell] of notebook.widgets.entries()) {
            if (cell.model.type !== 'code') continue;
            notebook.activeCellIndex = k;
            await window.jupyterapp.commands.execute('notebook:run-cell');
            if (cell.model.sharedModel.source.trim().startsWith('simulation(')) return;
          }
        }"""
    )
    page.locator("canvas.course-canvas[data-frame]").first.wait_for()
