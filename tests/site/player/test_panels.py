"""The panels of all simulations in Chromium: nothing is cut, and a page has its own colours.

A finger that moves up or down scrolls the page where nothing is dragged that way.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from course.simulations import declaration as told
from tests.budget import PROVE, sampled
from tests.conftest import chromium

pytestmark = [pytest.mark.browser, pytest.mark.slow]

WIDTHS = (390, 1024, 1280, 1440)
# As a page of the site has it: its column is 46em wide at most.
PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>A page</title>
<meta name="viewport" content="width=device-width">
<body style="margin:1rem;font:16px/1.5 sans-serif"><div style="max-width:46em">
<div class="course-live" data-simulation="{name}"></div></div>
<div style="height:3000px"></div>
<script src="live.js"></script><script src="bundle.js"></script></body></html>"""

# Words of a panel that do not fit into what holds them, or reach out of the panel.
CLIPPED = """() => {
  const panel = document.querySelector('.course-live');
  const edge = panel.getBoundingClientRect().right;
  const cut = [];
  const holders = panel.querySelectorAll(
    'label, .named > *, button, .title, .note, .quiet, .course-numbers div');
  for (const each of holders) {
    if (each.clientWidth && each.scrollWidth > each.clientWidth + 1) cut.push(each.textContent);
    if (each.getBoundingClientRect().right > edge + 1) cut.push(`${each.textContent} (outside)`);
  }
  const ink = document.createElement('canvas').getContext('2d');
  for (const menu of panel.querySelectorAll('select')) {
    ink.font = getComputedStyle(menu).font;
    for (const option of menu.options)
      if (ink.measureText(option.textContent).width > menu.clientWidth - 24) // its arrow
        cut.push(option.textContent);
  }
  // A label stands above its slider.
  for (const slider of panel.querySelectorAll('input[type=range]')) {
    const words = slider.closest('label').querySelector('.named').getBoundingClientRect();
    if (words.bottom > slider.getBoundingClientRect().top + 1)
      cut.push(`beside: ${slider.ariaLabel}`);
  }
  return cut;
}"""
# How light the pixels of a picture are: the median, and the share of those that differ from it.
LIGHT = """canvas => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const all = [];
  for (let k = 0; k < data.length; k += 4) all.push((data[k] + data[k + 1] + data[k + 2]) / 765);
  const sorted = [...all].sort((a, b) => a - b);
  const median = sorted[sorted.length >> 1];
  return [median, all.filter(v => Math.abs(v - median) > 0.15).length / all.length];
}"""
FRAME = "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--disable-quic"]
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=chromium(), args=flags)
        yield made
        made.close()


def opened(
    browser: Any, folder: Path, name: str, wide: int = 1280, before: str = "", **options: Any
) -> Any:
    (folder / "live.js").write_text(told.script(), encoding="utf-8")
    (folder / "bundle.js").write_text(told.bundle(name), encoding="utf-8")
    if not told.is_live(name):
        (folder / f"{name}.film.js").write_text(told.film(name), encoding="utf-8")
    (folder / "index.html").write_text(PAGE.format(name=name), encoding="utf-8")
    page = browser.new_context(viewport={"width": wide, "height": 800}, **options).new_page()
    page.set_default_timeout(60_000)
    if before:
        page.add_init_script(before)
    page.goto((folder / "index.html").as_uri())
    page.wait_for_selector("[data-ready] canvas[data-frame]")
    return page


# Keeps where the words of a picture stand and where short level strokes are: samples of a legend.
DRAWN = """
const all = CanvasRenderingContext2D.prototype;
const [fill, text, begin, move, line, stroke] =
  [all.fillRect, all.fillText, all.beginPath, all.moveTo, all.lineTo, all.stroke];
let points = [];
all.fillRect = function (...given) {
  [this.canvas.words, this.canvas.samples] = [[], []];
  fill.apply(this, given);
};
all.fillText = function (words, ...given) {
  const [at, size] = [this.getTransform(), this.measureText(words)];
  const [left, right] = [size.actualBoundingBoxLeft, size.actualBoundingBoxRight];
  const high = parseFloat(this.font.replace('bold ', '')) / 2;
  if (Math.abs(at.b) < 1e-9)
    this.canvas.words.push([words, at.e - at.a * left, at.e + at.a * right, at.f, high]);
  text.call(this, words, ...given);
};
all.beginPath = function () { points = []; begin.call(this); };
all.moveTo = function (x, y) { points.push([x, y]); move.call(this, x, y); };
all.lineTo = function (x, y) { points.push([x, y]); line.call(this, x, y); };
all.stroke = function () {
  if (points.length === 2 && points[0][1] === points[1][1]) {
    const [a, b] = [points[0][0], points[1][0]].sort((x, y) => x - y);
    if (b - a < 0.036 * this.canvas.width) this.canvas.samples.push([a, b, points[0][1]]);
  }
  stroke.call(this);
};
"""
# The words that a sample of a legend strikes through.
STRUCK = """() => {
  const { words, samples } = document.querySelector('canvas');
  return words.filter(([, left, right, y, high]) => samples.some(([a, b, at]) =>
    a < right - 1 && left < b - 1 && Math.abs(at - y) < high / 2)).map(([text]) => text);
}"""


