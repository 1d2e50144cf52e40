"""The pages beside the chapters: claims, charts, cards, questions, words and symbols, as Markdown.

Each is made from what the course has in its package; figures are those on record.
"""

import html
import importlib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from course import CHAPTERS, Chapter, cards, derivations
from course.check import invalid
from course.derivations.answer import Symbol
from course.simulations import declaration
from course.site import notebooks

Anchors = Mapping[str, set[str]]  # page -> what it can be entered at
_WHY = re.compile(
    r'<details class="why"><summary>[^<]*</summary>\n\n\*\*(.*?)\*\* (.*?)\n\n<details>', re.S
)

# A card that can be answered; a compact one has no answers.
_CARD = re.compile(
    r'<div class="card"[^>]* data-card="([\w.]+)"[^>]*>'
    r'(?:(?!<div class="card").)*?<details[^>]* data-answer=',
    re.S,
)


def page_of(chapter: Chapter) -> str:
    """Return the name of a chapter's page."""
    return Path(chapter.notebook).stem


def _title(chapter: Chapter) -> str:
    return f"{chapter.number} · {chapter.title}"


def _link(chapter: Chapter, anchor: str, anchors: Anchors, text: str) -> str:
    """Return a link into a chapter's page, where it has the anchor; else to its top."""
    page = page_of(chapter)
    inner = f"#{anchor}" if anchor in anchors.get(page, ()) else ""
    return f'<a href="{page}.html{inner}">{text}</a>'


def _verdict(claim: derivations.Claim, shown: Mapping[str, str]) -> tuple[str, str]:
    """Return the verdict on a claim and the correct statement, as Markdown.

    They come from its card, or from the record.
    """
    if claim.id in shown:
        # The card of a notebook has the verdict as readers see it there.
        if not (report := _WHY.search(shown[claim.id])):
            raise invalid(f"card of {claim.id}", shown[claim.id][:80], "one with an explanation")
        return report[1], report[2]
    outcome = derivations.recorded(claim.id, claim.file)
    return cards.tex(derivations.Block(outcome).verdict), cards.tex(outcome.corrected)


def claims(anchors: Anchors, shown: Mapping[str, str]) -> str:
    """Return the page of every claim of the course.

    Args:
        anchors: of the chapters.
        shown: Markdown of the cards in the notebooks, by id.
    """
    everything = derivations.claims()
    parts = [
        "# The claims",
        f"{len(everything)} common statements, each with its verdict and what is true "
        "instead. Each is settled by a check: `python -m course.derivations --id NAME` runs it.",
    ]
    for chapter in CHAPTERS:
        mine = [claim for claim in everything if claim.chapter == chapter.number]
        parts += [f"## {_title(chapter)}"] if mine else []
        for claim in mine:
            verdict, corrected = _verdict(claim, shown)
            settled = derivations.recorded(claim.id, claim.file).finding.verdict.value
            where = _link(chapter, f"claim-{claim.id}", anchors, f"chapter {chapter.number}")
            source = f" · {html.escape(claim.source)}" if claim.source else ""
            parts += [
                f'<div class="course-claim" id="{claim.id}" data-chapter="{chapter.number}" '
                f'data-verdict="{settled}">',
                f"“{cards.tex(claim.claim)}”",
                '<div class="course-verdict">',
                f"**{verdict}** {corrected}",
                "</div>",
                f'<p class="course-source"><code>{claim.id}</code> · {where}{source}</p>',
                "</div>",
            ]
    return "\n\n".join(parts) + "\n"


def charts(faults: list[str]) -> str:
    """Return the page of every chart: the gallery of the project, `docs/charts/README.md`.

    Args:
        faults: gets a sentence for each link that leads nowhere.
    """
    return text(notebooks.ROOT / "docs" / "charts" / "README.md", faults)


def text(path: Path, faults: list[str]) -> str:
    """Return a text of the project as a page.

    Args:
        path: of the Markdown file.
        faults: gets a sentence for each link that leads nowhere.
    """
    return notebooks.linked(path.read_text(encoding="utf-8"), path.parent, path.name, faults)


def _symbols(chapter: Chapter) -> dict[str, str]:
    """Return the symbols of a chapter's claims: what each means, in each file that says so."""
    meanings: dict[str, dict[str, None]] = {}
    for file in dict.fromkeys(c.file for c in derivations.claims() if c.chapter == chapter.number):
        module = importlib.import_module(f"course.derivations.{file}")
        # Several files may explain a symbol differently: all meanings are listed, each once.
        table: Mapping[str, Symbol] = getattr(module, "SYMBOLS", {})
        for name, symbol in table.items():
            meanings.setdefault(name, {})[symbol.meaning] = None
    ordered = sorted(meanings, key=lambda name: (name.lower(), name))
    return {name: "; ".join(meanings[name]) for name in ordered}


