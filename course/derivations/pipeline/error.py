"""Claims of chapter 11: which stage owns which millimetre of the error."""

import functools
from dataclasses import replace

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "kp": Symbol("proportional gain [N m/rad]"),
    "kd": Symbol("derivative gain [N m s/rad]"),
    "c": Symbol("friction of the joint [N m s/rad]"),
    "v": Symbol("speed of the reference or target"),
    "L": Symbol("latency [s]"),
    "T": Symbol("period of the camera [s]"),
    "m": Symbol("mass [kg]"),
    "g": Symbol("gravity [m/s^2]"),
    "d": Symbol("from the joint to the centre of mass [m]"),
    "s": Symbol("tilt of the table [rad]", 0.01, 1.5),
    "a": Symbol("gain of the position", 0.1, 1.0),
    "b": Symbol("gain of the rate", 0.01, 1.0),
}


def ends(mended=(), seeds=(0,), scenario=None, **changed):
    """Return errors of the tip at the end (2, N) [m], with some stages mended."""
    from course.pipeline import Scenario, Settings, errors, repair, run_many

    settings = repair(replace(Settings(), **changed), *mended)
    return errors(run_many(scenario or Scenario(), settings, seeds))


def rms(away):
    """Return the root of the mean square of errors (2, N) [m], in millimetres."""
    return 1e3 * float(np.sqrt(np.mean(np.sum(np.asarray(away) ** 2, axis=0))))


@claim(
    "Under the law kp (r - q) - kd v, with more Kd the arm lags further behind a target that moves "
    "at constant speed.",
    "Kd brakes the joint's own speed, so the spring has to balance all damping. The arm "
    "lags by {formula}. At {speed:.0f} mm/s the tip is {lag:.1f} mm behind, "
    "and {twice:.1f} mm with twice the Kd.",
    ask=(
        "A joint under kp (r - q) - kd v, with friction c v, follows a reference at the rate "
        "v. How far does it stay behind in the steady state?",
        "e = (kd + c)*v/kp",
        {
            "kd*v/kp": "The joint's own friction also holds it back.",
            "c*v/kp": "That would be left if Kd acted on the error of the rate.",
            "kp*v/(kd + c)": "A stiffer spring follows more closely.",
            "(kd + c)*v/(2*kp)": "The spring balances the whole damping torque.",
        },
    ),
)
def lag_of_the_arm(result):
    import sympy

    from course.pipeline import Scenario, theory

    kp, kd, c, v, e = sympy.symbols("kp kd c v e", positive=True)
    result.formula = sympy.solve(sympy.Eq(kp * e - kd * v - c * v, 0), e)[0]
    # All stages but the control are repaired: the error left is the arm's. With twice the Kd the
    # start of the motion is still 1 % of the lag after 7 s.
    scene, only = Scenario(seconds=9.0), ("perceive", "age", "plan")
    velocity = np.array(scene.velocity)
    speed = result.input("speed", 1e3 * float(np.hypot(*velocity)))

    def behind(kp, kd):
        away = ends(only, scenario=scene, kp=kp, kd=kd)[:, 0]
        return -1e6 * float(away @ velocity) / speed

    lag, twice = (result.measure(n, behind(25.0, x), 0.02) for n, x in (("lag", 8), ("twice", 16)))
    law = speed * float(result.formula.subs({kp: 25, kd: 8, c: scene.arm.damping[0], v: 1}))
    same = 1e3 * np.hypot(*theory.lag(scene.arm, (0.6, 1.6), 25.0, 8.0, velocity))
    result.statement = (
        "Measured at the end of runs of 9 s in which every stage except the arm was ideal."
    )
    stiff = result.rng.uniform(20.0, 60.0, 6)
    rows = [[behind(float(k), x * float(k)) for x in (0.15, 0.3, 0.45)] for k in stiff]
    result.statement_holds(all(a < b < c for a, b, c in rows))
    result.correction_holds(
        abs(lag / law - 1) < 0.05, abs(same / law - 1) < 1e-9, abs(twice / lag - 16.2 / 8.2) < 0.01
    )


