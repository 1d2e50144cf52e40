"""Each row of the table of jobs follows from the stored tables, and from nothing else."""

import json
import re

import pytest

from course.charts.platforms import jobs, table
from course.platforms.choose import Need, choose
from tests.budget import ROOT

ROWS = table.stored_rows()
PATHS = table.stored_rows("platform_paths")
# Scenes whose tolerance a job needs, the scene that ranks, the pick, who is out.
MEASURED = {
    "RL training, one world on a CPU": (("grasp",), "grasp", "MuJoCo", {"PyBullet"}),
    "Manipulation research": (("grasp", "brake", "tower"), "tower", "MuJoCo", {"PyBullet"}),
    "A quick prototype": ((), "tower", "MuJoCo", {"own code", "PyBullet"}),
}
UNKNOWN = {
    "RL training, from images": ("10,000 camera images per second", "Isaac Lab"),
    "Visual perception": ("photorealistic cameras", "Isaac Sim"),
    "Control that is proved safe": ("proof of safety, contacts included", "Drake"),
    "Soft, deformable objects": ("finite elements", "SOFA"),
}


def with_errors(scene: str, engine: str, error: float):
    """The rows with another error of an engine, fair, in a scene."""
    key = [scene, engine, "fair"]
    return [[*r[:4], error, *r[5:]] if list(r[:3]) == key else r for r in ROWS]


def test_there_are_seven_jobs_and_the_page_shows_what_is_computed_for_each() -> None:
    assert set(jobs.JOBS) == {*MEASURED, *UNKNOWN} and len(jobs.JOBS) == 7
    page = json.loads((ROOT / "notebooks" / "03_platforms.ipynb").read_text(encoding="utf-8"))
    shown = [
        "".join(o["data"].get("text/markdown", ""))
        for cell in page["cells"]
        for o in cell.get("outputs", [])
        if "data" in o
    ]
    head = "| Job | Needs | Pick | Why |"
    (lines,) = (text.splitlines()[2:] for text in shown if text.startswith(head))
    facts = jobs.facts()["MuJoCo"]

    def limits(job: str) -> str:
        """Return the needs of a job as the page states them."""
        return "; ".join(
            need.row
            if need.sense == "is"
            else f"{need.row} {need.sense} {need.limit:g} {facts[need.row].unit}".strip()
            for need in jobs.JOBS[job][0]
        )

    assert lines == [
        "| " + " | ".join((job, limits(job), *jobs.decide(job))) + " |" for job in jobs.JOBS
    ]


@pytest.mark.parametrize("job", MEASURED)
def test_a_pick_is_the_cheapest_that_keeps_the_tolerances_of_the_table(job) -> None:
    scenes, by, pick, out = MEASURED[job]
    tolerance = {row[0]: row[6] for row in ROWS}
    able = {
        e for e in table.ENGINES if all(table.errors(ROWS, s)[e] <= tolerance[s] for s in scenes)
    }
    if job == "A quick prototype":  # our code is no package, and PyBullet swallows most faults
        read = [r for r in table.stored_rows("platform_readers") if r[2] != "feature"]
        for reader in ("MuJoCo", "Drake", "PyBullet"):
            report = [r[3] in ("refused", "warned") for r in read if r[0] == reader]
            assert (sum(report) >= 0.75 * len(report)) == (reader != "PyBullet")
        able &= {"MuJoCo", "Drake"}
    result = choose(jobs.facts(), *jobs.JOBS[job])
    assert {one.engine for one in result.ranking} == able == set(table.ENGINES) - out
    assert result.pick == pick == min(able, key=lambda e: table.costs(ROWS, by)[e])
    text, why = jobs.decide(job)
    assert text == pick and all(row in why for row in result.deciding)
    # The named limit turns it, and each measured row that it needs can take the pick away.
    needs, cost = jobs.JOBS[job]
    assert result.turn
    printed = re.search(
        rf"With a limit (?:of|below|above) ([\d.e+-]+)( m)? for {result.turn.row}", why
    )
    assert printed
    for limit in (result.turn.limit, float(printed[1])):
        turned = [Need(n.row, limit, n.sense) if n.row == result.turn.row else n for n in needs]
        assert choose(jobs.facts(), turned, cost).pick == result.turn.pick != pick
    for scene in scenes:
        bad = with_errors(scene, pick, 2.0 * tolerance[scene])
        # What brakes is judged on its way: its largest error counts, not the one at the end.
        on_the_way = [
            [*r[:5], 2.0 * r[7] if r[:2] == [scene, pick] else r[5], *r[6:]] for r in PATHS
        ]
        assert jobs.decide(job, bad, on_the_way)[0] != pick
        if scene == "brake":
            assert jobs.decide(job, bad)[0] == pick != jobs.decide(job, None, on_the_way)[0]
    if scenes:  # and PyBullet, second in cost, would come in by the row that it fails
        retained = with_errors("grasp", "PyBullet", 1e-4)
        assert "PyBullet" in {
            one.engine for one in choose(jobs.facts(retained), needs, cost).ranking
        }


@pytest.mark.parametrize("job", UNKNOWN)
def test_where_nothing_was_measured_no_table_makes_a_pick(job) -> None:
    row, cited = UNKNOWN[job]
    for rows in (ROWS, [[*r[:4], 0.0, *r[5:]] for r in ROWS]):
        pick, why = jobs.decide(job, rows)
        assert pick == "not measured here"
        assert why.startswith(f"{row}: not measured for any of the four.")
    assert cited in why and any(f"20{year}" in why for year in range(23, 27))
    assert not any(mine[row].known for mine in jobs.facts().values())
    rest = [need for need in jobs.JOBS[job][0] if need.row != row]
    assert choose(jobs.facts(), rest, jobs.JOBS[job][1]).pick == "MuJoCo"


def test_the_hand_has_no_answer_until_the_worlds_are_measured() -> None:
    result = jobs.facts()
    assert choose(result, [*jobs.HELD, jobs.WORLDS], "cost of grasp").pick is None
    tight = [Need("grasp error", 1e-5, "at most")]
    assert choose(result, tight, "cost of grasp").pick == "own code"
