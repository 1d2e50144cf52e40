"""The site as files: complete, whole in its links, without a formula lost; and what it refuses."""

import base64
import copy
import functools
import html
import json
import re
from collections import deque
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit
from xml.etree import ElementTree

import nbformat
import pytest
from bs4 import BeautifulSoup, SoupStrainer
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output
from PIL import Image

from course import CHAPTERS, cards, charts, derivations
from course.cards import draws
from course.interview import questions
from course.simulations import declaration
from course.site import build, formulas, modules, notebooks, reference
from tests.budget import ROOT
from tools import front

PNG = (
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJg"
    "gg=="
)
pytestmark = pytest.mark.slow  # Sphinx builds the whole site once.

PAGES = ["reference", *(group.page for group in modules.GROUPS)]
CHAPTER_PAGES = [Path(chapter.notebook).stem for chapter in CHAPTERS]
# The scope puts the tests of a page one after the other, so that most workers read it once.
BY_PAGE = pytest.mark.parametrize("name", CHAPTER_PAGES, scope="module")


@functools.cache
def soup(page: Path) -> Any:
    return BeautifulSoup(page.read_text("utf-8"), "html.parser")


def letters(text: str) -> str:
    """A text without blanks and typographic quotes, which pages set in their own way."""
    return re.sub(r"[\s\"'“”‘’…._–—-]", "", text)


# --- What is on it --------------------------------------------------------------------------------


CHANGE_ME = re.compile(r"[Cc]hange me: (\w)")


@BY_PAGE
def test_plumbing_is_not_on_a_page(site: Path, name: str) -> None:
    """No code that only shows a card, a claim or a simulation."""
    code = [tag.get_text() for tag in soup(site / f"{name}.html").select("article pre")]
    assert code, "what teaches is there"
    shows = re.compile(r"^(predict|show|simulation|more_claims|interview)\(", re.M)
    assert [text for text in code if shows.search(text)] == []


@pytest.mark.prove
@pytest.mark.parametrize("name", ["index", *CHAPTER_PAGES])
def test_a_page_has_all_of_its_notebook(site: Path, name: str) -> None:
    """Headings, the code that teaches, what was printed and every table of figures, in order.

    Code that only fetches, shows or draws is not on it, nor what makes sense only with a kernel.
    """
    notebook = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    page = soup(site / f"{name}.html").article
    assert page is not None
    whole, at = letters(page.get_text()), 0
    assert not page.select(".kernel-only")
    for number, cell in enumerate(notebook.cells):
        expected = []
        if (
            cell.cell_type == "code"
            and "home()" not in cell.source
            and "ticks()" not in cell.source
            and "your_robot()" not in cell.source
        ):
            if "remove-input" not in cell.metadata.get("tags", ()):
                expected.append(CHANGE_ME.sub(lambda match: match[1].upper(), cell.source))
            for output in cell.outputs:
                expected += [output.text] if output.output_type == "stream" else []
        elif cell.cell_type == "markdown" and "## Where you are" not in cell.source:
            prose = re.sub(r"^```.*?^```", "", cell.source, flags=re.S | re.M)
            heads = re.findall(r"^#+ (.+)$", prose, re.M)
            expected += [re.sub(r"[*`]|\$[^$]*\$", "", head) for head in heads if "$" not in head]
        for text in expected:
            result = whole.find(letters(text), at)
            assert result >= 0, f"cell {number} of {name} is not there: {text[:200]}"
            at = result


