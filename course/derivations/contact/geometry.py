"""Claims on the geometry of contact: bounding boxes, broad and narrow phase, thin walls, hulls."""

import math

import numpy as np

from course.derivations import Ask, Symbol, claim

SYMBOLS = {"n": Symbol("number of bodies", 2, 1000)}


def _still(x=0.0, y=0.0, z=0.0):
    """Return a pose without rotation."""
    return np.array([x, y, z, 1.0, 0.0, 0.0, 0.0])


def _row(rng, n):
    """Return n boxes along x, one on each metre."""
    middle = rng.uniform(0.0, 0.3, (3, n))
    middle[0] = rng.uniform(0.0, float(n), n)
    half = rng.uniform(0.25, 0.5, (3, n))
    return np.stack((middle - half, middle + half))


def _angle():
    """Return two plates that stand at right angles, where they are, and all of their corners."""
    from course import contact

    plates = [
        (contact.box([0.5, 0.5, 0.05]), _still(0.45, 0.0, -0.05)),
        (contact.box([0.05, 0.5, 0.45]), _still(0.0, 0.0, 0.45)),
    ]
    return plates, np.hstack([plate.corners + place[:3, None] for plate, place in plates])


def _text(values):
    return " ".join(map(str, np.ravel(values)))


def _depth_in_mesh(mesh, place):
    """Return how deep a ball of 20 mm is in a MuJoCo mesh [m], and the mesh's number of vertices.

    The depth is 0 without contact.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="mesh" {mesh}/></asset><worldbody><geom type="mesh" '
        f'mesh="mesh"/><body pos="{_text(place)}"><freejoint/><geom size="0.02"/></body>'
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return -data.contact.dist.min() if data.ncon else 0.0, int(model.mesh_graph[0])


@claim(
    "Two axis-aligned bounding boxes overlap exactly if they overlap on all three axes.",
    "They do. But that says little about the shapes inside: of random capsules (rods with round "
    "ends), four times as long as wide, whose boxes overlap, {apart_percent:.0f} % are apart.",
)
def aabb_all_axes(result):
    from course import contact
    from course.charts.contact.geometry import random_poses

    rod = contact.capsule(0.1, 0.3)
    boxes = contact.bounds(rod, random_poses(result.rng, 400, 1.0))
    i, j = contact.overlapping_pairs(boxes)
    # A point that both hold: the middle of the common interval, on every axis.
    low = np.maximum(boxes[0][:, i], boxes[0][:, j])
    high = np.minimum(boxes[1][:, i], boxes[1][:, j])
    # The pruned search must report as many pairs as the exhaustive one.
    missed = contact.brute_force(boxes)[0].shape[1] - i.size
    poses = random_poses(result.rng, 400, 1.0)
    i, j = contact.overlapping_pairs(contact.bounds(rod, poses))
    apart = contact.distance(rod, poses[:, i], rod, poses[:, j]).distance > 0.0
    result.measure("apart_percent", 100.0 * apart.mean(), 0.02)
    result.statement = f"{apart.size} pairs of overlapping boxes among 400 random capsules."
    result.statement_holds(bool((low <= high).all()))
    result.correction_holds(missed == 0, bool(apart.any()), bool((low <= high).all()))


class _Watched:
    """Boxes that note which of their numbers are read; two are compared at a time."""

    def __init__(self, boxes):
        self._boxes, self.shape, self.read = boxes, boxes.shape, []

    def __getitem__(self, place):
        self.read.append(place)
        return self._boxes[place]


@claim(
    "Testing two bounding boxes in space for overlap takes six comparisons at most.",
    "Two boxes are {numbers:.0f} numbers, and boxes that overlap take {comparisons:.0f} "
    "comparisons of them. Boxes that are apart usually take fewer, {mean_comparisons:.1f} on "
    "average for random ones, because the first axis that separates them ends the test.",
)
def aabb_six_numbers(result):
    from course.contact import broad

    def cost(low, edge):
        watched = _Watched(np.stack((low, low + edge)))
        overlap = broad.aabb_overlap(watched, 0, 1)
        # Every comparison reads two numbers.
        return overlap, len(set(watched.read)), len(watched.read) // 2

    # Overlapping boxes are the worst case: no axis ends the test early.
    overlap, numbers, comparisons = cost(np.array([[0.0, 0.5]] * 3), 1.0)
    result.measure("numbers", numbers)
    result.measure("comparisons", comparisons)
    draws = [cost(result.rng.uniform(0.0, 5.0, (3, 2)), 1.0) for _ in range(300)]
    counts = [took for together, _, took in draws if not together]
    every = [took for _, _, took in draws]
    mean = result.measure("mean_comparisons", np.mean(counts), 0.02)
    # Apart only along the last axis, to either side: one of the two takes every comparison.
    above = [cost(np.array([[0.0, 0.5], [0.0, 0.5], [0.0, z]]), 1.0) for z in (-2.0, 2.0)]
    largest = max(took for together, _, took in above if not together)
    result.statement = f"The course's own test, counted; {len(counts)} random boxes that are apart."
    result.statement_holds(max(comparisons, *every) == 6)
    result.correction_holds(
        overlap,
        numbers == 12,
        comparisons == 6,
        mean < comparisons,
        min(counts) == 1,
        largest == comparisons,
    )


@claim(
    "The usual listing, a_min[0] <= b_max[0] and a_max[0] >= b_min[0] and the same for [1], is "
    "the test of bounding boxes in three dimensions.",
    "It tests two axes only. Of the random boxes in space that it reports as overlapping, "
    "{false_percent:.0f} % are apart along z.",
)
def aabb_listing_two_axes(result):
    from course import contact

    def listing(a_min, a_max, b_min, b_max):
        return (
            a_min[0] <= b_max[0]
            and a_max[0] >= b_min[0]
            and a_min[1] <= b_max[1]
            and a_max[1] >= b_min[1]
        )

    low = result.rng.uniform(0.0, 4.0, (3, 60))
    boxes = np.stack((low, low + result.rng.uniform(0.5, 1.0, (3, 60))))
    reported = {
        (i, j)
        for i in range(60)
        for j in range(i + 1, 60)
        if listing(boxes[0, :, i], boxes[1, :, i], boxes[0, :, j], boxes[1, :, j])
    }
    true = set(map(tuple, contact.brute_force(boxes)[0].T.tolist()))
    # The same exhaustive search in the plane, which is what the listing computes.
    flat = set(map(tuple, contact.brute_force(boxes[:, :2])[0].T.tolist()))
    result.measure("false_percent", 100.0 * len(reported - true) / len(reported), 0.02)
    result.statement = f"{len(reported)} pairs reported among 60 boxes, {len(true)} overlap."
    result.statement_holds(reported == true)
    result.correction_holds(reported == flat, true < reported)


@claim(
    "Without a broad phase, 100 objects need 4,950 tests of pairs, and the number grows with the "
    "square of n.",
    "Testing every pair of n objects once takes n (n - 1) / 2 tests: {tests:.0f} for "
    "{objects:.0f} objects.",
    ask=Ask(
        "How many tests does it take to test every pair of n bodies once?",
        "n*(n - 1)/2",
        {
            "n**2": "A body is not tested against itself, and (i, j) is (j, i).",
            "n*(n - 1)": "That counts each pair twice, as (i, j) and as (j, i).",
            "n**2/2": "A body is not tested against itself.",
            "n*(n + 1)/2": "That also tests each body against itself.",
        },
    ),
)
def brute_force_pairs(result):
    import sympy

    from course import contact

    n = sympy.symbols("n", positive=True)
    result.formula = sympy.factor(
        sympy.summation(n - 1 - sympy.symbols("i"), (sympy.symbols("i"), 0, n - 1))
    )
    objects = result.input("objects", 100)
    # The sum is compared with the code's own counter, also at the smallest number of bodies.
    tests = [contact.brute_force(np.zeros((2, 3, size)))[1] for size in (objects, 2, 57)]
    result.measure("tests", tests[0])
    result.statement = "The tests of `brute_force`, counted, and the sum."
    result.statement_holds(tests[0] == 4950)
    result.correction_holds(
        *[
            bool(result.formula.subs(n, size) == count)
            for size, count in zip((objects, 2, 57), tests, strict=True)
        ]
    )


def _exponent(crowd, sizes=(500, 4000)):
    """Return the growth of the overlap tests with the number of boxes, sweeping along x."""
    from course import contact

    sweeps = [contact.SweepAndPrune(axis=0) for _ in sizes]
    for sweep, n in zip(sweeps, sizes, strict=True):
        sweep.pairs(crowd(n))
    # Slope of the tests over the number of boxes in a log-log plot; counts do not depend on the
    # machine.
    return float(np.polyfit(np.log(sizes), np.log([sweep.tests for sweep in sweeps]), 1)[0])


@claim(
    "Sweep and prune sorts the boxes along an axis, so it makes the broad phase O(N log N).",
    "That is the cost of the sorting. The overlap tests along one axis grow as N^{spread:.2f} for "
    "bodies that fill a cube, where theory says 5/3; as N^{settled:.2f} for bodies in one layer "
    "(theory: 3/2); and as N^{aligned:.2f} if all bodies overlap on the axis. Only for short "
    "bodies in a row along the axis do they grow as N^{row:.2f}.",
)
def sweep_and_prune_n_log_n(result):
    from course.contact import broad

    crowds = {
        kind: _exponent(lambda n, kind=kind: broad.crowd(kind, n, result.rng))
        for kind in broad.CROWDS
    }
    rows = [_exponent(lambda n: _row(result.rng, n)) for _ in range(8)]
    spread = [_exponent(lambda n: broad.crowd("spread", n, result.rng)) for _ in range(8)]

    def with_long_ones(n):
        boxes = _row(result.rng, n)
        # One box of ten is half as long as the row, so that the intervals of most pairs with it
        # overlap.
        grown = n / 4 * (result.rng.random(n) < 0.1)
        boxes[0, 0], boxes[1, 0] = boxes[0, 0] - grown, boxes[1, 0] + grown
        return boxes

    long = [_exponent(with_long_ones) for _ in range(3)]
    for kind, exponent in crowds.items():
        result.measure(kind, exponent, 0.03)
    result.measure("row", np.mean(rows), 0.03)
    # N log N from 500 to 4000 boxes has the exponent 1.14.
    largest = 1.0 + float(np.log(np.log(4000) / np.log(500)) / np.log(8.0))
    result.statement = "Overlap tests counted at 500 and 4,000 boxes of 1 m, one per cubic metre."
    result.statement_holds(
        max(crowds.values()) <= largest,
        only_if="the bodies stand in a row along the axis that is swept, and none of them is long",
        inside=[exponent <= largest for exponent in rows],
        # Chosen to break it: a row in which one body of ten is half as long as the row.
        outside=[exponent <= largest for exponent in (*spread, *long)],
    )
    result.correction_holds(
        # In a cube of side N^(1/3) a box overlaps N^(2/3) others on one axis, in a layer N^(1/2).
        # The tolerance covers effects of the boundary at finite N.
        abs(crowds["spread"] - 5 / 3) < 0.06,
        abs(crowds["settled"] - 3 / 2) < 0.06,
        abs(crowds["aligned"] - 2) < 0.06,
        abs(np.mean(rows) - 1.0) < 0.05,
        min(long) > 1.8,
    )


def _pile(geom, width, shape, count, seed=1):
    """Return pairs of boxes that overlap and pairs that touch, after bodies settled in a bin."""
    import mujoco

    from course import contact

    rng = np.random.default_rng(seed)
    walls = "".join(
        f'<geom type="plane" size="1 1 1" pos="{-width * x} {-width * y} 0" zaxis="{x} {y} 0"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    bodies = ""
    for k in range(count):
        # The start is loose and uneven: exact columns would stay columns.
        x, y = (np.array([k % 16 // 4, k % 4]) - 1.5) * width / 2.2 + rng.uniform(-0.01, 0.01, 2)
        z = 0.08 + 0.11 * (k // 16)
        turn = " ".join(map(str, rng.normal(size=4)))
        bodies += f'<body pos="{x} {y} {z}" quat="{turn}"><freejoint/>{geom}</body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="1 1 1"/>{walls}'
        f"{bodies}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 300)
    poses = data.qpos.reshape(count, 7).T.copy()
    # Unit quaternions, whatever rounding the last integration left.
    poses[3:] /= np.linalg.norm(poses[3:], axis=0)
    i, j = contact.overlapping_pairs(contact.bounds(shape, poses))
    # Within 1 mm counts as touching, because soft contacts rest at small positive or negative gaps.
    near = contact.distance(shape, poses[:, i], shape, poses[:, j]).distance <= 1e-3
    speed = np.abs(data.qvel.reshape(count, 6)[:, :3]).max(axis=1)
    return i.size, int(near.sum()), float(np.median(speed))


@claim(
    "A bin of 100 objects has 4,950 potential pairs; the broad phase leaves about 200.",
    "How many pairs remain depends on the shapes and on the pile. Of {bodies:.0f} balls settled "
    "in a bin it is {balls:.0f} pairs, of cubes {cubes:.0f} (dropped again: {cubes_again:.0f}), "
    "of rods eight times as long as wide {rods:.0f}. Of these pairs, {balls_touch:.0f}, "
    "{cubes_touch:.0f} and {rods_touch:.0f} really touch.",
)
def pile_of_a_hundred(result):
    from course import contact

    scenes = {
        "balls": ('<geom size="0.04"/>', contact.sphere(0.04)),
        "cubes": ('<geom type="box" size="0.035 0.035 0.035"/>', contact.box([0.035] * 3)),
        "rods": ('<geom type="capsule" size="0.015 0.105"/>', contact.capsule(0.015, 0.105)),
    }
    bodies = result.input("bodies", 100)
    remaining, speeds = {}, []
    for name, (geom, shape) in scenes.items():
        # The pile is chaotic, so the record allows 15 %.
        count, touching, speed = _pile(geom, 0.2, shape, bodies)
        remaining[name] = result.measure(name, count, 0.15)
        result.measure(f"{name}_touch", touching, 0.15)
        speeds.append(speed)
    again = result.measure(
        "cubes_again", _pile(scenes["cubes"][0], 0.2, scenes["cubes"][1], bodies, seed=2)[0], 0.15
    )
    result.statement = (
        "Dropped by MuJoCo into a bin 0.4 m wide for 1.5 s; median speed at the end at most "
        f"{max(speeds):.3f} m/s; touching is within 1 mm."
    )
    result.statement_holds(all(150 <= count <= 250 for count in remaining.values()))
    result.correction_holds(
        remaining["rods"] > 2 * max(remaining["balls"], remaining["cubes"]),
        # The counts are of a pile at rest, not of bodies that still fall.
        max(speeds) < 0.1,
        remaining["balls"] > max(remaining["cubes"], again),
    )


@claim(
    "Two convex shapes intersect exactly if their Minkowski difference contains the origin: this "
    "is what GJK tests.",
    "The first half is true of any two sets. GJK needs convex shapes, because it only asks for "
    "support points, and a shape has the same support points as its convex hull, the smallest "
    "convex shape around it. Of the balls that we placed in the notch of an L-shaped profile, "
    "{clear_percent:.0f} % touch neither leg. GJK sees the profile's hull and reports contact for "
    "all of them.",
)
def gjk_minkowski(result):
    from scipy.spatial import ConvexHull

    from course import contact

    clouds = result.rng.normal(size=(2, 60, 3, 8)) * 0.5
    offsets = result.rng.uniform(-1.0, 1.0, (60, 3))
    agree, inside = [], []
    for a, b, offset in zip(*clouds, offsets, strict=True):
        # The Minkowski difference of two point sets: every vertex of its hull is a difference of
        # vertices.
        difference = (a[:, :, None] - (b + offset[:, None])[:, None, :]).reshape(3, -1)
        # The origin is inside a hull if no facet's half-space excludes it. Qhull is independent of
        # GJK.
        holds = bool((ConvexHull(difference.T).equations[:, 3] <= 0.0).all())
        apart = contact.distance(contact.points(a), _still(), contact.points(b), _still(*offset))
        agree.append(bool((apart.distance <= 0.0) == holds))
        inside.append(holds)
    plates, corners = _angle()
    ball, place = contact.sphere(0.02), np.tile(_still()[:, None], 200)
    place[:3] = result.rng.uniform((0.0, -0.4, 0.05), (0.3, 0.4, 0.3), (200, 3)).T
    # The union of two convex plates is the truth for the L-shaped profile.
    clear = np.min([contact.distance(p, at, ball, place).distance for p, at in plates], 0) > 0.0
    observed = contact.distance(contact.points(corners), _still(), ball, place).distance <= 0.0
    result.measure("clear_percent", 100.0 * clear.mean(), 0.02)
    wrong = result.measure("wrong_percent", 100.0 * (observed & clear).mean(), 0.02)
    result.measure("share_inside", np.mean(inside), 0.02)
    # Both outcomes must occur among the samples, or agreement would prove little.
    result.statement = "60 pairs of random hulls against the hull of all differences by Qhull."
    result.statement_holds(all(agree))
    result.correction_holds(
        all(agree), wrong > 20.0, bool((observed | ~clear).all()), 0 < np.mean(inside) < 1
    )


# Two cubes with aligned faces, in a process that has asked Coal about nothing, or about a rod at a
# turned cube.
_FRESH = """
import sys
from course import contact
from course.oracles import coal
import numpy as np
cube, rod, still, x = contact.box([0.5] * 3), contact.capsule(0.2, 0.5), *np.eye(7)[[3, 0], :, None]
if sys.argv[1] == "turned":
    turned = np.array([[0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0]]).T / 30**0.5
    coal.Pair(rod, cube).distances(still, turned + 3 * x)
