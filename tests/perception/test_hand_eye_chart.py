"""Hand-eye calibration next to OpenCV's: the same poses, the same answer, the predicted errors."""

import numpy as np
import pytest

from course import charts
from course.charts.perception import hand_eye as chart
from course.kinematics.chain import compose
from course.oracles import opencv
from tests import optional

WIDE, EXACT = (0.4, 0.4, 0.4), (0.0, 0.0)


def opencv_of(poses: chart.Poses) -> opencv.HandEye:
    """OpenCV's calibration of these poses, or a skipped test."""
    try:
        return opencv.HandEye(*poses)
    except ImportError as error:
        optional.skip(f"hand-eye calibration was NOT compared with OpenCV: {error}")


@pytest.mark.parametrize(("count", "partners", "expected"), [(4, 4, 6), (12, 4, 48), (12, 0, 66)])
def test_the_motions_fulfil_the_equation(count, partners, expected):
    A, B = chart.motions(*chart.observed(count, WIDE, np.random.default_rng(0), EXACT), partners)
    assert A.shape == B.shape == (7, expected)
    mount = np.tile(chart.MOUNT[:, None], expected)
    left, right = compose(A, mount), compose(mount, B)
    assert np.abs(left[:3] - right[:3]).max() < 1e-14
    assert np.abs(np.abs(np.sum(left[3:] * right[3:], axis=0)) - 1.0).max() < 1e-14


@pytest.mark.optional
@pytest.mark.parametrize("noise", [EXACT, (chart.TURN_NOISE, chart.SHIFT_NOISE)])
def test_all_pairs_have_the_answer_of_opencvs_park(noise):
    for seed in range(10):
        poses = chart.observed(8, WIDE, np.random.default_rng(seed), noise)
        ours = chart.pose_of(chart.solve(*poses, 0))
        theirs = chart.pose_of(opencv_of(poses).solve("PARK"))
        for mine, other in zip(ours, theirs, strict=True):
            assert np.abs(mine - other).max() < 1e-12


@pytest.mark.optional
@pytest.mark.parametrize("method", opencv.METHODS)
def test_every_method_of_opencv_finds_an_exact_mount(method):
    poses = chart.observed(8, WIDE, np.random.default_rng(1), EXACT)
    assert chart.point_error(*chart.pose_of(opencv_of(poses).solve(method))) < 1e-9


@pytest.mark.prove
@pytest.mark.parametrize("partners", chart.PARTNERS.values())
def test_the_noise_of_the_turns_predicts_the_error_of_the_rotation(partners):
    for turns in ((0.1, 0.1, 0.1), (0.4, 0.03, 0.03)):
        squares = [
            chart.turn_error(
                chart.pose_of(
                    chart.solve(*chart.observed(30, turns, np.random.default_rng(seed)), partners)
                )[0]
            )
            ** 2
            for seed in range(150)
        ]
        ratio = np.sqrt(np.mean(squares)) / chart.expected_turn_error(30, turns, partners)
        assert 0.85 < ratio < 1.2


def test_the_course_reports_that_one_axis_is_missing():
    work, limit = charts.build(
        "hand_eye_precision", counts=(4, 30), sizes=(1e-4, 0.1), seeds=12, repeats=1, library=False
    )
    for name in chart.PARTNERS:
        error_of_few, error_of_many = work[name].y
        assert error_of_many < 0.5 * error_of_few
    near, clear = limit["all pairs"].y
    expected = limit["all pairs"].expected
    # Below the limit the noise takes the place of the missing axis.
    assert near > 0.3 and clear < 2.0 * expected[1]
    assert limit.lines[0][1] == 0.1 and "0.0001 rad 0%, 0.1 rad 100%" in limit.notes[0]


@pytest.mark.optional
@pytest.mark.slow
def test_the_chart_compares_all_methods_of_opencv():
    poses = chart.observed(4, WIDE, np.random.default_rng(0))
    opencv_of(poses)  # skips without it
    work, limit = charts.build(
        "hand_eye_precision", counts=(4, 30), sizes=(1e-4, 0.1), seeds=12, repeats=1
    )
    assert len(work.series) == len(chart.PARTNERS) + len(opencv.METHODS)
    assert np.allclose(work["all pairs"].y, work["OpenCV PARK"].y, rtol=1e-6)
    assert limit["OpenCV PARK"].y[-1] == pytest.approx(limit["all pairs"].y[-1], rel=1e-6)


def test_an_opencv_without_the_function_is_named(monkeypatch):
    import sys
    from types import ModuleType

    fake = ModuleType("cv2")
    fake.__version__ = "5.0.0"  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "cv2", fake)
    with pytest.raises(ImportError, match=r"OpenCV 5.0.0 has no calibrateHandEye: pip install"):
        opencv.library()
