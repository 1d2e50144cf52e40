"""The tables: their form, what they quote, and that every figure is where it is said to be."""

from __future__ import annotations

import html
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import CHAPTERS, derivations
from course.derivations import records
from course.interview import chart_data, fields, tables, typed_numbers
from course.measure import data
from tests.budget import examples

SOURCES = Path(__file__).parents[2] / "notebooks" / "source"
HEADINGS = {
    chapter.topic: re.findall(
        r"^# #{2,3} (.+)$",
        (SOURCES / f"{chapter.number:02d}_{chapter.topic}.py").read_text(encoding="utf-8"),
        re.M,
    )
    for chapter in CHAPTERS
    if chapter.number < 12
}
SHEET, READING = tables.data("cheat_sheet"), tables.data("reading")
DOI, ARXIV = re.compile(r"10\.\d{4,9}/\S+"), re.compile(r"\d{4}\.\d{4,5}")


def _chart(monkeypatch, tmp_path, document: dict) -> None:
    (tmp_path / "made.json").write_text(json.dumps(document), encoding="utf-8")
    monkeypatch.setattr(data, "FOLDER", tmp_path)
    chart_data._data.cache_clear()


LINE = {"label": "a line, of two", "x": [1.0, 3.0, 5.0], "y": [0.0, 1.0, 9.0], "low": [0, 0, 5]}
POINT = {"parameter": 1.0, "count": 1.0, "failure": ""}
WORK = {
    "tolerance": 0.1,
    "curves": [
        {"name": "fast, wrong", "style": "ours", "points": [{**POINT, "error": 0.5, "time": 1.0}]},
        {"name": "ours", "style": "ours", "points": [{**POINT, "error": 0.1, "time": 3.0}]},
        {
            "name": "theirs",
            "style": "oracle",
            "points": [
                {**POINT, "error": 0.01, "time": 2.0},
                {**POINT, "error": 0.1, "time": 4.0},
                {**POINT, "error": 0.0, "time": 0.1, "failure": "lost"},
            ],
        },
    ],
}


@pytest.mark.parametrize(
    ("steps", "result"),
    [
        ("0/a line/y/1", 1.0),
        ("0/a line/y/-1", 9.0),
        ("top/0/y@2", 0.5),
        ("0/0/low@4", 2.5),
        ("0/0/x@5", 4.0),
        ("0/0/x@low=2.5", 4.0),
        ("0/0/y/max", 9.0),
        ("0/0/x/min", 1.0),
        ("0/names/y@b", 8.0),
        ("0/0/label", "a line, of two"),
    ],
)
def test_a_chart_is_read_by_steps(monkeypatch, tmp_path, steps: str, result) -> None:
    other = {"label": "names", "x": ["a", "b"], "y": [7.0, 8.0]}
    _chart(monkeypatch, tmp_path, {"panels": [{"title": "top", "series": [LINE, other]}]})
    assert fields.chart(f"made/{steps}") == result


@pytest.mark.parametrize(
    ("steps", "result"),
    [
        ("pick/name", "theirs"),
        ("ours/pick/time", 3.0),
        ("oracle/pick/time", 2.0),
        ("fast/0/error", 0.5),
        ("theirs/pick/error", 0.01),
        ("tolerance", 0.1),
    ],
)
def test_a_pick_is_the_cheapest_within_the_tolerance(monkeypatch, tmp_path, steps, result) -> None:
    _chart(monkeypatch, tmp_path, WORK)
    assert fields.chart(f"made/{steps}") == result


def test_a_share_is_shown_in_percentage_points() -> None:
    assert fields.filled("{a.b:points}", lambda *_: 0.0466) == "4.7"
    assert fields.filled("{a.b:points}", lambda *_: 0.08) == "8"