@pytest.mark.slow
@BY_PAGE
def test_pictures_and_simulations_of_a_page_are_those_of_its_notebook(
    site: Path, name: str
) -> None:
    notebook = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    labels = {declaration.model(each).paper.label: each for each in declaration.names()}
    simulations, drawn, pictures = [], 0, 0
    for cell in notebook.cells:
        pictures += len(re.findall(r"!\[[^\]]*\]\(\.\./docs", cell.source))
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            first = data.get("text/plain", "").partition("\n")[0]
            if first in labels:
                simulations.append(labels[first])
            else:
                drawn += bool({"image/png", "image/svg+xml"} & set(data))
            pictures += len(re.findall(r"!\[[^\]]*\]\(\.\./docs", data.get("text/markdown", "")))
    page = soup(site / f"{name}.html")
    places = page.select(".course-live")
    assert [place["data-simulation"] for place in places] == simulations
    for place in places:
        saved = place.find("img")
        assert saved is not None
        assert saved["alt"] == declaration.model(place["data-simulation"]).paper.label
        assert (site / saved["src"]).read_bytes().startswith(base64.b64decode("iVBORw0KGgo="))
        assert "acTL" not in (site / saved["src"]).read_bytes().decode("latin-1")  # no film
    scripts = [str(script.get("src", "")).partition("?")[0] for script in page.select("script")]
    expected = [f"_static/simulations/{each}.js" for each in dict.fromkeys(simulations)]
    assert [s for s in scripts if "/simulations/" in s] == expected
    assert scripts.count("_static/live.js") == 1
    assert len(page.select("article img")) == len(places) + drawn + pictures + len(
        page.select('article img[src^="data:"]')
    )


def test_a_phone_gets_the_narrow_picture_of_each_chart(site: Path) -> None:
    charts = {path.stem for path in (ROOT / "docs" / "charts").glob("*.png")}
    picture = re.compile(r"<picture\b[^>]*>.*?</picture>", re.S)
    address = re.compile(r'<img\b[^>]*\bsrc="(?!data:)([^"]*)"')

    def chart(image: str) -> str | None:
        name = Path(unquote(image)).stem
        return name if name in charts else None

    shown = 0
    for page in sorted(site.glob("*.html")):
        article = page.read_text("utf-8").partition("<article")[2].partition("</article>")[0]
        outside = [chart(image) for image in address.findall(picture.sub("", article))]
        assert not any(outside), (page.name, outside)
        for block in picture.findall(article):
            for name in filter(None, map(chart, address.findall(block))):
                source = re.findall(r"<source\b[^>]*>", block)
                assert len(source) == 1 and "max-width" in source[0]
                assert f'srcset="_static/charts/{name}.svg"' in source[0]
                svg = site / "_static" / "charts" / f"{name}.svg"
                assert svg.read_text("utf-8").lstrip().startswith("<?xml")
                shown += 1
    assert shown > 200


def test_what_a_preset_was_chosen_for_starts_with_it(site: Path) -> None:
    page = soup(site / "02_contact.html")
    places = page.select('.course-live[data-simulation="contact.touch"]')
    assert [place.get("data-preset") for place in places] == [
        None,
        "Tunnelling",
        "Pull-back",
        "Explosion",
        "Slip",
        "Stick",
    ]


def test_no_page_shows_an_unfilled_field(site: Path) -> None:
    # The reference shows docstrings, some of which say how a field is written.
    for page in sorted(set(site.glob("*.html")) - set(site.glob("code_*.html"))):
        text = page.read_text("utf-8").partition("<article")[2]
        prose = re.sub(r"<(pre|code|math|script)\b.*?</\1>|<[^>]*>", "", text, flags=re.S)
        assert not re.search(r"\{[a-z]\w*\.[a-z]", prose), page.name


# What makes sense only where a kernel runs.
KERNEL = re.compile(
    r"\b(run (the|these|this|all|a) cells?|change me|change the texts|shift\W?enter|restart the"
    r"|the cell above it)\b",
    re.I,
)


def kernel_sentences(article: Any) -> list[str]:
    """What a page says of a kernel, apart from the notes below what needs Python."""
    article = copy.copy(article)
    for note in article.select(".needs-python, .kernel-only"):
        note.decompose()
    text = re.sub(r"\s+", " ", article.get_text())
    return [text[max(0, m.start() - 40) : m.end() + 40] for m in KERNEL.finditer(text)]


