"""Analysis against runs, bounds against what they promise, locks against arithmetic by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.middleware import schedule
from course.middleware.schedule import (
    PROTOCOLS,
    blocking,
    breakdown,
    hyperbolic,
    liu_layland,
    random_sets,
    response_times,
    run,
    utilization,
)
from tests.budget import examples


@pytest.mark.parametrize("load", [0.7, 0.85, 0.97])
@pytest.mark.parametrize("n", [2, 4, 8])
def test_the_analysis_is_what_a_run_from_the_critical_instant_shows(n, load):
    C, T = random_sets(n, load, 400, np.random.default_rng(n))
    output, observed = response_times(C, T), run(C, T, 2.0)
    meets = np.isfinite(output)
    assert np.allclose(observed.longest[meets], output[meets], rtol=0, atol=1e-12)
    assert np.array_equal(observed.late == 0, meets)
    assert np.all(observed.longest[~meets] > T[~meets]) or not meets.all()


def test_jitter_delays_the_task_and_all_below():
    """The first release of each comes late, so that all come at once: the worst case."""
    rng = np.random.default_rng(3)
    C, T = random_sets(4, 0.6, 300, rng)
    J = 0.3 * T * rng.random(T.shape)
    text = response_times(C, T, 0.0, J)
    observed, meets = run(C, T, 1.2, phase=J.max(axis=0) - J, jitter=J), np.isfinite(text)
    assert np.allclose(observed.longest[meets], text[meets], rtol=0, atol=1e-8)
    assert np.all(text >= response_times(C, T) + J - 1e-9)


def test_every_set_within_a_bound_meets_its_deadlines_and_some_beyond_do():
    rng, n = np.random.default_rng(1), 4
    for load in (0.75, 0.8, 0.95):
        C, T = random_sets(n, load, 1000, rng)
        meets = np.isfinite(response_times(C, T)).all(axis=0)
        sums, products = utilization(C, T) <= liu_layland(n), hyperbolic(C, T)
        assert np.all(products | ~sums)
        assert np.all(meets | ~products)
        assert np.allclose(utilization(C, T), load)
        if load == 0.8:
            assert not sums.any() and products.any() and meets.sum() > products.sum()
    assert liu_layland(1) == 1.0
    assert liu_layland(2) == pytest.approx(2.0 * (math.sqrt(2.0) - 1.0))
    assert liu_layland(10**6) == pytest.approx(math.log(2.0), abs=1e-6)


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_no_set_breaks_earlier_than_the_one_of_liu_and_layland(n):
    """T = 2^(i/n), C = the gaps: it just meets its deadlines, at the bound."""
    T = 2.0 ** (np.arange(n) / n)
    C = np.append(np.diff(T), 2.0 * T[0] - T[-1])
    assert utilization(C, T) == pytest.approx(liu_layland(n))
    assert breakdown(C, T) == pytest.approx(liu_layland(n), rel=1e-6)
    rates = np.array([0.1, 0.2, 0.4])
    assert breakdown(0.1 * rates, rates) == pytest.approx(1.0)  # harmonic periods


def test_a_set_breaks_where_a_run_says():
    C, T = random_sets(5, 0.5, 300, np.random.default_rng(2))
    limit = breakdown(C, T)
    assert np.all(limit >= liu_layland(5) * (1 - 1e-6)) and np.all(limit <= 1.0 + 1e-6)
    assert 0.78 < np.median(limit) < 0.98
    for share, meets in ((0.9999, True), (1.0001, False)):
        observed = run(C * limit / 0.5 * share, T, 1.01)
        assert np.array_equal(observed.late.sum(axis=0) == 0, np.full(300, meets))


HIGH, MIDDLE, LOW = 0.01, 0.1, 0.02


def inversion(protocol, between=1):
    """High comes just after low has taken the lock, for 20 ms, and those between after that."""
    n = between + 2
    C = [HIGH] + [MIDDLE] * between + [LOW]
    observed = run(
        C,
        [2.0] * n,
        2.0,
        phase=[0.001] + [0.002] * between + [0.0],
        section=[HIGH] + [0.0] * between + [LOW],
        lock=[0] + [-1] * between + [0],
        protocol=protocol,
    )
    return observed.longest[0] - HIGH


def test_a_task_waits_for_those_between_without_a_protocol_and_not_with_one():
    rest = LOW - 0.001  # what is left of the section when high comes
    assert inversion("none") == pytest.approx(rest + MIDDLE)
    assert inversion("none", 5) == pytest.approx(rest + 5 * MIDDLE)  # without end
    for protocol in ("inheritance", "ceiling"):
        for between in (1, 5):
            assert inversion(protocol, between) == pytest.approx(rest)
    bounds = [blocking([HIGH, 0.0, LOW], [0, -1, 0], p)[0] for p in PROTOCOLS]
    assert bounds == [math.inf, LOW, LOW]
    assert blocking([HIGH, LOW], [0, 0], "none").tolist() == [LOW, 0.0]


ROWS = st.lists(
    st.tuples(
        st.integers(2, 20),
        st.integers(40, 200),
        st.floats(0.0, 1.0),
        st.floats(0.0, 1.0),
        st.sampled_from([-1, 0, 1, 2]),
        st.integers(0, 60),
    ),
    min_size=2,
    max_size=6,
)


@examples(150)
@given(rows=ROWS, protocol=st.sampled_from(PROTOCOLS[1:]))
def test_with_a_protocol_no_wait_is_longer_than_the_analysis_says(rows, protocol):
    C, T, share, at, lock, phase = (np.array(column) for column in zip(*rows, strict=True))
    C, T, phase = 1e-3 * C, 1e-3 * np.sort(T), 1e-3 * phase
    section = np.round(share * C, 6) * (lock >= 0)
    before = np.floor(1e6 * at * (C - section)) * 1e-6
    text = response_times(C, T, blocking(section, lock, protocol))
    observed = run(C, T, 2.0, phase, 0.0, before, section, lock, protocol)
    meets = np.isfinite(text) & (np.cumsum(~np.isfinite(text)) == 0)
    assert np.all(observed.longest[meets] <= text[meets] + 1e-8)


def test_ceilings_wait_for_one_section_and_inheritance_for_one_of_each_lock():
    C, section, lock = [0.02, 0.02, 0.03, 0.04], [0.005, 0.005, 0.02, 0.03], [0, 1, 0, 1]
    assert blocking(section, lock, "inheritance").tolist() == pytest.approx([0.02, 0.05, 0.03, 0.0])
    assert blocking(section, lock, "ceiling").tolist() == pytest.approx([0.02, 0.03, 0.03, 0.0])
    waits = [
        run(
            C,
            [1.0] * 4,
            1.0,
            [0.012, 0.011, 0.005, 0.0],
            0.0,
            [0.01, 0.002, 0.0, 0.0],
            section,
            lock,
            p,
        ).longest[1]
        for p in PROTOCOLS[1:]
    ]
    assert waits[1] < waits[0]


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: liu_layland(0), r"n must be .*, got 0"),
        (lambda: response_times([0.1], [0.0]), "period"),
        (lambda: response_times([0.1, 0.1], [1.0]), "period.shape"),
        (lambda: response_times([0.1], [1.0], [0.1, 0.1]), "blocking.shape"),
        (lambda: run([0.1], [1.0], 1.0, section=0.2, lock=[0]), "before"),
        (lambda: run([0.1], [1.0], 1.0, protocol="luck"), "protocol"),
        (lambda: random_sets(3, 0.0, 2, np.random.default_rng(0)), "load"),
        (lambda: schedule.blocking([0.1], [0], "all"), "protocol"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(ValueError, match=match):
        call()
