"""The simulation of chapter 1 in a real browser: JupyterLab, its kernel, headless Chromium.

The page is opened as `make lab` opens it, on a screen of 1280 x 800, and as a document. Prints when
something moves, how long a slider takes to change the picture and how many pictures a second arrive
while it is dragged. With COURSE_SCREENSHOTS=1 it keeps pictures of the page under docs/screenshots.
"""

import importlib.util
import json
import os
import secrets
import signal
import socket
import statistics
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nbformat
import pytest

from course.simulations.rigid_body import MODEL
from tests.conftest import chromium

pytestmark = [pytest.mark.browser, pytest.mark.slow]

ROOT = Path(__file__).resolve().parents[2]
CHAPTER = ROOT / "notebooks" / "01_rigid_body.ipynb"
EXTENSION = "tools.lab_extension"

FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]

SETTINGS = {
    "@jupyterlab/apputils-extension:notification": {"fetchNews": "false", "checkForUpdates": False},
    "@jupyterlab/notebook-extension:tracker": {"windowingMode": "none"},
}
# An installed package may bring an extension that "needs a build": no dialogue about that.
PAGE = {"buildCheck": False, "buildAvailable": False}

# The picture: a checksum of the pixels of the canvas, and the number of the frame it shows.
PIXELS = """canvas => {
  const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
  let sum = 0, dark = 0;
  for (let k = 0; k < data.length; k += 4) {
    const value = data[k] + 256 * data[k + 1] + 65536 * data[k + 2];
    sum = (sum * 31 + value) % 4294967291;
    dark += data[k] + data[k + 1] + data[k + 2] < 600;
  }
  return {sum, share: 4 * dark / data.length, frame: Number(canvas.dataset.frame)};
}"""

# Notes from the opening on what shows the simulation: its film, the live picture, or nothing.
SHOWN = """
window.shown = [];
const look = () => {
  const film = [...document.querySelectorAll('.jp-Notebook img')].some(image =>
    image.alt === TITLE && image.naturalWidth && image.getBoundingClientRect().height > 99);
  const live = [...document.querySelectorAll('canvas.course-canvas')].some(c => c.dataset.frame);
  const now = (film ? 'film ' : '') + (live ? 'live' : '');
  if (window.shown.at(-1)?.[1] !== now) window.shown.push([performance.now() / 1000, now]);
  requestAnimationFrame(look);
};
requestAnimationFrame(look);
"""

# Where picture, controls and words of the first panel are: made so wide if a number is given.
PLACES = """wide => {
  const panel = document.querySelector('.course-simulation');
  panel.style.width = wide ? wide + 'px' : '';
  const box = place => place.getBoundingClientRect();
  const [picture, slider] = [box(panel.querySelector('canvas')),
                             box(panel.querySelector('.widget-slider'))];
  const ink = document.createElement('canvas').getContext('2d');
  const cut = [...panel.querySelectorAll('.widget-label')]
    .filter(label => label.scrollWidth > label.clientWidth).map(label => label.innerText);
  for (const menu of panel.querySelectorAll('select')) {
    ink.font = getComputedStyle(menu).font;
    cut.push(...[...menu.options].map(option => option.innerText)
      .filter(words => ink.measureText(words).width > menu.clientWidth - 24)); // its arrow
  }
  return {row: slider.left >= picture.right && slider.top < picture.bottom, high: box(panel).height,
          wide: box(panel).width, picture: picture.width, cut};
}"""

# The labels of every panel of the page that do not fit into their columns.
CUT = """() => [...document.querySelectorAll('.course-simulation .widget-label')]
  .filter(label => label.clientWidth && label.scrollWidth > label.clientWidth)
  .map(label => label.innerText)"""

# Notes when the browser has drawn each frame, and when each key came in.
WATCH = """canvas => {
  window.drawn = [];
  window.inputs = [];
  new MutationObserver(() => window.drawn.push(performance.now()))
    .observe(canvas, {attributes: true, attributeFilter: ['data-frame']});
  document.addEventListener('keydown', () => window.inputs.push(performance.now()), true);
}"""


def notebook(path: Path) -> None:
    """The chapter's notebook without outputs; its film is part of the text."""
    content = nbformat.read(CHAPTER, as_version=4)
    for cell in content.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    # Without the name of a kernel JupyterLab asks for one.
    content.metadata["kernelspec"] = {
        "name": "python3",
        "display_name": "Python 3",
        "language": "python",
    }
    nbformat.write(content, path)


