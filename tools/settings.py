"""Which settings the stored pictures of the simulations were made with.

A page stores a picture of each simulation that it shows, and the README a film. They are made when
the page is built, so a default that changes afterwards would leave them showing the old value.
`notebooks/settings.json` therefore holds the settings of every stored picture: the build writes
those of the page that it has built, and `tests/notebooks/test_settings.py` compares them with the
settings as they are now. The recordings of `course.site.films` carry a fingerprint of their own.
"""

import ast
import importlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from nbformat import NotebookNode

from course.charts import write
from course.simulations import SIMULATIONS
from course.simulations.model import Model

# Of a picture: each control and its value.
Settings = dict[str, float]

FOLDER = Path(__file__).resolve().parents[1] / "notebooks"
FILE = "settings.json"
README = "README"  # what the film of the README is stored under
_FILM = re.compile(r"\(attachment:([\w.]+)\.png\)")
_NAMES = {name.rpartition(".")[2]: name for name in SIMULATIONS}
_CLOSE = 1e-9  # a default may be computed, and its last digits differ between machines


def model(name: str) -> Model:
    """Return the simulation with this name in `SIMULATIONS`."""
    result: Model = importlib.import_module(f"course.simulations.{name}").MODEL
    return result


def settings(name: str, preset: str = "") -> Settings:
    """Return the controls that a simulation starts with.

    Args:
        name: one of `SIMULATIONS`.
        preset: one of its presets; the first one, as in a panel and a film, if empty.
    """
    simulated = model(name)
    chosen = simulated.presets[preset or next(iter(simulated.presets))]
    record = simulated.controls.new(**chosen.values)
    result: Settings = {}
    for control in simulated.controls.fields:
        result.update(_numbers(control, record[control].tolist()))
    return result


def _numbers(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield the numbers of a control, those of an array under its name and an index."""
    if isinstance(value, list):
        for index, each in enumerate(value):
            yield from _numbers(f"{name}[{index}]", each)
    else:
        yield name, value


def of_page(cells: Sequence[NotebookNode]) -> dict[str, Settings]:
    """Return the settings of all pictures on a page, as they are now.

    Args:
        cells: of the notebook or of its source.

    Returns:
        Settings by picture, such as "contact.touch film" or "contact.touch, Slip, still 0.15".
    """
    result = {}
    for cell in cells:
        if cell.cell_type == "markdown":
            for name in _FILM.findall(cell.source):
                result[f"{name} film"] = settings(name)
            continue
        for name, preset, *others in _calls(cell.source):
            module = _NAMES[name]
            picture = ", ".join([module, *filter(None, [preset]), *others])
            result[picture] = settings(module, preset)
    return result


def _calls(source: str) -> Iterator[list[str]]:
    """Yield name, preset ("" for the first) and other arguments of each call of `simulation`."""
    try:
        tree = ast.parse(source)
    except SyntaxError:  # of the notebook: %matplotlib
        return
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name("simulation"), args=arguments, keywords=keywords):
                values = dict(zip(("name", "preset", "still"), arguments, strict=False))
                values |= {str(each.arg): each.value for each in keywords}
                literal = {name: ast.literal_eval(value) for name, value in values.items()}
                name, preset = literal.pop("name"), literal.pop("preset", "")
                yield [name, preset, *(f"{key} {value}" for key, value in literal.items())]


def of_readme() -> dict[str, Settings]:
    """Return the settings of the README's film, as they are now."""
    return {"rigid_body.bouncing_box film": settings("rigid_body.bouncing_box")}


def stored(folder: Path = FOLDER) -> dict[str, dict[str, Settings]]:
    """Return the settings with which the pictures were made: page -> picture -> control."""
    path = folder / FILE
    result = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    return dict(result)


def store(page: str, pictures: Mapping[str, Settings], folder: Path = FOLDER) -> None:
    """Store the settings of a page whose pictures have just been made."""
    pages = {**stored(folder), page: dict(pictures)}
    text = json.dumps(dict(sorted(pages.items())), indent=1, ensure_ascii=False)
    write(folder / FILE, f"{text}\n")


def out_of_date(page: str, before: Mapping[str, Settings], now: Mapping[str, Settings]) -> str:
    """Return what the pictures of a page show that has changed since, and how to make them again.

    Args:
        page: stem of a notebook, such as "02_contact", or `README`.
        before: the stored settings of each picture.
        now: those that a build would use.

    Returns:
        One sentence for each picture and the command; nothing if all is as it was.
    """
    faults = []
    for picture in sorted({*before, *now}):
        if picture not in before or picture not in now:
            change = "is new" if picture in now else "is no longer shown"
            faults.append(f"{page}: the picture of {picture} {change}.")
            continue
        old, new = before[picture], now[picture]
        changes = [
            f"{control} {old.get(control, 'absent')}, now {new.get(control, 'absent')}"
            for control in {**old, **new}
            if control not in old
            or control not in new
            or not math.isclose(old[control], new[control], rel_tol=_CLOSE, abs_tol=_CLOSE)
        ]
        if changes:
            faults.append(f"{page}: the picture of {picture} was made with {', '.join(changes)}.")
    command = "tools.gallery" if page == README else f"tools.notebooks {page}"
    return "\n".join([*faults, f"Run `.venv/bin/python -m {command}`."]) if faults else ""
