"""The cheat sheet on paper: printed by a browser, it is one page."""

from __future__ import annotations

import re
import subprocess

import pytest

from course.interview import tables
from tests.conftest import chromium

pytestmark = pytest.mark.browser

BROWSER = chromium()


@pytest.mark.parametrize(("rows", "pages"), [(1, 1), (3, 2)])
def test_the_cheat_sheet_is_one_page(tmp_path, rows: int, pages: int) -> None:
    """One page as it is; with every row three times it is more, so that the count counts."""
    body = re.sub(r"<tr><td>.*</tr>", lambda row: rows * row[0], tables.page())
    (tmp_path / "page.html").write_text(body, encoding="utf-8")
    flags = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        f"--user-data-dir={tmp_path / 'profile'}",
        "--no-pdf-header-footer",
        f"--print-to-pdf={tmp_path / 'page.pdf'}",
    ]
    command = [str(BROWSER), *flags, (tmp_path / "page.html").as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    result = len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes()))
    assert result == 1 if pages == 1 else result >= pages