@contextmanager
def jupyter_lab(folder: Path, extension: bool) -> Iterator[str]:
    """A JupyterLab server of its own on the folder; its address, with the token."""
    config = folder / "config"
    (config / "labconfig").mkdir(parents=True, exist_ok=True)
    (config / "labconfig" / "default_setting_overrides.json").write_text(json.dumps(SETTINGS))
    (config / "labconfig" / "page_config.json").write_text(json.dumps(PAGE))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    token = secrets.token_hex(16)
    options = [f"--ServerApp.jpserver_extensions={{'{EXTENSION}': True}}"] if extension else []
    environment = os.environ | {
        "JUPYTER_CONFIG_DIR": str(config),
        "JUPYTER_DATA_DIR": str(folder / "data"),
        "JUPYTER_RUNTIME_DIR": str(folder / "runtime"),
        "IPYTHONDIR": str(folder / "ipython"),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "COURSE_QUIET": "1",
        # As in nbval: the checks of the claims run in the tests of the claims.
        "COURSE_CLAIMS": "recorded",
    }
    with (folder / "server.log").open("w") as log:
        server = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "jupyterlab",
                "--no-browser",
                "--allow-root",
                f"--ServerApp.root_dir={folder}",
                "--ServerApp.ip=127.0.0.1",
                f"--ServerApp.port={port}",
                "--ServerApp.port_retries=0",
                f"--IdentityProvider.token={token}",
                "--LabApp.expose_app_in_browser=True",
                *options,
            ],
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        address = f"http://127.0.0.1:{port}"
        try:
            wait_for_server(server, f"{address}/api/status?token={token}", folder / "server.log")
            yield f"{address}/{{}}/tree/{CHAPTER.name}?token={token}&reset"
        finally:
            os.killpg(server.pid, signal.SIGINT)
            try:
                server.wait(timeout=5)
            except subprocess.TimeoutExpired:
                os.killpg(server.pid, signal.SIGKILL)
                server.wait()


def wait_for_server(server: subprocess.Popen[Any], address: str, log: Path) -> None:
    end = time.monotonic() + 90
    while time.monotonic() < end:
        assert server.poll() is None, f"JupyterLab ended:\n{log.read_text()[-2000:]}"
        try:
            with urllib.request.urlopen(address, timeout=5):
                return
        except (urllib.error.URLError, TimeoutError, ConnectionError):
            time.sleep(0.2)
    raise AssertionError(f"JupyterLab did not start in 90 s:\n{log.read_text()[-2000:]}")


@contextmanager
def open_page(profile: Path) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            str(profile),
            executable_path=chromium(),
            args=FLAGS,
            headless=True,
            viewport={"width": 1280, "height": 800},
            timeout=60_000,
        )
        try:
            page = context.pages[0] if context.pages else context.new_page()
            page.set_default_timeout(60_000)
            page.add_init_script(SHOWN.replace("TITLE", json.dumps(MODEL.title)))
            yield page
        finally:
            context.close()


def open_notebook(page: Any, address: str) -> float:
    """Open the notebook and wait for its kernel; when its film was seen, after the opening [s]."""
    page.goto(address, wait_until="domcontentloaded")
    page.wait_for_function(
        """() => {
          const shell = window.jupyterapp?.shell;
          window.panel = shell ? [...shell.widgets('main')].find(w => w.sessionContext) : null;
          return window.panel?.sessionContext?.session?.kernel?.status === 'idle';
        }"""
    )
    page.evaluate("() => window.jupyterapp.shell.activateById(window.panel.id)")
    page.wait_for_function("() => window.shown.some(([when, what]) => what === 'film ')")
    return page.evaluate("() => window.shown.find(([when, what]) => what)[0]")


def run_all_cells(page: Any) -> None:
    """Run all cells. Fails at the first cell that does."""
    page.evaluate("() => window.jupyterapp.commands.execute('notebook:run-all-cells')")
    errors = page.evaluate(
        """async patience => {
          const panel = window.panel;
          const kernel = panel.sessionContext.session.kernel;
          const cells = panel.content.model.sharedModel.cells.filter(c => c.cell_type == 'code');
          const runnable = cells.filter(c => c.source.trim());
          const watched = cells.filter(c => !c.metadata.tags?.includes('raises-exception'));
          const errors = () => watched.flatMap(c =>
            c.outputs.filter(o => o.output_type === 'error').map(o => o.ename + ': ' + o.evalue));
          const end = performance.now() + 1000 * patience;
          while (kernel.status !== 'idle' || runnable.some(c => !c.execution_count)) {
            // What follows a cell that failed is never run.
            if (errors().length) break;
            if (performance.now() > end) return [`not done after ${patience} s`];
            await new Promise(done => setTimeout(done, 100));
          }
          return errors();
        }""",
        900,
    )
    assert errors == []


