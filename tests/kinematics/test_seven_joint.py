"""The closed form of the 7-R arm against forward kinematics, a search, and its own limits."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.kinematics import (
    frames,
    ik,
    jacobian,
    panda,
    planar,
    pose_error,
    random_chain,
    singular_values,
    tip,
)
from course.kinematics.seven_joint import (
    BRANCHES,
    closed_form,
    postures_within_limits,
    swivel_angle,
)

ARM = panda()


def postures(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(ARM.lower[:, None], ARM.upper[:, None], (7, count))


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the largest difference of any joint, modulo a turn [rad]."""
    return np.abs(np.angle(np.exp(1j * (a - b)))).max(axis=0)


@given(st.integers(0, 2**31))
def test_every_branch_reaches_the_pose_and_one_is_the_posture_it_came_from(seed: int) -> None:
    q = postures(seed, 50)
    goal = tip(ARM, q)
    solved = closed_form(ARM, goal, q[6])
    solvable = np.isfinite(solved[0])
    wide = np.broadcast_to(goal[:, None], (7, BRANCHES, 50))
    assert np.abs(pose_error(wide[:, solvable], tip(ARM, solved[:, solvable]))).max() < 1e-10
    # Branches come in pairs of the shoulder, so there are 4 or 8 where a posture is known.
    assert set(solvable.sum(axis=0)) <= {4, 8}
    distance = np.where(solvable, apart(solved, q[:, None]), np.inf).min(axis=0)
    # Close to a singular posture rounding grows as the inverse of the smallest singular value.
    assert (distance * singular_values(jacobian(ARM, q)[:, :6])[-1] < 1e-9).all()


def test_all_that_a_search_finds_is_among_the_branches() -> None:
    q = postures(5, 10)
    goal = tip(ARM, q)
    for k in range(q.shape[1]):
        branches = closed_form(ARM, goal[:, k], q[6, k])
        for seed in range(6):
            searched = ik(ARM, goal[:, k], restarts=5, tolerance=(1e-11, 1e-11), rng=seed)
            if not searched.success:
                continue
            # The search chooses a last joint of its own: the closed form must know that posture.
            answers = closed_form(ARM, goal[:, k], searched.q[6])
            assert np.nanmin(apart(answers, searched.q[:, None])) < 1e-5
        assert np.nanmin(apart(branches, q[:, k, None])) < 1e-6


def test_a_branch_moves_in_the_null_space() -> None:
    q, h = postures(11, 40), 1e-5
    goal = tip(ARM, q)
    before, here, after = (closed_form(ARM, goal, q[6] + step) for step in (-h, 0.0, h))
    slope = np.angle(np.exp(1j * (after - before))) / (2.0 * h)
    ok = np.isfinite(slope).all(axis=0) & (np.abs(slope).max(axis=0) < 50.0)
    J = jacobian(ARM, here[:, ok])
    drift = np.einsum("ijn,jn->in", J, slope[:, ok])
    assert ok.sum() > 100 and np.abs(slope[:, ok]).max() > 1.0
    assert np.abs(drift).max() < 1e-4


def edge(goal: np.ndarray, branch: int, inside: float, outside: float) -> float:
    """Return the last joint angle at which a branch ends, by halving."""
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        good = np.isfinite(closed_form(ARM, goal, middle)[0, branch])
        inside, outside = (middle, outside) if good else (inside, middle)
    return inside


@pytest.mark.prove
def test_a_branch_ends_where_the_other_six_joints_are_singular() -> None:
    ends, angles = 0, np.linspace(-np.pi, np.pi, 400)
    for q in postures(3, 12).T:
        goal = tip(ARM, q)
        solvable = np.isfinite(closed_form(ARM, np.tile(goal[:, None], 400), angles)[0])
        for branch in range(BRANCHES):
            for k in np.flatnonzero(solvable[branch, :-1] != solvable[branch, 1:])[:2]:
                pair = angles[k], angles[k + 1]
                inside, outside = pair if solvable[branch, k] else pair[::-1]
                limit = edge(goal, branch, inside, outside)
                toward = np.sign(inside - outside)
                smallest = [
                    singular_values(
                        jacobian(ARM, closed_form(ARM, goal, limit + toward * away)[:, branch])[
                            :, :6
                        ]
                    )[-1]
                    for away in (1e-6, 1e-8)
                ]
                # Two solutions of a square root meet: the singular value goes with the root.
                assert smallest[0] < 1e-2
                assert smallest[1] / smallest[0] == pytest.approx(0.1, rel=0.2)
                # On the other side of the limit there is no solution.
                assert np.isnan(closed_form(ARM, goal, limit - toward * 1e-6)[0, branch])
                ends += 1
    assert ends > 20


