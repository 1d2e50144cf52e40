"""The site in one go: the pages are written, Sphinx makes HTML of them, and every link is followed.

Nothing is run and nothing fetched; what is written depends on the committed files alone, so two
builds are the same to the byte.
"""

import filecmp
import functools
import gc
import hashlib
import html
import importlib.metadata
import io
import os
import re
import shutil
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat

from course import CHAPTERS, cards
from course.check import invalid
from course.simulations import declaration
from course.site import charts, modules, notebooks, reference

HERE = Path(__file__).parent
WORK = notebooks.ROOT / "build" / "site"
TARGET = notebooks.ROOT / "site"
# What a reader finds beside the chapters, in the order of the side bar.
BESIDE = ("claims", "charts", "cards", "questions", "glossary")
DOORS = tuple(notebooks.TEXTS)
STILL = f"{notebooks.FILM.stem}.still.png"  # for who wants no motion
_CLAIM = re.compile(r' id="claim-(\w+)"')  # where the first tag of a card goes on
_PICTURE = re.compile(
    r"<(?:img|source)\b(?=[^>]* src(?:set)?=\"([^\":]+\.(?:png|svg))\")[^>]*?(?= ?/?>)"
)
_WIDTH = re.compile(r' width="(\d+)"')
_POINTS = re.compile(rb'<svg [^>]*?width="([\d.]+)pt" height="([\d.]+)pt"')
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
            ("Practise, use the code", (*DOORS, "reference")),
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
        made[path.stem] = notebooks.page(path, cards.vocabulary(chapter.topic), chapter)
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
    moving = reference.simulations_table({name: page.simulations for name, page in made.items()})
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
    for group in modules.GROUPS:
        text = modules.page(group, anchors)
        (folder / f"{group.page}.rst").write_text(text, encoding="utf-8")
    (folder / "reference.rst").write_text(modules.index(), encoding="utf-8")
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
    shutil.copy(notebooks.ROBOT, pictures)
    for picture in notebooks.TEXTS["mathematics"].parent.glob("*.png"):
        shutil.copy(picture, pictures)
    (pictures / STILL).write_bytes(notebooks.first_picture(notebooks.FILM.read_bytes()))
    static = folder / "_static"
    for name in ("course.css", "page.js", "math.woff2", "math_license.txt"):
        shutil.copy(HERE / name, static)
    (static / "live.js").write_text(declaration.script(), encoding="utf-8")


def script(name: str) -> dict[str, str]:
    """Return the files of a simulation, by what follows its name: its script, and its recording."""
    files = {".js": declaration.bundle(name)}
    if not declaration.is_live(name):
        files[".film.js"] = declaration.film(name)
    return files


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
    settings = {
        "html_static_path": [str(source / "_static")],
        "html_search_scorer": str(HERE / "scorer.js"),
        "course_simulations": simulations,
    }
    # Millions of nodes live until the end: searching them for garbage takes a fifth of the time,
    # and collecting them afterwards takes seconds more. The process ends soon.
    collecting = gc.isenabled()
    gc.disable()
    try:
        with patch_docutils(HERE), docutils_namespace():
            trees = out.with_name("doctrees")
            app = Sphinx(source, HERE, out, trees, "html", settings, None, report)
            app.build()
    finally:
        gc.freeze()
        if collecting:
            gc.enable()
    # Every warning of Sphinx is a fault: a site with broken formulas is not published.
    if faults := report.getvalue().replace(f"{source}{os.sep}", "").splitlines():
        raise Unbuildable(faults)


def picture_size(path: Path) -> tuple[int, int] | None:
    """Return the width and the height of a PNG or an SVG in CSS pixels; None where it has none."""
    head = path.read_bytes()[:2000]
    if head[:4] == b"\x89PNG":
        width, height = struct.unpack(">II", head[16:24])
        return width, height
    points = _POINTS.search(head)
    # A CSS pixel is three quarters of a point.
    return (round(float(points[1]) / 0.75), round(float(points[2]) / 0.75)) if points else None


