"""What the charts of chapter 3 say: sentences hold for their rows, laws for small runs."""

import math

import numpy as np
import pytest

from course import charts
from course.charts.platforms import smooth, table
from course.platforms import FAIR, theory
from course.platforms.models import MODELS, VERDICTS

ROWS = table.stored_rows()


def changed(rows, factor: float, *names: str):
    """The rows with the errors of some engines as shipped or fair (or both) multiplied."""
    return [[*r[:4], r[4] * (factor if {r[1], r[2]} & {*names} else 1.0), *r[5:]] for r in rows]


@pytest.mark.parametrize("sentence", table.SENTENCES)
def test_every_sentence_of_the_table_holds(sentence: str) -> None:
    assert table.SENTENCES[sentence](ROWS)
    assert sentence in charts.read("platforms_table")


def test_a_sentence_fails_on_another_table() -> None:
    """Errors, costs and verdicts handed on by some rows break every one of them."""
    for holds in table.SENTENCES.values():
        shifts = [[*ROWS[k:], *ROWS[:k]] for k in (1, 3, 7, 22)]
        moved = [[[*r[:4], *o[4:]] for r, o in zip(ROWS, rows, strict=True)] for rows in shifts]
        assert not all(holds(rows) for rows in moved)
    first, second = list(table.SENTENCES.values())[:2]
    assert not first(changed(ROWS, 1.003, "Drake")) and first(changed(ROWS, 1.001, "Drake"))
    assert not second(changed(ROWS, 1.01, "as shipped"))


def test_the_table_is_complete_and_its_verdicts_follow_from_its_errors() -> None:
    for name in table.TABLE:
        fair, shipped = (table.errors(ROWS, name, s) for s in ("fair", "as shipped"))
        assert list(fair) == list(table.ENGINES) and list(shipped) == list(table.ENGINES[1:])
    for row in ROWS:
        assert (row[8] == "good") == (row[4] <= row[6])
    assert all(table.costs(ROWS, name)["MuJoCo"] == 1.0 for name in table.TABLE)


@pytest.mark.prove
def test_a_cost_does_not_pay_for_the_caches_that_another_motion_has_emptied() -> None:
    """Each sampler here takes longer in its first run after another one's."""
    last: list[int] = []

    def sampler(k: int, seconds: float):
        def run(n: int) -> float:
            cold = last[-1:] != [k]
            last.append(k)
            return n * seconds + (5e-4 if cold else 0.0)

        return run

    short = [sampler(k, seconds) for k, seconds in enumerate((1e-3, 3e-3, 2e-3))]
    for unit, expected in ((0, [1.0, 3.0, 2.0]), (2, [0.5, 1.5, 1.0])):
        quartiles = table.relative_costs(short, unit, 4)
        np.testing.assert_allclose(quartiles, np.transpose([expected] * 3), rtol=1e-12)
    # A motion of a second is run twice in all, and its cold start doesn't count for much.
    last.clear()
    slow = table.relative_costs([*short, sampler(3, 1.0)], 0, 6)
    assert last.count(3) == 2 and slow[3][1] == pytest.approx(1000.0, rel=1e-3)


def test_a_small_table_is_measured_as_the_stored_one() -> None:
    result = charts.build("platforms_table", scenes=("tumble",), rounds=5)[0].data["rows"]
    result += table.scene_rows("brake", 1e-3, rounds=2)
    for row in result:
        (same,) = (r for r in ROWS if r[:3] == row[:3])
        assert row[4] == pytest.approx(same[4], rel=1e-3, abs=1e-9), row[:3]
        assert row[9] <= row[7] <= row[10]  # a cost has a band, which holds its median
    assert all(row[7] == 1.0 for row in result if row[1:3] == ["MuJoCo", "fair"])


def test_same_scheme_same_error_and_order_one() -> None:
    *scenes, agree = charts.build("platform_accuracy", steps=(4e-3, 2e-3), share=0.2)
    for panel in scenes:
        own = np.array(panel["own code"].y)
        assert math.log2(own[0] / own[1]) == pytest.approx(1.0, abs=0.15)
        for name in [n for n in smooth.here() if n != "own code"]:
            np.testing.assert_allclose(panel[name].y, own, rtol=0.02)
        assert panel["MuJoCo, RK4"].y[1] < 1e-3 * own[1]
    assert max(agree["MuJoCo"].y) < 1e-8
    for panel in charts.stored("platform_accuracy")[:3]:
        assert min(panel["PyBullet, as shipped"].y) > 2.0 * max(panel["PyBullet"].y)


