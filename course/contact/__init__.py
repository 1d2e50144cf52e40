"""Chapter 2: contact and friction, from bounding boxes to the forces between bodies.

Geometry: shapes as data (`sphere`, `capsule`, `box`, `points`, `plane`; `dim=2` or sizes of two
numbers for the plane), `overlapping_pairs` of bounding boxes, `distance` of two shapes (signed,
with the nearest points and the unit normal from a to b), `contacts` of a scene (points, normals
from the first to the second body, signed distances), `time_of_impact`.

Forces: a `Problem` is one step of bodies in contact, `solve(model, problem)` answers with impulses
and says whether it solved it, `residuals` judges the impulses of any model or engine.

A pose is (x, y, z, qw, qx, qy, qz) in space and (x, y, angle) in the plane; components along
axis 0, a batch last.

The chapter's algorithms, and the functions of their steps:

- Sweep and prune (Baraff, 1992): `broad._sort` keeps the order, `broad._sweep` reports pairs.
- GJK (Gilbert, Johnson and Keerthi, 1988): `narrow._gjk`, with `_support` and `_nearest`, which
  reduces the simplex.
- EPA (van den Bergen, 2001): `narrow._grow` makes the first tetrahedron, `narrow._epa` expands the
  polytope: closest face, support, horizon, fan of faces.
- Clipped face manifolds (Sutherland and Hodgman, 1974): `features._box_contacts`, with `_facing`
  for the reference face and `_clip`.
- Projected Gauss-Seidel (Moreau, 1999; Jean, 1999): `models.pgs_sweep` visits the contacts,
  `project` is the cone, `sweep_until` the loop.
- Semismooth Newton on the natural map (Alart and Curnier, 1991): `models.natural_map`, and the line
  search in `_round_cone`.
- Conservative advancement (Mirtich, 1996): `sweep.time_of_impact`.

Examples:
    >>> from course import contact
    >>> ball, marble = contact.sphere(1.0), contact.sphere(0.5)  # radii [m]
    >>> result = contact.distance(ball, [0, 0, 0, 1, 0, 0, 0], marble, [2, 0, 0, 1, 0, 0, 0])
    >>> print(result.distance, result.point_a)  # m
    0.5 [1. 0. 0.]
"""

from course.contact.broad import SweepAndPrune, brute_force, overlapping_pairs, uniform_grid
from course.contact.features import Contacts, contacts, enumerated, separating_axes
from course.contact.models import MODELS, solve
from course.contact.narrow import Distance, distance
from course.contact.problem import Problem, Solution
from course.contact.residuals import Residuals, residuals
from course.contact.shapes import Shape, bounds, box, capsule, plane, points, sphere
from course.contact.sweep import Impact, spheres_time_of_impact, time_of_impact

__all__ = [
    "MODELS",
    "Contacts",
    "Distance",
    "Impact",
    "Problem",
    "Residuals",
    "Shape",
    "Solution",
    "SweepAndPrune",
    "bounds",
    "box",
    "brute_force",
    "capsule",
    "contacts",
    "distance",
    "enumerated",
    "overlapping_pairs",
    "plane",
    "points",
    "residuals",
    "separating_axes",
    "solve",
    "sphere",
    "spheres_time_of_impact",
    "time_of_impact",
    "uniform_grid",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    from course.contact import broad, features, models, narrow, scenes

    broad.warm()
    narrow.warm()
    features.warm()
    models.warm()
    scenes.warm()