def run_notebook(page: Any) -> Any:
    """Run all cells; the canvas of the simulation."""
    run_all_cells(page)
    canvas = page.locator("canvas.course-canvas").first
    canvas.wait_for()
    canvas.scroll_into_view_if_needed()
    page.wait_for_function("c => c.dataset.frame", arg=canvas.element_handle())
    return canvas


def run_simulation(page: Any) -> None:
    """Run the cell of the simulation; the kernel has run those before it."""
    page.evaluate(
        """async () => {
          const notebook = window.panel.content;
          notebook.activeCellIndex = notebook.widgets.findIndex(
            c => c.model.type === 'code' && c.model.sharedModel.source.startsWith('simulation('));
          await window.jupyterapp.commands.execute('notebook:run-cell');
        }"""
    )
    page.locator("canvas.course-canvas[data-frame]").first.wait_for()


def wait_for_frame(page: Any, canvas: Any, after: int) -> dict[str, Any]:
    page.wait_for_function(
        "([c, n]) => Number(c.dataset.frame) > n", arg=[canvas.element_handle(), after]
    )
    return canvas.evaluate(PIXELS)


def wait_for_change(page: Any, canvas: Any, before: dict[str, Any]) -> dict[str, Any]:
    """Wait for a picture that is another one; a frame may draw the same again."""
    deadline = time.monotonic() + 60.0
    while (now := canvas.evaluate(PIXELS))["sum"] == before["sum"]:
        assert time.monotonic() < deadline, "the picture stays the same"
        page.wait_for_timeout(20)
    return now


def numbers_of(page: Any) -> str:
    return page.locator(".course-simulation .course-numbers").first.inner_text()


def slider(page: Any, label: str) -> Any:
    row = page.locator(".course-simulation .widget-slider", has_text=label).first
    return row.locator(".noUi-handle")


def measure_latency(page: Any, canvas: Any, handle: Any, times: int = 15) -> list[float]:
    """Milliseconds from the key to the drawn picture, one key at a time."""
    handle.focus()
    result = []
    for k in range(times):
        before = canvas.evaluate("c => Number(c.dataset.frame)")
        page.evaluate("() => { window.drawn.length = 0; window.inputs.length = 0; }")
        handle.press("ArrowLeft" if k % 2 else "ArrowRight")
        wait_for_frame(page, canvas, before)
        result.append(page.evaluate("() => window.drawn[0] - window.inputs[0]"))
        page.wait_for_timeout(60)
    return result


def measure_drag(page: Any, handle: Any) -> tuple[float, float]:
    """Pictures and mouse moves per second while the handle is dragged to and fro for two seconds.

    The moves are made in the page, one per animation frame, as a real mouse makes them; from
    outside each would wait until the page has answered the last one.
    """
    result = handle.evaluate(
        """async handle => {
          const box = handle.getBoundingClientRect();
          const [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
          const send = (target, kind, shift) => target.dispatchEvent(new MouseEvent(kind, {
            bubbles: true, cancelable: true, button: 0, buttons: kind === 'mouseup' ? 0 : 1,
            clientX: x + shift, clientY: y}));
          send(handle.firstElementChild, 'mousedown', 0);
          window.drawn.length = 0;
          const start = performance.now();
          let moves = 0;
          // Two seconds; longer only where the machine did not get to three pictures in them.
          const due = () => performance.now() - start < (window.drawn.length < 3 ? 60000 : 2000);
          while (due()) {
            moves += 1;
            send(document.documentElement, 'mousemove', 2 * Math.abs(moves % 40 - 20) - 20);
            await new Promise(requestAnimationFrame);
          }
          if (window.drawn.length < 3) throw new Error('no pictures while the handle is dragged');
          const seconds = (performance.now() - start) / 1000;
          const rates = [window.drawn.length / seconds, moves / seconds];
          send(document.documentElement, 'mouseup', 0);
          return rates;
        }"""
    )
    page.wait_for_timeout(300)
    return result[0], result[1]


def save_screenshot(page: Any, name: str) -> None:
    if os.environ.get("COURSE_SCREENSHOTS") == "1":
        folder = ROOT / "docs" / "screenshots"
        folder.mkdir(parents=True, exist_ok=True)
        page.locator(".course-simulation").first.screenshot(path=str(folder / name))


def look_at_the_page(page: Any) -> None:
    """Picture and controls are beside each other and on one screen, and no word is cut."""
    for wide in (0, 700):
        result = page.evaluate(PLACES, wide)
        assert result["row"] and result["high"] < 700, result
        assert result["cut"] == [] and result["picture"] > 0.55 * result["wide"], result
    page.evaluate(PLACES, 0)


