"""Small functions of an array for the compiler: what a model may use, and what it may not."""

import math

import numpy as np
from numba.extending import register_jitable


def maths(a):
    a[0] = math.sin(a[0]) + math.cos(a[1]) + math.tan(a[2]) + math.atan2(a[3], a[4])
    a[1] = math.exp(a[0]) + math.log(2.0 + a[1] ** 2) + math.hypot(a[0], a[3]) + abs(a[1]) ** 0.3
    a[2] = np.sinh(a[2]) + np.tanh(a[3]) + math.log1p(abs(a[2])) + math.expm1(a[4]) + np.cbrt(a[3])
    a[3] = np.fmod(7.5, 2.0 + a[3] ** 2) + (a[3] % 1.7) + 2.0 ** a[2] + np.log2(3.0 + a[4] ** 2)
    a[4] = np.floor(a[0]) + np.ceil(a[1]) + np.sqrt(abs(a[2])) + np.rint(a[3]) + np.sign(a[4])


def arrays(a):
    b = np.where(a > 0.0, a, -a) + np.arange(a.size)
    c = np.sort(b)
    table = np.outer(b, c).reshape(-1)
    total = table.reshape(a.size, a.size).sum(axis=0)
    a[:] = total + np.searchsorted(c, 2.0) + np.cumsum(c)[::-1] + c[b > 1.0].mean()
    a[0] = np.argmax(c)


def lists(a):
    rows, values = [np.zeros(2)], [a[0]]
    for k in range(200):
        rows.append(np.full(2, a[k % a.size] + k))
        values.append(rows[k][1])
    values.pop()
    a[:] = np.array(values)[: a.size] + rows[-1][0] + len(values)


def wholes(a):
    seed = np.uint64(0x9E3779B97F4A7C15)
    for _ in range(9):
        seed = (seed ^ (seed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    a[0] = (seed >> np.uint64(11)) * 2.0**-53
    a[1] = -7 // 3 + -7 % 3 + int(a[1]) + round(a[2]) + (1 << 40)
    a[2] = a[2] // 0.3 + (-1.5) ** 3


def raises(a):
    if a[0] > 0.0:
        raise ValueError("0 is the most \N{EM DASH} of a[0]")
    a[0] = 1.0


def takes(a):
    """The sum of a[0] arrays of a kilobyte, one after the other."""
    total = 0.0
    for k in range(int(a[0])):
        total += np.full(128, float(k))[k % 128]
    a[1] = total


def takes_at_once(a):
    a[1] = np.empty(int(a[0])).size


RIGHT = {
    each.__name__: each for each in (maths, arrays, lists, wholes, raises, takes, takes_at_once)
}


@register_jitable
def solves(a):
    a[:] = np.linalg.solve(np.eye(a.size), a)


def draws(a):
    a[0] = 1.0
    a[1] = np.random.random()  # noqa: NPY002


def inner(a):
    solves(a)


def looks_up(a):
    a[0] = {1: 2.0}[int(a[0])]


def prints(a):
    print(a[0])


WRONG = {each.__name__: each for each in (solves, draws, inner, looks_up, prints)}
