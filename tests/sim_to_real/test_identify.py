"""Output error: the answer, its error bar, what does not show, and what the residual gives away."""

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.charts.sim_to_real import logs
from course.charts.sim_to_real.logs import ALL, FREE, GUESS, NOISE, TRUTH, record
from course.sim_to_real import (
    Log,
    excitation,
    fit,
    measurement_lag,
    plants,
    scan,
    validate,
    whiteness,
)
from course.sim_to_real.identify import ALARM, arm
from tests.budget import examples

TRUE = np.array(list(TRUTH.values()))
RUNS = 60


@cache
def cramer_rao():
    """Covariance that no unbiased estimate goes below: slopes of fourth order, by another route
    than the fit's."""
    blank = record(noise=0.0)
    rows = []
    for i, step in enumerate(1e-3 * TRUE):
        columns = np.zeros((len(plants.ROWS), 4))
        columns[:5], columns[7] = TRUE[:, None], 1.0
        columns[i] += step * np.array([-2.0, -1.0, 1.0, 2.0])
        q = plants.driven(columns, blank.command.T, np.zeros(4), blank.dt).q
        rows.append(
            (q @ np.eye(q.shape[2])).swapaxes(1, 2) @ [1.0, -8.0, 8.0, -1.0] / (12.0 * step)
        )
    J = np.array(rows).reshape(5, -1)
    return NOISE**2 * np.linalg.inv(J @ J.T)


@cache
def runs():
    return [fit(arm, record(seed=seed), GUESS, FREE) for seed in range(RUNS)]


@given(
    st.floats(0.6, 1.6),
    st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3),
    st.lists(st.floats(0.3, 3.0), min_size=2, max_size=2),
)
@examples(6)
def test_without_noise_the_truth_comes_back_from_afar(heavy, deviation, damping):
    factors = [*(heavy * (1.0 + x) for x in deviation), *damping]
    start = {name: value * f for (name, value), f in zip(TRUTH.items(), factors, strict=True)}
    result = fit(arm, record(noise=0.0), start, FREE)
    assert result.value == pytest.approx(TRUE, rel=1e-7)
    assert result.reason == ""


@pytest.mark.slow
def test_the_spread_is_the_least_possible_and_the_intervals_hold():
    value = np.array([result.value for result in runs()])
    bound = np.sqrt(np.diag(cramer_rao()))
    # Four standard deviations of a spread, a mean and a share out of so many runs.
    spread = value.std(axis=0, ddof=1) / bound
    assert np.abs(spread - 1.0).max() < 4.0 / math.sqrt(2.0 * RUNS)
    assert (np.abs(value.mean(axis=0) - TRUE) < 4.0 / math.sqrt(RUNS) * bound).all()
    held = np.mean([np.abs(f.value - TRUE) < f.half_width() for f in runs()])
    assert abs(held - 0.95) < 4.0 * math.sqrt(0.05 * 0.95 / (5 * RUNS)) * 1.5
    claimed = np.array([np.sqrt(np.diag(f.covariance)) for f in runs()]) / bound
    assert np.abs(claimed - 1.0).max() < 4.0 / math.sqrt(2.0 * 2000.0)
    assert np.mean([f.white < ALARM for f in runs()]) < ALARM + 4.0 * math.sqrt(ALARM / RUNS)


def along(log):
    """Angles, rates and accelerations of the true arm, each (2, T + 1)."""
    columns = np.zeros((len(plants.ROWS), 1))
    columns[:5, 0], columns[7] = TRUE, 1.0
    run = plants.driven(columns, log.command.T, np.zeros(4), log.dt)
    q, v = run.q[:, 0], run.v[:, 0]
    return q, v, np.gradient(v, log.dt, axis=1)


