"""What chapter 4 says of its charts, on smaller settings: theory against what was measured."""

from dataclasses import replace

import numpy as np
import pytest

from course import charts
from course.charts.kinematics import dynamics, inverse, seven_joint
from course.kinematics import ik, panda, planar, tip
from course.kinematics.seven_joint import swivel_angle
from course.oracles.mujoco import chain
from course.oracles.pinocchio import Arm

pytestmark = pytest.mark.slow


def slope(series) -> float:
    return float(np.polyfit(np.log(series.x), np.log(series.y), 1)[0])


def test_differences_lose_digits_on_both_sides_of_the_step_that_theory_names() -> None:
    errors, right = charts.build(
        "jacobian_precision", steps=tuple(np.logspace(-14, -1, 14)), repeats=1
    )
    for name in ("forward", "central"):
        measured, theory = np.asarray(errors[name].y), errors[name].expected
        assert np.all(measured < 3 * theory) and np.all(theory[-4:] < 3 * measured[-4:])
        assert 0 < int(np.argmin(measured)) < measured.size - 1
        assert np.all(theory < 300 * measured)
    assert max(errors["complex step"].y[:5]) < 1e-14
    wrong = {series.label: series.y[0] for series in right.series}
    assert wrong["analytic"] < 1e-14 and wrong["autograd"] < 1e-14
    assert wrong["forward"] > 1e3 * wrong["complex step"]


def test_the_null_space_drifts_with_the_square_and_one_step_mends_it() -> None:
    (panel,) = charts.build("null_space_step", steps=(0.01, 0.02, 0.05, 0.1), postures=60)
    exact, mended, damped = panel.series
    assert exact.y == pytest.approx(exact.expected, rel=0.02)
    assert [round(slope(s), 1) for s in panel.series] == pytest.approx([2, 4, 1], abs=0.15)
    assert np.all(mended.y < 1e-2 * np.asarray(exact.y)) and np.all(damped.y > exact.y)


def test_damping_keeps_the_joints_within_their_speed_where_theory_says() -> None:
    needed_panel, right = charts.build("damping_map", nx=41, ny=31, dampings=(1e-3, 1e-2, 0.1))
    grid, needed = needed_panel.grid, np.asarray(needed_panel.series[0].y)
    assert grid is not None
    # One cell of the map beside the theory on either side.
    high, low = (np.interp(np.log(needed), np.log(grid.y), range(grid.y.size)) + d for d in (1, -1))
    for i, column in enumerate(grid.values.T):
        rows = np.arange(grid.y.size)
        assert np.all(column[rows > high[i]] <= 1)
        if needed[i] > 1e-3:
            assert np.all(column[rows < low[i]] > 1)
    assert grid.values[grid.y > needed_panel.series[1].y[0]].max() <= 1
    assert grid.values.max() > 3
    for series in right.series:
        assert series.y[-1] > 5 * series.y[0]


@pytest.mark.prove
def test_the_four_steps_end_as_theory_says() -> None:
    usual, edge = charts.build("ik_residual", budgets=(1, 2, 3, 5, 8, 12, 20), targets=12)
    remaining = {series.label: np.asarray(series.y) for series in usual.series}
    # Newton's steps double the digits; damping leaves a share of every one.
    assert remaining["pseudo_inverse"][3] < 1e-9 and remaining["levenberg_marquardt"][4] < 1e-9
    ratios = remaining["damped"][3:6] / remaining["damped"][2:5]
    assert np.all(ratios < 0.5) and remaining["damped"][3] > 1e3 * remaining["pseudo_inverse"][3]
    assert remaining["transpose"][-1] > 1e-5
    # At the edge the Jacobian loses rank: the error is quartered a step, not squared.
    newton = np.asarray(edge["pseudo_inverse"].y)
    assert newton[5] / newton[4] == pytest.approx(0.25**4, rel=0.5)
    assert edge["damped"].y[-1] > 100 * newton[-1]


@pytest.mark.prove
def test_shares_solved_keep_their_order() -> None:
    reached, beside, far = charts.build("ik_success", targets=60, slow=12, seeds=(0,), table=500)
    for panel in (reached, beside):
        share = {series.label: series.y[-1] for series in panel.series}
        assert share["uniform starts"] > 0.95 and share["nearest of a table"] > 0.95
        assert share["usual loop"] < 0.7 < share["usual loop, clamped, 20 starts"]
        assert share["our method in Python"] > 0.95
        assert {"uniform starts, a call a pose", "uniform starts"} <= {
            line.split("  ")[0] for line in panel.notes
        }
        assert all(" 0 claims that FK contradicts" in line for line in panel.notes[:2])
    assert " 0 claimed" in far.notes[0]