@pytest.mark.parametrize("name", ["index", *CHAPTER_PAGES], scope="module")
def test_no_sentence_is_about_a_kernel(site: Path, name: str) -> None:
    page = soup(site / f"{name}.html")
    assert page.select(".kernel-only") == []
    assert kernel_sentences(page.article) == []


def test_a_sentence_about_a_kernel_is_found_and_left_out() -> None:
    text = (
        "*A box falls. Answer first; then run the cells, press* Play *and see.* It takes a while."
    )
    assert kernel_sentences(BeautifulSoup(f"<p>{text}</p>", "html.parser"))
    assert notebooks.without_kernel(text) == "*A box falls. Answer first.* It takes a while."
    text = 'Answer. <span class="kernel-only">Run this cell.</span> Then read.'
    assert notebooks.without_kernel(text) == "Answer. Then read."


def test_the_home_page_begins_with_the_film_the_doors_and_something_to_move(site: Path) -> None:
    page = soup(site / "index.html")
    film, *_ = page.select("article img")
    assert (site / unquote(str(film["src"]))).read_bytes() == notebooks.FILM.read_bytes()
    assert film.get("loading") != "lazy"
    still = film.parent.source
    assert still["media"] == "(prefers-reduced-motion: reduce)"
    assert getattr(Image.open(site / still["srcset"]), "n_frames", 1) == 1
    doors = page.select(".course-doors a")
    assert [door["href"].partition("#")[0] for door in doors] == [
        "00_role.html",
        "drills.html",
        "modules.html",
    ]
    (place,) = page.select(".course-live")
    assert place.has_attr("data-plays") and declaration.is_live(place["data-simulation"])
    whole = page.article.get_text(" ")
    at = [str(page.article).find(part) for part in ("course-film", "course-doors", "course-live")]
    assert -1 not in at and at == sorted(at)
    # It says how much there is and how long it takes, and keeps no books.
    assert front.hours() in " ".join(whole.split()) and front.counts() in " ".join(whole.split())
    assert not re.search(r"\d (coming|written)|\bready\b", whole)


def test_every_chapter_has_one_name(site: Path) -> None:
    """In its page, the side bar, the list of the home page and the pages beside."""
    for chapter, name in zip(CHAPTERS, CHAPTER_PAGES, strict=True):
        title = f"{chapter.number} · {chapter.title}"
        page = soup(site / f"{name}.html")
        assert page.h1.find(string=True, recursive=False) == title
        home = soup(site / "index.html")
        bar = [a.get_text() for a in home.select(f'.sidebar-tree a[href="{name}.html"]')]
        listed = [a.get_text() for a in home.select(f'article table a[href="{name}.html"]')]
        assert bar == [title] and chapter.title in listed
        for beside in ("claims", "cards", "questions"):
            heads = [h.find(string=True) for h in soup(site / f"{beside}.html").select("h2")]
            assert title in heads, (beside, title)


def test_the_home_page_counts_the_cards_of_every_chapter(site: Path) -> None:
    rows = soup(site / "index.html").select(".course-scores [data-cards]")
    assert len(rows) == len(CHAPTERS)
    for row, name in zip(rows, CHAPTER_PAGES, strict=True):
        cards_there = soup(site / f"{name}.html").select(".card[data-card]")
        questions = {
            card["data-card"] for card in cards_there if card.select("details[data-answer]")
        }
        assert set(row["data-cards"].split()) == questions, name
        assert row.a["href"] == f"{name}.html"
        for card in cards_there:
            right = [each["data-right"] for each in card.select("details[data-answer]")]
            assert not right or right.count("yes") == 1, card["data-card"]


