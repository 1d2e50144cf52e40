"""The outline: where the model's contour lies, which border pixels count, and what they tell."""

import numpy as np
import pytest

from course.kinematics.chain import compose
from course.perception import STEREO, locate, pose_distance, render, sense, shape, together
from course.perception.outline import border, contour, rows
from course.rigid_body.quaternion import conjugate, exp, log, product, rotate
from tests.perception.part_images import BOX, CAMERA, CYLINDER, SENSOR, SPHERE

LARGE = type(CAMERA).symmetric(960, 720, 1.0)
SEVERAL = together([BOX, shape("cylinder", 0.03, 0.06, pose=(0, 0, 0.09, 1, 0, 0, 0))])


def from_above(part, truth, rng, tilt=0.0, sensor=SENSOR, camera=CAMERA, more=()):
    """A part on a table that the camera looks down on, at random: image, pose and ids."""
    table = np.concatenate(((0.0, 0.0, 0.8), exp(np.array([np.pi - tilt, 0.0, 0.0]))))
    height = truth.sizes[{"box": 2, "cylinder": 1, "sphere": 0}[truth.kinds[0]], 0]
    place = (*rng.uniform(-0.1, 0.1, 2), height, *exp(np.array([0.0, 0.0, rng.uniform(-3, 3)])))
    pose = compose(table[:, None], np.array(place)[:, None])[:, 0]
    exact, ids = render(together([shape("plane").moved(table), truth.moved(pose), *more]), camera)
    return sense(exact, camera, sensor, rng), pose, ids


def six(result, pose):
    """Error in the six directions, of the pose or of its half turn about z, whichever is nearer."""
    errors = []
    for q in (pose[3:], product(pose[3:], np.array([0.0, 0.0, 0.0, 1.0]))):
        turned = log(product(conjugate(q), result.pose[3:]))
        errors.append(np.append(rotate(conjugate(q), result.p - pose[:3]), turned))
    return min(errors, key=lambda e: np.abs(e[3:]).max())


@pytest.mark.prove
@pytest.mark.parametrize("part", [BOX, CYLINDER, SPHERE, SEVERAL], ids="box can ball both".split())
def test_the_contour_lies_between_the_pixels_of_a_rendered_border(part):
    """Independent of it: rays that meet the part, and their neighbours that don't."""
    rng = np.random.default_rng(0)
    for _ in range(6):
        q = rng.standard_normal(4)
        pose = np.array([*rng.uniform(-0.1, 0.1, 2), 0.6, *q / np.linalg.norm(q)])
        inside = render(part.moved(pose), LARGE)[0] > 0.0
        v, u = np.nonzero(inside[:, :-1] != inside[:, 1:])
        middle = np.stack(
            ((u + 0.5 - LARGE.cx) / LARGE.fx, (v - LARGE.cy) / LARGE.fy, np.ones(u.size)),
            dtype=float,
        )
        c, n, distance = contour(part.moved(pose), middle)
        good = np.isfinite(distance)
        assert good.mean() > 0.97 and LARGE.fx * distance[good].max() < 0.52
        assert np.abs(np.sum(n * c, axis=0)).max() < 1e-12  # perpendicular to the line of sight
        assert np.allclose(np.linalg.norm(n[:, good], axis=0), 1.0)
        # Outward: of a pair the pixel of the part is on the inner side.
        sign = np.where(inside[v, u], -1.0, 1.0)
        steep = good & (np.abs(n[0]) > 0.5)
        assert np.all(sign[steep] * n[0, steep] < 0.0)


@pytest.mark.parametrize("part", [BOX, CYLINDER, SPHERE], ids="box can ball".split())
def test_the_rows_are_the_derivatives_of_the_residuals(part):
    rng = np.random.default_rng(1)
    depth, pose, ids = from_above(part, part, rng, 0.5)
    at = border(depth, CAMERA, SENSOR, ids == 1)
    here = rows(part, pose, CAMERA, SENSOR, at, 1.0)
    assert here.pixel.size > 40
    for k, h in enumerate((1e-6,) * 3 + (1e-5,) * 3):
        moved = []
        for s in (h, -h):
            step = np.zeros(6)
            step[k] = s
            q = product(pose[3:], exp(step[3:]))
            turned = np.append(pose[:3] + rotate(pose[3:], step[:3]), q)
            moved.append(rows(part, turned, CAMERA, SENSOR, at, 1.0).residual)
        if moved[0].size == moved[1].size == here.residual.size:
            slope = (moved[0] - moved[1]) / (2.0 * h)
            # To first order in the residual; at a corner a border may change its edge.
            assert np.mean(np.abs(slope + here.J[k]) < 1e-2 * (1.0 + np.abs(slope))) > 0.95