def test_the_curve_of_answers_is_complete_and_right() -> None:
    lengths, target = (1.0, 0.8, 0.5), np.array([1.1, 0.4, 0.0])
    curve = inverse.solution_curve(lengths, target)
    assert np.abs(tip(planar(lengths), curve)[:3] - target[:, None]).max() < 1e-12
    result = ik(planar(lengths), np.repeat(target[:, None], 40, axis=1), restarts=1, rng=3)
    assert result.success.sum() > 30
    on = np.array([inverse.covered(q[:, None], curve, 0.02) for q in result.q.T[result.success]])
    assert np.all(on == 1)
    assert inverse.covered(curve, curve[:, :1]) < 0.2 < 1 == inverse.covered(curve, curve)


@pytest.mark.prove
def test_learned_starts_are_solved_in_fewer_steps_than_random_ones() -> None:
    solved_panel, right = charts.build(
        "learned_seeds", targets=60, steps=100, table=500, draws=(1, 8), points=2
    )
    half = {s.label: s.x[np.argmax(s.y >= 0.5)] for s in solved_panel.series}
    assert half["network's starts"] < half["uniform starts"] > half["nearest of a table"]
    for series in right.series:
        assert series.y[0] <= series.y[1] <= 1


def test_the_throughput_chart_asks_all_three_the_same() -> None:
    panels = charts.build("arm_throughput", sizes=(1, 50), at_most=1, repeats=1)
    for panel in panels:
        single = [[1, 50], [1], [1]]
        assert [list(s.x) for s in panel.series if "batch" not in s.label] == single
        batched = [list(s.x) for s in panel.series if "batch" in s.label]
        assert batched == ([] if "Jacobian" in panel.title else [[1, 50]])
        assert all(min(s.y) > 0 for s in panel.series)
    arm = replace(panda(), damping=0.0)
    q, v, x = np.random.default_rng(0).uniform(-1, 1, (3, 7, 5))
    for ours, theirs, mujocos in dynamics.ASKED.values():
        answer = ours(arm, q, v, x)[..., -1]
        for other in (Arm(arm).calls(theirs, q, v, x), chain.calls(arm, mujocos, q, v, x)):
            assert other() == pytest.approx(answer, rel=1e-9, abs=1e-9)
        if theirs in ("rnea", "aba"):
            whole = Arm(arm).parallel(theirs, q, v, x)()
            assert whole == pytest.approx(ours(arm, q, v, x), rel=1e-9, abs=1e-9)


def test_the_same_method_in_python_takes_the_same_steps() -> None:
    """On Pinocchio's calls, from the same starts: the same end after as many steps."""
    arm, rng = panda(), np.random.default_rng(5)
    library, steps = Arm(arm), np.zeros(2)
    for target in inverse.reachable(arm, 20, 3):
        start = rng.uniform(arm.lower, arm.upper)
        ours = ik(arm, target, start, restarts=0)
        q, solved, taken = library.marquardt_ik(target, start[None], (arm.lower, arm.upper))
        assert solved == bool(ours.success)
        if solved:
            assert q == pytest.approx(ours.q, abs=1e-6)
        steps += (taken, int(ours.iterations))
    assert steps[0] == pytest.approx(steps[1], rel=0.02)


@pytest.mark.prove
def test_the_plane_ends_at_a_fault_of_a_tenth_of_a_degree() -> None:
    (panel,) = charts.build("two_links_enough", angles=(0.01, 0.1, 1.0))
    assert dynamics.reaching_arm().check() == []
    for series in panel.series:
        assert slope(series) == pytest.approx(1.0, abs=0.1)
        assert series.y[0] < dynamics.TOLERANCE < series.y[1]
    assert (
        np.abs(dynamics.spatial() - tip(dynamics.ARM.chain(), dynamics.closed())[:3]).max() < 1e-12
    )


def test_the_closed_form_misses_only_what_its_grid_leaves_out() -> None:
    postures, right = charts.build(
        "seven_joint", targets=60, slow=3, grids=(1, 8, 64), starts=(1, 32), batches=1
    )
    fits = next(s for s in postures.series if s.label == "within the limits")
    # The posture that the pose was made from lies on the curve.
    q = seven_joint.POSTURE
    place = [q[6], float(swivel_angle(panda(), q))]
    assert np.min(np.hypot(np.asarray(fits.x) - place[0], np.asarray(fits.y) - place[1])) < 0.05
    closed, batch = right["closed form"], right["closed form, a batch"]
    for series in (closed, batch):
        # More angles of the last joint can only find more.
        assert series.y[0] > series.y[1] > series.y[2] and series.y[2] <= 0.05
    assert right["compiled search"].y[-1] <= 0.05
