"""Claims of chapter 5: trees, edges, passages, roadmaps, and what is done to a path."""

from typing import Any

import numpy as np

_KEPT: dict[Any, list[Any]] = {}


def runs(scene: str, method: str, seeds: int, *place: float, **options: Any) -> list[Any]:
    """Return plans of a method, one a seed, in a ready-made scene (`scenes.gap(*place)`, ...).

    Those that another claim has asked for are not made again.
    """
    from course.planning import plan, scenes

    requested = getattr(scenes, scene)(*place)
    usual: dict[str, Any] = {"budget": 200_000}
    if "rrt" in method:
        usual["step"] = requested.step
    if method == "rrt":
        usual["goal_bias"] = 0.05
    options = usual | options
    retained = _KEPT.setdefault((scene, place, method, *sorted(options.items())), [])
    for seed in range(len(retained), seeds):
        retained.append(
            plan(
                requested.world, requested.start, requested.goal, method=method, rng=seed, **options
            )
        )
    return retained[:seeds]


def samples(*question: Any, **options: Any) -> np.ndarray:
    """Return samples of these runs, shape (seeds,)."""
    return np.array([answer.samples for answer in runs(*question, **options)])


def through_gap(share: float, thickness: float) -> float:
    """Return shortest path of `scenes.gap`: around both near corners of the opening [m]."""
    from course.planning import scenes

    requested = scenes.gap(share, thickness)
    corner = np.array([5.0 - 0.5 * thickness, 5.0 - 5.0 * share])
    return float(2.0 * np.linalg.norm(corner - requested.start) + thickness)
