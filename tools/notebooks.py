"""Build the notebooks from their sources, and prove that the two agree.

Text and code are written as py:percent in `notebooks/source/NN_topic.py`. `python -m
tools.notebooks` (or `make notebooks`) runs each in a fresh kernel and writes
`notebooks/NN_topic.ipynb` with its outputs; with `--check` it only looks whether the notebooks that
are there belong to their sources. What is written depends on nothing but source and outputs: two
builds are the same to the byte where the outputs are.
"""

import base64
import hashlib
import importlib
import io
import operator
import os
import re
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import click
import jupytext
import nbclient
import nbformat
from nbformat import NotebookNode

import course
from drills import cards
from tools import contents, form, front, plumbing, settings

FOLDER = Path(__file__).resolve().parent.parent / "notebooks"

_KERNELSPEC = {"display_name": "Python 3", "language": "python", "name": "python3"}
_PNG = "iVBORw0KGgo"  # how a picture begins, in base64
_WIDGET_VIEW = "application/vnd.jupyter.widget-view+json"
_ADDRESS = re.compile(r"\bat 0x[0-9a-fA-F]{6,}")
# A film of a simulation: its title, and its module in course.simulations.
_FILM = re.compile(r"!\[([^\]]+)\]\(attachment:([\w.]+)\.png\)")
# What a text takes from a tool or from the course: {{contents.moving}}, {{PREREQUISITES}}.
_FILLED = re.compile(r"\{\{([\w.]+)\}\}")
_CELL_TIMEOUT = 600  # s
_MINUTES = re.compile(r"\{(open|folded|exercise) minutes\}")


def sources(folder: Path = FOLDER) -> list[Path]:
    """Return the sources under `folder`, in the order of their names."""
    return sorted((folder / "source").glob("*.py"))


def target(source: Path) -> Path:
    """Return the notebook that is built from `source`."""
    return source.parent.parent / f"{source.stem}.ipynb"


def filled(text: str) -> str:
    """Return a text in which each {{name}} is replaced by what the course says under it.

    `{{contents.name}}` and `{{front.name}}` are functions of these tools, any other name is a
    constant of the package `course`.

    Raises:
        AttributeError: there is no such name.
    """
    tools = SimpleNamespace(contents=contents, front=front)

    def value(match: re.Match[str]) -> str:
        if hasattr(tools, match[1].partition(".")[0]):
            result = operator.attrgetter(match[1])(tools)()
        else:
            result = getattr(course, match[1])
        return str(result).rstrip("\n")

    return _FILLED.sub(value, text)


def read_source(source: Path) -> NotebookNode:
    """Return the notebook that a py:percent file describes, without outputs.

    Every cell's id is a hash of its place and its text, so that it only changes with them. A text
    is `filled`; in it `{open minutes}` and `{folded minutes}` become the time to read it, and
    `{exercise minutes}` the sum of its exercises' cards. A chapter ends with links to
    its neighbours. Code that only fetches, shows or draws is marked as `tools.plumbing` says.

    Args:
        source: path of the py:percent file.

    Returns:
        A notebook in format 4.5 with no metadata but its kernel's name.
    """
    parsed = jupytext.read(source, fmt="py:percent")
    minutes = {**form.reading(parsed.cells), "exercise": _exercise_minutes(source)}
    cells = []
    number = source.stem.partition("_")[0]
    if any(source.stem == f"{c.number:02d}_{c.topic}" for c in course.CHAPTERS):
        parsed.cells.append(nbformat.v4.new_markdown_cell(contents.neighbours(int(number))))
    plumbing.mark(parsed.cells)
    for index, cell in enumerate(parsed.cells):
        if cell.cell_type == "markdown":
            cell.source = _MINUTES.sub(lambda match: str(minutes[match[1]]), filled(cell.source))
        digest = hashlib.sha256(f"{index}\n{cell.cell_type}\n{cell.source}".encode())
        metadata = {k: v for k, v in cell.metadata.items() if k != "lines_to_next_cell"}
        make = {
            "code": nbformat.v4.new_code_cell,
            "markdown": nbformat.v4.new_markdown_cell,
            "raw": nbformat.v4.new_raw_cell,
        }[cell.cell_type]
        cells.append(make(cell.source, id=digest.hexdigest()[:12], metadata=metadata))
    return nbformat.v4.new_notebook(cells=cells, metadata={"kernelspec": dict(_KERNELSPEC)})