print(coal.Pair(cube, cube, float(sys.argv[2])).distances(still, still + 1.25 * x)[0] - 0.25)
"""


@claim(
    "An established library such as Coal is the truth that a narrow phase is measured against.",
    "It is as exact as its tolerances, and it has habits. With its default tolerance of "
    "{usual:.0e} it reports two aligned faces as touching up to a gap of {touch_um:.2f} um, and "
    "the distance between a box of a kilometre and one of a millimetre is off by up to "
    "{far_um:.0f} um. With tolerances of {tight:.0e}, its answers depend on the first "
    "query of a process, from which Coal stores a factor. If the search direction of that query "
    "had a zero component, later distances from a cube of a metre are off by {large:.0e} m; "
    "otherwise they are exact. Enumerating all pairs of features shows this; the "
    "course's own distance differs from the enumeration by {ours:.0e} of the size.",
    source="Coal 3 source, support_functions: a static factor of 1 + 1e-10 for boxes",
)
def coal_is_the_truth(result):
    import subprocess
    import sys

    from course import contact
    from course.charts.contact.geometry import random_poses
    from course.oracles import coal

    def compared(a, b, qa, qb):
        """Return exact distances, our largest error over the size, and Coal's distances."""
        # Enumeration of all feature pairs needs no iteration, so it has no tolerance of its own.
        truth = contact.enumerated(a, qa, b, qb)
        error = np.abs(contact.distance(a, qa, b, qb).distance - truth).max() / (a.size + b.size)
        return truth, error, coal.Pair(a, b, None).distances(qa, qb)

    tight = result.input("tight", 1e-12)
    n, cube = 500, contact.box([0.5] * 3)
    aligned, beside = (np.tile(_still()[:, None], n) for _ in range(2))
    # Gaps over eight decades, log-uniform, to bracket the tolerance at which Coal reports contact.
    beside[0] = 1.0 + 10.0 ** result.rng.uniform(-9.0, -1.0, n)
    beside[1:3] = result.rng.uniform(-0.4, 0.4, (2, n))
    result.measure("usual", coal.Pair(cube, cube, None).request.gjk_tolerance, 1e-9)
    gap, near, coals = compared(cube, cube, aligned, beside)
    touch = result.measure("touch_um", 1e6 * gap[coals <= 0.0].max(), 0.05)
    # A ratio of sizes of a million makes a relative tolerance visible as an absolute error.
    big, small = contact.box([500.0] * 3), contact.box([5e-4] * 3)
    pose = random_poses(result.rng, n, 700.0)
    truth, far, other = compared(big, small, aligned, pose)
    missed = result.measure("far_um", 1e6 * np.abs(other - truth).max(), 0.5)
    ours = result.measure("ours", max(near, far, 1e-15), 0.5)
    # Each in a new process: the library stores a static factor at the first query.
    first, turned = (
        abs(
            float(
                subprocess.run(
                    [sys.executable, "-c", _FRESH, how, str(tight)],
                    capture_output=True,
                    text=True,
                    check=True,
                ).stdout
            )
        )
        for how in ("aligned", "turned")
    )
    result.measure("large", first, 0.01)
    result.measure("plain", turned, 1e-6)
    result.statement = f"The same two cubes: off by {first:.1e} m, or {turned:.0e} m."
    result.statement_holds(touch < 1e-3 and missed < 1.0)
    result.correction_holds(
        0.5 < touch < 2.0,
        coals[gap > 2e-6].min() > 0.0,
        missed > 1.0,
        1e-11 < first < 1e-10,
        turned < 1e-15,
        ours < 1e-14,
    )


