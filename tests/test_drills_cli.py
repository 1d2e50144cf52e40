"""The command `drills` as somebody types it: commands, JSON, exit codes, and its nerves."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from click.testing import CliRunner

from drills import catalogue as package
from drills import exercise as catalogue
from drills import terminal, workspace
from drills.cli import cli
from drills.reasons import Reason

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = Path(sys.executable).with_name("drills")
SCHEMA = json.loads((ROOT / "drills" / "schema.json").read_text(encoding="utf-8"))
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
COMMANDS = list(cli.commands)

RIGHT = catalogue.card("verlet").solution_text()
WRONG = "def verlet_step(q, v, a, acceleration, dt):\n    return q, v, a\n"


class Place:
    """A folder to work in, and the real console script."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.work = folder / "work"
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("DRILLS", "LC_", "LANG"))}
        kept.pop("NO_COLOR", None)
        kept.pop("COLUMNS", None)
        self.environment = {**kept, "LC_ALL": "C.UTF-8", "TERM": "xterm"}
        self.environment["COURSE_QUIET"] = "1"

    def popen(self, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
        extra = options.pop("env", {})
        return subprocess.Popen(
            [str(SCRIPT), *arguments],
            cwd=self.folder,
            env={**self.environment, **extra},
            **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options},
        )

    def run(self, *arguments: str, text: str | bytes = "", **extra: str) -> "Done":
        process = self.popen(*arguments, stdin=subprocess.PIPE, env=extra)
        data = text.encode() if isinstance(text, str) else text
        out, err = process.communicate(data, timeout=120)
        return Done(process.returncode, out.decode(), err.decode())

    def json(self, *arguments: str, text: str | bytes = "", **extra: str) -> dict[str, Any]:
        done = self.run(*arguments, "--json", text=text, **extra)
        lines = done.out.splitlines()
        assert len(lines) == 1, done
        assert done.err == "", done
        data = json.loads(lines[0])
        VALIDATOR.validate(data)
        assert data["exit"] == done.code
        return data

    def answer(self, text: str, name: str = "verlet") -> Path:
        self.work.mkdir(exist_ok=True)
        path = self.work / f"{name}.py"
        path.write_text(text, encoding="utf-8")
        return path

    def record(self, name: str = "verlet") -> dict[str, Any]:
        content = json.loads((self.work / "progress.json").read_text(encoding="utf-8"))
        return content["exercises"].get(name, {})


class Done:
    """How a command ended."""

    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err

    def __repr__(self) -> str:
        return f"exit {self.code}\n{self.out}\n--- stderr\n{self.err}"


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


# --- A newcomer's way -----------------------------------------------------------------------------


def test_the_console_script_is_there() -> None:
    assert SCRIPT.exists(), "install the project again: the script `drills` is missing"


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

    refused = place.run("solution", "verlet")
    assert refused.code == 2 and "--give-up" in refused.err and refused.out == ""

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


# An answer that takes every angle from the x axis.
ABSOLUTE_ANGLES = """
import numpy as np

def fk3(lengths, thetas):
    points = [(0.0, 0.0)]
    for length, theta in zip(lengths, thetas):
        x, y = points[-1]
        points.append((x + length * np.cos(theta), y + length * np.sin(theta)))
    return np.array(points)
"""


def test_the_feedback_in_the_readme_is_what_one_gets(place: Place) -> None:
    place.answer(ABSOLUTE_ANGLES, "fk3")
    said = place.run("check", "fk3", "--seed", "1").out
    feedback = said.partition("\nChecks:")[0].strip()
    assert "Likely cause" in feedback
    assert feedback in (ROOT / "README.md").read_text(encoding="utf-8"), said


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
    assert done.stdout == place.run("list").out


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


