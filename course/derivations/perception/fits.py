"""Claims of chapter 7: fits that end elsewhere, and what does not tell it."""

import numpy as np

from course.derivations import claim
from course.derivations.perception import image_of


@claim(
    "The best rotation that takes points a to their partners b, both with mean zero, is V U^T, "
    "where U S V^T is the SVD of the sum of all a b^T.",
    "This matrix may be a mirror image. It is one in {flat:.0%} of the fits to points whose "
    "thickness is {thin} of the noise. With the determinant as a factor of the last singular "
    "vector, the result is always the best rotation.",
    source="W. Kabsch, 1978; S. Umeyama, 1991",
)
def kabsch_without_determinant(result):
    from scipy.spatial.transform import Rotation

    from course.perception import rigid_fit
    from course.rigid_body.quaternion import exp, to_matrix

    def fits(thick, runs=25, count=12):
        """Return the share of reflections without the determinant, and whether all fits are best.

        The second result is with the determinant.
        """
        mirrored, best = 0, True
        for _ in range(runs):
            a = result.rng.uniform(-1.7, 1.7, (3, count)) * [[1], [1], [0.1 * thick]]
            b = to_matrix(exp(result.rng.normal(size=3))) @ a + 0.1 * result.rng.normal(
                size=a.shape
            )
            c, d = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=1, keepdims=True)
            U, _, V = np.linalg.svd(d @ c.T)
            mirrored += int(np.linalg.det(U @ V) < 0)
            R, least = rigid_fit(a, b)[0], Rotation.align_vectors(d.T, c.T)[1]
            best = best and np.linalg.det(R) > 0.999 and np.linalg.norm(R @ c - d) < least + 1e-7
        return mirrored / runs, best

    def mirrored(thick, count, axes, runs=20_000):
        """Return the share of mirror images where points are so thin along these axes."""
        size = np.where(np.isin(np.arange(3), axes), 0.1 * thick, 1.0)[:, None]
        a = result.rng.uniform(-1.7, 1.7, (runs, 3, count)) * size
        b = a + 0.1 * result.rng.normal(size=a.shape)
        c, d = (x - x.mean(axis=2, keepdims=True) for x in (a, b))
        # U V^T is a mirror image if the covariance has a negative determinant.
        return np.mean(np.linalg.det(d @ c.transpose(0, 2, 1)) < 0)

    def odd(spread, error, count=12, runs=4000):
        """Return the share of mirror images for a plate with other points or other noise."""
        a = result.rng.uniform(-1.7, 1.7, (runs, 3, count))
        a[:, 2] = 0.1 * least * spread((runs, count))
        b = a + 0.1 * error(a.shape)
        c, d = (x - x.mean(axis=2, keepdims=True) for x in (a, b))
        return np.mean(np.linalg.det(d @ c.transpose(0, 2, 1)) < 0)

    def ends(size):
        return result.rng.choice([-1.0, 1.0], size)

    def single(size):
        """Return heights of which only one differs, with a standard deviation of 1."""
        return np.where(np.arange(size[1]) == 0, size[1] / np.sqrt(size[1] - 1), 0.0) * np.ones(
            size
        )

    def tails(size):
        return result.rng.standard_t(4, size) / np.sqrt(2.0)

    flat = result.measure("flat", fits(result.input("thin", 0.1), 400)[0], 0.15)
    least = result.input("least", 2)
    draws = result.rng.uniform(0, 1, (2, 10))
    result.statement = "Fits of 12 noisy points, and of 4, flat and thick, beside SciPy's."
    result.statement_holds(
        flat == 0,
        only_if="the noise is too small to mirror the points. For a dozen points or more, it is "
        "enough that they spread by {least:.0f} times the noise (standard deviations) even in "
        "their thinnest direction: then less than one fit in a thousand is mirrored",
        inside=[mirrored(least * (1 + x), int(12 + 20 * x), 2, 2000) < 1e-3 for x in draws[0]]
        # At the edge of the condition: a flat plate, a rod and a ball.
        + [mirrored(least, 12, axes) < 1e-3 for axes in ([2], [1, 2], [0, 1, 2])]
        # Chosen to break it: heights of two values, or of one point only, and heavy tails.
        + [odd(spread, result.rng.standard_normal) < 1e-3 for spread in (ends, single)]
        + [odd(ends, tails) < 1e-3],
        outside=[
            *(fits(0.1 * least * x)[0] == 0 for x in draws[1]),
            *(fits(least * (1 + x), 25, 4)[0] == 0 for x in draws[1]),
        ],
    )
    result.correction_holds(0.2 < flat < 0.7, all(fits(x)[1] for x in (0.0, 0.3, 3.0)))


