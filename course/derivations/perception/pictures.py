"""Claims of chapter 7: depth pictures, their noise, and calibration."""

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.perception import image_of, walls

SYMBOLS = {
    "z": Symbol("distance [m]"),
    "f": Symbol("focal length [pixels]"),
    "B": Symbol("baseline [m]"),
    "s": Symbol("standard deviation of a disparity [pixels]"),
    "sigma": Symbol("standard deviation of a coordinate [m]"),
    "N": Symbol("points", 4.0, 100.0),
}


@claim(
    'One entry on a data sheet, such as "1 to 3 mm", describes a depth camera\'s noise at all '
    "distances.",
    "The noise is {formula}, which depends on the distance: a sensor with a focal length of "
    "{focal:.0f} pixels, a baseline of {base_mm:.0f} mm and a tenth of a pixel of noise has "
    "{low:.2f} mm at {near} m, {middle:.1f} mm at {mid} m and {high:.0f} mm at {far} m. Each "
    "quoted number is right at some distance only.",
    ask=(
        "Depth is f B / d, and d has the standard deviation s. Standard deviation of depth z?",
        "sigma = z^2*s/(f*B)",
        {
            "z*s/(f*B)": "One z is missing: the derivative of f B / d is -z^2 / (f B).",
            "s/(f*B)": "That is the noise of the inverse depth.",
            "f*B/s": "That is the distance of a disparity s.",
        },
    ),
)
def noise_is_one_number(result):
    import sympy

    z, f, B, s, d = sympy.symbols("z f B s d", positive=True)
    result.formula = (-s * sympy.diff(f * B / d, d)).subs(d, f * B / z)
    places = [result.input("near", 0.3), result.input("mid", 0.7), result.input("far", 3.0)]
    focal, base = int(result.input("focal", 600)), result.input("base_mm", 50) / 1000
    spread = [np.std(walls(x, result.rng)) for x in places]
    for k, name in enumerate(("low", "middle", "high")):
        result.measure(name, 1000 * spread[k], 0.03)
    law = [float(result.formula.subs({z: x, f: focal, B: base, s: 0.1})) for x in places]
    result.statement = "The spread over 19,600 pixels of a wall at three distances."
    result.statement_holds(max(spread) < 1e-3 or all(1e-3 <= x <= 3e-3 for x in spread))
    result.correction_holds(np.allclose(spread, law, rtol=0.02))


