"""The progress file: readable, atomic, safe with several processes, damaged ones put aside."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drills import json_store, progress
from drills.progress import Record


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "work" / "progress.json"


def attempt(path: Path, name: str, passed: bool, **costs: tuple[float, str]) -> Record:
    loaded = progress.change(path, name, lambda r: progress.note_attempt(r, passed, costs))
    return loaded.of(name)


def run(program: str, *arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)], stdout=subprocess.PIPE, text=True
    )


def test_no_file_is_no_progress(file: Path) -> None:
    loaded = progress.load(file)
    assert loaded.records == {} and loaded.notices == ()
    assert loaded.of("fk3") == Record()
    assert not file.parent.exists()


def test_what_is_recorded_is_read_back(file: Path) -> None:
    attempt(file, "fk3", False, time=(3.0, "s"))
    assert progress.load(file).of("fk3").state == "attempted"
    assert progress.load(file).of("fk3").best == {}
    attempt(file, "fk3", True, time=(2.0, "s"))
    attempt(file, "fk3", True, time=(5.0, "s"))
    attempt(file, "fk3", False)
    record = progress.load(file).of("fk3")
    assert (record.state, record.attempts) == ("solved", 4)
    assert record.best == {"time": {"value": 2.0, "unit": "s"}}
    assert record.first <= record.solved <= record.last


def test_the_file_is_readable_and_alone(file: Path) -> None:
    attempt(file, "fk3", True)
    text = file.read_text(encoding="utf-8")
    assert json.loads(text)["schema"] == progress.SCHEMA
    assert '\n    "fk3": {\n' in text and text.endswith("}\n")
    assert sorted(p.name for p in file.parent.iterdir()) == [".progress.json.lock", "progress.json"]


def test_none_keeps_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert progress.load(None).records == {}
    loaded = progress.change(None, "fk3", lambda r: progress.note_attempt(r, True, {}))
    assert loaded.of("fk3").state == "solved"
    progress.forget(None, "fk3")
    assert list(tmp_path.iterdir()) == []


def test_forgetting_drops_one_record(file: Path) -> None:
    attempt(file, "fk3", True)
    attempt(file, "rrt", True)
    progress.forget(file, "fk3")
    assert list(progress.load(file).records) == ["rrt"]


DAMAGED = [
    b"",
    b"{",
    b"[]",
    b"null",
    b'{"schema": 1}',
    b'{"schema": "something else", "exercises": {}}',
    b'{"schema": "drills-progress/1"}',
    b'{"schema": "drills-progress/1", "exercises": []}',
    b'{"schema": "drills-progress/1", "exercises": {"fk3": 1}}',
    b'{"schema": "drills-progress/1", "exercises": {"fk3": {"state": "great"}}}',
    b'{"schema": "drills-progress/1", "exercises": {"fk3": {"attempts": "many"}}}',
    b'{"schema": "drills-progress/1", "exercises": {"fk3": {"hints": true}}}',
    b'{"schema": "drills-progress/1", "exercises": {"fk3": {"best": {"time": 3}}}}',
    b"\xff\xfe\x00",
    b"[" * 100_000,
]


@pytest.mark.parametrize("content", DAMAGED)
def test_a_damaged_file_is_put_aside_and_said_so(file: Path, content: bytes) -> None:
    file.parent.mkdir()
    file.write_bytes(content)
    loaded = progress.load(file)
    assert loaded.records == {}
    aside = file.with_name("progress.json.damaged-1")
    assert str(aside) in loaded.notices[0]
    assert aside.read_bytes() == content
    assert not file.exists()
    assert attempt(file, "fk3", True).attempts == 1


def test_damaged_files_do_not_replace_each_other(file: Path) -> None:
    file.parent.mkdir()
    for number in (1, 2, 3):
        file.write_text(f"broken {number}")
        loaded = progress.change(file, "fk3", lambda r: progress.note_attempt(r, False, {}))
        assert f"damaged-{number}" in loaded.notices[0]
        assert file.with_name(f"progress.json.damaged-{number}").read_text() == f"broken {number}"


def test_a_file_of_another_version_is_left_alone(file: Path) -> None:
    file.parent.mkdir()
    file.write_text('{"schema": "drills-progress/2", "exercises": {}}')
    assert "another version" in progress.load(file).notices[0]
    with pytest.raises(json_store.Problem, match="another version"):
        attempt(file, "fk3", True)
    assert "drills-progress/2" in file.read_text()


def test_a_file_that_grew_without_bound_is_not_read_into_memory(file: Path) -> None:
    file.parent.mkdir()
    with file.open("wb") as out:
        out.truncate(50_000_000_000)
    assert "damaged" in progress.load(file).notices[0]


def test_what_cannot_be_written_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "work").write_text("a file where the folder should be")
    with pytest.raises(json_store.Problem, match="can't be written"):
        attempt(tmp_path / "work" / "progress.json", "fk3", True)
    folder = tmp_path / "progress.json"
    folder.mkdir()
    assert "can't be read" in progress.load(folder).notices[0]


def test_a_read_only_folder_is_a_sentence(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempt(file, "fk3", True)
    original = os.open

    def read_only(path: Path, flags: int, mode: int = 0o777) -> int:
        if flags & (os.O_WRONLY | os.O_RDWR):
            raise OSError(30, "Read-only file system")
        return original(path, flags, mode)

    monkeypatch.setattr(os, "open", read_only)
    assert progress.load(file).of("fk3").state == "solved"
    with pytest.raises(json_store.Problem, match="can't be written: read-only file system"):
        attempt(file, "fk3", True)


def test_a_full_disk_leaves_the_old_file(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempt(file, "fk3", True)
    before = file.read_bytes()

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(json_store.Problem, match="no space left"):
        attempt(file, "fk3", True)
    assert file.read_bytes() == before
    assert not list(file.parent.glob(".*.part"))


def test_a_link_is_followed(file: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere.json"
    elsewhere.write_text('{"schema": "drills-progress/1", "exercises": {}}')
    file.parent.mkdir()
    file.symlink_to(elsewhere)
    attempt(file, "fk3", True)
    assert file.is_symlink()
    assert "fk3" in elsewhere.read_text()


WRITER = """
import sys
from pathlib import Path
from drills import progress
path, name, times = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
print("ready", flush=True)
for _ in range(times):
    progress.change(path, name, lambda r: progress.note_attempt(r, False, {}))
    progress.change(path, "shared", lambda r: progress.note_attempt(r, True, {"t": (1.0, "s")}))