@pytest.mark.parametrize("name", [card.name for card in catalogue.cards() if card.drill])
def test_every_drill_is_checked_from_a_file(place: Place, name: str) -> None:
    card = catalogue.card(name)
    path = place.folder / "somewhere.py"
    path.write_text(card.solution_text(), encoding="utf-8")
    right = place.json("check", name, "--file", str(path))
    assert (right["verdict"], right["reason"], right["exit"]) == ("pass", "right", 0), right
    path.write_text("answer = 42\n")
    wrong = place.json("check", name, "--file", str(path))
    assert (wrong["verdict"], wrong["reason"], wrong["exit"]) == ("fail", "missing_name", 1)


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
        found = [verify.Finding("verlet", "one thing", True), verify.Finding("verlet", "b", passed)]
        for finding in found:
            progress(finding)
        return found

    monkeypatch.setattr(verify, "verify", prove)
    command = ["verify", "verlet", "--seeds", "3"]
    done = CliRunner().invoke(cli, command)
    assert done.exit_code == code
    assert ("FAIL b" in done.stdout) is not passed and "ok   one thing" in done.stdout
    data = json.loads(CliRunner().invoke(cli, [*command, "--json"]).stdout)
    VALIDATOR.validate(data)
    assert (data["verdict"], data["exit"]) == ("pass" if passed else "fail", code)


def test_a_chart_is_written_for_a_right_answer_only(place: Place) -> None:
    place.answer(WRONG)
    assert place.json("chart", "verlet")["verdict"] == "fail"
    assert not (place.work / "verlet.png").exists()
    place.answer(RIGHT)
    data = place.json("chart", "verlet", "-o", "picture.png")
    assert Path(data["picture"]).read_bytes().startswith(b"\x89PNG")
    assert "yours" in data["table"]
    assert not (place.work / "progress.json").exists()  # a chart is no attempt


def test_doctor_names_the_protections(place: Place) -> None:
    data = place.json("doctor")
    assert data["exit"] == 0, data
    assert len(data["protections"]) > 3
    assert all(row["ok"] for row in data["grader"])


# --- Which exercise, which file -------------------------------------------------------------------


def test_a_file_is_recognised_by_its_name_or_by_what_it_defines(place: Place) -> None:
    other = place.folder / "mine.py"
    other.write_text(RIGHT)
    assert place.json("check", "mine.py")["drill"] == "verlet"
    assert place.json("check", "-", text=RIGHT)["drill"] == "verlet"
    named = place.folder / "verlet.py"
    named.write_text("x = 1\n")
    assert place.json("check", "./verlet.py")["reason"] == "missing_name"
    other.write_text("x = 1\n")
    assert "Say which one" in place.json("check", "mine.py")["error"]["message"]
    entries = [card.entry for card in catalogue.cards()[:2]]
    other.write_text("".join(f"def {entry}(): pass\n" for entry in entries))
    assert "several" in place.json("check", "mine.py")["error"]["message"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\xff\xfed\x00e\x00f\x00", "UTF-16"),
        ("# -*- coding: latin-1 -*-\n# \xe9\n".encode("latin-1"), "latin-1"),
        (b"x = '\xe9'\n", "not UTF-8"),
        (b"#" * 1_000_001, "MB"),
    ],
    ids=["UTF-16", "declared", "undeclared", "large"],
)
def test_what_is_not_source_is_unreadable(place: Place, content: bytes, said: str) -> None:
    path = place.answer("")
    path.write_bytes(content)
    data = place.json("check", "verlet")
    assert (data["verdict"], data["reason"], data["exit"]) == ("fail", "unreadable", 1)
    assert said in data["sentence"]
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


def test_all_answers_are_checked_one_by_one(place: Place) -> None:
    assert place.json("check", "--all")["exit"] == 2
    place.answer(RIGHT)
    place.run("start", "observed_order")
    both = place.json("check", "--all")
    verdicts = {entry["drill"]: entry["reason"] for entry in both["results"]}
    assert verdicts == {"verlet": "right", "observed_order": "not_attempted"}
    assert (both["verdict"], both["right"], both["total"], both["exit"]) == ("fail", 1, 2, 1)
    (place.work / "observed_order.py").unlink()
    done = place.run("check", "--all")
    assert done.code == 0 and "1 of 1 right" in done.out


