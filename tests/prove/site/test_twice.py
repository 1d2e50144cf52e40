"""Two builds of one commit are the same to the byte."""

import hashlib
from pathlib import Path

from tests.site.conftest import built


def digests(folder: Path) -> dict[str, str]:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


def test_two_builds_are_equal(tmp_path: Path) -> None:
    """In other folders, with other hashes, on another day and in another zone."""
    first, second = tmp_path / "one" / "site", tmp_path / "another place" / "site"
    for folder, environment in (
        (first, {"PYTHONHASHSEED": "1", "TZ": "UTC", "LANG": "C.UTF-8"}),
        (second, {"PYTHONHASHSEED": "2", "TZ": "Asia/Tokyo", "LANG": "de_DE.UTF-8"}),
    ):
        folder.parent.mkdir()
        done = built(folder, **environment)
        assert done.returncode == 0, done.stderr
    report = digests(first)
    assert len(report) > 150
    assert digests(second) == report