def test_only_a_border_that_hides_something_counts():
    """Not the foot, where depth goes on, and not where a nearer part cuts it off."""
    rng = np.random.default_rng(2)
    bar = shape("box", 0.3, 0.01, 0.01, pose=(0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0))
    for _ in range(5):
        depth, pose, ids = from_above(BOX, BOX, rng, 0.6, more=(bar,))
        at = border(depth, CAMERA, SENSOR, (ids == 1) & (depth > 0.0))
        assert np.all(at.far > at.near)
        u = CAMERA.cx + CAMERA.fx * at.rays[0]
        v = CAMERA.cy + CAMERA.fy * at.rays[1]
        for s in (-0.5, 0.5):
            x = np.where(at.along == 0, u + s, u).round().astype(int)
            y = np.where(at.along == 1, v + s, v).round().astype(int)
            assert not np.any(ids[y, x] == 2)
        used = rows(BOX, pose, CAMERA, SENSOR, at, 1.5)
        assert used.pixel.size > 20 and np.abs(used.residual / used.pixel).max() < 0.75


@pytest.mark.prove
@pytest.mark.parametrize("sensor", [SENSOR, STEREO], ids=["white", "stereo"])
@pytest.mark.parametrize("tilt", [0.0, 0.6], ids=["above", "oblique"])
def test_a_lone_part_is_found_from_above_with_an_honest_covariance(tilt, sensor):
    """From above the faces tell neither x nor y nor the turn: without the outline none is found."""
    rng = np.random.default_rng(3)
    squares, hits = [], 0
    for _ in range(30):
        depth, pose, _ = from_above(BOX, BOX, rng, tilt, sensor)
        (result,) = locate(depth, CAMERA, sensor, BOX)
        hits += result.status == "found"
        assert result.unobserved == () and pose_distance(BOX, pose, result.pose)[0] < 1e-3
        e, some = six(result, pose), [0, 1, 5]
        C = result.covariance[np.ix_(some, some)]
        squares.append(e[some] @ np.linalg.solve(C, e[some]) / 3.0)
    assert hits >= 28
    assert 0.2 < np.mean(squares) < 1.5 and max(squares) < 8.0


@pytest.mark.slow
@pytest.mark.parametrize(("part", "free"), [(CYLINDER, ("turn z",)), (SPHERE, ())])
def test_a_round_part_is_found_from_above_and_its_turn_stays_unknown(part, free):
    rng = np.random.default_rng(4)
    for _ in range(8):
        depth, pose, _ = from_above(part, part, rng)
        (result,) = locate(depth, CAMERA, SENSOR, part)
        assert result.status == "found" and set(free) <= set(result.unobserved)
        e = rotate(conjugate(result.pose[3:]), pose[:3] - result.p)[:2]
        C = result.covariance[:2, :2]
        assert e @ np.linalg.solve(C, e) / 2.0 < 8.0 and np.linalg.norm(e) < 6e-4


@pytest.mark.slow
def test_a_part_that_is_longer_than_the_model_is_not_found():
    """By 6 mm, two and a half pixels: all of the pose agrees, and its border is off."""
    rng = np.random.default_rng(5)
    longer = shape("box", 0.083, 0.05, 0.03)
    hits = agree = 0
    for _ in range(15):
        depth, _, _ = from_above(BOX, longer, rng)
        (result,) = locate(depth, CAMERA, SENSOR, BOX)
        hits += result.status == "found"
        agree += result.agrees > 0.9 and result.see_through < 0.05
    assert hits <= 2 and agree >= 13  # 13 and more were found without the border
