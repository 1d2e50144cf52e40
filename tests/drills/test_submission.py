"""Reading a submission from disk: regular files of UTF-8, and a sentence for all else."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from drills.sandbox import Unreadable, decode_submission, read_submission

pytestmark = pytest.mark.smoke


def test_submission_is_read(tmp_path: Path) -> None:
    path = tmp_path / "answer.py"
    path.write_bytes(b"\xef\xbb\xbfx = '\xc3\xa4'\r\n")
    assert read_submission(path) == "x = 'ä'\r\n"
    path.write_bytes(b"")
    assert read_submission(path) == ""


@pytest.mark.parametrize(
    ("data", "word"),
    [
        ("x = 1".encode("utf-16"), "UTF-16"),
        ("x = 1".encode("utf-16-le"), "UTF-16"),
        ("x = 1".encode("utf-32"), "UTF-32"),
        (b"\n\nx = '\xe4'", "Line 3"),
        (b"x = 1\n\0", "NUL"),
        (b"# -*- coding: latin-1 -*-\nx = 1", "latin-1"),
        (b"#!/usr/bin/python\n# coding=cp1252\n", "cp1252"),
        (b"# coding: klingon\n", "klingon"),
        (b"#" * 1_000_001, "1 MB"),
        (b"x = '\xed\xa0\x80'", "UTF-8"),
    ],
)
def test_other_encodings_are_named(data: bytes, word: str) -> None:
    with pytest.raises(Unreadable) as caught:
        decode_submission(data)
    assert word in caught.value.sentence


def test_coding_line_of_utf8_is_fine() -> None:
    assert decode_submission(b"# -*- coding: utf-8 -*-\nx = 1").endswith("x = 1")


def test_only_regular_files_are_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("x = 1")
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "big").write_bytes(b"#" * 1_000_001)
    words = {
        "pipe": "named pipe",
        "link": "symbolic link",
        "loop": "symbolic link",
        "absent": "no file",
        "big": "1.0 MB",
        ".": "folder",
        "file/x": "can't be opened",
        "nul\0": "NUL",
    }
    for name, word in words.items():
        with pytest.raises(Unreadable) as caught:
            read_submission(f"{tmp_path}/{name}")
        assert word in caught.value.sentence, name
    for device in ("/dev/zero", "/dev/null"):
        with pytest.raises(Unreadable, match="device"):
            read_submission(device)
