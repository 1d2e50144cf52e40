"""A committed notebook as the page that Sphinx reads: nothing is run, what it shows is kept.

What only a kernel can do is replaced: a simulation by a place for the one that runs in the page,
with its saved picture; whatever grades or keeps a record by what it showed, and how to run it.
"""

import ast
import base64
import functools
import hashlib
import html
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import nbformat
from nbformat import NotebookNode
from PIL import Image

from course import Chapter
from course.cards import draws
from course.simulations import LIVE_TAG, declaration
from course.simulations.model import Model
from course.site import modules

ROOT = Path(__file__).resolve().parents[2]
# Folders of what a page shows, beside it.
PICTURES, CHARTS = "_static/pictures", "charts"
# The moving picture of the README and the home page, the picture of the robot on the home page, and
# the texts of the project that are pages.
FILM = ROOT / "docs" / "film.png"
ROBOT = ROOT / "docs" / "robot.png"
TEXTS = {
    "drills": ROOT / "drills" / "README.md",
    "modules": ROOT / "docs" / "howto" / "modules.md",
    "environments": ROOT / "docs" / "howto" / "vector_env.md",
    "drills_in_ci": ROOT / "docs" / "howto" / "drills_in_ci.md",
    "your_method": ROOT / "docs" / "howto" / "chart.md",
    "robot_planner": ROOT / "docs" / "howto" / "robot_planner.md",
    "mathematics": ROOT / "docs" / "mathematics" / "README.md",
}
_FILM = re.compile(r"!\[[^\]]+\]\(attachment:([\w.]+)\.png\)\n*")
_LINK = re.compile(r"(?<!\\)(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^()\s]+)\)")
_FENCE = re.compile(r"^```.*?^```|`[^`\n]+`", re.S | re.M)
_CARD = re.compile(r'(<div class="card") id="((?:claim|card)-\w+)"')
_KERNEL_ONLY = re.compile(r'[ \t]*<(span|div) class="kernel-only">.*?</\1>', re.S)
# The same phrases where a text does not mark them: what is there, and what stays.
_PHRASES = tuple(
    (re.compile(pattern.replace(" ", r"\s+"), re.S), stays)
    for pattern, stays in (
        (r"; then run the cells[^.]*\.", "."),
        (r" \(?A number in the text comes from the cell above it,.*?runs again\.\)?", ""),
        (r" Change the texts( until they are right:|\.)", ""),
    )
)
_CHANGE_ME = re.compile(r"\b[Cc]hange me: (\w)")
# What needs Python: the function that a cell calls last, and what a reader is told below it.
_LAB = "in a copy of this page, which <code>make lab</code> opens"
_NEEDS = {
    "check": "Grading needs Python: <code>drills start {name}</code> in a terminal writes the "
    f"starter, <code>drills check {{name}}</code> grades it; or run this cell {_LAB}.",
    "answer": f"Formula answers need Python, which compares them with the right one {_LAB}.",
    "badges": f"What you have solved is kept by Python: <code>drills status</code>, or {_LAB}.",
    "TradeOff": f"To drag the tolerance needs Python: run this cell {_LAB}.",
}


@dataclass
class Page:
    """What comes of a notebook.

    Attributes:
        notebook: for Sphinx.
        simulations: the names of those that the page runs, as they come.
        pictures: file name -> PNG, for the folder `PICTURES`.
        anchors: what the page can be entered at, such as "claim-top_condition".
        faults: what the site cannot be built with, one sentence each.
    """

    notebook: NotebookNode
    simulations: list[str] = field(default_factory=list)
    pictures: dict[str, bytes] = field(default_factory=dict)
    anchors: set[str] = field(default_factory=set)
    faults: list[str] = field(default_factory=list)


@functools.cache
def _by_label() -> dict[str, str]:
    """Return the name of each simulation by what its pictures say to those who cannot see them."""
    return {declaration.model(name).paper.label: name for name in declaration.names()}


@functools.cache
def _pages() -> dict[Path, str]:
    """Return the page of each text of the project that has one."""
    return {path: name for name, path in TEXTS.items()}


def slug(text: str) -> str:
    """Return a text as it stands in an anchor: small letters, digits and dashes."""
    return re.sub(r"\W+", "-", text.lower()).strip("-")


def called(source: str) -> tuple[str, list[Any]]:
    """Return the name of the function in a cell's last statement and its literal arguments."""
    try:
        body = ast.parse(source).body
    except SyntaxError:  # of the notebook: %matplotlib
        return "", []
    # The last expression statement of a cell decides what it shows.
    match body[-1:]:
        case [ast.Expr(ast.Call(func=ast.Name(name), args=arguments))]:
            return name, [a.value for a in arguments if isinstance(a, ast.Constant)]
    return "", []


def _html(text: str) -> NotebookNode:
    return nbformat.v4.new_output("display_data", {"text/html": text})


