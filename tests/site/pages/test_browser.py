"""The pages in headless Chromium: from a sub-path and from the disk, narrow and wide, both colours.

Every request to another origin is refused and counted as a failure.
"""

import functools
import http.server
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.budget import PROVE
from tests.conftest import chromium
from tests.site.test_build import WORDS

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = [pytest.mark.browser, pytest.mark.slow]

# Pages of each kind; the long tier looks at all of them.
LOOKED_AT = {"index.html", "search.html", "claims.html", "02_contact.html", "10_middleware.html"}

FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]

# What reaches beyond the screen without a box of its own that scrolls.
TOO_WIDE = """() => {
  for (const each of document.querySelectorAll('details')) each.open = true;
  const wide = document.documentElement.clientWidth;
  const boxed = e => e && e !== document.body && (
    /auto|scroll/.test(getComputedStyle(e).overflowX) && e.getBoundingClientRect().right <= wide + 1
    || boxed(e.parentElement));
  return [...document.querySelectorAll('article *, article')].filter(e =>
    e.getBoundingClientRect().right > wide + 1 && !boxed(e)).slice(0, 5).map(e =>
    `${e.tagName}.${e.className}: ${(e.textContent || '').slice(0, 60)}`);
}"""

# Tables of three columns or more with a column that is hardly a word wide.
SQUEEZED = """() => [...document.querySelectorAll('article table')].filter(e =>
  e.rows[0]?.cells.length > 2 && [...e.rows[0].cells].some(c => c.offsetWidth < 90))
  .map(e => e.textContent.slice(0, 60))"""

# What a reader who cannot see the page misses: names, levels of headings, doubled ids.
UNNAMED = """() => {
  const said = [];
  const name = e => (e.getAttribute('aria-label') || e.textContent || e.title || '').trim();
  const shown = e => e.checkVisibility({visibilityProperty: true});
  if (!document.documentElement.lang || !document.title) said.push('no language or title');
  for (const e of document.images) if (!e.alt.trim()) said.push(`image ${e.src.slice(-40)}`);
  const inner = 'img[alt], svg title';
  for (const e of document.querySelectorAll('button, a[href], summary'))
    if (shown(e) && !name(e) && !e.querySelector(inner)) said.push(e.outerHTML.slice(0, 90));
  for (const e of document.querySelectorAll('input:not([type=hidden], .sidebar-toggle), select'))
    if (shown(e) && !e.labels?.length && !e.getAttribute('aria-label') && !e.placeholder)
      said.push(e.outerHTML.slice(0, 90));
  const heads = [...document.querySelectorAll('article :is(h1,h2,h3,h4,h5,h6)')]
    .filter(e => !e.closest('.course-live')).map(e => Number(e.tagName[1]));
  if (heads.filter(level => level === 1).length !== 1) said.push(`h1: ${heads}`);
  heads.forEach((level, k) => k && level > heads[k - 1] + 1
    && said.push(`h${heads[k - 1]}, h${level}`));
  const ids = [...document.querySelectorAll('[id]')].map(e => e.id);
  for (const id of new Set(ids.filter((id, k) => ids.indexOf(id) !== k)))
    said.push(`id ${id} twice`);
  const places = [...document.querySelectorAll('[tabindex]')];
  if (places.some(e => e.tabIndex > 0)) said.push('tabindex');
  return said;
}"""

