"""Claims of chapter 7: formulas that follow from the law of noise, and from a rigid fit."""

import numpy as np

from course.derivations import Symbol, claim
from course.derivations.perception import walls

SYMBOLS = {
    "z": Symbol("distance [m]"),
    "f": Symbol("focal length [pixels]"),
    "B": Symbol("baseline [m]"),
    "s": Symbol("standard deviation of a disparity [pixels]"),
    "h": Symbol("height of a part [m]"),
    "k": Symbol("standard deviations"),
    "sigma": Symbol("standard deviation of a coordinate [m]"),
    "N": Symbol("points", 4.0, 100.0),
}


@claim(
    "Noise that is symmetric in the disparity leaves the mean depth unchanged.",
    "1 / d is curved, so the mean depth is {formula} too far: {bias_mm:.1f} mm at {far:.0f} m with "
    "{noise} px. Averaging more images doesn't remove it. The mean of 1 / z has no such error.",
    ask=(
        "Depth is f B / d. The disparity d has a small error, symmetric about zero, with standard "
        "deviation s. To second order, by how much is the mean depth at z too large?",
        "e = z^3*s^2/(f*B)^2",
        {
            "z^2*s/(f*B)": "That is the standard deviation, the first order. Its mean is zero.",
            "z^3*s^2/(2*(f*B)^2)": "The second derivative of f B / d is 2 f B / d^3; half of it "
            "times the variance.",
            "z^2*s^2/(f*B)": "Check the unit: the result must be in metres.",
        },
    ),
)
def depth_bias(result):
    import sympy

    z, f, B, s, d = sympy.symbols("z f B s d", positive=True)
    result.formula = (sympy.diff(f * B / d, d, 2) / 2 * s**2).subs(d, f * B / z)
    far, noise = result.input("far", 3.0), result.input("noise", 0.5)
    observed = walls(far, result.rng, 60, noise=noise)
    bias = 1000 * (np.mean(observed) - far)
    law = 1000 * float(result.formula.subs({z: far, f: 600, B: 0.05, s: noise}))
    result.measure("bias_mm", law, 1e-9)
    remaining = 1000 * abs(1 / np.mean(1 / observed) - far)
    result.statement = "The mean over 1,176,000 pixels of a wall."
    result.statement_holds(abs(bias) < 1.0)
    result.correction_holds(abs(bias / law - 1) < 0.1, remaining < 0.1 * bias)


@claim(
    "The range on the data sheet says how far away a part may lie.",
    "The part's height does. Seen from above, a part of {height_mm:.0f} mm is as high as {k:.0f} "
    "standard deviations of the noise at {formula}: {far:.2f} m for a sensor with a range of "
    "{range:.0f} m.",
    ask=(
        "Seen from above, a part of height h counts as found if h is at least k standard "
        "deviations of a depth at the table's distance z. What is the largest z?",
        "z = sqrt(h*f*B/(k*s))",
        {
            "h*f*B/(k*s)": "Noise grows with the square of the distance: a root.",
            "sqrt(k*s/(h*f*B))": "The wrong way up: a higher part is found farther away.",
            "sqrt(h*f*B/s)": "That is for one standard deviation, not k.",
        },
    ),
)
def farthest_part(result):
    import sympy

    from course.perception import Camera, Sensor, sense

    h, f, B, k, s, z = sympy.symbols("h f B k s z", positive=True)
    result.formula = sympy.solve(sympy.Eq(z**2 * s / (f * B), h / k), z)[0]
    eye = Camera(140, 140, 600.0, 600.0, 69.5, 69.5)
    sensor = Sensor(0.05, 0.1, far=result.input("range", 10.0))
    height, sigmas = result.input("height_mm", 10) / 1000, result.input("k", 4)

    def above(z):
        """Return share of the pixels of the part's top that are so much higher than the table."""
        top = sense(np.full((140, 140), z - height), eye, sensor, result.rng)
        return np.mean(z - top > sigmas * sensor.sigma(z, eye))

    near, far = 0.2, 5.0
    for _ in range(12):
        middle = 0.5 * (near + far)
        near, far = (middle, far) if above(middle) > 0.5 else (near, middle)
    limit = result.measure("far", near, 0.02)
    law = float(result.formula.subs({h: height, f: 600, B: 0.05, k: sigmas, s: 0.1}))
    result.statement = "Where half of a part's pixels are higher, by halving over the distance."
    result.statement_holds(limit > sensor.far)
    result.correction_holds(abs(limit / law - 1) < 0.03)


@claim(
    "The more points are touched, the smaller is the residual of a calibration.",
    "The residual grows towards sigma: per coordinate it is {formula}, {few:.2f} sigma for {n:.0f} "
    "points and {many:.2f} sigma for {most:.0f}. What becomes smaller is the error of the camera's "
    "position.",
    ask=(
        "A rigid motion is fitted to N points, each coordinate with an error of standard deviation "
        "sigma. What is the root mean square residual of a coordinate?",
        "r = sigma*sqrt(1 - 2/N)",
        {
            "sigma*sqrt(1 - 6/N)": "Six numbers are fitted to 3 N coordinates.",
            "sigma*sqrt(3/N)": "That is the error at the points' middle. It falls.",
            "sigma": "That is without a fit, or for very many points.",
        },
    ),
)
def fit_residual(result):
    import sympy

    from course.perception import rigid_fit

    sigma, N = sympy.symbols("sigma N", positive=True)
    result.formula = sigma * sympy.sqrt((3 * N - 6) / (3 * N))

    def residual(n):
        squares = []
        for _ in range(12_000 // (3 * n - 6)):
            a = result.rng.uniform(-1, 1, (3, n))
            b = a + 1e-3 * result.rng.standard_normal((3, n))
            R, p = rigid_fit(a, b)
            squares.append(np.mean((R @ a + p[:, None] - b) ** 2))
        return 1000 * np.sqrt(np.mean(squares))

    counts = int(result.input("n", 4)), 10, int(result.input("most", 40))
    observed = [residual(n) for n in counts]
    law = [float(result.formula.subs({sigma: 1, N: n})) for n in counts]
    few, more = result.measure("few", observed[0], 0.03), result.measure("many", observed[2], 0.03)
    result.statement = "2,000, 500 and 105 fits to 4, 10 and 40 points: of each 12,000 free errors."
    result.statement_holds(more < few)
    result.correction_holds(np.allclose(observed, law, rtol=0.03), few < more < 1.0)
