"""What the chapter's simulation shows: five scenes on every engine, recorded.

`python -m course.charts.platforms.record` runs them and writes `course/platforms/recorded.npz`.
With `heights` behind it, it runs only the braking block again and replaces the heights in that
file; with `costs` it times the motions again and replaces costs and the five numbers. All of them
need all engines.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from course import kinematics, platforms
from course.charts.platforms.smooth import again
from course.charts.platforms.table import relative_costs
from course.oracles.engines import engines
from course.oracles.readers import readings
from course.platforms import AS_SHIPPED, FAIR, Engine, Run, Scene, Settings, State, measures, scenes
from course.platforms.models import MODELS, honesty, verdict
from course.rigid_body import quaternion

Array = NDArray[np.float64]

PATH = Path(platforms.__file__).parent / "recorded.npz"
STEPS = (5e-4, 1e-3, 2e-3, 4e-3)  # [s]
SETTINGS = (AS_SHIPPED, FAIR)
SAMPLES = 41  # of a path, its start among them
HEADING = math.radians(22.5)


def shown() -> list[Scene]:
    """Return the scenes of the simulation, in the order of its menu."""
    return [
        scenes.tumble(4.0),
        scenes.chain(6, 2.0),
        scenes.brake(HEADING),
        scenes.tower(5),
        scenes.grasp(1.02 * 0.2 * scenes.GRAVITY),
    ]


def place(scene: Scene, state: State, time: float) -> tuple[float, float]:
    """Return where a state is drawn.

    The body's third axis, the tip [m], the block [m], or time [s] and the height gained by the
    highest cube or the part [mm].
    """
    if scene.judge == "turn":
        x, y, _ = quaternion.rotate(state.q[3:, 0], np.array([0.0, 0.0, 1.0]))
        return float(x), float(y)
    if scene.chain:
        x, y = kinematics.tip(scene.chain, state.q)[:2]
        return float(x), float(y)
    if scene.name == "brake":
        return float(state.q[0, 0]), float(state.q[1, 0])
    body = len(scene.bodies) - 1 if scene.name == "tower" else 0
    return time, 1e3 * float(state.q[2, body] - scene.start.q[2, body])


def samples(run: Run, scene: Scene, dt: float) -> Iterator[tuple[float, State]]:
    """Advance a run to the recorded times, one after the other; yield each time and state."""
    marks = np.round(np.linspace(0, round(scene.duration / dt), SAMPLES)).astype(int)
    for mark, steps in zip(marks, np.diff(marks, prepend=0), strict=True):
        run.run(int(steps))
        yield mark * dt, run.state()


def path(engine: Engine, scene: Scene, dt: float, settings: Settings) -> tuple[Array, float]:
    """Return the plotted trajectory of a run, (SAMPLES, 2), and its final error.

    Once a state is not finite, the last finite position is repeated.
    """
    run = platforms.prepared(engine, scene, dt, settings)
    rows, before, time = list[tuple[float, float]](), run.state(), 0.0
    for time, state in samples(run, scene, dt):
        before = state if np.isfinite(state.q).all() else before
        rows.append(place(scene, before, time))
    error = scene.error(run.state(), time)
    run.close()
    return np.array(rows), error


def heights(engine: Engine) -> Array:
    """Return the height of the braking block above its start [m], (SAMPLES,): fair, at 1 ms."""
    scene = scenes.brake(HEADING)
    run = platforms.prepared(engine, scene, 1e-3, FAIR)
    result = np.array([state.q[2, 0] for _, state in samples(run, scene, 1e-3)])
    run.close()
    return result - scene.start.q[2, 0]


def costs(result: list[Engine], scene: Scene) -> Array:
    """Return the cost of the motion at 1 ms, as a multiple of the fair MuJoCo's, (2, E).

    It is measured as in `platforms_table`: each time from the start to the end of the scene. Beyond
    its end the run may be another scene: a part that creeps leaves the grip, and an empty grip is
    cheaper.
    """
    steps = max(1, round(scene.duration / 1e-3))
    pairs = [(engine, settings) for settings in SETTINGS for engine in result]
    runs = [platforms.prepared(engine, scene, 1e-3, settings) for engine, settings in pairs]
    samplers = [again(run, steps) for run in runs]
    for sampler in samplers:
        sampler(1)  # the first motion warms the caches
    unit = len(result) + [engine.name for engine in result].index("MuJoCo")
    ratio = np.array(relative_costs(samplers, unit))[:, 1].reshape(2, len(result))
    for run in runs:
        run.close()
    same = [not engine.changes for engine in result]  # both settings are one
    ratio[:, same] = ratio[:, same].mean(axis=0)
    return ratio


# --- five numbers of each simulator, fair settings, from 0 to 1 ----------------------------------
# Both ends of an axis: what counts as 0 and as 1.
AXES = {
    "smooth accuracy": (100.0, 0.01),  # error over tolerance, at what MuJoCo costs at 1 ms
    "contact accuracy": (100.0, 0.01),  # error over tolerance at 1 ms
    "speed in contact": (1000.0, 0.1),  # cost of a step over MuJoCo's
    "largest step": (1e-4, 1e-1),  # that is within the tolerance [s]
    "honesty": (0.0, 1.0),  # share of faulty models that are refused or warned about; not log
}
SMOOTH, CONTACT = (0, 1), (2, 3, 4)  # of `shown`
TRIED = tuple(5e-4 * 2**k for k in range(7))  # steps for the largest within the tolerance [s]
READER = {"own code": "chapter 4"}  # who reads models for whom, where the names differ


def score(axis: str, value: Array) -> Array:
    """Return where values stand between the ends of an axis, on a log scale but for honesty."""
    low, high = AXES[axis]
    if axis == "honesty":
        return np.clip(value, 0.0, 1.0)
    return np.clip(np.log(np.maximum(value, 1e-300) / low) / np.log(high / low), 0.0, 1.0)


def equal_cost(errors: Array, cost: float) -> float:
    """Return the error at which a simulated second costs what MuJoCo's does at 1 ms.

    Along a line in logarithms through the steps that were run.

    Args:
        errors: at `STEPS`, (T,).
        cost: of a step, as a multiple of MuJoCo's.
    """
    slope, intercept = np.polyfit(np.log(STEPS), np.log(errors), 1)
    return float(np.exp(intercept + slope * np.log(1e-3 * cost)))


def radar(result: list[Engine], errors: Array, cost: Array, tolerance: Array) -> Array:
    """Return lowest over the scenes, middle and highest of each axis, (E, 5, 3)."""
    rows = np.zeros((len(result), len(AXES), 3))
    for e, engine in enumerate(result):
        report = readings(READER.get(engine.name, engine.name))
        verdicts = {model.name: verdict(model, report[model.name]) for model in MODELS}
        values = (
            [equal_cost(errors[s, :, 1, e], cost[s, 1, e]) / tolerance[s] for s in SMOOTH],
            [errors[s, 1, 1, e] / tolerance[s] for s in CONTACT],
            [cost[s, 1, e] for s in CONTACT],
            [measures.largest_step(engine, scene, TRIED) for scene in shown()],
            [honesty(verdicts)],
        )
        for k, (axis, given) in enumerate(zip(AXES, values, strict=True)):
            scores = score(axis, np.array(given))
            rows[e, k] = scores.min(), np.median(scores), scores.max()
        print(engine.name, [np.round(row, 4).tolist() for row in values], flush=True)
    return rows


def main() -> None:
    """Record everything."""
    result, names = list(engines().values()), list(engines())
    paths = np.zeros((len(shown()), len(STEPS), 2, len(result), SAMPLES, 2))
    errors, cost = np.zeros(paths.shape[:4]), np.zeros((len(paths), 2, len(result)))
    truth = np.zeros((len(paths), SAMPLES, 2))
    for s, scene in enumerate(shown()):
        for at, time in enumerate(np.linspace(0.0, scene.duration, SAMPLES)):
            true = State(time, scene.truth(time), np.zeros(0))
            truth[s, at] = place(scene, true, time)
        for t, dt in enumerate(STEPS):
            for k, settings in enumerate(SETTINGS):
                for e, engine in enumerate(result):
                    paths[s, t, k, e], errors[s, t, k, e] = path(engine, scene, dt, settings)
        cost[s] = costs(result, scene)
        print(scene.name, errors[s, 1].tolist(), cost[s].tolist(), flush=True)
    tolerance = np.array([scene.tolerance for scene in shown()])
    np.savez_compressed(
        PATH,
        paths=paths.astype(np.float32),
        truth=truth,
        errors=errors,
        costs=cost,
        tolerance=tolerance,
        radar=radar(result, errors, cost, tolerance),
        heights=np.array([heights(engine) for engine in result]),
        duration=np.array([scene.duration for scene in shown()]),
        steps=np.array(STEPS),
        engines=np.array(names),
        versions=np.array([engine.version() for engine in result]),
    )


def record_again(part: str) -> None:
    """Replace one part of the record and keep the rest of it.

    Args:
        part: `heights` of the braking block, or `costs`, with the five numbers that use them.
    """
    with np.load(PATH) as before:
        arrays = {name: before[name] for name in before.files}
    result = list(engines().values())
    if part == "heights":
        arrays["heights"] = np.array([heights(engine) for engine in result])
    else:
        arrays["costs"] = np.array([costs(result, scene) for scene in shown()])
        arrays["radar"] = radar(result, arrays["errors"], arrays["costs"], arrays["tolerance"])
    np.savez_compressed(PATH, **arrays)


if __name__ == "__main__":
    requested = [part for part in ("heights", "costs") if part in sys.argv[1:]]
    for part in requested:
        record_again(part)
    if not requested:
        main()