@BY_PAGE
def test_no_formula_is_left_as_typed(site: Path, name: str) -> None:
    """As many formulas as the text of the notebook has between dollars, and no dollar left."""
    notebook = nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)
    count = 0
    for cell in notebook.cells:
        texts = [cell.source] if cell.cell_type == "markdown" else []
        for output in cell.get("outputs", []):
            texts += [
                output.get("data", {}).get(kind, "") for kind in ("text/markdown", "text/html")
            ]
        if cell.source.startswith("checkpoint("):
            texts = [draws.offered(name[3:])]  # the page draws from all questions
        for text in texts:
            quiet = re.sub(r"^```.*?^```|`[^`]*`", "", text, flags=re.S | re.M)
            dollars = len(re.findall(r"(?<!\\)\$", quiet.replace("$$", "$")))
            assert dollars % 2 == 0, text
            count += dollars // 2
    page = (site / f"{name}.html").read_text("utf-8").partition("<article")[2]
    assert page.count("<math ") == count
    quiet = re.sub(r"<(pre|code|math|script)\b.*?</\1>|<[^>]*>", "", page, flags=re.S)
    assert "$" not in quiet


def test_every_claim_card_question_word_and_chart_is_there(site: Path) -> None:
    shown = {tag["id"]: tag.get_text().lower() for tag in soup(site / "claims.html").select("[id]")}
    for claim in derivations.claims():
        # A Greek name may be a letter there; words of some length are as they were.
        message = set(re.findall(r"[a-z]{4,}", claim.claim.lower()))
        message -= {"alpha", "beta", "gamma", "theta", "lambda", "omega", "sigma", "sqrt", "delta"}
        assert message <= set(re.findall(r"[a-z]+", shown[claim.id])), claim.id
    text = letters(soup(site / "questions.html").get_text())
    for chapter in CHAPTERS:
        for question in questions(chapter.topic):
            head = re.split(r"[$`*]", question.title)[0]
            assert letters(head) in text, question.name
    count = sum(len(cards.predictions(chapter.topic)) for chapter in CHAPTERS)
    assert len(soup(site / "cards.html").find_all("strong", string="Predict.")) == count
    words = soup(site / "glossary.html").get_text()
    for chapter in CHAPTERS:
        for term in cards.vocabulary(chapter.topic):
            assert term in words
        for word, term in cards.synonyms(chapter.topic).items():
            assert f"{word}: see {term}, chapter {chapter.number}" in words
    alts = {image["alt"] for image in soup(site / "charts.html").select("article img")}
    assert alts == {path.stem for path in (ROOT / "docs" / "charts").glob("*.png")}


def test_the_verdicts_are_those_on_record(site: Path) -> None:
    """Each claim's verdict, read in the record itself."""
    words = {
        "holds": "It is true.",
        "false": "It is false.",
        "holds only if": "It is true only if",
    }
    places = {tag["id"]: tag for tag in soup(site / "claims.html").select(".course-claim")}
    for claim in derivations.claims():
        verdict = derivations.records.load(claim.file)[claim.id]["verdict"]
        strong = places[claim.id].find_all("strong")
        assert any(tag.get_text().startswith(words[verdict]) for tag in strong), claim.id
        assert "{" not in re.sub(r"alttext=.*", "", places[claim.id].get_text()), claim.id


def test_live_and_recorded_are_told_as_the_declarations_say(site: Path) -> None:
    section = soup(site / "index.html").find(id="what-moves-on-this-site")
    assert section is not None
    rows = {}
    for row in section.select("tbody tr"):
        title, _, kind = (cell.get_text() for cell in row.select("td"))
        rows[title] = kind.startswith("live")
    names = [name for name in declaration.names()]
    assert rows == {
        declaration.model(name).title: not declaration.why_recorded(name) for name in names
    }


# --- Links, sizes, search -------------------------------------------------------------------------


@functools.cache
def places(page: Path) -> set[str]:
    return {tag["id"] for tag in soup(page).select("[id]")}


def links(page: Path) -> list[tuple[Path, str]]:
    """Where the links of a page lead within the site: file and anchor."""
    result = []
    for tag in soup(page).select("a[href]"):
        parts = urlsplit(tag["href"])
        if not parts.scheme and not parts.netloc:
            file = page.parent / unquote(parts.path) if parts.path else page
            result.append((file, unquote(parts.fragment)))
    return result


