"""Quaternions compiled for one and for a batch give what the plain source gives."""

import numpy as np

from course.compiled import MATRIX, VECTOR, compiled
from course.rigid_body import quaternion as quat
from tests.rigid_body.test_quaternion import random_vectors


def _several(u, v):
    p, q = quat.exp(u), quat.exp(v)
    e = quat.to_euler_zyx(q)
    again = quat.from_euler_zyx(e[0], e[1], e[2])
    return (
        quat.log(quat.product(p, quat.conjugate(q))),
        quat.rotate(q, v),
        quat.from_matrix(quat.to_matrix(p)),
        quat.dexp_inverse(u, v),
        quat.derivative(quat.normalise(again), u),
        quat.angle_between(p, q),
        quat.euler_zyx_rate_matrix(e[1], e[2]),
    )


def _few(u, v):
    q = quat.exp(u)
    return q, quat.derivative(q, v)


def test_compiled_code_gives_the_same_numbers():
    u, v = random_vectors(3)
    single = compiled(_several, (VECTOR, VECTOR))
    for i in range(3):
        arguments = u[:, i].copy(), v[:, i].copy()
        for fast, plain in zip(single(*arguments), _several(*arguments), strict=True):
            np.testing.assert_allclose(fast, plain, rtol=0, atol=2e-15)
    batch = compiled(_few, (MATRIX, MATRIX))
    for fast, plain in zip(batch(u, v), _few(u, v), strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=2e-15)