@pytest.mark.parametrize(
    ("field", "text"),
    [
        ("chart.made/0/nothing", r"must be .*a line, of two.*, got 'nothing'"),
        ("chart.made/0/a", "must be 0 to 1"),
        ("chart.made/0/a line", "to a number or a word"),
        ("chart.made/0/a line/y@6", "must be an x from 1 to 5"),
        ("chart.made/0/a line/x@10", "a y between 0 and 9"),
        ("chart.lost/0", r"chart must be .*, got 'lost'"),
        ("chart.made/0/a line/y@b", r"place of .* must be .*, got 'b'"),
        ("estimate.lost", r"estimate must be .*, got 'lost'"),
        ("estimate.rays.colour", r"input of rays must be one of robots.*, got 'colour'"),
        ("no_such_claim.x", r"id must be .*, got 'no_such_claim'"),
        ("trials_to_tell.x", r"name must be .*, got 'x'"),
    ],
)
def test_a_field_that_nothing_fills_is_refused(monkeypatch, tmp_path, field, text) -> None:
    two = [LINE, {**LINE, "label": "a lost one"}]
    _chart(monkeypatch, tmp_path, {"panels": [{"title": "top", "series": two}]})
    with pytest.raises(ValueError, match=text):
        fields.filled(f"It is {{{field}:.3g}}.", records.figure)


@examples(60)
@given(st.lists(st.floats(-9, 9), min_size=2, max_size=6, unique=True), st.floats(0.01, 0.99))
def test_what_is_read_off_lies_on_the_line(ys: list[float], part: float) -> None:
    series = {"x": [2.0 * i for i in range(len(ys))], "y": ys}
    expected = (1 - part) * ys[0] + part * ys[1]
    x = chart_data._read_off(series, "x", repr(expected), "made")
    assert np.interp(x, series["x"], ys) == pytest.approx(expected, abs=1e-9)
    assert chart_data._read_off(series, "y", repr(x), "made") == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("seconds", "expected"),
    [(2.0, "2 s"), (0.1584, "160 ms"), (9.65e-4, "960 us"), (1e-3, "1 ms"), (2e-8, "0.02 us")],
)
def test_seconds_get_a_unit_that_fits(seconds: float, expected: str) -> None:
    text = fields.filled("{a.b:time}", lambda *_: seconds)
    assert text in (expected, expected.replace("960", "970"))


# --- The tables -----------------------------------------------------------------------------------


def test_the_tables_have_their_rows_and_columns() -> None:
    sizes = [(len(t().rows), len(t().head)) for t in tables.TABLES]
    assert sizes == [(8, 6), (5, 4), (11, 4), (4, 2)]
    assert [len(READING[kind]) for kind in ("book", "paper", "repository")] == [1, 5, 5]
    topics = [row["chapter"] for row in SHEET["row"]]
    assert len(set(topics)) == 8 and set(topics) <= HEADINGS.keys()


@pytest.mark.parametrize("row", SHEET["row"], ids=lambda row: row["chapter"])
def test_thirty_seconds_end_with_what_was_measured(row) -> None:
    text = fields.filled(row["measured"], records.figure)
    pick, limit = text.split(" Limit: ")
    # Three words a second, and what is measured has figures: an error or share, costs, the limit.
    assert len(f"{row['says']} {text}".split()) <= 95
    assert len(re.findall(r"\d", pick)) >= 3 and re.search(r"\d", limit)
    assert len(re.findall(r"[\d.]+ (?:s|ms|us)\b", pick)) >= 2, "ours and the library's cost"
    assert typed_numbers(f"{row['says']} {row['measured']}") == []


@pytest.mark.parametrize("row", SHEET["row"], ids=lambda row: row["chapter"])
def test_an_equation_is_settled_by_a_claim_of_its_chapter(row) -> None:
    claim = next(item for item in derivations.claims() if item.id == row["claim"])
    assert claim.file.split(".")[0] == row["chapter"]


@pytest.mark.parametrize(
    ("topic", "formula"), [("control", "2*b/(h+2*D)"), ("sim_to_real", "gamma*eps*R/(1-gamma)^2")]
)
def test_where_the_claim_has_the_formula_the_sheet_has_the_same(topic: str, formula: str) -> None:
    row = next(row for row in SHEET["row"] if row["chapter"] == topic)
    assert derivations.answer(row["claim"], formula).correct
    assert row["plain"].replace(" ", "").endswith(formula.replace("*", ""))