@pytest.mark.prove  # the build itself refuses such a site, by other code
def test_every_link_and_anchor_leads_somewhere(site: Path) -> None:
    pages = sorted(site.glob("*.html"))
    assert len(pages) == 1 + len(CHAPTERS) + len(build.BESIDE) + len(build.DOORS) + 1 + len(PAGES)
    for page in pages:
        for file, anchor in links(page):
            assert file.is_file(), (page.name, file)
            assert not anchor or anchor in places(file), (page.name, file.name, anchor)
        for tag in soup(page).select("[src], link[href]"):
            address = tag.get("src") or tag.get("href")
            if tag.name == "link" and tag.get("rel") not in (["stylesheet"], ["icon"]):
                continue
            if not address.startswith("data:"):
                assert not urlsplit(address).scheme and not urlsplit(address).netloc, address
                assert (site / urlsplit(address).path).is_file(), (page.name, address)


def test_nothing_is_fetched_by_style_or_script(site: Path) -> None:
    for path in sorted(site.rglob("*.css")):
        result = re.findall(r"@import|url\((?!['\"]?data:)[^)]*\)", path.read_text("utf-8"))
        assert all(not re.search(r"//|@import", each) for each in result), (path.name, result)
    assert "MathJax" not in "".join(page.read_text("utf-8") for page in site.glob("*.html"))


@pytest.mark.prove
def test_everything_is_within_three_clicks(site: Path) -> None:
    clicks = {site / "index.html": 0}
    entered: dict[str, int] = {}
    waiting = deque(clicks)
    while waiting:
        page = waiting.popleft()
        for file, anchor in links(page):
            if anchor:
                entered.setdefault(f"{file.name}#{anchor}", clicks[page] + 1)
            if file.suffix == ".html" and file not in clicks:
                clicks[file] = clicks[page] + 1
                waiting.append(file)
    pages = [site / f"{name}.html" for name in (*CHAPTER_PAGES, *build.BESIDE)]
    assert all(clicks[page] <= 1 for page in pages)
    # A claim and a chart stand on pages of one click, open.
    for name, selector in (("claims", ".course-claim"), ("charts", "img")):
        hidden = soup(site / f"{name}.html").select(f"details {selector}")
        assert hidden == []


@pytest.mark.prove
def test_a_page_is_small(site: Path) -> None:
    """The page, its styles and scripts, and the pictures that don't wait to be seen."""
    for page in sorted(site.glob("*.html")):
        size = page.stat().st_size
        for tag in soup(page).select("script[src], link[rel=stylesheet], img[src]"):
            address = urlsplit(tag.get("src") or tag.get("href"))
            if address.scheme != "data" and tag.get("loading") != "lazy":
                size += (site / address.path).stat().st_size
        assert size < 3e6, (page.name, size)


def test_a_picture_that_waits_takes_up_its_room(site: Path) -> None:
    """Or the page grows on the way to a section, and a link ends beside it."""
    waiting = 0
    pictures = SoupStrainer(["picture", "source", "img"])
    for page in sorted(site.glob("*.html")):
        article = page.read_text("utf-8").partition("<article")[2].partition("</article>")[0]
        parsed: Any = BeautifulSoup(article, "html.parser", parse_only=pictures)
        for image in parsed.select("img[loading=lazy]"):
            sizes = [image] + ([image.parent.source] if image.parent.name == "picture" else [])
            for tag in sizes:
                path = site / (tag.get("src") or tag["srcset"])
                if path.suffix == ".png":
                    waiting += 1
                    with Image.open(path) as opened:
                        wide, high = opened.size
                    ratio = int(tag["width"]) * high / (int(tag["height"]) * wide)
                    assert abs(ratio - 1) < 1 / int(tag["height"]), (page.name, path.name)
    assert waiting > 200