@claim(
    "Averaging enough images removes any error of depth.",
    "It does not remove the rounding of the disparity if the noise is small compared with a "
    "step. For a disparity {between} of the way between two steps, {silent:.2f} of a step "
    "remains forever without noise, and {third:.3f} of a step with noise of a third of a "
    "step. Some noise makes an average more accurate.",
    source="B. Widrow, I. Kollar, Quantization Noise, 2008, ch. 4",
)
def averaging_removes_all(result):
    def remaining(share, between=0.25, step=0.25):
        """Return the error of the mean disparity of six pictures, over a step."""
        z = 30.0 / ((40 + between) * step)
        observed = 30.0 / walls(z, result.rng, 6, noise=share * step, step=step)
        return abs(np.mean(observed) / step - 40 - between)

    def of_depths(share, between, step=0.25):
        """Return the error where the depths of the pictures are averaged, over a step."""
        z = 30.0 / ((40 + between) * step)
        mean = np.mean(walls(z, result.rng, 6, noise=share * step, step=step))
        return abs(30.0 / mean / step - 40 - between)

    def frozen(share, between, step=0.25):
        """Return the error of a pixel whose noise is the same in each picture, over a step."""
        z = 30.0 / ((40 + between) * step)
        once = 30.0 / walls(z, result.rng, 1, noise=share * step, step=step)
        return np.median(np.abs(once / step - 40 - between))

    def cut(share):
        """Return the error at a wall so far away that some pixels are beyond the sensor's range."""
        z, step = 9.9, 0.25
        depths = walls(z, result.rng, 6, noise=share * step, step=step)
        return abs(np.mean(30.0 / depths[depths > 0.0]) - 30.0 / z) / step

    def rounded_first(share, between):
        """Return the error of the mean where the noise comes after the rounding, over a step."""
        observed = np.rint(40.0 + between) + share * result.rng.normal(size=100_000)
        return abs(np.mean(observed) - 40.0 - between)

    place = result.input("between", 0.25)  # where noise leaves most; without it the middle is worst
    silent = result.measure("silent", remaining(0.0, place))
    third = result.measure("third", remaining(1 / 3, place), 0.15)
    least, draws = result.input("least", 0.45), result.rng.uniform(size=(2, 12))
    result.statement = "117,600 pixels of a wall between two steps, over noise and place."
    result.statement_holds(
        silent < 0.01,
        only_if="the disparity is averaged, no pixel falls out of the sensor's range, and the only "
        "other error is Gaussian noise of zero mean that is new in each image. This noise must be "
        "added before the rounding and exceed {least} of a step. Less than a hundredth of a step "
        "is left then",
        # Gaussian dither above the bound at random places between two steps.
        inside=[remaining(least + x, y) < 0.01 for x, y in draws.T]
        # Chosen to break it: the least noise at other steps of the disparity.
        + [remaining(least, 0.25, x) < 0.01 for x in (0.125, 0.5, 1.0)],
        outside=[remaining(0.7 * least * x, y) < 0.01 for x, y in draws.T]
        + [of_depths(2 + x, y) < 0.01 for x, y in draws.T[:4]]
        + [frozen(least + x, y) < 0.01 for x, y in draws.T[:4]]
        + [cut(least + x) < 0.01 for x in draws[0, :2]]
        # Chosen to break it: the same noise, added after the rounding.
        + [rounded_first(least + x, 0.1 + 0.3 * y) < 0.01 for x, y in draws.T[:4]],
    )

    def dithered(between):
        """Return what noise that is even over one step leaves: nothing, with less spread."""
        noise = result.rng.uniform(-0.5, 0.5, 200_000)
        return abs(np.mean(np.rint(40.0 + between + noise)) - 40.0 - between)

    result.correction_holds(
        silent > 0.2,
        abs(third - np.exp(-2 * np.pi**2 / 9) / np.pi) < 0.005,
        max(dithered(x) for x in draws[1]) < 0.01,
    )


@claim(
    "The mean of N pixels is less noisy than a single one by a factor of the square root of N.",
    "Neighbouring pixels of a stereo camera share their noise. Over {side:.0f} by {side:.0f} "
    "pixels and with a matching window of {window:.0f} pixels, the mean is {ratio:.1f} times as "
    "noisy as this rule says. A covariance that neglects this is too small by a factor of "
    "nearly window^2.",
)
def pixels_are_independent(result):
    def ratio(n, window, count=150, step=0.0, z=1.0):
        depth = walls(z, result.rng, count, n, window=window, step=step)
        # Averaged as disparity, in which the noise is added.
        means = (30.0 / depth).mean(axis=(1, 2))
        return np.std(means) / 0.1 * n

    side, window = int(result.input("side", 48)), int(result.input("window", 5))
    amount = result.measure("ratio", ratio(side, window, 600), 0.1)
    sides = result.rng.integers(8, 49, 10)
    result.statement = "The spread of the mean over 150 to 600 pictures of a wall."
    result.statement_holds(
        abs(amount - 1.0) < 0.3,
        only_if="the noise is white (the window is one pixel), and the steps of the disparity are "
        "at most twice as large as the noise",
        inside=[abs(ratio(n, 1) - 1.0) < 0.3 for n in sides]
        # Chosen to break it: steps of twice the noise, the edge of the condition, at distances on
        # and off a step.
        + [abs(ratio(n, 1, step=0.05) - 1.0) < 0.3 for n in sides[:4]]
        + [
            abs(ratio(n, 1, step=0.2, z=1 + 0.002 * k) - 1.0) < 0.3 for k, n in enumerate(sides[:4])
        ],
        outside=[abs(ratio(n, w) - 1.0) < 0.3 for n in sides for w in (2, 7)]
        + [abs(ratio(n, 1, step=x) - 1.0) < 0.3 for n in sides[:4] for x in (0.35, 1.0)],
    )
    result.correction_holds(0.9 * window < amount < 1.1 * window)


