"""Interactive simulations: pure models of what happens, and the one canvas that shows them all."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from course.check import finite, one_of
from course.simulations.registry import SIMULATIONS

if TYPE_CHECKING:
    from course.simulations.panel import Panel

# The tag of the home page's cell whose simulation moves as soon as the page is there.
LIVE_TAG = "live"


def warm() -> None:
    """Compile, or load from the cache, what simulations run and no chapter does."""
    from course.simulations.control import joint, nyquist, probe
    from course.simulations.learning import point

    for model in (nyquist, joint, probe, point):
        model.warm()


def simulation(name: str, preset: str = "", still: float = 3.0) -> Panel:
    """Return a simulation as a widget for a notebook; it starts paused.

    Args:
        name: the last part of a name in `SIMULATIONS`, such as "bouncing_box" or "pipeline".
        preset: what it begins with, one of its presets; its first one if empty.
        still: how far into its motion the picture of a saved notebook is [s].

    Raises:
        ValueError: there is no such simulation or preset.
    """
    from course.simulations.panel import Panel

    modules = {module.rpartition(".")[2]: module for module in SIMULATIONS}
    module = modules[one_of("name", name, modules)]
    still = finite("still", still, 0.0, unit="s")
    panel = Panel(importlib.import_module(f"{__name__}.{module}").MODEL, still)
    presets = panel.model.presets
    panel.choose(one_of("preset", preset, presets) if preset else next(iter(presets)))
    return panel