def test_the_braking_law_and_the_cones() -> None:
    fair, shipped = charts.stored("platform_braking")
    for name in ("own code", "MuJoCo", "Drake", "PyBullet"):
        x, y = (np.array(v) for v in (fair[name].x, fair[name].y))
        law = [theory.stopped_short(dt=dt) for dt in x]
        np.testing.assert_allclose(y[x <= 4e-3], np.array(law)[x <= 4e-3], rtol=0.06)
    assert min(shipped["Drake, as shipped"].y) > 0.8 > 0.1 > max(shipped["Drake, points"].y)
    path, turn = charts.stored("platform_cone")
    bounds = {"own code": 0.1, "MuJoCo, elliptic": 0.5, "Drake": 0.1, "MuJoCo, pyramid": 14.0}
    for label, bound in bounds.items():
        assert np.max(np.abs(turn[label].y)) < bound
    assert max(path["MuJoCo, pyramid"].y) == pytest.approx(math.sqrt(2.0), rel=0.01)
    assert min(path["PyBullet, box"].y) == pytest.approx(math.sqrt(0.5), rel=0.01)
    assert np.all(np.array(turn["PyBullet, box"].y)[1:4] < -8.0)


@pytest.mark.prove
def test_creep_follows_its_law_on_a_small_scan() -> None:
    rest, held = charts.build("platform_creep", ratios=(1.0, 30.0), dt=2e-3)
    for panel in (rest, held):
        line = panel["MuJoCo, elliptic"]
        np.testing.assert_allclose(line.y, line.expected, rtol=1e-4)
        assert panel["MuJoCo, pyramidal"].y[0] > 1.2 * line.y[0]
    assert rest["own code"].y[0] < 1e-9


def test_squeezes_and_towers() -> None:
    for panel in charts.stored("platform_grasp")[:4]:
        assert max(panel["falls"].x) < 1.0 and min(panel["held"].x) > 0.97
    loose = charts.stored("platform_grasp")[4]
    one = [x for x, dt in zip(loose["held"].x, loose["held"].y, strict=True) if dt == 1.0]
    missing = [x for x, dt in zip(loose["falls"].x, loose["falls"].y, strict=True) if dt == 1.0]
    assert min(one) < max(missing)  # no threshold
    ratio = charts.stored("platform_sag")[1]
    for label in ("MuJoCo, as shipped", "Drake"):
        squares = [theory.sag_growth(n, "inverse mass") for n in np.array(ratio[label].x, int)]
        np.testing.assert_allclose(ratio[label].y, squares, rtol=0.05)
    assert ratio["PyBullet"].y[-1] < 0.3 * theory.sag_growth(8, "inverse mass")


@pytest.mark.prove
def test_readers_effects_and_costs() -> None:
    rows = table.stored_rows("platform_readers")
    assert {r[1] for r in rows} == {m.name for m in MODELS} and {r[3] for r in rows} <= {*VERDICTS}
    ours = {r[1]: r[3] for r in rows if r[0] == "chapter 4"}
    assert all(ours[m.name] == "refused" for m in MODELS if m.kind == "impossible")
    rest = {r[2]: r for r in table.stored_rows("platform_effects") if r[:2] == ["PyBullet", "rest"]}
    assert rest["friction"][5] > 1e3 * rest["friction"][6]
    assert rest["damping"][5] == pytest.approx(rest["damping"][6], rel=1e-6)
    small = charts.build("platform_scaling", scenes=("field",), at_most=4, repeats=1)
    assert small[0]["own code"].y[-1] > 5.0 * small[0]["MuJoCo"].y[-1]
    assert all(0.0 <= share <= 1.0 for series in small[1].series for share in series.y)


def test_the_table_of_whole_motions_shows_the_block_that_hops() -> None:
    rows = table.stored_rows("platform_paths")
    for sentence, holds in table.MESSAGES.items():
        assert holds(rows) and sentence in charts.read("platform_paths")
        assert not holds([[*r[:5], r[4], *r[6:8], 0.02] for r in rows])
    assert {row[0] for row in rows} == {*table.ON_THE_WAY}
    for row in rows:
        assert row[5] >= row[4] and 0.0 <= row[8] <= 1.0
        (same,) = (r for r in ROWS if r[:3] == row[:3])
        assert row[4] == pytest.approx(same[4], rel=1e-3, abs=1e-12)
    new = table.path_row(smooth.here()["MuJoCo"], "brake", FAIR, 1e-3)
    (old,) = (r for r in rows if r[:3] == new[:3])
    assert new[5] == pytest.approx(old[5], rel=0.05) and new[8] == pytest.approx(old[8], abs=0.05)
