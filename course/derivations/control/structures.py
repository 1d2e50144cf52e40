"""Claims of chapter 6: cascade, observer, predictor and notch around a joint, and adaptation."""

import numpy as np

from course.derivations import claim


def _share_limit(stable, low, high):
    """Return where a loop stops being stable between low and high, or high if it does not."""
    grid = np.linspace(low, high, 61)
    bad = next((k for k, x in enumerate(grid) if not stable(x)), 0)
    if not bad:
        return high
    low, high = grid[bad - 1], grid[bad]
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low


@claim(
    "A cascade (a position loop around a velocity loop) rejects a load torque in a way that no PID "
    "controller can.",
    "At one sample rate a P-PI cascade is a PID controller that takes a share of the set-point in "
    "its P term. The commands of {draws:.0f} random cascades under a random load differ from those "
    "of the PID controllers by at most {difference:.0e} of their size. The reverse is not always "
    "possible: only PID gains with Kp^2 >= 4 Kd Ki are a cascade, here {share:.0%} of the random "
    "ones.",
    source="G. Ellis, Control System Design Guide, 2012, chapter 17",
)
def cascade_beats_pid(result):
    from course.control import held, joint_system, structures

    dt, n = 1e-3, 400
    draws = result.input("draws", 20)
    largest = 0.0
    for _ in range(draws):
        position, velocity, integral = result.rng.uniform((1, 2, 1), (20, 15, 80))
        plant = held(*joint_system(0.5, 0.5), dt, result.rng.uniform(0, 5e-3))
        push = result.rng.standard_normal(n)
        pid = structures.respond(
            plant,
            structures.cascade(position, velocity, integral).law(dt),
            push,
            samples=n,
        )
        # The two loops as they are drawn, one inside the other, on the same joint.
        x, total, last, sent, commands = np.zeros(2), 0.0, 0.0, np.zeros(plant.whole + 2), []
        for load in push:
            rate, last = (x[0] - last) / dt, x[0]
            missing = -position * x[0] - rate
            total += integral * dt * missing
            sent = np.concatenate([[velocity * missing + total], sent[:-1]])
            commands.append(sent[0])
            x = (
                plant.transition @ x
                + plant.now * (sent[plant.whole] + load)
                + plant.before * (sent[plant.whole + 1] + load)
            )
        size = np.abs(pid.command).max()
        largest = max(largest, float(np.abs(pid.command - commands).max()) / size)
    # Random PID gains: real zeros are the two gains of a cascade.
    kp, ki, kd = 10.0 ** result.rng.uniform((0, 0, 0), (2, 2, 1.3), (400, 3)).T
    zeros = [np.isreal(np.roots(row)).all() for row in np.column_stack([kd, kp, ki])]
    result.measure("difference", max(largest, 1e-16), 0.5)
    result.measure("share", np.mean(zeros), 1e-6)
    result.statement = "Commands of both under the same load and delay, over random gains."
    result.statement_holds(largest > 1e-6)
    result.correction_holds(
        largest < 1e-9, bool((np.array(zeros) == (kp**2 >= 4 * kd * ki)).all()), np.mean(zeros) < 1
    )


