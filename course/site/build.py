"""The site in one go: the pages are written, Sphinx makes HTML of them, and every link is followed.

Nothing is run and nothing fetched; what is written depends on the committed files alone, so two
builds are the same to the byte.
"""

import functools
import html.parser
import io
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat

from course import CHAPTERS, cards
from course.check import invalid
from course.simulations import declaration
from course.site import charts, notebooks, reference

HERE = Path(__file__).parent
WORK = notebooks.ROOT / "build" / "site"
TARGET = notebooks.ROOT / "site"
# What a reader finds beside the chapters, in the order of the side bar.
BESIDE = ("claims", "charts", "cards", "questions", "glossary")
DOORS = tuple(notebooks.TEXTS)
STILL = f"{notebooks.FILM.stem}.still.png"  # for who wants no motion
_CLAIM = re.compile(r' id="claim-(\w+)"')  # where the first tag of a card goes on
_LEFT_OUT = (".buildinfo", "objects.inv", "genindex.html")


class Unbuildable(Exception):
    """The site cannot be built; one sentence for each reason."""

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__("\n".join(faults))
        self.faults = list(faults)


def _contents() -> str:
    """Return the side bar, as a cell of the index that is not seen."""
    chapters = [reference.page_of(chapter) for chapter in CHAPTERS]
    return "\n\n".join(
        f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n" + "\n".join(pages) + "\n```"
        for caption, pages in (
            ("Chapters", chapters),
            ("Beside them", BESIDE),
            ("Practise, use the code", DOORS),
        )
    )


def _shown(page: notebooks.Page) -> dict[str, str]:
    """Return the cards of claims on a page, by id."""
    result: dict[str, str] = {}
    for cell in page.notebook.cells:
        for output in cell.get("outputs", ()):
            # Cards are found in the Markdown output of saved cells.
            markdown = output.get("data", {}).get("text/markdown", "")
            for card in markdown.split('<div class="card"')[1:]:
                if name := _CLAIM.match(card):
                    result.setdefault(name[1], card)
    return result


def pages(folder: Path) -> dict[str, notebooks.Page]:
    """Return the page of each chapter and of the index, by name.

    Args:
        folder: of the notebooks.

    Raises:
        Unbuildable: a notebook has a fault.
    """
    made = {"index": notebooks.page(folder / "index.ipynb")}
    for chapter in CHAPTERS:
        path = folder / Path(chapter.notebook).name
        made[path.stem] = notebooks.page(path, cards.vocabulary(chapter.topic))
    if faults := [fault for page in made.values() for fault in page.faults]:
        raise Unbuildable(faults)
    return made


def write_sources(folder: Path, made: Mapping[str, notebooks.Page]) -> None:
    """Write what Sphinx reads.

    Args:
        folder: an empty one.
        made: the pages of the notebooks.
    """
    anchors = {name: page.anchors for name, page in made.items()}
    shown = {id: card for page in made.values() for id, card in _shown(page).items()}
    faults: list[str] = []
    texts = {
        "claims": reference.claims(anchors, shown),
        "charts": reference.charts(faults),
        "cards": reference.predictions(anchors),
        "questions": reference.questions(),
        "glossary": reference.glossary(anchors),
        **{name: reference.text(path, faults) for name, path in notebooks.TEXTS.items()},
    }
    # Check every simulation first, so that all faults are reported together.
    names = {name for page in made.values() for name in page.simulations}
    for name in sorted(names):
        try:
            declaration.why_recorded(name)
        except ValueError as problem:
            faults.append(f"{name}: {problem}")
    if faults:
        raise Unbuildable(faults)
    moving = reference.moving({name: page.simulations for name, page in made.items()})
    added = {
        "scores": reference.scores(made),
        "moving": "## What moves on this site\n\n<details><summary>Every simulation, live or "
        f"recorded</summary>\n\n{moving}\n\n</details>",
        "contents": _contents(),
    }
    for id, text in added.items():
        made["index"].notebook.cells.append(nbformat.v4.new_markdown_cell(text, id=id))
    for name, page in made.items():
        nbformat.write(page.notebook, folder / f"{name}.ipynb")
    for name, text in texts.items():
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
    wide = folder / notebooks.CHARTS
    wide.mkdir()
    for picture in (notebooks.ROOT / "docs" / "charts").glob("*.png"):
        shutil.copy(picture, wide)
    pictures = folder / notebooks.PICTURES
    pictures.mkdir(parents=True)
    for page in made.values():
        for file, png in page.pictures.items():
            (pictures / file).write_bytes(png)
    shutil.copy(notebooks.FILM, pictures)
    (pictures / STILL).write_bytes(notebooks.first_picture(notebooks.FILM.read_bytes()))
    static = folder / "_static"
    shutil.copy(HERE / "course.css", static)
    shutil.copy(HERE / "page.js", static)
    (static / "live.js").write_text(declaration.script(), encoding="utf-8")


@contextmanager
def scripts(names: Iterable[str]) -> Iterator[Iterator[tuple[str, str]]]:
    """Return each simulation's script, (name, text), made in parallel with the other work.

    Args:
        names: of the simulations.
    """
    # What is recorded takes long, so it comes first.
    ordered = sorted(set(names), key=lambda name: (declaration.is_live(name), name))
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        yield zip(ordered, pool.map(declaration.bundle, ordered), strict=True)


def sphinx(source: Path, out: Path, simulations: Mapping[str, Sequence[str]]) -> None:
    """Make HTML of the sources.

    Args:
        source: their folder.
        out: an empty folder beside it.
        simulations: those on each page.

    Raises:
        Unbuildable: Sphinx had something to say, such as a formula that does not convert.
    """
    from sphinx.application import Sphinx
    from sphinx.util.docutils import docutils_namespace, patch_docutils

    # A fixed date makes the build reproducible.
    os.environ["SOURCE_DATE_EPOCH"] = "0"
    report = io.StringIO()
    settings = {"html_static_path": [str(source / "_static")], "course_simulations": simulations}
    with patch_docutils(HERE), docutils_namespace():
        app = Sphinx(
            source, HERE, out, out.with_name("doctrees"), "html", settings, None, report, True
        )
        app.build()
    # Every warning of Sphinx is a fault: a site with broken formulas is not published.
    if faults := report.getvalue().replace(f"{source}{os.sep}", "").splitlines():
        raise Unbuildable(faults)


class _Read(html.parser.HTMLParser):
    """What a page can be entered at, what it leads to, and what it loads."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        report = {name: value or "" for name, value in attributes}
        self.anchors.add(report.get("id", ""))
        address = report.get("src") or report.get("srcset") or report.get("href") or ""
        if not address:
            return
        # What the browser loads by itself must be local; links may lead elsewhere.
        loads = tag in ("img", "script", "iframe", "source") or (
            tag == "link" and report.get("rel") in ("stylesheet", "icon", "preload")
        )
        (self.loaded if loads else self.links).append(address)


def read(page: Path) -> _Read:
    """Return the addresses that an HTML page links to and loads."""
    result = _Read()
    result.feed(page.read_text(encoding="utf-8"))
    return result


def broken(site: Path) -> list[str]:
    """Return the faults of a site's addresses, one sentence each: missing or on another host."""
    # Pages are read once, although many links lead to them.
    known = functools.cache(read)
    faults = []
    for page in sorted(site.rglob("*.html")):
        where = page.relative_to(site).as_posix()
        for address in known(page).loaded:
            if urlsplit(address).scheme not in ("", "data") or address.startswith("//"):
                faults.append(f"{where}: it loads {address}, from elsewhere")
        for address in [*known(page).links, *known(page).loaded]:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            # Resolve the address like a browser with the site's root, and keep it inside the site.
            file = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            if not file.is_file() or not file.is_relative_to(site.resolve()):
                faults.append(f"{where}: the link to {address} leads nowhere")
            elif parts.fragment and file.suffix == ".html":
                if unquote(parts.fragment) not in known(file).anchors:
                    faults.append(f"{where}: the link to {address} leads to no place on that page")
    return faults


def build(
    target: Path = TARGET, folder: Path = notebooks.ROOT / "notebooks", work: Path = WORK
) -> None:
    """Build the site.

    Args:
        target: the folder that it becomes; one that is there is replaced if it holds a site.
        folder: of the notebooks.
        work: what is needed on the way; emptied.

    Raises:
        Unbuildable: with a sentence for each reason; `target` is left as it was.
        ValueError: `target` holds something else.
    """
    # Refuse to delete a folder that is not a site of ours.
    if target.exists() and any(target.iterdir()) and not (target / "searchindex.js").is_file():
        raise invalid("target", str(target), "an empty folder, or one with a site")
    shutil.rmtree(work, ignore_errors=True)
    source, out = work / "source", work / "html"
    source.mkdir(parents=True)
    made = pages(folder)
    write_sources(source, made)
    shown = sorted(path.stem for path in (source / notebooks.CHARTS).glob("*.png"))
    # Simulations and charts are made in other processes while Sphinx runs.
    with (
        scripts(name for page in made.values() for name in page.simulations) as simulations,
        charts.pictures(shown) as narrow,
    ):
        sphinx(source, out, {name: page.simulations for name, page in made.items()})
        (out / "_static" / "charts").mkdir()
        for name, text in narrow:
            (out / "_static" / "charts" / f"{name}.svg").write_text(text, encoding="utf-8")
        (out / "_static" / "simulations").mkdir()
        for name, text in simulations:
            place = out / "_static" / "simulations"
            (place / f"{name}.js").write_text(text, encoding="utf-8")
            if not declaration.is_live(name):
                (place / f"{name}.film.js").write_text(declaration.film(name), encoding="utf-8")
    for name in _LEFT_OUT:
        (out / name).unlink(missing_ok=True)
    (out / "_sources").rmdir()
    # Only a site without faults replaces the one that is there.
    if faults := broken(out):
        raise Unbuildable(faults)
    shutil.rmtree(target, ignore_errors=True)
    shutil.move(out, target)
