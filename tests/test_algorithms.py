"""The central algorithms of each chapter, as its package lists them, are found by their names."""

import importlib
import pkgutil
import re
from typing import Any

import pytest

from course import CHAPTERS

pytestmark = pytest.mark.smoke


def named_steps(topic: str) -> list[tuple[str, bool]]:
    """Return the names in a chapter's list of algorithms, and whether each is in the code."""
    package = importlib.import_module(f"course.{topic}")
    text = (package.__doc__ or "").partition("The chapter's algorithms")[2].partition(":\n\n")[2]
    listed = re.split(r"\n\n(?!- )", text)[0]
    paths = getattr(package, "__path__", [])
    sections = {
        module.name: importlib.import_module(f"course.{topic}.{module.name}")
        for module in pkgutil.iter_modules(paths)
        if module.name != "__main__"
    }
    known = set(sections)
    for module in (package, *sections.values()):
        for name, value in vars(module).items():
            known.add(name)
            if isinstance(value, type):  # `Class.method`, and a method by its name alone
                known |= {part for m in vars(value) for part in (m, f"{name}.{m}")}

    def exists(name: str) -> bool:
        first, _, rest = name.partition(".")
        if first not in sections or not rest:
            return name in known
        value: Any = sections[first]
        for part in rest.split("."):
            value = getattr(value, part, None)
        return value is not None

    return [(name, exists(name)) for name in re.findall(r"`([\w.]+)`", listed)]


@pytest.mark.parametrize("topic", [chapter.topic for chapter in CHAPTERS])
def test_the_steps_of_a_chapters_algorithms_are_in_its_code(topic: str) -> None:
    steps = named_steps(topic)
    assert len(steps) >= 3
    assert [name for name, present in steps if not present] == []