def _exercise_minutes(source: Path) -> int:
    """Return the sum of the minutes on the cards of a chapter's exercises.

    0 where it is no chapter.
    """
    number = source.stem.partition("_")[0]
    mine = [one for one in cards.cards() if number == f"{one.chapter:02d}" and not one.drill]
    return sum(one.minutes for one in mine)


def films(text: str) -> dict[str, dict[str, str]]:
    """Return the films that a text shows, as the attachments of its cell.

    A film is there before a kernel runs and while it is busy: cells of text keep what they show
    when all cells are run. `![title](attachment:topic.module.png)` is one of the simulation
    `course.simulations.topic.module`; the live simulation finds it by its title and hides it.

    Args:
        text: markdown.

    Returns:
        File name -> MIME type -> base64.

    Raises:
        ValueError: the title is not that of the simulation.
    """
    result = {}
    for title, name in _FILM.findall(text):
        from course.simulations.painter import film

        model = importlib.import_module(f"course.simulations.{name}").MODEL
        if title != model.title:
            raise ValueError(f"title of a film must be {model.title!r}, got {title!r}")
        result[f"{name}.png"] = {"image/png": base64.b64encode(film(model)).decode("ascii")}
    return result


def smaller(png: str) -> str:
    """Return a picture in a palette of 256 colours.

    That is plenty for a chart, and a third of the size. An animated picture stays as it is.

    Args:
        png: in base64.
    """
    from PIL import Image

    picture = Image.open(io.BytesIO(base64.b64decode(png)))
    if getattr(picture, "n_frames", 1) > 1:
        return png  # saving it as one picture would drop the other frames
    packed = io.BytesIO()
    # The median cut would give a rare colour to its neighbour: an amber label became orange.
    palette = picture.convert("RGB").quantize(
        256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    palette.save(packed, "PNG", optimize=True)
    text = base64.b64encode(packed.getvalue()).decode("ascii")
    return text if len(text) < len(png) else png


def run(notebook: NotebookNode, folder: Path) -> NotebookNode:
    """Run every cell in a fresh kernel of this interpreter and keep what comes out.

    A widget lives only as long as its kernel. What is kept is the rest of its output: the picture
    that it offers beside itself, or at least its text. Films are recorded here, too.

    Args:
        notebook: the notebook to run; it is left as it was.
        folder: the kernel's working directory.

    Returns:
        A copy with outputs.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed that isn't tagged `raises-exception`.
    """
    executed = nbformat.from_dict(notebook)
    client = nbclient.NotebookClient(
        executed,
        kernel_name=_KERNELSPEC["name"],
        timeout=_CELL_TIMEOUT,
        record_timing=False,
        store_widget_state=False,
        coalesce_streams=True,
        resources={"metadata": {"path": str(folder)}},
    )
    # The compiler's announcements and the builder's own progress don't belong in the notebook. What
    # takes long is computed, and goes on record for the tests (`course.page_records`).
    quiet = {"COURSE_QUIET": "1", "DRILLS_PROGRESS": "none", "COURSE_CLAIMS": "stored"}
    client.execute(env={**os.environ, **quiet})
    executed.metadata = nbformat.from_dict({"kernelspec": dict(_KERNELSPEC)})
    shown = False
    for cell in executed.cells:
        if cell.cell_type == "markdown" and (attachments := films(cell.source)):
            cell.attachments = nbformat.from_dict(attachments)
            shown = True
        for output in cell.get("outputs", []):
            if (png := output.get("data", {}).get("image/png", "")).startswith(_PNG):
                output.data["image/png"] = smaller(png)
            if output.get("data", {}).pop(_WIDGET_VIEW, None) and shown:
                for part in (output.data, output.metadata):
                    part.pop("image/png", None)  # it would stand below the film
                shown = False
            output.get("metadata", {}).pop(_WIDGET_VIEW, None)
    return executed


def write(notebook: NotebookNode, path: Path) -> None:
    """Write `notebook` to `path` in one go: a reader sees the old file or the new one."""
    nbformat.validate(notebook)
    text = nbformat.writes(notebook, version=4).rstrip("\n") + "\n"
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", newline="\n", dir=path.parent, suffix=".part", delete=False
    ) as part:
        part.write(text)
    try:
        os.chmod(part.name, 0o644)
        os.replace(part.name, path)
    except OSError:
        os.unlink(part.name)
        raise