@claim(
    "When a body has sunk into another, EPA returns the way back to the side it came from.",
    "It returns the shortest way out. For a ball of {ball_mm:.0f} mm radius in a wall of "
    "{wall_mm:.0f} mm, that leads back as long as the depth is below {middle_mm:.1f} mm, the "
    "radius plus half the wall. Beyond that, EPA pushes the ball out on the far side. And EPA "
    "gives one point. Where faces meet, the contact is a polygon, with {corners:.0f} corners for a "
    "cube on a cube with parallel edges.",
)
def epa_gives_the_contact(result):
    from course import contact

    radius, wall = result.input("ball_mm", 20.0) / 1000, result.input("wall_mm", 10.0) / 1000
    middle = radius + wall / 2
    ball, slab = contact.sphere(radius), contact.box([1.0, 1.0, wall / 2])

    def back(sunk, aside=0.0):
        """Return whether the way out is the way in, of a ball [m] beside the wall's middle."""
        place = _still(x=aside, z=middle - sunk)
        return bool(contact.distance(slab, _still(), ball, place).normal[2] > 0.5)

    # Bisection of the depth at which the shortest way out changes sides.
    low, high = 0.0, 2.0 * middle
    while high - low > 1e-9:
        low, high = ((low + high) / 2, high) if back((low + high) / 2) else (low, (low + high) / 2)
    result.measure("middle_mm", 1000 * high)
    cube = contact.box([0.5, 0.5, 0.5])
    pair = np.stack((_still(), _still(0.1, 0.2, 0.99)), axis=1)
    corners = result.measure("corners", contact.contacts([cube, cube], pair).distance.size)
    result.statement = "A ball is pressed into a wall from above, to random depths."
    result.statement_holds(
        back(1.5 * middle),
        only_if="the ball's centre has not passed the middle of the wall (here, at a depth of "
        "{middle_mm:.1f} mm), and no edge of the wall is nearer",
        inside=[back(share * middle) for share in result.rng.uniform(0.01, 0.999, 12)]
        + [back(share * middle, 0.9) for share in result.rng.uniform(0.01, 0.999, 4)],
        # From just beyond the middle: there the way in and the way out differ least.
        outside=[back(share * middle) for share in result.rng.uniform(1.001, 1.9, 12)]
        # Chosen to break it: at the edge of the wall the shortest way out is sideways.
        + [back(share * middle, 0.999) for share in result.rng.uniform(0.9, 0.999, 4)],
    )
    single = contact.distance(cube, pair[:, 0], cube, pair[:, 1])
    result.correction_holds(
        abs(single.distance + 0.01) < 1e-12, corners == 4, abs(high - middle) < 1e-8
    )