def reserved(text: str, folder: Path) -> str:
    """Return the HTML of a page whose pictures state their size.

    A picture that waits until it comes into sight then takes up its room before it is loaded:
    otherwise the page grows while a link leads down to a section, and the reader ends elsewhere.

    Args:
        text: the page.
        folder: what the addresses of its pictures start from.
    """

    def stated(match: re.Match[str]) -> str:
        tag, path = match[0], folder / unquote(match[1])
        size = picture_size(path) if path.is_file() and " height=" not in tag else None
        if size is None:
            return tag
        width = int(given[1]) if (given := _WIDTH.search(tag)) else size[0]
        height = round(size[1] * width / size[0])
        return f'{_WIDTH.sub("", tag)} width="{width}" height="{height}"'

    return _PICTURE.sub(stated, text)


_TAG = re.compile(r"<([a-zA-Z][\w-]*)((?:[^<>\"']|\"[^\"]*\"|'[^']*')*)>")
_ATTRIBUTE = re.compile(r"([\w-]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
_ADDRESSES = ("src", "srcset", "href")


@dataclass
class _Read:
    """What a page can be entered at, what it leads to, and what it loads."""

    anchors: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    loaded: list[str] = field(default_factory=list)


def read(page: Path) -> _Read:
    """Return the addresses that an HTML page links to and loads."""
    result = _Read()
    for tag, text in _TAG.findall(page.read_text(encoding="utf-8")):
        if "=" not in text:
            continue
        report = {
            name: html.unescape(one or other) for name, one, other in _ATTRIBUTE.findall(text)
        }
        result.anchors.add(report.get("id", ""))
        address = next((report[name] for name in _ADDRESSES if report.get(name)), "")
        if not address:
            continue
        # What the browser loads by itself must be local; links may lead elsewhere.
        loads = tag in ("img", "script", "iframe", "source") or (
            tag == "link" and report.get("rel") in ("stylesheet", "icon", "preload")
        )
        (result.loaded if loads else result.links).append(address)
    return result


def broken(site: Path, known: Callable[[Path], _Read] | None = None) -> list[str]:
    """Return the faults of a site's addresses, one sentence each: missing or on another host.

    Args:
        site: its folder.
        known: `read`, or one that remembers what it has read.
    """
    # Pages are read once, although many links lead to them; an address is looked up once.
    known = known or functools.cache(read)
    whole = site.resolve()

    @functools.cache
    def file_of(folder: Path, path: str) -> Path | None:
        """Return the file at an address like a browser with the site's root; None outside of it."""
        file = (folder / unquote(path)).resolve()
        return file if file.is_file() and file.is_relative_to(whole) else None

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
            file = file_of(page.parent, parts.path) if parts.path else page
            if file is None:
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
        target: the folder that it becomes; one that is there is brought up to date if it holds a
            site: files that stay the same are not written again.
        folder: of the notebooks.
        work: what is needed on the way. It is kept: the next build makes only the pages anew whose
            sources have changed, or all of them if something changed that every page shows.

    Raises:
        Unbuildable: with a sentence for each reason; `target` is left as it was.
        ValueError: `target` holds something else.
    """
    # Refuse to change a folder that is not a site of ours.
    if target.exists() and any(target.iterdir()) and not (target / "searchindex.js").is_file():
        raise invalid("target", str(target), "an empty folder, or one with a site")
    made = pages(folder)
    fresh = work / "fresh"
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    write_sources(fresh, made)
    on_page = {name: page.simulations for name, page in made.items()}
    render(fresh, target, work, on_page, _shared(fresh, on_page))


def render(
    fresh: Path, target: Path, work: Path, simulations: Mapping[str, Sequence[str]], key: str
) -> None:
    """Make the site of its sources; what has not changed since the last time is left alone.

    Args:
        fresh: the folder of the sources; it is used up.
        target: the folder that the site becomes.
        work: what an earlier build left, and this one leaves.
        simulations: those on each page.
        key: what all pages depend on. Where it has changed, all are made anew.

    Raises:
        Unbuildable: with a sentence for each reason; `target` is left as it was.
    """
    noted = work / "key"
    source, built = work / "source", work / "html"
    if not noted.is_file() or noted.read_text(encoding="utf-8") != key:
        for part in (source, built, work / "doctrees"):
            shutil.rmtree(part, ignore_errors=True)
    noted.unlink(missing_ok=True)  # until the build has ended well
    renew(fresh, source)
    shown = sorted(path.stem for path in (source / notebooks.CHARTS).glob("*.png"))
    # Charts are drawn in other processes while Sphinx runs.
    with charts.pictures(shown) as narrow:
        sphinx(source, built, simulations)
        out = work.resolve() / "site"
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(built, out)
        (out / "_static" / "charts").mkdir()
        for name, text in narrow:
            (out / "_static" / "charts" / f"{name}.svg").write_text(text, encoding="utf-8")
        (out / "_static" / "simulations").mkdir()
        for name in sorted({name for names in simulations.values() for name in names}):
            for ending, text in script(name).items():
                place = out / "_static" / "simulations" / f"{name}{ending}"
                place.write_text(text, encoding="utf-8")
    for name in _LEFT_OUT:
        (out / name).unlink(missing_ok=True)
    (out / "_sources").rmdir()
    for page in out.glob("*.html"):
        page.write_text(reserved(page.read_text(encoding="utf-8"), out), encoding="utf-8")
    known = functools.cache(read)
    faults, loaded = broken(out, known), _loaded(out, known)
    # Only a site without faults replaces the one that is there.
    if faults:
        raise Unbuildable(faults)
    for pictures in (out / "_images", out / notebooks.PICTURES):
        for picture in pictures.glob("*"):
            if picture not in loaded:
                picture.unlink()  # of an earlier version of a page
    renew(out, target)
    noted.write_text(key, encoding="utf-8")


def renew(fresh: Path, source: Path) -> None:
    """Bring a folder up to date with another, whose files it takes; equal files are left alone."""
    new = {path.relative_to(fresh) for path in fresh.rglob("*") if path.is_file()}
    if source.is_dir():
        for path in [path for path in source.rglob("*") if path.is_file()]:
            if path.relative_to(source) not in new:
                path.unlink()
        for path in sorted(source.rglob("*"), reverse=True):
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
    for name in sorted(new):
        old = source / name
        if not (old.is_file() and filecmp.cmp(fresh / name, old, shallow=False)):
            old.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(fresh / name, old)
    shutil.rmtree(fresh)


def _shared(source: Path, simulations: Mapping[str, Sequence[str]]) -> str:
    """Return a hash of what every page depends on: looks, side bar, titles, names of the code."""
    state = hashlib.sha256()
    for package in ("sphinx", "furo", "myst-nb", "docutils"):
        state.update(importlib.metadata.version(package).encode())
    for path in (*sorted(HERE.glob("*.*")), *sorted((source / "_static").glob("*.*"))):
        state.update(path.read_bytes())
    for path in sorted(source.glob("*.*")):
        state.update(f"{path.name}: {_title(path)}\n".encode())
    state.update(repr(sorted(simulations.items())).encode())
    state.update(repr(sorted(modules.addresses().items())).encode())
    return state.hexdigest()


def _title(source: Path) -> str:
    """Return the title of a page: the first heading of what Sphinx reads."""
    text = source.read_text(encoding="utf-8")
    title_match = None if source.suffix == ".rst" else re.search(r"^\W*# (.+)$", text, re.M)
    return title_match[1] if title_match else text.partition("\n")[0]


def _loaded(site: Path, known: Callable[[Path], _Read]) -> set[Path]:
    """Return the files that the pages of a site show or link to."""
    return {
        (page.parent / unquote(urlsplit(address).path)).resolve()
        for page in site.glob("*.html")
        for address in [*known(page).loaded, *known(page).links]
        if not urlsplit(address).scheme
    }