"""


@pytest.mark.prove
def test_many_processes_lose_nothing(file: Path) -> None:
    writers = [run(WRITER, file, f"drill{i}", 25) for i in range(8)]
    while any(writer.poll() is None for writer in writers):
        assert progress.load(file).notices == ()  # a reader never sees half a file
        time.sleep(0.01)
    assert all(writer.wait() == 0 for writer in writers)
    records = progress.load(file).records
    assert {name: r.attempts for name, r in records.items()} == {
        **{f"drill{i}": 25 for i in range(8)},
        "shared": 200,
    }


def test_a_killed_writer_leaves_a_whole_file_and_no_lock(file: Path) -> None:
    attempt(file, "before", True)
    for delay in (0.0, 0.01, 0.02, 0.03, 0.05, 0.08):
        writer = run(WRITER, file, "drill", 100_000)
        assert writer.stdout is not None
        assert writer.stdout.readline() == "ready\n"
        time.sleep(delay)
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        loaded = progress.load(file)
        assert loaded.notices == ()
        assert loaded.of("before").state == "solved"
        start = loaded.of("mine").attempts
        assert attempt(file, "mine", False).attempts == start + 1  # the lock is free again
    assert not list(file.parent.glob(".*.part"))


def test_a_lock_that_is_never_freed_is_a_sentence(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import fcntl

    attempt(file, "fk3", False)
    monkeypatch.setattr(json_store, "_PATIENCE", 0.1)
    with (file.parent / ".progress.json.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(json_store.Problem, match="has held the lock"):
            attempt(file, "fk3", True)
        assert progress.load(file).of("fk3").state == "attempted"  # reading needs no lock


@given(st.lists(st.tuples(st.booleans(), st.floats(1e-9, 1e9))))
def test_a_record_never_gets_worse(attempts: list[tuple[bool, float]]) -> None:
    record = Record()
    for passed, cost in attempts:
        before = record.state, record.best.get("time", {"value": float("inf")})["value"]
        progress.note_attempt(record, passed, {"time": (cost, "s")})
        assert progress.STATES.index(record.state) >= progress.STATES.index(before[0])
        assert record.best.get("time", {"value": float("inf")})["value"] <= before[1]
    assert record.attempts == len(attempts)
    right = [cost for passed, cost in attempts if passed]
    assert record.state == ("solved" if right else "attempted" if attempts else "not_attempted")
    assert record.best == ({"time": {"value": min(right), "unit": "s"}} if right else {})


@pytest.mark.parametrize("state", progress.STATES)
def test_a_field_of_a_later_revision_is_not_damage(file: Path, state: str) -> None:
    file.parent.mkdir()
    entry = {"state": state, "attempts": 2, "colour": "blue"}
    file.write_text(json.dumps({"schema": progress.SCHEMA, "exercises": {"fk3": entry}}))
    loaded = progress.load(file)
    assert loaded.notices == ()
    assert loaded.of("fk3").attempts == 2


def test_a_derivation_a_lab_and_a_design_have_their_badges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from click.testing import CliRunner

    from course import derivations
    from drills import notebook
    from drills.cli import cli

    path = tmp_path / "progress.json"
    monkeypatch.setenv("DRILLS_PROGRESS", str(path))
    requested = derivations.formula("deep_queue")
    assert not notebook.answer("deep_queue", " ") and not path.exists()
    assert not notebook.answer("deep_queue", next(iter(requested.slips)))
    notebook.tried("lab", "late_messages", 0)
    notebook.tried("design", "nightly_fleet", 0, True)
    text = repr(notebook.badges(0))
    assert "◐ derivation/deep_queue: attempted" in text and "◐ lab/late_messages" in text
    assert "● design/nightly_fleet: solved" in text
    assert notebook.answer("deep_queue", requested.expression)
    notebook.answer("deep_queue", next(iter(requested.slips)))  # run again: what is solved stays so
    assert "● derivation/deep_queue: solved" in repr(notebook.badges(0))
    out = CliRunner().invoke(cli, ["status"]).output
    assert "● derivation/deep_queue" in out.replace("[x]", "●")
    with pytest.raises(ValueError, match=r"kind must be .*, got 'quiz'"):
        notebook.tried("quiz", "x", 0)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["chapters"]["0"]["tried"]["lab/late_messages"] = "perhaps"
    path.write_text(json.dumps(content), encoding="utf-8")
    assert "damaged" in progress.load(path).notices[0]
