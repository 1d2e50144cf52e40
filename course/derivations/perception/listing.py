"""Claims of chapter 7: what a tutorial's chain is said to do, and a pose good enough to grasp."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "L": Symbol("length [m]"),
    "W": Symbol("width [m]"),
    "phi": Symbol("turn [rad]", 0.1, 1.4),
    "b": Symbol("width of a finger [m]"),
    "e": Symbol("error sideways [m]", 0.001, 0.002),
    "t": Symbol("error of the turn [rad]", 0.01, 0.1),
}


@claim(
    "The five steps of an Open3D tutorial (read a file of points, voxels, plane, clusters, boxes) "
    "can be applied to a depth image as they are.",
    "The first step reads a file of points. With a file that contains the points of our image, "
    "the steps find {there:.0f} clusters for {boxes:.0f} boxes. Without it, Open3D warns, "
    "continues with {empty:.0f} points, and fails at the plane. A depth image has to be "
    "converted to points in metres first: the tutorial's lengths are metres, and with points in "
    "millimetres the steps ran through and found {mm:.0f} of {two:.0f} boxes.",
    source="Open3D 0.20 itself",
)
def tutorial_runs(result):
    import tempfile
    from pathlib import Path

    from course.charts.perception.poses import BOX, EYE, SENSOR, TABLE
    from course.charts.perception.precision import on_table
    from course.oracles.open3d import Picture, library
    from course.perception import render, sense, shape, together

    o3d, folder = library(), tempfile.TemporaryDirectory()

    def clusters(file):
        cloud = o3d.io.read_point_cloud(file).voxel_down_sample(0.005)
        _, near = cloud.segment_plane(0.01, 3, 1000)
        return np.max(cloud.select_by_index(near, invert=True).cluster_dbscan(0.02, 50)) + 1

    def fails(file):
        try:
            return clusters(file) is None
        except RuntimeError:  # a plane without points
            return len(o3d.io.read_point_cloud(file).points) == 0
        except ValueError:  # no clusters, of which to take the largest number
            return True

    boxes = int(result.input("boxes", 3))
    places = [
        (x, 0.0, yaw)
        for x, yaw in zip((-0.25, 0.0, 0.25), result.rng.uniform(0, 1, 3), strict=True)
    ]
    things = [BOX.moved(on_table(BOX, *place)) for place in places[:boxes]]
    depth, _ = render(together([shape("plane").moved(TABLE), *things]), EYE)
    other = str(Path(folder.name) / "scene.ply")
    o3d.io.write_point_cloud(other, Picture(sense(depth, EYE, SENSOR, result.rng), EYE).cloud())
    count = result.measure("there", clusters(other))
    bare = o3d.geometry.PointCloud()
    spots = result.rng.uniform(-0.5, 0.5, (2000, 3)) * [1.0, 1.0, 0.0]
    bare.points = o3d.utility.Vector3dVector(spots)
    table = str(Path(folder.name) / "table.ply")
    o3d.io.write_point_cloud(table, bare)

    def with_part(height):
        """Return a file of this table with a square part on it, so high [m]."""
        points = spots.copy()
        points[np.abs(points[:, :2]).max(axis=1) < 0.1, 2] = height
        some, file = o3d.geometry.PointCloud(), str(Path(folder.name) / f"part_{height}.ply")
        some.points = o3d.utility.Vector3dVector(points)
        o3d.io.write_point_cloud(file, some)
        return file

    def found(pitch, unit=1.0):
        """Return the clusters of a dense table with two boxes, points `pitch` [m] apart.

        Args:
            pitch: distance between neighbouring points [m].
            unit: of the file, 1000 for millimetres.
        """
        x, y = np.meshgrid(np.arange(-0.3, 0.3, pitch), np.arange(-0.15, 0.15, pitch))
        points = np.stack((x.ravel(), y.ravel(), np.zeros(x.size)), axis=1)
        on_box = (np.abs(np.abs(points[:, 0]) - 0.15) < 0.05) & (np.abs(points[:, 1]) < 0.05)
        points[on_box, 2] = 0.05
        points += 1e-3 * result.rng.standard_normal(points.shape)
        some, file = o3d.geometry.PointCloud(), str(Path(folder.name) / "dense.ply")
        some.points = o3d.utility.Vector3dVector(unit * points)
        o3d.io.write_point_cloud(file, some)
        return clusters(file)

    pitch, two = result.input("pitch_mm", 4) / 1000, result.input("two", 2)
    # Chosen to break it: points too far apart for 50 neighbours, and a file in millimetres.
    coarse = found(0.01)
    mm = result.measure("mm", found(pitch, 1000.0))
    empty = str(Path(folder.name) / "none.pcd")  # a reader that says nothing by itself
    result.measure("empty", len(o3d.io.read_point_cloud(empty).points))
    result.statement = "The steps with the tutorial's numbers, with a file and without."
    result.statement_holds(
        fails(other),
        only_if="the image was converted to a file of points in metres first, they are dense "
        "enough for the neighbours that the cluster step counts (here {pitch_mm:.0f} mm apart), "
        "and not all of them are within the plane's tolerance of one plane",
        inside=[count == boxes, found(pitch) == two],
        # Chosen to break it: a part that is lower than the plane's tolerance of 10 mm.
        outside=[not fails(empty), not fails(table), not fails(with_part(0.005))]
        + [coarse == two, mm == two],
        cases=True,
    )
    result.correction_holds(
        count == boxes, fails(empty), fails(table), fails(with_part(0.005)), mm < two
    )


@claim(
    "RANSAC removes the table, and the objects are left.",
    "It removes the largest plane. A board whose top has {more:.1f} times as many pixels as the "
    "table is taken for the table, and the table is left as an object. And a plate with "
    "{share:.0%} of the table's pixels, two or three tolerances high, tilts the plane by "
    "{tilt:.1f} degrees, because a slanted plane through both has more inliers than either. The "
    "tops of many "
    "equally high parts are one plane, too.",
)
def ransac_takes_the_table(result):
    from course.charts.perception.poses import EYE, SENSOR, TABLE
    from course.perception import (
        back_project,
        ransac_plane,
        render,
        sense,
        shape,
        together,
    )
    from course.rigid_body.quaternion import rotate

    def table_found(side):
        """Return whether the plane is the table, and the board's pixels over the table's."""
        board = shape("box", side, side, 0.05)
        top = np.append(TABLE[:3] + rotate(TABLE[3:], np.array([0, 0, 0.05])), TABLE[3:])
        depth, ids = render(together([shape("plane").moved(TABLE), board.moved(top)]), EYE)
        points, _ = back_project(sense(depth, EYE, SENSOR, result.rng), EYE)
        plane, _, _ = ransac_plane(points, 0.006, result.rng)
        return abs(plane[:3] @ TABLE[:3] + plane[3]) < 0.02, np.sum(ids == 1) / np.sum(ids == 0)

    def slant(side, height):
        """Return the plane's tilt [rad] where a large plate lies at the right, its share.

        If it is off.
        """
        plate, at = shape("box", 0.5, 0.5, 0.5 * height), np.array([side, 0.0, 0.5 * height])
        low = np.append(TABLE[:3] + rotate(TABLE[3:], at + [0.5, 0.0, 0.0]), TABLE[3:])
        depth, ids = render(together([shape("plane").moved(TABLE), plate.moved(low)]), EYE)
        points, _ = back_project(sense(depth, EYE, SENSOR, result.rng), EYE)
        plane, _, _ = ransac_plane(points, 0.006, result.rng)
        up = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
        tilt, share = np.arccos(min(1.0, plane[:3] @ up)), np.sum(ids == 1) / np.sum(ids == 0)
        return tilt, share, tilt < 0.005

    def crowded(side, pitch, count, height):
        """Return whether a grid of boxes leaves the table the plane, and their largest share."""
        things = [shape("plane").moved(TABLE)]
        for i in range(-count, count + 1):
            for j in range(-count, count + 1):
                at = TABLE[:3] + rotate(TABLE[3:], np.array([i * pitch, j * pitch, height / 2]))
                one = shape("box", side, side, height / 2)
                things.append(one.moved(np.append(at, TABLE[3:])))
        depth, ids = render(together(things), EYE)
        points, _ = back_project(sense(depth, EYE, SENSOR, result.rng), EYE)
        plane, _, _ = ransac_plane(points, 0.006, result.rng)
        pixels = np.bincount(ids[ids >= 0].ravel())
        return abs(plane[:3] @ TABLE[:3] + plane[3]) < 0.02, pixels[1:].max() / pixels[0]

    def stairs(height):
        """Return whether five steps leave the table the plane, and the largest one's share."""
        things = [shape("plane").moved(TABLE)]
        for k in range(1, 5):
            half = 0.5 * k * height
            at = TABLE[:3] + rotate(TABLE[3:], np.array([0.0, 0.1 * k - 0.2, half]))
            things.append(shape("box", 0.5, 0.05, half).moved(np.append(at, TABLE[3:])))
        depth, ids = render(together(things), EYE)
        points, _ = back_project(sense(depth, EYE, SENSOR, result.rng), EYE)
        plane, _, _ = ransac_plane(points, 0.006, result.rng)
        up = rotate(TABLE[3:], np.array([0.0, 0.0, 1.0]))
        pixels = np.bincount(ids[ids >= 0].ravel())
        return abs(plane[:3] @ up) > np.cos(0.005), pixels[1:].max() / pixels[0]

    # Boards clearly smaller and slightly larger than the visible table.
    small = [table_found(x) for x in result.rng.uniform(0.03, 0.15, 8)]
    large = [table_found(x) for x in result.rng.uniform(0.27, 0.3, 8)]
    result.measure("more", min(share for _, share in large), 0.1)
    plates = [slant(x, 0.006 * h) for x, h in result.rng.uniform((0.02, 2), (0.1, 3), (8, 2))]
    result.measure("share", max(share for _, share, _ in plates), 0.1)
    crowds = [crowded(0.06, 0.14, 4, 0.03), crowded(0.03, 0.1, 5, 0.1)]
    tilt = result.measure("tilt", np.degrees(np.median([tilt for tilt, _, _ in plates])), 0.3)

    def synthetic(share, height, most):
        """Return whether the table is removed and parts are left, from points in a box.

        Args:
            share: of the points that lie on the table.
            height: of the lowest part [m]; with a share of nearly 1, the only one.
            most: largest number of triples.
        """
        part = result.rng.uniform((-0.5, -0.5, height), (0.5, 0.5, max(height, 0.5)), (1500, 3))
        on_table = np.arange(1500) < share * 1500
        part[on_table, 2] = 1e-3 * result.rng.standard_normal(on_table.sum())
        # Parts that stand apart are points at any height; a flat one has one height.
        if height < 0.01:
            part[~on_table, 2] = height
        _, near, _ = ransac_plane(part.T, 0.006, result.rng, at_most=most)
        return bool(near[on_table].mean() > 0.9 and near[~on_table].mean() < 0.1)

    # Chosen to break it: washers of 4 mm, within the tolerance; and a table that is the largest
    # plane, but an eighth of the points, with too few triples.
    washers = [synthetic(0.95, 0.004, 1000) for _ in range(3)]
    hurried = [synthetic(0.12, 0.02, 100) for _ in range(8)]
    patient = [synthetic(0.12, 0.02, 10_000) for _ in range(3)]
    result.statement = "Square boards of 60 to 600 mm, 100 mm high, and low plates, on a table."
    result.statement_holds(
        all(ok for ok, _ in large),
        only_if="no other plane has as many points within the tolerance as the table: not that of "
        "a large part or of many equally high parts, and no slanted one through the table and low "
        "plates or steps; every object is higher than the tolerance; and enough triples are "
        "sampled for the table's share of the points",
        inside=[ok for ok, _ in small]
        + patient
        # Chosen to break it: the same plates, too high for a slanted plane.
        + [slant(x, 0.006 * 6)[2] for x in (0.1, 0.25)],
        outside=[ok for ok, _ in large]
        + [ok for _, _, ok in plates]
        + [ok for ok, _ in crowds]
        # A plate and steps of which each shows less than the table.
        + [slant(0.1, 0.015)[2], stairs(0.012)[0]]
        + washers
        + [all(hurried)],
    )
    result.correction_holds(
        tilt > 0.5,
        max(share for _, share, _ in plates) < 1,
        not any(ok for ok, _ in large),
        all(share < 1 for _, share in small),
        not any(ok or share > 1 for ok, share in crowds),
        all(share > 1 for _, share in large),
    )


