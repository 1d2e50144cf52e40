"""Small matrices in loops against NumPy's, also where they are badly conditioned."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.perception import linear
from tests.budget import examples

ROUNDING = np.finfo(float).eps


@st.composite
def factors(draw):
    """A matrix B (n, m) of many orders of magnitude; B B^T may be singular."""
    n, m = draw(st.sampled_from([3, 6])), draw(st.integers(1, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rows = 10.0 ** (draw(st.sampled_from([0.0, 3.0, 8.0])) * rng.uniform(-1.0, 1.0, (n, 1)))
    columns = 10.0 ** (draw(st.sampled_from([0.0, 4.0])) * rng.uniform(-1.0, 1.0, m))
    return rows * rng.standard_normal((n, m)) * columns


@examples(100)
@given(factors())
def test_eigenvalues_and_vectors_are_those_of_lapack(B):
    """Within rounding of the largest; vectors at right angles, of which the matrix is the sum."""
    M = B @ B.T
    values, vectors = linear.eigen(M)
    n, largest = len(M), np.linalg.norm(M, 2)
    assert np.all(np.diff(values) >= 0.0) and values[0] >= 0.0
    assert np.abs(values - np.linalg.eigvalsh(M)).max() <= 20 * n * ROUNDING * largest
    assert np.abs(vectors.T @ vectors - np.eye(n)).max() <= 20 * n * ROUNDING
    assert np.abs((vectors * values) @ vectors.T - M).max() <= 20 * n * ROUNDING * largest


@pytest.mark.parametrize("n", [3, 6])
def test_small_eigenvalues_retain_their_digits_where_rows_differ_in_scale(n):
    """D R D with a well-conditioned R: relative accuracy, which LAPACK does not promise."""
    from fractions import Fraction

    rng = np.random.default_rng(0)
    for _ in range(20):
        D = np.diag(10.0 ** -np.arange(0.0, 3.0 * n, 3.0))
        R = np.eye(n) + 0.1 * (lambda Q: Q + Q.T)(rng.uniform(-0.5, 0.5, (n, n)))
        M = D @ R @ D
        values, _ = linear.eigen(M)
        # The product of all eigenvalues is the determinant, here in exact arithmetic.
        rows = [[Fraction(x) for x in row] for row in M]
        determinant = Fraction(1)
        for k in range(n):
            determinant *= rows[k][k]
            for i in range(k + 1, n):
                share = rows[i][k] / rows[k][k]
                rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
        assert np.prod(values) == pytest.approx(float(determinant), rel=1e-12)


@examples(100)
@given(factors())
def test_the_pseudoinverse_is_that_of_lapack(B):
    M = B @ B.T
    scale = np.sqrt(np.diag(M))
    M = M / np.outer(scale, scale)
    values = np.linalg.eigvalsh(M)
    share = 1e-9
    # An eigenvalue near the limit may fall on either side of it.
    if np.any((values > 1e-3 * share * values[-1]) & (values < 1e3 * share * values[-1])):
        return
    expected = np.linalg.pinv(M, share, hermitian=True)
    smallest = values[values > share * values[-1]].min()
    limit = 1e3 * ROUNDING * values[-1] / smallest**2
    assert np.abs(linear.pseudoinverse(M, share) - expected).max() <= limit


def test_products_are_those_of_blas():
    rng = np.random.default_rng(0)
    for m, n, k in ((6, 6, 300), (3, 64, 5), (4, 2, 0)):
        a, b = rng.standard_normal((m, k)), rng.standard_normal((n, k))
        np.testing.assert_allclose(linear.times_transposed(a, b), a @ b.T, atol=1e-13)
    R, v = rng.standard_normal((3, 3)), rng.standard_normal((3, 7))
    np.testing.assert_allclose(linear.apply(R.T, v), R.T @ v, atol=1e-14)
    np.testing.assert_allclose(linear.apply(R, v[:, 0]), R @ v[:, 0], atol=1e-14)


def test_compiled_and_plain_are_the_same():
    M = np.cov(np.random.default_rng(0).standard_normal((6, 20)))
    values, vectors = np.empty(6), np.empty((6, 6))
    linear._eigen(M, values, vectors)
    for plain, compiled in zip((values, vectors), linear.eigen(M), strict=True):
        np.testing.assert_allclose(plain, compiled, atol=1e-13)
