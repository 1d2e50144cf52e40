"""The tiers of the tests, their topics, and what they need from the machine.

Markers say where a test runs. They stand at the test, or in `pytestmark` of its file:

    slow      takes seconds: `make check` leaves it out.
    prove     takes long: only `make prove` runs it, as it does all of `tests/prove`.
    optional  needs a library that `make test` does not install. Without it the test is skipped
              with a sentence; where COURSE_REQUIRE_OPTIONAL is 1 that is a failure.
    browser   drives Chromium. Without it the test is skipped; where COURSE_REQUIRE_BROWSER is 1
              that is a failure.
    smoke     the framework that every topic stands on: it runs with `--topic` as well.
    topic     names the topic of a test over all chapters, which is otherwise its folder's.

`--topic contact` runs the tests of one topic and the smoke tests. COURSE_PROVE=1 runs the long tier
as well: what is marked `prove`, and every property with ten times as many examples, sampled with
the SEED of `make prove`.
"""

import gc
import importlib.util
import os
import shutil
import signal
from collections.abc import Generator
from pathlib import Path

import hypothesis
import pytest

from tests.budget import CHAPTER, PROVE, ROOT, TOPICS, topic_of

# Small matrices are slower with threads, and threads that wait for each other use processor time.
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
# A learner's own settings are not for the tests, which make work folders of their own.
for _name in [name for name in os.environ if name.startswith("DRILLS_")]:
    del os.environ[_name]

# A shell may start what runs in its background with Ctrl-C ignored, and every child inherits that.
# The tests of an interrupt need the handler that Python installs otherwise.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# `make test` samples the same examples every time, and `make prove SEED=2` others than with seed 1.
# With pytest alone, without --hypothesis-seed, each run of the long tier samples new ones. Where CI
# is set, the library's own profile would ignore the seed.
hypothesis.settings.register_profile("test", derandomize=True, deadline=None, database=None)
hypothesis.settings.register_profile("prove", derandomize=False, deadline=None, print_blob=True)
hypothesis.settings.load_profile("prove" if PROVE else "test")

MARKERS = (
    "slow: takes seconds; make check leaves it out",
    "prove: takes long; only make prove runs it",
    "optional: needs a library that make test does not install",
    "browser: drives Chromium",
    "smoke: part of the framework that every topic stands on",
    "topic(name): the topic of a test over all chapters",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--topic", help="run the tests of this topic, and the smoke tests")


def pytest_configure(config: pytest.Config) -> None:
    for marker in MARKERS:
        config.addinivalue_line("markers", marker)


# --- Which tests run ------------------------------------------------------------------------------


def _waits(path: Path) -> bool:
    return (
        path.is_relative_to(ROOT / "tests" / "site")
        or path == ROOT / "tests/notebooks/test_browser.py"
    )


def _topic(item: pytest.Item) -> str:
    marker = item.get_closest_marker("topic")
    if marker:
        return marker.args[0]
    # A claim, a card, a question: a test over all of them belongs to the chapter of each.
    callspec = getattr(item, "callspec", None)
    for value in callspec.params.values() if callspec else ():
        if isinstance(getattr(value, "chapter", None), int):
            return CHAPTER[value.chapter]
    return topic_of(item.path.relative_to(ROOT).as_posix())


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(ROOT / "tests" / "prove"):
            item.add_marker("prove")
    topic = config.getoption("--topic")
    if topic:
        known = sorted({*TOPICS, *map(_topic, items)})
        if topic not in known:
            raise pytest.UsageError(f"topic must be one of {', '.join(known)}, got {topic!r}")

    def selected(item: pytest.Item) -> bool:
        in_tier = PROVE or item.get_closest_marker("prove") is None
        of_topic = not topic or _topic(item) == topic or item.get_closest_marker("smoke")
        return bool(in_tier and of_topic)

    config.hook.pytest_deselected(items=[item for item in items if not selected(item)])
    # What waits for a browser or for the site comes first: as the last it would run alone.
    items[:] = sorted(filter(selected, items), key=lambda item: not _waits(item.path))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect the tests without looking for garbage: what they import stays until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    if collection_path == ROOT / "tests" / "prove" and not PROVE:
        return True
    return None


# --- What a test needs from the machine -----------------------------------------------------------


def chromium() -> str | None:
    """Return the path of a Chromium, from COURSE_CHROMIUM or the usual names."""
    names = [os.environ.get("COURSE_CHROMIUM", ""), "chromium", "chromium-browser", "google-chrome"]
    return next((path for name in names if name and (path := shutil.which(name))), None)


def why_no_browser() -> str:
    """Return what the browser tests lack, or nothing."""
    if importlib.util.find_spec("playwright") is None:
        return "the package playwright is not installed"
    return "" if chromium() else "Chromium was not found"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    # Before any fixture starts the browser.
    if item.get_closest_marker("browser") and (reason := why_no_browser()):
        if os.environ.get("COURSE_REQUIRE_BROWSER") == "1":
            pytest.fail(f"a browser is required: {reason}", pytrace=False)
        pytest.skip(f"the browser test did NOT run: {reason}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item):
    report = yield
    required = os.environ.get("COURSE_REQUIRE_OPTIONAL") == "1"
    if report.skipped and required and item.get_closest_marker("optional"):
        report.outcome = "failed"
        report.longrepr = f"an optional test was skipped where it is required: {report.longrepr}"
    return report
