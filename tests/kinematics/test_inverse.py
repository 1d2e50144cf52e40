"""Inverse kinematics: what is solved, what is told of the rest, and where each step fails."""

import dataclasses
import functools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import kinematics
from course.kinematics import METHODS, ik, panda, planar, tip, two_link_ik, within
from course.kinematics.inverse import _miss, decompose, gain, step
from course.rigid_body.quaternion import exp, product
from tests.budget import examples
from tests.kinematics.arms import drawn

seeds = st.integers(0, 10_000)
LENGTHS = np.array([1.0, 0.7])


def distance_and_angle(chain, target, q):
    """Distance and angle from the tip to targets, by forward kinematics."""
    pose = tip(chain, q)
    if len(target) == 3:
        return np.linalg.norm(target - pose[:3], axis=0), 0.0
    error = kinematics.pose_error(target, pose)
    return np.linalg.norm(error[:3], axis=0), np.linalg.norm(error[3:], axis=0)


def contradicted(chain, target, result) -> int:
    """How many claims of success forward kinematics or the limits contradict."""
    distance, angle = distance_and_angle(chain, target, result.q)
    other = (distance <= 1e-6) & (angle <= 1e-6) & within(chain, result.q)
    return int(np.sum(np.asarray(result.success) & ~other))


# --- what is solved -------------------------------------------------------------------------------


@pytest.mark.parametrize("table", [False, True], ids=["uniform", "table"])
def test_reachable_poses_of_the_seven_joint_arm_are_solved_within_its_limits(table) -> None:
    chain, rng = panda(), np.random.default_rng(7)
    target = tip(chain, kinematics.uniform_starts(chain, 1000, rng).T)
    start = kinematics.Samples(chain, 10_000, 1) if table else None
    result = ik(chain, target, start, rng=2)
    assert result.success.mean() >= 0.995 and contradicted(chain, target, result) == 0
    assert np.all(within(chain, result.q))
    # A table saves at least half of the steps.
    assert result.iterations.mean() < (25.0 if table else 60.0)
    assert set(result.reason[result.success]) == {"solved"}


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_no_step_claims_what_forward_kinematics_contradicts(method) -> None:
    """Reachable, unreachable and near-singular targets, with and without limits."""
    rng = np.random.default_rng(3)
    for chain in (panda(), drawn(24)):
        q = kinematics.uniform_starts(chain, 60, rng).T
        q[:, :20] *= 1e-3  # some arms nearly at zero: the panda is singular there
        target = tip(chain, q)
        target[:3, 40:] *= 3.0
        result = ik(chain, target, method=method, restarts=5, iterations=60, rng=1)
        assert contradicted(chain, target, result) == 0
        assert np.all(within(chain, result.q))
        distance, angle = distance_and_angle(chain, target, result.q)
        np.testing.assert_allclose(result.distance, distance, atol=1e-12)
        np.testing.assert_allclose(result.angle, angle, atol=1e-8)


def test_the_same_seed_gives_the_same_answer_alone_or_in_a_batch() -> None:
    chain = panda()
    target = tip(chain, kinematics.uniform_starts(chain, 300, np.random.default_rng(0)).T)
    whole, again = ik(chain, target, rng=5), ik(chain, target, rng=5)
    np.testing.assert_array_equal(whole.q, again.q)
    one = ik(chain, target[:, 0], rng=5)
    np.testing.assert_array_equal(one.q, whole.q[:, 0])
    assert isinstance(one.success, bool) and one.reason == "solved" and one.starts >= 1