@claim(
    "The extent of an axis-aligned box around a cluster is the object's size.",
    "A part of {long:.0f} x {wide:.0f} mm that is turned by phi has the extent {formula} along x: "
    "{measured:.0f} mm at {turn} rad, which is longer than any of its sides. Fit the part's own "
    "shape to the points instead.",
    ask=(
        "A rectangle L x W is turned by phi, less than a right angle. Extent along x?",
        "L*cos(phi) + W*sin(phi)",
        {
            "L": "Only where it lies along the axes.",
            "L*cos(phi)": "The other side reaches out too.",
            "sqrt(L**2 + W**2)": "That is the diagonal: the greatest extent of all turns.",
        },
    ),
)
def extent_is_size(result):
    import sympy

    from course.charts.perception.poses import BOX, EYE, TABLE
    from course.charts.perception.precision import on_table
    from course.kinematics.chain import invert
    from course.perception import back_project, render
    from course.rigid_body.quaternion import rotate

    L, W, phi = sympy.symbols("L W phi", positive=True)
    turn = sympy.Matrix([[sympy.cos(phi), -sympy.sin(phi)], [sympy.sin(phi), sympy.cos(phi)]])
    result.formula = sympy.expand(2 * (turn * sympy.Matrix([L / 2, -W / 2]))[0])
    long, wide = 2000 * BOX.sizes[:2, 0]
    result.measure("long", long)
    result.measure("wide", wide)

    def extent(yaw):
        points, _ = back_project(render(BOX.moved(on_table(BOX, 0.0, 0.0, yaw)), EYE)[0], EYE)
        # Points in the table's frame, where the box is turned by the yaw only.
        back = invert(TABLE[:, None])[:, 0]
        return 1000 * np.ptp(rotate(back[3:], points)[0])

    turns = [result.input("turn", 0.6), *result.rng.uniform(0.1, 1.4, 6)]
    law = [float(result.formula.subs({L: long, W: wide, phi: x})) for x in turns]
    measured = result.measure("measured", extent(turns[0]), 0.02)
    result.statement = "Extents along the table's x of exact pictures of a box at seven turns."
    result.statement_holds(abs(measured - long) < 5)
    result.correction_holds(
        np.allclose([extent(x) for x in turns], law, atol=5.0), measured > long + 10
    )


