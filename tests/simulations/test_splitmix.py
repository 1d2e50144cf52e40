"""The generator against its published stream, against whole-number arithmetic and by moments."""

import numpy as np
import pytest

from course.simulations import splitmix


def test_the_published_stream():
    # First five numbers of splitmix64.c (Vigna, 2015) for the seed 1234567.
    seed = np.array([1234567], np.uint64)
    expected = [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]
    assert splitmix.integers(seed, 2).tolist() == expected[:2]
    assert splitmix.integers(seed, 0).tolist() == []
    assert splitmix.integers(seed, 3).tolist() == expected[2:]


@pytest.mark.parametrize("start", [0, 1, 2**64 - 1])
def test_against_whole_numbers(start):
    state, expected = start, []
    for _ in range(100):
        state = (state + 0x9E3779B97F4A7C15) % 2**64
        z = state
        z = ((z ^ z >> 30) * 0xBF58476D1CE4E5B9) % 2**64
        z = ((z ^ z >> 27) * 0x94D049BB133111EB) % 2**64
        expected.append(z ^ z >> 31)
    seed = np.array([start], np.uint64)
    assert splitmix.integers(seed, 100).tolist() == expected and seed[0] == state


def test_moments_of_both_distributions():
    n = 200_000
    seed, u, z = np.array([3], np.uint64), np.empty(n), np.empty(n)
    splitmix.uniform(seed, u)
    splitmix.normal(seed, z)
    assert 0.0 <= u.min() and u.max() < 1.0
    # Five standard errors of the mean, the variance, and the neighbours' correlation.
    assert abs(u.mean() - 0.5) < 5 * np.sqrt(1 / 12 / n)
    assert abs(u.var() - 1 / 12) < 5 * np.sqrt(1 / 180 / n)
    assert abs(z.mean()) < 5 / np.sqrt(n) and abs(z.var() - 1.0) < 5 * np.sqrt(2 / n)
    assert abs((z**4).mean() - 3.0) < 5 * np.sqrt(96 / n)
    assert abs((z[1:] * z[:-1]).mean()) < 5 / np.sqrt(n)
