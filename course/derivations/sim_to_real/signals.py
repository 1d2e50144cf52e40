"""Claims of chapter 8: signals of different kinds in one fit, and logs recorded under feedback."""

import functools
import math
from dataclasses import replace

import numpy as np

from course.derivations import claim


@functools.cache
def two_kinds():
    """Return a log of angles and speeds without noise, and its slopes at the true parameters."""
    from course.charts.sim_to_real.logs import FREE, TRUTH, plan
    from course.sim_to_real import Log, fit
    from course.sim_to_real.signals import angles_and_rates

    sent = plan("two sines")
    times = 2e-3 * np.arange(sent.shape[1] + 1)
    blank = Log(times, np.zeros((4, times.size)), sent)
    truth = {name: np.array([value]) for name, value in TRUTH.items()}
    log = replace(blank, measured=angles_and_rates(truth, blank)[..., 0])
    return log, fit(angles_and_rates, log, TRUTH, FREE).slope


def scattered(scale, noise, rng, runs):
    """Return fits to noisy logs, shape (runs, 5), and the error bar that each fit reports."""
    from course.charts.sim_to_real.logs import FREE, TRUTH
    from course.sim_to_real import fit
    from course.sim_to_real.signals import angles_and_rates, weighted

    log, _ = two_kinds()
    fits = []
    for _ in range(runs):
        error = noise[:, None] * rng.standard_normal(log.measured.shape)
        noisy = replace(log, measured=log.measured + error)
        fits.append(fit(*weighted(angles_and_rates, noisy, scale), TRUTH, FREE))
    reported = np.sqrt([np.diag(one.covariance) for one in fits])
    return np.array([one.value for one in fits]), reported


def over_the_bound(scale, noise):
    """Return the predicted standard deviation of each parameter over the Cramer-Rao bound, (5,)."""
    from course.sim_to_real.signals import weighted_covariance

    _, slope = two_kinds()
    spread, bound = (weighted_covariance(slope, noise, x) for x in (scale, noise))
    return np.sqrt(np.diag(spread) / np.diag(bound))


@claim(
    "A fit of angles in rad and speeds in rad/s may add the squares of all residuals as they are.",
    "With noise of {angle_mrad:.0f} mrad and {speed:.2f} rad/s the fit without weights scatters up "
    "to {plain:.1f} times as much as the Cramér-Rao bound allows (measured: {plain_seen:.1f}). "
    "With each residual divided by its noise this factor is {best:.2f} (measured: "
    "{best_seen:.2f}). The weights need not be exact: if the noise of the speeds is assumed "
    "{off:.0f} times too small the factor is {small:.2f}, {off:.0f} times too large {large:.2f}. "
    "A fit of the speeds alone has {speeds_only:.1f}, of the angles alone {angles_only:.2f}.",
    source="A. C. Aitken, On least squares and linear combination of observations, 1936",
)
def signals_of_different_kinds(result):
    from course.charts.sim_to_real.logs import TRUTH
    from course.sim_to_real.signals import weighted_covariance

    angle, speed = 1e-3 * result.input("angle_mrad", 2.0), result.input("speed", 0.02)
    noise, plain = np.array([angle, angle, speed, speed]), np.ones(4)
    truth = np.array(list(TRUTH.values()))
    _, slope = two_kinds()
    bound = np.sqrt(np.diag(weighted_covariance(slope, noise, noise)))
    runs = 100
    predicted = {"plain": over_the_bound(plain, noise), "best": over_the_bound(noise, noise)}
    factors, bars, centred = {}, {}, {}
    for name, scale in (("plain", plain), ("best", noise)):
        fits, reported = scattered(scale, noise, result.rng, runs)
        factors[name] = fits.std(axis=0, ddof=1) / bound
        bars[name] = reported.mean(axis=0) / fits.std(axis=0, ddof=1)
        centred[name] = np.abs(fits.mean(axis=0) - truth) * math.sqrt(runs) / fits.std(axis=0)
        worst = int(np.argmax(predicted[name])) if name == "plain" else 0
        result.measure(name, predicted[name][worst], 0.01)
        result.measure(f"{name}_seen", factors[name][worst], 0.2)
    factor_off = result.input("off", 3.0)

    def speeds(factor):
        """Return the worst factor over the bound if the speeds' noise is assumed wrongly."""
        return float(over_the_bound(noise * (1.0, 1.0, factor, factor), noise).max())

    small = result.measure("small", speeds(1.0 / factor_off), 0.01)
    large = result.measure("large", speeds(factor_off), 0.01)
    alone = result.measure("angles_only", speeds(1e4), 0.01)
    result.measure("speeds_only", speeds(1e-4), 0.01)

    def correlated(share, pairs):
        """Return whether the plain fit is efficient if pairs of signals share their noise."""
        _, slope = two_kinds()
        noise = np.eye(4)
        for i, j in pairs:
            noise[i, j] = noise[j, i] = share
        inverse = np.linalg.inv(np.einsum("ntp,ntq->pq", slope, slope))
        middle = np.einsum("ntp,nm,mtq->pq", slope, noise, slope)
        bound = np.einsum("ntp,nm,mtq->pq", slope, np.linalg.inv(noise), slope)
        spread = np.diag(inverse @ middle @ inverse)
        return bool(np.sqrt(spread / np.diag(np.linalg.inv(bound))).max() < 1.02)

    def efficient(ratio, size):
        """Return whether the plain fit is within 2 % of the bound for this ratio of the noises."""
        some = size * np.array([1.0, 1.0, ratio, ratio])
        return bool(over_the_bound(plain, some).max() < 1.02)

    result.statement = "100 logs of two seconds with other noise; predictions to first order."
    result.statement_holds(
        bool(predicted["plain"].max() < 1.02),
        only_if="the noise of all signals has the same standard deviation, as a number in the "
        "units used, and is independent",
        inside=[efficient(1.0, x) for x in 10.0 ** result.rng.uniform(-4.0, -1.0, 8)],
        # Both kinds of error: speeds that are noisier, and angles that are.
        outside=[efficient(x, 1e-3) for x in (*result.rng.uniform(2.0, 30.0, 6), 0.5, 0.1)]
        # Chosen to break it: speeds that share their angles' noise, as a derivative of them does.
        + [correlated(x, ((0, 2), (1, 3))) for x in (0.5, 0.9)],
    )
    result.correction_holds(
        # A standard deviation of 100 fits is uncertain by 7 %.
        all(
            np.all(np.abs(factors[name] / predicted[name] - 1.0) < 0.3)
            for name in ("plain", "best")
        ),
        bool(np.all(np.abs(bars["best"] - 1.0) < 0.3)),
        all(bool(np.all(x < 4.0)) for x in centred.values()),
        predicted["plain"].max() > 2.0,
        1.0 < large < small < 0.7 * predicted["plain"].max(),
        large < alone < predicted["plain"].max(),
    )