# --- Misuse ---------------------------------------------------------------------------------------

MISUSE = [
    (["chek"], "check"),
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


@pytest.mark.parametrize(("arguments", "said"), MISUSE, ids=lambda v: " ".join(v)[:30])
def test_misuse_is_a_sentence_and_exit_2(place: Place, arguments: list[str], said: str) -> None:
    done = place.run(*arguments)
    assert done.code == 2, done
    assert done.out == "" and "Traceback" not in done.err
    assert said in " ".join(done.err.split())
    data = place.json(*arguments)
    assert data["exit"] == 2 and data["error"]["kind"] == "misuse"
    assert said in data["error"]["message"]
    assert list(place.folder.iterdir()) == []


def test_the_nearest_names_are_data_too(place: Place) -> None:
    assert "verlet" in place.json("check", "verlt")["error"]["nearest"]
    assert "check" in place.json("chekc")["error"]["nearest"]


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
    found = sorted(p.relative_to(place.folder).as_posix() for p in place.folder.rglob("*.py"))
    assert found == ["a/verlet.py", "b/verlet.py", "c/verlet.py"]


def test_inside_the_project_the_answers_are_in_its_work_folder(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DRILLS_WORK", raising=False)
    monkeypatch.chdir(ROOT / "notebooks")
    assert workspace.folder() == ROOT / "work"
    monkeypatch.chdir("/")
    assert workspace.folder() == Path("/work")


def test_two_terminals_at_once_count_both(place: Place) -> None:
    place.answer(WRONG)
    running = [place.popen("check", "verlet") for _ in range(3)]
    assert {process.wait() for process in running} == {1}
    for process in running:
        process.communicate()
    assert place.record()["attempts"] == 3


# --- Where the output goes ------------------------------------------------------------------------

TEXTS = [
    [],
    ["list"],
    ["hint", "verlet"],
    ["check", "verlet"],
    ["check", "--all"],
    ["status"],
    ["doctor"],
    ["solution", "verlet"],
    ["start", "verlet"],
    ["--help"],
    *([name, "--help"] for name in COMMANDS),
    *(["show", name] for name in catalogue.names()),
]
# One process runs them all: most of the time of one is starting Python.
ALL_TEXTS = f"""
from drills.cli import cli
for arguments in {TEXTS!r}:
    code = cli.main(arguments, prog_name="drills", standalone_mode=False)
    assert code in (0, 1, 2), (code, arguments)
"""


@pytest.mark.parametrize(
    "locale",
    [{"LC_ALL": "C"}, {"LC_ALL": "POSIX"}, {"PYTHONIOENCODING": "ascii"}, {}],
    ids=["C", "POSIX", "ascii", "UTF-8"],
)
def test_every_text_fits_80_columns_and_the_locale(place: Place, locale: dict[str, str]) -> None:
    place.answer(WRONG)
    done = subprocess.run(
        [sys.executable, "-c", ALL_TEXTS],
        cwd=place.folder,
        env={**place.environment, **locale},
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr.decode()
    text = (done.stdout + done.stderr).decode()
    assert text.isascii() is bool(locale)
    assert "\x1b" not in text and "\ufffd" not in text
    wide = [line for line in text.splitlines() if len(line) > 80]
    assert [line for line in wide if str(place.folder) not in line] == []
    assert "Drills: write an answer" in text and "RIGHT  verlet" in text


def test_an_output_that_says_more_than_ascii_does_not_break_an_ascii_pipe(place: Place) -> None:
    place.answer("print('caf\\u00e9 \\u2603 \\U0001f916')\n" + WRONG)
    done = place.run("check", "verlet", PYTHONIOENCODING="ascii")
    assert done.code == 1 and done.out.isascii() and "NOT RIGHT" in done.out


def test_colour_is_for_terminals_and_can_be_refused(place: Place) -> None:
    assert "\x1b[" not in place.run("list").out
    assert "\x1b[" in in_terminal(place, ["list"])[1]
    assert "\x1b[" not in in_terminal(place, ["list"], NO_COLOR="1")[1]
    assert "\x1b[" not in in_terminal(place, ["list"], TERM="dumb")[1]


def test_a_reader_that_goes_away_changes_nothing(place: Place) -> None:
    place.answer(WRONG)
    for arguments, code in ((["list"], 0), (["check", "verlet"], 1), (["list", "--json"], 0)):
        reading, writing = os.pipe()
        os.close(reading)
        process = place.popen(*arguments, stdout=writing)
        os.close(writing)
        assert process.communicate(timeout=60)[1] == b"", arguments
        assert process.returncode == code
    assert place.record()["attempts"] == 1


def test_no_standard_streams_at_all(place: Place) -> None:
    command = f"exec {SCRIPT} list <&- >&- 2>&-"
    done = subprocess.run(["sh", "-c", command], cwd=place.folder, env=place.environment)
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("part", "whole", "full"), [(0, 0, 0), (0, 5, 0), (1, 100, 1), (99, 100, 9), (5, 5, 10)]
)
def test_a_bar_is_full_or_empty_only_when_that_is_true(part: int, whole: int, full: int) -> None:
    drawn = terminal.bar(part, whole)
    assert len(drawn) == 10 and drawn.count("█") == full


def test_ascii_keeps_the_meaning() -> None:
    text = terminal.to_ascii("θ ≤ 90° → é 10⁻³ m² ☃")
    assert text.isascii()
    assert text.startswith("theta <= 90 deg -> e") and "m^2" in text


# --- Being stopped --------------------------------------------------------------------------------

ENDLESS = "def verlet_step(q, v, a, acceleration, dt):\n    while True:\n        pass\n"


def descendants(pid: int) -> set[int]:
    """The processes below one, by /proc."""
    parents: dict[int, int] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                status = (entry / "stat").read_text()
            except OSError:
                continue
            parents[int(entry.name)] = int(status.rpartition(")")[2].split()[1])
    found: set[int] = set()
    while more := {child for child, parent in parents.items() if parent in {pid, *found}} - found:
        found |= more
    return found


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_stopped_check_leaves_nothing_behind(place: Place, number: int, code: int) -> None:
    place.answer(WRONG)
    place.run("check", "verlet")
    before = (place.work / "progress.json").read_bytes()
    place.answer(ENDLESS)
    process = place.popen("check", "verlet", "--json")
    deadline = time.monotonic() + 30
    while not (running := descendants(process.pid)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert running
    time.sleep(0.4)
    running |= descendants(process.pid)
    process.send_signal(number)
    out, err = process.communicate(timeout=20)
    assert process.returncode == code
    assert b"Traceback" not in err
    if number == signal.SIGINT:
        data = json.loads(out)
        VALIDATOR.validate(data)
        assert data["error"]["kind"] == "interrupted"
    assert not any(Path(f"/proc/{pid}").exists() for pid in running)
    assert (place.work / "progress.json").read_bytes() == before


def test_watch_grades_at_every_save_until_it_is_stopped(place: Place) -> None:
    path = place.answer(WRONG)
    process = place.popen("watch", "verlet", "--json")
    assert process.stdout is not None
    seen = [json.loads(next_line(process))]
    path.write_text(RIGHT)  # in place
    seen.append(json.loads(next_line(process)))
    new = place.work / "new.tmp"
    new.write_text(WRONG)
    os.replace(new, path)  # as many editors do
    seen.append(json.loads(next_line(process)))
    process.send_signal(signal.SIGINT)
    seen.append(json.loads(next_line(process)))
    process.communicate(timeout=20)
    assert process.returncode == 130
    for data in seen:
        VALIDATOR.validate(data)
    assert [data.get("verdict") for data in seen] == ["fail", "pass", "fail", None]
    assert seen[-1]["error"]["kind"] == "interrupted"


def test_watch_says_the_time_and_survives_a_missing_file(place: Place) -> None:
    path = place.answer(WRONG)
    process = place.popen("watch", "verlet", stdin=subprocess.DEVNULL)
    until(process, "--seed")
    path.unlink()
    until(process, "is gone")
    path.write_text(RIGHT)
    text = until(process, "RIGHT  verlet")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=20)
    assert re.search(r"--- \d\d:\d\d:\d\d ---", text)


# --- Our own failures -----------------------------------------------------------------------------


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Exception]:
    """A grader that raises what the test puts into the list."""
    import drills.grade

    raised: list[Exception] = []

    def grade(*args: object, **kwargs: object) -> None:
        raise raised[0]

    monkeypatch.setattr(drills.grade, "grade", grade)
    monkeypatch.setenv("DRILLS_WORK", str(tmp_path / "work"))
    monkeypatch.delenv("DRILLS_DEBUG", raising=False)
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "verlet.py").write_text(WRONG)
    return raised


