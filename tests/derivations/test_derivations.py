"""Every claim is settled again and compared with its record; and the doors to them."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from course import derivations
from course.derivations import Verdict, claim, claims, records, run
from course.derivations.__main__ import main, select, shown

ALL = claims()
FILE = "rigid_body.time_step"
QUICK = "determinant_one_is_stable"
# What chapter 3 settles without Drake and PyBullet.
WITHOUT = {
    "rk4_and_contact", "pyramid_inscribed", "creep_not_friction", "default_of_learning",
    "python_first", "opened", "fewer_environments", "steps_per_second", "radar_area",
    "hello_world_winds", "motor_is_torque", "damping_realism", "servo_droops",
}  # fmt: skip


def refuse(missing):
    raise ImportError(missing)


@pytest.mark.slow
@pytest.mark.parametrize("item", ALL, ids=lambda item: item.id)
def test_verdict_and_figures_reproduce(item):
    try:
        outcome = run(item.id)
    except ImportError as missing:
        if os.environ.get("COURSE_REQUIRE_EXTRAS") == "1":
            raise
        pytest.skip(str(missing))
    assert outcome.agrees, "\n".join(outcome.disagreements)


@pytest.mark.slow
@pytest.mark.parametrize("item", ALL, ids=lambda item: item.id)
def test_texts_are_complete(item):
    assert len(item.claim) > 15 and len(item.corrected) > 15
    assert item.claim.strip().rstrip(".") != item.corrected.strip().rstrip(".")
    assert run(item.id).finding.statement


def test_the_record_holds_the_claims_there_are():
    for file in records.files():
        assert set(records.load(file)) <= {item.id for item in ALL if item.file == file}, file


def test_ids_are_unique_and_chapters_covered():
    ids = [item.id for item in ALL]
    assert len(ids) == len(set(ids))
    assert sum(len(claims(number)) for number in {item.chapter for item in ALL}) == len(ALL)
    assert len(claims(1)) >= 60 and len(claims(8)) >= 10


def test_some_claims_fail_and_some_hold():
    verdicts = [run(item.id).finding.verdict for item in ALL]
    assert all(verdicts.count(v) >= 5 for v in Verdict)


def test_an_id_that_is_taken_is_refused():
    taken = dict.fromkeys(["semi_implicit_limit"], ALL[0])
    check = derivations.CLAIMS["semi_implicit_limit"].check
    with pytest.raises(ValueError, match="must be unique"):
        claim("Something else.", "Something.", registry=taken)(check)


def test_figure_is_computed_once_per_process(monkeypatch):
    calls = []

    def check(found):
        calls.append(1)
        return determinant.check(found)

    determinant = derivations.CLAIMS["determinant_one_is_stable"]
    counted = replace(determinant, id="counted_once", check=check)
    monkeypatch.setitem(derivations.CLAIMS, "counted_once", counted)
    first = derivations.figure("counted_once", "outer_at_2_1")
    assert derivations.figure("counted_once", "outer_at_2_1") == first
    assert len(calls) == 1


def test_figure_and_show():
    limit = derivations.figure("semi_implicit_limit", "limit_ms")
    assert limit == pytest.approx(2000 / 100_000**0.5, rel=1e-9)
    block = derivations.show("semi_implicit_limit")
    assert "6.3246" in repr(block) and "6.3246" in block._repr_markdown_()
    assert "0x" not in repr(block)


@pytest.mark.topic("platforms")
@pytest.mark.parametrize("item", claims(3), ids=lambda item: item.id)
def test_without_a_simulator_a_card_shows_the_record_and_says_so(item, monkeypatch):
    from course.oracles import drake, pybullet

    needed = set()

    def lacks(name):
        def missing(*_):
            needed.add(name)
            return f"this needs {name}: make platforms"

        return missing

    for module, engine in ((drake, drake.Drake), (pybullet, pybullet.PyBullet)):
        missing = lacks(engine.name)
        monkeypatch.setattr(engine, "missing", missing)
        monkeypatch.setattr(module, "library", lambda say=missing: refuse(say()))
    monkeypatch.setattr(derivations, "run", derivations.run.__wrapped__)
    if item.id not in WITHOUT:
        block = derivations.show(item.id)
        assert needed and needed.pop() in block.outcome.finding.statement
        entry = records.load(item.file)[item.id]
        assert block.outcome.finding.verdict.value == entry["verdict"]
        assert "{" not in block.outcome.corrected + block.outcome.condition


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: derivations.figure("no_such_claim", "x"), "no_such_claim"),
        (lambda: derivations.figure("semi_implicit_limit", "nothing"), "limit_ms"),
        (lambda: derivations.claims(77), "77"),
        (lambda: derivations.show("no_such_claim"), "no_such_claim"),
        (lambda: derivations.show("rk4_limt"), "did you mean rk4_limit"),
        (lambda: derivations.answer("planar_state", "6"), "semi_implicit_limit"),
    ],
)
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_importing_is_light():
    code = (
        "import sys, course.derivations as d; d.claims();"
        "heavy = {'sympy', 'mujoco', 'scipy', 'matplotlib', 'torch'} & set(sys.modules);"
        "print(sorted(heavy))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


@pytest.fixture
def changed(monkeypatch):
    """Changes a real claim for one test."""

    def change(**fields):
        item = replace(derivations.CLAIMS[QUICK], **fields)
        monkeypatch.setitem(derivations.CLAIMS, QUICK, item)
        # What the other claims gave is kept, as `test_mutations.py` asks for it too.
        monkeypatch.setattr("course.derivations.__main__.run", derivations.run.__wrapped__)

    return change


@pytest.mark.slow
def test_command_prints_a_table_of_80_columns():
    result = subprocess.run(
        [sys.executable, "-m", "course.derivations", "--id", "semi_implicit_limit"],
        capture_output=True,
        text=True,
        env={"COLUMNS": "80", "PATH": "/usr/bin:/bin", "HOME": "/nonexistent", "LANG": "C.UTF-8"},
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "semi_implicit_limit" in result.stdout and "limit_ms = 6.3246" in result.stdout
    assert max(len(line) for line in result.stdout.splitlines()) <= 80


def test_command_prints_json():
    result = CliRunner().invoke(main, ["1", "--id", QUICK, "--json"])
    (data,) = json.loads(result.stdout)
    assert data["verdict"] == "holds only if" and data["condition"]
    assert data["figures"]["outer_at_2_1"] == pytest.approx(-1.877328, rel=1e-6)
    assert data["disagreements"] == []
    assert result.exit_code == 0


def test_command_exits_with_1_when_something_disagrees(changed):
    changed(corrected="It is always stable.")
    result = CliRunner().invoke(main, ["--id", QUICK])
    assert result.exit_code == 1 and "DISAGREES" in result.output


def test_a_check_that_breaks_is_reported_not_raised(changed):
    changed(check=lambda found: 1 / 0)
    result = CliRunner().invoke(main, ["--id", QUICK])
    assert result.exit_code == 1 and "ZeroDivisionError" in result.output


@pytest.mark.parametrize("arguments", [("77",), ("juggling",), ("--id", "no_such_claim")])
def test_command_refuses_what_is_not_there(arguments):
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert arguments[-1] in result.stderr


def test_command_selects_by_chapter_topic_and_file():
    assert select("1", ()) == claims(1) == select("rigid_body", ())
    assert {item.file for item in select(FILE, ())} == {FILE}
    assert select(None, ()) == claims()


def test_what_a_notebook_shows_is_a_claim_of_its_chapter_or_one_before():
    sources = Path(__file__).parents[2] / "notebooks" / "source"
    for path in sources.glob("[0-9][0-9]_*.py"):
        named = set(re.findall(r'\b(?:show|answer|figure)\(\s*"(\w+)"', path.read_text("utf-8")))
        there = {item.id for item in ALL if item.chapter <= int(path.name[:2]) and shown(item)}
        assert named <= there, path.name
    assert shown(derivations.CLAIMS["semi_implicit_limit"])
    assert not shown(derivations.CLAIMS[QUICK])


# --- writing the record -------------------------------------------------------------------------


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """The record of one file in a folder of its own, and the command there."""
    text = (records.FOLDER / f"{FILE}.toml").read_text(encoding="utf-8")
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    records.load.cache_clear()
    path = tmp_path / f"{FILE}.toml"
    path.write_text(text, encoding="utf-8")
    yield path, lambda *arguments: CliRunner().invoke(main, [*arguments, "--record"])
    records.load.cache_clear()


def test_record_writes_nothing_when_nothing_changed(copied):
    path, command = copied
    before = path.read_text(encoding="utf-8")
    result = command(FILE)
    assert (result.exit_code, result.output) == (0, "")
    assert path.read_text(encoding="utf-8") == before


def test_record_prints_what_changes_and_touches_only_what_was_asked_for(copied):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    wrong = right.replace("[-1.877328045, 1e-06]", "[-1.9, 1e-06]").replace(
        'verdict = "holds"\n', 'verdict = "false"\n'
    )
    path.write_text(wrong, encoding="utf-8")
    records.load.cache_clear()
    result = command("--id", QUICK)
    assert result.exit_code == 0
    assert result.output.startswith(f"{QUICK}: outer_at_2_1 is -1.87")
    assert len(result.output.splitlines()) == 1
    half = path.read_text(encoding="utf-8")
    assert "-1.877328045" in half and 'verdict = "holds"\n' not in half
    result = command(FILE)
    assert result.output == "semi_implicit_limit: verdict on record: 'false'; found: 'holds'\n"
    assert path.read_text(encoding="utf-8") == right


def test_record_refuses_a_claim_that_fails_by_itself(copied, changed):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    changed(corrected="Below 1.5 m.")
    result = command("--id", QUICK)
    assert result.exit_code == 1 and "NOT WRITTEN: '1.5 m'" in result.output
    assert path.read_text(encoding="utf-8") == right


def test_record_drops_a_claim_that_is_gone(copied):
    path, command = copied
    right = path.read_text(encoding="utf-8")
    gone = right.replace(f"[{QUICK}]", "[gone]").replace(f"[{QUICK}.figures]", "[gone.figures]")
    path.write_text(gone, encoding="utf-8")
    records.load.cache_clear()
    result = command(FILE)
    assert f"{QUICK}: not on record" in result.output and "gone: leaves the record" in result.output
    assert path.read_text(encoding="utf-8") == right
