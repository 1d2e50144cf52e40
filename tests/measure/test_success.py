"""Share solved against budget: counted by hand, and Wilson's interval by its defining equation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from course.measure.figure import Panel, draw
from course.measure.success import TWO_SIGMA, Success, collect, wilson
from tests.budget import examples

pytestmark = pytest.mark.smoke


@given(st.integers(1, 2000), st.floats(0.0, 1.0), st.floats(0.3, 4.0))
def test_wilson_ends_are_where_the_share_is_z_deviations_off(tried, share, z):
    """Both ends p solve (share - p)^2 = z^2 p (1 - p) / n: there the interval comes from."""
    solved = share * tried
    share = solved / tried  # as rounded
    for end, side in zip(wilson(solved, tried, z), (1.0, -1.0), strict=True):
        assert 0.0 <= end <= 1.0 and side * (share - end) >= 0.0
        deviation = (share - end) ** 2 - z**2 * end * (1.0 - end) / tried
        assert abs(deviation) <= 1e-9


@examples(15)
@given(st.sampled_from([0.02, 0.3, 0.9, 0.995]), st.integers(40, 400))
def test_wilson_holds_the_true_share_about_as_often_as_it_says(share, tried):
    """Exact coverage, by the binomial distribution; that of the usual interval is far off."""
    counts = np.arange(tried + 1)
    low, high = wilson(counts, tried)
    weight = binom.pmf(counts, tried, share)
    assert 0.89 < weight[(low <= share) & (share <= high)].sum() <= 1.0


def test_no_failure_in_a_hundred_tries_is_not_certainty():
    low, high = wilson([0, 100], 100)
    assert low[0] == 0.0 and high[1] == 1.0
    assert high[0] == pytest.approx(TWO_SIGMA**2 / (100 + TWO_SIGMA**2), rel=1e-12)
    assert low[1] == pytest.approx(1.0 - high[0], rel=1e-12)


COST = [[1.0, 2.0, 3.0, math.inf], [2.0, 2.0, 8.0, 9.0], [1.0, math.inf, math.inf, math.inf]]


def test_shares_count_a_failure_at_every_budget():
    result = Success("mine", np.array(COST), "steps")
    budgets = [0.5, 1.0, 2.0, 8.0, 1e9]
    assert result.shares(budgets).tolist() == [
        [0.0, 0.25, 0.5, 0.75, 0.75],
        [0.0, 0.0, 0.5, 0.75, 1.0],
        [0.0, 0.25, 0.25, 0.25, 0.25],
    ]
    assert result.share(budgets).tolist() == [0.0, 0.25, 0.5, 0.75, 0.75]
    assert result.ever == 0.75
    low, high = result.band(budgets)
    assert ((low <= result.share(budgets)) & (result.share(budgets) <= high)).all()
    expected = wilson([2.0], 4)
    assert (low[2], high[2]) == (expected[0][0], expected[1][0])


def test_the_budget_of_a_share_is_infinite_where_so_much_is_never_solved():
    result = Success("mine", np.array(COST), "steps")
    assert result.budget(0.25) == (1.0, 1.0, 2.0)
    assert result.budget() == (2.0, 2.0, math.inf)
    assert result.budget(1.0) == (math.inf, 9.0, math.inf)
    pair = Success("two", np.array([[2.0], [4.0]]), "steps")
    assert pair.budget(1.0) == (3.0, 2.0, 4.0)
    assert Success("two", np.array([[2.0], [math.inf]]), "steps").budget(1.0)[0] == math.inf


@given(st.lists(st.floats(0.0, 10.0) | st.just(math.inf), min_size=1, max_size=30))
def test_within_the_budget_of_a_share_that_share_is_solved_and_below_it_is_not(cost):
    result = Success("mine", np.array([cost]), "steps")
    for k in range(1, len(cost) + 1):
        needed, *_ = result.budget(k / len(cost))
        if math.isinf(needed):
            assert result.ever < k / len(cost)
        else:
            assert result.share([needed])[0] >= k / len(cost) - 1e-12
            if needed > 1e-300:
                assert result.share([np.nextafter(needed, 0.0)])[0] < k / len(cost)


def test_collecting_gives_counts_and_times_and_a_stream_a_problem():
    ticks = iter(range(1000))
    drawn: dict[str, list[float]] = {}

    def solve(problem, rng):
        drawn.setdefault(problem, []).append(rng.random())
        return math.inf if problem == "hard" else 3.0

    by_count, by_time = collect(
        "mine", solve, ["easy", "hard"], [4, 5], "steps", lambda: float(next(ticks))
    )
    assert by_count.cost.tolist() == [[3.0, math.inf]] * 2 and by_count.unit == "steps"
    assert by_time.cost.tolist() == [[1.0, math.inf]] * 2 and by_time.unit == "s"
    alone = dict(drawn)
    drawn.clear()
    collect("mine", solve, ["easy"], [5], "steps")
    assert drawn["easy"] == [alone["easy"][1]]
    assert len({*alone["easy"], *alone["hard"]}) == 4


def test_its_series_is_drawn_with_its_band_and_says_its_figures():
    series = Success("MuJoCo", np.array(COST), "steps").series([1.0, 2.0, 8.0])
    assert series.key == "MuJoCo" and "75.00%" in series.note and "within 2 steps" in series.note
    figure = draw([Panel("solved", "steps", "share", series=[series])])
    assert len(figure.axes[0].collections) == 1
    never = Success("mine", np.full((1, 3), math.inf), "s").series([1.0])
    assert "never" in never.note and list(never.y) == [0.0]


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        ([1.0, 2.0], "cost.shape"),
        ([[math.nan]], "cost must be"),
        ([[-1.0]], "cost must be"),
        ([[]], "shape"),
    ],
)
def test_costs_that_are_none_are_refused(cost, words):
    with pytest.raises(ValueError, match=words):
        Success("mine", np.array(cost), "s")


def test_bad_questions_are_refused():
    result = Success("mine", np.array(COST), "steps")
    for call, words in (
        (lambda: result.budget(0.0), "share"),
        (lambda: result.share([math.nan]), "budgets"),
        (lambda: wilson([3.0], 2), "solved"),
        (lambda: wilson([0.0], 0), "tried"),
        (lambda: collect("mine", lambda p, rng: 1.0, [], [1], "steps"), "problems and seeds"),
    ):
        with pytest.raises(ValueError, match=words):
            call()