def test_a_failure_of_the_grader_is_exit_3_and_says_how_to_report_it(
    broken: list[Exception], tmp_path: Path
) -> None:
    broken.append(RuntimeError("the flux\ncapacitor"))
    done = CliRunner().invoke(cli, ["check", "verlet", "--seed", "7"])
    assert done.exit_code == 3
    said = " ".join(done.stderr.split())
    assert "DRILLS_DEBUG=1 drills check verlet --seed 7" in said
    assert "RuntimeError: the flux capacitor" in said and "Traceback" not in said
    data = json.loads(CliRunner().invoke(cli, ["check", "verlet", "--json"]).stdout)
    VALIDATOR.validate(data)
    assert data["error"]["kind"] == "grader" and data["error"]["drill"] == "verlet"
    assert f"--seed {data['error']['seed']}" in data["error"]["message"]
    assert not (tmp_path / "work" / "progress.json").exists()


def test_a_missing_library_says_what_to_install(broken: list[Exception]) -> None:
    broken.append(ModuleNotFoundError("No module named 'ompl'", name="ompl"))
    done = CliRunner().invoke(cli, ["check", "verlet"])
    assert done.exit_code == 3 and "ompl is not installed" in done.stderr
    assert "make setup" in done.stderr


def test_with_debug_the_traceback_is_there(
    broken: list[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRILLS_DEBUG", "1")
    broken.append(RuntimeError("the flux capacitor"))
    done = CliRunner().invoke(cli, ["check", "verlet"])
    assert done.exit_code == 3 and "Traceback" in done.stderr


# --- Lightness ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments", [[], ["list"], ["status"], ["hint", "verlet"], ["start", "verlet"], ["--help"]]
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


# --- Helpers --------------------------------------------------------------------------------------


def in_terminal(
    place: Place, arguments: list[str], typed: str = "", **extra: str
) -> tuple[int, str]:
    """Run a command in a pseudo-terminal; gives its exit code and what it wrote."""
    ours, theirs = pty.openpty()
    process = place.popen(
        *arguments, stdin=theirs, stdout=theirs, stderr=theirs, env=extra, start_new_session=True
    )
    os.close(theirs)
    os.write(ours, typed.encode())
    out = b""
    while True:
        try:
            data = os.read(ours, 65536)
        except OSError:  # the other side is closed
            break
        if not data:
            break
        out += data
    os.close(ours)
    return process.wait(timeout=60), out.decode("utf-8", "replace")


def next_line(process: subprocess.Popen[bytes], seconds: float = 30.0) -> bytes:
    """The next line of a running command's output."""
    assert process.stdout is not None
    line, deadline = b"", time.monotonic() + seconds
    handle = process.stdout.fileno()
    while not line.endswith(b"\n"):
        assert select.select([handle], [], [], max(0.0, deadline - time.monotonic()))[0], line
        byte = os.read(handle, 1)
        assert byte, (process.wait(), line)
        line += byte
    return line


def until(process: subprocess.Popen[bytes], text: str) -> str:
    """What a running command writes until a line holds `text`."""
    read = ""
    while text not in read:
        read += next_line(process).decode()
    return read
