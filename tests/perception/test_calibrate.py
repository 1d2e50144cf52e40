"""Calibration: the error it predicts is what happens; hand-eye and its rank."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.kinematics.chain import compose, invert
from course.perception.calibrate import camera_to_base, hand_eye, target_error
from course.perception.camera import shape
from course.perception.pose import pose_distance
from course.rigid_body.quaternion import exp, from_matrix, to_matrix
from tests.budget import examples

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, 8, 30])
def test_the_error_at_a_target_is_as_predicted(count):
    """1,000 fits: within four standard errors of their root mean square, near and far."""
    rng = np.random.default_rng(count)
    points = rng.uniform(-1.0, 1.0, (3, count)) * np.array([[0.3], [0.2], [0.05]])
    places = np.array([[0.0, 0.2, 0.6], [0.0, -0.1, 0.5], [0.0, 0.3, 0.1]])
    sigma, runs = 1e-4, 1000
    R, p = to_matrix(exp(np.array([0.4, -2.0, 0.3]))), np.array([0.1, 0.2, 1.0])
    squares, report = np.zeros(3), np.zeros(runs)
    for k in range(runs):
        observed = R.T @ (points - p[:, None]) + sigma * rng.standard_normal(points.shape)
        result = camera_to_base(observed, points)
        report[k] = result.sigma**2
        deviation = result.R @ (R.T @ (places - p[:, None])) + result.p[:, None] - places
        squares += np.sum(deviation**2, axis=0) / runs
    ratio = np.sqrt(squares) / target_error(points, places, sigma)
    assert np.abs(ratio - 1.0).max() < 4.0 / np.sqrt(2.0 * 2.0 * runs)
    assert abs(report.mean() / sigma**2 - 1.0) < 4.0 * np.sqrt(2.0 / (3 * count - 6) / runs)
    assert np.allclose(result.error_at(places), target_error(points, places, result.sigma))


def motions(rng, X, count, size, planar=False, noise=0.0):
    """Motions of a hand, and of the camera that it carries, with errors of the turns [rad]."""
    turns = size * rng.standard_normal((3, count))
    turns[:2] *= not planar
    shifts = 0.2 * rng.standard_normal((3, count))
    shifts[2] *= not planar
    A = np.concatenate((shifts, exp(turns)))
    by = np.tile(X[:, None], count)
    B = compose(compose(invert(by), A), by)
    B[3:] = compose(B, np.concatenate((0 * shifts, exp(noise * rng.standard_normal((3, count))))))[
        3:
    ]
    return A, B


@given(SEEDS, st.floats(0.05, 1.0))
@examples(25)
def test_hand_eye_is_exact_with_two_axes(seed, size):
    rng = np.random.default_rng(seed)
    X = np.concatenate((0.1 * rng.standard_normal(3), exp(rng.standard_normal(3))))
    result = hand_eye(*motions(rng, X, 8, size))
    shift, _ = pose_distance(shape("box", 1.0, 2.0, 3.0), X, result.pose)
    assert (
        shift < 1e-11 / size
        and np.linalg.norm(to_matrix(X[3:]) - to_matrix(result.pose[3:])) < 1e-11
    )
    assert result.rank == 3


@given(SEEDS)
@examples(15)
def test_a_planar_arm_has_rank_two_however_many_motions(seed):
    """Any X that is turned about, and shifted along, the common axis explains pure turns too."""
    rng = np.random.default_rng(seed)
    X = np.concatenate((0.1 * rng.standard_normal(3), exp(rng.standard_normal(3))))
    for count in (3, 30):
        for noise in (0.0, 1e-3):
            assert hand_eye(*motions(rng, X, count, 0.7, True, noise)).rank == 2
    A, B = motions(rng, X, 10, 0.7, True)
    other = np.concatenate(((0.0, 0.0, 0.3), exp(np.array([0.0, 0.0, 0.5]))))
    Y = compose(np.tile(other[:, None], 10), np.tile(X[:, None], 10))
    # It commutes with the turns of A about the axis, and the pure turns among them fit it.
    A[:3] = 0.0
    B = compose(compose(invert(np.tile(X[:, None], 10)), A), np.tile(X[:, None], 10))
    left, right = compose(A, Y), compose(Y, B)
    assert np.abs(left[:3] - right[:3]).max() < 1e-12
    assert np.abs(np.abs(np.sum(left[3:] * right[3:], axis=0)) - 1.0).max() < 1e-12


def test_small_turns_cost_accuracy():
    """The error of the rotation falls as one over the size of the turns."""
    rng = np.random.default_rng(3)
    X = np.concatenate(((0.05, 0.0, 0.1), exp(np.array([0.3, 0.2, -0.5]))))
    errors = []
    for size in (0.05, 0.5):
        deviation = []
        for _ in range(60):
            A, B = motions(rng, X, 10, size, noise=1e-3)
            deviation.append(hand_eye(A, B, tolerance=1e-6).pose)
        errors.append(
            np.sqrt(
                np.mean([pose_distance(shape("box", 1, 2, 3), X, x)[1] ** 2 for x in deviation])
            )
        )
    assert 6.0 < errors[0] / errors[1] < 16.0


LINE = np.array([[0.0, 1.0, 2.0, 5.0]] * 3)
STAY = np.zeros((7, 3)) + np.array([0, 0, 0, 1, 0, 0, 0])[:, None]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: target_error(LINE, LINE, 1.0), "off one line"),
        (lambda: target_error(np.eye(3)[:, :2], LINE, 1.0), "three points"),
        (lambda: target_error(np.eye(3), LINE, -1.0), "sigma"),
        (lambda: camera_to_base(np.eye(3), LINE), "target|source"),
        (lambda: camera_to_base(LINE, LINE), "off one line"),
        (lambda: hand_eye(STAY, STAY), "that turn"),
        (lambda: hand_eye(STAY[:, :1], STAY[:, :1]), "two motions"),
        (lambda: hand_eye(2.0 * STAY, STAY), "length of 1"),
        (lambda: from_matrix(hand_eye(STAY * np.nan, STAY).pose), "A"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
