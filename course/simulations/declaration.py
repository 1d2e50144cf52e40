"""What a page needs to show a simulation without Python: `live.js` makes the panel from it.

A simulation is live where its compiled module, a `.wasm`, lies beside its source; else its presets
are recorded, and `RECORDED` says why. Nothing here needs a widget or a plot.
"""

import base64
import contextlib
import gzip
import html
import importlib
import itertools
import json
import re
import sys
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import invalid
from course.simulations import pen as drawing
from course.simulations.model import KEYS, Experiment, Model
from course.simulations.record import Field, Record
from course.simulations.registry import RECORDED, SIMULATIONS

# How long a recording is, and how many pictures it has in a second: as `Step` in live.js.
SECONDS, RATE = 10.0, 25
# A recording ends before that where its text would be longer than this, all presets together. But
# each preset has two different pictures at least, as one that is played has to move.
ROOM = 1_200_000
# Points are quantised to 1 / GRID of the window's unit, a fraction of a pixel, and clipped to _FAR.
# _GAP stands for a gap in a line, and _EXACT for a number that is stored exactly.
GRID, _FAR, _GAP, _EXACT = 512, 2.0**30, -(2**31), 1 - 2**31

_HERE = Path(__file__).parent


def names() -> tuple[str, ...]:
    """Return the names of all simulations below `course.simulations`, in chapter order."""
    return SIMULATIONS


def model(name: str) -> Model:
    """Return the model of a simulation.

    Raises:
        ValueError: there is no such simulation.
    """
    with contextlib.suppress(ModuleNotFoundError, AttributeError):
        return importlib.import_module(f"{__package__}.{name}").MODEL
    raise invalid("name", name, f"one of {', '.join(names())}")


def module(name: str) -> Path:
    """Return the path of a simulation's compiled module, whether or not it exists."""
    return _HERE.joinpath(*name.split(".")).with_suffix(".wasm")


def recording(name: str) -> Path:
    """Return the path of a simulation's recording, beside its source.

    See `course.site.films`.
    """
    return module(name).with_suffix(".json")


def is_live(name: str) -> bool:
    """Return whether a simulation runs in the page: it is compiled, and not to be recorded."""
    return name not in RECORDED and not model(name).recorded and module(name).exists()


def why_recorded(name: str) -> str:
    """Return why a simulation is recorded; nothing for one that is live.

    Raises:
        ValueError: there is no such simulation, or it is neither compiled nor recorded.
    """
    if is_live(name):
        return ""
    if name not in RECORDED and not model(name).recorded:
        how = f"one with a .wasm (python -m course.site.wasm {name}), or in RECORDED"
        raise invalid("name", name, how)
    return RECORDED.get(name, "a library computes them")


def declaration(name: str) -> dict[str, Any]:
    """Return everything about a simulation but its functions, as JSON has it.

    Records are told as runs of equal eight-byte words, [how many, the word as text]; of the
    controls those with a label have an input, whose `offset` in the record is in bytes. `remaining`
    is the offset in the state of how many portions are left, where the work is done in portions.

    Raises:
        ValueError: there is no such simulation, or it is neither compiled nor recorded.
    """
    made, why = model(name), why_recorded(name)
    functions = ("initial", "advance", "frame", "drag", "grab", "press", "complete")
    return {
        "name": name,
        "title": made.title,
        "paper": made.paper.declaration() | {"readouts": dict(made.readouts)},
        "pen": {
            "size": drawing.HEADER + made.paper.room,
            "header": made.paper.pen()[: drawing.HEADER].tolist(),
        },
        "controls": _layout(made.controls),
        "state": _layout(made.state) | _remaining(made),
        "inputs": [_input(key, field, made.controls) for key, field in made.controls.panel()],
        "presets": [
            {
                "name": key,
                "note": (why and preset.recorded) or preset.note,
                "words": _runs(made.controls.new(**preset.values)),
            }
            for key, preset in made.presets.items()
        ],
        "functions": [each for each in functions if getattr(made, each) is not None],
        "keys": list(KEYS) if made.press is not None else [],
        "live_drag": made.live_drag,
        "upright": made.upright,
        "recorded": why,
    }