@claim(
    "ICP of a model against its own points converges to the right pose from any start nearby.",
    "Point-to-point converges from {near} degrees, with a residual of zero. From {start} to {most} "
    "degrees it always stops at {stall:.2f} degrees, where the grid of points matches itself "
    "again. Point-to-plane converges from all of them. A test that takes its measured points from "
    "the model's own points, and starts nearby, proves nothing.",
)
def own_points_come_home(result):
    from course.charts.perception.poses import BOX, STILL, turned_by
    from course.perception import Cloud, icp

    half, grid, faces = BOX.sizes[:, 0], result.input("grid_mm", 4) / 1000, []
    for k in range(3):
        line = [np.arange(-h, h + 1e-9, grid) for h in half]
        for sign in (-1.0, 1.0):
            line[k] = np.array([sign * half[k]])
            face = np.array(np.meshgrid(*line)).reshape(3, -1)
            faces.append((face, sign * np.eye(3)[:, [k] * face.shape[1]]))
    points, normals = (np.hstack(both) for both in zip(*faces, strict=True))
    model = Cloud.of(points, normals)

    def remaining(degrees, method="point"):
        start = turned_by(STILL, 0, 0, 0, 0, 0, np.radians(degrees))
        fit = icp(points, model, start, method=method, iterations=200)
        return abs(np.degrees(np.arctan2(fit.R[1, 0], fit.R[0, 0])))

    start, near, far = (result.input(*x) for x in (("start", 4), ("near", 1), ("most", 10)))
    stall = result.measure("stall", remaining(start), 0.01)
    ends = [remaining(x) for x in result.rng.uniform(start, far, 6)]
    result.statement = "A box of 4 mm points registered to itself, turned by up to ten degrees."
    result.statement_holds(stall < 0.1)
    result.correction_holds(
        np.allclose(ends, stall, atol=0.01),
        remaining(near) < 1e-6,
        max(remaining(x, "plane") for x in (near, start, 9)) < 1e-3,
    )


