"""Bodies in a pen: what lies in it before anything is timed."""

import numpy as np
import pytest

from course.oracles.mujoco.heap import MASS, RADIUS, Heap, hull


@pytest.mark.parametrize(("points", "contacts"), [(0, 1), (1, 4)])
def test_one_body_lies_on_as_many_points_as_it_should(points, contacts):
    cost = Heap(points, 1, 1500).measure(10)
    assert cost.contacts == contacts
    assert cost.rows == 4 * contacts  # a pyramid of four edges
    assert cost.step > cost.collision + cost.solver > 0.0


def test_hulls_become_the_sphere():
    ball = 0.4 * MASS * RADIUS**2
    deviation = []
    for points in (20, 200, 2000):
        assert np.allclose(np.linalg.norm(hull(points), axis=1), RADIUS)
        deviation.append(abs(Heap(points, 1, 1).model.body_inertia[1].mean() / ball - 1.0))
    assert deviation[0] > deviation[1] > deviation[2]
    assert deviation[2] < 0.01


def test_all_bodies_stay_in_the_pen_and_apart():
    heap = Heap(20, 8, 600)
    places = heap.data.qpos.reshape(8, 7)[:, :3]
    assert np.abs(places[:, :2]).max() < 1.15 * 3 * RADIUS
    assert places[:, 2].min() > 0.6 * RADIUS
    gaps = np.linalg.norm(places[:, None] - places, axis=2)[~np.eye(8, dtype=bool)]
    assert gaps.min() > 1.2 * RADIUS
    assert heap.measure(20).contacts >= 3 * 8 / 2