@claim(
    "Half a pixel in the principal point does not matter.",
    "It moves a point at the depth z by {formula}. A box whose visible faces are {far:.2f} m away "
    "moves by {shift_mm:.2f} mm, and no test of the pipeline notices it. The residual is "
    "{same:.3f} times the right one's, and the covariance claims an accuracy of {told_mm:.3f} mm. "
    "With pixel centres at integers, the middle of W columns is (W - 1)/2.",
    ask=(
        "A program uses a principal point that is half a pixel off. By how much does a point at "
        "the depth z move sideways?",
        "e = z/(2*f)",
        {
            "1/(2*f)": "That is the angle: times the distance.",
            "z/f": "That is a whole pixel.",
            "f/(2*z)": "The wrong way up: a longer lens has smaller pixels.",
        },
    ),
)
def half_a_pixel(result):
    from dataclasses import replace

    import sympy

    from course.charts.perception.poses import BOX, EYE, SENSOR
    from course.perception import back_project, locate, render

    z, f, c, u = sympy.symbols("z f c u", positive=True)
    result.formula = sympy.expand(z * (u - c) / f - z * (u - c - sympy.Rational(1, 2)) / f)
    depth, _ = image_of(BOX, 0.0, 0.5, result.rng)
    right, deviation = (
        locate(depth, eye, SENSOR, BOX)[0] for eye in (EYE, replace(EYE, cx=EYE.cx + 0.5))
    )
    shift = result.measure("shift_mm", 1000 * abs(deviation.p[0] - right.p[0]), 0.03)
    same = result.measure("same", deviation.residual / right.residual, 1e-3)
    report = result.measure("told_mm", 1000 * np.sqrt(deviation.covariance[:3, :3].max()), 0.03)
    faces, _ = back_project(render(BOX.moved(right.pose), EYE)[0], EYE)
    far = result.measure("far", np.mean(faces[2]), 1e-3)
    law = 1000 * float(result.formula.subs({z: far, f: EYE.fx}))
    result.statement = "One picture of a box on a table, located with both principal points."
    result.statement_holds(shift < 3 * report)
    result.correction_holds(
        abs(same - 1) < 0.01, deviation.status == "found", abs(shift / law - 1) < 0.02
    )