def glossary(anchors: Anchors) -> str:
    """Return the glossary: terms with where they are defined, symbols with their meaning."""
    parts = [
        "# Words and symbols",
        "Each word is defined where its link leads. After some words, *see* names the term under "
        "which the chapter explains them. A symbol means what its chapter says; names are as you "
        "type them into a formula.",
        "## Words",
    ]
    # A term may be defined in several chapters: one entry with a link to each. Another
    # word for a term leads to where that term is defined.
    where: dict[str, list[str]] = {}
    for chapter in CHAPTERS:
        names = {term: term for term in cards.vocabulary(chapter.topic)}
        for word, term in {**names, **cards.synonyms(chapter.topic)}.items():
            anchor = f"term-{notebooks.slug(term)}"
            link = _link(chapter, anchor, anchors, f"chapter {chapter.number}")
            where.setdefault(word, []).append(link if word == term else f"see *{term}*, {link}")
    ordered = sorted(where, key=lambda term: (term.lower(), term))
    parts.append("\n".join(f"* **{term}**: {', '.join(where[term])}" for term in ordered))
    for chapter in CHAPTERS:
        if symbols := _symbols(chapter):
            parts += [
                f"## Symbols of chapter {chapter.number}",
                "| symbol | typed | meaning |\n"
                "|---|---|---|\n"
                + "\n".join(
                    f"| {cards.tex(name)} | `{name}` | {cards.tex(meaning)} |"
                    for name, meaning in symbols.items()
                ),
            ]
    return "\n\n".join(parts) + "\n"


def questions() -> str:
    """Return the page of every chapter's interview questions, with what unfolds."""
    parts = [
        "# The questions of an interview",
        "Answer aloud, then open.  `drills interview` asks "
        "them with a clock, and a partner's rubric.",
    ]
    for chapter in CHAPTERS:
        requested = str(cards.interview(chapter.topic)._repr_markdown_())
        parts += [
            f"## {_title(chapter)}",
            # The notebook's headings are one level lower than those of this page.
            requested.replace("\n#### ", "\n### ").replace("#### ", "### ", 1),
        ]
    return "\n\n".join(parts) + "\n"


def predictions(anchors: Anchors) -> str:
    """Return the page of every chapter's cards: a question, and answers that unfold."""
    parts = [
        "# The cards",
        "A question each; click the answer that you believe. `drills review` "
        "asks again when you are about to forget.",
    ]
    for chapter in CHAPTERS:
        parts.append(f"## {_title(chapter)}")
        for name in cards.predictions(chapter.topic):
            parts.append(str(cards.predict(name)._repr_markdown_()))
            link = _link(chapter, f"card-{name}", anchors, f"chapter {chapter.number}")
            parts.append(f'<p class="course-source">{link}</p>')
    return "\n\n".join(parts) + "\n"


def scores(pages: Mapping[str, notebooks.Page]) -> str:
    """Return where a reader sees how many cards of each chapter are answered; page.js fills it in.

    Args:
        pages: of the notebooks, by name.
    """
    rows = []
    for chapter in CHAPTERS:
        page = page_of(chapter)
        outputs = [out for cell in pages[page].notebook.cells for out in cell.get("outputs", ())]
        texts = [out.get("data", {}).get("text/markdown", "") for out in outputs]
        # Only cards that can be answered count; the page's script compares them with stored
        # answers.
        answered = [card for text in texts for card in _CARD.findall(text)]
        names = " ".join(dict.fromkeys(answered))
        rows.append(
            f'<li data-cards="{names}"><a href="{page}.html">{_title(chapter)}</a> '
            '<span class="score"></span></li>'
        )
    listed = "\n".join(rows)
    return f'## Your answers\n\n<div class="course-scores"><ul>\n{listed}\n</ul></div>'


def simulations_table(pages: Mapping[str, Sequence[str]]) -> str:
    """Return a Markdown table of the simulations that move and those that show a recording.

    Args:
        pages: name of a page, without .ipynb -> the simulations on it; pages that are no chapter
            are passed over.

    Raises:
        ValueError: one is neither compiled nor recorded.
    """
    rows = ["| simulation | chapter | in the page |", "|---|---|---|"]
    titles = {page_of(chapter): _title(chapter) for chapter in CHAPTERS}
    for name in declaration.names():
        where = [page for page, shown in pages.items() if name in shown and page in titles]
        links = ", ".join(f"[{titles[page]}]({page}.ipynb)" for page in where)
        # Simulations that no chapter shows are not listed.
        if links:
            why = declaration.why_recorded(name)
            kind = f"recorded: {why}" if why else "live"
            rows.append(f"| {declaration.model(name).title} | {links} | {kind} |")
    return "\n".join(rows)
