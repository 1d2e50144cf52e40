"""The charts of exercises: what `chart_of` makes of a plan, in this process."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drills import cards
from drills import exercise as exercises
from drills.attempt import Attempt, Place
from drills.chart import chart_of
from drills.chart_plan import Drawing, Plan
from drills.grade_report import Report
from drills.verify import in_this_process


def charted(name: str, text: str, seed: int = 0, plan: Plan | None = None) -> Any:
    """An answer's chart, or that of a plan, without a child."""
    card, made = cards.card(name), exercises.of(name)
    draw: Any = made.chart
    if plan is not None:
        draw = chart_of("?", lambda attempt: plan, tolerance=0.1, error_unit="m", failed_above=9.0)
    assert draw is not None
    solution = card.solution_text()
    places = [in_this_process(card, one, "answer") for one in (text, solution)]
    for place in places:
        place.load()
    return draw(Attempt(card, places[0], Report(name, seed, "", text), made.given), places[1])


def test_yours_and_the_worked_answer_are_asked_the_same() -> None:
    """A wrong answer is off on the chart, a library has settings of its own, a failure is one."""

    def ask(place: Place, turn: float) -> tuple[float, float]:
        return place.call("fk3", np.ones(3), np.array([turn, 0.0, 0.0]))[3][0], 2.0 / turn

    plan = Plan(
        settings=[0.5, 0.25],
        ask=ask,
        truth=3.0,
        check=3.0,
        ours={"far off": lambda turn: (20.0, 1.0)},
        libraries={"exact": lambda turn: (3.0, 7.0)},
        own_settings={"exact": [4.0]},
    )
    solution = cards.card("fk3").solution_text()
    result = charted("fk3", solution.replace("np.cumsum(thetas)", "0.0 * thetas"), plan=plan)
    kinds = [(curve.name, curve.style, len(curve.points)) for curve in result.curves]
    assert kinds == [
        ("yours", "yours", 2),
        ("worked answer", "ours", 2),
        ("far off", "ours", 2),
        ("exact", "oracle", 1),
    ]
    assert max(point.error for point in result.curve("yours").points) < 1e-300
    errors = [point.error for point in result.curve("worked answer").points]
    assert errors == pytest.approx([3.0 - 3.0 * np.cos(0.5), 3.0 - 3.0 * np.cos(0.25)])
    assert [point.count for point in result.curve("worked answer").points] == [4.0, 8.0]
    assert all(point.failure for point in result.curve("far off").points)
    assert result.curve("exact").points[0].parameter == 4.0


def check_chart(name: str) -> None:
    """The worked answer lies on its own curve, and something meets the tolerance."""
    result = charted(name, cards.card(name).solution_text())
    if isinstance(result, Drawing):
        assert all("yours is within 0.0e+00" in panel.notes[0] for panel in result.panels())
        return
    yours, answer, *others = result.curves
    assert (yours.name, yours.style, answer.style) == ("yours", "yours", "ours")
    assert any(curve.style == "oracle" for curve in others)
    assert [p.parameter for p in yours.points] == [p.parameter for p in answer.points]
    assert [p.error for p in yours.points] == [p.error for p in answer.points]
    assert result.tolerance is not None and result.reference_uncertainty < 0.1 * result.tolerance
    assert result.pick() is not None


def test_the_chart_of_an_exercise() -> None:
    check_chart("stable_step")


def test_arms_are_drawn_where_speed_buys_no_accuracy() -> None:
    solution = cards.card("fk3").solution_text()
    right = charted("fk3", solution)
    for panel in right.panels():
        assert [series.label for series in panel.series] == ["yours", "worked answer"]
        assert len(panel["yours"].x) == 4 and panel["yours"].y[-1] == panel["worked"].y[-1]
    assert right.table().count("tip at (") == len(right.panels()) == 2
    wrong = charted("fk3", solution.replace("np.cumsum(thetas)", "thetas"))
    assert wrong.panels()[0]["worked"].x[-1] == right.panels()[0]["worked"].x[-1]
    yours, answer = (wrong.panels()[0][name] for name in ("yours", "worked"))
    assert np.hypot(yours.x[-1] - answer.x[-1], yours.y[-1] - answer.y[-1]) > 0.01


def test_a_share_of_successes_has_no_order() -> None:
    settings = [0.5, 0.25, 0.125]
    plan = Plan(settings, lambda place, share: ([share], 1.0 / share), [0.0], [0.0])
    made = charted("fk3", cards.card("fk3").solution_text(), plan=plan)
    assert "observed order 1.00" in made.table()
    assert "order" not in replace(made, converges=False).table()