@claim(
    "A calibration is as good as its residual says.",
    "Three touched points up to {wide} m apart, each coordinate known to {sigma_mm:.0f} mm, leave "
    "a residual of {three_mm:.2f} mm per point and an error of {far_mm:.1f} mm at {away} m above "
    "them. More points raise the residual, for {many:.0f} points to {many_mm:.2f} mm, and lower "
    "the error. The error is {formula} at the points' middle, and grows outside of them with the "
    "distance divided by their extent.",
    ask=(
        "A rigid motion is fitted to N touched points, each coordinate with a standard deviation "
        "sigma. What is the root mean square position error at the points' middle?",
        "e = sigma*sqrt(3/N)",
        {
            "sigma/sqrt(N)": "That is one coordinate; the error has three.",
            "3*sigma/sqrt(N)": "Three variances add: the root of 3.",
            "sigma*sqrt(1 - 2/N)": "That is the residual: it grows with N.",
        },
    ),
    source="Fitzpatrick, West, Maurer, Predicting error in point-based registration, 1998",
)
def calibration_residual(result):
    import sympy

    from course.perception import rigid_fit, target_error

    sigma, N = sympy.symbols("sigma N", positive=True)
    result.formula = sympy.sqrt(3 * sigma**2 * N / N**2)  # of a mean of N, three coordinates
    at, seen_at, report = np.array([[0, 0], [0, 0], [0, result.input("away", 0.6)]]), [], []
    wide, error = result.input("wide", 0.3), result.input("sigma_mm", 1) / 1000
    larger = int(result.input("many", 30))
    for n in (3, larger):
        points = result.rng.uniform(-0.5, 0.5, (3, n)) * [[wide], [0.7 * wide], [0.1 * wide]]
        if n == 3:  # a thin triangle, drawn by chance, has any error
            points = wide * np.array([[-0.5, 0.5, 0.0], [-0.35, -0.35, 0.35], [0.0, 0.0, 0.0]])
        points -= points.mean(axis=1, keepdims=True)
        both, squares = np.hstack((points, at)), np.zeros(n + 2)
        for _ in range(1000):
            wrong = error * result.rng.standard_normal((3, n))
            R, p = rigid_fit(points, points + wrong)
            shown = np.hstack((wrong, np.zeros((3, 2))))
            squares += np.sum((R @ both + p[:, None] - both - shown) ** 2, axis=0) / 1000
        seen_at.append(np.sqrt([np.mean(squares[:n]), *squares[n:]]))
        middle = float(result.formula.subs({sigma: error, N: n}))
        report.append([*target_error(points, at, error), middle])
    (three, near, far), (count, _, less) = 1000 * np.array(seen_at)
    result.measure("three_mm", three, 0.05)
    result.measure("far_mm", far, 0.05)
    result.measure("many_mm", count, 0.05)
    result.statement = "1,000 fits to 3 and to 30 points with 1 mm of noise in each coordinate."
    result.statement_holds(far < 2 * three)
    result.correction_holds(
        np.allclose([x[[1, 2, 1]] for x in seen_at], report, rtol=0.1),
        near < far,
        # Of three coordinates a point, the fit uses up six numbers in all.
        all(
            abs(x / (1e3 * error * np.sqrt(3 - 6 / n)) - 1) < 0.05
            for n, x in ((3, three), (larger, count))
        ),
        less < 0.5 * far,
    )


@claim(
    "Enough motions calibrate a camera in the hand of any arm.",
    "The motions must turn about at least two axes. Those of a planar arm do not: with "
    "{many:.0f} motions and {noise} rad of noise the rank of the equations is {rank:.0f}. The "
    "shift along the axis then comes out as zero, which is {off_mm:.0f} mm off here, because no "
    "equation contains it.",
    source="F. C. Park, B. J. Martin, Robot sensor calibration, 1994",
)
def motions_calibrate_any_arm(result):
    from course.kinematics.chain import compose, invert
    from course.perception import hand_eye
    from course.rigid_body.quaternion import exp

    X = np.array([0.05, 0.02, 0.12, *exp(np.array([0.4, 0.3, -0.5]))])
    noise = result.input("noise", 1e-3)

    def solved(count, tilt):
        """Return the answer where the axes of the turns are z, but for a share `tilt` of others."""
        turns = 0.7 * result.rng.standard_normal((3, count)) * [[tilt], [tilt], [1.0]]
        shifts = 0.2 * tilt * result.rng.standard_normal((3, count))
        A, by = np.concatenate((shifts, exp(turns))), np.tile(X[:, None], count)
        wrong = np.concatenate((0 * shifts, exp(noise * result.rng.standard_normal((3, count)))))
        return hand_eye(A, compose(compose(compose(invert(by), A), by), wrong))

    flat = solved(int(result.input("many", 200)), 0.0)
    rank = result.measure("rank", flat.rank)
    error = result.measure("off_mm", 1000 * abs(flat.pose[2] - X[2]), 0.1)
    free = [solved(20, x).pose[2] - X[2] for x in result.rng.uniform(0.2, 1.0, 10)]
    result.statement = "Motions of a hand at random, in a plane and in space."
    result.statement_holds(rank == 3)
    result.correction_holds(
        rank == 2, error > 20.0, abs(flat.pose[2]) < 1e-3 < 0.01 > np.abs(free).max()
    )