@claim(
    "A Smith predictor takes the delay out of the loop, so its gains can be chosen as if there "
    "were no delay.",
    "With the exact delay and model, the loop's matrix has the eigenvalues of the loop without "
    "delay, and further ones that are zero. That is true of a predictor that starts from the "
    "measured state. "
    "Smith's original one runs a model beside the plant, which leaves the plant's own eigenvalues "
    "in the loop, so an unstable plant stays unstable. An aggressive design depends on the delay. "
    "For both poles at -{p:g}/s and an assumed delay of {late:g} ms, PD alone is unstable. The "
    "predictor is stable only while "
    "the true delay is between {low:.2f} and {high:.2f} of the assumed one. For poles at "
    "-{slow:g}/s every delay down to none and up to {slow_high:.1f} times the assumed one is "
    "stable. A constant load leaves "
    "{load:.2f} times the error of PD without delay.",
    source="O. J. M. Smith, Closer control of loops with dead time, 1957; A. Z. Manitius, A. W. "
    "Olbrot, Finite spectrum assignment problem for systems with delays, 1979",
)
def smith_removes_the_delay(result):
    from scipy.linalg import expm

    from course.control import growth, held, joint_system, loop_matrix, pid_law, structures

    dt, late = 1e-3, result.input("late", 20)
    p, slow = result.input("p", 100.0), result.input("slow", 20.0)

    def gains(p):
        return 0.5 * p * p, p - 0.5

    def law(p, n=late):
        return structures.predictor_law(*gains(p), dt=dt, inertia=0.5, damping=0.5, late=n)

    def plant(share=1.0, inertia=0.5, n=late):
        return held(*joint_system(inertia, 0.5), dt, share * n * dt)

    def stable(share, p=p):
        return growth(loop_matrix(plant(share), law(p))) < 1.0

    low = result.measure("low", _share_limit(stable, 1.0, 0.0), 1e-4)
    high = result.measure("high", _share_limit(stable, 1.0, 3.0), 1e-4)
    far = _share_limit(lambda x: stable(x, slow), 1.0, 6.0)
    result.measure("slow_high", far, 1e-3)
    near = _share_limit(lambda x: stable(x, slow), 1.0, 0.0)
    run = structures.respond(plant(), law(slow), 1.0, samples=4000)
    load = result.measure("load", run.error[-1] * gains(slow)[0], 1e-4)
    bare = growth(loop_matrix(plant(), pid_law(gains(p)[0], 0.0, gains(p)[1], dt=dt)))

    def as_without(p, n, share=1.0, inertia=0.5):
        """Return whether the loop decays as fast as that without the delay."""
        free = plant(0.0)
        known = growth(free.transition - np.outer(free.now, gains(p)))
        return abs(growth(loop_matrix(plant(share, inertia, n), law(p, n))) - known) < 1e-6

    cases = list(
        zip(result.rng.uniform(10.0, 150.0, 10), result.rng.integers(2, 30, 10), strict=True)
    )
    wrong = [as_without(p, n, share) for (p, n), share in zip(cases, [0.8, 1.2] * 5, strict=True)]
    wrong += [as_without(p, n, inertia=0.6) for p, n in cases]

    def carried(p, n, torque, original):
        """Return (growth with a predictor, that without delay, that of the plant).

        The plant is the joint with a torque proportional to its angle [N m/rad], which gravity
        makes positive for a link that stands upright.
        """
        pull = np.array([[0.0, 1.0, 0.0], [torque / 0.5, -1.0, 2.0], [0.0, 0.0, 0.0]])
        whole = expm(pull * dt)
        A, B, K = whole[:2, :2], whole[:2, 2], np.array([0.5 * p * p + torque, p - 0.5])
        # The state of the loop: the plant, the commands sent and, for the original form, the model
        # without the delay and the model with it.
        size = 6 + n if original else 2 + n
        rows = np.eye(size)
        known, sent = rows[:2], rows[2 : 2 + n]
        if original:
            model, delayed = rows[-4:-2], rows[-2:]
            law = -K @ (model + known - delayed)
            beside = [A @ model + np.outer(B, law), A @ delayed + np.outer(B, sent[-1])]
        else:
            ahead, beside = known, []
            for command in sent[::-1]:
                ahead = A @ ahead + np.outer(B, command)
            law = -K @ ahead
        loop = np.vstack([A @ known + np.outer(B, sent[-1]), law, sent[:-1], *beside])
        parts = loop, A - np.outer(B, K), A
        return [float(np.abs(np.linalg.eigvals(part)).max()) for part in parts]

    # Chosen to break it: a plant that falls over by itself, under both forms of the predictor.
    torques = result.rng.uniform(2.0, 20.0, 4)
    upright = [carried(p, n, x, False) for (p, n), x in zip(cases, torques, strict=False)]
    classical = [carried(p, n, x, True) for (p, n), x in zip(cases, torques, strict=False)]
    result.statement = "Growth of the loop's matrix, with delays and inertias that differ."
    result.statement_holds(
        stable(0.8) and stable(1.2),
        only_if="delay and model are exact, and the prediction starts from the measured state",
        inside=[as_without(p, n) for p, n in cases]
        + [abs(loop - known) < 1e-6 for loop, known, _ in upright],
        outside=wrong + [abs(loop - known) < 1e-6 for loop, known, _ in classical],
    )
    result.correction_holds(
        bare > 1.0,
        stable(1.0),
        not stable(low - 0.02 * (1 - low)),
        not stable(high + 0.02 * (high - 1)),
        near == 0.0,
        load > 1.0,
        all(loop > 1.0 and abs(loop - alone) < 1e-6 for loop, _, alone in classical),
    )