@claim(
    "A circle test returns the depth and the normal of two circles that overlap.",
    "A common implementation divides by the distance of the centres, and returns no contact at all "
    "if that distance is {limit_m:.0e} m or less. But there the overlap is as deep as it can be: "
    "{depth_m:g} m here. At a distance of 0 any direction is a correct normal, and the code has to "
    "choose one.",
)
def circle_test_concentric(result):
    from course import contact

    limit = result.input("limit_m", 1e-8)

    def listing(p1, r1, p2, r2):
        diff = p2 - p1
        dist = np.linalg.norm(diff)
        if dist < r1 + r2 and dist > limit:
            return (r1 + r2) - dist, diff / dist
        return 0, np.zeros(2)

    places = result.rng.uniform(-1.0, 1.0, (30, 2))
    a, b = contact.sphere(0.7, 2), contact.sphere(0.5, 2)
    # At random offsets the listing and our distance must agree, so only the concentric case
    # differs.
    ours = [contact.distance(a, (0, 0, 0), b, (*p, 0)).distance for p in places]
    theirs = [listing(np.zeros(2), 0.7, p, 0.5)[0] for p in places]
    depth, normal = listing(np.zeros(2), 0.7, np.zeros(2), 0.5)
    deepest = contact.distance(a, (0, 0, 0), b, (0, 0, 0))
    result.measure("depth_m", -deepest.distance)
    result.statement = (
        f"The usual listing at equal centres: depth {depth}, normal {normal.tolist()}."
    )

    def right(middle, first, second):
        """Return whether the listing finds the depth, and a unit normal that separates."""
        depth, direction = listing(np.zeros(2), first, middle, second)
        overlap = first + second - np.hypot(*middle)
        gap = np.hypot(*(middle + depth * direction)) - first - second
        return bool(abs(depth - overlap) < 1e-12 and abs(gap) < 1e-12)

    radii = result.rng.uniform(0.3, 1.0, (8, 2))
    turns = result.rng.uniform(0.0, 2.0 * np.pi, 8)
    offsets = result.rng.uniform(0.01, 0.5, (8, 1)) * np.stack((np.cos(turns), np.sin(turns)), 1)
    # Chosen to break it: centres that are almost at the same point, on either side of the limit.
    near = (
        limit
        * result.rng.uniform(0.1, 0.99, 8)[:, None]
        * np.stack((np.cos(turns), np.sin(turns)), 1)
    )
    beyond = near * 10 ** result.rng.uniform(1.1, 4.0, (8, 1))
    result.statement_holds(
        depth > 0,
        only_if="the centres are farther apart than the listing's limit, {limit_m:.0e} m",
        inside=[right(p, *pair) for p, pair in zip(offsets, radii, strict=True)]
        + [right(p, *pair) for p, pair in zip(beyond, radii, strict=True)],
        outside=[right(np.zeros(2), *pair) for pair in radii]
        + [right(p, *pair) for p, pair in zip(near, radii, strict=True)],
    )
    result.correction_holds(
        bool(np.allclose(np.maximum(0.0, np.negative(ours)), theirs, atol=1e-12)),
        not normal.any(),
        abs(np.linalg.norm(deepest.normal) - 1.0) < 1e-12,
        abs(deepest.distance + 1.2) < 1e-12,
    )


