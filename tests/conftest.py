"""The environment of the tests; those in a browser run where there is one, and say so if not."""

import importlib.util
import os
import shutil
from pathlib import Path

# A learner's own settings are not for the tests, which make work folders of their own.
for _name in [name for name in os.environ if name.startswith("DRILLS_")]:
    del os.environ[_name]


def chromium() -> str | None:
    """The path of a Chromium, from COURSE_CHROMIUM or the usual names."""
    names = [os.environ.get("COURSE_CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome"]
    return next((path for name in names if name and (path := shutil.which(name))), None)


def why_no_browser() -> str:
    """What the browser test lacks, or nothing."""
    if importlib.util.find_spec("playwright") is None:
        return "the package playwright is not installed"
    return "" if chromium() else "Chromium not found"


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    # A run that names the file itself is not asked: there a missing browser fails.
    required = os.environ.get("COURSE_REQUIRE_BROWSER") == "1"
    if collection_path.name == "test_browser.py" and why_no_browser() and not required:
        return True
    return None


def pytest_terminal_summary(terminalreporter) -> None:
    reason = why_no_browser()
    if reason and os.environ.get("COURSE_REQUIRE_BROWSER") != "1":
        terminalreporter.write_line(f"browser test did NOT run: {reason}", yellow=True, bold=True)
