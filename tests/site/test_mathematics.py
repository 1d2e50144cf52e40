"""The page of mathematics: each number of an answer is computed here, each picture is there."""

import re

import numpy as np
import pytest

from course.measure import success
from course.site import notebooks
from tools import mathematics

TEXT = notebooks.TEXTS["mathematics"].read_text("utf-8")
EXERCISES = re.findall(
    r"\*\*Exercise (\d+)\.\*\*(.*?)<summary>Answer</summary>(.*?)</details>", TEXT, re.S
)
ANSWERS = {int(number): answer for number, _, answer in EXERCISES}


def test_ten_exercises_in_order_each_with_an_answer() -> None:
    assert [int(number) for number, _, _ in EXERCISES] == list(range(1, 11))


def test_every_picture_is_shown_and_drawn_by_the_tool() -> None:
    assert re.findall(r"^!\[[^\]]+\]\((\w+)\.png\)$", TEXT, re.M) == list(mathematics.PICTURES)
    files = {path.stem for path in mathematics.FOLDER.glob("*.png")}
    assert files == set(mathematics.PICTURES)


def test_the_tangent_of_the_sine() -> None:
    assert f"{np.sin(0.1):.5f}" in ANSWERS[1]
    assert f"{0.1 - np.sin(0.1):.5f}" == f"{0.1**3 / 6:.5f}" == "0.00017"


def test_the_jacobian_of_two_links() -> None:
    def tip(q: np.ndarray) -> np.ndarray:
        turned = np.exp(1j * q[0]) + np.exp(1j * (q[0] + q[1]))
        return np.array([turned.real, turned.imag])

    q, h = np.array([0.0, np.pi / 2]), 1e-6
    slopes = [(tip(q + step) - tip(q - step)) / (2 * h) for step in h * np.eye(2)]
    np.testing.assert_allclose(np.column_stack(slopes), [[-1, -1], [1, 0]], atol=1e-9)
    assert r"\begin{pmatrix} -1 & -1\\ 1 & 0\end{pmatrix}" in ANSWERS[2]


def test_eigenvalues() -> None:
    np.testing.assert_allclose(np.linalg.eigvalsh([[2.0, 1.0], [1.0, 2.0]]), [1.0, 3.0])
    growth = np.abs(np.linalg.eigvals([[0.9, -0.5], [0.5, 0.9]]))
    assert growth == pytest.approx([1.03, 1.03], abs=5e-3)
    assert "3 %" in ANSWERS[4] and "1.03" in ANSWERS[4]


def test_what_decays_in_the_end_may_grow_first() -> None:
    matrix = np.array([[0.9, 10.0], [0.0, 0.9]])
    lengths = [np.linalg.norm(np.linalg.matrix_power(matrix, n) @ [0.0, 1.0]) for n in (1, 200)]
    assert np.abs(np.linalg.eigvals(matrix)).max() < 1.0 < 10.0 < lengths[0]
    assert lengths[1] < 1e-5


def test_euler_and_its_limits() -> None:
    assert f"{np.exp(-0.2):.4f}" in ANSWERS[5] and "0.8$" in ANSWERS[5]
    x = {h: np.abs((1.0 - 2.0 * h) ** np.arange(40)) for h in (0.3, 0.75, 0.99, 1.01)}
    assert x[0.3][-1] < 1e-9 and x[0.75][-1] < 1e-9 and x[0.99][-1] < 1 < x[1.01][-1]
    assert 1.0 - 2.0 * 0.75 < 0.0


def test_probability() -> None:
    rng = np.random.default_rng(1)
    rates = rng.binomial(100, 0.8, 200_000) / 100
    assert rates.std() == pytest.approx(0.04, abs=5e-4) and "= 0.04$" in ANSWERS[7]
    (low,), (high,) = success.wilson([80], 100)
    text = " ".join(ANSWERS[7].split())
    assert "72 % and 88 %" in text and f"from {low:.0%} to {high:.0%}".replace("%", " %") in text
    noise = rng.normal(0.0, 6.0, (20_000, 36)).mean(axis=1)
    assert noise.std() == pytest.approx(1.0, abs=0.02) and "36" in ANSWERS[8]
    both = rng.normal(0.0, 3.0, 200_000) + rng.normal(0.0, 4.0, 200_000)
    assert both.std() == pytest.approx(5.0, abs=0.05) and "3 mm and 4 mm make 5 mm" in TEXT


def test_least_squares() -> None:
    lengths = np.array([10.0, 11.0, 15.0])
    best, *_ = np.linalg.lstsq(np.ones((3, 1)), lengths, rcond=None)
    assert best == pytest.approx([12.0]) and "12 mm" in ANSWERS[9]
    a = np.linspace(-1.0, 1.0, 9)
    assert np.linalg.matrix_rank(np.column_stack([a, 2.0 * a])) == 1
    assert "I + 2b" in ANSWERS[10]