def test_six_numbers_of_which_five_show_as_the_regressor_predicts():
    log, start = record(), logs.six()
    bounds = dict.fromkeys(start, (1e-4, 10.0))
    result = fit(logs.rods, log, start, bounds)
    # d base / d (m1, I1, m2, I2, c1, c2), each times its size.
    l1, l2 = plants.ARM.lengths
    into = np.zeros((5, 6))
    into[0] = l1**2 / 4, 1.0, l1**2 + l2**2 / 4, 1.0, 0.0, 0.0
    into[1, 2], into[2, 2], into[2, 3] = l1 * l2 / 2, l2**2 / 4, 1.0
    into[3, 4] = into[4, 5] = 1.0
    rows = plants.ARM.regressor(*along(log)).swapaxes(0, 1).reshape(5, -1).T @ into
    _, values, directions = np.linalg.svd(rows * list(start.values()), full_matrices=False)
    assert values[-1] < 1e-13 * values[0] < 1e-6 * values[-2]
    assert result.rank == 5
    assert abs(result.directions[0] @ directions[-1]) == pytest.approx(1.0, abs=1e-6)
    assert np.abs(result.directions[0, :2]) == pytest.approx([0.316, 0.949], abs=1e-3)
    assert result.null == ("of m1 and I1 only I1 +0.0625 m1 shows",)
    assert result.null[0] in result.reason
    assert list(np.isinf(result.half_width())) == [True, True, False, False, False, False]
    # What shows is right, and a start elsewhere on the null line stays there.
    other = fit(logs.rods, log, start | {"m1": 0.7, "I1": 0.01}, bounds)
    for answer in (result, other):
        shown = answer.value[1] + 0.0625 * answer.value[0]
        assert shown == pytest.approx(start["I1"] + 0.0625 * start["m1"], rel=1e-3)
    assert abs(other.value[0] - result.value[0]) > 0.05


def test_what_does_not_show_is_said_in_a_sentence():
    def line(p, log):
        t = log.times[None, :, None]
        return (p["x"] + p["y"] + p["z"]) * t + 3e-6 * p["w"] * t**2

    t = np.linspace(0.0, 4.9, 50)
    log = Log(t, 6.0 * t[None] + 0.01 * np.sin(77.0 * t), np.zeros((1, 49)))
    start = {"x": 1.0, "y": 2.0, "z": 3.0, "w": 5.0}
    result = fit(line, log, start, dict.fromkeys(start, (-1e6, 1e6)))
    assert result.rank == 1
    assert "w does not show" in result.null
    # Two directions out of three: each sentence names two numbers of which the sum shows.
    pairs = [text for text in result.null if " only " in text]
    assert len(pairs) == 2 and all(" +1 " in text for text in pairs)
    assert np.isinf(result.half_width()).all()


def test_excitation_is_told_before_it_is_measured():
    kinds = ("one slow joint", "steps", "two sines")
    report = excitation(arm, {kind: record(kind) for kind in kinds}, TRUTH, FREE, NOISE)
    assert next(iter(report)) == "two sines"
    condition = {kind: what.condition for kind, what in report.items()}
    assert condition["two sines"] < 10.0 < 2.0 * condition["two sines"] < condition["steps"]
    assert condition["one slow joint"] > 15.0
    # A tolerance of 0.1 %: two sines keep it and one slow joint does not; fits agree with both.
    for kind, inside in (("two sines", True), ("one slow joint", False)):
        claimed = 1.96 * np.sqrt(np.diag(report[kind].covariance)) / TRUE
        assert (claimed.max() < 1e-3) == inside
        error = np.abs(
            [fit(arm, record(kind, seed=s), GUESS, FREE).value / TRUE - 1 for s in range(3)]
        )
        assert (error.max() < 1e-3) == inside
        assert (error < 2.0 * claimed).all()


@pytest.mark.parametrize(
    "changed",
    [
        {"f1": 0.1, "f2": 0.05},
        {"f1": 0.01, "f2": 0.005},
        {"delay": 0.01},
        {"delay": 0.0005},
    ],
)
def test_the_interval_lies_when_the_model_does_and_the_residual_tells(changed):
    log = record(**changed)
    result = fit(arm, log, GUESS, FREE)
    assert (np.abs(result.value - TRUE) / result.half_width()).max() > 4.0
    assert result.white < ALARM and "not white" in result.reason
    # With it in the model all is well, whether its start is known or not.
    bounds = dict.fromkeys(changed, (0.0, 0.4))
    start = GUESS | {key: 2.0 * value for key, value in changed.items()}
    mended = fit(arm, log, start, FREE | bounds)
    assert mended.reason == ""
    truth = np.array([*TRUE, *changed.values()])
    assert (np.abs(mended.value - truth) < 1.6 * mended.half_width()).all()