@claim(
    "One worker that takes 100 ms for an image processes all images of a camera that takes 30 per "
    "second.",
    "It delivers {rate:.0f} poses per second and drops the other images. Several workers in turn "
    "deliver all {camera:.0f}, but each pose is as old as before when it arrives: at {speed:.0f} "
    "mm/s the part has moved on by {late_mm:.0f} mm. A higher rate doesn't remove this error. A "
    "prediction to the time of use does, while the part keeps its speed: {left_mm:.1f} mm remain "
    "if each coordinate of a pose has {noise_mm:g} mm of noise, and the filter allows for "
    "accelerations of {allowed:g} m/s^2. The more it allows for, the more its velocity follows the "
    "noise.",
)
def pipeline_keeps_up(result):
    from course.perception import Tracker
    from course.role import Stage, age

    camera, work = result.input("camera", 30), result.input("work_ms", 100) / 1000
    alone = Stage("pipeline", work, overload="skip")
    # Pipelined workers raise the rate; the latency of each result stays.
    turns = Stage("pipeline", work, overload="pipelined")
    rate = result.measure("rate", 1 / alone.interval(1 / camera))
    speed = result.input("speed", 200) / 1000
    stages = [age([Stage("camera", 1e-6, 1 / camera), one]).least for one in (alone, turns)]
    late = result.measure("late_mm", 1000 * speed * stages[1], 1e-3)
    noise, ahead = result.input("noise_mm", 0.2) / 1000, []
    allowed = result.input("allowed", 0.5)
    for _ in range(200):
        tracker = Tracker((allowed, 2.0))
        for k in range(30):
            z = np.array([speed * k / camera, 0, 0]) + noise * result.rng.standard_normal(3)
            tracker.update(k / camera, z, noise**2 * np.eye(3))
        end = 29 / camera + work
        ahead.append(tracker.predict(end)[0][:2] - (speed * end, 0.0))
    # Root mean square over the runs of the distance along and across the belt.
    remaining = 1000 * np.sqrt(np.mean(np.sum(np.square(ahead), axis=1)))
    result.measure("left_mm", remaining, 0.1)
    result.statement = "Chapter 0's chain of a camera and one stage; a filter on 30 pictures."
    result.statement_holds(rate >= camera)
    result.correction_holds(
        rate < camera,
        abs(1 / turns.interval(1 / camera) - camera) < 1e-6,
        min(stages) > 0.99 * work,
        remaining < 0.2 * late,
    )


