"""The command `drills` as somebody types it: commands, JSON, exit codes, files."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from course import CHAPTERS
from drills import cards as catalogue
from drills import catalogue as package
from drills import doctor, task_text, workspace
from drills import exercise as exercises
from drills.cards import Hint
from drills.cli import cli
from drills.reasons import Reason
from drills.terminal import to_ascii
from tests.drills.place import (
    COMMANDS,
    RIGHT,
    ROOT,
    SCHEMA,
    SCRIPT,
    VALIDATOR,
    WRONG,
    Place,
    a_place,
    in_terminal,
)

__all__ = ["a_place"]

FIRST = next(chapter for chapter in CHAPTERS if chapter.ready)


# --- A newcomer's way -----------------------------------------------------------------------------


def test_the_console_script_is_there() -> None:
    assert SCRIPT.exists(), "install the project again: the script `drills` is missing"


@pytest.mark.prove
@pytest.mark.smoke
def test_a_newcomer_starts_fails_asks_and_solves(place: Place) -> None:
    welcome = place.run()
    assert welcome.code == 0 and "drills start" in welcome.out and "verlet" in welcome.out

    started = place.run("start", "verlet")
    assert started.code == 0, started
    path = place.work / "verlet.py"
    head = path.read_text().split("\n\n")[0]
    assert "verlet" in head and "drills show verlet" in head and "drills check verlet" in head

    untouched = place.run("check", "verlet")
    assert untouched.code == 1 and "NOT ATTEMPTED" in untouched.out
    assert not (place.work / "progress.json").exists()

    place.answer(WRONG)
    wrong = place.run("check", "verlet")
    assert wrong.code == 1 and "NOT RIGHT" in wrong.out and "--seed" in wrong.out
    assert place.record()["state"] == "attempted"

    rejected = place.run("solution", "verlet")
    assert rejected.code == 2 and "--give-up" in rejected.err and rejected.out == ""

    hints = [place.run("hint", "verlet").out for _ in range(4)]
    assert [f"Hint {n} of 3" in text for n, text in zip((1, 2, 3, 3), hints, strict=True)]
    assert len(set(hints[:3])) == 3 and "last hint" in hints[3]

    place.answer(RIGHT)
    right = place.run("check", "verlet")
    assert right.code == 0 and right.out.startswith("RIGHT")
    record = place.record()
    assert (record["state"], record["attempts"], record["hints"]) == ("solved", 2, 3)
    assert record["best"]

    shown = place.run("solution", "verlet")
    assert shown.code == 0 and "def verlet_step" in shown.out
    status = place.run("status").out
    assert "1 of" in status and "verlet: 2 attempts" in status and "3 hints" in status
    assert "●" in next(line for line in place.run("list").out.splitlines() if " verlet " in line)


@pytest.mark.smoke
@pytest.mark.slow
def test_the_first_two_minutes_of_the_readme(place: Place) -> None:
    """The answer that it shows gets the feedback that it shows; with the change it is right."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (listing,) = re.findall(r"```python\n(import numpy as np\n.*?)```", readme, re.S)
    place.run("start", "fk3")
    place.answer(listing, "fk3")
    output = place.run("check", "fk3", "--seed", "1").out
    feedback = output.partition("\nCases:")[0].strip()
    assert "Likely cause" in feedback
    assert feedback in readme, output
    assert "Write `zip(lengths, np.cumsum(thetas))`" in readme
    better = listing.replace("zip(lengths, thetas)", "zip(lengths, np.cumsum(thetas))")
    place.answer(better, "fk3")
    assert place.run("check", "fk3").code == 0


