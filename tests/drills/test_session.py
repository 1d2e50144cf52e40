"""The command `drills` under odd circumstances: terminals, pipes, signals, failures of ours."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from course.libraries import import_error
from drills import cards as catalogue
from drills import terminal
from drills.cli import cli
from tests.drills.place import (
    COMMANDS,
    ENDLESS,
    RIGHT,
    SCRIPT,
    VALIDATOR,
    WRONG,
    Place,
    a_place,
    descendants,
    in_terminal,
    next_line,
    until,
)

pytestmark = pytest.mark.slow


__all__ = ["a_place"]


# --- Where the output goes ------------------------------------------------------------------------

TEXTS = [
    [],
    ["list"],
    ["hint", "verlet"],
    ["check", "verlet"],
    ["check", "--all"],
    ["status"],
    ["next"],
    ["start", "1"],
    ["read", "1"],
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
    [
        pytest.param({"LC_ALL": "C"}, id="C"),
        pytest.param({"PYTHONIOENCODING": "ascii"}, id="ascii", marks=pytest.mark.prove),
        pytest.param({}, id="UTF-8", marks=pytest.mark.prove),
    ],
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
    done = place.script("check", "verlet", PYTHONIOENCODING="ascii")
    assert done.code == 1 and done.out.isascii() and "NOT RIGHT" in done.out


def test_colour_is_for_terminals_and_can_be_refused(place: Place) -> None:
    assert "\x1b[" not in place.run("list").out
    assert "\x1b[" in in_terminal(place, ["list"])[1]
    assert "\x1b[" not in in_terminal(place, ["list"], NO_COLOR="1")[1]
    assert "\x1b[" not in in_terminal(place, ["list"], TERM="dumb")[1]


@pytest.mark.prove
def test_a_reader_that_goes_away_changes_nothing(place: Place) -> None:
    place.answer(WRONG)
    for arguments, code in ((["list"], 0), (["check", "verlet"], 1), (["list", "--json"], 0)):
        reading, writing = os.pipe()
        os.close(reading)
        process = place.popen(*arguments, stdout=writing)
        os.close(writing)
        assert process.communicate(timeout=120)[1] == b"", arguments
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


@pytest.mark.prove
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_stopped_check_leaves_nothing_behind(place: Place, number: int, code: int) -> None:
    place.answer(WRONG)
    place.run("check", "verlet")
    before = (place.work / "progress.json").read_bytes()
    place.answer(ENDLESS)
    place.watch_scratch()
    process = place.popen("check", "verlet", "--json")
    running = place.wait_for_answer(process)
    assert running
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert process.returncode == code
    assert b"Traceback" not in err
    if number == signal.SIGINT:
        data = json.loads(out)
        VALIDATOR.validate(data)
        assert data["error"]["kind"] == "interrupted"
    assert not any(Path(f"/proc/{pid}").exists() for pid in running)
    assert (place.work / "progress.json").read_bytes() == before


@pytest.mark.prove
@pytest.mark.parametrize("processes", [1, 2, 3, 5])
def test_ctrl_c_ends_a_proof_at_once(place: Place, processes: int) -> None:
    """Also while its workers start: they must neither die with a traceback nor be left over."""
    process = place.popen("verify", "--seeds", "50", start_new_session=True)
    deadline = time.monotonic() + 120
    while len(running := descendants(process.pid)) < processes and time.monotonic() < deadline:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"Traceback" not in err
    elapsed = time.monotonic() + 60
    while any(Path(f"/proc/{pid}").exists() for pid in running) and time.monotonic() < elapsed:
        time.sleep(0.05)
    assert not any(Path(f"/proc/{pid}").exists() for pid in running)


@pytest.mark.prove
def test_watch_grades_at_every_save_until_it_is_stopped(place: Place) -> None:
    path = place.answer(WRONG)
    process = place.popen("watch", "verlet", "--json")
    assert process.stdout is not None
    observed = [json.loads(next_line(process))]
    path.write_text(RIGHT)  # in place
    observed.append(json.loads(next_line(process)))
    new = place.work / "new.tmp"
    new.write_text(WRONG)
    os.replace(new, path)  # as many editors do
    observed.append(json.loads(next_line(process)))
    process.send_signal(signal.SIGINT)
    observed.append(json.loads(next_line(process)))
    process.communicate(timeout=120)
    assert process.returncode == 130
    for data in observed:
        VALIDATOR.validate(data)
    assert [data.get("verdict") for data in observed] == ["fail", "pass", "fail", None]
    assert observed[-1]["error"]["kind"] == "interrupted"


@pytest.mark.prove
def test_watch_says_the_time_and_survives_a_missing_file(place: Place) -> None:
    path = place.answer(WRONG)
    process = place.popen("watch", "verlet", stdin=subprocess.DEVNULL)
    until(process, "--seed")
    path.unlink()
    until(process, "is gone")
    path.write_text(RIGHT)
    text = until(process, "RIGHT  verlet")
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=120)
    assert re.search(r"--- \d\d:\d\d:\d\d ---", text)


# --- Our own failures -----------------------------------------------------------------------------


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Exception]:
    """A grader that raises what the test puts into the list."""
    import drills.grader

    raised: list[Exception] = []

    def grade(*args: object, **kwargs: object) -> None:
        raise raised[0]

    monkeypatch.setattr(drills.grader, "grade", grade)
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
    output = " ".join(done.stderr.split())
    assert "DRILLS_DEBUG=1 drills check verlet --seed 7" in output
    assert "RuntimeError: the flux capacitor" in output and "Traceback" not in output
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


@pytest.mark.parametrize("by_adapter", [True, False])
def test_a_missing_shared_library_is_named(broken: list[Exception], by_adapter: bool) -> None:
    error = ImportError("libgomp.so.1: cannot open shared object file: No such file or directory")
    if by_adapter:
        text = import_error("Pinocchio", "pip install 'pin>=4.0'", error)
        text.__cause__ = error
        broken.append(text)
    else:
        broken.append(error)
    done = CliRunner().invoke(cli, ["check", "verlet"])
    output = " ".join(done.stderr.split())
    assert done.exit_code == 3 and "the system library libgomp.so.1 is missing" in output
    assert "apt-get install --no-install-recommends" in output and "libgomp1" in output
    assert "our fault" not in output and ("Pinocchio" in output) == by_adapter


def test_with_debug_the_traceback_is_there(
    broken: list[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DRILLS_DEBUG", "1")
    broken.append(RuntimeError("the flux capacitor"))
    done = CliRunner().invoke(cli, ["check", "verlet"])
    assert done.exit_code == 3 and "Traceback" in done.stderr