def estimates(loop, samples, runs, rng):
    """Return errors of 1 / I over 1 / I: least squares, output error, instrument; (runs,) each."""
    from course.sim_to_real.signals import regression, speed_output_error, with_instrument

    measured, sent = loop.record(samples, runs, rng)
    values = {
        "least squares": regression(measured, sent, loop.dt),
        "output error": speed_output_error(measured, sent, loop.dt),
        "instrument": with_instrument(measured, sent, loop.plan(samples), loop.dt),
    }
    return {name: value * loop.inertia - 1.0 for name, value in values.items()}


@claim(
    "Least squares on a log recorded under feedback is biased, and a longer log does not help.",
    "A joint with I dv/dt = torque: feedback puts minus gain times the noise of the measured speed "
    "into the torque, and the differentiated speed contains the same noise. On average 1/I comes "
    "out too large by gain sigma^2 / (dt mean(torque^2)): {law:.1%} by this formula, {seen:.1%} "
    "measured. That is {short:.0f} standard errors in a log of {n:.0f} samples, and {long:.0f} in "
    "one {times:.0f} times as long. With twice the gain it is {double:.0%}, without feedback less "
    "than {open:.2%}. "
    "On the same logs output error is biased by less than {output:.3%}, and an instrument, the "
    "planned torque, by less than {instrument:.2%}. With a perfect sensor and a white torque "
    "disturbance of {push:.0f} N m, in logs {longer:.0f} times as long, least squares is biased by "
    "less than {pushed:.1%}, and output error by {swapped:.0%}. A disturbance that lasts, such as "
    "the pull of a cable, biases least squares with a perfect sensor, too.",
    source="T. Soderstrom, P. Stoica, System Identification, 1989, chapter 10",
)
def feedback_and_regression(result):
    from scipy.signal import lfilter

    from course.sim_to_real import Log, fit
    from course.sim_to_real.signals import SpeedLoop, regression, speed_output_error, spin

    loop, runs = SpeedLoop(), 200
    n, times = int(result.input("n", 1000)), int(result.input("times", 16))
    longer = int(result.input("longer", 4))

    def mean_of(some, samples, name="least squares"):
        """Return the mean error, and the standard deviation of one log's."""
        error = estimates(some, samples, runs, result.rng)[name]
        return float(error.mean()), float(error.std(ddof=1))

    few = estimates(loop, n, runs, result.rng)
    long_mean, deviation = mean_of(loop, times * n)
    law = result.measure("law", loop.inertia * loop.bias(n), 1e-3)
    short_mean = result.measure("seen", few["least squares"].mean(), 0.03)
    short = result.measure("short", short_mean / few["least squares"].std(ddof=1), 0.15)
    long = result.measure("long", long_mean / deviation, 0.15)
    double = result.measure("double", mean_of(replace(loop, gain=2.0 * loop.gain), n)[0], 0.03)

    def limit(errors):
        """Return five standard errors of the mean: a bias beyond it would show."""
        return 5.0 * float(errors.std(ddof=1)) / math.sqrt(runs)

    quiet = estimates(replace(loop, gain=0.0), n, runs, result.rng)["least squares"]
    shaken = replace(loop, noise=0.0, disturbance=result.input("push", 2.0))
    other = estimates(shaken, longer * n, runs, result.rng)
    unbiased = {
        "open": quiet,
        "output": few["output error"],
        "instrument": few["instrument"],
        "pushed": other["least squares"],
    }
    for name, errors in unbiased.items():
        result.measure(name, limit(errors), 0.2)
    swapped = result.measure("swapped", abs(other["output error"].mean()), 0.2)

    # The course's own fit finds what the closed form of the output error does.
    measured, sent = loop.record(n, 1, result.rng)
    log = Log(np.linspace(0.0, n * loop.dt, n + 1), measured, sent)
    fitted = fit(spin, log, {"mobility": 5.0}, {"mobility": (0.1, 100.0)}).value[0]
    same = abs(fitted / speed_output_error(measured, sent, loop.dt)[0] - 1.0) < 1e-6

    def biased(some, samples):
        """Return whether the mean error is beyond five standard errors of the mean."""
        errors = estimates(some, samples, runs, result.rng)["least squares"]
        return abs(errors.mean()) > limit(errors)

    def older(late, noise=loop.noise, push=0.0):
        """Return whether logs are biased if the controller uses a speed that is samples old."""
        planned = loop.plan(n)
        desired = loop.dt / loop.inertia * (np.cumsum(planned) - planned)
        error, v = noise * result.rng.standard_normal((n + 1, runs)), np.zeros((n + 1, runs))
        sent, push = np.zeros((n, runs)), np.zeros((n, runs)) + push
        for k in range(n):
            j = max(0, k - late)
            sent[k] = planned[k] + loop.gain * (desired[j] - v[j] - error[j])
            v[k + 1] = v[k] + loop.dt / loop.inertia * (sent[k] + push[k])
        errors = regression((v + error).T, sent.T, loop.dt) * loop.inertia - 1.0
        return bool(abs(errors.mean()) > limit(errors))

    def lasting(memory):
        """Return whether logs are biased by a torque that lasts, with a perfect sensor."""
        sent = result.rng.standard_normal((n, runs))
        push = lfilter([math.sqrt(1.0 - memory**2)], [1.0, -memory], sent, axis=0)
        return older(0, 0.0, push)

    def drawn(**changed):
        gain, inertia = result.rng.uniform(0.5, 8.0), result.rng.uniform(0.05, 0.3)
        return replace(loop, gain=gain, inertia=inertia, **changed)

    result.statement = "200 logs of each kind."
    result.statement_holds(
        all([biased(loop, n), biased(shaken, n)]),
        only_if="the controller feeds back what is correlated with the error of the acceleration "
        "in the same sample: noise of the measurement, or a disturbance that lasts longer than a "
        "sample",
        inside=[biased(drawn(noise=x), n) for x in result.rng.uniform(0.01, 0.1, 8)] + [older(0)],
        # The loop is closed in these logs too, but its measurements have no noise.
        outside=[biased(drawn(noise=0.0, disturbance=x), n) for x in result.rng.uniform(0.1, 2, 8)]
        # Chosen to break it: feedback that comes samples late, whose noise is in earlier rows.
        + [older(late) for late in (1, 2)],
    )
    lasts = [lasting(memory) for memory in (0.8, 0.9, 0.99)]
    gains = (0.5, 1.0, 4.0, 16.0, 32.0)
    laws = [replace(loop, gain=g) for g in gains]
    result.correction_holds(
        all(abs(mean_of(x, n)[0] / (x.inertia * x.bias(n)) - 1.0) < 0.05 for x in (loop, *laws)),
        abs(short_mean - law) < limit(few["least squares"]),
        # Four times the root: the bias stays and the scatter falls.
        3.0 < long / short < 5.3,
        1.7 < double / short_mean < 2.1,
        all(abs(errors.mean()) < limit(errors) for errors in unbiased.values()),
        all(lasts),
        swapped > 0.2,
        swapped > limit(other["output error"]),
        same,
    )