def test_the_readme_of_the_drills_names_every_command_and_member() -> None:
    text = (ROOT / "drills" / "README.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"`drills {name}" not in text] == []
    members = [*SCHEMA["properties"], *SCHEMA["$defs"]["attempt"]["required"], "error"]
    missing = [name for name in members if f"`{name}`" not in text and name != "file"]
    assert missing == []


def test_python_dash_m_is_the_same_command(place: Place) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "drills", "list"],
        cwd=place.folder,
        env=place.environment,
        capture_output=True,
        text=True,
    )
    assert done.stdout == place.script("list").out == place.run("list").out


# --- JSON -----------------------------------------------------------------------------------------


def test_the_schema_is_a_schema_and_knows_every_command_and_reason() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert set(SCHEMA["properties"]["command"]["enum"]) == {*COMMANDS, "drills"}
    assert SCHEMA["$defs"]["reason"]["enum"] == [str(reason) for reason in Reason]
    described = [entry["if"]["properties"]["command"]["const"] for entry in SCHEMA["else"]["allOf"]]
    assert set(described) == set(COMMANDS)


def test_the_schema_refuses_what_is_missing() -> None:
    whole = {"schema": "drills/1", "command": "hint", "exit": 0, "notices": [], "drill": "x"}
    whole |= {"hints": [], "left": 0}
    VALIDATOR.validate(whole)
    for key in whole:
        broken = {k: v for k, v in whole.items() if k != key}
        assert not VALIDATOR.is_valid(broken), key


@pytest.mark.smoke
def test_the_json_of_the_quick_commands(place: Place) -> None:
    listed = place.json("list")
    assert [entry["drill"] for entry in listed["exercises"]] == catalogue.names()
    assert {entry["reason"] for entry in listed["reasons"]} == {str(r) for r in Reason}
    assert place.json()["command"] == "list"
    shown = place.json("show", "verlet")
    assert "Verlet" in shown["prompt"] and shown["examples"]
    assert place.json("start", "verlet")["created"] is True
    assert place.json("start", "verlet")["created"] is False
    assert place.json("hint", "verlet")["hints"][0]["number"] == 1
    assert place.json("status")["next"] == catalogue.names()[0]
    given_up = place.json("solution", "verlet", "--give-up")
    assert given_up["solution"] == RIGHT
    assert place.json("status")["exercises"]["verlet"]["gave_up"] is True
    assert place.json("reset", "verlet")["backup"] is None


def test_an_argument_is_marked_where_there_is_no_colour(place: Place) -> None:
    """`every` is also an English word; in the table it is alone in its column."""
    shown = place.run("show", "execute_chunks").out
    assert "0,\n`every`, `2 * every` and so on" in shown
    assert re.search(r"takes +every +number", shown)


@pytest.mark.prove
def test_what_to_do_next_is_chosen(place: Place) -> None:
    """By chapter, level and minutes; what was tried goes first, what is solved is gone."""
    every = [card for card in catalogue.cards()]
    names = [card.name for card in every]
    following = place.json("next")
    assert [entry["drill"] for entry in following["exercises"]] == names
    assert following["minutes"] == sum(card.minutes for card in every)
    assert following["reading"] == {"chapter": FIRST.number, "section": 1}
    for options, fits in (
        (["--chapter", "1"], lambda card: card.chapter == 1),
        (["--chapter", "1", "--chapter", "8"], lambda card: card.chapter in (1, 8)),
        (["--level", "3"], lambda card: card.difficulty == 3),
        (["--minutes", "15"], lambda card: card.minutes <= 15),
        (
            ["--chapter", "1", "--level", "2", "--minutes", "10"],
            lambda card: (card.chapter, card.difficulty) == (1, 2) and card.minutes <= 10,
        ),
    ):
        fitting = [card.name for card in every if fits(card)]
        assert 0 < len(fitting) < len(every)
        for command in ("next", "list"):
            chosen = place.json(command, *options)["exercises"]
            assert [entry["drill"] for entry in chosen] == fitting
    assert "Nothing fits" in place.run("list", "--minutes", "1").out
    assert "Nothing that fits" in place.run("next", "--minutes", "1").out
    place.answer(WRONG)
    place.run("check", "verlet")
    assert "Go on with verlet" in place.run("next").out
    assert place.json("status")["next"] == "verlet"
    place.answer(RIGHT)
    place.run("check", "verlet")
    names.remove("verlet")
    assert [entry["drill"] for entry in place.json("next")["exercises"]] == names


@pytest.mark.prove
def test_a_chapter_is_started_read_and_counted(place: Place) -> None:
    number = str(FIRST.number)
    path = Path((started := place.json("start", number))["file"])
    assert (started["state"], path.name) == ("made", Path(FIRST.notebook).name)
    assert path.parent == place.work and json.loads(path.read_text())["cells"]
    assert place.json("start", number)["state"] == "as it was"
    parts = place.json("read", number)["sections"]
    assert len(parts) > 5 and not any(part["read"] for part in parts)
    marked = place.json("read", number, "2", "1")["sections"]
    assert [part["number"] for part in marked if part["read"]] == [1, 2]
    assert place.json("next")["reading"] == {"chapter": FIRST.number, "section": parts[2]["number"]}
    assert place.json("read", number, "--checkpoint")["checkpoint"]
    row = next(row for row in place.json("status")["chapters"] if row["chapter"] == FIRST.number)
    assert row["read"] == 2 and row["sections"] == len(parts) and row["checkpoint"]
    assert row["reading_minutes"] == round(sum(part["minutes"] for part in parts[2:]))
    for row in place.json("status")["chapters"]:
        if row["sections"]:
            place.json("read", str(row["chapter"]), "--all")
    assert place.json("next")["reading"] is None
    undone = place.json("read", number, "2", "--checkpoint", "--undo")
    assert undone["checkpoint"] is None and not undone["sections"][1]["read"]


@pytest.mark.slow
def test_a_drill_is_checked_from_a_file(place: Place, name: str = "fk3") -> None:
    card = catalogue.card(name)
    path = place.folder / "somewhere.py"
    path.write_text(card.solution_text(), encoding="utf-8")
    right = place.json("check", name, "--file", str(path))
    assert (right["verdict"], right["reason"], right["exit"]) == ("pass", "right", 0), right
    path.write_text("answer = 42\n")
    wrong = place.json("check", name, "--file", str(path))
    assert (wrong["verdict"], wrong["reason"], wrong["exit"]) == ("fail", "missing_name", 1)


@pytest.mark.prove
def test_a_seed_draws_the_same_cases_again(place: Place) -> None:
    place.answer(WRONG)
    first = place.json("check", "verlet")
    again = place.json("check", "verlet", "--seed", str(first["seed"]))
    other = place.json("check", "verlet")
    assert first["checks"] == again["checks"]
    assert other["seed"] != first["seed"] and other["checks"] != first["checks"]


def test_the_rendered_feedback_comes_along(place: Place) -> None:
    data = place.json("check", "verlet", "--file", "-", "--rendered", "--called", "it", text=WRONG)
    assert data["file"] is None
    assert data["text"].startswith("NOT RIGHT") and "<table>" in data["html"]


@pytest.mark.parametrize(("passed", "code"), [(True, 0), (False, 1)])
def test_verify_says_what_was_proved(
    monkeypatch: pytest.MonkeyPatch, passed: bool, code: int
) -> None:
    from drills import verify

    def prove(names: list[str] | None, seeds: int, progress: Any) -> list[verify.Finding]:
        assert (names, seeds) == (["verlet"], 3)
        result = [
            verify.Finding("verlet", "one thing", True),
            verify.Finding("verlet", "b", passed),
        ]
        for finding in result:
            progress(finding)
        return result

    monkeypatch.setattr(verify, "verify", prove)
    command = ["verify", "verlet", "--seeds", "3"]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == code
    assert ("FAIL b" in done.stdout) is not passed and "ok   one thing" in done.stdout
    data = json.loads(CliRunner().invoke(cli, [*command, "--json"]).stdout)
    VALIDATOR.validate(data)
    assert (data["verdict"], data["exit"]) == ("pass" if passed else "fail", code)


def test_a_wrong_answer_gets_no_chart(place: Place) -> None:
    place.answer(WRONG)
    assert place.json("chart", "verlet")["verdict"] == "fail"
    assert sorted(path.name for path in place.work.iterdir()) == ["verlet.py"]
    lines = place.run("chart", "verlet").out.splitlines()
    assert lines[0].startswith("Only a right answer goes on the chart.")
    assert lines[-1] == "The feedback: drills check verlet --seed 0"
    assert len(lines) <= 4  # the reason, not the whole feedback


def test_doctor_names_the_protections(place: Place) -> None:
    data = place.json("doctor")
    assert data["exit"] == 0, data
    assert len(data["protections"]) > 3
    assert all(row["ok"] for row in data["grader"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "distribution", "extra"), [(row[0], row[1], row[3]) for row in doctor.LIBRARIES]
)
def test_doctor_names_the_extra_that_installs_a_library(
    monkeypatch: pytest.MonkeyPatch, module: str, distribution: str, extra: str
) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    group = project["optional-dependencies"][extra] if extra else project["dependencies"]
    assert distribution in {re.split(r"[<>=; ]", one)[0] for one in group}

    def absent(name: str) -> None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(doctor.importlib, "import_module", absent)
    monkeypatch.setattr(workspace, "in_tree", lambda: False)
    row = next(r for r in doctor.examine(Path("work"), None)["libraries"] if r["name"] == module)
    package = "robotics-simulation-course" + (f"[{extra}]" if extra else "")
    assert not row["ok"] and row["detail"].endswith(f"pip install '{package}'")


@pytest.mark.parametrize("columns", ["60", "80"])
def test_no_title_is_cut_and_no_line_is_too_long(place: Place, columns: str) -> None:
    for extra in ({}, {"LC_ALL": "C"}):
        done = place.run("list", COLUMNS=columns, **extra)
        rows = [line.rstrip() for line in done.out.splitlines()]
        assert max(map(len, rows)) <= int(columns)
        words = " ".join(done.out.split())
        assert "..." not in words
        for card in catalogue.cards():
            assert all(word in words for word in to_ascii(card.title).split()), card.title


@pytest.mark.slow
def test_a_hint_knows_what_the_last_check_found(place: Place) -> None:
    card = catalogue.card("dbscan")
    slip = next(s for s in exercises.of("dbscan").slips if "exactly" in s.sentence)
    place.answer(slip.text(card.solution_text()), "dbscan")
    assert place.json("check", "dbscan")["slip"] == slip.name
    hints = [place.run("hint", "dbscan").out for _ in range(3)]
    assert all("Your last check found:" in text for text in hints)
    assert "exactly" in hints[0].partition("Hint 1")[2]
    shown = [hint.text.split()[0] for hint in card.hints]
    assert all(any(word in text for text in hints) for word in shown)
    place.answer(card.solution_text(), "dbscan")
    place.run("check", "dbscan")
    assert "Your last check" not in place.run("hint", "dbscan").out


def test_the_ladder_begins_with_the_hint_that_is_about_the_finding() -> None:
    hints = [
        Hint("Some are missing.", "Look at the border."),
        Hint("Noise is a cluster.", "Count the point itself as a neighbour."),
        Hint("It is slow.", "Sort them first."),
    ]
    assert task_text.ladder(hints, "") == hints == task_text.ladder(hints, "Something else.")
    ordered = task_text.ladder(hints, "Each point itself is a neighbour too; yours does not count.")
    assert ordered == [hints[1], hints[0], hints[2]]


def test_the_commands_to_begin_with_come_last(place: Place) -> None:
    lines = place.run().out.rstrip().splitlines()
    first = [line.split()[1] for line in lines[-5:]]
    assert all(line.startswith("  drills ") for line in lines[-5:])
    assert first == ["next", "start", "check", "hint", "--help"]


# --- Which exercise, which file -------------------------------------------------------------------


@pytest.mark.slow
def test_a_file_is_recognised_by_its_name_or_by_what_it_defines(place: Place) -> None:
    other = place.folder / "mine.py"
    other.write_text(RIGHT)
    assert place.json("check", "mine.py")["drill"] == "verlet"
    assert place.json("check", "-", text=RIGHT)["drill"] == "verlet"
    assert place.json("check", "-", text=WRONG + "(")["reason"] == "syntax_error"
    named = place.folder / "verlet.py"
    named.write_text("x = 1\n")
    assert place.json("check", "./verlet.py")["reason"] == "missing_name"
    other.write_text("x = 1\n")
    assert "Say which one" in place.json("check", "mine.py")["error"]["message"]
    entries = [card.entry for card in catalogue.cards()[:2]]
    other.write_text("".join(f"def {entry}(): pass\n" for entry in entries))
    assert "several" in place.json("check", "mine.py")["error"]["message"]


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"\xff\xfed\x00e\x00f\x00", "UTF-16"),
        ("# -*- coding: latin-1 -*-\n# \xe9\n".encode("latin-1"), "latin-1"),
        (b"x = '\xe9'\n", "not UTF-8"),
        (b"#" * 1_000_001, "MB"),
    ],
    ids=["UTF-16", "declared", "undeclared", "large"],
)
def test_what_is_not_source_is_unreadable(place: Place, content: bytes, text: str) -> None:
    path = place.answer("")
    path.write_bytes(content)
    data = place.json("check", "verlet")
    assert (data["verdict"], data["reason"], data["exit"]) == ("fail", "unreadable", 1)
    assert text in data["sentence"]
    piped = place.json("check", "verlet", "--file", "-", text=content)
    assert piped["reason"] == "unreadable"
    assert not (place.work / "progress.json").exists()


def test_a_byte_order_mark_is_accepted(place: Place) -> None:
    place.answer("").write_bytes(b"\xef\xbb\xbf" + RIGHT.encode())
    assert place.json("check", "verlet")["verdict"] == "pass"


@pytest.mark.parametrize("kind", ["folder", "pipe", "link", "nothing there"])
def test_odd_files_are_no_answer_and_nothing_waits(place: Place, kind: str) -> None:
    place.work.mkdir()
    path = place.work / "verlet.py"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        (place.folder / "target.py").write_text(RIGHT)
        path.symlink_to(place.folder / "target.py")
    data = place.json("check", "verlet")
    if kind == "nothing there":
        assert data["exit"] == 2 and "drills start verlet" in data["error"]["message"]
    else:
        assert (data["reason"], data["exit"]) == ("unreadable", 1)


@pytest.mark.slow
def test_all_answers_are_checked_one_by_one(place: Place) -> None:
    assert place.json("check", "--all")["exit"] == 2
    place.answer(RIGHT)
    place.run("start", "observed_order")
    both = place.json("check", "--all")
    verdicts = {entry["drill"]: entry["reason"] for entry in both["results"]}
    assert verdicts == {"verlet": "right", "observed_order": "not_attempted"}
    assert (both["verdict"], both["right"], both["total"], both["exit"]) == ("fail", 1, 2, 1)
    # One line for each, also for those that are right.
    lines = place.run("check", "--all").out.splitlines()
    assert [line.split()[:2] for line in lines[:2]] == [
        ["right", "verlet"],
        ["open", "observed_order"],
    ]
    (place.work / "observed_order.py").unlink()
    done = place.run("check", "--all")
    assert done.code == 0 and "1 of 1 right" in done.out


# --- Misuse ---------------------------------------------------------------------------------------

MISUSE = [
    (["chek"], "check"),  # codespell:ignore chek
    (["show", "verlt"], "verlet"),
    (["start", "verlte"], "verlet"),
    (["check"], "Say which"),
    (["check", "nowhere.py"], "no file nowhere.py"),
    (["check", "verlet", "--file", "nowhere.py"], "no file nowhere.py"),
    (["check", "verlet.py"], "drills check verlet grades the answer"),
    (["check", "verlet", "--all"], "not both"),
    (["check", "verlet", "--seed", "-1"], "--seed"),
    (["check", "verlet", "--sed", "1"], "--seed"),
    (["hint"], "NAME"),
    (["start", "77"], "no chapter 77"),
    (["read", "1", "99"], "no section 99"),
    (["list", "--chapter", "77"], "No exercise is of chapter 77"),
    (["next", "--level", "6"], "--level"),
    (["hint", "nonsense_of_no_name"], "drills list"),
    (["verify", "--seeds", "0"], "--seeds"),
    (["watch", "verlet", "--file", "-"], "can't be watched"),
    (["--nonsense"], "--nonsense"),
]


def test_a_folder_that_is_gone_is_misuse(place: Place) -> None:
    program = f"mkdir gone && cd gone && rmdir ../gone && exec {SCRIPT} list"
    done = subprocess.run(
        ["sh", "-c", program], cwd=place.folder, env=place.environment, capture_output=True
    )
    assert done.returncode == 2 and b"current folder is gone" in done.stderr


@pytest.mark.parametrize(("arguments", "text"), MISUSE, ids=lambda v: " ".join(v)[:30])
def test_misuse_is_a_sentence_and_exit_2(place: Place, arguments: list[str], text: str) -> None:
    done = place.run(*arguments)
    assert done.code == 2, done
    assert done.out == "" and "Traceback" not in done.err
    assert text in " ".join(done.err.split())
    data = place.json(*arguments)
    assert data["exit"] == 2 and data["error"]["kind"] == "misuse"
    assert text in data["error"]["message"]
    assert list(place.folder.iterdir()) == []


def test_the_nearest_names_are_data_too(place: Place) -> None:
    assert "verlet" in place.json("check", "verlt")["error"]["nearest"]
    assert "check" in place.json("chekc")["error"]["nearest"]  # codespell:ignore chekc


# --- Nothing is lost ------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["start", "reset"])
def test_an_answer_is_never_replaced_in_a_pipe(place: Place, command: str) -> None:
    path = place.answer("my hour of work\n")
    done = place.run(command, "verlet", text="y\n")
    assert done.code == 2 and "--force" in done.err
    assert path.read_text() == "my hour of work\n"
    for number in (1, 2):
        path.write_text(f"version {number}\n")
        data = place.json(command, "verlet", "--force")
        assert Path(data["backup"]).name == f"verlet.py.bak-{number}"
        assert Path(data["backup"]).read_text() == f"version {number}\n"
        assert path.read_text() == workspace.start_text(catalogue.card("verlet"))


@pytest.mark.slow
@pytest.mark.parametrize(("typed", "replaced"), [("y\n", True), ("n\n", False), ("\n", False)])
def test_a_person_is_asked(place: Place, typed: str, replaced: bool) -> None:
    path = place.answer("my hour of work\n")
    code, out = in_terminal(place, ["start", "verlet"], typed)
    assert "start over?" in out
    assert (path.read_text() != "my hour of work\n") is replaced
    assert code == (0 if replaced else 2)
    assert (place.work / "verlet.py.bak-1").exists() is replaced


def test_reset_forgets_the_progress_only_when_told(place: Place) -> None:
    place.answer(RIGHT)
    place.run("check", "verlet")
    assert place.run("reset", "verlet", "--progress").code == 2
    assert place.record()["state"] == "solved"
    assert place.run("reset", "verlet", "--force").code == 0
    assert place.record()["state"] == "solved"
    assert place.run("reset", "verlet", "--force", "--progress").code == 0
    assert place.record() == {}


def test_a_damaged_progress_file_is_said_and_kept(place: Place) -> None:
    place.work.mkdir()
    (place.work / "progress.json").write_text("half a fi")
    data = place.json("list")
    assert "damaged-1" in data["notices"][0]
    assert (place.work / "progress.json.damaged-1").read_text() == "half a fi"
    (place.work / "progress.json").write_text("again")
    assert "damaged-2" in place.run("status").err


def test_a_verdict_is_given_where_progress_cannot_be_kept(place: Place) -> None:
    place.answer(RIGHT)
    blocked = str(place.work / "verlet.py" / "progress.json")
    data = place.json("check", "verlet", DRILLS_PROGRESS=blocked)
    assert data["verdict"] == "pass" and "can't be written" in data["notices"][0]
    hint = place.json("hint", "verlet", DRILLS_PROGRESS=blocked)
    assert len(hint["hints"]) == 3


def test_progress_can_be_switched_off(place: Place) -> None:
    place.answer(RIGHT)
    data = place.json("check", "verlet", DRILLS_PROGRESS="none")
    assert data["verdict"] == "pass" and data["state"] == "not_attempted"
    assert sorted(p.name for p in place.work.iterdir()) == ["verlet.py"]


def test_the_work_folder_can_be_chosen(place: Place) -> None:
    place.run("start", "verlet", DRILLS_WORK=str(place.folder / "a"))
    place.run("start", "verlet", "--work", "b")
    place.run("--work", "c", "start", "verlet")
    result = sorted(p.relative_to(place.folder).as_posix() for p in place.folder.rglob("*.py"))
    assert result == ["a/verlet.py", "b/verlet.py", "c/verlet.py"]


def test_inside_the_project_the_answers_are_in_its_work_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DRILLS_WORK", raising=False)
    monkeypatch.chdir(ROOT / "notebooks")
    assert workspace.folder() == ROOT / "work"
    monkeypatch.chdir("/")
    assert workspace.folder() == Path("/work")


@pytest.mark.prove
def test_two_terminals_at_once_count_both(place: Place) -> None:
    place.answer(WRONG)
    running = [place.popen("check", "verlet") for _ in range(3)]
    assert {process.wait() for process in running} == {1}
    for process in running:
        process.communicate()
    assert place.record()["attempts"] == 3


# --- Lightness ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [[], ["list"], ["next"], ["status"], ["start", "verlet"], ["start", "1"], ["--help"]],
)
def test_nothing_heavy_is_imported_before_it_is_needed(place: Place, arguments: list[str]) -> None:
    program = (
        "import sys; from drills.cli import cli\n"
        "cli.main(sys.argv[1:], standalone_mode=False)\n"
        "heavy = 'numpy scipy matplotlib mujoco rich IPython numba jsonschema'.split()\n"
        "print('HEAVY', *[name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=place.folder,
        env=place.environment,
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines()[-1] == "HEAVY", done.stderr


def test_the_package_is_light_and_lends_the_notebook_names() -> None:
    program = "import sys, drills; print('numpy' in sys.modules); print(drills.check.__module__)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.split() == ["False", "drills.notebook"], done.stderr
    assert package.__name__ == "drills.catalogue"