def test_ten_numbers_of_a_real_arm_out_of_one_episode():
    gains, ranks = np.array([41.0, 2.5, 5.6, 21.0, 3.3, 1.2]), []
    for gap, seed in ((0.3, 0), (0.3, 1), (1.0, 0), (1.0, 1)):
        log, start, truth = logs.episode(plants.real(gap, 0.01), gains, plants.tasks(1, seed))
        result = fit(arm, log, start, ALL)
        assert (np.abs(result.value - truth) < 1.8 * result.half_width()).all()
        ranks.append(result.rank)
    assert sorted(ranks)[1:] == [10, 10, 10]
    # The motor's strength is none of them: it scales all torques.
    weak = fit(arm, log, start | {"torque": 1.0}, ALL | {"torque": (0.1, 3.0)})
    assert weak.rank == 10 and "torque by" in weak.null[0] and np.isinf(weak.half_width()[-1])


def test_a_white_residual_is_no_proof_where_the_motion_cannot_show_the_fault():
    log = record("one slow joint", delay=0.01)
    result = fit(arm, log, GUESS, FREE)
    assert result.reason == "" and result.white > 0.1
    assert (np.abs(result.value - TRUE) / result.half_width()).max() > 10.0
    # Excitation says so beforehand: with delay among the numbers this log is hopeless.
    start, bounds = TRUTH | {"delay": 0.01}, FREE | {"delay": (0.0, 0.05)}
    logs = {kind: record(kind) for kind in ("one slow joint", "two sines")}
    report = excitation(arm, logs, start, bounds)
    assert report["one slow joint"].condition > 10.0 * report["two sines"].condition


def test_a_log_one_step_late_is_found_by_its_clock():
    log = record()
    shifted = np.column_stack([log.measured[:, 0], log.measured[:, :-1]])
    wrong = fit(arm, Log(log.times, shifted, log.command), GUESS, FREE)
    bound = np.sqrt(np.diag(cramer_rao()))
    assert (np.abs(wrong.value - TRUE) / bound).max() > 30.0
    assert wrong.noise < 1.8 * NOISE  # hardly to be seen in its size
    assert wrong.white < ALARM
    by, deviation = measurement_lag(wrong, Log(log.times, shifted, log.command))
    assert abs(by - log.dt) < 4.0 * deviation < 0.2 * log.dt
    right = fit(arm, log, GUESS, FREE)
    by, deviation = measurement_lag(right, log)
    assert abs(by) < 4.0 * deviation < 0.1 * log.dt


def test_delay_by_scan_and_as_a_number_like_the_others():
    log = record(delay=0.0073)
    result, best = scan(
        arm, log, GUESS | {"delay": 0.0}, FREE, "delay", np.arange(0.0, 0.02, 0.004)
    )
    assert result == pytest.approx(0.0073, abs=2e-4)
    whole = fit(arm, log, GUESS | {"delay": result}, FREE | {"delay": (0.0, 0.05)})
    assert abs(whole.value[-1] - 0.0073) < 2.0 * whole.half_width()[-1] < 2e-4
    assert whole.noise < best.noise
    with pytest.raises(ValueError, match=r"^values must be .*both sides of 0.004"):
        scan(arm, log, GUESS | {"delay": 0.0}, FREE, "delay", np.array([0.0, 0.002, 0.004]))


