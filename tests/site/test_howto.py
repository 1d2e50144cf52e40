"""The code of the how-to pages runs as it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from course.site import notebooks
from tests.budget import ROOT

FOLDER = ROOT / "docs" / "howto"
PAGES = sorted(FOLDER.glob("*.md"))
CI = FOLDER / "drills_in_ci.md"


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.S | re.M)


def test_every_page_is_on_the_site() -> None:
    assert set(PAGES) <= set(notebooks.TEXTS.values())


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_python_of_a_page_runs(page: Path) -> None:
    """All of its blocks, one after the other; what they assert holds."""
    code = "\n".join(blocks(page, "python"))
    assert code
    exec(compile(code, str(page), "exec"), {"__name__": "howto"})


@pytest.mark.slow
def test_a_drill_is_graded_as_the_page_says(tmp_path: Path) -> None:
    (answer,), (command,) = blocks(CI, "python"), blocks(CI, "sh")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "DRILLS_PROGRESS": "none"}
    for text, expected in ((answer, 0), (answer.replace("np.cumsum(thetas)", "thetas"), 1)):
        (tmp_path / "fk3.py").write_text(text, "utf-8")
        done = subprocess.run(
            command.split(), cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == expected, done.stdout + done.stderr
