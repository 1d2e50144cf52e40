"""Numbers are written alike by Python and by a real browser."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from course.simulations import canvas as widget
from course.simulations import pen as draw
from tests.conftest import chromium

pytestmark = [pytest.mark.browser, pytest.mark.slow]

SCRIPT = Path(widget.__file__).with_suffix(".js").read_text(encoding="utf-8")
FORMS = [*range(16), *(draw.SIGNED + k for k in range(16)), *(draw.EXPONENT + k for k in range(16))]


@pytest.fixture(scope="module", name="page")
def browser_page() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium(), args=["--no-sandbox", "--disable-gpu", "--disable-quic"]
        )
        page = browser.new_page()
        load = "async text => { window.painter = await import('data:text/javascript,' + text); }"
        page.evaluate(load, "".join(f"%{byte:02x}" for byte in SCRIPT.encode()))
        yield page
        browser.close()


def drawn(count: int) -> Iterator[tuple[float, int]]:
    """Numbers and forms: halves of the last decimal, of either sign; tiny, huge and plain ones."""
    rng = np.random.default_rng(3)
    for k in range(count):
        form = FORMS[rng.integers(len(FORMS))]
        unit = 10.0 ** -(form % 20)
        value = (
            (rng.integers(0, 1000) + 0.5) * unit,  # a half, as near as a float can be
            rng.integers(0, 2**20) / 2.0 ** rng.integers(0, 12),  # often a half exactly
            10.0 ** rng.uniform(-320.0, -15.0),
            10.0 ** rng.uniform(15.0, 308.0),
            rng.normal() * 10.0 ** rng.uniform(-12.0, 12.0),
        )[k % 5]
        yield math.copysign(value, rng.normal()), form


@pytest.mark.prove
def test_both_write_numbers_alike(page: Any) -> None:
    odd = [0.0, 0.5, 1.5, 2.5, 0.125, 1.005, 9.995, 99999.5, 1e21, 9.99999e20, 5e-324, 1.7e308]
    odd += [math.nan, math.inf]
    pairs = [(sign * value, form) for value in odd for form in FORMS for sign in (1.0, -1.0)]
    pairs += drawn(10_000)
    shown = page.evaluate("pairs => pairs.map(p => window.painter.written(...p))", pairs)
    wrong = [
        (value, form, draw.written(value, form), text)
        for (value, form), text in zip(pairs, shown, strict=True)
        if draw.written(value, form) != text
    ]
    assert wrong == []
