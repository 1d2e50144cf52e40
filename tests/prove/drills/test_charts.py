"""Every exercise's chart, in this process."""

from __future__ import annotations

import pytest

from drills import cards
from tests.drills.test_chart import check_chart


@pytest.mark.parametrize("name", cards.names())
def test_the_chart_of_an_exercise(name: str) -> None:
    check_chart(name)