@pytest.mark.parametrize("name", sampled(told.names(), 8))
def test_words_are_whole_and_free_of_legends(browser: Any, tmp_path: Path, name: str) -> None:
    page = opened(browser, tmp_path, name, 1280, before=DRAWN)
    # The widest and the narrowest; those between them in the long tier.
    for wide in sorted(WIDTHS if PROVE else (WIDTHS[0], WIDTHS[-1]), reverse=True):
        page.set_viewport_size({"width": wide, "height": 800})
        page.evaluate(FRAME)
        assert page.evaluate(CLIPPED) == [], wide
        assert page.evaluate(STRUCK) == [], wide
    # On a phone, the last and narrowest, each preset's own picture.
    menu = page.get_by_label("Preset")
    for preset in menu.locator("option").all_inner_texts():
        menu.select_option(preset)
        page.evaluate(FRAME)
        assert page.evaluate(STRUCK) == [], preset
    page.context.close()


@pytest.mark.prove
def test_a_word_that_is_struck_through_is_found(browser: Any, tmp_path: Path) -> None:
    page = opened(browser, tmp_path, "rigid_body.spring", before=DRAWN)
    page.evaluate("""() => {
      const canvas = document.querySelector('canvas');
      const [, left, right, y] = canvas.words[0];
      canvas.samples.push([(left + right) / 2 - 5, (left + right) / 2 + 5, y]);
    }""")
    assert len(page.evaluate(STRUCK)) == 1
    page.context.close()


def test_a_label_that_is_cut_is_found(browser: Any, tmp_path: Path) -> None:
    page = opened(browser, tmp_path, "rigid_body.bouncing_box")
    style = ".course-live .named > * { width: 20px; white-space: nowrap; flex: none; }"
    page.add_style_tag(content=style)
    assert len(page.evaluate(CLIPPED)) >= 5
    page.context.close()


def test_a_number_says_what_it_means(browser: Any, tmp_path: Path) -> None:
    name = "rigid_body.spring"
    page, meanings = opened(browser, tmp_path, name), told.model(name).readouts
    cells = page.locator(".course-numbers > div")
    titles = cells.evaluate_all("all => all.map(c => [c.children[0].textContent, c.title])")
    assert titles == [[each, meanings[each]] for each, _ in titles] and len(titles) == 5
    cells.nth(2).click()
    note = page.locator(".course-meaning")
    assert note.inner_text() == f"determinant: {meanings['determinant']}"
    cells.nth(2).click()
    assert note.inner_text() == ""
    page.context.close()


@pytest.mark.prove
def test_a_picture_is_dark_where_the_page_is(browser: Any, tmp_path: Path) -> None:
    """By the system, by Furo's attribute and by JupyterLab's, at once and both ways."""
    page = opened(browser, tmp_path, "rigid_body.spring", color_scheme="dark")
    canvas = page.locator("canvas")

    def dark() -> bool:
        page.evaluate(FRAME)
        median, ink = canvas.evaluate(LIGHT)
        assert ink > 0.01, "something is drawn on it"
        assert median < 0.15 or median > 0.95
        return median < 0.15

    assert dark()
    for attribute, value, expected in (
        ("theme", "light", False),
        ("theme", "dark", True),
        ("theme", "auto", True),
        ("jpThemeLight", "true", False),
        ("jpThemeLight", "false", True),
    ):
        page.evaluate(f"document.body.dataset.{attribute} = '{value}'")
        assert dark() == expected, (attribute, value)
    page.evaluate("delete document.body.dataset.jpThemeLight; delete document.body.dataset.theme")
    page.emulate_media(color_scheme="light")
    assert not dark()
    page.emulate_media(color_scheme="dark")
    assert dark()
    page.emulate_media(media="print")
    assert not dark()
    page.context.close()


