"""How the presets of the learning simulation end, over ten seeds: a record, and what makes it.

Training is chaotic: a rounding error more, as on another CPU, and a seed ends elsewhere. So no test
rests on one run; the tests compare what ten seeds say together. Make the record again, in some
minutes of one core, with `python -m tests.learning.presets`.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.simulations.learning import point

RECORD = Path(__file__).with_name("presets.json")
SEEDS = range(10)
EARLY = 8  # the picture at a third of the run


def outcome(preset: str, seed: int) -> dict[str, float]:
    """Return what one run comes to.

    Args:
        preset: its name in the simulation.
        seed: of the run.

    Returns:
        success, early: share of the starts that arrive after the last iteration, and after a third.
        share: of the most that the prize can be worth, after the last iteration.
        began, ended: return after the first and the last iteration.
        moved: mean divergence of an iteration.
        excess: how much more than the truth the first episodes to finish show, at most.
    """
    controls = {name: field.default for name, field in point.CONTROLS.fields.items()}
    c: dict[str, Any] = controls | dict(point.PRESETS[preset].values) | {"seed": seed}
    rows = point.learned(
        float(c["rate"]), c["epochs"], seed, c["reward"], c["left_out"], int(c["first"])
    )[0].T
    read = rows[point.READ] if c["first"] else rows[point.SUCCESS]
    result = {
        "success": rows[point.SUCCESS, -1],
        "early": rows[point.SUCCESS, EARLY],
        "share": rows[point.SHARE, -1],
        "began": rows[point.RETURN, 0],
        "ended": rows[point.RETURN, -1],
        "moved": rows[point.MOVED].mean(),
        "excess": np.max(read - rows[point.SUCCESS]),
    }
    return {name: round(float(value), 4) for name, value in result.items()}


def recorded() -> dict[str, dict[str, NDArray[np.float64]]]:
    """Return the outcomes on record: preset -> name of an outcome -> one number for each seed."""
    stored = json.loads(RECORD.read_text(encoding="utf-8"))
    return {
        preset: {name: np.array(values) for name, values in result.items()}
        for preset, result in stored.items()
    }


def write_record() -> None:
    """Run every preset with every seed, and write what came out."""
    parts = []
    for preset in point.PRESETS:
        runs = [outcome(preset, seed) for seed in SEEDS]
        rows = [f'  "{name}": {[run[name] for run in runs]}' for name in runs[0]]
        parts.append(f'"{preset}": {{\n' + ",\n".join(rows) + "\n}")
        print(preset, flush=True)
    RECORD.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    write_record()
