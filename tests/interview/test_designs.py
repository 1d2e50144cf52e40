"""The four designs: complete, drawn without a knot, and scored as a reader scores."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import derivations
from course.derivations.records import figure
from course.interview import designs
from course.interview.fields import FIELD
from tests import budget

DESIGNS = {name: designs.read(name) for name in designs.NAMES}
WEAK = sorted((Path(__file__).parent / "weak_answers").glob("*.toml"))
every = pytest.mark.parametrize("name", DESIGNS)


@every
def test_a_design_has_all_its_parts_and_its_figures(name: str) -> None:
    design = DESIGNS[name]
    known = {"estimate", "chart", "drawing", *(item.id for item in derivations.claims())}
    for text in design.texts():
        assert {m[1] for m in FIELD.finditer(text)} <= known
    shown = design.markdown(figure)
    assert "{" not in shown and design.title in shown
    assert len(design.filled(design.answer, figure).split()) <= designs.WORDS
    assert len(design.clarify) >= 5 and len(design.red_flags) >= 5
    assert shown.count("<details>") == 5


def test_the_designs_of_the_folder_are_those_that_are_asked() -> None:
    assert {path.stem for path in designs.FOLDER.glob("*.md")} == set(DESIGNS)


@every
def test_the_model_answer_scores_full_and_each_passage_earns_its_item(name: str) -> None:
    design = DESIGNS[name]
    result = designs.levels(design, design.filled(design.answer, figure))
    assert result == dict.fromkeys(result, "defended") and designs.score(design, result) == 1.0
    for item, passage in designs.passages(design, figure).items():
        assert designs.levels(design, passage)[item] == "defended", item
        # Without its doubt it is quantified, without its digits named.
        certain = re.sub(designs._MIND, "", passage)
        assert designs.levels(design, certain)[item] == "quantified", item
        assert designs.levels(design, re.sub(r"\d", "", certain))[item] == "named", item


def test_weak_answers_score_what_a_reader_gave_them() -> None:
    assert len(WEAK) == 3 * len(DESIGNS)
    same, items = 0, 0
    for path in WEAK:
        retained = tomllib.loads(path.read_text(encoding="utf-8"))
        design = DESIGNS[retained["design"]]
        result = designs.levels(design, retained["text"])
        theirs = designs.score(design, retained["levels"])
        assert theirs < 0.6
        assert designs.score(design, result) == pytest.approx(theirs, abs=0.15), path.name
        same += sum(result[item] == level for item, level in retained["levels"].items())
        items += len(result)
    assert same >= 0.9 * items


@every
def test_words_alone_name_and_nothing_is_missing_from_nothing(name: str) -> None:
    design = DESIGNS[name]
    assert set(designs.levels(design, "").values()) == {"missing"}
    # The rubric itself, read back: words, and neither figures nor doubts.
    result = designs.levels(design, "\n\n".join(item.asks for item in design.rubric))
    assert set(result.values()) <= {"missing", "named"} and designs.score(design, result) > 0.2


@pytest.mark.parametrize("standard", ["ISO 13482", "ISO 10218-1:2025", "IEC 61508", "ISO/TS 15066"])
def test_the_number_of_a_standard_names_one(standard: str) -> None:
    result = designs.levels(DESIGNS["among_people"], f"I begin with {standard}.")
    assert result["hazards"] == "named"
    assert designs.levels(DESIGNS["among_people"], "I isolate it.")["hazards"] == "missing"


@given(st.permutations(WEAK), st.integers(1, 4))
@budget.examples(20)
def test_saying_more_never_lowers_a_level(paths, n: int) -> None:
    texts = [tomllib.loads(path.read_text(encoding="utf-8"))["text"] for path in paths[: n + 1]]
    for design in DESIGNS.values():
        less, more = (designs.levels(design, "\n\n".join(part)) for part in (texts[:n], texts))
        steps = designs.LEVELS.index
        assert all(steps(more[item]) >= steps(less[item]) for item in less)


def test_the_score_counts_steps_and_the_weakest_item_is_asked_about() -> None:
    design = DESIGNS["pick_and_place"]
    names = [item.name for item in design.rubric]
    answered = dict.fromkeys(names, "named") | {names[3]: "defended", names[5]: "missing"}
    # Eight of one point, one of three, one of none, of thirty.
    assert designs.score(design, answered) == pytest.approx(11 / 30)
    assert designs.weakest(design, answered).name == names[5]
    with pytest.raises(ValueError, match="answered must be"):
        designs.score(design, {names[0]: "named"})
    with pytest.raises(ValueError, match=rf"{names[0]} must be .*, got 'good'"):
        designs.score(design, answered | {names[0]: "good"})


def test_the_age_of_a_drawing_is_the_sum_of_its_parts() -> None:
    design = DESIGNS["fleet_simulation"]
    scan, speeds = (next(a for a in design.arrows if a.what == what) for what in design.path)
    least, half = scan.ms + speeds.ms, 500.0 / scan.hz + 500.0 / speeds.hz
    assert design.drawn("least_ms") == pytest.approx(least)
    assert design.drawn("mean_ms") == pytest.approx(least + half)
    assert design.drawn("greatest_ms") == pytest.approx(least + 2.0 * half)
    assert design.drawn("scan.hz") == scan.hz
    fast = [replace(arrow, hz=10.0 * arrow.hz) for arrow in design.arrows]
    with pytest.raises(ValueError, match="execution time of scan"):
        replace(design, arrows=fast).drawn("mean_ms")
    with pytest.raises(ValueError, match=r"drawing must be .*, got 'scan'"):
        design.drawn("scan")


@every
def test_nothing_in_a_drawing_covers_anything(name: str) -> None:
    design = DESIGNS[name]
    text = designs.svg(design)
    words = re.findall(r'<text x="(\d+)" y="(\d+)" text-anchor="(\w+)">([^<]*)</text>', text)
    assert {w[3] for w in words} == {
        *design.boxes,
        *(a.what for a in design.arrows),
        *(str(a) for a in design.arrows),
    }
    wide, high = map(int, re.findall(r'viewBox="0 0 (\d+) (\d+)" width', text)[0])
    areas = []
    for x, y, anchor, label in words:
        length = 6.5 * len(label)
        remaining = int(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * length
        areas.append((remaining, int(y) - 9, remaining + length, int(y) + 1))
    rims = [
        (int(x), int(y), int(x) + 120, int(y) + 40)
        for x, y in re.findall(r'<rect x="(\d+)" y="(\d+)"', text)
    ]
    inside = [a for a, w in zip(areas, words, strict=True) if w[3] not in design.boxes]
    for a, b in combinations([*inside, *rims], 2):
        assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1], (a, b)
    assert all(0 <= a[0] and a[2] <= wide and 0 <= a[1] and a[3] <= high for a in areas)
    ends = [tuple(map(int, e)) for e in re.findall(r"M(\d+) (\d+)L(\d+) (\d+)", text)]
    for x, y, u, v in ends:
        middle = (0.5 * (x + u), 0.5 * (y + v))
        assert not any(r[0] < middle[0] < r[2] and r[1] < middle[1] < r[3] for r in rims)
    lines = designs.plain(design).splitlines()
    assert len(lines) == len(design.arrows) and max(map(len, lines)) <= 80


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"answer": "The bin takes 5 s."}, "passage of cycle"),
        ({"follow_ups": ("And then?",)}, r"follow_ups must be .*, got 1"),
        ({"path": ("depth picture", "torques")}, r"path must be .*, got 'torques'"),
        ({"path": ("smoke",)}, r"path must be .*, got 'smoke'"),
        ({"boxes": {"camera": (0, 0)}}, "the end of an arrow"),
        ({"red_flags": ("Below 10 N.",)}, r"a typed number must be .*, got '10'"),
    ],
)
def test_a_faulty_design_is_refused(changes, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        replace(DESIGNS["pick_and_place"], **changes)
    with pytest.raises(ValueError, match=f"up to {designs.WORDS} words"):
        replace(DESIGNS["pick_and_place"], answer=DESIGNS["pick_and_place"].answer + " so" * 900)
    with pytest.raises(ValueError, match=r"rubric must be .*, got 1"):
        replace(DESIGNS["pick_and_place"], rubric=DESIGNS["pick_and_place"].rubric[:1])


def test_a_name_that_is_no_design_is_refused() -> None:
    with pytest.raises(ValueError, match=r"name must be .*, got 'warp_drive'"):
        designs.read("warp_drive")