@claim(
    "A pose error of 2 mm is good enough to grasp.",
    "For a part longer than the fingers are wide, an error e and a turn t use up {formula} of the "
    "gap on one side. With a gap of {play} mm on each side, an error of {error_mm} mm and "
    "{turn_deg} degrees leave enough for fingers that are {narrow:.0f} mm wide, but not for "
    "{wide:.0f} mm.",
    ask=(
        "Two parallel fingers are about to close on a part of width W. Each finger is b wide, and "
        "the part is longer than b. But the part is turned by the angle t, and its middle line "
        "passes the gripper's middle at the distance e, measured along the fingers' motion. To "
        "clear the part, each finger must start farther from the gripper's middle than W/2. How "
        "much farther?",
        "e + b/2*tan(t) + W/2*(1/cos(t) - 1)",
        {
            "e": "A turned part is wider between the fingers.",
            "e + b*tan(t)": "A finger reaches b/2 to either side of its middle.",
            "e + W/2*sin(t)": "It is the fingers' width that meets the slope, not the part's.",
        },
    ),
)
def two_millimetres_will_do(result):
    import sympy

    from course.contact import box, distance

    W, b, e, t, y = sympy.symbols("W b e t y", positive=True)
    # The turned part's face meets the corner of the finger.
    side = sympy.solve(-sympy.sin(t) * b / 2 + sympy.cos(t) * (y - e) - W / 2, y)[0]
    result.formula = sympy.simplify(side - W / 2)
    width, error = 0.05, result.input("error_mm", 2) / 1000
    play, turn = result.input("play", 2.5) / 1000, np.radians(result.input("turn_deg", 2))

    def gap(finger, shift=error, angle=turn, width=width, play=play):
        """Return the least distance of a finger from the turned part, of one on each side."""
        part, tool = box((0.1, 0.5 * width)), box((0.5 * finger, 0.01))
        far = 0.5 * width + play + 0.01
        return min(
            float(
                np.min(
                    distance(
                        part, np.array([0.0, shift, angle]), tool, np.array([0.0, s * far, 0.0])
                    ).distance
                )
            )
            for s in (-1, 1)
        )

    law = sympy.lambdify((W, b, e, t), result.formula)
    largest = (play - error - width * (1 / np.cos(turn) - 1) / 2) * 2 / np.tan(turn)
    narrow, wide = result.measure("narrow", 700 * largest), result.measure("wide", 1300 * largest)
    draws = result.rng.uniform(0, 1, (2, 8))

    def drawn(share):
        """Return whether random fingers, parts, errors and turns leave a share of the law free."""
        finger, some = result.rng.uniform((0.001, 0.005), (0.04, 0.1))
        shift, angle = result.rng.uniform((-0.006, -0.35), (0.006, 0.35))
        used = law(some, finger, abs(shift), abs(angle))
        return gap(finger, shift, angle, some, share * used) > 0

    def above_table(planned, down, wider):
        """Return the least distance of a finger from part and table, planned above the table [m].

        Seen from the side: a finger beside a flat part that lies on the table.
        """
        finger, part, table = box((0.005, 0.01)), box((0.5 * width, 1e-3)), box((0.2, 0.05))
        side = np.array([0.5 * width + wider * play + 0.005, planned - down + 0.01, 0.0])
        others = ((part, np.array([0.0, 1e-3, 0.0])), (table, np.array([0.0, -0.05, 0.0])))
        return min(float(np.min(distance(one, at, finger, side).distance)) for one, at in others)

    result.statement = "Chapter 2's distances between a turned part and two fingers."
    result.statement_holds(
        gap(wide / 1000) > 0,
        only_if="the error lies along the fingers' motion and the gap on each side is wider than "
        "the error and what the turn costs: more for wide fingers, and in a large turn too much "
        "even for narrow ones",
        inside=[gap(0.98 * x * largest) > 0 for x in draws[0]]
        # Chosen to break it: turns and errors of both signs, other parts, gaps just wide enough.
        + [drawn(1.02) for _ in range(16)],
        outside=[gap((1.02 + x) * largest) > 0 for x in draws[1]]
        + [gap(0.1 * largest, (1.05 + x) * play) > 0 for x in draws[1][:4]]
        # Needles as fingers, and a part that is turned by 15 degrees.
        + [drawn(0.98), gap(1e-4, error, 0.26) > 0]
        # Chosen to break it: an error in height, with a wide gap and the table 1 mm below.
        + [above_table(1e-3, error, 1.0 + x) > 0 for x in draws[1][:4]],
    )
    result.correction_holds(
        gap(narrow / 1000) > 0 > gap(wide / 1000),
        abs(law(width, largest, error, turn) - play) < 1e-9,
    )
