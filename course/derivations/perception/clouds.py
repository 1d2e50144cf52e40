"""Claims of chapter 7: points, planes and clusters."""

import math

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "P": Symbol("probability", 0.1, 0.9),
    "w": Symbol("share of inliers", 0.1, 0.9),
    "r": Symbol("radius eps [m]"),
    "v": Symbol("edge of a voxel [m]"),
}


@claim(
    "A flat part that faces the camera has about a sixteenth of the pixels if it is half as wide "
    "and high, and twice as far away.",
    "A square of side a that faces the camera has (f a / z)^2 pixels, give or take a row and a "
    "column. With a focal length of {focal:.0f} pixels, one of {side_mm:.0f} mm at {far:.0f} m has "
    "{pixels:.0f} pixels, and {near:.0f} at half of that distance. If it is tilted in the "
    "middle of the image, multiply by the cosine of the tilt. Elsewhere it shows more or less of "
    "itself.",
)
def small_parts_have_few_pixels(result):
    from course.perception import Camera, render, shape

    eye = Camera.symmetric(int(result.input("wide", 640)), 480, 1.0)
    result.measure("focal", eye.fx)

    def counted(side, z, tilt=0.0, y=0.0):
        turn = np.cos(tilt / 2), np.sin(tilt / 2), 0, 0
        tile = shape("box", 0.5 * side, 0.5 * side, 1e-4, pose=(0, y, z + 1e-4, *turn))
        return np.count_nonzero(render(tile, eye)[0])

    side, far = result.input("side_mm", 10) / 1000, result.input("far", 1.0)
    few = result.measure("pixels", counted(side, far))
    result.measure("near", counted(side, far / 2))
    tilts = [(counted(0.05, 1.0, x), np.cos(x)) for x in result.rng.uniform(0.2, 1.2, 8)]
    # Above and below the middle of the image the ray meets the tile at another angle.
    views = result.rng.uniform([0.2, -0.2], [0.9, 0.2], (8, 2))
    shares = [counted(0.05, 1.0, t, y) / counted(0.05, 1.0) for t, y in views]
    exact = [np.cos(t) - np.sin(t) * y for t, y in views]
    # Near and far, small and large; one row and column may be cut at the edge.
    draws = result.rng.uniform([0.005, 0.2], [0.05, 2.0], (40, 2))
    result.statement = "Pixels of square tiles in exact pictures, and 40 random ones."
    pairs = [(a, z) for a, z in result.rng.uniform([0.1, 0.25], [0.2, 0.5], (12, 2))]
    result.statement_holds(
        all(abs(16.0 * counted(a / 2, 2 * z) / counted(a, z) - 1.0) < 0.15 for a, z in pairs)
    )
    result.correction_holds(
        few < 1e-3 * eye.width * eye.height,
        all(abs(np.sqrt(counted(a, z)) - eye.fx * a / z) <= 1 for a, z in draws),
        all(abs(n / counted(0.05, 1.0) / c - 1) < 0.12 for n, c in tilts),
        np.allclose(shares, exact, rtol=0.12),
        counted(0.05, 1.0, 0.9, 0.2) < 0.85 * counted(0.05, 1.0, 0.9),
    )


@claim(
    "A voxel grid of 10 mm removes parts smaller than 10 mm.",
    "Every part that has a pixel keeps at least one mean: none of {parts:.0f} parts smaller "
    "than that is lost. But in the median only {left:.1f} means remain of a part, and DBSCAN "
    "treats so few as noise. Also, a mean averages everything in its cell. Of cubes of "
    "{low:.0f} mm on a table, the highest mean is at {high:.0%} of their height in one case of "
    "ten, and a tolerance then counts it as table.",
)
def voxels_remove_small_parts(result):
    from course.perception import dbscan, voxel_mean

    sides = result.rng.uniform(0.002, 0.01, int(result.input("parts", 200)))
    parts = [
        result.rng.uniform(-x, x, (3, 60)) / 2 + result.rng.uniform(0, 1, (3, 1)) for x in sides
    ]
    means = [voxel_mean(part, 0.01, [-1.0] * 3)[0] for part in parts]
    counts = np.array([x.shape[1] for x in means])

    def stands(side):
        """Return the largest mean height of a cube on a table, seen from above, over its height."""
        x, y = result.rng.uniform(-0.04, 0.04, (2, 6000))
        top = np.where(np.maximum(np.abs(x), np.abs(y)) < side / 2, 1.0, 0.0)
        # A random offset of the grid against the part.
        origin = -1 - result.rng.uniform(0, 0.01, 3)
        return voxel_mean([x, y, side * top], 0.01, origin)[0][2].max() / side

    low = result.input("low", 4) / 1000
    high = result.measure("high", np.quantile([stands(low) for _ in range(60)], 0.1), 0.4)
    whole = min(stands(0.02) for _ in range(8))  # a cube as large as two voxels has one of its own
    result.measure("left", np.median(counts))
    result.statement = "Clouds of small cubes at random places on a grid of 10 mm."
    result.statement_holds(counts.min() == 0)
    result.correction_holds(
        all(dbscan(x, 0.02, 10)[0].max() < 0 for x in means),
        all(dbscan(x, 0.02, 10)[0].min() == 0 for x in parts),
        counts.min() > 0,
        high < 0.5 < 0.99 < whole,
    )