@claim(
    "A camera that is 100 ms late costs 100 ms times the target's speed.",
    "Add the wait for the next frame: half a period on average, so the error is {formula}. "
    "With a period of {period_ms:.0f} ms the arm aims at where the target was {age_ms:.0f} ms "
    "ago, at worst {worst_ms:.0f} ms, unless it predicts the target to the present.",
    ask=(
        "Frames are taken every T and arrive after L. What is the mean error of an arm that "
        "aims at the newest position of a target of speed v?",
        "v*(L + T/2)",
        {
            "v*L": "That is the error when a result arrives; then it gets older.",
            "v*(L + T)": "That is the worst case, just before the next result arrives.",
            "v*(L - T/2)": "A result gets older while it is the newest one.",
            "v*(L/2 + T/2)": "The latency counts in full.",
        },
    ),
)
def latency_is_not_age(result):
    import sympy

    from course.pipeline import Scenario
    from course.role import Stage, age

    t, L, T, v = sympy.symbols("t L T v", positive=True)
    result.formula = sympy.integrate(v * (L + t), (t, 0, T)) / T
    scene = Scenario(velocity=(-0.02, 0.015), seconds=3.0)

    def ages(late, period):
        """Return the age of what an arm without lag aims at, over the phases of the camera [s]."""
        changed = {"noise": 0.0, "bias": (0.0, 0.0), "filtered": False, "frame": period}
        u = np.array(scene.velocity)
        return np.array(
            [
                # Error along the motion over the speed is the age of what is aimed at.
                -ends(
                    ("plan", "control"), (0,), scene, latency=late, phase=float(phase), **changed
                )[:, 0]
                @ u
                / (u @ u)
                for phase in period * (np.arange(12) + 0.5) / 12
            ]
        )

    late, period = 0.1, 1e-3 * result.input("period_ms", 300.0)
    observed = ages(late, period)
    mean = result.measure("age_ms", 1e3 * observed.mean(), 0.02)
    camera = Stage("camera", late, period, overload="pipelined")
    result.measure("worst_ms", 1e3 * age([camera]).greatest)
    result.statement = "Runs with twelve phases of the camera and an arm without lag."
    result.statement_holds(bool(abs(mean / (1e3 * late) - 1.0) < 0.1))
    drawn = result.rng.uniform((0.05, 0.1), (0.3, 0.4), (4, 2))
    each = [(ages(*x).mean(), float(result.formula.subs({L: x[0], T: x[1], v: 1}))) for x in drawn]
    result.correction_holds(
        all(abs(a / b - 1.0) < 0.04 for a, b in each),
        abs(mean / 250.0 - 1.0) < 0.02,
        observed.max() < late + period,
    )