def first_picture(png: bytes) -> bytes:
    """Return the first picture of a film as a PNG of its own; a picture stays what it is."""
    picture = Image.open(io.BytesIO(png))
    # A film is an animated PNG: its first frame stands in until the simulation has started.
    if getattr(picture, "n_frames", 1) == 1:
        return png
    packed, still = io.BytesIO(), picture.convert("RGB")
    still.info = {}
    still.quantize(256, dither=Image.Dither.NONE).save(packed, "PNG", optimize=True)
    return packed.getvalue()


def place_of_simulation(
    name: str, model: Model, picture: str, preset: str = "", plays: bool = False
) -> str:
    """Return where a simulation comes to life, with its saved picture; HTML.

    Args:
        name: below `course.simulations`.
        model: that one.
        picture: address of its saved picture, relative to the page.
        preset: the one to start with, if it is not the first.
        plays: whether it moves as soon as it is there.
    """
    label, chosen = html.escape(model.paper.label), html.escape(preset)
    start = f' data-preset="{chosen}"' if preset else ""
    start += " data-plays" if plays else ""
    return (
        f'<div class="course-live" data-simulation="{name}"{start}>'
        f'<img alt="{label}" loading="lazy" src="{picture}" width="{int(model.paper.width)}"></div>'
    )


def _simulation(
    page: Page, cell: NotebookNode, output: NotebookNode, film: bytes | None, place: str
) -> NotebookNode:
    """Return the output of a cell that shows a simulation, for the page."""
    # The label in a picture's text is how a saved output is attributed to its simulation.
    label = output.data["text/plain"].partition("\n")[0]
    name = _by_label().get(label)
    if name is None:
        page.faults.append(f"{place}: no module has the simulation {label!r}")
        return output
    if "image/png" in output.data:
        film = base64.b64decode(output.data["image/png"])
    if film is None:
        page.faults.append(f"{place}: the simulation {label!r} has no picture")
        return output
    png, model = first_picture(film), declaration.model(name)
    # Named by content: equal pictures are stored once, and a changed one has a new address.
    file = f"{hashlib.sha256(png).hexdigest()[:16]}.png"
    page.pictures[file] = png
    page.simulations.append(name)
    # A string argument that names a preset is the one that the notebook starts with.
    presets = [text for text in called(cell.source)[1] if text in model.presets]
    plays = LIVE_TAG in cell.metadata.get("tags", ())
    preset = presets[-1] if presets else ""
    return _html(place_of_simulation(name, model, f"{PICTURES}/{file}", preset, plays))


def _outputs(page: Page, cell: NotebookNode, film: bytes | None, place: str) -> list[NotebookNode]:
    def anchored(match: re.Match[str]) -> str:
        """Let a page be entered at a card; an id is on it once."""
        if match[2] in page.anchors:
            return match[1]
        page.anchors.add(match[2])
        return match[0]

    name, _ = called(cell.source)
    made = []
    for output in cell.outputs:
        data: dict[str, Any] = output.get("data", {})
        text = data.get("text/plain", "")
        if data and (name == "simulation" or text.partition("\n")[0] in _by_label()):
            output = _simulation(page, cell, output, film, place)
        elif (
            data and "image/png" not in data and (text.startswith("<Figure") or name == "TradeOff")
        ):
            page.faults.append(f"{place}: its output {text[:60]!r} has no picture")
        elif "text/markdown" in data:
            data["text/markdown"] = _CARD.sub(anchored, data["text/markdown"])
        made.append(output)
    if name in _NEEDS and cell.outputs:
        report = cell.outputs[-1].get("data", {}).get("text/plain", "").partition(":")[0]
        made.append(_html(f'<p class="needs-python">{_NEEDS[name].format(name=report)}</p>'))
    return made


def linked(text: str, folder: Path, place: str, faults: list[str]) -> str:
    """Return Markdown whose links to files of the project lead to pages, or are shown as paths.

    Args:
        text: Markdown.
        folder: in which its links are.
        place: what to call it in a fault.
        faults: gets a sentence for each link that leads nowhere.
    """

    def link(match: re.Match[str]) -> str:
        mark, label, target = match.groups()
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        # Links to pages stay, those to charts lead to the gallery's copy, other files become paths.
        file = (folder / path).resolve()
        if not file.exists() or not file.is_relative_to(ROOT):
            faults.append(f"{place}: the link to {target} leads nowhere")
        elif file.parent == ROOT / "docs" / "charts":
            mine = f"{CHARTS}/{file.name}" if mark else "charts.md"
            return f"{mark}[{label}]({mine}{'#' if anchor else ''}{anchor})"
        elif mark and (file in (FILM, ROBOT) or file.parent == TEXTS["mathematics"].parent):
            return f"{mark}[{label}]({PICTURES}/{file.name})"
        elif name := _pages().get(file):
            return f"[{label}]({name}.md{'#' if anchor else ''}{anchor})"
        elif file.suffix != ".ipynb":
            return f"{label} (`{file.relative_to(ROOT).as_posix()}`)"
        return match[0]

    # Code is left alone: links are replaced only between fenced or inline code.
    parts, end = [], 0
    for quiet in _FENCE.finditer(text):
        parts += [_LINK.sub(link, text[end : quiet.start()]), quiet[0]]
        end = quiet.end()
    return "".join([*parts, _LINK.sub(link, text[end:])])


