"""The recordings of simulations that no browser computes, kept beside their sources.

`python -m course.site.films` records those whose sources have changed, a minute of work for all,
and writes `course/simulations/<name>.json`; with names just those. They are kept because a learned
policy is not the same to the bit on another machine, and a site has to be.
"""

import ast
import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from course.simulations import declaration
from course.site.wasm import bare

COURSE = Path(declaration.__file__).parents[1]


def names() -> list[str]:
    """Return the simulations that are recorded, as dotted paths below course.simulations."""
    return [name for name in declaration.names() if not declaration.is_live(name)]


def reached(name: str) -> list[Path]:
    """Return the files of the course that a simulation is made from.

    Those that it imports, whatever these import, and the data beside them.
    """
    result: set[Path] = set()
    # A search over the import statements, without importing anything.
    waiting = [f"course.simulations.{name}"]
    while waiting:
        parts = waiting.pop().split(".")[1:]
        place = COURSE.joinpath(*parts)
        path = place / "__init__.py" if place.is_dir() else place.with_suffix(".py")
        if not parts or path in result or not path.is_file():
            continue
        result.add(path)
        if place.is_dir():
            # Recorded policies and similar data beside a package belong to what it computes.
            result.update(each for each in place.iterdir() if each.suffix in (".npz", ".toml"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                waiting += [each.name for each in node.names if each.name.startswith("course.")]
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("course"):
                # The imported name may be a module or something in one: both candidates are tried.
                waiting += [f"{node.module}.{each.name}" for each in node.names]
                waiting.append(str(node.module))
    return sorted(result)


def fingerprint(name: str) -> str:
    """Return a hash of what a recording depends on.

    Data as it is, sources without words for readers.
    """
    how = declaration.SECONDS, declaration.RATE, declaration.ROOM, declaration.GRID
    state = hashlib.sha256(repr(how).encode())
    for path in reached(name):
        state.update(path.relative_to(COURSE).as_posix().encode())
        if path.suffix == ".py":
            # Texts for readers do not change the pictures, so they need no new recording.
            state.update(_without_notes(bare(path.read_text(encoding="utf-8"))).encode())
        else:
            state.update(path.read_bytes())
    return state.hexdigest()


def _without_notes(source: str) -> str:
    """Return source without the notes of its presets and the tooltips of its readouts."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Preset"):
            node.args = node.args[:1]
            node.keywords = [each for each in node.keywords if each.arg == "values"]
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "READOUTS":
            node.value = ast.Constant(None)
    return ast.unparse(tree)


def stale(name: str) -> bool:
    """Return whether the recording of a simulation is missing or was made from other sources."""
    path = declaration.recording(name)
    if not path.exists():
        return True
    return json.loads(path.read_text(encoding="utf-8"))["fingerprint"] != fingerprint(name)


def main(chosen: Sequence[str]) -> None:
    """Record these simulations, or all that are stale, and write the recordings."""
    for name in chosen or filter(stale, names()):
        films = declaration.recorded(declaration.model(name))
        report = json.dumps({"fingerprint": fingerprint(name), "films": films}, indent=0)
        declaration.recording(name).write_text(f"{report}\n", encoding="utf-8")
        print(f"{name}: {len(report):,} bytes", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