@claim(
    "Testing the circles in every step finds their collisions.",
    "For a straight relative path that passes the centre at a distance d, they overlap over twice "
    "sqrt((r1 + r2)^2 - d^2). With steps up to three times as long, {missed_percent:.0f} % of "
    "random flights went undetected. The time of impact finds all of them.",
)
def circles_once_a_step(result):
    from course import contact

    a, b = contact.sphere(0.3, 2), contact.sphere(0.5, 2)

    def flights(low, high, n=40):
        """Return whether a test per step and whether the time of impact see each random hit."""
        h = result.rng.uniform(0.0, 0.75, n)
        # In units of the chord over which the discs overlap, which is the claimed limit.
        step = 2.0 * np.sqrt(0.8**2 - h**2) * result.rng.uniform(low, high, n)
        # A random phase of the first test within its step.
        start = -1.0 - step * result.rng.uniform(0.0, 1.0, n)
        observed = []
        for x, dx, y in zip(start, step, h, strict=True):
            at = np.zeros((3, 2 + int((1.0 - x) / dx)))
            at[0], at[1] = x + dx * np.arange(at.shape[1]), y
            observed.append(bool((contact.distance(b, (0, 0, 0), a, at).distance <= 0.0).any()))
        when = contact.spheres_time_of_impact(
            np.stack((-start, -h)), np.stack((-step, 0.0 * h)), 0.8
        )
        return observed, bool(np.isfinite(when).all())

    def moving(low, high, n=40):
        """Return whether a test per step sees each hit of two discs that both move."""
        observed = []
        for h in result.rng.uniform(0.0, 0.75, n):
            chord = 2.0 * np.sqrt(0.8**2 - h**2)
            # The relative motion of each step; either disc takes half of it, in its own direction.
            steps = chord * result.rng.uniform(low, high, 3 + int(2.0 / (chord * low)))
            x = -1.0 - steps[0] * result.rng.uniform() + np.cumsum(steps)
            # Both drift along the same random path, which does not count.
            drift = np.cumsum(result.rng.normal(0.0, 0.3, (2, len(x))), axis=1)
            at_a, at_b = np.zeros((2, 3, len(x)))
            half = 0.5 * np.stack((x, np.full(len(x), h)))
            at_a[:2], at_b[:2] = drift + half, drift - half
            observed.append(bool((contact.distance(b, at_b, a, at_a).distance <= 0.0).any()))
        return observed

    inside, all_inside = flights(0.1, 1.0)
    # From 0.1 % above the chord, where a miss is rarest.
    outside, all_outside = flights(1.001, 3.0)
    result.measure("missed_percent", 100.0 * (1.0 - np.mean(outside)), 0.02)
    result.statement = "Discs of 0.3 and 0.5 m; phase of the step and offset of the path at random."
    result.statement_holds(
        all(outside),
        only_if="no step of their relative motion is longer than the part of the relative path on "
        "which they overlap",
        # Chosen to break it: both discs move, on curved paths and in steps of unequal length.
        inside=inside + moving(0.1, 1.0),
        # And each disc by itself moves less than that part in a step, but the two together more.
        outside=outside + moving(1.001, 2.0),
    )
    result.correction_holds(all(inside), all_inside, all_outside, not all(outside))