def test_another_log_is_explained_by_the_right_model_only():
    other = record("steps", seed=9)
    noise, white = validate(arm, other, GUESS, fit(arm, record(), GUESS, FREE))
    assert noise == pytest.approx(1.0, abs=0.05) and white > ALARM
    # A fit with friction left out explains its own log by wrong numbers, and the other one worse.
    wrong = fit(arm, record(f1=0.1, f2=0.05), GUESS, FREE)
    noise, white = validate(arm, record("steps", seed=9, f1=0.1, f2=0.05), GUESS, wrong)
    assert noise > 2.0 and white < ALARM


def test_whiteness_is_uniform_on_white_noise_and_hears_a_colour():
    rng = np.random.default_rng(3)
    chances = np.array([whiteness(rng.standard_normal((2, 800))) for _ in range(600)])
    for share in (0.01, 0.1, 0.5, 0.9):
        spread = math.sqrt(share * (1.0 - share) / 600)
        assert abs(np.mean(chances < share) - share) < 4.0 * spread + 0.005
    white = rng.standard_normal((2, 2001))
    assert whiteness(white[:, 1:] + 0.25 * white[:, :-1]) < 1e-6


@pytest.mark.parametrize("form", ["differentiated", "filtered", "integral"])
def test_regression_is_right_without_noise_and_differences_drown_in_a_hundredth_mrad(form):
    quiet, loud = (np.abs(logs.regress(record(noise=x), form) / TRUE - 1.0) for x in (0.0, 1e-5))
    assert quiet.max() < {"differentiated": 1e-3, "filtered": 2e-3, "integral": 4e-3}[form]
    assert (loud.max() > 0.2) == (form == "differentiated")
    assert np.abs(fit(arm, record(noise=1e-5), GUESS, FREE).value / TRUE - 1.0).max() < 1e-5


def test_what_speaks_against_an_answer_is_said():
    log = record()
    assert fit(arm, log, GUESS, FREE, steps=2).reason.startswith("not settled")
    tight = fit(arm, log, GUESS, FREE | {"c2": (0.21, 10.0)})
    assert "c2 is at its bound, 0.21" in tight.reason and tight.white < ALARM
    assert np.isinf(tight.half_width()[4]) and np.isfinite(tight.half_width()[:4]).all()
    free = record(c2=0.0, noise=0.0)
    assert fit(arm, free, GUESS, FREE | {"c2": (0.0, 1.0)}).value[4] == pytest.approx(0.0, abs=1e-7)


T = np.arange(5.0)
Q, U = np.zeros((2, 5)), np.zeros((2, 4))
GAP = np.array([0.0, 1.0, 2.0, 4.0, 5.0])
NAN = np.full((2, 5), np.nan)
BAD = {
    "times.size": lambda: Log(T[:2], Q[:, :2], U[:, :1]),
    "measured": lambda: Log(T, NAN, U),
    "measured.shape": lambda: Log(T, Q[:, 1:], U),
    "command.shape": lambda: Log(T, Q, Q),
    "times[-1] - times[0]": lambda: Log(0.0 * T, Q, U),
    "times[3]": lambda: Log(GAP, Q, U),
    "sent[3]": lambda: Log(T, Q, U, 1.02 * T[:-1]),
    "log": lambda: fit(arm, Log(T[:3], Q[:1, :3], U[:, :2]), GUESS, FREE),
    "free": lambda: fit(arm, record(), GUESS, {"mass": (0.0, 1.0)}),
    "free ": lambda: fit(arm, record(), GUESS, FREE | {"a": (1.0, 1.0)}),
    "start['a']": lambda: fit(arm, record(), GUESS, FREE | {"a": (1.0, 2.0)}),
    "start": lambda: fit(arm, record(), GUESS | {"b": 0.14}, FREE),
    "simulate(parameters, log).shape": lambda: fit(
        lambda p, log: arm(p, log)[0], record(), GUESS, FREE
    ),
    "noise": lambda: excitation(arm, {"": record()}, GUESS, FREE, 0.0),
    "columns[0]": lambda: fit(arm, record(), GUESS | {"a": -1.0}, {"c1": (0.0, 1.0)}),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    with pytest.raises(ValueError, match=r".* must be") as report:
        BAD[name]()
    assert str(report.value).startswith(name.strip())