def build(source: Path) -> Path:
    """Run one source and write its notebook; a source that fails leaves the old notebook.

    Args:
        source: path of a py:percent file in a folder `source`.

    Returns:
        Path of the notebook, beside that folder.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    path = target(source)
    notebook = run(read_source(source), path.parent)
    write(notebook, path)
    # With which settings the pictures were made, for the test that a default has not changed since.
    if pictures := settings.of_page(notebook.cells):
        settings.store(path.stem, pictures, path.parent)
    return path


def check(source: Path) -> list[str]:
    """Return what is wrong with the notebook of `source`.

    Nothing is wrong if it was built from that source and ran through.

    The outputs themselves aren't compared here: nbval does that by running the notebook again.

    Args:
        source: path of a py:percent file in a folder `source`.

    Returns:
        One sentence for each fault.
    """
    path = target(source)
    if not path.exists():
        return [f"{path.name} is missing: build it with `make notebooks`"]
    desired = read_source(source)
    result = nbformat.read(path, as_version=4)
    faults = []
    if result.metadata != desired.metadata:
        faults.append(f"{path.name}: its metadata are not those that the build writes")
    if len(result.cells) != len(desired.cells):
        faults.append(
            f"{path.name} has {len(result.cells)} cells, its source has {len(desired.cells)}"
        )
    count = 0
    for index, (cell, other) in enumerate(zip(result.cells, desired.cells, strict=False)):
        place = f"{path.name}, cell {index}"
        for part in ("cell_type", "source", "metadata", "id"):
            if cell.get(part) != other.get(part):
                faults.append(f"{place}: its {part} differs from the source")
        if cell.cell_type != "code":
            wanted_films = {f"{name}.png" for _, name in _FILM.findall(cell.source)}
            if set(cell.get("attachments", {})) != wanted_films:
                faults.append(f"{place}: its films are not those of its text")
            continue
        if cell.source.strip():
            count += 1
            if cell.execution_count != count:
                faults.append(f"{place}: run as {cell.execution_count}, expected {count}")
        for output in cell.outputs:
            if output.output_type == "error" and "raises-exception" not in cell.metadata.get(
                "tags", []
            ):
                faults.append(f"{place}: shows the error {output.ename}: {output.evalue}")
            text = output.get("text", "") + output.get("data", {}).get("text/plain", "")
            if _ADDRESS.search(text):
                faults.append(f"{place}: shows a memory address, which changes with every run")
    return faults


def check_all(folder: Path = FOLDER) -> list[str]:
    """Return the faults of every notebook under `folder`, and the notebooks that have no source.

    Args:
        folder: the folder of the notebooks, with their sources in its folder `source`.

    Returns:
        One sentence for each fault.
    """
    faults = [fault for source in sources(folder) for fault in check(source)]
    built = {target(source) for source in sources(folder)}
    strays = sorted(set(folder.glob("*.ipynb")) - built)
    return faults + [f"{path.name} has no source in {folder.name}/source" for path in strays]


def _chosen(names: tuple[str, ...]) -> list[Path]:
    by_name = {source.stem: source for source in sources()}
    if unknown := sorted(set(names) - set(by_name)):
        raise click.BadParameter(f"{', '.join(unknown)}: allowed are {', '.join(by_name)}")
    return [by_name[name] for name in names] if names else list(by_name.values())


@click.command()
@click.argument("names", nargs=-1)
@click.option("--check", "only_check", is_flag=True, help="Build nothing, look for faults.")
def main(names: tuple[str, ...], only_check: bool) -> None:
    """Build the notebooks called NAMES (such as 01_rigid_body), or all of them."""
    chosen = _chosen(names)
    if only_check:
        faults = [fault for source in chosen for fault in check(source)] if names else check_all()
        for fault in faults:
            click.echo(fault)
        if not faults:
            click.echo(f"{len(chosen)} notebooks agree with their sources")
        sys.exit(bool(faults))
    for source in chosen:
        click.echo(f"running {source.stem} ...")
        try:
            path = build(source)
        except nbclient.exceptions.CellExecutionError as error:
            click.echo(f"{source.stem} failed, its notebook is left as it was\n{error}", err=True)
            sys.exit(1)
        click.echo(f"wrote {path.parent.name}/{path.name}")


if __name__ == "__main__":
    main(prog_name="python -m tools.notebooks")