@claim(
    "With a step that is small enough, nothing passes a thin wall.",
    "With one test per step, a hit can be missed only at (2 r + w) / h or faster: "
    "{geometric_m_per_s:.0f} m/s for a ball of {ball_mm:.0f} mm radius, a wall of {wall_mm:.0f} mm "
    "and a step of {step_ms:g} ms. But a soft contact gives way. Pushed past the middle of the "
    "wall, the ball comes out on the far side. In MuJoCo's default this starts "
    "at a speed of about e (r + w/2)/T, here {soft_m_per_s:.2f} m/s, where e is Euler's number and "
    "T the time constant (section 2); measured at three steps, at {smallest_m_per_s:.2f} to "
    "{largest_m_per_s:.2f} m/s.",
)
def soft_wall(result):
    from course.charts.contact.geometry import RADIUS, WALL, checked, in_mujoco

    radius, wall = (
        result.input("ball_mm", 1e3 * RADIUS) / 1e3,
        result.input("wall_mm", 1e3 * WALL) / 1e3,
    )
    dt = result.input("step_ms", 0.5) / 1000
    # Deepest point of a critically damped contact, hit with 1 m/s. At full impedance the row obeys
    # a = dmax a_ref with b = 2 / (dmax T) and k = dmax / (dmax T)^2: dmax cancels, w = 1 / T.
    t = np.linspace(0.0, 0.2, 20_001)
    soft = result.measure("soft_m_per_s", (radius + wall / 2) / np.max(t * np.exp(-t / 0.02)))

    def bisected(passes, low, high):
        while high - low > 0.005 * low:
            middle = (low + high) / 2
            low, high = (low, middle) if passes(middle) else (middle, high)
        return high

    def unseen(speed):
        """Return whether some phase of a test a step misses the ball."""
        # A fast ball is missed only at some phases of the step, so all phases are tried.
        return any(checked(dt, speed, phase) for phase in np.linspace(0.0, 1.0, 401))

    def through(speed, step):
        return any(in_mujoco(step, speed, phase) for phase in np.arange(3) / 3)

    geometric = result.measure("geometric_m_per_s", bisected(unseen, 50.0, 200.0), 0.02)
    limits = [bisected(lambda v, h=h: through(v, h), 2.0, 6.0) for h in (dt, 2 * dt, 4 * dt)]
    result.measure("smallest_m_per_s", min(limits), 0.05)
    result.measure("largest_m_per_s", max(limits), 0.05)
    result.statement = "Bisected over the speed, the ball's start shifted by thirds of a step."
    result.statement_holds(limits[0] > 2 * limits[2])
    result.correction_holds(
        # 5 %: the theory takes continuous time and a constant impedance, MuJoCo has neither.
        *[abs(limit / soft - 1.0) < 0.05 for limit in limits],
        abs(soft / (math.e * (radius + wall / 2) / 0.02) - 1.0) < 1e-6,
        abs(geometric * dt / (2 * radius + wall) - 1.0) < 0.02,
    )


