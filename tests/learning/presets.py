"""How the presets of the learning simulation end, over ten seeds: a record, and what makes it.

`presets.json` has the ten seeds that the panel offers, as its own learner trains them, and
`presets_pytorch.json` the same settings and seeds trained with the chapter's `ppo`. Their random
numbers differ, and training is chaotic: the tests compare what ten seeds say together. Make the
first record again, in some minutes of one core, with `python -m tests.learning.presets`, the second
one with `python -m tests.learning.presets pytorch`.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.learning import Settings, evaluate, first_finished, one_thread, ppo
from course.simulations.learning import point
from course.simulations.model import Experiment
from course.vector_env import PointReachVector

RECORD = Path(__file__).with_name("presets.json")
PYTORCH = Path(__file__).with_name("presets_pytorch.json")
SEEDS = range(10)
EARLY = 8  # the picture at a third of the run
BROKEN: tuple[dict[str, Any], ...] = (
    {},
    {"trace": 0.0},
    {"discount": 0.9},
    {"scale_rewards": False},
)


def settings_of(controls: Any) -> Settings:
    """Return the settings of the chapter's `ppo` that the controls name."""
    return Settings(
        horizon=point.HORIZON,
        minibatches=point.PARTS,
        hidden=(16, 16),
        rate=1e-3 * float(controls["rate"]),
        epochs=int(controls["epochs"]),
        **BROKEN[controls["left_out"]],
    )


def trained(preset: str, seed: int, **values: Any) -> Experiment:
    """Return the simulation with a preset and a seed, trained to the end."""
    experiment = Experiment(point.MODEL, **{**point.PRESETS[preset].values, "seed": seed, **values})
    experiment.advance(point.PICTURE * point.ITERATIONS + 0.01)
    return experiment


def pytorch(preset: str, seed: int) -> NDArray[np.float64]:
    """Return the report of the same run by the chapter's `ppo`: a row for each iteration."""
    controls = point.CONTROLS.new(**{**point.PRESETS[preset].values, "seed": seed})
    kind, report = point.REWARDS[controls["reward"]], np.zeros((point.ITERATIONS, 8))
    envs = PointReachVector(point.POINTS, kind, autoreset_mode="SameStep")
    test = PointReachVector(point.STARTS, kind)
    steps = point.ITERATIONS * point.POINTS * point.HORIZON
    with one_thread():
        for k, now in enumerate(ppo(envs, settings_of(controls), steps=steps, seed=seed)):
            played = evaluate(now.policy, test, point.FIRST, discount=point.DISCOUNT)
            worth = np.where(played.success, point.DISCOUNT ** (played.steps - 1.0), 0.0)
            report[k, point.SUCCESS], report[k, point.RETURN] = (
                played.success.mean(),
                played.returns.mean(),
            )
            report[k, point.SHARE] = worth.mean() / point.PRIZES[controls["reward"]]
            report[k, point.MOVED], report[k, point.SPREAD] = now.kl, now.spread
            if controls["first"]:
                read = first_finished(now.policy, test, point.STARTS, point.FIRST)
                report[k, point.READ] = read.success.mean()
    return report


def outcome(preset: str, seed: int, own: bool = True) -> dict[str, float]:
    """Return what one run comes to.

    Args:
        preset: its name in the simulation.
        seed: of the run.
        own: whether the simulation's learner trains, or the chapter's.

    Returns:
        success, early: share of the starts that arrive after the last iteration, and after a third.
        share: of the most that the prize can be worth, after the last iteration.
        began, ended: return after the first and the last iteration.
        moved: mean divergence of an iteration.
        excess: how much more than the truth the first episodes to finish show, at most.
    """
    # The first row of the simulation's report is the untrained policy.
    rows = trained(preset, seed).state["report"][1:].T if own else pytorch(preset, seed).T
    first = point.PRESETS[preset].values.get("first", False)
    read = rows[point.READ] if first else rows[point.SUCCESS]
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


def recorded(path: Path = RECORD) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Return the outcomes on record: preset -> name of an outcome -> one number for each seed."""
    stored = json.loads(path.read_text(encoding="utf-8"))
    return {
        preset: {name: np.array(values) for name, values in result.items()}
        for preset, result in stored.items()
    }


def write_record(own: bool) -> None:
    """Run every preset with every seed, and write what came out."""
    parts = []
    for preset in point.PRESETS:
        runs = [outcome(preset, seed, own) for seed in SEEDS]
        rows = [f'  "{name}": {[run[name] for run in runs]}' for name in runs[0]]
        parts.append(f'"{preset}": {{\n' + ",\n".join(rows) + "\n}")
        print(preset, flush=True)
    path = RECORD if own else PYTORCH
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    write_record(sys.argv[1:] != ["pytorch"])