@pytest.mark.parametrize("part", SHEET["component"], ids=lambda part: part["name"])
def test_a_switch_is_a_measured_crossing_or_is_not_measured(part) -> None:
    when = part["when"]
    assert part["chapter"] in HEADINGS
    assert typed_numbers(" ".join((part["classical"], part["learned"], when))) == []
    bands = ("low", "high", "half_width")
    assert when == tables.NOT_MEASURED or any(band in when for band in bands)
    assert (when == tables.NOT_MEASURED) == (part["chapter"] == "contact")


def test_the_bar_of_the_learned_controller_is_the_one_that_was_measured() -> None:
    (bar,) = set(re.findall(r"x@(?:low|high)=([\d.]+)", SHEET["component"][1]["when"]))
    measured = fields.chart("tracking_laws/1/PD + gravity/y/-1")
    assert float(bar) == pytest.approx(float(measured), rel=1e-2)


def test_no_figure_that_is_quoted_has_moved() -> None:
    known = tomllib.loads(tables.RECORD.read_text(encoding="utf-8"))
    now = tables.quoted()
    assert now.keys() == known.keys()
    for key, was in known.items():
        assert records.close(was, 0.02, now[key]), (
            f"{key} was {was}, is {now[key]}: read the sentences that quote it, then "
            "`python -m course.interview.tables --record`"
        )


def test_a_terminal_shows_80_columns_and_a_page_all_cells() -> None:
    for table in (make() for make in tables.TABLES):
        text = table.text()
        assert max(map(len, text.splitlines())) <= 80
        words = {word for row in table.rows for cell in row for word in cell.split()}
        assert words <= set(text.split())
        assert table.markdown().count("\n") == len(table.rows) + 1
    result = {html.unescape(cell) for cell in re.findall("<td>(.*?)</td>", tables.page())}
    assert {cell for row in tables.cheat_sheet(plain=True).rows for cell in row} == result


def test_a_row_that_lacks_a_cell_is_refused() -> None:
    with pytest.raises(ValueError, match=r"a row of T must be 2 cells, none empty"):
        tables.Table("T", ("a", "b"), (("1", ""),))


# --- Reading --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", READING["works"])
def test_a_work_is_complete_and_used(name: str) -> None:
    work = READING["works"][name]
    assert {"authors", "title", "year", "venue", "place"} <= work.keys()
    assert 1900 < work["year"] < 2030 and name.endswith(f"_{work['year']}")
    assert "doi" in work or "arxiv" in work
    assert DOI.fullmatch(work.get("doi", "10.1000/x"))
    assert ARXIV.fullmatch(work.get("arxiv", "2101.00001"))
    if "arxiv" in work:  # the number says when it came, and a venue does not print it earlier
        assert 2000 + int(work["arxiv"][:2]) <= work["year"]
    users = [row[kind] for row in SHEET["row"] for kind in ("classic", "modern")]
    users += [e["work"] for kind in ("book", "paper", "repository") for e in READING[kind]]
    assert name in users


def test_nothing_is_listed_twice() -> None:
    works = READING["works"].values()
    for key in ("title", "doi", "arxiv"):
        values = [work[key].lower() for work in works if key in work]
        assert len(values) == len(set(values))
    assert len({e["name"] for e in READING["repository"]}) == 5
    assert len({e["work"] for kind in ("book", "paper") for e in READING[kind]}) == 6


@pytest.mark.parametrize(
    "entry",
    [e for kind in ("book", "paper", "repository") for e in READING[kind]],
    ids=lambda e: e.get("name", e["work"]),
)
def test_what_is_read_serves_a_section_that_is_there(entry) -> None:
    assert entry["work"] in READING["works"] and entry["says"].endswith(".")
    assert re.fullmatch(r"[\w-]+/[\w-]+", entry.get("name", "a/b"))
    for place in entry["serves"]:
        topic, heading = place.split(": ")
        assert any(head.startswith(heading) for head in HEADINGS[topic]), place