@claim(
    "The faster the filter of a disturbance observer, the better it rejects a load.",
    "The filter has a limit. Around PD with both poles at -{p:g}/s and a delay of {late:g} ms, an "
    "observer that ignores the delay is stable up to {ignored:.0f} rad/s. With the delay in its "
    "model and the exact inertia none was found up to {most:.0f} rad/s, but with twice the inertia "
    "it is {double:.0f} rad/s. Without PD and friction, an observer that ignores a delay of n "
    "samples reaches its limit where the filter takes over the share 2 sin(pi/(4 n + 2)) of a new "
    "disturbance within one sample. "
    "Below the limit a constant load leaves no error: {rest:.0e} rad of {plain:.3f} rad.",
    source="K. Ohnishi, M. Shibata, T. Murakami, Motion control for advanced mechatronics, 1996; "
    "S. A. Levin, R. M. May, A note on difference-delay equations, 1976",
)
def observer_as_fast_as_possible(result):
    from course.control import growth, held, joint_system, loop_matrix, pid_law, structures

    dt, p, late = 1e-3, result.input("p", 10.0), result.input("late", 20.0)
    n = round(late)
    plant = held(*joint_system(0.5, 0.5), dt, n * dt)
    kp, kd = 0.5 * p * p, p - 0.5

    def law(bandwidth, known, inertia=0.5):
        return structures.observer_law(
            kp, kd, bandwidth, dt=dt, inertia=inertia, damping=0.5, late=n if known else 0
        )

    def stable(*case):
        return growth(loop_matrix(plant, law(*case))) < 1.0

    largest = result.input("most", 2000.0)
    ignored = _share_limit(lambda g: stable(g, False), 1.0, largest)
    known = _share_limit(lambda g: stable(g, True), 1.0, largest)
    double = _share_limit(lambda g: stable(g, True, 1.0), 1.0, largest)
    result.measure("ignored", ignored, 1e-4)
    result.measure("double", double, 1e-4)
    rest = [
        structures.respond(plant, law(0.5 * ignored, case), 1.0, samples=6000).error
        for case in (False, True)
    ]
    # A size of rounding: only its smallness is a result.
    result.measure("rest", max(1e-9, *(float(abs(run[-1])) for run in rest)), 0.5)
    bare = pid_law(kp, 0.0, kd, dt=dt)
    plain = structures.respond(plant, bare, 1.0, samples=6000).error[-1]
    result.measure("plain", plain, 1e-6)

    def alone(samples, share):
        """Return growth of the observer alone, as a free joint runs it, in its rate."""
        free, w = 0.5 / dt, 0.0
        rate, sent, sizes = 1.0, [0.0] * samples, []
        for k in range(4000):
            u = w - share * free * rate
            sent.append(u)
            w = (1.0 - share) * w + share * free * share * rate + share * u
            rate += sent[k] / free
            sizes.append(abs(rate))
        return max(sizes[-400:]) / max(sizes[400:800])

    sides = [
        (alone(m, 0.98 * limit) < 1.0, alone(m, 1.02 * limit) > 1.0)
        for m, limit in ((m, structures.observer_limit(dt, m)) for m in (3, 6, 10))
    ]
    result.statement = "Limits from the loop's matrix; the observer alone simulated on both sides."
    result.statement_holds(stable(1.05 * ignored, False))
    result.correction_holds(
        stable(0.98 * ignored, False),
        not stable(1.02 * ignored, False),
        stable(0.98 * double, True, 1.0),
        not stable(1.02 * double, True, 1.0),
        known >= largest,
        all(a and b for a, b in sides),
        max(abs(run[-1]) for run in rest) < 1e-4 * plain,
    )


@claim(
    "A notch filter near the resonance can only help: at worst it does nothing.",
    "A notch lags below its frequency and leads above it. On an elastic joint with its resonance "
    "at {w:.0f} rad/s and a delay of {late:g} ms, a notch at the resonance raises the largest "
    "stable PD gains {exact:.1f} times. One {off:.0%} above the resonance lowers them to "
    "{high:.2f} of those without a notch; one that is as far below it still raises them "
    "{below:.1f} times. It stops helping {edge:.0%} above the resonance.",
    source="G. Ellis, Control System Design Guide, 2012, chapters 9 and 16",
)
def notch_can_only_help(result):
    from course.charts.control.structures import LINK, MOTOR, SPRING, elastic_limit
    from course.control import structures

    late, mistuned = result.input("late", 5.0), result.input("off", 0.15)
    w = result.measure("w", structures.resonance(MOTOR, LINK, SPRING), 1e-9)
    plain = elastic_limit(None, late)

    def factor(share):
        return elastic_limit(share * w, late) / plain

    exact = result.measure("exact", factor(1.0), 1e-3)
    high = result.measure("high", factor(1.0 + mistuned), 1e-3)
    below = result.measure("below", factor(1.0 - mistuned), 1e-3)
    edge = _share_limit(lambda share: factor(share) > 1.0, 1.0, 1.0 + mistuned)
    result.measure("edge", edge - 1.0, 1e-2)
    result.statement = "Largest stable factor on PD gains, over that without a notch."
    result.statement_holds(high >= 1.0)
    result.correction_holds(exact > 1.2, below > 1.0, high < 0.9, factor(edge + 0.01) < 1.0)


