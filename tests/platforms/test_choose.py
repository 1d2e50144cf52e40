"""A pick of `choose` meets every need, the unknown meets none, the turning tolerance turns."""

import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.platforms.choose import UNKNOWN, Fact, Need, choose
from tests import budget

ROWS = ("error", "step", "cost")
ENGINES = ("one", "two", "three", "four")

numbers = st.one_of(st.none(), st.just(math.nan), st.floats(1e-6, 1e3))
facts = st.builds(Fact, numbers)
yes_or_no = st.builds(Fact, st.sampled_from([True, False, None]))
tables = st.fixed_dictionaries(
    {
        engine: st.fixed_dictionaries(
            {}, optional={**{row: facts for row in ROWS}, "gpu": yes_or_no}
        )
        for engine in ENGINES
    }
).map(
    # A row that no engine has is a typing mistake; one of which nothing is known is there.
    lambda result: {**result, "one": {**dict.fromkeys((*ROWS, "gpu"), UNKNOWN), **result["one"]}}
)
limits = st.floats(1e-6, 1e3)
jobs = st.fixed_dictionaries({"error": limits, "step": limits, "gpu": st.booleans()}).map(
    lambda result: [
        Need("error", result["error"], "at most"),
        Need("step", result["step"], "at least"),
        *([Need("gpu")] if result["gpu"] else []),
    ]
)


@pytest.mark.slow
@budget.examples(200)
@given(tables, jobs)
def test_a_pick_meets_all_needs_and_no_other_that_does_is_cheaper(table, needs) -> None:
    def holds(engine: str) -> bool:
        rows = table[engine]
        error, step, gpu, cost = (
            rows.get(r, UNKNOWN).value for r in ("error", "step", "gpu", "cost")
        )
        if any(x is None or x != x for x in (error, step, cost)):
            return False
        if len(needs) == 3 and gpu is not True:
            return False
        return error <= needs[0].limit and step >= needs[1].limit

    result = choose(table, needs, "cost")
    able = [engine for engine in ENGINES if holds(engine)]
    assert sorted(one.engine for one in result.ranking) == sorted(able)
    assert (result.pick is None) == (not able)
    if result.pick:
        assert table[result.pick]["cost"].value == min(table[e]["cost"].value for e in able)
    assert len(result.ranking) + len(result.out) == len(ENGINES)
    for one in result.out:
        assert one.failed or one.unknown
        assert set(one.failed) | set(one.unknown) <= set(result.deciding)


@pytest.mark.slow
@budget.examples(100)
@given(tables, jobs, st.sampled_from(ENGINES), st.sampled_from([*ROWS, "gpu"]))
def test_forgetting_a_fact_never_lets_an_engine_in(table, needs, engine, row) -> None:
    before = {one.engine for one in choose(table, needs, "cost").ranking}
    less = {**table, engine: {**table[engine], row: UNKNOWN}}
    result = choose(less, needs, "cost")
    assert {one.engine for one in result.ranking} <= before
    if row in ("error", "step", "cost"):
        assert result.pick != engine
        (out,) = (one for one in result.out if one.engine == engine)
        assert row in out.unknown and row not in out.failed


@budget.examples(100)
@given(tables, jobs, st.floats(1.0, 100.0))
def test_a_looser_tolerance_keeps_who_was_in(table, needs, factor) -> None:
    looser = [replace(needs[0], limit=needs[0].limit * factor), *needs[1:]]
    before, after = choose(table, needs, "cost"), choose(table, looser, "cost")
    assert {o.engine for o in before.ranking} <= {o.engine for o in after.ranking}
    if before.pick:
        assert after.pick and after.ranking[0].cost <= before.ranking[0].cost


@budget.examples(100)
@given(tables, jobs, st.floats(0.0, 1.0))
def test_the_turning_tolerance_turns_and_no_smaller_change_does(table, needs, share) -> None:
    result = choose(table, needs, "cost")

    def pick(row: str, limit: float) -> str | None:
        changed = [replace(n, limit=limit) if n.row == row else n for n in needs]
        return choose(table, changed, "cost").pick

    if result.turn:
        assert result.turn.pick != result.pick
        assert pick(result.turn.row, result.turn.limit) == result.turn.pick
    largest = result.turn.factor if result.turn else 1e6
    less = 1.0 + share * (largest - 1.0) * (1.0 - 1e-9)
    if math.isfinite(less) and less < largest:
        for need in needs[:2]:
            for limit in (need.limit * less, need.limit / less):
                assert pick(need.row, limit) == result.pick


def test_the_answer_says_what_decides() -> None:
    table = {
        "quick": {"error": Fact(0.02, "m"), "cost": Fact(1.0)},
        "exact": {"error": Fact(0.001, "m"), "cost": Fact(5.0)},
        "praised": {"cost": Fact(0.1)},
    }
    result = choose(table, [Need("error", 0.01, "at most")], "cost")
    assert (result.pick, result.deciding) == ("exact", ("error",))
    assert result.turn and (result.turn.row, result.turn.limit, result.turn.pick) == (
        "error",
        0.02,
        "quick",
    )
    assert "Out: praised, error unknown" in str(result) and "quick, fails error" in str(result)
    assert "With a limit of 0.02 m for error, quick would be picked" in str(result)
    loose = choose(table, [Need("error", 0.1, "at most")], "cost")
    assert (loose.pick, loose.deciding) == ("quick", ("error", "cost"))
    requested = {**table, "praised": {**table["praised"], "gpu": UNKNOWN}}
    assert choose(requested, [Need("gpu")], "cost").pick is None


def test_needs_that_say_nothing_are_refused() -> None:
    wrong: list[tuple[Any, str]] = [
        (0.1, "is"),
        (True, "at most"),
        (math.nan, "at most"),
        ("1e-3", "at most"),
    ]
    wrong += [(None, "at least"), ([1.0], "at most"), ("yes", "is")]
    for limit, sense in wrong:
        with pytest.raises(ValueError, match="limit must be"):
            Need("error", limit, sense)
    with pytest.raises(ValueError, match=r"sense must be .*, got 'below'"):
        Need("error", 0.1, "below")
    twice = [Need("error", 0.1, "at most"), Need("error", 0.2, "at most")]
    with pytest.raises(ValueError, match="each row and sense once"):
        choose({}, twice, "cost")


def test_a_row_that_no_engine_has_is_a_typing_mistake() -> None:
    table = {"one": {"error": Fact(0.1), "cost": Fact(1.0)}, "two": {"cost": Fact(2.0)}}
    with pytest.raises(ValueError, match=r"row of a need must be one of 'error'.*, got 'errors'"):
        choose(table, [Need("errors", 0.1, "at most")], "cost")
    with pytest.raises(ValueError, match=r"by must be one of 'error', 'cost'.*, got 'csot'"):
        choose(table, [Need("error", 0.1, "at most")], "csot")
    # What one engine has, or what is said to be unknown, is a row.
    result = choose(table, [Need("error", 0.1, "at most")], "cost")
    assert (result.pick, result.out[0].unknown) == ("one", ("error",))
