"""The cards in a notebook: turned, judged, rated by button and key, and kept."""

import sys
from datetime import UTC, datetime
from pathlib import Path

import pytest

from course.derivations import records
from drills.interview import store
from drills.interview.deck import VERDICTS
from drills.interview.panel import Flashcards, flashcards, rendered

NOON = datetime(2026, 5, 4, 12, tzinfo=UTC)


@pytest.fixture(name="file")
def a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("DRILLS_PROGRESS", str(tmp_path / "progress.json"))
    return tmp_path / "reviews.json"


def a_panel(*kinds: str) -> Flashcards:
    made = flashcards([4], kinds, clock=lambda: NOON)
    assert isinstance(made, Flashcards)
    return made


def test_a_card_is_rated_once_it_is_turned_and_another_run_goes_on(file: Path) -> None:
    panel = a_panel("claim")
    first = panel.entry
    assert first is not None and all(button.disabled for button in panel.ratings.values())
    panel.ratings[3].click()
    assert not file.exists() and panel.entry == first
    panel.turn.click()
    assert panel.turned and not any(button.disabled for button in panel.ratings.values())
    panel.ratings[3].click()
    second = panel.entry
    assert second not in (None, first) and not panel.turned
    panel.press({"key": " "})
    panel.press({"key": "1"})
    log = store.load(file)[0].log
    assert [(one["card"], one["rating"]) for one in log] == [
        (getattr(first, "key", ""), 3),
        (getattr(second, "key", ""), 1),
    ]
    before = file.read_bytes()
    again = a_panel("claim")  # the cell is run again
    assert again.entry not in (first, second) and file.read_bytes() == before
    for noise in (None, "1", {"key": 9}, {"key": "x"}):
        again.press(noise)
    again.press({"key": "n"})
    assert file.read_bytes() == before


@pytest.mark.parametrize(("right", "number"), [(True, 3), (False, 1)])
def test_what_is_said_of_a_claim_is_judged(file: Path, right: bool, number: int) -> None:
    panel = a_panel("claim")
    assert panel.entry is not None
    verdict = records.load(panel.entry.file)[panel.entry.name]["verdict"]
    panel.answer_box.value = next(k for k, v in VERDICTS.items() if (v == verdict) == right)
    panel.reveal()
    assert [n for n, b in panel.ratings.items() if b.button_style] == [number]


def test_a_build_keeps_nothing_and_what_it_saves_does_not_depend_on_a_state(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRILLS_PROGRESS", "none")
    monkeypatch.setenv("DRILLS_WORK", str(tmp_path / "work"))
    panel = a_panel("drill")
    text = panel._repr_mimebundle_()["text/plain"]
    panel.reveal()
    panel.rate(4)
    assert list(tmp_path.iterdir()) == [] and panel.entry is None
    assert panel._repr_mimebundle_()["text/plain"] == text


def test_formulas_pass_through_and_markup_does_not() -> None:
    page = rendered(r"*so* $a_1 \, b_{2} < c_1$ <script>x</script> and `q_1`")
    assert r"$a_1 \, b_{2} &lt; c_1$" in page and "<em>so</em>" in page
    assert "<script>" not in page and "<code>q_1</code>" in page


def test_what_is_missing_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsrs", None)
    assert "fsrs is not installed" in repr(flashcards())
    with pytest.raises(ValueError, match="kind"):
        flashcards(kinds=["joke"])
