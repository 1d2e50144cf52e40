"""What a learner is told first, what is said of the rest, and what is drawn."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drills import cards as catalogue
from drills import exercise as exercises
from drills import feedback, picture
from drills.grade_report import Shown
from drills.grader import COMPILING, limits_for
from drills.reasons import Reason
from drills.sandbox import Limits
from tests.drills.here import grade_here
from tests.drills.place import Place, a_place

__all__ = ["a_place"]

FK3 = catalogue.card("fk3").solution_text()
ANGLES = "np.cumsum(thetas)"


def test_a_failure_of_edge_cases_alone_is_told_with_what_holds() -> None:
    """An arm of no length is wrong, everything else is right."""
    report = grade_here("fk3", FK3.replace(ANGLES, f"{ANGLES} / (lengths.sum() > 0.0)"), seed=3)
    assert not report.passed and report.parts[report.checks[0].part].level == "simple"
    failed = next(check for check in report.checks if not check.passed)
    assert failed.name == "an arm of no length"
    assert feedback.tally_text(report) == "Cases: simple 2 of 2, core 14 of 14, edge 4 of 5"
    assert feedback.as_dict(report, catalogue.card("fk3"))["cases"][2]["hold"] == 4


def test_the_simplest_failure_is_told_although_a_later_case_raises() -> None:
    wrong = FK3.replace(ANGLES, f"thetas if lengths.all() else {ANGLES}[[].pop()]")
    report = grade_here("fk3", wrong, seed=3)
    assert report.reason is Reason.WRONG_VALUE and report.problem is not None
    assert report.unreached > 0 and "not reached" in feedback.tally_text(report)
    assert report.sentence == next(c.sentence for c in report.checks if not c.passed)


def test_a_mistake_that_spares_a_case_is_still_named() -> None:
    spared = FK3.replace(ANGLES, f"(thetas if abs(thetas).max() < 10.0 else {ANGLES})")
    assert grade_here("fk3", spared, seed=3).slip == "absolute_angles"
    # What is right but for a few cases of its own is not one of the slips.
    few = FK3.replace(ANGLES, f"({ANGLES} if lengths.max() < 1.3 else 2.0 * thetas)")
    slips = {slip.name for slip in exercises.of("fk3").slips}
    assert grade_here("fk3", few, seed=3).slip not in slips


def test_a_time_out_is_not_blamed_on_bounces_that_there_are_not() -> None:
    (endless,) = [slip for slip in exercises.of("bounce").slips if slip.ends]
    assert endless.cause((1.0, 0.0, 9.0, 0.5, 9.81)) and endless.cause((0.0, 0.0, 1.0, 0.5))
    assert not endless.cause((1.0, 0.0, 0.3, 0.5)) and not endless.cause((1.0, 0.0, 9.0, 1.0))


def test_a_sentence_on_many_cases_is_said_once() -> None:
    report = grade_here("fk3", "def fk3(lengths, thetas):\n    return [1.0, 2.0]\n", seed=3)
    rows = feedback.grouped(report.checks)
    assert [count for _, count in rows] == [len(report.checks)]
    text = feedback.text(report, catalogue.card("fk3"))
    assert text.count(report.sentence[:40]) == 1 and "as said above" in text


def test_a_part_that_is_right_in_every_case_is_told() -> None:
    wrong = FK3.replace("np.cos(directions), ", "np.cos(2.0 * directions), ")
    report = grade_here("fk3", wrong, seed=3)
    assert report.slip == "one_part_right" and "column 1. Wrong: column 0" in report.diagnosis


# A slip whose values can be drawn; of other exercises the first one is.
DRAWN = {
    "fk3": "clockwise",
    "bounce": "rest_time_halved",
    "rrt": "vertices_only",
    "rrt_connect": "both_greedy",
    "tumble": "bug_still_there",
    "orientation": "scalar_last",
    "pid": "integral_not_stopped",
    "circle_contact": "from_b_to_a",
}


@pytest.mark.prove
@pytest.mark.parametrize("name", [n for n in catalogue.names() if exercises.of(n).picture])
def test_a_case_that_failed_is_drawn(name: str) -> None:
    first, *others = exercises.of(name).slips
    slip = next((slip for slip in others if slip.name == DRAWN.get(name)), first)
    card = catalogue.card(name)
    report = grade_here(name, slip.text(card.solution_text()), seed=5)
    figure = picture.figure_of(report)
    assert figure is not None and len(figure.axes[0].lines) >= 2
    assert figure.get_suptitle().startswith(name)
    passed = grade_here(name, card.solution_text(), seed=5)
    assert picture.figure_of(passed) is None


def test_the_picture_of_a_body_says_how_far_apart_the_two_are() -> None:
    assert np.isclose(picture.angle([0.5, 0.5, 0.5, 0.5], [-3.0, 0.0, 0.0, 0.0]), 120.0)
    assert np.isclose(np.radians(picture.angle(np.eye(4)[0], [1.0, 1e-9, 0.0, 0.0])), 2e-9)


def test_numbers_that_no_picture_can_hold_are_no_fault(tmp_path: Path) -> None:
    report = grade_here("fk3", FK3.replace(ANGLES, "thetas"), seed=5)
    assert report.shown is not None
    huge = (np.full((4, 2), 1e308) * [[1.0, -1.0]],)
    report.shown = Shown("huge", report.shown.args, huge, report.shown.expected)
    result = picture.write(report, tmp_path / "a.png")
    assert result is None or result.read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] in ([], ["a.png"])


@pytest.mark.prove
def test_the_command_writes_the_picture_and_the_notebook_shows_it(place: Place) -> None:
    place.answer(FK3.replace(ANGLES, "thetas"), "fk3")
    data = place.json("check", "fk3", "--rendered")
    drawn = place.work / "fk3.case.png"
    assert data["picture"] == str(drawn.absolute()) and drawn.read_bytes()[:4] == b"\x89PNG"
    assert '<img alt="the first case that failed" src="data:image/png;base64,' in data["html"]
    place.answer(FK3, "fk3")
    assert place.json("check", "fk3")["picture"] is None and not drawn.exists()


def test_numba_may_compile_on_top_of_the_limits() -> None:
    usual: Any = Limits()
    assert limits_for(usual, "import numpy\n# from numba import njit\n") == usual
    longer = limits_for(usual, "import numpy\nfrom numba import njit\n")
    assert longer.call == usual.call + COMPILING and longer.memory == usual.memory


def test_a_part_that_is_wrong_now_and_then_is_told() -> None:
    """The longest stage is often, not always, the one that limits the rate."""
    right = catalogue.card("throughput").solution_text()
    longest = right + (
        "\n\n_right = throughput\n\n\ndef throughput(stages, workers):\n"
        "    return (*_right(stages, workers)[:2], int(np.argmax(stages)))\n"
    )
    report = grade_here("throughput", longest, seed=11)
    assert report.slip == "one_part_right"
    assert re.search(
        r"^Right in every case: latency and rate\. Wrong in \d+ of \d+ cases: slowest\.",
        report.diagnosis,
    )


def test_rows_of_any_length_are_told_apart() -> None:
    right = catalogue.card("back_project").solution_text()
    upward = right + (
        "\n\n_right = back_project\n\n\ndef back_project(*args):\n"
        "    return _right(*args) * [[1.0], [-1.0], [1.0]]\n"
    )
    report = grade_here("back_project", upward, seed=11)
    assert report.slip == "one_part_right"
    assert report.diagnosis.startswith("Right in every case: row 0 and row 2. Wrong: row 1.")


def test_a_factor_of_all_results_is_told() -> None:
    right = catalogue.card("tip_resolution").solution_text()
    halved = right + (
        "\n\n_right = tip_resolution\n\n\ndef tip_resolution(*args):\n"
        "    each, total = _right(*args)\n    return 0.5 * np.asarray(each), 0.5 * total\n"
    )
    report = grade_here("tip_resolution", halved, seed=11)
    assert report.slip == "constant_factor"
    assert report.diagnosis.startswith("Every value is 0.5 times the right one")
