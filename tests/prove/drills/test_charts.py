"""Every exercise's chart, in this process."""

from __future__ import annotations

import pytest

from drills import cards
from drills import exercise as exercises
from tests.drills.test_chart import check_chart

WITH_CHART = [name for name in cards.names() if exercises.of(name).chart is not None]


def test_there_are_exercises_with_a_chart() -> None:
    assert len(WITH_CHART) >= 10


@pytest.mark.parametrize("name", WITH_CHART)
def test_the_chart_of_an_exercise(name: str) -> None:
    check_chart(name)