@claim(
    "While the arm rests at its target, an adaptive law has nothing to learn, so its estimate "
    "stays where it is.",
    "The measured rate is in the regressor and in s, with the same noise, and its square has a "
    "mean. At rest with {noise:.0e} rad of encoder noise, the estimated inertia of a joint at "
    "first grows by {drift:.2f} kg m^2/s (median of {seeds:.0f} seeds; {predicted:.2f} predicted), "
    "and then faster, as it amplifies the noise. After {passed:.1f} s it passes the sampled limit, "
    "where it makes the damping too high, at {largest:.0f} kg m^2. {after:.1f} s later the joint "
    "is out of control. Dead zone, "
    "projection and leakage end the drift, normalisation slows it. On a motion, only the wide dead "
    "zone costs accuracy here: the error is {zone:.0f} mrad instead of {bare:.0f} without a cure. "
    "With leakage it is {leak:.0f}, with projection {box:.0f}, with normalisation {norm:.0f} and "
    "without adaptation {off:.0f} mrad.",
    source="P. A. Ioannou, J. Sun, Robust adaptive control, 1996, sections 8.3 to 8.5",
)
def estimate_rests_with_the_arm(result):
    from course.charts.control import structures as chart
    from course.control.adaptive import Cures, drift_rate
    from course.control.sampled import pd_limit

    seeds = result.input("seeds", 12)
    noise = result.input("noise", chart.BLUR)
    still = chart.adaptive_run(Cures(), True, 14.0, seeds)
    early = round(2.0 / chart.SLOW)
    drifts = (still.estimate[early, 0] - still.estimate[0, 0]) / (early * chart.SLOW)
    drift = result.measure("drift", np.median(drifts), 0.02)
    predicted = drift_rate(chart.RATE, chart.SLOPE, noise, chart.SLOW)
    result.measure("predicted", predicted, 1e-9)
    # The estimate of the inertia adds to the damping: PD with a difference ends at 2 J / dt.
    slope, damping = chart.SLOPE, chart.DAMP
    limit = _share_limit(
        lambda x: (
            pd_limit(damping + slope * x, chart.J, chart.SLOW, "difference") > slope * damping
        ),
        1.0,
        100.0,
    )
    largest = result.measure("largest", limit, 1e-4)
    passed = np.argmax(~(still.estimate[:, 0] < largest), axis=0)
    lost = np.argmax(~(np.abs(still.error) < 0.5), axis=0)
    result.measure("passed", chart.SLOW * np.median(passed), 0.05)
    after = result.measure("after", chart.SLOW * np.median(lost - passed), 0.3)
    calm = [np.abs(still.error[: passed[i], i]).max() < 0.05 for i in range(seeds)]

    def moved(cures, rate=chart.RATE):
        tail = chart.adaptive_run(cures, False, 20.0, seeds, rate).error[-2500:]
        return float(np.median(1e3 * np.sqrt(np.mean(tail**2, axis=0))))

    errors = {
        name: result.measure(word, moved(chart.CURES[name]), 0.05)
        for name, word in (("dead zone", "zone"), ("leakage", "leak"), ("projection", "box"))
    }
    bare = result.measure("bare", moved(Cures()), 0.05)
    scaled = result.measure("norm", moved(chart.CURES["normalisation"]), 0.05)
    unadapted = result.measure("off", moved(Cures(), 1e-9), 0.05)

    def late_drift(name):
        """Return the drift of the median estimate in the last half of a run at rest [1/s]."""
        runs = chart.adaptive_run(chart.CURES[name], True, 14.0, seeds).estimate[:, 0]
        middle = np.median(runs, axis=1)
        return (middle[-1] - middle[runs.shape[0] // 2]) / 7.0

    ended = [abs(late_drift(name)) < 0.05 * predicted for name in errors]
    result.statement = "Runs at rest from the true parameters, and on a motion of two sines."
    result.statement_holds(bool((np.abs(drifts) < 0.1).all()))
    result.correction_holds(
        abs(drift / predicted - 1.0) < 0.1,
        all(calm),
        bool((lost > passed).all()),
        after < 1.0,
        all(ended),
        0.02 * predicted < late_drift("normalisation") < 0.5 * predicted,
        scaled < errors["projection"] < errors["leakage"] < bare < errors["dead zone"] < unadapted,
    )