def test_the_size_of_a_picture_is_stated_once(tmp_path: Path) -> None:
    Image.new("L", (600, 200)).save(tmp_path / "a.png")
    (tmp_path / "b.svg").write_text('<svg width="302.4pt" height="518.4pt" version="1.1"></svg>')
    page = '<p><img src="a.png" width="300" /><source srcset="b.svg"><img src="data:,"></p>'
    expected = (
        '<p><img src="a.png" width="300" height="100" /><source srcset="b.svg" width="403" '
        'height="691"><img src="data:,"></p>'
    )
    assert build.reserved(page, tmp_path) == expected
    assert build.reserved(expected, tmp_path) == expected


# A word of each and the page that is about it.
WORDS = {
    "quaternion": "01_rigid_body",
    "complementarity": "02_contact",
    "drake": "03_platforms",
    "manipulability": "04_kinematics",
    "roadmap": "05_planning",
    "impedance": "06_control",
    "voxel": "07_perception",
    "randomisation": "08_sim_to_real",
    "diffusion": "09_learning",
    "watchdog": "10_middleware",
    "work_precision_oscillator": "charts",
    "top_condition": "claims",
}


def test_the_index_of_the_search_knows_where_words_are(site: Path) -> None:
    import snowballstemmer

    text = (site / "searchindex.js").read_text("utf-8")
    index = json.loads(text.removeprefix("Search.setIndex(").rstrip().removesuffix(")"))
    stem = snowballstemmer.stemmer("english").stemWord
    for word, page in WORDS.items():
        result: set[int] = set()
        for kind in ("terms", "titleterms"):
            hits = index[kind].get(stem(word), [])
            result |= {hits} if isinstance(hits, int) else set(hits)
        assert page in {index["docnames"][each] for each in result}, word


# --- Formulas -------------------------------------------------------------------------------------


def test_mathml_says_what_the_formula_says() -> None:
    made = ElementTree.fromstring(formulas.mathml(r"\frac{a}{b^2} \le \sqrt{c}", block=True))
    tag = "{http://www.w3.org/1998/Math/MathML}"
    fraction = next(made.iter(f"{tag}mfrac"))
    assert ["".join(part.itertext()) for part in fraction] == ["a", "b2"]
    assert "".join(made.itertext()) == "ab2≤c"
    assert made.get("display") == "block" and made.get("alttext") == r"\frac{a}{b^2} \le \sqrt{c}"


@pytest.mark.parametrize("tex", [r"\nonsense x", r"\frac{1}", "x^", "{a", "a}", r"\left( a"])
def test_a_formula_that_does_not_convert_is_refused(tex: str) -> None:
    with pytest.raises(ValueError, match=r"^formula must be .*, got '"):
        formulas.mathml(tex)


@pytest.mark.parametrize(
    ("tex", "spaces"),
    [
        (r"\sin q", 1),
        (r"l_2 \sin q_2", 2),
        (r"2\cos\theta", 2),
        (r"\log p(x)", 1),
        (r"\exp(x)", 0),
        (r"\sin^2 q", 1),
        (r"\sin q \cos q", 3),
        (r"s i n", 0),
        (r"-\sin(q)", 0),
        (r"\tan^2(q/2)", 0),
        (r"\log_2(n)", 0),
    ],
)
def test_names_of_functions_stand_apart(tex: str, spaces: int) -> None:
    made = formulas.mathml(tex)
    assert made.count("<mspace") == spaces
    # A browser refuses a power of three parts: the space is never inside.
    for element in ElementTree.fromstring(made).iter():
        if element.tag.endswith(("}msub", "}msup")):
            assert len(element) == 2


def test_only_text_has_formulas() -> None:
    text = r'<b title="$a$">$x &lt; y$</b> <code>$b$</code> <!-- $c$ --> 3\$ $$d$$'
    made = formulas.in_html(text)
    assert made.count("<math") == 2 and 'alttext="x &lt; y"' in made and 'display="block"' in made
    for selected in ('title="$a$"', "<code>$b$</code>", "<!-- $c$ -->", r"3\$"):
        assert selected in made


# --- What it refuses ------------------------------------------------------------------------------