def name_of(made: Model) -> str:
    """Return the name of the simulation with this model.

    It is "" if the model is none of the course's.
    """
    home = made.frame.__module__
    mine = getattr(sys.modules.get(home), "MODEL", None) is made
    return home.removeprefix(f"{__package__}.") if mine else ""


def content(name: str) -> dict[str, Any]:
    """Return what `panel` in live.js receives: the declaration, and the code or film to run.

    Raises:
        ValueError: there is no such simulation, or it is neither compiled nor recorded.
    """
    report = declaration(name)
    live = not report["recorded"]
    return {
        "declaration": report,
        "wasm": base64.b64encode(module(name).read_bytes()).decode() if live else None,
        "pictures": None if live else _film(name),
    }


def bundle(name: str) -> str:
    """Return the script that brings one simulation into a page.

    Its declaration and its compiled code. The pictures of a recording are a script of their own
    (`film`) in the same folder, which a page fetches when the simulation comes into sight.

    Raises:
        ValueError: there is no such simulation, or it is neither compiled nor recorded.
    """
    # The frames of a recording are large, so they are left to a second script.
    made = content(name)
    text = _assigned("courseSimulations", name, made | {"pictures": None})
    if made["pictures"] is None:
        return text
    where = f"new URL({json.dumps(f'{name}.film.js')}, document.currentScript.src).href"
    return f"{text}window.courseSimulations[{json.dumps(name)}].film = {where};\n"


def film(name: str) -> str:
    """Return the script that brings the pictures of a recorded simulation into a page.

    Raises:
        ValueError: there is no such simulation, or it has no recording.
    """
    return _assigned("courseFilms", name, _film(name))


def _assigned(table: str, name: str, value: object) -> str:
    packed = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return f"(window.{table} ??= {{}})[{json.dumps(name)}] = {packed};\n"


def script() -> str:
    """Return the one script of all simulations.

    It makes a panel of every element `.course-live`.
    """
    return (
        '"use strict";\n(() => {\n' + joined("canvas", "live") + "window.courseLive = "
        "{ compiled, recorded, allowed, panel, mount };\n"
        'if (document.readyState !== "loading") mount();\n'
        'else document.addEventListener("DOMContentLoaded", mount);\n})();\n'
    )


def inline(name: str, picture: str) -> str:
    """Return a live simulation as HTML that needs nothing beside it; it moves at once.

    JupyterLab runs its scripts in a trusted notebook, before there is a kernel.

    Args:
        name: of a simulation that is live.
        picture: what is shown until it runs, a PNG in base64.

    Raises:
        ValueError: there is no such simulation, or it is recorded.
    """
    if not is_live(name):
        raise invalid("name", name, "a live simulation")
    label = html.escape(model(name).paper.label)
    # A `</script>` inside a script would end it early.
    scripts = "".join(
        "<script>" + text.replace("</", "<\\/") + "</script>" for text in (bundle(name), script())
    )
    return (
        f'<div class="course-live" data-simulation="{name}" data-plays '
        f'data-lm-suppress-shortcuts="true"><img alt="{label}" '
        f'src="data:image/png;base64,{picture}"></div>{scripts}'
    )


def joined(*parts: str) -> str:
    """Return JavaScript modules of this folder as one text, without their imports and exports."""
    # Imports and exports are cut out, so that the modules become one classic script.
    texts = [(_HERE / f"{part}.js").read_text(encoding="utf-8") for part in parts]
    whole = re.sub(r"^import .*;\n|^export default .*;\n", "", "\n".join(texts), flags=re.M)
    return re.sub(r"^export ", "", whole, flags=re.M)


def _runs(record: Any) -> list[list[Any]]:
    """Return the words of a record, each with how often it stands there in turn."""
    # Every field has eight bytes, so words need no types; as text they survive JSON exactly.
    words = np.frombuffer(record.tobytes(), "<u8").tolist()
    return [[len(list(run)), str(word)] for word, run in itertools.groupby(words)]


