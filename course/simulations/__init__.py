"""Interactive simulations: pure models of what happens, and the one canvas that shows them all."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from course.check import finite, one_of

if TYPE_CHECKING:
    from course.simulations.panel import Panel

# The module of each simulation below this package, in the order of the chapters.
SIMULATIONS = (
    "role.stack",
    "role.development",
    "rigid_body.bouncing_box",
    "rigid_body.double_cover",
    "rigid_body.flip",
    "rigid_body.free_body",
    "rigid_body.gimbal",
    "rigid_body.force_evaluations",
    "rigid_body.spring",
    "rigid_body.top",
    "rigid_body.tunnelling",
    "contact.touch",
    "contact.friction_cone",
    "contact.half_axes",
    "contact.simplex",
    "contact.penalty_spring",
    "contact.sweeps",
    "contact.soft_contact",
    "contact.stopping_distance",
    "platforms",
    "kinematics.arm",
    "kinematics.elbow",
    "planning.growing",
    "control.joint",
    "control.nyquist",
    "control.probe",
    "perception",
    "sim_to_real.arms",
    "sim_to_real.faults",
    "learning.point",
    "learning.two_ways",
    "learning.policy_gradient",
    "learning.gae_weights",
    "learning.clipped_objective",
    "learning.cloning_drift",
    "learning.denoising",
    "learning.action_chunks",
    "middleware",
    "pipeline",
    "interview",
)

# The tag of the home page's cell whose simulation moves as soon as the page is there.
LIVE_TAG = "live"

# Those that no browser computes, by their name, and why: their presets are shown as recorded.
RECORDED = {
    "pipeline": (
        "its planner is a Python function that you can replace, which a browser cannot compile; in "
        "a notebook each change runs the whole pipeline more than 20 times, which takes 0.1 to 1 s"
    ),
}


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