@examples(60)
@given(seeds)
def test_positions_alone_of_random_arms(seed) -> None:
    chain, rng = drawn(2 * (seed // 2)), np.random.default_rng(seed)
    target = tip(chain, kinematics.uniform_starts(chain, 1, rng)[0])[:3]
    result = ik(chain, target, restarts=30, rng=seed)
    assert contradicted(chain, target, result) == 0
    assert result.success or chain.n < 4


def test_a_half_turn_goes_the_short_way() -> None:
    """Just before and just beyond half a turn the error points to opposite sides, never longer."""
    here = np.array([0.0, 0, 0, 1, 0, 0, 0])
    for angle, remaining in (
        (3.0, 3.0),
        (np.pi - 1e-6, np.pi - 1e-6),
        (np.pi + 1e-6, 1e-6 - np.pi),
    ):
        goal = np.concatenate([np.zeros(3), exp(np.array([0.0, 0.0, angle]))])
        np.testing.assert_allclose(
            kinematics.pose_error(goal, here)[3:], [0, 0, remaining], atol=1e-9
        )
        np.testing.assert_allclose(
            kinematics.pose_error(-goal, here)[3:], [0, 0, remaining], atol=1e-9
        )


@examples(60)
@given(seeds)
def test_the_loop_sees_the_error_that_the_door_does(seed) -> None:
    """Turns on both sides of half a turn, and both signs of the target's quaternion."""
    chain, rng = panda(), np.random.default_rng(seed)
    q = rng.normal(size=7)
    turn = rng.normal(size=3)
    turn *= rng.uniform(0.0, 2.0 * np.pi) / np.linalg.norm(turn)
    here, e = tip(chain, q), np.empty(6)
    target = np.concatenate([rng.normal(size=3), product(exp(turn), here[3:])])
    for goal in (target, np.concatenate([target[:3], -target[3:]])):
        result = _miss(chain.table, q[:, None], goal[:, None], 0, np.empty((8, 7)), e)
        np.testing.assert_allclose(e, kinematics.pose_error(goal, here), atol=1e-12)
        assert result[1] == pytest.approx(np.linalg.norm(e[3:]), abs=1e-12)


# --- what is told of the rest ---------------------------------------------------------------------


def test_every_reason_is_told_where_it_is_true() -> None:
    arm, once = planar(LENGTHS), functools.partial(ik, restarts=0)
    beyond = once(arm, [3.0, 0.5, 0.0], [0.3, 0.4])
    assert (beyond.success, beyond.reason) == (False, "unreachable")
    # Nearly as near as it can: it stretches out towards the target, ever more slowly.
    assert 0.0 <= beyond.distance - (np.hypot(3.0, 0.5) - 1.7) < 0.05
    hole = once(arm, [0.1, 0.1, 0.0], [0.3, 2.0])
    assert (hole.success, hole.reason) == (False, "unreachable")
    far = ik(panda(), [1e200, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], restarts=2)  # its square is infinite
    assert (far.success, far.reason) == (False, "unreachable") and far.distance > 1e100
    assert ik(panda(), np.empty((7, 0))).success.shape == (0,)
    assert once(arm, [0.9, 0.0, 0.0], [0.0, 0.0]).reason == "singularity"
    short = once(arm, [0.5, 1.0, 0.0], [0.3, 0.4], iterations=1)
    assert (short.reason, short.iterations) == ("iterations", 1)
    held = replace(arm, lower=[-0.2, 0.1], upper=[0.2, 0.5])
    cut = ik(held, [0.2, 1.2, 0.0], rng=0)
    assert (cut.success, cut.reason) == (False, "limit") and within(held, cut.q)
    both = two_link_ik(LENGTHS, [0.2, 1.2]).q
    assert not np.any(within(held, both)) and two_link_ik(LENGTHS, [0.2, 1.2]).reached


@examples(60)
@given(seeds)
def test_limits_that_cut_the_solution_set_leave_the_branch_that_is_inside(seed) -> None:
    """Two answers exist; a limit at q2 = 0 leaves one, and it is found."""
    rng, arm = np.random.default_rng(seed), planar(LENGTHS)
    q = rng.uniform([-2.0, 0.2], [2.0, 2.9])
    target = tip(arm, q)[:3]
    for sign in (1.0, -1.0):
        low, high = sorted((0.0, sign * 3.1))
        held = replace(arm, lower=[-np.pi, low], upper=[np.pi, high])
        result, branch = ik(held, target, rng=1), 0 if sign > 0 else 1
        assert result.success and within(held, result.q)
        exact = two_link_ik(LENGTHS, target[:2]).q[:, branch]
        turn = (result.q - exact + np.pi) % (2 * np.pi) - np.pi
        # The angles come with the tip's tolerance, enlarged near the stretched arm.
        assert np.abs(turn).max() < 1e-6 / np.sin(min(q[1], np.pi - q[1])) * 10.0


def test_a_pose_of_the_arm_is_never_called_unreachable() -> None:
    """Each target is forward kinematics of a posture, and one start or no tolerance fails often."""
    chain = panda()
    target = tip(chain, kinematics.uniform_starts(chain, 400, np.random.default_rng(5)).T)
    once = ik(chain, target, restarts=1, rng=0)
    assert "stuck" in once.reason and "unreachable" not in once.reason
    exact = ik(planar(LENGTHS), tip(planar(LENGTHS), [0.3, 0.9])[:3], tolerance=(0.0, 0.0))
    assert exact.reason in {"solved", "stuck", "iterations"} and exact.distance < 1e-14


def test_unreachable_and_near_singular_sets_of_the_seven_joint_arm() -> None:
    """None of the first is claimed, and each is told to be out of reach; of the second at least
    19 of 20 are solved, as many as far from singular."""
    chain, rng = panda(), np.random.default_rng(11)
    q = kinematics.uniform_starts(chain, 200, rng).T
    far, base = tip(chain, q), chain.placement[:3, :1]
    out = far[:3] - base
    far[:3] = base + 1.02 * chain.reach[1] * out / np.linalg.norm(out, axis=0)
    result = ik(chain, far, restarts=3, rng=0)
    assert not result.success.any()
    assert set(result.reason) == {"unreachable"}
    near = q.copy()
    near[5] = rng.uniform(-0.017, 0.05, 200)  # the last axis but one folds the wrist
    near[3] = rng.uniform(-0.12, -0.07, 200)  # the elbow nearly stretched
    target = tip(chain, near)
    result = ik(chain, target, rng=0)
    assert result.success.mean() >= 0.95 and contradicted(chain, target, result) == 0


# --- where the steps fail -------------------------------------------------------------------------


@pytest.mark.slow
@examples(80)
@given(seeds, st.floats(1e-3, 1.0))
def test_decomposed_rows_are_orthogonal_and_a_damped_step_is_the_textbook_one(seed, damping):
    rng = np.random.default_rng(seed)
    m, n = (int(x) for x in rng.integers(1, 8, 2))
    J, e = rng.normal(size=(m, n)) * 10.0 ** rng.integers(-6, 3), rng.normal(size=m)
    A, U, dq = np.empty((m, n)), np.empty((m, m)), np.empty(n)
    decompose(J, A, U)
    np.testing.assert_allclose(U @ A, J, atol=1e-13 * np.abs(J).max())
    np.testing.assert_allclose(U.T @ U, np.eye(m), atol=1e-13)
    size = np.sort(np.linalg.norm(A, axis=1))[::-1][: min(m, n)]
    np.testing.assert_allclose(size, kinematics.singular_values(J), rtol=1e-9, atol=1e-300)
    step(J, e, METHODS.index("damped"), damping, A, U, dq)
    # As least squares, whose condition is the square root of that of J J^T + lambda^2.
    taller = np.vstack([J, damping * np.eye(n)])
    exact = np.linalg.lstsq(taller, np.append(e, np.zeros(n)))[0]
    np.testing.assert_allclose(dq, exact, atol=1e-8 * np.abs(exact).max())
    step(J, e, METHODS.index("pseudo_inverse"), damping, A, U, dq)
    np.testing.assert_allclose(dq, np.linalg.pinv(J) @ e, rtol=1e-5, atol=1e-8 * np.abs(dq).max())


@examples(50)
@given(st.floats(1e-4, 1.0))
def test_gains_stay_under_their_bounds_and_reach_them(damping) -> None:
    """The pseudo-inverse has none."""
    s = np.append(np.geomspace(1e-9, 1e3, 241), damping)
    bounds = {"damped": 0.5 / damping, "adaptive": 1.0 / damping}
    for name, bound in bounds.items():
        result = np.array([gain(x, METHODS.index(name), damping) for x in s])
        assert result.max() <= bound * (1.0 + 1e-15)
        assert result[-1] == pytest.approx(bound, rel=1e-12)  # at s = lambda
    assert gain(1e-9, METHODS.index("pseudo_inverse"), damping) == pytest.approx(1e9)


@pytest.mark.parametrize("method", METHODS)
def test_from_a_stretched_arm_no_step_goes_inwards(method) -> None:
    """The target lies on the arm's line; sideways of it every method gets there."""
    arm, goal = planar(LENGTHS), [0.9, 0.0, 0.0]
    stuck = ik(arm, goal, [0.0, 0.0], method=method, restarts=0)
    assert (stuck.success, stuck.reason) == (False, "singularity")
    np.testing.assert_array_equal(stuck.q, [0.0, 0.0])
    aside = ik(arm, [0.9, 0.4, 0.0], [0.0, 0.5], method=method, restarts=0, iterations=3000)
    assert aside.success
    assert ik(arm, goal, [0.0, 0.0], method=method, restarts=20, iterations=3000).success


def test_a_null_space_step_moves_the_tip_by_c_h_squared_and_one_step_takes_it_back() -> None:
    chain, q = panda(), np.array([0.3, -0.5, 0.2, -1.8, 0.4, 1.6, 0.7])
    goal, rows = tip(chain, q), []
    _, slope = kinematics.elbow_height(chain, q)
    for h in (0.2, 0.1, 0.05, 0.025):
        other = kinematics.null_space_step(chain, q, slope, h)
        assert np.linalg.norm(other - q) == pytest.approx(h)
        back = ik(chain, goal, other, method="pseudo_inverse", restarts=0, iterations=1)
        rows.append(
            (distance_and_angle(chain, goal, other)[0], distance_and_angle(chain, goal, back.q)[0])
        )
        assert kinematics.elbow_height(chain, back.q)[0] > kinematics.elbow_height(chain, q)[0]
    moved, remaining = np.array(rows).T
    np.testing.assert_allclose(np.log2(moved[:-1] / moved[1:]), 2.0, atol=0.15)
    # The rest is of fourth order: the square of what there was.
    assert np.all(remaining < 2.0 * moved**2) and np.log2(remaining[1] / remaining[2]) > 3.0


@examples(40)
@given(seeds)
def test_objectives_have_the_gradients_they_say(seed) -> None:
    rng, h = np.random.default_rng(seed), 1e-6
    arm, chain = planar([0.5, 0.4, 0.3]), panda()
    centre = rng.uniform(-1.5, 1.5, 2)
    for name, objective in (
        (chain, lambda q: kinematics.elbow_height(chain, q)),
        (chain, lambda q: kinematics.mid_range(chain, q)),
        (arm, lambda q: kinematics.disc_distance(arm, q, centre, 0.1)),
    ):
        q = rng.uniform(-1.0, 1.0, name.n)
        value, slope = objective(q)
        moved = [objective(q + h * e)[0] - objective(q - h * e)[0] for e in np.eye(name.n)]
        if abs(value + 0.1) > 1e-3:  # on a line the distance has a kink
            np.testing.assert_allclose(slope, np.array(moved) / (2 * h), atol=1e-4)
    pinned = dataclasses.replace(chain, lower=chain.upper)  # no joint has a range left
    assert kinematics.mid_range(pinned, chain.upper)[0] == 0.0


# --- two links ------------------------------------------------------------------------------------


@examples(100)
@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(0.0, 1.0), st.floats(-3.1, 3.1))
def test_both_branches_reach_every_point_of_the_annulus(l1, l2, share, heading) -> None:
    """Its edges included: there the two become one."""
    near, far = abs(l1 - l2), l1 + l2
    r = near + share * (far - near)
    target = r * np.array([np.cos(heading), np.sin(heading)])
    result = two_link_ik([l1, l2], target)
    assert result.distance <= 1e-15 * far * 4
    arm = planar([l1, l2])
    for branch in (0, 1):
        q = result.q[:, branch]
        assert np.abs(tip(arm, q)[:2] - target).max() < 1e-14 * far
    assert result.q[1, 0] >= 0.0 >= result.q[1, 1]


@examples(60)
@given(st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.floats(1e-9, 1.0), st.floats(-3.1, 3.1))
def test_outside_the_annulus_both_point_at_the_target(l1, l2, gap, heading) -> None:
    near, far, line = abs(l1 - l2), l1 + l2, np.array([np.cos(heading), np.sin(heading)])
    for r in [far + gap] + ([near - gap] if near > 1.001 * gap else []):
        result = two_link_ik([l1, l2], r * line)
        assert not result.reached
        assert result.distance == pytest.approx(gap, abs=1e-14 * (far + 1.0))
        for branch in (0, 1):
            at = tip(planar([l1, l2]), result.q[:, branch])[:2]
            assert np.linalg.norm(at - r * line) == pytest.approx(gap, rel=1e-6, abs=1e-13)


def test_near_the_edge_the_angle_keeps_its_digits() -> None:
    """1e-12 inside the outer edge the bend is the square root of it; half the digits of an
    arccosine would be gone."""
    for gap in (1e-12, 1e-10, 1e-8):
        result = two_link_ik([1.0, 1.0], [2.0 * (1.0 - gap), 0.0])
        x = 2.0 * (1.0 - gap)
        exact = 2.0 * np.arctan2(np.sqrt((2.0 - x) * (2.0 + x)), x)
        assert result.q[1, 0] == pytest.approx(exact, rel=1e-12)
    centre = two_link_ik([1.0, 1.0], [[0.0, 1.0], [0.0, 1.0]])
    assert centre.reached.all() and np.isfinite(centre.q).all()
    assert np.abs(tip(planar([1.0, 1.0]), centre.q[:, 0])[:2, 0]).max() < 1e-15