def _remaining(made: Model) -> dict[str, int]:
    """Return where in the state the number of remaining portions is, if it has one."""
    fields: Any = made.state.dtype.fields
    return {} if made.complete is None else {"remaining": fields["remaining"][1]}


def _layout(record: Record) -> dict[str, Any]:
    return {"size": record.dtype.itemsize, "words": _runs(record.new())}


def _input(name: str, field: Field, record: Record) -> dict[str, Any]:
    fields: Any = record.dtype.fields
    kind, offset = fields[name][:2]
    low, high = (0, 1) if field.switch else (field.ends[0], field.ends[-1])
    return {
        "name": name,
        "label": field.label,
        "offset": offset,
        "kind": kind.kind,
        "low": low,
        "high": high,
        "step": field.step,
        "unit": field.unit,
        "decimals": field.decimals,
        "choices": list(field.choices),
        "switch": field.switch,
        "live": field.live,
    }


def _film(name: str) -> dict[str, Any]:
    """Return the recording that is kept beside a simulation's source."""
    if not recording(name).exists():
        raise invalid("name", name, f"one with a recording (python -m course.site.films {name})")
    return json.loads(recording(name).read_text(encoding="utf-8"))["films"]


def recorded(made: Model) -> dict[str, Any]:
    """Return each preset of a model as a film.

    It consists of the sizes of its frames, and their numbers, compressed.

    A picture is told by what differs from the one before: of each number, in steps of 1 / `GRID`,
    the difference as four bytes, first the lowest ones of all, and so on. After them stand the
    numbers that are told exactly. A picture of size 0 is like the one before.
    """
    films = {}
    for name in made.presets:
        run, room = Experiment(made), ROOM / len(made.presets)
        sizes: list[int] = []
        parts: list[bytes] = []
        run.choose(name)
        before, shown, packer = np.empty(0, np.int32), b"", zlib.compressobj(9)
        for _ in range(round(SECONDS * RATE) + 1):
            picture = run.picture()
            run.advance(1.0 / RATE)
            same = picture.data.tobytes() == shown
            sizes.append(0 if same else picture.data.size)
            if same:
                continue
            shown = picture.data.tobytes()
            # Delta coding: each number as its difference from the picture before.
            steps, exact = _steps(picture)
            change, both = steps.copy(), min(steps.size, before.size)
            change[:both] -= before[:both]
            # Byte planes: the upper bytes of small differences are equal and compress well.
            part = change.view(np.uint8).reshape(-1, 4).T.tobytes() + exact.tobytes()
            # What this picture adds to the compressed film; Base64 takes four characters for three
            # bytes.
            packed = packer.compress(part) + packer.flush(zlib.Z_SYNC_FLUSH)
            room -= len(packed) * 4 / 3
            if len(parts) > 1 and room < 0:
                sizes.pop()
                break
            parts.append(part)
            before = steps
        data = gzip.compress(b"".join(parts), 9, mtime=0)
        films[name] = {"sizes": sizes, "data": base64.b64encode(data).decode()}
    return films


def _steps(picture: drawing.Picture) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """Return the numbers of a picture in steps of 1 / `GRID`, and those that are told exactly.

    Points are as exact as a screen asks for, all else as it is.
    """
    data, point, at = picture.data, np.zeros(picture.data.size, bool), 0
    # Only coordinates may be rounded: mark them, item by item.
    while at < data.size:
        kind, end = int(data[at]), at + 2 + int(data[at + 1])
        if kind in (drawing.LINE, drawing.POLYGON, drawing.DISC, drawing.ARROW):
            point[at + 2 + drawing.STYLE[kind] : end] = True
        at = end
    gap = np.isnan(data)
    # What the grid does not hold is marked in the steps, and stored apart unless it is a point.
    scaled = np.clip(np.where(gap, 0.0, GRID * data), -_FAR, _FAR)
    steps = np.round(scaled).astype(np.int32)
    exact = ~(point | gap | (steps == GRID * data))
    steps[gap], steps[exact] = _GAP, _EXACT
    return steps, data[exact]