@claim(
    "A part can be tracked by registering each image to the previous one.",
    "The error of each step stays in the result. After {pictures:.0f} images, point-to-point from "
    "image to image is {pairs_mm:.1f} mm off. Fitting each image to the model leaves "
    "{model_mm:.2f} mm. Two things differ here: the reference and the kind of pairs.",
)
def picture_to_picture(result):
    from course.charts.perception.poses import BOX, EYE, SENSOR, turned_by
    from course.kinematics.chain import compose
    from course.perception import Cloud, back_project, icp, pose_distance, render, sense

    pictures = int(result.input("pictures", 32))
    first = image_of(BOX, 0.0, 0.5, result.rng)[1]
    pairs, model, before, deviation = first, first, None, []
    for k in range(pictures + 1):
        true = turned_by(first, 0.001 * k, 0, 0, 0, 0, 0.008 * k)
        depth = sense(render(BOX.moved(true), EYE)[0], EYE, SENSOR, result.rng)
        cloud = np.ascontiguousarray(back_project(depth, EYE)[0][:, ::4])
        model = icp(cloud, BOX, model, gate=0.01, sigma=SENSOR.sigma(cloud[2], EYE)).pose
        if before is not None:
            step = icp(cloud, Cloud.of(before), method="point", gate=0.01).pose
            pairs = compose(step[:, None], pairs[:, None])[:, 0]
        before = cloud
        deviation.append([1000 * pose_distance(BOX, true, pose)[0] for pose in (pairs, model)])
    last = result.measure("pairs_mm", deviation[-1][0], 0.1)
    worst = result.measure("model_mm", max(row[1] for row in deviation[1:]), 0.3)
    result.statement = "A box that moves by 1 mm and 0.5 degrees from picture to picture."
    result.statement_holds(last < 2 * deviation[1][0])
    result.correction_holds(
        last > 3 * deviation[len(deviation) // 4][0] / 2, worst < 0.5, last > 10 * worst
    )


@claim(
    "A pose is right if the camera does not see through it.",
    "Next to its twin, a part is placed up to {off_mm:.0f} mm from either of them, at a "
    "see-through share of {through:.3f}: the two form one block, and every position inside it "
    "is covered. What the pose leaves over reveals it. The pose explains {agrees:.0%} of the "
    "block, but {alone:.0%} of a part that stands alone. Below {least:.0%} it is not "
    "reported as found. The same applies to a pose with an unobserved shift, or with a border "
    "that is off its outline. A gap remains: a part {longer_mm:.0f} mm longer than the model is "
    "reported as found in {near:.0%} of the images, and one {far_mm:.0f} mm longer in "
    "{far:.0%}. Another gap is a part that you locate as standing, but that is tilted: at "
    "{tilt_deg:.0f} degrees it is reported as found in {tilted:.0%} of the images, up to "
    "{tilted_mm:.1f} mm off. If you leave the tilt free, the error is at most {free_mm:.1f} mm.",
)
def not_looked_through_is_right(result):
    from course.charts.perception.bins import picture_of
    from course.charts.perception.poses import BOX, EYE, SENSOR, turned_by
    from course.perception import locate, pose_distance, shape

    def first(cause, yaw):
        """Return the error to the nearer of part and twin, and the judgements of the pose."""
        depth, _, pose = picture_of(cause, yaw, result.rng)
        one = locate(depth, EYE, SENSOR, BOX)[0]
        beside = turned_by(pose, 0.0, 0.1 * (cause != "as it is"), 0.0, 0.0, 0.0, 0.0)
        near = 1000 * min(
            pose_distance(BOX, pose, one.pose)[0], pose_distance(BOX, beside, one.pose)[0]
        )
        return near, one.see_through, one.agrees, one.status == "found", *one.unobserved[:1]

    twins, alone = (
        [first(cause, x) for x in result.rng.uniform(0.2, 3.0, 12)]
        for cause in ("its twin beside it", "as it is")
    )
    deviation, through, agrees = zip(*(run[:3] for run in twins), strict=True)
    worst = result.measure("off_mm", max(deviation), 0.1)
    observed = result.measure("through", through[int(np.argmax(deviation))], 0.5)
    share, least = result.measure("agrees", np.median(agrees), 0.1), result.input("least", 0.9)
    own = result.measure("alone", min(run[2] for run in alone), 0.02)
    longer, half = result.input("longer_mm", 2), BOX.sizes[:, 0]

    def called_found(excess):
        """Return the share of parts, by so much longer than the model [mm], that are found."""
        part = shape("box", half[0] + 0.0005 * excess, *half[1:])
        turns = result.rng.uniform(0.2, 3.0, 12)
        looks = [image_of(part, 0.0, yaw, result.rng)[0] for yaw in turns]
        return np.mean([locate(z, EYE, SENSOR, BOX)[0].status == "found" for z in looks])

    near = result.measure("near", called_found(longer), 0.3)
    far = result.measure("far", called_found(result.input("far_mm", 10)), 0.2)
    tilt = np.radians(result.input("tilt_deg", 3))
    leaning = [image_of(BOX, 0.0, yaw, result.rng, tilt) for yaw in result.rng.uniform(0.2, 3, 12)]

    def wrongly(standing):
        """Return the share that is found, and the largest error of those that are [mm]."""
        ones = [(locate(z, EYE, SENSOR, BOX, standing=standing)[0], pose) for z, pose in leaning]
        off = [pose_distance(BOX, pose, x.pose)[0] for x, pose in ones if x.status == "found"]
        return len(off) / len(ones), 1000 * max(off)

    (tilted, raised), (free, left) = wrongly(True), wrongly(False)
    result.measure("tilted", tilted, 0.3)
    result.measure("tilted_mm", raised, 0.2)
    result.measure("free_mm", left, 0.5)
    # A box that is laid flat about its lower edge moves its middle by so much.
    laid = 1000 * 2 * np.hypot(*half[1:]) * np.sin(tilt / 2)
    result.statement = "Twelve pictures each of a box alone and beside its twin."
    result.statement_holds(worst < 2 or observed > 0.1)
    result.correction_holds(
        share < max(agrees) < least < own,
        not any(run[3] for run in twins),
        all(run[3] != (len(run) > 4) for run in alone),
        far < near,
        tilted > 0.5,
        abs(raised / laid - 1) < 0.3,
        free > 0.5,
        left < raised / 5,
    )


@claim(
    "The spread of a part's estimated poses shows how accurately its pose is known.",
    "For a symmetric part, the poses from equivalent images are up to {raw:.0f} degrees apart, "
    "because a pose and its half turn are equally right. Compared up to symmetry they differ by "
    "{up_to:.2f} degrees, which agrees with the covariance.",
)
def spread_of_symmetric_poses(result):
    from course.charts.perception.poses import BOX, EYE, SENSOR
    from course.perception import locate, pose_distance, shape, together

    alone = together([BOX, shape("sphere", 0.001)])  # of several shapes no symmetry is assumed
    turns, raw, report = [], [], []
    for yaw in result.rng.uniform(-3, 3, 10):
        depth, pose = image_of(BOX, 0.0, yaw, result.rng)
        one = locate(depth, EYE, SENSOR, BOX)[0]
        turns.append(pose_distance(BOX, pose, one.pose)[1])
        raw.append(pose_distance(alone, pose, one.pose)[1])
        report.append(one.covariance[5, 5])
    far = result.measure("raw", np.degrees(max(raw)), 0.02)
    near = result.measure("up_to", np.degrees(np.sqrt(np.mean(np.square(turns)))), 0.3)
    result.statement = "Ten pictures of a box on a table, at random turns."
    result.statement_holds(far < 10 * near)
    result.correction_holds(
        min(raw) < 0.02, far > 170, near < 4 * np.degrees(np.sqrt(np.mean(report)))
    )


@claim(
    "DBSCAN returns the same clusters in whatever order the points are given.",
    "Core points and noise do not depend on the order. But in the published algorithm, a border "
    "point within reach of two clusters joins the one that is processed first: in Open3D, "
    "another order moves it in {moved:.0%} of the trials. Here it joins its nearest core point, "
    "and so it stays.",
    source="M. Ester et al., A density-based algorithm, 1996",
)
def dbscan_has_no_order(result):
    from course.oracles import open3d
    from course.perception import dbscan

    def by_open3d(points):
        return open3d.Cloud(points).dbscan(1.0, 8)

    def moves(cluster):
        """Return whether the point between two rows changes cluster with the points' order."""
        ends = np.concatenate(([0.9, 0.93, 0.95], result.rng.uniform(1.05, 1.9, 9)))
        x = np.concatenate((-ends, ends * result.rng.uniform(0.99, 1.01), [0.0]))
        points, order = np.stack((x, 0 * x, 0 * x)), result.rng.permutation(25)
        labels, other = cluster(points), np.empty(25, np.int64)
        other[order] = cluster(np.ascontiguousarray(points[:, order]))
        return (labels[24] == labels[0]) != (other[24] == other[0]), labels[0] != labels[12]

    theirs, own = (
        np.array([moves(path) for _ in range(100)])
        for path in (by_open3d, lambda points: dbscan(points, 1.0, 8)[0])
    )
    moved = result.measure("moved", np.mean(theirs[:, 0]), 0.3)
    retained = []
    for _ in range(20):  # who is noise, and which core points are together
        cloud, order = result.rng.normal(scale=2.5, size=(3, 200)), result.rng.permutation(200)
        distance = np.linalg.norm(cloud[:, :, None] - cloud[:, None], axis=0)
        core, a, b = (distance <= 1.0).sum(axis=1) >= 8, by_open3d(cloud), np.empty(200, np.int64)
        b[order] = by_open3d(np.ascontiguousarray(cloud[:, order]))
        same = [x[core][:, None] == x[core] for x in (a, b)]
        retained.append(np.array_equal(a < 0, b < 0) and np.array_equal(*same))
    result.statement = "100 times two rows of points with one between, each in two orders."
    result.statement_holds(moved == 0)
    result.correction_holds(
        moved > 0.2, not own[:, 0].any(), theirs[:, 1].all(), own[:, 1].all(), all(retained)
    )


@claim(
    "A network that was trained to turn one part rejects the part's mirror image.",
    "It returns a turn for the mirror image as it does for its own part. After ICP, the "
    "see-through test refutes {refuted:.0%} of these poses, and {own:.0%} of those of its own "
    "part.",
)
def network_knows_its_part(result):
    from course.charts.perception import learned
    from course.charts.perception.poses import EYE, SENSOR, TABLE
    from course.perception import yaw_net

    net = yaw_net.train(EYE, SENSOR, TABLE, pictures=200, steps=150)
    path = learned.methods(net, result.rng)["network"]

    def through(part):
        looks = [yaw_net.picture(EYE, SENSOR, TABLE, result.rng, part)[0] for _ in range(20)]
        answers = [learned.laid(depth, SENSOR, path) for depth in looks]
        return np.mean([share > 0.1 for _, _, share in answers]), np.isfinite(answers[0][0]).all()

    (own, _), (other, text) = through(yaw_net.L_PART), through(learned.MIRRORED)
    result.measure("own", own, 0.5)
    refuted = result.measure("refuted", other, 0.15)
    result.statement = "A network after a short training, 20 pictures each of part and image."
    result.statement_holds(not text)
    result.correction_holds(refuted > 0.7, own < 0.1)