def exercise(page: Any, canvas: Any) -> tuple[float, float, float, float]:
    """Everything a reader does with the simulation; median and worst latency, two rates."""
    first, words = canvas.evaluate(PIXELS), numbers_of(page)
    assert first["share"] > 0.01, "the canvas is blank"
    label = canvas.get_attribute("aria-label")
    assert "0.000 s" in words and "time 0.000 s" in label and "kinetic" in label
    save_screenshot(page, "rigid_body_start.png")

    # A key on a slider: another picture, other numbers.
    gravity = slider(page, "Gravity")
    gravity.focus()
    gravity.press("ArrowRight")
    wait_for_change(page, canvas, first)
    page.wait_for_function(
        "old => document.querySelector('.course-numbers').innerText !== old", arg=words
    )
    assert canvas.get_attribute("aria-label") != label

    canvas.evaluate(WATCH)
    latencies = measure_latency(page, canvas, gravity)
    pictures, moves = measure_drag(page, gravity)

    # Reset and play: time runs and the box moves; pause: it stands still.
    words = numbers_of(page)
    before = canvas.evaluate(PIXELS)
    page.get_by_role("button", name="Play").first.click()
    wait_for_frame(page, canvas, before["frame"] + 15)
    page.wait_for_timeout(700)
    moving = canvas.evaluate(PIXELS)
    assert moving["sum"] != before["sum"]
    assert numbers_of(page) != words
    save_screenshot(page, "rigid_body_playing.png")
    page.get_by_role("button", name="Pause").first.click()
    page.get_by_role("button", name="Play").first.wait_for()
    # Pictures that were under way may still come, but they end.
    still: Any = None
    deadline = time.monotonic() + 60.0
    while still != (still := canvas.evaluate(PIXELS)):
        assert time.monotonic() < deadline, "it runs on"
        page.wait_for_timeout(500)

    # A preset, the pointer on the picture, and keys on the picture.
    page.locator(".course-simulation select").first.select_option("Explicit Euler gains energy")
    third = wait_for_change(page, canvas, still)
    assert "explicit Euler" not in words
    box = canvas.bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.4 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.3 * box["height"], steps=4)
    page.mouse.up()
    wait_for_change(page, canvas, third)
    canvas.press(" ")
    page.get_by_role("button", name="Pause").first.wait_for()
    page.wait_for_timeout(2500)
    save_screenshot(page, "rigid_body_explicit_euler.png")
    canvas.press(" ")
    page.get_by_role("button", name="Play").first.wait_for()
    return statistics.median(latencies), max(latencies), pictures, moves


def drag_the_tolerance(page: Any) -> None:
    """Keys and the mouse move the tolerance of the live chart; pick and price go along."""
    place = page.locator(".course-trade-off").first
    place.scroll_into_view_if_needed()
    words, handle = place.locator(".widget-html-content").first, place.locator(".noUi-handle").first
    changed = "([words, old]) => words.innerText !== old"
    before = words.inner_text()
    assert "simulated s" in before
    handle.focus()
    for _ in range(30):
        handle.press("ArrowLeft")
    page.wait_for_function(changed, arg=[words.element_handle(), before])
    before, box = words.inner_text(), handle.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    page.mouse.down()
    page.mouse.move(0.0, box["y"] + 0.5 * box["height"], steps=8)
    page.mouse.up()
    page.wait_for_function(changed, arg=[words.element_handle(), before])
    page.wait_for_function(
        "words => words.innerText.includes('Nothing here')", arg=words.element_handle()
    )


def test_chapter_1_in_the_browser(tmp_path, capsys):
    available = importlib.util.find_spec(EXTENSION) is not None
    compare = os.environ.get("COURSE_COMPARE_NAGLE") == "1"
    for extension in [False, True] if available and compare else [available]:
        folder = tmp_path / f"extension_{extension}"
        folder.mkdir()
        notebook(folder / CHAPTER.name)
        with jupyter_lab(folder, extension) as address, open_page(folder / "profile") as page:
            opened = open_notebook(page, address.format("lab"))
            canvas = run_notebook(page)
            observed = [what for _, what in page.evaluate("() => window.shown")]
            assert observed[observed.index("film ") :] == ["film ", "live"], "the picture was away"
            look_at_the_page(page)
            assert page.evaluate(CUT) == []
            median, worst, pictures, moves = exercise(page, canvas)
            drag_the_tolerance(page)
            # As a document; another view of the notebook has the same kernel.
            open_notebook(page, address.format("doc"))
            run_simulation(page)
            look_at_the_page(page)
        with capsys.disabled():
            print(
                f"\nbrowser ({'Nagle off' if extension else 'stock server'}): film after "
                f"{opened:.1f} s; slider to picture {median:.0f} ms (median), "
                f"{worst:.0f} ms (worst); {pictures:.0f} pictures/s while dragging "
                f"({moves:.0f} mouse moves/s)"
            )
        assert pictures > 0.0
