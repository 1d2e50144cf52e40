"""What the charts of chapter 8 say is in what they measured: their stored series are read."""

import numpy as np

from course import charts


def test_what_lowers_and_what_lifts_success() -> None:
    gap, width = charts.stored("success_over_gap")
    assert gap["no range"].y[-1] < gap["range 0.4"].y[-1] < 0.7 < gap["true parameters"].y[-1]
    assert max(gap["no range"].y) < min(gap["range 1"].y[:4])
    assert min(width["simulator's own arm"].y) > 0.99
    twin = width["MuJoCo's twin"]
    assert twin.high[0] < twin.y[-1]
    (bought,) = charts.stored("robot_time")
    plain = {name: rate for _, rate, name in bought.lines}
    report, tried = bought["identified from a log"], bought["fine-tuned"]
    assert plain["no range"] < plain["range 1"] < min(report.low)
    assert report.x[0] < 0.02 * tried.x[0] and report.high[0] > max(tried.low)


def test_a_mended_delay_hurts_alone_and_the_trace_is_of_these_subsets() -> None:
    every, shares = charts.stored("mending")
    assert every["delay first"].y[1] < every["delay first"].y[0] < max(every[""].y)
    assert shares["delay"].y[0] < shares["delay"].y[2] < shares["load"].y[1]
    total = sum(shares[part].y[1] for part in ("delay", "friction", "motor", "load", "encoder"))
    assert np.isclose(total, every["delay first"].y[-1] - every["delay first"].y[0], atol=1e-4)


def test_mujocos_delay_fails_where_ours_does_and_both_about_the_limit() -> None:
    by_gain, both = charts.stored("late_commands")
    half, locked, whole = by_gain.series
    fail, alone, free = (np.array(series.y) for series in (half, locked, whole))
    # At the gains as tuned and a little below, reaches fail near both limits of the linear loop.
    near = slice(5, 9)
    assert np.all((fail[near] > 0.6 * alone[near]) & (fail[near] < 1.1 * alone[near]))
    # A free joint 1 shortens the limit; beyond it a torque limit bounds what grows.
    assert np.all(free < alone[-free.size :]) and fail[-1] > 1.3 * alone[-1]
    # The band surrounds the middle.
    assert np.all(np.array(half.low) <= fail) and np.all(fail <= np.array(half.high))
    for name in ("no range", "range 1"):
        pair = (s for s in both.series if s.label in (name, f"{name}, MuJoCo"))
        ours, theirs = (np.array(s.y) for s in pair)
        assert np.abs(ours - theirs).max() < 0.15


def test_the_fit_follows_mujocos_and_the_bar_lies_before_the_residual_tells() -> None:
    noise, _ = charts.stored("what_finds_the_numbers")
    ours, theirs = np.array(noise["output error"].y), np.array(noise["mujoco.sysid"].y)
    assert np.all(np.abs(np.log(ours / theirs)) < np.log(2.0))
    assert np.all(10.0 * ours < noise["integral"].y)
    for panel in charts.stored("believed_error_bars"):
        wrong, claim = (np.array(panel[k].y) for k in ("error", "half-width"))
        assert wrong[0] < claim[0] and np.all(wrong[3:] > 2.0 * claim[3:])
    (bound,) = charts.build("bound_reached")
    assert all(np.allclose(s.y, s.expected, rtol=1e-9) for s in bound.series)


def test_knowing_the_arm_beats_randomised_gains_and_each_arm_has_its_own_limit() -> None:
    within, over, history, limits = charts.stored("varying_arms")
    median = {series.label: series.x[0] for series in within.series}
    worst = {series.label: series.high[0] for series in within.series}
    assert median["teacher"] < median["student with history"] < median["randomised gains"]
    # The bound holds for fixed gains arm by arm, so also for their percentiles.
    for name in ("one tuned gain set", "randomised gains"):
        assert median["best gains in hindsight"] <= median[name]
        assert worst["best gains in hindsight"] <= worst[name]
    # It is none for who knows the arm.
    assert worst["teacher"] < worst["best gains in hindsight"]
    for name in ("teacher", "student with history"):
        assert over[name].y[0] < over["one tuned gain set"].y[0]
    quiet, noisy = history.series
    assert quiet.y[-1] < quiet.y[0] and noisy.y[-1] < noisy.y[0]
    lines = [value for _, value, _ in limits.lines]
    assert lines == sorted(lines)
    for series, limit in zip(limits.series, lines, strict=True):
        x, y = np.array(series.x), np.array(series.y)
        # More damping helps up to the limit, and harms beyond it.
        assert np.all(np.diff(y[x < 0.8 * limit]) < 0.0)
        assert 0.75 * limit < x[np.argmin(y)] < 1.3 * limit and y[-1] > 1.2 * y.min()


def test_the_network_beats_formulas_on_the_recording_and_gets_worse_off_it() -> None:
    cases, sizes = charts.stored("actuator_models")
    network, formula, ideal = (
        np.array(cases[name].x) for name in ("network", "lag and friction", "ideal drive")
    )
    assert network[0] < formula[0] < ideal[0]
    assert network[2] > 2.0 * network[0]
    assert np.array(cases["network"].high)[3] > 2.0 * np.array(cases["network"].high)[0]
    error = np.array(sizes["network"].y)
    assert error[-1] < 0.6 * error[0] and sizes["lag and friction"].y[0] > error[-1]