def test_postures_within_the_limits_include_the_one_it_came_from() -> None:
    for q in postures(23, 200).T:
        goal = tip(ARM, q)
        solved = postures_within_limits(ARM, goal, q[6])
        assert (solved >= ARM.lower[:, None]).all() and (solved <= ARM.upper[:, None]).all()
        # As numbers, not modulo a turn: joint 6 may pass half a turn.
        assert np.abs(solved - q[:, None]).max(axis=0).min() < 1e-5
        assert (
            np.abs(pose_error(np.tile(goal[:, None], solved.shape[1]), tip(ARM, solved))).max()
            < 1e-9
        )
    assert (postures(23, 200)[5] > np.pi).any()


def test_out_of_reach_there_is_no_branch() -> None:
    goal = tip(ARM, np.zeros(7) + 0.3)
    goal[:3] = 0.0, 0.0, 3.0
    assert np.isnan(closed_form(ARM, goal, np.linspace(-3.0, 3.0, 50))).all()


def test_the_elbow_turns_about_the_line_by_the_swivel_angle() -> None:
    q = postures(17, 30)
    goal = tip(ARM, q)
    turned = closed_form(ARM, goal, q[6])
    joints = frames(ARM, q)
    line = joints[:3, 5] - np.array([0.0, 0.0, 0.333])[:, None]
    line /= np.linalg.norm(line, axis=0)
    for k in range(30):
        centre = np.array([0.0, 0.0, 0.333])
        first = joints[:3, 3, k] - centre
        for branch in np.flatnonzero(np.isfinite(turned[0, :, k])):
            other = frames(ARM, turned[:, branch, k])[:3, 3] - centre
            # The last joint is the same, so the wrist is, and the elbow is on a circle: where both
            # bend alike, Rodrigues' formula takes one elbow to the other.
            if abs(np.angle(np.exp(1j * (turned[3, branch, k] - q[3, k])))) > 1e-6:
                continue
            angle = swivel_angle(ARM, turned[:, branch, k]) - swivel_angle(ARM, q[:, k])
            axis = line[:, k]
            expected = (
                first * np.cos(angle)
                + np.cross(axis, first) * np.sin(angle)
                + axis * (axis @ first) * (1.0 - np.cos(angle))
            )
            assert np.abs(expected - other).max() < 1e-7


def test_the_swivel_angle_is_zero_with_the_elbow_up() -> None:
    # With q1 = q3 = 0 the arm is in the vertical plane through x.
    up = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.5, 0.3])
    assert swivel_angle(ARM, up) == pytest.approx(0.0, abs=1e-9)
    assert swivel_angle(ARM, np.stack([up, up], axis=1)).shape == (2,)


def test_shapes() -> None:
    q = postures(1, 3)
    goal = tip(ARM, q)
    assert closed_form(ARM, goal[:, 0], 0.1).shape == (7, 8)
    assert closed_form(ARM, goal[:, 0], [0.1, 0.2]).shape == (7, 8, 2)
    assert closed_form(ARM, goal, 0.1).shape == (7, 8, 3)
    alone = [closed_form(ARM, goal[:, k], q[6, k]) for k in range(3)]
    np.testing.assert_allclose(
        closed_form(ARM, goal, q[6]), np.stack(alone, axis=2), rtol=0, atol=1e-12
    )


def test_wrong_input_is_refused() -> None:
    goal = tip(ARM, np.full(7, 0.3))
    for chain in (planar([1.0, 0.8]), random_chain(7, np.random.default_rng(0))):
        with pytest.raises(ValueError, match=re.escape("7-R arm with the layout of `panda()`")):
            closed_form(chain, goal, 0.0)
    with pytest.raises(ValueError, match="last"):
        closed_form(ARM, goal, np.nan)
    with pytest.raises(ValueError, match=re.escape("target.shape")):
        closed_form(ARM, goal[:3], 0.0)
    with pytest.raises(ValueError, match=re.escape("target[3:]")):
        closed_form(ARM, 2.0 * goal, 0.0)