# Text whose contrast with what is behind it is too low (WCAG 2, 4.5, or 3 where it is large).
FAINT = """() => {
  const numbers = text => text.match(/[\\d.]+/g).map(Number);
  const canvas = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
  const rgb = colour => {
    canvas.clearRect(0, 0, 1, 1); canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const light = ([r, g, b]) => [r, g, b].map(v => (v /= 255) <= 0.04045 ? v / 12.92
    : ((v + 0.055) / 1.055) ** 2.4).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = e => {
    for (; e; e = e.parentElement) {
      const colour = getComputedStyle(e).backgroundColor;
      if (colour !== 'rgba(0, 0, 0, 0)' && colour !== 'transparent') return rgb(colour);
    }
    return [255, 255, 255];
  };
  const seen = new Map();
  const words = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = words.nextNode());) {
    const e = node.parentElement;
    const seeable = e.checkVisibility({opacityProperty: true, visibilityProperty: true});
    if (!node.data.trim() || !seeable) continue;
    const style = getComputedStyle(e);
    const [a, b] = [light(rgb(style.color)), light(behind(e))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const large = parseFloat(style.fontSize) >= 24;
    if (ratio < (large ? 3 : 4.5)) {
      const key = `${e.tagName}.${e.className} ${style.color}`;
      const words = node.data.trim().slice(0, 30);
      if (!seen.has(key)) seen.set(key, `${key}: ${ratio.toFixed(2)} ${words}`);
    }
  }
  return [...seen.values()];
}"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *_message: Any) -> None:
        pass


@pytest.fixture(scope="module")
def browser() -> Iterator["Browser"]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def addresses(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """Where the site is: on the disk, and below a path of a server."""
    folder = tmp_path_factory.mktemp("host")
    (folder / "some").mkdir()
    (folder / "some" / "where").symlink_to(site)
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield [site.as_uri(), f"http://127.0.0.1:{server.server_port}/some/where"]
        server.shutdown()


class Reader:
    """A page that keeps to one origin, and remembers what went wrong."""

    def __init__(self, browser: "Browser", address: str, **options: Any) -> None:
        self.context = browser.new_context(**options)
        self.address, self.wrong = address, []  # type: str, list[str]
        self.context.route(
            lambda url: not url.startswith((address, "data:", "blob:")), self._refuse
        )
        self.page = self.context.new_page()
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))

    def _console(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.wrong.append(message.text)

    def _refuse(self, route: Any) -> None:
        self.wrong.append(f"asked for {route.request.url}")
        route.abort()

    def open(self, name: str) -> Any:
        self.page.goto(f"{self.address}/{name}")
        return self.page

    def __enter__(self) -> "Reader":
        return self

    def __exit__(self, *_raised: Any) -> None:
        self.context.close()


@pytest.mark.prove
def test_every_page_opens_alone_and_fits(
    browser: "Browser", site: Path, addresses: list[str]
) -> None:
    """From the disk on a telephone, from a sub-path on a wide screen, everything unfolded."""
    for address, wide in zip(addresses, (390, 2560), strict=True):
        with Reader(browser, address, viewport={"width": wide, "height": 900}) as reader:
            for path in sorted(site.glob("*.html")):
                page = reader.open(path.name)
                assert page.evaluate(TOO_WIDE) == [], (path.name, wide)
                assert page.evaluate("document.documentElement.scrollWidth") <= wide, path.name
                if wide < 600:
                    assert page.evaluate(SQUEEZED) == [], path.name
                assert reader.wrong == [], path.name


def test_pages_have_names_and_levels(browser: "Browser", site: Path, addresses: list[str]) -> None:
    with Reader(browser, addresses[0], viewport={"width": 1280, "height": 900}) as reader:
        result = {
            name: reader.open(name).evaluate(UNNAMED)
            for name in (path.name for path in sorted(site.glob("*.html")))
            if PROVE or name in LOOKED_AT
        }
    result["search.html"].remove("h1: ")  # it is Furo's, and has none before one has searched
    assert {name: text for name, text in result.items() if text} == {}


@pytest.mark.prove
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out(browser: "Browser", addresses: list[str], scheme: str) -> None:
    options: dict[str, Any] = {"color_scheme": scheme, "viewport": {"width": 1280, "height": 900}}
    with Reader(browser, addresses[0], **options) as reader:
        for name in ("index", "01_rigid_body", "10_middleware", "claims", "search"):
            assert reader.open(f"{name}.html").evaluate(FAINT) == [], name


def test_the_checks_see_what_they_are_for(browser: "Browser", tmp_path: Path) -> None:
    bad = (
        '<html><body style="background:#fff"><article><h1>a</h1><h3>b</h3><img src="data:,">'
        '<button></button><p style="color:#999">faint</p><p id="x"></p><p id="x"></p>'
        '<div style="width:3000px">wide</div><script src="https://a.invalid/b.js"></script>'
    )
    (tmp_path / "bad.html").write_text(bad)
    with Reader(browser, tmp_path.as_uri()) as reader:
        page = reader.open("bad.html")
        assert any("wide" in text for text in page.evaluate(TOO_WIDE))
        message = " ".join(page.evaluate(UNNAMED))
        assert all(
            word in message for word in ("no language", "image", "<button>", "h1, h3", "id x")
        )
        assert len(page.evaluate(FAINT)) == 1
        assert any("asked for https://a.invalid/b.js" in text for text in reader.wrong)


@pytest.mark.prove
def test_the_focus_goes_down_the_page(browser: "Browser", addresses: list[str]) -> None:
    """With the tabulator from one thing to the next: each is seen, none is met twice."""
    with Reader(browser, addresses[0], viewport={"width": 1280, "height": 900}) as reader:
        page = reader.open("00_role.html")
        met = []
        for _ in range(40):
            page.keyboard.press("Tab")
            met.append(
                page.evaluate(
                    "() => { const e = document.activeElement;"
                    " const all = [...document.querySelectorAll('*')];"
                    " return [all.indexOf(e), e.checkVisibility(), e.tagName]; }"
                )
            )
        assert all(observed for _, observed, tag in met if tag != "BODY"), met
        places = [place for place, _, tag in met if tag != "BODY"]
        assert len(places) > 30 and places == sorted(set(places)), met


@pytest.mark.prove
def test_the_search_finds_words_where_they_are(browser: "Browser", addresses: list[str]) -> None:
    with Reader(browser, addresses[0]) as reader:
        for word, expected in WORDS.items():
            page = reader.open(f"search.html?q={word}")
            page.wait_for_selector("#search-results .search li a")
            page.wait_for_function(
                "/finished|found/i.test(document.querySelector('.search-summary').textContent)"
            )
            hits = page.eval_on_selector_all(
                "#search-results .search li a",
                "all => all.map(a => new URL(a.href).pathname.split('/').at(-1))",
            )
            assert f"{expected}.html" in hits[:5], (word, hits[:5])
        assert reader.wrong == []


def test_the_search_finds_first_what_is_taught(browser: "Browser", addresses: list[str]) -> None:
    """A chapter before the gallery of charts, and the glossary among the first five."""
    with Reader(browser, addresses[0]) as reader:
        words = (
            "quaternion",
            "latency",
            "friction",
            "impedance",
            "point cloud",
            "energy drift",
            "lidar",
        )
        for word in words:
            page = reader.open(f"search.html?q={word}")
            page.wait_for_selector("#search-results .search li a")
            page.wait_for_function(
                "/finished|found/i.test(document.querySelector('.search-summary').textContent)"
            )
            hits = page.eval_on_selector_all(
                "#search-results .search li a",
                "all => all.map(a => new URL(a.href).pathname.split('/').at(-1))",
            )
            chapters = [k for k, hit in enumerate(hits) if hit[:2].isdigit()]
            assert chapters and chapters[0] < min(
                5, *[k for k, hit in enumerate(hits) if hit == "charts.html"], 99
            ), (word, hits[:8])
            assert "glossary.html" in hits[:5], (word, hits[:8])
        assert reader.wrong == []


@pytest.mark.prove
def test_what_is_folded_unfolds_and_the_side_bar_opens(
    browser: "Browser", addresses: list[str]
) -> None:
    with Reader(browser, addresses[1], viewport={"width": 390, "height": 844}) as reader:
        page = reader.open("cards.html")
        first = page.locator("article details").first
        assert not first.locator("p").first.is_visible()
        first.locator("summary").click()
        assert first.locator("p").first.is_visible()
        page.locator("label.nav-overlay-icon, .mobile-header .nav-overlay-icon").first.click()
        page.locator(".sidebar-tree a", has_text="The claims").click()
        page.wait_for_url("**/claims.html")
        assert reader.wrong == []


PIXELS = """() => {
  const canvas = document.querySelector('.course-live canvas');
  const copy = new OffscreenCanvas(canvas.width, canvas.height);
  const context = copy.getContext('2d', {willReadFrequently: true});
  context.drawImage(canvas, 0, 0);
  const {data} = context.getImageData(0, 0, canvas.width, canvas.height);
  let sum = 0;
  for (let k = 0; k < data.length; k += 1) sum = (sum * 31 + data[k]) % 4294967291;
  return sum;
}"""


# Where the words of the first such element begin [CSS pixels].
TEXT_STARTS = """all => all.map(name => {
  const words = document.createRange();
  words.selectNodeContents(document.querySelector(`article ${name}`));
  return words.getBoundingClientRect().left;
})"""


@pytest.mark.parametrize("wide", [390, 1440])
def test_the_home_page_moves_at_once_and_is_dragged(
    browser: "Browser", addresses: list[str], capsys: pytest.CaptureFixture[str], wide: int
) -> None:
    start = time.monotonic()
    with Reader(browser, addresses[1], viewport={"width": wide, "height": 850}) as reader:
        page = reader.open("index.html")
        canvas = page.locator(".course-live[data-ready] canvas[data-frame]")
        canvas.wait_for()
        assert canvas.bounding_box()["y"] < 850, "it begins on the first screen"
        starts = page.evaluate(TEXT_STARTS, ["h1", "#move-something h2", "#move-something > p"])
        assert max(starts) - min(starts) < 1.0, "headings begin where the text does"
        first = page.evaluate(PIXELS)
        page.wait_for_function(f"first => ({PIXELS})() !== first", arg=first)
        moved = time.monotonic() - start
        page.get_by_role("button", name="Pause").click()
        before = page.evaluate(PIXELS)
        canvas.scroll_into_view_if_needed()
        box = canvas.bounding_box()
        page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 0.4 * box["height"])
        page.mouse.down()
        page.mouse.move(box["x"] + 0.15 * box["width"], box["y"] + 0.6 * box["height"])
        page.mouse.up()
        page.wait_for_function(f"before => ({PIXELS})() !== before", arg=before)
        dragged = time.monotonic() - start
        assert reader.wrong == []
    with capsys.disabled():
        print(
            f"\nhome page, {wide} px: it moves after {moved:.1f} s, dragged after {dragged:.1f} s"
        )


@pytest.mark.prove
@pytest.mark.parametrize("wide", [390, pytest.param(1440, marks=pytest.mark.prove)])
def test_nothing_lies_on_a_picture_that_one_scrolls_up_to(
    browser: "Browser", addresses: list[str], wide: int
) -> None:
    with Reader(browser, addresses[0], viewport={"width": wide, "height": 850}) as reader:
        page = reader.open("01_rigid_body.html")
        canvas = page.locator(".course-live[data-ready] canvas[data-frame]").first
        page.locator(".course-live").first.scroll_into_view_if_needed()
        canvas.wait_for()
        page.evaluate("() => scrollBy(0, 2000)")
        page.wait_for_timeout(100)
        # With the wheel, as a reader does it: by and by, until it is below the bar at the top.
        page.mouse.move(wide // 2, 400)
        while canvas.bounding_box()["y"] < 60:
            page.mouse.wheel(0, -40)
            page.wait_for_timeout(20)
        button = page.locator(".back-to-top")
        button.wait_for(state="visible")
        covered = canvas.evaluate(
            """canvas => {
              const box = canvas.getBoundingClientRect(), result = [];
              for (let x = box.left + 5; x < box.right; x += 10)
                for (let y = box.top + 5; y < box.bottom; y += 10)
                  if (document.elementFromPoint(x, y) !== canvas) result.push([x, y]);
              return result;
            }"""
        )
        assert covered == []


@pytest.mark.prove
def test_with_less_motion_the_home_page_stands_still(
    browser: "Browser", addresses: list[str]
) -> None:
    with Reader(browser, addresses[0], reduced_motion="reduce") as reader:
        page = reader.open("index.html")
        page.locator(".course-live").scroll_into_view_if_needed()
        page.locator(".course-live[data-ready] canvas[data-frame]").wait_for()
        film = page.locator(".course-film img").evaluate("e => e.currentSrc")
        assert film.endswith("film.still.png")
        assert page.get_by_role("button", name="Play").count() == 1


def test_the_home_page_leads_back_to_where_one_was(
    browser: "Browser", addresses: list[str]
) -> None:
    with Reader(browser, addresses[1]) as reader:
        page = reader.open("index.html")
        assert page.locator(".course-go-on").count() == 0
        page = reader.open("02_contact.html")
        section = page.locator("article section section h2").nth(3)
        section.evaluate("e => e.scrollIntoView({behavior: 'instant'})")
        title = section.evaluate("e => e.firstChild.textContent")
        page = reader.open("index.html")
        link = page.locator(".course-go-on a")
        assert link.inner_text().startswith("2 · Contact and friction: ")
        assert title in link.inner_text()
        link.click()
        page.wait_for_url("**/02_contact.html#*")
        assert reader.wrong == []


# Where the words of a picture stand, from its left edge to its right one, line by line.
WORDS_DRAWN = """
const draw = CanvasRenderingContext2D.prototype.fillText;
const fresh = CanvasRenderingContext2D.prototype.fillRect;
CanvasRenderingContext2D.prototype.fillRect = function (...given) {
  this.canvas.words = [];
  fresh.apply(this, given);
};
CanvasRenderingContext2D.prototype.fillText = function (words, ...given) {
  const [at, size] = [this.getTransform(), this.measureText(words)];
  if (Math.abs(at.b) < 1e-9)
    this.canvas.words.push([
      words, at.f, at.e - at.a * size.actualBoundingBoxLeft,
      at.e + at.a * size.actualBoundingBoxRight,
    ]);
  draw.call(this, words, ...given);
};
"""


@pytest.mark.prove
def test_words_of_a_narrow_picture_stand_apart(browser: "Browser", addresses: list[str]) -> None:
    with Reader(browser, addresses[0], viewport={"width": 390, "height": 844}) as reader:
        reader.page.add_init_script(WORDS_DRAWN)
        page = reader.open("01_rigid_body.html")
        # A simulation starts when it comes into view; with a wide font this one lies below.
        page.locator(".course-live").first.scroll_into_view_if_needed()
        picture = page.locator(".course-live canvas").first
        picture.wait_for()
        page.wait_for_function("() => document.querySelector('canvas')?.words?.length")
        words, wide = picture.evaluate("picture => [picture.words, picture.width]")
        assert len(words) > 20
        for k, (text, line, left, right) in enumerate(words):
            assert 0 <= left and right <= wide, text
            for other, its_line, start, end in words[:k]:
                assert its_line != line or end <= left or right <= start, (text, other)


@pytest.mark.prove
def test_tables_in_html_have_the_lines_of_those_in_markdown(
    browser: "Browser", addresses: list[str]
) -> None:
    looks = """() => [...document.querySelectorAll('article table')].map(e => {
      const {padding, borderLeftWidth, borderBottomWidth} = getComputedStyle(e.rows[1].cells[1]);
      return [e.classList.contains('docutils'), parseFloat(padding.split(' ').at(-1)),
        parseFloat(borderLeftWidth), parseFloat(borderBottomWidth)];
    })"""
    with Reader(browser, addresses[0]) as reader:
        tables = reader.open("09_learning.html").evaluate(looks)
        assert {of_markdown for of_markdown, *_ in tables} == {True, False}
        for _, padding, left, bottom in tables:
            assert padding >= 4.0 and left == bottom == 1.0


@pytest.mark.prove
def test_a_tap_enlarges_a_picture_beyond_a_telephone(
    browser: "Browser", addresses: list[str]
) -> None:
    options: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
    with Reader(browser, addresses[0], **options) as reader:
        page = reader.open("02_contact.html")
        # A drawing of the page, which has no narrow version as the charts have.
        picture = page.locator("article a.course-enlarge img[alt*=Delassus]").first
        picture.scroll_into_view_if_needed()
        small = picture.bounding_box()
        picture.tap()
        large = page.locator("dialog img").bounding_box()
        assert small and large and small["width"] <= 390 < 600 < large["width"]
        room = page.locator("dialog > div")
        assert room.evaluate("e => e.scrollWidth > e.clientWidth"), "it moves below the finger"
        assert reader.wrong == []


@pytest.mark.prove
def test_a_page_prints_as_it_is(browser: "Browser", addresses: list[str]) -> None:
    with Reader(browser, addresses[0], viewport={"width": 1280, "height": 900}) as reader:
        page = reader.open("01_rigid_body.html")
        picture = page.locator(".course-live[data-ready] canvas").first
        picture.wait_for()
        shape = "picture => picture.clientWidth / picture.clientHeight"
        before = picture.evaluate(shape)
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 700, "height": 900})
        page.evaluate("document.querySelector('.course-live canvas').style.height = '50px'")
        assert picture.evaluate(shape) == pytest.approx(before, rel=0.02)
        for bar in (".sidebar-drawer", ".skip-to-content", ".course-live .side"):
            assert not page.locator(bar).first.is_visible(), bar


@pytest.mark.prove
def test_subscripts_lie_below_their_letters(browser: "Browser", addresses: list[str]) -> None:
    """With the font that the site brings along; few machines have one with a table for formulas."""
    lowered = """async () => {
      await document.fonts.ready;
      return [...document.querySelectorAll('article math msub')].slice(0, 20).map(e => {
        const [base, below] = [...e.children].map(child => child.getBoundingClientRect());
        return (below.bottom - base.bottom) / base.height;
      });
    }"""
    for address in addresses:
        with Reader(browser, address) as reader:
            page = reader.open("09_learning.html")
            page.wait_for_function("document.fonts.check('16px CourseMath')")
            drops = page.evaluate(lowered)
            assert len(drops) > 5 and min(drops) > 0.05, (address, drops)
            assert reader.wrong == []