def without_kernel(text: str) -> str:
    """Return Markdown without what makes sense only where a kernel runs.

    Such a phrase stands in `<span class="kernel-only">`, whole blocks in
    `<div class="kernel-only">`; they are not nested.
    """
    text = _KERNEL_ONLY.sub("", text)
    for pattern, stays in _PHRASES:
        # Where emphasis begins before the phrase and ends within it, it ends with what stays.
        for phrase in dict.fromkeys(match[0] for match in pattern.finditer(text)):
            text = text.replace(phrase, stays + "*" * (phrase.count("*") % 2))
    return text


def term_pattern(term: str) -> re.Pattern[str]:
    """Return where a text sets a term in bold, singular or plural."""
    # Words may be separated by a dash or a line break; plurals count as the term.
    words = r"[\s-]+".join(map(re.escape, re.split(r"[\s-]+", term)))
    return re.compile(rf"\*\*[^*\n]*?(?<!\w){words}(?:s|es)?(?!\w)[^*\n]*\*\*", re.I)


def _defined(page: Page, terms: Sequence[str]) -> None:
    """Put an anchor where each term is first set in bold."""
    cells = [cell for cell in page.notebook.cells if cell.cell_type == "markdown"]
    for term in terms:
        pattern, anchor = term_pattern(term), f"term-{slug(term)}"
        for cell in cells:
            if result := pattern.search(cell.source):
                before, after = cell.source[: result.start()], cell.source[result.start() :]
                cell.source = f'{before}<span id="{anchor}"></span>{after}'
                page.anchors.add(anchor)
                break


def _used(page: Page, chapter: Chapter) -> None:
    """Put an anchor where the text first names each public function or class of its module."""
    for cell in page.notebook.cells:
        if cell.cell_type != "markdown":
            continue
        quiet = [
            match.span() for match in re.finditer(r"^```.*?^```|^\|.*?$", cell.source, re.S | re.M)
        ]
        for at, name in reversed(list(modules.mentioned(cell.source, chapter))):
            anchor = f"code-{name}"
            if anchor in page.anchors or any(start <= at < end for start, end in quiet):
                continue
            page.anchors.add(anchor)
            cell.source = f'{cell.source[:at]}<span id="{anchor}"></span>{cell.source[at:]}'


def page(path: Path, vocabulary: Sequence[str] = (), chapter: Chapter | None = None) -> Page:
    """Return the page of a committed notebook.

    Args:
        path: of the notebook; its links are those of a file in the folder `notebooks`.
        vocabulary: terms that can be entered at.
        chapter: whose module's names can be entered at; None for the home page.

    Returns:
        The page; where it has faults, the site cannot be built.
    """
    notebook = nbformat.read(path, as_version=4)
    made = Page(notebook)
    film: bytes | None = None
    cells = []
    for number, cell in enumerate(notebook.cells):
        place = f"{path.name}, cell {number}"
        if cell.cell_type == "markdown":
            if cell.source.startswith("---\n") and "](index.ipynb)" in cell.source:
                continue  # its neighbours: every page has them below
            if cell.source.startswith("## Where you are\n"):
                continue
            for name in _FILM.findall(cell.source):
                # A film is attached to the Markdown cell before the simulation that it belongs to.
                film = base64.b64decode(cell.attachments[f"{name}.png"]["image/png"])
            cell.pop("attachments", None)
            cell.source = linked(
                without_kernel(_FILM.sub("", cell.source)), ROOT / "notebooks", place, made.faults
            )
            if not cell.source.strip():
                continue
        elif cell.cell_type == "code":
            # "Change me" refers to editing a cell, which a page cannot.
            cell.source = _CHANGE_ME.sub(lambda match: match[1].upper(), cell.source)
            if called(cell.source) in (("home", []), ("ticks", []), ("your_robot", [])):
                continue  # how far a reader is, which a page doesn't know
            if cell.source.strip() and cell.execution_count is None:
                made.faults.append(f"{place}: it was not executed; run `make notebooks`")
            if "remove-input" in cell.metadata.get("tags", ()) and not cell.outputs:
                continue  # imports: nothing to read, nothing to see
            shown = len(made.simulations)
            name, arguments = called(cell.source)
            if name == "checkpoint":
                # The page draws the questions itself; there is nothing to type into a cell.
                pool = draws.offered(arguments[0])
                cell.outputs = [nbformat.v4.new_output("display_data", {"text/markdown": pool})]
            else:
                cell.outputs = _outputs(made, cell, film, place)
            # A film belongs to the next simulation only.
            film = None if len(made.simulations) > shown else film
            for output in cell.outputs:
                data = output.get("data", {})
                if "text/markdown" in data:
                    data["text/markdown"] = linked(
                        data["text/markdown"], ROOT / "notebooks", place, made.faults
                    )
        cells.append(cell)
    notebook.cells = cells
    _defined(made, vocabulary)
    if chapter is not None:
        _used(made, chapter)
    return made