def luminance(colour: str) -> float:
    """The relative luminance of "#rrggbb" (WCAG 2)."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """The contrast of two colours (WCAG 2), from 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_dark_colours_keep_their_contrast(browser: Any, tmp_path: Path) -> None:
    """Ink of the palette stands out from its background in the dark too, and keeps its order."""
    from course.simulations import pen

    source = (Path(told.__file__).parent / "canvas.js").read_text("utf-8")
    page = browser.new_context().new_page()
    load = "async text => { window.painter = await import('data:text/javascript,' + text); }"
    page.evaluate(load, "".join(f"%{byte:02x}" for byte in source.encode()))
    every = {"#ffffff", "#000000"}
    for name in told.names():
        every |= {*told.model(name).paper.colours.entries, told.model(name).paper.background}
    light = sorted(every)
    dark = dict(
        zip(light, page.evaluate("all => all.map(window.painter.darkened)", light), strict=True)
    )
    assert all(len(each) == 7 for each in dark.values())
    for colour in pen.PALETTE:
        required = min(contrast(colour, "#ffffff"), 4.5)
        assert contrast(dark[colour], dark["#ffffff"]) > 0.93 * required, colour
    assert luminance(dark["#ffffff"]) < 0.01 and luminance(dark["#000000"]) > 0.75
    greys = [f"#{v:02x}{v:02x}{v:02x}" for v in range(0, 256, 5)]
    ordered = [
        luminance(c) for c in page.evaluate("all => all.map(window.painter.darkened)", greys)
    ]
    assert ordered == sorted(ordered, reverse=True)
    page.context.close()


# Waits until the page has not scrolled for a quarter of a second.
SETTLED = """async () => {
  for (let [last, still] = [-1, 0]; still < 15; last = scrollY) {
    await new Promise(requestAnimationFrame);
    still = scrollY === last ? still + 1 : 0;
  }
}"""
# How far a finger moves [pixels].
SWIPES = {"up": (0.0, -165.0), "across": (140.0, 3.0)}


def swipe(page: Any, direction: str) -> None:
    """A finger goes down near the lower left of the picture, moves and leaves, as on a phone."""
    box, (right, down) = page.locator("canvas").bounding_box(), SWIPES[direction]
    x, y = box["x"] + 0.3 * box["width"], box["y"] + box["height"] - 10.0
    session = page.context.new_cdp_session(page)

    def touch(kind: str, *points: dict[str, float]) -> None:
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})

    touch("touchStart", {"x": x, "y": y})
    for k in range(1, 12):
        touch("touchMove", {"x": x + right * k / 11, "y": y + down * k / 11})
    touch("touchEnd")
    page.evaluate(FRAME)


@pytest.mark.prove
@pytest.mark.parametrize("name", ["rigid_body.spring", "contact.touch"])
def test_a_finger_scrolls_the_page_where_nothing_is_dragged_upright(
    browser: Any, tmp_path: Path, name: str
) -> None:
    page = opened(browser, tmp_path, name, 390, has_touch=True, is_mobile=True)
    records = "() => document.querySelector('.course-live').courseLive.records()[0].join()"
    before = page.evaluate(records)
    upright = told.model(name).upright
    swipe(page, "up")
    if upright:
        page.wait_for_timeout(300)
    else:
        page.wait_for_function("() => window.scrollY > 50")
    scrolled, after = page.evaluate("window.scrollY"), page.evaluate(records)
    if upright:
        assert scrolled == 0 and after != before, "the hand is dragged"
    else:
        assert scrolled > 50 and after == before, "the page scrolls and nothing is moved"
        # A finger's scroll runs on for a while: where it ends is not where the next one begins.
        page.evaluate(SETTLED)
        page.evaluate("window.scrollTo(0, 0)")
        page.evaluate(SETTLED)
        swipe(page, "across")
        # Across, it is dragged. A finger's events arrive a little later on a busy machine.
        page.wait_for_function(
            f"before => ({records})() !== before",
            arg=before,
        )
    page.context.close()