@claim(
    "If a mesh is not convex, MuJoCo decomposes it into convex pieces by itself.",
    "It uses the convex hull of the mesh. A ball that hangs freely in the notch of an L-shaped "
    "profile, {free_mm:.0f} mm from both legs, is {depth_mm:.0f} mm deep in the mesh. The "
    "decomposition is the user's job, with another tool. Other engines may differ.",
    source="MuJoCo 4 documentation, Computation, Convex decomposition",
)
def concave_mesh_is_its_hull(result):
    from course import contact

    plates, corners = _angle()
    faces = np.reshape(
        [
            0,
            2,
            3,
            0,
            3,
            1,
            4,
            5,
            7,
            4,
            7,
            6,
            0,
            1,
            5,
            0,
            5,
            4,
            2,
            6,
            7,
            2,
            7,
            3,
            0,
            4,
            6,
            0,
            6,
            2,
            1,
            3,
            7,
            1,
            7,
            5,
        ],
        (12, 3),
    )
    ball, place = contact.sphere(0.02), _still(0.15, 0.0, 0.1)
    # In MuJoCo a mesh stands at its centre of mass, unless its frame is asked for.
    mesh = f'vertex="{_text(corners.T)}" face="{_text([faces, faces + 8])}" inertia="legacy"'
    depth, _ = _depth_in_mesh(mesh, place[:3])
    free = min(float(contact.distance(plate, at, ball, place).distance) for plate, at in plates)
    hull = contact.distance(contact.points(corners), _still(), ball, place).distance
    result.measure("free_mm", 1000 * free)
    result.measure("depth_mm", 1000 * depth, 1e-3)
    result.statement = (
        f"MuJoCo's contact is {1000 * depth:.2f} mm deep, the hull's {-1000 * hull:.2f}."
    )
    result.statement_holds(depth == 0.0)
    # Two independent distances: from the legs (the true shape) and from the hull of all corners.
    result.correction_holds(free > 0.05, depth > 0.0, abs(depth + hull) < 1e-6)


