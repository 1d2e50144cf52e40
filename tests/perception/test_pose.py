"""The chain: right poses are found, wrong ones do not pass, and the covariance is what happens."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.perception.camera import Sensor, render, sense, shape, together
from course.perception.pose import STANDING, _extent, locate, pose_distance, see_through, stand_in
from course.perception.registration import DIRECTIONS
from course.rigid_body.quaternion import exp, to_matrix
from tests.budget import examples
from tests.perception.part_images import (
    BOX,
    CAMERA,
    CYLINDER,
    SENSOR,
    SPHERE,
    TABLE,
    error,
    on_table,
)

HEIGHT = {"box": 0.03, "cylinder": 0.05, "sphere": 0.04}
SMALL = shape("box", 0.03, 0.02, 0.02)


def picture(shapes, rng, sensor=SENSOR):
    return sense(render(shapes, CAMERA)[0], CAMERA, sensor, rng)


def turned(pose, *rotvec):
    moved = shape("sphere", 1.0, pose=(0, 0, 0, *exp(np.array(rotvec)))).moved(pose)
    return moved.poses[:, 0]


@pytest.mark.prove
@pytest.mark.parametrize(
    "part", [BOX, CYLINDER, SPHERE, SMALL], ids=["box", "can", "ball", "small"]
)
def test_parts_are_found_and_the_covariance_holds(part):
    rng = np.random.default_rng(1)
    squares, number = 0.0, 0
    for _ in range(25):
        height = 0.02 if part is SMALL else HEIGHT[part.kinds[0]]
        at = (*rng.uniform(-0.15, 0.15, 2) * (1.0, 0.6), height, rng.uniform(-3.0, 3.0))
        shapes, (pose,) = on_table([(part, *at)])
        (result,) = locate(picture(shapes, rng), CAMERA, SENSOR, part)
        assert result.status == "found" and not {"x", "y"} & set(result.unobserved)
        assert result.see_through < 0.05 and result.agrees > 0.9
        observed = np.isfinite(np.diag(result.covariance))
        shift, angle = pose_distance(part, pose, result.pose)
        assert shift < 3e-3 and angle < np.radians(2.0)
        # In the frame of the found one, so that a symmetric answer counts as the same.
        near = [turned(pose, 0, 0, k * np.pi / 2) for k in range(4)]
        truth = min(near, key=lambda p: np.abs(error(result.R, result.p, p)[3:]).max())
        if part is not CYLINDER and part is not SPHERE:
            e = error(result.R, result.p, truth)[observed]
            squares += e @ np.linalg.solve(result.covariance[np.ix_(observed, observed)], e)
            number += observed.sum()
    assert not number or 0.4 < squares / number < 1.5


@pytest.mark.slow
def test_anyhow_in_space():
    rng = np.random.default_rng(2)
    for k in range(4):
        shapes, (pose,) = on_table([(BOX, 0.0, 0.0, 0.09, 0.4 + k)], roll=0.3)
        (result, *_) = locate(picture(shapes, rng), CAMERA, SENSOR, BOX, standing=False)
        shift, angle = pose_distance(BOX, pose, result.pose)
        assert result.status == "found"  # at the last only the outline tells x
        assert shift < 1e-3 and angle < np.radians(0.5)


def test_see_through_refutes_what_a_residual_does_not():
    rng = np.random.default_rng(3)
    for yaw in rng.uniform(-3.0, 3.0, 10):
        shapes, (pose,) = on_table([(BOX, 0.0, 0.0, 0.03, yaw)])
        depth = picture(shapes, rng)
        wrong = turned(pose, 0.0, 0.0, 0.5 * np.pi)
        assert see_through(depth, CAMERA, SENSOR, BOX.moved(pose)) < 0.012
        assert see_through(depth, CAMERA, SENSOR, BOX.moved(wrong)) > 0.26
        away = shape("sphere", 0.01, pose=(0, 0, -1.0, 1, 0, 0, 0))
        assert see_through(depth, CAMERA, SENSOR, away) == 1.0


def test_half_out_of_the_picture_is_not_found():
    """Every point matched, the residual of a right pose, and up to 90 degrees off: it says cut."""
    rng = np.random.default_rng(4)
    worst = 0.0
    for yaw in (0.4, 1.2, 2.0, 2.8):
        shapes, (pose,) = on_table([(BOX, 0.45, 0.0, 0.03, yaw)])
        for result in locate(picture(shapes, rng), CAMERA, SENSOR, BOX):
            assert result.status in ("cut", "refuted") and result.matched > 0.95
            assert result.residual < 1.5e-3
            worst = max(worst, pose_distance(BOX, pose, result.pose)[0])
    assert worst > 0.02


@pytest.mark.parametrize("starts", [1, 4])
def test_a_nearly_square_box_is_not_found_a_quarter_turn_off(starts):
    """The residual of the turned one is as good: with few starts it was found, half of the time."""
    rng = np.random.default_rng(9)
    statuses = set()
    for side in (0.0499, 0.0499, 0.0475, 0.046):
        part = shape("box", 0.05, side, 0.03)
        shapes, (pose,) = on_table([(part, 0.0, 0.0, 0.03, rng.uniform(-3.0, 3.0))])
        (result,) = locate(picture(shapes, rng), CAMERA, SENSOR, part, starts=starts)
        right = pose_distance(part, pose, result.pose)[1] < np.radians(2.0)
        assert result.status == "ambiguous" or (result.status == "found" and right)
        statuses.add(result.status)
    assert statuses == {"found", "ambiguous"}


def test_another_part_is_refuted_and_a_table_is_empty():
    rng = np.random.default_rng(5)
    cube = shape("box", 0.03, 0.03, 0.03)
    shapes, (pose, _) = on_table([(BOX, -0.12, 0.0, 0.03, 1.2), (cube, 0.15, 0.0, 0.03, 0.3)])
    first, second = locate(picture(shapes, rng), CAMERA, SENSOR, BOX)
    assert first.status == "found" and pose_distance(BOX, pose, first.pose)[0] < 1e-3
    assert second.status == "refuted" and second.see_through > 0.3
    assert locate(picture(on_table([])[0], rng), CAMERA, SENSOR, BOX) == []


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_neighbour_that_touches_is_shut_out(side):
    """The ends of the box show no face, but their outline tells x, whatever touches its side."""
    rng = np.random.default_rng(6)
    cube = shape("box", 0.03, 0.03, 0.05)
    shapes, (pose, _) = on_table([(BOX, 0.0, 0.0, 0.03, 0.0), (cube, 0.0, 0.081 * side, 0.05, 0.0)])
    result = locate(picture(shapes, rng), CAMERA, SENSOR, BOX)[0]
    e, C = error(result.R, result.p, pose), result.covariance
    observed = np.isfinite(np.diag(C))
    assert result.status in ("found", "ambiguous") and result.unobserved == () and observed.all()
    assert np.all(np.abs(e[observed]) < 5.0 * np.sqrt(np.diag(C)[observed]) + 1e-4)


@pytest.mark.parametrize("other", [BOX, shape("box", 0.12, 0.075, 0.03)], ids=["twin", "larger"])
def test_a_part_within_a_block_is_not_found(other):
    """Nothing is looked through and all of the pose agrees; what it leaves over tells."""
    rng, worst = np.random.default_rng(10), 0.0
    for yaw in rng.uniform(-3.0, 3.0, 6):
        twin = (BOX, 0.1 * np.sin(yaw), -0.1 * np.cos(yaw), 0.03, yaw)
        far_end = [twin, (other, 0.0, 0.0, 0.03, yaw)] if other is BOX else [(other, *twin[1:])]
        shapes, poses = on_table(far_end)
        for result in locate(picture(shapes, rng), CAMERA, SENSOR, BOX):
            assert result.status in ("ambiguous", "refuted") and result.agrees < 0.9
            worst = max(
                worst, min(pose_distance(BOX, p, result.pose)[0] for p in poses) * result.agrees
            )
    assert worst > 5e-3


def test_a_wrong_scale_is_seen_by_no_test_inside():
    rng = np.random.default_rng(7)
    shapes, (pose,) = on_table([(BOX, 0.0, 0.0, 0.03, 0.6)])
    (result,) = locate(1.01 * picture(shapes, rng), CAMERA, SENSOR, BOX)
    assert result.status == "found" and result.see_through < 0.012
    assert pose_distance(BOX, pose, result.pose)[0] > 5e-3 > 50.0 * np.sqrt(result.covariance[0, 0])


def test_a_scale_that_moves_the_outline_by_pixels_is_not_found():
    """Faces say how far the part is, the outline how large it looks: at 3 % they disagree."""
    rng = np.random.default_rng(7)
    for yaw in (0.6, 1.4, 2.5):
        shapes, _ = on_table([(BOX, 0.0, 0.0, 0.03, yaw)])
        for scale in (0.97, 1.03):
            (result,) = locate(scale * picture(shapes, rng), CAMERA, SENSOR, BOX)
            assert result.status in ("ambiguous", "refuted")


def test_the_normal_of_the_table_may_point_either_way():
    rng = np.random.default_rng(12)
    shapes, (pose,) = on_table([(BOX, 0.0, 0.0, 0.03, 0.6)])
    depth = picture(shapes, rng)
    up = to_matrix(TABLE[3:])[:, 2]
    plane = np.append(up, -up @ TABLE[:3])
    one, other = (locate(depth, CAMERA, SENSOR, BOX, table=s * plane) for s in (1.0, -1.0))
    assert (
        max(pose_distance(BOX, one[0].pose, other[0].pose)) < 1e-12 and len(one) == len(other) == 1
    )
    assert pose_distance(BOX, pose, one[0].pose)[0] < 1e-3


def test_pixels_without_a_measurement_may_be_nan_or_infinite():
    """As in the depth images of ROS (REP 118)."""
    rng = np.random.default_rng(13)
    shapes, _ = on_table([(BOX, 0.0, 0.0, 0.03, 0.6)])
    depth = picture(shapes, rng)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    marked = np.where(depth > 0.0, depth, rng.choice([np.nan, np.inf, -np.inf], depth.shape))
    one, other = (locate(z, CAMERA, SENSOR, BOX)[0] for z in (depth, marked))
    assert np.array_equal(one.pose, other.pose) and one.status == "found"


@given(st.integers(0, 2**32 - 1), st.sampled_from([BOX, CYLINDER, SPHERE, shape("box", 1, 1, 2)]))
@examples(20)
def test_symmetric_poses_are_no_distance_apart(seed, part):
    rng = np.random.default_rng(seed)
    pose = np.concatenate((rng.standard_normal(3), exp(rng.standard_normal(3))))
    same = {"box": (0, 0, np.pi), "cylinder": (0, 0, 0.7), "sphere": (1, 2, 0.3)}[part.kinds[0]]
    assert pose_distance(part, pose, turned(pose, *same))[1] < 1e-7
    assert pose_distance(part, pose, turned(pose, np.pi, 0.0, 0.0))[1] < 1e-7
    quarter = pose_distance(part, pose, turned(pose, 0, 0, 0.5 * np.pi))[1]
    assert abs(quarter - (0.5 * np.pi if part is BOX else 0.0)) < 1e-7
    tilt = pose_distance(part, pose, turned(pose, 0.2, 0, 0))[1]
    assert abs(tilt - (0.0 if part is SPHERE else 0.2)) < 1e-7
    several = together([part, part])
    assert abs(pose_distance(several, pose, turned(pose, 0, 0, 3.0))[1] - 3.0) < 1e-7


@pytest.mark.prove
@pytest.mark.parametrize("window", [1, 3])
def test_the_stand_in_is_the_chain(window):
    """Spread of the whole chain over its prediction from one exact picture, without noise."""
    rng = np.random.default_rng(8)
    sensor = Sensor(baseline=0.075, noise=0.05, window=window)
    shapes, (pose,) = on_table([(BOX, 0.0, 0.0, 0.03, 0.6)])
    bias, C = stand_in(CAMERA, sensor, BOX, pose[:, None])
    assert np.abs(bias).max() < 1e-6
    errors = []
    for _ in range(30):
        (result,) = locate(picture(shapes, rng, sensor), CAMERA, sensor, BOX)
        truth = min(
            (pose, turned(pose, 0, 0, np.pi)), key=lambda p: error(result.R, result.p, p)[5] ** 2
        )
        errors.append(error(result.R, result.p, truth))
    moving = [DIRECTIONS.index(name) for name in STANDING]
    flip = np.abs(errors)[:, moving]
    ratio = np.sqrt(np.mean(flip**2, axis=0) / np.diag(C[:, :, 0])[moving])
    assert 0.6 < ratio.min() and ratio.max() < 1.4


def test_a_coarse_step_is_a_bias_that_noise_cures():
    _, (pose,) = on_table([(BOX, 0.0, 0.0, 0.03, 0.6)])
    moved = []
    for noise in (0.0, 0.1, 0.4):
        sensor = Sensor(baseline=0.075, noise=noise, step=0.5)
        bias, _ = stand_in(CAMERA, sensor, BOX, pose[:, None], standing=False)
        moved.append(np.abs(bias[:3]).max())
    assert moved[0] > 1e-4 and moved[1] < 0.6 * moved[0] and moved[2] < 1e-5 * moved[0]
    behind = pose * np.array([1, 1, -1, 1, 1, 1, 1])
    _, C = stand_in(CAMERA, SENSOR, BOX, behind[:, None])
    assert np.isinf(np.diag(C[:, :, 0])[[0, 1, 5]]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"depth": np.ones((3, 3))}, "shape"),
        ({"depth": np.full((240, 320), 800.0)}, "millimetres"),
        ({"depth": np.zeros((240, 320))}, "at least one measurement"),
        ({"depth": np.full((240, 320), -1.0)}, "depth"),
        ({"part": shape("plane")}, "no plane"),
        ({"table": (0.0, 0.0, 2.0, 1.0)}, "unit length"),
        ({"starts": 0}, "starts"),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"depth": np.ones((240, 320)), "camera": CAMERA, "sensor": SENSOR, "part": BOX}
    with pytest.raises(ValueError, match=words):
        locate(**(given | change))


@given(st.sampled_from(["box", "cylinder", "sphere"]), st.integers(0, 2**32 - 1))
@examples(30)
def test_the_extent_of_a_turned_shape_is_that_of_its_surface(kind, seed):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.01, 0.1, {"box": 3, "cylinder": 2, "sphere": 1}[kind])
    place, turn = rng.uniform(-0.1, 0.1, 3), exp(rng.uniform(-2.0, 2.0, 3))
    # Points of the surface, densely: corners, both rims, or the directions of a grid.
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    if kind == "box":
        points = np.array(np.meshgrid(*[(-a, a) for a in size])).reshape(3, -1)
    elif kind == "cylinder":
        rim = size[0] * np.array([np.cos(angle), np.sin(angle)])
        points = np.hstack([np.vstack((rim, np.full(721, z))) for z in (-size[1], size[1])])
    else:
        up, around = np.meshgrid(np.linspace(0.0, np.pi, 181), angle)
        points = size[0] * np.array(
            [np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)]
        ).reshape(3, -1)
    world = to_matrix(turn) @ points + place[:, None]
    low, high = _extent(shape(kind, *size, pose=np.concatenate((place, turn))))
    assert low == pytest.approx(world.min(axis=1), abs=2e-4 * size.max())
    assert high == pytest.approx(world.max(axis=1), abs=2e-4 * size.max())