def faults(tmp_path: Path, *cells: nbformat.NotebookNode) -> list[str]:
    """What is wrong with a notebook of these cells."""
    path = tmp_path / "77_some.ipynb"
    nbformat.write(new_notebook(cells=list(cells)), path)
    return notebooks.page(path).faults


def executed(source: str, data: dict[str, str]) -> nbformat.NotebookNode:
    return new_code_cell(source, execution_count=1, outputs=[new_output("display_data", data)])


def test_a_notebook_that_was_not_executed(tmp_path: Path) -> None:
    assert faults(tmp_path, new_code_cell("1 + 1", execution_count=1)) == []
    assert faults(tmp_path, new_markdown_cell("x"), new_code_cell("1 + 1")) == [
        "77_some.ipynb, cell 1: it was not executed; run `make notebooks`"
    ]


def test_an_output_without_a_picture(tmp_path: Path) -> None:
    label = declaration.model("rigid_body.top").paper.label
    whole = {"text/plain": f"{label}\n  time: 0.00 s", "image/png": PNG}
    assert faults(tmp_path, executed('simulation("top")', whole)) == []
    without = {"text/plain": whole["text/plain"]}
    assert faults(tmp_path, executed('simulation("top")', without)) == [
        f"77_some.ipynb, cell 0: the simulation {label!r} has no picture"
    ]
    figure = executed("plt.show()", {"text/plain": "<Figure size 640x480 with 1 Axes>"})
    assert faults(tmp_path, figure) == [
        "77_some.ipynb, cell 0: its output '<Figure size 640x480 with 1 Axes>' has no picture"
    ]


def test_a_film_is_the_picture_of_the_simulation_below_it(tmp_path: Path) -> None:
    label = declaration.model("rigid_body.top").paper.label
    film = new_markdown_cell(
        f"![{label}](attachment:rigid_body.top.png)\n\nBelow.",
        attachments={"rigid_body.top.png": {"image/png": PNG}},
    )
    below, again = (executed("simulation()", {"text/plain": label}) for _ in range(2))
    assert faults(tmp_path, film, below) == []
    assert len(faults(tmp_path, film, below, again)) == 1  # it is used once


def test_a_simulation_without_a_module(tmp_path: Path) -> None:
    cell = executed("simulation()", {"text/plain": "A unicycle\n  time: 0 s", "image/png": PNG})
    assert faults(tmp_path, cell) == [
        "77_some.ipynb, cell 0: no module has the simulation 'A unicycle'"
    ]


def test_a_simulation_that_is_neither_compiled_nor_recorded(tmp_path: Path, monkeypatch) -> None:
    cell = executed(
        "simulation()",
        {"text/plain": declaration.model("rigid_body.top").paper.label, "image/png": PNG},
    )
    path = tmp_path / "01_rigid_body.ipynb"
    nbformat.write(new_notebook(cells=[cell]), path)
    made = {"01_rigid_body": notebooks.page(path)}
    monkeypatch.setattr(declaration, "module", lambda name: tmp_path / "nothing.wasm")
    monkeypatch.setattr(reference, "claims", lambda *_: "")  # not asked here
    with pytest.raises(build.Unbuildable, match=r"^rigid_body.top: .* must be one with a .wasm"):
        build.write_sources(tmp_path, made)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[x](nowhere.ipynb)", "the link to nowhere.ipynb leads nowhere"),
        (
            "![x](../docs/charts/nothing.png)",
            "the link to ../docs/charts/nothing.png leads nowhere",
        ),
        ("[x](../../../etc/hosts)", "the link to ../../../etc/hosts leads nowhere"),
    ],
)
def test_a_link_to_nowhere(tmp_path: Path, text: str, expected: str) -> None:
    assert faults(tmp_path, new_markdown_cell(text)) == [f"77_some.ipynb, cell 0: {expected}"]


def test_a_link_to_a_file_of_the_project_is_shown_as_its_path() -> None:
    result: list[str] = []
    text = "[the code](../course/role.py), `[kept](x)`, [a page](01_rigid_body.ipynb#x), [w](https://a)"
    made = notebooks.linked(text, ROOT / "notebooks", "here", result)
    assert made == text.replace("[the code](../course/role.py)", "the code (`course/role.py`)")
    assert result == []