@claim(
    "Requiring 50 neighbours is a good setting of DBSCAN for voxels of 5 mm and an eps of 20 mm.",
    "A face along the grid has about {formula} voxels within eps, and {flat:.0f} in its "
    "interior. So {least:.0f} is a borderline value. Of a face of {large_mm:.0f} mm, {kept:.0%} of "
    "the voxels end up in clusters, because the means of a few points scatter and some get more "
    "neighbours. With more points per voxel they scatter less, and it is {dense:.0%}. Of a tilted "
    "face, which has {tilted:.0f} neighbours, all do, and of a part of {small_mm:.0f} mm none. A "
    "third of the formula finds the large face and the small part completely.",
    ask=(
        "A flat face lies along a grid of voxels with edge v. How many are within r of one?",
        "pi*(r/v)^2",
        {
            "4/3*pi*(r/v)^3": "A surface is flat: it doesn't fill the ball.",
            "(2*r/v)^2": "That is the square around the disc.",
            "pi*r/v": "The area over that of a voxel.",
        },
    ),
)
def fifty_neighbours(result):
    import sympy

    from course.perception import dbscan, radius_search, voxel_mean

    r, v, x = sympy.symbols("r v x", positive=True)
    result.formula = sympy.integrate(2 * sympy.pi * x / v**2, (x, 0, r))

    def face(side, tilt=0.0, count=60_000):
        x, y = result.rng.uniform(0, side, (2, count))
        z = y * np.sin(tilt) + 0.0017
        return voxel_mean([x, y * np.cos(tilt), z], 0.005, [-1e-9] * 3)[0]

    required = int(result.input("least", 50))

    def retained(cloud, least=required):
        return np.mean(dbscan(cloud, 0.02, least)[0] >= 0)

    side, part = result.input("large_mm", 200) / 1000, result.input("small_mm", 30) / 1000
    large, tilted = face(side), face(side, 0.6)
    # The median ignores the voxels at the edge of the face.
    counts = [np.median(np.diff(radius_search(x, x, 0.02)[0])) for x in (large, tilted)]
    flat = result.measure("flat", counts[0])
    result.measure("tilted", counts[1], 0.05)
    share = result.measure("kept", retained(large), 0.3)
    dense = result.measure("dense", retained(face(side, count=240_000)), 0.3)
    law = float(result.formula.subs({r: 0.02, v: 0.005}))
    result.statement = "Voxels of square faces with 60,000 points each, and one with 240,000."
    result.statement_holds(share == 1)
    third = [retained(x, int(law / 3)) == 1 for x in (large, face(part))]
    result.correction_holds(
        abs(flat / law - 1) < 0.1,
        dense < 0.5 * share,
        retained(tilted) == 1,
        all(third),
        retained(face(part)) == 0,
    )


