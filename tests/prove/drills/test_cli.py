"""The command `drills` where it takes long: every exercise from a file, and a chart."""

from __future__ import annotations

from pathlib import Path

import pytest

from drills import cards as catalogue
from tests.drills.place import RIGHT, Place, a_place

__all__ = ["a_place"]


@pytest.mark.parametrize("name", catalogue.names())
def test_every_exercise_is_checked_from_a_file(place: Place, name: str) -> None:
    path = place.folder / "somewhere.py"
    path.write_text(catalogue.card(name).solution_text(), encoding="utf-8")
    done = place.script("check", name, "--file", str(path))
    assert done.code == 0 and done.out.startswith("RIGHT"), done
    path.write_text("answer = 42\n")
    done = place.script("check", name, "--file", str(path))
    assert done.code == 1 and "is not defined" in done.out, done


def test_a_chart_is_written_for_a_right_answer(place: Place) -> None:
    place.answer(RIGHT)
    data = place.json("chart", "verlet", "-o", "picture.png")
    assert Path(data["picture"]).read_bytes().startswith(b"\x89PNG")
    assert "yours" in data["table"]
    assert not (place.work / "progress.json").exists()  # a chart is no attempt
