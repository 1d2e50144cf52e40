"""The files of the cards: one per chapter, in this folder."""

import tomllib
from pathlib import Path
from typing import Any

from course.check import invalid

FOLDER = Path(__file__).parent


def read(topic: str) -> dict[str, Any]:
    """Return what the file of a chapter holds.

    Raises:
        ValueError: for a topic that has no file.
    """
    path = FOLDER / f"{topic}.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.toml")))
        raise invalid("topic", topic, known)
    return tomllib.loads(path.read_text(encoding="utf-8"))


def gate(topic: str) -> list[str]:
    """Return the claims that the checkpoint of a chapter asks for.

    Raises:
        ValueError: for a topic that has no file.
    """
    return list(read(topic)["checkpoint"])
