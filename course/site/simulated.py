"""The simulations of the course by name, for the pages that show them."""

import functools
import importlib
import pkgutil

from course import CHAPTERS
from course.simulations.model import Model


@functools.cache
def models() -> dict[str, Model]:
    """Every model, by its path below `course.simulations`, in the order of the chapters."""
    found = {}
    for chapter in CHAPTERS:
        whole = importlib.import_module(chapter.simulation_module)
        inner = [each.name for each in pkgutil.iter_modules(getattr(whole, "__path__", ()))]
        for name in [f"{chapter.topic}.{each}" for each in inner] or [chapter.topic]:
            module = importlib.import_module(f"course.simulations.{name}")
            if hasattr(module, "MODEL"):
                found[name] = module.MODEL
    return found


@functools.cache
def by_label() -> dict[str, str]:
    """The name of each model by the words that its pictures carry for those who cannot see them."""
    return {model.paper.label: name for name, model in models().items()}
