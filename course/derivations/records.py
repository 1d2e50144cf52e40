"""What came out of each claim, on record: one TOML file a file of claims, reviewed as a diff.

An entry holds the verdict, the condition, the formula where a learner is asked for one, the inputs,
the figures, and a fingerprint of the claim's texts. A changed text disagrees with its record until
it is recorded again, after a look at it.
"""

import functools
import hashlib
import textwrap
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from course.check import invalid

FOLDER = Path(__file__).parent / "record"
_TEXTS = ("verdict", "condition", "formula", "texts")


@functools.cache
def load(file: str) -> dict[str, dict[str, Any]]:
    """Return the record of a file of claims: id -> entry; empty if there is none.

    Args:
        file: such as "rigid_body.flight".
    """
    path = FOLDER / f"{file}.toml"
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def figure(id: str, name: str) -> float | str:
    """Return a figure or an input of a claim as it is on record, without running its check.

    Args:
        id: id of a claim.
        name: name of the figure, or of an input of the check.

    Raises:
        ValueError: for an unknown id or name.
    """
    entries = {key: entry for file in files() for key, entry in load(file).items()}
    if id not in entries:
        raise invalid("id", id, "the id of a claim on record")
    known = {key: entry[0] for key, entry in entries[id]["figures"].items()}
    # An answer states the settings of a measurement, too; they are the inputs of the check.
    known = entries[id].get("inputs", {}) | known
    if name not in known:
        raise invalid("name", name, f"one of {', '.join(known)}")
    value: float | str = known[name]
    return value


def fingerprint(*texts: str) -> str:
    """Return a short hash of the texts of a claim."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def files() -> list[str]:
    """Return files of claims that have a record."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _value(value: float | str, tolerance: float = 1.0) -> str:
    if isinstance(value, str):
        return _quoted(value)
    text = f"{value:.10g}" if tolerance > 1e-9 else repr(value)
    return text if set(text) & set(".en") else f"{text}.0"  # TOML: 2 is no float


def _entry(id: str, entry: Mapping[str, Any]) -> list[str]:
    lines = [f"[{id}]"]
    for name in _TEXTS:
        text = entry.get(name, "")
        if not text:
            continue
        if len(text) <= 80:
            lines.append(f"{name} = {_quoted(text)}")
        else:  # a line that ends in a backslash goes on in the next
            escaped = text.replace("\\", "\\\\").replace('"', '\\"')
            rows = textwrap.wrap(escaped, 94, break_long_words=False, break_on_hyphens=False)
            lines.append(f'{name} = """\\\n  ' + " \\\n  ".join(rows) + '"""')
    if entry.get("inputs"):
        lines.append(f"[{id}.inputs]")
        lines += [f"{name} = {_value(value)}" for name, value in entry["inputs"].items()]
    lines.append(f"[{id}.figures]")
    for name, (value, tolerance) in entry["figures"].items():
        lines.append(f"{name} = [{_value(value, tolerance)}, {_value(tolerance)}]")
    return lines


def save(file: str, entries: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the record of a file of claims, sorted by id.

    Args:
        file: such as "rigid_body.flight".
        entries: id -> entry, as `load` returns them.
    """
    FOLDER.mkdir(exist_ok=True)
    head = f"# Written by `python -m course.derivations {file} --record`; reviewed as a diff."
    blocks = ["\n".join(_entry(id, entries[id])) for id in sorted(entries)]
    path = FOLDER / f"{file}.toml"
    path.write_text("\n\n".join([head, *blocks]) + "\n", encoding="utf-8")
    load.cache_clear()


def close(expected: float | str, tolerance: float, value: float | str) -> bool:
    """Return whether a figure is the one on record."""
    if isinstance(expected, str) or isinstance(value, str):
        return expected == value
    return value == expected or abs(value - expected) <= tolerance * (abs(expected) or 1.0)


def differences(old: Mapping[str, Any] | None, new: Mapping[str, Any]) -> Iterable[str]:
    """Yield where what came out differs from what is on record, one sentence each.

    Args:
        old: the entry on record, or None.
        new: the entry of a run.
    """
    if old is None:
        yield "not on record; `python -m course.derivations FILE --id ID --record` writes it"
        return
    for name in _TEXTS:
        if old.get(name, "") != new.get(name, ""):
            yield f"{name} on record: {old.get(name, '')!r}; found: {new.get(name, '')!r}"
    given, gives = old.get("inputs", {}), new["inputs"]
    for name in sorted({*given, *gives}):
        if name not in given or name not in gives or not close(given[name], 1e-9, gives[name]):
            yield f"input {name} on record: {given.get(name)!r}; found: {gives.get(name)!r}"
    before, now = old.get("figures", {}), new["figures"]
    for name in sorted(set(before) ^ set(now)):
        yield f"{name} is " + (
            "on record but not computed" if name in before else "computed, not on record"
        )
    for name in (name for name in before if name in now):
        (expected, tolerance), (value, allowed) = before[name], now[name]
        if not close(expected, tolerance, value):
            yield f"{name} is {_value(value)}, on record is {_value(expected)} within {tolerance:g}"
        if allowed != tolerance:
            yield f"the tolerance of {name} is {allowed:g}, on record is {tolerance:g}"


def merged(old: Mapping[str, Any] | None, new: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry to write.

    A figure that agrees keeps the digits on record, so diffs stay small.
    """
    before = (old or {}).get("figures", {})
    figures = {
        name: before[name]
        if name in before
        and before[name][1] == entry[1]
        and close(before[name][0], entry[1], entry[0])
        else entry
        for name, entry in new["figures"].items()
    }
    return {**new, "figures": figures}