def test_an_anchor_to_nowhere_and_a_load_from_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<p id="top"><a href="b.html#end">b</a><a href="#top">a</a>')
    (tmp_path / "b.html").write_text('<p id="end"><img src="data:image/png;base64,">')
    assert build.broken(tmp_path) == []
    (tmp_path / "b.html").write_text(
        '<a href="a.html#no">x</a><a href="c.html">x</a><script src="https://a.b/c.js"></script>'
    )
    assert build.broken(tmp_path) == [
        "a.html: the link to b.html#end leads to no place on that page",
        "b.html: it loads https://a.b/c.js, from elsewhere",
        "b.html: the link to a.html#no leads to no place on that page",
        "b.html: the link to c.html leads nowhere",
    ]


@pytest.mark.slow
def test_a_page_with_a_wrong_formula_or_link_is_named(tmp_path: Path) -> None:
    source = tmp_path / "source"
    (source / "_static").mkdir(parents=True)
    (source / "_static" / "course.css").touch()
    (source / "_static" / "page.js").touch()
    (source / "index.md").write_text("# T\n\n$\\nonsense$ and [a](b.md)\n\n<p>$\\odd$</p>\n")
    with pytest.raises(build.Unbuildable) as rejected:
        build.sphinx(source, tmp_path / "html", {})
    message = sorted(html.unescape(fault) for fault in rejected.value.faults)
    assert len(message) == 3
    assert any("index: formula must be" in m and "got '\\\\nonsense'" in m for m in message)
    assert any("index: formula must be" in m and "got '\\\\odd'" in m for m in message)
    assert any("b.md" in line for line in message)


@pytest.mark.slow
@pytest.mark.parametrize("topic", ["control", "learning"])
def test_the_pool_of_a_checkpoint_becomes_a_page(tmp_path: Path, topic: str) -> None:
    """Every question with its answers and formulas, five of them visible without a script."""
    (file,) = [chapter.notebook for chapter in CHAPTERS if chapter.topic == topic]
    made = notebooks.page(ROOT / file)
    (cell,) = [one for one in made.notebook.cells if one.source.startswith("checkpoint(")]
    assert "remove-input" in cell.metadata.tags
    made.notebook.cells = [new_markdown_cell("# T"), cell]
    source = tmp_path / "source"
    (source / "_static").mkdir(parents=True)
    (source / "_static" / "course.css").touch()
    (source / "_static" / "page.js").touch()
    nbformat.write(made.notebook, source / "index.ipynb")
    build.sphinx(source, tmp_path / "html", {})
    box = soup(tmp_path / "html" / "index.html").select_one(".course-checkpoint")
    assert box is not None
    questions = box.select(".checkpoint-question")
    pool = draws.pool(topic)
    assert [one["data-key"] for one in questions] == [question.key for question in pool]
    visible = {one["data-key"] for one in questions if not one.has_attr("hidden")}
    assert visible == {question.key for question in draws.draw(topic, 1)}
    for one, question in zip(questions, pool, strict=True):
        right = [each for each in one.select("details.answer") if each["data-right"] == "yes"]
        assert len(right) == (0 if isinstance(question, draws.Estimate) else 1)
        assert one.select_one(":scope > details.why") is not None
    assert len(box.select("math")) > 20
    for code in box.select("code, math, annotation"):
        code.decompose()
    assert not re.search(r"[$`]|\*\*", box.get_text())


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    with pytest.raises(ValueError, match=r"^target must be"):
        build.build(tmp_path, work=tmp_path / "work")
    assert (tmp_path / "mine.txt").read_text() == "kept"


def test_charts_are_read_where_they_lie() -> None:
    assert charts.CHARTS is not None
    result: list[str] = []
    text = reference.charts(result)
    assert result == [] and f"]({notebooks.CHARTS}/age_precision.png)" in text
