"""The exact picture against MuJoCo and closed forms, the sensor's against its law."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.kinematics.chain import invert
from course.oracles.mujoco import camera as mujoco
from course.perception import STEREO, Camera, Sensor, camera, render, sense, shape, together
from course.rigid_body.quaternion import to_matrix
from tests.budget import examples
from tests.perception.draws import LONG, SMALL, at, facing, scene

seeds = st.integers(0, 2**32 - 1)


@pytest.mark.prove
def test_two_hundred_scenes_as_mujoco_sees_them():
    rng, worst = np.random.default_rng(0), 0.0
    for _ in range(200):
        shapes = scene(rng)
        depth, ids = render(shapes, SMALL)
        theirs, owner = mujoco.Rays(shapes, SMALL).picture()
        assert np.array_equal(ids, owner)
        worst = max(worst, np.abs(depth - theirs).max())
    assert worst < 1e-12


@pytest.mark.parametrize(
    ("kind", "size"), [("box", (1.0, 2.0, 3.0)), ("cylinder", (1.0, 2.0)), ("sphere", (1.0,))]
)
def test_from_inside_the_far_side_is_seen(kind, size):
    shapes = shape(kind, *size, pose=at(0.2, -0.3, 0.1, (0.4, 0.5, 0.6)))
    depth, ids = render(shapes, SMALL)
    theirs, _ = mujoco.Rays(shapes, SMALL).picture()
    assert np.all(ids == 0) and np.abs(depth - theirs).max() < 1e-13


def test_a_picture_in_closed_form():
    """Seen straight from above, where rays are parallel to faces and axes."""
    odd = Camera.symmetric(81, 61, 1.0)
    shapes = together(
        [facing(1.0), shape("cylinder", 0.1, 0.2, pose=at(0.0, 0.0, 0.9, (np.pi, 0.0, 0.0)))]
    )
    depth, ids = render(shapes, odd)
    x, y = odd.rays()
    on_top = np.hypot(x, y[:, None]) * 0.7 <= 0.1
    assert x[40] == y[30] == 0.0 and ids[30, 40] == 1
    assert np.abs(depth[on_top] - 0.7).max() < 1e-15
    assert np.abs(depth[ids == 0] - 1.0).max() < 1e-15
    box, _ = render(shape("box", 0.1, 0.1, 0.1, pose=at(z=0.9)), odd)
    assert np.count_nonzero(box) == np.sum(np.maximum(np.abs(x), np.abs(y[:, None])) * 0.8 <= 0.1)
    # A plane is seen from above only; what is behind the camera not at all.
    assert not render(shape("plane", pose=at(z=1.0)), odd)[0].any()
    assert not render(shape("sphere", 0.1, pose=at(z=-1.0)), odd)[0].any()


def test_the_middle_of_a_picture_is_between_its_pixels():
    """Mirrored shapes give the mirrored picture, to the last bit but rounding."""
    shapes = together([facing(1.0), shape("box", 0.2, 0.1, 0.05, pose=at(z=0.9))])
    depth, ids = render(shapes, SMALL)
    assert np.array_equal(ids, ids[:, ::-1]) and np.array_equal(ids, ids[::-1])
    assert np.abs(depth - depth[:, ::-1]).max() < 1e-15
    shifted = Camera(80, 60, SMALL.fx, SMALL.fy, 40.0, 30.0)
    ids = render(shapes, shifted)[1]
    assert not np.array_equal(ids, ids[:, ::-1])


@given(seed=seeds)
@examples(20)
def test_neither_the_order_nor_the_windows_change_a_picture(seed):
    rng = np.random.default_rng(seed)
    shapes = scene(rng, 5)
    depth, ids = render(shapes, SMALL)
    alone = [
        render(camera.Shapes((k,), shapes.sizes[:, [i]], shapes.poses[:, [i]]), SMALL)[0]
        for i, k in enumerate(shapes.kinds)
    ]
    nearest = np.where(np.array(alone) > 0.0, alone, np.inf).min(axis=0)
    # A quaternion that is made of unit length again differs in its last bit.
    nearest[np.isinf(nearest)] = 0.0
    assert np.abs(depth - nearest).max() < 1e-12
    assert np.array_equal(ids >= 0, depth > 0.0)


def test_a_camera_elsewhere_sees_the_scene_from_there():
    rng = np.random.default_rng(3)
    shapes, eye = scene(rng, 4), at(0.1, -0.2, 0.05, (0.2, -0.1, 0.3))
    depth, _ = render(shapes.moved(invert(eye)), SMALL)
    x, y = SMALL.rays()
    v, u = np.nonzero(depth)
    observed = np.stack((x[u] * depth[v, u], y[v] * depth[v, u], depth[v, u]))
    world = to_matrix(eye[3:]) @ observed + eye[:3, None]
    # Of a point of the world, the same picture in whichever frame it is asked for.
    assert np.abs(shapes.moved(invert(eye)).moved(eye).poses - shapes.poses).max() < 1e-15
    plane = to_matrix(shapes.poses[3:, 0])[:, 2] @ (world - shapes.poses[:3, :1])
    assert plane.min() > -1e-14 and np.abs(plane).min() < 1e-14
    assert np.abs(SMALL.project(observed) - np.stack((u, v))).max() < 1e-12


def test_plain_python_draws_the_same(monkeypatch):
    tiny, shapes = Camera.symmetric(16, 12, 1.0), scene(np.random.default_rng(1), 5)
    expected = render(shapes, tiny)
    monkeypatch.setattr(camera, "_cast", camera._render)
    with np.errstate(divide="ignore", invalid="ignore"):
        plain = render(shapes, tiny)
    assert np.array_equal(plain[1], expected[1]) and np.array_equal(plain[0], expected[0])


# --- The sensor -----------------------------------------------------------------------------------


def pictures(sensor: Sensor, z: float, count: int, eye: Camera = LONG, seed: int = 0):
    """What the sensor makes of a wall at z, again and again, shape (count, H, W)."""
    rng, exact = np.random.default_rng(seed), np.full((eye.height, eye.width), z)
    return np.array([sense(exact, eye, sensor, rng) for _ in range(count)])


@pytest.mark.parametrize("z", [0.3, 1.0, 2.0, 6.0])
@pytest.mark.parametrize("sensor", [Sensor(noise=0.05), Sensor(noise=0.04, step=0.06, unit=1e-5)])
def test_noise_grows_with_the_square_of_the_distance(z, sensor):
    measured = pictures(sensor, z, 4)
    spread = 1.0 / math.sqrt(2.0 * measured.size)
    assert abs(measured.std() / sensor.sigma(z, LONG) - 1.0) < 4.0 * spread + 2e-3
    # To second order the mean is too far, as depth is convex in disparity.
    disparity = LONG.fx * sensor.baseline / z
    bias = z * (math.hypot(sensor.noise, sensor.step / math.sqrt(12.0)) / disparity) ** 2
    assert abs(measured.mean() - z - bias) < 4.0 * measured.std() / math.sqrt(measured.size)


@pytest.mark.parametrize("noise", [0.02, 0.2, 1 / 3, 0.6])
def test_averaging_cannot_remove_a_step_without_noise(noise):
    """What is left of a quarter step, by Fourier: q / pi e^(-2 pi^2 (s/q)^2), and so on."""
    step = 0.25
    z = LONG.fx * 0.05 / (37.0 * step + 0.25 * step)
    measured = pictures(Sensor(noise=noise * step, step=step), z, 12)
    remaining = (LONG.fx * 0.05 / measured).mean() - LONG.fx * 0.05 / z
    k = np.arange(1, 400)
    waves = (-1.0) ** k / k * np.exp(-2.0 * (np.pi * k * noise) ** 2) * np.sin(0.5 * np.pi * k)
    predicted = step / np.pi * waves.sum()
    assert abs(remaining - predicted) < 5.0 * step * math.hypot(noise, 0.3) / math.sqrt(
        measured.size
    )
    assert (abs(remaining) > 0.2 * step) == (noise < 0.1)


@pytest.mark.parametrize("window", [1, 3, 5])
def test_noise_that_neighbours_share_averages_out_more_slowly(window):
    """The mean over n x n pixels spreads w times as much, less what the border cuts off."""
    n, count = 24, 600
    sensor, eye = Sensor(noise=0.05, window=window), Camera(n, n, 600.0, 600.0, 11.5, 11.5)
    measured = eye.fx * sensor.baseline / pictures(sensor, 1.0, count, eye)
    assert measured.std() == pytest.approx(0.05, rel=0.02)
    k = np.arange(1 - window, window)
    line = ((n - np.abs(k)) * (1.0 - np.abs(k) / window)).sum() / n**2
    ratio = measured.mean(axis=(1, 2)).std() / (0.05 * line)
    assert abs(ratio - 1.0) < 4.0 / math.sqrt(2.0 * count)
    assert 0.9 * window < line * n <= window


def test_what_is_grazed_is_not_measured():
    shapes = together([facing(1.0, 1.2), shape("box", 0.05, 0.05, 0.05, pose=at(z=0.4))])
    depth, ids = render(shapes, SMALL)
    x, y = SMALL.rays()
    rays = np.stack(np.broadcast_arrays(x, y[:, None], 1.0))
    normal = to_matrix(shapes.poses[3:, 0])[:, 2]
    cosine = -np.einsum("i,ihw->hw", normal, rays) / np.linalg.norm(rays, axis=0)
    result = camera.incidence(depth, SMALL)
    assert np.abs(np.cos(result) - cosine)[ids == 0].max() < 1e-12
    front = ids == 1
    assert np.abs(np.cos(result) - 1.0 / np.linalg.norm(rays, axis=0))[front].max() < 1e-12
    limit = float(np.median(np.arccos(cosine[ids == 0])))
    observed = sense(depth, SMALL, Sensor(noise=0.0, grazing=limit), np.random.default_rng(0)) > 0.0
    assert np.array_equal(observed[ids == 0], (np.arccos(cosine) <= limit)[ids == 0])


def test_dropout_range_and_unit():
    eye, rng = SMALL, np.random.default_rng(0)
    depth = np.linspace(0.05, 5.0, eye.width * eye.height).reshape(eye.height, eye.width)
    sensor = Sensor(noise=0.0, unit=0.01, dropout=0.3, near=0.2, far=4.0)
    observed = sense(depth, eye, sensor, rng)
    got = observed[observed > 0.0]
    assert got.min() >= 0.2 and got.max() <= 4.0
    assert np.abs(got / 0.01 - np.rint(got / 0.01)).max() < 1e-9
    inside = np.count_nonzero((depth >= 0.195) & (depth <= 4.005))
    assert abs(got.size / inside - 0.7) < 4.0 * math.sqrt(0.21 / inside)
    np.testing.assert_allclose(sense(depth, eye, Sensor(noise=0.0, near=0.01), rng), depth, 1e-15)
    first, again = (sense(depth, eye, STEREO, np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first, again)


GOOD = np.ones((60, 80))
BAD = [
    (lambda: SMALL.picture(np.ones((80, 60))), "depth.shape"),
    (lambda: SMALL.picture(-GOOD), r"depth\[0, 0\] must be .*, got -1"),
    (lambda: SMALL.picture(GOOD * np.nan), "at least one measurement"),
    (lambda: SMALL.picture((1000 * GOOD).astype(np.uint16)), "millimetres"),
    (lambda: SMALL.picture(800.0 * GOOD), "millimetres"),
    (lambda: sense(0.0 * GOOD, SMALL, STEREO, np.random.default_rng(0)), "0 everywhere"),
    (lambda: shape("cone", 1.0), "one of"),
    (lambda: shape("box", 1.0), "3 numbers for a box"),
    (lambda: shape("sphere", 0.0), r"sizes\[0, 0\]"),
    (lambda: shape("sphere", 1.0, pose=np.zeros(7)), "length of 1"),
    (lambda: shape("sphere", 1.0).at(np.zeros((7, 2))), "poses.shape"),
    (lambda: Camera(0, 1, 1.0, 1.0, 0.0, 0.0), "width"),
    (lambda: Camera(1, 1, 1.0, -1.0, 0.0, 0.0), "fy"),
    (lambda: Camera.symmetric(10, 10, math.pi), "view"),
    (lambda: SMALL.project(np.zeros((3, 1))), "in front of the camera"),
    (lambda: Sensor(baseline=0.0), "baseline"),
    (lambda: Sensor(window=0), "window"),
    (lambda: Sensor(dropout=1.5), "dropout"),
    (lambda: Sensor(near=2.0, far=1.0), "far"),
]


@pytest.mark.parametrize(("call", "words"), BAD, ids=range(len(BAD)))
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