@claim(
    "Replace meshes by their convex hulls to make collisions fast: a mug of 5,000 triangles has a "
    "hull of about 20 faces.",
    "The hull of a round mug of {triangles:.0f} triangles keeps both rims and has {faces:.0f} "
    "triangles. In an engine that collides hulls anyway, such as MuJoCo, nothing gets faster: for "
    "the mesh and for its hull it stores the same {kept:.0f} corners, and both give the same "
    "depth for a ball. The inside of the mug is lost either way: a ball that hangs freely in it is "
    "{depth_mm:.0f} mm deep.",
)
def mug_and_its_hull(result):
    from scipy.spatial import ConvexHull

    from course import contact

    # Two triangles for each square of its 25 bands, and a fan at each of both ends.
    around, rings = result.input("triangles", 5200) // 52, 13
    angle = 2 * np.pi * np.arange(around) / around
    # Outside from the bottom up, over the rim, inside down again; closed by two middles.
    profile = [(0.04, z) for z in np.linspace(0.0, 0.1, rings)]
    profile += [(0.035, z) for z in np.linspace(0.1, 0.005, rings)]
    vertices = np.hstack(
        [[r * np.cos(angle), r * np.sin(angle), z + 0 * angle] for r, z in profile]
    )
    hull = ConvexHull(vertices.T)
    faces = result.measure("faces", len(hull.simplices))

    # Off the axis, so that the nearest point of the hull is unique.
    place = _still(0.01, 0.003, 0.05)
    # MuJoCo receives the mesh and, separately, only the corners of Qhull's hull.
    (whole, retained), (reduced, same) = (
        _depth_in_mesh(f'vertex="{_text(some.T)}"', place[:3])
        for some in (vertices, vertices[:, hull.vertices])
    )
    result.measure("kept", retained)
    inside = contact.distance(
        contact.points(vertices), _still(), contact.sphere(0.02), place
    ).distance
    result.measure("depth_mm", -1000 * inside, 1e-3)
    result.statement = (
        f"MuJoCo: {1000 * whole:.3f} mm deep in the mesh, {1000 * reduced:.3f} in its hull."
    )
    result.statement_holds(faces < 40)
    result.correction_holds(
        faces > 100, abs(whole - reduced) < 1e-6, whole > 0.0, inside < -0.02, retained == same
    )
