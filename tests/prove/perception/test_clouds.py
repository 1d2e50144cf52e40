"""Thousands of scenes and clouds against the libraries, the law of noise, and ratios of times."""

import math

import numpy as np
import pytest

from course import charts
from course.oracles import open3d
from course.oracles.mujoco import camera as mujoco
from course.perception import Sensor, dbscan, render, sense
from tests.perception.draws import LONG, SMALL, blobs, scene


def test_two_thousand_scenes_as_mujoco_sees_them():
    rng, worst, pixels = np.random.default_rng(), 0.0, 0
    for _ in range(2000):
        shapes = scene(rng)
        depth, ids = render(shapes, SMALL)
        theirs, owner = mujoco.Rays(shapes, SMALL).picture()
        pixels += int(np.count_nonzero(ids != owner))
        worst = max(worst, np.abs(depth - theirs)[ids == owner].max())
    # Where a ray all but grazes a round shape the root has half of the digits.
    assert worst < 1e-10 and pixels <= 2


@pytest.mark.parametrize("z", np.geomspace(0.3, 6.0, 6))
def test_the_law_of_noise_to_three_thousandths(z):
    rng, exact = np.random.default_rng(), np.full((120, 160), z)
    sensor = Sensor(noise=0.05, step=0.05)
    measured = np.array([sense(exact, LONG, sensor, rng) for _ in range(60)])
    relative = float(sensor.sigma(z, LONG)) / z  # of its square the second order adds four times
    ratio = measured.std() / sensor.sigma(z, LONG) / (1.0 + 4.0 * relative**2)
    assert abs(ratio - 1.0) < 3e-3 + 4.0 / math.sqrt(2.0 * measured.size)


@pytest.mark.parametrize(("eps", "least"), [(0.004, 3), (0.01, 6), (0.02, 20), (0.05, 100)])
def test_clusters_of_many_clouds_are_open3ds(eps, least):
    rng = np.random.default_rng()
    for n in (100, 1000, 8000):
        points = blobs(rng, n)
        labels, core = dbscan(points, eps, least)
        theirs = open3d.Cloud(points).dbscan(eps, least)
        assert np.array_equal(labels[core], theirs[core])
        assert np.array_equal(labels < 0, theirs < 0)


def test_each_step_is_as_many_times_faster_as_it_says():
    """The stored chart, measured on a quiet machine; a quick one is built in the other tests."""
    steps, growth = charts.stored("cloud_speed")
    ratio = dict(zip(steps["library"].y, steps["library"].x, strict=True))
    least = {
        "image, MuJoCo": 10.0,
        "image, Embree": 10.0,
        "points": 1.5,
        "voxels of 2 mm": 4.0,
        "voxels of 5 mm": 2.5,
        "voxels of 20 mm": 1.0,
        "plane, 300 draws": 8.0,
        "plane, early stop": 1.5,
    }
    assert ratio.keys() == least.keys()
    assert not {name: ratio[name] for name in least if ratio[name] < least[name]}
    own, other = (np.array(growth[name].y) for name in ("course", "Open3D"))
    assert (other / own)[-1] > 20.0 and (other / own)[2] > 2.0