@claim(
    "DBSCAN separates the objects.",
    "It separates objects that are farther apart than eps. Two boxes with a gap of {gap_mm:.0f} "
    "mm become {joined:.0f} cluster at an eps of {eps_mm:.0f} mm. Objects that touch are one "
    "cluster at any eps at which they are clusters at all.",
)
def dbscan_separates(result):
    from course.perception import dbscan, voxel_mean

    eps = result.input("eps_mm", 20) / 1000

    def clusters(gap, turn=0.0, voxel=0.004):
        x = result.rng.uniform(-0.03, 0.03, (3, 8000)) * [[1], [1], [0]]
        x[0] += np.where(np.arange(8000) < 4000, 1, -1) * (0.03 + 0.5 * gap)
        c, s = np.cos(turn), np.sin(turn)
        means, _ = voxel_mean(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ x, voxel)
        return dbscan(means, eps, 10)[0].max() + 1

    def rods(gap, voxel):
        """Return the clusters of two thin rods in line, a gap apart."""
        x = result.rng.uniform(-0.03, 0.03, (3, 4000)) * [[1], [0.01], [0.01]]
        x[0] += np.where(np.arange(4000) < 2000, 1, -1) * (0.03 + 0.5 * gap)
        return dbscan(voxel_mean(x + 0.5 * voxel, voxel)[0], eps, 10)[0].max() + 1

    def faces(count, half, hidden=0.0):
        """Return the clusters of two square faces of `count` points, far apart.

        Something in front may hide a strip of the first one, this wide [m].
        """
        x = result.rng.uniform(-half, half, (3, count)) * [[1], [1], [0]]
        x[0] += np.where(np.arange(count) < count // 2, 1, -1) * (half + eps)
        x = x[:, np.abs(x[0] - half - eps) > 0.5 * hidden]
        return dbscan(voxel_mean(x, eps / 3)[0], eps, 10)[0].max() + 1

    def corner(width, gap, turn, voxel):
        """Return the clusters of three small faces around a corner."""
        x = result.rng.uniform(-0.5 * width, 0.5 * width, (3, 9000)) * [[1], [1], [0]]
        group = np.arange(9000) % 3
        x[0] += np.where(group == 1, width + gap, 0.0)
        x[1] += np.where(group == 2, width + gap, 0.0)
        c, s = np.cos(turn), np.sin(turn)
        means, _ = voxel_mean(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ x, voxel)
        return dbscan(means, eps, 10)[0].max() + 1

    joined = result.measure("joined", clusters(result.input("gap_mm", 12) / 1000))
    draws = result.rng.uniform((0, 0), (1, np.pi), (12, 2))
    result.statement = "Two faces of 60 mm at random turns, on voxels of 4 mm."
    result.statement_holds(
        joined == 2,
        only_if="the gaps are wider than eps, eps is three voxels or more, and each part is wider "
        "than eps, dense with points and in one piece: a thin rod or a small part has too few "
        "neighbours, and something in front cuts a part in two",
        # Gaps from just above eps, at random turns and voxel sizes.
        inside=[clusters(eps * (1.001 + x), t, eps / (3 + x)) == 2 for x, t in draws]
        # Chosen to break it: three parts around a corner, barely wider than eps, barely apart.
        + [corner(1.02 * eps, 1.01 * eps, t, eps / (3 + 2 * x)) == 3 for x, t in draws],
        outside=[
            *(clusters(eps * 0.75 * x, t) == 2 for x, t in draws),
            *(clusters(2 * eps, t, eps * (0.7 + x)) == 2 for x, t in draws),
            *(rods(2 * eps, eps / (3 + x)) == 2 for x, _ in draws),
            *(faces(*some) == 2 for some in ((8000, 0.4 * eps), (60, 1.5 * eps))),
            faces(8000, 2 * eps, 1.3 * eps) == 2,
        ],
    )
    result.correction_holds(joined == 1, clusters(0.0) == 1)


@claim(
    "Without a refit, log(1 - P) / log(1 - w^3) samples find the plane of noisy points with "
    "probability P.",
    "If there are many points, at least one of these samples has three inliers with probability P: "
    "for a P of {asked} it happened in {drawn:.3f} of the runs, but with {few:.0f} points in "
    "{rare:.2f}. Without noise, such a sample is the plane. A plane through three noisy inliers is "
    "not the plane yet. At a tolerance of {sigmas} sigma, {found_it:.2f} of the runs find it, and "
    "{refitted:.2f} after a refit to all nearby points.",
    ask=(
        "A share w of the points lies on the plane. How many draws of three hold one of inliers "
        "only, with probability P?",
        "log(1 - P)/log(1 - w^3)",
        {
            "log(P)/log(1 - w^3)": "All draws fail with 1 - P.",
            "log(1 - P)/log(1 - (1 - w)^3)": "w is the share of inliers, not of outliers.",
            "log(1 - P)/log(w^3)": "One draw fails with 1 - w^3.",
        },
    ),
    source="M. A. Fischler, R. C. Bolles, Random sample consensus, 1981",
)
def draws_find_the_plane(result):
    import sympy

    from course.charts.perception.clouds import share_found
    from course.perception import draws_needed

    P, w, n = sympy.symbols("P w n", positive=True)
    result.formula = sympy.solve(sympy.log(1 - P) - n * sympy.log(1 - w**3), n)[0]
    largest = math.ceil(draws_needed(0.5, result.input("asked", 0.9)))
    # Without noise three inliers suffice: the law itself is tested.
    drawn = result.measure("drawn", share_found(None, 0, 20_000, 200, largest), 0.01)
    tolerance = result.input("sigmas", 2.5)
    plain, again = (share_found(tolerance, k, 600, 200, largest) for k in (0, 1))
    result.measure("found_it", plain, 0.1)
    result.measure("refitted", again, 0.06)
    # Of few points the second and third inlier are rarer: nothing is drawn twice.
    few = int(result.input("few", 10))
    hits = result.rng.hypergeometric(few // 2, few - few // 2, 3, (4000, largest))
    rare = result.measure("rare", np.mean((hits == 3).any(axis=1)), 0.05)
    result.statement = (
        f"600 to 20,000 runs of {largest} draws from 200 points, half of them a plane's; a run "
        "finds it with nine tenths of the true plane's inliers."
    )
    result.statement_holds(plain > 0.85)
    result.correction_holds(
        abs(drawn - 0.9) < 0.03,
        1.0 - (1.0 - 0.5**3) ** largest >= 0.9,
        again > plain + 0.2,
        rare < drawn - 0.05,
        largest == math.ceil(float(result.formula.subs({P: 0.9, w: 0.5}))),
    )


@claim(
    "For a tilted table and a stereo camera, a linear fit of inverse depth is more accurate "
    "than a fit to the points.",
    "A camera of {wide:.0f} by {high:.0f} pixels with a baseline of {base_mm:.0f} mm and {noise} "
    "px of noise measures the table's angle {ratio:.1f} times more accurately this way, because "
    "the noise of a stereo sensor is uniform in 1 / z. It also avoids an offset of "
    "{offset_mm:.2f} mm that the fit to the points has. If the table faces the camera, both are "
    "equally accurate. With noise that is uniform in z the order is reversed: the ratio is "
    "{other:.2f}.",
)
def inverse_depth_is_better(result):
    from course import perception as see
    from course.rigid_body.quaternion import exp, rotate

    size = int(result.input("wide", 160)), int(result.input("high", 120))
    eye, base = see.Camera.symmetric(*size, 1.0), result.input("base_mm", 50) / 1000
    sensor = see.Sensor(base, result.input("noise", 0.3))

    def times(sensor, tilts, even=0.0):
        """Return the angle error over that of the linear fit, and both mean offsets [m]."""
        deviation = []
        for tilt in tilts:
            turn = exp(np.array([np.pi - tilt, 0.0, 0.0]))
            exact, _ = see.render(see.shape("plane", pose=(0, 0, 0.8, *turn)), eye)
            z = see.sense(exact, eye, sensor, result.rng)
            if even:
                z = exact + even * result.rng.standard_normal(exact.shape)
            planes = see.inverse_depth_plane(z, eye), see.fit_plane(see.back_project(z, eye)[0])
            normal = rotate(turn, np.array([0.0, 0, 1]))
            deviation.append(
                [(np.linalg.norm(np.cross(p[:3], normal)), 0.8 * p[2] + p[3]) for p in planes]
            )
        own, points = np.sqrt(np.mean(np.square(deviation), axis=0))[:, 0]
        return points / own, np.mean(deviation, axis=0)[:, 1]

    ratio, mean = times(sensor, result.rng.uniform(0.4, 0.9, 40))
    result.measure("ratio", ratio, 0.25)
    other = result.measure("other", times(sensor, result.rng.uniform(0.4, 0.9, 40), 1e-3)[0], 0.2)
    offset = result.measure("offset_mm", 1000 * abs(mean[1]), 0.3)
    draws = result.rng.uniform((0.4, 0.1), (0.9, 0.3), (8, 2))
    # The control: for a table that faces the camera both fits are equally good.
    facing = times(sensor, [0.0] * 30)[0]
    result.statement = (
        "Tables with tilts of 0.4 to 0.9 rad, 0.8 m away, ten pictures or more of each."
    )
    result.statement_holds(min(times(see.Sensor(0.05, s), [t] * 10)[0] for t, s in draws) > 1)
    result.correction_holds(
        ratio > 1.5, 1000 * abs(mean[0]) < 0.3 * offset, other < 1, abs(facing - 1) < 0.1
    )