@claim(
    "After an alpha-beta filter, the position is less noisy than in a single frame.",
    "An alpha-beta filter has the form of a Kalman filter with fixed gains, a for the "
    "position and b for the speed. The variance of its position is {formula} of that of a frame. "
    "With a = {alpha:.2f} and b = {beta:.2f} this is {calm:.2f}. A filter that corrects its speed "
    "too strongly, with b = {beta_wild:.2f}, amplifies the noise to {wild:.2f}. Noise that is "
    "similar from frame to frame passes the filter and can even be amplified, here up to "
    "{alike:.2f}.",
    ask=(
        "The error of an alpha-beta filter is x' = (1 - a)(x + y) + a n, y' = y - b (x + y) + "
        "b n with white noise n of variance 1. What is the variance of x?",
        "(2*a^2 + b*(2 - 3*a))/(a*(4 - b - 2*a))",
        {
            "a/(2 - a)": "That is a filter without a rate.",
            "a^2": "Earlier frames still contribute.",
            "(2*a^2 + b*(2 - 3*a))/(4 - b - 2*a)": "A factor a is missing in the denominator.",
            "(2*a^2 + b*(2 + a))/(a*(4 - b - 2*a))": "Position and rate are correlated.",
        },
    ),
    source="P. Kalata, The tracking index, 1984",
)
def filter_calms(result):
    import sympy
    from scipy.linalg import solve_discrete_lyapunov

    from course.pipeline import theory

    a, b, xx, xy, yy = sympy.symbols("a b xx xy yy")
    # Stationary covariance of the filter's error: a discrete Lyapunov equation.
    A = sympy.Matrix([[1 - a, 1 - a], [-b, 1 - b]])
    B, P = sympy.Matrix([a, b]), sympy.Matrix([[xx, xy], [xy, yy]])
    result.formula = sympy.factor(sympy.solve(P - A * P * A.T - B * B.T, [xx, xy, yy])[xx])
    alpha, beta = result.input("alpha", 0.3), result.input("beta", 0.05)
    wild = result.input("beta_wild", 0.9)

    def gain(alpha, beta, memory=0.0):
        """Return the same by SciPy, of the matrices as numbers; infinite where it is unstable.

        Args:
            alpha: gain of the position.
            beta: gain of the rate.
            memory: correlation of the noise in a picture with that in the one before.
        """
        # The noise's own memory as a third state (coloured noise).
        matrix = np.array(
            [
                [1.0 - alpha, 1.0 - alpha, alpha * memory],
                [-beta, 1.0 - beta, beta * memory],
                [0.0, 0.0, memory],
            ]
        )
        if np.abs(np.linalg.eigvals(matrix)).max() >= 1.0:
            return np.inf
        take = np.sqrt(1.0 - memory**2) * np.array([alpha, beta, 1.0])
        return float(solve_discrete_lyapunov(matrix, np.outer(take, take))[0, 0])

    calm = result.measure("calm", theory.filter_gain(alpha, beta))
    loud = result.measure("wild", theory.filter_gain(alpha, wild))
    drawn = result.rng.uniform(0.05, 0.95, 30)
    inside, outside = ([gain(x, share * 2.0 * x) < 1.0 for x in drawn] for share in (0.97, 1.03))
    outside += [gain(1.0 + 0.3 * x, 1.0) < 1.0 for x in drawn]
    # Chosen to break it: gains near every edge, noise that is alike in pictures that follow each
    # other, as from a lamp that flickers or a detector with a habit, and a rate with a wrong sign.
    inside += [gain(x, x * y) < 1.0 for x in (1e-3, 0.999) for y in (1e-3, 1.0, 1.999)]
    coloured = [gain(x, 1.5 * x, 0.9) for x in drawn]
    outside += [x < 1.0 for x in coloured]
    outside += [gain(x, -0.1 * x) < 1.0 for x in drawn]
    both = [(theory.filter_gain(x, x), gain(x, x)) for x in drawn]
    alike = result.measure("alike", max(coloured))
    result.statement = "By algebra, and with numbers on both sides of the condition."
    result.statement_holds(
        loud < 1.0,
        only_if="the noise is independent from frame to frame, both gains are positive, the gain "
        "of the position is below 1, and the gain of the speed is below twice the gain of the "
        "position",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(
        not any(outside),
        all(abs(x / y - 1.0) < 1e-9 for x, y in both),
        calm < 0.3,
        alike > 1.0,
        theory.filter_gain(1.2, 1.0) > 1.0,
    )


@claim(
    "With a high enough frame rate, even a biased camera locates a target as exactly as you want.",
    "Averaging removes noise that is fresh in each frame. It does not remove the bias. At "
    "{slow:.0f} frames per second the tip is {few:.1f} mm off, at {fast:.0f} it is {many:.1f} "
    "mm. The bias alone is {bias:.1f} mm.",
)
def pictures_without_bias(result):
    from course.pipeline import Settings

    only = ("age", "plan", "control")

    def deviation(rate, **changed):
        return rms(ends(only, range(16), frame=1.0 / rate, **changed))

    slow, fast = result.input("slow", 10), result.input("fast", 400)
    few = result.measure("few", deviation(slow), 0.1)
    count = result.measure("many", deviation(fast), 0.1)
    bias = result.measure("bias", 1e3 * np.hypot(*Settings().bias))
    fair = deviation(fast, bias=(0.0, 0.0))
    result.statement = "16 runs for each frame rate, with every stage except perception ideal."
    result.statement_holds(count < 0.5 * bias)
    result.correction_holds(few > 2.0 * count, count > 0.9 * bias, fair < 0.9 * count)


@functools.cache
def cancelling(runs=6, **changed):
    """Return a budget in which bias and lag point against each other, with little noise."""
    from course.pipeline import Scenario, Settings, repair
    from course.pipeline.budget import budget

    settings = replace(Settings(), noise=1e-3, bias=(-0.004, 0.003), **changed)
    return budget(Scenario(), repair(settings, "plan"), range(runs), ("perceive", "age", "control"))


@claim(
    "The errors of the stages always add up as the root of their summed squares.",
    "That is right for independent errors with zero mean. In this example, perception alone "
    "causes {eye:.1f} mm, age {age:.1f} and the arm {arm:.1f}, which makes {rss:.1f} mm by "
    "that rule. Together they make {whole:.1f} mm, because the bias points against the two "
    "others.",
)
def root_sum_square(result):
    from course.pipeline.budget import Budget

    made = cancelling()
    parts = ("perceive", "age", "control")
    alone = [1e3 * made.rms(made.only(part))[0] for part in parts]
    for name, value in zip(("eye", "age", "arm"), alone, strict=True):
        result.measure(name, value, 0.05)
    rss = result.measure("rss", float(np.hypot(np.hypot(alone[0], alone[1]), alone[2])), 0.05)
    whole = result.measure("whole", 1e3 * made.rms(frozenset())[0], 0.1)
    # Parts of mean 0 that know nothing of each other: there the rule is right.
    rng = result.rng
    noise = {part: 1e-3 * rng.standard_normal((2, 4000)) for part in parts}
    sets = {
        s: sum((noise[p] for p in parts if p not in s), np.zeros((2, 4000))) for s in made.errors
    }
    fair = Budget(parts, sets, made.moments)
    right = fair.rms(frozenset())[0] / np.sqrt(sum(fair.rms(fair.only(p))[0] ** 2 for p in parts))
    result.statement = "Six runs for each of the eight sets of ideal stages, and noise alone."
    result.statement_holds(abs(whole / rss - 1.0) < 0.1)
    result.correction_holds(rss > 2.0 * whole, bool(abs(right - 1.0) < 0.05))


@claim(
    "As long as all errors are small, and no stage has a dead band or is at a limit, the mean "
    "error of the pipeline is nearly the vector sum of the mean errors of its stages.",
    "In our example, the sum of the vectors agrees with the measured total to {gap:.2f} mm. The "
    "lengths of the vectors add up to {lengths:.1f} mm, while the total is {whole:.1f} mm: lengths "
    "and squares do not add up. With static friction or play, small errors need not add up at all.",
)
def signed_parts_add_up(result):
    made = cancelling()
    lengths = [1e3 * np.hypot(*made.mean(made.only(p))[0]) for p in ("perceive", "age", "control")]
    summed = result.measure("lengths", sum(lengths), 0.05)
    result.measure("gap", 1e3 * float(np.hypot(*made.gap()[0])), 0.5)
    whole = result.measure("whole", 1e3 * float(np.hypot(*made.mean(frozenset())[0])), 0.2)

    def adds(kp, kd, late):
        one = cancelling(2, kp=float(kp), kd=float(kd), latency=float(late))
        return float(np.hypot(*one.gap()[0])) < 3e-4

    drawn = result.rng.uniform((25.0, 4.0, 0.02), (40.0, 8.0, 0.15), (3, 3))
    holds = all(adds(*x) for x in drawn) and float(np.hypot(*made.gap()[0])) < 3e-4
    result.statement = "The same budget, and three with other gains and latencies: within 0.3 mm."
    result.statement_holds(holds)
    result.correction_holds(summed > 2.0 * whole)


@claim(
    "Making one stage ideal cannot make the error of the tip larger.",
    "It can, if errors cancel. With all stages real, the tip is {whole:.1f} mm off. With ideal"
    " perception it is {eye:.1f} mm, with an arm without lag {arm:.1f} mm, with both "
    "{both:.1f} mm. The three stages can be fixed in {orders:.0f} orders. The number of orders in "
    "which the error never grows on the way is {safe:.0f}.",
)
def mending_makes_worse(result):
    from itertools import permutations

    made = cancelling()
    mended = ((), ("perceive",), ("control",), ("perceive", "control"))
    whole, eye, arm, both = (1e3 * made.rms(frozenset(some))[0] for some in mended)
    for name, value in (("whole", whole), ("eye", eye), ("arm", arm), ("both", both)):
        result.measure(name, value, 0.1)
    result.measure("orders", len(list(permutations(made.parts))))
    safe = result.measure("safe", len(made.orders()))
    # Without a bias there is nothing to cancel.
    fair = ends(("plan",), range(6), noise=1e-3, bias=(0.0, 0.0))
    better = ends(("plan", "control"), range(6), noise=1e-3, bias=(0.0, 0.0))
    result.statement = "Six runs for each of the eight sets of ideal stages."
    result.statement_holds(eye <= whole and arm <= whole)
    result.correction_holds(eye > 2.0 * whole, arm > 1.5 * whole, rms(better) < rms(fair), safe < 6)


@claim(
    "How far an arm sags on a tilted table does not depend on Kd.",
    "At rest only the spring carries the load: a joint gives way by {formula}. At a tilt of "
    "{tilt:.3f} rad the tip sags by {sag:.1f} mm for any Kd, and by half of that with twice "
    "the Kp.",
    ask=(
        "A link of mass m lies across a table that is tilted by s; its centre of mass is d "
        "from the joint. By which angle does a spring kp give way, to first order?",
        "m*g*d*sin(s)/kp",
        {
            "m*g*d*cos(s)/kp": "On a level table gravity does not pull along the plane.",
            "m*g*d/kp": "That is a vertical table.",
            "m*g*sin(s)/kp": "A torque is a force times its lever arm.",
        },
    ),
)
def sag_without_kd(result):
    import sympy

    from course.pipeline import Scenario, Settings, theory
    from course.pipeline.budget import predicted

    m, g, d, s, kp, e = sympy.symbols("m g d s kp e", positive=True)
    result.formula = sympy.solve(sympy.Eq(kp * e, m * g * d * sympy.sin(s)), e)[0]
    tilt = result.input("tilt", 0.06)
    level = Scenario(velocity=(0.0, 0.0), seconds=6.0)
    tilted = replace(level, tilt=tilt)
    only = ("perceive", "age", "plan")

    def sag(kd, kp=25.0):
        first, second = (ends(only, scenario=x, kp=kp, kd=kd)[:, 0] for x in (tilted, level))
        return 1e3 * float(np.hypot(*(first - second)))

    each = [sag(float(kd)) for kd in result.rng.uniform(3.0, 12.0, 6)]
    here = result.measure("sag", sag(8.0), 0.02)
    stiff = sag(9.0, 50.0)
    report = predicted(tilted, Settings(kp=25.0))[0] - predicted(level, Settings(kp=25.0))[0]
    bends = [theory.sag(tilted.plant, (0.0, 0.0), x)[1] for x in (25, 50)]
    result.statement = (
        "Final positions of runs of 6 s on a tilted and on a level table, with six values of Kd."
    )
    result.statement_holds(bool(np.ptp(each) < 0.02 * here))
    result.correction_holds(
        bool(abs(1e3 * np.hypot(*report) / here - 1.0) < 0.1),
        abs(stiff / here - 0.5) < 0.02,
        bool(abs(bends[0] / bends[1] - 2.0) < 1e-9),
    )


@claim(
    "To compare two settings with the fewest runs, give each of them fresh random numbers.",
    "With the same seeds both face the same noise, and its common effect cancels in the "
    "difference. To detect the cost of a tenth more noise takes {saved:.0f} times fewer runs "
    "that way, if the random numbers of both stay in step, as with a generator for each stage. "
    "If every second frame is left out, the noise no longer matches, and the factor is "
    "{other:.1f}. If the same noise helps one setting and harms the other, as with a bias of "
    "{bias_mm:.0f} mm whose sign is flipped, common seeds take {lost:.1f} times as many runs.",
)
def same_seeds(result):
    from course.pipeline import Scenario, Settings, repair
    from course.pipeline.budget import compare

    first = repair(Settings(), "plan")
    second, scene = replace(first, noise=1.1 * first.noise), Scenario(seconds=3.2)
    sets = [compare(scene, first, second, seeds) for seeds in (range(20), range(20, 40))]
    saved = result.measure("saved", min(one.saved for one in sets), 0.5)
    bias = 1e-3 * result.input("bias_mm", 20.0)
    turned = [replace(first, bias=(x, 0.0)) for x in (bias, -bias)]
    lost = result.measure("lost", 1.0 / compare(scene, turned[0], turned[1], range(40)).saved, 0.3)
    other = compare(scene, first, replace(first, frame=2.0 * first.frame), range(40)).saved
    result.measure("other", other, 0.3)
    result.statement = (
        "The smaller saving of two sets of 20 seeds; 40 seeds for the bias and the frames."
    )
    result.statement_holds(saved < 1.0)
    result.correction_holds(
        saved > 4.0, lost > 1.2, other < 2.0, all(one.square[1] > 0.0 for one in sets)
    )
