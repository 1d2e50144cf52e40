"""Chapter 5: motion planning. From here to there without touching anything, and a judge of paths.

The front door:

    plan(world, start, goal, *, method, budget, rng) -> Plan      any planner
    build_roadmap(world, samples) -> Roadmap                      for method="roadmap"
    check_path(world, path) -> Verdict                            the judge, of its own code
    shortcut, smooth(path, world, ...)                            shorter, smoother, free as before
    covariant_gradient, sequential_convex(path, world, ...)       pushed out of obstacles
    time_parameterise(path, limits) -> Trajectory                 state, rate, acceleration at any t
    plane, planar_arm, capsule_arm, from_function                 worlds as data
    with_self_collision, holding(world, shape, pose)              links and a held object checked
    state_free, edge_free, clearance                              what a world answers
    scenes                                                        ready-made questions

A state is (n,), a path (n, k): one state a column. A seed gives one answer.

The chapter's algorithms, and the functions of their steps:

- RRT (LaValle, 1998): `trees._grow` samples with `_target`, finds `_near`, extends with `_steer`.
- RRT-Connect (Kuffner and LaValle, 2000): `trees._connect`, one tree extends, the other connects.
- RRT* (Karaman and Frazzoli, 2011) and informed RRT* (Gammell et al., 2014): `trees._grow`, which
  chooses the parent and rewires the neighbours within the radius of `rrt_star`.
- Lazy PRM (Bohlin and Kavraki, 2000): `roadmaps._search` runs A*, `_resolve` checks its path.
- CBiRRT (Berenson et al., 2009), a cup carried upright: `manifold.constrain_config` projects,
  `manifold.constrained_extend` steps along the constraint manifold, `manifold.cbirrt` joins trees.
- Kinodynamic RRT (LaValle and Kuffner, 2001): `kinodynamic.kinodynamic_rrt` extends by `propagate`;
  `minimum_time` and `step_margin` are the bounds that its trajectories are tested with.
- Conservative advancement (Mirtich, 1996): `capsules._freed` and `worlds._arm_reach` bound the
  motion that is certainly free, `_edge` covers an edge with such bounds.

A new world is a `World` with three plain functions over its two tables (top of `worlds.py`), and a
judge of its edges in `check.JUDGES` under its kind, of other code (`check.prove` does the halving).
A new method is a function (`problem.Query`) -> `Plan` in `problem.METHODS`. It takes what it needs
from the query (world, start, the goal's box, budget, rng, `options` to pop from), hands
`query.world.kernels` to its compiled loop, counts in `query.counts` (`samplers.SAMPLES`,
`STATE_CHECKS`, `EDGE_CHECKS`), calls `query.report_progress(...)` between chunks of work, and
returns `query.answer(status, path, nodes=..., edges=...)` with the path's states as rows.
`samplers.draw`, `neighbours.nearest` and `within` are for any compiled loop.

Examples:
    >>> from course import planning
    >>> room = planning.plane([[0, 0], [1, 1]], discs=[[0.5, 0.5, 0.2]])  # corners; x, y, radius
    >>> planning.state_free(room, [0.1, 0.1]), planning.edge_free(room, [0, 0], [1, 1])
    (True, False)
    >>> path = planning.plan(room, [0.1, 0.1], [0.9, 0.9], method="rrt_connect", rng=0).path
    >>> bool(planning.length(path) > 2**0.5 * 0.8)  # around the disc is farther than straight on
    True
"""

from course.planning import scenes
from course.planning.capsules import Shelf, capsule_arm, shelf, with_sphere
from course.planning.check import Verdict, check_path
from course.planning.held import holding, with_self_collision
from course.planning.problem import METHODS, Budget, Plan, Region, length, plan
from course.planning.roadmaps import Roadmap, adapted, build_roadmap, revalidated, with_paths
from course.planning.scenes import Scene
from course.planning.trajectory import (
    Limits,
    Trajectory,
    covariant_gradient,
    sequential_convex,
    shortcut,
    smooth,
    time_parameterise,
)
from course.planning.trees import rrt, rrt_connect, rrt_star
from course.planning.worlds import (
    World,
    clearance,
    edge_free,
    from_function,
    planar_arm,
    plane,
    state_free,
)

__all__ = [
    "METHODS",
    "Budget",
    "Limits",
    "Plan",
    "Region",
    "Roadmap",
    "Scene",
    "Shelf",
    "Trajectory",
    "Verdict",
    "World",
    "adapted",
    "build_roadmap",
    "capsule_arm",
    "check_path",
    "clearance",
    "covariant_gradient",
    "edge_free",
    "from_function",
    "holding",
    "length",
    "plan",
    "planar_arm",
    "plane",
    "revalidated",
    "rrt",
    "rrt_connect",
    "rrt_star",
    "scenes",
    "sequential_convex",
    "shelf",
    "shortcut",
    "smooth",
    "state_free",
    "time_parameterise",
    "warm",
    "with_paths",
    "with_self_collision",
    "with_sphere",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    from course.planning import (
        batches,
        capsules,
        held,
        kinodynamic,
        manifold,
        roadmaps,
        trajectory,
        trees,
        worlds,
    )

    worlds.warm()
    capsules.warm()
    batches.warm()
    held.warm()
    trees.warm()
    roadmaps.warm()
    trajectory.warm()
    manifold.warm()
    kinodynamic.warm()
