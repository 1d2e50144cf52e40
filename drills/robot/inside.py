"""What runs in the sandbox's child process: the whole loop, with no round trip in it.

The modules of `MODULES` import nothing but NumPy and each other. They travel as text, as the child
may not read the course's files; `bundle` packs them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drills.robot.cell import Level, World, make_task
from drills.robot.engine import PLAIN, Engine
from drills.robot.faults import with_fault
from drills.robot.loop import run_task
from drills.robot.parts import CALL, Bench, PartFailed
from drills.robot.promises import promises_of
from drills.robot.records import Cell, Estimate, Motion, Outcome, Sighting
from drills.robot.slots import FUNCTION_SHAPES, NAMED, Part, fits
from drills.robot.stages import build

MODULES = (
    "records",
    "slots",
    "cell",
    "engine",
    "parts",
    "promises",
    "stages",
    "faults",
    "loop",
    "inside",
)
# What a function of the learner's own may return as a plain tuple.
RECORDS: dict[str, Any] = {"perceive": Sighting, "estimate": Estimate, "plan": Motion}
_BOOT = """
import sys, types
for name in ("drills", "drills.robot"):
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = []
for name, text in SOURCES.items():
    name = "drills.robot." + name
    module = sys.modules[name] = types.ModuleType(name)
    module.__file__ = name + ".py"
    exec(compile(text, module.__file__, "exec", dont_inherit=True), module.__dict__)
    setattr(sys.modules["drills.robot"], name.rpartition(".")[2], module)
from drills.robot.inside import prepare, play, trace
"""


def bundle() -> str:
    """Return the loop as one text for the child."""
    folder = Path(__file__).parent
    sources = {name: (folder / f"{name}.py").read_text(encoding="utf-8") for name in MODULES}
    return f"SOURCES = {sources!r}\n{_BOOT}"


class Robot:
    """A robot with its parts, ready for tasks.

    Args:
        parts: of every slot, and of stages that are replaced as a whole.
        level: what it has to do.
        world: the arm as it is.
        seed: of all tasks.
        limit: processor time of a call [s]; 0 for trusted parts.
        fault: a stage and a direction, for level 6.
        engine: compiled functions for a robot of known parts.
    """

    def __init__(
        self,
        parts: list[Part],
        level: Level,
        world: World,
        seed: int,
        limit: float = CALL,
        fault: tuple[str, float] | None = None,
        engine: Engine = PLAIN,
    ) -> None:
        self.cell, self.level, self.world, self.seed = Cell(), level, world, seed
        # What the engine brings is the course's: the tests hold it to its promises.
        checks = {
            part.slot: promises_of(part.slot, part.holder)
            for part in parts
            if part.slot in NAMED and part.slot not in engine.functions
        }
        self.engine = engine
        self.bench = Bench({part.slot: part for part in parts}, checks, limit, engine.functions)
        self.stages = build(self.cell, self.bench, engine)
        for part in parts:
            if part.slot not in NAMED:
                own = _own_function(self.bench, part.slot)
                self.stages = self.stages._replace(**{part.slot: own})
        if fault is not None and fault[0] == "control":
            # A faulty law is called at each tick.
            self.engine = engine._replace(drive=None)
        if fault is not None:
            self.stages = with_fault(self.stages, *fault)

    def play(self, number: int, filmed: bool = False) -> Outcome:
        """Play task `number`; `filmed` records its motion."""
        task = make_task(self.cell, self.level, self.seed, number, self.engine.clearance)
        return run_task(
            self.cell, self.world, self.level, self.stages, self.bench, task, filmed, self.engine
        )


def _own_function(bench: Bench, name: str) -> Callable[[Any], Any]:
    """Return a function of `Stages` that a file of the learner's own defines."""

    def call(request: Any) -> Any:
        result = bench.call(name, request)
        record = RECORDS.get(name)
        if name == "perceive" and result is None:
            return None
        try:
            if record is not None:
                result = record(*result)
            values = result if isinstance(result, tuple) else (result,)
            arrays = [np.asarray(value, dtype=float) for value in values]
        except (TypeError, ValueError):
            text = f"returned a value of type {type(result).__name__} that is no result of {name}"
            raise bench.failed(name, "wrong type", text, (request,)) from None
        shapes = FUNCTION_SHAPES[name]
        if len(arrays) != len(shapes):
            text = f"returned {len(arrays)} values; {len(shapes)} are expected"
            raise bench.failed(name, "wrong type", text, (request,))
        for i, (array, shape) in enumerate(zip(arrays, shapes, strict=True)):
            if not fits(array.shape, shape):
                expected = str(shape).replace("None", "n")
                where = f"result {i + 1} of {len(shapes)}" if len(shapes) > 1 else "the result"
                text = f"{where} has the shape {array.shape}; {expected} is expected"
                raise bench.failed(name, "wrong shape", text, (request,))
        if name == "plan" and len({len(array) for array in arrays[2:]}) > 1:
            text = "q, v and a must have as many rows as each other, one a tick"
            raise bench.failed(name, "wrong shape", text, (request,))
        if not all(np.isfinite(array).all() for array in arrays):
            raise bench.failed(name, "not finite", "the result contains NaN", (request,))
        plain = record(*arrays) if record is not None else tuple(arrays)
        return plain if record is not None or len(plain) > 1 else plain[0]

    return call


_ROBOT: list[Robot] = []


def prepare(
    parts: list[list[Any]], level: list[Any], world: list[Any], seed: int, fault: list[Any] | None
) -> list[Any] | None:
    """Load the parts in the child; returns the failure of one, or None."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # what parts print would flood the pipe
    values: list[Any] = [tuple(v) if isinstance(v, list) else v for v in world]
    given = World(*values)
    try:
        listed = [Part(*part) for part in parts]
        chosen = (str(fault[0]), float(fault[1])) if fault else None
        _ROBOT[:] = [Robot(listed, Level(*level), given, seed, CALL, chosen)]
    except PartFailed as failed:
        return list(failed.failure)
    return None


def play(number: int, filmed: bool) -> Outcome:
    """Play one task in the child."""
    return _ROBOT[0].play(number, filmed)


def trace(number: int, entering: Callable[[str, int, str], object]) -> Outcome:
    """Play one task and report every call before it is made, to name one that never returns."""
    _ROBOT[0].bench.entering = entering
    return _ROBOT[0].play(number, False)
